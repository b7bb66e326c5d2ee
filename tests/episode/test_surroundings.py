"""Which lanes a trace keeps."""

from typing import Any

import numpy as np

from sumo_mcts.episode.surroundings import lanes_around
from sumo_mcts.road import RoadMap


def _grid() -> RoadMap:
    """An approach of two lanes, an internal lane from each (the left one signalled), and an exit of
    one lane far away."""
    shapes: list[list[tuple[float, float]]] = [
        [(0, -3.2), (50, -3.2)],
        [(0, 0), (50, 0)],
        [(50, -3.2), (60, -3.2)],
        [(50, 0), (55, 0), (60, -3.2)],
        [(60, -3.2), (90, -3.2)],
    ]
    points = np.array([point for shape in shapes for point in shape], dtype=np.float64)
    ints: dict[str, list[int]] = {
        "edge": [0, 0, 1, 1, 2], "exit": [0, 1, 4, 4, 4], "rule": [0, 0, 0, 0, 0],
        "signal": [-1, -1, -1, 0, -1],
        "point_offset": [0, 2, 4, 6, 9, 11], "successor_offset": [0, 1, 2, 3, 4, 4],
        "successor": [2, 3, 4, 4], "oncoming": [],
    }  # fmt: skip
    given: dict[str, Any] = {
        "lane_ids": ("a_0", "a_1", ":j_0_0", ":j_0_1", "b_0"),
        "internal": np.array([False, False, True, True, False]),
        "width": np.full(5, 3.2),
    }
    arrays = {name: np.array(values, dtype=np.int32) for name, values in ints.items()}
    return RoadMap(**dict.fromkeys(RoadMap._fields) | {"points": points, **arrays, **given})  # type: ignore[arg-type]


def test_the_lanes_near_the_ego_are_kept_with_route_and_stop_lines() -> None:
    lanes = lanes_around(_grid(), ((0, 2),), np.array([[45.0, 0.0]]), 20.0)
    assert lanes.lane_ids == ("a_0", "a_1", ":j_0_0", ":j_0_1", "b_0")
    assert lanes.offset.tolist() == [0, 2, 4, 6, 9, 11]
    assert lanes.route.tolist() == [True] * 5
    np.testing.assert_allclose(lanes.stop_lines, [[50, 1.6, 50, -1.6]])
    assert lanes_around(_grid(), ((0,),), np.array([[90.0, 0.0]]), 5.0).lane_ids == ("b_0",)
    assert lanes_around(_grid(), ((0,),), np.array([[25.0, 3.0]]), 5.0).lane_ids == (
        "a_1",
    )  # in the middle of a long straight piece
    assert lanes_around(_grid(), ((0,),), np.array([[900.0, 0.0]]), 5.0).lane_ids == ()
