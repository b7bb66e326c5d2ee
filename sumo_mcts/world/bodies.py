"""The centres of vehicles: SUMO gives only the position of the front."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.errors import ConfigError
from sumo_mcts.numerics.drawn import MOST_UNDER
from sumo_mcts.road import RoadMap
from sumo_mcts.world.places import Places
from sumo_mcts.world.vehicle_types import VehicleType


class Body(NamedTuple):
    """Where a vehicle is."""

    x: float  # centre of its box, m
    y: float
    heading: float  # rad
    lane: int  # of the front
    s: float  # lane position of the front, m
    d: float  # offset from the lane's centre line, m, left positive


class BodyReader:
    """Reads the bodies of vehicles, and remembers the lanes under the long ones."""

    def __init__(self, libsumo: Any, road: RoadMap, lanes: Mapping[str, int]) -> None:
        """`lanes`: lane id -> index."""
        self._get, self._road = libsumo.vehicle, road
        self._places = Places(libsumo, road, lanes)
        # the lanes under each articulated vehicle, the present one last
        self._driven: dict[str, tuple[int, ...]] = {}

    def read(self, vehicle: str, kind: VehicleType, px: float, py: float) -> Body:
        """The body of a vehicle of this kind whose front is at (px, py), m."""
        lane, s, d = self._places.of(vehicle)
        if kind.articulated and lane >= 0:
            heading = self._chord(vehicle, lane, s - kind.length, px, py)
        else:
            heading = heading_of(self._get.getAngle(vehicle))
        return Body(
            x=px - 0.5 * kind.length * math.cos(heading),
            y=py - 0.5 * kind.length * math.sin(heading),
            heading=heading,
            lane=lane,
            s=s,
            d=d,
        )

    def _chord(self, vehicle: str, lane: int, rear: float, px: float, py: float) -> float:
        """Heading from the rear, at lane position `rear` (m, negative: on a lane before), to the
        front of a long vehicle at (px, py)."""
        driven = self._driven.get(vehicle, (lane,))
        if driven[-1] != lane:
            changed = self._road.edge[driven[-1]] == self._road.edge[lane]  # beside, not behind
            driven = (*(driven[:-1] if changed else driven[-MOST_UNDER:]), lane)
        self._driven[vehicle] = driven
        for before in driven[-2::-1]:
            if rear >= 0.0:
                break
            lane, rear = before, rear + float(self._road.length[before])
        along = max(rear, 0.0) * self._road.scale[lane]
        first, last = int(self._road.point_offset[lane]), int(self._road.point_offset[lane + 1])
        arc, points = self._road.point_s[first:last], self._road.points[first:last]
        x, y = np.interp(along, arc, points[:, 0]), np.interp(along, arc, points[:, 1])
        return math.atan2(py - float(y), px - float(x))


def heading_of(angle: float) -> float:
    """SUMO's degrees clockwise from north to radians counter-clockwise from east, in (-pi, pi]."""
    heading = math.radians(90.0 - angle)
    return heading + 2 * math.pi if heading <= -math.pi else heading


def require_finite(vehicle: str, *state: float) -> None:
    """Raise ConfigError where the files of a vehicle gave SUMO a position or speed that is no
    number."""
    if not all(map(math.isfinite, state)):
        raise ConfigError(
            f"vehicle {vehicle}: SUMO tells no finite position and speed of it; what its files say "
            "of its departure has to be numbers"
        )
