"""One recorded decision taken again: from the trace and its map alone, without SUMO, with the
recorded settings or with others."""

import math
from collections.abc import Sequence

from sumo_mcts.config import ScenarioConfig, build, is_oracle
from sumo_mcts.driver.driver import Driver, PlanningResult
from sumo_mcts.driver.params import Physics
from sumo_mcts.driver.registry import prediction_label
from sumo_mcts.driver.warmup import warm_up
from sumo_mcts.errors import ConfigError
from sumo_mcts.prediction.interface import Oracles
from sumo_mcts.records import CycleRecord, Setting, Trace, TraceError, require_fit, scenario_of
from sumo_mcts.scene import Follow, Ints, PlannerMemory, Release, RoadMap, Scene, Scripted

READ = (
    "planner",
    "prediction",
    "ego_model",
    "cost",
    "paper",
    "idm",
    "failsafe",
)  # sections; what the others decide has happened before a decision


def recorded_config(
    setting: Setting, overrides: Sequence[str] = (), *, allow_plugins: bool = False
) -> ScenarioConfig:
    """The scenario that a trace was recorded with, with some keys set otherwise; code that it names
    only where that is allowed. Raises ConfigError, also where a key has no say in a decision, and
    TraceError where the trace holds none."""
    config = build(
        scenario_of(setting), "the trace's scenario", tuple(overrides), allow_plugins=allow_plugins
    )
    for override in overrides:
        if override.partition("=")[0].partition(".")[0] not in READ:
            raise ConfigError(
                f"--set {override}: a recorded decision does not depend on it; it reads the "
                f"sections {', '.join(READ)}"
            )
    return config


def replan(trace: Trace, road: RoadMap, cycle: int, config: ScenarioConfig) -> PlanningResult:
    """The decision of a cycle, taken again from what is recorded.

    Raises ConfigError where another oracle would have to be asked, TraceError where the record is
    damaged, and PlannerError where the planner fails too often.
    """
    require_fit(trace, road, range(max(cycle - 1, 0), cycle + 1))
    now, setting, before = trace.cycles[cycle], trace.setting, scenario_of(trace.setting)
    if not (math.isfinite(setting.step) and math.isfinite(setting.change_duration)):
        raise TraceError("trace.setting: does not say how the simulation moves vehicles")
    physics = Physics(setting.step, setting.ballistic, setting.change_duration)
    memory = (
        now.memory
        if config.planner.name == before["planner"]["name"]
        else now.memory._replace(planner=PlannerMemory())
    )
    warm_up(config, road, physics)
    driver = Driver(
        config, road, physics, setting.seed, _witness(now, before["prediction"]["name"], config)
    )
    last = trace.cycles[cycle - 1] if cycle else None
    try:
        driver.recall(
            now.ego,
            memory,
            None if last is None else last.decision,
            0.0 if last is None else last.time,
        )
    except (
        ValueError,
        IndexError,
        OverflowError,
        TypeError,
    ):  # what a planner makes of a memory that is none of its own
        raise TraceError(
            f"trace.cycles[{cycle}].memory: is none of planner {config.planner.name}"
        ) from None
    return driver.decide(Scene(now.time, now.step, now.ego, now.agents, now.signals))


def _witness(now: CycleRecord, recorded: str, config: ScenarioConfig) -> Oracles:
    """Answers what the oracles answered. Raises ConfigError where they were not asked."""
    asked = config.prediction.name
    if asked != recorded and is_oracle(prediction_label(config)):
        allowed = ", ".join(dict.fromkeys((recorded, "idm", "constant_velocity")))
        raise ConfigError(
            f"prediction.name: {asked} is an oracle that this episode did not ask; allowed: "
            f"{allowed}"
        )
    told = now.answers
    states = [
        Scripted(told.pose[k], told.v[k], told.lane[k], told.s[k], told.valid[k])
        for k in range(len(told.agent))
    ]
    of = {now.agents.ids[i]: k for k, i in enumerate(told.agent.tolist())}

    def way(vehicle: str, lane: int) -> Ints:
        if not told.ways:
            raise ConfigError(
                f"prediction.name: {asked} asks where {vehicle} goes, and the oracle of this "
                "episode was not asked that"
            )
        return told.ways[now.agents.ids.index(vehicle)]

    def script(vehicle: str, time: float, step: float, count: int) -> Scripted | None:
        k = of.get(vehicle)
        return (
            None
            if k is None or not told.scripted[k]
            else _as_far(states[k], now.forecast.dt, step, count)
        )

    def clone(
        scene: Scene, command: Follow | Release, step: float, count: int
    ) -> dict[int, Scripted]:
        return {
            int(i): _as_far(states[k], now.forecast.dt, step, count)
            for k, i in enumerate(told.agent)
        }

    return Oracles(way, script, clone)


def _as_far(states: Scripted, told_step: float, step: float, count: int) -> Scripted:
    """The first `count` states, `step` s apart. Raises ConfigError where they are not told."""
    if step != told_step:
        raise ConfigError(
            f"prediction.step_s: the oracle told where the others are every {told_step:g} s, not "
            f"every {step:g} s; it stays as it was"
        )
    if count > len(states.v):
        raise ConfigError(
            f"the oracle told {len(states.v)} states of the others, and {count} would be needed: "
            "the horizon cannot grow"
        )
    return Scripted(
        states.pose[:count],
        states.v[:count],
        states.lane[:count],
        states.s[:count],
        states.valid[:count],
    )
