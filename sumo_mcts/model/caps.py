"""The highest speed along a route: before lower limits, ends of lanes, waypoints, and limits that
the simulation has just lowered."""

import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices
from sumo_mcts.numerics.kernel import entry
from sumo_mcts.scene import Stop

SPACING = 1.0  # m between the rows of the pose and speed tables
END_GAP = 1.5  # m kept to the end of a lane that leads nowhere
NOTICED_S = 1.0  # s after the end of a waypoint for which its speed still holds


@entry
def fill_caps(
    cap: Floats,
    nxt: Indices,
    row: Indices,
    length: Floats,
    most: Floats,
    goal: Bools,
    decel: float,
) -> None:
    """RouteMap.cap [R], backward over the nodes: v^2 = v_next^2 + 2 b d. `most` [R]: the limits,
    m/s."""
    for i in range(len(nxt) - 1, -1, -1):
        beyond = row[i + 1] - 1
        end = most[beyond] if goal[i] else 0.0
        distance = -END_GAP
        if nxt[i] >= 0:
            end, distance = min(most[beyond], cap[row[nxt[i]]]), 0.0
        elif goal[i]:
            distance = 0.0
        for k in range(row[i + 1] - 1, row[i] - 1, -1):
            to_end = max(0.0, length[i] - (k - row[i]) * SPACING + distance)
            cap[k] = min(most[k], math.sqrt(end * end + 2.0 * decel * to_end))
        share = length[i] / SPACING - (beyond - 1 - row[i])
        # between the last two rows `end` is to be read where the lane ends
        if nxt[i] >= 0 and share > 1e-6:
            cap[beyond] = max(0.0, cap[beyond - 1] + (end - cap[beyond - 1]) / share)


def slow_down(
    cap: Floats, nxt: Indices, row: Indices, length: Floats, node: int, stop: Stop, decel: float
) -> None:
    """Bound RouteMap.cap before a waypoint on `node`, and on it.

    Its speed holds for as long behind it as SUMO may take to notice.
    """
    begin = math.floor(stop.begin)
    end = stop.place + stop.speed * NOTICED_S + SPACING
    to = np.full(len(nxt), np.inf)  # m from the start of each node to the waypoint
    to[node] = begin
    for i in range(node, -1, -1):
        if i != node and nxt[i] >= 0:
            to[i] = length[i] + to[nxt[i]]
        if math.isinf(to[i]):
            continue
        away = to[i] - np.arange(row[i + 1] - row[i]) * SPACING
        bound = np.sqrt(stop.speed**2 + 2.0 * decel * np.maximum(away, 0.0))
        rows = slice(row[i], row[i + 1])
        cap[rows] = np.where(away >= begin - end, np.minimum(cap[rows], bound), cap[rows])


class Pace(NamedTuple):
    """Where the ego is on its route, and how it drives."""

    node: int
    s: float  # m
    v: float  # m/s
    a: float  # m/s2


def braking(distance: Floats, pace: Pace, decel: float, jerk: float) -> Floats:
    """[n] speed after so many metres of braking, m/s."""
    begins = max(pace.a + decel, 0.0) / jerk  # s until it brakes with `decel`
    time = np.linspace(0.0, begins, 21)
    v = np.maximum(pace.v + pace.a * time - 0.5 * jerk * time**2, 0.0)
    driven = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(time))])
    later = np.sqrt(np.maximum(v[-1] ** 2 - 2.0 * decel * (distance - driven[-1]), 0.0))
    return np.where(distance < driven[-1], np.interp(distance, driven, v), later)
