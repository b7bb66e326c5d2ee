"""Keeps what one ego's driver planned, cycle by cycle, for its row and its trace."""

import math
from itertools import pairwise
from typing import Any

import numpy as np

from sumo_mcts.config import ScenarioConfig
from sumo_mcts.driver.driver import PlanningResult
from sumo_mcts.driver.forecaster import no_forecast
from sumo_mcts.driver.params import deadline_s
from sumo_mcts.driver.stops import given_up
from sumo_mcts.episode.surroundings import lanes_around
from sumo_mcts.model.route import is_rest_of
from sumo_mcts.records import CycleRecord, Setting, Trace
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Plan, Scene

DRAWN = 90.0  # m around the ego's trajectory within which lanes go into the trace
SPEED_DEVIATION = 0.05  # m/s between commanded and executed speed that is noted
FIRM = 0.5  # m/s2 beyond which a plan counts as accelerating or braking


class Recorder:
    """Collects the cycles of one ego."""

    def __init__(self) -> None:
        self._scenes: list[Scene] = []
        self._planned: list[PlanningResult] = []

    def note(self, scene: Scene, planned: PlanningResult) -> None:
        """Add a cycle."""
        self._scenes.append(scene)
        self._planned.append(planned)

    def planning(self, config: ScenarioConfig, period: float) -> dict[str, Any]:
        """The keys of a row about decisions; `period` in s."""
        decisions = [planned.decision for planned in self._planned]
        times = np.array([planned.plan_ms for planned in self._planned])
        deadline = deadline_s(config, period)
        searched = any(decision.iterations or decision.known for decision in decisions)
        detours = [
            f"{scene.time:.1f} s: {text}"
            for scene, planned in zip(self._scenes, self._planned, strict=True)
            for text in (scene.ego.detour, given_up(planned.decision))
            if text
        ]
        return {
            "reroutes": self._scenes[-1].ego.reroutes if self._scenes else 0,
            "detours": "; ".join(detours) or None,
            "decision_flips": _flips([decision.plan for decision in decisions]),
            "failsafe_interventions": sum(planned.intervened for planned in self._planned),
            "iterations_per_decision": config.planner.iterations
            if searched and config.planner.time_budget_ms is None
            else None,
            "iterations": sum(int(decision.iterations) for decision in decisions),
            "cycles": len(decisions),
            "deadline_s": deadline,
            "deadline_misses": int((times > deadline * 1000.0).sum()),
            **{
                f"plan_ms_{name}": _percentile(times, q)
                for name, q in (("p50", 50), ("p95", 95), ("p99", 99), ("max", 100))
            },
        }

    def simulated(self, period: float) -> float:
        """Seconds of simulation that the decisions cover."""
        return self._scenes[-1].time - self._scenes[0].time + period if self._scenes else 0.0

    def trace(
        self, key: str, scenario: str, outcome: str, road: RoadMap, setting: Setting
    ) -> Trace | None:
        """All cycles with the roads around them; None without any."""
        if not self._scenes:
            return None
        where = np.array([[scene.ego.x, scene.ego.y] for scene in self._scenes])
        following = [*self._scenes[1:], None]
        cycles = tuple(
            _cycle(*cycle) for cycle in zip(self._scenes, self._planned, following, strict=True)
        )
        return Trace(
            key,
            scenario,
            outcome,
            lanes_around(road, _routes(self._scenes), where, DRAWN),
            cycles,
            setting,
        )


def _routes(scenes: list[Scene]) -> list[tuple[int, ...]]:
    """The routes that the ego had, one after the other."""
    routes = [scenes[0].ego.route]
    for scene in scenes:
        if scene.ego.route and not is_rest_of(scene.ego.route, routes[-1]):
            routes.append(scene.ego.route)
    return routes


def _cycle(scene: Scene, planned: PlanningResult, after: Scene | None) -> CycleRecord:
    """One cycle, and what came of it by the next one."""
    decision = planned.decision
    speed, lane = _commanded(decision.plan, scene, after)
    forecast = planned.forecast if planned.forecast is not None else no_forecast(scene.step)
    true_speed, true_lane = (math.nan, -1) if after is None else (after.ego.v, after.ego.lane)
    return CycleRecord(
        time=scene.time,
        step=scene.step,
        ego=scene.ego,
        agents=scene.agents,
        signals=scene.signals,
        forecast=forecast,
        decision=decision,
        plan_ms=planned.plan_ms,
        commanded_speed=speed,
        executed_speed=true_speed,
        commanded_lane=lane,
        executed_lane=true_lane,
        deviation=_deviation(speed, lane, true_speed, true_lane),
        intervened=planned.intervened,
        memory=planned.memory,
        answers=planned.answers,
        changes=scene.changes,
    )


def _commanded(plan: Plan | None, scene: Scene, after: Scene | None) -> tuple[float, int]:
    """Speed, m/s, and lane that the plan has for the time of the next cycle; nan and -1 without a
    plan or a next cycle."""
    if plan is None or after is None or not len(plan.v):
        return math.nan, -1
    k = min(round((after.time - scene.time) / scene.step) - 1, len(plan.v) - 1)
    return float(plan.v[k]), int(plan.lane[k])


def _deviation(speed: float, lane: int, executed_speed: float, executed_lane: int) -> str:
    """How SUMO differs from the plan, in words; "" where it does not, or either is
    unknown (nan)."""
    if math.isnan(speed) or math.isnan(executed_speed):
        return ""
    if abs(speed - executed_speed) > SPEED_DEVIATION:
        return f"speed {executed_speed:.2f} instead of {speed:.2f} m/s"
    return "SUMO has the ego on another lane" if lane != executed_lane else ""


def _flips(plans: list[Plan | None]) -> int:
    """How often the plan of the coming second turned from accelerating to braking or back."""
    signs = [
        sign for plan in plans if plan is not None and len(plan.v) > 1 and (sign := _tendency(plan))
    ]
    return sum(before != now for before, now in pairwise(signs))


def _tendency(plan: Plan) -> int:
    """+1 where the plan gains speed within a second, -1 where it loses some, 0 in between."""
    k = min(len(plan.v) - 1, int(np.searchsorted(plan.time, 1.0)))
    gained = float(plan.v[k] - plan.v[0]) / max(float(plan.time[k] - plan.time[0]), 1e-9)
    return 1 if gained > FIRM else -1 if gained < -FIRM else 0


def _percentile(times: Any, q: int) -> float | None:
    return float(np.percentile(times, q)) if len(times) else None
