"""What the local maps hold of the agents at each time of the forecast: for all hypotheses at
once."""

from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices, Ints
from sumo_mcts.model.local_map import (
    DRIVEN,
    EAST,
    ELSEWHERE,
    GONE,
    KINDS,
    LATE,
    NEARBY,
    NODE,
    NORTH,
    OCCUPANCY_SAMPLES,
    SOUTH,
    UPSTREAM,
    WEST,
    S,
    V,
)
from sumo_mcts.model.route import RouteMap, Upstream
from sumo_mcts.numerics.drawn import drawn_shares
from sumo_mcts.numerics.geometry import COS, SIN, X, Y
from sumo_mcts.numerics.kernel import entry, kernel
from sumo_mcts.numerics.lanes import opposed
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Forecast


class Moving(NamedTuple):
    """The fields of a Forecast that the tables are made of. H hypotheses, T times, N agents."""

    pose: Floats  # [H, T, N, 4]
    v: Floats  # [H, T, N]
    lane: Ints  # [H, T, N]
    s: Floats  # [H, T, N]
    valid: Bools  # [H, T, N]
    half_length: Floats  # [N]
    half_width: Floats  # [N]


class Tables(NamedTuple):
    """Fields of LocalMap, and columns of LocalMap.agent, in each hypothesis."""

    node: Indices  # [H, T, N] column NODE
    position: Floats  # [H, T, N] column S
    driven: Floats  # [H, T, N] column DRIVEN
    agent: Floats  # [H, T, N, 8]
    bounds: Floats  # [H, T, N, 4]
    place: Indices  # [H, T, N]


def moving(forecast: Forecast, count: int) -> Moving:
    """The first `count` hypotheses of a forecast."""
    return Moving(
        pose=forecast.pose[:count],
        v=forecast.v[:count],
        lane=forecast.lane[:count],
        s=forecast.s[:count],
        valid=forecast.valid[:count],
        half_length=forecast.half_length,
        half_width=forecast.half_width,
    )


def tables_of(
    length: Floats, upstream: Upstream, lane_node: Indices, those: Indices, agents: Moving,
    dt: float, claim_s: float,
) -> Tables:  # fmt: skip
    """The tables of `agents`, who drive on `those` lanes, at times `dt` s apart.

    Of each lane of the road [L] its `length`, m, and the route's node `lane_node`, -1: none;
    `upstream` as in RouteMap, `claim_s` as in Rules.
    """
    shape = agents.lane.shape
    tables = Tables(
        node=np.empty(shape, np.int64),
        position=np.empty(shape),
        driven=np.empty(shape),
        agent=np.empty((*shape, DRIVEN + 1)),
        bounds=np.empty((*shape, NORTH + 1)),
        place=np.empty(shape, np.int64),
    )
    to, column = np.full((2, len(lane_node)), -1)
    column[those] = np.arange(len(those))
    # the times, in steps of the forecast from now, at which a box counts too
    shifts = [-int(LATE / dt + 0.5)]
    shifts += [
        int(k * claim_s / OCCUPANCY_SAMPLES / dt + 0.5) for k in range(1, OCCUPANCY_SAMPLES + 1)
    ]
    _fill(tables, agents, lane_node, upstream, to, column, length, np.array(shifts), dt)
    return tables


def lanes_of(agents: Moving, lanes: int) -> Indices:
    """The lanes that agents drive on, of so many that the road has."""
    driven = np.zeros(lanes + 1, np.bool_)
    driven[agents.lane] = True  # off the road: the one more
    return np.flatnonzero(driven[:-1])


@entry
def _fill(
    out: Tables, agents: Moving, lane_node: Indices, upstream: Upstream, to: Indices,
    column: Indices, length: Floats, shifts: Indices, dt: float,
) -> None:  # fmt: skip
    """Fill the tables. Working memory [lanes of the road]: `to`, all -1. `column` [lanes of the
    road] of LocalMap.level, `length` of each lane (m), `shifts`: see tables_of."""
    for k in range(len(upstream.lane)):
        if lane_node[upstream.onto[k]] >= 0:
            to[upstream.lane[k]] = k
    hypotheses, times, n = agents.lane.shape
    for h in range(hypotheses):
        for i in range(n):
            _fill_driven(out, agents, h, i, dt)
            _fill_nodes(out, agents, lane_node, upstream, to, h, i)
        for t in range(times):
            for i in range(n):
                lane, near = agents.lane[h, t, i], NEARBY + 2.0 * agents.half_length[i]
                out.place[h, t, i] = -1
                if lane >= 0:
                    bits = 1 + 2 * int(length[lane] - agents.s[h, t, i] < near)
                    bits += 4 * int(agents.s[h, t, i] < near)
                    out.place[h, t, i] = (column[lane] << KINDS) + bits
                row = out.agent[h, t, i]
                row[X], row[Y] = agents.pose[h, t, i, X], agents.pose[h, t, i, Y]
                row[COS], row[SIN] = agents.pose[h, t, i, COS], agents.pose[h, t, i, SIN]
                row[V], row[NODE] = agents.v[h, t, i], out.node[h, t, i]
                row[S], row[DRIVEN] = out.position[h, t, i], out.driven[h, t, i]
                _fill_bounds(out.bounds[h, t, i], agents, shifts, h, t, i, dt)


@kernel
def _fill_driven(out: Tables, agents: Moving, h: int, i: int, dt: float) -> None:
    """Column DRIVEN of agent i."""
    out.driven[h, 0, i] = 0.0
    for t in range(1, agents.lane.shape[1]):
        moved = 0.5 * (agents.v[h, t, i] + agents.v[h, t - 1, i]) * dt
        if agents.lane[h, t, i] == agents.lane[h, t - 1, i] >= 0:
            moved = agents.s[h, t, i] - agents.s[h, t - 1, i]
        out.driven[h, t, i] = out.driven[h, t - 1, i] + moved


@kernel
def _fill_nodes(
    out: Tables, agents: Moving, lane_node: Indices, upstream: Upstream, to: Indices, h: int, i: int
) -> None:
    """Columns NODE and S of agent i. On lanes that lead into the ego's, unless it turns off, they
    are the node that it comes to, and its position from the start of that (negative), m."""
    comes = True  # assumed at the end of the forecast
    for t in range(agents.lane.shape[1] - 1, -1, -1):
        lane = agents.lane[h, t, i]
        node = lane_node[lane] if lane >= 0 else ELSEWHERE
        node = node if agents.valid[h, t, i] else GONE
        position = agents.s[h, t, i]
        if node != ELSEWHERE:
            comes = node >= 0
        else:
            k = to[lane] if comes and lane >= 0 else -1
            comes = k >= 0
            if comes:
                node = UPSTREAM - lane_node[upstream.onto[k]]
                position += upstream.begin[k]
        out.node[h, t, i], out.position[h, t, i] = node, position


@kernel
def _fill_bounds(
    row: Floats, agents: Moving, shifts: Indices, h: int, t: int, i: int, dt: float
) -> None:
    """LocalMap.bounds of agent i at the t-th time.

    The bounds are too large rather than too small. They serve to skip distant agents quickly.
    """
    half, last = agents.half_length[i] + agents.half_width[i], agents.lane.shape[1] - 1
    swept = half + 0.5 * agents.v[h, t, i] * dt
    x, y = agents.pose[h, t, i, X], agents.pose[h, t, i, Y]
    west, east, south, north = x - swept, x + swept, y - swept, y + swept
    for shift in shifts:
        then = min(max(t + shift, 0), last)
        x, y = agents.pose[h, then, i, X], agents.pose[h, then, i, Y]
        west, east = min(west, x - half), max(east, x + half)
        south, north = min(south, y - half), max(north, y + half)
    row[WEST], row[EAST], row[SOUTH], row[NORTH] = west, east, south, north


def levels(road: RoadMap, own: Indices, those: Indices) -> Indices:
    """LocalMap.level [W, K]: which of the ego's lanes `own` [W] may touch which lanes `those` [K]
    of agents: not those on bridges.

    Boxes that overlap in the plane touch only on the same edge, or near a junction cluster of both
    lanes. Elsewhere one road is a bridge over the other.

    A lane has clusters of three kinds: 0 the one it lies in, 1 the one where it ends, 2 the one
    where it begins. Bit 3 i + j: cluster i of the ego's lane is cluster j of the other lane; bit 0
    is set on the same edge too. Bit j of LocalMap.place: the agent is near cluster j of its lane;
    bit 0 always.
    """
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
    return level


def drawn(route: RouteMap, view: slice, agents: Moving) -> list[Floats]:
    """LocalMap.drawn in each hypothesis."""
    near, in_full = route.drawing.near, np.zeros((0, 0))
    if not len(near):
        return [in_full] * len(agents.lane)
    shorter: Bools = np.asarray(np.append(near, False)[agents.lane].any(axis=(1, 2)))
    shorter |= near[route.lane[view]].any()
    if not shorter.any():
        return [in_full] * len(agents.lane)
    shares = drawn_shares(route.drawing, agents.lane, agents.s, 2.0 * agents.half_length)
    return [each if some else in_full for each, some in zip(shares, shorter, strict=True)]
