"""Where the others could be, whatever they do within bounds, and whether they meet the ego there.

Compiled; failsafe.py asks.
"""

import math
from typing import NamedTuple

from sumo_mcts.arrays import Floats, Indices
from sumo_mcts.model.gaps import is_seen
from sumo_mcts.model.local_map import (
    DRIVEN,
    HALF_LENGTH,
    HALF_WIDTH,
    REACTS,
    LocalMap,
    S,
    State,
    V,
    boxes_meet,
    chain_gap,
    is_gone,
    node_of,
    on_other_level,
)
from sumo_mcts.model.motion import (
    GOAL,
    EgoParams,
    advance,
    begin_change,
    obey,
    pose_of,
    within_step,
)
from sumo_mcts.model.route import INTERNAL, LENGTH, NEXT
from sumo_mcts.numerics.geometry import COS, SIN, Box, X, Y
from sumo_mcts.numerics.kernel import entry, kernel
from sumo_mcts.planners.ply import DRIVEN_S, DRIVEN_V

CHECK_S = 0.25  # longest time between two checks
ALONG = 0.8  # cosine of the angle between two headings up to which one vehicle follows the other
AT_REST = 0.01  # m/s
NO_AGENT, NO_END = -1, -2  # in place of an obstacle's agent
# A manoeuvre after the decision period. BRAKE brakes at once. HOLD and ACCELERATE last until the
# junction is left and the lane change ended; then the ego brakes.
BRAKE, HOLD, ACCELERATE = range(3)


class Assumed(NamedTuple):
    """What the others may do; see config.FailSafeConfig. SI units, decelerations positive."""

    decel: float
    accel: float
    over_limit: float
    reaction: float
    yield_decel: float
    horizon: float


@entry
def drive(
    local: LocalMap, p: EgoParams, q: Assumed, top: Floats, start: State, speeds: Floats, side: int,
    period: int, begin: int, decel: float,
    nodes: Indices, motion: Floats, pose: Floats,
) -> tuple[int, int, float]:  # fmt: skip
    """Drive the commanded `speeds` for `period` steps, then a manoeuvre that ends in braking with
    `decel`, m/s2.

    `top` [N]: the speeds that agents may reach, m/s. Each step fills a row of nodes [M], motion
    [M, 2] DRIVEN_S and DRIVEN_V, and pose [M, 4].

    Returns the number of steps, the agent that the ego could meet, and when, s from now. NO_AGENT
    stands for none. NO_END: the manoeuvre does not end in time, or equals the one with BRAKE. That
    it crosses a closed stop line is no objection: only agents that the ego could meet are.
    """
    state = begin_change(local, p, start, side) if side != 0 else start
    checks = max(1, math.ceil(p.step / CHECK_S))
    interval = p.step / checks
    clear = 0.0
    for k in range(len(nodes)):
        time, before = k * p.step, state
        if k == period:
            clear = _to_clear(local, p, state)
            if begin != BRAKE and clear <= 0.0 and state.progress == 0.0:
                return k, NO_END, time  # the same as braking at once
        if k < period:
            wanted = speeds[k] if k < len(speeds) else state.v + min(state.a, 0.0) * p.step
            state, event = obey(local, p, state, wanted, time)
        else:
            accel = p.max_accel if begin == ACCELERATE else 0.0
            if begin == BRAKE or (clear <= 0.0 and state.progress == 0.0):
                accel = -decel
            state, event = advance(local, p, state, accel, time)
            clear -= state.v * p.step
        nodes[k] = state.node
        motion[k, DRIVEN_S], motion[k, DRIVEN_V] = state.s, state.v
        pose[k, X], pose[k, Y], pose[k, COS], pose[k, SIN] = pose_of(local, p, state)
        if event == GOAL:
            return k + 1, NO_AGENT, time
        for r in range(checks):
            moment = time + (r + 1.0) * interval
            there = within_step(local, p, before, state, (r + 1.0) / checks)
            agent = _obstructing(local, p, q, top, start, there, moment, interval)
            if agent != NO_AGENT:
                return k + 1, agent, moment
        if k >= period and state.v < AT_REST and time + p.step >= q.horizon:
            return k + 1, NO_AGENT, time
    return len(nodes), NO_END, len(nodes) * p.step


@kernel
def _to_clear(local: LocalMap, p: EgoParams, state: State) -> float:
    """m to where the ego has left the junction that it is in, or that it cannot stop before in
    comfort; 0 elsewhere."""
    node, end = state.node, local.node[state.node, LENGTH] - state.s
    if local.node[node, INTERNAL] == 0.0:
        node = int(local.node[node, NEXT])
        if (
            node < 0
            or local.node[node, INTERNAL] == 0.0
            or end > state.v * state.v / (2.0 * p.comfort_decel) + state.v * p.step
        ):
            return 0.0
        end += local.node[node, LENGTH]
    while local.node[node, NEXT] >= 0.0 and local.node[int(local.node[node, NEXT]), INTERNAL] > 0.0:
        node = int(local.node[node, NEXT])
        end += local.node[node, LENGTH]
    return end + 2.0 * p.half_length


@kernel
def _obstructing(
    local: LocalMap,
    p: EgoParams,
    q: Assumed,
    top: Floats,
    start: State,
    state: State,
    moment: float,
    interval: float,
) -> int:
    """The first agent that could be where the ego is at `moment` (s from now), half an interval
    before or after; NO_AGENT."""
    x, y, cs, sn = pose_of(local, p, state)
    width = p.half_width + (local.aside if state.progress > 0.0 else 0.0)
    box = Box(x, y, cs, sn, p.half_length + 0.5 * state.v * interval, width)
    early, late = max(moment - 0.5 * interval, 0.0), moment + 0.5 * interval
    for i in range(local.agent.shape[1]):
        v = local.agent[0, i, V]
        most = _driven_most(v, q.accel, top[i], late)
        reach = (
            most
            + box.half_length
            + box.half_width
            + local.trait[i, HALF_LENGTH]
            + local.trait[i, HALF_WIDTH]
        )
        if (
            is_gone(local, 0, i)
            or abs(local.agent[0, i, X] - x) > reach
            or abs(local.agent[0, i, Y] - y) > reach
        ):
            continue
        if _is_behind(local, start, i):
            continue  # it keeps its distance
        reacting = (
            min(most, _driven_reacting(v, q, top[i], late))
            if local.trait[i, REACTS] > 0.0
            else most
        )
        if _meets(local, state, i, _driven_least(v, q.decel, early), most, reacting, box):
            return i
    return NO_AGENT


@kernel
def _is_behind(local: LocalMap, start: State, i: int) -> bool:
    """Whether the agent is now behind the ego on a lane that leads to it, and sees it."""
    node = node_of(local, 0, i)
    if not is_seen(local, start, node, local.agent[0, i, S]):
        return False
    for target in (start.node, start.other):
        if (
            node >= 0
            and target >= 0
            and 0.0 < chain_gap(local, node, local.agent[0, i, S], target, start.s) < math.inf
        ):
            return True
    return False


@kernel
def _driven_least(v: float, decel: float, time: float) -> float:
    """m that an agent drives at least: braking from now on."""
    time = min(time, v / decel)
    return v * time - 0.5 * decel * time * time


@kernel
def _driven_most(v: float, accel: float, top: float, time: float) -> float:
    """m that an agent drives at most: accelerating up to its top speed."""
    rise = min(time, (top - v) / accel)
    return v * rise + 0.5 * accel * rise * rise + (v + accel * rise) * (time - rise)


@kernel
def _driven_reacting(v: float, q: Assumed, top: float, time: float) -> float:
    """m that an agent drives at most which brakes for the ego after its reaction time."""
    before = min(time, q.reaction)
    return _driven_most(v, q.accel, top, before) + _driven_least(
        min(v + q.accel * before, top), q.yield_decel, time - before
    )


@kernel
def _meets(
    local: LocalMap, state: State, i: int, least: float, most: float, reacting: float, box: Box
) -> bool:
    """Whether a box meets the part of agent i's path from `least` to `most`, m from now.

    Beyond `reacting` the part counts only where the agent would neither drive up to the box from
    behind, nor set off towards it.
    """
    last = local.agent.shape[0] - 1
    if not is_gone(local, last, i):
        # the forecast's path ends there: it waits, or the forecast is over
        least = min(least, local.agent[last, i, DRIVEN])
    for t in range(max(last, 1)):
        then = min(t + 1, last)
        if is_gone(local, then, i) or local.agent[t, i, DRIVEN] > most:
            return False
        if local.agent[then, i, DRIVEN] < least or (
            t > 0 and local.agent[then, i, DRIVEN] - local.agent[t, i, DRIVEN] < 1e-6
        ):
            continue
        if _covers(local, state, i, t, then, least, most, box):
            ahead = (box.x - local.agent[t, i, X]) * local.agent[t, i, COS] + (
                box.y - local.agent[t, i, Y]
            ) * local.agent[t, i, SIN]
            along = (
                ahead > 0.0
                and box.cos * local.agent[t, i, COS] + box.sin * local.agent[t, i, SIN] > ALONG
            )
            if not along and local.agent[0, i, V] > AT_REST:
                return True
            return local.agent[t, i, DRIVEN] <= reacting and _covers(
                local, state, i, t, then, least, reacting, box
            )
    return False


@kernel
def _covers(
    local: LocalMap, state: State, i: int, t: int, then: int, least: float, most: float, box: Box
) -> bool:
    """Whether a box meets agent i anywhere between forecast times t and `then`, as far as that lies
    between `least` and `most` on its path."""
    now, later = local.agent[t, i], local.agent[then, i]
    here, length = now[DRIVEN], later[DRIVEN] - now[DRIVEN]
    first, final = 0.0, 0.0
    if length > 1e-6:
        first = max((least - here) / length, 0.0)
        final = min((most - here) / length, 1.0)
    dx, dy = later[X] - now[X], later[Y] - now[Y]
    middle = 0.5 * (first + final)
    half = local.trait[i, HALF_LENGTH] + 0.5 * (final - first) * math.sqrt(dx * dx + dy * dy)
    x, y, width = now[X] + middle * dx, now[Y] + middle * dy, local.trait[i, HALF_WIDTH]
    close = box.half_length + box.half_width + half + width
    if (
        abs(x - box.x) > close
        or abs(y - box.y) > close
        or on_other_level(local, state.node, state.s, 2.0 * box.half_length, t, i)
    ):
        return False
    other = Box(x, y, now[COS], now[SIN], half, width)
    return boxes_meet(local, state.node, state.s, box.half_length, box, other, t, i)
