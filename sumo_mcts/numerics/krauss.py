"""How SUMO's drivers keep clear of what is ahead (Krauss 1998): as fast as possible, braking as
late as possible. Two sides of one rule."""

import math

from sumo_mcts.numerics.kernel import kernel

DECEL = 4.5  # m/s2 with which they brake, as long as that is enough
STANDSTILL = 2.5  # m that they keep to a vehicle that stands ahead
USUAL_S = 1.0  # s of driving that they usually leave beyond that,
CAREFUL_S = 1.8  # and that the most careful of them leave


@kernel
def safe_speed(gap: float, leader_v: float, reaction: float) -> float:
    """The highest speed from which a driver can stop behind a leader that brakes too, m/s.

    `gap`: m between them, without the standstill gap. `reaction`: s until the driver brakes. 0: the
    gap is too short.
    """
    own = DECEL * reaction
    return (
        math.sqrt(own * own + leader_v * leader_v + 2.0 * DECEL * gap) - own if gap >= 0.0 else 0.0
    )


@kernel
def safe_gap(v: float, leader_v: float, reaction: float) -> float:
    """The gap (m) at which v (m/s) is the safe speed; for a faster leader `reaction` s are left all
    the same."""
    return reaction * v + max(0.0, v * v - leader_v * leader_v) / (2.0 * DECEL)
