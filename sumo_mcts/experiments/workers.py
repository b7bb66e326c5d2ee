"""The processes that drive the episodes of a batch, behind `concurrent.futures.Executor`: of this
machine, or of a dask cluster."""

import logging
import multiprocessing
import os
import queue
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as ended
from multiprocessing.context import SpawnProcess
from typing import Any, NamedTuple, ParamSpec, TypeVar

from sumo_mcts import records
from sumo_mcts.errors import ConfigError, in_one_line
from sumo_mcts.experiments.experiment import DECIDING
from sumo_mcts.process.supervisor import die_with_parent, silence_libraries

PATIENCE_S = 3.0  # from the request to end until a worker is killed
# tasks of one process, then a new one takes over: it grows by 4 MB in a hundred episodes
LONGEST = 200
ANSWER_S = 20.0  # for a scheduler, whatever it is asked
AHEAD = 2  # episodes handed out for each worker: one that it drives, and the next

_P = ParamSpec("_P")
_T = TypeVar("_T")
_Task = tuple[Future[Any], tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]]


class DeadWorkerError(Exception):
    """The process that was at work is gone.

    `shortage`: it was killed from outside, as a system without memory does.
    """

    def __init__(self, message: str, *, shortage: bool = False) -> None:
        super().__init__(message)
        self.shortage = shortage


class SilentWorkerError(Exception):
    """The process that was at work gave no answer in time, and was ended."""


class Crew(NamedTuple):
    """An executor, and what a batch needs to know about it."""

    executor: Executor
    most: Callable[[], int]  # how many episodes to hand out at a time
    deaths: type[Exception]  # what a future raises where its worker crashed


def cores() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def here() -> Iterator[Crew]:
    """This process alone: a task is done as soon as it is handed out."""
    yield Crew(_Alone(), lambda: 1, DeadWorkerError)


@contextmanager
def local(count: int, patience_s: float | None = None) -> Iterator[Crew]:
    """`count` processes of this machine.

    They end with the context, whatever they are doing. `patience_s`: how long a task may take, s.
    """
    pool = LocalPool(count, patience_s=patience_s)
    try:
        yield Crew(pool, lambda: AHEAD * count, DeadWorkerError)
    finally:
        pool.shutdown(cancel_futures=True)


@contextmanager
def cluster(address: str) -> Iterator[Crew]:
    """The workers of a dask.distributed scheduler.

    Raises ConfigError where there are none such, or other versions than here.

    A scheduler that is there and answers nothing is given up after ANSWER_S, then and later.
    """
    try:
        from distributed import Client
        from distributed.scheduler import KilledWorker
    except ImportError:
        raise ConfigError("--scheduler: needs dask.distributed: pip install distributed") from None
    with _without_logging("distributed"):
        try:
            client: Any = _answer(lambda: Client(address, timeout=ANSWER_S, set_as_default=False))  # type: ignore[no-untyped-call]
        except (OSError, ValueError) as error:
            raise ConfigError(
                f"--scheduler {address}: no scheduler answers: {in_one_line(error)}"
            ) from None
        try:
            _check_workers(client, address)
            executor = client.get_executor(pure=False)
            yield Crew(
                executor, lambda: AHEAD * max(1, len(_answer(client.nthreads))), KilledWorker
            )
        finally:
            with suppress(OSError):
                _answer(client.close)


def _answer(ask: Callable[[], _T]) -> _T:
    """What a call to a scheduler returns.

    Raises TimeoutError where nothing comes within ANSWER_S, whatever time limits the library has.
    """
    answer: Future[_T] = Future()

    def wait() -> None:
        try:
            answer.set_result(ask())
        except BaseException as error:
            answer.set_exception(error)

    threading.Thread(target=wait, daemon=True).start()
    try:
        return answer.result(ANSWER_S)
    except TimeoutError as error:
        raise TimeoutError(f"no answer within {ANSWER_S:g} s") from error


@contextmanager
def _without_logging(package: str) -> Iterator[None]:
    """Inside the block a package logs nothing. Its messages about a lost scheduler, with
    tracebacks, become one line."""
    known = [
        logging.getLogger(name)
        for name in list(logging.root.manager.loggerDict)
        if name.partition(".")[0] == package
    ]
    enabled = [logger for logger in known if not logger.disabled]
    for logger in enabled:
        logger.disabled = True
    try:
        yield
    finally:
        for logger in enabled:
            logger.disabled = False


def _check_workers(client: Any, address: str) -> None:
    """Raise ConfigError where the results of a worker would differ from those of this process.

    One SUMO runs in a process, so a worker has to have one thread.
    """
    threads = _answer(client.nthreads)
    if any(count != 1 for count in threads.values()):
        raise ConfigError(
            f"--scheduler {address}: a worker has {max(threads.values())} threads; start them with "
            "--nthreads 1 (and --nworkers N)"
        )
    here = records.versions()
    for worker, there in _answer(lambda: client.run(records.versions)).items():
        for name in DECIDING:
            if there[name] != here[name]:
                raise ConfigError(
                    f"--scheduler {address}: {name} is {there[name]} on worker {worker}, "
                    f"{here[name]} here"
                )


class _Alone(Executor):
    def submit(self, fn: Callable[_P, _T], /, *args: _P.args, **kwargs: _P.kwargs) -> Future[_T]:
        future: Future[_T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class LocalPool(Executor):
    """Processes (spawned, not forked). If a process crashes, its task fails and a new process is
    started.

    `ProcessPoolExecutor` instead fails all tasks, and does not report which process crashed.
    """

    def __init__(self, count: int, longest: int = LONGEST, patience_s: float | None = None) -> None:
        """`longest`: tasks of one process; `patience_s`: how long a task may take, s."""
        self._longest, self._patience_s = longest, patience_s
        self._tasks: queue.SimpleQueue[_Task | None] = queue.SimpleQueue()
        self._scratch = tempfile.TemporaryDirectory(prefix="sumo_mcts-", ignore_cleanup_errors=True)
        self._workers: dict[int, _Worker] = {}  # at work or waiting for it
        self._lock = threading.Lock()
        self._ending = self._cancelled = False
        if sys.platform != "win32":
            # its start would unblock the signal that _tend blocks
            resource_tracker.ensure_running()
        self._threads = [
            threading.Thread(target=self._tend, args=(k,), daemon=True) for k in range(count)
        ]
        for thread in self._threads:
            thread.start()

    def pids(self) -> list[int]:
        """The processes that there are now."""
        with self._lock:
            return [worker.process.pid or 0 for worker in self._workers.values()]

    def submit(self, fn: Callable[_P, _T], /, *args: _P.args, **kwargs: _P.kwargs) -> Future[_T]:
        """Hand out a task; its future raises DeadWorkerError where the process is gone before it is
        done, SilentWorkerError where it takes too long."""
        if self._ending:
            raise RuntimeError("the pool has been shut down")
        future: Future[_T] = Future()
        self._tasks.put((future, (fn, args, kwargs)))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes: after all tasks, or at once with `cancel_futures`, those at work
        too."""
        self._ending = True
        if cancel_futures:
            self._end_now()
        for _ in self._threads:
            self._tasks.put(None)
        for thread in self._threads if wait or cancel_futures else ():
            thread.join()
        if wait or cancel_futures:
            self._scratch.cleanup()

    def _end_now(self) -> None:
        """Take back what is not begun, and end the processes; those that do not end are killed."""
        with self._lock:
            self._cancelled = True
            processes = [worker.process for worker in self._workers.values()]
        with suppress(queue.Empty):
            while task := self._tasks.get_nowait():
                task[0].cancel()
        for process in processes:
            process.terminate()
        until = time.monotonic() + PATIENCE_S
        left = {process.sentinel: process for process in processes}
        while left and time.monotonic() < until:
            for sentinel in ended(list(left), until - time.monotonic()):
                del left[sentinel]  # type: ignore[arg-type]  # sentinels are what we wait for
        for process in left.values():
            process.kill()

    def _tend(self, number: int) -> None:
        """Give one worker its tasks, one at a time."""
        if sys.platform != "win32":
            # the process inherits that: these signals are for the main process alone
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
        while (task := self._tasks.get()) is not None:
            future, call = task
            if future.set_running_or_notify_cancel():
                try:
                    done, value = self._worker(number).ask(call, self._patience_s)
                except (DeadWorkerError, SilentWorkerError) as error:
                    self._drop_worker(number)
                    done, value = False, error
                except Exception as error:  # what cannot be pickled
                    done, value = False, error
                (future.set_result if done else future.set_exception)(value)
                if number in self._workers and self._workers[number].answered >= self._longest:
                    self._drop_worker(number)
        self._drop_worker(number)

    def _worker(self, number: int) -> "_Worker":
        # starting processes from several threads at a time is not promised to work
        with self._lock:
            if self._cancelled:
                raise DeadWorkerError("the pool was shut down")
            if number not in self._workers:
                self._workers[number] = _Worker(self._scratch.name)
            return self._workers[number]

    def _drop_worker(self, number: int) -> None:
        with self._lock:
            worker = self._workers.pop(number, None)
        if worker is not None:
            worker.end()


class _Worker:
    """One process and the pipe to it."""

    def __init__(self, scratch: str) -> None:
        context = multiprocessing.get_context("spawn")
        self.answered = 0
        self._pipe, theirs = context.Pipe()
        self._scratch = tempfile.TemporaryDirectory(dir=scratch, ignore_cleanup_errors=True)
        self.process: SpawnProcess = context.Process(
            target=_work, args=(theirs, self._scratch.name), daemon=True
        )
        self.process.start()
        theirs.close()  # so that the pipe ends with the process

    def ask(self, call: object, patience_s: float | None) -> tuple[bool, Any]:
        """Whether the call returned, and its value or exception.

        Raises DeadWorkerError, and SilentWorkerError after `patience_s`; None: never.
        """
        try:
            self._pipe.send(call)
            if not self._pipe.poll(patience_s):
                self.process.kill()  # it may be stopped, or in code that no other signal ends
                raise SilentWorkerError(f"no end within {patience_s:g} s (--episode-timeout)")
            answer: tuple[bool, Any] = self._pipe.recv()
        except (EOFError, OSError):
            self.process.join(PATIENCE_S)
            code = self.process.exitcode
            raise DeadWorkerError(
                f"the worker died ({_cause(code)})", shortage=code == -signal.SIGKILL
            ) from None
        self.answered += 1
        return answer

    def end(self) -> None:
        """End the process, which has no more tasks, or has crashed."""
        self._pipe.close()
        self.process.join(PATIENCE_S)
        if self.process.exitcode is None:
            self.process.kill()
            self.process.join()
        self._scratch.cleanup()


def _cause(code: int | None) -> str:
    if code is None or code >= 0:
        return f"exit status {code}"
    names = {number.value: number.name for number in signal.Signals}
    return names.get(-code, f"signal {-code}")


def _work(pipe: Connection, scratch: str) -> None:
    """What a worker process does: answer calls until the other end of the pipe is closed.

    Its temporary files lie in `scratch`, so that the main process can remove them.
    """
    tempfile.tempdir = scratch
    silence_libraries()
    die_with_parent()
    try:
        while True:
            fn, args, kwargs = pipe.recv()
            try:
                answer = (True, fn(*args, **kwargs))
            except Exception as error:
                answer = (False, error)
            pipe.send(answer)
    except (EOFError, OSError):  # it is closed
        pass
