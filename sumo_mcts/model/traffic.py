"""How the others will move: the forward-predicted copy of the traffic.

Every agent is led along its most likely lanes: the turn that its signals announce, else straight on, else the first way. `constant_velocity`
keeps its speed; `idm` follows its leader, stops for red, yields where it must and lets a standing car stand; `routes` does so along the lanes
that the agents are going to take in truth; `script` reads what is scripted; `clone` reads what a copy of the simulation tells.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from sumo_mcts.model.geometry import chord, point_at, swung
from sumo_mcts.model.kernel import kernel, making_arrays
from sumo_mcts.model.krauss import safe_speed
from sumo_mcts.model.local import SIDEWAYS, signal_states
from sumo_mcts.model.route import Indices
from sumo_mcts.scene import (
    ALLWAY,
    BRAKES,
    FORCES,
    GREEN,
    LEFT,
    RIGHT,
    STARTS,
    STOP,
    STRAIGHT,
    TURNS,
    USUAL,
    Agents,
    Bools,
    EgoState,
    Floats,
    Forecast,
    Intent,
    Ints,
    RoadMap,
    Scene,
)

LANES = 14  # lanes of a path at most
PATH = 200.0  # m of a path at most
TOLD = 10.0  # worth of a way on which an oracle has seen an agent: more than any guess
UNTURNED = 0.05  # rad between box and lane up to which it is a matter of how curves are drawn
ASIDE = 0.1  # m off the centre line from which a blinking vehicle is taken to be changing lanes: a step of 0.1 s or two after it has begun
CRUISING = 0.5  # m/s2 of smoothed acceleration below which a vehicle is taken to drive at the speed it likes
INSIDE = -1e9  # rank of whoever is inside a junction
AT_LINE = 4.0  # m before a stop sign within which standing counts
BEFORE = 1.0  # m before a line where somebody stops, as late as possible,
CLOSER = 0.5  # m nearer than that where it waits for others: SUMO's drivers do so 0.1 m before the line
STOPS = 5.0  # m/s2 beyond which nobody stops for red or for who has the right of way: a little more than they brake with
AT_SIGN = 9.0  # m/s2 likewise at a stop sign, at which everybody stops
MOVES = 1.0  # m/s above which the acceleration of late tells how somebody drives on
MOST_HABIT = 4.0  # m/s2 that it tells at most
FOES = 24  # conflicts looked at for each agent
HARD = 4.5  # m/s2 with which an agent is taken to brake where it is taken to brake for no reason


class TrafficParams(NamedTuple):
    """See config.PredictionConfig; SI units."""

    step: float
    headway: float
    gap: float
    accel: float
    decel: float
    yield_decel: float
    yield_gap: float
    stays_after: float
    persistence: float  # s after which 1/e is left of what a driver did otherwise than expected; 0: nothing is
    euler: float  # half of SUMO's step, s: its positions follow the speed at the end of a step; 0 where it integrates ballistically
    interacting: bool  # False: constant velocity


class Paths(NamedTuple):
    """The lanes that N vehicles are expected to drive."""

    lane: Ints  # [N, LANES] -1 beyond the end
    offset: Floats  # [N, LANES+1] where each lane begins, m from the start of the first
    count: Ints  # type: ignore[assignment]  # [N] (tuple.count is not missed)


NOBODY = Intent(-1, USUAL)


def predict(
    road: RoadMap, scene: Scene, ego_lanes: Ints, nominal: Floats, params: TrafficParams, seconds: float, told: "Told", ego_stood_s: float = -math.inf,
    intent: Intent = NOBODY,
) -> Forecast:  # fmt: skip
    """Every agent of the scene for `seconds`; `ego_stood_s`: how long ago the ego came to a stand at the stop line before it.

    The ego drives along `ego_lanes` (the present one first) with the speeds `nominal` [K] at multiples of params.step, later by car following:
    the table is conditional on that. `told` is what an oracle tells: Told() for what sensors see. One agent has the `intent`, the others react.
    """
    times = int(math.ceil(seconds / params.step)) + 1
    agents, ego = changing(road, scene.agents), scene.ego
    ways = {**told.ways, intent.agent: np.array(intent.way, np.int32)} if intent.does == TURNS else told.ways
    paths = likely_paths(road, agents, ego, ego_lanes, ways)
    does = np.full(len(agents.ids) + 1, USUAL)
    does[intent.agent + 1] = intent.does
    grid = np.arange(times, dtype=np.float64) * params.step
    x, v, polite = _drive(
        road, params, params._replace(accel=min(params.accel, ego.max_accel)), paths, *_start(agents, ego), nominal,
        _red_lights(road, scene, paths, grid), _stays(agents, params), _cruises(agents),
        np.concatenate([[-ego_stood_s], np.where(agents.standing_s > 0.0, -agents.standing_s, np.inf)]), times,
        conflicts_of(road, paths) if params.interacting else None, does, np.concatenate([[0.0], agents.trend]),
    )  # fmt: skip
    pose, lane, s, valid = _poses(road, agents, paths, x, v, times, params.step)
    for i, known in (*told.copies.items(), *told.scripts.items()):
        have = min(len(known.v), times)
        pose[:have, i], v[:have, i + 1], lane[:have, i], s[:have, i] = known.pose[:have], known.v[:have], known.lane[:have], known.s[:have]
        valid[:have, i], valid[have:, i] = known.valid[:have], False
    reacts = ~agents.person
    for i in told.scripts:
        reacts[i], polite[i] = False, False
    return Forecast(
        params.step, np.ones(1), pose[None], v[:, 1:][None].copy(), lane[None], s[None], valid[None], agents.length / 2, agents.width / 2, reacts,
        polite[None], (intent,),
    )  # fmt: skip


class Scripted(NamedTuple):
    """The coming states of an agent, known from its script or from a copy of the simulation, at the forecast's times. K times."""

    pose: Floats  # [K, 4]
    v: Floats  # [K]
    lane: Ints  # [K]
    s: Floats  # [K]
    valid: Bools  # [K]


class Told(NamedTuple):
    """What oracles tell, by agent (index): nothing, unless a scenario asks for one."""

    scripts: Mapping[int, Scripted] = {}  # its coming states, whatever happens
    copies: Mapping[int, Scripted] = {}  # its coming states if the ego does what is nominal; it reacts and yields as it would otherwise
    ways: Mapping[int, Ints] = {}  # the lanes that it is really going to take from the one that it is in


def _start(agents: Agents, ego: EgoState) -> tuple[Floats, Floats, Floats]:
    """Position along the path, speed and length of the ego (row 0) and the agents."""
    return np.concatenate([[ego.s], agents.s]), np.concatenate([[ego.v], agents.v]), np.concatenate([[ego.length], agents.length])


def _stays(agents: Agents, params: TrafficParams) -> Bools:
    """[N+1] whom nobody expects to move: it has stood for a while (why is looked at in _drive)."""
    return np.concatenate([[False], (agents.standing_s >= params.stays_after) & params.interacting])


def changing(road: RoadMap, agents: Agents) -> Agents:
    """The agents, those that move towards a neighbouring lane with the blinker on as if they were there already, at its edge."""
    side = np.where(agents.lane >= 0, agents.blinker, 0)
    beside = np.where(side > 0, road.left[agents.lane], np.where(side < 0, road.right[agents.lane], -1))
    moves = (beside >= 0) & (agents.d * side > ASIDE)
    apart = 0.5 * (road.width[agents.lane] + road.width[beside])
    return agents._replace(lane=np.where(moves, beside, agents.lane).astype(np.int32), d=np.where(moves, agents.d - side * apart, agents.d))


def _cruises(agents: Agents) -> Bools:
    """[N+1] who keeps its speed on its own account, if nobody is in its way: it has not accelerated for a while."""
    return np.concatenate([[False], (np.abs(agents.trend) < CRUISING) & (agents.v > 3.0)])


def likely_paths(road: RoadMap, agents: Agents, ego: EgoState, ego_lanes: Ints, ways: Mapping[int, Ints]) -> Paths:
    """The ego's lanes (row 0) and the likely ones of the agents; `ways`: the coming lanes of those of whom they are known."""
    n = len(agents.ids) + 1
    lane = np.full((n, LANES), -1, np.int32)
    offset = np.zeros((n, LANES + 1))
    count = np.zeros(n, np.int32)
    k = min(len(ego_lanes), LANES)
    lane[0, :k] = ego_lanes[:k]
    offset[0, 1 : k + 1] = np.cumsum(road.length[ego_lanes[:k]])
    offset[0, k + 1 :] = offset[0, k]
    count[0] = k
    true = np.full((n, LANES), -1, np.int32)
    for i, way in ways.items():
        true[i + 1, : len(way)] = way[:LANES]
    _likely(
        lane, offset, count, true, agents.lane, agents.s, agents.blinker, road.successor_offset, road.successor, road.direction, road.length,
        road.internal, road.edge,
    )  # fmt: skip
    return Paths(lane, offset, count)


@kernel
def _likely(
    path: Ints, offset: Floats, count: Ints, true: Ints, lane: Ints, s: Floats, blinker: Ints, first: Ints, successor: Ints, direction: Ints,
    length: Floats, internal: Bools, edge: Ints,
) -> None:  # fmt: skip
    """The lanes each agent will most likely drive. The blinker speaks for the next turn only; `true` (-1: not told) knows better."""
    for i in range(len(lane)):
        row, here, side = i + 1, lane[i], blinker[i]
        if here < 0:
            continue
        total, n = 0.0, 0
        while here >= 0 and n < LANES and total - s[i] < PATH:
            path[row, n] = here
            total += length[here]
            n += 1
            offset[row, n] = total
            best, rank, ways = -1, -1.0, first[here + 1] - first[here]
            for k in range(first[here], first[here + 1]):
                worth = _turn_worth(direction[successor[k]], side) + TOLD * _agreement(true[row], edge, successor[k])
                if worth > rank:
                    best, rank = successor[k], worth
            if best >= 0 and internal[best] and not internal[here] and direction[best] != STRAIGHT:
                side = 0
            here = best if ways > 0 else -1
        count[row] = n
        for k in range(n + 1, LANES + 1):
            offset[row, k] = total


@kernel
def _agreement(true: Ints, edge: Ints, lane: int) -> float:
    """How far a lane is what was told: 2 the lane itself, 1 another one of its edge (whoever changes lanes), else 0."""
    agreement = 0.0
    for told in true:
        if told == lane:
            return 2.0
        if told >= 0 and edge[told] == edge[lane]:
            agreement = 1.0
    return agreement


@kernel
def _turn_worth(turn: int, side: int) -> float:
    if side > 0:
        return 3.0 if turn == LEFT else 2.0 if turn == STRAIGHT else 1.0 if turn == RIGHT else 0.5
    if side < 0:
        return 3.0 if turn == RIGHT else 2.0 if turn == STRAIGHT else 1.0 if turn == LEFT else 0.5
    return 3.0 if turn == STRAIGHT else 2.0 if turn == RIGHT else 1.0 if turn == LEFT else 0.5


def _red_lights(road: RoadMap, scene: Scene, paths: Paths, grid: Floats) -> Bools:
    """[N+1, LANES, T] the way from the lane before into this lane of the path shows red or yellow."""
    red = np.zeros((*paths.lane.shape, len(grid)), np.bool_)
    rows, places = np.nonzero((paths.lane[:, 1:] >= 0) & (road.signal[paths.lane[:, 1:]] >= 0))
    lanes, which = np.unique(paths.lane[rows, places + 1], return_inverse=True)
    red[rows, places + 1] = (signal_states(scene.signals, road.signal[lanes], road.link[lanes], grid) != GREEN)[which]
    return red


def conflicts_of(road: RoadMap, paths: Paths) -> tuple[Ints, Ints, Floats]:
    """For each vehicle the others whose paths meet its own where it must yield or where lanes merge.

    Returns foe [N+1, FOES] (-1 beyond the end), kind [N+1, FOES] (1: has to yield, 2: merge with equal right, 3: mutual, 4: all-way stop) and
    place [N+1, FOES, 4]: begin and end of the shared stretch on its own path and on the foe's, m; the begin of the lane entered is found again by search.
    """
    n = len(paths.lane)
    foe = np.full((n, FOES), -1, np.int32)
    kind = np.zeros((n, FOES), np.int32)
    place = np.zeros((n, FOES, 4))
    _find_conflicts(
        foe, kind, place, paths.lane, paths.offset, paths.count, np.full(len(road.lane_ids), -1, np.int32), road.conflict_offset, road.conflict_lane,
        road.conflict_begin, road.conflict_end, road.conflict_other_begin, road.conflict_other_end, road.conflict_merge, road.conflict_yields,
        road.rule == ALLWAY,
    )  # fmt: skip
    return foe, kind, place


@making_arrays
def _find_conflicts(
    foe: Ints, kind: Ints, place: Floats, path: Ints, offset: Floats, count: Ints, mark: Ints, first: Ints, other: Ints, begin: Floats, end: Floats,
    other_begin: Floats, other_end: Floats, merge: Bools, yields: Bools, allway: Bools,
) -> None:  # fmt: skip
    n = len(path)
    used = np.zeros(n, np.int32)
    for j in range(n):
        for k in range(count[j]):
            mark[path[j, k]] = k
        for i in range(n):
            if i == j:
                continue
            for m in range(count[i]):
                lane = path[i, m]
                for e in range(first[lane], first[lane + 1]):
                    k = mark[other[e]]
                    if k < 0 or used[i] >= foe.shape[1]:
                        continue
                    back = False
                    for r in range(first[other[e]], first[other[e] + 1]):
                        if other[r] == lane:
                            back = back or yields[r]
                    if not yields[e] and not merge[e]:
                        continue
                    u = used[i]
                    foe[i, u] = j
                    kind[i, u] = (4 if allway[lane] else 3 if back else 1) if yields[e] else 2 if not back else 0
                    if kind[i, u] == 0:
                        continue
                    place[i, u, 0], place[i, u, 1] = offset[i, m] + begin[e], offset[i, m] + end[e]
                    place[i, u, 2], place[i, u, 3] = offset[j, k] + other_begin[e], offset[j, k] + other_end[e]
                    used[i] += 1
        for k in range(count[j]):
            mark[path[j, k]] = -1


def _signs(road: RoadMap, paths: Paths) -> Bools:
    """[N+1, LANES] who enters this lane of the path has to stand first."""
    sign = (paths.lane >= 0) & np.isin(road.rule[paths.lane], (STOP, ALLWAY)) & (road.signal[paths.lane] < 0)
    sign[:, 0] = False
    return np.asarray(sign)


def _drive(
    road: RoadMap, q: TrafficParams, own: TrafficParams, paths: Paths, x: Floats, v: Floats, length: Floats, nominal: Floats,
    red: Bools, stays: Bools, cruises: Bools, stood: Floats, times: int, conflicts: tuple[Ints, Ints, Floats] | None,
    does: Indices, trend: Floats,
) -> tuple[Floats, Floats, Bools]:  # fmt: skip
    """Positions along the paths [T, N+1], speeds [T, N+1], and which agents let the ego pass [N]. `own`: the parameters of the ego, row 0."""
    xs, vs = np.zeros((times, len(x))), np.zeros((times, len(x)))
    xs[0], vs[0] = x, v
    polite = np.zeros(len(x), np.bool_)
    if conflicts is None:
        xs[:] = x + np.arange(times)[:, None] * q.step * v
        vs[:] = v
        return xs, vs, polite[1:]
    foe, kind, place = conflicts
    _step_all(
        xs, vs, polite, q, own, paths.lane, paths.offset, paths.count, length, nominal, red, stays, cruises,
        np.full(len(road.lane_ids), -1, np.int32), road.speed, foe, kind, place, road.internal, _signs(road, paths), stood, does, trend,
    )  # fmt: skip
    return xs, vs, polite[1:]


@making_arrays
def _step_all(
    xs: Floats, vs: Floats, polite: Bools, q: TrafficParams, own: TrafficParams, path: Ints, offset: Floats, count: Ints, length: Floats,
    nominal: Floats, red: Bools, stays: Bools, cruises: Bools, mark: Ints, speed: Floats, foe: Ints, kind: Ints, place: Floats, internal: Bools,
    sign: Bools, stood: Floats, does: Indices, trend: Floats,
) -> None:  # fmt: skip
    times, n = xs.shape
    rank = np.full(n, np.inf)  # when it came to a stand at the stop sign ahead; those inside a junction come before all others
    current = np.zeros(n, np.int32)
    liked = np.full(n, np.inf)
    habit = np.zeros(n)  # m/s2 by which a driver accelerates otherwise than expected: its own car following is another one, or it knows more
    fading = math.exp(-q.step / q.persistence) if q.persistence > 0.0 else 0.0
    for t in range(times - 1):
        x, v = xs[t], vs[t]
        for i in range(n):
            while current[i] < count[i] - 1 and x[i] > offset[i, current[i] + 1]:
                current[i] += 1
            rank[i] = _rank(rank[i], sign, path, offset, count, internal, i, current[i], x[i], v[i], t * q.step if t > 0 else min(stood[i], 0.0))
        for i in range(n):
            if count[i] == 0:  # off the road, a pedestrian: straight on
                xs[t + 1, i], vs[t + 1, i] = x[i] + v[i] * q.step, v[i]
                continue
            if i == 0 and t < len(nominal):
                vs[t + 1, 0] = nominal[t]
                xs[t + 1, 0] = x[0] + nominal[t] * q.step
                continue
            p = own if i == 0 else q
            gap, leader_v = _leader(path, offset, count, length, mark, current, x, v, i)
            if t == 0 and cruises[i] and gap > 10.0 + 3.0 * v[i]:
                liked[i] = v[i]
            a = _free(p, path, offset, count, speed, i, current[i], x[i], v[i], liked[i])
            if not math.isinf(gap):
                a = min(a, _follow(p, v[i], gap, leader_v, a))
            if t == 0 and i > 0 and fading > 0.0 and v[i] > MOVES:
                habit[i] = min(max(trend[i] - a, -MOST_HABIT), MOST_HABIT)
            a += habit[i]
            habit[i] *= 1.0 if cruises[i] else fading
            if stays[i] and does[i] != STARTS and v[i] < 0.1 and gap > 4.0 and not _red_ahead(red, current[i], count[i], i, 0, offset, x[i]):
                xs[t + 1, i], vs[t + 1, i] = x[i], 0.0
                continue
            a = min(a, _red_accel(q, red, path, offset, count, current[i], i, t, x[i], v[i]))
            if math.isinf(rank[i]):
                a = min(a, _halt(q, v[i], _to_sign(sign, offset, count, i, current[i], x[i]), AT_SIGN))
            a = min(a, _yield_accel(q, foe, kind, place, offset, count, current, length, x, v, i, polite, path, internal, red, t, rank, does[i] == FORCES))
            if does[i] == BRAKES:
                a = min(a, -HARD)
            speed_next = max(0.0, v[i] + max(a, -8.0) * q.step)
            vs[t + 1, i] = speed_next
            ahead = q.euler if does[i] == BRAKES else 0.0  # with everybody else the gain is none: SUMO's drivers brake later than these
            xs[t + 1, i] = x[i] + max(0.0, 0.5 * (v[i] + speed_next) * q.step + (speed_next - v[i]) * ahead)


@kernel
def _free(q: TrafficParams, path: Ints, offset: Floats, count: Ints, speed: Floats, i: int, k: int, x: float, v: float, liked: float) -> float:
    """Acceleration on the empty road, with the lower limits of the coming lanes in view."""
    wish = max(speed[path[i, k]], 1.0)
    wish = min(max(wish, min(v, 1.2 * wish)), liked)  # whoever is faster has a reason of its own
    a = max(min(q.accel, (wish - v) / q.step), -q.decel)  # not less and less towards it, as in the model's own term: SUMO's drivers do not
    for m in range(k + 1, count[i]):
        distance = offset[i, m] - x
        if distance > 60.0:
            break
        slow = speed[path[i, m]]
        if slow < v and distance > 0.0:
            a = min(a, (slow * slow - v * v) / (2.0 * max(distance, 1.0)) if v * v - slow * slow > distance * q.decel else a)
    return a


@kernel
def _follow(q: TrafficParams, v: float, gap: float, leader_v: float, free: float) -> float:
    """Car following (IDM; Treiber, Hennecke, Helbing 2000): the acceleration on the empty road less the interaction."""
    wish = q.gap + max(0.0, v * q.headway + v * (v - leader_v) / (2.0 * math.sqrt(q.accel * q.decel)))
    return free - q.accel * (wish / max(gap, 0.1)) ** 2


@kernel
def _leader(
    path: Ints, offset: Floats, count: Ints, length: Floats, mark: Ints, current: Ints, x: Floats, v: Floats, i: int
) -> tuple[float, float]:  # fmt: skip
    """Gap (m) and speed of the nearest vehicle ahead on the path; a vehicle's tail counts on the lane it came from."""
    for k in range(current[i], count[i]):
        mark[path[i, k]] = k
    gap, leader_v = math.inf, 0.0
    for j in range(len(x)):
        if j == i or count[j] == 0:
            continue
        k = current[j]
        m = mark[path[j, k]]
        place = x[j] - offset[j, k]
        if m < 0 and k > 0 and place < length[j]:
            m = mark[path[j, k - 1]]
            place = x[j] - offset[j, k - 1]
        if m < 0:
            continue
        distance = offset[i, m] + place - x[i]
        if distance > 0.0 or (distance == 0.0 and j < i):
            if distance - length[j] < gap:
                gap, leader_v = distance - length[j], v[j]
    for k in range(current[i], count[i]):
        mark[path[i, k]] = -1
    return gap, leader_v


@kernel
def _red_ahead(red: Bools, k: int, count: int, i: int, t: int, offset: Floats, x: float) -> bool:
    for m in range(k + 1, count):
        if offset[i, m] - x > 30.0:
            return False
        if red[i, m, t]:
            return True
    return False


@kernel
def _red_before(red: Bools, offset: Floats, count: int, k: int, i: int, t: int, place: float) -> bool:
    """Whether vehicle i has a red light between where it is and `place` on its path."""
    for m in range(k + 1, count):
        if offset[i, m] > place:
            return False
        if red[i, m, t]:
            return True
    return False


@kernel
def _halt(q: TrafficParams, v: float, distance: float, most: float) -> float:
    """Acceleration that stops `distance` m ahead, at the last moment; none where that takes more than `most` m/s2.

    It leads to the safe speed of a driver with a step to react in: fitted to SUMO's drivers.
    """
    if v * v > 2.0 * most * max(distance, 0.1):
        return math.inf
    return max((safe_speed(max(distance - BEFORE, 0.0), 0.0, q.step) - v) / q.step, -most)


@kernel
def _red_accel(q: TrafficParams, red: Bools, path: Ints, offset: Floats, count: Ints, k: int, i: int, t: int, x: float, v: float) -> float:
    for m in range(k + 1, count[i]):
        distance = offset[i, m] - x
        if distance > 80.0:
            break
        if red[i, m, t]:
            return _halt(q, v, distance, STOPS)
    return math.inf


@kernel
def _to_sign(sign: Bools, offset: Floats, count: Ints, i: int, k: int, x: float) -> float:
    """m to the next stop sign on the path; inf where there is none near."""
    for m in range(k + 1, count[i]):
        if offset[i, m] - x > 60.0:
            break
        if sign[i, m]:
            return float(offset[i, m] - x)
    return math.inf


@kernel
def _rank(rank: float, sign: Bools, path: Ints, offset: Floats, count: Ints, internal: Bools, i: int, k: int, x: float, v: float, now: float) -> float:
    """The time (s from now, negative: ago) since when vehicle i has its turn at the stop sign ahead; inf before it has stood."""
    if count[i] == 0:
        return math.inf
    if internal[path[i, k]]:
        return INSIDE
    if rank == INSIDE:
        return math.inf
    if math.isinf(rank) and v < 0.5 and _to_sign(sign, offset, count, i, k, x) < AT_LINE:
        return now
    return rank


@kernel
def _yield_accel(
    q: TrafficParams, foe: Ints, kind: Ints, place: Floats, offset: Floats, count: Ints, current: Ints, length: Floats, x: Floats, v: Floats, i: int,
    polite: Bools, path: Ints, internal: Bools, red: Bools, t: int, rank: Floats, forces: bool,
) -> float:  # fmt: skip
    """Stop before a stretch that somebody with the right of way will use, or fall in behind whoever merges first; not for the ego where i `forces`."""
    a = math.inf
    for u in range(foe.shape[1]):
        j = foe[i, u]
        if j < 0:
            break
        to_begin, to_end = place[i, u, 0] - x[i], place[i, u, 1] - x[i]
        foe_begin, foe_end = place[i, u, 2] - x[j], place[i, u, 3] - x[j]
        if to_begin < 0.0 or to_begin > 60.0 or foe_end + length[j] < 0.0 or foe_begin > 90.0:
            continue
        mine, theirs = to_begin / max(v[i], 3.0), max(foe_begin, 0.0) / max(v[j], 1.0)
        if kind[i, u] == 2:  # merge: the one that is nearer goes first, the other sees it as its leader
            if to_end > foe_end and foe_begin < 30.0:
                a = min(a, _follow(q, v[i], max(to_end - foe_end - length[j], 0.5), v[j], q.accel))
            continue
        if j == 0 and forces:
            continue
        if kind[i, u] == 3 and (mine < theirs or (mine == theirs and i < j)):
            continue
        if kind[i, u] == 4 and (rank[i] < rank[j] or (rank[i] == rank[j] and i < j)):
            continue
        if v[j] < 0.3 and foe_begin > 1.0 and kind[i, u] != 4:
            continue  # it waits itself
        if _red_before(red, offset, count[j], current[j], j, t, place[i, u, 2]):
            continue
        leaves = (to_end + length[i]) / max(v[i], 3.0)
        if theirs > leaves + q.yield_gap:
            continue
        stop = _halt(q, v[i], _stop_place(offset, current[i], i, x[i], place[i, u, 0], path, internal) + CLOSER, STOPS)
        if math.isinf(stop):
            continue
        if j == 0:
            if not polite[i] and v[i] * v[i] > 2.0 * q.yield_decel * max(to_begin - 2.0, 0.1):
                continue  # it could not let the ego pass in comfort when that came up: do not count on it
            polite[i] = True
        a = min(a, stop)
    return a


@kernel
def _stop_place(offset: Floats, k: int, i: int, x: float, begin: float, path: Ints, internal: Bools) -> float:
    """m to where vehicle i waits before a stretch that begins at `begin`: the entry of the junction, or the place to wait inside it, where it has one."""
    place = begin
    for m in range(k + 1, offset.shape[1] - 1):
        if offset[i, m] >= begin or path[i, m] < 0:
            break
        place = offset[i, m] if internal[path[i, m]] else begin
    return place - x


def _poses(road: RoadMap, agents: Agents, paths: Paths, x: Floats, v: Floats, times: int, step: float) -> tuple[Floats, Ints, Floats, Bools]:
    """Pose [T, N, 4], lane [T, N], s [T, N] and validity [T, N] of the agents from their positions along the paths [T, N+1]."""
    n = len(agents.ids)
    pose, lane, s, valid = np.zeros((times, n, 4)), np.full((times, n), -1, np.int32), np.zeros((times, n)), np.ones((times, n), np.bool_)
    scale = road.shape_length / np.maximum(road.length, 1e-9)
    _place(
        pose, lane, s, valid, x, paths.lane, paths.offset, paths.count, agents.x, agents.y, agents.heading, agents.length, agents.d, agents.v, step,
        road.points, road.point_s, road.point_offset, scale,
    )  # fmt: skip
    return pose, lane, s, valid


@kernel
def _place(
    pose: Floats, lane: Ints, s: Floats, valid: Bools, x: Floats, path: Ints, offset: Floats, count: Ints, x0: Floats, y0: Floats, heading: Floats,
    length: Floats, d: Floats, v0: Floats, step: float, points: Floats, arc: Floats, first: Ints, scale: Floats,
) -> None:  # fmt: skip
    times, n = lane.shape
    for i in range(n):
        row = i + 1
        cs, sn = math.cos(heading[i]), math.sin(heading[i])
        rear_x, rear_y = x0[i] - 0.5 * length[i] * cs, y0[i] - 0.5 * length[i] * sn
        start, aside, turn = x[0, row], d[i], 0.0
        k, kr = 0, 0
        for t in range(times):
            moved = x[t, row] - start
            if count[row] == 0:
                pose[t, i, 0], pose[t, i, 1], pose[t, i, 2], pose[t, i, 3] = x0[i] + moved * cs, y0[i] + moved * sn, cs, sn
                continue
            while k < count[row] - 1 and x[t, row] > offset[row, k + 1]:
                k += 1
            if x[t, row] > offset[row, count[row]] + 0.1 and count[row] < path.shape[1] and offset[row, count[row]] - start < PATH:
                valid[t, i] = False  # beyond the end of the road
            here = path[row, k]
            lane[t, i], s[t, i] = here, x[t, row] - offset[row, k]
            fx, fy = point_at(points, arc, first[here], first[here + 1], s[t, i] * scale[here])
            back = x[t, row] - length[i]
            if back < 0.0:  # its rear is where it has already been: on the line from the rear to the front it has now
                rx, ry = rear_x + moved * cs, rear_y + moved * sn
            else:
                while kr < count[row] - 1 and back > offset[row, kr + 1]:
                    kr += 1
                rx, ry = point_at(points, arc, first[path[row, kr]], first[path[row, kr] + 1], (back - offset[row, kr]) * scale[path[row, kr]])
            px, py, pc, ps = chord(fx, fy, rx, ry, cs, sn)
            if t == 0:
                turn = math.atan2(sn * pc - cs * ps, cs * pc + sn * ps)
                turn = turn if abs(turn) > UNTURNED else 0.0
                pose[t, i, 0], pose[t, i, 1], pose[t, i, 2], pose[t, i, 3] = x0[i], y0[i], cs, sn
                continue
            if turn != 0.0 or aside != 0.0:
                left = -math.copysign(min(SIDEWAYS * step, abs(aside)), aside)
                aside, turn = aside + left, swung(turn, x[t, row] - x[t - 1, row], left, length[i])
            ct, st = math.cos(turn), math.sin(turn)
            c, n = pc * ct - ps * st, ps * ct + pc * st
            pose[t, i, 0] = px - aside * ps + 0.5 * length[i] * (pc - c)
            pose[t, i, 1] = py + aside * pc + 0.5 * length[i] * (ps - n)
            pose[t, i, 2], pose[t, i, 3] = c, n
