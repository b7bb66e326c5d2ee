"""The row of an ego and the path that it came, worked out by hand on small roads."""

from math import inf, nan
from typing import Any

import numpy as np
import pytest
from helpers import Lane, build, edge, edges, ego_at, frame_of, lane
from helpers_referee import ROUTE, STEP, STRAIGHT, drive, referee

from sumo_mcts.evaluation.goal import Goal
from sumo_mcts.evaluation.own_side import OwnSide
from sumo_mcts.evaluation.reachability import driven
from sumo_mcts.evaluation.referee import Referee, _match
from sumo_mcts.road import RoadChanges, RoadMap


def row_of(*speeds: float, step: float = STEP) -> dict[str, Any]:
    """The row of an ego with these speeds, one for each state."""
    s, judge = 20.0, None
    for k, v in enumerate(speeds):
        s += v * step if k else 0.0
        frame = frame_of(STRAIGHT, k * step, ego_at(STRAIGHT, "a_1", s, v))
        if judge is None:
            judge = referee(STRAIGHT, frame, *ROUTE, step=step)
        else:
            judge.observe(frame)
    assert judge is not None
    return judge.row()


def test_who_never_brakes_has_no_deceleration() -> None:
    row = row_of(5.0, 5.0, 6.0)
    assert (row["max_decel_mps2"], row["hard_brakes"]) == (0.0, 0)
    assert row_of(5.0, 4.9)["max_decel_mps2"] == pytest.approx(0.2)


def test_hard_brakes_are_harder_than_4_5_and_a_second_apart() -> None:
    assert row_of(9.0, 6.75)["hard_brakes"] == 0  # 4.5 m/s2
    assert row_of(9.0, 6.7)["hard_brakes"] == 1
    assert row_of(14.0, 11.0, 11.0, 8.0)["hard_brakes"] == 1  # half a second of quiet
    assert row_of(14.0, 11.0, 11.0, 11.0, 8.0)["hard_brakes"] == 2


def test_stops_are_counted_in_steps() -> None:
    row = row_of(5.0, 0.0, 0.05, 3.0, 0.0, 0.0, 0.09, 3.0, 0.11)
    assert (row["stopped_s"], row["longest_stop_s"]) == (2.5, 1.5)
    assert row_of(0.0, 3.0)["stopped_s"] == 0.0  # the take-over is no step


@pytest.mark.parametrize(
    ("speed", "faster"), [(5.65, 0.0), (5.7, 0.0), (5.75, 1.0), (5.72, 1.0), (4.0, 0.0)]
)
def test_too_fast_is_who_is_a_tenth_above_the_limit(speed: float, faster: float) -> None:
    """The limit is 5.6 m/s; 5.7 is a little more than 5.6 + 0.1 in numbers."""
    assert 5.7 > 5.6 + 0.1
    road = build([Lane("a", 0, ((0, 0), (200, 0)), speed=5.6)])
    ego = ego_at(road, "a_0", 20.0, speed)
    judge = referee(road, frame_of(road, 0.0, ego), "a")
    judge.observe(frame_of(road, STEP, ego))
    assert judge.row()["speeding_share"] == faster


def test_the_limit_is_that_of_the_moment() -> None:
    ego = ego_at(STRAIGHT, "a_1", 20.0, 12.0)
    here = lane(STRAIGHT, "a_1")
    columns = STRAIGHT.classes, STRAIGHT.change_left, STRAIGHT.change_right
    slower = RoadChanges(
        np.array([here], np.int32), np.array([10.0]), *(each[[here]] for each in columns)
    )
    judge = referee(STRAIGHT, frame_of(STRAIGHT, 0.0, ego), *ROUTE)
    shares = []
    for k, changes in enumerate((RoadChanges(), slower, slower, RoadChanges()), 1):
        judge.observe(frame_of(STRAIGHT, k * STEP, ego)._replace(changes=changes))
        shares.append(judge.row()["speeding_share"])
    assert shares == pytest.approx([0.0, 1 / 2, 2 / 3, 2 / 4])


@pytest.mark.parametrize(("s", "more"), [(150.0, 5.0), (197.0, 3.0), (200.0, 0.0), (201.0, 0.0)])
def test_before_it_is_taken_out_an_ego_drives_to_the_end_of_its_lane(s: float, more: float) -> None:
    """At most as far as it comes in the step: 5 m."""
    frames = [frame_of(STRAIGHT, STEP * k, ego_at(STRAIGHT, "c_1", s)) for k in range(3)]
    judge = referee(STRAIGHT, frames[0], *ROUTE)
    judge.observe(frames[1])
    judge.observe(frames[2]._replace(present=False, arrived=True))
    assert judge.row()["distance_m"] == pytest.approx(more)


def test_the_closest_and_the_strongest_stay_from_the_take_over_on() -> None:
    frame = frame_of(STRAIGHT, 0.0, ego_at(STRAIGHT, "a_1", 20.0, 0.0))

    def row(*seen: tuple[float, float, float]) -> tuple[float | None, ...]:
        frames = [
            frame._replace(time=k * STEP, ttc=ttc, pet=pet, drac=drac)
            for k, (ttc, pet, drac) in enumerate(seen)
        ]
        judge = referee(STRAIGHT, frames[0], *ROUTE)
        for each in frames[1:]:
            judge.observe(each)
        found = judge.row()
        return found["min_ttc_s"], found["min_pet_s"], found["max_drac_mps2"]

    nothing = nan, nan, nan
    assert row((1.0, 2.0, 3.0)) == row((1.0, 2.0, 3.0), nothing) == (1.0, 2.0, 3.0)
    assert row(nothing, nothing) == (None, None, None)
    assert row((2.0, 3.0, 1.0), (1.0, 2.0, 0.5), (3.0, 4.0, 2.0), nothing) == (1.0, 2.0, 2.0)


def test_a_lane_change_begins_once_and_counts_when_the_lane_is_another() -> None:
    """It begins at 0.5 s, and anew at 2 s, where its share of the next change is smaller."""
    shares = [0.0, 0.2, 0.6, 0.9, 0.1, 0.5, 0.5 - 1e-9, 0.0]
    names = ["a_0", "a_0", "a_1", "a_1", "a_1", "a_0", "a_0", "a_0"]
    states = [
        ego_at(STRAIGHT, name, 20.0 + 5.0 * k)._replace(changing=share)
        for k, (name, share) in enumerate(zip(names, shares, strict=True))
    ]
    judge = referee(STRAIGHT, frame_of(STRAIGHT, 0.0, states[0]), *ROUTE)
    assert judge._change_began == -inf
    began = []
    for k, ego in enumerate(states[1:], 1):
        judge.observe(frame_of(STRAIGHT, k * STEP, ego))
        began.append(judge._change_began)
    assert began == [0.5, 0.5, 0.5, 2.0, 2.0, 2.0, 2.0]
    assert judge.row()["lane_changes"] == 2


def test_a_change_at_once_begins_when_it_is_seen_and_one_under_way_at_the_take_over() -> None:
    judge, _ = drive(STRAIGHT, [("a_0", 20.0), ("a_0", 25.0), ("a_1", 30.0)], ROUTE)
    assert judge._change_began == 2 * STEP
    under_way = ego_at(STRAIGHT, "a_0", 20.0)._replace(changing=0.4)
    assert referee(STRAIGHT, frame_of(STRAIGHT, 3.0, under_way), *ROUTE)._change_began == 3.0


def test_a_collision_before_the_ego_is_on_the_road_is_one() -> None:
    """SUMO reports it; nothing else is known of the ego."""
    absent = frame_of(STRAIGHT, 0.0, ego_at(STRAIGHT, "a_1", 20.0))._replace(present=False)
    for taken_over in (absent, None):
        goal = Goal(edges(STRAIGHT, *ROUTE), -1, 100.0, 20.0)
        judge = Referee(STRAIGHT, goal, STEP, taken_over)
        assert judge.observe(absent._replace(time=STEP, collisions=("x",))) == "collision"
        row = judge.row()
        assert (row["collisions"], row["at_fault"], row["distance_m"]) == (1, True, 0.0)


@pytest.mark.parametrize("speeds", [(30.0, 1.0), (1.0, 30.0)])
def test_the_path_is_followed_as_far_as_the_faster_of_two_states_reaches(
    speeds: tuple[float, float],
) -> None:
    """24 m in half a second, over the junction and a lane to the right."""
    was, ego = (
        ego_at(STRAIGHT, *at) for at in zip(("a_1", "b_0"), (190.0, 4.0), speeds, strict=True)
    )
    judge = referee(STRAIGHT, frame_of(STRAIGHT, 0.0, was), *ROUTE)
    judge.observe(frame_of(STRAIGHT, STEP, ego))
    row = judge.row()
    assert (row["distance_m"], row["lane_changes"]) == (pytest.approx(24.0), 1)
    assert judge._trail == [lane(STRAIGHT, name) for name in (":m_1", "b_0")]


@pytest.mark.parametrize(("s", "driven"), [(3.0, 15.0), (11.0, 10.0), (73.0, 10.0)])
def test_who_was_put_somewhere_else_has_driven_by_its_speed(s: float, driven: float) -> None:
    """18 m or more in a step, where 7.5 m and 5 m are the most: the lanes behind are forgotten."""
    judge, _ = drive(STRAIGHT, [("a_1", 198.0), (":m_1", 3.0), ("b_1", s)], ROUTE)
    assert judge.row()["distance_m"] == pytest.approx(driven)
    assert (judge._trail == [lane(STRAIGHT, "b_1")]) is (s > 5.0)


def test_off_the_lanes_an_ego_has_no_trail_and_is_nowhere() -> None:
    """Neither is it off its route, whatever the last lane of the map is."""
    two = build([Lane("a", k, ((0, 3.2 * k), (200, 3.2 * k))) for k in range(2)])
    for road, name, route in ((STRAIGHT, "b_1", ROUTE), (two, "a_0", ("a",))):
        on = ego_at(road, name, 20.0)
        off = on._replace(lane=-1)
        judge = referee(road, frame_of(road, 0.0, off), *route)
        assert judge._trail == []
        for k, ego in enumerate((off, on._replace(s=25.0), off), 1):
            assert judge.observe(frame_of(road, k * STEP, ego)) is None
            assert judge._trail == ([on.lane] if ego.lane >= 0 else [])
        assert judge.row()["distance_m"] == pytest.approx(15.0)
        assert judge.row()["lane_changes"] == 0


def test_after_a_change_the_trail_is_on_the_other_lane() -> None:
    judge, _ = drive(STRAIGHT, [("a_1", 20.0), ("a_0", 25.0), ("a_0", 30.0)], ROUTE)
    assert judge._trail == [lane(STRAIGHT, "a_0")]


def test_who_is_taken_elsewhere_has_driven_nothing_more() -> None:
    frames = [frame_of(STRAIGHT, STEP * k, ego_at(STRAIGHT, "a_1", 150.0)) for k in range(3)]
    judge = referee(STRAIGHT, frames[0], *ROUTE)
    judge.observe(frames[1])
    assert judge.observe(frames[2]._replace(present=False, teleported=True)) == "teleported"
    assert judge.row()["distance_m"] == 0.0


@pytest.mark.parametrize(("success", "there"), [("", ("c_1", 199.0)), ("c", ("b_1", 199.0))])
def test_of_who_is_taken_out_at_its_goal_nothing_of_the_route_is_left(
    success: str, there: tuple[str, float]
) -> None:
    """81 s, of which free flow takes 20 s."""
    first = frame_of(STRAIGHT, 20.0, ego_at(STRAIGHT, "a_1", 0.0))
    judge = referee(STRAIGHT, first, *ROUTE, success=success, limit=200.0)
    judge._progress.advance([lane(STRAIGHT, name) for name in ("a_1", "b_1", there[0])])
    here = ego_at(STRAIGHT, *there, route=edges(STRAIGHT, *ROUTE))
    assert judge.observe(frame_of(STRAIGHT, 100.0, here)) is None
    gone = frame_of(STRAIGHT, 101.0, here)._replace(present=False, arrived=True)
    assert judge.observe(gone) == "arrived"
    assert judge.row()["time_lost_s"] == pytest.approx(81.0 - 20.0)


def test_on_the_edge_that_counts_the_rest_of_the_route_is_left() -> None:
    """200 m, 10 m and 200 m at 15 m/s."""
    first = frame_of(STRAIGHT, 0.0, ego_at(STRAIGHT, "a_1", 199.0))
    judge = referee(STRAIGHT, first, *ROUTE, success="b", limit=200.0)
    judge._goal = judge._goal._replace(free_flow=40.0)
    judge._progress.advance([lane(STRAIGHT, "b_1")])
    here = ego_at(STRAIGHT, "b_1", 0.0, route=edges(STRAIGHT, *ROUTE))
    assert judge.observe(frame_of(STRAIGHT, 80.0, here)) == "arrived"
    assert judge.row()["time_lost_s"] == pytest.approx(80.0 - (40.0 - 410.0 / 15.0))


@pytest.mark.parametrize(("strength", "counts"), [(3.0, [0]), (3.1, [1]), (9.1, [1])])
def test_braking_imposed_on_others_counts_where_it_is_stronger(
    strength: float, counts: list[int]
) -> None:
    judge, _ = drive(STRAIGHT, [("a_1", 20.0), ("a_1", 25.0)], ROUTE)
    judge._imposed = [(0.5, strength - 0.5), (1.0, strength)]
    row = judge.row()
    assert row["imposed_max_decel_mps2"] == strength
    found = {int(key[15:]): row[key] for key in row if key.startswith("imposed_brakes_")}
    assert found == {limit: int(strength > limit) for limit in found} and 3 in found
    assert [found[3]] == counts


def test_a_new_route_with_another_end_is_a_new_goal() -> None:
    """Onto d, where it then may be and arrives."""
    states = [("a_0", 190.0, "c"), ("a_0", 195.0, "d"), (":mr_0", 0.5, "d"), ("d_0", 1.0, "d")]
    egos = [
        ego_at(STRAIGHT, name, s, route=edges(STRAIGHT, "a", *ROUTE[1:2] * (end == "c"), end))
        for name, s, end in states
    ]
    judge = referee(STRAIGHT, frame_of(STRAIGHT, 0.0, egos[0]), *ROUTE)
    for k, ego in enumerate(egos[1:], 1):
        assert judge.observe(frame_of(STRAIGHT, k * STEP, ego)) is None
    taken_out = frame_of(STRAIGHT, 2.0, egos[-1])._replace(present=False, arrived=True)
    assert judge._goal.edges[-1] == edge(STRAIGHT, "d")
    assert judge.observe(taken_out) == "arrived"
    # and another one again
    judge = referee(STRAIGHT, frame_of(STRAIGHT, 0.0, egos[0]), *ROUTE)
    for k, (ego, end) in enumerate(((egos[1], "d"), (egos[0]._replace(s=196.0), "c")), 1):
        judge.observe(frame_of(STRAIGHT, k * STEP, ego))
        assert judge._goal.edges[-1] == edge(STRAIGHT, end)
    # the same route again, or a shorter one with the same end, leaves the goal as it is
    judge = referee(STRAIGHT, frame_of(STRAIGHT, 0.0, egos[0]), *ROUTE)
    goal = judge._goal
    ahead = ego_at(STRAIGHT, "b_1", 5.0, route=edges(STRAIGHT, "b", "c"))
    judge.observe(frame_of(STRAIGHT, STEP, ahead))
    assert judge._goal is goal


@pytest.mark.parametrize(
    ("before", "now", "places"),
    [
        (("a", "b"), ("a", "b"), [0, 1]),
        (("a", "b"), ("b", "c", "a"), [1, -1, 0]),
        (("a",), (), []),
        ((), ("a",), [-1]),
    ],
)
def test_where_each_stood_before(
    before: tuple[str, ...], now: tuple[str, ...], places: list[int]
) -> None:
    assert _match(before, now).tolist() == places


# --- on the lane of the oncoming traffic ---


def turn_round(angle: float = 0.0) -> RoadMap:
    """A road of 100 m that leads somewhere, back beside it, and round at its end; turned about the
    origin."""
    c, s = np.cos(angle), np.sin(angle)

    def at(*points: tuple[float, float]) -> list[tuple[float, float]]:
        return [(7.0 + c * x - s * y, 5.0 + s * x + c * y) for x, y in points]

    return build([
        Lane("there", 0, at((0, 0), (100, 0)), (":t_0",)),
        Lane(":t", 0, at((100, 0), (102, 1.6), (100, 3.2)), ("back_0",), junction="t"),
        Lane("back", 0, at((100, 3.2), (0, 3.2))),
    ])  # fmt: skip


TURN_ROUND = turn_round()


@pytest.mark.parametrize(
    ("speeds", "crosses"),
    [((10.0, 1.0), False), ((1.0, 10.0), False), ((5.0, 2.0), True), ((2.0, 5.0), True)],
)
def test_who_turns_round_drives_there_and_who_overtakes_crosses_over(
    speeds: tuple[float, float], crosses: bool
) -> None:
    """Back along the road it is 11 m by the turning, and half as much again as 10 m/s in half a
    second, and 5 m, is further; its heading tells nothing yet."""
    before = ego_at(TURN_ROUND, "there_0", 98.0, speeds[0])
    s = 9.0 - float(TURN_ROUND.length[1])
    after = ego_at(TURN_ROUND, "back_0", s, speeds[1])._replace(heading=0.0)
    assert driven(TURN_ROUND, 0, 98.0, 2, s, 11.1) is not None
    frame = frame_of(TURN_ROUND, STEP, after)
    seen = OwnSide(TURN_ROUND, STEP).seen(before, frame)
    assert (seen.ego.lane == before.lane) is crosses
    assert (seen is frame) is not crosses


@pytest.mark.parametrize("angle", [0.0, 1.0, 2.5, -1.2])
@pytest.mark.parametrize(
    ("turned", "crosses"), [(0.3, True), (-1.4, True), (2.8, False), (1.7, False)]
)
def test_who_crosses_over_drives_against_the_lane_that_it_comes_to(
    angle: float, turned: float, crosses: bool
) -> None:
    """`turned`: its heading, as seen along its own road."""
    road = turn_round(angle)
    over = ego_at(road, "back_0", 60.0)._replace(heading=angle + turned)
    frame = frame_of(road, STEP, over)
    seen = OwnSide(road, STEP).seen(ego_at(road, "there_0", 35.0), frame)
    assert (seen.ego.lane, seen.ego.s) == (
        (0, pytest.approx(40.0)) if crosses else (over.lane, 60.0)
    )


def test_only_a_lane_of_another_road_is_crossed_over_to() -> None:
    """Backwards on its own road or inside a junction it has crossed over nothing."""
    for here, at, there, s in (("a_1", 2.0, "a_0", 150.0), ("a_1", 20.0, ":m_0", 2.0)):
        before = ego_at(STRAIGHT, here, at)
        frame = frame_of(STRAIGHT, STEP, ego_at(STRAIGHT, there, s)._replace(heading=3.1))
        assert OwnSide(STRAIGHT, STEP).seen(before, frame) is frame


def test_back_on_its_own_side_or_off_the_lanes_it_is_where_it_is() -> None:
    own = ego_at(TURN_ROUND, "there_0", 20.0)
    over = ego_at(TURN_ROUND, "back_0", 75.0)._replace(heading=0.0)
    for after in (own._replace(s=30.0), own._replace(lane=-1)):
        side = OwnSide(TURN_ROUND, STEP)
        first = side.seen(own, frame_of(TURN_ROUND, STEP, over)).ego
        assert (first.lane, first.s) == (own.lane, pytest.approx(25.0))
        frame = frame_of(TURN_ROUND, 2 * STEP, after)
        assert side.seen(first, frame) is frame
        again = frame_of(TURN_ROUND, 3 * STEP, own._replace(s=35.0))
        assert side.seen(after, again) is again
