"""Moments of an episode, and the windows that show them."""

import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats
from sumo_mcts.records import CycleRecord, Trace
from sumo_mcts.reporting.canvas import SS, View
from sumo_mcts.scene import Agents

STRIP = 4.4  # aspect ratio of a window on a long straight road
AROUND_EGO = 20.0  # m of room on every side of the ego's trajectory
NEAR = 50.0  # m about the ego within which the others belong in the picture
AROUND = 4.0  # m of room about each of them


class Shot(NamedTuple):
    """One moment, between two decisions."""

    cycle: CycleRecord  # the last decision
    elapsed: float  # s since then
    ego: Floats  # [4] x, y, heading, v
    others: Floats  # [N, 3] x, y, heading; the agents of the cycle


def shot_at(trace: Trace, time: float) -> Shot:
    """The moment at a simulation time, s; between two cycles, positions are interpolated."""
    times = [cycle.time for cycle in trace.cycles]
    i = int(np.clip(np.searchsorted(times, time + 1e-9, side="right") - 1, 0, len(times) - 1))
    cycle, after = trace.cycles[i], trace.cycles[min(i + 1, len(times) - 1)]
    elapsed = max(0.0, time - cycle.time)
    share = min(elapsed / (after.time - cycle.time), 1.0) if after.time > cycle.time else 0.0
    now = np.array([cycle.ego.x, cycle.ego.y, cycle.ego.heading])
    then = np.array([after.ego.x, after.ego.y, after.ego.heading])
    ego = np.append(_between(now, then, share), cycle.ego.v + share * (after.ego.v - cycle.ego.v))
    coming = dict(zip(after.agents.ids, _poses(after.agents), strict=True))
    others = [
        _between(pose, coming.get(name, pose), share)
        for name, pose in zip(cycle.agents.ids, _poses(cycle.agents), strict=True)
    ]
    return Shot(cycle, elapsed, ego, np.array(others).reshape(-1, 3))


def views_of(
    shots: list[Shot], size: tuple[int, int], largest: float = 110.0, also: Floats | None = None
) -> list[View]:
    """The window of each shot, of this size in px.

    It is the same for all if the ego's trajectory fits into `largest` m, with the places `also`
    [K, 2] m, or else the others near it, if they fit too. Else the windows have one scale and move
    with the ego.
    """
    wide, tall = size
    # a strip may show more of the road, an upright window less: it is narrow
    stretch = min(max(wide / tall / 1.3, 0.5), 1.8)

    def needed(box: Floats) -> float:
        across, along = box[1] - box[0]
        return max(float(across), float(along) * wide / tall, 60.0 * stretch)

    places = np.array([shot.ego[:2] for shot in shots])
    box = np.array([places.min(axis=0) - AROUND_EGO, places.max(axis=0) + AROUND_EGO])
    wished = map(_near, shots) if also is None else [_around(also[:, :2])]
    others = np.concatenate([box, *wished])
    with_others = np.array([others.min(axis=0), others.max(axis=0)])
    if needed(with_others) <= largest * stretch:
        box = with_others
    fixed = needed(box) <= largest * stretch
    # beyond it vehicles would be too small to read
    metres = needed(box) if fixed else 88.0 * stretch
    middle = box.mean(axis=0)
    centres = [middle if fixed else _ahead(shot, metres, metres * tall / wide) for shot in shots]
    pixel = metres / wide  # the window moves by whole pixels, so that edges do not flicker
    corners = [
        np.round((centre + np.array([-metres / 2, metres / 2 * tall / wide])) / pixel) * pixel
        for centre in centres
    ]
    return [
        View(float(west), float(north), SS / pixel, (SS * wide, SS * tall))
        for west, north in corners
    ]


def arrangement(shots: list[Shot]) -> tuple[int, float]:
    """The number of columns of a page and the aspect ratio of a panel, by the shape of the ego's
    trajectory."""
    wide, tall = _extent(shots)
    if wide > 100 and wide > 3 * tall:
        return 2, STRIP
    if tall > 100 and tall > 3 * wide:
        return 6, 0.5
    return 3, 1.3


def _near(shot: Shot) -> Floats:
    """[K, 2] the corners of what the others near the ego need of the picture, m."""
    away = np.hypot(*(shot.others[:, :2] - shot.ego[:2]).T)
    return _around(shot.others[away < NEAR, :2])


def _around(places: Floats) -> Floats:
    """[2K, 2] the corners of the room that vehicles at these places [K, 2] take, m."""
    return np.concatenate([places - AROUND, places + AROUND])


def _extent(shots: list[Shot]) -> tuple[float, float]:
    """Width and height of the box around the ego's positions, m."""
    places = np.array([shot.ego[:2] for shot in shots])
    wide, tall = np.ptp(places, axis=0)
    return float(wide), float(tall)


def _ahead(shot: Shot, wide: float, tall: float) -> Floats:
    """The centre of a moving window of this size, m: a point ahead of the ego."""
    return np.array(
        [
            shot.ego[0] + 0.2 * wide * math.cos(shot.ego[2]),
            shot.ego[1] + 0.2 * tall * math.sin(shot.ego[2]),
        ]
    )


def _poses(agents: Agents) -> Floats:
    """[N, 3] x, y, heading."""
    return np.column_stack([agents.x, agents.y, agents.heading])


def _between(a: Floats, b: Floats, share: float) -> Floats:
    """[3] pose between a and b; the heading turns by the smaller angle."""
    turn = (b[2] - a[2] + math.pi) % (2 * math.pi) - math.pi
    return a + share * np.array([b[0] - a[0], b[1] - a[1], turn])
