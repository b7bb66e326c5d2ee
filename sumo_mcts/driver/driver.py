"""The planner loop of one ego: observe, predict, plan, check, once a decision period.

Predictor, planner and fail-safe are put together here and nowhere else.
"""

from typing import NamedTuple

import numpy as np

from sumo_mcts.config import ScenarioConfig
from sumo_mcts.driver.change_progress import about_to_change
from sumo_mcts.driver.factories import make_planner
from sumo_mcts.driver.forecaster import Cycle, Forecaster, LastDecision, ego_lanes
from sumo_mcts.driver.params import (
    Physics,
    assumed,
    cost_params,
    deadline_s,
    overtakes,
    sight,
    time_budget_s,
)
from sumo_mcts.driver.reasons import Reasons
from sumo_mcts.driver.route_keeper import Kept, RouteKeeper
from sumo_mcts.driver.stops import without_stop
from sumo_mcts.errors import in_one_line
from sumo_mcts.model.local_map import State
from sumo_mcts.model.sideways import own_path, shifted
from sumo_mcts.numerics.kernel import Stopwatch
from sumo_mcts.planners.base import Planner, Remembering, Situation, Task
from sumo_mcts.planners.budget import Timekeeper
from sumo_mcts.planners.failsafe import FailSafe
from sumo_mcts.planners.validity import why_invalid
from sumo_mcts.prediction.interface import OracleRecorder, Oracles
from sumo_mcts.road import RoadChanges, RoadMap
from sumo_mcts.scene import (
    Answers,
    Decision,
    EgoState,
    Follow,
    Forecast,
    Memory,
    PlannerMemory,
    Release,
    Scene,
)


class PlannerError(Exception):
    """The planner does not start, or planner or predictor failed too often in a row; the message
    is that of the last failure."""


class PlanningResult(NamedTuple):
    """One decision, and what it rests on."""

    decision: Decision
    forecast: Forecast | None
    plan_ms: float  # without the time in which kernels were compiled or loaded
    # a fail-safe manoeuvre replaces the planner's decision; decision.reason says why
    intervened: bool = False
    memory: Memory = Memory()  # of earlier decisions, on which this one rests
    answers: Answers = Answers()  # of oracles


class Driver:
    """Plans for one ego."""

    def __init__(
        self,
        config: ScenarioConfig,
        road: RoadMap,
        physics: Physics,
        seed: int,
        oracles: Oracles | None = None,
        planner: Planner | None = None,
    ) -> None:
        """`planner`: in place of the one that the scenario names.

        Raises ConfigError where a plugin cannot be made.
        """
        self._config, self._seed = config, seed
        may_overtake = planner is None and overtakes(config)
        self._keeper = RouteKeeper(config, road, physics, may_overtake)
        self._oracles = OracleRecorder(oracles)
        self._planner = make_planner(config) if planner is None else planner
        self._cost = cost_params(config)
        self._forecaster = Forecaster(config, road, physics, self._oracles.oracles())
        self._period = max(1, round(config.planner.period_s / physics.step)) * physics.step
        self._fail_safe = FailSafe(assumed(config), self._period)
        self._timekeeper = Timekeeper(time_budget_s(config))
        self._reasons = Reasons()
        self._failures = 0  # of planner and predictor, in a row
        self._last = LastDecision()
        # what the planner was asked last; None where the ego is not on its route
        self.question: tuple[Task, Situation] | None = None

    def decide(self, scene: Scene) -> PlanningResult:
        """Observe, predict, plan, check.

        Raises PlannerError where the planner failed too often in a row.
        """
        watch = Stopwatch()
        until = self._timekeeper.until(watch.began)
        memory = self._memory()
        self._oracles.forget()
        if scene.ego.held:
            return self._held(scene, memory, watch)
        placed = self.placed(scene)
        if placed is None:
            return self._released(memory, watch, "not on its route: SUMO drives")
        task, state = placed
        self._keeper.note_stand(task.route, state, scene)
        forecast, failure = (
            self._foresee(scene, state)
            if self._planner.needs_forecast or self._config.failsafe.on
            else (None, "")
        )
        situation = Situation(
            scene=scene,
            state=state,
            forecast=self._forecaster.nothing() if forecast is None else forecast,
            cleared=frozenset(self._keeper.stood),
            until=until + watch.loading_s,
            path=own_path(task.road, task.route, state, scene),
        )
        self.question = (task, situation)
        decision, why = self._plan(situation, failure)
        why = why or self._objection(situation, decision, watch.seconds * 1000.0)
        if why:
            if forecast is None:
                situation = situation._replace(forecast=self._foresee(scene, state)[0])
            decision = self._fail_safe.fall_back(situation, why, decision)
        assert decision is not None, "whatever fails has a reason"
        if scene.ego.stop == self._keeper.missed:
            decision = without_stop(decision)
        if situation.path is not None and not why:
            decision = shifted(decision, situation.path)
        self._last = LastDecision(decision.plan, decision.command, scene.time)
        self._timekeeper.note(until, watch.began + watch.seconds)
        return PlanningResult(
            decision=decision,
            forecast=forecast,
            plan_ms=watch.seconds * 1000.0,
            intervened=why != "",
            memory=memory,
            answers=self._oracles.answers(scene.agents.ids),
        )

    def placed(self, scene: Scene) -> tuple[Task, State] | None:
        """The task, and where the ego is on its route; None where it is not on it.

        The route is laid out again where SUMO changed it, the road or the vehicle.
        """
        kept = self._keeper.keep(scene)
        self._forecaster.follow(self._keeper.road)
        if kept is Kept.OTHER:
            self._start(scene.ego)
        elif kept is Kept.RENEWED:
            before = self._memory()
            self._start(scene.ego)
            self._go_on(before)
        state = self._keeper.state(scene.ego)
        return None if state is None else (self._task, state)

    def forecast(self, scene: Scene, name: str, seconds: float) -> Forecast | None:
        """What the predictor `name` (built-in, or the scenario's) says right after a decision,
        given its plan; None where the ego is not on its route.

        Raises what a plugin raises, and ValueError where its answer is no forecast.
        """
        state = self._keeper.state(scene.ego)
        if state is None:
            return None
        state = about_to_change(self._task.route, state, self._last.command)
        return self._forecaster.ask(name, self._cycle(scene, state), seconds)

    def recall(
        self,
        ego: EgoState,
        changes: RoadChanges,
        memory: Memory,
        last: Decision | None,
        when: float,
    ) -> None:
        """Go on after the decision `last`, taken at the time `when` (s), as if all earlier ones had
        been taken here; `ego` and the `changes` of the map as they were then."""
        self._failures = memory.failures
        self._reasons.seen = dict(zip(memory.held_up, memory.held_up_at, strict=True))
        self._keeper.recall(ego, changes, memory)
        self._forecaster.follow(self._keeper.road)
        if last is not None:
            self._last = LastDecision(last.plan, last.command, when)
        if memory.edges:
            self._start(ego)
            self._go_on(memory)

    def _memory(self) -> Memory:
        """What the next decision depends on, beside its scene and the last decision."""
        planner, keeper = self._planner, self._keeper
        found = Memory(
            failures=self._failures,
            held_up=tuple(self._reasons.seen),
            held_up_at=tuple(self._reasons.seen.values()),
        )
        if keeper.route is None:
            return found
        return found._replace(
            edges=keeper.edges,
            stood=tuple(keeper.stood),
            stood_since=tuple(keeper.stood.values()),
            stop=keeper.stop,
            ready=self._fail_safe.ready,
            planner=planner.memory() if isinstance(planner, Remembering) else PlannerMemory(),
        )

    # --- a cycle ---

    def _released(self, memory: Memory, watch: Stopwatch, why: str) -> PlanningResult:
        """SUMO drives an ego that is not on its route, or parked off the road."""
        self.question = None
        self._last = self._last._replace(plan=None, command=Release())
        self._fail_safe.forget()
        decision = Decision(Release(), None, (), -1, why, 0, 0)
        return PlanningResult(decision, None, watch.seconds * 1000.0, memory=memory)

    def _held(self, scene: Scene, memory: Memory, watch: Stopwatch) -> PlanningResult:
        """The ego stands at a stop until SUMO lets it go."""
        if scene.ego.lane < 0 or isinstance(self._last.command, Release):
            return self._released(memory, watch, "at a stop: SUMO drives")
        self.question = None
        self._fail_safe.forget()
        stand = Follow(np.zeros(max(1, round(self._period / scene.step))), 0)
        self._last = LastDecision(None, stand, scene.time)
        decision = Decision(stand, None, (), -1, "stands at a stop", 0, 0)
        return PlanningResult(decision, None, watch.seconds * 1000.0, memory=memory)

    def _foresee(self, scene: Scene, state: State) -> tuple[Forecast, str]:
        """The forecast, and why it is not the scenario's predictor's (a plugin failed)."""
        weighs = getattr(self._planner, "weighs_hypotheses", False)
        most = self._config.prediction.hypotheses if weighs else 1
        return self._forecaster.foresee(self._cycle(scene, state), most)

    def _cycle(self, scene: Scene, state: State) -> Cycle:
        stood_s = self._keeper.stood_s(state, scene.time)
        patience_s = self._config.prediction.stays_after_s
        held_up = self._reasons.lately(self._keeper.road, scene, patience_s)
        return Cycle(scene, ego_lanes(self._task.route, state), self._last, stood_s, held_up)

    def _plan(self, situation: Situation, failure: str) -> tuple[Decision | None, str]:
        """The planner's decision and "", or None and why there is none.

        `failure`: of the predictor, on whose forecast nothing is planned.
        """
        decision, why, failed = None, failure, "predictor"
        if not failure:
            failed = "planner"
            try:
                decision = self._planner.plan(situation)
                why = why_invalid(self._task, situation, decision)
            except Exception as error:  # whatever a planner may do
                why = f"{type(error).__name__}: {error}"
        self._failures = self._failures + 1 if why else 0
        if self._failures > self._config.failsafe.most_failures:
            raise PlannerError(why)
        return (None, f"the {failed} failed: {why}") if why else (decision, "")

    def _objection(self, situation: Situation, decision: Decision | None, ms: float) -> str:
        """Why a decision that took `ms` must not be executed; "" where it may."""
        deadline = deadline_s(self._config, self._period) * 1000.0
        if self._config.planner.enforce_deadline and ms > deadline:
            return f"late: {ms:.0f} ms of {deadline:.0f} ms"
        if (
            self._config.failsafe.on
            and decision is not None
            and isinstance(decision.command, Follow)
        ):
            return self._fail_safe.objection(situation, decision.command)
        self._fail_safe.forget()
        return ""

    # --- along which route ---

    def _start(self, ego: EgoState) -> None:
        """Start planner and fail-safe on the route. Raises PlannerError."""
        keeper = self._keeper
        assert keeper.route is not None, "it has just been laid out"
        self._task = Task(
            keeper.road, keeper.route, keeper.params(ego), self._cost, sight(self._config)
        )
        self._fail_safe.start(self._task)
        try:
            self._planner.start(self._task, self._seed)
        except Exception as error:  # whatever a planner may do
            raise PlannerError(
                f"planner {self._config.planner.name} does not start: {in_one_line(error)}"
            ) from error

    def _go_on(self, memory: Memory) -> None:
        """Planner and fail-safe remember this."""
        self._fail_safe.ready = memory.ready
        remembers = len(memory.planner.numbers) + len(memory.planner.generator) > 0
        if isinstance(self._planner, Remembering) and remembers:
            self._planner.recall(memory.planner)
