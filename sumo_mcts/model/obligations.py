"""Yield obligations: stretches of a junction that the ego's route shares with agents that have the
right of way."""

import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices, Ints
from sumo_mcts.model.local_map import (
    AGENT,
    ENTERS,
    HEAD_ON,
    IN_WAY,
    JOINS,
    JUMPS,
    KERB,
    MERGES,
    OWED_FROM,
    OWN_NODE,
    PAST,
    STRETCH_END,
    UNSEEN,
    WALKS,
)
from sumo_mcts.model.route import RouteMap
from sumo_mcts.numerics.kernel import entry, kernel
from sumo_mcts.numerics.lanes import Ahead, Areas, ahead_of, areas_of, facing, leads_to
from sumo_mcts.prediction.on_foot import Crossings, crossings_on, entering_m
from sumo_mcts.road import JUMP, RoadMap

JUNCTION_VIEW = 120.0  # m of the route ahead within which junctions count
# obligations in one cycle; further ones, those on the junctions furthest ahead, are left out
MOST = 256
AWAY = 0.5  # m that the ego stays away from a crossing to which people come


class Coming(NamedTuple):
    """N agents at T forecast times, in one hypothesis."""

    lane: Ints  # [T, N]
    s: Floats  # [T, N]
    driven: Floats  # [T, N] m from now on
    valid: Bools  # [T, N]
    lets_pass: Bools  # [N] it lets the ego pass, or follows it
    unseen: Bools  # [N] it is taken to come, where the ego does not see


def obligations(
    road: RoadMap, route: RouteMap, first: int, last: int, here: float, coming: Coming
) -> Floats:
    """[K, 8] LocalMap.obligation, on the nodes [first, last) of the route.

    It covers the junctions of the next JUNCTION_VIEW metres from `here`, m from the start of the
    route.
    """
    nodes = junction_nodes(route, first, last, here)
    rows = np.zeros((MOST, PAST + 1))
    used = _find_obligations(rows, nodes, route.lane, areas_of(road), ahead_of(road), coming)
    return _behind_jumps(rows[:used], road, route)


def _behind_jumps(rows: Floats, road: RoadMap, route: RouteMap) -> Floats:
    """The obligations, those of jumps on the node behind them: there the ego is in the way until
    its rear is over. The jump itself takes no time."""
    node = rows[:, OWN_NODE].astype(np.int64)
    over = route.length[node] <= JUMP
    if over.any():
        rows[over, OWN_NODE] = route.next[node[over]]
        rows[over, STRETCH_END] *= road.scale[route.lane[node[over]]]
        rows[over, MERGES] = np.where(rows[over, MERGES] == 0.0, JUMPS, JOINS)
    return rows


def to_oncoming(road: RoadMap, route: RouteMap, view: slice, here: float, coming: Coming) -> Floats:
    """[K, 8] LocalMap.obligation: what an ego that overtakes owes to those that come towards it, on
    the lanes that end ahead of `here`, m from the start of the route."""
    rows = [np.zeros((0, PAST + 1))]
    nodes = view.start + np.flatnonzero(route.oncoming[view])
    nodes = nodes[route.station[nodes] + route.length[nodes] > here]
    if not len(nodes):
        return rows[0]
    place = np.full(len(road.lane_ids), np.nan)  # m from the start of the route to a lane's start
    back = nodes[::-1]  # of an edge that is driven twice the first time counts
    place[facing(road)[route.lane[back]]] = route.station[back] + route.length[back]
    on_it = ~np.isnan(place[coming.lane]) & (coming.lane >= 0) & coming.valid
    those = np.flatnonzero(on_it.any(axis=0))
    at = np.argmax(on_it[:, those], axis=0)
    front = place[coming.lane[at, those]] - coming.s[at, those] + coming.driven[at, those]
    for n in nodes.tolist():
        ahead = front >= route.station[n]
        row = np.zeros((int(ahead.sum()), PAST + 1))
        row[:, OWN_NODE], row[:, AGENT] = n, those[ahead]
        row[:, MERGES] = np.where(coming.unseen[those[ahead]], UNSEEN, HEAD_ON)
        row[:, STRETCH_END] = math.inf
        row[:, ENTERS] = (front - route.station[n])[ahead]
        rows.append(row)
    return np.concatenate(rows)


def junction_nodes(route: RouteMap, first: int, last: int, here: float) -> Indices:
    """Those of [first, last) that lie inside a junction within JUNCTION_VIEW metres of `here`."""
    nodes = np.arange(first, last)
    away = np.abs(route.station[nodes] - here)
    return nodes[route.internal[nodes] & (away < JUNCTION_VIEW)]


def to_people(
    road: RoadMap, lanes: Indices, lane_node: Indices, people: Indices, pose: Floats,
    driven: Floats, half_length: Floats,
) -> Floats:  # fmt: skip
    """[K, 8] LocalMap.obligation: what the ego owes to people who are going to walk over crossings
    of its `lanes`.

    `lane_node` [L] the node of each lane of the road; `people`: which of the N agents are on foot;
    `pose` [T, N, 4] and `driven` [T, N]: where the agents are, and how far they have come, m.
    """
    rows = [np.zeros((0, PAST + 1))]
    if not len(people):
        return rows[0]
    crossings = crossings_on(road, lanes)
    for c, lane in enumerate(crossings.lane):
        enters, kerb, past, leaves = entering_m(crossings, c, pose, driven, half_length, people)
        those = np.flatnonzero((enters < np.inf) | (crossings.yields[c] & (past > 0.0)))
        row = np.zeros((len(those), PAST + 1))
        row[:, OWN_NODE], row[:, STRETCH_END] = lane_node[lane], crossings.last[c]
        row[:, OWED_FROM] = crossings.first[c] - AWAY
        row[:, AGENT], row[:, ENTERS] = people[those], enters[those]
        if crossings.yields[c]:
            row[:, KERB], row[:, PAST] = kerb[those], past[those]
            row[:, MERGES] = np.where(past[those] > 0.0, WALKS, 0.0)
        rows.append(row)
        if crossings.cuts[c]:
            rows.append(_in_the_way(crossings, c, lane_node[lane], people, enters, leaves))
    return np.concatenate(rows)


def _in_the_way(
    crossings: Crossings, c: int, node: int, people: Indices, enters: Floats, leaves: Floats
) -> Floats:
    """[K, 8] LocalMap.obligation to those of `people` [P] who are, or come to be, on the ego's part
    of a crossing: m that they walk until they enter it, and until they have left it."""
    those = np.flatnonzero(leaves > 0.0)
    row = np.zeros((len(those), PAST + 1))
    row[:, OWN_NODE], row[:, STRETCH_END] = node, crossings.last[c]
    row[:, OWED_FROM], row[:, MERGES] = crossings.first[c] - AWAY, IN_WAY
    row[:, AGENT], row[:, ENTERS] = people[those], leaves[those]
    row[:, KERB] = np.where(np.isinf(enters[those]), 0.0, enters[those])
    return row


@entry
def _find_obligations(
    rows: Floats, nodes: Indices, node_lane: Indices, areas: Areas, ahead: Ahead, coming: Coming
) -> int:
    """Write the obligations on `nodes` into `rows` [., 8]; how many were written."""
    used = 0
    for node in nodes:
        here = node_lane[node]
        for e in range(areas.first[here], areas.first[here + 1]):
            # at a zipper neither has the right of way: the forecast has who goes first
            owes = areas.yields[e] and not (areas.zipper[here] and areas.merge[e])
            for i in range(len(coming.lets_pass) if owes else 0):
                enters = (
                    math.inf
                    if coming.lets_pass[i]
                    else _enters(coming, ahead, i, areas.other[e], areas.other_begin[e])
                )
                if enters < math.inf and used < len(rows):
                    rows[used, OWN_NODE], rows[used, STRETCH_END] = node, areas.end[e]
                    rows[used, AGENT], rows[used, ENTERS] = i, enters
                    rows[used, MERGES] = areas.merge[e]
                    used += 1
    return used


@kernel
def _enters(coming: Coming, ahead: Ahead, i: int, lane: int, begin: float) -> float:
    """m that agent i drives until it is at `begin` on a lane; inf: never, or it is behind that
    already."""
    for t in range(coming.lane.shape[0]):
        here, s, before = coming.lane[t, i], coming.s[t, i], coming.lane[max(t - 1, 0), i]
        if not coming.valid[t, i] or (t == 0 and here == lane and s >= begin):
            return math.inf
        if here == lane and s >= begin:
            return float(coming.driven[t, i] - (s - begin))
        # it may have come over a short lane within this step
        if here != before and before >= 0 and here >= 0:
            driven, was = coming.driven[t - 1, i], coming.s[t - 1, i]
            if before == lane:
                return float(driven + begin - was)
            if here != lane and leads_to(ahead, before, lane) and leads_to(ahead, lane, here):
                return float(driven + ahead.length[before] - was + begin)
    return math.inf
