"""Other ways for a vehicle to where it has to go: SUMO's router finds them, SUMO takes them on."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from sumo_mcts.world.library import running_sumo


class Way(NamedTuple):
    """A way that SUMO's router found."""

    edges: tuple[str, ...]
    seconds: float  # of driving it, as the router expects now


def ways(vehicle: str, onto: Iterable[str], goal: str) -> list[Way]:
    """The quickest way for the vehicle from each of the edges `onto` to the edge `goal`, both with
    it; those from where no way leads there are left out.

    Closed edges and the vehicle's class count as they are now.
    """
    sumo = running_sumo()
    kind = sumo.vehicle.getTypeID(vehicle)
    found = [(edge, sumo.simulation.findRoute(edge, goal, kind)) for edge in onto]
    return [Way(tuple(f.edges), float(f.travelTime)) for edge, f in found if f.edges]


def take(vehicle: str, edges: Sequence[str]) -> bool:
    """Give the vehicle this route, from its present edge on; whether SUMO accepts it.

    Else it keeps its own.
    """
    sumo = running_sumo()
    try:
        sumo.vehicle.setRoute(vehicle, list(edges))
    except sumo.TraCIException:
        return False
    return True


def stop_edges(vehicle: str) -> list[str]:
    """The edges at which the vehicle still has to stop, in order.

    SUMO drops a stop without a word where a new route leaves its edge out.
    """
    get = running_sumo().vehicle
    # the lane of a stop is "" where it was given by its edge
    count = len(get.getStops(vehicle))
    return [get.getStopParameter(vehicle, i, "edge") for i in range(count)]
