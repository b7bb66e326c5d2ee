"""What it costs to be in a lane of oncoming traffic at the horizon: the time until the ego is back
where that is in time, else as much as a contact."""

import math
from typing import NamedTuple

from sumo_mcts.model.cost import LEAST_LOSS, behind, is_against, stuck_behind
from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.model.local_map import (
    AGENT,
    DRIVEN,
    ENTERS,
    HALF_LENGTH,
    HEAD_ON,
    MERGES,
    ONCOMING,
    OWN_NODE,
    UNSEEN,
    LocalMap,
    S,
    State,
    V,
    chain_gap,
    index_at,
    node_of,
)
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.model.occupancy import brakes_share, room_to_stop
from sumo_mcts.model.route import HOME, LIMIT, REACH
from sumo_mcts.numerics.kernel import kernel
from sumo_mcts.numerics.krauss import CAREFUL_S, STANDSTILL, USUAL_S

PLATOON = 4  # vehicles without a gap between them that may be overtaken beyond the horizon
LEAST_FASTER = 1.0  # m/s
LONGEST_S = 20.0  # beyond the horizon


class _Return(NamedTuple):
    """How an overtaking ends, all at the speeds of one time of the forecast."""

    to: float  # m ahead of the ego to where its front is then, behind those ahead
    seconds: float  # until the ego is back in its lane, ahead of those that it overtakes
    gap: float  # m that it then has, or would have now, to the next vehicle ahead; inf: none
    leader_v: float  # m/s


@kernel
def unfinished(local: LocalMap, p: EgoParams, c: CostParams, state: State, time: float) -> float:
    """The cost of an overtaking that is under way at the horizon, `time` s from now: to complete
    it, and to be behind the next vehicle then."""
    if is_against(local, state) == 0.0:
        return 0.0
    there = state.node
    if local.to_leave[there - local.first, ONCOMING] == 0.0:
        there = state.other
    t = min(index_at(local, time), local.agent.shape[0] - 1)
    back = _return(local, p, state, there, t, 0.0)
    cost = _cost(local, c, state, there, back, time)
    if back.gap < math.inf:  # or past the next one ahead, too
        further = _return(local, p, state, there, t, back.to + back.gap)
        cost = min(cost, _cost(local, c, state, there, further, time))
    return cost


@kernel
def _cost(
    local: LocalMap, c: CostParams, state: State, there: int, back: _Return, time: float
) -> float:
    """The cost of ending an overtaking like that: half of a contact where it is not in time."""
    # beyond the end of the lane there may be others that are not known to come
    free = local.node[there, REACH] - state.s
    least = LEAST_LOSS * c.contact
    if back.seconds > LONGEST_S or (state.v + local.node[there, LIMIT]) * back.seconds >= free:
        return least
    t = min(index_at(local, time), local.agent.shape[0] - 1)
    rate = c.route * abs(local.urgency[there - local.first])
    owed = _share_owed(local, state, there, t, back.seconds)
    if math.isinf(owed):
        return least
    lost = behind(local, c, back.gap, back.leader_v)
    lost += stuck_behind(local, int(local.node[there, HOME]), state.s, back.to, time)
    return min(
        c.lane_change + rate * back.seconds + c.claim * owed + c.progress * c.tail_s * lost, least
    )


@kernel
def _return(local: LocalMap, p: EgoParams, state: State, there: int, t: int, to: float) -> _Return:
    """How the ego gets back into its lane, from a state at forecast time `t`, at `to` m ahead or
    where it is past those that are there."""
    home, v = int(local.node[there, HOME]), 0.0
    gap, leader_v = math.inf, 0.0
    for _ in range(PLATOON + 1):
        before, gap, leader_v = to, math.inf, 0.0
        for i in range(local.agent.shape[1]):
            node, s, theirs = node_of(local, t, i), local.agent[t, i, S], local.agent[t, i, V]
            ahead = chain_gap(local, home, state.s, node, s) if node >= 0 else math.inf
            if ahead == math.inf:  # or it is behind
                ahead = -chain_gap(local, node, s, home, state.s) if node >= 0 else math.inf
            clear = ahead + STANDSTILL + CAREFUL_S * theirs + 2.0 * p.half_length
            rear = ahead - 2.0 * local.trait[i, HALF_LENGTH]
            if rear - p.gap < to < clear:
                to, v = clear, theirs
            elif to <= rear - p.gap and rear - to < gap:
                gap, leader_v = rear - to, theirs
        if to == before:
            break
    if to != before or (to > 0.0 and state.v - v < LEAST_FASTER):
        return _Return(to, math.inf, gap, leader_v)
    passing = to / (state.v - v) if to > 0.0 else 0.0
    return _Return(to, passing + p.change_duration, gap, leader_v)


@kernel
def _share_owed(local: LocalMap, state: State, there: int, t: int, seconds: float) -> float:
    """Share of a second's price of standing in the way of one of the oncoming that is owed to them
    by an ego that is that long in their lane; inf: it comes too near to one."""
    share = 0.0
    for k in range(local.obligation.shape[0]):
        kind = local.obligation[k, MERGES]
        if int(local.obligation[k, OWN_NODE]) != there or kind not in (HEAD_ON, UNSEEN):
            continue
        i = int(local.obligation[k, AGENT])
        v = local.agent[t, i, V]
        distance = local.obligation[k, ENTERS] - local.agent[t, i, DRIVEN] - state.s
        if distance < -2.0 * local.trait[i, HALF_LENGTH]:
            continue
        left = distance - (state.v + v) * seconds
        if left < USUAL_S * v:
            return math.inf
        if kind == UNSEEN and local.committed:  # it may have to brake
            continue
        owed = brakes_share(left, room_to_stop(local, k, t))
        if owed > 0.0 and not local.committed:  # only an ego that is there already goes on
            return math.inf
        share = max(share, owed)
    return share
