"""The yardstick for speed never changes: its tree is the same to the visit."""

import numpy as np
import pytest

from sumo_mcts.numerics import yardstick
from sumo_mcts.numerics.geometry import COS, SIN, Box, X, Y, box_distance

PASSES = 3000


@pytest.fixture(scope="module")
def nodes() -> yardstick.Nodes:
    return yardstick.searched(PASSES)


def test_its_tree_is_frozen(nodes: yardstick.Nodes) -> None:
    """Another digest means another yardstick: all ratios noted before would be worthless."""
    assert yardstick.digest(nodes) == "80af254018e2a15f"


def test_every_pass_is_counted(nodes: yardstick.Nodes) -> None:
    assert nodes.visits[0] == PASSES
    for node in range(100):
        children = nodes.child[node][nodes.child[node] >= 0]
        ended_here = 0 if node == 0 else 1  # the pass that made it
        if len(children):
            assert nodes.visits[children].sum() + ended_here == nodes.visits[node]
            assert (nodes.parent[children] == node).all()


def test_the_root_tries_all_actions_and_stays_with_the_cheapest(nodes: yardstick.Nodes) -> None:
    children = nodes.child[0]
    assert (children >= 0).all() and (nodes.visits[children] > 10).all()
    mean = nodes.total[children] / nodes.visits[children]
    assert nodes.visits[children].argmax() == mean.argmin()


def test_distances_and_contacts_are_those_of_boxes() -> None:
    """The distance of the kernel against all ten boxes, one by one."""
    given = yardstick.problem()
    size = yardstick.HALF_LENGTH, yardstick.HALF_WIDTH
    touched = 0
    for s in np.linspace(0.0, 120.0, 61):
        for t in range(0, len(given.agent), 5):
            ego = yardstick._pose(given.path, float(s))
            boxes = [Box(a[X], a[Y], a[COS], a[SIN], *size) for a in given.agent[t]]
            near = [
                box_distance(ego, box)
                for box in boxes
                if np.hypot(box.x - ego.x, box.y - ego.y) <= yardstick.REACH
            ]
            least = min([yardstick.REACH, *near])
            assert yardstick._nearest(given, ego, t) == pytest.approx(least)
            touched += least == 0.0
    assert touched > 20, "somebody is in the way"


def test_a_contact_ends_a_pass_and_costs() -> None:
    given = yardstick.problem()
    ends = {yardstick._ply(given, float(s), 10.0, 0.0, 3)[3] for s in range(100)}
    assert ends == {0, 1}
    s = next(s for s in range(100) if yardstick._ply(given, float(s), 10.0, 0.0, 3)[3])
    assert yardstick._ply(given, float(s), 10.0, 0.0, 3)[2] >= yardstick.CONTACT
