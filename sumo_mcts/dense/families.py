"""Families of drivers: what the vehicle types of the others say, beside what all have."""

from collections.abc import Mapping
from typing import Literal, get_args

Family = Literal["krauss", "idm", "acc", "eidm", "w99", "sl2015"]
FAMILIES: tuple[Family, ...] = get_args(Family)
HELD_APART: tuple[Family, ...] = ("eidm", "w99", "sl2015")  # for the last measurement
SUBLANE: tuple[Family, ...] = ("sl2015",)  # need SUMO's option lateral-resolution

_ATTRIBUTES: Mapping[Family, Mapping[str, str]] = {
    "krauss": {},
    "idm": {"carFollowModel": "IDM"},
    "acc": {"carFollowModel": "ACC"},
    "eidm": {"carFollowModel": "EIDM"},
    "w99": {"carFollowModel": "W99"},
    "sl2015": {"laneChangeModel": "SL2015"},
}
# Pedestrians and bicycles are the same in all families.
_MOTOR = {
    "car": {"speedDev": "0.1"},
    "truck": {"vClass": "truck", "speedDev": "0.05"},
    "van": {"vClass": "delivery"},
}
_OTHERS = {
    "bicycle": {"vClass": "bicycle"},
    "pedestrian": {"vClass": "pedestrian"},
    "ego": {"speedDev": "0"},
}


def types(family: Family) -> dict[str, dict[str, str]]:
    """Attributes of each vehicle type, by id."""
    motor = {name: {**given, **_ATTRIBUTES[family]} for name, given in _MOTOR.items()}
    return {**motor, **_OTHERS}
