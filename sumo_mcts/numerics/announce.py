"""What is said while kernels are compiled: that takes a quarter of a minute."""

import math
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait
from contextlib import contextmanager, suppress
from typing import TypeVar

COMPILING = "compiling the search, once for this version"
WAITING = "waiting for another process, which is compiling the search"
PATIENCE_S = 2.0  # of waiting before it is said
LOOK_S = 0.5  # between two looks at what other processes do
_T = TypeVar("_T")
Note = Callable[[str], object]


class Teller:
    """Tells `note` what is going on. What follows two spaces is new each time."""

    def __init__(self, note: Note) -> None:
        self._note, self._count = note, 0
        self._plan: tuple[int, int] | None = None  # kernels that are compiled, and that are needed

    def compiles(self) -> None:
        """One more kernel is being compiled."""
        self._count += 1
        done = (
            f"{self._count} kernels"
            if self._plan is None
            else "{} of {} kernels".format(*self._plan)
        )
        self._note(f"{COMPILING}  {done}")

    def plans(self, plan: tuple[int, int] | None) -> None:
        """So many kernels are compiled of so many; None: it is not known how many are needed."""
        self._plan = plan

    def waits(self, seconds: float) -> None:
        """For so long another process has been compiling what is needed here."""
        if seconds > PATIENCE_S:
            self._note(f"{WAITING}  {seconds:.0f} s")

    def notes(self, line: str) -> None:
        """Something that is to stay on the screen."""
        _to_stderr(line)


class _Silent(Teller):
    def notes(self, line: str) -> None:
        """Nothing: another process has said it."""


_said: set[str] = set()


def _to_stderr(text: str) -> None:
    line = text.partition("  ")[0]
    if line not in _said:
        _said.add(line)
        with suppress(OSError, ValueError, AttributeError):  # closed, or not there at all
            sys.stderr.write(f"sumo-mcts: {line}\n")


_tellers = [Teller(_to_stderr)]  # the last one tells


def teller() -> Teller:
    """The one that tells now; where no note is given, standard error is told, and once."""
    return _tellers[-1]


@contextmanager
def announced(note: Note | None) -> Iterator[None]:
    """`note` is told whatever is compiled meanwhile, kernel by kernel. None: as outside of this."""
    with _told_by(teller() if note is None else Teller(note)):
        yield


@contextmanager
def unannounced() -> Iterator[None]:
    """Nothing is said, since another process says it."""
    with _told_by(_Silent(lambda _: None)):
        yield


@contextmanager
def _told_by(one: Teller) -> Iterator[None]:
    _tellers.append(one)
    try:
        yield
    finally:
        _tellers.remove(one)


class Growth:
    """Sees from the number of kept kernels whether any process is compiling."""

    def __init__(self, count: Callable[[], int]) -> None:
        self._count = count
        self._first = self._last = count()
        self._grown_at = -math.inf

    def news(self) -> str:
        """What to say of it; "" where nothing is being compiled."""
        now, before = self._count(), self._last
        self._last = now
        if now > before:
            self._grown_at = time.monotonic()
        return (
            f"{COMPILING}  {now - self._first} kernels"
            if time.monotonic() - self._grown_at < PATIENCE_S
            else ""
        )


def watched(future: "Future[_T]", count: Callable[[], int], note: Note) -> _T:
    """The answer of another process.

    Meanwhile `note` is told where kernels are compiled, of which `count` tells how many are kept.
    Raises what it raises.
    """
    growth = Growth(count)
    while not wait([future], LOOK_S).done:
        if news := growth.news():
            note(news)
    return future.result()
