"""From a SUMO network file to scene.RoadMap: lanes, connections, right of way, and where the paths through a junction meet."""

import zlib
from collections import defaultdict
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from xml.sax import SAXException
from xml.sax.expatreader import ExpatParser

import numpy as np
import sumolib  # type: ignore[import-untyped]
from numpy.typing import NDArray

from sumo_mcts import files
from sumo_mcts.config import ConfigError
from sumo_mcts.errors import near
from sumo_mcts.scene import (
    ALLWAY,
    LEFT,
    PRIORITY,
    RIGHT,
    STOP,
    STRAIGHT,
    TURN,
    VEHICLE_CLASSES,
    YIELD,
    ZIPPER,
    Bools,
    Floats,
    Ints,
    RoadMap,
)

REACH = 2.2  # m: foes whose centre lines come closer than this share the road
TOUCH = 1.9  # m: the same where SUMO sees no foes: two cars of 1.8 m just pass
SIDE_BY_SIDE = 0.75  # ... but never more than this share of the distance at which the two lanes would lie next to each other
APART = 5.0  # m: two meetings of the same two paths count as one when less lies between them
SAMPLING = 0.5  # m between the points at which two centre lines are compared
KNOT = 25.0  # m: junctions with shorter lanes between them are one place
NAMED = 6  # edges that a message names
TINY = 0.01  # m: the length given to a lane whose shape has none, so that it has a heading
LEAST_SPEED = 0.1  # m/s: a lane with a lower limit cannot be driven
MOST_SPEED, MOST_LENGTH, MOST_WIDTH, FARTHEST = 1000.0, 1e6, 100.0, 1e8  # m/s, m, m, m: beyond them a number is taken for damage
MOST_DURATION = 1e9  # s, of a phase of a signal
MOST_POINTS = 2000  # at which an internal lane is sampled
MOST_IN_CHAIN = 20  # internal lanes of one way across a junction
MOST_UNPACKED = 1 << 30  # bytes of a network

_DIRECTIONS = {"s": STRAIGHT, "l": LEFT, "L": LEFT, "r": RIGHT, "R": RIGHT, "t": TURN, "T": TURN}
_RULES = {"m": YIELD, "=": YIELD, "o": YIELD, "s": STOP, "w": ALLWAY, "Z": ZIPPER}
_PARENTS = {"lane": "edge", "request": "junction", "phase": "tlLogic", **dict.fromkeys(("edge", "junction", "connection", "tlLogic", "location"), "net")}
_ON_FOOT = ("walkingarea", "crossing")
_BROKEN = (OSError, EOFError, zlib.error, SAXException, ValueError, LookupError, AttributeError, TypeError)


class _NoInternalLanesError(Exception):
    """There are signals or stop signs, but no lanes inside junctions, which they belong to."""


class _Link(NamedTuple):
    """One way across a junction: ordinary lane `origin` to ordinary lane `exit` along the internal lanes of `chain`."""

    origin: int
    exit: int
    chain: tuple[int, ...]  # empty where the network has no internal lanes
    edges: tuple[str, str]  # those of origin and exit
    junction: int
    duty: int  # bit k set: lets link k of the junction pass
    foes: int  # bit k set: SUMO holds that it meets link k
    number: int  # its own bit in the duties of the others, -1 unknown
    direction: int
    rule: int
    signal: int
    signal_link: int
    classes: int  # bit mask over VEHICLE_CLASSES


class _Path(NamedTuple):
    """One internal lane, sampled. n points."""

    lane: int
    link: _Link
    last: bool  # the next lane is an ordinary one
    width: float  # m
    points: Floats  # [n, 2] m
    s: Floats  # [n] SUMO lane positions, m
    low: Floats  # [2] corner of the bounding box, m
    high: Floats  # [2] m


class _Conflict(NamedTuple):
    """Where path `lane` meets path `other`; the field names of RoadMap without their prefix."""

    lane: int
    other: int
    begin: float
    end: float
    other_begin: float
    other_end: float
    merge: bool
    yields: bool


def read_roadmap(net_file: str) -> RoadMap:
    """The network in `net_file` (.net.xml or .net.xml.gz) as arrays; lanes in the order of the file. ConfigError where it cannot be read."""
    why = files.problem(net_file)
    if why:
        raise ConfigError(f"{net_file}: {why.replace('such file', 'such network file')}")
    try:
        road = _convert(_read(net_file))
    except _NoInternalLanesError:
        raise ConfigError(
            f"{net_file}: signals or stop signs, but no lanes inside junctions, without which nobody heeds them; "
            "build the network again without --no-internal-links (netconvert -s FILE -o NEW)"
        ) from None
    except _BROKEN as error:
        # sumolib fails in many ways on a file that is not what it expects
        missing = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        reason = error.strerror if isinstance(error, OSError) else missing or type(error).__name__
        raise ConfigError(f"{net_file}: not a readable SUMO network ({reason})") from error
    if not road.lane_ids:
        raise ConfigError(f"{net_file}: not a SUMO network with lanes")
    return road


def _read(net_file: str) -> Any:
    """The network as sumolib has it. Raises OSError, ValueError, and what sumolib and its parser do, with the line."""
    root = files.xml_root(net_file)
    if root != "net":
        raise ValueError(f"its root element is {root}, that of a network is net")
    files.require_whole(net_file, MOST_UNPACKED)
    reader = _Reader(withInternal=True)
    parser = ExpatParser()
    parser.setContentHandler(reader)
    try:
        for chunk in files.unpacked(net_file, MOST_UNPACKED):
            parser.feed(chunk)
        parser.close()
    except SAXException:
        raise
    except _BROKEN as error:
        missing = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise ValueError(f"line {parser.getLineNumber()}: {missing or type(error).__name__}") from error
    return reader.getNet()


class _Reader(sumolib.net.NetReader):  # type: ignore[misc]  # sumolib has no types
    """Refuses what sumolib lets pass and SUMO does not survive: elements out of place, and lanes that are not counted through."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self._inside: list[str] = []
        self._edge, self._lanes = "", 0

    def startElement(self, name: str, attrs: Any) -> None:  # noqa: N802  # the parser's name
        """Called by the parser."""
        parent = self._inside[-1] if self._inside else ""
        if _PARENTS.get(name, parent) != parent:
            raise ValueError(f"{name}: inside {parent}, not {_PARENTS[name]}")
        if name == "edge":
            self._edge, self._lanes = attrs["id"], 0
        elif name == "lane":
            if attrs["id"] != f"{self._edge}_{self._lanes}":
                raise ValueError(f"lane {attrs['id']}: number {self._lanes} of edge {self._edge}, so its id has to be {self._edge}_{self._lanes}")
            self._lanes += 1
        elif name == "phase":
            for key in ("duration", "minDur", "maxDur"):
                _require_within(f"phase: {key}", float(attrs.get(key, 0.0)), 0.0, MOST_DURATION)
        self._inside.append(name)
        super().startElement(name, attrs)

    def endElement(self, name: str) -> None:  # noqa: N802  # the parser's name
        """Called by the parser."""
        self._inside.pop()
        super().endElement(name)


_known: dict[str, RoadMap] = {}  # read once in a process


def known_roadmap(net_file: str) -> RoadMap:
    """As read_roadmap, from memory where the file is still the same."""
    path = files.absolute(Path(net_file))
    key = "" if files.problem(path) else f"{path}:{path.stat().st_mtime_ns}"
    if key not in _known:
        _known[key] = read_roadmap(net_file)
    return _known[key]


def has_edge(road: RoadMap, edge: str, where: str) -> None:
    """Raise ConfigError, with `where` in front, where the network has no such edge."""
    ordinary = [name for name in road.edge_ids if not name.startswith(":")]
    if edge not in ordinary:
        like = near(edge, ordinary, NAMED) or ordinary[:NAMED]
        raise ConfigError(f"{where}: the network has no edge {edge}; among its {len(ordinary)} edges: {', '.join(like)}")


def lane_index(road: RoadMap) -> dict[str, int]:
    """Lane id -> index."""
    return {name: i for i, name in enumerate(road.lane_ids)}


def lane_shape(road: RoadMap, lane: int) -> Floats:
    """Centre line of a lane: [n, 2], m, n >= 2."""
    return road.points[road.point_offset[lane] : road.point_offset[lane + 1]]


def _convert(net: Any) -> RoadMap:
    edges = list(net.getEdges())
    for edge in edges:
        _require_sound(edge)
    _require_reached(edges)
    lanes = [lane for edge in edges for lane in edge.getLanes()]
    ids = [f"{edge.getID()}_{i}" for edge in edges for i in range(len(edge.getLanes()))]
    number = {name: i for i, name in enumerate(ids)}
    junctions = {node.getID(): i for i, node in enumerate(net.getNodes())}
    following = [_following(lane, number) for lane in lanes]
    offset, points, point_s = _flatten(_shapes(lanes, following))
    fields = _lane_fields(edges, lanes, junctions, offset, points)
    signal_ids, links = _read_links(net, number, junctions)
    if any(not link.chain and (link.signal >= 0 or link.rule in (STOP, ALLWAY)) for link in links):
        raise _NoInternalLanesError
    paths = [_path(lane, link, fields["width"][lane], fields["length"][lane], points[offset[lane] : offset[lane + 1]]) for link in links for lane in link.chain]
    return RoadMap(
        lane_ids=tuple(ids),
        edge_ids=tuple(edge.getID() for edge in edges),
        junction_ids=tuple(junctions),
        signal_ids=signal_ids,
        point_offset=offset,
        points=points,
        point_s=point_s,
        scale=point_s[offset[1:] - 1] / np.maximum(fields["length"], 1e-9),
        successor_offset=_offsets([len(lanes_after) for lanes_after in following]),
        successor=np.array([lane for lanes_after in following for lane in lanes_after], dtype=np.int32),
        **{**fields, **_link_fields(fields["classes"], links), **_conflict_fields(paths, len(lanes))},
    )


def _lane_fields(edges: Sequence[Any], lanes: Sequence[Any], junctions: dict[str, int], offset: Ints, points: Floats) -> dict[str, Any]:
    """What a RoadMap says of each lane alone."""
    edge = np.repeat(np.arange(len(edges), dtype=np.int32), [len(each.getLanes()) for each in edges])
    internal = np.array([lane.getEdge().isSpecial() for lane in lanes], dtype=np.bool_)
    begins = np.array([junctions[lane.getEdge().getFromNode().getID()] for lane in lanes], dtype=np.int32)
    ends = np.array([junctions[lane.getEdge().getToNode().getID()] for lane in lanes], dtype=np.int32)
    length = np.array([lane.getLength() for lane in lanes], dtype=np.float64)
    speed = np.array([lane.getSpeed() for lane in lanes], dtype=np.float64)
    classes = np.array([_mask(frozenset(lane.getPermissions())) for lane in lanes], dtype=np.uint64)
    closed = speed < LEAST_SPEED
    classes[closed] = 0
    lefthand = _is_lefthand(edge, internal, offset, points)
    return {
        "lefthand": lefthand,
        "edge": edge,
        "index": np.array([i for each in edges for i in range(len(each.getLanes()))[:: -1 if lefthand else 1]], dtype=np.int32),
        "internal": internal,
        "length": length,
        "width": np.array([lane.getWidth() for lane in lanes], dtype=np.float64),
        "speed": np.where(closed, LEAST_SPEED, speed),
        "classes": classes,
        "left": _neighbours(edge, -1 if lefthand else 1),
        "right": _neighbours(edge, 1 if lefthand else -1),
        "junction": np.where(internal, begins, -1).astype(np.int32),
        **knots(internal, length, begins, ends),
    }


def _link_fields(classes: NDArray[np.uint64], links: Sequence[_Link]) -> dict[str, Any]:
    """What it says of the lanes inside junctions, by the ways across that they belong to; `classes` [L]: who may drive where, as the lanes say."""
    count, classes = len(classes), classes.copy()
    exit_lane = np.arange(count, dtype=np.int32)
    direction, rule = np.full((2, count), [[STRAIGHT], [PRIORITY]], dtype=np.int32)
    signal, signal_link = np.full((2, count), -1, dtype=np.int32)
    for link in links:
        chain, first = list(link.chain), list(link.chain[:1])
        exit_lane[chain] = link.exit
        direction[chain] = link.direction
        classes[chain] &= np.uint64(link.classes)
        rule[first] = link.rule
        signal[first] = link.signal
        signal_link[first] = link.signal_link
    return {"exit": exit_lane, "direction": direction, "classes": classes, "rule": rule, "signal": signal, "link": signal_link}


def _conflict_fields(paths: Sequence[_Path], lanes: int) -> dict[str, Any]:
    """Where the paths through a junction meet."""
    conflicts = sorted(_conflicts(paths))
    field = _Conflict(*zip(*conflicts, strict=True)) if conflicts else _Conflict(*([],) * len(_Conflict._fields))  # type: ignore[arg-type]
    return {
        "conflict_offset": _offsets(np.bincount(np.array(field.lane, dtype=np.int64), minlength=lanes).tolist()),
        "conflict_lane": np.array(field.other, dtype=np.int32),
        "conflict_begin": np.array(field.begin, dtype=np.float64),
        "conflict_end": np.array(field.end, dtype=np.float64),
        "conflict_other_begin": np.array(field.other_begin, dtype=np.float64),
        "conflict_other_end": np.array(field.other_end, dtype=np.float64),
        "conflict_merge": np.array(field.merge, dtype=np.bool_),
        "conflict_yields": np.array(field.yields, dtype=np.bool_),
    }


# --- what cannot be computed with ---


def _require_sound(edge: Any) -> None:
    """Raise ValueError that names the lane where an edge holds what is no road."""
    if None in (edge.getFromNode(), edge.getToNode()):
        raise ValueError(f"edge {edge.getID()}: from and to: have to be junctions")
    if not edge.getLanes():
        raise ValueError(f"edge {edge.getID()} has no lanes")
    for number, lane in enumerate(edge.getLanes()):
        name = f"lane {edge.getID()}_{number}"
        _require_within(f"{name}: speed", lane.getSpeed(), -MOST_SPEED, MOST_SPEED)
        _require_within(f"{name}: length", lane.getLength(), TINY, MOST_LENGTH)
        _require_within(f"{name}: width", lane.getWidth(), TINY, MOST_WIDTH)
        if not lane.getShape():
            raise ValueError(f"{name}: shape: not given")
        for coordinate in (each for point in lane.getShape() for each in point):
            _require_within(f"{name}: shape", coordinate, -FARTHEST, FARTHEST)


def _require_reached(edges: Sequence[Any]) -> None:
    """Raise ValueError where no way leads over a lane inside a junction: SUMO does not survive that."""
    reached = {connection.getViaLaneID() for edge in edges for lane in edge.getLanes() for connection in lane.getOutgoing()}
    inside = (edge for edge in edges if edge.getFunction() == "internal")
    lost = next((name for edge in inside for name in (f"{edge.getID()}_{i}" for i in range(len(edge.getLanes()))) if name not in reached), None)
    if lost is not None:
        raise ValueError(f"lane {lost}, inside a junction, belongs to no connection")


def _require_within(what: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise ValueError(f"{what}: has to be from {low:g} to {high:g}, got {value:g}")


# --- lanes ---


@cache
def _mask(allowed: frozenset[str]) -> int:
    """Bit mask over VEHICLE_CLASSES of the classes named."""
    return sum(1 << i for i, name in enumerate(VEHICLE_CLASSES) if name in allowed or "all" in allowed)


def _offsets(counts: Sequence[int]) -> Ints:
    """[n] counts -> [n+1] where each share begins and the last ends."""
    return np.concatenate(([0], np.cumsum(counts))).astype(np.int32)


def _neighbours(edge: Ints, step: int) -> Ints:
    """[L] the lane `step` places further on the same edge, or -1; lanes of an edge stand together."""
    there = np.arange(len(edge), dtype=np.int32) + step
    inside = (there >= 0) & (there < len(edge))
    there[~inside] = 0
    return np.where(inside & (edge[there] == edge), there, -1).astype(np.int32)


def _is_lefthand(edge: Ints, internal: Bools, offset: Ints, points: Floats) -> bool:
    """Whether the second lane of an edge lies to the right of the first one. The network file says it too, but sumolib does not read it."""
    pairs = np.flatnonzero((edge[1:] == edge[:-1]) & ~internal[1:])
    if not len(pairs):
        return False
    along = points[offset[pairs] + 1] - points[offset[pairs]]
    aside = points[offset[pairs + 1]] - points[offset[pairs]]
    return bool(np.median(along[:, 0] * aside[:, 1] - along[:, 1] * aside[:, 0]) < 0.0)


def sumo_lane(road: RoadMap, lane: int) -> int:
    """The number that SUMO gives a lane of its edge: counted from the left where people drive on the left."""
    return int(road.lane_ids[lane].rsplit("_", 1)[1])


def _connections(lane: Any) -> list[Any]:
    """The ways on from a lane that vehicles may take."""
    if lane.getEdge().getFunction() in _ON_FOOT:
        return []
    return [connection for connection in lane.getOutgoing() if connection.getTo().getFunction() not in _ON_FOOT]


def _next_id(connection: Any) -> str:
    """The lane driven next: the internal one where there is one."""
    return str(connection.getViaLaneID() or connection.getToLane().getID())


def _following(lane: Any, number: dict[str, int]) -> list[int]:
    return [number[_next_id(connection)] for connection in _connections(lane)]


def _shapes(lanes: Sequence[Any], following: Sequence[Sequence[int]]) -> list[Floats]:
    """Centre line of each lane, [n >= 2, 2] m, no two consecutive points equal."""
    shapes = [_distinct(np.array(lane.getShape(), dtype=np.float64).reshape(-1, 2)) for lane in lanes]
    return [shape if len(shape) > 1 else _stretched(shape, [shapes[i] for i in after]) for shape, after in zip(shapes, following, strict=True)]


def _distinct(shape: Floats) -> Floats:
    keep = np.ones(len(shape), dtype=np.bool_)
    keep[1:] = np.any(shape[1:] != shape[:-1], axis=1)
    return shape[keep]


def _stretched(point: Floats, after: Sequence[Floats]) -> Floats:
    """A very short line from the only point of a lane, in the direction in which the road goes on; east where nothing tells."""
    way = next((shape[1] - shape[0] for shape in after if len(shape) > 1), np.array([1.0, 0.0]))
    return np.concatenate((point, point + TINY * way / np.linalg.norm(way)))


def _flatten(shapes: Sequence[Floats]) -> tuple[Ints, Floats, Floats]:
    """Offsets [L+1], points [P, 2] and arc length of each point along its lane [P], m."""
    arcs = [np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(shape, axis=0), axis=1)))) for shape in shapes]
    return _offsets([len(shape) for shape in shapes]), np.concatenate(shapes or [np.zeros((0, 2))]), np.concatenate(arcs or [np.zeros(0)])


# --- connections and right of way ---


def knots(internal: Bools, length: Floats, begins: Ints, ends: Ints) -> dict[str, Ints]:
    """RoadMap.knot, begins and ends, from the junctions [L] where lanes begin and end (-1: nowhere; of internal lanes that which they lie in)."""
    inside = internal | (length < KNOT)
    name = np.arange(max(begins.max(initial=-1), ends.max(initial=-1)) + 2)  # the last one is that of nowhere
    joins = np.unique(np.column_stack([begins, ends])[inside & (begins >= 0) & (ends >= 0) & (begins != ends)], axis=0)
    for a, b in joins:  # once for an edge, not for each of its lanes
        name[name == name[b]] = name[a]
    name[-1] = -1
    return {key: values.astype(np.int32) for key, values in (("knot", np.where(inside, name[begins], -1)), ("begins", name[begins]), ("ends", name[ends]))}


def _read_links(net: Any, number: dict[str, int], junction_number: dict[str, int]) -> tuple[tuple[str, ...], list[_Link]]:
    """Signal ids in the order of their first link, and every way across a junction."""
    signals: dict[str, int] = {}
    links: list[_Link] = []
    for edge in net.getEdges(withInternal=False):
        node = edge.getToNode()
        # intLanes names the last internal lane of each link, in the order of the right-of-way matrix
        place = {lane: i for i, lane in enumerate(node.getInternal() or ())}
        # bit strings are read from the right, which is what int() does; sumolib keeps them private
        duty = {i: int(bits, 2) for i, bits in node._prohibits.items()}
        foes = {i: int(bits, 2) for i, bits in node._foes.items()}
        for connection in (connection for lane in edge.getLanes() for connection in _connections(lane)):
            chain = _chain(net, connection)
            own = next((place[lane] for lane in reversed(chain) if lane in place), -1)
            signal = connection.getTLSID()
            links.append(
                _Link(
                    origin=number[connection.getFromLane().getID()],
                    exit=number[connection.getToLane().getID()],
                    chain=tuple(number[lane] for lane in chain),
                    edges=(edge.getID(), connection.getTo().getID()),
                    junction=junction_number[node.getID()],
                    duty=duty.get(own, 0),
                    foes=foes.get(own, 0),
                    number=own,
                    direction=_DIRECTIONS.get(connection.getDirection(), STRAIGHT),
                    rule=_rule(connection, duty.get(own, 0)),
                    signal=signals.setdefault(signal, len(signals)) if signal else -1,
                    signal_link=connection.getTLLinkIndex() if signal else -1,
                    classes=_mask(frozenset(connection._allowed)),
                )
            )
    return tuple(signals), links


def _chain(net: Any, connection: Any) -> tuple[str, ...]:
    """Ids of the internal lanes that a connection leads over; two where a left turn may wait inside the junction."""
    chain: list[str] = []
    while connection.getViaLaneID():
        chain.append(connection.getViaLaneID())
        onward = net.getLane(chain[-1]).getOutgoing()
        if len(onward) != 1 or len(chain) > MOST_IN_CHAIN:
            raise ValueError(f"lane {chain[-1]}, inside a junction, does not lead to one lane outside")
        connection = onward[0]
    return tuple(chain)


def _rule(connection: Any, duty: int) -> int:
    """How the connection is entered. Under a signal its letter says little: what counts is whether it has anybody to let pass."""
    if connection.getTLSID():
        return YIELD if duty else PRIORITY
    return _RULES.get(connection.getState(), PRIORITY)


# --- where paths meet ---


def _path(lane: int, link: _Link, width: float, length: float, shape: Floats) -> _Path:
    """An internal lane sampled at most SAMPLING apart; shape [n, 2] m, no two consecutive points equal."""
    arc = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(shape, axis=0), axis=1))))
    at = np.linspace(0.0, arc[-1], min(int(np.ceil(arc[-1] / SAMPLING)), MOST_POINTS) + 1)
    points = np.column_stack((np.interp(at, arc, shape[:, 0]), np.interp(at, arc, shape[:, 1])))
    return _Path(lane, link, lane == link.chain[-1], width, points, at * (length / arc[-1]), points.min(axis=0), points.max(axis=0))


def _conflicts(paths: Sequence[_Path]) -> Iterable[_Conflict]:
    """Both directions of every pair of paths that meet. Paths of different junctions never do: one may be a bridge over the other."""
    junctions: defaultdict[int, list[_Path]] = defaultdict(list)
    for path in paths:
        junctions[path.link.junction].append(path)
    for members in junctions.values():
        for a, b in _near(members):
            yield from _meet(a, b)


def _near(paths: Sequence[_Path]) -> Iterable[tuple[_Path, _Path]]:
    """Pairs of paths from different lanes whose bounding boxes come within REACH."""
    low = np.array([path.low for path in paths]) - REACH
    high = np.array([path.high for path in paths])
    origin = np.array([path.link.origin for path in paths])
    target = np.array([path.link.exit for path in paths])
    close = np.all((low[:, None] <= high[None]) & (low[None] <= high[:, None]), axis=2) | (target[:, None] == target[None])
    for i, k in np.argwhere(np.triu(close & (origin[:, None] != origin[None]))):
        yield paths[i], paths[k]


def _has(bits: int, number: int) -> bool:
    """Whether the bit of a link is set; an unknown link (-1) has none."""
    return number >= 0 and bool(bits >> number & 1)


def _meet(a: _Path, b: _Path) -> Iterable[_Conflict]:
    """The stretches that two paths share, from either side; nothing where they keep clear of each other."""
    merge = a.link.exit == b.link.exit
    if not merge and _abreast(a, b):
        return
    foes = merge or _has(a.link.foes, b.link.number) or _has(b.link.foes, a.link.number)
    reach = min(REACH if foes else TOUCH, SIDE_BY_SIDE * (a.width + b.width) / 2)
    gap = a.points[:, None] - b.points[None]
    close = np.einsum("ijk,ijk->ij", gap, gap) < reach * reach
    if merge and a.last and b.last:
        close[-1, -1] = True  # their ends touch, whatever the shapes say
    for rows in _runs(close.any(axis=1), a.s):
        a_begin, a_end = _extent(rows, a.s)
        b_begin, b_end = _extent(np.flatnonzero(close[rows].any(axis=0)), b.s)
        yield _Conflict(a.lane, b.lane, a_begin, a_end, b_begin, b_end, merge, _has(a.link.duty, b.link.number))
        yield _Conflict(b.lane, a.lane, b_begin, b_end, a_begin, a_end, merge, _has(b.link.duty, a.link.number))


def _abreast(a: _Path, b: _Path) -> bool:
    """Whether two paths lead from one edge to another without changing sides: lanes beside each other, however closely they are drawn."""
    origin, target = a.link.origin - b.link.origin, a.link.exit - b.link.exit
    return a.link.edges == b.link.edges and origin * target > 0


def _runs(close: Bools, s: Floats) -> list[NDArray[np.intp]]:
    """The samples [n] that are close, cut where more than APART lies between two of them; s [n] m."""
    rows = np.flatnonzero(close)
    return [run for run in np.split(rows, np.flatnonzero(np.diff(s[rows]) > APART) + 1) if len(run)]


def _extent(rows: NDArray[np.intp], s: Floats) -> tuple[float, float]:
    """From the first to the last of the samples `rows`, widened by the half step that sampling may have missed; s [n] m."""
    half = float(s[1] - s[0]) / 2
    return max(0.0, float(s[rows[0]]) - half), min(float(s[-1]), float(s[rows[-1]]) + half)
