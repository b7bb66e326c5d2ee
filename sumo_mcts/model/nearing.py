"""What it costs to come near an agent that moves sideways: its place is not known to the
decimetre."""

from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.model.local_map import SIDEWAYS_UNTIL, LocalMap, State, on_other_level
from sumo_mcts.numerics.geometry import COS, SIN, Box, X, Y, box_distance
from sumo_mcts.numerics.kernel import inlined, kernel

# m by which an agent that moves sideways may be nearer than its forecast. The error is taken to be
# distributed as a triangle of that half width.
MARGIN = 1.0


@inlined
def margin_of(local: LocalMap, t: int, i: int) -> float:
    """m by which agent i may be elsewhere than it is predicted at forecast time `t`."""
    return MARGIN if 0 < t <= local.trait[i, SIDEWAYS_UNTIL] else 0.0


@kernel
def nearing_cost(
    local: LocalMap, c: CostParams, state: State, box: Box, other: Box, t: int, i: int
) -> float:
    """Cost per second of coming nearer to agent i, whose box is `other` at forecast time `t`.

    It is what a contact costs, times the growth of its probability since the time before. So an ego
    that stays as near pays nothing, and one that comes as near as can be pays half of a contact,
    however slowly it comes.
    """
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
