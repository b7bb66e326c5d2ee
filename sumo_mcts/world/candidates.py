"""Which vehicles of a user's simulation an ego could be: found by running it for a while with SUMO alone."""

import math
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

from sumo_mcts.world.simulation import Simulation, import_libsumo

ROAD_CLASSES = frozenset(
    {"passenger", "private", "authority", "army", "vip", "hov", "taxi", "bus", "coach", "delivery", "truck", "trailer", "motorcycle", "moped", "evehicle",
     "custom1", "custom2", "emergency"}
)  # fmt: skip
LEAST_LENGTH = 50.0  # m of route that make an ego worth watching
PATIENCE_S = 60.0  # wall time spent on looking


class Candidate(NamedTuple):
    """A vehicle that could be an ego."""

    id: str
    vclass: str
    depart_s: float
    edges: int
    length_m: float
    suitable: bool
    why_not: str


def candidates(
    arguments: Sequence[str], count: int, enough: Callable[[Candidate], bool] | None = None, *, patience_s: float = PATIENCE_S, lasting_s: float = math.inf
) -> list[Candidate]:
    """The first `count` vehicles that depart, or fewer: all until one is `enough`, the traffic ends, or patience does (s of this clock), or so many
    seconds are simulated. Raises ConfigError."""
    found: list[Candidate] = []
    until = time.monotonic() + patience_s
    with Simulation(arguments) as simulation:
        sumo = import_libsumo()
        last = simulation.time + lasting_s
        while len(found) < count and not simulation.finished and time.monotonic() < until and simulation.time < last:
            simulation.step()
            for vehicle in sumo.simulation.getDepartedIDList():
                found.append(_look(vehicle, simulation.time))
                if enough is not None and enough(found[-1]):
                    return found
    return found[:count]


def _look(vehicle: str, now: float) -> Candidate:
    sumo = import_libsumo()
    vclass = str(sumo.vehicle.getVehicleClass(vehicle))
    route = sumo.vehicle.getRoute(vehicle)
    length = sum(float(sumo.lane.getLength(f"{edge}_0")) for edge in route)
    why_not = ""
    if vclass not in ROAD_CLASSES:
        why_not = f"class {vclass}"
    elif sumo.vehicle.getStops(vehicle, 1):
        why_not = "has stops to serve"
    elif length < LEAST_LENGTH:
        why_not = f"route shorter than {LEAST_LENGTH:g} m"
    return Candidate(vehicle, vclass, now, len(route), length, not why_not, why_not)
