"""The tree of the search as arrays: its nodes, backpropagation, and closed branches. Compiled."""

from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices
from sumo_mcts.model.interaction import Neighbours
from sumo_mcts.model.local_map import (
    MOTION_A,
    MOTION_S,
    MOTION_V,
    WHERE_NODE,
    WHERE_OTHER,
    State,
    keep_state,
)
from sumo_mcts.numerics.kernel import inlined, kernel
from sumo_mcts.planners.actions import ACCEL, SIDE, copy_line, no_actions, put_action
from sumo_mcts.planners.continued import Continued, nothing_continued
from sumo_mcts.planners.ply import NONE
from sumo_mcts.scene import COMFORT, OTHER, PASSABILITY, SAFETY

GAP, LEADER_V = range(2)  # columns of Tree.leader
WISHES = 4  # of a rollout for its acceleration (see search.py)
# rows of Continued for each node: 3.1 were taken for each pass; without room plies are driven again
KEPT = 4


class Tree(NamedTuple):
    """M nodes, A actions, R reacting agents. Node 0 is the root."""

    parent: Indices  # [M]
    child: Indices  # [M, A] NONE: untried, IMPOSSIBLE
    level: Indices  # [M]
    visits: Indices  # [M]
    total: Floats  # [M] sum of the costs J backed up
    best: Floats  # [M] lowest J found below
    # [M] nothing below is left to try: lost, arrived, all children closed, or (adaptive) nothing
    # better can be there
    closed: Bools
    end: Indices  # [M] ALIVE, LOST or ARRIVED
    # the ego's state (local_map.keep_state): [M, 2] WHERE_NODE, WHERE_OTHER, the lane of its front
    # and the other lane of a change; [M, 5] MOTION_S (m), MOTION_V (m/s), MOTION_A (m/s2),
    # MOTION_PROGRESS (0..1 of a change), MOTION_TURN (rad)
    where: Indices
    motion: Floats
    followers: Indices  # [M] bit mask, see Neighbours
    leader: Floats  # [M, 2] GAP (m) and LEADER_V (m/s)
    others: Floats  # [M, R, 2] the agents that the search moves (see model/reactions.py)
    cost: Floats  # [M, 4] SAFETY .. OTHER from the root
    least: Floats  # [M] J from there on is no lower (model/least_cost.py), where the search prunes
    # of the tree, not of a node:
    moving: Floats  # [R, 2] scratch for the agents that the search moves
    plan: Floats  # [A, levels, 3] for each root action the best sequence (see actions.py)
    line: Floats  # [levels, 3] scratch
    used: Indices  # [1] nodes in use
    continued: Continued  # by rollouts


def new_tree(size: int, actions: int, plies: int, others: Floats) -> Tree:
    """An empty tree for `size` nodes and sequences of `plies` actions.

    `others` [R, 2]: the agents that the search moves, as they are now.
    """
    moved = np.zeros((size, *others.shape))
    moved[0] = others
    return Tree(
        parent=np.full(size, NONE, np.int64),
        child=np.full((size, actions), NONE, np.int64),
        level=np.zeros(size, np.int64),
        visits=np.zeros(size, np.int64),
        total=np.zeros(size),
        best=np.full(size, np.inf),
        closed=np.zeros(size, np.bool_),
        end=np.zeros(size, np.int64),
        where=np.full((size, 2), NONE, np.int64),
        motion=np.zeros((size, 5)),
        followers=np.zeros(size, np.int64),
        leader=np.zeros((size, 2)),
        others=moved,
        cost=np.zeros((size, 4)),
        least=np.zeros(size),
        moving=others.copy(),
        plan=no_actions(actions, plies),
        line=no_actions(plies),
        used=np.zeros(1, np.int64),
        continued=nothing_continued(size, KEPT * size, WISHES, len(others)),
    )


# --- nodes ---


@kernel
def store(tree: Tree, i: int, state: State, near: Neighbours) -> None:
    """Write the ego's state and the traffic around it into node i."""
    keep_state(tree.where, tree.motion, i, state)
    tree.followers[i] = near.followers
    tree.leader[i, GAP], tree.leader[i, LEADER_V] = near.gap, near.leader_v


@inlined
def near_of(tree: Tree, i: int) -> Neighbours:
    """The traffic around the ego in node i."""
    return Neighbours(tree.leader[i, GAP], tree.leader[i, LEADER_V], tree.followers[i])


@kernel
def spent(tree: Tree, node: int) -> float:
    """J from the root to a node."""
    return float(
        tree.cost[node, SAFETY]
        + tree.cost[node, COMFORT]
        + tree.cost[node, PASSABILITY]
        + tree.cost[node, OTHER]
    )


@kernel
def is_known(tree: Tree, node: int, action: int, state: State) -> bool:
    """Whether an earlier action led to the same state: the road or the bounds left no choice."""
    for k in range(action):
        i = tree.child[node, k]
        if (
            i >= 0
            and tree.where[i, WHERE_NODE] == state.node
            and tree.where[i, WHERE_OTHER] == state.other
            and abs(tree.motion[i, MOTION_S] - state.s) < 1e-6
            and abs(tree.motion[i, MOTION_V] - state.v) < 1e-6
            and abs(tree.motion[i, MOTION_A] - state.a) < 1e-6
        ):
            return True
    return False


# --- backpropagation ---


@kernel
def back_up(tree: Tree, actions: Floats, node: int, j: float, line: Floats) -> None:
    """Count a visit in every node up to the root, and keep the best J there.

    Each root action keeps the sequence behind its best J: the actions in the tree, then `line`
    [levels, 3].
    """
    i = node
    while i != NONE:
        tree.visits[i] += 1
        tree.total[i] += j
        better = j < tree.best[i] or (tree.visits[i] == 1 and j <= tree.best[i])
        tree.best[i] = min(tree.best[i], j)
        if tree.level[i] == 1 and better:
            k = _action_of(tree, 0, i)
            copy_line(line, tree.plan[k])
            _trace_back(tree, actions, node, k)
        i = tree.parent[i]


@kernel
def _action_of(tree: Tree, node: int, child: int) -> int:
    for k in range(tree.child.shape[1]):
        if tree.child[node, k] == child:
            return k
    return NONE


@kernel
def _trace_back(tree: Tree, actions: Floats, node: int, row: int) -> None:
    """Write the actions from the root to a node into the sequence of root action `row`."""
    while tree.parent[node] != NONE:
        k = _action_of(tree, tree.parent[node], node)
        put_action(tree.plan[row], tree.level[node] - 1, actions[k, ACCEL], int(actions[k, SIDE]))
        node = tree.parent[node]


# --- closed branches ---


@kernel
def is_exhausted(tree: Tree, node: int) -> bool:
    """Whether every action of a node was tried, and every child is closed."""
    for k in range(tree.child.shape[1]):
        i = tree.child[node, k]
        if i == NONE or (i >= 0 and not tree.closed[i]):
            return False
    return True


@kernel
def close_branch(tree: Tree, node: int) -> None:
    """Close a node, below which nothing is left to try, and its ancestors that have nothing
    else."""
    tree.closed[node] = True
    i = tree.parent[node]
    while i != NONE and is_exhausted(tree, i):
        tree.closed[i] = True
        i = tree.parent[i]
