"""Gaps along lanes between the ego and the others, and what it costs to move in front of one."""

import math

from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.model.local_map import BESIDE, HALF_LENGTH, UNTIL, LocalMap, State, chain_gap
from sumo_mcts.model.motion import EgoParams, to_the_left, towards_other
from sumo_mcts.numerics.kernel import kernel
from sumo_mcts.numerics.krauss import CAREFUL_S, STANDSTILL, USUAL_S, safe_speed

# m/s by which a careful driver has to slow down for a lane change of the ego. For each time so much
# the change costs as much as a second in a place that the driver is about to need.
TAKEN = 2.5
# The same as a share of the driver's speed; the larger of the two counts. On motorways drivers keep
# shorter distances than a careful driver.
TAKEN_SHARE = 0.2


@kernel
def target_lane(state: State) -> int:
    """The lane that the ego changes to."""
    return state.other if state.progress < 0.5 and state.other >= 0 else state.node


@kernel
def gap_ahead(local: LocalMap, state: State, node: int, s: float) -> float:
    """m from the ego's front to an agent's front, down the ego's lane or the other lane of its
    change; inf: not there."""
    gap = chain_gap(local, state.node, state.s, node, s)
    if state.other >= 0:
        gap = min(gap, chain_gap(local, state.other, state.s, node, s))
    return gap


@kernel
def gap_behind(local: LocalMap, state: State, node: int, s: float) -> float:
    """m from an agent's front to the ego's front, down the agent's lane; inf: its lane does not
    lead to the ego."""
    gap = chain_gap(local, node, s, state.node, state.s)
    if state.other >= 0:
        gap = min(gap, chain_gap(local, node, s, state.other, state.s))
    return gap


@kernel
def gap_to_leaving(local: LocalMap, state: State, i: int, s: float, t: int) -> float:
    """m from the ego's front to the rear of an agent ahead that is leaving the ego's lane: its
    front is in another lane, its rear still here. inf: the agent is none of these."""
    left = lane_left(local, i, t)
    if left < 0:
        return math.inf
    gap = gap_ahead(local, state, left, s) - 2.0 * local.trait[i, HALF_LENGTH]
    return gap if gap > 0.0 else math.inf


@kernel
def lane_left(local: LocalMap, i: int, t: int) -> int:
    """The node of the lane that an agent leaves and is not yet wholly out of; -1: none.

    A vehicle that moves in front of it there makes it brake.
    """
    return int(local.trait[i, BESIDE]) if t <= local.trait[i, UNTIL] else -1


@kernel
def is_beside_in_lane(
    local: LocalMap, p: EgoParams, state: State, node: int, s: float, half_length: float
) -> bool:
    """Whether an agent is beside the ego in a lane that SUMO counts the ego to.

    SUMO calls that a collision, however far aside the ego has moved. It looks before it moves
    vehicles over: at half time the old lane counts for a step more, and another one for SUMO's
    rounding. The new one counts as well then where the rear is still on the lanes before: there it
    looks again.
    """
    lasts = 2.5 * p.step / p.change_duration if p.change_duration > 0.0 else 0.5
    old = 0.5 < state.progress < 0.5 + lasts and state.other >= 0
    if old and _is_beside(local, p, state.s, state.other, node, s, half_length):
        return True
    new = not old or state.s < 2.0 * p.half_length
    return new and _is_beside(local, p, state.s, state.node, node, s, half_length)


@kernel
def _is_beside(
    local: LocalMap, p: EgoParams, ego_s: float, lane: int, node: int, s: float, half_length: float
) -> bool:
    """Whether the ego, at `ego_s` (m) on `lane`, and an agent are beside each other."""
    ahead = chain_gap(local, lane, ego_s, node, s)
    behind = chain_gap(local, node, s, lane, ego_s)
    return 0.0 <= ahead < 2.0 * half_length or 0.0 <= behind < 2.0 * p.half_length


@kernel
def is_seen(local: LocalMap, state: State, node: int, s: float) -> bool:
    """Whether the driver of an agent behind the ego, on `node` at `s` (m), sees it by now.

    Where SUMO divides lanes, drivers in the lane that the ego changes to do not see it before it
    reaches over.
    """
    if math.isinf(local.seen_within) or state.progress <= 0.0 or state.other < 0:
        return True
    apart = abs(to_the_left(local, state.node, state.other, state.s))
    if (1.0 - towards_other(state)) * apart < local.seen_within:
        return True
    return node >= 0 and chain_gap(local, node, s, state.node, state.s) < math.inf


@kernel
def cut_in_cost(
    c: CostParams, gap: float, follower_v: float, ego_v: float, expects: bool = False
) -> float:
    """Cost of moving in front of a follower (gap m, speeds m/s): what speed it takes from a careful
    driver, or from a usual one that `expects` the ego there; -1 where no driver could cope."""
    closing = max(0.0, follower_v - ego_v)
    if gap < 1.0 or closing * closing > 2.0 * c.cut_in_decel_mps2 * (gap - 1.0):
        return -1.0
    # an ego that is faster now may be so no longer when another vehicle slows down ahead of it
    leads_with = min(ego_v, follower_v)
    reaction = USUAL_S if expects else CAREFUL_S
    taken = max(0.0, follower_v - safe_speed(gap - STANDSTILL, leads_with, reaction))
    return c.claim * taken / max(TAKEN, TAKEN_SHARE * follower_v)
