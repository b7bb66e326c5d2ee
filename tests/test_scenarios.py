"""Wrong arguments of what programs call are told in one line, before anything starts."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import libsumo
import numpy as np
import pytest
from typer.testing import CliRunner

from sumo_mcts import load_scenario, run_batch, run_episode
from sumo_mcts.cli import app
from sumo_mcts.config import whole
from sumo_mcts.errors import ConfigError
from sumo_mcts.scenarios import GROUPS, listed_scenarios

SCENE = load_scenario("straight-line", "planner.name=sumo", "episode.stop_time_s=1")
WRONG: dict[str, Callable[[Path], object]] = {
    "run_episode: config: a scenario, as load_scenario returns it, got 'straight-line'": lambda _: (
        run_episode("straight-line")
    ),
    "seed: a whole number from 0 on, got -1": lambda _: run_episode(SCENE, -1),
    "seed: a whole number from 0 on, got '1'": lambda _: run_episode(SCENE, "1"),
    "seed: a whole number from 0 on, got True": lambda _: run_episode(SCENE, True),
    "load_scenario: scenario: a name or a path, got ScenarioConfig(name='straight-line'": lambda _: (
        load_scenario(SCENE)
    ),
    "load_scenario: assignments: a text, got {'planner.iterations': 3}": lambda _: load_scenario(
        "straight-line", {"planner.iterations": 3}
    ),
    "load_scenario: ego: a text, got 3": lambda _: load_scenario("straight-line", ego=3),
    "jobs: a whole number from 1 on, got 0": lambda folder: run_batch(
        "quick", folder / "out", jobs=0
    ),
    "jobs: a whole number from 1 on, got -2": lambda folder: run_batch(
        "quick", folder / "out", jobs=-2
    ),
    "--shard 1/2/3: i/n with i from 1 to n": lambda folder: run_batch(
        "quick", folder / "out", shard=(1, 2, 3)
    ),
}


@pytest.mark.parametrize("said", WRONG)
def test_wrong_arguments(said: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="^" + re.escape(said)) as refused:
        WRONG[said](tmp_path)
    assert len(str(refused.value).splitlines()) == 1
    assert not libsumo.simulation.isLoaded()
    assert list(tmp_path.iterdir()) == []


def test_whole_numbers_of_any_kind_are_taken() -> None:
    assert [whole("k", each, 1) for each in (1, np.int64(7), np.uint8(3))] == [1, 7, 3]
    assert json.dumps(run_episode(SCENE, np.int64(3)).rows[0]["seed"]) == "3"


def test_built_in_scenarios_are_listed_in_groups_by_what_moves_the_others() -> None:
    found = listed_scenarios()
    groups = {group: [each["name"] for each in found if each["group"] == group] for group in GROUPS}
    assert [each["name"] for each in found] == [name for names in groups.values() for name in names]
    assert all(names == sorted(names) and names for names in groups.values())
    assert [f"{name}-scripted" for name in groups["paper"]] == groups["scripted"]
    assert groups["varied"] == [
        f"{name}-varied" for name in ("highway-exit", "straight-line", "unprotected-left-turn")
    ]
    for prefix in ("dense", "rule", "passing"):
        assert all(name.startswith(f"{prefix}-") for name in groups[prefix])


def test_each_group_stands_under_its_heading() -> None:
    blocks = CliRunner().invoke(app, ["scenarios"]).stdout.split("\n\n")
    assert [block.splitlines()[0] for block in blocks] == list(GROUPS.values())
    listed = [line.split()[0] for block in blocks for line in block.splitlines()[1:]]
    assert listed == [each["name"] for each in listed_scenarios()]
