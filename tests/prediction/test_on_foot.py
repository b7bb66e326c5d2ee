"""Where people are expected to walk, and what the ego owes to those who walk over a crossing."""

import math

import numpy as np
import pytest
from helpers import Agent, Lane, build, edges, ego_at, lights
from helpers_model import forecast_of, local_of, scene_of, task_of
from hypothesis import given, settings
from hypothesis import strategies as st

from sumo_mcts.arrays import Floats
from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.model.local_map import AGENT, ENTERS, LocalMap, State
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.model.occupancy import yielding_cost
from sumo_mcts.model.reactions import undisturbed
from sumo_mcts.prediction.on_foot import crossings_on
from sumo_mcts.road import (
    LEFT,
    PEOPLE_FIRST,
    PEOPLE_WAIT,
    PRIORITY,
    RIGHT,
    VEHICLE_CLASSES,
    RoadMap,
)
from sumo_mcts.scene import GREEN

SOUTH, NORTH = -math.pi / 2, math.pi / 2
ON_FOOT = 1 << VEHICLE_CLASSES.index("pedestrian")
MIDDLE, HALF, LOW, HIGH = 8.0, 2.0, -5.0, 2.0  # m: x and y of the crossing
STEP = 0.2  # s between the times of a forecast


def road(rule: int = PEOPLE_FIRST, signal: str = "") -> RoadMap:
    """A lane eastward at y = -1.6 through a junction from x = -10 to 10, with a crossing."""
    return build([
        Lane("w", 0, ((-100.0, -1.6), (-10.0, -1.6)), (":w_0",)),
        Lane(":w", 0, ((-10.0, -1.6), (10.0, -1.6)), ("e_0",), junction="c", signal=signal,
             link=0 if signal else -1),
        Lane("e", 0, ((10.0, -1.6), (200.0, -1.6))),
        Lane(":c_c0", 0, ((MIDDLE, LOW), (MIDDLE, HIGH)), junction="c", width=2.0 * HALF,
             classes=ON_FOOT, rule=rule),
    ])  # fmt: skip


ROAD = road()


def walker(x: float, y: float, heading: float, v: float = 1.2) -> Agent:
    return Agent("p", "", v=v, length=0.4, width=0.5, x=x, y=y, heading=heading)


def walk(*who: Agent, on: RoadMap = ROAD, at: tuple[float, float] = (60.0, 5.0)) -> Floats:
    """[T, 4] where the first is expected. The ego is on its way to the crossing, `at` its s (m) and
    v (m/s); the junction begins at 90 m."""
    ego = ego_at(on, "w_0", *at, route=edges(on, "w", "e"))
    signals = lights(GREEN) if on.signal_ids else lights()
    return forecast_of(task_of(on, ego), scene_of(ego, on, *who, signals=signals)).pose[0, :, 0]


def crosses(way: Floats) -> bool:
    """Whether it comes over the ego's lane, on the crossing."""
    there = way[np.abs(way[:, 1] + 1.6) < 0.5]
    return bool(len(there) and (np.abs(there[:, 0] - MIDDLE) <= HALF).all())


@pytest.mark.parametrize(
    ("x", "y", "heading", "over"),
    [
        (11.0, 4.0, math.pi, True),  # along the pavement, to the corner
        (6.5, 5.0, SOUTH, True),
        (11.0, -6.0, math.pi, True),
        (MIDDLE + 1.0, HIGH - 1.0, SOUTH + 0.5, True),  # on it, round somebody else
        (MIDDLE, LOW + 1.0, NORTH - 0.5, True),
        (MIDDLE, LOW + 1.0, 0.0, True),  # on it, crosswise: to the end that is further
        (6.0, 4.0, math.pi, False),  # past it
        (MIDDLE, HIGH + 1.0, NORTH, False),
        (MIDDLE, LOW + 1.0, SOUTH, False),
        (20.0, 4.0, math.pi, False),  # it does not come there for a while
    ],
)
def test_who_comes_to_a_crossing_walks_over_it(
    x: float, y: float, heading: float, over: bool
) -> None:
    assert crosses(walk(walker(x, y, heading))) == over


def test_but_not_where_a_signal_may_stop_it_or_where_it_is_no_crossing() -> None:
    corner = walker(11.0, 4.0, math.pi)
    for other in (road(signal="t"), road(PRIORITY)):
        way = walk(corner, on=other)
        assert way[:, 1] == pytest.approx(4.0) and not crosses(way)


@pytest.mark.parametrize(
    ("s", "v", "waits"),
    [
        (85.0, 10.0, True),
        (50.0, 10.0, True),  # it could be at the junction 1 s after the person
        (0.0, 10.0, False),  # it is far away
        (85.0, 2.0, False),  # who is slow may stop, and has to expect that people go
        (85.0, 0.0, False),
    ],
)
def test_people_who_have_to_let_vehicles_pass_wait_for_an_ego_that_is_near(
    s: float, v: float, waits: bool
) -> None:
    corner, minor = walker(11.0, 4.0, math.pi), road(PEOPLE_WAIT)
    way = walk(corner, on=minor, at=(s, v))
    assert crosses(way) != waits
    assert crosses(walk(corner, at=(s, v))), "on a zebra crossing they go"
    if waits:
        assert way[-1, 1] > HIGH and (way[-1] == way[-2]).all()


def test_who_is_on_such_a_crossing_walks_on() -> None:
    for y, heading in ((HIGH - 0.5, SOUTH), (LOW + 0.5, NORTH)):
        assert crosses(walk(walker(MIDDLE, y, heading), on=road(PEOPLE_WAIT), at=(85.0, 10.0)))


@settings(deadline=None, max_examples=50)
@given(
    st.floats(0.0, 16.0), st.floats(-10.0, 7.0), st.floats(-math.pi, math.pi), st.floats(0.0, 2.0)
)
def test_people_walk_as_fast_as_before_from_where_they_are(
    x: float, y: float, heading: float, v: float
) -> None:
    who = walker(x, y, heading, v)
    way = walk(who)
    moved = np.hypot(*np.diff(way[:, :2], axis=0).T)
    assert way[0, :2] == pytest.approx((x, y), abs=1e-9)
    assert np.hypot(way[:, 2], way[:, 3]) == pytest.approx(1.0)
    assert (moved <= STEP * v + 1e-6).all()
    assert (moved < STEP * v - 1e-6).sum() <= 1  # where it turns onto the crossing


def owing(s: float, y: float = HIGH + 1.0) -> tuple[LocalMap, State, EgoParams, CostParams]:
    """The ego `s` m inside the junction; somebody walks south to the crossing."""
    ego = ego_at(ROAD, ":w_0", s, 1.0, route=edges(ROAD, "w", "e"))
    task = task_of(ROAD, ego)
    local, state = local_of(task, scene_of(ego, ROAD, walker(MIDDLE, y, SOUTH)))
    return local, state, task.ego, task.cost


def test_the_ego_owes_the_crossing_to_who_comes() -> None:
    """It is 4.6 m to the middle of the lane; less by the ego's half and by its own."""
    local = owing(2.0)[0]
    assert local.obligation[:, AGENT].tolist() == [0.0]
    assert local.obligation[0, ENTERS] == pytest.approx(HIGH + 1.0 + 1.6 - 1.0 - 0.2, abs=0.25)


@pytest.mark.parametrize(("s", "due"), [(2.0, False), (15.0, False), (15.8, True), (19.0, True)])
def test_before_the_crossing_nothing_is_due_and_on_it_no_patience_counts(
    s: float, due: bool
) -> None:
    """Who is on foot does not brake for an ego that has waited long."""
    local, state, ego, cost = owing(s)
    nobody = undisturbed(local)
    price = yielding_cost(local, ego, cost, state, nobody, 0)
    assert (price > 0.0) == due
    assert yielding_cost(local._replace(patience=0.1), ego, cost, state, nobody, 0) == price


def test_who_has_passed_or_goes_elsewhere_is_owed_nothing() -> None:
    assert not len(owing(2.0, y=LOW)[0].obligation)


def turning(at: float) -> RoadMap:
    """A turn to the left out of the lane eastward, with a crossing (people wait) `at` m of it."""
    way = [(-10.0 + r * math.sin(a), -1.6 + r * (1.0 - math.cos(a)))
           for r in (12.0,) for a in np.linspace(0.0, 0.5 * math.pi, 13)]  # fmt: skip
    a = at / 12.0
    x, y, c, s = -10.0 + 12.0 * math.sin(a), -1.6 + 12.0 * (1.0 - math.cos(a)), *(
        math.cos(a), math.sin(a)
    )  # fmt: skip
    return build([
        Lane("w", 0, ((-100.0, -1.6), (-10.0, -1.6)), (":w_0",)),
        Lane(":w", 0, tuple(way), ("n_0",), junction="c", direction=LEFT),
        Lane("n", 0, (way[-1], (2.0, 200.0))),
        Lane(":c_c0", 0, ((x + 4.0 * s, y - 4.0 * c), (x - 4.0 * s, y + 4.0 * c)), junction="c",
             width=3.0, classes=ON_FOOT, rule=PEOPLE_WAIT),
    ])  # fmt: skip


@pytest.mark.parametrize(("at", "waits"), [(2.0, True), (16.0, False)])
def test_people_wait_for_one_that_turns_where_it_comes_from_not_where_it_goes(
    at: float, waits: bool
) -> None:
    on = turning(at)
    crossings = crossings_on(on, np.array([on.lane_ids.index(":w_0")], np.int32))
    assert crossings.yields.tolist() == [True] and crossings.waits.tolist() == [waits]


@pytest.mark.parametrize(("at", "cuts"), [(2.0, False), (16.0, True)])
def test_who_has_turned_to_the_near_side_cuts_the_corner(at: float, cuts: bool) -> None:
    on = turning(at)
    on.direction[on.lane_ids.index(":w_0")] = RIGHT
    crossings = crossings_on(on, np.array([on.lane_ids.index(":w_0")], np.int32))
    assert crossings.yields.tolist() == crossings.cuts.tolist() == [cuts]
    assert crossings.waits.tolist() == [False]
