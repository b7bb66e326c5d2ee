"""Lanes of oncoming traffic as who overtakes there drives them: SUMO's `neigh` of the lane in the
middle of the road, turned round and put beside it."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from sumo_mcts.arrays import Ints
from sumo_mcts.numerics.lanes import connection, successors
from sumo_mcts.road import STRAIGHT, RoadMap

AS_LONG = 1.0  # m by which the two lanes may differ in length: positions are counted side by side


def with_oncoming(road: RoadMap, beside: Mapping[int, int]) -> RoadMap:
    """The network with a lane more for each of `beside`: lane in the middle of the road -> lane of
    the oncoming.

    Left out are pairs that differ in length, and those inside junctions but where the road goes
    straight on: there the lane of the oncoming leads into the next one.
    """
    pairs = {own: other for own, other in sorted(beside.items()) if _fits(road, own, other)}
    if not pairs:
        return road
    inside = _through_junctions(road, pairs, beside)
    pairs.update(inside)
    own, other = (np.array(lanes, np.int32) for lanes in zip(*pairs.items(), strict=True))
    count, more = len(road.length), len(own)
    new = np.arange(count, count + more, dtype=np.int32)
    number = dict(zip(pairs, new.tolist(), strict=True))
    after = [_after(road, lane, inside, number) for lane in pairs]
    last = road.lane_ids
    changes: dict[str, Any] = {
        name: np.concatenate([values, values[own]])
        for name, values in road._asdict().items()
        if isinstance(values, np.ndarray) and name in OF_LANES
    }
    for name in ("length", "scale", "width", "classes"):
        changes[name][new] = getattr(road, name)[other]
    changes["exit"][new] = [number[lane] for lane in road.exit[own].tolist()]
    _put_beside(changes, road, own, new)
    shapes = [road.points[road.point_offset[i] : road.point_offset[i + 1]][::-1] for i in other]
    arcs = [road.point_s[road.point_offset[i] : road.point_offset[i + 1]] for i in other]
    return road._replace(
        **changes,
        lane_ids=(*last, *(_beside(last[i]) for i in own)),
        class_speed=np.concatenate([road.class_speed, road.class_speed[:, own]], axis=1),
        points=np.concatenate([road.points, *shapes]),
        point_s=np.concatenate([road.point_s, *(arc[-1] - arc[::-1] for arc in arcs)]),
        point_offset=longer(road.point_offset, [len(shape) for shape in shapes]),
        successor=np.concatenate([road.successor, *after]).astype(np.int32),
        successor_offset=longer(road.successor_offset, [len(lanes) for lanes in after]),
        conflict_offset=longer(road.conflict_offset, [0] * more),
        oncoming=other,
    )


# The fields of a RoadMap with one number for each lane.
OF_LANES = (
    "edge", "index", "internal", "length", "scale", "width", "speed", "classes", "change_left",
    "change_right", "left", "right", "exit", "direction", "junction", "knot", "begins", "ends",
    "rule", "signal", "link",
)  # fmt: skip


def _put_beside(changes: dict[str, Any], road: RoadMap, own: Ints, new: Ints) -> None:
    """Put each new lane on the far side of its own lane: left, or right where traffic drives on the
    left."""
    far, near = ("right", "left") if road.lefthand else ("left", "right")
    changes[far][own], changes[far][new], changes[near][new] = new, -1, own
    changes[f"change_{far}"][new], changes[f"change_{near}"][new] = 0, ~np.uint64(0)
    index = changes["index"]
    if road.lefthand:  # lanes are counted from the right
        index[np.isin(changes["edge"], changes["edge"][new])] += 1
        index[new] = 0
    else:
        index[new] += 1


def _fits(road: RoadMap, own: int, other: int) -> bool:
    """Whether the lane of the oncoming runs beside a lane in the middle of the road from end to
    end."""
    ordinary = not (road.internal[own] or road.internal[other])
    as_long = abs(float(road.length[own] - road.length[other])) < AS_LONG
    in_the_middle = (road.right if road.lefthand else road.left)[own] < 0
    return ordinary and as_long and bool(in_the_middle) and own != other


def _through_junctions(
    road: RoadMap, pairs: Mapping[int, int], beside: Mapping[int, int]
) -> dict[int, int]:
    """The lanes inside junctions, with those of the oncoming, that lead straight on from one of
    `pairs` to another: SUMO's drivers go on overtaking there."""
    found = {}
    for own, other in pairs.items():
        for inside in successors(road, own):
            facing = beside.get(inside, -1)
            onto = connection(road, inside)[1:]
            if facing < 0 or len(onto) != 1 or onto[0] not in pairs:
                continue
            comes_from = pairs[onto[0]]
            leads_back = connection(road, facing)[1:] == [other]
            if leads_back and facing in successors(road, comes_from):
                if road.direction[inside] == road.direction[facing] == STRAIGHT:
                    found[inside] = facing
    return found


def _after(
    road: RoadMap, own: int, inside: Mapping[int, int], number: Mapping[int, int]
) -> list[int]:
    """The lanes into which the new lane beside `own` leads; `number`: own lane -> new lane."""
    if road.internal[own]:
        return [number[lane] for lane in successors(road, own)]
    return [number[lane] for lane in successors(road, own) if lane in inside]


def _beside(name: str) -> str:
    """The id of the lane beyond this one: SUMO counts lanes from the edge of the road."""
    edge, _, number = name.rpartition("_")
    return f"{edge}_{int(number) + 1}"


def longer(offset: Ints, counts: list[int]) -> Ints:
    """Offsets [n+1] and those of further parts of these sizes."""
    return np.concatenate([offset, offset[-1] + np.cumsum(counts)]).astype(np.int32)
