"""The referee on small hand-made roads: each outcome, each reason for blame, lights, imposed
braking, and the box tests beneath."""

from math import hypot, inf, nan, pi
from typing import Any

import numpy as np
import pytest
from helpers import (
    Agent,
    Lane,
    build,
    crossing,
    edge,
    edges,
    ego_at,
    frame_of,
    lane,
    lights,
    place,
    straight_road,
)
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely import Polygon, affinity, box  # type: ignore[import-untyped]

from sumo_mcts.evaluation.contact import (
    between,
    boxes_overlap,
    first_contact,
    jumped,
    kept_apart,
    touch_point,
)
from sumo_mcts.evaluation.reachability import can_meet, driven, goal_reaching_edges
from sumo_mcts.evaluation.referee import Goal, Referee
from sumo_mcts.scene import GREEN, RED, YELLOW, Frame, RoadMap

STRAIGHT = straight_road()
CROSSING = crossing()
SIGNALLED = crossing("c")
STEP = 0.5


def referee(
    road: RoadMap,
    first: Frame,
    *route: str,
    success: str = "",
    limit: float = 100.0,
    step: float = STEP,
) -> Referee:
    return Referee(
        road,
        Goal(edges(road, *route), edge(road, success) if success else -1, limit, 20.0),
        step,
        first,
    )


def drive(
    road: RoadMap,
    where: list[tuple[str, float]],
    route: tuple[str, ...],
    v: float = 10.0,
    step: float = STEP,
    **goal: Any,
) -> tuple[Referee, str | None]:
    """The verdict over an ego that was at these lane positions, one a step."""
    ways = [ego_at(road, name, s, v, route=edges(road, *route)) for name, s in where]
    judge = referee(road, frame_of(road, 0.0, ways[0]), *route, step=step, **goal)
    outcome = None
    for k, ego in enumerate(ways[1:], 1):
        outcome = judge.observe(frame_of(road, k * step, ego))
    return judge, outcome


# --- geometry ---

numbers = st.floats(-6.0, 6.0)
sizes = st.floats(0.2, 5.0)
angles = st.floats(-7.0, 7.0)


def polygon(values: tuple[float, ...]) -> Polygon:
    x, y, heading, long, wide = values
    return affinity.translate(
        affinity.rotate(box(-long, -wide, long, wide), heading, origin=(0, 0), use_radians=True),
        x,
        y,
    )


@settings(max_examples=300, deadline=None)
@given(
    st.tuples(numbers, numbers, angles, sizes, sizes),
    st.tuples(numbers, numbers, angles, sizes, sizes),
)
def test_boxes_overlap_as_polygons_do(first: tuple[float, ...], second: tuple[float, ...]) -> None:
    a, b = polygon(first), polygon(second)
    shared = a.intersection(b).area
    assume(shared > 1e-9 or a.distance(b) > 1e-9)
    assert bool(boxes_overlap(np.array(first), np.array(second))) == (shared > 0)
    assert bool(boxes_overlap(np.array(second), np.array(first))) == (shared > 0)


def test_boxes_overlap_is_vectorised() -> None:
    ego = np.array([0.0, 0.0, 0.0, 2.5, 0.9])
    others = np.array(
        [
            [5.1, 0.0, 0.0, 2.5, 0.9],
            [4.9, 0.0, 0.0, 2.5, 0.9],
            [0.0, 3.2, 0.0, 2.5, 0.9],
            [0.0, 3.2, pi / 2, 2.5, 0.9],
        ]
    )
    assert boxes_overlap(ego, others).tolist() == [False, True, False, True]


@settings(max_examples=100, deadline=None)
@given(st.tuples(numbers, numbers, angles), st.tuples(numbers, numbers, angles))
def test_between_starts_and_ends_where_it_should(
    before: tuple[float, ...], after: tuple[float, ...]
) -> None:
    way = between(np.array(before), np.array(after), np.array([0.0, 1.0]))
    assert way[:, :2] == pytest.approx(np.array([before[:2], after[:2]]))
    assert np.cos(way[:, 2]) == pytest.approx(np.cos([before[2], after[2]]), abs=1e-9)


def test_between_follows_an_arc() -> None:
    radius, turn = 10.0, 1.0
    start, end = (
        np.array([radius, 0.0, pi / 2]),
        np.array([radius * np.cos(turn), radius * np.sin(turn), pi / 2 + turn]),
    )
    way = between(start, end, np.linspace(0, 1, 11))
    assert np.hypot(way[:, 0], way[:, 1]) == pytest.approx(
        radius, abs=0.08
    )  # the chord is 1.2 m off


def test_touch_point_is_the_middle_of_the_overlap() -> None:
    half = np.array([2.5, 0.9])
    contact = first_contact(
        np.array([0.0, 0, 0]),
        np.array([10.0, 0, 0]),
        np.array([12.0, 0.9, 0]),
        np.array([12.0, 0.9, 0]),
        half,
        half,
    )
    assert contact is not None
    assert contact.exact
    assert contact.ego[0] == pytest.approx(7.0, abs=0.01)
    assert touch_point(contact, half, half) == pytest.approx((9.5, 0.45), abs=0.01)


def test_no_contact_between_vehicles_that_pass() -> None:
    half = np.array([2.5, 0.9])
    assert (
        first_contact(
            np.array([0.0, 0, 0]),
            np.array([20.0, 0, 0]),
            np.array([20.0, 2, pi]),
            np.array([0.0, 2, pi]),
            half,
            half,
        )
        is None
    )


poses = st.tuples(st.floats(-15.0, 15.0), st.floats(-15.0, 15.0), angles)


@settings(max_examples=300, deadline=None)
@given(poses, poses, poses, poses)
def test_the_cheap_test_never_denies_a_contact(
    a: tuple[float, ...], b: tuple[float, ...], c: tuple[float, ...], d: tuple[float, ...]
) -> None:
    half = np.array([2.5, 0.9])
    a0, a1, b0, b1 = (np.array(pose) for pose in (a, b, c, d))
    if kept_apart(a0, a1, half, b0[None], b1[None], half[None])[0]:
        assert first_contact(a0, a1, b0, b1, half, half) is None


def test_jumps_are_told_from_arcs() -> None:
    before = np.array([[0.0, 0.0, 0.0]] * 4)
    after = np.array(
        [
            [8.0, 3.2, 0.0],
            [8.0, 1.0, 0.0],
            [10 * np.sin(0.8), 10 - 10 * np.cos(0.8), 0.8],
            [60.0, 0.0, 0.0],
        ]
    )
    assert jumped(before, after, np.full(4, 20.0)).tolist() == [True, False, False, True]


# --- the map ---


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


# --- outcomes ---

ROUTE = ("a", "b", "c")


def test_arrives_where_sumo_takes_it_out() -> None:
    first = ego_at(STRAIGHT, "c_1", 189.0)
    judge = referee(STRAIGHT, frame_of(STRAIGHT, 30.0, first), "a", "b", "c")
    last = ego_at(STRAIGHT, "c_1", 195.0, v=12.0)
    assert judge.observe(frame_of(STRAIGHT, 30.5, last)) is None
    gone = frame_of(STRAIGHT, 31.0, last)._replace(present=False, arrived=True)
    assert judge.observe(gone) == "arrived"
    assert judge.observe(gone._replace(arrived=False)) == "arrived"
    row = judge.row()
    assert row["travel_time_s"] == 1.0
    assert row["in_time"] is True
    assert row["free_flow_s"] == 20.0
    assert row["distance_m"] == pytest.approx(11.0)
    assert row["at_fault"] is None
    assert row["collisions"] == 0
    assert row["error"] is None


@pytest.mark.parametrize(
    ("last", "outcome"),
    [
        (("c_1", 5.0), "arrived"),
        (("b_1", 197.0), "arrived"),
        (("b_1", 150.0), "off_route"),
        (("a_1", 199.0), "off_route"),
    ],
)
def test_who_is_taken_out_elsewhere_has_not_arrived(last: tuple[str, float], outcome: str) -> None:
    before = ego_at(STRAIGHT, *last, v=12.0)
    judge = referee(STRAIGHT, frame_of(STRAIGHT, 0.0, before), *ROUTE)
    assert (
        judge.observe(frame_of(STRAIGHT, 0.5, before)._replace(present=False, arrived=True))
        == outcome
    )


def test_who_is_taken_out_before_the_success_edge_has_not_arrived() -> None:
    before = ego_at(STRAIGHT, "b_1", 150.0, v=12.0)
    taken_out = frame_of(STRAIGHT, 0.5, before)._replace(present=False, arrived=True)
    assert (
        referee(STRAIGHT, frame_of(STRAIGHT, 0.0, before), *ROUTE, success="b").observe(taken_out)
        == "arrived"
    )
    assert (
        referee(STRAIGHT, frame_of(STRAIGHT, 0.0, before), *ROUTE, success="c").observe(taken_out)
        == "off_route"
    )


def test_arrives_beyond_the_end_of_a_goal_edge_that_is_not_the_last() -> None:
    _, outcome = drive(STRAIGHT, [("a_1", 190.0), ("a_1", 199.0)], ("a",))
    assert outcome is None
    for beyond in ((":m_1", 2.0), ("b_1", 1.0)):
        judge, outcome = drive(STRAIGHT, [("a_1", 190.0), ("a_1", 199.0), beyond], ("a",))
        assert outcome == "arrived"
        assert judge.row()["travel_time_s"] == 1.0


def test_success_edge() -> None:
    judge, outcome = drive(
        STRAIGHT, [("a_1", 190.0), ("a_1", 199.0), (":m_1", 2.0)], ROUTE, success="b"
    )
    assert outcome is None
    judge, outcome = drive(
        STRAIGHT, [("a_1", 190.0), ("a_1", 199.0), ("b_1", 0.5)], ROUTE, success="b"
    )
    assert outcome == "arrived"
    assert judge.row()["in_time"] is True
    short = build(
        [
            Lane(name, 0, ((x, 0), (x + 4, 0)), (after,) if after else ())
            for name, x, after in (("a", 0, "b_0"), ("b", 4, "c_0"), ("c", 8, ""))
        ]
    )
    assert (
        drive(short, [("a_0", 3.0), ("c_0", 1.0)], ROUTE, success="b")[1] == "arrived"
    )  # skipped within a step


def test_a_route_may_pass_its_goal_edge_before() -> None:
    ring = build(
        [
            Lane("a", 0, ((0, 0), (30, 0)), ("b_0",)),
            Lane("b", 0, ((30, 0), (30, 9), (0, 9), (0, 0)), ("a_0",)),
        ]
    )
    lap = [
        ("a_0", 25.0),
        ("b_0", 0.0),
        ("b_0", 7.0),
        ("b_0", 14.0),
        ("b_0", 21.0),
        ("b_0", 28.0),
        ("b_0", 35.0),
        ("b_0", 42.0),
        ("a_0", 1.0),
    ]
    assert drive(ring, lap, ("a", "b", "a"))[1] is None
    assert (
        drive(
            ring,
            [*lap, ("a_0", 8.0), ("a_0", 15.0), ("a_0", 22.0), ("a_0", 29.0), ("b_0", 3.0)],
            ("a", "b", "a"),
        )[1]
        == "arrived"
    )


def test_off_route() -> None:
    assert drive(STRAIGHT, [("a_0", 199.0), (":mr_0", 3.0)], ROUTE)[1] == "off_route"
    assert drive(STRAIGHT, [("a_0", 199.0), (":m_0", 3.0)], ROUTE)[1] is None


def test_timeout_comes_after_the_limit() -> None:
    where = [("a_1", 10.0 + 5 * k) for k in range(4)]
    assert drive(STRAIGHT, where, ROUTE, limit=1.5)[1] is None
    judge, outcome = drive(STRAIGHT, where, ROUTE, limit=1.4)
    assert outcome == "timeout"
    assert judge.row()["travel_time_s"] is None
    assert judge.row()["in_time"] is False


def gone(**what: Any) -> Frame:
    return frame_of(STRAIGHT, 0.5, ego_at(STRAIGHT, "a_1", 10.0))._replace(present=False, **what)


def test_vanished_teleported_failed() -> None:
    first = frame_of(STRAIGHT, 0.0, ego_at(STRAIGHT, "a_1", 10.0))
    judge = referee(STRAIGHT, first, *ROUTE)
    assert judge.observe(gone()) == "error"
    assert judge.row()["error"] == "vanished"
    assert referee(STRAIGHT, first, *ROUTE).observe(gone(teleported=True)) == "teleported"
    judge = referee(STRAIGHT, first, *ROUTE)
    judge.fail("SUMO failed: no reason given")
    assert judge.observe(first._replace(time=0.5)) == "error"
    assert judge.row()["error"] == "SUMO failed: no reason given"
    row = judge.row()  # nothing is known of what did not come to an end
    assert {key for key, value in row.items() if value is not None} == {
        "outcome",
        "error",
        "free_flow_s",
        "in_time",
        "distance_m",
    } and row["in_time"] is False
    judge = referee(STRAIGHT, first, *ROUTE)
    judge.observe(gone(teleported=True))
    judge.fail("too late")
    assert judge.row()["outcome"] == "teleported"
    assert judge.row()["error"] is None
    never = Referee(STRAIGHT, Goal(edges(STRAIGHT, *ROUTE), -1, inf, nan), STEP)
    never.fail("never departed")
    assert never.row()["outcome"] == "error"
    assert never.row()["free_flow_s"] is None
    assert never.row()["rms_jerk_mps3"] is None


def test_precedence() -> None:
    start = frame_of(STRAIGHT, 0.0, ego_at(STRAIGHT, "a_0", 199.0))
    everything = frame_of(
        STRAIGHT, 0.5, ego_at(STRAIGHT, ":mr_0", 3.0), Agent("x", ":mr_0", 3.0)
    )._replace(teleported=True)
    route = ("a", "b", "c")
    assert referee(STRAIGHT, start, *route, limit=0.1).observe(everything) == "collision"
    alone = frame_of(STRAIGHT, 0.5, ego_at(STRAIGHT, ":mr_0", 3.0))
    assert (
        referee(STRAIGHT, start, *route, limit=0.1).observe(alone._replace(teleported=True))
        == "teleported"
    )
    assert referee(STRAIGHT, start, *route, limit=0.1).observe(alone) == "off_route"
    assert referee(STRAIGHT, start, "a", limit=0.1).observe(alone) == "timeout"
    assert referee(STRAIGHT, start, "a").observe(alone) == "arrived"
    assert (
        referee(STRAIGHT, start, *route).observe(gone(arrived=True, collisions=("x",)))
        == "collision"
    )


def test_first_frame_is_the_take_over_where_none_is_given() -> None:
    judge = Referee(STRAIGHT, Goal(edges(STRAIGHT, *ROUTE), -1, 100.0, 20.0), STEP)
    assert judge.observe(frame_of(STRAIGHT, 7.0, ego_at(STRAIGHT, "c_1", 195.0))) is None
    assert (
        judge.observe(
            frame_of(STRAIGHT, 7.5, ego_at(STRAIGHT, "c_1", 195.0))._replace(
                present=False, arrived=True
            )
        )
        == "arrived"
    )
    assert judge.row()["travel_time_s"] == 0.5
    judge = Referee(STRAIGHT, Goal(edges(STRAIGHT, *ROUTE), -1, 100.0, 20.0), STEP)
    assert (
        judge.observe(
            frame_of(STRAIGHT, 7.0, ego_at(STRAIGHT, "c_1", 95.0), Agent("x", "c_1", 97.0))
        )
        == "collision"
    )


# --- collisions ---


def crash(
    road: RoadMap,
    before: tuple[Any, ...],
    after: tuple[Any, ...],
    route: tuple[str, ...],
    step: float = STEP,
) -> tuple[str | None, bool | None]:
    """Outcome and blame after one step; before and after: the ego, then the agents."""
    judge = referee(road, frame_of(road, 10.0, *before), *route, step=step)
    outcome = judge.observe(frame_of(road, 10.0 + step, *after))
    assert judge.row()["collisions"] == (outcome == "collision")
    return outcome, judge.row()["at_fault"]


def test_front_into_a_standing_car_and_into_a_slow_one() -> None:
    def ego(s: float) -> Any:
        return ego_at(STRAIGHT, "a_1", s)

    for v in (0.0, 3.0):
        found = crash(
            STRAIGHT,
            (ego(20.0), Agent("x", "a_1", 29.0, v)),
            (ego(25.0), Agent("x", "a_1", 29.0 + v / 2, v)),
            ROUTE,
        )
        assert found == (("collision", True) if v == 0 else (None, None))
    assert crash(
        STRAIGHT,
        (ego(20.0), Agent("x", "a_1", 27.0, 3.0)),
        (ego(25.0), Agent("x", "a_1", 28.5, 3.0)),
        ROUTE,
    ) == ("collision", True)


def test_hit_from_behind_is_not_the_egos_fault() -> None:
    def step(ego_v: float, **change: Any) -> tuple[str | None, bool | None]:
        before, after = (
            ego_at(STRAIGHT, "a_1", 50.0, ego_v),
            ego_at(STRAIGHT, "a_1", 50.0 + ego_v / 2, ego_v)._replace(**change),
        )
        return crash(
            STRAIGHT,
            (before, Agent("x", "a_1", 43.0, 12.0)),
            (after, Agent("x", "a_1", 49.0, 12.0)),
            ROUTE,
        )

    assert step(2.0) == ("collision", False)
    assert step(0.0) == ("collision", False)
    assert step(2.0, changing=0.2, change_from=2, change_to=2) == (
        "collision",
        True,
    )  # its lane change has just begun


def test_a_lane_change_counts_for_three_seconds() -> None:
    for wait, fault in ((2.5, True), (3.0, False)):
        ways = [
            ego_at(STRAIGHT, "a_1", 60.0 + 5 * k, 10.0, d=0.3)._replace(
                changing=min(0.1 + k / 6, 0.99)
            )
            for k in range(int(wait / STEP) + 1)
        ]
        judge = referee(STRAIGHT, frame_of(STRAIGHT, 0.0, ego_at(STRAIGHT, "a_1", 55.0)), *ROUTE)
        for k, ego in enumerate(ways[:-1]):
            assert (
                judge.observe(
                    frame_of(STRAIGHT, STEP * (k + 1), ego, Agent("x", "a_1", ego.s - 8.0, 18.0))
                )
                is None
            )
        hit = ways[-1]
        assert (
            judge.observe(
                frame_of(STRAIGHT, STEP * len(ways), hit, Agent("x", "a_1", hit.s - 4.0, 18.0))
            )
            == "collision"
        )
        assert judge.row()["at_fault"] is fault


def test_a_lane_change_at_once_is_judged_by_where_it_ends() -> None:
    # the car on the left drives where the way of the jump would lead through it
    before, after = ego_at(STRAIGHT, "a_0", 50.0, 20.0), ego_at(STRAIGHT, "a_1", 60.0, 20.0)
    agents = Agent("x", "a_1", 55.0, 0.1), Agent("x", "a_1", 54.9, 0.1)
    judge = referee(STRAIGHT, frame_of(STRAIGHT, 0.0, before, agents[0]), *ROUTE)
    assert judge.observe(frame_of(STRAIGHT, 0.5, after, agents[1])) is None
    assert judge.row()["lane_changes"] == 1
    assert (
        judge.observe(frame_of(STRAIGHT, 1.0, after._replace(v=0.0), Agent("x", "a_1", 57.0, 20.0)))
        == "collision"
    )
    assert judge.row()["at_fault"] is True  # it cut in


def test_an_agent_that_was_not_there_before_is_not_swept() -> None:
    ego = [ego_at(STRAIGHT, "a_1", s, 20.0) for s in (50.0, 60.0)]
    assert crash(STRAIGHT, (ego[0],), (ego[1], Agent("new", "a_1", 54.0, 1.0)), ROUTE) == (
        None,
        None,
    )
    assert (
        crash(STRAIGHT, (ego[0],), (ego[1], Agent("new", "a_1", 58.0, 1.0)), ROUTE)[0]
        == "collision"
    )


def test_sweep_finds_a_crossing_between_two_states() -> None:
    # the ego's box is before and behind the other's way when the step begins and ends, and so is
    # the other's
    before = ego_at(CROSSING, ":sn_0", 4.0, 20.0), Agent("x", ":we_0", 8.0, 20.0)
    after = ego_at(CROSSING, "no_0", 4.0, 40.0), Agent("x", "eo_0", 8.0, 40.0)
    assert crash(CROSSING, before, after, ("si", "no"), step=0.5) == ("collision", True)
    late = Agent("x", "wi_0", 80.0, 16.0), Agent("x", "wi_0", 88.0, 16.0)
    assert crash(CROSSING, (before[0], late[0]), (after[0], late[1]), ("si", "no"), step=0.5) == (
        None,
        None,
    )


def test_hit_from_the_side() -> None:
    def step(
        ego_road: str, other_road: str, other_s: float, ego_goal: tuple[str, ...]
    ) -> tuple[str | None, bool | None]:
        """The other's front into the middle of the ego's side."""
        before = ego_at(CROSSING, ego_road, 11.0, 4.0), Agent("x", other_road, 1.0, 12.0)
        return crash(
            CROSSING,
            before,
            (ego_at(CROSSING, ego_road, 13.0, 4.0), Agent("x", other_road, other_s, 15.0)),
            ego_goal,
        )

    assert step(":we_0", ":sn_0", 8.5, ("wi", "eo")) == ("collision", False)
    assert step(":sn_0", ":we_0", 11.5, ("si", "no")) == (
        "collision",
        True,
    )  # has to let the other pass


def test_a_red_light_run_outweighs_priority() -> None:
    def step(signals: tuple[int, ...]) -> bool | None:
        shown = lights(*signals)
        route = edges(SIGNALLED, "wi", "eo")
        ways = [
            ego_at(SIGNALLED, name, s, 16.0, route=route)
            for name, s in (("wi_0", 30.0), ("wi_0", 88.0), (":we_0", 6.0), (":we_0", 13.0))
        ]
        other = [Agent("x", ":sn_0", s, 14.0) for s in (0.1, 0.1, 1.0, 8.0)]
        judge = referee(SIGNALLED, frame_of(SIGNALLED, 0.0, ways[0], signals=shown), "wi", "eo")
        for k in (1, 2):
            assert (
                judge.observe(frame_of(SIGNALLED, STEP * k, ways[k], other[k], signals=shown))
                is None
            )
        assert (
            judge.observe(frame_of(SIGNALLED, 1.5, ways[3], other[3], signals=shown)) == "collision"
        )
        return judge.row()["at_fault"]  # type: ignore[no-any-return]

    assert step((GREEN, RED, RED)) is False
    assert step((RED, GREEN, RED)) is True


def test_nobody_owes_way_to_a_red_runner() -> None:
    def step(shown: tuple[int, ...]) -> bool | None:
        route, colours = edges(SIGNALLED, "si", "no"), lights(*shown)
        ways = [ego_at(SIGNALLED, ":sn_0", s, 4.0, route=route) for s in (7.0, 9.0, 11.0)]
        other = (
            Agent("x", "wi_0", 88.0, 12.0),
            Agent("x", ":we_0", 1.0, 14.0),
            Agent("x", ":we_0", 11.5, 19.0),
        )
        judge = referee(
            SIGNALLED, frame_of(SIGNALLED, 0.0, ways[0], other[0], signals=colours), "si", "no"
        )
        judge.observe(frame_of(SIGNALLED, 0.5, ways[1], other[1], signals=colours))
        assert (
            judge.observe(frame_of(SIGNALLED, 1.0, ways[2], other[2], signals=colours))
            == "collision"
        )
        return judge.row()["at_fault"]  # type: ignore[no-any-return]

    assert step((RED, GREEN, RED)) is False
    assert step((GREEN, GREEN, RED)) is True


def test_a_red_runner_that_comes_back_on_green_is_owed_its_way() -> None:
    colours = [lights(RED, GREEN, RED)] * 3 + [lights(GREEN, GREEN, RED)] * 3
    route = edges(SIGNALLED, "si", "no")
    ways = [
        ego_at(SIGNALLED, lane, s, 4.0, route=route)
        for lane, s in (
            *(("si_0", 50.0 + 2 * k) for k in range(3)),
            *((":sn_0", 7.0 + 2 * k) for k in range(3)),
        )
    ]
    there = [
        ("wi_0", 88.0, 12.0),
        (":we_0", 1.0, 14.0),
        ("eo_0", 10.0, 14.0),
        ("wi_0", 88.0, 12.0),
        (":we_0", 1.0, 14.0),
        (":we_0", 11.5, 19.0),
    ]
    frames = [
        frame_of(SIGNALLED, STEP * k, ways[k], Agent("x", *there[k]), signals=colours[k])
        for k in range(6)
    ]
    judge = referee(SIGNALLED, frames[0], "si", "no")
    assert [judge.observe(frame) for frame in frames[1:]] == [None] * 4 + ["collision"]
    assert judge.row()["at_fault"] is True


def test_an_ego_that_comes_back_on_green_has_not_entered_on_red() -> None:
    def blame(first: int) -> bool | None:
        route = edges(SIGNALLED, "wi", "eo")
        ways = [
            ("wi_0", 84.0),
            (":we_0", 2.0),
            ("wi_0", 76.0),
            ("wi_0", 81.0),
            ("wi_0", 86.0),
            (":we_0", 1.0),
            (":we_0", 6.0),
        ]
        judge = None
        for k, (where, s) in enumerate(ways):
            behind = [Agent("x", "wi_0", 85.0 if k == 5 else 91.6, 13.0)] if k >= 5 else []
            colour = first if k < 2 else GREEN
            frame = frame_of(
                SIGNALLED,
                STEP * k,
                ego_at(SIGNALLED, where, s, 10.0, route=route),
                *behind,
                signals=lights(colour, RED, RED),
            )
            judge = judge or referee(SIGNALLED, frame, "wi", "eo")
            outcome = judge.observe(frame) if k else None
        assert judge is not None and outcome == "collision"
        return judge.row()["at_fault"]  # type: ignore[no-any-return]

    assert blame(GREEN) is False
    assert blame(RED) is False


def test_standing_on_a_junction() -> None:
    def step(*leaders: Agent) -> tuple[str | None, bool | None]:
        ego = ego_at(CROSSING, ":we_0", 18.0, 0.0)
        judge = referee(
            CROSSING,
            frame_of(CROSSING, 0.0, ego, Agent("x", ":we_0", 9.0, 14.0), *leaders),
            "wi",
            "eo",
        )
        return judge.observe(
            frame_of(CROSSING, 0.5, ego, Agent("x", ":we_0", 16.0, 14.0), *leaders)
        ), judge.row()["at_fault"]

    assert step() == ("collision", True)
    assert step(Agent("queue", "eo_0", 6.0, 0.0)) == ("collision", False)
    assert step(Agent("queue", "eo_0", 30.0, 0.0)) == (
        "collision",
        True,
    )  # too far to be the reason
    assert step(Agent("queue", "eo_0", 6.0, 8.0)) == ("collision", True)  # drives off


def test_sideswipe() -> None:
    ego = [ego_at(STRAIGHT, "a_1", s) for s in (50.0, 55.0)]
    # it comes over, its side against the ego's
    drift = Agent("x", "a_0", 49.0, 10.0, d=1.3), Agent("x", "a_0", 54.0, 10.0, d=1.6)
    assert crash(STRAIGHT, (ego[0], drift[0]), (ego[1], drift[1]), ROUTE) == ("collision", False)
    # nobody can tell why
    ways = ego_at(STRAIGHT, "a_1", 50.0, d=-1.2), ego_at(STRAIGHT, "a_1", 55.0, d=-1.6)
    beside = Agent("x", "a_0", 49.0, 10.0), Agent("x", "a_0", 54.0, 10.0)
    assert crash(STRAIGHT, (ways[0], beside[0]), (ways[1], beside[1]), ROUTE) == ("collision", True)


def test_who_changes_lanes_standing_does_not_stand() -> None:
    """SUMO moves it to the side at no speed, into an ego that stands; an ego that moves aside
    itself comes to one that stands."""
    stands = ego_at(STRAIGHT, "a_1", 50.0, 0.0)
    beside = [Agent("x", "a_0", 47.0, 0.0, d=d) for d in (1.2, 1.6)]
    assert crash(STRAIGHT, (stands, beside[0]), (stands, beside[1]), ROUTE) == ("collision", False)
    aside = ego_at(STRAIGHT, "a_1", 50.0, 0.0, d=-0.4)
    assert crash(STRAIGHT, (stands, beside[0]), (aside, beside[0]), ROUTE) == ("collision", True)


def test_pedestrians_count() -> None:
    ego = [ego_at(STRAIGHT, "a_1", s) for s in (50.0, 55.0)]
    ahead = Agent("p", "", v=1.0, x=53.0, y=0.2, width=0.5, length=0.3)
    assert crash(STRAIGHT, (ego[0], ahead), (ego[1], ahead), ROUTE) == ("collision", True)
    into_the_side = ahead._replace(x=51.0, y=-1.5), ahead._replace(x=51.0, y=-1.0)
    assert crash(STRAIGHT, (ego[0], into_the_side[0]), (ego[1], into_the_side[1]), ROUTE) == (
        "collision",
        False,
    )


def test_a_bridge_is_no_contact() -> None:
    ego = [ego_at(CROSSING, "eo_0", s) for s in (35.0, 41.0)]
    above = Agent("x", "br_0", 95.0, 10.0), Agent("x", "br_0", 100.0, 10.0)
    assert boxes_overlap(
        np.array([48.5, -1.6, 0.0, 2.5, 0.9]), np.array([50.0, -2.5, pi / 2, 2.5, 0.9])
    )
    assert crash(CROSSING, (ego[0], above[0]), (ego[1], above[1]), ("wi", "eo")) == (None, None)


def test_what_sumo_reports_counts_and_unclear_is_at_fault() -> None:
    def step(*agents: Agent) -> tuple[str | None, Any, Any]:
        ego = ego_at(STRAIGHT, "a_1", 50.0)
        judge = referee(STRAIGHT, frame_of(STRAIGHT, 0.0, ego, *agents), *ROUTE)
        found = judge.observe(frame_of(STRAIGHT, 0.5, ego, *agents)._replace(collisions=("x",)))
        return found, judge.row()["collisions"], judge.row()["at_fault"]

    assert step() == ("collision", 1, True)
    assert step(Agent("x", "a_0", 50.0)) == ("collision", 1, True)
    assert step(Agent("x", "a_1", 44.9)) == ("collision", 1, False)
    assert step(Agent("x", "a_1", 46.0)) == ("collision", 1, False)  # the same pair is counted once
    assert step(Agent("x", "a_1", 46.0), Agent("y", "a_1", 53.0)) == ("collision", 2, True)


# --- lights ---


def lit(
    where: list[tuple[str, float, float]], colours: list[int], step: float = STEP
) -> tuple[int, int]:
    """Red and yellow runs of an ego at (lane, s, v), one a step, while the light of its link shows
    the colours."""
    route = edges(SIGNALLED, "wi", "eo")
    frames = [
        frame_of(
            SIGNALLED,
            k * step,
            ego_at(SIGNALLED, name, s, v, route=route),
            signals=lights(colour, RED, RED),
        )
        for k, ((name, s, v), colour) in enumerate(zip(where, colours, strict=True))
    ]
    judge = referee(SIGNALLED, frames[0], "wi", "eo", step=step)
    for frame in frames[1:]:
        judge.observe(frame)
    return judge.row()["red_lights_run"], judge.row()["yellow_run"]


def test_red_light_run() -> None:
    slow = [("wi_0", 55.5 + 5 * k, 10.0) for k in range(7)] + [(":we_0", 0.5, 10.0)]
    assert lit(slow, [RED] * 8) == (1, 0)
    assert lit(slow, [GREEN] * 8) == (0, 0)
    assert lit(slow, [GREEN] * 2 + [RED] * 6) == (1, 0)  # 29.5 m and 10 m/s: 1.7 m/s2
    assert lit(slow, [RED] * 7 + [GREEN]) == (0, 0)
    assert lit(slow, [GREEN] * 7 + [RED]) == (0, 0)
    assert lit(slow[:7], [RED] * 7) == (0, 0)


def test_red_light_run_over_a_lane_skipped_within_a_step() -> None:
    assert lit(
        [("wi_0", s, 24.0) for s in (15.5, 39.5, 63.5, 87.5)] + [("eo_0", 1.5, 24.0)],
        [RED] * 5,
        step=1.0,
    ) == (1, 0)


def test_whoever_could_not_stop_at_the_end_of_green_ran_no_light() -> None:
    near = [
        ("wi_0", 65.0, 15.0),
        ("wi_0", 72.0, 15.0),
        ("wi_0", 79.5, 15.0),
        ("wi_0", 87.0, 15.0),
        (":we_0", 4.5, 15.0),
    ]
    assert lit(near, [GREEN, GREEN, RED, RED, RED]) == (0, 0)  # 18 m at 15 m/s: 6.3 m/s2
    assert lit([("wi_0", 65.5, 15.0), *near[1:]], [GREEN, RED, RED, RED, RED]) == (
        0,
        0,
    )  # 24.5 m: 4.6 m/s2
    assert lit([("wi_0", 64.5, 15.0), *near[1:]], [GREEN, RED, RED, RED, RED]) == (
        1,
        0,
    )  # 25.5 m: 4.4 m/s2
    assert lit(near[2:], [RED, RED, RED]) == (0, 0)  # taken over too late
    stopped = [("wi_0", 72.0, 15.0), ("wi_0", 89.0, 0.0), ("wi_0", 89.5, 1.0), (":we_0", 0.5, 2.0)]
    assert lit(stopped, [GREEN, RED, RED, RED]) == (1, 0)  # it did stop


def test_yellow_run() -> None:
    way = [("wi_0", 80.0, 10.0), ("wi_0", 85.0, 10.0), (":we_0", 0.5, 10.0)]
    assert lit(way, [GREEN, YELLOW, YELLOW]) == (0, 0)  # 10 m at 10 m/s: 5 m/s2
    far = [("wi_0", 70.0, 10.0), ("wi_0", 75.0, 10.0), *way]
    assert lit(far, [GREEN, YELLOW, YELLOW, YELLOW, YELLOW]) == (0, 1)  # 20 m: 2.5 m/s2
    assert lit(far, [GREEN, YELLOW, YELLOW, YELLOW, RED]) == (0, 1)
    assert lit(far, [GREEN, GREEN, GREEN, GREEN, YELLOW]) == (0, 0)
    assert lit(far, [GREEN, YELLOW, YELLOW, RED, RED]) == (1, 0)


# --- imposed braking ---


def imposed(
    road: RoadMap,
    ego: Any,
    *agents: Agent,
    path: tuple[str, ...] = (),
    leader: str = "",
    decel: float = 3.5,
    signals: Any = None,
) -> float:
    """What the referee holds the ego responsible for when the first agent (by id) brakes."""
    faster = [a._replace(v=a.v + decel * STEP) if k == 0 else a for k, a in enumerate(agents)]
    judge = referee(
        road,
        frame_of(road, 0.0, ego, *faster, signals=signals),
        *(road.edge_ids[k] for k in ego.route),
    )
    frame = frame_of(road, STEP, ego, *agents, signals=signals)
    n = len(agents)
    none = np.zeros(0, np.int32)
    way = np.array([lane(road, name) for name in path], dtype=np.int32)
    judge.observe(
        frame._replace(leader=(leader,) + ("",) * (n - 1), paths=(way,) + (none,) * (n - 1))
    )
    return judge.row()["imposed_max_decel_mps2"]  # type: ignore[no-any-return]


def test_braking_for_the_ego_as_leader() -> None:
    ego = ego_at(STRAIGHT, "a_1", 60.0, 5.0, route=edges(STRAIGHT, *ROUTE))
    assert imposed(STRAIGHT, ego, Agent("x", "a_1", 30.0), leader="ego") == pytest.approx(3.5)
    assert imposed(STRAIGHT, ego, Agent("x", "a_1", 30.0), leader="ego", decel=1.9) == 0.0
    assert (
        imposed(STRAIGHT, ego, Agent("x", "a_1", 90.0), leader="y", path=("a_1", ":m_1", "b_1"))
        == 0.0
    )  # it is in front


def test_braking_for_an_ego_on_the_path() -> None:
    ego = ego_at(STRAIGHT, "b_1", 5.0, 5.0, route=edges(STRAIGHT, "b", "c"))
    way = ("a_1", ":m_1", "b_1")
    assert imposed(STRAIGHT, ego, Agent("x", "a_1", 180.0), path=way) == pytest.approx(3.5)
    assert (
        imposed(STRAIGHT, ego, Agent("x", "a_1", 120.0, 11.0), path=way) == 0.0
    )  # 90 m ahead, more than 4 s
    assert imposed(STRAIGHT, ego, Agent("x", "a_1", 195.0, 0.5), path=way) == 0.0  # 15 m ahead
    assert (
        imposed(STRAIGHT, ego, Agent("x", "a_0", 190.0), path=("a_0", ":m_0", "b_0")) == 0.0
    )  # a neighbour
    changing = ego._replace(
        changing=0.2, change_from=lane(STRAIGHT, "b_1"), change_to=lane(STRAIGHT, "b_0")
    )
    assert imposed(
        STRAIGHT, changing, Agent("x", "a_0", 190.0), path=("a_0", ":m_0", "b_0")
    ) == pytest.approx(3.5)


def test_braking_for_an_ego_whose_rear_is_still_on_the_path() -> None:
    route = edges(STRAIGHT, "a", "d")
    ways = [
        ego_at(STRAIGHT, name, s, 4.0, route=route)
        for name, s in (("a_0", 199.0), (":mr_0", 1.0), (":mr_0", 3.0))
    ]
    judge = referee(STRAIGHT, frame_of(STRAIGHT, 0.0, ways[0]), "a", "d")
    path = np.array([lane(STRAIGHT, name) for name in ("a_0", ":m_0", "b_0")], dtype=np.int32)
    judge.observe(frame_of(STRAIGHT, 0.5, ways[1], Agent("x", "a_0", 185.0, 10.0)))
    judge.observe(
        frame_of(STRAIGHT, 1.0, ways[2], Agent("x", "a_0", 189.0, 8.5))._replace(paths=(path,))
    )
    assert judge.row()["imposed_max_decel_mps2"] == pytest.approx(3.0)


def test_braking_for_a_conflict_area() -> None:
    way, route = ("wi_0", ":we_0", "eo_0"), edges(CROSSING, "si", "no")
    oncoming = Agent("x", "wi_0", 70.0)
    assert imposed(
        CROSSING, ego_at(CROSSING, ":sn_0", 8.0, 4.0, route=route), oncoming, path=way
    ) == pytest.approx(3.5)
    assert imposed(
        CROSSING, ego_at(CROSSING, "si_0", 85.0, 8.0, route=route), oncoming, path=way
    ) == pytest.approx(3.5)  # in it within 2 s
    assert (
        imposed(CROSSING, ego_at(CROSSING, "si_0", 85.0, 2.0, route=route), oncoming, path=way)
        == 0.0
    )
    assert (
        imposed(CROSSING, ego_at(CROSSING, ":sn_0", 18.0, 4.0, route=route), oncoming, path=way)
        == 0.0
    )  # has left it
    assert (
        imposed(
            CROSSING,
            ego_at(CROSSING, ":sn_0", 8.0, 4.0, route=route),
            Agent("x", "wi_0", 20.0),
            path=way,
        )
        == 0.0
    )  # too far
    assert (
        imposed(
            CROSSING,
            ego_at(CROSSING, ":sn_0", 8.0, 4.0, route=route),
            Agent("x", ":we_0", 15.0),
            path=way[1:],
        )
        == 0.0
    )  # has passed it


def test_not_for_the_ego_on_a_bridge() -> None:
    assert (
        imposed(CROSSING, ego_at(CROSSING, "br_0", 100.0), Agent("x", "eo_0", 30.0), path=("eo_0",))
        == 0.0
    )


def test_braking_before_a_red_light_is_not_for_the_ego_behind_it() -> None:
    way, ego = (
        ("wi_0", ":we_0", "eo_0"),
        ego_at(SIGNALLED, ":sn_0", 8.0, 4.0, route=edges(SIGNALLED, "si", "no")),
    )
    assert (
        imposed(SIGNALLED, ego, Agent("x", "wi_0", 70.0), path=way, signals=lights(RED, GREEN, RED))
        == 0.0
    )
    assert imposed(
        SIGNALLED, ego, Agent("x", "wi_0", 70.0), path=way, signals=lights(GREEN, GREEN, RED)
    ) == pytest.approx(3.5)
    waits = ego_at(SIGNALLED, "si_0", 85.0, 8.0, route=edges(SIGNALLED, "si", "no"))
    assert (
        imposed(
            SIGNALLED, waits, Agent("x", "wi_0", 70.0), path=way, signals=lights(GREEN, RED, RED)
        )
        == 0.0
    )


def test_where_paths_merge_only_the_one_behind_brakes_for_the_other() -> None:
    way, route = ("si_0", ":sn_0", "no_0"), edges(CROSSING, "wi", "no")
    assert imposed(
        CROSSING,
        ego_at(CROSSING, ":wn_0", 12.0, 6.0, route=route),
        Agent("x", ":sn_0", 3.0, 6.0),
        path=way[1:],
    ) == pytest.approx(3.5)
    assert (
        imposed(
            CROSSING,
            ego_at(CROSSING, ":wn_0", 6.0, 6.0, route=route),
            Agent("x", ":sn_0", 15.0, 6.0),
            path=way[1:],
        )
        == 0.0
    )


def test_imposed_events_are_a_second_apart() -> None:
    ego = ego_at(STRAIGHT, "a_1", 60.0, 5.0)
    # time, deceleration that the follower begins to show
    shown = [2.5, 3.5, 4.5, 0.0, 2.5, 0.0, 0.0, 0.0, 2.2]
    v = 30.0
    judge = referee(STRAIGHT, frame_of(STRAIGHT, 0.0, ego, Agent("x", "a_1", 30.0, v)), *ROUTE)
    for k, decel in enumerate(shown, 1):
        v -= decel * STEP
        judge.observe(
            frame_of(STRAIGHT, k * STEP, ego, Agent("x", "a_1", 30.0, v))._replace(leader=("ego",))
        )
    row = judge.row()
    assert row["imposed_max_decel_mps2"] == pytest.approx(4.5)
    assert (row["imposed_brakes_2"], row["imposed_brakes_3"], row["imposed_brakes_4"]) == (2, 1, 1)


# --- the rest of the row ---


def test_motion_in_the_row() -> None:
    speeds = [10.0, 10.0, 7.0, 4.0, 0.05, 0.0, 1.0, 16.0]
    s, judge = (
        20.0,
        referee(STRAIGHT, frame_of(STRAIGHT, 0.0, ego_at(STRAIGHT, "a_1", 20.0, 10.0)), *ROUTE),
    )
    for k, v in enumerate(speeds[1:], 1):
        s += v * STEP
        judge.observe(frame_of(STRAIGHT, k * STEP, ego_at(STRAIGHT, "a_1", s, v)))
    row = judge.row()
    assert row["distance_m"] == pytest.approx(s - 20.0)
    assert row["stopped_s"] == pytest.approx(1.0)
    assert row["max_decel_mps2"] == pytest.approx(7.9)
    assert row["hard_brakes"] == 1
    assert row["speeding_share"] == pytest.approx(1 / 7)
    assert row["comfortable_share"] < 0.5
    assert row["rms_jerk_mps3"] > 0
    assert row["outcome"] is None
    assert row["lane_changes"] == 0
    assert row["min_ttc_s"] is None


def test_speeding_allows_the_vehicles_own_factor() -> None:
    ego = ego_at(STRAIGHT, "a_1", 20.0, 16.5)._replace(speed_factor=1.1)
    judge = referee(STRAIGHT, frame_of(STRAIGHT, 0.0, ego), *ROUTE)
    judge.observe(frame_of(STRAIGHT, 0.5, ego))
    assert judge.row()["speeding_share"] == 0.0


def test_surrogates_keep_the_worst() -> None:
    ego = ego_at(STRAIGHT, "a_1", 20.0)
    judge = referee(STRAIGHT, frame_of(STRAIGHT, 0.0, ego), *ROUTE)
    for k, (ttc, pet, drac) in enumerate(
        [(nan, nan, nan), (3.0, nan, 1.0), (2.0, nan, 0.5), (nan, nan, nan)], 1
    ):
        judge.observe(frame_of(STRAIGHT, k * STEP, ego)._replace(ttc=ttc, pet=pet, drac=drac))
    row = judge.row()
    assert (row["min_ttc_s"], row["min_pet_s"], row["max_drac_mps2"]) == (2.0, None, 1.0)


def test_lane_changes_across_a_junction_and_a_full_width_of_the_road() -> None:
    judge, _ = drive(
        STRAIGHT,
        [("a_0", 190.0), ("a_1", 195.0), (":m_1", 1.0), (":m_1", 6.0), ("b_1", 3.0), ("b_0", 8.0)],
        ROUTE,
    )
    assert judge.row()["lane_changes"] == 2
    assert judge.row()["distance_m"] == pytest.approx(28.0)


def test_helpers_place_boxes_behind_their_front() -> None:
    x, y, heading = place(CROSSING, ":we_0", 10.0, 5.0)
    assert (x, y, heading) == (-2.5, -1.6, 0.0)
    assert hypot(*np.subtract(place(CROSSING, "si_0", 50.0, 5.0, 1.0)[:2], (0.6, -52.5))) < 1e-9
