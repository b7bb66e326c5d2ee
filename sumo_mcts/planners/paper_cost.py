"""The cost J of the paper's planner, term by term, as printed and in the other forms that its text
names. Compiled. The formulas stand in docs/planner.md.

Costs are those of one ply, weighted, at its end, as the sum of equation 1 counts them.
"""

import math
from typing import NamedTuple

from sumo_mcts.arrays import Bools, Floats
from sumo_mcts.model.gaps import gap_ahead
from sumo_mcts.model.local_map import (
    HALF_LENGTH,
    HALF_WIDTH,
    LocalMap,
    S,
    State,
    V,
    drawn_share,
    follows,
    index_at,
    is_gone,
    node_of,
    on_other_level,
)
from sumo_mcts.model.motion import EgoParams, pose_of, towards_other
from sumo_mcts.model.route import INTERNAL, LENGTH, LIMIT, NEXT, STATION
from sumo_mcts.numerics.drawn import as_drawn
from sumo_mcts.numerics.geometry import COS, SIN, Box, X, Y, box_distance
from sumo_mcts.numerics.kernel import kernel
from sumo_mcts.scene import STANDING

SIGHT = 40.0  # m beyond which agents are ignored
NEAREST = 0.1  # m: no distance counts as less
HIGHWAY = 22.2  # m/s: from this limit on a road is a highway, 80 km/h
AT_LINE = 3.0  # m before a stop sign within which the ego stands at it
SLOW_SHARE = 0.5  # of the limit: who is slower is bypassed by a lane change


class Weights(NamedTuple):
    """What the compiled code reads of the scenario; see config.PaperConfig. Times are in steps of
    the simulation."""

    ply: int
    check: int
    look_ahead: int
    rollout: int
    skips: bool  # a pass whose expansion finds a collision ends there
    by_root: bool  # N of the UCB equation counts the visits of the root
    dead_end_free: bool  # where every child was discarded, 0 is backed up
    last_alone: bool  # J is that of the last step
    aligned: bool  # contact is between boxes parallel to the axes
    exploration: float
    brake_probability: float
    accelerate_probability: float
    safety: float
    comfort: float
    passability: float
    other: float
    threshold: float
    highway_threshold: float
    closing: float  # m/s of approach that double C_s; inf: only the distance counts
    contact: float
    jerk_factor: float
    lateral_factor: float
    goal_factor: float
    straight: bool  # the distance to the local goal is the straight line
    junction_penalty: float
    lane_change: float
    bypass: float
    stop: float
    stop_sign: float
    turn: float
    emergency: float


class Guide(NamedTuple):
    """The inputs of the costs that come from the route. W nodes of the route."""

    goal: float  # where the local goal lies, m from the start of the route
    goal_x: float  # and in the world
    goal_y: float
    aside: Floats  # [W] m that the lane changes still needed there add to the local goal's distance
    turns: Bools  # [W] turns left or right at a junction
    signs: Bools  # [W] lanes that end at a stop sign


@kernel
def nearest(
    local: LocalMap, p: EgoParams, state: State, time: float, aligned: bool
) -> tuple[float, float]:
    """Distance between the boxes of the ego and of the nearest agent, m, 0 at contact; and how fast
    the two approach each other, m/s, at least 0.

    `aligned`: between the smallest boxes around them that are parallel to the axes.
    """
    x, y, c, s = pose_of(local, p, state)
    t = min(index_at(local, time), local.agent.shape[0] - 1)
    distance, closing = math.inf, 0.0
    for i in range(local.agent.shape[1]):
        if (
            is_gone(local, t, i)
            or follows(local, local.followers, i)
            or on_other_level(local, state.node, state.s, 2.0 * p.half_length, t, i)
        ):
            continue
        row, trait = local.agent[t, i], local.trait[i]
        if abs(row[X] - x) < SIGHT and abs(row[Y] - y) < SIGHT:
            other = Box(row[X], row[Y], row[COS], row[SIN], trait[HALF_LENGTH], trait[HALF_WIDTH])
            own = Box(x, y, c, s, p.half_length, p.half_width)
            if local.drawn.shape[0] > 0:
                own = as_drawn(own, drawn_share(local, state.node, state.s), p.half_length)
                other = as_drawn(other, local.drawn[t, i], trait[HALF_LENGTH])
            if aligned:
                own, other = _upright(own), _upright(other)
            found = box_distance(own, other)
            if found < distance:
                distance = found
                dx, dy = row[X] - x, row[Y] - y
                apart = max(math.sqrt(dx * dx + dy * dy), NEAREST)
                vx, vy = state.v * c - row[V] * row[COS], state.v * s - row[V] * row[SIN]
                closing = max(0.0, (dx * vx + dy * vy) / apart)
    return distance, closing


@kernel
def _upright(box: Box) -> Box:
    """The smallest box around it that is parallel to the axes."""
    c, s = abs(box.cos), abs(box.sin)
    length = box.half_length * c + box.half_width * s
    width = box.half_length * s + box.half_width * c
    return Box(box.x, box.y, 1.0, 0.0, length, width)


@kernel
def safety(local: LocalMap, p: EgoParams, w: Weights, state: State, time: float) -> float:
    """C_s: 1/d up to the threshold; with relative velocity, larger by the share of it in
    `closing`."""
    distance, closing = nearest(local, p, state, time, False)
    on_highway = local.node[state.node, LIMIT] >= HIGHWAY
    if distance > (w.highway_threshold if on_highway else w.threshold):
        return 0.0
    return w.safety * (1.0 + closing / w.closing) / max(distance, NEAREST)


@kernel
def comfort(local: LocalMap, p: EgoParams, w: Weights, began: State, state: State) -> float:
    """C_c = k j^2, and k_lat a_lat^2 where that has a factor."""
    seconds = w.ply * p.step
    jerk = (state.a - began.a) / seconds
    cost = w.comfort * w.jerk_factor * jerk * jerk
    if w.lateral_factor > 0.0:
        _, _, c0, s0 = pose_of(local, p, began)
        _, _, c1, s1 = pose_of(local, p, state)
        yaw_rate = math.atan2(c0 * s1 - s0 * c1, c0 * c1 + s0 * s1) / seconds
        lateral = 0.5 * (began.v + state.v) * yaw_rate
        cost += w.comfort * w.lateral_factor * lateral * lateral
    return cost


@kernel
def passability(local: LocalMap, p: EgoParams, w: Weights, guide: Guide, state: State) -> float:
    """C_p1, the distance to the local goal, and C_p2, the penalty of a junction not yet passed."""
    if w.straight:
        x, y, _, _ = pose_of(local, p, state)
        remaining = math.sqrt((guide.goal_x - x) ** 2 + (guide.goal_y - y) ** 2)
    else:
        remaining = max(0.0, guide.goal - local.node[state.node, STATION] - state.s)
    remaining += _aside(guide, state)
    penalty = w.junction_penalty if _junction_ahead(local, state, guide.goal) else 0.0
    return w.passability * (w.goal_factor * remaining + penalty)


@kernel
def other(
    local: LocalMap, p: EgoParams, w: Weights, guide: Guide, state: State, accel: float
) -> float:
    """C_o of standing, of standing at a stop sign, of turning, and of braking hard."""
    emergency = w.emergency if accel < -p.comfort_decel else 0.0
    stop, node = 0.0, state.node
    if state.v < STANDING:
        at_sign = guide.signs[node] and local.node[node, LENGTH] - state.s < AT_LINE
        stop = w.stop + (w.stop_sign if at_sign else 0.0)
    return w.other * (stop + (w.turn if guide.turns[node] else 0.0) + emergency)


@kernel
def lane_change(local: LocalMap, w: Weights, state: State, time: float) -> float:
    """C_o,lc of a lane change that begins in this state, and what it costs more as a bypass."""
    cost = w.lane_change
    if w.bypass > 0.0 and _slow_ahead(local, state, time):
        cost += w.bypass
    return w.other * cost


@kernel
def _slow_ahead(local: LocalMap, state: State, time: float) -> bool:
    """Whether somebody in the ego's lane ahead, in sight, stands or is slow."""
    slow = SLOW_SHARE * local.node[state.node, LIMIT]
    t = min(index_at(local, time), local.agent.shape[0] - 1)
    for i in range(local.agent.shape[1]):
        node = node_of(local, t, i)
        if node >= 0 and local.agent[t, i, V] < slow:
            gap = gap_ahead(local, state, node, local.agent[t, i, S])
            if 0.0 < gap < SIGHT:
                return True
    return False


@kernel
def _aside(guide: Guide, state: State) -> float:
    """m that lane changes add to the distance to the local goal. A change under way counts for what
    is left of it."""
    here = guide.aside[state.node]
    if state.progress <= 0.0 or state.other < 0:
        return float(here)
    return float(here + towards_other(state) * (guide.aside[state.other] - here))


@kernel
def _junction_ahead(local: LocalMap, state: State, goal: float) -> bool:
    """Whether a junction lies between the state and the local goal."""
    node, distance = state.node, goal - local.node[state.node, STATION]
    while node >= 0 and distance > 0.0:
        if local.node[node, INTERNAL] > 0.0:
            return True
        distance -= local.node[node, LENGTH]
        node = int(local.node[node, NEXT])
    return False
