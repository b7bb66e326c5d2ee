"""Room is asked for where the route needs a lane change soon and the plan finds no place, and
nowhere else."""

import pytest
from helpers import Agent, Lane, build, edges, ego_at
from helpers_model import scene_of
from helpers_tree import Toy, decide

from sumo_mcts.scene import Follow, RoadMap


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
