"""An agent that stands behind somebody, or before a red light, has a reason to; when the reason is
gone it is expected to start."""

import numpy as np
import pytest
from helpers import Agent, crossing, ego_at, lights
from helpers_model import PHYSICS, scenario, scene_of

from sumo_mcts.driver.driver import Driver
from sumo_mcts.driver.reasons import Reasons, has_reason
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import AFTER_STOP, GREEN, RED, Scene, Signals

PATIENCE_S = 2.0
FIRST, SECOND = Agent("first", "si_0", 88.0, 0.0), Agent("second", "si_0", 80.0, 0.0)


def seen(
    *agents: Agent, time: float = 0.0, shows: Signals | None = None, road: RoadMap | None = None
) -> Scene:
    """These agents, which have stood for a minute unless they move, and the ego far from them."""
    road = road or crossing(bridge=False)
    scene = scene_of(ego_at(road, "wi_0", 20.0, 0.0, route=(0, 2)), road, *agents, signals=shows)
    stood = np.where(scene.agents.v == 0.0, 60.0, 0.0)
    return scene._replace(time=time, agents=scene.agents._replace(standing_s=stood))


@pytest.mark.parametrize(
    ("gap", "aside", "expected"),
    [(0.5, 0.0, True), (3.9, 0.0, True), (4.1, 0.0, False), (2.0, 1.7, True), (2.0, 1.9, False)],
)
def test_a_vehicle_close_ahead_is_a_reason(gap: float, aside: float, expected: bool) -> None:
    """Both are 5 m long and 1.8 m wide."""
    scene = seen(
        Agent("behind", "si_0", 40.0, 0.0), Agent("leader", "si_0", 45.0 + gap, 3.0, d=aside)
    )
    assert has_reason(crossing(bridge=False), scene).tolist() == [expected, False]


def test_the_ego_is_a_reason_too_and_one_that_drives_needs_none() -> None:
    road = crossing(bridge=False)
    ego = ego_at(road, "wi_0", 50.0, 0.0, route=(0, 2))
    scene = scene_of(ego, road, Agent("a", "wi_0", 43.0, 0.0), Agent("b", "wi_0", 36.0, 2.0))
    assert has_reason(road, scene).tolist() == [True, False]


@pytest.mark.parametrize(("ahead", "aside", "expected"), [(2.0, 4.0, True), (9.0, 0.0, False)])
def test_a_lorry_across_the_lane_is_as_wide_as_it_is_long(
    ahead: float, aside: float, expected: bool
) -> None:
    """16 m long and 2 m wide, its middle so far from the bumper and from the lane."""
    road = crossing(bridge=False)
    scene = seen(Agent("a", "si_0", 40.0, 0.0), Agent("lorry", "", x=0.0, y=0.0))
    agents = scene.agents
    x, y = agents.x[0] + aside, agents.y[0] + 2.5 + ahead
    lorry = agents._replace(
        x=np.array([agents.x[0], x]), y=np.array([agents.y[0], y]),
        heading=np.array([agents.heading[0], 0.0]), length=np.array([5.0, 16.0]),
        width=np.array([1.8, 2.0]), person=np.array([False, False]),
    )  # fmt: skip
    assert has_reason(road, scene._replace(agents=lorry))[0] == expected


def test_a_vehicle_on_a_bridge_is_no_reason() -> None:
    """The bridge leads northward over eo at x = 50."""
    road = crossing()
    above = Agent("above", "br_0", 100.9, 8.0)  # its middle 0.2 m beside the axis of eo
    under = Agent("under", "eo_0", 35.0, 0.0)  # its front at x = 45
    assert has_reason(road, seen(above, under, road=road)).tolist() == [False, False]
    beside = Agent("above", "eo_0", 42.0, 8.0)
    assert has_reason(road, seen(beside, under, road=road)).tolist() == [False, True]


@pytest.mark.parametrize(
    ("shows", "s", "expected"),
    [(RED, 85.0, True), (RED, 55.0, False), (GREEN, 85.0, False), (AFTER_STOP, 85.0, False)],
)
def test_a_red_light_is_a_reason_close_before_it(shows: int, s: float, expected: bool) -> None:
    road = crossing("tls", bridge=False)
    scene = seen(Agent("a", "si_0", s, 0.0), shows=lights(GREEN, shows, GREEN), road=road)
    assert has_reason(road, scene).tolist() == [expected]


def test_a_way_that_is_open_leaves_no_reason() -> None:
    """From wi it goes straight on and left; one of them is red."""
    road = crossing("tls", bridge=False)
    for left, expected in ((GREEN, False), (RED, True)):
        scene = seen(Agent("a", "wi_0", 88.0, 0.0), shows=lights(RED, GREEN, left), road=road)
        assert has_reason(road, scene).tolist() == [expected]


def test_a_reason_is_remembered_for_a_while_and_only_of_those_that_stand() -> None:
    road, reasons = crossing(bridge=False), Reasons()
    assert reasons.lately(road, seen(FIRST, SECOND), PATIENCE_S).tolist() == [False, True]
    for _ in range(2):  # asked twice at the same time it says the same
        found = reasons.lately(road, seen(SECOND, time=1.9), PATIENCE_S)
        assert found.tolist() == [True]
    assert reasons.lately(road, seen(SECOND, time=2.1), PATIENCE_S).tolist() == [False]
    reasons.lately(road, seen(FIRST, SECOND, time=3.0), PATIENCE_S)
    reasons.lately(road, seen(SECOND._replace(v=1.0), time=3.5), PATIENCE_S)
    assert reasons.lately(road, seen(SECOND, time=4.0), PATIENCE_S).tolist() == [False]


def speeds(driver: Driver, *scenes: Scene) -> float:
    """How fast the only agent of the last scene is expected to get."""
    found = [driver.decide(scene).forecast for scene in scenes][-1]
    assert found is not None
    return float(found.v[0].max())


def test_one_whose_leader_is_gone_is_expected_to_start() -> None:
    """As when SUMO takes out a vehicle that has stood for too long, or it changes lanes."""
    road = crossing(bridge=False)
    before, after = seen(FIRST, SECOND), seen(SECOND, time=0.5)
    assert speeds(Driver(scenario(), road, PHYSICS, 0), after) == 0.0
    assert speeds(Driver(scenario(), road, PHYSICS, 0), before, after) > 2.0


def test_one_whose_light_has_turned_green_is_expected_to_start() -> None:
    road = crossing("tls", bridge=False)
    red, green = (
        seen(FIRST, time=time, shows=lights(GREEN, shows, GREEN), road=road)
        for time, shows in ((0.0, RED), (0.5, GREEN))
    )
    assert speeds(Driver(scenario(), road, PHYSICS, 0), green) == 0.0
    assert speeds(Driver(scenario(), road, PHYSICS, 0), red, green) > 2.0


def test_the_memory_goes_with_the_record() -> None:
    """A decision that is taken again from a trace knows the reasons of the one before."""
    road = crossing(bridge=False)
    driver, again = (Driver(scenario(), road, PHYSICS, 0) for _ in range(2))
    before, after = seen(FIRST, SECOND), seen(SECOND, time=0.5)
    last = driver.decide(before).decision
    planned = driver.decide(after)
    assert planned.memory.held_up == ("second",) and planned.memory.held_up_at == (0.0,)
    again.recall(before.ego, before.changes, planned.memory, last, before.time)
    found = again.decide(after).forecast
    assert found is not None and planned.forecast is not None
    np.testing.assert_array_equal(found.v, planned.forecast.v)


def test_the_memory_outlasts_a_decision_off_the_route() -> None:
    road = crossing(bridge=False)
    driver, again = (Driver(scenario(), road, PHYSICS, 0) for _ in range(2))
    before, after = seen(FIRST, SECOND), seen(SECOND, time=1.0)
    driver.decide(before)
    off = seen(SECOND, time=0.5)
    last = driver.decide(off._replace(ego=off.ego._replace(route=()))).decision
    planned = driver.decide(after)
    again.recall(before.ego, before.changes, planned.memory, last, 0.5)
    found = again.decide(after).forecast
    assert found is not None and planned.forecast is not None
    np.testing.assert_array_equal(found.v, planned.forecast.v)
    assert found.v.max() > 2.0
