"""Decisions: what is none, what counts as waiting, how passes are shared, which candidate is
chosen."""

import math
import time
from collections.abc import Sequence
from functools import cache
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from helpers import ego_at
from helpers_model import lanes_east, scenario, scene_of, situation_of, task_of

from sumo_mcts.planners import mcts
from sumo_mcts.planners.actions import ACCEL, FOLLOW, LATER, SIDE, lasting, packed
from sumo_mcts.planners.base import Situation, Task
from sumo_mcts.planners.budget import Budget, part, passes_within
from sumo_mcts.planners.candidates import Candidate
from sumo_mcts.planners.mcts import MctsPlanner, actions_of, forecast_s, in_steps, mcts_params
from sumo_mcts.planners.patience import patience
from sumo_mcts.planners.risk import shares
from sumo_mcts.planners.validity import why_invalid
from sumo_mcts.scene import LOSS, Decision, Follow, Plan, RootChild

LANES = lanes_east(3, 250.0)

# --- what is no decision ---


def plan_of(**change: object) -> Plan:
    """Two states."""
    one = np.ones(2)
    return Plan(one, one, np.zeros(2, np.int32), one, np.ones((2, 4)))._replace(**change)  # type: ignore[arg-type]


def child(best: float, loss: float = 0.0) -> RootChild:
    terms = np.zeros(5)
    terms[LOSS] = loss
    return RootChild(0.0, 0, 1, best, best, terms, np.zeros((1, 4)))


@cache
def case(name: str = "a_1") -> tuple[Task, Situation]:
    """An ego alone on a lane."""
    ego = ego_at(LANES, name, 200.0, 10.0)
    task = task_of(LANES, ego)
    return task, situation_of(task, scene_of(ego, LANES), seconds=1.0)


def why(name: str = "a_1", **change: object) -> str:
    """Why a decision of an ego on this lane is none."""
    decision = Decision(Follow(np.full(5, 10.0), 0), plan_of(), (child(1.0),), 0, "", 0, 0)
    decision = decision._replace(**change)  # type: ignore[arg-type]
    return why_invalid(*case(name), decision)


def test_a_whole_decision_is_valid() -> None:
    assert why() == "" and why(plan=None) == "" and why(children=()) == ""
    assert why(command=Follow(np.array([1, 0], np.uint8), 0)) == ""
    for asks in (-1, 0, 1):
        assert why(command=Follow(np.ones(1), 0, asks)) == ""


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"command": Follow(np.ones(1), 0, 2)}, "a wish for the side 2"),
        ({"command": Follow(np.ones(1), 2)}, "a lane change by 2"),
        ({"command": Follow(np.array([1.0, 2.0, -0.1, -3.0]), 0)}, "a speed of -0.1 m/s"),
        ({"command": Follow(np.array([True]), 0)}, "speeds of shape (1,) and type bool"),
        ({"children": [child(1.0)]}, "children that are no tuple of RootChild"),
        ({"children": (child(1.0), "b")}, "children that are no tuple of RootChild"),
        ({"plan": "straight on"}, "no plan but str"),
        ({"plan": plan_of(time=np.ones(3))}, "a plan whose v has shape (2,)"),
        ({"plan": plan_of(v=np.ones((2, 2)))}, "a plan whose v has shape (2, 2)"),
        ({"plan": plan_of(pose=np.ones((2, 3)))}, "a plan whose pose has shape (2, 3)"),
        ({"plan": plan_of(s=np.array([1.0, np.nan]))}, "a plan whose s has shape (2,)"),
        ({"plan": plan_of(lane=np.array(["a", "b"]))}, "a plan whose lane has shape (2,)"),
        ({"plan": plan_of(time=np.array(1.0))}, "a plan whose time has shape ()"),
    ],
)
def test_what_is_no_decision(change: dict[str, object], words: str) -> None:
    assert why(**change).startswith(words)


def test_no_change_beyond_the_outer_lanes() -> None:
    for name, side, there in (("a_2", 1, False), ("a_2", -1, True), ("a_0", -1, False),
                              ("a_0", 1, True)):  # fmt: skip
        said = why(name, command=Follow(np.ones(1), side))
        word = "left" if side > 0 else "right"
        assert said == ("" if there else f"a lane change to the {word}, where there is no lane")


# --- shares, budgets, patience ---


def test_half_of_the_passes_by_weight_and_half_equally() -> None:
    weight = np.array([0.6, 0.3, 0.1])
    assert shares(weight, 1000, 10) == pytest.approx(0.5 * weight + 0.5 / 3)
    # every action four times in each: 80 passes suffice for two, and weights are those of two
    assert shares(weight, 80, 10) == pytest.approx([0.5 * 2 / 3 + 0.25, 0.5 / 3 + 0.25])
    assert shares(weight, 79, 10).tolist() == [1.0]
    assert len(shares(weight, 120, 10)) == 3 and len(shares(weight, 119, 10)) == 2


def test_a_part_of_a_budget_and_the_passes_of_a_time() -> None:
    assert part(Budget(1000, 3000, 0.5), 0.25) == (250, 750, 0.5)
    assert passes_within(700, math.inf) == 700
    assert passes_within(700, 0.01) == 5100 and passes_within(700, -1.0) == 100
    assert passes_within(700, 60.0) == 1_000_000


def test_patience_halves_after_the_time_that_it_is_the_reciprocal_of() -> None:
    assert patience(0.1, 0.0) == 1.0 and patience(0.1, 10.0) == 0.5
    assert patience(0.1, 30.0) == 0.25 and patience(0.0, 99.0) == 1.0


# --- the planner around the search ---


def planner(*sets: str) -> MctsPlanner:
    found = MctsPlanner(mcts_params(scenario(*sets)))
    found.start(case()[0], 1)
    return found


def candidates(*those: tuple[float, float]) -> list[Candidate]:
    """(J, loss) of each."""
    return [Candidate(child(*each), plan_of(), np.zeros((1, 3))) for each in those]


def test_the_cheapest_is_chosen_the_last_of_equal_ones_and_the_mildest_where_all_is_lost() -> None:
    choice, contact = planner()._choice, case()[0].cost.contact
    assert choice(candidates((3.0, 0.0), (2.0, 0.0), (4.0, 0.0))) == (1, False)
    assert choice(candidates((2.0, 0.0), (2.0, 0.0), (4.0, 0.0))) == (1, False)
    # all end in a contact: the least bad one, and of equal ones the cheaper
    lost = candidates((contact, 90.0), (2 * contact, 80.0), (1.5 * contact, 80.0))
    assert choice(lost) == (2, True)
    # what is lost far ahead only, and so costs less than half of a contact, is no contact yet
    assert choice(candidates((0.4 * contact, 90.0), (contact, 80.0))) == (0, False)
    assert choice(candidates((0.6 * contact, 90.0), (contact, 80.0))) == (1, True)
    assert choice(candidates((0.6 * contact, 0.0), (contact, 80.0))) == (0, False)


def test_following_comes_first_then_accelerations_then_changes_to_the_left_and_right() -> None:
    p = mcts_params(scenario())._replace(
        accelerations=(2.0, 0.0, -3.0), lane_change_accelerations=(1.0, -1.0),
        later_accelerations=(0.0, -1.0), later_lane_change_accelerations=(-1.0, 2.0),
    )  # fmt: skip
    found = actions_of(p)
    assert found[:, ACCEL].tolist() == [FOLLOW, 2.0, 0.0, -3.0, 1.0, -1.0, 1.0, -1.0]
    assert found[:, SIDE].tolist() == [0.0] * 4 + [1.0, 1.0, -1.0, -1.0]
    assert found[:, LATER].tolist() == [1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0]


def test_a_forecast_lasts_for_the_horizon_the_claim_and_a_step() -> None:
    sets = (
        "planner.step_s=1", "planner.look_ahead_steps=3", "planner.rollout_steps=4",
        "cost.claim_s=2",
    )  # fmt: skip
    assert forecast_s(scenario(*sets), 0.1, 0.2) == pytest.approx(7.0 + 2.0 + 0.2)
    assert forecast_s(scenario(*sets), 0.3, 0.2) == pytest.approx(7 * 0.9 + 2.0 + 0.2)
    assert forecast_s(scenario(*sets), 3.0, 0.2) == pytest.approx(7 * 3.0 + 2.0 + 0.2)


def test_most_iterations_are_no_fewer_than_iterations_and_cvar_has_its_share() -> None:
    def of(*sets: str) -> tuple[int, int, float]:
        p = mcts_params(scenario(*sets))
        return p.budget.iterations, p.budget.most, p.worst_share

    few = "planner.iterations=500"
    assert of(few, "planner.most_iterations=null") == (500, 500, 1.0)
    assert of(few, "planner.most_iterations=900")[1] == 900
    assert of("planner.risk=cvar", "planner.cvar_alpha=0.2")[2] == 0.2


def test_what_is_left_of_the_last_sequence_is_continued_with_following() -> None:
    """Ten steps of 0.1 s that began at 7 s: accelerations 0 to 9, a change to the left with the
    seventh."""
    mind = planner()
    line = lasting(0.0, 0, 10)
    line[:, ACCEL] = np.arange(10.0)
    line[6, SIDE] = 1.0
    mind._last_line, mind._last_time = packed(line), 7.0

    def left(now: float, steps: int) -> Sequence[tuple[float, float]]:
        return [(a, side) for a, side, _ in mind._remaining(now, steps).tolist()]

    assert left(7.5, 3) == [(5.0, 0.0), (6.0, 1.0), (7.0, 0.0)]
    assert left(7.8, 4) == [(8.0, 0.0), (9.0, 0.0), (FOLLOW, 0.0), (FOLLOW, 0.0)]
    assert left(7.9, 2) == [(9.0, 0.0), (FOLLOW, 0.0)]
    assert left(7.1, 2) == [(1.0, 0.0), (2.0, 0.0)]
    for now in (7.0, 6.0, 8.0, 30.0):  # nothing is over yet, or all
        assert left(now, 3) == []


def test_a_planner_goes_on_from_what_it_remembered() -> None:
    mind, other = planner(), planner()
    mind._last_line, mind._last_time, mind._waited_s = np.array([1.0, 2.0, 3.0]), 7.5, 4.0
    other.recall(mind.memory())
    assert other._last_line.tolist() == [1.0, 2.0, 3.0]
    assert (other._last_time, other._waited_s) == (7.5, 4.0)
    other.start(other._task, 1)  # a new episode
    assert (len(other._last_line), other._last_time, other._waited_s) == (0, 0.0, 0.0)


def test_the_times_of_the_search_in_steps() -> None:
    p = mcts_params(scenario())._replace(step_s=1.0, look_ahead_steps=3, rollout_steps=4)
    assert in_steps(p, 0.1, 0.2).horizon == pytest.approx(7.0)


# --- a decision, with the search put in by hand ---


class Fakes(NamedTuple):
    """What a planner found, and what its search was told."""

    decision: Decision
    beat: float
    mind: MctsPlanner


def decided(
    monkeypatch: pytest.MonkeyPatch, found: list[Candidate], warm: Candidate | None,
    *, asks: bool = True, can_ask: bool = True,
) -> Fakes:  # fmt: skip
    """A decision among these candidates, the last plan carried on as another one."""
    mind, beats = planner(), []
    mind._params = mind._params._replace(asks=asks)

    def searched(*arguments: object) -> mcts.Searched:
        beats.append(arguments[-1])
        return mcts.Searched(SimpleNamespace(leader=np.full((1, 3), 50.0)), 5, 2)

    monkeypatch.setattr(mcts, "warm_start", lambda *_: warm)
    monkeypatch.setattr(mcts, "root_candidates", lambda *_: list(found))
    monkeypatch.setattr(mcts, "not_for_a_stop", lambda _, __, chosen, ___: chosen)
    monkeypatch.setattr(mcts, "asked_side", lambda *_: 1)
    monkeypatch.setattr(mind, "_search", searched)
    _, situation = case()
    scene = situation.scene
    scene = scene._replace(time=6.5, ego=scene.ego._replace(can_ask=can_ask))
    return Fakes(mind.plan(situation._replace(scene=scene)), beats[0], mind)


def test_the_last_plan_is_carried_on_unless_the_search_found_a_better_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = candidates((3.0, 0.0), (2.0, 0.0))
    for best, reason, chosen in (
        (1.5, "carried on", 2),
        (2.0, "carried on", 2),
        (2.5, "search", 1),
    ):
        made = decided(monkeypatch, found, candidates((best, 0.0))[0])
        assert (made.decision.reason, made.decision.chosen) == (reason, chosen)
        assert made.beat == best and len(made.decision.children) == 3
        assert (made.decision.iterations, made.decision.known) == (5, 2)
    alone = decided(monkeypatch, found, None)
    assert (alone.decision.reason, alone.beat) == ("search", math.inf)
    assert len(alone.decision.children) == 2


def test_a_plan_that_ends_in_a_contact_is_not_carried_on(monkeypatch: pytest.MonkeyPatch) -> None:
    contact = case()[0].cost.contact
    safe = decided(monkeypatch, candidates((2.0, 0.0)), None)
    assert safe.mind._last_line.tolist() == [0.0] and safe.mind._last_time == 6.5
    lost = decided(monkeypatch, candidates((contact, 0.5)), None)
    assert lost.decision.reason == "brake" and len(lost.mind._last_line) == 0


def test_room_is_asked_for_where_that_is_allowed_and_no_change_begins(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    keeps = candidates((2.0, 0.0))
    changes = [each._replace(child=each.child._replace(lane_change=1)) for each in keeps]
    for found, asks, can_ask, side in (
        (keeps, True, True, 1), (keeps, False, True, 0), (keeps, True, False, 0),
        (changes, True, True, 0),
    ):  # fmt: skip
        command = decided(monkeypatch, found, None, asks=asks, can_ask=can_ask).decision.command
        assert isinstance(command, Follow)
        assert (command.asks, command.lane_change) == (side, found[0].child.lane_change)


def searched(
    monkeypatch: pytest.MonkeyPatch, share: list[float], *, each: tuple[int, int] | None = None,
) -> tuple[tuple[int, int], list[int]]:  # fmt: skip
    """Passes to the horizon and known ones of a search, and how many were asked for at a time;
    `each`: what a call finds, instead of all but one that are known."""
    mind, asked, (_, situation) = planner("planner.iterations=1000"), [], case()

    def search(*arguments: object) -> tuple[int, int]:
        count = next(each for each in arguments if type(each) is int)
        asked.append(count)
        return (count - 1, 1) if each is None else each

    monkeypatch.setattr(mcts, "search", search)
    q = in_steps(mind._params, 0.1, 0.2)
    local = mind._locals(situation, 1)[0]
    _, done, known = mind._search(local, q, situation, np.array(share), math.inf)
    return (done, known), asked


def test_a_search_makes_its_share_of_the_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    assert searched(monkeypatch, [1.0]) == ((999, 1), [1000])
    assert searched(monkeypatch, [0.25, 0.75]) == ((249, 1), [250])
    assert searched(monkeypatch, [1.0], each=(400, 200))[1] == [1000, 400]
    assert searched(monkeypatch, [1.0], each=(0, 0)) == ((0, 0), [1000])  # nothing is left


@pytest.mark.parametrize(
    ("share", "threads", "seconds"),
    [
        ([0.25, 0.75], 1, 2.0),
        ([0.25, 0.25], 1, 4.0),
        ([0.25, 0.75], 2, 4.0),  # the other half is the other thread's
        ([0.75, 0.25], 2, 8.0),
    ],
)
def test_time_is_shared_with_those_that_are_still_to_be_searched(
    share: list[float], threads: int, seconds: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    mind, (_, situation), spans = planner(), case(), []
    mind._params = mind._params._replace(threads=threads)

    def count(_: Budget, __: object, ___: int, began: float, until: float) -> int:
        spans.append(until - began)
        return 0

    monkeypatch.setattr(mcts, "_count", count)
    monkeypatch.setattr(mcts, "new_tree", lambda *_: None)
    timed = situation._replace(until=time.perf_counter() + 8.0)
    local = mind._locals(situation, 1)[0]
    mind._search(local, in_steps(mind._params, 0.1, 0.2), timed, np.array(share), math.inf)
    assert spans[0] == pytest.approx(seconds, abs=0.3)


@pytest.mark.parametrize(("worst", "expected"), [(1.0, [2.25, 3.25]), (0.25, [3.0, 10.0])])
def test_each_candidate_costs_what_it_does_in_all_hypotheses(
    worst: float, expected: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two of them, three to one: costs 3 and 0, 1 and 10."""
    mind, (_, situation) = planner(), case()
    mind._params = mind._params._replace(worst_share=worst)
    terms = np.arange(10.0).reshape(2, 5)
    tree = SimpleNamespace(others=np.zeros((1, 2, 2)))
    monkeypatch.setattr(mcts, "costs_in", lambda *_: (np.array([0.0, 10.0]), terms))
    weighed = situation._replace(
        forecast=situation.forecast._replace(weight=np.array([0.6, 0.2, 0.2]))
    )
    q, local = in_steps(mind._params, 0.1, 0.2), mind._locals(situation, 1)[0]
    first = candidates((3.0, 0.5), (1.0, 0.0))
    found = mind._weighed(weighed, q, first, [local], [mcts.Searched(tree, 7, 3)])
    assert [each.child.best for each in found] == pytest.approx(expected)
    for k, each in enumerate(found):
        assert each.child.hypotheses.tolist() == [first[k].child.terms.tolist(), terms[k].tolist()]


def test_it_goes_on_drawing_from_what_it_remembered() -> None:
    """Also in the middle of a draw of 64 bits, of which half is left."""
    mind, other = planner(), planner()
    for _ in range(3):
        mind._rng.integers(0, 2**31, dtype=np.int32)
        other.recall(mind.memory())
        drawn = [each._rng.bit_generator.random_raw() for each in (mind, other)]
        assert drawn[0] == drawn[1]
        left = [each._rng.integers(0, 2**31, 3, dtype=np.int32).tolist() for each in (mind, other)]
        assert left[0] == left[1]
    assert planner()._rng.random() != mind._rng.random()


@pytest.mark.parametrize(("until", "asked"), [(math.inf, ("passes", 30)), (110.0, (30, 7.0, 3.0))])
def test_with_a_time_budget_the_clock_is_asked(
    until: float, asked: tuple[object, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The search began at 100 s, and it is 107 s."""
    monkeypatch.setattr(mcts.time, "perf_counter", lambda: 107.0)
    monkeypatch.setattr(mcts, "next_passes", lambda _, __, made: ("passes", made))
    monkeypatch.setattr(mcts, "next_passes_in_time", lambda _, *those: those)
    assert mcts._count(Budget(1, 1, 0.0), None, 30, 100.0, until) == asked  # type: ignore[arg-type]
