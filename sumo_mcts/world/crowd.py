"""The vehicles that a scenario adds, drawn by the seed.

They are actors and a crowd of further vehicles, each with one of the kinds of drivers.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from sumo_mcts.config import (
    CROWD_ID,
    Actor,
    CrowdConfig,
    Depart,
    DriversConfig,
    Stream,
    TrafficConfig,
)
from sumo_mcts.road import RoadMap
from sumo_mcts.world.actors import draw
from sumo_mcts.world.scripts import check_path

# Between fronts at the start: so many m, and what is driven in so many s.
CLEAR_M, CLEAR_S = 10.0, 1.5
TRIES = 20  # places that are tried for a vehicle before it has to come later

# Attributes of SUMO's vehicle types, uniform between two numbers. Krauss' car following, LC2013,
# and the junction model. All may overtake on the right: SUMO's rule against it has drivers brake as
# hard as they can for moments, with no other vehicle near.
_ANY = {
    "length": (4.0, 5.2), "width": (1.7, 2.0), "accel": (1.8, 3.0), "decel": (3.8, 5.0),
    "emergencyDecel": (8.0, 9.0), "maxSpeed": (25.0, 50.0),
    "lcOvertakeRight": (1.0, 1.0),
}  # fmt: skip
_KINDS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "ordinary": {**_ANY, "tau": (0.9, 1.8), "minGap": (1.5, 3.0), "sigma": (0.0, 0.6),
    "speedFactor": (0.85, 1.1), "impatience": (0.0, 0.3)},
    "aggressive": {
        **_ANY, "accel": (2.6, 4.0), "tau": (0.5, 1.0), "minGap": (0.8, 1.5), "sigma": (0.0, 0.5),
        "speedFactor": (1.05, 1.35), "impatience": (0.5, 1.0),
        "lcAssertive": (1.5, 4.0), "lcCooperative": (0.0, 0.3), "lcSpeedGain": (1.5, 5.0),
        "jmTimegapMinor": (0.3, 0.7),
    },
    "inattentive": {
        **_ANY, "tau": (1.0, 1.8), "minGap": (1.5, 3.0), "sigma": (0.4, 0.9),
        "speedFactor": (0.8, 1.15), "lcCooperative": (0.0, 1.0),
        "jmIgnoreFoeProb": (0.0, 0.02), "jmIgnoreFoeSpeed": (20.0, 20.0),
    },
}  # fmt: skip

Attributes = dict[str, str]


class Cast(NamedTuple):
    """All vehicles that a scenario adds to the traffic."""

    actors: tuple[Actor, ...] = ()  # the crowd among them
    # vehicle -> the vehicle type that it has to itself, where its driver was drawn
    types: Mapping[str, Attributes] = {}
    # the vehicles that wait for free space to enter; the others appear where they should, even
    # where a vehicle stands
    late: frozenset[str] = frozenset()


def cast(
    traffic: TrafficConfig, egos: Sequence[str], road: RoadMap, rng: np.random.Generator
) -> Cast:
    """The cast of one seed.

    The actors are the same with and without a crowd and kinds of drivers, but that none enters
    faster than its driver goes there. The `egos` keep their vehicle types. Raises ConfigError where
    SUMO could not insert a vehicle of a stream.
    """
    for k, stream in enumerate(traffic.crowd.streams):
        check_stream(k, stream, road)
    actors = draw(traffic, rng)
    crowd, late = _crowd(traffic.crowd, actors, rng)
    driven = [
        actor.id for actor in (*actors, *crowd) if actor.driver == "sumo" and actor.id not in egos
    ]
    types = (
        {vehicle: _type(traffic.drivers, rng) for vehicle in driven}
        if _drawn(traffic.drivers)
        else {}
    )
    return Cast(tuple(_held_back(actor, types, road) for actor in (*actors, *crowd)), types, late)


def crowd_ids(crowd: CrowdConfig) -> list[str]:
    """The ids that vehicles of the crowd have, whatever is drawn: those of the largest one."""
    return [f"{CROWD_ID}{number}" for number in range(1, crowd.count[1] + 1)]


def write_routes(members: Cast, folder: Path) -> Path:
    """Write a SUMO route file with the cast. Returns its path."""
    root = ElementTree.Element("routes")
    for vehicle, attributes in members.types.items():
        ElementTree.SubElement(
            root,
            "vType",
            {"id": _type_id(vehicle), "vClass": "passenger", "speedDev": "0", **attributes},
        )
    for actor in sorted(members.actors, key=lambda actor: actor.depart.time_s):
        at = {
            "depart": repr(actor.depart.time_s),
            "departLane": str(actor.depart.lane),
            "departPos": repr(actor.depart.pos_m),
        }
        speed = (
            {"departSpeed": "avg"}
            if actor.id in members.late
            else {"departSpeed": repr(actor.depart.speed_mps), "insertionChecks": "none"}
        )
        name = _type_id(actor.id) if actor.id in members.types else actor.vtype
        entry = ElementTree.SubElement(
            root, "vehicle", {"id": actor.id, "type": name, **at, **speed}
        )
        ElementTree.SubElement(entry, "route", {"edges": " ".join(actor.route)})
    ElementTree.indent(root)
    path = folder / "actors.rou.xml"
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    return path


def check_stream(number: int, stream: Stream, road: RoadMap) -> None:
    """Raise ConfigError where SUMO could not insert a vehicle of a stream, whatever is drawn.

    `number`: of the stream, from 0.
    """
    for lane in stream.lanes:
        depart = Depart(lane=lane, pos_m=stream.pos_m[1], speed_mps=stream.speed_mps[1])
        check_path(f"traffic.crowd.streams: stream {number + 1}", stream.route, depart, road)


def _crowd(
    crowd: CrowdConfig, actors: Sequence[Actor], rng: np.random.Generator
) -> tuple[tuple[Actor, ...], frozenset[str]]:
    """The crowd, and the ids of those that enter later."""
    if crowd.count[1] == 0:
        return (), frozenset()
    there, late = list(actors), []
    count = int(rng.integers(crowd.count[0], crowd.count[1] + 1))
    for name in crowd_ids(crowd)[:count]:
        stream = crowd.streams[int(rng.integers(len(crowd.streams)))]
        lane, speed = (
            stream.lanes[int(rng.integers(len(stream.lanes)))],
            _within(stream.speed_mps, rng),
        )
        time, places = _within((0.0, crowd.within_s), rng), rng.uniform(*stream.pos_m, TRIES)
        is_late = rng.random() < crowd.late
        free = [
            float(pos)
            for pos in places
            if not is_late and _is_free(stream, lane, float(pos), speed, there)
        ]
        depart = (
            Depart(lane=lane, pos_m=free[0], speed_mps=speed)
            if free
            else Depart(time_s=time, lane=lane, speed_mps=speed)
        )
        member = Actor(id=name, route=stream.route, depart=depart)
        there.append(member)
        late += [] if free else [member.id]
    return tuple(there[len(actors) :]), frozenset(late)


def _is_free(stream: Stream, lane: int, pos: float, speed: float, there: Sequence[Actor]) -> bool:
    """Whether no vehicle that is there from the start is too near in the same lane."""
    same = [
        a.depart
        for a in there
        if a.route[0] == stream.route[0] and a.depart.lane == lane and a.depart.time_s == 0.0
    ]
    return all(
        abs(pos - at.pos_m) > CLEAR_M + CLEAR_S * (at.speed_mps if at.pos_m < pos else speed)
        for at in same
    )


def _drawn(drivers: DriversConfig) -> bool:
    return any(getattr(drivers, kind) > 0.0 for kind in _KINDS)


def _type(drivers: DriversConfig, rng: np.random.Generator) -> Attributes:
    """A driver of some kind."""
    shares = np.array([getattr(drivers, kind) for kind in _KINDS])
    kind = list(_KINDS)[int(rng.choice(len(_KINDS), p=shares / shares.sum()))]
    return {key: f"{_within(bounds, rng):.3f}" for key, bounds in _KINDS[kind].items()}


def _held_back(actor: Actor, types: Mapping[str, Attributes], road: RoadMap) -> Actor:
    """The actor, not faster than its driver's share of the limit: SUMO would refuse it."""
    if actor.id not in types or actor.route[0] not in road.edge_ids:
        return actor
    limit = float(road.speed[road.edge == road.edge_ids.index(actor.route[0])].min())
    speed = min(actor.depart.speed_mps, limit * float(types[actor.id]["speedFactor"]))
    return actor.model_copy(update={"depart": actor.depart.model_copy(update={"speed_mps": speed})})


def _type_id(vehicle: str) -> str:
    return f"driver_of_{vehicle}"


def _within(bounds: tuple[float, float], rng: np.random.Generator) -> float:
    return float(rng.uniform(*bounds))
