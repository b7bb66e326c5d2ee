"""Drives a scenario to its end: the loop steps SUMO, drivers decide, recorders keep what they
decided."""

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from sumo_mcts import records
from sumo_mcts.config import ScenarioConfig, digest, plugins, require_scenario, whole
from sumo_mcts.driver.driver import Driver
from sumo_mcts.driver.factories import forecast_label, reads_forecast
from sumo_mcts.driver.params import streams
from sumo_mcts.driver.warmup import warm_up
from sumo_mcts.episode.launch import LaunchOptions, Progress
from sumo_mcts.episode.loop import Loop
from sumo_mcts.episode.recorder import Recorder
from sumo_mcts.errors import of_machine
from sumo_mcts.numerics.announce import announced
from sumo_mcts.records import Row, Setting, Trace
from sumo_mcts.registry import searches
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Decision, Scene
from sumo_mcts.world.arguments import REFEREE_OPTIONS

Watch = Callable[
    [Loop, Mapping[str, Driver], Mapping[str, Scene]], None
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
    """Run a scenario to its end. Raises ConfigError where the input is wrong; what fails later is
    an outcome.

    seed: without one SUMO keeps its own.
    gui: with SUMO's window.
    sumo_options: as on SUMO's command line.
    progress: gets messages about the progress.
    variant: the name in rows and keys; default planner-prediction-iterations.
    watch: is called with every set of decisions, before they are executed.
    measured: egos of later episodes in this process. SUMO measures TTC, DRAC and PET only of
        vehicles that are named when it first starts in a process; of others they are None.
    """
    options = LaunchOptions(gui, sumo_options, progress, measured)
    with open_episode(config, seed, options, variant=variant, watch=watch) as result:
        return result


@contextlib.contextmanager
def open_episode(
    config: ScenarioConfig,
    seed: int | None = None,
    options: LaunchOptions | None = None,
    *,
    variant: str | None = None,
    watch: Watch | None = None,
) -> Iterator[EpisodeResult]:
    """The same, while SUMO is still there: it closes at the end of the context, which takes a
    window some time."""
    require_scenario("run_episode", config)
    seed = None if seed is None else whole("seed", seed, 0)
    options = options or LaunchOptions()
    began = time.perf_counter()
    recorders = {ego.id: Recorder() for ego in config.egos}
    with announced(options.progress), contextlib.closing(Loop(config, seed, options)) as loop:
        drivers = _drivers(loop)
        warm_up(config, loop.world.road, loop.world.physics)
        while scenes := loop.scenes():
            decisions = _decide(loop, scenes, drivers, recorders)
            if watch is not None:
                watch(loop, drivers, scenes)
            loop.apply(decisions)
            if options.progress is not None:
                options.progress(_news(scenes))
        result = _result(loop, recorders, variant, time.perf_counter() - began)
        if options.connect is not None:  # what drives there is not ours
            further = {"connected_to": options.connect, "reproducible": False}
            result = result._replace(manifest={**result.manifest, **further})
        yield result


def default_variant(config: ScenarioConfig) -> str:
    """planner-prediction-iterations, e.g. mcts-idm-1000, as far as there are such."""
    planner = config.planner
    if not reads_forecast(config):
        return planner.name
    if not searches(planner.name):
        return f"{planner.name}-{config.prediction.name}"
    budget = (
        str(planner.iterations)
        if planner.time_budget_ms is None
        else f"{planner.time_budget_ms:g}ms"
    )
    return f"{planner.name}-{config.prediction.name}-{budget}"


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
    named = len(config.egos) > 1 or config.sumo.sumocfg is not None
    return records.complete_row(
        {
            **row,
            **recorder.planning(config, period),
            "key": records.episode_key(config.name, variant, seed, row["ego"] if named else None),
            "scenario": config.name,
            "variant": variant,
            "planner": config.planner.name,
            "prediction": forecast_label(config),
            "seed": seed,
            "wall_s": wall,
            "realtime_factor": recorder.simulated(period) / wall if wall > 0 else None,
            "config_digest": digest(config),
        }
    )


# --- decisions ---


def _drivers(loop: Loop) -> dict[str, Driver]:
    """A driver for each ego."""
    world, search = loop.world, streams(loop.seed).search
    return {
        ego.id: Driver(loop.config, world.road, world.physics, search, loop.oracles)
        for ego in loop.config.egos
    }


def _decide(
    loop: Loop,
    scenes: Mapping[str, Scene],
    drivers: Mapping[str, Driver],
    recorders: Mapping[str, Recorder],
) -> dict[str, Decision]:
    """A decision of every driver, one after the other in the order of the scenario: connected egos
    know the plans of those before them. One that raises is an outcome, not the end of a batch."""
    decisions = {}
    for ego, scene in scenes.items():
        try:
            planned = drivers[ego].decide(scene)
        except Exception as error:  # whatever a planner may do
            if of_machine(error):
                raise
            loop.fail(ego, f"{type(error).__name__}: {error}")
            continue
        recorders[ego].note(scene, planned)
        decisions[ego] = planned.decision
        loop.tell(scene, planned.decision)
    return decisions


def _news(scenes: Mapping[str, Scene]) -> str:
    scene = next(iter(scenes.values()))
    return (
        f"{scene.time:.1f} s  {scene.ego.id} at {scene.ego.v:.1f} m/s, {len(scene.agents.ids)} "
        "in range"
    )


# --- results ---


def _result(
    loop: Loop, recorders: Mapping[str, Recorder], variant: str | None, wall: float
) -> EpisodeResult:
    """What the episode leaves behind; `wall`: what it took, s."""
    config, seed, road = loop.config, loop.seed, loop.world.road
    name = variant or default_variant(config)
    rows = [
        completed(row, config, seed, name, recorders[row["ego"]], loop.world.period, wall)
        for row in loop.rows()
    ]
    setting = _setting(loop)
    traces = [
        recorders[row["ego"]].trace(row["key"], config.name, row["outcome"], road, setting)
        for row in rows
    ]
    there = tuple(trace for trace in traces if trace is not None)
    return EpisodeResult(tuple(rows), there, _manifest(loop), road)


def _setting(loop: Loop) -> Setting:
    physics = loop.world.physics
    return Setting(
        config=loop.config.model_dump_json(),
        seed=streams(loop.seed).search,
        step=physics.step,
        ballistic=physics.ballistic,
        change_duration=physics.change_duration,
        map=records.map_name(loop.world.road),
    )


def _manifest(loop: Loop) -> dict[str, Any]:
    config = loop.config
    return {
        "schema_version": records.SCHEMA_VERSION,
        "scenario": config.model_dump(mode="json"),
        "config_digest": digest(config),
        "seed": loop.seed,
        "redrawn": loop.redrawn,
        "versions": records.versions(),
        "plugins": plugins.described(config),
        "sumo_arguments": loop.arguments,
        "set_by_referee": REFEREE_OPTIONS,
        "step_s": loop.world.physics.step,
        "reproducible": config.reproducible,
    }
