"""Rows of invented episodes, and folders with them. No SUMO."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from sumo_mcts.records import MANIFEST, ROWS, complete_row, episode_key, save_trace
from sumo_mcts.scene import Follow

VARIANTS = {
    "mcts-idm-100": ("mcts", 100),
    "mcts-idm-1000": ("mcts", 1000),
    "idm": ("idm", None),
    "sumo": ("sumo", None),
}


def made_row(
    scenario: str = "left", variant: str = "mcts-idm-100", seed: int = 0, **known: Any
) -> dict[str, Any]:
    """The row of an episode without incidents; `known` replaces or adds keys."""
    planner, iterations = VARIANTS.get(variant, (variant, None))
    usual = {
        "key": episode_key(scenario, variant, seed), "scenario": scenario, "variant": variant,
        "planner": planner, "ego": "ego", "seed": seed,
        "prediction": None if planner == "sumo" else "idm", "outcome": "arrived",
        "travel_time_s": 20.0 + seed % 7, "min_ttc_s": 3.0 + seed % 5,
        "rms_jerk_mps3": 1.0 + 0.1 * (seed % 9), "imposed_brakes_2": 0, "imposed_brakes_3": 0,
        "imposed_brakes_4": 0, "imposed_max_decel_mps2": 0.0,
        "failsafe_interventions": 0, "iterations_per_decision": iterations, "iterations": 100,
        "cycles": 40, "deadline_misses": 0,
        "comfortable_share": 0.75, "plan_ms_p50": 2.0 + seed % 3, "plan_ms_p95": 5.0,
        "plan_ms_p99": 9.0, "plan_ms_max": 11.0, "realtime_factor": 12.0,
    }  # fmt: skip
    return {**complete_row(usual), **known}


def crashed(row: dict[str, Any], **known: Any) -> dict[str, Any]:
    """The same episode, with a collision at its end."""
    return {
        **row,
        "outcome": "collision",
        "travel_time_s": None,
        "at_fault": True,
        "collisions": 1,
        **known,
    }


def made_rows(seeds: int = 6) -> list[dict[str, Any]]:
    """Two scenes under all variants; the smaller budget collides at times."""
    rows = [
        made_row(scene, variant, seed)
        for scene in ("left", "exit")
        for variant in VARIANTS
        for seed in range(seeds)
    ]
    return [
        crashed(row) if row["variant"] == "mcts-idm-100" and row["seed"] % 3 == 0 else row
        for row in rows
    ]


def write_rows(folder: Path, rows: Iterable[dict[str, Any]], manifest: object = None) -> Path:
    """Write the folder of a `run` or `batch`, without traces."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / ROWS).write_text("".join(json.dumps(row) + "\n" for row in rows))
    if manifest is not None:
        (folder / MANIFEST).write_text(json.dumps(manifest))
    return folder


def write_traces(folder: Path, *keys: str) -> None:
    """Write a trace for each key.

    It is helpers_trace.crossing_trace, where the fail-safe acts in three cycles.
    """
    from helpers_trace import crossing_trace

    trace = crossing_trace()
    cycles = list(trace.cycles)
    for k in (12, 13, 20):
        decision = cycles[k].decision
        reason = "fail-safe: car.01 at 12 m could meet the hardest stop after 1.2 s"
        assert isinstance(decision.command, Follow)
        cycles[k] = cycles[k]._replace(
            decision=decision._replace(
                reason=reason, chosen=-1, command=Follow(decision.command.speeds, 0)
            ),
            intervened=True,
        )
    for key in keys:
        save_trace(folder / "traces" / f"{key}.npz", trace._replace(key=key, cycles=tuple(cycles)))
