"""Where a vehicle stands that is no queue, the ego's lane ends; where it is one, nothing changes."""

import math
from typing import NamedTuple

import numpy as np
import pytest
from helpers import Agent, Conflict, Lane, build, edges, ego_at, lights
from helpers_model import compiled, forecast_of, scenario, scene_of, task_of, traffic_params
from hypothesis import given, settings
from hypothesis import strategies as st

from sumo_mcts.model.cost import leads_nowhere, terminal
from sumo_mcts.model.local_map import END, LocalMap, State, ego_state, to_end, urgency_at
from sumo_mcts.model.motion import GOAL, advance
from sumo_mcts.model.standing import PASSED, QUEUE_GAP, STOOD_S, WAITS
from sumo_mcts.planners import base
from sumo_mcts.planners.base import Situation, Task
from sumo_mcts.prediction.forecast import Question, predict
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import GREEN, NO_STOP, STARTS, Intent, Stop

advance, leads_nowhere, terminal, to_end, urgency_at = map(
    compiled, (advance, leads_nowhere, terminal, to_end, urgency_at)
)

LONG = 300.0  # m, lanes of a and b
CAR = 5.0  # m


class Way(NamedTuple):
    """The two edges that the ego drives, and what is between them."""

    lanes: int = 2
    signal: str = ""
    meets: bool = False  # a side road crosses the junction, and has to yield
    onward: int = 2  # lanes of a from the right that lead on


TWO_LANES = Way()


def road_of(way: Way) -> RoadMap:
    """a, a junction of 10 m, b."""
    lanes = [Lane("s", 0, ((LONG + 5, -90.0), (LONG + 5, -6.0)), (":ms_0",))]
    lanes += [Lane(":ms", 0, ((LONG + 5, -6.0), (LONG + 5, 20.0)), ("n_0",), junction="m")]
    lanes += [Lane("n", 0, ((LONG + 5, 20.0), (LONG + 5, 90.0)))]
    for k in range(way.lanes):
        y, on = 3.2 * k, (f":m_{k}",) if k < way.onward else ()
        inner = ((LONG, y), (LONG + 10.0, y))
        lanes += [
            Lane("a", k, ((0.0, y), (LONG, y)), on),
            Lane(":m", k, inner, (f"b_{k}",), junction="m", signal=way.signal, link=k),
            Lane("b", k, ((LONG + 10.0, y), (2 * LONG + 10.0, y))),
        ]
    crossed = [Conflict(":ms_0", 4.0, 8.0, ":m_0", 3.0, 7.0, yields=":ms_0")]
    return build(lanes, crossed if way.meets else [])


class Here(NamedTuple):
    task: Task
    local: LocalMap
    state: State

    def end(self, lane: str) -> float:
        """m from the start of a lane to where the ego has to have left it."""
        return float(self.local.to_leave[self.row(lane), END])

    def urgency(self, lane: str) -> float:
        return float(self.local.urgency[self.row(lane)])

    def row(self, lane: str) -> int:
        number = self.task.road.lane_ids.index(lane)
        return int(np.flatnonzero(self.task.route.lane == number)[0]) - self.local.first


def seen(
    *agents: Agent, way: Way = TWO_LANES, at: float = 20.0, on: str = "a_0", stood: float = 60.0,
    blinker: int = 0, starts: bool = False, interacting: bool = True,
    stop: Stop = NO_STOP,
) -> Here:  # fmt: skip
    """What the ego makes of the agents, of which those that stand have stood for `stood` s."""
    road = road_of(way)
    ego = ego_at(road, on, at, 10.0, route=edges(road, "a", "b"))._replace(stop=stop)
    task = task_of(road, ego, scenario())
    scene = scene_of(ego, road, *agents, signals=lights(GREEN, GREEN) if way.signal else None)
    stands = scene.agents.v == 0.0
    scene = scene._replace(
        agents=scene.agents._replace(
            standing_s=np.where(stands, stood, 0.0),
            blinker=np.where(stands, blinker, 0).astype(np.int32),
        )
    )
    forecast = forecast_of(task, scene, params=traffic_params(interacting=interacting))
    if starts:
        lanes = np.array([road.lane_ids.index("a_0")], np.int32)
        question = Question(scene, lanes, np.zeros(0), traffic_params(), 10.0)
        forecast = predict(road, question, intent=Intent(0, STARTS))
    state = ego_state(task.route, scene.ego)
    assert state is not None
    return Here(task, base.local_of(task, Situation(scene, state, forecast, frozenset())), state)


def stands_at(s: float, on: str = "a_0", name: str = "x") -> Agent:
    return Agent(name, on, s, 0.0, length=CAR)


def goes_on(here: Here) -> bool:
    """Whether no lane ends for the ego."""
    return bool(np.isinf(here.local.to_leave[:, END]).all()) and not here.local.urgency.any()


@settings(deadline=None, max_examples=40)
@given(st.floats(60.0, LONG - WAITS - 1.0), st.sampled_from([0, 1]), st.sampled_from([0, 1]))
def test_a_lane_ends_where_a_vehicle_stands_that_is_no_queue(s: float, k: int, own: int) -> None:
    here = seen(stands_at(s, f"a_{k}"), way=Way(meets=True), on=f"a_{own}")
    assert here.end(f"a_{k}") == pytest.approx(s - CAR)
    assert math.isinf(here.end(f"a_{1 - k}"))
    assert here.urgency(f"a_{1 - k}") == 0.0
    assert here.urgency(f"a_{k}") * (1 if k == 0 else -1) >= 0.0
    if s < 200.0:  # near: see AHEAD_S
        assert here.urgency(f"a_{k}") != 0.0


def test_the_lane_before_ends_there_too() -> None:
    here = seen(stands_at(40.0, "b_0"), at=200.0)
    assert here.end("a_0") == pytest.approx(LONG + 10.0 + 40.0 - CAR)
    assert here.urgency("a_0") > 0.0 == here.urgency("a_1")


cars = st.lists(st.floats(0.5, QUEUE_GAP - 0.5), max_size=6)


@settings(deadline=None, max_examples=40)
@given(cars, st.floats(0.0, WAITS - 0.5), st.sampled_from([Way(meets=True), Way(signal="t")]))
def test_a_queue_before_a_junction_ends_no_lane(gaps: list[float], line: float, way: Way) -> None:
    place = [LONG - line - sum(gaps[:n]) - n * CAR for n in range(len(gaps) + 1)]
    assert goes_on(seen(*(stands_at(s, name=f"x{s:.3f}") for s in place), way=way))


@settings(deadline=None, max_examples=40)
@given(cars, st.floats(0.5, QUEUE_GAP - 0.5), st.floats(0.2, 8.0))
def test_a_jam_whose_head_moves_ends_no_lane(gaps: list[float], gap: float, v: float) -> None:
    place = [250.0 - gap - CAR - sum(gaps[:n]) - n * CAR for n in range(len(gaps) + 1)]
    queue = [stands_at(s, name=f"x{s:.3f}") for s in place]
    assert goes_on(seen(Agent("head", "a_0", 250.0, v, length=CAR), *queue))


def test_who_stands_in_a_queue_behind_a_van_is_no_other_end() -> None:
    here = seen(stands_at(200.0), stands_at(190.0, name="y"))
    assert here.end("a_0") == pytest.approx(200.0 - CAR)


@pytest.mark.parametrize(
    "here",
    [
        pytest.param(lambda: seen(stands_at(200.0), stood=0.5 * STOOD_S), id="just stopped"),
        pytest.param(
            lambda: seen(stands_at(200.0), stood=0.5 * STOOD_S, interacting=False),
            id="just stopped, speeds are kept",
        ),
        pytest.param(lambda: seen(stands_at(200.0), blinker=1), id="says that it goes"),
        pytest.param(lambda: seen(stands_at(200.0), starts=True), id="expected to set off"),
        pytest.param(lambda: seen(Agent("x", "a_0", 200.0, 3.0)), id="crawls"),
        pytest.param(lambda: seen(Agent("x", "", v=0.0, x=200.0)), id="on foot"),
        pytest.param(lambda: seen(stands_at(60.0), at=70.0), id="behind the ego"),
        pytest.param(lambda: seen(stands_at(200.0), way=Way(lanes=1)), id="no lane beside"),
        pytest.param(
            lambda: seen(stands_at(200.0), stands_at(205.0, "a_1", "y")), id="every lane is blocked"
        ),
        pytest.param(lambda: seen(stands_at(LONG - 5.0), way=Way(meets=True)), id="at a junction"),
    ],
)
def test_elsewhere_nothing_changes(here) -> None:  # type: ignore[no-untyped-def]
    assert goes_on(here())


def test_where_nothing_is_to_be_waited_for_a_junction_is_none() -> None:
    assert seen(stands_at(LONG - 5.0)).end("a_0") == pytest.approx(LONG - 5.0 - CAR)


@pytest.mark.parametrize("room", [PASSED - 5.0, PASSED + 5.0])
def test_a_lane_that_the_route_leaves_leads_past_where_there_is_room_to_come_back(
    room: float,
) -> None:
    """Only the right lane leads on; the left one ends with the edge."""
    here = seen(stands_at(LONG - room), way=Way(onward=1))
    past = here.end("a_0") == pytest.approx(LONG - room - CAR)
    assert past == (room > PASSED)
    assert here.end("a_1") == pytest.approx(LONG)


@pytest.mark.parametrize("beyond", [10.0, -10.0])
def test_before_a_stop_of_the_ego_the_lane_beside_leads_past_to_the_stop(beyond: float) -> None:
    """There all lanes end. A stop that the other one stands on is not to be come to."""
    lane = road_of(TWO_LANES).lane_ids.index("a_0")
    stop = Stop(lane, 150.0 + beyond - 1.0, 150.0 + beyond, after=1)
    here = seen(stands_at(150.0), stop=stop)
    assert (here.urgency("a_0") > 0.0) == (beyond > 0.0)


def test_past_it_the_lane_goes_on() -> None:
    """Neither its cost nor its motion knows of what stands behind; the goal stays a goal."""
    here, free = seen(stands_at(100.0, "b_0"), at=280.0), seen(at=280.0)
    cost, node = here.task.cost, here.row("b_0") + here.local.first
    before, after = (here.state._replace(node=node, s=s) for s in (60.0, 140.0))
    assert to_end(here.local, before) == pytest.approx(100.0 - CAR - 60.0)
    assert urgency_at(here.local, before) > 0.0
    assert math.isinf(to_end(here.local, after)) and urgency_at(here.local, after) == 0.0
    costs = [terminal(each.local, cost, after, math.inf, 0.0, 8.0) for each in (here, free)]
    assert costs[0] == costs[1]
    assert not leads_nowhere(here.local, node)
    goal = after._replace(s=LONG - 0.1)
    assert advance(here.local, here.task.ego, goal, 0.0, 0.0)[1] == GOAL
