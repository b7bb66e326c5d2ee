"""Where the paths of two lanes cross or merge."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.arrays import Bools, Floats
from sumo_mcts.world.links import Link

# Two paths share the road where their centre lines come closer than this, m:
REACH = 2.2  # where SUMO sees foes
TOUCH = 1.9  # where it sees none: two cars of 1.8 m just pass
# but never more than this share of the distance at which the two lanes lie next to each other.
SIDE_BY_SIDE = 0.75

APART = 5.0  # m: two meetings of the same two paths count as one when less lies between them
SAMPLING = 0.5  # m between the points at which two centre lines are compared,
MOST_POINTS = 2000  # of which an internal lane has at most so many
TINY = 0.01  # m: the length given to a lane whose shape has none, so that it has a heading


class LanePath(NamedTuple):
    """One internal lane, sampled. n points."""

    lane: int
    link: Link
    last: bool  # the next lane is an ordinary one
    width: float  # m
    points: Floats  # [n, 2] m
    s: Floats  # [n] SUMO lane positions, m
    low: Floats  # [2] corner of the bounding box, m
    high: Floats  # [2] m


class Conflict(NamedTuple):
    """Where lane `lane` meets lane `other`: the fields conflict_... of RoadMap."""

    lane: int
    other: int
    begin: float  # m, in positions of `lane`
    end: float
    other_begin: float  # m, in positions of `other`
    other_end: float
    merge: bool
    yields: bool


def lane_path(lane: int, link: Link, width: float, length: float, shape: Floats) -> LanePath:
    """An internal lane sampled at most SAMPLING apart; shape [n, 2] m, no two consecutive points
    equal."""
    arc = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(shape, axis=0), axis=1))))
    at = np.linspace(0.0, arc[-1], min(int(np.ceil(arc[-1] / SAMPLING)), MOST_POINTS) + 1)
    points = np.column_stack((np.interp(at, arc, shape[:, 0]), np.interp(at, arc, shape[:, 1])))
    return LanePath(
        lane=lane,
        link=link,
        last=lane == link.chain[-1],
        width=width,
        points=points,
        s=at * (length / arc[-1]),
        low=points.min(axis=0),
        high=points.max(axis=0),
    )


def conflicts_between(paths: Sequence[LanePath]) -> Iterable[Conflict]:
    """Both directions of every pair of paths that meet.

    Paths of different junctions never do: one may be a bridge over the other.
    """
    junctions: defaultdict[int, list[LanePath]] = defaultdict(list)
    for path in paths:
        junctions[path.link.junction].append(path)
    for members in junctions.values():
        for a, b in _near(members):
            yield from _meet(a, b)


def _near(paths: Sequence[LanePath]) -> Iterable[tuple[LanePath, LanePath]]:
    """Pairs of paths from different lanes whose bounding boxes come within REACH."""
    low = np.array([path.low for path in paths]) - REACH
    high = np.array([path.high for path in paths])
    origin = np.array([path.link.origin for path in paths])
    target = np.array([path.link.exit for path in paths])
    close = np.all((low[:, None] <= high[None]) & (low[None] <= high[:, None]), axis=2) | (
        target[:, None] == target[None]
    )
    for i, k in np.argwhere(np.triu(close & (origin[:, None] != origin[None]))):
        yield paths[i], paths[k]


def _has(bits: int, number: int) -> bool:
    """Whether the bit of a link is set; an unknown link (-1) has none."""
    return number >= 0 and bool(bits >> number & 1)


def _meet(a: LanePath, b: LanePath) -> Iterable[Conflict]:
    """The stretches that two paths share, from either side; none where they keep clear of each
    other."""
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
        conflict = Conflict(
            lane=a.lane,
            other=b.lane,
            begin=a_begin,
            end=a_end,
            other_begin=b_begin,
            other_end=b_end,
            merge=merge,
            yields=_has(a.link.yields_to, b.link.number),
        )
        yield conflict
        yield _from_other_side(conflict, _has(b.link.yields_to, a.link.number))


def _from_other_side(conflict: Conflict, yields: bool) -> Conflict:
    """The same conflict for traffic on the other lane."""
    return Conflict(
        lane=conflict.other,
        other=conflict.lane,
        begin=conflict.other_begin,
        end=conflict.other_end,
        other_begin=conflict.begin,
        other_end=conflict.end,
        merge=conflict.merge,
        yields=yields,
    )


def _abreast(a: LanePath, b: LanePath) -> bool:
    """Whether two paths lead from one edge to another without changing sides: their lanes lie
    beside each other, however closely they are drawn."""
    origin, target = a.link.origin - b.link.origin, a.link.exit - b.link.exit
    return a.link.edges == b.link.edges and origin * target > 0


def _runs(close: Bools, s: Floats) -> list[NDArray[np.intp]]:
    """The samples [n] that are close, cut where more than APART lies between two of them; s [n]
    m."""
    rows = np.flatnonzero(close)
    return [run for run in np.split(rows, np.flatnonzero(np.diff(s[rows]) > APART) + 1) if len(run)]


def _extent(rows: NDArray[np.intp], s: Floats) -> tuple[float, float]:
    """From the first to the last of the samples `rows`, widened by the half step that sampling may
    have missed; s [n] m."""
    half = float(s[1] - s[0]) / 2
    return max(0.0, float(s[rows[0]]) - half), min(float(s[-1]), float(s[rows[-1]]) + half)


# --- shapes ---


def distinct(shape: Floats) -> Floats:
    """A line [n, 2] without points that equal the one before."""
    keep = np.ones(len(shape), dtype=np.bool_)
    keep[1:] = np.any(shape[1:] != shape[:-1], axis=1)
    return shape[keep]


def stretched(point: Floats, after: Sequence[Floats]) -> Floats:
    """A very short line from the only point of a lane, in the direction in which the road goes on,
    or east if none is known."""
    along = next((shape[1] - shape[0] for shape in after if len(shape) > 1), np.array([1.0, 0.0]))
    return np.concatenate((point, point + TINY * along / np.linalg.norm(along)))
