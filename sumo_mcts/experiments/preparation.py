"""What a batch does before its first episode: says what it is, chooses egos, and tries every
scenario."""

import hashlib
from collections.abc import Iterable, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any, TypeVar

from sumo_mcts import files, records
from sumo_mcts.config import ScenarioConfig, plugin_names, plugins
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments import tasks, workers
from sumo_mcts.experiments.experiment import ChosenEgos, Plan, all_egos, with_ego
from sumo_mcts.experiments.problems import BatchError, exhausted
from sumo_mcts.experiments.progress import Watch, before_the_first
from sumo_mcts.experiments.workers import Crew
from sumo_mcts.numerics.announce import COMPILING, watched
from sumo_mcts.numerics.kernel import kept_kernels
from sumo_mcts.world.arguments import REFEREE_OPTIONS, files_of

SHARDS = "i/n with i from 1 to n, as in 2/8"  # what is allowed
COMPILING_S = 120.0  # on top of an episode's time limit, before the first episode

_T = TypeVar("_T")


def manifest_of(plan: Plan, part: tuple[int, int], command: Sequence[str]) -> dict[str, Any]:
    """What a folder says of its batch, but for the egos that are drawn.

    Raises ConfigError where there is no such shard.
    """
    match part:
        case (int(number), int(count)) if 1 <= number <= count:
            pass
        case _:
            raise ConfigError(f"--shard {'/'.join(map(str, part))}: {SHARDS}")
    configs = [config for case in plan.cases for config in case.configs.values()]
    described = {str(each): each for config in configs for each in plugins.described(config)}
    return {
        "experiment": plan.experiment.model_dump(mode="json", by_alias=True),
        "experiment_digest": plan.digest,
        "shard": f"{number}/{count}",
        "files": contents({path for config in configs for path in files_of(config.sumo)}),
        "scenarios": {case.name: case.base.model_dump(mode="json") for case in plan.cases},
        "variants": plan.variants,
        "versions": records.versions(),
        "plugins": [each for _, each in sorted(described.items())],
        "command": ["sumo-mcts", *command] if command else None,
        "set_by_referee": REFEREE_OPTIONS,
        "reproducible": all(config.reproducible for config in configs),
    }


def contents(paths: Iterable[str]) -> dict[str, list[str]]:
    """SHA-256 of the files of each name, in whatever folder.

    Missing files are reported when SUMO starts.
    """
    found: dict[str, set[str]] = {}
    for path in map(Path, paths):
        if not files.problem(path):
            with path.open("rb") as file:
                found.setdefault(path.name, set()).add(
                    hashlib.file_digest(file, "sha256").hexdigest()
                )
    return {name: sorted(found[name]) for name in sorted(found)}


def prepared(
    plan: Plan, tell: Watch, patience_s: float, egos: ChosenEgos | None = None, decide: bool = True
) -> ChosenEgos:
    """The egos of each user's network, chosen unless they are given. All scenarios are tried, up to
    a decision where `decide`.

    Raises ConfigError; BatchError where a step of that takes longer than an episode
    (`patience_s`) and a compilation may.
    """
    with workers.local(1, patience_s + COMPILING_S) as crew:
        chosen = _chosen(plan, crew, tell) if egos is None else egos
        _rehearse(plan, chosen, crew, tell, decide)
    return chosen


def kind(config: ScenarioConfig) -> tuple[object, ...]:
    """What decides whether a scenario starts, and what is compiled for it.

    A plugin may read, and refuse, anything.
    """
    sections = (
        config.sumo,
        config.traffic,
        config.episode,
        config.sensor,
        *([config] if any(plugin_names(config)) else []),
    )
    return (
        config.planner.name,
        config.prediction.name,
        config.failsafe.on,
        *(section.model_dump_json() for section in sections),
    )


def _chosen(plan: Plan, crew: Crew, tell: Watch) -> ChosenEgos:
    """The egos of each user's network. Raises ConfigError where there are none such."""
    found: dict[str, tuple[str, ...]] = {}
    for case in plan.cases:
        if case.egos is not None:
            tell(before_the_first(f"looking for egos in {case.name}"))
            answer = crew.executor.submit(tasks.choose, case.base, case.egos)
            found[case.name] = asked(plan, case.name, answer, crew, tell)
    return found


def _rehearse(plan: Plan, egos: ChosenEgos, crew: Crew, tell: Watch, decide: bool) -> None:
    """Start every scenario once with every planner, in one process: wrong input ends the batch
    here, and with `decide` the search is compiled for all. Raises ConfigError."""
    tell(before_the_first("starting SUMO" if kept_kernels() or not decide else COMPILING))
    measured = all_egos(plan, egos)
    for case in plan.cases:
        configs = [
            with_ego(config, egos[case.name][0]) if case.name in egos else config
            for config in case.configs.values()
        ]
        for config in {kind(config): config for config in configs}.values():
            answer = crew.executor.submit(tasks.rehearse, config, case.seeds[0], decide, measured)
            problem = asked(plan, case.name, answer, crew, tell)
            if problem:
                raise ConfigError(f"{plan.origin}: scenarios: {case.name}: {problem}")


def asked(plan: Plan, name: str, future: "Future[_T]", crew: Crew, tell: Watch) -> _T:
    """The answer of a worker about scenario `name`.

    Raises ConfigError where the worker says so, or crashes on the question. Raises BatchError where
    the machine fails.
    """
    try:
        return watched(future, kept_kernels, lambda news: tell(before_the_first(news)))
    except (ConfigError, crew.deaths) as error:
        if getattr(error, "shortage", False):
            raise exhausted(name, error) from None
        raise ConfigError(f"{plan.origin}: scenarios: {name}: {error}") from None
    except workers.SilentWorkerError as error:
        raise BatchError(f"{plan.origin}: scenarios: {name}: {error}") from None
    except (OSError, MemoryError) as error:
        raise exhausted(name, error) from None
