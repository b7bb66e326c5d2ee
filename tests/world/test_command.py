"""The last line of defence: no command leaves the bounds on acceleration and jerk, whatever a
planner wants."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts.world.command import Bounds, bounded

BOUNDS = Bounds(step=0.1, change_duration=3.0, accel=2.6, decel=8.0, jerk=20.0)
SLACK = 1e-5


@given(st.floats(), st.floats(0.0, 50.0), st.floats(-300.0, 300.0))
def test_never_beyond_the_bounds(wanted: float, v: float, a: float) -> None:
    speed = bounded(wanted, v, a, BOUNDS)
    reached = (speed - v) / BOUNDS.step
    assert speed >= 0.0
    assert reached <= BOUNDS.accel + SLACK
    assert reached >= -BOUNDS.decel - SLACK
    if -BOUNDS.decel <= a <= BOUNDS.accel:  # from beyond the bounds the way back is not bounded
        assert reached <= max(a + BOUNDS.jerk * BOUNDS.step, -v / BOUNDS.step) + SLACK
        assert reached >= a - BOUNDS.jerk * BOUNDS.step - SLACK


@pytest.mark.parametrize(
    ("wanted", "a", "speed"),
    [
        (10.1, 1.0, 10.1),
        (9.9, -1.0, 9.9),
        (10.0, 0.0, 10.0),
        (0.0, 0.0, 9.8),
        (50.0, 0.0, 10.2),
        (50.0, 2.0, 10.26),
    ],
)
def test_what_is_possible_is_done_to_the_bit(wanted: float, a: float, speed: float) -> None:
    assert bounded(wanted, 10.0, a, BOUNDS) == pytest.approx(speed, abs=1e-6)
    if abs(wanted - 10.0) < 0.2:
        assert bounded(wanted, 10.0, a, BOUNDS) == wanted


def test_no_number_means_stop() -> None:
    assert bounded(math.nan, 10.0, 0.0, BOUNDS) == bounded(0.0, 10.0, 0.0, BOUNDS)
