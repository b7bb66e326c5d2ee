"""Progress of commands that take long, on standard error."""

import datetime
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import typer

from sumo_mcts.errors import printable

if TYPE_CHECKING:
    from sumo_mcts.experiments.progress import Progress


@contextmanager
def progress(what: str, *, quiet: bool) -> Iterator[Callable[[str], None]]:
    """Gives a function that shows a text as the current activity, at first `what`.

    On a terminal it is a line that changes. Elsewhere the words before two spaces are printed, each
    once, unless they begin with a number.
    """
    if quiet:
        yield _say_nothing
    elif sys.stderr.isatty():
        from rich.console import Console
        from rich.text import Text

        with Console(stderr=True).status(what) as status:
            yield lambda text: status.update(Text(printable(text)))  # ids may look like markup
    else:
        yield _Lines().tell


class BatchProgress:
    """Shows the progress of a batch: a bar on a terminal, elsewhere a line every ten seconds."""

    EVERY_S = 10.0

    def __init__(self, *, quiet: bool) -> None:
        self._quiet = quiet
        self._told_at, self._text = -math.inf, ""  # the last line
        self._bar: Any = None

    def __enter__(self) -> "BatchProgress":
        if sys.stderr.isatty() and not self._quiet:
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

            columns = (
                BarColumn(),
                MofNCompleteColumn(),
                TextColumn("{task.description}", markup=False),
            )
            self._bar = Progress(*columns, console=Console(stderr=True), transient=True)
            self._bar.start()
            self._task = self._bar.add_task("", total=None)
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def tell(self, at: "Progress") -> None:
        """Show what has changed."""
        if self._bar is not None:
            words = _named(at.part, at.doing or _how_far(at))
            total = at.total or None
            self._bar.update(self._task, completed=at.done, total=total, description=words)
        elif not self._quiet:
            self._tell_line(at)

    def _tell_line(self, at: "Progress") -> None:
        now = time.monotonic()
        text = _named(
            at.part,
            f"{_first_words(at.doing)} ..."
            if at.doing
            else f"{at.done}/{at.total} episodes, {_how_far(at)}",
        )
        due = at.doing or at.done == at.total or now - self._told_at >= self.EVERY_S
        if due and text != self._text:
            self._told_at, self._text = now, text
            typer.echo(text, err=True)


class _Lines:
    """Prints a line for each thing that is going on, each once."""

    def __init__(self) -> None:
        self._told: set[str] = set()

    def tell(self, text: str) -> None:
        words = _first_words(text)
        if not words[:1].isdigit() and words not in self._told:
            self._told.add(words)
            typer.echo(f"{words} ...", err=True)


def _first_words(text: object) -> str:
    """What is going on; behind two spaces stands how far it is."""
    return str(text).split("  ")[0]


def _named(part: str, text: str) -> str:
    """A text with the part before it that it tells of."""
    return f"{part}: {text}" if part else text


def _how_far(at: "Progress") -> str:
    speed = (
        ""
        if at.rate_per_s is None or at.left_s is None
        else f", {at.rate_per_s:.2g}/s, {datetime.timedelta(seconds=round(at.left_s))} left"
    )
    return f"{at.collisions} collisions" + (f", {at.errors} errors" if at.errors else "") + speed


def _say_nothing(text: str) -> None:
    """Say nothing."""
