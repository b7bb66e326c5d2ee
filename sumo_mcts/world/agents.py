"""The agents near a place: a row of scene.Agents for each vehicle and person."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.road import VEHICLE_CLASSES
from sumo_mcts.scene import SETS_OFF, STANDING, Agents
from sumo_mcts.world.bodies import BodyReader, heading_of, require_finite
from sumo_mcts.world.vehicle_types import TypeReader, require_size
from sumo_mcts.world.whereabouts import Whereabouts

PEDESTRIAN = VEHICLE_CLASSES.index("pedestrian")
LEAST_LENGTH, LEAST_WIDTH = 0.3, 0.5  # m: smaller persons count as this large
TREND_S = 0.5  # memory of smoothed accelerations
# m/s2 between an acceleration and the smoothed one beyond which smoothing begins again. SUMO's own
# noise stays below.
CHANGED = 2.0
# s that a vehicle counts as having stood before, where it stands when it is first seen: nobody saw
# it come, so it may have stood for long. It is the default of prediction.stays_after_s.
STOOD_BEFORE = 2.0
_BLINKER_RIGHT, _BLINKER_LEFT = 1, 2  # bits of SUMO's vehicle signals


class _Row(NamedTuple):
    """One agent: the columns of scene.Agents, in their order."""

    id: str
    x: float
    y: float
    heading: float
    v: float
    a: float
    trend: float
    length: float
    width: float
    lane: int
    s: float
    d: float
    blinker: int
    standing_s: float
    person: bool
    vclass: int


class _Stand(NamedTuple):
    """Where somebody stands, or stood."""

    since: float  # simulation time, s
    driven: float  # m since then
    time: float  # of what is known, s


# of the columns that are no numbers with a fraction
_TYPES = {"lane": np.int32, "blinker": np.int32, "person": np.bool_, "vclass": np.int32}


class AgentReader:
    """Reads agents, and remembers for how long each has stood and how it accelerated.

    What was read at one time is not read again: referee and planner look at the same moment, and
    so may several egos.
    """

    def __init__(self, libsumo: Any, types: TypeReader, bodies: BodyReader) -> None:
        self._cars, self._persons = libsumo.vehicle, libsumo.person
        self._types, self._bodies = types, bodies
        self._vehicles, self._walking = Whereabouts(self._cars), Whereabouts(self._persons)
        self._time = -math.inf  # of what follows, s
        self._before = -math.inf  # the moment before, s
        self._read: dict[tuple[bool, str], _Row] = {}  # by name, persons apart
        self._stands: dict[str, _Stand] = {}  # the last one of each
        self._found: set[str] = set()  # who stood when first seen, and has not driven off since
        self._first = math.inf  # when agents were first read, s
        self._trend: dict[str, tuple[float, float]] = {}  # time, s, and smoothed acceleration, m/s2

    def present(self, vehicle: str, time: float) -> bool:
        """Whether a vehicle is on the road at this time, which is now."""
        self._look(time)
        return vehicle in self._vehicles

    def read(self, ego: str, x: float, y: float, reach: float, time: float) -> Agents:
        """The agents within `reach` m of (x, y) but the ego, sorted by id; `time` in s."""
        return _table(sorted(self.rows(ego, x, y, reach, time), key=lambda row: row.id))

    def rows(self, ego: str, x: float, y: float, reach: float, time: float) -> list[_Row]:
        """The same as rows, unsorted. Reading them is what the memory lives on."""
        self._look(time)
        self._first = min(self._first, time)
        vehicles = self._vehicles.within(x, y, reach, time)
        walking = self._walking.within(x, y, reach, time)
        return [
            *(self._row(False, *each) for each in vehicles if each[0] != ego),
            *(self._row(True, *each) for each in walking if not self._persons.getVehicle(each[0])),
        ]

    def _look(self, time: float) -> None:
        """Begin anew where this is another moment than before."""
        if time != self._time:
            self._before, self._time, self._read = self._time, time, {}
            self._vehicles.look()
            self._walking.look()

    def _row(self, person: bool, name: str, px: float, py: float) -> _Row:
        """The row of one that is at (px, py) now, m."""
        row = self._read.get((person, name))
        if row is None:
            of_one = self._of_person if person else self._of_vehicle
            row = self._read[person, name] = of_one(name, px, py, self._time)
        return row

    def _of_vehicle(self, vehicle: str, px: float, py: float, time: float) -> _Row:
        get, kind = self._cars, self._types.of(vehicle, time)
        body = self._bodies.read(vehicle, kind, px, py)
        v, a = get.getSpeed(vehicle), get.getAcceleration(vehicle)
        require_finite(vehicle, px, py, v)
        if vehicle not in self._trend and v <= STANDING and not self._appeared(vehicle, time):
            self._found.add(vehicle)
        signals = get.getSignals(vehicle)
        return _Row(
            id=vehicle,
            x=body.x,
            y=body.y,
            heading=body.heading,
            v=v,
            a=a,
            trend=self._smoothed(vehicle, a, time),
            length=kind.length,
            width=kind.width,
            lane=body.lane,
            s=body.s,
            d=body.d,
            blinker=-1 if signals & _BLINKER_RIGHT else 1 if signals & _BLINKER_LEFT else 0,
            standing_s=self._stood(vehicle, v, time),
            person=False,
            vclass=kind.vclass,
        )

    def _of_person(self, person: str, px: float, py: float, time: float) -> _Row:
        get = self._persons
        v = get.getSpeed(person)
        length = max(get.getLength(person), LEAST_LENGTH)
        width = max(get.getWidth(person), LEAST_WIDTH)
        require_size(person, length, width)
        return _Row(
            id=person,
            x=px,
            y=py,
            heading=heading_of(get.getAngle(person)),
            v=v,
            a=0.0,
            trend=0.0,
            length=length,
            width=width,
            lane=-1,
            s=0.0,
            d=0.0,
            blinker=0,
            standing_s=self.standing_s(person, v, time),
            person=True,
            vclass=PEDESTRIAN,
        )

    def _appeared(self, vehicle: str, time: float) -> bool:
        """Whether SUMO has put it there since the moment before, when others were read already."""
        return time > self._first and self._cars.getDeparture(vehicle) >= self._before

    def _stood(self, vehicle: str, v: float, time: float) -> float:
        """Agents.standing_s of a vehicle."""
        seen = self.standing_s(vehicle, v, time)
        if vehicle not in self._found:
            return seen
        if vehicle not in self._stands:
            self._found.remove(vehicle)
            return seen
        return seen + STOOD_BEFORE if v <= STANDING else seen - STOOD_BEFORE

    def standing_s(self, name: str, v: float, time: float) -> float:
        """As Agents.standing_s, of one at `v` m/s at this time, s."""
        stand = self._stands.get(name, _Stand(time, 0.0, time))
        if v <= STANDING:
            since = time if stand.driven > 0.0 else stand.since
            self._stands[name] = _Stand(since, 0.0, time)
            return time - since
        driven = stand.driven + v * (time - stand.time)
        if name not in self._stands or driven >= SETS_OFF:
            self._stands.pop(name, None)
            return 0.0
        self._stands[name] = stand._replace(driven=driven, time=time)
        return stand.since - time

    def _smoothed(self, name: str, a: float, time: float) -> float:
        """Its acceleration smoothed over TREND_S, m/s2. Smoothing begins again where the
        acceleration jumps."""
        before, mean = self._trend.get(name, (time, a))
        if abs(a - mean) > CHANGED:
            mean = a
        else:
            mean = mean + (a - mean) * (1.0 - math.exp((before - time) / TREND_S))
        self._trend[name] = time, mean
        return mean


def _table(rows: Sequence[_Row]) -> Agents:
    """The rows as columns."""
    names, *columns = zip(*rows, strict=True) if rows else ((),) * len(_Row._fields)
    named: dict[str, Any] = dict(zip(_Row._fields[1:], columns, strict=True))
    others: dict[str, Any] = {
        field: np.array(named.pop(field), kind) for field, kind in _TYPES.items()
    }
    numbers = np.array([*named.values()], np.float64)  # one array: each costs time
    return Agents(ids=tuple(names), **dict(zip(named, numbers, strict=True)), **others)
