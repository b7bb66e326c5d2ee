"""What it costs to come near an agent that moves sideways: its place is not known to the
decimetre."""

import numpy as np

from sumo_mcts.arrays import Floats, Ints
from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.model.local_map import (
    EAST,
    NORTH,
    SOUTH,
    WEST,
    LocalMap,
    State,
    on_other_level,
)
from sumo_mcts.numerics.geometry import COS, SIN, Box, X, Y, box_distance
from sumo_mcts.numerics.kernel import kernel

# m by which an agent that moves sideways may be nearer than its forecast. The error is taken to be
# distributed as a triangle of that half width.
MARGIN = 1.0


def widened(bounds: Floats, until: Ints) -> Floats:
    """LocalMap.bounds [H, T, N, 4] with MARGIN about agents that move sideways until the forecast
    times `until` [H, N]."""
    if until.max(initial=-1) < 0:
        return bounds
    moves = np.arange(bounds.shape[1])[:, None] <= until[:, None]
    wider = bounds.copy()
    wider[..., [WEST, SOUTH]] -= MARGIN * moves[..., None]
    wider[..., [EAST, NORTH]] += MARGIN * moves[..., None]
    return wider


@kernel
def nearing_cost(
    local: LocalMap, c: CostParams, state: State, box: Box, other: Box, t: int, i: int
) -> float:
    """Cost per second of coming nearer to agent i, whose box is `other` at forecast time `t`.

    It is what a contact costs, times the growth of its probability since the time before. So an ego
    that stays as near pays nothing, and one that comes as near as can be pays half of a contact,
    however slowly it comes.
    """
    if t == 0:
        return 0.0
    now = likely_contact(box_distance(box, other))
    if now == 0.0 or on_other_level(local, state.node, state.s, 2.0 * box.half_length, t, i):
        return 0.0
    driven = state.v * local.dt
    was = Box(
        box.x - driven * box.cos, box.y - driven * box.sin, box.cos, box.sin, box.half_length,
        box.half_width,
    )  # fmt: skip
    row = local.agent[t - 1, i]
    it_was = Box(row[X], row[Y], row[COS], row[SIN], other.half_length, other.half_width)
    grown = now - likely_contact(box_distance(was, it_was))
    return c.nearing * max(grown, 0.0) * (c.contact + c.speed_at_contact * state.v) / local.dt


@kernel
def likely_contact(room: float) -> float:
    """The probability of a contact with an agent predicted to be `room` m away."""
    missing = max(1.0 - room / MARGIN, 0.0)
    return 0.5 * missing * missing
