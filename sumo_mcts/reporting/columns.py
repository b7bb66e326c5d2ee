"""The columns of a report's tables: those of measures, and those that no single key gives.

How a measure is counted, labelled and explained says the table of measures (records/measures.py).
"""

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from sumo_mcts.records import Row
from sumo_mcts.records.measures import BY_KEY, Count, Kind
from sumo_mcts.records.statistics import (
    SLOW,
    Rate,
    arrived,
    at_fault,
    collided,
    rate,
    some,
    wilson,
)
from sumo_mcts.reporting.cells import Cell


class Column(NamedTuple):
    """The heading of a column."""

    key: str
    label: str
    about: str = ""  # the definition
    digits: int = 2
    unit: str = ""

    @property
    def heading(self) -> str:
        """The label with its unit."""
        return f"{self.label}, {self.unit}" if self.unit else self.label


# --- columns of measures ---


def column_of(key: str) -> Column:
    """The column of a measure that is counted over episodes."""
    measure = BY_KEY[key]
    assert measure.counted is not None, "only measures that are counted have a column"
    counts = measure.counted in _RATES
    unit = "" if counts else "%" if measure.kind is Kind.SHARE else measure.unit
    about = f"{measure.meaning} {measure.counted.value}"
    return Column(measure.column or key, measure.label, about, measure.digits, unit)


def value_column(key: str) -> Column:
    """The column of a measure in a list of single episodes."""
    measure = BY_KEY[key]
    return Column(key, measure.label, measure.meaning, measure.digits, measure.unit)


def compared_column(key: str, further: str = "") -> Column:
    """The column that compares a measure's episodes pair by pair; `further` to its definition."""
    measure = BY_KEY[key]
    about = f"{measure.meaning} {further}".strip()
    return Column(measure.column or key, measure.label, about)


def cell_of(key: str, rows: Sequence[Row]) -> Cell:
    """A measure counted over episodes."""
    measure = BY_KEY[key]
    assert measure.counted is not None, "only measures that are counted have a cell"
    cell = _COUNTING[measure.counted](rows, key)
    return 100 * cell if measure.kind is Kind.SHARE and isinstance(cell, float) else cell


def _known(rows: Iterable[Row], key: str) -> list[float]:
    return [row[key] for row in rows if row[key] is not None]


def _median(rows: Iterable[Row], key: str) -> float | None:
    values = _known(rows, key)
    return float(np.median(values)) if values else None


def _mean(rows: Iterable[Row], key: str) -> float | None:
    values = _known(rows, key)
    return float(np.mean(values)) if values else None


def _per_decision(rows: Sequence[Row], key: str) -> float | None:
    """The sum over the number of decisions; None without any."""
    decisions, total = int(sum(_known(rows, "cycles"))), sum(_known(rows, key))
    return total / decisions if decisions and total else None


def _of_decisions(rows: Sequence[Row], key: str) -> Rate:
    """How many of the decisions; rows that say more than there were are damaged, and left out."""
    whole = [row for row in rows if (row[key] or 0) <= (row["cycles"] or 0)]
    k, n = int(sum(_known(whole, key))), int(sum(_known(whole, "cycles")))
    return Rate(k, n, wilson(k, n))


def _of_collisions(rows: Sequence[Row], key: str) -> Rate | None:
    judged = [row for row in rows if collided(row) and row[key] is not None]
    return rate(row[key] for row in judged) if judged else None


_COUNTING: dict[Count, Callable[[Sequence[Row], str], Cell]] = {
    Count.EPISODES: lambda rows, key: rate(map(some(key), rows)),
    Count.FAULTS: lambda rows, key: rate(map(at_fault, rows)),
    Count.COLLISIONS: _of_collisions,
    Count.MEDIAN: _median,
    Count.MEDIAN_ARRIVED: lambda rows, key: _median(filter(arrived, rows), key),
    Count.MEAN: _mean,
    Count.SUM: lambda rows, key: int(sum(_known(rows, key))),
    Count.LARGEST: lambda rows, key: max(_known(rows, key), default=None),
    Count.PER_DECISION: _per_decision,
    Count.DECISIONS: _of_decisions,
}
_RATES = (Count.EPISODES, Count.FAULTS, Count.COLLISIONS, Count.DECISIONS)


# --- further columns ---

SCENARIO = Column("scenario", "Scenario", "The scene, network and task.")
VARIANT = Column(
    "variant",
    "Variant",
    "The planner and its settings; an oracle's forecast knows what no sensor sees.",
)
AGAINST = Column("against", "Against", "The other variant.")
EPISODES = Column("episodes", "Episodes", "Episodes that were run, those with an error too.")
TWIN_AT_FAULT = Column(
    "twin_at_fault",
    "Twin at fault",
    "Of the pairs, those whose twin ended in a collision at fault.",
)
PAIRS = Column("pairs", "Pairs", "Episodes of the same scenario, seed and ego that both were run.")
ARRIVED = Column(
    "arrived",
    "Arrived",
    "The ego's front passed the end of its route, or the scene's success point, within the time "
    "limit.",
)
COLLISIONS = Column(
    "collisions",
    "Collisions",
    "Episodes that ended in a contact of the ego with another agent, at fault or not.",
)
OTHER_OUTCOMES = Column(
    "other_outcomes",
    "Other outcomes",
    "Timeout, off the route, teleported by SUMO, or an error of the run.",
)
_TIME_RATIO = (
    "of the ego's travel time divided by the other's. An ego that did not arrive counts as "
    "infinite; pairs whose other did not are left out."
)
TIME_RATIOS = (
    Column("travel_time_ratio", "Time ratio, 50 %", f"Median over pairs {_TIME_RATIO}"),
    *(
        Column(
            f"travel_time_ratio_p{percent}",
            f"{percent} %",
            f"What {percent} % of the pairs do not exceed {_TIME_RATIO}",
        )
        for percent in SLOW
    ),
)
WITH_TWIN = Column(
    "arrived_with_twin",
    "Arrived where the twin did",
    "Of the pairs whose twin arrived, those in which the ego did.",
)
WITHOUT_TWIN = Column(
    "arrived_without_twin",
    "... did not",
    "The other pairs, listed apart: those in which the ego arrived though its twin did not.",
)
