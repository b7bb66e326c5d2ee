"""Every number of the section `cost` reaches the kernels, and counts in some situation."""

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from helpers import Agent, Lane, build, crossing, edges, ego_at
from helpers_model import local_of, scenario, scene_of, task_of
from helpers_tree import TOYS, Toy, before_a_light, on_three_lanes

from sumo_mcts.arrays import Floats
from sumo_mcts.config.sections.cost import CostConfig, CostWeights
from sumo_mcts.driver.params import cost_params
from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.model.local_map import LocalMap, State
from sumo_mcts.model.reactions import undisturbed
from sumo_mcts.planners.actions import commanded, lasting
from sumo_mcts.planners.base import Task
from sumo_mcts.planners.candidates import follow_line
from sumo_mcts.planners.mcts import in_steps, mcts_params
from sumo_mcts.scene import RED

STEPS = 30  # of a sequence, 3 s


class Drive(NamedTuple):
    """A sequence in a situation. R agents react."""

    task: Task
    local: LocalMap
    state: State
    others: Floats  # [R, 2]
    line: Floats  # [STEPS, 3]


def drive(toy: Toy, line: Floats, turn: float = 0.0) -> Drive:
    """A sequence [STEPS, 3] from the toy's scene; `turn`, rad, as in State."""
    reactive = scenario(*toy.sets).planner.reactive
    task = task_of(toy.road, toy.scene.ego)
    local, state = local_of(task, toy.scene, reactive=reactive)
    others = undisturbed(local, reactive)
    return Drive(task, local, state._replace(turn=turn), others, line)


def in_junction() -> Toy:
    """The ego stands where two roads cross; a vehicle with the right of way comes."""
    road = crossing()
    ego = ego_at(road, ":sn_0", 10.0, 0.0, route=edges(road, "si", "no"))
    return Toy(road, scene_of(ego, road, Agent("x", "wi_0", 70.0, 12.0)))


def on_ending_lane(v: float) -> Toy:
    """Two lanes of edge a, of which the left one leads on; the ego is on the other one, and a
    faster vehicle far ahead in the left one."""
    road = build(
        [
            Lane("a", 0, ((0.0, -1.6), (300.0, -1.6))),
            Lane("a", 1, ((0.0, 1.6), (300.0, 1.6)), ("b_0",)),
            Lane("b", 0, ((300.0, 1.6), (600.0, 1.6))),
        ]
    )
    ego = ego_at(road, "a_0", 200.0, v, route=edges(road, "a", "b"))
    return Toy(road, scene_of(ego, road, Agent("fast", "a_1", 280.0, 15.0)))


@cache
def drives() -> tuple[Drive, ...]:
    """Situations in which each number counts at least once."""
    reactive = TOYS["reactive"].sets
    follower = Agent("behind", "a_0", 78.0, 13.0)
    moves_over = Agent("moves", "a_2", 106.0, 0.5, -0.9)
    slow = ego_at(TOYS["free"].road, "a_1", 100.0, 5.0)
    standing = on_three_lanes(ego_at(TOYS["free"].road, "a_1", 100.0, 0.0))
    return (
        drive(TOYS["wall"], lasting(2.0, 0, STEPS)),
        drive(TOYS["traffic"], lasting(-6.0, 0, STEPS)),
        drive(on_three_lanes(slow, follower, sets=reactive), lasting(0.0, -1, STEPS)),
        drive(before_a_light(RED, distance=20.0), commanded(np.full(STEPS, 12.0), 0)),
        drive(before_a_light(RED, distance=150.0), lasting(0.0, 0, STEPS)),
        drive(in_junction(), lasting(0.0, 0, STEPS)),
        drive(on_ending_lane(10.0), lasting(0.0, 0, STEPS)),
        drive(standing, lasting(0.0, 0, STEPS), turn=0.3),
        drive(on_three_lanes(slow, moves_over), lasting(0.0, 0, STEPS)),
    )


@cache
def costs(**changed: float) -> Floats:
    """[drives, 5] the terms of each drive, with other numbers than the usual ones."""
    usual = cost_params(scenario())
    q = in_steps(mcts_params(scenario()), 0.1, 0.2)._replace(horizon=0.1 * STEPS)
    return np.array(
        [
            follow_line(
                local, task._replace(cost=usual._replace(**changed)), q, state, others, line
            )[1]
            for task, local, state, others, line in drives()
        ]
    )


@pytest.mark.parametrize("name", CostWeights.model_fields)
def test_a_number_that_changes_changes_a_cost(name: str) -> None:
    usual = CostWeights.model_fields[name].default
    assert not np.array_equal(costs(**{name: 0.5 * usual or 1.0}), costs())


@pytest.mark.parametrize("name", CostWeights.model_fields)
def test_kernels_get_what_the_scenario_says(name: str) -> None:
    said = scenario(f"cost.{name}=3.25")
    assert cost_params(said) == cost_params(scenario())._replace(**{name: 3.25})


def test_what_is_no_number_of_a_built_in_term_belongs_to_the_term_of_the_users_own() -> None:
    own = set(CostConfig.model_fields) - set(CostWeights.model_fields)
    assert own == {"term", "term_weight"}


def test_a_number_that_is_not_given_costs_nothing() -> None:
    assert CostParams(red=100.0) == (
        *(100.0 * (n == "red") for n in CostWeights.model_fields),
        None,
    )
