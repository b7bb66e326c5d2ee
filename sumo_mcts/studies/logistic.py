"""Logistic regression by Newton's method: a model small enough to be read."""

import numpy as np

from sumo_mcts.arrays import Bools, Floats

PENALTY = 1.0  # on the squares of all weights but the first
ROUNDS, CLOSE = 50, 1e-8
WIDEST = 30.0  # of a logarithm of odds: beyond it the probability is 0 or 1 to all digits


def probability(x: Floats, weights: Floats) -> Floats:
    """[P] of samples x [P, F]."""
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(x @ weights, -WIDEST, WIDEST))))


def fitted(x: Floats, happened: Bools, penalty: float = PENALTY) -> Floats:
    """[F] the weights of greatest likelihood for samples x [P, F], less `penalty` times half their
    squares. The first column is the constant, which has no penalty."""
    weights = np.zeros(x.shape[1])
    ridge = np.full(x.shape[1], penalty)
    ridge[0] = 1e-9
    for _ in range(ROUNDS):
        p = probability(x, weights)
        slope = x.T @ (p - happened) + ridge * weights
        curve = (x * (p * (1.0 - p))[:, None]).T @ x + np.diag(ridge)
        step = np.linalg.solve(curve, slope)
        weights = weights - step * min(1.0, 5.0 / max(float(np.abs(step).max()), 1e-12))
        if np.abs(step).max() < CLOSE:
            break
    return weights
