"""What the local map of one cycle holds of the agents: one hypothesis of the forecast, beside the
ego's route."""

from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices, Ints
from sumo_mcts.model.agent_tables import Tables
from sumo_mcts.model.local_map import (
    AGENT,
    KERB,
    OWN_NODE,
    PAST,
    UPSTREAM,
    State,
)
from sumo_mcts.model.route import RouteMap
from sumo_mcts.model.stop_lines import Rules
from sumo_mcts.numerics.kernel import entry
from sumo_mcts.prediction.poses import SIDEWAYS
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import STANDING, STARTS, Agents, EgoState, Forecast, Scene

MOST_ASKED = 4  # agents behind the ego that may make room in one cycle
MOST_FOLLOWERS = 63  # bits of a mask
MOST_AT_KERBS = 12  # people whom the search has wait or walk in one cycle
DRIFTS = 0.2  # m off the middle of its lane from which an agent moves sideways
STRAIGHTENS = 1.0  # s from the middle of the lane until its rear has followed
CRAWLS = 1.0  # m/s of the ego below which people on foot walk round it


class Traffic(NamedTuple):
    """The agents in one hypothesis. T times, N agents."""

    pose: Floats  # [T, N, 4] poses of the box
    v: Floats  # [T, N] m/s
    lane: Ints  # [T, N] lane of the front, -1 off the road
    s: Floats  # [T, N] lane position of the front, m
    valid: Bools  # [T, N] False: not there
    # Columns NODE, S and DRIVEN of LocalMap.agent
    node: Indices  # [T, N]
    position: Floats  # [T, N] m
    driven: Floats  # [T, N] m
    polite: Bools  # [N] it lets the ego pass
    starts: int  # LocalMap.starts


def traffic_of(forecast: Forecast, hypothesis: int, tables: Tables) -> Traffic:
    """The agents in a hypothesis; `tables`: of the forecast."""
    return Traffic(
        pose=forecast.pose[hypothesis],
        v=forecast.v[hypothesis],
        lane=forecast.lane[hypothesis],
        s=forecast.s[hypothesis],
        valid=forecast.valid[hypothesis],
        node=tables.node[hypothesis],
        position=tables.position[hypothesis],
        driven=tables.driven[hypothesis],
        polite=forecast.yields[hypothesis],
        starts=_starts(forecast, hypothesis),
    )


def comes_to(node: Indices) -> Indices:
    """[N] the node that each agent is on or comes to, negative: none, from column NODE of
    LocalMap.agent at one time."""
    return np.where(node <= UPSTREAM, UPSTREAM - node, node)


def traits(
    forecast: Forecast,
    traffic: Traffic,
    state: State,
    slots: Indices,
    sideways: tuple[Indices, Ints, Ints],
    bits: Indices,
    walks: Bools,
    owed: Indices,
) -> Floats:
    """LocalMap.trait, from its columns SLOT; BESIDE, UNTIL and SIDEWAYS_UNTIL; BIT; ON_FOOT; and
    OWED."""
    beside, until, sideways_until = sideways
    return np.column_stack([
        forecast.half_length, forecast.half_width, forecast.reacts, traffic.polite,
        slots, beside, until, bits, walks, walks & (state.v < CRAWLS), owed, sideways_until,
    ])  # fmt: skip


def _starts(forecast: Forecast, hypothesis: int) -> int:
    """LocalMap.starts."""
    intents = forecast.intents[hypothesis : hypothesis + 1]
    return next((intent.agent for intent in intents if intent.does == STARTS), -1)


def slots_of(
    route: RouteMap,
    state: State,
    forecast: Forecast,
    traffic: Traffic,
    ego: EgoState,
    rules: Rules,
) -> Indices:
    """[N] 0, 1, ... for those that the search moves, -1 for the others: the one that starts,
    then the nearest that react and come to a lane of the ego's route; where it asks for room, those
    behind it in the lane asked."""
    if rules.asked == 0:
        those, most = forecast.reacts & (traffic.node >= 0).any(axis=0), rules.reactive
    else:
        beside = (route.left if rules.asked > 0 else route.right)[state.node]
        behind = (comes_to(traffic.node[0]) == beside) & (traffic.position[0] < state.s)
        those, most = forecast.reacts & behind & (beside >= 0), MOST_ASKED
    first = np.arange(len(those)) == traffic.starts
    numbers = _nearest(forecast, np.flatnonzero(those & ~first), ego, most)
    return np.where(first, 0, np.where(numbers >= 0, numbers + first.any(), -1))


def owed_at(obligation: Floats, agents: int, first: int, ahead: Floats) -> Indices:
    """Trait OWED of `agents`: the nearest kerb at which each may wait for the ego, on the way of
    the ego's lane if there is one. Lanes beside it lead over the same crossing.

    `ahead` [W]: the row of LocalMap.ahead of the ego's node, for nodes from `first` on.
    """
    owed = np.full(agents, -1)
    those = np.flatnonzero(obligation[:, PAST] > 0.0)
    if not len(those):
        return owed
    own = np.isfinite(ahead[obligation[those, OWN_NODE].astype(int) - first])
    best_last = those[np.lexsort((-obligation[those, KERB], own))]
    owed[obligation[best_last, AGENT].astype(int)] = best_last
    return owed


def with_people(slots: Indices, owed: Indices, forecast: Forecast, ego: EgoState) -> Indices:
    """`slots` and, after those, the nearest people of trait OWED: the search moves them too."""
    those = np.flatnonzero(owed >= 0)
    if not len(those):
        return slots
    people = _nearest(forecast, those, ego, MOST_AT_KERBS)
    return np.where(people >= 0, people + slots.max(initial=-1) + 1, slots)


def bits_of(forecast: Forecast, node: Indices, ego: EgoState) -> Indices:
    """Trait BIT: each agent's own number where there are few, else 0, 1, ... for the nearest of
    those that could follow the ego, -1 for the others."""
    if len(forecast.reacts) <= MOST_FOLLOWERS:
        return np.arange(len(forecast.reacts))
    comes = ((node >= 0) | (node <= UPSTREAM)).any(axis=0)
    return _nearest(forecast, np.flatnonzero(forecast.reacts & comes), ego, MOST_FOLLOWERS)


def _nearest(forecast: Forecast, those: Indices, ego: EgoState, most: int) -> Indices:
    """[N] 0, 1, ... for the nearest `most` of `those`, -1 for the others."""
    where = forecast.pose[0, 0, those]
    nearest = those[
        np.argsort(np.hypot(where[:, 0] - ego.x, where[:, 1] - ego.y), kind="stable")[:most]
    ]
    numbers = np.full(len(forecast.reacts), -1)
    numbers[nearest] = np.arange(len(nearest))
    return numbers


@entry
def followers_of(
    node: Indices, s: Floats, reacts: Bools, bits: Indices, ahead: Floats, state: State, first: int,
    other: int,
) -> int:  # fmt: skip
    """Bit mask of the agents that react and follow the ego: their lane leads to the ego, which is
    ahead of them, or to its place on the lane `other`; -1: it has none there."""
    result = 0
    for i in range(len(node)):
        for target in (state.node, other):
            if node[i] >= 0 and target >= 0 and reacts[i] and bits[i] >= 0:
                gap = ahead[node[i] - first, target - first] + state.s - s[i]
                if 0.0 < gap < np.inf:
                    result |= 1 << bits[i]
    return result


def moving_sideways(
    road: RoadMap, scene: Scene, lane: Ints, half_width: Floats, lane_node: Indices, dt: float
) -> tuple[Indices, Ints, Ints]:
    """BESIDE [H, N], UNTIL [H, N] and SIDEWAYS_UNTIL [H, N] of agents on the lanes `lane`
    [H, T, N].

    The lane that an agent leaves is not free until its whole box is out of it. Where lanes are
    divided, agents that change no lane stay where they are in theirs. Who stands moves nowhere: an
    ego beside it would wait as long as it does.
    """
    agents = scene.agents
    first, times = lane[:, 0], lane.shape[1]
    if not agents.ids:  # a forecast without a scene (evaluation/hindsight.py): its boxes are true
        nothing = np.zeros(first.shape, np.int32)
        return np.full(first.shape, -1), nothing, nothing - 1
    apart = 0.5 * (road.width[agents.lane] + road.width[first])
    off = np.where(
        first == agents.lane,
        agents.d,
        np.where(first == road.left[agents.lane], agents.d - apart, agents.d + apart),
    )
    beside = np.where(
        (first >= 0) & (off != 0.0), np.where(off > 0.0, road.left[first], road.right[first]), -1
    )
    seconds = (np.abs(off) + half_width - 0.5 * road.width[first]) / SIDEWAYS
    leaves = lane != first[:, None]
    on_it = np.where(leaves.any(axis=1), np.argmax(leaves, axis=1), times)
    until = np.minimum(np.floor(seconds / dt), on_it - 1).astype(np.int32)
    drifts = (first >= 0) & ((first != agents.lane) | (scene.ego.sideways.speed <= 0.0))
    drifts &= (np.abs(off) > DRIFTS) & (agents.v > STANDING)
    last = np.floor((np.abs(off) / SIDEWAYS + STRAIGHTENS) / dt)
    drifts_until = np.where(drifts, last, -1.0).astype(np.int32)
    return np.where((beside >= 0) & (seconds > 0.0), lane_node[beside], -1), until, drifts_until


def on_foot(agents: Agents, count: int) -> Bools:
    """Trait ON_FOOT of the `count` agents of a forecast, which are those of the scene, or not in it
    (evaluation/hindsight.py)."""
    return agents.person if agents.ids else np.zeros(count, np.bool_)
