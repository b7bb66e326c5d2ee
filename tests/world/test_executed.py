"""The predicted ego is the executed ego: what a Plan says of the end of each decision period is what SUMO then reports."""

import math
from typing import Any

import numpy as np
import pytest

from sumo_mcts import driver
from sumo_mcts.assets import scenario_path
from sumo_mcts.config import ScenarioConfig, load
from sumo_mcts.episode import EpisodeResult, run_episode
from sumo_mcts.model.ego import FREE, advance, begin_change, can_change, pose_of
from sumo_mcts.model.local import build_local
from sumo_mcts.planners.base import Situation, Task
from sumo_mcts.scene import Decision, Follow, Plan

STRAIGHT, CROSSING = "straight-line", "unprotected-left-turn"
STEPS = [0.05, 0.1, 0.25, 0.5, 1.0]


class Erratic:
    """Does anything that it may, looks at nobody, and says beforehand what will come of it."""

    needs_forecast = False

    def start(self, task: Task, seed: int) -> None:
        """Take the ego over."""
        self._task, self._rng = task, np.random.default_rng(seed)

    def plan(self, situation: Situation) -> Decision:
        """A second of something."""
        task, state = self._task, situation.state
        local = build_local(task.road, task.route, state, situation.scene, situation.forecast, 0, situation.cleared, 3.0)
        needed = int(np.sign(task.route.changes[state.node]))
        side = needed if needed and self._rng.random() < 0.8 else int(self._rng.integers(-1, 2))
        side = side if side and can_change(local, task.ego, state, side) else 0
        state = begin_change(local, task.ego, state, side) if side else state
        accel = float(self._rng.choice([-8.0, -3.0, -1.0, 0.0, 1.0, 2.6, 2.6]))
        states, events = [], []
        for k in range(max(1, round(1.0 / task.ego.step))):
            state, event = advance(local, task.ego, state, accel, k * task.ego.step)
            states.append(state)
            events.append(event)
        plan = Plan(
            (np.arange(len(states)) + 1.0) * task.ego.step,
            np.array([s.v for s in states]),
            np.array([task.route.lane[s.node] for s in states], np.int32),
            np.array([s.s for s in states]),
            np.array([pose_of(local.node, local.row, s, 0.0) for s in states]),
        )
        over = next((k for k, event in enumerate(events) if event != FREE), len(events))
        return Decision(Follow(plan.v, side), Plan(*(field[:over] for field in plan)), (), -1, "erratic", 0, 0)


def alone(name: str, step: float, change_s: float = 3.0, ballistic: bool = False) -> ScenarioConfig:
    """A built-in scene with nobody but the ego."""
    config = load(scenario_path(name))
    options = {"lanechange.duration": change_s, "step-method.ballistic": ballistic}
    return config.model_copy(
        update={
            "sumo": config.sumo.model_copy(update={"step_length_s": step, "options": options}),
            "traffic": config.traffic.model_copy(update={"actors": tuple(a for a in config.traffic.actors if a.id == "ego")}),
            "episode": config.episode.model_copy(update={"time_limit_s": 200.0}),
        }
    )


def differences(result: EpisodeResult) -> tuple[list[dict[str, Any]], int]:
    """Where the ego was at the end of each period that its plan covers, less where the plan had it; and the number of lanes it changed to."""
    (trace,) = result.traces
    found, flips = [], 0
    for before, after in zip(trace.cycles, trace.cycles[1:], strict=False):
        plan = before.decision.plan
        k = round((after.time - before.time) / before.step) - 1
        if plan is None or len(plan.v) <= k:
            continue
        flips += before.decision.command.lane_change != 0
        x, y, c, n = plan.pose[k]
        turned = math.degrees(abs(math.remainder(math.atan2(n, c) - after.ego.heading, math.tau)))
        place = {"time": after.time, "lanes": (int(plan.lane[k]), after.ego.lane), "changing": after.ego.changing}
        found.append({**place, "s": after.ego.s - plan.s[k], "v": after.ego.v - plan.v[k], "aside": math.dist((x, y), (after.ego.x, after.ego.y)), "turned": turned})
    return found, flips
