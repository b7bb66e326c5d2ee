"""How much of a body is drawn. Where a lane is longer than its shape, SUMO draws vehicles closer
together than they are, and shorter: from the front to where the rear's lane position lies."""

from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices, Ints
from sumo_mcts.numerics.geometry import Box
from sumo_mcts.numerics.kernel import entry, inlined
from sumo_mcts.road import RoadMap

LONGEST = 25.0  # m of a body
SEEN = 0.1  # m by which a body has to be drawn shorter for it to matter
# Lanes behind the one of its front that a body can lie on: they can be very short inside junctions.
MOST_UNDER = 7


class Drawing(NamedTuple):
    """How a network is drawn. L lanes; all fields are empty where bodies are as long as drawn."""

    near: Bools  # [L] a body with its front here may be drawn shorter than it is
    before: Indices  # [L] the lane before that is drawn shortest, -1 none
    length: Floats  # [L] m
    scale: Floats  # [L] m of the shape for each metre of the lane, 1 at most


def drawing(road: RoadMap) -> Drawing:
    """How a network is drawn."""
    near = (1.0 - road.scale) * np.minimum(road.length, LONGEST) > SEEN
    if not near.any():
        return Drawing(near[:0], np.zeros(0, np.int64), np.zeros(0), np.zeros(0))
    count = len(road.length)
    origin = np.repeat(np.arange(count), np.diff(road.successor_offset))
    before = np.full(count, -1, np.int64)
    shortest_last = np.argsort(-road.scale[origin], kind="stable")
    before[road.successor[shortest_last]] = origin[shortest_last]
    for _ in range(MOST_UNDER):
        near[road.successor[near[origin]]] = True
    return Drawing(near, before, road.length, np.minimum(road.scale, 1.0))


def drawn_shares(drawing: Drawing, lane: Ints | Indices, s: Floats, length: Floats) -> Floats:
    """The share of their length to which bodies are drawn, their fronts at s (m) on `lane`, of a
    `length` (m); the shapes are broadcast. 1 off the road."""
    lane, s, length = np.broadcast_arrays(lane, s, length)
    shares = np.ones(lane.size)
    if len(drawing.near):
        _fill_shares(shares, drawing, lane.astype(np.int64).ravel(), s.ravel(), length.ravel())
    return shares.reshape(lane.shape)


@entry
def _fill_shares(
    shares: Floats, drawing: Drawing, lane: Indices, s: Floats, length: Floats
) -> None:
    for i in range(len(shares)):
        here, room, rest, drawn = lane[i], s[i], length[i], 0.0
        for _ in range(MOST_UNDER + 1):
            if here < 0:
                break
            covered = min(max(room, 0.0), rest)
            drawn += covered * drawing.scale[here]
            rest -= covered
            here = drawing.before[here]
            room = drawing.length[here]
        missing = length[i] - drawn - rest  # what lies beyond is drawn in full
        if missing > SEEN:
            shares[i] = 1.0 - missing / max(length[i], SEEN)


@inlined
def as_drawn(box: Box, share: float, half: float) -> Box:
    """A body of half length `half` (m), perhaps lengthened at both ends to `box`, as it is drawn:
    its front stays, and lengths along it become this share."""
    ahead = (1.0 - share) * half
    return Box(
        box.x + ahead * box.cos,
        box.y + ahead * box.sin,
        box.cos,
        box.sin,
        share * box.half_length,
        box.half_width,
    )
