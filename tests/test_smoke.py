"""What a user does first, with the real command and with warnings as errors: does all of it work
with this Python and these versions of the dependencies?

Together with tests elsewhere that are marked `smoke` this is what `make test-versions` runs with
each of them.
"""

import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from sumo_mcts import records
from sumo_mcts.scene import Release

pytestmark = [pytest.mark.smoke, pytest.mark.slow]

FROM_LIBSUMO = "ignore:builtin type:DeprecationWarning"  # raised by its SWIG wrapper
EXPERIMENT = """
name: two
scenarios: [straight-line]
variants: {few: {planner.iterations: 50, episode.time_limit_s: 3, episode.stop_time_s: 3}}
seeds: [1, 2]
"""


def command(*words: object, status: int = 0) -> subprocess.CompletedProcess[str]:
    """sumo-mcts, in a process of its own."""
    line = [sys.executable, "-m", "sumo_mcts", *map(str, words)]
    environment = {**os.environ, "PYTHONWARNINGS": f"error,{FROM_LIBSUMO}"}
    done = subprocess.run(
        line, env=environment, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == status, done.stderr
    return done


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an episode of four seconds."""
    folder = tmp_path_factory.mktemp("smoke") / "one"
    command(
        "run",
        "unprotected-left-turn",
        "--seed",
        3,
        "--iterations",
        100,
        "--time-limit",
        4,
        "--out",
        folder,
        "--quiet",
    )
    return folder


@pytest.mark.slow
def test_an_episode_leaves_a_row_a_trace_and_pictures(driven: Path) -> None:
    (row,) = records.read_rows(driven)
    assert row["outcome"] == "timeout"
    assert row["cycles"] > 5
    trace = records.load_trace(driven / records.TRACES / f"{row['key']}.npz")
    assert len(trace.cycles) == row["cycles"]
    assert not any(isinstance(cycle.decision.command, Release) for cycle in trace.cycles)
    records.save_trace(driven / "again.npz", trace)
    assert records.same(records.Trace, trace, records.load_trace(driven / "again.npz"))
    assert len(list((driven / "figures").iterdir())) == 2


@pytest.mark.slow
def test_it_is_reported_explained_and_exported_without_sumo(driven: Path) -> None:
    command("report", driven, "--quiet")
    assert "<html" in (driven / "report.html").read_text(encoding="utf-8")
    said = command("explain", driven, "--at", 1.5, "--replan").stdout
    assert said.rstrip().endswith("taken again with the same settings: the identical decision")
    command("export", driven, "--format", "csv")
    (table,) = (driven / "exports").glob("*.csv")
    with table.open(encoding="utf-8") as file:
        assert len(list(csv.DictReader(file))) > 0


@pytest.mark.slow
def test_a_batch_of_two_episodes(tmp_path: Path) -> None:
    (tmp_path / "two.yaml").write_text(EXPERIMENT, encoding="utf-8")
    command("batch", tmp_path / "two.yaml", "--out", tmp_path / "out", "--quiet")
    rows = records.read_rows(tmp_path / "out")
    assert sorted((row["seed"], row["outcome"]) for row in rows) == [(1, "timeout"), (2, "timeout")]
    assert json.loads(command("report", tmp_path / "out", "--json").stdout)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("no-such-scene",), "no-such-scene"),
        (("straight-line", "--set", "planner.iteration=5"), "planner.iteration"),
    ],
)
def test_wrong_input_is_told_in_one_line(words: tuple[str, ...], said: str) -> None:
    lines = command("run", *words, status=2).stderr.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("error: ")
    assert said in lines[0]
