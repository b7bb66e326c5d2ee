"""Families of drivers: what the vehicle types of the others say, beside what all have."""

from collections.abc import Mapping, Set
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
# Types that few kinds use
_RARE = {
    "bus": {"vClass": "bus"},
    "tram": {"vClass": "tram"},
    "train": {"vClass": "rail"},
    "emergency": {"vClass": "emergency", "speedFactor": "1.3", "speedDev": "0"},
    "tractor": {"vClass": "truck", "length": "6", "maxSpeed": "8"},
    "rider": {"vClass": "bicycle", "latAlignment": "right"},
    "moped": {"vClass": "moped", "maxSpeed": "8", "latAlignment": "right"},
}
# Type -> key and value of its parameters
DEVICES: Mapping[str, Mapping[str, str]] = {"emergency": {"has.bluelight.device": "true"}}


def types(family: Family, used: Set[str] = frozenset()) -> dict[str, dict[str, str]]:
    """Attributes of each vehicle type, by id; of the rare ones those that are used."""
    motor = {name: {**given, **_ATTRIBUTES[family]} for name, given in _MOTOR.items()}
    rare = {name: given for name, given in _RARE.items() if name in used}
    return {**motor, **_OTHERS, **rare}
