"""Facts from SUMO that no sensor sees: the lanes that a vehicle is going to take, and its
leader."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from sumo_mcts.arrays import Ints
from sumo_mcts.numerics.lanes import successors
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Agents

LEADER_RANGE = 100.0  # m within which an agent's leader is asked for
BRAKING = -1.5  # m/s2: the referee asks of agents that brake harder why they do
MOST_INSIDE = 8  # internal lanes of a connection that are followed
_NO_LANES: Ints = np.zeros(0, np.int32)


class TruthReader:
    """Reads what no sensor sees."""

    def __init__(self, libsumo: Any, road: RoadMap, lanes: Mapping[str, int]) -> None:
        """`lanes`: lane id -> index."""
        self._libsumo, self._road, self._lanes = libsumo, road, lanes
        self._successors: dict[int, tuple[int, ...]] = {}  # of the lanes asked for so far

    def coming_lanes(self, vehicle: str, lane: int) -> Ints:
        """The lanes that a vehicle on `lane` takes without changing lanes, that one first; in the
        wrong lane they end where that lane does."""
        lanes = [lane]
        try:
            links = self._libsumo.vehicle.getNextLinks(vehicle)
        except self._libsumo.TraCIException:  # it is remembered, but has left
            links = ()
        for exit_id, _, _, _, via_id, *_ in links:
            onto = self._lanes.get(exit_id, -1)
            via = self._lanes.get(via_id, -1) if via_id else self._jump(lanes[-1], onto)
            for following in (*self._inside(via), onto):
                if following not in self._onto(lanes[-1]):
                    return np.array(lanes, np.int32)
                lanes.append(following)
        return np.array(lanes, np.int32)

    def why_brakes(self, agents: Agents) -> tuple[tuple[str, ...], tuple[Ints, ...]]:
        """Of each agent that brakes the leader that SUMO names, and its coming lanes; "" and no
        lanes of the others."""
        leader, paths = [""] * len(agents.ids), [_NO_LANES] * len(agents.ids)
        for i in np.flatnonzero((agents.a < BRAKING) & ~agents.person & (agents.lane >= 0)):
            found = self._libsumo.vehicle.getLeader(agents.ids[i], LEADER_RANGE)
            leader[i] = found[0] if found else ""
            paths[i] = self.coming_lanes(agents.ids[i], int(agents.lane[i]))
        return tuple(leader), tuple(paths)

    def _jump(self, lane: int, onto: int) -> int:
        """The lane that the map has for a jump from a lane onto another one, -1: none."""
        over = self._onto(lane)
        return next((i for i in over if self._road.internal[i] and onto in self._onto(i)), -1)

    def _inside(self, lane: int) -> list[int]:
        """The internal lanes of a connection, from its first one on."""
        road = self._road
        chain: list[int] = []
        while lane >= 0 and road.internal[lane] and len(chain) < MOST_INSIDE:
            chain.append(lane)
            lane = next(iter(self._onto(lane)), -1)
        return chain

    def _onto(self, lane: int) -> tuple[int, ...]:
        """The successors of a lane."""
        if lane not in self._successors:
            self._successors[lane] = tuple(successors(self._road, lane))
        return self._successors[lane]
