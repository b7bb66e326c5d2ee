"""The stops of a vehicle's schedule, as SUMO counts them.

SUMO takes a stop for reached where the vehicle's front is beyond the start of its place, on its
lane, at no more than 0.1 m/s; in a parking area it has to stand right before the end of a free lot.
Then it holds the vehicle, whatever it is commanded. A stop that was passed stays in the schedule,
and SUMO halts the vehicle at the end of the edge.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from sumo_mcts.road import RoadMap
from sumo_mcts.scene import NO_STOP, STANDING, Stop
from sumo_mcts.world.library import running_sumo
from sumo_mcts.world.simulation import is_ballistic, step_length

_BUS, _CHARGING, _PARKING = 8, 32, 64  # bits of a stop's flags
_ACCEPTED = 0.2  # m before the end of a lot within which a stand counts
_SHORT = 0.02  # m before the end of a place at which the ego is to stand


def skip_next(vehicle: str) -> None:
    """Take the next stop out of a vehicle's schedule, if it has one.

    A stop that was passed would have SUMO halt the vehicle at the end of the edge.
    """
    get = running_sumo().vehicle
    if get.getStops(vehicle, 1):
        get.replaceStop(vehicle, 0, "")


class StopReader:
    """The next stop of vehicles."""

    def __init__(self, libsumo: Any, road: RoadMap, lanes: Mapping[str, int]) -> None:
        """`lanes`: lane id -> index in `road`."""
        self._libsumo, self._road, self._lanes = libsumo, road, lanes
        self._edges = {edge: i for i, edge in enumerate(road.edge_ids)}
        self._lots: dict[str, int] = {}  # of parking areas
        self._step = step_length()  # s
        # braking takes less where positions follow the speed at the end of a step: s of driving
        self._shorter = 0.0 if is_ballistic() else 0.5 * self._step

    def read(self, vehicle: str, route: tuple[int, ...], lane: int, s: float) -> tuple[Stop, bool]:
        """The next stop of a vehicle on `lane` at `s` (m) with this route, and whether SUMO has the
        vehicle stand at it."""
        get = self._libsumo.vehicle
        listed = get.getStops(vehicle, 1)
        if not listed:
            return NO_STOP, False
        data, held = listed[0], self.is_held(vehicle)
        at = self._lanes.get(data.lane, -1)
        if at < 0:
            at = self._any_lane(get.getStopParameter(vehicle, 0, "edge"), lane)
        edge = int(self._road.edge[at]) if at >= 0 else -1
        if edge not in route:
            return NO_STOP, held
        first = route.index(edge)
        here = lane >= 0 and int(self._road.edge[lane]) == edge
        if here and first == 0 and not held and s > data.endPos and edge in route[1:]:
            first = route.index(edge, 1)  # on its next round
        begin, place = float(data.startPos), float(data.endPos) - _SHORT
        if not held and data.stopFlags & (_BUS | _CHARGING):
            place = min(place, self._behind_others(vehicle, data) - _SHORT)
        if data.stopFlags & _PARKING and not held:
            v = float(get.getSpeed(vehicle))
            braking = max(v / (2.0 * get.getDecel(vehicle)) - self._shorter, 0.0) * v
            ahead = s + braking if here and first == 0 else 0.0
            # SUMO takes a step to see that it stands
            refused = v < STANDING and get.getWaitingTime(vehicle) > 1.5 * self._step
            place = self._lot(data, ahead + (_ACCEPTED if refused else 0.0)) - _SHORT
        speed = max(float(data.speed), 0.0)
        waits = speed > 0.0 and float(data.until) > float(self._libsumo.simulation.getTime())
        return Stop(at, begin, max(place, begin), speed, len(route) - 1 - first, waits), held

    def is_held(self, vehicle: str) -> bool:
        """Whether SUMO has a vehicle stand at its next stop."""
        get = self._libsumo.vehicle
        if not get.isStopped(vehicle):
            return False
        return float(get.getStops(vehicle, 1)[0].speed) <= 0.0

    def _any_lane(self, edge: str, lane: int) -> int:
        """The lane of a stop that any lane of an edge will do for: the vehicle's own, if it is on
        the edge, else the rightmost with the most classes."""
        number = self._edges.get(edge, -1)
        if lane >= 0 and int(self._road.edge[lane]) == number:
            return lane
        found: list[int] = np.flatnonzero(self._road.edge == number).tolist()
        return max(found, key=lambda i: (int(self._road.classes[i]).bit_count(), -i), default=-1)

    def _behind_others(self, vehicle: str, data: Any) -> float:
        """Where a vehicle is to stand behind those that stand at the same bus stop or charging
        station, m; inf: there are none."""
        get, sumo = self._libsumo.vehicle, self._libsumo
        domain = sumo.busstop if data.stopFlags & _BUS else sumo.chargingstation
        rears = [
            float(get.getLanePosition(other)) - float(get.getLength(other))
            for other in domain.getVehicleIDs(data.stoppingPlaceID)
            if other != vehicle and get.getLaneID(other) == data.lane
        ]
        return min(rears, default=math.inf) - float(get.getMinGap(vehicle))

    def _lot(self, data: Any, ahead: float) -> float:
        """The end of the first free lot of a parking area beyond `ahead`, m; the end of the area
        where there is none.

        Lots are of equal length, as of `roadsideCapacity`. With lots of another kind SUMO has
        vehicles stop at the end of the area.
        """
        area = data.stoppingPlaceID
        if area not in self._lots:
            self._lots[area] = int(
                self._libsumo.simulation.getParameter(area, "parkingArea.capacity") or 0
            )
        count, length = self._lots[area], data.endPos - data.startPos
        parked = [
            float(self._libsumo.vehicle.getLanePosition(other))
            for other in self._libsumo.parkingarea.getVehicleIDs(area)
        ]
        for i in range(count):
            end = float(data.startPos + length * (i + 1) / count)
            if end >= ahead and all(abs(end - p) > _ACCEPTED for p in parked):
                return end
        return float(data.endPos)
