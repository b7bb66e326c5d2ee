"""The lanes of a connection, from one of them to the lane where it ends."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sumo_mcts.numerics.lanes import connection


def road(internal: list[bool], onward: list[list[int]]) -> Any:
    offsets = np.cumsum([0, *map(len, onward)])
    return SimpleNamespace(
        internal=np.array(internal),
        successor=np.array([lane for lanes in onward for lane in lanes], np.int64),
        successor_offset=offsets,
    )


@pytest.mark.parametrize(
    ("internal", "onward", "path"),
    [
        ([False, True], [[1], []], [0]),  # an ordinary lane, whatever follows
        ([True, True, False, False], [[1], [2], [3], []], [0, 1, 2]),
        ([True, True], [[1], []], [0, 1]),  # nothing follows
        ([True, True], [[1], [0]], [0, 1]),  # a damaged network: in a circle
        ([True] * 12 + [False], [[k + 1] for k in range(12)] + [[]], list(range(13))),
    ],
)
def test_a_connection_ends_at_the_first_ordinary_lane(
    internal: list[bool], onward: list[list[int]], path: list[int]
) -> None:
    assert connection(road(internal, onward), 0) == path
