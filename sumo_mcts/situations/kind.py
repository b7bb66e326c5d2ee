"""What a kind of situation is, and how its parameters are drawn in one half of their
ranges."""

from collections.abc import Callable, Mapping, Sequence
from random import Random
from typing import Literal, NamedTuple, get_args

from sumo_mcts.situations.situation import Situation

Half = Literal["development", "final"]
HALVES: tuple[Half, ...] = get_args(Half)
INTERVALS = 8  # of each range; the halves have every second one

Values = Mapping[str, float]


class Range(NamedTuple):
    """The numbers that a parameter may have."""

    low: float
    high: float
    unit: str
    meaning: str
    choices: tuple[str, ...] = ()  # what 0, 1, ... stand for; empty: numbers

    def chosen(self, values: Values, name: str) -> str:
        """The choice that a parameter drawn in this range stands for."""
        return self.choices[int(values[name])]


def one_of(meaning: str, *choices: str) -> Range:
    """A parameter that is one of these, each as often."""
    return Range(0.0, float(len(choices)), "", meaning, choices)


class Kind(NamedTuple):
    """One kind of situation."""

    name: str
    about: str  # one line
    ranges: Mapping[str, Range]
    build: Callable[[Values], Situation]


# Parameters that most kinds have
TRUCKS = Range(0.0, 0.15, "", "share of trucks")
TOWN_SPEED = Range(11.0, 16.0, "m/s", "speed limit")


def source(kind: str, half: Half | None, seed: int, purpose: str) -> Random:
    """Random numbers for one purpose, the same on every machine and with every Python."""
    return Random(f"{kind} {half or 'whole'} {seed} {purpose}")


def drawn(kind: Kind, half: Half | None, seed: int) -> dict[str, float]:
    """The parameters of a seed, each uniform in this half of its range; None: in all of it.

    A range is cut in INTERVALS equal intervals. The 1st, 3rd, 5th and 7th belong to the development
    half, the others to the final one.
    """
    random = source(kind.name, half, seed, "parameters")
    return {name: _within(parts(each, half), random) for name, each in kind.ranges.items()}


def parts(bounds: Range, half: Half | None) -> list[tuple[float, float]]:
    """The intervals of a range that belong to a half; None: the whole range."""
    if half is None:
        return [(bounds.low, bounds.high)]
    width = (bounds.high - bounds.low) / INTERVALS
    first = HALVES.index(half)
    return [
        (bounds.low + k * width, bounds.low + (k + 1) * width) for k in range(first, INTERVALS, 2)
    ]


def _within(intervals: Sequence[tuple[float, float]], random: Random) -> float:
    # not random.choice: what it draws may change from one Python to the next
    low, high = intervals[int(len(intervals) * random.random())]
    return low + random.random() * (high - low)
