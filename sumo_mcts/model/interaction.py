"""The ego and the others at one moment: contact, headway, gaps and right of way.

These are the inputs of the cost of safety, C_s in equation 1 of the paper.
"""

import math
from typing import NamedTuple

from sumo_mcts.arrays import Floats
from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.model.gaps import (
    cut_in_cost,
    gap_ahead,
    gap_behind,
    gap_to_leaving,
    is_beside_in_lane,
    is_seen,
    lane_left,
    target_lane,
)
from sumo_mcts.model.kerbs import stands_aside
from sumo_mcts.model.local_map import (
    BIT,
    GOES_ROUND,
    GONE,
    HALF_LENGTH,
    HALF_WIDTH,
    ON_FOOT,
    POLITE,
    REACTS,
    SIDEWAYS_UNTIL,
    SLOT,
    LocalMap,
    S,
    State,
    V,
    boxes_meet,
    chain_gap,
    follows,
    node_of,
    on_other_level,
    upstream_of,
)
from sumo_mcts.model.motion import EgoParams, pose_of
from sumo_mcts.model.nearing import nearing_cost
from sumo_mcts.model.occupancy import (
    late_cost,
    may_be_near,
    occupancy_cost,
    someone_comes,
    yielding_cost,
)
from sumo_mcts.model.passing import passing_cost
from sumo_mcts.model.reactions import seen
from sumo_mcts.model.route import OWES
from sumo_mcts.numerics.geometry import COS, SIN, Box, X, Y
from sumo_mcts.numerics.kernel import inlined, kernel
from sumo_mcts.prediction.on_foot import BODY

# m beyond which agents are ignored, but for those ahead in the ego's lane: a leader that came into
# sight only there would cost the ego so much at once that it would rather wait out of sight.
SIGHT = 80.0
LOOKS_FURTHER = 40.0  # m to the leader in sight: with less none out of sight is nearer
# Cost of standing on the path of a person on foot, as a share of that of an occupied place. In full
# it would exceed that of a contact.
ROUND_SHARE = 0.1

LEAST_GAP = 0.5  # m from the ego's front to an agent's rear; with less the agent is beside it


class Neighbours(NamedTuple):
    """What drives before and behind the ego in its lanes."""

    gap: float  # m to the leader, inf: none
    leader_v: float  # m/s
    followers: int  # bit mask (trait BIT) of the agents that follow the ego and react to it


class Meeting(NamedTuple):
    """The ego among the others at one moment."""

    contact: bool
    rate: float  # safety cost per second
    once: float  # safety cost of having moved in front of an agent
    near: Neighbours


# Long, since it is one pass over the agents, whose rows it reads once.
@inlined
def meet(  # noqa: PLR0915
    local: LocalMap, p: EgoParams, c: CostParams, state: State, others: Floats, followers: int,
    index: int,
) -> Meeting:  # fmt: skip
    """Contact, headway and predicted occupancy at forecast time `index`.

    `others` [R, 2] as in model/reactions.py; `followers`: the agents that followed the ego before.
    """
    x, y, cs, sn = pose_of(local, p, state)
    t = min(index, local.agent.shape[0] - 1)
    changing = state.progress > 0.0
    box = Box(x, y, cs, sn, p.half_length, p.half_width)
    wide = Box(x, y, cs, sn, p.half_length, p.half_width + (local.aside if changing else 0.0))
    rate, once, gap, leader_v = 0.0, 0.0, math.inf, 0.0
    own = wide.half_length + wide.half_width + 0.5 * state.v * local.dt + 0.01
    for i in range(local.agent.shape[1]):
        if _is_distant(local, x, y, t, i):
            continue
        node, moved = node_of(local, t, i), local.trait[i, SLOT] >= 0.0
        if node == GONE:
            continue
        near = moved or may_be_near(local, x, y, own, t, i)
        comes_to = upstream_of(local, t, i) if changing else -1
        if node < 0 and comes_to < 0 and not near:
            continue
        row, at = local.agent[t, i], t
        bx, by, bc, bs, v, s = row[X], row[Y], row[COS], row[SIN], row[V], row[S]
        if moved:
            bx, by, bc, bs, v, s, at = seen(local, others, i, t)
            node = node_of(local, at, i)
            comes_to = upstream_of(local, at, i) if changing else -1
        length = local.trait[i, HALF_LENGTH]
        behind, to_ego = follows(local, followers, i), math.inf
        if comes_to >= 0:
            to_ego = chain_gap(local, comes_to, s, target_lane(state), state.s)
        elif node >= 0:
            to_agent = gap_ahead(local, state, node, s)
            to_ego = gap_behind(local, state, node, s)
            if not moved and behind and (to_agent < math.inf or to_ego < math.inf):
                continue  # the forecast has it where it would be without the ego
            to_rear = min(
                to_agent - 2.0 * length if to_agent >= 0.0 else math.inf,
                gap_to_leaving(local, state, i, s, t),
            )
            if to_rear < gap:
                gap, leader_v = to_rear, v
            if changing and is_beside_in_lane(local, p, state, node, s, length):
                return Meeting(True, rate, once, Neighbours(gap, leader_v, followers))
            left = lane_left(local, i, t) if changing else -1
            if left >= 0:
                to_ego = min(to_ego, chain_gap(local, left, s, target_lane(state), state.s))
        if (
            not behind
            and local.trait[i, BIT] >= 0.0
            and local.trait[i, REACTS] > 0.0
            and 0.0 < to_ego < math.inf
            and is_seen(local, state, node, s)
        ):
            expects = local.trait[i, POLITE] > 0.0
            price = local.patience * cut_in_cost(
                c, to_ego - 2.0 * p.half_length, v, state.v, expects
            )
            if price >= 0.0:
                followers |= 1 << int(local.trait[i, BIT])
                once += price
                if not moved:
                    continue
            else:  # no driver could cope: as dear as standing in its way
                rate += c.claim
        if not near:
            continue
        aside = moved and stands_aside(local, p, state, others, i)
        width = local.trait[i, HALF_WIDTH]
        # who waits keeps still: no margin
        other = Box(bx, by, bc, bs, BODY, BODY) if aside else Box(bx, by, bc, bs, length, width)
        nearness = _nearness(local, p, c, state, box, wide, other, v, at, t, i, moved, aside)
        if math.isinf(nearness):
            return Meeting(True, rate, once, Neighbours(gap, leader_v, followers))
        rate += nearness
        if not moved and t <= local.trait[i, SIDEWAYS_UNTIL]:
            rate += nearing_cost(local, c, state, box, other, t, i)
    neighbours = Neighbours(gap, leader_v, followers)
    if gap > LOOKS_FURTHER:
        neighbours = _with_distant_leader(local, state, x, y, others, neighbours, t)
    if local.node[state.node, OWES] > 0.0 or (changing and local.node[state.other, OWES] > 0.0):
        rate += yielding_cost(local, p, c, state, others, t)
    rate += _headway(c, neighbours.gap, state.v)
    return Meeting(False, rate, once, neighbours)


@inlined
def _is_distant(local: LocalMap, x: float, y: float, t: int, i: int) -> bool:
    """Whether agent i is out of sight from (x, y) at forecast time `t`."""
    return abs(local.agent[t, i, X] - x) > SIGHT or abs(local.agent[t, i, Y] - y) > SIGHT


@kernel
def _with_distant_leader(
    local: LocalMap, state: State, x: float, y: float, others: Floats, near: Neighbours, t: int
) -> Neighbours:
    """The neighbours `near`, which are in sight from (x, y), but with a leader out of sight where
    that is the nearest."""
    gap, leader_v, followers = near
    for i in range(local.agent.shape[1]):
        node = node_of(local, t, i)
        if node < 0 or not _is_distant(local, x, y, t, i):
            continue
        v, s, moved = local.agent[t, i, V], local.agent[t, i, S], local.trait[i, SLOT] >= 0.0
        if moved:
            _, _, _, _, v, s, at = seen(local, others, i, t)
            node = node_of(local, at, i)
            if node < 0:
                continue
        to_agent = gap_ahead(local, state, node, s)
        to_rear = min(
            to_agent - 2.0 * local.trait[i, HALF_LENGTH] if to_agent >= 0.0 else math.inf,
            gap_to_leaving(local, state, i, s, t),
        )
        if to_rear < gap and (moved or not follows(local, followers, i)):
            gap, leader_v = to_rear, v
    return Neighbours(gap, leader_v, followers)


@inlined
def _nearness(
    local: LocalMap,
    p: EgoParams,
    c: CostParams,
    state: State,
    box: Box,
    wide: Box,
    other: Box,
    v: float,
    at: int,
    t: int,
    i: int,
    moved: bool,
    aside: bool,
) -> float:
    """Cost per second, at forecast index `t`, of how near agent i is; inf: contact.

    Its box is `other`; the forecast has it there at index `at`, which is earlier if it is late.
    `aside`: it waits for the ego at a kerb.
    """
    # with a deceleration the ego may have come to its stand in this step
    round_it = local.trait[i, GOES_ROUND] > 0.0 and state.v == 0.0 and state.a == 0.0
    if _touch(local, p, state, wide, other, v, at, i):
        return ROUND_SHARE * c.claim if round_it else math.inf
    on_foot = local.trait[i, ON_FOOT] > 0.0
    if moved and (aside or at < t or not on_foot):
        return 0.0
    rate = (ROUND_SHARE if round_it else 1.0) * (
        late_cost(local, c, state, box, t, i) + occupancy_cost(local, c, state, box, t, i)
    )
    if on_foot:
        rate += passing_cost(c, state.v, box, other)
    return rate


@kernel
def _headway(c: CostParams, gap: float, v: float) -> float:
    """Cost per second of following too closely."""
    wish = c.headway_gap_m + c.headway_s * v
    if gap >= wish:
        return 0.0
    missing = 1.0 - max(gap, 0.0) / wish
    return c.headway * missing * missing


@inlined
def _touch(
    local: LocalMap, p: EgoParams, state: State, box: Box, other: Box, v: float, at: int, i: int
) -> bool:
    """Whether the ego's box touches that of agent i, which drives at v (m/s) and is where it was to
    be at forecast time `at`."""
    close = (
        box.half_length
        + other.half_length
        + box.half_width
        + other.half_width
        + 0.5 * (state.v + v) * local.dt
    )
    if abs(other.x - box.x) >= close or abs(other.y - box.y) >= close:
        return False
    swept, its = _swept(box, state.v * local.dt), _swept(other, v * local.dt)
    if not boxes_meet(local, state.node, state.s, p.half_length, swept, its, at, i):
        return False
    return not on_other_level(local, state.node, state.s, 2.0 * box.half_length, at, i)


@kernel
def _swept(box: Box, driven: float) -> Box:
    """A box longer by half of what is `driven` (m) until the next check, at both ends: no vehicle
    slips through between two."""
    return Box(box.x, box.y, box.cos, box.sin, box.half_length + 0.5 * driven, box.half_width)


@kernel
def place_is_free(
    local: LocalMap,
    p: EgoParams,
    c: CostParams,
    changed: State,
    others: Floats,
    index: int,
    most: float = math.inf,
) -> bool:
    """Whether a change that begins now leaves every agent that reacts a sufficient gap, at a cost
    of at `most`.

    `changed`: the state right after the change began; `others` [R, 2]: the reacting agents; without
    rows all are where the forecast has them.
    """
    t = min(index, local.agent.shape[0] - 1)
    target = changed.other if changed.other >= 0 else changed.node
    if local.node[target, OWES] > 0.0 and someone_comes(local, p, target, changed.s, t):
        return False
    for i in range(local.agent.shape[1]):
        node, comes_to = node_of(local, t, i), upstream_of(local, t, i)
        if (node < 0 and comes_to < 0) or local.trait[i, REACTS] == 0.0:
            continue
        s, v, left = local.agent[t, i, S], local.agent[t, i, V], lane_left(local, i, t)
        if others.shape[0] > 0 and local.trait[i, SLOT] >= 0.0:
            _, _, _, _, v, s, at = seen(local, others, i, t)
            node, comes_to = node_of(local, at, i), upstream_of(local, at, i)
        behind = chain_gap(local, max(node, comes_to), s, target, changed.s)
        if left >= 0:
            behind = min(behind, chain_gap(local, left, s, target, changed.s))
        price = (
            local.patience * cut_in_cost(c, behind - 2.0 * p.half_length, v, changed.v)
            if 0.0 <= behind < math.inf
            else 0.0
        )
        if price < 0.0 or price > most:
            return False
        if comes_to >= 0:
            continue
        ahead = chain_gap(local, target, changed.s, node, s) - 2.0 * local.trait[i, HALF_LENGTH]
        closing = max(0.0, changed.v - v)
        beside = ahead < LEAST_GAP <= ahead + 2.0 * local.trait[i, HALF_LENGTH]
        if beside or (
            behind == math.inf
            and closing * closing > 2.0 * p.comfort_decel * max(ahead - LEAST_GAP, 0.0)
        ):
            return False
    return True
