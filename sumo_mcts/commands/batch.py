"""The command batch: what it prints. experiments/batch.py drives."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments.batch import listed
from sumo_mcts.experiments.preparation import SHARDS
from sumo_mcts.records import Row

SHARD_DIGITS = 9  # of the number of shards: more are a mistake


def listing(
    experiment: str, out: Path | None, shard: tuple[int, int], *, fresh: bool, allow_plugins: bool
) -> str:
    """A line for each row that `batch` would bring about. Raises ConfigError."""
    found = listed(experiment, out, shard=shard, fresh=fresh, allow_plugins=allow_plugins)
    lines = [f"{'done' if item.done else 'to do':6s} {item.key}" for item in found]
    done = sum(item.done for item in found)
    return "\n".join([*lines, f"{len(found)} rows, {done} done, {len(found) - done} to do"])


def summary(rows: Sequence[Row]) -> str:
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


def shard_of(text: str) -> tuple[int, int]:
    """The two numbers of `I/N`. Raises ConfigError; batch.py checks that I is one of 1 .. N."""
    number, _, count = text.partition("/")
    if not all(part.isdecimal() and len(part) <= SHARD_DIGITS for part in (number, count)):
        raise ConfigError(f"--shard {text}: {SHARDS}")
    return int(number), int(count)


def failures(rows: Sequence[Row]) -> list[str]:
    """One line, if any row has outcome error: how many, and the first."""
    failed = [row for row in rows if row["outcome"] == "error"]
    if not failed:
        return []
    first = f"{failed[0]['key']}: {failed[0]['error']}"
    return [f"{len(failed)} of {len(rows)} rows have outcome error, the first: {first}"]
