"""How much room people who walk along the ego's lane leave it."""

import math

import numpy as np
import pytest
from helpers import Agent, Lane, build, ego_at
from helpers_model import lanes_east, scene_of
from hypothesis import given, settings
from hypothesis import strategies as st

from sumo_mcts.prediction.roadside import VIEW, room_beside
from sumo_mcts.road import RoadMap

ROAD = lanes_east(1)
HALF, EGO_HALF, FRONT = 0.25, 0.9, 100.0  # m: half the width of a person and of the ego; its front


def room(who: Agent, road: RoadMap = ROAD, at: float = FRONT) -> float:
    ego = ego_at(road, road.lane_ids[0], at)
    lanes = np.arange(len(road.lane_ids), dtype=np.int32)
    return float(room_beside(road, lanes, ego, scene_of(ego, road, who).agents)[0])


def walker(x: float, y: float, degrees: float = 0.0) -> Agent:
    heading = math.radians(degrees)
    return Agent("p", "", v=1.2, length=0.3, width=2.0 * HALF, x=x, y=y, heading=heading)


@settings(deadline=None, max_examples=60)
@given(
    st.floats(FRONT - 5.0, FRONT + 90.0), st.floats(1.2, 5.0), st.booleans(), st.booleans(),
    st.floats(-20.0, 20.0),
)  # fmt: skip
def test_it_is_what_lies_between_the_sides(
    x: float, off: float, left: bool, against: bool, turned: float
) -> None:
    """On either side, whichever way they walk."""
    who = walker(x, off if left else -off, turned + (180.0 if against else 0.0))
    assert room(who) == pytest.approx(off - HALF - EGO_HALF, abs=1e-9)


@pytest.mark.parametrize(
    "who",
    [
        walker(120.0, 1.3, 90.0),  # across
        walker(120.0, 1.0),  # in the way
        walker(120.0, 7.0),  # beside the road
        walker(700.0, 1.3),  # beyond the end of the road
    ],
)
def test_others_leave_none_to_speak_of(who: Agent) -> None:
    assert room(who) == math.inf


def test_it_is_seen_ahead_of_the_ego_however_long_its_lane_is() -> None:
    assert room(walker(FRONT + VIEW - 10.0, 1.3), at=FRONT) < 1.0


def test_in_a_junction_people_turn() -> None:
    road = build([
        Lane("a", 0, ((0.0, 0.0), (100.0, 0.0)), (":m_0",)),
        Lane(":m", 0, ((100.0, 0.0), (120.0, 0.0)), ("b_0",), junction="m"),
        Lane("b", 0, ((120.0, 0.0), (300.0, 0.0))),
    ])  # fmt: skip
    assert [room(walker(x, 1.3), road, 90.0) < 1.0 for x in (95.0, 110.0, 130.0)] == [
        True, False, True,
    ]  # fmt: skip


def test_along_a_bend_it_counts_from_the_bend() -> None:
    """Straight on from where the ego is they would be far from its lane."""
    arc = [(50.0 * math.sin(a), 50.0 - 50.0 * math.cos(a)) for a in np.linspace(0.0, 1.5, 40)]
    road, inner = build([Lane("a", 0, arc)]), 50.0 - 1.3
    where = (inner * math.sin(1.0), 50.0 - inner * math.cos(1.0))
    assert room(walker(*where, math.degrees(1.0)), road, 10.0) == pytest.approx(0.15, abs=0.02)
