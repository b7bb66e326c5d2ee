"""Overtaking through oncoming traffic: the reason for it, the sight, and what it costs to be
there."""

from typing import Any

import numpy as np
import pytest
from helpers import Agent, Lane, build, edges, ego_at, lane
from helpers_model import PHYSICS, compiled, forecast_of, scenario, scene_of
from numpy.typing import NDArray

from sumo_mcts.driver.params import cost_params, ego_params
from sumo_mcts.model import completing, cost, interaction, occupancy
from sumo_mcts.model.local_map import (
    AGENT,
    ENTERS,
    GONE,
    HEAD_ON,
    MERGES,
    NODE,
    UNSEEN,
    LocalMap,
    State,
    ego_state,
)
from sumo_mcts.model.motion import FREE, advance, begin_change, can_change
from sumo_mcts.model.oncoming import OVER_LIMIT, Sight
from sumo_mcts.model.reactions import undisturbed
from sumo_mcts.model.route import route_map
from sumo_mcts.numerics.geometry import COS, X, Y
from sumo_mcts.planners.base import Situation, Task, local_of
from sumo_mcts.planners.ply import OVERTAKES_SOON, may_change, needed_side
from sumo_mcts.road import STOP, RoadMap
from sumo_mcts.world.oncoming import with_oncoming

LONG, LIMIT = 600.0, 15.0
at_end, step = compiled(completing.unfinished), compiled(cost.step_passability)
owing, may_begin, begun = (
    compiled(occupancy.yielding_cost), compiled(can_change), compiled(begin_change)
)  # fmt: skip


def two_way(before: bool = True) -> RoadMap:
    """Edge a eastward at y = 0 and b westward at y = 3.2, side by side; `before`: edge c leads into
    b, else the map ends there."""
    lanes = [
        Lane("a", 0, ((0.0, 0.0), (LONG, 0.0)), speed=LIMIT),
        Lane("b", 0, ((LONG, 3.2), (0.0, 3.2)), speed=LIMIT),
    ]
    if before:
        lanes.append(Lane("c", 0, ((LONG + 300.0, 3.2), (LONG, 3.2)), ("b_0",), speed=LIMIT))
    return with_oncoming(build(lanes), {0: 1})


def in_a_row(*more: Lane, side: float = 1.0) -> RoadMap:
    """Edges a and c eastward through a junction of 4 m, d and b westward; e leads into d. `more`
    lanes; `side`: 1 where the oncoming are to the left, -1 to the right."""
    y, half = 3.2 * side, 0.5 * LONG
    lanes = [
        Lane("a", 0, ((0.0, 0.0), (half, 0.0)), ("j_0",), speed=LIMIT),
        Lane("j", 0, ((half, 0.0), (half + 4.0, 0.0)), ("c_0",), speed=LIMIT, junction="n"),
        Lane("c", 0, ((half + 4.0, 0.0), (LONG + 4.0, 0.0)), speed=LIMIT),
        Lane("d", 0, ((LONG + 4.0, y), (half + 4.0, y)), ("k_0",), speed=LIMIT),
        Lane("k", 0, ((half + 4.0, y), (half, y)), ("b_0",), speed=LIMIT, junction="n"),
        Lane("b", 0, ((half, y), (0.0, y)), speed=LIMIT),
        Lane("e", 0, ((LONG + 304.0, y), (LONG + 4.0, y)), ("d_0",), speed=LIMIT),
        *more,
    ]
    road = build(lanes)._replace(lefthand=side < 0.0)
    pairs = {"a_0": "b_0", "j_0": "k_0", "c_0": "d_0"}
    return with_oncoming(road, {lane(road, own): lane(road, other) for own, other in pairs.items()})


ROAD, FAR = two_way(), Sight(200.0)
ROW = in_a_row()


def seen(
    *agents: Agent, ego: str = "a_0", s: float = 50.0, v: float = 10.0, sight: Sight = FAR,
    road: RoadMap = ROAD, oncoming: bool = True, way: tuple[str, ...] = ("a",),
) -> tuple[Task, LocalMap, State]:  # fmt: skip
    """What the ego reads there on its `way`."""
    state = ego_at(road, ego, s, v, route=edges(road, *way))
    params = ego_params(scenario(), state, PHYSICS)
    route = route_map(
        road, state.route, 0, 5.0, 1.0, 50.0, params.approach_decel, oncoming=oncoming
    )
    task = Task(road, route, params, cost_params(scenario()), sight)
    scene = scene_of(state, road, *agents)
    where = ego_state(route, state)
    assert where is not None
    forecast = forecast_of(task, scene)
    return task, local_of(task, Situation(scene, where, forecast, frozenset())), where


SLOW = Agent("x", "a_0", 90.0, 4.0)


@pytest.mark.parametrize(
    ("agents", "there"),
    [
        ((), False),
        ((SLOW,), True),
        ((SLOW._replace(v=0.0),), True),
        ((SLOW._replace(v=14.0),), False),  # fast enough
        ((SLOW._replace(s=40.0),), False),  # behind
        ((SLOW._replace(s=300.0),), False),  # far
        ((SLOW._replace(on="b_0"),), False),
    ],
)
def test_only_a_slow_leader_opens_the_lane_of_the_oncoming(
    agents: tuple[Agent, ...], there: bool
) -> None:
    task, local, state = seen(*agents)
    assert may_begin(local, task.ego, state, 1) == there


def test_who_stands_near_the_end_is_not_overtaken() -> None:
    task, local, state = seen(SLOW._replace(s=LONG - 20.0), s=LONG - 60.0)
    assert not may_begin(local, task.ego, state, 1)


def test_without_leave_there_is_no_such_lane() -> None:
    task, local, state = seen(SLOW, oncoming=False)
    assert not may_begin(local, task.ego, state, 1) and len(local.node) == 1
    assert local.agent.shape[1] == 1  # nor anybody unseen


def test_the_ego_wants_back_and_must_not_end_there() -> None:
    task, local, _ = seen(SLOW, ego="a_1")
    there = State(1, 50.0, 10.0, 0.0, 0.0, -1, 0.0)
    own = there._replace(node=0)
    assert may_begin(local, task.ego, there, -1) and compiled(needed_side)(local, there) == -1
    assert step(local, task.ego, task.cost, there) > step(local, task.ego, task.cost, own)
    assert at_end(local, task.ego, task.cost, there, 8.0) == 0.5 * task.cost.contact
    assert at_end(local, task.ego, task.cost, own, 8.0) == 0.0
    # out of it, and on the way back past the middle, it is over; on the way there it counts
    out, back = (
        own._replace(other=1, progress=0.3), own._replace(other=1, progress=0.7)
    )  # fmt: skip
    assert at_end(local, task.ego, task.cost, out, 8.0) > 0.0
    assert at_end(local, task.ego, task.cost, back, 8.0) == 0.0


@pytest.mark.parametrize(
    ("s", "v", "comes", "in_time"),
    [
        (115.0, 12.0, 0.0, True),  # nearly past it, at 90 + 8 * 4 = 122 m
        (115.0, 12.0, 450.0, True),
        (115.0, 12.0, 330.0, False),  # at the horizon it has come 8 * 14 m nearer
        (115.0, 4.5, 0.0, False),  # too slow ever to be past
        (60.0, 12.0, 0.0, True),  # far behind it, where the own lane is free
    ],
)
def test_what_the_horizon_cuts_may_be_completed_in_time(
    s: float, v: float, comes: float, in_time: bool
) -> None:
    others = (Agent("o", "b_0", LONG - comes, 14.0),) if comes else ()
    task, local, _ = seen(SLOW, *others, ego="a_1", sight=Sight(500.0))
    there = State(1, s, v, 0.0, 0.0, -1, 0.0)
    price = at_end(local, task.ego, task.cost, there, 8.0)
    assert price < 20.0 if in_time else price == 0.5 * task.cost.contact


def unseen(local: LocalMap) -> NDArray[np.float64]:
    """[T, .] the agent that was added."""
    return local.agent[:, -1]


def test_beyond_sight_somebody_comes_faster_than_the_limit() -> None:
    _, local, _ = seen(SLOW)
    rows = unseen(local)
    assert local.agent.shape[1] == 2
    # the middle of the ego is at 47.5 m; a vehicle is seen where its front is
    assert rows[0, X] - 2.5 == pytest.approx(247.5, abs=0.6)
    assert rows[0, Y] == pytest.approx(3.2) and rows[0, COS] == pytest.approx(-1.0)
    speed = (rows[0, X] - rows[10, X]) / (10 * local.dt)
    assert speed == pytest.approx(OVER_LIMIT * LIMIT, abs=0.3)


def test_it_is_there_only_from_when_it_comes_to_the_lane() -> None:
    _, local, _ = seen(SLOW._replace(s=480.0), s=450.0)
    rows = unseen(local)
    comes = int(np.argmax(rows[:, NODE] != GONE))
    assert comes * local.dt == pytest.approx((450.0 - 2.5 + 200.0 - LONG) / 18.0, abs=local.dt)


def test_where_the_map_ends_nobody_is_seen_coming() -> None:
    _, local, _ = seen(SLOW._replace(s=480.0), s=450.0, road=two_way(before=False))
    assert unseen(local)[0, X] - 2.5 == pytest.approx(LONG, abs=4.0)


@pytest.mark.parametrize(("gap", "view"), [(10.0, 60.0), (40.0, 160.0)])
def test_a_leader_hides_the_lane_beside_it(gap: float, view: float) -> None:
    """The nearer it is, the less is seen past it."""
    leader = Agent("x", "a_0", 50.0 + gap + 5.0, 4.0)
    _, local, _ = seen(leader, sight=Sight(300.0, hidden=True))
    hidden = unseen(local)[0, X] - 50.0
    _, local, _ = seen(leader, sight=Sight(300.0))
    assert hidden < view < 250.0 < unseen(local)[0, X] - 50.0


def test_whoever_comes_has_room_to_stop() -> None:
    """As SUMO's drivers take it: for an ego in their lane they brake as for one that stands."""
    task, local, _ = seen(SLOW, Agent("o", "b_0", 300.0, 14.0))
    rows = local.obligation
    assert rows[:, AGENT].tolist() == [0.0, 2.0]
    assert rows[:, MERGES].tolist() == [HEAD_ON, UNSEEN]
    for s, owes in ((150.0, False), (265.0, True), (320.0, False)):
        there = State(1, s, 10.0, 0.0, 0.0, -1, 0.0)
        assert (owing(local, task.ego, task.cost, there, undisturbed(local), 0) > 0.0) == owes
    later = round(10.0 / 14.0 / local.dt)  # it has come 10 m nearer
    there = State(1, 262.0, 10.0, 0.0, 0.0, -1, 0.0)
    assert owing(local, task.ego, task.cost, there, undisturbed(local), later) > owing(
        local, task.ego, task.cost, there, undisturbed(local), 0
    )


def test_who_is_not_seen_has_room_at_the_limit_unless_the_ego_is_there() -> None:
    """The ego begins nothing for which it would have to brake hard, but it does go on."""
    task, there, _ = seen(SLOW, ego="a_1")
    begins = there._replace(committed=False)
    from_ego = 200.0 - 2.5 - 50.0  # m from the state below to where the unseen is
    for short, owes in ((30.0, True), (45.0, False)):
        state = State(1, 100.0 + from_ego - short, 10.0, 0.0, 0.0, -1, 0.0)
        rates = [
            owing(each, task.ego, task.cost, state, undisturbed(each), 0)
            for each in (begins, there)
        ]
        assert (rates[0] > 0.0) == owes and rates[1] == 0.0
    # to complete it after the horizon takes 4.5 s; it is 35 m short of the ego then, or 65 m
    for sight, may in ((350.0, False), (380.0, True)):
        task, there, _ = seen(SLOW, ego="a_1", s=90.0, sight=Sight(sight))
        prices = [
            at_end(each, task.ego, task.cost, State(1, 125.0, 12.0, 0.0, 0.0, -1, 0.0), 8.0)
            for each in (there._replace(committed=False), there)
        ]
        assert (prices[0] < 20.0) == may and prices[1] < 20.0


def test_its_box_counts_though_it_is_on_another_edge() -> None:
    task, local, state = seen(SLOW, Agent("o", "b_0", LONG - 47.0, 14.0))
    assert lane(ROAD, "b_0") == 1
    there = begun(local, task.ego, state, 1)._replace(progress=0.49)
    meets = compiled(interaction.meet)
    nobody_moves = np.zeros((0, 2))
    assert meets(local, task.ego, task.cost, there, nobody_moves, 0, 0).contact
    assert not meets(local, task.ego, task.cost, state, nobody_moves, 0, 0).contact


def test_nobody_moves_over_in_front_of_who_comes() -> None:
    """SUMO's driver would brake as hard as it can, and stand in the ego's way."""
    free, near, beside = (
        seen(SLOW, Agent("o", "b_0", LONG - x, 14.0)) for x in (130.0, 85.0, 43.0)
    )  # fmt: skip
    is_free, nobody_moves = compiled(interaction.place_is_free), np.zeros((0, 2))
    for (task, local, state), may in ((free, True), (near, False), (beside, False)):
        out = begun(local, task.ego, state, 1)
        assert is_free(local, task.ego, task.cost, out, nobody_moves, 0) == may


def test_the_room_is_owed_from_the_beginning_of_the_change() -> None:
    task, local, state = seen(SLOW, Agent("o", "b_0", LONG - 80.0, 14.0))
    rates = [
        compiled(interaction.meet)(local, task.ego, task.cost, each, np.zeros((0, 2)), 0, 0).rate
        for each in (state, begun(local, task.ego, state, 1))
    ]
    assert rates[1] > rates[0] + 4.0


def across(road: RoadMap = ROW, *agents: Agent, **how: Any) -> tuple[Task, LocalMap, State]:
    """The same on a road of two edges."""
    return seen(*agents, road=road, way=("a", "c"), sight=Sight(900.0), **how)


def test_a_leader_beyond_a_plain_junction_opens_the_lane_too() -> None:
    ahead = Agent("x", "c_0", 30.0, 4.0)
    for s, there in ((270.0, True), (100.0, False)):
        task, local, state = across(ROW, ahead, s=s)
        assert may_begin(local, task.ego, state, 1) == there


def test_a_leader_before_the_junction_may_be_passed_where_the_road_goes_on() -> None:
    leader = Agent("x", "a_0", 280.0, 4.0)
    side_road = Lane("m", 0, ((300.0, -9.0), (304.0, 0.0)), ("c_0",), junction="n")
    light = in_a_row()._replace(rule=np.where(ROW.junction >= 0, STOP, ROW.rule))
    for road, there in ((ROW, True), (in_a_row(side_road), False), (light, False)):
        task, local, state = across(road, leader, s=240.0)
        assert may_begin(local, task.ego, state, 1) == there


def test_the_lane_is_driven_on_through_the_junction() -> None:
    task, local, _ = across(ROW, SLOW, ego="a_1", s=290.0)
    nodes = task.route.lane.tolist()
    there = nodes.index(lane(ROW, "a_1"))
    inside, beyond = (nodes.index(lane(ROW, name)) for name in ("j_1", "c_1"))
    state = State(there, 290.0, 12.0, 0.0, 0.0, -1, 0.0)
    on = [state.node]
    for k in range(20):
        state, event = compiled(advance)(local, task.ego, state, 0.0, 0.1 * k)
        assert event == FREE
        on.append(state.node)
    assert list(dict.fromkeys(on)) == [there, inside, beyond]


def test_who_comes_on_the_next_edge_has_room_to_stop() -> None:
    """Before it is on the edge of the ego, and though it does not get there within the horizon."""
    task, local, _ = across(ROW, SLOW, Agent("o", "d_0", 20.0, 5.0))
    rows = local.obligation[local.obligation[:, MERGES] == HEAD_ON]
    names = [ROW.lane_ids[task.route.lane[int(node)]] for node in rows[:, 0]]
    assert names == ["a_1", "j_1", "c_1"]
    # it is 280 m beyond the junction, which is 304 m from the start of the first edge
    np.testing.assert_allclose(rows[:, ENTERS], [584.0, 284.0, 280.0])


def test_an_overtaking_is_completed_across_a_junction() -> None:
    """Beside a leader that is past it at the horizon, at 250 + 8 * 4 = 282 m."""
    leader = SLOW._replace(s=250.0)
    for road, in_time in ((ROW, True), (in_a_row(Lane("m", 0, ((300.0, -9.0), (304.0, 0.0)),
    ("c_0",), junction="n")), False)):  # fmt: skip
        task, local, _ = across(road, leader, ego="a_1", s=240.0)
        node = task.route.lane.tolist().index(lane(road, "a_1"))
        price = at_end(local, task.ego, task.cost, State(node, 280.0, 12.0, 0.0, 0.0, -1, 0.0), 8.0)
        assert (price < 6.0) == in_time


def test_behind_the_leader_nothing_is_gained_by_being_there() -> None:
    """Else the ego would move out far behind it, or fall back for that."""
    task, local, _ = seen(SLOW, ego="a_1", sight=Sight(900.0))
    slow, fast, past = (
        at_end(local, task.ego, task.cost, State(1, s, v, 0.0, 0.0, -1, 0.0), 8.0)
        for s, v in ((80.0, 4.5), (80.0, 12.0), (160.0, 12.0))  # the leader is at 122 m then
    )
    assert past < 1.5 < fast < 5.0 < slow < 0.5 * task.cost.contact


@pytest.mark.parametrize(("count", "v", "gained"), [(2, 4.0, 1.0 - 4.0 / LIMIT), (6, 0.0, 0.0)])
def test_passing_one_is_worth_it_but_not_in_a_jam(count: int, v: float, gained: float) -> None:
    queue = [SLOW._replace(id=f"q{k}", s=90.0 + 25.0 * k, v=v) for k in range(count)]
    _, local, _ = seen(*queue)
    first = 90.0 + 8.0 * v  # where the first one is then
    lost = [
        compiled(cost.stuck_behind)(local, 0, s, 0.0, 8.0) for s in (first - 10.0, first + 10.0)
    ]
    assert lost[0] - lost[1] == pytest.approx(gained, abs=0.02)
    closed = seen(*queue, oncoming=False)[1]
    assert compiled(cost.stuck_behind)(closed, 0, first - 10.0, 0.0, 8.0) == 0.0


def test_where_it_gets_back_ahead_of_all_of_a_queue_counts() -> None:
    """Not between two without a gap between them; with more of them than PLATOON not at all."""
    for count, in_time in ((2, True), (completing.PLATOON + 3, False)):
        queue = [SLOW._replace(id=f"q{k}", s=90.0 + 20.0 * k) for k in range(count)]
        task, local, _ = seen(*queue, ego="a_1", sight=Sight(900.0))
        state = State(1, 115.0, 14.0, 0.0, 0.0, -1, 0.0)
        price = at_end(local, task.ego, task.cost, state, 8.0)
        assert (price < 0.5 * task.cost.contact) == in_time


def test_an_overtaking_begins_soon_or_is_no_plan() -> None:
    task, local, state = seen(SLOW, sight=Sight(900.0))
    change, nobody_moves = compiled(may_change), np.zeros((0, 2))
    for time, may in ((0.0, True), (OVERTAKES_SOON, True), (OVERTAKES_SOON + 1.0, False)):
        found = change(local, task.ego, task.cost, state, nobody_moves, 1, 1.0, time)
        assert found == may


def test_whoever_comes_and_brakes_has_its_price_at_the_horizon() -> None:
    """Less than a contact: an ego that is there goes on. One that is not does not begin."""
    prices, begins = [], []
    for comes in (600.0, 400.0, 330.0):
        other = Agent("o", "b_0", LONG - comes, 14.0)
        task, local, _ = seen(SLOW, other, ego="a_1", sight=Sight(900.0))
        state = State(1, 115.0, 12.0, 0.0, 0.0, -1, 0.0)
        prices.append(at_end(local, task.ego, task.cost, state, 8.0))
        not_yet = local._replace(committed=False)
        begins.append(at_end(not_yet, task.ego, task.cost, state, 8.0))
    worst = 0.5 * task.cost.contact
    assert prices[0] < 3.0 < prices[1] < worst == prices[2]
    assert begins == [prices[0], worst, worst]


def test_traffic_on_the_left_is_the_mirror_image() -> None:
    left = in_a_row(side=-1.0)
    far, near = Agent("o", "d_0", 20.0, 5.0), Agent("x", "a_0", 90.0, 4.0)
    maps = [across(road, near, far) for road in (ROW, left)]
    (task, local, state), (_, mirrored, other) = maps
    assert may_begin(local, task.ego, state, 1) and not may_begin(local, task.ego, state, -1)
    assert may_begin(mirrored, task.ego, other, -1) and not may_begin(mirrored, task.ego, other, 1)
    np.testing.assert_array_equal(mirrored.urgency, -local.urgency)
    np.testing.assert_allclose(mirrored.obligation, local.obligation)
    np.testing.assert_allclose(mirrored.agent[..., Y], -local.agent[..., Y], atol=1e-9)
    there = State(task.route.lane.tolist().index(lane(ROW, "a_1")), 115.0, 12.0, 0.0, 0.0, -1, 0.0)
    prices = [at_end(each, task.ego, task.cost, there, 8.0) for each in (local, mirrored)]
    assert prices[0] == pytest.approx(prices[1]) and 0.0 < prices[0] < 0.5 * task.cost.contact
