"""Kinds in which the ego passes slow traffic: through the lane of the oncoming, and within its own
lane."""

from collections.abc import Sequence
from itertools import accumulate
from math import pi, sin

from sumo_mcts.situations.junctions import arms, times
from sumo_mcts.situations.kind import TRUCKS, Kind, Range, Values, one_of
from sumo_mcts.situations.situation import Companion, Edge, Node, Parked, Situation, Stream

_SIDE = one_of("where people drive", "right", "left")
_SPEEDS = {"tractor": 8.0, "bicycle": 5.6, "rider": 5.6, "moped": 8.0}  # the most of a type, m/s
IN_ROW_S = 3.0  # between those ahead

# The road with a lane of oncoming traffic to overtake in
_SLOW = one_of(
    "ahead", "car", "lorry", "tractor", "bicycle", "two cars", "four cars", "parked van"
)  # fmt: skip
_ROWS = {
    "car": ("car", 1), "lorry": ("truck", 1), "tractor": ("tractor", 1), "bicycle": ("bicycle", 1),
    "two cars": ("car", 2), "four cars": ("car", 4), "parked van": ("van", 0),
}  # fmt: skip
_ONCOMING = one_of("oncoming vehicles", "none", "90 1/h", "225 1/h")
_EDGES = one_of("edges of the road", "1", "2", "3", "4")
_COURSE = one_of("course", "straight", "wide bends", "narrow bends")
SWINGS = {"straight": 0.0, "wide bends": 8.0, "narrow bends": 18.0}  # m to each side
WAVE = 600.0  # m, from bend to bend on the same side
POINT = 20.0  # m between the points of a bend
_BETWEEN = one_of("between two edges", "nothing", "a side road")
ASIDE = 150.0  # m, length of a side road
SIDE_SPEED = 14.0  # m/s

# The road with room in the lane
_NARROW = one_of(
    "ahead", "bicycle", "two bicycles", "moped", "parked van", "parked van and bicycle"
)  # fmt: skip
_RIDERS = {
    "bicycle": ("rider", 1), "two bicycles": ("rider", 2), "moped": ("moped", 1),
    "parked van": ("van", 0), "parked van and bicycle": ("rider", 1),
}  # fmt: skip
_CARS = one_of("cars with the ego", "none", "one before and one behind it")
CARS_S = 4.0  # before and behind the ego
_LIGHT = one_of("a light after 600 m", "no", "yes")
LENGTHS = (600.0, 200.0)  # m, of the ego's road to either side of the light, of the other
PARKED_AT = 350.0  # m
VAN = 2.16  # m, width
BESIDE = 1.0  # m of it that stand beside the lane


def oncoming_lane(values: Values) -> Situation:
    """The ego follows slow traffic on a road of one lane each way."""
    speed, count = values["speed"], int(_EDGES.chosen(values, "edges"))
    swing = SWINGS[_COURSE.chosen(values, "course")]
    lengths = (values["even" if k % 2 else "odd"] for k in range(count))
    ends = list(accumulate(lengths, initial=0.0))
    there = [
        Edge(f"e{k}", f"n{k}", f"n{k + 1}", 1, speed, 3, _points(ends[k], ends[k + 1], swing))
        for k in range(count)
    ]
    back = [
        Edge(f"o{k}", edge.end, edge.start, 1, speed, 3, edge.shape[::-1])
        for k, edge in enumerate(there)
    ]
    aside = _BETWEEN.chosen(values, "between") == "a side road"
    nodes, sides, streams = _side_roads(ends, swing, values["side"]) if aside else ((), (), ())
    ahead, oncoming = _SLOW.chosen(values, "ahead"), _ONCOMING.chosen(values, "oncoming")
    if oncoming != "none":
        streams = (Stream(_road("o", count - 1, -1), float(oncoming.split()[0])), *streams)
    return Situation(
        nodes=(*(Node(f"n{k}", x, _north(x, swing)) for k, x in enumerate(ends)), *nodes),
        edges=(*there, *back, *sides),
        streams=streams,
        ego_route=_road("e", 0, count),
        netconvert=("--opposites.guess", "--opposites.guess.fix-lengths", *_left_hand(values)),
        parked=(Parked("e0", 0, 0.5 * ends[1]),) if ahead == "parked van" else (),
        companions=_row(*_ROWS[ahead], values),
    )


def _north(x: float, swing: float) -> float:
    """Where the road is at `x`, m."""
    return swing * sin(2.0 * pi * x / WAVE)


def _points(start: float, end: float, swing: float) -> tuple[tuple[float, float], ...]:
    """Those of an edge between these places, m; none where the road is straight."""
    parts = max(round((end - start) / POINT), 1) if swing else -1
    places = (start + (end - start) * k / parts for k in range(parts + 1))
    return tuple((x, _north(x, swing)) for x in places)


def _road(letter: str, first: int, stop: int) -> str:
    """The edges from `first` on until before `stop`, forwards or backwards."""
    return " ".join(f"{letter}{k}" for k in range(first, stop, 1 if first < stop else -1))


def _side_roads(
    ends: Sequence[float], swing: float, per_hour: float
) -> tuple[tuple[Node, ...], tuple[Edge, ...], tuple[Stream, ...]]:
    """A road to the south between two edges, and who comes from there or turns in."""
    last = len(ends) - 1
    nodes = tuple(Node(f"s{k}", ends[k], _north(ends[k], swing) - ASIDE) for k in range(1, last))
    edges = tuple(
        Edge(name, *between, 1, SIDE_SPEED)
        for k in range(1, last)
        for name, between in ((f"in{k}", (f"s{k}", f"n{k}")), (f"out{k}", (f"n{k}", f"s{k}")))
    )
    streams = tuple(
        Stream(route, per_hour)
        for k in range(1, last)
        for route in (
            f"in{k} {_road('e', k, last)}", f"in{k} {_road('o', k - 1, -1)}",
            f"{_road('o', last - 1, k - 1)} out{k}",
        )
    )  # fmt: skip
    return nodes, edges, streams


def _row(vtype: str, number: int, values: Values) -> tuple[Companion, ...]:
    """So many in a row, the last of them `distance` m ahead of the ego when it departs."""
    share = 1.0 if vtype in _SPEEDS else values.get("share", 1.0)
    before = values["distance"] / min(_SPEEDS.get(vtype, 100.0), share * values["speed"])
    return tuple(Companion(vtype, before + k * IN_ROW_S, share) for k in range(number))


def _left_hand(values: Values) -> tuple[str, ...]:
    """netconvert's option for the side on which people drive."""
    return ("--lefthand",) if _SIDE.chosen(values, "hand") == "left" else ()


def own_lane(values: Values) -> Situation:
    """The ego comes up behind narrow traffic at the edge of its lane, one lane each way."""
    width, light = values["width"], _LIGHT.chosen(values, "light") == "yes"
    nodes, edges = arms("traffic_light" if light else "priority", (1, 1), values["speed"], LENGTHS)
    ahead = _NARROW.chosen(values, "ahead")
    beside = () if _CARS.chosen(values, "cars") == "none" else (CARS_S, -CARS_S)
    across = (Stream("nc cs", values["across"]), Stream("sc cn", values["across"]))
    along = set("wce")
    return Situation(
        nodes=tuple(node for node in nodes if light or node.id in along),
        edges=tuple(
            edge._replace(width=width) if set(edge.id) <= along else edge
            for edge in edges
            if light or set(edge.id) <= along
        ),
        streams=(Stream("ec cw", values["oncoming"]), *(across if light else ())),
        ego_route="wc ce",
        netconvert=(*times(values["green"]), *_left_hand(values)),
        parked=(Parked("wc", 0, PARKED_AT, 0.5 * (VAN - width) - BESIDE),)
        if "parked van" in ahead
        else (),
        companions=(
            *_row(*_RIDERS[ahead], values),
            *(Companion("car", before) for before in beside),
        ),
        lateral=values["lateral"],
    )


_DISTANCE = Range(60.0, 200.0, "m", "from the ego to those ahead when it departs")
_WIDE = {
    "ahead": _NARROW,
    "cars": _CARS,
    "distance": _DISTANCE,
    "oncoming": Range(50.0, 600.0, "1/h", "oncoming vehicles"),
    "light": _LIGHT,
    "green": Range(15.0, 42.0, "s", "green of a phase"),
    "across": Range(50.0, 200.0, "1/h", "vehicles across, each way"),
    "hand": _SIDE,
    "lateral": Range(0.4, 1.6, "m", "SUMO's lateral resolution"),
    "speed": Range(8.3, 19.4, "m/s", "speed limit"),
    "trucks": TRUCKS,
}
_NARROWER = one_of("ahead", *_NARROW.choices[:2])  # the first ones of the wide lane
KINDS = (
    Kind("oncoming-lane", "past slow traffic through the lane of the oncoming",
         {"ahead": _SLOW,
          "share": Range(0.35, 0.6, "", "speed of cars and lorries ahead, as a share of the limit"),
          "distance": _DISTANCE, "oncoming": _ONCOMING,
          "edges": _EDGES,
          "odd": Range(300.0, 2250.0, "m", "length of the first and third edge"),
          "even": Range(300.0, 2250.0, "m", "length of the second and fourth edge"),
          "course": _COURSE, "between": _BETWEEN,
          "side": Range(10.0, 60.0, "1/h", "vehicles of each turn at a side road"),
          "hand": _SIDE, "speed": Range(13.9, 27.8, "m/s", "speed limit"), "trucks": TRUCKS},
         oncoming_lane),
    Kind("wide-lane", "past narrow traffic within a wide lane",
         {"width": Range(4.0, 6.0, "m", "width of the lane"), **_WIDE}, own_lane),
    Kind("narrow-lane", "behind bicycles in a lane with hardly any room to pass",
         {"width": Range(3.0, 3.75, "m", "width of the lane"), **_WIDE, "ahead": _NARROWER},
         own_lane),
)  # fmt: skip
