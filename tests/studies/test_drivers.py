"""The study of drivers: the fit against its definition, and the questions in small episodes."""

import json
from collections.abc import Mapping

import numpy as np
import pytest
from helpers import Agent, ego_at, lane, straight_road
from helpers_model import lanes_east, scene_of
from typer.testing import CliRunner

from sumo_mcts import config
from sumo_mcts.cli import app
from sumo_mcts.config import ScenarioConfig, builtin
from sumo_mcts.driver.driver import Driver
from sumo_mcts.episode import run_episode
from sumo_mcts.episode.loop import Loop
from sumo_mcts.evaluation.driver_events import Course, foreseen
from sumo_mcts.evaluation.lane_changes import FEATURES
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import BRAKES, STARTS, USUAL, Follow, Forecast, Intent, Scene
from sumo_mcts.studies.copies import (
    CHANGES,
    Asker,
    Reaction,
    follower_gap,
    reactions,
    slower,
    straight_from,
)
from sumo_mcts.studies.drivers import answers, asked, probabilities, usual_of, weighed
from sumo_mcts.studies.logistic import PENALTY, fitted, probability

# --- the fit ---


def samples(count: int, *weights: float) -> tuple[np.ndarray, np.ndarray]:
    """Samples of a model with these weights."""
    rng = np.random.default_rng(1)
    x = np.column_stack([np.ones(count), rng.random((count, len(weights) - 1))])
    return x, rng.random(count) < probability(x, np.array(weights))


def test_the_fit_finds_the_weights_that_made_the_samples() -> None:
    x, happened = samples(40000, -3.0, 4.0, -2.0, 0.0)
    assert fitted(x, happened) == pytest.approx([-3.0, 4.0, -2.0, 0.0], abs=0.2)


def test_no_other_weights_are_likelier() -> None:
    x, happened = samples(500, -1.0, 3.0, 0.5)

    def lost(weights: np.ndarray) -> float:
        p = probability(x, weights)
        likelihood = float(np.log(np.where(happened, p, 1.0 - p)).sum())
        return 0.5 * PENALTY * float((weights[1:] ** 2).sum()) - likelihood

    best = fitted(x, happened)
    for k in range(3):
        for step in (-0.01, 0.01):
            assert lost(best + step * np.eye(3)[k]) > lost(best)


def test_what_is_never_seen_gets_no_weight_and_what_separates_stays_finite() -> None:
    x = np.column_stack([np.ones(50), np.zeros(50), np.arange(50) >= 25])
    found = fitted(x, x[:, 2] > 0.0)
    assert found[1] == 0.0 and 2.0 < found[2] < 20.0


# --- who is asked ---


def test_who_is_asked_what() -> None:
    road = straight_road()
    scene = scene_of(
        ego_at(road, "a_1", 50.0), road,
        Agent("drives", "a_0", 90.0, 10.0), Agent("stands", "a_1", 90.0, 0.0), Agent("walks", ""),
    )  # fmt: skip
    seen = np.full((3, 2, len(FEATURES)), np.nan)
    seen[0, 1] = seen[1, 0] = 0.0
    found = asked(road, scene, straight_from(road, lane(road, "a_1")), seen)
    assert {name: who.tolist() for name, who in found.items()} == {
        "changes right": [False, True, False],
        "changes left": [True, False, False],
        "starts": [False, True, False],
        "stops": [True, False, False],
        "brakes hard": [True, False, False],
        "falls back": [True, False, False],
        "enters": [False, False, False],
    }


def test_the_follower_of_a_gap_is_the_nearest_behind_where_the_gap_is_empty() -> None:
    road = lanes_east()
    ego, left = ego_at(road, "a_1", 100.0, 10.0), lane(road, "a_2")

    def gap(*others: Agent) -> tuple[int, float] | None:
        return follower_gap(road, scene_of(ego, road, *others), left)

    assert gap(Agent("a", "a_2", 80.0), Agent("b", "a_2", 60.0)) == (0, 15.0)
    assert gap(Agent("a", "a_2", 60.0), Agent("b", "a_2", 80.0)) == (1, 15.0)
    assert gap(Agent("a", "a_2", 80.0), Agent("b", "a_2", 98.0)) is None  # beside the ego
    assert gap(Agent("a", "a_2", 80.0), Agent("b", "a_2", 104.0)) is None
    assert gap(Agent("a", "a_0", 80.0), Agent("b", "a_2", 120.0)) is None
    assert follower_gap(road, scene_of(ego, road, Agent("a", "a_2", 80.0)), -1) is None


def test_a_driver_makes_room_where_it_is_slower_than_without() -> None:
    def course(*speeds: float) -> Course:
        v = np.array([speeds]).T
        return Course(0.2, v, np.zeros(v.shape, np.int32), np.ones(v.shape, np.bool_))

    assert slower(course(10.0, 9.0, 9.0), course(10.0, 8.4, 9.0), 0)
    assert not slower(course(10.0, 9.0, 9.0), course(10.0, 8.6, 9.5), 0)


# --- probabilities ---


def two_ways() -> Forecast:
    """Agent 0 keeps its speed, with probability 0.3 it brakes; agent 1 changes to lane 1, with 0.3
    it does not."""
    v = np.full((2, 31, 2), 10.0)
    v[1, :, 0] = np.maximum(10.0 - 0.45 * np.arange(31), 0.0)
    on = np.zeros((2, 31, 2), np.int32)
    on[0, 20:, 1] = 1
    none = np.zeros(2)
    return Forecast(
        0.1, np.array([0.7, 0.3]), np.zeros((2, 31, 2, 4)), v, on, v, np.ones((2, 31, 2), np.bool_),
        none, none, none > 0, np.zeros((2, 2), np.bool_),
        (Intent(-1, USUAL), Intent(0, BRAKES)),
    )  # fmt: skip


def test_the_probability_is_the_weight_of_the_hypotheses_in_which_it_happens() -> None:
    forecast, road = two_ways(), lanes_east()
    courses = [foreseen(forecast, h, 0.5, 7) for h in (0, 1)]
    found = probabilities(road, np.zeros(2, np.int32), courses, courses[0], forecast.weight)
    assert found["brakes hard"] == pytest.approx([0.3, 0.0])
    assert found["falls back"] == pytest.approx([0.3, 0.0])
    assert found["changes left"] == pytest.approx([0.0, 0.7])
    assert found["changes right"] == pytest.approx([0.0, 0.0])


def test_a_hypothesis_is_weighed_against_the_usual_forecast_wherever_that_stands() -> None:
    forecast = two_ways()
    assert (usual_of(forecast), weighed(forecast)) == (0, ((Intent(0, BRAKES), 0.3),))
    turned = forecast._replace(
        weight=np.array([0.6, 0.3, 0.1]),
        intents=(Intent(0, BRAKES), Intent(-1, USUAL), Intent(1, STARTS)),
    )
    assert usual_of(turned) == 1
    assert [odds for _, odds in weighed(turned)] == pytest.approx([0.6 / 0.9, 0.1 / 0.4])


# --- in episodes ---


def weaving() -> ScenarioConfig:
    return config.load(
        builtin.scenario_path("dense-weaving"),
        ("episode.time_limit_s=20", "planner.iterations=100"),
    )


def recorded() -> tuple[list[tuple[Scene, dict[str, tuple[int, float]]]], RoadMap]:
    """Of the same episode, cycle by cycle: the scene, and lane and speed of all that are there."""
    cycles: list[tuple[Scene, dict[str, tuple[int, float]]]] = []
    names: set[str] = set()

    def watch(loop: Loop, _: Mapping[str, Driver], scenes: Mapping[str, Scene]) -> None:
        (scene,) = scenes.values()
        names.update(scene.agents.ids)
        there = sorted(names)
        states = loop.world.observer.states(there)
        found = {
            name: (int(row[5]), float(row[4]))
            for name, row in zip(there, states, strict=True)
            if row[7] > 0.0
        }
        cycles.append((scene, found))

    road = run_episode(weaving(), 1000, watch=watch).road
    assert road is not None
    return cycles, road


def changed(road: RoadMap, before: int, after: int) -> bool:
    return bool(road.edge[before] == road.edge[after] and road.index[after] > road.index[before])


@pytest.mark.slow
def test_questions_of_an_episode_against_a_recording_of_it() -> None:
    found = answers(weaving(), 1000)
    assert found.problems == () and sum(found.outcomes.values()) == 1
    cycles, road = recorded()
    left, stops = [], []
    for k, (scene, now) in enumerate(cycles[:-6]):
        for i, name in enumerate(scene.agents.ids):
            later = [states.get(name) for _, states in cycles[k + 1 : k + 7]]
            seen = [each for each in later if each is not None]
            if road.left[scene.agents.lane[i]] >= 0 and not road.internal[scene.agents.lane[i]]:
                happened = any(changed(road, now[name][0], on) for on, _ in seen)
                if happened or len(seen) == 6:
                    left.append(happened)
            if scene.agents.v[i] > 1.0:
                happened = any(v < 0.1 for _, v in seen)
                if happened or len(seen) == 6:
                    stops.append(happened)
    assert found.samples["changes left"].happened.tolist() == left and any(left)
    assert found.samples["stops"].happened.tolist() == stops
    for name, sample in found.samples.items():
        assert ((sample.present >= 0.0) & (sample.present <= 1.0)).all(), name
        assert len(sample.present) == len(sample.happened) == len(sample.seen)


@pytest.mark.slow
def test_who_makes_room_does_so_for_the_change_alone() -> None:
    """Copies in which the ego does the same are the same; where it changes, followers brake."""
    scenario = config.load(
        builtin.scenario_path("dense-exit"), ("episode.time_limit_s=20", "planner.iterations=100")
    )
    found: list[Reaction] = []

    def watch(loop: Loop, _: Mapping[str, Driver], scenes: Mapping[str, Scene]) -> None:
        (scene,) = scenes.values()
        if round(scene.time * 2) % 4 == 0:
            lanes = straight_from(loop.world.road, scene.ego.lane)
            found.extend(reactions(loop, scene, lanes, np.zeros(len(scene.agents.ids), np.bool_)))
            ask = Asker(loop, scene)
            keeps = Follow(np.full(ask.steps, scene.ego.v), 0)
            one, other = ask.copy(keeps), ask.copy(keeps)
            np.testing.assert_array_equal(one.v, other.v)
            assert not any(slower(one, other, i) for i in range(one.v.shape[1]))

    run_episode(scenario, 1000, watch=watch)
    changes = [each for each in found if each.question == CHANGES]
    assert any(each.happened for each in changes)


@pytest.mark.slow
def test_the_command_prints_scores_and_weights() -> None:
    options = ["--families", "krauss,idm", "--set", "episode.time_limit_s=10", "--fit", "--json"]
    found = CliRunner().invoke(app, ["drivers", "dense-weaving", "--first", "1000", *options])
    assert found.exit_code == 0, found.output
    document = json.loads(found.stdout)
    assert document["outcomes"] == {"timeout": 2}
    rows = {(row["question"], row["by"]): row for row in document["questions"]}
    for row in rows.values():
        assert sum(each["asked"] for each in row["reliability"]) == row["asked"]
    assert ("changes left", "model") in rows and ("stops", "model") not in rows
    assert list(document["weights"]) == list(FEATURES)


def test_an_unknown_family_is_named() -> None:
    found = CliRunner().invoke(app, ["drivers", "dense-weaving", "--families", "krauss,lada"])
    assert found.exit_code == 2 and "--families krauss,lada" in found.stderr
