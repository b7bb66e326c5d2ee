"""The lanes that an ego may use along its route, in tables for the search: successors, neighbours,
speed limits."""

import heapq
import math
from collections.abc import Collection
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from sumo_mcts.numerics.geometry import COS, SIN, Lines, X, Y, chord, lines_of, point_on
from sumo_mcts.numerics.kernel import entry, kernel
from sumo_mcts.numerics.lanes import connection, limits, of_class, usable
from sumo_mcts.scene import ALLWAY, STOP, Bools, Floats, Indices, RoadMap

SPACING = 1.0  # m between the rows of the pose and speed tables

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
) = range(12)
CAP = 4  # column of RouteMap.rows after those of the pose
END_GAP = 1.5  # m kept to the end of a lane that leads nowhere
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
    stop: Bools  # [W] a stop line at its end: signal, stop sign
    signal: Indices  # [W] signal of that stop line, -1 none
    link: Indices  # [W]
    sign: Bools  # [W] a stop sign: the ego has to stand there first
    internal: Bools  # [W]
    # [W+1] node i owns the table rows row[i]:row[i+1], one every SPACING m, the last at or beyond
    # its end
    row: Indices
    pose: Floats  # [R, 4] centre x, y, cos, sin of the ego's box with its front there
    # [R] highest speed from which approach_decel is enough for all lower limits and lane ends ahead
    cap: Floats
    # [W, 12] next .. station, reach, stop, internal, first and last row, and junction, once more,
    # for compiled code
    table: Floats
    rows: Floats  # [R, 5] X .. SIN of the pose and CAP, likewise
    upstream: Upstream


def is_rest_of(route: tuple[int, ...], edges: tuple[int, ...]) -> bool:
    """Whether a vehicle with this route still drives the path that was laid out for `edges`.

    SUMO takes off what lies behind.
    """
    return len(route) > 0 and route == edges[len(edges) - len(route) :]


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
) -> RouteMap:
    """Lay out the route for a vehicle of this class, length (m), speed factor and top speed (m/s).

    `decel` (m/s2) shapes `cap`.
    """
    lanes, legs, following = _collect(road, edges, vclass)
    w = len(lanes)
    lane, leg = np.array(lanes, np.int64), np.array(legs, np.int64)
    position = {(int(leg[i]), int(lane[i])): i for i in range(w)}
    node_length = road.length[lane]
    left, right = (
        np.array([position.get((int(leg[i]), int(side[lane[i]])), -1) for i in range(w)], np.int64)
        for side in (road.left, road.right)
    )
    own = of_class(np.array([vclass]))
    # SUMO does not change lanes inside a junction
    left[road.internal[lane] | (road.change_left[lane] & own == 0)] = -1
    right[road.internal[lane] | (road.change_right[lane] & own == 0)] = -1
    nxt, changes, reach = _continuations(
        road, lane, leg, following, node_length, (left, right), len(edges)
    )
    limit = np.minimum(limits(road, lane, vclass) * speed_factor, max_speed)
    has = nxt >= 0
    entered = np.where(has, lane[nxt], 0)
    signal = np.where(has, road.signal[entered], -1).astype(np.int64)
    sign = has & np.isin(road.rule[entered], (STOP, ALLWAY)) & (signal < 0)
    row = np.zeros(w + 1, np.int64)
    row[1:] = np.cumsum(np.ceil(node_length / SPACING).astype(np.int64) + 1)
    last = leg == len(edges) - 1
    previous = np.full(w, -1, np.int64)
    previous[nxt[nxt >= 0]] = np.flatnonzero(nxt >= 0)
    station, stop, internal = (
        _stations(road, edges, lane, leg, nxt),
        (signal >= 0) | sign,
        road.internal[lane].copy(),
    )
    pose = _poses(road, lane, previous, row, node_length, length)
    cap = np.zeros(row[-1])
    _fill_caps(cap, nxt, row, node_length, limit, last & ~internal, decel)
    return RouteMap(
        lane, leg, nxt, left, right, node_length, limit, station, changes, _needed(nxt, changes),
        reach, stop, signal,
        np.where(has, road.link[entered], -1).astype(np.int64), sign, internal, row, pose, cap,
        np.column_stack([nxt, left, right, node_length, limit, station, reach, stop, internal,
        row[:-1], row[1:] - 1, road.junction[lane]]).astype(np.float64),
        np.column_stack([pose, cap]), _upstream(road, lane),
    )  # fmt: skip


def _edge_lanes(road: RoadMap, edge: int, vclass: int) -> list[int]:
    lanes = np.flatnonzero(road.edge == edge)
    return [int(i) for i in lanes[usable(road, lanes, vclass)]]


def _collect(
    road: RoadMap, edges: tuple[int, ...], vclass: int
) -> tuple[list[int], list[int], dict[tuple[int, int], list[list[int]]]]:
    """All lanes of the route in driving order, their legs, and for each (leg, lane) its paths on.

    A path is [internal lanes..., exit lane].
    """
    lanes: list[int] = []
    legs: list[int] = []
    following: dict[tuple[int, int], list[list[int]]] = {}
    for leg, edge in enumerate(edges):
        here = _edge_lanes(road, edge, vclass)
        lanes += here
        legs += [leg] * len(here)
        if leg + 1 == len(edges):
            break
        target = set(_edge_lanes(road, edges[leg + 1], vclass))
        for lane in here:
            paths = []
            for k in range(road.successor_offset[lane], road.successor_offset[lane + 1]):
                path = connection(road, int(road.successor[k]))
                if path[-1] in target and usable(road, np.array(path), vclass).all():
                    paths.append(path)
                    lanes += path[:-1]
                    legs += [leg] * (len(path) - 1)
            following[leg, lane] = paths
    return lanes, legs, following


def _continuations(
    road: RoadMap,
    lane: Indices,
    leg: Indices,
    following: dict[tuple[int, int], list[list[int]]],
    length: Floats,
    beside: tuple[Indices, Indices],
    legs: int,
) -> tuple[Indices, Indices, Floats]:
    """next, changes and reach of every node, as SUMO continues: the furthest path, then the fewest
    lane changes, then the rightmost. `beside`: the nodes to the left and right to which the ego
    may change."""
    w = len(lane)
    nxt, changes, reach = np.full(w, -1, np.int64), np.zeros(w, np.int64), np.zeros(w)
    entered = np.zeros(w)  # reach; 0: the ego would be in a lane that it cannot leave in time
    nodes = {(int(leg[i]), int(lane[i])): i for i in range(w)}
    for k in range(legs - 1, -1, -1):
        here = [i for i in np.flatnonzero(leg == k).tolist() if not road.internal[lane[i]]]
        for i in here:
            reach[i] = math.inf if k == legs - 1 else length[i]
            best: tuple[float, int] | None = None
            for path in following.get((k, int(lane[i])), []):
                inner = [nodes[k, j] for j in path[:-1]]
                target = nodes[k + 1, path[-1]]
                beyond = float(sum(length[j] for j in inner)) + entered[target]
                for a, b in pairwise([*inner, target]):
                    nxt[a] = b
                for n, j in enumerate(inner):
                    reach[j] = float(sum(length[m] for m in inner[n:])) + entered[target]
                    changes[j] = changes[target]
                rank = (beyond, -abs(int(changes[target])))
                if best is None or rank > best:
                    best, nxt[i] = rank, inner[0] if inner else target
                    reach[i] = length[i] + beyond
        furthest = max((reach[i] for i in here), default=0.0)
        good = {i for i in here if reach[i] >= furthest - 1e-6}
        for i in here:
            changes[i], entered[i] = changes[nxt[i]] if nxt[i] >= 0 else 0, reach[i]
            found = _changes_to(good, i, beside)
            if found is not None:
                changes[i] = found
            elif nxt[i] < 0 or reach[i] <= length[i]:
                entered[i] = 0.0
    return nxt, changes, reach


def _changes_to(good: Collection[int], node: int, beside: tuple[Indices, Indices]) -> int | None:
    """Lane changes, one by one, to the nearest of the `good` nodes, positive to the left; None:
    there is no way. `beside` as in _continuations."""
    left = right = node
    for n in range(len(beside[0])):
        if right in good:
            return -n
        if left in good:
            return n
        left, right = (
            int(side[at]) if at >= 0 else -1 for side, at in zip(beside, (left, right), strict=True)
        )
        if left < 0 and right < 0:
            break
    return None


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


def _needed(nxt: Indices, changes: Indices) -> Indices:
    """The most changes on each node's path, to the side of the first.

    With `changes` alone, driving on to where the lanes multiply would look like a loss.
    """
    side, most = np.sign(changes), np.abs(changes)
    for i in range(len(nxt) - 1, -1, -1):
        if nxt[i] >= 0:
            side[i] = side[i] or side[nxt[i]]
            most[i] = max(most[i], most[nxt[i]])
    return side * most


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


@entry
def _fill_caps(
    cap: Floats,
    nxt: Indices,
    row: Indices,
    length: Floats,
    limit: Floats,
    goal: Bools,
    decel: float,
) -> None:
    """RouteMap.cap [R], backward over the nodes: v^2 = v_next^2 + 2 b d."""
    for i in range(len(nxt) - 1, -1, -1):
        end = limit[i] if goal[i] else 0.0
        distance = -END_GAP
        if nxt[i] >= 0:
            end, distance = min(limit[i], cap[row[nxt[i]]]), 0.0
        elif goal[i]:
            distance = 0.0
        for k in range(row[i + 1] - 1, row[i] - 1, -1):
            to_end = max(0.0, length[i] - (k - row[i]) * SPACING + distance)
            cap[k] = min(limit[i], math.sqrt(end * end + 2.0 * decel * to_end))
        beyond = row[i + 1] - 1
        share = length[i] / SPACING - (beyond - 1 - row[i])
        # between the last two rows `end` is to be read where the lane ends
        if nxt[i] >= 0 and share > 1e-6:
            cap[beyond] = max(0.0, cap[beyond - 1] + (end - cap[beyond - 1]) / share)


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
