"""How long the ego has waited for a gap, and what that makes cheaper."""

import math

import numpy as np
import pytest
from helpers import Agent, crossing, edges, ego_at, lights
from helpers_model import compiled, lanes_east, local_of, road_with_light, scene_of, task_of

from sumo_mcts.model.interaction import meet
from sumo_mcts.model.local_map import LocalMap, State
from sumo_mcts.model.motion import begin_change
from sumo_mcts.model.occupancy import yielding_cost
from sumo_mcts.model.reactions import undisturbed
from sumo_mcts.planners.base import Task
from sumo_mcts.planners.patience import patience, waited_s
from sumo_mcts.scene import GREEN, RED

meet, yielding_cost, begin_change = map(compiled, (meet, yielding_cost, begin_change))
NO_OTHERS = np.zeros((0, 2))


@pytest.mark.parametrize(
    ("s", "v", "shows", "gap", "after"),
    [
        (195.0, 0.0, GREEN, math.inf, 4.5),  # it waits at green, first at the line
        (195.0, 0.0, RED, math.inf, 4.0),  # the light is what it waits for
        (195.0, 0.0, GREEN, 3.0, 4.0),  # a leader is
        (100.0, 0.0, RED, math.inf, 4.5),  # the red light is far away
        (195.0, 3.0, GREEN, math.inf, 4.0),  # it rolls: neither more nor over
        (195.0, 6.0, GREEN, math.inf, 0.0),  # it drives
    ],
)
def test_what_counts_as_waiting(s: float, v: float, shows: int, gap: float, after: float) -> None:
    road = road_with_light()
    ego = ego_at(road, "a_0", s, v, route=edges(road, "a", "b"))
    task = task_of(road, ego)
    local, state = local_of(task, scene_of(ego, road, signals=lights(shows)))
    assert waited_s(4.0, local, task.route, state, gap, 0.5) == after


def test_what_others_can_brake_for_in_comfort_costs_less_and_less() -> None:
    assert patience(0.1, 0.0) == 1.0
    assert patience(0.1, 10.0) == 0.5
    assert patience(0.1, 90.0) == pytest.approx(0.1)
    assert patience(0.0, 90.0) == 1.0


def changing(behind: float, share: float) -> tuple[float, float]:
    """Price of a lane change in front of a follower at 8 m/s, once and per second."""
    road = lanes_east(3, 900.0)
    ego = ego_at(road, "a_1", 205.0, 4.0)
    task = task_of(road, ego)
    scene = scene_of(ego, road, Agent("x", "a_0", 200.0 - behind, 8.0))
    local, state = local_of(task, scene, patience=share)
    moved = begin_change(local, task.ego, state, -1)._replace(progress=0.1)
    met = meet(local, task.ego, task.cost, moved, NO_OTHERS, 0, 0)
    return met.once, met.rate


def test_a_place_before_a_follower_gets_cheaper_and_one_that_is_too_near_does_not() -> None:
    assert changing(9.7, 0.25)[0] == pytest.approx(0.25 * changing(9.7, 1.0)[0])
    assert changing(9.7, 0.25)[0] > 0.0
    assert changing(1.5, 0.25) == changing(1.5, 1.0)
    assert changing(1.5, 0.25)[1] > 0.0


def entering(away: float, share: float) -> tuple[Task, LocalMap, State]:
    """The ego crosses a road with priority, on which a car comes from so many metres away."""
    road = crossing(bridge=False)
    ego = ego_at(road, ":sn_0", 3.0, 4.0, route=edges(road, "si", "no"))
    task = task_of(road, ego)
    scene = scene_of(ego, road, Agent("x", "wi_0", 90.0 - away, 12.0))
    return task, *local_of(task, scene, patience=share)


@pytest.mark.parametrize(("away", "ratio"), [(18.0, 0.25), (4.0, 1.0)])
def test_the_right_of_way_of_those_that_can_stop_in_comfort_gets_cheaper(
    away: float, ratio: float
) -> None:
    prices = []
    for share in (1.0, 0.25):
        task, local, state = entering(away, share)
        prices.append(yielding_cost(local, task.ego, task.cost, state, undisturbed(local), 0))
    assert prices[1] == pytest.approx(ratio * prices[0])
    assert prices[0] > 0.0
