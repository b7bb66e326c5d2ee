"""The terms of J in planner `mcts`, each written down once more from the table in docs/planner.md,
and numbers worked out by hand.

Steps of 0.1 s, a limit of 15 m/s, a comfortable deceleration of 3 m/s2, and the usual weights:
progress 1, jerk 0.005, acceleration 0.02, braking 0.5, route 2, blocking 0.3, astride 4, contact 60
and 1 for each m/s, tail 8 s.
"""

import math

import numpy as np
import pytest
from helpers import Agent, ego_at, lights
from helpers_model import lanes_east, local_of, plain, road_with_light, scenario, scene_of, task_of

from sumo_mcts.driver.params import cost_params
from sumo_mcts.model import cost
from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.model.local_map import (
    DENSITY,
    ELSEWHERE,
    NODE,
    ONCOMING,
    STREAM,
    LocalMap,
    State,
    V,
)
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.model.route import HOME, REACH, STATION
from sumo_mcts.scene import GREEN, RED

C = cost_params(scenario())
comfort, passability = plain(cost.step_comfort), plain(cost.step_passability)
terminal, behind = plain(cost.terminal), plain(cost.behind)
contact = plain(cost.contact_cost)


def after_contact(c: CostParams, state: State, time: float, local: LocalMap) -> float:
    return float(plain(cost.after_contact)(local, c, state, time, 8.0))


def view(*agents: Agent, v: float = 10.0, lanes: int = 1) -> tuple[EgoParams, LocalMap, State]:
    """The ego on lane 0, its front at 100 m; the limit is 15 m/s."""
    road = lanes_east(lanes, 900.0)
    ego = ego_at(road, "a_0", 100.0, v)
    task = task_of(road, ego)
    return task.ego, *local_of(task, scene_of(ego, road, *agents))


def without(*names: str, c: CostParams = C, **more: float) -> CostParams:
    return c._replace(**dict.fromkeys(names, 0.0), **more)


# --- C_c ---


def naive_comfort(c: CostParams, before: float, after: float) -> float:
    """k j^2 up to 10 m/s3, w a^2, w (deceleration beyond the comfortable one)^2, for 0.1 s."""
    jerk = min(abs(after - before) / 0.1, 10.0)
    return 0.1 * (
        c.jerk * jerk**2 + c.acceleration * after**2 + c.braking * max(-after - 3.0, 0.0) ** 2
    )


@pytest.mark.parametrize(
    ("before", "after", "rate"),
    [
        (0.0, 0.0, 0.0),
        (1.0, 1.0, 0.02),
        (-2.0, -2.0, 0.08),  # 0.02 * 2^2
        (0.0, 0.5, 0.13),  # j = 5: 0.005 * 25 = 0.125; 0.02 * 0.25
        (0.5, 0.0, 0.125),
        (0.0, 2.0, 0.58),  # j = 20 counts as 10: 0.5; 0.02 * 4
        (-5.0, -5.0, 2.5),  # 0.02 * 25 = 0.5; 2 m/s2 beyond: 0.5 * 4 = 2
        (-3.0, -3.0, 0.18),
        (5.0, 5.0, 0.5),  # accelerating is no braking
    ],
)
def test_comfort(before: float, after: float, rate: float) -> None:
    p, _, state = view()
    found = comfort(p, C, state._replace(a=before), state._replace(a=after))
    assert found == pytest.approx(0.1 * rate) == naive_comfort(C, before, after)


def test_comfort_of_drawn_steps_and_each_weight_alone() -> None:
    p, _, state = view()
    rng, names = np.random.default_rng(1), ("jerk", "acceleration", "braking")
    for before, after in rng.uniform(-8.0, 3.0, (60, 2)):
        states = state._replace(a=before), state._replace(a=after)
        usual = comfort(p, C, *states)
        assert usual == pytest.approx(naive_comfort(C, before, after))
        alone = [comfort(p, without(*(n for n in names if n != name)), *states) for name in names]
        assert sum(alone) == pytest.approx(usual)
        for name, part in zip(names, alone, strict=True):
            twice = C._replace(**{name: 2.0 * getattr(C, name)})
            assert comfort(p, twice, *states) == pytest.approx(usual + part)
            assert comfort(p, without(name), *states) == pytest.approx(usual - part)


# --- C_p ---


@pytest.mark.parametrize(
    ("v", "rate"), [(0.0, 1.0), (3.0, 0.8), (7.5, 0.5), (15.0, 0.0), (20.0, 0.0)]
)
def test_progress_is_the_share_of_the_limit_that_is_not_driven(v: float, rate: float) -> None:
    p, local, state = view()
    assert passability(local, p, C, state._replace(v=v)) == pytest.approx(0.1 * rate)
    assert passability(local, p, without(progress=3.0), state._replace(v=v)) == pytest.approx(
        0.3 * rate
    )


@pytest.mark.parametrize("urgency", [1.5, -1.5, 0.0, 3.0])
def test_a_lane_that_the_route_leaves_costs_by_its_urgency(urgency: float) -> None:
    p, local, state = view(v=15.0)
    urgent = local._replace(urgency=np.full_like(local.urgency, urgency))
    assert passability(urgent, p, C, state) == pytest.approx(0.1 * 2.0 * abs(urgency))
    assert passability(urgent, p, without("route"), state) == 0.0


@pytest.mark.parametrize(
    ("stream", "density", "share"),
    [
        (25.0, 0.02, 0.28347),  # 1 - exp(-0.02 * 10^2 / (2 * 3))
        (20.0, 0.02, 0.07996),  # 5 m/s slower
        (25.0, 0.04, 0.48658),
        (15.0, 0.02, 0.0),
        (5.0, 0.02, 0.0),  # the ego is the faster one
    ],
)
def test_the_slower_than_the_next_lane_the_dearer(
    stream: float, density: float, share: float
) -> None:
    """The ego drives 15 m/s, so progress costs nothing."""
    p, local, state = view(v=15.0)
    to_leave = local.to_leave.copy()
    to_leave[:, STREAM], to_leave[:, DENSITY] = stream, density
    local = local._replace(to_leave=to_leave)
    assert passability(local, p, C, state) == 0.0  # in a lane that is none to leave
    local = local._replace(urgency=np.full_like(local.urgency, 1.0))
    for weight in (0.0, 1.0, 2.0):
        found = passability(local, p, C._replace(mismatch=weight), state)
        assert found == pytest.approx(0.2 * (1.0 + weight * share), rel=1e-4)


@pytest.mark.parametrize(("v", "blocks"), [(0.0, True), (0.9, True), (1.1, False)])
def test_standing_in_a_junction_blocks_others(v: float, blocks: bool) -> None:
    road = road_with_light()
    ego = ego_at(road, "a_0", 150.0, 0.0, route=(0, 2))
    task = task_of(road, ego)
    local, state = local_of(task, scene_of(ego, road, signals=lights(GREEN)))
    for node, inside in ((0, False), (1, True), (2, False)):
        costs = [
            passability(local, task.ego, c, state._replace(node=node, s=5.0, v=v))
            for c in (C, without("blocking"))
        ]
        assert costs[0] - costs[1] == pytest.approx(0.03 if blocks and inside else 0.0)


# --- the loss of a contact ---


@pytest.mark.parametrize(
    ("time", "v", "loss"),
    [(0.0, 0.0, 60.0), (8.0, 0.0, 30.0), (16.0, 0.0, 30.0), (4.0, 0.0, 45.0), (0.0, 7.0, 67.0), (8.0, 7.0, 37.0)],
)  # fmt: skip
def test_contact_costs_less_the_later_and_more_the_faster(
    time: float, v: float, loss: float
) -> None:
    _, _, state = view()
    assert contact(C, state._replace(v=v), time, 8.0) == pytest.approx(loss)
    twice = C._replace(speed_at_contact=2.0)
    assert contact(twice, state._replace(v=v), time, 8.0) == pytest.approx(loss + v)


@pytest.mark.parametrize("moment", [0.0, 3.0, 8.0, 9.0])
def test_after_a_contact_the_ego_stands_there(moment: float) -> None:
    """A second for each one that is left of 8, then 15^2 / (2 * 2.6 * 15) s to reach the limit and
    8 s behind what it touches; its speed at the contact is worth nothing."""
    _, local, state = view()
    expected = max(8.0 - moment, 0.0) + 2.8846 + 8.0
    for v in (0.0, 12.0):
        assert after_contact(C, state._replace(v=v), moment, local) == pytest.approx(
            expected, abs=1e-4
        )
    assert after_contact(C._replace(after_contact=0.5), state, moment, local) == pytest.approx(
        0.5 * expected, abs=1e-4
    )
    assert after_contact(without("after_contact"), state, moment, local) == 0.0


@pytest.mark.parametrize("s", [100.0, 150.0, 190.0])
def test_no_contact_is_cheaper_than_to_wait_in_its_place(s: float) -> None:
    """Before a light that stays red: standing until the horizon costs at most as much."""
    road = road_with_light()
    ego = ego_at(road, "a_0", s, 0.0, route=(0, 2))
    task = task_of(road, ego)
    local, state = local_of(task, scene_of(ego, road, signals=lights(RED)))
    waits = 8.0 + terminal(local, C, state, math.inf, 0.0, 8.0)
    for moment in (0.0, 4.0, 7.9):
        touches = moment + contact(C, state, moment, 8.0)
        assert touches + after_contact(C, state, moment, local) >= waits + 30.0 - 1e-9


# --- the horizon ---


@pytest.mark.parametrize(
    ("gap", "leader", "share"),
    [(0.0, 0.0, 1.0), (0.0, 7.5, 0.5), (0.0, 15.0, 0.0), (0.0, 30.0, 0.0), (60.0, 0.0, 0.8), (60.0, 7.5, 0.4), (300.0, 0.0, 0.0), (math.inf, 0.0, 0.0)],
)  # fmt: skip
def test_behind_a_slow_leader_time_is_lost(gap: float, leader: float, share: float) -> None:
    """1 - v/15 of 8 s, less by 0.4 of a second for each second of gap: 0.4 * 60 / (8 * 15)."""
    _, local, _ = view()
    assert behind(local, C, gap, leader) == pytest.approx(share, abs=1e-6)


@pytest.mark.parametrize(
    ("v", "gap", "leader", "seconds"),
    [
        (15.0, math.inf, 0.0, 0.0),
        (0.0, math.inf, 0.0, 2.8846),  # 15^2 / (2 * 2.6 * 15)
        (9.0, math.inf, 0.0, 0.46154),  # 6^2 / 78
        (20.0, math.inf, 0.0, 0.0),
        (15.0, 0.0, 0.0, 2.8846 + 8.0),  # behind one that stands speed is worth nothing
        (15.0, 60.0, 0.0, 121.0 / 78.0 + 6.4),  # 60 / 15 = 4 m/s of it are
        (5.0, 60.0, 7.5, 100.0 / 78.0 + 3.2),
    ],
)
def test_at_the_horizon_the_time_counts_that_is_lost_by_then(
    v: float, gap: float, leader: float, seconds: float
) -> None:
    _, local, state = view()
    found = terminal(local, C, state._replace(v=v), gap, leader, 8.0)
    assert found == pytest.approx(seconds, abs=1e-3)
    twice = terminal(local, C._replace(progress=2.0), state._replace(v=v), gap, leader, 8.0)
    assert twice == pytest.approx(2.0 * found)
    shut = local._replace(open_ahead=False)
    lost = terminal(shut, C, state._replace(v=v), gap, leader, 8.0)
    assert lost == pytest.approx(8.0 * behind(local, C, gap, leader))


def test_in_a_lane_that_the_route_leaves_its_rate_goes_on() -> None:
    _, local, state = view(v=15.0)
    for urgency in (1.0, -2.0):
        urgent = local._replace(urgency=np.full_like(local.urgency, urgency))
        found = terminal(urgent, C, state, math.inf, 0.0, 8.0)
        assert found == pytest.approx(2.0 * abs(urgency) * 8.0)
        assert terminal(urgent, without("route"), state, math.inf, 0.0, 8.0) == 0.0


@pytest.mark.parametrize(
    ("v", "turn", "reach", "astride"),
    [
        (0.9, 0.21, math.inf, True),
        (0.9, -0.21, math.inf, True),
        (1.1, 0.21, math.inf, False),
        (0.9, 0.19, math.inf, False),
        (0.9, 0.21, 200.0, False),  # the lane leads nowhere: it may have to stand there
    ],
)
def test_standing_across_two_lanes(v: float, turn: float, reach: float, astride: bool) -> None:
    p, local, state = view()
    node = local.node.copy()
    node[:, REACH] = reach
    turned = state._replace(v=v, turn=turn)
    costs = [passability(local._replace(node=node), p, c, turned) for c in (C, without("astride"))]
    assert costs[0] - costs[1] == pytest.approx(0.4 if astride else 0.0)


@pytest.mark.parametrize(
    ("stop", "v", "share"),
    [(108.0, 0.0, 1.0), (105.0, 0.0, 0.6), (104.0, 0.0, 0.4), (102.0, 0.0, 0.0), (90.0, 0.0, 0.0), (102.0, 0.15, 0.5), (104.0, 0.15, 0.5), (102.0, 3.0, 1.0)],
)  # fmt: skip
def test_before_a_stop_all_time_is_lost(stop: float, v: float, share: float) -> None:
    """It stands 2 m before the line; the last 5 m before that place count less and less, and
    speeds below 0.3 m/s. The ego is at 100 m."""
    p, local, state = view(v=v)
    held = local._replace(stop_at=stop, stands_before=2.0, near_stop=5.0)
    rates = [passability(each, p, C, state) for each in (held, local)]
    assert rates[0] - rates[1] == pytest.approx(0.1 * share)


@pytest.mark.parametrize(("stop", "seconds"), [(122.0, 5.0), (102.0, 0.0), (99.0, 0.0), (132.0, 7.5), (500.0, 7.5)])  # fmt: skip
def test_at_the_horizon_the_way_to_a_stop_counts(stop: float, seconds: float) -> None:
    """At 4 m/s, for 30 m at most; the lane of the ego begins 40 m down the route."""
    _, local, state = view(v=15.0)
    node = local.node.copy()
    node[:, STATION] += 40.0
    held = local._replace(stop_at=stop + 40.0, stands_before=2.0, near_stop=5.0, node=node)
    assert terminal(held, C, state, math.inf, 0.0, 8.0) == pytest.approx(seconds)


@pytest.mark.parametrize(
    ("room", "v", "speed", "slow"),
    [(0.0, 0.0, 10.0, 1.0), (20.0, 0.0, 20.396, 0.5), (20.0, 5.0, 20.0, 0.4323), (20.0, 15.0, 10.0, 0.0), (3.0, 0.0, 0.0, 0.0)],
)  # fmt: skip
def test_too_slow_for_those_in_the_next_lane(
    room: float, v: float, speed: float, slow: float
) -> None:
    """With 2.6 m/s2 up to the end of the lane: sqrt(v^2 + 5.2 room) of the others' speed (at least
    1 m/s). A tenth of that is added to what the lane costs for 8 s more."""
    _, local, state = view(v=15.0)
    node = local.node.copy()
    node[:, REACH] = 100.0 + room
    local = local._replace(
        node=node, target_lane_speed=speed, urgency=np.full_like(local.urgency, 1.5),
        to_leave=np.array([[0.0, 0.0, 100.0 + room, 0.0]]),
    )  # fmt: skip
    state = state._replace(v=v)
    assert plain(cost._too_slow)(local, state) == pytest.approx(slow, abs=1e-3)
    found = terminal(local, without("progress"), state, math.inf, 0.0, 8.0)
    assert found == pytest.approx(2.0 * 1.5 * 8.0 * (1.0 + 0.1 * slow), rel=1e-4)
    node[:, REACH] = math.inf
    endless = local._replace(to_leave=np.array([[0.0, 0.0, math.inf, 0.0]]))
    assert plain(cost._too_slow)(endless, state) == 0.0


def test_past_the_end_of_its_lane_an_ego_is_as_fast_as_it_is() -> None:
    """5 m past it at 5 m/s, of the 10 m/s that are driven in the next lane."""
    _, local, state = view(v=5.0)
    node = local.node.copy()
    node[:, REACH] = 95.0
    past = local._replace(
        node=node, target_lane_speed=10.0, to_leave=np.array([[0.0, 0.0, 95.0, 0.0]])
    )
    assert plain(cost._too_slow)(past, state) == pytest.approx(0.5)


def test_where_only_the_oncoming_lane_leads_past_each_slow_one_ahead_holds_the_ego_up() -> None:
    """At 160 m and 7.5 m/s a half, at 200 m and 3 m/s 0.8; the one behind nothing; 2 at most."""
    agents = [Agent("a", "a_0", 160.0, 7.5), Agent("b", "a_0", 200.0, 3.0), Agent("c", "a_0", 50.0, 3.0)]  # fmt: skip
    _, local, state = view(*agents, v=15.0)
    stuck = plain(cost.stuck_behind)
    assert stuck(local, state.node, 100.0, 0.0, 0.0) == 0.0  # elsewhere it is for the leader to say
    local = local._replace(stuck=1.0)
    local.agent[:, 1, V], local.agent[5:, 0, V], local.agent[5:, 2, V] = 3.0, 15.0, 15.0
    assert stuck(local, state.node, 100.0, 0.0, 0.0) == pytest.approx(0.5 + 0.8)
    assert stuck(local, state.node, 100.0, 0.0, 2.0) == pytest.approx(0.8)
    assert stuck(local, state.node, 100.0, 0.0, 1e4) == pytest.approx(0.8)
    assert stuck(local, state.node, 100.0, 70.0, 0.0) == pytest.approx(0.8)
    assert stuck(local, state.node, 10.0, 0.0, 0.0) == pytest.approx(2.0)
    local.agent[0, 1, NODE] = ELSEWHERE
    assert stuck(local, state.node, 100.0, 0.0, 0.0) == pytest.approx(0.5)
    found = terminal(local, C, state, math.inf, 0.0, 0.0)
    assert found == pytest.approx(8.0 * 0.5)


def test_waiting_beyond_the_horizon_counts_less_and_less(monkeypatch: pytest.MonkeyPatch) -> None:
    """30 (1 - exp(-t / 30)); the time to get as fast as the limit is lost already."""
    _, local, state = view(v=9.0)
    asked: list[tuple[float, ...]] = []
    for t, seconds in ((0.0, 0.0), (10.0, 8.504), (60.0, 25.940)):
        monkeypatch.setattr(cost, "waiting_s", lambda *those, t=t: asked.append(those[2:]) or t)
        found = terminal(local, C, state, math.inf, 0.0, 8.0) - 36.0 / 78.0
        assert found == pytest.approx(seconds, abs=1e-3)
        none = terminal(local, without("beyond_s"), state, math.inf, 0.0, 8.0)
        assert none == pytest.approx(36.0 / 78.0)
    assert asked == [(8.0, pytest.approx(36.0 / 78.0))] * 3


@pytest.mark.parametrize(
    ("node", "other", "progress", "against"),
    [(0, -1, 0.0, False), (1, -1, 0.0, True), (0, 1, 0.3, True), (0, 1, 0.7, False), (1, 0, 0.7, True), (0, 2, 0.3, False), (5, -1, 0.0, False)],
)  # fmt: skip
def test_who_is_in_a_lane_of_the_oncoming_or_comes_to_it(
    node: int, other: int, progress: float, against: bool
) -> None:
    _, local, state = view(lanes=3)
    to_leave = local.to_leave.copy()
    to_leave[1, ONCOMING] = 1.0
    there = state._replace(node=node, other=other, progress=progress)
    assert plain(cost.is_against)(local._replace(to_leave=to_leave), there) == against


def test_an_overtaking_ego_is_worth_at_the_horizon_what_it_is_in_its_own_lane() -> None:
    """From the lane of the oncoming it has to come back: urgency counts where it belongs."""
    _, local, state = view(lanes=3, v=15.0)
    to_leave, node, urgency = local.to_leave.copy(), local.node.copy(), local.urgency.copy()
    to_leave[1, ONCOMING], node[1, HOME], urgency[:3] = 1.0, 0.0, (1.0, 3.0, 0.0)
    local = local._replace(to_leave=to_leave, node=node, urgency=urgency)
    own = terminal(local, C, state, math.inf, 0.0, 8.0)
    assert own == pytest.approx(16.0)
    assert terminal(local, C, state._replace(node=1), math.inf, 0.0, 8.0) == pytest.approx(own)
    changing = state._replace(other=1, progress=0.3)  # no home of its own: it stays where it is
    node[0, HOME] = -1.0
    assert terminal(local, C, changing, math.inf, 0.0, 8.0) == pytest.approx(own)
