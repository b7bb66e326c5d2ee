"""What a forecast takes the ego to do, and who is asked for it."""

import numpy as np
import pytest
from helpers import Agent, ego_at
from helpers_model import PHYSICS, lanes_east, scenario, scene_of

from sumo_mcts.arrays import Ints
from sumo_mcts.driver.forecaster import (
    NOMINAL_S,
    Cycle,
    Forecaster,
    LastDecision,
    nominal_command,
    nominal_speeds,
)
from sumo_mcts.prediction.interface import Oracles
from sumo_mcts.scene import Follow, Plan, Release, Scene, Scripted

ROAD = lanes_east(1)


def last(v: np.ndarray, step: float = 0.1, side: int = 1) -> LastDecision:
    """A plan with these speeds, and its command, decided at 10 s."""
    time = step * np.arange(1.0, len(v) + 1)
    plan = Plan(time, v, np.zeros(len(v), np.int32), time, np.zeros((len(v), 4)))
    return LastDecision(plan, Follow(v, side), 10.0)


def test_the_ego_goes_on_with_its_plan_for_a_while() -> None:
    speeds = nominal_speeds(last(np.linspace(0.1, 5.0, 50)), 11.0, 0.2)
    assert speeds == pytest.approx(1.0 + 0.2 * np.arange(1, round(NOMINAL_S / 0.2) + 1))


def test_the_ego_goes_on_with_its_plan_as_far_as_there_is_one() -> None:
    assert len(nominal_speeds(last(np.full(15, 3.0)), 11.0, 0.2)) == 2
    assert len(nominal_speeds(last(np.full(5, 3.0)), 11.0, 0.2)) == 0
    assert len(nominal_speeds(last(np.zeros(0)), 10.0, 0.2)) == 0
    assert len(nominal_speeds(LastDecision(), 10.0, 0.2)) == 0


def test_a_lane_change_is_commanded_once() -> None:
    decided = last(np.arange(30.0))
    at_once, later = (nominal_command(decided, now, 0.1) for now in (10.0, 11.0))
    assert isinstance(at_once, Follow) and isinstance(later, Follow)
    assert (at_once.lane_change, later.lane_change) == (1, 0)
    assert list(at_once.speeds) == list(range(20)) and list(later.speeds) == list(range(10, 30))


def test_after_the_last_command_sumo_drives() -> None:
    assert isinstance(nominal_command(last(np.arange(5.0)), 10.5, 0.1), Release)
    assert isinstance(nominal_command(LastDecision(), 10.5, 0.1), Release)


def asked(name: str) -> tuple[list[str], list[tuple[Follow | Release, int]]]:
    """What a predictor asks oracles about the only agent, and of a copy of the simulation."""
    questions: list[str] = []
    copies: list[tuple[Follow | Release, int]] = []
    standing = Scripted(
        pose=np.tile([400.0, 0.0, 1.0, 0.0], (6, 1)),
        v=np.zeros(6),
        lane=np.zeros(6, np.int32),
        s=np.full(6, 402.5),
        valid=np.ones(6, np.bool_),
    )

    def lanes(vehicle: str, lane: int) -> Ints:
        questions.append(f"lanes of {vehicle}")
        return np.array([lane], np.int32)

    def script(vehicle: str, time: float, step: float, count: int) -> Scripted:
        questions.append(f"script of {vehicle}")
        return standing

    def clone(
        scene: Scene, command: Follow | Release, step: float, count: int
    ) -> dict[int, Scripted]:
        copies.append((command, count))
        return {0: standing}

    scene = scene_of(ego_at(ROAD, "a_0", 300.0, 5.0), ROAD, Agent("car", "a_0", 402.5, 9.0))
    forecaster = Forecaster(scenario(), ROAD, PHYSICS, Oracles(lanes, script, clone))
    cycle = Cycle(scene, np.zeros(1, np.int32), last(np.full(30, 5.0))._replace(time=0.0), -np.inf)
    found = forecaster.ask(name, cycle, 1.0)
    stands = bool((found.v[0, :, 0] == 0.0).all())
    assert stands == (name in {"script", "clone"})
    return questions, copies


@pytest.mark.parametrize("name", ["idm", "constant_velocity"])
def test_what_sensors_see_needs_no_oracle(name: str) -> None:
    assert asked(name) == ([], [])


def test_an_oracle_asks_what_it_is_named_after() -> None:
    assert asked("routes") == (["lanes of car"], [])
    assert asked("script") == (["script of car"], [])


def test_a_copy_is_told_what_the_ego_goes_on_with() -> None:
    questions, ((command, count),) = asked("clone")
    assert questions == ["script of car"] and count == 6
    assert isinstance(command, Follow) and list(command.speeds) == [5.0] * 20


def test_an_oracle_that_cannot_ask_is_car_following() -> None:
    scene = scene_of(ego_at(ROAD, "a_0", 300.0, 5.0), ROAD, Agent("car", "a_0", 402.5, 9.0))
    forecaster = Forecaster(scenario(), ROAD, PHYSICS, None)
    cycle = Cycle(scene, np.zeros(1, np.int32), LastDecision(), -np.inf)
    usual = forecaster.ask("idm", cycle, 1.0)
    for name in ("routes", "script", "clone"):
        assert (forecaster.ask(name, cycle, 1.0).pose == usual.pose).all()
    assert not (forecaster.ask("constant_velocity", cycle, 1.0).pose == usual.pose).all()
