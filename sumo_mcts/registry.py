"""The built-in planners and predictors, a row for each. All that depends on their names reads it.

It imports nothing heavy: code is named as module:name and imported when it is needed.
"""

from collections.abc import Mapping
from importlib import import_module
from typing import Any, Literal, NamedTuple

ORACLE_MARK = " (oracle)"  # results write it behind the name of a plugin that is an oracle
PLUGIN_RANK = 3  # the rank of planners that have none of their own: plugins


class PlannerRow(NamedTuple):
    """A planner."""

    name: str
    make: str  # its factory (options, scenario) -> Planner, as a plugin has it
    searches: bool = False  # its decisions take a budget: `planner.iterations` or a time
    reads_forecast: bool = True
    drives: bool = True  # False: it leaves the ego to SUMO
    warm_starts: bool = (
        False  # root children: first car following, last (not visited) the warm start
    )
    section: str = "planner"  # of a scenario, with the steps of its look-ahead
    # (scenario, step of SUMO (s), step of the forecast (s)) -> s of forecast that it needs
    forecast: str = "sumo_mcts.planners.mcts:forecast_s"
    label: str = ""  # `explain`: the reason of decisions that give only the planner's name
    rank: int = PLUGIN_RANK  # its place in tables of results, ascending
    colour: str = ""  # CSS; "": that of all planners without a colour of their own


class PredictorRow(NamedTuple):
    """A predictor."""

    name: str
    make: str  # its factory (options, scenario) -> Predictor, as a plugin has it
    # an oracle: the question that it asks of prediction/interface.py::Oracles
    oracle: Literal["lanes", "script", "clone"] | None = None
    label: str = ""  # of an oracle: its answers, in the description of `prediction.name`
    rank: int = 1  # its place where predictors are compared, ascending


_PLANNERS = (
    PlannerRow(
        name="mcts",
        make="sumo_mcts.planners.mcts:make",
        searches=True,
        warm_starts=True,
        rank=0,
        colour="var(--ego)",
    ),
    PlannerRow(
        name="paper",
        make="sumo_mcts.planners.paper:make",
        searches=True,
        section="paper",
        forecast="sumo_mcts.planners.paper:forecast_s",
        rank=1,
        colour="light-dark(#c2510c, #ff9a5c)",
    ),
    PlannerRow(
        name="idm",
        make="sumo_mcts.planners.baselines:make_idm",
        label="car following and gap acceptance; no action is weighed",
        rank=4,
        colour="light-dark(#0a7d62, #3ccba5)",
    ),
    PlannerRow(
        name="random",
        make="sumo_mcts.planners.baselines:make_random",
        label="drawn",
        rank=5,
        colour="light-dark(#8c6a00, #e2ba3a)",
    ),
    PlannerRow(
        name="sumo",
        make="sumo_mcts.planners.baselines:make_sumo",
        reads_forecast=False,
        drives=False,
        rank=7,
        colour="light-dark(#6b7380, #98a2b0)",
    ),
    PlannerRow(
        name="constant",
        make="sumo_mcts.planners.baselines:make_constant",
        reads_forecast=False,
        label="the speed of the take-over is held; other agents are ignored",
        rank=6,
        colour="light-dark(#9c3f86, #e08cc8)",
    ),
    PlannerRow(
        name="exhaustive",
        make="sumo_mcts.planners.exhaustive:make",
        forecast="sumo_mcts.planners.exhaustive:forecast_s",
        label="the optimum of the reference problem",
        rank=2,
        colour="light-dark(#1886a8, #5cc8ea)",
    ),
)

_PREDICTORS = (
    PredictorRow(name="idm", make="sumo_mcts.prediction.predictors:Idm"),
    PredictorRow(
        name="constant_velocity",
        make="sumo_mcts.prediction.predictors:ConstantVelocity",
        rank=0,
    ),
    PredictorRow(
        name="routes",
        make="sumo_mcts.prediction.predictors:Routes",
        oracle="lanes",
        label="idm along the agents' true next lanes",
    ),
    PredictorRow(
        name="script",
        make="sumo_mcts.prediction.predictors:Scripts",
        oracle="script",
        label="the scripts of a scripted scene",
    ),
    PredictorRow(
        name="clone",
        make="sumo_mcts.prediction.predictors:Clone",
        oracle="clone",
        label="what a copy of the running simulation does, on Linux without a window",
    ),
)

# By name, in the order in which messages list them: new rows come last.
PLANNERS: Mapping[str, PlannerRow] = {row.name: row for row in _PLANNERS}
PREDICTORS: Mapping[str, PredictorRow] = {row.name: row for row in _PREDICTORS}
ORACLES = tuple(row.name for row in _PREDICTORS if row.oracle is not None)
SENSED = tuple(row.name for row in _PREDICTORS if row.oracle is None)  # predictors without oracle


def searches(planner: str) -> bool:
    """Whether it is a built-in planner that searches."""
    return planner in PLANNERS and PLANNERS[planner].searches


def asks(predictor: str, question: str) -> bool:
    """Whether a predictor is a built-in oracle that asks this question of Oracles."""
    return predictor in PREDICTORS and PREDICTORS[predictor].oracle == question


def is_oracle(prediction: str | None) -> bool:
    """Whether a forecast, by its name in results, uses an oracle."""
    return prediction is not None and (prediction in ORACLES or prediction.endswith(ORACLE_MARK))


def without(*questions: str) -> list[str]:
    """The built-in predictors that ask oracles none of these questions."""
    return [row.name for row in PREDICTORS.values() if row.oracle not in questions]


def code(name: str) -> Any:
    """The object that is named as module:name."""
    module, _, attribute = name.partition(":")
    return getattr(import_module(module), attribute)
