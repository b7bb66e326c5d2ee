"""The words for what is wrong with a scenario: one line that says what is allowed."""

import sys
from operator import index
from typing import Any, SupportsIndex

from pydantic import BaseModel, ValidationError

from sumo_mcts.errors import ConfigError, shown

_LARGEST = sys.float_info.max


def whole(key: str, value: object, least: int) -> int:
    """A whole number from `least` on, as an argument of a function. Raises ConfigError."""
    number = (
        None if isinstance(value, bool) or not isinstance(value, SupportsIndex) else index(value)
    )
    if number is None or number < least:
        raise ConfigError(f"{key}: a whole number from {least} on, got {shown(value)}")
    return number


def positive(key: str, value: object) -> float:
    """A number above 0, as an argument of a function. Raises ConfigError."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value <= _LARGEST:
        raise ConfigError(f"{key}: a number greater than 0, got {shown(value)}")
    return float(value)


# What is allowed, by the beginning of the type of pydantic's error, and with its parameters.
_ALLOWED = {
    "model": "a mapping of keys", "dict": "a mapping of keys", "tuple": "a list", "list": "a list",
    "string_type": "a text", "int": "a whole number",
    "float": "a number", "finite": "a finite number", "bool": "true or false",
    "literal": "{expected}", "string_pattern": "a text like {pattern}",
    "string_too_short": "a text of at least {min_length} characters",
    "string_too_long": "a text of at most {max_length} characters",
    "string_unicode": "a text in Unicode",
    "greater_than_equal": "at least {ge}", "greater_than": "greater than {gt}",
    "less_than_equal": "at most {le}", "less_than": "less than {lt}",
}  # fmt: skip


def refused(error: ValidationError, model: type[BaseModel], origin: str) -> ConfigError:
    """An error about the input for a model. It names the first mistake, and holds all of them in
    `every`."""
    lines = [f"{origin}: {line}" for line in problems(error, model)]
    return ConfigError(
        lines[0] + (f" (and {len(lines) - 1} more)" if len(lines) > 1 else ""), lines
    )


def problems(error: ValidationError, model: type[BaseModel]) -> list[str]:
    """A line for each thing that is wrong: key, what is allowed, what was given."""
    found = error.errors()
    around = {each["loc"][:k] for each in found for k in range(len(each["loc"]))}
    # a list that is too short because its entries are wrong is left out
    return [
        _problem(each, model)
        for each in found
        if each["type"] != "too_short" or each["loc"] not in around
    ]


def _problem(found: Any, model: type[BaseModel]) -> str:
    key = ".".join(str(part) for part in found["loc"] if part != "[key]") or "scenario"
    given = (
        ""
        if found["type"] in ("missing", "extra_forbidden")
        or isinstance(found["input"], dict | BaseModel)
        else f", got {shown(found['input'])}"
    )
    return f"{key}: {_in_words(found, model)}{given}"


def _in_words(problem: Any, model: type[BaseModel]) -> str:
    """What one of pydantic's errors says."""
    kind, parameters = (
        problem["type"],
        {
            key: int(x) if isinstance(x, float) and x.is_integer() else x
            for key, x in problem.get("ctx", {}).items()
        },
    )
    match kind:
        case "extra_forbidden":
            return "unknown key" + _allowed_beside(problem["loc"], model)
        case "missing":
            return "has to be given"
        case "too_short":
            return (
                f"has to have at least {parameters['min_length']} "
                f"entr{'y' if parameters['min_length'] == 1 else 'ies'}"
            )
        case "too_long":
            return f"has to have at most {parameters['max_length']} entries"
        case "value_error":
            return str(parameters["error"])
    allowed = next((words for begin, words in _ALLOWED.items() if kind.startswith(begin)), None)
    return problem["msg"] if allowed is None else f"has to be {allowed.format_map(parameters)}"


def _allowed_beside(location: tuple[int | str, ...], model: Any) -> str:
    """The keys allowed where an unknown one stood."""
    for part in location[:-1]:
        if isinstance(part, int):
            continue
        field = model.model_fields.get(part)
        kinds = (
            () if field is None else (field.annotation, *getattr(field.annotation, "__args__", ()))
        )
        plain = [getattr(kind, "__origin__", kind) for kind in kinds]  # Annotated[A, ...] is an A
        inner = [kind for kind in plain if isinstance(kind, type) and issubclass(kind, BaseModel)]
        if not inner:
            return ""
        model = inner[0]
    return "; allowed: " + ", ".join(
        field.alias or name for name, field in model.model_fields.items()
    )
