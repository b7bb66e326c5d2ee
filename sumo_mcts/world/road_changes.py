"""Reads what the running simulation has changed of the road: speed signs, closed lanes, bans of
lane changes. SUMO tells nobody of such changes, so lanes near the ego are read every time."""

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.arrays import Indices
from sumo_mcts.numerics.lanes import against_traffic, jumps
from sumo_mcts.road import LEAST_SPEED, RoadChanges, RoadMap
from sumo_mcts.scene import EgoState
from sumo_mcts.world.links import mask_of
from sumo_mcts.world.nearby import Nearby
from sumo_mcts.world.net_file import MOST_SPEED

AHEAD = 500.0  # m of the ego's route that are read: more than braking from any speed takes
AROUND = 100.0  # m about the ego within which all lanes are read, for those who drive there
# Networks of older versions do not name these classes, and SUMO closes lanes to them.
_UNNAMED = mask_of(frozenset({"rail_fast", "subway", "cable_car"}))
_ON_FOOT = mask_of(frozenset({"pedestrian"}))
_LEFT, _RIGHT = 1, -1  # SUMO's directions of a lane change
_Classes = tuple[str, ...]


class _Read(NamedTuple):
    """What SUMO said of a lane last."""

    speed: float  # m/s
    allowed: _Classes | None  # None: not asked
    left: _Classes | None  # that may change to the left
    right: _Classes | None


class _Lane(NamedTuple):
    """The row of one lane in RoadChanges."""

    speed: float
    classes: int
    change_left: int
    change_right: int


class RoadReader:
    """Remembers what is changed of the lanes that were read."""

    def __init__(self, libsumo: Any, road: RoadMap) -> None:
        self._get, self._road = libsumo.lane, road
        shapes = road.point_offset[:-1]
        self._near = Nearby(
            np.minimum.reduceat(road.points, shapes, axis=0),
            np.maximum.reduceat(road.points, shapes, axis=0),
            AROUND,
        )
        order = np.argsort(road.edge, kind="stable")
        first = np.searchsorted(road.edge[order], np.arange(len(road.edge_ids) + 1))
        self._of_edge = [order[begin:end] for begin, end in pairwise(first)]
        self._driven = road.classes != _ON_FOOT
        self._unknown = against_traffic(road) | jumps(road)  # SUMO does not know these lanes
        self._read: dict[int, _Read] = {}
        self._changed: dict[int, _Lane] = {}
        self.changes = RoadChanges()  # of all lanes, as they were when they were read last

    def look(self, ego: EgoState) -> RoadChanges:
        """Read the lanes around the ego, and those of its route ahead."""
        ahead = self._ahead(ego)
        beside = self._around(ego.x, ego.y)
        self._note(ahead, changing=True)
        self._note(np.setdiff1d(beside, ahead), changing=False)
        return self.changes

    def below(self, ego: EgoState) -> RoadChanges:
        """Read the lane that the ego is on."""
        if ego.lane >= 0:
            self._note(np.array([ego.lane]), changing=False)
        return self.changes

    # --- which lanes ---

    def _ahead(self, ego: EgoState) -> Indices:
        """The lanes of the edges of the ego's route, as far as AHEAD."""
        lanes, left = [np.zeros(0, np.int64)], AHEAD + ego.s
        for edge in ego.route:
            if edge < 0 or left <= 0.0:
                break
            lanes.append(self._of_edge[edge])
            left -= float(self._road.length[self._of_edge[edge][0]])
        return np.concatenate(lanes)

    def _around(self, x: float, y: float) -> Indices:
        """The lanes for vehicles whose bounding box is within AROUND of a place (m)."""
        near = self._near.of(x, y)
        return np.asarray(near[self._driven[near]])

    # --- what has changed ---

    def _note(self, lanes: Indices, *, changing: bool) -> None:
        """Read these lanes; with `changing` also who may change from them."""
        stale = False
        for lane in lanes[~self._unknown[lanes]].tolist():
            known = self._read.get(lane)
            found = self._asked(lane, known, changing=changing)
            if found != known:
                self._read[lane] = found
                stale = self._compare(lane, found) or stale
        if stale:
            self.changes = _table(self._changed)

    def _asked(self, lane: int, known: _Read | None, *, changing: bool) -> _Read:
        """What SUMO says of a lane now. Inside a junction only the limit counts: which classes may
        drive there follows from the connection too, which SUMO does not tell."""
        get, name = self._get, self._road.lane_ids[lane]
        speed = get.getMaxSpeed(name)
        if self._road.internal[lane]:
            return _Read(speed, None, None, None)
        sides = (known.left, known.right) if known is not None else (None, None)
        if changing and (self._road.left[lane] >= 0 or self._road.right[lane] >= 0):
            sides = (get.getChangePermissions(name, _LEFT), get.getChangePermissions(name, _RIGHT))
        return _Read(speed, get.getAllowed(name), *sides)

    def _compare(self, lane: int, read: _Read) -> bool:
        """Whether the row of a lane, there or not, is another one now."""
        road, before = self._road, self._changed.pop(lane, None)
        in_file = _Lane(
            float(road.speed[lane]),
            int(road.classes[lane]),
            int(road.change_left[lane]),
            int(road.change_right[lane]),
        )
        speed = read.speed if math.isfinite(read.speed) else in_file.speed
        asked = (read.allowed, read.left, read.right)
        classes, left, right = (
            was if names is None else mask_of(frozenset(names))
            for names, was in zip(asked, in_file[1:], strict=True)
        )
        classes = classes & ~_UNNAMED | in_file.classes & _UNNAMED
        closed = speed < LEAST_SPEED
        now = _Lane(min(max(speed, LEAST_SPEED), MOST_SPEED), 0 if closed else classes, left, right)
        if now != in_file:
            self._changed[lane] = now
        return self._changed.get(lane) != before


def _table(changed: dict[int, _Lane]) -> RoadChanges:
    """The rows as columns, lanes in rising order."""
    lanes = sorted(changed)
    if not lanes:
        return RoadChanges()
    speed, *masks = zip(*(changed[lane] for lane in lanes), strict=True)
    return RoadChanges(
        np.array(lanes, np.int32), np.array(speed), *(np.array(mask, np.uint64) for mask in masks)
    )
