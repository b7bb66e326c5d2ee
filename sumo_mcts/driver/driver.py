"""The planner loop of one ego: observe, predict, plan, check, once a decision period.

Predictor, planner and fail-safe are put together here and nowhere else.
"""

import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.config import ScenarioConfig
from sumo_mcts.driver.change_progress import about_to_change, as_seen
from sumo_mcts.driver.factories import make_planner
from sumo_mcts.driver.forecaster import Cycle, Forecaster, LastDecision, ego_lanes
from sumo_mcts.driver.params import (
    Physics,
    assumed,
    cost_params,
    deadline_s,
    ego_params,
    overtakes,
    sight,
    time_budget_s,
)
from sumo_mcts.driver.stops import NONE_MISSED, is_missed, without_stop
from sumo_mcts.errors import in_one_line
from sumo_mcts.model.caps import Pace
from sumo_mcts.model.local_map import State, ego_state
from sumo_mcts.model.route import RouteMap, eased, is_rest_of, moved_to, route_map
from sumo_mcts.numerics.kernel import Stopwatch
from sumo_mcts.numerics.lanes import usable, with_changes
from sumo_mcts.numerics.signals import shown
from sumo_mcts.planners.base import Planner, Remembering, Situation, Task
from sumo_mcts.planners.budget import Timekeeper
from sumo_mcts.planners.failsafe import FailSafe
from sumo_mcts.planners.validity import why_invalid
from sumo_mcts.prediction.interface import OracleRecorder, Oracles
from sumo_mcts.scene import (
    AFTER_STOP,
    NO_STOP,
    STANDING,
    Answers,
    Decision,
    EgoState,
    Follow,
    Forecast,
    Memory,
    PlannerMemory,
    Release,
    RoadChanges,
    RoadMap,
    Scene,
    Stop,
)

NEAR_STOP = 3.0  # m before a stop sign within which standing counts


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
        self._config, self._physics, self._seed = config, physics, seed
        self._map = self._road = road  # as it was read, and as it is now
        self._changes = RoadChanges()
        self._oracles = OracleRecorder(oracles)
        self._planner = make_planner(config) if planner is None else planner
        self._overtakes = planner is None and overtakes(config)
        self._cost = cost_params(config)
        self._forecaster = Forecaster(config, road, physics, self._oracles.oracles())
        self._period = max(1, round(config.planner.period_s / physics.step)) * physics.step
        self._fail_safe = FailSafe(assumed(config), self._period)
        self._timekeeper = Timekeeper(time_budget_s(config))
        self._failures = 0  # of planner and predictor, in a row
        # as it is driven, and without the time to brake for changes
        self._route: RouteMap | None = None
        self._plain: RouteMap | None = None
        self._edges: tuple[int, ...] = ()
        self._vehicle: tuple[float, ...] = ()  # for which the route was laid out, see _laid_for
        self._stood: dict[int, float] = {}  # node at whose stop line the ego has stood -> when
        self._stop, self._missed = NO_STOP, NONE_MISSED  # laid out for; given up last
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
        self._note_stop(task.route, state, scene)
        forecast, failure = (
            self._foresee(scene, state)
            if self._planner.needs_forecast or self._config.failsafe.on
            else (None, "")
        )
        situation = Situation(
            scene=scene,
            state=state,
            forecast=self._forecaster.nothing() if forecast is None else forecast,
            cleared=frozenset(self._stood),
            until=until + watch.loading_s,
        )
        self.question = (task, situation)
        decision, why = self._plan(situation, failure)
        why = why or self._objection(situation, decision, watch.seconds * 1000.0)
        if why:
            if forecast is None:
                situation = situation._replace(forecast=self._foresee(scene, state)[0])
            decision = self._fail_safe.fall_back(situation, why, decision)
        assert decision is not None, "whatever fails has a reason"
        if scene.ego.stop == self._missed:
            decision = without_stop(decision)
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
        self._keep_route(scene)
        state = self._state(scene)
        if state is not None and is_missed(self._task.route, self._stop, state, scene.ego):
            self._missed = self._stop
            self._lay_out(scene.ego, self._edges, NO_STOP)
            state = self._state(scene)
        return None if state is None else (self._task, state)

    def forecast(self, scene: Scene, name: str, seconds: float) -> Forecast | None:
        """What the predictor `name` (built-in, or the scenario's) says right after a decision,
        given its plan; None where the ego is not on its route.

        Raises what a plugin raises, and ValueError where its answer is no forecast.
        """
        state = self._state(scene)
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
        self._note_changes(changes)
        if last is not None:
            self._last = LastDecision(last.plan, last.command, when)
        if not memory.edges:
            return
        self._lay_out(ego, memory.edges, memory.stop)
        self._stood = dict(zip(memory.stood, memory.stood_since, strict=True))
        self._go_on(memory)

    def _memory(self) -> Memory:
        """What the next decision depends on, beside its scene and the last decision."""
        if self._route is None:
            return Memory(failures=self._failures)
        planner = self._planner
        return Memory(
            edges=self._edges,
            stood=tuple(self._stood),
            stood_since=tuple(self._stood.values()),
            stop=self._stop,
            failures=self._failures,
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
        if scene.ego.lane < 0:
            return self._released(memory, watch, "parked at a stop")
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
        stood_s = scene.time - self._stood.get(state.node, math.inf)
        return Cycle(scene, ego_lanes(self._task.route, state), self._last, stood_s)

    def _plan(self, situation: Situation, failure: str) -> tuple[Decision | None, str]:
        """The planner's decision and "", or None and why there is none.

        `failure`: of the predictor, on whose forecast nothing is planned.
        """
        decision, why, failed = None, failure, "predictor"
        if not failure:
            failed = "planner"
            try:
                decision = self._planner.plan(situation)
                why = why_invalid(self._task, situation.state, decision)
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

    # --- route and stop signs ---

    def _state(self, scene: Scene) -> State | None:
        """Where the ego is on its route, if it is on it."""
        if self._route is None or scene.ego.lane < 0:
            return None
        return ego_state(self._route, as_seen(self._road, scene.ego))

    def _keep_route(self, scene: Scene) -> None:
        """Lay the route out at the take-over, and again when SUMO changed it, the road or the
        vehicle, or the next stop is another one."""
        ego, other_road = scene.ego, self._note_changes(scene.changes)
        stop = NO_STOP if ego.stop == self._missed else ego.stop
        kept = self._route is not None and is_rest_of(ego.route, self._edges)
        if kept and stop == self._stop:
            if other_road or self._vehicle != self._laid_for(ego):
                self._renew(ego, self._laid_out(ego, self._edges))
            elif self._plain is not None and len(self._changes.lane):
                self._renew(ego, self._plain)
        elif not ego.route or -1 in ego.route:
            self._route = None
        else:
            self._lay_out(ego, ego.route, stop)

    def _note_changes(self, changes: RoadChanges) -> bool:
        """Drive by the map as it is now. Returns whether it is another one than before."""
        before = self._changes
        if all(
            np.array_equal(getattr(changes, name), getattr(before, name))
            for name in RoadChanges._fields
        ):
            return False
        self._changes, self._road = changes, with_changes(self._map, changes)
        self._forecaster.follow(self._road)
        return True

    def _renew(self, ego: EgoState, plain: RouteMap) -> None:
        """Go on along the same route; planner, fail-safe and stop signs go on as they were."""
        before, route = self._route, self._eased(ego, plain)
        if before is None or (before is self._plain is plain is route):
            return
        memory = self._memory()
        self._drive(ego, plain, route)
        self._stood = moved_to(before, route, memory.stood, memory.stood_since)
        self._go_on(memory)

    def _eased(self, ego: EgoState, plain: RouteMap) -> RouteMap:
        """The route, with time to brake for what the simulation has changed."""
        state = None if ego.lane < 0 else ego_state(plain, as_seen(self._road, ego))
        if state is None or not len(self._changes.lane):
            return plain
        lowered = np.isin(plain.lane, self._changes.lane)
        params = ego_params(self._config, ego, self._physics)
        pace = Pace(state.node, state.s, state.v, state.a)
        return eased(plain, lowered, pace, params.approach_decel, params.jerk, self._stop)

    def _go_on(self, memory: Memory) -> None:
        """Planner and fail-safe remember this."""
        self._fail_safe.ready = memory.ready
        remembers = len(memory.planner.numbers) + len(memory.planner.generator) > 0
        if isinstance(self._planner, Remembering) and remembers:
            self._planner.recall(memory.planner)

    def _lay_out(self, ego: EgoState, edges: tuple[int, ...], stop: Stop) -> None:
        """Start planner and fail-safe on a route, given by its edges, up to a stop. Raises
        PlannerError."""
        self._edges, self._stood, self._stop = edges, {}, stop
        plain = self._laid_out(ego, edges)
        self._drive(ego, plain, self._eased(ego, plain))

    def _laid_out(self, ego: EgoState, edges: tuple[int, ...]) -> RouteMap:
        """A route for the ego on the road as it is now."""
        params = ego_params(self._config, ego, self._physics)
        return route_map(
            self._road,
            edges,
            ego.vclass,
            ego.length,
            ego.speed_factor,
            ego.max_speed,
            params.approach_decel,
            self._closed_under(ego),
            self._stop,
            self._overtakes,
        )

    def _closed_under(self, ego: EgoState) -> tuple[int, ...]:
        """The lanes under the ego that the simulation has closed to it."""
        changed = [i for i in (ego.lane, ego.change_from) if i in self._changes.lane]
        return tuple(i for i in changed if not usable(self._road, np.array([i]), ego.vclass)[0])

    def _laid_for(self, ego: EgoState) -> tuple[float, ...]:
        """What a route and the bounds of the ego depend on, beside the road."""
        return (
            ego.vclass,
            ego.length,
            ego.width,
            ego.max_speed,
            ego.speed_factor,
            ego.max_accel,
            ego.comfort_decel,
            ego.emergency_decel,
            *self._closed_under(ego),
        )

    def _drive(self, ego: EgoState, plain: RouteMap, route: RouteMap) -> None:
        """Start planner and fail-safe on a route. Raises PlannerError."""
        self._vehicle, self._plain, self._route = self._laid_for(ego), plain, route
        params = ego_params(self._config, ego, self._physics)
        self._task = Task(self._road, route, params, self._cost, sight(self._config))
        self._fail_safe.start(self._task)
        try:
            self._planner.start(self._task, self._seed)
        except Exception as error:  # whatever a planner may do
            raise PlannerError(
                f"planner {self._config.planner.name} does not start: {in_one_line(error)}"
            ) from error

    def _note_stop(self, route: RouteMap, state: State, scene: Scene) -> None:
        """Remember when the ego came to a stand at a stop sign, or a light that is one."""
        node, to_line = state.node, route.length[state.node] - state.s
        if state.v >= STANDING or to_line >= NEAR_STOP:
            return
        light = shown(scene.signals, int(route.signal[node]), int(route.link[node]))
        if node == route.halt.node:
            return  # SUMO says when a stop is served
        if route.sign[node] or light == AFTER_STOP:
            self._stood.setdefault(node, scene.time)
