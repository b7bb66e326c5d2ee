"""The wish to change lanes for the route, which SUMO's drivers make room for; the change itself
stays ours."""

from typing import Any

from sumo_mcts.world.library import running_sumo
from sumo_mcts.world.simulation import option

# lane change mode of a vehicle that asks: changes for the route, and no others
ASKING = 1
# What a vehicle that asks gets in place of its own: it wants the change wherever the route needs
# it, also far before its lane ends and at a stand; and it finds no gap safe in which anyone would
# have to brake, so that it leaves the change to us.
_WISHES = {"lcStrategic": "1e6", "lcAssertive": "1e-4"}


class Wish:
    """The wish of one vehicle, which is off at first."""

    def __init__(self, vehicle: str) -> None:
        self._sumo: Any = running_sumo()
        self._get, self._vehicle = self._sumo.vehicle, vehicle
        self._own: dict[str, str] | None = None  # the parameters to be given back; None: it is off
        # Asking gained nothing in SUMO's sublane model; the lane change model DK2008 has no wish.
        self.possible = float(option("lateral-resolution")) <= 0.0 and self._settings() is not None

    @property
    def on(self) -> bool:
        """Whether the vehicle asks."""
        return self._own is not None

    @property
    def mode(self) -> int:
        """The lane change mode that goes with it."""
        return ASKING if self.on else 0

    def turn(self, on: bool) -> None:
        """Ask from the coming step on, or no longer; nothing where that is not possible."""
        if on == self.on or not self.possible:
            return
        if self._own is None:
            self._own = self._settings()
            self._set(_WISHES)
        else:
            self._set(self._own)
            self._own = None
        self._get.setLaneChangeMode(self._vehicle, self.mode)

    def _settings(self) -> dict[str, str] | None:
        """The vehicle's own wishes, with as many digits as SUMO tells; None: it has none."""
        try:
            return {key: self._get.getParameter(self._vehicle, _key(key)) for key in _WISHES}
        except self._sumo.TraCIException:
            return None

    def renew(self) -> None:
        """Another hand has set the vehicle: ask as before, if it asked."""
        if self.on:
            self._set(_WISHES)
            self._get.setLaneChangeMode(self._vehicle, self.mode)

    def forget(self) -> None:
        """It is off, and nothing is to be given back: the vehicle is gone."""
        self._own = None

    def _set(self, values: dict[str, str]) -> None:
        for key, value in values.items():
            self._get.setParameter(self._vehicle, _key(key), value)


def _key(name: str) -> str:
    return f"laneChangeModel.{name}"
