"""How fast a vehicle may take the bends of its route, by the bound on its lateral acceleration: the
paper's limit of steering. The way itself is the lane's."""

import math

import numpy as np

from sumo_mcts.arrays import Floats, Indices
from sumo_mcts.model.caps import SPACING
from sumo_mcts.numerics.geometry import COS, SIN

WINDOW = 5.0  # m on either side: lanes are drawn with kinks, which a driver rounds off
ROWS = round(WINDOW / SPACING)


def bend_speeds(pose: Floats, row: Indices, lateral_accel: float, decel: float) -> Floats:
    """[R] highest speed in bends, m/s, where v^2 times the curvature is `lateral_accel` (m/s2), and
    before them on the same node, as braking with `decel` (m/s2) leads to it.

    pose [R, 4] X .. SIN, one every SPACING m of a node; row [W+1] as in RouteMap. The curvature is
    how much the heading changes over WINDOW m before and behind, less at the ends of the node.
    """
    square = np.full(len(pose), np.inf)
    if math.isinf(lateral_accel):
        return square
    for first, beyond in zip(row[:-1].tolist(), row[1:].tolist(), strict=True):
        heading = np.unwrap(np.arctan2(pose[first:beyond, SIN], pose[first:beyond, COS]))
        at = np.arange(len(heading))
        before, behind = np.maximum(at - ROWS, 0), np.minimum(at + ROWS, len(at) - 1)
        turned = np.abs(heading[behind] - heading[before])
        curvature = turned / (np.maximum(behind - before, 1) * SPACING)
        bent, braked = curvature > 0.0, 2.0 * decel * SPACING * at
        square[first:beyond][bent] = lateral_accel / curvature[bent]
        ahead = np.minimum.accumulate((square[first:beyond] + braked)[::-1])[::-1]
        square[first:beyond] = ahead - braked
    return np.sqrt(square)
