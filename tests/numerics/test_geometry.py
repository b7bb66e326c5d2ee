"""Boxes and polylines against shapely."""

import math
from itertools import pairwise

import naive
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from shapely import LineString, Point

from sumo_mcts.numerics.geometry import Box, box_distance, boxes_touch, chord, nearest, point_at

near = st.floats(-12.0, 12.0)
angle = st.one_of(
    st.floats(-math.pi, math.pi), st.sampled_from([0.0, math.pi / 2, math.pi, -math.pi / 2])
)
boxes = st.builds(naive.Box, near, near, angle, st.floats(0.2, 9.0), st.floats(0.2, 1.5))
polylines = st.lists(st.tuples(st.floats(-100, 100), st.floats(-100, 100)), min_size=2, max_size=8)


@given(boxes, boxes)
def test_boxes_touch_as_shapely_says(a: naive.Box, b: naive.Box) -> None:
    touching = naive.distance(a, b) == 0.0
    assume(
        touching
        == a.polygon(1e-6).intersects(b.polygon(1e-6))
        == a.polygon(-1e-6).intersects(b.polygon(-1e-6))
    )  # not a matter of rounding
    assert (
        boxes_touch(Box(*a.flat()), Box(*b.flat()))
        == touching
        == boxes_touch(Box(*b.flat()), Box(*a.flat()))
    )


@given(boxes, boxes)
def test_box_distance_is_shapelys(a: naive.Box, b: naive.Box) -> None:
    assert box_distance(Box(*a.flat()), Box(*b.flat())) == pytest.approx(
        naive.distance(a, b), abs=1e-6
    )


@given(polylines, st.floats(-0.5, 1.5))
def test_point_at_is_the_point_at_that_arc_length(
    points: list[tuple[float, float]], share: float
) -> None:
    assume(all(math.dist(a, b) > 0.1 for a, b in pairwise(points)))
    arcs = naive.arc_lengths(points)
    padded = np.array(
        [(999.0, 999.0), *points, (-999.0, 999.0)]
    )  # neighbours in the array belong to other lanes
    found = point_at(padded, np.array([0.0, *arcs, 0.0]), 1, 1 + len(points), share * arcs[-1])
    assert found == pytest.approx(naive.point_at(points, share * arcs[-1]), abs=1e-6)


@given(polylines, near, near, st.floats(0.0, 0.9))
def test_the_nearest_place_of_each_piece_is_shapelys(
    points: list[tuple[float, float]], x: float, y: float, least: float
) -> None:
    corners = np.array(points)
    begin, way = corners[:-1], np.diff(corners, axis=0)
    assume((np.hypot(way[:, 0], way[:, 1]) > 1e-3).all())
    share, away = nearest(begin, way, x, y, least)
    kept = [LineString([a + least * along, a + along]) for a, along in zip(begin, way, strict=True)]
    assert away == pytest.approx([piece.distance(Point(x, y)) for piece in kept], abs=1e-6)
    foot = begin + share[:, None] * way
    assert np.hypot(foot[:, 0] - x, foot[:, 1] - y) == pytest.approx(away, abs=1e-9)
    assert ((least <= share) & (share <= 1.0)).all()


def test_a_piece_without_length_is_a_point() -> None:
    _, away = nearest(np.array([[3.0, 0.0]]), np.zeros((1, 2)), 0.0, 4.0)
    assert away.tolist() == [5.0]


@given(boxes)
def test_chord_is_the_box_between_its_bumpers(box: naive.Box) -> None:
    x, y, c, s, length, _ = box.flat()
    assert chord(
        x + c * length, y + s * length, x - c * length, y - s * length, 1.0, 0.0
    ) == pytest.approx((x, y, c, s), abs=1e-9)
    assert chord(x, y, x, y, c, s) == (x, y, c, s)  # without a length the heading stays
