"""From a Command to SUMO: a speed every step, lane changes, and SUMO's own driver back at the end."""

import math
from typing import Any

import numpy as np

from sumo_mcts.scene import Floats, Follow, Release, RoadMap
from sumo_mcts.world.observe import Change
from sumo_mcts.world.simulation import import_libsumo

_OWN_SPEED_MODE, _OWN_LANE_CHANGE_MODE = 31, 1621  # SUMO's defaults


class Commander:
    """Drives one vehicle. SUMO adds no bounds and no safety (speedMode 0, laneChangeMode 0): the bounds here are ours."""

    def __init__(self, vehicle: str, road: RoadMap, step: float, change_duration: float, max_accel: float, max_decel: float) -> None:
        self._get: Any = import_libsumo().vehicle
        self._vehicle, self._road, self._step = vehicle, road, step
        self._duration, self._accel, self._decel = change_duration, max_accel, max_decel
        self._profile: Floats = np.zeros(0)
        self._at = 0
        self._holding = False
        self.change = Change()

    def accept(self, command: Follow | Release) -> None:
        """Play this from the coming step on."""
        if isinstance(command, Release):
            self.release()
            return
        if not self._holding:
            self._get.setSpeedMode(self._vehicle, 0)
            self._get.setLaneChangeMode(self._vehicle, 0)
            self._holding = True
        self._profile, self._at = command.speeds, 0
        if command.lane_change != 0:
            self._begin_change(command.lane_change)

    def before_step(self) -> None:
        """Command the step that begins now; past its end a profile keeps its last speed."""
        if not self._holding:
            return
        v = float(self._get.getSpeed(self._vehicle))
        wanted = float(self._profile[min(self._at, len(self._profile) - 1)]) if len(self._profile) else 0.0
        if not math.isfinite(wanted):
            wanted = 0.0
        self._get.setSpeed(self._vehicle, min(max(wanted, v - self._decel * self._step, 0.0), v + self._accel * self._step))
        self._at += 1
        if self.change.target >= 0:
            self._go_on_changing()

    def release(self) -> None:
        """Hand the vehicle back to SUMO."""
        if self._holding and self._vehicle in import_libsumo().vehicle.getIDList():
            self._get.setSpeed(self._vehicle, -1.0)
            self._get.setSpeedMode(self._vehicle, _OWN_SPEED_MODE)
            self._get.setLaneChangeMode(self._vehicle, _OWN_LANE_CHANGE_MODE)
        self._holding = False
        self.change = Change()

    def _begin_change(self, side: int) -> None:
        index = int(self._get.getLaneIndex(self._vehicle)) + side
        lane = f"{self._get.getRoadID(self._vehicle)}_{index}"
        if lane not in self._road.lane_ids:
            return
        self._get.changeLane(self._vehicle, index, 0.0)
        if self._duration > 0.0:
            self.change = Change(0.0, self._road.lane_ids.index(self._get.getLaneID(self._vehicle)), self._road.lane_ids.index(lane))

    def _go_on_changing(self) -> None:
        """SUMO moves the vehicle sideways for change_duration; the same clock runs here."""
        progress = self.change.progress + self._step / self._duration
        self.change = self.change._replace(progress=progress) if progress < 1.0 - 1e-9 else Change()
