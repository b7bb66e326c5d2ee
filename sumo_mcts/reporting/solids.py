"""Vehicles and people as solids: faces with a colour, in metres around their middle.

x ahead, y left, z up. The faces of a part are those of a convex body; parts are given from below.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats
from sumo_mcts.reporting.canvas import BLINK, BRAKE, PAINT, Colour, mixed

LIGHT = np.array([-0.35, 0.45, 0.82])  # where it comes from, in the vehicle's own directions
DARKEST = 0.62
LONG, NARROW = 7.0, 1.1  # m: longer is a lorry or bus, narrower has two wheels
LAMP_OFF: Colour = (120, 30, 34)
BLACK: Colour = (18, 20, 24)


class Face(NamedTuple):
    """A convex area of a solid."""

    corners: Floats  # [K, 3] m, counter-clockwise as seen from outside
    colour: Colour


def vehicle(
    size: tuple[float, float], colours: tuple[Colour, Colour], lights: tuple[bool, int]
) -> list[Face]:
    """A vehicle of this length and width, m; `colours` of body and glass; `lights`: braking,
    blinker."""
    length, width = size
    if width < NARROW:
        return _two_wheels(length, width, colours)
    parts = _lorry(length, width, colours) if length > LONG else _car(length, width, colours)
    return [*parts, *_lamps(length, width, lights)]


def person(size: float, colours: tuple[Colour, Colour]) -> list[Face]:
    """Somebody on foot, as wide as `size`, m."""
    turn = np.linspace(0, 2 * np.pi, 9)[:-1]
    ring = max(size, 0.45) / 2 * np.column_stack([np.cos(turn), np.sin(turn)])
    return [
        *_tapered(ring, 0.0, 0.8 * ring, 1.35, colours[1], colours[1]),
        *_tapered(0.45 * ring, 1.4, 0.4 * ring, 1.75, colours[0], colours[0]),
    ]


def _car(length: float, width: float, colours: tuple[Colour, Colour]) -> list[Face]:
    half, side = length / 2, width / 2
    lower = _outline(-half, half, side, min(0.4, 0.1 * length))
    glass = _outline(-0.40 * length, 0.22 * length, 0.92 * side, 0.1)
    roof = _outline(-0.30 * length, 0.05 * length, 0.76 * side, 0.1)
    return [
        *_tapered(0.98 * lower, 0.12, lower, 0.35, BLACK, BLACK),
        *_tapered(lower, 0.35, 0.97 * lower, 0.86, *_body(colours[0])),
        *_tapered(glass, 0.86, roof, 1.42, colours[1], _body(colours[0])[1]),
    ]


def _lorry(length: float, width: float, colours: tuple[Colour, Colour]) -> list[Face]:
    outline = _outline(-length / 2, length / 2, width / 2, 0.15)
    return [
        *_tapered(0.98 * outline, 0.15, outline, 0.55, BLACK, BLACK),
        *_tapered(outline, 0.55, outline, 1.4, *_body(colours[0])),
        *_tapered(outline, 1.4, outline, 2.3, colours[1], colours[1]),
        *_tapered(outline, 2.3, outline, 3.0, *_body(colours[0])),
    ]


def _two_wheels(length: float, width: float, colours: tuple[Colour, Colour]) -> list[Face]:
    frame = _outline(-length / 2, length / 2, 0.15, 0.1)
    rider = _outline(-0.25, 0.15, max(0.22, 0.4 * width), 0.1)
    return [
        *_tapered(frame, 0.05, 0.9 * frame, 0.85, BLACK, BLACK),
        *_tapered(rider, 0.85, 0.85 * rider, 1.45, *_body(colours[0])),
        *_tapered(0.5 * rider, 1.5, 0.45 * rider, 1.75, colours[1], colours[1]),
    ]


def _body(colour: Colour) -> tuple[Colour, Colour]:
    """Of the sides, and of what lies on top, which is lighter."""
    return colour, mixed(PAINT, colour, 0.14)


def _outline(back: float, front: float, side: float, corner: float) -> Floats:
    """[8, 2] a rectangle without its corners, counter-clockwise, m."""
    return np.array([
        (back, -side + corner), (back + corner, -side), (front - corner, -side),
        (front, -side + corner), (front, side - corner), (front - corner, side),
        (back + corner, side), (back, side - corner),
    ])  # fmt: skip


def _tapered(
    below: Floats, low: float, above: Floats, high: float, sides: Colour, top: Colour
) -> list[Face]:
    """A body between two outlines [K, 2] with as many corners, at these heights, m."""
    a = np.column_stack([below, np.full(len(below), low)])
    b = np.column_stack([above, np.full(len(above), high)])
    walls = [np.array([a[i], a[j], b[j], b[i]]) for i, j in pairwise([*range(len(a)), 0])]
    return [*(Face(wall, _shaded(wall, sides)) for wall in walls), Face(b, _shaded(b, top))]


def _shaded(corners: Floats, colour: Colour) -> Colour:
    """The colour of a face by how much light falls on it."""
    normal = normal_of(corners)
    falls = max(float(normal @ LIGHT) / max(float(np.linalg.norm(normal)), 1e-9), 0.0)
    return mixed(colour, BLACK, DARKEST + (1 - DARKEST) * falls)


def normal_of(corners: Floats) -> Floats:
    """[3] outwards, of any length."""
    normal: Floats = np.cross(corners[1] - corners[0], corners[2] - corners[1])
    return normal


def _lamps(length: float, width: float, lights: tuple[bool, int]) -> list[Face]:
    """Rear lamps, red where it brakes, and blinkers on their outer ends."""
    braking, blinker = lights
    back, side = -length / 2 - 0.03, width / 2
    found = []
    for left in (1, -1):
        inner, outer = left * 0.45 * side, left * 0.86 * side
        blinks = blinker == left
        middle = inner + 0.4 * (outer - inner) if blinks else outer
        found.append(_rear(back, inner, middle, BRAKE if braking else LAMP_OFF))
        if blinks:
            found.append(_rear(back, middle, outer, BLINK))
    return found


def _rear(back: float, y1: float, y2: float, colour: Colour) -> Face:
    """A lamp at the back between two positions across, m."""
    left, right = max(y1, y2), min(y1, y2)
    corners = [(back, left, 0.58), (back, right, 0.58), (back, right, 0.76), (back, left, 0.76)]
    return Face(np.array(corners), colour)
