"""Takes a recorded decision again, from the trace and its map alone, without SUMO, with the
recorded settings or others."""

import math
from collections.abc import Sequence

from sumo_mcts.arrays import Ints
from sumo_mcts.config import ScenarioConfig, build
from sumo_mcts.driver.driver import Driver, PlanningResult
from sumo_mcts.driver.factories import prediction_label
from sumo_mcts.driver.params import Physics
from sumo_mcts.driver.warmup import warm_up
from sumo_mcts.errors import ConfigError
from sumo_mcts.prediction.interface import Oracles
from sumo_mcts.records import CycleRecord, Setting, Trace, TraceError, require_fit, scenario_of
from sumo_mcts.registry import SENSED, is_oracle
from sumo_mcts.road import RoadChanges, RoadMap
from sumo_mcts.scene import Answers, Follow, PlannerMemory, Release, Scene, Scripted, ToldPlans

# sections that a decision reads; what the others decide has happened before
READ = ("planner", "prediction", "ego_model", "cost", "paper", "idm", "failsafe")


def recorded_config(
    setting: Setting, overrides: Sequence[str] = (), *, allow_plugins: bool = False
) -> ScenarioConfig:
    """The scenario of a trace, with some keys changed.

    Raises ConfigError, also where no decision depends on such a key, or where the scenario names
    code and that is not allowed. Raises TraceError where the trace holds no scenario.
    """
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
    """The decision of a cycle, taken again from the record.

    Raises ConfigError where an oracle is needed that the episode did not ask. Raises TraceError
    where the record is damaged, and PlannerError where the planner fails too often.
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
    oracles = _recorded_oracles(now, before["prediction"]["name"], config)
    driver = Driver(config, road, physics, setting.seed, oracles)
    last = trace.cycles[cycle - 1] if cycle else None
    try:
        if last is None:
            driver.recall(now.ego, RoadChanges(), memory, None, 0.0)
        else:
            driver.recall(last.ego, last.changes, memory, last.decision, last.time)
    except (ValueError, IndexError, OverflowError, TypeError):
        # a planner may raise any of these at a memory that is not its own
        raise TraceError(
            f"trace.cycles[{cycle}].memory: is none of planner {config.planner.name}"
        ) from None
    return driver.decide(Scene(now.time, now.step, now.ego, now.agents, now.signals, now.changes))


def _states(recorded: Answers | ToldPlans) -> dict[int, Scripted]:
    """The coming states that are recorded, by index of the agent."""
    return {
        i: Scripted(*(getattr(recorded, name)[k] for name in Scripted._fields))
        for k, i in enumerate(recorded.agent.tolist())
    }


def _recorded_oracles(now: CycleRecord, recorded: str, config: ScenarioConfig) -> Oracles:
    """Oracles that answer as they did in the episode. Raises ConfigError where they were not
    asked; `recorded`: the name of the episode's predictor."""
    asked = config.prediction.name
    if asked != recorded and is_oracle(prediction_label(config)):
        allowed = ", ".join(dict.fromkeys((recorded, *SENSED)))
        raise ConfigError(
            f"prediction.name: {asked} is an oracle that this episode did not ask; allowed: "
            f"{allowed}"
        )
    answers = now.answers
    states, told = _states(answers), _states(answers.told)
    index = {vehicle: i for i, vehicle in enumerate(now.agents.ids)}
    scripted = set(answers.agent[answers.scripted].tolist())

    def lanes(vehicle: str, lane: int) -> Ints:
        if not answers.ways:
            raise ConfigError(
                f"prediction.name: {asked} asks where {vehicle} goes, and the oracle of this "
                "episode was not asked that"
            )
        return answers.ways[now.agents.ids.index(vehicle)]

    def script(vehicle: str, time: float, step: float, count: int) -> Scripted | None:
        i = index.get(vehicle, -1)
        return _first(states[i], now.forecast.dt, step, count) if i in scripted else None

    def clone(
        scene: Scene, command: Follow | Release, step: float, count: int
    ) -> dict[int, Scripted]:
        return {i: _first(each, now.forecast.dt, step, count) for i, each in states.items()}

    def plan(vehicle: str, time: float, step: float, count: int) -> Scripted | None:
        i = index.get(vehicle, -1)
        return _first(told[i], now.forecast.dt, step, count) if i in told else None

    return Oracles(lanes, script, clone, plan)


def _first(states: Scripted, recorded_step: float, step: float, count: int) -> Scripted:
    """The first `count` states, `step` s apart. Raises ConfigError where they are not recorded."""
    if step != recorded_step:
        raise ConfigError(
            f"prediction.step_s: the oracle told where the others are every {recorded_step:g} s, "
            f"not every {step:g} s; it stays as it was"
        )
    if count > len(states.v):
        raise ConfigError(
            f"the oracle told {len(states.v)} states of the others, and {count} would be needed: "
            "the horizon cannot grow"
        )
    return Scripted(
        pose=states.pose[:count],
        v=states.v[:count],
        lane=states.lane[:count],
        s=states.s[:count],
        valid=states.valid[:count],
    )
