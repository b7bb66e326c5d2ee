"""Where the next stop of the ego ends its route."""

import numpy as np

from sumo_mcts.model.continuation import NO_HALT, Halt, Nodes
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Stop

CUT = 0.1  # m: the least length of a lane that is cut at a stop
LINE_BEYOND = 2.0  # m from the place of a stop to a line that closes the lane behind it


def halt_of(road: RoadMap, nodes: Nodes, legs: int, stop: Stop) -> Halt:
    """The node of a stop. The lanes of its edge are cut there, unless it is a waypoint that is
    passed: its own ends at a line LINE_BEYOND its place, the others at the place."""
    leg = legs - 1 - stop.after
    node = nodes.number.get((leg, stop.lane), -1) if stop.lane >= 0 else -1
    if node < 0:
        return NO_HALT
    if not stop.ends:
        return Halt(node, stop.begin, False)
    edge = (nodes.leg == leg) & ~road.internal[nodes.lane]
    nodes.length[edge] = np.minimum(nodes.length[edge], max(stop.place, CUT))
    nodes.length[node] = stop.place + LINE_BEYOND
    return Halt(node, stop.place, True)
