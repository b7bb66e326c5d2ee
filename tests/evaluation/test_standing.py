"""How long the ego stood, how long at green, and what it lost: hand-made frames, counted plainly."""

from itertools import groupby
from typing import Any

import numpy as np
import pytest
from helpers import Agent, crossing, edges, ego_at, frame_of, lane, lights
from helpers_referee import ROUTE, SIGNALLED, STEP, STRAIGHT, referee
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts.evaluation.goal import Goal
from sumo_mcts.evaluation.metrics import free_flow_time
from sumo_mcts.evaluation.referee import Referee
from sumo_mcts.evaluation.standing import AT_LINE, longest_run, stands_at_green
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import GREEN, RED, YELLOW, Frame

LENGTH = float(SIGNALLED.length[lane(SIGNALLED, "wi_0")])


@given(st.lists(st.booleans(), max_size=30))
def test_the_longest_run_is_that_of_plain_counting(happened: list[bool]) -> None:
    runs = [len(list(run)) for each, run in groupby(happened) if each]
    assert longest_run(np.array(happened, np.bool_)) == max(runs, default=0)


def waiting(
    s: float = LENGTH - 1.0,
    *agents: Agent,
    on: str = "wi_0",
    v: float = 0.0,
    shown: tuple[int, int, int] = (GREEN, RED, RED),
    onto: str = "eo",
    time: float = 0.0,
) -> Frame:
    """An ego before the light of the crossing, on its way straight on or to the left."""
    start = SIGNALLED.edge_ids[int(SIGNALLED.edge[lane(SIGNALLED, on)])]
    ego = ego_at(SIGNALLED, on, s, v, route=edges(SIGNALLED, start, *([onto] if onto else [])))
    return frame_of(SIGNALLED, time, ego, *agents, signals=lights(*shown))


def test_the_light_is_that_of_the_own_connection() -> None:
    """The links: 0 straight on, 1 the other road, 2 to the left."""
    for shown, straight, left in (
        ((GREEN, RED, RED), True, False),
        ((RED, GREEN, GREEN), False, True),
        ((YELLOW, GREEN, YELLOW), False, False),
    ):
        assert stands_at_green(SIGNALLED, waiting(shown=shown)) is straight
        assert stands_at_green(SIGNALLED, waiting(shown=shown, onto="no")) is left


def test_in_a_lane_that_leads_elsewhere_all_its_lights_count() -> None:
    for onto in ("si", ""):
        assert stands_at_green(SIGNALLED, waiting(shown=(GREEN, RED, GREEN), onto=onto))
        assert not stands_at_green(SIGNALLED, waiting(shown=(GREEN, GREEN, RED), onto=onto))


def test_a_light_that_is_off_is_not_green() -> None:
    frame = waiting()
    off = frame._replace(green=np.zeros(3, np.bool_))  # signals show GREEN all the same
    assert stands_at_green(SIGNALLED, frame)
    assert not stands_at_green(SIGNALLED, off)


@pytest.mark.parametrize(
    ("other", "first"),
    [
        (Agent("x", "wi_0", LENGTH - 3.0, 0.0), False),  # ahead
        (Agent("x", "wi_0", LENGTH - 27.0, 0.0), True),  # behind
        (Agent("x", ":we_0", 3.0, 2.0), False),  # crosses on the same connection
        (Agent("x", ":wn_0", 3.0, 2.0), False),  # turns, its rear before the line
        (Agent("x", ":sn_0", 3.0, 2.0), True),  # comes from the other road
        (Agent("x", "eo_0", 8.0, 2.0), True),  # is over the junction
        (Agent("x", "", x=-9.0, y=0.0), True),  # on foot
    ],
)
def test_first_is_an_ego_with_no_vehicle_between_it_and_the_far_side(
    other: Agent, first: bool
) -> None:
    assert stands_at_green(SIGNALLED, waiting(LENGTH - 20.0, other)) is first


def test_only_a_standing_ego_near_a_line_stands_at_green() -> None:
    assert not stands_at_green(SIGNALLED, waiting(v=0.1))
    assert stands_at_green(SIGNALLED, waiting(v=0.09))
    assert stands_at_green(SIGNALLED, waiting(LENGTH - AT_LINE))
    assert not stands_at_green(SIGNALLED, waiting(LENGTH - AT_LINE - 0.5))
    inside = waiting(3.0, on=":we_0")
    assert not stands_at_green(SIGNALLED, inside)
    off_road = waiting()
    assert not stands_at_green(SIGNALLED, off_road._replace(ego=off_road.ego._replace(lane=-1)))
    assert not stands_at_green(
        crossing(), frame_of(crossing(), 0.0, ego_at(crossing(), "wi_0", 89, 0.0))
    )


STATES = st.tuples(
    st.sampled_from([0.0, 0.05, 0.1, 3.0]), st.sampled_from([GREEN, RED]), st.booleans()
)


@given(st.lists(STATES, min_size=2, max_size=25))
def test_the_row_is_what_plain_counting_says(states: list[tuple[float, int, bool]]) -> None:
    """States of speed, light, and whether a vehicle stands ahead of the ego, which is at 10 m from
    the line throughout."""
    ahead = (Agent("x", "wi_0", LENGTH, 0.0, length=4.0),)
    frames = [
        waiting(
            LENGTH - 10.0, *(ahead if behind else ()), v=v, shown=(light, RED, RED), time=k * STEP
        )
        for k, (v, light, behind) in enumerate(states)
    ]
    judge = referee(SIGNALLED, frames[0], "wi", "eo")
    for frame in frames[1:]:
        judge.observe(frame)
    stopped = longest = run = at_green = 0
    before = False
    for k, (v, light, behind) in enumerate(states):
        idle = v < 0.1 and light == GREEN and not behind
        at_green += idle and before
        before = idle
        if k == 0:
            continue
        run = run + 1 if v < 0.1 else 0
        stopped, longest = stopped + (v < 0.1), max(longest, run)
    row = judge.row()
    assert row["stopped_s"] == stopped * STEP
    assert row["longest_stop_s"] == longest * STEP
    assert row["stopped_at_green_s"] == at_green * STEP


# --- time lost ---


def judged(
    road: RoadMap, where: list[tuple[str, float]], *, gone: str = "", **goal: Any
) -> Referee:
    """A referee whose goal knows its free-flow time, after an ego was at these lane positions, one
    a second; `gone`: it is taken out at the end of its route."""
    route = edges(road, *ROUTE)
    ways = [ego_at(road, name, s, route=route) for name, s in where]
    free = free_flow_time(road, route, ways[0].s, ways[0])
    start = frame_of(road, 7.0, ways[0])
    judge = Referee(road, Goal(route, -1, 100.0, free)._replace(**goal), 1.0, start)
    frames = [frame_of(road, 7.0 + k, ego) for k, ego in enumerate(ways)]
    for frame in frames[1:]:
        judge.observe(frame)
    if gone:
        judge.observe(
            frames[-1]._replace(time=frames[-1].time + 1.0, present=False, **{gone: True})
        )
    return judge


def test_after_an_arrival_the_time_lost_is_that_above_free_flow() -> None:
    places = [("a_1", s) for s in np.arange(0.0, 200.0, 10.0)]
    places += [(":m_1", 3.0)] + [("b_1", s) for s in np.arange(3.0, 200.0, 10.0)]
    places += [("c_1", s) for s in np.arange(3.0, 200.0, 10.0)]
    row = judged(STRAIGHT, places, gone="arrived").row()
    assert row["outcome"] == "arrived"
    assert row["time_lost_s"] == pytest.approx(row["travel_time_s"] - row["free_flow_s"])
    assert row["time_lost_s"] > 15.0


@pytest.mark.parametrize("gone", ["", "teleported"])
def test_otherwise_it_is_that_above_free_flow_so_far(gone: str) -> None:
    """The limit is 15 m/s: 60 m take 4 s."""
    places = [("a_1", 10.0), ("a_1", 25.0), ("a_1", 40.0), ("a_1", 55.0), ("a_1", 70.0)]
    assert judged(STRAIGHT, places).row()["time_lost_s"] == pytest.approx(0.0, abs=1e-9)
    row = judged(STRAIGHT, [*places, *[("a_1", 70.0)] * 5], gone=gone).row()
    assert row["time_lost_s"] == pytest.approx(5.0 + bool(gone))


def test_time_lost_inside_a_junction_and_after_it() -> None:
    inside = float(STRAIGHT.length[lane(STRAIGHT, ":m_1")])
    for place, way in ((":m_1", 3.0), ("b_1", inside + 5.0)):
        end = 3.0 if place == ":m_1" else 5.0
        row = judged(STRAIGHT, [("a_1", 195.0), (place, end), (place, end)]).row()
        assert row["time_lost_s"] == pytest.approx(2.0 - (5.0 + way) / 15.0)


def test_time_is_not_gained_and_unknown_off_the_route() -> None:
    assert judged(STRAIGHT, [("a_1", 10.0), ("a_1", 30.0)]).row()["time_lost_s"] == 0.0
    astray = judged(STRAIGHT, [("a_0", 199.0), (":mr_0", 3.0)]).row()
    assert (astray["outcome"], astray["time_lost_s"]) == ("off_route", None)
    unknown = judged(STRAIGHT, [("a_1", 10.0), ("a_1", 20.0)], free_flow=float("nan")).row()
    assert unknown["time_lost_s"] is None


def test_with_a_success_edge_the_way_beyond_it_does_not_count() -> None:
    at_once = int(edges(STRAIGHT, "b")[0])
    places = [("a_1", 180.0), ("a_1", 190.0), ("a_1", 199.0), ("b_1", 2.0)]
    row = judged(STRAIGHT, places, success_edge=at_once).row()
    inside = float(STRAIGHT.length[lane(STRAIGHT, ":m_1")])
    assert row["outcome"] == "arrived"
    assert row["time_lost_s"] == pytest.approx(3.0 - (20.0 + inside + 2.0) / 15.0)


def test_after_an_error_nothing_of_it_is_known() -> None:
    judge = judged(STRAIGHT, [("a_1", 10.0), ("a_1", 10.0)])
    judge.fail("as planned")
    keys = ("stopped_s", "longest_stop_s", "stopped_at_green_s", "time_lost_s")
    assert [judge.row()[key] for key in keys] == [None] * 4
