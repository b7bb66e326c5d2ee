"""What drivers do next, against what forecasts say: probabilities judged in every cycle of
episodes that planner mcts drives."""

import math
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Ints
from sumo_mcts.config import ScenarioConfig
from sumo_mcts.driver.driver import Driver
from sumo_mcts.driver.forecaster import ego_lanes
from sumo_mcts.episode.loop import Loop
from sumo_mcts.episode.run import run_episode
from sumo_mcts.evaluation.driver_events import EVENTS, FAST, MOVES, Course, foreseen, of_intent
from sumo_mcts.evaluation.lane_changes import FEATURES, WITHIN_S, features
from sumo_mcts.evaluation.reliability import Judged
from sumo_mcts.planners.base import Situation, Task
from sumo_mcts.prediction.conflicts import (
    FOE_BEGIN,
    FOE_END,
    MERGES,
    OWN_BEGIN,
    conflicts_of,
)
from sumo_mcts.prediction.paths import likely_paths
from sumo_mcts.prediction.yielding import FOE_VIEW
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import STANDING, Forecast, Intent, Scene
from sumo_mcts.studies.copies import reactions
from sumo_mcts.world.arguments import without_outputs
from sumo_mcts.world.clone import require_copyable, require_possible
from sumo_mcts.world.observe import LANE, SPEED, THERE

EVERY = 4  # cycles from one in which copies of the simulation are asked to the next
AT_JUNCTION = 30.0  # m before a shared stretch within which a driver is asked whether it enters
CHANGES = ("changes right", "changes left")  # in the order of lane_changes.WEIGHTS


class Sample(NamedTuple):
    """The answers to one question in one cycle, for K agents."""

    present: Floats  # [K] probability that the forecast of the planner gives
    happened: Bools  # [K]
    seen: Floats  # [K, FEATURES]; no column where no model is fitted


class Answers(NamedTuple):
    """All samples of one or several episodes, by question, and how the episodes ended."""

    samples: Mapping[str, Sample]
    outcomes: Counter[str]
    problems: tuple[str, ...]


def answers(config: ScenarioConfig, seed: int | None) -> Answers:
    """Drive an episode and judge all probabilities in it. Raises ConfigError."""
    require_possible(gui=False)
    watcher = _Watcher()
    rows = run_episode(
        config, seed, sumo_options=without_outputs(config.sumo, ()), watch=watcher.watch
    ).rows
    return Answers(
        {name: joined(parts) for name, parts in watcher.found.items()},
        Counter(row["outcome"] for row in rows),
        tuple(
            f"{row['scenario']}: seed {seed}: {row['error']}"
            for row in rows
            if row["outcome"] == "error"
        ),
    )


def joined(parts: Sequence[Sample]) -> Sample:
    """All samples of one question."""
    return Sample(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def judged(sample: Sample, probability: Floats | None = None) -> Judged:
    """The present predictor's probabilities, or others, with what came of them."""
    return Judged(sample.present if probability is None else probability, sample.happened)


class _Pending(NamedTuple):
    """What was asked in one cycle of one ego."""

    names: tuple[str, ...]
    lane: Ints  # [N] then
    asked: Mapping[str, Bools]  # by question, [N]
    present: Mapping[str, Floats]
    seen: Floats  # [N, 2, FEATURES]
    usual: Course
    odds: tuple[tuple[Intent, float], ...]  # of each other hypothesis, its probability
    states: list[Floats]  # [N, 8] in each cycle from then on


class _Watcher:
    """Asks in every cycle, and judges when the time has come."""

    def __init__(self) -> None:
        self.found: defaultdict[str, list[Sample]] = defaultdict(list)
        self._pending: defaultdict[str, list[_Pending]] = defaultdict(list)  # by ego
        self._cycles: Counter[str] = Counter()

    def watch(self, loop: Loop, drivers: Mapping[str, Driver], scenes: Mapping[str, Scene]) -> None:
        """A cycle of the egos in `scenes`."""
        for ego, scene in scenes.items():
            for pending in self._pending[ego]:
                pending.states.append(loop.world.observer.states(pending.names))
            self._judge_due(ego, loop.world.road, loop.world.period)
            question = drivers[ego].question
            if question is not None and len(scene.agents.ids):
                self._ask(loop, ego, scene, *question)

    def _ask(self, loop: Loop, ego: str, scene: Scene, task: Task, situation: Situation) -> None:
        road, period, forecast = loop.world.road, loop.world.period, situation.forecast
        lanes = ego_lanes(task.route, situation.state)
        seen = features(road, scene.agents, scene.ego)
        count = math.ceil(WITHIN_S / period - 1e-9) + 1
        courses = [foreseen(forecast, h, period, count) for h in range(len(forecast.weight))]
        usual = courses[usual_of(forecast)]
        self._pending[ego].append(
            _Pending(
                scene.agents.ids,
                scene.agents.lane,
                asked(road, scene, lanes, seen),
                probabilities(road, scene.agents.lane, courses, usual, forecast.weight),
                seen,
                usual,
                weighed(forecast),
                [loop.world.observer.states(scene.agents.ids)],
            )
        )
        if self._cycles[ego] % EVERY == 0:
            require_copyable()
            for found in reactions(loop, scene, lanes, forecast.yields[0]):
                self._note(found.question, found.present, found.happened)
        self._cycles[ego] += 1

    def _judge_due(self, ego: str, road: RoadMap, period: float) -> None:
        """Judge what has been pending for WITHIN_S."""
        left = []
        for pending in self._pending[ego]:
            if (len(pending.states) - 1) * period >= WITHIN_S - 1e-9:
                self._judge(road, pending, period)
            else:
                left.append(pending)
        self._pending[ego] = left

    def _judge(self, road: RoadMap, pending: _Pending, period: float) -> None:
        states = np.array(pending.states)
        course = Course(
            period, states[:, :, SPEED], states[:, :, LANE].astype(np.int32),
            states[:, :, THERE] > 0.0,
        )  # fmt: skip
        stays: Bools = np.asarray(course.there.all(axis=0))
        for name, event in EVENTS.items():
            happened = event(road, pending.lane, course, pending.usual)
            known = pending.asked[name] & (happened | stays)
            if known.any():
                seen = pending.seen[known, CHANGES.index(name)] if name in CHANGES else None
                self._keep(name, pending.present[name][known], happened[known], seen)
        for intent, probability in pending.odds:
            found = of_intent(intent, float(course.v[0, intent.agent]))
            if found is not None and stays[intent.agent]:
                name, event = found
                happened = event(road, pending.lane, course, pending.usual)
                self._note(name, probability, bool(happened[intent.agent]))

    def _note(self, question: str, probability: float, happened: bool) -> None:
        self._keep(question, np.array([probability]), np.array([happened]), None)

    def _keep(self, question: str, present: Floats, happened: Bools, seen: Floats | None) -> None:
        columns = np.zeros((len(happened), 0)) if seen is None else seen
        self.found[question].append(Sample(present, happened, columns))


def usual_of(forecast: Forecast) -> int:
    """The hypothesis in which every agent does what is likeliest, each for itself."""
    agents = [intent.agent for intent in forecast.intents]
    return agents.index(-1) if -1 in agents else 0


def weighed(forecast: Forecast) -> tuple[tuple[Intent, float], ...]:
    """What the hypotheses are about, and the probability of each against the usual forecast."""
    about = list(zip(forecast.intents, forecast.weight.tolist(), strict=False))
    usual = sum(weight for intent, weight in about if intent.agent < 0)
    return tuple((intent, w / (w + usual)) for intent, w in about if intent.agent >= 0)


def probabilities(
    road: RoadMap, lane: Ints, courses: Sequence[Course], usual: Course, weight: Floats
) -> dict[str, Floats]:
    """By question [N]: the weight of the hypotheses in which it happens; `lane` [N] now."""
    return {
        name: weight
        @ np.array([event(road, lane, course, usual) for course in courses], np.float64)
        for name, event in EVENTS.items()
    }


def asked(road: RoadMap, scene: Scene, lanes: Ints, seen: Floats) -> dict[str, Bools]:
    """By question [N]: whether it makes sense for each agent."""
    agents = scene.agents
    drives = (agents.lane >= 0) & ~agents.person
    beside = ~np.isnan(seen[:, :, FEATURES.index("always")])
    return {
        "changes right": drives & beside[:, 0],
        "changes left": drives & beside[:, 1],
        "starts": drives & (agents.v < STANDING),
        "stops": drives & (agents.v > MOVES),
        "brakes hard": drives & (agents.v > FAST),
        "falls back": drives & (agents.v > FAST),
        "enters": drives & _owes(road, scene, lanes),
    }


def _owes(road: RoadMap, scene: Scene, lanes: Ints) -> Bools:
    """[N] it is before a junction where it has to let another vehicle pass that comes."""
    agents, ego = scene.agents, scene.ego
    paths = likely_paths(road, agents, ego, lanes, {}, WITHIN_S)
    foe, kind, place, _ = conflicts_of(road, paths)
    s = np.concatenate([[ego.s], agents.s])
    to_own, to_foe = place[..., OWN_BEGIN] - s[:, None], place[..., FOE_BEGIN] - s[foe]
    comes = (to_foe < FOE_VIEW) & (place[..., FOE_END] - s[foe] > 0.0)
    owes = (foe >= 0) & (kind != MERGES) & comes & (to_own > 0.0) & (to_own < AT_JUNCTION)
    ordinary = ~road.internal[agents.lane] & (agents.lane >= 0)
    return np.asarray(owes.any(axis=1)[1:] & ordinary)
