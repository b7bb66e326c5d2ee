"""What a scenario file may say: every key with its unit, its default and its bounds. Unknown keys are refused."""

import hashlib
import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from importlib import metadata
from operator import index
from pathlib import Path
from typing import Annotated, Any, Literal, SupportsIndex

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, WithJsonSchema, field_validator, model_validator

from sumo_mcts import files, yaml_file
from sumo_mcts.errors import ConfigError as ConfigError  # noqa: PLC0414  # for those who look for it here
from sumo_mcts.errors import shown
from sumo_mcts.yaml_file import YamlError

SCHEMA_VERSION = 1
CROWD_ID = "crowd_"

PLANNERS = ("mcts", "paper", "idm", "random", "sumo", "constant", "exhaustive")
PREDICTORS = ("idm", "constant_velocity", "routes", "script", "clone")
ORACLES = ("routes", "script", "clone")  # of these, those that know what no sensor sees;
ORACLE_MARK = " (oracle)"  # one of the user's own has this behind its name wherever results name it
# Where installed packages name planners, predictors and cost terms of their own (entry points).
PLANNER_GROUP, PREDICTOR_GROUP, TERM_GROUP = "sumo_mcts.planners", "sumo_mcts.predictors", "sumo_mcts.cost_terms"
_CODE = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")

MOST_BASES = 20  # scenario files laid over each other
MOST_SEED = 2**31 - 1  # SUMO's largest
MOST_OF_OPTION = 1e9  # a number among SUMO's options
MOST_ID = 500  # characters
MOST_STATES = 2000  # of a forecast: they are kept for every agent and hypothesis


def _id(text: str) -> str:
    """The text, if SUMO could take it for an id. Raises ValueError."""
    if not 0 < len(text) <= MOST_ID or any(c.isspace() or not c.isprintable() for c in text):
        raise ValueError(f"has to be a text of 1 to {MOST_ID} characters without spaces, line breaks and control characters")
    return text


# Every number has bounds: beyond them memory, time or arithmetic gives out. True and "1" are no numbers.
_Float = Annotated[float, Field(strict=True, allow_inf_nan=False)]
_Int = Annotated[int, Field(strict=True)]
Positive = Annotated[_Float, Field(ge=0.01, le=1_000_000)]
NonNegative = Annotated[_Float, Field(ge=0, le=1_000_000)]
Share = Annotated[_Float, Field(ge=0, le=1)]
Part = Annotated[_Float, Field(ge=0, le=1000)]
Metres = Annotated[_Float, Field(ge=0, le=1_000_000)]
Speed = Annotated[_Float, Field(ge=0, le=200)]
TopSpeed = Annotated[_Float, Field(ge=0.1, le=200)]
Acceleration = Annotated[_Float, Field(ge=0.01, le=100)]
Jerk = Annotated[_Float, Field(ge=0.01, le=1000)]
Headway = Annotated[_Float, Field(ge=0.01, le=60)]
Gap = Annotated[_Float, Field(ge=0.01, le=100)]
StepTime = Annotated[_Float, Field(ge=0.01, le=10)]
Delay = Annotated[_Float, Field(ge=0, le=60)]
Milliseconds = Annotated[_Float, Field(ge=0.01, le=60_000)]
Action = Annotated[_Float, Field(ge=-20, le=20)]
Actions = Annotated[tuple[Action, ...], Field(max_length=32)]
LaneNumber = Annotated[_Int, Field(ge=0, le=100)]
Count = Annotated[_Int, Field(ge=0, le=1_000_000)]
CrowdSize = Annotated[_Int, Field(ge=0, le=500)]
Flag = Annotated[bool, Field(strict=True)]
Id = Annotated[str, AfterValidator(_id)]
FileName = Annotated[str, Field(min_length=1, max_length=4000)]
FileNames = Annotated[tuple[FileName, ...], Field(max_length=1000)]
Edges = Annotated[tuple[Id, ...], Field(min_length=1, max_length=2000)]


def _or_plugin(builtin: tuple[str, ...], group: str) -> tuple[AfterValidator, WithJsonSchema]:
    """The type of a name of ours, or of a plugin's."""
    any_name = {"type": "string"}
    schema = {"anyOf": [{"type": "string", "enum": list(builtin)}, any_name]} if builtin else any_name
    return AfterValidator(lambda name: _known(name, builtin, group)), WithJsonSchema(schema)


def _known(name: str, builtin: tuple[str, ...], group: str) -> str:
    """The name, if it is ours or a plugin's. Raises ValueError."""
    if name in builtin or is_plugin(name, group):
        return name
    ours = f"{', '.join(map(repr, builtin))}, " if builtin else ""
    raise ValueError(f"has to be {ours}an installed plugin ({', '.join(_installed(group)) or 'there is none'}) or module:name")


def is_plugin(name: str, group: str) -> bool:
    """Whether a name is that of an installed plugin, or code of the user's own as module:name."""
    return _CODE.fullmatch(name) is not None or name in _installed(group)


def _installed(group: str) -> list[str]:
    return sorted(metadata.entry_points(group=group).names)


PlannerName = Annotated[str, *_or_plugin(PLANNERS, PLANNER_GROUP)]
PredictorName = Annotated[str, *_or_plugin(PREDICTORS, PREDICTOR_GROUP)]
TermName = Annotated[str, *_or_plugin((), TERM_GROUP)]


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)


def _scalar(value: object) -> object:
    if not isinstance(value, str | int | float | bool):
        raise ValueError("has to be a text, a number, true or false")
    if isinstance(value, int | float) and not abs(value) <= MOST_OF_OPTION:
        raise ValueError(f"has to be a number from -{MOST_OF_OPTION:.0f} to {MOST_OF_OPTION:.0f}")
    return value


_SumoInt = Annotated[int, Field(strict=True, ge=-MOST_OF_OPTION, le=MOST_OF_OPTION)]
_SumoFloat = Annotated[float, Field(strict=True, ge=-MOST_OF_OPTION, le=MOST_OF_OPTION)]
SumoValue = Annotated[str | _SumoInt | _SumoFloat | bool, BeforeValidator(_scalar)]


class SumoConfig(_Section):
    """The simulation: either a .sumocfg, or a network with routes."""

    sumocfg: FileName | None = Field(None, description="a .sumocfg file; its settings stay as they are")
    net: FileName | None = Field(None, description="network (.net.xml, .net.xml.gz)")
    routes: FileNames = Field((), description="route files")
    additional: FileNames = Field((), description="additional files: vehicle types, signal plans, stops")
    step_length_s: Annotated[_Float, Field(ge=0.001, le=10)] | None = Field(None, description="step of the simulation; default 0.1, with a sumocfg its own")
    options: dict[str, SumoValue] = Field({}, description="further SUMO options, without the dashes")

    @model_validator(mode="after")
    def _one_source(self) -> "SumoConfig":
        if (self.sumocfg is None) == (self.net is None):
            raise ValueError("give either sumocfg or net")
        return self


class EgoConfig(_Section):
    """A vehicle that the planner drives."""

    id: Id = Field(description="vehicle id")
    until: Id | None = Field(None, description="the goal: the end of this edge; default the last of its route")


class Depart(_Section):
    """Where and how an actor enters."""

    time_s: NonNegative = Field(0.0, description="when it enters")
    lane: LaneNumber = Field(0, description="lane of the first edge, 0 = rightmost")
    pos_m: Metres = Field(0.0, description="position of its front on the first edge")
    speed_mps: Speed = Field(0.0, description="speed at entry")


class Event(_Section):
    """Something that a vehicle is told to do: when, and exactly one of change_lane, slow_to_mps, stop_for_s."""

    at_s: NonNegative | None = Field(None, description="when: seconds after the actor's departure")
    at_m: Metres | None = Field(None, description="or where: metres driven since its departure")
    change_lane: Literal["left", "right"] | None = Field(None, description="change to the next lane on that side")
    slow_to_mps: Speed | None = Field(None, description="reach this speed (also a higher one) and keep it")
    stop_for_s: Positive | None = Field(None, description="brake to a stand, stand this long, go on at the speed it had")
    accel_mps2: Acceleration = Field(2.5, description="acceleration with which the speed changes")

    @model_validator(mode="after")
    def _one_of_each(self) -> "Event":
        if (self.at_s is None) == (self.at_m is None):
            raise ValueError("give either at_s or at_m")
        if sum(x is not None for x in (self.change_lane, self.slow_to_mps, self.stop_for_s)) != 1:
            raise ValueError("give exactly one of change_lane, slow_to_mps, stop_for_s")
        return self


class Vary(_Section):
    """How far a drawn scene may lie from the written one: uniform within +- these, times traffic.vary."""

    pos_m: Metres = Field(0.0, description="departure position")
    speed_mps: Speed = Field(0.0, description="departure speed and the speeds of its events")
    time_s: NonNegative = Field(0.0, description="departure and event times")


class Actor(_Section):
    """A vehicle of the scene. `script` holds its speeds and lanes whatever happens; `sumo` drives like SUMO's own traffic."""

    id: Id
    route: Edges = Field(description="edges")
    depart: Depart = Depart()
    driver: Literal["sumo", "script"] = "sumo"
    max_speed_mps: TopSpeed | None = Field(None, description="its own top speed; default its vehicle type's")
    vtype: Id = Field("DEFAULT_VEHTYPE", description="vehicle type")
    events: tuple[Event, ...] = Field((), max_length=1000)
    vary: Vary = Vary()


class VehicleEvent(Event):
    """An event for a vehicle of the route files."""

    vehicle: Id


class DriversConfig(_Section):
    """Shares of the kinds of drivers, drawn for every vehicle of actors and crowd that SUMO drives. All 0: their vehicle types stand."""

    ordinary: Part = Field(0.0, description="keeps its distance and roughly to the limit")
    aggressive: Part = Field(0.0, description="drives close and fast, takes small gaps, lets nobody in")
    inattentive: Part = Field(0.0, description="dawdles, and now and then overlooks who has the right of way")


class Stream(_Section):
    """A way that vehicles of the crowd may take."""

    route: Edges = Field(description="edges")
    lanes: tuple[LaneNumber, ...] = Field((0,), min_length=1, max_length=100, description="lanes of the first edge, 0 = rightmost")
    pos_m: tuple[Metres, Metres] = Field((0.0, 0.0), description="from and to: where those are who are there from the start")
    speed_mps: tuple[Speed, Speed] = Field(
        (5.0, 10.0), description="from and to: their speed; SUMO refuses more than the limit times the driver's speed factor, 0.8 at least"
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
    late: Share = Field(0.5, description="share of those that enter later, at the beginning of their way, as does whoever finds no room at the start")
    within_s: Positive = Field(20.0, description="they enter within this time, or as soon as SUMO finds room after it")

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
    vary: Annotated[_Float, Field(ge=0, le=3)] = Field(1.0, description="scale of all `vary` entries; 0 = the fixed scene")

    @model_validator(mode="after")
    def _ids_are_free(self) -> "TrafficConfig":
        taken = [actor.id for actor in self.actors if actor.id.startswith(CROWD_ID)]
        if self.crowd.count[1] > 0 and taken:
            raise ValueError(f"actors: {taken[0]}: ids that begin with {CROWD_ID} are the crowd's")
        return self


class EpisodeConfig(_Section):
    """When an episode ends."""

    stop_time_s: Positive | None = Field(None, description="time limit after departure; default time_limit_s")
    success_edge: Id | None = Field(None, description="arrived as soon as the front is on this edge; default the end of the goal edge")
    time_limit_s: Positive | None = Field(None, description="time limit after departure; default 3 x free-flow time + 120")
    depart_limit_s: Positive = Field(3600.0, description="how long to wait for the ego's departure")


class SensorConfig(_Section):
    """What the planner may know."""

    range_m: Annotated[_Float, Field(ge=1, le=10_000)] = Field(200.0, description="sensor range")
    signals: Literal["timing", "current"] = Field(
        "timing", description="coming signal phases are broadcast, up to one whose end the traffic decides, or only the present state is seen"
    )
    position_error_m: Annotated[_Float, Field(ge=0, le=100)] = Field(0.0, description="standard deviation of the error of an agent's position, along each axis")
    speed_error_mps: Annotated[_Float, Field(ge=0, le=100)] = Field(0.0, description="standard deviation of the error of an agent's speed")
    error_time_s: Positive = Field(1.0, description="time after which the share 1/e of an error is left: a tracker's errors last")
    drop_probability: Share = Field(0.0, description="probability that an agent is not seen in a cycle")
    occlusion: Flag = Field(False, description="whether vehicles hide whom they stand before")
    visible_share: Share = Field(0.1, description="occlusion: share of an agent, as an angle seen from the ego's centre, that has to be in view")
    memory_s: NonNegative = Field(5.0, description="how long an agent that was dropped or hidden is remembered")


class PredictionConfig(_Section):
    """The forward-predicted copy of the traffic."""

    name: PredictorName = Field(
        "idm",
        description="routes, script and clone are oracles: idm along the agents' true next lanes, the scripts of a scripted scene, and what a copy of the "
        "running simulation does (Linux, without a window); or a plugin, see extending.md",
    )
    step_s: StepTime = Field(0.2, description="time between forecast states")
    headway_s: Headway = Field(1.2, description="IDM time headway of the others")
    min_gap_m: Gap = Field(2.0, description="IDM gap at standstill")
    accel_mps2: Acceleration = Field(2.0, description="IDM acceleration of the others")
    decel_mps2: Acceleration = Field(2.5, description="IDM comfortable deceleration of the others")
    yield_decel_mps2: Acceleration = Field(2.5, description="an agent is expected to yield only if this deceleration suffices")
    yield_gap_s: Delay = Field(1.0, description="time gap that a yielding agent accepts")
    stays_after_s: NonNegative = Field(2.0, description="a vehicle that stood this long without a cause is expected to stay")
    persistence_s: NonNegative = Field(
        2.0,
        description="time after which 1/e is left of an agent's accelerating otherwise than the model has it (nothing fades of who keeps its speed); 0: none",
    )
    room_on_foot_m: Annotated[_Float, Field(ge=0, le=10)] = Field(
        0.4, description="room around whoever is on foot, who may turn or stop at any time; at most half of what is between them and the ego now"
    )
    hypotheses: _Int = Field(
        4,
        ge=1,
        le=8,
        description="how many joint hypotheses about the others planner mcts weighs at most: another turn, not yielding, braking, starting, stopping on foot; "
        "only with idm, the other forecasts have one",
    )
    options: dict[str, Any] = Field({}, description="parameters of a plugin, which checks them itself")


class EgoModelConfig(_Section):
    """How the ego may move, in the plan and in SUMO alike."""

    jerk_mps3: Jerk = Field(4.0, description="jerk of ordinary actions")
    emergency_jerk_mps3: Jerk = Field(20.0, description="jerk of braking beyond comfort_decel_mps2")
    comfort_decel_mps2: Acceleration = Field(3.0, description="strongest braking with the ordinary jerk")
    max_decel_mps2: Acceleration = Field(8.0, description="strongest braking at all; never beyond the vehicle type's emergencyDecel")
    max_accel_mps2: Acceleration = Field(2.6, description="strongest acceleration; never beyond the vehicle type's accel")
    approach_decel_mps2: Acceleration = Field(2.0, description="braking towards lower limits, stop lines and the end of a lane")
    stop_gap_m: _Float = Field(1.0, ge=0.0, le=2.0, description="distance to the stop line at standstill")


class PlannerConfig(_Section):
    """The search."""

    name: PlannerName = "mcts"
    iterations: _Int = Field(1000, ge=1, le=1_000_000, description="iteration budget of one decision")
    adaptive: Flag = Field(True, description="leave out what cannot become the best, and stop when nothing else is left")
    most_iterations: _Int | None = Field(None, ge=1, le=1_000_000, description="go on so far while the choice is close; default: no further than `iterations`")
    close_cost: NonNegative = Field(0.2, description="difference of J up to which another command than the best is close")
    time_budget_ms: Milliseconds | None = Field(None, description="time budget of one decision instead, from the scene to the decision (not reproducible)")
    enforce_deadline: Flag = Field(False, description="a decision later than the time budget, else the period, is not executed (not reproducible)")
    period_s: StepTime = Field(0.5, description="decision period; in whole steps of the simulation, one at least")
    step_s: StepTime = Field(1.0, description="duration of one action in the tree of planner mcts")
    look_ahead_steps: _Int = Field(6, ge=1, le=12, description="levels of the tree")
    rollout_steps: _Int = Field(2, ge=0, le=24, description="further steps to the terminal state")
    check_s: StepTime = Field(0.2, description="time between collision checks")
    accelerations_mps2: Actions = Field((-8.0, -4.5, -3.0, -2.0, -1.0, 0.0, 1.0, 2.6), min_length=1, description="actions that keep the lane")
    lane_change_accelerations_mps2: Actions = Field((-1.5, 0.0, 1.5), description="actions combined with a change left and right")
    later_accelerations_mps2: Actions = Field((-3.0, 2.6), description="those of them that are tried below the root too, beside car following")
    later_lane_change_accelerations_mps2: Actions = Field((0.0,), description="likewise, of those combined with a change")
    reactive: _Int = Field(0, ge=0, le=20, description="how many of the agents nearest on the ego's way react to it inside the search; 0: the forecast stands")
    exploration: NonNegative = Field(0.8, description="const of the UCB equation, on costs normalised to 0..1")
    risk: Literal["expected", "cvar"] = Field("expected", description="what counts of the costs in several hypotheses: their mean, or that of the worst")
    cvar_alpha: Annotated[_Float, Field(ge=0.001, le=1)] = Field(0.2, description="cvar: share of the worst that may happen, by weight, whose mean cost counts")
    options: dict[str, Any] = Field({}, description="parameters of a plugin, which checks them itself")

    @model_validator(mode="after")
    def _most_is_more(self) -> "PlannerConfig":
        if self.most_iterations is not None and self.most_iterations < self.iterations:
            raise ValueError(f"most_iterations: at least iterations ({self.iterations}), got {self.most_iterations}")
        return self


class PaperConfig(_Section):
    """Planner `paper`: what the text leaves open. The readings are listed in docs/planner.md."""

    step_s: StepTime = Field(1.0, description="T_1")
    look_ahead_steps: _Int = Field(2, ge=1, le=12)
    rollout_steps: _Int = Field(1, ge=0, le=24)
    exploration: NonNegative = Field(5.0, description="const of the UCB equation, on raw costs")
    brake_probability: Share = Field(0.1, description="rollout: decelerate")
    accelerate_probability: Share = Field(0.1, description="rollout: accelerate; otherwise keep")
    accelerations_mps2: Actions = Field((-8.0, -5.0, -4.0, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0), min_length=1)
    lane_change_accelerations_mps2: Actions = Field((0.0,))
    weight_safety: NonNegative = Field(10.0, description="omega_s: 1 m from another vehicle costs as much as being 10 m further from the local goal")
    weight_comfort: NonNegative = Field(1.0, description="omega_c")
    weight_passability: NonNegative = Field(1.0, description="omega_p")
    weight_other: NonNegative = Field(1.0, description="omega_o")
    safety_threshold_m: Positive = Field(10.0, description="d_thresh")
    contact_cost: Positive = Field(1000.0, description="stands for the infinite C_s at contact, 1/m; times omega_s it is paid once")
    jerk_factor: NonNegative = Field(0.1, description="k of C_c = k j^2, s^6/m^2")
    goal_distance_m: Annotated[_Float, Field(ge=1, le=1_000_000)] = Field(100.0, description="distance of the local goal")
    lane_distance_m: NonNegative = Field(20.0, description="what each lane change that the route still needs adds to that distance")
    goal_factor: NonNegative = Field(1.0, description="C_p1 per metre to the local goal: the unit of the other costs")
    junction_penalty: NonNegative = Field(10.0, description="C_p2 while the junction ahead is not passed")
    lane_change_cost: NonNegative = Field(1.0, description="C_o,lc of a lane change, when it begins")
    stop_cost: NonNegative = Field(2.0, description="C_o of standing at the end of a step")
    turn_cost: NonNegative = Field(0.0, description="C_o of turning at a junction at the end of a step")
    emergency_cost: NonNegative = Field(5.0, description="C_o of a step of braking beyond comfort_decel_mps2")


class IdmConfig(_Section):
    """Planner `idm`: car following (IDM), and the gaps that it accepts at junctions and for lane changes."""

    headway_s: Headway = Field(1.5, description="time headway")
    min_gap_m: Gap = Field(2.0, description="gap at standstill")
    accel_mps2: Acceleration = Field(2.0, description="acceleration; never beyond ego_model.max_accel_mps2")
    decel_mps2: Acceleration = Field(2.0, description="comfortable deceleration")
    critical_gap_s: Delay = Field(5.0, description="time from the ego at the stop line to whoever has the right of way, from which it goes")
    cut_in_decel_mps2: Acceleration = Field(2.0, description="braking to which a lane change may bring whoever is behind, by the same car following")


class CostConfig(_Section):
    """The terms of J for planner `mcts`. One unit is one second of standing still."""

    contact: Positive = Field(60.0, description="predicted contact now; falls linearly to half of it at the horizon")
    speed_at_contact: NonNegative = Field(1.0, description="added per m/s of speed at contact")
    headway_s: Delay = Field(1.2, description="time gap below which following costs")
    headway_gap_m: Annotated[_Float, Field(ge=0, le=100)] = Field(2.0, description="gap that belongs to it at standstill")
    headway: NonNegative = Field(1.5, description="per second at no gap at all")
    claim_s: Delay = Field(1.6, description="time for which an agent's way ahead belongs to it")
    claim: NonNegative = Field(16.0, description="per second of standing in the way of an agent that will be there at once")
    acceleration: NonNegative = Field(0.02, description="per second at 1 m/s2, quadratic")
    jerk: NonNegative = Field(0.005, description="k of C_c = k j^2 per second, saturating at 10 m/s3")
    braking: NonNegative = Field(0.5, description="per second and m/s2 of braking beyond comfort_decel_mps2, quadratic")
    imposed: NonNegative = Field(2.0, description="per second and m/s2 of braking beyond 2 m/s2 that the ego forces on an agent that the search moves")
    cut_in_decel_mps2: Acceleration = Field(3.0, description="braking that a follower is trusted to do when the ego moves in front of it")
    progress: NonNegative = Field(1.0, description="per second of standing where the limit could be driven")
    tail_s: Delay = Field(8.0, description="for how long beyond the horizon a slow leader, or the end of a lane, still counts")
    blocking: NonNegative = Field(0.3, description="per second of standing inside a junction")
    astride: NonNegative = Field(4.0, description="per second of standing across two lanes: whoever follows in the one that the ego leaves takes it to be free")
    route: NonNegative = Field(2.0, description="per second on a lane that the route leaves, at full urgency")
    lane_change: NonNegative = Field(0.6, description="C_o,lc per change begun")
    red: Positive = Field(100.0, description="entering on red")
    term: TermName | None = Field(None, description="a further term of your own: a plugin, see extending.md")
    term_weight: NonNegative = Field(1.0, description="handed to it")


class FailSafeConfig(_Section):
    """The last check before a decision is executed, and what the others may do meanwhile."""

    on: Flag = Field(False, description="execute only decisions after which a safe end can be reached, whatever the others do within these bounds")
    decel_mps2: Acceleration = Field(4.5, description="others brake with at most this")
    accel_mps2: Acceleration = Field(2.6, description="others accelerate with at most this")
    over_limit: Annotated[_Float, Field(ge=1, le=10)] = Field(1.25, description="up to so many times the limit, or up to the speed that they have")
    reaction_s: Delay = Field(1.0, description="an agent in front of which the ego moves accelerates so long before it brakes")
    yield_decel_mps2: Acceleration = Field(4.5, description="and then brakes with at least this")
    horizon_s: Annotated[_Float, Field(ge=0.1, le=60)] = Field(6.0, description="how long the ego has to be safe at its stop too, from now")
    most_failures: Count = Field(10, description="so many decisions in a row may fail (raise, or be nonsense); one more ends the episode as error")


class ScenarioConfig(_Section):
    """One scenario file."""

    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=100, description="safe as a file name")
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
        section, plan = ("paper", self.paper) if self.planner.name == "paper" else ("planner", self.planner)
        states = (plan.look_ahead_steps + plan.rollout_steps) * plan.step_s / self.prediction.step_s
        if states > MOST_STATES:
            raise ValueError(
                f"prediction.step_s: with {section}.look_ahead_steps, {section}.rollout_steps and {section}.step_s a forecast of {states:.0f} states; "
                f"allowed are {MOST_STATES}"
            )
        return self

    @property
    def reproducible(self) -> bool:
        """Whether no clock has a say in decisions."""
        return self.planner.time_budget_ms is None and not self.planner.enforce_deadline


def load(path: Path, overrides: tuple[str, ...] = (), *, changes: Mapping[str, Any] | None = None, allow_plugins: bool = False) -> ScenarioConfig:
    """Read a scenario file; `overrides` are `a.b=c` assignments, `changes` are values by key. Files that it names are made absolute. Raises ConfigError, also
    where the file names code of the user's own (module:name) and that is not allowed."""
    return build(_read(path, ()), str(path), overrides, changes=changes, allow_plugins=allow_plugins)


def build(
    data: dict[str, Any], origin: str, overrides: tuple[str, ...] = (), *, changes: Mapping[str, Any] | None = None, allow_plugins: bool = False
) -> ScenarioConfig:
    """Check a scenario given as a mapping, as `load` does a file; `origin` stands in error messages. Raises ConfigError."""
    for override in overrides:
        _assign(data, *_assignment(override), f"--set {override}")
    for key, value in (changes or {}).items():
        _assign(data, key, value, f"{origin}: {key}")
    try:
        scenario = ScenarioConfig.model_validate(data)
    except ValidationError as error:
        raise refused(error, ScenarioConfig, origin) from None
    for key, name in plugin_names(scenario):
        require_permission(f"{origin}: {key}", name, allow_plugins)
    return scenario


def parsed(path: Path) -> Any:
    """What a file in YAML says. Raises ConfigError."""
    try:
        return yaml_file.read(path)
    except YamlError as error:
        raise ConfigError(f"{path}: not valid YAML: {error}") from None
    except OSError as error:
        raise ConfigError(f"{path}: {unreadable(error)}") from None


def unreadable(error: OSError) -> str:
    """Why a file cannot be read, in a few words."""
    words = error.strerror or str(error)
    return words if words.startswith(("no such", "cannot")) else f"cannot be read: {words}"


def name_from(path: Path) -> str:
    """What a scenario is called that has nothing but a file: safe as a file name."""
    stem = re.sub(r"[^A-Za-z0-9_-]", "_", path.stem)[:100]
    return stem if stem[:1].isalnum() else f"net{stem}"[:100]


def whole(key: str, value: object, least: int) -> int:
    """An argument of a program that has to be a whole number from `least` on. Raises ConfigError."""
    number = None if isinstance(value, bool) or not isinstance(value, SupportsIndex) else index(value)
    if number is None or number < least:
        raise ConfigError(f"{key}: a whole number from {least} on, got {value!r}")
    return number


def positive(key: str, value: object) -> float:
    """A number above 0, as a program hands it over. Raises ConfigError."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < math.inf:
        raise ConfigError(f"{key}: a number greater than 0, got {value!r:.60}")
    return float(value)


def require_scenario(function: str, config: object) -> None:
    """Raise ConfigError where an argument is no scenario but, for example, its name."""
    if not isinstance(config, ScenarioConfig):
        raise ConfigError(f"{function}: config: a scenario, as load_scenario returns it, got {config!r:.60}")


def is_oracle(prediction: str | None) -> bool:
    """Whether a forecast, as results name it, knows what no sensor sees."""
    return prediction is not None and (prediction in ORACLES or prediction.endswith(ORACLE_MARK))


def plugin_names(scenario: ScenarioConfig) -> Iterator[tuple[str, str]]:
    """Key and name of every plugin that a scenario names."""
    if scenario.planner.name not in PLANNERS:
        yield "planner.name", scenario.planner.name
    if scenario.prediction.name not in PREDICTORS:
        yield "prediction.name", scenario.prediction.name
    if scenario.cost.term is not None:
        yield "cost.term", scenario.cost.term


def require_permission(key: str, name: str, allow_plugins: bool) -> None:
    """Raise ConfigError where a name is code and code is not allowed: a file from somebody else must not run any. What is installed was let in."""
    if ":" in name and not allow_plugins:
        raise ConfigError(f"{key}: {name}: code that a scenario names runs only with --allow-plugins")


def digest(config: BaseModel, sections: Iterable[str] | None = None) -> str:
    """SHA-256 of the resolved configuration, or of some sections of it, file names without their folders."""
    data = config.model_dump(mode="json", include=None if sections is None else set(sections))
    sumo = data.get("sumo", {})
    for key in ("sumocfg", "net"):
        sumo[key] = Path(sumo[key]).name if sumo.get(key) else None
    for key in ("routes", "additional"):
        sumo[key] = [Path(p).name for p in sumo.get(key, [])]
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def json_schema() -> dict[str, Any]:
    """The JSON schema of a scenario file."""
    schema = ScenarioConfig.model_json_schema()
    schema["properties"]["base"] = {"type": "string", "description": "another scenario file, relative to this one, over which this one is laid"}
    return schema


def _read(path: Path, seen: tuple[Path, ...]) -> dict[str, Any]:
    """The mapping in a file, laid over the one that its `base` names; relative file names belong to the file that states them."""
    if _is_xml(path):
        raise ConfigError(f"{path}: a file of SUMO's; give the .sumocfg that names it, or a scenario file with it under `sumo` (docs/scenario-file.md)")
    data = parsed(path)
    if not isinstance(data, dict):
        raise ConfigError(f"{path}: a scenario is a mapping of keys, see `sumo-mcts schema`")
    _absolute_paths(data.get("sumo"), path.parent)
    if "base" not in data:
        return data
    base = data.pop("base")
    base_path = _base(base, path)
    if base_path in seen or len(seen) == MOST_BASES:
        raise ConfigError(f"{path}: base: {base} leads back to itself" if base_path in seen else f"{path}: base: more than {MOST_BASES} files")
    return _overlay(_read(base_path, (*seen, files.absolute(path))), data)


def _is_xml(path: Path) -> bool:
    """Whether a file is XML, packed or not, or is called so."""
    try:
        return bool(files.xml_root(path))
    except (OSError, ValueError):
        return path.suffix == ".xml"


def _base(base: object, path: Path) -> Path:
    """The file that `base` in a file means: one beside it, or a built-in scenario of this name. Raises ConfigError."""
    if not isinstance(base, str) or not base:
        raise ConfigError(f"{path}: base: has to be a scenario file, or the name of a built-in one, got {shown(base)}")
    beside = path.parent / base
    builtin = files.builtin_scenario(base) if files.problem(beside) else None
    if builtin is None and files.problem(beside):
        raise ConfigError(f"{path}: base: {base}: {files.problem(beside)}")
    return files.absolute(builtin or beside)


def _absolute_paths(sumo: object, folder: Path) -> None:
    if not isinstance(sumo, dict):
        return
    for key in ("sumocfg", "net"):
        if isinstance(sumo.get(key), str):
            sumo[key] = str(files.absolute(folder / sumo[key]))
    for key in ("routes", "additional"):
        if isinstance(sumo.get(key), list):
            sumo[key] = [str(files.absolute(folder / p)) if isinstance(p, str) else p for p in sumo[key]]


def _overlay(under: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """Mappings are merged key by key; lists of mappings with an `id` entry by that id; anything else is replaced."""
    result = dict(under)
    for key, value in over.items():
        below = under.get(key)
        if isinstance(below, dict) and isinstance(value, dict):
            result[key] = _overlay(below, value)
        elif _has_ids(below) and _has_ids(value):
            merged = {item["id"]: item for item in below}  # type: ignore[union-attr]  # _has_ids says it is a list
            for item in value:
                merged[item["id"]] = _overlay(merged.get(item["id"], {}), item)
            result[key] = list(merged.values())
        else:
            result[key] = value
    return result


def _has_ids(value: object) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(item, dict) and isinstance(item.get("id"), str) for item in value)


def _assignment(override: str) -> tuple[str, Any]:
    """Key and value of `a.b=c`. Raises ConfigError."""
    key, sep, text = override.partition("=")
    if not sep or not key:
        raise ConfigError(f"--set {override}: write it as key.subkey=value")
    try:
        return key, yaml_file.parsed(text)
    except YamlError as error:
        raise ConfigError(f"--set {override}: the value is not valid YAML: {error}") from None


def _assign(data: dict[str, Any], key: str, value: Any, where: str) -> None:
    """Set a key `a.b` of a mapping. Raises ConfigError, with `where` in front."""
    *parents, last = key.split(".")
    if len(parents) >= yaml_file.MOST_DEPTH:
        raise ConfigError(f"{where}: a key of more than {yaml_file.MOST_DEPTH} parts")
    for parent in parents:
        data = data.setdefault(parent, {})
        if not isinstance(data, dict):
            raise ConfigError(f"{where}: {parent} has no keys below it")
    data[last] = value


# What is allowed, by the type of pydantic's error and with its parameters; every type whose name begins so.
_ALLOWED = {
    "model": "a mapping of keys", "dict": "a mapping of keys", "tuple": "a list", "list": "a list", "string_type": "a text", "int": "a whole number",
    "float": "a number", "finite": "a finite number", "bool": "true or false", "literal": "{expected}", "string_pattern": "a text like {pattern}",
    "string_too_short": "a text of at least {min_length} characters", "string_too_long": "a text of at most {max_length} characters",
    "string_unicode": "a text in Unicode",
    "greater_than_equal": "at least {ge}", "greater_than": "greater than {gt}", "less_than_equal": "at most {le}", "less_than": "less than {lt}",
}  # fmt: skip


def refused(error: ValidationError, model: type[BaseModel], origin: str) -> ConfigError:
    """What is wrong with the input for a model, as an error that tells the first thing and knows all."""
    lines = [f"{origin}: {line}" for line in problems(error, model)]
    return ConfigError(lines[0] + (f" (and {len(lines) - 1} more)" if len(lines) > 1 else ""), lines)


def problems(error: ValidationError, model: type[BaseModel]) -> list[str]:
    """A line for each thing that is wrong: key, what is allowed, what was given."""
    found = error.errors()
    around = {each["loc"][:k] for each in found for k in range(len(each["loc"]))}
    # what is too short because its entries are wrong is not told as well
    return [_problem(each, model) for each in found if each["type"] != "too_short" or each["loc"] not in around]


def _problem(found: Any, model: type[BaseModel]) -> str:
    key = ".".join(str(part) for part in found["loc"] if part != "[key]") or "scenario"
    given = "" if found["type"] in ("missing", "extra_forbidden") or isinstance(found["input"], dict | BaseModel) else f", got {shown(found['input'])}"
    return f"{key}: {_in_words(found, model)}{given}"


def _in_words(problem: Any, model: type[BaseModel]) -> str:
    """What one of pydantic's errors says."""
    kind, parameters = problem["type"], {key: int(x) if isinstance(x, float) and x.is_integer() else x for key, x in problem.get("ctx", {}).items()}
    match kind:
        case "extra_forbidden":
            return "unknown key" + _allowed_beside(problem["loc"], model)
        case "missing":
            return "has to be given"
        case "too_short":
            return f"has to have at least {parameters['min_length']} entr{'y' if parameters['min_length'] == 1 else 'ies'}"
        case "too_long":
            return f"has to have at most {parameters['max_length']} entries"
        case "value_error":
            return str(parameters["error"])
    allowed = next((words for begin, words in _ALLOWED.items() if kind.startswith(begin)), None)
    return problem["msg"] if allowed is None else f"has to be {allowed.format_map(parameters)}"


def _allowed_beside(location: tuple[int | str, ...], model: Any) -> str:
    """The keys allowed where an unknown one stood."""
    for part in location[:-1]:
        if isinstance(part, int):
            continue
        field = model.model_fields.get(part)
        kinds = () if field is None else (field.annotation, *getattr(field.annotation, "__args__", ()))
        plain = [getattr(kind, "__origin__", kind) for kind in kinds]  # Annotated[A, ...] is an A
        inner = [kind for kind in plain if isinstance(kind, type) and issubclass(kind, BaseModel)]
        if not inner:
            return ""
        model = inner[0]
    return "; allowed: " + ", ".join(field.alias or name for name, field in model.model_fields.items())
