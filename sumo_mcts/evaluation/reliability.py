"""How good probabilities are: Brier score, its skill against the base rate, reliability."""

from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats
from sumo_mcts.records.statistics import wilson

# Bounds of the bins of predicted probabilities: finer near 0, where rare events lie.
BINS = (0.0, 0.005, 0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0)


class Judged(NamedTuple):
    """P predictions, and what came of them."""

    probability: Floats  # [P]
    happened: Bools  # [P]


def scores(judged: Judged) -> dict[str, Any]:
    """The Brier score (mean squared error; Brier 1950), its skill (1: perfect; 0: as good as the
    base rate), and the table of reliability; None where they are not defined."""
    n = len(judged.happened)
    if n == 0:
        return {"asked": 0, "happened": 0, "brier": None, "skill": None, "reliability": []}
    base = float(judged.happened.mean())
    brier = float(np.mean((judged.probability - judged.happened) ** 2))
    uncertain = base * (1.0 - base)
    return {
        "asked": n,
        "happened": int(judged.happened.sum()),
        "brier": brier,
        "skill": 1.0 - brier / uncertain if uncertain > 0.0 else None,
        "reliability": reliability(judged),
    }


def reliability(judged: Judged) -> list[dict[str, Any]]:
    """A row for each bin that holds a prediction: how often it happened, with the 95 % interval."""
    place = np.clip(np.searchsorted(BINS, judged.probability, side="right") - 1, 0, len(BINS) - 2)
    rows = []
    for k in np.unique(place):
        chosen = place == k
        count, happened = int(chosen.sum()), int(judged.happened[chosen].sum())
        rows.append(
            {
                "from": BINS[k],
                "to": BINS[k + 1],
                "asked": count,
                "predicted": float(judged.probability[chosen].mean()),
                "happened": happened,
                "interval": wilson(happened, count),
            }
        )
    return rows
