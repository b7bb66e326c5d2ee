"""What is wrong with a file is told in our words, not in those of the library that checks it."""

from typing import Any

import pytest
from pydantic import BaseModel, ValidationError

from sumo_mcts.config import build, json_schema
from sumo_mcts.config.problems import problems
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments.schema import Experiment

FINE: dict[str, Any] = {"name": "x", "sumo": {"net": "x.net.xml"}, "egos": [{"id": "ego"}]}
NOT_OURS = (
    "Input",
    "valid",
    "dictionary",
    "instance",
    "tuple",
    "integer",
    "string",
    "validation",
    "permitted",
    "parse",
    "Config",
    "Field",
)
NONSENSE = (3, -1, 0.5, "word", "", [], [3], {}, {"nonsense": 1}, None, True, float("nan"))


def keys(schema: dict[str, Any], definitions: dict[str, Any]) -> list[str]:
    """Every key of a scenario file, as `--set` names them."""
    found = []
    for name, part in schema["properties"].items():
        inner = definitions.get(part.get("$ref", "").rpartition("/")[2])
        found += (
            [name]
            if inner is None
            else [name, *(f"{name}.{below}" for below in keys(inner, definitions))]
        )
    return found


@pytest.mark.parametrize(
    "key",
    [
        key
        for key in keys(json_schema(), json_schema()["$defs"])
        if key not in ("base", "name", "sumo", "egos")
    ],
)
def test_scenario_files(key: str) -> None:
    for value in NONSENSE:
        data: dict[str, Any] = {**FINE, "sumo": dict(FINE["sumo"])}
        *parents, last = key.split(".")
        inner = data
        for parent in parents:
            inner = inner.setdefault(parent, {})
        inner[last] = value
        try:
            build(data, "x.yaml")
        except ConfigError as error:
            said = str(error)
            assert said.startswith("x.yaml: ")
            assert not [word for word in NOT_OURS if word in said.partition(", got ")[0]], said


@pytest.mark.parametrize("key", list(Experiment.model_fields))
def test_experiment_files(key: str) -> None:
    name = Experiment.model_fields[key].alias or key
    for value in NONSENSE:
        for said in told(Experiment, {"name": "x", "scenarios": ["straight-line"], name: value}):
            assert not [word for word in NOT_OURS if word in said.partition(", got ")[0]], said


def told(model: type[BaseModel], data: dict[str, Any]) -> list[str]:
    try:
        model.model_validate(data)
    except ValidationError as error:
        return problems(error, model)
    return []


def test_what_is_short_of_wrong_entries_is_not_told_twice() -> None:
    assert told(Experiment, {"name": "x", "scenarios": [3]}) == [
        "scenarios.0: has to be a mapping of keys, got 3"
    ]
    assert told(Experiment, {"name": 3, "scenarios": []}) == [
        "name: has to be a text, got 3",
        "scenarios: has to have at least 1 entry, got []",
    ]
