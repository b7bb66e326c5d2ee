"""An ego that is too fast for the highest speeds along its route: for a limit that was lowered, for
a stop in the lane beside, and for both."""

import math

import numpy as np
import pytest
from helpers import Lane, build, edges, ego_at
from helpers_model import PHYSICS, lanes_east, scenario, scene_of

from sumo_mcts.driver.route_keeper import RouteKeeper
from sumo_mcts.model.caps import END_GAP, Pace
from sumo_mcts.model.route import RouteMap, route_map
from sumo_mcts.model.too_fast import with_time_to_brake
from sumo_mcts.road import RoadChanges
from sumo_mcts.scene import Stop
from sumo_mcts.world.roadmap import lane_index


def test_a_limit_lowered_under_the_ego_leaves_time_to_brake() -> None:
    """The caps are those of an ego that brakes from now on; they need no more than `decel`, and
    elsewhere nothing changes."""
    road = build([Lane("a", 0, ((0, 0), (400, 0)), ("b_0",), speed=5.0),
                  Lane("b", 0, ((400, 0), (500, 0)), speed=15.0)])  # fmt: skip
    plain = route_map(road, edges(road, "a", "b"), 0, 5.0, 1.0, 50.0, 2.0)
    lowered = plain.lane == lane_index(road)["a_0"]
    route = with_time_to_brake(plain, lowered, Pace(0, 50.0, 15.0, 1.0), (2.0,), 2.0)
    cap = route.cap[: route.row[1]]
    assert cap[50] >= 15.0 and cap[51] >= 15.0
    braking = (cap[50:-1] ** 2 - cap[51:] ** 2) / 2.0
    assert braking.max() < 2.05
    assert cap[190] == 5.0 and np.array_equal(route.rows[:, 4], route.cap)
    assert np.array_equal(route.cap[route.row[1] :], plain.cap[route.row[1] :])
    assert with_time_to_brake(plain, lowered, Pace(0, 50.0, 5.0, 0.0), (2.0,), 2.0) is plain
    assert with_time_to_brake(plain, ~lowered, Pace(0, 50.0, 15.0, 0.0), (2.0,), 2.0) is plain


@pytest.mark.parametrize(("v", "decel"), [(5.0, 2.0), (13.0, 2.0), (16.0, 3.0), (30.0, 4.5)])
def test_before_a_stop_the_gentlest_braking_that_is_enough_is_taken(v: float, decel: float) -> None:
    """Beside the lane of the stop the ego's lane ends at its place, 60 m ahead, of which END_GAP is
    kept; harder braking than 2 m/s2 begins after half a second."""
    road, stop = lanes_east(2, speed=50.0), Stop(1, 59.8, 60.0)
    route = route_map(road, edges(road, "a"), 0, 5.0, 1.0, 50.0, 2.0, stop=stop)
    none = np.zeros(2, np.bool_)
    found = with_time_to_brake(route, none, Pace(0, 0.0, v, 0.0), (2.0, 3.0, 4.5), 2.0, stop)
    assert found.cap[30] == pytest.approx(math.sqrt(2.0 * decel * (30.0 - END_GAP)))


def test_a_limit_lowered_far_ahead_takes_nothing_from_the_braking_for_a_stop() -> None:
    """The ego comes to a stop in the lane beside too fast for gentle braking, and at the same
    moment a limit falls that it is too fast for, too."""
    road, stop = lanes_east(2, speed=15.0), Stop(1, 149.8, 150.0)
    ego = ego_at(road, "a_0", 100.0, 14.0, route=edges(road, "a"))._replace(stop=stop)
    changes = RoadChanges(
        *(np.array(x) for x in ([0], [13.0])), road.classes[:1], road.change_left[:1],
        road.change_right[:1],
    )  # fmt: skip

    def kept(changes: RoadChanges) -> RouteMap:
        keeper = RouteKeeper(scenario(), road, PHYSICS, False)
        keeper.keep(scene_of(ego, road)._replace(changes=changes))
        assert keeper.route is not None
        return keeper.route

    alone, both = kept(RoadChanges()), kept(changes)
    before_the_end = slice(int(alone.row[0]) + 125, int(alone.row[0]) + 148)
    assert both.cap[before_the_end] == pytest.approx(alone.cap[before_the_end])
