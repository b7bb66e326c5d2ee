"""The search for an escape, part by part: what it asks, what counts as touched, what it returns."""

from math import atan2, cos, pi, sin

import numpy as np
import pytest
from helpers import Lane, build, edge, edges, ego_at, lane
from helpers_hindsight import Car, futures, question, seen_later
from helpers_model import PHYSICS, lanes_east, scenario, scene_of
from helpers_referee import CROSSING, STRAIGHT
from shapely import affinity, box  # type: ignore[import-untyped]

from sumo_mcts.driver.params import Physics, ego_params
from sumo_mcts.evaluation import hindsight
from sumo_mcts.evaluation.goal import Goal
from sumo_mcts.evaluation.hindsight import (
    ALIVE,
    CELL,
    DONE,
    HORIZON_S,
    MARGIN,
    TOUCHED,
    Cell,
    Future,
    Hindsight,
    _cell_of,
    _forecast,
    _goal_nodes,
    actions,
    drive,
    escape,
)
from sumo_mcts.model.local_map import State
from sumo_mcts.model.motion import advance, begin_change, pose_of, within_step
from sumo_mcts.model.route import route_map
from sumo_mcts.road import STOP, RoadMap
from sumo_mcts.scene import Scripted

ONE = lanes_east(1, 1000.0, 15.0)


def params_of(road: RoadMap = ONE, physics: Physics = PHYSICS):
    return ego_params(scenario(), ego_at(road, road.lane_ids[0], 100.0), physics)


# --- what is asked ---


@pytest.mark.parametrize(
    ("step", "ply", "plies", "looks"),
    [(0.1, 5, 16, 2), (0.25, 2, 16, 5), (0.3, 2, 14, 6), (0.02, 25, 16, 1), (1.0, 1, 8, 20)],
)
def test_actions_of_half_a_second_for_eight_seconds(
    step: float, ply: int, plies: int, looks: int
) -> None:
    """And a look at the boxes every 0.05 s, once a step at least. 13 actions of 0.6 s are too
    few."""
    road = lanes_east(1, 1000.0, 15.0)
    moves = Physics(step, False, 3.0)
    asked = question(seen_later(road, ego_at(road, "a_0", 100.0), Car(300.0, 0.0), moves=moves))
    assert asked[5] == (ply, plies, looks, CELL)
    assert plies * ply * step >= HORIZON_S - 1e-9
    assert asked[0].agent.shape[0] > plies * ply  # the futures last as long


def test_everything_it_can_do_and_the_hardest_braking_in_its_lane_first() -> None:
    p = params_of()
    found = [(accel, int(side)) for accel, side in actions(p)]
    assert sorted(found) == sorted(
        (accel, side)
        for accel in (p.max_accel, 0.0, -p.approach_decel, -p.max_decel)
        for side in (-1, 0, 1)
    )
    assert found[-1] == (-p.max_decel, 0)  # the last one is tried first
    assert [side for _, side in found] == [1] * 4 + [-1] * 4 + [0] * 4


@pytest.mark.parametrize(
    ("names", "success", "home"),
    [
        ("abc", "", set()),
        ("ab", "", {":n", "c"}),
        ("a", "", {":m", "b", ":n", "c"}),
        ("abc", "b", {"b", "c"}),
        ("abc", "c", {"c"}),
        ("ab", "b", {"b", ":n", "c"}),
        ("abc", "a", {"a", "b", "c"}),
    ],
)
def test_where_it_has_arrived(names: str, success: str, home: set[str]) -> None:
    """Behind the last edge of its goal, or on the one that counts and on those after it."""
    ego = ego_at(STRAIGHT, "a_1", 100.0, route=edges(STRAIGHT, "a", "b", "c"))
    route = route_map(STRAIGHT, ego.route, 0, 5.0, 1.0, 50.0, 4.0)
    own = edges(STRAIGHT, *names)
    goal = Goal(own, edge(STRAIGHT, success) if success else -1, 100.0, 10.0)
    reached = _goal_nodes(route, goal)
    edge_of = [STRAIGHT.edge_ids[STRAIGHT.edge[k]] for k in route.lane]
    assert {name for name, there in zip(edge_of, reached, strict=True) if there} == home
    assert all(there == (name in home) for name, there in zip(edge_of, reached, strict=True))


def test_the_futures_side_by_side() -> None:
    def future(first: float, length: float, width: float, valid: list[bool]) -> Future:
        n = len(valid)
        pose = first + np.arange(4.0 * n).reshape(n, 4)
        numbers = first + np.arange(float(n))
        states = Scripted(pose, 10.0 * numbers, numbers.astype(np.int32), -numbers, np.array(valid))
        return Future(states, length, width)

    both = [future(1.0, 5.0, 1.8, [True, True]), future(50.0, 12.0, 2.5, [False, True])]
    found = _forecast(both, 0.25, 2)
    assert (found.dt, found.weight.tolist()) == (0.25, [1.0])
    assert found.pose[0, :, 0].tolist() == [[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]]
    assert found.pose[0, 1, 1].tolist() == [54.0, 55.0, 56.0, 57.0]
    assert found.v[0].tolist() == [[10.0, 500.0], [20.0, 510.0]]
    assert found.lane[0].tolist() == [[1, 50], [2, 51]]
    assert found.s[0].tolist() == [[-1.0, -50.0], [-2.0, -51.0]]
    assert found.valid[0].tolist() == [[True, False], [True, True]]
    assert found.half_length.tolist() == [2.5, 6.0] and found.half_width.tolist() == [0.9, 1.25]
    assert not found.reacts.any() and not found.yields.any()
    assert found.yields.shape == (1, 2) and found.pose.shape == (1, 2, 2, 4)
    for column in (found.v, found.lane, found.s, found.valid):
        assert column.shape == (1, 2, 2)


def test_a_stop_sign_does_not_hold_who_has_to_escape() -> None:
    road = build([
        Lane("a", 0, ((0, 0), (200, 0)), (":m_0",)),
        Lane(":m", 0, ((200, 0), (220, 0)), ("b_0",), junction="m", rule=STOP),
        Lane("b", 0, ((220, 0), (520, 0))),
    ])  # fmt: skip
    ego, follower = ego_at(road, "a_0", 185.0, 8.0), Car(150.0, 0.0, 13.0)
    assert seen_later(road, ego, follower).unavoidable() is False


@pytest.mark.parametrize(
    ("d", "known"), [(0.15, True), (-0.15, True), (0.25, False), (-0.25, False)]
)
def test_who_is_off_the_middle_of_its_lane_is_changing_to_nobody_knows_where(
    d: float, known: bool
) -> None:
    road = lanes_east(3)
    found = seen_later(road, ego_at(road, "a_1", 100.0, d=d)).unavoidable()
    assert found is (False if known else None)


def test_as_many_scenes_are_kept_as_three_seconds_have() -> None:
    for step, count in ((0.1, 31), (0.25, 13), (1.0, 4)):
        road = lanes_east(1, 1000.0)
        ego = ego_at(road, "a_0", 100.0, route=(0,))
        params = ego_params(scenario(), ego, Physics(step, False, 3.0))
        asked = Hindsight(road, Goal((0,), -1, 100.0, 10.0), ego, params, futures())
        for k in range(2 * count):
            asked.note(scene_of(ego, road)._replace(time=k * step))
        assert len(asked._scenes) == count
        assert asked._scenes[-1].time - asked._scenes[0].time == pytest.approx(3.0)


# --- what is touched ---


def overlaps(asked: tuple, state: State, states: Scripted, row: int, share: float) -> bool:
    """The ego's box with its margin, and a car of 5 m and 1.8 m at a share of a step."""
    x, y, c, n = pose_of(*asked[:2], state)
    p = asked[1]
    first, then = states.pose[row], states.pose[row + 1]
    at = (1.0 - share) * first + share * then
    own, other = (
        affinity.translate(
            affinity.rotate(box(-a, -b, a, b), turned, origin=(0, 0), use_radians=True), *where
        )
        for a, b, turned, where in (
            (p.half_length + MARGIN, p.half_width + MARGIN, atan2(n, c), (x, y)),
            (2.5, 0.9, atan2(at[3], at[2]), at[:2]),
        )
    )
    return bool(own.intersection(other).area > 0.0)


def test_touched_is_who_overlaps_at_one_of_the_looks() -> None:
    """Cars that turn and go in any direction, by more than their length in a step."""
    rng, found = np.random.default_rng(4), []
    moves = Physics(0.5, False, 3.0)
    for _ in range(60):
        begin, end = rng.uniform((186, -8), (214, 8), (2, 2))
        turned = rng.uniform(-pi, pi) + np.array([0.0, rng.uniform(-1.5, 1.5)])
        pose = np.array([(*at, cos(h), sin(h)) for at, h in zip((begin, end), turned, strict=True)])

        def known(_: float, count: int, pose: np.ndarray = pose) -> list[Future]:
            there = pose[np.minimum(np.arange(count), 1)]
            zero, valid = np.zeros(count), np.arange(count) < 2
            states = Scripted(there, zero, np.full(count, -1, np.int32), zero, valid)
            return [Future(states, 5.0, 1.8)]

        ego = ego_at(ONE, "a_0", 202.5, float(rng.uniform(0.0, 12.0)), route=(0,))
        params = ego_params(scenario(), ego, moves)
        whole = Hindsight(ONE, Goal((0,), -1, 100.0, 10.0), ego, params, known)
        whole.note(scene_of(ego, ONE, step=0.5))
        asked = question(whole)
        local, p, root, _, home, _ = asked
        looks, accel = int(rng.integers(1, 6)), float(rng.choice([-9.0, 0.0, 2.6]))
        after, _ = advance(local, p, root, accel, 0.0)
        states = known(0.0, 2)[0].states
        expected = any(
            overlaps(asked, within_step(local, p, root, after, k / looks), states, 0, k / looks)
            for k in range(1, looks + 1)
        )
        state, end = drive(local, p, home, root, accel, 0, 1, looks)
        assert end == (TOUCHED if expected else ALIVE)
        assert state == after
        found.append(expected)
    assert 15 < sum(found) < 45


def test_a_bridge_over_the_road_is_not_touched() -> None:
    for name, touched in (("br_0", False), ("eo_0", True)):

        def known(_: float, count: int, name: str = name) -> list[Future]:
            pose = np.tile([50.0, -1.6, 0.0, 1.0], (count, 1))
            on = np.full(count, lane(CROSSING, name), np.int32)
            s = np.full(count, 102.5 if name == "br_0" else 42.5)
            valid = np.ones(count, np.bool_)
            return [Future(Scripted(pose, 0.0 * s, on, s, valid), 5.0, 1.8)]

        ego = ego_at(CROSSING, "eo_0", 30.0, 15.0, route=edges(CROSSING, "eo"))
        asked = Hindsight(
            CROSSING, Goal(ego.route, -1, 100.0, 10.0), ego, params_of(CROSSING), known
        )
        asked.note(scene_of(ego, CROSSING))
        assert asked.unavoidable() is touched


def test_it_has_arrived_where_its_node_says_so_or_its_road_ends() -> None:
    road = build([
        Lane("a", 0, ((0, 0), (100, 0)), ("b_0",)), Lane("b", 0, ((100, 0), (130, 0))),
    ])  # fmt: skip
    ego = ego_at(road, "a_0", 98.0, 15.0)
    local, p, root, _, home, _ = question(seen_later(road, ego))
    assert not home.any()
    assert drive(local, p, home, root, 0.0, 0, 5, 1)[1] == ALIVE
    state, end = drive(local, p, ~home, root, 0.0, 0, 5, 1)
    assert end == DONE and state.s == pytest.approx(99.5)  # after the first step
    assert drive(local, p, home, root, 0.0, 0, 25, 1)[1] == DONE  # 32 m: it drives off the road


# --- what is returned ---


def test_states_in_one_cell_are_one() -> None:
    state = question(seen_later(ONE, ego_at(ONE, "a_0", 100.0, 7.0)))[2]
    state = state._replace(s=10.0, v=6.0, a=-3.0, progress=0.4, turn=0.25, other=1)
    cell = Cell(4.0, 2.0, 0.5, 0.1, 0.125)
    assert _cell_of(state, 3, cell) == (3, state.node, 1, 2, 3, -6, 4, 2)


@pytest.mark.parametrize(
    ("column", "apart"), [("s", 0.5), ("v", 0.5), ("a", 2.0), ("progress", 0.05), ("turn", 0.1)]
)
def test_how_far_apart_states_are_two(column: str, apart: float) -> None:
    state = question(seen_later(ONE, ego_at(ONE, "a_0", 100.0, 7.0)))[2]
    state = state._replace(s=0.0, v=0.0, a=0.0, progress=0.0, turn=0.0)
    cells = [
        _cell_of(state._replace(**{column: share * apart}), 3, CELL) for share in (0.0, 0.45, 1.0)
    ]
    assert cells[0] == cells[1] != cells[2]


@pytest.mark.parametrize(("room", "touched"), [(0.05, True), (0.15, False)])
def test_ten_centimetres_all_around_are_kept(room: float, touched: bool) -> None:
    road = lanes_east(1, 1000.0)
    ego = ego_at(road, "a_0", 100.0, 0.0)
    walls = [
        Car(99.0, 1.8 + room), Car(99.0, -1.8 - room), Car(100.0 + 5.0 + room, 0.0),
        Car(95.0 - room, 0.0),
    ]  # fmt: skip
    for wall in walls:
        local, p, root, _, home, _ = question(seen_later(road, ego, wall))
        assert (drive(local, p, home, root, 0.0, 0, 1, 2)[1] == TOUCHED) is touched


def test_the_escape_is_the_sequence_that_led_there() -> None:
    """Both of two lanes are blocked further on, the left one behind the right one. The actions are
    given so that the wrong one is tried first."""
    road = lanes_east(2, 1000.0, 30.0)
    ego = ego_at(road, "a_0", 300.0, 10.0)
    local, p, root, _, home, grain = question(
        seen_later(road, ego, Car(312.0 + 5.0, -1.6), Car(345.0, 1.6))
    )
    choice = np.array([(-p.max_decel, 0.0), (p.max_accel, 1.0), (p.max_accel, 0.0)])
    found = escape(local, p, root, choice, home, grain._replace(plies=6))
    assert len(found) == 6
    state = root
    for k, action in enumerate(found):
        accel, side = choice[action]
        state = begin_change(local, p, state, int(side)) if side else state
        state, end = drive(local, p, home, state, accel, k * grain.ply, grain.ply, 4)
        assert end == ALIVE
    assert 0 in found
    walls = seen_later(road, ego, Car(306.0 + 5.0, -1.6), Car(306.0 + 5.0, 1.6))
    assert len(escape(question(walls)[0], *question(walls)[1:])) == 0


def test_an_escape_ends_where_the_ego_arrives() -> None:
    road = build([
        Lane("a", 0, ((0, 0), (100, 0)), ("b_0",)), Lane("b", 0, ((100, 0), (400, 0))),
    ])  # fmt: skip
    near = seen_later(road, ego_at(road, "a_0", 90.0, 15.0), Car(140.0, 0.0), success="b")
    local, p, root, _, home, grain = question(near)
    only = np.array([(0.0, 0.0)])
    found = escape(local, p, root, only, home, grain)
    assert found.tolist() == [0, 0]  # 10 m at 15 m/s


def test_no_state_is_driven_from_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """A standing ego that a follower is going to hit: braking a little or hard, it stays where it
    is. Two actions at each level are all that is tried, not two to the power of levels."""
    calls = []
    usual = hindsight.drive

    def counted(*given):
        calls.append(1)
        return usual(*given)

    local, p, root, _, home, grain = question(
        seen_later(ONE, ego_at(ONE, "a_0", 200.0, 0.0), Car(150.0, 0.0, 10.0))
    )
    monkeypatch.setattr(hindsight, "drive", counted)
    still = np.array([(-p.approach_decel, 0.0), (-p.max_decel, 0.0)])
    search = getattr(escape, "py_func", escape)
    assert len(search(local, p, root, still, home, grain)) == 0
    assert len(calls) <= 2 * grain.plies
