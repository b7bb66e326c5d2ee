"""Rates, pairs and their differences, as docs/measures.md counts them.

Plain functions over rows; the same rows give the same intervals.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats
from sumo_mcts.records.measures import REDRAWN, TRAFFIC_DIGEST, Row

Z = 1.96  # of the 95 % interval
RESAMPLES = 2000  # of a bootstrap interval
SEED = 0  # of the resampling
# Values that an interval needs: of fewer, even the range from smallest to largest misses the median
# more often than once in twenty.
LEAST = 6
SLOW = (90, 95, 99)  # %, of the pairs whose time ratio is at most what is told beside the median
# The planner whose episodes are the others' twins, and their variant where `twins` adds it.
TWIN = "sumo"
# What the two episodes of a pair share: scenario, seed, ego, traffic, how often it was redrawn.
Place = tuple[str, int | None, str | None, str | None, int | None]


class Rate(NamedTuple):
    """k of n, with the 95 % Wilson interval of its share; None of none."""

    k: int
    n: int
    interval: tuple[float, float] | None


class Estimate(NamedTuple):
    """A number with its 95 % bootstrap interval, if it has one.

    Infinite where an episode without an end decides it.
    """

    value: float
    interval: tuple[float, float] | None
    n: int


class Contrast(NamedTuple):
    """The number of events in n pairs for each of the two, and their difference per hundred
    episodes, with its 95 % bootstrap interval if there is one."""

    k: int
    other: int
    n: int
    per_hundred: float
    interval: tuple[float, float] | None


class Pair(NamedTuple):
    """Two episodes of the same scenario, seed and ego, in the same traffic."""

    one: Row
    other: Row


# --- rates ---


def wilson(k: int, n: int) -> tuple[float, float] | None:
    """The 95 % interval of a rate (Wilson 1927)."""
    if n == 0:
        return None
    p, z = k / n, Z
    middle, half = p + z * z / (2 * n), z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return max(0.0, (middle - half) / (1 + z * z / n)), min(1.0, (middle + half) / (1 + z * z / n))


def rate(happened: Iterable[bool | None]) -> Rate:
    """How often something happened, among those of which it is known."""
    counts = Counter(bool(each) for each in happened if each is not None)
    k, n = counts[True], counts.total()
    return Rate(k, n, wilson(k, n))


# --- what happened in an episode ---


def arrived(row: Row) -> bool:
    """Whether the ego came to its goal; after an error it did not."""
    return bool(row["outcome"] == "arrived")


def collided(row: Row) -> bool | None:
    """Whether the episode ended in a collision, at fault or not; None: unknown, after an error."""
    return None if row["outcome"] == "error" else bool(row["outcome"] == "collision")


def at_fault(row: Row) -> bool | None:
    """Whether the episode ended in a collision at fault, where unclear fault counts; None: unknown,
    after an error."""
    return collided(row) and row["at_fault"] is not False


def timed_out(row: Row) -> bool:
    """Whether the time was up before the ego came to its goal."""
    return bool(row["outcome"] == "timeout")


def some(key: str) -> Callable[[Row], bool | None]:
    """A test of rows: whether this count or share is above 0; None: unknown."""
    return lambda row: None if row[key] is None else row[key] > 0


# --- pairs ---


def place(row: Row) -> Place:
    """What an episode shares with its twin."""
    return row["scenario"], row["seed"], row["ego"], row.get(TRAFFIC_DIGEST), row.get(REDRAWN)


def pairs(ones: Iterable[Row], others: Iterable[Row]) -> list[Pair]:
    """Each of `ones` with its counterpart among `others`, where there is one; the first of
    several."""
    known: dict[Place, Row] = {}
    for row in others:
        known.setdefault(place(row), row)
    return [Pair(row, known[place(row)]) for row in ones if place(row) in known]


def contrast(both: Iterable[Pair], happened: Callable[[Row], bool | None]) -> Contrast | None:
    """The paired difference of how often something happened, over the pairs of which it is known
    for both; None without any."""
    judged = [(happened(pair.one), happened(pair.other)) for pair in both]
    known = np.array([each for each in judged if None not in each], dtype=np.float64).reshape(-1, 2)
    if not len(known):
        return None
    difference = 100 * (known[:, 0] - known[:, 1])
    k, other = (int(count) for count in known.sum(axis=0))
    return Contrast(
        k, other, len(known), float(difference.mean()), _interval_of(difference, resampled_means)
    )


def time_ratio(both: Sequence[Pair]) -> Estimate | None:
    """The median of the one's travel time over the other's; None without any.

    Pairs count whose other arrived. A travel without arrival took infinitely long.
    """
    return median(_time_ratios(both))


def slow_ratios(both: Sequence[Pair]) -> list[float | None]:
    """The ratio of travel times, as in `time_ratio`, that SLOW % of the pairs do not exceed."""
    ratios = _time_ratios(both)
    return [at_most(ratios, percent) for percent in SLOW]


def at_most(values: Floats, percent: int) -> float | None:
    """The smallest of [n] values, some perhaps infinite, that `percent` % of them do not exceed.

    None of none. Of fewer than 100 / (100 - percent) values it is the largest.
    """
    if not len(values):
        return None
    # In whole numbers: 0.9 * 10 is not 9 to every machine.
    return float(np.sort(values)[-(-percent * len(values) // 100) - 1])


def median(values: Floats) -> Estimate | None:
    """The median of [n] values, some of which may be infinite; None of none."""
    if not len(values):
        return None
    ordered, n = np.sort(values), len(values)
    return Estimate(
        float(ordered[(n - 1) // 2] + ordered[n // 2]) / 2,
        _interval_of(values, resampled_medians),
        n,
    )


def _time_ratios(both: Iterable[Pair]) -> Floats:
    """[n] travel times of the one over the other's, of the pairs whose other arrived."""
    return np.array(
        [
            _travelled(pair.one) / pair.other["travel_time_s"]
            for pair in both
            if arrived(pair.other) and pair.other["travel_time_s"]
        ]
    )


def _travelled(row: Row) -> float:
    return (
        float(row["travel_time_s"])
        if arrived(row) and row["travel_time_s"] is not None
        else math.inf
    )


# --- the bootstrap ---
# Efron 1979: the statistic of RESAMPLES samples, each of n draws with replacement from n values.


def _interval_of(
    values: Floats, resampled: Callable[[Floats], Floats]
) -> tuple[float, float] | None:
    """The interval of a statistic of [n] values.

    None for fewer than LEAST, and where all are the same: resampling those shows no spread.
    """
    return (
        None
        if len(values) < LEAST or bool((values == values[0]).all())
        else interval(resampled(values))
    )


def interval(statistics: Floats) -> tuple[float, float]:
    """The middle 95 % of a statistic's resamples."""
    # "nearest": between a finite and an infinite value there is nothing to interpolate.
    low, high = np.percentile(statistics, [2.5, 97.5], method="nearest")
    return float(low), float(high)


def resampled_means(values: Floats) -> Floats:
    """[RESAMPLES] means. Drawing values is drawing how often each distinct one occurs."""
    levels, counts = np.unique(values, return_counts=True)
    drawn = np.random.default_rng(SEED).multinomial(
        len(values), counts / len(values), size=RESAMPLES
    )
    means: Floats = drawn @ levels / len(values)
    return means


def resampled_medians(values: Floats) -> Floats:
    """[RESAMPLES] medians.

    The k-th smallest of n draws lies where the k-th smallest of n uniform numbers lies. That place
    has a beta distribution, so only the middle one is drawn, or the middle two.
    """
    ordered, n, rng = np.sort(values), len(values), np.random.default_rng(SEED)
    k = (n + 1) // 2
    lower = rng.beta(k, n - k + 1, RESAMPLES)
    upper = lower if n % 2 else lower + (1 - lower) * rng.beta(1, n - k, RESAMPLES)
    one, other = (
        ordered[np.minimum((n * share).astype(np.int64), n - 1)] for share in (lower, upper)
    )
    medians: Floats = (one + other) / 2
    return medians
