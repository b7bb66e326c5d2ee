"""What a moment has to show on the ground, in metres: the plan, and where others are expected."""

from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats
from sumo_mcts.reporting.camera import Shot

MARK_S = 1.0  # expected positions are marked every second, of plan and forecast alike
AHEAD_S = 5.0  # so far ahead
MOVES_M = 0.5  # an agent that is expected to move less has no marks


class Expected(NamedTuple):
    """A place where an agent is expected."""

    place: Floats  # [2] m
    strength: float  # 0..1: the later and the less likely, the weaker


def plan_path(shot: Shot) -> Floats:
    """[K, 2] the chosen plan from the ego's position on, m; empty where there is none."""
    plan = shot.cycle.decision.plan
    if plan is None or len(plan.time) == 0:
        return np.zeros((0, 2))
    coming = plan.time > shot.elapsed
    return np.concatenate([shot.ego[None, :2], plan.pose[coming, :2]])


def plan_marks(shot: Shot) -> list[Floats]:
    """Places of the plan every second, [2] m each, the last one first."""
    plan = shot.cycle.decision.plan
    if plan is None or len(plan.time) == 0:
        return []
    return [
        plan.pose[int(np.argmin(np.abs(plan.time - at))), :2]
        for at in reversed(_times(shot.elapsed, float(plan.time[-1])))
    ]


def expected(shot: Shot) -> list[Expected]:
    """The expected positions of the others, every second, the last and least likely ones first."""
    forecast = shot.cycle.forecast
    times = forecast.dt * np.arange(forecast.pose.shape[1])
    found = []
    for at in reversed(_times(shot.elapsed, times[-1] if len(times) else 0.0)):
        k = int(np.argmin(np.abs(times - at)))
        for h in np.argsort(forecast.weight):
            strength = fade(at) * (0.35 + 0.65 * float(forecast.weight[h]))
            for n in np.flatnonzero(forecast.valid[h, k]):
                moved = np.hypot(*(forecast.pose[h, k, n, :2] - forecast.pose[h, 0, n, :2]))
                if moved > MOVES_M:
                    found.append(Expected(forecast.pose[h, k, n, :2], strength))
    return found


def fade(at: float) -> float:
    """The strength of a mark this many seconds ahead."""
    return 0.9 - 0.65 * min(at / AHEAD_S, 1.0)


def _times(elapsed: float, horizon: float) -> list[float]:
    """Times since the decision at which an expected position is marked."""
    return [
        float(t) for t in np.arange(MARK_S, min(AHEAD_S, horizon) + 1e-6, MARK_S) if t > elapsed
    ]
