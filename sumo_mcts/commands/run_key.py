"""The key of a run: which scenario, which ego, and the settings that differ from the scenario's
own."""

import hashlib
import json
import re
from collections.abc import Sequence
from typing import Any

from sumo_mcts.config import ScenarioConfig, digest
from sumo_mcts.episode.run import EpisodeResult, default_variant
from sumo_mcts.experiments.experiment import TRAFFIC
from sumo_mcts.experiments.preparation import contents
from sumo_mcts.records import Row, episode_key
from sumo_mcts.registry import searches
from sumo_mcts.world.arguments import files_of

_SIMPLE = re.compile(r"[A-Za-z0-9_.]{1,24}")  # a value that can be read in a name


def variant_of(
    config: ScenarioConfig, own: ScenarioConfig | None, sumo_options: Sequence[str] = ()
) -> str:
    """planner-prediction-budget, then what else differs from the scenario's own settings.

    As in `mcts-idm-1000-cost.headway_s-2.0`; a digest stands for a value that is not a word. `own`:
    the scenario without the settings of the command line; None: it cannot stand alone.
    """
    base = {} if own is None else _settings(own)
    named = _in_default_variant(config)
    changed = {
        key: value
        for key, value in _settings(config).items()
        if key not in named and (key not in base or base[key] != value)
    }
    if sumo_options:
        changed["options"] = list(sumo_options)
    return "-".join(
        [default_variant(config), *(_word(key, value) for key, value in changed.items())]
    )


def is_named(config: ScenarioConfig, own: ScenarioConfig | None) -> bool:
    """Whether keys name the ego: where there are several, in a .sumocfg, and where it is not the
    scenario's own."""
    return (
        len(config.egos) > 1
        or config.sumo.sumocfg is not None
        or own is None
        or _ids(config) != _ids(own)
    )


def keyed(result: EpisodeResult, scenario: str, *, named: bool) -> EpisodeResult:
    """The result under this name of the scenario; its keys name the ego where `named`."""
    new = {
        row["key"]: episode_key(
            scenario, row["variant"], row["seed"], row["ego"] if named else None
        )
        for row in result.rows
    }
    traces = tuple(trace._replace(key=new[trace.key], scenario=scenario) for trace in result.traces)
    return result._replace(
        rows=tuple({**row, "key": new[row["key"]], "scenario": scenario} for row in result.rows),
        traces=traces,
    )


def names_ego(row: Row) -> bool:
    """Whether the key of a row names the ego."""
    return bool(row["key"] != episode_key(row["scenario"], row["variant"], row["seed"]))


def inputs(
    config: ScenarioConfig, own: ScenarioConfig | None, sumo_options: Sequence[str]
) -> dict[str, Any]:
    """For the manifest: options for SUMO, SHA-256 of the files, and `identity`.

    `identity` distinguishes scenarios of one name. It is a digest of the scenario's own settings
    and of its files; the ego of a .sumocfg does not count, the command line names it.
    """
    scenario, files = own or config, contents(files_of(config.sumo))
    plain = scenario.model_copy(
        update={"description": "", **({} if scenario.sumo.sumocfg is None else {"egos": ()})}
    )
    return {
        "sumo_options": list(sumo_options),
        "files": files,
        "identity": _digest([digest(plain), files]),
    }


def traffic(config: ScenarioConfig, sumo_options: Sequence[str]) -> str:
    """A digest of the traffic, equal for an episode and its paired SUMO baseline.

    Rows of a batch have it too. Options for SUMO change it.
    """
    shared = digest(config, TRAFFIC)
    return _digest([shared, list(sumo_options)]) if sumo_options else shared


def _settings(config: ScenarioConfig) -> dict[str, Any]:
    """section.key -> value, of all settings that decide what is driven.

    The egos count where there are several in the episode; their goals always.
    """
    data = config.model_dump(mode="json", exclude={"name", "description", "egos", "sumo"})
    sumo = config.sumo.model_dump(mode="json", exclude={"sumocfg"})
    sections = {
        f"{section}.{key}": value
        for section, values in {**data, "sumo": sumo}.items()
        for key, value in values.items()
    }
    alone = len(config.egos) == 1  # the key names it elsewhere
    return {
        **sections,
        "egos": None if alone else _ids(config),
        "until": config.egos[0].until if alone else [ego.until for ego in config.egos],
    }


def _in_default_variant(config: ScenarioConfig) -> tuple[str, ...]:
    """The settings that the name of a variant holds without further words."""
    name = default_variant(config)
    forecast = ("prediction.name",) if name != config.planner.name else ()
    budget = (
        "planner.iterations" if config.planner.time_budget_ms is None else "planner.time_budget_ms"
    )
    return ("planner.name", *forecast, *((budget,) if searches(config.planner.name) else ()))


def _word(key: str, value: Any) -> str:
    """A setting in a name."""
    text = json.dumps(value) if not isinstance(value, str) else value
    return f"{key}-{text}" if _SIMPLE.fullmatch(text) else f"{key}.{_digest(value)[:8]}"


def _ids(config: ScenarioConfig) -> list[str]:
    return [ego.id for ego in config.egos]


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()
