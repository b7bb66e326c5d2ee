"""Escapes from scenes whose futures are known."""

import math

import naive
import numpy as np
import pytest
from helpers import Agent, Lane, agents_at, build, ego_at, lights
from helpers_hindsight import BREADTH, LENGTH, Car, futures, question, seen_later
from helpers_model import PHYSICS, WIDTH, lanes_east, road_with_light, scenario, scene_of

from sumo_mcts.driver.params import Physics, ego_params
from sumo_mcts.evaluation.goal import Goal
from sumo_mcts.evaluation.hindsight import (
    ALIVE,
    BEFORE_S,
    CELL,
    MARGIN,
    Cell,
    Future,
    Hindsight,
    drive,
    escape,
)
from sumo_mcts.model.local_map import GONE, NODE, State
from sumo_mcts.model.motion import begin_change, can_change, pose_of, within_step
from sumo_mcts.numerics.geometry import X, Y
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import GREEN, RED

FINE = Cell(1e-9, 1e-9, 1e-9, 1e-9, 1e-9)  # states count as one only where they are one


def goal_of(road: RoadMap) -> Goal:
    """The end of all edges."""
    return Goal(tuple(range(len(road.edge_ids))), -1, 100.0, 10.0)


# --- walls and followers ---


@pytest.mark.parametrize(
    "moves",
    [PHYSICS, Physics(0.1, True, 3.0), Physics(0.25, False, 3.0)],
    ids=["euler", "ballistic", "quarter"],
)
@pytest.mark.parametrize("v", [8.0, 15.0, 25.0])
def test_a_wall_is_met_from_as_near_as_the_strongest_braking_needs(
    v: float, moves: Physics
) -> None:
    road = lanes_east(3, 1000.0, 30.0)
    ego = ego_at(road, "a_1", 100.0, v)
    need = naive.stopping_distance(ego_params(scenario(), ego, moves), v, 0.0) + MARGIN

    def wall(gap: float) -> bool | None:
        return seen_later(
            road, ego, *(Car(100.0 + gap + LENGTH, y) for y in (-WIDTH, 0.0, WIDTH)), moves=moves
        ).unavoidable()

    assert wall(need - 0.02) is True
    assert wall(need + 0.02) is False


def test_a_gap_in_the_wall_is_an_escape() -> None:
    road = lanes_east(3, 1000.0, 30.0)
    ego = ego_at(road, "a_1", 100.0, 20.0)
    row = [Car(155.0, y) for y in (-WIDTH, 0.0)]
    assert (
        seen_later(road, ego, *row, Car(145.0, WIDTH)).unavoidable() is False
    )  # 50 m are enough for braking
    assert seen_later(road, ego, Car(129.0, 0.0)).unavoidable() is True  # a change takes 3 s
    ego = ego_at(road, "a_1", 100.0, 30.0)
    need = naive.stopping_distance(ego_params(scenario(), ego, PHYSICS), 30.0, 0.0)
    near = [Car(100.0 + need - 3.0 + LENGTH, y) for y in (-WIDTH, 0.0, WIDTH)]
    assert seen_later(road, ego, *near).unavoidable() is True
    assert seen_later(road, ego, *near[:2]).unavoidable() is False


def test_a_follower_that_does_not_brake_cannot_be_outrun_but_let_past() -> None:
    one, two = lanes_east(1, 1000.0, 15.0), lanes_east(2, 1000.0, 15.0)
    assert (
        seen_later(one, ego_at(one, "a_0", 200.0, 5.0), Car(150.0, 0.0, 30.0)).unavoidable() is True
    )
    assert (
        seen_later(one, ego_at(one, "a_0", 200.0, 5.0), Car(150.0, 0.0, 14.0)).unavoidable()
        is False
    )
    assert (
        seen_later(two, ego_at(two, "a_0", 200.0, 10.0), Car(100.0, -WIDTH / 2, 30.0)).unavoidable()
        is False
    )
    beside = Car(205.0, WIDTH / 2, 15.0)  # as fast as the ego may drive
    assert (
        seen_later(
            two, ego_at(two, "a_0", 200.0, 15.0), Car(165.0, -WIDTH / 2, 30.0), beside
        ).unavoidable()
        is True
    )


def test_only_who_is_there_is_met() -> None:
    road = lanes_east(1, 1000.0, 15.0)
    ego = ego_at(road, "a_0", 200.0, 15.0)
    assert seen_later(road, ego).unavoidable() is False
    assert seen_later(road, ego, Car(215.0, 0.0)).unavoidable() is True
    assert seen_later(road, ego, Car(215.0, 0.0, end=0.3)).unavoidable() is False
    assert (
        seen_later(road, ego, Car(215.0, 0.0, begin=5.0)).unavoidable() is False
    )  # it will have passed, or stopped before
    assert seen_later(road, ego, Car(70.0, 0.0, 33.0)).unavoidable() is True
    assert (
        seen_later(road, ego, Car(70.0, 0.0, 33.0, begin=4.0)).unavoidable() is True
    )  # wherever the ego is by then
    assert seen_later(road, ego, Car(70.0, 0.0, 33.0, end=4.0)).unavoidable() is False


def test_red_holds_the_ego_in_front_of_a_follower() -> None:
    road = road_with_light(length=200.0, speed=15.0)
    ego, follower = ego_at(road, "a_0", 185.0, 8.0), Car(150.0, 0.0, 13.0)
    assert seen_later(road, ego, follower, signals=lights(GREEN)).unavoidable() is False
    assert seen_later(road, ego, follower, signals=lights(RED)).unavoidable() is True


def test_whoever_arrives_before_is_out_of_it() -> None:
    road = build(
        [
            Lane("a", 0, ((0.0, 0.0), (100.0, 0.0)), ("b_0",)),
            Lane("b", 0, ((100.0, 0.0), (400.0, 0.0))),
        ]
    )
    ego, wall = ego_at(road, "a_0", 90.0, 15.0), Car(110.0, 0.0)
    assert seen_later(road, ego, wall).unavoidable() is True
    assert seen_later(road, ego, wall, success="b").unavoidable() is False
    assert seen_later(road, ego, Car(101.0, 0.0), success="b").unavoidable() is True


def test_looked_at_is_the_state_3_s_before_or_the_take_over() -> None:
    road = lanes_east(1, 2000.0, 15.0)
    times = []

    def known(now: float, count: int) -> list[Future]:
        times.append(now)
        return futures(Car(240.0, 0.0))(now, count)

    start = ego_at(road, "a_0", 100.0, 15.0, route=(0,))
    params = ego_params(scenario(), start, PHYSICS)
    last = 240.0 - LENGTH - MARGIN - naive.stopping_distance(params, 15.0, 0.0)
    asked = Hindsight(road, goal_of(road), start, params, known)
    answers = set()
    for k in range(115):
        now = 7.0 + 0.1 * k
        asked.note(scene_of(ego_at(road, "a_0", 100.0 + 1.5 * k, 15.0), road)._replace(time=now))
        looked_at = max(7.0, now - BEFORE_S)
        answers.add(asked.unavoidable())
        assert asked.unavoidable() is bool(100.0 + 15.0 * (looked_at - 7.0) > last), now
        assert times[-1] == pytest.approx(looked_at)
    assert answers == {False, True}


def test_unknown_where_the_ego_goes_nobody_knows_where() -> None:
    road = lanes_east(2)
    asked = seen_later(road, ego_at(road, "a_0", 100.0))
    asked._scenes[0] = asked._scenes[0]._replace(ego=ego_at(road, "a_0", 100.0)._replace(lane=-1))
    assert asked.unavoidable() is None
    assert seen_later(road, ego_at(road, "a_0", 100.0, d=0.8)).unavoidable() is None
    changing = ego_at(road, "a_0", 100.0, d=0.8)._replace(changing=0.25, change_from=0, change_to=1)
    assert seen_later(road, changing).unavoidable() is False


def test_the_futures_say_who_is_there_whoever_is_in_view() -> None:
    """Scenes have those within 100 m, in another order; futures everybody who holds a script, also
    who has still to depart."""
    road = lanes_east(2)
    ego = ego_at(road, "a_0", 100.0, 10.0)
    cars = Car(130.0, -1.6), Car(500.0, -1.6, 5.0), Car(520.0, 1.6, 5.0, begin=60.0)
    asked = seen_later(road, ego, *cars)
    answer = asked.unavoidable()
    asked.note(
        asked._scenes[0]._replace(
            agents=agents_at(road, Agent("near", "a_0", 130.0), Agent("walks", "", x=140.0, y=9.0))
        )
    )
    asked._scenes.popleft()
    assert asked.unavoidable() == answer


# --- the search against a slow and obvious one ---


def naive_escape(asked: tuple, state: State, level: int, plies: int) -> bool:
    """Every sequence of actions, one after the other."""
    local, p, _, choice, home, (ply, _, looks, _) = asked
    alone = local._replace(agent=local.agent[:, :0], trait=local.trait[:0])
    for accel, side in choice:
        if side and not can_change(local, p, state, int(side)):
            continue
        after = begin_change(local, p, state, int(side)) if side else state
        free = True
        for k in range(level * ply, (level + 1) * ply):
            before = after
            after, end = drive(alone, p, home, before, accel, k, 1, 1)
            assert end == ALIVE
            shares = [(look + 1) / looks for look in range(looks)]
            free = free and not any(
                _overlaps(asked, within_step(local, p, before, after, share), k, share)
                for share in shares
            )
        if free and (level + 1 == plies or naive_escape(asked, after, level + 1, plies)):
            return True
    return False


def _overlaps(asked: tuple, state: State, row: int, share: float) -> bool:
    local, p = asked[:2]
    x, y, c, n = pose_of(local, p, state)
    own = naive.Box(x, y, math.atan2(n, c), p.half_length + MARGIN, p.half_width + MARGIN)
    before, after = local.agent[row], local.agent[row + 1]
    there = [
        (1.0 - share) * b + share * a
        for b, a in zip(before, after, strict=True)
        if b[NODE] != GONE and a[NODE] != GONE
    ]
    return any(
        naive.overlap_area(own, naive.Box(agent[X], agent[Y], 0.0, LENGTH / 2, BREADTH / 2)) > 0.0
        for agent in there
    )


@pytest.mark.slow
def test_finds_what_trying_everything_finds() -> None:
    rng = np.random.default_rng(7)
    road = lanes_east(2, 1000.0, 30.0)
    found = []
    for _ in range(60):
        ego = ego_at(road, "a_0", 300.0, float(rng.uniform(3.0, 25.0)))
        ahead = [
            Car(float(rng.uniform(306.0, 340.0)), side * WIDTH / 2, float(rng.uniform(0.0, 8.0)))
            for side in (-1, 1)
        ]
        behind = Car(float(rng.uniform(280.0, 294.0)), -WIDTH / 2, float(rng.uniform(0.0, 35.0)))
        local, p, root, choice, home, grain = asked = question(
            seen_later(road, ego, *ahead, behind)
        )
        few = choice[[1, 3, 8, 11]]  # two changes to the left, full acceleration, full braking
        expected = naive_escape((*asked[:3], few, *asked[4:]), root, 0, 3)
        grain = grain._replace(plies=3, cell=FINE)
        assert len(escape(local, p, root, few, home, grain)) == (3 if expected else 0)
        found.append(expected)
    assert 15 <= sum(found) <= 45


def test_cells_hide_no_escape() -> None:
    """Every escape found in cells is one; of those there are, hardly any is missed."""
    rng = np.random.default_rng(3)
    road = lanes_east(3, 1000.0, 30.0)
    pairs = []
    for _ in range(60):
        ego = ego_at(road, "a_1", 300.0, float(rng.uniform(3.0, 25.0)))
        cars = [
            Car(float(rng.uniform(306.0, 345.0)), side * WIDTH, float(rng.uniform(0.0, 6.0)))
            for side in (-1, 0, 1)
        ]
        cars += [
            Car(float(rng.uniform(270.0, 294.0)), side * WIDTH, float(rng.uniform(10.0, 30.0)))
            for side in (-1, 0, 1)
        ]
        local, p, root, choice, home, grain = question(seen_later(road, ego, *cars))
        pairs.append(
            tuple(
                bool(len(escape(local, p, root, choice, home, grain._replace(plies=5, cell=cell))))
                for cell in (CELL, FINE)
            )
        )
    assert all(fine or not coarse for coarse, fine in pairs)
    assert 10 <= sum(fine for _, fine in pairs) <= 50
    assert sum(coarse != fine for coarse, fine in pairs) <= 2


def test_the_escape_touches_no_vehicle_when_it_is_driven() -> None:
    road = lanes_east(3, 1000.0, 30.0)
    ego = ego_at(road, "a_1", 300.0, 18.0)
    local, p, root, choice, home, grain = question(
        seen_later(road, ego, Car(345.0, 0.0), Car(335.0, WIDTH, 4.0), Car(240.0, 0.0, 25.0))
    )
    found = escape(local, p, root, choice, home, grain)
    assert len(found) == grain.plies == 16
    assert choice[found, 1].any()  # it has to let the car behind pass
    state = root
    for k, action in enumerate(found):
        accel, side = choice[action]
        state = begin_change(local, p, state, int(side)) if side else state
        for i in range(k * grain.ply, (k + 1) * grain.ply):
            state, end = drive(local, p, home, state, accel, i, 1, 10)
            assert end == ALIVE
            assert not any(_overlaps((local, p), state, i, share) for share in (0.3, 0.7, 1.0))
