"""The shared vocabulary: plain tuples of arrays, no behaviour.

In order: the inputs of a cycle (Scene), forecasts, decisions, the memory of a driver, the inputs of
the referee (Frame). The network is in road.py.

SI units; angles in radians, counter-clockwise from east; left is left, also where traffic drives on
the left. Every index array uses -1 for "none". A lane position ``s`` is SUMO's: metres from the
start of the lane in units of its SUMO length, which may differ from the length of its shape. A pose
has four columns (numerics/geometry.py: X .. SIN): x and y of the centre of a box, m, cosine and
sine of its heading. Traces store these fields under their names.
"""

from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Ints, Words
from sumo_mcts.road import RoadChanges

STANDING = 0.1  # m/s: slower counts as standing
SETS_OFF = 3.0  # m from the place of a stand within which it is remembered
REFEREE_RANGE = 100.0  # m about the ego within which the referee sees agents


# --- what a cycle knows ---

# What a signal shows to a link (Signals.state). AFTER_STOP: red that a vehicle may pass that has
# stood before it and lets all others pass, as for turning right on red.
GREEN, YELLOW, RED, AFTER_STOP = range(4)


class Signals(NamedTuple):
    """What each signalled link shows, now and at its coming switches.

    Q signals; K phases, the present one first.
    """

    offset: Ints  # [Q+1] links of signal q: offset[q]:offset[q+1]
    state: Ints  # [links, K] GREEN .. AFTER_STOP during phase k
    until: Floats  # [Q, K] seconds from now at which phase k of signal q ends; inf where unknown


class Agents(NamedTuple):
    """The vehicles and persons in sensor range but the ego. N agents, sorted by id."""

    ids: tuple[str, ...]  # [N]
    x: Floats  # [N] centre of the box, m
    y: Floats  # [N] m
    heading: Floats  # [N] rad
    v: Floats  # [N] m/s
    a: Floats  # [N] m/s2
    # [N] m/s2, its acceleration smoothed over about half a second, as far as it was seen, and since
    # it last changed abruptly
    trend: Floats
    length: Floats  # [N] m
    width: Floats  # [N] m
    lane: Ints  # [N] lane of the front; -1 for persons and for vehicles off the road
    s: Floats  # [N] lane position of the front, m
    d: Floats  # [N] offset from the lane's centre line, m, left positive
    blinker: Ints  # [N] -1 right, 0 none, 1 left
    # [N] for how long it has stood, s, as far as it was seen, and 2 s longer where it already stood
    # when it was first seen; 0: it moves; below 0: it has set off from where it came to a stand so
    # long ago, and has come less than SETS_OFF m since
    standing_s: Floats
    person: Bools  # [N] on foot
    # [N] index into VEHICLE_CLASSES, or IGNORING: a car, a lorry, a tram or a bicycle looks like
    # one
    vclass: Ints


class Stop(NamedTuple):
    """The next place where a vehicle has to stand, or a waypoint, which it passes slowly."""

    lane: int = -1  # -1: there is none
    begin: float = 0.0  # lane position from which on a stand counts, m
    place: float = 0.0  # where the front is to stand, m; the end of a waypoint
    speed: float = 0.0  # m/s at most on a waypoint; 0: it has to stand
    after: int = 0  # edges of the route after its own
    waits: bool = False  # at the end of a waypoint the ego has to stand until a time to come

    @property
    def ends(self) -> bool:
        """Whether the ego has to stand there."""
        return self.speed <= 0.0 or self.waits


NO_STOP = Stop()


class Sideways(NamedTuple):
    """How a vehicle may move within its lane; as it is where SUMO does not divide lanes (option
    lateral-resolution)."""

    speed: float = 0.0  # m/s to the side at most; 0: lanes are not divided
    gap: float = 0.0  # m that it keeps to others beside it
    wish: float = 0.0  # where it likes to drive, m off the middle of its lane, left positive


class EgoState(NamedTuple):
    """The ego vehicle, from its own sensors and documents."""

    id: str
    x: float  # centre of the box, m
    y: float  # m
    heading: float  # rad
    v: float  # m/s
    a: float  # m/s2
    lane: int  # of the front, -1 none
    s: float  # lane position of the front, m
    d: float  # offset from the lane's centre line, m, left positive
    length: float  # m
    width: float  # m
    max_accel: float  # m/s2, of its vehicle type
    comfort_decel: float  # m/s2, positive
    emergency_decel: float  # m/s2, positive
    max_speed: float  # m/s
    speed_factor: float  # its share of a speed limit
    vclass: int  # index into VEHICLE_CLASSES, or IGNORING
    route: tuple[int, ...]  # edges, from the present one to the goal
    changing: float  # lane change under way: progress 0..1, 0 = none
    # lane that it moves to, -1 none; the same as `lane` in the second half of the change
    change_to: int
    change_from: int  # lane that it leaves, -1 none
    asks: int = 0  # the side on which it asks for room now: 1 left, -1 right, 0 neither
    can_ask: bool = True  # SUMO's model of its lane changes knows such a wish
    reroutes: int = 0  # how often it has left its route so far, since its lane did not lead on
    # what it did just now about a lane that does not lead on along its route, in words; "": nothing
    detour: str = ""
    stop: Stop = NO_STOP  # the next one that it has to serve
    held: bool = False  # SUMO has it stand at that stop
    sideways: Sideways = Sideways()
    standing_s: float = 0.0  # as Agents.standing_s


class Scene(NamedTuple):
    """What is known at the start of one cycle."""

    time: float  # simulation time, s
    step: float  # simulation step, s
    ego: EgoState
    agents: Agents
    signals: Signals
    changes: RoadChanges = RoadChanges()  # of the map, as far as the ego has come near them


# --- forecasts ---

# What an agent is taken to do (Intent.does).
USUAL = 0  # what is likeliest
TURNS = 1  # takes the lanes Intent.way
FORCES = 2  # does not let the ego pass
BRAKES = 3  # hard, to a stand
STARTS = 4  # though it has stood for a while


class Intent(NamedTuple):
    """What one agent is taken to do, where it is not what is likeliest (see
    prediction/alternatives.py)."""

    agent: int  # index, -1 none
    does: int  # USUAL .. STARTS
    way: tuple[int, ...] = ()  # lanes, the present one first; empty unless it TURNS


class Forecast(NamedTuple):
    """The forward-predicted copy of the traffic.

    H hypotheses, T times, N agents (order of Scene.agents). Time 0 is now.
    """

    dt: float  # s between times
    weight: Floats  # [H] sums to 1
    pose: Floats  # [H, T, N, 4] poses of the box
    v: Floats  # [H, T, N] m/s
    lane: Ints  # [H, T, N] lane of the front, -1 off the road
    s: Floats  # [H, T, N] lane position of the front, m
    valid: Bools  # [H, T, N] False: not there (left the map)
    half_length: Floats  # [N] m
    half_width: Floats  # [N] m
    reacts: Bools  # [N] brakes for an ego in front of it: contact from behind is imposed braking
    # [H, N] has to let the ego pass where their paths meet, and can do so comfortably
    yields: Bools
    # [H] what each hypothesis is about; empty: every agent does what is likeliest
    intents: tuple[Intent, ...] = ()


class Scripted(NamedTuple):
    """The coming states of an agent, from its script, its plan or a copy of the simulation.

    K times, those of the forecast.
    """

    pose: Floats  # [K, 4] poses of the box
    v: Floats  # [K] m/s
    lane: Ints  # [K] lane of the front, -1 off the road
    s: Floats  # [K] lane position of the front, m
    valid: Bools  # [K] False: not there


class ToldPlans(NamedTuple):
    """What connected egos told one of them in one cycle.

    K agents with T coming states.
    """

    agent: Ints = np.zeros(0, np.int32)  # [K] index
    pose: Floats = np.zeros((0, 0, 4))  # [K, T, 4] poses, at the times asked for
    v: Floats = np.zeros((0, 0))  # [K, T] m/s
    lane: Ints = np.zeros((0, 0), np.int32)  # [K, T]
    s: Floats = np.zeros((0, 0))  # [K, T] m
    valid: Bools = np.zeros((0, 0), np.bool_)  # [K, T] False: beyond the end of the plan


class Answers(NamedTuple):
    """The answers of oracles in one cycle; empty unless a scenario names an oracle. And what
    connected egos told.

    N agents of the scene; K agents with T coming states.
    """

    # [N] the lanes that each agent is really going to take; empty: not asked
    ways: tuple[Ints, ...] = ()
    agent: Ints = np.zeros(0, np.int32)  # [K] index
    # [K] it holds a script; False: the states are from a copy of the simulation
    scripted: Bools = np.zeros(0, np.bool_)
    pose: Floats = np.zeros((0, 0, 4))  # [K, T, 4] poses, at the times asked for
    v: Floats = np.zeros((0, 0))  # [K, T] m/s
    lane: Ints = np.zeros((0, 0), np.int32)  # [K, T]
    s: Floats = np.zeros((0, 0))  # [K, T] m
    valid: Bools = np.zeros((0, 0), np.bool_)  # [K, T]
    told: ToldPlans = ToldPlans()


# --- decisions ---

# Terms of the cost, in the order of RootChild.terms.
SAFETY, COMFORT, PASSABILITY, OTHER, LOSS = range(5)
TERMS = ("safety", "comfort", "passability", "other", "loss")


class Plan(NamedTuple):
    """What the planner expects the ego to do. M steps of the simulation."""

    time: Floats  # [M] s from now
    v: Floats  # [M] m/s, the speed commanded for the step that ends then
    lane: Ints  # [M] lane of the front then
    s: Floats  # [M] lane position of the front, m
    pose: Floats  # [M, 4] poses of the box


class Follow(NamedTuple):
    """Drive this profile; one speed a simulation step."""

    speeds: Floats  # [M] m/s
    lane_change: int  # -1 right, 0 none, 1 left, at once
    asks: int = 0  # side on which others are asked for room: -1 right, 0 none, 1 left
    skips_stop: bool = False  # the next stop cannot be served any more and is given up
    shift: float = 0.0  # m to the left that it moves within its lane, as SUMO's drivers do


class Release(NamedTuple):
    """Let SUMO drive."""


class RootChild(NamedTuple):
    """One action at the root after the search."""

    accel: float  # m/s2 asked for
    lane_change: int  # -1 right, 0 none, 1 left
    visits: int
    mean: float  # mean total cost J
    # lowest total cost seen, or the risk where several hypotheses are weighed; inf: every
    # continuation is lost
    best: float
    # [5] of the best in the likeliest hypothesis: safety, comfort, passability, other, loss
    terms: Floats
    poses: Floats  # [M, 4] poses, of its best continuation
    # [H, 5] terms of the best in each hypothesis that was searched; empty: there is one
    hypotheses: Floats = np.zeros((0, 5))


class Decision(NamedTuple):
    """The planner's decision and its reason."""

    command: Follow | Release
    plan: Plan | None
    children: tuple[RootChild, ...]
    chosen: int  # index into children, -1: none
    reason: str  # "search", "brake" (nothing is free), "release", ...
    iterations: int  # passes of the search
    known: int  # passes that ended in a known terminal node


# --- what a driver carries from one decision to the next ---


class Manoeuvre(NamedTuple):
    """What the ego does from some time on, step by step, until it stands or is at its goal."""

    time: float  # simulation time, s
    plan: Plan
    verified: bool


class PlannerMemory(NamedTuple):
    """What a planner carries from one decision to the next."""

    numbers: Floats = np.zeros(0)  # their meaning is the planner's own affair
    # the state of its random generator; empty: it draws nothing
    generator: Words = np.zeros(0, np.uint64)
    waited_s: float = 0.0  # s for which it has waited for a gap


class Memory(NamedTuple):
    """What a driver carries from one decision to the next, beside that decision."""

    # the route as it was laid out, from where the ego was then; empty: not yet
    edges: tuple[int, ...] = ()
    stood: tuple[int, ...] = ()  # nodes of the route at whose stop sign the ego has stood,
    stood_since: tuple[float, ...] = ()  # and since when, simulation time, s
    stop: Stop = NO_STOP  # the one that the route was laid out for
    failures: int = 0  # of the planner, in a row
    ready: Manoeuvre | None = None  # the fail-safe's, verified last
    planner: PlannerMemory = PlannerMemory()
    # agents that stand, and when they were last seen to have a reason for it, simulation time, s
    held_up: tuple[str, ...] = ()
    held_up_at: tuple[float, ...] = ()


# --- what the referee sees ---


class Frame(NamedTuple):
    """What SUMO reports of one ego after one simulation step.

    For the referee alone: it may hold what no sensor sees. N agents.
    """

    time: float  # simulation time, s
    ego: EgoState  # the last known one where the ego is gone
    present: bool  # False: SUMO no longer has the ego
    agents: Agents  # all within REFEREE_RANGE of the ego
    signals: Signals  # K = 1
    green: Bools  # [links] whether each is lit and green; empty: not asked (asked where it stands)
    leader: tuple[str, ...]  # [N] SUMO's leader of each agent that brakes; "" none, or not asked
    # [N] true next lanes of each agent, the present one first; empty where not asked
    paths: tuple[Ints, ...]
    collisions: tuple[str, ...]  # those that SUMO reports in collision with the ego in this step
    collision_type: str  # "", "collision" (lengthwise), "side" (lane change), "junction", ...
    teleported: bool  # SUMO began to move the ego elsewhere in this step
    arrived: bool  # SUMO took the ego out at the end of its route
    # of SUMO's surrogate safety device for the ego at this moment; nan undefined
    ttc: float  # s, time to collision
    pet: float  # s, post-encroachment time
    drac: float  # m/s2, deceleration to avoid a collision
    changes: RoadChanges = RoadChanges()  # of the map, the ego's lane as it is in this step
