"""Planners, predictors and cost terms of the user's own: what is behind their names, made, and
asked whether it has what it needs.

A name is that of an entry point of an installed package, or module:name. Whether the latter may run
is asked where a scenario is read (config.py).
"""

import hashlib
import importlib.util
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from sumo_mcts.config.loading import plugin_names
from sumo_mcts.config.names import PLANNER_GROUP, PREDICTOR_GROUP, TERM_GROUP
from sumo_mcts.config.schema import ScenarioConfig
from sumo_mcts.errors import ConfigError, in_one_line

_GROUPS = {
    "planner.name": PLANNER_GROUP,
    "prediction.name": PREDICTOR_GROUP,
    "cost.term": TERM_GROUP,
}  # by the key that names a plugin


def loaded(key: str, name: str) -> Any:
    """What is behind a name. Raises ConfigError."""
    point = _entry_point(key, name)
    try:
        module = importlib.import_module(point.module)
    except Exception as error:  # whatever an import may do
        raise ConfigError(
            f"{key}: {name}: {point.module} cannot be imported: {in_one_line(error)}"
        ) from None
    if not hasattr(module, point.attr):
        raise ConfigError(f"{key}: {name}: {point.module} has no {point.attr}")
    return getattr(module, point.attr)


def made(
    key: str,
    name: str,
    members: Sequence[str],
    options: Mapping[str, Any],
    scenario: ScenarioConfig,
) -> Any:
    """A plugin's object, from its class or another factory, with the `members` that it has to have.

    Raises ConfigError.
    """
    factory = loaded(key, name)
    try:
        plugin = factory(dict(options), scenario)
    except Exception as error:  # whatever a constructor may do
        raise ConfigError(
            f"{key}: {name}: does not take {key.partition('.')[0]}.options {dict(options)}: "
            f"{in_one_line(error)}"
        ) from None
    missing = [member for member in members if not hasattr(plugin, member)]
    if missing:
        raise ConfigError(
            f"{key}: {name}: lacks {', '.join(missing)}; it needs {', '.join(members)}"
        )
    return plugin


def described(scenario: ScenarioConfig) -> list[dict[str, Any]]:
    """For a manifest: the plugins that a scenario names, the code behind each, SHA-256 of the file
    with that code, and the package and version that an entry point belongs to."""
    return [_description(key, name) for key, name in plugin_names(scenario)]


def _entry_point(key: str, name: str) -> metadata.EntryPoint:
    group = _GROUPS[key]
    if ":" in name:
        return metadata.EntryPoint(name, name, group)
    found = metadata.entry_points(group=group, name=name)
    if not found:
        raise ConfigError(f"{key}: {name}: no such plugin is installed")
    if len({point.value for point in found}) > 1:
        raise ConfigError(
            f"{key}: {name}: several packages have a plugin of this name: "
            f"{', '.join(sorted(point.value for point in found))}"
        )
    return next(iter(found))


def _description(key: str, name: str) -> dict[str, Any]:
    point = _entry_point(key, name)
    package = (
        None if point.dist is None else {"name": point.dist.name, "version": point.dist.version}
    )
    return {
        "key": key,
        "name": name,
        "code": point.value,
        "file_digest": _file_digest(point.module),
        "package": package,
    }


def _file_digest(module: str) -> str | None:
    """SHA-256 of the file that a module comes from;

    None where there is none such, which is told when the plugin is loaded.
    """
    try:
        found = importlib.util.find_spec(module)
    except Exception:  # whatever the import of the package around it may do
        found = None
    path = None if found is None or found.origin is None else Path(found.origin)
    return (
        hashlib.sha256(path.read_bytes()).hexdigest()
        if path is not None and path.is_file()
        else None
    )
