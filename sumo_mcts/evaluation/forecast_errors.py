"""How far forecasts lie from what then happened.

A pair is an agent in one cycle that is still there when the forecast is judged.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Ints
from sumo_mcts.scene import Forecast


class Errors(NamedTuple):
    """One forecast, or several, at one time. P pairs."""

    distance: Floats  # [P] m between the centres; nan where the forecast has the agent gone
    on_lane: Bools  # [P] it counts in the lane share: it was on a lane
    right_lane: Bools  # [P] the forecast had its front there (a lane of a junction counts as one)


def errors(forecast: Forecast, after: float, centre: Floats, lane: Ints, there: Bools) -> Errors:
    """A forecast (its likeliest hypothesis) against where the agents really are `after` s.

    centre [N, 2] m; lane [N] of the front; there [N]: whether an agent is still on the road.
    Between two forecast times positions lie on a straight line; the lane is that of the nearer one.
    """
    last = forecast.v.shape[1] - 1
    place = min(after / forecast.dt, float(last))
    low = min(int(np.floor(place + 1e-9)), last - 1) if last > 0 else 0
    high, near = min(low + 1, last), round(place)
    share = max(place - low, 0.0)
    valid = forecast.valid[0, [low, high]]
    # where the agent is gone at one of the two times, the other one counts
    share_of_high = np.where(valid.all(axis=0), share, valid[1])[:, None]
    expected = (
        forecast.pose[0, low, :, :2] * (1.0 - share_of_high)
        + forecast.pose[0, high, :, :2] * share_of_high
    )
    distance = np.where(forecast.valid[0, near], np.hypot(*(expected - centre).T), np.nan)
    right = (forecast.lane[0, near] == lane) & forecast.valid[0, near]
    return Errors(distance[there], (lane >= 0)[there], right[there])


def together(parts: Sequence[Errors]) -> Errors:
    """All pairs of several forecasts."""
    if not parts:
        return Errors(np.zeros(0), np.zeros(0, np.bool_), np.zeros(0, np.bool_))
    return Errors(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def statistics(found: Errors) -> dict[str, float | int | None]:
    """The number of pairs; mean, 95th percentile and maximum of their position errors, m; the share
    on the right lane. And the number of agents that the forecast wrongly took to be gone."""
    known = found.distance[~np.isnan(found.distance)]
    return {
        "pairs": len(found.distance),
        "mean_m": float(known.mean()) if len(known) else None,
        "p95_m": float(np.percentile(known, 95)) if len(known) else None,
        "max_m": float(known.max()) if len(known) else None,
        "right_lane": (
            float(found.right_lane[found.on_lane].mean()) if found.on_lane.any() else None
        ),
        "gone": len(found.distance) - len(known),
    }
