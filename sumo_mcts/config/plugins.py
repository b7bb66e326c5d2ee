"""Makes planners, predictors and cost terms from their names, and checks their members.

A plugin's name is that of an entry point of an installed package, or module:name. Whether the
latter may run is checked where a scenario is read (loading.py).
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
from sumo_mcts.registry import PLANNERS, PREDICTORS, code

_GROUPS = {
    "planner.name": PLANNER_GROUP,
    "prediction.name": PREDICTOR_GROUP,
    "cost.term": TERM_GROUP,
}  # by the key that names a plugin


def made(
    key: str,
    name: str,
    members: Sequence[str],
    options: Mapping[str, Any],
    scenario: ScenarioConfig,
) -> Any:
    """The planner or predictor of this name, from its class or another factory.

    A plugin has to have the `members`. Raises ConfigError.
    """
    built_in = PLANNERS.get(name) if key == "planner.name" else PREDICTORS.get(name)
    if built_in is not None:
        return code(built_in.make)(options, scenario)
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


def loaded(key: str, name: str) -> Any:
    """The code behind a plugin's name. Raises ConfigError."""
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


def described(scenario: ScenarioConfig) -> list[dict[str, Any]]:
    """For a manifest: the plugins of a scenario, each with its code, the SHA-256 of its file, and
    the package and version of its entry point."""
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
    """SHA-256 of a module's file; None where it has none, which loaded() reports."""
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
