"""The fail-safe piece by piece: distances against plain integration, and values worked out by
hand."""

import math

import numpy as np
import pytest
from helpers import Agent, Lane, agents_at, build, crossing, edges, ego_at, lane
from helpers_model import (
    ASSUMED,
    lanes_east,
    local_of,
    plain,
    scene_of,
    situation_of,
    task_of,
)

from sumo_mcts.driver.params import Physics
from sumo_mcts.model.local_map import DRIVEN, GONE, NODE, State
from sumo_mcts.model.motion import begin_change
from sumo_mcts.numerics.geometry import Box, X
from sumo_mcts.planners.base import Task
from sumo_mcts.planners.failsafe import FailSafe, Manoeuvre, _in_words, _rest, coming
from sumo_mcts.planners.failsafe import Obstacle as Why
from sumo_mcts.planners.failsafe_reach import (
    ACCELERATE,
    BRAKE,
    HOLD,
    NO_AGENT,
    NO_END,
    _covers,
    _driven_least,
    _driven_most,
    _driven_reacting,
    _is_behind,
    _meets,
    _obstructing,
    _to_clear,
    drive,
)
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import EgoState, Follow, Plan

LANES, CROSSING = lanes_east(3, 500.0), crossing(bridge=False)
TICK = 1e-3  # s


# --- what agents drive, against plain integration ---


def driven(v: float, top: float, time: float, phases: list[tuple[float, float]]) -> float:
    """m driven from v with accelerations, each up to a time, between standing and the top speed."""
    x = 0.0
    for k in range(round(time / TICK)):
        accel = next(a for a, until in phases if k * TICK < until - 1e-9)
        after = min(max(v + accel * TICK, 0.0), top)
        x, v = x + 0.5 * (v + after) * TICK, after
    return x


@pytest.mark.parametrize("v", [0.0, 3.0, 12.0])
@pytest.mark.parametrize("time", [0.3, 1.5, 4.0])
@pytest.mark.parametrize("top", [12.5, 30.0])
def test_bounds_of_what_an_agent_drives(v: float, time: float, top: float) -> None:
    q = ASSUMED
    least = driven(v, top, time, [(-q.decel, math.inf)])
    assert plain(_driven_least)(v, q.decel, time) == pytest.approx(least, abs=0.02)
    most = driven(v, top, time, [(q.accel, math.inf)])
    assert plain(_driven_most)(v, q.accel, top, time) == pytest.approx(most, abs=0.02)
    reacting = driven(v, top, time, [(q.accel, q.reaction), (-q.yield_decel, math.inf)])
    assert plain(_driven_reacting)(v, q, top, time) == pytest.approx(reacting, abs=0.02)


# --- where the junction is left ---


def situation(road: RoadMap, ego: EgoState, *agents: Agent) -> tuple:
    """Task, local map and state."""
    task = task_of(road, ego)
    return task, *local_of(task, scene_of(ego, road, *agents))


@pytest.mark.parametrize(
    ("name", "s", "v", "clear"),
    [
        (":sn_0", 6.0, 5.0, 14.0 + 5.0),  # to its end, and the length of the ego
        ("si_0", 60.0, 9.0, 0.0),  # 30 m before the line
        ("si_0", 75.2, 9.0, 0.0),  # 14.8 m
        ("si_0", 76.0, 9.0, 14.0 + 20.0 + 5.0),
        ("si_0", 89.5, 0.0, 0.0),
        ("no_0", 2.0, 9.0, 0.0),
    ],
)
def test_how_far_it_is_to_clear_the_junction(name: str, s: float, v: float, clear: float) -> None:
    """The ego stops from 9 m/s in 9 * 9 / (2 * 3) = 13.5 m, and 0.9 m are a step (0.1 s)."""
    route = edges(CROSSING, "si", "no") if name != "no_0" else edges(CROSSING, "no")
    task, local, state = situation(CROSSING, ego_at(CROSSING, name, s, v, route=route))
    assert task.ego.comfort_decel == 3.0 and task.ego.step == 0.1
    assert plain(_to_clear)(local, task.ego, state) == pytest.approx(clear)


def test_a_junction_of_several_lanes_is_cleared_behind_the_last() -> None:
    road = build(
        [
            Lane("a", 0, ((0, 0), (50, 0)), (":m_0",)),
            Lane(":m", 0, ((50, 0), (60, 0)), (":n_0",), junction="m"),
            Lane(":n", 0, ((60, 0), (67, 0)), ("b_0",), junction="m"),
            Lane("b", 0, ((67, 0), (160, 0))),
        ]
    )
    for name, s, clear in (("a_0", 49.0, 1.0 + 17.0), (":m_0", 4.0, 6.0 + 7.0), (":n_0", 4.0, 3.0)):
        ego = ego_at(road, name, s, 9.0, route=edges(road, "a", "b"))
        task, local, state = situation(road, ego)
        assert plain(_to_clear)(local, task.ego, state) == pytest.approx(clear + 5.0)


# --- who is behind ---


@pytest.mark.parametrize(
    ("name", "s", "other", "behind"),
    [
        ("a_1", 190.0, -1, True),
        ("a_1", 210.0, -1, False),
        ("a_2", 190.0, -1, False),
        ("a_2", 190.0, 2, True),  # in the lane that the ego changes to
        ("a_2", 210.0, 2, False),
        ("a_2", 199.5, 2, True),
    ],
)
def test_behind_is_who_comes_along_a_lane_of_the_ego(
    name: str, s: float, other: int, behind: bool
) -> None:
    task, local, state = situation(LANES, ego_at(LANES, "a_1", 200.0), Agent("x", name, s))
    if other >= 0:
        nodes = {int(k): i for i, k in enumerate(task.route.lane)}
        state = state._replace(other=nodes[lane(LANES, f"a_{other}")], progress=0.1)
    assert plain(_is_behind)(local, state, 0) is behind


# --- a path of an agent and a box ---


def beside(x: float, y: float = 0.0, turned: float = 0.0) -> Box:
    """A box of 5 m and 1.8 m."""
    return Box(x, y, math.cos(turned), math.sin(turned), 2.5, 0.9)


def along_the_middle(v: float = 10.0) -> tuple[Task, object, State]:
    """An agent whose middle is at x = 300 and who drives east on y = 0, seen by an ego far away."""
    return situation(LANES, ego_at(LANES, "a_0", 100.0, 0.0), Agent("x", "a_1", 302.5, v))


@pytest.mark.parametrize(
    ("least", "most", "x", "y", "met"),
    [
        (20.0, 40.0, 330.0, 0.0, True),
        (20.0, 40.0, 344.9, 0.0, True),  # at most 340, and 5 m between the middles
        (20.0, 40.0, 345.2, 0.0, False),
        (20.0, 40.0, 315.2, 0.0, True),  # at least 320
        (20.0, 40.0, 314.8, 0.0, False),
        (20.0, 40.0, 330.0, 1.75, True),
        (20.0, 40.0, 330.0, 1.85, False),
        (20.0, 40.0, 330.0, -1.85, False),
        (0.0, 0.0, 304.9, 0.0, True),  # it stays where it is
        (0.0, 0.0, 305.1, 0.0, False),
    ],
)
def test_an_agent_covers_its_path_from_the_least_to_the_most(
    least: float, most: float, x: float, y: float, met: bool
) -> None:
    _, local, state = along_the_middle(10.0 if most else 0.0)
    crosswise = beside(x, y), beside(x, y, math.pi)  # comes towards it, so nobody brakes for it
    assert bool(plain(_meets)(local, state, 0, least, most, most, crosswise[1])) is met
    assert bool(plain(_meets)(local, state, 0, least, most, most, crosswise[0])) is met
    if x >= 330.0:  # it drives up to the box from behind, and brakes before it comes so far
        assert not plain(_meets)(local, state, 0, least, most, 0.0, crosswise[0])


def test_who_stands_sets_off_towards_nobody_who_is_in_its_way() -> None:
    _, local, state = along_the_middle(0.005)
    for turned in (0.0, math.pi / 2, math.pi):
        box = beside(304.5, 0.0, turned)
        assert plain(_meets)(local, state, 0, 0.0, 5.0, 5.0, box)
    far = beside(320.0, 0.0, math.pi / 2)
    assert not plain(_meets)(local, state, 0, 0.0, 5.0, 5.0, far)


def test_between_two_times_the_part_between_counts() -> None:
    """At 10 m/s: 10 m from the fifth to the tenth forecast time, 0.2 s apart."""
    _, local, state = along_the_middle()
    t, then = 5, 10

    def covers(x: float, least: float, most: float) -> bool:
        return bool(plain(_covers)(local, state, 0, t, then, least, most, beside(x)))

    here = float(local.agent[t, 0, 0])
    driven_then = here - 300.0
    length = float(local.agent[then, 0, 0]) - here
    assert length > 8.0
    for share, at in ((0.0, 0.0), (0.4, 0.4 * length)):
        least, most = driven_then + share * length, driven_then + 0.8 * length
        assert covers(here + at - 4.9, least, most) and not covers(here + at - 5.1, least, most)
        end = here + 0.8 * length
        assert covers(end + 4.9, least, most) and not covers(end + 5.1, least, most)
    # beyond both ends only what lies between the two times
    assert not covers(here - 5.1, 0.0, 99.0)
    assert not covers(here + length + 5.1, 0.0, 99.0)


def test_where_the_forecast_ends_the_agent_stays() -> None:
    """It has driven less than it drives at least: it waits there, unless it has left the map."""
    _, local, state = along_the_middle()
    agent = local.agent.copy()
    agent[8:] = agent[8]  # it waits from then on
    end, driven_there = float(agent[8, 0, X]), float(agent[8, 0, DRIVEN])
    box, far = beside(end, 0.0, math.pi), (driven_there + 5.0, driven_there + 9.0)
    waits = local._replace(agent=agent)
    assert plain(_meets)(waits, state, 0, *far, far[1], box)
    agent = agent.copy()
    agent[9:, 0, NODE] = GONE
    assert not plain(_meets)(local._replace(agent=agent), state, 0, *far, far[1], box)


def test_of_a_forecast_of_one_moment_the_place_counts() -> None:
    _, local, state = along_the_middle()
    alone = local._replace(agent=local.agent[:1])
    assert plain(_meets)(alone, state, 0, 0.0, 9.0, 9.0, beside(304.9, 0.0, math.pi))
    assert not plain(_meets)(alone, state, 0, 0.0, 9.0, 9.0, beside(305.1, 0.0, math.pi))


@pytest.mark.parametrize(
    ("y", "turned", "met"),
    [
        (-30.0, math.pi / 2, False),  # in front of it, the same way: it brakes
        (-30.0, math.pi / 2 - 0.6, False),  # nearly
        (-30.0, math.pi / 2 - 0.7, True),  # across
        (-30.0, -math.pi / 2, True),
        (-52.0, math.pi / 2, True),  # beside where it is now
    ],
)
def test_northward_too_who_comes_from_behind_brakes(y: float, turned: float, met: bool) -> None:
    """The middle of the agent is at y = -50; it may drive up to 40 m, or none if it reacts."""
    far = ego_at(CROSSING, "si_0", 10.0, 0.0, route=edges(CROSSING, "si", "no"))
    agent = Agent("x", "si_0", 52.5, 10.0)
    _, local, state = situation(CROSSING, far, agent)
    box = Box(1.6, y, math.cos(turned), math.sin(turned), 2.5, 0.9)
    assert bool(plain(_meets)(local, state, 0, 0.0, 40.0, -1.0, box)) is met


@pytest.mark.parametrize(
    ("x", "y", "met"),
    [
        (1.6, -25.2, True), (1.6, -24.9, False),  # its front at most
        (1.6, -44.8, True), (1.6, -45.2, False),  # and its rear at least
        (3.35, -35.0, True), (3.45, -35.0, False), (-0.25, -35.0, False),
    ],
)  # fmt: skip
def test_northward_too_it_covers_its_path(x: float, y: float, met: bool) -> None:
    """The middle of the agent is at y = -60, and it drives from 20 m to 30 m."""
    far = ego_at(CROSSING, "si_0", 10.0, 0.0, route=edges(CROSSING, "si", "no"))
    _, local, state = situation(CROSSING, far, Agent("x", "si_0", 42.5, 10.0))
    box = Box(x, y, 0.0, -1.0, 2.5, 0.9)
    assert bool(plain(_meets)(local, state, 0, 20.0, 30.0, 30.0, box)) is met


@pytest.mark.parametrize(("name", "met"), [("br_0", False), ("eo_0", True)])
def test_on_a_bridge_nobody_is_met(name: str, met: bool) -> None:
    """The bridge crosses 40 m behind the junction, at s = 98.4 m of its own."""
    road = crossing()
    ego = ego_at(road, "eo_0", 42.5, 0.0)
    s = 100.9 if name == "br_0" else 42.5
    _, local, state = situation(road, ego, Agent("x", name, s, 0.0))
    box = Box(50.0, -1.6, -1.0, 0.0, 2.5, 0.9)
    assert bool(plain(_meets)(local, state, 0, 0.0, 0.0, 0.0, box)) is met


# --- the ego among all ---


def obstructed(
    agent: Agent, s: float, v: float, moment: float = 0.1, interval: float = 0.1,
    aside: float = 0.0, progress: float = 0.0,
) -> bool:  # fmt: skip
    """Whether an agent could be where the ego is at that moment, on its lane."""
    task, local, state = situation(LANES, ego_at(LANES, "a_1", 100.0, v), agent)
    local = local._replace(aside=aside)
    there = state._replace(s=s, progress=progress, other=2 if progress else -1)
    found = plain(_obstructing)(
        local, task.ego, ASSUMED, np.array([20.0]), state, there, moment, interval
    )
    assert found in (0, NO_AGENT)
    return bool(found == 0)


@pytest.mark.parametrize(("gap", "met"), [(0.45, True), (0.55, False)])
def test_the_box_of_the_ego_is_drawn_out_for_half_an_interval(gap: float, met: bool) -> None:
    """At 10 m/s and 0.1 s: half a metre to the front and to the rear."""
    assert obstructed(Agent("x", "a_1", 305.0 + gap, 0.0), 300.0, 10.0) is met
    assert not obstructed(Agent("x", "a_1", 305.05, 0.0), 300.0, 0.0)


@pytest.mark.parametrize(("gap", "met"), [(0.25, True), (0.35, False)])
def test_a_lane_change_keeps_room_aside(gap: float, met: bool) -> None:
    beside_it = Agent("x", "a_1", 300.0, 0.0, d=1.8 + gap)
    assert obstructed(beside_it, 300.0, 0.0, aside=0.3, progress=1e-4) is met
    assert not obstructed(beside_it, 300.0, 0.0, aside=0.3)


@pytest.mark.parametrize(("s", "met"), [(301.7, False), (302.0, True), (304.0, True)])
def test_what_an_agent_ahead_has_driven_at_least_is_counted_half_an_interval_before(
    s: float, met: bool
) -> None:
    """Its rear is at 297.5 m; within 0.5 s it drives 4.375 m if it brakes with 5 m/s2."""
    agent = Agent("x", "a_1", 302.5, 10.0)
    assert obstructed(agent, s, 0.0, moment=1.0, interval=1.0) is met


# --- a manoeuvre ---


def driven_by(
    task: Task, local: object, state: State, begin: int, *speeds: float, period: int = 5,
    horizon: float = 6.0,
) -> tuple[int, int, float, np.ndarray]:  # fmt: skip
    """Steps, the agent met, when, and the speeds."""
    nodes, motion, pose = np.zeros(200, np.int64), np.zeros((200, 2)), np.zeros((200, 4))
    top = np.full(local.agent.shape[1], 20.0)  # type: ignore[attr-defined]
    used, agent, when = drive(
        local, task.ego, ASSUMED._replace(horizon=horizon), top, state, np.array(speeds), 0,
        period, begin, 4.0, nodes, motion, pose,
    )  # fmt: skip
    return used, agent, when, motion[:used, 1]


def test_after_the_period_it_brakes_to_a_stand_and_stays_there_until_the_horizon() -> None:
    task, local, state = situation(LANES, ego_at(LANES, "a_1", 200.0, 10.0))
    used, agent, when, v = driven_by(task, local, state, BRAKE, *[10.0] * 5)
    assert (used, agent) == (60, NO_AGENT) and when == pytest.approx(5.9)
    assert v[:5] == pytest.approx(10.0) and np.all(np.diff(v[4:]) <= 0.0) and v[-1] < 0.01
    stands = int(np.flatnonzero(v < 0.01)[0]) + 1
    assert 30 <= stands <= 36  # 2.5 s of braking with 4 m/s2, and what the jerk costs
    short = driven_by(task, local, state, BRAKE, *[10.0] * 5, horizon=1.0)
    assert short[0] == stands
    assert driven_by(task, local, state, BRAKE, 10.0, 9.9)[3][:5] == pytest.approx(
        [10.0, 9.9, 9.8, 9.7, 9.6]  # a command that is too short goes on braking
    )


def test_on_a_free_road_another_manoeuvre_than_braking_is_none() -> None:
    task, local, state = situation(LANES, ego_at(LANES, "a_1", 200.0, 10.0))
    for begin in (HOLD, ACCELERATE):
        used, agent, when, _ = driven_by(task, local, state, begin, *[10.0] * 5)
        assert (used, agent) == (5, NO_END) and when == pytest.approx(0.5)


def test_on_a_junction_it_holds_its_speed_or_accelerates_until_it_is_clear() -> None:
    """14 m to the end, and 5 m of its own: 3.8 s at 5 m/s."""
    ego = ego_at(CROSSING, ":sn_0", 6.0, 5.0, route=edges(CROSSING, "si", "no"))
    task, local, state = situation(CROSSING, ego)
    holds = driven_by(task, local, state, HOLD, *[5.0] * 5)[3]
    kept = int(np.flatnonzero(holds < 4.99)[0])
    assert abs(kept - 38) <= 1
    faster = driven_by(task, local, state, ACCELERATE, *[5.0] * 5)[3]
    assert faster.max() > 8.0 and int(np.argmax(faster)) < 30 and faster[-1] < 0.01
    assert np.all(np.diff(driven_by(task, local, state, BRAKE, *[5.0] * 5)[3][5:]) <= 0.0)


def test_a_lane_change_is_ended_before_it_brakes() -> None:
    """It takes 3 s."""
    task, local, state = situation(LANES, ego_at(LANES, "a_1", 200.0, 10.0))
    changing = begin_change(local, task.ego, state, 1)
    used, agent, _, v = driven_by(task, local, changing, HOLD, *[10.0] * 5)
    assert agent == NO_AGENT and used >= 60
    assert abs(int(np.flatnonzero(v < 9.99)[0]) - 30) <= 1
    assert np.all(driven_by(task, local, changing, BRAKE, *[10.0] * 5)[3][7:] < 10.0)


def test_without_a_command_the_ego_does_not_go_on_accelerating() -> None:
    task, local, state = situation(LANES, ego_at(LANES, "a_1", 200.0, 10.0))
    for a, v in ((1.0, 10.0), (-1.0, 9.9)):
        assert driven_by(task, local, state._replace(a=a), BRAKE, period=1)[3][0] == v


def test_within_long_steps_the_boxes_are_looked_at_every_quarter_of_a_second() -> None:
    ego = ego_at(LANES, "a_1", 200.0, 10.0)
    task = task_of(LANES, ego, physics=Physics(0.5, False, 3.0))
    for gap, when in ((3.5, 0.25), (6.0, 0.5), (8.5, 0.75)):
        wall = Agent("wall", "a_1", 205.0 + gap, 0.0)
        local, state = local_of(task, scene_of(ego, LANES, wall, step=0.5))
        steps = math.ceil(when / 0.5)
        assert driven_by(task, local, state, BRAKE, 10.0, 10.0, period=2)[:3] == (steps, 0, when)


@pytest.mark.parametrize(("room", "met"), [(0.15, False), (-0.05, True)])
def test_a_wall_is_met_where_the_stop_comes_too_late(room: float, met: bool) -> None:
    task, local, state = situation(LANES, ego_at(LANES, "a_1", 200.0, 10.0))
    v = driven_by(task, local, state, BRAKE, *[10.0] * 5)[3]
    wall = Agent("wall", "a_1", 200.0 + 0.1 * float(v.sum()) + room + 5.0, 0.0)
    task, local, state = situation(LANES, ego_at(LANES, "a_1", 200.0, 10.0), wall)
    used, agent, when, _ = driven_by(task, local, state, BRAKE, *[10.0] * 5)
    assert agent == (0 if met else NO_AGENT)
    if met:
        assert when == pytest.approx(used * 0.1) and 2.0 < when < 3.6


# --- words, and what is left ---


@pytest.mark.parametrize("heading", [0.0, 1.4, 2.0])
@pytest.mark.parametrize(
    ("ahead", "turned", "word"),
    [
        (20.0, 0.0, "ahead"), (-20.0, 0.0, "behind"), (1.0, 0.0, "ahead"), (-1.0, 0.0, "behind"), (20.0, math.pi, "oncoming"),
        (20.0, math.pi / 2, "crossing"), (20.0, -math.pi / 2, "crossing"),
        (20.0, math.radians(36.0), "ahead"), (20.0, math.radians(38.0), "crossing"),
    ],
)  # fmt: skip
def test_how_an_agent_comes(heading: float, ahead: float, turned: float, word: str) -> None:
    ego = ego_at(LANES, "a_1", 200.0)._replace(heading=heading, y=50.0)
    c, s = math.cos(heading), math.sin(heading)
    x, y = ego.x + ahead * c + 3.0 * s, ego.y + ahead * s - 3.0 * c  # 3 m to the right
    agents = agents_at(LANES, Agent("x", "", x=x, y=y, heading=heading + turned))
    assert coming(ego, agents, 0) == word


def test_an_obstacle_in_words() -> None:
    ego = ego_at(LANES, "a_1", 200.0)
    task = task_of(LANES, ego)
    seen = situation_of(task, scene_of(ego, LANES, Agent("x", "a_1", 230.0, 7.0)))
    words = _in_words(seen, Why(0, 2.5))
    assert "x (ahead, 30 m away, 7.0 m/s)" in words and "in 2.5 s" in words
    assert "not seen, in 2.5 s" in _in_words(seen, Why(1, 2.5))
    assert _in_words(seen, Why(NO_END, 2.5)) == "the ego would not come to a stop"


@pytest.mark.parametrize(("now", "first"), [(5.0, 0), (5.1, 1), (5.3, 3), (9.0, 4)])
def test_what_is_left_of_a_manoeuvre(now: float, first: int) -> None:
    """It began at 5 s and has five states, 0.1 s apart; at its end the last one goes on."""
    steps = np.arange(1.0, 6.0)
    plan = Plan(0.1 * steps, steps, steps.astype(np.int32), 10 * steps, np.tile(steps, (4, 1)).T)
    left = _rest(Manoeuvre(5.0, plan, True), now)
    assert left.v.tolist() == steps[first:].tolist() == left.lane.tolist()
    assert left.time == pytest.approx(0.1 * steps[first:] - (now - 5.0))
    assert left.s.tolist() == (10 * steps[first:]).tolist()


def test_the_decision_to_fall_back_chose_no_candidate_and_brakes_at_once() -> None:
    ego = ego_at(LANES, "a_1", 200.0, 10.0)
    task = task_of(LANES, ego)
    seen = situation_of(task, scene_of(ego, LANES))
    fail_safe = FailSafe(ASSUMED, 0.5)
    fail_safe.start(task)
    made = fail_safe.fall_back(seen, "late", None)
    assert (made.children, made.chosen, made.iterations, made.known) == ((), -1, 0, 0)
    assert isinstance(made.command, Follow) and made.command.lane_change == 0
    assert made.command.speeds[0] < 10.0 and made.reason == "fail-safe: late"
    planned = made._replace(command=Follow(np.ones(3), 1), chosen=4, iterations=70, reason="search")
    replaced = fail_safe.fall_back(seen, "unsafe", planned)
    assert isinstance(replaced.command, Follow) and replaced.command.lane_change == 0
    assert (replaced.chosen, replaced.iterations, replaced.reason) == (-1, 70, "fail-safe: unsafe")


def test_agents_may_be_a_quarter_faster_than_allowed_or_as_fast_as_they_are() -> None:
    ego = ego_at(LANES, "a_0", 100.0)  # the limit is 15 m/s
    task = task_of(LANES, ego)
    agents = (
        Agent("calm", "a_1", 150.0, 5.0), Agent("fast", "a_1", 250.0, 25.0),
        Agent("walks", "", v=1.0, x=300.0, y=30.0),
    )  # fmt: skip
    seen = situation_of(task, scene_of(ego, LANES, *agents))
    fail_safe = FailSafe(ASSUMED, 0.5)
    fail_safe.start(task)
    local, _ = local_of(task, seen.scene)
    top = fail_safe._top_speeds(seen, local)
    assert top[:2] == pytest.approx([18.75, 25.0])
