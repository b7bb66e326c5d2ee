"""The lanes around an ego's trajectory, which a trace keeps for pictures."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from sumo_mcts.arrays import Bools, Floats
from sumo_mcts.numerics.geometry import nearest
from sumo_mcts.numerics.lanes import against_traffic, successors
from sumo_mcts.records import Lanes
from sumo_mcts.road import YIELD, RoadMap


def lanes_around(
    road: RoadMap, routes: Sequence[Sequence[int]], where: Floats, distance: float
) -> Lanes:
    """The lanes with a part within `distance`, m, of the points `where` [K, 2].

    routes: the edges of each route that the ego had.
    """
    near = _near(road, where, distance)
    keep = np.array(
        [near[begin:end].any() for begin, end in pairwise(road.point_offset.tolist())],
        dtype=np.bool_,
    )
    chosen: list[int] = np.flatnonzero(keep).tolist()
    shapes = [road.points[road.point_offset[i] : road.point_offset[i + 1]] for i in chosen]
    on_route = np.zeros(len(road.lane_ids), np.bool_)
    for route in routes:
        on_route |= np.isin(road.edge, np.asarray(route, dtype=np.int32)) & ~road.internal
        on_route |= _between(road, route)
    on_route &= ~against_traffic(road)
    return Lanes(
        lane_ids=tuple(road.lane_ids[i] for i in chosen),
        points=np.concatenate(shapes) if shapes else np.zeros((0, 2)),
        offset=np.cumsum([0, *(len(shape) for shape in shapes)], dtype=np.int32),
        width=road.width[chosen],
        internal=road.internal[chosen],
        route=on_route[chosen],
        stop_lines=np.array(
            [_stop_line(road, i) for i in chosen if _stops(road, i)], dtype=np.float64
        ).reshape(-1, 4),
    )


def _near(road: RoadMap, where: Floats, distance: float) -> Bools:
    """[P] whether the piece of lane that begins at a shape point comes within `distance`, m, of one
    of the points `where` [K, 2]."""
    last = road.point_offset[1:] - 1
    along = np.diff(road.points, axis=0, append=road.points[-1:])
    along[last] = 0.0  # a lane's last point is joined to nothing
    near = np.zeros(len(road.points), dtype=np.bool_)
    for x, y in where.tolist():  # one at a time, for memory's sake
        near |= nearest(road.points, along, x, y)[1] <= distance
    return near


def _between(road: RoadMap, route: Sequence[int]) -> Bools:
    """[L] internal lanes that lead from one edge of the route to the next."""
    result = np.zeros(len(road.lane_ids), dtype=np.bool_)
    for edge, following in pairwise(route):
        for lane in np.flatnonzero((road.edge == edge) & ~road.internal).tolist():
            for entered in successors(road, lane):
                inside = entered
                while (
                    road.internal[inside]
                    and road.edge[road.exit[inside]] == following
                    and not result[inside]
                ):
                    result[inside] = True
                    inside = successors(road, inside)[0]
    return result


def _stops(road: RoadMap, lane: int) -> bool:
    """Whether traffic may have to wait at the end of the lane: a signal, or a connection that has
    to yield."""
    following = successors(road, lane)
    return not road.internal[lane] and bool(
        ((road.signal[following] >= 0) | (road.rule[following] >= YIELD)).any()
    )


def _stop_line(road: RoadMap, lane: int) -> Floats:
    """[4] both ends of the line across the lane's end."""
    before, end = road.points[road.point_offset[lane + 1] - 2 : road.point_offset[lane + 1]]
    along = (end - before) / max(float(np.linalg.norm(end - before)), 1e-9)
    across = np.array([-along[1], along[0]]) * road.width[lane] / 2
    return np.concatenate([end + across, end - across])
