"""Numbers from the ego's executed states alone: comfort, jerk, separate events, free-flow time.
Plain arrays in, plain numbers out."""

from collections.abc import Sequence
from math import inf

import numpy as np

from sumo_mcts.arrays import Floats, Indices
from sumo_mcts.numerics.lanes import connection, limits, successors
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import EgoState

ACCEL_RANGE = (-4.05, 2.40)  # m/s2, longitudinal
LATERAL_MAX = 4.89  # m/s2
JERK_MAX = 4.13  # m/s3
WINDOW_S = 0.5  # accelerations are averaged over at least this long before they are differenced
EVENTS_APART_S = 1.0
_EPS = 1e-6  # a value that sits on a bound has not passed it


def window(step: float) -> int:
    """Number of steps that an average covers: as few as fill WINDOW_S, at least one. step: s."""
    return max(1, int(np.ceil(WINDOW_S / step - _EPS)))


def accelerations(v: Floats, step: float) -> Floats:
    """Acceleration [T-1], m/s2, during each step, from the speeds v [T], m/s, at its ends."""
    return np.diff(v) / step


def jerks(v: Floats, step: float) -> Floats:
    """Longitudinal jerk [max(0, T-2n)], m/s3, from speeds v [T], m/s; n = window(step).

    The mean accelerations over two adjoining windows of n steps, differenced over the time between
    their middles. SUMO changes an acceleration from one step to the next, so an unsmoothed jerk
    would measure the step length and not the driving.
    """
    n = window(step)
    if len(v) <= 2 * n:
        return np.zeros(0)
    mean = (v[n:] - v[:-n]) / (n * step)
    return np.asarray((mean[n:] - mean[:-n]) / (n * step), dtype=np.float64)


def lateral_accelerations(v: Floats, heading: Floats, step: float) -> Floats:
    """Speed times yaw rate [max(0, T-n)], m/s2, averaged over the n steps of a window: lanes are
    polylines, whose kinks are no real yaw."""
    n = window(step)
    if len(v) <= n:
        return np.zeros(0)
    turned = np.unwrap(heading)
    total = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]))])
    return np.asarray(
        (total[n:] - total[:-n]) / n * (turned[n:] - turned[:-n]) / (n * step), dtype=np.float64
    )


def comfortable_share(v: Floats, heading: Floats, step: float) -> float | None:
    """Share [0..1] of the steps with acceleration, lateral acceleration and jerk within bounds.

    None without a step. v [T] m/s, heading [T] rad.

    Lateral acceleration and jerk are judged from the step on in which their windows are full.
    """
    a = accelerations(v, step)
    if len(a) == 0:
        return None
    fine = (a >= ACCEL_RANGE[0] - _EPS) & (a <= ACCEL_RANGE[1] + _EPS)
    for values, limit in (
        (lateral_accelerations(v, heading, step), LATERAL_MAX),
        (jerks(v, step), JERK_MAX),
    ):
        if len(values):
            fine[-len(values) :] &= np.abs(values) <= limit + _EPS
    return float(np.mean(fine))


def rms(values: Floats) -> float | None:
    """Root of the mean square of values [K]; None where there are none."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else None


def events(
    times: Sequence[float], strengths: Sequence[float], step: float, apart: float = EVENTS_APART_S
) -> list[float]:
    """Greatest strength of each separate event.

    times [K], s, ascending: ends of the steps in which something of that strength [K] was seen. An
    event lasts until nothing was seen for `apart` seconds: so the count does not depend on the step
    length.
    """
    found: list[float] = []
    last = -inf
    for time, strength in zip(times, strengths, strict=True):
        if time - step - last >= apart - _EPS:
            found.append(strength)
        else:
            found[-1] = max(found[-1], strength)
        last = time
    return found


def free_flow_time(road: RoadMap, edges: Sequence[int], start_s: float, ego: EgoState) -> float:
    """Seconds from lane position start_s, m, on the first of `edges` to the end of the last, as
    fast as the ego may and can drive.

    Each edge counts with its fastest lane, each junction with the quickest of the connections that
    lead on.
    """
    total = 0.0
    for k, edge in enumerate(edges):
        lanes = np.flatnonzero(road.edge == edge)
        times = road.length[lanes] / _free_speed(road, lanes, ego)
        best = int(np.argmin(times))
        share = 1.0 if k else max(0.0, 1.0 - start_s / float(road.length[lanes[best]]))
        total += share * float(times[best])
        if k + 1 < len(edges):
            total += min(
                (_connection_time(road, int(lane), edges[k + 1], ego) for lane in lanes),
                default=0.0,
            )
    return total


def _connection_time(road: RoadMap, lane: int, onto: int, ego: EgoState) -> float:
    """Seconds on the internal lanes between `lane` and the edge `onto`; inf where they are not
    connected."""
    quickest = inf
    for first in successors(road, lane):
        time, exit_lane = crossing_time(road, first, 0.0, ego)
        if road.edge[exit_lane] == onto:
            quickest = min(quickest, time)
    return quickest


def crossing_time(road: RoadMap, lane: int, s: float, ego: EgoState) -> tuple[float, int]:
    """Free-flow seconds from lane position s, m, on an internal lane to the end of its connection,
    and the ordinary lane there; 0 and the lane itself where it is ordinary."""
    *inside, ends = connection(road, lane)
    lanes = np.array(inside, dtype=np.int64)
    left = road.length[lanes]
    left[:1] = np.maximum(left[:1] - s, 0.0)
    return float((left / _free_speed(road, lanes, ego)).sum()), ends


def _free_speed(road: RoadMap, lanes: Indices, ego: EgoState) -> Floats:
    """How fast the ego may and can drive on these lanes, m/s."""
    return np.minimum(limits(road, lanes, ego.vclass) * ego.speed_factor, ego.max_speed)
