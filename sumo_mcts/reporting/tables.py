"""What a report says in numbers: tables of rates, medians and paired differences, as text,
Markdown, CSV and JSON."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.records import SCHEMA_VERSION
from sumo_mcts.records.highlights import KINDS, WRONG, order, reasons
from sumo_mcts.records.statistics import (
    TWIN,
    Contrast,
    Estimate,
    Pair,
    Rate,
    Row,
    arrived,
    at_fault,
    collided,
    contrast,
    pairs,
    rate,
    some,
    time_ratio,
    wilson,
)
from sumo_mcts.registry import is_oracle
from sumo_mcts.reporting.results import Results, planner_rank

NOT_WORSE = 1.0  # so many more episodes in a hundred than the twin's are allowed
EACH = (
    3  # hard moments of one kind, of a scenario and variant, that are shown; a batch keeps HARDEST
)

Cell = Rate | Estimate | Contrast | float | int | str | None


class Column(NamedTuple):
    """A measure, and how it is written."""

    key: str
    label: str
    about: str = ""  # the definition
    digits: int = 2
    unit: str = ""


class Table(NamedTuple):
    """Rows of cells under columns."""

    name: str
    title: str
    about: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]


class Look(NamedTuple):
    """An episode worth a look, and why."""

    row: Row
    reasons: tuple[str, ...]  # the gravest first


# --- the columns ---

_SCENARIO = Column("scenario", "Scenario", "The scene, network and task.")
_VARIANT = Column(
    "variant",
    "Variant",
    "Who drives, and with which settings; an oracle's forecast knows what no sensor sees.",
)
_EPISODES = Column("episodes", "Episodes", "Episodes that were run, those with an error too.")
_PAIRS = Column("pairs", "Pairs", "Episodes of the same scenario, seed and ego that both were run.")

_ARRIVED = Column(
    "arrived",
    "Arrived",
    "The ego's front passed the end of its way, or the scene's success point, within the time "
    "limit.",
)
_COLLISIONS = Column(
    "collisions",
    "Collisions",
    "Episodes that ended in a contact of the ego with anybody, whoever was at fault.",
)
_AT_FAULT = Column(
    "at_fault",
    "At fault",
    "Collisions that are the ego's: its front came first, the other stood, or it had to let the "
    "other pass. What is unclear counts.",
)
_OTHER = Column(
    "other_outcomes",
    "Other outcomes",
    "Timeout, off the route, teleported by SUMO, or an error of the run.",
)
_INEVITABLE = Column(
    "inevitable",
    "Inevitable",
    "Of the collisions, those that a search knowing the scripts could not avoid from 3 s before. "
    "Known in scripted scenes only.",
)
_RED = Column(
    "red_lights_run",
    "Red light run",
    "Episodes in which the front crossed a stop line at red though it could have stopped with 4.5 "
    "m/s².",
)
_YELLOW = Column(
    "yellow_run",
    "Yellow run",
    "Episodes in which it entered on yellow though 3 m/s² would have stopped it.",
)
_SPEEDING = Column(
    "speeding",
    "Speeding",
    "Episodes with a moment faster than the lane's limit times the vehicle's own speed factor, by "
    "more than 0.1 m/s.",
)
_FAILSAFE = Column(
    "failsafe",
    "Fail-safe",
    "Episodes in which a fail-safe manoeuvre replaced at least one decision.",
)

_IMPOSED = (
    "Episodes in which somebody braked beyond {} m/s² because of the ego: it was the "
    "leader, or in the way of the next 4 s."
)
_TIME = Column(
    "travel_time_s",
    "Travel time",
    "Median from departure to arrival, over those that arrived.",
    1,
    "s",
)
_RATIO = Column(
    "travel_time_ratio",
    "Time ratio",
    "Median over pairs of the ego's travel time divided by the other's. An ego that did not arrive "
    "counts as infinite; pairs whose other did not are left out.",
)
_WITH_TWIN = Column(
    "arrived_with_twin",
    "Arrived where the twin did",
    "Of the pairs whose twin arrived, those in which the ego did.",
)
_IMPOSING = tuple(
    Column(
        f"imposed_brakes_{limit}",
        f"Imposed beyond {limit}",
        f"{_IMPOSED.format(limit)} The ego's episodes : the twin's, and the difference per hundred "
        "episodes; at most one more is allowed.",
    )
    for limit in (2, 3, 4)
)
_TTC = Column(
    "min_ttc_s",
    "TTC",
    "Smallest time to collision, SUMO's surrogate safety device: median over the episodes in which "
    "there was one.",
    2,
    "s",
)
_PET = Column(
    "min_pet_s",
    "PET",
    "Smallest time between one leaving a conflict area and the other entering it: median where it "
    "is known.",
    2,
    "s",
)
_DRAC = Column(
    "max_drac_mps2",
    "DRAC",
    "Largest deceleration that was needed to avoid a crash: median where it is known.",
    2,
    "m/s²",
)
_COMFORT = Column(
    "comfortable_share",
    "Comfortable",
    "Share of time within −4.05..2.40 m/s² lengthwise, 4.89 m/s² sideways and 4.13 m/s³ jerk: "
    "median.",
    0,
    "%",
)
_JERK = Column(
    "rms_jerk_mps3",
    "Jerk",
    "Root mean square of the longitudinal jerk, smoothed over half a second: median.",
    2,
    "m/s³",
)
_DECEL = Column(
    "max_decel_mps2",
    "Hardest braking",
    "Strongest braking of the ego in an episode: median.",
    2,
    "m/s²",
)
_HARD = Column("hard_brakes", "Hard brakes", "Episodes in which the ego braked beyond 4.5 m/s².")
_CHANGES = Column("lane_changes", "Lane changes", "Carried out, on average.", 2)
_FLIPS = Column(
    "decision_flips",
    "Flips",
    "How often the plan turned from accelerating to braking or back, on average.",
    2,
)

_DECISIONS = Column("decisions", "Decisions", "Decisions taken in all episodes.", 0)
_EFFORT = Column(
    "iterations_used",
    "Iterations",
    "Passes of the search to its horizon, per decision on average.",
    0,
)
_P50, _P95, _P99 = (
    Column(
        f"plan_ms_p{q}",
        f"p{q}",
        f"{q} % of an episode's decisions took at most so long, from scene to decision: median "
        "over episodes.",
        1,
        "ms",
    )
    for q in (50, 95, 99)
)
_WORST = Column("plan_ms_max", "Slowest", "The slowest decision of all.", 1, "ms")
_MISSES = Column(
    "deadline_misses",
    "Late",
    "Decisions that took longer than the deadline: the time budget, else the decision period.",
)
_REAL = Column(
    "realtime_factor", "Real time", "Simulated over wall time of whole episodes: median.", 1, "×"
)


# --- the tables ---


def tables(rows: Sequence[Row]) -> list[Table]:
    """All tables of a report, from rows in their order."""
    groups = grouped(rows)
    return [
        _outcomes(groups),
        _overall(rows),
        _against_twin(groups, rows),
        _others(groups),
        _comfort(groups),
        _rules(groups),
        _planning(groups),
        _between(groups),
    ]


def grouped(rows: Iterable[Row]) -> dict[tuple[str, str], list[Row]]:
    """The rows of each scenario and variant, in the order in which they come."""
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["scenario"], row["variant"]), []).append(row)
    return groups


def labelled(row: Row) -> str:
    """The variant of a row, with a word where its forecast is an oracle."""
    return f"{row['variant']} (oracle)" if is_oracle(row["prediction"]) else str(row["variant"])


Groups = dict[tuple[str, str], list[Row]]


def _each(
    groups: Groups, cells: Callable[[list[Row]], Sequence[Cell]]
) -> tuple[tuple[Cell, ...], ...]:
    return tuple(
        (scenario, labelled(rows[0]), *cells(rows)) for (scenario, _), rows in groups.items()
    )


def _outcomes(groups: Groups) -> Table:
    def cells(rows: list[Row]) -> list[Cell]:
        return [
            len(rows),
            rate(map(arrived, rows)),
            rate(map(collided, rows)),
            rate(map(at_fault, rows)),
            _rest(rows),
        ]

    columns = (_SCENARIO, _VARIANT, _EPISODES, _ARRIVED, _COLLISIONS, _AT_FAULT, _OTHER)
    return Table(
        "outcomes",
        "Outcomes",
        "How the episodes ended, as k/n with the 95 % Wilson interval.",
        columns,
        _each(groups, cells),
    )


def _rest(rows: list[Row]) -> str:
    counts = Counter(
        row["outcome"] for row in rows if row["outcome"] not in ("arrived", "collision")
    )
    return ", ".join(
        f"{count} {outcome.replace('_', ' ')}" for outcome, count in sorted(counts.items())
    )


def _overall(rows: Sequence[Row]) -> Table:
    """Each variant over all its scenarios; empty where there is one scenario only."""
    twins = [row for row in rows if row["planner"] == TWIN]
    variants: dict[str, list[Row]] = {}
    for row in rows:
        variants.setdefault(row["variant"], []).append(row)

    def cells(those: list[Row]) -> list[Cell]:
        both = pairs(those, twins) if those[0]["planner"] != TWIN else []
        compared: list[Cell] = [time_ratio(both), *_imposed(both)] if both else [None] * 4
        return [
            len(those),
            *(rate(map(each, those)) for each in (arrived, collided, at_fault)),
            *compared,
            _median(those, "plan_ms_p50"),
        ]

    columns = (_VARIANT, _EPISODES, _ARRIVED, _COLLISIONS, _AT_FAULT, _RATIO, *_IMPOSING, _P50)
    lines = (
        tuple((labelled(those[0]), *cells(those)) for those in variants.values())
        if len({row["scenario"] for row in rows}) > 1
        else ()
    )
    return Table(
        "overall",
        "Over all scenarios",
        "Every episode counts the same, whatever its scenario.",
        columns,
        lines,
    )


def _imposed(both: Sequence[Pair]) -> list[Contrast | None]:
    return [contrast(both, some(f"imposed_brakes_{limit}")) for limit in (2, 3, 4)]


def _against_twin(groups: Groups, rows: Sequence[Row]) -> Table:
    twins = [row for row in rows if row["planner"] == TWIN]
    found = {
        key: pairs(those, twins) for key, those in groups.items() if those[0]["planner"] != TWIN
    }

    def cells(both: list[Pair]) -> list[Cell]:
        there = [pair for pair in both if arrived(pair.other)]
        apart = [pair for pair in both if not arrived(pair.other)]
        return [
            len(both),
            rate(arrived(pair.one) for pair in there),
            rate(arrived(pair.one) for pair in apart),
            time_ratio(both),
            *_imposed(both),
        ]

    without = Column(
        "arrived_without_twin",
        "... did not",
        "The other pairs, listed apart: those in which the ego arrived though its twin did not.",
    )
    columns = (_SCENARIO, _VARIANT, _PAIRS, _WITH_TWIN, without, _RATIO, *_IMPOSING)
    about = (
        "The twin is the same vehicle at the same seed, driven by SUMO. Differences in "
        "episodes per hundred with a 95 % bootstrap interval over pairs."
    )
    lines = tuple(
        (key[0], labelled(groups[key][0]), *cells(both)) for key, both in found.items() if both
    )
    return Table("twin", "Against SUMO's driver", about, columns, lines)


def _others(groups: Groups) -> Table:
    def cells(rows: list[Row]) -> list[Cell]:
        imposed = [rate(map(some(f"imposed_brakes_{limit}"), rows)) for limit in (2, 3, 4)]
        return [
            *imposed,
            *(_median(rows, key) for key in ("min_ttc_s", "min_pet_s", "max_drac_mps2")),
        ]

    imposing = (
        Column(f"imposed_brakes_{limit}", f"Imposed beyond {limit}", _IMPOSED.format(limit))
        for limit in (2, 3, 4)
    )
    about = "What the others had to do about the ego, and how near they came to it."
    return Table(
        "others",
        "Others",
        about,
        (_SCENARIO, _VARIANT, *imposing, _TTC, _PET, _DRAC),
        _each(groups, cells),
    )


def _comfort(groups: Groups) -> Table:
    def cells(rows: list[Row]) -> list[Cell]:
        comfortable = _median(rows, "comfortable_share")
        return [
            _median([row for row in rows if arrived(row)], "travel_time_s"),
            None if comfortable is None else 100 * comfortable,
            _median(rows, "rms_jerk_mps3"),
            _median(rows, "max_decel_mps2"),
            rate(map(some("hard_brakes"), rows)),
            _mean(rows, "lane_changes"),
            _mean(rows, "decision_flips"),
        ]

    columns = (_SCENARIO, _VARIANT, _TIME, _COMFORT, _JERK, _DECEL, _HARD, _CHANGES, _FLIPS)
    return Table("comfort", "Time and comfort", "How the ego drove.", columns, _each(groups, cells))


def _rules(groups: Groups) -> Table:
    def cells(rows: list[Row]) -> list[Cell]:
        judged = [row for row in rows if collided(row) and row["inevitable"] is not None]
        counted = [
            rate(map(some(key), rows))
            for key in ("red_lights_run", "yellow_run", "speeding_share", "failsafe_interventions")
        ]
        return [*counted, rate(row["inevitable"] for row in judged) if judged else None]

    columns = (_SCENARIO, _VARIANT, _RED, _YELLOW, _SPEEDING, _FAILSAFE, _INEVITABLE)
    return Table(
        "rules", "Rules and fail-safe", "Episodes with at least one.", columns, _each(groups, cells)
    )


def _planning(groups: Groups) -> Table:
    def cells(rows: list[Row]) -> list[Cell]:
        decisions, iterations = int(_sum(rows, "cycles")), _sum(rows, "iterations")
        slowest = max(_known(rows, "plan_ms_max"), default=None)
        timed = [
            row for row in rows if (row["deadline_misses"] or 0) <= (row["cycles"] or 0)
        ]  # a damaged row may say anything
        late, of = int(_sum(timed, "deadline_misses")), int(_sum(timed, "cycles"))
        used = iterations / decisions if decisions and iterations else None
        times = [_median(rows, f"plan_ms_p{q}") for q in (50, 95, 99)]
        return [
            decisions,
            used,
            *times,
            slowest,
            Rate(late, of, wilson(late, of)),
            _median(rows, "realtime_factor"),
        ]

    columns = (_SCENARIO, _VARIANT, _DECISIONS, _EFFORT, _P50, _P95, _P99, _WORST, _MISSES, _REAL)
    planning = {key: rows for key, rows in groups.items() if rows[0]["planner"] != TWIN}
    return Table(
        "planning",
        "Planning time",
        "Wall time of decisions; it differs from machine to machine.",
        columns,
        _each(planning, cells),
    )


def _between(groups: Groups) -> Table:
    """Every two variants of a scenario, SUMO's driver left out."""
    driven = {key: rows for key, rows in groups.items() if rows[0]["planner"] != TWIN}
    lines: list[tuple[Cell, ...]] = []
    for ((scenario, _), one), ((other, _), two) in combinations(driven.items(), 2):
        both = pairs(one, two) if scenario == other else []
        if both:
            happened = (arrived, collided, at_fault, some("imposed_brakes_3"))
            lines.append(
                (
                    scenario,
                    labelled(one[0]),
                    labelled(two[0]),
                    len(both),
                    time_ratio(both),
                    *(contrast(both, each) for each in happened),
                )
            )
    columns = (_SCENARIO, _VARIANT, Column("against", "Against", "The other variant."), _PAIRS,
    _RATIO, _ARRIVED, _COLLISIONS, _AT_FAULT,
               Column("imposed_brakes_3", "Imposed beyond 3", _IMPOSED.format(3)))  # fmt: skip
    about = (
        "Pairs of the same seed: episodes of the one : of the other, and the difference per "
        "hundred episodes with a 95 % bootstrap interval."
    )
    return Table("variants", "Between variants", about, columns, tuple(lines))


def _known(rows: Iterable[Row], key: str) -> list[float]:
    return [row[key] for row in rows if row[key] is not None]


def _sum(rows: Iterable[Row], key: str) -> float:
    return sum(_known(rows, key))


def _median(rows: Iterable[Row], key: str) -> float | None:
    values = _known(rows, key)
    return float(np.median(values)) if values else None


def _mean(rows: Iterable[Row], key: str) -> float | None:
    values = _known(rows, key)
    return float(np.mean(values)) if values else None


# --- episodes worth a look ---


def worth_a_look(rows: Iterable[Row], most: int) -> tuple[list[Look], int]:
    """Episodes in which something went wrong, and EACH of the hardest moments of every kind, for
    each scenario and variant, else its first episode; at most so many in all, and of how many. In
    turns, the gravest of everyone first, so that one bad driver does not fill the list; drivers
    that do not search after those that do, and SUMO's own driver not at all."""
    found: list[
        tuple[tuple[Any, ...], tuple[Any, ...], Look]
    ] = []  # when it is chosen, where it stands
    for those in grouped(row for row in rows if row["planner"] != TWIN).values():
        why = {row["key"]: reasons(row) for row in those}
        known = sorted((reason, key) for key, found_here in why.items() for reason in found_here)
        ranks = {
            each: rank
            for kind in range(KINDS)
            for rank, each in enumerate(each for each in known if each[0][0] == kind)
        }
        for row in those:
            ranked = [(ranks[reason, row["key"]], *reason) for reason in why[row["key"]]]
            worth = [
                (rank, gravity, words)
                for rank, gravity, _, words in ranked
                if gravity <= WRONG or rank < EACH
            ]
            if worth:
                planner, gravity = (
                    planner_rank(row["planner"]),
                    min(gravity for _, gravity, _ in worth),
                )
                turn, rank = min(
                    (rank // EACH if gravity <= WRONG else rank, rank) for rank, gravity, _ in worth
                )
                look = Look(row, tuple(words for _, _, words in worth))
                found.append(
                    (
                        (planner > planner_rank(""), turn, gravity, rank, planner),
                        (gravity, planner, rank),
                        look,
                    )
                )
        if not known:
            planner = planner_rank(those[0]["planner"])
            found.append(
                (
                    (planner > planner_rank(""), 0, KINDS, 0, planner),
                    (KINDS, planner, 0),
                    Look(min(those, key=order), ("nothing happened",)),
                )
            )
    chosen = sorted(found, key=lambda each: each[0])[:most]
    return [look for _, _, look in sorted(chosen, key=lambda each: each[1])], len(found)


# --- as text ---


def text(cell: Cell, column: Column) -> str:
    """A cell in words, with its interval."""
    if isinstance(cell, Rate):
        return f"{cell.k}/{cell.n}{spread(cell)}"
    if isinstance(cell, Estimate):
        return f"{number(cell.value, column.digits)}{spread(cell)}"
    if isinstance(cell, Contrast):
        return f"{cell.k}:{cell.other}, {signed(cell.per_hundred)}{spread(cell)}"
    if cell is None:
        return "-"
    return (
        cell
        if isinstance(cell, str)
        else number(cell, column.digits if isinstance(cell, float) else 0)
    )


def spread(cell: Rate | Estimate | Contrast) -> str:
    """The interval in brackets, after a space; nothing where there is none."""
    if cell.interval is None:
        return ""
    show: Callable[[float], str] = {Rate: _percent, Contrast: signed, Estimate: number}[type(cell)]
    low, high = map(show, cell.interval)
    return f" ({low}..{high}{' %' if isinstance(cell, Rate) else ''})"


def number(value: float, digits: int = 2) -> str:
    """With so many digits; infinite as such."""
    return f"{value:,.{digits}f}".replace(",", "\u2009") if math.isfinite(value) else "∞"


def signed(value: float) -> str:
    """Episodes per hundred, with their sign."""
    return "0.0" if abs(value) < 0.05 else f"{value:+.1f}".replace("-", "\u2212")


def _percent(share: float) -> str:
    """In percent, finer where it is small or large."""
    value = 100 * share
    return f"{value:.1f}" if 0.05 <= value < 10 or 90 < value < 99.95 else f"{value:.0f}"


def markdown(table: Table) -> str:
    """A table in Markdown, with its heading."""
    lines = [
        f"## {table.title}",
        "",
        table.about,
        "",
        _line(f"{c.label}, {c.unit}" if c.unit else c.label for c in table.columns),
    ]
    lines.append(
        _line(
            "---:" if any(_numeric(row[i]) for row in table.rows) else "---"
            for i in range(len(table.columns))
        )
    )
    lines += [
        _line(text(cell, column) for cell, column in zip(row, table.columns, strict=True))
        for row in table.rows
    ]
    return "\n".join(lines) + "\n"


def looks_markdown(looks: Sequence[Look]) -> str:
    """The episodes worth a look, in Markdown."""
    lines = [
        "## Episodes worth a look",
        "",
        _line(("Episode", "Outcome", "Why")),
        _line(("---",) * 3),
    ]
    lines += [
        _line((look.row["key"], look.row["outcome"].replace("_", " "), "; ".join(look.reasons)))
        for look in looks
    ]
    return "\n".join(lines) + "\n"


def _line(cells: Iterable[str]) -> str:
    plain_cells = (cell.replace("|", "&#124;").replace("\n", " ") or " " for cell in cells)
    return f"| {' | '.join(plain_cells)} |"


def _numeric(cell: Cell) -> bool:
    return cell is not None and not isinstance(cell, str)


def report_markdown(results: Results, found: Sequence[Table], looks: Sequence[Look]) -> str:
    """The whole report in Markdown."""
    head = [f"# {results.name}", *([results.description] if results.description else [])]
    parts = [*head, *(markdown(table) for table in found if table.rows)]
    if looks:
        parts.append(looks_markdown(looks))
    if results.notes:
        parts.append("\n".join(["## Notes", "", *(f"- {note}" for note in results.notes)]))
    return "\n\n".join(part.strip() for part in parts) + "\n"


# --- as data ---


def report_document(
    results: Results, found: Sequence[Table], looks: Sequence[Look], of: int
) -> dict[str, Any]:
    """The whole report for JSON."""
    return {
        "schema_version": SCHEMA_VERSION,
        "name": results.name,
        "description": results.description,
        "episodes": len(results.rows),
        "notes": list(results.notes),
        "tables": {table.name: document(table) for table in found},
        "worth_a_look": {
            "of": of,
            "episodes": [
                {
                    "key": look.row["key"],
                    "outcome": look.row["outcome"],
                    "reasons": list(look.reasons),
                }
                for look in looks
            ],
        },
    }


def flat(table: Table) -> tuple[list[str], list[Row]]:
    """Columns and rows for CSV: a rate is KEY_k, KEY_n, KEY_low and KEY_high, and so on; infinite
    is `inf`."""
    rows = [
        {
            name: value
            for cell, column in zip(row, table.columns, strict=True)
            for name, value in _parts(cell, column.key)
        }
        for row in table.rows
    ]
    return list(dict.fromkeys(name for row in rows for name in row)) or [
        column.key for column in table.columns
    ], rows


def _parts(cell: Cell, key: str) -> Iterator[tuple[str, Any]]:
    for name, value in plain(cell).items() if isinstance(cell, tuple) else [("", cell)]:
        yield (f"{key}_{name}" if name not in ("", "value") else key), value


def plain(cell: Rate | Estimate | Contrast) -> dict[str, Any]:
    """The parts of a cell by name, its interval as `low` and `high`; infinite ones as the text
    `inf`."""
    low, high = cell.interval or (None, None)
    parts = {**cell._asdict(), "low": low, "high": high}
    return {
        name: "inf" if value == math.inf else value
        for name, value in parts.items()
        if name != "interval"
    }


def document(table: Table) -> dict[str, Any]:
    """A table for JSON."""
    columns = [
        {"key": c.key, "label": c.label, "unit": c.unit, "about": c.about} for c in table.columns
    ]
    rows = [
        {
            c.key: plain(cell) if isinstance(cell, tuple) else cell
            for cell, c in zip(row, table.columns, strict=True)
        }
        for row in table.rows
    ]
    return {"title": table.title, "about": table.about, "columns": columns, "rows": rows}
