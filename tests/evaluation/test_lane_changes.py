"""What is seen before a lane change: against a slow second implementation on a straight road, and
one by one."""

from math import exp, inf

import numpy as np
import pytest
from helpers import Agent, Lane, agents_at, build, ego_at, lane, straight_road
from hypothesis import given, settings
from hypothesis import strategies as st

from sumo_mcts.evaluation.lane_changes import (
    FEATURES,
    RELAX,
    TIGHT,
    VIEW,
    features,
)
from sumo_mcts.road import RIGHT as RIGHT_TURN
from sumo_mcts.road import RoadMap

ROAD = straight_road()
RIGHT, LEFT = 0, 1  # columns
BEGINS = {"a": 0.0, ":m": 200.0, "b": 210.0}


def seen(name: str, road: RoadMap, side: int, *those: Agent, blinker: int = 0) -> float:
    """A feature of the first of these agents, with the ego far away on c."""
    agents = agents_at(road, *those)
    agents = agents._replace(
        blinker=np.where(np.arange(len(those)) == 0, blinker, 0).astype(np.int32)
    )
    return float(
        features(road, agents, ego_at(road, road.lane_ids[-1], 90.0))[0, side, FEATURES.index(name)]
    )


# --- against a second implementation ---


@st.composite
def crowds(draw: st.DrawFn) -> list[Agent]:
    count = draw(st.integers(2, 7))
    return [
        Agent(
            f"v{k}",
            f"{draw(st.sampled_from(sorted(BEGINS)))}_{draw(st.integers(0, 1))}",
            draw(st.floats(0.0, 10.0)) if draw(st.booleans()) else draw(st.floats(0.5, 9.5)),
            draw(st.floats(0.0, 20.0)),
            length=draw(st.floats(3.0, 12.0)),
        )
        for k in range(count)
    ]


def along(agent: Agent) -> float:
    return BEGINS[agent.on[:-2]] + agent.s


def leader(those: list[Agent], i: int, number: str) -> tuple[float, float]:
    gaps = [
        (along(other) - other.length - along(those[i]), other.v)
        for j, other in enumerate(those)
        if j != i and other.on[-1] == number and 0.0 <= along(other) - along(those[i]) < VIEW
    ]
    return min(gaps, default=(inf, inf))


def follower(those: list[Agent], i: int, number: str) -> float:
    gaps = [
        along(those[i]) - those[i].length - along(other)
        for j, other in enumerate(those)
        if j != i and other.on[-1] == number and 0.0 < along(those[i]) - along(other) < VIEW
    ]
    return min(gaps, default=inf)


@settings(max_examples=60, deadline=None)
@given(crowds())
def test_who_is_ahead_and_behind_across_edges(those: list[Agent]) -> None:
    those = [
        each._replace(s=min(each.s * 20.0, 200.0)) if each.on[0] != ":" else each for each in those
    ]
    found = features(ROAD, agents_at(ROAD, *those), ego_at(ROAD, "d_0", 90.0))
    metres, seconds = RELAX
    for i, each in enumerate(those):
        if each.on[0] == ":":
            assert np.isnan(found[i]).all()  # inside a junction nobody is asked
            continue
        side = LEFT if each.on[-1] == "0" else RIGHT
        other = "1" if side == LEFT else "0"
        assert np.isnan(found[i, 1 - side]).all()  # there is no lane
        row = dict(zip(FEATURES, found[i, side], strict=True))
        span = metres + seconds * each.v
        for number, near, slow in (
            (each.on[-1], "near", "slow"),
            (other, "near_beside", "slow_beside"),
        ):
            gap, v = leader(those, i, number)
            assert row[near] == pytest.approx(exp(-max(gap, 0.0) / span))
            assert row[slow] == pytest.approx(row[near] * (1.0 - min(v / max(15.0, each.v), 1.0)))
        assert row["tight_ahead"] == pytest.approx(
            exp(-max(leader(those, i, other)[0], 0.0) / TIGHT)
        )
        assert row["tight_behind"] == pytest.approx(
            exp(-max(follower(those, i, other), 0.0) / TIGHT)
        )


# --- one by one ---


def test_a_gap_is_free_where_neither_side_has_to_brake() -> None:
    me = Agent("a", "a_0", 100.0, 10.0)
    assert seen("free", ROAD, LEFT, me) == 1.0
    assert seen("free", ROAD, LEFT, me, Agent("b", "a_1", 100.0, 10.0)) == 0.0  # beside it
    assert seen("free", ROAD, LEFT, me, Agent("b", "a_1", 82.0, 10.0)) == 1.0
    assert seen("free", ROAD, LEFT, me, Agent("b", "a_1", 82.0, 15.0)) == 0.0  # comes up fast
    assert seen("free", ROAD, LEFT, me, Agent("b", "a_1", 118.0, 10.0)) == 1.0
    assert seen("free", ROAD, LEFT, me, Agent("b", "a_1", 118.0, 2.0)) == 0.0  # too slow


def test_the_ego_counts_as_the_others_do() -> None:
    agents = agents_at(ROAD, Agent("a", "a_0", 100.0, 10.0))
    far, beside = ego_at(ROAD, "c_1", 90.0), ego_at(ROAD, "a_1", 98.0)
    free = FEATURES.index("free")
    assert features(ROAD, agents, far)[0, LEFT, free] == 1.0
    assert features(ROAD, agents, beside)[0, LEFT, free] == 0.0


def test_a_turn_signal_is_for_a_turn_only_where_the_lane_leads_to_one() -> None:
    direction = ROAD.direction.copy()
    direction[lane(ROAD, ":mr_0")] = RIGHT_TURN
    road = ROAD._replace(direction=direction, right=ROAD.left, left=ROAD.right)  # a_1 on the right
    at_end, before = Agent("a", "a_0", 190.0, 10.0), Agent("a", "a_0", 40.0, 10.0)
    assert seen("signal", road, RIGHT, at_end, blinker=-1) == 0.0
    assert seen("signal", road, RIGHT, before, blinker=-1) == 1.0
    assert seen("other_signal", road, RIGHT, before, blinker=1) == 1.0


def ending() -> RoadMap:
    """Two lanes, of which the right one ends."""
    return build(
        [
            Lane("a", 0, ((0.0, 0.0), (200.0, 0.0))),
            Lane("a", 1, ((0.0, 3.2), (200.0, 3.2)), ("b_1",)),
            Lane("b", 1, ((200.0, 3.2), (400.0, 3.2))),
        ]
    )


def test_a_lane_that_ends_is_the_more_urgent_the_nearer_its_end() -> None:
    road = ending()
    found = [seen("ends", road, LEFT, Agent("a", "a_0", s)) for s in (50.0, 150.0, 200.0)]
    assert found == sorted(found) and found[-1] == 1.0
    assert seen("ends_beside", road, RIGHT, Agent("a", "a_1", 200.0)) == 1.0
    assert seen("ends", road, RIGHT, Agent("a", "a_1", 200.0)) == 0.0


def test_a_lane_that_is_closed_to_its_class_is_none() -> None:
    classes = ROAD.classes.copy()
    classes[lane(ROAD, "a_1")] = 2
    agents = agents_at(ROAD, Agent("a", "a_0", 100.0))
    ego = ego_at(ROAD, "c_1", 90.0)
    assert np.isnan(features(ROAD._replace(classes=classes), agents, ego)).all()
