"""How a vehicle may move within its lane, and how it is told to: where SUMO divides lanes (option
lateral-resolution)."""

from typing import Any

from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Sideways
from sumo_mcts.world.places import Place
from sumo_mcts.world.simulation import option

_MOVES = 0.02  # m/s to the side from which a vehicle is on its way there


class Aside:
    """Reads and commands the places of vehicles within their lanes."""

    def __init__(self, libsumo: Any, road: RoadMap) -> None:
        self._get, self._road = libsumo.vehicle, road
        self._left = -1.0 if road.lefthand else 1.0  # as in world/places.py
        self.divided = float(option("lateral-resolution")) > 0.0

    def read(self, vehicle: str, place: Place, width: float) -> Sideways:
        """How a vehicle of this width (m) may move."""
        if not self.divided or place.lane < 0:
            return Sideways()
        get, room = self._get, 0.5 * max(float(self._road.width[place.lane]) - width, 0.0)
        named = {"left": self._left * room, "right": -self._left * room, "center": 0.0}
        wish = str(get.getLateralAlignment(vehicle))
        # SUMO's other words name no place: the vehicle stays where it is
        aside = named.get(wish, place.d)
        return Sideways(float(get.getMaxSpeedLat(vehicle)), float(get.getMinGapLat(vehicle)), aside)

    def moves(self, vehicle: str) -> bool:
        """Whether it is on its way to another place within its lane.

        SUMO drops the wish for a lane change meanwhile.
        """
        return self.divided and abs(float(self._get.getLateralSpeed(vehicle))) > _MOVES

    def shift(self, vehicle: str, left: float) -> None:
        """Have a vehicle move so far to the left (m), as fast as its type does; also into the lane
        beside."""
        if self.divided:
            self._get.changeSublane(vehicle, self._left * left)
