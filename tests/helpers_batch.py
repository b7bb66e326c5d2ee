"""Small experiments, and drivers of episodes that crash: in a module that worker processes can
import."""

import os
import resource
import signal
from pathlib import Path
from typing import Any

from sumo_mcts.experiments.experiment import Episode
from sumo_mcts.experiments.tasks import Driven, drive
from sumo_mcts.records import ROW_KEYS, Row
from sumo_mcts.records.highlights import Bar
from sumo_mcts.scene import Decision, Release

# No search, so nothing is compiled and an episode takes tenths of a second.
SMALL = """
name: small
scenarios: [unprotected-left-turn, highway-exit]
variants: {constant: {planner.name: constant}}
twins: true
seeds: 0..1
"""
CLOCK = (
    "plan_ms_p50",
    "plan_ms_p95",
    "plan_ms_p99",
    "plan_ms_max",
    "deadline_misses",
    "wall_s",
    "realtime_factor",
)


def write(folder: Path, text: str = SMALL, name: str = "small.yaml") -> Path:
    """An experiment file."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def timeless(rows: list[Row]) -> list[dict[str, Any]]:
    """The rows without what a clock says."""
    return [{key: row[key] for key in (*ROW_KEYS, "redrawn") if key not in CLOCK} for row in rows]


def crash_or_drive(episode: Episode, bar: Bar) -> Driven:
    """Take the process along where the environment's CRASH is the key; leave a file for each start
    in the folder STARTS."""
    key = episode.keys[0]
    number = len(list(Path(os.environ["STARTS"]).glob(f"{key}.*")))
    (Path(os.environ["STARTS"]) / f"{key}.{number}").touch()
    if key == os.environ["CRASH"]:
        os.kill(os.getpid(), signal.SIGSEGV)
    return drive(episode, bar)


def hang_or_drive(episode: Episode, bar: Bar) -> Driven:
    """Stop the process, as nothing but its death ends, where the environment's HANG is the key."""
    if episode.keys[0] == os.environ["HANG"]:
        os.kill(os.getpid(), signal.SIGSTOP)
    return drive(episode, bar)


def die_for_want_of_memory_or_drive(episode: Episode, bar: Bar) -> Driven:
    """End the process as a system without memory does where the environment's STARVE is the key."""
    if episode.keys[0] == os.environ["STARVE"]:
        os.kill(os.getpid(), signal.SIGKILL)
    return drive(episode, bar)


def exhaust_or_drive(episode: Episode, bar: Bar) -> Driven:
    """Drive with no file left to open where the environment's EXHAUST is the key."""
    if episode.keys[0] != os.environ["EXHAUST"]:
        return drive(episode, bar)
    most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (3, most[1]))
    try:
        return drive(episode, bar)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, most)


class Picky:
    """A planner that takes one number only."""

    needs_forecast = False

    def __init__(self, options: dict[str, Any], scenario: object) -> None:
        if options["number"] != 1:
            raise ValueError("number: 1 and nothing else")

    def start(self, task: object, seed: int) -> None:
        """Nothing to do."""

    def plan(self, situation: object) -> Decision:
        """SUMO drives."""
        return Decision(Release(), None, (), -1, "", 0, 0)


def rate(
    t: float, lane: int, s: float, v: float, a: float, jerk: float, min_gap: float, weight: float
) -> float:
    """A cost term that cannot be compiled."""
    return weight * os.getpid()


def echo(value: object) -> object:
    """The value itself."""
    return value


def raise_value_error() -> None:
    """Fail like a function, not like a process."""
    raise ValueError("as asked")


def die() -> None:
    """End the process at once."""
    os._exit(3)
