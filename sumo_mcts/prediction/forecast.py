"""How the others will move: the forward-predicted copy of the traffic.

Every agent is led along its most likely lanes (paths.py). `constant_velocity` keeps its speed.
`idm` drives there as SUMO's drivers do (behaviour.py). `routes` does so along the lanes that the
agents really take. `script` reads scripted states, `clone` those of a copy of the simulation.
No lane change is predicted that has not begun, except by these two, and that who overtakes on a
lane of the oncoming goes back.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Ints
from sumo_mcts.prediction.at_red import ways_at, with_waiting
from sumo_mcts.prediction.behaviour import drive
from sumo_mcts.prediction.course import Course, course_of
from sumo_mcts.prediction.drivers import NO_DRIVERS, Drivers, TrafficParams
from sumo_mcts.prediction.on_foot import Ways
from sumo_mcts.prediction.overtaking import Return, going_back
from sumo_mcts.prediction.paths import NO_PATHS, Paths, changing, likely_paths
from sumo_mcts.prediction.poses import places, poses
from sumo_mcts.prediction.turns import turns, waits_for_turn
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import (
    STANDING,
    TURNS,
    USUAL,
    Agents,
    EgoState,
    Follow,
    Forecast,
    Intent,
    Release,
    Scene,
    Scripted,
)

# m/s2 of smoothed acceleration below which a vehicle is taken to drive at its desired speed,
CRUISING = 0.5
CRUISING_SPEED = 3.0  # m/s, where it is faster than this
MILLISECONDS = 3  # digits of a time in s: SUMO counts in them
NO_INTENT = Intent(-1, USUAL)  # every agent does what is likeliest


class Question(NamedTuple):
    """What a predictor is asked each cycle."""

    scene: Scene
    # [K] the lanes that the ego is going to drive, the one it is on or moves to first
    ego_lanes: Ints
    # [K] m/s: what the ego is taken to do first, at multiples of params.step from now + params.step
    # on; may be empty. Later it follows as the others do. The forecast is conditional on that.
    nominal: Floats
    # of the sections `prediction` and `sensor`; params.step: s between the times of the forecast
    params: TrafficParams
    seconds: float  # how far the forecast has to reach
    # s since the ego came to a stand at the stop sign before it; -inf: it has not
    stood_s: float = -math.inf
    hypotheses: int = 1  # that the planner weighs at most
    command: Follow | Release = Release()  # what is left of the ego's last command
    # [N] agents that have, or had a moment ago, a reason to stand (driver/reasons.py); empty: none
    held_up: Bools = np.zeros(0, np.bool_)


class OracleData(NamedTuple):
    """Answers of oracles, by index of the agent; empty unless a scenario names an oracle."""

    scripts: Mapping[int, Scripted] = {}  # its coming states, whatever happens
    # its coming states if the ego does what is nominal; it reacts and yields as it would otherwise
    copies: Mapping[int, Scripted] = {}
    # the lanes that it is really going to take, from the one that it is in
    lanes: Mapping[int, Ints] = {}


NO_DATA = OracleData()
NO_LANES: Mapping[int, Ints] = {}


def times_of(seconds: float, step: float) -> int:
    """How many times, a step apart, a forecast of `seconds` has: now is the first."""
    return math.ceil(seconds / step) + 1


class Ground(NamedTuple):
    """What the hypotheses of a forecast have in common: where the agents are led, and what lies
    there."""

    agents: Agents  # those that change lanes on the lane that they move to
    drivers: Drivers  # the ego (row 0) and the agents, who do what is usual
    paths: Paths  # row 0: the ego's, row i + 1: that of agent i
    course: Course | None  # on these paths; None where all keep their speed
    on_foot: Ways
    back: Return  # of those that overtake
    place: Floats  # [N] m to the left of the middle of its lane that an agent drives at


def ground_of(road: RoadMap, question: Question, lanes: Mapping[int, Ints] = NO_LANES) -> Ground:
    """Where agents are led; some, by index, along `lanes` that are known."""
    agents = changing(road, question.scene.agents, question.ego_lanes, question.params.aside)
    times, step = times_of(question.seconds, question.params.step), question.params.step
    on_foot = ways_at(road, question.ego_lanes, question.scene, agents, times, step)
    back = going_back(road, agents, question.scene.ego)
    divided = question.scene.ego.sideways.speed > 0.0
    place = places(road, agents, back.lane) if divided else np.zeros(len(agents.ids))
    ground = Ground(agents, NO_DRIVERS, NO_PATHS, None, on_foot, back, place)
    return led(road, question, ground, lanes)


def led(road: RoadMap, question: Question, ground: Ground, lanes: Mapping[int, Ints]) -> Ground:
    """The same agents along other lanes, or for another time."""
    scene, agents = question.scene, ground.agents
    paths = likely_paths(road, agents, scene.ego, question.ego_lanes, lanes, question.seconds)
    if not question.params.interacting:
        return ground._replace(paths=paths, drivers=_drivers(road, agents, question, None))
    columns: Any = zip(paths, ground.paths, strict=True)
    if ground.course is not None and all(np.array_equal(*each) for each in columns):
        return ground
    times = np.arange(times_of(question.seconds, question.params.step), dtype=np.float64)
    times *= question.params.step
    course = course_of(road, scene.signals, paths, _classes(scene.ego, agents), times)
    drivers = _drivers(road, agents, question, course)
    return ground._replace(drivers=drivers, paths=paths, course=course)


def predict(
    road: RoadMap,
    question: Question,
    oracle: OracleData = NO_DATA,
    intent: Intent = NO_INTENT,
    ground: Ground | None = None,
) -> Forecast:
    """A forecast of one hypothesis: one agent has the `intent`, the others react.

    `oracle`: the answers of an oracle; without them the forecast uses what sensors see. `ground`:
    that of the question without oracle and intent, where it is there already.
    """
    if ground is None:
        ground = ground_of(road, question, oracle.lanes)
    if intent.does == TURNS:
        way = {intent.agent: np.array(intent.way, np.int32)}
        ground = led(road, question, ground, {**oracle.lanes, **way})
    agents, params = ground.agents, question.params
    x, v, polite = _driven(road, question, ground, intent)
    on_foot, x, v = with_waiting(ground.on_foot, x, v, params.step, intent.agent)
    found = poses(road, agents, ground.paths, on_foot, ground.back, x, params.step, ground.place)
    forecast = Forecast(
        dt=params.step,
        weight=np.ones(1),
        pose=found.pose[None],
        v=v[:, 1:].copy()[None],
        lane=found.lane[None],
        s=found.s[None],
        valid=found.valid[None],
        half_length=agents.length / 2,
        half_width=agents.width / 2,
        reacts=~agents.person,
        yields=polite[1:][None],
        intents=(intent,),
    )
    _overwrite(forecast, oracle)
    return forecast


def expected_accels(road: RoadMap, question: Question, ground: Ground) -> Floats:
    """[N] accelerations of the agents in the first step if they did what is usual, whatever they
    did of late, m/s2. `ground`: that of the question."""
    step = question.params.step
    forgetful = question.params._replace(persistence=0.0)
    now = question._replace(params=forgetful, seconds=step)
    _, v, _ = _driven(road, now, led(road, now, ground, NO_LANES), NO_INTENT)
    return np.asarray((v[1, 1:] - v[0, 1:]) / step)


def _driven(
    road: RoadMap, question: Question, ground: Ground, intent: Intent
) -> tuple[Floats, Floats, Bools]:
    """As behaviour.drive."""
    params, does = question.params, ground.drivers.does.copy()
    does[intent.agent + 1] = intent.does
    return drive(
        course=ground.course,
        drivers=ground.drivers._replace(does=does),
        nominal=question.nominal,
        params=params,
        of_ego=params._replace(accel=min(params.accel, question.scene.ego.max_accel)),
        times=times_of(question.seconds, params.step),
        lanes=len(road.lane_ids),
    )


def _classes(ego: EgoState, agents: Agents) -> Ints:
    """[N+1] vehicle classes of the ego and the agents."""
    return np.concatenate([[ego.vclass], agents.vclass]).astype(np.int32)


def _drivers(road: RoadMap, agents: Agents, question: Question, course: Course | None) -> Drivers:
    """The ego (row 0) and the agents on their course, who do what is usual."""
    ego, params = question.scene.ego, question.params
    cruises = (np.abs(agents.trend) < CRUISING) & (agents.v > CRUISING_SPEED)
    knows = (agents.standing_s != 0.0) | (agents.v <= STANDING)
    its_stand = np.where(knows, -np.abs(agents.standing_s), np.inf)
    stood = np.concatenate([[-question.stood_s], its_stand]).round(MILLISECONDS)
    drivers = Drivers(
        x=np.concatenate([[ego.s], agents.s]),
        v=np.concatenate([[ego.v], agents.v]),
        length=np.concatenate([[ego.length], agents.length]),
        stays=np.concatenate([[False], _stays(agents, question)]),
        cruises=np.concatenate([[False], cruises]),
        stood=stood,
        turn=turns(road, course, stood),
        trend=np.concatenate([[0.0], agents.trend]),
        does=np.full(len(agents.ids) + 1, USUAL),
        vclass=_classes(question.scene.ego, agents),
    )
    waits = waits_for_turn(course, drivers, params.stays_after)
    return drivers._replace(stays=drivers.stays & ~waits)


def _stays(agents: Agents, question: Question) -> Bools:
    """[N] which agents have stood for long without a reason that was seen."""
    stands = agents.standing_s >= question.params.stays_after
    return stands & ~question.held_up if len(question.held_up) else stands


def _overwrite(forecast: Forecast, oracle: OracleData) -> None:
    """Write the states from an oracle into the only hypothesis of a forecast."""
    times = forecast.v.shape[1]
    for i, states in (*oracle.copies.items(), *oracle.scripts.items()):
        have = min(len(states.v), times)
        forecast.pose[0, :have, i] = states.pose[:have]
        forecast.v[0, :have, i] = states.v[:have]
        forecast.lane[0, :have, i] = states.lane[:have]
        forecast.s[0, :have, i] = states.s[:have]
        forecast.valid[0, :have, i] = states.valid[:have]
        forecast.valid[0, have:, i] = False
    for i in oracle.scripts:
        forecast.reacts[i], forecast.yields[0, i] = False, False
