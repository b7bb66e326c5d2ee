"""What every planner is given, and what it has to return."""

import math
from typing import NamedTuple, Protocol

import numpy as np

from sumo_mcts.model.cost import CostParams
from sumo_mcts.model.ego import EgoParams
from sumo_mcts.model.local import Local, State, build_local
from sumo_mcts.model.route import RouteMap
from sumo_mcts.scene import Decision, Forecast, RoadMap, Scene

STOP_DECEL = 3.0  # m/s2 beyond which nobody has to stop for yellow (measures: yellow_run)


class Task(NamedTuple):
    """What a planner gets once, when it takes the ego over (and again when the ego's route changes)."""

    road: RoadMap
    route: RouteMap
    ego: EgoParams
    cost: CostParams


class Situation(NamedTuple):
    """What a planner gets each cycle."""

    scene: Scene
    state: State
    forecast: Forecast
    cleared: frozenset[int]  # route nodes at whose stop sign the ego has stood
    until: float = math.inf  # time.perf_counter() at which a search has to end; inf: iterations count


def local_of(task: Task, situation: Situation, reactive: int = 0, hypothesis: int = 0) -> Local:
    """What one cycle's search reads, in one hypothesis (0 the likeliest) of the forecast; it may move at most `reactive` agents."""
    return build_local(
        task.road, task.route, situation.state, situation.scene, situation.forecast, hypothesis, situation.cleared, STOP_DECEL, task.cost.claim_s,
        reactive,
    )  # fmt: skip


class Planner(Protocol):
    """From a situation to a decision. One object drives one ego for one episode."""

    needs_forecast: bool

    def start(self, task: Task, seed: int) -> None:
        """Take the ego over."""

    def plan(self, situation: Situation) -> Decision:
        """Decide for the coming decision period."""


class Drawing:
    """What the planners have in common that look into a forecast and draw."""

    needs_forecast = True

    def start(self, task: Task, seed: int) -> None:
        """Take the ego over."""
        self._task = task
        self._rng = np.random.Generator(np.random.PCG64(seed))
