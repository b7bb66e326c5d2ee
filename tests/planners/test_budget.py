"""Adaptive budgets: what a search may leave out, when it stops, and that decisions with a time
budget are there in time."""

import itertools
import math
import time
from typing import Any

import numpy as np
import pytest
from helpers import Agent, ego_at
from helpers_model import lanes_east, scene_of
from helpers_tree import TOYS, Grown, Toy, decide, grow, on_three_lanes, steady
from hypothesis import given, settings
from hypothesis import strategies as st

from sumo_mcts import config
from sumo_mcts.config import builtin
from sumo_mcts.episode import EpisodeResult, run_episode
from sumo_mcts.model.local_map import MOTION_V
from sumo_mcts.planners import budget as budgets
from sumo_mcts.planners import mcts
from sumo_mcts.planners.actions import ACCEL, FOLLOW, LATER, NO_SPEED, SIDE, to_steps
from sumo_mcts.planners.base import Situation, Task
from sumo_mcts.planners.budget import (
    AT_FIRST,
    AT_MOST,
    SLICE,
    SPARE,
    Budget,
    Timekeeper,
    is_close,
    next_passes,
    next_passes_in_time,
    passes_within,
)
from sumo_mcts.planners.candidates import follow_line
from sumo_mcts.planners.mcts import MctsPlanner, mcts_params
from sumo_mcts.scene import Decision

ENOUGH = 60_000  # passes after which a small tree has nothing left to try

# --- what is left out is no loss ---


def without_more(toy: Toy, *sets: str) -> Toy:
    return toy._replace(sets=(*toy.sets, *sets))


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("toy", TOYS.values(), ids=TOYS)
def test_a_search_that_stopped_by_itself_knows_the_best(toy: Toy, seed: int) -> None:
    """Whatever a search finds that tries everything and draws its rollouts is no better."""
    small = without_more(toy, "planner.look_ahead_steps=3", "planner.rollout_steps=3")
    proven = grow(small, ENOUGH)
    assert proven.tree.closed[0] and proven.done + proven.known < ENOUGH
    assert grow(steady(small), 8000, seed).tree.best[0] >= proven.tree.best[0] - 1e-9


agents = st.lists(
    st.tuples(st.integers(0, 2), st.floats(40.0, 220.0), st.floats(0.0, 15.0)), max_size=5
)


@given(agents, st.integers(0, 2), st.floats(0.0, 15.0), st.integers(0, 2**32 - 1))
@settings(max_examples=15)
def test_it_knows_the_best_in_any_scene(
    those: list[tuple[int, float, float]], lane: int, v: float, seed: int
) -> None:
    road = lanes_east(3, 900.0)
    toy = on_three_lanes(
        ego_at(road, f"a_{lane}", 100.0, v),
        *(Agent(f"v{k}", f"a_{i}", s, u) for k, (i, s, u) in enumerate(those)),
    )
    small = without_more(toy, "planner.look_ahead_steps=2", "planner.rollout_steps=3")
    proven = grow(small, ENOUGH)
    assert proven.tree.closed[0]
    assert grow(steady(small), 3000, seed).tree.best[0] >= proven.tree.best[0] - 1e-9


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("toy", TOYS.values(), ids=TOYS)
def test_where_every_action_counts_the_best_of_each_is_known(toy: Toy, seed: int) -> None:
    """As hypotheses need it, whose costs are put together action by action."""
    small = without_more(toy, "planner.look_ahead_steps=3", "planner.rollout_steps=3")
    each, winner, drawn = (
        grow(small, ENOUGH, each=True),
        grow(small, ENOUGH),
        grow(steady(small), 8000, seed),
    )
    assert each.tree.closed[0] and each.done < ENOUGH
    for i, j in zip(each.tree.child[0], drawn.tree.child[0], strict=True):
        assert (i >= 0) == (j >= 0)
        assert i < 0 or each.tree.best[i] <= drawn.tree.best[j] + 1e-9
    assert each.tree.best[0] == pytest.approx(winner.tree.best[0], abs=1e-9)


def best_of_all_lines(grown: Grown) -> float:
    """The lowest J of every sequence of actions with every continuation, each driven on its own;
    for a road without lane changes."""
    q, brake, push = grown.q, -grown.task.ego.approach_decel, grown.task.ego.max_accel
    first, later = (
        grown.actions[grown.actions[:, SIDE] == 0.0, ACCEL],
        grown.actions[(grown.actions[:, SIDE] == 0.0) & (grown.actions[:, LATER] == 1.0), ACCEL],
    )
    r = q.rollout
    ends = [[FOLLOW] * r, [brake] * r, [0.5 * brake] + [FOLLOW] * (r - 1)]
    for k in range(r):
        ends += [
            [FOLLOW] * k + [brake] * (r - k),
            [push] * (k + 1) + [FOLLOW] * (r - k - 1),
            [FOLLOW] * k + [push] * min(2, r - k) + [FOLLOW] * (r - k - 2),
        ]
    lines = [
        to_steps(np.array([(accel, 0.0, NO_SPEED) for accel in (*head, *end)]), q.ply)
        for head in itertools.product(first, *[later] * (q.look_ahead - 1))
        for end in ends
    ]
    return min(
        float(
            follow_line(grown.local, grown.task, q, grown.root, grown.tree.others[0], line)[1].sum()
        )
        for line in lines
    )


@pytest.mark.parametrize(
    ("gap", "v", "u"), [(40.0, 10.0, 6.0), (15.0, 8.0, 8.0), (30.0, 4.0, 0.0), (200.0, 13.0, 0.0)]
)
def test_the_best_is_that_of_all_sequences(gap: float, v: float, u: float) -> None:
    road = lanes_east(1, 900.0)
    toy = Toy(
        road, scene_of(ego_at(road, "a_0", 100.0, v), road, Agent("ahead", "a_0", 105.0 + gap, u))
    )
    grown = grow(without_more(toy, "planner.look_ahead_steps=3", "planner.rollout_steps=2"), ENOUGH)
    assert grown.tree.closed[0]
    assert grown.tree.best[0] == pytest.approx(best_of_all_lines(grown), abs=1e-9)


def test_it_leaves_out_a_good_part_of_a_tree() -> None:
    fewer = [(grow(toy, 3000), grow(steady(toy), 3000)) for toy in TOYS.values()]
    assert sum(a.done for a, _ in fewer) < 0.7 * sum(s.done for _, s in fewer)


def test_nothing_is_left_out_while_all_is_lost() -> None:
    """How bad a contact is decides then, and that is not the cost alone."""
    road = lanes_east(1, 900.0)
    toy = Toy(road, scene_of(ego_at(road, "a_0", 100.0, 14.0), road, Agent("w", "a_0", 112.0, 0.0)))
    here, there = (
        decide(toy, "planner.iterations=3000"),
        decide(steady(toy), "planner.iterations=3000"),
    )
    assert here.reason == there.reason == "brake"
    assert here.children[here.chosen].terms[4] == there.children[there.chosen].terms[4]


def recorded(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> tuple[list[tuple[Task, Situation, Decision]], EpisodeResult]:
    """Every decision of an episode with all that it rests on."""
    found, plan = [], MctsPlanner.plan

    def watched(self: MctsPlanner, situation: Situation) -> Decision:
        decision = plan(self, situation)
        found.append((self._task, situation, decision))
        return decision

    with monkeypatch.context() as patch:
        patch.setattr(MctsPlanner, "plan", watched)
        result = run_episode(
            config.load(builtin.scenario_path(name), ("prediction.hypotheses=1",)), 3
        )
    return found[-result.rows[0]["cycles"] :], result  # without the warm-up


@pytest.mark.parametrize(
    "name", ["unprotected-left-turn", "unprotected-left-turn-scripted", "highway-exit"]
)
def test_in_an_episode_what_was_decided_early_is_what_is_decided_late(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    decisions, _ = recorded(monkeypatch, name)
    early = [
        each
        for each in decisions
        if each[2].iterations + each[2].known < 1000 and each[2].reason != "brake"
    ]
    assert len(early) > 8
    params = mcts_params(
        config.load(
            builtin.scenario_path(name), ("planner.adaptive=false", "planner.iterations=2500")
        )
    )
    for task, situation, decision in early[::2]:
        planner = MctsPlanner(params)
        planner.start(task, 7)
        late = planner.plan(situation)
        known = decision.children[decision.chosen]
        assert late.children[late.chosen].best >= known.best - 1e-9
        if late.children[late.chosen].best < known.best + 1e-9 and decision.reason == "search":
            assert late.command.speeds[:5] == pytest.approx(decision.command.speeds[:5], abs=0.2)  # type: ignore[union-attr]  # a planner that searches commands


def test_an_adaptive_episode_is_reproducible_and_tells_what_it_did(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    decisions, result = recorded(monkeypatch, "unprotected-left-turn")
    again = recorded(monkeypatch, "unprotected-left-turn")[1]
    row = result.rows[0]
    assert row["trace_digest"] == again.rows[0]["trace_digest"]
    assert (
        row["iterations"]
        == sum(decision.iterations for *_, decision in decisions)
        < 0.8 * row["cycles"] * row["iterations_per_decision"]
    )


# --- more where it is close ---


def tree_with(*children: tuple[float, float, bool]) -> Any:
    """A root whose children have this best J, speed, and whether it is open."""
    tree = grow(TOYS["free"], 20).tree
    tree.child[0, :] = -1
    for i, (best, v, alive) in enumerate(children, 1):
        tree.child[0, i - 1], tree.best[i], tree.motion[i, MOTION_V], tree.closed[i] = (
            i,
            best,
            v,
            not alive,
        )
        tree.where[i] = tree.where[1]
    tree.closed[0] = False
    return tree


def test_close_is_another_command_that_may_still_win() -> None:
    assert is_close(tree_with((2.0, 10.0, True), (2.1, 11.0, True)), 0.2)
    assert not is_close(tree_with((2.0, 10.0, True), (2.3, 11.0, True)), 0.2)
    assert not is_close(tree_with((2.0, 10.0, True), (2.1, 10.2, True)), 0.2)  # the same command
    assert not is_close(
        tree_with((2.0, 10.0, True), (2.1, 11.0, False)), 0.2
    )  # nothing better will come of it
    assert is_close(tree_with((2.0, 10.0, False), (2.1, 11.0, True)), 0.2)


def test_it_goes_on_while_it_is_close() -> None:
    some, close, clear = (
        Budget(1000, 2100, 0.2),
        tree_with((2.0, 10.0, True), (2.1, 12.0, True)),
        tree_with((2.0, 10.0, True), (3.0, 12.0, True)),
    )
    assert [next_passes(some, clear, made) for made in (0, 400, 1000)] == [1000, 600, 0]
    assert [next_passes(some, close, made) for made in (0, 400, 1000, 2000, 2100)] == [
        1000,
        600,
        250,
        100,
        0,
    ]
    assert next_passes(Budget(10**7, 10**7, 0.2), close, 0) == SLICE  # an interrupt is heard
    close.closed[0] = True
    assert next_passes(some, close, 0) == 0


def test_more_passes_are_made_in_a_close_decision_only() -> None:
    made = {}
    for name, toy in TOYS.items():
        decision = decide(
            toy, "planner.iterations=200", "planner.most_iterations=1000", "planner.close_cost=0.3"
        )
        made[name] = decision.iterations + decision.known
    assert min(made.values()) <= 200 < max(made.values()) <= 1000


# --- in time ---


def test_a_time_budget_is_no_budget_of_passes() -> None:
    assert passes_within(1000, math.inf) == 1000
    assert 2000 < passes_within(1000, 0.02) < passes_within(1000, 60.0) == budgets.LARGEST
    tree = tree_with((2.0, 10.0, True), (2.1, 12.0, True))
    assert (
        next_passes_in_time(tree, 0, 0.0, -1.0) == 2 * tree.child.shape[1]
    )  # an answer in any case
    assert next_passes_in_time(tree, 100, 0.001, 0.01) == 500
    assert next_passes_in_time(tree, 100, 0.001, 1e-9) == 1
    assert next_passes_in_time(tree, 100, 0.001, 0.0) == 0
    tree.closed[0] = True
    assert next_passes_in_time(tree, 100, 0.001, 0.01) == 0


@given(st.lists(st.floats(0.0, 0.3), min_size=1, max_size=60))
def test_the_margin_covers_what_came_after_earlier_searches(shares: list[float]) -> None:
    keeper, seen = Timekeeper(1.0), []
    for k, after in enumerate(shares):
        until = keeper.until(float(k))
        kept = float(k) + 1.0 - until
        assert 0.0 <= kept <= AT_MOST
        assert kept == pytest.approx(
            min(SPARE * max(seen[-budgets.MEMORY :]), AT_MOST) if seen else AT_FIRST
        )
        keeper.note(until, until + after)
        seen += [after] if until + after > until else []
    until = keeper.until(100.0)
    keeper.note(until, until - 0.1)
    assert keeper.until(100.0) == until  # who was done earlier tells nothing
    assert Timekeeper(math.inf).until(5.0) == math.inf


def timed(
    monkeypatch: pytest.MonkeyPatch, name: str, *sets: str
) -> tuple[dict[str, Any], list[float]]:
    """An episode on a clock that stands still while others have the processor: its row, and the
    times of its decisions in ms."""
    monkeypatch.setattr(time, "perf_counter", time.process_time)
    result = run_episode(config.load(builtin.scenario_path(name), sets), 1)
    return result.rows[0], [cycle.plan_ms for cycle in result.traces[0].cycles]


@pytest.mark.slow
@pytest.mark.parametrize("on", ["false", "true"])
def test_a_time_budget_is_for_the_whole_decision(on: str, monkeypatch: pytest.MonkeyPatch) -> None:
    row, times = timed(
        monkeypatch, "highway-exit", "planner.time_budget_ms=40", f"failsafe.on={on}"
    )
    assert row["outcome"] == "arrived" and row["iterations_per_decision"] is None
    assert row["deadline_misses"] == sum(ms > 40.0 for ms in times) <= 0.15 * row["cycles"]
    assert max(times) > 25.0  # the time is made use of
    assert row["iterations"] > 150 * row["cycles"]


@pytest.mark.slow
def test_what_comes_after_the_search_is_learned(monkeypatch: pytest.MonkeyPatch) -> None:
    children = mcts.root_candidates

    def slow(*arguments: Any) -> Any:
        end = time.process_time() + 0.02
        while time.process_time() < end:
            pass
        return children(*arguments)

    monkeypatch.setattr(mcts, "root_candidates", slow)
    row, times = timed(monkeypatch, "highway-exit", "planner.time_budget_ms=60")
    assert row["deadline_misses"] <= 0.15 * row["cycles"] and max(times[2:]) > 40.0


def test_there_is_an_answer_however_short_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    row, _ = timed(monkeypatch, "unprotected-left-turn", "planner.time_budget_ms=0.1")
    assert row["outcome"] in ("arrived", "timeout") and row["failsafe_interventions"] == 0
    assert (
        row["deadline_misses"] == row["cycles"] and row["iterations"] <= 4 * 2 * 15 * row["cycles"]
    )  # hypotheses, continuations, actions


@pytest.mark.slow
def test_a_deadline_that_is_kept_can_be_enforced(monkeypatch: pytest.MonkeyPatch) -> None:
    row, _ = timed(
        monkeypatch,
        "unprotected-left-turn",
        "planner.time_budget_ms=60",
        "planner.enforce_deadline=true",
    )
    assert (
        row["outcome"] == "arrived" and row["failsafe_interventions"] <= row["deadline_misses"] <= 3
    )  # one that is nearly late may be late only when all is told
