"""The protocol of predictors, and the questions that an oracle may ask."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from sumo_mcts.arrays import Ints
from sumo_mcts.prediction.forecast import Question, times_of
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Answers, Follow, Forecast, Release, Scene, Scripted, ToldPlans


def no_plan(*_: object) -> None:
    """No vehicle tells its plan."""


class Oracles(NamedTuple):
    """Questions about the future that no sensor can answer. Only oracles ask them, but for the last
    one: connected egos ask each other."""

    # vehicle, its lane: the lanes that it is really going to take
    lanes: Callable[[str, int], Ints]
    # vehicle, time (s), step (s), count: its coming states, if it has a script
    script: Callable[[str, float, float, int], Scripted | None]
    # scene, command of its ego, step (s), count: the coming states of its agents (by index), in a
    # copy of the simulation
    clone: Callable[[Scene, Follow | Release, float, int], Mapping[int, Scripted]]
    # vehicle, time (s), step (s), count: its coming states by its last plan, if it is a connected
    # ego that has one; not valid beyond the end of the plan
    plan: Callable[[str, float, float, int], Scripted | None] = no_plan


class Predictor(Protocol):
    """From a question to a forecast. One object predicts for one ego in one episode."""

    oracle: bool  # asks for what no sensor sees, and is labelled so

    def start(self, road: RoadMap, oracles: Oracles | None) -> None:
        """Before the first question, and again where the simulation changed the map; `oracles` only
        for an oracle."""

    def predict(self, question: Question) -> Forecast:
        """The agents of the scene, in their order, at multiples of params.step from now on."""


class OracleRecorder:
    """Passes questions on to oracles and keeps the answers.

    With these the decision can be taken again without the simulation.
    """

    def __init__(self, oracles: Oracles | None) -> None:
        self._ask = oracles
        self.forget()

    def forget(self) -> None:
        """A new cycle begins."""
        self._lanes: dict[str, Ints] = {}
        self._scripts: dict[str, Scripted] = {}
        self._copies: dict[int, Scripted] = {}
        self._told: dict[str, Scripted] = {}

    def oracles(self) -> Oracles | None:
        """The oracles that are recorded; None where there are none."""
        if self._ask is None:
            return None
        return Oracles(self._lanes_of, self._script, self._clone, self._plan)

    def answers(self, ids: Sequence[str]) -> Answers:
        """The answers of this cycle, about the agents with these ids."""
        lanes = (
            tuple(self._lanes.get(vehicle, np.zeros(0, np.int32)) for vehicle in ids)
            if self._lanes
            else ()
        )
        scripts = {i: self._scripts[name] for i, name in enumerate(ids) if name in self._scripts}
        plans = {i: self._told[name] for i, name in enumerate(ids) if name in self._told}
        told = ToldPlans(**_stacked(plans)) if plans else ToldPlans()
        states = {**scripts, **self._copies}
        if not states:
            return Answers(lanes, told=told)
        return Answers(
            ways=lanes,
            scripted=np.array([ids[i] in self._scripts for i in states], np.bool_),
            told=told,
            **_stacked(states),
        )

    def _lanes_of(self, vehicle: str, lane: int) -> Ints:
        assert self._ask is not None
        self._lanes[vehicle] = self._ask.lanes(vehicle, lane)
        return self._lanes[vehicle]

    def _script(self, vehicle: str, time: float, step: float, count: int) -> Scripted | None:
        assert self._ask is not None
        return _noted(self._scripts, vehicle, self._ask.script(vehicle, time, step, count))

    def _clone(
        self, scene: Scene, command: Follow | Release, step: float, count: int
    ) -> Mapping[int, Scripted]:
        assert self._ask is not None
        found = self._ask.clone(scene, command, step, count)
        self._copies.update(found)
        return found

    def _plan(self, vehicle: str, time: float, step: float, count: int) -> Scripted | None:
        assert self._ask is not None
        return _noted(self._told, vehicle, self._ask.plan(vehicle, time, step, count))


def _noted(answers: dict[str, Scripted], vehicle: str, answer: Scripted | None) -> Scripted | None:
    """The answer about a vehicle, kept where there is one."""
    if answer is not None:
        answers[vehicle] = answer
    return answer


def _stacked(states: Mapping[int, Scripted]) -> dict[str, Any]:
    """The columns `agent` and those of Scripted, as far as there are states of all agents."""
    count = min(len(each.v) for each in states.values())
    return {
        "agent": np.array(list(states), np.int32),
        **{
            name: np.stack([getattr(each, name)[:count] for each in states.values()])
            for name in Scripted._fields
        },
    }


def checked(forecast: object, road: RoadMap, question: Question) -> Forecast:
    """A plugin's forecast with the types that compiled code reads without checking.

    Raises ValueError where it does not answer the question.
    """
    if not isinstance(forecast, Forecast):
        raise ValueError(f"no forecast but {type(forecast).__name__}")
    h, n = len(np.atleast_1d(forecast.weight)), len(question.scene.agents.ids)
    step = question.params.step
    times = times_of(question.seconds, step)
    if abs(forecast.dt - step) > 1e-9:
        raise ValueError(f"dt: {forecast.dt:g} s instead of {step:g} s")
    shapes = {
        "weight": (h,), "pose": (h, times, n, 4), "v": (h, times, n), "lane": (h, times, n),
        "s": (h, times, n), "valid": (h, times, n),
        "half_length": (n,), "half_width": (n,), "reacts": (n,), "yields": (h, n),
    }  # fmt: skip
    kinds: dict[str, type[np.generic]] = {
        "lane": np.int32, "valid": np.bool_, "reacts": np.bool_, "yields": np.bool_,
    }  # fmt: skip
    arrays: dict[str, Any] = {
        name: np.ascontiguousarray(getattr(forecast, name), kinds.get(name, np.float64))
        for name in shapes
    }
    for name, shape in shapes.items():
        if arrays[name].shape != shape:
            raise ValueError(f"{name}: shape {arrays[name].shape} instead of {shape}")
        if not np.isfinite(arrays[name]).all():
            raise ValueError(f"{name}: not finite")
    if h == 0 or (arrays["weight"] <= 0.0).any() or abs(arrays["weight"].sum() - 1.0) > 1e-6:
        raise ValueError("weight: not positive numbers that sum to 1")
    if ((arrays["lane"] < -1) | (arrays["lane"] >= len(road.lane_ids))).any():
        raise ValueError(f"lane: not within -1..{len(road.lane_ids) - 1}")
    return Forecast(dt=step, **arrays)
