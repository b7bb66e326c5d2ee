"""The closed loop: SUMO moves the traffic, drivers decide, the referee judges. Loop is one running scenario; run_episode drives it to the end."""

import hashlib
import math
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts import records
from sumo_mcts.config import ConfigError, ScenarioConfig, digest
from sumo_mcts.driver import Driver, Physics, Thought
from sumo_mcts.evaluation.metrics import free_flow_time
from sumo_mcts.evaluation.referee import Goal, Referee
from sumo_mcts.model.script import script_poses
from sumo_mcts.model.traffic import Scripted
from sumo_mcts.records import CycleRecord, Row, Trace
from sumo_mcts.scene import Decision, EgoState, Follow, Frame, RoadMap, Scene
from sumo_mcts.world.actors import Actors, draw, write_routes
from sumo_mcts.world.command import Commander
from sumo_mcts.world.observe import Observer
from sumo_mcts.world.roadmap import read_roadmap
from sumo_mcts.world.simulation import REFEREE_OPTIONS, Simulation, SimulationError, option, ssm_options, step_length

DEFAULT_STEP = 0.1  # s
LOST_LEG = 3.0  # multiple of the free-flow time that a time limit allows, see measures.md
LIMIT_SLACK = 120.0  # s

Progress = Callable[[str], None]


class EpisodeResult(NamedTuple):
    """What an episode leaves behind. One row and one trace an ego."""

    rows: tuple[Row, ...]
    traces: tuple[Trace, ...]
    manifest: dict[str, Any]


class Seeds(NamedTuple):
    """Independent streams from one seed."""

    sumo: int
    traffic: np.random.SeedSequence
    search: int


def spread(seed: int) -> Seeds:
    """The streams of a seed."""
    traffic, search, _noise = np.random.SeedSequence(seed).spawn(3)
    return Seeds(seed, traffic, int(search.generate_state(1)[0]))


class _Ego:
    """One ego in the loop."""

    def __init__(self, vehicle: str, until: str | None) -> None:
        self.id, self.until = vehicle, until
        self.state = "waiting"  # then "driving", "done"
        self.due = 0.0
        self.commander: Commander | None = None
        self.referee: Referee | None = None
        self.last: Frame | None = None
        self.error: str | None = None
        self.departed = math.nan
        self.hash = hashlib.sha256()


class Loop:
    """A scenario that runs: `scenes()` advances SUMO until an ego needs a decision, `apply()` takes the decisions."""

    def __init__(self, config: ScenarioConfig, seed: int | None, *, gui: bool = False, sumo_options: Sequence[str] = ()) -> None:
        """`seed` None: SUMO keeps its own. Raises ConfigError."""
        self.config, self.seed, self.gui = config, seed, gui
        self._options = tuple(sumo_options)
        self._egos = [_Ego(ego.id, ego.until) for ego in config.egos]
        self._folder = tempfile.TemporaryDirectory(prefix="sumo_mcts-")
        self._simulation: Simulation | None = None
        self._poses: dict[str, Any] = {}

    def start(self) -> None:
        """Start SUMO. Raises ConfigError where the input is wrong."""
        config, folder = self.config, Path(self._folder.name)
        seeds = spread(self.seed or 0)
        actors = draw(config.traffic, np.random.default_rng(seeds.traffic))
        self.arguments = sumo_arguments(config, self.seed, actors, folder, self._options)
        self._simulation = Simulation(self.arguments, gui=self.gui)
        self.road = _road(option("net-file"))
        self.physics = Physics(step_length(), option("step-method.ballistic") == "true", _change_duration())
        self._check()
        self._actors = Actors(
            actors, self.road, self.physics.step, events=config.traffic.events, egos=[e.id for e in config.egos], change_s=self.physics.change_duration
        )
        self._observer = Observer(self.road)
        self._begin = self._simulation.time
        period = config.planner.period_s
        self.period = max(1, round(period / self.physics.step)) * self.physics.step

    def _check(self) -> None:
        known = set(self.road.edge_ids)
        for ego in self.config.egos:
            if ego.until is not None and ego.until not in known:
                raise ConfigError(f"egos: {ego.id}: until: the network has no edge {ego.until}")
        success = self.config.episode.success_edge
        if success is not None and success not in known:
            raise ConfigError(f"episode.success_edge: the network has no edge {success}")

    def scenes(self) -> dict[str, Scene]:
        """What the egos know that need a decision now. Empty: the episode is over."""
        assert self._simulation is not None, "start() first"
        while True:
            due = {ego.id: self._scene(ego) for ego in self._egos if ego.state == "driving" and self._simulation.time >= ego.due - 1e-9}
            if due:
                return due
            if all(ego.state == "done" for ego in self._egos):
                return {}
            self._step()

    def apply(self, decisions: Mapping[str, Decision]) -> None:
        """Command what was decided for the coming period."""
        for ego in self._egos:
            decision = decisions.get(ego.id)
            if decision is None or ego.commander is None:
                continue
            ego.commander.accept(decision.command)
            ego.due += self.period
            _hash_decision(ego, decision)

    def _scene(self, ego: _Ego) -> Scene:
        assert ego.commander is not None
        sensor = self.config.sensor
        return self._observer.scene(ego.id, ego.commander.change, sensor.range_m, sensor.signals == "timing")

    def _step(self) -> None:
        """One step of the simulation: command, move, judge."""
        assert self._simulation is not None
        self._actors.before_step(self._simulation.time)
        for ego in self._egos:
            if ego.state == "driving" and ego.commander is not None:
                ego.commander.before_step()
        try:
            self._simulation.step()
        except SimulationError as error:
            self._fail_all(str(error))
            return
        for ego in self._egos:
            try:
                if ego.state == "driving":
                    self._judge(ego)
                elif ego.state == "waiting":
                    self._wait(ego)
            except Exception as error:  # libsumo's exceptions share no base; one ego's trouble is not the others'
                self._fail(ego, f"{type(error).__name__}: {error}")

    def _wait(self, ego: _Ego) -> None:
        """Take an ego over as soon as it is on the road."""
        assert self._simulation is not None
        now = self._simulation.time
        if self._observer.present(ego.id):
            self._take_over(ego, now)
        elif now - self._begin >= self.config.episode.depart_limit_s:
            self._fail(ego, f"never departed within {self.config.episode.depart_limit_s:g} s")
        elif self._simulation.finished and not self._simulation.gui:
            self._fail(ego, "never departed: no vehicle is left and none is to come")

    def _take_over(self, ego: _Ego, now: float) -> None:
        state = self._observer.ego(ego.id, _NO_CHANGE)
        ego.commander = Commander(
            ego.id, self.road, self.physics.step, self.physics.change_duration, state.max_accel, max(state.emergency_decel, state.comfort_decel)
        )
        frame = self._observer.frame(ego.id, _NO_CHANGE, None, True)
        try:
            goal = _goal(self.config, self.road, state, ego.until)
        except ConfigError as error:
            self._fail(ego, str(error))
            return
        ego.referee = Referee(self.road, goal, self.physics.step, frame)
        ego.last, ego.due, ego.departed, ego.state = frame, now, now, "driving"

    def _judge(self, ego: _Ego) -> None:
        assert ego.commander is not None
        assert ego.referee is not None
        frame = self._observer.frame(ego.id, ego.commander.change, ego.last, True)
        ego.last = frame
        _hash_state(ego, frame.ego)
        if ego.referee.observe(frame) is not None:
            ego.state = "done"
            ego.commander.release()

    def fail(self, vehicle: str, message: str) -> None:
        """End an ego's episode with outcome `error`."""
        self._fail(next(ego for ego in self._egos if ego.id == vehicle), message)

    def _fail(self, ego: _Ego, message: str) -> None:
        ego.error, ego.state = message, "done"
        if ego.referee is not None:
            ego.referee.fail(message)
        if ego.commander is not None:
            ego.commander.release()

    def _fail_all(self, message: str) -> None:
        for ego in self._egos:
            if ego.state != "done":
                ego.commander = None
                self._fail(ego, message)

    def scripted(self, vehicle: str, now: float, dt: float, count: int) -> Scripted | None:
        """The coming states of a scripted actor: an oracle."""
        script, departed = self._actors.script_of(vehicle), self._actors.departure(vehicle)
        if script is None or departed is None:
            return None
        if vehicle not in self._poses:
            length = self._observer.ego(vehicle, _NO_CHANGE).length
            self._poses[vehicle] = script_poses(self.road, script.lane, script.s, script.d, script.v, self.physics.step, length)
        rows = np.round((now - departed + np.arange(count) * dt) / self.physics.step).astype(int)
        valid = (rows >= 0) & (rows < len(script.v))
        rows = np.clip(rows, 0, len(script.v) - 1)
        return Scripted(self._poses[vehicle][rows], script.v[rows], script.lane[rows], script.s[rows], valid)

    def frame_of(self, vehicle: str) -> Frame | None:
        """The last state of an ego that the referee saw."""
        return next(ego for ego in self._egos if ego.id == vehicle).last

    def finish(self) -> tuple[Row, ...]:
        """Close SUMO; one row an ego, as far as states tell."""
        if self._simulation is not None:
            self._simulation.close()
            self._simulation = None
        self._folder.cleanup()
        rows = []
        for ego in self._egos:
            row = ego.referee.row() if ego.referee is not None else {"outcome": "error", "error": ego.error or "not started"}
            rows.append({**row, "ego": ego.id, "trace_digest": ego.hash.hexdigest()})
        return tuple(rows)


def run_episode(
    config: ScenarioConfig, seed: int | None = None, *, gui: bool = False, sumo_options: Sequence[str] = (), progress: Progress | None = None, variant: str | None = None
) -> EpisodeResult:
    """Run a scenario to its end. Raises ConfigError where the input is wrong; what fails later is an outcome."""
    began = time.perf_counter()
    loop = Loop(config, seed, gui=gui, sumo_options=sumo_options)
    recorders: dict[str, _Recorder] = {}
    try:
        loop.start()
        drivers = {ego.id: Driver(config, loop.road, loop.physics, spread(seed or 0).search, loop.scripted) for ego in config.egos}
        while scenes := loop.scenes():
            decisions = {}
            for ego, scene in scenes.items():
                try:
                    thought = drivers[ego].decide(scene)
                except Exception as error:  # a planner that raises is an outcome, not the end of a batch
                    loop.fail(ego, f"{type(error).__name__}: {error}")
                    continue
                recorders.setdefault(ego, _Recorder()).note(scene, thought)
                decisions[ego] = thought.decision
            loop.apply(decisions)
            if progress is not None:
                progress(_progress_line(scenes))
        ends = {ego.id: loop.frame_of(ego.id) for ego in config.egos}
    finally:
        rows = loop.finish()
    wall = time.perf_counter() - began
    name = variant or default_variant(config)
    full = tuple(_complete(row, config, seed, name, recorders.get(str(row["ego"])), wall, loop.period) for row in rows)
    traces = tuple(_trace(row, config, loop.road, recorders[str(row["ego"])], ends[str(row["ego"])]) for row in full if str(row["ego"]) in recorders)
    return EpisodeResult(full, traces, _manifest(config, seed, loop))


def default_variant(config: ScenarioConfig) -> str:
    """planner-prediction-effort, e.g. mcts-idm-1000."""
    planner = config.planner
    if planner.name in ("sumo", "constant"):
        return planner.name
    effort = str(planner.iterations) if planner.time_budget_ms is None else f"{planner.time_budget_ms:g}ms"
    return f"{planner.name}-{config.prediction.name}-{effort}"


def sumo_arguments(config: ScenarioConfig, seed: int | None, actors: Sequence[Any], folder: Path, extra: Sequence[str]) -> list[str]:
    """SUMO's command line for a scenario."""
    sumo = config.sumo
    for path in [p for p in (sumo.sumocfg, sumo.net, *sumo.routes, *sumo.additional) if p is not None]:
        if not Path(path).is_file():
            raise ConfigError(f"{path}: no such file")
    routes = list(sumo.routes)
    if actors:
        routes.append(str(write_routes(actors, folder)))
    if any("," in path for path in (*routes, *sumo.additional)):
        raise ConfigError("sumo.routes: SUMO splits file names at commas; rename the file")
    arguments: list[str] = []
    if sumo.sumocfg is not None:
        arguments += ["-c", sumo.sumocfg]
    else:
        arguments += ["-n", str(sumo.net), "--time-to-teleport", "-1", "--step-length", str(sumo.step_length_s or DEFAULT_STEP)]
    if sumo.sumocfg is not None and sumo.step_length_s is not None:
        arguments += ["--step-length", str(sumo.step_length_s)]
    if routes:
        arguments += ["-r", ",".join(routes)]
    if sumo.additional:
        arguments += ["-a", ",".join(sumo.additional)]
    if seed is not None:
        arguments += ["--seed", str(seed)]
    for key, value in {**REFEREE_OPTIONS, **sumo.options}.items():
        arguments += [f"--{key}", str(value).lower() if isinstance(value, bool) else str(value)]
    return [*arguments, *ssm_options([ego.id for ego in config.egos], folder), *extra]


class _Recorder:
    """Collects the cycles of one ego."""

    def __init__(self) -> None:
        self.scenes: list[Scene] = []
        self.thoughts: list[Thought] = []

    def note(self, scene: Scene, thought: Thought) -> None:
        self.scenes.append(scene)
        self.thoughts.append(thought)


_ROADS: dict[str, RoadMap] = {}
from sumo_mcts.world.observe import Change  # noqa: E402

_NO_CHANGE = Change()


def _road(net_file: str) -> RoadMap:
    """The road map of a network, read once in a process."""
    key = f"{net_file}:{Path(net_file).stat().st_mtime_ns}"
    if key not in _ROADS:
        _ROADS[key] = read_roadmap(net_file)
    return _ROADS[key]


def _change_duration() -> float:
    """How long a lane change takes in the running simulation, s; in the sublane model about a lane's width at 1 m/s."""
    return 3.0 if float(option("lateral-resolution")) > 0 else float(option("lanechange.duration"))


def _goal(config: ScenarioConfig, road: RoadMap, ego: EgoState, until: str | None) -> Goal:
    """Where the ego has to go. Raises ConfigError where it cannot get there."""
    if -1 in ego.route or not ego.route:
        raise ConfigError(f"{ego.id}: its route leaves the network")
    edges = ego.route
    if until is not None:
        goal = road.edge_ids.index(until)
        if goal not in edges:
            raise ConfigError(f"{ego.id}: its route does not pass edge {until}")
        edges = edges[: edges.index(goal) + 1]
    success = -1 if config.episode.success_edge is None else road.edge_ids.index(config.episode.success_edge)
    if success >= 0 and success not in edges:  # the success point may lie beyond the goal
        if success not in ego.route:
            raise ConfigError(f"episode.success_edge: the route of {ego.id} does not pass {config.episode.success_edge}")
        edges = ego.route[: ego.route.index(success) + 1]
    free = free_flow_time(road, edges, ego.s, ego.speed_factor, ego.max_speed)
    limit = config.episode.stop_time_s or config.episode.time_limit_s or LOST_LEG * free + LIMIT_SLACK
    return Goal(edges, success, limit, free)


def _micro(x: float) -> int:
    return round(x * 1e6) if math.isfinite(x) else -1


def _hash_state(ego: _Ego, state: EgoState) -> None:
    ego.hash.update(np.array([state.lane, _micro(state.s), _micro(state.v), _micro(state.x), _micro(state.y)], np.int64).tobytes())


def _hash_decision(ego: _Ego, decision: Decision) -> None:
    command = decision.command
    if isinstance(command, Follow):
        ego.hash.update(np.array([1, command.lane_change, *(_micro(v) for v in command.speeds)], np.int64).tobytes())
        ego.hash.update(np.array([child.visits for child in decision.children], np.int64).tobytes())
    else:
        ego.hash.update(b"release")


def _progress_line(scenes: Mapping[str, Scene]) -> str:
    scene = next(iter(scenes.values()))
    return f"{scene.time:.1f} s  {scene.ego.id} at {scene.ego.v:.1f} m/s, {len(scene.agents.ids)} in range"


def _complete(row: Row, config: ScenarioConfig, seed: int | None, variant: str, recorder: _Recorder | None, wall: float, period: float) -> Row:
    """The row with what is known about the planner."""
    ego = str(row["ego"])
    thoughts = recorder.thoughts if recorder else []
    searched = [t for t in thoughts if t.decision.iterations or t.decision.known]
    times = np.array([t.plan_ms for t in thoughts])
    deadline = period if config.planner.time_budget_ms is None else config.planner.time_budget_ms / 1000.0
    simulated = (recorder.scenes[-1].time - recorder.scenes[0].time + period) if recorder and recorder.scenes else 0.0
    quantile = (lambda q: float(np.percentile(times, q))) if len(times) else (lambda q: None)
    return {
        **records.row_defaults(),
        **row,
        "key": records.episode_key(config.name, variant, seed or 0, ego if len(config.egos) > 1 else None),
        "scenario": config.name, "variant": variant, "planner": config.planner.name,
        "prediction": config.prediction.name if config.planner.name in ("mcts", "paper") else None, "seed": seed,
        "decision_flips": _flips(thoughts), "iterations_per_decision": config.planner.iterations if searched else None,
        "iterations": sum(t.decision.iterations for t in thoughts), "cycles": len(thoughts), "deadline_s": deadline,
        "deadline_misses": int((times > deadline * 1000.0).sum()), "plan_ms_p50": quantile(50), "plan_ms_p95": quantile(95), "plan_ms_p99": quantile(99),
        "plan_ms_max": quantile(100), "wall_s": wall, "realtime_factor": simulated / wall if wall > 0 else None, "config_digest": digest(config),
    }  # fmt: skip


def _flips(thoughts: Sequence[Thought]) -> int:
    """How often the plan of the coming second turned from accelerating to braking or back."""
    signs = []
    for thought in thoughts:
        plan = thought.decision.plan
        if plan is not None and len(plan.v) > 1:
            k = min(len(plan.v) - 1, int(np.searchsorted(plan.time, 1.0)))
            gained = float(plan.v[k] - plan.v[0]) / max(float(plan.time[k] - plan.time[0]), 1e-9)
            signs.append(1 if gained > 0.5 else -1 if gained < -0.5 else 0)
    firm = [s for s in signs if s != 0]
    return sum(a != b for a, b in zip(firm, firm[1:], strict=False))


def _trace(row: Row, config: ScenarioConfig, road: RoadMap, recorder: _Recorder, end: Frame | None) -> Trace:
    cycles = []
    for k, (scene, thought) in enumerate(zip(recorder.scenes, recorder.thoughts, strict=True)):
        after = recorder.scenes[k + 1] if k + 1 < len(recorder.scenes) else None
        cycles.append(_cycle(scene, thought, after))
    where = np.array([[s.ego.x, s.ego.y] for s in recorder.scenes])
    return Trace(str(row["key"]), config.name, str(row["outcome"]), records.lanes_around(road, recorder.scenes[0].ego.route, where, 90.0), tuple(cycles))


def _cycle(scene: Scene, thought: Thought, after: Scene | None) -> CycleRecord:
    plan = thought.decision.plan
    speed, lane, deviation = math.nan, -1, ""
    if after is not None and plan is not None and len(plan.v):
        k = min(round((after.time - scene.time) / scene.step) - 1, len(plan.v) - 1)
        speed, lane = float(plan.v[k]), int(plan.lane[k])
        if abs(speed - after.ego.v) > 0.05:
            deviation = f"speed {after.ego.v:.2f} instead of {speed:.2f} m/s"
        elif lane != after.ego.lane:
            deviation = "SUMO has the ego on another lane"
    forecast = thought.forecast if thought.forecast is not None else _NO_FORECAST
    return CycleRecord(
        scene.time, scene.step, scene.ego, scene.agents, scene.signals, forecast, thought.decision, thought.plan_ms, speed,
        after.ego.v if after is not None else math.nan, lane, after.ego.lane if after is not None else -1, deviation, thought.decision.reason,
    )  # fmt: skip


def _no_forecast() -> Any:
    from sumo_mcts.driver import _nothing

    return _nothing(0.2)


_NO_FORECAST = _no_forecast()


def _manifest(config: ScenarioConfig, seed: int | None, loop: Loop) -> dict[str, Any]:
    return {
        "schema_version": records.SCHEMA_VERSION, "scenario": config.model_dump(mode="json"), "config_digest": digest(config), "seed": seed,
        "versions": records.versions(), "sumo_arguments": [a for a in loop.arguments], "set_by_referee": REFEREE_OPTIONS,
        "step_s": loop.physics.step, "reproducible": config.planner.time_budget_ms is None and not config.planner.deadline,
    }  # fmt: skip
