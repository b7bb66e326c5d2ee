"""The highest speeds along the route of an ego that is too fast for them: before a limit that was
lowered it gets time to brake, and before a stop it brakes harder than it is used to."""

import numpy as np

from sumo_mcts.arrays import Bools, Floats
from sumo_mcts.model.caps import SPACING, Pace, braking, fill_caps, slow_down
from sumo_mcts.model.route import CAP, RouteMap
from sumo_mcts.scene import NO_STOP, Stop

SOON_S = 0.5  # s until the ego brakes


def with_time_to_brake(
    route: RouteMap,
    lowered: Bools,
    pace: Pace,
    decels: tuple[float, ...],
    jerk: float,
    stop: Stop = NO_STOP,
) -> RouteMap:
    """The route for an ego that drives too fast: for a limit lowered before or under it, or for
    the end of its lane beside its `stop`, the one that the route was laid out for.

    Before the limit it is what braking from now on leads to, with `jerk` (m/s3) up to the first of
    `decels` (m/s2), which the route was laid out with. Before the stop it brakes with the first of
    them that is enough, else with the last. `lowered` [W]: the nodes whose limits were changed. The
    same route where the ego is slow enough.
    """
    most = _eased(route, lowered, pace, decels[0], jerk)
    decel = _enough(route, most, pace, decels) if route.halt.ends else decels[0]
    if decel == decels[0] and (most == route.most).all():
        return route
    caps, rows = _caps(route, most, decel), route.rows.copy()
    if route.halt.node >= 0 and stop.speed > 0.0:
        slow_down(caps, route.next, route.row, route.length, route.halt.node, stop, decel)
    rows[:, CAP] = caps
    return route._replace(cap=caps, rows=rows)


def _eased(route: RouteMap, lowered: Bools, pace: Pace, decel: float, jerk: float) -> Floats:
    """[R] the limits, m/s; on `lowered` nodes at least what the ego gets to by braking."""
    if not lowered.any():
        return route.most
    rows = np.diff(route.row)
    at = np.concatenate([np.arange(n) * SPACING for n in rows])
    ahead = np.repeat(route.station, rows) + at - float(route.station[pace.node]) - pace.s
    here = np.repeat(lowered, rows) & (ahead >= -SPACING)
    braked = np.where(here, braking(np.maximum(ahead, 0.0), pace, decel, jerk), 0.0)
    return np.maximum(route.most, braked)


def _enough(route: RouteMap, most: Floats, pace: Pace, decels: tuple[float, ...]) -> float:
    """The first of these decelerations (m/s2) that is enough: as ever if the ego is slow enough
    where it is, a harder one if it is after half a second."""
    soon = pace.s + SOON_S * pace.v
    for decel, s in zip(decels, (pace.s, *[soon] * len(decels)), strict=False):
        caps = _caps(route, most, decel)
        if _at(route, caps, pace.node, s) >= min(pace.v, _at(route, most, pace.node, s)):
            return decel
    return decels[-1]


def _caps(route: RouteMap, most: Floats, decel: float) -> Floats:
    """[R] RouteMap.cap with these limits and this deceleration (m/s2), without waypoints."""
    caps, goal = np.zeros(len(most)), (route.next < 0) & np.isinf(route.reach)
    fill_caps(caps, route.next, route.row, route.length, most, goal, decel)
    return caps


def _at(route: RouteMap, speeds: Floats, node: int, s: float) -> float:
    """One of these speeds [R] at a place of a node, m/s."""
    here = speeds[route.row[node] : route.row[node + 1]]
    return float(np.interp(s / SPACING, np.arange(len(here)), here))
