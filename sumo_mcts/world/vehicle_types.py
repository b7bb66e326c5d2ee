"""What hardly ever changes about a vehicle: its size, its limits, its class."""

import math
from typing import Any, NamedTuple

from sumo_mcts.errors import ConfigError
from sumo_mcts.road import IGNORING, VEHICLE_CLASSES

MOST_SIZE = 2000.0  # m; trains are long
KEPT_S = 1.0  # s after which the type of an agent is read again


class VehicleType(NamedTuple):
    """What hardly ever changes about a vehicle."""

    length: float  # m
    width: float  # m
    max_accel: float  # m/s2
    decel: float  # m/s2, positive
    emergency_decel: float  # m/s2, positive
    max_speed: float  # m/s
    speed_factor: float  # its share of a speed limit
    vclass: int  # index into VEHICLE_CLASSES, or IGNORING
    articulated: bool  # SUMO's angle is that of the tractor


class TypeReader:
    """Reads the types of vehicles, and again now and then: a program may change them."""

    def __init__(self, libsumo: Any) -> None:
        self._get = libsumo.vehicle
        self._known: dict[str, tuple[float, VehicleType]] = {}  # when it was read, s; the type

    def of(self, vehicle: str, now: float, kept_s: float = KEPT_S) -> VehicleType:
        """The type of a vehicle on the road, as it was at most `kept_s` before the time `now` (s).

        Raises ConfigError where it is unusable.
        """
        known = self._known.get(vehicle)
        if known is not None and 0.0 <= now - known[0] < kept_s:
            return known[1]
        kind = self._read(vehicle)
        if known is None or kind != known[1]:
            _require_sound(vehicle, kind)
        self._known[vehicle] = now, kind
        return kind

    def _read(self, vehicle: str) -> VehicleType:
        get = self._get
        name = get.getVehicleClass(vehicle)
        return VehicleType(
            length=get.getLength(vehicle),
            width=get.getWidth(vehicle),
            max_accel=get.getAccel(vehicle),
            decel=get.getDecel(vehicle),
            emergency_decel=get.getEmergencyDecel(vehicle),
            max_speed=get.getMaxSpeed(vehicle),
            speed_factor=get.getSpeedFactor(vehicle),
            vclass=VEHICLE_CLASSES.index(name) if name in VEHICLE_CLASSES else IGNORING,
            articulated="trailer" in get.getShapeClass(vehicle),
        )


def require_size(name: str, length: float, width: float) -> None:
    """Raise ConfigError where a vehicle or a person is larger than any."""
    for what, value in (("length", length), ("width", width)):
        if not 0.0 < value <= MOST_SIZE:
            raise ConfigError(
                f"vehicle type of {name}: {what}: has to be greater than 0 and at most "
                f"{MOST_SIZE:g} m, got {value:g}"
            )


def _require_sound(vehicle: str, kind: VehicleType) -> None:
    """Raise ConfigError where a vehicle's type holds what no program can compute with; SUMO takes
    it as it is."""
    require_size(vehicle, kind.length, kind.width)
    wrong = next((name for name, value in kind._asdict().items() if not math.isfinite(value)), None)
    if wrong is not None:
        raise ConfigError(f"vehicle type of {vehicle}: {wrong}: has to be a finite number")
