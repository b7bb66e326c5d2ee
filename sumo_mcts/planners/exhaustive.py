"""The planner that drives by the reference problem: what near-optimality is measured against, in
the closed loop."""

from collections.abc import Mapping
from typing import Any

from sumo_mcts.arrays import Floats
from sumo_mcts.config import ScenarioConfig
from sumo_mcts.planners import reference
from sumo_mcts.planners.actions import SIDE
from sumo_mcts.planners.base import Situation, Task
from sumo_mcts.planners.candidates import follow_line
from sumo_mcts.planners.reference import Problem, problem_of, root_lines, steps_of
from sumo_mcts.planners.reference_solver import Solution, best_root, solve
from sumo_mcts.scene import Decision, Follow, Plan, RootChild


def forecast_s(scenario: ScenarioConfig, step: float, forecast_step: float) -> float:
    """How long a forecast the reference problem needs, with states `forecast_step` apart, s."""
    return reference.forecast_s(forecast_step)


def make(_: Mapping[str, Any], scenario: ScenarioConfig) -> "ExhaustivePlanner":
    """The planner, whatever the scenario."""
    return ExhaustivePlanner()


class ExhaustivePlanner:
    """Takes the beginning that the solution of the newest reference problem prefers; costs, actions
    and horizon are that problem's, whatever is configured."""

    needs_forecast = True

    def start(self, task: Task, seed: int) -> None:
        """Take the ego over."""
        self._task = task

    def plan(self, situation: Situation) -> Decision:
        """Solve the reference problem; where every sequence ends in a loss the cheapest one is
        driven."""
        problem = problem_of(self._task, situation)
        lines = root_lines(problem)
        found = solve(problem, lines)
        driven = [_driven(problem, found, lines, i) for i in range(len(lines))]
        chosen = best_root(found)
        plan, child = driven[chosen]
        reason = "brake" if found.collides[chosen] else "exhaustive"
        return Decision(
            Follow(plan.v, child.lane_change),
            plan,
            tuple(child for _, child in driven),
            chosen,
            reason,
            0,
            0,
        )


def _driven(problem: Problem, found: Solution, lines: Floats, i: int) -> tuple[Plan, RootChild]:
    """The best sequence with the i-th beginning, step by step, and what it costs."""
    plan, terms, _ = follow_line(
        problem.local,
        problem.task,
        problem.q,
        problem.state,
        problem.others,
        steps_of(problem, lines[i], found.best[i]),
    )
    steps, value = min(int(problem.ends[0]), len(plan.v)), float(found.value[i])
    accel = float((plan.v[steps - 1] - problem.state.v) / plan.time[steps - 1])
    return plan, RootChild(accel, int(problem.roots[i, SIDE]), 0, value, value, terms, plan.pose)
