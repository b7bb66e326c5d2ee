"""How likely an agent begins a lane change: a logistic model of what a sensor sees.

`sumo-mcts drivers --fit` fits its weights to what SUMO's drivers do. No planner reads it. Lanes
beyond the one that an agent is on are looked at as far as the first connection leads.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.arrays import Floats, Ints
from sumo_mcts.numerics.kernel import entry, kernel
from sumo_mcts.numerics.krauss import USUAL_S, safe_gap
from sumo_mcts.numerics.lanes import Ahead, ahead_of, of_class
from sumo_mcts.road import LEFT, RIGHT, RoadMap
from sumo_mcts.scene import Agents, EgoState

WITHIN_S = 3.0  # s within which the change begins
VIEW = 100.0  # m from front to front, ahead and behind, within which others matter
HOPS = 4  # lanes of a way that are looked at, at most
NEAR_END = 100.0  # m before the end of a lane within which it becomes urgent
SIGNALS_S = 7.0  # s of driving before a turn within which drivers signal it

# What is seen of an agent and one side of it, numbers between 0 and 1.
FEATURES = (
    "always",  # 1
    "signal",  # its turn signal shows that side, where its own lane leads to no such turn
    "other_signal",  # its turn signal shows the other side
    "ends",  # its lane ends, the one beside leads on; 1 at the end
    "ends_beside",  # the other way round
    "parts",  # the two lanes lead to different edges
    "near",  # one is near ahead of it
    "near_beside",  # one is near ahead in the lane beside
    "slow",  # the one ahead is slower than the limit; 1: it is near and stands
    "slow_beside",  # the one ahead in the lane beside is
    "free",  # a gap is free beside it, and safe
    "tight_ahead",  # the one ahead in the lane beside is near
    "tight_behind",  # the one behind there is near
    "slowness",  # its speed below the limit
    "brakes",  # it brakes
    "signal_free",  # products
    "signal_slowness",
    "slow_free",
    "ends_slowness",
)
(
    ALWAYS, SIGNAL, OTHER_SIGNAL, ENDS, ENDS_BESIDE, PARTS, NEAR, NEAR_BESIDE, SLOW, SLOW_BESIDE,
    FREE, TIGHT_AHEAD, TIGHT_BEHIND, SLOWNESS, BRAKES, SIGNAL_FREE, SIGNAL_SLOWNESS, SLOW_FREE,
    ENDS_SLOWNESS,
) = range(19)  # fmt: skip
# [2, FEATURES] what each adds to the logarithm of the odds of a change to the right and left; of
# what episodes: docs/studies/drivers.md
WEIGHTS = np.array(
    [
        (-2.65, -4.96),  # always
        (3.16, 1.49),  # signal
        (-1.11, -0.13),  # other_signal
        (0.00, 5.69),  # ends
        (-4.46, 0.00),  # ends_beside
        (-3.83, -4.10),  # parts
        (-3.22, -0.34),  # near
        (0.01, 1.39),  # near_beside
        (1.07, -1.84),  # slow
        (-0.06, 1.76),  # slow_beside
        (0.97, 0.98),  # free
        (-1.93, -1.95),  # tight_ahead
        (-1.74, -1.54),  # tight_behind
        (-0.39, 0.70),  # slowness
        (-0.08, 2.04),  # brakes
        (0.00, -2.48),  # signal_free
        (0.63, 2.18),  # signal_slowness
        (-1.59, 3.22),  # slow_free
        (0.00, 2.94),  # ends_slowness
    ]
).T.copy()
RELAX = 10.0, 2.0  # m, and s of driving, over which a leader ahead loses importance
TIGHT = 10.0  # m over which one in the lane beside does
SAFE = 2.0  # m beyond the safe gap of a usual driver


class _Seen(NamedTuple):
    """The vehicles; row 0 is the ego."""

    lane: Ints  # [N] of the front
    s: Floats  # [N] m
    v: Floats  # [N] m/s
    length: Floats  # [N] m


def features(road: RoadMap, agents: Agents, ego: EgoState) -> Floats:
    """[N, 2, FEATURES] what is seen of each agent and side of it; nan where there is no lane on
    that side that it may use."""
    seen = _Seen(
        lane=np.concatenate([[ego.lane], agents.lane]).astype(np.int32),
        s=np.concatenate([[ego.s], agents.s]),
        v=np.concatenate([[ego.v], agents.v]),
        length=np.concatenate([[ego.length], agents.length]),
    )
    found = np.full((len(agents.ids), 2, len(FEATURES)), np.nan)
    _fill(
        found,
        ahead_of(road),
        road.speed,
        seen,
        agents.blinker,
        agents.trend,
        of_class(agents.vclass),
    )
    return found


@entry
def _fill(
    found: Floats,
    ahead: Ahead,
    limit: Floats,
    seen: _Seen,
    blinker: Ints,
    trend: Floats,
    kind: NDArray[np.uint64],
) -> None:
    for i in range(len(found)):
        lane = seen.lane[i + 1]
        if lane < 0 or ahead.internal[lane]:
            continue
        wish = max(limit[lane], seen.v[i + 1], 1.0)
        for k in range(2):
            side = 2 * k - 1
            beside = ahead.left[lane] if side > 0 else ahead.right[lane]
            if beside < 0 or ahead.classes[beside] & kind[i] == np.uint64(0):
                continue
            x = found[i, k]
            x[:] = 0.0
            x[ALWAYS] = 1.0
            _fill_own(x, ahead, seen, i + 1, beside, side, blinker[i], wish)
            x[BRAKES] = min(max(-0.5 * trend[i], 0.0), 1.0)
            _fill_gaps(x, ahead, seen, i + 1, beside, wish)
            x[SIGNAL_FREE], x[SIGNAL_SLOWNESS] = x[SIGNAL] * x[FREE], x[SIGNAL] * x[SLOWNESS]
            x[SLOW_FREE], x[ENDS_SLOWNESS] = x[SLOW] * x[FREE], x[ENDS] * x[SLOWNESS]


@kernel
def _fill_own(
    x: Floats, ahead: Ahead, seen: _Seen, i: int, beside: int, side: int, blinker: int, wish: float
) -> None:
    """The agent itself, and how its lane and the one beside go on."""
    lane, v = seen.lane[i], seen.v[i]
    left = max(ahead.length[lane] - seen.s[i], 0.0)
    if blinker == side:
        turns = left < SIGNALS_S * wish and _turns(ahead, lane, side)
        x[SIGNAL] = 0.0 if turns else 1.0
    elif blinker == -side:
        x[OTHER_SIGNAL] = 1.0
    urgent = math.exp(-left / NEAR_END)
    own, other = _straight_on(ahead, lane), _straight_on(ahead, beside)
    if own < 0 <= other:
        x[ENDS] = urgent
    elif other < 0 <= own:
        x[ENDS_BESIDE] = urgent
    elif own >= 0 and ahead.edge[ahead.exit[own]] != ahead.edge[ahead.exit[other]]:
        x[PARTS] = urgent
    x[SLOWNESS] = 1.0 - min(v / wish, 1.0)


@kernel
def _fill_gaps(x: Floats, ahead: Ahead, seen: _Seen, i: int, beside: int, wish: float) -> None:
    """Those ahead of the agent, and those ahead and behind it in the lane beside."""
    s, v = seen.s[i], seen.v[i]
    metres, seconds = RELAX
    gap, leader_v = _leader(ahead, seen, i, seen.lane[i], s)
    x[NEAR] = math.exp(-max(gap, 0.0) / (metres + seconds * v))
    x[SLOW] = (1.0 - min(leader_v / wish, 1.0)) * x[NEAR]
    gap, leader_v = _leader(ahead, seen, i, beside, s)
    x[NEAR_BESIDE] = math.exp(-max(gap, 0.0) / (metres + seconds * v))
    x[SLOW_BESIDE] = (1.0 - min(leader_v / wish, 1.0)) * x[NEAR_BESIDE]
    behind, follower_v = _follower(ahead, seen, i, beside, s)
    x[TIGHT_AHEAD] = math.exp(-max(gap, 0.0) / TIGHT)
    x[TIGHT_BEHIND] = math.exp(-max(behind, 0.0) / TIGHT)
    x[FREE] = 1.0 if _safe(gap, v, leader_v) and _safe(behind, follower_v, v) else 0.0


@kernel
def _safe(gap: float, v: float, leader_v: float) -> bool:
    """Whether a gap (m) is enough for one at `v` behind one at `leader_v`, m/s."""
    return gap > SAFE + safe_gap(v, leader_v, USUAL_S)


@kernel
def _straight_on(ahead: Ahead, lane: int) -> int:
    """The first lane behind it; -1: there is none."""
    k = ahead.first[lane]
    return ahead.successor[k] if k < ahead.first[lane + 1] else -1


@kernel
def _turns(ahead: Ahead, lane: int, side: int) -> bool:
    """Whether a lane leads to a turn to that side."""
    turns = False
    for k in range(ahead.first[lane], ahead.first[lane + 1]):
        turns = turns or ahead.direction[ahead.successor[k]] == (LEFT if side > 0 else RIGHT)
    return turns


@kernel
def _leader(ahead: Ahead, seen: _Seen, i: int, lane: int, s: float) -> tuple[float, float]:
    """Gap (m) and speed of the nearest vehicle ahead of position `s` on a lane, but vehicle i; inf
    and inf: there is none."""
    gap, v, begin = math.inf, math.inf, 0.0
    for _ in range(HOPS):
        for j in range(len(seen.lane)):
            if j != i and seen.lane[j] == lane:
                front = begin + seen.s[j] - s
                if 0.0 <= front < VIEW and front - seen.length[j] < gap:
                    gap, v = front - seen.length[j], seen.v[j]
        begin += ahead.length[lane]
        lane = _straight_on(ahead, lane)
        if lane < 0 or begin - s > VIEW:
            break
    return gap, v


@kernel
def _follower(ahead: Ahead, seen: _Seen, i: int, lane: int, s: float) -> tuple[float, float]:
    """Gap (m) and speed of the nearest vehicle that comes behind the body of vehicle i to position
    `s` on a lane; inf and 0: there is none."""
    gap, v = math.inf, 0.0
    for j in range(len(seen.lane)):
        here, begin = seen.lane[j], -seen.s[j]
        for _ in range(HOPS):
            if j == i or here < 0 or begin > VIEW:
                break
            if here == lane:
                way = begin + s
                if 0.0 < way < VIEW and way - seen.length[i] < gap:
                    gap, v = way - seen.length[i], seen.v[j]
                break
            begin += ahead.length[here]
            here = _straight_on(ahead, here)
    return gap, v
