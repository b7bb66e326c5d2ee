"""Controller in a libsumo loop of one's own: the decisions of `run`, and nothing before, after or
besides."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import libsumo
import numpy as np
import pytest

from sumo_mcts import config
from sumo_mcts.config import ScenarioConfig, builtin
from sumo_mcts.controller import Controller
from sumo_mcts.driver.params import streams
from sumo_mcts.episode import run_episode
from sumo_mcts.errors import ConfigError
from sumo_mcts.world.actors import Actors
from sumo_mcts.world.arguments import sumo_arguments
from sumo_mcts.world.crowd import cast
from sumo_mcts.world.roadmap import read_roadmap

SEED = 4
State = tuple[float, str, float, float, float, float]


def scenario(*overrides: str) -> ScenarioConfig:
    return config.load(
        builtin.scenario_path("highway-exit"), ("planner.iterations=200", *overrides)
    )


def state_of(vehicle: str) -> State:
    get: Any = libsumo.vehicle
    return (
        libsumo.simulation.getTime(),
        get.getLaneID(vehicle),
        get.getLanePosition(vehicle),
        get.getSpeed(vehicle),
        *get.getPosition(vehicle),
    )


class Simulation:
    """The built-in scene in a loop of its own."""

    def __init__(self, scene: ScenarioConfig, folder: Path) -> None:
        drawn = cast(
            scene.traffic,
            ["ego"],
            read_roadmap(str(scene.sumo.net)),
            np.random.default_rng(streams(SEED).traffic),
        )
        libsumo.start(
            [
                "sumo",
                *sumo_arguments(scene, SEED, drawn, folder, ()),
                "--no-step-log",
                "--no-warnings",
            ]
        )
        road = read_roadmap(str(scene.sumo.net))
        self._actors = Actors(drawn.actors, road, 0.1, egos=["ego"])

    def step(self) -> None:
        self._actors.before_step(libsumo.simulation.getTime())
        libsumo.simulationStep()


@pytest.fixture
def simulation(tmp_path: Path) -> Any:
    yield Simulation(scenario(), tmp_path)
    libsumo.close()


def drive(simulation: Simulation, controller: Controller) -> list[State]:
    trajectory = []
    for _ in range(1000):
        controller.step()
        simulation.step()
        if "ego" in libsumo.vehicle.getIDList():
            trajectory.append(state_of("ego"))
        elif trajectory:
            return trajectory
    raise AssertionError("the ego never left")


@pytest.mark.slow
@pytest.mark.parametrize(
    "sets",
    [(), ("sensor.position_error_m=0.3", "sensor.drop_probability=0.2", "sensor.occlusion=true")],
)
def test_the_same_trajectory_as_run_to_the_bit(
    sets: tuple[str, ...], simulation: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = drive(simulation, Controller("ego", scenario(*sets), seed=SEED))
    libsumo.close()

    from sumo_mcts.episode.loop import Loop

    seen = []
    step = Loop._step

    def watched(loop: Loop) -> None:
        step(loop)
        if "ego" in libsumo.vehicle.getIDList():
            seen.append(state_of("ego"))

    monkeypatch.setattr(Loop, "_step", watched)
    result = run_episode(scenario(*sets), SEED)
    assert result.rows[0]["outcome"] == "arrived"
    assert seen[: len(own)] == own[: len(seen)]
    assert len(seen) >= len(own) - 2


@pytest.mark.slow
@pytest.mark.smoke
def test_drives_only_while_the_ego_is_there(simulation: Simulation) -> None:
    controller = Controller("ego", {"planner": {"iterations": 50}})
    controller.step()
    assert not controller.driving
    simulation.step()
    controller.step()
    assert controller.driving
    assert libsumo.vehicle.getSpeedMode("ego") == 0
    assert drive(simulation, controller)
    controller.step()
    assert not controller.driving
    controller.step()


def test_release_gives_back_the_users_own_modes(simulation: Simulation) -> None:
    controller = Controller("ego", {"planner": {"iterations": 50}})
    simulation.step()
    libsumo.vehicle.setSpeedMode("ego", 7)
    libsumo.vehicle.setLaneChangeMode("ego", 512)
    controller.step()
    assert (libsumo.vehicle.getSpeedMode("ego"), libsumo.vehicle.getLaneChangeMode("ego")) == (0, 0)
    controller.release()
    assert (libsumo.vehicle.getSpeedMode("ego"), libsumo.vehicle.getLaneChangeMode("ego")) == (
        7,
        512,
    )
    simulation.step()
    controller.step()
    assert not controller.driving
    assert libsumo.vehicle.getSpeedMode("ego") == 7


def test_decides_once_a_period(simulation: Simulation) -> None:
    controller = Controller("ego", {"planner": {"iterations": 50, "period_s": 0.3}})
    thoughts = []
    for _ in range(13):
        controller.step()
        thoughts.append(controller.thought)
        simulation.step()
    assert thoughts[0] is None
    assert [a is not b for a, b in pairwise(thoughts)] == [True, False, False] * 4


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"planner": {"iteration": 5}}, "planner.iteration: unknown key"),
        ({"prediction": {"name": "script"}}, "prediction.name: script reads the scripts"),
        (
            {"prediction": {"name": "clone"}},
            "prediction.name: clone copies a simulation .* allowed: idm, constant_velocity, routes",
        ),
    ],
)
def test_wrong_settings_are_named(
    simulation: Simulation, settings: dict[str, Any], named: str
) -> None:
    with pytest.raises(ConfigError, match=named):
        Controller("ego", settings)


def test_says_that_no_simulation_runs() -> None:
    with pytest.raises(ConfigError, match=r"libsumo\.start"):
        Controller("ego")


def test_wrong_arguments_are_named(simulation: Simulation) -> None:
    with pytest.raises(ConfigError, match=r"^seed: a whole number from 0 on, got -1$"):
        Controller("ego", seed=-1)
    with pytest.raises(
        ConfigError,
        match=r"^Controller: config: a scenario or a mapping of its sections, got 'straight-line'$",
    ):
        Controller("ego", "straight-line")  # type: ignore[arg-type]
