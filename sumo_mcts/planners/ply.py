"""One ply of the search: an action simulated for planner.step_s; the parameters of the search."""

import math
from typing import NamedTuple

from sumo_mcts.arrays import Floats, Indices
from sumo_mcts.model.completing import unfinished
from sumo_mcts.model.cost import (
    after_contact,
    contact_cost,
    leads_nowhere,
    step_comfort,
    step_own,
    step_passability,
    terminal,
)
from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.model.interaction import Neighbours, meet, place_is_free
from sumo_mcts.model.local_map import CLOCK, SPEED, LocalMap, State, index_at, urgency_at
from sumo_mcts.model.motion import (
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
from sumo_mcts.model.route import HOME, LIMIT
from sumo_mcts.numerics.geometry import COS, SIN, X, Y
from sumo_mcts.numerics.kernel import entry, inlined, kernel
from sumo_mcts.planners.actions import FOLLOW, NO_SPEED, Action, Lines, action_at
from sumo_mcts.scene import COMFORT, LOSS, OTHER, PASSABILITY, SAFETY

NONE = -1  # no child, no parent
# an action that cannot be taken there, leads to the same state as another, or (adaptive) costs too
# much already
IMPOSSIBLE = -2
ALIVE, LOST, ARRIVED = range(3)
DRIVEN_S, DRIVEN_V = range(2)  # columns of what is written down of a drive: m, m/s
ROLLING = 2.0  # m/s below which a lane change begins with driving off
# s from now up to which an overtaking through oncoming traffic may begin: who comes later than that
# is not seen yet, and the ego would fall back for it again and again.
OVERTAKES_SOON = 2.0
GIVES_UP = 1.0 / 3.0  # of a predicted contact: cost of giving up a lane change under way


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
    each: bool  # the best known of its own root action instead, so that every one is searched


class Ply(NamedTuple):
    """What came of one action: the ego and the traffic around it at its end, and its costs."""

    state: State
    near: Neighbours
    safety: float
    comfort: float
    passability: float
    other: float
    end: int  # ALIVE, LOST, ARRIVED
    loss: float  # where LOST


class Driven(NamedTuple):
    """What came of M sequences, step by step; nothing beyond the steps that were driven."""

    node: Indices  # [M, S] lane of the front
    motion: Floats  # [M, S, 2] DRIVEN_S, DRIVEN_V
    pose: Floats  # [M, S, 4]
    terms: Floats  # [M, 5] SAFETY .. LOSS
    steps: Indices  # [M] how many were driven
    # [M] ALIVE after the whole sequence, LOST, ARRIVED, or IMPOSSIBLE where a lane change cannot
    # begin
    end: Indices
    moving: Floats  # [R, 2] scratch for the agents that the search moves


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
    several = step > forecast_dt + 1e-9
    return SearchParams(
        ply=ply,
        check=0 if several else max(1, round(check_s / step)),
        checks_in_step=max(1, round(step / forecast_dt)) if several else 1,
        look_ahead=look_ahead,
        rollout=rollout,
        exploration=exploration,
        horizon=(look_ahead + rollout) * ply * step,
        adaptive=adaptive,
        each=False,
    )


@inlined
def simulate(
    local: LocalMap, p: EgoParams, c: CostParams, q: SearchParams, state: State, others: Floats,
    near: Neighbours, action: Action, at: int,
) -> Ply:  # fmt: skip
    """One action from simulation step `at` on, for q.ply steps, with checks against the forecast.

    `others` [R, 2], the reacting agents, move (see model/reactions.py). The costs are those of
    equation 1 of the paper, summed over the steps.
    """
    safety, comfort, passability, other = 0.0, 0.0, 0.0, 0.0
    every = p.step * q.check if q.check > 0 else p.step / q.checks_in_step
    gap, leader_v, followers = near.gap, near.leader_v, near.followers
    for k in range(q.ply):
        time = (at + k) * p.step
        accel = action.accel
        if accel == FOLLOW:
            accel = follow_accel(p, state.v, local.node[state.node, LIMIT], gap, leader_v)
        before = state
        state, event = (
            advance(local, p, state, accel, time)
            if action.speed == NO_SPEED
            else obey(local, p, state, action.speed, time)
        )
        comfort += step_comfort(p, c, before, state)
        passability += step_passability(local, p, c, state)
        if event in (RED_LINE, OFF_END, GOAL):
            near = Neighbours(gap, leader_v, followers)
            if event == GOAL:
                return Ply(state, near, safety, comfort, passability, other, ARRIVED, 0.0)
            last = before if event == OFF_END else state
            loss = contact_cost(c, last, time, q.horizon)
            loss += c.red if event == RED_LINE else 0.0
            passability += after_contact(local, c, last, time, q.horizon)
            return Ply(state, near, safety, comfort, passability, other, LOST, loss)
        gap += (leader_v - state.v) * p.step
        other += step_own(c.term, local, p, c, before, state, gap, time + p.step)
        checks = q.checks_in_step if q.check == 0 else (1 if (at + k + 1) % q.check == 0 else 0)
        for r in range(checks):
            share = (r + 1.0) / checks
            there = within_step(local, p, before, state, share)
            moment = time + share * p.step
            t = index_at(local, moment)
            if others.shape[0] > 0:
                safety += c.imposed * react(local, p, there, others, t, every) * every
            meeting = meet(local, p, c, there, others, followers, t)
            gap, leader_v, followers = meeting.near
            safety += meeting.rate * every + meeting.once
            if meeting.contact:
                loss = contact_cost(c, state, moment, q.horizon)
                passability += after_contact(local, c, state, moment, q.horizon)
                return Ply(state, meeting.near, safety, comfort, passability, other, LOST, loss)
    near = Neighbours(gap, leader_v, followers)
    return Ply(state, near, safety, comfort, passability, other, ALIVE, 0.0)


@kernel
def for_steps(q: SearchParams, steps: int) -> SearchParams:
    """The same search with actions of so many steps."""
    return SearchParams(
        steps, q.check, q.checks_in_step, q.look_ahead, q.rollout, q.exploration, q.horizon,
        False, False,
    )  # fmt: skip


@kernel
def copy_pairs(source: Floats, target: Floats) -> None:
    """Copy the reacting agents [R, 2]: assigning slices would need an array in between."""
    for r in range(source.shape[0]):
        target[r, CLOCK], target[r, SPEED] = source[r, CLOCK], source[r, SPEED]


@kernel
def needed_side(local: LocalMap, state: State) -> int:
    """The side of the lane change that the route needs next: -1, 0, 1."""
    urgency = urgency_at(local, state)
    return 0 if urgency == 0.0 else (1 if urgency > 0.0 else -1)


@kernel
def may_change(
    local: LocalMap,
    p: EgoParams,
    c: CostParams,
    state: State,
    others: Floats,
    side: int,
    accel: float,
    time: float,
    most: float = math.inf,
) -> bool:
    """Whether a lane change may begin at `time`, s from now, with `accel`, m/s2 or FOLLOW.

    It may where the road allows it, and where taking the place costs at `most` that much.

    SUMO moves a standing vehicle to the side; no car does. So a slow ego has to drive off for it,
    but where its lane ends and SUMO holds it.
    """
    if state.progress > 0.0:  # back to where the ego came from, now or never
        return time <= 0.0 and can_change(local, p, state, side)
    if state.v < ROLLING and accel <= 0.0 and not leads_nowhere(local, state.node):
        return False
    if not can_change(local, p, state, side):
        return False
    changed = begin_change(local, p, state, side)
    if time > OVERTAKES_SOON and local.node[changed.other, HOME] >= 0.0:
        return False
    return place_is_free(local, p, c, changed, others, index_at(local, time), most)


@kernel
def change_price(c: CostParams, state: State) -> float:
    """C_o,lc of a lane change that begins in this state, or of giving up the one under way, which
    nothing but a danger is worth."""
    return c.lane_change if state.progress <= 0.0 else GIVES_UP * c.contact


@entry
def replay(
    local: LocalMap, p: EgoParams, c: CostParams, q: SearchParams, root: State, others: Floats,
    lines: Lines, driven: Driven,
) -> None:  # fmt: skip
    """Drive `lines` of an action for each step, each from `root` and the reacting agents `others`
    [R, 2] on, and record every step in `driven`."""
    for m in range(len(lines.steps)):
        copy_pairs(others, driven.moving)
        driven.steps[m], driven.end[m] = _driven_again(local, p, c, q, root, lines, driven, m)


@kernel
def _driven_again(
    local: LocalMap, p: EgoParams, c: CostParams, q: SearchParams, root: State, lines: Lines,
    driven: Driven, m: int,
) -> tuple[int, int]:  # fmt: skip
    """Drive sequence m; the number of its steps, and its end."""
    line, others, terms = lines.actions[m], driven.moving, driven.terms[m]
    lanes, motion, pose = driven.node[m], driven.motion[m], driven.pose[m]
    near = meet(local, p, c, root, others, local.followers, 0).near
    state, one = root, for_steps(q, 1)
    for at in range(lines.steps[m]):
        action = action_at(line, at)
        if action.side != 0:
            if not may_change(
                local, p, c, state, others, action.side, action.accel, at * p.step, math.inf
            ):
                return at, IMPOSSIBLE
            terms[OTHER] += change_price(c, state)
            state = begin_change(local, p, state, action.side)
        ply = simulate(local, p, c, one, state, others, near, action, at)
        state, near = ply.state, ply.near
        terms[SAFETY] += ply.safety
        terms[COMFORT] += ply.comfort
        terms[PASSABILITY] += ply.passability
        terms[OTHER] += ply.other
        terms[LOSS] += ply.loss
        lanes[at] = state.node
        motion[at, DRIVEN_S], motion[at, DRIVEN_V] = state.s, state.v
        pose[at, X], pose[at, Y], pose[at, COS], pose[at, SIN] = pose_of(local, p, state)
        if ply.end != ALIVE:
            return at + 1, ply.end
    if (lines.steps[m] + 0.5) * p.step > q.horizon:
        terms[PASSABILITY] += terminal(local, c, state, near.gap, near.leader_v, q.horizon)
        terms[PASSABILITY] += unfinished(local, p, c, state, q.horizon)
    return lines.steps[m], ALIVE
