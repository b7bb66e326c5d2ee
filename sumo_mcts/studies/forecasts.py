"""How far off each predictor is: all are asked in the same cycles of the same episodes, and the
planner drives by one of them."""

import time
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts import records
from sumo_mcts.config import ScenarioConfig
from sumo_mcts.driver.driver import Driver
from sumo_mcts.driver.factories import prediction_label
from sumo_mcts.episode.loop import Loop
from sumo_mcts.episode.run import default_variant, run_episode
from sumo_mcts.evaluation.forecast_errors import Errors, errors, statistics, together
from sumo_mcts.registry import PREDICTORS
from sumo_mcts.scene import Forecast, Scene
from sumo_mcts.world.arguments import without_outputs
from sumo_mcts.world.clone import require_copyable, require_possible
from sumo_mcts.world.observe import LANE, THERE

HORIZONS = (1.0, 3.0, 5.0)  # s
Note = Callable[[str], None]


def compare(
    configs: Sequence[ScenarioConfig],
    seeds: Sequence[int | None],
    sumo_options: Sequence[str],
    note: Note,
) -> dict[str, Any]:
    """Judge every predictor in all cycles of an episode for each of `configs` and seed.

    configs: one scenario, with different egos. Raises ConfigError.
    """
    require_possible(gui=False)
    judge, config = _Judge(configs[0]), configs[0]
    rows: list[records.Row] = []
    episodes = list(product(configs, seeds))
    for k, (episode, seed) in enumerate(episodes):
        judge.begin()
        news = partial(_tell, note, f"episode {k + 1} of {len(episodes)}")
        options = [*sumo_options, *without_outputs(episode.sumo, sumo_options)]
        rows += run_episode(
            episode, seed, sumo_options=options, progress=news, watch=judge.watch
        ).rows
    return {
        "schema_version": records.SCHEMA_VERSION,
        "scenario": config.name,
        "variant": default_variant(config),
        "seeds": list(seeds),
        "outcomes": dict(Counter(row["outcome"] for row in rows)),
        "problems": [
            f"{row['scenario']}: ego {row['ego']}: {row['error']}"
            for row in rows
            if row["outcome"] == "error"
        ],
        "cycles": judge.cycles,
        "forecasts": judge.table(),
    }


def _tell(note: Note, where: str, news: str) -> None:
    """Pass on what an episode says. News of a moment in it, which begin with the time, get its
    number."""
    note(f"{where}  {news}" if news[:1].isdigit() else news)


class _Pending(NamedTuple):
    """The forecasts of one cycle of one ego, still to be judged."""

    scene: Scene
    forecasts: Mapping[str, Forecast]


class _Judge:
    """Asks all predictors in every cycle, and compares each forecast when its time has come."""

    def __init__(self, config: ScenarioConfig) -> None:
        scripted = any(actor.driver == "script" for actor in config.traffic.actors)
        own = config.prediction.name
        self._predictors = {
            row.name: row.name
            for row in sorted(PREDICTORS.values(), key=lambda row: row.rank)
            if row.oracle != "script" or scripted
        }  # label -> name
        if own not in PREDICTORS:
            self._predictors[prediction_label(config)] = own
        self._found: defaultdict[tuple[str, float], list[Errors]] = defaultdict(list)
        self._ms: defaultdict[str, list[float]] = defaultdict(list)
        self.cycles = 0
        self.begin()

    def begin(self) -> None:
        """Another episode begins: what is still pending is never judged."""
        self._pending: defaultdict[str, list[_Pending]] = defaultdict(list)

    def watch(self, loop: Loop, drivers: Mapping[str, Driver], scenes: Mapping[str, Scene]) -> None:
        """A cycle of the egos in `scenes`: judge what is pending, and ask again."""
        require_copyable()
        for ego, scene in scenes.items():
            self._judge(loop, ego, scene.time)
            try:
                forecasts = {
                    label: self._ask(
                        drivers[ego], label, scene, max(HORIZONS) + 0.5 * loop.world.period
                    )
                    for label in self._predictors
                }
            except Exception as error:  # as with planners: an outcome, not the end of a batch
                loop.fail(ego, f"{type(error).__name__}: {error}")
                continue
            given = {name: forecast for name, forecast in forecasts.items() if forecast is not None}
            if given:
                self.cycles += 1
                self._pending[ego].append(_Pending(scene, given))

    def _ask(self, driver: Driver, label: str, scene: Scene, seconds: float) -> Forecast | None:
        began = time.perf_counter()
        forecast = driver.forecast(scene, self._predictors[label], seconds)
        self._ms[label].append((time.perf_counter() - began) * 1000.0)
        return forecast

    def _judge(self, loop: Loop, ego: str, now: float) -> None:
        """Judge each pending forecast in the cycle that is nearest to each horizon."""
        half = 0.5 * loop.world.period
        for pending in self._pending[ego]:
            after = now - pending.scene.time
            for horizon in HORIZONS:
                if horizon - half <= after - 1e-9 < horizon + half - 2e-9:
                    self._compare(loop, pending, horizon, after)
        self._pending[ego] = [
            pending for pending in self._pending[ego] if now - pending.scene.time < max(HORIZONS)
        ]

    def _compare(self, loop: Loop, pending: _Pending, horizon: float, after: float) -> None:
        states = loop.world.observer.states(pending.scene.agents.ids)
        for name, forecast in pending.forecasts.items():
            self._found[name, horizon].append(
                errors(
                    forecast,
                    after,
                    states[:, :2],
                    states[:, LANE].astype(np.int32),
                    states[:, THERE] > 0.0,
                )
            )

    def table(self) -> list[dict[str, Any]]:
        """A row for each predictor and horizon."""
        return [
            {
                "prediction": name,
                "horizon_s": horizon,
                **statistics(together(self._found[name, horizon])),
                "forecast_ms_p50": float(np.median(self._ms[name])) if self._ms[name] else None,
            }
            for name in self._predictors
            for horizon in HORIZONS
        ]
