"""Which lanes the others will drive: the turn that their signals announce, else straight on, else
the first way; and where these paths meet."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.numerics.kernel import entry, kernel
from sumo_mcts.scene import (
    ALLWAY,
    IGNORING,
    LEFT,
    RIGHT,
    STRAIGHT,
    Agents,
    Bools,
    EgoState,
    Floats,
    Ints,
    RoadMap,
)

LANES = 20  # lanes of a path at most
PATH = 200.0  # m of a path, or what can be driven within the forecast
FASTER = 1.2  # than its speed, and the limit, now
TOLD = 10.0  # worth of a way on which an oracle has seen an agent: more than any guess
CREEPS = 5.0  # m/s below which whoever is on a lane that ends has found no gap: it stops at the end
# m off the centre line from which a blinking vehicle may be changing lanes: a step of 0.1 s or two
# after it has begun
LEAVES_FROM = 0.1
CLOSED = 5.0  # worth lost by a way that its kind of vehicle may not take
# conflicts looked at for each agent: the most that were seen, with a car every 20 m of lane, are 59
FOES = 64
OPEN, EXIT, NARROWS = (
    0,
    1,
    2,
    # it does; it does not, and whoever comes there leaves; on a lane beside alone, for which who
    # creeps
    # has found no gap
)
YIELDS, MERGES, MUTUAL, IN_TURN = (
    1,
    2,
    3,
    4,
    # it has to let the other pass; with equal right; each the other, so the nearer goes; at an
    # all-way
    # stop
)


class Paths(NamedTuple):
    """The lanes that N vehicles are expected to drive."""

    lane: Ints  # [N, LANES] -1 beyond the end
    offset: Floats  # [N, LANES+1] where each lane begins, m from the start of the first
    count: Ints  # type: ignore[assignment]  # [N] (tuple.count is not missed)
    ends: Ints  # [N] OPEN .. NARROWS: how the road goes on behind the last of them


class Conflicts(NamedTuple):
    """For each of N vehicles the others whose paths meet its own where it must yield, or where
    lanes merge."""

    foe: Ints  # [N, FOES] -1 beyond the end
    kind: Ints  # [N, FOES] YIELDS .. IN_TURN
    # [N, FOES, 4] begin and end of the shared stretch on its own path and on the foe's, m
    place: Floats


class Ahead(NamedTuple):
    """How lanes go on, as in RoadMap; the successors of a lane begin at `first` [lanes + 1]."""

    first: Ints
    successor: Ints
    direction: Ints  # [lanes], and so on
    length: Floats
    internal: Bools
    edge: Ints
    exit: Ints
    classes: NDArray[np.uint64]
    left: Ints
    right: Ints


def ahead_of(road: RoadMap) -> Ahead:
    """How the lanes of a network go on."""
    return Ahead(
        road.successor_offset,
        road.successor,
        road.direction,
        road.length,
        road.internal,
        road.edge,
        road.exit,
        road.classes,
        road.left,
        road.right,
    )


def of_class(vclass: Ints) -> NDArray[np.uint64]:
    """[N] the bits of RoadMap.classes that a vehicle of this class [N] may drive on."""
    return np.where(
        vclass == IGNORING, ~np.uint64(0), np.uint64(1) << np.maximum(vclass, 0).astype(np.uint64)
    )


def changing(road: RoadMap, agents: Agents, ego_lanes: Ints, aside: float) -> Agents:
    """The agents, those that move towards a neighbouring lane with the blinker on as if they were
    there already, at its edge.

    A vehicle does so from LEAVES_FROM m off its centre line on; from `aside` m on where it moves no
    nearer to the way along the ego's present lane.
    """
    side = np.where(agents.lane >= 0, agents.blinker, 0)
    beside = np.where(
        side > 0, road.left[agents.lane], np.where(side < 0, road.right[agents.lane], -1)
    )
    enough = np.where(
        _away(road, beside, ego_lanes) < _away(road, agents.lane, ego_lanes), LEAVES_FROM, aside
    )
    moves = (
        (beside >= 0)
        & (agents.d * side > enough)
        & (road.classes[beside] & of_class(agents.vclass) != 0)
    )
    apart = 0.5 * (road.width[agents.lane] + road.width[beside])
    return agents._replace(
        lane=np.where(moves, beside, agents.lane).astype(np.int32),
        d=np.where(moves, agents.d - side * apart, agents.d),
    )


def _away(road: RoadMap, lane: Ints, ego_lanes: Ints) -> Ints:
    """[N] how many lanes each lies beside the ego's lanes; 0 where these do not come to its
    edge."""
    same = road.edge[lane][:, None] == road.edge[ego_lanes]
    return np.where(same, np.abs(road.index[lane][:, None] - road.index[ego_lanes]), 0).max(
        axis=1, initial=0
    )


def likely_paths(
    road: RoadMap,
    agents: Agents,
    ego: EgoState,
    ego_lanes: Ints,
    ways: Mapping[int, Ints],
    seconds: float,
) -> Paths:
    """The ego's lanes (row 0) and the likely ones of the agents for `seconds`;

    `ways`: the coming lanes of those of whom they are known.
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
    true = np.full((n, LANES), -1, np.int32)
    for i, way in ways.items():
        true[i + 1, : len(way)] = way[:LANES]
    paths = Paths(lane, offset, count, np.zeros(n, np.int32))
    reach = agents.s + np.maximum(
        PATH, FASTER * np.maximum(agents.v, road.speed[agents.lane]) * seconds
    )
    _likely(
        paths,
        true,
        agents.lane,
        agents.v,
        reach,
        agents.blinker,
        of_class(agents.vclass),
        ahead_of(road),
    )
    return paths


@entry
def _likely(
    paths: Paths,
    true: Ints,
    lane: Ints,
    v: Floats,
    reach: Floats,
    blinker: Ints,
    kind: NDArray[np.uint64],
    ahead: Ahead,
) -> None:
    """The lanes each agent will most likely drive.

    The blinker speaks for the next turn only; `true` (-1: not told) knows better.
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
            best, rank = -1, -np.inf
            on = _leading_on(ahead, here, kind[i])
            if on >= 0 and on != here and v[i] < CREEPS:
                paths.ends[row] = NARROWS
                break
            for k in range(ahead.first[on], ahead.first[on + 1] if on >= 0 else 0):
                after = ahead.successor[k]
                worth = _turn_worth(ahead.direction[after], side) + TOLD * _agreement(
                    true[row], ahead.edge, after
                )
                if ahead.classes[after] & ahead.classes[ahead.exit[after]] & kind[i] == np.uint64(
                    0
                ):
                    worth -= CLOSED
                if worth > rank:
                    best, rank = after, worth
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


@kernel
def leads_to(ahead: Ahead, lane: int, other: int) -> bool:
    """Whether one drives from a lane onto the other."""
    found = False
    for k in range(ahead.first[lane], ahead.first[lane + 1]):
        found = found or ahead.successor[k] == other
    return found


@kernel
def _leading_on(ahead: Ahead, lane: int, kind: int) -> int:
    """The lane itself if it leads on, else the nearest beside it that does and that a vehicle of
    this kind may use; -1: there is none."""
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


@kernel
def _agreement(true: Ints, edge: Ints, lane: int) -> float:
    """How far a lane is what was told: 2 the lane itself, 1 another one of its edge (whoever
    changes lanes), else 0."""
    agreement = 0.0
    for told in true:
        if told == lane:
            return 2.0
        if told >= 0 and edge[told] == edge[lane]:
            agreement = 1.0
    return agreement


@kernel
def _turn_worth(turn: int, side: int) -> float:
    if side > 0:
        return 3.0 if turn == LEFT else 2.0 if turn == STRAIGHT else 1.0 if turn == RIGHT else 0.5
    if side < 0:
        return 3.0 if turn == RIGHT else 2.0 if turn == STRAIGHT else 1.0 if turn == LEFT else 0.5
    return 3.0 if turn == STRAIGHT else 2.0 if turn == RIGHT else 1.0 if turn == LEFT else 0.5


class Areas(NamedTuple):
    """Where lanes cross or merge;

    `first` [lanes + 1]: which of them are a lane's, the rest as in RoadMap.
    """

    first: Ints
    other: Ints
    begin: Floats
    end: Floats
    other_begin: Floats
    other_end: Floats
    merge: Bools
    yields: Bools
    allway: Bools  # [lanes]


def areas_of(road: RoadMap) -> Areas:
    """Those of a network."""
    return Areas(
        road.conflict_offset, road.conflict_lane, road.conflict_begin, road.conflict_end,
        road.conflict_other_begin, road.conflict_other_end,
        road.conflict_merge, road.conflict_yields, road.rule == ALLWAY,
    )  # fmt: skip


def conflicts_of(road: RoadMap, paths: Paths) -> Conflicts:
    """Where the paths of the vehicles meet."""
    n = len(paths.lane)
    found = Conflicts(
        np.full((n, FOES), -1, np.int32), np.zeros((n, FOES), np.int32), np.zeros((n, FOES, 4))
    )
    _find_conflicts(
        found,
        paths,
        areas_of(road),
        np.full(len(road.lane_ids), -1, np.int32),
        np.zeros(n, np.int32),
    )
    return found


@entry
def _find_conflicts(found: Conflicts, paths: Paths, areas: Areas, mark: Ints, used: Ints) -> None:
    """`mark` [lanes of the road], all -1, and `used` [N], all 0, are room to work in."""
    n = len(paths.lane)
    for j in range(n):
        for k in range(
            paths.count[j] - 1, -1, -1
        ):  # where a path comes to a lane twice, in a roundabout, the first time counts
            mark[paths.lane[j, k]] = k
        for i in range(n):
            for m in range(paths.count[i] if i != j else 0):
                lane = paths.lane[i, m]
                for e in range(areas.first[lane], areas.first[lane + 1]):
                    k, u = mark[areas.other[e]], used[i]
                    kind = _kind(areas, lane, e) if k >= 0 and u < found.foe.shape[1] else 0
                    if kind == 0:
                        continue
                    found.foe[i, u], found.kind[i, u] = j, kind
                    found.place[i, u, 0], found.place[i, u, 1] = (
                        paths.offset[i, m] + areas.begin[e],
                        paths.offset[i, m] + areas.end[e],
                    )
                    found.place[i, u, 2], found.place[i, u, 3] = (
                        paths.offset[j, k] + areas.other_begin[e],
                        paths.offset[j, k] + areas.other_end[e],
                    )
                    used[i] += 1
        for k in range(paths.count[j]):
            mark[paths.lane[j, k]] = -1


@kernel
def _kind(areas: Areas, lane: int, e: int) -> int:
    """What whoever is on `lane` has to heed in its conflict area e:

    YIELDS .. IN_TURN, or 0: nothing.
    """
    back = False  # the other has to yield too
    for r in range(areas.first[areas.other[e]], areas.first[areas.other[e] + 1]):
        back = back or (areas.other[r] == lane and areas.yields[r])
    if areas.yields[e]:
        return IN_TURN if areas.allway[lane] else MUTUAL if back else YIELDS
    return MERGES if areas.merge[e] and not back else 0
