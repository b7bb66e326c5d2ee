"""Small situations for tests of the model and the planners. No SUMO."""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
from helpers import Agent, Lane, agents_at, build, ego_at, lights

from sumo_mcts import config as configuration
from sumo_mcts.config import ScenarioConfig
from sumo_mcts.driver import params
from sumo_mcts.driver.params import Physics, cost_params, ego_params
from sumo_mcts.model.local_map import LocalMap, State, ego_state
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.model.route import RouteMap, route_map
from sumo_mcts.numerics.kernel import entry
from sumo_mcts.planners import base
from sumo_mcts.planners.base import Situation, Task
from sumo_mcts.planners.failsafe_reach import Assumed
from sumo_mcts.prediction.drivers import TrafficParams
from sumo_mcts.prediction.forecast import OracleData, Question, predict
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import EgoState, Forecast, Scene, Signals

F = TypeVar("F", bound=Callable[..., Any])

PHYSICS = Physics(0.1, False, 3.0)
# what the fail-safe assumes of others
ASSUMED = Assumed(decel=5.0, accel=2.4, over_limit=1.25, reaction=0.8, yield_decel=3.0, horizon=6.0)
WIDTH = 3.2  # m, of a lane


def scenario(*sets: str, **keys: Any) -> ScenarioConfig:
    """The defaults, with `a.b=c` assignments."""
    return configuration.build(
        {"name": "test", "sumo": {"net": "none"}, "egos": [{"id": "ego"}], **keys}, "test", sets
    )


def compiled(function: F) -> F:
    """A kernel for other kernels, made callable from Python as compiled code."""
    return entry(getattr(function, "py_func", function))


def plain(function: F) -> F:
    """A kernel as plain Python, as `make mutants` runs all of them: no test waits for a compiler."""
    return getattr(function, "py_func", function)


def lanes_east(count: int = 3, length: float = 600.0, speed: float = 15.0) -> RoadMap:
    """One edge of parallel lanes, symmetric about y = 0."""
    middle = (count - 1) / 2
    return build(
        [
            Lane("a", k, ((0.0, (k - middle) * WIDTH), (length, (k - middle) * WIDTH)), speed=speed)
            for k in range(count)
        ]
    )


def road_with_light(length: float = 200.0, speed: float = 15.0, after: float = 15.0) -> RoadMap:
    """One lane along y = 0: edge a, a junction of 20 m behind a signal (link 0), edge b with the
    limit `after`."""
    return build(
        [
            Lane("a", 0, ((0.0, 0.0), (length, 0.0)), (":m_0",), speed),
            Lane(
                ":m",
                0,
                ((length, 0.0), (length + 20, 0.0)),
                ("b_0",),
                speed,
                junction="m",
                signal="t",
                link=0,
            ),
            Lane("b", 0, ((length + 20, 0.0), (length + 320, 0.0)), speed=after),
        ]
    )


def scene_of(
    ego: EgoState, road: RoadMap, *agents: Agent, signals: Signals | None = None, step: float = 0.1
) -> Scene:
    """A scene at time 0."""
    return Scene(0.0, step, ego, agents_at(road, *agents), signals or lights())


def task_of(
    road: RoadMap, ego: EgoState, config: ScenarioConfig | None = None, physics: Physics = PHYSICS
) -> Task:
    """What a planner gets once, when the episode begins."""
    config = config or scenario()
    params = ego_params(config, ego, physics)
    route = route_map(
        road,
        ego.route,
        ego.vclass,
        ego.length,
        ego.speed_factor,
        ego.max_speed,
        params.approach_decel,
        stop=ego.stop,
    )
    return Task(road, route, params, cost_params(config))


def traffic_params(
    step: float = 0.2, *, interacting: bool = True, config: ScenarioConfig | None = None
) -> TrafficParams:
    """The traffic parameters of the configuration, for forecast times `step` s apart."""
    return params.traffic_params(config or scenario(), PHYSICS)._replace(
        step=step, interacting=interacting
    )


def ego_lanes(route: RouteMap, state: State) -> Sequence[int]:
    """The lanes ahead of the ego, the present one first."""
    lanes, node = [], state.node
    while node >= 0:
        lanes.append(int(route.lane[node]))
        node = int(route.next[node])
    return lanes


def forecast_of(
    task: Task,
    scene: Scene,
    seconds: float = 10.0,
    params: TrafficParams | None = None,
    oracle: OracleData | None = None,
) -> Forecast:
    """The forecast, which takes the ego to follow its leader."""
    state = ego_state(task.route, scene.ego)
    assert state is not None
    lanes = np.array(ego_lanes(task.route, state), np.int32)
    question = Question(scene, lanes, np.zeros(0), params or traffic_params(), seconds)
    return predict(task.road, question, oracle or OracleData())


def situation_of(
    task: Task, scene: Scene, cleared: frozenset[int] = frozenset(), seconds: float = 10.0
) -> Situation:
    """What a planner gets in each cycle."""
    state = ego_state(task.route, scene.ego)
    assert state is not None
    return Situation(scene, state, forecast_of(task, scene, seconds), cleared)


def local_of(
    task: Task,
    scene: Scene,
    cleared: frozenset[int] = frozenset(),
    seconds: float = 10.0,
    reactive: int = 0,
    asked: int = 0,
    patience: float = 1.0,
) -> tuple[LocalMap, State]:
    """The local map of a cycle, and the ego's state in it."""
    situation = situation_of(task, scene, cleared, seconds)
    local = base.local_of(task, situation, reactive, asked=asked, patience=patience)
    return local, situation.state


def half(params: EgoParams) -> float:
    """Half the ego's length, m."""
    return params.half_length


def predicted(
    road: RoadMap,
    *agents: Agent,
    ego: str = "",
    seconds: float = 10.0,
    params: TrafficParams | None = None,
    signals: Signals | None = None,
    **traits: list[float],
) -> tuple[Scene, Forecast]:
    """The forecast for agents far from an ego at the start of its lane.

    `traits` replace columns of the agents.
    """
    name = ego or road.lane_ids[0]
    state = ego_at(road, name, 6.0, 0.0)
    scene = scene_of(state, road, *agents, signals=signals)
    columns = {
        key: np.array(values, dtype=getattr(scene.agents, key).dtype)
        for key, values in traits.items()
    }
    scene = scene._replace(agents=scene.agents._replace(**columns))
    return scene, forecast_of(task_of(road, state), scene, seconds, params)
