"""Builds the local map of one cycle from the route, the signals and the forecast."""

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.arrays import Floats, Indices
from sumo_mcts.model.cost_to_go import gap_times, gates
from sumo_mcts.model.least_cost import fill_sure
from sumo_mcts.model.leaving import Stream, leaving
from sumo_mcts.model.local_agents import (
    Traffic,
    bits_of,
    bounds,
    comes_to,
    drawn,
    followers_of,
    levels,
    on_foot,
    owed_at,
    reaching_in,
    slots_of,
    traffic_of,
    traits,
    with_people,
)
from sumo_mcts.model.local_map import LocalMap, State
from sumo_mcts.model.obligations import Coming, junction_nodes, obligations, to_oncoming, to_people
from sumo_mcts.model.oncoming import (
    WANTS_BACK,
    closed_table,
    is_there,
    may_overtake,
    side_back,
    with_unseen,
)
from sumo_mcts.model.route import UPSTREAM_VIEW, RouteMap
from sumo_mcts.model.sideways import in_the_way, reaches_over, seen_within
from sumo_mcts.model.standing import past_standing, standing
from sumo_mcts.model.stop_lines import Rules, closed_lines, is_open, stop_at
from sumo_mcts.numerics.kernel import entry
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Forecast, Scene

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
    view, ahead = slice(first, last), _ahead(route, first, last)
    lane_node, seen = _lane_nodes(road, route, view), len(forecast.reacts)
    scene, forecast = with_unseen(road, route, view, here, scene, forecast, rules.sight)
    traffic = _traffic(route, scene, forecast, hypothesis, lane_node)
    node, position, v = traffic.node, traffic.position, traffic.v
    length, limit = 2.0 * forecast.half_length, float(route.limit[state.node])
    bits = bits_of(forecast, node, scene.ego)
    within = seen_within(scene.ego)
    other = state.other if reaches_over(road, route, state, within) else -1
    followers = followers_of(
        node[0], traffic.s[0], forecast.reacts, bits, ahead, state, first, other
    )
    beside = reaching_in(
        road, scene.agents, traffic.lane, forecast.half_width, lane_node, forecast.dt
    )
    level, place = levels(road, route.lane[view], traffic.lane, traffic.s, length)
    closed, yellow = closed_lines(route, view, scene, forecast, state, rules)
    walks, coming = on_foot(scene.agents, len(bits)), _coming(traffic, followers, bits, seen)
    owed = np.concatenate([
        obligations(road, route, first, last, here, coming),
        to_people(road, route.lane[junction_nodes(route, first, last, here)], lane_node,
                  np.flatnonzero(walks), traffic.pose, traffic.driven, forecast.half_length),
    ])  # fmt: skip
    waits_at = owed_at(owed, len(bits), first, ahead[state.node - first])
    slots = slots_of(route, state, forecast, traffic, scene.ego, rules)
    slots = with_people(slots, waits_at, forecast, scene.ego)
    stands = standing(road, route, ahead, first, scene.agents, (node[0], position[0], v))
    needs = past_standing(route, view, here, stands)
    free_m = limit * len(v) * forecast.dt + FREE_BEYOND
    gate, to_gate = _gates(road, route, needs, view, scene, forecast.dt, owed, closed)
    urgency, now = _urgency(needs, view, here), (comes_to(node[0]), position[0], v[0])
    overtakes = may_overtake(route, state, scene.agents, node[0])
    to_stop, stands_before, near_stop = stop_at(route, state, rules, here)
    return LocalMap(
        node=route.table if overtakes else closed_table(route),
        row=route.rows, first=first, ahead=ahead, limit=limit, dt=forecast.dt,
        closed=closed, yellow=yellow, level=level, place=place,
        agent=np.dstack([traffic.pose, v, node, position, traffic.driven]),
        drawn=drawn(route, view, traffic.lane, traffic.s, length),
        trait=traits(forecast, traffic, state, slots, beside, bits, walks, waits_at),
        bounds=bounds(traffic, forecast, rules.claim_s),
        followers=followers, starts=traffic.starts, patience=rules.patience, asked=rules.asked,
        obligation=np.concatenate([owed, to_oncoming(road, route, view, here, coming)]),
        gate=gate, to_gate=to_gate, urgency=urgency,
        to_leave=np.column_stack([
            leaving(needs, view, here, urgency, now), route.oncoming[view]
        ]),
        target_lane_speed=_target_lane_speed(needs, view, here, now),
        open_ahead=is_open(route, closed, first, state, free_m),
        stop_at=to_stop, stands_before=stands_before, near_stop=near_stop,
        stop_decel=rules.stop_decel, seen_within=within,
        aside=ASIDE if state.progress == 0.0 else 0.5 * ASIDE,
        stuck=float(overtakes), committed=bool(is_there(route, state)),
    )  # fmt: skip


def _traffic(
    route: RouteMap, scene: Scene, forecast: Forecast, hypothesis: int, lane_node: Indices
) -> Traffic:
    """The agents in a hypothesis; where lanes are divided, who leaves room is on none of them."""
    found = traffic_of(route, forecast, hypothesis, lane_node)
    if scene.ego.sideways.speed <= 0.0:
        return found
    return found._replace(
        node=in_the_way(route, scene, forecast, found.pose, found.node, found.position)
    )


def _lane_nodes(road: RoadMap, route: RouteMap, view: slice) -> Indices:
    """[L] the node in `view` of each lane of the road, the first one where there are several; -1:
    none."""
    lane_node = np.full(len(road.lane_ids), -1, np.int64)
    lane_node[route.lane[view][::-1]] = np.arange(view.stop - 1, view.start - 1, -1, dtype=np.int64)
    return lane_node


def _coming(traffic: Traffic, followers: int, bits: Indices, seen: int) -> Coming:
    """The agents to which the ego may owe its way, of which the first `seen` are not assumed: one
    that follows it cannot come before the ego has gone on, and one that starts waits for it."""
    behind = (bits >= 0) & ((followers >> np.maximum(bits, 0)) & 1 > 0)
    lets_pass = traffic.polite | behind | (np.arange(len(behind)) == traffic.starts)
    unseen = np.arange(len(behind)) >= seen
    return Coming(traffic.lane, traffic.s, traffic.driven, traffic.valid, lets_pass, unseen)


def _gates(
    road: RoadMap,
    route: RouteMap,
    needs: RouteMap,
    view: slice,
    scene: Scene,
    dt: float,
    owed: Floats,
    closed: NDArray[np.uint8],
) -> tuple[Floats, Floats]:
    """LocalMap.gate and LocalMap.to_gate; `needs`: the route with what stands as the end of its
    lane, `owed` and `closed` as in LocalMap, `dt` s between times."""
    first, last, seconds = view.start, view.stop, (closed.shape[1] - 1) * dt
    gap_s = gap_times(owed, route.leg, first, last, seconds, scene.ego.length)
    gate, to_gate = gates(road, needs, first, last, scene.signals, gap_s)
    fill_sure(gate, to_gate, closed, route, first, scene.step)
    return gate, to_gate


def _ahead(route: RouteMap, first: int, last: int) -> Floats:
    """LocalMap.ahead."""
    ahead = np.full((last - first, last - first), np.inf)
    _fill_ahead(ahead, route.next, route.length, first)
    return ahead


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
    back = side_back(route) * np.maximum(np.abs(weight), WANTS_BACK)
    return np.where(route.oncoming[view], back, weight)


def _target_lane_speed(route: RouteMap, view: slice, here: float, stream: Stream) -> float:
    """LocalMap.target_lane_speed from agents [N], also those on lanes that lead into the route."""
    good, (to, s, v) = (route.changes == 0) & ~route.lost, stream
    at = np.maximum(to, 0)  # -1 and GONE are no nodes
    beside = (to >= 0) & good[at] & (np.abs(route.station[at] + s - here) < TARGET_LANE_VIEW)
    if beside.any():
        return float(v[beside].mean())
    return float(route.limit[view][good[view]].max(initial=0.0))
