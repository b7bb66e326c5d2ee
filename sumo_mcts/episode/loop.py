"""The closed loop: steps SUMO until an ego needs a decision, and takes the decisions."""

from collections.abc import Mapping

import numpy as np

from sumo_mcts.config import ScenarioConfig
from sumo_mcts.driver.params import streams
from sumo_mcts.driver.vehicle import EgoVehicle, World
from sumo_mcts.episode.ego import Ego
from sumo_mcts.episode.launch import Launcher, LaunchOptions
from sumo_mcts.episode.oracles import SimulationOracles
from sumo_mcts.episode.take_over import DepartureWatch, take_over
from sumo_mcts.prediction.interface import Oracles
from sumo_mcts.records import Row
from sumo_mcts.scene import Decision, Scene
from sumo_mcts.world import gui as window
from sumo_mcts.world.simulation import SimulationError

MOST_REDRAWN = 20  # draws in a row without an escape: then no draw will help


class Loop:
    """A scenario that runs, from its construction to close().

    While scenes() returns some, give apply() a decision for each; rows() says what came of it.
    """

    def __init__(
        self, config: ScenarioConfig, seed: int | None, options: LaunchOptions | None = None
    ) -> None:
        """Start SUMO. `seed` None: SUMO keeps its own.

        Raises ConfigError where the input is wrong.
        """
        self.config, self.seed = config, seed
        self.redrawn = 0  # draws thrown away, since the ego had no escape at its take-over
        self._options = options or LaunchOptions()
        noises = streams(seed).noise.spawn(len(config.egos))
        self._egos = [Ego(*each) for each in zip(config.egos, noises, strict=True)]
        self._launcher = Launcher(config, seed, self._options)
        self._running = self._launcher.launch()
        self._departures = self._watch_departures()
        self._oracles = SimulationOracles(self._running, self._driven)

    def scenes(self) -> dict[str, Scene]:
        """The scene of each ego that needs a decision now, by id. Empty: the episode is over."""
        while not all(ego.done for ego in self._egos):
            due = {}
            for ego in self._egos:
                if ego.vehicle is not None and ego.vehicle.due():
                    with ego.guarded():
                        due[ego.id] = ego.vehicle.scene()
            if due:
                return due
            self._step()
        return {}

    def tell(self, scene: Scene, decision: Decision) -> None:
        """An ego has decided: connected egos that decide after it know its plan."""
        self._oracles.tell(scene, decision)

    def apply(self, decisions: Mapping[str, Decision]) -> None:
        """Command what was decided for the coming period."""
        for ego in self._egos:
            decision = decisions.get(ego.id)
            if ego.vehicle is None or decision is None:
                continue
            with ego.guarded():
                ego.accept(decision)
                if self._options.gui:
                    plan = decision.plan
                    window.draw_plan(ego.id, np.zeros((0, 4)) if plan is None else plan.pose)

    def fail(self, vehicle: str, message: str) -> None:
        """End an ego's episode with outcome `error`."""
        self._ego(vehicle).fail(message)

    def judged(self, vehicle: str) -> Row:
        """The row of an ego if the episode ended now, with the keys that follow from states."""
        return self._ego(vehicle).row()

    def rows(self) -> tuple[Row, ...]:
        """A row for each ego, with the keys that follow from states."""
        return tuple(ego.row() for ego in self._egos)

    def close(self) -> None:
        """Close SUMO."""
        self._launcher.close()

    @property
    def world(self) -> World:
        """The running simulation; after a redraw another one."""
        return self._running.world

    @property
    def arguments(self) -> list[str]:
        """SUMO's command line, without the program's name."""
        return self._running.arguments

    @property
    def time(self) -> float:
        """Simulation time, s."""
        return self._running.simulation.time

    @property
    def oracles(self) -> Oracles:
        """For forecasts that are labelled as oracles; valid also after a redraw."""
        return self._oracles.oracles()

    def _ego(self, vehicle: str) -> Ego:
        return next(ego for ego in self._egos if ego.id == vehicle)

    def _driven(self) -> dict[str, EgoVehicle]:
        """The egos that are under control now, by id."""
        return {ego.id: ego.vehicle for ego in self._egos if ego.vehicle is not None}

    def _step(self) -> None:
        """One step of the simulation: command, move, judge."""
        self._running.actors.before_step(self.time)
        for ego in self._egos:
            if ego.vehicle is not None:
                with ego.guarded():
                    ego.vehicle.before_step()
        try:
            self._running.simulation.step()
        except SimulationError as error:
            for ego in self._egos:
                ego.lose(str(error))
            return
        self._departures.note_step()
        for ego in self._egos:
            with ego.guarded():
                if ego.vehicle is not None:
                    ego.judge(self._running)
                elif not ego.done:
                    self._await(ego)

    def _await(self, ego: Ego) -> None:
        """Take an ego over as soon as it is on the road."""
        if self.world.observer.present(ego.id):
            self._take_over(ego)
        elif why := self._departures.given_up():
            ego.fail(why)
        else:
            self._departures.report(ego.id)

    def _take_over(self, ego: Ego) -> None:
        """Take an ego over; where this draw of the traffic leaves it no escape, draw again."""
        taken = take_over(self.config, ego.config, ego.noise, self._running, self._oracles.futures)
        if self._running.varied and taken.hindsight is not None and taken.hindsight.unavoidable():
            self._redraw(ego)
            return
        ego.begin(taken)
        if self._options.gui and ego is self._egos[0]:
            window.follow(ego.id)

    def _redraw(self, ego: Ego) -> None:
        """Start again with the next draw."""
        if self.redrawn == MOST_REDRAWN:
            ego.fail(
                f"inevitable at its start in each of {self.redrawn + 1} draws: no motion of the "
                "ego is free of contacts"
            )
            return
        self.redrawn += 1
        self._running = self._launcher.launch()
        self._departures = self._watch_departures()
        self._oracles.follow(self._running)

    def _watch_departures(self) -> DepartureWatch:
        return DepartureWatch(
            self._running.simulation, self.config.episode.depart_limit_s, self._options.progress
        )
