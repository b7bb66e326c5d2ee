"""Small experiments, the `batch` command as a process, and functions that crash in a worker.

Worker processes import this module.
"""

import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sumo_mcts import config, records
from sumo_mcts.config import builtin
from sumo_mcts.episode import run_episode
from sumo_mcts.experiments.experiment import Episode, Plan, load
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
SLOW = (
    SMALL.replace("name: small", "name: slow").replace("0..1", "0..14")
    + "set: {sumo.step_length_s: 0.02}\n"
)
GOOD = Path(__file__).parent / "bad_inputs" / "good.sumocfg"
NET = GOOD.parent.parent.parent / "networks" / "crossing" / "crossing.net.xml"
CLOCK = (
    "plan_ms_p50",
    "plan_ms_p95",
    "plan_ms_p99",
    "plan_ms_max",
    "deadline_misses",
    "wall_s",
    "realtime_factor",
)

Reference = tuple[Path, list[Row]]  # the folder and the rows of a batch


def write(folder: Path, text: str = SMALL, name: str = "small.yaml") -> Path:
    """An experiment file."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def timeless(rows: list[Row]) -> list[dict[str, Any]]:
    """The rows without keys that depend on the clock."""
    return [{key: row[key] for key in (*ROW_KEYS, "redrawn") if key not in CLOCK} for row in rows]


def plan(folder: Path, text: str) -> Plan:
    """The plan of an experiment file with this text."""
    return load(write(folder, text))


def on_disk(out: Path) -> list[dict[str, Any]]:
    """Every line of episodes.jsonl; raises where one is incomplete."""
    return [json.loads(line) for line in (out / records.ROWS).read_text().splitlines()]


def start(experiment: Path, out: Path, jobs: int, **more: Any) -> subprocess.Popen[str]:
    """Start the command in its own process group, with its temporary files beside the experiment."""
    words = [
        sys.executable,
        "-m",
        "sumo_mcts",
        "batch",
        str(experiment),
        "--out",
        str(out),
        "--jobs",
        str(jobs),
    ]
    environment = {**os.environ, "TMPDIR": str(experiment.parent)}
    return subprocess.Popen(
        words,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=environment,
        **more,
    )


def wait_for(there: Callable[[], bool], process: subprocess.Popen[str] | None) -> None:
    """Wait until `there()`. Fails after a minute, or where the process ends before."""
    until = time.monotonic() + 60.0
    while not there():
        assert time.monotonic() < until
        assert process is None or process.poll() is None, process.communicate()
        time.sleep(0.02)


def is_gone(group: int) -> bool:
    """Whether no process of a group is left."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return True
    return False


def count(out: Path) -> int:
    return (out / records.ROWS).read_bytes().count(b"\n") if (out / records.ROWS).exists() else 0


def begun(whole: Reference, folder: Path, text: str = SMALL) -> tuple[Path, Path]:
    """An experiment, and the folder of a batch of it that was begun: a manifest, no rows."""
    manifest = json.loads((whole[0] / records.MANIFEST).read_text())
    path = write(folder, text)
    records.write_manifest(folder / "out", {**manifest, "experiment_digest": load(path).digest})
    return path, folder / "out"


def network(egos: str, more: str = "") -> str:
    """An experiment on the user's network GOOD."""
    return (
        f"name: x\nscenarios: [{{sumocfg: {GOOD}, egos: {egos}{more}}}]\nvariants: {{constant: "
        f"{{planner.name: constant}}}}\ntwins: true\n"
    )


def crash_or_drive(episode: Episode, bar: Bar) -> Driven:
    """Crash the process if the key equals CRASH of the environment.

    Each start leaves a file in the folder STARTS.
    """
    key = episode.keys[0]
    number = len(list(Path(os.environ["STARTS"]).glob(f"{key}.*")))
    (Path(os.environ["STARTS"]) / f"{key}.{number}").touch()
    if key == os.environ["CRASH"]:
        os.kill(os.getpid(), signal.SIGSEGV)
    return drive(episode, bar)


def hang_or_drive(episode: Episode, bar: Bar) -> Driven:
    """Suspend the process for ever if the key equals HANG of the environment."""
    if episode.keys[0] == os.environ["HANG"]:
        os.kill(os.getpid(), signal.SIGSTOP)
    return drive(episode, bar)


def out_of_memory_or_drive(episode: Episode, bar: Bar) -> Driven:
    """Kill the process, as Linux does without memory, if the key equals STARVE."""
    if episode.keys[0] == os.environ["STARVE"]:
        os.kill(os.getpid(), signal.SIGKILL)
    return drive(episode, bar)


def exhaust_or_drive(episode: Episode, bar: Bar) -> Driven:
    """Drive without a free file descriptor if the key equals EXHAUST of the environment."""
    if episode.keys[0] != os.environ["EXHAUST"]:
        return drive(episode, bar)
    most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (3, most[1]))
    try:
        return drive(episode, bar)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, most)


class Picky:
    """A planner with one valid option: number 1."""

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
    """Raise an error, which does not end the process."""
    raise ValueError("as asked")


def die() -> None:
    """End the process at once."""
    os._exit(3)


def driven_alone(row: Row) -> Row:
    """The row of the same episode, driven by itself."""
    path = builtin.scenario_path(str(row["scenario"]))
    scenario = config.load(path, (f"planner.name={row['planner']}",))
    result = run_episode(scenario, row["seed"], variant=row["variant"])
    return {**result.rows[0], "redrawn": result.manifest["redrawn"]}
