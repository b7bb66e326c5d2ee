"""The highlights of a report: which episodes it lists, and why."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from sumo_mcts.records import Row
from sumo_mcts.records.highlights import KINDS, WRONG, Reason, order, reasons
from sumo_mcts.records.statistics import Place, place
from sumo_mcts.reporting.variants import driven, grouped, planner_rank, twins_of

# Hard moments of one kind, of a scenario and variant, that are shown; a batch keeps HARDEST.
EACH = 3


class Highlight(NamedTuple):
    """An episode worth a look, and why."""

    row: Row
    reasons: tuple[str, ...]  # the gravest first


class _Candidate(NamedTuple):
    """A highlight that may be shown."""

    turn: tuple[Any, ...]  # the order in which candidates are chosen
    place: tuple[Any, ...]  # the order in which the chosen ones are listed
    highlight: Highlight


def choose_highlights(rows: Sequence[Row], most: int) -> tuple[list[Highlight], int]:
    """The highlights to show, `most` at most, and how many there are.

    For each scenario and variant these are the episodes in which something went wrong, and EACH of
    the hardest moments of every kind. Without any of these it is the first episode. They are chosen
    in turns, the gravest of each variant first, so that one bad planner does not fill the list.
    Planners that do not search come after those that do; SUMO's own driver is left out.
    """
    twins = {place(twin): twin for twin in reversed(twins_of(rows))}
    groups = grouped(driven(rows)).values()
    found = [each for those in groups for each in _candidates(those, twins)]
    chosen = sorted(found, key=lambda each: each.turn)[:most]
    return [each.highlight for each in sorted(chosen, key=lambda each: each.place)], len(found)


def _candidates(rows: Sequence[Row], twins: Mapping[Place, Row]) -> list[_Candidate]:
    """The highlights of one scenario and variant."""
    planner = planner_rank(rows[0]["planner"])
    later = planner > planner_rank("")
    why = {row["key"]: reasons(row, twins.get(place(row))) for row in rows}
    if not any(why.values()):
        first = Highlight(min(rows, key=order), ("nothing happened",))
        return [_Candidate((later, 0, KINDS, 0, planner), (KINDS, planner, 0), first)]
    ranks, found = _ranks(why), []
    for row in rows:
        shown = [
            (ranks[reason, row["key"]], reason)
            for reason in why[row["key"]]
            if reason.kind <= WRONG or ranks[reason, row["key"]] < EACH
        ]
        if shown:
            gravest, grave_rank = min((reason.kind, rank) for rank, reason in shown)
            turn, rank = min(
                (rank // EACH if reason.kind <= WRONG else rank, rank) for rank, reason in shown
            )
            found.append(
                _Candidate(
                    (later, turn, gravest, rank, planner),
                    (gravest, planner, grave_rank),
                    # an ego that is stuck has one of the longest stops, too
                    Highlight(row, tuple(dict.fromkeys(reason.words for _, reason in shown))),
                )
            )
    return found


def _ranks(why: dict[str, list[Reason]]) -> dict[tuple[Reason, str], int]:
    """The rank of each reason and key among those of its kind; 0: the gravest."""
    known = sorted((reason, key) for key, found in why.items() for reason in found)
    return {
        each: rank
        for kind in range(KINDS)
        for rank, each in enumerate(each for each in known if each[0].kind == kind)
    }
