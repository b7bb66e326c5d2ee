"""A gymnasium environment over the same loop and the same referee.

`import sumo_mcts.gym`, then gymnasium.make("sumo_mcts/Drive-v0").
"""

import math
import time
from collections.abc import Mapping, Sequence
from numbers import Real
from os import PathLike
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from sumo_mcts.config import whole
from sumo_mcts.driver.driver import Driver, PlanningResult
from sumo_mcts.driver.observation import Actions, Observation, Shown, bounds, observe
from sumo_mcts.driver.params import streams
from sumo_mcts.episode.launch import LaunchOptions
from sumo_mcts.episode.loop import Loop
from sumo_mcts.episode.recorder import Recorder
from sumo_mcts.episode.run import completed
from sumo_mcts.errors import ConfigError
from sumo_mcts.evaluation.referee import ARRIVED, COLLISION, ERROR, OFF_ROUTE, TELEPORTED, TIMEOUT
from sumo_mcts.model.local_map import State
from sumo_mcts.planners.base import Situation, Task
from sumo_mcts.records import Row, Setting
from sumo_mcts.reporting.birdseye import picture
from sumo_mcts.scenarios import load_scenario
from sumo_mcts.scene import Decision, Release
from sumo_mcts.world.arguments import without_outputs
from sumo_mcts.world.library import is_running

ENVIRONMENT = "sumo_mcts/Drive-v0"
NAME = "policy"  # of the planner, in rows
SEEDS = 2**31  # SUMO's seeds are below

# The weight of each term of the reward of one decision period; the referee measures all of them.
REWARD = {
    "progress": 0.1,  # per metre driven
    "time": -0.1,  # per second
    "discomfort": -0.5,  # per second beyond the bounds of the row's `comfortable_share`
    # per braking beyond 2, 3 and 4 m/s2 that is imposed on another vehicle: one beyond 4 counts
    # three times
    "imposed": -2.0,
    "red": -20.0,  # per red light run
    "collision": -100.0,
    "lost": -50.0,  # off its route, or teleported by SUMO
    "arrived": 20.0,
}


class DriveEnv(gymnasium.Env[Observation, np.int64]):
    """One ego of a scenario, from its departure to the referee's outcome; one step is one decision
    period.

    Observation: see driver/observation.py::bounds. Action: an index into `actions`, the
    acceleration and lane change of each. Terminated: the referee has an outcome; truncated: that
    outcome is `timeout`. The last observation of an episode is that of its last decision, since the
    ego may be gone.

    libsumo holds one simulation in a process, so the environment that was reset last drives; for
    several use gymnasium.vector.AsyncVectorEnv.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 2}  # noqa: RUF012  # as gymnasium declares it; fps: decisions
    _current: ClassVar["DriveEnv | None"] = None  # the one that drives in this process

    # Twelve parameters: gymnasium.make() passes all of an environment's settings as keywords.
    def __init__(
        self, scenario: str | PathLike[str] = "unprotected-left-turn", *,
        sumocfg: str | PathLike[str] | None = None, ego: str | None = None,
        until: str | None = None, assignments: Sequence[str] = (),
        sumo_options: Sequence[str] = (), agents: int = Shown().agents,
        points: int = Shown().points, reward: Mapping[str, float] | None = None,
        render_mode: str | None = None, allow_plugins: bool = False,
    ) -> None:  # fmt: skip
        """Check everything, start nothing. Raises ConfigError.

        scenario, ego, until, assignments, allow_plugins: as in load_scenario
        sumocfg: in place of a scenario, together with `ego`
        sumo_options: as on SUMO's command line
        agents, points: how many agents and points of the route an observation holds
        reward: weights in place of those in REWARD
        render_mode: None or "rgb_array"
        """
        if ego == "any":
            raise ConfigError(
                "ego: any: name one vehicle; `sumo-mcts run FILE.sumocfg` lists the candidates"
            )
        self._config = load_scenario(
            scenario if sumocfg is None else sumocfg,
            *assignments,
            ego=() if ego is None else ego,
            until=until,
            allow_plugins=allow_plugins,
        )
        if len(self._config.egos) != 1:
            raise ConfigError(
                f"{scenario}: egos: an environment has one, not {len(self._config.egos)}; name it "
                "with ego="
            )
        self._ego, self._weights = self._config.egos[0].id, _weights(reward)
        self._options = (*sumo_options, *without_outputs(self._config.sumo, sumo_options))
        self._shown = Shown(whole("agents", agents, 1), whole("points", points, 1))
        self._planner = _ActionPlanner(Actions(self._config))
        self.actions = self._planner.actions.table  # [A, 2]
        self.action_space = spaces.Discrete(len(self.actions))
        boxes: dict[str, spaces.Space[Any]] = {
            name: spaces.Box(low, high) for name, (low, high) in bounds(self._shown).items()
        }
        self.observation_space = spaces.Dict(boxes)  # type: ignore[assignment]  # a dict of arrays, which its type does not say
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ConfigError(f"render_mode: {render_mode}: not one of rgb_array, None")
        self.render_mode = render_mode
        self.metadata = {
            **self.metadata,
            "render_fps": max(1, round(1.0 / self._config.planner.period_s)),
        }
        self._loop: Loop | None = None
        self._lost_to_another = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode: with a seed that of `sumo-mcts run --seed`, without one the next
        episode that the last seed draws.

        Raises ConfigError where the input is wrong, RuntimeError where there is nothing to decide.
        """
        super().reset(seed=seed)
        self._take_over()
        self._seed = int(self.np_random.integers(SEEDS)) if seed is None else seed % SEEDS
        self._began, self._recorder = time.perf_counter(), Recorder()
        try:
            launch = LaunchOptions(sumo_options=self._options)
            self._loop = loop = Loop(self._config, self._seed, launch)
            physics = loop.world.physics
            self._driver = Driver(
                self._config,
                loop.world.road,
                physics,
                streams(self._seed).search,
                loop.oracles,
                planner=self._planner,
            )
            drives = self._drive_on(loop)
        except BaseException:
            self.close()
            raise
        if not drives:
            row = self._end(loop)
            raise RuntimeError(
                f"{row['scenario']}: seed {self._seed}: {row['outcome']} before the first "
                f"decision: {row['error']}"
            )
        self._start, self._totals = loop.time, self._measured(loop, loop.time)
        return self._observation(), {}

    def step(self, action: np.int64) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive one decision period.

        `info["reward"]` has the parts of the reward; at the end `info["row"]` is the row of
        docs/measures.md.
        """
        if self._loop is None:
            raise gymnasium.error.ResetNeeded(_TAKEN if self._lost_to_another else _FIRST)
        if not self.action_space.contains(action):
            raise ValueError(f"action: {action!r}: allowed: 0 to {len(self.actions) - 1}")
        loop = self._loop
        self._planner.action = int(action)
        result = self._driver.decide(self._scene)
        elapsed_ms = (time.perf_counter() - self._shown_at) * 1000.0
        self._recorder.note(self._scene, result._replace(plan_ms=elapsed_ms))
        loop.apply({self._ego: result.decision})
        drives = self._drive_on(loop)
        # after an error SUMO itself may be gone: nothing more is measured
        failed = loop.judged(self._ego)["outcome"] == ERROR
        totals = self._totals if failed else self._measured(loop, self._start)
        parts = {name: self._weights[name] * (totals[name] - self._totals[name]) for name in REWARD}
        self._totals = totals
        info: dict[str, Any] = {"reward": parts}
        outcome = None
        if not drives:
            info["row"] = row = self._end(loop)
            outcome = row["outcome"]
        return (
            self._observation(),
            float(sum(parts.values())),
            outcome not in (None, TIMEOUT),
            outcome == TIMEOUT,
            info,
        )

    def render(self) -> NDArray[np.uint8] | None:
        """[height, width, 3] the last scene from above with render_mode="rgb_array", else None."""
        if self.render_mode is None:
            return None
        if not hasattr(self, "_scene"):  # which reset() sets
            raise gymnasium.error.ResetNeeded(_FIRST)
        recorder, decision = Recorder(), Decision(Release(), None, (), -1, NAME, 0, 0)
        recorder.note(self._scene, PlanningResult(decision, forecast=None, plan_ms=0.0))
        trace = recorder.trace("", self._config.name, "", self._road, Setting())
        assert trace is not None, "a scene was noted"
        return np.asarray(picture(trace, self._scene.time)[0].convert("RGB"))

    def close(self) -> None:
        """End the episode and SUMO."""
        if self._loop is not None:
            self._loop.close()
            self._loop = None
        if DriveEnv._current is self:
            DriveEnv._current = None

    def _take_over(self) -> None:
        """End the episode of another environment in this process.

        Raises RuntimeError where a simulation runs that is not an environment's.
        """
        other = DriveEnv._current
        if other is not None:
            other.close()
            other._lost_to_another = other is not self
        elif is_running():
            raise RuntimeError(
                "a simulation runs in this process already, and libsumo holds one: close it first"
            )
        DriveEnv._current, self._lost_to_another = self, False

    def _drive_on(self, loop: Loop) -> bool:
        """Drive to the next scene in which the agent decides; False where the episode is over.

        SUMO drives an ego that is not on its route, and has it stand at its stops.
        """
        while scenes := loop.scenes():
            self._scene, self._road = scenes[self._ego], loop.world.road
            placed = None if self._scene.ego.held else self._driver.placed(self._scene)
            if placed is not None:
                self._placed: tuple[Task, State] = placed
                self._shown_at = time.perf_counter()
                return True
            loop.apply({self._ego: self._driver.decide(self._scene).decision})
        return False

    def _observation(self) -> Observation:
        """What the agent is shown of the present scene."""
        return observe(*self._placed, self._scene, self._shown)

    def _measured(self, loop: Loop, start: float) -> dict[str, float]:
        """The total of each term of the reward so far, without its weight.

        `start`: simulation time of the first decision, s.
        """
        row, passed = loop.judged(self._ego), loop.time - start
        share = 1.0 if row["comfortable_share"] is None else row["comfortable_share"]
        return {
            "progress": row["distance_m"],
            "time": passed,
            "discomfort": (1.0 - share) * passed,
            "imposed": row["imposed_brakes_2"] + row["imposed_brakes_3"] + row["imposed_brakes_4"],
            "red": row["red_lights_run"],
            "collision": float(row["outcome"] == COLLISION),
            "lost": float(row["outcome"] in (OFF_ROUTE, TELEPORTED)),
            "arrived": float(row["outcome"] == ARRIVED),
        }

    def _end(self, loop: Loop) -> Row:
        """Close SUMO, and give the whole row."""
        period = loop.world.period
        (row,) = loop.rows()
        self.close()
        wall = time.perf_counter() - self._began
        row = completed(row, self._config, self._seed, NAME, self._recorder, period, wall)
        return {**row, "planner": NAME}


class _ActionPlanner:
    """The planner that executes the agent's action."""

    needs_forecast = True

    def __init__(self, actions: Actions) -> None:
        self.actions, self.action = actions, 0

    def start(self, task: Task, seed: int) -> None:
        """Take the ego over."""
        self._task = task

    def plan(self, situation: Situation) -> Decision:
        """Begin the action."""
        return self.actions.decision(self._task, situation, self.action)


_FIRST = "call reset() first: no episode is under way"
_TAKEN = (
    "another environment was reset in this process and drives now: libsumo holds one simulation. "
    "For several at once use gymnasium.vector.AsyncVectorEnv, "
    "which gives each a process of its own"
)


def _weights(given: Mapping[str, float] | None) -> dict[str, float]:
    """The weights of the reward's terms. Raises ConfigError."""
    if given is not None and not isinstance(given, Mapping):
        raise ConfigError(f"reward: a mapping of terms to weights, got {given!r:.60}")
    for name, weight in (given or {}).items():
        if name not in REWARD:
            raise ConfigError(f"reward: {name}: unknown term; allowed: {', '.join(REWARD)}")
        if not isinstance(weight, Real) or not math.isfinite(weight):
            raise ConfigError(f"reward: {name}: a finite number, got {weight!r:.60}")
    return {**REWARD, **{name: float(weight) for name, weight in (given or {}).items()}}


gymnasium.register(ENVIRONMENT, entry_point="sumo_mcts.gym:DriveEnv")
