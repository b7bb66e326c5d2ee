"""What the fail-safe takes the others to reach, and how it drives: cases that
test_failsafe_by_hand.py leaves out."""

import numpy as np
import pytest
from helpers import Agent, Lane, build, crossing, edges, ego_at
from helpers_model import (
    ASSUMED,
    PHYSICS,
    lanes_east,
    local_of,
    plain,
    scene_of,
    situation_of,
    task_of,
)

from sumo_mcts.model.local_map import DRIVEN, GONE, NODE, REACTS, LocalMap, State
from sumo_mcts.numerics.geometry import COS, SIN, Box, X, Y
from sumo_mcts.planners.base import Task
from sumo_mcts.planners.failsafe import FailSafe, Obstacle
from sumo_mcts.planners.failsafe_reach import (
    BRAKE,
    HOLD,
    NO_AGENT,
    NO_END,
    _is_behind,
    _meets,
    _obstructing,
    _to_clear,
    drive,
)
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Follow

LANES, CROSSING = lanes_east(3, 500.0), crossing(bridge=False)
EASTWARD, NORTHWARD = (1.0, 0.0), (0.0, 1.0)


def situation(
    road: RoadMap, name: str, s: float, v: float, *agents: Agent, ways: tuple[str, ...] = ()
):
    """Task, local map and state."""
    ego = ego_at(road, name, s, v, route=edges(road, *ways) if ways else ())
    task = task_of(road, ego)
    return task, *local_of(task, scene_of(ego, road, *agents))


def moved(local: LocalMap, *places: tuple[float, float, float]) -> LocalMap:
    """The only agent at these x, y and m driven, one for each forecast time; the last one stays."""
    agent = local.agent.copy()
    for t in range(len(agent)):
        agent[t, 0, [X, Y, DRIVEN]] = places[min(t, len(places) - 1)]
    return local._replace(agent=agent)


def obstructed(
    local: LocalMap, task: Task, state: State, moment: float, interval: float, top: float = 20.0
) -> bool:
    found = plain(_obstructing)(
        local, task.ego, ASSUMED, np.array([top]), state, state, moment, interval
    )
    assert found in (0, NO_AGENT)
    return bool(found == 0)


@pytest.mark.parametrize(("front", "met"), [(17.0, True), (18.3, False)])
def test_what_an_agent_has_driven_at_most_is_counted_half_an_interval_later(
    front: float, met: bool
) -> None:
    """From 10 m/s with 2.4 m/s2: 17.7 m within 1.5 s. The ego crosses so far ahead of it; its side
    is 0.9 m from its middle."""
    task, local, state = situation(CROSSING, ":sn_0", 13.3, 0.0, ways=("si", "no"))
    x = 1.6 - task.ego.half_width - front
    agent = Agent("x", "wi_0", 100.0 + x, 10.0)
    task, local, state = situation(CROSSING, ":sn_0", 10.9, 0.0, agent, ways=("si", "no"))
    assert obstructed(local, task, state, 1.0, 1.0) is met


def test_from_one_time_to_the_next_it_reaches_no_further_than_its_top_speed() -> None:
    """It drives 12 m/s and may not drive faster: 18 m, not 20.7 m."""
    for top, met in ((12.0, False), (20.0, True)):
        x = 1.6 - 0.9 - 19.0
        agent = Agent("x", "wi_0", 100.0 + x, 12.0)
        task, local, state = situation(CROSSING, ":sn_0", 10.9, 0.0, agent, ways=("si", "no"))
        assert obstructed(local, task, state, 1.0, 1.0, top) is met


@pytest.mark.parametrize("ahead", [EASTWARD, NORTHWARD])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_who_drives_off_is_met_where_it_is_now(ahead: tuple[float, float], side: float) -> None:
    """Its rear still touches the box of the ego, at the next forecast time it is 8 m away. It goes
    across the ego's heading or against it, east or north."""
    c, s = ahead[0] * side, ahead[1] * side
    task, local, state = situation(LANES, "a_1", 102.5, 0.0, Agent("x", "a_1", 300.0, 40.0))
    ego = np.array([100.0, 0.0])
    reach = (2.5 if ahead == EASTWARD else 0.9) + 2.5 - 0.05
    first = ego + reach * np.array([c, s])
    places = [(*(first + 8.0 * k * np.array([c, s])), 8.0 * k) for k in range(40)]
    local = moved(local, *places)
    local.agent[:, 0, COS], local.agent[:, 0, SIN] = c, s
    assert obstructed(local, task, state, 0.01, 0.02, 40.0)
    gone = local.agent.copy()
    gone[0, 0, NODE] = GONE  # it is not there yet, so nobody knows where it could be
    assert not obstructed(local._replace(agent=gone), task, state, 0.01, 0.02, 40.0)


@pytest.mark.parametrize("ahead", [EASTWARD, NORTHWARD])
def test_the_first_look_reaches_as_far_as_bodies_and_path(ahead: tuple[float, float]) -> None:
    """A truck of 16 m that comes towards the ego from either side: 10 m within the second."""
    c, s = ahead
    for side in (1.0, -1.0):
        for gap, met in ((9.8, True), (11.5, False)):
            lorry = Agent("x", "a_1", 300.0, 10.0, length=16.0, width=2.5)
            task, local, state = situation(LANES, "a_1", 102.5, 0.0, lorry)
            away = gap + 8.0 + (2.5 if ahead == EASTWARD else 0.9)
            x, y = 100.0 - side * away * c, -side * away * s
            places = [(x + side * 2 * k * c, y + side * 2 * k * s, 2.0 * k) for k in range(40)]
            local = moved(local, *places)
            local.agent[:, 0, COS], local.agent[:, 0, SIN] = side * c, side * s
            local.agent[:, 0, NODE] = -1.0  # on no lane of the ego, so not behind it
            local.trait[0, REACTS] = 0.0
            assert obstructed(local, task, state, 0.95, 0.1, 10.0) is met


# --- its path ---


def crosses(x: float) -> Box:
    """A box on the path y = 0 of the agent, across it."""
    return Box(x, 0.0, 0.0, 1.0, 2.5, 0.9)


def waiting() -> tuple[LocalMap, State]:
    """An agent that stands at 300 m until the third forecast time, and is 30 m further at the
    fourth."""
    _, local, state = situation(LANES, "a_0", 100.0, 0.0, Agent("x", "a_1", 302.5, 5.0))
    return moved(
        local, (300.0, 0.0, 0.0), (300.0, 0.0, 0.0), (300.0, 0.0, 0.0), (330.0, 0.0, 30.0)
    ), state


def test_between_a_stand_and_the_next_place_all_is_covered() -> None:
    local, state = waiting()
    for x, met in ((300.0, True), (315.0, True), (333.3, True), (333.5, False)):
        assert bool(plain(_meets)(local, state, 0, 0.0, 90.0, 90.0, crosses(x))) is met
    for x, met in ((311.0, True), (314.0, False)):  # 10 m at most, its length and the box
        assert bool(plain(_meets)(local, state, 0, 0.0, 10.0, 10.0, crosses(x))) is met


def test_who_leaves_the_map_is_met_nowhere_after_that() -> None:
    """What its columns hold then means nothing."""
    _, local, state = situation(LANES, "a_0", 100.0, 0.0, Agent("x", "a_1", 302.5, 10.0))
    agent = local.agent.copy()
    agent[5:, 0, NODE] = GONE
    local = local._replace(agent=agent)
    there = float(agent[4, 0, X])
    assert plain(_meets)(local, state, 0, 0.0, 90.0, 90.0, crosses(there))
    assert not plain(_meets)(local, state, 0, 0.0, 90.0, 90.0, crosses(there + 15.0))


def test_at_the_end_of_the_forecast_it_is_at_its_last_place() -> None:
    """If it drives further at least: its front is 2.5 m ahead, the box 0.9 m to each side."""
    _, local, state = situation(LANES, "a_0", 100.0, 0.0, Agent("x", "a_1", 302.5, 10.0))
    last = len(local.agent) - 1
    local = moved(local, *[(300.0 + 2.0 * k, 0.0, 2.0 * k) for k in range(last + 1)])
    end = 300.0 + 2.0 * last
    for x, met in ((end + 3.3, True), (end + 3.5, False), (end - 3.3, True), (end - 3.5, False)):
        assert bool(plain(_meets)(local, state, 0, 999.0, 1999.0, 1999.0, crosses(x))) is met


def test_who_comes_from_behind_brakes_within_what_it_reaches_reacting() -> None:
    """From one place to the next it drives 2 m; a box is 9.5 m ahead of its middle, so that it
    touches after 4.5 m, and before 5 m behind it. A box half a metre ahead is one ahead."""
    _, local, state = situation(LANES, "a_0", 100.0, 0.0, Agent("x", "a_1", 302.5, 10.0))
    local = moved(local, *[(300.0 + 2.0 * k, 0.0, 2.0 * k) for k in range(20)])
    ahead = Box(309.5, 0.0, 1.0, 0.0, 2.5, 0.9)
    for reacting, met in ((4.2, False), (4.8, True), (9.0, True), (-1.0, False)):
        assert bool(plain(_meets)(local, state, 0, 0.0, 9.0, reacting, ahead)) is met
    for x, met in ((300.5, False), (299.5, True)):
        box = Box(x, 0.0, 1.0, 0.0, 2.5, 0.9)
        assert bool(plain(_meets)(local, state, 0, 0.0, 9.0, -1.0, box)) is met


def test_who_is_just_behind_now_is_behind() -> None:
    """A moment later its front is beyond that of the ego."""
    _, local, state = situation(LANES, "a_1", 200.0, 0.0, Agent("x", "a_1", 199.5, 10.0))
    assert plain(_is_behind)(local, state, 0)
    _, local, state = situation(LANES, "a_1", 200.0, 0.0, Agent("x", "a_1", 200.5, 10.0))
    assert not plain(_is_behind)(local, state, 0)


def test_a_lane_that_goes_on_without_a_junction_is_clear() -> None:
    road = build([
        Lane("a", 0, ((0, 0), (50, 0)), ("b_0",)), Lane("b", 0, ((50, 0), (100, 0)), (":m_0",)),
        Lane(":m", 0, ((100, 0), (120, 0)), ("c_0",), junction="m"),
        Lane("c", 0, ((120, 0), (220, 0))),
    ])  # fmt: skip
    for name, s, clear in (("a_0", 48.0, 0.0), ("b_0", 48.0, 2.0 + 20.0 + 5.0), ("c_0", 99.0, 0.0)):
        route = edges(road, *"abc") if name != "c_0" else edges(road, "c")
        ego = ego_at(road, name, s, 9.0, route=route)
        task = task_of(road, ego)
        local, state = local_of(task, scene_of(ego, road))
        assert plain(_to_clear)(local, task.ego, state) == pytest.approx(clear)


# --- how it drives ---


def driven(
    task: Task,
    local: LocalMap,
    state: State,
    begin: int,
    *speeds: float,
    side: int = 0,
    period: int = 5,
) -> tuple[int, int, float, np.ndarray, np.ndarray, np.ndarray]:
    nodes, motion, pose = np.zeros(300, np.int64), np.zeros((300, 2)), np.zeros((300, 4))
    top = np.full(local.agent.shape[1], 20.0)
    used, agent, when = drive(
        local, task.ego, ASSUMED, top, state, np.array(speeds), side, period, begin, 4.0,
        nodes, motion, pose,
    )  # fmt: skip
    return used, agent, when, nodes[:used], motion[:used], pose[:used]


def test_it_ends_where_its_road_ends_with_a_row_for_each_step() -> None:
    """At 10 m/s, 3 m before the end, in steps of 0.1 s."""
    task, local, state = situation(LANES, "a_1", 497.5, 10.0)
    used, agent, when, nodes, motion, pose = driven(task, local, state, BRAKE, *[10.0] * 5)
    assert (used, agent) == (3, NO_AGENT) and when == pytest.approx(0.2)
    assert motion[:, 0] == pytest.approx([498.5, 499.5, 500.5], abs=0.6)
    assert motion[:, 1] == pytest.approx(10.0) and set(nodes) == {state.node}
    assert pose[:, 0] == pytest.approx(motion[:, 0] - 2.5, abs=0.6)
    assert np.allclose(pose[:, 2:], (1.0, 0.0))


def test_a_commanded_lane_change_is_driven_and_ended() -> None:
    """Three seconds to the left, 3.2 m; then it brakes."""
    task, local, state = situation(LANES, "a_1", 100.0, 10.0)
    used, agent, _, _, motion, pose = driven(task, local, state, HOLD, *[10.0] * 5, side=1)
    assert agent == NO_AGENT and used > 50
    assert 0.0 < pose[0, 1] < 0.2 and 2.5 < pose[29, 1] < pose[-1, 1] == pytest.approx(
        3.2, abs=0.05
    )
    assert motion[28, 1] == pytest.approx(10.0) and motion[32, 1] < 9.9


def test_a_manoeuvre_that_takes_longer_than_half_a_minute_has_no_end() -> None:
    """Half a metre a second over a junction of 40 m."""
    road = build([
        Lane("a", 0, ((0, 0), (50, 0)), (":m_0",)),
        Lane(":m", 0, ((50, 0), (90, 0)), ("b_0",), junction="m"),
        Lane("b", 0, ((90, 0), (190, 0))),
    ])  # fmt: skip
    ego = ego_at(road, ":m_0", 10.0, 0.5, route=edges(road, "a", "b"))
    task = task_of(road, ego)
    seen = situation_of(task, scene_of(ego, road))
    fail_safe = FailSafe(ASSUMED, 0.5)
    fail_safe.start(task)
    local, _ = local_of(task, seen.scene)
    plan, why = fail_safe._drive(local, seen, Follow(np.full(5, 0.5), 0), HOLD, 3.0)
    assert why == Obstacle(NO_END, pytest.approx(30.0)) and len(plan.v) == 300
    assert plan.time == pytest.approx(PHYSICS.step * np.arange(1, 301))
    quick, why = fail_safe._drive(local, seen, Follow(np.full(5, 0.5), 0), BRAKE, 3.0)
    assert why.agent == NO_AGENT and len(quick.v) < 100


def test_the_gentlest_manoeuvre_is_taken_and_of_none_the_hardest_stop_is_told() -> None:
    """16 m to a wall from 10 m/s: in comfort, with 3 m/s2, it takes 19 m; 12 m are enough for the
    strongest braking; 7 m for none."""
    for gap, verified in ((30.0, True), (16.0, True), (6.0, False)):
        ego = ego_at(LANES, "a_1", 100.0, 10.0)
        task = task_of(LANES, ego)
        wall = Agent("wall", "a_1", 105.0 + gap, 0.0)
        seen = situation_of(task, scene_of(ego, LANES, wall))
        fail_safe = FailSafe(ASSUMED, 0.1)
        fail_safe.start(task)
        made, why = fail_safe._search(seen, Follow(np.array([10.0]), 0))
        assert (made is not None) is verified
        if made is None:
            assert why.agent == 0 and 0.5 < why.time < 1.2
        else:
            hardest = float(-np.diff(made.plan.v).min() / 0.1)
            assert hardest == pytest.approx(3.0 if gap == 30.0 else task.ego.max_decel, abs=0.05)
            assert made.verified and made.time == 0.0


def test_without_a_verified_manoeuvre_it_brakes_in_its_lane() -> None:
    """From the first step on, whether or not that can be verified."""
    for wall, verified in ((), True), ((Agent("wall", "a_1", 106.0, 0.0),), False):
        ego = ego_at(LANES, "a_1", 100.0, 10.0)
        task = task_of(LANES, ego)
        seen = situation_of(task, scene_of(ego, LANES, *wall))
        fail_safe = FailSafe(ASSUMED, 0.5)
        fail_safe.start(task)
        made = fail_safe.fall_back(seen, "late", None)
        assert made.plan is not None and set(made.plan.lane) == {ego.lane}
        assert made.plan.pose[:, 1] == pytest.approx(0.0) and made.plan.v[0] < 10.0
        assert (made.reason == "fail-safe: late") is verified
        assert np.array_equal(made.command.speeds, made.plan.v)  # type: ignore[union-attr]
