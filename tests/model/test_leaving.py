"""What a lane that the route leaves still costs."""

import math

import numpy as np
import pytest
from helpers import Agent, Lane, build, edges, ego_at
from helpers_model import compiled, local_of, scenario, scene_of, task_of
from hypothesis import given, settings
from hypothesis import strategies as st

from sumo_mcts.model.cost import step_passability, terminal
from sumo_mcts.model.leaving import VIEW_AHEAD, VIEW_BACK
from sumo_mcts.model.local_map import DENSITY, STREAM, LocalMap, State
from sumo_mcts.planners.base import Task
from sumo_mcts.planners.reference import VERSIONS, cost_of
from sumo_mcts.road import RoadMap

step_passability, terminal = map(compiled, (step_passability, terminal))

Car = tuple[float, float]  # m from the beginning of the acceleration lane, m/s


def road_of(mirrored: bool) -> RoadMap:
    """A ramp leads to a lane of a that ends, beside one that main leads to; both to the right, or
    all of it mirrored."""
    up, own, other = (-1.0, "a_1", "a_0") if mirrored else (1.0, "a_0", "a_1")
    lanes = {
        own: Lane("a", int(own[-1]), ((0.0, 0.0), (150.0, 0.0)), speed=30.0),
        other: Lane("a", int(other[-1]), ((0.0, 3.2 * up), (150.0, 3.2 * up)), ("b_0",), 30.0),
    }
    return build(
        [
            Lane("ramp", 0, ((-100.0, -60.0 * up), (0.0, 0.0)), (own,)),
            Lane("main", 0, ((-300.0, 3.2 * up), (0.0, 3.2 * up)), (other,), 30.0),
            lanes["a_0"],
            lanes["a_1"],
            Lane("b", 0, ((150.0, 3.2 * up), (600.0, 3.2 * up)), speed=30.0),
        ]
    )


def merging(
    s: float, v: float, cars: list[Car], *sets: str, mirrored: bool = False
) -> tuple[Task, LocalMap, State]:
    """The ego on the lane that ends, and cars of the lane beside."""
    road = road_of(mirrored)
    own, other = ("a_1", "a_0") if mirrored else ("a_0", "a_1")
    ego = ego_at(road, own, s, v, route=edges(road, "a", "b"))
    agents = [
        Agent(f"x{k}", other, at, speed) if at >= 0.0 else Agent(f"x{k}", "main_0", 300 + at, speed)
        for k, (at, speed) in enumerate(cars)
    ]
    task = task_of(road, ego, scenario(*sets))
    return task, *local_of(task, scene_of(ego, road, *agents))


def row_of(local: LocalMap, state: State) -> list[float]:
    return [float(x) for x in local.to_leave[state.node - local.first]]


DENSE: list[Car] = [(at, 25.0) for at in np.arange(-180.0, 150.0, 40.0)]
places = st.lists(
    st.tuples(st.floats(-290.0, 149.0), st.floats(1.0, 30.0)), max_size=8, unique_by=lambda c: c[0]
)


@settings(deadline=None, max_examples=30)
@given(st.floats(5.0, 140.0), places)
def test_the_stream_beside_is_that_of_those_who_are_there_or_come(
    s: float, cars: list[Car]
) -> None:
    _, local, state = merging(s, 10.0, cars)
    low, high = s - VIEW_BACK, min(s + VIEW_AHEAD, 150.0)
    seen = [v for at, v in cars if low <= at < high]
    row = row_of(local, state)
    assert row[DENSITY] == pytest.approx(len(seen) / (high - low))
    assert row[STREAM] == pytest.approx(sum(seen) / len(seen) if seen else 30.0)


@settings(deadline=None, max_examples=30)
@given(st.floats(5.0, 140.0), st.floats(0.0, 28.0), places)
def test_the_price_is_the_same_in_a_mirror(s: float, v: float, cars: list[Car]) -> None:
    found = []
    for mirrored in (False, True):
        task, local, state = merging(s, v, cars, mirrored=mirrored)
        found.append([
            *row_of(local, state),
            terminal(local, task.cost, state, math.inf, 0.0, 8.0),
            step_passability(local, task.ego, task.cost, state),
        ])  # fmt: skip
    assert found[0] == pytest.approx(found[1])


@settings(deadline=None, max_examples=30)
@given(st.floats(5.0, 140.0), st.floats(0.0, 28.0), st.floats(0.1, 20.0), places)
def test_standing_gains_nothing(s: float, v: float, seconds: float, cars: list[Car]) -> None:
    """A state is worth no more later, no motion costs more than standing in the lane, and to stand
    costs at least its time."""
    task, local, state = merging(s, v, cars)
    now, then = (terminal(local, task.cost, state, math.inf, 0.0, t) for t in (8.0, 8.0 + seconds))
    assert then >= now - 1e-9
    moves, stands = (
        step_passability(local, task.ego, task.cost, state._replace(v=at)) / task.ego.step
        for at in (v, 0.0)
    )
    assert stands >= max(moves, task.cost.progress) - 1e-9


def test_in_the_lane_that_ends_it_is_dearer_to_be_slower_than_the_next_one() -> None:
    """Also than the time that this loses: nobody can make room for a slow ego."""
    task, local, state = merging(60.0, 10.0, DENSE)
    p, c = task.ego, task.cost
    rates = [
        step_passability(local, p, c, state._replace(v=v)) / p.step + c.progress * v / local.limit
        for v in (0.0, 10.0, 20.0, 25.0, 28.0)
    ]
    assert rates[0] > rates[1] > rates[2] > rates[3]
    assert rates[3] == pytest.approx(rates[4])
    task, local, state = merging(60.0, 10.0, [])  # nobody is there who would have to make room
    free = [step_passability(local, p, c, state._replace(v=v)) / p.step for v in (0.0, 25.0)]
    assert free[0] - free[1] == pytest.approx(c.progress * 25.0 / local.limit)


@pytest.mark.parametrize("version", VERSIONS)
def test_the_reference_problem_has_no_such_price(version: str) -> None:
    task, local, state = merging(60.0, 10.0, DENSE)
    c = cost_of(version)
    rates = [
        step_passability(local, task.ego, c, state._replace(v=v)) / task.ego.step
        + c.progress * v / local.limit
        for v in (0.0, 28.0)
    ]
    assert rates[0] == pytest.approx(rates[1])
