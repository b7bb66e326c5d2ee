"""Paths of vehicles from one place on the lanes to another, and places where two vehicles can meet,
for the referee."""

from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.arrays import Bools
from sumo_mcts.numerics.lanes import facing, successors, usable
from sumo_mcts.road import RoadMap

# m along the road by which two boxes may miss each other's stretch and still meet: rounded corners,
# lanes of unequal length
REACH = 5.0


class Drive(NamedTuple):
    """How the front came from one lane position to the next."""

    lanes: tuple[int, ...]  # lanes entered at their start, in order
    lines: tuple[float, ...]  # m driven up to the start of each
    changes: int  # lane changes
    distance: float  # m


def driven(
    road: RoadMap, lane: int, s: float, onto: int, onto_s: float, reach: float
) -> Drive | None:
    """How the front got from (lane, s) to (onto, onto_s) within reach, m, with the fewest lane
    changes. None: not along the lanes."""
    if lane == onto:
        return Drive((), (), 0, onto_s - s) if abs(onto_s - s) <= reach else None
    # breadth first in the number of lane changes; state: lane, m driven to its start, lanes entered
    # and where
    layer: list[tuple[int, float, tuple[int, ...], tuple[float, ...]]] = [(lane, -s, (), ())]
    seen = {lane}
    for changes in range(8):
        k = 0
        while k < len(layer):  # grows while it is read
            here, start, lanes, lines = layer[k]
            k += 1
            if here == onto and start + onto_s <= reach:
                return Drive(lanes, lines, changes, start + onto_s)
            end = start + float(road.length[here])
            for after in successors(road, here) if end <= reach else ():
                if after not in seen:
                    seen.add(after)
                    layer.append((after, end, (*lanes, after), (*lines, end)))
        beside = []
        for here, start, lanes, lines in layer:
            for other in (int(road.left[here]), int(road.right[here])):
                if other >= 0 and other not in seen:
                    seen.add(other)
                    beside.append((other, start, lanes, lines))
        layer = beside
    return None


def can_meet(
    road: RoadMap, first: tuple[int, float, float], second: tuple[int, float, float]
) -> bool:
    """Whether two boxes that overlap in the plane are on the same level.

    Each: lane of the front (-1: none), its position, m, and the box's length, m.
    """
    if first[0] < 0 or second[0] < 0:
        return True
    if second[0] in _conflicting(road, first[0]) or first[0] in _conflicting(road, second[0]):
        return True
    turned_round = facing(road) if len(road.oncoming) else None
    stretches: list[dict[int, tuple[float, float]]] = []
    junctions: list[set[int]] = []
    for lane, s, length in (first, second):
        back, ahead = length + REACH, REACH
        edges: dict[int, tuple[float, float]] = {}
        inside: set[int] = set()
        for there, start in spread(road, lane, s, back, ahead).items():
            _widen(edges, int(road.edge[there]), -back - start, ahead - start)
            over = -1 if turned_round is None else int(turned_round[there])
            if over >= 0:
                end = float(road.length[there]) + start
                _widen(edges, int(road.edge[over]), end - ahead, end + back)
            if road.junction[there] >= 0:
                inside.add(int(road.junction[there]))
        stretches.append(edges)
        junctions.append(inside)
    if junctions[0] & junctions[1]:
        return True
    # positions count too: a ramp may lead over the road that it comes from
    return any(
        stretches[0][e][0] <= stretches[1][e][1] and stretches[1][e][0] <= stretches[0][e][1]
        for e in stretches[0].keys() & stretches[1].keys()
    )


def _widen(edges: dict[int, tuple[float, float]], edge: int, low: float, high: float) -> None:
    """Let the stretch of an edge reach from `low` to `high` too, m."""
    before = edges.get(edge, (inf, -inf))
    edges[edge] = (min(before[0], low), max(before[1], high))


def goal_reaching_edges(road: RoadMap, goal_edge: int, vclass: int) -> Bools:
    """[edges] whether the goal edge can be reached from an edge along lanes that the vehicle class
    may use, lane changes free."""
    allowed = usable(road, np.s_[:], vclass)
    origin = np.repeat(np.arange(len(road.edge)), np.diff(road.successor_offset))
    open_to_it = allowed[origin] & allowed[road.successor]
    source, target = road.edge[origin[open_to_it]], road.edge[road.successor[open_to_it]]
    order = np.argsort(target, kind="stable")
    source = source[order]
    first = np.searchsorted(target[order], np.arange(len(road.edge_ids) + 1))
    reached = np.zeros(len(road.edge_ids), np.bool_)
    reached[goal_edge] = True
    todo = [goal_edge]
    while todo:
        edge = todo.pop()
        for before in source[first[edge] : first[edge + 1]]:
            if not reached[before]:
                reached[before] = True
                todo.append(int(before))
    return reached


def spread(road: RoadMap, lane: int, s: float, back: float, ahead: float) -> dict[int, float]:
    """Lanes within back and ahead, m, of a lane position: lane -> where it starts, m from that
    position, ahead positive."""
    found = {lane: -s}
    todo = [lane]
    while todo:  # forward
        here = todo.pop()
        end = found[here] + float(road.length[here])
        for lane_after in successors(road, here) if end <= ahead else ():
            if lane_after not in found:
                found[lane_after] = end
                todo.append(lane_after)
    seen, todo = {lane}, [lane]
    while todo:  # backward
        here = todo.pop()
        for lane_before in predecessors(road, here) if found[here] >= -back else ():
            if lane_before not in seen:
                seen.add(lane_before)
                found.setdefault(lane_before, found[here] - float(road.length[lane_before]))
                todo.append(lane_before)
    return found


def predecessors(road: RoadMap, lane: int) -> list[int]:
    """Asked for so seldom that a search through all lanes is cheaper than an index."""
    links = np.flatnonzero(road.successor == lane)
    lanes: list[int] = (np.searchsorted(road.successor_offset, links, side="right") - 1).tolist()
    return lanes


def _conflicting(road: RoadMap, lane: int) -> NDArray[np.int32]:
    return road.conflict_lane[road.conflict_offset[lane] : road.conflict_offset[lane + 1]]
