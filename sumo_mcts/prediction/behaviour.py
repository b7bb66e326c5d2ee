"""How the others drive along their paths: car following, red lights, stop signs and right of way,
as SUMO's drivers are seen to do it."""

import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.numerics.kernel import entry, inlined, kernel
from sumo_mcts.numerics.krauss import safe_speed
from sumo_mcts.numerics.signals import signal_states
from sumo_mcts.prediction.paths import IN_TURN, MERGES, MUTUAL, NARROWS, Paths, conflicts_of
from sumo_mcts.scene import (
    ALLWAY,
    BRAKES,
    FORCES,
    GREEN,
    STANDING,
    STARTS,
    STOP,
    Bools,
    Floats,
    Indices,
    Ints,
    RoadMap,
    Signals,
)

INSIDE = -1e9  # rank of whoever is inside a junction
AT_LINE = 4.0  # m before a stop sign within which standing counts
BEFORE = 1.0  # m before a line where somebody stops, as late as possible,
CLOSER = (
    0.5  # m nearer than that where it waits for others: SUMO's drivers do so 0.1 m before the line
)
# m/s2 beyond which nobody stops for red or for who has the right of way: a little more than they
# brake with
STOPS = 5.0
AT_SIGN = 9.0  # m/s2 likewise at a stop sign, and at the end of a lane, where everybody stops
MOST_HABIT = 4.0  # m/s2 that it tells at most
HARD = 4.5  # m/s2 with which an agent is taken to brake where it is taken to brake for no reason


class TrafficParams(NamedTuple):
    """See config.PredictionConfig, for `aside` sensing.aside_m; SI units."""

    step: float
    headway: float
    gap: float
    accel: float
    decel: float
    yield_decel: float
    yield_gap: float
    stays_after: float
    # s after which 1/e is left of what a driver did otherwise than expected; 0: nothing is
    persistence: float
    # half of SUMO's step, s: its positions follow the speed at the end of a step; 0 where it
    # integrates ballistically
    euler: float
    interacting: bool  # False: constant velocity
    # m off the centre line of its lane from which a blinking vehicle has surely begun to leave it
    aside: float


class Drivers(NamedTuple):
    """N drivers; row 0 is the ego."""

    x: Floats  # [N] m from the start of the path
    v: Floats  # [N]
    length: Floats  # [N]
    stays: Bools  # [N] nobody expects it to move: it has stood for a while (why is looked at here)
    cruises: Bools  # [N] keeps its speed on its own account, if nobody is in its way
    # [N] when it came to a stand at the stop sign ahead, s from now (below 0: ago); inf: it has not
    stood: Floats
    trend: Floats  # [N] m/s2, its acceleration of late
    does: Indices  # [N] what it does, as in Intent.does


class _Course(NamedTuple):
    """What lies on the paths of N vehicles, of at most L lanes each."""

    path: Ints  # [N, L] lanes, -1 beyond the end
    offset: Floats  # [N, L+1] where each begins, m from the start of the first
    lanes: Ints  # [N] how many there are
    limit: Floats  # [N, L] m/s
    internal: Bools  # [N, L] inside a junction
    red: Bools  # [N, L, T] the way into it shows red or yellow
    sign: Bools  # [N, L] who enters it has to stand first
    # [N] where the last lane ends and one has to have changed to another; inf: the road goes on, or
    # ends
    end: Floats
    foe: Ints  # [N, F] and so on, as in Conflicts
    kind: Ints
    place: Floats


def drive(
    road: RoadMap,
    signals: Signals,
    paths: Paths,
    drivers: Drivers,
    nominal: Floats,
    params: TrafficParams,
    of_ego: TrafficParams,
    times: int,
) -> tuple[Floats, Floats, Bools]:
    """Positions along the paths [T, N] and speeds [T, N] at T `times`, and which drivers let the
    ego pass [N].

    The ego, row 0, has the speeds `nominal` [K] first, then follows as the others do, with
    parameters `of_ego`.
    """
    xs, vs, polite = (
        np.zeros((times, len(drivers.x))),
        np.zeros((times, len(drivers.x))),
        np.zeros(len(drivers.x), np.bool_),
    )
    xs[0], vs[0] = drivers.x, drivers.v
    if params.interacting:
        course = _course(road, signals, paths, np.arange(times, dtype=np.float64) * params.step)
        _step_all(
            xs,
            vs,
            polite,
            course,
            drivers,
            nominal,
            params,
            of_ego,
            _carried(len(drivers.x)),
            np.full(len(road.lane_ids), -1, np.int32),
        )
    else:
        xs[:] = drivers.x + np.arange(times)[:, None] * params.step * drivers.v
        vs[:] = drivers.v
    return xs, vs, polite


def _course(road: RoadMap, signals: Signals, paths: Paths, grid: Floats) -> _Course:
    red, sign = _red_lights(road, signals, paths, grid), _signs(road, paths)
    end = np.where(
        paths.ends == NARROWS, paths.offset[np.arange(len(paths.count)), paths.count], np.inf
    )
    return _Course(
        paths.lane,
        paths.offset,
        paths.count,
        road.speed[paths.lane],
        road.internal[paths.lane],
        red,
        sign,
        end,
        *conflicts_of(road, paths),
    )


def _red_lights(road: RoadMap, signals: Signals, paths: Paths, grid: Floats) -> Bools:
    """[N, LANES, T] the way from the lane before into this lane of the path shows red or yellow."""
    red = np.zeros((*paths.lane.shape, len(grid)), np.bool_)
    rows, places = np.nonzero((paths.lane[:, 1:] >= 0) & (road.signal[paths.lane[:, 1:]] >= 0))
    lanes, which = np.unique(paths.lane[rows, places + 1], return_inverse=True)
    red[rows, places + 1] = (
        signal_states(signals, road.signal[lanes], road.link[lanes], grid) != GREEN
    )[which]
    return red


def _signs(road: RoadMap, paths: Paths) -> Bools:
    """[N, LANES] who enters this lane of the path has to stand first."""
    rule = road.rule[paths.lane]
    sign = (paths.lane >= 0) & ((rule == STOP) | (rule == ALLWAY)) & (road.signal[paths.lane] < 0)
    sign[:, 0] = False
    return np.asarray(sign)


class _Carried(NamedTuple):
    """What each of N vehicles carries from step to step."""

    at: Ints  # lane of its path that it is on
    # when it came to a stand at the stop sign ahead, s from now; those inside a junction come
    # before all others
    rank: Floats
    liked: Floats  # speed that it does not exceed, m/s
    # m/s2 by which it accelerates otherwise than expected: its own car following is another one, or
    # it knows more
    habit: Floats


def _carried(n: int) -> _Carried:
    return _Carried(np.zeros(n, np.int32), np.full(n, np.inf), np.full(n, np.inf), np.zeros(n))


@entry
def _step_all(
    xs: Floats, vs: Floats, polite: Bools, c: _Course, d: Drivers, nominal: Floats,
    params: TrafficParams, of_ego: TrafficParams, carried: _Carried,
    mark: Ints,
) -> None:  # fmt: skip
    """`mark` [lanes of the road] is room to work in, all -1."""
    times, n = xs.shape
    at, rank, liked, habit = carried
    step, fading = (
        params.step,
        math.exp(-params.step / params.persistence) if params.persistence > 0.0 else 0.0,
    )
    for t in range(times - 1):
        x, v = xs[t], vs[t]
        for i in range(n):
            while at[i] < c.lanes[i] - 1 and x[i] > c.offset[i, at[i] + 1]:
                at[i] += 1
            rank[i] = _rank(
                c, i, at[i], rank[i], x[i], v[i], t * step if t > 0 else min(d.stood[i], 0.0)
            )
        for i in range(n):
            if c.lanes[i] == 0:  # off the road, a pedestrian: straight on, or it stops at once
                vs[t + 1, i] = 0.0 if d.does[i] == BRAKES else v[i]
                xs[t + 1, i] = x[i] + vs[t + 1, i] * step
                continue
            if i == 0 and t < len(nominal):
                vs[t + 1, 0] = nominal[t]
                xs[t + 1, 0] = x[0] + nominal[t] * step
                continue
            q = of_ego if i == 0 else params
            gap, leader_v = _leader(c, d.length, mark, at, x, v, i)
            if t == 0 and d.cruises[i] and gap > 10.0 + 3.0 * v[i]:
                liked[i] = v[i]
            a = _free(q, c, i, at[i], x[i], v[i], liked[i])
            if not math.isinf(gap):
                a = min(a, _follow(q, v[i], gap, leader_v, a))
            if t == 0 and i > 0 and fading > 0.0 and v[i] > STANDING:
                habit[i] = min(max(d.trend[i] - a, -MOST_HABIT), MOST_HABIT)
            a += habit[i]
            habit[i] *= 1.0 if d.cruises[i] else fading
            if (
                d.stays[i]
                and d.does[i] != STARTS
                and v[i] < STANDING
                and gap > 4.0
                and not _red_ahead(c, i, at[i], 0, x[i] + 30.0)
            ):
                xs[t + 1, i], vs[t + 1, i] = x[i], 0.0
                continue
            a = min(a, _red_accel(params, c, i, at[i], t, x[i], v[i]))
            if math.isinf(rank[i]):
                a = min(a, _halt(params, v[i], _to_sign(c, i, at[i], x[i]), AT_SIGN))
            if not math.isinf(c.end[i]):
                a = min(a, _halt(params, v[i], c.end[i] - x[i], AT_SIGN))
            a = min(a, _yield_accel(params, c, d, polite, at, rank, x, v, i, t))
            if d.does[i] == BRAKES:
                a = min(a, -HARD)
            speed_next = max(0.0, v[i] + max(a, -8.0) * step)
            vs[t + 1, i] = speed_next
            ahead = (
                params.euler if d.does[i] == BRAKES else 0.0
            )  # with everybody else the gain is none: SUMO's drivers brake later than these
            xs[t + 1, i] = x[i] + max(
                0.0, 0.5 * (v[i] + speed_next) * step + (speed_next - v[i]) * ahead
            )


# --- the road and who is on it ---


@kernel
def _free(q: TrafficParams, c: _Course, i: int, k: int, x: float, v: float, liked: float) -> float:
    """Acceleration on the empty road, with the lower limits of the coming lanes in view."""
    wish = max(c.limit[i, k], 1.0)
    wish = min(max(wish, min(v, 1.2 * wish)), liked)  # whoever is faster has a reason of its own
    a = max(
        min(q.accel, (wish - v) / q.step), -q.decel
    )  # not less and less towards it, as in the model's own term: SUMO's drivers do not
    for m in range(k + 1, c.lanes[i]):
        distance = c.offset[i, m] - x
        if distance > 60.0:
            break
        slow = c.limit[i, m]
        if slow < v and distance > 0.0:
            a = min(
                a,
                (slow * slow - v * v) / (2.0 * max(distance, 1.0))
                if v * v - slow * slow > distance * q.decel
                else a,
            )
    return a


@kernel
def _follow(q: TrafficParams, v: float, gap: float, leader_v: float, free: float) -> float:
    """Car following (IDM;

    Treiber, Hennecke, Helbing 2000): the acceleration on the empty road less the interaction.
    """
    wish = q.gap + max(
        0.0, v * q.headway + v * (v - leader_v) / (2.0 * math.sqrt(q.accel * q.decel))
    )
    return free - q.accel * (wish / max(gap, 0.1)) ** 2


@inlined
def _leader(
    c: _Course, length: Floats, mark: Ints, at: Ints, x: Floats, v: Floats, i: int
) -> tuple[float, float]:
    """Gap (m) and speed of the nearest vehicle ahead on the path; a vehicle's tail counts on the
    lane it came from."""
    for k in range(
        c.lanes[i] - 1, at[i] - 1, -1
    ):  # a path may come to a lane twice, in a roundabout: the first time counts
        mark[c.path[i, k]] = k
    gap, leader_v = math.inf, 0.0
    for j in range(len(x)):
        if j == i or c.lanes[j] == 0:
            continue
        k = at[j]
        m = mark[c.path[j, k]]
        place = x[j] - c.offset[j, k]
        if m < 0 and k > 0 and place < length[j]:
            m = mark[c.path[j, k - 1]]
            place = x[j] - c.offset[j, k - 1]
        if m < 0:
            continue
        distance = c.offset[i, m] + place - x[i]
        if distance > 0.0 or (distance == 0.0 and j < i):
            if distance - length[j] < gap:
                gap, leader_v = distance - length[j], v[j]
    for k in range(at[i], c.lanes[i]):
        mark[c.path[i, k]] = -1
    return gap, leader_v


# --- lines ---


@kernel
def _halt(q: TrafficParams, v: float, distance: float, most: float) -> float:
    """Acceleration that stops `distance` m ahead, at the last moment; none where that takes more
    than `most` m/s2.

    It leads to the safe speed of a driver with a step to react in: fitted to SUMO's drivers.
    """
    if v * v > 2.0 * most * max(distance, 0.1):
        return math.inf
    return max((safe_speed(max(distance - BEFORE, 0.0), 0.0, q.step) - v) / q.step, -most)


@kernel
def _red_ahead(c: _Course, i: int, k: int, t: int, place: float) -> bool:
    """Whether vehicle i, on the k-th lane of its path, has a red light before `place` on it."""
    for m in range(k + 1, c.lanes[i]):
        if c.offset[i, m] > place:
            return False
        if c.red[i, m, t]:
            return True
    return False


@kernel
def _red_accel(q: TrafficParams, c: _Course, i: int, k: int, t: int, x: float, v: float) -> float:
    for m in range(k + 1, c.lanes[i]):
        distance = c.offset[i, m] - x
        if distance > 80.0:
            break
        if c.red[i, m, t]:
            return _halt(q, v, distance, STOPS)
    return math.inf


@kernel
def _to_sign(c: _Course, i: int, k: int, x: float) -> float:
    """m to the next stop sign on the path; inf where there is none near."""
    for m in range(k + 1, c.lanes[i]):
        if c.offset[i, m] - x > 60.0:
            break
        if c.sign[i, m]:
            return float(c.offset[i, m] - x)
    return math.inf


@kernel
def _rank(c: _Course, i: int, k: int, rank: float, x: float, v: float, now: float) -> float:
    """The time (s from now, negative: ago) since when vehicle i has its turn at the stop sign
    ahead; inf before it has stood."""
    if c.lanes[i] == 0:
        return math.inf
    if c.internal[i, k]:
        return INSIDE
    if rank == INSIDE:
        return math.inf
    if math.isinf(rank) and v < 0.5 and _to_sign(c, i, k, x) < AT_LINE:
        return now
    return rank


# --- right of way ---


@inlined
def _yield_accel(
    q: TrafficParams, c: _Course, d: Drivers, polite: Bools, at: Ints, rank: Floats, x: Floats,
    v: Floats, i: int, t: int
) -> float:  # fmt: skip
    """Stop before a stretch that somebody with the right of way will use, or fall in behind whoever
    merges first."""
    a = math.inf
    for u in range(c.foe.shape[1]):
        j = c.foe[i, u]
        if j < 0:
            break
        to_begin, to_end = c.place[i, u, 0] - x[i], c.place[i, u, 1] - x[i]
        foe_begin, foe_end = c.place[i, u, 2] - x[j], c.place[i, u, 3] - x[j]
        if to_begin < 0.0 or to_begin > 60.0 or foe_end + d.length[j] < 0.0 or foe_begin > 90.0:
            continue
        if (
            c.kind[i, u] == MERGES
        ):  # the one that is nearer goes first, the other sees it as its leader
            if to_end > foe_end and foe_begin < 30.0:
                a = min(
                    a, _follow(q, v[i], max(to_end - foe_end - d.length[j], 0.5), v[j], q.accel)
                )
            continue
        if (j == 0 and d.does[i] == FORCES) or not _comes_first(
            q, c, d.length[i], at, rank, x, v, i, u, t
        ):
            continue
        stop = _halt(q, v[i], _stop_place(c, i, at[i], c.place[i, u, 0]) - x[i] + CLOSER, STOPS)
        if math.isinf(stop):
            continue
        if j == 0:
            if not polite[i] and v[i] * v[i] > 2.0 * q.yield_decel * max(to_begin - 2.0, 0.1):
                # it could not let the ego pass in comfort when that came up: do not count on it
                continue
            polite[i] = True
        a = min(a, stop)
    return a


@kernel
def _comes_first(
    q: TrafficParams, c: _Course, length: float, at: Ints, rank: Floats, x: Floats, v: Floats,
    i: int, u: int, t: int
) -> bool:  # fmt: skip
    """Whether vehicle i, `length` m long, has to let the foe of its u-th conflict pass now."""
    j, kind = c.foe[i, u], c.kind[i, u]
    foe_begin = c.place[i, u, 2] - x[j]
    mine, theirs = (c.place[i, u, 0] - x[i]) / max(v[i], 3.0), max(foe_begin, 0.0) / max(v[j], 1.0)
    if kind == MUTUAL and (mine < theirs or (mine == theirs and i < j)):
        return False
    if kind == IN_TURN and (rank[i] < rank[j] or (rank[i] == rank[j] and i < j)):
        return False
    if v[j] < 0.3 and foe_begin > 1.0 and kind != IN_TURN:
        return False  # it waits itself
    leaves = (c.place[i, u, 1] - x[i] + length) / max(v[i], 3.0)
    return bool(theirs <= leaves + q.yield_gap) and not _red_ahead(c, j, at[j], t, c.place[i, u, 2])


@kernel
def _stop_place(c: _Course, i: int, k: int, begin: float) -> float:
    """Where on its path vehicle i waits before a stretch that begins at `begin`: the entry of the
    junction, or the place to wait inside it, if any."""
    place = begin
    for m in range(k + 1, c.path.shape[1]):
        if c.offset[i, m] >= begin or c.path[i, m] < 0:
            break
        place = c.offset[i, m] if c.internal[i, m] else begin
    return place
