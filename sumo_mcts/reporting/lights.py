"""What signals show, as bars across the ends of lanes."""

from collections import defaultdict
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats
from sumo_mcts.reporting.canvas import BLINK, BRAKE, GO, Colour
from sumo_mcts.road import LEFT, RIGHT, STRAIGHT, TURN, RoadMap
from sumo_mcts.scene import AFTER_STOP, GREEN, RED, YELLOW, Signals

COLOURS: dict[int, Colour] = {GREEN: GO, YELLOW: BLINK, RED: BRAKE, AFTER_STOP: BRAKE}
_FROM_THE_RIGHT = (RIGHT, STRAIGHT, LEFT, TURN)  # links of a lane, in this order


class Light(NamedTuple):
    """What a lane is shown at its end."""

    bar: Floats  # [2, 2] from its right to its left, m
    colour: Colour


def lights(road: RoadMap, signals: Signals) -> list[Light]:
    """The bars of all signalled lanes; a lane whose links are shown different things has a part for
    each."""
    found = []
    for lane, links in _links(road).items():
        rows = [signals.offset[road.signal[i]] + road.link[i] for i in links]
        shown = signals.state[rows, 0].tolist()
        parts = shown[:1] if len(set(shown)) == 1 else shown
        right, left = _end(road, lane)
        cuts = right + np.linspace(0.0, 1.0, len(parts) + 1)[:, None] * (left - right)
        if road.lefthand:  # SUMO counts from the left there
            parts = parts[::-1]
        found += [Light(cuts[k : k + 2], COLOURS[state]) for k, state in enumerate(parts)]
    return found


def _links(road: RoadMap) -> dict[int, list[int]]:
    """The signalled connections of each ordinary lane, from the right to the left."""
    links: dict[int, list[int]] = defaultdict(list)
    for lane in np.flatnonzero(~road.internal).tolist():
        begin, end = road.successor_offset[lane : lane + 2]
        for after in road.successor[begin:end].tolist():
            if road.signal[after] >= 0:
                links[lane].append(after)
    for found in links.values():
        found.sort(key=lambda i: _FROM_THE_RIGHT.index(int(road.direction[i])))
    return links


def _end(road: RoadMap, lane: int) -> tuple[Floats, Floats]:
    """The right and the left corner of the end of a lane, m."""
    begin, end = road.point_offset[lane : lane + 2]
    before, last = road.points[end - 2 : end] if end - begin > 1 else (road.points[begin],) * 2
    along = (last - before) / max(float(np.linalg.norm(last - before)), 1e-9)
    aside = road.width[lane] / 2 * np.array([-along[1], along[0]])
    return last - aside, last + aside
