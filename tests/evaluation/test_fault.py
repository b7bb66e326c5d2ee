"""The referee on small hand-made roads: contacts, and each reason for blame."""

from math import pi
from typing import Any

import numpy as np
from helpers import (
    Agent,
    Lane,
    build,
    edges,
    ego_at,
    frame_of,
    lights,
)
from helpers_referee import CROSSING, ROUTE, SIGNALLED, STEP, STRAIGHT, referee

from sumo_mcts.evaluation.contact import (
    boxes_overlap,
)
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import GREEN, RED
from sumo_mcts.world.oncoming import with_oncoming


def crash(
    road: RoadMap,
    before: tuple[Any, ...],
    after: tuple[Any, ...],
    route: tuple[str, ...],
    step: float = STEP,
) -> tuple[str | None, bool | None]:
    """Outcome and blame after one step; before and after: the ego, then the agents."""
    judge = referee(road, frame_of(road, 10.0, *before), *route, step=step)
    outcome = judge.observe(frame_of(road, 10.0 + step, *after))
    assert judge.row()["collisions"] == (outcome == "collision")
    return outcome, judge.row()["at_fault"]


def test_front_into_a_standing_car_and_into_a_slow_one() -> None:
    def ego(s: float) -> Any:
        return ego_at(STRAIGHT, "a_1", s)

    for v in (0.0, 3.0):
        found = crash(
            STRAIGHT,
            (ego(20.0), Agent("x", "a_1", 29.0, v)),
            (ego(25.0), Agent("x", "a_1", 29.0 + v / 2, v)),
            ROUTE,
        )
        assert found == (("collision", True) if v == 0 else (None, None))
    assert crash(
        STRAIGHT,
        (ego(20.0), Agent("x", "a_1", 27.0, 3.0)),
        (ego(25.0), Agent("x", "a_1", 28.5, 3.0)),
        ROUTE,
    ) == ("collision", True)


def test_hit_from_behind_is_not_the_egos_fault() -> None:
    def step(ego_v: float, **change: Any) -> tuple[str | None, bool | None]:
        before, after = (
            ego_at(STRAIGHT, "a_1", 50.0, ego_v),
            ego_at(STRAIGHT, "a_1", 50.0 + ego_v / 2, ego_v)._replace(**change),
        )
        return crash(
            STRAIGHT,
            (before, Agent("x", "a_1", 43.0, 12.0)),
            (after, Agent("x", "a_1", 49.0, 12.0)),
            ROUTE,
        )

    assert step(2.0) == ("collision", False)
    assert step(0.0) == ("collision", False)
    assert step(2.0, changing=0.2, change_from=2, change_to=2) == (
        "collision",
        True,
    )  # its lane change has just begun


def test_a_lane_change_counts_for_three_seconds() -> None:
    for wait, fault in ((2.5, True), (3.0, False)):
        ways = [
            ego_at(STRAIGHT, "a_1", 60.0 + 5 * k, 10.0, d=0.3)._replace(
                changing=min(0.1 + k / 6, 0.99)
            )
            for k in range(int(wait / STEP) + 1)
        ]
        judge = referee(STRAIGHT, frame_of(STRAIGHT, 0.0, ego_at(STRAIGHT, "a_1", 55.0)), *ROUTE)
        for k, ego in enumerate(ways[:-1]):
            assert (
                judge.observe(
                    frame_of(STRAIGHT, STEP * (k + 1), ego, Agent("x", "a_1", ego.s - 8.0, 18.0))
                )
                is None
            )
        hit = ways[-1]
        assert (
            judge.observe(
                frame_of(STRAIGHT, STEP * len(ways), hit, Agent("x", "a_1", hit.s - 4.0, 18.0))
            )
            == "collision"
        )
        assert judge.row()["at_fault"] is fault


def test_a_lane_change_at_once_is_judged_by_where_it_ends() -> None:
    # the car on the left drives where the way of the jump would lead through it
    before, after = ego_at(STRAIGHT, "a_0", 50.0, 20.0), ego_at(STRAIGHT, "a_1", 60.0, 20.0)
    agents = Agent("x", "a_1", 55.0, 0.1), Agent("x", "a_1", 54.9, 0.1)
    judge = referee(STRAIGHT, frame_of(STRAIGHT, 0.0, before, agents[0]), *ROUTE)
    assert judge.observe(frame_of(STRAIGHT, 0.5, after, agents[1])) is None
    assert judge.row()["lane_changes"] == 1
    assert (
        judge.observe(frame_of(STRAIGHT, 1.0, after._replace(v=0.0), Agent("x", "a_1", 57.0, 20.0)))
        == "collision"
    )
    assert judge.row()["at_fault"] is True  # it cut in


def test_an_agent_that_was_not_there_before_is_not_swept() -> None:
    ego = [ego_at(STRAIGHT, "a_1", s, 20.0) for s in (50.0, 60.0)]
    assert crash(STRAIGHT, (ego[0],), (ego[1], Agent("new", "a_1", 54.0, 1.0)), ROUTE) == (
        None,
        None,
    )
    assert (
        crash(STRAIGHT, (ego[0],), (ego[1], Agent("new", "a_1", 58.0, 1.0)), ROUTE)[0]
        == "collision"
    )


def test_sweep_finds_a_crossing_between_two_states() -> None:
    # the ego's box is before and behind the other's way when the step begins and ends, and so is
    # the other's
    before = ego_at(CROSSING, ":sn_0", 4.0, 20.0), Agent("x", ":we_0", 8.0, 20.0)
    after = ego_at(CROSSING, "no_0", 4.0, 40.0), Agent("x", "eo_0", 8.0, 40.0)
    assert crash(CROSSING, before, after, ("si", "no"), step=0.5) == ("collision", True)
    late = Agent("x", "wi_0", 80.0, 16.0), Agent("x", "wi_0", 88.0, 16.0)
    assert crash(CROSSING, (before[0], late[0]), (after[0], late[1]), ("si", "no"), step=0.5) == (
        None,
        None,
    )


def test_hit_from_the_side() -> None:
    def step(
        ego_road: str, other_road: str, other_s: float, ego_goal: tuple[str, ...]
    ) -> tuple[str | None, bool | None]:
        """The other's front into the middle of the ego's side."""
        before = ego_at(CROSSING, ego_road, 11.0, 4.0), Agent("x", other_road, 1.0, 12.0)
        return crash(
            CROSSING,
            before,
            (ego_at(CROSSING, ego_road, 13.0, 4.0), Agent("x", other_road, other_s, 15.0)),
            ego_goal,
        )

    assert step(":we_0", ":sn_0", 8.5, ("wi", "eo")) == ("collision", False)
    assert step(":sn_0", ":we_0", 11.5, ("si", "no")) == (
        "collision",
        True,
    )  # has to let the other pass


def test_a_red_light_run_outweighs_priority() -> None:
    def step(signals: tuple[int, ...]) -> bool | None:
        shown = lights(*signals)
        route = edges(SIGNALLED, "wi", "eo")
        ways = [
            ego_at(SIGNALLED, name, s, 16.0, route=route)
            for name, s in (("wi_0", 30.0), ("wi_0", 88.0), (":we_0", 6.0), (":we_0", 13.0))
        ]
        other = [Agent("x", ":sn_0", s, 14.0) for s in (0.1, 0.1, 1.0, 8.0)]
        judge = referee(SIGNALLED, frame_of(SIGNALLED, 0.0, ways[0], signals=shown), "wi", "eo")
        for k in (1, 2):
            assert (
                judge.observe(frame_of(SIGNALLED, STEP * k, ways[k], other[k], signals=shown))
                is None
            )
        assert (
            judge.observe(frame_of(SIGNALLED, 1.5, ways[3], other[3], signals=shown)) == "collision"
        )
        return judge.row()["at_fault"]  # type: ignore[no-any-return]

    assert step((GREEN, RED, RED)) is False
    assert step((RED, GREEN, RED)) is True


def test_nobody_owes_way_to_a_red_runner() -> None:
    def step(shown: tuple[int, ...]) -> bool | None:
        route, colours = edges(SIGNALLED, "si", "no"), lights(*shown)
        ways = [ego_at(SIGNALLED, ":sn_0", s, 4.0, route=route) for s in (7.0, 9.0, 11.0)]
        other = (
            Agent("x", "wi_0", 88.0, 12.0),
            Agent("x", ":we_0", 1.0, 14.0),
            Agent("x", ":we_0", 11.5, 19.0),
        )
        judge = referee(
            SIGNALLED, frame_of(SIGNALLED, 0.0, ways[0], other[0], signals=colours), "si", "no"
        )
        judge.observe(frame_of(SIGNALLED, 0.5, ways[1], other[1], signals=colours))
        assert (
            judge.observe(frame_of(SIGNALLED, 1.0, ways[2], other[2], signals=colours))
            == "collision"
        )
        return judge.row()["at_fault"]  # type: ignore[no-any-return]

    assert step((RED, GREEN, RED)) is False
    assert step((GREEN, GREEN, RED)) is True


def test_a_red_runner_that_comes_back_on_green_is_owed_its_way() -> None:
    colours = [lights(RED, GREEN, RED)] * 3 + [lights(GREEN, GREEN, RED)] * 3
    route = edges(SIGNALLED, "si", "no")
    ways = [
        ego_at(SIGNALLED, lane, s, 4.0, route=route)
        for lane, s in (
            *(("si_0", 50.0 + 2 * k) for k in range(3)),
            *((":sn_0", 7.0 + 2 * k) for k in range(3)),
        )
    ]
    there = [
        ("wi_0", 88.0, 12.0),
        (":we_0", 1.0, 14.0),
        ("eo_0", 10.0, 14.0),
        ("wi_0", 88.0, 12.0),
        (":we_0", 1.0, 14.0),
        (":we_0", 11.5, 19.0),
    ]
    frames = [
        frame_of(SIGNALLED, STEP * k, ways[k], Agent("x", *there[k]), signals=colours[k])
        for k in range(6)
    ]
    judge = referee(SIGNALLED, frames[0], "si", "no")
    assert [judge.observe(frame) for frame in frames[1:]] == [None] * 4 + ["collision"]
    assert judge.row()["at_fault"] is True


def test_an_ego_that_comes_back_on_green_has_not_entered_on_red() -> None:
    def blame(first: int) -> bool | None:
        route = edges(SIGNALLED, "wi", "eo")
        ways = [
            ("wi_0", 84.0),
            (":we_0", 2.0),
            ("wi_0", 76.0),
            ("wi_0", 81.0),
            ("wi_0", 86.0),
            (":we_0", 1.0),
            (":we_0", 6.0),
        ]
        judge = None
        for k, (where, s) in enumerate(ways):
            behind = [Agent("x", "wi_0", 85.0 if k == 5 else 91.6, 13.0)] if k >= 5 else []
            colour = first if k < 2 else GREEN
            frame = frame_of(
                SIGNALLED,
                STEP * k,
                ego_at(SIGNALLED, where, s, 10.0, route=route),
                *behind,
                signals=lights(colour, RED, RED),
            )
            judge = judge or referee(SIGNALLED, frame, "wi", "eo")
            outcome = judge.observe(frame) if k else None
        assert judge is not None and outcome == "collision"
        return judge.row()["at_fault"]  # type: ignore[no-any-return]

    assert blame(GREEN) is False
    assert blame(RED) is False


def test_standing_on_a_junction() -> None:
    def step(*leaders: Agent) -> tuple[str | None, bool | None]:
        ego = ego_at(CROSSING, ":we_0", 18.0, 0.0)
        judge = referee(
            CROSSING,
            frame_of(CROSSING, 0.0, ego, Agent("x", ":we_0", 9.0, 14.0), *leaders),
            "wi",
            "eo",
        )
        return judge.observe(
            frame_of(CROSSING, 0.5, ego, Agent("x", ":we_0", 16.0, 14.0), *leaders)
        ), judge.row()["at_fault"]

    assert step() == ("collision", True)
    assert step(Agent("queue", "eo_0", 6.0, 0.0)) == ("collision", False)
    assert step(Agent("queue", "eo_0", 30.0, 0.0)) == (
        "collision",
        True,
    )  # too far to be the reason
    assert step(Agent("queue", "eo_0", 6.0, 8.0)) == ("collision", True)  # drives off


def test_sideswipe() -> None:
    ego = [ego_at(STRAIGHT, "a_1", s) for s in (50.0, 55.0)]
    # it comes over, its side against the ego's
    drift = Agent("x", "a_0", 49.0, 10.0, d=1.3), Agent("x", "a_0", 54.0, 10.0, d=1.6)
    assert crash(STRAIGHT, (ego[0], drift[0]), (ego[1], drift[1]), ROUTE) == ("collision", False)
    # nobody can tell why
    ways = ego_at(STRAIGHT, "a_1", 50.0, d=-1.2), ego_at(STRAIGHT, "a_1", 55.0, d=-1.6)
    beside = Agent("x", "a_0", 49.0, 10.0), Agent("x", "a_0", 54.0, 10.0)
    assert crash(STRAIGHT, (ways[0], beside[0]), (ways[1], beside[1]), ROUTE) == ("collision", True)


def test_who_changes_lanes_standing_does_not_stand() -> None:
    """SUMO moves it to the side at no speed, into an ego that stands; an ego that moves aside
    itself comes to one that stands."""
    stands = ego_at(STRAIGHT, "a_1", 50.0, 0.0)
    beside = [Agent("x", "a_0", 47.0, 0.0, d=d) for d in (1.2, 1.6)]
    assert crash(STRAIGHT, (stands, beside[0]), (stands, beside[1]), ROUTE) == ("collision", False)
    aside = ego_at(STRAIGHT, "a_1", 50.0, 0.0, d=-0.4)
    assert crash(STRAIGHT, (stands, beside[0]), (aside, beside[0]), ROUTE) == ("collision", True)


def test_pedestrians_count() -> None:
    ego = [ego_at(STRAIGHT, "a_1", s) for s in (50.0, 55.0)]
    ahead = Agent("p", "", v=1.0, x=53.0, y=0.2, width=0.5, length=0.3)
    assert crash(STRAIGHT, (ego[0], ahead), (ego[1], ahead), ROUTE) == ("collision", True)
    into_the_side = ahead._replace(x=51.0, y=-1.5), ahead._replace(x=51.0, y=-1.0)
    assert crash(STRAIGHT, (ego[0], into_the_side[0]), (ego[1], into_the_side[1]), ROUTE) == (
        "collision",
        False,
    )


def test_a_bridge_is_no_contact() -> None:
    ego = [ego_at(CROSSING, "eo_0", s) for s in (35.0, 41.0)]
    above = Agent("x", "br_0", 95.0, 10.0), Agent("x", "br_0", 100.0, 10.0)
    assert boxes_overlap(
        np.array([48.5, -1.6, 0.0, 2.5, 0.9]), np.array([50.0, -2.5, pi / 2, 2.5, 0.9])
    )
    assert crash(CROSSING, (ego[0], above[0]), (ego[1], above[1]), ("wi", "eo")) == (None, None)


def test_what_sumo_reports_counts_and_unclear_is_at_fault() -> None:
    def step(*agents: Agent) -> tuple[str | None, Any, Any]:
        ego = ego_at(STRAIGHT, "a_1", 50.0)
        judge = referee(STRAIGHT, frame_of(STRAIGHT, 0.0, ego, *agents), *ROUTE)
        found = judge.observe(frame_of(STRAIGHT, 0.5, ego, *agents)._replace(collisions=("x",)))
        return found, judge.row()["collisions"], judge.row()["at_fault"]

    assert step() == ("collision", 1, True)
    assert step(Agent("x", "a_0", 50.0)) == ("collision", 1, True)
    assert step(Agent("x", "a_1", 44.9)) == ("collision", 1, False)
    assert step(Agent("x", "a_1", 46.0)) == ("collision", 1, False)  # the same pair is counted once
    assert step(Agent("x", "a_1", 46.0), Agent("y", "a_1", 53.0)) == ("collision", 2, True)


def test_who_overtakes_into_the_other_is_to_blame() -> None:
    """The fronts of both are where they meet."""
    lanes = [Lane("a", 0, ((0, 0), (400, 0))), Lane("b", 0, ((400, 3.2), (0, 3.2)))]
    road = with_oncoming(build(lanes), {0: 1, 1: 0})
    for mine, other, s, fault in (
        ("a_1", "b_0", 296.0, True),
        ("a_0", "b_1", 296.0, False),
        ("a_1", "a_1", 109.0, True),
    ):
        before, after = (
            (ego_at(road, mine, 105.0 - x, 10.0), Agent("x", other, s - 0.4 * x, 4.0))
            for x in (5.0, 0.0)
        )
        assert crash(road, before, after, ("a",)) == ("collision", fault)
