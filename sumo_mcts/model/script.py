"""Where a scripted vehicle's box lies: from lane, position and lateral offset to poses."""

import numpy as np

from sumo_mcts.model.geometry import chord, point_at
from sumo_mcts.model.kernel import kernel
from sumo_mcts.scene import Floats, Ints, RoadMap


def script_poses(road: RoadMap, lane: Ints, s: Floats, d: Floats, v: Floats, step: float, length: float) -> Floats:
    """[M, 4] centre x, y, cos, sin of a vehicle that was on lane [M] at s [M] with offset d [M] after each step with speed v [M]."""
    driven = np.concatenate([[0.0], np.cumsum(v[1:] * step)])
    scale = road.shape_length / np.maximum(road.length, 1e-9)
    pose = np.zeros((len(lane), 4))
    _fill(pose, lane, s, d, driven, length, road.points, road.point_s, road.point_offset, scale)
    return pose


@kernel
def _fill(pose: Floats, lane: Ints, s: Floats, d: Floats, driven: Floats, length: float, points: Floats, arc: Floats, first: Ints, scale: Floats) -> None:
    rear = 0
    for m in range(len(lane)):
        here = lane[m]
        fx, fy = point_at(points, arc, first[here], first[here + 1], s[m] * scale[here])
        while rear < m and driven[rear + 1] <= driven[m] - length:
            rear += 1
        there = lane[rear] if driven[m] >= length else lane[0]
        at = s[rear] + (driven[m] - length - driven[rear])
        rx, ry = point_at(points, arc, first[there], first[there + 1], at * scale[there])
        x, y, c, n = chord(fx, fy, rx, ry, 1.0, 0.0)
        pose[m, 0], pose[m, 1], pose[m, 2], pose[m, 3] = x - d[m] * n, y + d[m] * c, c, n
