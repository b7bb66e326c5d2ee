"""The candidates of a decision, worked out by hand: what a root child becomes, when the last plan is
carried on, what a candidate costs in another hypothesis, when room is asked for."""

import math
from typing import Any

import numpy as np
import pytest
from helpers import Agent, ego_at
from helpers_model import lanes_east, local_of, scene_of, task_of

from sumo_mcts.model.local_map import MOTION_V
from sumo_mcts.planners import candidates
from sumo_mcts.planners.actions import ACCEL, FOLLOW, NO_SPEED, SIDE, lasting, lines_of
from sumo_mcts.planners.candidates import (
    Candidate,
    Start,
    _best_lines,
    _first_accel,
    _hardest,
    _nearest_actions,
    asked_side,
    costs_in,
    follow_line,
    not_for_a_stop,
    root_candidates,
    warm_start,
)
from sumo_mcts.planners.ply import ALIVE, ARRIVED, IMPOSSIBLE, LOST, Driven, search_params
from sumo_mcts.planners.tree import Tree, new_tree
from sumo_mcts.scene import LOSS, PASSABILITY, Plan, RootChild, Stop

ROAD = lanes_east(3, 900.0)
# acceleration, side, whether it is tried below the root
ACTIONS = np.array(
    [(FOLLOW, 0.0, 1.0), (-2.0, 0.0, 1.0), (1.0, 1.0, 0.0), (0.5, 1.0, 0.0), (1.0, -1.0, 1.0)]
)
NAN = math.nan


def start(*cars: Agent, name: str = "a_1", v: float = 10.0, stop: Stop | None = None) -> Start:
    """Actions of 1 s, steps of 0.1 s, a horizon of 8 s."""
    ego = ego_at(ROAD, name, 100.0, v)
    task = task_of(ROAD, ego if stop is None else ego._replace(stop=stop))
    local, state = local_of(task, scene_of(ego, ROAD, *cars))
    q = search_params(task.ego.step, 0.2, 1.0, 0.2, 6, 2, 0.5, adaptive=True)
    return Start(local, task, q, state, np.zeros((0, 2)))


def grown(*tried: int, levels: int = 3) -> Tree:
    """A tree whose root has children by these actions, numbered 1, 2 .. in this order."""
    tree = new_tree(9, len(ACTIONS), levels, np.zeros((0, 2)))
    for i, k in enumerate(tried, 1):
        tree.child[0, k], tree.level[i] = i, 1
        tree.plan[k, 0] = *ACTIONS[k, :2], NO_SPEED
    return tree


# --- root children ---


def test_each_tried_action_is_a_candidate_with_its_numbers() -> None:
    begun, tree = start(), grown(4, 0, 1)
    tree.visits[1:4], tree.total[1:4], tree.best[1:4] = (4, 0, 5), (20.0, 3.0, 5.0), (2.5, 3.0, 0.5)
    found = root_candidates(begun, tree, ACTIONS)
    children = [each.child for each in found]
    assert [(c.lane_change, c.visits, c.mean, c.best) for c in children] == [
        (0, 0, 3.0, 3.0), (0, 5, 1.0, 0.5), (-1, 4, 5.0, 2.5),
    ]  # fmt: skip
    assert children[1].accel == -2.0 and children[2].accel == 1.0
    for each in found:
        plan, terms, end = follow_line(*begun, each.line)
        assert end == ALIVE and np.array_equal(each.child.terms, terms)
        assert np.array_equal(each.plan.pose, plan.pose) and each.child.poses is each.plan.pose
        assert each.plan.time == pytest.approx(0.1 * np.arange(1, 11))
    # what following came to within the first second
    assert children[0].accel == pytest.approx(found[0].plan.v[9] - 10.0) and children[0].accel > 0.5


def test_the_best_sequence_step_by_step() -> None:
    """Two actions are known behind the first, one of which changes lanes; a third is not."""
    tree = grown(1, 2, 4, levels=4)
    tree.plan[1, :3] = (NAN, NAN, NAN), (3.0, 1.0, NO_SPEED), (4.0, 0.0, NO_SPEED)
    tree.plan[4] = (
        (-9.0, 1.0, NO_SPEED),
        (3.0, 0.0, NO_SPEED),
        (2.0, 0.0, NO_SPEED),
        (1.0, 0.0, -1.0),
    )
    tree.plan[2, 1] = (7.0, 0.0, NO_SPEED)
    tree.end[2] = LOST  # where the action ends the drive, nothing follows it
    lines = _best_lines(start(), tree, ACTIONS, np.array([1, 2, 4]))
    assert lines.steps.tolist() == [30, 10, 40]
    row = lines.actions[0]
    assert row[:30, ACCEL].tolist() == [-2.0] * 10 + [3.0] * 10 + [4.0] * 10
    assert np.isnan(row[30:, ACCEL]).all()
    assert np.flatnonzero(row[:30, SIDE]).tolist() == [10]
    assert lines.actions[1, 0].tolist()[:2] == [1.0, 1.0]
    last = lines.actions[2]  # it begins with its own action, whatever was kept
    assert last[:, ACCEL].tolist() == [1.0] * 10 + [3.0] * 10 + [2.0] * 10 + [1.0] * 10
    assert np.flatnonzero(last[:, SIDE]).tolist() == [0] and last[0, SIDE] == -1.0


def plan_of(*v: float) -> Plan:
    """These speeds, 0.1 s apart."""
    none: Any = np.zeros(0)
    return Plan(0.1 * np.arange(1.0, len(v) + 1.0), np.array(v), none, none, np.zeros((0, 4)))


@pytest.mark.parametrize(
    ("speeds", "accel"),
    [
        (tuple(10.0 + 0.2 * k for k in range(1, 21)), 2.0),
        (tuple(10.0 + 0.1 * k * k for k in range(1, 21)), 10.0),  # mean of the first second
        ((9.0, 8.0), -10.0),  # it ends after 0.2 s
        ((), 0.0),
    ],
)
def test_the_acceleration_of_a_plan_is_that_of_its_first_action(
    speeds: tuple[float, ...], accel: float
) -> None:
    assert _first_accel(start(), plan_of(*speeds)) == pytest.approx(accel)


# --- the last plan ---


def test_the_last_plan_is_carried_on_with_its_own_cost() -> None:
    begun = start()
    line = np.concatenate([lasting(-2.0, 0, 15), lasting(1.0, 0, 65)])
    found = warm_start(begun, line, 0.5)
    assert found is not None and found.line is line
    plan, terms, _ = follow_line(*begun, line)
    child = found.child
    assert child.mean == child.best == pytest.approx(terms.sum()) and child.best > 0.0
    assert (child.visits, child.lane_change) == (0, 0)
    assert child.accel == pytest.approx(plan.v[9] - 10.0) and child.accel < -1.0
    assert np.array_equal(found.plan.v, plan.v) and len(plan.v) == 80


@pytest.mark.parametrize(("at", "carried"), [(0, True), (1, False), (4, False), (5, True)])
def test_a_lane_change_begins_with_a_period_or_not_at_all(at: int, carried: bool) -> None:
    """Of 0.5 s, so of five steps."""
    line = lasting(0.0, 0, 40)
    line[at, SIDE] = 1.0
    found = warm_start(start(), line, 0.5)
    assert (found is not None) is carried
    if found is not None:
        assert found.child.lane_change == (1 if at == 0 else 0)


def test_what_is_impossible_or_ends_in_a_contact_is_not_carried_on() -> None:
    line = lasting(0.0, 0, 40)
    assert warm_start(start(), line[:0], 0.5) is None
    assert warm_start(start(Agent("x", "a_1", 112.0, 0.0)), line, 0.5) is None
    assert warm_start(start(name="a_2"), lasting(0.0, 1, 40), 0.5) is None
    assert warm_start(start(name="a_2"), lasting(0.0, -1, 40), 0.5) is not None
    far = lanes_east(1, 130.0)
    ego = ego_at(far, "a_0", 110.0, 14.0)
    task = task_of(far, ego)
    local, state = local_of(task, scene_of(ego, far))
    arrives = start()._replace(local=local, task=task, state=state)
    assert follow_line(*arrives, line)[2] == ARRIVED
    assert warm_start(arrives, line, 0.5) is not None


# --- another hypothesis ---


def candidate(side: int, *v: float) -> Candidate:
    child = RootChild(0.0, side, 1, 0.0, 0.0, np.zeros(5), np.zeros((0, 4)))
    return Candidate(child, plan_of(*v), np.zeros((0, 3)))


def test_the_nearest_action_has_the_same_change_and_the_nearest_speed() -> None:
    tree = grown(0, 1, 2, 3)
    tree.motion[1:5, MOTION_V] = 12.0, 8.0, 11.0, 10.5
    tree.best[1:5] = 1.0, 2.0, 3.0, 4.0
    ramp = tuple(9.0 + 0.1 * k for k in range(20))  # 9.9 m/s after a second
    found = [
        candidate(0, *ramp),  # 8 m/s is nearer than 12 m/s
        candidate(0, 12.0, 10.2),  # it ends before
        candidate(1, *[10.7] * 10),
        candidate(-1, *[10.0] * 10),  # no such change was tried
        candidate(0, *[10.0] * 10),  # both are as near: the cheaper one
    ]
    assert _nearest_actions(start(), tree, ACTIONS, found).tolist() == [1, 0, 3, -1, 0]
    tree.best[1] = 9.0
    assert _nearest_actions(start(), tree, ACTIONS, found).tolist() == [1, 0, 3, -1, 1]


@pytest.mark.parametrize(
    ("end", "steps", "whole", "cost", "terms"),
    [
        (ALIVE, 80, 4.0, 4.0, 0.8),  # driven to the horizon, and cheaper than begun
        (ALIVE, 80, 6.0, 6.0, 1.2),  # as cheap
        (ALIVE, 80, 7.0, 6.0, 3.0),  # only begun it is cheaper
        (ALIVE, 79, 4.0, 6.0, 3.0),  # it does not last to the horizon
        (LOST, 9, 4.0, 4.0, 0.8),
        (LOST, 9, 7.0, 6.0, 3.0),
        (ARRIVED, 9, 4.0, 4.0, 0.8),
        (IMPOSSIBLE, 80, 4.0, 6.0, 3.0),
    ],
)
def test_a_candidate_is_driven_to_its_end_or_only_begun(
    end: int, steps: int, whole: float, cost: float, terms: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """Begun it costs 6, with terms of 3 each; a candidate without such an action costs a contact."""
    begun, tree = start(), grown(0, 1)
    tree.best[1:3], tree.motion[1:3, MOTION_V] = (6.0, 1.0), (10.0, 3.0)
    asked = []

    def drive(_: Start, lines: Any) -> Driven:
        asked.append(lines)
        first = len(asked) == 1
        count = 2 if first else len(lines.steps)
        value = np.full((count, 5), whole / 5.0 if first else 3.0)
        none: Any = np.zeros(0)
        ends = np.full(count, end if first else ALIVE)
        return Driven(none, none, none, value, lines.steps, ends, none)

    monkeypatch.setattr(candidates, "drive", drive)
    found = [candidate(0, *[9.9] * 10), candidate(1, *[9.9] * 10)]
    lines = lines_of([lasting(0.0, 0, steps)] * 2)
    costs, parts = costs_in(begun, tree, ACTIONS, found, lines)
    assert costs[0] == cost and parts[0].tolist() == pytest.approx([terms] * 5)
    contact = begun.task.cost.contact
    goes_on = (end in (LOST, ARRIVED)) or (end == ALIVE and steps == 80)
    assert costs[1] == (whole if goes_on else contact)
    assert parts[1, LOSS] == (whole / 5.0 if goes_on else contact)
    assert parts[1].sum() == pytest.approx(whole if goes_on else contact)
    if cost == 6.0 and terms == 3.0:  # the best sequence behind the nearest action was driven
        assert asked[1].actions[0, 0, ACCEL] == FOLLOW and len(asked[1].steps) == 1


# --- room ---


def asks(line: np.ndarray, urgency: float, *cars: Agent, asked: int = 0, **state: Any) -> int:
    begun = start(*cars)
    there = begun.local.urgency.copy()
    there[:] = 0.0
    there[begun.state.node - begun.local.first] = urgency
    local = begun.local._replace(urgency=there, asked=asked)
    return asked_side(begun._replace(local=local, state=begun.state._replace(**state)), line)


def test_room_is_asked_for_on_the_side_that_the_route_needs_where_it_is_taken() -> None:
    stays = lasting(0.0, 0, 80)
    left, right = Agent("l", "a_2", 100.0, 10.0), Agent("r", "a_0", 100.0, 10.0)
    assert asks(stays, 2.0, left, right) == 1 and asks(stays, -0.5, left, right) == -1
    assert asks(stays, 0.0, left, right) == 0  # no change is needed
    assert asks(stays, 1.0, right) == 0 and asks(stays, -1.0, left) == 0  # it could change now
    assert asks(stays, 1.0, left, progress=0.1, other=2) == 0  # it is changing


@pytest.mark.parametrize(
    ("at", "side", "asked", "asks_for"),
    [
        (39, 1.0, 0, 0),  # within four seconds it changes, without help
        (40, 1.0, 0, 1),
        (39, -1.0, 0, 1),  # to the other side
        (39, 1.0, 1, 1),  # it counts on those that were asked
        (39, 1.0, -1, 0),
    ],
)
def test_a_change_that_is_planned_soon_needs_no_help(
    at: int, side: float, asked: int, asks_for: int
) -> None:
    line = lasting(0.0, 0, 80)
    line[at, SIDE] = side
    assert asks(line, 1.0, Agent("l", "a_2", 100.0, 10.0), asked=asked) == asks_for


def test_no_room_is_asked_for_where_there_is_no_lane() -> None:
    begun = start(name="a_2")
    there = np.full_like(begun.local.urgency, 1.0)
    begun = begun._replace(local=begun.local._replace(urgency=there))
    assert asked_side(begun, lasting(0.0, 0, 80)) == 0


def test_of_the_lanes_that_a_cycle_looks_at_the_first_counts_too_and_none_beyond() -> None:
    begun = start(Agent("l", "a_1", 100.0, 10.0), name="a_0")
    assert begun.state.node == begun.local.first
    there = np.zeros_like(begun.local.urgency)
    there[0] = 1.0
    urgent = begun._replace(local=begun.local._replace(urgency=there))
    assert asked_side(urgent, lasting(0.0, 0, 80)) == 1
    beyond = begun._replace(local=begun.local._replace(urgency=there[:0]))
    assert asked_side(beyond, lasting(0.0, 0, 80)) == 0


# --- braking for nothing but passability ---


def test_the_hardest_braking_of_the_first_action_counts() -> None:
    begun = start()
    for speeds, braking in (
        ((9.5, 9.3, *[9.3] * 18), 5.0),  # from the speed that it has now
        ((10.0, 9.8, 9.1, *[9.1] * 17), 7.0),
        ((*[10.0] * 10, *[2.0] * 10), 0.0),  # after a second
        ((*[10.0] * 9, *[9.0] * 11), 10.0),
        ((11.0, 12.0), 0.0),
    ):
        assert _hardest(begun, candidate(0, *speeds)) == pytest.approx(braking, abs=1e-5)


def test_of_those_that_brake_gently_the_cheapest_that_costs_others_no_more() -> None:
    begun = start(stop=Stop(0, 299.8, 300.0))

    def costing(v: float, passability: float, other: float) -> Candidate:
        made = candidate(0, *[v] * 10)
        terms = np.array([other, 0.0, 0.0, 0.0, 0.0])
        terms[PASSABILITY] = passability
        return made._replace(child=made.child._replace(best=passability + other, terms=terms))

    hard, mild = costing(9.0, 1.0, 2.0), costing(9.9, 30.0, 2.0)
    cheaper, dear = costing(9.8, 20.0, 2.0), costing(9.9, 5.0, 2.1)
    assert not_for_a_stop(begun, [mild, hard, cheaper, dear], 1, 4.5) == 2
    assert not_for_a_stop(begun, [mild, hard, dear], 1, 4.5) == 0
    assert not_for_a_stop(begun, [hard, dear], 0, 4.5) == 0  # nobody else is as good
    assert not_for_a_stop(begun, [mild, hard, cheaper], 1, 10.5) == 1  # that much is gentle
    assert not_for_a_stop(start(), [mild, hard, cheaper], 1, 4.5) == 1  # no stop ahead
