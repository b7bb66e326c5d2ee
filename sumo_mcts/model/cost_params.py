"""The weights and forms of the cost, and a cost term of the user's own."""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

from sumo_mcts.numerics.kernel import scalar_function

TermFunction = Callable[[float, int, float, float, float, float, float, float], float]
_TERM = "float64(float64, int64, float64, float64, float64, float64, float64, float64)"


class Term(NamedTuple):
    """A cost of the user's own, in units of J per second."""

    rate: TermFunction  # of t, lane, s, v, a, jerk, gap, weight; see `step_own`
    weight: float


class CostParams(NamedTuple):
    """Weights; see config.CostConfig for their meaning and units."""

    contact: float
    speed_at_contact: float
    headway_s: float
    headway_gap: float
    headway: float
    claim_s: float
    claim: float
    acceleration: float
    jerk: float
    braking: float
    progress: float
    tail_s: float
    blocking: float
    astride: float
    route: float
    lane_change: float
    red: float
    cut_in_decel: float
    imposed: float
    term: Term | None = None  # None: the kernels are compiled without a trace of it


@cache
def compiled_term(rate: TermFunction) -> TermFunction:
    """A term's function as kernels call it. Raises numba's error where it cannot be compiled."""
    return scalar_function(rate, _TERM)
