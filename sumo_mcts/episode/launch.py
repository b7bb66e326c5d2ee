"""Starts SUMO with one draw of a scenario's traffic after the other."""

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sumo_mcts.config import ScenarioConfig
from sumo_mcts.driver.params import streams
from sumo_mcts.driver.vehicle import World, running_world
from sumo_mcts.episode.goals import check_edges
from sumo_mcts.registry import asks
from sumo_mcts.road import RoadMap
from sumo_mcts.world import clone
from sumo_mcts.world.actors import Actors
from sumo_mcts.world.arguments import network_of, sumo_arguments, window_delay_ms
from sumo_mcts.world.candidates import require_named
from sumo_mcts.world.crowd import Cast, cast, crowd_ids
from sumo_mcts.world.generated import standing
from sumo_mcts.world.roadmap import known_roadmap
from sumo_mcts.world.scripts import check
from sumo_mcts.world.simulation import Simulation

Progress = Callable[[str], None]


class LaunchOptions(NamedTuple):
    """How SUMO is started, beside what the scenario says."""

    gui: bool = False  # with SUMO's window
    sumo_options: Sequence[str] = ()  # as on SUMO's command line
    progress: Progress | None = None  # gets a message about what the episode waits for
    measured: Sequence[str] = ()  # egos of later episodes in this process: see run_episode


class Running(NamedTuple):
    """SUMO with one draw of the traffic."""

    simulation: Simulation
    world: World
    actors: Actors
    arguments: list[str]  # SUMO's command line, without the program's name
    varied: bool  # whether the next draw would differ


class Launcher:
    """Holds the one simulation that an episode has at a time."""

    def __init__(self, config: ScenarioConfig, seed: int | None, options: LaunchOptions) -> None:
        """Start nothing yet. `seed` None: SUMO keeps its own."""
        self._seed, self._options = seed, options
        self._egos = [ego.id for ego in config.egos]
        self._traffic = np.random.default_rng(streams(seed).traffic)
        self._folder = tempfile.TemporaryDirectory(prefix="sumo_mcts-")
        self._config = self._standing(config)
        self._simulation: Simulation | None = None

    def launch(self) -> Running:
        """Start SUMO with the next draw of the actors; an earlier simulation is closed.

        Raises ConfigError where the input is wrong; then nothing is left running.
        """
        self._end()
        try:
            road = self._checked_road()
            drawn = cast(self._config.traffic, self._egos, road, self._traffic)
            return self._launched(drawn, road)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close SUMO, and remove its temporary files."""
        self._end()
        self._folder.cleanup()

    def _standing(self, config: ScenarioConfig) -> ScenarioConfig:
        """The scenario with files in place of a dense situation. Raises ConfigError."""
        try:
            sumo = standing(config.sumo, self._seed, Path(self._folder.name))
        except BaseException:
            self._folder.cleanup()
            raise
        return config if sumo is config.sumo else config.model_copy(update={"sumo": sumo})

    def _checked_road(self) -> RoadMap:
        """The network; SUMO itself does not survive every one. Raises ConfigError."""
        config = self._config
        if asks(config.prediction.name, "clone"):
            clone.require_possible(self._options.gui)
        road = known_roadmap(network_of(config.sumo.sumocfg, config.sumo.net))
        check_edges(config, road)
        return road

    def _launched(self, drawn: Cast, road: RoadMap) -> Running:
        config, options, actors = self._config, self._options, drawn.actors
        arguments = sumo_arguments(
            config, self._seed, drawn, Path(self._folder.name), tuple(options.sumo_options),
            {*options.measured, *self._egos},
        )  # fmt: skip
        for actor in actors:
            check(actor, road)
        simulation = self._simulation = Simulation(
            arguments, gui=options.gui, delay_ms=window_delay_ms(config.sumo)
        )
        if asks(config.prediction.name, "clone"):
            clone.require_copyable()
        ids = [actor.id for actor in actors]
        require_named("egos", self._egos, ids)
        with_events = [event.vehicle for event in config.traffic.events]
        require_named("traffic.events", with_events, [*ids, *crowd_ids(config.traffic.crowd)])
        world = running_world(config.planner.period_s)
        moved = Actors(
            actors,
            world.road,
            world.physics.step,
            events=config.traffic.events,
            egos=self._egos,
            change_s=world.physics.change_duration,
        )
        return Running(simulation, world, moved, arguments, actors != config.traffic.actors)

    def _end(self) -> None:
        if self._simulation is not None:
            simulation, self._simulation = self._simulation, None
            simulation.close()
