"""Kinds at junctions without signals: a side road, an all-way stop, priority to the right, a
roundabout."""

import math
from itertools import permutations

from sumo_mcts.situations.junctions import arms
from sumo_mcts.situations.kind import TOWN_SPEED, TRUCKS, Kind, Range, Values
from sumo_mcts.situations.situation import Edge, Node, Situation, Stream

ARMS = "wsen"  # against the clock


def side_road(values: Values) -> Situation:
    """The ego turns left from a side road onto a road with the right of way."""
    speed = values["speed"]
    return Situation(
        nodes=(
            Node("c", 0.0, 0.0), Node("w", -350.0, 0.0), Node("e", 350.0, 0.0),
            Node("s", 0.0, -250.0),
        ),
        edges=(
            *(Edge(name, name[0], name[1], 1, speed, 3) for name in ("wc", "cw", "ec", "ce")),
            *(Edge(name, name[0], name[1], 1, speed) for name in ("sc", "cs")),
        ),
        streams=(
            Stream("wc ce", values["from_left"]), Stream("ec cw", values["from_right"]),
            Stream("ec cs", values["turning"]), Stream("wc cs", values["turning"]),
            Stream("sc cw", values["side"] / 2), Stream("sc ce", values["side"] / 2),
        ),
        ego_route="sc cw",
    )  # fmt: skip


def _equals(control: str, values: Values) -> Situation:
    """Four roads of one lane; the ego turns left, the others go everywhere."""
    nodes, edges = arms(control, (1, 1), values["speed"], (250.0, 250.0))
    return Situation(
        nodes, edges, tuple(_everywhere(values["arm"], "{0}c c{1}")), ego_route="wc cn"
    )


def _everywhere(per_arm: float, route: str) -> list[Stream]:
    """Streams from each arm to each other."""
    return [Stream(route.format(*pair), per_arm / 3) for pair in permutations(ARMS, 2)]


def all_way_stop(values: Values) -> Situation:
    """All stop; who came first goes first."""
    return _equals("allway_stop", values)


def right_before_left(values: Values) -> Situation:
    """Who comes from the right goes first."""
    return _equals("right_before_left", values)


def roundabout(values: Values) -> Situation:
    """The ego enters, passes two exits, and leaves by the third."""
    speed, radius = values["speed"], values["radius"]
    nodes, edges, ring = [], [], []
    for k, arm in enumerate(ARMS):
        angle = math.pi + k * math.pi / 2
        ahead = ARMS[(k + 1) % 4]
        nodes += [
            Node(arm, 250.0 * math.cos(angle), 250.0 * math.sin(angle)),
            Node(f"r{arm}", *_on_circle(radius, angle)),
        ]
        arc = tuple(_on_circle(radius, angle + j * math.pi / 16) for j in range(9))
        ring.append(Edge(f"ring_{arm}", f"r{arm}", f"r{ahead}", 1, 8.5, 3, arc))
        edges += [Edge(f"in_{arm}", arm, f"r{arm}", 1, speed),
                  Edge(f"out_{arm}", f"r{arm}", arm, 1, speed)]  # fmt: skip
    return Situation(
        tuple(nodes),
        (*edges, *ring),
        tuple(
            Stream(_through(start, end), values["arm"] / 3) for start, end in permutations(ARMS, 2)
        ),
        ego_route=_through("w", "n"),
        rings=((" ".join(f"r{arm}" for arm in ARMS), " ".join(edge.id for edge in ring)),),
    )


def _on_circle(radius: float, angle: float) -> tuple[float, float]:
    return radius * math.cos(angle), radius * math.sin(angle)


def _through(start: str, end: str) -> str:
    """The route from arm to arm through the ring."""
    first, count = ARMS.index(start), (ARMS.index(end) - ARMS.index(start)) % 4
    ring = " ".join(f"ring_{ARMS[(first + j) % 4]}" for j in range(count))
    return f"in_{start} {ring} out_{end}"


_EQUALS = {"speed": TOWN_SPEED, "trucks": TRUCKS}
KINDS = (
    Kind("side-road", "left turn from a side road into two streams with the right of way",
         {"from_left": Range(100.0, 550.0, "1/h", "vehicles from the left"),
          "from_right": Range(100.0, 550.0, "1/h", "vehicles from the right"),
          "turning": Range(20.0, 80.0, "1/h", "vehicles that turn into the side road, each way"),
          "side": Range(20.0, 100.0, "1/h", "others from the side road"),
          "speed": Range(11.0, 19.0, "m/s", "speed limit"), "trucks": TRUCKS}, side_road),
    Kind("all-way-stop", "left turn where all have to stop",
         {"arm": Range(80.0, 480.0, "1/h", "vehicles from each arm"), **_EQUALS}, all_way_stop),
    Kind("right-before-left", "left turn where the right of way is the right's",
         {"arm": Range(60.0, 400.0, "1/h", "vehicles from each arm"), **_EQUALS},
         right_before_left),
    Kind("roundabout", "entry of a roundabout, third exit",
         {"arm": Range(120.0, 620.0, "1/h", "vehicles from each arm"),
          "radius": Range(15.0, 30.0, "m", "radius of the ring"), **_EQUALS}, roundabout),
)  # fmt: skip
