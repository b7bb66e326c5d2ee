"""The optimum of the paper's own J over its own tree: what its search would find without limits.

The tree is grown whole, which is no more than 157 nodes with the default keys. A node on the last
level is worth the expectation of J over its rollout; a node above it, what its best child is worth.
"""

from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats
from sumo_mcts.config import ScenarioConfig
from sumo_mcts.model.local_map import LocalMap, State, keep_state, kept_state
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.numerics.kernel import making_arrays
from sumo_mcts.planners import paper
from sumo_mcts.planners.base import Situation, Task, local_of
from sumo_mcts.planners.paper_cost import Guide, Weights
from sumo_mcts.planners.paper_search import (
    ACCEL_RANGE,
    BRAKE_RANGE,
    LEAST,
    PaperTree,
    expand,
    new_tree,
    one_ply,
)
from sumo_mcts.planners.ply import ARRIVED, LOST
from sumo_mcts.scene import Decision

PIECES = 4  # of the range from which braking, or accelerating, is drawn: each has its middle
BRAKING = 4.0  # m/s2, for T_1: its cost is the scale


class Own(NamedTuple):
    """What each action of the root is worth by J. A actions."""

    value: Floats  # [A] expected J of the best sequence that begins with it; inf: none is left
    scale: float  # what braking with 4 m/s2 for T_1 costs


def optimum(scenario: ScenarioConfig, task: Task, situation: Situation) -> Own:
    """The worth of each action, in the order of PaperPlanner."""
    p, state = scenario.paper, situation.state
    weights = paper.weights_of(scenario, task.ego.step)
    actions = paper.actions_of(scenario)
    tree = new_tree(paper.full_size(len(actions), p.look_ahead_steps), len(actions))
    guide = paper.guide_of(task, state, p.goal_distance_m, p.lane_distance_m)
    accel, share = draws(p.brake_probability, p.accelerate_probability)
    local = local_of(task, situation)
    value = _solve(tree, local, task.ego, weights, actions, guide, state, accel, share)
    seconds = weights.ply * task.ego.step
    hard = weights.emergency if task.ego.comfort_decel < BRAKING else 0.0
    return Own(
        value,
        weights.comfort * weights.jerk_factor * (BRAKING / seconds) ** 2
        + weights.passability * weights.goal_factor * 0.5 * BRAKING * seconds**2
        + weights.other * hard,
    )


def draws(brake: float, accelerate: float) -> tuple[Floats, Floats]:
    """Accelerations, m/s2, that stand for what a rollout draws, and the probability of each."""
    middle = (np.arange(PIECES) + 0.5) / PIECES
    accel = np.concatenate([-(LEAST + BRAKE_RANGE * middle), [0.0], LEAST + ACCEL_RANGE * middle])
    accelerate = min(accelerate, 1.0 - brake)
    each = np.repeat([brake / PIECES, accelerate / PIECES], PIECES)
    share = np.concatenate([each[:PIECES], [1.0 - brake - accelerate], each[PIECES:]])
    return accel[share > 0.0], share[share > 0.0]


def taken(scenario: ScenarioConfig, decision: Decision) -> int:
    """The number of the action of a decision; -1 where every one was discarded."""
    if decision.chosen < 0:
        return -1
    child = decision.children[decision.chosen]
    actions = paper.actions_of(scenario)
    return int(np.flatnonzero(np.all(actions == (child.accel, child.lane_change), axis=1))[0])


@making_arrays
def _solve(
    tree: PaperTree, local: LocalMap, p: EgoParams, w: Weights, actions: Floats, guide: Guide,
    root: State, accel: Floats, share: Floats,
) -> Floats:  # fmt: skip
    """Grow the whole tree, and back up the least worth from its last level."""
    keep_state(tree.where, tree.motion, 0, root)
    tree.used[0] = 1
    node = 0
    while node < tree.used[0]:
        if tree.level[node] < w.look_ahead and tree.end[node] != LOST:
            expand(tree, local, p, w, actions, guide, node)
        node += 1
    worth = np.full(tree.used[0], np.inf)
    for node in range(tree.used[0] - 1, 0, -1):
        if tree.end[node] == LOST:
            continue
        if worth[node] == np.inf:  # the last level, or nothing is left to follow
            worth[node] = _expected(tree, local, p, w, guide, node, accel, share)
        worth[tree.parent[node]] = min(worth[tree.parent[node]], worth[node])
    found = np.full(len(actions), np.inf)
    for k in range(len(actions)):
        if tree.child[0, k] >= 0:
            found[k] = worth[tree.child[0, k]]
    return found


@making_arrays
def _expected(
    tree: PaperTree, local: LocalMap, p: EgoParams, w: Weights, guide: Guide, node: int,
    accel: Floats, share: Floats,
) -> float:  # fmt: skip
    """J of the rollout from a node, the mean over all that it may draw."""
    steps = w.look_ahead + w.rollout - tree.level[node]
    if tree.end[node] == ARRIVED:
        steps = 0
    mean = 0.0
    for number in range(len(accel) ** steps):
        state, total = kept_state(tree.where, tree.motion, node), tree.cost[node].sum()
        probability, rest, over = 1.0, number, False
        for k in range(steps):
            draw, rest = rest % len(accel), rest // len(accel)
            probability *= share[draw]
            if over:
                continue
            at = (tree.level[node] + k) * w.ply
            state, cost, end = one_ply(local, p, w, state, accel[draw], guide, at)
            total = cost.sum() if w.last_alone else total + cost.sum()
            if end == LOST:
                total += w.safety * w.contact
            over = end in (LOST, ARRIVED)
        mean += probability * total
    return mean
