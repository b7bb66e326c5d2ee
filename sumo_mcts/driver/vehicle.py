"""The vehicle interface of one ego: when a decision is due, what is known then, and what SUMO is
commanded until the next one."""

import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.config import ScenarioConfig
from sumo_mcts.driver.missed_lane import MissedLane
from sumo_mcts.driver.missed_stop import MissedStop
from sumo_mcts.driver.params import Physics, ego_params
from sumo_mcts.driver.sensor import Sensor
from sumo_mcts.errors import ConfigError
from sumo_mcts.numerics.lanes import jumps
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Decision, EgoState, Follow, Frame, Scene
from sumo_mcts.world.command import Bounds, Commander
from sumo_mcts.world.observe import Change, Observer
from sumo_mcts.world.roadmap import known_roadmap
from sumo_mcts.world.simulation import is_ballistic, option, step_length

SUBLANE_CHANGE_S = 3.0  # a lane's width at about 1 m/s, as SUMO's sublane model goes sideways
_EPS = 1e-9


class World(NamedTuple):
    """The running simulation, as drivers need it."""

    road: RoadMap
    physics: Physics
    observer: Observer
    period: float  # between two decisions, s: whole steps of SUMO


def running_world(period_s: float, net: str | None = None) -> World:
    """The running simulation, for decisions every `period_s`.

    `net`: the file of its network; default the one that SUMO names, which may be relative to
    another folder where SUMO runs by itself. Raises ConfigError where it cannot be read, or where
    SUMO leaves out lanes that are in it.
    """
    physics = Physics(step_length(), is_ballistic(), _change_duration())
    road = known_roadmap(net or option("net-file"))
    if option("no-internal-links") == "true" and (road.internal & ~jumps(road)).any():
        raise ConfigError(
            "no-internal-links: the network has lanes inside junctions; build it without them "
            "instead (netconvert -s FILE --no-internal-links true -o NEW)"
        )
    period = max(1, round(period_s / physics.step)) * physics.step
    return World(road, physics, Observer(road), period)


class EgoVehicle:
    """Observes and commands one ego that is on the road.

    Between two steps of SUMO: look() or catch_up(), then a decision if due(), then before_step().
    """

    def __init__(
        self, vehicle: str, config: ScenarioConfig, world: World, noise: np.random.SeedSequence
    ) -> None:
        """Take over a vehicle that is on the road; `noise` seeds its sensor's errors."""
        self._vehicle, self._world, self._config = vehicle, world, config
        self._senses = Sensor(config.sensor, world.road, world.period, noise)
        bounds = self._bounds(world.observer.ego(vehicle, Change()))
        self._commander = Commander(vehicle, world.road, world.observer.lanes, bounds)
        self._missed = MissedLane(vehicle, world.road, config, world.period)
        self._missed_stop = MissedStop(vehicle, world.road, config, world.period)
        self._drives = False  # by decisions; else SUMO's own driver does
        self._frame: Frame | None = None
        self._time, self._next = 0.0, -math.inf  # now, and when to decide
        self._held = False  # SUMO had it stand at a stop when it decided
        self._commanded: float | None = None  # when the last command was given

    def look(self) -> Frame:
        """The inputs of the referee about the step that has just ended."""
        self._commander.notice()
        self._frame = self._world.observer.frame(self._vehicle, self._commander.change, self._frame)
        self._time = self._frame.time
        self._decide_when_let_go(self._frame.ego.held)
        return self._frame

    def catch_up(self) -> None:
        """In place of look() without a referee, where SUMO may have made steps without a
        command."""
        self._time = self._world.observer.remember(self._vehicle)
        if self._commanded is not None:
            self._commander.skip(
                round((self._time - self._commanded) / self._world.physics.step) - 1
            )
        self._commander.notice()
        self._decide_when_let_go(self._held and self._world.observer.is_held(self._vehicle))

    def due(self) -> bool:
        """Whether a decision is needed before the next step."""
        return self._time >= self._next - _EPS

    def _decide_when_let_go(self, held: bool) -> None:
        """An ego that SUMO lets go from a stop decides at once; `held`: SUMO has it stand there."""
        if self._held and not held:
            self._next = self._time

    def scene(self) -> Scene:
        """What the ego perceives, for the decision.

        Where it has missed its lane for good, it has another route from now on, and where it has
        missed that of its stop, not that stop any more.
        """
        truth = self._world.observer.scene(
            self._vehicle,
            self._commander.change,
            self._config.sensor.range_m,
            self._config.sensor.signals == "timing",
        )
        self._commander.bind(self._bounds(truth.ego))
        self._held = truth.ego.held
        ego = truth.ego._replace(asks=self._commander.asks, can_ask=self._commander.can_ask)
        seen = self._senses.perceive(truth._replace(ego=ego))
        detour = ""
        if self._drives:  # on another way the next stop may be another one
            detour = self._missed.note(seen) or self._missed_stop.note(seen)
        if detour:  # a stop is told by its place on the route
            ego = self._world.observer.ego(self._vehicle, Change())
        ego = seen.ego._replace(
            route=ego.route, stop=ego.stop, reroutes=self._missed.reroutes, detour=detour
        )
        return seen._replace(ego=ego)

    def accept(self, decision: Decision) -> None:
        """Execute a decision until the next one."""
        self._commander.accept(decision.command)
        self._drives = isinstance(decision.command, Follow)
        self._next = self._time + self._world.period

    def before_step(self) -> None:
        """Command the step that begins now."""
        self._commander.before_step()
        self._commanded = self._time

    def rehearse_step(self) -> None:
        """In place of before_step() in a copy of the simulation, where no decisions are taken.

        After the last command SUMO's own driver goes on until the ego has left.
        """
        if self._commander.played:
            self._commander.release()
        elif self._world.observer.present(self._vehicle):
            self._commander.before_step()

    def release(self) -> None:
        """Give the ego back to SUMO, if it is still there."""
        self._commander.release()

    def _bounds(self, ego: EgoState) -> Bounds:
        """The bounds of commands to the ego as its type is now."""
        physics, params = self._world.physics, ego_params(self._config, ego, self._world.physics)
        return Bounds(
            physics.step,
            params.change_duration,
            params.max_accel,
            params.max_decel,
            params.emergency_jerk,
        )


def never_departed(
    waited_s: float, limit_s: float, finished: bool, ended_s: float | None = None
) -> str:
    """Why it is useless to wait any longer for an ego that has not departed; "" where it may still
    come.

    `finished`: SUMO expects no further vehicle; `ended_s`: SUMO's option end, once it is reached.
    """
    if waited_s >= limit_s:
        return f"never departed within {limit_s:g} s (episode.depart_limit_s)"
    if ended_s is not None:
        return f"never departed before the simulation's end at {ended_s:g} s (SUMO's option end)"
    return "never departed: no vehicle is left and none is to come" if finished else ""


def _change_duration() -> float:
    """How long a lane change takes in the running simulation, s."""
    return (
        SUBLANE_CHANGE_S
        if float(option("lateral-resolution")) > 0
        else float(option("lanechange.duration"))
    )
