"""Coarse columns: to whole steps and back, whatever the shape and the numbers."""

import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from sumo_mcts.records.coarse import (
    LENGTH,
    MOST,
    POSE,
    Layout,
    from_steps,
    layout_of,
    narrowed,
    to_steps,
)

ZERO, ONE = Layout(0, LENGTH), Layout(1, LENGTH)


@given(
    values=arrays(
        np.float64,
        array_shapes(min_dims=1, max_dims=4, min_side=0, max_side=4),
        elements=st.floats(-1e7, 1e7),
    ),
    layout=st.sampled_from(
        [Layout(0, POSE), Layout(1, POSE), Layout(0, LENGTH), Layout(1, LENGTH)]
    ),
)
@settings(deadline=None)
def test_what_comes_back_is_within_half_a_step(values: np.ndarray, layout: Layout) -> None:
    row = to_steps(values, layout)
    assert row.shape == (values.size,)
    back = from_steps(row, values.shape, layout)
    assert back.shape == values.shape
    np.testing.assert_allclose(back, values, atol=0.5 * LENGTH[0] + 1e-8)
    again = from_steps(to_steps(back, layout), values.shape, layout)
    np.testing.assert_array_equal(again, back)


@pytest.mark.parametrize("axis", [0, 1])
def test_headings_are_kept_finer_than_places(axis: int) -> None:
    angle = np.linspace(0.0, 6.0, 24).reshape(2, 3, 4)
    pose = np.stack([100.0 * angle, -50.0 * angle, np.cos(angle), np.sin(angle)], axis=-1)
    back = from_steps(to_steps(pose, Layout(axis, POSE)), pose.shape, Layout(axis, POSE))
    assert np.abs(back - pose)[..., 2:].max() <= 5.0001e-5
    assert np.abs(back - pose)[..., :2].max() <= 0.0050001


def test_what_is_no_number_stays_none_and_spoils_no_neighbour() -> None:
    values = np.arange(12.0).reshape(2, 6)
    values[1, 2] = np.nan
    back = from_steps(to_steps(values, ONE), values.shape, ONE)
    assert np.isnan(back[1, 2]) and np.isnan(back).sum() == 1
    np.testing.assert_allclose(np.delete(back, 2, axis=1), np.delete(values, 2, axis=1))


def test_infinite_values_become_the_largest() -> None:
    back = from_steps(to_steps(np.array([np.inf, -np.inf, 1.0]), ZERO), (3,), ZERO)
    np.testing.assert_allclose(back, [MOST * LENGTH[0], -MOST * LENGTH[0], 1.0])


def test_even_motion_and_equal_hypotheses_take_no_space() -> None:
    """Second differences are 0, so it packs into little; the values themselves do not."""
    time = 0.2 * np.arange(41.0)
    s = (10.0 + np.arange(30.0) + np.arange(30.0) / 7.0 * time[:, None])[None].repeat(4, axis=0)
    packed = len(zlib.compress(narrowed(to_steps(s, ONE)).tobytes()))
    assert packed < 0.25 * len(zlib.compress(s.astype(np.float32).tobytes()))


def test_far_places_take_64_bits_and_the_others_32() -> None:
    """UTM's northings fit 32 bits, coordinates of 100 000 km do not."""
    for far, bits in ((9.0e6, np.int32), (1e8, np.int64)):
        values = far + np.arange(6.0)
        row = narrowed(to_steps(values, ZERO))
        assert row.dtype == bits
        np.testing.assert_allclose(from_steps(row, (6,), ZERO), values, atol=0.005)


def test_four_agents_are_no_pose() -> None:
    speeds = np.full((1, 3, 4), 3.004)
    np.testing.assert_allclose(from_steps(to_steps(speeds, ONE), (1, 3, 4), ONE), 3.0)


def test_only_the_large_columns_are_coarse() -> None:
    assert layout_of("trace/cycles/forecast/pose") == Layout(1, POSE)
    assert layout_of("trace/cycles/decision/plan/Plan/pose") == Layout(0, POSE)
    assert layout_of("trace/cycles/forecast/v") == ONE
    assert layout_of("trace/cycles/ego/v") is None
    assert layout_of("trace/cycles/decision/plan/Plan/v") is None
