"""Boxes that meet while they move."""

from math import pi

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely import Polygon, affinity, box  # type: ignore[import-untyped]

from sumo_mcts.evaluation.contact import (
    between,
    boxes_overlap,
    first_contact,
    jumped,
    kept_apart,
    touch_point,
)

numbers = st.floats(-6.0, 6.0)
sizes = st.floats(0.2, 5.0)
angles = st.floats(-7.0, 7.0)


def polygon(values: tuple[float, ...]) -> Polygon:
    x, y, heading, long, wide = values
    return affinity.translate(
        affinity.rotate(box(-long, -wide, long, wide), heading, origin=(0, 0), use_radians=True),
        x,
        y,
    )


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(
    st.tuples(numbers, numbers, angles, sizes, sizes),
    st.tuples(numbers, numbers, angles, sizes, sizes),
)
def test_boxes_overlap_as_polygons_do(first: tuple[float, ...], second: tuple[float, ...]) -> None:
    a, b = polygon(first), polygon(second)
    shared = a.intersection(b).area
    assume(shared > 1e-9 or a.distance(b) > 1e-9)
    assert bool(boxes_overlap(np.array(first), np.array(second))) == (shared > 0)
    assert bool(boxes_overlap(np.array(second), np.array(first))) == (shared > 0)


def test_boxes_overlap_is_vectorised() -> None:
    ego = np.array([0.0, 0.0, 0.0, 2.5, 0.9])
    others = np.array(
        [
            [5.1, 0.0, 0.0, 2.5, 0.9],
            [4.9, 0.0, 0.0, 2.5, 0.9],
            [0.0, 3.2, 0.0, 2.5, 0.9],
            [0.0, 3.2, pi / 2, 2.5, 0.9],
        ]
    )
    assert boxes_overlap(ego, others).tolist() == [False, True, False, True]


@settings(max_examples=100, deadline=None)
@given(st.tuples(numbers, numbers, angles), st.tuples(numbers, numbers, angles))
def test_between_starts_and_ends_where_it_should(
    before: tuple[float, ...], after: tuple[float, ...]
) -> None:
    way = between(np.array(before), np.array(after), np.array([0.0, 1.0]))
    assert way[:, :2] == pytest.approx(np.array([before[:2], after[:2]]))
    assert np.cos(way[:, 2]) == pytest.approx(np.cos([before[2], after[2]]), abs=1e-9)


def test_between_follows_an_arc() -> None:
    radius, turn = 10.0, 1.0
    start, end = (
        np.array([radius, 0.0, pi / 2]),
        np.array([radius * np.cos(turn), radius * np.sin(turn), pi / 2 + turn]),
    )
    way = between(start, end, np.linspace(0, 1, 11))
    assert np.hypot(way[:, 0], way[:, 1]) == pytest.approx(
        radius, abs=0.08
    )  # the chord is 1.2 m off


def test_touch_point_is_the_middle_of_the_overlap() -> None:
    half = np.array([2.5, 0.9])
    contact = first_contact(
        np.array([0.0, 0, 0]),
        np.array([10.0, 0, 0]),
        np.array([12.0, 0.9, 0]),
        np.array([12.0, 0.9, 0]),
        half,
        half,
    )
    assert contact is not None
    assert contact.exact
    assert contact.ego[0] == pytest.approx(7.0, abs=0.01)
    assert touch_point(contact) == pytest.approx((9.5, 0.45), abs=0.01)


def test_no_contact_between_vehicles_that_pass() -> None:
    half = np.array([2.5, 0.9])
    assert (
        first_contact(
            np.array([0.0, 0, 0]),
            np.array([20.0, 0, 0]),
            np.array([20.0, 2, pi]),
            np.array([0.0, 2, pi]),
            half,
            half,
        )
        is None
    )


poses = st.tuples(st.floats(-15.0, 15.0), st.floats(-15.0, 15.0), angles)


@settings(max_examples=300, deadline=None)
@given(poses, poses, poses, poses)
def test_the_cheap_test_never_denies_a_contact(
    a: tuple[float, ...], b: tuple[float, ...], c: tuple[float, ...], d: tuple[float, ...]
) -> None:
    half = np.array([2.5, 0.9])
    a0, a1, b0, b1 = (np.array(pose) for pose in (a, b, c, d))
    if kept_apart(a0, a1, half, b0[None], b1[None], half[None])[0]:
        assert first_contact(a0, a1, b0, b1, half, half) is None


def test_jumps_are_told_from_arcs() -> None:
    before = np.array([[0.0, 0.0, 0.0]] * 4)
    after = np.array(
        [
            [8.0, 3.2, 0.0],
            [8.0, 1.0, 0.0],
            [10 * np.sin(0.8), 10 - 10 * np.cos(0.8), 0.8],
            [60.0, 0.0, 0.0],
        ]
    )
    assert jumped(before, after, np.full(4, 20.0)).tolist() == [True, False, False, True]
