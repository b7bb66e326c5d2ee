"""Whole episodes in SUMO: the loop's promises, and what happens when something in it fails."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sumo_mcts import config, records
from sumo_mcts.config import builtin
from sumo_mcts.driver.driver import Driver, PlanningResult
from sumo_mcts.driver.vehicle import EgoVehicle
from sumo_mcts.episode import run_episode
from sumo_mcts.records import ROW_KEYS
from sumo_mcts.reporting import birdseye
from sumo_mcts.scene import Scene

DIGEST = """
from sumo_mcts import config
from sumo_mcts.config import builtin
from sumo_mcts.episode import run_episode
scene = config.load(builtin.scenario_path("unprotected-left-turn"), ("planner.iterations=200", "planner.name={planner}"))
print(run_episode(scene, {seed}).rows[0]["trace_digest"])
"""


def digest(seed: int, hash_seed: int, planner: str = "mcts") -> str:
    """The digest of an episode in a process of its own."""
    run = subprocess.run(
        [sys.executable, "-c", DIGEST.format(seed=seed, planner=planner)],
        env={**os.environ, "PYTHONHASHSEED": str(hash_seed)},
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    return run.stdout.strip()


@pytest.mark.slow
@pytest.mark.parametrize("planner", ["mcts", "paper"])
def test_same_seed_same_run_in_another_process(planner: str) -> None:
    first = digest(3, 0, planner)
    assert len(first) == 64
    assert digest(3, 1234, planner) == first


@pytest.mark.slow
def test_another_seed_is_another_run() -> None:
    assert digest(3, 0) != digest(4, 0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["unprotected-left-turn", "highway-exit", "straight-line"])
def test_mcts_drives_the_reactive_scenes(name: str) -> None:
    scene = config.load(builtin.scenario_path(name))
    row = run_episode(scene, 1).rows[0]
    assert row["outcome"] == "arrived", row
    assert row["red_lights_run"] == 0
    assert row["speeding_share"] == 0
    assert set(row) == set(ROW_KEYS)
    assert row["iterations"] > 100 * row["cycles"]
    json.dumps(row, allow_nan=False)


@pytest.mark.parametrize("name", ["unprotected-left-turn", "highway-exit", "straight-line"])
def test_the_oracle_solves_the_fixed_scripted_scenes(name: str) -> None:
    scene = config.load(
        builtin.scenario_path(f"{name}-scripted"), ("prediction.name=script", "traffic.vary=0")
    )
    result = run_episode(scene, 0)
    row = result.rows[0]
    assert row["outcome"] == "arrived", row
    assert row["inevitable"] is None
    seen = {name for cycle in result.traces[0].cycles for name in cycle.agents.ids}
    assert len(scene.traffic.actors) == 6 and len(seen) == 5  # the ego and five others


def test_a_blind_driver_collides_where_the_search_does_not() -> None:
    scene = config.load(
        builtin.scenario_path("unprotected-left-turn-scripted"),
        ("planner.name=constant", "traffic.vary=0"),
    )
    row = run_episode(scene, 0).rows[0]
    assert (row["outcome"], row["inevitable"]) == ("collision", False)


def test_the_twin_is_driven_by_sumo() -> None:
    scene = config.load(builtin.scenario_path("straight-line"), ("planner.name=sumo",))
    result = run_episode(scene, 1)
    row = result.rows[0]
    assert row["outcome"] == "arrived"
    assert row["iterations"] == 0
    assert row["prediction"] is None
    assert all(cycle.decision.plan is None for cycle in result.traces[0].cycles)


@pytest.mark.slow
def test_the_planner_knows_the_top_speed_of_its_actor() -> None:
    ego = (
        "{id: ego, vtype: ego, route: [road, beyond], max_speed_mps: 4, depart: {lane: 1, pos_m: "
        "250, speed_mps: 3}}"
    )
    sets = ("planner.name=idm", f"traffic.actors=[{ego}]", "traffic.vary=0")
    result = run_episode(config.load(builtin.scenario_path("straight-line"), sets), 0)
    speeds = [cycle.ego.v for cycle in result.traces[0].cycles]
    assert 3.5 < max(speeds) <= 4.0
    assert result.rows[0]["free_flow_s"] == pytest.approx(
        result.rows[0]["distance_m"] / 4.0, rel=0.1
    )


@pytest.mark.slow
def test_two_egos_get_a_row_each() -> None:
    scene = config.load(
        builtin.scenario_path("straight-line"),
        ("planner.iterations=200", "egos=[{id: ego, until: road}, {id: behind, until: road}]"),
    )
    result = run_episode(scene, 1)
    assert [row["ego"] for row in result.rows] == ["ego", "behind"]
    assert [row["outcome"] for row in result.rows] == ["arrived", "arrived"]
    assert len({row["key"] for row in result.rows}) == 2
    assert len(result.traces) == 2


def test_a_planner_that_raises_is_an_outcome(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError("as planned")

    monkeypatch.setattr(Driver, "decide", broken)
    scene = config.load(builtin.scenario_path("straight-line"))
    row = run_episode(scene, 1).rows[0]
    assert row["outcome"] == "error"
    assert "as planned" in row["error"]
    assert set(row) == set(ROW_KEYS)


@pytest.mark.parametrize(
    "shortage",
    [
        MemoryError(),
        OSError(11, "Resource temporarily unavailable"),
        RuntimeError("can't start new thread"),
    ],
)
def test_a_shortage_of_the_machine_is_no_outcome(
    shortage: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    def starve(*_: object) -> None:
        raise shortage

    scene = config.load(builtin.scenario_path("straight-line"), ("planner.name=constant",))
    for where, what in ((Driver, "decide"), (EgoVehicle, "before_step")):
        with monkeypatch.context() as patch:
            patch.setattr(where, what, starve)
            with pytest.raises(type(shortage)):
                run_episode(scene, 1)


def test_an_ego_that_never_comes_is_an_error() -> None:
    scene = config.load(
        builtin.scenario_path("straight-line"), ("egos=[{id: ahead.7}]", "episode.depart_limit_s=5")
    )
    row = run_episode(scene, 1).rows[0]
    assert row["outcome"] == "error"
    assert "never departed" in row["error"]


def test_the_trace_tells_what_the_row_says(tmp_path: Path) -> None:
    scene = config.load(builtin.scenario_path("highway-exit"), ("planner.iterations=200",))
    result = run_episode(scene, 2)
    trace = result.traces[0]
    assert len(trace.cycles) == result.rows[0]["cycles"]
    path = tmp_path / "trace.npz"
    records.save_trace(path, trace)
    again = records.load_trace(path)
    assert [c.decision.chosen for c in again.cycles] == [c.decision.chosen for c in trace.cycles]
    for cycle in again.cycles[:-1]:
        if cycle.deviation == "":
            assert abs(cycle.commanded_speed - cycle.executed_speed) < 0.06
    assert sum(cycle.deviation != "" for cycle in again.cycles) <= 1


def test_a_planner_that_raises_under_way_leaves_what_was_driven_so_far(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    decide = Driver.decide

    def tired(self: Driver, scene: Scene) -> PlanningResult:
        if scene.time > 3.0:
            raise RuntimeError("enough")
        return decide(self, scene)

    monkeypatch.setattr(Driver, "decide", tired)
    result = run_episode(
        config.load(builtin.scenario_path("straight-line"), ("planner.iterations=50",)), 1
    )
    row = result.rows[0]
    assert (row["outcome"], row["error"], row["cycles"]) == ("error", "RuntimeError: enough", 6)
    assert len(result.traces[0].cycles) == 6
    assert row["distance_m"] > 5.0
    assert set(row) == set(ROW_KEYS)
    json.dumps(row, allow_nan=False)


@pytest.mark.slow
def test_an_episode_leaves_nothing_behind_for_the_next() -> None:
    scene = config.load(builtin.scenario_path("highway-exit"), ("planner.iterations=50",))
    first, _, again = (run_episode(scene, seed).rows[0]["trace_digest"] for seed in (5, 6, 5))
    assert first == again


def test_a_trace_is_drawn_the_same_after_it_was_loaded(tmp_path: Path) -> None:
    trace = run_episode(
        config.load(builtin.scenario_path("unprotected-left-turn"), ("planner.iterations=100",)), 2
    ).traces[0]
    records.save_trace(tmp_path / "trace.npz", trace)
    again = records.load_trace(tmp_path / "trace.npz")
    middle = trace.cycles[len(trace.cycles) // 2].time
    before, after = (
        np.asarray(birdseye.picture(one, middle)[0], dtype=int) for one in (trace, again)
    )
    assert before.shape == after.shape
    assert (
        np.abs(before - after).max(axis=2) > 24
    ).mean() < 0.001  # poses are kept in single precision
    assert before.std() > 10.0
