"""From the running simulation to a Scene (what the planner may know) and a Frame (what the referee
judges by)."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.errors import ConfigError
from sumo_mcts.scene import (
    IGNORING,
    REFEREE_RANGE,
    STANDING,
    VEHICLE_CLASSES,
    Agents,
    EgoState,
    Floats,
    Frame,
    Ints,
    RoadMap,
    Scene,
    Signals,
)
from sumo_mcts.world.library import import_libsumo
from sumo_mcts.world.roadmap import lane_index
from sumo_mcts.world.signals import PHASES, SignalReader
from sumo_mcts.world.simulation import step_length

LEADER_RANGE = 100.0  # m within which an agent's leader is asked for
TREND_S = 0.5  # memory of smoothed accelerations
# m/s2 that an acceleration is off the smoothed one where the driver has changed its mind: SUMO's
# own noise stays below
CHANGED = 2.0
# lanes that a vehicle can stand on beside the one where its front is: they can be very short inside
# junctions
MOST_UNDER = 7
BRAKING = -1.5  # m/s2 beyond which the referee wants to know why
POSE, SPEED, LANE, POSITION, THERE = (
    slice(0, 4),
    4,
    5,
    6,
    7,
)  # columns of states(): centre x, y, cos, sin; m/s; lane of the front; m; 1 where it is there


class Change(NamedTuple):
    """A lane change of the ego under way, as the one who commanded it knows."""

    progress: float = 0.0
    source: int = -1
    target: int = -1


class VehicleType(NamedTuple):
    """What does not change about a vehicle."""

    length: float
    width: float
    max_accel: float
    decel: float
    emergency_decel: float
    max_speed: float
    speed_factor: float
    vclass: int
    articulated: bool  # SUMO's angle is that of the tractor


MOST_SIZE = 2000.0  # m; trains are long
_MEASURING = ("measures", "thresholds", "range", "extratime")  # of the SSM device


class Observer:
    """Reads one simulation.

    Keeps what needs memory: for how long agents have stood, and the signals' programs. `lanes`:
    lane id -> index.
    """

    def __init__(self, road: RoadMap) -> None:
        self._libsumo: Any = import_libsumo()
        self._road = road
        self.lanes = lane_index(road)
        self._left = (
            -1.0 if road.lefthand else 1.0
        )  # SUMO's lateral positions grow in the order of its lanes
        self._edges = {edge: i for i, edge in enumerate(road.edge_ids)}
        self._types: dict[str, VehicleType] = {}
        self._standing: dict[str, float] = {}
        self._driven: dict[
            str, tuple[int, ...]
        ] = {}  # the lanes under articulated vehicles, the present one last
        self._trend: dict[str, tuple[float, float]] = {}  # time and smoothed acceleration
        self._otherwise: dict[str, bool] = {}  # egos whose surrogate measures are not ours
        self._signals = SignalReader(self._libsumo, road)
        self.step = step_length()

    def present(self, vehicle: str) -> bool:
        """Whether a vehicle is on the road."""
        return vehicle in self._libsumo.vehicle.getIDList()

    def scene(self, ego: str, change: Change, sensor_range: float, timing: bool) -> Scene:
        """What the planner may know now."""
        state = self.ego(ego, change)
        time = float(self._libsumo.simulation.getTime())
        agents = self._agents(ego, state.x, state.y, sensor_range, time)
        return Scene(
            time,
            self.step,
            state,
            agents,
            self._signals.read(state.x, state.y, time, PHASES if timing else 1),
        )

    def timing(self, x: float, y: float) -> Signals:
        """The signals near a place with their coming phases."""
        return self._signals.read(x, y, float(self._libsumo.simulation.getTime()), PHASES)

    def remember(self, ego: str) -> float:
        """What frame() keeps in mind of the agents around an ego that is on the road, for a loop
        without a referee; returns the time, s."""
        time, state = float(self._libsumo.simulation.getTime()), self.ego(ego, Change())
        self._rows(ego, state.x, state.y, REFEREE_RANGE, time)
        return time

    def frame(self, ego: str, change: Change, last: Frame | None) -> Frame:
        """What SUMO reports of the last step, for the referee."""
        sumo = self._libsumo
        time = float(sumo.simulation.getTime())
        present = self.present(ego)
        if not present and last is None:
            raise LookupError(ego)
        state = self.ego(ego, change) if present or last is None else last.ego
        agents = self._agents(ego, state.x, state.y, REFEREE_RANGE, time)
        leader, paths = self._why_brakes(agents)
        hits = [c for c in sumo.simulation.getCollisions() if ego in (c.collider, c.victim)]
        ttc, drac, pet = self._surrogates(ego) if present else (math.nan,) * 3
        return Frame(
            time, state, present, agents, self._signals.read(state.x, state.y, time, 1), leader,
            paths,
            tuple(c.victim if c.collider == ego else c.collider for c in hits),
            hits[0].type if hits else "",
            ego in sumo.simulation.getStartingTeleportIDList(),
            ego in sumo.simulation.getArrivedIDList(), ttc, pet, drac,
        )  # fmt: skip

    def ego(self, vehicle: str, change: Change) -> EgoState:
        """The ego as its own sensors know it."""
        get = self._libsumo.vehicle
        kind = self._type(vehicle)
        x, y = get.getPosition(vehicle)
        _require_finite(vehicle, x, y, get.getSpeed(vehicle))
        heading = _heading(get.getAngle(vehicle))
        route = get.getRoute(vehicle)
        edges = tuple(
            self._edges.get(edge, -1) for edge in route[max(get.getRouteIndex(vehicle), 0) :]
        )
        return EgoState(
            vehicle, x - 0.5 * kind.length * math.cos(heading),
            y - 0.5 * kind.length * math.sin(heading), heading, get.getSpeed(vehicle),
            get.getAcceleration(vehicle), self.lanes.get(get.getLaneID(vehicle), -1),
            get.getLanePosition(vehicle),
            self._left * get.getLateralLanePosition(vehicle), kind.length, kind.width,
            kind.max_accel, kind.decel, kind.emergency_decel, kind.max_speed,
            kind.speed_factor, kind.vclass, edges, change.progress, change.target, change.source,
        )  # fmt: skip

    def states(self, names: Sequence[str]) -> Floats:
        """[N, 8] where vehicles and persons are now, however far away; zeros, on lane -1, for those
        that are not there."""
        cars, persons = self._libsumo.vehicle, self._libsumo.person
        driving, walking = set(cars.getIDList()), set(persons.getIDList())
        states = np.zeros((len(names), 8))
        states[:, LANE] = -1
        for i, name in enumerate(names):
            if name in driving:
                px, py = cars.getPosition(name)
                x, y, heading, lane, s = self._box(name, px, py)
                states[i] = (
                    x,
                    y,
                    math.cos(heading),
                    math.sin(heading),
                    cars.getSpeed(name),
                    lane,
                    s,
                    1.0,
                )
            elif name in walking and not persons.getVehicle(name):
                heading = _heading(persons.getAngle(name))
                states[i] = (
                    *persons.getPosition(name),
                    math.cos(heading),
                    math.sin(heading),
                    persons.getSpeed(name),
                    -1,
                    0.0,
                    1.0,
                )
        return states

    def way(self, vehicle: str, lane: int) -> Ints:
        """The lanes it is really going to take, as no sensor knows, without changing lanes; in the
        wrong lane they end where that lane does."""
        lanes = [lane]
        try:
            links = self._libsumo.vehicle.getNextLinks(vehicle)
        except self._libsumo.TraCIException:  # it is remembered, but has left
            links = ()
        for link in links:
            for following in (
                *self._chain(self.lanes.get(link[4], -1)),
                self.lanes.get(link[0], -1),
            ):
                first, last = (
                    self._road.successor_offset[lanes[-1]],
                    self._road.successor_offset[lanes[-1] + 1],
                )
                if following not in self._road.successor[first:last]:
                    return np.array(lanes, np.int32)
                lanes.append(following)
        return np.array(lanes, np.int32)

    def _agents(self, ego: str, x: float, y: float, reach: float, time: float) -> Agents:
        return _columns(sorted(self._rows(ego, x, y, reach, time), key=lambda row: str(row[0])))

    def _rows(
        self, ego: str, x: float, y: float, reach: float, time: float
    ) -> list[tuple[Any, ...]]:
        """Everybody within reach but the ego, as a row of Agents' columns each."""
        get = self._libsumo.vehicle
        ids = get.getIDList()
        near = []
        for vehicle in ids:
            if vehicle != ego:
                px, py = get.getPosition(vehicle)
                if (px - x) ** 2 + (py - y) ** 2 <= reach * reach:
                    near.append((vehicle, px, py))
        people = []
        persons = self._libsumo.person
        for person in persons.getIDList():
            px, py = persons.getPosition(person)
            if (px - x) ** 2 + (py - y) ** 2 <= reach * reach and not persons.getVehicle(person):
                people.append((person, px, py))
        return [self._vehicle_row(v, px, py, time) for v, px, py in near] + [
            self._person_row(p, px, py, time) for p, px, py in people
        ]

    def _vehicle_row(self, vehicle: str, px: float, py: float, time: float) -> tuple[Any, ...]:
        get = self._libsumo.vehicle
        kind = self._type(vehicle)
        x, y, heading, lane, s = self._box(vehicle, px, py)
        v, a = get.getSpeed(vehicle), get.getAcceleration(vehicle)
        _require_finite(vehicle, px, py, v)
        signals = get.getSignals(vehicle)
        return (
            vehicle, x, y, heading, v, a, self._smoothed(vehicle, a, time), kind.length,
            kind.width, lane, s, self._left * get.getLateralLanePosition(vehicle),
            (-1 if signals & 1 else 1 if signals & 2 else 0), self._stood(vehicle, v, time), False,
            kind.vclass,
        )  # fmt: skip

    def _box(self, vehicle: str, px: float, py: float) -> tuple[float, float, float, int, float]:
        """Centre x, y, heading, lane and lane position of a vehicle whose front is at (px, py)."""
        get = self._libsumo.vehicle
        kind = self._type(vehicle)
        lane, s = self.lanes.get(get.getLaneID(vehicle), -1), get.getLanePosition(vehicle)
        heading = (
            self._chord(vehicle, lane, s - kind.length, px, py)
            if kind.articulated and lane >= 0
            else _heading(get.getAngle(vehicle))
        )
        return (
            px - 0.5 * kind.length * math.cos(heading),
            py - 0.5 * kind.length * math.sin(heading),
            heading,
            lane,
            s,
        )

    def _chord(self, vehicle: str, lane: int, rear: float, px: float, py: float) -> float:
        """Heading from the rear, at lane position `rear` (m, negative: on a lane before), to the
        front of a long vehicle at (px, py)."""
        driven = self._driven.get(vehicle, (lane,))
        if driven[-1] != lane:
            changed = self._road.edge[driven[-1]] == self._road.edge[lane]  # beside, not behind
            driven = (*(driven[:-1] if changed else driven[-MOST_UNDER:]), lane)
        self._driven[vehicle] = driven
        for before in driven[-2::-1]:
            if rear >= 0.0:
                break
            lane, rear = before, rear + float(self._road.length[before])
        rear = max(rear, 0.0)
        scale = self._road.scale[lane]
        first, last = int(self._road.point_offset[lane]), int(self._road.point_offset[lane + 1])
        x = np.interp(
            rear * scale, self._road.point_s[first:last], self._road.points[first:last, 0]
        )
        y = np.interp(
            rear * scale, self._road.point_s[first:last], self._road.points[first:last, 1]
        )
        return math.atan2(py - float(y), px - float(x))

    def _person_row(self, person: str, px: float, py: float, time: float) -> tuple[Any, ...]:
        get = self._libsumo.person
        v = get.getSpeed(person)
        length, width = max(get.getLength(person), 0.3), max(get.getWidth(person), 0.5)
        _require_size(person, length, width)
        return (
            person,
            px,
            py,
            _heading(get.getAngle(person)),
            v,
            0.0,
            0.0,
            length,
            width,
            -1,
            0.0,
            0.0,
            0,
            self._stood(person, v, time),
            True,
            PEDESTRIAN,
        )

    def _stood(self, name: str, v: float, time: float) -> float:
        """For how long it has stood, s."""
        if v > STANDING:
            self._standing.pop(name, None)
            return 0.0
        return time - self._standing.setdefault(name, time)

    def _smoothed(self, name: str, a: float, time: float) -> float:
        """Its acceleration with a memory of TREND_S, which begins anew where the driver changes its
        mind, m/s2."""
        before, mean = self._trend.get(name, (time, a))
        mean = (
            a
            if abs(a - mean) > CHANGED
            else mean + (a - mean) * (1.0 - math.exp((before - time) / TREND_S))
        )
        self._trend[name] = time, mean
        return mean

    def _type(self, vehicle: str) -> VehicleType:
        kind = self._types.get(vehicle)
        if kind is None:
            get = self._libsumo.vehicle
            name = get.getVehicleClass(vehicle)
            vclass = VEHICLE_CLASSES.index(name) if name in VEHICLE_CLASSES else IGNORING
            kind = VehicleType(
                get.getLength(vehicle), get.getWidth(vehicle), get.getAccel(vehicle),
                get.getDecel(vehicle), get.getEmergencyDecel(vehicle),
                get.getMaxSpeed(vehicle), get.getSpeedFactor(vehicle), vclass,
                "trailer" in get.getShapeClass(vehicle),
            )  # fmt: skip
            _require_sound(vehicle, kind)
            self._types[vehicle] = kind
        return kind

    def _why_brakes(self, agents: Agents) -> tuple[tuple[str, ...], tuple[Ints, ...]]:
        """For agents that brake: the leader that SUMO names, and the lanes they are really going to
        take."""
        leader, paths = [""] * len(agents.ids), [_NO_LANES] * len(agents.ids)
        for i in np.flatnonzero((agents.a < BRAKING) & ~agents.person & (agents.lane >= 0)):
            found = self._libsumo.vehicle.getLeader(agents.ids[i], LEADER_RANGE)
            leader[i] = found[0] if found else ""
            paths[i] = self.way(agents.ids[i], int(agents.lane[i]))
        return tuple(leader), tuple(paths)

    def _chain(self, lane: int) -> list[int]:
        """The internal lanes of a connection from its first one on."""
        road = self._road
        chain: list[int] = []
        while lane >= 0 and road.internal[lane] and len(chain) < 8:
            chain.append(lane)
            first = road.successor_offset[lane]
            lane = int(road.successor[first]) if first < road.successor_offset[lane + 1] else -1
        return chain

    def _surrogates(self, ego: str) -> tuple[float, float, float]:
        """TTC (s), DRAC (m/s2), PET (s) of the ego's SSM device at this moment; nan where
        undefined, and where its device is not as we want it."""
        get = self._libsumo.vehicle.getParameter
        if get(ego, "has.ssm.device") != "true" or self._measures_otherwise(ego):
            return (math.nan,) * 3
        return (
            _number(get(ego, "device.ssm.minTTC")),
            _number(get(ego, "device.ssm.maxDRAC")),
            _number(get(ego, "device.ssm.minPET")),
        )

    def _measures_otherwise(self, vehicle: str) -> bool:
        """Whether the vehicle's type says itself how its SSM device measures, which SUMO puts above
        our options."""
        if vehicle not in self._otherwise:
            kind = self._libsumo.vehicle.getTypeID(vehicle)
            own = any(
                self._libsumo.vehicletype.getParameter(kind, f"device.ssm.{key}")
                for key in _MEASURING
            )
            self._otherwise[vehicle] = own or not self._measures_all(vehicle)
        return self._otherwise[vehicle]

    def _measures_all(self, vehicle: str) -> bool:
        """Whether the device has all three: the vehicle itself may say otherwise too."""
        try:
            for key in ("minTTC", "maxDRAC", "minPET"):
                self._libsumo.vehicle.getParameter(vehicle, f"device.ssm.{key}")
        except self._libsumo.TraCIException:
            return False
        return True


def departure(vehicle: str) -> float | None:
    """When a vehicle departed, s, which tells it from another one that has its id later;

    None: it is not there, on the road or between two in a teleport.
    """
    sumo = import_libsumo()
    try:
        return float(sumo.vehicle.getDeparture(vehicle))
    except sumo.TraCIException:
        return None


def _require_sound(vehicle: str, kind: VehicleType) -> None:
    """Raise ConfigError where a vehicle's type, which SUMO takes as it is, holds what nobody can
    compute with."""
    _require_size(vehicle, kind.length, kind.width)
    wrong = next((name for name, value in kind._asdict().items() if not math.isfinite(value)), None)
    if wrong is not None:
        raise ConfigError(f"vehicle type of {vehicle}: {wrong}: has to be a finite number")


def _require_finite(vehicle: str, *state: float) -> None:
    """Raise ConfigError where SUMO moves a vehicle by numbers that are none, which its files gave
    it."""
    if not all(map(math.isfinite, state)):
        raise ConfigError(
            f"vehicle {vehicle}: SUMO tells no finite position and speed of it; what its files say "
            "of its departure has to be numbers"
        )


def _require_size(name: str, length: float, width: float) -> None:
    """Raise ConfigError where a vehicle or a person is larger than any."""
    for what, value in (("length", length), ("width", width)):
        if not 0.0 < value <= MOST_SIZE:
            raise ConfigError(
                f"vehicle type of {name}: {what}: has to be greater than 0 and at most "
                f"{MOST_SIZE:g} m, got {value:g}"
            )


PEDESTRIAN = VEHICLE_CLASSES.index("pedestrian")
_NO_LANES: Ints = np.zeros(0, np.int32)


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if abs(value) < 1e6 else math.nan


def _heading(angle: float) -> float:
    """SUMO's degrees clockwise from north to radians counter-clockwise from east, in (-pi, pi]."""
    heading = math.radians(90.0 - angle)
    return heading + 2 * math.pi if heading <= -math.pi else heading


def _columns(rows: list[tuple[Any, ...]]) -> Agents:
    names, *columns = zip(*rows, strict=True) if rows else ((),) * 16
    x, y, heading, v, a, trend, length, width, lane, s, d, blinker, standing, person, vclass = (
        columns
    )
    return Agents(
        tuple(names), _floats(x), _floats(y), _floats(heading), _floats(v), _floats(a),
        _floats(trend), _floats(length), _floats(width),
        np.array(lane, np.int32), _floats(s), _floats(d), np.array(blinker, np.int32),
        _floats(standing), np.array(person, np.bool_),
        np.array(vclass, np.int32),
    )  # fmt: skip


def _floats(column: tuple[Any, ...]) -> Floats:
    return np.array(column, np.float64)
