"""Where the paths of two lanes cross or merge."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats, Indices
from sumo_mcts.world.links import Link, has_bit

# Two paths share the road where their centre lines come closer than this, m:
REACH = 2.2  # where SUMO sees foes
TOUCH = 1.9  # where it sees none: two cars of 1.8 m just pass
# but never more than this share of the distance at which the two lanes lie next to each other.
SIDE_BY_SIDE = 0.75

APART = 5.0  # m: two meetings of the same two paths count as one when less lies between them
SAMPLING = 0.5  # m between the points at which two centre lines are compared,
MOST_POINTS = 2000  # of which an internal lane has at most so many
BATCH = 1 << 17  # pairs of points that are compared at once: what fits into a processor's cache
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


class _Pair(NamedTuple):
    """Two paths through one junction."""

    a: LanePath
    b: LanePath


def lane_path(
    lane: int, link: Link, width: float, length: float, shape: Floats, arc: Floats
) -> LanePath:
    """An internal lane sampled at most SAMPLING apart; shape [n, 2] m, no two consecutive points
    equal, and arc length [n] of each point, m."""
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


def conflicts_between(paths: Iterable[LanePath]) -> Iterable[Conflict]:
    """Both directions of every pair of paths that meet.

    Paths of different junctions never do: one may be a bridge over the other.
    """
    junctions: defaultdict[int, list[LanePath]] = defaultdict(list)
    for path in paths:
        junctions[path.link.junction].append(path)
    pairs = (pair for members in junctions.values() for pair in _near(members))
    for batch in _batches(pairs):
        yield from _met(batch)


def _near(paths: Sequence[LanePath]) -> Iterable[_Pair]:
    """Pairs of paths from different lanes whose bounding boxes come within REACH, or that merge;
    without those that lie beside each other."""
    low = np.array([path.low for path in paths]) - REACH
    high = np.array([path.high for path in paths])
    origin = np.array([path.link.origin for path in paths])
    target = np.array([path.link.exit for path in paths])
    close = np.all((low[:, None] <= high[None]) & (low[None] <= high[:, None]), axis=2) | (
        target[:, None] == target[None]
    )
    for i, k in np.argwhere(np.triu(close & (origin[:, None] != origin[None]))).tolist():
        pair = _Pair(paths[i], paths[k])
        if _merge(pair) or not _abreast(pair):
            yield pair


def _batches(pairs: Iterable[_Pair]) -> Iterable[list[_Pair]]:
    """The pairs in lists, each with about BATCH pairs of samples to compare."""
    batch: list[_Pair] = []
    size = 0
    for pair in pairs:
        batch.append(pair)
        size += len(pair.a.s) * len(pair.b.s)
        if size >= BATCH:
            yield batch
            batch, size = [], 0
    if batch:
        yield batch


def _met(pairs: Sequence[_Pair]) -> Iterable[Conflict]:
    """The stretches that the paths of these pairs share, from either side; none where they keep
    clear of each other."""
    paths, others = zip(*pairs, strict=True)
    a, b = _side(paths, others), _side(others, paths)
    which, *samples = _stretches(a, b, pairs)
    for number, begin, end, other_begin, other_end in zip(
        which.tolist(),
        *_extents(a, which, *samples[:2]),
        *_extents(b, which, *samples[2:]),
        strict=True,
    ):
        pair = pairs[number]
        conflict = Conflict(
            lane=pair.a.lane,
            other=pair.b.lane,
            begin=begin,
            end=end,
            other_begin=other_begin,
            other_end=other_end,
            merge=_merge(pair),
            yields=has_bit(pair.a.link.yields_to, pair.b.link),
        )
        yield conflict
        yield _from_other_side(conflict, has_bit(pair.b.link.yields_to, pair.a.link))


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


# --- what a pair of paths says ---


def _merge(pair: _Pair) -> bool:
    return pair.a.link.exit == pair.b.link.exit


def _abreast(pair: _Pair) -> bool:
    """Whether two paths lead from one edge to another without changing sides: their lanes lie
    beside each other, however closely they are drawn."""
    a, b = pair.a.link, pair.b.link
    return a.edges == b.edges and (a.origin - b.origin) * (a.exit - b.exit) > 0


def _reach(pair: _Pair) -> float:
    """How close two paths come where they share the road, m."""
    a, b = pair.a.link, pair.b.link
    foes = _merge(pair) or has_bit(a.foes, b) or has_bit(b.foes, a)
    return min(REACH if foes else TOUCH, SIDE_BY_SIDE * (pair.a.width + pair.b.width) / 2)


# --- which samples are close, for all pairs of a batch at once ---


class _Side(NamedTuple):
    """One path of each of P pairs: its samples near the other path, one after the other."""

    offset: Indices  # [P+1] path i owns the samples offset[i]:offset[i+1]; its end is among them
    points: Floats  # [n, 2] m
    s: Floats  # [n] m
    half: Floats  # [P] half of the way between two samples, m
    end: Floats  # [P] where the path ends, m


def _side(paths: Sequence[LanePath], others: Sequence[LanePath]) -> _Side:
    """One side of pairs: the samples of `paths` within REACH of the bounding boxes of `others`."""
    count = np.array([len(path.s) for path in paths])
    points = np.concatenate([path.points for path in paths])
    s = np.concatenate([path.s for path in paths])
    of_path = np.repeat(np.arange(len(paths)), count)
    low = np.array([other.low for other in others]) - REACH
    high = np.array([other.high for other in others]) + REACH
    near = np.all((points >= low[of_path]) & (points <= high[of_path]), axis=1)
    near[np.cumsum(count) - 1] = True
    kept = np.bincount(of_path[near])
    return _Side(
        offset=np.concatenate(([0], np.cumsum(kept))),
        points=points[near],
        s=s[near],
        half=np.array([path.s[1] - path.s[0] for path in paths]) / 2,
        end=np.array([path.s[-1] for path in paths]),
    )


def _stretches(a: _Side, b: _Side, pairs: Sequence[_Pair]) -> tuple[Indices, ...]:
    """The stretches that each pair shares, cut where more than APART lies between two close samples
    of a: the pair's index, first and last sample in a, first and last in b."""
    pair = np.repeat(np.arange(len(pairs)), np.diff(a.offset))  # [n] of each sample of a
    sample, low, high = _close(a, b, pair, pairs)
    pair = pair[sample]
    cut = (np.diff(pair) != 0) | (np.diff(a.s[sample]) > APART)
    first = np.flatnonzero(np.concatenate(([True], cut))[: len(sample)])
    last = np.append(first[1:], len(sample)) - 1
    if not len(first):
        return (first,) * 5
    return (
        pair[first],
        sample[first],
        sample[last],
        np.minimum.reduceat(low, first),
        np.maximum.reduceat(high, first),
    )


def _close(a: _Side, b: _Side, pair: Indices, pairs: Sequence[_Pair]) -> tuple[Indices, ...]:
    """The samples of a that are close to one of b, with the first and the last sample of b that are
    close to them; `pair` [n]: the pair of each sample of a."""
    count = np.diff(b.offset)[pair]  # [n] comparisons of each sample of a: with all of b, in order
    end = np.cumsum(count)
    of_b = np.arange(end[-1]) - np.repeat(end - b.offset[pair + 1], count)
    x, y = (np.repeat(a.points[:, i], count) - b.points[of_b, i] for i in (0, 1))
    reach = np.array([_reach(each) for each in pairs])
    close = x * x + y * y < np.repeat((reach * reach)[pair], count)
    # where both end in the same lane their ends touch, whatever the shapes say
    touch = np.array([_merge(each) and each.a.last and each.b.last for each in pairs])
    close[end[a.offset[1:] - 1][touch] - 1] = True
    hit = np.flatnonzero(close)
    of_a = np.searchsorted(end, hit, side="right")
    first = np.flatnonzero(np.diff(of_a, prepend=-1))
    last = np.append(first[1:], len(hit))[: len(first)] - 1
    return of_a[first], of_b[hit[first]], of_b[hit[last]]


def _extents(
    side: _Side, which: Indices, first: Indices, last: Indices
) -> tuple[list[float], list[float]]:
    """Begin and end of stretches from one sample to another, m, widened by the half step that
    sampling may have missed; `which`: their paths."""
    begin = np.maximum(0.0, side.s[first] - side.half[which])
    end = np.minimum(side.end[which], side.s[last] + side.half[which])
    return begin.tolist(), end.tolist()


# --- shapes ---


def distinct(shapes: Sequence[Floats]) -> list[Floats]:
    """Lines [n, 2], each without points that equal the one before."""
    if not shapes:
        return []
    points, count = np.concatenate(shapes), np.array([len(shape) for shape in shapes])
    keep = np.ones(len(points), dtype=np.bool_)
    keep[1:] = np.any(points[1:] != points[:-1], axis=1)
    keep[np.cumsum(count)[:-1]] = True  # where the next line begins
    kept = np.bincount(np.repeat(np.arange(len(shapes)), count)[keep])
    return np.split(points[keep], np.cumsum(kept)[:-1])


def stretched(point: Floats, after: Sequence[Floats]) -> Floats:
    """A very short line from the only point of a lane, in the direction in which the road goes on,
    or east if none is known."""
    along = next((shape[1] - shape[0] for shape in after if len(shape) > 1), np.array([1.0, 0.0]))
    return np.concatenate((point, point + TINY * along / np.linalg.norm(along)))
