"""Where a driver stops or lets others pass: red lights, stop signs, ends of lanes, right of way."""

import math

from sumo_mcts.arrays import Bools, Floats
from sumo_mcts.numerics.kernel import inlined, kernel
from sumo_mcts.numerics.krauss import STANDSTILL, USUAL_S, safe_gap, safe_speed
from sumo_mcts.prediction.conflicts import (
    FOE_BEGIN,
    FOE_END,
    IN_TURN,
    MERGES,
    MUTUAL,
    OWN_BEGIN,
    OWN_END,
)
from sumo_mcts.prediction.course import Course, red_ahead, to_sign, waiting_place
from sumo_mcts.prediction.drivers import Drivers, Progress, TrafficParams
from sumo_mcts.prediction.following import follow_accel
from sumo_mcts.road import JUMP
from sumo_mcts.scene import FORCES

# Stopping.
BEFORE = 1.0  # m before a line at which a driver stops
CLOSER = 0.5  # m less where it waits for others: SUMO's drivers do so 0.1 m before the line
# m/s2 beyond which no driver stops for a red light or a foe with the right of way: a little more
# than drivers brake with
STOPS = 5.0
AT_SIGN = 9.0  # m/s2, the same at a stop sign and the end of a lane, where every driver stops
RED_VIEW = 80.0  # m before a red light from which on a driver brakes for it

# Stop signs.
INSIDE = -1e9  # Progress.rank of a vehicle that is inside a junction now: before all others
ENTERS = -1e6  # this is added to the rank of one that enters it later, which stays in its turn
AT_LINE = 4.0  # m before a stop sign within which standing counts
SLOW = 0.5  # m/s below which a vehicle at a stop sign counts as standing

# Right of way.
OWN_VIEW = 60.0  # m before a shared stretch from which on a driver yields
FOE_VIEW = 90.0  # m before it within which a foe matters
WAITS = 0.3  # m/s below which a foe waits itself

# Merging one by one, as SUMO's drivers do at a zipper (its MSLink::getZipperSpeed).
MERGE_VIEW = 100.0  # m before the stretch from which on a driver makes room
AT_ONCE = 4.5  # m/s by which one that is behind can slow down within the second that it has
# Of the safe gap, what they make. With all of it forecasts of the one behind are 3 m short after
# 4 s, with this 1.5 m.
ROOM = 0.5


@kernel
def halt_accel(q: TrafficParams, v: float, distance: float, most: float) -> float:
    """Acceleration that stops `distance` m ahead, at the last moment, m/s2; inf where that takes
    more than `most` m/s2.

    It leads to the safe speed of a driver with a step to react in: fitted to SUMO's drivers.
    """
    if v * v > 2.0 * most * max(distance, 0.1):
        return math.inf
    return max((safe_speed(max(distance - BEFORE, 0.0), 0.0, q.step) - v) / q.step, -most)


@kernel
def line_accel(
    q: TrafficParams, c: Course, i: int, k: int, t: int, x: float, v: float, rank: float
) -> float:
    """Acceleration for red lights, stop signs and the end of the lane ahead of vehicle i, m/s2.

    It is on the k-th lane of its path at the t-th time. inf: nothing to stop for.
    """
    a = math.inf
    for m in range(k + 1, c.lanes[i]):
        distance = c.offset[i, m] - x
        if distance > RED_VIEW:
            break
        if c.red[i, m, t]:
            a = halt_accel(q, v, distance, STOPS)
            break
    if math.isinf(rank):
        a = min(a, halt_accel(q, v, to_sign(c, i, k, x), AT_SIGN))
    if not math.isinf(c.end[i]):
        a = min(a, halt_accel(q, v, c.end[i] - x, AT_SIGN))
    return a


@kernel
def rank_of(
    c: Course, d: Drivers, i: int, k: int, rank: float, x: float, v: float, now: float
) -> float:
    """The time (s from now, negative: ago) since when vehicle i has its turn at the stop sign
    ahead; inf before it has stood; in a junction see INSIDE and ENTERS.

    `rank`: the same one time before; `now`: s.
    """
    if c.lanes[i] == 0:
        return math.inf
    if c.internal[i, k]:
        if rank < 0.5 * ENTERS:
            return rank
        return INSIDE if now == 0.0 else ENTERS + min(rank, now)
    if rank < 0.5 * ENTERS:
        return math.inf
    stood = d.stood[i] if now == 0.0 else math.inf
    if math.isinf(rank) and (v < SLOW or not math.isinf(stood)) and to_sign(c, i, k, x) < AT_LINE:
        return min(stood, now)
    return rank


@inlined
def yield_accel(
    q: TrafficParams,
    c: Course,
    d: Drivers,
    polite: Bools,
    progress: Progress,
    x: Floats,
    v: Floats,
    i: int,
    t: int,
) -> float:
    """Acceleration of vehicle i for foes with the right of way, m/s2; inf: there are none.

    It stops before the stretch that both use, or falls in behind a foe that merges first.

    `polite` [N]: set where it lets the ego pass.
    """
    a = math.inf
    for u in range(c.foe.shape[1]):
        j = c.foe[i, u]
        if j < 0:
            break
        to_begin, to_end = c.place[i, u, OWN_BEGIN] - x[i], c.place[i, u, OWN_END] - x[i]
        foe_begin, foe_end = c.place[i, u, FOE_BEGIN] - x[j], c.place[i, u, FOE_END] - x[j]
        if (
            to_begin < 0.0
            or to_begin > (MERGE_VIEW if c.kind[i, u] == MERGES else OWN_VIEW)
            or foe_end + d.length[j] < 0.0
            or foe_begin > FOE_VIEW
        ):
            continue
        if c.kind[i, u] == MERGES:
            own, its = c.limit[i, progress.at[i]], c.limit[j, progress.at[j]]
            room = _merge_accel(q, to_end, v[i], own, foe_end, v[j], its, d.length[j])
            polite[i] = polite[i] or (j == 0 and not math.isinf(room))
            a = min(a, room)
            continue
        if j == 0 and d.does[i] == FORCES:
            continue
        if not _comes_first(q, c, d, progress, x, v, i, u, t):
            continue
        wait = waiting_place(c, i, progress.at[i], c.place[i, u, OWN_BEGIN])
        stop = halt_accel(q, v[i], wait - x[i] + CLOSER, STOPS)
        if math.isinf(stop):
            continue
        if j == 0:
            stands_first = (
                math.isinf(progress.rank[i]) and to_sign(c, i, progress.at[i], x[i]) < to_begin
            )
            # where it would jump over the junction it stops at the line, as late as for red
            at_line = to_end - to_begin < 2.0 * JUMP
            trend = d.trend[i] if t == 0 else 0.0
            if (
                not polite[i]
                and not stands_first
                and not at_line
                and not _stops(q, v[i], trend, to_begin)
            ):
                continue  # do not count on it
            polite[i] = True
        a = min(a, stop)
    return a


@kernel
def _stops(q: TrafficParams, v: float, trend: float, distance: float) -> bool:
    """Whether a driver is counted on to stop within `distance` m, where it lets the ego pass: it
    can do so in comfort now, or its smoothed acceleration `trend` (m/s2) brings it to a stand."""
    in_comfort = v * v <= 2.0 * q.yield_decel * max(distance - 2.0, 0.1)
    return in_comfort or v * v < -2.0 * trend * distance


@kernel
def _merge_accel(
    q: TrafficParams,
    distance: float,
    v: float,
    limit: float,
    foe_distance: float,
    foe_v: float,
    foe_limit: float,
    foe_length: float,
) -> float:
    """Acceleration of a driver that merges with a foe, one by one, m/s2; inf: it goes first.

    `distance` and `foe_distance`: m to the end of the shared stretch. The one behind makes room,
    if a second of braking is enough; else the one that comes later. The room grows evenly until
    the foe is there, and both drive on as fast as they may meanwhile.
    """
    behind = distance - foe_distance
    comes, foe_comes = distance / max(v, 1.0), foe_distance / max(foe_v, 1.0)
    if behind > 0.0:
        first = v - AT_ONCE - foe_v >= behind and comes < foe_comes
    else:
        first = foe_v - AT_ONCE - v < -behind or comes <= foe_comes
    if first:
        return math.inf
    gap = behind - foe_length
    foe_ends = min(foe_limit, math.sqrt(foe_v * foe_v + 2.0 * q.accel * max(foe_distance, 0.0)))
    ends = min(limit, math.sqrt(v * v + 2.0 * q.accel * max(distance, 0.0)))
    seconds = max(2.0 * foe_distance / max(foe_v + foe_ends, 0.2), 1.0)
    grows = 0.5 * (foe_v + foe_ends - v - ends) * seconds
    missing = ROOM * safe_gap(ends, foe_ends, USUAL_S) + STANDSTILL - gap - grows
    makes_room = (ends - v) / seconds - 2.0 * missing / (seconds * seconds)
    return max(follow_accel(q, v, max(gap, 0.5), foe_v, q.accel), makes_room, -STOPS)


@kernel
def _turn_since(rank: float) -> float:
    """The rank of a vehicle, and before it entered a junction."""
    return rank - ENTERS if INSIDE < rank < 0.5 * ENTERS else rank


@kernel
def _comes_first(
    q: TrafficParams,
    c: Course,
    d: Drivers,
    progress: Progress,
    x: Floats,
    v: Floats,
    i: int,
    u: int,
    t: int,
) -> bool:
    """Whether vehicle i has to let the foe of its u-th conflict pass now."""
    j, kind, rank = c.foe[i, u], c.kind[i, u], progress.rank
    begin, foe_begin = c.place[i, u, OWN_BEGIN] - x[i], c.place[i, u, FOE_BEGIN] - x[j]
    theirs = max(foe_begin, 0.0) / max(v[j], 1.0)
    if kind == MUTUAL or (kind == IN_TURN and rank[i] == INSIDE == rank[j]):
        mine = max(begin, 0.0) / max(v[i], 1.0)
        if mine < theirs or (mine == theirs and d.turn[i] < d.turn[j]):
            return False
    elif kind == IN_TURN:
        since, foe_since = _turn_since(rank[i]), _turn_since(rank[j])
        if since < foe_since or (since == foe_since and d.turn[i] < d.turn[j]):
            return False
        if INSIDE < foe_since == rank[j] < math.inf and not (d.stays[j] and v[j] < WAITS):
            return True  # at its line: it sets off in its turn, however slow it is now
    if v[j] < WAITS and foe_begin > 1.0 and kind != IN_TURN:
        return False
    leaves = (c.place[i, u, OWN_END] - x[i] + d.length[i]) / max(v[i], 3.0)
    return bool(theirs <= leaves + q.yield_gap) and not red_ahead(
        c, j, progress.at[j], t, c.place[i, u, FOE_BEGIN]
    )
