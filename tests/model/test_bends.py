"""The bound on lateral acceleration: how fast an ego takes bends."""

import math

import numpy as np
import pytest
from helpers import Lane, build, edges, ego_at
from helpers_model import PHYSICS, scenario, scene_of

from sumo_mcts.driver.route_keeper import RouteKeeper
from sumo_mcts.model.route import RouteMap, route_map
from sumo_mcts.road import RoadMap

STRAIGHT, LIMIT, LATERAL = 100.0, 30.0, 3.0  # m, m/s, m/s2


def around(radius: float, degrees: float, kink: float = 3.0) -> RoadMap:
    """A straight lane, a bend to the left that is drawn with a point every `kink` degrees, and a
    straight one."""
    angles = np.radians(np.arange(0.0, degrees + 0.1, kink))
    x, y = STRAIGHT + radius * np.sin(angles), radius * (1.0 - np.cos(angles))
    end = (x[-1] + STRAIGHT * math.cos(angles[-1]), y[-1] + STRAIGHT * math.sin(angles[-1]))
    shape = [(0.0, 0.0), *zip(x.tolist(), y.tolist(), strict=True), end]
    return build([Lane("a", 0, tuple(shape), speed=LIMIT)])


def laid_out(road: RoadMap, lateral: float = LATERAL) -> RouteMap:
    return route_map(road, edges(road, "a"), 0, 5.0, 1.0, 50.0, 2.0, lateral_accel=lateral)


@pytest.mark.parametrize("radius", [12.0, 30.0, 80.0])
def test_in_a_bend_speed_squared_over_radius_is_the_bound(radius: float) -> None:
    road = around(radius, 170.0)
    most = laid_out(road).most
    inside = slice(int(STRAIGHT) + 10, int(STRAIGHT + radius * math.radians(170.0)) - 5)
    # the box is a chord of the bend, so its heading turns as the bend does
    assert most[inside] ** 2 / radius == pytest.approx(LATERAL, rel=0.12)
    assert np.isclose(most[-80:], LIMIT).all()


def test_the_ego_brakes_before_the_bend() -> None:
    """With approach_decel, 2 m/s2, as for a lower limit."""
    route = laid_out(around(12.0, 170.0))
    v = math.sqrt(LATERAL * 12.0)
    assert route.cap[50] == pytest.approx(math.sqrt(v * v + 2.0 * 2.0 * 50.0), rel=0.1)
    assert (np.diff(route.cap[:100] ** 2) > -2.0 * 2.0 - 1e-6).all()
    assert route.cap[0] == pytest.approx(math.sqrt(v * v + 2.0 * 2.0 * 100.0), rel=0.1)


def test_kinks_of_a_drawn_bend_are_rounded_off() -> None:
    """A bend of 60 m drawn with points every 15 m is not taken as slowly as its kinks are sharp."""
    fine, coarse = (laid_out(around(60.0, 120.0, kink)).most for kink in (1.0, 15.0))
    assert coarse[100:220].min() > 0.7 * fine[100:220].min()


def test_without_a_bound_nothing_changes_and_straight_lanes_never_do() -> None:
    road = around(12.0, 170.0)
    assert (laid_out(road, math.inf).most == LIMIT).all()
    straight = build([Lane("a", 0, ((0.0, 0.0), (200.0, 0.0)), speed=LIMIT)])
    bound, free = laid_out(straight), laid_out(straight, math.inf)
    assert np.array_equal(bound.cap, free.cap)


@pytest.mark.parametrize("bound", [None, 3.0])
def test_the_scenario_bounds_the_route_of_its_ego(bound: float | None) -> None:
    road = around(12.0, 170.0)
    keeper = RouteKeeper(
        scenario(ego_model={"max_lateral_accel_mps2": bound}), road, PHYSICS, False
    )
    keeper.keep(scene_of(ego_at(road, "a_0", 5.0, 10.0, route=edges(road, "a")), road))
    assert keeper.route is not None
    slowest = keeper.route.most.min()
    assert slowest == LIMIT if bound is None else slowest < 1.1 * math.sqrt(bound * 12.0)
