"""The actors of a scenario, drawn by the seed; the scripts that some of them hold; the events that vehicles are told.

Row m of a script is the state m steps after the vehicle appeared. SUMO moves first and inserts afterwards: a vehicle due at time t is there,
not yet moved, at the end of the first step that begins at t or later.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.config import Actor, ConfigError, Depart, Event, TrafficConfig, VehicleEvent
from sumo_mcts.model.lanes import successors
from sumo_mcts.scene import Floats, Ints, RoadMap
from sumo_mcts.world.roadmap import has_edge
from sumo_mcts.world.simulation import import_libsumo

ARRIVAL_SLACK = 0.1  # m before the end of its route at which SUMO takes a vehicle out
AT_REST = 0.01  # m/s
LATERAL_STANDING = 1.0  # m/s: SUMO's limit for going sideways is this plus the speed
CHANGE_WISH_S = 5.0  # how long a vehicle driven by SUMO goes on looking for a gap
_SIDES = {"left": 1, "right": -1}
_EPS = 1e-9


class Script(NamedTuple):
    """Where a scripted vehicle is, whatever happens. M rows, the first when it appears, one a step; the last before it leaves the map."""

    v: Floats  # [M] m/s, during the step that ends then
    lane: Ints  # [M] lane of the front
    s: Floats  # [M] lane position of the front, m
    d: Floats  # [M] offset from the lane's centre line, m, left positive
    change: Ints  # [M] a lane change that begins in the step that ends then: -1 right, 0 none, +1 left


class Actors:
    """Lets scripts be held and events happen: call `before_step` before every step of the running simulation."""

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
        """`step` and `change_s` (SUMO's lanechange.duration) in s; `egos` are driven by somebody else; scripts are compiled for `seconds`."""
        self._libsumo: Any = import_libsumo()
        self._step, self._left = step, -1 if road.lefthand else 1
        self._egos = frozenset(egos)
        self._actors = {actor.id: actor for actor in actors}
        for actor in actors:
            check(actor, road)
        scripted = [actor for actor in actors if actor.driver == "script" and actor.id not in self._egos]
        self._scripts = {actor.id: compile_script(actor, road, step, seconds, change_s) for actor in scripted}
        self._events = {actor.id: actor.events for actor in actors if actor.driver == "sumo" and actor.events and actor.id not in self._egos}
        for event in events:
            self._events[event.vehicle] = (*self._events.get(event.vehicle, ()), event)
        self._departed: dict[str, float] = {}
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
        """Whether everybody else, on the road or to come, holds a script, and somebody does: nobody reacts."""
        present = set(self._libsumo.vehicle.getIDList())
        known = present | (self._scripts.keys() - self._departed.keys())
        expected = int(self._libsumo.simulation.getMinExpectedNumber())  # persons and vehicles of the route files count too
        return bool(self._scripts) and present <= self._scripts.keys() | {ego} and expected <= len(known)

    def size(self, vehicle: str) -> tuple[float, float]:
        """Length and width of an actor, m; where it is not on the road those of its vehicle type."""
        sumo = self._libsumo
        if vehicle in sumo.vehicle.getIDList():
            return float(sumo.vehicle.getLength(vehicle)), float(sumo.vehicle.getWidth(vehicle))
        kind = self._actors[vehicle].vtype
        return float(sumo.vehicletype.getLength(kind)), float(sumo.vehicletype.getWidth(kind))

    def departure(self, vehicle: str) -> float | None:
        """When row 0 of an actor holds, s: as it happened, or as it is due. None for vehicles of the route files that are not there yet."""
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
        self._orders = {vehicle: orders for vehicle, orders in self._orders.items() if vehicle in present}
        for vehicle in sorted(self._playing):
            _play(self._libsumo.vehicle, vehicle, self._scripts[vehicle], round((time - self._departed[vehicle]) / self._step) + 1, self._left)
        for vehicle, orders in sorted(self._orders.items()):
            self._orders[vehicle] = _command(self._libsumo.vehicle, vehicle, orders, time - self._departed[vehicle], self._step, self._left)

    def limit(self, vehicle: str) -> None:
        """Give a vehicle on the road the top speed that its actor has; an ego before it is first looked at."""
        actor = self._actors.get(vehicle)
        if actor is not None and actor.max_speed_mps is not None:
            self._libsumo.vehicle.setMaxSpeed(vehicle, actor.max_speed_mps)

    def _begin(self, vehicle: str, time: float) -> None:
        self._departed[vehicle] = time
        self.limit(vehicle)
        if vehicle in self._scripts:
            self._libsumo.vehicle.setSpeedMode(vehicle, 0)
            self._libsumo.vehicle.setLaneChangeMode(vehicle, 0)
            self._playing.add(vehicle)
        elif vehicle in self._events:
            self._orders[vehicle] = _Orders(self._events[vehicle], _Drive(None, 0.0, 0.0, None))


def draw(traffic: TrafficConfig, rng: np.random.Generator) -> tuple[Actor, ...]:
    """The actors of one seed. With traffic.vary = 0 exactly as written. Every actor uses up the same draws whatever its `vary` says."""
    return tuple(_drawn(actor, traffic.vary * rng.uniform(-1.0, 1.0, 3 + len(actor.events))) for actor in traffic.actors)


def appears(due: float, step: float) -> float:
    """When a vehicle that is due at `due` is first on the road, in a simulation that begins at 0; s."""
    return (math.ceil(due / step - _EPS) + 1) * step


def check(actor: Actor, road: RoadMap) -> None:
    """Raise ConfigError where SUMO would refuse the actor or, worse, wait for ever in silence."""
    check_way(f"traffic.actors: {actor.id}", actor.route, actor.depart, road)


def check_way(where: str, route: Sequence[str], depart: Depart, road: RoadMap) -> None:
    """Raise ConfigError where SUMO could insert no vehicle there for this route; `where` in the scenario file that is written."""
    for edge in route:
        has_edge(road, edge, f"{where}: route")
    for edge, following in pairwise(route):
        if not _connected(road, edge, following):
            raise ConfigError(f"{where}: route: no connection leads from {edge} to {following}")
    lanes = np.flatnonzero(road.edge == road.edge_ids.index(route[0]))
    if depart.lane >= len(lanes):
        raise ConfigError(f"{where}: depart.lane: {route[0]} has lanes 0 to {len(lanes) - 1}, got {depart.lane}")
    lane = lanes[depart.lane]
    if depart.pos_m > road.length[lane]:
        raise ConfigError(f"{where}: depart.pos_m: {road.lane_ids[lane]} is {road.length[lane]:.1f} m long, got {depart.pos_m:g}")
    if depart.speed_mps > road.speed[lane]:
        raise ConfigError(f"{where}: depart.speed_mps: the limit on {road.lane_ids[lane]} is {road.speed[lane]:g} m/s, got {depart.speed_mps:g}")


def _connected(road: RoadMap, edge: str, following: str) -> bool:
    """Whether a lane of an edge leads onto another edge."""
    lanes, onto = np.flatnonzero(road.edge == road.edge_ids.index(edge)), road.edge_ids.index(following)
    return any(road.edge[road.exit[i]] == onto for lane in lanes for i in successors(road, int(lane)))


def compile_script(actor: Actor, road: RoadMap, step: float, seconds: float, change_s: float = 3.0) -> Script:
    """What a scripted actor does until it leaves the map, at most `seconds`. A lane change takes `change_s` (SUMO's lanechange.duration), s.

    Raises ConfigError where its lane leads nowhere or a lane change has no lane to go to.
    """
    check(actor, road)
    state = _start(actor, road)
    rows = [(state.v, state.lane, state.s, 0.0, 0)]
    for m in range(math.ceil(seconds / step)):
        state, begun = _obey(state, actor, road, m * step)
        moved = _moved(state, actor, road, step)
        if moved is None:
            break
        state, d = _shifted(moved, actor, road, step, change_s)
        rows.append((state.v, state.lane, state.s, d, begun))
    v, lane, s, offset, change = zip(*rows, strict=True)
    return Script(np.array(v), np.array(lane, dtype=np.int32), np.array(s), np.array(offset), np.array(change, dtype=np.int32))


# --- drawing ---


def _drawn(actor: Actor, draws: Floats) -> Actor:
    """The actor shifted by its `vary` times `draws` [3 + events]: position, speeds, departure, then the time of each event."""
    pos, speed, time = draws[0] * actor.vary.pos_m, draws[1] * actor.vary.speed_mps, draws[2] * actor.vary.time_s
    depart = actor.depart.model_copy(
        update={
            # who is there from the start stays: it would appear out of nothing in the middle of the scene
            "time_s": _not_negative(actor.depart.time_s + time) if actor.depart.time_s > 0 else 0.0,
            "pos_m": _not_negative(actor.depart.pos_m + pos),
            "speed_mps": _faster(actor.depart.speed_mps, speed),
        }
    )
    events = tuple(_drawn_event(event, speed, shift * actor.vary.time_s) for event, shift in zip(actor.events, draws[3:], strict=True))
    # its top speed moves along: a vehicle above it would brake as hard as it can
    top = None if actor.max_speed_mps is None else max(0.1, float(actor.max_speed_mps + speed))
    return actor.model_copy(update={"depart": depart, "events": events, "max_speed_mps": top})


def _drawn_event(event: Event, speed: float, time: float) -> Event:
    at = None if event.at_s is None else _not_negative(event.at_s + time)
    return event.model_copy(update={"at_s": at, "slow_to_mps": None if event.slow_to_mps is None else _faster(event.slow_to_mps, speed)})


def _faster(v: float, by: float) -> float:
    """A stand stays a stand."""
    return _not_negative(v + by) if v > 0 else 0.0


def _not_negative(x: float) -> float:
    # libsumo and repr want Python's own floats
    return max(0.0, float(x))


# --- speeds ---


class _Drive(NamedTuple):
    """What a vehicle was last told about its speed."""

    target: float | None  # m/s, to be reached and kept; None: its driver decides
    accel: float  # m/s2, on the way there
    stand: float  # s that it still has to stand
    resume: float | None  # target after that


def _told(drive: _Drive, event: Event, speed: float | None) -> _Drive:
    """After a speed event; `speed` is the target to go back to after a stop."""
    if event.stop_for_s is not None:
        return _Drive(0.0, event.accel_mps2, drive.stand + event.stop_for_s, drive.resume if drive.stand > 0 else speed)
    if drive.stand > 0:
        return drive._replace(resume=event.slow_to_mps)
    return _Drive(event.slow_to_mps, event.accel_mps2, 0.0, None)


def _stood(drive: _Drive, v: float, step: float) -> _Drive:
    """At the end of its stop it gets its old target back."""
    if drive.stand <= 0 or v > AT_REST:
        return drive
    left = drive.stand - step
    return drive._replace(stand=left) if left > _EPS else _Drive(drive.resume, drive.accel, 0.0, None)


def _towards(target: float, v: float, by: float) -> float:
    return min(max(target, v - by), v + by)


# --- scripts ---


class _State(NamedTuple):
    """A scripted vehicle between two steps."""

    v: float
    lane: int
    s: float
    edge: int  # position in its route of the edge that it is on or heads for
    driven: float  # m
    drive: _Drive
    waiting: tuple[Event, ...]
    side: int  # of the lane change under way, 0 none
    progress: float  # of it, 0..1


def _start(actor: Actor, road: RoadMap) -> _State:
    lane = int(np.flatnonzero(road.edge == road.edge_ids.index(actor.route[0]))[actor.depart.lane])
    speed = actor.depart.speed_mps
    return _State(speed, lane, actor.depart.pos_m, 0, 0.0, _Drive(speed, 0.0, 0.0, None), actor.events, 0, 0.0)


def _obey(state: _State, actor: Actor, road: RoadMap, time: float) -> tuple[_State, int]:
    """The state with the events that are due now, and the lane change that begins."""
    begun = 0
    kept = []
    for event in state.waiting:
        if not _due(event, time, state.driven):
            kept.append(event)
        elif event.change_lane is None:
            state = state._replace(drive=_told(state.drive, event, state.v))
        elif state.side or road.internal[state.lane]:
            kept.append(event)  # one after the other, and not inside a junction
        else:
            begun = _SIDES[event.change_lane]
            state = state._replace(side=begun, progress=0.0)
            _beside(road, state.lane, begun, actor)
    return state._replace(waiting=tuple(kept)), begun


def _due(event: Event, time: float, driven: float) -> bool:
    """Whether its moment has come, `time` s and `driven` m after departure."""
    return time >= event.at_s - _EPS if event.at_s is not None else driven >= (event.at_m or 0.0)


def _moved(state: _State, actor: Actor, road: RoadMap, step: float) -> _State | None:
    """One step along the route, with the new speed as SUMO's Euler step does; None once it has left the map."""
    drive = _stood(state.drive, state.v, step)
    v = _towards(drive.target or 0.0, state.v, drive.accel * step)
    lane, s, edge = state.lane, state.s + v * step, state.edge
    while s > road.length[lane]:
        if edge + 1 == len(actor.route):
            return None
        s -= float(road.length[lane])
        lane = _next_lane(road, lane, actor, edge)
        edge += not road.internal[lane]
    if edge + 1 == len(actor.route) and not road.internal[lane] and s >= road.length[lane] - ARRIVAL_SLACK:
        return None
    return state._replace(v=v, lane=lane, s=s, edge=edge, driven=state.driven + v * step, drive=drive)


def _next_lane(road: RoadMap, lane: int, actor: Actor, edge: int) -> int:
    """The lane after `lane` for a vehicle that leaves edge number `edge` of its route, with as much of the route ahead as possible."""
    route = [road.edge_ids.index(name) for name in actor.route]
    after = [i for i in successors(road, lane) if road.edge[road.exit[i]] == route[edge + 1]]
    if not after:
        raise ConfigError(f"traffic.actors: {actor.id}: {road.lane_ids[lane]} does not lead to {actor.route[edge + 1]}; change lanes before")
    return max(after, key=lambda i: _reach(road, int(road.exit[i]), route[edge + 2 :]))


def _reach(road: RoadMap, lane: int, route: list[int]) -> int:
    """How many of the edges to come can be driven from `lane` without a lane change."""
    lanes = {lane}
    for count, edge in enumerate(route):
        lanes = {int(road.exit[i]) for each in lanes for i in successors(road, each) if road.edge[road.exit[i]] == edge}
        if not lanes:
            return count
    return len(route)


def _shifted(state: _State, actor: Actor, road: RoadMap, step: float, change_s: float) -> tuple[_State, float]:
    """The state after a step of the lane change, if there is one, and the offset from the centre of the lane that it is then in, m."""
    if not state.side:
        return state, 0.0
    before, lane = state.progress, state.lane
    if before >= 0.5 and (road.right if state.side > 0 else road.left)[lane] < 0:  # on a turn of one lane SUMO breaks it off: there is nothing to leave
        return state._replace(side=0, progress=0.0), 0.0
    other = _beside(road, lane, -state.side if before >= 0.5 else state.side, actor)
    apart = float(road.width[lane] + road.width[other]) / 2
    # SUMO goes sideways with the speed that takes change_s, less where the vehicle hardly moves
    progress = before + (min(step / change_s, (LATERAL_STANDING + state.v) * step / apart) if change_s > 0 else 1.0)
    if before < 0.5 <= progress:  # here SUMO counts it to the new lane
        lane = other
    if progress >= 1.0 - _EPS:
        return state._replace(lane=lane, side=0, progress=0.0), 0.0
    return state._replace(lane=lane, progress=progress), state.side * apart * (progress - (progress >= 0.5))


def _beside(road: RoadMap, lane: int, side: int, actor: Actor) -> int:
    """The lane to the left (1) or right (-1)."""
    lane_there = int((road.left if side > 0 else road.right)[lane])
    if lane_there < 0:
        raise ConfigError(f"traffic.actors: {actor.id}: change_lane: no lane {'left' if side > 0 else 'right'} of {road.lane_ids[lane]}")
    return lane_there


def _play(cars: Any, vehicle: str, script: Script, row: int, left: int) -> None:
    """Have SUMO (its vehicle domain: `cars`) arrive at this row with its next step; after the last one the speed stays. `left`: to the next lane there."""
    if row >= len(script.v):
        return
    cars.setSpeed(vehicle, float(script.v[row]))
    if script.change[row]:
        cars.changeLane(vehicle, cars.getLaneIndex(vehicle) + left * int(script.change[row]), 0.0)


# --- vehicles that SUMO drives ---


class _Orders(NamedTuple):
    """Events to come for a vehicle, and what it was told before."""

    waiting: tuple[Event, ...]
    drive: _Drive


def _command(cars: Any, vehicle: str, orders: _Orders, time: float, step: float, left: int) -> _Orders:
    """Tell a vehicle what is due `time` s after its departure; its driver still keeps its distance."""
    due = [event for event in orders.waiting if _due(event, time, cars.getDistance(vehicle))]
    drive, v = orders.drive, cars.getSpeed(vehicle)
    for event in due:
        if event.change_lane is None:
            drive = _told(drive, event, drive.target)
        else:
            _ask_for_lane(cars, vehicle, left * _SIDES[event.change_lane])
    after = _stood(drive, v, step)
    if after.target is not None:
        cars.setSpeed(vehicle, _towards(after.target, v, after.accel * step))
    elif orders.drive.target is not None:
        cars.setSpeed(vehicle, -1.0)  # its driver again
    return _Orders(tuple(event for event in orders.waiting if event not in due), after)


def _ask_for_lane(cars: Any, vehicle: str, side: int) -> None:
    """Change lanes as soon as there is a gap."""
    index = cars.getLaneIndex(vehicle) + side
    if 0 <= index < import_libsumo().edge.getLaneNumber(cars.getRoadID(vehicle)):
        cars.changeLane(vehicle, index, CHANGE_WISH_S)
