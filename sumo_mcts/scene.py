"""The language between the rooms: plain tuples of arrays, no behaviour.

SI units; angles in radians, counter-clockwise from east; left is left, also where people drive on
the left. Every index array uses -1 for "none". A lane position ``s`` is SUMO's: metres from the
start of the lane in units of its SUMO length, which may differ from the length of its shape.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Bools = NDArray[np.bool_]
Words = NDArray[np.uint64]

# How a connection is entered (RoadMap.rule), in the order of growing duty.
PRIORITY, YIELD, ZIPPER, STOP, ALLWAY = range(5)

# Where a connection leads (RoadMap.direction).
STRAIGHT, LEFT, RIGHT, TURN = range(4)

# What a signal shows to a link (Signals.state).
GREEN, YELLOW, RED = range(3)

# What an agent is taken to do (Intent.does).
USUAL, TURNS, FORCES, BRAKES, STARTS = range(5)


class RoadMap(NamedTuple):
    """One network, lane by lane.

    L lanes (internal ones too), P shape points, S successor entries, C conflict entries.
    """

    lane_ids: tuple[str, ...]
    edge_ids: tuple[str, ...]
    junction_ids: tuple[str, ...]
    signal_ids: tuple[str, ...]
    lefthand: bool  # people drive on the left: SUMO then counts lanes from the left
    edge: Ints  # [L] index into edge_ids
    index: Ints  # type: ignore[assignment]  # [L] position within the edge from the right, 0 = rightmost (tuple.index is not missed)
    internal: Bools  # [L] inside a junction
    length: Floats  # [L] SUMO's lane length, m
    scale: Floats  # [L] m of the shape for each metre of the lane
    width: Floats  # [L] m
    speed: Floats  # [L] limit, m/s
    classes: NDArray[np.uint64]  # [L] bit i set: vehicle class i (VEHICLE_CLASSES) may drive here
    left: Ints  # [L] neighbour on the same edge
    right: Ints  # [L]
    point_offset: Ints  # [L+1] lane i owns points point_offset[i]:point_offset[i+1]
    points: Floats  # [P, 2] m
    point_s: Floats  # [P] arc length along the shape, m
    successor_offset: Ints  # [L+1]
    successor: Ints  # [S] the lane driven next (internal where the connection has one)
    exit: Ints  # [L] internal lanes: the ordinary lane that they end in; others: themselves
    # [L] internal lanes: STRAIGHT, LEFT, RIGHT or TURN of their connection; others: STRAIGHT
    direction: Ints
    junction: Ints  # [L] internal lanes: index into junction_ids
    # [L] the knot (junctions with nothing but short lanes between them) that the lane lies in
    knot: Ints
    begins: Ints  # [L] the knot where it begins
    ends: Ints  # [L] the knot where it ends
    rule: Ints  # [L] internal lanes that start a connection: how it is entered; others: PRIORITY
    signal: Ints  # [L] internal lanes that start a connection: index into signal_ids
    link: Ints  # [L] ... and the link's index in that signal's state
    conflict_offset: Ints  # [L+1]
    conflict_lane: Ints  # [C] the other lane
    conflict_begin: Floats  # [C] the shared stretch, in positions of this lane, m
    conflict_end: Floats  # [C]
    conflict_other_begin: Floats  # [C] the same stretch in positions of the other lane
    conflict_other_end: Floats  # [C]
    conflict_merge: Bools  # [C] both lanes lead into the same lane
    conflict_yields: Bools  # [C] traffic on this lane must let the other pass


class Signals(NamedTuple):
    """What each signalled link shows, now and at its coming switches.

    Q signals; K coming phases are broadcast.
    """

    offset: Ints  # [Q+1] links of signal q: offset[q]:offset[q+1]
    state: Ints  # [links, K] GREEN, YELLOW or RED during phase k
    until: Floats  # [Q, K] seconds from now at which phase k of signal q ends; inf where unknown


class Agents(NamedTuple):
    """Everybody in sensor range but the ego. N agents, sorted by id."""

    ids: tuple[str, ...]
    x: Floats  # [N] centre of the box, m
    y: Floats  # [N]
    heading: Floats  # [N]
    v: Floats  # [N] m/s
    a: Floats  # [N] m/s2
    # [N] its acceleration smoothed over about half a second, as far as it was seen, and since it
    # last changed abruptly, m/s2
    trend: Floats
    length: Floats  # [N] m
    width: Floats  # [N] m
    lane: Ints  # [N] lane of the front; -1 for pedestrians and whoever is off the road
    s: Floats  # [N] lane position of the front, m
    d: Floats  # [N] offset from the lane's centre line, m, left positive
    blinker: Ints  # [N] -1 right, 0 none, +1 left
    standing_s: Floats  # [N] for how long it has stood, as far as it was seen
    person: Bools  # [N]
    # [N] index into VEHICLE_CLASSES, or IGNORING: a car, a lorry, a tram or a bicycle looks like
    # one
    vclass: Ints


class EgoState(NamedTuple):
    """The ego vehicle as its own sensors and its owner know it."""

    id: str
    x: float  # centre, m
    y: float
    heading: float
    v: float
    a: float
    lane: int
    s: float
    d: float  # m, left positive
    length: float
    width: float
    max_accel: float  # m/s2, of its vehicle type
    comfort_decel: float  # m/s2, positive
    emergency_decel: float  # m/s2, positive
    max_speed: float
    speed_factor: float
    vclass: int  # index into VEHICLE_CLASSES
    route: tuple[int, ...]  # edges, from the present one to the goal
    changing: float  # lane change under way: progress 0..1, 0 = none
    change_to: int  # lane that it moves to; the same as `lane` in the second half of the change
    change_from: int  # lane that it leaves


class Scene(NamedTuple):
    """What is known at the start of one cycle."""

    time: float  # simulation time, s
    step: float  # simulation step, s
    ego: EgoState
    agents: Agents
    signals: Signals


class Intent(NamedTuple):
    """What one agent is taken to do, where it is not what is likeliest (see
    model/intentions.py)."""

    agent: int
    # TURNS: takes `way`; FORCES: does not let the ego pass; BRAKES: hard, to a stand; STARTS:
    # though it has stood for a while
    does: int
    way: tuple[int, ...] = ()  # lanes, the present one first


class Forecast(NamedTuple):
    """The forward-predicted copy of the traffic.

    H hypotheses, T times, N agents (order of Scene.agents). Time 0 is now.
    """

    dt: float  # s between times
    weight: Floats  # [H] sums to 1
    pose: Floats  # [H, T, N, 4] centre x, y, cos and sin of the heading
    v: Floats  # [H, T, N]
    lane: Ints  # [H, T, N] lane of the front
    s: Floats  # [H, T, N]
    valid: Bools  # [H, T, N] False: not there (left the map)
    half_length: Floats  # [N]
    half_width: Floats  # [N]
    reacts: Bools  # [N] brakes for an ego in front of it: contact from behind is imposed braking
    yields: (
        Bools  # [H, N] has to let the ego pass where their paths meet, and can do so comfortably
    )
    intents: tuple[
        Intent, ...
    ] = ()  # [H] what each hypothesis is about; empty: everybody does what is likeliest


class Plan(NamedTuple):
    """What the planner expects the ego to do. M steps of the simulation."""

    time: Floats  # [M] s from now
    v: Floats  # [M] speed commanded for the step that ends then
    lane: Ints  # [M] lane of the front then
    s: Floats  # [M]
    pose: Floats  # [M, 4] centre x, y, cos, sin


class Follow(NamedTuple):
    """Drive this profile; one speed a simulation step."""

    speeds: Floats  # [M] m/s
    lane_change: int  # -1 right, 0 none, +1 left, at once


class Release(NamedTuple):
    """Let SUMO drive."""


class RootChild(NamedTuple):
    """One action at the root after the search."""

    accel: float  # m/s2 asked for
    lane_change: int
    visits: int
    mean: float  # mean total cost J
    # lowest total cost seen, or the risk where several hypotheses are weighed; inf: every
    # continuation is lost
    best: float
    # [5] of the best in the likeliest hypothesis: safety, comfort, passability, other, loss
    terms: Floats
    poses: Floats  # [M, 4] of its best continuation
    hypotheses: Floats = np.zeros(
        (0, 5)
    )  # [H, 5] terms of the best in each hypothesis that was searched; empty: there is one


class Decision(NamedTuple):
    """What the planner wants, and why."""

    command: Follow | Release
    plan: Plan | None
    children: tuple[RootChild, ...]
    chosen: int  # index into children, -1: none
    reason: str  # "search", "brake" (nothing is free), "release", ...
    iterations: int
    known: int  # passes that ended in a known terminal node


class Manoeuvre(NamedTuple):
    """What the ego does from some time on, step by step, until it stands or is at its goal."""

    time: float  # simulation time, s
    plan: Plan
    verified: bool


class PlannerMemory(NamedTuple):
    """What a planner carries from one decision to the next."""

    numbers: Floats = np.zeros(0)  # their meaning is the planner's own affair
    generator: Words = np.zeros(
        0, np.uint64
    )  # the state of its random generator; empty: it draws nothing


class Memory(NamedTuple):
    """What a driver carries from one decision to the next, beside that decision."""

    edges: tuple[
        int, ...
    ] = ()  # the route as it was laid out, from where the ego was then; empty: not yet
    stood: tuple[int, ...] = ()  # nodes of the route at whose stop sign the ego has stood ...
    stood_since: tuple[float, ...] = ()  # ... and when, s
    failures: int = 0  # of the planner, in a row
    ready: Manoeuvre | None = None  # the fail-safe's, verified last
    planner: PlannerMemory = PlannerMemory()


class Answers(NamedTuple):
    """What oracles told in one cycle: nothing, unless a scenario asks for one.

    K agents whose coming T states were told.
    """

    ways: tuple[
        Ints, ...
    ] = ()  # [N] the lanes that each agent is really going to take; empty: it was not asked
    agent: Ints = np.zeros(0, np.int32)  # [K] index
    scripted: Bools = np.zeros(
        0, np.bool_
    )  # [K] holds a script; else from a copy of the simulation
    pose: Floats = np.zeros((0, 0, 4))  # [K, T, 4] at the times that were asked for
    v: Floats = np.zeros((0, 0))  # [K, T]
    lane: Ints = np.zeros((0, 0), np.int32)  # [K, T]
    s: Floats = np.zeros((0, 0))  # [K, T]
    valid: Bools = np.zeros((0, 0), np.bool_)  # [K, T]


SAFETY, COMFORT, PASSABILITY, OTHER, LOSS = range(5)
TERMS = ("safety", "comfort", "passability", "other", "loss")
VEHICLE_CLASSES = (
    "passenger", "private", "emergency", "authority", "army", "vip", "hov", "taxi", "bus", "coach",
    "delivery", "truck", "trailer",
    "motorcycle", "moped", "bicycle", "evehicle", "pedestrian", "tram", "rail_urban", "rail",
    "rail_electric", "rail_fast", "ship",
    "custom1", "custom2", "subway", "cable_car", "container", "aircraft", "wheelchair", "scooter",
    "drone",
)  # fmt: skip
IGNORING = -1  # the class of vehicles that may drive anywhere


class Frame(NamedTuple):
    """What SUMO reports of one ego after one simulation step.

    For the referee alone: it may hold what no sensor sees.
    """

    time: float  # s
    ego: EgoState  # the last known one where the ego is gone
    present: bool  # False: SUMO no longer has the ego
    agents: Agents  # everybody within REFEREE_RANGE
    signals: Signals  # K = 1
    leader: tuple[
        str, ...
        # [N] the vehicle that SUMO names as each agent's leader; "" none or not asked (asked of
        # those
        # that brake)
    ]
    paths: tuple[
        Ints, ...
    ]  # [N] true next lanes of each agent, the present one first; empty where not asked
    collisions: tuple[str, ...]  # whom SUMO reports in collision with the ego in this step
    collision_type: str  # "", "collision" (lengthwise), "side" (lane change), "junction", ...
    teleported: bool
    arrived: bool  # SUMO took the ego out at the end of its route
    ttc: float  # s, smallest of SUMO's surrogate safety device for the ego; nan undefined
    pet: float  # s
    drac: float  # m/s2


REFEREE_RANGE = 100.0  # m
STANDING = 0.1  # m/s: slower counts as standing


class Scripted(NamedTuple):
    """The coming states of an agent, known from its script or from a copy of the simulation, at the
    forecast's times. K times."""

    pose: Floats  # [K, 4]
    v: Floats  # [K]
    lane: Ints  # [K]
    s: Floats  # [K]
    valid: Bools  # [K]


Indices = NDArray[np.int64]
