"""Room is asked for where the route needs a lane change soon and the plan finds no place, and
nowhere else."""

import numpy as np
import pytest
from helpers import Agent, Lane, build, edges, ego_at
from helpers_model import scene_of, situation_of, task_of
from helpers_tree import Toy, decide

from sumo_mcts.model.local_map import SLOT
from sumo_mcts.planners.base import local_of
from sumo_mcts.planners.reference import problem_of
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Follow


def ending_lane(length: float = 400.0) -> RoadMap:
    """Two lanes of edge a, of which only the left one leads on to edge b."""
    return build(
        [
            Lane("a", 0, ((0.0, -1.6), (length, -1.6))),
            Lane("a", 1, ((0.0, 1.6), (length, 1.6)), ("b_0",)),
            Lane("b", 0, ((length, 1.6), (length + 500.0, 1.6))),
        ]
    )


def column(lane: str, v: float, begin: float, end: float, every: float = 9.0) -> list[Agent]:
    """Cars one behind the other, with no room between them."""
    return [
        Agent(f"c{k}", lane, begin + every * k, v) for k in range(int((end - begin) / every) + 1)
    ]


def asks(lane: str, s: float, v: float, *agents: Agent, sets: tuple[str, ...] = ()) -> int:
    """The side that an ego on the road with the ending lane asks for."""
    road = ending_lane()
    ego = ego_at(road, lane, s, v, route=edges(road, "a", "b"))
    command = decide(Toy(road, scene_of(ego, road, *agents), sets)).command
    assert isinstance(command, Follow)
    return 0 if command.lane_change else command.asks


def test_it_asks_beside_a_column_before_its_lane_ends() -> None:
    assert asks("a_0", 300.0, 8.0, *column("a_1", 8.0, 200.0, 390.0)) == 1


def test_it_asks_beside_a_queue_while_it_stands() -> None:
    assert asks("a_0", 350.0, 0.0, *column("a_1", 0.0, 250.0, 395.0, 7.5)) == 1


@pytest.mark.parametrize(
    ("lane", "s", "agents"),
    [
        ("a_1", 300.0, column("a_0", 8.0, 200.0, 390.0)),  # it is on the lane of its route
        ("a_0", 20.0, column("a_1", 8.0, 0.0, 390.0)),  # its lane goes on for long
        ("a_0", 300.0, []),  # it just changes
        ("a_0", 300.0, [Agent("passes", "a_1", 299.0, 12.0)]),  # it changes in a moment
    ],
)
def test_it_does_not_ask_for_what_it_does_not_need(
    lane: str, s: float, agents: list[Agent]
) -> None:
    assert asks(lane, s, 8.0, *agents) == 0


def test_it_does_not_ask_where_the_scenario_says_no() -> None:
    beside = column("a_1", 8.0, 200.0, 390.0)
    assert asks("a_0", 300.0, 8.0, *beside, sets=("ego_model.asks=false",)) == 0


def test_it_does_not_ask_where_sumo_knows_no_wish() -> None:
    road = ending_lane()
    ego = ego_at(road, "a_0", 300.0, 8.0, route=edges(road, "a", "b"))._replace(can_ask=False)
    command = decide(Toy(road, scene_of(ego, road, *column("a_1", 8.0, 200.0, 390.0)), ())).command
    assert isinstance(command, Follow)
    assert command.asks == 0


def test_only_a_planner_that_moves_them_has_others_make_room() -> None:
    """Others are handed to the search as rows; who takes a map without them has none that moves."""
    road = ending_lane()
    ego = ego_at(road, "a_0", 300.0, 8.0, route=edges(road, "a", "b"))._replace(asks=1)
    task = task_of(road, ego)
    situation = situation_of(task, scene_of(ego, road, *column("a_1", 8.0, 200.0, 390.0)))
    assert (local_of(task, situation).trait[:, SLOT] < 0.0).all()
    assert (local_of(task, situation, asked=1).trait[:, SLOT] >= 0.0).sum() == 4
    asked, quiet = (
        problem_of(task, situation._replace(scene=situation.scene._replace(ego=each)))
        for each in (ego, ego._replace(asks=0))
    )
    assert np.array_equal(asked.local.trait, quiet.local.trait)
    assert asked.local.asked == 0
