"""What the search reads in one cycle: the route's lanes, the coming signals and the forecast, in
one tuple of arrays."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.model.route import LENGTH, RouteMap, lane_pose
from sumo_mcts.numerics.kernel import kernel
from sumo_mcts.scene import EgoState, Floats, Indices

GONE = -2  # Local.agent's NODE of an agent that is not there
UPSTREAM = (
    -3
)  # ... and UPSTREAM - n of one that comes to node n from a lane beside the route: see upstream_of


class LocalMap(NamedTuple):
    """What compiled code reads.

    W window nodes from `first` on; T forecast times; N agents. Few arrays: each costs at every
    call.
    """

    node: Floats  # RouteMap.table, of the whole route
    row: Floats  # RouteMap.rows
    closed: NDArray[np.uint8]  # [W, T] the stop line at the node's end may not be crossed
    level: Indices  # [W, K] how the ego's lanes meet those that agents drive (see _levels)
    # [T, N] 8 times the agent's column of level, and which knots are near; negative off the road
    place: Indices
    # [W, W] m from the start of a node to the start of another one down its chain; inf: not on it
    ahead: Floats
    urgency: Floats  # [W] -3..3, lane changes needed (positive: to the left) and how soon
    agent: Floats  # [T, N, 8] X .. DRIVEN below: a row is a cache line
    trait: Floats  # [N, 9] HALF_LENGTH .. GOES_ROUND below
    # [T, N, 4] least and greatest x, least and greatest y of what counts of an agent's box: just
    # before, then, and in what it claims
    reach: Floats
    # [K, 5] NODE_OF .. MERGES below: where an agent is going to use a stretch of a junction that
    # the ego has to leave to it
    duty: Floats
    first: int  # first node of the window
    limit: float  # speed limit where the ego is now, m/s
    # mean speed of the others around the ego in the lanes that the route goes on in, m/s; where
    # there is nobody, their limit
    pace: float
    free: bool  # no light that stays red and no dead end ahead of the ego, as far as it could come
    # m along the route (STATION) where the next stop line is if it is that of a stop sign at which
    # the ego has still to stand; else inf
    stop_at: float
    # bit mask (trait BIT) of the agents that are behind the ego in its lane and react: their
    # contact is imposed braking
    followers: int
    # m to the side that a lane change keeps clear, since it may come out a little otherwise than
    # planned
    aside: float
    dt: float  # s between forecast times


# Columns of Local.agent: pose, speed, route node of the front (-1: elsewhere, GONE, from UPSTREAM
# downwards: on the way to one), lane position there (on the
# way: negative), m driven from now on.
X, Y, COS, SIN, V, NODE, S, DRIVEN = range(8)

# Columns of Local.trait: half sizes in m; 1 where the agent brakes for an ego in front of it; 1
# where it lets the ego pass;
# its row among those that the search moves (model/react.py), -1: the table has it; the node of the
# lane beside into which its box reaches while it changes lanes (-1: none), and the last forecast
# time at which it does; its bit among the followers, -1: it is too far away to be one; and 1 where
# it is on foot and walks round the ego, which crawls at most, once it stands.
HALF_LENGTH, HALF_WIDTH, REACTS, POLITE, SLOT, BESIDE, UNTIL, BIT, GOES_ROUND = range(9)

# Columns of Local.duty: the ego's node, where the stretch ends on it, the agent, what the agent
# drives until it enters the stretch (m), and 1 where both lead into the same lane.
NODE_OF, STRETCH_END, WHO, ENTERS, MERGES = range(5)

# Columns of Local.reach.
WEST, EAST, SOUTH, NORTH = range(4)
CLAIM_SAMPLES = 2  # how often an agent's way ahead is looked at
LATE = 0.4  # s that an agent may come later than its forecast


class State(NamedTuple):
    """The ego in the tree."""

    node: int  # lane of its front
    s: float
    v: float
    a: float
    progress: float  # of a lane change, 0 none; in the second half `node` is already the target
    other: int  # the other lane of the change
    # rad between its box and the lane, to the left: in a lane change the rear follows the front,
    # also when the change is over
    turn: float


def ego_state(route: RouteMap, ego: EgoState) -> State | None:
    """Where the ego stands on its route, None if it is on none of the route's lanes."""
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


@kernel
def upstream_of(node: int) -> int:
    """The node that an agent comes to from a lane beside the route; -1: it does not, or is on the
    route."""
    return UPSTREAM - node if node <= UPSTREAM else -1


@kernel
def apart(local: LocalMap, node: int, s: float, length: float, at: int, i: int) -> bool:
    """Whether the ego (its front at s on `node`, its length in m) and agent i, where it is at
    forecast time `at`, are on different levels."""
    w, place = node - local.first, local.place[at, i]
    if place < 0 or w < 0 or w >= local.level.shape[0]:
        return False
    level, theirs = local.level[w, place >> 3], place & 7
    if level & theirs != 0:
        return False
    if (level >> 3) & theirs != 0 and local.node[node, LENGTH] - s < NEARBY + length:
        return False
    return (level >> 6) & theirs == 0 or s >= NEARBY + length


@kernel
def follows(local: LocalMap, followers: int, i: int) -> bool:
    """Whether agent i is one of the `followers`, a bit mask."""
    bit = int(local.trait[i, BIT])
    return bit >= 0 and (followers >> bit) & 1 > 0


@kernel
def keep_state(where: Indices, motion: Floats, i: int, state: State) -> None:
    """Write a state into row i of `where` [M, 2] (node, other) and `motion` [M, 5] (s, v, a,
    progress, turn)."""
    where[i, 0], where[i, 1] = state.node, state.other
    motion[i, 0], motion[i, 1], motion[i, 2], motion[i, 3], motion[i, 4] = (
        state.s,
        state.v,
        state.a,
        state.progress,
        state.turn,
    )


@kernel
def kept_state(where: Indices, motion: Floats, i: int) -> State:
    """The state in row i."""
    return State(
        where[i, 0],
        motion[i, 0],
        motion[i, 1],
        motion[i, 2],
        motion[i, 3],
        where[i, 1],
        motion[i, 4],
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


NEARBY = 10.0  # m beside its length within which a vehicle is near a knot
TURNED = (
    0.035  # rad between box and lane from which it is no longer a matter of how curves are drawn
)


def node_at(route: RouteMap, lane: int, first: int) -> int:
    found = np.flatnonzero(route.lane[first:] == lane)
    return first + int(found[0]) if len(found) else -1
