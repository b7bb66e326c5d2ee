"""The agents near a place: a row of scene.Agents for each vehicle and person."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.road import VEHICLE_CLASSES
from sumo_mcts.scene import STANDING, Agents
from sumo_mcts.world.bodies import BodyReader, heading_of, require_finite
from sumo_mcts.world.vehicle_types import TypeReader, require_size

PEDESTRIAN = VEHICLE_CLASSES.index("pedestrian")
LEAST_LENGTH, LEAST_WIDTH = 0.3, 0.5  # m: smaller persons count as this large
TREND_S = 0.5  # memory of smoothed accelerations
# m/s2 between an acceleration and the smoothed one beyond which smoothing begins again. SUMO's own
# noise stays below.
CHANGED = 2.0
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


_TYPES = {"lane": np.int32, "blinker": np.int32, "person": np.bool_, "vclass": np.int32}


class AgentReader:
    """Reads agents, and remembers for how long each has stood and how it accelerated."""

    def __init__(self, libsumo: Any, types: TypeReader, bodies: BodyReader) -> None:
        self._cars, self._persons = libsumo.vehicle, libsumo.person
        self._types, self._bodies = types, bodies
        self._standing: dict[str, float] = {}  # since when each stands, s
        self._trend: dict[str, tuple[float, float]] = {}  # time, s, and smoothed acceleration, m/s2

    def read(self, ego: str, x: float, y: float, reach: float, time: float) -> Agents:
        """The agents within `reach` m of (x, y) but the ego, sorted by id; `time` in s."""
        return _table(sorted(self.rows(ego, x, y, reach, time), key=lambda row: row.id))

    def rows(self, ego: str, x: float, y: float, reach: float, time: float) -> list[_Row]:
        """The same as rows, unsorted. Reading them is what the memory lives on."""
        cars, persons = self._cars, self._persons
        vehicles = [name for name in cars.getIDList() if name != ego]
        near = _within(cars, vehicles, x, y, reach)
        walking = [
            each
            for each in _within(persons, persons.getIDList(), x, y, reach)
            if not persons.getVehicle(each[0])
        ]
        return [
            *(self._of_vehicle(name, px, py, time) for name, px, py in near),
            *(self._of_person(name, px, py, time) for name, px, py in walking),
        ]

    def _of_vehicle(self, vehicle: str, px: float, py: float, time: float) -> _Row:
        get, kind = self._cars, self._types.of(vehicle)
        body = self._bodies.read(vehicle, px, py)
        v, a = get.getSpeed(vehicle), get.getAcceleration(vehicle)
        require_finite(vehicle, px, py, v)
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
            standing_s=self._stood(person, v, time),
            person=True,
            vclass=PEDESTRIAN,
        )

    def _stood(self, name: str, v: float, time: float) -> float:
        """For how long it has stood, s."""
        if v > STANDING:
            self._standing.pop(name, None)
            return 0.0
        return time - self._standing.setdefault(name, time)

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


def _within(
    get: Any, names: Sequence[str], x: float, y: float, reach: float
) -> list[tuple[str, float, float]]:
    """Name and position (m) of those within `reach` m of (x, y)."""
    placed = [(name, *get.getPosition(name)) for name in names]
    return [each for each in placed if (each[1] - x) ** 2 + (each[2] - y) ** 2 <= reach * reach]


def _table(rows: Sequence[_Row]) -> Agents:
    """The rows as columns."""
    names, *columns = zip(*rows, strict=True) if rows else ((),) * len(_Row._fields)
    arrays: dict[str, Any] = {
        field: np.array(column, _TYPES.get(field, np.float64))
        for field, column in zip(_Row._fields[1:], columns, strict=True)
    }
    return Agents(ids=tuple(names), **arrays)
