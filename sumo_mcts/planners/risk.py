"""From the costs of actions in several hypotheses to one: the expected cost, or the expectation of
the worst share (CVaR)."""

import numpy as np

from sumo_mcts.arrays import Floats


def risk(cost: Floats, weight: Floats, share: float) -> Floats:
    """[A] mean cost in the worst `share` of what may happen, from costs [A, H] and the weights of
    the hypotheses [H], which sum to 1.

    A share of 1 is the expected cost, a share near 0 the worst case (conditional value at risk;
    Rockafellar and Uryasev 2000).
    """
    if len(weight) == 1:
        return cost[:, 0]
    order = np.argsort(-cost, axis=1, kind="stable")
    taken = np.diff(np.minimum(np.cumsum(weight[order], axis=1), share), axis=1, prepend=0.0)
    return np.asarray(
        (np.take_along_axis(cost, order, axis=1) * taken).sum(axis=1) / taken.sum(axis=1)
    )


def shares(weight: Floats, iterations: int, actions: int) -> Floats:
    """[H'] share of the iterations for each hypothesis: half by weight, half equally, since an
    unlikely one decides too if it is bad enough.

    Unlikely ones are left out where the iterations would not suffice to try every action four times
    in each.
    """
    kept = weight[: max(1, min(len(weight), iterations // (4 * actions)))]
    return np.asarray(0.5 * kept / kept.sum() + 0.5 / len(kept))
