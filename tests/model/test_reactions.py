"""Others that react to the ego inside the search."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from helpers import Agent, crossing, edges, ego_at
from helpers_model import (
    compiled,
    ego_lanes,
    lanes_east,
    local_of,
    plain,
    scene_of,
    situation_of,
    task_of,
    traffic_params,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from sumo_mcts.model.interaction import place_is_free
from sumo_mcts.model.local_map import (
    CLOCK,
    DRIVEN,
    GONE,
    KERB,
    NODE,
    OWED,
    PAST,
    SLOT,
    SPEED,
    LocalMap,
    S,
    State,
    V,
)
from sumo_mcts.model.motion import begin_change
from sumo_mcts.model.reactions import (
    HELPS,
    IMPOSED,
    _gap_across,
    react,
    seen,
    undisturbed,
)
from sumo_mcts.numerics.geometry import COS, SIN, X, Y
from sumo_mcts.numerics.krauss import DECEL, STANDSTILL, USUAL_S, safe_gap, safe_speed
from sumo_mcts.planners import base
from sumo_mcts.planners.base import Task
from sumo_mcts.prediction.forecast import Question, predict
from sumo_mcts.scene import STARTS, Intent

DT = 0.2  # s between looks, and between forecast times
LENGTH = 5.0  # m, of everybody


def view(
    v: float, *agents: Agent, reactive: int = 4, asked: int = 0
) -> tuple[Task, LocalMap, State]:
    """The ego in the middle of three lanes, 300 m along."""
    road = lanes_east(3, 1500.0)
    ego = ego_at(road, "a_1", 300.0, v)
    task = task_of(road, ego)
    scene = scene_of(ego, road, *agents)
    return task, *local_of(task, scene, reactive=reactive, asked=asked)


def drive(
    task: Task, local: LocalMap, state: State, accels: Sequence[float]
) -> tuple[list[State], list[tuple[float, float]], list[float]]:
    """The ego's states, position and speed of agent 0 beside each, and the braking imposed."""
    others, states, rows, imposed = (
        undisturbed(local, 4),
        [state],
        [(float(local.agent[0, 0, S]), float(local.agent[0, 0, V]))],
        [0.0],
    )
    for k, accel in enumerate(accels):
        v = max(0.0, state.v + accel * DT)
        state = state._replace(s=state.s + v * DT, v=v)
        imposed.append(react(local, task.ego, state, others, k + 1, DT))
        _, _, _, _, speed, s, _ = seen(local, others, 0, k + 1)
        states.append(state)
        rows.append((s, speed))
    return states, rows, imposed


def test_who_has_nobody_ahead_does_as_forecast() -> None:
    task, local, state = view(10.0, Agent("beside", "a_0", 280.0, 12.0))
    others = undisturbed(local, 4)
    for k in range(1, 40):
        assert react(local, task.ego, state._replace(s=300.0 + 2.0 * k), others, k, DT) == 0.0
        assert seen(local, others, 0, k) == pytest.approx(
            (*local.agent[k, 0, [X, Y, COS, SIN, V, S]], k)
        )


@settings(deadline=None)
@given(
    st.floats(0.0, 15.0),
    st.floats(3.0, 60.0),
    st.lists(st.floats(-DECEL, 2.6), min_size=30, max_size=30),
)
def test_a_careful_driver_never_touches_an_ego_that_brakes_no_harder(
    v: float, gap: float, accels: list[float]
) -> None:
    follower = min(15.0, safe_speed(gap - STANDSTILL, v, USUAL_S))
    task, local, state = view(v, Agent("behind", "a_1", 300.0 - LENGTH - gap, follower))
    states, rows, _ = drive(task, local, state, accels)
    for k, (ego, (s, speed)) in enumerate(zip(states, rows, strict=True)):
        late = float(local.agent[k, 0, S]) - s
        assert s < ego.s - LENGTH and late >= -1e-9 and speed >= 0.0
        if late > 1e-9 and k > 0 and ego.s - LENGTH - s > 1.5:
            assert rows[k - 1][1] - speed <= DECEL * DT + 1e-9


@given(st.floats(0.0, 15.0), st.floats(0.0, 80.0), st.floats(0.1, 2.0))
def test_the_safe_speed_leaves_room_to_stop(leader_v: float, gap: float, reaction: float) -> None:
    """After its reaction, both braking equally, it stands where the leader does; and the safe gap
    is the other side of the same rule."""
    v = safe_speed(gap, leader_v, reaction)
    assert v * reaction + v * v / (2.0 * DECEL) == pytest.approx(gap + leader_v**2 / (2.0 * DECEL))
    assert safe_speed(-0.01, leader_v, reaction) == 0.0
    if v >= leader_v:
        assert safe_gap(v, leader_v, reaction) == pytest.approx(gap, abs=1e-9)
    assert safe_gap(v, v + 1.0, reaction) == pytest.approx(v * reaction)


def test_who_is_held_up_drives_as_its_slow_twin() -> None:
    """Behind an ego that brakes to a stand, on a straight lane: Krauss' rule by hand."""
    task, local, state = view(12.0, Agent("behind", "a_1", 275.0, 12.0))
    accels = [0.0] * 5 + [-3.0] * 20 + [0.0] * 10
    states, rows, imposed = drive(task, local, state, accels)
    s, v = rows[0]
    for k, ego in enumerate(states[1:], 1):
        careful = safe_speed(ego.s - LENGTH - s - STANDSTILL, ego.v, USUAL_S)
        wanted = max(0.0, min(v + 2.0 * DT, max(careful, v - DECEL * DT)))
        asked = max(0.0, min((v - careful) / DT, DECEL) - IMPOSED) if careful < v else 0.0
        s, v = s + wanted * DT, wanted
        if s >= local.agent[k, 0, S]:
            s, v = local.agent[k, 0, S], local.agent[k, 0, V]
        assert rows[k] == pytest.approx((s, v)) and imposed[k] == pytest.approx(asked), k
    assert (
        rows[-1][1] < 1.5
        and STANDSTILL - 0.5 < states[-1].s - LENGTH - rows[-1][0] < STANDSTILL + 2.5
    )


def test_a_lane_change_close_in_front_imposes_braking_and_one_far_ahead_does_not() -> None:
    for gap, expected in ((4.0, True), (40.0, False)):
        task, local, state = view(8.0, Agent("beside", "a_2", 300.0 - LENGTH - gap, 12.0))
        other = int(np.flatnonzero(task.route.lane == 2)[0])
        _, _, imposed = drive(task, local, state._replace(other=other, progress=0.01), [0.0] * 5)
        assert (sum(imposed) > 0.0) == expected


def test_the_nearest_that_react_on_the_way_are_moved() -> None:
    those = [
        Agent("far", "a_1", 200.0, 9.0),
        Agent("near", "a_1", 280.0, 9.0),
        Agent("ahead", "a_2", 310.0, 9.0),
        Agent("walks", "", x=290.0, y=9.0),
    ]
    _, local, _ = view(10.0, *those, reactive=2)
    names = sorted(agent.id for agent in those)
    assert {
        name: slot
        for name, slot in zip(names, local.trait[:, SLOT].tolist(), strict=True)
        if slot >= 0
    } == {"ahead": 0.0, "near": 1.0}
    assert undisturbed(local, 2)[:, [CLOCK, SPEED]].tolist() == [[0.0, 9.0], [0.0, 9.0]]
    _, local, _ = view(10.0, *those, reactive=0)
    assert np.all(local.trait[:, SLOT] == -1) and undisturbed(local, 0).shape == (0, 2)


def test_who_stands_where_its_forecast_stands_is_found_again() -> None:
    """Where a forecast stands still its clock has no one answer; the position does."""
    task, local, state = view(0.0, Agent("behind", "a_1", 300.0 - LENGTH - STANDSTILL - 1.0, 0.0))
    _, rows, _ = drive(task, local, state, [0.0] * 20)
    assert all(math.isfinite(s) and s <= 300.0 - LENGTH for s, _ in rows)


# --- those that are asked for room ---


def asking(v: float, *agents: Agent, asked: int = 1) -> tuple[Task, LocalMap, State]:
    """The ego asks on its left, from the middle of three lanes."""
    return view(v, *agents, reactive=0, asked=asked)


def speeds_after(
    v: float, *agents: Agent, asked: int = 1, seconds: float = 3.0
) -> tuple[dict[str, float], float]:
    """The speed of each agent beside an ego that keeps its speed, and all imposed braking."""
    task, local, state = asking(v, *agents, asked=asked)
    others, imposed, steps = undisturbed(local), 0.0, round(seconds / DT)
    for k in range(1, steps + 1):
        imposed += react(local, task.ego, state._replace(s=300.0 + v * DT * k), others, k, DT)
    return {
        name: seen(local, others, i, steps)[4]
        for i, name in enumerate(sorted(agent.id for agent in agents))
    }, imposed


def test_the_nearest_behind_in_the_lane_asked_makes_room() -> None:
    column = [Agent("near", "a_2", 290.0, 12.0), Agent("next", "a_2", 265.0, 12.0)]
    asked, imposed = speeds_after(10.0, *column)
    assert asked["near"] < 10.5
    assert imposed == 0.0  # it was asked before, whatever the ego does now
    quiet, nothing = speeds_after(10.0, *column, asked=0)
    assert quiet["near"] > 11.5
    assert nothing == 0.0


def test_room_is_made_in_comfort() -> None:
    task, local, state = asking(10.0, Agent("near", "a_2", 290.0, 12.0))
    others, v = undisturbed(local), 12.0
    for k in range(1, 20):
        react(local, task.ego, state._replace(s=300.0 + 2.0 * k), others, k, DT)
        now = seen(local, others, 0, k)[4]
        assert v - now <= HELPS * DT + 1e-9
        v = now


def test_room_is_made_as_fast_as_comfort_allows() -> None:
    """7 m are too few for 12 m/s behind 10 m/s: 0.6 m/s less after 0.2 s; 40 m are enough."""
    for s, v in ((290.0, 12.0 - 3.0 * DT), (255.0, 12.0)):
        task, local, state = asking(10.0, Agent("near", "a_2", s, 12.0))
        others = undisturbed(local)
        assert react(local, task.ego, state._replace(s=302.0), others, 1, DT) == 0.0
        assert others[0, SPEED] == pytest.approx(v)


@pytest.mark.parametrize(
    ("v", "agent"),
    [
        (0.0, Agent("near", "a_2", 285.0, 14.0)),  # it could not brake for one that stands
        (10.0, Agent("near", "a_0", 285.0, 12.0)),  # on the other side
        (10.0, Agent("near", "a_2", 302.0, 12.0)),  # beside the ego already
    ],
)
def test_no_other_makes_room(v: float, agent: Agent) -> None:
    speeds, imposed = speeds_after(v, agent, seconds=1.0)
    assert speeds["near"] >= agent.v - 0.5
    assert imposed == 0.0


def test_a_place_is_free_where_room_was_made() -> None:
    """A follower that is too near falls back while the ego asks."""
    pair = [Agent("ahead", "a_2", 320.0, 10.0), Agent("near", "a_2", 291.0, 10.0)]
    task, local, state = asking(10.0, *pair)
    place, others, nobody = compiled(place_is_free), undisturbed(local), np.zeros((0, 2))
    found = []
    for k in range(1, 40):
        there = state._replace(s=300.0 + 2.0 * k)
        react(local, task.ego, there, others, k, DT)
        changed = begin_change(local, task.ego, there, 1)
        found.append(
            [
                place(local, task.ego, task.cost, changed, moved, k, 25.0)
                for moved in (others, nobody)
            ]
        )
    assert [any(column) for column in zip(*found, strict=True)] == [True, False]


# --- who starts after it has stood ---


def starting(s: float, ego_s: float) -> tuple[Task, LocalMap, State]:
    """A car that has stood `s` m along the main road from the west, and starts; the ego stands on
    its way to the north, `ego_s` m along the lane that crosses the main road."""
    road = crossing(bridge=False)
    ego = ego_at(road, ":sn_0", ego_s, 0.0, route=edges(road, "si", "no"))
    task = task_of(road, ego)
    scene = scene_of(ego, road, Agent("starts", "wi_0", s, 0.0))
    scene = scene._replace(agents=scene.agents._replace(standing_s=np.full(1, 10.0)))
    situation = situation_of(task, scene)
    question = Question(
        scene, np.array(ego_lanes(task.route, situation.state), np.int32), np.zeros(0),
        traffic_params(), 10.0,
    )  # fmt: skip
    forecast = predict(road, question, intent=Intent(0, STARTS))
    return task, base.local_of(task, situation._replace(forecast=forecast)), situation.state


def eastmost(task: Task, local: LocalMap, state: State, accel: float, steps: int) -> list[float]:
    """Where the front of the car that starts is, m east, step by step, beside an ego that stands
    until step 25 and then accelerates."""
    others, fronts = undisturbed(local), []
    for k in range(steps):
        v = state.v + (accel * DT if k > 25 else 0.0)
        state = state._replace(s=state.s + v * DT, v=v)
        react(local, task.ego, state, others, k + 1, DT)
        fronts.append(seen(local, others, 0, k + 1)[0] + LENGTH / 2)
    return fronts


@pytest.mark.parametrize("s", [70.0, 80.0, 88.0])
def test_who_starts_waits_for_an_ego_that_is_in_its_way(s: float) -> None:
    """The ego's right side is at x = 0.7; the car's front comes near to it, not there."""
    task, local, state = starting(s, 10.0)
    assert local.starts == 0 and len(local.obligation) == 0
    fronts = eastmost(task, local, state, 0.0, 48)
    assert -4.0 < fronts[-1] < -0.5 and max(fronts) == fronts[-1]
    assert eastmost(task, local._replace(starts=-1), state, 0.0, 48)[-1] > 5.0


def test_who_waited_goes_on_when_the_ego_has_gone() -> None:
    task, local, state = starting(88.0, 10.0)
    assert eastmost(task, local, state, 3.0, 48)[-1] > 5.0


def test_who_starts_does_as_forecast_where_no_ego_is_in_its_way() -> None:
    task, local, state = starting(88.0, 1.0)
    assert eastmost(task, local, state, 0.0, 48) == pytest.approx(
        [float(x) + LENGTH / 2 for x in local.agent[1:49, 0, X]]
    )


def test_who_starts_looks_twice_as_far_as_it_needs_to_stop() -> None:
    """Standing 5 m, at 3 m/s 2 (2.5 + 3 + 9 / 9) = 13 m; and no further than its forecast goes."""
    across = plain(_gap_across)
    task, local, state = starting(97.0, 10.0)
    others = undisturbed(local)
    gap = across(local, task.ego, state, others, 0)
    assert 3.0 < gap < 5.0
    k = int(np.argmax(local.agent[:, 0, DRIVEN] >= gap))  # the first time at which they meet
    assert local.agent[k, 0, DRIVEN] == gap
    for gone, found in ((k, math.inf), (k + 1, gap)):
        agent = local.agent.copy()
        agent[gone:, 0, NODE] = GONE
        assert across(local._replace(agent=agent), task.ego, state, others, 0) == found
    task, local, state = starting(97.0 - (13.0 - gap), 10.0)  # it drives by 0.02 k^2 m
    for v, near in ((0.0, False), (2.8, False), (3.3, True), (9.0, True)):
        others[0, SPEED] = v
        found = across(local, task.ego, state, others, 0)
        assert math.isfinite(found) == near and (not near or abs(found - 13.0) < 0.6)


@pytest.mark.parametrize(
    ("kerb", "clock", "v"), [(9.0, 1.5, 3.0), (4.0, 1.5, 3.0), (2.5, 1.0, 0.0)]
)
def test_who_may_wait_at_a_kerb_walks_up_to_it(kerb: float, clock: float, v: float) -> None:
    """Its forecast has it 2 m further at each time, 0.2 s apart, and 3 m/s fast; half of that is
    driven in 0.1 s. The ego, 10 m/s fast, is about to pass."""
    task, local, state = view(10.0, Agent("walks", "a_0", 280.0, 3.0))
    agent, trait = local.agent.copy(), local.trait.copy()
    agent[:, 0, DRIVEN], agent[:, 0, V] = 2.0 * np.arange(len(agent)), 3.0
    trait[0, [SLOT, OWED]] = 0.0
    row = np.array([[state.node, 280.0, 305.0, 0, 20.0, 0.0, 0.0, 0.0]])
    row[0, [KERB, PAST]] = kerb, 1.0
    others = np.array([[0.0, 3.0]])
    others[0, CLOCK] = 1.0
    local = local._replace(agent=agent, trait=trait, obligation=row)
    assert react(local, task.ego, state, others, 9, 0.5 * DT) == 0.0
    assert (others[0, CLOCK], others[0, SPEED]) == (pytest.approx(clock), v)
