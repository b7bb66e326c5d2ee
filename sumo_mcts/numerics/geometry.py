"""Polylines and oriented boxes."""

import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats, Ints
from sumo_mcts.numerics.kernel import kernel
from sumo_mcts.road import RoadMap

# Columns of poses: centre (m), cosine and sine of the heading.
X, Y, COS, SIN = range(4)


class Box(NamedTuple):
    """An oriented box: its centre (m), cosine and sine of its heading, and half its length and
    width (m)."""

    x: float
    y: float
    cos: float
    sin: float
    half_length: float
    half_width: float


@kernel
def point_at(
    points: Floats, arc: Floats, first: int, last: int, distance: float
) -> tuple[float, float]:
    """The point of the polyline points[first:last] [., 2] at an arc length; arc [.] are its
    vertices' arc lengths. Straight on beyond both ends."""
    low, high = first, last - 1
    while high - low > 1:
        middle = (low + high) // 2
        if arc[middle] <= distance:
            low = middle
        else:
            high = middle
    span = arc[low + 1] - arc[low]
    share = (distance - arc[low]) / span if span > 1e-9 else 0.0
    return (
        points[low, 0] + share * (points[low + 1, 0] - points[low, 0]),
        points[low, 1] + share * (points[low + 1, 1] - points[low, 1]),
    )


def nearest(
    begin: Floats, piece: Floats, x: float, y: float, least: Floats | float = 0.0
) -> tuple[Floats, Floats]:
    """Where each straight piece (from begin [P, 2] to begin + piece) is nearest to a point.

    Returns the share of the piece [P], not below `least`, and the distance [P], m.
    """
    to_x, to_y = x - begin[:, 0], y - begin[:, 1]
    square = np.maximum(piece[:, 0] ** 2 + piece[:, 1] ** 2, 1e-18)
    share = np.clip((to_x * piece[:, 0] + to_y * piece[:, 1]) / square, least, 1.0)
    return share, np.hypot(to_x - share * piece[:, 0], to_y - share * piece[:, 1])


class Lines(NamedTuple):
    """The centre lines of all lanes, as in RoadMap."""

    points: Floats
    arc: Floats
    first: Ints
    scale: Floats  # m of the line for each metre of the lane


def lines_of(road: RoadMap) -> Lines:
    """Those of a network."""
    return Lines(road.points, road.point_s, road.point_offset, road.scale)


@kernel
def point_on(lines: Lines, lane: int, s: float) -> tuple[float, float]:
    """The centre line's point at a position on a lane, m; straight on beyond its ends."""
    return point_at(
        lines.points, lines.arc, lines.first[lane], lines.first[lane + 1], s * lines.scale[lane]
    )


@kernel
def boxes_touch(a: Box, b: Box) -> bool:
    """Whether two boxes overlap (separating axes)."""
    dx, dy = b.x - a.x, b.y - a.y
    cosine = abs(a.cos * b.cos + a.sin * b.sin)
    sine = abs(a.cos * b.sin - a.sin * b.cos)
    if abs(dx * a.cos + dy * a.sin) > a.half_length + b.half_length * cosine + b.half_width * sine:
        return False
    if abs(dy * a.cos - dx * a.sin) > a.half_width + b.half_length * sine + b.half_width * cosine:
        return False
    if abs(dx * b.cos + dy * b.sin) > b.half_length + a.half_length * cosine + a.half_width * sine:
        return False
    return (
        abs(dy * b.cos - dx * b.sin) <= b.half_width + a.half_length * sine + a.half_width * cosine
    )


@kernel
def box_distance(a: Box, b: Box) -> float:
    """Distance between two boxes, m; 0 where they overlap: the nearest corner of either to the
    other."""
    return 0.0 if boxes_touch(a, b) else min(_corner_distance(a, b), _corner_distance(b, a))


@kernel
def _corner_distance(a: Box, b: Box) -> float:
    """From box a to the nearest corner of box b."""
    nearest = math.inf
    for corner in range(4):
        u, v = (
            (b.half_length if corner < 2 else -b.half_length),
            (b.half_width if corner % 2 == 0 else -b.half_width),
        )
        x, y = b.x + u * b.cos - v * b.sin - a.x, b.y + u * b.sin + v * b.cos - a.y
        dx = max(abs(x * a.cos + y * a.sin) - a.half_length, 0.0)
        dy = max(abs(y * a.cos - x * a.sin) - a.half_width, 0.0)
        nearest = min(nearest, math.sqrt(dx * dx + dy * dy))
    return nearest


@kernel
def chord(
    front_x: float,
    front_y: float,
    rear_x: float,
    rear_y: float,
    cos_default: float,
    sin_default: float,
) -> tuple[float, float, float, float]:
    """The pose (centre x, y, cos, sin) of a box whose front and rear bumper centres are given."""
    dx, dy = front_x - rear_x, front_y - rear_y
    norm = math.sqrt(dx * dx + dy * dy)
    if norm < 1e-6:
        return front_x, front_y, cos_default, sin_default
    return 0.5 * (front_x + rear_x), 0.5 * (front_y + rear_y), dx / norm, dy / norm


@kernel
def swung(turned: float, forward: float, left: float, length: float) -> float:
    """The angle (rad) between a vehicle and its lane after a step forward and to the left (m): its
    rear follows its front."""
    if left * left + forward * forward > length * length:
        return math.atan2(left, forward)
    return turned + math.asin(
        min(max(math.cos(turned) * (left - math.tan(turned) * forward) / length, -1.0), 1.0)
    )
