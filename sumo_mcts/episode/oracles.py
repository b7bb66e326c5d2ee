"""Answers from the running simulation that no sensor could give.

They serve forecasts that are labelled as oracles, and the verdict on collisions.
"""

import math
from collections.abc import Callable, Mapping

import numpy as np

from sumo_mcts.arrays import Floats, Ints
from sumo_mcts.driver.vehicle import EgoVehicle
from sumo_mcts.episode.launch import Running
from sumo_mcts.evaluation.hindsight import Future
from sumo_mcts.prediction.interface import Oracles
from sumo_mcts.prediction.script_poses import script_poses
from sumo_mcts.prediction.told import Told, states_told, told_by
from sumo_mcts.scene import Decision, Follow, Release, Scene, Scripted
from sumo_mcts.world import clone


class SimulationOracles:
    """Answers from the simulation that runs, also after a redraw."""

    def __init__(self, running: Running, driven: Callable[[], Mapping[str, EgoVehicle]]) -> None:
        """`driven`: the egos under control at the time of asking, by id."""
        self._driven = driven
        self.follow(running)

    def follow(self, running: Running) -> None:
        """Answer from this draw of the traffic from now on."""
        self._running = running
        self._script_poses: dict[str, Floats] = {}  # by vehicle: [steps, 4]
        self._told: dict[str, Told | None] = {}  # by ego, of its last decision

    def oracles(self) -> Oracles:
        """The questions that predictors may ask."""
        return Oracles(self.lanes, self.scripted, self.copied, self.planned)

    def tell(self, scene: Scene, decision: Decision) -> None:
        """An ego has decided: egos that are connected with it know its plan from now on."""
        self._told[scene.ego.id] = told_by(scene, decision)

    def planned(self, vehicle: str, now: float, dt: float, count: int) -> Scripted | None:
        """The coming `count` states of an ego by its last plan, `dt` s apart; None where it has
        none, or is not under control."""
        told = self._told.get(vehicle)
        return states_told(told, now, dt, count) if told and vehicle in self._driven() else None

    def lanes(self, vehicle: str, lane: int) -> Ints:
        """[K] the lanes that a vehicle on this lane is really going to take, this one first."""
        return self._running.world.observer.coming_lanes(vehicle, lane)

    def scripted(self, vehicle: str, now: float, dt: float, count: int) -> Scripted | None:
        """The coming `count` states of a scripted actor, `dt` s apart; None without a script, and
        before its departure."""
        actors, world = self._running.actors, self._running.world
        script, departed = actors.script_of(vehicle), actors.departure(vehicle)
        if script is None or departed is None:
            return None
        step = world.physics.step
        if vehicle not in self._script_poses:
            length, _ = actors.size(vehicle)
            self._script_poses[vehicle] = script_poses(
                world.road, script.lane, script.s, script.d, script.v, step, length
            )
        rows = np.round((now - departed + np.arange(count) * dt) / step).astype(int)
        valid = (rows >= 0) & (rows < len(script.v))
        rows = np.clip(rows, 0, len(script.v) - 1)
        return Scripted(
            self._script_poses[vehicle][rows],
            script.v[rows],
            script.lane[rows],
            script.s[rows],
            valid,
        )

    def futures(self, now: float, count: int) -> list[Future]:
        """The coming `count` states of every scripted actor, a step apart."""
        actors, step = self._running.actors, self._running.world.physics.step
        scripts = {vehicle: self.scripted(vehicle, now, step, count) for vehicle in actors.scripted}
        return [
            Future(script, *actors.size(vehicle))
            for vehicle, script in scripts.items()
            if script is not None
        ]

    def copied(
        self, scene: Scene, nominal: Follow | Release, dt: float, count: int
    ) -> dict[int, Scripted]:
        """The coming `count` states of the scene's agents, `dt` s apart, if its ego drives the
        nominal command, by index of the agent.

        A copy of the simulation drives on. In it the other egos carry out their last commands, then
        SUMO's own driver takes them. Agents that are not there yet are left out. Raises
        SimulationError.
        """
        step = self._running.world.physics.step
        every = max(1, round(dt / step))
        rows = math.ceil((count - 1) * dt / (every * step) - 1e-9) + 1
        states = clone.in_copy(
            lambda: self._rehearse(scene, nominal, every, rows), (rows, len(scene.agents.ids), 8)
        )
        return clone.at_times(states, every * step, dt, count)

    def _rehearse(self, scene: Scene, nominal: Follow | Release, every: int, rows: int) -> Floats:
        """[rows, N, 8] the states of the agents now and after each `every` steps.

        Only for a copy of the simulation, since it moves that on.
        """
        running, vehicles = self._running, self._driven()
        vehicles[scene.ego.id].accept(Decision(nominal, None, (), -1, "nominal", 0, 0))
        read = running.world.observer.states
        states = [read(scene.agents.ids)]
        for k in range(1, (rows - 1) * every + 1):
            running.actors.before_step(running.simulation.time)
            for vehicle in vehicles.values():
                vehicle.rehearse_step()
            running.simulation.step()
            now = read(scene.agents.ids)  # each step, as the original does: it remembers lanes
            if k % every == 0:
                states.append(now)
        return np.array(states)
