"""The gymnasium environment: its interface, the same episodes as everybody else's, and one
simulation a process."""

import json
import math
import os
import re
import subprocess
import sys
import warnings
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import gymnasium
import libsumo
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from helpers_networks import netconvert

from sumo_mcts import config
from sumo_mcts.driver.observation import EGO, Actions, Shown, bounds
from sumo_mcts.episode import run_episode
from sumo_mcts.errors import ConfigError
from sumo_mcts.gym import ENVIRONMENT, REWARD, DriveEnv
from sumo_mcts.planners.actions import FOLLOW
from sumo_mcts.planners.base import Situation, Task
from sumo_mcts.records import ROW_KEYS
from sumo_mcts.scenarios import load_scenario
from sumo_mcts.scene import Decision
from sumo_mcts.world.simulation import Simulation, SimulationError

SHORT = ("episode.time_limit_s=6", "episode.stop_time_s=6")
INPUTS = Path(__file__).parent / "bad_inputs"


@pytest.fixture
def env() -> Iterator[DriveEnv]:
    environment = DriveEnv("straight-line")
    yield environment
    environment.close()


def drive(
    environment: DriveEnv, actions: list[int], seed: int
) -> tuple[list[dict[str, Any]], list[float], dict[str, Any]]:
    """Observations, rewards, and the last info of an episode; the last action goes on."""
    seen, rewards = [environment.reset(seed=seed)[0]], []
    for k in range(1000):
        observation, reward, terminated, truncated, info = environment.step(
            np.int64(actions[min(k, len(actions) - 1)])
        )
        seen.append(observation)
        rewards.append(reward)
        assert observation in environment.observation_space
        if terminated or truncated:
            assert truncated == (info["row"]["outcome"] == "timeout") != terminated
            return seen, rewards, info
        assert "row" not in info
    raise AssertionError("no end")


@pytest.mark.smoke
def test_gymnasium_finds_nothing_amiss() -> None:
    environment = gymnasium.make(ENVIRONMENT, scenario="straight-line", disable_env_checker=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(environment.unwrapped)
    environment.close()


@pytest.mark.parametrize("seed", [1, 5])
def test_a_policy_is_judged_alike_in_the_environment_and_as_a_planner(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = load_scenario("unprotected-left-turn", *SHORT)
    actions = [
        int(action)
        for action in np.random.default_rng(seed).integers(len(Actions(scene).table), size=40)
    ]

    class Policy:
        needs_forecast = True

        def __init__(self, scenario: config.ScenarioConfig) -> None:
            self._actions, self._coming = Actions(scenario), iter(actions)

        def start(self, task: Task, seed: int) -> None:
            self._task = task

        def plan(self, situation: Situation) -> Decision:
            return self._actions.decision(self._task, situation, next(self._coming))

    monkeypatch.setattr("sumo_mcts.driver.driver.make_planner", Policy)
    ours = run_episode(scene, seed).rows[0]
    environment = DriveEnv("unprotected-left-turn", assignments=SHORT)
    seen, _, info = drive(environment, actions, seed)
    row = info["row"]
    assert tuple(row) == ROW_KEYS
    told = [
        key
        for key in ROW_KEYS
        if key not in ("key", "variant", "planner", "wall_s", "realtime_factor", "deadline_misses")
        and "plan_ms" not in key
    ]
    assert {key: row[key] for key in told} == {key: ours[key] for key in told}
    assert row["cycles"] == len(seen) - 1 > 5
    assert (row["planner"], row["variant"], row["key"]) == (
        "policy",
        "policy",
        f"unprotected-left-turn--policy--{seed}",
    )


def test_a_seed_is_an_episode_and_later_ones_follow_from_it(env: DriveEnv) -> None:
    def three(seed: int) -> list[Any]:
        rows = [env.reset(seed=seed)[0], env.reset()[0], env.reset()[0]]
        return [np.concatenate([part.ravel() for part in row.values()]).tolist() for row in rows]

    one, same, other = three(7), three(7), three(8)
    assert one == same
    assert one[0] != one[1] != one[2]
    assert one[0] != other[0]


def test_the_reward_is_what_the_referee_counts(env: DriveEnv) -> None:
    _, rewards, info = drive(env, [int(np.argmax(env.actions[:, 0] == 2.6))], 2)
    row = info["row"]
    assert row["outcome"] in ("arrived", "collision", "timeout")
    outcome = {"arrived": REWARD["arrived"], "collision": REWARD["collision"]}.get(
        row["outcome"], 0.0
    )
    imposed = row["imposed_brakes_2"] + row["imposed_brakes_3"] + row["imposed_brakes_4"]
    least = (
        REWARD["progress"] * row["distance_m"]
        + outcome
        + REWARD["imposed"] * imposed
        + REWARD["red"] * row["red_lights_run"]
    )
    passed = row["travel_time_s"] if row["travel_time_s"] is not None else 0.5 * row["cycles"]
    comfort = REWARD["discomfort"] * (1.0 - row["comfortable_share"]) * passed
    assert sum(rewards) == pytest.approx(least + REWARD["time"] * passed + comfort, abs=0.2)


def test_weights_of_the_reward() -> None:
    only = dict.fromkeys(REWARD, 0.0)
    environment = DriveEnv("straight-line", assignments=SHORT, reward={**only, "progress": 2.0})
    _, rewards, info = drive(environment, [0], 0)
    assert sum(rewards) == pytest.approx(2.0 * info["row"]["distance_m"])


def test_what_is_seen_moves_as_the_ego_does(env: DriveEnv) -> None:
    seen, _, _ = drive(env, [0], 3)
    names = [name for name, _, _ in EGO]
    speed, left = names.index("speed, m/s"), names.index("distance to the end of its route, m")
    for before, after in pairwise(seen[:-1]):
        driven = before["ego"][left] - after["ego"][left]
        assert driven == pytest.approx(
            0.5 * after["ego"][speed], abs=0.15 * 0.5 * 10.0
        )  # half a second, accelerations below 3 m/s2
    for observation in seen:
        there = observation["agents"][:, 0] > 0
        distances = np.hypot(*observation["agents"][there, 1:3].T)
        assert (np.diff(distances) >= 0.0).all()
        points = observation["route"][observation["route"][:, 0] > 0, 1:3]
        assert np.hypot(*np.diff(points, axis=0).T) == pytest.approx(10.0, abs=0.5)
        assert not len(points) or points[0] == pytest.approx([10.0, 0.0], abs=0.5)


def test_the_actions_are_those_of_the_search(env: DriveEnv) -> None:
    planner = load_scenario("straight-line").planner
    kept = env.actions[env.actions[:, 1] == 0.0, 0].tolist()
    assert kept == [FOLLOW, *planner.accelerations_mps2]
    assert sorted(set(env.actions[:, 1])) == [-1.0, 0.0, 1.0]
    env.reset(seed=0)
    for wrong in (-1, len(env.actions), 0.5):
        with pytest.raises(ValueError, match="allowed: 0 to 14"):
            env.step(wrong)  # type: ignore[arg-type]


def test_more_is_shown_where_it_is_asked_for() -> None:
    environment = DriveEnv("straight-line", agents=2, points=3)
    observation, _ = environment.reset(seed=0)
    assert {name: part.shape for name, part in observation.items()} == {
        "ego": (10,),
        "agents": (2, 11),
        "route": (3, 5),
        "stop_line": (7,),
    }
    assert {name: low.shape for name, (low, _) in bounds(Shown(2, 3)).items()} == {
        name: part.shape for name, part in observation.items()
    }
    environment.close()


def test_a_picture_of_the_scene() -> None:
    environment = DriveEnv("straight-line", render_mode="rgb_array")
    environment.reset(seed=0)
    first = environment.render()
    environment.step(np.int64(8))
    second = environment.render()
    environment.close()
    assert first is not None and second is not None
    assert first.ndim == 3 and first.shape[2] == 3 and first.dtype == np.uint8
    assert (first != second).any()


# --- one simulation a process ---


def test_the_environment_that_was_reset_last_drives(env: DriveEnv) -> None:
    env.reset(seed=0)
    other = DriveEnv("highway-exit")
    other.reset(seed=0)
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"another environment .*AsyncVectorEnv"):
        env.step(np.int64(0))
    other.step(np.int64(0))
    env.reset(seed=0)
    with pytest.raises(gymnasium.error.ResetNeeded, match="another environment"):
        other.step(np.int64(0))
    env.step(np.int64(0))


def test_a_simulation_of_somebody_else_is_left_alone(env: DriveEnv) -> None:
    net = load_scenario("straight-line").sumo.net
    libsumo.start(["sumo", "-n", str(net), "--no-step-log", "--no-warnings"])
    with pytest.raises(RuntimeError, match="a simulation runs in this process already"):
        env.reset(seed=0)
    assert libsumo.simulation.isLoaded()
    libsumo.close()
    env.reset(seed=0)


def test_steps_need_an_episode(env: DriveEnv) -> None:
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        env.step(np.int64(0))
    env.reset(seed=0)
    env.close()
    env.close()
    assert not libsumo.simulation.isLoaded()
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        env.step(np.int64(0))


TWO = """
import json
import gymnasium, numpy as np
both = gymnasium.make_vec("sumo_mcts.gym:sumo_mcts/Drive-v0", num_envs=2, vectorization_mode="async", vector_kwargs={"context": "spawn"},
                          scenario="straight-line", assignments=("episode.stop_time_s=6",))
first, _ = both.reset(seed=4)
digests, totals = {}, np.zeros(2)
while len(digests) < 2:
    _, rewards, terminated, truncated, info = both.step(np.array([8, 8]))
    for k in range(2):
        totals[k] += rewards[k] if k not in digests else 0.0
        if (terminated | truncated)[k] and k not in digests:
            digests[k] = info["row"]["trace_digest"][k]
both.close()
print(json.dumps([[first["agents"][k].tolist(), digests[k], totals[k]] for k in range(2)]))
"""


@pytest.mark.slow
def test_two_at_once_in_processes_of_their_own() -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    done = subprocess.run(
        [sys.executable, "-c", TWO], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    for seed, (agents, digest, total) in zip((4, 5), json.loads(done.stdout), strict=True):
        seen, rewards, info = drive(
            DriveEnv("straight-line", assignments=("episode.stop_time_s=6",)), [8], seed
        )
        assert seen[0]["agents"].tolist() == agents
        assert info["row"]["trace_digest"] == digest
        assert sum(rewards) == pytest.approx(total)


# --- what may be asked for ---


def test_a_sumocfg_of_the_users_own() -> None:
    environment = DriveEnv(
        sumocfg=INPUTS / "good.sumocfg", ego="ego", assignments=("episode.time_limit_s=5",)
    )
    _, _, info = drive(environment, [0], 3)
    row = run_episode(
        load_scenario(
            INPUTS / "good.sumocfg", "planner.name=sumo", "episode.time_limit_s=5", ego="ego"
        ),
        3,
    ).rows[0]
    assert (info["row"]["scenario"], info["row"]["ego"], info["row"]["free_flow_s"]) == (
        row["scenario"],
        row["ego"],
        row["free_flow_s"],
    )


def test_a_stop_is_no_decision(tmp_path: Path) -> None:
    """The step in which SUMO has the ego stand there lasts until it lets the ego go."""
    net = netconvert(
        tmp_path,
        '<node id="a" x="0" y="0"/><node id="b" x="200" y="0"/>',
        '<edge id="ab" from="a" to="b" speed="13.9"/>',
        "",
    )
    routes, sumocfg = tmp_path / "x.rou.xml", tmp_path / "x.sumocfg"
    routes.write_text(
        '<routes><vehicle id="ego" depart="0" departSpeed="5"><route edges="ab"/>'
        '<stop lane="ab_0" endPos="60" duration="20"/></vehicle></routes>'
    )
    sumocfg.write_text(
        f'<configuration><net-file value="{net}"/><route-files value="{routes}"/>'
        '<step-length value="0.1"/></configuration>'
    )
    environment = DriveEnv(sumocfg=sumocfg, ego="ego")
    _, rewards, info = drive(environment, [0], 1)
    row = info["row"]
    assert row["outcome"] == "arrived" and row["longest_stop_s"] >= 19.0
    assert len(rewards) < (row["travel_time_s"] - 19.0) / 0.5 + 2


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"scenario": "nowhere"}, "nowhere: no such scenario"),
        ({"sumocfg": INPUTS / "good.sumocfg"}, "good.sumocfg: --ego: not given"),
        ({"sumocfg": INPUTS / "good.sumocfg", "ego": "any"}, "ego: any: name one vehicle"),
        (
            {"scenario": load_scenario("straight-line")},
            "load_scenario: scenario: a name or a path, got ScenarioConfig(name='straight-line'",
        ),
        ({"agents": -1}, "agents: a whole number from 1 on, got -1"),
        ({"points": 2.5}, "points: a whole number from 1 on, got 2.5"),
        ({"reward": {"progress": math.nan}}, "reward: progress: a finite number, got nan"),
        ({"reward": ["progress"]}, "reward: a mapping of terms to weights, got ['progress']"),
        ({"reward": {"speed": 1.0}}, "reward: speed: unknown term; allowed: progress, time"),
        ({"render_mode": "human"}, "render_mode: human: not one of rgb_array"),
        (
            {"assignments": ("planner.name=nobody:Nothing",)},
            "planner.name: nobody:Nothing: code that a scenario names runs only",
        ),
        ({"assignments": ("egos=[{id: a}, {id: b}]",)}, "egos: an environment has one, not 2"),
    ],
)
def test_wrong_arguments_are_named(arguments: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(said)):
        DriveEnv(**arguments)


def test_there_is_nothing_to_see_before_the_first_episode() -> None:
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        DriveEnv("straight-line", render_mode="rgb_array").render()


def test_a_simulation_that_fails_ends_the_episode_with_its_message(
    env: DriveEnv, monkeypatch: pytest.MonkeyPatch
) -> None:
    env.reset(seed=0)
    env.step(np.int64(0))

    def fails(simulation: Simulation) -> None:
        raise SimulationError("the road is gone")

    monkeypatch.setattr(Simulation, "step", fails)
    _, reward, terminated, truncated, info = env.step(np.int64(0))
    assert (reward, terminated, truncated) == (0.0, True, False)
    assert (info["row"]["outcome"], info["row"]["error"]) == ("error", "the road is gone")
    monkeypatch.undo()
    env.reset(seed=0)


def test_an_ego_that_never_departs_is_no_episode() -> None:
    environment = DriveEnv(
        "straight-line", ego="ahead.7", assignments=("episode.depart_limit_s=1",)
    )
    with pytest.raises(
        RuntimeError,
        match="straight-line: seed 0: error before the first decision: never departed within 1 s",
    ):
        environment.reset(seed=0)
    assert not libsumo.simulation.isLoaded()
