"""The referee on small hand-made roads: each outcome, and the rest of the row."""

from math import hypot, inf, nan
from typing import Any

import numpy as np
import pytest
from helpers import (
    Agent,
    Lane,
    build,
    edges,
    ego_at,
    frame_of,
    place,
)
from helpers_referee import CROSSING, ROUTE, STEP, STRAIGHT, drive, referee

from sumo_mcts.evaluation.goal import Goal
from sumo_mcts.evaluation.referee import Referee
from sumo_mcts.road import VEHICLE_CLASSES
from sumo_mcts.scene import Frame


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


def test_speeding_is_by_the_limit_of_the_class_of_the_vehicle() -> None:
    truck = VEHICLE_CLASSES.index("truck")
    row = np.full(len(VEHICLE_CLASSES), -1, np.int32)
    row[truck] = 0
    road = STRAIGHT._replace(class_row=row, class_speed=np.full((1, len(STRAIGHT.speed)), 10.0))
    shares = []
    for vclass in (0, truck):
        ego = ego_at(road, "a_1", 20.0, 14.0)._replace(vclass=vclass)
        judge = referee(road, frame_of(road, 0.0, ego), *ROUTE)
        judge.observe(frame_of(road, 0.5, ego))
        shares.append(judge.row()["speeding_share"])
    assert shares == [0.0, 1.0]


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
