"""Rules at signals, signs and rails, a kind for each."""

from sumo_mcts.situations.junctions import GREEN, arms, times
from sumo_mcts.situations.kind import TOWN_SPEED, TRUCKS, Kind, Range, Values
from sumo_mcts.situations.situation import Edge, Link, Node, Situation, Stream


def _straight(values: Values, *netconvert: str) -> Situation:
    """The ego crosses a signal straight on."""
    nodes, edges = arms("traffic_light", (1, 1), values["speed"])
    return Situation(
        nodes,
        edges,
        (
            Stream("wc ce", values["along"]), Stream("ec cw", values["along"]),
            Stream("nc cs", values["across"]), Stream("sc cn", values["across"]),
        ),
        ego_route="wc ce",
        netconvert=netconvert,
    )  # fmt: skip


def yellow(values: Values) -> Situation:
    """Greens are short, so the light often turns yellow before the ego."""
    return _straight(
        values, *times(values["green"]), "--tls.yellow.time", f"{values['yellow']:.0f}"
    )


def actuated(values: Values) -> Situation:
    """Detectors decide when the phases end."""
    return _straight(values, "--tls.default-type", "actuated", "--tls.left-green.time", "0")


def _major_minor(control: str, values: Values, ego_route: str) -> Situation:
    """A road with the right of way from west to east, a side road from south to north."""
    nodes, edges = arms(control, (1, 1), values["speed"], (300.0, 200.0))
    ranked = tuple(edge._replace(priority=3 if edge.id in MAJOR else 1) for edge in edges)
    return Situation(
        nodes,
        ranked,
        (
            Stream("wc ce", values["major"]), Stream("ec cw", values["major"]),
            Stream("nc cs", values["minor"]), Stream("sc cn", values["minor"]),
            Stream("ec cs", values["minor"] / 2),
        ),
        ego_route=ego_route,
    )  # fmt: skip


def priority_road(values: Values) -> Situation:
    """The ego has the right of way; vehicles wait on both sides, and oncoming ones turn left."""
    return _major_minor("priority", values, "wc ce")


def stop_sign(values: Values) -> Situation:
    """The ego has to stop, and then crosses two streams."""
    return _major_minor("priority_stop", values, "sc cn")


def right_on_red(values: Values) -> Situation:
    """The ego turns right at a signal where that is allowed at red, after a stop."""
    nodes, edges = arms("traffic_light_right_on_red", (1, 1), values["speed"])
    return Situation(
        nodes,
        edges,
        (
            Stream("ec cw", values["along"]), Stream("wc cs", values["along"] / 4),
            Stream("nc cs", values["across"]), Stream("sc cn", values["across"]),
        ),
        ego_route="wc cs",
        netconvert=times(values["green"]),
    )  # fmt: skip


def blocked_exit(values: Values) -> Situation:
    """Behind a junction, a short road before a signal is often full; cross traffic has to get
    through."""
    speed, length = values["speed"], values["length"]
    return Situation(
        nodes=(
            Node("a", -300.0, 0.0), Node("c", 0.0, 0.0), Node("d", length, 0.0, "traffic_light"),
            Node("e", length + 250.0, 0.0), Node("n", 0.0, 200.0), Node("s", 0.0, -200.0),
            Node("u", length, 200.0), Node("v", length, -200.0),
        ),
        edges=(
            Edge("in", "a", "c", 1, speed, 3), Edge("short", "c", "d", 1, speed, 3),
            Edge("out", "d", "e", 1, speed, 3),
            Edge("nc", "n", "c", 1, speed), Edge("cs", "c", "s", 1, speed),
            Edge("ud", "u", "d", 1, speed), Edge("dv", "d", "v", 1, speed),
        ),
        links=(
            Link("in", "short", 0, 0), Link("short", "out", 0, 0),
            Link("nc", "cs", 0, 0), Link("ud", "dv", 0, 0),
        ),
        streams=(
            Stream("in short out", values["along"]), Stream("nc cs", values["across"]),
            Stream("ud dv", values["across"]),
        ),
        ego_route="in short out",
        netconvert=times(values["green"], None),
    )  # fmt: skip


def level_crossing(values: Values) -> Situation:
    """Trains cross the road, one every minute or two."""
    speed = values["speed"]
    return Situation(
        nodes=(
            Node("c", 0.0, 0.0, "rail_crossing"), Node("w", -350.0, 0.0), Node("e", 350.0, 0.0),
            Node("n", 0.0, 900.0), Node("s", 0.0, -900.0),
        ),
        edges=(
            *(Edge(name, name[0], name[1], 1, speed) for name in ("wc", "ce", "ec", "cw")),
            *(Edge(name, name[0], name[1], 1, values["train"], only=((0, "rail"),))
              for name in ("nc", "cs")),
        ),
        links=(Link("wc", "ce", 0, 0), Link("ec", "cw", 0, 0), Link("nc", "cs", 0, 0)),
        streams=(
            Stream("wc ce", values["along"]), Stream("ec cw", values["along"]),
            Stream("nc cs", values["trains"], regular=True, vtype="train"),
        ),
        ego_route="wc ce",
    )  # fmt: skip


MAJOR = ("wc", "cw", "ec", "ce")
_ALONG = Range(100.0, 500.0, "1/h", "vehicles on the ego's road, each way")
_ACROSS = Range(100.0, 400.0, "1/h", "vehicles across, each way")
_LIGHT = {"along": _ALONG, "across": _ACROSS, "speed": TOWN_SPEED, "trucks": TRUCKS}
_SIGN = {
    "major": Range(100.0, 400.0, "1/h", "vehicles with the right of way, each way"),
    "minor": Range(40.0, 160.0, "1/h", "vehicles from each side road"),
    "speed": TOWN_SPEED,
    "trucks": TRUCKS,
}
KINDS = (
    Kind("yellow", "straight on at a signal with short phases",
         {"green": Range(8.0, 16.0, "s", "green of a phase"),
          "yellow": Range(3.0, 5.0, "s", "yellow"), **_LIGHT}, yellow),
    Kind("actuated", "straight on at a signal whose phases end when detectors say so",
         _LIGHT, actuated),
    Kind("priority-road", "straight on with the right of way", _SIGN, priority_road),
    Kind("stop-sign", "straight on from a side road, after a stop", _SIGN, stop_sign),
    Kind("right-on-red", "right turn that is allowed at red, after a stop",
         {"green": GREEN, **_LIGHT}, right_on_red),
    Kind("blocked-exit", "across a junction behind which a queue stands",
         {"length": Range(40.0, 90.0, "m", "way from the junction to the signal"),
          "green": Range(15.0, 30.0, "s", "green of a phase"),
          "along": Range(250.0, 600.0, "1/h", "vehicles on the ego's road"),
          "across": _ACROSS, "speed": TOWN_SPEED, "trucks": TRUCKS}, blocked_exit),
    Kind("level-crossing", "over rails that trains use",
         {"trains": Range(25.0, 60.0, "1/h", "trains"),
          "train": Range(15.0, 35.0, "m/s", "speed limit of the trains"),
          "along": _ALONG, "speed": TOWN_SPEED, "trucks": TRUCKS}, level_crossing),
)  # fmt: skip
