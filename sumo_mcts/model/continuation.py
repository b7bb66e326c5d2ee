"""Which lane follows each lane of a route, and which lane changes it takes to stay on the route."""

import math
from collections.abc import Collection
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices
from sumo_mcts.numerics.lanes import (
    against_traffic,
    connection,
    facing,
    of_class,
    successors,
    usable,
)
from sumo_mcts.road import PRIORITY, RoadMap

AS_FAR = 1e-6  # m within which lanes count as leading equally far


class Nodes(NamedTuple):
    """The W lanes of a route in driving order, before it is known how they go on."""

    lane: Indices  # [W] lane of the RoadMap
    leg: Indices  # [W] index of the route's edge; internal lanes: of the edge before
    length: Floats  # [W] m
    number: dict[tuple[int, int], int]  # (leg, lane) -> node
    # (leg, lane) -> its paths to the next edge, each [internal lanes..., exit lane]
    following: dict[tuple[int, int], list[list[int]]]


class Continuation(NamedTuple):
    """How W nodes go on; fields as in RouteMap."""

    next: Indices
    changes: Indices
    reach: Floats
    lost: Bools


def _edge_lanes(road: RoadMap, edge: int, vclass: int, oncoming: bool = False) -> list[int]:
    lanes = np.flatnonzero((road.edge == edge) & (oncoming | ~against_traffic(road)))
    return [int(i) for i in lanes[usable(road, lanes, vclass)]]


def collect(
    road: RoadMap,
    edges: tuple[int, ...],
    vclass: int,
    under: tuple[int, ...] = (),
    oncoming: bool = False,
) -> Nodes:
    """All lanes of the route on which a vehicle of this class may drive, and those `under` it; with
    `oncoming` those of oncoming traffic beside them too.

    A lane that was closed under the ego ends, unless all beside it are closed too.
    """
    against = against_traffic(road)
    lanes: list[int] = []
    legs: list[int] = []
    following: dict[tuple[int, int], list[list[int]]] = {}
    for leg, edge in enumerate(edges):
        here = _edge_lanes(road, edge, vclass, oncoming)
        shut = [lane for lane in under if road.edge[lane] == edge and lane not in here]
        lanes += sorted([*here, *shut])
        legs += [leg] * len([*here, *shut])
        if leg + 1 == len(edges):
            break
        target = set(_edge_lanes(road, edges[leg + 1], vclass, oncoming))
        following.update({(leg, lane): [] for lane in shut})
        for lane in here or shut:
            paths = []
            for k in range(road.successor_offset[lane], road.successor_offset[lane + 1]):
                path = connection(road, int(road.successor[k]))
                if against[path[0]] and not _is_plain(road, path[0]):
                    continue  # who comes from aside does not expect the ego there
                if path[-1] in target and usable(road, np.array(path), vclass).all():
                    paths.append(path)
                    lanes += path[:-1]
                    legs += [leg] * (len(path) - 1)
            following[leg, lane] = paths
    number = {key: i for i, key in enumerate(zip(legs, lanes, strict=True))}
    all_lanes = np.array(lanes, np.int64)
    return Nodes(all_lanes, np.array(legs, np.int64), road.length[all_lanes], number, following)


def _is_plain(road: RoadMap, lane: int) -> bool:
    """Whether the junction of a lane is nothing but a road that goes on, in both directions and
    without a signal."""
    there = np.flatnonzero(road.junction == road.junction[lane])
    pair = road.edge[[lane, facing(road)[lane]]]
    alone = np.isin(road.edge[there], pair).all()
    free = (road.rule[there] == PRIORITY).all() and (road.signal[there] < 0).all()
    return bool(alone and free)


def lanes_beside(road: RoadMap, nodes: Nodes, vclass: int) -> tuple[Indices, Indices]:
    """[W] the nodes to the left, and to the right, to which a vehicle of this class may change;
    -1: none."""
    own = of_class(np.array([vclass]))
    found = []
    for side, allowed in ((road.left, road.change_left), (road.right, road.change_right)):
        to = [
            nodes.number.get((leg, other), -1)
            for leg, other in zip(nodes.leg.tolist(), side[nodes.lane].tolist(), strict=True)
        ]
        # SUMO does not change lanes inside a junction
        never = road.internal[nodes.lane] | (allowed[nodes.lane] & own == 0)
        never |= ~usable(road, side[nodes.lane], vclass)
        found.append(np.where(never, -1, np.array(to, np.int64)))
    return found[0], found[1]


class Halt(NamedTuple):
    """The node of the next stop, or waypoint."""

    node: int  # -1: there is none
    place: float  # m: up to where the other lanes lead
    ends: bool  # the route is laid out up to there only


NO_HALT = Halt(-1, math.inf, False)


def continuation(
    road: RoadMap,
    nodes: Nodes,
    beside: tuple[Indices, Indices],
    legs: int,
    halt: Halt = NO_HALT,
) -> Continuation:
    """How every node goes on, as SUMO continues: by the furthest path, then the fewest lane
    changes, then the rightmost. `beside` as of lanes_beside.

    The lane of a stop is the goal of its edge, and the others lead no further than its place.
    """
    w = len(nodes.lane)
    found = Continuation(
        np.full(w, -1, np.int64), np.zeros(w, np.int64), np.zeros(w), np.zeros(w, np.bool_)
    )
    against = against_traffic(road)[nodes.lane]
    for k in range(legs - 1, -1, -1):
        here = np.flatnonzero((nodes.leg == k) & ~road.internal[nodes.lane]).tolist()
        onto = {i: _go_on(nodes, found, i, last=k == legs - 1 and not against[i]) for i in here}
        if halt.node in here:
            _halt(found, nodes, here, halt)
        goes_on = {i: found.reach[i] for i in here if onto[i] >= 0 and not found.lost[onto[i]]}
        for i in here if goes_on else ():
            if onto[i] >= 0 and i not in goes_on:  # SUMO halts it at the end of this lane
                found.next[i], found.reach[i] = -1, float(nodes.length[i])
        furthest = max((found.reach[i] for i in here), default=0.0)
        good = {i for i in here if found.reach[i] >= furthest - AS_FAR}
        if halt.node in here:
            good, goes_on = {halt.node}, {}
        for i in here:
            needed = nearest(good, i, beside)
            if needed is None:  # perhaps the ego can change on the next edge
                needed, found.lost[i] = _onward(goes_on, found.changes, onto, i, beside)
            found.changes[i] = needed
    return found


def changes_onward(road: RoadMap, edges: tuple[int, ...], vclass: int, lane: int) -> int | None:
    """Lane changes from a lane of edges[0], one by one and positive to the left, to the nearest
    lane that leads onto edges[1], and there to one that leads on, and so forth; 0: the lane does,
    or the route ends with its edge.

    None: changes that a vehicle of this class may do lead to no such lane.
    """
    if len(edges) < 2:
        return 0
    nodes = collect(road, edges, vclass)
    beside = lanes_beside(road, nodes, vclass)
    node = nodes.number.get((0, lane))
    return None if node is None else nearest(_leading_on(nodes, beside, len(edges)), node, beside)


def _leading_on(nodes: Nodes, beside: tuple[Indices, Indices], legs: int) -> set[int]:
    """The nodes of the first of `legs` edges that lead onto the next one, to where lane changes
    lead on from; all that lead onto it where none does, since SUMO drives on then."""
    of_leg: list[list[int]] = [[] for _ in range(legs)]
    for leg, lane in nodes.following:
        of_leg[leg].append(lane)
    on, within = set[int](), set(nodes.lane[nodes.leg == legs - 1].tolist())
    for k in range(legs - 2, -1, -1):
        exits = {j: {path[-1] for path in nodes.following[k, j]} for j in of_leg[k]}
        on = {nodes.number[k, j] for j in of_leg[k] if exits[j] & within}
        on = on or {nodes.number[k, j] for j in of_leg[k] if exits[j]}
        within = {j for j in of_leg[k] if nearest(on, nodes.number[k, j], beside) is not None}
    return on


def missed_leg(
    road: RoadMap, edges: tuple[int, ...], vclass: int, lane: int
) -> tuple[int, list[int]]:
    """Where a vehicle that stays in a lane of edges[0] leaves its route, whatever lanes it takes
    further on: the index of the last edge that it drives, and the lanes that it can take there."""
    nodes = collect(road, edges, vclass)
    beside = lanes_beside(road, nodes, vclass)
    leg, lanes = 0, [lane]
    while leg + 1 < len(edges):
        onto = {path[-1] for j in lanes for path in nodes.following.get((leg, j), [])}
        if not onto:
            break
        leg += 1
        those = {nodes.number[leg, j] for j in onto}
        lanes = [
            int(nodes.lane[i])
            for (k, _), i in nodes.number.items()
            if k == leg and not road.internal[nodes.lane[i]]
            and any(nearest([i], start, beside) is not None for start in those)
        ]  # fmt: skip
    return leg, lanes


def leads_onto(road: RoadMap, lane: int, vclass: int) -> dict[int, list[int]]:
    """The edges onto which a vehicle of this class may drive from a lane, and for each the first
    lanes of the paths that lead there."""
    onto: dict[int, list[int]] = {}
    for first in successors(road, lane):
        path = connection(road, first)
        if not road.internal[path[-1]] and usable(road, np.array(path), vclass).all():
            onto.setdefault(int(road.edge[path[-1]]), []).append(first)
    return onto


def _halt(found: Continuation, nodes: Nodes, here: list[int], halt: Halt) -> None:
    """Let the nodes of a stop's edge lead to the stop, and where it is one end there."""
    for i in here:
        if i != halt.node:
            found.reach[i] = min(float(found.reach[i]), halt.place)
        elif halt.ends:
            found.reach[i] = math.inf
        if halt.ends:
            found.next[i] = -1


def _onward(
    goes_on: dict[int, float],
    changes: Indices,
    onto: dict[int, int],
    node: int,
    beside: tuple[Indices, Indices],
) -> tuple[int, bool]:
    """The changes from a node from which the ego cannot reach the lanes that lead furthest, and
    whether the route is lost there.

    They lead to the node that leads furthest of those within reach that go on (`goes_on`: their
    reach); in that node they are those of the next edge, where it leads (`onto`).
    """
    found = {other: nearest([other], node, beside) for other in goes_on}
    within = {other: n for other, n in found.items() if n is not None}
    if not within:
        return 0, True
    best = max(within, key=lambda other: (goes_on[other], -abs(within[other])))
    return within[best] or int(changes[onto[best]]), False


def _go_on(nodes: Nodes, found: Continuation, i: int, *, last: bool) -> int:
    """Fill in the path of node i to the next edge, where it ends there (-1: nowhere). A path to a
    node that is lost ends before it: only up to there can the ego still change."""
    leg, lane, length = int(nodes.leg[i]), int(nodes.lane[i]), nodes.length
    found.reach[i] = math.inf if last else length[i]
    best, ends = (-math.inf, 0), -1
    for path in nodes.following.get((leg, lane), []):
        inner = [nodes.number[leg, j] for j in path[:-1]]
        target = nodes.number[leg + 1, path[-1]]
        beyond = 0.0 if found.lost[target] else float(found.reach[target])
        for a, b in pairwise([*inner, target]):
            found.next[a] = b
        for n, j in enumerate(inner):
            found.reach[j] = float(length[inner[n:]].sum()) + beyond
            found.changes[j] = found.changes[target]
        beyond += float(length[inner].sum())
        rank = (beyond, -abs(int(found.changes[target])))
        if rank > best:
            best, ends = rank, target
            found.next[i] = inner[0] if inner else target
            found.reach[i] = length[i] + beyond
    return ends


def nearest(good: Collection[int], node: int, beside: tuple[Indices, Indices]) -> int | None:
    """Lane changes, one by one, to the nearest of the `good` nodes, positive to the left; None:
    there is no way. `beside` as of lanes_beside."""
    left = right = node
    for n in range(len(beside[0])):
        if right in good:
            return -n
        if left in good:
            return n
        left = int(beside[0][left]) if left >= 0 else -1
        right = int(beside[1][right]) if right >= 0 else -1
        if left < 0 and right < 0:
            break
    return None


def changes_ahead(nxt: Indices, changes: Indices) -> Indices:
    """The most changes on each node's path, to the side of the first.

    With `changes` alone, driving on to where the lanes multiply would look like a loss.
    """
    side, most = np.sign(changes), np.abs(changes)
    for i in range(len(nxt) - 1, -1, -1):
        if nxt[i] >= 0:
            side[i] = side[i] or side[nxt[i]]
            most[i] = max(most[i], most[nxt[i]])
    return side * most
