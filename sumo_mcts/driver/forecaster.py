"""Asks predictors what the other agents will do, with the inputs that the driver has in a cycle."""

from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Ints
from sumo_mcts.config import ScenarioConfig
from sumo_mcts.driver.factories import forecast_s, make_predictor
from sumo_mcts.driver.params import Physics, traffic_params
from sumo_mcts.driver.sensor import room_m
from sumo_mcts.errors import ConfigError, in_one_line
from sumo_mcts.model.local_map import State
from sumo_mcts.model.route import RouteMap
from sumo_mcts.prediction.at_red import margins_on_foot
from sumo_mcts.prediction.forecast import Question, times_of
from sumo_mcts.prediction.interface import Oracles, Predictor, checked
from sumo_mcts.prediction.margins import inflate
from sumo_mcts.prediction.paths import LANES
from sumo_mcts.prediction.roadside import room_beside
from sumo_mcts.prediction.told import with_plans
from sumo_mcts.registry import PREDICTORS, asks
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Follow, Forecast, Plan, Release, Scene, Scripted

# s of the last plan that a forecast takes for granted; then the nominal ego follows its leader
NOMINAL_S = 2.0
FALL_BACK = "idm"  # asked in place of a plugin that failed


class LastDecision(NamedTuple):
    """What the ego has been doing since the last cycle."""

    plan: Plan | None = None
    command: Follow | Release = Release()
    time: float = 0.0  # when it was decided, s


class Cycle(NamedTuple):
    """What a forecast depends on in one cycle."""

    scene: Scene
    lanes: Ints  # [K] that the ego is going to drive, see ego_lanes
    last: LastDecision
    stood_s: float  # s since the ego came to a stand at the stop sign before it; -inf: it has not
    held_up: Bools = np.zeros(0, np.bool_)  # [N] as in Question


class Forecaster:
    """Forecasts for one ego."""

    def __init__(
        self, config: ScenarioConfig, road: RoadMap, physics: Physics, oracles: Oracles | None
    ) -> None:
        """Raises ConfigError where the scenario's predictor is a plugin that does not start."""
        self._config, self._road, self._oracles = config, road, oracles
        self._step, self._traffic = physics.step, traffic_params(config, physics)
        self._forecast_s = forecast_s(config, physics.step, self._traffic.step)
        self._room_m = room_m(config.sensor)
        self._connected = frozenset(ego.id for ego in config.egos if ego.connected)
        self._predictors: dict[str, Predictor] = {}
        self._predictor(config.prediction.name)

    def follow(self, road: RoadMap) -> None:
        """Predict on this map."""
        if road is self._road:
            return
        self._road = road
        for name, predictor in self._predictors.items():
            self._start(name, predictor)

    def foresee(self, cycle: Cycle, hypotheses: int) -> tuple[Forecast, str]:
        """What the scenario's predictor says, as far as its planner looks, and "". Where a plugin
        fails, what FALL_BACK says instead, and why.

        Raises ConfigError where a recorded oracle has no answer.
        """
        name = self._config.prediction.name
        try:
            return self.ask(name, cycle, self._forecast_s, hypotheses), ""
        except ConfigError:
            raise
        except Exception as error:  # whatever a plugin may do
            if name in PREDICTORS:
                raise
            return self.ask(FALL_BACK, cycle, self._forecast_s), in_one_line(error)

    def ask(self, name: str, cycle: Cycle, seconds: float, hypotheses: int = 1) -> Forecast:
        """What a predictor (a built-in one or the scenario's) says, with margins for the sensor's
        errors and for pedestrians; of connected egos what they tell.

        Raises what a plugin raises, and ValueError where its answer is no forecast.
        """
        question = Question(
            scene=cycle.scene,
            ego_lanes=cycle.lanes,
            nominal=nominal_speeds(cycle.last, cycle.scene.time, self._traffic.step),
            params=self._traffic,
            seconds=seconds,
            stood_s=cycle.stood_s,
            hypotheses=hypotheses,
            command=nominal_command(cycle.last, cycle.scene.time, self._step),
            held_up=cycle.held_up,
        )
        found = self._predictor(name).predict(question)
        if name not in PREDICTORS:
            found = checked(found, self._road, question)
        # a copy of the simulation has the paths of pedestrians
        on_foot_m = 0.0 if asks(name, "clone") else self._config.prediction.room_on_foot_m
        around = margins_on_foot(self._road, cycle.lanes, cycle.scene, on_foot_m)
        room = room_beside(self._road, cycle.lanes, cycle.scene.ego, cycle.scene.agents)
        found = inflate(found, cycle.scene, self._room_m, around, room)
        plans = self._told(cycle.scene, seconds)
        return with_plans(found, self._road, cycle.scene.agents, cycle.lanes, plans)

    def _told(self, scene: Scene, seconds: float) -> dict[int, Scripted]:
        """What the connected egos in a scene tell one of them, by index of the agent."""
        if self._oracles is None or scene.ego.id not in self._connected:
            return {}
        step = self._traffic.step
        found = {
            i: self._oracles.plan(vehicle, scene.time, step, times_of(seconds, step))
            for i, vehicle in enumerate(scene.agents.ids)
            if vehicle in self._connected
        }
        return {i: states for i, states in found.items() if states is not None}

    def nothing(self) -> Forecast:
        """In place of a forecast that is not needed."""
        return no_forecast(self._traffic.step)

    def _predictor(self, name: str) -> Predictor:
        """The predictor of this name, which starts when it is first asked."""
        if name not in self._predictors:
            predictor = make_predictor(self._config, name)
            self._start(name, predictor)
            self._predictors[name] = predictor
        return self._predictors[name]

    def _start(self, name: str, predictor: Predictor) -> None:
        """Tell a predictor the map. Raises ConfigError where a plugin does not start."""
        try:
            predictor.start(self._road, self._oracles if predictor.oracle else None)
        except Exception as error:  # whatever a plugin may do
            raise ConfigError(
                f"prediction.name: {name}: does not start: {in_one_line(error)}"
            ) from None


def ego_lanes(route: RouteMap, state: State) -> Ints:
    """[K] the lanes that the ego is going to drive, first the one that it is on or moves to."""
    node = state.other if 0.0 < state.progress < 0.5 and state.other >= 0 else state.node
    lanes: list[int] = []
    while node >= 0 and len(lanes) < LANES:
        lanes.append(int(route.lane[node]))
        node = int(route.next[node])
    return np.array(lanes, np.int32)


def nominal_speeds(last: LastDecision, now: float, step: float) -> Floats:
    """[K] speeds of the last plan at multiples of `step` from now + step on, up to NOMINAL_S."""
    if last.plan is None or not len(last.plan.v):
        return np.zeros(0)
    begin = now - last.time
    end = min(float(last.plan.time[-1]), begin + NOMINAL_S)
    times = np.arange(begin + step, end + 1e-9, step)
    return np.asarray(np.interp(times, last.plan.time, last.plan.v))


def nominal_command(last: LastDecision, now: float, step: float) -> Follow | Release:
    """What is left of the last command, up to NOMINAL_S; then SUMO's own driver drives.

    `step`: of the simulation, s.
    """
    if isinstance(last.command, Release):
        return last.command
    begin = round((now - last.time) / step)
    left = last.command.speeds[begin : begin + round(NOMINAL_S / step)]
    side = last.command.lane_change if begin == 0 else 0
    return Follow(left, side, last.command.asks) if len(left) else Release()


def no_forecast(dt: float) -> Forecast:
    """A forecast without agents, `dt` s between its states."""
    none = np.zeros((1, 1, 0))
    return Forecast(
        dt=dt,
        weight=np.ones(1),
        pose=np.zeros((1, 1, 0, 4)),
        v=none,
        lane=none.astype(np.int32),
        s=none,
        valid=none.astype(np.bool_),
        half_length=np.zeros(0),
        half_width=np.zeros(0),
        reacts=np.zeros(0, np.bool_),
        yields=np.zeros((1, 0), np.bool_),
    )
