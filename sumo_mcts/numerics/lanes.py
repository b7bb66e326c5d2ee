"""How to read a road map: which lanes follow a lane, which vehicles may drive there, and the tables
of lanes that kernels read."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.arrays import Bools, Floats, Ints
from sumo_mcts.numerics.kernel import kernel
from sumo_mcts.road import ALLWAY, IGNORING, JUMP, ZIPPER, RoadChanges, RoadMap


def successors(road: RoadMap, lane: int) -> list[int]:
    """The lanes that may be driven next."""
    following: list[int] = road.successor[
        road.successor_offset[lane] : road.successor_offset[lane + 1]
    ].tolist()
    return following


def connection(road: RoadMap, lane: int) -> list[int]:
    """The lanes of a junction from one of them on, then the ordinary lane where they end.

    An ordinary lane is all by itself; where nothing follows the last one is internal.
    """
    path = [lane]
    while road.internal[path[-1]]:
        onward = successors(road, path[-1])
        if not onward or onward[0] in path:
            break
        path.append(onward[0])
    return path


def usable(road: RoadMap, lanes: Ints | NDArray[np.int64] | slice, vclass: int) -> NDArray[Any]:
    """[lanes] whether a vehicle of this class may drive on them."""
    classes = road.classes[lanes]
    return (
        np.ones(len(classes), np.bool_)
        if vclass == IGNORING
        else (classes >> np.uint64(vclass)) & np.uint64(1) == 1
    )


def against_traffic(road: RoadMap) -> Bools:
    """[L] lanes of oncoming traffic as who overtakes there drives them (RoadMap.oncoming)."""
    lanes = len(road.lane_ids)
    return np.arange(lanes) >= lanes - len(road.oncoming)


def jumps(road: RoadMap) -> Bools:
    """[L] lanes that only the map has: of connections on which vehicles jump over a junction."""
    return np.asarray(road.internal & (road.length <= JUMP))


def home_lanes(road: RoadMap) -> Ints:
    """[V] the lanes beside those of oncoming traffic, from which they are entered."""
    return (road.left if road.lefthand else road.right)[against_traffic(road)]


def facing(road: RoadMap) -> Ints:
    """[L] the lane in which the same place is driven the other way round, -1: none."""
    found = np.full(len(road.lane_ids), -1, np.int32)
    against = np.flatnonzero(against_traffic(road))
    found[against] = road.oncoming
    found[road.oncoming] = against
    return found


def opposed(road: RoadMap, one: NDArray[Any], other: NDArray[Any]) -> Bools:
    """Whether lanes belong to two edges whose traffic drives side by side in opposite directions,
    with a lane to overtake in between; the shapes are broadcast."""
    against = np.flatnonzero(against_traffic(road))
    pairs = np.zeros((2, len(road.edge_ids)), np.int64) - 1
    edges, facing_edges = road.edge[against], road.edge[road.oncoming]
    pairs[0, edges], pairs[1, facing_edges] = facing_edges, edges
    a, b = road.edge[one], road.edge[other]
    return np.asarray((pairs[0][a] == b) | (pairs[1][a] == b), dtype=np.bool_)


def limits(
    road: RoadMap, lanes: Ints | NDArray[np.int64], vclass: Ints | NDArray[np.int64] | int
) -> Floats:
    """The limits of lanes for vehicles of a class, m/s; the two shapes are broadcast."""
    if not len(road.class_speed):
        return road.speed[lanes]
    vclass = np.asarray(vclass)
    row = np.where(vclass == IGNORING, -1, road.class_row[np.maximum(vclass, 0)])
    return np.where(row >= 0, road.class_speed[np.maximum(row, 0), lanes], road.speed[lanes])


def limit(road: RoadMap, lane: int, vclass: int) -> float:
    """The limit of a lane for a vehicle of a class, m/s."""
    return float(limits(road, np.array([lane]), vclass)[0])


def with_changes(road: RoadMap, changes: RoadChanges) -> RoadMap:
    """The map as the simulation has changed it; the same map where nothing is changed.

    Limits of single vehicle classes stay: SUMO keeps them, whatever a sign shows.
    """
    lane = changes.lane
    if not len(lane):
        return road
    speed = _put(road.speed, lane, changes.speed)
    classes = _put(road.classes, lane, changes.classes)
    against = np.flatnonzero(against_traffic(road))
    speed[against], classes[against] = speed[home_lanes(road)], classes[road.oncoming]
    over = np.flatnonzero(jumps(road))
    speed[over] = speed[road.exit[over]]
    return road._replace(
        speed=speed,
        classes=classes,
        change_left=_put(road.change_left, lane, changes.change_left),
        change_right=_put(road.change_right, lane, changes.change_right),
    )


def _put(column: NDArray[Any], lane: Ints, now: NDArray[Any]) -> NDArray[Any]:
    """A copy of a column [L] with other values at these lanes [C]."""
    copied = column.copy()
    copied[lane] = now
    return copied


def of_class(vclass: Ints) -> NDArray[np.uint64]:
    """[N] the bits of RoadMap.classes that a vehicle of this class [N] may drive on."""
    return np.where(
        vclass == IGNORING, ~np.uint64(0), np.uint64(1) << np.maximum(vclass, 0).astype(np.uint64)
    )


# --- tables for kernels ---


class Ahead(NamedTuple):
    """How lanes go on; all but `first` as in RoadMap.

    The successors of lane i are successor[first[i]:first[i + 1]].
    """

    first: Ints  # [L+1]
    successor: Ints  # [S]
    direction: Ints  # [L]
    length: Floats  # [L] m
    internal: Bools  # [L]
    edge: Ints  # [L]
    exit: Ints  # [L]
    classes: NDArray[np.uint64]  # [L]
    left: Ints  # [L]
    right: Ints  # [L]


def ahead_of(road: RoadMap) -> Ahead:
    """How the lanes of a network go on."""
    return Ahead(
        first=road.successor_offset,
        successor=road.successor,
        direction=road.direction,
        length=road.length,
        internal=road.internal,
        edge=road.edge,
        exit=road.exit,
        classes=road.classes,
        left=road.left,
        right=road.right,
    )


@kernel
def leads_to(ahead: Ahead, lane: int, other: int) -> bool:
    """Whether a vehicle drives from a lane straight onto the other."""
    found = False
    for k in range(ahead.first[lane], ahead.first[lane + 1]):
        found = found or ahead.successor[k] == other
    return found


class Areas(NamedTuple):
    """Where lanes cross or merge: the conflict areas of lane i are first[i]:first[i + 1].

    All but `first`, `allway` and `zipper` as the fields conflict_... of RoadMap.
    """

    first: Ints  # [L+1]
    other: Ints  # [C] the other lane
    begin: Floats  # [C] m, in positions of this lane
    end: Floats  # [C]
    other_begin: Floats  # [C] m, in positions of the other lane
    other_end: Floats  # [C]
    merge: Bools  # [C]
    yields: Bools  # [C]
    allway: Bools  # [L] the lane is entered as at an all-way stop
    zipper: Bools  # [L] the lane is entered one by one with the other that leads where it leads


def areas_of(road: RoadMap) -> Areas:
    """The conflict areas of a network."""
    return Areas(
        first=road.conflict_offset,
        other=road.conflict_lane,
        begin=road.conflict_begin,
        end=road.conflict_end,
        other_begin=road.conflict_other_begin,
        other_end=road.conflict_other_end,
        merge=road.conflict_merge,
        yields=road.conflict_yields,
        allway=road.rule == ALLWAY,
        zipper=road.rule == ZIPPER,
    )
