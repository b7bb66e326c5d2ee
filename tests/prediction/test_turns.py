"""Whose turn it is at an all-way stop: everybody comes to the same answer."""

import itertools
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers import Agent, crossing, ego_at
from helpers_model import scene_of, task_of, traffic_params

from sumo_mcts.arrays import Floats
from sumo_mcts.driver.forecaster import ego_lanes
from sumo_mcts.model.local_map import ego_state
from sumo_mcts.prediction.forecast import Question, predict
from sumo_mcts.prediction.turns import in_order
from sumo_mcts.road import ALLWAY, RoadMap
from sumo_mcts.scene import SETS_OFF, Forecast
from sumo_mcts.world.agents import AgentReader

# the directions from which they come, and their lanes as the map counts them
SOUTH, EAST, NORTH, WEST = (-math.pi / 2, 4), (0.0, 6), (math.pi / 2, 2), (math.pi, 8)


@pytest.mark.parametrize(
    "order",
    [
        [EAST, SOUTH],  # from the south the one from the east is on the right
        [NORTH, EAST],
        [WEST, NORTH],
        [SOUTH, WEST],
        [NORTH, EAST, SOUTH],
        [WEST, NORTH, EAST],
        [NORTH, SOUTH],  # neither is on the other's right: the map has its lane first
        [NORTH, EAST, SOUTH, WEST],  # each has one on the right
    ],
)
def test_the_one_from_the_right_goes_first_whoever_asks(order: list[tuple[float, int]]) -> None:
    for seen in itertools.permutations(order):
        assert [seen[k] for k in in_order(seen, lefthand=False)] == order


def test_where_traffic_drives_on_the_left_the_one_from_the_left_goes_first() -> None:
    assert in_order([EAST, SOUTH], lefthand=True) == [1, 0]
    assert in_order([SOUTH, NORTH, WEST], lefthand=True) == [1, 2, 0]


@pytest.mark.parametrize("turned", [0.01, 0.7, 3.0])
def test_nothing_depends_on_where_north_is(turned: float) -> None:
    arms = [(math.remainder(angle + turned, math.tau), lane) for angle, lane in (EAST, NORTH)]
    assert in_order(arms, lefthand=False) == [1, 0]


def test_a_stand_is_remembered_for_a_few_metres() -> None:
    unasked: Any = SimpleNamespace(vehicle=None, person=None)

    def standing_s(*speeds: float) -> list[float]:
        reader, steps = AgentReader(unasked, unasked, unasked), enumerate(speeds, start=1)
        return [round(reader.standing_s("a", v, 0.5 * step), 3) for step, v in steps]

    assert standing_s(2.0, 0.0, 0.0, 0.0) == [0.0, 0.0, 0.5, 1.0]
    rolls = 0.9 * SETS_OFF
    assert standing_s(0.0, 0.0, rolls, rolls, rolls) == [0.0, 0.5, -1.0, -1.5, 0.0]
    assert standing_s(0.0, 0.0, 1.0, 0.0, 0.0) == [0.0, 0.5, -1.0, 0.0, 0.5]


def all_way_stop() -> RoadMap:
    """Straight on from the west and from the south, with a stop sign on every arm."""
    road = crossing(bridge=False)
    inside = np.array([road.lane_ids.index(name) for name in (":we_0", ":sn_0", ":wn_0")])
    rule = road.rule.copy()
    rule[inside] = ALLWAY
    found: RoadMap = road._replace(rule=rule, conflict_yields=np.ones_like(road.conflict_yields))
    return found


def seen_from_the_west(
    stood_s: float, standing_s: float, v: float = 0.0, own_v: float = 0.0
) -> Forecast:
    """What an ego from the west expects of an agent from the south; it has stood for `stood_s`, or
    came to a stand so long ago, and stands for 2 s more unless it moves."""
    road = all_way_stop()
    ego = ego_at(road, "wi_0", 88.0, own_v, route=(0, 2))
    scene = scene_of(ego, road, Agent("s", "si_0", 88.0, v))
    scene = scene._replace(agents=scene.agents._replace(standing_s=np.array([standing_s])))
    task = task_of(road, ego)
    state = ego_state(task.route, ego)
    assert state is not None
    nominal: Floats = own_v + (0.4 if own_v else 0.0) * np.arange(10.0)
    lanes = ego_lanes(task.route, state)
    question = Question(scene, lanes, nominal, traffic_params(), 8.0, stood_s)
    return predict(road, question)


@pytest.mark.parametrize(("v", "sign"), [(0.0, 1.0), (0.8, -1.0)])
@pytest.mark.parametrize("own_v", [0.0, 0.8])
def test_who_stood_first_has_its_turn_also_while_it_sets_off(
    own_v: float, v: float, sign: float
) -> None:
    """A tenth of a second makes the difference. The one from the south is on the right."""
    for other_s, waits in ((0.4, True), (0.5, False), (0.6, False)):
        forecast = seen_from_the_west(0.5, sign * other_s, v, own_v)
        assert forecast.yields[0].tolist() == [waits], other_s


def test_an_agent_that_waits_for_its_turn_is_not_taken_to_stay() -> None:
    """It has stood for long, for the ego's sake: it drives when the ego is through."""
    waits = seen_from_the_west(6.0, 5.0, own_v=2.0)
    assert waits.v[0, -1, 0] > 3.0
    stays = seen_from_the_west(6.0, 7.0, own_v=2.0)  # it is its turn, and it does not go
    assert stays.v[0].max() == 0.0
