"""How the others drive along their paths, as SUMO's drivers are seen to do it.

Each vehicle gets one acceleration at each time. It is that of the empty road or behind a leader
(following.py), lowered for red lights, stop signs and right of way (yielding.py).
"""

import math

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Ints
from sumo_mcts.numerics.kernel import entry, inlined
from sumo_mcts.prediction.course import Course, red_ahead
from sumo_mcts.prediction.drivers import Drivers, Progress, TrafficParams
from sumo_mcts.prediction.following import follow_accel, free_accel, leader_of
from sumo_mcts.prediction.yielding import line_accel, rank_of, yield_accel
from sumo_mcts.scene import BRAKES, STANDING, STARTS

# A vehicle that cruises keeps its speed where its leader is further away than this: m, and s of
# driving.
CRUISE_GAP, CRUISE_S = 10.0, 3.0
# A vehicle that has stood for a while is taken to stay, unless a leader or a red light within this
# distance is the reason, m, along its path; driver/reasons.py asks the same of what is seen.
STAY_GAP, STAY_RED = 4.0, 30.0
MOST_HABIT = 4.0  # m/s2 by which a driver accelerates otherwise than expected, at most
HARD = 4.5  # m/s2 with which an agent brakes that is taken to brake for no reason
MOST_DECEL = 8.0  # m/s2 with which any vehicle can brake


def drive(
    course: Course | None,
    drivers: Drivers,
    nominal: Floats,
    params: TrafficParams,
    of_ego: TrafficParams,
    times: int,
    lanes: int,
) -> tuple[Floats, Floats, Bools]:
    """Positions along the paths [T, N] (m) and speeds [T, N] (m/s) at T `times`, and which drivers
    let the ego pass [N].

    The ego, row 0, has the speeds `nominal` [K] first, then follows as the others do, with
    parameters `of_ego`. `course`: what lies on the paths; None: all keep their speed. `lanes`: of
    the road.
    """
    n = len(drivers.x)
    xs, vs, polite = np.zeros((times, n)), np.zeros((times, n)), np.zeros(n, np.bool_)
    xs[0], vs[0] = drivers.x, drivers.v
    if course is not None:
        progress = Progress(
            at=np.zeros(n, np.int32),
            rank=np.full(n, np.inf),
            liked=np.full(n, np.inf),
            habit=np.zeros(n),
        )
        mark = np.full(lanes, -1, np.int32)
        _step_all(xs, vs, polite, course, drivers, nominal, params, of_ego, progress, mark)
    else:
        xs[:] = drivers.x + np.arange(times)[:, None] * params.step * drivers.v
        vs[:] = drivers.v
    return xs, vs, polite


@entry
def _step_all(
    xs: Floats,
    vs: Floats,
    polite: Bools,
    c: Course,
    d: Drivers,
    nominal: Floats,
    params: TrafficParams,
    of_ego: TrafficParams,
    progress: Progress,
    mark: Ints,
) -> None:
    """Fill the rows of `xs` and `vs` from the second on, and `polite`.

    `mark` [lanes of the road] is work space, all -1.
    """
    times, n = xs.shape
    step, at, rank = params.step, progress.at, progress.rank
    fading = math.exp(-step / params.persistence) if params.persistence > 0.0 else 0.0
    for t in range(times - 1):
        x, v = xs[t], vs[t]
        for i in range(n):
            while at[i] < c.lanes[i] - 1 and x[i] > c.offset[i, at[i] + 1]:
                at[i] += 1
            rank[i] = rank_of(c, d, i, at[i], rank[i], x[i], v[i], t * step)
        for i in range(n):
            if c.lanes[i] == 0:  # off the road, or a person: straight on, or it stops at once
                vs[t + 1, i] = 0.0 if d.does[i] == BRAKES else v[i]
                xs[t + 1, i] = x[i] + vs[t + 1, i] * step
                continue
            if i == 0 and t < len(nominal):
                vs[t + 1, 0] = nominal[t]
                xs[t + 1, 0] = x[0] + nominal[t] * step
                continue
            gap, leader_v = leader_of(c, d.length, mark, at, x, v, i)
            q = of_ego if i == 0 else params
            a = _driving_accel(q, c, d, progress, gap, leader_v, x[i], v[i], i, t, fading)
            if (
                d.stays[i]
                and d.does[i] != STARTS
                and v[i] < STANDING
                and gap > STAY_GAP
                and not red_ahead(c, i, at[i], 0, x[i] + STAY_RED)
            ):
                xs[t + 1, i], vs[t + 1, i] = x[i], 0.0
                continue
            a = min(a, line_accel(params, c, i, at[i], t, x[i], v[i], rank[i]))
            a = min(a, yield_accel(params, c, d, polite, progress, x, v, i, t))
            # With the others the gain by `euler` is none: SUMO's drivers brake later than these.
            ahead = 0.0
            if d.does[i] == BRAKES:
                a, ahead = min(a, -HARD), params.euler
            after = max(0.0, v[i] + max(a, -MOST_DECEL) * step)
            vs[t + 1, i] = after
            xs[t + 1, i] = x[i] + max(0.0, 0.5 * (v[i] + after) * step + (after - v[i]) * ahead)


@inlined
def _driving_accel(
    q: TrafficParams,
    c: Course,
    d: Drivers,
    progress: Progress,
    gap: float,
    leader_v: float,
    x: float,
    v: float,
    i: int,
    t: int,
    fading: float,
) -> float:
    """Acceleration of vehicle i on the empty road and behind its leader, with what it does
    otherwise than expected, m/s2.

    At the first time (t = 0) this records its desired speed and its habit.
    """
    liked, habit = progress.liked, progress.habit
    if t == 0 and d.cruises[i] and gap > CRUISE_GAP + CRUISE_S * v:
        liked[i] = v
    a = free_accel(q, c, i, progress.at[i], x, v, liked[i])
    if not math.isinf(gap):
        a = min(a, follow_accel(q, v, gap, leader_v, a))
    if t == 0 and i > 0 and fading > 0.0 and v > STANDING:
        habit[i] = min(max(d.trend[i] - a, -MOST_HABIT), MOST_HABIT)
    a += habit[i]
    habit[i] *= 1.0 if d.cruises[i] else fading
    return a
