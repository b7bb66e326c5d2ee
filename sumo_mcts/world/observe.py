"""From the running simulation to a Scene (what the planner may know) and a Frame (what the referee
judges by)."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Ints
from sumo_mcts.numerics.geometry import COS, SIN, X, Y
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import REFEREE_RANGE, STANDING, EgoState, Frame, Scene, Signals
from sumo_mcts.world.agents import AgentReader
from sumo_mcts.world.bodies import BodyReader, heading_of, require_finite
from sumo_mcts.world.library import running_sumo
from sumo_mcts.world.places import Places
from sumo_mcts.world.road_changes import RoadReader
from sumo_mcts.world.roadmap import lane_index
from sumo_mcts.world.sideways import Aside
from sumo_mcts.world.signals import PHASES, SignalReader
from sumo_mcts.world.simulation import step_length
from sumo_mcts.world.stops import StopReader
from sumo_mcts.world.surrogates import SurrogateReader, Surrogates
from sumo_mcts.world.truth import TruthReader
from sumo_mcts.world.vehicle_types import TypeReader

# Columns of Observer.states(): those of a pose, then speed, m/s, lane and lane position (m) of the
# front, and 1 where the agent is there.
POSE = slice(0, 4)
SPEED, LANE, POSITION, THERE = range(4, 8)
_NOT_ASKED: Bools = np.zeros(0, np.bool_)


class Change(NamedTuple):
    """A lane change of the ego under way, as commanded."""

    progress: float = 0.0  # 0..1
    source: int = -1  # lane that it leaves
    target: int = -1  # lane that it moves to


class Observer:
    """Reads one simulation.

    Its readers keep what needs memory. `lanes`: lane id -> index; `step`: of the simulation, s.
    """

    def __init__(self, road: RoadMap) -> None:
        self._libsumo: Any = running_sumo()
        self.lanes = lane_index(road)
        self.step = step_length()
        self._places = Places(self._libsumo, road, self.lanes)
        self._edges = {edge: i for i, edge in enumerate(road.edge_ids)}
        self._types = TypeReader(self._libsumo)
        self._bodies = BodyReader(self._libsumo, road, self.lanes)
        self._agents = AgentReader(self._libsumo, self._types, self._bodies)
        self._signals = SignalReader(self._libsumo, road)
        self._stops = StopReader(self._libsumo, road, self.lanes)
        self._aside = Aside(self._libsumo, road)
        self._surrogates = SurrogateReader(self._libsumo)
        self._truth = TruthReader(self._libsumo, road, self.lanes)
        self._road = road
        self._changes: dict[str, RoadReader] = {}  # by ego: none knows what another one has seen

    def present(self, vehicle: str) -> bool:
        """Whether a vehicle is on the road."""
        return vehicle in self._libsumo.vehicle.getIDList()

    def scene(self, ego: str, change: Change, sensor_range: float, timing: bool) -> Scene:
        """What the planner may know now; with `timing` also the coming phases of signals."""
        state, time = self.ego(ego, change), self._time()
        return Scene(
            time=time,
            step=self.step,
            ego=state,
            agents=self._agents.read(ego, state.x, state.y, sensor_range, time),
            signals=self._signals.read(state.x, state.y, time, PHASES if timing else 1),
            changes=self._changes_near(ego).look(state),
        )

    def frame(self, ego: str, change: Change, last: Frame | None) -> Frame:
        """What SUMO reports of the last step, for the referee.

        `last`: the frame before, from which an ego that is gone keeps its state. Raises LookupError
        where there is neither.
        """
        simulation, time = self._libsumo.simulation, self._time()
        present = self._agents.present(ego, time)
        if not present and last is None:
            raise LookupError(ego)
        state = self.ego(ego, change) if present or last is None else last.ego
        agents = self._agents.read(ego, state.x, state.y, REFEREE_RANGE, time)
        leader, paths = self._truth.why_brakes(agents)
        hits = [c for c in simulation.getCollisions() if ego in (c.collider, c.victim)]
        measured = self._surrogates.read(ego) if present else Surrogates()
        near = self._changes_near(ego)
        return Frame(
            time=time,
            ego=state,
            present=present,
            agents=agents,
            signals=self._signals.read(state.x, state.y, time, 1),
            green=self._signals.green(state.x, state.y) if state.v < STANDING else _NOT_ASKED,
            leader=leader,
            paths=paths,
            collisions=tuple(c.victim if c.collider == ego else c.collider for c in hits),
            collision_type=hits[0].type if hits else "",
            teleported=ego in simulation.getStartingTeleportIDList(),
            arrived=ego in simulation.getArrivedIDList(),
            ttc=measured.ttc,
            pet=measured.pet,
            drac=measured.drac,
            changes=near.below(state) if present else near.changes,
        )

    def _changes_near(self, ego: str) -> RoadReader:
        if ego not in self._changes:
            self._changes[ego] = RoadReader(self._libsumo, self._road)
        return self._changes[ego]

    def remember(self, ego: str) -> float:
        """Update the memory of agents around an ego on the road, as frame() does, for a loop
        without a referee. Returns the time, s."""
        time, state = self._time(), self.ego(ego, Change())
        self._agents.rows(ego, state.x, state.y, REFEREE_RANGE, time)
        return time

    def is_held(self, vehicle: str) -> bool:
        """Whether SUMO has a vehicle stand at a stop of its schedule."""
        return self._stops.is_held(vehicle)

    def ego(self, vehicle: str, change: Change) -> EgoState:
        """The ego as its own sensors measure it."""
        get, time = self._libsumo.vehicle, self._time()
        kind = self._types.of(vehicle, time, 0.0)
        (x, y), v = get.getPosition(vehicle), get.getSpeed(vehicle)
        require_finite(vehicle, x, y, v)
        heading, place = heading_of(get.getAngle(vehicle)), self._places.of(vehicle)
        ahead = get.getRoute(vehicle)[max(get.getRouteIndex(vehicle), 0) :]
        route = tuple(self._edges.get(edge, -1) for edge in ahead)
        stop, held = self._stops.read(vehicle, route, place.lane, place.s)
        return EgoState(
            id=vehicle,
            x=x - 0.5 * kind.length * math.cos(heading),
            y=y - 0.5 * kind.length * math.sin(heading),
            heading=heading,
            v=v,
            a=get.getAcceleration(vehicle),
            lane=place.lane,
            s=place.s,
            d=place.d,
            length=kind.length,
            width=kind.width,
            max_accel=kind.max_accel,
            comfort_decel=kind.decel,
            emergency_decel=kind.emergency_decel,
            max_speed=kind.max_speed,
            speed_factor=kind.speed_factor,
            vclass=kind.vclass,
            route=route,
            changing=change.progress,
            change_to=change.target,
            change_from=change.source,
            stop=stop,
            held=held,
            sideways=self._aside.read(vehicle, place, kind.width),
            standing_s=self._agents.standing_s(vehicle, v, time),
        )

    def timing(self, x: float, y: float) -> Signals:
        """The signals near a place (m) with their coming phases."""
        return self._signals.read(x, y, self._time(), PHASES)

    def coming_lanes(self, vehicle: str, lane: int) -> Ints:
        """The lanes that a vehicle on `lane` is going to take, which no sensor sees."""
        return self._truth.coming_lanes(vehicle, lane)

    def states(self, names: Sequence[str]) -> Floats:
        """[N, 8] where vehicles and persons are now, however far away; zeros, on lane -1, for those
        that are not there."""
        cars, persons = self._libsumo.vehicle, self._libsumo.person
        driving, walking = set(cars.getIDList()), set(persons.getIDList())
        states = np.zeros((len(names), 8))
        states[:, LANE] = -1
        for i, name in enumerate(names):
            if name in driving:
                kind = self._types.of(name, self._time())
                body = self._bodies.read(name, kind, *cars.getPosition(name))
                states[i, X], states[i, Y] = body.x, body.y
                heading, speed = body.heading, cars.getSpeed(name)
                states[i, LANE], states[i, POSITION] = body.lane, body.s
            elif name in walking and not persons.getVehicle(name):
                states[i, X], states[i, Y] = persons.getPosition(name)
                heading, speed = heading_of(persons.getAngle(name)), persons.getSpeed(name)
            else:
                continue
            states[i, COS], states[i, SIN] = math.cos(heading), math.sin(heading)
            states[i, SPEED], states[i, THERE] = speed, 1.0
        return states

    def _time(self) -> float:
        return float(self._libsumo.simulation.getTime())


def departure(vehicle: str) -> float | None:
    """When a vehicle departed, s. This distinguishes it from a later vehicle with its id.

    None: it is neither on the road nor between two roads in a teleport.
    """
    get = running_sumo().vehicle
    # not asked in vain: SUMO would print an error at the other end of a connection
    there = vehicle in get.getIDList() or vehicle in get.getTeleportingIDList()
    return float(get.getDeparture(vehicle)) if there else None
