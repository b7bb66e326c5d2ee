"""From a SUMO network file to road.RoadMap: lanes, connections, right of way, and where the paths
through a junction meet."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sumo_mcts import files
from sumo_mcts.arrays import Floats, Ints
from sumo_mcts.errors import ConfigError, near
from sumo_mcts.road import LEAST_SPEED, PRIORITY, STRAIGHT, VEHICLE_CLASSES, RoadMap
from sumo_mcts.world.conflicts import (
    TINY,
    Conflict,
    LanePath,
    conflicts_between,
    distinct,
    lane_path,
    stretched,
)
from sumo_mcts.world.jumps import with_jumps
from sumo_mcts.world.kept_roads import kept_roadmap
from sumo_mcts.world.links import (
    Entry,
    Link,
    crossing_entries,
    following_lane,
    junction_clusters,
    mask_of,
    read_links,
)
from sumo_mcts.world.net_file import (
    BROKEN,
    MOST_SPEED,
    NetFile,
    read_net,
    require_within,
)
from sumo_mcts.world.oncoming import with_oncoming

NAMED = 6  # edges that a message names
MOST_KEPT = 16  # networks in one process: a batch may make one for each episode

# Beyond these a number is taken for damage.
MOST_LENGTH = 1e6  # m, of a lane
MOST_WIDTH = 100.0  # m
FARTHEST = 1e8  # m, of a coordinate from the origin


def read_roadmap(net_file: str) -> RoadMap:
    """The network in `net_file` (.net.xml or .net.xml.gz) as arrays, lanes in the order of the
    file.

    Raises ConfigError where it cannot be read.
    """
    why = files.problem(net_file)
    if why:
        raise ConfigError(f"{net_file}: {why.replace('such file', 'such network file')}")
    try:
        road = _convert(read_net(net_file))
    except BROKEN as error:
        # sumolib raises many kinds of errors on a file that it does not expect
        missing = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        reason = error.strerror if isinstance(error, OSError) else missing or type(error).__name__
        raise ConfigError(f"{net_file}: not a readable SUMO network ({reason})") from error
    if not road.lane_ids:
        raise ConfigError(f"{net_file}: not a SUMO network with lanes")
    return road


def known_roadmap(net_file: str) -> RoadMap:
    """The same, read once in a process as long as the file does not change; the last MOST_KEPT.

    Large networks are kept on disk, too.
    """
    path = files.absolute(Path(net_file))
    return _kept(net_file, 0 if files.problem(path) else path.stat().st_mtime_ns)


@lru_cache(maxsize=MOST_KEPT)
def _kept(net_file: str, changed: int) -> RoadMap:
    return kept_roadmap(Path(net_file), lambda: read_roadmap(net_file))


def has_edge(road: RoadMap, edge: str, where: str) -> None:
    """Raise ConfigError, with `where` in front, where the network has no such edge."""
    ordinary = [name for name in road.edge_ids if not name.startswith(":")]
    if edge not in ordinary:
        like = near(edge, ordinary, NAMED) or ordinary[:NAMED]
        raise ConfigError(
            f"{where}: the network has no edge {edge}; among its {len(ordinary)} edges: "
            f"{', '.join(like)}"
        )


def lane_index(road: RoadMap) -> dict[str, int]:
    """Lane id -> index."""
    return {name: i for i, name in enumerate(road.lane_ids)}


def lane_shape(road: RoadMap, lane: int) -> Floats:
    """Centre line of a lane: [n, 2], m, n >= 2."""
    return road.points[road.point_offset[lane] : road.point_offset[lane + 1]]


def sumo_lane(road: RoadMap, lane: int) -> int:
    """The number that SUMO gives a lane of its edge: counted from the left where traffic drives on
    the left."""
    return int(road.lane_ids[lane].rsplit("_", 1)[1])


# --- from sumolib's objects to arrays ---


def _convert(file: NetFile) -> RoadMap:
    """A network file as arrays. Raises ValueError, KeyError."""
    net = file.net
    edges = list(net.getEdges())
    for edge in edges:
        _require_sound(edge)
    _require_reached(edges)
    lanes = [lane for edge in edges for lane in edge.getLanes()]
    ids = [f"{edge.getID()}_{i}" for edge in edges for i in range(len(edge.getLanes()))]
    number = {name: i for i, name in enumerate(ids)}
    junctions = {node.getID(): i for i, node in enumerate(net.getNodes())}
    following = [following_lane(lane, number) for lane in lanes]
    offset, points, point_s = _flatten(_shapes(lanes, following))
    fields = _lane_fields(edges, lanes, junctions, file.lefthand)
    signal_ids, links = read_links(net, number, junctions)
    crossings = crossing_entries(edges, number, signal_ids)
    paths = [
        lane_path(
            lane,
            link,
            fields["width"][lane],
            fields["length"][lane],
            points[offset[lane] : offset[lane + 1]],
            point_s[offset[lane] : offset[lane + 1]],
        )
        for link in links
        for lane in link.chain
    ]
    road = RoadMap(
        lane_ids=tuple(ids),
        edge_ids=tuple(edge.getID() for edge in edges),
        junction_ids=tuple(junctions),
        signal_ids=signal_ids,
        point_offset=offset,
        points=points,
        point_s=point_s,
        scale=point_s[offset[1:] - 1] / np.maximum(fields["length"], 1e-9),
        successor_offset=_offsets([len(lanes_after) for lanes_after in following]),
        successor=np.array(
            [lane for lanes_after in following for lane in lanes_after], dtype=np.int32
        ),
        **{
            **fields,
            **_class_fields(file, edges, ids, fields["speed"]),
            **_link_fields(fields["classes"], links, crossings),
            **_conflict_fields(paths, len(lanes)),
        },
    )
    beside = {
        number[name]: number[lane.getNeigh()]
        for name, lane in zip(ids, lanes, strict=True)
        if lane.getNeigh() in number
    }
    return with_oncoming(with_jumps(road, links), beside)


def _shapes(lanes: Sequence[Any], following: Sequence[Sequence[int]]) -> list[Floats]:
    """Centre line of each lane, [n >= 2, 2] m, no two consecutive points equal."""
    shapes = distinct([np.array(lane.getShape(), np.float64).reshape(-1, 2) for lane in lanes])
    return [
        shape if len(shape) > 1 else stretched(shape, [shapes[i] for i in after])
        for shape, after in zip(shapes, following, strict=True)
    ]


def _flatten(shapes: Sequence[Floats]) -> tuple[Ints, Floats, Floats]:
    """Offsets [L+1], points [P, 2] and arc length of each point along its lane [P], m."""
    offset = _offsets([len(shape) for shape in shapes])
    points = np.concatenate([np.zeros((0, 2)), *shapes])
    steps, arc = np.linalg.norm(np.diff(points, axis=0), axis=1), np.zeros(len(points))
    for begin, end in pairwise(offset.tolist()):
        np.cumsum(steps[begin : end - 1], out=arc[begin + 1 : end])
    return offset, points, arc


def _lane_fields(
    edges: Sequence[Any],
    lanes: Sequence[Any],
    junctions: dict[str, int],
    lefthand: bool,
) -> dict[str, Any]:
    """The fields of a RoadMap that concern each lane alone."""
    edge = np.repeat(
        np.arange(len(edges), dtype=np.int32), [len(each.getLanes()) for each in edges]
    )
    internal = np.array([lane.getEdge().isSpecial() for lane in lanes], dtype=np.bool_)
    begins = np.array(
        [junctions[lane.getEdge().getFromNode().getID()] for lane in lanes], dtype=np.int32
    )
    ends = np.array(
        [junctions[lane.getEdge().getToNode().getID()] for lane in lanes], dtype=np.int32
    )
    length = np.array([lane.getLength() for lane in lanes], dtype=np.float64)
    speed = np.array([lane.getSpeed() for lane in lanes], dtype=np.float64)
    classes = np.array(
        [mask_of(frozenset(lane.getPermissions())) for lane in lanes], dtype=np.uint64
    )
    closed = speed < LEAST_SPEED
    classes[closed] = 0
    return {
        "lefthand": lefthand,
        "edge": edge,
        "index": np.array(
            [i for each in edges for i in range(len(each.getLanes()))[:: -1 if lefthand else 1]],
            dtype=np.int32,
        ),
        "internal": internal,
        "length": length,
        "width": np.array([lane.getWidth() for lane in lanes], dtype=np.float64),
        "speed": np.where(closed, LEAST_SPEED, speed),
        "classes": classes,
        "left": _neighbours(edge, -1 if lefthand else 1),
        "right": _neighbours(edge, 1 if lefthand else -1),
        "junction": np.where(internal, begins, -1).astype(np.int32),
        **junction_clusters(internal, length, begins, ends),
    }


def _class_fields(
    file: NetFile, edges: Sequence[Any], ids: Sequence[str], speed: Floats
) -> dict[str, Any]:
    """The fields of a RoadMap that tell what single vehicle classes may do; `ids` and `speed` [L]
    of the lanes."""
    changes = [file.changes.get(name, ("all", "all")) for name in ids]
    left, right = (
        np.array([mask_of(frozenset(classes.split())) for classes in side], dtype=np.uint64)
        for side in zip(*changes, strict=True)
    )
    own = {edge.getID(): file.restrictions.get(edge.getType(), {}) for edge in edges}
    named = sorted({name for limits in own.values() for name in limits} & set(VEHICLE_CLASSES))
    row = np.full(len(VEHICLE_CLASSES), -1, dtype=np.int32)
    row[[VEHICLE_CLASSES.index(name) for name in named]] = np.arange(len(named))
    of_lane = [own[name.rpartition("_")[0]] for name in ids]
    return {
        "change_left": left,
        "change_right": right,
        "class_row": row,
        "class_speed": np.array(
            [
                [
                    max(limits.get(name, usual), LEAST_SPEED)
                    for limits, usual in zip(of_lane, speed, strict=True)
                ]
                for name in named
            ]
        ).reshape(len(named), len(ids)),
    }


def _neighbours(edge: Ints, step: int) -> Ints:
    """[L] the lane `step` places further on the same edge, or -1; the lanes of an edge are
    neighbours in the file."""
    there = np.arange(len(edge), dtype=np.int32) + step
    inside = (there >= 0) & (there < len(edge))
    there[~inside] = 0
    return np.where(inside & (edge[there] == edge), there, -1).astype(np.int32)


def _link_fields(
    classes: NDArray[np.uint64], links: Sequence[Link], crossings: Mapping[int, Entry]
) -> dict[str, Any]:
    """The fields that lanes inside junctions have from the connection that they belong to.

    `classes` [L]: the vehicle classes that each lane allows, as its own attributes say;
    `crossings`: lane -> how people enter it.
    """
    count, classes = len(classes), classes.copy()
    exit_lane = np.arange(count, dtype=np.int32)
    direction, rule = np.full((2, count), [[STRAIGHT], [PRIORITY]], dtype=np.int32)
    signal, signal_link = np.full((2, count), -1, dtype=np.int32)
    for lane, entry in crossings.items():
        rule[lane], signal[lane], signal_link[lane] = entry
    for link in links:
        chain, first = list(link.chain), list(link.chain[:1])
        exit_lane[chain] = link.exit
        direction[chain] = link.direction
        classes[chain] &= np.uint64(link.classes)
        rule[first] = link.rule
        signal[first] = link.signal
        signal_link[first] = link.signal_link
    return {
        "exit": exit_lane,
        "direction": direction,
        "classes": classes,
        "rule": rule,
        "signal": signal,
        "link": signal_link,
    }


def _conflict_fields(paths: Sequence[LanePath], lanes: int) -> dict[str, Any]:
    """The fields conflict_...: where the paths through a junction meet."""
    conflicts = sorted(conflicts_between(paths))
    columns: Any = zip(*conflicts, strict=True) if conflicts else ([],) * len(Conflict._fields)
    field = Conflict(*columns)
    return {
        "conflict_offset": _offsets(
            np.bincount(np.array(field.lane, dtype=np.int64), minlength=lanes).tolist()
        ),
        "conflict_lane": np.array(field.other, dtype=np.int32),
        "conflict_begin": np.array(field.begin, dtype=np.float64),
        "conflict_end": np.array(field.end, dtype=np.float64),
        "conflict_other_begin": np.array(field.other_begin, dtype=np.float64),
        "conflict_other_end": np.array(field.other_end, dtype=np.float64),
        "conflict_merge": np.array(field.merge, dtype=np.bool_),
        "conflict_yields": np.array(field.yields, dtype=np.bool_),
    }


def _offsets(counts: Sequence[int]) -> Ints:
    """[n] counts -> [n+1] where each part begins, and where the last ends."""
    return np.concatenate(([0], np.cumsum(counts))).astype(np.int32)


# --- what is refused ---


def _require_sound(edge: Any) -> None:
    """Raise ValueError, which names the lane, where an edge holds what is no road."""
    if None in (edge.getFromNode(), edge.getToNode()):
        raise ValueError(f"edge {edge.getID()}: from and to: have to be junctions")
    if not edge.getLanes():
        raise ValueError(f"edge {edge.getID()} has no lanes")
    for number, lane in enumerate(edge.getLanes()):
        name = f"lane {edge.getID()}_{number}"
        require_within(f"{name}: speed", lane.getSpeed(), -MOST_SPEED, MOST_SPEED)
        require_within(f"{name}: length", lane.getLength(), TINY, MOST_LENGTH)
        require_within(f"{name}: width", lane.getWidth(), TINY, MOST_WIDTH)
        if not lane.getShape():
            raise ValueError(f"{name}: shape: not given")
        for coordinate in (each for point in lane.getShape() for each in point):
            require_within(f"{name}: shape", coordinate, -FARTHEST, FARTHEST)


def _require_reached(edges: Sequence[Any]) -> None:
    """Raise ValueError where a lane inside a junction belongs to no connection: SUMO does not
    survive that."""
    reached = {
        connection.getViaLaneID()
        for edge in edges
        for lane in edge.getLanes()
        for connection in lane.getOutgoing()
    }
    inside = (edge for edge in edges if edge.getFunction() == "internal")
    lost = next(
        (
            name
            for edge in inside
            for name in (f"{edge.getID()}_{i}" for i in range(len(edge.getLanes())))
            if name not in reached
        ),
        None,
    )
    if lost is not None:
        raise ValueError(f"lane {lost}, inside a junction, belongs to no connection")
