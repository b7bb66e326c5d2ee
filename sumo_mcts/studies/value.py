"""How true the cost-to-go is, along trips that SUMO's driver drives, and whether the planner would
go where that driver goes."""

from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from sumo_mcts.config import ScenarioConfig
from sumo_mcts.driver.driver import Driver
from sumo_mcts.driver.factories import make_planner
from sumo_mcts.driver.params import streams
from sumo_mcts.episode import run_episode
from sumo_mcts.episode.loop import Loop
from sumo_mcts.model.route import RouteMap
from sumo_mcts.planners.base import Situation, Task
from sumo_mcts.planners.mcts import forecast_s
from sumo_mcts.scene import Plan, Scene
from sumo_mcts.studies.trip import AFTER_S, GOES_M, GOES_S, Log, Row
from sumo_mcts.world.arguments import without_outputs


class Harvest(NamedTuple):
    """What an episode tells: rows as in studies/trip.py."""

    states: list[Row]
    trips: list[Row]
    stands: list[Row]
    outcomes: Counter[str]  # of the egos
    problems: list[str]  # a line for each ego with outcome `error`


def harvest(config: ScenarioConfig, seed: int | None, every: int) -> Harvest:
    """Have SUMO's driver drive an episode. In every `every`-th cycle of each ego the cost-to-go is
    asked; in each cycle in which it stands, the scenario's planner.

    Raises ConfigError.
    """
    planner = config.planner.model_copy(update={"name": "sumo"})
    watching = _Watching(config, seed, every)
    rows = run_episode(
        config.model_copy(update={"planner": planner}),
        seed,
        sumo_options=without_outputs(config.sumo),
        watch=watching.watch,
    ).rows
    found = Harvest([], [], [], Counter(row["outcome"] for row in rows), [])
    for row in rows:
        where = {"scenario": config.name, "seed": seed, "ego": row["ego"]}
        if row["outcome"] == "error":
            found.problems.append(f"{row['scenario']}: ego {row['ego']}: {row['error']}")
        for log in watching.logs.get(row["ego"], []):
            found.states.extend(
                {**where, **each} for each in log.states(row["outcome"] == "arrived")
            )
            found.trips.extend({**where, **each} for each in log.trips())
            found.stands.extend({**where, **each} for each in log.stands())
    return found


class _Watching:
    """The logs of an episode so far, and the planner that is asked."""

    def __init__(self, config: ScenarioConfig, seed: int | None, every: int) -> None:
        self._config, self._every = config, every
        self._planner, self._search = make_planner(config), streams(seed).search
        self.logs: dict[str, list[Log]] = {}

    def watch(self, loop: Loop, drivers: Mapping[str, Driver], scenes: Mapping[str, Scene]) -> None:
        """A cycle of the egos in `scenes`."""
        q = self._config.prediction
        seconds = forecast_s(self._config, loop.world.physics.step, q.step_s)
        for ego, scene in scenes.items():
            question = drivers[ego].question
            if question is None:
                continue
            task, situation = question
            log = self._log(ego, task.route)
            log.note(scene.time, situation.state)
            due, stands = len(log.time) % self._every == 0, log.stood_within(AFTER_S)
            if not (due or stands):
                continue
            try:
                forecast = drivers[ego].forecast(scene, q.name, seconds)
                assert forecast is not None, "the ego is on its route"
                situation = situation._replace(forecast=forecast)
                if due:
                    log.ask(task, situation)
                if stands:
                    log.goes[len(log.time) - 1] = self._goes(log, task, situation)
            except Exception as error:  # as with planners: an outcome, not the end of a batch
                loop.fail(ego, f"{type(error).__name__}: {error}")

    def _log(self, ego: str, route: RouteMap) -> Log:
        """The log of an ego; a new one where SUMO changed its route."""
        logs = self.logs.setdefault(ego, [])
        if not logs or logs[-1].route is not route:
            logs.append(Log(route))
        return logs[-1]

    def _goes(self, log: Log, task: Task, situation: Situation) -> bool:
        """Whether the planner would go. It takes the ego over when that comes to a stand."""
        if len(log.time) - 2 not in log.goes:
            self._planner.start(task, self._search)
        plan = self._planner.plan(situation).plan
        return plan is not None and driven(plan) >= GOES_M


def driven(plan: Plan) -> float:
    """m that the ego drives in the next GOES_S."""
    seconds = np.diff(plan.time, prepend=0.0)
    return float((plan.v * seconds)[plan.time <= GOES_S + 1e-6].sum())
