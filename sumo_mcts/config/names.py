"""The names of planners, predictors and cost terms that a scenario may hold: built-in ones,
installed ones, and code by name."""

import re
from importlib import metadata
from typing import Annotated

from pydantic import AfterValidator, WithJsonSchema

PLANNERS = ("mcts", "paper", "idm", "random", "sumo", "constant", "exhaustive")
PREDICTORS = ("idm", "constant_velocity", "routes", "script", "clone")
ORACLES = ("routes", "script", "clone")  # of these, those that know what no sensor sees;
ORACLE_MARK = " (oracle)"  # one of the user's own has this behind its name wherever results name it

# Where installed packages name planners, predictors and cost terms of their own (entry points).
PLANNER_GROUP, PREDICTOR_GROUP, TERM_GROUP = (
    "sumo_mcts.planners",
    "sumo_mcts.predictors",
    "sumo_mcts.cost_terms",
)
_CODE = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")


def _or_plugin(builtin: tuple[str, ...], group: str) -> tuple[AfterValidator, WithJsonSchema]:
    """The type of a name of ours, or of a plugin's."""
    any_name = {"type": "string"}
    schema = (
        {"anyOf": [{"type": "string", "enum": list(builtin)}, any_name]} if builtin else any_name
    )
    return AfterValidator(lambda name: _known(name, builtin, group)), WithJsonSchema(schema)


def _known(name: str, builtin: tuple[str, ...], group: str) -> str:
    """The name, if it is ours or a plugin's. Raises ValueError."""
    if name in builtin or is_plugin(name, group):
        return name
    ours = f"{', '.join(map(repr, builtin))}, " if builtin else ""
    raise ValueError(
        f"has to be {ours}an installed plugin ({', '.join(_installed(group)) or 'there is none'}) "
        "or module:name"
    )


def is_plugin(name: str, group: str) -> bool:
    """Whether a name is that of an installed plugin, or code of the user's own as module:name."""
    return _CODE.fullmatch(name) is not None or name in _installed(group)


def _installed(group: str) -> list[str]:
    return sorted(metadata.entry_points(group=group).names)


PlannerName = Annotated[str, *_or_plugin(PLANNERS, PLANNER_GROUP)]
PredictorName = Annotated[str, *_or_plugin(PREDICTORS, PREDICTOR_GROUP)]
TermName = Annotated[str, *_or_plugin((), TERM_GROUP)]


def is_oracle(prediction: str | None) -> bool:
    """Whether a forecast, as results name it, knows what no sensor sees."""
    return prediction is not None and (prediction in ORACLES or prediction.endswith(ORACLE_MARK))
