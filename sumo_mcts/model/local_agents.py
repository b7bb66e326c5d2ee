"""What the local map of one cycle holds of the agents: one hypothesis of the forecast, beside the
ego's route."""

from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices, Ints
from sumo_mcts.model.local_map import (
    AGENT,
    ELSEWHERE,
    GONE,
    KERB,
    KINDS,
    LATE,
    NEARBY,
    OCCUPANCY_SAMPLES,
    OWN_NODE,
    PAST,
    UPSTREAM,
    State,
)
from sumo_mcts.model.route import RouteMap, Upstream
from sumo_mcts.model.stop_lines import Rules
from sumo_mcts.numerics.drawn import drawn_shares
from sumo_mcts.numerics.geometry import Y
from sumo_mcts.numerics.kernel import entry
from sumo_mcts.numerics.lanes import opposed
from sumo_mcts.prediction.poses import SIDEWAYS
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import STARTS, Agents, EgoState, Forecast

MOST_ASKED = 4  # agents behind the ego that may make room in one cycle
MOST_FOLLOWERS = 63  # bits of a mask
MOST_AT_KERBS = 12  # people whom the search has wait or walk in one cycle
CRAWLS = 1.0  # m/s of the ego below which people on foot walk round it


class Traffic(NamedTuple):
    """The agents in one hypothesis. T times, N agents."""

    pose: Floats  # [T, N, 4] poses of the box
    v: Floats  # [T, N] m/s
    lane: Ints  # [T, N] lane of the front, -1 off the road
    s: Floats  # [T, N] lane position of the front, m
    valid: Bools  # [T, N] False: not there
    # Columns NODE, S and DRIVEN of LocalMap.agent
    node: Indices  # [T, N]
    position: Floats  # [T, N] m
    driven: Floats  # [T, N] m
    polite: Bools  # [N] it lets the ego pass
    starts: int  # LocalMap.starts


def traffic_of(route: RouteMap, forecast: Forecast, hypothesis: int, lane_node: Indices) -> Traffic:
    """The agents in a hypothesis; `lane_node` [L] is the route's node of each lane of the road, -1:
    none."""
    lane, s, v = forecast.lane[hypothesis], forecast.s[hypothesis], forecast.v[hypothesis]
    valid = forecast.valid[hypothesis]
    node, position = _places(route, lane, s, valid, lane_node)
    return Traffic(
        pose=forecast.pose[hypothesis],
        v=v,
        lane=lane,
        s=s,
        valid=valid,
        node=node,
        position=position,
        driven=_driven(lane, s, v, forecast.dt),
        polite=forecast.yields[hypothesis],
        starts=_starts(forecast, hypothesis),
    )


def comes_to(node: Indices) -> Indices:
    """[N] the node that each agent is on or comes to, negative: none, from column NODE of
    LocalMap.agent at one time."""
    return np.where(node <= UPSTREAM, UPSTREAM - node, node)


def traits(
    forecast: Forecast,
    traffic: Traffic,
    state: State,
    slots: Indices,
    beside: tuple[Indices, Ints],
    bits: Indices,
    walks: Bools,
    owed: Indices,
) -> Floats:
    """LocalMap.trait, from its columns SLOT; BESIDE and UNTIL; BIT; ON_FOOT; and OWED."""
    return np.column_stack([
        forecast.half_length, forecast.half_width, forecast.reacts, traffic.polite,
        slots, *beside, bits, walks, walks & (state.v < CRAWLS), owed,
    ])  # fmt: skip


def _starts(forecast: Forecast, hypothesis: int) -> int:
    """LocalMap.starts."""
    intents = forecast.intents[hypothesis : hypothesis + 1]
    return next((intent.agent for intent in intents if intent.does == STARTS), -1)


def _driven(lane: Ints, s: Floats, v: Floats, dt: float) -> Floats:
    """Column DRIVEN [T, N] of LocalMap.agent."""
    driven = np.zeros_like(v)
    same_lane = (lane[1:] == lane[:-1]) & (lane[1:] >= 0)
    moved = np.where(same_lane, s[1:] - s[:-1], 0.5 * (v[1:] + v[:-1]) * dt)
    driven[1:] = np.cumsum(moved, axis=0)
    return driven


def _places(
    route: RouteMap, lane: Ints, s: Floats, valid: Bools, lane_node: Indices
) -> tuple[Indices, Floats]:
    """Columns NODE [T, N] and S [T, N] of LocalMap.agent."""
    node = np.where(lane >= 0, lane_node[lane], ELSEWHERE).astype(np.int64)
    node[~valid] = GONE
    position = s.copy()  # those upstream count from their node
    none = np.full(len(lane_node), -1, np.int64)
    _fill_upstream(node, position, lane, lane_node, route.upstream, none)
    return node, position


@entry
def _fill_upstream(
    node: Indices, s: Floats, lane: Ints, lane_node: Indices, upstream: Upstream, to: Indices
) -> None:
    """Fill node and s of agents [T, N] on lanes that lead into the ego's, except those that turn
    off.

    `node` gets the node that they come to, `s` their position from its start (negative), m. `to`
    [lanes of the road] is working memory, all -1.
    """
    for k in range(len(upstream.lane)):
        if lane_node[upstream.onto[k]] >= 0:
            to[upstream.lane[k]] = k
    for i in range(lane.shape[1]):
        comes = True  # assumed at the end of the forecast
        for t in range(len(lane) - 1, -1, -1):
            if node[t, i] != -1:
                comes = node[t, i] >= 0
                continue
            k = to[lane[t, i]] if comes and lane[t, i] >= 0 else -1
            comes = k >= 0
            if comes:
                node[t, i] = UPSTREAM - lane_node[upstream.onto[k]]
                s[t, i] += upstream.begin[k]


def levels(
    road: RoadMap, own: Indices, lane: Ints, s: Floats, length: Floats
) -> tuple[Indices, Indices]:
    """Which of the ego's lanes `own` [W] may touch which lanes of agents: not those on bridges.

    The agents are on `lane` [T, N] at s [T, N], m, and have a `length` [N], m. Boxes that overlap
    in the plane touch only on the same edge, or near a junction cluster of both lanes. Elsewhere
    one road is a bridge over the other.

    Returns level [W, K] and place [T, N]. A lane has clusters of three kinds: 0 the one it lies in,
    1 the one where it ends, 2 the one where it begins. Bit 3 i + j of level: cluster i of the ego's
    lane is cluster j of the other lane; bit 0 is set on the same edge too. Bit j of place: the
    agent is near cluster j of its lane; bit 0 always.
    """
    those, column = np.unique(lane, return_inverse=True)
    mine, theirs = (
        np.stack([road.knot[lanes], road.ends[lanes], road.begins[lanes]]) for lanes in (own, those)
    )
    level = (road.edge[own][:, None] == road.edge[those]).astype(np.int64)
    if len(road.oncoming):
        level |= opposed(road, own[:, None], those)
    for i in range(KINDS):
        for j in range(KINDS):
            meet = (mine[i][:, None] == theirs[j]) & (theirs[j] >= 0)
            level |= meet.astype(np.int64) << (KINDS * i + j)
    near = 1 + 2 * (road.length[lane] - s < NEARBY + length) + 4 * (s < NEARBY + length)
    return level, np.where(lane >= 0, (column.reshape(lane.shape) << KINDS) + near, -1)


def slots_of(
    route: RouteMap,
    state: State,
    forecast: Forecast,
    traffic: Traffic,
    ego: EgoState,
    rules: Rules,
) -> Indices:
    """[N] 0, 1, ... for those that the search moves, -1 for the others: the one that starts,
    then the nearest that react and come to a lane of the ego's route; where it asks for room, those
    behind it in the lane asked."""
    if rules.asked == 0:
        those, most = forecast.reacts & (traffic.node >= 0).any(axis=0), rules.reactive
    else:
        beside = (route.left if rules.asked > 0 else route.right)[state.node]
        behind = (comes_to(traffic.node[0]) == beside) & (traffic.position[0] < state.s)
        those, most = forecast.reacts & behind & (beside >= 0), MOST_ASKED
    first = np.arange(len(those)) == traffic.starts
    numbers = _nearest(forecast, np.flatnonzero(those & ~first), ego, most)
    return np.where(first, 0, np.where(numbers >= 0, numbers + first.any(), -1))


def owed_at(obligation: Floats, agents: int, first: int, ahead: Floats) -> Indices:
    """Trait OWED of `agents`: the nearest kerb at which each may wait for the ego, on the way of
    the ego's lane if there is one. Lanes beside it lead over the same crossing.

    `ahead` [W]: the row of LocalMap.ahead of the ego's node, for nodes from `first` on.
    """
    owed = np.full(agents, -1)
    those = np.flatnonzero(obligation[:, PAST] > 0.0)
    own = np.isfinite(ahead[obligation[those, OWN_NODE].astype(int) - first])
    best_last = those[np.lexsort((-obligation[those, KERB], own))]
    owed[obligation[best_last, AGENT].astype(int)] = best_last
    return owed


def with_people(slots: Indices, owed: Indices, forecast: Forecast, ego: EgoState) -> Indices:
    """`slots` and, after those, the nearest people of trait OWED: the search moves them too."""
    people = _nearest(forecast, np.flatnonzero(owed >= 0), ego, MOST_AT_KERBS)
    return np.where(people >= 0, people + slots.max(initial=-1) + 1, slots)


def bits_of(forecast: Forecast, node: Indices, ego: EgoState) -> Indices:
    """Trait BIT: each agent's own number where there are few, else 0, 1, ... for the nearest of
    those that could follow the ego, -1 for the others."""
    if len(forecast.reacts) <= MOST_FOLLOWERS:
        return np.arange(len(forecast.reacts))
    comes = ((node >= 0) | (node <= UPSTREAM)).any(axis=0)
    return _nearest(forecast, np.flatnonzero(forecast.reacts & comes), ego, MOST_FOLLOWERS)


def _nearest(forecast: Forecast, those: Indices, ego: EgoState, most: int) -> Indices:
    """[N] 0, 1, ... for the nearest `most` of `those`, -1 for the others."""
    where = forecast.pose[0, 0, those]
    nearest = those[
        np.argsort(np.hypot(where[:, 0] - ego.x, where[:, 1] - ego.y), kind="stable")[:most]
    ]
    numbers = np.full(len(forecast.reacts), -1)
    numbers[nearest] = np.arange(len(nearest))
    return numbers


@entry
def followers_of(
    node: Indices, s: Floats, reacts: Bools, bits: Indices, ahead: Floats, state: State, first: int,
    other: int,
) -> int:  # fmt: skip
    """Bit mask of the agents that react and follow the ego: their lane leads to the ego, which is
    ahead of them, or to its place on the lane `other`; -1: it has none there."""
    result = 0
    for i in range(len(node)):
        for target in (state.node, other):
            if node[i] >= 0 and target >= 0 and reacts[i] and bits[i] >= 0:
                gap = ahead[node[i] - first, target - first] + state.s - s[i]
                if 0.0 < gap < np.inf:
                    result |= 1 << bits[i]
    return result


def reaching_in(
    road: RoadMap, agents: Agents, lane: Ints, half_width: Floats, lane_node: Indices, dt: float
) -> tuple[Indices, Ints]:
    """BESIDE [N] and UNTIL [N] of agents on the lanes `lane` [T, N].

    The lane that an agent leaves is not free until its whole box is out of it.
    """
    first, times = lane[0], len(lane)
    if not agents.ids:  # a forecast without a scene (evaluation/hindsight.py): its boxes are true
        return np.full(len(half_width), -1), np.zeros(len(half_width), np.int32)
    apart = 0.5 * (road.width[agents.lane] + road.width[first])
    off = np.where(
        first == agents.lane,
        agents.d,
        np.where(first == road.left[agents.lane], agents.d - apart, agents.d + apart),
    )
    beside = np.where(
        (first >= 0) & (off != 0.0), np.where(off > 0.0, road.left[first], road.right[first]), -1
    )
    seconds = (np.abs(off) + half_width - 0.5 * road.width[first]) / SIDEWAYS
    on_it = np.where((lane == first).all(axis=0), times, np.argmax(lane != first, axis=0))
    until = np.minimum(np.floor(seconds / dt), on_it - 1).astype(np.int32)
    return np.where((beside >= 0) & (seconds > 0.0), lane_node[beside], -1), until


def on_foot(agents: Agents, count: int) -> Bools:
    """Trait ON_FOOT of the `count` agents of a forecast, which are those of the scene, or not in it
    (evaluation/hindsight.py)."""
    return agents.person if agents.ids else np.zeros(count, np.bool_)


def bounds(traffic: Traffic, forecast: Forecast, claim_s: float) -> Floats:
    """LocalMap.bounds [T, N, 4].

    The bounds are too large rather than too small. They serve to skip distant agents quickly.
    """
    where, half, dt = (
        traffic.pose[:, :, : Y + 1], forecast.half_length + forecast.half_width, forecast.dt
    )  # fmt: skip
    last = len(where) - 1
    swept = (half + 0.5 * traffic.v * dt)[..., None]
    low, high = where - swept, where + swept
    for shift in (
        -int(LATE / dt + 0.5),
        *(int(k * claim_s / OCCUPANCY_SAMPLES / dt + 0.5) for k in range(1, OCCUPANCY_SAMPLES + 1)),
    ):
        then = where[np.clip(np.arange(last + 1) + shift, 0, last)]
        np.fmin(low, then - half[:, None], out=low)
        np.fmax(high, then + half[:, None], out=high)
    return np.stack([low[..., 0], high[..., 0], low[..., 1], high[..., 1]], axis=2)


def drawn(route: RouteMap, view: slice, lane: Ints, s: Floats, length: Floats) -> Floats:
    """LocalMap.drawn of agents on `lane` [T, N] at s [T, N], of a `length` [N], m."""
    near = route.drawing.near
    if not len(near) or not (near[route.lane[view]].any() or near[lane[lane >= 0]].any()):
        return np.zeros((0, 0))
    return drawn_shares(route.drawing, lane, s, length)
