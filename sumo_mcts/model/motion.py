"""How the ego moves under an action: with the steps, bounds and rounding of world/command.py, which
plays profiles into SUMO. It stops before closed lines (red, yellow, stop signs) while it can."""

import math
from typing import NamedTuple

from sumo_mcts.arrays import Floats
from sumo_mcts.model.caps import SPACING
from sumo_mcts.model.halts import LINE_BEYOND
from sumo_mcts.model.local_map import LocalMap, State, index_at
from sumo_mcts.model.route import (
    CAP,
    FIRST_ROW,
    HALT_LINE,
    LAST_ROW,
    LEFT_NODE,
    LENGTH,
    NEXT,
    REACH,
    RIGHT_NODE,
    STOP_LINE,
    lane_pose,
)
from sumo_mcts.numerics.geometry import swung
from sumo_mcts.numerics.kernel import inlined, kernel
from sumo_mcts.scene import STANDING

LOOK_AHEAD = 0.5  # s over which the speed adapts to what the road allows; a longer step is one
FREE, RED_LINE, GOAL, OFF_END = range(4)
SHORT_OF = 0.01  # m that a stop has to be short of a closed line
EASES = 0.65  # share of the distance to the place of a stop that braking may take when it begins
CREEP = 0.5  # 1/s: m/s for each metre to the place to stand, once that is nearer than one look
HELD = 2.0  # m/s up to which running into the end of a lane is as good as stopping at it
OVERSHOOT = 0.16  # of a lane change: how far SUMO still goes on aside when it is given up
BEGUN = 1e-12  # progress of a lane change that is about to begin
# progress right after a lane change without a duration: in that step SUMO has looked for collisions
# in the old lane
JUMPED = 1.0 - 1e-6
UNTURNED = 0.003  # rad of turn that cannot be seen
# progress beyond which the new lane counts; at half time itself SUMO's rounding decides
HALF = 0.5 + 1e-9


class EgoParams(NamedTuple):
    """Bounds of the ego's motion; SI units, decelerations positive."""

    step: float  # s, SUMO's
    ballistic: bool  # SUMO's integration: False Euler, True ballistic
    jerk: float
    emergency_jerk: float
    comfort_decel: float
    max_decel: float
    max_accel: float
    approach_decel: float
    stop_gap: float
    change_duration: float  # s, 0: SUMO jumps
    headway: float  # s, car following
    gap: float  # m, car following
    half_length: float
    half_width: float


@inlined
def advance(
    local: LocalMap, p: EgoParams, state: State, accel: float, time: float
) -> tuple[State, int]:
    """One step of the simulation towards an acceleration (m/s2), from `time` (s from now) on.

    Returns the new state and an event: FREE, RED_LINE (crossed a closed stop line), GOAL (beyond
    the end of the route) or OFF_END (at the end of a lane that leads nowhere).
    """
    v, look = state.v, max(LOOK_AHEAD, p.step)
    line, place = _to_line(local, p, state, time)
    ahead = _cap(local, state.node, state.s + v * look)
    allowed = (ahead - v) / look if ahead >= 0.0 or p.step < LOOK_AHEAD else math.inf
    if place < math.inf:
        allowed = min(allowed, _towards_place(p, v, state.a, place))
    else:
        allowed = min(allowed, _towards_line(p, v, line, look))
    speed = _next_speed(p, v, state.a, min(accel, allowed))
    slowest = _next_speed(p, v, state.a, -p.max_decel)
    bound = _cap(local, state.node, state.s + _moved(p, v, speed))
    if place < math.inf:
        bound = min(bound, _speed_to_stand(p, v, place))
    speed = min(speed, max(bound, slowest))
    if (
        line < math.inf
        and not _stops(p, speed, (speed - v) / p.step, line - _moved(p, v, speed) - SHORT_OF)
        and _stops(p, v, state.a, line)
    ):
        speed = slowest  # the last moment at which braking helps
    return _move(local, p, state, _moved(p, v, speed), speed, (speed - v) / p.step, time + p.step)


@kernel
def obey(
    local: LocalMap, p: EgoParams, state: State, wanted: float, time: float
) -> tuple[State, int]:
    """One step of the simulation at a commanded speed (m/s), whatever the road allows, within what
    world/command.py lets through."""
    low = min(max(state.a - p.emergency_jerk * p.step, -p.max_decel), p.max_accel)
    high = max(min(state.a + p.emergency_jerk * p.step, p.max_accel), low)
    speed = max(0.0, min(max(wanted, state.v + low * p.step), state.v + high * p.step))
    return _move(
        local, p, state, _moved(p, state.v, speed), speed, (speed - state.v) / p.step, time + p.step
    )


@kernel
def _next_speed(p: EgoParams, v: float, a: float, wanted: float) -> float:
    """Towards the wanted acceleration, as far as the bounds of acceleration and jerk allow within
    one step, m/s."""
    wanted = min(max(wanted, -p.max_decel), p.max_accel)
    jerk = p.emergency_jerk if min(wanted, a) < -p.comfort_decel else p.jerk
    return max(0.0, v + min(max(wanted, a - jerk * p.step), a + jerk * p.step) * p.step)


@kernel
def _towards_place(p: EgoParams, v: float, a: float, distance: float) -> float:
    """The acceleration with which the ego comes to a stand at the place of a stop, `distance` m
    ahead.

    It brakes as soon as coming to a stand from now on would take EASES of the distance, gently at
    first, and with comfort_decel where it takes all of it: it is slow where that costs least time.
    """
    shorter = 0.0 if p.ballistic else 0.5 * v * p.step
    share = _to_stand(p, v, a) / max(distance + shorter, SHORT_OF)
    return p.comfort_decel * max((EASES - share) / (1.0 - EASES), -1.0)


@kernel
def _to_stand(p: EgoParams, v: float, a: float) -> float:
    """m to a stand by braking with comfort_decel, which the ordinary jerk leads to."""
    rises = max(a + p.comfort_decel, 0.0) / p.jerk  # s
    left = v + (a - 0.5 * p.jerk * rises) * rises
    if left < 0.0:  # it stands before
        rises, left = (a + math.sqrt(a * a + 2.0 * p.jerk * v)) / p.jerk, 0.0
    driven = (v + (0.5 * a - p.jerk * rises / 6.0) * rises) * rises
    return driven + left * left / (2.0 * p.comfort_decel)


@kernel
def _speed_to_stand(p: EgoParams, v: float, distance: float) -> float:
    """The highest speed after the coming step from which the ego, braking with comfort_decel in
    whole steps, stands right at a place `distance` m ahead."""
    once = p.comfort_decel * p.step  # m/s of braking in a step
    steps = max(distance - (0.5 * v * p.step if p.ballistic else 0.0), 0.0) / p.step
    # n steps after the coming one: its speed u drives u + (u - once) + ... + (u - n once) = steps
    n = math.floor(0.5 * (math.sqrt(1.0 + 8.0 * steps / once) - 1.0))
    return steps / (n + 1.0) + 0.5 * n * once


@kernel
def _stops(p: EgoParams, v: float, a: float, distance: float) -> bool:
    """Whether the strongest braking leads to a stand within the distance (m)."""
    rising = max(a, 0.0)
    jerk = p.emergency_jerk if p.max_decel > p.comfort_decel else p.jerk
    top = v + rising * (rising / (2.0 * jerk) + p.step)
    braking = top * top / (2.0 * p.max_decel)
    if braking + top * ((p.max_decel + rising) / jerk + 2.0 * p.step) < distance:
        return True  # with room to spare
    while v > 0.0:
        speed = _next_speed(p, v, a, -p.max_decel)
        distance -= _moved(p, v, speed)
        v, a = speed, (speed - v) / p.step
    return distance >= 0.0


@kernel
def _moved(p: EgoParams, v: float, speed: float) -> float:
    """How far one step leads whose speed changes from v to `speed`, m."""
    return 0.5 * (v + speed) * p.step if p.ballistic else speed * p.step


@inlined
def _move(
    local: LocalMap, p: EgoParams, state: State, moved: float, speed: float, a: float, time: float
) -> tuple[State, int]:
    """Along the lane and into the next ones; a lane change goes on."""
    node, other, s, progress, event = state.node, state.other, state.s + moved, state.progress, FREE
    while s > local.node[node, LENGTH]:
        if _must_stop(local, p, node, state, local.node[node, LENGTH] - s, time):
            event = RED_LINE
        follow = int(local.node[node, NEXT])
        if follow < 0:
            if math.isinf(local.node[node, REACH]):
                event = GOAL if event == FREE else event
                return State(node, local.node[node, LENGTH], speed, a, 0.0, -1, 0.0), event
            event = OFF_END if speed > HELD else event
            # SUMO holds a vehicle at the end of a lane that leads nowhere
            moved, s, speed, a = 0.0, local.node[node, LENGTH], 0.0, 0.0
            break
        s -= local.node[node, LENGTH]
        node = follow
        if other >= 0:
            other = int(local.node[other, NEXT])
        if other < 0 or other == node:
            other, progress = -1, 0.0
    if progress > 0.0:
        before = progress
        progress += p.step / p.change_duration if p.change_duration > 0.0 else JUMPED
        if before <= HALF < progress and other >= 0:
            node, other = other, node
        if progress >= 1.0 - 1e-9:
            progress, other = 0.0, -1
    return State(node, s, speed, a, progress, other, _turned(local, p, state, moved)), event


@kernel
def within_step(local: LocalMap, p: EgoParams, before: State, after: State, share: float) -> State:
    """The front after a share of the step from `before` to `after`, driven at the speed of `after`.
    It is in the lane of `before` up to its end."""
    if share >= 1.0:
        return after
    moved = _moved(p, before.v, after.v)
    s = after.s - (1.0 - share) * moved
    if s >= 0.0:
        return State(after.node, s, after.v, after.a, after.progress, after.other, after.turn)
    node, s = before.node, before.s + share * moved
    while s > local.node[node, LENGTH] and local.node[node, NEXT] >= 0.0:
        s -= local.node[node, LENGTH]
        node = int(local.node[node, NEXT])
    if node != before.node:
        return State(node, s, after.v, after.a, 0.0, -1, before.turn)
    return State(node, s, after.v, after.a, before.progress, before.other, before.turn)


@kernel
def can_change(local: LocalMap, p: EgoParams, state: State, side: int) -> bool:
    """Whether a change to the left (+1) or right (-1) may begin: there is a lane, and it is long
    enough for the change. One that has not come half way may be given up where SUMO divides lanes:
    that is a change to the other side."""
    if state.progress > 0.0:
        return not math.isinf(local.seen_within) and goes_back(local.node, state, side)
    target = int(local.node[state.node, LEFT_NODE if side > 0 else RIGHT_NODE])
    # at the end of a lane that leads nowhere it is held until it is in the other
    if state.v < STANDING and local.node[state.node, NEXT] < 0:
        return target >= 0
    # SUMO moves a vehicle along its old lane first and changes lanes at the end of the step
    needed = max(state.v * 0.5 * p.change_duration, (state.v + p.max_accel * p.step) * p.step) + 0.5
    return target >= 0 and state.s + needed < local.node[state.node, LENGTH]


@kernel
def goes_back(table: Floats, state: State, side: int) -> bool:
    """Whether moving to the left (+1) or right (-1) leads back from a change that turns round
    before it has come half way; `table` as in RouteMap."""
    if state.other < 0 or not 0.0 < state.progress < HALF - OVERSHOOT:
        return False
    return state.other == int(table[state.node, RIGHT_NODE if side > 0 else LEFT_NODE])


@kernel
def begin_change(local: LocalMap, p: EgoParams, state: State, side: int) -> State:
    """The state right after a change was begun, or one under way was given up; without a duration
    SUMO jumps at the end of the step."""
    if state.progress > 0.0:
        # as one to this lane from the other that has come so much further
        back = 1.0 - (state.progress + OVERSHOOT)
        return State(state.node, state.s, state.v, state.a, back, state.other, state.turn)
    target = int(local.node[state.node, LEFT_NODE if side > 0 else RIGHT_NODE])
    return State(state.node, state.s, state.v, state.a, BEGUN, target, state.turn)


@kernel
def towards_other(state: State) -> float:
    """Where the ego's front is between its lane (0) and the other one of its lane change (1)."""
    return state.progress if state.progress <= HALF else 1.0 - state.progress


@kernel
def pose_of(local: LocalMap, p: EgoParams, state: State) -> tuple[float, float, float, float]:
    """Centre x, y, cos and sin of the heading of the ego's box."""
    x, y, c, n = lane_pose(local.node, local.row, state.node, state.s)
    if state.progress > 0.0 and state.other >= 0:
        left = towards_other(state) * to_the_left(local, state.node, state.other, state.s)
        x, y = x - left * n, y + left * c
    if state.turn == 0.0:
        return x, y, c, n
    ct, nt = math.cos(state.turn), math.sin(state.turn)
    cosine, sine = c * ct - n * nt, n * ct + c * nt
    return x + p.half_length * (c - cosine), y + p.half_length * (n - sine), cosine, sine


@kernel
def _turned(local: LocalMap, p: EgoParams, before: State, moved: float) -> float:
    """The turn after a step from the state `before` that leads `moved` metres on."""
    left = 0.0
    if before.progress > 0.0 and before.other >= 0 and p.change_duration > 0.0:
        other = to_the_left(local, before.node, before.other, before.s)
        left = (other if before.progress <= HALF else -other) * min(
            p.step / p.change_duration, 1.0 - before.progress
        )
    elif abs(before.turn) < UNTURNED:
        return 0.0
    return swung(before.turn, moved, left, 2.0 * p.half_length)


@kernel
def to_the_left(local: LocalMap, node: int, other: int, s: float) -> float:
    """m from a lane to another one beside it, positive to the left."""
    x, y, c, n = lane_pose(local.node, local.row, node, s)
    ox, oy, _, _ = lane_pose(local.node, local.row, other, s)
    return (oy - y) * c - (ox - x) * n


@kernel
def _cap(local: LocalMap, node: int, s: float) -> float:
    """The speed from which everything ahead can be met with approach_decel, m/s."""
    while s > local.node[node, LENGTH] and local.node[node, NEXT] >= 0:
        s -= local.node[node, LENGTH]
        node = int(local.node[node, NEXT])
    first, last = int(local.node[node, FIRST_ROW]), int(local.node[node, LAST_ROW])
    position = s / SPACING
    k = min(int(position), last - first - 1)
    share = min(position - k, 1.0)
    return float(
        local.row[first + k, CAP]
        + share * (local.row[first + k + 1, CAP] - local.row[first + k, CAP])
    )


@kernel
def _to_line(local: LocalMap, p: EgoParams, state: State, time: float) -> tuple[float, float]:
    """m to the next closed stop line, and where that is the one behind the place of a stop, m to
    that place; inf where there is none near enough to matter."""
    node, distance = state.node, -state.s
    limit = state.v * state.v / (2.0 * p.approach_decel) + state.v * (1.0 + p.step) + 10.0
    while node >= 0 and distance < limit:
        distance += local.node[node, LENGTH]
        if _must_stop(local, p, node, state, distance, time):
            halts = local.node[node, STOP_LINE] == HALT_LINE
            return distance, distance - LINE_BEYOND if halts else math.inf
        node = int(local.node[node, NEXT])
    return math.inf, math.inf


@kernel
def _towards_line(p: EgoParams, v: float, distance: float, look: float) -> float:
    """The acceleration with which a closed stop line is met.

    That is with approach_decel, else with comfort_decel, or the even braking that just stops there
    if that is stronger. inf: too late to stop.
    """
    if v * v > 2.0 * p.max_decel * (distance + 0.1):
        return math.inf
    to_stop = distance - p.stop_gap - v * look
    cap = (
        math.sqrt(2.0 * p.approach_decel * to_stop)
        if to_stop > 0.0
        else max(0.0, CREEP * (distance - p.stop_gap))
    )
    # a stop takes less where positions follow the speed at the end of a step
    shorter = 0.0 if p.ballistic else 0.5 * v * p.step
    evenly = v * v / (2.0 * max(distance - p.stop_gap + shorter, 0.1))
    return max((cap - v) / look, -max(evenly, p.comfort_decel))


@kernel
def is_closed(local: LocalMap, node: int, time: float) -> bool:
    """Whether the stop line at the node's end may not be crossed at `time` (s from now)."""
    i = node - local.first
    if i < 0 or i >= local.closed.shape[0] or local.node[node, STOP_LINE] == 0.0:
        return False
    return local.closed[i, min(index_at(local, time), local.closed.shape[1] - 1)] != 0


@kernel
def _must_stop(
    local: LocalMap, p: EgoParams, node: int, state: State, distance: float, time: float
) -> bool:
    """Whether the stop line at the node's end, `distance` m ahead, is to be kept at `time`.

    A yellow light is passed by an ego that it caught too near to stop. How it drove then is
    reckoned from now, with a deceleration of approach_decel at most: it may slow down for a turn,
    and one that brakes for the line is not let go.
    """
    if not is_closed(local, node, time):
        return False
    came, ends = local.yellow[node - local.first, 0], local.yellow[node - local.first, 1]
    if not came - local.dt < time < ends:
        return True
    if time < came:  # closed by rounding to the forecast's times
        return False
    since, slowed = time - came, min(max(-state.a, 0.0), p.approach_decel)
    v = state.v + slowed * since
    return v * v <= 2.0 * local.stop_decel * (distance + 0.5 * (state.v + v) * since)


@kernel
def follow_accel(p: EgoParams, v: float, limit: float, gap: float, leader_v: float) -> float:
    """Car following (Treiber, Hennecke, Helbing 2000): acceleration (m/s2) for a gap (m, inf: free
    road) to a leader at leader_v (m/s)."""
    share = v / max(limit, 0.1)
    # powers would be rounded otherwise without compilation
    free = 1.0 - (share * share) * (share * share)
    if math.isinf(gap):
        return p.max_accel * free
    wish = p.gap + max(
        0.0, v * p.headway + v * (v - leader_v) / (2.0 * math.sqrt(p.max_accel * p.approach_decel))
    )
    close = wish / max(gap, 0.1)
    return p.max_accel * (free - close * close)
