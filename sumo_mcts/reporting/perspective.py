"""An eye behind and above the ego: world metres to pixels, in perspective.

Places are x, y and z (up), m. What an eye sees is right, up and ahead of it, m.
"""

import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats

BACK, HEIGHT, AIM = 15.5, 7.0, 16.0  # m: behind the ego's middle, above the road; looks at ahead
OPEN = math.radians(62.0)  # from the left edge of the picture to the right one
NEAR = 1.0  # m ahead of the eye: nearer is not drawn. The lowest row shows the ground beyond that


class Eye(NamedTuple):
    """Where one looks from, and how."""

    place: Floats  # [3] m
    axes: Floats  # [3, 3] rows: right, up, ahead
    focal: float  # pixels of the drawing
    size: tuple[int, int]  # width and height of the drawing, pixels

    def seen(self, places: Floats) -> Floats:
        """[..., 3] right, up and ahead of the eye, m."""
        seen: Floats = (np.asarray(places) - self.place) @ self.axes.T
        return seen

    def pixels(self, seen: Floats) -> Floats:
        """[..., 2] pixels of what is ahead."""
        middle = np.array(self.size) / 2
        pixels: Floats = middle + self.focal * seen[..., :2] * (1, -1) / seen[..., 2:]
        return pixels

    @property
    def horizon(self) -> float:
        """The row of the horizon, pixels."""
        return self.size[1] / 2 - self.focal * math.tan(self._down)

    def depth(self, rows: Floats) -> Floats:
        """How far ahead the ground of these rows is, m; inf above the horizon."""
        angle = self._down + np.arctan((np.asarray(rows) - self.size[1] / 2) / self.focal)
        with np.errstate(divide="ignore"):
            far: Floats = np.where(angle > 0, self.place[2] / np.tan(np.maximum(angle, 0)), np.inf)
        return far

    @property
    def _down(self) -> float:
        """By how much the eye looks down, rad."""
        return math.asin(-float(self.axes[2, 2]))


def eye_behind(x: float, y: float, heading: float, size: tuple[int, int]) -> Eye:
    """The eye that follows a vehicle at x, y (m) with this heading (rad); `size` in pixels."""
    down = math.atan2(HEIGHT, BACK + AIM)
    along = np.array([math.cos(heading), math.sin(heading), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    ahead = math.cos(down) * along - math.sin(down) * up
    axes = np.array([np.cross(along, up), math.cos(down) * up + math.sin(down) * along, ahead])
    place = np.array([x, y, HEIGHT]) - BACK * along
    return Eye(place, axes, size[0] / 2 / math.tan(OPEN / 2), size)


def clipped(seen: Floats) -> Floats:
    """[M, 3] the part of a convex area [K, 3] that is at least NEAR ahead."""
    kept: list[Floats] = []
    for a, b in zip(seen, np.roll(seen, -1, axis=0), strict=True):
        if a[2] >= NEAR:
            kept.append(a)
        if (a[2] >= NEAR) != (b[2] >= NEAR):
            kept.append(a + (NEAR - a[2]) / (b[2] - a[2]) * (b - a))
    return np.array(kept).reshape(-1, 3)
