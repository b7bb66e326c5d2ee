"""For a libsumo loop of your own: the controller drives one vehicle of it.

libsumo.start(["sumo", "-c", "my.sumocfg"])
controller = Controller("ego")
while libsumo.simulation.getMinExpectedNumber():
    controller.step()
    libsumo.simulationStep()
"""

from collections.abc import Mapping
from typing import Any, NoReturn

from sumo_mcts import config as scenario_files
from sumo_mcts.config import ConfigError, ScenarioConfig
from sumo_mcts.driver import Driver, Thought, streams, warm_up
from sumo_mcts.model.predictor import Oracles
from sumo_mcts.pilot import Pilot, running_world
from sumo_mcts.world.simulation import option, require_running

_NOT_HERE = {
    "script": "reads the scripts of a scenario that `sumo-mcts run` plays",
    "clone": "copies a simulation that `sumo-mcts run` plays: what your loop is going to command is not known",
}


class Controller:
    """Takes the vehicle over as soon as it is on the road and drives it until it leaves; takes the decisions that `sumo-mcts run` takes."""

    def __init__(self, ego: str, config: ScenarioConfig | Mapping[str, Any] | None = None, *, seed: int = 0, allow_plugins: bool = False) -> None:
        """Join the simulation that runs in this process. Raises ConfigError where there is none, or where `config` is wrong.

        config: a scenario, of which everything but sumo, egos, traffic and episode counts; or its sections, as in
        {"planner": {"iterations": 2000}}; by default as in a scenario that says nothing. `seed` is that of the search and of the sensor's errors.
        allow_plugins: whether a mapping may name code of your own as module:name.
        """
        require_running()
        self._ego, self._config = ego, _scenario(ego, config, allow_plugins)
        self._world = running_world(self._config.planner.period_s)
        oracles = Oracles(self._world.observer.way, _no_script, _no_copy)
        self._driver = Driver(self._config, self._world.road, self._world.physics, streams(seed).search, oracles)
        self._noise = streams(seed).noise.spawn(1)[0]
        self._pilot: Pilot | None = None
        self._over = False
        self.thought: Thought | None = None  # the last decision, and what it rests on
        warm_up(self._config, self._world.road, self._world.physics)

    @property
    def driving(self) -> bool:
        """Whether the controller holds the vehicle."""
        return self._pilot is not None

    def step(self) -> None:
        """Command the step that begins now: to be called right before each libsumo.simulationStep()."""
        pilot = self._look()
        if pilot is None:
            return
        if pilot.due():
            self.thought = self._driver.decide(pilot.scene())
            pilot.accept(self.thought.decision)
        pilot.before_step()

    def release(self) -> None:
        """Hand the vehicle back to SUMO, for good."""
        self._over = True
        if self._pilot is not None:
            self._pilot.release()
            self._pilot = None

    def _look(self) -> Pilot | None:
        """Who can drive now: nobody before the departure, while SUMO teleports the vehicle, and after the arrival."""
        if self._pilot is None:
            if self._over or not self._world.observer.present(self._ego):
                return None
            self._pilot = Pilot(self._ego, self._config, self._world, self._noise)
        seen = self._pilot.glance()
        pilot = self._pilot if seen.present else None
        if seen.arrived:
            self._pilot, self._over = None, True
        return pilot


def _no_script(*_: object) -> None:
    """Nobody in a loop of the user's own holds one."""


def _no_copy(*_: object) -> NoReturn:
    """A copy would not do what the user's loop is going to do."""
    raise ConfigError("Controller: no copy of a loop of the user's own")


def _scenario(ego: str, config: ScenarioConfig | Mapping[str, Any] | None, allow_plugins: bool) -> ScenarioConfig:
    """A scenario around the running simulation."""
    if not isinstance(config, ScenarioConfig):
        if config is not None and not isinstance(config, Mapping):
            raise ConfigError(f"Controller: config: a scenario or a mapping of its sections, got {config!r:.60}")
        data = {"name": "controller", "sumo": {"net": option("net-file")}, "egos": [{"id": ego}]}
        config = scenario_files.build({**data, **(config or {})}, "Controller", allow_plugins=allow_plugins)
    if config.prediction.name in _NOT_HERE:
        raise ConfigError(f"Controller: prediction.name: {config.prediction.name} {_NOT_HERE[config.prediction.name]}; allowed: idm, constant_velocity, routes")
    return config
