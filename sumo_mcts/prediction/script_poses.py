"""Where a scripted vehicle's box lies: from lane, position and lateral offset to poses."""

import math

import numpy as np

from sumo_mcts.arrays import Floats, Ints
from sumo_mcts.numerics.geometry import (
    COS,
    SIN,
    Lines,
    X,
    Y,
    chord,
    lines_of,
    point_at,
    point_on,
    swung,
)
from sumo_mcts.numerics.kernel import making_arrays
from sumo_mcts.road import RoadMap

TANGENT = 0.5  # m over which the direction of a lane is measured


def script_poses(
    road: RoadMap, lane: Ints, s: Floats, d: Floats, v: Floats, step: float, length: float
) -> Floats:
    """[M, 4] (columns X .. SIN) where a vehicle's box is after each step.

    After a step (s) with speed v [M] (m/s) its front is on lane [M] at s [M] (m), with offset d [M]
    (m, left positive). `length`: m.
    """
    driven = np.concatenate([[0.0], np.cumsum(v[1:] * step)])
    pose = np.zeros((len(lane), 4))
    _fill(pose, lane, s, d, driven, length, lines_of(road))
    return pose


@making_arrays
def _fill(
    pose: Floats, lane: Ints, s: Floats, d: Floats, driven: Floats, length: float, lines: Lines
) -> None:
    """The box from the front to where the rear drove before; `driven` [M]: m since the first
    row."""
    # how far sideways the lanes lie that it has changed to, in x and y, m
    shift = np.zeros((len(lane), 2))
    rear, turned = 0, 0.0
    for m in range(len(lane)):
        here = lane[m]
        fx, fy = point_on(lines, here, s[m])
        ax, ay = point_at(
            lines.points,
            lines.arc,
            lines.first[here],
            lines.first[here + 1],
            s[m] * lines.scale[here] - TANGENT,
        )
        tx, ty = (fx - ax) / TANGENT, (fy - ay) / TANGENT
        forward, left = 0.0, 0.0
        if m > 0:
            shift[m] = shift[m - 1]
            forward, left = driven[m] - driven[m - 1], d[m] - d[m - 1]
            before = lane[m - 1]
            if here != before and abs(s[m] - s[m - 1] - forward) < 1e-6:
                bx, by = point_on(lines, before, s[m])
                shift[m, X] += fx - bx
                shift[m, Y] += fy - by
                left += (fy - by) * tx - (fx - bx) * ty
        while rear < m and driven[rear + 1] <= driven[m] - length:
            rear += 1
        rx, ry = point_on(lines, lane[rear], s[rear] + driven[m] - length - driven[rear])
        rx, ry = rx + shift[m, X] - shift[rear, X], ry + shift[m, Y] - shift[rear, Y]
        _, _, c, n = chord(fx, fy, rx, ry, 1.0, 0.0)
        turned = swung(turned, forward, left, length)
        ct, nt = math.cos(turned), math.sin(turned)
        c, n = c * ct - n * nt, n * ct + c * nt
        pose[m, X] = fx - d[m] * ty - 0.5 * length * c
        pose[m, Y] = fy + d[m] * tx - 0.5 * length * n
        pose[m, COS], pose[m, SIN] = c, n
