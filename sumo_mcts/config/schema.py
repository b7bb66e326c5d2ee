"""What a scenario file may say: every key with its unit, its default and its bounds.

Unknown keys are refused.
"""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from sumo_mcts.config.names import PlannerName, PredictorName, TermName
from sumo_mcts.config.values import (
    Acceleration,
    Actions,
    Count,
    CrowdSize,
    Delay,
    Edges,
    FileName,
    FileNames,
    Flag,
    Float,
    Gap,
    Headway,
    Id,
    Int,
    Jerk,
    LaneNumber,
    Metres,
    Milliseconds,
    NonNegative,
    Part,
    Positive,
    Share,
    Speed,
    StepTime,
    SumoValue,
    TopSpeed,
)
from sumo_mcts.registry import PLANNERS, PREDICTORS

SCHEMA_VERSION = 1
CROWD_ID = "crowd_"
MOST_STATES = 2000  # of a forecast: they are kept for every agent and hypothesis


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)


class SumoConfig(_Section):
    """The simulation: either a .sumocfg, or a network with routes."""

    sumocfg: FileName | None = Field(
        None, description="a .sumocfg file; its settings stay as they are"
    )
    net: FileName | None = Field(None, description="network (.net.xml, .net.xml.gz)")
    routes: FileNames = Field((), description="route files")
    additional: FileNames = Field(
        (), description="additional files: vehicle types, signal plans, stops"
    )
    step_length_s: Annotated[Float, Field(ge=0.001, le=10)] | None = Field(
        None, description="step of the simulation; default 0.1, with a sumocfg its own"
    )
    options: dict[str, SumoValue] = Field(
        {}, description="further SUMO options, without the dashes"
    )

    @model_validator(mode="after")
    def _one_source(self) -> "SumoConfig":
        if (self.sumocfg is None) == (self.net is None):
            raise ValueError("give either sumocfg or net")
        return self


class EgoConfig(_Section):
    """A vehicle that the planner drives."""

    id: Id = Field(description="vehicle id")
    until: Id | None = Field(
        None, description="the goal: the end of this edge; default the last of its route"
    )


class Depart(_Section):
    """Where and how an actor enters."""

    time_s: NonNegative = Field(0.0, description="when it enters")
    lane: LaneNumber = Field(0, description="lane of the first edge, 0 = rightmost")
    pos_m: Metres = Field(0.0, description="position of its front on the first edge")
    speed_mps: Speed = Field(0.0, description="speed at entry")


class Event(_Section):
    """Something that a vehicle is told to do: when, and exactly one of change_lane, slow_to_mps,
    stop_for_s."""

    at_s: NonNegative | None = Field(None, description="when: seconds after the actor's departure")
    at_m: Metres | None = Field(None, description="or where: metres driven since its departure")
    change_lane: Literal["left", "right"] | None = Field(
        None, description="change to the next lane on that side"
    )
    slow_to_mps: Speed | None = Field(
        None, description="reach this speed (also a higher one) and keep it"
    )
    stop_for_s: Positive | None = Field(
        None, description="brake to a stand, stand this long, go on at the speed it had"
    )
    accel_mps2: Acceleration = Field(2.5, description="acceleration with which the speed changes")

    @model_validator(mode="after")
    def _one_of_each(self) -> "Event":
        if (self.at_s is None) == (self.at_m is None):
            raise ValueError("give either at_s or at_m")
        if sum(x is not None for x in (self.change_lane, self.slow_to_mps, self.stop_for_s)) != 1:
            raise ValueError("give exactly one of change_lane, slow_to_mps, stop_for_s")
        return self


class Vary(_Section):
    """How far a drawn scene may lie from the written one: uniform within +- these, times
    traffic.vary."""

    pos_m: Metres = Field(0.0, description="departure position")
    speed_mps: Speed = Field(0.0, description="departure speed and the speeds of its events")
    time_s: NonNegative = Field(0.0, description="departure and event times")


class Actor(_Section):
    """A vehicle of the scene.

    `script` holds its speeds and lanes whatever happens; `sumo` drives like SUMO's own traffic.
    """

    id: Id
    route: Edges = Field(description="edges")
    depart: Depart = Depart()
    driver: Literal["sumo", "script"] = "sumo"
    max_speed_mps: TopSpeed | None = Field(
        None, description="its own top speed; default its vehicle type's"
    )
    vtype: Id = Field("DEFAULT_VEHTYPE", description="vehicle type")
    events: tuple[Event, ...] = Field((), max_length=1000)
    vary: Vary = Vary()


class VehicleEvent(Event):
    """An event for a vehicle of the route files."""

    vehicle: Id


class DriversConfig(_Section):
    """Shares of the kinds of drivers, drawn for every vehicle of actors and crowd that SUMO drives.

    All 0: their vehicle types stand.
    """

    ordinary: Part = Field(0.0, description="keeps its distance and roughly to the limit")
    aggressive: Part = Field(
        0.0, description="drives close and fast, takes small gaps, lets nobody in"
    )
    inattentive: Part = Field(
        0.0, description="dawdles, and now and then overlooks who has the right of way"
    )


class Stream(_Section):
    """A way that vehicles of the crowd may take."""

    route: Edges = Field(description="edges")
    lanes: tuple[LaneNumber, ...] = Field(
        (0,), min_length=1, max_length=100, description="lanes of the first edge, 0 = rightmost"
    )
    pos_m: tuple[Metres, Metres] = Field(
        (0.0, 0.0), description="from and to: where those are who are there from the start"
    )
    speed_mps: tuple[Speed, Speed] = Field(
        (5.0, 10.0),
        description="from and to: their speed; SUMO refuses more than the limit times the driver's "
        "speed factor, 0.8 at least",
    )

    @model_validator(mode="after")
    def _ascending(self) -> "Stream":
        _in_order("pos_m", self.pos_m)
        _in_order("speed_mps", self.speed_mps)
        return self


class CrowdConfig(_Section):
    """Further vehicles, driven by SUMO and drawn by the seed: crowd_1, crowd_2, ..."""

    count: tuple[CrowdSize, CrowdSize] = Field((0, 0), description="from and to: how many")
    streams: tuple[Stream, ...] = Field((), max_length=1000)
    late: Share = Field(
        0.5,
        description="share of those that enter later, at the beginning of their way, as does "
        "whoever finds no room at the start",
    )
    within_s: Positive = Field(
        20.0, description="they enter within this time, or as soon as SUMO finds room after it"
    )

    @model_validator(mode="after")
    def _drawable(self) -> "CrowdConfig":
        _in_order("count", self.count)
        if self.count[1] > 0 and not self.streams:
            raise ValueError("count: give streams too")
        return self


def _in_order(key: str, pair: tuple[float, float]) -> None:
    if pair[0] > pair[1]:
        raise ValueError(f"{key}: give the smaller number first")


class TrafficConfig(_Section):
    """Vehicles and events that the scenario adds to the route files."""

    actors: tuple[Actor, ...] = Field((), max_length=2000)
    crowd: CrowdConfig = CrowdConfig()
    drivers: DriversConfig = DriversConfig()
    events: tuple[VehicleEvent, ...] = Field((), max_length=2000)
    vary: Annotated[Float, Field(ge=0, le=3)] = Field(
        1.0, description="scale of all `vary` entries; 0 = the fixed scene"
    )

    @model_validator(mode="after")
    def _ids_are_free(self) -> "TrafficConfig":
        taken = [actor.id for actor in self.actors if actor.id.startswith(CROWD_ID)]
        if self.crowd.count[1] > 0 and taken:
            raise ValueError(f"actors: {taken[0]}: ids that begin with {CROWD_ID} are the crowd's")
        return self


class EpisodeConfig(_Section):
    """When an episode ends."""

    stop_time_s: Positive | None = Field(
        None, description="time limit after departure; default time_limit_s"
    )
    success_edge: Id | None = Field(
        None,
        description="arrived as soon as the front is on this edge; default the end of the goal "
        "edge",
    )
    time_limit_s: Positive | None = Field(
        None, description="time limit after departure; default 3 x free-flow time + 120"
    )
    depart_limit_s: Positive = Field(3600.0, description="how long to wait for the ego's departure")


class SensorConfig(_Section):
    """What the planner may know."""

    range_m: Annotated[Float, Field(ge=1, le=10_000)] = Field(200.0, description="sensor range")
    signals: Literal["timing", "current"] = Field(
        "timing",
        description="coming signal phases are broadcast, up to one whose end the traffic decides, "
        "or only the present state is seen",
    )
    position_error_m: Annotated[Float, Field(ge=0, le=100)] = Field(
        0.0, description="standard deviation of the error of an agent's position, along each axis"
    )
    speed_error_mps: Annotated[Float, Field(ge=0, le=100)] = Field(
        0.0, description="standard deviation of the error of an agent's speed"
    )
    error_time_s: Positive = Field(
        1.0,
        description="time after which the share 1/e of an error is left: a tracker's errors last",
    )
    drop_probability: Share = Field(
        0.0, description="probability that an agent is not seen in a cycle"
    )
    occlusion: Flag = Field(False, description="whether vehicles hide whom they stand before")
    visible_share: Share = Field(
        0.1,
        description="occlusion: share of an agent, as an angle seen from the ego's centre, that "
        "has to be in view",
    )
    memory_s: NonNegative = Field(
        5.0, description="how long an agent that was dropped or hidden is remembered"
    )


_ORACLES = ", ".join(
    f"{row.name} ({row.label})" for row in PREDICTORS.values() if row.oracle is not None
)


class PredictionConfig(_Section):
    """The forward-predicted copy of the traffic."""

    name: PredictorName = Field(
        "idm",
        description=f"the oracles are {_ORACLES}; or a plugin, see extending.md",
    )
    step_s: StepTime = Field(0.2, description="time between forecast states")
    headway_s: Headway = Field(1.2, description="IDM time headway of the others")
    min_gap_m: Gap = Field(2.0, description="IDM gap at standstill")
    accel_mps2: Acceleration = Field(2.0, description="IDM acceleration of the others")
    decel_mps2: Acceleration = Field(2.5, description="IDM comfortable deceleration of the others")
    yield_decel_mps2: Acceleration = Field(
        2.5, description="an agent is expected to yield only if this deceleration suffices"
    )
    yield_gap_s: Delay = Field(1.0, description="time gap that a yielding agent accepts")
    stays_after_s: NonNegative = Field(
        2.0, description="a vehicle that stood this long without a cause is expected to stay"
    )
    persistence_s: NonNegative = Field(
        2.0,
        description="time after which 1/e is left of an agent's accelerating otherwise than the "
        "model has it (nothing fades of who keeps its speed); 0: none",
    )
    room_on_foot_m: Annotated[Float, Field(ge=0, le=10)] = Field(
        0.4,
        description="room around whoever is on foot, who may turn or stop at any time; at most "
        "half of what is between them and the ego now",
    )
    hypotheses: Int = Field(
        4,
        ge=1,
        le=8,
        description="how many joint hypotheses about the others planner mcts weighs at most: "
        "another turn, not yielding, braking, starting, stopping on foot; "
        "only with idm, the other forecasts have one",
    )
    options: dict[str, Any] = Field(
        {}, description="parameters of a plugin, which checks them itself"
    )


class EgoModelConfig(_Section):
    """How the ego may move, in the plan and in SUMO alike."""

    jerk_mps3: Jerk = Field(4.0, description="jerk of ordinary actions")
    emergency_jerk_mps3: Jerk = Field(20.0, description="jerk of braking beyond comfort_decel_mps2")
    comfort_decel_mps2: Acceleration = Field(
        3.0, description="strongest braking with the ordinary jerk"
    )
    max_decel_mps2: Acceleration = Field(
        8.0, description="strongest braking at all; never beyond the vehicle type's emergencyDecel"
    )
    max_accel_mps2: Acceleration = Field(
        2.6, description="strongest acceleration; never beyond the vehicle type's accel"
    )
    approach_decel_mps2: Acceleration = Field(
        2.0, description="braking towards lower limits, stop lines and the end of a lane"
    )
    stop_gap_m: Float = Field(
        1.0, ge=0.0, le=2.0, description="distance to the stop line at standstill"
    )


class PlannerConfig(_Section):
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
        description="how many of the agents nearest on the ego's way react to it inside the "
        "search; 0: the forecast stands",
    )
    exploration: NonNegative = Field(
        0.8, description="const of the UCB equation, on costs normalised to 0..1"
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


class PaperConfig(_Section):
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
    safety_threshold_m: Positive = Field(10.0, description="d_thresh")
    contact_cost: Positive = Field(
        1000.0,
        description="stands for the infinite C_s at contact, 1/m; times omega_s it is paid once",
    )
    jerk_factor: NonNegative = Field(0.1, description="k of C_c = k j^2, s^6/m^2")
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
    stop_cost: NonNegative = Field(2.0, description="C_o of standing at the end of a step")
    turn_cost: NonNegative = Field(
        0.0, description="C_o of turning at a junction at the end of a step"
    )
    emergency_cost: NonNegative = Field(
        5.0, description="C_o of a step of braking beyond comfort_decel_mps2"
    )


class IdmConfig(_Section):
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
        description="time from the ego at the stop line to whoever has the right of way, from "
        "which it goes",
    )
    cut_in_decel_mps2: Acceleration = Field(
        2.0,
        description="braking to which a lane change may bring whoever is behind, by the same car "
        "following",
    )


class CostConfig(_Section):
    """The terms of J for planner `mcts`. One unit is one second of standing still."""

    contact: Positive = Field(
        60.0, description="predicted contact now; falls linearly to half of it at the horizon"
    )
    speed_at_contact: NonNegative = Field(1.0, description="added per m/s of speed at contact")
    headway_s: Delay = Field(1.2, description="time gap below which following costs")
    headway_gap_m: Annotated[Float, Field(ge=0, le=100)] = Field(
        2.0, description="gap that belongs to it at standstill"
    )
    headway: NonNegative = Field(1.5, description="per second at no gap at all")
    claim_s: Delay = Field(1.6, description="time for which an agent's way ahead belongs to it")
    claim: NonNegative = Field(
        16.0, description="per second of standing in the way of an agent that will be there at once"
    )
    acceleration: NonNegative = Field(0.02, description="per second at 1 m/s2, quadratic")
    jerk: NonNegative = Field(
        0.005, description="k of C_c = k j^2 per second, saturating at 10 m/s3"
    )
    braking: NonNegative = Field(
        0.5, description="per second and m/s2 of braking beyond comfort_decel_mps2, quadratic"
    )
    imposed: NonNegative = Field(
        2.0,
        description="per second and m/s2 of braking beyond 2 m/s2 that the ego forces on an agent "
        "that the search moves",
    )
    cut_in_decel_mps2: Acceleration = Field(
        3.0,
        description="braking that a follower is trusted to do when the ego moves in front of it",
    )
    progress: NonNegative = Field(
        1.0, description="per second of standing where the limit could be driven"
    )
    tail_s: Delay = Field(
        8.0,
        description="for how long beyond the horizon a slow leader, or the end of a lane, still "
        "counts",
    )
    blocking: NonNegative = Field(0.3, description="per second of standing inside a junction")
    astride: NonNegative = Field(
        4.0,
        description="per second of standing across two lanes: whoever follows in the one that the "
        "ego leaves takes it to be free",
    )
    route: NonNegative = Field(
        2.0, description="per second on a lane that the route leaves, at full urgency"
    )
    lane_change: NonNegative = Field(0.6, description="C_o,lc per change begun")
    red: Positive = Field(100.0, description="entering on red")
    term: TermName | None = Field(
        None, description="a further term of your own: a plugin, see extending.md"
    )
    term_weight: NonNegative = Field(1.0, description="handed to it")


class FailSafeConfig(_Section):
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


class ScenarioConfig(_Section):
    """One scenario file."""

    name: str = Field(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=100, description="safe as a file name"
    )
    description: str = Field("", max_length=10_000)
    sumo: SumoConfig
    egos: tuple[EgoConfig, ...] = Field(min_length=1, max_length=100)
    traffic: TrafficConfig = TrafficConfig()
    episode: EpisodeConfig = EpisodeConfig()
    sensor: SensorConfig = SensorConfig()
    prediction: PredictionConfig = PredictionConfig()
    ego_model: EgoModelConfig = EgoModelConfig()
    planner: PlannerConfig = PlannerConfig()
    paper: PaperConfig = PaperConfig()
    idm: IdmConfig = IdmConfig()
    cost: CostConfig = CostConfig()
    failsafe: FailSafeConfig = FailSafeConfig()

    @field_validator("egos")
    @classmethod
    def _each_once(cls, egos: tuple[EgoConfig, ...]) -> tuple[EgoConfig, ...]:
        ids = [ego.id for ego in egos]
        twice = next((name for name in ids if ids.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"{twice} is named twice")
        return egos

    @model_validator(mode="after")
    def _forecast_fits(self) -> "ScenarioConfig":
        row = PLANNERS.get(self.planner.name)
        section = "planner" if row is None else row.section
        plan = getattr(self, section)
        states = (plan.look_ahead_steps + plan.rollout_steps) * plan.step_s / self.prediction.step_s
        if states > MOST_STATES:
            raise ValueError(
                f"prediction.step_s: with {section}.look_ahead_steps, {section}.rollout_steps and "
                f"{section}.step_s a forecast of {states:.0f} states; "
                f"allowed are {MOST_STATES}"
            )
        return self

    @property
    def reproducible(self) -> bool:
        """Whether no clock has a say in decisions."""
        return self.planner.time_budget_ms is None and not self.planner.enforce_deadline
