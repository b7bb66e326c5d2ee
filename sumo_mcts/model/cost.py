"""Terms of J (paper, equation 1) for planner `mcts`: comfort, passability, the user's own term, the
value at the horizon, and the loss of a contact.

Headway is in interaction.py; `claim` there, in gaps.py and in occupancy.py; `imposed`, `red` and
`lane_change` in planners/ply.py, the latter also in planners/search.py. One unit is one second of
standing still.
"""

import math

from sumo_mcts.model.cost_params import CostParams, Term
from sumo_mcts.model.cost_to_go import PICK_UP, waiting_s
from sumo_mcts.model.crosswalks import stays_on_crosswalk
from sumo_mcts.model.leaving import MAKES_ROOM
from sumo_mcts.model.local_map import (
    DENSITY,
    ONCOMING,
    STREAM,
    LocalMap,
    S,
    State,
    V,
    chain_gap,
    index_at,
    node_of,
    to_end,
    urgency_at,
)
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.model.route import HOME, INTERNAL, LIMIT, NEXT, NUMBER, REACH, STATION
from sumo_mcts.numerics.kernel import kernel

# m/s2: by so much / limit for each metre of gap the ego's useful speed is above its leader's. Up to
# PICK_UP * (1 - TAIL_SLOPE) a metre less driven lowers the cost by no more than 1 / limit.
CLOSING = 1.0
TAIL_SLOPE = 0.4  # of 1 / limit: how fast a slow leader's cost falls with the gap
MOST_JERK = 10.0  # m/s3 from which more costs no more
SLOW = 1.0  # m/s below which the ego counts as blocking others
# rad between box and lane: beyond this the rear is still in the lane that the ego leaves
STRADDLING = 0.2
ROLLS = 0.3  # m/s below which the cost of the time before a stop falls to 0, at the place to stand
UP_TO_STOP = 30.0  # m before that place within which the distance to it has a cost at the horizon:
MOVE_UP = 4.0  # m/s, the time that driving up to it with this speed takes
# Factor of an additional cost at the horizon, in a lane that the route leaves: for an ego that can
# no longer reach the speed of the vehicles between which it has to move.
RUN_UP = 0.1
# times tail_s that is lost at most behind a queue: in a longer one nothing is gained by passing one
MOST_STUCK = 2.0
LEAST_LOSS = 0.5  # of cost.contact: what a contact costs at least, at the horizon


@kernel
def step_comfort(p: EgoParams, c: CostParams, before: State, after: State) -> float:
    """C_c of one simulation step: k j^2, saturating, and braking and accelerating hard."""
    jerk = (after.a - before.a) / p.step
    beyond = max(0.0, -after.a - p.comfort_decel)
    rate = (
        c.jerk * min(jerk * jerk, MOST_JERK * MOST_JERK)
        + c.acceleration * after.a * after.a
        + c.braking * beyond * beyond
    )
    return rate * p.step


@kernel
def step_passability(local: LocalMap, p: EgoParams, c: CostParams, after: State) -> float:
    """C_p of one simulation step.

    It has terms for time lost against the limit or before a stop, for a lane that the route
    leaves, and for standing in a junction or across two lanes.
    """
    limit = local.node[after.node, LIMIT]
    rate = c.progress * (1.0 - min(after.v, limit) / limit + _before_stop(local, after))
    urgent = abs(urgency_at(local, after))
    if urgent > 0.0:  # elsewhere the stream beside is not known
        rate += c.route * urgent * (1.0 + c.mismatch * _mismatch(local, after))
    if after.v < SLOW:
        if local.node[after.node, INTERNAL] > 0.0:
            rate += c.blocking
        # at the end of a lane that leads nowhere any angle is allowed
        if abs(after.turn) > STRADDLING and not leads_nowhere(local, after.node):
            rate += c.astride
    return rate * p.step


@kernel
def _mismatch(local: LocalMap, state: State) -> float:
    """How much rarer a driver of the next lane can make room for the ego than for one that is as
    fast as that lane, 0..1."""
    i = state.node - local.first
    slower = max(local.to_leave[i, STREAM] - state.v, 0.0)
    return 1.0 - math.exp(-local.to_leave[i, DENSITY] * slower * slower / (2.0 * MAKES_ROOM))


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

    It is at least 0, since the search takes costs to add up, and at most that of a contact for a
    second. nan counts as 0. Lanes are counted from the right among those that the ego may use;
    inside junctions they are all 0.
    """
    if term is None:  # numba leaves out the rest where there is none
        return 0.0
    lane = int(local.node[after.node, NUMBER])
    rate = term.rate(
        time, lane, after.s, after.v, after.a, (after.a - before.a) / p.step, gap, term.weight
    )
    return min(rate, c.contact) * p.step if rate > 0.0 else 0.0


@kernel
def terminal(
    local: LocalMap, c: CostParams, state: State, gap: float, leader_v: float, time: float
) -> float:
    """The cost of the time after the horizon, which is `time` s from now.

    This is the time lost until the ego reaches the limit. For tail_s more it is the time lost
    behind a slow leader, before the end of the road, and in a lane that the route leaves.

    If a metre less driven lowered this by more than 1 / limit, the time that driving it takes, it
    would pay to stand. So behind a leader speed has a value only as far as the gap allows. Before a
    red light or the end of the road it has none (LocalMap.open_ahead). The limit is that of the
    lane where the ego is now, in all states.
    """
    stuck = 0.0
    if is_against(local, state) > 0.0:
        state = _back(local, state)
    else:
        stuck = stuck_behind(local, state.node, state.s, 0.0, time)
    useful = min(state.v, leader_v + CLOSING * gap / local.limit)
    missing = max(0.0, local.limit - useful) if local.open_ahead else 0.0
    lost_behind = max(
        behind(local, c, gap, leader_v),
        behind(local, c, to_end(local, state), 0.0),
    )
    picks_up = missing * missing / (2.0 * PICK_UP * local.limit)
    waits = 0.0
    if c.beyond_s > 0.0:
        waits = c.beyond_s * (1.0 - math.exp(-waiting_s(local, state, time, picks_up) / c.beyond_s))
    if stays_on_crosswalk(local, state):
        waits = c.beyond_s  # it gains nothing by waiting there
    lost = (
        picks_up
        + waits
        + c.tail_s * (lost_behind + stuck)
        + min(_to_stop(local, state), UP_TO_STOP) / MOVE_UP
    )
    return c.progress * lost + c.route * abs(urgency_at(local, state)) * c.tail_s * (
        1.0 + RUN_UP * _too_slow(local, state)
    )


@kernel
def _back(local: LocalMap, state: State) -> State:
    """The ego at its place in the lane that it left to overtake (see model/completing.py)."""
    node = int(local.node[state.node, HOME])
    if node < 0:
        node = state.node
    return State(node, state.s, state.v, state.a, 0.0, -1, 0.0)


@kernel
def is_against(local: LocalMap, state: State) -> float:
    """1 where the ego is in a lane of oncoming traffic, or changes to one; else 0."""
    i = state.node - local.first
    if not 0 <= i < local.to_leave.shape[0]:
        return 0.0
    j = state.other - local.first
    comes = state.progress <= 0.5 and 0 <= j < local.to_leave.shape[0]
    return max(local.to_leave[i, ONCOMING], local.to_leave[j, ONCOMING] if comes else 0.0)


@kernel
def _too_slow(local: LocalMap, state: State) -> float:
    """How far the speed that the ego can still reach falls short of the target lane's, as a share.

    It counts up to the end of the ego's lane: an ego that stands there finds no gap.
    """
    distance = to_end(local, state)
    if math.isinf(distance):
        return 0.0
    return max(
        0.0,
        1.0
        - math.sqrt(state.v * state.v + 2.0 * PICK_UP * max(distance, 0.0))
        / max(local.target_lane_speed, 1.0),
    )


@kernel
def _before_stop(local: LocalMap, state: State) -> float:
    """Share of the time that counts as lost before the ego stands at the stop ahead."""
    if math.isinf(local.stop_at):
        return 0.0
    return min(max(_to_stop(local, state) / local.near_stop, state.v / ROLLS), 1.0)


@kernel
def _to_stop(local: LocalMap, state: State) -> float:
    """m to the place where the ego has to stand; 0 if it has stood there, or there is none."""
    if math.isinf(local.stop_at):
        return 0.0
    return max(local.stop_at - local.node[state.node, STATION] - state.s - local.stands_before, 0.0)


@kernel
def stuck_behind(local: LocalMap, node: int, s: float, beyond: float, time: float) -> float:
    """Share of the coming tail_s that is lost behind all vehicles more than `beyond` m ahead of a
    place, where only the lane of the oncoming leads past them: behind each one as long again."""
    if local.stuck == 0.0:
        return 0.0
    t, share = min(index_at(local, time), local.agent.shape[0] - 1), 0.0
    for i in range(local.agent.shape[1]):
        there, v = node_of(local, t, i), min(local.agent[t, i, V], local.limit)
        ahead = chain_gap(local, node, s, there, local.agent[t, i, S]) if there >= 0 else math.inf
        if beyond < ahead < math.inf:
            share += 1.0 - v / local.limit
    return min(share, MOST_STUCK)


@kernel
def behind(local: LocalMap, c: CostParams, gap: float, leader_v: float) -> float:
    """Share of the coming tail_s that is lost behind a slower vehicle, or something that stands."""
    return (1.0 - min(leader_v, local.limit) / local.limit) * max(
        0.0, 1.0 - TAIL_SLOPE * gap / (c.tail_s * local.limit + 1e-9)
    )


@kernel
def contact_cost(c: CostParams, state: State, time: float, horizon: float) -> float:
    """The loss of a contact: the later and the slower, the better, since there is time to find
    another path."""
    share = 1.0 - (1.0 - LEAST_LOSS) * min(time / horizon, 1.0)
    return c.contact * share + c.speed_at_contact * state.v


@kernel
def after_contact(
    local: LocalMap, c: CostParams, state: State, time: float, horizon: float
) -> float:
    """The cost of the time after a contact `time` s from now: the ego stands there from then on.

    So no contact is cheaper than to wait in the same place, however long that takes.
    """
    stands = State(state.node, state.s, 0.0, 0.0, state.progress, state.other, state.turn)
    left = c.progress * max(horizon - time, 0.0)
    return c.after_contact * (left + terminal(local, c, stands, 0.0, 0.0, horizon))
