"""Builds the local map of one cycle from the route, the signals and the forecast."""

import numpy as np

from sumo_mcts.model.cost_to_go import gap_times, gates
from sumo_mcts.model.least_cost import fill_sure
from sumo_mcts.model.leaving import leaving
from sumo_mcts.model.local_map import (
    ELSEWHERE,
    GONE,
    KINDS,
    LATE,
    NEARBY,
    OCCUPANCY_SAMPLES,
    UPSTREAM,
    LocalMap,
    State,
)
from sumo_mcts.model.obligations import Coming, junction_nodes, obligations, to_oncoming, to_people
from sumo_mcts.model.oncoming import KEEPS_RIGHT, closed_table, may_overtake, with_unseen
from sumo_mcts.model.route import UPSTREAM_VIEW, RouteMap, Upstream
from sumo_mcts.model.standing import past_standing, standing
from sumo_mcts.model.stop_lines import Rules, closed_lines, is_open, stop_at
from sumo_mcts.numerics.drawn import drawn_shares
from sumo_mcts.numerics.geometry import Y
from sumo_mcts.numerics.kernel import entry
from sumo_mcts.numerics.lanes import opposed
from sumo_mcts.prediction.poses import SIDEWAYS
from sumo_mcts.scene import (
    STARTS,
    Agents,
    Bools,
    EgoState,
    Floats,
    Forecast,
    Indices,
    Ints,
    RoadMap,
    Scene,
)

# m of the route behind the ego where followers are seen: as far as on the lanes that lead into it
BACK = UPSTREAM_VIEW
VIEW = 400.0  # m of the route ahead that a search may see
# A lane change that the route needs begins to be urgent so many s before the lane leaves the route,
AHEAD_S = 14.4
GROWS_S = 9.0  # and is urgent in full so many s later.
URBAN = 13.9  # m/s: least speed for these times, so that they are at least 200 m
# m before and behind the ego within which vehicles count for the speed of the target lane
TARGET_LANE_VIEW = 100.0
# m that a lane change keeps clear to the side before it begins, and half of that later: else small
# errors would stop a change that has begun
ASIDE = 0.2
FREE_BEYOND = 50.0  # m, added to the distance that the ego could drive within the forecast
MOST_ASKED = 4  # agents behind the ego that may make room in one cycle
MOST_FOLLOWERS = 63  # bits of a mask
CRAWLS = 1.0  # m/s of the ego below which people on foot walk round it
CHAIN = 250.0  # m beyond its end over which one lane is followed into the next


def window(route: RouteMap, here: float) -> tuple[int, int]:
    """[first, last): the nodes of the route's edges from BACK metres behind to VIEW metres ahead of
    `here`, m from the start of the route."""
    begins = np.searchsorted(route.leg, np.arange(route.leg[-1] + 1))
    station = route.station[begins]
    first = int(begins[max(0, int(np.searchsorted(station, here - BACK)) - 1)])
    beyond = int(np.searchsorted(station, here + VIEW))
    return first, int(begins[beyond]) if beyond < len(begins) else len(route.lane)


def build_local(
    road: RoadMap,
    route: RouteMap,
    state: State,
    scene: Scene,
    forecast: Forecast,
    rules: Rules,
    hypothesis: int = 0,
) -> LocalMap:
    """The search's view of this cycle, in one hypothesis of the forecast."""
    here = float(route.station[state.node] + state.s)
    first, last = window(route, here)
    view = slice(first, last)
    seen = len(forecast.reacts)
    scene, forecast = with_unseen(road, route, view, here, scene, forecast, rules.sight)
    lane, s, v = forecast.lane[hypothesis], forecast.s[hypothesis], forecast.v[hypothesis]
    lane_node = np.full(len(road.lane_ids), -1, np.int64)
    lane_node[route.lane[view][::-1]] = np.arange(last - 1, first - 1, -1, dtype=np.int64)
    node, position = _places(route, forecast, lane, s, lane_node, hypothesis)
    driven = _driven(lane, s, v, forecast.dt)
    ahead = np.full((last - first, last - first), np.inf)
    _fill_ahead(ahead, route.next, route.length, first)
    level, place = _levels(road, route.lane[view], lane, s, 2.0 * forecast.half_length)
    closed, yellow = closed_lines(route, view, scene, forecast, state, rules)
    bits = _bits(forecast, node, scene.ego)
    followers = _followers(node[0], s[0], forecast.reacts, bits, ahead, state, first)
    behind = (bits >= 0) & ((followers >> np.maximum(bits, 0)) & 1 > 0)
    # an agent that follows the ego cannot come before the ego has gone on
    starts = _starts(forecast, hypothesis)
    lets_pass = forecast.yields[hypothesis] | behind | (np.arange(len(behind)) == starts)
    unseen = np.arange(len(behind)) >= seen
    coming = Coming(lane, s, driven, forecast.valid[hypothesis], lets_pass, unseen)
    limit, times = float(route.limit[state.node]), forecast.pose.shape[1]
    beside, until = _reaching_in(
        road, scene.agents, lane, forecast.half_width, lane_node, forecast.dt
    )
    inside = route.lane[junction_nodes(route, first, last, here)]
    on_foot = _on_foot(scene.agents, lane.shape[1])
    owed = np.concatenate([
        obligations(road, route, first, last, here, coming),
        to_people(road, inside, lane_node, np.flatnonzero(on_foot), forecast.pose[hypothesis],
                  driven, forecast.half_length),
    ])  # fmt: skip
    gap_s = gap_times(owed, route.leg, first, last, (times - 1) * forecast.dt, scene.ego.length)
    stands = standing(road, route, ahead, first, scene.agents, (node[0], position[0], v))
    needs = past_standing(route, view, here, stands)
    gate, to_gate = gates(road, needs, first, last, scene.signals, gap_s)
    fill_sure(gate, to_gate, closed, route, first, scene.step)
    urgency = _urgency(needs, view, here)
    open_to_it = may_overtake(route, state, scene.agents, node[0])
    comes_to = np.where(node[0] <= UPSTREAM, UPSTREAM - node[0], node[0])
    to_stop, stands_before, near_stop = stop_at(route, state, rules, here)
    return LocalMap(
        gate=gate,
        to_gate=to_gate,
        node=route.table if open_to_it else closed_table(route),
        row=route.rows,
        closed=closed,
        yellow=yellow,
        level=level,
        place=place,
        ahead=ahead,
        urgency=urgency,
        to_leave=np.column_stack([
            leaving(needs, view, here, urgency, (comes_to, position[0], v[0])),
            route.oncoming[view],
        ]),
        agent=np.dstack([forecast.pose[hypothesis], v, node, position, driven]),
        drawn=_drawn(route, view, lane, s, 2.0 * forecast.half_length),
        trait=np.column_stack([
            forecast.half_length, forecast.half_width, forecast.reacts,
            forecast.yields[hypothesis],
            _slots(route, state, forecast, node, position, scene, rules, starts),
            beside, until, bits, on_foot, on_foot & (state.v < CRAWLS),
        ]),
        bounds=_bounds(
            forecast.pose[hypothesis, :, :, : Y + 1], v,
            forecast.half_length + forecast.half_width, forecast.dt, rules.claim_s,
        ),
        obligation=np.concatenate([owed, to_oncoming(road, route, view, coming)]),
        first=first,
        limit=limit,
        target_lane_speed=_target_lane_speed(needs, view, here, node[0], position[0], v[0]),
        open_ahead=is_open(route, closed, first, state, limit * times * forecast.dt + FREE_BEYOND),
        stop_at=to_stop,
        stands_before=stands_before,
        near_stop=near_stop,
        followers=followers,
        stop_decel=rules.stop_decel,
        aside=ASIDE if state.progress == 0.0 else 0.5 * ASIDE,
        patience=rules.patience,
        asked=rules.asked,
        starts=starts,
        dt=forecast.dt,
    )  # fmt: skip


def _drawn(route: RouteMap, view: slice, lane: Ints, s: Floats, length: Floats) -> Floats:
    """LocalMap.drawn of agents on `lane` [T, N] at s [T, N], of a `length` [N], m."""
    near = route.drawing.near
    if not len(near) or not (near[route.lane[view]].any() or near[lane[lane >= 0]].any()):
        return np.zeros((0, 0))
    return drawn_shares(route.drawing, lane, s, length)


def _driven(lane: Ints, s: Floats, v: Floats, dt: float) -> Floats:
    """Column DRIVEN [T, N] of LocalMap.agent."""
    driven = np.zeros_like(v)
    same_lane = (lane[1:] == lane[:-1]) & (lane[1:] >= 0)
    moved = np.where(same_lane, s[1:] - s[:-1], 0.5 * (v[1:] + v[:-1]) * dt)
    driven[1:] = np.cumsum(moved, axis=0)
    return driven


def _places(
    route: RouteMap, forecast: Forecast, lane: Ints, s: Floats, lane_node: Indices, hypothesis: int
) -> tuple[Indices, Floats]:
    """Columns NODE [T, N] and S [T, N] of LocalMap.agent; `lane_node` [L] is the route's node of
    each lane of the road, -1: none."""
    node = np.where(lane >= 0, lane_node[lane], ELSEWHERE).astype(np.int64)
    node[~forecast.valid[hypothesis]] = GONE
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


def _levels(
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


def _slots(
    route: RouteMap,
    state: State,
    forecast: Forecast,
    node: Indices,
    s: Floats,
    scene: Scene,
    rules: Rules,
    starts: int,
) -> Indices:
    """[N] 0, 1, ... for those that the search moves, -1 for the others: agent `starts` (-1: none),
    then the nearest that react and come to a lane of the ego's route; where it asks for room, those
    behind it in the lane asked."""
    if rules.asked == 0:
        those, most = forecast.reacts & (node >= 0).any(axis=0), rules.reactive
    else:
        beside = (route.left if rules.asked > 0 else route.right)[state.node]
        comes_to = np.where(node[0] <= UPSTREAM, UPSTREAM - node[0], node[0])
        behind = (comes_to == beside) & (s[0] < state.s)
        those, most = forecast.reacts & behind & (beside >= 0), MOST_ASKED
    first = np.arange(len(those)) == starts
    numbers = _nearest(forecast, np.flatnonzero(those & ~first), scene.ego, most)
    return np.where(first, 0, np.where(numbers >= 0, numbers + first.any(), -1))


def _starts(forecast: Forecast, hypothesis: int) -> int:
    """LocalMap.starts."""
    intents = forecast.intents[hypothesis : hypothesis + 1]
    return next((intent.agent for intent in intents if intent.does == STARTS), -1)


def _bits(forecast: Forecast, node: Indices, ego: EgoState) -> Indices:
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


def _reaching_in(
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


def _on_foot(agents: Agents, count: int) -> Bools:
    """Trait ON_FOOT of the `count` agents of a forecast, which are those of the scene, or not in it
    (evaluation/hindsight.py)."""
    return agents.person if agents.ids else np.zeros(count, np.bool_)


def _bounds(where: Floats, v: Floats, half: Floats, dt: float, claim_s: float) -> Floats:
    """LocalMap.bounds from centres [T, N, 2], speeds [T, N] and half sizes [N].

    The bounds are too large rather than too small. They serve to skip distant agents quickly.
    """
    last = len(where) - 1
    swept = (half + 0.5 * v * dt)[..., None]
    low, high = where - swept, where + swept
    for shift in (
        -int(LATE / dt + 0.5),
        *(int(k * claim_s / OCCUPANCY_SAMPLES / dt + 0.5) for k in range(1, OCCUPANCY_SAMPLES + 1)),
    ):
        then = where[np.clip(np.arange(last + 1) + shift, 0, last)]
        np.fmin(low, then - half[:, None], out=low)
        np.fmax(high, then + half[:, None], out=high)
    return np.stack([low[..., 0], high[..., 0], low[..., 1], high[..., 1]], axis=2)


@entry
def _fill_ahead(ahead: Floats, nxt: Indices, length: Floats, first: int) -> None:
    """LocalMap.ahead [W, W], which is inf everywhere before."""
    w = len(ahead)
    for i in range(w):
        ahead[i, i] = 0.0
        distance, n = length[first + i], nxt[first + i]
        while n >= first and n - first < w and distance < length[first + i] + CHAIN:
            ahead[i, n - first] = distance
            distance += length[n]
            n = nxt[n]


@entry
def _followers(
    node: Indices, s: Floats, reacts: Bools, bits: Indices, ahead: Floats, state: State, first: int
) -> int:
    """Bit mask of the agents that react and follow the ego: their lane leads to the ego, which is
    ahead of them."""
    result = 0
    for i in range(len(node)):
        for target in (state.node, state.other):
            if node[i] >= 0 and target >= 0 and reacts[i] and bits[i] >= 0:
                gap = ahead[node[i] - first, target - first] + state.s - s[i]
                if 0.0 < gap < np.inf:
                    result |= 1 << bits[i]
    return result


def _urgency(route: RouteMap, view: slice, here: float) -> Floats:
    """[W] lane changes needed (at most 3, positive to the left), weighed by how soon.

    The weight is 1 where the lane leaves the route soon, and falls to 0 at AHEAD_S for each change.
    """
    distance = np.maximum(route.station[view] + route.reach[view] - here, 1.0)
    needed = np.clip(route.needed[view], -3, 3)
    # one speed for all nodes, or going on could cost more than standing
    seconds = distance / max(route.limit[view][needed != 0].max(initial=0.0), URBAN)
    weight = np.where(
        needed != 0,
        np.clip((AHEAD_S - seconds / np.maximum(np.abs(route.needed[view]), 1)) / GROWS_S, 0.0, 1.0)
        * needed,
        0.0,
    )
    return np.where(route.oncoming[view], np.minimum(weight, -KEEPS_RIGHT), weight)


def _target_lane_speed(
    route: RouteMap, view: slice, here: float, node: Indices, s: Floats, v: Floats
) -> float:
    """LocalMap.target_lane_speed from agents [N], also those on lanes that lead into the route."""
    good = (route.changes == 0) & ~route.lost
    to = np.where(node <= UPSTREAM, UPSTREAM - node, node)
    at = np.maximum(to, 0)  # -1 and GONE are no nodes
    beside = (to >= 0) & good[at] & (np.abs(route.station[at] + s - here) < TARGET_LANE_VIEW)
    if beside.any():
        return float(v[beside].mean())
    return float(route.limit[view][good[view]].max(initial=0.0))
