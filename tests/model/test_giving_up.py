"""A lane change where SUMO divides lanes: drivers beside see it late, and it can be given up."""

import math

import pytest
from helpers import Agent, ego_at
from helpers_model import PHYSICS, compiled, lanes_east, local_of, scenario, scene_of, task_of

from sumo_mcts.driver.params import ego_params
from sumo_mcts.model import gaps, motion
from sumo_mcts.model.local_map import LocalMap, State
from sumo_mcts.model.motion import OVERSHOOT
from sumo_mcts.planners import ply
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Sideways

ROAD: RoadMap = lanes_east(3)
can_change, begin_change, is_seen = (
    compiled(f) for f in (motion.can_change, motion.begin_change, gaps.is_seen)
)


def changing(progress: float, divided: bool = True) -> tuple[LocalMap, State]:
    """An ego in the middle lane that changes to the left, and an agent behind in that lane."""
    ego = ego_at(ROAD, "a_1", 100.0, 10.0)
    if divided:
        ego = ego._replace(sideways=Sideways(1.0, 0.6))
    ego = ego._replace(changing=progress, change_from=1, change_to=2)
    local, state = local_of(task_of(ROAD, ego), scene_of(ego, ROAD, Agent("x", "a_2", 80.0, 12.0)))
    assert (state.node, state.other, state.progress) == (1, 2, progress)
    return local, state


@pytest.mark.parametrize(("progress", "seen"), [(0.1, False), (0.35, False), (0.48, True)])
def test_a_driver_in_the_other_lane_sees_who_reaches_over(progress: float, seen: bool) -> None:
    """Both are 1.8 m wide, and the lanes 3.2 m: it would touch the ego from 44 % on."""
    local, state = changing(progress)
    assert is_seen(local, state, 2, 80.0) == seen
    assert is_seen(local, state, 1, 80.0)  # in the ego's own lane it always does
    assert (local.followers != 0) == seen
    back = state._replace(progress=1.0 - progress)  # given up where it is
    assert is_seen(local, back, 2, 80.0) == seen
    local, state = changing(progress, divided=False)
    assert is_seen(local, state, 2, 80.0) and local.followers != 0


@pytest.mark.parametrize(
    ("progress", "divided", "possible"),
    [(0.1, True, True), (0.3, True, True), (0.4, True, False), (0.1, False, False)],
)
def test_a_change_is_given_up_by_one_to_the_other_side(
    progress: float, divided: bool, possible: bool
) -> None:
    local, state = changing(progress, divided)
    p = task_of(ROAD, ego_at(ROAD, "a_1", 100.0, 10.0)).ego
    assert can_change(local, p, state, -1) == possible
    assert not can_change(local, p, state, 1)


def test_what_is_given_up_goes_a_little_further_and_then_back() -> None:
    local, state = changing(0.2)
    ego = ego_at(ROAD, "a_1", 100.0, 10.0)._replace(sideways=Sideways(1.0, 0.6))
    p = task_of(ROAD, ego).ego
    back = begin_change(local, p, state, -1)
    assert (back.node, back.other) == (1, 2)
    assert back.progress == pytest.approx(1.0 - 0.2 - OVERSHOOT)
    assert compiled(motion.towards_other)(back) == pytest.approx(0.2 + OVERSHOOT)


def test_giving_up_costs_as_much_as_a_third_of_a_contact() -> None:
    _, state = changing(0.2)
    c = task_of(ROAD, ego_at(ROAD, "a_1", 100.0, 10.0)).cost
    price = compiled(ply.change_price)
    assert price(c, state) == pytest.approx(20.0)
    assert price(c, state._replace(progress=0.0)) == pytest.approx(0.6)


@pytest.mark.parametrize(("speed", "seconds"), [(1.0, 4.2), (0.5, 6.9), (2.0, 3.58), (0.0, 3.0)])
def test_a_lane_change_takes_as_long_as_going_aside_does(speed: float, seconds: float) -> None:
    """SUMO (1.28) needs 4.1, 6.8 and 3.5 s for 3.2 m; 0: lanes are not divided."""
    ego = ego_at(ROAD, "a_1", 100.0, 10.0)._replace(sideways=Sideways(speed))
    found = ego_params(scenario(), ego, PHYSICS).change_duration
    assert found == pytest.approx(seconds, abs=0.01) and math.isfinite(found)
