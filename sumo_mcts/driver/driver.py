"""One ego's mind: which predictor and which planner, and what they need from cycle to cycle.

The only place where they are put together.
"""

import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.config import ScenarioConfig
from sumo_mcts.driver.forecaster import CENTRED, NOMINAL_S, as_seen, ego_lanes, no_forecast
from sumo_mcts.driver.params import (
    Physics,
    assumed,
    cost_params,
    deadline_s,
    ego_params,
    time_budget_s,
    traffic_params,
)
from sumo_mcts.driver.registry import PlannerError, make_planner, make_predictor
from sumo_mcts.driver.sensor import room_m
from sumo_mcts.errors import ConfigError, in_one_line
from sumo_mcts.model.local_map import State, ego_state
from sumo_mcts.model.route import RouteMap, is_rest_of, route_map
from sumo_mcts.numerics.kernel import Stopwatch
from sumo_mcts.planners.base import Planner, Remembering, Situation, Task
from sumo_mcts.planners.budget import Timekeeper
from sumo_mcts.planners.failsafe import FailSafe, nonsense
from sumo_mcts.planners.mcts import MctsPlanner
from sumo_mcts.planners.reference import horizon_s
from sumo_mcts.prediction.forecast import OracleData, predict, times_of
from sumo_mcts.prediction.hypotheses import predict_hypotheses
from sumo_mcts.prediction.interface import OracleRecorder, Oracles, Question, checked
from sumo_mcts.prediction.margins import inflate
from sumo_mcts.scene import (
    STANDING,
    Answers,
    Decision,
    EgoState,
    Floats,
    Follow,
    Forecast,
    Memory,
    Plan,
    PlannerMemory,
    Release,
    RoadMap,
    Scene,
)

NEAR_STOP = 3.0  # m before a stop sign within which standing counts


class PlanningResult(NamedTuple):
    """One decision with what it rests on."""

    decision: Decision
    forecast: Forecast | None
    plan_ms: float  # without the time in which kernels were compiled or loaded
    intervened: bool = (
        False  # the fail-safe manoeuvre in place of what the planner decided; why: decision.reason
    )
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
        self._config, self._road, self._physics, self._seed = config, road, physics, seed
        self._heard = OracleRecorder(oracles)
        self._oracles = self._heard.oracles()
        self._planner = make_planner(config) if planner is None else planner
        self._cost = cost_params(config)
        self._predictor = make_predictor(config)
        if self._predictor is not None:
            try:
                self._predictor.start(road, self._oracles if self._predictor.oracle else None)
            except Exception as error:  # whatever a predictor may do
                raise ConfigError(
                    f"prediction.name: {config.prediction.name}: does not start: "
                    f"{in_one_line(error)}"
                ) from None
        self._period = max(1, round(config.planner.period_s / physics.step)) * physics.step
        self._fail_safe = FailSafe(assumed(config), self._period)
        self._timekeeper = Timekeeper(time_budget_s(config))
        self._failures = 0  # of the planner, in a row
        self._traffic = traffic_params(config, physics)
        self._route: RouteMap | None = None
        self._edges: tuple[int, ...] = ()
        self._stood: dict[int, float] = {}  # node at whose stop sign the ego has stood -> when
        self._plan: Plan | None = None
        self._command: Follow | Release = Release()
        self._plan_time = 0.0
        self.question: tuple[Task, Situation] | None = (
            None  # what the planner was asked last; None where the ego is not on its route
        )

    def decide(self, scene: Scene) -> PlanningResult:
        """Observe, predict, plan, check.

        Raises PlannerError where the planner failed too often in a row.
        """
        watch = Stopwatch()
        until = self._timekeeper.until(watch.began)
        memory = self._memory()
        self._heard.forget()
        placed = self.placed(scene)
        if placed is None:
            self._plan, self._command, self.question = None, Release(), None
            self._fail_safe.forget()
            return PlanningResult(
                Decision(Release(), None, (), -1, "not on its route: SUMO drives", 0, 0),
                None,
                watch.seconds * 1000.0,
                memory=memory,
            )
        task, state = placed
        self._note_stop(task.route, state, scene.time)
        forecast, failure = (
            self._foreseen(scene, state)
            if self._planner.needs_forecast or self._config.failsafe.on
            else (None, "")
        )
        expected = forecast if forecast is not None else no_forecast(self._traffic.step)
        situation = Situation(
            scene, state, expected, frozenset(self._stood), until + watch.loading_s
        )
        self.question = (task, situation)
        decision, why = self._planned(situation, failure)
        why = why or self._objection(situation, decision, watch.seconds * 1000.0)
        if why:
            if forecast is None:
                situation = situation._replace(forecast=self._foreseen(scene, state)[0])
            decision = self._fail_safe.fall_back(situation, why, decision)
        assert decision is not None, "whatever fails has a reason"
        self._plan, self._command, self._plan_time = decision.plan, decision.command, scene.time
        self._timekeeper.note(until, watch.began + watch.seconds)
        return PlanningResult(
            decision,
            forecast,
            watch.seconds * 1000.0,
            why != "",
            memory,
            self._heard.answers(scene.agents.ids),
        )

    def _memory(self) -> Memory:
        """What the next decision depends on, beside what it is given and the last one."""
        if self._route is None:
            return Memory(failures=self._failures)
        planner = (
            self._planner.memory() if isinstance(self._planner, Remembering) else PlannerMemory()
        )
        return Memory(
            self._edges,
            tuple(self._stood),
            tuple(self._stood.values()),
            self._failures,
            self._fail_safe.ready,
            planner,
        )

    def recall(self, ego: EgoState, memory: Memory, last: Decision | None, when: float) -> None:
        """Go on after the decision `last`, taken at the time `when` (s), as if all before it had
        been decided here; `ego` as it is now."""
        self._failures = memory.failures
        if last is not None:
            self._plan, self._command, self._plan_time = last.plan, last.command, when
        if not memory.edges:
            return
        self._lay_out(ego, memory.edges)
        self._stood = dict(zip(memory.stood, memory.stood_since, strict=True))
        self._fail_safe.ready = memory.ready
        if isinstance(self._planner, Remembering) and any(len(part) for part in memory.planner):
            self._planner.recall(memory.planner)

    def placed(self, scene: Scene) -> tuple[Task, State] | None:
        """What there is to drive, laid out anew where SUMO changed the route, and where the ego is
        on it; None where it is not on its route."""
        self._keep_route(scene.ego)
        state = self._state(scene)
        return None if state is None else (self._task, state)

    def _planned(self, situation: Situation, failure: str) -> tuple[Decision | None, str]:
        """The planner's decision, or why there is none;

        `failure`: of the predictor, on whose forecast nothing is planned.
        """
        decision, why, whose = None, failure, "predictor"
        if not failure:
            whose = "planner"
            try:
                decision = self._planner.plan(situation)
                why = nonsense(self._task, situation.state, decision)
            except Exception as error:  # whatever a planner may do
                why = f"{type(error).__name__}: {error}"
        self._failures = self._failures + 1 if why else 0
        if self._failures > self._config.failsafe.most_failures:
            raise PlannerError(why)
        return (None, f"the {whose} failed: {why}") if why else (decision, "")

    def _objection(self, situation: Situation, decision: Decision | None, ms: float) -> str:
        """Why a decision that took so long must not be executed; "" where it may."""
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

    def forecast(self, scene: Scene, name: str, seconds: float) -> Forecast | None:
        """What the predictor `name` (ours, or the scenario's) says right after a decision, given
        the plan just made; None where the ego is not on its route. Raises what a predictor of the
        user's own raises, and ValueError where its answer is no forecast."""
        route, state = self._route, self._state(scene)
        if state is None or route is None:
            return None
        side = self._command.lane_change if isinstance(self._command, Follow) else 0
        other = int((route.left if side > 0 else route.right)[state.node]) if side else -1
        if other >= 0:
            state = state._replace(progress=CENTRED, other=other)  # it is about to begin
        return self._forecast(scene, route, state, name, seconds)

    def _state(self, scene: Scene) -> State | None:
        """Where the ego is on its route, if it is."""
        return (
            None
            if self._route is None or scene.ego.lane < 0
            else ego_state(self._route, as_seen(self._road, scene.ego))
        )

    def _foreseen(self, scene: Scene, state: State) -> tuple[Forecast, str]:
        """What the scenario's predictor says, as far as its planner looks; where one of the user's
        own fails, what ours says, and why. Raises ConfigError where a record does not answer what
        it asks."""
        name, route = self._config.prediction.name, self._task.route
        most = self._config.prediction.hypotheses if isinstance(self._planner, MctsPlanner) else 1
        if self._predictor is None:
            return self._forecast(scene, route, state, name, self._horizon(), most), ""
        try:
            return self._forecast(scene, route, state, name, self._horizon()), ""
        except ConfigError:  # of oracles that only know what was recorded
            raise
        except Exception as error:  # whatever a predictor may do
            return self._forecast(scene, route, state, "idm", self._horizon()), in_one_line(error)

    def _keep_route(self, ego: EgoState) -> None:
        """Lay the route out when the ego is taken over, and again when SUMO gave it another one."""
        if self._route is not None and is_rest_of(ego.route, self._edges):
            return
        if not ego.route or -1 in ego.route:
            self._route = None
            return
        self._lay_out(ego, ego.route)

    def _lay_out(self, ego: EgoState, edges: tuple[int, ...]) -> None:
        """Prepare everybody for a route, given by its edges."""
        params = ego_params(self._config, ego, self._physics)
        self._edges, self._stood = edges, {}
        self._route = route_map(
            self._road,
            edges,
            ego.vclass,
            ego.length,
            ego.speed_factor,
            ego.max_speed,
            params.approach_decel,
        )
        self._task = Task(self._road, self._route, params, self._cost)
        self._fail_safe.start(self._task)
        try:
            self._planner.start(self._task, self._seed)
        except Exception as error:  # whatever a planner may do
            raise PlannerError(
                f"planner {self._config.planner.name} does not start: {in_one_line(error)}"
            ) from error

    def _note_stop(self, route: RouteMap, state: State, now: float) -> None:
        """Remember when the ego stood at a stop sign."""
        if (
            route.sign[state.node]
            and state.v < STANDING
            and route.length[state.node] - state.s < NEAR_STOP
        ):
            self._stood.setdefault(state.node, now)

    def _horizon(self) -> float:
        """How far the planner looks into a forecast, s."""
        config = self._config
        if config.planner.name == "exhaustive":
            return horizon_s(self._traffic.step)
        if config.planner.name == "paper":
            return (config.paper.look_ahead_steps + config.paper.rollout_steps) * max(
                config.paper.step_s, self._physics.step
            ) + self._traffic.step
        steps = config.planner.look_ahead_steps + config.planner.rollout_steps
        ply = max(1, round(config.planner.step_s / self._physics.step)) * self._physics.step
        return steps * ply + config.cost.claim_s + self._traffic.step

    def _forecast(
        self, scene: Scene, route: RouteMap, state: State, name: str, seconds: float, most: int = 1
    ) -> Forecast:
        """What the predictor `name` says, with room for the sensor's errors and for who is on
        foot."""
        params = self._traffic._replace(interacting=name != "constant_velocity")
        stood_s = scene.time - self._stood.get(state.node, math.inf)
        nominal, lanes = self._nominal(scene.time), ego_lanes(route, state)
        if self._predictor is not None and name == self._config.prediction.name:
            question = Question(scene, lanes, nominal, params, seconds, stood_s)
            found = checked(self._predictor.predict(question), self._road, question)
        elif name == "idm":
            found = predict_hypotheses(
                self._road, scene, lanes, nominal, params, seconds, stood_s, most
            )
        else:
            found = predict(
                self._road,
                scene,
                lanes,
                nominal,
                params,
                seconds,
                self._told(scene, name, seconds),
                stood_s,
            )
        on_foot = (
            0.0 if name == "clone" else self._config.prediction.room_on_foot_m
        )  # a copy knows where people walk
        return inflate(found, scene, room_m(self._config.sensor), on_foot)

    def _told(self, scene: Scene, name: str, seconds: float) -> OracleData:
        """What the oracle `name` tells, if it is one."""
        agents, ask = scene.agents, self._oracles
        count = times_of(seconds, self._traffic.step)
        match name:
            case "script" | "clone" if ask is not None:
                known = {
                    i: ask.script(vehicle, scene.time, self._traffic.step, count)
                    for i, vehicle in enumerate(agents.ids)
                }
                scripts = {i: script for i, script in known.items() if script is not None}
                if name == "script":
                    return OracleData(scripts=scripts)
                copies = ask.clone(
                    scene, self._nominal_command(scene.time), self._traffic.step, count
                )
                return OracleData(scripts={i: copies[i] for i in scripts}, copies=copies)
            case "routes" if ask is not None:
                return OracleData(
                    ways={
                        int(i): ask.way(agents.ids[i], int(agents.lane[i]))
                        for i in np.flatnonzero(agents.lane >= 0)
                    }
                )
        return OracleData()

    def _nominal(self, now: float) -> Floats:
        """[K] speeds of the last plan from now on, at the forecast's times."""
        if self._plan is None or not len(self._plan.v):
            return np.zeros(0)
        begin = now - self._plan_time
        end = min(float(self._plan.time[-1]), begin + NOMINAL_S)
        times = np.arange(begin + self._traffic.step, end + 1e-9, self._traffic.step)
        return np.asarray(np.interp(times, self._plan.time, self._plan.v))

    def _nominal_command(self, now: float) -> Follow | Release:
        """What is left of the last command, as long as the forecast takes it for granted; then
        SUMO's own driver."""
        if isinstance(self._command, Release):
            return self._command
        begin = round((now - self._plan_time) / self._physics.step)
        left = self._command.speeds[begin : begin + round(NOMINAL_S / self._physics.step)]
        return (
            Follow(left, self._command.lane_change if begin == 0 else 0) if len(left) else Release()
        )
