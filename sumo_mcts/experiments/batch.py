"""Runs an experiment: all of its episodes, from where an earlier run was interrupted."""

import time
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from sumo_mcts import records
from sumo_mcts.config import builtin, positive, whole
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments import folder, tasks, workers
from sumo_mcts.experiments.dispatch import Dispatch
from sumo_mcts.experiments.experiment import (
    Case,
    Episode,
    Plan,
    episodes,
    load,
    with_ego,
)
from sumo_mcts.experiments.experiment import shard as part_of
from sumo_mcts.experiments.preparation import kind, manifest_of, prepared
from sumo_mcts.experiments.problems import kept
from sumo_mcts.experiments.progress import Watch, silent
from sumo_mcts.experiments.workers import Crew
from sumo_mcts.numerics.kernel import kept_kernels
from sumo_mcts.records import Row

WHOLE = (1, 1)  # the only shard
EPISODE_TIMEOUT_S = 3600.0  # of wall time, for an episode


class Listing(NamedTuple):
    """What a batch would drive, and whether it is done already."""

    key: str
    done: bool


def run_batch(  # ten parameters, all but two by keyword: a public function, one for each choice
    experiment: str | Path,
    out: str | Path,
    *,
    jobs: int | None = None,
    scheduler: str | None = None,
    shard: tuple[int, int] = WHOLE,
    fresh: bool = False,
    allow_plugins: bool = False,
    episode_timeout_s: float = EPISODE_TIMEOUT_S,
    command: Sequence[str] = (),
    watch: Watch | None = None,
) -> list[Row]:
    """Drive all episodes of an experiment file into the folder `out`, and return the rows (keys:
    docs/measures.md), in the order of the experiment.

    experiment: a file (docs/experiments.md), or the name of a built-in one.
    jobs: processes, by default one for each core that this process may use.
    scheduler: the address of a dask.distributed scheduler (tcp://...) whose workers drive instead.
    shard: (i, n) drives only the i-th of n parts; each part has a folder of its own.
    fresh: remove what `out` holds of an earlier batch, whichever it was, and of its report.
        Otherwise what is done there is not done again.
    allow_plugins: run code that the experiment or its scenarios name as module:name.
    episode_timeout_s: an episode that takes longer (wall time, s) is ended with outcome `error`.
    command: goes into the manifest. watch: gets the progress, about twice a second.

    Every row is on the disk as soon as its episode ends: a batch may be interrupted at any time,
    and called again. The rows are the same with any number of workers, except for times. An episode
    whose worker crashes is driven once more, then its outcome is `error`. Where the worker was
    killed from outside, as a system without memory does, the next call drives it again.

    In a script call it under `if __name__ == "__main__":`: the workers import the script. Raises
    ConfigError where the input is wrong, or `out` holds something else; BatchError where the batch
    cannot go on.
    """
    plan, out = _loaded(experiment, allow_plugins), Path(out)
    tell = watch or silent
    count = workers.cores() if jobs is None else whole("jobs", jobs, 1)
    patience = positive("episode_timeout_s", episode_timeout_s)
    with folder.only_here(out):
        wanted = manifest_of(plan, shard, command)
        found = _begin(plan, out, shard, wanted, fresh, tell, patience)
        with _crew(scheduler, count, patience) as crew:
            drive_one = tasks.drive if scheduler is None else partial(tasks.drive_within, patience)
            return Dispatch(out, found, plan.experiment.traces, tell, drive_one).run(crew)


def listed(
    experiment: str | Path,
    out: str | Path | None = None,
    *,
    shard: tuple[int, int] = WHOLE,
    fresh: bool = False,
    allow_plugins: bool = False,
) -> list[Listing]:
    """What `run_batch` would drive. Every scenario is started to see whether it can, without any
    decision. Nothing is written. Raises as `run_batch` does."""
    plan = _loaded(experiment, allow_plugins)
    wanted = manifest_of(plan, shard, ())
    manifest = None if out is None else _begun(Path(out), wanted, fresh)
    egos = (
        prepared(plan, silent, EPISODE_TIMEOUT_S, decide=False)
        if manifest is None
        else manifest["egos"]
    )
    found = part_of(episodes(plan, egos), *shard)
    done = (
        set()
        if manifest is None or out is None
        else {row["key"] for row in folder.done(Path(out), found)}
    )
    return [Listing(key, key in done) for episode in found for key in episode.keys]


def tried(path: Path, seconds: float, *, allow_plugins: bool = False) -> list[str]:
    """The problems of an experiment file, a line for each. Every scenario is started in this
    process with every kind of driver, as long as time is left. Raises ConfigError where the file
    itself is wrong."""
    plan, until = load(path, allow_plugins=allow_plugins), time.monotonic() + seconds
    return [
        f"{plan.origin}: scenarios: {case.name}: {problem}"
        for case in plan.cases
        for problem in dict.fromkeys(_problems(case, until))
        if problem
    ]


def built_in() -> list[dict[str, str]]:
    """Name and description of the built-in experiments."""
    found = [load(builtin.experiment_path(name)).experiment for name in builtin.experiment_names()]
    return [
        {"name": experiment.name, "description": experiment.description} for experiment in found
    ]


def _loaded(experiment: str | Path, allow_plugins: bool) -> Plan:
    return load(builtin.experiment_path(str(experiment)), allow_plugins=allow_plugins)


def _begin(
    plan: Plan,
    out: Path,
    shard: tuple[int, int],
    wanted: Mapping[str, Any],
    fresh: bool,
    tell: Watch,
    patience: float,
) -> list[Episode]:
    """Try the scenarios and begin in the folder, or go on with what was begun there. Returns all
    episodes of the shard. `patience`: s for a step of that."""
    manifest = _begun(out, wanted, fresh)
    egos = None if manifest is None else manifest["egos"]
    if egos is None or not kept_kernels():
        egos = prepared(plan, tell, patience, egos)
    found = part_of(episodes(plan, egos), *shard)
    if manifest is None:
        started = {**wanted, "egos": egos, "rows": sum(len(episode.keys) for episode in found)}
        kept(out, lambda: _write_manifest(out, started, fresh))
    return found


def _begun(out: Path, wanted: Mapping[str, Any], fresh: bool) -> dict[str, Any] | None:
    """The manifest of the batch that goes on; None: a new one begins.

    Raises ConfigError where the folder is not for this batch.
    """
    if fresh:
        folder.check_ours(out)
        return None
    return folder.begun(out, wanted)


def _write_manifest(out: Path, manifest: Mapping[str, Any], fresh: bool) -> None:
    """Say in the folder what is to come, in place of what was."""
    if fresh:
        folder.clear(out)
    records.write_manifest(out, manifest)


def _crew(scheduler: str | None, count: int, patience: float) -> AbstractContextManager[Crew]:
    """The workers: processes of this machine, or those of a scheduler."""
    return workers.local(count, patience) if scheduler is None else workers.cluster(scheduler)


def _problems(case: Case, until: float) -> list[str]:
    """What is wrong with a scenario under any kind of driver, as far as that is found by `until`
    (time.monotonic())."""
    try:
        egos: tuple[str, ...] = ()
        if case.egos is not None:
            egos = tasks.some_egos(case.base, case.egos, max(0.0, until - time.monotonic()))
        configs = [with_ego(config, *egos) if egos else config for config in case.configs.values()]
        kinds = {kind(config): config for config in configs}
        return [
            tasks.rehearse(config, case.seeds[0], decide=False)
            for config in kinds.values()
            if time.monotonic() < until and (egos or case.egos is None)
        ]
    except ConfigError as error:
        return [str(error)]
