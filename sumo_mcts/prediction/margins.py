"""The room that a forecast leaves around agents of whom it is not sure where they will be."""

import math

import numpy as np

from sumo_mcts.numerics.geometry import Box, box_distance
from sumo_mcts.scene import EgoState, Floats, Forecast, Scene


def inflate(forecast: Forecast, scene: Scene, error: float, on_foot: float) -> Forecast:
    """The forecast with longer boxes, by `error` (m) at either end, and those of whoever is on foot
    `on_foot` (m) larger on every side.

    By no more than half of what is between a box and the ego now: else it would be in contact with
    whom it stands beside.
    """
    sideways = np.where(scene.agents.person, on_foot, 0.0)
    along = sideways + error
    concerned = np.flatnonzero(along)
    if not len(concerned):
        return forecast
    most = np.zeros(len(along))
    most[concerned] = 0.5 * _away(
        scene.ego,
        np.column_stack([forecast.pose[0, 0], forecast.half_length, forecast.half_width])[
            concerned
        ],
    )
    along, sideways = np.minimum(along, most), np.minimum(sideways, most)
    return forecast._replace(
        half_length=forecast.half_length + along, half_width=forecast.half_width + sideways,
        s=forecast.s + along,  # s is that of the front
    )  # fmt: skip


def _away(ego: EgoState, boxes: Floats) -> Floats:
    """[K] m from the ego to the boxes [K, 6]: columns as in Box."""
    own = Box(
        ego.x, ego.y, math.cos(ego.heading), math.sin(ego.heading), ego.length / 2, ego.width / 2
    )
    return np.array([box_distance(own, Box(*map(float, each))) for each in boxes])
