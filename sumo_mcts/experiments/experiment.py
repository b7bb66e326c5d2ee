"""From an experiment file to the episodes that it stands for: scenarios x variants x seeds."""

import copy
import hashlib
import itertools
import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from sumo_mcts import config, files, records
from sumo_mcts.config import EgoConfig, ScenarioConfig, builtin
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments.schema import Changes, Egos, Entry, Experiment, located, read
from sumo_mcts.records.statistics import TWIN

# sections in which an episode and its twin have to agree
TRAFFIC = ("sumo", "egos", "traffic", "episode")
# versions that decide what comes of an episode: rows of others do not mix
DECIDING = ("sumo_mcts", "sources", "sumo", "numpy", "numba")
UNKNOWN_EGO = "any"  # stands for an ego of a user's network until it is chosen

ChosenEgos = Mapping[str, Sequence[str]]  # of each user's network, by scenario


class Case(NamedTuple):
    """A scenario of an experiment under all its variants."""

    name: str
    base: ScenarioConfig  # without any variant
    seeds: tuple[int | None, ...]  # None: the .sumocfg's own
    # by variant; the egos of a user's network are not chosen yet
    configs: Mapping[str, ScenarioConfig]
    # of a user's network, an episode for each; None: the scenario's own, together
    egos: Egos | None


class Plan(NamedTuple):
    """An experiment file that was read and found good."""

    origin: str
    experiment: Experiment
    variants: Mapping[str, Changes]  # with the sweep and the twins
    cases: tuple[Case, ...]
    digest: str  # SHA-256 of all that decides what is driven


class Episode(NamedTuple):
    """One episode of an experiment."""

    keys: tuple[str, ...]  # of its rows, one an ego
    variant: str
    seed: int | None
    config: ScenarioConfig
    # the egos of all episodes: SUMO measures only those that are named first in a process
    measured: tuple[str, ...] = ()


def load(path: Path, *, allow_plugins: bool = False) -> Plan:
    """Read an experiment file and the scenarios that it names; code that they name only where that
    is allowed. Raises ConfigError."""
    experiment = read(path)
    variants = _variants(experiment, str(path))
    cases = tuple(_case(experiment, k, variants, path) for k in range(len(experiment.scenarios)))
    for name, count in Counter(case.name for case in cases).items():
        if count > 1:
            raise ConfigError(
                f"{path}: scenarios: {name}: named {count} times; give a `name` of its own to each"
            )
    for key, name in {
        named
        for case in cases
        for found in case.configs.values()
        for named in config.plugin_names(found)
    }:
        config.require_permission(f"{path}: {key}", name, allow_plugins)
    settings = experiment.model_dump(mode="json", by_alias=True, exclude={"description"})
    configs = {
        case.name: {variant: config.digest(found) for variant, found in case.configs.items()}
        for case in cases
    }
    digest = hashlib.sha256(
        json.dumps([settings, configs], sort_keys=True, default=str).encode()
    ).hexdigest()
    return Plan(str(path), experiment, variants, cases, digest)


def episodes(plan: Plan, egos: ChosenEgos) -> list[Episode]:
    """Every episode of an experiment, all scenarios and variants of a seed before those of the
    next. `egos`: the chosen ones of each user's network."""
    longest = max(len(case.seeds) for case in plan.cases)
    found = [
        episode
        for k in range(longest)
        for case in plan.cases
        if k < len(case.seeds)
        for episode in _of_seed(case, case.seeds[k], egos.get(case.name))
    ]
    measured = all_egos(plan, egos)
    return [episode._replace(measured=measured) for episode in found]


def all_egos(plan: Plan, egos: ChosenEgos) -> tuple[str, ...]:
    """The ids of all egos of an experiment."""
    own = {
        ego.id
        for case in plan.cases
        if case.name not in egos
        for scenario in case.configs.values()
        for ego in scenario.egos
    }
    return tuple(sorted(own.union(*egos.values())))


def with_ego(scenario: ScenarioConfig, *egos: str) -> ScenarioConfig:
    """A user's network with one of its vehicles as ego, or with several."""
    return scenario.model_copy(
        update={"egos": tuple(scenario.egos[0].model_copy(update={"id": ego}) for ego in egos)}
    )


def shard(found: Sequence[Episode], number: int, count: int) -> list[Episode]:
    """The episodes of shard `number` of 1 .. `count`: each is in exactly one, by its key."""
    return [
        episode
        for episode in found
        if int(hashlib.sha256(episode.keys[0].encode()).hexdigest(), 16) % count == number - 1
    ]


# --- variants ---


def _variants(experiment: Experiment, origin: str) -> dict[str, Changes]:
    """What each variant sets, beyond what all of them do.

    Raises ConfigError where two have one name.
    """
    found: dict[str, Changes] = {}
    for name, changes in experiment.variants.items():
        for point in _grid(experiment.sweep):
            full = "-".join(
                [
                    name,
                    *(
                        f"{_short(key, experiment.sweep)}-{_text(value)}"
                        for key, value in point.items()
                    ),
                ]
            )
            if full in found:
                raise ConfigError(
                    f"{origin}: variants: {full}: two variants have this name, one of them by "
                    "`sweep`"
                )
            found[full] = {**changes, **point}
    if experiment.twins and all(changes.get("planner.name") != TWIN for changes in found.values()):
        if TWIN in found:
            raise ConfigError(
                f"{origin}: variants: {TWIN}: with `twins` this is the name of the twins; give it "
                f"another, or planner.name: {TWIN}"
            )
        found[TWIN] = {"planner.name": TWIN}
    return found


def _grid(sweep: Mapping[str, Sequence[Any]]) -> Iterator[Changes]:
    """Every combination of values; without any key the empty one."""
    for values in itertools.product(*sweep.values()):
        yield dict(zip(sweep, values, strict=True))


def _short(key: str, sweep: Mapping[str, object]) -> str:
    """The last part of a key, if it differs from those of the others."""
    last = key.rpartition(".")[2]
    return last if sum(other.rpartition(".")[2] == last for other in sweep) == 1 else key


def _text(value: Any) -> str:
    return json.dumps(value, default=str).replace('"', "").replace(" ", "")


# --- scenarios ---


def _case(experiment: Experiment, number: int, variants: Mapping[str, Changes], path: Path) -> Case:
    """One entry of `scenarios`, with its configuration under every variant.

    Raises ConfigError that names the file and the key.
    """
    entry = experiment.scenarios[number]
    try:
        data = (
            _from_sumocfg(entry, path.parent)
            if entry.sumocfg is not None
            else _from_scenario(str(entry.scenario), path.parent)
        )
    except ConfigError as error:
        raise ConfigError(f"{path}: scenarios.{number}: {error}") from None
    data["name"] = name = entry.name or data["name"]
    for where, changes in (("set", experiment.assign), (f"scenarios.{number}.set", entry.assign)):
        data = _changed(data, changes, f"{path}: {where}").model_dump(mode="json")
    configs = {
        variant: _changed(data, changes, f"{path}: {_origin(experiment, variant)}")
        for variant, changes in variants.items()
    }
    base = config.build(data, str(path), allow_plugins=True)
    for variant, found in configs.items():
        if found.name != name or found.egos != base.egos:
            raise ConfigError(
                f"{path}: {_origin(experiment, variant)}: name and egos belong to the entries of "
                "`scenarios`"
            )
        if experiment.twins and any(
            getattr(found, section) != getattr(base, section) for section in TRAFFIC
        ):
            raise ConfigError(
                f"{path}: {_origin(experiment, variant)}: changes {', '.join(TRAFFIC)}, which "
                "twins share; set it for an entry of `scenarios`"
            )
    seeds = entry.seeds or experiment.seeds or ((0,) if entry.sumocfg is None else (None,))
    return Case(name, base, seeds, configs, entry.egos)


def _origin(experiment: Experiment, variant: str) -> str:
    return (
        f"variants.{variant}" if variant in experiment.variants else f"variants, sweep: {variant}"
    )


def _changed(data: dict[str, Any], changes: Changes, origin: str) -> ScenarioConfig:
    """The scenario with these keys set. Raises ConfigError."""
    return config.build(
        copy.deepcopy(data), origin, changes=copy.deepcopy(changes), allow_plugins=True
    )


def _from_scenario(name: str, folder: Path) -> dict[str, Any]:
    beside = folder / name
    return config.load(
        builtin.scenario_path(name) if files.problem(beside) else beside, allow_plugins=True
    ).model_dump(mode="json")


def _from_sumocfg(entry: Entry, folder: Path) -> dict[str, Any]:
    named = str(entry.sumocfg)
    path = located(named, folder)
    if path is None:
        raise ConfigError(f"sumocfg: {named}: {files.problem(folder / named)}")
    ego = EgoConfig(id=UNKNOWN_EGO, until=entry.until)
    data = {
        "name": config.name_from(path),
        "sumo": {"sumocfg": str(files.absolute(path))},
        "egos": [ego.model_dump()],
    }
    return config.build(data, str(path), allow_plugins=True).model_dump(mode="json")


# --- episodes ---


def _of_seed(case: Case, seed: int | None, egos: Sequence[str] | None) -> list[Episode]:
    """The episodes of a scenario at one seed: for each ego of a user's network, else one, under
    every variant."""
    chosen = [None] if egos is None else list(egos)
    return [_episode(case, variant, seed, ego) for ego in chosen for variant in case.configs]


def _episode(case: Case, variant: str, seed: int | None, ego: str | None) -> Episode:
    scenario = case.configs[variant] if ego is None else with_ego(case.configs[variant], ego)
    named = ego is not None or len(scenario.egos) > 1
    keys = tuple(
        records.episode_key(case.name, variant, seed, each.id if named else None)
        for each in scenario.egos
    )
    return Episode(keys, variant, seed, scenario)
