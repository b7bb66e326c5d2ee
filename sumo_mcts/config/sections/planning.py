"""The sections `ego_model`, `planner`, `paper`, `idm` and `failsafe`: how the ego may move, the
parameters of the planners, and the last check.
"""

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from sumo_mcts.config.names import PlannerName
from sumo_mcts.config.sections.section import Section
from sumo_mcts.config.values import (
    Acceleration,
    Actions,
    Count,
    Delay,
    Flag,
    Float,
    Gap,
    Headway,
    Int,
    Jerk,
    Milliseconds,
    NonNegative,
    Positive,
    Share,
    StepTime,
)


class EgoModelConfig(Section):
    """How the ego may move, in the plan and in SUMO alike."""

    jerk_mps3: Jerk = Field(4.0, description="jerk of ordinary actions")
    emergency_jerk_mps3: Jerk = Field(20.0, description="jerk of braking beyond comfort_decel_mps2")
    comfort_decel_mps2: Acceleration = Field(
        3.0,
        description="strongest braking with the ordinary jerk; never beyond the vehicle type's "
        "decel",
    )
    max_decel_mps2: Acceleration = Field(
        8.0, description="strongest braking at all; never beyond the vehicle type's emergencyDecel"
    )
    max_accel_mps2: Acceleration = Field(
        2.6, description="strongest acceleration; never beyond the vehicle type's accel"
    )
    max_lateral_accel_mps2: Acceleration | None = Field(
        None,
        description="bound on the lateral acceleration in bends, of the route as SUMO draws it; "
        "null: as fast as the limit allows, like SUMO's vehicles",
    )
    approach_decel_mps2: Acceleration = Field(
        2.0, description="braking towards lower limits, stop lines and the end of a lane"
    )
    stop_gap_m: Float = Field(
        1.0, ge=0.0, le=2.0, description="distance to the stop line at standstill"
    )
    asks: Flag = Field(
        True,
        description="ask others for room, as SUMO's drivers do, where the route needs a lane "
        "change soon (planner `mcts`; not with SUMO's sublane model)",
    )
    reroute_after_s: Positive | None = Field(
        60.0,
        description="in a lane that does not lead on along the route, take another way to the goal "
        "after standing there so long as the first in the lane, or at once where no lane change is "
        "left; likewise give up a stop beside which it stood so long; null: wait for a gap for "
        "ever (not with planner `sumo`)",
    )
    overtakes: Flag = Field(
        True,
        description="overtake a slow or standing vehicle in the lane of oncoming traffic, where "
        "the network has such a lane (`neigh`) and it is seen far enough (planner `mcts`)",
    )


class PlannerConfig(Section):
    """The search."""

    name: PlannerName = "mcts"
    iterations: Int = Field(
        1000, ge=1, le=1_000_000, description="iteration budget of one decision"
    )
    adaptive: Flag = Field(
        True,
        description="leave out what cannot become the best, and stop when nothing else is left",
    )
    most_iterations: Int | None = Field(
        None,
        ge=1,
        le=1_000_000,
        description="go on so far while the choice is close; default: no further than `iterations`",
    )
    close_cost: NonNegative = Field(
        0.2, description="difference of J up to which another command than the best is close"
    )
    threads: Int = Field(
        1,
        ge=1,
        le=64,
        description="threads that search the hypotheses side by side, with the same decisions; "
        "searches that draw use one",
    )
    time_budget_ms: Milliseconds | None = Field(
        None,
        description="time budget of one decision instead, from the scene to the decision (not "
        "reproducible)",
    )
    enforce_deadline: Flag = Field(
        False,
        description="a decision later than the time budget, else the period, is not executed (not "
        "reproducible)",
    )
    period_s: StepTime = Field(
        0.5, description="decision period; in whole steps of the simulation, one at least"
    )
    step_s: StepTime = Field(1.0, description="duration of one action in the tree of planner mcts")
    look_ahead_steps: Int = Field(6, ge=1, le=12, description="levels of the tree")
    rollout_steps: Int = Field(2, ge=0, le=24, description="further steps to the terminal state")
    check_s: StepTime = Field(0.2, description="time between collision checks")
    accelerations_mps2: Actions = Field(
        (-8.0, -4.5, -3.0, -2.0, -1.0, 0.0, 1.0, 2.6),
        min_length=1,
        description="actions that keep the lane",
    )
    lane_change_accelerations_mps2: Actions = Field(
        (-1.5, 0.0, 1.5), description="actions combined with a change left and right"
    )
    later_accelerations_mps2: Actions = Field(
        (-3.0, 2.6),
        description="those of them that are tried below the root too, beside car following",
    )
    later_lane_change_accelerations_mps2: Actions = Field(
        (0.0,), description="likewise, of those combined with a change"
    )
    reactive: Int = Field(
        0,
        ge=0,
        le=20,
        description="how many of the agents nearest on the ego's path react to it inside the "
        "search; 0: the forecast stands",
    )
    exploration: NonNegative = Field(
        0.8, description="const of the UCB equation, on costs normalised to 0..1"
    )
    impatience: NonNegative = Field(
        0.1,
        description="1/s: after t s of waiting for a gap, what others have to brake in comfort for "
        "the ego costs 1 / (1 + impatience * t) of its price; 0: always all of it",
    )
    risk: Literal["expected", "cvar"] = Field(
        "expected",
        description="what counts of the costs in several hypotheses: their mean, or that of the "
        "worst",
    )
    cvar_alpha: Annotated[Float, Field(ge=0.001, le=1)] = Field(
        0.2,
        description="cvar: share of the worst that may happen, by weight, whose mean cost counts",
    )
    options: dict[str, Any] = Field(
        {}, description="parameters of a plugin, which checks them itself"
    )

    @model_validator(mode="after")
    def _most_is_more(self) -> "PlannerConfig":
        if self.most_iterations is not None and self.most_iterations < self.iterations:
            raise ValueError(
                f"most_iterations: at least iterations ({self.iterations}), got "
                f"{self.most_iterations}"
            )
        return self


class PaperConfig(Section):
    """Planner `paper`: what the text leaves open. The readings are listed in docs/planner.md."""

    step_s: StepTime = Field(1.0, description="T_1")
    look_ahead_steps: Int = Field(2, ge=1, le=12)
    rollout_steps: Int = Field(1, ge=0, le=24)
    exploration: NonNegative = Field(5.0, description="const of the UCB equation, on raw costs")
    brake_probability: Share = Field(0.1, description="rollout: decelerate")
    accelerate_probability: Share = Field(0.1, description="rollout: accelerate; otherwise keep")
    accelerations_mps2: Actions = Field(
        (-8.0, -5.0, -4.0, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0), min_length=1
    )
    lane_change_accelerations_mps2: Actions = Field((0.0,))
    weight_safety: NonNegative = Field(
        10.0,
        description="omega_s: 1 m from another vehicle costs as much as being 10 m further from "
        "the local goal",
    )
    weight_comfort: NonNegative = Field(1.0, description="omega_c")
    weight_passability: NonNegative = Field(1.0, description="omega_p")
    weight_other: NonNegative = Field(1.0, description="omega_o")
    collided: Literal["discard", "skip"] = Field(
        "discard",
        description="a child that collides is never selected; skip: and the pass that finds it "
        "ends there, by Algorithm 1's `continue`",
    )
    visits_of: Literal["parent", "root"] = Field(
        "parent", description="whose visits N of the UCB equation counts"
    )
    dead_end: Literal["rollout", "free"] = Field(
        "rollout",
        description="what is backed up where every child was discarded: a rollout, or a cost of 0",
    )
    choice: Literal["mean", "ucb"] = Field(
        "mean", description="the root's child to take: of lowest mean cost, or of highest UCB"
    )
    counted: Literal["each", "last"] = Field(
        "each", description="J sums the costs of each step, or is those of the last one"
    )
    contact_boxes: Literal["turned", "aligned"] = Field(
        "turned",
        description="contact is between the boxes, or the smallest ones around them that are "
        "parallel to the axes",
    )
    settled_after: Int | None = Field(
        None,
        ge=1,
        le=1_000_000,
        description="stop when so many iterations have changed nothing about the action to take",
    )
    safety_threshold_m: Positive = Field(10.0, description="d_thresh")
    highway_threshold_m: Positive | None = Field(
        None,
        description="d_thresh where the limit is 22.2 m/s or more; null: the same everywhere",
    )
    closing_speed_mps: Positive | None = Field(
        None,
        description="speed of approach that doubles C_s; null: only the distance counts",
    )
    contact_cost: Positive = Field(
        1000.0,
        description="stands for the infinite C_s at contact, 1/m; times omega_s it is paid once",
    )
    jerk_factor: NonNegative = Field(0.1, description="k of C_c = k j^2, s^6/m^2")
    lateral_factor: NonNegative = Field(
        0.0, description="k_lat of C_c = k j^2 + k_lat a_lat^2, s^4/m^2"
    )
    goal_along: Literal["route", "line"] = Field(
        "route", description="d_goal is the way along the route, or the straight line"
    )
    goal_distance_m: Annotated[Float, Field(ge=1, le=1_000_000)] = Field(
        100.0, description="distance of the local goal"
    )
    lane_distance_m: NonNegative = Field(
        20.0, description="what each lane change that the route still needs adds to that distance"
    )
    goal_factor: NonNegative = Field(
        1.0, description="C_p1 per metre to the local goal: the unit of the other costs"
    )
    junction_penalty: NonNegative = Field(
        10.0, description="C_p2 while the junction ahead is not passed"
    )
    lane_change_cost: NonNegative = Field(
        1.0, description="C_o,lc of a lane change, when it begins"
    )
    bypass_cost: NonNegative = Field(
        0.0,
        description="C_o of a lane change away from somebody ahead who stands or drives below half "
        "the limit, on top of lane_change_cost",
    )
    stop_sign_cost: NonNegative = Field(
        0.0, description="C_o of standing at a stop sign at the end of a step, on top of stop_cost"
    )
    stop_cost: NonNegative = Field(2.0, description="C_o of standing at the end of a step")
    turn_cost: NonNegative = Field(
        0.0, description="C_o of turning at a junction at the end of a step"
    )
    emergency_cost: NonNegative = Field(
        5.0, description="C_o of a step of braking beyond comfort_decel_mps2"
    )


class IdmConfig(Section):
    """Planner `idm`: car following (IDM), and the gaps that it accepts at junctions and for lane
    changes."""

    headway_s: Headway = Field(1.5, description="time headway")
    min_gap_m: Gap = Field(2.0, description="gap at standstill")
    accel_mps2: Acceleration = Field(
        2.0, description="acceleration; never beyond ego_model.max_accel_mps2"
    )
    decel_mps2: Acceleration = Field(2.0, description="comfortable deceleration")
    critical_gap_s: Delay = Field(
        5.0,
        description="smallest time until a vehicle with the right of way arrives at which the ego "
        "leaves its stop line",
    )
    cut_in_decel_mps2: Acceleration = Field(
        2.0,
        description="braking to which a lane change may bring the vehicle behind, by the same car "
        "following",
    )


class FailSafeConfig(Section):
    """The last check before a decision is executed, and what the others may do meanwhile."""

    on: Flag = Field(
        False,
        description="execute only decisions after which a safe end can be reached, whatever the "
        "others do within these bounds",
    )
    decel_mps2: Acceleration = Field(4.5, description="others brake with at most this")
    accel_mps2: Acceleration = Field(2.6, description="others accelerate with at most this")
    over_limit: Annotated[Float, Field(ge=1, le=10)] = Field(
        1.25, description="up to so many times the limit, or up to the speed that they have"
    )
    reaction_s: Delay = Field(
        1.0,
        description="an agent in front of which the ego moves accelerates so long before it brakes",
    )
    yield_decel_mps2: Acceleration = Field(4.5, description="and then brakes with at least this")
    horizon_s: Annotated[Float, Field(ge=0.1, le=60)] = Field(
        6.0, description="how long the ego has to be safe at its stop too, from now"
    )
    most_failures: Count = Field(
        10,
        description="so many decisions in a row may fail (raise, or be nonsense); one more ends "
        "the episode as error",
    )
