"""One action of planner `mcts`, step by step: when contact is looked for, what is added up, how it
ends. And the policy of its tree on small trees worked out by hand.

Steps of 0.1 s, 10 m/s on a road with a limit of 15 m/s: a second costs a third of a second.
"""

import math
from typing import Any

import numpy as np
import pytest
from helpers import Agent, ego_at, lights
from helpers_model import lanes_east, local_of, plain, road_with_light, scenario, scene_of, task_of

from sumo_mcts.driver.params import cost_params
from sumo_mcts.model.cost_params import CostParams, Term
from sumo_mcts.model.interaction import Meeting, Neighbours
from sumo_mcts.model.local_map import LocalMap, State
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.model.route import HOME
from sumo_mcts.planners import ply, search, tree
from sumo_mcts.planners.actions import FOLLOW, NO_SPEED, Action, Lines, lasting
from sumo_mcts.planners.continued import NOT_DRIVEN
from sumo_mcts.planners.ply import ALIVE, ARRIVED, IMPOSSIBLE, LOST, NONE, Driven, SearchParams
from sumo_mcts.scene import GREEN, LOSS, OTHER, PASSABILITY, SAFETY

simulate, replay, may_change = plain(ply.simulate), plain(ply.replay), plain(ply.may_change)
select, continuation = plain(search._select), plain(search._continuation)
C = cost_params(scenario())
Q = SearchParams(6, 2, 1, 2, 3, 0.5, 8.0, adaptive=False, each=False)
NO_OTHERS = np.zeros((0, 2))
ALONE = Neighbours(math.inf, 0.0, 0)
KEEP = Action(0.0, 0, NO_SPEED)


def view(s: float = 100.0, v: float = 10.0, light: bool = False) -> tuple[Any, ...]:
    """The ego, alone: its bounds, the local map, its state."""
    road = road_with_light() if light else lanes_east(3, 900.0)
    ego = ego_at(road, "a_0" if light else "a_1", s, v, route=(0, 2) if light else ())
    task = task_of(road, ego)
    scene = scene_of(ego, road, signals=lights(GREEN) if light else None)
    return task.ego, *local_of(task, scene)


class Met:
    """In place of the look at the others: the same each time, and contact at the n-th one."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, contact: int = 99, **what: float) -> None:
        self.at: list[int] = []
        self.s: list[float] = []
        self.contact, self.what = contact, what
        monkeypatch.setattr(ply, "meet", self)

    def __call__(
        self, local: Any, p: Any, c: Any, state: State, others: Any, followers: int, at: int
    ) -> Meeting:
        self.at.append(at)
        self.s.append(state.s)
        near = Neighbours(self.what.get("gap", math.inf), self.what.get("leader_v", 0.0), 5)
        rate, once = self.what.get("rate", 0.0), self.what.get("once", 0.0)
        return Meeting(len(self.at) == self.contact, rate, once, near)


def run(
    q: SearchParams = Q, at: int = 0, c: CostParams = C, action: Action = KEEP,
    near: Neighbours = ALONE, seen: tuple[Any, ...] = (),
) -> ply.Ply:  # fmt: skip
    p, local, state = seen or view()
    return simulate(local, p, c, q, state, NO_OTHERS, near, action, at)


@pytest.mark.parametrize(
    ("check", "at", "indices"),
    [
        (2, 0, [1, 2, 3]),  # 0.2 s, 0.4 s, 0.6 s; forecast times are 0.2 s apart
        (2, 5, [3, 4, 5]),  # from 0.5 s on: 0.6 s, 0.8 s, 1.0 s
        (2, 6, [4, 5, 6]),
        (3, 0, [2, 3]),  # 0.3 s counts as 0.4 s
        (6, 0, [3]),
        (4, 6, [4, 6]),  # 0.8 s, 1.2 s
        (1, 0, [1, 1, 2, 2, 3, 3]),
    ],
)
def test_when_contact_is_looked_for(
    check: int, at: int, indices: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    met = Met(monkeypatch)
    found = run(Q._replace(check=check), at)
    assert met.at == indices and found.end == ALIVE and found.near.followers == 5


def test_a_long_step_is_looked_at_several_times(monkeypatch: pytest.MonkeyPatch) -> None:
    """A step of 0.4 s at 10 m/s: after 2 m and 4 m."""
    met, (p, local, state) = Met(monkeypatch, rate=3.0), view()
    q = Q._replace(ply=2, check=0, checks_in_step=2)
    found = run(q, seen=(p._replace(step=0.4), local, state))
    assert met.at == [1, 2, 3, 4] and met.s == pytest.approx([102.0, 104.0, 106.0, 108.0])
    assert found.safety == pytest.approx(3.0 * 0.8)


def test_rates_count_for_the_time_between_two_looks_and_prices_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    Met(monkeypatch, rate=3.0, once=5.0)
    found = run()
    assert found.safety == pytest.approx(3.0 * 0.6 + 3 * 5.0)
    assert found.passability == pytest.approx(0.6 / 3.0) and found.comfort == found.other == 0.0
    assert found.state.s == pytest.approx(106.0)


def test_braking_imposed_on_who_reacts_has_its_cost(monkeypatch: pytest.MonkeyPatch) -> None:
    """1.5 m/s2 beyond, three times 0.2 s, at 2 for each."""
    Met(monkeypatch)
    asked: list[tuple[int, float]] = []

    def react(local: Any, p: Any, state: State, others: Any, t: int, seconds: float) -> float:
        asked.append((t, seconds))
        return 1.5

    monkeypatch.setattr(ply, "react", react)
    p, local, state = view()
    found = simulate(local, p, C, Q, state, np.zeros((1, 2)), ALONE, KEEP, 0)
    assert found.safety == pytest.approx(2.0 * 1.5 * 0.6)
    assert [t for t, _ in asked] == [1, 2, 3]
    assert [seconds for _, seconds in asked] == pytest.approx([0.2] * 3)


@pytest.mark.parametrize(("n", "time"), [(1, 0.2), (2, 0.4), (3, 0.6)])
def test_a_contact_ends_the_ply_with_its_loss(
    n: int, time: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """60 now, 30 after 8 s, and 10 for 10 m/s; what was paid before stays paid."""
    Met(monkeypatch, contact=n, rate=3.0)
    found = run()
    assert found.end == LOST and found.state.s == pytest.approx(100.0 + 10.0 * time)
    assert found.loss == pytest.approx(60.0 - 30.0 * time / 8.0 + 10.0)
    assert found.safety == pytest.approx(3.0 * time)


def test_after_a_contact_standing_there_is_part_of_passability(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """0.2 s at 10 of 15 m/s, then 7.8 s at a stand, 2.8846 s to pick up and 8 s behind it."""
    Met(monkeypatch, contact=1)
    assert run().passability == pytest.approx(0.2 / 3.0 + 7.8 + 2.8846 + 8.0, abs=1e-4)
    Met(monkeypatch, contact=1)
    found = run(c=C._replace(after_contact=0.0))
    assert found.passability == pytest.approx(0.2 / 3.0)


def test_a_red_line_costs_a_contact_and_red(monkeypatch: pytest.MonkeyPatch) -> None:
    """12 m/s, 5 m before the line: crossed in the fifth step, which begins after 0.4 s."""
    Met(monkeypatch)
    p, local, state = view(195.0, 12.0, light=True)
    assert run(seen=(p, local, state)).end == ALIVE
    local.closed[:] = 1
    for at in (0, 10):
        found = run(at=at, seen=(p, local, state))
        time = 0.4 + 0.1 * at
        assert found.end == LOST
        assert found.loss == pytest.approx(60.0 - 30.0 * time / 8.0 + found.state.v + 100.0)
    none = run(c=C._replace(red=0.0), seen=(p, local, state))
    assert none.loss == pytest.approx(run(seen=(p, local, state)).loss - 100.0)


def test_the_end_of_the_route_is_no_loss(monkeypatch: pytest.MonkeyPatch) -> None:
    met = Met(monkeypatch)
    found = run(seen=view(898.5))
    assert (found.end, found.loss) == (ARRIVED, 0.0) and len(met.at) == 0


def test_car_following_knows_the_gap_of_the_moment(monkeypatch: pytest.MonkeyPatch) -> None:
    """5 m/s slower: half a metre a step; after each look it is what was seen."""
    Met(monkeypatch, gap=30.0, leader_v=8.0)
    asked: list[tuple[float, ...]] = []
    monkeypatch.setattr(ply, "follow_accel", lambda p, *those: asked.append(those) or 0.0)
    run(action=Action(FOLLOW, 0, NO_SPEED), near=Neighbours(50.0, 5.0, 0))
    expected = [(10, 15, 50.0, 5.0), (10, 15, 49.5, 5.0)]
    expected += [(10, 15, 30.0, 8.0), (10, 15, 29.8, 8.0)] * 2
    assert np.array(asked) == pytest.approx(np.array(expected))


def test_a_term_of_the_users_own_is_asked_in_every_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """t, lane, s, v, a, jerk, gap, weight; 2 a second, as long as it lies between 0 and a
    contact."""
    Met(monkeypatch, gap=30.0, leader_v=10.0)
    asked: list[tuple[float, ...]] = []
    for rate, second in ((2.0, 2.0), (-1.0, 0.0), (math.nan, 0.0), (1000.0, 60.0)):
        term = Term(lambda *those, rate=rate: asked.append(those) or rate, 7.0)
        found = run(c=C._replace(term=term), at=10, near=Neighbours(50.0, 5.0, 0))
        assert found.other == pytest.approx(0.6 * second)
    assert asked[0] == pytest.approx((1.1, 1, 101.0, 10.0, 0.0, 0.0, 49.5, 7.0))
    assert asked[5][0] == pytest.approx(1.6)


def test_times_become_steps() -> None:
    def made(step: float, forecast: float) -> SearchParams:
        return ply.search_params(step, forecast, 0.8, 0.4, 3, 5, 0.7, adaptive=True)

    assert made(0.1, 0.2) == SearchParams(8, 4, 1, 3, 5, 0.7, pytest.approx(6.4), True, False)
    assert made(0.2, 0.2)[:3] == (4, 2, 1) and made(1.0, 0.2)[:3] == (1, 0, 5)
    assert made(1.0, 0.2).horizon == pytest.approx(8.0)
    assert ply.for_steps.__name__ == "for_steps" and plain(ply.for_steps)(
        made(0.1, 0.2), 1
    ) == made(0.1, 0.2)._replace(ply=1, adaptive=False)


# --- a whole sequence ---


def driven(line: Any, seen: tuple[EgoParams, LocalMap, State], q: SearchParams = Q) -> Any:
    p, local, state = seen
    m = len(line)
    found = Driven(
        np.zeros((1, m), np.int64), np.zeros((1, m, 2)), np.zeros((1, m, 4)), np.zeros((1, 5)),
        np.zeros(1, np.int64), np.zeros(1, np.int64), NO_OTHERS.copy(),
    )  # fmt: skip
    replay(local, p, C, q, state, NO_OTHERS, Lines(line[None], np.array([m])), found)
    return (
        found.steps[0],
        found.end[0],
        found.terms[0],
        found.node[0],
        found.motion[0],
        found.pose[0],
    )


def test_a_sequence_is_written_down_step_by_step() -> None:
    """Nine steps of a horizon of a second: nothing beyond it is counted."""
    steps, end, terms, lanes, motion, pose = driven(
        lasting(0.0, 0, 9), view(), Q._replace(horizon=1.0)
    )
    assert (steps, end) == (9, ALIVE) and lanes.tolist() == [1] * 9
    assert motion[:, 0] == pytest.approx(np.arange(101, 110)) and motion[:, 1] == pytest.approx(
        10.0
    )
    assert pose[:, 0] == pytest.approx(np.arange(98.5, 107.0))
    assert terms == pytest.approx([0.0, 0.0, 0.3, 0.0, 0.0])


def test_at_the_horizon_the_value_of_the_state_there_is_added() -> None:
    """5 m/s below the limit: 25 / 78 s."""
    terms = driven(lasting(0.0, 0, 10), view(), Q._replace(horizon=1.0))[2]
    assert terms[PASSABILITY] == pytest.approx(1.0 / 3.0 + 25.0 / 78.0)


def test_a_lane_change_has_its_cost_and_what_cannot_begin_ends_it() -> None:
    steps, end, terms, *_ = driven(lasting(0.0, 1, 5), view())
    assert (steps, end) == (5, ALIVE) and terms[OTHER] == pytest.approx(0.6)
    line = lasting(0.0, 0, 5)
    line[3, 1] = 1.0
    p, local, state = view(899.0 - 10.0)  # too near to the end of the lane by then
    assert driven(line, (p, local, state))[:2] == (3, IMPOSSIBLE)


def test_a_sequence_over_a_red_line_ends_there() -> None:
    p, local, state = view(195.0, 12.0, light=True)
    local.closed[:] = 1
    steps, end, terms, *_ = driven(lasting(0.0, 0, 9), (p, local, state))
    assert (steps, end) == (5, LOST) and 160.0 < terms[LOSS] < 172.0
    assert terms[SAFETY] == 0.0


def test_a_sequence_has_all_terms(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each step costs 1, 2, 3 and 4; at the end there are 5 and 6 more."""
    asked: list[float] = []

    def may(*those: Any) -> bool:
        asked.append(those[7])
        return True

    def fake(*those: Any) -> ply.Ply:
        return ply.Ply(those[4], ALONE, 1.0, 2.0, 3.0, 4.0, ALIVE, 0.0)

    monkeypatch.setattr(ply, "simulate", fake)
    monkeypatch.setattr(ply, "may_change", may)
    monkeypatch.setattr(ply, "terminal", lambda *_: 5.0)
    monkeypatch.setattr(ply, "unfinished", lambda *_: 6.0)
    line = lasting(1.0, 0, 10)
    line[4, 1] = -1.0
    terms = driven(line, view(), Q._replace(horizon=1.0))[2]
    assert terms == pytest.approx([10.0, 20.0, 30.0 + 11.0, 40.0 + 0.6, 0.0])
    assert asked == [pytest.approx(0.4)]
    short = driven(line[:9], view(), Q._replace(horizon=1.0))[2]
    assert short[PASSABILITY] == pytest.approx(27.0)


def test_a_lane_of_the_oncoming_is_changed_to_soon_or_not_at_all() -> None:
    p, local, state = view()
    node = local.node.copy()
    node[2, HOME] = 1.0
    local = local._replace(node=node)
    for time, side, may in ((1.9, 1, True), (2.1, 1, False), (2.1, -1, True), (3.9, 1, False)):
        assert may_change(local, p, C, state, NO_OTHERS, side, 0.0, time) == may


@pytest.mark.parametrize(
    ("v", "accel", "may"), [(10.0, 0.0, True), (10.0, -2.0, True), (1.9, 0.0, False), (1.9, 1.0, True), (1.9, -1.0, False), (2.1, -1.0, True)]
)  # fmt: skip
def test_a_slow_ego_drives_off_to_change_lanes(v: float, accel: float, may: bool) -> None:
    p, local, state = view(v=v)
    for side in (1, -1):
        assert may_change(local, p, C, state, NO_OTHERS, side, accel, 0.0) == may
    assert not may_change(local, p, C, state._replace(node=2), NO_OTHERS, 1, accel, 0.0)


def test_a_change_needs_a_free_place_at_the_time_that_it_begins() -> None:
    """Somebody is beside the ego on the left lane; later nobody is."""
    road = lanes_east(3, 900.0)
    ego = ego_at(road, "a_1", 100.0, 10.0)
    task = task_of(road, ego)
    local, state = local_of(task, scene_of(ego, road, Agent("x", "a_2", 102.0, 10.0)))
    local.agent[5:, 0, 5] = -1.0  # NODE: off the road after a second
    local.bounds[5:] = 1e6
    assert [
        may_change(local, task.ego, C, state, NO_OTHERS, side, 0.0, time)
        for side, time in ((1, 0.0), (-1, 0.0), (1, 1.0))
    ] == [False, True, True]


# --- the tree policy of `mcts`, on lowest costs ---


def planted(*children: tuple[int, float], more: int = 0, levels: int = 2) -> tree.Tree:
    """A root with children (visits, lowest J below)."""
    made = tree.new_tree(12, len(children) + more, levels, np.zeros((0, 2)))
    made.used[0] = 1
    for k, (visits, best) in enumerate(children):
        add(made, 0, k, visits, best)
    made.visits[0] = sum(visits for visits, _ in children)
    made.best[0] = min(best for _, best in children)
    return made


def add(made: tree.Tree, node: int, k: int, visits: int, best: float) -> int:
    i = int(made.used[0])
    made.used[0] += 1
    made.child[node, k], made.parent[i], made.level[i] = i, node, made.level[node] + 1
    made.visits[i], made.best[i] = visits, best
    return i


@pytest.mark.parametrize(("exploration", "chosen"), [(0.0, 1), (0.5, 1), (1.06, 1), (1.07, 3), (3.0, 3)])  # fmt: skip
def test_the_upper_confidence_bound_on_lowest_costs(exploration: float, chosen: int) -> None:
    """J of 2, 6 and 12 are 0, -0.4 and -1 between the lowest and the highest. After 10, 5 and 2
    visits sqrt(2 ln 18 / n) is 0.760, 1.075 and 1.700: the third overtakes the first at 1.064."""
    made = planted((10, 2.0), (5, 6.0), (2, 12.0))
    assert math.sqrt(2.0 * math.log(18.0) / 2.0) == pytest.approx(1.700, abs=1e-3)
    q = Q._replace(exploration=exploration, look_ahead=1)
    assert select(made, C, q, math.inf) == chosen
    made.best[-2], made.visits[-2] = -9.0, 1  # where a careless index would lead
    made.child[0, chosen - 1] = IMPOSSIBLE
    assert select(made, C, q, math.inf) not in (chosen, IMPOSSIBLE)


def test_values_are_scaled_by_the_open_children_of_the_root_and_by_one_at_least() -> None:
    """J of 2 and 2.1: 0 and -0.1, since the scale is 1; a lost one of 70 makes it 0 and -0.0015."""
    q = Q._replace(exploration=0.05, look_ahead=1)
    bonus = [math.sqrt(2.0 * math.log(10.0) / n) for n in (7, 2)]
    assert 0.0015 < 0.05 * (bonus[1] - bonus[0]) < 0.1
    assert select(planted((7, 2.0), (2, 2.1)), C, q, math.inf) == 1
    wide = planted((6, 2.0), (2, 2.1), (1, 70.0))
    q = q._replace(exploration=0.02)
    assert select(wide, C, q, math.inf) == 2
    wide.closed[3] = True
    assert select(wide, C, q, math.inf) == 1


def test_below_the_root_the_parents_visits_count_and_an_untried_action_comes_first() -> None:
    made = planted((9, 2.0), (1, 30.0))
    for k, (visits, best) in enumerate([(5, 2.0), (3, 9.0)]):
        add(made, 1, k, visits, best)
    q = Q._replace(exploration=0.0)
    assert select(made, C, q, math.inf) == 3
    bonus = [math.sqrt(2.0 * math.log(10.0) / n) for n in (5, 3)]
    border = 7.0 / 28.0 / (bonus[1] - bonus[0])
    for exploration, chosen in ((0.99 * border, 3), (1.01 * border, 4)):
        made.visits[0] = 10_000  # of the root; it has no part in this, nor on its second child
        made.closed[2] = False
        made.visits[2] = 10_000
        assert select(made, C, q._replace(exploration=exploration), math.inf) == chosen
    made.child[1, 1] = NONE
    assert select(made, C, q, math.inf) == 1
    made.closed[1] = True
    made.child[2, :] = NONE
    assert select(made, C, q, math.inf) == 2


@pytest.mark.parametrize(
    ("adaptive", "best", "beat", "cost", "pruned"),
    [
        (True, 5.0, math.inf, 5.0, True),
        (True, 5.0, math.inf, 4.9, False),
        (False, 5.0, math.inf, 9.0, False),
        (True, 5.0, 3.0, 4.0, True),  # a better one is known without the tree
        (True, 31.0, math.inf, 40.0, False),  # even the best may be lost: from half a contact on
        (True, 29.0, math.inf, 40.0, True),
    ],
)
def test_what_costs_more_than_the_best_is_left_out(
    adaptive: bool, best: float, beat: float, cost: float, pruned: bool
) -> None:
    made = planted((4, best), (2, best + 8.0))
    q = Q._replace(adaptive=adaptive)
    assert plain(search._is_pruned)(made, C, q, 2, cost, beat) == pruned
    if best < 20.0 and adaptive:  # where each counts, it is the best of its own root action
        below = add(made, 2, 0, 1, 15.0)
        one = q._replace(each=True)
        assert not plain(search._is_pruned)(made, C, one, below, best + 7.9, beat)
        assert plain(search._is_pruned)(made, C, one, below, best + 8.0, beat)


def test_backing_up_counts_visits_and_keeps_the_lowest() -> None:
    made = tree.new_tree(6, 2, 3, np.zeros((0, 2)))
    made.used[0] = 1
    actions = np.array([[-1.0, 0.0, 1.0], [2.0, 1.0, 1.0]])
    a, b = (add(made, 0, k, 0, math.inf) for k in (0, 1))
    c = add(made, b, 0, 0, math.inf)
    line = np.full((3, 3), np.nan)
    line[2] = 0.5, -1.0, NO_SPEED
    for node, j in ((a, 7.0), (c, 5.0), (c, 9.0), (b, 6.0)):
        plain(tree.back_up)(made, actions, node, j, line)
    assert made.visits[:4].tolist() == [4, 1, 3, 2]
    assert made.total[:4].tolist() == [27.0, 7.0, 20.0, 14.0]
    assert made.best[:4].tolist() == [5.0, 7.0, 5.0, 5.0]
    assert made.plan[1].tolist() == [[2.0, 1.0, -1.0], [-1.0, 0.0, -1.0], [0.5, -1.0, -1.0]]
    assert made.plan[0, 0].tolist() == [-1.0, 0.0, -1.0]


def test_a_branch_closes_when_nothing_below_is_open() -> None:
    made = planted((1, 1.0), (1, 2.0))
    a, b = (add(made, 1, k, 1, 1.0) for k in (0, 1))
    plain(tree.close_branch)(made, a)
    assert made.closed[:5].tolist() == [False, False, False, True, False]
    plain(tree.close_branch)(made, b)
    assert made.closed[:5].tolist() == [False, True, False, True, True]
    made.child[2] = IMPOSSIBLE, IMPOSSIBLE
    plain(tree.close_branch)(made, 2)
    assert made.closed[:5].all()
    made.child[2, 1] = NONE
    assert not plain(tree.is_exhausted)(made, 2)


# --- rollouts of `mcts` ---


def test_continuations_are_tried_one_after_the_other() -> None:
    """From level 1 of 5: follow, brake, slow down, and then by turns for each level."""
    made, q = planted((0, 1.0)), Q._replace(adaptive=True)
    found = []
    for visits in range(11):
        made.visits[1] = visits
        found.append(continuation(made, q, 1, np.random.default_rng(1)))
    f, b, s, t, u, c = range(6)
    assert found[:3] == [(f, 5, 0), (b, 5, 0), (s, 5, 0)]
    assert found[3:7] == [(u, 1, 0), (t, 1, 0), (c, 1, -1), (c, 1, 1)]
    assert found[7:] == [(u, 2, 0), (t, 2, 0), (c, 2, -1), (c, 2, 1)]


def test_otherwise_they_are_drawn_each_as_often() -> None:
    made, rng = planted((9, 1.0)), np.random.default_rng(4)
    found = [continuation(made, Q, 1, rng) for _ in range(4000)]
    for policy in range(1, 6):
        assert abs(sum(each[0] == policy for each in found) - 800) < 5.0 * 25.3
    turns = [turn for policy, turn, _ in found if policy >= 3]
    assert all(turn == 5 for policy, turn, _ in found if policy < 3)
    assert all(abs(turns.count(k) - 600) < 5.0 * 22.6 for k in (1, 2, 3, 4)) and max(turns) == 4
    sides = [side for policy, _, side in found if policy == 5]
    assert abs(sides.count(1) - 400) < 100 and set(sides) == {-1, 1}
    assert all(side == 0 for policy, _, side in found if policy < 5)


@pytest.mark.parametrize(
    ("policy", "turn", "side", "accels"),
    [
        (0, 5, 0, [FOLLOW] * 4),
        (1, 5, 0, [-2.0] * 4),
        (2, 5, 0, [-1.0, FOLLOW, FOLLOW, FOLLOW]),
        (3, 3, 0, [FOLLOW, FOLLOW, -2.0, -2.0]),
        (4, 2, 0, [2.6, 2.6, FOLLOW, FOLLOW]),
        (5, 2, 1, [FOLLOW, 2.6, 2.6, FOLLOW]),
    ],
)
def test_what_a_rollout_does(
    policy: int, turn: int, side: int, accels: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """From level 1 of 5, four plies of 6 steps, with 1 + 2 + 3 + 4 for each; what was spent before
    is 100; a lane change costs 0.6."""
    p, local, state = view()
    made, asked = planted((1, 1.0), levels=5), []
    tree.keep_state(made.where, made.motion, 1, state)
    made.cost[1] = 10.0, 20.0, 30.0, 40.0

    def fake(*those: Any) -> ply.Ply:
        asked.append((those[7].accel, those[7].side, those[8]))
        return ply.Ply(those[4], ALONE, 1.0, 2.0, 3.0, 4.0, ends[len(asked) - 1], 50.0)

    monkeypatch.setattr(search, "simulate", fake)
    monkeypatch.setattr(search, "_continuation", lambda *_: (policy, turn, side))
    times: list[float] = []
    monkeypatch.setattr(search, "may_change", lambda *those: times.append(those[7]) or True)
    monkeypatch.setattr(search, "terminal", lambda *_: 0.25)
    monkeypatch.setattr(search, "unfinished", lambda *_: 0.5)
    rollout, rng, line = plain(search._rollout), np.random.default_rng(1), np.zeros((5, 3))
    change = 0.6 if side else 0.0
    for ends, j in (
        ([ALIVE] * 4, 140.75 + change),
        ([ALIVE, LOST], 170.0 + change),
        ([ALIVE, ARRIVED], 120.0 + change),
    ):
        asked.clear()
        made.continued.begin[1] = NOT_DRIVEN
        assert rollout(made, local, p, C, Q, 1, line, rng) == pytest.approx(j)
        assert [accel for accel, _, _ in asked] == accels[: len(ends)]
        assert [s for _, s, _ in asked] == [
            side if k == turn else 0 for k in range(1, 1 + len(ends))
        ]
        assert [at for *_, at in asked] == [6, 12, 18, 24][: len(ends)]
    assert times == ([pytest.approx(1.2)] * len(times)) and bool(times) == bool(side)
    assert np.isnan(line[0, 0]) and line[1:3, 0].tolist() == accels[:2]
