"""The share of a body that is drawn where lanes are longer than their shapes."""

import numpy as np
import pytest
from helpers import Lane, build, lane

from sumo_mcts.numerics.drawn import as_drawn, drawing, drawn_shares
from sumo_mcts.numerics.geometry import Box
from sumo_mcts.road import RoadMap


def road(scale: float) -> RoadMap:
    """A lane drawn at a scale, and one behind it drawn as it is."""
    made = build(
        [
            Lane("a", 0, ((0.0, 0.0), (50.0, 0.0)), ("b_0",)),
            Lane("b", 0, ((50.0, 0.0), (100.0, 0.0))),
        ]
    )
    return made._replace(scale=np.array([scale, 1.0]), length=np.array([50.0 / scale, 50.0]))


@pytest.mark.parametrize(
    ("name", "s", "length", "share"),
    [
        ("a_0", 80.0, 5.0, 0.5),
        ("b_0", 10.0, 5.0, 1.0),
        ("b_0", 2.0, 5.0, (2.0 + 3.0 * 0.5) / 5.0),  # its rear is on the lane behind
        ("a_0", 2.0, 5.0, (2.0 * 0.5 + 3.0) / 5.0),  # what is behind the road is drawn in full
    ],
)
def test_a_body_is_drawn_from_its_front_to_its_rear(
    name: str, s: float, length: float, share: float
) -> None:
    squeezed = road(0.5)
    found = drawn_shares(
        drawing(squeezed), np.array([lane(squeezed, name), -1]), np.array([s]), np.array([length])
    )
    assert found == pytest.approx([share, 1.0])


@pytest.mark.parametrize("scale", [0.999, 1.0, 3.0])
def test_elsewhere_it_is_drawn_in_full(scale: float) -> None:
    usual = drawing(road(scale))
    assert not len(usual.near)
    assert drawn_shares(usual, np.array([0]), np.array([9.0]), np.array([5.0])).tolist() == [1.0]


def test_the_front_stays_where_it_is() -> None:
    box = as_drawn(Box(1.0, 2.0, 0.6, 0.8, 2.5, 0.9), 0.4, 2.5)
    front = box.x + 0.6 * box.half_length, box.y + 0.8 * box.half_length
    assert box.half_length == pytest.approx(1.0) and box.half_width == 0.9
    assert front == pytest.approx((1.0 + 0.6 * 2.5, 2.0 + 0.8 * 2.5))
