"""From the departure of an ego to its take-over: how long it is waited for, and what judges it from
then on."""

from typing import NamedTuple

import numpy as np

from sumo_mcts.config import EgoConfig, ScenarioConfig
from sumo_mcts.driver.change_progress import as_seen
from sumo_mcts.driver.params import ego_params
from sumo_mcts.driver.vehicle import EgoVehicle, World, never_departed
from sumo_mcts.episode.goals import goal_of
from sumo_mcts.episode.launch import Progress, Running
from sumo_mcts.evaluation.hindsight import Futures, Hindsight
from sumo_mcts.evaluation.referee import Referee
from sumo_mcts.scene import Frame, Scene
from sumo_mcts.world.candidates import NAMED
from sumo_mcts.world.simulation import Stepped

NEWS_S = 30.0  # between two messages about an ego that has not departed


class TakeOver(NamedTuple):
    """An ego under control, and its judges."""

    vehicle: EgoVehicle
    referee: Referee
    hindsight: Hindsight | None  # None: others react, so their true future is unknown


def take_over(
    config: ScenarioConfig,
    ego: EgoConfig,
    noise: np.random.SeedSequence,
    running: Running,
    futures: Futures,
) -> TakeOver:
    """Take over an ego that is on the road. `noise` seeds its sensor's errors; `futures`: of the
    scripted actors.

    Raises ConfigError where it cannot get to its goal.
    """
    running.actors.limit(ego.id)
    world = running.world
    vehicle = EgoVehicle(ego.id, config, world, noise)
    frame = vehicle.look()
    goal = goal_of(config, world.road, frame.ego, ego.until)
    hindsight = None
    if running.actors.only_scripts_beside(ego.id):
        params = ego_params(config, frame.ego, world.physics)
        hindsight = Hindsight(world.road, goal, frame.ego, params, futures)
        hindsight.note(true_scene(world, frame))
    return TakeOver(vehicle, Referee(world.road, goal, world.physics.step, frame), hindsight)


def true_scene(world: World, frame: Frame) -> Scene:
    """The scene of a frame, without errors of a sensor."""
    ego = frame.ego
    return Scene(
        frame.time,
        world.physics.step,
        as_seen(world.road, ego),
        frame.agents,
        world.observer.timing(ego.x, ego.y),
        frame.changes,
    )


class DepartureWatch:
    """Waits for egos to depart, from the start of a simulation on."""

    def __init__(self, simulation: Stepped, limit_s: float, progress: Progress | None) -> None:
        """`limit_s`: how long an ego is waited for."""
        self._simulation, self._limit_s, self._progress = simulation, limit_s, progress
        self._begin = self._news_due = simulation.time
        self._departed: list[str] = []  # the first few vehicles that did

    def note_step(self) -> None:
        """To be called after every step of the simulation."""
        self._departed = [*self._departed, *self._simulation.departed()][:NAMED]

    def given_up(self) -> str:
        """Why an ego that has not departed is waited for no longer; "" where it may still come."""
        simulation = self._simulation
        waited = simulation.time - self._begin
        ended = simulation.end if simulation.time >= simulation.end else None
        why = never_departed(waited, self._limit_s, simulation.finished, ended)
        if why and self._departed:
            return f"{why}; the first that did: {', '.join(self._departed)}"
        return why

    def report(self, ego: str) -> None:
        """Say now and then that this ego is waited for."""
        now = self._simulation.time
        if self._progress is not None and now >= self._news_due:
            self._news_due = now + NEWS_S
            self._progress(f"{now:.1f} s  waiting for {ego}")
