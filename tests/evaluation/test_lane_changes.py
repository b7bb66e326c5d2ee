"""What is seen before a lane change: against a slow second implementation on a straight road, and
one by one."""

from math import exp, inf

import numpy as np
import pytest
from helpers import Agent, Lane, agents_at, build, ego_at, lane, straight_road
from hypothesis import given, settings
from hypothesis import strategies as st

from sumo_mcts.evaluation.lane_changes import (
    FEATURES,
    RELAX,
    TIGHT,
    VIEW,
    features,
)
from sumo_mcts.road import LEFT as LEFT_TURN
from sumo_mcts.road import RIGHT as RIGHT_TURN
from sumo_mcts.road import RoadMap

ROAD = straight_road()
RIGHT, LEFT = 0, 1  # columns
BEGINS = {"a": 0.0, ":m": 200.0, "b": 210.0}


def seen(name: str, road: RoadMap, side: int, *those: Agent, blinker: int = 0) -> float:
    """A feature of the first of these agents, with the ego far away on c."""
    agents = agents_at(road, *those)
    agents = agents._replace(
        blinker=np.where(np.arange(len(those)) == 0, blinker, 0).astype(np.int32)
    )
    return float(
        features(road, agents, ego_at(road, road.lane_ids[-1], 90.0))[0, side, FEATURES.index(name)]
    )


# --- against a second implementation ---


@st.composite
def crowds(draw: st.DrawFn) -> list[Agent]:
    count = draw(st.integers(2, 7))
    return [
        Agent(
            f"v{k}",
            f"{draw(st.sampled_from(sorted(BEGINS)))}_{draw(st.integers(0, 1))}",
            draw(st.floats(0.0, 10.0)) if draw(st.booleans()) else draw(st.floats(0.5, 9.5)),
            draw(st.floats(0.0, 20.0)),
            length=draw(st.floats(3.0, 12.0)),
        )
        for k in range(count)
    ]


def along(agent: Agent) -> float:
    return BEGINS[agent.on[:-2]] + agent.s


def leader(those: list[Agent], i: int, number: str) -> tuple[float, float]:
    gaps = [
        (along(other) - other.length - along(those[i]), other.v)
        for j, other in enumerate(those)
        if j != i and other.on[-1] == number and 0.0 <= along(other) - along(those[i]) < VIEW
    ]
    return min(gaps, default=(inf, inf))


def follower(those: list[Agent], i: int, number: str) -> float:
    gaps = [
        along(those[i]) - those[i].length - along(other)
        for j, other in enumerate(those)
        if j != i and other.on[-1] == number and 0.0 < along(those[i]) - along(other) < VIEW
    ]
    return min(gaps, default=inf)


@settings(max_examples=60, deadline=None)
@given(crowds())
def test_who_is_ahead_and_behind_across_edges(those: list[Agent]) -> None:
    those = [
        each._replace(s=min(each.s * 20.0, 200.0)) if each.on[0] != ":" else each for each in those
    ]
    found = features(ROAD, agents_at(ROAD, *those), ego_at(ROAD, "d_0", 90.0))
    metres, seconds = RELAX
    for i, each in enumerate(those):
        if each.on[0] == ":":
            assert np.isnan(found[i]).all()  # inside a junction nobody is asked
            continue
        side = LEFT if each.on[-1] == "0" else RIGHT
        other = "1" if side == LEFT else "0"
        assert np.isnan(found[i, 1 - side]).all()  # there is no lane
        row = dict(zip(FEATURES, found[i, side], strict=True))
        span = metres + seconds * each.v
        for number, near, slow in (
            (each.on[-1], "near", "slow"),
            (other, "near_beside", "slow_beside"),
        ):
            gap, v = leader(those, i, number)
            assert row[near] == pytest.approx(exp(-max(gap, 0.0) / span))
            assert row[slow] == pytest.approx(row[near] * (1.0 - min(v / max(15.0, each.v), 1.0)))
        assert row["tight_ahead"] == pytest.approx(
            exp(-max(leader(those, i, other)[0], 0.0) / TIGHT)
        )
        assert row["tight_behind"] == pytest.approx(
            exp(-max(follower(those, i, other), 0.0) / TIGHT)
        )


# --- one by one ---


def test_a_gap_is_free_where_neither_side_has_to_brake() -> None:
    me = Agent("a", "a_0", 100.0, 10.0)
    assert seen("free", ROAD, LEFT, me) == 1.0
    assert seen("free", ROAD, LEFT, me, Agent("b", "a_1", 100.0, 10.0)) == 0.0  # beside it
    assert seen("free", ROAD, LEFT, me, Agent("b", "a_1", 82.0, 10.0)) == 1.0
    assert seen("free", ROAD, LEFT, me, Agent("b", "a_1", 82.0, 15.0)) == 0.0  # comes up fast
    assert seen("free", ROAD, LEFT, me, Agent("b", "a_1", 118.0, 10.0)) == 1.0
    assert seen("free", ROAD, LEFT, me, Agent("b", "a_1", 118.0, 2.0)) == 0.0  # too slow


def test_the_ego_counts_as_the_others_do() -> None:
    agents = agents_at(ROAD, Agent("a", "a_0", 100.0, 10.0))
    far, beside = ego_at(ROAD, "c_1", 90.0), ego_at(ROAD, "a_1", 98.0)
    free = FEATURES.index("free")
    assert features(ROAD, agents, far)[0, LEFT, free] == 1.0
    assert features(ROAD, agents, beside)[0, LEFT, free] == 0.0


def test_a_turn_signal_is_for_a_turn_only_where_the_lane_leads_to_one() -> None:
    direction = ROAD.direction.copy()
    direction[lane(ROAD, ":mr_0")] = RIGHT_TURN
    road = ROAD._replace(direction=direction, right=ROAD.left, left=ROAD.right)  # a_1 on the right
    at_end, before = Agent("a", "a_0", 190.0, 10.0), Agent("a", "a_0", 40.0, 10.0)
    assert seen("signal", road, RIGHT, at_end, blinker=-1) == 0.0
    assert seen("signal", road, RIGHT, before, blinker=-1) == 1.0
    assert seen("other_signal", road, RIGHT, before, blinker=1) == 1.0


def ending() -> RoadMap:
    """Two lanes, of which the right one ends."""
    return build(
        [
            Lane("a", 0, ((0.0, 0.0), (200.0, 0.0))),
            Lane("a", 1, ((0.0, 3.2), (200.0, 3.2)), ("b_1",)),
            Lane("b", 1, ((200.0, 3.2), (400.0, 3.2))),
        ]
    )


def test_a_lane_that_ends_is_the_more_urgent_the_nearer_its_end() -> None:
    road = ending()
    found = [seen("ends", road, LEFT, Agent("a", "a_0", s)) for s in (50.0, 150.0, 200.0)]
    assert found == sorted(found) and found[-1] == 1.0
    assert seen("ends_beside", road, RIGHT, Agent("a", "a_1", 200.0)) == 1.0
    assert seen("ends", road, RIGHT, Agent("a", "a_1", 200.0)) == 0.0


def test_a_lane_that_is_closed_to_its_class_is_none() -> None:
    classes = ROAD.classes.copy()
    classes[lane(ROAD, "a_1")] = 2
    agents = agents_at(ROAD, Agent("a", "a_0", 100.0))
    ego = ego_at(ROAD, "c_1", 90.0)
    assert np.isnan(features(ROAD._replace(classes=classes), agents, ego)).all()


@pytest.mark.parametrize(("trend", "seen_as"), [(-1.0, 0.5), (-0.2, 0.1), (-3.0, 1.0), (2.0, 0.0)])
def test_who_brakes_with_two_metres_per_second_squared_brakes(trend: float, seen_as: float) -> None:
    agents = agents_at(ROAD, Agent("a", "a_0", 100.0))._replace(trend=np.array([trend]))
    found = features(ROAD, agents, ego_at(ROAD, "c_1", 90.0))
    assert found[0, LEFT, FEATURES.index("brakes")] == pytest.approx(seen_as)


@pytest.mark.parametrize(
    ("v", "limit", "slow"),
    [(15.0, 15.0, 0.0), (6.0, 15.0, 0.6), (0.0, 15.0, 1.0), (20.0, 15.0, 0.0), (0.25, 0.5, 0.75)],
)
def test_slow_is_who_is_below_the_limit_or_a_metre_a_second(
    v: float, limit: float, slow: float
) -> None:
    road = ROAD._replace(speed=np.full(len(ROAD.speed), limit))
    assert seen("slowness", road, LEFT, Agent("a", "a_0", 100.0, v)) == pytest.approx(slow)


def test_each_agent_has_its_own_speed_place_and_signal() -> None:
    agents = agents_at(
        ROAD,
        Agent("a", "a_0", 100.0, 15.0),
        Agent("b", "a_1", 150.0, 3.0),
        Agent("c", "b_0", 50.0, 9.0),
    )._replace(blinker=np.array([0, -1, 1], np.int32))
    found = features(ROAD, agents, ego_at(ROAD, "c_1", 90.0, 7.0))
    slowness, signal = FEATURES.index("slowness"), FEATURES.index("signal")
    for k, side, slow, signals in ((0, LEFT, 0.0, 0.0), (1, RIGHT, 0.8, 1.0), (2, LEFT, 0.4, 1.0)):
        assert found[k, side, slowness] == pytest.approx(slow)
        assert found[k, side, signal] == signals
        assert np.isnan(found[k, 1 - side]).all()


def forked(*after: int) -> RoadMap:
    """Lanes a_0 and a_1 of 200 m, the first of which leads to b_0, the second to c_0, as asked."""
    leads = [(f"{'bc'[k]}_0",) if k in after else () for k in range(2)]
    return build([
        Lane("z", 0, ((0.0, 50.0), (9.0, 50.0)), ("b_0",)),  # the first lane of the map is another
        *(Lane("a", k, ((0.0, 3.2 * k), (200.0, 3.2 * k)), leads[k]) for k in range(2)),
        Lane("b", 0, ((200.0, 0.0), (300.0, 0.0))), Lane("c", 0, ((200.0, 3.2), (300.0, 9.0))),
    ])  # fmt: skip


@pytest.mark.parametrize(
    ("after", "right", "left"),
    [
        ((0, 1), "parts", "parts"),
        ((1,), "ends", "ends_beside"),  # as seen from the right lane, and from the left one
        ((0,), "ends_beside", "ends"),
        ((), "", ""),
    ],
)
def test_where_two_lanes_lead(after: tuple[int, ...], right: str, left: str) -> None:
    """100 m before their end: exp(-1); at the end 1. On one that goes on with the other, nothing."""
    road = forked(*after)
    for s, urgent in ((100.0, exp(-1.0)), (150.0, exp(-0.5)), (200.0, 1.0)):
        for name, side, word in (("a_0", LEFT, right), ("a_1", RIGHT, left)):
            for feature in ("ends", "ends_beside", "parts"):
                found = seen(feature, road, side, Agent("x", name, s))
                assert found == pytest.approx(urgent if feature == word else 0.0)
    assert seen("parts", ROAD, LEFT, Agent("x", "a_0", 150.0)) == 0.0


def test_the_lane_beside_may_lead_to_the_first_lane_of_the_map() -> None:
    road = build([
        Lane("b", 0, ((200.0, 3.2), (300.0, 3.2))),
        Lane("a", 0, ((0.0, 0.0), (200.0, 0.0))), Lane("a", 1, ((0.0, 3.2), (200.0, 3.2)), ("b_0",)),
    ])  # fmt: skip
    assert seen("ends", road, LEFT, Agent("x", "a_0", 200.0)) == 1.0
    assert seen("ends_beside", road, RIGHT, Agent("x", "a_1", 200.0)) == 1.0


@pytest.mark.parametrize(("left", "turns"), [(100.0, True), (110.0, False)])
@pytest.mark.parametrize("side", [RIGHT, LEFT])
def test_a_turn_is_signalled_seven_seconds_before(left: float, turns: bool, side: int) -> None:
    """At the limit of 15 m/s, 105 m. A lane from which one of two ways turns to that side."""
    direction = ROAD.direction.copy()
    direction[lane(ROAD, ":mr_0")] = RIGHT_TURN if side == RIGHT else LEFT_TURN
    other = {RIGHT: ROAD.left, LEFT: ROAD.right}[side]
    beside = {RIGHT: {"right": other}, LEFT: {}}[side]
    road = ROAD._replace(direction=direction, **beside)
    blinks = -1 if side == RIGHT else 1
    at = Agent("a", "a_0", 200.0 - left, 10.0)
    assert seen("signal", road, side, at, blinker=blinks) == (0.0 if turns else 1.0)
    straight = Agent("a", "b_0", 200.0 - left, 10.0)  # this lane leads straight on alone
    assert seen("signal", road, side, straight, blinker=blinks) == 1.0


def test_products_are_products() -> None:
    """It signals, drives 6 of 15 m/s behind one that stands, and where its lane ends."""
    road = forked(1)
    me, ahead = Agent("a", "a_0", 150.0, 6.0), Agent("b", "a_0", 175.0, 0.0)
    beside = Agent("c", "a_1", 150.0, 6.0)
    near = exp(-20.0 / (10.0 + 2.0 * 6.0))
    for those, free in (((me, ahead), 1.0), ((me, ahead, beside), 0.0)):
        found = {name: seen(name, road, LEFT, *those, blinker=1) for name in FEATURES}
        assert (found["always"], found["signal"], found["free"]) == (1.0, 1.0, free)
        assert found["near"] == found["slow"] == pytest.approx(near)
        assert found["signal_free"] == free and found["slow_free"] == pytest.approx(near * free)
        assert found["signal_slowness"] == pytest.approx(0.6)
        assert found["ends_slowness"] == pytest.approx(0.6 * exp(-0.5))
    silent = {name: seen(name, road, LEFT, me, beside) for name in FEATURES}
    assert not any(silent[name] for name in ("signal_free", "signal_slowness", "slow_free"))


@pytest.mark.parametrize(("gap", "free"), [(11.9, 0.0), (12.1, 1.0)])
def test_a_free_gap_is_a_second_and_two_metres(gap: float, free: float) -> None:
    """At 10 m/s behind one as fast, ahead and behind, for cars of 5 m."""
    me = Agent("a", "a_0", 100.0, 10.0)
    assert seen("free", ROAD, LEFT, me, Agent("b", "a_1", 105.0 + gap, 10.0)) == free
    assert seen("free", ROAD, LEFT, me, Agent("b", "a_1", 95.0 - gap, 10.0)) == free


def test_near_is_10_metres_and_two_seconds_tight_10_metres() -> None:
    me, far = Agent("a", "a_0", 100.0, 10.0), Agent("b", "a_0", 135.0, 10.0)
    assert seen("near", ROAD, LEFT, me, far) == pytest.approx(exp(-1.0))
    beside, behind = Agent("b", "a_1", 115.0, 10.0), Agent("b", "a_1", 75.0, 10.0)
    assert seen("tight_ahead", ROAD, LEFT, me, beside) == pytest.approx(exp(-1.0))
    assert seen("tight_behind", ROAD, LEFT, me, behind) == pytest.approx(exp(-2.0))
    overlapping = Agent("b", "a_1", 103.0, 10.0)
    assert seen("tight_ahead", ROAD, LEFT, me, overlapping) == 1.0
    assert seen("near_beside", ROAD, LEFT, me, overlapping) == 1.0


def test_four_lanes_of_a_way_are_looked_at_and_a_hundred_metres() -> None:
    """Lanes of 10 m or of 60 m, one behind the other."""
    names = "abcdefghijkl"

    def chain(length: float) -> RoadMap:
        return build([
            Lane(name, k, ((n * length, 3.2 * k), ((n + 1) * length, 3.2 * k)),
                 (f"{names[n + 1]}_{k}",) if n < 11 else ())
            for n, name in enumerate(names) for k in range(2)
        ])  # fmt: skip

    short, long = chain(10.0), chain(60.0)

    def noticed(road: RoadMap, me: str, other: str, s: float = 5.0) -> tuple[bool, ...]:
        those = Agent("a", f"{me}_0", 5.0, 10.0), Agent("b", f"{other}_1", s, 10.0)
        return tuple(
            seen(f"tight_{side}", road, LEFT, *those) > 0.0 for side in ("ahead", "behind")
        )

    assert noticed(short, "d", "g") == (True, False) and noticed(short, "d", "h") == (False, False)
    assert noticed(short, "g", "d") == (False, True) and noticed(short, "h", "d") == (False, False)
    assert noticed(long, "d", "e", 44.0) == (True, False)  # 99 m
    assert noticed(long, "d", "f") == (False, False) == noticed(long, "f", "d")
    assert noticed(short, "k", "l") == (True, False)  # where the road ends
