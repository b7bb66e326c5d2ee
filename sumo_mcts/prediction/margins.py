"""The margins that a forecast leaves around agents whose position is uncertain."""

import math

import numpy as np

from sumo_mcts.arrays import Floats
from sumo_mcts.numerics.geometry import Box, box_distance
from sumo_mcts.scene import EgoState, Forecast, Scene


def inflate(
    forecast: Forecast, scene: Scene, error: float, on_foot: float | Floats, room: Floats
) -> Forecast:
    """The forecast with boxes that are `error` (m) longer at either end, and those of persons
    `on_foot` (m), of all or [N], larger on every side.

    A margin is at most half of the distance between a box and the ego now. Else the ego would be in
    contact with an agent beside it. Sideways it is at most half of the `room` [N] that the ego has
    beside who walks along its lane (roadside.py). Else it could not pass where there is room.
    """
    along = np.where(scene.agents.person, on_foot, 0.0)
    sideways = np.minimum(along, 0.5 * room)
    along = along + error
    grows = np.flatnonzero(along)
    if not len(grows):
        return forecast
    boxes = np.column_stack([forecast.pose[0, 0], forecast.half_length, forecast.half_width])
    most = np.zeros(len(along))
    most[grows] = 0.5 * _distance(scene.ego, boxes[grows])
    along, sideways = np.minimum(along, most), np.minimum(sideways, most)
    return forecast._replace(
        half_length=forecast.half_length + along,
        half_width=forecast.half_width + sideways,
        s=forecast.s + along,  # the position of the front
    )


def _distance(ego: EgoState, boxes: Floats) -> Floats:
    """[K] m from the ego to the boxes [K, 6]: columns as in Box."""
    own = Box(
        x=ego.x,
        y=ego.y,
        cos=math.cos(ego.heading),
        sin=math.sin(ego.heading),
        half_length=ego.length / 2,
        half_width=ego.width / 2,
    )
    return np.array([box_distance(own, Box(*map(float, each))) for each in boxes])
