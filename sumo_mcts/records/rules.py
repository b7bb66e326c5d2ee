"""What every field of a trace and of a map may hold: its shape, and the bounds of its numbers.

RULES says field by field what road.py, scene.py and trace.py say in words. A shape names sizes: the
first field with a size sets it, and all others have to agree. Sizes with a capital letter hold for
a whole decision or map, those with a small one for one tuple. `lanes`, `edges` and so on are the
sizes of the map; without a map they are not checked.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

from sumo_mcts.road import LEAST_SPEED, PEOPLE_WAIT, VEHICLE_CLASSES

FAR = 1e8  # m: coordinates of all projections that SUMO writes lie within
LARGE = 1e10  # bound of every other number; SUMO writes -1.07e9 for an unknown one
LONGEST = 1e6  # m of a lane
TICK, MINUTE = 1e-3, 60.0  # s: bounds of a step


class Rule(NamedTuple):
    """What one field may hold."""

    shape: tuple[str | int, ...] = ()  # of an array, or the length of a tuple; (): a single number
    least: float = -LARGE
    most: float = LARGE
    below: str = ""  # the size that an index stays below; "": none
    rises: str = ""  # offsets: from 0 to this size, by `least` at least; "": none
    endless: bool = False  # infinite is allowed
    unknown: bool = False  # nan is


def _index(below: str, *shape: str | int, least: int = -1) -> Rule:
    """A place in something of that size; -1: none."""
    return Rule(shape, least, math.inf, below)


def _offsets(size: str, *shape: str, least: int = 0) -> Rule:
    """Where the shares of an array of that size begin, each of `least` entries or more, and where
    the last one ends."""
    return Rule(shape, least, math.inf, rises=size)


def _place(*shape: str | int) -> Rule:
    """Coordinates, m."""
    return Rule(shape, -FAR, FAR)


def _positive(*shape: str | int, most: float = LARGE) -> Rule:
    """Sizes, speeds and times from 0 on."""
    return Rule(shape, 0.0, most)


def _any(*shape: str | int) -> Rule:
    """Costs and what a planner remembers: any number, infinite ones too."""
    return Rule(shape, endless=True, unknown=True, least=-math.inf, most=math.inf)


_CLASS = Rule(("N",), -1, len(VEHICLE_CLASSES) - 1)
_STEP = Rule((), TICK, MINUTE)
_SIDE = Rule((), -1, 1)
_COUNT = Rule((), 0, math.inf)
RULES: Mapping[str, Mapping[str, Rule]] = {
    "RoadMap": {
        "lane_ids": Rule(("lanes",)), "edge_ids": Rule(("edges",)),
        "junction_ids": Rule(("junctions",)), "signal_ids": Rule(("signals",)),
        "edge": _index("edges", "lanes", least=0), "index": _index("lanes", "lanes", least=0),
        "internal": Rule(("lanes",)),
        "length": _positive("lanes", most=LONGEST), "scale": _positive("lanes"),
        "width": _positive("lanes"), "speed": Rule(("lanes",), LEAST_SPEED),
        "classes": Rule(("lanes",), most=math.inf), "left": _index("lanes", "lanes"),
        "change_left": Rule(("lanes",), most=math.inf),
        "change_right": Rule(("lanes",), most=math.inf),
        "class_row": _index("R", len(VEHICLE_CLASSES)),
        "class_speed": Rule(("R", "lanes"), LEAST_SPEED),
        "right": _index("lanes", "lanes"),
        "points": _place("P", 2), "point_s": _positive("P"),
        "point_offset": _offsets("P", "lanes+1", least=2),
        "successor": _index("lanes", "S", least=0), "successor_offset": _offsets("S", "lanes+1"),
        "exit": _index("lanes", "lanes", least=0), "direction": Rule(("lanes",), 0, 3),
        "junction": _index("junctions", "lanes"),
        "knot": Rule(("lanes",), -1), "begins": Rule(("lanes",), -1), "ends": Rule(("lanes",), -1),
        "rule": Rule(("lanes",), 0, PEOPLE_WAIT), "signal": _index("signals", "lanes"),
        "link": Rule(("lanes",), -1),
        "conflict_lane": _index("lanes", "C", least=0), "conflict_offset": _offsets("C", "lanes+1"),
        "conflict_begin": Rule(("C",)), "conflict_end": Rule(("C",)),
        "conflict_other_begin": Rule(("C",)), "conflict_other_end": Rule(("C",)),
        "conflict_merge": Rule(("C",)), "conflict_yields": Rule(("C",)),
        "oncoming": _index("lanes", "V", least=0),
    },
    "RoadChanges": {
        "lane": _index("lanes", "r", least=0), "speed": Rule(("r",), LEAST_SPEED),
        "classes": Rule(("r",), most=math.inf), "change_left": Rule(("r",), most=math.inf),
        "change_right": Rule(("r",), most=math.inf),
    },
    "Trace": {"cycles": Rule(("cycles",))},
    "Lanes": {
        "lane_ids": Rule(("l",)), "points": _place("p", 2), "offset": _offsets("p", "l+1"),
        "width": _positive("l", most=1e3), "internal": Rule(("l",)),
        "route": Rule(("l",)), "stop_lines": _place("s", 4),
    },
    "Setting": {
        "seed": _COUNT, "step": _STEP._replace(unknown=True),
        "change_duration": Rule((), 0.0, LARGE, unknown=True),
    },
    "CycleRecord": {
        "time": Rule(), "step": _STEP, "plan_ms": Rule((), unknown=True),
        "commanded_speed": Rule((), unknown=True),
        "executed_speed": Rule((), unknown=True), "commanded_lane": _index("lanes"),
        "executed_lane": _index("lanes"),
    },
    "EgoState": {
        "x": _place(), "y": _place(), "heading": Rule(), "v": Rule(), "a": Rule(),
        "lane": _index("lanes"), "s": Rule(), "d": Rule(),
        "length": _positive(most=1e4), "width": _positive(most=1e3), "max_accel": Rule(),
        "comfort_decel": Rule(), "emergency_decel": Rule(),
        "max_speed": Rule(), "speed_factor": Rule(), "vclass": _CLASS._replace(shape=()),
        "route": _index("edges", "e"), "changing": Rule(),
        "change_to": _index("lanes"), "change_from": _index("lanes"), "asks": _SIDE,
        "reroutes": _COUNT, "standing_s": Rule(),
    },
    "Stop": {
        "lane": _index("lanes"), "begin": Rule(), "place": _positive(most=LONGEST),
        "speed": _positive(), "after": _COUNT,
    },
    "Sideways": {"speed": _positive(), "gap": Rule(), "wish": Rule()},
    "Agents": {
        "ids": Rule(("N",)), "x": _place("N"), "y": _place("N"), "heading": Rule(("N",)),
        "v": Rule(("N",)), "a": Rule(("N",)), "trend": Rule(("N",)),
        "length": _positive("N", most=1e4), "width": _positive("N", most=1e3),
        "lane": _index("lanes", "N"), "s": Rule(("N",)), "d": Rule(("N",)),
        "blinker": Rule(("N",), -1, 1), "standing_s": Rule(("N",)), "person": Rule(("N",)),
        "vclass": _CLASS,
    },
    "Signals": {
        "state": Rule(("links", "K"), 0, 3), "offset": _offsets("links", "Q+1"),
        "until": Rule(("Q", "K"), endless=True),
    },
    "Forecast": {
        "dt": _STEP, "weight": Rule(("H",), 0.0, 1.0 + 1e-6), "pose": _place("H", "T", "F", 4),
        "v": Rule(("H", "T", "F")),
        "lane": _index("lanes", "H", "T", "F"), "s": Rule(("H", "T", "F")),
        "valid": Rule(("H", "T", "F")),
        "half_length": _positive("F", most=1e4), "half_width": _positive("F", most=1e3),
        "reacts": Rule(("F",)), "yields": Rule(("H", "F")), "intents": Rule(("I",)),
    },
    "Intent": {"agent": _index("F"), "does": Rule((), 0, 4), "way": _index("lanes", "w", least=0)},
    "Decision": {"children": Rule(("c",)), "chosen": _index("c"), "iterations": _COUNT,
    "known": _COUNT},
    "Follow": {"speeds": Rule(("m",)), "lane_change": _SIDE, "asks": _SIDE,
               "shift": Rule()},
    "Release": {},
    "Plan": {"time": Rule(("m",)), "v": Rule(("m",)), "lane": _index("lanes", "m"),
    "s": Rule(("m",)), "pose": _place("m", 4)},
    "RootChild": {
        "accel": Rule(), "lane_change": _SIDE, "visits": _COUNT, "mean": _any(), "best": _any(),
        "terms": _any(5), "poses": _place("m", 4),
        "hypotheses": _any("h", 5),
    },
    "Manoeuvre": {"time": Rule()},
    "PlannerMemory": {"numbers": Rule(("n",)), "generator": Rule(("g",), most=math.inf),
    "waited_s": Rule()},
    "Memory": {"edges": _index("edges", "e"), "stood": _COUNT._replace(shape=("s",)),
    "stood_since": Rule(("s",)), "failures": _COUNT, "held_up": Rule(("h",)),
    "held_up_at": Rule(("h",))},
    "Answers": {
        "ways": Rule(("W",)), "agent": _index("N", "a", least=0), "scripted": Rule(("a",)),
        "pose": _place("a", "t", 4), "v": Rule(("a", "t")),
        "lane": _index("lanes", "a", "t"), "s": Rule(("a", "t")), "valid": Rule(("a", "t")),
    },
    "ToldPlans": {
        "agent": _index("N", "p", least=0), "pose": _place("p", "u", 4), "v": Rule(("p", "u")),
        "lane": _index("lanes", "p", "u"), "s": Rule(("p", "u")), "valid": Rule(("p", "u")),
    },
}  # fmt: skip
ANSWERED = _index("lanes", "w")  # one of Answers.ways
