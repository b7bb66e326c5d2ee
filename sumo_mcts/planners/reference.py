"""The reference problem that near-optimality is measured against (docs/measures.md), and its
solution: ply by ply, whatever the ego can do.

The numbers in this file are frozen: they say what is compared, not what is best, and follow no
configuration. Whoever changes one of them makes regrets of before and after incomparable; `digest`
tells.
"""

import hashlib
import json
import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.model.cost import PICK_UP, step_comfort, terminal
from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.model.interaction import meet
from sumo_mcts.model.local_map import LocalMap, State, keep_state, kept_state
from sumo_mcts.model.motion import COMMANDED, FOLLOW, EgoParams, begin_change, can_change
from sumo_mcts.model.reactions import at_rest
from sumo_mcts.model.route import LIMIT
from sumo_mcts.numerics.kernel import kernel, lengthy
from sumo_mcts.planners.base import Situation, Task, local_of
from sumo_mcts.planners.rollout import (
    ALIVE,
    LOST,
    Ply,
    SearchParams,
    copy_pairs,
    entry_of,
    may_change,
    search_params,
    side_of,
    simulate,
)
from sumo_mcts.scene import Bools, Floats, Follow, Indices

COST = CostParams(
    contact=60.0, speed_at_contact=1.0, headway_s=1.2, headway_gap=2.0, headway=1.5, claim_s=1.6,
    claim=16.0, acceleration=0.02, jerk=0.005,
    braking=0.5, progress=1.0, tail_s=8.0, blocking=0.3, astride=4.0, route=2.0, lane_change=0.6,
    red=100.0, cut_in_decel=3.0, imposed=2.0,
)  # fmt: skip
KEEPING = (FOLLOW, -8.0, -4.5, -3.0, -2.0, -1.0, 0.0, 1.0, 2.6)  # accelerations in the lane, m/s2
CHANGING = (-1.5, 0.0, 1.5)  # accelerations that begin a lane change to the left or right, m/s2
ENDS_S = (
    0.5,
    1.0,
    1.5,
    2.0,
    3.0,
    4.0,
    5.0,
    6.0,
    7.0,
    8.0,
)  # when one action ends and the next begins, s
CHECK_S = 0.2  # s between collision checks
REACTIVE = 8  # agents that react inside the search
SCALE_DECEL = 4.0  # m/s2: a second of it is the scale of regret

LABELS = 200  # that are kept for each beginning and ply
CELL = (
    0.25,
    0.25,
    0.5,
    0.05,
    0.5,
    0.5,
    # m, m/s, m/s2, progress; of agents that react: forecast times, m/s. Labels in a cell count as
    # one
)
KIND = (
    5.0,
    1.0,
)  # m, m/s: labels that are nearer together are of one kind, of which the best come first


class Labels(NamedTuple):
    """M states at the end of a ply, each with the cheapest way found to it.

    R agents that react, P plies.
    """

    where: Indices  # [M, 2] State.node and State.other
    motion: Floats  # [M, 5] State.s, v, a, progress, turn
    followers: Indices  # [M]
    leader: Floats  # [M, 2] gap (m) and speed of the leader
    others: Floats  # [M, R, 2] see model/react.py
    cost: Floats  # [M] so far
    bound: Floats  # [M] no continuation costs less in the end
    key: Indices  # [M] number of the cell, or of the kind
    rank: Indices  # [M] how many of its kind have a lower bound
    line: Floats  # [M, P] entries (see tree.entry_of) that led here


class Rest(NamedTuple):
    """What the bound has to know: no way is faster than this."""

    # the lowest speed limit ahead, m/s; inf: the route may end before the horizon, and the costs
    # with it
    limit: float
    accel: float  # m/s2


class Problem(NamedTuple):
    """The reference problem in one state. P plies, A actions, B of them can begin now."""

    task: Task  # with the frozen cost
    local: LocalMap
    state: State
    others: Floats  # [R, 2] the agents that react, as they are now
    q: SearchParams
    ends: Indices  # [P] steps of the simulation at which plies end
    actions: Floats  # [A, 2] acceleration, lane change
    roots: Floats  # [B, 2]


class Work(NamedTuple):
    """What the compiled solution reads, and its scratch."""

    local: LocalMap
    ego: EgoParams
    q: SearchParams
    ends: Indices
    actions: Floats
    rest: Rest
    cell: Floats  # CELL
    kind: Floats  # KIND
    table: Indices  # label + 1 by the hash of its key, 0 free
    moving: Floats  # [R, 2] the agents that react, during an action
    driven: Indices  # [1] actions simulated


class Solution(NamedTuple):
    """C beginnings, each with its best continuation."""

    value: Floats  # [C] cost of the whole way; of ways without a loss as far as there are any
    collides: Bools  # [C] no way without a loss was found
    # [C, P] its entries; that of the first ply, which is the beginning itself, is nan, and so are
    # those after its end
    way: Floats
    driven: int  # actions simulated


def digest() -> str:
    """SHA-256 of all numbers above: what regrets depend on beside the model."""
    cost = {
        name: value for name, value in COST._asdict().items() if value is not None
    }  # the reference has no term of anybody's own
    numbers = (cost, KEEPING, CHANGING, ENDS_S, CHECK_S, REACTIVE, SCALE_DECEL, LABELS, CELL, KIND)
    return hashlib.sha256(json.dumps(numbers).encode()).hexdigest()


def horizon_s(forecast_dt: float) -> float:
    """How far the reference looks into a forecast with states `forecast_dt` apart, s."""
    return ENDS_S[-1] + COST.claim_s + forecast_dt


def scale(ego: EgoParams) -> float:
    """What a second of braking with SCALE_DECEL costs: the unit of regret."""
    braking = State(0, 0.0, 10.0, -SCALE_DECEL, 0.0, -1, 0.0)
    return step_comfort(ego, COST, braking, braking) / ego.step


def problem_of(task: Task, situation: Situation) -> Problem:
    """The reference problem in a situation: how the ego can move is the task's own, all else is
    frozen."""
    ego, state = task.ego._replace(headway=COST.headway_s, gap=COST.headway_gap), situation.state
    task, local = task._replace(ego=ego, cost=COST), local_of(task, situation, REACTIVE)
    ends = np.unique([max(1, math.floor(end / ego.step + 0.5)) for end in ENDS_S])
    q = search_params(ego.step, local.dt, ENDS_S[0], CHECK_S, len(ends), 0, 0.0, False)._replace(
        horizon=float(ends[-1]) * ego.step
    )
    actions = np.array(
        [(accel, 0.0) for accel in KEEPING]
        + [(accel, side) for side in (1.0, -1.0) for accel in CHANGING]
    )
    possible = [
        side == 0.0 or may_change(local, ego, COST, state, int(side), accel, 0.0)
        for accel, side in actions
    ]
    return Problem(
        task, local, state, at_rest(local, REACTIVE), q, ends, actions, actions[possible]
    )


def root_lines(problem: Problem) -> Floats:
    """[B, K] the actions that can begin now as one entry a step of the first ply."""
    lines = np.repeat(problem.roots[:, :1], problem.ends[0], axis=1)
    lines[:, 0] = [entry_of(accel, side) for accel, side in problem.roots]
    return lines


def profile_line(problem: Problem, command: Follow) -> Floats:
    """[K] the commanded speeds of the first ply, whatever they are; a profile that is too short
    keeps its last speed."""
    steps = int(problem.ends[0])
    line = COMMANDED + np.append(
        command.speeds[:steps], np.full(max(0, steps - len(command.speeds)), command.speeds[-1])
    )
    line[0] = entry_of(line[0], float(command.lane_change))
    return line


def solve(
    problem: Problem, lines: Floats, labels: int = LABELS, cell: tuple[float, ...] = CELL
) -> Solution:
    """The best continuation of each beginning in `lines` [C, K], with at most so many labels for
    each and ply."""
    count, plies, rows = len(lines), len(problem.ends), labels * len(problem.actions) + 1
    table, driven = np.zeros(1 << (2 * rows).bit_length(), np.int64), np.zeros(1, np.int64)
    work = Work(
        problem.local, problem.task.ego, problem.q, problem.ends, problem.actions, _rest(problem),
        np.array(cell), np.array(KIND), table,
        problem.others.copy(), driven,
    )  # fmt: skip
    starts, now, then = (_new_labels(size, plies, problem.others) for size in (count, labels, rows))
    best, way = np.full((count, 2), np.inf), np.full((count, plies), np.nan)
    _solve(work, problem.state, problem.others, lines, starts, now, then, best, way)
    collides = np.isinf(best[:, 0])
    return Solution(np.where(collides, best[:, 1], best[:, 0]), collides, way, int(driven[0]))


def best_root(solution: Solution, count: int | None = None) -> int:
    """The beginning, of the first `count`, that is free of losses if any is, and of these the
    cheapest."""
    return int(np.lexsort((solution.value[:count], solution.collides[:count]))[0])


def steps_of(problem: Problem, line: Floats, way: Floats) -> Floats:
    """A beginning [K] and its continuation [P] as one entry a step of the simulation; it ends where
    the way does."""
    parts = [line]
    for entry, steps in zip(way[1:], np.diff(problem.ends), strict=True):
        if np.isnan(entry):
            break
        part = np.full(steps, entry_of(entry, -side_of(entry)))
        part[0] = entry
        parts.append(part)
    return np.concatenate(parts)


def _new_labels(size: int, plies: int, others: Floats) -> Labels:
    whole = (np.zeros(size, np.int64) for _ in range(3))
    return Labels(
        np.zeros((size, 2), np.int64), np.zeros((size, 5)), next(whole), np.zeros((size, 2)),
        np.zeros((size, *others.shape)), np.zeros(size),
        np.zeros(size), next(whole), next(whole), np.zeros((size, plies)),
    )  # fmt: skip


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
    work: Work,
    root: State,
    at_root: Floats,
    lines: Floats,
    starts: Labels,
    now: Labels,
    then: Labels,
    best: Floats,
    way: Floats,
) -> None:
    """best [C, 2]: the lowest cost of the ways without a loss, and of those with one, that begin
    with each line; way [C, P]: the best of them."""
    free, same = np.full(len(work.ends), FOLLOW), np.arange(len(lines))
    for i in range(len(lines)):
        end = _begin(work, root, at_root, lines[i], starts, i)
        same[i] = _same(starts, i)
        if end != ALIVE:
            best[i, 1 if end == LOST else 0], same[i] = starts.cost[i], -1
        if same[i] < i:  # it is over, or the road and the bounds left no choice
            continue
        _drive_on(work, starts, i, 0, free, best[i], way[i])
        for j in range(i):
            _drive_on(work, starts, i, 0, way[j], best[i], way[i])
        _copy(starts, i, now, 0)
        used = 1
        for ply in range(1, len(work.ends)):
            found = _spread(work, now, used, then, ply, best[i], way[i])
            order = np.argsort(
                then.bound[:found], kind="mergesort"
            )  # stable: the same without compilation
            if found > len(now.cost):
                _rank(work, then, order)
                order = order[np.argsort(then.rank[order], kind="mergesort")]
            used = 0
            for k in order[: len(now.cost)]:
                if then.bound[k] < best[i, 0]:
                    _copy(then, k, now, used)
                    used += 1
            if used == 0:
                break
            _drive_on(work, now, 0, ply, free, best[i], way[i])
    for i in range(len(lines)):  # what was found for one beginning may be good for another
        for j in range(len(lines)):
            if same[i] == i and j != i and same[j] == j:
                _drive_on(work, starts, i, 0, way[j], best[i], way[i])
    for i in range(len(lines)):
        if 0 <= same[i] < i:
            best[i], way[i] = best[same[i]], way[same[i]]


@kernel
def _begin(work: Work, root: State, at_root: Floats, line: Floats, labels: Labels, k: int) -> int:
    """Drive the first ply, written step by step, into label k: how it ends."""
    local, p = work.local, work.ego
    meeting = meet(local, p, COST, root, at_root, local.followers, 0)
    state, followers, gap, leader_v = root, meeting.followers, meeting.gap, meeting.leader_v
    copy_pairs(at_root, work.moving)
    cost, end, side = 0.0, ALIVE, side_of(line[0])
    if side != 0 and can_change(local, p, state, side):
        state = begin_change(local, p, state, side)
        cost += COST.lane_change
    for at in range(len(line)):
        ply = _simulate(
            work,
            state,
            followers,
            gap,
            leader_v,
            entry_of(line[at], -side_of(line[at])),
            at,
            at + 1,
        )
        cost += ply.safety + ply.comfort + ply.passability + ply.loss
        state, followers, gap, leader_v, end = (
            ply.state,
            ply.followers,
            ply.gap,
            ply.leader_v,
            ply.end,
        )
        if end != ALIVE:
            break
    labels.line[k], labels.bound[k] = np.nan, cost
    _write(labels, k, state, followers, gap, leader_v, work.moving, cost)
    return end


@kernel
def _same(starts: Labels, i: int) -> int:
    """The first beginning that comes to the same as the i-th; i: none before it."""
    for j in range(i):
        apart = abs(starts.cost[i] - starts.cost[j])
        for n in range(4):
            apart = max(apart, abs(starts.motion[i, n] - starts.motion[j, n]))
        if (
            apart < 1e-6
            and starts.where[i, 0] == starts.where[j, 0]
            and starts.where[i, 1] == starts.where[j, 1]
        ):
            return j
    return i


@kernel
def _spread(
    work: Work, now: Labels, used: int, then: Labels, ply: int, best: Floats, way: Floats
) -> int:
    """Every action from each of the `used` labels `now`, to the end of the ply.

    What goes on is left in `then`: returns how many labels; what is over, or comes to the horizon,
    goes into `best` and `way`.
    """
    local, p, at, end = work.local, work.ego, int(work.ends[ply - 1]), int(work.ends[ply])
    work.table[:] = 0
    found, left = 0, int(work.ends[-1]) - end
    for k in range(used):
        if now.bound[k] >= best[0]:
            continue
        for n in range(len(work.actions)):
            state, side, cost = (
                kept_state(now.where, now.motion, k),
                int(work.actions[n, 1]),
                now.cost[k],
            )
            if side != 0:
                if not may_change(local, p, COST, state, side, work.actions[n, 0], at * p.step):
                    continue
                state = begin_change(local, p, state, side)
                cost += COST.lane_change
            copy_pairs(now.others[k], work.moving)
            _set(then.line[found], now.line[k])
            then.line[found, ply] = entry_of(work.actions[n, 0], work.actions[n, 1])
            step = _simulate(
                work,
                state,
                now.followers[k],
                now.leader[k, 0],
                now.leader[k, 1],
                work.actions[n, 0],
                at,
                end,
            )
            cost += step.safety + step.comfort + step.passability + step.loss
            if step.end == ALIVE and left > 0:
                then.bound[found] = cost + _at_least(local, work.rest, step.state.v, left, p.step)
                if then.bound[found] < best[0]:
                    _write(
                        then,
                        found,
                        step.state,
                        step.followers,
                        step.gap,
                        step.leader_v,
                        work.moving,
                        cost,
                    )
                    found = _merged(work, then, found)
            else:
                if step.end == ALIVE:
                    cost += terminal(local, COST, step.state, step.gap, step.leader_v)
                _note(best, way, step.end, cost, then.line[found])
    return found


@kernel
def _drive_on(
    work: Work, labels: Labels, i: int, ply: int, tail: Floats, best: Floats, way: Floats
) -> None:
    """From label i, at the end of `ply`, to the horizon by the entries of `tail`, with car
    following where there are none: a way that others have to be better than."""
    local, p = work.local, work.ego
    state, followers, gap, leader_v, cost = (
        kept_state(labels.where, labels.motion, i),
        labels.followers[i],
        labels.leader[i, 0],
        labels.leader[i, 1],
        labels.cost[i],
    )
    copy_pairs(labels.others[i], work.moving)
    line, end = labels.line[i], ALIVE
    for k in range(ply + 1, len(work.ends)):
        at, entry = int(work.ends[k - 1]), FOLLOW if np.isnan(tail[k]) else tail[k]
        side = side_of(entry)
        accel = entry_of(entry, -side)
        if side != 0 and may_change(local, p, COST, state, side, accel, at * p.step):
            state = begin_change(local, p, state, side)
            cost += COST.lane_change
        else:
            entry = accel
        line[k] = entry
        step = _simulate(work, state, followers, gap, leader_v, accel, at, int(work.ends[k]))
        cost += step.safety + step.comfort + step.passability + step.loss
        state, followers, gap, leader_v, end = (
            step.state,
            step.followers,
            step.gap,
            step.leader_v,
            step.end,
        )
        if end != ALIVE:
            break
    if end == ALIVE:
        cost += terminal(local, COST, state, gap, leader_v)
    _note(best, way, end, cost, line)
    line[ply + 1 :] = np.nan


@kernel
def _simulate(
    work: Work,
    state: State,
    followers: int,
    gap: float,
    leader_v: float,
    accel: float,
    begin: int,
    end: int,
) -> Ply:
    """One action from step `begin` to step `end`."""
    q = SearchParams(
        end - begin,
        work.q.check,
        work.q.checks_in_step,
        work.q.look_ahead,
        work.q.rollout,
        work.q.exploration,
        work.q.horizon,
        False,
        False,
    )
    work.driven[0] += 1
    return simulate(
        work.local, work.ego, COST, q, state, work.moving, followers, gap, leader_v, accel, begin
    )


@kernel
def _note(best: Floats, way: Floats, end: int, cost: float, line: Floats) -> None:
    """Keep a way that is over, where it is the best of its kind; one with a loss is shown only as
    long as there is none without."""
    kind = 1 if end == LOST else 0
    if cost < best[kind]:
        best[kind] = cost
        if kind == 0 or best[0] == math.inf:
            _set(way, line)


@kernel
def _at_least(local: LocalMap, rest: Rest, v: float, steps: int, step: float) -> float:
    """What `steps` of the simulation (of `step` s) and the end cost at least from speed v on:
    progress lost although the ego accelerates as it can."""
    if rest.limit == math.inf:
        return 0.0
    gain = rest.accel * step
    n = min(
        float(steps), max(0.0, math.floor((rest.limit - v) / gain))
    )  # until the limit is reached
    lost = step * (n * (1.0 - v / rest.limit) - gain * n * (n + 1.0) / (2.0 * rest.limit))
    missing = max(0.0, local.limit - v - gain * steps) if local.free else 0.0
    return COST.progress * (lost + missing * missing / (2.0 * PICK_UP * local.limit))


@kernel
def _merged(work: Work, labels: Labels, new: int) -> int:
    """Label `new` among those before it: of two in a cell the cheaper one stays.

    Returns the number of labels.
    """
    key = _key(labels, new, work.cell)
    slot = _slot(work, labels, key)
    labels.key[new] = key
    if work.table[slot] == 0:
        work.table[slot] = new + 1
        return new + 1
    k = work.table[slot] - 1
    if labels.cost[new] < labels.cost[k]:
        _copy(labels, new, labels, k)
    return new


@kernel
def _rank(work: Work, labels: Labels, order: Indices) -> None:
    """Number the labels of each kind in this order.

    The best of each kind shall come before the second of any: what is dear now, such as to let
    others go first, may be cheap in the end.
    """
    work.table[:] = 0
    for k in order:
        key = _key(labels, k, work.kind)
        slot = _slot(work, labels, key)
        labels.rank[k] = labels.rank[work.table[slot] - 1] + 1 if work.table[slot] != 0 else 0
        labels.key[k] = key
        work.table[slot] = k + 1


@kernel
def _slot(work: Work, labels: Labels, key: int) -> int:
    """Where a key is in the table, or is to be."""
    slot = key % len(work.table)
    while work.table[slot] != 0 and labels.key[work.table[slot] - 1] != key:
        slot = (slot + 1) % len(work.table)
    return slot


@kernel
def _key(labels: Labels, k: int, cell: Floats) -> int:
    """A number for the cell of label k (`cell` as CELL), or for its kind (as KIND)."""
    low, high = _mixed(0, 0, labels.where[k, 0])
    low, high = _mixed(low, high, labels.where[k, 1])
    for n in range(min(len(cell), 4)):
        low, high = _mixed(low, high, int(math.floor(labels.motion[k, n] / cell[n])))
    if len(cell) > 4:
        low, high = _mixed(low, high, labels.followers[k] % 2147483647)
        for r in range(labels.others.shape[1]):
            low, high = _mixed(low, high, int(math.floor(labels.others[k, r, 0] / cell[4])))
            low, high = _mixed(low, high, int(math.floor(labels.others[k, r, 1] / cell[5])))
    return low * 2147483648 + high


@kernel
def _mixed(low: int, high: int, number: int) -> tuple[int, int]:
    """Two hashes, by two primes below 2^31: nothing overflows, so that it is the same without
    compilation."""
    return (low * 1000003 + number + 1000000) % 2147483647, (
        high * 1299709 + number + 1000000
    ) % 2147483629


@kernel
def _write(
    labels: Labels,
    k: int,
    state: State,
    followers: int,
    gap: float,
    leader_v: float,
    others: Floats,
    cost: float,
) -> None:
    keep_state(labels.where, labels.motion, k, state)
    labels.followers[k], labels.cost[k] = followers, cost
    labels.leader[k, 0], labels.leader[k, 1] = gap, leader_v
    copy_pairs(others, labels.others[k])


@kernel
def _copy(source: Labels, i: int, target: Labels, k: int) -> None:
    _set(target.motion[k], source.motion[i])
    _set(target.line[k], source.line[i])
    copy_pairs(source.others[i], target.others[k])
    target.where[k, 0], target.where[k, 1] = source.where[i, 0], source.where[i, 1]
    target.leader[k, 0], target.leader[k, 1] = source.leader[i, 0], source.leader[i, 1]
    target.followers[k], target.cost[k], target.bound[k], target.key[k] = (
        source.followers[i],
        source.cost[i],
        source.bound[i],
        source.key[i],
    )


@kernel
def _set(target: Floats, source: Floats) -> None:
    """Copy a row: assigning slices would need an array in between."""
    for n in range(len(source)):
        target[n] = source[n]
