"""Which lane changes bring a vehicle onto the next edge of its route, against a search over all
ways from lane to lane."""

from typing import NamedTuple

import pytest
from helpers import ALL_CLASSES, Lane, build, edges
from helpers import edge as edge_of
from helpers import lane as lane_of
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts.model.continuation import (
    changes_onward,
    collect,
    continuation,
    lanes_beside,
    leads_onto,
    missed_leg,
)
from sumo_mcts.road import RoadMap

CAR = 0
CLOSED = ALL_CLASSES & ~1  # for cars


class Made(NamedTuple):
    """One lane of edge a."""

    onto: str  # the edge to which it leads, "" none
    closed: bool  # the lane itself
    closed_inside: bool  # its path through the junction
    left: bool  # changes to the left are allowed
    right: bool


lanes_of_a = st.lists(
    st.builds(
        Made,
        onto=st.sampled_from(["", "b", "c"]),
        closed=st.sampled_from([False, False, False, True]),
        closed_inside=st.sampled_from([False, False, False, True]),
        left=st.booleans(),
        right=st.booleans(),
    ),
    min_size=1,
    max_size=5,
)


def road_of(made: list[Made]) -> RoadMap:
    """Edge a, whose lanes lead over a junction to lane 0 of b or c."""
    lanes = []
    for k, lane in enumerate(made):
        y, inside = 3.0 * k, f":m{k}_0"
        lanes.append(
            Lane(
                "a",
                k,
                ((0.0, y), (100.0, y)),
                (inside,) if lane.onto else (),
                classes=CLOSED if lane.closed else ALL_CLASSES,
                change_left=ALL_CLASSES if lane.left else CLOSED,
                change_right=ALL_CLASSES if lane.right else CLOSED,
            )
        )
        if lane.onto:
            lanes.append(
                Lane(
                    f":m{k}",
                    0,
                    ((100.0, y), (110.0, y)),
                    (f"{lane.onto}_0",),
                    junction="m",
                    classes=CLOSED if lane.closed_inside else ALL_CLASSES,
                )
            )
    lanes += [Lane(name, 0, ((110.0, 0.0), (200.0, 0.0))) for name in ("b", "c")]
    return build(lanes)


def least_changes(made: list[Made], start: int) -> set[int]:
    """The changes, with their sign, to each of the nearest lanes that lead onto b: by walking from
    lane to lane."""
    if made[start].closed:
        return set()
    for distance in range(len(made)):
        found = set()
        for side in (1, -1):
            here, there = start, True
            for _ in range(distance):
                allowed = made[here].left if side > 0 else made[here].right
                here += side
                there = there and allowed and 0 <= here < len(made) and not made[here].closed
                if not there:
                    break
            if there and made[here].onto == "b" and not made[here].closed_inside:
                found.add(side * distance)
        if found:
            return found
    return set()


@given(lanes_of_a, st.data())
def test_changes_lead_to_the_nearest_lane_that_goes_on(
    made: list[Made], data: st.DataObject
) -> None:
    start = data.draw(st.integers(0, len(made) - 1))
    road = road_of(made)
    found = changes_onward(road, edges(road, "a", "b"), CAR, lane_of(road, f"a_{start}"))
    expected = least_changes(made, start)
    assert (found is None and not expected) or found in expected


@given(lanes_of_a)
def test_a_lane_leads_onto_what_is_open(made: list[Made]) -> None:
    road = road_of(made)
    for k, lane in enumerate(made):
        onto = leads_onto(road, lane_of(road, f"a_{k}"), CAR)
        open_ = lane.onto and not lane.closed_inside
        assert onto == ({edge_of(road, lane.onto): [lane_of(road, f":m{k}_0")]} if open_ else {})


@pytest.mark.parametrize("onto", ["", "c"])
def test_on_the_last_edge_every_lane_will_do(onto: str) -> None:
    road = road_of([Made(onto, False, False, True, True)])
    assert changes_onward(road, edges(road, "a"), CAR, lane_of(road, "a_0")) == 0


def two_in_a_row(*, changes_on_a: bool) -> RoadMap:
    """Edges a and b of two lanes each; only the left one of b leads to c, the right one to d. Lane
    changes are banned on b, and perhaps on a."""
    after = {"a_0": "b_0", "a_1": "b_1", "b_0": "d_0", "b_1": "c_0"}
    begins = {"a": 0.0, "b": 100.0, "c": 200.0, "d": 200.0}
    lanes = [
        Lane(edge, k, ((x, 3.0 * k), (x + 100.0, 3.0 * k)),
             (after[f"{edge}_{k}"],) if f"{edge}_{k}" in after else (),
             change_left=ALL_CLASSES if edge == "a" and changes_on_a else 0)
        for edge, x in begins.items()
        for k in range(2 if edge in "ab" else 1)
    ]  # fmt: skip
    return build(lanes)


def test_a_lane_that_leads_to_where_no_change_is_allowed_does_not_lead_on() -> None:
    """SUMO halts its vehicles at the end of such a lane, within a step."""
    for changes_on_a, needed in ((True, 1), (False, None)):
        road = two_in_a_row(changes_on_a=changes_on_a)
        route, lane = edges(road, "a", "b", "c"), lane_of(road, "a_0")
        assert changes_onward(road, route, CAR, lane) == needed
        assert changes_onward(road, route, CAR, lane_of(road, "a_1")) == 0
        leg, there = missed_leg(road, route, CAR, lane)
        assert (leg, there) == (1, [lane_of(road, "b_0")])
        nodes = collect(road, route, CAR)
        found = continuation(road, nodes, lanes_beside(road, nodes, CAR), len(route))
        assert (found.next[nodes.number[0, lane]], found.reach[nodes.number[0, lane]]) == (-1, 100)
        assert found.next[nodes.number[0, lane_of(road, "a_1")]] >= 0
