"""The search's view of a cycle: how much of the route it shows."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers import Agent, Lane, build, crossing, edges, ego_at
from helpers_model import (
    PHYSICS,
    ego_lanes,
    lanes_east,
    scenario,
    scene_of,
    task_of,
    traffic_params,
)
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts.arrays import Indices
from sumo_mcts.driver.driver import Driver
from sumo_mcts.model.local_build import BACK, VIEW, window
from sumo_mcts.model.local_map import KINDS, LocalMap, ego_state
from sumo_mcts.planners.base import Situation, local_of, locals_of
from sumo_mcts.prediction.forecast import Question
from sumo_mcts.prediction.hypotheses import OF_HYPOTHESES, predict_hypotheses
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Forecast, Scene

JUNCTION = 80.0  # m, of every lane inside a junction


def chain(*lengths: float) -> RoadMap:
    """Edges e0, e1, ... of so many metres, one lane each, with junctions between them."""
    lanes, x = [], 0.0
    for k, length in enumerate(lengths):
        onward = (f":j{k}_0",) if k + 1 < len(lengths) else ()
        lanes.append(Lane(f"e{k}", 0, ((x, 0.0), (x + length, 0.0)), onward))
        x += length
        if onward:
            lanes.append(
                Lane(
                    f":j{k}", 0, ((x, 0.0), (x + JUNCTION, 0.0)), (f"e{k + 1}_0",), junction=f"j{k}"
                )
            )
            x += JUNCTION
    return build(lanes)


@given(st.lists(st.floats(10.0, 1500.0), min_size=2, max_size=6), st.floats(0.0, 1.0))
def test_the_view_reaches_as_far_from_wherever_the_ego_is(
    lengths: list[float], share: float
) -> None:
    """On an edge or inside the junction behind it: those edges are there that begin or go on
    between BACK behind and VIEW ahead of it, and no others."""
    road = chain(*lengths)
    route = task_of(
        road, ego_at(road, "e0_0", 6.0, route=edges(road, *(f"e{k}" for k in range(len(lengths)))))
    ).route
    begins = np.cumsum([0.0, *(length + JUNCTION for length in lengths[:-1])])
    ends = np.append(begins[1:], begins[-1] + lengths[-1])
    here = share * ends[-1]
    first, last = window(route, here)
    seen = set(route.leg[first:last].tolist())
    inside, touched = (
        (ends > here - BACK) & (begins < here + VIEW),
        (ends >= here - BACK - 1e-6) & (begins <= here + VIEW + 1e-6),
    )
    assert set(np.flatnonzero(inside).tolist()) <= seen <= set(np.flatnonzero(touched).tolist())


def test_who_follows_through_a_junction_is_no_danger_however_long_the_road_before_it_was() -> None:
    plans = []
    for before in (100.0, 900.0):
        road = chain(before, 300.0)
        scene = scene_of(
            ego_at(road, ":j0_0", 60.0, 12.0, route=edges(road, "e0", "e1")),
            road,
            Agent("behind", ":j0_0", 45.0, 12.0),
        )
        plan = Driver(scenario(), road, PHYSICS, 0).decide(scene).decision.plan
        assert plan is not None and plan.v.min() > 11.9
        plans.append(plan.v.tolist())
    assert plans[0] == pytest.approx(plans[1])


def alone(forecast: Forecast, h: int) -> Forecast:
    """One hypothesis of a forecast as its only one."""
    columns: dict[str, Any] = {name: getattr(forecast, name)[h : h + 1] for name in OF_HYPOTHESES}
    return forecast._replace(weight=np.ones(1), intents=forecast.intents[h : h + 1], **columns)


def met(local: LocalMap) -> Indices:
    """[W, T, N] what LocalMap.level has of each agent at each time."""
    return np.where(local.place >= 0, local.level[:, local.place >> KINDS], -1)


def at_a_crossing() -> tuple[RoadMap, Scene]:
    """With some that may turn, brake, or not yield."""
    road = crossing(bridge=False)
    ego = ego_at(road, "wi_0", 40.0, 10.0, route=edges(road, "wi", "eo"))
    cars = Agent("turns", "wi_0", 80.0, 9.0), Agent("waits", "si_0", 60.0, 8.0)
    return road, scene_of(ego, road, Agent("behind", "wi_0", 20.0, 9.0), *cars)


def behind_a_van() -> tuple[RoadMap, Scene]:
    """It stands in the ego's lane, and may start."""
    road = lanes_east(2)
    scene = scene_of(
        ego_at(road, "a_0", 100.0, 10.0),
        road,
        Agent("beside", "a_1", 120.0, 8.0),
        Agent("van", "a_0", 125.0, 0.0),
    )
    return road, scene._replace(agents=scene.agents._replace(standing_s=np.array([0.0, 8.0])))


@pytest.mark.parametrize("made", [at_a_crossing, behind_a_van])
def test_hypotheses_built_together_are_as_each_built_alone(
    made: Callable[[], tuple[RoadMap, Scene]],
) -> None:
    road, scene = made()
    ego = scene.ego
    task = task_of(road, ego)
    state = ego_state(task.route, ego)
    assert state is not None
    lanes = np.array(ego_lanes(task.route, state), np.int32)
    question = Question(scene, lanes, np.zeros(0), traffic_params(), 10.0, hypotheses=6)
    forecast = predict_hypotheses(road, question)
    count = len(forecast.weight)
    assert count > 1
    together = locals_of(task, Situation(scene, state, forecast, frozenset()), count, reactive=2)
    for h, local in enumerate(together):
        single = local_of(
            task, Situation(scene, state, alone(forecast, h), frozenset()), reactive=2
        )
        for name in LocalMap._fields:
            if name not in ("level", "place"):
                assert np.array_equal(getattr(local, name), getattr(single, name)), (h, name)
        # which column of level a lane has depends on the other lanes
        near = (1 << KINDS) - 1
        assert np.array_equal(local.place & near, single.place & near)
        assert np.array_equal(met(local), met(single))
