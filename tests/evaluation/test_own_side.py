"""Overtaking on the lane of the oncoming traffic, and bodies that are drawn shorter than they are."""

import pytest
from helpers import Agent, Lane, build, edges, ego_at, frame_of
from helpers_referee import STRAIGHT, referee

from sumo_mcts.road import RoadMap
from sumo_mcts.scene import EgoState, Frame

STEP = 0.5
ROAD = build(
    [
        Lane("there", 0, ((0.0, 0.0), (200.0, 0.0)), ("on_0",)),
        Lane("back", 0, ((200.0, 3.2), (0.0, 3.2))),
        Lane("on", 0, ((200.0, 0.0), (300.0, 0.0))),
    ]
)


def overtaking(x: float) -> EgoState:
    """The ego on the oncoming lane, its front at x."""
    ego = ego_at(ROAD, "back_0", 200.0 - x, route=edges(ROAD, "there"))
    return ego._replace(x=x - 2.5, heading=0.0)


def states() -> list[EgoState]:
    """It leaves its lane at 20 m, and comes back at 45 m."""
    own = [ego_at(ROAD, "there_0", s, route=edges(ROAD, "there")) for s in (15.0, 20.0, 45.0, 50.0)]
    return [*own[:2], *map(overtaking, (25.0, 30.0, 35.0, 40.0)), *own[2:]]


def judged(route: tuple[str, ...], *agents: Agent) -> tuple[list[str | None], dict[str, object]]:
    first, *later = (frame_of(ROAD, k * STEP, ego, *agents) for k, ego in enumerate(states()))
    judge = referee(ROAD, first, *route, step=STEP)
    return [judge.observe(frame) for frame in later], judge.row()


@pytest.mark.parametrize("route", [("there",), ("there", "on")])
def test_who_overtakes_has_neither_arrived_nor_left_its_route(route: tuple[str, ...]) -> None:
    outcomes, row = judged(route)
    assert set(outcomes) == {None}
    assert row["distance_m"] == pytest.approx(35.0)
    assert row["speeding_share"] == 0.0


@pytest.mark.parametrize("lane", ["back_0", "there_0"])
def test_it_can_meet_those_of_both_sides(lane: str) -> None:
    s = 200.0 - 33.0 if lane == "back_0" else 33.0
    outcomes, _ = judged(("there",), Agent("met", lane, s, 0.0, d=0.0 if lane == "back_0" else 1.8))
    assert "collision" in outcomes


# --- lanes longer than they are drawn ---


def squeezed(scale: float) -> RoadMap:
    return STRAIGHT._replace(scale=STRAIGHT.scale * scale, length=STRAIGHT.length / scale)


def behind(road: RoadMap, gap: float) -> list[Frame]:
    """The ego drives up to `gap` metres behind a vehicle, as lane positions say."""
    agent = Agent("ahead", "b_1", 100.0, 0.0)
    return [
        frame_of(road, k * STEP, ego_at(road, "b_1", 95.0 - gap - away, 1.0), agent)
        for k, away in enumerate((2.0, 1.0, 0.0))
    ]


@pytest.mark.parametrize(("gap", "outcome"), [(1.0, None), (0.1, None), (-0.3, "collision")])
@pytest.mark.parametrize("scale", [1.0, 0.4, 0.15])
def test_on_one_lane_positions_tell_who_touches(
    scale: float, gap: float, outcome: str | None
) -> None:
    road = squeezed(scale)
    first, *later = behind(road, gap)
    judge = referee(road, first, "a", "b", "c", step=STEP)
    assert [judge.observe(frame) for frame in later][-1] == outcome
    assert judge.row()["at_fault"] is (True if outcome else None)
