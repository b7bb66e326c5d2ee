"""The actors of a scenario: drawn by the seed, moved by their scripts, or changed by events.

Row m of a script is the state m steps after the vehicle appeared. SUMO moves first and inserts
afterwards: a vehicle due at time t is there, not yet moved, at the end of the first step that
begins at t or later.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats
from sumo_mcts.config import Actor, Event, TrafficConfig, VehicleEvent
from sumo_mcts.road import RoadMap
from sumo_mcts.world.library import running_sumo
from sumo_mcts.world.scripts import (
    EPS,
    SIDES,
    Drive,
    Script,
    after_event,
    check,
    compile_script,
    is_due,
    stood,
    towards,
)

CHANGE_WISH_S = 5.0  # how long a vehicle driven by SUMO goes on looking for a gap


class Actors:
    """Plays scripts and events: call `before_step` before every step of the running simulation."""

    def __init__(
        self,
        actors: Sequence[Actor],
        road: RoadMap,
        step: float,
        *,
        events: Sequence[VehicleEvent] = (),
        egos: Sequence[str] = ("ego",),
        change_s: float = 3.0,
        seconds: float = 600.0,
    ) -> None:
        """`step` and `change_s` (SUMO's lanechange.duration) in s.

        `egos` are driven by planners; scripts are compiled for `seconds`. Raises ConfigError.
        """
        self._libsumo: Any = running_sumo()
        self._step, self._left = step, -1 if road.lefthand else 1
        self._egos = frozenset(egos)
        self._actors = {actor.id: actor for actor in actors}
        for actor in actors:
            check(actor, road)
        scripted = [
            actor for actor in actors if actor.driver == "script" and actor.id not in self._egos
        ]
        self._scripts = {
            actor.id: compile_script(actor, road, step, seconds, change_s) for actor in scripted
        }
        self._events = {
            actor.id: actor.events
            for actor in actors
            if actor.driver == "sumo" and actor.events and actor.id not in self._egos
        }
        for event in events:
            self._events[event.vehicle] = (*self._events.get(event.vehicle, ()), event)
        self._departed: dict[str, float] = {}  # simulation time, s
        self._orders: dict[str, _Orders] = {}  # of vehicles on the road that SUMO drives
        self._playing: set[str] = set()  # scripted vehicles on the road

    def script_of(self, vehicle: str) -> Script | None:
        """The script that a vehicle holds; None where SUMO or a planner drives it."""
        return self._scripts.get(vehicle)

    @property
    def scripted(self) -> tuple[str, ...]:
        """The vehicles that hold scripts, on the road or not."""
        return tuple(self._scripts)

    def only_scripts_beside(self, ego: str) -> bool:
        """Whether all others, on the road or to come, hold scripts, and there are some: no vehicle
        reacts."""
        present = set(self._libsumo.vehicle.getIDList())
        known = present | (self._scripts.keys() - self._departed.keys())
        # persons and vehicles of the route files count too
        expected = int(self._libsumo.simulation.getMinExpectedNumber())
        return (
            bool(self._scripts)
            and present <= self._scripts.keys() | {ego}
            and expected <= len(known)
        )

    def size(self, vehicle: str) -> tuple[float, float]:
        """Length and width of an actor, m; where it is not on the road those of its vehicle
        type."""
        sumo = self._libsumo
        if vehicle in sumo.vehicle.getIDList():
            return float(sumo.vehicle.getLength(vehicle)), float(sumo.vehicle.getWidth(vehicle))
        kind = self._actors[vehicle].vtype
        return float(sumo.vehicletype.getLength(kind)), float(sumo.vehicletype.getWidth(kind))

    def departure(self, vehicle: str) -> float | None:
        """When row 0 of an actor's script holds, s: as it happened, or as it is due.

        None for vehicles of the route files that are not there yet.
        """
        if vehicle in self._departed:
            return self._departed[vehicle]
        actor = self._actors.get(vehicle)
        return None if actor is None else appears(actor.depart.time_s, self._step)

    def before_step(self, time: float) -> None:
        """Command the step that begins now; `time` in s."""
        for vehicle in self._libsumo.simulation.getDepartedIDList():
            self._begin(vehicle, time)
        if not self._playing and not self._orders:
            return
        present = frozenset(self._libsumo.vehicle.getIDList())
        self._playing &= present
        self._orders = {
            vehicle: orders for vehicle, orders in self._orders.items() if vehicle in present
        }
        for vehicle in sorted(self._playing):
            _play(
                self._libsumo.vehicle,
                vehicle,
                self._scripts[vehicle],
                round((time - self._departed[vehicle]) / self._step) + 1,
                self._left,
            )
        for vehicle, orders in sorted(self._orders.items()):
            self._orders[vehicle] = _command(
                self._libsumo.vehicle,
                vehicle,
                orders,
                time - self._departed[vehicle],
                self._step,
                self._left,
            )

    def limit(self, vehicle: str) -> None:
        """Give a vehicle on the road the top speed of its actor; an ego gets it before its first
        scene."""
        actor = self._actors.get(vehicle)
        if actor is not None and actor.max_speed_mps is not None:
            self._libsumo.vehicle.setMaxSpeed(vehicle, actor.max_speed_mps)

    def _begin(self, vehicle: str, time: float) -> None:
        """A vehicle has departed."""
        self._departed[vehicle] = time
        self.limit(vehicle)
        if vehicle in self._scripts:
            self._libsumo.vehicle.setSpeedMode(vehicle, 0)
            self._libsumo.vehicle.setLaneChangeMode(vehicle, 0)
            self._playing.add(vehicle)
        elif vehicle in self._events:
            self._orders[vehicle] = _Orders(self._events[vehicle], Drive(None, 0.0, 0.0, None))


def appears(due: float, step: float) -> float:
    """When a vehicle that is due at `due` is first on the road, in a simulation that begins at 0;
    s."""
    return (math.ceil(due / step - EPS) + 1) * step


# --- vehicles that hold scripts ---


def _play(cars: Any, vehicle: str, script: Script, row: int, left: int) -> None:
    """Have SUMO arrive at this row with its next step; after the last row the speed stays.

    `cars`: libsumo's vehicle domain; `left`: what leads to the next lane on the left in SUMO's
    count, 1 or -1.
    """
    if row >= len(script.v):
        return
    cars.setSpeed(vehicle, float(script.v[row]))
    if script.change[row]:
        cars.changeLane(vehicle, cars.getLaneIndex(vehicle) + left * int(script.change[row]), 0.0)


# --- vehicles that SUMO drives ---


class _Orders(NamedTuple):
    """Events to come for a vehicle, and its last order about speed."""

    waiting: tuple[Event, ...]
    drive: Drive


def _command(
    cars: Any, vehicle: str, orders: _Orders, time: float, step: float, left: int
) -> _Orders:
    """Command the events of a vehicle that are due `time` s after its departure. Its driver still
    keeps its distance."""
    due = [event for event in orders.waiting if is_due(event, time, cars.getDistance(vehicle))]
    drive, v = orders.drive, cars.getSpeed(vehicle)
    for event in due:
        if event.change_lane is None:
            drive = after_event(drive, event, drive.target)
        else:
            _ask_for_lane(cars, vehicle, left * SIDES[event.change_lane])
    after = stood(drive, v, step)
    if after.target is not None:
        cars.setSpeed(vehicle, towards(after.target, v, after.accel * step))
    elif orders.drive.target is not None:
        cars.setSpeed(vehicle, -1.0)  # its driver again
    return _Orders(tuple(event for event in orders.waiting if event not in due), after)


def _ask_for_lane(cars: Any, vehicle: str, side: int) -> None:
    """Change lanes as soon as there is a gap."""
    index = cars.getLaneIndex(vehicle) + side
    if 0 <= index < running_sumo().edge.getLaneNumber(cars.getRoadID(vehicle)):
        cars.changeLane(vehicle, index, CHANGE_WISH_S)


# --- the actors of a seed ---


def draw(traffic: TrafficConfig, rng: np.random.Generator) -> tuple[Actor, ...]:
    """The actors of one seed.

    With traffic.vary = 0 exactly as written. Every actor uses up the same draws whatever its `vary`
    says.
    """
    return tuple(
        _drawn(actor, traffic.vary * rng.uniform(-1.0, 1.0, 3 + len(actor.events)))
        for actor in traffic.actors
    )


def _drawn(actor: Actor, draws: Floats) -> Actor:
    """The actor shifted by its `vary` times `draws` [3 + events]: position, speeds, departure, then
    the time of each event."""
    pos, speed, time = (
        draws[0] * actor.vary.pos_m,
        draws[1] * actor.vary.speed_mps,
        draws[2] * actor.vary.time_s,
    )
    depart = actor.depart.model_copy(
        update={
            # an actor that is there from the start stays so: else it would appear out of nothing in
            # the middle of the scene
            "time_s": _not_negative(actor.depart.time_s + time) if actor.depart.time_s > 0 else 0.0,
            "pos_m": _not_negative(actor.depart.pos_m + pos),
            "speed_mps": _faster(actor.depart.speed_mps, speed),
        }
    )
    events = tuple(
        _drawn_event(event, speed, shift * actor.vary.time_s)
        for event, shift in zip(actor.events, draws[3:], strict=True)
    )
    # its top speed moves along: a vehicle above it would brake as hard as it can
    top = None if actor.max_speed_mps is None else max(0.1, float(actor.max_speed_mps + speed))
    return actor.model_copy(update={"depart": depart, "events": events, "max_speed_mps": top})


def _drawn_event(event: Event, speed: float, time: float) -> Event:
    at = None if event.at_s is None else _not_negative(event.at_s + time)
    return event.model_copy(
        update={
            "at_s": at,
            "slow_to_mps": None if event.slow_to_mps is None else _faster(event.slow_to_mps, speed),
        }
    )


def _faster(v: float, by: float) -> float:
    """A stand stays a stand."""
    return _not_negative(v + by) if v > 0 else 0.0


def _not_negative(x: float) -> float:
    # libsumo and repr need Python's own floats
    return max(0.0, float(x))
