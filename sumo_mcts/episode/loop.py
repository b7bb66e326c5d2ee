"""A scenario that runs: steps SUMO until an ego needs a decision, takes the decisions, gives the
rows."""

import contextlib
import hashlib
import math
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from sumo_mcts.config import EgoConfig, ScenarioConfig
from sumo_mcts.driver.forecaster import as_seen
from sumo_mcts.driver.params import ego_params, streams
from sumo_mcts.driver.vehicle import EgoVehicle, World, never_departed, running_world
from sumo_mcts.episode.goals import check_edges, goal_of
from sumo_mcts.errors import ConfigError, of_machine
from sumo_mcts.evaluation.hindsight import Future, Hindsight
from sumo_mcts.evaluation.referee import COLLISION, Goal, Referee
from sumo_mcts.prediction.interface import Oracles
from sumo_mcts.prediction.script_poses import script_poses
from sumo_mcts.records import Row
from sumo_mcts.scene import Decision, EgoState, Floats, Follow, Frame, Release, Scene, Scripted
from sumo_mcts.world import clone
from sumo_mcts.world import gui as window
from sumo_mcts.world.actors import Actors
from sumo_mcts.world.arguments import network_of, sumo_arguments, window_delay_ms
from sumo_mcts.world.candidates import NAMED, require_named
from sumo_mcts.world.crowd import cast
from sumo_mcts.world.roadmap import known_roadmap
from sumo_mcts.world.scripts import check
from sumo_mcts.world.simulation import Simulation, SimulationError

WAITING_NEWS_S = 30.0  # between two words about an ego that has not departed
MOST_REDRAWN = 20  # draws in a row without a way out: it is not the draw's fault
Progress = Callable[[str], None]


class _Ego:
    """One ego of a scenario, from waiting for its departure to its outcome."""

    def __init__(self, config: EgoConfig, noise: np.random.SeedSequence) -> None:
        self.id, self.until, self.noise = config.id, config.until, noise
        self.pilot: EgoVehicle | None = None  # None: not departed, or over
        self.referee: Referee | None = None
        self.hindsight: Hindsight | None = (
            None  # None: somebody reacts, so nobody knows what would have come
        )
        self.inevitable: bool | None = None
        self.error: str | None = None
        self.done = False
        self.digest = _Digest()

    def row(self) -> Row:
        """What states alone tell."""
        judged = (
            self.referee.row()
            if self.referee is not None
            else {"outcome": "error", "error": self.error or "not started"}
        )
        return {
            **judged,
            "ego": self.id,
            "inevitable": self.inevitable,
            "trace_digest": self.digest.text(),
        }


class Loop:
    """A scenario that runs:

    `scenes()` advances SUMO until an ego needs a decision, `apply()` takes the decisions.
    """

    def __init__(
        self,
        config: ScenarioConfig,
        seed: int | None,
        *,
        gui: bool = False,
        sumo_options: Sequence[str] = (),
        progress: Progress | None = None,
        measured: Sequence[str] = (),
    ) -> None:
        """`seed` None:

        SUMO keeps its own. `sumo_options` as on SUMO's command line; `progress` is told what the
        loop waits for; `measured` as in `run_episode`.
        """
        self.config, self.seed = config, seed
        self._gui, self._options, self._progress = gui, tuple(sumo_options), progress
        self._measured = {*measured, *(ego.id for ego in config.egos)}
        self._egos = [
            _Ego(*each)
            for each in zip(config.egos, streams(seed).noise.spawn(len(config.egos)), strict=True)
        ]
        self._folder = tempfile.TemporaryDirectory(prefix="sumo_mcts-")
        self._simulation: Simulation | None = None
        self._traffic = np.random.default_rng(streams(seed).traffic)
        self.redrawn = 0  # draws thrown away, since the ego had no way out at its start

    def start(self) -> None:
        """Start SUMO with the next draw of the actors.

        Raises ConfigError where the input is wrong.
        """
        config = self.config
        if config.prediction.name == "clone":
            clone.require_possible(self._gui)
        road = known_roadmap(
            network_of(config.sumo.sumocfg, config.sumo.net)
        )  # SUMO itself does not survive every network
        check_edges(config, road)
        drawn = cast(config.traffic, [ego.id for ego in config.egos], road, self._traffic)
        actors = drawn.actors
        self.arguments = sumo_arguments(
            config, self.seed, drawn, Path(self._folder.name), self._options, self._measured
        )
        for actor in actors:
            check(actor, road)
        self._simulation = Simulation(
            self.arguments, gui=self._gui, delay_ms=window_delay_ms(config.sumo)
        )
        if config.prediction.name == "clone":
            clone.require_copyable()
        require_named([ego.id for ego in self._egos], [actor.id for actor in actors])
        self.world: World = running_world(config.planner.period_s)
        physics, egos = self.world.physics, [ego.id for ego in self._egos]
        self._actors = Actors(
            actors,
            self.world.road,
            physics.step,
            events=config.traffic.events,
            egos=egos,
            change_s=physics.change_duration,
        )
        self._varied = actors != config.traffic.actors  # else the next draw is the same
        self._departed: list[str] = []  # the first few vehicles that did
        self._script_poses: dict[str, Floats] = {}
        self._begin = self._news_due = self._simulation.time

    def scenes(self) -> dict[str, Scene]:
        """What the egos know that need a decision now. Empty: the episode is over."""
        while not all(ego.done for ego in self._egos):
            due = {}
            for ego in self._egos:
                if ego.pilot is not None and ego.pilot.due():
                    with self._only_for(ego):
                        due[ego.id] = ego.pilot.scene()
            if due:
                return due
            self._step()
        return {}

    def apply(self, decisions: Mapping[str, Decision]) -> None:
        """Command what was decided for the coming period."""
        for ego in self._egos:
            decision = decisions.get(ego.id)
            if ego.pilot is None or decision is None:
                continue
            with self._only_for(ego):
                ego.pilot.accept(decision)
                ego.digest.add_decision(decision)
                if self._gui:
                    window.draw_plan(
                        ego.id,
                        decision.plan.pose if decision.plan is not None else np.zeros((0, 4)),
                    )

    def judged(self, vehicle: str) -> Row:
        """What the row of an ego would be if the episode ended now, as far as states tell."""
        return next(ego for ego in self._egos if ego.id == vehicle).row()

    @property
    def time(self) -> float:
        """Simulation time, s."""
        assert self._simulation is not None, "start() first"
        return self._simulation.time

    def fail(self, vehicle: str, message: str) -> None:
        """End an ego's episode with outcome `error`."""
        self._fail(next(ego for ego in self._egos if ego.id == vehicle), message)

    def rows(self) -> tuple[Row, ...]:
        """One row an ego, as far as states tell."""
        return tuple(ego.row() for ego in self._egos)

    def close(self) -> None:
        """Close SUMO."""
        if self._simulation is not None:
            self._simulation.close()
            self._simulation = None
        self._folder.cleanup()

    @property
    def oracles(self) -> Oracles:
        """For forecasts that are labelled so."""
        return Oracles(self.world.observer.way, self.scripted, self.copied)

    def scripted(self, vehicle: str, now: float, dt: float, count: int) -> Scripted | None:
        """The coming `count` states of a scripted actor, `dt` s apart: an oracle."""
        script, departed = self._actors.script_of(vehicle), self._actors.departure(vehicle)
        if script is None or departed is None:
            return None
        step = self.world.physics.step
        if vehicle not in self._script_poses:
            length, _ = self._actors.size(vehicle)
            self._script_poses[vehicle] = script_poses(
                self.world.road, script.lane, script.s, script.d, script.v, step, length
            )
        rows = np.round((now - departed + np.arange(count) * dt) / step).astype(int)
        valid = (rows >= 0) & (rows < len(script.v))
        rows = np.clip(rows, 0, len(script.v) - 1)
        return Scripted(
            self._script_poses[vehicle][rows],
            script.v[rows],
            script.lane[rows],
            script.s[rows],
            valid,
        )

    def copied(
        self, scene: Scene, nominal: Follow | Release, dt: float, count: int
    ) -> dict[int, Scripted]:
        """The coming `count` states of the scene's agents, `dt` s apart, if its ego does what is
        nominal: an oracle. Raises SimulationError.

        Everybody else does what it will do; egos carry on with what they were told, then SUMO's own
        driver does. Who is not there yet is left out.
        """
        every = max(1, round(dt / self.world.physics.step))
        rows = math.ceil((count - 1) * dt / (every * self.world.physics.step) - 1e-9) + 1
        states = clone.in_copy(
            lambda: self._rehearse(scene, nominal, every, rows), (rows, len(scene.agents.ids), 8)
        )
        return clone.at_times(states, every * self.world.physics.step, dt, count)

    def _rehearse(self, scene: Scene, nominal: Follow | Release, every: int, rows: int) -> Floats:
        """[rows, N, 8] the states of the agents now and after each `every` steps: for a copy of the
        simulation, which it moves on."""
        assert self._simulation is not None, "start() first"
        pilots = {ego.id: ego.pilot for ego in self._egos if ego.pilot is not None}
        pilots[scene.ego.id].accept(Decision(nominal, None, (), -1, "nominal", 0, 0))
        read = self.world.observer.states
        states = [read(scene.agents.ids)]
        for k in range(1, (rows - 1) * every + 1):
            self._actors.before_step(self._simulation.time)
            for pilot in pilots.values():
                pilot.rehearse_step()
            self._simulation.step()
            now = read(scene.agents.ids)  # each step, as the original does: it remembers lanes
            if k % every == 0:
                states.append(now)
        return np.array(states)

    def _futures(self, now: float, count: int) -> list[Future]:
        """The coming `count` states of every scripted actor, a step apart."""
        scripts = {
            vehicle: self.scripted(vehicle, now, self.world.physics.step, count)
            for vehicle in self._actors.scripted
        }
        return [
            Future(script, *self._actors.size(vehicle))
            for vehicle, script in scripts.items()
            if script is not None
        ]

    def _step(self) -> None:
        """One step of the simulation: command, move, judge."""
        assert self._simulation is not None, "start() first"
        self._actors.before_step(self._simulation.time)
        for ego in self._egos:
            if ego.pilot is not None:
                with self._only_for(ego):
                    ego.pilot.before_step()
        try:
            self._simulation.step()
        except SimulationError as error:
            self._fail_all(str(error))
            return
        self._departed = [*self._departed, *self._simulation.departed()][:NAMED]
        for ego in self._egos:
            with self._only_for(ego):
                if ego.pilot is not None:
                    self._judge(ego, ego.pilot)
                elif not ego.done:
                    self._wait(ego, self._simulation)

    @contextlib.contextmanager
    def _only_for(self, ego: _Ego) -> Iterator[None]:
        """One ego's trouble is not the others'; wrong input concerns everybody."""
        try:
            yield
        except ConfigError:
            raise
        except Exception as error:  # libsumo's exceptions share no base
            if of_machine(error):
                raise
            self._fail(ego, f"{type(error).__name__}: {error}")

    def _wait(self, ego: _Ego, simulation: Simulation) -> None:
        """Take an ego over as soon as it is on the road."""
        if self.world.observer.present(ego.id):
            self._take_over(ego)
            return
        waited, ended = (
            simulation.time - self._begin,
            simulation.end if simulation.time >= simulation.end else None,
        )
        why = never_departed(waited, self.config.episode.depart_limit_s, simulation.finished, ended)
        if why:
            self._fail(
                ego,
                why
                + (f"; the first that did: {', '.join(self._departed)}" if self._departed else ""),
            )
        elif self._progress is not None and simulation.time >= self._news_due:
            self._news_due = simulation.time + WAITING_NEWS_S
            self._progress(f"{simulation.time:.1f} s  waiting for {ego.id}")

    def _take_over(self, ego: _Ego) -> None:
        self._actors.limit(ego.id)
        pilot = EgoVehicle(ego.id, self.config, self.world, ego.noise)
        frame = pilot.look()
        goal = goal_of(self.config, self.world.road, frame.ego, ego.until)
        ego.hindsight = self._hindsight(goal, frame)
        if ego.hindsight is not None and self._varied and ego.hindsight.inevitable():
            self._redraw(ego)
            return
        ego.referee = Referee(self.world.road, goal, self.world.physics.step, frame)
        ego.pilot = pilot
        if self._gui and ego is self._egos[0]:
            window.follow(ego.id)

    def _hindsight(self, goal: Goal, take_over: Frame) -> Hindsight | None:
        """From the take-over on; None where others react."""
        ego, world = take_over.ego, self.world
        if not self._actors.only_scripts_beside(ego.id):
            return None
        hindsight = Hindsight(
            world.road, goal, ego, ego_params(self.config, ego, world.physics), self._futures
        )
        hindsight.note(self._whole(take_over))
        return hindsight

    def _whole(self, frame: Frame) -> Scene:
        """The scene of a frame, whatever sensors would see of it."""
        ego, world = frame.ego, self.world
        return Scene(
            frame.time,
            world.physics.step,
            as_seen(world.road, ego),
            frame.agents,
            world.observer.timing(ego.x, ego.y),
        )

    def _redraw(self, ego: _Ego) -> None:
        """Start anew with the next draw."""
        if self.redrawn == MOST_REDRAWN:
            self._fail(
                ego,
                f"inevitable at its start in each of {self.redrawn + 1} draws: no motion of the "
                "ego is free of contacts",
            )
            return
        assert self._simulation is not None
        self.redrawn += 1
        self._simulation.close()
        self._simulation = None
        self.start()

    def _judge(self, ego: _Ego, pilot: EgoVehicle) -> None:
        assert ego.referee is not None
        frame = pilot.look()
        ego.digest.add_state(frame.ego)
        if ego.hindsight is not None:
            ego.hindsight.note(self._whole(frame))
        outcome = ego.referee.observe(frame)
        if outcome is None:
            return
        ego.done, ego.pilot = True, None
        pilot.release()
        if (
            outcome == COLLISION
            and ego.hindsight is not None
            and self._actors.only_scripts_beside(ego.id)
        ):
            ego.inevitable = ego.hindsight.inevitable()

    def _fail(self, ego: _Ego, message: str) -> None:
        pilot, ego.pilot = ego.pilot, None
        ego.error, ego.done = message, True
        if ego.referee is not None:
            ego.referee.fail(message)
        if pilot is not None:
            with contextlib.suppress(Exception):  # SUMO itself may be what failed
                pilot.release()

    def _fail_all(self, message: str) -> None:
        """SUMO is gone: nothing can be handed back."""
        for ego in self._egos:
            ego.pilot = None
            if not ego.done:
                self._fail(ego, message)


class _Digest:
    """SHA-256 over decisions and executed states, rounded to micrometres; no timings."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()

    def add_state(self, ego: EgoState) -> None:
        """What SUMO made of a step."""
        self._add([ego.lane, *map(_micro, (ego.s, ego.v, ego.x, ego.y))])

    def add_decision(self, decision: Decision) -> None:
        """What is to be done, and how the search came to it."""
        command = decision.command
        if isinstance(command, Follow):
            self._add([1, command.lane_change, *map(_micro, command.speeds)])
            self._add([child.visits for child in decision.children])
        else:
            self._hash.update(b"release")

    def text(self) -> str:
        """The digest so far, in hexadecimal."""
        return self._hash.hexdigest()

    def _add(self, numbers: Sequence[int]) -> None:
        self._hash.update(np.array(numbers, np.int64).tobytes())


def _micro(x: float) -> int:
    return round(x * 1e6) if math.isfinite(x) else -1
