"""Messages while kernels are compiled, which takes a quarter of a minute."""

import math
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait
from contextlib import contextmanager, suppress
from typing import TypeVar

COMPILING = "compiling the search, once for this version"
WAITING = "waiting for another process, which is compiling the search"
PATIENCE_S = 2.0  # of waiting before a message; of no new kernel before compiling counts as over
LOOK_S = 0.5  # between two checks of another process
_T = TypeVar("_T")
Note = Callable[[str], object]


class Announcer:
    """Sends messages to `note`. The text after two spaces changes from message to message."""

    def __init__(self, note: Note) -> None:
        self._note, self._count = note, 0
        self._plan: tuple[int, int] | None = None  # kernels compiled so far, kernels needed

    def compiles(self) -> None:
        """The compilation of one more kernel begins."""
        self._count += 1
        done = (
            f"{self._count} kernels"
            if self._plan is None
            else "{} of {} kernels".format(*self._plan)
        )
        self._note(f"{COMPILING}  {done}")

    def plans(self, plan: tuple[int, int] | None) -> None:
        """Set how many kernels are compiled, and how many are needed; None: unknown."""
        self._plan = plan

    def waits(self, seconds: float) -> None:
        """Another process has been compiling for so many seconds, and this one waits for it."""
        if seconds > PATIENCE_S:
            self._note(f"{WAITING}  {seconds:.0f} s")

    def notes(self, line: str) -> None:
        """A line that is to stay on the screen."""
        _to_stderr(line)


class _Silent(Announcer):
    def notes(self, line: str) -> None:
        """Print nothing: another process has printed the line."""


_said: set[str] = set()  # lines that were printed already


def _to_stderr(text: str) -> None:
    line = text.partition("  ")[0]
    if line not in _said:
        _said.add(line)
        with suppress(OSError, ValueError, AttributeError):  # closed, or missing
            sys.stderr.write(f"sumo-mcts: {line}\n")


_announcers = [Announcer(_to_stderr)]  # the last one is in use


def announcer() -> Announcer:
    """The announcer in use. The first one prints each line once, on standard error."""
    return _announcers[-1]


@contextmanager
def announced(note: Note | None) -> Iterator[None]:
    """Inside the block `note` gets a message for each kernel that is compiled.

    None: messages go where they went before the block.
    """
    with _announced_by(announcer() if note is None else Announcer(note)):
        yield


@contextmanager
def unannounced() -> Iterator[None]:
    """Inside the block there are no messages, since another process prints them."""
    with _announced_by(_Silent(lambda _: None)):
        yield


@contextmanager
def _announced_by(one: Announcer) -> Iterator[None]:
    _announcers.append(one)
    try:
        yield
    finally:
        _announcers.remove(one)


class Growth:
    """Detects from the number of kernels on disk, `count()`, whether any process is compiling."""

    def __init__(self, count: Callable[[], int]) -> None:
        self._count = count
        self._first = self._last = count()
        self._grown_at = -math.inf

    def news(self) -> str:
        """The message about it; "" where no process is compiling."""
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
    """Wait for the result of another process and return it.

    While that process compiles, `note` gets messages; `count` returns the number of kernels on
    disk. Raises the exception of the other process, if it ended with one.
    """
    growth = Growth(count)
    while not wait([future], LOOK_S).done:
        if news := growth.news():
            note(news)
    return future.result()
