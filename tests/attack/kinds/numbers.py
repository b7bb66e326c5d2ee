"""Every number of a scenario, out of all bounds."""

import itertools
from collections.abc import Iterator, Mapping
from typing import Any

from sumo_mcts.config import json_schema

from ..case import ANY, ONLY_REFUSED, Case, scenario_case
from ..good import SCENARIO, dumped, with_key

ALWAYS = (0, -1, 1e-300, 1e9, 1e308)
IN_TURN: tuple[object, ...] = (
    float("nan"),
    float("inf"),
    float("-inf"),
    10**400,
    "many",
    True,
    None,
    [],
    {},
    "1e3",
    "0x10",
    "1_000",
)
MAY_BE_TAKEN = (
    0,
    -1,
    1e-300,
    1e9,
    None,
    "0x10",
    "1_000",
    "1e3",
)  # depends on the key; the episode then has to end
EACH = 2  # of IN_TURN for every number

_DRIVERS = {
    "paper": "paper",
    "idm": "idm",
    "sumo": "constant",
    "traffic": "constant",
    "episode": "constant",
}


def cases() -> Iterator[Case]:
    """Every number of the schema with values that make no sense."""
    turn = itertools.cycle(IN_TURN)
    for key, whole in numbers(json_schema()):
        for value in (*ALWAYS, *itertools.islice(turn, EACH)):
            given = (
                int(value)
                if whole and isinstance(value, float) and value in (1e9, 1e308)
                else value
            )
            name = f"{key}: {value if value != 10**400 else '10**400'!r}"
            allowed = (
                ANY
                if any(value == other and type(value) is type(other) for other in MAY_BE_TAKEN)
                else ONLY_REFUSED
            )
            yield scenario_case(
                "number",
                name,
                dumped(with_key(whole_scenario(key), key, given)),
                allowed,
                (last_name(key),),
            )


def last_name(key: str) -> str:
    """The last part of a key that is no number."""
    return next(part for part in reversed(key.split(".")) if not part.isdecimal())


def numbers(schema: Mapping[str, Any]) -> Iterator[tuple[str, bool]]:
    """Keys of all numbers of a JSON schema, `a.b.0` for the first of a list, and whether the number
    is a whole one."""

    def walk(part: Mapping[str, Any], path: tuple[str, ...]) -> Iterator[tuple[str, bool]]:
        if "$ref" in part:
            part = schema["$defs"][part["$ref"].rpartition("/")[2]]
        if part.get("type") in ("number", "integer"):
            yield ".".join(path), part["type"] == "integer"
        for inner in (*part.get("anyOf", ()), *part.get("allOf", ())):
            yield from walk(inner, path)
        for name, inner in part.get("properties", {}).items():
            yield from walk(inner, (*path, name))
        if "prefixItems" in part:
            for number, inner in enumerate(part["prefixItems"]):
                yield from walk(inner, (*path, str(number)))
        elif isinstance(part.get("items"), dict):
            yield from walk(part["items"], (*path, "0"))

    return walk(schema, ())


_TWO = [0.0, 1.0]
_STREAM = {
    "route": ["road", "beyond"],
    "lanes": [0],
    "pos_m": [10.0, 40.0],
    "speed_mps": [1.0, 4.0],
}
_AROUND: dict[str, Any] = {  # what all numbers need around them
    "planner.iterations": 20,
    "planner.accelerations_mps2": _TWO,
    "planner.lane_change_accelerations_mps2": _TWO,
    "planner.later_accelerations_mps2": _TWO,
    "planner.later_lane_change_accelerations_mps2": _TWO,
    "paper.accelerations_mps2": _TWO,
    "paper.lane_change_accelerations_mps2": _TWO,
    "traffic.crowd": {"count": [1, 2], "streams": [_STREAM]},
}


def whole_scenario(key: str) -> dict[str, Any]:
    """The good scenario with what a number needs around it, and driven by what reads it."""
    data = with_key(SCENARIO, "planner.name", _DRIVERS.get(key.partition(".")[0], "mcts"))
    for name, value in _AROUND.items():
        data = with_key(data, name, value)
    if ".events." not in key:
        return data
    # An event has a time or a place, and one action: the number is one of these, or stands beside
    # them.
    when = {} if key.endswith(("at_s", "at_m")) else {"at_s": 1.0}
    action = {} if key.endswith(("slow_to_mps", "stop_for_s")) else {"slow_to_mps": 2.0}
    if key.startswith("traffic.events"):
        return with_key(data, "traffic.events", [{"vehicle": "other", **when, **action}])
    return with_key(data, "traffic.actors.0.events", [{**when, **action}])
