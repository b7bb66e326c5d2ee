"""Runs an experiment: hands its episodes out, keeps every row as it ends, and goes on where an
earlier run was interrupted."""

import hashlib
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from sumo_mcts import files, records
from sumo_mcts.config import ScenarioConfig, builtin, plugin_names, plugins, positive, whole
from sumo_mcts.errors import ConfigError, FailedError, of_machine
from sumo_mcts.experiments import folder, tasks, workers
from sumo_mcts.experiments.experiment import (
    Episode,
    Plan,
    all_egos,
    episodes,
    load,
    shard,
    with_ego,
)
from sumo_mcts.experiments.tasks import Driven
from sumo_mcts.experiments.workers import Crew
from sumo_mcts.numerics.announce import COMPILING, Growth, watched
from sumo_mcts.numerics.kernel import kept_kernels
from sumo_mcts.records import MAPS, TRACES, Row
from sumo_mcts.records.highlights import Bar, Highlight
from sumo_mcts.world.arguments import REFEREE_OPTIONS, files_of

TRIES = 2  # of an episode whose worker dies
WHOLE = (1, 1)  # the only shard
SHARDS = "i/n with i from 1 to n, as in 2/8"  # what is allowed
NEWS_S = 0.5  # between two words about the progress
EPISODE_TIMEOUT_S = 3600.0  # of wall time, for an episode
COMPILING_S = 120.0  # on top of it before the first episode

_T = TypeVar("_T")


class BatchError(FailedError):
    """A batch that could not go on: what is done is kept, and the same command goes on.

    One line.
    """


class Progress(NamedTuple):
    """How far a batch is. Counts are of episodes."""

    # what comes before the first episode, or what is compiled between them; "" while they are
    # driven
    doing: str
    done: int  # earlier runs included
    total: int
    collisions: int  # egos that collided
    errors: int  # egos with outcome error
    rate_per_s: float | None  # episodes, in this run; None: none is done yet
    left_s: float | None


class Listing(NamedTuple):
    """What a batch would drive, and whether it is done already."""

    key: str
    done: bool


Egos = Mapping[str, Sequence[str]]  # of each user's network, by scenario
Watch = Callable[[Progress], None]
Drive = Callable[[Episode, Bar], Driven]


def run_batch(
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
    episode_timeout_s: an episode that takes longer (wall time, s) is ended, and its outcome is
        `error`.
    command: goes into the manifest. watch: is told the progress, about twice a second.

    Every row is on the disk as soon as its episode ends, so a batch may be interrupted in any way
    and called again. The rows are the same with any number of workers, except for times. An episode
    whose worker dies is driven once more, then its outcome is `error`; where the worker was killed
    from outside, as a system without memory does, the next call drives it again.

    In a script call it under `if __name__ == "__main__":`, since the worker processes import the
    script.

    Raises ConfigError where the input is wrong, or `out` holds something else; BatchError where the
    batch cannot go on.
    """
    plan, out = (
        load(builtin.experiment_path(str(experiment)), allow_plugins=allow_plugins),
        Path(out),
    )
    tell = watch or _nobody
    count = workers.cores() if jobs is None else whole("jobs", jobs, 1)
    patience = positive("episode_timeout_s", episode_timeout_s)
    with folder.only_here(out):
        wanted = _manifest(plan, shard, command)
        manifest = _begun(out, wanted, fresh)
        if manifest is None:
            egos = _prepared(plan, tell, patience)
            found = _part(plan, egos, shard)
            started = {**wanted, "egos": egos, "rows": sum(len(episode.keys) for episode in found)}
            _kept(out, lambda: _begin(out, started, fresh))
        else:
            if not kept_kernels():
                _prepared(plan, tell, patience, manifest["egos"])
            found = _part(plan, manifest["egos"], shard)
        with (
            workers.local(count, patience)
            if scheduler is None
            else workers.cluster(scheduler) as crew
        ):
            drive_one = tasks.drive if scheduler is None else partial(tasks.drive_within, patience)
            return _Batch(out, found, plan.experiment.traces, tell, drive_one).run(crew)


def listed(
    experiment: str | Path,
    out: str | Path | None = None,
    *,
    shard: tuple[int, int] = WHOLE,
    fresh: bool = False,
    allow_plugins: bool = False,
) -> list[Listing]:
    """What `run_batch` would drive, after a look whether it can: every scenario is started, but
    nobody decides. Nothing is written. Raises as it does."""
    plan = load(builtin.experiment_path(str(experiment)), allow_plugins=allow_plugins)
    wanted = _manifest(plan, shard, ())
    manifest = None if out is None else _begun(Path(out), wanted, fresh)
    egos = (
        _prepared(plan, _nobody, EPISODE_TIMEOUT_S, decide=False)
        if manifest is None
        else manifest["egos"]
    )
    found = _part(plan, egos, shard)
    done = (
        set()
        if manifest is None or out is None
        else {row["key"] for row in folder.done(Path(out), found)}
    )
    return [Listing(key, key in done) for episode in found for key in episode.keys]


def tried(path: Path, seconds: float, *, allow_plugins: bool = False) -> list[str]:
    """What is wrong with an experiment file, a line each: every scenario is started in this process
    with every kind of driver, as far as there is time for it. Raises ConfigError where the file
    itself is wrong."""
    plan, until = load(path, allow_plugins=allow_plugins), time.monotonic() + seconds
    found = []
    for case in plan.cases:
        try:
            egos = (
                ()
                if case.egos is None
                else tasks.some_egos(case.base, case.egos, max(0.0, until - time.monotonic()))
            )
            configs = {
                _kind(config): with_ego(config, *egos) if egos else config
                for config in case.configs.values()
            }.values()
            problems = [
                tasks.rehearse(config, case.seeds[0], decide=False)
                for config in configs
                if time.monotonic() < until and (egos or case.egos is None)
            ]
        except ConfigError as error:
            problems = [str(error)]
        found += [
            f"{plan.origin}: scenarios: {case.name}: {problem}"
            for problem in dict.fromkeys(problems)
            if problem
        ]
    return found


def built_in() -> list[dict[str, str]]:
    """Name and description of the built-in experiments."""
    found = [load(builtin.experiment_path(name)).experiment for name in builtin.experiment_names()]
    return [
        {"name": experiment.name, "description": experiment.description} for experiment in found
    ]


class _Batch:
    """The episodes of one run, on their way into the folder."""

    def __init__(
        self,
        out: Path,
        found: Sequence[Episode],
        traces: str,
        tell: Watch,
        drive_one: Drive = tasks.drive,
    ) -> None:
        self._out, self._all, self._tell, self._drive = out, found, tell, drive_one
        self._worth = Highlight(traces)
        self._rows = [row for row in folder.done(out, found) if not tasks.of_shortage(row)]
        known = {row["key"] for row in self._rows}
        self._waiting = deque(episode for episode in found if not known.issuperset(episode.keys))
        self._flying: dict[Future[Driven], Episode] = {}
        self._deaths: Counter[tuple[str, ...]] = Counter()
        self._began, self._before = time.monotonic(), len(found) - len(self._waiting)
        self._spoke, self._compiled = -NEWS_S, Growth(kept_kernels)

    def run(self, crew: Crew) -> list[Row]:
        """Drive what is not done yet. Returns all rows."""
        _kept(self._out, self._tidy)
        self._began = time.monotonic()
        try:
            while self._waiting or self._flying:
                self._hand_out(crew)
                done, _ = wait(self._flying, NEWS_S, FIRST_COMPLETED)
                for future in sorted(
                    done, key=_failed
                ):  # what is done is kept before what failed may end the batch
                    self._take(future, crew.deaths)
                self._report()
        finally:
            with suppress(OSError):  # what stopped us is told instead
                folder.settle(self._out, self._all)
            self._report(last=True)
        return folder.done(self._out, self._all)

    def _tidy(self) -> None:
        """Leave whole episodes alone in the folder, and the traces that are worth it so far."""
        folder.sweep(self._out)
        folder.settle(self._out, self._all)
        lost = {key for episode in self._waiting for key in episode.keys}
        for row in self._rows:
            lost |= self._worth.add(row)
        folder.drop_traces(self._out, lost)

    def _hand_out(self, crew: Crew) -> None:
        try:
            room = crew.most() - len(self._flying)
            for _ in range(min(room, len(self._waiting))):
                episode = self._waiting.popleft()
                bar = self._worth.bar(episode.config.name, episode.variant)
                self._flying[crew.executor.submit(self._drive, episode, bar)] = episode
        except Exception as error:  # of a scheduler that is gone
            raise _lost(error) from None

    def _take(self, future: "Future[Driven]", deaths: type[Exception]) -> None:
        """Keep what an episode left, or have it driven again."""
        episode = self._flying.pop(future)
        try:
            driven = future.result()
        except deaths as error:
            self._deaths[episode.keys] += 1
            if self._deaths[episode.keys] < TRIES:
                self._waiting.append(episode)
                return
            said = f"{' '.join(str(error).split())}, in each of {TRIES} tries"
            driven = Driven(
                tasks.failed(episode, said, shortage=getattr(error, "shortage", False)), {}, {}
            )
        except workers.SilentWorkerError as error:
            driven = Driven(tasks.failed(episode, str(error)), {}, {})
        except (
            BaseException
        ) as error:  # a worker answers whatever happens to an episode: this is about the workers
            if isinstance(error, KeyboardInterrupt | SystemExit):
                raise
            if of_machine(error):
                raise _exhausted(f"episode {episode.keys[0]}", error) from None
            raise _lost(error) from None
        _kept(self._out, lambda: self._keep(driven))

    def _keep(self, driven: Driven) -> None:
        """Write traces and the maps that they refer to, then the rows, which say that the episode
        is done."""
        for name, content in driven.maps.items():
            if not (self._out / MAPS / f"{name}.npz").exists():
                records.write_whole(self._out / MAPS / f"{name}.npz", content)
        for key, content in driven.traces.items():
            records.write_whole(self._out / TRACES / f"{key}.npz", content)
        for row in driven.rows:
            records.append_row(self._out, row)
        self._rows += driven.rows
        for row in driven.rows:
            folder.drop_traces(self._out, self._worth.add(row))

    def _report(self, last: bool = False) -> None:
        now = time.monotonic()
        if not last and now - self._spoke < NEWS_S:
            return
        self._spoke = now
        outcomes = Counter(row["outcome"] for row in self._rows)
        done = len(self._all) - len(self._waiting) - len(self._flying)
        rate = (done - self._before) / (now - self._began) if done > self._before else None
        left = None if rate is None else (len(self._all) - done) / rate
        self._tell(
            Progress(
                "" if last else self._compiled.news(),
                done,
                len(self._all),
                outcomes["collision"],
                outcomes["error"],
                rate,
                left,
            )
        )


def _failed(future: "Future[Driven]") -> bool:
    return future.cancelled() or future.exception() is not None


# --- before the first episode ---


def _manifest(plan: Plan, part: tuple[int, int], command: Sequence[str]) -> dict[str, Any]:
    """What a folder says of its batch, but for the egos that are drawn.

    Raises ConfigError where there is no such shard.
    """
    match part:
        case (int(number), int(count)) if 1 <= number <= count:
            pass
        case _:
            raise ConfigError(f"--shard {'/'.join(map(str, part))}: {SHARDS}")
    scenarios = {case.name: case.base.model_dump(mode="json") for case in plan.cases}
    configs = [config for case in plan.cases for config in case.configs.values()]
    return {
        "experiment": plan.experiment.model_dump(mode="json", by_alias=True),
        "experiment_digest": plan.digest,
        "shard": f"{number}/{count}",
        "files": contents({path for config in configs for path in files_of(config.sumo)}),
        "scenarios": scenarios,
        "variants": plan.variants,
        "versions": records.versions(),
        "plugins": [
            each
            for _, each in sorted(
                {
                    str(each): each for config in configs for each in plugins.described(config)
                }.items()
            )
        ],
        "command": ["sumo-mcts", *command] if command else None,
        "set_by_referee": REFEREE_OPTIONS,
        "reproducible": all(config.reproducible for config in configs),
    }


def contents(paths: Iterable[str]) -> dict[str, list[str]]:
    """SHA-256 of the files of each name, wherever they lie.

    What is missing is told when SUMO starts.
    """
    found: dict[str, set[str]] = {}
    for path in map(Path, paths):
        if not files.problem(path):
            with path.open("rb") as file:
                found.setdefault(path.name, set()).add(
                    hashlib.file_digest(file, "sha256").hexdigest()
                )
    return {name: sorted(found[name]) for name in sorted(found)}


def _begun(out: Path, wanted: Mapping[str, Any], fresh: bool) -> dict[str, Any] | None:
    """The manifest of the batch that goes on;

    None: a new one begins. Raises ConfigError where the folder is not for this batch.
    """
    if fresh:
        folder.check_ours(out)
        return None
    return folder.begun(out, wanted)


def _prepared(
    plan: Plan, tell: Watch, patience_s: float, egos: Egos | None = None, decide: bool = True
) -> Egos:
    """The egos of each user's network, chosen unless they are given; the scenarios have been tried,
    up to a decision where asked. Raises ConfigError, and BatchError where a step of that takes
    longer than an episode may (`patience_s`) and a compilation does."""
    with workers.local(1, patience_s + COMPILING_S) as crew:
        chosen = _chosen(plan, crew, tell) if egos is None else egos
        _rehearse(plan, chosen, crew, tell, decide)
    return chosen


def _begin(out: Path, manifest: Mapping[str, Any], fresh: bool) -> None:
    """Say in the folder what is to come, in place of what was."""
    if fresh:
        folder.clear(out)
    records.write_manifest(out, manifest)


def _chosen(plan: Plan, crew: Crew, tell: Watch) -> Egos:
    """The egos of each user's network. Raises ConfigError where there are none such."""
    found: dict[str, Sequence[str]] = {}
    for case in plan.cases:
        if case.egos is not None:
            tell(_before(f"looking for egos in {case.name}"))
            found[case.name] = _asked(
                plan,
                case.name,
                crew.executor.submit(tasks.choose, case.base, case.egos),
                crew,
                tell,
            )
    return found


def _rehearse(plan: Plan, egos: Egos, crew: Crew, tell: Watch, decide: bool) -> None:
    """Start every scenario once with every planner, in one process: wrong input ends the batch
    here, and the search is compiled for all that `decide`. Raises ConfigError."""
    tell(_before("starting SUMO" if kept_kernels() or not decide else COMPILING))
    measured = all_egos(plan, egos)
    for case in plan.cases:
        configs = [
            with_ego(config, egos[case.name][0]) if case.name in egos else config
            for config in case.configs.values()
        ]
        for config in {_kind(config): config for config in configs}.values():
            problem = _asked(
                plan,
                case.name,
                crew.executor.submit(tasks.rehearse, config, case.seeds[0], decide, measured),
                crew,
                tell,
            )
            if problem:
                raise ConfigError(f"{plan.origin}: scenarios: {case.name}: {problem}")


def _kind(config: ScenarioConfig) -> tuple[object, ...]:
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


def _asked(plan: Plan, name: str, future: "Future[_T]", crew: Crew, tell: Watch) -> _T:
    """The answer of a worker.

    Raises ConfigError where it says so, or dies of the question, BatchError where the machine
    fails.
    """
    try:
        return watched(future, kept_kernels, lambda news: tell(_before(news)))
    except (ConfigError, crew.deaths) as error:
        if getattr(error, "shortage", False):
            raise _exhausted(name, error) from None
        raise ConfigError(f"{plan.origin}: scenarios: {name}: {error}") from None
    except workers.SilentWorkerError as error:
        raise BatchError(f"{plan.origin}: scenarios: {name}: {error}") from None
    except (OSError, MemoryError) as error:
        raise _exhausted(name, error) from None


def _part(plan: Plan, egos: Egos, part: tuple[int, int]) -> list[Episode]:
    return shard(episodes(plan, egos), *part)


def _told(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__} {error}".split())


def _before(doing: str) -> Progress:
    return Progress(doing, 0, 0, 0, 0, None, None)


def _nobody(progress: Progress) -> None:
    """Is told, and tells nobody."""


def _kept(out: Path, write: Callable[[], object]) -> None:
    """Write. Raises BatchError where the disk does not take it."""
    try:
        write()
    except OSError as error:
        raise _exhausted(f"--out {out}", error) from None


def _lost(error: BaseException) -> BatchError:
    """What to say where nobody is left to drive."""
    return BatchError(
        f"the workers are lost ({_told(error)}); what is done is kept, and the same command goes on"
    )


def _exhausted(where: str, error: BaseException) -> BatchError:
    """What to say where the machine has no room for more."""
    told = getattr(error, "strerror", None) or _told(error)
    return BatchError(
        f"{where}: {told}; what is done is kept, and the same command goes on when that is mended"
    )
