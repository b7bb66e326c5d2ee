"""What a batch says while it is at work."""

from collections.abc import Callable
from typing import NamedTuple


class Progress(NamedTuple):
    """How far a batch is. Counts are of episodes."""

    # what comes before the first episode, or what is compiled between them; "" while they are
    # driven
    doing: str
    done: int  # earlier runs included
    total: int
    collisions: int  # egos that collided
    errors: int  # egos with outcome error
    rate_per_s: float | None  # episodes, in this run; None: none is done yet
    left_s: float | None
    part: str = ""  # which of several batches


Watch = Callable[[Progress], None]


def before_the_first(doing: str) -> Progress:
    """The progress while there are no episodes yet."""
    return Progress(doing, 0, 0, 0, 0, None, None)


def part_of(watch: Watch, part: str) -> Watch:
    """Tell the progress of one of several batches."""
    return lambda at: watch(at._replace(part=part))


def silent(progress: Progress) -> None:
    """Ignore the progress."""
