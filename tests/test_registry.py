"""Each row of the registry says of its planner or predictor what is true of it."""

import pytest
from helpers_model import scenario

from sumo_mcts.driver.factories import forecast_s, make_planner, make_predictor, reads_forecast
from sumo_mcts.planners.base import Planner
from sumo_mcts.prediction.interface import Oracles, Predictor
from sumo_mcts.registry import (
    ORACLE_MARK,
    PLANNERS,
    PLUGIN_RANK,
    PREDICTORS,
    asks,
    is_oracle,
    searches,
    without,
)
from sumo_mcts.reporting.explanation_words import REASONS
from sumo_mcts.reporting.results import planner_rank


@pytest.mark.parametrize("name", PLANNERS)
def test_a_planner_is_what_its_row_says(name: str) -> None:
    config = scenario(f"planner.name={name}")
    planner: Planner = make_planner(config)
    assert planner.needs_forecast == reads_forecast(config) == PLANNERS[name].reads_forecast
    assert all(callable(getattr(planner, member)) for member in ("start", "plan"))
    assert 1.0 < forecast_s(config, 0.1, 0.2) < 30.0
    assert hasattr(config, PLANNERS[name].section)
    assert planner_rank(name) == PLANNERS[name].rank != PLUGIN_RANK


@pytest.mark.parametrize("name", PREDICTORS)
def test_a_predictor_is_what_its_row_says(name: str) -> None:
    predictor: Predictor = make_predictor(scenario(), name)
    row = PREDICTORS[name]
    assert predictor.oracle == is_oracle(name) == (row.oracle is not None)
    assert row.oracle is None or (row.oracle in Oracles._fields and row.label)


def test_tables_show_planners_in_one_order() -> None:
    ranks = [row.rank for row in PLANNERS.values()]
    assert len(set(ranks)) == len(ranks)
    assert sorted(PLANNERS, key=planner_rank)[:2] == ["mcts", "paper"]
    assert planner_rank(None) == planner_rank("mine") == PLUGIN_RANK


def test_the_horizon_is_that_of_the_planners_own_section() -> None:
    short = ("planner.look_ahead_steps=1", "paper.look_ahead_steps=2", "paper.step_s=0.5")
    rest = ("planner.rollout_steps=1", "paper.rollout_steps=1", "planner.step_s=1.0")
    of = {
        name: forecast_s(scenario(f"planner.name={name}", *short, *rest), 0.1, 0.2)
        for name in PLANNERS
    }
    claim_s = scenario().cost.claim_s
    assert of["paper"] == pytest.approx(3 * 0.5 + 0.2)
    assert of["mcts"] == of["idm"] == of["sumo"] == pytest.approx(2 * 1.0 + claim_s + 0.2)
    assert of["exhaustive"] > of["mcts"]


def test_names_that_have_no_row() -> None:
    assert not searches("mine:Planner") and not asks("mine:Predictor", "clone")
    assert is_oracle(f"mine:Predictor{ORACLE_MARK}")
    assert not is_oracle("mine:Predictor") and not is_oracle(None)


def test_predictors_by_what_they_ask() -> None:
    free = without("script", "clone")
    assert (
        {"idm", "constant_velocity", "routes"} <= set(free) <= set(PREDICTORS) - {"script", "clone"}
    )
    assert [name for name in PREDICTORS if asks(name, "clone")] == ["clone"]


def test_planners_that_weigh_no_actions_say_what_they_go_by() -> None:
    named = {name for name in PLANNERS if name in REASONS}
    assert named >= {"idm", "random", "constant", "exhaustive"} and not named & {"mcts", "sumo"}
