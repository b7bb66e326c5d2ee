"""Surrogate measures of safety that SUMO's SSM device takes: TTC, DRAC, PET."""

import math
from typing import Any, NamedTuple

_MEASURES = ("minTTC", "maxDRAC", "minPET")
_SETTINGS = ("measures", "thresholds", "range", "extratime")  # of the device
_MOST = 1e6  # a larger number, or one below 0, stands for none


class Surrogates(NamedTuple):
    """The measures at this moment; nan where undefined."""

    ttc: float = math.nan  # s, time to collision
    drac: float = math.nan  # m/s2, deceleration to avoid a collision
    pet: float = math.nan  # s, post-encroachment time


class SurrogateReader:
    """Reads the SSM devices of vehicles that have one with our settings."""

    def __init__(self, libsumo: Any) -> None:
        self._libsumo = libsumo
        self._otherwise: dict[str, bool] = {}  # vehicles whose devices have other settings

    def read(self, vehicle: str) -> Surrogates:
        """The values of a vehicle's device; all nan where its settings are not ours."""
        get = self._libsumo.vehicle.getParameter
        if get(vehicle, "has.ssm.device") != "true" or self._measures_otherwise(vehicle):
            return Surrogates()
        ttc, drac, pet = (_number(get(vehicle, f"device.ssm.{key}")) for key in _MEASURES)
        return Surrogates(ttc=ttc, drac=drac, pet=pet)

    def _measures_otherwise(self, vehicle: str) -> bool:
        """Whether the vehicle's type has settings of its own, which SUMO puts above our options."""
        if vehicle not in self._otherwise:
            kind = self._libsumo.vehicle.getTypeID(vehicle)
            own = any(
                self._libsumo.vehicletype.getParameter(kind, f"device.ssm.{key}")
                for key in _SETTINGS
            )
            self._otherwise[vehicle] = own or not self._measures_all(vehicle)
        return self._otherwise[vehicle]

    def _measures_all(self, vehicle: str) -> bool:
        """Whether the device has all three: the vehicle itself may say otherwise too."""
        try:
            for key in _MEASURES:
                self._libsumo.vehicle.getParameter(vehicle, f"device.ssm.{key}")
        except self._libsumo.TraCIException:
            return False
        return True


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if 0.0 <= value < _MOST else math.nan
