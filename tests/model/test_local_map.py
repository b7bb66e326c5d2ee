"""The search's view of a cycle: how much of the route it shows."""

import numpy as np
import pytest
from helpers import Agent, Lane, build, edges, ego_at
from helpers_model import PHYSICS, scenario, scene_of, task_of
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts.driver.driver import Driver
from sumo_mcts.model.local_build import BACK, VIEW, window
from sumo_mcts.road import RoadMap

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
