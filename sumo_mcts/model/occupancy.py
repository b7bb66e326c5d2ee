"""The predicted occupancy of the others and the ego's yield obligations: where other vehicles are
about to be, and what it costs to be there."""

from sumo_mcts.arrays import Floats
from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.model.kerbs import stands_aside
from sumo_mcts.model.local_map import (
    AGENT,
    CLOCK,
    DRIVEN,
    EAST,
    ENTERS,
    HALF_LENGTH,
    HALF_WIDTH,
    HEAD_ON,
    IN_WAY,
    JOINS,
    JUMPS,
    KERB,
    LATE,
    MERGES,
    NORTH,
    OCCUPANCY_SAMPLES,
    ON_FOOT,
    ONTO,
    OWED,
    OWED_FROM,
    OWN_NODE,
    POLITE,
    REACTS,
    SLOT,
    SOUTH,
    STRETCH_END,
    UNSEEN,
    WALKS,
    WEST,
    LocalMap,
    State,
    V,
    between,
    boxes_meet,
    is_gone,
    on_other_level,
)
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.model.oncoming import OVER_LIMIT
from sumo_mcts.numerics.geometry import COS, SIN, Box, X, Y
from sumo_mcts.numerics.kernel import inlined, kernel
from sumo_mcts.numerics.krauss import STANDSTILL, USUAL_S, safe_gap

LATE_SHARE = 0.5  # of cost.claim, where an agent is if it comes later than its forecast
# Of cost.claim, inside a junction, where an agent with the right of way begins to brake; and what
# the missing share of its safe gap adds: with a quarter missing it is all of cost.claim.
BRAKES_SHARE, GROWTH = 0.5, 2.0
# m, beside a second's way, of who walks where vehicles have the right of way, or jumps over a
# junction and does not see who crosses its path
STEPS = 0.5


@kernel
def may_be_near(local: LocalMap, x: float, y: float, own: float, t: int, i: int) -> bool:
    """Whether the box of agent i, or its predicted occupancy, can be within `own` m of the ego at
    (x, y): one look instead of several."""
    bounds = local.bounds[t, i]
    return (
        bounds[WEST] - own <= x <= bounds[EAST] + own
        and bounds[SOUTH] - own <= y <= bounds[NORTH] + own
    )


@inlined
def occupancy_cost(local: LocalMap, c: CostParams, state: State, box: Box, t: int, i: int) -> float:
    """Cost per second of standing where agent i is predicted to be within claim_s of forecast time
    `t`; the cost is higher the sooner this is."""
    if local.trait[i, POLITE] != 0.0:
        return 0.0
    for k in range(1, OCCUPANCY_SAMPLES + 1):
        at = t + int(k * c.claim_s / OCCUPANCY_SAMPLES / local.dt + 0.5)
        if at >= local.agent.shape[0] or is_gone(local, at, i):
            return 0.0
        if _meets(local, state, box, at, i):
            return (
                0.0
                if on_other_level(local, state.node, state.s, 2.0 * box.half_length, at, i)
                else c.claim * (1.0 - (k - 1.0) / OCCUPANCY_SAMPLES)
            )
    return 0.0


@inlined
def late_cost(local: LocalMap, c: CostParams, state: State, box: Box, t: int, i: int) -> float:
    """Cost per second of being where the agent still is if it comes a little later than its
    forecast."""
    at = t - int(LATE / local.dt + 0.5)
    if at < 0 or is_gone(local, at, i):
        return 0.0
    if not _meets(local, state, box, at, i) or on_other_level(
        local, state.node, state.s, 2.0 * box.half_length, at, i
    ):
        return 0.0
    return c.claim * LATE_SHARE


@inlined
def _meets(local: LocalMap, state: State, box: Box, at: int, i: int) -> bool:
    """Whether the ego's box, where it is now, meets that of agent i at forecast time `at`."""
    length, width = local.trait[i, HALF_LENGTH], local.trait[i, HALF_WIDTH]
    reach = box.half_length + length + box.half_width + width
    x, y = local.agent[at, i, X], local.agent[at, i, Y]
    if abs(x - box.x) >= reach or abs(y - box.y) >= reach:
        return False
    other = Box(x, y, local.agent[at, i, COS], local.agent[at, i, SIN], length, width)
    return boxes_meet(local, state.node, state.s, box.half_length, box, other, at, i)


@kernel
def yielding_cost(
    local: LocalMap, p: EgoParams, c: CostParams, state: State, others: Floats, t: int
) -> float:
    """Cost per second of being inside a junction while an agent with the right of way comes near,
    or in the lane of one that comes towards the ego. Drivers brake for any vehicle there."""
    rate = 0.0
    for k in range(local.obligation.shape[0]):
        node, i = int(local.obligation[k, OWN_NODE]), int(local.obligation[k, AGENT])
        # Where a turn has a place to wait, its path through the junction is two lanes: those that
        # it yields to on the second pass a vehicle that waits on the first.
        kind = local.obligation[k, MERGES]
        head_on, crosses, jumps = kind in (UNSEEN, HEAD_ON), kind == JUMPS, kind >= JUMPS
        if kind == UNSEEN and local.committed:  # it may have to brake
            continue
        here = node == state.node or (head_on and node == state.other)
        # who is in its way may stop there: then the ego has to be able to stop, too
        stops = state.v * state.v / (2.0 * p.comfort_decel) if kind == IN_WAY else 0.0
        if not here or state.s + stops < local.obligation[k, OWED_FROM]:
            continue
        end = local.obligation[k, STRETCH_END]
        if (0.0 if jumps else end) - state.s + 2.0 * p.half_length < 0.0:
            continue
        if local.trait[i, ON_FOOT] > 0.0 and local.agent[t, i, V] == 0.0:
            continue  # it waits for its signal
        driven = local.agent[t, i, DRIVEN]
        if local.trait[i, OWED] >= 0.0 and local.trait[i, SLOT] >= 0.0:
            if stands_aside(local, p, state, others, i):
                continue
            driven = between(local, i, others[int(local.trait[i, SLOT]), CLOCK], DRIVEN)
        distance = local.obligation[k, ENTERS] - driven
        if head_on:
            distance -= state.s
        if kind == IN_WAY:
            there = distance > 0.0 and driven >= local.obligation[k, KERB]
            rate = max(rate, c.claim) if there else rate
            continue
        # To a driver in SUMO, a vehicle that crosses its path is as good as standing there; one
        # that merges drives ahead of it.
        ahead_v = state.v if kind in (ONTO, JOINS) else 0.0
        needed = STANDSTILL + safe_gap(local.agent[t, i, V], ahead_v, USUAL_S)
        if head_on:
            needed = room_to_stop(local, k, t)
        if kind == WALKS or crosses:
            needed = STEPS + local.agent[t, i, V] * USUAL_S
        # who jumps is over with its rear
        least = -2.0 * local.trait[i, HALF_LENGTH] if crosses else 0.0
        if least < distance < needed:
            v = local.agent[t, i, V]
            # an agent that can stop in comfort may have to for an ego that has waited long
            copes = v * v < 2.0 * c.cut_in_decel_mps2 * max(distance - STANDSTILL, 0.0)
            # who is on foot does not wait for it, nor does who jumps over the junction
            reacts = local.trait[i, REACTS] > 0.0 and not crosses
            share = local.patience if copes and reacts and not head_on else 1.0
            # the price of the whole way through the junction, at its end
            share *= 1.0 + end / (2.0 * p.half_length) if jumps else 1.0
            rate = max(rate, share * c.claim * brakes_share(distance, needed))
    return rate


@kernel
def room_to_stop(local: LocalMap, k: int, t: int) -> float:
    """m that the agent of an obligation needs to stop as SUMO's drivers usually do; one that is not
    seen if it drives at the limit."""
    v = local.agent[t, int(local.obligation[k, AGENT]), V]
    if local.obligation[k, MERGES] == UNSEEN:
        v /= OVER_LIMIT
    return STANDSTILL + safe_gap(v, 0.0, USUAL_S)


@kernel
def brakes_share(distance: float, needed: float) -> float:
    """Share of cost.claim for an agent that is so near, m, and needs more for its safe gap."""
    return min(1.0, BRAKES_SHARE + GROWTH * (1.0 - distance / needed)) if distance < needed else 0.0


@kernel
def someone_comes(local: LocalMap, p: EgoParams, node: int, s: float, t: int) -> bool:
    """Whether an agent in a lane of oncoming traffic is too near to stop for an ego at s on `node`,
    or is beside it. SUMO's drivers brake for an ego as soon as it begins to move over."""
    for k in range(local.obligation.shape[0]):
        if int(local.obligation[k, OWN_NODE]) != node or local.obligation[k, MERGES] != HEAD_ON:
            continue
        i = int(local.obligation[k, AGENT])
        distance = local.obligation[k, ENTERS] - local.agent[t, i, DRIVEN] - s
        beside = -2.0 * (p.half_length + local.trait[i, HALF_LENGTH])
        if beside < distance < room_to_stop(local, k, t):
            return True
    return False
