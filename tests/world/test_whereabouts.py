"""Who is near, and what is near, without looking at everything in every step."""

import math
import random

import numpy as np
import pytest

from sumo_mcts.world.nearby import MARGIN, Nearby
from sumo_mcts.world.whereabouts import AGAIN_S, FASTEST, Whereabouts

STEP, REACH = 0.1, 100.0


class Domain:
    """What libsumo tells of vehicles; counts how often it is asked for a position."""

    def __init__(self, places: dict[str, tuple[float, float]]) -> None:
        self.places, self.asked = places, 0

    def getIDList(self) -> tuple[str, ...]:  # noqa: N802  # libsumo's name
        return tuple(sorted(self.places))

    def getPosition(self, name: str) -> tuple[float, float]:  # noqa: N802  # libsumo's name
        self.asked += 1
        return self.places[name]


def near(domain: Domain, x: float, y: float, reach: float) -> list[tuple[str, float, float]]:
    """Who is there, by looking at all."""
    return [
        (name, *domain.places[name])
        for name in domain.getIDList()
        if math.dist(domain.places[name], (x, y)) <= reach
    ]


@pytest.mark.parametrize("seed", range(5))
def test_nobody_is_missed_who_drives(seed: int) -> None:
    """Vehicles come and go, drive up to FASTEST, and two places are asked about."""
    rng = random.Random(seed)
    domain = Domain({})
    where = Whereabouts(domain)
    for k in range(300):
        for name, (x, y) in domain.places.items():
            angle, way = rng.uniform(-math.pi, math.pi), rng.uniform(0.0, FASTEST) * STEP
            domain.places[name] = x + way * math.cos(angle), y + way * math.sin(angle)
        for name in rng.sample("abcdefghij", 2):
            if domain.places.pop(name, None) is None:
                domain.places[name] = rng.uniform(-400.0, 400.0), rng.uniform(-400.0, 400.0)
        where.look()
        for x, reach in ((0.0, REACH), (2.0 * k, 1.5 * REACH)):
            assert where.within(x, 0.0, reach, k * STEP) == near(domain, x, 0.0, reach)
        for name in "abcdefghij":
            assert (name in where) == (name in domain.places)


def test_those_far_away_are_asked_for_now_and_then() -> None:
    domain = Domain({"near": (10.0, 0.0), **{f"far{i}": (1000.0 + i, 0.0) for i in range(100)}})
    where = Whereabouts(domain)
    steps = 50
    for k in range(steps):
        where.look()
        assert [name for name, *_ in where.within(0.0, 0.0, REACH, k * STEP)] == ["near"]
    assert domain.asked <= steps + 100 * (1 + steps * STEP / AGAIN_S)


def test_at_one_time_each_is_asked_for_once() -> None:
    domain = Domain({"a": (0.0, 0.0), "b": (50.0, 0.0)})
    where = Whereabouts(domain)
    where.look()
    for reach in (10.0, 60.0, 300.0):
        where.within(0.0, 0.0, reach, 7.0)
    assert domain.asked == 2


def test_who_was_on_no_road_may_be_anywhere_next() -> None:
    """SUMO's position of those is one far beyond any road."""
    domain = Domain({"a": (-1073741824.0, -1073741824.0)})
    where = Whereabouts(domain)
    where.look()
    assert where.within(0.0, 0.0, REACH, 0.0) == []
    domain.places["a"] = 1.0, 2.0
    where.look()
    assert where.within(0.0, 0.0, REACH, STEP) == [("a", 1.0, 2.0)]


def test_time_that_goes_back_is_another_run() -> None:
    domain = Domain({"a": (1000.0, 0.0)})
    where = Whereabouts(domain)
    where.look()
    assert where.within(0.0, 0.0, REACH, 60.0) == []
    domain.places["a"] = 1.0, 2.0
    where.look()
    assert where.within(0.0, 0.0, REACH, 10.0) == [("a", 1.0, 2.0)]


def test_boxes_near_a_place_that_moves_are_those_that_a_look_at_all_finds() -> None:
    rng = np.random.default_rng(0)
    low = rng.uniform(-2000.0, 2000.0, (500, 2))
    high = low + rng.uniform(0.0, 300.0, (500, 2))
    boxes, found = Nearby(low, high, REACH), 0
    place = np.zeros(2)
    for _ in range(300):
        place += rng.uniform(-0.3 * MARGIN, 0.3 * MARGIN, 2) + 2.0
        away = np.maximum(np.maximum(low - place, place - high), 0.0)
        expected = np.flatnonzero(np.hypot(*away.T) < REACH)
        assert boxes.of(*place).tolist() == expected.tolist()
        found += len(expected)
    assert found > 0
