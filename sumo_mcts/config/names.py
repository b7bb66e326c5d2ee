"""The names of planners, predictors and cost terms that a scenario may hold: built-in ones
(registry.py), installed ones, and code as module:name."""

import re
from collections.abc import Collection
from importlib import metadata
from typing import Annotated

from pydantic import AfterValidator, WithJsonSchema

from sumo_mcts.registry import PLANNERS, PREDICTORS

# Where installed packages name planners, predictors and cost terms of their own (entry points).
PLANNER_GROUP, PREDICTOR_GROUP, TERM_GROUP = (
    "sumo_mcts.planners",
    "sumo_mcts.predictors",
    "sumo_mcts.cost_terms",
)
_CODE = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")


def _or_plugin(builtin: Collection[str], group: str) -> tuple[AfterValidator, WithJsonSchema]:
    """What checks and describes a name: a built-in one or a plugin's."""
    any_name = {"type": "string"}
    schema = (
        {"anyOf": [{"type": "string", "enum": list(builtin)}, any_name]} if builtin else any_name
    )
    return AfterValidator(lambda name: _checked(name, builtin, group)), WithJsonSchema(schema)


def _checked(name: str, builtin: Collection[str], group: str) -> str:
    """The name, if it is a built-in one or a plugin's. Raises ValueError."""
    if name in builtin or is_plugin(name, group):
        return name
    names = "".join(f"{each!r}, " for each in builtin)
    raise ValueError(
        f"has to be {names}an installed plugin ({', '.join(_installed(group)) or 'there is none'}) "
        "or module:name"
    )


def is_plugin(name: str, group: str) -> bool:
    """Whether a name is that of an installed plugin, or code as module:name."""
    return _CODE.fullmatch(name) is not None or name in _installed(group)


def _installed(group: str) -> list[str]:
    return sorted(metadata.entry_points(group=group).names)


PlannerName = Annotated[str, *_or_plugin(PLANNERS, PLANNER_GROUP)]
PredictorName = Annotated[str, *_or_plugin(PREDICTORS, PREDICTOR_GROUP)]
TermName = Annotated[str, *_or_plugin((), TERM_GROUP)]
