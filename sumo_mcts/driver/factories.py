"""The planner and the predictor that a scenario names, built-in or plugin, and how results name
its forecast."""

from sumo_mcts.config import ScenarioConfig, plugins
from sumo_mcts.planners.base import Planner
from sumo_mcts.prediction.interface import Predictor
from sumo_mcts.registry import ORACLE_MARK, PLANNERS, PREDICTORS, PlannerRow, code

_PLUGIN = PlannerRow(name="", make="")  # the row of a plugin holds the defaults only


def make_planner(config: ScenarioConfig) -> Planner:
    """The planner that a scenario names.

    Raises ConfigError where it is a plugin that cannot be made.
    """
    p = config.planner
    planner: Planner = plugins.made(
        "planner.name", p.name, ("needs_forecast", "start", "plan"), p.options, config
    )
    return planner


def make_predictor(config: ScenarioConfig, name: str | None = None) -> Predictor:
    """The predictor of this name; by default the one that a scenario names.

    Raises ConfigError where it is a plugin that cannot be made.
    """
    q = config.prediction
    predictor: Predictor = plugins.made(
        "prediction.name", name or q.name, ("oracle", "start", "predict"), q.options, config
    )
    return predictor


def forecast_s(config: ScenarioConfig, step: float, forecast_step: float) -> float:
    """How long a forecast a scenario's planner needs, s.

    `step`: of the simulation, `forecast_step`: between the states of the forecast, s.
    """
    row = PLANNERS.get(config.planner.name, _PLUGIN)
    return float(code(row.forecast)(config, step, forecast_step))


def reads_forecast(config: ScenarioConfig) -> bool:
    """Whether a scenario's planner reads a forecast.

    Raises ConfigError where it is a plugin that cannot be loaded.
    """
    name = config.planner.name
    if name in PLANNERS:
        return PLANNERS[name].reads_forecast
    return bool(getattr(plugins.loaded("planner.name", name), "needs_forecast", True))


def prediction_label(config: ScenarioConfig) -> str:
    """What results call a scenario's predictor: its name, and a mark if it is a plugin and an
    oracle. Raises ConfigError where it cannot be loaded."""
    name = config.prediction.name
    if name in PREDICTORS:
        return name
    oracle = getattr(plugins.loaded("prediction.name", name), "oracle", False)
    return f"{name}{ORACLE_MARK}" if oracle else name


def forecast_label(config: ScenarioConfig) -> str | None:
    """What results call the forecast that a scenario's planner reads; None: it reads none.

    Raises ConfigError where a plugin cannot be loaded.
    """
    return prediction_label(config) if reads_forecast(config) else None
