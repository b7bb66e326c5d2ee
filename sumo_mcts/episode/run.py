"""The closed loop:

SUMO moves the traffic, drivers decide, the referee judges. Loop is one running scenario;
run_episode drives it to the end.
"""

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from sumo_mcts import records
from sumo_mcts.config import ScenarioConfig, digest, plugins, require_scenario, whole
from sumo_mcts.driver.driver import Driver
from sumo_mcts.driver.params import streams
from sumo_mcts.driver.registry import SEARCHING, forecast_label, reads_forecast
from sumo_mcts.driver.warmup import warm_up
from sumo_mcts.episode.loop import Loop, Progress
from sumo_mcts.episode.recorder import Recorder
from sumo_mcts.errors import of_machine
from sumo_mcts.numerics.announce import announced
from sumo_mcts.records import Row, Setting, Trace
from sumo_mcts.scene import Decision, RoadMap, Scene
from sumo_mcts.world.arguments import REFEREE_OPTIONS

Watch = Callable[
    ["Loop", Mapping[str, Driver], Mapping[str, Scene]], None
]  # called with every set of decisions, before they are executed


class EpisodeResult(NamedTuple):
    """What an episode leaves behind.

    One row an ego; one trace an ego that decided at least once.
    """

    rows: tuple[Row, ...]
    traces: tuple[Trace, ...]
    manifest: dict[str, Any]
    road: RoadMap | None = None  # to which the traces refer


def run_episode(
    config: ScenarioConfig,
    seed: int | None = None,
    *,
    gui: bool = False,
    sumo_options: Sequence[str] = (),
    progress: Progress | None = None,
    variant: str | None = None,
    watch: Watch | None = None,
    measured: Sequence[str] = (),
) -> EpisodeResult:
    """Run a scenario to its end; without a seed SUMO keeps its own.

    Raises ConfigError where the input is wrong; what fails later is an outcome.

    `sumo_options` as on SUMO's command line. `progress` is told what goes on, `watch` is called
    with every set of decisions before they are executed. `variant` is what rows and keys call it;
    default planner-prediction-effort. `measured`: egos of later episodes in this process, since
    SUMO measures TTC, DRAC and PET of nobody who was not named when it was first started; of others
    they are None.
    """
    episode = open_episode(
        config,
        seed,
        gui=gui,
        sumo_options=sumo_options,
        progress=progress,
        variant=variant,
        watch=watch,
        measured=measured,
    )
    with episode as result:
        return result


@contextlib.contextmanager
def open_episode(
    config: ScenarioConfig,
    seed: int | None = None,
    *,
    gui: bool = False,
    sumo_options: Sequence[str] = (),
    progress: Progress | None = None,
    variant: str | None = None,
    watch: Watch | None = None,
    measured: Sequence[str] = (),
) -> Iterator[EpisodeResult]:
    """The same, while SUMO is still there: it is closed at the end of the context, for which a
    window may take its time."""
    require_scenario("run_episode", config)
    seed = None if seed is None else whole("seed", seed, 0)
    began = time.perf_counter()
    recorders = {ego.id: Recorder() for ego in config.egos}
    loop = Loop(
        config, seed, gui=gui, sumo_options=sumo_options, progress=progress, measured=measured
    )
    with announced(progress), contextlib.closing(loop):
        loop.start()
        drivers = {
            ego.id: Driver(
                config, loop.world.road, loop.world.physics, streams(seed).search, loop.oracles
            )
            for ego in config.egos
        }
        warm_up(config, loop.world.road, loop.world.physics)
        while scenes := loop.scenes():
            decisions = _decide(loop, scenes, drivers, recorders)
            if watch is not None:
                watch(loop, drivers, scenes)
            loop.apply(decisions)
            if progress is not None:
                progress(_news(scenes))
        name, wall = variant or default_variant(config), time.perf_counter() - began
        full = [
            completed(row, config, seed, name, recorders[row["ego"]], loop.world.period, wall)
            for row in loop.rows()
        ]
        road, setting = loop.world.road, _setting(config, seed, loop)
        traces = [
            recorders[row["ego"]].trace(row["key"], config.name, row["outcome"], road, setting)
            for row in full
        ]
        yield EpisodeResult(
            tuple(full),
            tuple(trace for trace in traces if trace is not None),
            _manifest(config, seed, loop),
            road,
        )


def default_variant(config: ScenarioConfig) -> str:
    """planner-prediction-effort, e.g. mcts-idm-1000, as far as there are such."""
    planner = config.planner
    if not reads_forecast(config):
        return planner.name
    if planner.name not in SEARCHING:
        return f"{planner.name}-{config.prediction.name}"
    effort = (
        str(planner.iterations)
        if planner.time_budget_ms is None
        else f"{planner.time_budget_ms:g}ms"
    )
    return f"{planner.name}-{config.prediction.name}-{effort}"


# --- decisions and results ---


def _decide(
    loop: Loop,
    scenes: Mapping[str, Scene],
    drivers: Mapping[str, Driver],
    recorders: Mapping[str, Recorder],
) -> dict[str, Decision]:
    """Let every driver think; one that raises is an outcome, not the end of a batch."""
    decisions = {}
    for ego, scene in scenes.items():
        try:
            thought = drivers[ego].decide(scene)
        except Exception as error:  # whatever a planner may do
            if of_machine(error):
                raise
            loop.fail(ego, f"{type(error).__name__}: {error}")
            continue
        recorders[ego].note(scene, thought)
        decisions[ego] = thought.decision
    return decisions


def _news(scenes: Mapping[str, Scene]) -> str:
    scene = next(iter(scenes.values()))
    return (
        f"{scene.time:.1f} s  {scene.ego.id} at {scene.ego.v:.1f} m/s, {len(scene.agents.ids)} "
        "in range"
    )


def completed(
    row: Row,
    config: ScenarioConfig,
    seed: int | None,
    variant: str,
    recorder: Recorder,
    period: float,
    wall: float,
) -> Row:
    """The row with what is known about scenario, planner and time; `period` and `wall` in s."""
    return {
        **records.row_defaults(),
        **row,
        **recorder.planning(config, period),
        "key": records.episode_key(
            config.name,
            variant,
            seed,
            row["ego"] if len(config.egos) > 1 or config.sumo.sumocfg is not None else None,
        ),
        "scenario": config.name,
        "variant": variant,
        "planner": config.planner.name,
        "prediction": forecast_label(config),
        "seed": seed,
        "wall_s": wall,
        "realtime_factor": recorder.simulated(period) / wall if wall > 0 else None,
        "config_digest": digest(config),
    }


def _setting(config: ScenarioConfig, seed: int | None, loop: Loop) -> Setting:
    physics = loop.world.physics
    return Setting(
        config.model_dump_json(), streams(seed).search, physics.step, physics.ballistic,
        physics.change_duration, records.map_name(loop.world.road)
    )  # fmt: skip


def _manifest(config: ScenarioConfig, seed: int | None, loop: Loop) -> dict[str, Any]:
    return {
        "schema_version": records.SCHEMA_VERSION,
        "scenario": config.model_dump(mode="json"),
        "config_digest": digest(config),
        "seed": seed,
        "redrawn": loop.redrawn,
        "versions": records.versions(),
        "plugins": plugins.described(config),
        "sumo_arguments": loop.arguments,
        "set_by_referee": REFEREE_OPTIONS,
        "step_s": loop.world.physics.step,
        "reproducible": config.reproducible,
    }
