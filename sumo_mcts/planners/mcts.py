"""The planner that people should use: UCT on a deterministic forecast, best-value backup, informed rollouts, braking when nothing is free."""

import math
import time
from typing import NamedTuple

import numpy as np

from sumo_mcts.model.ego import FOLLOW
from sumo_mcts.model.local import Local, State, build_local
from sumo_mcts.planners.base import Situation, Task
from sumo_mcts.planners.tree import ALIVE, SearchParams, Tree, new_tree, replay, search, search_params
from sumo_mcts.scene import Decision, Floats, Follow, Plan, RootChild

STOP_DECEL = 3.0  # m/s2 beyond which nobody has to stop for yellow (measures: yellow_run)
SLICE = 20_000  # passes after which an interrupt from the keyboard is heard
TIMED_SLICE = 100  # passes between looks at the clock


class MctsParams(NamedTuple):
    """See config.PlannerConfig."""

    iterations: int
    time_budget_s: float  # inf: none
    period_s: float
    step_s: float
    look_ahead_steps: int
    rollout_steps: int
    check_s: float
    accelerations: tuple[float, ...]
    lane_change_accelerations: tuple[float, ...]
    exploration: float


class MctsPlanner:
    """Monte-Carlo tree search over the forecast."""

    needs_forecast = True

    def __init__(self, params: MctsParams) -> None:
        self._params = params
        self._actions = root_actions(params.accelerations, params.lane_change_accelerations)

    def start(self, task: Task, seed: int) -> None:
        """Take the ego over."""
        self._task = task
        self._rng = np.random.Generator(np.random.PCG64(seed))

    def plan(self, situation: Situation) -> Decision:
        """Search from the present state."""
        p, task = self._params, self._task
        local = build_local(task.road, task.route, situation.state, situation.scene, situation.forecast, 0, situation.cleared, STOP_DECEL)
        q = search_params(task.ego.step, local.dt, p.step_s, p.check_s, p.look_ahead_steps, p.rollout_steps, p.exploration)
        tree = new_tree(p.iterations + 2, len(self._actions), p.look_ahead_steps + p.rollout_steps)
        done = known = 0
        timed = p.time_budget_s < math.inf
        end = time.perf_counter() + p.time_budget_s
        while done + known < p.iterations and not tree.dead[0] and (not timed or time.perf_counter() < end):
            count = min(TIMED_SLICE if timed else SLICE, p.iterations - done - known)
            more = search(tree, local, task.ego, task.cost, q, self._actions, situation.state, count, self._rng)
            done, known = done + more[0], known + more[1]
        children = _children(tree, local, task, q, self._actions, situation.state)
        chosen = min(range(len(children)), key=lambda i: children[i][0].best)
        child, plan = children[chosen]
        return Decision(
            Follow(plan.v, child.lane_change), plan, tuple(c for c, _ in children), chosen, "search" if child.terms[4] == 0.0 else "brake", done, known
        )


def root_actions(accelerations: tuple[float, ...], lane_change_accelerations: tuple[float, ...]) -> Floats:
    """[A, 2] acceleration and lane change: car following first, then the given ones, then the changes."""
    keep = [(FOLLOW, 0.0), *((a, 0.0) for a in accelerations)]
    return np.array(keep + [(a, side) for side in (1.0, -1.0) for a in lane_change_accelerations])


def _children(tree: Tree, local: Local, task: Task, q: SearchParams, actions: Floats, state: State) -> list[tuple[RootChild, Plan]]:
    """The root's children and the best plan through each of them."""
    result = []
    for k in range(len(actions)):
        i = int(tree.child[0, k])
        if i < 0:
            continue
        line = _tidy(tree.plan[k], actions[k], int(tree.end[i]))
        plan, terms = follow_line(local, task, q, state, line)
        accel = float(actions[k, 0]) if actions[k, 0] != FOLLOW else _first_accel(plan, state.v, q.ply * task.ego.step)
        child = RootChild(accel, int(actions[k, 1]), int(tree.visits[i]), float(tree.total[i] / max(tree.visits[i], 1)), float(tree.best[i]), terms, plan.pose)
        result.append((child, plan))
    return result


def _first_accel(plan: Plan, v: float, seconds: float) -> float:
    """Mean acceleration (m/s2) of a plan's first action: what car following came to."""
    steps = min(len(plan.v), int(np.searchsorted(plan.time, seconds - 1e-9)) + 1)
    return float((plan.v[steps - 1] - v) / plan.time[steps - 1]) if steps else 0.0


def _tidy(line: Floats, action: Floats, end: int) -> Floats:
    """A sequence that certainly starts with its own action."""
    line = line.copy()
    line[0] = action[0] + 1000.0 * action[1]
    if end != ALIVE:
        line[1:] = np.nan
    return line


def follow_line(local: Local, task: Task, q: SearchParams, state: State, line: Floats) -> tuple[Plan, Floats]:
    """The plan, step by step, and the cost terms [5] of a sequence of actions."""
    steps = len(line) * q.ply
    nodes, motion, pose, terms = np.zeros(steps, np.int64), np.zeros((steps, 2)), np.zeros((steps, 4)), np.zeros(5)
    used = replay(local, task.ego, task.cost, q, state, line, nodes, motion, pose, terms)
    lanes = task.route.lane[nodes[:used]].astype(np.int32)
    times = (np.arange(used, dtype=np.float64) + 1.0) * task.ego.step
    return Plan(times, motion[:used, 1].copy(), lanes, motion[:used, 0].copy(), pose[:used].copy()), terms
