"""A vehicle that turns round within a step, beside one that sets off."""

import math

import numpy as np
import pytest
from helpers import Agent, Lane, build, ego_at, frame_of

from sumo_mcts.evaluation.contact import Contact, contacts
from sumo_mcts.evaluation.on_lanes import Move, Place, clear_on_lanes, poses_on_lanes
from sumo_mcts.numerics.drawn import drawing
from sumo_mcts.scene import EgoState, Frame

# A road northward of two lanes, where one turns round on the left and the other right, as
# netgenerate draws it.
TURN = ((121.6, 349.6), (120.8, 350.8), (120.0, 351.2), (119.2, 350.8), (118.4, 349.6))
ROAD = build([
    Lane("n", 0, ((124.8, 250.4), (124.8, 349.6)), (":r_0",)),
    Lane("n", 1, ((121.6, 250.4), (121.6, 349.6)), (":t_0",)),
    Lane(":t", 0, TURN, ("s_0",), junction="c"),
    Lane("s", 0, ((118.4, 349.6), (118.4, 250.4))),
    Lane(":r", 0, ((124.8, 349.6), (125.15, 352.05), (126.2, 353.8), (127.95, 354.85)), ("e_0",),
         junction="c"),
    Lane("e", 0, ((127.95, 354.85), (200.0, 354.85))),
])  # fmt: skip
DRAWING = drawing(ROAD)
LENGTH = 5.0  # m
# What SUMO showed before and after the step: front, degrees from north, lane, its position there
ROUND = ((121.0469, 350.4297, 353.4715, ":t_0", 0.9964), (118.4025, 349.6038, 276.0414, ":t_0",
         4.6654))  # fmt: skip
ASIDE = ((124.9760, 350.8319, 2.0210, ":r_0", 1.2447), (126.6167, 354.0500, 22.2144, ":r_0", 4.77))


def pose(x: float, y: float, degrees: float) -> tuple[float, float, float]:
    """The middle of a body, and its heading, rad from east."""
    heading = math.remainder(math.pi / 2 - math.radians(degrees), 2.0 * math.pi)
    return x - 2.5 * math.cos(heading), y - 2.5 * math.sin(heading), heading


def ego(moment: int) -> EgoState:
    x, y, degrees, name, s = ROUND[moment]
    x, y, heading = pose(x, y, degrees)
    return ego_at(ROAD, name, s, 3.7)._replace(x=x, y=y, heading=heading)


def frames(nearer: float = 0.0) -> tuple[Frame, Frame]:
    """The ego turns round, and the other is `nearer` (m) on its left."""
    found = []
    for moment, (front, y, degrees, name, s) in enumerate(ASIDE):
        x, y_now, heading = pose(front - nearer, y, degrees)
        frame = frame_of(ROAD, float(moment), ego(moment), Agent("x", name, s, 3.8))
        where = {"x": np.array([x]), "y": np.array([y_now]), "heading": np.array([heading])}
        found.append(frame._replace(agents=frame.agents._replace(**where)))
    return found[0], found[1]


def met(before: Frame, after: Frame) -> dict[str, Contact]:
    return contacts(ROAD, DRAWING, 1.0, before, after, np.zeros(1, np.int32))


def test_a_rear_that_swings_out_at_the_end_has_not_been_there_before() -> None:
    """0.4 m are between the two after the step, more before; from the poses alone they touch."""
    before, after = frames()
    hits = met(before, after)
    assert set(hits) == {"x"} and hits["x"].exact
    assert clear_on_lanes(ROAD, before, after, "x", 0, hits["x"])


def test_what_touches_along_the_lanes_too_is_a_contact() -> None:
    before, after = frames(0.5)
    hits = met(before, after)
    assert not clear_on_lanes(ROAD, before, after, "x", 0, hits["x"])


def test_where_the_lanes_do_not_tell_the_poses_do() -> None:
    """The ego is not drawn where its lane lies."""
    before, after = frames()
    hit = met(before, after)["x"]
    aside = after._replace(ego=after.ego._replace(y=after.ego.y + 0.5))
    assert not clear_on_lanes(ROAD, before, aside, "x", 0, hit)
    off = after._replace(ego=after.ego._replace(lane=-1))
    assert not clear_on_lanes(ROAD, before, off, "x", 0, hit)


def test_front_and_rear_are_on_the_lanes() -> None:
    """Half way round the rear is still on the road."""
    places = [Place(each.lane, each.s, np.array([each.x, each.y, each.heading]))
              for each in (ego(0), ego(1))]  # fmt: skip
    found = poses_on_lanes(ROAD, Move(*places, LENGTH), np.array([0.0, 0.5, 1.0]))
    assert found is not None
    assert found[0] == pytest.approx(places[0].pose, abs=0.05)
    assert found[-1] == pytest.approx(places[1].pose, abs=0.05)
    x, y, heading = found[1]
    front = x + 2.5 * math.cos(heading), y + 2.5 * math.sin(heading)
    assert front == pytest.approx((119.56, 350.98), abs=0.01)
    assert math.degrees(heading) == pytest.approx(119.9, abs=0.1)  # evenly: 135
    behind = (121.6 - front[0]) / -math.cos(heading)
    assert front[1] - behind * math.sin(heading) == pytest.approx(349.6 - (5.0 - 2.83), abs=0.1)
