"""Kinds at signals: permissive and protected left turns, a queue to change into, a turn beside a
crossing."""

from sumo_mcts.situations.kind import TOWN_SPEED, TRUCKS, Kind, Range, Values
from sumo_mcts.situations.situation import Edge, Link, Node, Situation, Stream

GREEN = Range(22.0, 42.0, "s", "green of a phase")
# netconvert's options for room beside the road
BESIDE = (
    "--sidewalks.guess", "true", "--crossings.guess", "true", "--bikelanes.guess", "true",
    "--sidewalks.guess.max-speed", "20", "--bikelanes.guess.max-speed", "20",
)  # fmt: skip


def arms(
    control: str,
    lanes: tuple[int, int],
    speed: float,
    lengths: tuple[float, float] = (400.0, 250.0),
) -> tuple[tuple[Node, ...], tuple[Edge, ...]]:
    """A crossing of two roads: edges wc, cw (from and to the west) and so on.

    control: type of the junction, as netconvert names it
    lanes, lengths (m): of the road from west to east, of the other
    """
    ends = {"w": (-1, 0), "e": (1, 0), "n": (0, 1), "s": (0, -1)}
    nodes = [Node("c", 0.0, 0.0, control)]
    edges = []
    for name, (x, y) in ends.items():
        across = name in "ns"
        nodes.append(Node(name, x * lengths[across], y * lengths[across]))
        # roads of one priority are equals at a junction without signals
        edges += [Edge(f"{name}c", name, "c", lanes[across], speed),
                  Edge(f"c{name}", "c", name, lanes[across], speed)]  # fmt: skip
    return tuple(nodes), tuple(edges)


def times(green: float, left: float | None = 0.0) -> tuple[str, ...]:
    """netconvert's options for the green of a phase and of the one for left turns, s.

    0: left turns have no phase of their own; None: as netconvert has it.
    """
    first = ("--tls.green.time", f"{green:.0f}")
    return first if left is None else (*first, "--tls.left-green.time", f"{left:.0f}")


def _left(values: Values, left_green: float) -> Situation:
    """The ego turns left from the west across the stream from the east."""
    nodes, edges = arms("traffic_light", (3, 2), values["speed"])
    return Situation(
        nodes,
        edges,
        (
            Stream("ec cw", values["oncoming"], "random"),
            Stream("wc ce", values["along"], "random"),
            Stream("wc cn", values["lefts"]),
            Stream("ec cs", values["lefts"]),
            Stream("nc cs", values["across"], "random"),
            Stream("sc cn", values["across"], "random"),
        ),
        ego_route="wc cn",
        ego_lane="1",
        netconvert=times(values["green"], left_green),
    )  # fmt: skip


def permissive_left(values: Values) -> Situation:
    """Left turns have no phase of their own."""
    return _left(values, 0.0)


def protected_left(values: Values) -> Situation:
    """Left turns may go in gaps, and then have a phase of their own."""
    return _left(values, values["left_green"])


def queue_change(values: Values) -> Situation:
    """The ego is in the right lane; the lane to the left is a queue before a signal."""
    speed = values["speed"]
    return Situation(
        nodes=(
            Node("a", -values["length"], 0.0), Node("c", 0.0, 0.0, "traffic_light"),
            Node("e", 300.0, 0.0), Node("n", 0.0, 300.0), Node("s", 0.0, -300.0),
        ),
        edges=(
            Edge("in", "a", "c", 3, speed), Edge("out", "c", "e", 2, speed),
            Edge("left", "c", "n", 1, speed), Edge("side", "s", "c", 2, speed),
        ),
        links=(
            Link("in", "out", 0, 0), Link("in", "out", 1, 1), Link("in", "left", 2, 0),
            Link("side", "out", 0, 0), Link("side", "left", 1, 0),
        ),
        streams=(
            Stream("in left", values["lefts"]), Stream("in out", values["along"]),
            Stream("side out", values["side"]),
        ),
        ego_route="in left",
        ego_lane="0",
        netconvert=times(values["green"], None),
    )  # fmt: skip


def crossing(values: Values) -> Situation:
    """The ego turns left across oncoming cars, bicycles, and a crossing with pedestrians.

    Cars alone: the place to wait is so near to the oncoming lane that a truck would graze the ego.
    """
    nodes, edges = arms("traffic_light", (2, 1), values["speed"])
    walking, riding = values["pedestrians"] / 2, values["bicycles"] / 2
    return Situation(
        nodes,
        edges,
        (
            Stream("ec cw", values["oncoming"]),
            Stream("wc ce", values["along"]),
            Stream("nc cs", values["across"]),
            *(Stream(route, walking, vtype="pedestrian") for route in ("wc ce", "ec cw")),
            *(Stream(route, riding, vtype="bicycle") for route in ("wc ce", "ec cw")),
        ),
        ego_route="wc cn",
        netconvert=(*times(values["green"]), *BESIDE),
    )  # fmt: skip


_LEFT = {
    "along": Range(200.0, 700.0, "1/h", "vehicles straight on beside the ego"),
    "lefts": Range(30.0, 100.0, "1/h", "left turns from either side"),
    "across": Range(100.0, 400.0, "1/h", "vehicles on the other road, each way"),
    "green": GREEN,
    "speed": TOWN_SPEED,
    "trucks": TRUCKS,
}
KINDS = (
    Kind("permissive-left", "left turn at a signal, through gaps in the oncoming stream alone",
         {"oncoming": Range(200.0, 1000.0, "1/h", "oncoming vehicles"), **_LEFT}, permissive_left),
    Kind("protected-left", "left turn through gaps, then with a phase of its own",
         {"oncoming": Range(400.0, 1400.0, "1/h", "oncoming vehicles"),
          "left_green": Range(5.0, 10.0, "s", "green of the left turns alone"), **_LEFT},
         protected_left),
    Kind("queue-change", "change into a queue before a signal",
         {"lefts": Range(200.0, 1000.0, "1/h", "vehicles in the queue's lane"),
          "along": Range(200.0, 1200.0, "1/h", "vehicles straight on"),
          "side": Range(50.0, 400.0, "1/h", "vehicles from the side"),
          "length": Range(400.0, 700.0, "m", "way to the signal"),
          "green": GREEN, "speed": TOWN_SPEED, "trucks": TRUCKS}, queue_change),
    Kind("crossing", "permissive left turn beside a crossing with pedestrians and bicycles",
         {"oncoming": Range(100.0, 800.0, "1/h", "oncoming vehicles"),
          "along": Range(50.0, 500.0, "1/h", "vehicles straight on behind and before the ego"),
          "across": Range(50.0, 500.0, "1/h", "vehicles on the other road"),
          "pedestrians": Range(60.0, 900.0, "1/h", "pedestrians over the crossing, both ways"),
          "bicycles": Range(30.0, 300.0, "1/h", "bicycles, both ways"),
          "green": GREEN, "speed": TOWN_SPEED}, crossing),
)  # fmt: skip
