"""A stop on the route: where the route ends until it is served, how the ego comes to a stand at its
place, and when it is too late."""

import math

import numpy as np
import pytest
from helpers import Lane, build, edges, ego_at
from helpers_model import PHYSICS, lanes_east, local_of, scene_of, task_of

from sumo_mcts.driver.params import Physics
from sumo_mcts.driver.stops import is_missed, without_stop
from sumo_mcts.model.cost import step_passability, terminal
from sumo_mcts.model.local_map import ego_state
from sumo_mcts.model.motion import FREE, advance
from sumo_mcts.model.route import RouteMap
from sumo_mcts.planners.base import Task
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import NO_STOP, Decision, Follow, Stop

PHYSICS_OF = {
    "euler": PHYSICS,
    "ballistic": Physics(0.1, True, 3.0),
    "quarter": Physics(0.25, True, 3.0),
    "half": Physics(0.5, False, 0.0),
    "second": Physics(1.0, False, 3.0),
}
SERVED = 0.1  # m/s at most: SUMO counts the stop
WINDOW = 0.1  # m before its end, the shortest that SUMO makes


def two_edges() -> RoadMap:
    return build(
        [
            Lane("a", 0, ((0.0, 0.0), (200.0, 0.0)), (":m_0",)),
            Lane(":m", 0, ((200.0, 0.0), (210.0, 0.0)), ("b_0",), junction="m"),
            Lane("b", 0, ((210.0, 0.0), (410.0, 0.0))),
        ]
    )


def task_with(
    road: RoadMap, stop: Stop, *, lane: str = "a_0", s: float = 10.0, v: float = 10.0,
    moves: Physics = PHYSICS,
) -> Task:  # fmt: skip
    names = [e for e in road.edge_ids if not e.startswith(":")]
    ego = ego_at(road, lane, s, v, route=edges(road, *names))._replace(stop=stop)
    return task_of(road, ego, physics=moves)


def cap_at(route: RouteMap, node: int, s: float) -> float:
    first, last = route.row[node], route.row[node + 1] - 1
    return float(np.interp(s, np.arange(last - first + 1), route.cap[first : last + 1]))


def test_the_lane_of_a_stop_is_the_goal_of_its_edge() -> None:
    road = lanes_east(3)
    route = task_with(road, Stop(2, 299.8, 300.0)).route
    assert route.changes.tolist() == [2, 1, 0]
    assert route.reach.tolist() == [300.0, 300.0, math.inf]
    assert route.next.tolist() == [-1, -1, -1]
    assert route.sign.tolist() == [False, False, True]
    assert not route.lost.any()


def test_a_stop_on_a_later_edge_ends_the_route_there() -> None:
    road = two_edges()
    route = task_with(road, Stop(road.lane_ids.index("b_0"), 49.8, 50.0)).route
    a, b = (int(np.flatnonzero(route.lane == road.lane_ids.index(n))[0]) for n in ("a_0", "b_0"))
    assert route.next[a] >= 0 and route.next[b] == -1
    before = task_with(road, Stop(road.lane_ids.index("a_0"), 49.8, 50.0, after=1)).route
    assert before.next[a] == -1 and math.isinf(before.reach[a])


@pytest.mark.parametrize("v", [8.33, 13.9, 20.0])
def test_braking_for_a_stop_costs_little_time_and_is_mostly_gentle(v: float) -> None:
    """Before, the ego braked with 1.7 m/s2 and crept up to the place: 4 s longer than SUMO's
    driver, who brakes with 4.5."""
    road, stop = lanes_east(1, speed=v), Stop(0, 149.8, 149.98)
    task = task_with(road, stop, s=0.0, v=v)
    local, state = local_of(task, scene_of(ego_at(road, "a_0", 0.0, v)._replace(stop=stop), road))
    braking, time = [], 0.0
    while state.v > 0.0:
        state, _ = advance(local, task.ego, state, 99.0, time)
        time += task.ego.step
        braking.append(-state.a)
    assert time - (150.0 / v + v / (2.0 * 4.5)) < 1.3 * max(v / 13.9, 1.0)
    assert np.median([b for b in braking if b > 0.3]) < 2.6
    assert max(braking) < 3.01


def test_a_waypoint_bounds_the_speed_from_its_begin_to_behind_its_end() -> None:
    route = task_with(lanes_east(2), Stop(1, 99.6, 150.0, speed=4.0)).route
    assert route.changes.tolist() == [1, 0]
    assert [cap_at(route, 1, s) for s in (99.6, 120.0, 152.0)] == pytest.approx([4.0] * 3)
    assert cap_at(route, 1, 90.0) == pytest.approx(math.sqrt(16.0 + 2.0 * 2.0 * 9.0), abs=0.1)
    assert cap_at(route, 1, 160.0) == cap_at(route, 0, 100.0) == pytest.approx(15.0)
    assert not route.stop.any()


@pytest.mark.parametrize("moves", PHYSICS_OF)
@pytest.mark.parametrize(("s", "v"), [(0.0, 15.0), (60.0, 0.0), (88.0, 3.0), (99.0, 0.0)])
def test_whoever_drives_on_stands_at_the_place(s: float, v: float, moves: str) -> None:
    """With every acceleration that is asked for: within what SUMO counts, and not by braking
    hard."""
    road = lanes_east(1)
    task = task_with(road, Stop(0, 99.8, 99.98), s=s, v=v, moves=PHYSICS_OF[moves])
    ego = ego_at(road, "a_0", s, v)._replace(stop=Stop(0, 99.8, 99.98))
    local, state = local_of(task, scene_of(ego, road, step=task.ego.step))
    states = []
    for k in range(round(30.0 / task.ego.step)):
        state, event = advance(local, task.ego, state, 99.0, k * task.ego.step)
        assert event == FREE
        states.append(state)
    stood = next(k for k, x in enumerate(states) if x.v <= SERVED and x.s >= 100.0 - WINDOW)
    assert max(x.s for x in states) < 100.0  # behind the end of a lot it does not count
    assert min(x.a for x in states) > -4.5
    assert (stood + 1) * task.ego.step < 18.0


def test_a_second_short_of_the_place_costs_more_than_at_it() -> None:
    """So an ego that stands before its stop moves up to it."""
    road = lanes_east(1)
    stop = Stop(0, 99.8, 99.98)
    task = task_with(road, stop)
    ego = ego_at(road, "a_0", 99.98, 0.0)._replace(stop=stop)
    local, there = local_of(task, scene_of(ego, road))
    short = there._replace(s=99.5)
    costs = [
        step_passability(local, task.ego, task.cost, x) / task.ego.step for x in (there, short)
    ]
    assert costs[1] - costs[0] == pytest.approx(task.cost.progress)
    ends = [terminal(local, task.cost, x, math.inf, 0.0, 8.0) for x in (there, short)]
    assert ends[1] > ends[0]


@pytest.mark.parametrize(
    ("lane", "s", "v", "missed"),
    [
        ("a_0", 90.0, 5.0, False),
        ("a_0", 90.0, 13.0, True),  # too fast to stand there
        ("a_0", 101.0, 0.0, False),  # SUMO counts a stand a little behind it
        ("a_0", 103.0, 0.0, True),
        ("a_1", 99.0, 0.0, False),  # it may wait for room beside
        ("a_1", 99.0, 5.0, True),
    ],
)
def test_when_a_stop_is_missed(lane: str, s: float, v: float, missed: bool) -> None:
    road, stop = lanes_east(2), Stop(0, 99.9, 100.0)
    task = task_with(road, stop)
    ego = ego_at(road, lane, s, v)._replace(stop=stop)
    state = ego_state(task.route, ego)
    assert state is not None
    assert is_missed(task.route, stop, state, ego) == missed
    assert not is_missed(task.route, NO_STOP, state, ego)


@pytest.mark.parametrize(("s", "missed"), [(10.0, False), (240.0, False), (290.0, True)])
def test_a_stop_on_a_closed_lane_is_missed_when_the_ego_comes_to_it(s: float, missed: bool) -> None:
    """Before that the lane may be opened again."""
    road = lanes_east(2)
    road = road._replace(classes=np.array([1, 1 << 8], np.uint64))  # cars; buses
    stop = Stop(1, 299.9, 300.0)
    task = task_with(road, stop)
    ego = ego_at(road, "a_0", s, 10.0)._replace(stop=stop)
    state = ego_state(task.route, ego)
    assert state is not None
    assert is_missed(task.route, stop, state, ego) == missed


def test_a_stop_that_is_given_up_is_named_in_the_reason() -> None:
    decision = Decision(Follow(np.ones(1), 0), None, (), -1, "search", 0, 0)
    changed = without_stop(decision)
    assert isinstance(changed.command, Follow) and changed.command.skips_stop
    assert "given up" in changed.reason
