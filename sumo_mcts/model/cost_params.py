"""The numbers of the section `cost` as kernels read them, and a cost term of the user's own."""

from collections import namedtuple
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

from sumo_mcts.config.sections.cost import CostWeights
from sumo_mcts.numerics.kernel import scalar_function

TermFunction = Callable[[float, int, float, float, float, float, float, float], float]
_TERM = "float64(float64, int64, float64, float64, float64, float64, float64, float64)"


class Term(NamedTuple):
    """A cost of the user's own, in units of J per second."""

    rate: TermFunction  # of t, lane, s, v, a, jerk, gap, weight; see `step_own`
    weight: float


if TYPE_CHECKING:

    class CostParams(CostWeights):
        """What a type checker takes the tuple below for."""

        term: Term | None = None

else:
    # A number that is not given is 0: that term costs nothing. Where the term is None, kernels are
    # compiled without a trace of it.
    CostParams = namedtuple(
        "CostParams",
        [*CostWeights.model_fields, "term"],
        defaults=[*[0.0] * len(CostWeights.model_fields), None],
    )


@cache
def compiled_term(rate: TermFunction) -> TermFunction:
    """A term's function as kernels call it. Raises numba's error where it cannot be compiled."""
    return scalar_function(rate, _TERM)
