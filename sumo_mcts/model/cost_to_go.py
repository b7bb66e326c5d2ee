"""The cost-to-go: the time that is still to be lost beyond the horizon, where the ego may have to
wait on its route.

A gate is such a place: a stop line with a signal, or the place before a stretch of a junction that
the ego has to leave to others. Gates are built once a cycle, of what is seen then; the search asks
for each of its last states how long the ego would wait at all of them, one after the other.
"""

import math
from collections.abc import Collection

import numpy as np

from sumo_mcts.arrays import Floats, Indices
from sumo_mcts.model.local_map import (
    AGENT,
    AWAY,
    CLOSES,
    ENTERS,
    FREE_S,
    GAP_S,
    GATE,
    IN_WAY,
    LINE,
    MERGES,
    NEXT_FREE_S,
    NEXT_GATE,
    OPENINGS,
    OPENS,
    OWN_NODE,
    QUEUE,
    SPREAD,
    STREAM_S,
    STRETCH_END,
    LocalMap,
    S,
    State,
    chain_gap,
    follows,
    index_at,
    node_of,
)
from sumo_mcts.model.route import LENGTH, LIMIT, NEXT, RouteMap
from sumo_mcts.numerics.kernel import entry, kernel
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import AFTER_STOP, GREEN, Signals

DISCHARGE_S = 2.0  # s between two vehicles of a queue that starts
UNKNOWN_S = 20.0  # s expected at a light of which no coming green is known
# m/s2: acceleration with which the ego is taken to start, and to regain lost speed
PICK_UP = 2.6
REACT_S = 1.0  # s until it starts
MOST_GAP_S = 20.0  # s expected at most until a stream has a gap: it may end before


def gates(
    road: RoadMap, route: RouteMap, first: int, last: int, signals: Signals, gap_s: Floats
) -> tuple[Floats, Floats]:
    """LocalMap.gate [G, .] and LocalMap.to_gate [W, 7] of the nodes [first, last), but for what
    least_cost.py fills in.

    `gap_s` [W]: seconds expected until the streams that a node yields to have a gap.
    """
    view = slice(first, last)
    after = route.next[view] - first
    inside = (after >= 0) & (after < last - first)
    gap = np.where(inside, gap_s[after * inside], 0.0)
    signalled = route.stop[view] & (route.signal[view] >= 0)
    those = np.flatnonzero(inside & (signalled | (gap > 0.0)))
    gate = np.full((len(those), CLOSES + 2 * OPENINGS), np.inf)
    for row, i in zip(gate, those.tolist(), strict=True):
        n = first + i
        row[LINE], row[GAP_S], row[STREAM_S] = i, gap[i], 0.0
        if gap[i] > 0.0:
            row[STREAM_S] = _stream_ends(road, int(route.lane[route.next[n]]), signals)
        openings = (
            open_times(signals, int(route.signal[n]), int(route.link[n]), (GREEN, AFTER_STOP))[
                :OPENINGS
            ]
            if signalled[i]
            else [(0.0, math.inf)]
        )
        row[OPENS : OPENS + 2 * len(openings)] = np.ravel(openings)
    to_gate = np.full((last - first, SPREAD + 1), np.inf)
    at = np.full(last - first, -1)
    at[those] = np.arange(len(those))
    _fill_to_gate(to_gate, gate, at, route.table, _needed(route, first, last), first)
    return gate, to_gate


def _needed(route: RouteMap, first: int, last: int) -> Indices:
    """[W] the lane beside each node to which the route has it change, as far as lanes lie there;
    counted from `first`."""
    found, left = np.arange(last - first), route.changes[first:last].copy()
    for _ in range(int(np.abs(left).max(initial=0))):
        here = first + found
        beside = np.where(left > 0, route.left[here], route.right[here]) - first
        moves = (left != 0) & (beside >= 0) & (beside < last - first)
        found = np.where(moves, beside, found)
        left = np.where(moves, left - np.sign(left), 0)
    return found


@entry
def _fill_to_gate(
    to_gate: Floats, gate: Floats, at: Indices, table: Floats, needed: Indices, first: int
) -> None:
    """Fill LocalMap.to_gate, and NEXT_GATE and NEXT_FREE_S of the gates; `at` [W]: the gate at the
    end of a node, -1: none.

    A lane that the route leaves has the gates and the queue of the lane that it needs, and so has
    what leads onto it: neither leaving the queue nor staying before it saves anything.
    """
    w = to_gate.shape[0]
    for i in range(w - 1, -1, -1):
        n = first + i
        after = int(table[n, NEXT]) - first
        if 0 <= after < w:
            after = needed[after]
        to_gate[i, GATE], to_gate[i, QUEUE] = -1.0, n
        g = at[i]
        if g >= 0:
            gate[g, NEXT_GATE] = to_gate[after, GATE]
            gate[g, NEXT_FREE_S] = to_gate[after, FREE_S]
            to_gate[i, GATE], to_gate[i, FREE_S], to_gate[i, AWAY] = g, 0.0, 0.0
        elif 0 <= after < w and to_gate[after, GATE] >= 0.0:
            for k in (GATE, FREE_S, AWAY):
                to_gate[i, k] = to_gate[after, k]
        to_gate[i, FREE_S] += table[n, LENGTH] / table[n, LIMIT]
        to_gate[i, AWAY] += table[n, LENGTH]
    for i in range(w):
        for k in range(QUEUE + 1):
            to_gate[i, k] = to_gate[needed[i], k]


def open_times(
    signals: Signals, signal: int, link: int, may_go: Collection[int] = (GREEN,)
) -> list[tuple[float, float]]:
    """The times from now (s) at which a link begins and ends to show one of the states `may_go`, as
    far as known."""
    shows = signals.state[signals.offset[signal] + link]
    until = signals.until[signal]
    found: list[tuple[float, float]] = []
    begin = 0.0
    for state, end in zip(shows.tolist(), until.tolist(), strict=True):
        if state in may_go:
            if found and found[-1][1] == begin:
                found[-1] = (found[-1][0], end)
            else:
                found.append((begin, end))
        begin = end
        if math.isinf(end):
            break
    return found


def _stream_ends(road: RoadMap, lane: int, signals: Signals) -> float:
    """s until the last of the streams that `lane` yields to is stopped by its signal; inf: never,
    as far as known."""
    ends = 0.0
    for e in range(road.conflict_offset[lane], road.conflict_offset[lane + 1]):
        other = int(road.conflict_lane[e])
        if not road.conflict_yields[e]:
            continue
        if road.signal[other] < 0:
            return math.inf
        times = open_times(signals, int(road.signal[other]), int(road.link[other]))
        if times and times[0][0] == 0.0:
            ends = max(ends, times[0][1])
    return ends


def gap_times(
    owed: Floats, leg: Indices, first: int, last: int, seconds: float, length: float
) -> Floats:
    """[W] s expected until there is a gap in the streams that each node yields to.

    `owed`: LocalMap.obligation; `leg` as in RouteMap; `seconds`: of the forecast, in which they
    come; `length`: of the ego, m.
    A stream without memory of q vehicles a second has a gap of t s after (exp(q t) - 1 - q t) / q
    seconds in the mean (Adams 1936). Lanes side by side wait for the same gap: the longest wait
    counts for all of them, or the ego would change lanes for a difference that is noise.
    """
    found = np.zeros(last - first)
    # the others wait at the kerb, or are counted when they enter
    owed = owed[(owed[:, ENTERS] < math.inf) & (owed[:, MERGES] != IN_WAY)]
    if not len(owed):
        return found
    nodes = owed[:, OWN_NODE].astype(np.int64)
    for n in np.unique(nodes):
        rows = owed[nodes == n]
        rate = len(np.unique(rows[:, AGENT])) / seconds
        clears = REACT_S + math.sqrt(2.0 * (rows[:, STRETCH_END].max() + length) / PICK_UP)
        x = rate * clears
        found[n - first] = min((math.exp(min(x, 50.0)) - 1.0 - x) / rate, MOST_GAP_S)
    for here in np.unique(leg[np.unique(nodes)]):
        beside = (leg[first:last] == here) & (found > 0.0)
        found[beside] = found[beside].max()
    return found


@kernel
def waiting_s(local: LocalMap, state: State, time: float, lost: float) -> float:
    """s that the ego waits at the gates ahead when it is in `state` at `time` (s from now), and has
    `lost` s to lose until it drives as fast as it may."""
    i = state.node - local.first
    if not 0 <= i < local.to_gate.shape[0]:
        return 0.0
    gate = int(local.to_gate[i, GATE])
    if gate < 0:
        return 0.0
    arrives = (
        time + lost + max(local.to_gate[i, FREE_S] - state.s / local.node[state.node, LIMIT], 0.0)
    )
    queue, waits = DISCHARGE_S * _queued(local, state, time), 0.0
    while gate >= 0:
        passes = passes_at(local, gate, arrives, time, queue)
        waits += passes - arrives
        arrives = passes + local.gate[gate, NEXT_FREE_S]
        gate, queue = int(local.gate[gate, NEXT_GATE]), 0.0
    return waits


@entry
def expected_wait(local: LocalMap, state: State, time: float, lost: float) -> float:
    """The same for Python."""
    return waiting_s(local, state, time, lost)


@kernel
def passes_at(local: LocalMap, gate: int, arrives: float, time: float, queue: float) -> float:
    """When the ego passes a gate that it reaches at `arrives`, in the mean, s from now.

    `queue`: s that those need who stand before it.
    """
    gap, stream = local.gate[gate, GAP_S], local.gate[gate, STREAM_S]
    share, mean, now = 1.0, 0.0, arrives  # share: how likely it still waits at `now`
    for k in range(OPENINGS):
        opens, closes = local.gate[gate, OPENS + 2 * k], local.gate[gate, CLOSES + 2 * k]
        if math.isinf(opens):
            break
        if closes <= now:  # who leaves then is not counted: waits are expected too short anyway
            continue
        opens = max(opens, time)
        start = max(now, opens + queue)
        if start >= closes:
            queue = max(queue - (closes - opens), 0.0)
            continue
        queue = 0.0  # it is the first one then
        mean += share * (start - now)
        busy = max(min(closes, stream) - start, 0.0)
        if gap > 0.0 and busy > 0.0:
            goes_on = math.exp(-busy / gap)
            mean += share * gap * (1.0 - goes_on)
            share *= goes_on
        if stream < closes or gap <= 0.0 or math.isinf(closes):
            return arrives + mean
        now = closes
    return arrives + mean + share * UNKNOWN_S


@kernel
def _queued(local: LocalMap, state: State, time: float) -> int:
    """How many vehicles are between the ego and its next gate at `time`, in the lane that it
    needs."""
    i, now, count = state.node - local.first, index_at(local, time), 0
    lane, away = int(local.to_gate[i, QUEUE]), local.to_gate[i, AWAY] - state.s
    now = min(now, local.agent.shape[0] - 1)
    for j in range(local.agent.shape[1]):
        node = node_of(local, now, j)
        if node < 0:
            continue
        gap = chain_gap(local, lane, state.s, node, local.agent[now, j, S])
        if 0.0 < gap < away and not follows(local, local.followers, j):
            count += 1
    return count
