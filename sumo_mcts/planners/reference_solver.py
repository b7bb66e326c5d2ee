"""The solution of the reference problem: label by label, ply by ply, whatever the ego can do.

docs/planner.md says how.
"""

import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices
from sumo_mcts.model.cost import terminal
from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.model.cost_to_go import PICK_UP
from sumo_mcts.model.interaction import Neighbours, meet
from sumo_mcts.model.local_map import (
    MOTION_TURN,
    WHERE_NODE,
    WHERE_OTHER,
    LocalMap,
    State,
    kept_state,
)
from sumo_mcts.model.motion import EgoParams, begin_change, can_change
from sumo_mcts.model.route import LIMIT
from sumo_mcts.numerics.kernel import kernel, lengthy
from sumo_mcts.planners.actions import (
    ACCEL,
    FOLLOW,
    NO_SPEED,
    SIDE,
    Action,
    action_at,
    copy_line,
    no_actions,
    put_action,
)
from sumo_mcts.planners.ply import (
    ALIVE,
    LOST,
    Ply,
    SearchParams,
    change_price,
    copy_pairs,
    for_steps,
    may_change,
    simulate,
)
from sumo_mcts.planners.reference import CELL, KIND, LABELS, Problem
from sumo_mcts.planners.reference_labels import Labels, copy_label, merge, rank, write_label
from sumo_mcts.planners.tree import GAP, LEADER_V

FREE, LOSING = range(2)  # columns of the lowest costs: of sequences without a loss, and with one


class Solution(NamedTuple):
    """C beginnings, each with its best continuation."""

    # [C] cost of the whole sequence; of sequences without a loss as far as there are any
    value: Floats
    collides: Bools  # [C] no sequence without a loss was found
    # [C, P, 3] its actions; that of the first ply, which is the beginning itself, is nan, and so
    # are those after its end
    best: Floats
    driven: int  # actions simulated


def solve(
    problem: Problem, lines: Floats, labels: int = LABELS, cell: tuple[float, ...] = CELL
) -> Solution:
    """The best continuation of each beginning in `lines` [C, K, 3], with at most so many labels for
    each and ply."""
    count, plies, rows = len(lines), len(problem.ends), labels * len(problem.actions) + 1
    work = Work(
        local=problem.local,
        ego=problem.task.ego,
        cost=problem.task.cost,
        q=problem.q,
        ends=problem.ends,
        actions=problem.actions,
        rest=_rest(problem),
        cell=np.array(cell),
        kind=np.array(KIND),
        table=np.zeros(1 << (2 * rows).bit_length(), np.int64),
        moving=problem.others.copy(),
        none=np.zeros((0, 2)),
        driven=np.zeros(1, np.int64),
    )
    starts, now, then = (_new_labels(size, plies, problem.others) for size in (count, labels, rows))
    cost, best = np.full((count, 2), np.inf), no_actions(count, plies)
    _solve(work, problem.state, problem.others, lines, starts, now, then, cost, best)
    collides = np.isinf(cost[:, FREE])
    value = np.where(collides, cost[:, LOSING], cost[:, FREE])
    return Solution(value, collides, best, int(work.driven[0]))


def best_root(solution: Solution, count: int | None = None) -> int:
    """The beginning, of the first `count`, that is free of losses if any is, and of these the
    cheapest."""
    return int(np.lexsort((solution.value[:count], solution.collides[:count]))[0])


class Rest(NamedTuple):
    """The inputs of the bound: no sequence is faster than this."""

    # the lowest speed limit ahead, m/s; inf: the route may end before the horizon, and the costs
    # with it
    limit: float
    accel: float  # m/s2


class Work(NamedTuple):
    """What the compiled solution reads, and its scratch."""

    local: LocalMap
    ego: EgoParams
    cost: CostParams
    q: SearchParams
    ends: Indices
    actions: Floats
    rest: Rest
    cell: Floats  # CELL
    kind: Floats  # KIND
    table: Indices  # label + 1 by the hash of its key, 0 free
    moving: Floats  # [R, 2] the agents that react, during an action
    none: Floats  # [0, 2] no agents: whether a lane change is possible depends on the forecast
    driven: Indices  # [1] actions simulated


def _new_labels(size: int, plies: int, others: Floats) -> Labels:
    return Labels(
        where=np.zeros((size, 2), np.int64),
        motion=np.zeros((size, 5)),
        followers=np.zeros(size, np.int64),
        leader=np.zeros((size, 2)),
        others=np.zeros((size, *others.shape)),
        cost=np.zeros(size),
        bound=np.zeros(size),
        key=np.zeros(size, np.int64),
        rank=np.zeros(size, np.int64),
        line=np.zeros((size, plies, 3)),
    )


def _rest(problem: Problem) -> Rest:
    """The lowest limit that the ego could come to, and its strongest acceleration."""
    local, state, p, route = problem.local, problem.state, problem.task.ego, problem.task.route
    accel = max(p.max_accel, state.a)
    reach = (state.v + accel * problem.q.horizon) * problem.q.horizon
    window = np.arange(local.first, local.first + len(local.urgency))
    ahead = window[route.leg[window] >= route.leg[state.node]]
    ends = (
        (route.next[ahead] < 0)
        & np.isinf(route.reach[ahead])
        & (route.station[ahead] + route.length[ahead] < route.station[state.node] + state.s + reach)
    )
    return Rest(math.inf if ends.any() else float(local.node[ahead, LIMIT].min()), accel)


# --- compiled ---


@lengthy
def _solve(
    work: Work, root: State, at_root: Floats, lines: Floats, starts: Labels, now: Labels,
    then: Labels, cost: Floats, best: Floats,
) -> None:  # fmt: skip
    """Fill `cost` [C, 2] and `best` [C, P, 3]: for each line the lowest cost of a sequence that
    begins with it, FREE of a loss and LOSING, and the best of these sequences."""
    free, same = np.full((len(work.ends), 3), NO_SPEED), np.arange(len(lines))
    free[:, ACCEL], free[:, SIDE] = FOLLOW, 0.0
    for i in range(len(lines)):
        end = _begin(work, root, at_root, lines[i], starts, i)
        same[i] = _same(starts, i)
        if end != ALIVE:
            cost[i, LOSING if end == LOST else FREE], same[i] = starts.cost[i], -1
        if same[i] < i:  # it is over, or the road and the bounds left no choice
            continue
        _drive_on(work, starts, i, 0, free, cost[i], best[i])
        for j in range(i):
            _drive_on(work, starts, i, 0, best[j], cost[i], best[i])
        copy_label(starts, i, now, 0)
        used = 1
        for ply in range(1, len(work.ends)):
            found = _spread(work, now, used, then, ply, cost[i], best[i])
            # a stable order is the same without compilation
            order = np.argsort(then.bound[:found], kind="mergesort")
            if found > len(now.cost):
                rank(work.table, work.kind, then, order)
                order = order[np.argsort(then.rank[order], kind="mergesort")]
            used = 0
            for k in order[: len(now.cost)]:
                if then.bound[k] < cost[i, FREE]:
                    copy_label(then, k, now, used)
                    used += 1
            if used == 0:
                break
            _drive_on(work, now, 0, ply, free, cost[i], best[i])
    for i in range(len(lines)):  # what was found for one beginning may be good for another
        for j in range(len(lines)):
            if same[i] == i and j != i and same[j] == j:
                _drive_on(work, starts, i, 0, best[j], cost[i], best[i])
    for i in range(len(lines)):
        if 0 <= same[i] < i:
            cost[i], best[i] = cost[same[i]], best[same[i]]


@kernel
def _begin(work: Work, root: State, at_root: Floats, line: Floats, labels: Labels, k: int) -> int:
    """Drive the first ply, written step by step in `line` [K, 3], into label k: how it ends."""
    local, p, c = work.local, work.ego, work.cost
    state = root
    near = meet(local, p, c, root, at_root, local.followers, 0).near
    copy_pairs(at_root, work.moving)
    cost, end, side = 0.0, ALIVE, action_at(line, 0).side
    if side != 0 and can_change(local, p, state, side):
        cost += change_price(c, state)
        state = begin_change(local, p, state, side)
    for at in range(len(line)):
        ply = _simulate(work, state, near, action_at(line, at), at, at + 1)
        cost += ply.safety + ply.comfort + ply.passability + ply.loss
        state, near, end = ply.state, ply.near, ply.end
        if end != ALIVE:
            break
    labels.line[k], labels.bound[k] = np.nan, cost
    write_label(labels, k, state, near, work.moving, cost)
    return end


@kernel
def _same(starts: Labels, i: int) -> int:
    """The first beginning that comes to the same as the i-th; i: none before it."""
    for j in range(i):
        apart = abs(starts.cost[i] - starts.cost[j])
        for n in range(MOTION_TURN):
            apart = max(apart, abs(starts.motion[i, n] - starts.motion[j, n]))
        if (
            apart < 1e-6
            and starts.where[i, WHERE_NODE] == starts.where[j, WHERE_NODE]
            and starts.where[i, WHERE_OTHER] == starts.where[j, WHERE_OTHER]
        ):
            return j
    return i


@kernel
def _spread(
    work: Work, now: Labels, used: int, then: Labels, ply: int, least: Floats, best: Floats
) -> int:
    """Every action from each of the `used` labels `now`, to the end of the ply.

    What goes on is left in `then`: returns how many labels. What is over, or comes to the horizon,
    goes into `least` [2] (FREE, LOSING) and `best` [P, 3].
    """
    local, p, c, at, end = (
        work.local,
        work.ego,
        work.cost,
        int(work.ends[ply - 1]),
        int(work.ends[ply]),
    )
    work.table[:] = 0
    found, left = 0, int(work.ends[-1]) - end
    for k in range(used):
        if now.bound[k] >= least[FREE]:
            continue
        for n in range(len(work.actions)):
            state, cost = kept_state(now.where, now.motion, k), now.cost[k]
            action = Action(work.actions[n, ACCEL], int(work.actions[n, SIDE]), NO_SPEED)
            if action.side != 0:
                if not may_change(
                    local, p, c, state, work.none, action.side, action.accel, at * p.step
                ):
                    continue
                cost += change_price(c, state)
                state = begin_change(local, p, state, action.side)
            copy_pairs(now.others[k], work.moving)
            copy_line(now.line[k], then.line[found])
            put_action(then.line[found], ply, action.accel, action.side)
            near = Neighbours(now.leader[k, GAP], now.leader[k, LEADER_V], now.followers[k])
            step = _simulate(work, state, near, action, at, end)
            cost += step.safety + step.comfort + step.passability + step.loss
            if step.end == ALIVE and left > 0:
                then.bound[found] = cost + _at_least(
                    local, c, work.rest, step.state.v, left, p.step
                )
                if then.bound[found] < least[FREE]:
                    write_label(then, found, step.state, step.near, work.moving, cost)
                    found = merge(work.table, work.cell, then, found)
            else:
                if step.end == ALIVE:
                    cost += terminal(
                        local, c, step.state, step.near.gap, step.near.leader_v, work.q.horizon
                    )
                _note(least, best, step.end, cost, then.line[found])
    return found


@kernel
def _drive_on(
    work: Work, labels: Labels, i: int, ply: int, tail: Floats, least: Floats, best: Floats
) -> None:
    """Drive on from label i, at the end of `ply`, to the horizon.

    The actions are those of `tail` [P, 3], and car following where a row is nan. The cost of this
    sequence is a bound for all others.
    """
    local, p, c = work.local, work.ego, work.cost
    state, cost = kept_state(labels.where, labels.motion, i), labels.cost[i]
    near = Neighbours(labels.leader[i, GAP], labels.leader[i, LEADER_V], labels.followers[i])
    copy_pairs(labels.others[i], work.moving)
    line, end = labels.line[i], ALIVE
    for k in range(ply + 1, len(work.ends)):
        at = int(work.ends[k - 1])
        action = Action(FOLLOW, 0, NO_SPEED) if np.isnan(tail[k, ACCEL]) else action_at(tail, k)
        side = action.side
        if side != 0 and may_change(local, p, c, state, work.none, side, action.accel, at * p.step):
            cost += change_price(c, state)
            state = begin_change(local, p, state, side)
        else:
            side = 0
        put_action(line, k, action.accel, side)
        step = _simulate(work, state, near, action, at, int(work.ends[k]))
        cost += step.safety + step.comfort + step.passability + step.loss
        state, near, end = step.state, step.near, step.end
        if end != ALIVE:
            break
    if end == ALIVE:
        cost += terminal(local, c, state, near.gap, near.leader_v, work.q.horizon)
    _note(least, best, end, cost, line)
    line[ply + 1 :] = np.nan


@kernel
def _simulate(
    work: Work, state: State, near: Neighbours, action: Action, begin: int, end: int
) -> Ply:
    """One action from step `begin` to step `end`."""
    work.driven[0] += 1
    q = for_steps(work.q, end - begin)
    return simulate(work.local, work.ego, work.cost, q, state, work.moving, near, action, begin)


@kernel
def _note(least: Floats, best: Floats, end: int, cost: float, line: Floats) -> None:
    """Keep a finished sequence if it is the best of its kind. One with a loss is shown only as long
    as there is none without."""
    kind = LOSING if end == LOST else FREE
    if cost < least[kind]:
        least[kind] = cost
        if kind == FREE or least[FREE] == math.inf:
            copy_line(line, best)


@kernel
def _at_least(
    local: LocalMap, c: CostParams, rest: Rest, v: float, steps: int, step: float
) -> float:
    """A lower bound of the cost of `steps` steps (of `step` s) and of the end, from speed v on: the
    progress lost although the ego accelerates as hard as it can."""
    if rest.limit == math.inf:
        return 0.0
    gain = rest.accel * step
    # steps until the limit is reached
    n = min(float(steps), max(0.0, math.floor((rest.limit - v) / gain)))
    lost = step * (n * (1.0 - v / rest.limit) - gain * n * (n + 1.0) / (2.0 * rest.limit))
    missing = max(0.0, local.limit - v - gain * steps) if local.open_ahead else 0.0
    return c.progress * (lost + missing * missing / (2.0 * PICK_UP * local.limit))
