"""What passing people at the edge of the lane costs."""

import math

import pytest
from helpers import Agent, ego_at
from helpers_model import PHYSICS, compiled, lanes_east, scenario, scene_of
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts.driver.driver import Driver
from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.model.passing import AMPLE, PACE, passing_cost
from sumo_mcts.numerics.geometry import Box
from sumo_mcts.scene import Plan

passing_cost = compiled(passing_cost)
COST = CostParams(claim=16.0)
EGO = Box(0.0, 0.0, 1.0, 0.0, 2.5, 0.9)


def price(v: float, room: float, ahead: float = 0.0, degrees: float = 0.0) -> float:
    """The ego passes at v (m/s) a person whose margin leaves it `room`, m."""
    heading = math.radians(degrees)
    other = Box(ahead, 0.9 + 0.3 + room, math.cos(heading), math.sin(heading), 0.5, 0.3)
    return float(passing_cost(COST, v, EGO, other))


@given(st.floats(0.0, 40.0), st.floats(0.0, 1.0), st.floats(0.0, 0.3), st.floats(0.0, 5.0))
def test_it_grows_with_speed_and_falls_with_the_room(
    v: float, room: float, more: float, faster: float
) -> None:
    assert 0.0 <= price(v, room + more) <= price(v, room) <= price(v + faster, room) <= COST.claim


def test_slowly_and_with_ample_room_it_costs_nothing() -> None:
    assert price(PACE, 0.0) == 0.0 and price(30.0, AMPLE) == 0.0
    assert price(2.0 * PACE, 0.0) == COST.claim


@pytest.mark.parametrize(("ahead", "degrees"), [(3.1, 0.0), (-3.1, 0.0), (0.0, 90.0)])
def test_nobody_else_is_passed(ahead: float, degrees: float) -> None:
    """Who is still ahead, who is behind, and who walks across."""
    assert price(15.0, 0.05, ahead, degrees) == 0.0


def planned(left: float, degrees: float) -> Plan:
    """What the ego plans at 10 m/s behind a person 40 m ahead."""
    road = lanes_east(1, speed=13.9)
    heading = math.radians(degrees)
    who = Agent("p", "", v=1.2, length=0.3, width=0.5, x=145.0, y=left, heading=heading)
    scene = scene_of(ego_at(road, "a_0", 100.0, 10.0), road, who)
    plan = Driver(scenario("planner.iterations=400"), road, PHYSICS, 0).decide(scene).decision.plan
    assert plan is not None
    return plan


@pytest.mark.parametrize("degrees", [0.0, 180.0])
@pytest.mark.parametrize("left", [-1.28, 1.28])
def test_the_ego_passes_who_walks_at_the_edge_slowly(left: float, degrees: float) -> None:
    """0.13 m are between them. The whole margin would keep the ego behind for ever."""
    plan = planned(left, degrees)
    beside = abs(plan.pose[:, 0] - (145.0 + 1.2 * math.cos(math.radians(degrees)) * plan.time)) < 2
    assert plan.pose[-1, 0] > 160.0 and beside.any()
    assert 3.0 < plan.v[beside].max() < 11.0  # without a price 13.9


def test_but_not_who_walks_in_its_way() -> None:
    plan = planned(-0.6, 0.0)
    assert (plan.pose[:, 0] + 2.5 < 145.0 + 1.2 * plan.time).all()
