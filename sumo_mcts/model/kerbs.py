"""People at crossings where they have to let vehicles pass: who is not on it yet waits at the kerb
while the ego comes over it.

Whether they wait depends on what the ego does, not on what it is taken to do: an ego that stands
is not waited for, however long it stands. So the search moves them.
"""

from sumo_mcts.arrays import Floats
from sumo_mcts.model.local_map import (
    CLOCK,
    DRIVEN,
    KERB,
    OWED,
    OWN_NODE,
    PAST,
    SLOT,
    SPEED,
    STRETCH_END,
    LocalMap,
    State,
    V,
    between,
    chain_gap,
)
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.numerics.kernel import kernel

PACE = 1.0  # m/s with which people reckon that they walk over a crossing, as SUMO's do
CLEAR = 0.5  # m behind the ego's rear from which on they go


@kernel
def stands_aside(local: LocalMap, p: EgoParams, state: State, others: Floats, i: int) -> bool:
    """Whether person i, where it is by now, waits at the kerb for the ego where `state` says.

    It does if the ego is inside the junction and, at its speed, would be over the crossing before
    the person is past its way.
    """
    r, k = int(local.trait[i, SLOT]), int(local.trait[i, OWED])
    if r < 0 or k < 0 or between(local, i, others[r, CLOCK], DRIVEN) > local.obligation[k, KERB]:
        return False
    over = chain_gap(
        local,
        int(local.obligation[k, OWN_NODE]),
        local.obligation[k, STRETCH_END],
        state.node,
        state.s,
    )
    reach = state.v * local.obligation[k, PAST] / PACE
    return bool(-reach <= over < 2.0 * p.half_length + CLEAR)


@kernel
def walk(
    local: LocalMap, p: EgoParams, state: State, others: Floats, t: int, i: int, seconds: float
) -> None:
    """Move person i on by `seconds`, up to forecast time `t`, but not over a kerb at which it waits
    for the ego."""
    r, k = int(local.trait[i, SLOT]), int(local.trait[i, OWED])
    clock = others[r, CLOCK] + seconds / local.dt
    if t - clock < 1.0:
        clock = float(t)
    steps_on = between(local, i, clock, DRIVEN) > local.obligation[k, KERB]
    if steps_on and stands_aside(local, p, state, others, i):
        others[r, SPEED] = 0.0
        return
    others[r, CLOCK], others[r, SPEED] = clock, local.agent[min(int(clock), t), i, V]
