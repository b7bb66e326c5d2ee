"""The network as all packages see it: plain tuples of arrays, no behaviour.

Units, indices and lane positions as in scene.py. Maps are stored under the names of these fields.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.arrays import Bools, Floats, Ints, Words

# Bit i of RoadMap.classes, and index i of `vclass`, is this class.
VEHICLE_CLASSES = (
    "passenger", "private", "emergency", "authority", "army", "vip", "hov", "taxi", "bus", "coach",
    "delivery", "truck", "trailer", "motorcycle", "moped", "bicycle", "evehicle", "pedestrian",
    "tram", "rail_urban", "rail", "rail_electric", "rail_fast", "ship", "custom1", "custom2",
    "subway", "cable_car", "container", "aircraft", "wheelchair", "scooter", "drone",
)  # fmt: skip
IGNORING = -1  # the class of vehicles that may drive anywhere

# How a connection is entered (RoadMap.rule), in the order of growing obligation to yield.
PRIORITY, YIELD, ZIPPER, STOP, ALLWAY = range(5)
# The same for a crossing: people go first, or let vehicles pass.
PEOPLE_FIRST, PEOPLE_WAIT = 5, 6

# Where a connection leads (RoadMap.direction).
STRAIGHT, LEFT, RIGHT, TURN = range(4)  # TURN: it turns round

# m: the length of a lane inside a junction where the network has none and vehicles jump over it.
# No real one is that short.
JUMP = 0.01

LEAST_SPEED = 0.1  # m/s: the lowest limit of a lane in a map; lanes below are closed to all


class RoadMap(NamedTuple):
    """One network, lane by lane.

    L lanes (internal ones too), P shape points, S successor entries, C conflict entries. Internal
    lanes lie inside junctions; a connection leads over one or several of them.
    """

    lane_ids: tuple[str, ...]  # [L]
    edge_ids: tuple[str, ...]
    junction_ids: tuple[str, ...]
    signal_ids: tuple[str, ...]
    lefthand: bool  # traffic drives on the left: SUMO then counts lanes from the left

    # Each lane.
    edge: Ints  # [L] index into edge_ids
    index: Ints  # type: ignore[assignment]  # [L] position within the edge from the right, 0 = rightmost (tuple.index is not missed)
    internal: Bools  # [L] inside a junction
    length: Floats  # [L] SUMO's lane length, m
    scale: Floats  # [L] m of the shape for each metre of the lane
    width: Floats  # [L] m
    speed: Floats  # [L] limit, m/s
    classes: NDArray[np.uint64]  # [L] bit i set: vehicle class i (VEHICLE_CLASSES) may drive here
    # [L] likewise, which classes may change from here to the left, and to the right
    change_left: NDArray[np.uint64]
    change_right: NDArray[np.uint64]
    # Limits that single vehicle classes have instead of `speed`: the row of each class, -1 none
    class_row: Ints  # [classes]
    class_speed: Floats  # [R, L] m/s
    left: Ints  # [L] neighbour on the same edge, -1 none
    right: Ints  # [L] the same to the right

    # Centre lines.
    point_offset: Ints  # [L+1] lane i owns points point_offset[i]:point_offset[i+1]
    points: Floats  # [P, 2] x and y, m
    point_s: Floats  # [P] arc length along the shape, m

    # How lanes go on.
    successor_offset: Ints  # [L+1] lane i owns successor[successor_offset[i]:...[i+1]]
    successor: Ints  # [S] the lane driven next (internal where the connection has one)
    exit: Ints  # [L] internal lanes: the ordinary lane that they end in; others: themselves
    # [L] internal lanes: STRAIGHT, LEFT, RIGHT or TURN of their connection; others: STRAIGHT
    direction: Ints

    # Junctions. A cluster is junctions with nothing but short lanes between them.
    junction: Ints  # [L] internal lanes: index into junction_ids; others: -1
    knot: Ints  # [L] the junction cluster that the lane lies in, -1 none
    begins: Ints  # [L] the junction cluster where it begins, -1 none
    ends: Ints  # [L] the junction cluster where it ends, -1 none

    # Right of way, at internal lanes that start a connection, and at crossings.
    rule: Ints  # [L] how it is entered, PRIORITY .. PEOPLE_WAIT; others: PRIORITY
    signal: Ints  # [L] index into signal_ids, -1 none
    link: Ints  # [L] index of its link in that signal's state, -1 none

    # Conflict areas: the stretches that two internal lanes share.
    conflict_offset: Ints  # [L+1] lane i owns conflict_offset[i]:conflict_offset[i+1]
    conflict_lane: Ints  # [C] the other lane
    conflict_begin: Floats  # [C] the shared stretch, in positions of this lane, m
    conflict_end: Floats  # [C]
    conflict_other_begin: Floats  # [C] the same stretch in positions of the other lane, m
    conflict_other_end: Floats  # [C]
    conflict_merge: Bools  # [C] both lanes lead into the same lane
    conflict_yields: Bools  # [C] traffic on this lane must let the other pass

    # The last V lanes are lanes of oncoming traffic, as who overtakes there drives them: beside the
    # lane in the middle of the road, of its edge, and leading nowhere but straight through
    # junctions into the next such lane. [V] which lanes those are for the oncoming.
    oncoming: Ints = np.zeros(0, np.int32)


class RoadChanges(NamedTuple):
    """What the simulation has changed of C lanes of a RoadMap: its columns as they are now."""

    lane: Ints = np.zeros(0, np.int32)  # [C] in rising order
    speed: Floats = np.zeros(0)  # [C]
    classes: Words = np.zeros(0, np.uint64)  # [C]
    change_left: Words = np.zeros(0, np.uint64)  # [C]
    change_right: Words = np.zeros(0, np.uint64)  # [C]
