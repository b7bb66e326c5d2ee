"""The variants of a report: how rows are grouped by them, their labels, order and colours."""

from collections.abc import Iterable, Sequence
from itertools import cycle

from sumo_mcts.records import Row
from sumo_mcts.records.statistics import TWIN
from sumo_mcts.registry import PLANNERS, PLUGIN_RANK, is_oracle

# Planners with a colour of their own.
KNOWN = tuple(row.name for row in PLANNERS.values() if row.colour)
FURTHER = 6  # colours that belong to no planner

Groups = dict[tuple[str, str], list[Row]]


def grouped(rows: Iterable[Row]) -> Groups:
    """The rows of each scenario and variant, in the order in which they come."""
    groups: Groups = {}
    for row in rows:
        groups.setdefault((row["scenario"], row["variant"]), []).append(row)
    return groups


def twins_of(rows: Iterable[Row]) -> list[Row]:
    """The episodes that SUMO's own driver drove."""
    return [row for row in rows if row["planner"] == TWIN]


def driven(rows: Iterable[Row]) -> list[Row]:
    """The episodes that another planner than SUMO's own driver drove."""
    return [row for row in rows if row["planner"] != TWIN]


def labelled(row: Row) -> str:
    """The variant of a row, with a word where its forecast is an oracle."""
    return f"{row['variant']} (oracle)" if is_oracle(row["prediction"]) else str(row["variant"])


def labels(rows: Iterable[Row]) -> dict[str, str]:
    """The label of each variant."""
    return {row["variant"]: labelled(row) for row in rows}


def planner_rank(planner: str | None) -> int:
    """Where a planner stands in tables and figures."""
    row = PLANNERS.get(planner or "")
    return PLUGIN_RANK if row is None else row.rank


def foremost(rows: Sequence[Row]) -> str:
    """The variant that is shown first: of the first planner, the one with the largest budget."""

    def place(row: Row) -> tuple[int, float]:
        return planner_rank(row["planner"]), -(row["iterations_per_decision"] or 0)

    return str(min(rows, key=place)["variant"])


def colours(rows: Iterable[Row]) -> dict[str, str]:
    """The CSS class that gives the marks of each variant their colour.

    The first variant of a planner has the planner's own colour. The others have those of planners
    that drive nowhere here, then further ones, in turns.
    """
    own = {
        row["variant"]: f"p-{row['planner']}" if row["planner"] in KNOWN else "p-other"
        for row in rows
    }
    first = {colour: variant for variant, colour in reversed(own.items())}
    spare = [f"p-{planner}" for planner in KNOWN if planner != TWIN and f"p-{planner}" not in first]
    free = cycle([*spare, *(f"p-further-{k}" for k in range(1, FURTHER + 1))])
    return {
        variant: colour if first[colour] == variant else next(free)
        for variant, colour in own.items()
    }


def planner_style() -> str:
    """CSS: the colours of the planners that have one of their own."""
    return "".join(
        f".p-{row.name} {{ --c: {row.colour}; }}\n" for row in PLANNERS.values() if row.colour
    )
