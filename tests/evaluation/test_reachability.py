"""How vehicles get along the lanes, and where they can meet."""

import numpy as np
from helpers import (
    Lane,
    build,
    edge,
    lane,
)
from helpers_referee import CROSSING, STRAIGHT

from sumo_mcts.evaluation.reachability import can_meet, driven, goal_reaching_edges
from sumo_mcts.road import RoadMap
from sumo_mcts.world.oncoming import with_oncoming


def test_lanes_on_which_two_can_meet() -> None:
    def meet(first: tuple[str, float], second: tuple[str, float], road: RoadMap = CROSSING) -> bool:
        a, b = ((lane(road, name), s, 5.0) for name, s in (first, second))
        assert can_meet(road, a, b) == can_meet(road, b, a)
        return can_meet(road, a, b)

    assert meet(("wi_0", 40), ("wi_0", 36))
    assert not meet(("eo_0", 42), ("br_0", 100))
    assert meet(("wi_0", 88), (":we_0", 4))
    assert meet((":we_0", 12), (":sn_0", 8))
    assert meet(("eo_0", 2), (":sn_0", 8))  # its tail is still on the junction
    assert not meet(("wi_0", 30), ("eo_0", 30))
    assert meet(("a_0", 50), ("a_1", 52), STRAIGHT)
    assert can_meet(CROSSING, (-1, 0.0, 5.0), (0, 0.0, 5.0))


def test_a_ramp_over_the_road_that_it_comes_from_is_another_level() -> None:
    road = build(
        [
            Lane("a", 0, ((0, 0), (100, 0)), ("r_0",)),
            Lane("r", 0, ((100, 0), (130, 30), (50, 60), (50, -60))),
        ]
    )
    crossing_s = float(road.length[1]) - 60.0
    assert not can_meet(road, (0, 52.0, 5.0), (1, crossing_s + 2.0, 5.0))
    assert can_meet(road, (0, 99.0, 5.0), (1, 4.0, 5.0))


def test_two_meet_in_a_lane_of_oncoming_traffic() -> None:
    """Where one of them overtakes, and where it only moves over."""
    lanes = [Lane("a", 0, ((0, 0), (400, 0))), Lane("b", 0, ((400, 3.2), (0, 3.2)))]
    road = with_oncoming(build(lanes), {0: 1, 1: 0})
    own, theirs, out, opposed = (lane(road, name) for name in ("a_0", "b_0", "a_1", "b_1"))
    for ego, other in ((own, theirs), (out, theirs), (own, opposed)):
        assert can_meet(road, (ego, 100.0, 5.0), (other, 300.0, 5.0))
        assert can_meet(road, (other, 300.0, 5.0), (ego, 100.0, 5.0))
        assert not can_meet(road, (ego, 100.0, 5.0), (other, 200.0, 5.0))


def test_driven_finds_skipped_lanes_and_lane_changes() -> None:
    a0, m1, b0, b1 = (lane(STRAIGHT, name) for name in ("a_0", ":m_1", "b_0", "b_1"))
    assert driven(STRAIGHT, a0, 10.0, a0, 20.0, 30.0) == ((), (), 0, 10.0)
    way = driven(STRAIGHT, lane(STRAIGHT, "a_1"), 195.0, b1, 5.0, 30.0)
    assert way is not None
    assert way.lanes == (m1, b1)
    assert way.lines == (5.0, 15.0)
    assert way.changes == 0
    assert way.distance == 20.0
    way = driven(STRAIGHT, a0, 195.0, b1, 5.0, 30.0)
    assert way is not None
    assert way.changes == 1
    assert driven(STRAIGHT, a0, 10.0, b0, 50.0, 30.0) is None


def test_edges_from_which_the_goal_can_be_reached() -> None:
    assert [
        STRAIGHT.edge_ids[k]
        for k in np.flatnonzero(goal_reaching_edges(STRAIGHT, edge(STRAIGHT, "c"), 0))
    ] == ["a", ":m", "b", ":n", "c"]
    buses = 1 << 8
    road = build(
        [
            Lane("a", 0, ((0, 0), (9, 0)), ("b_0",)),
            Lane("b", 0, ((9, 0), (20, 0)), ("c_0",), classes=buses),
            Lane("c", 0, ((20, 0), (30, 0))),
        ]
    )
    assert goal_reaching_edges(road, 2, 0).tolist() == [False, False, True]
    assert goal_reaching_edges(road, 2, 8).tolist() == [True, True, True]  # b lets buses in
    assert goal_reaching_edges(road, 2, -1).tolist() == [True, True, True]
