"""The command batch."""

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from sumo_mcts.config import ScenarioConfig
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments.batch import listed, run_batch
from sumo_mcts.experiments.preparation import SHARDS
from sumo_mcts.experiments.progress import Progress
from sumo_mcts.scenarios import require_egos, resolve

TRIED_S = 7.0  # wall time that a check may take once SUMO runs


def episodes_of(
    scenario: str,
    egos: Sequence[str],
    until: str | None,
    overrides: tuple[str, ...],
    sumo_options: Sequence[str] = (),
    *,
    allow_plugins: bool,
) -> list[ScenarioConfig]:
    """The scenario with each ego (none given: its own, together)."""
    require_egos(scenario, egos)
    each = [[ego] for ego in egos] or [[]]
    return [
        resolve(scenario, None, names, until, overrides, sumo_options, allow_plugins=allow_plugins)
        for names in each
    ]


def batch(
    experiment: str,
    out: Path,
    jobs: int | None,
    scheduler: str | None,
    shard: str,
    fresh: bool,
    allow_plugins: bool,
    episode_timeout: float,
    command: Sequence[str],
    watch: Callable[[Progress], None],
) -> list[dict[str, Any]]:
    """The rows of an experiment, driven into a folder as far as they are not there yet.

    Raises ConfigError and BatchError.
    """
    return run_batch(
        experiment, out, jobs=jobs, scheduler=scheduler, shard=_shard(shard), fresh=fresh,
        allow_plugins=allow_plugins, episode_timeout_s=episode_timeout,
        command=command, watch=watch,
    )  # fmt: skip


def batch_listing(
    experiment: str, out: Path | None, shard: str, fresh: bool, allow_plugins: bool
) -> str:
    """A line for each row that `batch` would bring about. Raises ConfigError."""
    found = listed(experiment, out, shard=_shard(shard), fresh=fresh, allow_plugins=allow_plugins)
    lines = [f"{'done' if item.done else 'to do':6s} {item.key}" for item in found]
    done = sum(item.done for item in found)
    return "\n".join([*lines, f"{len(found)} rows, {done} done, {len(found) - done} to do"])


def batch_summary(rows: Sequence[dict[str, Any]]) -> str:
    """How the episodes ended, for a person: a line for each scenario and variant."""
    counts: dict[tuple[str, str], Counter[str]] = {}
    for row in rows:
        counts.setdefault((row["scenario"], row["variant"]), Counter())[row["outcome"]] += 1
    width = max((len(name) for names in counts for name in names), default=0)
    return "\n".join(
        f"{scenario:{width}s}  {variant:{width}s}  "
        f"{', '.join(f'{n} {outcome}' for outcome, n in found.most_common())}"
        for (scenario, variant), found in counts.items()
    )


def _shard(text: str) -> tuple[int, int]:
    number, _, count = text.partition("/")
    if not (number.isdecimal() and count.isdecimal()):
        raise ConfigError(f"--shard {text}: {SHARDS}")
    return int(number), int(count)
