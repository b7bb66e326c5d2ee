"""Yield obligations: stretches of a junction that the ego's route shares with agents that have the
right of way."""

import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.model.local_map import AGENT, ENTERS, MERGES, OWN_NODE, STRETCH_END
from sumo_mcts.model.route import RouteMap
from sumo_mcts.numerics.kernel import entry, kernel
from sumo_mcts.numerics.lanes import Ahead, Areas, ahead_of, areas_of, leads_to
from sumo_mcts.scene import Bools, Floats, Indices, Ints, RoadMap

JUNCTION_VIEW = 120.0  # m of the route ahead within which junctions count
# obligations in one cycle; further ones, those on the junctions furthest ahead, are left out
MOST = 256


class Coming(NamedTuple):
    """N agents at T forecast times, in one hypothesis."""

    lane: Ints  # [T, N]
    s: Floats  # [T, N]
    driven: Floats  # [T, N] m from now on
    valid: Bools  # [T, N]
    lets_pass: Bools  # [N] it lets the ego pass, or follows it


def obligations(
    road: RoadMap, route: RouteMap, first: int, last: int, here: float, coming: Coming
) -> Floats:
    """[K, 5] LocalMap.obligation, on the nodes [first, last) of the route.

    It covers the junctions of the next JUNCTION_VIEW metres from `here`, m from the start of the
    route.
    """
    nodes = np.arange(first, last)
    near = (
        route.internal[nodes]
        & (route.station[nodes] < here + JUNCTION_VIEW)
        & (route.station[nodes] > here - JUNCTION_VIEW)
    )
    rows = np.zeros((MOST, MERGES + 1))
    used = _find_obligations(rows, nodes[near], route.lane, areas_of(road), ahead_of(road), coming)
    return rows[:used]


@entry
def _find_obligations(
    rows: Floats, nodes: Indices, node_lane: Indices, areas: Areas, ahead: Ahead, coming: Coming
) -> int:
    """Write the obligations on `nodes` into `rows` [., 5]; how many were written."""
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
