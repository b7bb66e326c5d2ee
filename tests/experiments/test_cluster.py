"""The same batch on a real dask.distributed cluster: two worker processes, one of which is killed on the way."""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers_batch import timeless, write

from sumo_mcts import run_batch
from sumo_mcts.config import ConfigError
from sumo_mcts.experiments.batch import Progress
from sumo_mcts.experiments.workers import cluster

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
