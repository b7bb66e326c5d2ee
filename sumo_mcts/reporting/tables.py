"""The tables of a report: rates, medians and paired differences by scenario and variant."""

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import combinations
from typing import NamedTuple

from sumo_mcts.records import Row
from sumo_mcts.records.measures import COMPARED, TABLES
from sumo_mcts.records.statistics import (
    TWIN,
    Pair,
    arrived,
    at_fault,
    collided,
    contrast,
    pairs,
    rate,
    slow_ratios,
    some,
    time_ratio,
)
from sumo_mcts.reporting.cells import Cell
from sumo_mcts.reporting.columns import (
    AGAINST,
    ARRIVED,
    COLLISIONS,
    EPISODES,
    OTHER_OUTCOMES,
    PAIRS,
    SCENARIO,
    TIME_RATIOS,
    TWIN_AT_FAULT,
    VARIANT,
    WITH_TWIN,
    WITHOUT_TWIN,
    Column,
    cell_of,
    column_of,
    compared_column,
)
from sumo_mcts.reporting.variants import Groups, driven, grouped, labelled, twins_of

NOT_WORSE = 1.0  # so many more episodes in a hundred than the twin's are allowed


class Table(NamedTuple):
    """Rows of cells under columns."""

    name: str
    title: str
    about: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]


def tables(rows: Sequence[Row]) -> list[Table]:
    """All tables of a report, from rows in their order."""
    groups = grouped(rows)
    planned = {key: those for key, those in groups.items() if those[0]["planner"] != TWIN}
    return [
        _outcomes(groups),
        _overall(rows),
        _against_twin(planned, twins_of(rows)),
        _of_measures(
            "others",
            "Others",
            "What the others had to do about the ego, and how near they came to it.",
            groups,
        ),
        _of_measures("comfort", "Time and comfort", "How the ego drove.", groups),
        _of_measures("rules", "Rules and fail-safe", "Episodes with at least one.", groups),
        _of_measures(
            "planning",
            "Planning time",
            "Wall time of decisions; it differs from machine to machine.",
            planned,
        ),
        _between_variants(planned),
    ]


def study(rows: Sequence[Row]) -> Table:
    """What a page of results shows of a study: each variant in each scenario beside its twins."""
    twins = twins_of(rows)

    def cells(those: list[Row]) -> list[Cell]:
        both = pairs(those, twins)
        other = rate(at_fault(pair.other) for pair in both) if both else None
        against = _against(both) if both else [None] * len(_WITH_TWIN)
        ended = rate(map(arrived, those)), cell_of("at_fault", those)
        return [*ended, other, *against, *(cell_of(key, those) for key in last)]

    last = ("hard_brakes", "plan_ms_p50")
    columns = (
        SCENARIO, VARIANT, ARRIVED, column_of("at_fault"), TWIN_AT_FAULT, *_WITH_TWIN,
        *map(column_of, last),
    )  # fmt: skip
    about = (
        "Rates with the 95 % Wilson interval. The twin is the same vehicle at the same seed, "
        "driven by SUMO. Differences in episodes per hundred, and the median of the time ratio, "
        "with a 95 % bootstrap interval over pairs."
    )
    return Table("study", "Study", about, columns, _lines(grouped(driven(rows)), cells))


def _of_measures(name: str, title: str, about: str, groups: Groups) -> Table:
    """A table whose columns are measures: records/measures.py lists them under its name."""
    keys = TABLES[name]
    columns = (SCENARIO, VARIANT, *map(column_of, keys))
    return Table(
        name,
        title,
        about,
        columns,
        _lines(groups, lambda rows: [cell_of(key, rows) for key in keys]),
    )


def _lines(
    groups: Groups, cells: Callable[[list[Row]], Sequence[Cell]]
) -> tuple[tuple[Cell, ...], ...]:
    """A line for each scenario and variant."""
    return tuple(
        (scenario, labelled(rows[0]), *cells(rows)) for (scenario, _), rows in groups.items()
    )


def _outcomes(groups: Groups) -> Table:
    columns = (
        SCENARIO, VARIANT, EPISODES, ARRIVED, COLLISIONS, column_of("at_fault"), OTHER_OUTCOMES,
    )  # fmt: skip
    return Table(
        "outcomes",
        "Outcomes",
        "How the episodes ended, as k/n with the 95 % Wilson interval.",
        columns,
        _lines(groups, lambda rows: [*_ends(rows), _other_outcomes(rows)]),
    )


def _ends(rows: Sequence[Row]) -> list[Cell]:
    """Episodes; how many arrived, collided, collided at fault."""
    return [len(rows), *(rate(map(each, rows)) for each in (arrived, collided, at_fault))]


def _other_outcomes(rows: Sequence[Row]) -> str:
    counts = Counter(
        row["outcome"] for row in rows if row["outcome"] not in ("arrived", "collision")
    )
    return ", ".join(
        f"{count} {outcome.replace('_', ' ')}" for outcome, count in sorted(counts.items())
    )


def _overall(rows: Sequence[Row]) -> Table:
    """Each variant over all its scenarios; empty where there is one scenario only."""
    twins = twins_of(rows)
    variants: dict[str, list[Row]] = {}
    for row in rows:
        variants.setdefault(row["variant"], []).append(row)

    def cells(those: list[Row]) -> list[Cell]:
        both = pairs(those, twins) if those[0]["planner"] != TWIN else []
        against = _against(both) if both else [None] * len(_WITH_TWIN)
        return [*_ends(those), *against, cell_of("plan_ms_p50", those)]

    columns = (
        VARIANT, EPISODES, ARRIVED, COLLISIONS, column_of("at_fault"), *_WITH_TWIN,
        column_of("plan_ms_p50"),
    )  # fmt: skip
    several = len({row["scenario"] for row in rows}) > 1
    lines = tuple((labelled(those[0]), *cells(those)) for those in variants.values())
    return Table(
        "overall",
        "Over all scenarios",
        "Every episode counts the same, whatever its scenario.",
        columns,
        lines if several else (),
    )


_MORE = (
    "The ego's episodes : the twin's, and the difference per hundred episodes; at most one more is "
    "allowed."
)
_WITH_TWIN = (*TIME_RATIOS, *(compared_column(key, _MORE) for key in COMPARED))


def _against(both: Sequence[Pair]) -> list[Cell]:
    """The cells of _WITH_TWIN: what is compared with the twin's."""
    return [*_time_ratios(both), *(contrast(both, some(key)) for key in COMPARED)]


def _time_ratios(both: Sequence[Pair]) -> list[Cell]:
    """The cells of TIME_RATIOS."""
    return [time_ratio(both), *slow_ratios(both)]


def _against_twin(planned: Groups, twins: Sequence[Row]) -> Table:
    """Each variant beside SUMO's own driver, over the pairs."""

    def cells(both: list[Pair]) -> list[Cell]:
        there = [pair for pair in both if arrived(pair.other)]
        apart = [pair for pair in both if not arrived(pair.other)]
        return [
            len(both),
            rate(arrived(pair.one) for pair in there),
            rate(arrived(pair.one) for pair in apart),
            *_against(both),
        ]

    columns = (SCENARIO, VARIANT, PAIRS, WITH_TWIN, WITHOUT_TWIN, *_WITH_TWIN)
    about = (
        "The twin is the same vehicle at the same seed, driven by SUMO. Differences in "
        "episodes per hundred with a 95 % bootstrap interval over pairs."
    )
    paired = {key: pairs(those, twins) for key, those in planned.items()}
    lines = tuple(
        (key[0], labelled(planned[key][0]), *cells(both)) for key, both in paired.items() if both
    )
    return Table("twin", "Against SUMO's driver", about, columns, lines)


def _between_variants(planned: Groups) -> Table:
    """Every two variants of a scenario, SUMO's own driver left out."""
    imposed = "imposed_brakes_3"
    happened = (arrived, collided, at_fault, some(imposed))
    lines: list[tuple[Cell, ...]] = []
    for ((scenario, _), one), ((other, _), two) in combinations(planned.items(), 2):
        both = pairs(one, two) if scenario == other else []
        if both:
            contrasts = [contrast(both, each) for each in happened]
            names = scenario, labelled(one[0]), labelled(two[0])
            lines.append((*names, len(both), *_time_ratios(both), *contrasts))
    columns = (
        SCENARIO, VARIANT, AGAINST, PAIRS, *TIME_RATIOS, ARRIVED, COLLISIONS,
        compared_column("at_fault"), compared_column(imposed),
    )  # fmt: skip
    about = (
        "Pairs of the same seed: episodes of the one : of the other, and the difference per "
        "hundred episodes with a 95 % bootstrap interval."
    )
    return Table("variants", "Between variants", about, columns, tuple(lines))
