"""Others that react to the ego inside the search: each drives along its own forecast, late by as
much as the ego holds it up.

An agent that is held up only falls behind its forecast: it stays clear of the vehicles that the
forecast has it follow. It brakes as SUMO's drivers do (Krauss 1998, with a reaction time of a
second and 4.5 m/s2): late and hard. One that has stood brakes for an ego across its path, too.
People wait at the kerb, or do not (kerbs.py).
"""

import math

import numpy as np

from sumo_mcts.arrays import Floats
from sumo_mcts.model.kerbs import walk
from sumo_mcts.model.local_map import (
    CLOCK,
    DRIVEN,
    HALF_LENGTH,
    HALF_WIDTH,
    OWED,
    SLOT,
    SPEED,
    LocalMap,
    S,
    State,
    V,
    between,
    boxes_meet,
    chain_gap,
    is_gone,
    node_of,
    upstream_of,
)
from sumo_mcts.model.motion import EgoParams, pose_of
from sumo_mcts.model.route import LEFT_NODE, RIGHT_NODE
from sumo_mcts.numerics.geometry import COS, SIN, Box, X, Y
from sumo_mcts.numerics.kernel import kernel
from sumo_mcts.numerics.krauss import DECEL, STANDSTILL, USUAL_S, safe_speed

PANIC = 9.0  # m/s2 of emergency braking, as SUMO's cars have it by default,
NEAR = 1.0  # m to the ego up to which they brake like that
CATCHES_UP = 2.0  # m/s2 with which an agent that is late drives faster again
# m/s2 with which an agent brakes at most for an ego that asks for room: SUMO's brake with 4.5
HELPS = 3.0
IMPOSED = 2.0  # m/s2 of braking that counts as imposed (measures)


def undisturbed(local: LocalMap, count: int = 0) -> Floats:
    """[R, 2] the reacting agents as they are now, before the ego has held any up; at least `count`
    rows."""
    others = np.zeros((max(int(local.trait[:, SLOT].max(initial=-1.0)) + 1, count), 2))
    for i, slot in enumerate(local.trait[:, SLOT].astype(int)):
        if slot >= 0:
            others[slot, SPEED] = local.agent[0, i, V]
    return others


@kernel
def react(
    local: LocalMap, p: EgoParams, state: State, others: Floats, t: int, seconds: float
) -> float:
    """Move every reacting agent on by `seconds`, up to forecast time `t`, with the ego where
    `state` says. Returns the braking beyond IMPOSED that the ego causes, summed up over agents, in
    m/s2; what an agent brakes to make room is no part of it, since it was asked already."""
    imposed = 0.0
    t = min(t, local.agent.shape[0] - 1)
    for i in range(local.agent.shape[1]):
        r = int(local.trait[i, SLOT])
        if r < 0 or is_gone(local, t, i):
            continue
        if local.trait[i, OWED] >= 0.0:
            walk(local, p, state, others, t, i, seconds)
            continue
        clock, v = others[r, CLOCK], others[r, SPEED]
        k = int(clock)
        driven = between(local, i, clock, DRIVEN)
        gap = _gap_to_ego(
            local,
            p,
            state,
            max(node_of(local, k, i), upstream_of(local, k, i) if local.asked != 0 else -1),
            _position(local, i, clock),
        )
        leads_with = state.v
        if i == local.starts and gap == math.inf:
            gap, leads_with = _gap_across(local, p, state, others, i), 0.0
        speed = v + CATCHES_UP * seconds
        asked = _gap_when_asked(local, p, state, others, i, t)
        if asked < math.inf:
            careful = safe_speed(asked - STANDSTILL, state.v, USUAL_S)
            speed = min(speed, max(careful, v - HELPS * seconds))
        if gap < math.inf:
            careful = safe_speed(gap - STANDSTILL, leads_with, USUAL_S)
            if careful < v:
                imposed += max(0.0, min((v - careful) / seconds, DECEL) - IMPOSED)
            speed = min(speed, max(careful, v - (DECEL if gap > NEAR else PANIC) * seconds))
        speed = max(speed, 0.0)
        reached = driven + speed * seconds
        if reached >= local.agent[t, i, DRIVEN]:
            others[r, CLOCK], others[r, SPEED] = t, local.agent[t, i, V]
            continue
        while k + 1 < t and local.agent[k + 1, i, DRIVEN] <= reached:
            k += 1
        span = local.agent[k + 1, i, DRIVEN] - local.agent[k, i, DRIVEN]
        others[r, CLOCK] = k + (
            (reached - local.agent[k, i, DRIVEN]) / span if span > 1e-9 else 0.0
        )
        others[r, SPEED] = speed
    return imposed


@kernel
def seen(
    local: LocalMap, others: Floats, i: int, t: int
) -> tuple[float, float, float, float, float, float, int]:
    """Agent i at forecast time `t`: centre x, y, cos and sin of the heading, speed, lane
    position, and the time at which the forecast has it there."""
    r = int(local.trait[i, SLOT])
    if r < 0 or others[r, CLOCK] >= t:
        row = local.agent[t, i]
        return row[X], row[Y], row[COS], row[SIN], row[V], row[S], t
    clock = others[r, CLOCK]
    k = int(clock)
    s = _position(local, i, clock)
    return (
        between(local, i, clock, X), between(local, i, clock, Y), between(local, i, clock, COS),
        between(local, i, clock, SIN), others[r, SPEED], s, k,
    )  # fmt: skip


@kernel
def _gap_to_ego(local: LocalMap, p: EgoParams, state: State, node: int, s: float) -> float:
    """m from an agent's front to the ego's rear down the agent's lane; inf where the ego is not
    ahead of it."""
    if node < 0:
        return math.inf
    gap = chain_gap(local, node, s, state.node, state.s)
    if state.other >= 0:
        gap = min(gap, chain_gap(local, node, s, state.other, state.s))
    return gap - 2.0 * p.half_length if gap > 0.0 else math.inf


@kernel
def _gap_across(local: LocalMap, p: EgoParams, state: State, others: Floats, i: int) -> float:
    """m that agent i still drives until its box meets the ego's, where that is now; inf: it does
    not, or not before the agent could stop twice."""
    length, width = local.trait[i, HALF_LENGTH], local.trait[i, HALF_WIDTH]
    r = int(local.trait[i, SLOT])
    x, y, cs, sn = pose_of(local, p, state)
    box, near = Box(x, y, cs, sn, p.half_length, p.half_width), p.half_length + p.half_width
    v, driven = others[r, SPEED], between(local, i, others[r, CLOCK], DRIVEN)
    view = 2.0 * (STANDSTILL + v * USUAL_S + v * v / (2.0 * DECEL))
    for k in range(int(others[r, CLOCK]) + 1, local.agent.shape[0]):
        row = local.agent[k, i]
        if is_gone(local, k, i) or row[DRIVEN] - driven > view:
            break
        if max(abs(row[X] - x), abs(row[Y] - y)) < near + length + width:
            other = Box(row[X], row[Y], row[COS], row[SIN], length, width)
            if boxes_meet(local, state.node, state.s, p.half_length, box, other, k, i):
                return float(max(row[DRIVEN] - driven, 0.0))
    return math.inf


@kernel
def _gap_when_asked(
    local: LocalMap, p: EgoParams, state: State, others: Floats, i: int, t: int
) -> float:
    """m from agent i's front to the ego's rear where the ego asks it for room, and it makes some;
    else inf.

    Like SUMO's drivers the nearest one behind falls back if it can brake for the ego in comfort.
    From an ego that is too slow for that it drives on.
    """
    if local.asked == 0 or state.progress > 0.0:
        return math.inf
    beside = int(local.node[state.node, LEFT_NODE if local.asked > 0 else RIGHT_NODE])
    if beside < 0:
        return math.inf
    gap, v = _gap_to(local, others, i, beside, state.s), others[int(local.trait[i, SLOT]), SPEED]
    room, closing = gap - 2.0 * p.half_length, max(0.0, v - state.v)
    if room <= 0.0 or room == math.inf or closing * closing > 2.0 * HELPS * room:
        return math.inf
    for j in range(local.agent.shape[1]):
        if j != i and local.trait[j, SLOT] >= 0.0 and not is_gone(local, t, j):
            if 0.0 < _gap_to(local, others, j, beside, state.s) < gap:
                return math.inf
    return room


@kernel
def _gap_to(local: LocalMap, others: Floats, i: int, node: int, s: float) -> float:
    """m from the front of the reacting agent i, where it is by now, to `s` on `node`; inf: its lane
    does not lead there."""
    clock = others[int(local.trait[i, SLOT]), CLOCK]
    k = int(clock)
    here = _position(local, i, clock)
    return chain_gap(local, max(node_of(local, k, i), upstream_of(local, k, i)), here, node, s)


@kernel
def _position(local: LocalMap, i: int, clock: float) -> float:
    """Lane position of agent i between two forecast times, on its lane at the earlier one, m."""
    k = int(clock)
    return float(
        local.agent[k, i, S] + between(local, i, clock, DRIVEN) - local.agent[k, i, DRIVEN]
    )
