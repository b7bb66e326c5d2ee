"""The paper's search, Algorithms 1 and 2 to the letter. Compiled.

Which reading was chosen where the text leaves it open: docs/planner.md.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from sumo_mcts.arrays import Floats, Indices
from sumo_mcts.model.local_map import LocalMap, State, keep_state, kept_state
from sumo_mcts.model.motion import (
    FREE,
    GOAL,
    OFF_END,
    RED_LINE,
    EgoParams,
    advance,
    begin_change,
    can_change,
)
from sumo_mcts.numerics.kernel import kernel, making_arrays
from sumo_mcts.planners.actions import ACCEL, SIDE
from sumo_mcts.planners.paper_cost import (
    Guide,
    Weights,
    comfort,
    lane_change,
    nearest,
    other,
    passability,
    safety,
)
from sumo_mcts.planners.ply import ALIVE, ARRIVED, IMPOSSIBLE, LOST, NONE
from sumo_mcts.scene import COMFORT, OTHER, PASSABILITY, SAFETY

# Accelerations of the rollout are drawn from LEAST on, m/s2: braking up to 5, accelerating up to 3.
LEAST, BRAKE_RANGE, ACCEL_RANGE = 1.0, 4.0, 2.0


class PaperTree(NamedTuple):
    """M nodes, A actions."""

    parent: Indices  # [M]
    child: Indices  # [M, A]
    level: Indices  # [M]
    visits: Indices  # [M] n(v)
    total: Floats  # [M] C(v)
    end: Indices  # [M]
    where: Indices  # [M, 2] see local_map.keep_state
    motion: Floats  # [M, 5] likewise
    cost: Floats  # [M, 4] SAFETY .. OTHER, weighted, from the root
    used: Indices  # [1]


def new_tree(size: int, actions: int) -> PaperTree:
    """An empty tree for `size` nodes."""
    return PaperTree(
        parent=np.full(size, NONE, np.int64),
        child=np.full((size, actions), NONE, np.int64),
        level=np.zeros(size, np.int64),
        visits=np.zeros(size, np.int64),
        total=np.zeros(size),
        end=np.zeros(size, np.int64),
        where=np.full((size, 2), NONE, np.int64),
        motion=np.zeros((size, 5)),
        cost=np.zeros((size, 4)),
        used=np.zeros(1, np.int64),
    )


@making_arrays
def search(
    tree: PaperTree, local: LocalMap, p: EgoParams, w: Weights, actions: Floats, root: State,
    guide: Guide, iterations: int, rng: Generator,
) -> None:  # fmt: skip
    """Algorithm 1: `iterations` passes from the state `root`; `actions` [A, 2] ACCEL, SIDE."""
    if tree.used[0] == 0:
        keep_state(tree.where, tree.motion, 0, root)
        tree.used[0] = 1
    for _ in range(iterations):
        node = _select(tree, w, rng)
        if tree.level[node] < w.look_ahead and tree.child[node, 0] == NONE:
            collided = expand(tree, local, p, w, actions, guide, node)
            if w.skips and collided:
                continue
        if w.dead_end_free and _is_dead_end(tree, node):
            cost = 0.0
        else:
            cost = _rollout(tree, local, p, w, guide, node, rng)
        i = node
        while i != NONE:
            tree.total[i] += cost
            tree.visits[i] += 1
            i = tree.parent[i]


@kernel
def bound(tree: PaperTree, w: Weights, node: int, i: int) -> float:
    """UCB of the child `i` of a node, which has visits: -C/n + const sqrt(2 ln N / n)."""
    visits = tree.visits[0] if w.by_root else tree.visits[node]
    return -tree.total[i] / tree.visits[i] + w.exploration * math.sqrt(
        2.0 * math.log(max(visits, 1)) / tree.visits[i]
    )


@kernel
def _is_dead_end(tree: PaperTree, node: int) -> bool:
    """Whether a node has been expanded and all that could follow was discarded."""
    if tree.child[node, 0] == NONE or tree.end[node] != ALIVE:
        return False
    for k in range(tree.child.shape[1]):
        i = tree.child[node, k]
        if i >= 0 and tree.end[i] != LOST:
            return False
    return True


@kernel
def _select(tree: PaperTree, w: Weights, rng: Generator) -> int:
    """Down to a node without children by the paper's UCB; collided children are not there, and one
    of the unvisited is drawn."""
    node = 0
    while tree.child[node, 0] != NONE:
        chosen, top, unvisited, drawn = NONE, -math.inf, 0, NONE
        for k in range(tree.child.shape[1]):
            i = tree.child[node, k]
            if i < 0 or tree.end[i] == LOST:
                continue
            if tree.visits[i] == 0:
                unvisited += 1
                if rng.random() * unvisited < 1.0:
                    drawn = i
                continue
            score = bound(tree, w, node, i)
            if score > top:
                chosen, top = i, score
        if drawn != NONE:
            return drawn
        if chosen == NONE:
            return node
        node = chosen
    return node


@making_arrays
def expand(
    tree: PaperTree,
    local: LocalMap,
    p: EgoParams,
    w: Weights,
    actions: Floats,
    guide: Guide,
    node: int,
) -> bool:
    """All children of a node; those that collide are marked and never visited. Returns whether one
    does."""
    collided = False
    begin = kept_state(tree.where, tree.motion, node)
    for k in range(len(actions)):
        side = int(actions[k, SIDE])
        tree.child[node, k] = IMPOSSIBLE
        if (
            (side != 0 and (begin.progress > 0.0 or not can_change(local, p, begin, side)))
            or tree.used[0] >= len(tree.parent)
            or tree.end[node] != ALIVE
        ):
            continue
        state = begin_change(local, p, begin, side) if side != 0 else begin
        state, cost, end = one_ply(
            local, p, w, state, actions[k, ACCEL], guide, tree.level[node] * w.ply
        )
        if side != 0:
            cost[OTHER] += lane_change(local, w, begin, tree.level[node] * w.ply * p.step)
            if end == ALIVE and not _can_finish(local, p, w, state, tree.level[node] + 1):
                end = LOST
        collided = collided or end == LOST
        i = tree.used[0]
        tree.used[0] += 1
        tree.child[node, k], tree.parent[i] = i, node
        tree.level[i], tree.end[i] = tree.level[node] + 1, end
        tree.cost[i] = cost if w.last_alone else tree.cost[node] + cost
        keep_state(tree.where, tree.motion, i, state)
    return collided


@kernel
def _can_finish(local: LocalMap, p: EgoParams, w: Weights, state: State, level: int) -> bool:
    """Whether a lane change that began in the ply before can go on at this speed without contact;
    it may take longer than T_1, the paper's length of a ply (paper.step_s)."""
    for k in range(level * w.ply, (w.look_ahead + w.rollout) * w.ply):
        if state.progress <= 0.0:
            return True
        state, event = advance(local, p, state, 0.0, k * p.step)
        if event != FREE or (
            (k + 1) % w.check == 0
            and nearest(local, p, state, (k + 1) * p.step, w.aligned)[0] <= 0.0
        ):
            return event == GOAL
    return True


@making_arrays
def _rollout(
    tree: PaperTree,
    local: LocalMap,
    p: EgoParams,
    w: Weights,
    guide: Guide,
    node: int,
    rng: Generator,
) -> float:
    """Algorithm 2: random longitudinal actions to the terminal state; the cost J of the whole
    sequence."""
    state, total = kept_state(tree.where, tree.motion, node), tree.cost[node].sum()
    if tree.end[node] == ARRIVED:
        return total
    for level in range(tree.level[node], w.look_ahead + w.rollout):
        draw = rng.random()
        accel = 0.0
        if draw < w.brake_probability:
            accel = -(LEAST + BRAKE_RANGE * rng.random())
        elif draw < w.brake_probability + w.accelerate_probability:
            accel = LEAST + ACCEL_RANGE * rng.random()
        state, cost, end = one_ply(local, p, w, state, accel, guide, level * w.ply)
        total = cost.sum() if w.last_alone else total + cost.sum()
        if end == LOST:
            return total + w.safety * w.contact
        if end == ARRIVED:
            return total
    return total


@making_arrays
def one_ply(
    local: LocalMap, p: EgoParams, w: Weights, state: State, accel: float, guide: Guide, at: int
) -> tuple[State, Floats, int]:
    """One ply of T_1, from simulation step `at` on: the state after it, its four weighted costs,
    and how it ended.

    Costs are counted at its end, as the sum of equation 1 is.
    """
    began, end = state, ALIVE
    cost = np.zeros(4)
    for k in range(w.ply):
        state, event = advance(local, p, state, accel, (at + k) * p.step)
        if event in (RED_LINE, OFF_END):
            return state, cost, LOST
        if event == GOAL:
            end = ARRIVED
            break
        if (at + k + 1) % w.check == 0:
            distance, _ = nearest(local, p, state, (at + k + 1) * p.step, w.aligned)
            if distance <= 0.0:
                return state, cost, LOST
    # Beyond the end of the route neither traffic nor distance is left; how the ego drove there
    # counts.
    if end == ALIVE:
        cost[SAFETY] = safety(local, p, w, state, (at + w.ply) * p.step)
        cost[PASSABILITY] = passability(local, p, w, guide, state)
    cost[COMFORT] = comfort(local, p, w, began, state)
    cost[OTHER] = other(local, p, w, guide, state, accel)
    return state, cost, end
