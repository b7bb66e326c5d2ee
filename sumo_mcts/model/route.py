"""The lanes that an ego may use along its route, in tables for the search: successors, neighbours,
speed limits."""

import heapq
import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices
from sumo_mcts.model.bends import bend_speeds
from sumo_mcts.model.caps import SPACING, fill_caps, slow_down
from sumo_mcts.model.continuation import (
    NO_HALT,
    Halt,
    Nodes,
    changes_ahead,
    collect,
    continuation,
    lanes_beside,
)
from sumo_mcts.model.halts import halt_of
from sumo_mcts.numerics.drawn import Drawing, drawing, drawn_shares
from sumo_mcts.numerics.geometry import COS, SIN, Lines, X, Y, chord, lines_of, point_on
from sumo_mcts.numerics.kernel import entry, kernel
from sumo_mcts.numerics.lanes import against_traffic, home_lanes, jumps, limits
from sumo_mcts.road import ALLWAY, STOP, RoadMap
from sumo_mcts.scene import NO_STOP, Stop

# Columns of RouteMap.table: compiled code is handed one array, since every array in a tuple costs
# at every call.
(
    NEXT,
    LEFT_NODE,
    RIGHT_NODE,
    LENGTH,
    LIMIT,
    STATION,
    REACH,
    STOP_LINE,
    INTERNAL,
    FIRST_ROW,
    LAST_ROW,
    JUNCTION,
    NUMBER,
    OWES,
    HOME,
) = range(15)
HALT_LINE = 2.0  # in column STOP_LINE: the line behind the place of a stop
CAP, DRAWN = 4, 5  # columns of RouteMap.rows after those of the pose
UPSTREAM_VIEW = 200.0  # m before the route over which the lanes that lead into it are followed


class Upstream(NamedTuple):
    """U lanes beside the route that lead into it."""

    lane: Indices  # [U] lane of the RoadMap
    onto: Indices  # [U] the lane of the route that it leads to
    begin: Floats  # [U] where it begins, as that lane counts: negative, m


class RouteMap(NamedTuple):
    """W lanes ("nodes") in driving order:

    `next` always lies later. R table rows. Computed once for a route. Indices are 64 bit wide
    throughout the search, so that compiled states have one type.
    """

    lane: Indices  # [W] lane of the RoadMap
    leg: Indices  # [W] index of the route's edge; internal lanes: of the edge before
    next: Indices  # [W] node driven next, -1: the route ends, or the lane leads nowhere
    left: Indices  # [W]
    right: Indices  # [W]
    length: Floats  # [W] m
    limit: Floats  # [W] speed limit times the ego's speed factor, at most its own top speed, m/s
    station: Floats  # [W] where it begins, m from the start of the route
    # [W] lane changes to the lane of this edge that leads furthest; positive: to the left
    changes: Indices
    # [W] the largest number of changes needed on this node or any after it on its path, with the
    # sign of the first that is needed
    needed: Indices
    # [W] m from the node's start to where the route is lost without a lane change; inf: never
    reach: Floats
    lost: Bools  # [W] from there no lane changes that the ego may do keep it on the route
    stop: Bools  # [W] a stop line at its end: signal, stop sign
    signal: Indices  # [W] signal of that stop line, -1 none
    link: Indices  # [W]
    sign: Bools  # [W] a stop sign: the ego has to stand there first
    internal: Bools  # [W]
    # [W+1] node i owns the table rows row[i]:row[i+1], one every SPACING m, the last at or beyond
    # its end
    row: Indices
    pose: Floats  # [R, 4] centre x, y, cos, sin of the ego's box with its front there
    most: Floats  # [R] the limit, or what bends allow where that is less, m/s
    # [R] highest speed from which approach_decel is enough for all that is lower ahead, and for the
    # ends of lanes
    cap: Floats
    # [W, 15] next .. station, reach, stop, internal, first and last row, and junction, once more,
    # for compiled code; and which lane it is, counted from the right among those that the ego may
    # use, inside junctions 0; and 1 where it may owe something to others (LocalMap.obligation); and
    # of a lane of oncoming traffic the node that it lies beside, -1: an ordinary one
    table: Floats
    # [R, 6] X .. SIN of the pose and CAP, likewise, and the share of the ego's length to which it
    # is drawn there
    rows: Floats
    upstream: Upstream
    oncoming: Bools  # [W] a lane of oncoming traffic, on which the ego may overtake
    drawing: Drawing  # of the whole network
    halt: Halt = NO_HALT  # the next stop: what lies behind it is not reached before it is served


def is_rest_of(route: tuple[int, ...], edges: tuple[int, ...]) -> bool:
    """Whether a vehicle with this route still drives the path that was laid out for `edges`.

    SUMO takes off what lies behind.
    """
    return len(route) > 0 and route == edges[len(edges) - len(route) :]


def moved_to(
    before: RouteMap, now: RouteMap, nodes: tuple[int, ...], values: tuple[float, ...]
) -> dict[int, float]:
    """Values of nodes, by node of the same route laid out anew; without those that are gone."""
    number = {key: i for i, key in enumerate(zip(now.leg.tolist(), now.lane.tolist(), strict=True))}
    return {
        number[key]: value
        for node, value in zip(nodes, values, strict=True)
        if (key := (int(before.leg[node]), int(before.lane[node]))) in number
    }


def stop_ahead(route: RouteMap, node: int, s: float, within: float = math.inf) -> tuple[int, float]:
    """The first node from `node` on that ends at a stop line, and the distance to that line from s,
    m. -1 and inf where there is none `within` m."""
    distance = -s
    while node >= 0 and distance < within:
        distance += float(route.length[node])
        if route.stop[node]:
            return node, distance
        node = int(route.next[node])
    return -1, math.inf


def route_map(
    road: RoadMap,
    edges: tuple[int, ...],
    vclass: int,
    length: float,
    speed_factor: float,
    max_speed: float,
    decel: float,
    under: tuple[int, ...] = (),
    stop: Stop = NO_STOP,
    oncoming: bool = False,
    lateral_accel: float = math.inf,
) -> RouteMap:
    """Lay out the route for a vehicle of this class, length (m), speed factor and top speed (m/s).

    `decel` (m/s2) shapes `cap`; `under`: lanes that the vehicle is on, though they may be closed;
    `oncoming`: lanes of oncoming traffic beside the route count too. A `stop` closes its lane at
    its place, as a stop sign would; a waypoint bounds the speed there. `lateral_accel` (m/s2)
    bounds the speed in bends.
    """
    nodes = collect(road, edges, vclass, under, oncoming)
    halt = halt_of(road, nodes, len(edges), stop)
    lane, leg, node_length, w = nodes.lane, nodes.leg, nodes.length, len(nodes.lane)
    left, right = lanes_beside(road, nodes, vclass)
    nxt, changes, reach, lost = continuation(road, nodes, (left, right), len(edges), halt)
    limit = np.minimum(limits(road, lane, vclass) * speed_factor, max_speed)
    has = nxt >= 0
    entered = np.where(has, lane[nxt], 0)
    signal = np.where(has, road.signal[entered], -1).astype(np.int64)
    sign = has & np.isin(road.rule[entered], (STOP, ALLWAY)) & (signal < 0)
    if halt.ends:
        sign[halt.node] = True
    row = np.zeros(w + 1, np.int64)
    row[1:] = np.cumsum(np.ceil(node_length / SPACING).astype(np.int64) + 1)
    against = against_traffic(road)[lane]
    owes = road.internal[lane] | against | _behind_jumps(road, lane, nxt)
    previous = np.full(w, -1, np.int64)
    previous[nxt[nxt >= 0]] = np.flatnonzero(nxt >= 0)
    station, line, internal = (
        _stations(road, edges, lane, leg, nxt),
        (signal >= 0) | sign,
        road.internal[lane].copy(),
    )
    pose = _poses(road, lane, previous, row, node_length, length)
    drawn = drawing(road)
    closes = line.astype(np.float64)
    if halt.ends:
        closes[halt.node] = HALT_LINE
    cap = np.zeros(row[-1])
    bends = bend_speeds(pose, row, lateral_accel, decel)
    most = np.minimum(np.repeat(limit, np.diff(row)), bends)
    fill_caps(cap, nxt, row, node_length, most, (nxt < 0) & np.isinf(reach), decel)
    if halt.node >= 0 and stop.speed > 0.0:
        slow_down(cap, nxt, row, node_length, halt.node, stop, decel)
    table = np.column_stack(
        [nxt, left, right, node_length, limit, station, reach, closes, internal, row[:-1],
         row[1:] - 1, road.junction[lane], _numbers(road, nodes), owes,
         _homes(road, nodes)]
    ).astype(np.float64)  # fmt: skip
    return RouteMap(
        lane, leg, nxt, left, right, node_length, limit, station, changes,
        changes_ahead(nxt, changes), reach, lost, line, signal,
        np.where(has, road.link[entered], -1).astype(np.int64), sign, internal, row, pose, most,
        cap, table, np.column_stack([pose, cap, _drawn(drawn, lane, row, length)]),
        _upstream(road, lane), against, drawn, halt,
    )  # fmt: skip


def _behind_jumps(road: RoadMap, lane: Indices, nxt: Indices) -> Bools:
    """[W] the nodes onto which the ego jumps over a junction."""
    found = np.zeros(len(lane), np.bool_)
    found[nxt[jumps(road)[lane] & (nxt >= 0)]] = True
    return found


def _numbers(road: RoadMap, nodes: Nodes) -> Indices:
    """[W] which lane of its edge each node is, from the right; 0 inside junctions."""
    found = np.zeros(len(nodes.lane), np.int64)
    for leg in np.unique(nodes.leg):
        here = np.flatnonzero((nodes.leg == leg) & ~road.internal[nodes.lane])
        found[here[np.argsort(road.index[nodes.lane[here]])]] = np.arange(len(here))
    return found


def _homes(road: RoadMap, nodes: Nodes) -> Indices:
    """[W] the node that a lane of oncoming traffic lies beside, -1: it is an ordinary lane."""
    home = np.full(len(road.lane_ids), -1, np.int64)
    home[against_traffic(road)] = home_lanes(road)
    places = zip(nodes.leg.tolist(), home[nodes.lane].tolist(), strict=True)
    return np.array([nodes.number.get(place, -1) for place in places], np.int64)


def _upstream(road: RoadMap, own: Indices) -> Upstream:
    """The lanes that are not among the route's `own` and lead to one of them within UPSTREAM_VIEW
    m; where one leads to several, to the nearest."""
    order = np.argsort(road.successor, kind="stable")
    origin = np.repeat(np.arange(len(road.length)), np.diff(road.successor_offset))[order]
    first = np.searchsorted(road.successor[order], np.arange(len(road.length) + 1))
    seen = set(own.tolist())
    todo = [(0.0, here, here) for here in sorted(seen)]
    found: list[tuple[int, int, float]] = []
    while todo:
        driven, here, onto = heapq.heappop(todo)
        for lane in origin[first[here] : first[here + 1]].tolist():
            if lane in seen:
                continue
            seen.add(lane)
            begin = driven + float(road.length[lane])
            found.append((lane, onto, -begin))
            if begin < UPSTREAM_VIEW:
                heapq.heappush(todo, (begin, lane, onto))
    lanes, onto_lanes, begins = zip(*found, strict=True) if found else ((), (), ())
    return Upstream(np.array(lanes, np.int64), np.array(onto_lanes, np.int64), np.array(begins))


def _stations(
    road: RoadMap, edges: tuple[int, ...], lane: Indices, leg: Indices, nxt: Indices
) -> Floats:
    """Where each node begins, m from the route's start; paths through a junction count as long as
    the longest of them."""
    station = np.zeros(len(lane))
    begin = 0.0
    for k in range(len(edges)):
        here = np.flatnonzero(leg == k)
        ordinary = here[~road.internal[lane[here]]]
        inner = here[road.internal[lane[here]]]
        station[ordinary] = begin
        edge_length = float(road.length[lane[ordinary]].max()) if len(ordinary) else 0.0
        end = begin + edge_length
        station[inner] = end
        for i in inner:
            after = nxt[i]
            if after >= 0 and leg[after] == k:
                station[after] = max(station[after], station[i] + road.length[lane[i]])
        begin = max([end, *(station[i] + road.length[lane[i]] for i in inner)])
    return station


def _drawn(drawn: Drawing, lane: Indices, row: Indices, length: float) -> Floats:
    """Column DRAWN of RouteMap.rows for a vehicle of this length, m."""
    node = np.repeat(np.arange(len(lane)), np.diff(row))
    at = SPACING * (np.arange(row[-1]) - row[node]).astype(np.float64)
    return drawn_shares(drawn, lane[node], at, np.full(len(at), length))


def _poses(
    road: RoadMap, lane: Indices, previous: Indices, row: Indices, length: Floats, vehicle: float
) -> Floats:
    pose = np.zeros((row[-1], 4))
    _fill_poses(pose, lane, previous, row, length, vehicle, lines_of(road))
    return pose


@entry
def _fill_poses(
    pose: Floats,
    lane: Indices,
    previous: Indices,
    row: Indices,
    length: Floats,
    vehicle: float,
    lines: Lines,
) -> None:
    for i in range(len(lane)):
        for k in range(row[i], row[i + 1]):
            s = (k - row[i]) * SPACING
            fx, fy = point_on(lines, lane[i], s)
            node, rear = i, s - vehicle
            while rear < 0.0 and previous[node] >= 0:
                node = previous[node]
                rear += length[node]
            rx, ry = point_on(lines, lane[node], rear)
            _, _, c, n = chord(fx, fy, rx, ry, 1.0, 0.0)
            # the middle of the chord would lie elsewhere where a shape is longer or shorter than
            # its lane
            pose[k, X], pose[k, Y] = fx - 0.5 * vehicle * c, fy - 0.5 * vehicle * n
            pose[k, COS], pose[k, SIN] = c, n


@kernel
def lane_pose(table: Floats, row: Floats, node: int, s: float) -> tuple[float, float, float, float]:
    """Centre x, y, cos and sin of the heading of a box in the middle of its lane, its front at s.

    `table` and `row` as in RouteMap.
    """
    first, last = int(table[node, FIRST_ROW]), int(table[node, LAST_ROW])
    position = max(s, 0.0) / SPACING
    k = min(int(position), last - first - 1)
    share = position - k
    k += first
    c = row[k, COS] + share * (row[k + 1, COS] - row[k, COS])
    n = row[k, SIN] + share * (row[k + 1, SIN] - row[k, SIN])
    norm = math.sqrt(c * c + n * n)
    x = row[k, X] + share * (row[k + 1, X] - row[k, X])
    y = row[k, Y] + share * (row[k + 1, Y] - row[k, Y])
    if s < 0.0:  # still with its front on the lane before
        x, y = x + s * c / norm, y + s * n / norm
    return x, y, c / norm, n / norm
