"""When those who overtake on a lane of the oncoming go back to their own lane."""

import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats, Indices
from sumo_mcts.numerics.lanes import against_traffic, home_lanes
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Agents, EgoState

CREEPS = 5.0  # m/s: a slower one has found no gap to go back to
CLEAR_BEHIND = 2.0  # m between its rear and whom it has overtaken when it goes back
CLEAR_AHEAD = 1.0  # s of driving: who is nearer ahead is overtaken too


class Return(NamedTuple):
    """How N agents leave the lane of the oncoming."""

    after: Floats  # [N] when they begin to move over, s from now; inf: never
    lane: Indices  # [N] to which lane; -1: they do not
    aside: Floats  # [N] m from the middle of the lane that they are on to that of the other


def going_back(road: RoadMap, agents: Agents, ego: EgoState) -> Return:
    """Who overtakes on a lane of the oncoming goes back as soon as it is past those beside it in
    its own lane. It is expected to pass them as fast as both are now."""
    n = len(agents.lane)
    found = Return(np.full(n, np.inf), np.full(n, -1), np.zeros(n))
    if len(road.oncoming) == 0:
        return found
    lane, s, v, length = (
        np.append(getattr(agents, name), getattr(ego, name))
        for name in ("lane", "s", "v", "length")
    )
    against, side = against_traffic(road), 1.0 if road.lefthand else -1.0
    there = (agents.lane >= 0) & against[agents.lane] & (agents.v >= CREEPS)
    homes, first = home_lanes(road), len(against) - len(road.oncoming)
    for i in np.flatnonzero(there):
        own = int(homes[agents.lane[i] - first])
        ahead = s - agents.s[i]
        passes = (
            (lane == own)
            & (ahead > -agents.length[i] - CLEAR_BEHIND)
            & (ahead - length < CLEAR_AHEAD * agents.v[i])
        )
        past = ahead[passes] + agents.length[i] + CLEAR_BEHIND
        faster = agents.v[i] - v[passes]
        after = np.where(faster > 0.0, past / np.maximum(faster, 1e-9), math.inf)
        found.after[i] = after.max(initial=0.0)
        found.lane[i] = own
        found.aside[i] = side * 0.5 * (road.width[agents.lane[i]] + road.width[own])
    return found
