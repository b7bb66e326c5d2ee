"""What a kind builds: a network in plain terms, the streams of traffic in it, and the ego."""

from typing import NamedTuple

LEAST_GAP_S = 1.3  # between cars of a regular row


class Node(NamedTuple):
    """A junction, or the end of a road."""

    id: str
    x: float  # m
    y: float
    type: str = "priority"  # as netconvert names types


class Edge(NamedTuple):
    """A road in one direction."""

    id: str
    start: str
    end: str
    lanes: int
    speed: float  # limit, m/s
    priority: int = 1
    shape: tuple[tuple[float, float], ...] = ()  # m; empty: straight
    only: tuple[tuple[int, str], ...] = ()  # lane -> the classes that may use it, and no other
    width: float = 0.0  # of each lane, m; 0: SUMO's


class Link(NamedTuple):
    """A connection from lane to lane across a junction; 0 is the rightmost lane."""

    start: str
    end: str
    from_lane: int
    to_lane: int


class LaneStop(NamedTuple):
    """A stop on a lane, as of a bus."""

    edge: str
    lane: int
    position: float  # of the front, m
    duration: float  # s


class Stream(NamedTuple):
    """Vehicles, or pedestrians, on one route."""

    route: str  # edges, with spaces between
    per_hour: float
    lane: str = "best"  # on which they enter, as SUMO's departLane
    # False: random, at a constant rate; True: gaps within SPREAD of the mean
    regular: bool = False
    vtype: str = ""  # of all of them; "": cars and trucks
    stops: tuple[LaneStop, ...] = ()  # of each of them


class Parked(NamedTuple):
    """A van that stands on a lane from the beginning to the end."""

    edge: str
    lane: int
    position: float  # of its front, m
    aside: float = 0.0  # from the middle of the lane, m to the left; needs `lateral`


class Companion(NamedTuple):
    """A vehicle on the ego's route that departs shortly before or after it."""

    vtype: str
    before: float  # s before the ego; negative: after it
    share: float = 1.0  # its speed where it is free, as a share of the limit


class Situation(NamedTuple):
    """A network with traffic."""

    nodes: tuple[Node, ...]
    edges: tuple[Edge, ...]
    streams: tuple[Stream, ...]
    ego_route: str
    ego_lane: str = "best"
    links: tuple[Link, ...] = ()  # of edges that are not named netconvert makes all
    netconvert: tuple[str, ...] = ()  # further options
    rings: tuple[tuple[str, str], ...] = ()  # nodes and edges of roundabouts
    parked: tuple[Parked, ...] = ()
    companions: tuple[Companion, ...] = ()
    lateral: float = 0.0  # SUMO's lateral resolution, m; 0: lanes are not divided


def row_per_hour(gap: float, speed: float) -> float:
    """Vehicles an hour in a lane in which cars of 5 m drive at `speed` (m/s) with `gap` (m) between
    them, or LEAST_GAP_S where that is more: no lane takes more at this speed."""
    return 3600.0 * speed / (max(gap, LEAST_GAP_S * speed) + 5.0)
