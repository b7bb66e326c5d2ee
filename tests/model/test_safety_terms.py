"""The terms of safety in planner `mcts`, each written down once more from the table in
docs/planner.md, and numbers worked out by hand: headway, moving in front of somebody, predicted
occupancy, passing people, yield obligations.

Steps of 0.1 s; headway 1.5 (2 m and 1.2 s), claim 16 (1.6 s), careful drivers 1.8 s, 4.5 m/s2 and
2.5 m; boxes of 5 m by 1.8 m; the ego's front is at 100 m.
"""

import math
from typing import Any

import numpy as np
import pytest
from helpers import Agent, ego_at
from helpers_model import lanes_east, local_of, plain, scenario, scene_of, task_of

from sumo_mcts.driver.params import cost_params
from sumo_mcts.model import gaps, interaction, occupancy
from sumo_mcts.model.local_map import (
    AGENT,
    BESIDE,
    BIT,
    DRIVEN,
    ELSEWHERE,
    GONE,
    HALF_LENGTH,
    HALF_WIDTH,
    HEAD_ON,
    NODE,
    POLITE,
    REACTS,
    UNSEEN,
    UNTIL,
    WALKS,
    LocalMap,
    State,
    V,
)
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.model.passing import passing_cost
from sumo_mcts.numerics.geometry import COS, SIN, Box, X, Y
from sumo_mcts.numerics.krauss import safe_gap, safe_speed

C = cost_params(scenario())
headway, meet = plain(interaction._headway), plain(interaction.meet)
cut_in, occupied = plain(gaps.cut_in_cost), plain(occupancy.occupancy_cost)
late, yielding = plain(occupancy.late_cost), plain(occupancy.yielding_cost)
share_of, passing = plain(occupancy.brakes_share), plain(passing_cost)
speed_for, gap_for = plain(safe_speed), plain(safe_gap)
NO_OTHERS = np.zeros((0, 2))


def view(*agents: Agent, v: float = 10.0, lanes: int = 1) -> tuple[EgoParams, LocalMap, State]:
    """The ego on lane 0, its front at 100 m; the limit is 15 m/s."""
    road = lanes_east(lanes, 900.0)
    ego = ego_at(road, "a_0", 100.0, v)
    task = task_of(road, ego)
    return task.ego, *local_of(task, scene_of(ego, road, *agents))


# --- C_s: headway ---


@pytest.mark.parametrize(
    ("gap", "v", "rate"),
    [
        (14.0, 10.0, 0.0),  # wished for: 2 + 1.2 * 10
        (20.0, 10.0, 0.0),
        (7.0, 10.0, 0.375),  # half of it is missing: 1.5 / 4
        (10.5, 10.0, 0.09375),  # a quarter: 1.5 / 16
        (0.0, 10.0, 1.5),
        (-3.0, 10.0, 1.5),
        (1.0, 0.0, 0.375),
        (math.inf, 10.0, 0.0),
    ],
)
def test_headway_is_quadratic_in_what_is_missing(gap: float, v: float, rate: float) -> None:
    assert headway(C, gap, v) == pytest.approx(rate)
    assert headway(C._replace(headway=3.0), gap, v) == pytest.approx(2.0 * rate)


def test_headway_counts_from_the_leaders_rear() -> None:
    """The leader's front is at 112 m, its rear at 107 m: 7 m."""
    p, local, state = view(Agent("x", "a_0", 112.0, 10.0))
    met = meet(local, p, C._replace(claim=0.0), state, NO_OTHERS, 0, 0)
    assert met.near.gap == pytest.approx(7.0) and met.near.leader_v == pytest.approx(10.0)
    assert met.rate == pytest.approx(0.375) and not met.contact and met.once == 0.0


# --- C_s: the safe gap, and moving in front of somebody ---


@pytest.mark.parametrize(
    ("v", "leader", "reaction", "gap"),
    [(10.0, 10.0, 1.0, 10.0), (10.0, 0.0, 1.0, 21.111), (10.0, 8.0, 1.0, 14.0), (5.0, 10.0, 1.8, 9.0), (9.0, 0.0, 0.5, 13.5)],
)  # fmt: skip
def test_the_safe_gap_and_the_safe_speed_are_two_sides_of_one_rule(
    v: float, leader: float, reaction: float, gap: float
) -> None:
    """reaction v + (v^2 - u^2) / (2 * 4.5)."""
    assert gap_for(v, leader, reaction) == pytest.approx(gap, abs=1e-3)
    if v >= leader:
        assert speed_for(gap, leader, reaction) == pytest.approx(v, abs=1e-3)
    assert speed_for(-0.1, leader, reaction) == 0.0


def naive_cut_in(gap: float, follower: float, ego: float, reaction: float) -> float:
    """16 for each 2.5 m/s, or fifth of the follower's speed, that it has to lose at once."""
    closing = max(follower - ego, 0.0)
    if gap < 1.0 or closing**2 / (2.0 * 3.0) > gap - 1.0:
        return -1.0
    own = 4.5 * reaction
    room, leads = gap - 2.5, min(ego, follower)
    safe = math.sqrt(own**2 + leads**2 + 9.0 * room) - own if room >= 0.0 else 0.0
    return 16.0 * max(follower - safe, 0.0) / max(2.5, 0.2 * follower)


@pytest.mark.parametrize(
    ("gap", "follower", "ego", "price"),
    [
        (13.983, 8.0, 4.0, 16.0),  # gives up 2.5 m/s
        (22.24, 8.0, 4.0, 0.0),
        (6.9, 10.0, 4.0, -1.0),  # 36 / 6 = 6 m of braking, and 1 m
        (0.9, 5.0, 5.0, -1.0),
        (1.1, 5.0, 5.0, 32.0),  # below the gap at a stand: all of its 5 m/s
    ],
)
def test_moving_in_front_of_somebody(gap: float, follower: float, ego: float, price: float) -> None:
    assert cut_in(C, gap, follower, ego) == pytest.approx(price, abs=0.01)


def test_drawn_lane_changes_cost_what_they_take() -> None:
    rng = np.random.default_rng(2)
    for gap, follower, ego in rng.uniform((0.0, 0.0, 0.0), (60.0, 30.0, 30.0), (200, 3)):
        for expects, reaction in ((False, 1.8), (True, 1.0)):
            found = cut_in(C, gap, follower, ego, expects)
            assert found == pytest.approx(naive_cut_in(gap, follower, ego, reaction))
            if found >= 0.0:
                assert cut_in(C._replace(claim=32.0), gap, follower, ego, expects) == 2.0 * found
                assert cut_in(C, gap + 1.0, follower, ego, expects) <= found


# --- C_s: where others are about to be ---


def occupying(index: int, **traits: float) -> tuple[LocalMap, State, Box]:
    """Somebody is where the ego is at one forecast time only, and else 300 m away."""
    p, local, state = view(Agent("x", "", x=0.0, y=300.0), v=0.0)
    agent, place, trait = local.agent.copy(), local.place.copy(), local.trait.copy()
    agent[:, 0, [X, Y, COS, SIN, NODE]] = 97.5, 300.0, 1.0, 0.0, ELSEWHERE
    agent[index, 0, Y], place[:], trait[:, BIT] = 1.0, -1, -1.0
    trait[0, [HALF_LENGTH, HALF_WIDTH]], trait[0, POLITE] = (2.5, 0.9), traits.get("polite", 0.0)
    box = Box(97.5, 0.0, 1.0, 0.0, p.half_length, p.half_width)
    return local._replace(agent=agent, place=place, trait=trait), state, box


@pytest.mark.parametrize(
    ("index", "now", "soon", "was"),
    [(14, 10, 16.0, 0.0), (18, 10, 8.0, 0.0), (10, 10, 0.0, 0.0), (12, 10, 0.0, 0.0), (16, 10, 0.0, 0.0), (20, 10, 0.0, 0.0), (8, 10, 0.0, 8.0), (9, 10, 0.0, 0.0), (6, 10, 0.0, 0.0)],
)  # fmt: skip
def test_a_place_belongs_to_who_comes_there_within_claim_s(
    index: int, now: int, soon: float, was: float
) -> None:
    """Looked at are 0.8 s and 1.6 s later, 4 and 8 forecast times, and 0.4 s before, 2 of them."""
    local, state, box = occupying(index)
    assert occupied(local, C, state, box, now, 0) == soon
    assert late(local, C, state, box, now, 0) == was
    twice = C._replace(claim=2.0 * C.claim)
    assert occupied(local, twice, state, box, now, 0) == 2.0 * soon
    assert late(local, twice, state, box, now, 0) == 2.0 * was
    longer = C._replace(claim_s=3.2)  # 1.6 s and 3.2 s
    assert occupied(local, longer, state, box, now, 0) == (16.0 if index == now + 8 else 0.0)


def test_who_lets_the_ego_pass_or_is_gone_claims_nothing() -> None:
    local, state, box = occupying(14, polite=1.0)
    assert occupied(local, C, state, box, 10, 0) == 0.0
    local, state, box = occupying(18)
    assert occupied(local, C, state, box, 10, 0) == 8.0
    local.agent[14, 0, NODE] = GONE  # before it comes
    assert occupied(local, C, state, box, 10, 0) == 0.0
    local, state, box = occupying(8)
    local.agent[8, 0, NODE] = GONE
    assert late(local, C, state, box, 10, 0) == 0.0
    last = local.agent.shape[0] - 1
    local, state, box = occupying(last)
    assert (
        occupied(local, C, state, box, last - 3, 0) == 0.0
    )  # beyond the forecast nothing is known
    assert occupied(local, C, state, box, last - 4, 0) == 16.0
    assert late(local, C, state, box, 1, 0) == 0.0


def test_the_nearest_forecast_times_are_looked_at() -> None:
    """0.3 s apart: 0.8 s, 1.6 s and 0.4 s are about 3, 5 and 1 of them."""
    for index, soon, was in ((13, 16.0, 0.0), (15, 8.0, 0.0), (12, 0.0, 0.0), (9, 0.0, 8.0)):
        local, state, box = occupying(index)
        local = local._replace(dt=0.3)
        assert occupied(local, C, state, box, 10, 0) == soon
        assert late(local, C, state, box, 10, 0) == was
    local = occupying(8)[0]._replace(dt=0.25)  # 1.6 times: 2
    assert late(local, C, state, box, 10, 0) == 8.0


def test_on_another_level_nothing_is_claimed(monkeypatch: pytest.MonkeyPatch) -> None:
    for index in (14, 18, 8):
        local, state, box = occupying(index)
        asked: list[Any] = []
        monkeypatch.setattr(
            occupancy, "on_other_level", lambda *those, asked=asked: asked.append(those[1:]) or True
        )
        assert occupied(local, C, state, box, 10, 0) == late(local, C, state, box, 10, 0) == 0.0
        assert asked == [(state.node, state.s, 5.0, index, 0)]


@pytest.mark.parametrize(
    ("dx", "dy", "meets"),
    [(0.0, 1.7, True), (0.0, 1.9, False), (0.0, -1.7, True), (4.9, 0.0, True), (-4.9, 1.0, True), (5.1, 0.0, False), (-5.1, 0.0, False)],
)  # fmt: skip
def test_boxes_of_five_by_one_point_eight_metres_meet(dx: float, dy: float, meets: bool) -> None:
    local, state, box = occupying(14)
    local.agent[14, 0, [X, Y]], box = (97.5 + dx, 40.0 + dy), box._replace(y=40.0)
    assert occupied(local, C, state, box, 10, 0) == (16.0 if meets else 0.0)


@pytest.mark.parametrize(
    ("v", "room", "along", "share"),
    [(8.0, 0.0, True, 0.0), (12.0, 0.0, True, 0.5), (20.0, 0.0, True, 1.0), (12.0, 0.1, True, 0.125), (12.0, 0.4, True, 0.0), (12.0, 0.0, False, 0.0)],
)  # fmt: skip
def test_passing_who_walks_along_the_road(v: float, room: float, along: bool, share: float) -> None:
    """v / 8 m/s * (1 - room / 0.4 m) - 1, from 0 to 1, times 16."""
    ego = Box(100.0, 0.0, 1.0, 0.0, 2.5, 0.9)
    for side in (1.0, -1.0):
        walker = Box(101.0, side * (1.4 + room), *((1.0, 0.0) if along else (0.0, 1.0)), 0.5, 0.5)
        assert passing(C, v, ego, walker) == pytest.approx(16.0 * share)
        turned = [Box(b.y, b.x, b.sin, b.cos, b.half_length, b.half_width) for b in (ego, walker)]
        assert passing(C, v, *turned) == pytest.approx(16.0 * share)  # northward
        for away, counts in ((2.9, True), (3.1, False)):  # half a car and half a margin
            there = walker._replace(x=100.0 + side * away)
            assert passing(C, v, ego, there) == pytest.approx(16.0 * share * counts)


# --- C_s: yield obligations ---


@pytest.mark.parametrize(
    ("distance", "share"), [(20.0, 0.0), (25.0, 0.0), (18.0, 0.7), (15.0, 1.0), (5.0, 1.0), (19.0, 0.6)]
)  # fmt: skip
def test_who_has_to_brake_for_the_ego_claims_by_what_is_missing(
    distance: float, share: float
) -> None:
    """Of 20 m needed: a half at once, and twice the missing share."""
    assert share_of(distance, 20.0) == pytest.approx(share)


def owing(merges: float = 0.0, enters: float = 20.0, **more: Any) -> tuple[Any, ...]:
    """The ego, its front at 100 m, is in a stretch from 95 m to 105 m that it owes to somebody who
    comes with 10 m/s."""
    p, local, state = view(Agent("x", "", x=0.0, y=300.0), v=8.0)
    agent, trait = local.agent.copy(), local.trait.copy()
    agent[:, 0, V], agent[:, 0, DRIVEN] = 10.0, 0.0
    trait[0, REACTS], trait[0, 4], trait[0, 10] = more.get("reacts", 1.0), -1.0, -1.0
    row = [state.node, more.get("begins", 95.0), more.get("ends", 105.0), 0, enters, merges, 0, 0]
    local = local._replace(
        agent=agent, trait=trait, obligation=np.array([row]), patience=more.get("patience", 1.0),
        committed=more.get("committed", False),
    )  # fmt: skip
    return local, p, C, state, NO_OTHERS, 0


CROSSING = 2.5 + 10.0 + 100.0 / 9.0  # m: standstill gap, a second, braking to a stand
MERGING = 2.5 + 10.0 + 36.0 / 9.0  # behind an ego of 8 m/s


@pytest.mark.parametrize(
    ("merges", "enters", "needed", "driven"),
    [
        (0.0, 20.0, CROSSING, 20.0),
        (0.0, 23.0, CROSSING, 23.0),
        (0.0, 24.0, CROSSING, 24.0),
        (0.0, 0.0, CROSSING, 0.0),
        (0.0, -1.0, CROSSING, -1.0),
        (1.0, 16.0, MERGING, 16.0),
        (1.0, 17.0, MERGING, 17.0),
        (HEAD_ON, 122.0, CROSSING, 22.0),  # to the ego's front
        (HEAD_ON, 125.0, CROSSING, 25.0),
        (UNSEEN, 120.0, 2.5 + 10.0 / 1.1 + (10.0 / 1.1) ** 2 / 9.0, 20.0),
        (WALKS, 10.0, 10.5, 10.0),  # half a metre and a second
        (WALKS, 11.0, 10.5, 11.0),
    ],
)
def test_being_in_the_way_costs_by_how_near_the_other_is(
    merges: float, enters: float, needed: float, driven: float
) -> None:
    if merges == UNSEEN:
        needed = 2.5 + gap_for(10.0 / occupancy.OVER_LIMIT, 0.0, 1.0)
    share = min(1.0, 0.5 + 2.0 * (1.0 - driven / needed)) if 0.0 < driven < needed else 0.0
    assert yielding(*owing(merges, enters)) == pytest.approx(16.0 * share)


def test_what_the_agent_has_driven_brings_it_nearer() -> None:
    those = owing(enters=40.0)
    those[0].agent[3, 0, DRIVEN] = 20.0
    assert yielding(*those) == 0.0
    assert yielding(*those[:-1], 3) == pytest.approx(16.0 * share_of(20.0, CROSSING))


@pytest.mark.parametrize(
    ("begins", "ends", "inside"),
    [(101.0, 110.0, False), (99.0, 110.0, True), (80.0, 95.5, True), (80.0, 94.5, False)],
)
def test_only_in_the_stretch_until_the_rear_has_left_it(
    begins: float, ends: float, inside: bool
) -> None:
    """The ego is 5 m long."""
    assert (yielding(*owing(begins=begins, ends=ends)) > 0.0) == inside


def test_who_has_waited_long_counts_less_on_comfortable_braking() -> None:
    """Whoever can stop with 3 m/s2 2.5 m before it: 100 < 6 (20 - 2.5), but not from 19 m."""
    usual = yielding(*owing())
    assert yielding(*owing(patience=0.25)) == pytest.approx(0.25 * usual)
    assert yielding(*owing(patience=0.25, reacts=0.0)) == pytest.approx(usual)
    assert yielding(*owing(enters=19.0, patience=0.25)) == yielding(*owing(enters=19.0)) > usual
    assert yielding(*owing(HEAD_ON, 120.0, patience=0.25)) == yielding(*owing(HEAD_ON, 120.0)) > 0.0


def test_on_another_lane_or_for_one_that_nobody_sees_nothing_is_owed() -> None:
    local, *rest = owing()
    for column, value in ((0, 1.0), (AGENT, 0.0)):
        row = local.obligation.copy()
        row[0, column] = value
        assert (yielding(local._replace(obligation=row), *rest) > 0.0) == (column == AGENT)
    assert yielding(*owing(UNSEEN, 115.0)) > 0.0
    assert yielding(*owing(UNSEEN, 115.0, committed=True)) == 0.0
    assert yielding(*owing(HEAD_ON, 115.0, committed=True)) > 0.0


# --- beside, behind, oncoming ---


@pytest.mark.parametrize(
    ("progress", "lane", "s", "beside"),
    [
        (0.3, 0, 104.9, True),  # an agent of 4 m: its rear is at 100.9 m, but SUMO looks at fronts
        (0.3, 0, 103.9, True),
        (0.3, 0, 100.5, True),
        (0.3, 0, 99.5, True),
        (0.3, 0, 105.1, False),
        (0.3, 0, 95.1, True),  # the ego is 5 m long
        (0.3, 0, 94.9, False),
        (0.3, 1, 102.0, False),  # it counts to its old lane up to the middle of the change
        (0.52, 0, 102.0, False),  # and for two and a half steps of 0.1 s more to the one it leaves
        (0.52, 1, 102.0, True),
        (0.58, 1, 102.0, True),
        (0.59, 1, 102.0, False),
        (0.59, 0, 102.0, True),
    ],
)
def test_who_is_beside_in_the_lane_that_sumo_counts_the_ego_to(
    progress: float, lane: int, s: float, beside: bool
) -> None:
    """The ego is on lane 0 and changes to or comes from lane 1; the agent is 5 m long, too, or 4
    m."""
    p, local, state = view(lanes=2)
    there = state._replace(node=0, other=1, progress=progress)
    found = plain(gaps.is_beside_in_lane)(local, p, there, lane, s, 2.5)
    assert found == beside
    if lane == 0 and s > 100.0 and progress < 0.5:  # shorter, it is beside for less
        shorter = plain(gaps.is_beside_in_lane)(local, p, there, lane, s, 2.0)
        assert shorter == (s < 104.0)


@pytest.mark.parametrize(
    ("front", "progress", "beside"),
    [
        (4.9, 0.52, True),
        (5.1, 0.52, False),  # 5 m long: its rear is on this lane
        (4.9, 0.48, False),  # the new lane does not count yet
        (5.1, 0.59, True),
    ],
)
def test_behind_the_end_of_a_lane_the_new_lane_counts_at_once(
    front: float, progress: float, beside: bool
) -> None:
    """In crossing-blocked-scripted, seed 4, the ego came over to the lane of a car that stood at
    the line, half a metre too early."""
    p, local, state = view(lanes=2)
    node, other = (0, 1) if progress > 0.5 else (1, 0)
    there = state._replace(node=node, other=other, s=front, progress=progress)
    assert plain(gaps.is_beside_in_lane)(local, p, there, 0, 1.0, 2.5) == beside


def test_without_a_duration_the_old_lane_counts_for_the_step_of_the_jump() -> None:
    p, local, state = view(lanes=2)
    for progress, beside in ((0.9, True), (1.1, False)):
        there = state._replace(node=0, other=1, progress=progress)
        jump = p._replace(change_duration=0.0)
        assert plain(gaps.is_beside_in_lane)(local, jump, there, 1, 102.0, 2.5) == beside
    alone = state._replace(node=0, other=-1, progress=0.52)
    assert plain(gaps.is_beside_in_lane)(local, p, alone, 0, 102.0, 2.5)


def test_gaps_are_along_both_lanes_of_a_change() -> None:
    _, local, state = view(lanes=3)
    ahead, back, left = map(plain, (gaps.gap_ahead, gaps.gap_behind, gaps.lane_left))
    alone = state._replace(node=1)
    both = alone._replace(other=2, progress=0.3)
    assert [ahead(local, alone, lane, 130.0) for lane in (0, 1, 2)] == [math.inf, 30.0, math.inf]
    assert [ahead(local, both, lane, 130.0) for lane in (0, 1, 2)] == [math.inf, 30.0, 30.0]
    assert [back(local, alone, lane, 80.0) for lane in (0, 1, 2)] == [math.inf, 20.0, math.inf]
    assert [back(local, both, lane, 80.0) for lane in (0, 1, 2)] == [math.inf, 20.0, 20.0]
    target = plain(gaps.target_lane)
    assert [target(both), target(both._replace(progress=0.6)), target(alone)] == [2, 1, 1]
    trait = np.zeros((1, 11))
    trait[0, [HALF_LENGTH, BESIDE, UNTIL]] = 2.5, 1.0, 4.0
    local = local._replace(trait=trait)
    assert [left(local, 0, t) for t in (0, 4, 5)] == [1, 1, -1]
    to_leaving = plain(gaps.gap_to_leaving)
    assert to_leaving(local, alone, 0, 120.0, 4) == 15.0
    assert (
        to_leaving(local, alone, 0, 120.0, 5) == to_leaving(local, alone, 0, 104.0, 4) == math.inf
    )


@pytest.mark.parametrize(
    ("distance", "merges", "node", "comes"),
    [
        (20.0, HEAD_ON, 0, True),
        (23.0, HEAD_ON, 0, True),
        (24.0, HEAD_ON, 0, False),  # 23.6 m are enough to stop
        (-9.0, HEAD_ON, 0, True),  # beside: 5 m and 5 m
        (-11.0, HEAD_ON, 0, False),
        (20.0, 0.0, 0, False),
        (20.0, HEAD_ON, 1, False),
    ],
)
def test_whether_somebody_comes_in_a_lane_of_the_oncoming(
    distance: float, merges: float, node: int, comes: bool
) -> None:
    """It has driven 7 m of the way by then."""
    local, p, *_ = owing(merges, 100.0 + distance + 7.0)
    local.agent[:, 0, DRIVEN], local.trait[0, HALF_LENGTH] = 7.0, 2.5
    row = local.obligation.copy()
    row[0, 0] = node
    local = local._replace(obligation=row)
    assert plain(occupancy.someone_comes)(local, p, 0, 100.0, 3) == comes


@pytest.mark.parametrize(
    ("x", "y", "near"),
    [(0.0, 0.0, True), (-12.0, 0.0, True), (-14.0, 0.0, False), (22.0, 0.0, True), (24.0, 0.0, False), (5.0, -8.0, True), (5.0, -9.0, False), (5.0, 10.0, True), (5.0, 11.0, False)],
)  # fmt: skip
def test_a_first_look_is_at_the_bounds(x: float, y: float, near: bool) -> None:
    """West -10, east 20, south -5, north 7; the ego reaches 3.5 m."""
    _, local, _ = view(Agent("x", "a_0", 130.0, 5.0))
    bounds = np.full_like(local.bounds, 1e6)
    bounds[4, 0] = -10.0, 20.0, -5.0, 7.0
    assert plain(occupancy.may_be_near)(local._replace(bounds=bounds), x, y, 3.5, 4, 0) == near
