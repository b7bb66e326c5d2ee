"""Whose turn it is where several came to a stand at an all-way stop at the same moment.

Who stood first goes first. Of those who cannot be told apart by that, the one goes first that has
no other on its right. Four that have one another on their right: the first is the one whose lane
the map has first. Everybody sees all this, so everybody comes to the same order, and it is that of
SUMO's drivers but for who begins of four.
"""

import math
from collections import defaultdict
from collections.abc import Iterable

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Ints
from sumo_mcts.prediction.conflicts import IN_TURN
from sumo_mcts.prediction.course import Course
from sumo_mcts.prediction.drivers import Drivers
from sumo_mcts.road import ALLWAY, RoadMap

ALIKE = 0.01  # rad by which gaps between arms differ that are as large as each other


def turns(road: RoadMap, course: Course | None, stood: Floats) -> Ints:
    """[N] the order of vehicles on these paths that came to a stand at the same time, `stood` [N]:
    the lower one goes first. No two have the same."""
    order = np.arange(len(stood), dtype=np.int32)
    if course is None or not course.sign.any():
        return order
    together = defaultdict(list)
    rows, places = np.nonzero(course.sign & (road.rule[course.path] == ALLWAY))
    for i in np.unique(rows).tolist():
        m = int(places[rows == i][0])
        before, inside = int(course.path[i, m - 1]), int(course.path[i, m])
        together[int(road.junction[inside]), float(stood[i])].append((i, before))
    for those in together.values():
        numbers = sorted(i for i, _ in those)
        arms = [(_comes_from(road, before), before) for _, before in those]
        for number, k in zip(numbers, in_order(arms, road.lefthand), strict=True):
            order[those[k][0]] = number
    return order


def waits_for_turn(course: Course | None, drivers: Drivers, patience_s: float) -> Bools:
    """[N] which of the drivers that have stood for long (`stays`) have, or had just now, a reason
    for it at an all-way stop: others that are inside, or whose turn comes or came first.

    One that stood again gave up its turn: who has it now has `patience_s` from then on to set off.
    """
    stays, stood, turn = drivers.stays, drivers.stood, drivers.turn
    waits = np.zeros(len(stays), np.bool_)
    if course is None or not course.sign.any():
        return waits
    # the first in turn comes first: who stands for no reason is no reason for those behind it
    for i in sorted(np.flatnonzero(stays).tolist(), key=lambda i: (stood[i], turn[i])):
        those = course.foe[i, (course.foe[i] >= 0) & (course.kind[i] == IN_TURN)]
        first = (stood[those] < stood[i]) | ((stood[those] == stood[i]) & (turn[those] < turn[i]))
        lately = np.isfinite(stood[those]) & (stood[those] > -patience_s)
        goes = course.internal[those, 0] | lately | (first & (~stays[those] | waits[those]))
        waits[i] = bool(goes.any())
    return waits


def _comes_from(road: RoadMap, lane: int) -> float:
    """In which direction a vehicle lies, seen from the junction at which its lane ends, rad."""
    end = road.point_offset[lane + 1]
    x, y = road.points[end - 2] - road.points[end - 1]
    return math.atan2(y, x)


def in_order(arms: Iterable[tuple[float, int]], lefthand: bool) -> list[int]:
    """Who goes first, second, ... of those that come from these directions (rad) on these lanes.

    Round the junction, each before the one on whose right it is; the widest gap parts the last one
    from the first.
    """
    side = -1.0 if lefthand else 1.0
    # counterclockwise, so that the one on the right is the next one (clockwise on the left)
    ring = sorted((side * angle, lane, k) for k, (angle, lane) in enumerate(arms))
    ahead = [*ring[1:], (ring[0][0] + 2.0 * math.pi, *ring[0][1:])]
    gaps = [after[0] - here[0] for here, after in zip(ring, ahead, strict=True)]
    widest = [n for n, gap in enumerate(gaps) if gap > max(gaps) - ALIKE]
    first = min(widest, key=lambda n: ring[n][1])
    return [ring[(first - n) % len(ring)][2] for n in range(len(ring))]
