"""Rules of a road that is shared with buses, trams, bicycles, people and an ambulance, a kind for
each."""

from sumo_mcts.situations.junctions import BESIDE, GREEN, arms, times
from sumo_mcts.situations.kind import TOWN_SPEED, TRUCKS, Kind, Range, Values
from sumo_mcts.situations.situation import Edge, LaneStop, Link, Node, Situation, Stream

ROAD = (Node("a", -500.0, 0.0), Node("b", 0.0, 0.0), Node("z", 400.0, 0.0))  # of one-way roads


def bus_lane(values: Values) -> Situation:
    """The right lane is for buses alone, up to 120 m before the ego's right turn."""
    speed = values["speed"]
    nodes = (*ROAD[:2], Node("d", 120.0, 0.0), Node("z", 400.0, 0.0), Node("s", 120.0, -200.0))
    return Situation(
        nodes=nodes,
        edges=(
            Edge("in", "a", "b", 2, speed, only=((0, "bus"),)), Edge("mid", "b", "d", 2, speed),
            Edge("out", "d", "z", 1, speed), Edge("turn", "d", "s", 1, speed),
        ),
        links=(
            Link("in", "mid", 0, 0), Link("in", "mid", 1, 1),
            Link("mid", "turn", 0, 0), Link("mid", "out", 1, 0),
        ),
        streams=(
            Stream("in mid out", values["demand"], "1"),
            Stream("in mid turn", values["demand"] / 4, "1"),
            Stream("in mid turn", values["buses"], "0", regular=True, vtype="bus"),
        ),
        ego_route="in mid turn",
        ego_lane="1",
    )  # fmt: skip


def bus_stop(values: Values) -> Situation:
    """Buses stop on the right of two lanes."""
    stop = LaneStop("in", 0, 350.0, values["halt"])
    return _two_lanes(values, Stream("in out", values["buses"], "0", True, "bus", (stop,)))


def _two_lanes(values: Values, *streams: Stream) -> Situation:
    """The ego starts on the right of two lanes."""
    speed = values["speed"]
    return Situation(
        nodes=ROAD,
        edges=(Edge("in", "a", "b", 2, speed), Edge("out", "b", "z", 2, speed)),
        streams=(Stream("in out", values["demand"], "random"), *streams),
        ego_route="in out",
        ego_lane="0",
    )


def tram(values: Values) -> Situation:
    """Trams stop on the left of two lanes, which they share with cars; the ego is behind them and
    turns left."""
    speed = values["speed"]
    stop = LaneStop("in", 1, 350.0, values["halt"])
    return Situation(
        nodes=(*ROAD, Node("n", 0.0, 200.0)),
        edges=(
            Edge("in", "a", "b", 2, speed), Edge("out", "b", "z", 2, speed),
            Edge("left", "b", "n", 1, speed),
        ),
        links=(
            Link("in", "out", 0, 0), Link("in", "out", 1, 1), Link("in", "left", 1, 0),
        ),
        streams=(
            Stream("in out", values["demand"], "random"),
            Stream("in left", values["demand"] / 4, "1"),
            Stream("in out", values["trams"], "1", True, "tram", (stop,)),
        ),
        ego_route="in left",
        ego_lane="1",
    )  # fmt: skip


def emergency(values: Values) -> Situation:
    """Ambulances with blue light come from behind."""
    return _two_lanes(values, Stream("in out", values["ambulances"], "best", True, "emergency"))


def bicycle_ahead(values: Values) -> Situation:
    """Bicycles ride on the right of two lanes."""
    return _two_lanes(values, Stream("in out", values["bicycles"], "0", False, "bicycle"))


def _right_turn(values: Values, *streams: Stream) -> Situation:
    """The ego turns right at a signal, across what goes straight on beside it."""
    nodes, edges = arms("traffic_light", (1, 1), values["speed"])
    return Situation(
        nodes,
        edges,
        (
            Stream("wc ce", values["along"]), Stream("ec cw", values["along"]),
            Stream("nc cs", values["across"]), *streams,
        ),
        ego_route="wc cs",
        netconvert=(*times(values["green"]), *BESIDE),
    )  # fmt: skip


def bicycle_beside(values: Values) -> Situation:
    """Bicycles on a lane of their own go straight on beside the turning ego."""
    return _right_turn(values, Stream("wc ce", values["bicycles"], vtype="bicycle"))


def people_beside(values: Values) -> Situation:
    """People cross the road into which the ego turns, and walk round the corner beside it."""
    walking = values["pedestrians"] / 3
    return _right_turn(
        values,
        *(Stream(route, walking, vtype="pedestrian") for route in ("wc ce", "ec cw", "wc cs")),
    )


def zebra(values: Values) -> Situation:
    """People cross the ego's road at a junction without signals."""
    nodes, edges = arms("priority", (1, 1), values["speed"], (300.0, 200.0))
    walking = values["pedestrians"] / 2
    return Situation(
        nodes,
        tuple(
            edge._replace(priority=3 if set(edge.id) <= set("wce") else 1) for edge in edges
        ),
        (
            Stream("wc ce", values["along"]), Stream("ec cw", values["along"]),
            *(Stream(route, walking, vtype="pedestrian") for route in ("nc cs", "sc cn")),
        ),
        ego_route="wc ce",
        netconvert=(
            "--sidewalks.guess", "true", "--sidewalks.guess.max-speed", "20",
            "--crossings.guess", "true", "--crossings.guess.speed-threshold", "20",
        ),
    )  # fmt: skip


_DEMAND = Range(200.0, 1200.0, "1/h", "cars and trucks")
_ROAD = {"demand": _DEMAND, "speed": TOWN_SPEED, "trucks": TRUCKS}
_HALT = Range(10.0, 30.0, "s", "time at the stop")
_TURN = {
    "along": Range(50.0, 400.0, "1/h", "vehicles straight on, each way"),
    "across": Range(50.0, 300.0, "1/h", "vehicles into the ego's road"),
    "green": GREEN,
    "speed": TOWN_SPEED,
}
_BICYCLES = Range(60.0, 300.0, "1/h", "bicycles")
_PEDESTRIANS = Range(60.0, 500.0, "1/h", "pedestrians")
KINDS = (
    Kind("bus-lane", "right turn behind the end of a bus lane",
         {"buses": Range(20.0, 90.0, "1/h", "buses"), **_ROAD}, bus_lane),
    Kind("bus-stop", "past buses that stop in the lane",
         {"buses": Range(40.0, 120.0, "1/h", "buses"), "halt": _HALT, **_ROAD}, bus_stop),
    Kind("tram", "left turn from a lane in which trams stop",
         {"trams": Range(30.0, 90.0, "1/h", "trams"), "halt": _HALT, **_ROAD}, tram),
    Kind("emergency", "ambulances from behind",
         {"ambulances": Range(40.0, 120.0, "1/h", "ambulances"), **_ROAD}, emergency),
    Kind("bicycle-ahead", "past bicycles in the lane", {"bicycles": _BICYCLES, **_ROAD},
         bicycle_ahead),
    Kind("bicycle-beside", "right turn across a bicycle lane",
         {"bicycles": _BICYCLES, **_TURN}, bicycle_beside),
    Kind("people-beside", "right turn across a crossing at a signal",
         {"pedestrians": _PEDESTRIANS, **_TURN}, people_beside),
    Kind("zebra", "straight on over a crossing without signals",
         {"pedestrians": Range(30.0, 200.0, "1/h", "pedestrians, both ways"),
          "along": Range(50.0, 400.0, "1/h", "vehicles straight on, each way"),
          "speed": TOWN_SPEED}, zebra),
)  # fmt: skip
