"""The sequences that a decision is chosen from: one for each root child of a tree, and the warm
start from the last plan. Each is driven again step by step."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats, Indices
from sumo_mcts.model.local_map import MOTION_V, LocalMap, State
from sumo_mcts.model.route import LEFT_NODE, RIGHT_NODE
from sumo_mcts.planners.actions import ACCEL, FOLLOW, SIDE, Lines, lines_of
from sumo_mcts.planners.base import Task
from sumo_mcts.planners.ply import (
    ALIVE,
    ARRIVED,
    DRIVEN_S,
    DRIVEN_V,
    IMPOSSIBLE,
    LOST,
    Driven,
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
    those = np.flatnonzero(tree.child[0] >= 0)
    lines = _best_lines(start, tree, actions, those)
    driven = drive(start, lines)
    result = []
    for m, (k, i) in enumerate(zip(those.tolist(), tree.child[0, those].tolist(), strict=True)):
        plan = _plan(start.task, driven, m)
        accel = float(actions[k, ACCEL])
        child = RootChild(
            accel=_first_accel(start, plan) if accel == FOLLOW else accel,
            lane_change=int(actions[k, SIDE]),
            visits=int(tree.visits[i]),
            mean=float(tree.total[i] / max(tree.visits[i], 1)),
            best=float(tree.best[i]),
            terms=driven.terms[m],
            poses=plan.pose,
        )
        result.append(Candidate(child, plan, lines.actions[m, : lines.steps[m]]))
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


def costs_in(
    start: Start, tree: Tree, actions: Floats, found: Sequence[Candidate], lines: Lines
) -> tuple[Floats, Floats]:
    """[C] what candidates, with the sequences `lines`, cost in another hypothesis, that of `start`
    and `tree`, and their terms [C, 5].

    This is the lower of two costs: the candidate driven to its end, or only begun. In the latter
    case the best sequence of the tree follows, below the root's child that is nearest to the
    candidate's first action. This takes the hypothesis to be known by then (QMDP).
    """
    driven = drive(start, lines)
    ends = (driven.end == LOST) | (driven.end == ARRIVED)
    lasts = lines.steps >= round(start.q.horizon / start.task.ego.step)
    whole, terms = driven.terms.sum(axis=1), driven.terms
    action = _nearest_actions(start, tree, actions, found)
    begun = np.where(action >= 0, tree.best[tree.child[0, action]], start.task.cost.contact)
    driven_on = (ends | ((driven.end == ALIVE) & lasts)) & (whole <= begun)
    terms[~driven_on] = 0.0
    terms[~driven_on & (action < 0), LOSS] = start.task.cost.contact
    those = np.flatnonzero(~driven_on & (action >= 0))
    if len(those):
        again, which = np.unique(action[those], return_inverse=True)
        terms[those] = drive(start, _best_lines(start, tree, actions, again)).terms[which]
    return np.where(driven_on, whole, begun), terms


def _nearest_actions(
    start: Start, tree: Tree, actions: Floats, found: Sequence[Candidate]
) -> Indices:
    """[C] the tried action with the lane change of each candidate whose speed is nearest to the
    candidate's after the first action, the cheapest of equal ones; -1: there is none."""
    child, ply = tree.child[0], start.q.ply
    v = np.array([each.plan.v[min(ply, len(each.plan.v)) - 1] for each in found])
    side = np.array([each.child.lane_change for each in found])
    alike = (child >= 0) & (actions[:, SIDE] == side[:, None])
    apart = np.where(alike, np.abs(tree.motion[child, MOTION_V] - v[:, None]), np.inf)
    nearest = np.lexsort((np.broadcast_to(tree.best[child], apart.shape), apart))[:, 0]
    return np.where(alike.any(axis=1), nearest, -1)


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
    ply.Driven).
    """
    driven = drive(Start(local, task, q, state, others), lines_of([line]))
    return _plan(task, driven, 0), driven.terms[0], int(driven.end[0])


def drive(start: Start, lines: Lines) -> Driven:
    """Drive sequences from the same start."""
    m, steps, _ = lines.actions.shape
    driven = Driven(
        node=np.zeros((m, steps), np.int64),
        motion=np.zeros((m, steps, 2)),
        pose=np.zeros((m, steps, 4)),
        terms=np.zeros((m, 5)),
        steps=np.zeros(m, np.int64),
        end=np.zeros(m, np.int64),
        moving=np.empty_like(start.others),
    )
    local, task, q, state, others = start
    replay(local, task.ego, task.cost, q, state, others, lines, driven)
    return driven


def _plan(task: Task, driven: Driven, m: int) -> Plan:
    """Sequence m as it was driven, step by step."""
    used = driven.steps[m]
    return Plan(
        time=(np.arange(used, dtype=np.float64) + 1.0) * task.ego.step,
        v=driven.motion[m, :used, DRIVEN_V].copy(),
        lane=task.route.lane[driven.node[m, :used]].astype(np.int32),
        s=driven.motion[m, :used, DRIVEN_S].copy(),
        pose=driven.pose[m, :used].copy(),
    )


def _first_accel(start: Start, plan: Plan) -> float:
    """Mean acceleration (m/s2) of a plan's first action: what car following came to."""
    seconds = start.q.ply * start.task.ego.step
    steps = min(len(plan.v), int(np.searchsorted(plan.time, seconds - 1e-9)) + 1)
    return float((plan.v[steps - 1] - start.state.v) / plan.time[steps - 1]) if steps else 0.0


def _best_lines(start: Start, tree: Tree, actions: Floats, those: Indices) -> Lines:
    """The best sequences of these root actions. Each certainly starts with its own action, and that
    is all where the action ends the drive."""
    plan, ply = tree.plan[those], start.q.ply
    plan[:, 0, : SIDE + 1] = actions[those, : SIDE + 1]
    missing = np.isnan(plan[:, :, ACCEL])
    levels = np.where(missing.any(axis=1), missing.argmax(axis=1), plan.shape[1])
    levels[tree.end[tree.child[0, those]] != ALIVE] = 1
    rows = np.repeat(plan, ply, axis=1)
    rows[:, np.arange(rows.shape[1]) % ply > 0, SIDE] = 0.0
    return Lines(rows, levels * ply)
