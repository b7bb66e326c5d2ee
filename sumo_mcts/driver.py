"""One ego's mind: which predictor and which planner, and what they need from cycle to cycle. The only place where they are put together."""

import math
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from sumo_mcts import plugins
from sumo_mcts.config import ORACLE_MARK, PLANNERS, PREDICTORS, ConfigError, ScenarioConfig, whole
from sumo_mcts.errors import in_one_line
from sumo_mcts.model.cost import CostParams, Term, compiled_term
from sumo_mcts.model.ego import HALF, EgoParams
from sumo_mcts.model.intentions import foresee
from sumo_mcts.model.kernel import Stopwatch
from sumo_mcts.model.local import State, ego_state
from sumo_mcts.model.others import TrafficParams
from sumo_mcts.model.paths import LANES
from sumo_mcts.model.predictor import Heard, Oracles, Predictor, Question, checked
from sumo_mcts.model.prepare import prepare
from sumo_mcts.model.room import with_room
from sumo_mcts.model.route import RouteMap, is_rest_of, route_map
from sumo_mcts.model.script import script_poses
from sumo_mcts.model.traffic import Told, predict, times_of
from sumo_mcts.planners.base import Planner, Remembering, Situation, Task
from sumo_mcts.planners.baselines import ConstantPlanner, IdmParams, IdmPlanner, RandomPlanner, SumoPlanner
from sumo_mcts.planners.effort import Effort, Timekeeper
from sumo_mcts.planners.exhaustive import ExhaustivePlanner
from sumo_mcts.planners.failsafe import Assumed, FailSafe, nonsense
from sumo_mcts.planners.mcts import MctsParams, MctsPlanner
from sumo_mcts.planners.paper import PaperParams, PaperPlanner
from sumo_mcts.planners.reference import horizon_s
from sumo_mcts.scene import (
    GREEN,
    IGNORING,
    STANDING,
    Agents,
    Answers,
    Decision,
    EgoState,
    Floats,
    Follow,
    Forecast,
    Ints,
    Memory,
    Plan,
    PlannerMemory,
    Release,
    RoadMap,
    Scene,
    Signals,
)
from sumo_mcts.sensing import aside_m, room_m

SEARCHING = ("mcts", "paper")  # planners that search a forecast
FORECASTING = (*SEARCHING, "idm", "random", "exhaustive")  # planners that read one
NEAR_STOP = 3.0  # m before a stop sign within which standing counts
NOMINAL_S = 2.0  # s of the last plan that the forecast takes for granted; afterwards the nominal ego follows its leader

CENTRED = 0.02  # m from the middle of its lane within which no lane change is under way


class Physics(NamedTuple):
    """How the running simulation moves vehicles."""

    step: float  # s
    ballistic: bool
    change_duration: float  # s


class Streams(NamedTuple):
    """Independent randomness from one seed."""

    traffic: np.random.SeedSequence
    search: int
    noise: np.random.SeedSequence


def streams(seed: int | None) -> Streams:
    """The streams of a seed; without one those of seed 0. Raises ConfigError where it is none."""
    traffic, search, noise = np.random.SeedSequence(0 if seed is None else whole("seed", seed, 0)).spawn(3)
    return Streams(traffic, int(search.generate_state(1)[0]), noise)


class PlannerError(Exception):
    """The planner, or a predictor of the user's own, does not start or failed too often in a row; the message is that of its last failure."""


class Thought(NamedTuple):
    """One decision with what it rests on."""

    decision: Decision
    forecast: Forecast | None
    plan_ms: float  # without the time in which kernels were compiled or loaded
    intervened: bool = False  # the fail-safe manoeuvre in place of what the planner decided; why: decision.reason
    memory: Memory = Memory()  # of earlier decisions, on which this one rests
    answers: Answers = Answers()  # of oracles


class Driver:
    """Plans for one ego."""

    def __init__(
        self, config: ScenarioConfig, road: RoadMap, physics: Physics, seed: int, oracles: Oracles | None = None, planner: Planner | None = None
    ) -> None:
        """`planner`: in place of the one that the scenario names. Raises ConfigError where a plugin cannot be made."""
        self._config, self._road, self._physics, self._seed = config, road, physics, seed
        self._heard = Heard(oracles)
        self._oracles = self._heard.oracles()
        self._planner = make_planner(config) if planner is None else planner
        self._cost = cost_params(config)
        self._predictor = make_predictor(config)
        if self._predictor is not None:
            try:
                self._predictor.start(road, self._oracles if self._predictor.oracle else None)
            except Exception as error:  # whatever a predictor may do
                raise ConfigError(f"prediction.name: {config.prediction.name}: does not start: {in_one_line(error)}") from None
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
        self.question: tuple[Task, Situation] | None = None  # what the planner was asked last; None where the ego is not on its route

    def decide(self, scene: Scene) -> Thought:
        """Observe, predict, plan, check. Raises PlannerError where the planner failed too often in a row."""
        watch = Stopwatch()
        until = self._timekeeper.until(watch.began)
        memory = self._memory()
        self._heard.forget()
        placed = self.placed(scene)
        if placed is None:
            self._plan, self._command, self.question = None, Release(), None
            self._fail_safe.forget()
            return Thought(Decision(Release(), None, (), -1, "not on its route: SUMO drives", 0, 0), None, watch.seconds * 1000.0, memory=memory)
        task, state = placed
        self._note_stop(task.route, state, scene.time)
        forecast, failure = self._foreseen(scene, state) if self._planner.needs_forecast or self._config.failsafe.on else (None, "")
        expected = forecast if forecast is not None else no_forecast(self._traffic.step)
        situation = Situation(scene, state, expected, frozenset(self._stood), until + watch.loading_s)
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
        return Thought(decision, forecast, watch.seconds * 1000.0, why != "", memory, self._heard.answers(scene.agents.ids))

    def _memory(self) -> Memory:
        """What the next decision depends on, beside what it is given and the last one."""
        if self._route is None:
            return Memory(failures=self._failures)
        planner = self._planner.memory() if isinstance(self._planner, Remembering) else PlannerMemory()
        return Memory(self._edges, tuple(self._stood), tuple(self._stood.values()), self._failures, self._fail_safe.ready, planner)

    def recall(self, ego: EgoState, memory: Memory, last: Decision | None, when: float) -> None:
        """Go on after the decision `last`, taken at the time `when` (s), as if all before it had been decided here; `ego` as it is now."""
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
        """What there is to drive, laid out anew where SUMO changed the route, and where the ego is on it; None where it is not on its route."""
        self._keep_route(scene.ego)
        state = self._state(scene)
        return None if state is None else (self._task, state)

    def _planned(self, situation: Situation, failure: str) -> tuple[Decision | None, str]:
        """The planner's decision, or why there is none; `failure`: of the predictor, on whose forecast nothing is planned."""
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
        if self._config.failsafe.on and decision is not None and isinstance(decision.command, Follow):
            return self._fail_safe.objection(situation, decision.command)
        self._fail_safe.forget()
        return ""

    def forecast(self, scene: Scene, name: str, seconds: float) -> Forecast | None:
        """What the predictor `name` (ours, or the scenario's) says right after a decision, given the plan just made; None where the ego is not on its
        route. Raises what a predictor of the user's own raises, and ValueError where its answer is no forecast."""
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
        return None if self._route is None or scene.ego.lane < 0 else ego_state(self._route, as_seen(self._road, scene.ego))

    def _foreseen(self, scene: Scene, state: State) -> tuple[Forecast, str]:
        """What the scenario's predictor says, as far as its planner looks; where one of the user's own fails, what ours says, and why. Raises ConfigError
        where a record does not answer what it asks."""
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
        self._route = route_map(self._road, edges, ego.vclass, ego.length, ego.speed_factor, ego.max_speed, params.approach_decel)
        self._task = Task(self._road, self._route, params, self._cost)
        self._fail_safe.start(self._task)
        try:
            self._planner.start(self._task, self._seed)
        except Exception as error:  # whatever a planner may do
            raise PlannerError(f"planner {self._config.planner.name} does not start: {in_one_line(error)}") from error

    def _note_stop(self, route: RouteMap, state: State, now: float) -> None:
        """Remember when the ego stood at a stop sign."""
        if route.sign[state.node] and state.v < STANDING and route.length[state.node] - state.s < NEAR_STOP:
            self._stood.setdefault(state.node, now)

    def _horizon(self) -> float:
        """How far the planner looks into a forecast, s."""
        config = self._config
        if config.planner.name == "exhaustive":
            return horizon_s(self._traffic.step)
        if config.planner.name == "paper":
            return (config.paper.look_ahead_steps + config.paper.rollout_steps) * max(config.paper.step_s, self._physics.step) + self._traffic.step
        steps = config.planner.look_ahead_steps + config.planner.rollout_steps
        ply = max(1, round(config.planner.step_s / self._physics.step)) * self._physics.step
        return steps * ply + config.cost.claim_s + self._traffic.step

    def _forecast(self, scene: Scene, route: RouteMap, state: State, name: str, seconds: float, most: int = 1) -> Forecast:
        """What the predictor `name` says, with room for the sensor's errors and for who is on foot."""
        params = self._traffic._replace(interacting=name != "constant_velocity")
        stood_s = scene.time - self._stood.get(state.node, math.inf)
        nominal, lanes = self._nominal(scene.time), _ego_lanes(route, state)
        if self._predictor is not None and name == self._config.prediction.name:
            question = Question(scene, lanes, nominal, params, seconds, stood_s)
            found = checked(self._predictor.predict(question), self._road, question)
        elif name == "idm":
            found = foresee(self._road, scene, lanes, nominal, params, seconds, stood_s, most)
        else:
            found = predict(self._road, scene, lanes, nominal, params, seconds, self._told(scene, name, seconds), stood_s)
        on_foot = 0.0 if name == "clone" else self._config.prediction.room_on_foot_m  # a copy knows where people walk
        return with_room(found, scene, room_m(self._config.sensor), on_foot)

    def _told(self, scene: Scene, name: str, seconds: float) -> Told:
        """What the oracle `name` tells, if it is one."""
        agents, ask = scene.agents, self._oracles
        count = times_of(seconds, self._traffic.step)
        match name:
            case "script" | "clone" if ask is not None:
                known = {i: ask.script(vehicle, scene.time, self._traffic.step, count) for i, vehicle in enumerate(agents.ids)}
                scripts = {i: script for i, script in known.items() if script is not None}
                if name == "script":
                    return Told(scripts=scripts)
                copies = ask.clone(scene, self._nominal_command(scene.time), self._traffic.step, count)
                return Told(scripts={i: copies[i] for i in scripts}, copies=copies)
            case "routes" if ask is not None:
                return Told(ways={int(i): ask.way(agents.ids[i], int(agents.lane[i])) for i in np.flatnonzero(agents.lane >= 0)})
        return Told()

    def _nominal(self, now: float) -> Floats:
        """[K] speeds of the last plan from now on, at the forecast's times."""
        if self._plan is None or not len(self._plan.v):
            return np.zeros(0)
        begin = now - self._plan_time
        end = min(float(self._plan.time[-1]), begin + NOMINAL_S)
        times = np.arange(begin + self._traffic.step, end + 1e-9, self._traffic.step)
        return np.asarray(np.interp(times, self._plan.time, self._plan.v))

    def _nominal_command(self, now: float) -> Follow | Release:
        """What is left of the last command, as long as the forecast takes it for granted; then SUMO's own driver."""
        if isinstance(self._command, Release):
            return self._command
        begin = round((now - self._plan_time) / self._physics.step)
        left = self._command.speeds[begin : begin + round(NOMINAL_S / self._physics.step)]
        return Follow(left, self._command.lane_change if begin == 0 else 0) if len(left) else Release()


def warm_up(config: ScenarioConfig, road: RoadMap, physics: Physics) -> None:
    """Load (the first time: compile) what decisions need, by one that nobody executes; without it the ego's first decision would be late. What is compiled
    is announced (model/announce.py)."""
    if not reads_forecast(config) and not config.failsafe.on:
        return
    planner = config.planner.model_copy(update={"iterations": 1, "most_iterations": None, "time_budget_ms": None, "enforce_deadline": False})
    checked = config.failsafe.on or config.planner.enforce_deadline
    tried = config.model_copy(update={"planner": planner, "failsafe": config.failsafe.model_copy(update={"on": checked})})
    scene = _still_life(road, physics.step)
    with suppress(Exception):  # what fails here fails again at the first real decision, where it becomes the outcome
        prepare(lambda: Driver(tried, road, physics, 0).decide(scene))
    if config.prediction.name == "script":
        row = np.zeros(1)
        script_poses(road, scene.agents.lane, row, row, row, physics.step, scene.ego.length)


def as_seen(road: RoadMap, ego: EgoState) -> EgoState:
    """The ego with its lane change as far as SUMO has it by now, which may refuse one, be slower than its own clock, or end it in a junction."""
    if ego.changing <= 0.0 or ego.lane < 0:
        return ego
    side = 1 if road.left[ego.change_from] == ego.change_to else -1
    moved = ego.d * side < 0.0  # past the middle
    other = int((road.left if (side > 0) != moved else road.right)[ego.lane])
    if abs(ego.d) < CENTRED or other < 0:
        return ego._replace(changing=0.0)
    share = abs(ego.d) / float(road.width[ego.lane] + road.width[other]) * 2.0
    if moved:  # at half time rounding decides: progress has to agree with the lane
        return ego._replace(changing=max(1.0 - share, HALF + 1e-9), change_from=other, change_to=ego.lane)
    return ego._replace(changing=min(share, 0.5 - 1e-9), change_from=ego.lane, change_to=other)


def reads_forecast(config: ScenarioConfig) -> bool:
    """Whether the planner that a scenario names reads a forecast. Raises ConfigError where it is a plugin that cannot be loaded."""
    name = config.planner.name
    return name in FORECASTING if name in PLANNERS else bool(getattr(plugins.loaded("planner.name", name), "needs_forecast", True))


def prediction_label(config: ScenarioConfig) -> str:
    """What the scenario's predictor is called in results: a plugin that is an oracle is labelled. Raises ConfigError where it cannot be loaded."""
    name = config.prediction.name
    oracle = name not in PREDICTORS and getattr(plugins.loaded("prediction.name", name), "oracle", False)
    return f"{name}{ORACLE_MARK}" if oracle else name


def forecast_label(config: ScenarioConfig) -> str | None:
    """What the forecast is called that a scenario's planner reads; None: it reads none. Raises ConfigError where a plugin cannot be loaded."""
    return prediction_label(config) if reads_forecast(config) else None


def make_predictor(config: ScenarioConfig) -> Predictor | None:
    """The predictor of the user's own that a scenario names; None: one of ours. Raises ConfigError."""
    q = config.prediction
    if q.name in PREDICTORS:
        return None
    predictor: Predictor = plugins.made("prediction.name", q.name, ("oracle", "start", "predict"), q.options, config)
    return predictor


def make_planner(config: ScenarioConfig) -> Planner:
    """The planner that a scenario names. Raises ConfigError where it is a plugin that cannot be made."""
    p = config.planner
    match p.name:
        case "sumo":
            return SumoPlanner()
        case "constant":
            return ConstantPlanner(p.period_s)
        case "idm":
            return IdmPlanner(_idm_params(config), p.period_s)
        case "random":
            return RandomPlanner(mcts_params(config))
        case "exhaustive":
            return ExhaustivePlanner()
        case "paper":
            return PaperPlanner(_paper_params(config))
        case "mcts":
            return MctsPlanner(mcts_params(config))
    planner: Planner = plugins.made("planner.name", p.name, ("needs_forecast", "start", "plan"), p.options, config)
    return planner


def mcts_params(config: ScenarioConfig) -> MctsParams:
    """The search of planner `mcts`."""
    p = config.planner
    return MctsParams(
        Effort(p.iterations, max(p.iterations, p.most_iterations or 0), p.close_cost), p.period_s, p.step_s, p.look_ahead_steps, p.rollout_steps, p.check_s,
        p.accelerations_mps2, p.lane_change_accelerations_mps2, p.later_accelerations_mps2, p.later_lane_change_accelerations_mps2, p.exploration, p.reactive,
        p.cvar_alpha if p.risk == "cvar" else 1.0, p.adaptive,
    )  # fmt: skip


def ego_params(config: ScenarioConfig, ego: EgoState, physics: Physics) -> EgoParams:
    """The ego's bounds: the scenario's, never beyond its vehicle type's."""
    m = config.ego_model
    return EgoParams(
        physics.step, physics.ballistic, m.jerk_mps3, m.emergency_jerk_mps3, m.comfort_decel_mps2,
        min(m.max_decel_mps2, max(ego.emergency_decel, ego.comfort_decel)), min(m.max_accel_mps2, ego.max_accel), m.approach_decel_mps2, m.stop_gap_m,
        physics.change_duration, config.cost.headway_s, config.cost.headway_gap_m, ego.length / 2, ego.width / 2,
    )  # fmt: skip


def cost_params(config: ScenarioConfig) -> CostParams:
    """The weights of planner `mcts`, and a term of the user's own. Raises ConfigError where that cannot be compiled."""
    c = config.cost
    return CostParams(
        c.contact, c.speed_at_contact, c.headway_s, c.headway_gap_m, c.headway, c.claim_s, c.claim, c.acceleration, c.jerk, c.braking, c.progress,
        c.tail_s, c.blocking, c.astride, c.route, c.lane_change, c.red, c.cut_in_decel_mps2, c.imposed,
        None if c.term is None else _term(c.term, c.term_weight),
    )  # fmt: skip


def traffic_params(config: ScenarioConfig, physics: Physics) -> TrafficParams:
    """Forecast times that fall on steps of the simulation, or divide them evenly."""
    q, step = config.prediction, physics.step
    dt = step * max(1, round(q.step_s / step)) if step <= q.step_s * 1.25 + 1e-9 else step / round(step / q.step_s)
    return TrafficParams(
        dt, q.headway_s, q.min_gap_m, q.accel_mps2, q.decel_mps2, q.yield_decel_mps2, q.yield_gap_s, q.stays_after_s, q.persistence_s,
        0.0 if physics.ballistic else 0.5 * step, q.name != "constant_velocity", aside_m(config.sensor),
    )  # fmt: skip


def _term(name: str, weight: float) -> Term:
    try:
        return Term(compiled_term(plugins.loaded("cost.term", name)), weight)
    except ConfigError:
        raise
    except Exception as error:  # numba's errors share no base of use
        raise ConfigError(f"cost.term: {name}: cannot be compiled: {in_one_line(error)}") from None


def assumed(config: ScenarioConfig) -> Assumed:
    """What the fail-safe takes the others to do."""
    f = config.failsafe
    return Assumed(f.decel_mps2, f.accel_mps2, f.over_limit, f.reaction_s, f.yield_decel_mps2, f.horizon_s)


def deadline_s(config: ScenarioConfig, period: float) -> float:
    """When a decision is late, s: the time budget if there is one, else the decision period (s)."""
    return period if config.planner.time_budget_ms is None else time_budget_s(config)


def time_budget_s(config: ScenarioConfig) -> float:
    """The time budget of a decision, s; inf: none."""
    return math.inf if config.planner.time_budget_ms is None else config.planner.time_budget_ms / 1000.0


def _paper_params(config: ScenarioConfig) -> PaperParams:
    p = config.paper
    return PaperParams(
        config.planner.iterations, p.step_s,
        p.look_ahead_steps, p.rollout_steps, config.planner.check_s, p.accelerations_mps2, p.lane_change_accelerations_mps2, p.exploration,
        p.brake_probability, p.accelerate_probability, p.weight_safety, p.weight_comfort, p.weight_passability, p.weight_other, p.safety_threshold_m,
        p.contact_cost, p.jerk_factor, p.goal_distance_m, p.lane_distance_m, p.goal_factor, p.junction_penalty, p.lane_change_cost, p.stop_cost, p.turn_cost,
        p.emergency_cost,
    )  # fmt: skip


def _idm_params(config: ScenarioConfig) -> IdmParams:
    p = config.idm
    return IdmParams(p.headway_s, p.min_gap_m, p.accel_mps2, p.decel_mps2, p.critical_gap_s, p.cut_in_decel_mps2)


def _ego_lanes(route: RouteMap, state: State) -> Ints:
    """The lanes that the ego is going to drive, the one it moves to first."""
    node = state.other if 0.0 < state.progress < 0.5 and state.other >= 0 else state.node
    lanes: list[int] = []
    while node >= 0 and len(lanes) < LANES:
        lanes.append(int(route.lane[node]))
        node = int(route.next[node])
    return np.array(lanes, np.int32)


def no_forecast(dt: float) -> Forecast:
    """A forecast without agents, `dt` s between its states."""
    none = np.zeros((1, 1, 0))
    return Forecast(
        dt, np.ones(1), np.zeros((1, 1, 0, 4)), none, none.astype(np.int32), none, none.astype(np.bool_), np.zeros(0), np.zeros(0),
        np.zeros(0, np.bool_), np.zeros((1, 0), np.bool_),
    )  # fmt: skip


def _still_life(road: RoadMap, step: float) -> Scene:
    """An ego and an agent that stand on an ordinary lane of a network."""
    lane = int(np.flatnonzero(~road.internal)[0])
    x, y = (float(value) for value in road.points[road.point_offset[lane]])
    ego = EgoState("", x, y, 0.0, 0.0, 0.0, lane, 0.0, 0.0, 5.0, 1.8, 2.6, 4.5, 9.0, 50.0, 1.0, IGNORING, (int(road.edge[lane]),), 0.0, -1, -1)
    zero, none, end = np.zeros(1), np.zeros(1, np.int32), float(road.length[lane])
    agents = Agents(
        ("agent",), zero + x, zero + y, zero, zero, zero, zero, zero + 5.0, zero + 1.8, none + lane, zero + end, zero, none, zero, none > 0, none
    )  # fmt: skip
    links = [int(road.link[road.signal == signal].max(initial=-1)) + 1 for signal in range(len(road.signal_ids))]
    offset = np.concatenate([[0], np.cumsum(links)]).astype(np.int32)
    signals = Signals(offset, np.full((int(offset[-1]), 1), GREEN, np.int32), np.full((len(links), 1), np.inf))
    return Scene(0.0, step, ego, agents, signals)
