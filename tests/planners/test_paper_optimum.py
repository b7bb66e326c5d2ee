"""The optimum of the paper's J over its own tree, against a second implementation that drives every
sequence of actions on its own."""

import math
from typing import Any

import numpy as np
import pytest
from helpers import Agent, ego_at
from helpers_model import lanes_east, plain, scenario, situation_of, task_of
from helpers_tree import Toy, on_three_lanes

from sumo_mcts.driver.factories import make_planner
from sumo_mcts.model.motion import begin_change, can_change
from sumo_mcts.planners import paper, paper_search
from sumo_mcts.planners.base import local_of
from sumo_mcts.planners.paper_cost import lane_change
from sumo_mcts.planners.paper_optimum import draws, optimum, taken
from sumo_mcts.planners.ply import ALIVE, ARRIVED, LOST

FEW = ("paper.accelerations_mps2=[-3, 0, 2]",)
one_ply, can_finish = plain(paper_search.one_ply), plain(paper_search._can_finish)


def asked(toy: Toy, *sets: str) -> tuple[Any, Any, Any]:
    config = scenario("planner.name=paper", *toy.sets, *sets)
    task = task_of(toy.road, toy.scene.ego, config)
    return config, task, situation_of(task, toy.scene)


def naive(toy: Toy, *sets: str) -> list[float]:
    """Expected J of the best sequence that begins with each action, by recursion."""
    config, task, situation = asked(toy, *sets)
    p, w = config.paper, paper.weights_of(config, task.ego.step)
    local = local_of(task, situation)
    guide = paper.guide_of(task, situation.state, p.goal_distance_m, p.lane_distance_m)
    chances = [(0.0, 1.0 - p.brake_probability - p.accelerate_probability)]
    for k in range(4):
        chances.append((-(1.5 + k), p.brake_probability / 4))
        chances.append((1.25 + 0.5 * k, p.accelerate_probability / 4))

    def rollout(state: Any, level: int) -> float:
        if level == w.look_ahead + w.rollout:
            return 0.0
        total = 0.0
        for accel, share in chances:
            after, cost, end = one_ply(local, task.ego, w, state, accel, guide, level * w.ply)
            more = {LOST: w.safety * w.contact, ARRIVED: 0.0}.get(end)
            total += share * (cost.sum() + (rollout(after, level + 1) if more is None else more))
        return total

    def values(state: Any, level: int) -> list[float]:
        found = []
        for accel, side in paper.actions_of(config):
            begun, price = state, 0.0
            if side:
                if state.progress > 0.0 or not can_change(local, task.ego, state, int(side)):
                    found.append(math.inf)
                    continue
                begun = begin_change(local, task.ego, state, int(side))
                price = lane_change(local, w, state, level * w.ply * task.ego.step)
            after, cost, end = one_ply(local, task.ego, w, begun, accel, guide, level * w.ply)
            if side and end == ALIVE and not can_finish(local, task.ego, w, after, level + 1):
                end = LOST
            if end == LOST:
                found.append(math.inf)
                continue
            rest = 0.0
            if end == ALIVE:
                deeper = values(after, level + 1) if level + 1 < w.look_ahead else []
                rest = min([*deeper, math.inf])
                rest = rollout(after, level + 1) if math.isinf(rest) else rest
            found.append(cost.sum() + price + rest)
        return found

    return values(situation.state, 0)


TOYS = {
    "free": on_three_lanes(),
    "slow ahead": on_three_lanes(None, Agent("x", "a_1", 116.0, v=3.0)),
    "beside": on_three_lanes(
        None, Agent("x", "a_1", 120.0, v=2.0), Agent("y", "a_2", 97.0, v=10.0)
    ),
    "wall": on_three_lanes(None, *(Agent(f"w{k}", f"a_{k}", 124.0, v=0.0) for k in range(3))),
}


@pytest.mark.parametrize("sets", [(), ("paper.look_ahead_steps=1", "paper.rollout_steps=2")])
@pytest.mark.parametrize("toy", TOYS.values(), ids=TOYS)
def test_the_optimum_is_that_of_all_sequences(toy: Toy, sets: tuple[str, ...]) -> None:
    found = optimum(*asked(toy, *FEW, *sets)).value
    assert found.tolist() == pytest.approx(naive(toy, *FEW, *sets))
    assert np.isfinite(found).any()


def test_what_a_rollout_draws_is_taken_in_four_pieces() -> None:
    accel, share = draws(0.2, 0.4)
    of = dict(zip(accel.tolist(), share.tolist(), strict=True))
    assert of == pytest.approx({
        -1.5: 0.05, -2.5: 0.05, -3.5: 0.05, -4.5: 0.05, 0.0: 0.4,
        1.25: 0.1, 1.75: 0.1, 2.25: 0.1, 2.75: 0.1,
    })  # fmt: skip
    assert [each.tolist() for each in draws(0.0, 0.0)] == [[0.0], [1.0]]
    assert draws(0.7, 0.9)[1].sum() == pytest.approx(1.0)  # as much as is left, as in the rollout


def test_the_scale_is_what_braking_with_four_costs() -> None:
    """0.1 * 4^2 for the jerk, 2 m of way, and 5 for braking beyond 3 m/s2."""
    assert optimum(*asked(TOYS["free"], *FEW)).scale == pytest.approx(1.6 + 2.0 + 5.0)


def test_no_search_finds_less_and_a_wall_is_braked_for() -> None:
    config, task, situation = asked(TOYS["wall"])
    own = optimum(config, task, situation)
    planner = make_planner(config)
    for seed in range(3):
        planner.start(task, seed)
        action = taken(config, planner.plan(situation))
        assert own.value[action] >= own.value.min()
    assert paper.actions_of(config)[int(np.argmin(own.value)), 0] < 0.0
    behind = on_three_lanes(
        ego_at(lanes_east(3, 900.0), "a_1", 100.0, 14.0),
        *(Agent(f"w{k}", f"a_{k}", 106.5, v=0.0) for k in range(3)),
    )
    config, task, situation = asked(behind)
    planner.start(task, 1)
    assert np.isinf(optimum(config, task, situation).value).all()
    assert taken(config, planner.plan(situation)) == -1


def test_each_action_is_known_by_its_number() -> None:
    config, task, situation = asked(TOYS["free"])
    planner = make_planner(config)
    planner.start(task, 1)
    decision = planner.plan(situation)
    numbers = [taken(config, decision._replace(chosen=k)) for k in range(len(decision.children))]
    assert numbers == list(range(12))
