"""What rollouts have driven beyond the nodes of the tree, so that none of it is driven again.

The model is deterministic, and rollouts from one node begin alike: one that follows and then brakes
follows at first like the one that only follows. So what was driven is kept as a tree behind each
node of the search, with a row for each ply. Compiled.
"""

from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats, Indices
from sumo_mcts.numerics.kernel import kernel

NOT_DRIVEN = 0  # in Continued.begin and Continued.then; row 0 is not used
SIDES = 3  # to the right, none or what the route needs, to the left


class Continued(NamedTuple):
    """M rows: the states in which rollouts begin, and those after each of their plies; for N nodes,
    W wishes for the acceleration, R reacting agents. Units as in tree.Tree."""

    begin: Indices  # [N] the row in which the rollouts from a node begin, or NOT_DRIVEN
    then: Indices  # [M, W * SIDES] the row after the next ply (see choice), or NOT_DRIVEN
    side: Indices  # [M] of the lane change with which the ply began
    end: Indices  # [M] ALIVE, LOST or ARRIVED
    where: Indices  # [M, 2] the ego's state, as motion
    motion: Floats  # [M, 5]
    followers: Indices  # [M]
    leader: Floats  # [M, 2]
    others: Floats  # [M, R, 2]
    j: Floats  # [M] from the root; at the horizon with the cost of the time after it
    used: Indices  # [1] rows in use


def nothing_continued(nodes: int, rows: int, wishes: int, reacting: int) -> Continued:
    """Nothing driven yet. Rows are written when they are taken."""
    return Continued(
        begin=np.full(nodes, NOT_DRIVEN, np.int64),
        then=np.empty((rows, wishes * SIDES), np.int64),
        side=np.empty(rows, np.int64),
        end=np.empty(rows, np.int64),
        where=np.empty((rows, 2), np.int64),
        motion=np.empty((rows, 5)),
        followers=np.empty(rows, np.int64),
        leader=np.empty((rows, 2)),
        others=np.empty((rows, reacting, 2)),
        j=np.empty(rows),
        used=np.ones(1, np.int64),
    )


@kernel
def choice(wish: int, side: int) -> int:
    """The column of Continued.then for a wish and the side of a lane change that was drawn."""
    return wish * SIDES + side + 1


@kernel
def new_row(used: Indices, then: Indices) -> tuple[int, bool]:
    """A row to write to, after which nothing is driven yet, and whether it may be kept: the last
    one never is, and serves again and again once the others are taken. Two fields of Continued."""
    last = len(then) - 1
    row = min(used[0], last)
    for k in range(then.shape[1]):
        then[row, k] = NOT_DRIVEN
    if row == last:
        return last, False
    used[0] += 1
    return row, True
