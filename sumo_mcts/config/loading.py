"""From a scenario file, or a mapping, to a ScenarioConfig: base, settings, checks."""

import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from sumo_mcts import files
from sumo_mcts.config import builtin, yaml_file
from sumo_mcts.config.problems import refused
from sumo_mcts.config.schema import ScenarioConfig
from sumo_mcts.config.yaml_file import YamlError
from sumo_mcts.errors import ConfigError, shown
from sumo_mcts.registry import PLANNERS, PREDICTORS

MOST_BASES = 20  # scenario files laid over each other


def load(
    path: Path,
    overrides: tuple[str, ...] = (),
    *,
    changes: Mapping[str, Any] | None = None,
    allow_plugins: bool = False,
) -> ScenarioConfig:
    """The scenario in a file.

    `overrides` are `a.b=c` assignments, `changes` are values by key. Names of files become
    absolute. Raises ConfigError, also where the file names code of the user's own (module:name) and
    that is not allowed.
    """
    return build(
        _read(path, ()), str(path), overrides, changes=changes, allow_plugins=allow_plugins
    )


def build(
    data: dict[str, Any],
    origin: str,
    overrides: tuple[str, ...] = (),
    *,
    changes: Mapping[str, Any] | None = None,
    allow_plugins: bool = False,
) -> ScenarioConfig:
    """The scenario in a mapping, checked as `load` checks a file.

    `origin` stands in error messages. Raises ConfigError.
    """
    for override in overrides:
        _assign(data, *_assignment(override), f"--set {override}")
    for key, value in (changes or {}).items():
        _assign(data, key, value, f"{origin}: {key}")
    try:
        scenario = ScenarioConfig.model_validate(data)
    except ValidationError as error:
        raise refused(error, ScenarioConfig, origin) from None
    for key, name in plugin_names(scenario):
        require_permission(f"{origin}: {key}", name, allow_plugins)
    return scenario


def parsed(path: Path) -> Any:
    """What a file in YAML says. Raises ConfigError."""
    try:
        return yaml_file.read(path)
    except YamlError as error:
        raise ConfigError(f"{path}: not valid YAML: {error}") from None
    except OSError as error:
        raise ConfigError(f"{path}: {unreadable(error)}") from None


def unreadable(error: OSError) -> str:
    """Why a file cannot be read, in a few words."""
    words = error.strerror or str(error)
    return words if words.startswith(("no such", "cannot")) else f"cannot be read: {words}"


def name_from(path: Path) -> str:
    """The name of a scenario that has nothing but a file: safe as a file name."""
    stem = re.sub(r"[^A-Za-z0-9_-]", "_", path.stem)[:100]
    return stem if stem[:1].isalnum() else f"net{stem}"[:100]


def require_scenario(function: str, config: object) -> None:
    """Raise ConfigError where an argument is not a scenario but, for example, its name."""
    if not isinstance(config, ScenarioConfig):
        raise ConfigError(
            f"{function}: config: a scenario, as load_scenario returns it, got {config!r:.60}"
        )


def plugin_names(scenario: ScenarioConfig) -> Iterator[tuple[str, str]]:
    """Key and name of every plugin that a scenario names."""
    if scenario.planner.name not in PLANNERS:
        yield "planner.name", scenario.planner.name
    if scenario.prediction.name not in PREDICTORS:
        yield "prediction.name", scenario.prediction.name
    if scenario.cost.term is not None:
        yield "cost.term", scenario.cost.term


def require_permission(key: str, name: str, allow_plugins: bool) -> None:
    """Raise ConfigError where a name is code and code is not allowed.

    A file that comes from elsewhere must not run code. An installed plugin may run.
    """
    if ":" in name and not allow_plugins:
        raise ConfigError(
            f"{key}: {name}: code that a scenario names runs only with --allow-plugins"
        )


def digest(config: BaseModel, sections: Iterable[str] | None = None) -> str:
    """SHA-256 of the resolved configuration, or of some sections of it.

    File names count without their folders.
    """
    data = config.model_dump(mode="json", include=None if sections is None else set(sections))
    sumo = data.get("sumo", {})
    for key in ("sumocfg", "net"):
        sumo[key] = Path(sumo[key]).name if sumo.get(key) else None
    for key in ("routes", "additional"):
        sumo[key] = [Path(p).name for p in sumo.get(key, [])]
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def json_schema() -> dict[str, Any]:
    """The JSON schema of a scenario file."""
    schema = ScenarioConfig.model_json_schema()
    for section in (schema, *schema["$defs"].values()):  # docstrings, without their line breaks
        section["description"] = " ".join(section["description"].split())
    schema["properties"]["base"] = {
        "type": "string",
        "description": "another scenario file, relative to this one, over which this one is laid",
    }
    return schema


def _read(path: Path, seen: tuple[Path, ...]) -> dict[str, Any]:
    """The mapping in a file, laid over the one that its `base` names.

    Relative file names belong to the file that states them; `seen`: the files whose base this is.
    """
    if _is_xml(path):
        raise ConfigError(
            f"{path}: a file of SUMO's; give the .sumocfg that names it, or a scenario file with "
            "it under `sumo` (docs/scenario-file.md)"
        )
    data = parsed(path)
    if not isinstance(data, dict):
        raise ConfigError(f"{path}: a scenario is a mapping of keys, see `sumo-mcts schema`")
    _absolute_paths(data.get("sumo"), path.parent)
    if "base" not in data:
        return data
    base = data.pop("base")
    base_path = _base(base, path)
    if base_path in seen or len(seen) == MOST_BASES:
        raise ConfigError(
            f"{path}: base: {base} leads back to itself"
            if base_path in seen
            else f"{path}: base: more than {MOST_BASES} files"
        )
    return _overlay(_read(base_path, (*seen, files.absolute(path))), data)


def _is_xml(path: Path) -> bool:
    """Whether a file is XML, packed or not, or is called so."""
    try:
        return bool(files.xml_root(path))
    except (OSError, ValueError):
        return path.suffix == ".xml"


def _base(base: object, path: Path) -> Path:
    """The file that `base` in a file means: one beside it, or a built-in scenario of this name.

    Raises ConfigError.
    """
    if not isinstance(base, str) or not base:
        raise ConfigError(
            f"{path}: base: has to be a scenario file, or the name of a built-in one, got "
            f"{shown(base)}"
        )
    beside = path.parent / base
    why = files.problem(beside)
    built_in = builtin.scenario_named(base) if why else None
    if why and built_in is None:
        raise ConfigError(f"{path}: base: {base}: {why}")
    if built_in is None and _is_xml(beside):
        raise ConfigError(
            f"{path}: base: {base}: a file of SUMO's; allowed: a scenario file, or the name of a "
            "built-in one"
        )
    return files.absolute(built_in or beside)


def _absolute_paths(sumo: object, folder: Path) -> None:
    if not isinstance(sumo, dict):
        return
    for key in ("sumocfg", "net"):
        if isinstance(sumo.get(key), str):
            sumo[key] = str(files.absolute(folder / sumo[key]))
    for key in ("routes", "additional"):
        if isinstance(sumo.get(key), list):
            sumo[key] = [
                str(files.absolute(folder / p)) if isinstance(p, str) else p for p in sumo[key]
            ]


def _overlay(under: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """Both, merged: mappings key by key, lists of mappings with an `id` entry by that id.

    Anything else is replaced.
    """
    result = dict(under)
    for key, value in over.items():
        below = under.get(key)
        if isinstance(below, dict) and isinstance(value, dict):
            result[key] = _overlay(below, value)
        elif _has_ids(below) and _has_ids(value):
            merged = {item["id"]: item for item in below}  # type: ignore[union-attr]  # _has_ids says it is a list
            for item in value:
                merged[item["id"]] = _overlay(merged.get(item["id"], {}), item)
            result[key] = list(merged.values())
        else:
            result[key] = value
    return result


def _has_ids(value: object) -> bool:
    return (
        isinstance(value, list)
        and bool(value)
        and all(isinstance(item, dict) and isinstance(item.get("id"), str) for item in value)
    )


def _assignment(override: str) -> tuple[str, Any]:
    """Key and value of `a.b=c`. Raises ConfigError."""
    key, sep, text = override.partition("=")
    if not sep or not key:
        raise ConfigError(f"--set {override}: write it as key.subkey=value")
    try:
        return key, yaml_file.parsed(text)
    except YamlError as error:
        raise ConfigError(f"--set {override}: the value is not valid YAML: {error}") from None


def _assign(data: dict[str, Any], key: str, value: Any, where: str) -> None:
    """Set a key `a.b` of a mapping. Raises ConfigError, with `where` in front."""
    *parents, last = key.split(".")
    if len(parents) >= yaml_file.MOST_DEPTH:
        raise ConfigError(f"{where}: a key of more than {yaml_file.MOST_DEPTH} parts")
    for parent in parents:
        data = data.setdefault(parent, {})
        if not isinstance(data, dict):
            raise ConfigError(f"{where}: {parent} has no keys below it")
    data[last] = value
