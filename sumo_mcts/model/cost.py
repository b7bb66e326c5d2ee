"""The four terms of J (paper, equation 1) for planner `mcts`.

One unit is one second of standing still.
"""

import math

from sumo_mcts.model.cost_params import CostParams, Term
from sumo_mcts.model.local_map import LocalMap, State
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.model.route import INTERNAL, LIMIT, NEXT, REACH, RIGHT_NODE, STATION
from sumo_mcts.numerics.kernel import kernel

PICK_UP = 2.6  # m/s2 with which lost speed is valued
TAIL_SLOPE = 0.4  # of 1 / limit: how fast a slow leader's cost falls with the gap
SLOW = 1.0  # m/s below which the ego stands in the way of others
# rad between box and lane from which the rear is still in the lane that the ego leaves
STRADDLING = 0.2
STANDS_BEFORE = 2.0  # m before the line of a stop sign: the place to stand
NEAR_SIGN = 5.0  # m before that place within which less and less of a second counts as lost,
ROLLS = 0.3  # m/s below which, there, likewise
UP_TO_SIGN = 30.0  # m before that place within which the distance to it counts at the horizon,
MOVE_UP = 4.0  # m/s as if driven with this
# by how much dearer, at the horizon, a lane is that the route leaves if the ego cannot get as fast
# any more as those it has to move between
RUN_UP = 0.1


@kernel
def step_comfort(p: EgoParams, c: CostParams, before: State, after: State) -> float:
    """C_c of one simulation step: k j^2, saturating, and braking and accelerating hard."""
    jerk = (after.a - before.a) / p.step
    beyond = max(0.0, -after.a - p.comfort_decel)
    rate = (
        c.jerk * min(jerk * jerk, 100.0)
        + c.acceleration * after.a * after.a
        + c.braking * beyond * beyond
    )
    return rate * p.step


@kernel
def step_passability(local: LocalMap, p: EgoParams, c: CostParams, after: State) -> float:
    """C_p of one simulation step: time lost against the limit or before a stop sign, a lane that
    the route leaves, standing in a junction or straddling lanes."""
    limit = local.node[after.node, LIMIT]
    rate = c.progress * (1.0 - min(after.v, limit) / limit + _before_sign(local, after))
    rate += c.route * _urgent(local, after.node)
    if after.v < SLOW:
        if local.node[after.node, INTERNAL] > 0.0:
            rate += c.blocking
        # an ego that is held at a dead end leaves it as it can
        if abs(after.turn) > STRADDLING and not leads_nowhere(local, after.node):
            rate += c.astride
    return rate * p.step


@kernel
def _urgent(local: LocalMap, node: int) -> float:
    """How many lane changes are urgent there; 0 beyond the lanes that this cycle looks at."""
    i = node - local.first
    return abs(local.urgency[i]) if 0 <= i < local.urgency.shape[0] else 0.0


@kernel
def leads_nowhere(local: LocalMap, node: int) -> bool:
    """Whether the lane ends before the route does."""
    return local.node[node, NEXT] < 0.0 and not math.isinf(local.node[node, REACH])


@kernel
def step_own(
    term: Term | None,
    local: LocalMap,
    p: EgoParams,
    c: CostParams,
    before: State,
    after: State,
    gap: float,
    time: float,
) -> float:
    """The user's own cost of one simulation step that ends `time` s from now, `gap` m behind the
    leader (inf: none).

    At least 0, since the search takes costs to add up, and at most that of a contact for a second;
    what is no number costs nothing. Lanes are counted from the right among those that the ego may
    use; inside junctions they are all 0.
    """
    if term is None:  # numba leaves out the rest where there is none
        return 0.0
    lane, beside = 0, int(local.node[after.node, RIGHT_NODE])
    while beside >= 0:
        lane, beside = lane + 1, int(local.node[beside, RIGHT_NODE])
    rate = term.rate(
        time, lane, after.s, after.v, after.a, (after.a - before.a) / p.step, gap, term.weight
    )
    return min(rate, c.contact) * p.step if rate > 0.0 else 0.0


@kernel
def terminal(local: LocalMap, c: CostParams, state: State, gap: float, leader_v: float) -> float:
    """What is still to come at the horizon: the time lost until the limit is reached, and for
    tail_s more behind a slow leader, before a dead end, and in a lane that the route leaves.

    Nothing here may fall by more than 1 / limit for a metre less driven, the time that is gained by
    driving it, or it would pay to stand. So speed counts behind a leader only as far as there is
    room for it, before a red light or a dead end not at all (LocalMap.free). The limit is that of
    the lane where the ego is now, the same for all.
    """
    useful = min(state.v, leader_v + gap / local.limit)
    missing = max(0.0, local.limit - useful) if local.free else 0.0
    behind = max(
        _behind(local, c, gap, leader_v),
        _behind(local, c, local.node[state.node, REACH] - state.s, 0.0),
    )
    lost = (
        missing * missing / (2.0 * PICK_UP * local.limit)
        + c.tail_s * behind
        + min(_to_sign(local, state), UP_TO_SIGN) / MOVE_UP
    )
    return c.progress * lost + c.route * _urgent(local, state.node) * c.tail_s * (
        1.0 + RUN_UP * _too_slow(local, state)
    )


@kernel
def _too_slow(local: LocalMap, state: State) -> float:
    """Share of the speed of those it has to move between that the ego cannot reach any more before
    its lane ends: an ego that stands there finds no gap."""
    room = local.node[state.node, REACH] - state.s
    if math.isinf(room):
        return 0.0
    return max(
        0.0,
        1.0
        - math.sqrt(state.v * state.v + 2.0 * PICK_UP * max(room, 0.0))
        / max(local.target_lane_speed, 1.0),
    )


@kernel
def _before_sign(local: LocalMap, state: State) -> float:
    """Share of a second that is lost before the ego stands at the stop sign ahead: its turn comes
    only after that."""
    if math.isinf(local.stop_at):
        return 0.0
    return min(max(_to_sign(local, state) / NEAR_SIGN, state.v / ROLLS), 1.0)


@kernel
def _to_sign(local: LocalMap, state: State) -> float:
    """m to where it has to stand; 0 where it has, or there is none."""
    if math.isinf(local.stop_at):
        return 0.0
    return max(local.stop_at - local.node[state.node, STATION] - state.s - STANDS_BEFORE, 0.0)


@kernel
def _behind(local: LocalMap, c: CostParams, gap: float, leader_v: float) -> float:
    """Share of the coming tail_s that is lost behind a slower vehicle, or something that stands."""
    return (1.0 - min(leader_v, local.limit) / local.limit) * max(
        0.0, 1.0 - TAIL_SLOPE * gap / (c.tail_s * local.limit + 1e-9)
    )


@kernel
def contact_cost(c: CostParams, state: State, time: float, horizon: float) -> float:
    """The loss of a contact: the later and the slower, the better, since there is time to find
    another path."""
    return c.contact * (1.0 - 0.5 * min(time / horizon, 1.0)) + c.speed_at_contact * state.v
