"""The roads under the vehicles."""

from collections import defaultdict
from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from sumo_mcts.arrays import Floats
from sumo_mcts.records import Lanes
from sumo_mcts.reporting.canvas import (
    ASPHALT,
    KERB,
    LAND,
    PAINT,
    ROUTE,
    View,
    draw_line,
    draw_polygon,
)

TILES = 8  # pieces of the ground that are kept while the camera moves


class Strokes(NamedTuple):
    """Lines or areas of one kind. K of them."""

    shapes: list[Floats]  # [K] each [P, 2] m
    width: Floats  # [K] m
    low: Floats  # [K, 2] corner of the box around each, m
    high: Floats  # [K, 2]


class Roads(NamedTuple):
    """What is drawn of the roads, in any window."""

    lanes: Strokes
    route: Strokes  # lanes on the ego's route
    junctions: Strokes  # areas
    paint: Strokes  # lines between lanes, beside them, and where to stop


def roads_of(lanes: Lanes) -> Roads:
    """The roads of a trace, ready to be drawn."""
    shapes = [lanes.points[begin:end] for begin, end in pairwise(lanes.offset.tolist())]
    drawn = [i for i, shape in enumerate(shapes) if len(shape)]
    on_route = [i for i in drawn if lanes.route[i]]
    hulls, borders = _junctions(lanes, shapes), _borders(lanes, shapes)
    return Roads(
        _strokes([shapes[i] for i in drawn], lanes.width[drawn]),
        _strokes([shapes[i] for i in on_route], lanes.width[on_route]),
        _strokes(hulls, np.zeros(len(hulls))),
        _strokes(
            [*borders, *lanes.stop_lines.reshape(-1, 2, 2)],
            np.repeat([0.16, 0.45], [len(borders), len(lanes.stop_lines)]),
        ),
    )


def draw_ground(roads: Roads, view: View) -> Image.Image:
    """Land, asphalt, lane borders and stop lines."""
    image = Image.new("RGB", view.size, LAND)
    draw = ImageDraw.Draw(image)
    for extra, colour in ((0.7, KERB), (0.1, ASPHALT)):  # 0.1: no seams between lanes
        for outline, _ in _seen(roads.junctions, view):
            draw_polygon(draw, outline, colour, outline=extra * view.scale)
        for line, width in _seen(roads.lanes, view):
            draw_line(draw, line, width + extra, colour, view)
    for strokes, colour in ((roads.route, ROUTE), (roads.paint, PAINT)):
        for line, width in _seen(strokes, view):
            draw_line(draw, line, width, colour, view)
    return image


class Ground:
    """The roads under a camera that moves by whole pixels.

    They are drawn once, in tiles of the window's size, as far as they are seen.
    """

    def __init__(self, roads: Roads, view: View) -> None:
        self._roads, self._origin = roads, view
        self._tiles: dict[tuple[int, int], Image.Image] = {}

    def under(self, view: View) -> Image.Image:
        """The image of a view of the same scale and size."""
        wide, tall = view.size
        x, y = (
            round((view.west - self._origin.west) * view.scale),
            round((self._origin.north - view.north) * view.scale),
        )
        image = Image.new("RGB", view.size)
        for column in range(x // wide, -(-(x + wide) // wide)):
            for row in range(y // tall, -(-(y + tall) // tall)):
                image.paste(self._tile(column, row), (column * wide - x, row * tall - y))
        return image

    def _tile(self, column: int, row: int) -> Image.Image:
        here = column, row
        if here not in self._tiles:
            west, north, scale, size = self._origin
            self._tiles[here] = draw_ground(
                self._roads,
                View(west + column * size[0] / scale, north - row * size[1] / scale, scale, size),
            )
        self._tiles[here] = self._tiles.pop(here)  # the one used last stands last
        if len(self._tiles) > TILES:
            del self._tiles[next(iter(self._tiles))]
        return self._tiles[here]


# --- the shapes of roads ---


def _strokes(shapes: list[Floats], width: Floats) -> Strokes:
    boxes = np.array([(shape.min(axis=0), shape.max(axis=0)) for shape in shapes]).reshape(-1, 2, 2)
    return Strokes(shapes, width, boxes[:, 0], boxes[:, 1])


def _junctions(lanes: Lanes, shapes: list[Floats]) -> list[Floats]:
    """The area of each junction: the hull of the lanes inside it."""
    inside: dict[str, list[Floats]] = defaultdict(list)
    for i, shape in enumerate(shapes):
        if lanes.internal[i] and len(shape):
            half = lanes.width[i] / 2
            inside[lanes.lane_ids[i].rsplit("_", 2)[0]] += [
                beside(shape, half),
                beside(shape, -half),
            ]
    return [hull(np.concatenate(sides)) for sides in inside.values()]


def _borders(lanes: Lanes, shapes: list[Floats]) -> list[Floats]:
    """Broken lines between the lanes of an edge, a solid one to the left of it."""
    places = [lane_id.rpartition("_") for lane_id in lanes.lane_ids]
    top: dict[str, int] = defaultdict(int)
    for edge, _, index in places:
        top[edge] = max(top[edge], int(index) if index.isdecimal() else 0)
    found: list[Floats] = []
    for i, (edge, _, index) in enumerate(places):
        if lanes.internal[i] or not index.isdecimal() or not len(shapes[i]):
            continue
        if int(index) > 0:
            found += list(dashes(beside(shapes[i], -lanes.width[i] / 2), 3.0, 4.5))
        if int(index) == top[edge]:
            found.append(beside(shapes[i], lanes.width[i] / 2))
    return found


def beside(shape: Floats, distance: float) -> Floats:
    """[P, 2] the shape moved to the left by a distance, m."""
    along = np.gradient(shape, axis=0) if len(shape) > 1 else np.zeros_like(shape)
    unit = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    return np.asarray(shape + distance * np.column_stack([-unit[:, 1], unit[:, 0]]))


def dashes(shape: Floats, dash: float, gap: float) -> Floats:
    """[K, 2, 2] pieces of a broken line along a shape, m."""
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(shape, axis=0), axis=1))])
    starts = np.arange(gap / 2, s[-1] - dash, dash + gap)
    ends = np.column_stack([starts, starts + dash])
    return np.stack([np.interp(ends, s, shape[:, 0]), np.interp(ends, s, shape[:, 1])], axis=-1)


def hull(points: Floats) -> Floats:
    """[K, 2] convex hull, counter-clockwise (upper and lower chain over the sorted points)."""
    ordered = sorted(set(map(tuple, points.round(3).tolist())))

    def chain(places: list[Any]) -> list[Any]:
        kept: list[Any] = []
        for p in places:
            while len(kept) > 1 and (kept[-1][0] - kept[-2][0]) * (p[1] - kept[-2][1]) <= (
                kept[-1][1] - kept[-2][1]
            ) * (p[0] - kept[-2][0]):
                kept.pop()
            kept.append(p)
        return kept[:-1]

    return np.array(chain(ordered) + chain(ordered[::-1])).reshape(-1, 2)


# --- what is in the window ---


def _seen(strokes: Strokes, view: View) -> Iterator[tuple[Floats, float]]:
    """The strokes that reach into the window, or nearly: [P, 2] pixels, and the width in m.

    Pixels are whole numbers, so that neighbouring tiles agree.
    """
    margin = 5.0  # m
    west, south, east, north = (
        view.west,
        view.north - view.size[1] / view.scale,
        view.west + view.size[0] / view.scale,
        view.north,
    )
    inside = (strokes.high > (west - margin, south - margin)) & (
        strokes.low < (east + margin, north + margin)
    )
    for i in np.flatnonzero(inside.all(axis=1)).tolist():
        yield np.floor(view.pixels(strokes.shapes[i]) + 1e-6), float(strokes.width[i])
