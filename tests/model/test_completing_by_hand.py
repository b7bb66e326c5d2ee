"""An overtaking that is under way at the horizon, by hand: how it ends, what is owed to the
oncoming, and what that costs.

The ego drives 15 m/s, 100 m along the lane of the oncoming; vehicles are 5 m long. Past one of v
it is 2.5 m + 1.8 s v + 5 m ahead of it. The weights are the usual ones: claim 16, route 2, progress
1, tail 8 s, contact 60.
"""

import math

import numpy as np
import pytest
from helpers import Agent, ego_at
from helpers_model import lanes_east, local_of, plain, scenario, scene_of, task_of

from sumo_mcts.driver.params import cost_params
from sumo_mcts.model import completing
from sumo_mcts.model.completing import _Return
from sumo_mcts.model.local_map import (
    DRIVEN,
    ELSEWHERE,
    HEAD_ON,
    NODE,
    ONCOMING,
    UNSEEN,
    LocalMap,
    S,
    State,
    V,
)
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.model.oncoming import OVER_LIMIT
from sumo_mcts.model.route import HOME, REACH

C = cost_params(scenario())
HOME_LANE, THERE = 0, 1
returned, unfinished = plain(completing._return), plain(completing.unfinished)
owed, priced = plain(completing._share_owed), plain(completing._cost)


def overtaking(*those: tuple[float, float], v: float = 15.0) -> tuple[LocalMap, EgoParams, State]:
    """Others at these places of the ego's own lane, with these speeds, which they keep."""
    road = lanes_east(2, 900.0)
    ego = ego_at(road, "a_0", 100.0, v)
    agents = [Agent(f"q{k}", "a_0", s, speed) for k, (s, speed) in enumerate(those)]
    task = task_of(road, ego)
    local, state = local_of(task, scene_of(ego, road, *agents))
    agent, node, to_leave = local.agent.copy(), local.node.copy(), local.to_leave.copy()
    for i, (s, speed) in enumerate(those):
        agent[:, i, S], agent[:, i, V] = s, speed
    node[THERE, HOME], to_leave[THERE, ONCOMING] = HOME_LANE, 1.0
    local = local._replace(agent=agent, node=node, to_leave=to_leave)
    return local, task.ego, state._replace(node=THERE)


@pytest.mark.parametrize(
    ("those", "v", "to", "seconds", "gap", "leader"),
    [
        ((), 15.0, 0.0, 0.0, math.inf, 0.0),
        (((104.0, 5.0),), 15.0, 20.5, 2.05, math.inf, 0.0),  # 4 + 2.5 + 9 + 5 m, 10 m/s faster
        (((97.0, 5.0),), 15.0, 13.5, 1.35, math.inf, 0.0),  # it is behind, but not far enough
        (((80.0, 5.0),), 15.0, 0.0, 0.0, math.inf, 0.0),
        (((104.0, 5.0), (150.0, 6.0)), 15.0, 20.5, 2.05, 24.5, 6.0),
        (((150.0, 6.0), (104.0, 5.0)), 15.0, 20.5, 2.05, 24.5, 6.0),
        (((104.0, 5.0), (150.0, 6.0), (180.0, 3.0)), 15.0, 20.5, 2.05, 24.5, 6.0),
        (((170.0, 3.0), (160.0, 6.0), (104.0, 5.0)), 15.0, 20.5, 2.05, 34.5, 6.0),
        (((104.0, 5.0), (126.0, 6.0)), 15.0, 44.3, 44.3 / 9.0, math.inf, 0.0),  # past both
        (((130.0, 3.0),), 15.0, 0.0, 0.0, 25.0, 3.0),  # behind it
        (((104.0, 5.0),), 5.9, 20.5, math.inf, math.inf, 0.0),  # hardly faster
        (((104.0, 5.0),), 6.1, 20.5, 20.5 / 1.1, math.inf, 0.0),
        (((130.0, 5.0),), 5.9, 0.0, 0.0, 25.0, 5.0),
        (((140.0, 5.0), (128.0, 5.0), (116.0, 5.0), (104.0, 5.0)), 15.0, 56.5, 5.65, math.inf, 0.0),
    ],
)
def test_how_the_ego_gets_back(
    those: tuple[tuple[float, float], ...], v: float, to: float, seconds: float, gap: float,
    leader: float,
) -> None:  # fmt: skip
    local, p, state = overtaking(*those, v=v)
    found = returned(local, p, state, THERE, 0, 0.0)
    assert found == pytest.approx((to, seconds + p.change_duration, gap, leader))


def test_a_platoon_of_five_is_too_long_and_who_is_in_no_lane_is_not_in_it() -> None:
    five = [(152.0 - 12.0 * k, 5.0) for k in range(5)]
    local, p, state = overtaking(*five)
    assert returned(local, p, state, THERE, 0, 0.0).seconds == math.inf
    local.agent[7, :, NODE] = ELSEWHERE
    assert returned(local, p, state, THERE, 7, 0.0) == (0.0, p.change_duration, math.inf, 0.0)


@pytest.mark.parametrize(("s", "to"), [(48.0, 13.5), (25.0, 0.0)])
def test_who_is_behind_on_a_lane_before_is_not_cut_off(s: float, to: float) -> None:
    """50 m long, it leads to the ego's own: 3 m, or 26 m, behind the ego."""
    local, p, state = overtaking((104.0, 5.0))
    ahead = np.full((3, 3), np.inf)
    ahead[0, 0], ahead[2, 0] = 0.0, 50.0
    local = local._replace(ahead=ahead)
    local.agent[:, 0, [NODE, S]] = 2.0, s
    found = returned(local, p, state._replace(s=1.0), THERE, 0, 0.0)
    assert found == pytest.approx((to, to / 10.0 + p.change_duration, math.inf, 0.0))


def test_past_the_next_one_ahead_too() -> None:
    """From 25 m on, its rear: 30 + 2.5 + 5.4 + 5 m, 12 m/s faster."""
    local, p, state = overtaking((130.0, 3.0))
    found = returned(local, p, state, THERE, 0, 25.0)
    assert found == pytest.approx((42.9, 42.9 / 12.0 + p.change_duration, math.inf, 0.0))


# --- what is owed ---

ROOM = 2.5 + 10.0 + 100.0 / 9.0  # m in which one of 10 m/s stops
LEGAL = 10.0 / OVER_LIMIT  # m/s: one that nobody sees is taken to drive faster than it may
UNSEEN_ROOM = 2.5 + LEGAL + LEGAL**2 / 9.0


@pytest.mark.parametrize(
    ("left", "kind", "committed", "share"),
    [
        (24.0, HEAD_ON, False, 0.0),
        (20.0, HEAD_ON, False, math.inf),  # it had to brake
        (20.0, HEAD_ON, True, 0.5 + 2.0 * (1.0 - 20.0 / ROOM)),
        (10.1, HEAD_ON, True, 1.0),
        (9.9, HEAD_ON, True, math.inf),  # within a second of it
        (-54.9, HEAD_ON, True, math.inf),
        (-55.1, HEAD_ON, True, 0.0),  # it is past the ego, with its rear
        (20.0, UNSEEN, True, 0.0),
        (9.9, UNSEEN, True, math.inf),
        (UNSEEN_ROOM - 0.1, UNSEEN, False, math.inf),
        (UNSEEN_ROOM + 0.1, UNSEEN, False, 0.0),
        (5.0, 0, False, 0.0),  # it does not come towards the ego
    ],
)
def test_what_is_owed_to_the_oncoming(
    left: float, kind: int, committed: bool, share: float
) -> None:
    """In two seconds both drive 50 m; it has driven 3 m at the second forecast time."""
    local, _, state = overtaking((500.0, 10.0))
    local.agent[1, 0, DRIVEN] = 3.0
    enters = 100.0 + 50.0 + left
    for t, more in ((0, 0.0), (1, 3.0)):
        row = np.array([[THERE, 0.0, 900.0, 0, enters + more, kind, 0.0, 0.0]])
        now = local._replace(obligation=row, committed=committed)
        now.agent[0, 0, DRIVEN] = 0.0
        assert owed(now, state, THERE, t, 2.0) == pytest.approx(share)
        assert owed(now, state, HOME_LANE, t, 2.0) == 0.0  # another lane's
    twice = np.concatenate([row, row])
    twice[1, 4] += 500.0  # another one, far away
    assert owed(now._replace(obligation=twice), state, THERE, 1, 2.0) == pytest.approx(share)
    assert owed(now._replace(obligation=twice[::-1]), state, THERE, 1, 2.0) == pytest.approx(share)


# --- what it costs ---


def cost(back: _Return, urgency: float = 0.0, reach: float = math.inf, **more: float) -> float:
    local, _, state = overtaking((160.0, 7.5))
    urgencies, node = local.urgency.copy(), local.node.copy()
    urgencies[:], node[THERE, REACH] = (9.0, urgency), reach
    local = local._replace(urgency=urgencies, node=node, obligation=np.zeros((0, 8)), **more)
    found = priced(local, C, state, THERE, back, 0.0)
    twice = priced(local, C._replace(progress=2.0), state, THERE, back, 0.0)
    assert found <= twice <= 2.0 * found
    if back.gap < math.inf and urgency == 0.0:
        assert twice - C.lane_change == pytest.approx(2.0 * (found - C.lane_change))
    return found


def test_it_costs_the_lane_change_the_time_in_that_lane_and_what_is_lost_then() -> None:
    back = _Return(30.0, 4.0, math.inf, 0.0)
    assert cost(back) == pytest.approx(C.lane_change)
    assert cost(back, 1.5) == cost(back, -1.5) == pytest.approx(C.lane_change + 2.0 * 1.5 * 4.0)
    behind = back._replace(gap=60.0, leader_v=7.5)  # half of 8 s, less by 0.4 * 60 / 120
    assert cost(behind) == pytest.approx(C.lane_change + 8.0 * 0.5 * 0.8)
    assert cost(back, stuck=1.0) == pytest.approx(C.lane_change + 8.0 * 0.5)
    assert cost(back._replace(to=61.0), stuck=1.0) == pytest.approx(C.lane_change)
    assert cost(back, 9.0) == 30.0  # half of a contact at most


@pytest.mark.parametrize(
    ("seconds", "reach", "in_time"),
    [(19.9, math.inf, True), (20.1, math.inf, False), (9.9, 400.0, True), (10.1, 400.0, False)],
)
def test_out_of_time_it_costs_half_a_contact(seconds: float, reach: float, in_time: bool) -> None:
    """20 s; or the end of that lane, 300 m ahead, from which others may come with 15 m/s."""
    found = cost(_Return(0.0, seconds, math.inf, 0.0), reach=reach)
    assert found == pytest.approx(C.lane_change if in_time else 30.0)


@pytest.mark.parametrize("owing", [False, True])
def test_somebody_who_comes_adds_a_share_of_a_claim(owing: bool) -> None:
    local, _, state = overtaking((500.0, 10.0))
    row = np.array([[THERE, 0.0, 900.0, 0, 100.0 + 50.0 + 20.0, HEAD_ON, 0.0, 0.0]])
    local = local._replace(obligation=row, committed=owing, urgency=np.zeros(2))
    found = priced(local, C, state, THERE, _Return(0.0, 2.0, math.inf, 0.0), 0.0)
    share = 16.0 * (0.5 + 2.0 * (1.0 - 20.0 / ROOM))
    assert found == pytest.approx(C.lane_change + share if owing else 30.0)


def test_at_the_horizon_the_cheaper_way_back_counts_from_either_lane() -> None:
    """Behind one of 3 m/s, 25 m: 0.8 (1 - 0.4 * 25 / 120) of 8 s; or past it, 42.9 m / 12 m/s
    later, each second for twice the urgency."""
    local, p, state = overtaking((130.0, 3.0))
    there = state._replace(node=HOME_LANE, other=THERE, progress=0.3)
    behind, past = 8.0 * 0.8 * (1.0 - 10.0 / 120.0), 42.9 / 12.0
    for urgency in (0.0, 0.5, 1.0):
        now = local._replace(urgency=np.array([0.0, urgency]))
        rate = 2.0 * urgency
        expected = C.lane_change + rate * p.change_duration + min(behind, rate * past)
        for each in (state, there):
            assert unfinished(now, p, C, each, 0.0) == pytest.approx(expected)
        home = state._replace(node=HOME_LANE)
        assert unfinished(now, p, C, home, 0.0) == 0.0
    now.agent[10:, 0, NODE] = ELSEWHERE  # 2 s from now it is not there
    for time in (2.0, 99.0):
        alone = C.lane_change + rate * p.change_duration
        assert unfinished(now, p, C, state, time) == pytest.approx(alone)
