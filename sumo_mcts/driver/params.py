"""From the scenario to the parameters of the compiled code, and to the streams of randomness.

The parameters of a planner stand in the planner's own file.
"""

import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.config import ScenarioConfig, plugins, whole
from sumo_mcts.driver.sensor import aside_m
from sumo_mcts.errors import ConfigError, in_one_line
from sumo_mcts.model.cost_params import CostParams, Term, compiled_term
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.model.oncoming import Sight
from sumo_mcts.planners.failsafe_reach import Assumed
from sumo_mcts.prediction.drivers import TrafficParams
from sumo_mcts.scene import EgoState

LANE_WIDTH = 3.2  # m, SUMO's default: how far a lane change leads aside
ASIDE_ACCEL = 1.0  # m/s2 with which SUMO moves a vehicle aside by default
LEAST_DECEL = 0.1  # m/s2 that a vehicle can brake with, whatever its type says


class Physics(NamedTuple):
    """How the running simulation moves vehicles."""

    step: float  # s
    ballistic: bool
    change_duration: float  # s


class Streams(NamedTuple):
    """Independent randomness from one seed."""

    traffic: np.random.SeedSequence
    search: int
    noise: np.random.SeedSequence


def streams(seed: int | None) -> Streams:
    """The streams of a seed, by default of seed 0. Raises ConfigError where it is not a seed."""
    traffic, search, noise = np.random.SeedSequence(
        0 if seed is None else whole("seed", seed, 0)
    ).spawn(3)
    return Streams(traffic, int(search.generate_state(1)[0]), noise)


def ego_params(config: ScenarioConfig, ego: EgoState, physics: Physics) -> EgoParams:
    """The ego's bounds: the scenario's, never beyond its vehicle type's."""
    m = config.ego_model
    return EgoParams(
        step=physics.step,
        ballistic=physics.ballistic,
        jerk=m.jerk_mps3,
        emergency_jerk=m.emergency_jerk_mps3,
        comfort_decel=min(m.comfort_decel_mps2, max(ego.comfort_decel, LEAST_DECEL)),
        max_decel=min(m.max_decel_mps2, max(ego.emergency_decel, ego.comfort_decel)),
        max_accel=min(m.max_accel_mps2, ego.max_accel),
        approach_decel=m.approach_decel_mps2,
        stop_gap=m.stop_gap_m,
        change_duration=_change_duration(ego, physics),
        headway=config.cost.headway_s,
        gap=config.cost.headway_gap_m,
        half_length=ego.length / 2,
        half_width=ego.width / 2,
    )


def _change_duration(ego: EgoState, physics: Physics) -> float:
    """How long the ego's lane changes take, s.

    Where SUMO divides lanes, a vehicle moves aside as fast as its type may, and needs time to get
    to that speed and to lose it.
    """
    speed = ego.sideways.speed
    if speed <= 0.0:
        return physics.change_duration
    speed = min(speed, math.sqrt(LANE_WIDTH * ASIDE_ACCEL))
    return LANE_WIDTH / speed + speed / ASIDE_ACCEL


def cost_params(config: ScenarioConfig) -> CostParams:
    """The weights of the cost, and a plugin's term.

    Raises ConfigError where the term cannot be compiled.
    """
    c = config.cost
    return CostParams(
        **c.model_dump(exclude={"term", "term_weight"}),
        term=None if c.term is None else _term(c.term, c.term_weight),
    )


def _term(name: str, weight: float) -> Term:
    """A plugin's term. Raises ConfigError."""
    try:
        return Term(compiled_term(plugins.loaded("cost.term", name)), weight)
    except ConfigError:
        raise
    except Exception as error:  # numba's errors share no useful base class
        raise ConfigError(f"cost.term: {name}: cannot be compiled: {in_one_line(error)}") from None


def overtakes(config: ScenarioConfig) -> bool:
    """Whether the ego may overtake through oncoming traffic: only `mcts` knows what that takes."""
    return config.ego_model.overtakes and config.planner.name == "mcts"


def sight(config: ScenarioConfig) -> Sight:
    """How far the ego sees."""
    return Sight(config.sensor.range_m, config.sensor.occlusion)


def traffic_params(config: ScenarioConfig, physics: Physics) -> TrafficParams:
    """How a forecast has the other agents drive.

    Its times fall on steps of the simulation, or divide them evenly.
    """
    q, step = config.prediction, physics.step
    dt = (
        step * max(1, round(q.step_s / step))
        if step <= q.step_s * 1.25 + 1e-9
        else step / round(step / q.step_s)
    )
    return TrafficParams(
        step=dt,
        headway=q.headway_s,
        gap=q.min_gap_m,
        accel=q.accel_mps2,
        decel=q.decel_mps2,
        yield_decel=q.yield_decel_mps2,
        yield_gap=q.yield_gap_s,
        stays_after=q.stays_after_s,
        persistence=q.persistence_s,
        euler=0.0 if physics.ballistic else 0.5 * step,
        interacting=True,
        aside=aside_m(config.sensor),
    )


def assumed(config: ScenarioConfig) -> Assumed:
    """What the fail-safe assumes of the other agents."""
    f = config.failsafe
    return Assumed(
        decel=f.decel_mps2,
        accel=f.accel_mps2,
        over_limit=f.over_limit,
        reaction=f.reaction_s,
        yield_decel=f.yield_decel_mps2,
        horizon=f.horizon_s,
    )


def deadline_s(config: ScenarioConfig, period: float) -> float:
    """When a decision is late, s: the time budget if there is one, else the decision period (s)."""
    return period if config.planner.time_budget_ms is None else time_budget_s(config)


def time_budget_s(config: ScenarioConfig) -> float:
    """The time budget of a decision, s; inf: none."""
    return (
        math.inf
        if config.planner.time_budget_ms is None
        else config.planner.time_budget_ms / 1000.0
    )
