"""Processes that answer, raise, and die, each of which costs its own task alone."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from helpers_batch import die, echo, raise_value_error

from sumo_mcts.experiments.workers import DeadWorkerError, LocalPool, SilentWorkerError, local


@pytest.mark.slow
def test_answers_exceptions_and_deaths() -> None:
    with LocalPool(2) as pool:
        before = [pool.submit(echo, k) for k in range(3)]
        bad, dead, unsent = (
            pool.submit(raise_value_error),
            pool.submit(die),
            pool.submit(echo, lambda: 0),
        )
        after = [pool.submit(echo, k) for k in range(3)]
        assert [future.result(30) for future in before + after] == [0, 1, 2, 0, 1, 2]
        with pytest.raises(ValueError, match="as asked"):
            bad.result(30)
        with pytest.raises(DeadWorkerError, match=r"the worker died \(exit status 3\)"):
            dead.result(30)
        assert unsent.exception(30) is not None  # a lambda does not travel
        assert len(pool.pids()) <= 2
    with pytest.raises(RuntimeError):
        pool.submit(echo, 0)


def test_the_context_ends_what_is_at_work() -> None:
    with local(2) as crew:
        running = [crew.executor.submit(time.sleep, 60.0) for _ in range(4)]
        pool = crew.executor
        assert isinstance(pool, LocalPool)
        until = time.monotonic() + 30.0
        while len(pool.pids()) < 2 and time.monotonic() < until:
            time.sleep(0.05)
        pids = pool.pids()
        began = time.monotonic()
    assert time.monotonic() - began < 5.0
    assert len(pids) == 2
    assert all(future.done() for future in running)
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


@pytest.mark.slow
def test_a_killed_worker_is_named_with_its_signal() -> None:
    with LocalPool(1) as pool:
        assert pool.submit(echo, 1).result(30) == 1
        slow = pool.submit(time.sleep, 60.0)
        (pid,) = pool.pids()
        os.kill(pid, signal.SIGKILL)
        with pytest.raises(DeadWorkerError, match="SIGKILL"):
            slow.result(30)
        assert pool.submit(echo, 2).result(30) == 2
        assert pool.pids() != [pid]


@pytest.mark.slow
def test_a_process_does_not_grow_old() -> None:
    with LocalPool(1, longest=2) as pool:
        pids = [pool.submit(os.getpid).result(30) for _ in range(4)]
    assert pids[0] == pids[1] != pids[2] == pids[3]


@pytest.mark.slow
def test_a_stopped_process_is_given_up() -> None:
    with LocalPool(1, patience_s=10.0) as pool:
        assert pool.submit(echo, 1).result(30) == 1
        (pid,) = pool.pids()
        os.kill(pid, signal.SIGSTOP)
        with pytest.raises(SilentWorkerError, match=r"no end within 10 s \(--episode-timeout\)"):
            pool.submit(echo, 2).result(30)
        assert pool.submit(echo, 3).result(30) == 3
        assert pool.pids() != [pid]


@pytest.mark.slow
def test_a_process_killed_from_outside_is_a_shortage_and_one_that_crashes_is_none() -> None:
    for number, shortage in ((signal.SIGKILL, True), (signal.SIGSEGV, False)):
        with LocalPool(1) as pool, pytest.raises(DeadWorkerError, match=number.name) as death:
            pool.submit(signal.raise_signal, number).result(30)
        assert death.value.shortage == shortage


ORPHAN = """
import sys, time
from sumo_mcts.experiments.workers import LocalPool
if __name__ == "__main__":
    pool = LocalPool(1)
    pool.submit(abs, 1).result()
    print(*pool.pids(), flush=True)
    pool.submit(time.sleep, 60).result()
"""


@pytest.mark.slow
@pytest.mark.skipif(
    sys.platform != "linux", reason="elsewhere a worker notices when its task is done"
)
def test_a_worker_at_work_does_not_outlive_a_parent_that_is_killed(tmp_path: Path) -> None:
    (tmp_path / "parent.py").write_text(ORPHAN)
    with subprocess.Popen(
        [sys.executable, tmp_path / "parent.py"], stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout is not None
        worker = Path("/proc") / parent.stdout.readline().strip()
        assert worker.exists()
        time.sleep(0.2)  # until it sleeps
        parent.kill()
    end = time.monotonic() + 5.0
    while worker.exists() and "\nState:\tZ" not in (worker / "status").read_text():
        assert time.monotonic() < end, "still there"
        time.sleep(0.05)
