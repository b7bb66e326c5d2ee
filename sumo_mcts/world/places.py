"""On which lane a vehicle is: where it overtakes through oncoming traffic SUMO names the lane of
the oncoming, and counts from its start."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.numerics.lanes import against_traffic, connection, successors
from sumo_mcts.road import RoadMap


class Place(NamedTuple):
    """Where the front of a vehicle is on its lane."""

    lane: int  # -1: on none that is known
    s: float  # m
    d: float  # m off the centre line, left positive


class Places:
    """Reads the places of vehicles."""

    def __init__(self, libsumo: Any, road: RoadMap, lanes: Mapping[str, int]) -> None:
        """`lanes`: lane id -> index."""
        self._get, self._road, self._lanes = libsumo.vehicle, road, lanes
        self._left = -1.0 if road.lefthand else 1.0  # SUMO's lateral positions grow with its lanes
        against = np.flatnonzero(against_traffic(road)).tolist()
        self._against = dict(zip(road.oncoming.tolist(), against, strict=True))
        self._of_edge = _edges_of(road)

    def of(self, vehicle: str) -> Place:
        """The place of a vehicle on the road."""
        lane = self._lanes.get(self._get.getLaneID(vehicle), -1)
        s = float(self._get.getLanePosition(vehicle))
        d = self._left * float(self._get.getLateralLanePosition(vehicle))
        if lane not in self._of_edge or self._on_route(vehicle) == self._of_edge[lane]:
            return Place(lane, s, d)
        # SUMO's drivers overtake through any junction; ways straight on are in the map
        return Place(self._against.get(lane, -1), float(self._road.length[lane]) - s, -d)

    def _on_route(self, vehicle: str) -> str:
        """The edge of its route on which a vehicle is, or from which it entered a junction."""
        route, at = self._get.getRoute(vehicle), self._get.getRouteIndex(vehicle)
        return str(route[at]) if at >= 0 else ""


def _edges_of(road: RoadMap) -> dict[int, str]:
    """The edge of each lane of oncoming traffic, as that drives it, and of each lane inside a
    junction the edge from which it is entered; empty where nobody can overtake like that."""
    found = {int(lane): road.edge_ids[road.edge[lane]] for lane in road.oncoming}
    if not found:
        return {}
    for lane in np.flatnonzero(~road.internal).tolist():
        for first in successors(road, lane):
            *inside, _ = connection(road, first)
            found.update(dict.fromkeys(inside, road.edge_ids[road.edge[lane]]))
    return found
