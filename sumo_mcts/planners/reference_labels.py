"""The labels of the reference's solver: states with the cheapest sequence found to each, merged in
cells and ranked by kind. Compiled."""

import math
from typing import NamedTuple

from sumo_mcts.arrays import Floats, Indices
from sumo_mcts.model.interaction import Neighbours
from sumo_mcts.model.local_map import (
    CLOCK,
    MOTION_TURN,
    SPEED,
    WHERE_NODE,
    WHERE_OTHER,
    State,
    keep_state,
)
from sumo_mcts.numerics.kernel import kernel
from sumo_mcts.planners.actions import copy_line
from sumo_mcts.planners.ply import copy_pairs
from sumo_mcts.planners.tree import GAP, LEADER_V

REACTING = 4  # columns of a cell from which on it has those of agents that react, see CELL


class Labels(NamedTuple):
    """M states at the end of a ply, each with the cheapest sequence found that leads to it.

    R agents that react, P plies.
    """

    where: Indices  # [M, 2] see local_map.keep_state
    motion: Floats  # [M, 5] likewise
    followers: Indices  # [M]
    leader: Floats  # [M, 2] gap (m) and speed of the leader
    others: Floats  # [M, R, 2] see model/reactions.py
    cost: Floats  # [M] so far
    bound: Floats  # [M] no continuation costs less in the end
    key: Indices  # [M] number of the cell, or of the kind
    rank: Indices  # [M] how many of its kind have a lower bound
    line: Floats  # [M, P, 3] actions that led here (see actions.py)


@kernel
def write_label(
    labels: Labels, k: int, state: State, near: Neighbours, others: Floats, cost: float
) -> None:
    """Write a state, the traffic around it and its cost into label k."""
    keep_state(labels.where, labels.motion, k, state)
    labels.followers[k], labels.cost[k] = near.followers, cost
    labels.leader[k, GAP], labels.leader[k, LEADER_V] = near.gap, near.leader_v
    copy_pairs(others, labels.others[k])


@kernel
def copy_label(source: Labels, i: int, target: Labels, k: int) -> None:
    """Copy label i of `source` to label k of `target`, but for its rank."""
    for n in range(MOTION_TURN + 1):
        target.motion[k, n] = source.motion[i, n]
    copy_line(source.line[i], target.line[k])
    copy_pairs(source.others[i], target.others[k])
    target.where[k, WHERE_NODE] = source.where[i, WHERE_NODE]
    target.where[k, WHERE_OTHER] = source.where[i, WHERE_OTHER]
    target.leader[k, GAP], target.leader[k, LEADER_V] = (
        source.leader[i, GAP],
        source.leader[i, LEADER_V],
    )
    target.followers[k], target.cost[k] = source.followers[i], source.cost[i]
    target.bound[k], target.key[k] = source.bound[i], source.key[i]


@kernel
def merge(table: Indices, cell: Floats, labels: Labels, new: int) -> int:
    """Label `new` among those before it: of two in a cell the cheaper one stays.

    `table`: label + 1 by the hash of its key, 0 free. Returns the number of labels.
    """
    key = _key(labels, new, cell)
    slot = _slot(table, labels, key)
    labels.key[new] = key
    if table[slot] == 0:
        table[slot] = new + 1
        return new + 1
    k = table[slot] - 1
    if labels.cost[new] < labels.cost[k]:
        copy_label(labels, new, labels, k)
    return new


@kernel
def rank(table: Indices, kind: Floats, labels: Labels, order: Indices) -> None:
    """Number the labels of each kind in this order.

    The best label of each kind comes before the second one of any kind. A label with a high cost
    now, such as after letting others go first, may lead to the lowest cost.
    """
    table[:] = 0
    for k in order:
        key = _key(labels, k, kind)
        slot = _slot(table, labels, key)
        labels.rank[k] = labels.rank[table[slot] - 1] + 1 if table[slot] != 0 else 0
        labels.key[k] = key
        table[slot] = k + 1


@kernel
def _slot(table: Indices, labels: Labels, key: int) -> int:
    """Where a key is in the table, or is to be."""
    slot = key % len(table)
    while table[slot] != 0 and labels.key[table[slot] - 1] != key:
        slot = (slot + 1) % len(table)
    return slot


@kernel
def _key(labels: Labels, k: int, cell: Floats) -> int:
    """A number for the cell of label k (`cell` as CELL), or for its kind (as KIND)."""
    low, high = _mixed(0, 0, labels.where[k, WHERE_NODE])
    low, high = _mixed(low, high, labels.where[k, WHERE_OTHER])
    for n in range(min(len(cell), REACTING)):
        low, high = _mixed(low, high, int(math.floor(labels.motion[k, n] / cell[n])))
    if len(cell) > REACTING:
        low, high = _mixed(low, high, labels.followers[k] % 2147483647)
        for r in range(labels.others.shape[1]):
            low, high = _mixed(
                low, high, int(math.floor(labels.others[k, r, CLOCK] / cell[REACTING]))
            )
            low, high = _mixed(
                low, high, int(math.floor(labels.others[k, r, SPEED] / cell[REACTING + 1]))
            )
    return low * 2147483648 + high


@kernel
def _mixed(low: int, high: int, number: int) -> tuple[int, int]:
    """Two hashes, by two primes below 2^31: nothing overflows, so that it is the same without
    compilation."""
    return (low * 1000003 + number + 1000000) % 2147483647, (
        high * 1299709 + number + 1000000
    ) % 2147483629
