"""Where people walk: over the crossing on the ego's way that they come to, else straight on.

A person at a corner faces the corner until it turns onto the crossing. Straight on it would never
come before the ego. Which way it takes is not known, so the one that matters is expected. Where
people have to let vehicles pass, one that comes to the crossing stops before it for an ego that is
near and has not turned yet, and goes first where the ego is far, slow or has turned. Then only
the search tells whether it waits (model/kerbs.py). An ego that is about to turn to the near side,
right where traffic drives on the right, counts on nobody to wait on the road that it leaves.
Where a signal shows red to people they wait at the kerb until it shows green.
"""

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices, Ints
from sumo_mcts.numerics.geometry import COS, SIN, X, Y
from sumo_mcts.numerics.kernel import entry, kernel
from sumo_mcts.road import LEFT, PEOPLE_FIRST, PEOPLE_WAIT, RIGHT, STRAIGHT, RoadMap
from sumo_mcts.scene import STANDING, Agents, EgoState

ENTERS_S = 4.0  # within which a person comes to a crossing that it is expected to walk over
BESIDE = 0.5  # m: so near to its edges one is on it, and between them enters it so far inside
ALONG = 0.3  # share of its way that leads along the crossing, with less it may go either way
SAMPLE = 0.25  # m between the points of a lane that are looked at
MOST_KEPT = 256  # lanes of which the crossings are kept, and with them their road maps
NOT_TURNED = 0.7  # cosine of the angle by which a vehicle may have turned that they wait for
EGO_HALF = 1.0  # m from the middle of a lane to the side of the ego
# s: people who have to let vehicles pass wait if the ego could be there sooner. SUMO's people wait
# where a vehicle could be at the junction within 3.2 s. In front of one that is inside already they
# walk over the part of the crossing that it would not reach while they do.
GAP_S = 2.5
SLOW = 5.0  # m/s: they do not wait for an ego that stands or is slower
LEAST_ACCEL = 0.1  # m/s2 that any ego is taken to have
KERB = 0.5  # m before a crossing at which they wait
BODY = 0.25  # m from the middle of a person to its side
LEAST_ROOM = 0.2  # m: nobody waits where an ego that cuts the corner comes so near to the kerb
STEP = 0.5  # m of a crossing on which they may be before they are on their way over it
WAITS_WITHIN = 2.0  # m before a crossing whose signal shows red: who stands there waits for green
FACES = 0.7  # cosine of the angle to the crossing up to which it does
NO_LIGHT = -1.0  # Ways.goes of who waits for no signal


class Crossings(NamedTuple):
    """C places where the ego's way meets a crossing for people on foot."""

    begin: Floats  # [C, 2] the middle of one end, m
    along: Floats  # [C, 2] unit vector to the other end
    length: Floats  # [C] m
    half_width: Floats  # [C] m
    first: Floats  # [C] from where to where on its lane the ego's front is on the crossing, m
    last: Floats  # [C] m
    near: Floats  # [C] the ego's part of the crossing, from where to where along it, m
    far: Floats  # [C] m
    lane: Ints  # [C] the ego's lane
    over: Ints  # [C] the lane that is the crossing
    yields: Bools  # [C] people have to let vehicles pass, and the ego counts on it,
    waits: Bools  # [C] and it has not turned when it comes to the crossing,
    cuts: Bools  # [C] or it has turned to the near side: its rear cuts the corner


class Approach(NamedTuple):
    """The ego on its way to C crossings, as fast as it can."""

    line: Floats  # [C] m that its front has to drive to the junction; negative inside it
    over: Floats  # [C] until it is over the crossing
    v: float  # m/s
    accel: float  # m/s2, up to
    fastest: float  # m/s


class Ways(NamedTuple):
    """Two straight pieces for each of N agents; the second has no end."""

    turn: Floats  # [N] m until the second piece, inf: never
    pose: Floats  # [N, 4] columns X .. SIN: where and how the first piece begins,
    then: Floats  # [N, 4] and the second
    stop: Floats  # [N] m after which it waits, inf: never
    # [N] s after which its signal lets it go on, inf: not as far as is looked; NO_LIGHT: it waits
    # for none
    goes: Floats
    faces: Floats  # [N, 2] cosine and sine of the heading now


class _Same:
    """A road map as a key: it is the same as itself alone."""

    def __init__(self, road: RoadMap) -> None:
        self.road = road

    def __hash__(self) -> int:
        return id(self.road.points)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.road.points is other.road.points


def crossings_on(road: RoadMap, lanes: Ints | Indices) -> Crossings:
    """The crossings that the ego meets on `lanes` [K]."""
    inside = lanes[road.junction[lanes] >= 0].tolist()
    found = [row for lane in inside for row in _crossings_of(_Same(road), lane)]
    rows = np.array(found).reshape(-1, 14)
    length, half, first, last, near, far = rows[:, 4:10].T.copy()
    begin, along, lane = rows[:, :2].copy(), rows[:, 2:4].copy(), rows[:, 10].astype(np.int32)
    over = rows[:, 13].astype(np.int32)
    near_side = road.direction[lane] == (LEFT if road.lefthand else RIGHT)
    turned = (road.direction[lane] != STRAIGHT) & (rows[:, 12] <= NOT_TURNED)
    # who is about to turn to the near side slows down too much for people to wait for it
    yields = (rows[:, 11] == PEOPLE_WAIT) & (turned | ~near_side)
    waits, cuts = yields & ~turned, yields & near_side
    return Crossings(
        begin, along, length, half, first, last, near, far, lane, over, yields, waits, cuts
    )


def approach(road: RoadMap, lanes: Ints, ego: EgoState, crossings: Crossings) -> Approach:
    """How the ego comes to crossings of its `lanes` [K], of which it is on the first."""
    begin = np.concatenate([[0.0], np.cumsum(road.length[lanes])]) - ego.s
    at = np.array([lanes.tolist().index(lane) for lane in crossings.lane.tolist()], np.int64)
    inside = road.junction[lanes]
    enters = np.array([np.argmax(inside == inside[k]) for k in at], np.int64)
    over = begin[at] + crossings.last
    fastest = float(road.speed[crossings.lane].max(initial=ego.v))
    return Approach(begin[enters], over, ego.v, max(ego.max_accel, LEAST_ACCEL), fastest)


@lru_cache(maxsize=MOST_KEPT)
def _crossings_of(same: _Same, lane: int) -> tuple[tuple[float, ...], ...]:
    """The rows of Crossings for one lane inside a junction."""
    road = same.road
    here = road.junction == road.junction[lane]
    known = here & (road.rule >= PEOPLE_FIRST)
    if (road.signal[here] >= 0).any():
        known &= road.signal >= 0  # of others it is not known when people go
    return tuple(row for each in np.flatnonzero(known) for row in _meeting(road, lane, int(each)))


def _meeting(road: RoadMap, lane: int, crossing: int) -> Iterator[tuple[float, ...]]:
    """The row of Crossings for a lane and a crossing, if they meet."""
    ends = road.points[road.point_offset[crossing : crossing + 2] + np.array([0, -1])]
    length, half = float(np.linalg.norm(ends[1] - ends[0])), 0.5 * float(road.width[crossing])
    begin, along = ends[0], (ends[1] - ends[0]) / max(length, 1e-9)
    pieces = slice(road.point_offset[lane], road.point_offset[lane + 1])
    points, arc = road.points[pieces], road.point_s[pieces]
    at = np.linspace(0.0, arc[-1], max(2, int(arc[-1] / SAMPLE) + 1))
    x, y = np.interp(at, arc, points[:, 0]), np.interp(at, arc, points[:, 1])
    side = np.column_stack([-np.gradient(y), np.gradient(x)])
    side *= EGO_HALF / np.maximum(np.linalg.norm(side, axis=1), 1e-9)[:, None]
    front = np.column_stack([x, y])
    away = np.stack([front - side, front, front + side]) - begin
    on, off = away @ along, away @ np.array([-along[1], along[0]])
    meets = (on >= 0.0) & (on <= length) & (np.abs(off) <= half)
    if meets.any():
        there = np.flatnonzero(meets.any(axis=0))
        covered = at[there] / road.scale[lane]
        part = covered[0], covered[-1], on[meets].min(), on[meets].max()
        k = int(there.mean())
        step = front[min(k + 1, len(at) - 1)] - front[max(k - 1, 0)]
        ahead = step @ _comes_from(road, lane) / max(float(np.linalg.norm(step)), 1e-9)
        rule = int(road.rule[crossing])
        yield (*begin, *along, length, half, *part, lane, rule, ahead, crossing)


def _comes_from(road: RoadMap, lane: int) -> Floats:
    """[2] unit vector along the end of the road by which `lane`, inside a junction, is reached."""
    while road.internal[lane] and (road.successor == lane).any():
        into = np.flatnonzero(road.successor == lane)[0]
        lane = int(np.searchsorted(road.successor_offset, into, side="right")) - 1
    last = road.points[road.point_offset[lane + 1] - 2 : road.point_offset[lane + 1]]
    way = last[1] - last[0]
    return np.asarray(way / max(float(np.linalg.norm(way)), 1e-9))


@kernel
def _place(crossings: Crossings, c: int, x: float, y: float) -> tuple[float, float]:
    """m along crossing c, and to the left of its middle, of a point."""
    dx, dy = x - crossings.begin[c, X], y - crossings.begin[c, Y]
    ax, ay = crossings.along[c, X], crossings.along[c, Y]
    return dx * ax + dy * ay, dy * ax - dx * ay


def entering_m(
    crossings: Crossings, c: int, pose: Floats, driven: Floats, half: Floats, people: Indices
) -> tuple[Floats, Floats, Floats, Floats]:
    """[P] m that `people` [P] walk until they are on the ego's part of crossing c; inf: never, or
    they are there already. And until they are at its kerb, and from there past the ego's part; 0
    where they are on the crossing already. And until they have left the ego's part; inf: not
    within the forecast, 0: they are never there.

    Agents are at `pose` [T, N, 4] after `driven` [T, N] m, `half` [N] m long to either side.
    """
    found = np.zeros((4, len(people)))
    found[0] = np.inf
    _fill_entering(found, crossings, c, pose, driven, half, people)
    return found[0], found[1], found[2], found[3]


@entry
def _fill_entering(
    found: Floats, crossings: Crossings, c: int, pose: Floats, driven: Floats, half: Floats,
    people: Indices,
) -> None:  # fmt: skip
    """Fill `found` [4, P], which is inf and three times 0 before."""
    length, middle = crossings.length[c], 0.5 * (crossings.near[c] + crossings.far[c])
    for k in range(len(people)):
        i = people[k]
        low, high = crossings.near[c] - half[i], crossings.far[c] + half[i]
        for t in range(pose.shape[0]):
            on, off = _place(crossings, c, pose[t, i, X], pose[t, i, Y])
            on_part = abs(off) < crossings.half_width[c] + BESIDE and low < on < high
            if found[3, k] > 0.0:
                if not on_part:
                    found[3, k] = driven[t, i]
                    break
                continue
            if abs(off) >= crossings.half_width[c] + BESIDE:
                continue
            way, before = (middle, on) if on < 0.5 * length else (length - middle, length - on)
            room = way - EGO_HALF - BODY  # between who waits and the ego
            fits = room > LEAST_ROOM or not crossings.cuts[c]
            if found[2, k] == 0.0 and fits and -KERB < before < min(STEP, room):
                found[1, k], found[2, k] = driven[t, i], way + EGO_HALF
            if on_part:
                found[0, k] = driven[t, i] if t > 0 else np.inf
                found[3, k] = np.inf


def ways_on_foot(
    agents: Agents, crossings: Crossings, ego: Approach, green: Bools, step: float
) -> Ways:
    """The ways of agents [N], of which only those of persons mean anything.

    `green` [C, T]: at which times, `step` s apart, people may enter each crossing.
    """
    never = np.full(len(agents.x), np.inf)
    pose = np.column_stack([agents.x, agents.y, np.cos(agents.heading), np.sin(agents.heading)])
    no_light = np.full(len(agents.x), NO_LIGHT)
    ways = Ways(never, pose, pose.copy(), never.copy(), no_light, pose[:, COS:].copy())
    if len(crossings.length):
        _lead(ways, crossings, ego, np.flatnonzero(agents.person), agents.v, green, step)
    return ways


@entry
def _lead(
    ways: Ways, crossings: Crossings, ego: Approach, people: Indices, v: Floats, green: Bools,
    step: float,
) -> None:  # fmt: skip
    """Lead people over the crossing that they are on, or wait for, or come to within ENTERS_S
    first."""
    for i in people:
        nearest = ENTERS_S * v[i]
        for c in range(len(crossings.length)):
            if v[i] < STANDING and not green[c, 0]:
                _wait(ways, i, crossings, c, green, step)
            before, nearest = nearest, _over(ways, i, crossings, c, nearest)
            if nearest < before:
                on_it = nearest == 0.0
                waits = crossings.waits[c] and not on_it and _lets_pass(ego, c, nearest / v[i])
                ways.stop[i] = max(nearest - KERB, 0.0) if waits else math.inf
                ways.goes[i] = NO_LIGHT
                if not on_it:
                    _stop_at_red(ways, i, green[c], nearest, nearest / v[i] / step, step)


@kernel
def _stop_at_red(
    ways: Ways, i: int, green: Bools, away: float, arrives: float, step: float
) -> None:
    """Stop person i before a crossing that is `away` m, where people have green [T] at times `step`
    s apart, if it has no green when it `arrives` (steps)."""
    k = min(int(arrives), len(green) - 1)
    if green[k]:
        return
    ways.stop[i], ways.goes[i] = max(away - KERB, 0.0), math.inf
    for t in range(k, len(green)):
        if green[t]:
            ways.goes[i] = t * step
            return


@kernel
def _wait(ways: Ways, i: int, crossings: Crossings, c: int, green: Bools, step: float) -> None:
    """Lead person i, who stands, over crossing c if it waits for its signal there."""
    ax, ay, length = crossings.along[c, X], crossings.along[c, Y], crossings.length[c]
    on, off = _place(crossings, c, ways.pose[i, X], ways.pose[i, Y])
    onward = 1.0 if on < 0.5 * length else -1.0
    before = -on if onward > 0.0 else on - length
    faces = onward * (ways.faces[i, 0] * ax + ways.faces[i, 1] * ay)
    beside = abs(off) > crossings.half_width[c] + BESIDE
    if ways.turn[i] < math.inf or beside or faces < FACES or not -STEP < before < WAITS_WITHIN:
        return
    _then(ways, i, 0.0, ways.pose[i, X], ways.pose[i, Y], onward * ax, onward * ay)
    _stop_at_red(ways, i, green[c], 0.0, 0.0, step)


@kernel
def _over(ways: Ways, i: int, crossings: Crossings, c: int, nearest: float) -> float:
    """Lead person i over crossing c if it is on it, or comes to it within `nearest` m; how far it
    is."""
    x, y = ways.pose[i, X], ways.pose[i, Y]
    ax, ay = crossings.along[c, X], crossings.along[c, Y]
    length, half = crossings.length[c], crossings.half_width[c]
    on, off = _place(crossings, c, x, y)
    if ways.turn[i] == 0.0:
        return nearest  # it is on another already
    if 0.0 <= on <= length and abs(off) <= half + BESIDE:
        share = ways.faces[i, 0] * ax + ways.faces[i, 1] * ay
        onward = math.copysign(1.0, share if abs(share) > ALONG else 0.5 * length - on)
        _then(ways, i, 0.0, x, y, onward * ax, onward * ay)
        return 0.0
    room = max(half - BESIDE, 0.0)
    aside = min(max(off, -room), room)
    faces_x, faces_y = ways.faces[i, 0], ways.faces[i, 1]
    for onward in (1.0, -1.0):
        end = 0.0 if onward > 0.0 else length
        mx, my = crossings.begin[c, X] + end * ax, crossings.begin[c, Y] + end * ay
        to_x, to_y = mx - aside * ay, my + aside * ax
        away = math.hypot(to_x - x, to_y - y)
        if 0.0 < away < nearest and (mx - x) * faces_x + (my - y) * faces_y > 0.0:
            ways.pose[i, COS], ways.pose[i, SIN] = (to_x - x) / away, (to_y - y) / away
            _then(ways, i, away, to_x, to_y, onward * ax, onward * ay)
            nearest = away
    return nearest


@kernel
def _lets_pass(ego: Approach, c: int, time: float) -> bool:
    """Whether a person who is at crossing c after `time` s waits there for the ego: it would need
    less than GAP_S at the speed that it can have by then.

    One that comes when the ego could be past waits too: the ego may be later.
    """
    if ego.v < SLOW:
        return False
    rise = min(time, (ego.fastest - ego.v) / ego.accel)
    v = ego.v + ego.accel * rise
    driven = ego.v * rise + 0.5 * ego.accel * rise * rise + v * (time - rise)
    away = ego.line[c] if driven < ego.line[c] else ego.over[c]
    return bool(away - driven < GAP_S * v)


@kernel
def _then(ways: Ways, i: int, turn: float, x: float, y: float, cs: float, sn: float) -> None:
    """The second piece of a way."""
    ways.turn[i] = turn
    ways.then[i, X], ways.then[i, Y], ways.then[i, COS], ways.then[i, SIN] = x, y, cs, sn


@kernel
def walked(ways: Ways, i: int, moved: float) -> tuple[float, float, float, float]:
    """Pose of person i after `moved` m: x, y, cosine, sine."""
    moved = min(moved, ways.stop[i])
    second = moved >= ways.turn[i]
    row = ways.then[i] if second else ways.pose[i]
    on = moved - ways.turn[i] if second else moved
    return row[X] + on * row[COS], row[Y] + on * row[SIN], row[COS], row[SIN]
