"""Planner `mcts` around and below its tree: how passes add up, how long they go on, what a rollout
does in a lane of oncoming traffic, how an action ends."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers import ego_at
from helpers_model import lanes_east, local_of, plain, scenario, scene_of, situation_of, task_of

from sumo_mcts.driver.params import cost_params
from sumo_mcts.model.interaction import Neighbours
from sumo_mcts.model.local_map import State
from sumo_mcts.model.motion import OFF_END, RED_LINE
from sumo_mcts.planners import mcts, ply, search, tree
from sumo_mcts.planners.actions import (
    FOLLOW,
    NO_SPEED,
    Action,
    commanded,
    lasting,
    lines_of,
    packed,
    to_steps,
)
from sumo_mcts.planners.base import Situation
from sumo_mcts.planners.budget import Timekeeper
from sumo_mcts.planners.candidates import Candidate, follow_line
from sumo_mcts.planners.continued import NOT_DRIVEN
from sumo_mcts.planners.mcts import MctsPlanner, in_steps, mcts_params
from sumo_mcts.planners.ply import ALIVE, LOST, SearchParams, change_price, search_params
from sumo_mcts.scene import Plan, RootChild

C = cost_params(scenario())
Q = SearchParams(6, 2, 1, 2, 3, 0.5, 8.0, adaptive=False, each=False)
ALONE = Neighbours(math.inf, 0.0, 0)
ROAD = lanes_east(3, 900.0)
EGO = ego_at(ROAD, "a_1", 100.0, 10.0)
TASK = task_of(ROAD, EGO)


def seen() -> Situation:
    return situation_of(TASK, scene_of(EGO, ROAD), seconds=1.0)


def planner(*sets: str) -> MctsPlanner:
    found = MctsPlanner(mcts_params(scenario(*sets)))
    found.start(TASK, 1)
    return found


def candidates(*costs: float) -> list[Candidate]:
    plan = Plan(np.ones(2), np.ones(2), np.zeros(2, np.int32), np.ones(2), np.ones((2, 4)))
    return [
        Candidate(RootChild(0.0, 0, 1, j, j, np.zeros(5), plan.pose), plan, lasting(0.0, 0, 1))
        for j in costs
    ]


# --- a decision ---


def test_passes_of_all_hypotheses_add_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three of them: 5 and 2 in the likeliest, 7 and 3 in each of the others."""
    mind, situation = planner(), seen()
    made = iter([(5, 2), (7, 3), (7, 3)])
    fake = SimpleNamespace(leader=np.full((1, 3), 50.0), others=np.zeros((1, 0, 2)))
    local = mind._locals(situation, 1)[0]
    monkeypatch.setattr(mind, "_search", lambda *_: mcts.Searched(fake, *next(made)))
    monkeypatch.setattr(mind, "_locals", lambda _, count: [local] * count)
    monkeypatch.setattr(mcts, "shares", lambda *_: np.array([0.5, 0.3, 0.2]))
    monkeypatch.setattr(mcts, "root_candidates", lambda *_: candidates(3.0, 1.0))
    monkeypatch.setattr(mcts, "costs_in", lambda *_: (np.zeros(2), np.zeros((2, 5))))
    monkeypatch.setattr(mcts, "warm_start", lambda *_: None)
    weighed = situation._replace(
        forecast=situation.forecast._replace(weight=np.array([0.5, 0.3, 0.2]))
    )
    decision = mind.plan(weighed)
    assert (decision.iterations, decision.known) == (5 + 7 + 7, 2 + 3 + 3)
    assert [each.best for each in decision.children] == pytest.approx([1.5, 0.5])
    made = iter([(5, 2)])
    monkeypatch.setattr(mcts, "shares", lambda *_: np.ones(1))
    alone = mind.plan(weighed)
    assert (alone.iterations, alone.known) == (5, 2)
    assert [each.best for each in alone.children] == [3.0, 1.0]


def test_of_the_last_plan_as_much_is_carried_on_as_the_horizon_has_steps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mind, given = planner("planner.iterations=20"), []
    mind._last_line, mind._last_time = packed(lasting(0.5, 0, 500)), -0.1
    monkeypatch.setattr(mcts, "warm_start", lambda _, line, __: given.append(line))
    mind.plan(seen())
    p = mind._params
    steps = (p.look_ahead_steps + p.rollout_steps) * round(p.step_s / 0.1)
    assert given[0].shape == (steps, 3)
    mind._last_line, mind._last_time = packed(lasting(0.5, 0, 4)), -0.1
    mind.plan(seen())  # the second of its steps is the first one left
    assert given[1][:, 0].tolist() == [0.5] * 3 + [FOLLOW] * (steps - 3)


def test_a_tree_has_room_for_the_passes_of_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """A quarter of 8 s; without a time budget a quarter of the passes."""
    mind, situation, asked = planner("planner.iterations=400"), seen(), []

    def passes(most: int, seconds: float) -> int:
        asked.append((most, seconds))
        return 30

    monkeypatch.setattr(mcts, "passes_within", passes)
    monkeypatch.setattr(mcts.time, "perf_counter", lambda: 1000.0)
    monkeypatch.setattr(mcts, "_count", lambda *_: 0)
    local = mind._locals(situation, 1)[0]
    q = in_steps(mind._params, 0.1, 0.2)
    for until, seconds in ((1008.0, 2.0), (math.inf, math.inf)):
        share = np.array([0.25, 0.75])
        made, *_ = mind._search(local, q, situation._replace(until=until), share, math.inf)
        assert asked[-1] == (mind._params.budget.most // 4, seconds)
        assert len(made.parent) == 32 and made.plan.shape[:2] == (
            len(mind._actions),
            mind._params.look_ahead_steps + mind._params.rollout_steps,
        )


# --- the tree ---


@pytest.mark.parametrize(("exploration", "chosen"), [(0.29, 1), (0.32, 2)])
def test_costs_that_differ_by_less_than_one_are_scaled_by_one(
    exploration: float, chosen: int
) -> None:
    """2 and 2.5, visited 9 times and once: the second is better from 0.304 on."""
    grown = tree.new_tree(6, 2, 3, np.zeros((0, 2)))
    grown.child[0] = 1, 2
    grown.level[1:3], grown.visits[:3], grown.best[:3] = 1, (20, 9, 1), (2.0, 2.0, 2.5)
    q = Q._replace(look_ahead=1, exploration=exploration)
    assert plain(search._select)(grown, C, q, math.inf) == chosen


@pytest.mark.parametrize(("exploration", "chosen"), [(0.58, 2), (0.63, 3)])
def test_further_down_what_costs_more_than_that_scale_counts_as_its_end(
    exploration: float, chosen: int
) -> None:
    """Below the only child one costs 2 and one 50, visited 9 times and once."""
    grown = tree.new_tree(6, 2, 3, np.zeros((0, 2)))
    grown.child[0], grown.child[1] = (1, ply.IMPOSSIBLE), (2, 3)
    grown.level[1:4], grown.visits[:4] = (1, 2, 2), (20, 20, 9, 1)
    grown.best[:4] = 2.0, 2.0, 2.0, 50.0
    q = Q._replace(look_ahead=2, exploration=exploration)
    assert plain(search._select)(grown, C, q, math.inf) == chosen


@pytest.mark.parametrize("a", [-2.0, 0.0, 1.5])
def test_a_state_is_known_by_its_own_acceleration(a: float) -> None:
    made = tree.new_tree(3, 2, 2, np.zeros((0, 2)))
    state = local_of(TASK, scene_of(EGO, ROAD))[1]._replace(a=a)
    tree.store(made, 1, state, ALONE)
    made.child[0, 0] = 1
    known = plain(tree.is_known)
    assert known(made, 0, 1, state) and not known(made, 0, 1, state._replace(a=a + 0.1))
    assert not known(made, 0, 1, state._replace(a=-a - 0.1))


@pytest.mark.parametrize(("policy", "accel"), [(0, 2.6), (2, FOLLOW), (3, FOLLOW), (4, FOLLOW)])
def test_only_who_follows_pushes_on_in_a_lane_of_oncoming_traffic(
    policy: int, accel: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On the last of three levels, which no policy turns at."""
    local, state = local_of(TASK, scene_of(EGO, ROAD))
    made, asked = tree.new_tree(3, 2, 3, np.zeros((0, 2))), []
    tree.store(made, 0, state, ALONE)

    def simulated(*those: Any) -> ply.Ply:
        asked.append(those[7].accel)
        return ply.Ply(those[4], ALONE, 0.0, 0.0, 0.0, 0.0, ALIVE, 0.0)

    turn = 9 if policy in (2, 3) else 0
    monkeypatch.setattr(search, "simulate", simulated)
    monkeypatch.setattr(search, "_continuation", lambda *_: (policy, turn, 0))
    monkeypatch.setattr(search, "is_against", lambda *_: 1.0)
    q, line = Q._replace(look_ahead=1, rollout=2), np.zeros((3, 3))
    plain(search._rollout)(made, local, TASK.ego, C, q, 0, line, np.random.default_rng(1))
    assert asked[2] == accel
    made.continued.begin[0] = NOT_DRIVEN
    monkeypatch.setattr(search, "is_against", lambda *_: 0.0)
    plain(search._rollout)(made, local, TASK.ego, C, q, 0, line, np.random.default_rng(1))
    assert asked[5] == FOLLOW


def test_a_rollout_moves_the_agents_that_react_from_where_its_node_has_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The pass before has left other numbers behind; the node keeps its own."""
    local, state = local_of(TASK, scene_of(EGO, ROAD))
    made, asked = tree.new_tree(3, 2, 3, np.array([[1.0, 2.0]])), []
    tree.store(made, 1, state, ALONE)
    made.others[1], made.moving[:] = (5.0, 6.0), 99.0

    def simulated(*those: Any) -> ply.Ply:
        asked.append(those[5][0].tolist())
        those[5][:] += 1.0
        return ply.Ply(those[4], ALONE, 0.0, 0.0, 0.0, 0.0, ALIVE, 0.0)

    monkeypatch.setattr(search, "simulate", simulated)
    q, line = Q._replace(look_ahead=1, rollout=1), np.zeros((3, 3))
    for _ in range(2):
        made.continued.begin[1] = NOT_DRIVEN
        plain(search._rollout)(made, local, TASK.ego, C, q, 1, line, np.random.default_rng(1))
    assert asked[0] == asked[len(asked) // 2] == [5.0, 6.0]
    assert made.others[1].tolist() == [[5.0, 6.0]]


@pytest.mark.parametrize(
    ("to_side", "asked"), [(1, [(1, math.inf), (-1, 0.0)]), (0, [(-1, 0.0)] * 2)]
)
def test_in_a_rollout_the_route_changes_only_where_it_costs_nobody_anything(
    to_side: int, asked: list[tuple[int, float]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A change that was drawn, for the first of two plies, may cost what it takes."""
    local, state = local_of(TASK, scene_of(EGO, ROAD))
    made, found = tree.new_tree(3, 2, 2, np.zeros((0, 2))), []
    tree.store(made, 0, state, ALONE)

    def may_change(*those: Any) -> bool:
        found.append((those[5], those[8]))
        return False

    kept = ply.Ply(state, ALONE, 0.0, 0.0, 0.0, 0.0, ALIVE, 0.0)
    monkeypatch.setattr(search, "simulate", lambda *_: kept)
    monkeypatch.setattr(search, "may_change", may_change)
    monkeypatch.setattr(search, "needed_side", lambda *_: -1)
    monkeypatch.setattr(search, "_continuation", lambda *_: (5, 0, to_side))
    q, line = Q._replace(look_ahead=0, rollout=2), np.zeros((2, 3))
    plain(search._rollout)(made, local, TASK.ego, C, q, 0, line, np.random.default_rng(1))
    assert found == asked and not line[:, 1].any()


def test_each_root_action_keeps_the_first_of_its_best_sequences() -> None:
    """One that is as cheap does not replace it, and those of others stay as they are."""
    made = tree.new_tree(5, 3, 3, np.zeros((0, 2)))
    actions = np.array([(1.0, 0.0, 1.0), (2.0, 1.0, 1.0), (3.0, -1.0, 1.0)])
    made.child[0, :2], made.child[1, 1] = (1, 2), 3
    made.parent[1:4], made.level[1:4] = (0, 0, 1), (1, 1, 2)

    def back_up(node: int, j: float, mark: float) -> list[float]:
        line = np.full((3, 3), np.nan)
        line[made.level[node] :] = mark
        plain(tree.back_up)(made, actions, node, j, line)
        return made.plan[0, :, 0].tolist()

    assert back_up(1, 9.0, 7.0) == [1.0, 7.0, 7.0]
    assert back_up(1, 9.0, 8.0) == [1.0, 7.0, 7.0]
    assert back_up(3, 8.0, 6.0) == [1.0, 2.0, 6.0]
    assert back_up(3, 8.0, 5.0) == [1.0, 2.0, 6.0] and back_up(1, 8.5, 4.0) == [1.0, 2.0, 6.0]
    assert made.plan[0, :, 1].tolist()[:2] == [0.0, 1.0] and np.isnan(made.plan[1:]).all()
    assert (made.best[0], made.visits[0], made.total[0]) == (8.0, 5, 42.5)
    made.best[2] = 5.0  # what was known of it before its first visit, as of one that ended
    plain(tree.back_up)(made, actions, 2, 5.0, np.full((3, 3), np.nan))
    assert made.plan[1, 0, 0] == 2.0


def test_known_ends_and_rollouts_are_counted_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first action ends in a contact, the second does not: two passes are two."""
    local, state = local_of(TASK, scene_of(EGO, ROAD))
    made, ends = tree.new_tree(9, 2, 5, np.zeros((0, 2))), iter([LOST, ALIVE, ALIVE, ALIVE])
    tree.store(made, 0, state, ALONE)
    made.used[0] = 1

    def simulated(*those: Any) -> ply.Ply:
        after = those[4]._replace(s=those[4].s + those[7].accel)
        return ply.Ply(after, ALONE, 1.0, 0.0, 0.0, 0.0, next(ends), 50.0)

    monkeypatch.setattr(search, "simulate", simulated)
    monkeypatch.setattr(search, "_rollout", lambda *_: 20.0)
    actions = np.array([(1.0, 0.0, 1.0), (2.0, 0.0, 1.0)])
    rng = np.random.default_rng(1)
    found = plain(search.search)(made, local, TASK.ego, C, Q, actions, state, 2, math.inf, rng)
    assert found == (1, 1) and made.visits[:3].tolist() == [2, 1, 1]


# --- one action ---


@pytest.mark.parametrize(
    ("event", "loss"),
    [(OFF_END, 60.0 - 30.0 * 0.4 / 8.0 + 10.0), (RED_LINE, 60.0 - 1.5 + 4.0 + 100.0)],
)
def test_off_the_end_of_a_road_the_speed_before_counts_at_a_red_line_the_one_after(
    event: int, loss: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From 10 to 4 m/s in the step that begins after 0.4 s."""
    local, state = local_of(TASK, scene_of(EGO, ROAD))
    usual = ply.advance

    def advanced(local: Any, p: Any, state: State, accel: float, time: float) -> tuple[State, int]:
        after, usually = usual(local, p, state, accel, time)
        return (after._replace(v=4.0), event) if time > 0.35 else (after, usually)

    monkeypatch.setattr(ply, "advance", plain(advanced))
    keeps = Action(0.0, 0, NO_SPEED)
    found = plain(ply.simulate)(local, TASK.ego, C, Q, state, np.zeros((0, 2)), ALONE, keeps, 0)
    assert (found.end, found.loss) == (LOST, pytest.approx(loss))


def test_a_commanded_speed_is_driven_whatever_an_action_says() -> None:
    local, state = local_of(TASK, scene_of(EGO, ROAD))
    q = search_params(0.1, 0.2, 1.0, 0.2, 6, 2, 0.5, adaptive=True)
    speeds = 10.0 - 0.05 * np.arange(1, 31)
    plan, _, end = follow_line(local, TASK, q, state, np.zeros((0, 2)), commanded(speeds, 0))
    assert end == ALIVE and plan.v == pytest.approx(speeds)
    free = follow_line(local, TASK, q, state, np.zeros((0, 2)), lasting(FOLLOW, 0, 30))[0]
    assert free.v[-1] > 11.0


def test_contacts_are_looked_for_once_a_step_at_least() -> None:
    for check_s, check in ((0.01, 1), (0.1, 1), (0.26, 3), (0.5, 5)):
        assert search_params(0.1, 0.2, 1.0, check_s, 6, 2, 0.5, adaptive=True).check == check
    assert search_params(0.1, 0.2, 0.01, 0.2, 6, 2, 0.5, adaptive=True).ply == 1


def test_giving_up_a_change_costs_a_third_of_a_contact() -> None:
    state = local_of(TASK, scene_of(EGO, ROAD))[1]
    assert change_price(C, state) == C.lane_change == 0.6
    assert change_price(C, state._replace(progress=0.01)) == pytest.approx(20.0)


@pytest.mark.parametrize("possible", [True, False])
def test_a_change_is_given_up_now_where_that_is_possible(
    possible: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    local, state = local_of(TASK, scene_of(EGO, ROAD))
    monkeypatch.setattr(ply, "can_change", lambda *_: possible)
    for time in (0.0, 1.0):
        found = plain(ply.may_change)(
            local, TASK.ego, C, state._replace(progress=0.3), np.zeros((0, 2)), -1, 0.0, time
        )
        assert found is (possible and time == 0.0)


def test_a_sequence_begins_among_those_that_are_there_now(monkeypatch: pytest.MonkeyPatch) -> None:
    local, state = local_of(TASK, scene_of(EGO, ROAD))
    looks, usual, none = [], ply.meet, np.zeros((0, 2))

    def meet(*those: Any) -> Any:
        looks.append(those[6])
        return plain(usual)(*those)

    monkeypatch.setattr(ply, "meet", meet)
    lines = lines_of([lasting(0.0, 0, 3)])
    driven = ply.Driven(
        np.zeros((1, 3), np.int64), np.zeros((1, 3, 2)), np.zeros((1, 3, 4)), np.zeros((1, 5)),
        np.zeros(1, np.int64), np.zeros(1, np.int64), none,
    )  # fmt: skip
    replayed = plain(ply._driven_again)
    assert replayed(local, TASK.ego, C, Q, state, lines, driven, 0) == (3, ALIVE)
    assert looks[0] == 0


def test_at_most_half_of_the_time_is_kept_free() -> None:
    keeper = Timekeeper(2.0)
    assert keeper.until(10.0) == pytest.approx(11.5)  # a quarter before anything is known
    keeper.note(11.5, 11.4)
    assert keeper.until(10.0) == pytest.approx(11.5)
    keeper.note(11.5, 11.7)
    assert keeper.until(10.0) == pytest.approx(12.0 - 1.25 * 0.2)
    keeper.note(11.5, 14.0)
    assert keeper.until(10.0) == pytest.approx(11.0)


def test_actions_that_last_are_written_out_step_by_step() -> None:
    line = np.array([(1.0, -1.0, NO_SPEED), (2.0, 1.0, NO_SPEED), (3.0, 1.0, 5.0)])
    rows = to_steps(line, 2)
    assert rows[:, 0].tolist() == [1.0, 1.0, 2.0, 2.0, 3.0, 3.0]
    assert rows[:, 1].tolist() == [-1.0, 0.0, 1.0, 0.0, 1.0, 0.0]
    assert rows[:, 2].tolist() == [NO_SPEED] * 4 + [5.0] * 2
    uneven = to_steps(line, np.array([1, 3, 2]))
    assert uneven[:, 1].tolist() == [-1.0, 1.0, 0.0, 0.0, 1.0, 0.0]
    both = lines_of([line, line[:1]])
    assert both.steps.tolist() == [3, 1] and both.actions.shape == (2, 3, 3)
    assert np.isnan(both.actions[1, 1:]).all() and lines_of([]).actions.shape == (0, 0, 3)
