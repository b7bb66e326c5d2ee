"""Lanes of oncoming traffic as who overtakes there drives them: SUMO's `neigh` of a leftmost lane,
turned round and put beside it."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from sumo_mcts.arrays import Ints
from sumo_mcts.road import RoadMap

AS_LONG = 1.0  # m by which the two lanes may differ in length: positions are counted side by side


def with_oncoming(road: RoadMap, beside: Mapping[int, int]) -> RoadMap:
    """The network with a lane more for each of `beside`: leftmost lane -> lane of the oncoming.

    Left out are pairs that differ in length, those inside junctions, and all where traffic drives
    on the left.
    """
    pairs = [(own, other) for own, other in sorted(beside.items()) if _fits(road, own, other)]
    if road.lefthand or not pairs:
        return road
    own, other = (np.array(lanes, np.int32) for lanes in zip(*pairs, strict=True))
    count, more = len(road.length), len(own)
    new = np.arange(count, count + more, dtype=np.int32)
    last = road.lane_ids
    changes: dict[str, Any] = {
        name: np.concatenate([values, values[own]])
        for name, values in road._asdict().items()
        if isinstance(values, np.ndarray) and name in _OF_LANES
    }
    for name in ("length", "scale", "width", "classes"):
        changes[name][new] = getattr(road, name)[other]
    changes["index"][new] += 1
    changes["left"][own], changes["left"][new], changes["right"][new] = new, -1, own
    changes["change_left"][new], changes["change_right"][new] = 0, ~np.uint64(0)
    changes["exit"][new] = new
    shapes = [road.points[road.point_offset[i] : road.point_offset[i + 1]][::-1] for i in other]
    arcs = [road.point_s[road.point_offset[i] : road.point_offset[i + 1]] for i in other]
    return road._replace(
        **changes,
        lane_ids=(*last, *(_beside(last[i]) for i in own)),
        class_speed=np.concatenate([road.class_speed, road.class_speed[:, own]], axis=1),
        points=np.concatenate([road.points, *shapes]),
        point_s=np.concatenate([road.point_s, *(arc[-1] - arc[::-1] for arc in arcs)]),
        point_offset=_longer(road.point_offset, [len(shape) for shape in shapes]),
        successor_offset=_longer(road.successor_offset, [0] * more),
        conflict_offset=_longer(road.conflict_offset, [0] * more),
        oncoming=other,
    )


# The fields of a RoadMap with one number for each lane.
_OF_LANES = (
    "edge", "index", "internal", "length", "scale", "width", "speed", "classes", "change_left",
    "change_right", "left", "right", "exit", "direction", "junction", "knot", "begins", "ends",
    "rule", "signal", "link",
)  # fmt: skip


def _fits(road: RoadMap, own: int, other: int) -> bool:
    """Whether the lane of the oncoming runs beside a leftmost lane from end to end."""
    ordinary = not (road.internal[own] or road.internal[other])
    as_long = abs(float(road.length[own] - road.length[other])) < AS_LONG
    return ordinary and as_long and road.left[own] < 0 and own != other


def _beside(name: str) -> str:
    """The id of the lane to the left of this one."""
    edge, _, number = name.rpartition("_")
    return f"{edge}_{int(number) + 1}"


def _longer(offset: Ints, counts: list[int]) -> Ints:
    """Offsets [n+1] and those of further parts of these sizes."""
    return np.concatenate([offset, offset[-1] + np.cumsum(counts)]).astype(np.int32)
