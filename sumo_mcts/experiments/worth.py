"""Which traces of a batch are worth keeping: what went wrong, and of each scenario and variant the hardest moments."""

import bisect
import math
from collections import defaultdict
from typing import NamedTuple

from sumo_mcts.records import Row

HARDEST = 5  # of each scenario, variant and score

_SCORES = {"imposed_max_decel_mps2": 1.0, "min_ttc_s": -1.0, "min_pet_s": -1.0}  # key of the row -> sign with which more is harder
_NOTHING = -math.inf  # the score of a row that has none


class Bar(NamedTuple):
    """What a trace has to reach to be worth keeping, as known when its episode began. It only rises, so no trace is missed."""

    wrong: bool  # whether those of episodes in which something went wrong are
    scores: tuple[float, ...]  # and those that reach one of these


def went_wrong(row: Row) -> bool:
    """A collision or any other outcome than arriving, or a fail-safe manoeuvre."""
    return row["outcome"] != "arrived" or bool(row["failsafe_interventions"])


def is_worth(row: Row, bar: Bar) -> bool:
    """Whether a trace is wanted, as far as the bar tells."""
    return (bar.wrong and went_wrong(row)) or any(score >= least for score, least in zip(_scores(row), bar.scores, strict=True))


class Worth:
    """Follows a batch: the traces of which rows are worth keeping so far. The choice in the end does not depend on the order of the rows."""

    def __init__(self, rule: str) -> None:
        """`rule`: the key `traces` of the experiment, worth, all or none."""
        self._rule = rule
        self._hardest: dict[tuple[str, str], list[list[tuple[float, str]]]] = defaultdict(lambda: [[] for _ in _SCORES])
        self._wrong: set[str] = set()

    def bar(self, scenario: str, variant: str) -> Bar:
        """For the next episode of this scenario and variant."""
        match self._rule:
            case "all":
                return Bar(True, (_NOTHING,) * len(_SCORES))
            case "none":
                return Bar(False, (math.inf,) * len(_SCORES))
        return Bar(True, tuple(-best[-1][0] if len(best) == HARDEST else math.nextafter(_NOTHING, 0.0) for best in self._hardest[scenario, variant]))

    def add(self, row: Row) -> set[str]:
        """Count a row; returns the keys whose traces are not worth it any more, perhaps its own."""
        key = row["key"]
        if self._rule != "worth":
            return set() if self._rule == "all" else {key}
        if went_wrong(row):
            self._wrong.add(key)
        lost = {key}
        for score, best in zip(_scores(row), self._hardest[row["scenario"], row["variant"]], strict=True):
            if score > _NOTHING:
                bisect.insort(best, (-score, key))
                lost.update(key for _, key in best[HARDEST:])
                del best[HARDEST:]
        return {key for key in lost if not self._holds(row["scenario"], row["variant"], key)}

    def _holds(self, scenario: str, variant: str, key: str) -> bool:
        return key in self._wrong or any(key == held for best in self._hardest[scenario, variant] for _, held in best)


def _scores(row: Row) -> list[float]:
    """How hard each of the moments was; nothing where nothing is known, and where nobody had to brake."""
    return [sign * row[name] if row[name] is not None and (sign < 0.0 or row[name] > 0.0) else _NOTHING for name, sign in _SCORES.items()]
