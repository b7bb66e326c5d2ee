"""No sequence costs less than the bound by which the search leaves sequences out."""

import itertools
import math
from typing import NamedTuple

import numpy as np
import pytest
from helpers import Agent, Lane, build, edges, ego_at
from helpers_model import WIDTH, compiled, local_of, scenario, scene_of, task_of
from hypothesis import given, settings
from hypothesis import strategies as st

from sumo_mcts.arrays import Floats
from sumo_mcts.driver.params import Physics, cost_params
from sumo_mcts.model import least_cost as bound
from sumo_mcts.model.local_map import SURE, LocalMap, State, node_at
from sumo_mcts.model.reactions import undisturbed
from sumo_mcts.planners.actions import FOLLOW, NO_SPEED, to_steps
from sumo_mcts.planners.base import Task
from sumo_mcts.planners.candidates import follow_line
from sumo_mcts.planners.mcts import actions_of, in_steps, mcts_params
from sumo_mcts.planners.ply import ALIVE, ARRIVED, SearchParams
from sumo_mcts.planners.search import search
from sumo_mcts.planners.tree import new_tree
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import GREEN, RED, YELLOW, EgoState, Scene, Signals

least_cost = compiled(bound.least_cost)
EPSILON = 1e-9
# Four actions of two seconds, and nothing but time has a price: so the bound is near.
FREE = ("jerk", "acceleration", "braking", "headway", "claim", "route", "blocking", "tail_s")
PLAIN = (
    "planner.step_s=2", "planner.look_ahead_steps=2", "planner.rollout_steps=2",
    *(f"cost.{name}=0" for name in FREE),
)  # fmt: skip
# a search that comes to its end
FEW = (
    "planner.accelerations_mps2=[-3, 0, 2]", "planner.lane_change_accelerations_mps2=[0]",
    "planner.later_accelerations_mps2=[-3, 2]", "planner.step_s=2",
    "planner.look_ahead_steps=2", "planner.rollout_steps=2",
)  # fmt: skip


class Case(NamedTuple):
    """Two stop lines one behind the other, before an ego on one of two lanes."""

    task: Task
    scene: Scene
    local: LocalMap
    state: State
    q: SearchParams


def road_of(lengths: tuple[float, float, float], limits: list[float], joins: bool) -> RoadMap:
    """Edges a, b, c of two lanes, with a light behind a and behind b; `joins`: the right lane of a
    leads nowhere."""
    a, b, c = np.cumsum([lengths[0], 12.0 + lengths[1], 12.0 + lengths[2]])
    lanes = []
    for k in range(2):
        y, after = k * WIDTH, () if joins and k == 0 else (f":m_{k}",)
        lanes += [
            Lane("a", k, ((0.0, y), (a, y)), after, limits[k]),
            Lane("b", k, ((a + 12.0, y), (b, y)), (f":n_{k}",), limits[2 + k]),
            Lane("c", k, ((b + 12.0, y), (c, y)), (), limits[4 + k]),
            Lane(":m", k, ((a, y), (a + 12.0, y)), (f"b_{k}",), limits[6], junction="m",
                 signal="t", link=k),
            Lane(":n", k, ((b, y), (b + 12.0, y)), (f"c_{k}",), limits[7], junction="n",
                 signal="u", link=k),
        ]  # fmt: skip
    return build(sorted(lanes, key=lambda lane: lane.edge.replace(":", "~")))


def shown(draw: st.DrawFn, alike: bool) -> tuple[list[list[int]], list[float]]:
    """What two links show, and until when; alike: the same."""
    states = st.lists(st.sampled_from([GREEN, RED, YELLOW]), min_size=4, max_size=4)
    one = draw(states)
    until = np.cumsum(draw(st.lists(st.floats(0.5, 15.0), min_size=4, max_size=4)))
    until[-1] = np.inf
    return [one, one if alike else draw(states)], until.tolist()


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """Any lights, lengths and limits, any step of the simulation."""
    limit = st.sampled_from([6.0, 13.9, 15.0, 25.0])
    limits = draw(st.lists(limit, min_size=8, max_size=8))
    if draw(st.booleans()):  # lanes side by side with one limit
        limits[1::2][:3] = limits[0:6:2]
        limits[1], limits[3], limits[5] = limits[0], limits[2], limits[4]
    lengths = (draw(st.floats(40.0, 150.0)), draw(st.floats(3.0, 60.0)), 400.0)
    road = road_of(lengths, limits, draw(st.booleans()))
    lane = draw(st.integers(0, 1))
    s = draw(st.floats(0.0, lengths[0]))
    v = draw(st.floats(0.0, 1.1)) * limits[lane]
    ego = ego_at(road, f"a_{lane}", s, v, route=edges(road, "a", "b", "c"))
    lights = [shown(draw, draw(st.booleans())) for _ in range(2)]
    signals = Signals(
        np.array([0, 2, 4], np.int32),
        np.array([*lights[0][0], *lights[1][0]], np.int32),
        np.array([lights[0][1], lights[1][1]]),
    )
    cars = [
        Agent(f"q{k}", f"a_{draw(st.integers(0, 1))}", draw(st.floats(s, lengths[0])), 0.0)
        for k in range(draw(st.integers(0, 2)))
    ]
    step, ballistic = draw(st.sampled_from([0.1, 0.1, 0.5, 1.0])), draw(st.booleans())
    return case_of(road, ego, signals, cars, Physics(step, ballistic, 2.0))


def case_of(
    road: RoadMap, ego: EgoState, signals: Signals, cars: list[Agent], physics: Physics
) -> Case:
    config = scenario(*PLAIN)
    scene = scene_of(ego, road, *cars, signals=signals, step=physics.step)
    task = task_of(road, ego, config, physics)
    local, state = local_of(task, scene)
    return Case(task, scene, local, state, in_steps(mcts_params(config), physics.step, local.dt))


def driven(case: Case, line: Floats) -> tuple[int, float, State]:
    """How a sequence ends, its J, and the last state."""
    plan, terms, end = follow_line(
        case.local, case.task, case.q, case.state, undisturbed(case.local), line
    )
    node = node_at(case.task.route, int(plan.lane[-1]), 0) if len(plan.v) else 0
    s, v = (float(column[-1]) if len(column) else 0.0 for column in (plan.s, plan.v))
    return end, float(terms.sum()), State(node, s, v, 0.0, 0.0, -1, 0.0)


def sequences() -> list[Floats]:
    """Four actions of two seconds, all of them; the first may begin a lane change."""
    rows = [
        [(accel, side if k == 0 else 0, NO_SPEED) for k, accel in enumerate(accels)]
        for accels in itertools.product((-4.0, 0.0, FOLLOW, 2.6), repeat=4)
        for side in (0, 1, -1)
        if side == 0 or accels[1:] == (accels[1],) * 3
    ]
    return [np.array(row, np.float64) for row in rows]


@settings(deadline=None, max_examples=40)
@given(cases())
def test_no_sequence_costs_less_than_the_bound_from_any_state_on_it(case: Case) -> None:
    """The naive way: every sequence is driven to its end."""
    task, q = case.task, case.q
    bounds: dict[bytes, tuple[float, float]] = {}
    for row in sequences():
        line = to_steps(row, q.ply)
        end, whole, _ = driven(case, line)
        if end not in (ALIVE, ARRIVED):
            continue
        at = least_cost(case.local, task.ego, task.cost, case.state, 0.0, q.horizon)
        assert whole >= at - EPSILON
        for level in range(1, 4):
            key = row[:level].tobytes()
            if key not in bounds:
                begun, spent, state = driven(case, line[: level * q.ply])
                time = level * q.ply * task.ego.step
                at = least_cost(case.local, task.ego, task.cost, state, time, q.horizon)
                bounds[key] = (spent, at) if begun == ALIVE else (spent, 0.0)
            spent, at = bounds[key]
            assert whole >= spent + at - EPSILON


def settled(case: Case, each: bool, *, pruned: bool) -> tuple[int, list[float]]:
    """Passes until nothing is left to try, and the best J of every action of the root."""
    local, config = case.local, scenario(*FEW)
    if not pruned:
        local = local._replace(to_gate=local.to_gate.copy())
        local.to_gate[:, SURE] = -1.0
    params = mcts_params(config)
    q = in_steps(params, case.task.ego.step, local.dt)._replace(each=each)
    actions = actions_of(params)
    tree = new_tree(20_000, len(actions), q.look_ahead + q.rollout, undisturbed(local))
    done, known = search(
        tree, local, case.task.ego, cost_params(config), q, actions, case.state, 20_000, math.inf,
        np.random.default_rng(1),
    )  # fmt: skip
    assert tree.closed[0]
    return done + known, [float(tree.best[i]) if i >= 0 else -1.0 for i in tree.child[0]]


@pytest.mark.parametrize("each", [False, True])
@settings(deadline=None, max_examples=40)
@given(case=cases())
def test_the_bound_changes_no_decision(case: Case, each: bool) -> None:
    (_, found), (_, naive) = (settled(case, each, pruned=pruned) for pruned in (True, False))
    assert min(found) == min(naive)
    if each:
        assert found == naive


@pytest.mark.parametrize("until", [(math.inf,), (20.0, 50.0, 90.0)], ids=["unknown", "known"])
def test_before_a_red_light_the_bound_spares_passes(until: tuple[float, ...]) -> None:
    road = road_of((100.0, 50.0, 400.0), [13.9] * 8, joins=False)
    ego = ego_at(road, "a_0", 40.0, 10.0, route=edges(road, "a", "b", "c"))
    shows = [RED, GREEN, RED][: len(until)]
    signals = Signals(
        np.array([0, 2, 4], np.int32), np.array([shows] * 4, np.int32), np.array([until] * 2)
    )
    case = case_of(road, ego, signals, [], Physics(0.1, False, 3.0))
    (few, found), (many, naive) = (settled(case, False, pruned=pruned) for pruned in (True, False))
    assert min(found) == min(naive)
    assert few < 0.7 * many
