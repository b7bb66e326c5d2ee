"""Compiles kernels before they are needed, in two processes.

A trial in plain Python shows which kernels are needed, and in which order to compile them.
"""

import importlib
import os
import pickle
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from sumo_mcts.numerics import kernel
from sumo_mcts.numerics.announce import announcer, unannounced
from sumo_mcts.numerics.kept import LONGEST_WAIT_S, POLL_S
from sumo_mcts.numerics.kernel import Kernel, Part, Types
from sumo_mcts.process.garbage import no_collection
from sumo_mcts.process.supervisor import die_with_parent

FEW = 8  # kernels up to which this process compiles alone: a second one would start too late


class Task(NamedTuple):
    """A kernel to compile for certain types of arguments."""

    kernel: Kernel
    wanted: Types
    calls: set[Kernel]  # the kernels that it calls, which are compiled before it

    def is_done(self) -> bool:
        """Whether the compiled kernel is on disk."""
        kept = self.kernel.kept(self.wanted)
        return kept is not None and kept.is_there()

    def is_free(self) -> bool:
        """Whether no other process is compiling it."""
        kept = self.kernel.kept(self.wanted)
        return kept is None or not kept.is_taken()


def prepare(use: Callable[[], object]) -> None:
    """Compile all kernels that `use` calls and that are not on disk yet.

    For this `use` is called once, and those kernels run as plain Python. Raises what `use` raises.
    """
    if kernel.is_plain() or kernel.folder() is None:
        use()
        return
    trial = _Trial()
    try:
        with kernel.tried(trial.run), np.errstate(all="ignore"):  # as in compiled code
            use()
    except Exception:  # what failed may be compiled code yet; an interrupt ends it at once
        _compile_found(trial.tasks())
        raise
    _compile_found(trial.tasks())


def _compile_found(tasks: Sequence[Task]) -> None:
    """Compile or load the kernels that a trial has found."""
    missing = [task for task in tasks if not task.is_done()]
    with _assisted(missing), no_collection():
        _compile_all(missing)
    for task in tasks:
        if not isinstance(task.kernel, Part):
            task.kernel.compile(task.wanted)  # loaded, unless the other process failed


class _Trial:
    """Records which kernels a run in plain Python calls, and which kernels these call."""

    def __init__(self) -> None:
        self._done: dict[Kernel, Task] = {}  # a called kernel before its callers
        self._running: list[Task] = []  # the call stack of kernels

    def run(self, called: Kernel, args: Sequence[Any]) -> Any:
        """Run a kernel as plain Python, and record it."""
        if self._running:
            self._running[-1].calls.add(called)
        task = self._done.get(called) or Task(called, self._wanted(called, args), set())
        self._running.append(task)
        try:
            return called.py_func(*args)
        finally:
            self._running.pop()
            self._done.setdefault(called, task)

    def _wanted(self, called: Kernel, args: Sequence[Any]) -> Types:
        """The types to compile for: exact for a call from Python, general for one from a kernel."""
        exact = called.types_of(args)
        return tuple(map(kernel.general, exact)) if self._running else exact

    def tasks(self) -> list[Task]:
        """The kernels to compile, first those with the longest chain of callers.

        A caller waits for the kernels that it calls, so the longest chain decides when the search
        can begin.
        """
        above: dict[Kernel, int] = {}  # length of the longest chain of callers
        for caller, task in reversed(self._done.items()):
            for called in task.calls:
                above[called] = max(above.get(called, 0), above.get(caller, 0) + 1)
        return sorted(self._done.values(), key=lambda task: -above.get(task.kernel, 0))


def _compile_all(tasks: Sequence[Task]) -> None:
    """Compile kernels until all are on disk, each one after the kernels that it calls.

    Kernels that another process has compiled, or is compiling, are left out.
    """
    left = {task.kernel: task for task in tasks}
    idle_since = time.monotonic()
    while left:
        left = {each: task for each, task in left.items() if not task.is_done()}
        announcer().plans((len(tasks) - len(left), len(tasks)))
        ready = next(
            (task for task in left.values() if not task.calls & left.keys() and task.is_free()),
            None,
        )
        if ready is not None:
            ready.kernel.compile(ready.wanted)
            left.pop(ready.kernel)  # also where it could not be written
            idle_since = time.monotonic()
        elif time.monotonic() - idle_since > LONGEST_WAIT_S:
            break
        elif left:
            announcer().waits(time.monotonic() - idle_since)
            time.sleep(POLL_S)
    announcer().plans(None)


# --- the second process ---

_Name = tuple[str, str]  # module and function
# Id of the first process, folder of kernels, and for each task: kernel, types, called kernels.
_Request = tuple[int, Path, list[tuple[_Name, Types, list[_Name]]]]
_PROGRAM = """
import pickle, sys
sys.path[:] = pickle.load(sys.stdin.buffer)
from sumo_mcts.numerics.prepare import assist
assist(pickle.load(sys.stdin.buffer))
"""


@contextmanager
def _assisted(tasks: Sequence[Task]) -> Iterator[None]:
    """Inside the block a second process compiles the same tasks, where that saves time."""
    second = _second_process() if len(tasks) > FEW else None
    if second is None:
        yield
        return
    named = [
        (_name(task.kernel), task.wanted, [_name(each) for each in task.calls]) for task in tasks
    ]
    try:
        with suppress(OSError), cast(Any, second.stdin) as pipe:  # it may have ended
            pipe.write(pickle.dumps(sys.path) + pickle.dumps((os.getpid(), kernel.folder(), named)))
        yield
    finally:
        second.kill()
        second.wait()


def _second_process() -> "subprocess.Popen[bytes] | None":
    """A process that reads a request from its standard input.

    It has its own process group, so that Ctrl-C reaches only the first process. None where the
    machine has one core, or the process cannot be started.
    """
    if (
        not hasattr(os, "sched_getaffinity")
        or len(os.sched_getaffinity(0)) < 2
        or not sys.executable
    ):
        return None
    try:
        # -I: isolated, so nothing is imported from the current folder
        command = [sys.executable, "-I", "-c", _PROGRAM]
        return subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            process_group=0,
        )
    except OSError:
        return None


def assist(request: _Request) -> None:
    """The main function of the second process: compile the tasks."""
    first, where, named = request
    die_with_parent()
    if os.getppid() != first:  # the first process has ended already
        return
    kernel.keep_in(where)
    with unannounced(), no_collection():
        _compile_all(
            [Task(_named(name), wanted, set(map(_named, calls))) for name, wanted, calls in named]
        )


def _name(one: Kernel) -> _Name:
    return one.py_func.__module__, one.py_func.__name__


def _named(name: _Name) -> Kernel:
    return cast(Kernel, getattr(importlib.import_module(name[0]), name[1]))
