"""What coming near an agent that moves sideways costs."""

import math
from itertools import pairwise

import numpy as np
import pytest
from helpers import Agent, ego_at
from helpers_model import (
    PHYSICS,
    compiled,
    lanes_east,
    local_of,
    plain,
    scenario,
    scene_of,
    task_of,
)
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts.driver.driver import Driver
from sumo_mcts.driver.params import cost_params
from sumo_mcts.model import nearing
from sumo_mcts.model.local_map import EAST, NORTH, SIDEWAYS_UNTIL, SOUTH, WEST, LocalMap
from sumo_mcts.model.nearing import MARGIN
from sumo_mcts.numerics.geometry import COS, SIN, Box, X, Y, box_distance
from sumo_mcts.scene import Forecast, Plan, Scene

likely_contact = compiled(nearing.likely_contact)
nearing_cost = plain(nearing.nearing_cost)
COST = cost_params(scenario())
ROAD = lanes_east(2, 900.0)


@given(st.floats(0.0, 3.0), st.floats(0.0, 1.0))
def test_a_contact_is_the_likelier_the_less_room(room: float, more: float) -> None:
    assert 0.0 <= likely_contact(room + more) <= likely_contact(room) <= 0.5


def test_it_is_never_likelier_than_not() -> None:
    assert likely_contact(0.0) == 0.5 and likely_contact(MARGIN) == 0.0


def scene_with(
    d: float, blinker: int = 0, v: float = 2.0, own: float = 7.0, gap: float = 2.0
) -> Scene:
    """The ego on the right lane, and ahead of it one `d` m off the middle of the left one."""
    ego = ego_at(ROAD, "a_0", 100.0, own)
    agent = Agent("x", "a_1", 100.0 + gap + 5.0, v, d)
    scene = scene_of(ego, ROAD, agent)
    return scene._replace(agents=scene.agents._replace(blinker=np.array([blinker])))


def local(scene: Scene) -> LocalMap:
    return local_of(task_of(ROAD, scene.ego), scene)[0]


@pytest.mark.parametrize(
    ("d", "blinker", "seconds"),
    [
        (0.0, 0, -0.2),  # it keeps to its lane
        (0.0, -1, -0.2),  # it has not begun
        (0.1, 0, -0.2),
        (-1.2, -1, (3.2 - 1.2) / 1.2 + 1.0),  # to the middle of the next lane, and straight there
        (0.6, 0, 0.6 / 1.2 + 1.0),
    ],
)
def test_who_moves_sideways_and_until_when(d: float, blinker: int, seconds: float) -> None:
    until = local(scene_with(d, blinker)).trait[0, SIDEWAYS_UNTIL]
    assert until == math.floor(seconds / 0.2 + 1e-9)


def test_bounds_are_wider_about_agents_that_move_sideways_while_they_do() -> None:
    """Else two narrow vehicles would not be looked at that are less than MARGIN apart."""
    bounds = np.arange(3 * 2 * 4.0).reshape(1, 3, 2, 4)
    wider = nearing.widened(bounds, np.array([[1, -1]], np.int32)) - bounds
    by = dict(zip((WEST, SOUTH, EAST, NORTH), (-MARGIN, -MARGIN, MARGIN, MARGIN), strict=True))
    for side, margin in by.items():
        assert wider[0, :, 0, side].tolist() == [margin, margin, 0.0]
    assert not wider[0, :, 1].any()
    keeps, drifts = (local(scene_with(d)).bounds[1, 0] for d in (0.1, 0.6))
    assert drifts[WEST] == pytest.approx(keeps[WEST] - MARGIN, abs=0.3)
    assert drifts[EAST] == pytest.approx(keeps[EAST] + MARGIN, abs=0.3)


def test_who_stands_astride_is_passed_as_any_other() -> None:
    """Else the ego would wait beside it, in each cycle for two seconds more."""
    assert local(scene_with(-1.2, -1, v=0.0)).trait[0, SIDEWAYS_UNTIL] == -1


def cost_of(rooms: list[float], own: float = 5.0) -> float:
    """Of an ego whose room to an agent that stands ahead becomes `rooms`, m, one after the other:
    each is what its motion leaves."""
    here, total = local(scene_with(-1.2, -1, v=0.0)), 0.0
    _, state = local_of(task_of(ROAD, (scene := scene_with(-1.2, -1)).ego), scene)
    here.agent[:, 0, [X, Y, COS, SIN]] = 0.0, 0.0, 1.0, 0.0
    other = Box(0.0, 0.0, 1.0, 0.0, 2.5, 0.9)
    for before, room in pairwise(rooms):
        moving = state._replace(v=(before - room) / here.dt)
        box = Box(-5.0 - room, 0.0, 1.0, 0.0, 2.5, 0.9)
        total += nearing_cost(here, COST, moving, box, other, 1, 0) * here.dt
    return total


def test_the_way_nearer_counts_once_however_slowly() -> None:
    bare = COST.contact
    fast, slow = cost_of([1.5, 0.1]), cost_of([1.5, *np.linspace(0.98, 0.1, 9)])
    assert slow == pytest.approx(bare * likely_contact(0.1), rel=0.05)
    assert slow < fast < 1.2 * slow  # the faster, the worse the contact


def test_who_stays_as_near_or_falls_back_pays_nothing() -> None:
    assert cost_of([0.2, 0.2, 0.2]) == 0.0 == cost_of([0.2, 0.5, 0.9])


def decided(scene: Scene) -> tuple[Plan, Forecast]:
    answer = Driver(scenario("planner.iterations=600"), ROAD, PHYSICS, 0).decide(scene)
    assert answer.decision.plan is not None
    return answer.decision.plan, answer.forecast


def least_room(plan: Plan, forecast: Forecast) -> float:
    """m between the plan and the agent in the next 3 s, as the forecast has it."""
    boxes = []
    for k in range(1, 16):
        at = int(np.argmin(np.abs(plan.time - k * forecast.dt)))
        boxes.append((Box(*plan.pose[at], 2.5, 0.9), Box(*forecast.pose[0, k, 0], 2.5, 0.9)))
    return min(box_distance(own, other) for own, other in boxes)


@pytest.mark.parametrize(("own", "gap"), [(5.0, 5.0), (7.5, 8.0), (10.0, 8.0)])
def test_the_ego_passes_who_leaves_its_lane_with_room(own: float, gap: float) -> None:
    """Without the price 0.5, 0.5 and 0.4 m are left."""
    ego = ego_at(ROAD, "a_1", 100.0, own)
    scene = scene_of(ego, ROAD, Agent("x", "a_0", 105.0 + gap, 3.6, 1.5))
    blinks = {"blinker": np.array([-1]), "heading": np.array([-0.2])}
    plan, forecast = decided(scene._replace(agents=scene.agents._replace(**blinks)))
    assert least_room(plan, forecast) > 0.75
    assert plan.v[-1] > own  # it does not wait for ever


def test_the_ego_brakes_for_who_moves_over_before_it_with_room_to_spare() -> None:
    """If the other one does not speed up as expected, 0.7 m would be left without the price."""
    scene = scene_with(-1.2, -1, own=10.0, gap=8.0)
    plan, _ = decided(scene)
    soon = plan.time <= 1.5
    rear = scene.agents.x[0] - 2.5 + scene.agents.v[0] * plan.time[soon]
    assert (rear - plan.pose[soon, 0] - 2.5).min() > 1.0
