"""Contacts within a step: against plain sampling of boxes on straight lines, and values worked out
by hand."""

from collections.abc import Sequence
from math import inf, pi, sin

import numpy as np
import pytest
from helpers import Agent, Lane, agents_at, build, ego_at, frame_of
from helpers_referee import CROSSING, STRAIGHT
from shapely import affinity, box  # type: ignore[import-untyped]

from sumo_mcts.arrays import Floats
from sumo_mcts.evaluation.contact import (
    Contact,
    _gap_along,
    _moves,
    _stray,
    _stretch,
    ahead_of,
    as_drawn,
    between,
    boxes_overlap,
    contacts,
    first_contact,
    jumped,
    kept_apart,
    touch_point,
)
from sumo_mcts.numerics.drawn import drawing
from sumo_mcts.road import RoadMap

CAR = np.array([2.5, 0.9])  # half length, half width, m
DRAWING = drawing(CROSSING)
EAST = (("wi_0", -100.0, 90.0), (":we_0", -10.0, 20.0), ("eo_0", 10.0, 90.0))
NORTH = (("si_0", -100.0, 90.0), (":sn_0", -10.0, 20.0), ("no_0", 10.0, 90.0))


def pose(x: float, y: float, heading: float = 0.0) -> Floats:
    return np.array([x, y, heading])


# --- a whole step, against plain sampling ---


def on(line: Sequence[tuple[str, float, float]], front: float) -> tuple[str, float]:
    """The lane of a straight road, and the position on it, of a front at this coordinate."""
    name, begin, _ = next(each for each in line if front <= each[1] + each[2])
    return name, front - begin


def met(step: float, ego: tuple[float, float], *others: tuple[float, float, float, float]) -> set:
    """Who met an ego that goes east at constant speed (front, m/s). The others go north: front,
    speed, length, width."""
    frames = []
    for time in (0.0, step):
        agents = [
            Agent(f"x{k}", *on(NORTH, y + v * time), v, length=length, width=width)
            for k, (y, v, length, width) in enumerate(others)
        ]
        front = ego[0] + ego[1] * time
        frames.append(frame_of(CROSSING, time, ego_at(CROSSING, *on(EAST, front), ego[1]), *agents))
    known = np.arange(len(others), dtype=np.int32)
    return set(contacts(CROSSING, DRAWING, step, *frames, known))


def overlap(
    step: float, ego: tuple[float, float], other: tuple[float, float, float, float]
) -> float:
    """By how much the two boxes overlap at most within the step, m; below 0: apart."""
    y, v, length, width = other
    t = np.linspace(0.0, step, 2001)
    across = np.abs(ego[0] + ego[1] * t - 2.5 - 1.6)
    along = np.abs(y + v * t - length / 2 + 1.6)
    deep = np.minimum(2.5 + width / 2 - across, 0.9 + length / 2 - along)
    return float(deep.max())


def test_met_is_who_overlaps_at_some_moment_of_the_step() -> None:
    """Cars, trucks and bicycles, slow ones and such that are through within the step."""
    rng, found = np.random.default_rng(5), []
    for _ in range(250):
        step = float(rng.choice([0.1, 0.5, 1.0]))
        ego = float(rng.uniform(-20.0, 12.0)), float(rng.uniform(0.0, 30.0))
        others = []
        for _ in range(2):
            length, width = ((5.0, 1.8), (16.0, 2.5), (1.8, 0.6))[rng.integers(3)]
            others.append(
                (float(rng.uniform(-25.0, 12.0)), float(rng.uniform(0.0, 40.0)), length, width)
            )
        depth = [overlap(step, ego, other) for other in others]
        if min(abs(each) for each in depth) < 0.3:
            continue  # the boxes are tested once in 0.4 m of motion
        assert met(step, ego, *others) == {f"x{k}" for k in range(2) if depth[k] > 0.0}
        found += [each > 0.0 for each in depth]
    assert 40 < sum(found) < len(found) - 40


@pytest.mark.parametrize("speeds", [(44.0, 0.1), (0.1, 44.0)])
def test_the_faster_one_of_two_speeds_tells_how_far_away_it_may_be(
    speeds: tuple[float, float],
) -> None:
    """It drives through the ego, and brakes or accelerates meanwhile."""
    ego = ego_at(CROSSING, ":we_0", 14.1, 0.0)
    places = zip((-26.0, 14.0), speeds, strict=True)
    agents = [Agent("x", *on(NORTH, front), v) for front, v in places]
    frames = [frame_of(CROSSING, k, ego, agent) for k, agent in enumerate(agents)]
    assert set(contacts(CROSSING, DRAWING, 1.0, *frames, np.zeros(1, np.int32))) == {"x"}


@pytest.mark.parametrize("speeds", [(44.0, 0.1), (0.1, 44.0)])
def test_so_it_is_for_the_ego(speeds: tuple[float, float]) -> None:
    stands = Agent("x", *on(NORTH, 0.9), 0.0)
    places = zip((-26.0, 14.0), speeds, strict=True)
    egos = [ego_at(CROSSING, *on(EAST, front), v) for front, v in places]
    frames = [frame_of(CROSSING, k, ego, stands) for k, ego in enumerate(egos)]
    assert set(contacts(CROSSING, DRAWING, 1.0, *frames, np.zeros(1, np.int32))) == {"x"}


def test_a_long_ego_is_met_where_its_rear_is() -> None:
    """Its front is 10 m behind the junction, its rear 2 m before the middle of it."""
    ego = ego_at(CROSSING, "no_0", 10.0, 0.0, length=22.0)
    agents = [Agent("x", ":we_0", s, 10.0) for s in (8.0, 13.0)]
    frames = [frame_of(CROSSING, 0.5 * k, ego, agent) for k, agent in enumerate(agents)]
    assert set(contacts(CROSSING, DRAWING, 0.5, *frames, np.zeros(1, np.int32))) == {"x"}


def test_who_was_put_beyond_the_ego_did_not_drive_through_it() -> None:
    """16 m within 0.1 s at 10 m/s."""
    ego = ego_at(CROSSING, ":we_0", 14.1, 0.0)
    agents = [Agent("x", *on(NORTH, front), 10.0) for front in (-8.0, 8.0)]
    frames = [frame_of(CROSSING, 0.1 * k, ego, agent) for k, agent in enumerate(agents)]
    assert contacts(CROSSING, DRAWING, 0.1, *frames, np.zeros(1, np.int32)) == {}


def test_on_lanes_that_are_drawn_longer_vehicles_are_drawn_faster() -> None:
    scale = CROSSING.scale.copy()
    scale[:3] = 2.0, 0.5, 1.0
    road = CROSSING._replace(scale=scale)
    assert _stretch(road, np.array([0, 1, 2, -1])).tolist() == [2.0, 1.0, 1.0, 1.0]


def test_who_was_put_into_the_ego_met_it_nobody_knows_where() -> None:
    """Or the ego was put there; driven there, the moment is known."""
    here, far = ego_at(CROSSING, ":we_0", 14.1, 10.0), ego_at(CROSSING, "wi_0", 40.0, 10.0)
    into, away = Agent("x", ":sn_0", 12.0, 10.0), Agent("x", "si_0", 20.0, 10.0)
    driven = Agent("x", ":sn_0", 7.0, 10.0)
    known = np.zeros(1, np.int32)
    for (first, was), (ego, agent), exact in (
        ((here, away), (here, into), False), ((far, into), (here, into), False),
        ((here._replace(v=0.0), driven), (here._replace(v=0.0), into), True),
    ):  # fmt: skip
        frames = frame_of(CROSSING, 0.0, first, was), frame_of(CROSSING, 0.5, ego, agent)
        found = contacts(CROSSING, DRAWING, 0.5, *frames, known)
        assert found["x"].exact is exact
        if not exact:
            assert found["x"].ego == pytest.approx((ego.x, ego.y, 0.0))
            assert found["x"].other == pytest.approx((1.6, -0.5, pi / 2))
    new = contacts(CROSSING, DRAWING, 0.5, *frames, np.full(1, -1, np.int32))
    assert not new["x"].exact  # where it came from nobody knows


@pytest.mark.parametrize(("further", "met"), [(3.9, True), (4.8, False)])
def test_three_metres_more_than_its_speed_says_are_driven(further: float, met: bool) -> None:
    """A bicycle that crosses at 1 m/s within a second: half as much again, and 3 m."""
    ego = ego_at(CROSSING, ":we_0", 14.1, 0.0)
    front = -1.6 - 0.9 - 0.05
    frames = [
        frame_of(CROSSING, k, ego, Agent("x", *on(NORTH, y), 1.0, length=1.8, width=0.6))
        for k, y in enumerate((front, front + further))
    ]
    found = set(contacts(CROSSING, DRAWING, 1.0, *frames, np.zeros(1, np.int32)))
    assert found == ({"x"} if met else set())


def test_an_ego_that_was_put_beyond_somebody_did_not_drive_through_it() -> None:
    """16 m within 0.1 s at 10 m/s."""
    stands = Agent("x", *on(NORTH, 0.9), 0.0)
    egos = [ego_at(CROSSING, *on(EAST, front), 10.0) for front in (-6.0, 10.0)]
    frames = [frame_of(CROSSING, 0.1 * k, ego, stands) for k, ego in enumerate(egos)]
    assert contacts(CROSSING, DRAWING, 0.1, *frames, np.zeros(1, np.int32)) == {}


def test_in_a_step_of_two_seconds_both_come_twice_as_far() -> None:
    """At 30 m/s one of them passes where the other stands."""
    assert met(2.0, (-30.0, 30.0), (0.9, 0.0, 5.0, 1.8)) == {"x0"}
    assert met(2.0, (4.1, 0.0), (-20.0, 30.0, 5.0, 1.8)) == {"x0"}


@pytest.mark.parametrize(("x", "y", "angle"), [(700.0, -900.0, 0.0), (-50.0, 30.0, 2.0)])
def test_where_the_road_lies_does_not_matter(x: float, y: float, angle: float) -> None:
    """The same poses, moved and turned."""
    rng, c, s, met_by = np.random.default_rng(9), np.cos(angle), np.sin(angle), []
    known = np.zeros(1, np.int32)
    for _ in range(60):
        ego, agent = rng.uniform(-12.0, 8.0, 2)
        frames = [
            frame_of(
                CROSSING, k, ego_at(CROSSING, *on(EAST, ego + 4.0 * k), 8.0),
                Agent("x", *on(NORTH, agent + 6.0 * k), 12.0),
            )
            for k in range(2)
        ]  # fmt: skip
        moved = []
        for frame in frames:
            those = {}
            for name, old in (("ego", frame.ego), ("agents", frame.agents)):
                those[name] = old._replace(
                    x=x + c * old.x - s * old.y, y=y + s * old.x + c * old.y,
                    heading=old.heading + angle,
                )  # fmt: skip
            moved.append(frame._replace(**those))
        one, other = (contacts(CROSSING, DRAWING, 0.5, *each, known) for each in (frames, moved))
        assert set(one) == set(other)
        if one:
            place = one["x"].ego
            assert other["x"].ego == pytest.approx(
                (x + c * place[0] - s * place[1], y + s * place[0] + c * place[1], angle), abs=0.05
            )
        met_by.append(bool(one))
    assert 10 < sum(met_by) < 50


def test_nobody_is_met_where_nobody_is() -> None:
    frame = frame_of(CROSSING, 0.0, ego_at(CROSSING, ":we_0", 14.0))
    assert contacts(CROSSING, DRAWING, 1.0, frame, frame, np.zeros(0, np.int32)) == {}


# --- two boxes ---


@pytest.mark.parametrize(
    ("x", "y"), [(0.0, 3.304), (0.0, -3.304), (4.904, 1.131), (-4.904, -1.131)]
)
def test_a_corner_touches_a_side(x: float, y: float) -> None:
    """A box aslant by 45 degrees reaches (2.5 + 0.9) / sqrt(2) = 2.404 m along each axis."""
    box_at = np.array([0.0, 0.0, 0.0, 2.5, 0.9])
    for further, overlap_is in ((0.03, False), (-0.03, True)):
        if abs(y) > 2.0:
            place = x, y + further * np.sign(y)
        else:
            place = x + further * np.sign(x), y
        aslant = np.array([*place, pi / 4, 2.5, 0.9])
        assert bool(boxes_overlap(box_at, aslant)) is overlap_is
        assert bool(boxes_overlap(aslant, box_at)) is overlap_is


def test_the_first_contact_is_when_the_gap_is_used_up() -> None:
    """5 m between them, 10 m driven: after half of the step."""
    found = first_contact(pose(0, 0), pose(10, 0), pose(10, 0), pose(10, 0), CAR, CAR)
    assert found is not None and found.exact
    assert found.ego == pytest.approx((5.0, 0.0, 0.0), abs=1e-3)
    assert found.other == (10.0, 0.0, 0.0)
    met_by = first_contact(pose(10, 0), pose(10, 0), pose(0, 0), pose(10, 0), CAR, CAR)
    assert met_by is not None and met_by.other == pytest.approx((5.0, 0.0, 0.0), abs=1e-3)
    early = first_contact(pose(4.9, 0), pose(14.9, 0), pose(10, 0), pose(10, 0), CAR, CAR)
    assert early is not None and early.exact
    assert early.ego[0] == pytest.approx(5.0, abs=1e-3)


def test_where_boxes_overlap_from_the_beginning_nobody_knows_where_they_met() -> None:
    found = first_contact(pose(6, 0), pose(16, 0), pose(10, 0), pose(10, 0), CAR, CAR)
    assert found is not None and not found.exact
    assert found.ego == (6.0, 0.0, 0.0)


def test_what_is_passed_in_the_middle_of_a_step_is_met() -> None:
    """Also through the origin, and by a bar that turns on the spot to the opposite side or back."""
    post, bar = np.array([0.1, 0.1]), np.array([4.0, 0.1])
    there = pose(-5.0, 0.0), pose(-5.0, 0.0)
    assert first_contact(pose(-10, 0), pose(10, 0), *there, CAR, post) is not None
    assert first_contact(*there, pose(-10, 0), pose(10, 0), post, CAR) is not None
    beside = pose(3.0, 2.0), pose(3.0, 2.0)  # at an angle of 0.59
    for begin, end in ((-1.5, 1.5), (1.5, 0.0), (0.0, 1.5)):
        turns = pose(0, 0, begin), pose(0, 0, end)
        assert first_contact(*turns, *beside, bar, post) is not None
        assert first_contact(*beside, *turns, post, bar) is not None


def test_a_box_that_turns_on_the_spot_sweeps_what_is_beside_it() -> None:
    """A post 2 m to its left: neither where it begins nor where it ends does it reach so far."""
    post = np.array([0.1, 0.1])
    turns = pose(0, 0, 0.0), pose(0, 0, 3.0)
    bar, far = np.array([8.0, 0.2]), (pose(0, 6), pose(0, 6))
    assert first_contact(*turns, *far, bar, post) is not None
    assert first_contact(*far, *turns, post, bar) is not None
    still = pose(0, 2), pose(0, 2)
    for moves in ((*turns, *still, CAR, post), (*still, *turns, post, CAR)):
        assert first_contact(*moves) is not None
    assert first_contact(*turns, pose(0, 2.8), pose(0, 2.8), CAR, post) is None


def test_the_touch_point_by_hand() -> None:
    half = np.array([2.0, 1.0])

    def point(*other: float) -> tuple[float, float]:
        return touch_point(Contact((0.0, 0.0, 0.0), other, half, half, True))  # type: ignore[arg-type]

    assert point(3.0, 1.0, 0.0) == pytest.approx((1.5, 0.5))  # corner against corner
    assert point(-3.0, -1.5, 0.0) == pytest.approx((-1.5, -0.75))
    assert point(2.5, 1.2, pi / 2) == pytest.approx((1.75, 0.1))  # its side against the front
    assert point(0.5, -2.5, pi / 2) == pytest.approx((0.5, -0.75))
    square = np.array([1.0, 1.0])  # its corner reaches 1.414 m, the other begins at 1.2 m
    aslant = Contact((0.0, 0.0, pi / 4), (3.2, 0.0, 0.0), square, half, True)
    assert touch_point(aslant) == pytest.approx(((2**0.5 + 2 * 1.2) / 3, 0.0))
    assert point(6.0, 4.0, 0.0) == pytest.approx((3.0, 2.0))  # apart: between the middles
    assert point(4.0 - 0.5, 0.0, pi) == pytest.approx((1.75, 0.0))
    # sides that lie on each other: one behind the other in the same lane, and beside each other
    assert point(3.5, 0.0, 0.0) == pytest.approx((1.75, 0.0))
    assert point(0.0, 0.0, 0.0) == pytest.approx((0.0, 0.0))
    assert point(0.0, 1.8, 0.0) == pytest.approx((0.0, 0.9))


def test_the_touch_point_is_the_mean_corner_of_the_overlap() -> None:
    rng, tried = np.random.default_rng(8), 0
    for _ in range(60):
        poses = rng.uniform(-2.0, 2.0, (2, 2)), rng.uniform(-pi, pi, 2)
        halves = rng.uniform((1.5, 0.5), (3.0, 1.2), (2, 2))
        boxes = [
            affinity.translate(
                affinity.rotate(box(-a, -b, a, b), turned, origin=(0, 0), use_radians=True), x, y
            )
            for (x, y), turned, (a, b) in zip(*poses, halves, strict=True)
        ]
        shared = boxes[0].intersection(boxes[1])
        if shared.area < 0.05:
            continue
        ego, other = ((*place, turned) for place, turned in zip(*poses, strict=True))
        corners = np.array(shared.exterior.coords)[:-1]
        found = touch_point(Contact(ego, other, *halves, True))
        assert found == pytest.approx(corners.mean(axis=0), abs=1e-6)
        tried += 1
    assert tried > 20


def test_how_far_a_point_is_ahead() -> None:
    assert ahead_of((1.0, 2.0, 0.0), (4.0, 9.0)) == pytest.approx(3.0)
    assert ahead_of((1.0, 2.0, pi / 2), (4.0, 9.0)) == pytest.approx(7.0)
    assert ahead_of((1.0, 2.0, pi / 4), (0.0, 1.0)) == pytest.approx(-(2.0**0.5))


# --- the path within a step ---


def test_a_move_is_never_further_from_its_chord_than_the_bound() -> None:
    """The bound is 4/27 of how far the two tangents, as long as the chord, end away from it: for
    headings off by an angle, twice the sine of half the angle."""
    rng = np.random.default_rng(2)
    for _ in range(50):
        angle, begin, end = rng.uniform(-pi, pi), *rng.uniform(-1.2, 1.2, 2)
        length = rng.uniform(1.0, 30.0)
        before = pose(3.0, -4.0, angle + begin)
        after = pose(3.0 + length * np.cos(angle), -4.0 + length * np.sin(angle), angle + end)
        t = np.linspace(0.0, 1.0, 201)
        chord = before[:2] + t[:, None] * (after - before)[:2]
        off = np.hypot(*(between(before, after, t)[:, :2] - chord).T)
        bound = float(_stray(before, after))
        assert off.max() <= bound + 1e-9
        expected = 8.0 / 27.0 * length * (abs(sin(begin / 2)) + abs(sin(end / 2)))
        assert bound == pytest.approx(expected, abs=1e-6)


def test_straight_on_a_move_keeps_its_speed_and_the_heading_turns_evenly() -> None:
    t = np.array([0.0, 0.25, 0.5, 1.0])
    straight = between(pose(1, 2, pi / 2), pose(1, 10, pi / 2), t)
    assert straight[:, 0] == pytest.approx(1.0) and straight[:, 1] == pytest.approx(2 + 8 * t)
    turning = between(pose(0, 0, 3.0), pose(-8, 0, -3.0), t)
    assert turning[:, 2] == pytest.approx(3.0 + t * (2 * pi - 6.0))  # the short way round
    # symmetric in time: half way through it is half way along
    assert turning[2, 0] == pytest.approx(-4.0)


@pytest.mark.parametrize("heading", [0.0, 0.7, pi / 2, -2.5])
def test_a_jump_is_sideways_or_too_far(heading: float) -> None:
    def is_jump(ahead: float, left: float, turned: float = 0.0) -> bool:
        c, s = np.cos(heading + turned / 2), np.sin(heading + turned / 2)
        after = [7.0 + ahead * c - left * s, -3.0 + ahead * s + left * c, heading + turned]
        before = pose(7, -3, heading)[None]
        return bool(jumped(before, np.array([after]), np.array([20.0]))[0])

    assert not is_jump(8.0, 1.4) and is_jump(8.0, 1.6)
    assert not is_jump(8.0, -1.4) and is_jump(8.0, -1.6)
    assert not is_jump(19.9, 0.0) and is_jump(20.1, 0.0) and is_jump(-20.1, 0.0)
    assert not is_jump(9.0, 0.0, 1.4)  # along an arc


def test_an_axis_parts_boxes_that_do_not_turn_by_their_sizes_alone() -> None:
    def apart(x: float, y: float, heading: float = 0.0, drives: float = 8.0) -> bool:
        """A box that moves along with the ego."""
        before, after = pose(0, 0), pose(8, 0)
        other = pose(x, y, heading)[None], pose(x + drives, y, heading)[None]
        found = kept_apart(before, after, CAR, other[0], other[1], CAR[None])
        return bool(found[0])

    assert apart(0, 1.81) and apart(0, -1.81) and not apart(0, 1.79) and not apart(0, -1.79)
    assert apart(5.01, 0) and apart(-5.01, 0) and not apart(4.99, 0) and not apart(-4.99, 0)
    # it stands: what counts is the nearer end of the step
    assert not apart(12.9, 0, drives=0.0) and apart(13.1, 0, drives=0.0)
    assert apart(-5.1, 0, drives=0.0) and not apart(-4.9, 0, drives=0.0)
    assert not apart(6.0, 0, drives=-8.0)  # from one side of the ego to the other
    # aslant by 30 degrees: 2.5 sin 30 + 0.9 cos 30 = 2.029 m to its side
    boxes = pose(0, 2.94, pi / 6)[None], pose(0, 2.92, pi / 6)[None]
    stands = pose(0, 0), pose(0, 0), CAR
    assert [bool(kept_apart(*stands, box, box, CAR[None])[0]) for box in boxes] == [True, False]


def test_who_swings_out_from_its_chord_is_not_taken_to_be_apart() -> None:
    """It begins and ends 4.2 m beside the other, heading away from its chord, and comes 1.4 m
    nearer."""
    swings = pose(-16, 4.2, 0.8), pose(4, 4.2, 0.8)
    stands = pose(0, 0), pose(0, 0)
    assert first_contact(*stands, *swings, CAR, CAR) is not None
    assert not kept_apart(*stands, CAR, *(each[None] for each in swings), CAR[None])[0]
    turned = [each - pose(0, 0, 0.8) for each in swings]  # the same in the axes of the other
    turned = [pose(*np.dot([[np.cos(0.8), np.sin(0.8)], [-np.sin(0.8), np.cos(0.8)]], each[:2]))
              for each in turned]  # fmt: skip
    still = [pose(0, 0, -0.8)] * 2
    assert first_contact(*turned, *still, CAR, CAR) is not None
    assert not kept_apart(*turned, CAR, *(each[None] for each in still), CAR[None])[0]


def test_a_turn_makes_a_box_wider() -> None:
    """Of what keeps apart by 0.5 m, a turn on the spot by 0.2 takes 0.27 m, one by 0.5 too much."""
    for turn, parts in ((0.2, False), (0.02, True)):
        own = pose(0, 0), pose(0, 0, turn), CAR
        wide = 2.5 * sin(turn) + 0.9 * np.cos(turn)
        other = pose(0, 0.9 + wide + 0.1)[None]
        assert bool(kept_apart(*own, other, other, CAR[None])[0]) is parts


@pytest.mark.parametrize(("y", "parts"), [(2.48, False), (2.63, True)])
def test_by_how_much_the_turn_of_the_other_box_makes_it_wider(y: float, parts: bool) -> None:
    """By 0.2, half of 2.66 m times that, 0.27 m; with the half widths, 0.9 m and 1.38 m: 2.55 m."""
    other, turned = pose(0, y)[None], pose(0, y, 0.2)[None]
    assert bool(kept_apart(pose(0, 0), pose(0, 0), CAR, other, turned, CAR[None])[0]) is parts


@pytest.mark.parametrize("angle", [0.0, 1.0, -2.0])
@pytest.mark.parametrize(("y", "parts"), [(3.0, False), (3.15, True)])
def test_by_how_much_the_own_turn_does(y: float, parts: bool, angle: float) -> None:
    """Along the side of the turned box: 1.38 m twice, and 0.27 m, are 3.02 m, or 3.09 m across; and
    so in any direction."""
    other = pose(-y * sin(angle), y * np.cos(angle), angle)[None]
    own = pose(0, 0, angle), pose(0, 0, angle + 0.2)
    assert bool(kept_apart(*own, CAR, other, other, CAR[None])[0]) is parts


# --- boxes that are drawn shorter ---


def scaled(*scales: float) -> RoadMap:
    """STRAIGHT, its lanes a_1, :m_1 and b_1 drawn to these shares of their lengths."""
    scale, length = STRAIGHT.scale.copy(), STRAIGHT.length.copy()
    for name, share in zip(("a_1", ":m_1", "b_1"), scales, strict=True):
        scale[STRAIGHT.lane_ids.index(name)] = share
        length[STRAIGHT.lane_ids.index(name)] /= share
    return STRAIGHT._replace(scale=scale, length=length)


def test_a_body_is_drawn_as_long_as_at_the_moment_at_which_it_is_drawn_longer() -> None:
    """Half as long on a_1, a fifth on b_1; from the front on."""
    road = scaled(0.5, 0.5, 0.2)
    ego = ego_at(road, "b_1", 500.0)
    places = ("a_1", 100.0), ("a_1", 105.0), ("b_1", 100.0), ("b_1", 105.0), (":m_1", 19.0)
    frames = [frame_of(road, 0.0, ego, Agent("x", *at)) for at in places]
    known = np.zeros(1, np.int64)
    for before, after, share in ((0, 1, 0.5), (2, 3, 0.2), (4, 2, 0.5), (2, 4, 0.5)):
        moves = _moves(road, drawing(road), 0.5, frames[before], frames[after], known, known)
        assert moves.share == pytest.approx([share])
        assert moves.half[0] == pytest.approx([2.5 * share, 0.9])
        for found, frame in ((moves.before, frames[before]), (moves.after, frames[after])):
            front = frame.agents.x[0] + 2.5
            assert found[0] == pytest.approx([front - 2.5 * share, 0.0, 0.0])


@pytest.mark.parametrize(("s", "touch"), [(398.5, False), (399.3, True)])
def test_where_bodies_are_drawn_shorter_lanes_tell_who_touches(s: float, touch: bool) -> None:
    """On a lane that is drawn to a fifth, behind one of 400 m that is drawn to a half, one drives
    from 2 m to 4 m. Its rear is 1 m before the end of that lane then, but it is drawn as long as it
    was."""
    lanes = Lane("a", 0, ((0, 0), (200, 0)), ("b_0",)), Lane("b", 0, ((200, 0), (400, 0)))
    road = build(lanes)
    scale = np.array([0.5, 0.2])
    road = road._replace(scale=scale, length=road.length / scale)
    frames = [
        frame_of(road, k, ego_at(road, "a_0", at, 3.0), Agent("x", "b_0", 2.0 + 2.0 * k, 4.0))
        for k, at in ((0, 396.5), (1, s))
    ]
    found = contacts(road, drawing(road), 1.0, *frames, np.zeros(1, np.int32))
    assert (set(found) == {"x"}) is touch


@pytest.mark.parametrize(("ahead", "touch"), [(-0.2, True), (0.2, False)])
def test_the_front_of_an_ego_that_is_drawn_shorter_is_where_it_is(
    ahead: float, touch: bool
) -> None:
    """A person stands there; the lane is drawn to a third."""
    road = scaled(0.33, 1.0, 1.0)
    ego = ego_at(road, "a_1", 300.0, 0.1)
    front = ego.x + 2.5
    who = Agent("x", "", x=front + ahead + 0.1, y=0.0, v=0.0, length=0.2, width=0.2)
    frames = [frame_of(road, k, ego, who) for k in range(2)]
    found = contacts(road, drawing(road), 1.0, *frames, np.zeros(1, np.int32))
    assert (set(found) == {"x"}) is touch


def test_a_corner_that_touches_counts_though_lane_positions_tell_them_apart() -> None:
    """Bodies as long as they are drawn; the one ahead is turned by 0.34, so that its rear corner is
    0.16 m further back."""
    ego = ego_at(STRAIGHT, "a_1", 100.0, 0.1)
    frame = frame_of(STRAIGHT, 0.0, ego, Agent("x", "a_1", 105.05, 0.1))
    for heading, touch in ((0.34, True), (0.0, False)):
        there = frame._replace(agents=frame.agents._replace(heading=np.array([heading])))
        later = there._replace(time=1.0)
        found = contacts(STRAIGHT, drawing(STRAIGHT), 1.0, there, later, np.zeros(1, np.int32))
        assert (set(found) == {"x"}) is touch


@pytest.mark.parametrize("who", ["ego", "agent"])
def test_on_a_lane_that_is_drawn_twice_as_long_twice_the_speed_is_driven(who: str) -> None:
    """At 10 m/s 20 m within a second, through somebody who stands."""
    names = ("si_0", ":sn_0", "no_0") if who == "agent" else ("wi_0", ":we_0", "eo_0")
    those = [CROSSING.lane_ids.index(name) for name in names]
    scale, length = CROSSING.scale.copy(), CROSSING.length.copy()
    scale[those], length[those] = 2.0, length[those] / 2.0
    road = CROSSING._replace(scale=scale, length=length)

    def halved(line: Sequence[tuple[str, float, float]], front: float) -> tuple[str, float]:
        name, s = on(line, front)
        return name, s / 2.0

    frames = []
    for k, front in enumerate((-8.0, 12.0)):
        if who == "agent":
            ego = ego_at(road, ":we_0", 14.1, 0.0)
            frames.append(frame_of(road, k, ego, Agent("x", *halved(NORTH, front), 10.0)))
        else:
            ego = ego_at(road, *halved(EAST, front), 10.0)
            frames.append(frame_of(road, k, ego, Agent("x", *on(NORTH, 0.9), 0.0)))
    found = contacts(road, drawing(road), 1.0, *frames, np.zeros(1, np.int32))
    assert set(found) == {"x"} and found["x"].exact


@pytest.mark.parametrize("heading", [0.0, pi / 2, 2.2])
def test_a_box_drawn_shorter_keeps_its_front(heading: float) -> None:
    here = pose(3, -4, heading)
    shorter = as_drawn(here, 2.5, 0.4)
    ahead = np.array([np.cos(heading), np.sin(heading)])
    assert shorter[:2] + 0.4 * 2.5 * ahead == pytest.approx(here[:2] + 2.5 * ahead)
    assert shorter[2] == heading
    assert as_drawn(here, 2.5, 1.0) == pytest.approx(here)


@pytest.mark.parametrize(
    ("ego", "other", "length", "gap"),
    [
        (("a_1", 100.0), ("a_1", 110.0), 8.0, 2.0),  # to its rear
        (("a_1", 100.0), ("a_1", 90.0), 8.0, 5.0),  # behind the ego, which is 5 m long
        (("a_1", 198.0), ("b_1", 3.0), 8.0, 7.0),  # over a junction of 10 m
        (("b_1", 3.0), ("a_1", 198.0), 8.0, 10.0),
        (("a_1", 100.0), ("a_1", 157.0), 8.0, 49.0),
        (("a_0", 100.0), ("a_0", 110.0), 8.0, 2.0),  # the first lane of the map
        (("a_1", 100.0), ("a_1", 159.0), 8.0, -inf),  # too far to matter
        (("a_1", 100.0), ("a_0", 110.0), 8.0, -inf),  # beside it
        (("a_1", 100.0), ("", 0.0), 8.0, -inf),
    ],
)
def test_the_gap_along_lanes(
    ego: tuple[str, float], other: tuple[str, float], length: float, gap: float
) -> None:
    agents = agents_at(STRAIGHT, Agent("x", *other, length=length))
    own = ego_at(STRAIGHT, *ego)
    assert _gap_along(STRAIGHT, own, agents, 0) == pytest.approx(gap)
    assert _gap_along(STRAIGHT, own._replace(lane=-1), agents, 0) == -inf
