"""Builds the local map of one cycle from the route, the signals and the forecast."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.arrays import Bools, Floats, Indices
from sumo_mcts.model.agent_tables import Tables, drawn, lanes_of, levels, moving, tables_of
from sumo_mcts.model.cost_to_go import gap_times, gates
from sumo_mcts.model.crosswalks import crosswalks
from sumo_mcts.model.least_cost import fill_sure
from sumo_mcts.model.leaving import Stream, leaving
from sumo_mcts.model.local_agents import (
    Traffic,
    bits_of,
    comes_to,
    followers_of,
    moving_sideways,
    on_foot,
    owed_at,
    slots_of,
    traffic_of,
    traits,
    with_people,
)
from sumo_mcts.model.local_map import NODE, LocalMap, State
from sumo_mcts.model.nearing import widened
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
from sumo_mcts.scene import STANDING, Forecast, Scene

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


class _Common(NamedTuple):
    """What the local maps of all hypotheses of a cycle have in common."""

    road: RoadMap
    route: RouteMap
    state: State
    scene: Scene  # with who is assumed where the ego does not see
    forecast: Forecast  # likewise
    seen: int  # agents that are not assumed
    rules: Rules
    here: float  # m from the start of the route
    view: slice  # the nodes of the window
    ahead: Floats  # LocalMap.ahead
    lane_node: Indices  # [L] see _lane_nodes
    closed: NDArray[np.uint8]  # LocalMap.closed
    yellow: Floats  # LocalMap.yellow
    walks: Bools  # [N] trait ON_FOOT
    inside: Indices  # the lanes of the junctions ahead
    crosswalk: Floats  # LocalMap.crosswalk


class _Moment(NamedTuple):
    """What follows from where the agents are now, and from who of them is going to stay there."""

    agents: tuple[Indices, Floats, Floats, Bools]  # [N] node, s (m), v (m/s); whether they stay
    needs: RouteMap  # the route with what stands as the end of its lane
    overtakes: bool  # the lane of the oncoming is open to the ego
    urgency: Floats  # LocalMap.urgency
    to_leave: Floats  # LocalMap.to_leave
    target_lane_speed: float


def build_local(
    road: RoadMap, route: RouteMap, state: State, scene: Scene, forecast: Forecast, rules: Rules
) -> LocalMap:
    """The search's view of this cycle, in the likeliest hypothesis of the forecast."""
    return build_locals(road, route, state, scene, forecast, rules, 1)[0]


def build_locals(
    road: RoadMap, route: RouteMap, state: State, scene: Scene, forecast: Forecast, rules: Rules,
    count: int,
) -> list[LocalMap]:  # fmt: skip
    """The search's view of this cycle, in each of the first `count` hypotheses of the forecast."""
    c = _common(road, route, state, scene, forecast, rules)
    forecast, view, lane_node, dt = c.forecast, c.view, c.lane_node, forecast.dt
    agents = moving(forecast, count)
    those = lanes_of(agents, len(road.lane_ids))
    tables = tables_of(road.length, route.upstream, lane_node, those, agents, dt, rules.claim_s)
    _leave_out_who_leaves_room(c, tables)
    level, shares = levels(road, route.lane[view], those), drawn(route, view, agents)
    sideways = moving_sideways(road, c.scene, agents.lane, forecast.half_width, lane_node, dt)
    bounds = widened(tables.bounds, sideways[2])
    stays = agents.v.max(axis=1) < STANDING
    free_m = float(route.limit[state.node]) * agents.v.shape[1] * dt + FREE_BEYOND
    open_ahead = is_open(route, c.closed, view.start, state, free_m)
    to_stop, stands_before, near_stop = stop_at(route, state, rules, c.here)
    within = seen_within(scene.ego)
    other = state.other if reaches_over(road, route, state, within) else -1
    found: list[LocalMap] = []
    moment: _Moment | None = None
    for h in range(count):
        traffic = traffic_of(forecast, h, tables)
        moment = _moment(c, traffic, stays[h], moment)
        bits = bits_of(forecast, traffic.node, scene.ego)
        followers = followers_of(
            traffic.node[0],
            traffic.s[0],
            forecast.reacts,
            bits,
            c.ahead,
            state,
            view.start,
            other,
        )
        coming = _coming(traffic, followers, bits, c.seen)
        owed = _owed(c, traffic, coming)
        waits_at = owed_at(owed, len(bits), view.start, c.ahead[state.node - view.start])
        slots = slots_of(route, state, forecast, traffic, scene.ego, rules)
        slots = with_people(slots, waits_at, forecast, scene.ego)
        gate, to_gate = _gates(c, moment.needs, owed)
        found.append(LocalMap(
            node=route.table if moment.overtakes else closed_table(route),
            row=route.rows, first=view.start, ahead=c.ahead,
            limit=float(route.limit[state.node]), dt=dt, closed=c.closed, yellow=c.yellow,
            level=level, place=tables.place[h], agent=tables.agent[h], drawn=shares[h],
            trait=traits(
                forecast, traffic, state, slots, tuple(each[h] for each in sideways), bits,
                c.walks, waits_at,
            ),
            bounds=bounds[h],
            followers=followers, starts=traffic.starts, patience=rules.patience, asked=rules.asked,
            obligation=np.concatenate([owed, to_oncoming(road, route, view, c.here, coming)]),
            crosswalk=c.crosswalk, gate=gate, to_gate=to_gate, urgency=moment.urgency,
            to_leave=moment.to_leave,
            target_lane_speed=moment.target_lane_speed, open_ahead=open_ahead,
            stop_at=to_stop, stands_before=stands_before, near_stop=near_stop,
            stop_decel=rules.stop_decel, seen_within=within,
            aside=ASIDE if state.progress == 0.0 else 0.5 * ASIDE,
            stuck=float(moment.overtakes), committed=bool(is_there(route, state)),
        ))  # fmt: skip
    return found


def _common(
    road: RoadMap, route: RouteMap, state: State, scene: Scene, forecast: Forecast, rules: Rules
) -> _Common:
    """What does not depend on the hypothesis."""
    here = float(route.station[state.node] + state.s)
    first, last = window(route, here)
    view, seen = slice(first, last), len(forecast.reacts)
    scene, forecast = with_unseen(road, route, view, here, scene, forecast, rules.sight)
    closed, yellow = closed_lines(route, view, scene, forecast, state, rules)
    lane_node = _lane_nodes(road, route, view)
    inside = route.lane[junction_nodes(route, first, last, here)]
    return _Common(
        road=road, route=route, state=state, scene=scene, forecast=forecast, seen=seen, rules=rules,
        here=here, view=view, ahead=_ahead(route, first, last),
        lane_node=lane_node, closed=closed, yellow=yellow,
        walks=on_foot(scene.agents, len(forecast.reacts)),
        inside=inside,
        crosswalk=crosswalks(road, route, inside, lane_node, scene, state),
    )  # fmt: skip


def _leave_out_who_leaves_room(c: _Common, tables: Tables) -> None:
    """Where lanes are divided, who leaves room is on none of them."""
    if c.scene.ego.sideways.speed <= 0.0:
        return
    for h, node in enumerate(tables.node):
        pose, position = c.forecast.pose[h], tables.position[h]
        node[:] = in_the_way(c.route, c.scene, c.forecast, pose, node, position)
        tables.agent[h, ..., NODE] = node


def _moment(c: _Common, traffic: Traffic, stays: Bools, known: _Moment | None) -> _Moment:
    """What follows from where the agents are now; it is `known` already where they are there in
    another hypothesis too."""
    agents = traffic.node[0], traffic.position[0], traffic.v[0], stays
    if known is not None and all(map(np.array_equal, agents, known.agents)):
        return known
    node, position, v, _ = agents
    route, view, here = c.route, c.view, c.here
    place = node, position, stays
    stands = standing(c.road, route, c.ahead, view.start, c.scene.agents, place)
    needs, stream = past_standing(route, view, here, stands), (comes_to(node), position, v)
    urgency = _urgency(needs, view, here)
    to_leave = leaving(needs, view, here, urgency, stream)
    return _Moment(
        agents=agents,
        needs=needs,
        overtakes=may_overtake(route, c.state, c.scene.agents, node),
        urgency=urgency,
        to_leave=np.column_stack([to_leave, route.oncoming[view]]),
        target_lane_speed=_target_lane_speed(needs, view, here, stream),
    )


def _owed(c: _Common, traffic: Traffic, coming: Coming) -> Floats:
    """LocalMap.obligation, but for the lanes of the oncoming."""
    first, last, half_length = c.view.start, c.view.stop, c.forecast.half_length
    people = np.flatnonzero(c.walks)
    return np.concatenate([
        obligations(c.road, c.route, first, last, c.here, coming),
        to_people(c.road, c.inside, c.lane_node, people, traffic.pose, traffic.driven, half_length),
    ])  # fmt: skip


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


def _gates(c: _Common, needs: RouteMap, owed: Floats) -> tuple[Floats, Floats]:
    """LocalMap.gate and LocalMap.to_gate; `needs`: the route with what stands as the end of its
    lane, `owed`: LocalMap.obligation."""
    first, last, seconds = c.view.start, c.view.stop, (c.closed.shape[1] - 1) * c.forecast.dt
    gap_s = gap_times(owed, c.route.leg, first, last, seconds, c.scene.ego.length)
    gate, to_gate = gates(c.road, needs, first, last, c.scene.signals, gap_s)
    fill_sure(gate, to_gate, c.closed, c.route, first, c.scene.step)
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
