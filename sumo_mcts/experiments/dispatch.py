"""Hands the episodes of a batch out to workers, and keeps every row as its episode ends."""

import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import suppress
from pathlib import Path

from sumo_mcts import records
from sumo_mcts.errors import of_machine
from sumo_mcts.experiments import folder, tasks, workers
from sumo_mcts.experiments.experiment import Episode
from sumo_mcts.experiments.problems import exhausted, kept, lost
from sumo_mcts.experiments.progress import Progress, Watch
from sumo_mcts.experiments.tasks import Driven
from sumo_mcts.experiments.workers import Crew
from sumo_mcts.numerics.announce import Growth
from sumo_mcts.numerics.kernel import kept_kernels
from sumo_mcts.records import MAPS, TRACES, Row
from sumo_mcts.records.highlights import Bar, TraceSelection

TRIES = 2  # of an episode whose worker crashes
NEWS_S = 0.5  # between two reports of the progress

Drive = Callable[[Episode, Bar], Driven]


class Dispatch:
    """The episodes of one run of a batch, and the folder that they go into."""

    def __init__(
        self,
        out: Path,
        found: Sequence[Episode],
        traces: str,
        tell: Watch,
        drive_one: Drive = tasks.drive,
    ) -> None:
        """`found`: all episodes, done or not. `traces`: which are kept, as in an experiment file.
        `drive_one` runs in the workers."""
        self._out, self._all, self._tell, self._drive = out, found, tell, drive_one
        self._highlights = TraceSelection(traces)
        self._rows = [row for row in folder.done(out, found) if not tasks.of_shortage(row)]
        known = {row["key"] for row in self._rows}
        self._waiting = deque(episode for episode in found if not known.issuperset(episode.keys))
        self._flying: dict[Future[Driven], Episode] = {}
        self._deaths: Counter[tuple[str, ...]] = Counter()
        self._began, self._before = time.monotonic(), len(found) - len(self._waiting)
        self._reported, self._compiled = -NEWS_S, Growth(kept_kernels)

    def run(self, crew: Crew) -> list[Row]:
        """Drive what is not done yet. Returns all rows. Raises BatchError."""
        kept(self._out, self._tidy)
        self._began = time.monotonic()
        try:
            while self._waiting or self._flying:
                self._hand_out(crew)
                done, _ = wait(self._flying, NEWS_S, FIRST_COMPLETED)
                # what is done is kept before what failed may end the batch
                for future in sorted(done, key=_failed):
                    self._take(future, crew.deaths)
                self._report()
        finally:
            with suppress(OSError):  # the error that ended the batch is reported instead
                folder.settle(self._out, self._all)
            self._report(last=True)
        return folder.done(self._out, self._all)

    def _tidy(self) -> None:
        """Leave only whole episodes in the folder, and the traces that are kept so far."""
        folder.sweep(self._out)
        folder.settle(self._out, self._all)
        outdated = {key for episode in self._waiting for key in episode.keys}
        for row in self._rows:
            outdated |= self._highlights.add(row)
        folder.drop_traces(self._out, outdated)

    def _hand_out(self, crew: Crew) -> None:
        try:
            free = crew.most() - len(self._flying)
            for _ in range(min(free, len(self._waiting))):
                episode = self._waiting.popleft()
                bar = self._highlights.bar(episode.config.name, episode.variant)
                self._flying[crew.executor.submit(self._drive, episode, bar)] = episode
        except Exception as error:  # of a scheduler that is gone
            raise lost(error) from None

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
            shortage = getattr(error, "shortage", False)
            driven = Driven(tasks.failed(episode, said, shortage=shortage), {}, {})
        except workers.SilentWorkerError as error:
            driven = Driven(tasks.failed(episode, str(error)), {}, {})
        # a worker answers whatever happens to an episode: this is about the workers
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt | SystemExit):
                raise
            if of_machine(error):
                raise exhausted(f"episode {episode.keys[0]}", error) from None
            raise lost(error) from None
        kept(self._out, lambda: self._keep(driven))

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
            folder.drop_traces(self._out, self._highlights.add(row))

    def _report(self, last: bool = False) -> None:
        now = time.monotonic()
        if not last and now - self._reported < NEWS_S:
            return
        self._reported = now
        outcomes = Counter(row["outcome"] for row in self._rows)
        done = len(self._all) - len(self._waiting) - len(self._flying)
        rate = (done - self._before) / (now - self._began) if done > self._before else None
        self._tell(
            Progress(
                doing="" if last else self._compiled.news(),
                done=done,
                total=len(self._all),
                collisions=outcomes["collision"],
                errors=outcomes["error"],
                rate_per_s=rate,
                left_s=None if rate is None else (len(self._all) - done) / rate,
            )
        )


def _failed(future: "Future[Driven]") -> bool:
    return future.cancelled() or future.exception() is not None
