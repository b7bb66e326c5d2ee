"""Junctions without lanes inside, over which vehicles jump: in the map each connection there has a
lane of its own, so that lights, signs and right of way have their place."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sumo_mcts.arrays import Floats
from sumo_mcts.numerics.lanes import successors
from sumo_mcts.road import JUMP, RoadMap
from sumo_mcts.world.conflicts import TINY, Conflict
from sumo_mcts.world.links import Link, has_bit
from sumo_mcts.world.oncoming import OF_LANES, longer

# What a lane of a jump has from the lane onto which it leads.
_OF_EXIT = ("width", "speed", "classes", "change_left", "change_right")


def with_jumps(road: RoadMap, links: Sequence[Link]) -> RoadMap:
    """The network with one lane more, JUMP m long, for each connection that has none; the same
    network where all have.

    As in SUMO the way over it is no way at all: what a vehicle drives lies before it or behind.
    """
    jumps = [link for link in links if not link.chain]
    if not jumps:
        return road
    count, more = len(road.lane_ids), len(jumps)
    new = np.arange(count, count + more, dtype=np.int32)
    origin, exits = (np.array([getattr(link, end) for link in jumps], np.int32)
                     for end in ("origin", "exit"))  # fmt: skip
    shapes = [_line(road, *ends) for ends in zip(origin, exits, strict=True)]
    arc = np.array([np.linalg.norm(shape[1] - shape[0]) for shape in shapes])
    after = _after(road, jumps, new.tolist())
    conflicts = sorted(_conflicts(jumps, count))
    names = [f":{road.junction_ids[link.junction]}_over{k}" for k, link in enumerate(jumps)]
    changes: dict[str, Any] = {
        name: np.concatenate([getattr(road, name), values]).astype(getattr(road, name).dtype)
        for name, values in _columns(road, jumps, origin, exits).items()
    }
    changes["edge"][new] = len(road.edge_ids) + np.arange(more)
    changes["scale"][new] = arc / JUMP
    return road._replace(
        **changes,
        lane_ids=(*road.lane_ids, *(f"{name}_0" for name in names)),
        edge_ids=(*road.edge_ids, *names),
        class_speed=np.concatenate([road.class_speed, road.class_speed[:, exits]], axis=1),
        points=np.concatenate([road.points, *shapes]),
        point_s=np.concatenate([road.point_s, np.column_stack([0.0 * arc, arc]).ravel()]),
        point_offset=longer(road.point_offset, [2] * more),
        successor=np.concatenate([np.array(lanes, np.int32) for lanes in after]),
        successor_offset=longer(np.zeros(1, np.int32), [len(lanes) for lanes in after]),
        **_conflict_columns(road, conflicts, new.tolist()),
    )


def _columns(
    road: RoadMap, jumps: Sequence[Link], origin: Any, exits: Any
) -> dict[str, Sequence[Any]]:
    """What the new lanes have in the columns of RoadMap with one number for each lane."""
    none, knot = [-1] * len(jumps), road.ends[origin]
    found: dict[str, Any] = dict.fromkeys(OF_LANES, np.zeros(len(jumps)))
    found |= {name: getattr(road, name)[exits] for name in _OF_EXIT}
    found |= dict.fromkeys(("left", "right"), none) | dict.fromkeys(
        ("knot", "begins", "ends"), knot
    )
    found["classes"] = [
        int(classes) & link.classes
        for classes, link in zip(road.classes[exits], jumps, strict=True)
    ]
    of_link = ("exit", "direction", "junction", "rule", "signal")
    found |= {name: [getattr(link, name) for link in jumps] for name in of_link}
    found |= {
        "internal": [True] * len(jumps),
        "length": [JUMP] * len(jumps),
        "link": [link.signal_link for link in jumps],
    }
    return found


def _line(road: RoadMap, origin: int, onto: int) -> Floats:
    """[2, 2] from the end of a lane to the start of another one, m; TINY long at least."""
    ends = road.points[[road.point_offset[origin + 1] - 1, road.point_offset[onto]]]
    if np.linalg.norm(ends[1] - ends[0]) < TINY:
        along = road.points[road.point_offset[onto] + 1] - ends[1]
        ends[1] = ends[0] + TINY * along / np.linalg.norm(along)
    return ends


def _after(road: RoadMap, jumps: Sequence[Link], new: Sequence[int]) -> list[list[int]]:
    """[L] the successors of each lane: where it jumps, the new lane, and of that where it leads."""
    over = {(link.origin, link.exit): lane for link, lane in zip(jumps, new, strict=True)}
    return [
        *([over.get((lane, onto), onto) for onto in successors(road, lane)]
          for lane in range(len(road.lane_ids))),
        *([link.exit] for link in jumps),
    ]  # fmt: skip


def _conflicts(jumps: Sequence[Link], first: int) -> list[Conflict]:
    """Where the lanes of jumps, numbered from `first` on, meet: all of one that SUMO holds to meet
    all of the other, or that leads where the other leads."""
    of_junction: dict[int, list[int]] = {}
    for k, link in enumerate(jumps):
        of_junction.setdefault(link.junction, []).append(k)
    return [
        Conflict(
            first + i, first + k, 0.0, JUMP, 0.0, JUMP, jumps[i].exit == jumps[k].exit,
            has_bit(jumps[i].yields_to, jumps[k]),
        )
        for those in of_junction.values()
        for i in those
        for k in those
        if jumps[i].origin != jumps[k].origin and _meet(jumps[i], jumps[k])
    ]  # fmt: skip


def _meet(a: Link, b: Link) -> bool:
    return a.exit == b.exit or has_bit(a.foes, b) or has_bit(b.foes, a)


def _conflict_columns(
    road: RoadMap, conflicts: Sequence[Conflict], new: Sequence[int]
) -> dict[str, Any]:
    """The fields conflict_... with those of the `new` lanes behind the others."""
    counts = [0] * len(new)
    for each in conflicts:
        counts[each.lane - new[0]] += 1
    columns: Any = zip(*conflicts, strict=True) if conflicts else ([],) * len(Conflict._fields)
    names = ("lane", "begin", "end", "other_begin", "other_end", "merge", "yields")
    found: dict[str, Any] = {
        f"conflict_{name}": np.concatenate(
            [(old := getattr(road, f"conflict_{name}")), np.array(values, old.dtype)]
        )
        for name, values in zip(names, list(columns)[1:], strict=True)
    }
    return {**found, "conflict_offset": longer(road.conflict_offset, counts)}
