"""Kinds on one road: merging, weaving, an exit, lanes that end, a van in the way."""

from sumo_mcts.situations.kind import TRUCKS, Kind, Range, Values
from sumo_mcts.situations.situation import (
    Edge,
    Link,
    Node,
    Parked,
    Situation,
    Stream,
    row_per_hour,
)

GAP = Range(20.0, 60.0, "m", "mean gap in each lane of the main road at the limit, 1.3 s at least")
ROAD_SPEED = Range(15.0, 28.0, "m/s", "speed limit")
SLOW_SPEED = Range(11.0, 20.0, "m/s", "speed limit")
LANE = 3.2  # m, width
MAIN = -900.0  # m: where the main road begins


def ramp(values: Values) -> Situation:
    """The ego comes from a slip road and has to merge before its lane ends."""
    speed, length = values["speed"], values["length"]
    beside = row_per_hour(values["gap"], speed)
    return Situation(
        nodes=_past_slip_road(length),
        edges=(
            Edge("main", "a", "m", 2, speed, 9), Edge("merge", "m", "e", 3, speed, 9),
            Edge("away", "e", "z", 2, speed, 9), _slip(0.75 * speed),
        ),
        links=(
            Link("slip", "merge", 0, 0), Link("main", "merge", 0, 1), Link("main", "merge", 1, 2),
            Link("merge", "away", 1, 0), Link("merge", "away", 2, 1),
        ),
        streams=(
            *(Stream("main merge away", beside, lane, regular=True) for lane in "01"),
            Stream("slip merge away", values["merging"]),
        ),
        ego_route="slip merge away",
    )  # fmt: skip


def weaving(values: Values) -> Situation:
    """The ego comes in on the right and stays; others leave on the right across its way."""
    speed, length = values["speed"], values["length"]
    beside = row_per_hour(values["gap"], speed)
    return Situation(
        nodes=(*_past_slip_road(length), Node("x", length + 250.0, -70.0)),
        edges=(
            Edge("main", "a", "m", 2, speed, 9), Edge("weave", "m", "e", 3, speed, 9),
            Edge("away", "e", "z", 2, speed, 9), _slip(0.75 * speed),
            _exit(length, 2, 0.75 * speed),
        ),
        links=(
            Link("slip", "weave", 0, 0), Link("main", "weave", 0, 1), Link("main", "weave", 1, 2),
            Link("weave", "exit", 0, 0), Link("weave", "away", 1, 0), Link("weave", "away", 2, 1),
        ),
        streams=(
            Stream("main weave away", beside, "1", regular=True),
            Stream("main weave away", (1.0 - values["leaving"]) * beside, "0", regular=True),
            Stream("main weave exit", values["leaving"] * beside, "0", regular=True),
            Stream("slip weave away", values["merging"]),
        ),
        ego_route="slip weave away",
    )  # fmt: skip


def leave(values: Values) -> Situation:
    """The ego is in the left of three lanes and has to take the exit on the right."""
    speed, beside = values["speed"], row_per_hour(values["gap"], values["speed"])
    return Situation(
        nodes=(
            Node("a", -values["length"], 0.0), Node("m", 0.0, 0.0), Node("e", 200.0, 0.0),
            Node("z", 700.0, 0.0), Node("x", 450.0, -70.0),
        ),
        edges=(
            Edge("main", "a", "m", 3, speed, 9), Edge("beside", "m", "e", 4, speed, 9),
            Edge("away", "e", "z", 3, speed, 9), _exit(200.0, 3, 0.75 * speed),
        ),
        links=(
            *(Link("main", "beside", k, k + 1) for k in range(3)), Link("main", "beside", 0, 0),
            *(Link("beside", "away", k + 1, k) for k in range(3)), Link("beside", "exit", 0, 0),
        ),
        streams=(
            *(Stream("main beside away", beside, lane, regular=True) for lane in "12"),
            Stream("main beside away", (1.0 - values["leaving"]) * beside, "0", regular=True),
            Stream("main beside exit", values["leaving"] * beside, "0", regular=True),
        ),
        ego_route="main beside exit",
        ego_lane="2",
    )  # fmt: skip


def zipper(values: Values) -> Situation:
    """Two lanes become one, and neither has the right of way."""
    return _narrowing(values, 2, "zipper", (Link("in", "out", 0, 0), Link("in", "out", 1, 0)))


def lane_drop(values: Values) -> Situation:
    """The right of three lanes ends; the ego is in it."""
    return _narrowing(values, 3, "priority", (Link("in", "out", 1, 0), Link("in", "out", 2, 1)))


def _past_slip_road(length: float) -> tuple[Node, ...]:
    """A main road from a by m and e to z; between m, where the slip road from r comes in, and e it
    is `length` m long."""
    return (
        Node("a", MAIN, 0.0), Node("m", 0.0, 0.0), Node("e", length, 0.0),
        Node("z", length + 500.0, 0.0), Node("r", -250.0, -70.0),
    )  # fmt: skip


def _slip(speed: float) -> Edge:
    """From r to m at x = 0, at last beside a main road of two lanes."""
    shape = ((-250.0, -70.0), (-130.0, -14.0), (-70.0, -2 * LANE), (0.0, -2 * LANE))
    return Edge("slip", "r", "m", 1, speed, 3, shape)


def _exit(start: float, lanes: int, speed: float) -> Edge:
    """From e at x = `start` to x, at first beside a main road of so many lanes."""
    beside = -lanes * LANE
    shape = ((0.0, beside), (70.0, beside), (130.0, beside - 8.0), (250.0, -70.0))
    return Edge("exit", "e", "x", 1, speed, 3, tuple((start + x, y) for x, y in shape))


def _narrowing(values: Values, lanes: int, control: str, links: tuple[Link, ...]) -> Situation:
    """A road on which so many lanes become one less."""
    speed = values["speed"]
    return Situation(
        nodes=(
            Node("a", -values["length"], 0.0), Node("c", 0.0, 0.0, control), Node("z", 400.0, 0.0),
        ),
        edges=(Edge("in", "a", "c", lanes, speed), Edge("out", "c", "z", lanes - 1, speed)),
        links=links,
        streams=(Stream("in out", values["demand"], "random"),),
        ego_route="in out",
        ego_lane="0",
    )  # fmt: skip


def parked_van(values: Values) -> Situation:
    """A van stands in the ego's lane; the lane beside it is full."""
    speed, demand = values["speed"], values["demand"]
    return Situation(
        nodes=(Node("a", -values["length"], 0.0), Node("b", 400.0, 0.0)),
        edges=(Edge("road", "a", "b", 2, speed),),
        streams=(
            Stream("road", (1.0 - values["right"]) * demand, "1", regular=True),
            Stream("road", values["right"] * demand, "0"),
        ),
        ego_route="road",
        ego_lane="0",
        parked=(Parked("road", 0, values["length"]),),
    )


_MERGING = Range(30.0, 250.0, "1/h", "others from the slip road")
_BEFORE = Range(250.0, 500.0, "m", "way to the place")
KINDS = (
    Kind("ramp", "merge from a slip road, its lane short or long",
         {"gap": GAP, "length": Range(60.0, 300.0, "m", "lane beside the main road"),
          "merging": _MERGING, "speed": ROAD_SPEED, "trucks": TRUCKS}, ramp),
    Kind("weaving", "merge where others leave across the ego's way",
         {"gap": GAP, "length": Range(120.0, 350.0, "m", "weaving section"),
          "leaving": Range(0.1, 0.5, "", "share of the right lane that leaves"),
          "merging": _MERGING, "speed": ROAD_SPEED, "trucks": TRUCKS}, weaving),
    Kind("exit", "from the left of three lanes to an exit on the right",
         {"gap": GAP, "length": Range(500.0, 1000.0, "m", "way to the lane of the exit"),
          "leaving": Range(0.1, 0.4, "", "share of the right lane that leaves"),
          "speed": ROAD_SPEED, "trucks": TRUCKS}, leave),
    Kind("zipper", "two lanes become one, one by one",
         {"demand": Range(500.0, 1850.0, "1/h", "vehicles in both lanes"),
          "length": _BEFORE, "speed": SLOW_SPEED, "trucks": TRUCKS}, zipper),
    Kind("lane-drop", "the right of three lanes ends",
         {"demand": Range(1000.0, 4400.0, "1/h", "vehicles in all lanes"),
          "length": _BEFORE, "speed": SLOW_SPEED, "trucks": TRUCKS}, lane_drop),
    Kind("parked-van", "past a double-parked van by the lane beside it",
         {"demand": Range(400.0, 2200.0, "1/h", "vehicles in both lanes"),
          "right": Range(0.05, 0.4, "", "share of them in the van's lane"),
          "length": _BEFORE, "speed": SLOW_SPEED, "trucks": TRUCKS}, parked_van),
)  # fmt: skip
