"""The storyboard of an episode: a page of pictures (PNG)."""

import math
from pathlib import Path

import numpy as np

from sumo_mcts.records import CycleRecord, Trace
from sumo_mcts.reporting.birdseye import draw_panel
from sumo_mcts.reporting.camera import arrangement, shot_at, views_of
from sumo_mcts.reporting.ground import draw_ground, roads_of
from sumo_mcts.reporting.picture_page import Strip, column_width, write_page
from sumo_mcts.reporting.words import verb_of


def storyboard(trace: Trace, path: Path, moments: int = 6) -> None:
    """Write a PNG of some moments of the episode.

    Raises ValueError where there is no cycle, OSError where it cannot be written.
    """
    shots = [shot_at(trace, trace.cycles[i].time) for i in choose_moments(trace, moments)]
    columns, aspect = arrangement(shots)
    columns = min(columns, len(shots))
    width = column_width(columns)
    views = views_of(shots, (width, round(width / aspect)))
    roads = roads_of(trace.lanes)
    panels = [
        draw_panel(draw_ground(roads, view), shot, view)
        for shot, view in zip(shots, views, strict=True)
    ]
    rows = [
        Strip(shots[k : k + columns], panels[k : k + columns])
        for k in range(0, len(shots), columns)
    ]
    write_page(path, trace, rows, views[0].scale)


# --- which moments ---


def choose_moments(trace: Trace, count: int) -> list[int]:
    """The indices of cycles spread evenly over the episode.

    Each is moved a little to where the decision changes or an agent is near.
    """
    total = len(trace.cycles)
    if total == 0:
        raise ValueError(f"{trace.key}: the trace holds no cycle to draw")
    if total <= count:
        return list(range(total))
    interest = [_interest(trace.cycles, i) for i in range(total)]
    targets = np.linspace(0, total - 1, count)
    reach = (targets[1] - targets[0]) / 2 if count > 1 else 0.0
    chosen = []
    for target in targets:
        within = [i for i in range(total) if abs(i - target) < reach]
        at_an_end = target in (0, total - 1)
        chosen.append(
            round(target)
            if at_an_end or not within
            else max(within, key=lambda i: interest[i] - 1.2 * abs(i - target) / reach)
        )
    return chosen


def _interest(cycles: tuple[CycleRecord, ...], i: int) -> float:
    """How much a cycle is worth showing, about 0 to 2."""
    changed = i > 0 and verb_of(cycles[i]) != verb_of(cycles[i - 1])
    ego, agents = cycles[i].ego, cycles[i].agents
    nearest = (
        float(np.hypot(agents.x - ego.x, agents.y - ego.y).min()) if len(agents.ids) else math.inf
    )
    return float(changed) + 8.0 / max(nearest, 8.0)
