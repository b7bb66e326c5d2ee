"""The same batch on a real dask.distributed cluster: two worker processes, one of which is killed on the way."""

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
from sumo_mcts.config import ConfigError
from sumo_mcts.experiments.batch import Progress
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
        return subprocess.Popen([sys.executable, "-m", "dask", *words, "--no-dashboard"], stdout=log, stderr=log, cwd=folder, env=environment)


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


def test_a_cluster_gives_the_same(address: str, tmp_path: Path) -> None:
    crew = [dask(tmp_path, "worker", address, "--nthreads", "1", "--no-nanny", "--name", str(k)) for k in range(2)]
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
    assert {path.name for path in (tmp_path / "out" / "traces").iterdir()} == {path.name for path in (tmp_path / "alone" / "traces").iterdir()}


def test_a_lost_scheduler_is_told_in_one_line(tmp_path: Path) -> None:
    """By the command itself, whose standard error shows what anybody logs."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    out, address = tmp_path / "out", f"tcp://127.0.0.1:{port}"
    crew = [dask(tmp_path, "scheduler", "--host", "127.0.0.1", "--port", str(port)), dask(tmp_path, "worker", address, "--nthreads", "1", "--no-nanny")]
    many = write(tmp_path, SMALL.replace("0..1", "0..99"))
    try:
        from distributed import Client

        with Client(address, timeout=30) as client:
            client.wait_for_workers(1, timeout=30)
        words = [sys.executable, "-m", "sumo_mcts", "batch", str(many), "--out", str(out), "--scheduler", address]
        batch = subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
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
    assert all(line.startswith(("starting SUMO", "compiling")) or " episodes, " in line for line in told.splitlines()[:-1])
    assert 2 <= len(read_rows(out)) < 400


def test_a_worker_with_threads_is_refused(address: str, tmp_path: Path) -> None:
    worker = dask(tmp_path, "worker", address, "--nthreads", "2", "--no-nanny")
    try:
        from distributed import Client

        with Client(address, timeout=30) as client:
            client.wait_for_workers(1, timeout=30)
        with pytest.raises(ConfigError, match="a worker has 2 threads; start them with --nthreads 1"), cluster(address):
            pass
    finally:
        worker.terminate()
        worker.wait()
