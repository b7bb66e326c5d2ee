"""Which things of a network are near a place that moves."""

import math

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices

MARGIN = 100.0  # m that the place moves until all things are looked at again


class Nearby:
    """The bounding boxes within `reach` m. So that a look costs what is near and not what the
    network has, those within MARGIN more are kept in mind."""

    def __init__(self, low: Floats, high: Floats, reach: float) -> None:
        """The corners of N boxes, [N, 2] m."""
        self._low, self._high, self._reach = low, high, reach
        self._x = self._y = math.inf  # the place where all were looked at, m
        self._some: Indices = np.zeros(0, np.int64)

    def of(self, x: float, y: float) -> Indices:
        """The boxes less than `reach` m from a place (m), in rising order."""
        if not math.hypot(x - self._x, y - self._y) < MARGIN:
            further = self._reach + MARGIN + 1.0  # a metre: nothing is lost by rounding
            self._x, self._y = x, y
            self._some = np.flatnonzero(_within(self._low, self._high, x, y, further))
        some = self._some
        return some[_within(self._low[some], self._high[some], x, y, self._reach)]


def _within(low: Floats, high: Floats, x: float, y: float, reach: float) -> Bools:
    away = np.maximum(np.maximum(low - (x, y), (x, y) - high), 0.0)
    return np.asarray((away * away).sum(axis=1) < reach**2)
