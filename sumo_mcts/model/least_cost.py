"""A lower bound on the cost that is still to come: what the ego loses for certain before the gates
ahead, whatever it does. The search leaves out by it what cannot become the best.

Let `arrives` be when the ego reaches a gate after driving on freely from the end of a sequence.
Progress on the way and at the horizon costs arrives - now - (free driving to the gate), waiting
there at least as long as from `arrives` until the ego passes. Who comes later passes no earlier,
and a second of waiting costs no more than one of progress. So no sequence costs less than to reach
the gate as early as possible and to wait there.
"""

import math

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.arrays import Floats, Indices
from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.model.cost_to_go import passes_at
from sumo_mcts.model.local_map import (
    GAP_S,
    GATE,
    LATEST,
    LINE,
    SPREAD,
    SURE,
    SURE_LATEST,
    SURE_NEXT,
    SURE_SPREAD,
    LocalMap,
    State,
    index_at,
)
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.model.route import LENGTH, LIMIT, NEXT, RouteMap
from sumo_mcts.numerics.kernel import entry, kernel

NONE_YET = -2  # no gate so far
FASTER = 0.02  # share of the limit by which the ego may be faster now: else nothing is certain
# s, and steps, for which it may be faster while it slows down for a limit, and by which distances
# of discrete steps differ from the sum of their speeds
FASTER_S, STEPS = 0.05, 0.5


def fill_sure(
    gate: Floats, to_gate: Floats, closed: NDArray[np.uint8], route: RouteMap, first: int,
    step: float,
) -> None:  # fmt: skip
    """Fill the columns SURE_NEXT .. SURE_SPREAD of LocalMap.gate, and SURE .. SPREAD of
    LocalMap.to_gate.

    `closed` as in LocalMap; `step`: of the simulation, s.
    """
    view, count = slice(first, first + len(to_gate)), len(to_gate)
    at = np.full(count, -1)
    at[gate[:, LINE].astype(np.int64)] = np.arange(len(gate))
    group = np.where(route.internal[view], -1 - np.arange(count), route.leg[view])
    _fill_sure(gate, to_gate, at, closed, group, route.table, first, step)


@entry
def _fill_sure(
    gate: Floats, to_gate: Floats, at: Indices, closed: NDArray[np.uint8], group: Indices,
    table: Floats, first: int, step: float,
) -> None:  # fmt: skip
    """Backwards, the lanes of an edge together: the ego may change between them.

    `at` [W]: the gate at the end of a node, -1: none; `group` [W]: equal for the lanes of an edge,
    and each its own inside junctions.
    """
    w = to_gate.shape[0]
    last = w
    while last > 0:
        n = last - 1
        while n > 0 and group[n - 1] == group[n]:
            n -= 1
        slow, fast, short, long = math.inf, 0.0, math.inf, 0.0
        for i in range(first + n, first + last):
            slow, fast = min(slow, table[i, LIMIT]), max(fast, table[i, LIMIT])
            short, long = min(short, table[i, LENGTH]), max(long, table[i, LENGTH])
        sure, latest, soonest, jump = NONE_YET, 0.0, math.inf, 0.0
        for i in range(n, last):
            after, here, late, soon = int(table[first + i, NEXT]) - first, -1, 0.0, 0.0
            if 0 <= after < w:
                limit = table[first + after, LIMIT]
                jump = max(jump, step * (1.0 - min(slow, limit) / max(fast, limit)))
                here, late = int(to_gate[after, SURE]), to_gate[after, LATEST]
                soon = late - to_gate[after, SPREAD]
                if at[i] >= 0:
                    gate[at[i], SURE_NEXT], gate[at[i], SURE_LATEST] = here, late
                    gate[at[i], SURE_SPREAD] = late - soon
                    here, late, soon = at[i], 0.0, 0.0
            elif after + first < 0 and to_gate[i, GATE] >= 0.0:
                continue  # the lane leads nowhere, and counts as the one that the ego needs
            sure = here if sure == NONE_YET else _merged(gate, closed, sure, here)
            latest, soonest = max(latest, late), min(soonest, soon)
        differ = long * (1.0 / slow - 1.0 / fast)
        latest += long / slow + differ + jump
        soonest += short / fast - differ - jump
        for i in range(n, last):
            to_gate[i, SURE], to_gate[i, LATEST] = max(sure, -1), latest
            to_gate[i, SPREAD] = latest - soonest
        last = n


@kernel
def _merged(gate: Floats, closed: NDArray[np.uint8], one: int, other: int) -> int:
    """A gate that stands for two, since who waits there waits as long; -1: none does."""
    if one < 0 or other < 0 or one == other:
        return one if one == other else -1
    for k in range(GAP_S, gate.shape[1]):
        if gate[one, k] != gate[other, k]:
            return -1
    for t in range(closed.shape[1]):
        if closed[int(gate[one, LINE]), t] != closed[int(gate[other, LINE]), t]:
            return -1
    if gate[one, SURE_NEXT] != gate[other, SURE_NEXT]:
        gate[one, SURE_NEXT] = -1.0
    late, soon = gate[one, SURE_LATEST], gate[one, SURE_LATEST] - gate[one, SURE_SPREAD]
    gate[one, SURE_LATEST] = max(late, gate[other, SURE_LATEST])
    soon = min(soon, gate[other, SURE_LATEST] - gate[other, SURE_SPREAD])
    gate[one, SURE_SPREAD] = gate[one, SURE_LATEST] - soon
    return one


@kernel
def least_cost(
    local: LocalMap, p: EgoParams, c: CostParams, state: State, time: float, horizon: float
) -> float:
    """What every sequence to the `horizon` costs at least, from `state` at `time` (s from now) on,
    unless it ends in a contact or at a closed line."""
    i = state.node - local.first
    if not 0 <= i < local.to_gate.shape[0]:
        return 0.0
    gate, limit = int(local.to_gate[i, SURE]), local.node[state.node, LIMIT]
    if gate < 0 or state.v > (1.0 + FASTER) * limit:
        return 0.0
    spread = local.to_gate[i, SPREAD] + FASTER_S + 2.0 * STEPS * p.step
    # when the ego is at the gate at the latest without losing time; what it has lost for certain
    due, lost = time + local.to_gate[i, LATEST] - state.s / limit + STEPS * p.step, 0.0
    while gate >= 0:
        opens = _opens(local, int(local.gate[gate, LINE]), due + lost - spread, time, horizon)
        if opens > horizon:
            lost = max(lost, horizon - due)
            waits = _waits(local, gate, max(due + lost - spread, horizon), due + lost, horizon)
            if c.beyond_s > 0.0:
                lost += c.beyond_s * (1.0 - math.exp(-waits / c.beyond_s))
            break
        lost = max(lost, opens - p.step - due)
        due += local.gate[gate, SURE_LATEST]
        spread += local.gate[gate, SURE_SPREAD]
        gate = int(local.gate[gate, SURE_NEXT])
    return c.progress * lost


@kernel
def _opens(local: LocalMap, line: int, arrives: float, time: float, horizon: float) -> float:
    """When a line is passed at the earliest that is reached at `arrives`, on yellow perhaps; inf:
    beyond the horizon."""
    if arrives > horizon:
        return math.inf
    last = local.closed.shape[1] - 1
    came, ends = local.yellow[line, 0] - local.dt, local.yellow[line, 1] + local.dt
    for t in range(index_at(local, max(arrives, time)), index_at(local, horizon) + 1):
        if local.closed[line, min(t, last)] == 0 or came < t * local.dt < ends:
            return (t - 0.5) * local.dt
    return math.inf


@kernel
def _waits(local: LocalMap, gate: int, arrives: float, due: float, horizon: float) -> float:
    """s for which the ego waits at least at the gates from `gate` on, which it reaches between
    `arrives` and `due`."""
    most = 0.0
    while gate >= 0:
        passes = passes_at(local, gate, arrives, horizon, 0.0)
        most = max(most, passes - due)
        arrives = passes + local.gate[gate, SURE_LATEST] - local.gate[gate, SURE_SPREAD]
        due += local.gate[gate, SURE_LATEST]
        gate = int(local.gate[gate, SURE_NEXT])
    return most
