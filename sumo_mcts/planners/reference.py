"""The reference problem that near-optimality is measured against (docs/measures.md).

The numbers in this file are frozen: they say what is compared, not what is best, and follow no
configuration. Regrets of different numbers cannot be compared; `digest` shows a change of one of
them. What the planner came to minimise later makes a further version, beside the old ones.
reference_solver.py solves the problem.
"""

import hashlib
import json
import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats, Indices
from sumo_mcts.model.cost import step_comfort
from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.model.local_map import LocalMap, State
from sumo_mcts.model.reactions import undisturbed
from sumo_mcts.planners.actions import ACCEL, FOLLOW, SIDE, commanded, lasting, to_steps
from sumo_mcts.planners.base import Situation, Task, local_of
from sumo_mcts.planners.ply import SearchParams, may_change, search_params
from sumo_mcts.scene import Follow

# by the names of when they were frozen, which the digest is of too
_COST = {
    "contact": 60.0, "speed_at_contact": 1.0, "headway_s": 1.2, "headway_gap": 2.0, "headway": 1.5,
    "claim_s": 1.6, "claim": 16.0, "acceleration": 0.02, "jerk": 0.005, "braking": 0.5,
    "progress": 1.0, "tail_s": 8.0, "blocking": 0.3, "astride": 4.0, "route": 2.0,
    "lane_change": 0.6, "red": 100.0, "cut_in_decel": 3.0, "imposed": 2.0,
}  # fmt: skip
_NOW = {"headway_gap": "headway_gap_m", "cut_in_decel": "cut_in_decel_mps2"}
KEEPING = (FOLLOW, -8.0, -4.5, -3.0, -2.0, -1.0, 0.0, 1.0, 2.6)  # accelerations in the lane, m/s2
CHANGING = (-1.5, 0.0, 1.5)  # accelerations that begin a lane change to the left or right, m/s2
# when one action ends and the next begins, s
ENDS_S = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0)
CHECK_S = 0.2  # s between collision checks
SCALE_DECEL = 4.0  # m/s2: a second of it is the scale of regret

LABELS = 200  # that are kept for each beginning and ply
# m, m/s, m/s2, progress; of agents that react: forecast times, m/s. Labels in a cell count as one
CELL = (0.25, 0.25, 0.5, 0.05, 0.5, 0.5)
# m, m/s: labels that are nearer together are of one kind, of which the best come first
KIND = (5.0, 1.0)


class Version(NamedTuple):
    """The numbers in which the versions of the problem differ."""

    weights: dict[str, float]  # of the terms of J; those that are not named are 0
    reactive: int  # agents that react inside the search


_WAITING = {**_COST, "beyond_s": 30.0}
VERSIONS = {
    "1": Version(_COST, 8),
    "2": Version(_WAITING, 8),  # waiting beyond the horizon costs what it costs planner `mcts`
    "2-forecast": Version(_WAITING, 0),  # the agents drive as forecast, as they do for `mcts`
}
NEWEST = "2"


class Problem(NamedTuple):
    """The reference problem in one state. P plies, A actions, B of them can begin now."""

    task: Task  # with the frozen cost
    local: LocalMap
    state: State
    others: Floats  # [R, 2] the agents that react, as they are now
    q: SearchParams
    ends: Indices  # [P] steps of the simulation at which plies end
    actions: Floats  # [A, 2] acceleration, lane change
    roots: Floats  # [B, 2]


def cost_of(version: str) -> CostParams:
    """The frozen costs."""
    weights = VERSIONS[version].weights
    return CostParams(**{_NOW.get(name, name): value for name, value in weights.items()})


def digest(version: str) -> str:
    """SHA-256 of all numbers above: what regrets depend on beside the model."""
    weights, reactive = VERSIONS[version]
    numbers = (
        weights, KEEPING, CHANGING, ENDS_S, CHECK_S, reactive, SCALE_DECEL, LABELS, CELL, KIND,
    )  # fmt: skip
    return hashlib.sha256(json.dumps(numbers).encode()).hexdigest()


def forecast_s(forecast_dt: float) -> float:
    """How long a forecast the reference needs, with states `forecast_dt` apart, s."""
    return ENDS_S[-1] + _COST["claim_s"] + forecast_dt


def scale(task: Task) -> float:
    """What a second of braking with SCALE_DECEL costs: the unit of regret. `task`: a problem's."""
    braking = State(0, 0.0, 10.0, -SCALE_DECEL, 0.0, -1, 0.0)
    return step_comfort(task.ego, task.cost, braking, braking) / task.ego.step


def problem_of(task: Task, situation: Situation, version: str = NEWEST) -> Problem:
    """The reference problem in a situation: how the ego can move is the task's own, all else is
    frozen."""
    cost, reactive, state = cost_of(version), VERSIONS[version].reactive, situation.state
    ego = task.ego._replace(headway=cost.headway_s, gap=cost.headway_gap_m)
    task = task._replace(ego=ego, cost=cost)
    local = local_of(task, situation, reactive)
    ends = np.unique([max(1, math.floor(end / ego.step + 0.5)) for end in ENDS_S])
    q = search_params(ego.step, local.dt, ENDS_S[0], CHECK_S, len(ends), 0, 0.0, False)._replace(
        horizon=float(ends[-1]) * ego.step
    )
    actions = np.array(
        [(accel, 0.0) for accel in KEEPING]
        + [(accel, side) for side in (1.0, -1.0) for accel in CHANGING]
    )
    possible = [
        side == 0.0 or may_change(local, ego, cost, state, np.zeros((0, 2)), int(side), accel, 0.0)
        for accel, side in actions
    ]
    return Problem(
        task, local, state, undisturbed(local, reactive), q, ends, actions, actions[possible]
    )


def root_lines(problem: Problem) -> Floats:
    """[B, K, 3] the actions that can begin now, each with one row for each step of the first
    ply."""
    steps = int(problem.ends[0])
    return np.array([lasting(root[ACCEL], int(root[SIDE]), steps) for root in problem.roots])


def profile_line(problem: Problem, command: Follow) -> Floats:
    """[K, 3] the commanded speeds of the first ply, whatever they are; a profile that is too short
    keeps its last speed."""
    steps = int(problem.ends[0])
    missing = np.full(max(0, steps - len(command.speeds)), command.speeds[-1])
    return commanded(np.append(command.speeds[:steps], missing), command.lane_change)


def steps_of(problem: Problem, line: Floats, best: Floats) -> Floats:
    """A beginning [K, 3] and its continuation [P, 3] as one row for each step of the simulation.

    It ends where the continuation does.
    """
    over = np.isnan(best[1:, ACCEL])
    plies = int(np.argmax(over)) if over.any() else len(over)
    later = to_steps(best[1 : plies + 1], np.diff(problem.ends)[:plies])
    return np.concatenate([line, later])
