"""What every planner is given, and what it has to return."""

import math
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from sumo_mcts.arrays import Words
from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.model.local_build import build_locals
from sumo_mcts.model.local_map import LocalMap, State
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.model.oncoming import Sight
from sumo_mcts.model.route import RouteMap
from sumo_mcts.model.sideways import Path
from sumo_mcts.model.stop_lines import Rules
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Decision, Forecast, PlannerMemory, Scene

STOP_DECEL = 3.0  # m/s2 beyond which no driver has to stop for yellow (measures: yellow_run)


class Task(NamedTuple):
    """What a planner gets once, when it takes the ego over (and again when the ego's route, the
    road or the ego's type changes)."""

    road: RoadMap
    route: RouteMap
    ego: EgoParams
    cost: CostParams
    sight: Sight = Sight()


class Situation(NamedTuple):
    """What a planner gets each cycle."""

    scene: Scene
    state: State
    forecast: Forecast
    cleared: frozenset[int]  # route nodes at whose stop line the ego has stood
    # time.perf_counter() at which a search has to end; inf: iterations count
    until: float = math.inf
    path: Path | None = None  # within its lanes; None: in the middle of them


def local_of(
    task: Task, situation: Situation, reactive: int = 0, asked: int = 0, patience: float = 1.0
) -> LocalMap:
    """What one cycle's search reads, in the likeliest hypothesis of the forecast; see locals_of."""
    return locals_of(task, situation, 1, reactive, asked, patience)[0]


def locals_of(
    task: Task,
    situation: Situation,
    count: int,
    reactive: int = 0,
    asked: int = 0,
    patience: float = 1.0,
) -> list[LocalMap]:
    """What one cycle's search reads, in each of the first `count` hypotheses of the forecast.

    It may move at most `reactive` agents, or else those that make room on the side `asked`;
    `asked` and `patience` as in LocalMap.
    """
    rules = Rules(
        cleared=situation.cleared,
        stop_decel=STOP_DECEL,
        claim_s=task.cost.claim_s,
        asked=asked,
        patience=patience,
        reactive=reactive,
        sight=task.sight,
    )
    path = situation.path
    route = task.route if path is None else task.route._replace(rows=path.rows)
    return build_locals(
        task.road, route, situation.state, situation.scene, situation.forecast, rules, count
    )


class Planner(Protocol):
    """From a situation to a decision. One object drives one ego for one episode.

    With a member `weighs_hypotheses` that is true its forecasts may hold several hypotheses.
    """

    needs_forecast: bool

    def start(self, task: Task, seed: int) -> None:
        """Take the ego over."""

    def plan(self, situation: Situation) -> Decision:
        """Decide for the coming decision period."""


@runtime_checkable
class Remembering(Protocol):
    """A planner whose decisions depend on earlier ones. Others have nothing to remember."""

    def memory(self) -> PlannerMemory:
        """What the next decision depends on, beside the situation; asked after `start`."""

    def recall(self, memory: PlannerMemory) -> None:
        """Go on from this memory; called after `start`."""


class SeededPlanner:
    """What planners have in common that read a forecast and draw at random."""

    needs_forecast = True

    def start(self, task: Task, seed: int) -> None:
        """Take the ego over."""
        self._task = task
        self._rng = np.random.Generator(np.random.PCG64(seed))

    def memory(self) -> PlannerMemory:
        """What it has drawn so far."""
        return PlannerMemory(generator=_words(self._rng))

    def recall(self, memory: PlannerMemory) -> None:
        """Go on drawing from there."""
        self._rng = _generator(memory.generator)


_LOW = (1 << 64) - 1


def _words(rng: np.random.Generator) -> Words:
    """[6] the state of a PCG64 generator: state and increment, high and low, and what is left of
    the last draw."""
    kept: Any = rng.bit_generator.state
    state, increment = kept["state"]["state"], kept["state"]["inc"]
    return np.array(
        [
            state >> 64,
            state & _LOW,
            increment >> 64,
            increment & _LOW,
            kept["has_uint32"],
            kept["uinteger"],
        ],
        np.uint64,
    )


def _generator(words: Words) -> np.random.Generator:
    """The generator with this state."""
    high, low, increment_high, increment_low, has, left = (int(word) for word in words)
    bits = np.random.PCG64(0)
    bits.state = {
        "bit_generator": "PCG64", "state": {"state": high << 64 | low,
        "inc": increment_high << 64 | increment_low}, "has_uint32": has, "uinteger": left,
    }  # fmt: skip
    return np.random.Generator(bits)
