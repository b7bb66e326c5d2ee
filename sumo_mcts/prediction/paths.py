"""Which lanes the others will drive: the turn that their signals announce, else straight on, else
the first connection."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.arrays import Floats, Ints
from sumo_mcts.numerics.kernel import entry, inlined, kernel
from sumo_mcts.numerics.lanes import Ahead, ahead_of, limits, of_class
from sumo_mcts.road import LEFT, RIGHT, STRAIGHT, RoadMap
from sumo_mcts.scene import Agents, EgoState

LANES = 20  # lanes of a path at most
PATH = 200.0  # m of a path at least, as far as the road goes
FASTER = 1.2  # a path covers this times the higher of speed and limit, over the whole forecast
CREEPS = 5.0  # m/s: a slower vehicle on a lane that ends has found no gap, and stops at its end
# m off the centre line from which a blinking vehicle may be changing lanes. It is as far after one
# or two steps of 0.1 s.
LEAVES_FROM = 0.1

# Scores of a connection beside the turn scores (0.5 to 3, see _turn_score).
BY_ORACLE = 10.0  # an oracle has seen the agent there: more than any guess
CLOSED = 5.0  # lost where the agent's class may not drive

# How the road goes on behind the last lane of a path (Paths.ends).
OPEN = 0  # it goes on
EXIT = 1  # it does not: a vehicle that comes there leaves the map
NARROWS = 2  # only on a neighbouring lane: a creeping vehicle has to stop at the end


class Paths(NamedTuple):
    """The lanes that N vehicles are expected to drive. Row 0 is the ego."""

    lane: Ints  # [N, LANES] -1 beyond the end
    offset: Floats  # [N, LANES+1] where each lane begins, m from the start of the first
    count: Ints  # type: ignore[assignment]  # [N] lanes of the path (tuple.count is not missed)
    ends: Ints  # [N] OPEN, EXIT or NARROWS


_NOBODY: Ints = np.zeros(0, np.int32)
NO_PATHS = Paths(np.zeros((0, LANES), np.int32), np.zeros((0, LANES + 1)), _NOBODY, _NOBODY)


def likely_paths(
    road: RoadMap,
    agents: Agents,
    ego: EgoState,
    ego_lanes: Ints,
    known: Mapping[int, Ints],
    seconds: float,
) -> Paths:
    """The ego's lanes (row 0) and the likely ones of the agents for `seconds`.

    `ego_lanes` [K], the present one first; `known`: agent -> its true coming lanes, from an oracle.
    """
    n = len(agents.ids) + 1
    lane = np.full((n, LANES), -1, np.int32)
    offset = np.zeros((n, LANES + 1))
    count = np.zeros(n, np.int32)
    k = min(len(ego_lanes), LANES)
    lane[0, :k] = ego_lanes[:k]
    offset[0, 1 : k + 1] = np.cumsum(road.length[ego_lanes[:k]])
    offset[0, k + 1 :] = offset[0, k]
    count[0] = k
    from_oracle = np.full((n, LANES), -1, np.int32)
    for i, lanes in known.items():
        from_oracle[i + 1, : len(lanes)] = lanes[:LANES]
    paths = Paths(lane=lane, offset=offset, count=count, ends=np.zeros(n, np.int32))
    fastest = np.maximum(agents.v, limits(road, agents.lane, agents.vclass))
    _extend(
        paths,
        from_oracle,
        agents.lane,
        agents.v,
        agents.s + np.maximum(PATH, FASTER * fastest * seconds),
        agents.blinker,
        of_class(agents.vclass),
        ahead_of(road),
    )
    return paths


@entry
def _extend(
    paths: Paths,
    from_oracle: Ints,
    lane: Ints,
    v: Floats,
    reach: Floats,
    blinker: Ints,
    kind: NDArray[np.uint64],
    ahead: Ahead,
) -> None:
    """Fill the paths of the agents [N - 1], lane by lane, up to `reach` [N - 1] m.

    A turn signal counts for the next turn only. `from_oracle` [N, LANES], its lanes from an oracle
    (-1: none), comes first.
    """
    for i in range(len(lane)):
        row, here, side = i + 1, lane[i], blinker[i]
        if here < 0:
            continue
        total, n = 0.0, 0
        while here >= 0 and n < LANES and total < reach[i]:
            paths.lane[row, n] = here
            total += ahead.length[here]
            n += 1
            paths.offset[row, n] = total
            on = _leading_on(ahead, here, kind[i])
            if on >= 0 and on != here and v[i] < CREEPS:
                paths.ends[row] = NARROWS
                break
            best = _best_successor(ahead, on, side, from_oracle[row], kind[i])
            if (
                best >= 0
                and ahead.internal[best]
                and not ahead.internal[here]
                and ahead.direction[best] != STRAIGHT
            ):
                side = 0
            if best < 0:
                paths.ends[row] = EXIT
            here = best
        paths.count[row] = n
        for k in range(n + 1, LANES + 1):
            paths.offset[row, k] = total


@inlined
def _best_successor(ahead: Ahead, lane: int, side: int, from_oracle: Ints, kind: int) -> int:
    """The successor of a lane (-1: none) with the highest score, the first of several; -1: none.

    `side`: the blinker, -1 right, 0 none, 1 left; `kind`: class bits.
    """
    best, highest = -1, -np.inf
    for k in range(ahead.first[lane], ahead.first[lane + 1] if lane >= 0 else 0):
        after = ahead.successor[k]
        score = _turn_score(ahead.direction[after], side) + BY_ORACLE * _agreement(
            from_oracle, ahead.edge, after
        )
        if ahead.classes[after] & ahead.classes[ahead.exit[after]] & kind == np.uint64(0):
            score -= CLOSED
        if score > highest:
            best, highest = after, score
    return best


@kernel
def _turn_score(turn: int, side: int) -> float:
    """How likely a turn is with the blinker on a side: 3 the likeliest, 0.5 the least likely."""
    if side > 0:
        return 3.0 if turn == LEFT else 2.0 if turn == STRAIGHT else 1.0 if turn == RIGHT else 0.5
    if side < 0:
        return 3.0 if turn == RIGHT else 2.0 if turn == STRAIGHT else 1.0 if turn == LEFT else 0.5
    return 3.0 if turn == STRAIGHT else 2.0 if turn == RIGHT else 1.0 if turn == LEFT else 0.5


@kernel
def _agreement(from_oracle: Ints, edge: Ints, lane: int) -> float:
    """How well a lane agrees with those from an oracle: 2 it is one of them, 1 it is on the edge of
    one (the vehicle changes lanes), else 0."""
    agreement = 0.0
    for each in from_oracle:
        if each == lane:
            return 2.0
        if each >= 0 and edge[each] == edge[lane]:
            agreement = 1.0
    return agreement


@kernel
def _leading_on(ahead: Ahead, lane: int, kind: int) -> int:
    """The lane itself if it leads on. Else the nearest lane beside it that does and that a vehicle
    of this kind may use. -1: there is none."""
    if ahead.first[lane + 1] > ahead.first[lane]:
        return lane
    left, right = lane, lane
    while left >= 0 or right >= 0:
        left = _beside(ahead, ahead.left, left, kind)
        right = _beside(ahead, ahead.right, right, kind)
        for beside in (left, right):
            if beside >= 0 and ahead.first[beside + 1] > ahead.first[beside]:
                return beside
    return -1


@kernel
def _beside(ahead: Ahead, side: Ints, lane: int, kind: int) -> int:
    """The lane on that side of it that a vehicle of this kind may use; -1: there is none."""
    beside = side[lane] if lane >= 0 else -1
    return beside if beside >= 0 and ahead.classes[beside] & kind != np.uint64(0) else -1


# --- lane changes under way ---


def changing(road: RoadMap, agents: Agents, ego_lanes: Ints, aside: float) -> Agents:
    """The agents, with those that blink and move towards a neighbouring lane put on the edge of
    that lane already.

    That is so from LEAVES_FROM m off the centre line on. Where the vehicle moves no nearer to the
    ego's lane, or the lanes that follow it, it is so from `aside` m on.
    """
    side = np.where(agents.lane >= 0, agents.blinker, 0)
    beside = np.where(
        side > 0, road.left[agents.lane], np.where(side < 0, road.right[agents.lane], -1)
    )
    nearer = _lanes_between(road, beside, ego_lanes) < _lanes_between(road, agents.lane, ego_lanes)
    moves = (
        (beside >= 0)
        & (agents.d * side > np.where(nearer, LEAVES_FROM, aside))
        & (road.classes[beside] & of_class(agents.vclass) != 0)
    )
    apart = 0.5 * (road.width[agents.lane] + road.width[beside])
    return agents._replace(
        lane=np.where(moves, beside, agents.lane).astype(np.int32),
        d=np.where(moves, agents.d - side * apart, agents.d),
    )


def _lanes_between(road: RoadMap, lane: Ints, ego_lanes: Ints) -> Ints:
    """[N] how many lanes each lies beside the ego's lanes; 0 where these do not come to its
    edge."""
    same = road.edge[lane][:, None] == road.edge[ego_lanes]
    return np.where(same, np.abs(road.index[lane][:, None] - road.index[ego_lanes]), 0).max(
        axis=1, initial=0
    )
