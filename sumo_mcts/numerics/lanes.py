"""How to read a road map: which lanes follow a lane, and on which a vehicle may drive."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.scene import IGNORING, Ints, RoadMap


def successors(road: RoadMap, lane: int) -> list[int]:
    """The lanes that may be driven next."""
    following: list[int] = road.successor[
        road.successor_offset[lane] : road.successor_offset[lane + 1]
    ].tolist()
    return following


def usable(road: RoadMap, lanes: Ints | NDArray[np.int64] | slice, vclass: int) -> NDArray[Any]:
    """[lanes] whether a vehicle of this class may drive on them."""
    classes = road.classes[lanes]
    return (
        np.ones(len(classes), np.bool_)
        if vclass == IGNORING
        else (classes >> np.uint64(vclass)) & np.uint64(1) == 1
    )
