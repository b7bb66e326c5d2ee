"""What an experiment file may say, and the episodes that it stands for: scenarios x variants x
seeds."""

import copy
import hashlib
import itertools
import json
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    model_validator,
)

from sumo_mcts import config, files, records
from sumo_mcts.config import MOST_SEED, EgoConfig, Flag, Id, ScenarioConfig, builtin
from sumo_mcts.errors import ConfigError
from sumo_mcts.records.statistics import TWIN
from sumo_mcts.world.arguments import is_sumocfg, sumo_home

TRAFFIC = (
    "sumo",
    "egos",
    "traffic",
    "episode",
)  # sections in which an episode and its twin have to agree
DECIDING = (
    "sumo_mcts",
    "sources",
    "sumo",
    "numpy",
    "numba",
)  # versions that decide what comes of an episode, so that rows of others do not mix
SUMO_FOLDER = "${SUMO_HOME}"
UNKNOWN_EGO = "any"  # stands for an ego of a user's network until it is chosen

MOST_EPISODES = 1_000_000
MOST_CONFIGS = 10_000  # scenarios times variants: each is checked

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=100)]
Changes = dict[str, Any]


def _seeds(value: object) -> object:
    """The seeds in `0..9`, `[3, 7]` or `[0..9, 20..29]`, ascending, each once."""
    if value is None:
        return None
    parts = (
        value if isinstance(value, list | tuple) else [value] if isinstance(value, str) else None
    )
    if not parts:
        raise ValueError("a range such as 0..9, or a list of numbers and ranges")
    ranges = [_range(part) for part in parts]
    if (
        sum(each.stop - each.start for each in ranges) > MOST_EPISODES
    ):  # a range of more than an index can tell has no length
        raise ValueError(f"at most {MOST_EPISODES} seeds")
    return tuple(sorted(set(itertools.chain.from_iterable(ranges))))


def _range(part: object) -> range:
    found = (
        re.fullmatch(r"\s*(\d{1,12})\s*(?:\.\.\s*(\d{1,12})\s*)?", str(part), re.ASCII)
        if isinstance(part, int | str)
        else None
    )
    if found is None or isinstance(part, bool):
        raise ValueError(f"{part}: a number from 0 on, or a range such as 0..9")
    first, last = int(found[1]), int(found[2] or found[1])
    if last < first:
        raise ValueError(f"{part}: the range runs backwards; write {last}..{first}")
    if last > MOST_SEED:
        raise ValueError(f"{part}: a seed is at most {MOST_SEED}")
    return range(first, last + 1)


Seeds = Annotated[tuple[int, ...] | None, BeforeValidator(_seeds)]


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)


class Egos(_Section):
    """The egos of a user's network, an episode each: given by id, or drawn from its suitable
    vehicles, the same for all variants."""

    ids: tuple[Id, ...] = Field(
        (), max_length=100_000, description="vehicle ids; a list alone is short for it"
    )
    random: Annotated[int, Field(strict=True, ge=1, le=100_000)] | None = Field(
        None, description="or how many are drawn"
    )
    seed: int = Field(0, strict=True, ge=0, le=MOST_SEED, description="of the draw")

    @model_validator(mode="after")
    def _one_kind(self) -> "Egos":
        if (self.random is None) == (not self.ids):
            raise ValueError("give vehicle ids or {random: N}")
        if len(set(self.ids)) < len(self.ids):
            raise ValueError("ids: one is named twice")
        return self


def _listed(value: object) -> object:
    return {"ids": value} if isinstance(value, list) else value


class Entry(_Section):
    """A scenario of an experiment: a name or a scenario file, or a .sumocfg with egos."""

    scenario: str | None = Field(
        None, description="a built-in name, or a scenario file, relative to the experiment's"
    )
    sumocfg: str | None = Field(
        None,
        description="a .sumocfg, relative to the experiment's file; `${SUMO_HOME}` is the folder "
        "of the installed SUMO",
    )
    name: Name | None = Field(
        None,
        description="what it is called in keys and tables; default the scenario's own name, or the "
        ".sumocfg's",
    )
    egos: Annotated[Egos | None, BeforeValidator(_listed)] = Field(
        None, description="with a sumocfg: vehicle ids, or `{random: N, seed: K}`"
    )
    until: Id | None = Field(
        None,
        description="with a sumocfg: the goal, the end of this edge; default the last of the ego's "
        "route",
    )
    seeds: Seeds = Field(None, description="its own seeds; default those of the experiment")
    assign: Changes = Field(
        {}, alias="set", description="keys of the scenario, `a.b: value`, for all variants"
    )

    @model_validator(mode="after")
    def _one_source(self) -> "Entry":
        if (self.scenario is None) == (self.sumocfg is None):
            raise ValueError("give either scenario or sumocfg")
        if (self.sumocfg is None) != (self.egos is None):
            raise ValueError("egos: vehicle ids or {random: N} belong to a sumocfg, and only there")
        if self.until is not None and self.sumocfg is None:
            raise ValueError("until: only with a sumocfg")
        return self


def _entry(value: object, info: ValidationInfo) -> object:
    """A name or a path alone."""
    if isinstance(value, str):
        path = _located(value, Path((info.context or {}).get("folder", ".")))
        return {
            "sumocfg" if is_sumocfg(value if path is None else str(path)) else "scenario": value
        }
    return value


def _located(named: str, folder: Path) -> Path | None:
    """A file beside the experiment's, else from here; None where there is none."""
    named = named.replace(SUMO_FOLDER, sumo_home()) if SUMO_FOLDER in named else named
    return next((path for path in (folder / named, Path(named)) if not files.problem(path)), None)


class Experiment(_Section):
    """One experiment file."""

    name: Name = Field(description="what it is called")
    description: str = ""
    scenarios: tuple[Annotated[Entry, BeforeValidator(_entry)], ...] = Field(
        min_length=1, description="where is driven"
    )
    variants: dict[str, Changes] = Field(
        {"default": {}}, min_length=1, description="by name: keys of the scenario, `a.b: value`"
    )
    sweep: dict[str, Annotated[tuple[Any, ...], Field(min_length=1)]] = Field(
        {},
        description="by key of the scenario: values. Every variant is run with every combination "
        "of them",
    )
    seeds: Seeds = Field(
        None,
        description="of every scenario, the same for all variants; default 0, for a .sumocfg its "
        "own",
    )
    twins: Flag = Field(False, description="drive every episode with planner `sumo` too")
    traces: Literal["worth", "all", "none"] = Field("worth", description="which traces are kept")
    assign: Changes = Field(
        {}, alias="set", description="keys of every scenario, `a.b: value`, for all variants"
    )


class Case(NamedTuple):
    """A scenario of an experiment under all its variants."""

    name: str
    base: ScenarioConfig  # without any variant
    seeds: tuple[int | None, ...]  # None: the .sumocfg's own
    configs: Mapping[
        str, ScenarioConfig
    ]  # by variant; the egos of a user's network are not chosen yet
    egos: (
        Egos | None
    )  # of a user's network, an episode for each; None: the scenario's own, together


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
    measured: tuple[
        str, ...
    ] = ()  # the egos of all episodes: SUMO keeps to those that it is told first in a process


def load(path: Path, *, allow_plugins: bool = False) -> Plan:
    """Read an experiment file and the scenarios that it names; code that they name only where that
    is allowed. Raises ConfigError."""
    experiment = _parsed(path)
    _require_bounded(experiment, str(path))
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
    told = experiment.model_dump(mode="json", by_alias=True, exclude={"description"})
    configs = {
        case.name: {variant: config.digest(found) for variant, found in case.configs.items()}
        for case in cases
    }
    digest = hashlib.sha256(
        json.dumps([told, configs], sort_keys=True, default=str).encode()
    ).hexdigest()
    return Plan(str(path), experiment, variants, cases, digest)


def episodes(plan: Plan, egos: Mapping[str, Sequence[str]]) -> list[Episode]:
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


def all_egos(plan: Plan, egos: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
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


# --- the file ---


def is_experiment(data: object) -> bool:
    """Whether what a file in YAML says is an experiment rather than a scenario."""
    return isinstance(data, dict) and "scenarios" in data


def _parsed(path: Path) -> Experiment:
    data = config.parsed(path)
    if not isinstance(data, dict):
        raise ConfigError(
            f"{path}: an experiment is a mapping of keys: {', '.join(_keys(Experiment))}"
        )
    try:
        return Experiment.model_validate(data, context={"folder": path.parent})
    except ValidationError as error:
        raise config.refused(error, Experiment, str(path)) from None


def _require_bounded(experiment: Experiment, origin: str) -> None:
    """Raise ConfigError where there are too many episodes, before any is made."""
    variants = (
        len(experiment.variants) * math.prod(len(values) for values in experiment.sweep.values())
        + experiment.twins
    )
    configs = variants * len(experiment.scenarios)
    if configs > MOST_CONFIGS:
        raise ConfigError(
            f"{origin}: scenarios x variants x sweep: {configs}; at most {MOST_CONFIGS}"
        )
    episodes_of = [
        len(entry.seeds or experiment.seeds or (0,)) * _egos(entry)
        for entry in experiment.scenarios
    ]
    if variants * sum(episodes_of) > MOST_EPISODES:
        raise ConfigError(
            f"{origin}: scenarios x egos x variants x sweep x seeds: {variants * sum(episodes_of)} "
            f"episodes; at most {MOST_EPISODES}"
        )


def _egos(entry: Entry) -> int:
    """The episodes for each variant and seed."""
    return 1 if entry.egos is None else entry.egos.random or len(entry.egos.ids)


def _keys(model: type[BaseModel]) -> list[str]:
    return [field.alias or name for name, field in model.model_fields.items()]


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
    """The last part of a key where that tells it from the others."""
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
    path = _located(named, folder)
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
