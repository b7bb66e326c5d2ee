"""How true the cost-to-go is: a trip by hand, the statistics, and the command in real episodes."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from helpers import edges, ego_at
from helpers_model import local_of, road_with_light, scene_of, situation_of, task_of
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from sumo_mcts import load_scenario
from sumo_mcts.cli import app
from sumo_mcts.model.local_map import State
from sumo_mcts.scene import GREEN, RED, Plan, Signals
from sumo_mcts.studies.trip import GOES_S, HORIZON_S, Log, Row, expected
from sumo_mcts.studies.value import driven, harvest
from sumo_mcts.studies.value_statistics import errors, gate, rank_correlation, summary

OPENS, PERIOD = 20.0, 0.5


def opens_at(time: float) -> Signals:
    return Signals(
        np.array([0, 1], np.int32),
        np.array([[RED, GREEN]], np.int32),
        np.array([[max(time, 1e-3), math.inf]]),
    )


# --- a trip by hand ---


def test_what_is_expected_reaches_to_the_last_gate_and_then_to_the_end_of_the_route() -> None:
    road = road_with_light()
    ego = ego_at(road, "a_0", 50.0, 15.0, route=edges(road, "a", "b"))
    task = task_of(road, ego)
    local, state = local_of(task, scene_of(ego, road, signals=opens_at(OPENS)))
    found = expected(local, task.route, state, 0.0)
    assert (found.gate, found.away, found.lost) == ("light", 150.0, 0.0)
    assert found.profile.tolist() == [[50.0, 0.0], [200.0, 10.0]]
    assert found.rest == pytest.approx(320.0 / 15.0)
    assert found.waits == pytest.approx(OPENS - 10.0)
    after = expected(local, task.route, state._replace(node=2, s=100.0, v=0.0), 0.0)
    assert (after.gate, after.away, after.waits) == ("none", math.inf, 0.0)
    assert after.profile[-1].tolist() == [520.0, pytest.approx(200.0 / 15.0)]
    assert after.lost == pytest.approx(15.0 / (2.0 * 2.6))


def drive_to_a_light() -> Log:
    """At 15 m/s to the line, where the ego stands until the light opens, and on."""
    road = road_with_light()
    ego = ego_at(road, "a_0", 50.0, 15.0, route=edges(road, "a", "b"))
    task = task_of(road, ego)
    log = Log(task.route)
    for k in range(100):
        time = k * PERIOD
        moving = min(time, 9.9) + max(time - OPENS, 0.0)
        v = 0.0 if 9.9 < time < OPENS else 15.0
        station = 50.0 + 15.0 * moving
        node = int(np.searchsorted([200.0, 220.0, 520.0], station))
        if node > 2:
            break
        s = station - (0.0, 200.0, 220.0)[node]
        state = State(node, s, v, 0.0, 0.0, -1, 0.0)
        log.note(time, state)
        if k % 2 == 0:
            name = road.lane_ids[task.route.lane[node]]
            there = ego_at(road, name, s, v, route=edges(road, "a", "b"))
            scene = scene_of(there, road, signals=opens_at(OPENS - time))
            log.ask(task, situation_of(task, scene)._replace(state=state))
        if v == 0.0:
            log.goes[k] = time > OPENS - 4.2
    return log


def test_a_wait_that_was_foreseen_was_waited() -> None:
    rows = [row for row in drive_to_a_light().states(arrived=True) if row["gate"] == "light"]
    assert {row["ahead_s"] for row in rows} == {0.0, HORIZON_S}
    waits = [row for row in rows if row["expected_s"] > 0.0]
    assert len(waits) > 15
    for row in waits:
        assert row["waited_s"] == pytest.approx(row["expected_s"], abs=0.2)
    for row in rows:
        assert row["expected_s"] > 0.0 or row["waited_s"] < 0.2
    assert max(row["waited_s"] for row in rows) > 9.0


def test_the_expected_time_falls_along_that_trip() -> None:
    (row,) = drive_to_a_light().trips()
    assert row["median_rate"] == pytest.approx(-1.0)
    assert row["rise_s"] < 3.0  # where the ego comes to a stand from one moment to the next


def test_a_stand_tells_whether_and_since_when_the_planner_would_have_gone() -> None:
    log = drive_to_a_light()
    (row,) = log.stands()
    assert (row["stood_s"], row["goes"], row["earlier_s"]) == (9.5, True, 3.5)
    log.goes = dict.fromkeys(log.goes, False)
    (row,) = log.stands()
    assert (row["goes"], row["goes_soon"], row["earlier_s"]) == (False, False, None)


def test_a_place_that_the_ego_never_came_to_tells_nothing() -> None:
    log = drive_to_a_light()
    ended = log.states(arrived=False)
    assert all(row["gate"] == "light" for row in ended)
    assert len(log.states(arrived=True)) > len(ended)


def test_what_is_driven_counts_up_to_the_horizon_only() -> None:
    time = np.arange(1, 101) * 0.1
    plan = Plan(time, np.full(100, 2.0), np.zeros(100, np.int32), time, np.zeros((100, 4)))
    assert driven(plan) == pytest.approx(2.0 * GOES_S)


# --- statistics ---


def state(told: float, true: float, away: float | None = 30.0, ahead: float = 0.0) -> Row:
    return {
        "scenario": "one", "ahead_s": ahead, "gate": "light" if away is not None else "none",
        "gate_m": away, "expected_s": told, "waited_s": true,
    }  # fmt: skip


def test_errors_by_hand() -> None:
    found = errors([state(1.0, 3.0), state(5.0, 4.0), state(0.0, -1.0)])
    assert (found["states"], found["waited_s"], found["bias_s"]) == (3, 2.0, 0.0)
    assert found["mae_s"] == pytest.approx(4 / 3)
    assert found["none_s"] == pytest.approx(8 / 3)
    assert found["rank"] == pytest.approx(1.0)
    assert errors([])["mae_s"] is None


@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=2, max_size=12))
def test_rank_correlation_is_that_of_mean_ranks(pairs: list[tuple[int, int]]) -> None:
    one, other = (np.array(side, np.float64) for side in zip(*pairs, strict=True))
    naive = [
        [sum(x < y for x in side) + (sum(x == y for x in side) + 1) / 2 for y in side]
        for side in (one, other)
    ]
    found = rank_correlation(one, other)
    if len(set(one)) == 1 or len(set(other)) == 1:
        assert found is None
    else:
        assert found == pytest.approx(np.corrcoef(naive)[0, 1])


def test_states_are_told_apart_by_scenario_gate_and_distance() -> None:
    rows = [state(1.0, 1.0, away) for away in (5.0, 20.0, 20.1, 400.0, None)]
    assert [gate(row) for row in rows] == [
        "light, 0–20 m", "light, 0–20 m", "light, 20–60 m", "light, 250 m and more", "none",
    ]  # fmt: skip
    found = summary([*rows, state(2.0, 1.0, ahead=8.0)], [], [])
    assert found["by_scenario"][0]["now"]["states"] == 5
    assert found["by_scenario"][0]["horizon"]["bias_s"] == 1.0
    assert [row["gate"] for row in found["by_gate"]].count("light, 20–60 m") == 1


# --- real episodes ---


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seed"), [("permissive-left", 1), ("side-road", 1)])
def test_where_sumo_s_driver_goes_the_planner_does_not_stand_for_ever(kind: str, seed: int) -> None:
    found = harvest(load_scenario(f"dense-{kind}"), seed, 4)
    assert found.stands
    assert all(row["goes_soon"] for row in found.stands)
    assert all(row["median_rate"] < 0.0 for row in found.trips)


@pytest.mark.slow
def test_the_command_measures_and_keeps_what_it_measured(tmp_path: Path) -> None:
    done = CliRunner().invoke(
        app,
        ["value", "dense-permissive-left", "--jobs", "1", "--json", "--out", str(tmp_path / "out")],
    )
    assert done.exit_code == 0, done.output
    result = json.loads(done.stdout)
    assert result["outcomes"] == {"arrived": 1}
    assert result == json.loads((tmp_path / "out" / "value.json").read_text())
    now = result["by_scenario"][0]["now"]
    assert now["states"] > 50
    assert now["rank"] > 0.5
    assert now["mae_s"] < now["none_s"]
    lines = (tmp_path / "out" / "states.csv").read_text().splitlines()
    told = sum(part["states"] for part in (now, result["by_scenario"][0]["horizon"]))
    assert len(lines) == told + 1
