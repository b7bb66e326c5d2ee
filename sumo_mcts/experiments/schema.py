"""What an experiment file may say."""

import itertools
import math
import re
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    model_validator,
)

from sumo_mcts import config, files
from sumo_mcts.config import MOST_SEED, Flag, Id
from sumo_mcts.errors import ConfigError
from sumo_mcts.world.arguments import is_sumocfg, sumo_home

SUMO_FOLDER = "${SUMO_HOME}"
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
    # len() fails for ranges larger than an index
    if sum(each.stop - each.start for each in ranges) > MOST_EPISODES:
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
    """An entry that is a name or a path alone."""
    if isinstance(value, str):
        path = located(value, Path((info.context or {}).get("folder", ".")))
        return {
            "sumocfg" if is_sumocfg(value if path is None else str(path)) else "scenario": value
        }
    return value


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


def read(path: Path) -> Experiment:
    """Read an experiment file. Raises ConfigError."""
    experiment = _parsed(path)
    _require_bounded(experiment, str(path))
    return experiment


def is_experiment(data: object) -> bool:
    """Whether what a file in YAML says is an experiment rather than a scenario."""
    return isinstance(data, dict) and "scenarios" in data


def located(named: str, folder: Path) -> Path | None:
    """A file beside the experiment's, else in the working directory; None where there is none."""
    named = named.replace(SUMO_FOLDER, sumo_home()) if SUMO_FOLDER in named else named
    return next((path for path in (folder / named, Path(named)) if not files.problem(path)), None)


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
        len(entry.seeds or experiment.seeds or (0,)) * _episodes(entry)
        for entry in experiment.scenarios
    ]
    if variants * sum(episodes_of) > MOST_EPISODES:
        raise ConfigError(
            f"{origin}: scenarios x egos x variants x sweep x seeds: {variants * sum(episodes_of)} "
            f"episodes; at most {MOST_EPISODES}"
        )


def _episodes(entry: Entry) -> int:
    """The episodes for each variant and seed."""
    return 1 if entry.egos is None else entry.egos.random or len(entry.egos.ids)


def _keys(model: type[BaseModel]) -> list[str]:
    return [field.alias or name for name, field in model.model_fields.items()]
