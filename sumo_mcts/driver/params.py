"""From the scenario to the parameters of the compiled code."""

import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.config import ScenarioConfig, plugins, whole
from sumo_mcts.driver.sensor import aside_m
from sumo_mcts.errors import ConfigError, in_one_line
from sumo_mcts.model.cost_params import CostParams, Term, compiled_term
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.planners.baselines import IdmParams
from sumo_mcts.planners.budget import Effort
from sumo_mcts.planners.failsafe import Assumed
from sumo_mcts.planners.mcts import MctsParams
from sumo_mcts.planners.paper import PaperParams
from sumo_mcts.prediction.behaviour import TrafficParams
from sumo_mcts.scene import EgoState


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
    """The streams of a seed; without one those of seed 0. Raises ConfigError where it is none."""
    traffic, search, noise = np.random.SeedSequence(
        0 if seed is None else whole("seed", seed, 0)
    ).spawn(3)
    return Streams(traffic, int(search.generate_state(1)[0]), noise)


def mcts_params(config: ScenarioConfig) -> MctsParams:
    """The search of planner `mcts`."""
    p = config.planner
    return MctsParams(
        Effort(p.iterations, max(p.iterations, p.most_iterations or 0), p.close_cost), p.period_s,
        p.step_s, p.look_ahead_steps, p.rollout_steps, p.check_s,
        p.accelerations_mps2, p.lane_change_accelerations_mps2, p.later_accelerations_mps2,
        p.later_lane_change_accelerations_mps2, p.exploration, p.reactive,
        p.cvar_alpha if p.risk == "cvar" else 1.0, p.adaptive,
    )  # fmt: skip


def ego_params(config: ScenarioConfig, ego: EgoState, physics: Physics) -> EgoParams:
    """The ego's bounds: the scenario's, never beyond its vehicle type's."""
    m = config.ego_model
    return EgoParams(
        physics.step, physics.ballistic, m.jerk_mps3, m.emergency_jerk_mps3, m.comfort_decel_mps2,
        min(m.max_decel_mps2, max(ego.emergency_decel, ego.comfort_decel)),
        min(m.max_accel_mps2, ego.max_accel), m.approach_decel_mps2, m.stop_gap_m,
        physics.change_duration, config.cost.headway_s, config.cost.headway_gap_m, ego.length / 2,
        ego.width / 2,
    )  # fmt: skip


def cost_params(config: ScenarioConfig) -> CostParams:
    """The weights of planner `mcts`, and a term of the user's own.

    Raises ConfigError where that cannot be compiled.
    """
    c = config.cost
    return CostParams(
        c.contact, c.speed_at_contact, c.headway_s, c.headway_gap_m, c.headway, c.claim_s, c.claim,
        c.acceleration, c.jerk, c.braking, c.progress,
        c.tail_s, c.blocking, c.astride, c.route, c.lane_change, c.red, c.cut_in_decel_mps2,
        c.imposed,
        None if c.term is None else _term(c.term, c.term_weight),
    )  # fmt: skip


def traffic_params(config: ScenarioConfig, physics: Physics) -> TrafficParams:
    """Forecast times that fall on steps of the simulation, or divide them evenly."""
    q, step = config.prediction, physics.step
    dt = (
        step * max(1, round(q.step_s / step))
        if step <= q.step_s * 1.25 + 1e-9
        else step / round(step / q.step_s)
    )
    return TrafficParams(
        dt, q.headway_s, q.min_gap_m, q.accel_mps2, q.decel_mps2, q.yield_decel_mps2,
        q.yield_gap_s, q.stays_after_s, q.persistence_s,
        0.0 if physics.ballistic else 0.5 * step, q.name != "constant_velocity",
        aside_m(config.sensor),
    )  # fmt: skip


def _term(name: str, weight: float) -> Term:
    try:
        return Term(compiled_term(plugins.loaded("cost.term", name)), weight)
    except ConfigError:
        raise
    except Exception as error:  # numba's errors share no base of use
        raise ConfigError(f"cost.term: {name}: cannot be compiled: {in_one_line(error)}") from None


def assumed(config: ScenarioConfig) -> Assumed:
    """What the fail-safe takes the others to do."""
    f = config.failsafe
    return Assumed(
        f.decel_mps2, f.accel_mps2, f.over_limit, f.reaction_s, f.yield_decel_mps2, f.horizon_s
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


def paper_params(config: ScenarioConfig) -> PaperParams:
    p = config.paper
    return PaperParams(
        config.planner.iterations, p.step_s,
        p.look_ahead_steps, p.rollout_steps, config.planner.check_s, p.accelerations_mps2,
        p.lane_change_accelerations_mps2, p.exploration,
        p.brake_probability, p.accelerate_probability, p.weight_safety, p.weight_comfort,
        p.weight_passability, p.weight_other, p.safety_threshold_m,
        p.contact_cost, p.jerk_factor, p.goal_distance_m, p.lane_distance_m, p.goal_factor,
        p.junction_penalty, p.lane_change_cost, p.stop_cost, p.turn_cost,
        p.emergency_cost,
    )  # fmt: skip


def idm_params(config: ScenarioConfig) -> IdmParams:
    p = config.idm
    return IdmParams(
        p.headway_s, p.min_gap_m, p.accel_mps2, p.decel_mps2, p.critical_gap_s, p.cut_in_decel_mps2
    )
