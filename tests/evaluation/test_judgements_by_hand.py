"""What parts of the referee say, on small hand-made roads: blame, braking, lights, goals."""

from math import inf, isnan, nan, pi

import numpy as np
import pytest
from helpers import Agent, Conflict, Lane, build, edge, edges, ego_at, frame_of, lane, lights
from helpers_referee import CROSSING, ROUTE, SIGNALLED, STEP, STRAIGHT, drive, referee

from sumo_mcts.evaluation.contact import Contact
from sumo_mcts.evaluation.fault import (
    Conduct,
    _half_sizes,
    _hit_by_other,
    _moves,
    _overtook_into,
    _shifts,
    _stands_on_junction,
    _violates_right_of_way,
    is_at_fault,
)
from sumo_mcts.evaluation.goal import Goal, RouteProgress
from sumo_mcts.evaluation.imposed import (
    MIN_PATH,
    Stretch,
    _coming,
    _is_in_path,
    _next_on_route,
    braking_for_ego,
    lanes_under,
)
from sumo_mcts.evaluation.lights import LightRecord, _lit
from sumo_mcts.evaluation.metrics import events, free_flow_time
from sumo_mcts.evaluation.own_side import OwnSide
from sumo_mcts.evaluation.reachability import can_meet, driven, spread
from sumo_mcts.evaluation.standing import stands_at_green
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import GREEN, RED, EgoState, Frame, Signals
from sumo_mcts.world.oncoming import with_oncoming

# --- blame ---


@pytest.mark.parametrize(
    ("ego_half", "other_half", "front", "other_hit"),
    [
        (2.5, 8.0, -0.2, True),  # the middle of the overlap is in the last quarter of the ego
        (2.5, 8.0, 0.2, False),
        (8.0, 2.5, -5.6, True),  # and in the first quarter of the other
        (8.0, 2.5, -5.4, False),
    ],
)
def test_of_boxes_deep_in_each_other_only_who_came_from_behind_is_known(
    ego_half: float, other_half: float, front: float, other_hit: bool
) -> None:
    """`front`: where the other's front is, from the middle of the ego."""
    sizes = np.array([ego_half, 0.9]), np.array([other_half, 0.8])
    contact = Contact((0.0, 0.0, 0.0), (front - other_half, 0.0, 0.0), *sizes, False)
    assert _hit_by_other(contact, False) is other_hit
    assert _hit_by_other(contact, True) is other_hit  # drifting tells nothing here


@pytest.mark.parametrize(
    ("other", "drifts", "other_hit"),
    [
        ((-4.95, 0.0, 0.0), False, True),  # its front into the rear
        ((4.95, 0.0, 0.0), False, False),  # the ego's front into its rear
        ((0.0, -3.35, pi / 2), False, True),  # its front into the side
        ((0.0, 1.75, 0.0), False, False),  # side against side: nobody knows
        ((0.0, 1.75, 0.0), True, True),  # but it came over
        ((4.95, 0.0, pi), False, False),  # front against front
    ],
)
def test_where_two_touched_says_who_hit(
    other: tuple[float, float, float], drifts: bool, other_hit: bool
) -> None:
    half = np.array([2.5, 0.9])
    assert _hit_by_other(Contact((0.0, 0.0, 0.0), other, half, half, True), drifts) is other_hit


@pytest.mark.parametrize("name", ["a_0", "a_1"])
def test_who_is_hit_from_behind_is_not_at_fault_on_any_lane(name: str) -> None:
    frames = [
        frame_of(STRAIGHT, k * STEP, ego_at(STRAIGHT, name, 50.0 + k, 2.0), Agent("x", name, s))
        for k, s in enumerate((43.0, 49.0))
    ]
    judge = referee(STRAIGHT, frames[0], *ROUTE)
    assert judge.observe(frames[1]) == "collision"
    assert judge.row()["at_fault"] is False


@pytest.mark.parametrize(("began", "fault"), [(0.2, False), (0.3, False), (0.4, True)])
def test_a_lane_change_counts_for_three_seconds_to_the_rounding(began: float, fault: bool) -> None:
    ego = ego_at(STRAIGHT, "a_1", 50.0, 2.0)
    before = frame_of(STRAIGHT, 3.2, ego, Agent("x", "a_1", 44.2))
    frame = frame_of(STRAIGHT, 3.3, ego, Agent("x", "a_1", 45.2))
    body = [Stretch(ego.lane, 45.0, 50.0, 50.0)]
    touching = Contact((0.0, 0.0, 0.0), (-4.95, 0.0, 0.0), *_half_sizes(ego, frame.agents, 0), True)
    conduct = Conduct(body, began, -1, {})
    assert is_at_fault(STRAIGHT, conduct, 0.1, before, frame, "x", touching) is fault


@pytest.mark.parametrize(
    ("then", "now", "speeds", "moves"),
    [
        ((50.0, 3.0), (50.0, 3.0), (0.0, 0.0), False),
        ((50.0, 3.0), (50.0, 3.0), (0.2, 0.0), True),  # it has just stopped
        ((50.0, 3.0), (50.0, 3.0), (0.0, 0.2), True),
        ((50.0, 3.0), (50.0, 3.2), (0.0, 0.0), True),  # it was moved to the side, by 0.2 m
        ((50.0, 3.0), (50.2, 3.0), (0.0, 0.0), True),
        ((50.0, 3.0), (50.0, 3.04), (0.0, 0.0), False),  # in half a second, 0.08 m/s
    ],
)
def test_who_stands_does_not_move(
    then: tuple[float, float], now: tuple[float, float], speeds: tuple[float, float], moves: bool
) -> None:
    agents = [
        frame_of(
            STRAIGHT,
            k,
            ego_at(STRAIGHT, "c_1", 50.0),
            Agent("x", "", v=speeds[k], x=at[0], y=at[1]),
        ).agents
        for k, at in enumerate((then, now))
    ]
    assert _moves(agents[0], 0, agents[1], 0, 0.5) is moves
    assert _moves(agents[0], -1, agents[1], 0, 0.5) is (speeds[1] > 0.1)  # not there before


def test_a_collision_that_boxes_do_not_show_is_judged_by_where_they_are() -> None:
    """The other's front is in the last quarter of the ego, or only just behind its middle."""
    for s, fault in ((46.5, False), (48.0, True)):
        ego = ego_at(STRAIGHT, "a_1", 50.0, 2.0)
        frames = [frame_of(STRAIGHT, k, ego, Agent("x", "a_1", s, 5.0)) for k in range(2)]
        conduct = Conduct([Stretch(ego.lane, 45.0, 50.0, 50.0)], -inf, -1, {})
        assert is_at_fault(STRAIGHT, conduct, 0.5, *frames, "x", None) is fault


def test_half_sizes() -> None:
    agents = frame_of(
        STRAIGHT,
        0.0,
        ego_at(STRAIGHT, "a_1", 50.0),
        Agent("x", "a_0", 40.0, length=12.0, width=2.5),
    ).agents
    own, other = _half_sizes(ego_at(STRAIGHT, "a_1", 50.0), agents, 0)
    assert own.tolist() == [2.5, 0.9] and other.tolist() == [6.0, 1.25]


@pytest.mark.parametrize(
    ("s", "other", "yields"),
    [
        (5.0, 12.0, False),  # it is not in the area yet, which begins at 6.2 m
        (8.0, 12.0, True),
        (15.0, 12.0, True),  # its rear is at 10 m, the area ends at 10.6 m
        (16.0, 12.0, True),  # at 11 m, but half a second ago at 10 m
        (17.0, 12.0, False),  # it was out of it a step ago, not a second
        (18.0, 12.0, False),  # it was out of it a step ago
        (8.0, 40.0, False),  # the other is long gone
    ],
)
def test_right_of_way_is_violated_inside_the_area(s: float, other: float, yields: bool) -> None:
    ego = ego_at(CROSSING, ":sn_0", s, 2.0, route=edges(CROSSING, "si", "no"))
    on = (":we_0", other) if other < 20.0 else ("eo_0", other)
    frame = frame_of(CROSSING, 1.0, ego, Agent("x", *on, 4.0))
    conduct = Conduct([Stretch(ego.lane, s - 5.0, s, s)], -inf, -1, {})
    assert _violates_right_of_way(CROSSING, conduct, STEP, frame, 0) is yields
    runner = conduct._replace(red_runners={"x": int(CROSSING.junction[ego.lane])})
    assert not _violates_right_of_way(CROSSING, runner, STEP, frame, 0)
    against_red = conduct._replace(red_junction=int(CROSSING.junction[ego.lane]))
    assert _violates_right_of_way(CROSSING, against_red, STEP, frame, 0)


def test_off_the_lanes_the_ego_has_no_right_of_way() -> None:
    ego = ego_at(CROSSING, "si_0", 50.0)._replace(lane=-1)
    frame = frame_of(CROSSING, 1.0, ego, Agent("x", "si_0", 46.0))
    assert _violates_right_of_way(CROSSING, Conduct([], -inf, -1, {}), STEP, frame, 0)


def test_only_who_faces_the_ego_is_met_head_on() -> None:
    """On lanes that lead north."""
    lanes = [Lane("a", 0, ((0, 0), (0, 400))), Lane("b", 0, ((-3.2, 400), (-3.2, 0)))]
    road = with_oncoming(build(lanes), {0: 1, 1: 0})
    ego = ego_at(road, "a_1", 100.0)
    body = [Stretch(ego.lane, 95.0, 100.0, 100.0)]
    for heading, verdict in ((pi / 2, None), (-pi / 2, True)):
        x = Agent("x", "", x=-3.2, y=102.0, heading=heading)
        assert _overtook_into(road, body, frame_of(road, 0.0, ego, x), 0) is verdict


@pytest.mark.parametrize(
    ("others", "stands"),
    [
        ((), True),
        ((("eo_0", 6.0, 0.0),), False),  # a queue: its rear is 3 m ahead
        ((("eo_0", 9.0, 0.0),), True),  # 6 m ahead
        ((("eo_0", 6.0, 1.5),), True),  # it drives off
        (((":we_0", 8.0, 0.0),), True),  # it is behind
        (((":sn_0", 20.0, 0.0),), True),  # it stands elsewhere
    ],
)
def test_who_stands_on_a_junction_needs_a_reason(
    others: tuple[tuple[str, float, float], ...], stands: bool
) -> None:
    """The front of the ego is 2 m before the end of the junction."""
    ego = ego_at(CROSSING, ":we_0", 18.0, 0.0)
    hits = Agent("hits", "eo_0", 6.5, 0.5)  # it is slow and ahead, but no reason
    those = [Agent(f"x{k}", *each) for k, each in enumerate(others)]
    frame = frame_of(CROSSING, 0.0, ego, hits, *those)
    body = [Stretch(ego.lane, 13.0, 18.0, 18.0)]
    assert _stands_on_junction(CROSSING, body, frame, 0) is stands
    assert not _stands_on_junction(CROSSING, body, frame._replace(ego=ego._replace(v=0.2)), 0)


@pytest.mark.parametrize(
    ("was", "now", "moved"),
    [
        (("a_0", 0.0), ("a_0", 0.01), False),
        (("a_0", 0.0), ("a_0", 0.03), True),
        (("a_0", 0.0), ("a_0", -0.03), True),
        (("a_0", 0.0), ("a_1", 0.0), True),
        (("a_0", 0.0), (":m_0", 0.0), False),  # onto the next edge
        (("d_0", 0.0), ("", 0.0), False),
        (("", 0.0), ("d_0", 0.0), False),
    ],
)
def test_who_moved_sideways(was: tuple[str, float], now: tuple[str, float], moved: bool) -> None:
    before, after = (
        frame_of(STRAIGHT, k, ego_at(STRAIGHT, "c_1", 50.0), Agent("x", on, 9.0, d=d)).agents
        for k, (on, d) in enumerate((was, now))
    )
    assert _shifts(STRAIGHT, before, 0, after, 0) is moved


# --- braking ---


def braked(
    road: RoadMap, ego: EgoState, agent: Agent, path: tuple[str, ...] = (), leader: str = ""
) -> bool:
    """Whether an agent that brakes with 3.5 m/s2 in half a second brakes for the ego."""
    faster = agent._replace(v=agent.v + 1.75)
    way = np.array([lane(road, name) for name in path], np.int32)
    frame = frame_of(road, STEP, ego, agent)._replace(leader=(leader,), paths=(way,))
    before = frame_of(road, 0.0, ego, faster)
    known = np.zeros(1, np.int32)
    return bool(braking_for_ego(road, [ego.lane], STEP, before, frame, known))


def test_people_do_not_brake() -> None:
    ego = ego_at(STRAIGHT, "a_1", 60.0)
    assert braked(STRAIGHT, ego, Agent("x", "a_1", 30.0, 1.0), leader="ego")
    assert not braked(STRAIGHT, ego, Agent("x", "", v=1.0, x=30.0), leader="ego")


@pytest.mark.parametrize(("s", "brakes"), [(97.0, True), (103.0, True), (104.5, False)])
def test_the_ego_is_in_the_way_for_four_seconds_on_the_same_lane(s: float, brakes: bool) -> None:
    """At 11.75 m/s: 47 m up to its rear, which is 5 m behind its front."""
    ego = ego_at(STRAIGHT, "a_1", s, 5.0)
    assert braked(STRAIGHT, ego, Agent("x", "a_1", 52.0), ("a_1",)) is brakes


def test_an_ego_behind_is_no_reason_to_brake() -> None:
    ego = ego_at(STRAIGHT, "a_1", 50.0, 5.0)
    assert not braked(STRAIGHT, ego, Agent("x", "a_1", 52.0), ("a_1",))


@pytest.mark.parametrize(("s", "brakes"), [(75.0, True), (70.0, False)])
def test_a_conflict_area_counts_by_where_it_begins_on_the_agents_path(
    s: float, brakes: bool
) -> None:
    """It begins 9.4 m behind the line, 90 m from where the lane begins; at 6.75 m/s it is 27 m."""
    ego = ego_at(CROSSING, ":sn_0", 8.0, 4.0, route=edges(CROSSING, "si", "no"))
    path = ("wi_0", ":we_0", "eo_0")
    assert braked(CROSSING, ego, Agent("x", "wi_0", s, 5.0), path) is brakes


def test_for_an_ego_that_stands_where_paths_merge_only_who_is_behind_it_brakes() -> None:
    route = edges(CROSSING, "wi", "no")
    ego = ego_at(CROSSING, ":wn_0", 12.0, 0.0, route=route)  # 7 m before the end
    path = (":sn_0", "no_0")
    assert not braked(CROSSING, ego, Agent("x", ":sn_0", 15.5, 6.0), path)  # 4.5 m
    assert braked(CROSSING, ego, Agent("x", ":sn_0", 3.0, 6.0), path)  # 17 m


@pytest.mark.parametrize(("faster", "brakes"), [(1.0, False), (1.05, True)])
def test_who_brakes_with_two_metres_per_second_squared_does_not_brake_hard(
    faster: float, brakes: bool
) -> None:
    ego = ego_at(STRAIGHT, "a_1", 60.0)
    frames = [
        frame_of(STRAIGHT, STEP * k, ego, Agent("x", "a_1", 40.0, v))._replace(leader=("ego",))
        for k, v in enumerate((10.0 + faster, 10.0))
    ]
    found = braking_for_ego(STRAIGHT, [ego.lane], STEP, *frames, np.zeros(1, np.int32))
    assert bool(found) is brakes


def test_an_ego_whose_front_is_just_ahead_is_in_the_way() -> None:
    ego = ego_at(STRAIGHT, "a_1", 50.5, 5.0)
    assert braked(STRAIGHT, ego, Agent("x", "a_1", 50.0), ("a_1",))


@pytest.mark.parametrize(("s", "brakes"), [(60.5, True), (67.0, False)])
def test_who_is_slow_looks_a_few_metres_ahead_all_the_same(s: float, brakes: bool) -> None:
    """Ten metres to the rear of the ego, at 2 m/s, where 4 s are 8 m."""
    ego = ego_at(STRAIGHT, "a_1", s, 0.5)
    assert MIN_PATH == 10.0
    assert braked(STRAIGHT, ego, Agent("x", "a_1", 46.0, 0.25), ("a_1",)) is brakes


def test_the_first_lane_of_the_map_is_one() -> None:
    ego = ego_at(STRAIGHT, "a_0", 100.0)
    assert lane(STRAIGHT, "a_0") == 0
    assert [each.lane for each in lanes_under(STRAIGHT, ego, [0])] == [0]
    assert lanes_under(STRAIGHT, ego._replace(lane=-1), [0]) == []


def test_at_the_end_of_its_route_no_lane_is_next() -> None:
    """Whatever the number of the edge behind it."""
    names = "abcd"
    road = build([
        Lane(name, 0, ((50 * k, 0), (50 * k + 50, 0)), (f"{names[k + 1]}_0",) if k < 3 else ())
        for k, name in enumerate(names)
    ])  # fmt: skip
    for k in range(3):
        assert _next_on_route(road, k, tuple(range(k + 1))) == -1
        assert _next_on_route(road, k, tuple(range(k + 2))) == k + 1
        assert _next_on_route(road, k, (3,)) == -1  # off its route


# --- lights ---


def test_a_red_runner_is_one_until_it_has_left_the_junction() -> None:
    record = LightRecord(SIGNALLED)
    shown = lights(RED, GREEN, RED)
    ego = ego_at(SIGNALLED, "si_0", 20.0)
    others = Agent("a", "eo_0", 50.0), Agent("b", ":we_0", 6.0)
    junction = int(SIGNALLED.junction[lane(SIGNALLED, ":we_0")])
    record.note_state(shown, 0)

    def noted(before: tuple[Agent, ...], after: tuple[Agent, ...]) -> dict[str, int]:
        frames = [
            frame_of(SIGNALLED, k, ego, *those, signals=shown)
            for k, those in enumerate((before, after))
        ]
        ids = frames[0].agents.ids
        known = np.array(
            [ids.index(name) if name in ids else -1 for name in frames[1].agents.ids], np.int32
        )
        record.note_red_runners(*frames, known)
        return dict(record.red_runners)

    waits, runs = Agent("x", "wi_0", 89.0), Agent("x", ":we_0", 2.0)
    assert noted((waits,), (waits,)) == {}
    assert noted((*others, waits), (*others, runs)) == {"x": junction}
    rear_inside = Agent("x", "eo_0", 4.0)
    assert noted((*others, runs), (*others, rear_inside)) == {"x": junction}
    assert noted((*others, runs), others) == {}  # it has left the simulation


TWO = build(
    [
        Lane("p", 0, ((0, 0), (100, 0)), (":p_0",)),
        Lane(":p", 0, ((100, 0), (110, 0)), ("r_0",), junction="j", signal="one", link=0),
        Lane("r", 0, ((110, 0), (200, 0))),
        Lane("q", 0, ((0, 50), (100, 50)), (":q_0",)),
        Lane(":q", 0, ((100, 50), (110, 50)), ("t_0",), junction="k", signal="two", link=0),
        Lane("t", 0, ((110, 50), (200, 50))),
    ]
)


@pytest.mark.parametrize("shown", [(RED, GREEN), (GREEN, RED)])
def test_each_signal_has_its_own_links(shown: tuple[int, int]) -> None:
    signals = Signals(
        np.array([0, 1, 2], np.int32), np.array([shown], np.int32).T, np.full((2, 1), inf)
    )
    for k, (name, onto) in enumerate((("p", "r"), ("q", "t"))):
        route = edges(TWO, name, onto)
        ego = ego_at(TWO, f"{name}_0", 98.0, 0.0, route=route)
        stands = frame_of(TWO, 0.0, ego, signals=signals)
        assert stands_at_green(TWO, stands) is (shown[k] == GREEN)
        states = [
            ego_at(TWO, at, s, 8.0, route=route)
            for at, s in ((f"{name}_0", 94.0), (f"{name}_0", 98.0), (f":{name}_0", 2.0))
        ]
        record = LightRecord(TWO)
        frames = [frame_of(TWO, STEP * i, each, signals=signals) for i, each in enumerate(states)]
        for i in range(2):
            record.note_state(signals, i)
        inside = lane(TWO, f":{name}_0")
        record.cross_stop_line(frames[1], frames[2], inside, 30.0, [8.0, 8.0], [0.0, 28.0])
        assert (record.red, record.yellow) == (int(shown[k] == RED), 0)


def test_who_stays_in_its_lane_runs_no_light_whichever_is_red() -> None:
    """The light of the second lane of the map is."""
    signals = Signals(
        np.array([0, 1, 2], np.int32), np.array([[RED, GREEN]], np.int32).T, np.full((2, 1), inf)
    )
    record, ego = LightRecord(TWO), ego_at(TWO, "q_0", 20.0)
    assert record.red_junction not in range(len(TWO.junction_ids))
    record.note_state(signals, 0)
    frames = [
        frame_of(TWO, k, ego, Agent("x", "p_0", 40.0 + 5.0 * k), signals=signals) for k in range(2)
    ]
    record.note_red_runners(*frames, np.zeros(1, np.int32))
    assert record.red_runners == {}


def test_off_the_lanes_nobody_stands_at_green() -> None:
    ego = ego_at(SIGNALLED, "wi_0", 89.0, 0.0, route=edges(SIGNALLED, "wi", "eo"))
    for where, stands in (
        (ego, True),
        (ego._replace(lane=-1, s=float(SIGNALLED.length[-1])), False),
    ):
        assert stands_at_green(SIGNALLED, frame_of(SIGNALLED, 0.0, where)) is stands


# --- where two can meet ---


def test_lanes_that_cross_meet_without_a_junction() -> None:
    lanes = [Lane("a", 0, ((0, 0), (100, 0))), Lane("b", 0, ((50, -50), (50, 50)))]
    places = (0, 50.0, 5.0), (1, 50.0, 5.0)
    for areas, meet in (([], False), ([Conflict("a_0", 48, 52, "b_0", 48, 52)], True)):
        road = build(lanes, areas)
        assert can_meet(road, *places) is meet and can_meet(road, *places[::-1]) is meet


def test_who_comes_onto_the_lane_but_too_far_was_not_driven_there() -> None:
    a, b = lane(STRAIGHT, "a_0"), lane(STRAIGHT, "b_0")
    for s, found in ((14.9, True), (15.1, False)):  # 5 m, 10 m, and 15 m
        assert (driven(STRAIGHT, a, 195.0, b, s, 30.0) is not None) is found


def test_the_lanes_within_reach_and_where_they_begin() -> None:
    def within(name: str, s: float, back: float, ahead: float) -> dict[str, float]:
        found = spread(STRAIGHT, lane(STRAIGHT, name), s, back, ahead)
        return {STRAIGHT.lane_ids[k]: start for k, start in found.items()}

    assert within("a_1", 150.0, 30.0, 49.0) == {"a_1": -150.0}
    assert within("a_1", 150.0, 30.0, 51.0) == {"a_1": -150.0, ":m_1": 50.0}
    assert within("a_1", 150.0, 30.0, 61.0) == {"a_1": -150.0, ":m_1": 50.0, "b_1": 60.0}
    assert within("a_0", 199.0, 0.0, 2.0) == {"a_0": -199.0, ":m_0": 1.0, ":mr_0": 1.0}
    assert within("b_1", 5.0, 4.0, 0.0) == {"b_1": -5.0}
    assert within("b_1", 5.0, 6.0, 0.0) == {"b_1": -5.0, ":m_1": -15.0}
    assert within("b_1", 5.0, 16.0, 0.0) == {"b_1": -5.0, ":m_1": -15.0, "a_1": -215.0}


# --- goals ---


def progress(success: str = "", free_flow: float = 40.0, per: float = 3.0) -> RouteProgress:
    at = edge(STRAIGHT, success) if success else -1
    return RouteProgress(STRAIGHT, Goal(edges(STRAIGHT, *ROUTE), at, 100.0, free_flow, per))


@pytest.mark.parametrize(
    ("name", "s", "v", "arrived"),
    [
        ("c_1", 1.0, 0.0, True),  # it is on the goal edge
        ("b_1", 196.0, 0.0, True),  # within 5 m of it
        ("b_1", 194.0, 0.0, False),
        ("b_1", 188.0, 10.0, True),  # or within what it may drive in a step, and half of that
        ("b_1", 187.0, 10.0, False),
    ],
)
def test_an_ego_taken_out_just_before_its_goal_has_reached_it(
    name: str, s: float, v: float, arrived: bool
) -> None:
    found = progress()
    found.advance([lane(STRAIGHT, "a_1"), lane(STRAIGHT, name)])
    assert found.ends_at_goal(ego_at(STRAIGHT, name, s, v), 0.5) is arrived


def test_the_edges_between_an_ego_and_its_goal_count() -> None:
    short = build(
        [
            Lane(name, 0, ((x, 0), (x + 4, 0)), (after,) if after else ())
            for name, x, after in (("a", 0, "b_0"), ("b", 4, "c_0"), ("c", 8, ""))
        ]
    )
    found = RouteProgress(short, Goal((0, 1, 2), -1, 100.0, 40.0))
    found.advance([0])
    for s, arrived in ((2.9, False), (3.1, True)):  # 4 m more, of 5
        assert found.ends_at_goal(ego_at(short, "a_0", s, 0.0), 0.5) is arrived


def test_a_success_edge_counts_whatever_its_number_is() -> None:
    first = progress("a")
    first.advance([lane(STRAIGHT, "a_1")])
    assert first.ends_at_goal(None, 0.5)
    assert not progress("b").ends_at_goal(None, 0.5)


def test_who_skips_the_edge_that_counts_has_reached_it() -> None:
    found = progress("b")
    found.advance([lane(STRAIGHT, "c_1")])
    assert found.arrived


def test_an_edge_that_counts_may_lie_off_the_route() -> None:
    found = progress("d")
    found.advance([lane(STRAIGHT, name) for name in ("a_0", "b_0", "c_0")])
    assert not found.arrived and not found.ends_at_goal(None, 0.5)
    found.advance([lane(STRAIGHT, "d_0")])
    assert found.arrived


def test_who_arrives_beyond_its_goal_has_lost_the_time_above_free_flow() -> None:
    where = [("a_1", 190.0)] * 50 + [("a_1", 199.0), ("b_1", 1.0)]
    judge, outcome = drive(STRAIGHT, where, ("a",))
    assert outcome == "arrived"
    assert judge.row()["time_lost_s"] == pytest.approx(51 * STEP - 20.0)


def test_another_route_makes_another_goal_by_what_is_driven_and_left() -> None:
    """From 140 m on a to its end: 60 m, 10 m and 200 m, twice, are left; onto d less."""
    here = ego_at(STRAIGHT, "a_0", 140.0, route=edges(STRAIGHT, "a", "d"))
    turn = float(STRAIGHT.length[lane(STRAIGHT, ":mr_0")])
    left, onto = (60.0 + 420.0) / 15.0, 60.0 / 15.0 + turn / 8.0 + 100.0 / 15.0
    found = progress().rerouted(here, 9.0)
    assert found is not None and found.edges == here.route
    assert found.free_flow == pytest.approx(40.0 - left + onto)
    assert found.time_limit == pytest.approx(100.0 + 3.0 * (found.free_flow - 40.0))
    # what it has driven is unknown where its free flow is: then the time that it took counts
    unknown = progress(free_flow=nan).rerouted(here, 9.0)
    assert unknown is not None and unknown.time_limit == 100.0
    assert unknown.free_flow == pytest.approx(9.0 + onto)
    on_side_road = ego_at(STRAIGHT, "d_0", 40.0, route=edges(STRAIGHT, "d"))
    astray = progress().rerouted(on_side_road, 9.0)
    assert astray is not None and astray.free_flow == pytest.approx(9.0 + 60.0 / 15.0)
    assert astray.time_limit == pytest.approx(100.0 + 3.0 * (13.0 - 40.0))


def test_the_goal_stays_where_the_route_leads_to_it_or_nowhere() -> None:
    here = ego_at(STRAIGHT, "a_0", 140.0)
    for route in ((), edges(STRAIGHT, "b", "c"), edges(STRAIGHT, "a", ":m"), (-1,)):
        assert progress().rerouted(here._replace(route=route), 9.0) is None
    nowhere = progress().rerouted(here._replace(route=edges(STRAIGHT, "b")), 9.0)
    assert nowhere is not None and isnan(nowhere.free_flow) and nowhere.time_limit == 100.0


# --- the lanes under the ego ---


def test_the_trail_is_the_lanes_under_the_ego() -> None:
    """Lanes of 4 m under an ego of 5 m."""
    names = "abcdefg"
    road = build(
        [
            Lane(name, 0, ((4 * k, 0), (4 * k + 4, 0)), (f"{names[k + 1]}_0",) if k < 6 else ())
            for k, name in enumerate(names)
        ]
    )

    def frame(x: float) -> Frame:
        k = int(x // 4.0)
        return frame_of(road, x, ego_at(road, f"{names[k]}_0", x - 4.0 * k, 2.0))

    judge = referee(road, frame(1.0), *names, step=1.0)
    for x in np.arange(2.0, 27.0):
        judge.observe(frame(x))
        under = [k for k in range(7) if 4.0 * k <= x and 4.0 * k + 4.0 > x - 5.0]
        assert judge._trail == under


@pytest.mark.parametrize(
    ("s", "length", "under"),
    [
        (5.5, 5.0, {"b_1": (0.5, 5.5)}),
        (2.0, 5.0, {"b_1": (-3.0, 2.0), ":m_1": (7.0, 10.0)}),
        (2.0, 15.0, {"b_1": (-13.0, 2.0), ":m_1": (-3.0, 10.0), "a_1": (197.0, 200.0)}),
    ],
)
def test_each_lane_under_the_ego_with_the_part_that_it_is_on(
    s: float, length: float, under: dict[str, tuple[float, float]]
) -> None:
    trail = [lane(STRAIGHT, name) for name in ("a_1", ":m_1", "b_1")]
    found = lanes_under(STRAIGHT, ego_at(STRAIGHT, "b_1", s, length=length), trail)
    assert {STRAIGHT.lane_ids[each.lane]: (each.begin, each.end) for each in found} == under
    for each in found:  # the front, as each lane counts
        before = {"b_1": 0.0, ":m_1": 10.0, "a_1": 210.0}[STRAIGHT.lane_ids[each.lane]]
        assert each.front == s + before


@pytest.mark.parametrize(("s", "brakes"), [(13.3, True), (14.0, False)])
def test_an_agent_brakes_until_its_front_is_out_of_the_area(s: float, brakes: bool) -> None:
    """It ends 13.8 m behind the line."""
    ego = ego_at(CROSSING, ":sn_0", 8.0, 4.0, route=edges(CROSSING, "si", "no"))
    assert braked(CROSSING, ego, Agent("x", ":we_0", s, 5.0), (":we_0", "eo_0")) is brakes


def test_the_junction_entered_against_red_is_forgotten_behind_it() -> None:
    record = LightRecord(SIGNALLED)
    inside, behind = lane(SIGNALLED, ":we_0"), lane(SIGNALLED, "eo_0")
    record.red_junction = int(SIGNALLED.junction[inside])
    record.leave_junction([inside, behind])
    assert record.red_junction == SIGNALLED.junction[inside]
    record.leave_junction([behind])
    assert record.red_junction == -1


def test_events_a_second_apart_to_the_rounding() -> None:
    """From 0.3 s to the beginning of the step that ends at 1.4 s."""
    assert 1.4 - 0.1 - 0.3 < 1.0
    assert events([0.3, 1.4], [3.0, 4.0], 0.1) == [3.0, 4.0]
    assert events([0.3, 1.3], [3.0, 4.0], 0.1) == [4.0]


def test_of_several_ways_over_a_junction_the_quickest_counts() -> None:
    ways = [
        Lane(":m", k, ((100, 0), (120, 0)), ("b_0",), speed, junction="m")
        for k, speed in enumerate((10.0, 20.0, 5.0))
    ]
    after = [f":m_{k}" for k in range(3)]
    road = build([
        Lane("a", 0, ((0, 0), (100, 0)), after, 10.0), *ways, Lane("b", 0, ((120, 0), (220, 0)), (), 10.0),
    ])  # fmt: skip
    ego = ego_at(road, "a_0", 0.0)
    assert free_flow_time(road, edges(road, "a", "b"), 0.0, ego) == pytest.approx(10 + 1 + 10)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_who_crosses_over_is_judged_on_its_own_side_from_the_first_step(
    order: tuple[int, int],
) -> None:
    """Whichever of the two lanes comes first in the map."""
    both = Lane("there", 0, ((0, 0), (200, 0))), Lane("back", 0, ((100, 3.2), (0, 3.2)))
    road = build([both[k] for k in order])
    own = ego_at(road, "there_0", 100.0, 10.0)
    over = ego_at(road, "back_0", 40.0, 10.0)._replace(heading=0.0)
    seen = OwnSide(road, 0.5).seen(own, frame_of(road, 0.5, over))
    # 40 of 100 m towards where that lane begins: 60 % of the way along its own
    assert (seen.ego.lane, seen.ego.s) == (own.lane, pytest.approx(120.0))
    turned = over._replace(heading=pi)  # it does drive on that lane
    assert OwnSide(road, 0.5).seen(own, frame_of(road, 0.5, turned)).ego.lane == over.lane


def test_a_side_road_is_off_the_route_whatever_its_number_is() -> None:
    """The first lane of the map leads nowhere."""
    road = build([
        Lane("side", 0, ((100, 0), (150, -50))),
        Lane("a", 0, ((0, 0), (100, 0)), ("side_0", "b_0")),
        Lane("b", 0, ((100, 0), (200, 0))),
    ])  # fmt: skip
    assert drive(road, [("a_0", 98.0), ("side_0", 2.0)], ("a", "b"))[1] == "off_route"
    assert drive(road, [("a_0", 98.0), ("b_0", 2.0)], ("a", "b"))[1] is None


def test_the_time_limit_itself_is_in_time_to_the_rounding() -> None:
    """0.3 s after 0.1 s, which is a little more than the limit of 0.2 s in numbers."""
    assert (0.1 + 0.2) - 0.1 > 0.2
    for limit, outcome in ((0.2, None), (0.19, "timeout")):
        ego = ego_at(STRAIGHT, "a_1", 20.0)
        judge = referee(STRAIGHT, frame_of(STRAIGHT, 0.1, ego), *ROUTE, limit=limit)
        assert judge.observe(frame_of(STRAIGHT, 0.1 + 0.2, ego)) == outcome


def test_what_the_ego_comes_over_within_two_seconds() -> None:
    """20 m: 5 m of its lane, the junction of 10 m, and 5 m behind it."""
    route = edges(STRAIGHT, *ROUTE)
    ego = ego_at(STRAIGHT, "a_1", 195.0, 10.0, route=route)
    found = _coming(STRAIGHT, frame_of(STRAIGHT, 0.0, ego))
    assert [(STRAIGHT.lane_ids[each.lane], *each[1:]) for each in found] == [
        ("a_1", 195.0, 200.0, 195.0), (":m_1", 0.0, 10.0, -5.0), ("b_1", 0.0, 5.0, -15.0),
    ]  # fmt: skip
    stands = frame_of(STRAIGHT, 0.0, ego._replace(v=0.0))
    assert _coming(STRAIGHT, stands) == []


def test_who_is_off_the_lanes_has_no_path() -> None:
    frame = frame_of(STRAIGHT, 0.0, ego_at(STRAIGHT, "d_0", 9.0), Agent("x", "", x=9.0))
    under = [Stretch(frame.ego.lane, 4.0, 9.0, 9.0)]
    assert not _is_in_path(STRAIGHT, frame, 0, 10.0, under)


@pytest.mark.parametrize(
    ("was", "now", "lit"),
    [
        ("wi_0", ":we_0", ":we_0"),
        ("wi_0", "eo_0", ":we_0"),  # over the junction within a step
        ("wi_0", "no_0", ":wn_0"),
        ("si_0", "eo_0", ""),  # no way leads there
        ("", "eo_0", ""),
        (":we_0", "eo_0", ""),
    ],
)
def test_the_light_that_a_vehicle_drove_past(was: str, now: str, lit: str) -> None:
    places = [lane(SIGNALLED, name) if name else -1 for name in (was, now, lit)]
    assert _lit(SIGNALLED, places[0], places[1]) == places[2]
