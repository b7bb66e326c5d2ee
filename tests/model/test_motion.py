"""How the ego moves under an action: bounds, limits, stop lines and lane changes."""

import math
from collections.abc import Sequence
from itertools import pairwise

import naive
import numpy as np
import pytest
from helpers import Lane, build, crossing, edges, ego_at, lights
from helpers_model import (
    PHYSICS,
    lanes_east,
    local_of,
    road_with_light,
    scenario,
    scene_of,
    task_of,
)
from hypothesis import assume, given
from hypothesis import strategies as st

from sumo_mcts.driver.params import Physics
from sumo_mcts.model.local_map import LocalMap, State
from sumo_mcts.model.motion import (
    FREE,
    GOAL,
    OFF_END,
    RED_LINE,
    EgoParams,
    advance,
    begin_change,
    can_change,
    follow_accel,
    pose_of,
    within_step,
)
from sumo_mcts.model.route import LENGTH, STATION
from sumo_mcts.planners.base import Task
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import GREEN, RED, YELLOW, Signals

PHYSICS_OF = {
    "euler": PHYSICS,
    "ballistic": Physics(0.1, True, 3.0),
    "fine": Physics(0.05, False, 3.0),
    "quarter": Physics(0.25, True, 3.0),
    "half": Physics(0.5, False, 0.0),
    "second": Physics(1.0, False, 3.0),
}
accelerations = st.lists(
    st.sampled_from([-8.0, -4.5, -3.0, -1.0, 0.0, 1.0, 2.6, 99.0]), min_size=1, max_size=8
)


def on_road(
    road: RoadMap,
    name: str,
    s: float,
    v: float,
    moves: Physics = PHYSICS,
    *,
    route: Sequence[str] = (),
    signals: Signals | None = None,
) -> tuple[Task, LocalMap, State]:
    """An ego alone."""
    ego = ego_at(road, name, s, v, route=edges(road, *(route or road.edge_ids[:1])))
    task = task_of(road, ego, physics=moves)
    local, state = local_of(task, scene_of(ego, road, signals=signals, step=moves.step))
    return task, local, state


def drive(
    local: LocalMap, p: EgoParams, state: State, asked: Sequence[float], seconds: float = 1.0
) -> list[tuple[State, int]]:
    """The state after every step, each acceleration asked for during `seconds`; until something
    happens."""
    states: list[tuple[State, int]] = []
    for accel in asked:
        for _ in range(max(1, round(seconds / p.step))):
            state, event = advance(local, p, state, accel, len(states) * p.step)
            states.append((state, event))
            if event != FREE:
                return states
    return states


def patchwork(limits: Sequence[float], lengths: Sequence[float]) -> RoadMap:
    """Edges e0, e1, ... with these limits; the first and the last are 200 m long."""
    x, lanes = 0.0, []
    for k, limit in enumerate(limits):
        length = 200.0 if k in (0, len(limits) - 1) else lengths[k]
        lanes.append(
            Lane(
                f"e{k}",
                0,
                ((x, 0.0), (x + length, 0.0)),
                (f"e{k + 1}_0",) if k + 1 < len(limits) else (),
                speed=limit,
            )
        )
        x += length
    return build(lanes)


# --- bounds ---

limits = st.lists(st.floats(3.0, 30.0), min_size=3, max_size=6)
lengths = st.lists(st.floats(1.0, 80.0), min_size=6, max_size=6)


@pytest.mark.slow
@pytest.mark.parametrize("moves", PHYSICS_OF.values(), ids=PHYSICS_OF)
@given(limits, lengths, st.floats(0.0, 1.0), accelerations)
def test_bounds_and_limits_hold(
    moves: Physics, limits: list[float], lengths: list[float], share: float, asked: list[float]
) -> None:
    """Never backwards, never beyond the strongest braking and acceleration, never above a limit by
    more than 0.1 m/s."""
    task, local, state = on_road(
        road := patchwork(limits, lengths), "e0_0", 20.0, 0.0, moves, route=road.edge_ids
    )
    route, p = task.route, task.ego
    state = state._replace(v=share * float(route.cap[20]))
    for after, event in drive(local, p, state, asked, 2.0):
        assert after.v >= 0.0
        assert route.station[after.node] + after.s >= route.station[state.node] + state.s
        assert after.a == pytest.approx((after.v - state.v) / p.step)
        assert -p.max_decel - 1e-9 <= after.a <= p.max_accel + 1e-9
        assert after.v == 0.0 or abs(after.a - state.a) <= p.emergency_jerk * p.step + 1e-6
        assert after.v <= route.limit[after.node] + 0.1
        moved = (0.5 * (state.v + after.v) if p.ballistic else after.v) * p.step
        assert event == GOAL or route.station[after.node] + after.s == pytest.approx(
            route.station[state.node] + state.s + moved
        )
        state = after


@pytest.mark.parametrize("moves", PHYSICS_OF.values(), ids=PHYSICS_OF)
@given(st.floats(5.0, 30.0), st.floats(0.0, 1.0), accelerations)
def test_jerk_is_bounded(moves: Physics, limit: float, share: float, asked: list[float]) -> None:
    """Between a stand and the limit, which come before comfort; more than the ordinary jerk only
    into and out of hard braking."""
    task, local, state = on_road(
        patchwork([limit] * 3, [50.0] * 3),
        "e0_0",
        20.0,
        share * limit,
        moves,
        route=("e0", "e1", "e2"),
    )
    p = task.ego
    for accel in asked:
        for after, _ in drive(local, p, state, [accel]):
            wanted = max(min(accel, p.max_accel), -p.max_decel)
            bound = p.emergency_jerk if min(wanted, state.a) < -p.comfort_decel else p.jerk
            if 0.0 < after.v < limit - 1e-9:
                assert abs(after.a - state.a) <= bound * p.step + 1e-6
            state = after
            if state.node == 2:
                return


def test_a_wish_is_fulfilled() -> None:
    task, local, state = on_road(lanes_east(), "a_1", 50.0, 8.0)
    for accel, steps in ((2.0, 25), (-2.0, 25), (-8.0, 9)):
        for _ in range(steps):
            state, _ = advance(local, task.ego, state, accel, 0.0)
        assert state.a == pytest.approx(accel)


def test_the_end_of_the_route_is_the_goal_and_a_dead_end_a_wall() -> None:
    task, local, state = on_road(
        patchwork([15.0] * 3, [50.0] * 3), "e0_0", 150.0, 15.0, route=("e0", "e1", "e2")
    )
    states = drive(local, task.ego, state, [0.0] * 60)
    assert states[-1][1] == GOAL and states[-1][0].node == 2
    lanes = [Lane("e", k, ((0, 3.0 * k), (100, 3.0 * k)), ("f_0",) if k else ()) for k in range(2)]
    road = build([*lanes, Lane("f", 0, ((100, 3), (200, 3)))])
    task, local, state = on_road(road, "e_0", 20.0, 15.0, route=("e", "f"))
    states = drive(local, task.ego, state, [2.6] * 30)
    assert all(event == FREE for _, event in states)
    assert 98.0 < states[-1][0].s <= 100.0 and states[-1][0].v == pytest.approx(0.0, abs=0.05)
    assert min(s.a for s, _ in states) > -3.0  # without haste
    (held, event), *_ = drive(
        local, task.ego, state._replace(s=99.5, v=15.0), [0.0]
    )  # too late: SUMO holds it there
    assert (held.s, held.v, event) == (100.0, 0.0, OFF_END)


# --- stop lines ---

CLOSED = lights(RED)


@pytest.mark.slow
@pytest.mark.parametrize("moves", PHYSICS_OF.values(), ids=PHYSICS_OF)
@given(
    st.floats(0.0, 15.0), st.sampled_from([0.0, 0.0, 1.0, 2.6, -2.0, -8.0]), st.sampled_from([1.0, 1.02, 1.1, 1.3, 2.0]), st.floats(0.001, 5.0), accelerations
)  # fmt: skip
def test_it_stops_before_a_closed_line_whenever_the_strongest_braking_suffices(
    moves: Physics, v: float, a: float, times: float, more: float, asked: list[float]
) -> None:
    task, local, state = on_road(
        road_with_light(), "a_0", 10.0, v, moves, route=("a", "b"), signals=CLOSED
    )
    line = int(np.flatnonzero(task.route.stop)[0]) - local.first
    local.closed[line] = 1  # also where the light changed too late for a stop in comfort
    state = state._replace(s=200.0 - naive.stopping_distance(task.ego, v, a) * times - more, a=a)
    states = drive(local, task.ego, state, asked)
    assert all(event == FREE for _, event in states)
    assert states[-1][0].s <= 200.0


@pytest.mark.slow
@pytest.mark.parametrize("moves", PHYSICS_OF.values(), ids=PHYSICS_OF)
@given(st.floats(3.0, 15.0), st.floats(100.0, 190.0))
def test_from_afar_it_stops_a_little_before_the_line_in_comfort(
    moves: Physics, v: float, distance: float
) -> None:
    task, local, state = on_road(
        road_with_light(), "a_0", 200.0 - distance, v, moves, route=("a", "b"), signals=CLOSED
    )
    states = drive(local, task.ego, state, [0.0] * 120)
    assert states[-1][0].v < 0.05 and 0.5 < 200.0 - states[-1][0].s < 3.0
    assert (
        min(after.a for after, _ in states)
        > -(1.2 if moves.step < 0.4 else 1.5) * task.ego.comfort_decel
    )


@pytest.mark.slow
@pytest.mark.parametrize("moves", PHYSICS_OF.values(), ids=PHYSICS_OF)
@given(st.floats(8.0, 15.0), st.floats(2.5, 5.0))
def test_a_line_that_closes_late_is_met_by_braking_evenly(
    moves: Physics, v: float, needed: float
) -> None:
    """Not with all that the brakes give until the ego is as slow as it would have been, had it
    known before."""
    task, local, state = on_road(
        road_with_light(), "a_0", 10.0, v, moves, route=("a", "b"), signals=CLOSED
    )
    local.closed[int(np.flatnonzero(task.route.stop)[0]) - local.first] = 1
    states = drive(
        local,
        task.ego,
        state._replace(s=200.0 - task.ego.stop_gap - v * v / (2.0 * needed)),
        [0.0] * 12,
    )
    assert states[-1][0].v < 0.5 and states[-1][0].s <= 200.0
    assert min(after.a for after, _ in states) > -max(1.15 * needed, 1.15 * task.ego.comfort_decel)


def test_an_open_line_is_crossed_and_a_closed_one_is_told() -> None:
    task, local, state = on_road(
        road_with_light(), "a_0", 180.0, 12.0, route=("a", "b"), signals=lights(GREEN)
    )
    assert all(event == FREE for _, event in drive(local, task.ego, state, [0.0] * 5))
    line = int(np.flatnonzero(task.route.stop)[0]) - local.first
    local.closed[line, 5:] = 1  # too late: 1 s from now, 8 m before the line
    assert drive(local, task.ego, state, [0.0] * 5)[-1][1] == RED_LINE


def yellow_in(seconds: float, lasts: float = 3.0) -> Signals:
    return Signals(
        np.array([0, 1], np.int32),
        np.array([[GREEN, YELLOW, RED]], np.int32),
        np.array([[seconds, seconds + lasts, math.inf]]),
    )


@pytest.mark.parametrize("moves", PHYSICS_OF.values(), ids=PHYSICS_OF)
@pytest.mark.parametrize("before", [0.0, 0.5, 1.0, 2.0, 4.0])
@given(st.floats(4.0, 14.5), st.floats(1.0, 7.0))
def test_yellow_is_passed_where_three_metres_per_second_squared_would_not_have_stopped(
    moves: Physics, before: float, v: float, needed: float
) -> None:
    """`needed`: the deceleration that would stop the ego when yellow comes."""
    away = v * v / (2.0 * needed)
    assume(abs(needed - 3.0) > 0.05 and away / v + moves.step < 2.9)
    before = round(before / moves.step) * moves.step
    task, local, state = on_road(
        road_with_light(),
        "a_0",
        200.0 - away - before * v,
        v,
        moves,
        route=("a", "b"),
        signals=yellow_in(before),
    )
    states = drive(local, task.ego, state, [0.0] * 8)
    crossed = next((k for k, (after, _) in enumerate(states) if after.node > 0), None)
    if needed > 3.0:
        assert crossed is not None and all(event == FREE for _, event in states)
        assert before <= (crossed + 1) * moves.step < before + 3.0 + moves.step
    else:
        assert crossed is None


@pytest.mark.parametrize("moves", PHYSICS_OF.values(), ids=PHYSICS_OF)
@given(st.floats(4.0, 14.5), st.floats(0.5, 2.8), accelerations)
def test_an_ego_that_yellow_found_far_enough_away_is_never_let_go(
    moves: Physics, v: float, needed: float, asked: list[float]
) -> None:
    """However hard or late it brakes."""
    task, local, state = on_road(
        road_with_light(), "a_0", 10.0, v, moves, route=("a", "b"), signals=yellow_in(0.0, 8.0)
    )
    local.yellow[int(np.flatnonzero(task.route.stop)[0]) - local.first] = 0.0, 8.0
    states = drive(local, task.ego, state._replace(s=200.0 - v * v / (2.0 * needed)), asked)
    assert all(after.node == 0 for after, _ in states)


def test_an_ego_that_slows_down_for_its_turn_passes_yellow() -> None:
    """It needed 4 m/s2 to stop when yellow came, and crosses at less than half of its speed."""
    task, local, state = on_road(
        road_with_light(after=6.0), "a_0", 10.0, 12.0, route=("a", "b"), signals=yellow_in(0.0)
    )
    local.yellow[int(np.flatnonzero(task.route.stop)[0]) - local.first] = 0.0, 3.0
    states = drive(local, task.ego, state._replace(s=182.0, a=-2.0), [-2.0, -2.0])
    assert any(after.node > 0 for after, _ in states)
    assert all(event == FREE for _, event in states)


def test_red_is_never_passed() -> None:
    """Nor by an ego that yellow caught too near, where yellow is too short for it."""
    task, local, state = on_road(
        road_with_light(), "a_0", 172.0, 14.5, route=("a", "b"), signals=yellow_in(0.1, 1.0)
    )
    assert drive(local, task.ego, state, [0.0] * 5)[-1][1] == RED_LINE


def test_a_line_that_opens_again_is_waited_for() -> None:
    signals = Signals(
        np.array([0, 1], np.int32), np.array([[RED, GREEN]], np.int32), np.array([[6.0, math.inf]])
    )
    task, local, state = on_road(
        road_with_light(), "a_0", 150.0, 12.0, route=("a", "b"), signals=signals
    )
    states = drive(local, task.ego, state, [2.6] * 12)
    crossed = next(k for k, (after, _) in enumerate(states) if after.node > 0) * 0.1
    assert all(event == FREE for _, event in states) and 6.0 < crossed < 9.0


@given(
    st.floats(70.0, 90.0),
    st.floats(0.0, 15.0),
    st.sampled_from(["second", "half", "quarter"]),
    st.floats(0.0, 1.0),
)
def test_within_a_long_step_the_ego_stays_on_the_curve(
    s: float, v: float, moves: str, share: float
) -> None:
    road = crossing()
    task, local, state = on_road(road, "wi_0", s, v, PHYSICS_OF[moves], route=("wi", "no"))
    for k in range(12):
        after, event = advance(local, task.ego, state, 1.0, k * task.ego.step)
        if event != FREE:
            break
        between, end = (
            within_step(local, task.ego, state, after, share),
            within_step(local, task.ego, state, after, 1.0),
        )
        assert end == after
        begin, there, target = (
            local.node[each.node, STATION] + each.s for each in (state, between, after)
        )
        assert there - begin == pytest.approx(share * (target - begin), abs=1e-6)
        assert 0.0 <= between.s <= local.node[between.node, LENGTH] + 1e-9
        assert pose_of(local, task.ego, between) == pose_of(
            local, task.ego, State(between.node, between.s, 0.0, 0.0, 0.0, -1, 0.0)
        )
        state = after


# --- lane changes ---


@pytest.mark.slow
@pytest.mark.parametrize("moves", [PHYSICS, Physics(0.1, False, 0.0), Physics(0.25, True, 2.0)])
@given(st.floats(0.0, 15.0), accelerations)
def test_a_change_to_the_right_mirrors_one_to_the_left(
    moves: Physics, v: float, asked: list[float]
) -> None:
    task, local, state = on_road(lanes_east(3, 900.0), "a_1", 50.0, v, moves)
    ways = []
    for side in (1, -1):
        assert can_change(local, task.ego, state, side)
        states = drive(local, task.ego, begin_change(local, task.ego, state, side), asked)
        ways.append(np.array([pose_of(local, task.ego, after) for after, _ in states]))
        assert [after.node - state.node for after, _ in states] == sorted(
            (after.node - state.node for after, _ in states), reverse=side < 0
        )
    assert ways[0] == pytest.approx(ways[1] * (1, -1, 1, -1))


@pytest.mark.parametrize(("side", "target"), [(1, 3.2), (-1, -3.2)])
def test_a_change_takes_its_time_and_flips_the_lane_at_half(side: int, target: float) -> None:
    task, local, state = on_road(lanes_east(), "a_1", 50.0, 10.0)
    states = [
        after
        for after, _ in drive(
            local, task.ego, begin_change(local, task.ego, state, side), [0.0] * 4
        )
    ]
    poses = np.array([pose_of(local, task.ego, after) for after in states])
    front, rear = (poses[:, 1] + end * task.ego.half_length * poses[:, 3] for end in (1, -1))
    assert np.diff(front[:30]) == pytest.approx(np.full(29, target / 30), abs=1e-4)
    assert front[29:] == pytest.approx(target, abs=1e-4)
    assert np.all(np.abs(rear) <= np.abs(front) + 1e-9) and rear[-1] == pytest.approx(
        target, abs=0.1
    )  # the rear trails, and comes in
    assert abs(rear[29]) < abs(target) - 0.3
    assert [k for k, (a, b) in enumerate(pairwise(states)) if a.node != b.node] == [
        14
    ]  # with the 16th of 30 steps, as SUMO's rounding has it
    assert not can_change(local, task.ego, states[10], 1) and not can_change(
        local, task.ego, states[10], -1
    )
    assert not can_change(local, task.ego, states[-1], side) and can_change(
        local, task.ego, states[-1], -side
    )


def test_no_change_begins_that_the_lane_is_too_short_for() -> None:
    task, local, state = on_road(lanes_east(length=100.0), "a_1", 50.0, 10.0)
    assert can_change(local, task.ego, state._replace(s=84.0), 1)
    assert not can_change(local, task.ego, state._replace(s=85.0), 1)


# --- car following ---


@given(
    st.floats(0.0, 40.0),
    st.floats(5.0, 40.0),
    st.one_of(st.floats(0.5, 200.0), st.just(math.inf)),
    st.floats(0.0, 40.0),
)
def test_car_following_is_the_intelligent_driver_model(
    v: float, limit: float, gap: float, leader_v: float
) -> None:
    p = task_of(road := lanes_east(), ego_at(road, "a_1", 50.0), scenario()).ego
    assert follow_accel(p, v, limit, gap, leader_v) == pytest.approx(
        naive.follow(p, v, limit, gap, leader_v), rel=1e-9, abs=1e-9
    )


def test_a_closed_line_crossed_in_the_step_that_ends_the_route_is_crossed() -> None:
    road = build(
        [
            Lane("a", 0, ((0.0, 0.0), (100.0, 0.0)), (":m_0",)),
            Lane(":m", 0, ((100.0, 0.0), (100.2, 0.0)), ("b_0",), junction="m", signal="t", link=0),
            Lane("b", 0, ((100.2, 0.0), (100.5, 0.0))),
        ]
    )
    ego = ego_at(road, "a_0", 99.9, 10.0, route=edges(road, "a", "b"))
    task = task_of(road, ego)
    local, state = local_of(task, scene_of(ego, road, signals=lights(GREEN)))
    assert advance(local, task.ego, state, 0.0, 0.0)[1] == GOAL
    local.closed[:] = 1
    assert advance(local, task.ego, state, 0.0, 0.0)[1] == RED_LINE
