"""The ego among the others at one moment, by hand: contact, leader, followers, and the place for a
lane change.

Boxes are 5 m by 1.8 m, lanes 3.2 m apart; forecast times are 0.2 s apart.
"""

import math
from typing import Any

import numpy as np
import pytest
from helpers import Agent, ego_at
from helpers_model import lanes_east, local_of, plain, scenario, scene_of, task_of

from sumo_mcts.driver.params import cost_params
from sumo_mcts.model import interaction
from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.model.local_map import (
    BIT,
    ELSEWHERE,
    GOES_ROUND,
    GONE,
    HALF_LENGTH,
    HALF_WIDTH,
    NODE,
    ON_FOOT,
    POLITE,
    REACTS,
    SLOT,
    LocalMap,
    S,
    State,
    V,
)
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.model.route import OWES
from sumo_mcts.numerics.geometry import COS, SIN, X, Y

C = cost_params(scenario())
BARE = C._replace(headway=0.0, claim=0.0)
NO_OTHERS = np.zeros((0, 2))
meet, place_is_free = plain(interaction.meet), plain(interaction.place_is_free)


class Road:
    """The ego on lane 1 of three, its front at 100 m, and one other vehicle."""

    def __init__(self, lane: int = 1, s: float = 130.0, v: float = 10.0, own: float = 10.0) -> None:
        road = lanes_east(3, 900.0)
        ego = ego_at(road, "a_1", 100.0, own)
        task = task_of(road, ego)
        self.p: EgoParams = task.ego
        local, self.state = local_of(task, scene_of(ego, road, Agent("x", f"a_{lane}", s, v)))
        agent = local.agent.copy()
        agent[:, 0] = agent[0, 0]  # it stays where it is
        bounds = np.broadcast_to(np.array([-np.inf, np.inf, -np.inf, np.inf]), local.bounds.shape)
        self.local: LocalMap = local._replace(agent=agent, bounds=bounds.copy())

    def change(self, progress: float = 0.1, side: int = 1) -> State:
        return self.state._replace(other=1 + side, progress=progress)

    def meet(self, state: State | None = None, c: CostParams = BARE, t: int = 0, followers: int = 0) -> interaction.Meeting:  # fmt: skip
        return meet(self.local, self.p, c, state or self.state, NO_OTHERS, followers, t)


# --- contact ---


@pytest.mark.parametrize(
    ("gap", "own", "its", "contact"),
    [
        (0.1, 0.0, 0.0, False),
        (-0.1, 0.0, 0.0, True),
        (0.9, 10.0, 0.0, True),  # the way of a tenth of a second is part of the box, 1 m
        (1.1, 10.0, 0.0, False),
        (1.9, 10.0, 10.0, True),  # of both
        (2.1, 10.0, 10.0, False),
        (5.9, 30.0, 30.0, True),
        (6.1, 30.0, 30.0, False),
        (2.9, 30.0, 0.0, True),
        (2.9, 0.0, 30.0, True),
    ],
)
def test_nobody_slips_through_between_two_looks(
    gap: float, own: float, its: float, contact: bool
) -> None:
    """Ahead of the ego and behind it."""
    for s in (105.0 + gap, 95.0 - gap):
        road = Road(s=s, v=its, own=own)
        road.local.trait[:, BIT] = -1.0
        assert road.meet().contact == contact
        aside = road.meet(road.state._replace(node=0))
        assert not aside.contact


@pytest.mark.parametrize(("y", "contact"), [(1.7, True), (1.9, False), (-1.7, True), (-1.9, False)])
def test_boxes_meet_sideways(y: float, contact: bool) -> None:
    road = Road(lane=2, s=100.0)
    road.local.agent[:, 0, [X, Y]] = 97.5, y
    assert road.meet().contact == contact


@pytest.mark.parametrize(("y", "contact"), [(1.7, True), (1.85, True), (2.3, False)])
def test_a_lane_change_keeps_clear_to_the_side(y: float, contact: bool) -> None:
    """An ego that has hardly begun is in the middle of its lane still."""
    road = Road(lane=2, s=100.0)
    road.local.agent[:, 0, [X, Y, NODE]] = 97.5, y, ELSEWHERE
    road.local = road.local._replace(aside=0.2)
    assert road.meet(road.change(1e-6)).contact == contact
    assert road.meet().contact == (y < 1.8)


def test_who_is_gone_on_another_level_or_follows_is_not_met(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    road = Road(s=97.0)
    road.local.trait[0, BIT] = 0.0
    assert road.meet().contact and not road.meet(followers=1).contact
    assert road.meet(followers=2).contact
    asked: list[Any] = []
    monkeypatch.setattr(
        interaction, "on_other_level", lambda *those: asked.append(those[1:]) or True
    )
    assert not road.meet(t=3).contact and asked == [(1, 100.0, 5.0, 3, 0)]
    monkeypatch.undo()
    road.local.agent[:, 0, NODE] = GONE
    assert not road.meet().contact


def test_the_look_is_at_the_time_that_is_asked() -> None:
    road = Road(s=150.0)
    road.local.agent[4, 0, [X, S]] = 101.0, 103.5
    last = road.local.agent.shape[0] - 1
    assert [road.meet(t=t).contact for t in (3, 4, 5, last + 9)] == [False, True, False, False]
    road.local.agent[last, 0, [X, S]] = 101.0, 103.5
    assert road.meet(t=last + 9).contact  # beyond the forecast its last time counts


def test_where_somebody_comes_or_may_still_be_costs() -> None:
    """It is there at one forecast time: 0.8 s later 16 a second, 1.6 s later 8, 0.4 s before 8."""
    road = Road(lane=2, s=100.0, own=0.0)
    road.local.agent[:, 0, [Y, NODE]] = 60.0, ELSEWHERE
    road.local.agent[10, 0, Y] = 1.0
    c = C._replace(headway=0.0)
    assert [road.meet(c=c, t=t).rate for t in (2, 6, 12, 5, 9, 11)] == [8.0, 16.0, 8.0, 0, 0, 0]


def test_beyond_eighty_metres_there_is_nobody() -> None:
    """But a leader; the swept box would reach it."""
    road = Road(own=0.0)
    for dx, dy in ((79.0, 0.0), (-79.0, 0.0), (0.0, 79.0), (0.0, -79.0)):
        for more in (0.0, 2.0):
            at = 97.5 + dx * (79.0 + more) / 79.0, dy * (79.0 + more) / 79.0
            road.local.agent[:, 0, [X, Y, NODE]] = *at, ELSEWHERE
            road.local.trait[0, [HALF_LENGTH, HALF_WIDTH]] = 100.0, 100.0
            assert road.meet().contact == (more == 0.0)


# --- leader and followers ---


@pytest.mark.parametrize(
    ("lane", "s", "gap"),
    [(1, 130.0, 25.0), (1, 175.0, 70.0), (1, 300.0, 195.0), (1, 90.0, math.inf), (2, 130.0, math.inf), (1, 106.0, 1.0)],
)  # fmt: skip
def test_the_leader_is_who_is_ahead_in_the_lane_at_any_distance(
    lane: int, s: float, gap: float
) -> None:
    road = Road(lane, s, v=7.0, own=0.0)
    near = road.meet().near
    assert near.gap == pytest.approx(gap) and near.leader_v == (7.0 if gap < math.inf else 0.0)
    if gap < math.inf:
        road.local.agent[:, 0, NODE] = ELSEWHERE
        assert road.meet().near.gap == math.inf


def test_who_follows_leads_nobody_out_of_sight() -> None:
    road = Road(1, 300.0)
    road.local.trait[0, BIT] = 0.0
    assert road.meet().near.gap == 195.0 and road.meet(followers=1).near.gap == math.inf
    assert road.meet(t=4).near.gap == 195.0


def test_who_is_late_leads_from_where_it_is_even_if_it_once_followed() -> None:
    """By the forecast it is at 310 m, but it was held up at 300 m, and drives 3 m/s."""
    road, late = Road(1, 300.0), np.array([[0.0, 3.0]])
    road.local.agent[5, 0, S] = 310.0
    road.local.trait[0, [BIT, SLOT]] = 0.0
    for followers in (0, 1):
        near = meet(road.local, road.p, BARE, road.state, late, followers, 5).near
        assert (near.gap, near.leader_v) == (pytest.approx(195.0), 3.0)


@pytest.mark.parametrize(("lane", "s"), [(1, 60.0), (2, 60.0)])
def test_a_follower_is_new_where_the_ego_moves_in_front_of_it(lane: int, s: float) -> None:
    """40 m behind at 10 m/s, as fast as the ego: it costs nothing, and is remembered by its bit."""
    road = Road(lane, s)
    road.local.trait[0, BIT] = 3.0
    for state, follows in ((road.state, lane == 1), (road.change(), True), (road.change(side=-1), lane == 1)):  # fmt: skip
        met = road.meet(state, C)
        assert (met.near.followers, met.once) == (8 if follows else 0, 0.0)
        assert road.meet(state, C, followers=1).near.followers == (9 if follows else 1)
        assert road.meet(state, C, followers=8).near.followers == 8
    for column in (REACTS, BIT):  # who does not react, or is too far away to be known
        road.local.trait[0, column] = -1.0 if column == BIT else 0.0
        assert road.meet(road.change(), C).near.followers == 0


@pytest.mark.parametrize(("polite", "reaction"), [(0.0, 1.8), (1.0, 1.0)])
def test_the_price_of_moving_in_front_is_paid_once_and_less_by_patience(
    polite: float, reaction: float
) -> None:
    """8 m before a follower of 8 m/s, 4 m/s faster than the ego; who expects it reacts faster."""
    road = Road(2, 87.0, v=8.0, own=4.0)
    road.local.trait[0, POLITE] = polite
    own = 4.5 * reaction
    safe = math.sqrt(own**2 + 16.0 + 9.0 * 5.5) - own
    price = 16.0 * max(8.0 - safe, 0.0) / 2.5
    assert price > 1.0
    c = C._replace(headway=0.0)
    assert road.meet(road.change(), c).once == pytest.approx(price)
    road.local = road.local._replace(patience=0.25)
    assert road.meet(road.change(), c).once == pytest.approx(0.25 * price)
    assert road.meet(road.change(), c, followers=1).once == 0.0  # it was paid before


def test_where_no_driver_could_cope_it_is_as_dear_as_standing_in_the_way() -> None:
    road = Road(2, 93.0, v=10.0, own=4.0)
    met = road.meet(road.change(), C._replace(headway=0.0))
    assert met.rate >= C.claim and met.once == 0.0 and met.near.followers == 0


def test_a_person_beside_the_lane_costs_by_the_speed() -> None:
    """At 12 m/s, without room to spare: 16 (12 / 8 - 1)."""
    road = Road(2, 100.0, own=12.0)
    road.local.agent[:, 0, [X, Y, COS, SIN, V, NODE]] = 97.5, 1.4, 1.0, 0.0, 0.0, ELSEWHERE
    road.local.trait[0, [HALF_LENGTH, HALF_WIDTH]] = 0.5, 0.5 - 1e-6
    for on_foot, rate in ((1.0, 8.0), (0.0, 0.0)):
        road.local.trait[0, ON_FOOT] = on_foot
        met = road.meet(c=C._replace(headway=0.0))
        assert not met.contact and met.rate == pytest.approx(rate, rel=1e-3)


# --- the place for a lane change ---


def free(road: Road, most: float = math.inf, side: int = 1) -> bool:
    return place_is_free(road.local, road.p, C, road.change(1e-9, side), NO_OTHERS, 0, most)


@pytest.mark.parametrize(
    ("s", "v", "is_free"),
    [
        (100.0, 10.0, False),  # beside
        (104.0, 10.0, False),
        (105.4, 10.0, False),  # 0.4 m from the ego's front to its rear
        (105.6, 10.0, True),
        (96.0, 10.0, False),  # its front is beside
        (93.5, 10.0, True),  # 1.5 m behind, at the same speed
        (94.5, 10.0, False),
        (88.0, 16.0, True),  # 6 m/s faster: 36 / 6 = 6 m, and 1 m, of 7 m
        (88.2, 16.0, False),
    ],
)
def test_a_place_is_free_that_leaves_room(s: float, v: float, is_free: bool) -> None:
    road = Road(2, s, v)
    assert free(road) == is_free
    late = road.change(1e-9), NO_OTHERS, 10**6  # beyond the forecast
    assert place_is_free(road.local, road.p, C, *late) == is_free
    assert free(road, side=-1)  # on the other side nobody is
    road.local.trait[0, REACTS] = 0.0
    assert free(road)  # who does not react is found by its box


@pytest.mark.parametrize(
    ("s", "v", "is_free"),
    [(111.4, 4.0, False), (111.6, 4.0, True), (107.1, 7.0, True), (106.9, 7.0, False), (105.6, 14.0, True)],
)  # fmt: skip
def test_on_a_lane_further_on_nobody_may_be_slower_than_comfort_can_follow(
    s: float, v: float, is_free: bool
) -> None:
    """6 m/s slower: 36 / 6 = 6 m, and half a metre; 3 m/s slower: 1.5 m. It is 5 m long."""
    road = Road(2, s, v)
    ahead = road.local.ahead.copy()
    ahead[2, 0] = 0.0  # lane 0 lies on the way of lane 2 now
    road.local = road.local._replace(ahead=ahead)
    road.local.agent[:, 0, NODE] = 0.0
    assert free(road) == is_free


def test_a_place_may_cost_no_more_than_is_said() -> None:
    """15 m behind, at 8 m/s, of an ego of 4 m/s: 10 m of room."""
    road = Road(2, 85.0, v=8.0, own=4.0)
    safe = math.sqrt(8.1**2 + 16.0 + 9.0 * 7.5) - 8.1
    price = 16.0 * (8.0 - safe) / 2.5
    assert price > 1.0
    assert free(road, price + 0.01) and not free(road, price - 0.01)
    road.local = road.local._replace(patience=0.5)
    assert free(road, 0.51 * price) and not free(road, 0.49 * price)


def test_before_somebody_on_the_oncoming_lane_no_place_is_free(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    road, asked = Road(1, 400.0), []
    monkeypatch.setattr(
        interaction, "someone_comes", lambda *those: asked.append(those[2:]) or True
    )
    assert free(road) and asked == []
    node = road.local.node.copy()
    node[2, OWES] = 1.0
    road.local = road.local._replace(node=node)
    assert not free(road) and asked == [(2, 100.0, 0)] and free(road, side=-1)


# --- with the bounds that the forecast has ---


@pytest.mark.parametrize(("gap", "contact"), [(2.9, True), (3.1, False)])
def test_a_fast_ego_is_near_whom_it_sweeps_over(gap: float, contact: bool) -> None:
    """Half of 0.2 s at 30 m/s, 3 m, to one that stands ahead, or behind and on no lane."""
    for s in (105.0 + gap, 95.0 - gap):
        road = Road(s=s, v=0.0, own=30.0)
        at = road.local.agent[0, 0, X]
        road.local.bounds[:, 0] = at - 2.5, at + 2.5, -0.9, 0.9
        road.local.trait[:, BIT] = -1.0
        assert road.meet().contact == contact
        road.local.agent[:, :, NODE] = ELSEWHERE
        assert road.meet().contact == contact


def test_a_follower_that_is_in_no_lane_of_the_ego_any_more_is_met() -> None:
    """It has moved into the ego's box from the lane beside."""
    road = Road(lane=2, s=100.0)
    road.local.trait[0, BIT] = 0.0
    road.local.agent[:, 0, [X, Y]] = 97.5, 1.7
    assert road.meet(followers=1).contact
    road.local.agent[:, 0, NODE] = road.state.node  # in its lane it is where it would be without it
    road.local.agent[:, 0, S] = 96.0
    assert not road.meet(followers=1).contact


def test_the_leader_is_the_nearest_of_several_and_costs_by_its_distance() -> None:
    for order in ((130.0, 118.0), (118.0, 130.0)):
        road, ego = lanes_east(3, 900.0), ego_at(lanes_east(3, 900.0), "a_1", 100.0, 10.0)
        task = task_of(road, ego)
        cars = [Agent(f"x{k}", "a_1", s, 10.0 - k) for k, s in enumerate(order)]
        local, state = local_of(task, scene_of(ego, road, *cars))
        found = meet(local, task.ego, C, state, NO_OTHERS, 0, 0)
        nearest = order.index(118.0)
        assert found.near.gap == pytest.approx(13.0)
        assert found.near.leader_v == pytest.approx(10.0 - nearest)
        # 2 m and 1.2 s at 10 m/s are 14 m, of which one is missing
        assert found.rate == pytest.approx(1.5 / 14.0**2, abs=1e-6)


@pytest.mark.parametrize(
    ("round_it", "v", "a", "contact"),
    [(1.0, 0.0, 0.0, False), (0.0, 0.0, 0.0, True), (1.0, 0.1, 0.0, True), (1.0, 0.0, -1.0, True)],
)
def test_who_can_go_round_a_standing_ego_is_in_its_way_by_a_tenth(
    round_it: float, v: float, a: float, contact: bool
) -> None:
    """Of 16 a second; an ego that has come to its stand in this very step still hits."""
    road = Road(lane=1, s=101.0, v=1.0, own=v)
    road.local.trait[0, [ON_FOOT, GOES_ROUND]] = 1.0, round_it
    road.local.trait[0, BIT] = -1.0
    road.local.agent[:, 0, NODE] = ELSEWHERE
    met = road.meet(road.state._replace(a=a), C._replace(headway=0.0))
    assert met.contact is contact
    if not contact:
        assert met.rate == pytest.approx(1.6)


def test_only_who_is_late_or_walks_where_it_was_to_be_is_in_the_way_no_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of those that the search moves: who is on foot and in time claims its way still."""
    road = Road(lane=2, s=130.0)
    monkeypatch.setattr(interaction, "late_cost", lambda *_: 1.0)
    monkeypatch.setattr(interaction, "occupancy_cost", lambda *_: 2.0)
    monkeypatch.setattr(interaction, "passing_cost", lambda *_: 0.5)
    box = interaction.Box(97.5, 0.0, 1.0, 0.0, 2.5, 0.9)
    other = interaction.Box(140.0, 0.0, 1.0, 0.0, 2.5, 0.9)

    def rate(on_foot: float, moved: bool, aside: bool, at: int) -> float:
        road.local.trait[0, ON_FOOT] = on_foot
        return plain(interaction._nearness)(
            road.local, road.p, C, road.state, box, box, other, 1.0, at, 5, 0, moved, aside
        )

    assert rate(1.0, False, False, 5) == rate(1.0, True, False, 5) == 3.5
    assert rate(0.0, False, False, 5) == rate(0.0, False, False, 4) == 3.0
    assert rate(0.0, True, False, 5) == 0.0
    assert rate(1.0, True, True, 5) == rate(1.0, True, False, 4) == 0.0
