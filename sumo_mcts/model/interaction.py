"""How the ego meets the others: distances, gaps, contact and right of way, the inputs of the cost
of safety."""

import math
from typing import NamedTuple

from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.model.local_map import (
    BESIDE,
    BIT,
    CLAIM_SAMPLES,
    COS,
    DRIVEN,
    EAST,
    ENTERS,
    GOES_ROUND,
    GONE,
    HALF_LENGTH,
    HALF_WIDTH,
    LATE,
    MERGES,
    NODE,
    NODE_OF,
    NORTH,
    POLITE,
    REACTS,
    SIN,
    SLOT,
    SOUTH,
    STRETCH_END,
    UNTIL,
    WEST,
    WHO,
    LocalMap,
    S,
    State,
    V,
    X,
    Y,
    apart,
    chain_gap,
    follows,
    upstream_of,
)
from sumo_mcts.model.motion import EgoParams, pose_of
from sumo_mcts.model.reactions import seen
from sumo_mcts.model.route import INTERNAL, JUNCTION
from sumo_mcts.numerics.geometry import Box, boxes_touch
from sumo_mcts.numerics.kernel import inlined, kernel
from sumo_mcts.numerics.krauss import CAREFUL_S, STANDSTILL, USUAL_S, safe_gap, safe_speed
from sumo_mcts.scene import Floats

SIGHT = 80.0  # m beyond which an agent is not looked at
# m/s by which a careful driver has to slow down for a lane change of the ego that costs as much as
# a second in its way,
TAKEN = 2.5
# or this share of its speed, where that is more: on motorways nobody keeps a careful driver's
# distance
TAKEN_SHARE = 0.2
# share of a claim that it costs to stand in the way of somebody on foot: a whole one would be
# dearer than a contact
WAY_ROUND = 0.1


class Meeting(NamedTuple):
    """The ego among the others at one moment."""

    contact: bool
    rate: float  # safety cost per second
    once: float  # safety cost of having moved in front of somebody
    gap: float  # m to the leader, inf: none
    leader_v: float  # m/s
    followers: int  # bit mask (trait BIT) of the agents that follow the ego and react to it


@inlined
def meet(
    local: LocalMap,
    p: EgoParams,
    c: CostParams,
    state: State,
    others: Floats,
    followers: int,
    index: int,
) -> Meeting:
    """Contacts, headway and claims at forecast time `index`; `others` as in model/react.py."""
    x, y, cs, sn = pose_of(local, p, state)
    now = min(index, local.agent.shape[0] - 1)
    box = Box(x, y, cs, sn, p.half_length, p.half_width)
    wide = Box(
        x, y, cs, sn, p.half_length, p.half_width + (local.aside if state.progress > 0.0 else 0.0)
    )
    rate, once, gap, leader_v = 0.0, 0.0, math.inf, 0.0
    own = wide.half_length + wide.half_width + 0.5 * state.v * local.dt + 0.01
    for i in range(local.agent.shape[1]):
        node, moved = int(local.agent[now, i, NODE]), local.trait[i, SLOT] >= 0.0
        if (
            node == GONE
            or abs(local.agent[now, i, X] - x) > SIGHT
            or abs(local.agent[now, i, Y] - y) > SIGHT
        ):
            continue
        near = moved or _near(local, x, y, own, now, i)
        comes_to = upstream_of(node) if state.progress > 0.0 else -1
        if node < 0 and comes_to < 0 and not near:
            continue
        bx, by, bc, bs = (
            local.agent[now, i, X],
            local.agent[now, i, Y],
            local.agent[now, i, COS],
            local.agent[now, i, SIN],
        )
        v, s, at = local.agent[now, i, V], local.agent[now, i, S], now
        if moved:
            bx, by, bc, bs, v, s, at = seen(local, others, i, now)
            node = int(local.agent[at, i, NODE])
        length = local.trait[i, HALF_LENGTH]
        behind, to_ego = follows(local, followers, i), math.inf
        if comes_to >= 0:
            to_ego = chain_gap(local, comes_to, s, _target(state), state.s)
        elif node >= 0:
            to_agent = _gap_ahead(local, state, node, s)
            to_ego = _gap_behind(local, state, node, s)
            if not moved and behind and (to_agent < math.inf or to_ego < math.inf):
                continue  # the table has it where it would be without the ego
            to_rear = min(
                to_agent - 2.0 * length if to_agent >= 0.0 else math.inf,
                _to_leaving(local, state, i, s, now),
            )
            if to_rear < gap:
                gap, leader_v = to_rear, v
            if state.progress > 0.0 and _beside_in_lane(local, p, state, node, s, length):
                return Meeting(True, rate, once, gap, leader_v, followers)
            if state.progress > 0.0 and _leaves(local, i, now) >= 0:
                to_ego = min(
                    to_ego, chain_gap(local, _leaves(local, i, now), s, _target(state), state.s)
                )
        if (
            not behind
            and local.trait[i, BIT] >= 0.0
            and local.trait[i, REACTS] > 0.0
            and 0.0 < to_ego < math.inf
        ):
            price = _cut_in(c, to_ego - 2.0 * p.half_length, v, state.v)
            if price >= 0.0:
                followers |= 1 << int(local.trait[i, BIT])
                once += price
                if not moved:
                    continue
            else:
                rate += c.claim
        if not near:
            continue
        nearness = _nearness(
            local,
            c,
            state,
            box,
            wide,
            Box(bx, by, bc, bs, length, local.trait[i, HALF_WIDTH]),
            v,
            at,
            now,
            i,
            moved,
        )
        if math.isinf(nearness):
            return Meeting(True, rate, once, gap, leader_v, followers)
        rate += nearness
    if local.node[state.node, INTERNAL] > 0.0:
        rate += _in_the_way(local, p, c, state, now)
    return Meeting(False, rate + _headway(c, gap, state.v), once, gap, leader_v, followers)


@inlined
def _nearness(
    local: LocalMap,
    c: CostParams,
    state: State,
    box: Box,
    wide: Box,
    other: Box,
    v: float,
    at: int,
    now: int,
    i: int,
    moved: bool,
) -> float:
    """Cost per second of how near agent i is, whose box is `other`; inf: contact."""
    round_it = (
        local.trait[i, GOES_ROUND] > 0.0 and state.v == 0.0 and state.a == 0.0
    )  # with a it may have come to its stand in this step
    if _touch(local, state, wide, other, v, at, i):
        return WAY_ROUND * c.claim if round_it else math.inf
    if moved:
        return 0.0
    return (WAY_ROUND if round_it else 1.0) * (
        _late(local, c, state, box, now, i) + _claim(local, c, state, box, now, i)
    )


@kernel
def _near(local: LocalMap, x: float, y: float, own: float, now: int, i: int) -> bool:
    """Whether the box of agent i, or what it claims, can be within `own` m of the ego: one look
    instead of several."""
    reach = local.reach[now, i]
    return (
        reach[WEST] - own <= x <= reach[EAST] + own
        and reach[SOUTH] - own <= y <= reach[NORTH] + own
    )


@kernel
def _headway(c: CostParams, gap: float, v: float) -> float:
    """Cost per second of following too closely."""
    wish = c.headway_gap + c.headway_s * v
    if gap >= wish:
        return 0.0
    missing = 1.0 - max(gap, 0.0) / wish
    return c.headway * missing * missing


@inlined
def _touch(local: LocalMap, state: State, box: Box, other: Box, v: float, at: int, i: int) -> bool:
    """Whether the ego's box touches that of agent i, who drives at v and is where it was to be at
    forecast time `at`."""
    close = (
        box.half_length
        + other.half_length
        + box.half_width
        + other.half_width
        + 0.5 * (state.v + v) * local.dt
    )
    if abs(other.x - box.x) >= close or abs(other.y - box.y) >= close:
        return False
    if not boxes_touch(_swept(box, state.v * local.dt), _swept(other, v * local.dt)):
        return False
    return not apart(local, state.node, state.s, 2.0 * box.half_length, at, i)


@kernel
def _swept(box: Box, way: float) -> Box:
    """A box longer by what is driven until half-way to the next check, at both ends: nobody slips
    through between two."""
    return Box(box.x, box.y, box.cos, box.sin, box.half_length + 0.5 * way, box.half_width)


@kernel
def place_is_free(
    local: LocalMap, p: EgoParams, c: CostParams, changed: State, index: int, most: float = math.inf
) -> bool:
    """Whether a change that begins now (`changed`: the state right after it began) leaves everybody
    who reacts a gap to cope with, which costs at `most`."""
    now = min(index, local.agent.shape[0] - 1)
    target = changed.other if changed.other >= 0 else changed.node
    for i in range(local.agent.shape[1]):
        node = int(local.agent[now, i, NODE])
        comes_to = upstream_of(node)
        if (node < 0 and comes_to < 0) or local.trait[i, REACTS] == 0.0:
            continue
        s, left = local.agent[now, i, S], _leaves(local, i, now)
        behind = chain_gap(local, max(node, comes_to), s, target, changed.s)
        if left >= 0:
            behind = min(behind, chain_gap(local, left, s, target, changed.s))
        price = (
            _cut_in(c, behind - 2.0 * p.half_length, local.agent[now, i, V], changed.v)
            if 0.0 <= behind < math.inf
            else 0.0
        )
        if price < 0.0 or price > most:
            return False
        if comes_to >= 0:
            continue
        ahead = chain_gap(local, target, changed.s, node, s) - 2.0 * local.trait[i, HALF_LENGTH]
        closing = max(0.0, changed.v - local.agent[now, i, V])
        beside = ahead < 0.5 <= ahead + 2.0 * local.trait[i, HALF_LENGTH]
        if beside or (
            behind == math.inf and closing * closing > 2.0 * p.comfort_decel * max(ahead - 0.5, 0.0)
        ):
            return False
    return True


@kernel
def _target(state: State) -> int:
    """The lane that the ego changes to."""
    return state.other if state.progress < 0.5 and state.other >= 0 else state.node


@kernel
def _gap_ahead(local: LocalMap, state: State, node: int, s: float) -> float:
    """m from the ego's front to an agent's front, down the ego's lane or the other lane of its
    change; inf: not there."""
    gap = chain_gap(local, state.node, state.s, node, s)
    if state.other >= 0:
        gap = min(gap, chain_gap(local, state.other, state.s, node, s))
    return gap


@kernel
def _to_leaving(local: LocalMap, state: State, i: int, s: float, now: int) -> float:
    """m from the ego's front to the rear of an agent that is ahead, in another lane already but not
    yet wholly out of the ego's; inf: it is not."""
    left = _leaves(local, i, now)
    if left < 0:
        return math.inf
    gap = _gap_ahead(local, state, left, s) - 2.0 * local.trait[i, HALF_LENGTH]
    return gap if gap > 0.0 else math.inf


@kernel
def _leaves(local: LocalMap, i: int, now: int) -> int:
    """The node of the lane that an agent leaves and is not yet wholly out of; -1: none.

    Whoever moves in front of it there makes it brake.
    """
    return int(local.trait[i, BESIDE]) if now <= local.trait[i, UNTIL] else -1


@kernel
def _gap_behind(local: LocalMap, state: State, node: int, s: float) -> float:
    """m from an agent's front to the ego's front, down the agent's lane; inf: its lane does not
    lead to the ego."""
    gap = chain_gap(local, node, s, state.node, state.s)
    if state.other >= 0:
        gap = min(gap, chain_gap(local, node, s, state.other, state.s))
    return gap


@kernel
def _beside_in_lane(
    local: LocalMap, p: EgoParams, state: State, node: int, s: float, half_length: float
) -> bool:
    """Whether an agent is beside the ego in the lane that the ego counts to:

    SUMO calls that a collision, however far aside the ego has moved.

    It looks before it moves vehicles over, so that at half time the old lane counts for a step
    more, and another one for its rounding.
    """
    lasts = 2.5 * p.step / p.change_duration if p.change_duration > 0.0 else 0.5
    old = 0.5 < state.progress < 0.5 + lasts and state.other >= 0
    lane = state.other if old else state.node
    ahead = chain_gap(local, lane, state.s, node, s)
    behind = chain_gap(local, node, s, lane, state.s)
    return 0.0 <= ahead < 2.0 * half_length or 0.0 <= behind < 2.0 * p.half_length


@kernel
def _cut_in(c: CostParams, gap: float, follower_v: float, ego_v: float) -> float:
    """Cost of moving in front of a follower (gap m, speeds m/s): what speed it takes from a careful
    driver; -1 where nobody could cope."""
    closing = max(0.0, follower_v - ego_v)
    if gap < 1.0 or closing * closing > 2.0 * c.cut_in_decel * (gap - 1.0):
        return -1.0
    leads_with = min(
        ego_v, follower_v
    )  # an ego that is faster now may be so no longer when somebody slows down ahead of it
    taken = max(0.0, follower_v - safe_speed(gap - STANDSTILL, leads_with, CAREFUL_S))
    return c.claim * taken / max(TAKEN, TAKEN_SHARE * follower_v)


@kernel
def _in_the_way(local: LocalMap, p: EgoParams, c: CostParams, state: State, now: int) -> float:
    """Cost per second of being inside a junction while somebody with the right of way comes near:
    drivers brake for whoever is on it."""
    rate = 0.0
    for k in range(local.duty.shape[0]):
        node, i = int(local.duty[k, NODE_OF]), int(local.duty[k, WHO])
        if local.node[node, JUNCTION] != local.node[state.node, JUNCTION]:
            continue
        left = chain_gap(local, state.node, state.s, node, local.duty[k, STRETCH_END])
        if left == math.inf or left + 2.0 * p.half_length < 0.0:
            continue
        distance = local.duty[k, ENTERS] - local.agent[now, i, DRIVEN]
        # Who crosses its way is to a driver in SUMO as good as standing there; who merges drives
        # ahead of it.
        needed = STANDSTILL + safe_gap(
            local.agent[now, i, V], state.v if local.duty[k, MERGES] > 0.0 else 0.0, USUAL_S
        )
        if 0.0 < distance < needed:
            rate = max(rate, c.claim * min(1.0, 0.5 + 2.0 * (1.0 - distance / needed)))
    return rate


@inlined
def _claim(local: LocalMap, c: CostParams, state: State, box: Box, now: int, i: int) -> float:
    """Cost per second of standing where the agent will be within claim_s; the sooner, the
    dearer."""
    if local.trait[i, POLITE] != 0.0:
        return 0.0
    for k in range(1, CLAIM_SAMPLES + 1):
        at = now + int(k * c.claim_s / CLAIM_SAMPLES / local.dt + 0.5)
        if at >= local.agent.shape[0] or local.agent[at, i, NODE] == GONE:
            return 0.0
        if _touches(local, box, at, i):
            return (
                0.0
                if apart(local, state.node, state.s, 2.0 * box.half_length, at, i)
                else c.claim * (1.0 - (k - 1.0) / CLAIM_SAMPLES)
            )
    return 0.0


@inlined
def _late(local: LocalMap, c: CostParams, state: State, box: Box, now: int, i: int) -> float:
    """Cost per second of being where the agent still is if it comes a little later than its
    forecast."""
    at = now - int(LATE / local.dt + 0.5)
    if at < 0 or local.agent[at, i, NODE] == GONE:
        return 0.0
    if not _touches(local, box, at, i) or apart(
        local, state.node, state.s, 2.0 * box.half_length, at, i
    ):
        return 0.0
    return c.claim * 0.5


@inlined
def _touches(local: LocalMap, box: Box, at: int, i: int) -> bool:
    """Whether the ego's box, where it is now, meets that of agent i at forecast time `at`."""
    length, width = local.trait[i, HALF_LENGTH], local.trait[i, HALF_WIDTH]
    reach = box.half_length + length + box.half_width + width
    x, y = local.agent[at, i, X], local.agent[at, i, Y]
    if abs(x - box.x) >= reach or abs(y - box.y) >= reach:
        return False
    return boxes_touch(
        box, Box(x, y, local.agent[at, i, COS], local.agent[at, i, SIN], length, width)
    )
