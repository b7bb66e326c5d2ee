"""Who walks along the ego's lanes, at their edges, and how much room that leaves the ego."""

import math

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices, Ints
from sumo_mcts.numerics.geometry import Lines, X, Y, lines_of
from sumo_mcts.numerics.kernel import entry
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Agents, EgoState

VIEW = 100.0  # m of the ego's lanes along which people count
ALONG = 0.9  # cosine of the angle to the lane up to which one walks along it
JOINT = 1.0  # m beyond a straight piece of a lane, where it bends, that count to it
FAR = 6.0  # m from the middle of a lane from which on nobody walks along it


def room_beside(road: RoadMap, lanes: Ints, ego: EgoState, agents: Agents) -> Floats:
    """[N] m between the ego's side and who walks along its `lanes` [K], where the ego is in their
    middle.

    It is inf of all others: of who walks across, of who is in a junction, where people turn, and of
    who is in the ego's way.
    """
    room = np.full(len(agents.ids), np.inf)
    people = np.flatnonzero(agents.person)
    if len(people):
        heading = np.column_stack([np.cos(agents.heading), np.sin(agents.heading)])
        where = np.column_stack([agents.x, agents.y])
        _fill_room(
            room, people, where, heading,
            0.5 * np.maximum(agents.length, agents.width), lines_of(road), lanes,
            road.junction[lanes] >= 0, ego.s, 0.5 * ego.width,
        )  # fmt: skip
    return room


@entry
def _fill_room(
    room: Floats, people: Indices, where: Floats, heading: Floats, half: Floats,
    lines: Lines, lanes: Ints, inside: Bools, ego_s: float, ego_half: float,
) -> None:  # fmt: skip
    """Fill `room` [N], which is inf before; `where` and `heading` [N, 2]."""
    for i in people:
        nearest, driven = FAR, -ego_s
        for k in range(len(lanes)):
            first, last = lines.first[lanes[k]], lines.first[lanes[k] + 1]
            if driven > VIEW:
                break
            driven += lines.arc[last - 1]
            for p in range(first, last - 1):
                dx = lines.points[p + 1, X] - lines.points[p, X]
                dy = lines.points[p + 1, Y] - lines.points[p, Y]
                length = max(math.sqrt(dx * dx + dy * dy), 1e-9)
                cs, sn = dx / length, dy / length
                to_x, to_y = where[i, X] - lines.points[p, X], where[i, Y] - lines.points[p, Y]
                along, off = to_x * cs + to_y * sn, abs(to_y * cs - to_x * sn)
                if off >= nearest or not -JOINT <= along <= length + JOINT:
                    continue
                nearest = off
                turned = abs(heading[i, X] * cs + heading[i, Y] * sn)
                beside = off - ego_half - half[i]
                goes_along = turned > ALONG and not inside[k]
                room[i] = beside if goes_along and beside > 0.0 else math.inf
