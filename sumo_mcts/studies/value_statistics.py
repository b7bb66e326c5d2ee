"""What expected and true waits tell: errors and rank correlations of states, counts of trips and
stands."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from sumo_mcts.arrays import Floats
from sumo_mcts.records.statistics import wilson
from sumo_mcts.studies.trip import Row

BANDS = (20.0, 60.0, 120.0, 250.0)  # m to the next gate


def summary(states: Sequence[Row], trips: Sequence[Row], stands: Sequence[Row]) -> dict[str, Any]:
    """Errors of the states by scenario and by gate, once of those asked now and once of those at
    the horizon; what came of trips and stands."""
    now = [row for row in states if row["ahead_s"] == 0.0]
    later = [row for row in states if row["ahead_s"] > 0.0]
    return {
        "by_scenario": [
            {"scenario": name, "now": errors(ones), "horizon": errors(others)}
            for name, ones, others in _by(lambda row: row["scenario"], now, later)
        ],
        "by_gate": [
            {"gate": name, "now": errors(ones), "horizon": errors(others)}
            for name, ones, others in _by(gate, now, later)
        ],
        "trips": {
            "count": len(trips),
            "falls": sum(row["median_rate"] < 0.0 for row in trips),
            "falling_cycles": sum(row["falls"] for row in trips),
            "cycles": sum(row["states"] - 1 for row in trips),
            "rise_s": float(np.mean([row["rise_s"] for row in trips])) if trips else None,
        },
        "stands": {
            "count": len(stands),
            "goes": _rate(stands, "goes"),
            "goes_soon": _rate(stands, "goes_soon"),
        },
    }


def gate(row: Row) -> str:
    """The next gate of a state, and how far away it is."""
    if row["gate_m"] is None:
        return "none"
    k = int(np.searchsorted(BANDS, row["gate_m"]))
    low, high = (0.0, *BANDS)[k], (*BANDS, None)[k]
    return (
        f"{row['gate']}, {low:g} m and more"
        if high is None
        else f"{row['gate']}, {low:g}–{high:g} m"
    )


def errors(rows: Sequence[Row]) -> Row:
    """How far off expected waits are, s, and whether they are longer where the true ones are."""
    told = np.array([row["expected_s"] for row in rows])
    true = np.array([row["waited_s"] for row in rows])
    if not len(rows):
        return {
            "states": 0,
            "waited_s": None,
            "bias_s": None,
            "mae_s": None,
            "none_s": None,
            "rank": None,
        }
    return {
        "states": len(rows),
        "waited_s": float(true.mean()),
        "bias_s": float((told - true).mean()),
        "mae_s": float(np.abs(told - true).mean()),
        "none_s": float(np.abs(true).mean()),  # the same, if no wait were expected
        "rank": rank_correlation(told, true),
    }


def rank_correlation(one: Floats, other: Floats) -> float | None:
    """Spearman's; equal values share their mean rank. None where one of them does not vary."""
    ranks = _ranks(one), _ranks(other)
    if min(len(np.unique(each)) for each in ranks) < 2:
        return None
    return float(np.corrcoef(*ranks)[0, 1])


def _ranks(values: Floats) -> Floats:
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(count)
    return (last - 0.5 * (count - 1))[place]


def _rate(rows: Sequence[Row], key: str) -> Row:
    k = sum(row[key] for row in rows)
    return {"k": k, "wilson": wilson(k, len(rows))}


def _by(
    key: Callable[[Row], str], ones: Sequence[Row], others: Sequence[Row]
) -> list[tuple[str, list[Row], list[Row]]]:
    """The rows of both kinds for each value of the key, in the order of first appearance."""
    names = dict.fromkeys(key(row) for row in (*ones, *others))
    return [
        (
            name,
            [row for row in ones if key(row) == name],
            [row for row in others if key(row) == name],
        )
        for name in names
    ]
