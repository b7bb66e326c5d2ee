"""Which vehicles of a user's simulation could be an ego: found by running it for a while with SUMO
alone. It also finds names that are in no file."""

import math
import re
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from sumo_mcts import files
from sumo_mcts.errors import ConfigError, near
from sumo_mcts.world.library import running_sumo
from sumo_mcts.world.simulation import Simulation, named_files, option

ROAD_CLASSES = frozenset(
    {"passenger", "private", "authority", "army", "vip", "hov", "taxi", "bus", "coach", "delivery",
    "truck", "trailer", "motorcycle", "moped", "evehicle",
     "custom1", "custom2", "emergency"}
)  # fmt: skip
LEAST_LENGTH = 50.0  # least length of an ego's route, m
PATIENCE_S = 60.0  # wall time spent on looking
NAMED = 5  # vehicles that a message names
MOST_READ = 200_000_000  # bytes of files that are looked through for a name: some 2 s

# Options with the files that name vehicles.
_SOURCES = ("route-files", "additional-files", "load-state")
_ID = re.compile(rb"""\bid\s*=\s*(?:"([^"]*)"|'([^']*)')""")
# What SUMO puts between an id and a number: for vehicles of a flow, a person's car, by --scale.
_MADE = re.compile(r"[._]")


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
    arguments: Sequence[str], count: int, enough: Callable[[Candidate], bool] | None = None, *,
    until: str | None = None, patience_s: float = PATIENCE_S,
    lasting_s: float = math.inf,
) -> list[Candidate]:  # fmt: skip
    """The first `count` vehicles that depart, or fewer.

    Fewer where one is `enough`, the traffic ends, SUMO's option `end` comes, `patience_s` of wall
    time is over, or `lasting_s` are simulated. `until`: the edge that the route of a suitable one
    has to pass. Raises ConfigError.
    """
    found: list[Candidate] = []
    give_up = time.monotonic() + patience_s
    with closing(Simulation(arguments)) as simulation:
        sumo = running_sumo()
        last = min(simulation.time + lasting_s, simulation.end)
        while (
            len(found) < count
            and not simulation.finished
            and time.monotonic() < give_up
            and simulation.time < last
        ):
            simulation.step()
            for vehicle in sumo.simulation.getDepartedIDList():
                found.append(_look(vehicle, float(sumo.vehicle.getDeparture(vehicle)), until))
                if enough is not None and enough(found[-1]):
                    return found
    return found[:count]


def require_named(key: str, vehicles: Iterable[str], others: Iterable[str]) -> None:
    """Raise ConfigError where the running simulation cannot have one of the vehicles.

    It can if the vehicle is one of `others`, those of the scenario. It can if the simulation's
    files hold its id, or an id from which SUMO may make it. Whether it departs is another question.
    `key`: where the scenario names the vehicles.
    """
    in_files = _ids_in_files()
    if in_files is None:
        return
    known = in_files.union(others)
    for vehicle in vehicles:
        if known.isdisjoint({vehicle, *(vehicle[: at.start()] for at in _MADE.finditer(vehicle))}):
            like = near_ids(vehicle, others)
            of_file = option("configuration-file")
            listed = (
                f"; `sumo-mcts run {of_file}` lists candidates"
                if of_file
                else f"; the scenario's own: {', '.join(others)}"
                if others
                else ""
            )
            raise ConfigError(
                f"{key}: {vehicle}: no file of the simulation names such a vehicle"
                + (f"; near: {', '.join(like)}" if like else listed)
            )


def near_ids(vehicle: str, others: Iterable[str]) -> list[str]:
    """The ids among `others` and in the files of the running simulation that are similar to the
    vehicle's; the most similar first."""
    return near(vehicle, sorted((_ids_in_files() or frozenset()).union(others)), NAMED)


def _ids_in_files() -> frozenset[str] | None:
    """Every id in the files that the running simulation reads; None where these are too large, or
    not all can be read."""
    paths = [path for name in _SOURCES for path in named_files(name)]
    if any(map(files.problem, paths)) or sum(path.stat().st_size for path in paths) > MOST_READ:
        return None
    found = [_ids_in(path, path.stat().st_mtime_ns) for path in paths]
    return None if None in found else frozenset().union(*(ids for ids in found if ids is not None))


@lru_cache(maxsize=32)
def _ids_in(path: Path, changed: int) -> frozenset[str] | None:
    """Every id in a file of SUMO's, whatever it names; None where it is too large, or includes
    another file.

    `changed`: when the file was, for the cache.
    """
    try:
        text = files.beginning(path, MOST_READ + 1)
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from None
    if len(text) > MOST_READ or b"<include" in text:
        return None
    return frozenset(
        (double or single).decode(errors="replace") for double, single in _ID.findall(text)
    )


def not_passing(until: str) -> str:
    """Why a vehicle is not suitable that does not come to an edge."""
    return f"its route does not pass edge {until}"


def _look(vehicle: str, now: float, until: str | None) -> Candidate:
    """The vehicle, which departed at `now` (s), as a candidate."""
    sumo = running_sumo()
    vclass = str(sumo.vehicle.getVehicleClass(vehicle))
    route = sumo.vehicle.getRoute(vehicle)
    length = sum(float(sumo.lane.getLength(f"{edge}_0")) for edge in route)
    why_not = ""
    if until is not None and until not in route:
        why_not = not_passing(until)
    elif vclass not in ROAD_CLASSES:
        why_not = f"class {vclass}"
    elif sumo.vehicle.getStops(vehicle, 1):
        why_not = "has stops to serve"
    elif length < LEAST_LENGTH:
        why_not = f"route shorter than {LEAST_LENGTH:g} m"
    return Candidate(
        id=vehicle,
        vclass=vclass,
        depart_s=now,
        edges=len(route),
        length_m=length,
        suitable=not why_not,
        why_not=why_not,
    )
