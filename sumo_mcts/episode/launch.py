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
from sumo_mcts.errors import ConfigError
from sumo_mcts.registry import asks
from sumo_mcts.road import RoadMap
from sumo_mcts.world import clone
from sumo_mcts.world.actors import Actors
from sumo_mcts.world.arguments import network_of, sumo_arguments, window_delay_ms
from sumo_mcts.world.candidates import require_named
from sumo_mcts.world.connected import Connected
from sumo_mcts.world.crowd import Cast, cast, crowd_ids
from sumo_mcts.world.generated import standing
from sumo_mcts.world.roadmap import known_roadmap
from sumo_mcts.world.scripts import check
from sumo_mcts.world.simulation import Simulation, Stepped

Progress = Callable[[str], None]


class LaunchOptions(NamedTuple):
    """How SUMO is started, beside what the scenario says."""

    gui: bool = False  # with SUMO's window
    sumo_options: Sequence[str] = ()  # as on SUMO's command line
    progress: Progress | None = None  # gets a message about what the episode waits for
    measured: Sequence[str] = ()  # egos of later episodes in this process: see run_episode
    connect: str | None = None  # host:port of a SUMO that is not started but connected to


class Running(NamedTuple):
    """SUMO with one draw of the traffic."""

    simulation: Stepped
    world: World
    actors: Actors
    arguments: list[str]  # SUMO's command line, without the program's name; none where connected
    varied: bool  # whether the next draw would differ


class Launcher:
    """Holds the one simulation that an episode has at a time."""

    def __init__(self, config: ScenarioConfig, seed: int | None, options: LaunchOptions) -> None:
        """Start nothing yet. `seed` None: SUMO keeps its own. Raises ConfigError."""
        if options.connect is not None:
            _require_there(config)
        self._seed, self._options = seed, options
        self._egos = [ego.id for ego in config.egos]
        self._traffic = np.random.default_rng(streams(seed).traffic)
        self._folder = tempfile.TemporaryDirectory(prefix="sumo_mcts-")
        self._config = self._standing(config)
        self._simulation: Stepped | None = None

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
        config, actors = self._config, drawn.actors
        for actor in actors:
            check(actor, road)
        arguments = [] if self._options.connect else self._arguments(drawn)
        simulation = self._simulation = self._started(arguments)
        if asks(config.prediction.name, "clone"):
            clone.require_copyable()
        ids = [actor.id for actor in actors]
        require_named("egos", self._egos, ids)
        with_events = [event.vehicle for event in config.traffic.events]
        require_named("traffic.events", with_events, [*ids, *crowd_ids(config.traffic.crowd)])
        world = running_world(
            config.planner.period_s, network_of(config.sumo.sumocfg, config.sumo.net)
        )
        moved = Actors(
            actors,
            world.road,
            world.physics.step,
            events=config.traffic.events,
            egos=self._egos,
            change_s=world.physics.change_duration,
        )
        return Running(simulation, world, moved, arguments, actors != config.traffic.actors)

    def _arguments(self, drawn: Cast) -> list[str]:
        options = self._options
        return sumo_arguments(
            self._config, self._seed, drawn, Path(self._folder.name), tuple(options.sumo_options),
            {*options.measured, *self._egos},
        )  # fmt: skip

    def _started(self, arguments: list[str]) -> Stepped:
        options = self._options
        if options.connect is not None:
            return Connected(options.connect)
        return Simulation(arguments, gui=options.gui, delay_ms=window_delay_ms(self._config.sumo))

    def _end(self) -> None:
        if self._simulation is not None:
            simulation, self._simulation = self._simulation, None
            simulation.close()


def _require_there(config: ScenarioConfig) -> None:
    """Raise ConfigError where an episode needs what only a SUMO of ours has."""
    if config.traffic.actors or any(config.traffic.crowd.count):
        raise ConfigError(
            "traffic: with --connect an ego drives in the traffic of the SUMO at the other end; "
            "leave actors and crowd out"
        )
    if config.sumo.dense or config.sumo.rule or config.sumo.passing:
        raise ConfigError(
            "sumo: with --connect the files of a drawn situation are not there at the other end; "
            "take a .sumocfg or a scenario with net and routes"
        )
    if asks(config.prediction.name, "clone"):
        raise ConfigError(
            f"prediction.name: {config.prediction.name} copies a simulation in this process; not "
            "with --connect"
        )
