"""How long a search goes on: until its passes are made or its time is up, and longer while the
choice is close."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from sumo_mcts.model.local_map import MOTION_V
from sumo_mcts.planners.tree import Tree

SLICE = 20_000  # passes after which Ctrl-C takes effect
STAGES = 4  # a close choice gets iterations / STAGES more passes at a time
FASTEST = 500_000.0  # passes/s that no search exceeds
LARGEST = 1_000_000  # largest number of passes, for about 300 MB
DIFFERENT = 0.5  # m/s after the first action from which two actions are not the same command
# decisions from which is learned how long it takes from the end of a search to the decision
MEMORY = 20
SPARE = 1.25  # times the longest of them is kept free
# share of a time budget that is kept free: before anything was learned, and at most
AT_FIRST, AT_MOST = 0.25, 0.5


class Budget(NamedTuple):
    """See config.PlannerConfig."""

    iterations: int
    most: int  # no less than iterations
    close: float  # J


def part(budget: Budget, share: float) -> Budget:
    """A share of the passes."""
    return budget._replace(iterations=int(budget.iterations * share), most=int(budget.most * share))


def passes_within(iterations: int, seconds: float) -> int:
    """The number of passes; with a time budget (s, else inf) more than can be made in it."""
    return (
        iterations if math.isinf(seconds) else min(100 + int(FASTEST * max(seconds, 0.0)), LARGEST)
    )


def next_passes(budget: Budget, tree: Tree, made: int) -> int:
    """How many passes to make after these; 0: it is enough."""
    if tree.closed[0]:
        return 0
    if made < budget.iterations:
        return min(SLICE, budget.iterations - made)
    if made < budget.most and is_close(tree, budget.close):
        return min(SLICE, max(1, budget.iterations // STAGES), budget.most - made)
    return 0


def next_passes_in_time(tree: Tree, made: int, spent: float, left: float) -> int:
    """Likewise where time counts (s): half of what fits into the time left, judged by those made.

    Every action of the root is tried once in any case.
    """
    if tree.closed[0]:
        return 0
    if made == 0:
        return 2 * tree.child.shape[1]  # where following leads to a contact, braking is tried too
    return max(1, min(SLICE, int(0.5 * left * made / spent))) if left > 0.0 else 0


def is_close(tree: Tree, within: float) -> bool:
    """Whether another command than the best could still become the best, and costs no more than
    `within` more by now."""
    found = tree.child[0][tree.child[0] >= 0]
    best = found[np.argmin(tree.best[found])]
    other = np.any(tree.where[found] != tree.where[best], axis=1) | (
        np.abs(tree.motion[found, MOTION_V] - tree.motion[best, MOTION_V]) > DIFFERENT
    )
    return bool(
        np.any(other & ~tree.closed[found] & (tree.best[found] - tree.best[best] <= within))
    )


class Timekeeper:
    """Says until when a search may go on so that the decision is there in time: what comes after it
    took as long before."""

    def __init__(self, seconds: float) -> None:
        """`seconds` for a whole decision; inf: as long as it takes."""
        self._seconds = seconds
        self._after: deque[float] = deque(maxlen=MEMORY)

    def until(self, began: float) -> float:
        """When to stop searching for a decision that began then (s, on one clock)."""
        share = min(SPARE * max(self._after) / self._seconds, AT_MOST) if self._after else AT_FIRST
        return began + (1.0 - share) * self._seconds

    def note(self, until: float, ended: float) -> None:
        """A decision that was to search `until` was there at `ended`.

        An earlier end says nothing about the time needed.
        """
        if ended > until:
            self._after.append(ended - until)
