"""The room that forecasts leave around the others."""

import math

import numpy as np
import pytest
from helpers import Agent, ego_at
from helpers_model import PHYSICS, forecast_of, lanes_east, scenario, scene_of, task_of

from sumo_mcts.driver.driver import Driver
from sumo_mcts.prediction.margins import inflate
from sumo_mcts.scene import Forecast, Scene

ROAD = lanes_east(1)
ALL = np.inf  # the room of who does not walk along the ego's lane
FRONT = 300.0  # m, of the ego


def seen(*agents: Agent, v: float = 0.0) -> tuple[Scene, Forecast]:
    ego = ego_at(ROAD, "a_0", FRONT, v)
    scene = scene_of(ego, ROAD, *agents)
    return scene, forecast_of(task_of(ROAD, ego), scene)


def walker(ahead: float, left: float, v: float = 1.0, heading: float = 0.0) -> Agent:
    return Agent(
        f"walker{ahead}", "", v=v, length=0.4, width=0.6, x=FRONT + ahead, y=left, heading=heading
    )


def test_errors_lengthen_boxes_by_half_of_what_is_between_at_most() -> None:
    """Else the ego would be in contact with whom it stands beside."""
    scene, forecast = seen(
        *(
            Agent(name, "a_0", FRONT + gap + 5.0)
            for name, gap in (("ahead", 20.0), ("close", 0.5), ("inside", -1.0))
        )
    )
    found = inflate(forecast, scene, 0.6, 0.4, np.full(3, ALL))
    assert found.half_length - forecast.half_length == pytest.approx([0.6, 0.25, 0.0])
    assert (found.half_width == forecast.half_width).all()
    rear, front = found.s - 2.0 * found.half_length, found.s
    assert (forecast.s - 2.0 * forecast.half_length - rear)[0, 0] == pytest.approx(
        [0.6, 0.25, 0.0]
    ), "along the lane as in the plane"
    assert (front - forecast.s)[0, 0] == pytest.approx([0.6, 0.25, 0.0])


@pytest.mark.parametrize(
    ("error", "along", "aside"), [(0.0, [0.4, 0.3], [0.4, 0.3]), (0.6, [1.0, 0.3], [0.4, 0.3])]
)
def test_who_is_on_foot_has_room_on_every_side(
    error: float, along: list[float], aside: list[float]
) -> None:
    scene, forecast = seen(walker(20.0, 3.0), walker(0.8, 0.0))  # the latter 0.6 m before the ego
    found = inflate(forecast, scene, error, 0.4, np.full(2, ALL))
    order = np.argsort(scene.agents.x)[::-1]
    assert (found.half_length - forecast.half_length)[order] == pytest.approx(along)
    assert (found.half_width - forecast.half_width)[order] == pytest.approx(aside)


def test_vehicles_seen_without_error_have_none() -> None:
    scene, forecast = seen(Agent("car", "a_0", FRONT + 20.0))
    assert inflate(forecast, scene, 0.0, 0.4, np.full(1, ALL)) is forecast


@pytest.mark.parametrize(("room", "aside"), [(0.2, 0.1), (0.7, 0.35), (0.9, 0.4), (ALL, 0.4)])
def test_who_walks_along_the_lane_leaves_half_of_the_room_to_the_ego(
    room: float, aside: float
) -> None:
    scene, forecast = seen(walker(20.0, 3.0))
    found = inflate(forecast, scene, 0.0, 0.4, np.array([room]))
    assert found.half_width - forecast.half_width == pytest.approx([aside])
    assert found.half_length - forecast.half_length == pytest.approx([0.4])


def test_the_planner_is_given_it() -> None:
    scene, _ = seen(walker(20.0, 3.0))
    thought = Driver(scenario("planner.iterations=20"), ROAD, PHYSICS, 0).decide(scene)
    assert thought.forecast is not None and thought.forecast.half_width.tolist() == pytest.approx(
        [0.3 + 0.4]
    )
    without = Driver(
        scenario("planner.iterations=20", "prediction.room_on_foot_m=0"), ROAD, PHYSICS, 0
    ).decide(scene)
    assert without.forecast is not None and without.forecast.half_width.tolist() == pytest.approx(
        [0.3]
    )


@pytest.mark.parametrize(
    ("ahead", "left", "degrees"), [(4.0, -1.0, 180.0), (3.4, -2.5, 138.0), (2.6, -1.8, 138.0)]
)
def test_an_ego_that_stands_does_not_set_off_towards_who_comes_on_foot(
    ahead: float, left: float, degrees: float
) -> None:
    """Whatever it does, the forecast has who walks come straight through it, and driving only
    changes when."""
    scene, _ = seen(walker(ahead, left, 1.2, math.radians(degrees)))
    plan = Driver(scenario("planner.iterations=300"), ROAD, PHYSICS, 0).decide(scene).decision.plan
    assert plan is not None and plan.v[: round(2.0 / PHYSICS.step)].max() == 0.0
