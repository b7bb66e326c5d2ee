"""Room taken sideways within the lane, where SUMO divides lanes."""

import math

import numpy as np
import pytest
from helpers import Agent, Lane, build, ego_at
from helpers_model import forecast_of, scene_of, task_of
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts.model.local_map import ELSEWHERE, NODE, ego_state
from sumo_mcts.model.route import CAP, lane_pose
from sumo_mcts.model.sideways import EDGE, Path, own_path, shifted
from sumo_mcts.planners.base import Situation, local_of
from sumo_mcts.road import VEHICLE_CLASSES, RoadMap
from sumo_mcts.scene import Decision, EgoState, Follow, Scene, Sideways

WIDE, CAR, BICYCLE = 4.5, 1.8, 0.65  # m
RIGHT_EDGE = 0.5 * (BICYCLE - WIDE)
DIVIDED = Sideways(speed=1.0, gap=0.6)


def road_of(width: float = WIDE, count: int = 1) -> RoadMap:
    """One edge of lanes side by side, the rightmost along y = 0."""
    road = build([
        Lane("a", k, ((0.0, k * width), (600.0, k * width)), speed=13.9) for k in range(count)
    ])  # fmt: skip
    return road._replace(width=np.full(count, width))


def bicycle(name: str, s: float, d: float = RIGHT_EDGE, v: float = 4.0) -> Agent:
    """One at the right edge of the lane."""
    return Agent(name, "a_0", s, v, d, length=1.6, width=BICYCLE)


def seen(road: RoadMap, ego: EgoState, *agents: Agent) -> Scene:
    """A scene; narrow agents are bicycles."""
    scene = scene_of(ego, road, *agents)
    kind = np.where(scene.agents.width < 1.0, VEHICLE_CLASSES.index("bicycle"), 0)
    return scene._replace(agents=scene.agents._replace(vclass=kind.astype(np.int32)))


def path_of(road: RoadMap, ego: EgoState, *agents: Agent, stood_s: float = 0.0) -> Path | None:
    """The ego's path past the agents, of whom those that stand have stood so long."""
    scene = seen(road, ego, *agents)
    stood = np.where(scene.agents.v == 0.0, stood_s, 0.0)
    scene = scene._replace(agents=scene.agents._replace(standing_s=stood))
    task = task_of(road, ego)
    state = ego_state(task.route, ego)
    assert state is not None
    return own_path(road, task.route, state, scene)


def aside(road: RoadMap, ego: EgoState, path: Path, s: float) -> float:
    """m to the left of the middle of the first lane that the path leads, the ego's front at s."""
    return float(lane_pose(task_of(road, ego).route.table, path.rows, 0, s)[1])


def car(road: RoadMap, s: float = 100.0, v: float = 13.9, **more: float) -> EgoState:
    """An ego whose lanes are divided."""
    return ego_at(road, "a_0", s, v, **more)._replace(sideways=DIVIDED)


def test_where_lanes_are_not_divided_there_is_no_path() -> None:
    road = road_of()
    ego = car(road)
    assert path_of(road, ego._replace(sideways=Sideways()), bicycle("b", 130.0)) is None
    assert path_of(road, ego, bicycle("b", 130.0)) is not None


def test_a_bicycle_at_the_edge_is_passed_with_a_sufficient_gap() -> None:
    road = road_of()
    ego = car(road)
    path = path_of(road, ego, bicycle("b", 140.0))
    assert path is not None and path.shift > 0.0
    there = aside(road, ego, path, 138.0)
    gap = there - 0.5 * CAR - (RIGHT_EDGE + 0.5 * BICYCLE)
    assert gap == pytest.approx(1.5, abs=0.05)  # m, at 50 km/h
    assert there + 0.5 * CAR <= 0.5 * WIDE - EDGE
    assert aside(road, ego, path, 100.0) == 0.0  # where it is now
    slope = np.diff([aside(road, ego, path, s) for s in np.arange(100.0, 138.0)])
    assert slope.max() * 13.9 <= DIVIDED.speed


def test_it_moves_aside_only_when_the_bicycle_is_near() -> None:
    road = road_of()
    ego = car(road)
    path = path_of(road, ego, bicycle("b", 240.0))
    assert path is not None and path.shift == 0.0 and aside(road, ego, path, 236.0) > 0.5


def test_with_less_room_it_passes_more_slowly_and_with_too_little_not_at_all() -> None:
    """A lane of 4 m leaves 1.45 m, one of 3.8 m 1.25 m, one of 3.2 m 0.65 m."""
    slowest = []
    for width in (WIDE, 4.0, 3.8):
        road = road_of(width)
        path = path_of(road, car(road), bicycle("b", 140.0, 0.5 * (BICYCLE - width)))
        assert path is not None and path.shift > 0.0
        slowest.append(path.rows[135:141, CAP].min())
    assert slowest[0] == pytest.approx(13.9) and slowest[0] >= slowest[1] > slowest[2] > 5.5
    road = road_of(3.2)
    path = path_of(road, car(road), bicycle("b", 140.0, 0.5 * (BICYCLE - 3.2)))
    assert path is not None and path.shift == 0.0


def test_it_comes_back_once_it_is_past() -> None:
    road = road_of()
    ego = car(road, d=0.8)
    for s in (97.0, 88.0):  # beside the ego, and too near behind it
        beside = path_of(road, ego, bicycle("b", s))
        assert beside is not None and beside.shift == pytest.approx(0.0, abs=0.01)
    past = path_of(road, ego, bicycle("b", 84.0))
    assert past is not None and past.shift == pytest.approx(-0.8)


def test_it_returns_to_where_its_type_likes_to_drive() -> None:
    road = road_of()
    ego = car(road)._replace(sideways=DIVIDED._replace(wish=-9.0))
    path = path_of(road, ego)
    assert path is not None and path.shift == pytest.approx(-(0.5 * (WIDE - CAR) - EDGE))


def test_a_car_that_drives_is_followed_and_one_that_is_parked_is_passed() -> None:
    road = road_of(6.0)
    van = Agent("v", "a_0", 150.0, 4.0, d=-1.8, width=2.2)
    path = path_of(road, car(road), van)
    assert path is not None and path.shift == 0.0
    parked = path_of(road, car(road), van._replace(v=0.0), stood_s=10.0)
    assert parked is not None and parked.shift > 0.0
    waits = path_of(road, car(road), van._replace(v=0.0), Agent("w", "a_0", 158.0, 0.0), stood_s=10)
    assert waits is not None and waits.shift == 0.0  # it is the end of a queue
    two = road_of(6.0, 2)
    beside = Agent("w", "a_1", 163.0, 5.0)  # who drives in the lane beside is no cause
    path = path_of(two, car(two), van._replace(v=0.0), beside, stood_s=10.0)
    assert path is not None and path.shift > 0.0


def test_nobody_who_rides_is_passed_on_the_wrong_side() -> None:
    road = road_of(6.0)
    left = bicycle("b", 140.0, 0.5 * (6.0 - BICYCLE))
    path = path_of(road, car(road), left)
    assert path is not None and path.shift == 0.0
    path = path_of(road._replace(lefthand=True), car(road), left)
    assert path is not None and aside(road, car(road), path, 138.0) < -0.0
    motorcycle = car(road, width=0.8)
    path = path_of(road, motorcycle, Agent("c", "a_0", 140.0, 3.0, d=0.8))
    assert path is not None and aside(road, motorcycle, path, 135.0) < 0.0


def nodes(road: RoadMap, ego: EgoState, *agents: Agent) -> np.ndarray[tuple[int, ...], np.dtype]:
    """[T, N] on which node of the route each agent counts."""
    scene, task = seen(road, ego, *agents), task_of(road, ego)
    state = ego_state(task.route, ego)
    assert state is not None
    path = own_path(road, task.route, state, scene)
    found = local_of(
        task, Situation(scene, state, forecast_of(task, scene), frozenset(), path=path)
    )
    return found.agent[:, :, NODE]


def test_who_leaves_room_beside_is_no_leader() -> None:
    road = road_of()
    ego = car(road)
    assert (nodes(road, ego, bicycle("b", 150.0)) == ELSEWHERE).all()
    assert (nodes(road, ego, bicycle("b", 150.0, d=0.0)) == 0).all()
    undivided = ego._replace(sideways=Sideways())
    assert (nodes(road, undivided, bicycle("b", 150.0)) == 0).all()


def test_near_the_bicycle_it_is_still_a_leader() -> None:
    """The ego cannot be aside before it is there."""
    road = road_of()
    found = nodes(road, car(road), bicycle("b", 108.0, v=10.0))
    assert found[0, 0] == 0


@given(st.floats(0.0, 13.0), st.floats(-60.0, 100.0), st.floats(-1.0, 1.0), st.floats(3.0, 7.0))
def test_the_path_stays_in_the_lane(v: float, ahead: float, share: float, width: float) -> None:
    road = road_of(width)
    ego = car(road, 200.0)
    d = share * 0.5 * (width - BICYCLE)
    path = path_of(road, ego, bicycle("b", 200.0 + ahead, d, v), bicycle("c", 230.0, -d, 3.0))
    assert path is not None
    room = max(0.5 * (width - CAR) - EDGE, 0.0)
    assert np.abs(path.rows[:, 1]).max() <= room + 1e-9
    assert np.isfinite(path.rows).all() and (path.rows[:, CAP] >= 0.0).all()


def test_a_lane_change_comes_before_it() -> None:
    def decided(side: int) -> Follow:
        command = Follow(np.full(5, 10.0), side)
        found = shifted(Decision(command, None, (), -1, "", 0, 0), Path(0.7, np.zeros((0, 6))))
        assert isinstance(found.command, Follow)
        return found.command

    assert decided(0).shift == 0.7 and decided(1).shift == 0.0
    assert math.isclose(decided(-1).shift, 0.0)
