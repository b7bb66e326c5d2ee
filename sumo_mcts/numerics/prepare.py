"""Compiles what is needed before it is needed: in the order that a trial shows, and in two
processes side by side."""

import gc
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
from sumo_mcts.numerics.announce import teller, unannounced
from sumo_mcts.numerics.kept import LONGEST_WAIT_S, POLL_S
from sumo_mcts.numerics.kernel import Kernel, Part, Types
from sumo_mcts.process.supervisor import die_with_parent

FEW = 8  # kernels that are compiled here alone: until then a second process has only just started


class Task(NamedTuple):
    """A kernel that is to be compiled for certain types of arguments."""

    kernel: Kernel
    wanted: Types
    calls: set[Kernel]  # which are compiled before

    def is_done(self) -> bool:
        """Whether it is kept."""
        kept = self.kernel.kept(self.wanted)
        return kept is not None and kept.is_there()

    def is_free(self) -> bool:
        """Whether no other process is compiling it."""
        kept = self.kernel.kept(self.wanted)
        return kept is None or not kept.is_taken()


def prepare(use: Callable[[], object]) -> None:
    """Call `use`, and have everything compiled that it calls and that is not kept yet; in that call
    this runs as plain Python. Raises what `use` raises."""
    if kernel.is_plain() or kernel.folder() is None:
        use()
        return
    trial = _Trial()
    try:
        with kernel.tried(trial.run), np.errstate(all="ignore"):  # as compiled code does
            use()
    finally:
        tasks = trial.tasks()
        missing = [task for task in tasks if not task.is_done()]
        with _assisted(missing), _no_collection():
            _work_off(missing)
        for task in tasks:
            if not isinstance(task.kernel, Part):
                task.kernel.compile(task.wanted)  # loaded, unless the other process failed


class _Trial:
    """A run as plain Python shows which kernels are needed, and which of them call which."""

    def __init__(self) -> None:
        self._done: dict[Kernel, Task] = {}  # those that are called before those that call them
        self._running: list[Task] = []

    def run(self, called: Kernel, args: Sequence[Any]) -> Any:
        """Run a kernel as plain Python, and note it."""
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
        """Python calls it with just these types, a kernel with more general ones."""
        exact = called.types_of(args)
        return tuple(map(kernel.general, exact)) if self._running else exact

    def tasks(self) -> list[Task]:
        """What is to be compiled, first what has the longest chain of callers: the search cannot be
        begun before the last of them is done."""
        above: dict[Kernel, int] = {}
        for caller, task in reversed(self._done.items()):
            for called in task.calls:
                above[called] = max(above.get(called, 0), above.get(caller, 0) + 1)
        return sorted(self._done.values(), key=lambda task: -above.get(task.kernel, 0))


@contextmanager
def _no_collection() -> Iterator[None]:
    """Meanwhile no garbage is looked for, which takes a twentieth of the time and finds none."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def _work_off(tasks: Sequence[Task]) -> None:
    """Compile, each after what it calls, what no other process has compiled or is compiling, until
    all is done."""
    left = {task.kernel: task for task in tasks}
    idle_since = time.monotonic()
    while left:
        left = {each: task for each, task in left.items() if not task.is_done()}
        teller().plans((len(tasks) - len(left), len(tasks)))
        ready = next(
            (task for task in left.values() if not task.calls & left.keys() and task.is_free()),
            None,
        )
        if ready is not None:
            ready.kernel.compile(ready.wanted)
            left.pop(ready.kernel)  # whether it could be kept or not
            idle_since = time.monotonic()
        elif time.monotonic() - idle_since > LONGEST_WAIT_S:
            break
        elif left:
            teller().waits(time.monotonic() - idle_since)
            time.sleep(POLL_S)
    teller().plans(None)


# --- the second process ---

_Name = tuple[str, str]  # module and function
_Told = tuple[
    int, Path, list[tuple[_Name, Types, list[_Name]]]
]  # the process that asks, the folder, the tasks
_PROGRAM = """
import pickle, sys
sys.path[:] = pickle.load(sys.stdin.buffer)
from sumo_mcts.numerics.prepare import assist
assist(pickle.load(sys.stdin.buffer))
"""


@contextmanager
def _assisted(tasks: Sequence[Task]) -> Iterator[None]:
    """Meanwhile a second process works on the same tasks, where that is of use and possible."""
    helper = _helper() if len(tasks) > FEW else None
    if helper is None:
        yield
        return
    named = [
        (_name(task.kernel), task.wanted, [_name(each) for each in task.calls]) for task in tasks
    ]
    try:
        with suppress(OSError), cast(Any, helper.stdin) as pipe:  # it may have failed already
            pipe.write(pickle.dumps(sys.path) + pickle.dumps((os.getpid(), kernel.folder(), named)))
        yield
    finally:
        helper.kill()
        helper.wait()


def _helper() -> "subprocess.Popen[bytes] | None":
    """A process that waits for tasks, in a group of its own, since an interrupt is our matter.

    None where there is no room for one.
    """
    if (
        not hasattr(os, "sched_getaffinity")
        or len(os.sched_getaffinity(0)) < 2
        or not sys.executable
    ):
        return None
    try:
        command = [
            sys.executable,
            "-I",
            "-c",
            _PROGRAM,
        ]  # isolated: nothing is imported from where the user happens to be
        return subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            process_group=0,
        )
    except OSError:
        return None


def assist(told: _Told) -> None:
    """What the second process does: work on the tasks."""
    asks, where, named = told
    die_with_parent()
    if os.getppid() != asks:  # it has died already
        return
    kernel.keep_in(where)
    with unannounced(), _no_collection():
        _work_off(
            [Task(_named(name), wanted, set(map(_named, calls))) for name, wanted, calls in named]
        )


def _name(one: Kernel) -> _Name:
    return one.py_func.__module__, one.py_func.__name__


def _named(name: _Name) -> Kernel:
    return cast(Kernel, getattr(importlib.import_module(name[0]), name[1]))
