"""What the search reads in one cycle: the route's lanes, the coming signals and the forecast, in
one tuple of arrays."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.arrays import Floats, Indices
from sumo_mcts.model.caps import SPACING
from sumo_mcts.model.route import (
    DRAWN,
    FIRST_ROW,
    LAST_ROW,
    LENGTH,
    REACH,
    RouteMap,
    lane_pose,
)
from sumo_mcts.numerics.drawn import as_drawn
from sumo_mcts.numerics.geometry import Box, boxes_touch
from sumo_mcts.numerics.kernel import inlined, kernel
from sumo_mcts.scene import EgoState

# What column NODE of LocalMap.agent holds beside nodes; node_of, upstream_of and is_gone read it.
ELSEWHERE = -1  # off the ego's route
GONE = -2  # not there any more
UPSTREAM = -3  # and below: UPSTREAM - n on the path to node n, on a lane that leads into the route


class LocalMap(NamedTuple):
    """What compiled code reads.

    W window nodes from `first` on; T forecast times; N agents; K whatever the field says. Few
    arrays: each costs at every call.
    """

    node: Floats  # RouteMap.table, of the whole route
    row: Floats  # RouteMap.rows
    closed: NDArray[np.uint8]  # [W, T] the stop line at the node's end may not be crossed
    # [W, 2] s from now at which the green light at the node's end turns yellow, and yellow ends;
    # inf: it does not, as far as known
    yellow: Floats
    # [W, K] how the ego's lanes meet those that agents drive: bits by INSIDE, ENDS, BEGINS below
    # (see local_agents.levels)
    level: Indices
    # [T, N] the agent's column of level, shifted by KINDS, and KINDS bits: near which junction
    # clusters of its lane it is; negative off the road
    place: Indices
    # [W, W] m from the start of a node to the start of another one down its chain; inf: not on it
    ahead: Floats
    urgency: Floats  # [W] -3..3, lane changes needed (positive: to the left) and how soon
    agent: Floats  # [T, N, 8] X .. DRIVEN below: a row is a cache line
    # [T, N] the share of its length to which an agent is drawn; [0, 0]: all are drawn in full
    drawn: Floats
    trait: Floats  # [N, 12] HALF_LENGTH .. SIDEWAYS_UNTIL below
    # [T, N, 4] WEST .. NORTH: bounds of an agent's box at that time and LATE earlier, and of its
    # predicted occupancy; with a margin where it moves sideways (model/nearing.py)
    bounds: Floats
    # [K, 8] OWN_NODE .. PAST below: stretches of a junction that an agent is going to use and
    # that the ego has to leave to it, and lanes of oncoming traffic likewise
    obligation: Floats
    # [K, 3] ON_NODE .. TO of model/crosswalks.py: the ego's node, and from where to where its front
    # is while its body is on a crossing for people on foot, m
    crosswalk: Floats
    # [G, .] NEXT_GATE .. CLOSES below: places ahead where the ego may have to wait
    gate: Floats
    to_gate: Floats  # [W, 7] GATE .. SPREAD below
    to_leave: Floats  # [W, 4] STREAM .. ONCOMING below
    first: int  # first node of the window
    limit: float  # speed limit where the ego is now, m/s
    # mean speed of the others near the ego in the lanes in which the route goes on, m/s; without
    # others the limit of these lanes
    target_lane_speed: float
    # no light that stays red, and no end of the road, within the distance that the ego could drive
    open_ahead: bool
    # m along the route (STATION) of the next stop line, if it has a stop sign at which the ego has
    # not stood yet, or is that of a stop to be served; else inf
    stop_at: float
    stands_before: float  # m before that line: the place to stand
    near_stop: float  # m before that place over which the cost of lost time falls to 0
    # bit mask (trait BIT) of the agents that are behind the ego in its lane and react: their
    # contact is imposed braking
    followers: int
    stop_decel: float  # m/s2 of braking beyond which a yellow light is passed
    # m between the ego and the middle of the lane that it changes to within which drivers there see
    # it; inf: from the beginning
    seen_within: float
    # m to the side that a lane change keeps clear, since it may differ a little from its plan
    aside: float
    # share of its price that comfortable braking of others costs an ego that has waited for a gap
    patience: float
    asked: int  # the side on which the ego asks for room: 1 left, -1 right, 0 neither
    committed: bool  # the ego is in a lane of oncoming traffic, or changes to one, when it decides
    stuck: float  # 1 where only a lane of oncoming traffic leads past a slow leader, else 0
    # The agent that starts in this hypothesis though it has stood for a while; -1: none. It looks
    # first: the search moves it, and it waits for an ego that is in its way before it is there,
    # whoever has the right of way.
    starts: int
    dt: float  # s between forecast times


# The kinds of junction clusters of a lane: the one it lies in, where it ends, where it begins. And
# the first bit of each kind in LocalMap.level.
KINDS = 3
INSIDE, ENDS, BEGINS = 0, KINDS, 2 * KINDS

# Columns of LocalMap.agent after those of the pose. V: speed, m/s. NODE: the lane of the front (see
# above). S: lane position there, m, negative upstream of the node. DRIVEN: m from now on.
V, NODE, S, DRIVEN = range(4, 8)

# Columns of LocalMap.trait:
#   HALF_LENGTH, HALF_WIDTH  m
#   REACTS      1 where the agent brakes for an ego in front of it
#   POLITE      1 where it lets the ego pass
#   SLOT        its row among those that the search moves (model/reactions.py); -1: the forecast
#               has it
#   BESIDE      the node of the lane beside into which its box reaches while it changes lanes; -1:
#               none
#   UNTIL       the last forecast time at which it does
#   BIT         its bit among the followers; -1: it is too far away to be one
#   ON_FOOT     1 where it is a person
#   GOES_ROUND  1 where it is one that walks round the ego once the ego stands
#   OWED        the row of LocalMap.obligation at whose kerb it may wait for the ego; -1: none
#   SIDEWAYS_UNTIL  the last forecast time at which it moves sideways in its lane; -1: it does not
(
    HALF_LENGTH, HALF_WIDTH, REACTS, POLITE, SLOT, BESIDE, UNTIL, BIT, ON_FOOT, GOES_ROUND, OWED,
    SIDEWAYS_UNTIL,
) = range(12)  # fmt: skip

# Columns of LocalMap.obligation: the ego's node; from where on it the ego's front is in the way, m;
# where the stretch ends, m; the agent; m that it drives or walks until it enters the stretch; one
# of the kinds below. Of a person who has to let vehicles pass and is not on the crossing yet: m
# that it walks to the kerb, and from there until it is past the ego's way; else 0.
OWN_NODE, OWED_FROM, STRETCH_END, AGENT, ENTERS, MERGES, KERB, PAST = range(8)
# Kinds of obligations. 0: the paths cross; ONTO: both lead into the same lane. HEAD_ON: the agent
# comes towards the ego on the node, ENTERS is m until it leaves it; UNSEEN likewise. Of people on a
# crossing where they have to let vehicles pass, WALKS: it comes over it; IN_WAY: it is on the ego's
# part of it, from KERB m on, ENTERS is m until it has left that. On the node behind a junction over
# which vehicles jump (STRETCH_END: the way that was jumped), JUMPS: the paths cross; JOINS: both
# lead onto the node.
ONTO, HEAD_ON, UNSEEN, WALKS, IN_WAY, JUMPS, JOINS = range(1, 8)

# Columns of the array that holds the agents that the search moves (model/reactions.py). CLOCK:
# forecast index (with fraction) of the place that the agent has reached; its delay at index t is
# t - CLOCK. SPEED: m/s.
CLOCK, SPEED = range(2)

# Columns of LocalMap.gate (model/cost_to_go.py): the gate after it, -1: none; s of free driving
# there; its node, counted from `first`; the sure gate after it, likewise SURE .. SPREAD below; s
# until the streams that it yields to have a gap; s until they end; then OPENINGS pairs of times (s
# from now) at which it opens and closes, inf: none.
(
    NEXT_GATE, NEXT_FREE_S, LINE, SURE_NEXT, SURE_LATEST, SURE_SPREAD, GAP_S, STREAM_S, OPENS,
    CLOSES,
) = range(10)  # fmt: skip
OPENINGS = 4
# Columns of LocalMap.to_gate: the next gate, -1: none; s of free driving and m to it from the
# start of the node; the node whose lane the ego needs there. The next gate on whatever lanes the
# ego drives there (model/least_cost.py), -1: none; s of free driving to it at most; by how much
# less it may be.
GATE, FREE_S, AWAY, QUEUE, SURE, LATEST, SPREAD = range(7)

# Columns of LocalMap.to_leave (model/leaving.py), of a lane that the route leaves: m/s of the
# stream in the next lane, and vehicles a metre there, 0 of other lanes; m from the start of the
# node to where the ego has to have left it, inf: never; and 1 of a lane of oncoming traffic.
STREAM, DENSITY, END, ONCOMING = range(4)

# Columns of LocalMap.bounds, m.
WEST, EAST, SOUTH, NORTH = range(4)
OCCUPANCY_SAMPLES = 2  # points of an agent's path ahead that are checked
LATE = 0.4  # s that an agent may come later than its forecast

# Columns of the arrays that states are kept in (keep_state).
WHERE_NODE, WHERE_OTHER = range(2)
MOTION_S, MOTION_V, MOTION_A, MOTION_PROGRESS, MOTION_TURN = range(5)

NEARBY = 10.0  # m beside its length within which a vehicle is near a junction cluster
# rad between box and lane; smaller angles may come from the polylines of curves
TURNED = 0.035


class State(NamedTuple):
    """The ego in the tree."""

    node: int  # lane of its front
    s: float
    v: float
    a: float
    progress: float  # of a lane change, 0 none; in the second half `node` is already the target
    other: int  # the other lane of the change
    # rad between its box and the lane, left positive: in a lane change the rear follows the front,
    # even after the end of the change
    turn: float


def ego_state(route: RouteMap, ego: EgoState) -> State | None:
    """Where the ego stands on its route, None if it is on none of the route's lanes."""
    if not len(route.leg):  # all lanes are closed to its class
        return None
    leg = int(route.leg[-1]) + 1 - len(ego.route)
    first = int(np.searchsorted(route.leg, leg))
    node = node_at(route, ego.lane, first)
    if node < 0:
        return None
    other = -1
    if ego.changing > 0.0:
        other = node_at(route, ego.change_from if ego.changing >= 0.5 else ego.change_to, first)
    _, _, c, n = lane_pose(route.table, route.rows, node, ego.s)
    turn = math.remainder(ego.heading - math.atan2(n, c), 2.0 * math.pi)
    turn = turn if abs(turn) > TURNED else 0.0
    return State(node, ego.s, ego.v, ego.a, ego.changing if other >= 0 else 0.0, other, turn)


@inlined
def node_of(local: LocalMap, at: int, i: int) -> int:
    """The route's node on which agent i is at forecast time `at`; negative where it is on none:
    ELSEWHERE, GONE, or upstream of one."""
    return int(local.agent[at, i, NODE])


@inlined
def upstream_of(local: LocalMap, at: int, i: int) -> int:
    """The node that agent i comes to from a lane beside the route; -1: it does not, or is on the
    route."""
    node = node_of(local, at, i)
    return UPSTREAM - node if node <= UPSTREAM else -1


@inlined
def is_gone(local: LocalMap, at: int, i: int) -> bool:
    """Whether agent i is not there any more."""
    return local.agent[at, i, NODE] == GONE


@kernel
def on_other_level(local: LocalMap, node: int, s: float, length: float, at: int, i: int) -> bool:
    """Whether the ego (its front at s on `node`, its length in m) and agent i, where it is at
    forecast time `at`, are on different levels."""
    w, place = node - local.first, local.place[at, i]
    if place < 0 or w < 0 or w >= local.level.shape[0]:
        return False
    level, theirs = local.level[w, place >> KINDS], place & ((1 << KINDS) - 1)
    if (level >> INSIDE) & theirs != 0:
        return False
    if (level >> ENDS) & theirs != 0 and local.node[node, LENGTH] - s < NEARBY + length:
        return False
    return (level >> BEGINS) & theirs == 0 or s >= NEARBY + length


@kernel
def to_end(local: LocalMap, state: State) -> float:
    """m until the ego has to have left its lane; inf: never, as far as known.

    What stands in the lane ends it only for those who come to it, not for those who are past it.
    """
    i = state.node - local.first
    end = local.to_leave[i, END] if 0 <= i < local.to_leave.shape[0] else -math.inf
    return float(end if end >= state.s else local.node[state.node, REACH]) - state.s


@kernel
def urgency_at(local: LocalMap, state: State) -> float:
    """LocalMap.urgency where the ego is in `state`: 0 beyond the lanes that this cycle looks at,
    and past what stands in its lane."""
    i = state.node - local.first
    if not 0 <= i < local.urgency.shape[0] or local.to_leave[i, END] < state.s:
        return 0.0
    return float(local.urgency[i])


@kernel
def boxes_meet(
    local: LocalMap, node: int, s: float, half: float, box: Box, other: Box, at: int, i: int
) -> bool:
    """Whether the ego's box meets that of agent i, as the network is drawn.

    The ego's front is at s (m) on `node`, half its length is `half` (m); the agent is where it is
    at forecast time `at`. Either box may be longer than the body, at both ends.
    """
    if not boxes_touch(box, other):
        return False
    if local.drawn.shape[0] == 0:
        return True
    return boxes_touch(
        as_drawn(box, drawn_share(local, node, s), half),
        as_drawn(other, local.drawn[at, i], local.trait[i, HALF_LENGTH]),
    )


@kernel
def drawn_share(local: LocalMap, node: int, s: float) -> float:
    """The share of its length to which the ego is drawn, its front at s (m) on `node`."""
    row = int(local.node[node, FIRST_ROW]) + int(max(s, 0.0) / SPACING)
    return float(local.row[min(row, int(local.node[node, LAST_ROW])), DRAWN])


@kernel
def between(local: LocalMap, i: int, clock: float, column: int) -> float:
    """A column of agent i between two forecast times, at index `clock` (with fraction)."""
    k = min(int(clock), local.agent.shape[0] - 2)
    return float(
        local.agent[k, i, column]
        + (clock - k) * (local.agent[k + 1, i, column] - local.agent[k, i, column])
    )


@kernel
def follows(local: LocalMap, followers: int, i: int) -> bool:
    """Whether agent i is one of the `followers`, a bit mask."""
    bit = int(local.trait[i, BIT])
    return bit >= 0 and (followers >> bit) & 1 > 0


@kernel
def keep_state(where: Indices, motion: Floats, i: int, state: State) -> None:
    """Write a state into row i of `where` [M, 2] (WHERE_NODE, WHERE_OTHER) and `motion` [M, 5]
    (MOTION_S .. MOTION_TURN)."""
    where[i, WHERE_NODE], where[i, WHERE_OTHER] = state.node, state.other
    motion[i, MOTION_S], motion[i, MOTION_V], motion[i, MOTION_A] = state.s, state.v, state.a
    motion[i, MOTION_PROGRESS], motion[i, MOTION_TURN] = state.progress, state.turn


@kernel
def kept_state(where: Indices, motion: Floats, i: int) -> State:
    """The state in row i."""
    return State(
        where[i, WHERE_NODE],
        motion[i, MOTION_S],
        motion[i, MOTION_V],
        motion[i, MOTION_A],
        motion[i, MOTION_PROGRESS],
        where[i, WHERE_OTHER],
        motion[i, MOTION_TURN],
    )


@kernel
def index_at(local: LocalMap, time: float) -> int:
    """The forecast time nearest to `time` (s from now); it may lie beyond the last one."""
    return int(time / local.dt + 0.5)


@kernel
def chain_gap(local: LocalMap, node: int, s: float, other_node: int, other_s: float) -> float:
    """m from (node, s) forward along the lane's chain to (other_node, other_s); inf where that is
    not on it."""
    i, j = node - local.first, other_node - local.first
    w = local.ahead.shape[0]
    if i < 0 or j < 0 or i >= w or j >= w:
        return math.inf
    return float(local.ahead[i, j]) + other_s - s


def node_at(route: RouteMap, lane: int, first: int) -> int:
    found = np.flatnonzero(route.lane[first:] == lane)
    return first + int(found[0]) if len(found) else -1
