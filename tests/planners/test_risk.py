"""One cost out of several hypotheses, and what the planner makes of it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import Agent, crossing, ego_at, lane
from helpers_model import scenario, scene_of, situation_of, task_of, traffic_params
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sumo_mcts.arrays import Floats
from sumo_mcts.config import load
from sumo_mcts.config.builtin import scenario_path
from sumo_mcts.driver.factories import make_planner
from sumo_mcts.episode import run_episode
from sumo_mcts.planners.base import Situation, Task
from sumo_mcts.planners.risk import risk, shares
from sumo_mcts.prediction.forecast import Question, predict
from sumo_mcts.prediction.hypotheses import together
from sumo_mcts.records import load_trace, save_trace
from sumo_mcts.reporting.storyboard import storyboard
from sumo_mcts.scene import FORCES, Decision, Follow, Intent

ROAD = crossing(bridge=False)


def cvar_of(costs: Floats, weight: Floats, share: float) -> float:
    """The definition: the least threshold + mean excess over it / share; the least is attained at
    one of the costs (Rockafellar and Uryasev)."""
    return min(
        threshold + float(weight @ np.maximum(costs - threshold, 0.0)) / share
        for threshold in costs
    )


costs_of = arrays(
    np.float64, st.tuples(st.integers(1, 5), st.integers(1, 5)), elements=st.floats(0.0, 100.0)
)


@given(costs_of, st.lists(st.floats(0.0, 1.0), min_size=5, max_size=5), st.floats(0.01, 1.0))
def test_risk_is_the_conditional_value_at_risk(
    cost: Floats, weights: list[float], share: float
) -> None:
    weight = np.array(weights[: cost.shape[1]])
    assume(weight.sum() > 0.1)
    weight /= weight.sum()
    found = risk(cost, weight, share)
    assert found == pytest.approx([cvar_of(row, weight, share) for row in cost], abs=1e-6)
    assert risk(cost, weight, 1.0) == pytest.approx(cost @ weight)
    assert np.all(found >= risk(cost, weight, 1.0) - 1e-6)
    assert np.all(found <= cost.max(axis=1) + 1e-9)


@given(costs_of, st.floats(0.01, 1.0))
def test_certainty_is_the_single_hypothesis(cost: Floats, share: float) -> None:
    certain = np.zeros(cost.shape[1])
    certain[0] = 1.0
    assert risk(cost, certain, share) == pytest.approx(cost[:, 0])
    assert np.array_equal(risk(cost[:, :1], certain[:1], share), cost[:, 0])  # to the bit


@given(
    st.lists(st.floats(0.01, 1.0), min_size=1, max_size=8), st.integers(1, 3000), st.integers(1, 20)
)
def test_effort(weights: list[float], iterations: int, actions: int) -> None:
    weight = np.array(sorted(weights, reverse=True)) / sum(weights)
    share = shares(weight, iterations, actions)
    assert share.sum() == pytest.approx(1.0) and np.all(np.diff(share) <= 1e-12)
    assert 1 <= len(share) <= len(weight)
    assert len(share) == 1 or share.min() * iterations >= actions - 1e-6
    if iterations >= 4 * actions * len(weight):
        assert len(share) == len(weight)


def uncertain(task: Task, scene: Any, odds: float) -> Situation:
    """A car that has to let the ego pass does (odds 1), or does not."""
    lanes = np.array([lane(ROAD, name) for name in ("wi_0", ":we_0", "eo_0")], np.int32)
    question = Question(scene, lanes, np.zeros(0), traffic_params(), 10.0)
    forecasts = [
        predict(ROAD, question, intent=intent) for intent in (Intent(0, 0), Intent(0, FORCES))
    ]
    return situation_of(task, scene)._replace(forecast=together(forecasts, [1.0, odds]))


def decided(odds: float, *sets: str, s: float = 42.0) -> tuple[Decision, float]:
    """What an ego with the right of way does about a car from the south at s, and its speed after
    the first second."""
    ego = ego_at(ROAD, "wi_0", 40.0, 12.0, route=(0, 2))
    config = scenario(*sets)
    task = task_of(ROAD, ego, config)
    scene = scene_of(ego, ROAD, Agent("n", "si_0", s, 11.0))
    planner = make_planner(config)
    planner.start(task, 1)
    decision = planner.plan(uncertain(task, scene, odds))
    assert isinstance(decision.command, Follow)
    return decision, float(decision.command.speeds[9])


CVAR = ("planner.risk=cvar", "planner.cvar_alpha=0.1")


def test_an_ego_that_may_not_be_let_pass_waits() -> None:
    trusting, careful = decided(1e-9)[1], decided(0.3, *CVAR)[1]
    assert trusting > 11.5  # it has the right of way
    assert careful < trusting - 1.0
    assert decided(0.01, *CVAR)[1] <= decided(0.01)[1]  # and the more careful, the slower


def test_it_goes_where_it_is_safe_either_way() -> None:
    assert decided(0.9, *CVAR, s=5.0)[1] > 11.5  # it could not be there in time, whatever it does


def test_a_hypothesis_without_weight_does_not_count() -> None:
    alone, weightless = decided(0.0)[0], decided(1e-12)[0]
    assert weightless.children[weightless.chosen].best == pytest.approx(
        min(child.best for child in alone.children), abs=0.5
    )


def test_passes_are_shared() -> None:
    for iterations in (20, 200, 1000):
        decision, _ = decided(0.3, f"planner.iterations={iterations}")
        assert decision.iterations + decision.known <= iterations + 1
        assert decision.children[decision.chosen].best == min(
            child.best for child in decision.children
        )


def test_the_same_seed_gives_the_same_decision() -> None:
    first, second = (decided(0.3, *CVAR)[0] for _ in range(2))
    assert (
        np.array_equal(first.plan.v, second.plan.v)
        if first.plan is not None and second.plan is not None
        else False
    )
    assert [child.best for child in first.children] == [child.best for child in second.children]


def test_the_same_seed_gives_the_same_episode() -> None:
    several = load(
        scenario_path("unprotected-left-turn"),
        (
            "prediction.hypotheses=3",
            "planner.risk=cvar",
            "planner.iterations=200",
            "episode.stop_time_s=8",
        ),
    )
    first, second = (run_episode(several, 4).rows[0] for _ in range(2))
    assert first["trace_digest"] == second["trace_digest"]
    one = several.model_copy(
        update={"prediction": several.prediction.model_copy(update={"hypotheses": 1})}
    )
    assert run_episode(one, 4).rows[0]["trace_digest"] != first["trace_digest"]


@pytest.mark.parametrize(
    "sets",
    [
        ("planner.name=paper",),
        ("planner.name=idm",),
        ("planner.name=random",),
        ("failsafe.on=true",),
    ],
)
def test_others_are_told_the_likeliest_and_all_can_be_drawn(
    sets: tuple[str, ...], tmp_path: Path
) -> None:
    config = load(
        scenario_path("unprotected-left-turn"),
        ("prediction.hypotheses=3", "planner.iterations=100", "episode.stop_time_s=5", *sets),
    )
    result = run_episode(config, 4)
    assert result.rows[0]["outcome"] == "timeout" and result.rows[0]["error"] is None
    path = tmp_path / "trace.npz"
    save_trace(path, result.traces[0])
    trace = load_trace(path)
    assert (max(len(cycle.forecast.weight) for cycle in trace.cycles) > 1) == (
        config.planner.name == "mcts"
    )
    assert all(
        cycle.forecast.yields.shape == (len(cycle.forecast.weight), len(cycle.agents.ids))
        for cycle in trace.cycles
    )
    storyboard(trace, tmp_path / "storyboard.png")
    assert (tmp_path / "storyboard.png").stat().st_size > 1000
