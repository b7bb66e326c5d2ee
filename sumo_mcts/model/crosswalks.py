"""Where an ego that stands has a crossing for people on foot under it: there they walk into it."""

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices
from sumo_mcts.model.local_map import LocalMap, State
from sumo_mcts.model.route import LIMIT, RouteMap
from sumo_mcts.numerics.kernel import kernel
from sumo_mcts.prediction.on_foot import Crossings, crossings_on
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Scene

NEAR = 20.0  # m from the middle of a crossing, beside half of its length, within which people count
AWAY = 0.5  # m before a crossing from which on the ego is in the way
GETS_ON = 0.5  # share of the limit below which an ego at the horizon may not get off the crossing

# Columns of LocalMap.crosswalk.
ON_NODE, FROM, TO = range(3)


def crosswalks(
    road: RoadMap, route: RouteMap, lanes: Indices, lane_node: Indices, scene: Scene, state: State
) -> Floats:
    """[K, 3] LocalMap.crosswalk, of the crossings of `lanes` near which there are people. One where
    people wait for the ego is left out, and one that the ego is on already: it has to get off, and
    there is nothing to choose.

    `lane_node` [L] the node of each lane of the road.
    """
    agents, length = scene.agents, scene.ego.length
    people = np.flatnonzero(agents.person)
    rows: list[tuple[float, float, float]] = []
    if not len(people):
        return np.zeros((0, 3))
    crossings = crossings_on(road, lanes)
    due = _has_people(crossings, agents.x[people], agents.y[people])
    for c in np.flatnonzero(due & ~(crossings.yields & ~crossings.cuts)):
        node, begin = int(lane_node[crossings.lane[c]]), crossings.first[c] - AWAY
        rows += _stretches(route, node, begin, crossings.last[c] + length, state)
    return np.array(rows).reshape(-1, 3)


def _stretches(
    route: RouteMap, node: int, begin: float, end: float, state: State
) -> list[tuple[float, float, float]]:
    """Rows of LocalMap.crosswalk from `begin` on `node` on, m, to `end`, which may lie on the nodes
    behind it; none where the ego is there."""
    rows = []
    while node >= 0 and end > 0.0:
        if node == state.node and begin < state.s < end:
            return []
        rows.append((float(node), begin, end))
        begin, end, node = 0.0, end - float(route.length[node]), int(route.next[node])
    return rows


def _has_people(crossings: Crossings, x: Floats, y: Floats) -> Bools:
    """[C] whether people at x, y [P] (m) are near each crossing."""
    middle = crossings.begin + 0.5 * crossings.length[:, None] * crossings.along
    away = np.hypot(x - middle[:, :1], y - middle[:, 1:])
    return np.asarray((away < NEAR + 0.5 * crossings.length[:, None]).any(axis=1))


@kernel
def stays_on_crosswalk(local: LocalMap, state: State) -> bool:
    """Whether the ego is on a crossing, and too slow to be over it soon."""
    for k in range(local.crosswalk.shape[0]):
        if local.crosswalk[k, ON_NODE] == state.node and state.v < (
            GETS_ON * local.node[state.node, LIMIT]
        ):
            if local.crosswalk[k, FROM] < state.s < local.crosswalk[k, TO]:
                return True
    return False
