"""The sequences that a decision is chosen from: one for each root child of a tree, and the warm
start from the last plan. Each is driven again step by step."""

from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats
from sumo_mcts.model.local_map import MOTION_V, LocalMap, State
from sumo_mcts.model.route import LEFT_NODE, RIGHT_NODE
from sumo_mcts.planners.actions import ACCEL, FOLLOW, SIDE, to_steps
from sumo_mcts.planners.base import Task
from sumo_mcts.planners.ply import (
    ALIVE,
    ARRIVED,
    DRIVEN_S,
    DRIVEN_V,
    IMPOSSIBLE,
    LOST,
    SearchParams,
    replay,
)
from sumo_mcts.planners.tree import Tree
from sumo_mcts.scene import LOSS, PASSABILITY, Plan, RootChild

# s within which a planned change needs no help: a car that was asked would wait for an ego that
# waits for it to pass
SOON = 4.0
ROUNDING = 1e-6  # m/s2


class Candidate(NamedTuple):
    """A root child and the best sequence that is known to begin with it."""

    child: RootChild
    plan: Plan
    line: Floats  # [steps, 3] see actions.py


class Start(NamedTuple):
    """What every sequence of one decision starts from, in one hypothesis."""

    local: LocalMap
    task: Task
    q: SearchParams
    state: State
    others: Floats  # [R, 2] the agents that the search moves, as they are now


def root_candidates(start: Start, tree: Tree, actions: Floats) -> list[Candidate]:
    """The root's children, each with the best sequence through it; `actions` [A, 3]."""
    result = []
    for k in range(len(actions)):
        i = int(tree.child[0, k])
        if i < 0:
            continue
        line = _best_line(start, tree, actions, k)
        plan, terms, _ = follow_line(
            start.local, start.task, start.q, start.state, start.others, line
        )
        accel = float(actions[k, ACCEL])
        child = RootChild(
            accel=_first_accel(start, plan) if accel == FOLLOW else accel,
            lane_change=int(actions[k, SIDE]),
            visits=int(tree.visits[i]),
            mean=float(tree.total[i] / max(tree.visits[i], 1)),
            best=float(tree.best[i]),
            terms=terms,
            poses=plan.pose,
        )
        result.append(Candidate(child, plan, line))
    return result


def warm_start(start: Start, line: Floats, period_s: float) -> Candidate | None:
    """What is left of the last plan, `line` [steps, 3], if it is possible without a contact.

    It begins in the middle of an action, so the tree cannot hold it. A lane change begins with a
    decision period or not at all.
    """
    later = line[1 : round(period_s / start.task.ego.step)]
    if not len(line) or (later[:, SIDE] != 0.0).any():
        return None
    plan, terms, end = follow_line(
        start.local, start.task, start.q, start.state, start.others, line
    )
    if end not in (ALIVE, ARRIVED):
        return None
    cost, side = float(terms.sum()), int(line[0, SIDE])
    child = RootChild(_first_accel(start, plan), side, 0, cost, cost, terms, plan.pose)
    return Candidate(child, plan, line)


def cost_in(
    start: Start, tree: Tree, actions: Floats, candidate: Candidate
) -> tuple[float, Floats]:
    """What a candidate costs in another hypothesis, that of `start` and `tree`, and its terms [5].

    This is the lower of two costs: the candidate driven to its end, or only begun. In the latter
    case the best sequence of the tree follows, below the root's child that is nearest to the
    candidate's first action. This takes the hypothesis to be known by then (QMDP).
    """
    v = float(candidate.plan.v[min(start.q.ply, len(candidate.plan.v)) - 1])
    alike = [
        (k, i)
        for k, i in enumerate(tree.child[0])
        if i >= 0 and int(actions[k, SIDE]) == candidate.child.lane_change
    ]
    _, begun, k = min(
        ((abs(tree.motion[i, MOTION_V] - v), float(tree.best[i]), k) for k, i in alike),
        default=(0.0, start.task.cost.contact, -1),
    )
    local, task, q, state, others = start
    _, terms, end = follow_line(local, task, q, state, others, candidate.line)
    whole = end in (LOST, ARRIVED) or (
        end == ALIVE and len(candidate.line) >= round(q.horizon / task.ego.step)
    )
    if whole and terms.sum() <= begun:
        return float(terms.sum()), terms
    if k < 0:
        lost = np.zeros(5)
        lost[LOSS] = begun
        return begun, lost
    line = _best_line(start, tree, actions, k)
    return begun, follow_line(local, task, q, state, others, line)[1]


def asked_side(start: Start, line: Floats) -> int:
    """The side on which others are asked for room (1 left, -1 right, 0 none) while `line`
    [steps, 3] is driven: that of the lane change that the route needs soon, where it is not
    possible now and the line does not make it within SOON."""
    local, state = start.local, start.state
    i = state.node - local.first
    urgency = local.urgency[i] if 0 <= i < len(local.urgency) else 0.0
    side = int(np.sign(urgency))
    column = LEFT_NODE if side > 0 else RIGHT_NODE
    if side == 0 or state.progress > 0.0 or local.node[state.node, column] < 0.0:
        return 0
    soon = (line[: round(SOON / start.task.ego.step), SIDE] == side).any()
    if soon and local.asked != side:  # else it may count on those that were asked
        return 0
    now = line[:1].copy()
    now[0, SIDE] = side
    *_, end = follow_line(local, start.task, start.q, state, start.others, now)
    return side if end == IMPOSSIBLE else 0


def not_for_a_stop(start: Start, found: list[Candidate], chosen: int, most: float) -> int:
    """`chosen`, or in its place the best candidate that does not, where it brakes with more than
    `most` (m/s2) in the coming period for nothing but passability: for a gap beside, perhaps.

    Only where a stop lies ahead: in its lane the ego can get later, or do without it.
    """
    if not start.task.route.halt.ends or _hardest(start, found[chosen]) <= most:
        return chosen
    gentle = [
        i
        for i, each in enumerate(found)
        if _hardest(start, each) <= most and _others(each) <= _others(found[chosen])
    ]
    return min(gentle, key=lambda i: found[i].child.best, default=chosen)


def _hardest(start: Start, candidate: Candidate) -> float:
    """The strongest braking in the first action of a candidate, m/s2."""
    v = np.concatenate([[start.state.v], candidate.plan.v[: start.q.ply]])
    return float(-np.diff(v).min(initial=0.0)) / start.task.ego.step - ROUNDING


def _others(candidate: Candidate) -> float:
    """What a candidate costs, but for passability."""
    return candidate.child.best - float(candidate.child.terms[PASSABILITY])


def follow_line(
    local: LocalMap, task: Task, q: SearchParams, state: State, others: Floats, line: Floats
) -> tuple[Plan, Floats, int]:
    """Drive a sequence `line` [steps, 3], from `state` and the reacting agents `others` [R, 2].

    Returns the plan, step by step, the cost terms [5] SAFETY .. LOSS, and how it ends (see
    ply.replay).
    """
    steps = len(line)
    nodes, motion, pose = np.zeros(steps, np.int64), np.zeros((steps, 2)), np.zeros((steps, 4))
    terms = np.zeros(5)
    used, end = replay(
        local, task.ego, task.cost, q, state, others.copy(), line, nodes, motion, pose, terms
    )
    plan = Plan(
        time=(np.arange(used, dtype=np.float64) + 1.0) * task.ego.step,
        v=motion[:used, DRIVEN_V].copy(),
        lane=task.route.lane[nodes[:used]].astype(np.int32),
        s=motion[:used, DRIVEN_S].copy(),
        pose=pose[:used].copy(),
    )
    return plan, terms, end


def _first_accel(start: Start, plan: Plan) -> float:
    """Mean acceleration (m/s2) of a plan's first action: what car following came to."""
    seconds = start.q.ply * start.task.ego.step
    steps = min(len(plan.v), int(np.searchsorted(plan.time, seconds - 1e-9)) + 1)
    return float((plan.v[steps - 1] - start.state.v) / plan.time[steps - 1]) if steps else 0.0


def _best_line(start: Start, tree: Tree, actions: Floats, k: int) -> Floats:
    """[steps, 3] the best sequence of root action k; it certainly starts with its own action, and
    that is all where the action ends the drive."""
    line = tree.plan[k].copy()
    line[0, : SIDE + 1] = actions[k, : SIDE + 1]
    missing = np.isnan(line[:, ACCEL])
    levels = int(np.argmax(missing)) if missing.any() else len(line)
    if tree.end[tree.child[0, k]] != ALIVE:
        levels = 1
    return to_steps(line[:levels], start.q.ply)
