"""How a driver follows the road and the leader: desired speed, and car following."""

import math

from sumo_mcts.arrays import Floats, Ints
from sumo_mcts.numerics.kernel import inlined, kernel
from sumo_mcts.prediction.course import Course
from sumo_mcts.prediction.drivers import TrafficParams

LIMIT_VIEW = 60.0  # m ahead within which a driver slows down for a lower limit
OVER_LIMIT = 1.2  # times the limit: a vehicle that is faster still slows down to this
LEAST_LIMIT = 1.0  # m/s: lower limits count as this


@kernel
def free_accel(
    q: TrafficParams, c: Course, i: int, k: int, x: float, v: float, liked: float
) -> float:
    """Acceleration of vehicle i, on the k-th lane of its path, on the empty road, m/s2.

    Lower limits of coming lanes are in view. The acceleration does not fade towards the speed
    wished for, as the IDM's own term does: SUMO's drivers do not.
    """
    wish = max(c.limit[i, k], LEAST_LIMIT)
    # a vehicle that is faster than the limit has a reason of its own
    wish = min(max(wish, min(v, OVER_LIMIT * wish)), liked)
    a = max(min(q.accel, (wish - v) / q.step), -q.decel)
    for m in range(k + 1, c.lanes[i]):
        distance = c.offset[i, m] - x
        if distance > LIMIT_VIEW:
            break
        slow = c.limit[i, m]
        if slow < v and distance > 0.0 and v * v - slow * slow > distance * q.decel:
            a = min(a, (slow * slow - v * v) / (2.0 * max(distance, 1.0)))
    return a


@kernel
def follow_accel(q: TrafficParams, v: float, gap: float, leader_v: float, free: float) -> float:
    """Acceleration behind a leader, m/s2: that on the empty road, `free`, less the interaction term
    of the IDM (Treiber, Hennecke, Helbing 2000)."""
    wish = q.gap + max(
        0.0, v * q.headway + v * (v - leader_v) / (2.0 * math.sqrt(q.accel * q.decel))
    )
    return free - q.accel * (wish / max(gap, 0.1)) ** 2


@inlined
def leader_of(
    c: Course, length: Floats, mark: Ints, at: Ints, x: Floats, v: Floats, i: int
) -> tuple[float, float]:
    """Gap (m) and speed of the nearest vehicle ahead on the path of vehicle i; (inf, 0): none.

    A vehicle also counts on the lane behind its front's, as far as it reaches back. `mark` [lanes
    of the road] is work space, all -1.
    """
    # a path may come to a lane twice, in a roundabout: the first time counts
    for k in range(c.lanes[i] - 1, at[i] - 1, -1):
        mark[c.path[i, k]] = k
    gap, leader_v = math.inf, 0.0
    for j in c.along[i]:
        if j < 0:
            break
        k = at[j]
        m = mark[c.path[j, k]]
        place = x[j] - c.offset[j, k]
        if m < 0 and k > 0 and place < length[j]:
            m = mark[c.path[j, k - 1]]
            place = x[j] - c.offset[j, k - 1]
        if m < 0:
            continue
        distance = c.offset[i, m] + place - x[i]
        if distance > 0.0 or (distance == 0.0 and j < i):
            if distance - length[j] < gap:
                gap, leader_v = distance - length[j], v[j]
    for k in range(at[i], c.lanes[i]):
        mark[c.path[i, k]] = -1
    return gap, leader_v
