"""The same batch on a real dask.distributed cluster: two worker processes, one of which is killed
on the way."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers_batch import SMALL, timeless, write

from sumo_mcts import run_batch
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments import workers
from sumo_mcts.experiments.problems import BatchError
from sumo_mcts.experiments.progress import Progress
from sumo_mcts.experiments.workers import cluster
from sumo_mcts.records import read_rows

pytest.importorskip("distributed")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),  # of dask's own dependencies
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]


def dask(folder: Path, *words: str) -> subprocess.Popen[bytes]:
    environment = {**os.environ, "DASK_DISTRIBUTED__WORKER__MEMORY__TERMINATE": "False"}
    with (folder / f"{words[0]}.log").open("ab") as log:
        return subprocess.Popen(
            [sys.executable, "-m", "dask", *words, "--no-dashboard"],
            stdout=log,
            stderr=log,
            cwd=folder,
            env=environment,
        )


@pytest.fixture
def address(tmp_path: Path) -> Iterator[str]:
    """A scheduler without workers."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    scheduler = dask(tmp_path, "scheduler", "--host", "127.0.0.1", "--port", str(port))
    yield f"tcp://127.0.0.1:{port}"
    scheduler.terminate()
    scheduler.wait()


@pytest.mark.slow
def test_a_cluster_gives_the_same(address: str, tmp_path: Path) -> None:
    crew = [
        dask(tmp_path, "worker", address, "--nthreads", "1", "--no-nanny", "--name", str(k))
        for k in range(2)
    ]
    told: list[int] = []

    def kill_one(at: Progress) -> None:
        if at.done >= 2 and not told:
            told.append(at.done)
            os.kill(crew[0].pid, signal.SIGKILL)

    alone = run_batch(write(tmp_path), tmp_path / "alone", jobs=1)
    try:
        rows = run_batch(write(tmp_path), tmp_path / "out", scheduler=address, watch=kill_one)
        assert crew[0].wait(10) == -signal.SIGKILL
        assert len(told) == 1 and told[0] < len(rows)
    finally:
        for worker in crew:
            worker.terminate()
            worker.wait()
    assert timeless(rows) == timeless(alone)
    assert {path.name for path in (tmp_path / "out" / "traces").iterdir()} == {
        path.name for path in (tmp_path / "alone" / "traces").iterdir()
    }


@pytest.mark.slow
def test_a_lost_scheduler_is_told_in_one_line(tmp_path: Path) -> None:
    """By the command itself, whose standard error shows what anybody logs."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    out, address = tmp_path / "out", f"tcp://127.0.0.1:{port}"
    crew = [
        dask(tmp_path, "scheduler", "--host", "127.0.0.1", "--port", str(port)),
        dask(tmp_path, "worker", address, "--nthreads", "1", "--no-nanny"),
    ]
    many = write(tmp_path, SMALL.replace("0..1", "0..99"))
    try:
        from distributed import Client

        with Client(address, timeout=30) as client:
            client.wait_for_workers(1, timeout=30)
        words = [
            sys.executable,
            "-m",
            "sumo_mcts",
            "batch",
            str(many),
            "--out",
            str(out),
            "--scheduler",
            address,
        ]
        batch = subprocess.Popen(
            words, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
        )
        until = time.monotonic() + 60.0
        while len(read_rows(out)) < 2 and time.monotonic() < until:
            time.sleep(0.1)
        crew[0].kill()
        _, told = batch.communicate(timeout=60)
    finally:
        for process in crew:
            process.kill()
            process.wait()
    assert batch.returncode == 1, told
    assert told.splitlines()[-1].startswith("error: the workers are lost (")
    assert told.splitlines()[-1].endswith("; what is done is kept, and the same command goes on")
    assert all(
        line.startswith(("starting SUMO", "compiling")) or " episodes, " in line
        for line in told.splitlines()[:-1]
    )
    assert 2 <= len(read_rows(out)) < 400


@pytest.mark.slow
def test_a_scheduler_that_accepts_and_says_nothing_is_given_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(workers, "ANSWER_S", 3.0)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        began = time.monotonic()
        with (
            pytest.raises(ConfigError, match=rf"--scheduler {address}: no scheduler answers: "),
            cluster(address),
        ):
            pass
    assert time.monotonic() - began < 20.0


@pytest.mark.slow
def test_a_scheduler_that_is_stopped_on_the_way_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "ANSWER_S", 5.0)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    crew = [
        dask(tmp_path, "scheduler", "--host", "127.0.0.1", "--port", str(port)),
        dask(tmp_path, "worker", address, "--nthreads", "1", "--no-nanny"),
    ]
    stopped: list[float] = []

    def stop(at: Progress) -> None:
        if at.done >= 1 and not stopped:
            stopped.append(time.monotonic())
            crew[0].send_signal(signal.SIGSTOP)

    try:
        with pytest.raises(BatchError, match="the workers are lost"):
            run_batch(
                write(tmp_path, SMALL.replace("0..1", "0..49")),
                tmp_path / "out",
                scheduler=address,
                watch=stop,
            )
        assert time.monotonic() - stopped[0] < 60.0
    finally:
        for process in crew:
            process.kill()
            process.wait()


@pytest.mark.slow
def test_an_episode_without_an_end_ends_its_process() -> None:
    code = (
        "from sumo_mcts.experiments import tasks; tasks.drive = lambda *_: "
        "__import__('ctypes').PyDLL(None).sleep(60); tasks.drive_within(1.0, None, None)"
    )
    assert (
        subprocess.run([sys.executable, "-c", code], check=False, timeout=30).returncode
        == -signal.SIGALRM
    )


@pytest.mark.slow
def test_a_worker_with_threads_is_refused(address: str, tmp_path: Path) -> None:
    worker = dask(tmp_path, "worker", address, "--nthreads", "2", "--no-nanny")
    try:
        from distributed import Client

        with Client(address, timeout=30) as client:
            client.wait_for_workers(1, timeout=30)
        with (
            pytest.raises(
                ConfigError, match="a worker has 2 threads; start them with --nthreads 1"
            ),
            cluster(address),
        ):
            pass
    finally:
        worker.terminate()
        worker.wait()
