"""What it costs to be in a lane of oncoming traffic at the horizon: the time until the ego is back
where that is in time, else as much as a contact."""

import math

from sumo_mcts.model.cost import LEAST_LOSS, is_against
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
    LocalMap,
    S,
    State,
    V,
    index_at,
    node_of,
)
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.model.route import LENGTH, LIMIT, RIGHT_NODE
from sumo_mcts.numerics.kernel import kernel
from sumo_mcts.numerics.krauss import CAREFUL_S, STANDSTILL, USUAL_S, safe_gap

PLATOON = 4  # vehicles without a gap between them that may be overtaken beyond the horizon
LEAST_FASTER = 1.0  # m/s
LONGEST_S = 6.0  # beyond the horizon


@kernel
def unfinished(local: LocalMap, p: EgoParams, c: CostParams, state: State, time: float) -> float:
    """The cost of an overtaking that is under way at the horizon, `time` s from now."""
    if is_against(local, state) == 0.0:
        return 0.0
    there = state.node
    if local.to_leave[there - local.first, ONCOMING] == 0.0:
        there = state.other
    t = min(index_at(local, time), local.agent.shape[0] - 1)
    seconds = _seconds_left(local, p, state, there, t)
    # beyond the end of the lane there may be others that are not known to come
    free = local.node[there, LENGTH] - state.s
    if seconds <= LONGEST_S and (state.v + local.node[there, LIMIT]) * seconds < free:
        if not _is_met(local, state, there, t, seconds):
            return c.route * abs(local.urgency[there - local.first]) * seconds
    return LEAST_LOSS * c.contact


@kernel
def _seconds_left(local: LocalMap, p: EgoParams, state: State, there: int, t: int) -> float:
    """s until the ego is back in its lane, ahead of those that it overtakes, all at the speeds of
    forecast time `t`."""
    own, to, v = int(local.node[there, RIGHT_NODE]), state.s, 0.0
    for _ in range(PLATOON):
        for i in range(local.agent.shape[1]):
            if node_of(local, t, i) != own:
                continue
            s, theirs = local.agent[t, i, S], local.agent[t, i, V]
            clear = s + STANDSTILL + CAREFUL_S * theirs + 2.0 * p.half_length
            if s - 2.0 * local.trait[i, HALF_LENGTH] - p.gap < to < clear:
                to, v = clear, theirs
    if to == state.s:
        return p.change_duration
    if state.v - v < LEAST_FASTER:
        return math.inf
    return (to - state.s) / (state.v - v) + p.change_duration


@kernel
def _is_met(local: LocalMap, state: State, there: int, t: int, seconds: float) -> bool:
    """Whether the ego, that long in the lane of the oncoming, comes too near to one of them."""
    for k in range(local.obligation.shape[0]):
        kind = local.obligation[k, MERGES]
        if int(local.obligation[k, OWN_NODE]) != there or kind < HEAD_ON:
            continue
        i = int(local.obligation[k, AGENT])
        v = local.agent[t, i, V]
        distance = local.obligation[k, ENTERS] - local.agent[t, i, DRIVEN] - state.s
        # who is not seen may have to brake
        keeps = STANDSTILL + safe_gap(v, 0.0, USUAL_S) if kind == HEAD_ON else USUAL_S * v
        passed = distance < -2.0 * local.trait[i, HALF_LENGTH]
        if not passed and distance < (state.v + v) * seconds + keeps:
            return True
    return False
