"""The drivers to compare with: what idm takes for its leader, whom it lets pass and where it
changes lanes; that random is random, but possible."""

from collections import Counter
from itertools import pairwise

import naive
import numpy as np
import pytest
from helpers import Agent, crossing, edges, ego_at, lane, lights, straight_road
from helpers_model import (
    PHYSICS,
    lanes_east,
    local_of,
    road_with_light,
    scenario,
    scene_of,
    situation_of,
    task_of,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from naive import Box

from sumo_mcts import config
from sumo_mcts.config import builtin
from sumo_mcts.driver.factories import make_planner
from sumo_mcts.episode.run import default_variant, run_episode
from sumo_mcts.model.motion import begin_change
from sumo_mcts.planners.actions import ACCEL, FOLLOW, SIDE
from sumo_mcts.planners.base import Planner, Task
from sumo_mcts.planners.baselines import accel_behind, leader_on_path, with_yield_lines
from sumo_mcts.planners.mcts import actions_of, mcts_params
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import RED, Decision, EgoState, Follow, Signals

CRITICAL_GAP = 5.0


def planner_of(name: str, task: Task, seed: int = 1) -> Planner:
    planner = make_planner(scenario(f"planner.name={name}"))
    planner.start(task, seed)
    return planner


def command(decision: Decision) -> Follow:
    assert isinstance(decision.command, Follow)
    return decision.command


def drive(
    road: RoadMap, ego: EgoState, seconds: float, *others: Agent, signals: Signals | None = None
) -> list[EgoState]:
    """The ego as planner idm drives it, period by period; the others keep their speeds and lanes."""
    task = task_of(road, ego)
    planner, states = planner_of("idm", task), [ego]
    for k in range(round(seconds / 0.5)):
        moved = [other._replace(s=other.s + 0.5 * k * other.v) for other in others]
        plan = planner.plan(
            situation_of(task, scene_of(states[-1], road, *moved, signals=signals))
        ).plan
        assert plan is not None
        v, a = float(plan.v[4]), float(plan.v[4] - plan.v[3]) / PHYSICS.step
        name = road.lane_ids[int(plan.lane[4])]
        route, here = states[-1].route, int(road.edge[lane(road, name)])
        states.append(
            ego_at(
                road,
                name,
                float(plan.s[4]),
                v,
                route=route[route.index(here) :] if here in route else route,
            )._replace(a=a)
        )
    return states


# --- idm: the leader ---


@pytest.mark.slow
@settings(max_examples=30)
@given(st.floats(5.0, 60.0), st.floats(-2.5, 2.5), st.floats(-0.6, 0.6), st.floats(2.0, 14.0))
def test_the_leader_is_whom_the_ego_would_touch_first(
    ahead: float, aside: float, turned: float, v: float
) -> None:
    road = lanes_east(1)
    ego = ego_at(road, "a_0", 100.0)
    other = Agent("other", "", x=100.0 + ahead, y=aside, heading=turned, v=v)
    local, state = local_of(task_of(road, ego), scene_of(ego, road, other))
    gap, speed = leader_on_path(local, task_of(road, ego).ego, state, 80.0)
    box = Box(other.x, other.y, turned, other.length / 2, other.width / 2).polygon()
    touching = [
        k * 0.05
        for k in range(1600)
        if Box(ego.x + k * 0.05, ego.y, 0.0, 2.5, 0.9).polygon().intersects(box)
    ]
    beside = (
        not touching or touching[0] + 1.0 > other.x - ego.x
    )  # it would first be touched when its middle is about to be passed: no leader
    if touching and touching[-1] - touching[0] > 1.0 and not beside:
        assert touching[0] - 0.06 <= gap <= touching[0] + 1.06
        assert speed == pytest.approx(v * np.cos(turned))
    elif not touching:
        assert gap == np.inf


def test_the_tail_of_whoever_turns_off_is_in_the_way() -> None:
    """It counts to the lane into the side road already, which the ego does not take."""
    road = straight_road()
    ego = ego_at(road, "a_0", 150.0, route=edges(road, "a", "b"))
    task = task_of(road, ego)
    local, state = local_of(
        task, scene_of(ego, road, Agent("turning", ":mr_0", 3.0, v=2.0, length=8.0))
    )
    gap, _ = leader_on_path(local, task.ego, state, 100.0)
    assert 40.0 < gap < 50.0


def test_neighbours_and_followers_lead_nobody() -> None:
    road = lanes_east(3)
    ego = ego_at(road, "a_1", 100.0)
    task = task_of(road, ego)
    local, state = local_of(
        task,
        scene_of(
            ego,
            road,
            Agent("left", "a_2", 110.0),
            Agent("right", "a_0", 103.0),
            Agent("behind", "a_1", 94.0),
        ),
    )
    assert leader_on_path(local, task.ego, state, 100.0)[0] == np.inf


@pytest.mark.parametrize("v", [0.0, 3.0, 8.0])
def test_it_closes_up_to_its_leader_and_no_further(v: float) -> None:
    road = lanes_east(1, 2000.0)
    leader = Agent("leader", "a_0", 150.0, v)
    states = drive(road, ego_at(road, "a_0", 60.0, 12.0), 40.0, leader)
    gaps = [150.0 + 0.5 * k * v - leader.length - state.s for k, state in enumerate(states)]
    keys = scenario().idm
    assert min(gaps) > 0.5 * keys.min_gap_m
    assert states[-1].v == pytest.approx(v, abs=0.1)
    assert gaps[-1] == pytest.approx(
        keys.min_gap_m + v * keys.headway_s, abs=1.5 + 0.15 * v
    )  # the place of the leader is looked for in steps of 1 m
    assert max(abs(b.v - a.v) for a, b in pairwise(states)) <= 0.5 * 5.0


def test_it_stops_for_red() -> None:
    road = road_with_light()
    states = drive(
        road,
        ego_at(road, "a_0", 60.0, 12.0, route=edges(road, "a", "b")),
        30.0,
        signals=lights(RED),
    )
    assert states[-1].v < 0.1
    assert 197.0 < states[-1].s < 200.0


# --- idm: right of way ---


def closed_before(on: str, s: float, v: float, *others: Agent) -> list[str]:
    """The lanes whose ends planner idm takes for closed stop lines."""
    road = crossing(bridge=False)
    ego = ego_at(
        road, on, s, v, route=edges(road, "si", "no") if on == "si_0" else edges(road, "wi", "eo")
    )
    task = task_of(road, ego)
    local, state = local_of(task, scene_of(ego, road, *others))
    open_again = with_yield_lines(local, state, CRITICAL_GAP)
    assert not local.closed.any()
    return [
        road.lane_ids[task.route.lane[local.first + k]]
        for k in np.flatnonzero(open_again.closed.all(axis=1))
    ]


@pytest.mark.parametrize(
    ("away", "closed"), [(20.0, ["si_0"]), (45.0, ["si_0"]), (70.0, []), (85.0, [])]
)
def test_it_waits_for_who_comes_within_the_critical_gap(away: float, closed: list[str]) -> None:
    """At the line, at 10 m/s: 5.3 s until it could go, so whoever enters the shared stretch sooner
    is waited for."""
    assert (
        closed_before("si_0", 89.0, 0.0, Agent("other", "wi_0", 90.0 + 9.4 - away, 10.0)) == closed
    )


def test_it_does_not_wait_where_it_has_the_right_of_way() -> None:
    assert closed_before("wi_0", 80.0, 10.0, Agent("other", "si_0", 60.0, 10.0)) == []


def test_it_goes_on_where_it_is_too_late_to_stop() -> None:
    other = Agent("other", "wi_0", 70.0, 10.0)
    assert closed_before("si_0", 60.0, 10.0, other) == ["si_0"]  # needs 17 m
    assert closed_before("si_0", 80.0, 10.0, other) == []


def test_it_lets_them_pass_and_then_goes() -> None:
    road = crossing(bridge=False)
    states = drive(
        road,
        ego_at(road, "si_0", 50.0, 8.0, route=edges(road, "si", "no")),
        20.0,
        *(Agent(f"{k}", "wi_0", 80.0 - 30.0 * k, 10.0) for k in range(3)),
    )
    waiting = [state for state in states if state.v < 0.5]
    assert waiting
    assert all(road.lane_ids[state.lane] == "si_0" for state in waiting)
    assert road.lane_ids[states[-1].lane] == "no_0"


# --- idm: lane changes ---


def side_taken(*others: Agent, route: tuple[str, ...] = ("a", "d")) -> int:
    road = straight_road()
    ego = ego_at(road, "a_1", 80.0, 10.0, route=edges(road, *route))
    task = task_of(road, ego)
    return command(
        planner_of("idm", task).plan(situation_of(task, scene_of(ego, road, *others)))
    ).lane_change


def test_it_changes_to_the_lane_of_its_route_where_the_gap_allows() -> None:
    assert side_taken() == -1
    assert side_taken(Agent("beside", "a_0", 81.0)) == 0
    assert side_taken(Agent("fast behind", "a_0", 70.0, 15.0)) == 0
    assert side_taken(Agent("far behind", "a_0", 30.0)) == -1
    assert side_taken(route=("a", "b", "c")) == 0


@pytest.mark.parametrize(
    ("away", "v", "ego_v"), [(12.0, 10.0, 5.0), (30.0, 14.0, 10.0), (60.0, 3.0, 8.0)]
)
def test_the_next_behind_is_asked_how_it_would_brake(away: float, v: float, ego_v: float) -> None:
    road = lanes_east(2)
    ego = ego_at(road, "a_0", 200.0, ego_v)
    task = task_of(road, ego)
    others = [
        Agent("next", "a_1", 200.0 - away, v),
        Agent("after it", "a_1", 100.0, 30.0),
        Agent("ahead", "a_1", 230.0),
        Agent("own lane", "a_0", 195.0, 14.0),
    ]
    local, state = local_of(task, scene_of(ego, road, *others))
    changed = begin_change(local, task.ego, state, 1)
    assert accel_behind(local, task.ego, changed) == pytest.approx(
        naive.follow(task.ego, v, 15.0, away - 5.0, ego_v)
    )
    local, state = local_of(task, scene_of(ego, road, *others[2:]))
    assert accel_behind(local, task.ego, changed) == np.inf


# --- random ---


@pytest.mark.slow
def test_each_action_that_is_possible_is_as_likely() -> None:
    road = lanes_east(2)
    ego = ego_at(road, "a_0", 100.0, 5.0)
    task = task_of(road, ego)
    planner, situation = planner_of("random", task), situation_of(task, scene_of(ego, road))
    actions = actions_of(mcts_params(scenario()))
    possible = actions[actions[:, SIDE] >= 0.0]  # nothing lies to the right
    count = 1500
    drawn = [command(planner.plan(situation)) for _ in range(count)]
    sides = Counter(one.lane_change for one in drawn)
    assert set(sides) == {0, 1}
    assert sides[1] / count == pytest.approx((possible[:, SIDE] > 0.0).mean(), abs=0.04)
    ends = Counter(round(float(one.speeds[4]), 6) for one in drawn if one.lane_change == 0)
    kept = (possible[:, SIDE] == 0.0).sum()
    assert len(ends) <= kept
    assert min(ends.values()) > 0.6 * count / len(possible)
    assert FOLLOW in possible[:, ACCEL]


def test_random_is_seeded() -> None:
    road = lanes_east(2)
    ego = ego_at(road, "a_0", 100.0, 5.0)
    task = task_of(road, ego)
    situation = situation_of(task, scene_of(ego, road))

    def some(seed: int) -> list[list[float]]:
        planner = planner_of("random", task, seed)
        return [command(planner.plan(situation)).speeds.tolist() for _ in range(10)]

    assert some(3) == some(3)
    assert some(3) != some(4)


def test_random_changes_lanes_only_where_the_place_is_free() -> None:
    road = lanes_east(2)
    ego = ego_at(road, "a_0", 100.0, 5.0)
    task = task_of(road, ego)
    planner, situation = (
        planner_of("random", task),
        situation_of(task, scene_of(ego, road, Agent("beside", "a_1", 101.0, 5.0))),
    )
    assert {command(planner.plan(situation)).lane_change for _ in range(100)} == {0}


# --- episodes ---


@pytest.mark.slow
@pytest.mark.parametrize("name", ["unprotected-left-turn", "highway-exit", "straight-line"])
def test_idm_drives_the_reactive_scenes(name: str) -> None:
    first, again = (
        run_episode(config.load(builtin.scenario_path(name), ("planner.name=idm",)), 1).rows[0]
        for _ in range(2)
    )
    assert first["outcome"] == "arrived", first
    assert (first["red_lights_run"], first["speeding_share"]) == (0, 0.0)
    assert (first["prediction"], first["variant"], first["iterations_per_decision"]) == (
        "idm",
        "idm-idm",
        None,
    )
    assert first["trace_digest"] == again["trace_digest"]


def test_random_is_judged_like_everybody() -> None:
    one, same, other = (
        run_episode(
            config.load(builtin.scenario_path("straight-line"), ("planner.name=random",)), seed
        ).rows[0]
        for seed in (2, 2, 3)
    )
    assert one["outcome"] in {"arrived", "collision", "timeout"}
    assert one["trace_digest"] == same["trace_digest"] != other["trace_digest"]


def test_variants_name_what_planners_use() -> None:
    names = [
        default_variant(scenario(f"planner.name={name}"))
        for name in ("mcts", "idm", "random", "sumo", "constant")
    ]
    assert names == ["mcts-idm-1000", "idm-idm", "random-idm", "sumo", "constant"]
