"""How the others will move: the forward-predicted copy of the traffic.

Every agent is led along its most likely lanes (`paths.py`). `constant_velocity` keeps its speed;
`idm` drives there as SUMO's drivers do (`others.py`); `routes` does so along the lanes that the
agents are going to take in truth; `script` reads what is scripted; `clone` reads what a copy of the
simulation tells.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from sumo_mcts.prediction.behaviour import Drivers, TrafficParams, drive
from sumo_mcts.prediction.paths import changing, likely_paths
from sumo_mcts.prediction.poses import poses
from sumo_mcts.scene import (
    TURNS,
    USUAL,
    Agents,
    EgoState,
    Floats,
    Forecast,
    Intent,
    Ints,
    RoadMap,
    Scene,
    Scripted,
)

# m/s2 of smoothed acceleration below which a vehicle is taken to drive at the speed it likes
CRUISING = 0.5
NOBODY = Intent(-1, USUAL)


class OracleData(NamedTuple):
    """What oracles tell, by agent (index): nothing, unless a scenario asks for one."""

    scripts: Mapping[int, Scripted] = {}  # its coming states, whatever happens
    copies: Mapping[
        int, Scripted
        # its coming states if the ego does what is nominal; it reacts and yields as it would
        # otherwise
    ] = {}
    ways: Mapping[
        int, Ints
    ] = {}  # the lanes that it is really going to take from the one that it is in


def times_of(seconds: float, step: float) -> int:
    """How many times, a step apart, a forecast of `seconds` has: now is the first."""
    return math.ceil(seconds / step) + 1


def predict(
    road: RoadMap, scene: Scene, ego_lanes: Ints, nominal: Floats, params: TrafficParams,
    seconds: float, told: OracleData, ego_stood_s: float = -math.inf,
    intent: Intent = NOBODY,
) -> Forecast:  # fmt: skip
    """Every agent of the scene for `seconds`;

    `ego_stood_s`: how long ago the ego came to a stand at the stop line before it.

    The ego drives along `ego_lanes` (the present one first) with the speeds `nominal` [K] at
    multiples of params.step, later by car following: the table is conditional on that. `told` is
    what an oracle tells: Told() for what sensors see. One agent has the `intent`, the others react.
    """
    times = times_of(seconds, params.step)
    agents, ego = changing(road, scene.agents, ego_lanes, params.aside), scene.ego
    ways = (
        {**told.ways, intent.agent: np.array(intent.way, np.int32)}
        if intent.does == TURNS
        else told.ways
    )
    paths = likely_paths(road, agents, ego, ego_lanes, ways, seconds)
    of_ego = params._replace(accel=min(params.accel, ego.max_accel))
    x, v, polite = drive(
        road,
        scene.signals,
        paths,
        _drivers(agents, ego, ego_stood_s, intent, params),
        nominal,
        params,
        of_ego,
        times,
    )
    found, v, yields, reacts = (
        poses(road, agents, paths, x, params.step),
        v[:, 1:].copy(),
        polite[1:],
        ~agents.person,
    )
    for i, known in (*told.copies.items(), *told.scripts.items()):
        have = min(len(known.v), times)
        found.pose[:have, i], v[:have, i], found.lane[:have, i], found.s[:have, i] = (
            known.pose[:have],
            known.v[:have],
            known.lane[:have],
            known.s[:have],
        )
        found.valid[:have, i], found.valid[have:, i] = known.valid[:have], False
    for i in told.scripts:
        reacts[i], yields[i] = False, False
    return Forecast(
        params.step, np.ones(1), found.pose[None], v[None], found.lane[None], found.s[None],
        found.valid[None], agents.length / 2, agents.width / 2, reacts,
        yields[None], (intent,),
    )  # fmt: skip


def _drivers(
    agents: Agents, ego: EgoState, ego_stood_s: float, intent: Intent, params: TrafficParams
) -> Drivers:
    """The ego (row 0) and the agents."""
    does = np.full(len(agents.ids) + 1, USUAL)
    does[intent.agent + 1] = intent.does
    return Drivers(
        x=np.concatenate([[ego.s], agents.s]),
        v=np.concatenate([[ego.v], agents.v]),
        length=np.concatenate([[ego.length], agents.length]),
        stays=np.concatenate([[False], agents.standing_s >= params.stays_after]),
        cruises=np.concatenate([[False], (np.abs(agents.trend) < CRUISING) & (agents.v > 3.0)]),
        stood=np.concatenate(
            [[-ego_stood_s], np.where(agents.standing_s > 0.0, -agents.standing_s, np.inf)]
        ),
        trend=np.concatenate([[0.0], agents.trend]),
        does=does,
    )
