"""Who is near a place, without asking for the position of everybody in every step."""

import math
from itertools import chain, repeat
from typing import Any

import numpy as np

from sumo_mcts.arrays import Indices

# m/s that nothing moves faster than: who is further away than it can have come is not asked for.
FASTEST = 100.0
NOWHERE = 1e9  # m: SUMO's position of who is on no road is beyond
AGAIN_S = 0.5  # s after which it is asked for all the same, wherever it was


class Whereabouts:
    """The vehicles, or the persons, of one simulation, and where each was seen last."""

    def __init__(self, domain: Any) -> None:
        """`domain`: libsumo's, with getIDList and getPosition."""
        self._get = domain
        self._names: tuple[str, ...] = ()  # who is there, as SUMO lists them
        self._place: dict[str, int] = {}  # index of each
        self._x = self._y = np.zeros(0)  # [N] m, where each was seen last
        self._seen = np.zeros(0)  # [N] and when, s; -inf: never

    def __contains__(self, name: str) -> bool:
        """Whether it was there at the last look."""
        return name in self._place

    def look(self) -> None:
        """Take note of who is there now. One that was away in between is not known any more."""
        names = tuple(self._get.getIDList())
        if names == self._names:
            return
        known = np.array([*map(self._place.get, names, repeat(-1))], np.int64)
        self._x, self._y = np.append(self._x, 0.0)[known], np.append(self._y, 0.0)[known]
        self._seen = np.append(self._seen, -math.inf)[known]
        self._names, self._place = names, dict(zip(names, range(len(names)), strict=True))

    def within(
        self, x: float, y: float, reach: float, time: float
    ) -> list[tuple[str, float, float]]:
        """Name and position (m) of those within `reach` m of (x, y) at `time`, s, which is now."""
        if not self._names:
            return []
        age = time - self._seen
        may_be = (age >= AGAIN_S) | (age < 0.0)
        far = reach + FASTEST * np.where(may_be, 0.0, age)
        may_be |= self._squared(x, y) <= far * far
        self._ask(np.flatnonzero(may_be & (age != 0.0)), time)
        near = np.flatnonzero(self._squared(x, y) <= reach * reach)
        places = zip(near.tolist(), self._x[near].tolist(), self._y[near].tolist(), strict=True)
        return [(self._names[i], px, py) for i, px, py in places]

    def _ask(self, those: Indices, time: float) -> None:
        """Ask where these are at `time`, s, which is now."""
        if len(those):
            names = map(self._names.__getitem__, those.tolist())
            numbers = chain.from_iterable(map(self._get.getPosition, names))
            places = np.fromiter(numbers, np.float64, 2 * len(those))  # no array of tuples: slow
            self._x[those], self._y[those] = places[::2], places[1::2]
            self._seen[those] = np.where(np.abs(self._x[those]) < NOWHERE, time, -math.inf)

    def _squared(self, x: float, y: float) -> Any:
        """[N] the square of how far each was away when it was seen last, m2."""
        dx, dy = self._x - x, self._y - y
        return dx * dx + dy * dy
