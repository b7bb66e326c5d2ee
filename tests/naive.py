"""Slow and simple versions of compiled kernels, to compare with: plain Python, numpy, shapely."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from shapely.geometry import LineString, Point, Polygon

from sumo_mcts.model.caps import END_GAP, SPACING
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.model.route import RouteMap
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Signals


class Box(NamedTuple):
    """An oriented box: centre, heading, half length, half width."""

    x: float
    y: float
    heading: float
    length: float
    width: float

    def polygon(self, grown: float = 0.0) -> Polygon:
        """The outline of the box, `grown` m larger on every side."""
        c, s, u, v = (
            math.cos(self.heading),
            math.sin(self.heading),
            self.length + grown,
            self.width + grown,
        )
        return Polygon(
            [
                (self.x + a * u * c - b * v * s, self.y + a * u * s + b * v * c)
                for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))
            ]
        )

    def flat(self) -> tuple[float, float, float, float, float, float]:
        """The numbers that kernels take: x, y, cos, sin, half length, half width."""
        return (
            self.x,
            self.y,
            math.cos(self.heading),
            math.sin(self.heading),
            self.length,
            self.width,
        )


def distance(a: Box, b: Box) -> float:
    """The distance between two boxes, m."""
    return float(a.polygon().distance(b.polygon()))


def overlap_area(a: Box, b: Box) -> float:
    """The area that two boxes share, m2."""
    return float(a.polygon().intersection(b.polygon()).area)


def share_in_view(
    x: float, y: float, boxes: Sequence[Box], blocks: Sequence[bool], rays: int
) -> list[float]:
    """For each box: how many of the rays that hit it do so before they hit a box that blocks.

    `rays` leave (x, y) at equal angles. nan where no ray hits the box.
    """
    hits, free = [0] * len(boxes), [0] * len(boxes)
    outlines = [box.polygon() for box in boxes]
    for k in range(rays):
        angle = 2.0 * math.pi * (k + 0.5) / rays
        ray = LineString([(x, y), (x + 1000.0 * math.cos(angle), y + 1000.0 * math.sin(angle))])
        met = {
            i: ray.intersection(outline).distance(Point(x, y))
            for i, outline in enumerate(outlines)
            if ray.intersects(outline)
        }
        for i, away in met.items():
            hits[i] += 1
            free[i] += all(away <= met[j] for j in met if blocks[j])
    return [a / b if b else math.nan for a, b in zip(free, hits, strict=True)]


def point_at(points: Sequence[tuple[float, float]], along: float) -> tuple[float, float]:
    """The point of a polyline at an arc length; beyond the ends the line goes straight on."""
    line = LineString(points)
    if 0.0 <= along <= line.length:
        point = line.interpolate(along)
        return point.x, point.y
    (ax, ay), (bx, by) = (points[0], points[1]) if along < 0.0 else (points[-2], points[-1])
    beyond = (along if along < 0.0 else along - line.length) / math.dist((ax, ay), (bx, by))
    x, y = (ax, ay) if along < 0.0 else (bx, by)
    return x + beyond * (bx - ax), y + beyond * (by - ay)


def cap(route: RouteMap, node: int, s: float, decel: float, goal: Sequence[bool]) -> float:
    """The highest speed at (node, s) from which braking with `decel` is enough, m/s.

    It is enough for every lower limit and for the end of the lane, so the result is the least over
    all places ahead.
    """
    found = [float(route.limit[node])]
    to_end = max(float(route.length[node]) - s, 0.0)  # the last row lies at the end or beyond
    while True:
        following = int(route.next[node])
        if following < 0:
            if not goal[node]:
                found.append(math.sqrt(2.0 * decel * max(to_end - END_GAP, 0.0)))
            return min(found)
        found.append(math.sqrt(float(route.limit[following]) ** 2 + 2.0 * decel * to_end))
        node = following
        to_end += float(route.length[node])


def rows_of(route: RouteMap, node: int) -> list[tuple[int, float]]:
    """(table row, position on the node, m) of each table row of a node."""
    return [
        (int(route.row[node]) + k, k * SPACING)
        for k in range(int(route.row[node + 1] - route.row[node]))
    ]


def chain_of(route: RouteMap, node: int) -> list[int]:
    """The nodes that are driven from `node` on, itself first."""
    chain = [node]
    while route.next[chain[-1]] >= 0:
        chain.append(int(route.next[chain[-1]]))
    return chain


def desired_gap(
    v: float, leader_v: float, gap: float, headway: float, accel: float, decel: float
) -> float:
    """s* of the intelligent driver model (Treiber, Hennecke, Helbing 2000), m.

    Never below the gap at standstill.
    """
    return max(gap, gap + headway * v + v * (v - leader_v) / (2.0 * math.sqrt(accel * decel)))


def follow(p: EgoParams, v: float, limit: float, gap: float, leader_v: float) -> float:
    """The ego's car following, m/s2."""
    interaction = (
        0.0
        if gap == math.inf
        else desired_gap(v, leader_v, p.gap, p.headway, p.max_accel, p.approach_decel) / gap
    )
    return p.max_accel * (1.0 - (v / limit) ** 4 - interaction**2)


def free_drive(
    s: float, v: float, limit: float, accel: float, step: float, times: int
) -> list[tuple[float, float]]:
    """(position, speed) of a car on an empty road, which accelerates with `accel` up to the limit.

    Positions are integrated by trapezoids.
    """
    states = [(s, v)]
    for _ in range(times - 1):
        faster = min(v + step * accel, limit)
        s, v = s + step * (v + faster) / 2.0, faster
        states.append((s, v))
    return states


def light_at(signals: Signals, signal: int, link: int, time: float) -> int:
    """What a link shows `time` s from now: the state of the first phase that ends later.

    The last phase has no end.
    """
    phases = len(signals.until[signal])
    for k in range(phases):
        if time < signals.until[signal][k]:
            return int(signals.state[int(signals.offset[signal]) + link][k])
    return int(signals.state[int(signals.offset[signal]) + link][phases - 1])


def stopping_distance(p: EgoParams, v: float, a: float) -> float:
    """The distance until the ego stands, with the strongest braking in its bounds, m."""
    driven = 0.0
    while v > 0.0:
        jerk = p.emergency_jerk  # braking beyond comfort is asked for at once
        a = max(-p.max_decel, a - jerk * p.step)
        faster, v = v, max(0.0, v + a * p.step)
        driven += (0.5 * (faster + v) if p.ballistic else v) * p.step
    return driven


def arc_lengths(points: Sequence[tuple[float, float]]) -> list[float]:
    """The arc length at each vertex of a polyline, m."""
    arcs = [0.0]
    for a, b in pairwise(points):
        arcs.append(arcs[-1] + math.dist(a, b))
    return arcs


def successors_of(road: RoadMap, lane: int) -> list[int]:
    """The lanes that may be driven after a lane."""
    return [
        int(i)
        for i in road.successor[road.successor_offset[lane] : road.successor_offset[lane + 1]]
    ]
