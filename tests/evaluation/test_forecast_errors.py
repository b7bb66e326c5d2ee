"""The statistics of forecasts, by hand; and where they come from, in small episodes."""

import json

import numpy as np
import pytest

from sumo_mcts import config
from sumo_mcts.arrays import Floats
from sumo_mcts.commands import forecast as command
from sumo_mcts.config import ScenarioConfig, builtin
from sumo_mcts.episode import run_episode
from sumo_mcts.episode.loop import Loop
from sumo_mcts.episode.oracles import SimulationOracles
from sumo_mcts.evaluation.forecast_errors import errors, statistics, together
from sumo_mcts.scene import Forecast
from sumo_mcts.studies.forecasts import compare


def forecast(x: Floats, lane: list[list[int]], valid: list[list[bool]] | None = None) -> Forecast:
    """Agents that drive east along y = 0 at x [T, N], half a second between the times."""
    times, n = x.shape
    pose = np.zeros((1, times, n, 4))
    pose[0, :, :, 0], pose[0, :, :, 2] = x, 1.0
    there = np.ones((times, n), np.bool_) if valid is None else np.array(valid)
    none = np.zeros(n)
    return Forecast(
        dt=0.5,
        weight=np.ones(1),
        pose=pose,
        v=np.zeros((1, times, n)),
        lane=np.array([lane], np.int32),
        s=pose[..., 0],
        valid=there[None],
        half_length=none,
        half_width=none,
        reacts=none > 0,
        yields=none > 0,
    )


X = np.array([[0.0, 50.0, 90.0], [5.0, 50.0, 95.0], [10.0, 50.0, 100.0]])
LANES = [[1, 2, 3], [1, 2, 3], [1, 2, 4]]
ALL = np.ones(3, np.bool_)


def test_distance_is_between_centres_and_lanes_are_compared() -> None:
    found = errors(
        forecast(X, LANES),
        1.0,
        np.array([[13.0, 4.0], [50.0, 0.0], [100.0, 2.0]]),
        np.array([1, 5, 4]),
        ALL,
    )
    assert found.distance.tolist() == [5.0, 0.0, 2.0]
    assert found.right_lane.tolist() == [True, False, True]
    stats = statistics(found)
    assert stats == {
        "pairs": 3,
        "mean_m": pytest.approx(7 / 3),
        "p95_m": pytest.approx(4.7),
        "max_m": 5.0,
        "right_lane": pytest.approx(2 / 3),
        "gone": 0,
    }


def test_between_two_times_on_a_line_and_beyond_the_last_one_there() -> None:
    truth = np.array([[7.5, 0.0], [50.0, 0.0], [97.5, 0.0]])
    assert errors(forecast(X, LANES), 0.75, truth, np.array([1, 2, 3]), ALL).distance.tolist() == [
        0.0,
        0.0,
        0.0,
    ]
    assert errors(
        forecast(X, LANES), 9.0, X[2][:, None] * [1.0, 0.0], np.array([1, 2, 4]), ALL
    ).distance.tolist() == [0.0, 0.0, 0.0]
    assert errors(forecast(X, LANES), 0.3, truth, np.array([1, 2, 3]), ALL).right_lane.all()


def test_who_left_is_no_pair_and_who_was_taken_for_gone_is_off_lane() -> None:
    valid = [[True, True, True], [True, True, True], [True, False, False]]
    found = errors(
        forecast(X, LANES, valid),
        1.0,
        np.array([[11.0, 0.0], [50.0, 0.0], [0.0, 0.0]]),
        np.array([1, 2, -1]),
        np.array([True, True, False]),
    )
    assert statistics(found) == {
        "pairs": 2,
        "mean_m": 1.0,
        "p95_m": 1.0,
        "max_m": 1.0,
        "right_lane": 0.5,
        "gone": 1,
    }


def test_a_pose_of_who_is_taken_for_gone_does_not_count() -> None:
    x = [[0.0, 50.0], [10.0, 50.0], [-999.0, 50.0]]
    there = forecast(np.array(x), [[1, 2]] * 3, [[True, True], [True, True], [False, True]])
    for after in (0.5, 0.6, 0.7):  # half a second apart: between the second and the third
        assert errors(
            there, after, np.array([[10.0, 0.0], [50.0, 0.0]]), np.array([1, 2]), ALL[:2]
        ).distance.tolist() == [0.0, 0.0]


def test_whoever_is_on_no_lane_does_not_count_among_the_lanes() -> None:
    found = errors(
        forecast(X, [[-1, 2, 3]] * 3), 1.0, X[2][:, None] * [1.0, 0.0], np.array([-1, 2, 9]), ALL
    )
    assert statistics(found)["right_lane"] == 0.5


def test_statistics_are_over_all_pairs_not_over_cycles() -> None:
    truth = np.array([[10.0, 0.0], [50.0, 0.0], [100.0, 0.0]])
    many = errors(forecast(X, LANES), 1.0, truth, np.array([1, 2, 4]), ALL)
    one = errors(
        forecast(X[:, :1], [[1]] * 3), 1.0, np.array([[18.0, 0.0]]), np.array([1]), ALL[:1]
    )
    stats = statistics(together([many, one]))
    assert (stats["pairs"], stats["mean_m"], stats["right_lane"]) == (4, 2.0, 1.0)
    empty = statistics(together([]))
    assert empty == {
        "pairs": 0,
        "mean_m": None,
        "p95_m": None,
        "max_m": None,
        "right_lane": None,
        "gone": 0,
    }


# --- in episodes ---


def scene_of(name: str, *sets: str) -> ScenarioConfig:
    return config.load(builtin.scenario_path(name), sets)


def told(document: dict[str, object], name: str) -> list[dict[str, float]]:
    """The rows of one predictor."""
    rows: list[dict[str, float]] = document["forecasts"]  # type: ignore[assignment]
    return [row for row in rows if row["prediction"] == name]


def nothing(_: str) -> None:
    """Say nothing."""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["straight-line", "highway-exit-scripted"])
def test_the_copy_is_exact_where_the_ego_does_what_was_nominal(name: str) -> None:
    document = compare([scene_of(name, "planner.name=sumo")], [2], (), nothing)
    assert document["problems"] == []
    pairs = {row["horizon_s"]: row["pairs"] for row in told(document, "clone")}
    assert pairs[1.0] >= pairs[3.0] >= pairs[5.0] > 20
    for row in told(document, "clone"):
        assert row["max_m"] < 1e-9
        assert (row["right_lane"], row["gone"]) == (1.0, 0)
    for row in told(document, "constant_velocity"):
        assert row["pairs"] == pairs[row["horizon_s"]]
        assert row["mean_m"] > 0.01
    assert bool(told(document, "script")) == name.endswith("scripted")
    json.dumps(document, allow_nan=False)


@pytest.mark.slow
def test_horizons_between_two_cycles_are_judged_in_the_nearer_one() -> None:
    """Cycles 0.3 s apart: 0.9, 3.0 and 5.1 s; between two states of the forecast, 0.2 s apart,
    nobody leaves a line by more than 4.5 cm at 9 m/s2."""
    document = compare(
        [
            scene_of(
                "straight-line",
                "planner.name=sumo",
                "planner.period_s=0.3",
                "episode.time_limit_s=8",
            )
        ],
        [2],
        (),
        nothing,
    )
    rows = told(document, "clone")
    assert min(row["pairs"] for row in rows) > 20
    assert rows[1]["max_m"] < 1e-9
    assert max(row["max_m"] for row in rows) < 0.045


@pytest.mark.slow
def test_all_are_judged_on_the_same_pairs_and_nothing_is_disturbed() -> None:
    scene = scene_of("unprotected-left-turn-scripted", "planner.iterations=100")
    seen: list[str] = []
    document = compare([scene], [0, 1], (), seen.append)
    for horizon in (1.0, 3.0, 5.0):
        rows = [row for row in document["forecasts"] if row["horizon_s"] == horizon]
        assert [row["prediction"] for row in rows] == [
            "constant_velocity",
            "idm",
            "routes",
            "script",
            "clone",
        ]
        assert len({row["pairs"] for row in rows}) == 1
    for script, copy in zip(told(document, "script"), told(document, "clone"), strict=True):
        assert script["mean_m"] == pytest.approx(copy["mean_m"], abs=1e-3)
    assert any(text.startswith("episode 2 of 2") for text in seen)


@pytest.mark.slow
def test_each_ego_has_an_episode_of_its_own() -> None:
    found = command.forecast(
        "straight-line",
        ["ego", "ahead.7"],
        None,
        ("planner.name=sumo", "episode.depart_limit_s=1"),
        None,
        (),
        nothing,
    )
    assert found["outcomes"] == {"arrived": 1, "error": 1}
    assert found["seeds"] == [0]


@pytest.mark.slow
def test_asking_changes_no_episode() -> None:
    scene = scene_of("unprotected-left-turn", "planner.iterations=100")
    alone = run_episode(scene, 0).rows[0]["trace_digest"]

    def ask(_: Loop, drivers: dict, scenes: dict) -> None:
        for ego, seen in scenes.items():
            for name in ("constant_velocity", "idm", "routes", "clone"):
                assert drivers[ego].forecast(seen, name, 5.0) is not None

    assert run_episode(scene, 0, watch=ask).rows[0]["trace_digest"] == alone


def test_a_forecast_that_fails_is_an_outcome(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("no crystal ball")

    monkeypatch.setattr(SimulationOracles, "copied", broken)
    document = compare([scene_of("straight-line", "planner.name=sumo")], [0], (), nothing)
    assert document["outcomes"] == {"error": 1}
    assert document["problems"] == ["straight-line: ego ego: RuntimeError: no crystal ball"]


def test_the_table_shows_every_row() -> None:
    row = {
        "prediction": "idm",
        "horizon_s": 1.0,
        "pairs": 8,
        "mean_m": 0.126,
        "p95_m": 1.0,
        "max_m": 2.0,
        "right_lane": 0.975,
        "gone": 1,
        "forecast_ms_p50": 0.31,
    }
    none = {
        **row,
        "horizon_s": 3.0,
        "pairs": 0,
        "mean_m": None,
        "p95_m": None,
        "max_m": None,
        "right_lane": None,
        "gone": 0,
    }
    other = [{**each, "prediction": "clone", "forecast_ms_p50": None} for each in (row, none)]
    document = {
        "scenario": "s",
        "variant": "mcts-idm-1000",
        "outcomes": {"arrived": 2},
        "cycles": 40,
        "forecasts": [row, none, *other],
    }
    lines = command.table(document).splitlines()
    assert lines[0] == "s, driven by mcts-idm-1000: 2 arrived, 40 cycles; after 1, 3 s:"
    assert lines[-2] == "| s | idm | 8 0 | 0.13 - | 1.00 - | 2.00 - | 97.5 - | 1 0 | 0.3 |"
    assert lines[-1] == "| s | clone | 8 0 | 0.13 - | 1.00 - | 2.00 - | 97.5 - | 1 0 | - |"
    assert len({line.count("|") for line in lines[2:]}) == 1
