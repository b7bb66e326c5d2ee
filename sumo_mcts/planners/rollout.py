"""One ply of the search: an action simulated for a period, and the parameters of the search."""

import math
from typing import NamedTuple

from sumo_mcts.model.cost import (
    contact_cost,
    leads_nowhere,
    step_comfort,
    step_own,
    step_passability,
    terminal,
)
from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.model.interaction import meet, place_is_free
from sumo_mcts.model.local_map import LocalMap, State, index_at
from sumo_mcts.model.motion import (
    COMMANDED,
    GOAL,
    OFF_END,
    RED_LINE,
    EgoParams,
    advance,
    begin_change,
    can_change,
    follow_accel,
    obey,
    pose_of,
    within_step,
)
from sumo_mcts.model.reactions import react
from sumo_mcts.model.route import LIMIT
from sumo_mcts.numerics.kernel import entry, inlined, kernel
from sumo_mcts.scene import Floats, Indices

NONE = -1  # no child, no parent
# an action that cannot be taken there, leads to the same state as another, or (adaptive) is too
# dear already
IMPOSSIBLE = -2
ALIVE, LOST, ARRIVED = range(3)
ROLLING = 2.0  # m/s below which a lane change begins with driving off


class SearchParams(NamedTuple):
    """Times in steps of the simulation; see config.PlannerConfig."""

    ply: int  # steps of one action
    check: int  # steps between collision checks; 0: several checks within a step
    checks_in_step: int  # then: how many
    look_ahead: int  # levels of the tree
    rollout: int  # further actions
    exploration: float
    horizon: float  # s
    adaptive: bool  # leave out what cannot be better than the best known
    each: bool  # better than the best of its own root action: every one of them gets its due


class Ply(NamedTuple):
    """What came of one action."""

    state: State
    followers: int
    gap: float
    leader_v: float
    safety: float
    comfort: float
    passability: float
    other: float
    end: int  # ALIVE, LOST, ARRIVED
    loss: float  # where LOST


def search_params(
    step: float,
    forecast_dt: float,
    ply_s: float,
    check_s: float,
    look_ahead: int,
    rollout: int,
    exploration: float,
    adaptive: bool,
) -> SearchParams:
    """Times in seconds to steps of the simulation; a step longer than the forecast's gets several
    checks."""
    ply = max(1, round(ply_s / step))
    check, checks = (
        (0, max(1, round(step / forecast_dt)))
        if step > forecast_dt + 1e-9
        else (max(1, round(check_s / step)), 1)
    )
    return SearchParams(
        ply,
        check,
        checks,
        look_ahead,
        rollout,
        exploration,
        (look_ahead + rollout) * ply * step,
        adaptive,
        False,
    )


@kernel
def entry_of(accel: float, side: float) -> float:
    """An action of a sequence as one number: acceleration (m/s2) and lane change (-1, 0, 1)."""
    return accel + 1000.0 * side


@kernel
def side_of(entry: float) -> int:
    """The lane change of an entry."""
    return int(round(entry / 1000.0)) if abs(entry) > 500.0 else 0


@inlined
def simulate(
    local: LocalMap, p: EgoParams, c: CostParams, q: SearchParams, state: State, others: Floats,
    followers: int, gap: float, leader_v: float,
    accel: float, at: int,
) -> Ply:  # fmt: skip
    """One action from simulation step `at` on: q.ply steps towards `accel` (FOLLOW: car following;
    from COMMANDED on: that speed), with checks against the forecast; `others` move."""
    safety, comfort, passability, other = 0.0, 0.0, 0.0, 0.0
    every = p.step * q.check if q.check > 0 else p.step / q.checks_in_step
    for k in range(q.ply):
        time = (at + k) * p.step
        wanted = (
            follow_accel(p, state.v, local.node[state.node, LIMIT], gap, leader_v)
            if accel > 50.0
            else accel
        )
        before = state
        state, event = (
            advance(local, p, state, wanted, time)
            if accel < COMMANDED
            else obey(local, p, state, accel - COMMANDED, time)
        )
        comfort += step_comfort(p, c, before, state)
        passability += step_passability(local, p, c, state)
        if event in (RED_LINE, OFF_END):
            loss = contact_cost(c, before if event == OFF_END else state, time, q.horizon)
            return Ply(
                state,
                followers,
                gap,
                leader_v,
                safety,
                comfort,
                passability,
                other,
                LOST,
                loss + (c.red if event == RED_LINE else 0.0),
            )
        if event == GOAL:
            return Ply(
                state, followers, gap, leader_v, safety, comfort, passability, other, ARRIVED, 0.0
            )
        gap += (leader_v - state.v) * p.step
        other += step_own(c.term, local, p, c, before, state, gap, time + p.step)
        checks = q.checks_in_step if q.check == 0 else (1 if (at + k + 1) % q.check == 0 else 0)
        for r in range(checks):
            share = (r + 1.0) / checks
            there = within_step(local, p, before, state, share)
            moment = time + share * p.step
            now = index_at(local, moment)
            if others.shape[0] > 0:
                safety += c.imposed * react(local, p, there, others, now, every) * every
            meeting = meet(local, p, c, there, others, followers, now)
            followers, gap, leader_v = meeting.followers, meeting.gap, meeting.leader_v
            safety += meeting.rate * every + meeting.once
            if meeting.contact:
                return Ply(
                    state,
                    followers,
                    gap,
                    leader_v,
                    safety,
                    comfort,
                    passability,
                    other,
                    LOST,
                    contact_cost(c, state, moment, q.horizon),
                )
    return Ply(state, followers, gap, leader_v, safety, comfort, passability, other, ALIVE, 0.0)


@kernel
def copy_pairs(source: Floats, target: Floats) -> None:
    """Copy rows of two: assigning slices would need an array in between."""
    for r in range(source.shape[0]):
        target[r, 0], target[r, 1] = source[r, 0], source[r, 1]


@kernel
def needed_side(local: LocalMap, state: State) -> int:
    """The side of the lane change that the route needs next: -1, 0, 1."""
    i = state.node - local.first
    if not 0 <= i < local.urgency.shape[0] or local.urgency[i] == 0.0:
        return 0
    return 1 if local.urgency[i] > 0.0 else -1


@kernel
def may_change(
    local: LocalMap,
    p: EgoParams,
    c: CostParams,
    state: State,
    side: int,
    accel: float,
    time: float,
    most: float = math.inf,
) -> bool:
    """Whether a lane change may begin at `time` (s from now) with `accel` (m/s2, or FOLLOW): the
    road allows it and the place is free for at `most` that cost.

    SUMO moves who stands to the side; no car does. So a slow ego has to drive off for it, but where
    its lane ends and SUMO holds it.
    """
    if state.v < ROLLING and accel <= 0.0 and not leads_nowhere(local, state.node):
        return False
    return can_change(local, p, state, side) and place_is_free(
        local, p, c, begin_change(local, p, state, side), index_at(local, time), most
    )


@entry
def replay(
    local: LocalMap, p: EgoParams, c: CostParams, q: SearchParams, root: State, others: Floats,
    line: Floats, lanes: Indices, motion: Floats, pose: Floats,
    terms: Floats,
) -> tuple[int, int]:  # fmt: skip
    """Drive a sequence of M steps (entries, see entry_of) and write down every one of them.

    lanes [M] node, motion [M, 2] s and v, pose [M, 4]; terms [5] receives safety, comfort,
    passability, other and loss. Returns the number of steps written and how it ended: ALIVE at the
    end of the sequence, LOST, ARRIVED, or IMPOSSIBLE where a lane change cannot begin.
    """
    meeting = meet(local, p, c, root, others, local.followers, 0)
    state, followers, gap, leader_v = root, meeting.followers, meeting.gap, meeting.leader_v
    one = SearchParams(
        1,
        q.check,
        q.checks_in_step,
        q.look_ahead,
        q.rollout,
        q.exploration,
        q.horizon,
        False,
        False,
    )
    terms[:] = 0.0
    for at in range(len(line)):
        side = side_of(line[at])
        if side != 0:
            if not may_change(
                local, p, c, state, side, entry_of(line[at], -side), at * p.step, math.inf
            ):
                return at, IMPOSSIBLE
            state = begin_change(local, p, state, side)
            terms[3] += c.lane_change
        ply = simulate(
            local, p, c, one, state, others, followers, gap, leader_v, entry_of(line[at], -side), at
        )
        state, followers, gap, leader_v = ply.state, ply.followers, ply.gap, ply.leader_v
        terms[0] += ply.safety
        terms[1] += ply.comfort
        terms[2] += ply.passability
        terms[3] += ply.other
        lanes[at] = state.node
        motion[at, 0], motion[at, 1] = state.s, state.v
        pose[at, 0], pose[at, 1], pose[at, 2], pose[at, 3] = pose_of(local, p, state)
        terms[4] += ply.loss
        if ply.end != ALIVE:
            return at + 1, ply.end
    if (len(line) + 0.5) * p.step > q.horizon:
        terms[2] += terminal(local, c, state, gap, leader_v)
    return len(line), ALIVE
