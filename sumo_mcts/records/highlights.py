"""Highlights: the episodes that are worth a look.

These are the episodes in which something went wrong; and of each scenario and variant those with
the hardest moments, or else the first one. A batch keeps their traces, and a report shows some.

The order is that of the harm: a collision at fault, then an ego that is stuck, then what others did
to it. A batch does not know the twin when an episode ends: there an ego is stuck where its time was
up, and the longest stops are hard moments.
"""

import bisect
import math
from collections import defaultdict
from typing import NamedTuple

from sumo_mcts.records.measures import Row
from sumo_mcts.records.statistics import TWIN, arrived, at_fault, collided, timed_out

HARDEST = 5  # of each scenario, variant and kind of hard moment a batch keeps so many
STUCK_S = 30.0  # of standing at a stretch; so much longer than its twin an ego is stuck
KINDS = 9  # of reasons
WRONG = 4  # up to this kind something went wrong; beyond it are hard moments
Order = tuple[float, str, str]  # of the episodes of a variant: seed, ego, key
_FIRST, _LAST = (-math.inf, "", ""), (math.inf, "", "")


class Reason(NamedTuple):
    """Why an episode may be a highlight."""

    kind: int  # 0: gravest
    gravity: float  # within the kind; lower is graver
    words: str


class Bar(NamedTuple):
    """What an episode has to reach for its trace to be kept, as known when the episode began.

    The bar only rises, so no trace is missed.
    """

    twins: bool  # traces of SUMO's own driver are kept, which no report shows
    wrong: bool  # traces of episodes in which something went wrong are kept
    hard: tuple[float, ...]  # by kind: the gravity that a hard moment needs
    quiet: Order  # an episode in which nothing happened has to come before this one


def reasons(row: Row, twin: Row | None = None) -> list[Reason]:
    """Why an episode may be a highlight, the gravest first; empty where nothing happened.

    `twin`: SUMO's own driver in the same place, where it is known.
    """
    found: list[Reason] = []
    if collided(row) and at_fault(row):
        found.append(Reason(0, 0.0, "collision at fault"))
    if words := _stuck(row, twin):
        found.append(Reason(1, -_longest_stop(row), words))
    if collided(row) and not at_fault(row):
        found.append(Reason(2, 0.0, "collision, not at fault"))
    if not (arrived(row) or collided(row) or timed_out(row)):
        found.append(Reason(3, 0.0, row["outcome"].replace("_", " ")))
    if count := row["failsafe_interventions"]:
        found.append(
            Reason(4, -count, f"{count:g} fail-safe intervention{'s' if count > 1 else ''}")
        )
    return found + _hard_moments(row, twin)


def _hard_moments(row: Row, twin: Row | None) -> list[Reason]:
    """What was hard in an episode, though nothing may have gone wrong."""
    found: list[Reason] = []
    ttc, pet, imposed = row["min_ttc_s"], row["min_pet_s"], row["imposed_max_decel_mps2"]
    if ttc is not None and not collided(row):
        found.append(Reason(5, ttc, f"TTC {ttc:.2f} s"))
    if pet is not None and not collided(row):
        found.append(Reason(6, pet, f"PET {pet:.2f} s"))
    if imposed:
        found.append(Reason(7, -imposed, f"imposed braking {imposed:.1f} m/s²"))
    if _longest_stop(row) >= STUCK_S and not timed_out(row):
        found.append(Reason(8, -_longest_stop(row), _stop_words(row, twin)))
    return found


def _stuck(row: Row, twin: Row | None) -> str:
    """How an ego was stuck, in words: its time was up, or it stood far longer than its twin; ""
    where it was not."""
    if timed_out(row):
        return ", ".join(["timeout", *([_stop_words(row, twin)] if _longest_stop(row) else [])])
    if twin is None or twin.get("longest_stop_s") is None:
        return ""
    far = _longest_stop(row) >= _longest_stop(twin) + STUCK_S
    return _stop_words(row, twin) if far else ""


def _stop_words(row: Row, twin: Row | None) -> str:
    other = None if twin is None else twin.get("longest_stop_s")
    beside = "" if other is None else f", its twin {other:.0f} s"
    return f"stood {_longest_stop(row):.0f} s at a stretch{beside}"


def _longest_stop(row: Row) -> float:
    """In s; 0 where it is unknown, as in a batch that a version without this key began."""
    return row.get("longest_stop_s") or 0.0


def order(row: Row) -> Order:
    """Where an episode stands among those of its variant: by seed, ego and key."""
    return row["seed"] if row["seed"] is not None else -1, row["ego"] or "", row["key"]


def is_highlight(row: Row, bar: Bar) -> bool:
    """Whether the trace of an episode is kept by this bar."""
    if row["planner"] == TWIN:
        return bar.twins
    found = reasons(row)
    return (
        any(
            bar.wrong if each.kind <= WRONG else each.gravity <= bar.hard[each.kind - WRONG - 1]
            for each in found
        )
        if found
        else order(row) < bar.quiet
    )


class TraceSelection:
    """Follows a batch: the traces of which episodes are kept so far.

    What is kept in the end does not depend on the order of the episodes.
    """

    def __init__(self, rule: str) -> None:
        """`rule`: the key `traces` of the experiment: worth, all or none."""
        self._rule = rule
        self._hardest: dict[tuple[str, str], list[list[tuple[float, str]]]] = defaultdict(
            lambda: [[] for _ in range(WRONG + 1, KINDS)]
        )
        # The first episode in which nothing happened; _FIRST: in some something did.
        self._quiet: dict[tuple[str, str], Order] = defaultdict(lambda: _LAST)
        self._wrong: set[str] = set()

    def bar(self, scenario: str, variant: str) -> Bar:
        """What the next episode of this scenario and variant has to reach."""
        hardest = self._hardest[scenario, variant]
        match self._rule:
            case "all":
                return Bar(True, True, (math.inf,) * len(hardest), _LAST)
            case "none":
                return Bar(False, False, (-math.inf,) * len(hardest), _FIRST)
        return Bar(
            False,
            True,
            tuple(best[-1][0] if len(best) == HARDEST else math.inf for best in hardest),
            self._quiet[scenario, variant],
        )

    def add(self, row: Row) -> set[str]:
        """Count an episode; the keys whose traces are not kept any more, perhaps its own."""
        key, group = row["key"], (row["scenario"], row["variant"])
        if self._rule != "worth" or row["planner"] == TWIN:
            return set() if self._rule == "all" else {key}
        found, lost = reasons(row), {key}
        for each in found:
            if each.kind <= WRONG:
                self._wrong.add(key)
                continue
            best = self._hardest[group][each.kind - WRONG - 1]
            bisect.insort(best, (each.gravity, key))
            lost.update(key for _, key in best[HARDEST:])
            del best[HARDEST:]
        before = self._quiet[group]
        self._quiet[group] = _FIRST if found else min(before, order(row))
        lost |= {before[2]} - {""}
        return {key for key in lost if not self._holds(group, key)}

    def _holds(self, group: tuple[str, str], key: str) -> bool:
        return (
            key in self._wrong
            or self._quiet[group][2] == key
            or any(key == held for best in self._hardest[group] for _, held in best)
        )
