"""What a learned driver observes, as arrays of fixed size, and what it may do.

The same in gym.py, where it is trained, and in a planner that drives by it.
"""

import math
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.arrays import Floats
from sumo_mcts.config import ScenarioConfig
from sumo_mcts.model.local_map import State
from sumo_mcts.model.route import RouteMap, lane_pose, stop_ahead
from sumo_mcts.planners.base import Situation, Task, local_of
from sumo_mcts.planners.baselines import plan_of
from sumo_mcts.planners.mcts import actions_of, mcts_params
from sumo_mcts.scene import AFTER_STOP, GREEN, RED, YELLOW, Agents, Decision, Follow, Scene, Signals

POINT_M = 10.0  # m between the points of the route
FAR_M = 300.0  # m: larger distances count as this much
LONG_M = 10_000.0  # m: the same for the end of the route
LATER_S = 60.0  # s: later counts as this much
Array = NDArray[np.float32]
Observation = dict[str, Array]

# Every column with its unit and bounds: name -> (column, low, high).
_THERE = ("there", 0.0, 1.0)  # 1; 0: the row is empty
EGO = (
    ("speed, m/s", 0.0, 100.0), ("acceleration, m/s2", -20.0, 20.0),
    ("limit of its lane, m/s", 0.0, 100.0),
    ("offset from the middle of its lane, m, left > 0", -10.0, 10.0),
    ("progress of a lane change", 0.0, 1.0), ("a lane to the left", 0.0, 1.0),
    ("a lane to the right", 0.0, 1.0),
    ("lane changes that the route needs, left > 0", -20.0, 20.0),
    ("distance until its lane leaves the route, m", 0.0, FAR_M),
    ("distance to the end of its route, m", 0.0, LONG_M),
)  # fmt: skip
AGENT = (
    _THERE, ("x ahead, m", -FAR_M, FAR_M), ("y to the left, m", -FAR_M, FAR_M),
    ("cos of the heading", -1.0, 1.0), ("sin of the heading", -1.0, 1.0),
    ("speed, m/s", 0.0, 100.0), ("acceleration, m/s2", -20.0, 20.0), ("length, m", 0.0, 50.0),
    ("width, m", 0.0, 10.0),
    ("turn signal, left 1, right -1", -1.0, 1.0), ("a pedestrian", 0.0, 1.0),
)  # fmt: skip
POINT = (
    _THERE,
    ("x ahead, m", -FAR_M, FAR_M),
    ("y to the left, m", -FAR_M, FAR_M),
    ("limit, m/s", 0.0, 100.0),
    ("inside a junction", 0.0, 1.0),
)
STOP_LINE = (
    _THERE, ("distance to it, m", 0.0, FAR_M), ("green", 0.0, 1.0), ("yellow", 0.0, 1.0),
    ("red", 0.0, 1.0), ("a stop sign", 0.0, 1.0),
    ("time to its next change, s", 0.0, LATER_S),
)  # fmt: skip


class Shown(NamedTuple):
    """How much is observed."""

    agents: int = 8  # the nearest ones
    points: int = 12  # of the ego's lane ahead, and of those that follow it, POINT_M apart


@cache
def bounds(shown: Shown) -> dict[str, tuple[Array, Array]]:
    """Lowest and highest values of an observation.

    ego [10], agents [N, 11], route [P, 5], stop_line [7]; columns as above.
    """
    rows = {
        "ego": EGO,
        "agents": (AGENT,) * shown.agents,
        "route": (POINT,) * shown.points,
        "stop_line": STOP_LINE,
    }
    return {name: (_side(each, 1), _side(each, 2)) for name, each in rows.items()}


def observe(task: Task, state: State, scene: Scene, shown: Shown) -> Observation:
    """What is known in a scene, in the frame of the ego's centre and heading.

    Values beyond the bounds are clipped.
    """
    seen = {
        "ego": _ego(task.route, state, scene),
        "agents": _agents(scene, shown.agents),
        "route": _points(task, state, scene, shown.points),
        "stop_line": _stop_line(task.route, state, scene.signals),
    }
    return {
        name: np.clip(seen[name], low, high, dtype=np.float32)
        for name, (low, high) in bounds(shown).items()
    }


def _side(rows: Any, k: int) -> Array:
    """The k-th entry of each column, [columns] or [rows, columns]."""
    return np.array(rows, dtype=object)[..., k].astype(np.float32)


class Actions:
    """What may be done for one decision period: the actions at the root of a scenario's search."""

    def __init__(self, config: ScenarioConfig) -> None:
        """Accelerations, lane changes and period are those of the section `planner`."""
        self._params = mcts_params(config)
        # [A, 2] acceleration, m/s2 (FOLLOW: car following), and lane change, -1 right, 0, 1 left
        self.table = actions_of(self._params)[:, :2]

    def decision(self, task: Task, situation: Situation, action: int) -> Decision:
        """The command that begins the action and goes on with it, with the speeds that the search
        expects. A lane change that cannot begin is left out."""
        accel, side = float(self.table[action, 0]), int(self.table[action, 1])
        local = local_of(task, situation)
        plan = plan_of(task, self._params, local, situation.state, accel, side)
        if not len(plan.v):
            side, plan = 0, plan_of(task, self._params, local, situation.state, accel, 0)
        return Decision(Follow(plan.v, side), plan, (), -1, "policy", 0, 0)


def _ego(route: RouteMap, state: State, scene: Scene) -> Floats:
    """[10] see EGO."""
    ego, node = scene.ego, state.node
    goal = float(route.station[-1] + route.length[-1] - route.station[node]) - state.s
    return np.array([
        ego.v, ego.a, route.limit[node], ego.d, state.progress, route.left[node] >= 0,
        route.right[node] >= 0,
        route.needed[node], route.reach[node] - state.s, goal,
    ])  # fmt: skip


def _agents(scene: Scene, count: int) -> Floats:
    """[count, 11] see AGENT, the nearest first."""
    a: Agents = scene.agents
    x, y = _seen_from(scene, a.x, a.y)
    turned = a.heading - scene.ego.heading
    columns = (
        np.ones(len(x)), x, y, np.cos(turned), np.sin(turned), a.v, a.a, a.length, a.width,
        a.blinker, a.person,
    )  # fmt: skip
    nearest = np.argsort(x * x + y * y, kind="stable")[:count]
    rows = np.zeros((count, len(AGENT)))
    rows[: len(nearest)] = np.column_stack(columns)[nearest]
    return rows


def _points(task: Task, state: State, scene: Scene, count: int) -> Floats:
    """[count, 5] see POINT: where the ego's centre is going to be."""
    route, rows = task.route, np.zeros((count, len(POINT)))
    for row, (node, s) in zip(
        rows, _ahead(route, state, [POINT_M * k for k in range(1, count + 1)]), strict=False
    ):
        x, y, _, _ = lane_pose(route.table, route.rows, node, s)
        row[:] = 1.0, *_seen_from(scene, x, y), route.limit[node], route.internal[node]
    return rows


def _ahead(
    route: RouteMap, state: State, distances: Sequence[float]
) -> Iterator[tuple[int, float]]:
    """Node and lane position at distances ahead (m, ascending), as far as the lane goes on."""
    node, begin = state.node, -state.s
    for distance in distances:
        while distance - begin > route.length[node]:
            begin += float(route.length[node])
            node = int(route.next[node])
            if node < 0:
                return
        yield node, distance - begin


def _stop_line(route: RouteMap, state: State, signals: Signals) -> Floats:
    """[7] see STOP_LINE: the next one on the ego's lane and those that follow it."""
    node, distance = stop_ahead(route, state.node, state.s, FAR_M)
    if distance >= FAR_M:
        return np.array([0.0, FAR_M, 0.0, 0.0, 0.0, 0.0, LATER_S])
    signal = int(route.signal[node])
    if signal < 0:
        return np.array([1.0, distance, 0.0, 0.0, 0.0, 1.0, LATER_S])
    shows = signals.state[signals.offset[signal] + int(route.link[node])]
    # up to the last phase before the signal shows something else
    until = signals.until[signal][: int(np.argmax(shows != shows[0])) or len(shows)]
    after_stop = shows[0] == AFTER_STOP
    colours = (shows[0] == GREEN, shows[0] == YELLOW, shows[0] == RED or after_stop)
    return np.array([1.0, distance, *colours, after_stop, min(float(until[-1]), LATER_S)])


def _seen_from(scene: Scene, x: Floats | float, y: Floats | float) -> tuple[Floats, Floats]:
    """Coordinates ahead and to the left of the ego's centre, m."""
    dx, dy = np.asarray(x) - scene.ego.x, np.asarray(y) - scene.ego.y
    c, n = math.cos(scene.ego.heading), math.sin(scene.ego.heading)
    return dx * c + dy * n, dy * c - dx * n
