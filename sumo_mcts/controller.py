"""Drives one vehicle in a libsumo loop of your own:

libsumo.start(["sumo", "-c", "my.sumocfg", "--collision.mingap-factor", "0"])
with Controller("ego") as controller:
    while libsumo.simulation.getMinExpectedNumber():
        controller.step()
        libsumo.simulationStep()

A SUMO that runs by itself is driven through a TraCI connection, by the same decisions:

connection = traci.connect(8813)
controller = Controller("ego", connection=connection)
"""

import logging
import math
import weakref
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NoReturn, Self

from sumo_mcts import config as scenario_files
from sumo_mcts import files
from sumo_mcts.config import ScenarioConfig
from sumo_mcts.driver.driver import Driver, PlanningResult
from sumo_mcts.driver.params import streams
from sumo_mcts.driver.vehicle import EgoVehicle, never_departed, running_world
from sumo_mcts.driver.warmup import warm_up
from sumo_mcts.errors import ConfigError
from sumo_mcts.prediction.interface import Oracles
from sumo_mcts.prediction.told import Told, states_told, told_by
from sumo_mcts.registry import asks, without
from sumo_mcts.scene import Scripted
from sumo_mcts.world import simulation
from sumo_mcts.world.candidates import near_ids
from sumo_mcts.world.library import Remote, remote_of, using
from sumo_mcts.world.observe import departure

# questions to oracles that a loop of the user's own cannot answer, and what a predictor does with
# the answers
_NOT_HERE = {
    "script": "reads the scripts of a scenario that `sumo-mcts run` plays",
    "clone": "copies a simulation that `sumo-mcts run` plays: what your loop is going to command "
    "is not known",
}
_MOVED = (
    "%s: SUMO teleports a vehicle that stops a little nearer to another than its minGap; start it "
    "with --collision.mingap-factor 0"
)


class Controller:
    """Drives one vehicle from its departure until it leaves, by the decisions that `sumo-mcts run`
    takes.

    Where the loop does something unusual:

    - Another simulation in the same process (libsumo.load, another libsumo.start, an earlier
      state): the next step() begins again in it, like a new controller with the same arguments.
      While no simulation runs, step() raises ConfigError.
    - Another controller of the same vehicle raises ConfigError. One that was released, has ended
      its drive or is garbage leaves the vehicle to others.
    - A second step() before the same step of SUMO does nothing: that step is commanded already.
    - A step of SUMO without step(): the vehicle keeps its speed in it, whatever happens. The plan
      goes on where it would be by then.
    - The vehicle never departs: simulationStep() raises ConfigError, which names similar ids. It
      does so `episode.depart_limit_s` after the controller was made, or earlier if SUMO had
      vehicles and expects no more.
    - The vehicle is gone: the drive is over. One that gets the same id later is another vehicle,
      for another controller.

    The vehicle gets its speed mode, lane change mode and action step length back by release(), at
    the end of a `with` block, when step() raises, while SUMO teleports it, and when the controller
    is garbage.
    """

    def __init__(
        self,
        ego: str,
        config: ScenarioConfig | Mapping[str, Any] | None = None,
        *,
        seed: int = 0,
        allow_plugins: bool = False,
        connection: Any = None,
    ) -> None:
        """Join the simulation that runs in this process, or at the other end of a connection.

        Raises ConfigError where there is none, or where `config` is wrong.

        config: a scenario, without its sections sumo, egos, traffic and (but for depart_limit_s)
            episode; or its sections, as in {"planner": {"iterations": 2000}}; by default an empty
            scenario; of `egos` it reads who is connected: controllers of connected vehicles tell
            each other their plans
        seed: of the search and of the sensor's errors
        allow_plugins: whether a mapping may name code of your own as module:name
        connection: what traci.connect or traci.getConnection returns, or the module traci for the
            one that is in use there; by default libsumo. Where the network that SUMO names is not
            found from here, `config` says where it is: {"sumo": {"net": FILE}}
        """
        self._ego, self._asked, self._seed, self._allow_plugins = ego, config, seed, allow_plugins
        self._released = False
        self._remote = remote_of(connection)
        self._hold = _Hold(self._remote)
        weakref.finalize(self, self._hold.let_go).atexit = False
        with using(self._remote):
            simulation.require_running()
            self._join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    @property
    def driving(self) -> bool:
        """Whether the controller holds the vehicle."""
        with using(self._remote):
            return self._hold.vehicle is not None and self._hold.simulation == simulation.number()

    def step(self) -> None:
        """Command the step that begins now. Call it right before each libsumo.simulationStep().

        Raises ConfigError where no simulation runs, or another one in which the controller cannot
        drive; PlannerError where the planner failed too often in a row.
        """
        if self._released:
            return
        with using(self._remote):
            try:
                self._command()
            except BaseException:
                self._finish()
                raise

    def release(self) -> None:
        """Give the vehicle back to SUMO; the controller ends. Never raises."""
        self._released = True
        self._finish()

    def _join(self) -> None:
        """Get ready for the simulation that runs now. Raises ConfigError."""
        net = _network(self._asked)
        self._config = _scenario(self._ego, self._asked, self._allow_plugins, net)
        self._world = running_world(self._config.planner.period_s, net)
        oracles = Oracles(
            self._world.observer.coming_lanes, _no_script, _no_copy, self._plan_of_another
        )
        self._driver = Driver(
            self._config, self._world.road, self._world.physics, streams(self._seed).search, oracles
        )
        self._noise = streams(self._seed).noise.spawn(1)[0]
        warm_up(self._config, self._world.road, self._world.physics)
        if simulation.moves_who_comes_near():
            logging.getLogger(__name__).warning(_MOVED, self._ego)
        self.thought: PlanningResult | None = None  # the last decision, and what it rests on
        self._told: Told | None = None  # what it tells of that decision
        self._over = False
        self._departure: float | None = None  # of the vehicle, s; None: it has not come so far
        self._time = -math.inf  # of the last step(), s
        number = simulation.number()
        if _DRIVEN.setdefault((number, self._ego), self) is not self:
            raise ConfigError(
                f"Controller: {self._ego}: another Controller drives this vehicle; release() that "
                "one first"
            )
        self._hold.simulation = number
        self._await()

    def _await(self) -> None:
        """After each step of SUMO check whether the vehicle can still depart."""
        me, number, begun = weakref.ref(self), self._hold.simulation, simulation.now()
        seen: set[str] = set()

        def check() -> bool:
            controller = me()
            if controller is None:
                return False
            with using(controller._remote):
                if not controller._awaits(number):
                    return False
                seen.update(simulation.departed())
                controller._expect(simulation.now() - begun, seen)
            return True

        self._traffic = simulation.expected() > 0
        simulation.after_each_step(check)

    def _awaits(self, number: int) -> bool:
        """Whether the simulation of this number still runs, and the vehicle has not departed in
        it."""
        waiting = (
            not self._over
            and self._departure is None
            and self._hold.simulation == number == simulation.number()
        )
        return waiting and not self._world.observer.present(self._ego)

    def _expect(self, waited_s: float, seen: set[str]) -> None:
        """Raise ConfigError where the vehicle cannot depart any more.

        `seen`: the vehicles that departed.
        """
        comes = simulation.expected() > 0
        self._traffic = self._traffic or comes
        # without any traffic so far, the loop is going to add it
        finished = self._traffic and not comes
        why = never_departed(waited_s, self._config.episode.depart_limit_s, finished)
        if why:
            self._finish()
            near = near_ids(self._ego, seen)
            raise ConfigError(
                f"Controller: {self._ego}: {why}" + (f"; near: {', '.join(near)}" if near else "")
            )

    def _command(self) -> None:
        """What step() does."""
        simulation.require_running()
        number, time = simulation.number(), simulation.now()
        if number != self._hold.simulation or time < self._time:
            self._finish()
            self._join()
        if time == self._time:
            return
        self._time = time
        vehicle = self._look()
        if vehicle is None:
            return
        if vehicle.due():
            scene = vehicle.scene()
            self.thought = self._driver.decide(scene)
            self._told = told_by(scene, self.thought.decision)
            vehicle.accept(self.thought.decision)
        vehicle.before_step()

    def _plan_of_another(
        self, vehicle: str, now: float, step: float, count: int
    ) -> Scripted | None:
        """The coming states of a vehicle by its last plan, if another controller drives it."""
        other = _DRIVEN.get((self._hold.simulation, vehicle))
        if other is None or not other.driving or other._told is None:
            return None
        return states_told(other._told, now, step, count)

    def _look(self) -> EgoVehicle | None:
        """The vehicle, if it can be driven now; None before the departure, during a teleport, and
        afterwards."""
        if self._over:
            return None
        departed, present = departure(self._ego), self._world.observer.present(self._ego)
        if self._departure not in {None, departed}:
            self._finish()
        elif not present:
            self._hold.let_go()
        elif self._hold.vehicle is None:
            self._departure = departed
            self._hold.vehicle = EgoVehicle(self._ego, self._config, self._world, self._noise)
        if self._hold.vehicle is not None:
            self._hold.vehicle.catch_up()
        return self._hold.vehicle

    def _finish(self) -> None:
        """End the drive in this simulation: SUMO gets the vehicle back, and another controller may
        drive it."""
        self._over = True
        self._hold.let_go()
        key = (self._hold.simulation, self._ego)
        if _DRIVEN.get(key) is self:
            del _DRIVEN[key]


class _Hold:
    """The vehicle that a controller drives in one simulation. It outlives the controller for as
    long as it takes to give the vehicle back."""

    def __init__(self, remote: Remote | None) -> None:
        self._remote = remote
        self.vehicle: EgoVehicle | None = None  # None: SUMO drives
        self.simulation = 0  # its number

    def let_go(self) -> None:
        """Give the vehicle back to SUMO, if the same simulation still runs. Never raises."""
        vehicle, self.vehicle = self.vehicle, None
        if vehicle is not None:
            # libsumo's exceptions share no base class, and SUMO itself may have failed
            with suppress(Exception), using(self._remote):
                if self.simulation == simulation.number():
                    vehicle.release()


# (number of the simulation, id of the vehicle) -> its controller
_DRIVEN: weakref.WeakValueDictionary[tuple[int, str], Controller] = weakref.WeakValueDictionary()


def _no_script(*_: object) -> None:
    """No vehicle in a loop of the user's own has a script."""


def _no_copy(*_: object) -> NoReturn:
    """A copy does not do what the user's loop is going to do."""
    raise ConfigError("Controller: no copy of a loop of the user's own")


def _network(config: ScenarioConfig | Mapping[str, Any] | None) -> str:
    """The file of the network: what SUMO names, or what is given where that is not found from
    here. Raises ConfigError."""
    named = simulation.option("net-file")
    if not files.problem(named):
        return named
    sumo = config.get("sumo") if isinstance(config, Mapping) else getattr(config, "sumo", None)
    given = sumo.get("net") if isinstance(sumo, Mapping) else getattr(sumo, "net", None)
    if given is None:
        raise ConfigError(
            f"Controller: {named}: SUMO's network is not found from here; say where it is: "
            'Controller(ego, {"sumo": {"net": FILE}})'
        )
    return str(given)


def _scenario(
    ego: str, config: ScenarioConfig | Mapping[str, Any] | None, allow_plugins: bool, net: str
) -> ScenarioConfig:
    """A scenario around the running simulation, whose network is the file `net`."""
    if not isinstance(ego, str) or not ego:
        raise ConfigError(f"Controller: ego: the id of a vehicle, got {ego!r:.60}")
    if not isinstance(config, ScenarioConfig):
        if config is not None and not isinstance(config, Mapping):
            raise ConfigError(
                f"Controller: config: a scenario or a mapping of its sections, got {config!r:.60}"
            )
        data = {
            "name": "controller",
            "sumo": {"net": net},
            "egos": [{"id": ego}],
        }
        config = scenario_files.build(
            {**data, **(config or {})}, "Controller", allow_plugins=allow_plugins
        )
    for question, use in _NOT_HERE.items():
        if asks(config.prediction.name, question):
            raise ConfigError(
                f"Controller: prediction.name: {config.prediction.name} {use}; "
                f"allowed: {', '.join(without(*_NOT_HERE))}"
            )
    return config
