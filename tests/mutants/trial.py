"""Tests against changed functions, in copies of one process that has collected the tests.

Compilation is off (NUMBA_DISABLE_JIT), so every kernel is a plain function. A change is put in its
place in a copy of the process: no file is written, and nothing is imported or compiled anew.
"""

import gc
import json
import os
import resource
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, NamedTuple

import pytest
from _pytest.runner import runtestprotocol

from .changes import PACKAGE, Mutant, codes, compiled

MEMORY = 8 << 30  # bytes of address space of a copy
PATIENCE = 20.0  # s of real time for each second of computing; the machine may be busy


class Outcome(NamedTuple):
    """What a copy of the process found."""

    failed: str  # the first test that failed; "": none
    seconds: float  # of computing
    reached: tuple[str, ...]  # "path::function" of the package, where that was asked for


class Job(NamedTuple):
    """What one copy of the process does."""

    tests: Sequence[Any]
    limit: float  # s of computing for all of them
    prepare: Callable[[], None]
    watched: dict[int, str] | None = None  # id of code -> "path::function"


def in_copies(jobs: Sequence[Job], at_once: int) -> Iterator[tuple[int, Outcome]]:
    """Run each job in a copy of this process; yields (number of the job, outcome) as they end."""
    waiting, running = list(enumerate(jobs))[::-1], {}
    with tempfile.TemporaryDirectory() as folder:
        while waiting or running:
            while waiting and len(running) < at_once:
                number, job = waiting.pop()
                answer = Path(folder) / str(number)
                running[_forked(job, answer)] = number, job, answer, time.monotonic()
            for pid, (number, job, answer, since) in list(running.items()):
                if time.monotonic() - since > PATIENCE * (job.limit + 1.0):
                    os.kill(pid, signal.SIGKILL)
                if os.waitpid(pid, os.WNOHANG)[0]:
                    del running[pid]
                    yield number, _answer(answer, job)
            time.sleep(0.005)


def _answer(file: Path, job: Job) -> Outcome:
    """What a copy wrote down; one that ended without doing so ran out of time, or crashed."""
    if not file.exists():
        return Outcome("no end", job.limit, ())
    failed, seconds, reached = json.loads(file.read_text(encoding="utf-8"))
    return Outcome(failed, seconds, tuple(reached))


def _forked(job: Job, answer: Path) -> int:
    pid = os.fork()
    if pid:
        return pid
    try:
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, job.limit)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        outcome = _run(job)
        part = answer.with_suffix(".part")
        part.write_text(json.dumps(outcome), encoding="utf-8")
        part.replace(answer)
    finally:
        os._exit(0)


def _run(job: Job) -> Outcome:
    job.prepare()
    reached: set[str] = set()
    if job.watched is not None:
        watched = job.watched

        def notice(frame: Any, event: str, _: object) -> None:
            name = watched.get(id(frame.f_code)) if event == "call" else None
            if name is not None:
                reached.add(name)

        sys.setprofile(notice)
    begun, failed = time.process_time(), ""
    for test in job.tests:
        reports = runtestprotocol(test, log=False, nextitem=None)
        if not any(each.when == "call" and each.passed for each in reports) or any(
            each.failed for each in reports
        ):
            failed = test.nodeid
            break
    sys.setprofile(None)
    return Outcome(failed, time.process_time() - begun, tuple(sorted(reached)))


# --- a change in its place ---


class Functions:
    """The functions of the package that are in memory."""

    def __init__(self) -> None:
        self._all: dict[tuple[str, str, int], list[FunctionType]] = {}
        self.watched: dict[int, str] = {}
        for each in gc.get_objects():
            if isinstance(each, FunctionType):
                code = each.__code__
                if code.co_filename.startswith(str(PACKAGE)):
                    path = str(Path(code.co_filename).relative_to(PACKAGE))
                    key = path, code.co_qualname, code.co_firstlineno
                    self._all.setdefault(key, []).append(each)
                    self.watched[id(code)] = f"{path}::{code.co_qualname}"
        gc.freeze()

    def has(self, mutant: Mutant) -> bool:
        """Whether the changed function is in memory; what the module itself says is always."""
        return not mutant.function or (mutant.path, mutant.function, mutant.first) in self._all

    def users(self, mutant: Mutant) -> set[str]:
        """ "path::function" of those that a change concerns: the function itself; for a change of
        the module, those that use one of its names."""
        if mutant.function:
            return {f"{mutant.path}::{mutant.function}"}
        names = set(mutant.text.split("=")[0].replace(",", " ").replace(":", " ").split())
        return {
            f"{path}::{name}"
            for (path, name, _), functions in self._all.items()
            if any(names & _names(each.__code__) for each in functions)
        }

    def put(self, mutant: Mutant) -> None:
        """Put the change in its place, in this process."""
        module = compiled(mutant)
        if mutant.function:
            code = codes(module)[mutant.function, mutant.first]
            for each in self._all[mutant.path, mutant.function, mutant.first]:
                each.__code__ = code
            return
        name = "sumo_mcts." + mutant.path.removesuffix(".py").replace("/", ".")
        before = vars(sys.modules[name])
        after: dict[str, Any] = {"__name__": name, "__file__": before["__file__"]}
        exec(module, after)
        for constant, value in after.items():
            old = before.get(constant)
            if not isinstance(value, int | float | tuple) or value == old:
                continue
            for each in list(sys.modules.values()):
                if vars(each).get(constant) is old:
                    setattr(each, constant, value)


def _names(code: CodeType) -> set[str]:
    inner = [each for each in code.co_consts if isinstance(each, CodeType)]
    return set(code.co_names).union(*(_names(each) for each in inner))


# --- pytest ---


class Collected:
    """A plugin of pytest that hands the collected tests over instead of running them."""

    def __init__(self, use: Callable[[Sequence[Any]], None], left_out: Sequence[str]) -> None:
        self._use, self._left_out = use, left_out

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Instead of the usual loop."""
        session.config._tmp_path_factory.getbasetemp()  # type: ignore[attr-defined]
        self._use([t for t in session.items if t.originalname not in self._left_out])  # type: ignore[attr-defined]
        return True


def with_tests(
    places: Sequence[str], left_out: Sequence[str], use: Callable[[Sequence[Any]], None]
) -> None:
    """Collect the tests at these places and call `use` with them."""
    options = ["-p", "no:cacheprovider", "-p", "no:terminal", "-p", "no:xdist"]
    options += ["--hypothesis-profile=brief", "--rootdir", str(PACKAGE.parent)]
    status = pytest.main([*options, *places], plugins=[Collected(use, left_out)])
    if status not in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED):
        raise SystemExit(f"the tests could not be collected: {status!r}")
