"""The built-in planners and predictors by name."""

from sumo_mcts.config import ORACLE_MARK, PLANNERS, PREDICTORS, ScenarioConfig, plugins
from sumo_mcts.driver.params import idm_params, mcts_params, paper_params
from sumo_mcts.planners.base import Planner
from sumo_mcts.planners.baselines import ConstantPlanner, IdmPlanner, RandomPlanner, SumoPlanner
from sumo_mcts.planners.exhaustive import ExhaustivePlanner
from sumo_mcts.planners.mcts import MctsPlanner
from sumo_mcts.planners.paper import PaperPlanner
from sumo_mcts.prediction.interface import Predictor

SEARCHING = ("mcts", "paper")  # planners that search a forecast
FORECASTING = (*SEARCHING, "idm", "random", "exhaustive")  # planners that read one


class PlannerError(Exception):
    """The planner, or a predictor of the user's own, does not start or failed too often in a row;
    the message is that of its last failure."""


def reads_forecast(config: ScenarioConfig) -> bool:
    """Whether the planner that a scenario names reads a forecast.

    Raises ConfigError where it is a plugin that cannot be loaded.
    """
    name = config.planner.name
    return (
        name in FORECASTING
        if name in PLANNERS
        else bool(getattr(plugins.loaded("planner.name", name), "needs_forecast", True))
    )


def prediction_label(config: ScenarioConfig) -> str:
    """What the scenario's predictor is called in results: a plugin that is an oracle is labelled.

    Raises ConfigError where it cannot be loaded.
    """
    name = config.prediction.name
    oracle = name not in PREDICTORS and getattr(
        plugins.loaded("prediction.name", name), "oracle", False
    )
    return f"{name}{ORACLE_MARK}" if oracle else name


def forecast_label(config: ScenarioConfig) -> str | None:
    """What the forecast is called that a scenario's planner reads;

    None: it reads none. Raises ConfigError where a plugin cannot be loaded.
    """
    return prediction_label(config) if reads_forecast(config) else None


def make_predictor(config: ScenarioConfig) -> Predictor | None:
    """The predictor of the user's own that a scenario names;

    None: one of ours. Raises ConfigError.
    """
    q = config.prediction
    if q.name in PREDICTORS:
        return None
    predictor: Predictor = plugins.made(
        "prediction.name", q.name, ("oracle", "start", "predict"), q.options, config
    )
    return predictor


def make_planner(config: ScenarioConfig) -> Planner:
    """The planner that a scenario names.

    Raises ConfigError where it is a plugin that cannot be made.
    """
    p = config.planner
    match p.name:
        case "sumo":
            return SumoPlanner()
        case "constant":
            return ConstantPlanner(p.period_s)
        case "idm":
            return IdmPlanner(idm_params(config), p.period_s)
        case "random":
            return RandomPlanner(mcts_params(config))
        case "exhaustive":
            return ExhaustivePlanner()
        case "paper":
            return PaperPlanner(paper_params(config))
        case "mcts":
            return MctsPlanner(mcts_params(config))
    planner: Planner = plugins.made(
        "planner.name", p.name, ("needs_forecast", "start", "plan"), p.options, config
    )
    return planner
