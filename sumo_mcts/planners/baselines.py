"""Drivers to compare with: SUMO's own, and a blind one that shows how hard a scene is."""

import numpy as np

from sumo_mcts.planners.base import Situation, Task
from sumo_mcts.scene import Decision, Follow, Release


class SumoPlanner:
    """SUMO's own driver: the same referee, no planner. Every episode's twin."""

    needs_forecast = False

    def start(self, task: Task, seed: int) -> None:
        """Nothing to prepare."""

    def plan(self, situation: Situation) -> Decision:
        """Let SUMO drive."""
        return Decision(Release(), None, (), -1, "release", 0, 0)


class ConstantPlanner:
    """Keeps the speed it was taken over with, changes to the lanes its route needs as soon as they are there, and looks at nobody."""

    needs_forecast = False

    def __init__(self, period_s: float) -> None:
        self._period = period_s

    def start(self, task: Task, seed: int) -> None:
        """Take the ego over."""
        self._task = task
        self._speed = -1.0

    def plan(self, situation: Situation) -> Decision:
        """Hold the speed."""
        state, route = situation.state, self._task.route
        if self._speed < 0.0:
            self._speed = max(state.v, 1.0)
        side = int(np.sign(route.changes[state.node])) if state.progress == 0.0 else 0
        if (side > 0 and route.left[state.node] < 0) or (side < 0 and route.right[state.node] < 0):
            side = 0
        steps = max(1, round(self._period / self._task.ego.step))
        return Decision(Follow(np.full(2 * steps, self._speed), side), None, (), -1, "constant", 0, 0)
