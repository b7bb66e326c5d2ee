"""Room taken sideways within the lane, where SUMO divides lanes: slower narrow traffic at the edge
is passed beside it, and nobody is a leader who leaves room beside itself.

The ego's path is the middle of its lanes moved aside. It is laid once a cycle (`own_path`), from
where the others are now. The search reads its rows in place of those of the route, and tests them
against the forecast as ever.
"""

import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices, Ints
from sumo_mcts.model.caps import SPACING
from sumo_mcts.model.local_map import ELSEWHERE, State
from sumo_mcts.model.route import CAP, RouteMap
from sumo_mcts.model.standing import QUEUE_GAP, waits
from sumo_mcts.numerics.geometry import COS, SIN, X, Y
from sumo_mcts.numerics.krauss import CAREFUL_S, STANDSTILL, safe_gap
from sumo_mcts.road import LEFT, RIGHT, VEHICLE_CLASSES, RoadMap
from sumo_mcts.scene import STANDING, Agents, Decision, EgoState, Follow, Forecast, Scene

VIEW = 200.0  # m of the ego's lanes over which the path is laid
LOOK = 150.0  # m ahead of the ego within which others count
NARROW = 1.3  # m of width up to which a vehicle leaves its lane to others, too
STOOD_S = 5.0  # s after which a wide vehicle that stands is taken to stay
LEAST_SHIFT = 0.02  # m aside that are worth a command
EDGE = 0.1  # m kept to the edges of the lane
PACE = 0.7  # of the speed to the side at most that a path assumes: SUMO sets off gently
TURNS_AT = 20.0  # m before its turn from which the ego passes nobody on that side
EARLY_S = 2.0  # s before it has to that the ego begins to move aside
LEAST_V = 3.0  # m/s from which a path goes aside: slower it does so over as many metres
FASTER = 1.5  # m/s by which the ego has to be able to pass
# m beside others for each m/s of the ego, added to its type's gap: to cyclists and the like, whom
# drivers give 1.5 m at 50 km/h, and to all others
GROWS_S, GROWS_WIDE_S = 0.05, 0.02
UNPROTECTED_M = 0.2  # m more to those
UNPROTECTED = np.array([
    name in ("bicycle", "moped", "motorcycle", "pedestrian", "scooter") for name in VEHICLE_CLASSES
])  # fmt: skip
SLACK = 0.1  # m by which the gap to one who is passed may fall short before it is a leader again
SLOWS = 2.0  # m/s2 of slowing down to the speed at which the room is enough
OTHERS_HALF = 0.9  # m: half the width of an agent that sees who reaches over into its lane
BEND = 0.1  # sine of the angle between two bodies that curves may explain


class Path(NamedTuple):
    """Where the ego drives within its lanes in this cycle."""

    shift: float  # m to the left of where it is now that it moves to
    rows: Floats  # [R, 6] as RouteMap.rows


class Chain(NamedTuple):
    """The ego's lanes ahead, and the one that it came from."""

    node: Indices  # [K]
    begin: Floats  # [K] where each begins, m ahead of the ego's front


class Beside(NamedTuple):
    """M others near the ego's lanes; m ahead of the ego's front, m to the left of the middle."""

    rear: Floats  # [M]
    front: Floats  # [M]
    aside: Floats  # [M] of its middle
    half_width: Floats  # [M] m
    v: Floats  # [M] m/s
    gap: Floats  # [M] m beside it that the ego keeps, standing
    grows: Floats  # [M] s: m more for each m/s
    passable: Bools  # [M] the ego may pass it within the lane
    # [M] on which side of the ego it is to be then: 1 left, -1 right, 0 either
    side: Floats
    own: Bools  # [M] it is on the ego's lanes


def own_path(road: RoadMap, route: RouteMap, state: State, scene: Scene) -> Path | None:
    """The ego's path past those at the edges of its lane, or back to where it likes to drive.

    None: it drives in the middle of its lanes, as where SUMO does not divide them, while it changes
    lanes, and where it overtakes through oncoming traffic.
    """
    ego = scene.ego
    if ego.sideways.speed <= 0.0 or state.other >= 0 or route.oncoming[state.node]:
        return None
    chain = _chain(route, state)
    others = _others(road, route, chain, scene)
    room = np.maximum(0.5 * (road.width[route.lane[chain.node]] - ego.width) - EDGE, 0.0)
    here = int(np.flatnonzero(chain.node == state.node)[0])
    limit = float(route.limit[state.node])
    turn = _turn(road, route, chain)
    to, passed = _place(ego, others, float(room[here]), limit, turn)
    rows = route.rows.copy()
    slope = PACE * ego.sideways.speed / max(ego.v, LEAST_V)
    first = min((float(others.rear[i]) for i in passed), default=0.0)
    begins = first - abs(to - ego.d) / slope - EARLY_S * ego.v
    if abs(ego.d) > room[here]:
        begins = 0.0  # it is not wholly in its lane
    _lay(rows, route, chain, room, (ego.d, to), (begins, slope))
    for i in passed:
        speed = (_gap(ego, others, i, to) + SLACK - others.gap[i]) / others.grows[i]
        if others.own[i] and others.v[i] < ego.v and speed < limit:
            _slow(rows, route, chain, others, i, (ego.v, max(speed, float(others.v[i]) + 1.0)))
    # SUMO moves a standing vehicle to the side; no car does, unless it has to get past something
    goes = begins <= 0.0 and (ego.v >= STANDING or len(passed) > 0)
    return Path(to - ego.d if goes else 0.0, rows)


def shifted(decision: Decision, path: Path) -> Decision:
    """The decision, and the ego moves along its path unless it changes lanes."""
    command = decision.command
    if not isinstance(command, Follow) or command.lane_change != 0 or abs(path.shift) < LEAST_SHIFT:
        return decision
    return decision._replace(command=command._replace(shift=path.shift))


def in_the_way(
    route: RouteMap, scene: Scene, forecast: Forecast, pose: Floats, node: Indices, s: Floats
) -> Indices:
    """Column NODE [T, N] of LocalMap.agent, from `node` and S [T, N], where those are on no node
    who leave room beside the ego's path: there they are no leaders and no followers, only bodies.

    `pose` [T, N, 4] of the agents; the path is in route.rows.
    """
    ego, agents = scene.ego, scene.agents
    on = np.maximum(node, 0)
    last = route.row[on + 1] - 1
    row = route.rows[np.minimum(route.row[on] + np.maximum(s / SPACING, 0.0).astype(int), last)]
    half = forecast.half_length
    dx = pose[..., X] + half * pose[..., COS] - row[..., X] - 0.5 * ego.length * row[..., COS]
    dy = pose[..., Y] + half * pose[..., SIN] - row[..., Y] - 0.5 * ego.length * row[..., SIN]
    aside = np.abs(dy * row[..., COS] - dx * row[..., SIN])
    across = np.abs(pose[..., SIN] * row[..., COS] - pose[..., COS] * row[..., SIN])
    body = forecast.half_width + 2.0 * half * np.maximum(across - BEND, 0.0)
    gap = np.full(len(half), math.inf)  # who is assumed, and not seen, leaves none
    still, grows = _gaps(ego, agents)
    gap[: len(still)] = still + grows * agents.v - SLACK
    return np.where((node >= 0) & (aside - body - 0.5 * ego.width >= gap), ELSEWHERE, node)


def _chain(route: RouteMap, state: State) -> Chain:
    """The ego's lanes, from the one before its own on."""
    node, begin = state.node, -state.s
    before = np.flatnonzero(route.next == node)
    nodes, begins = [node], [begin]
    if len(before):
        nodes.insert(0, int(before[0]))
        begins.insert(0, begin - float(route.length[before[0]]))
    while route.next[node] >= 0 and begin < VIEW:
        begin += float(route.length[node])
        node = int(route.next[node])
        nodes.append(node)
        begins.append(begin)
    return Chain(np.array(nodes), np.array(begins))


def _gaps(ego: EgoState, agents: Agents) -> tuple[Floats, Floats]:
    """[N] m that the ego keeps beside each, standing, and s: m more for each m/s."""
    soft = agents.person | UNPROTECTED[np.maximum(agents.vclass, 0)]
    return ego.sideways.gap + np.where(soft, UNPROTECTED_M, 0.0), np.where(
        soft, GROWS_S, GROWS_WIDE_S
    )


def _others(road: RoadMap, route: RouteMap, chain: Chain, scene: Scene) -> Beside:
    """The vehicles on the ego's lanes and on those beside them, the first one first."""
    ego, agents = scene.ego, scene.agents
    lanes = route.lane[chain.node]
    n = len(agents.ids)
    begin, aside, own = np.full(n, math.inf), np.zeros(n), np.zeros(n, np.bool_)
    for lane, at in zip(lanes[::-1].tolist(), chain.begin[::-1].tolist(), strict=True):
        left, right = int(road.left[lane]), int(road.right[lane])
        for beside, side in ((lane, 0.0), (left, 1.0), (right, -1.0)):
            on = (agents.lane == beside) & (beside >= 0)
            apart = 0.5 * float(road.width[lane] + road.width[beside])
            begin[on], aside[on], own[on] = at, side * apart, side == 0.0
    near = np.flatnonzero(np.isfinite(begin))
    front = begin[near] + agents.s[near]
    order = np.argsort(front, kind="stable")
    near, front = near[order], front[order]
    gap, grows = _gaps(ego, agents)
    rear = front - agents.length[near]
    return Beside(
        rear=rear,
        front=front,
        aside=(aside + agents.d)[near],
        half_width=0.5 * agents.width[near],
        v=agents.v[near],
        gap=gap[near],
        grows=grows[near],
        passable=(np.minimum(agents.width, ego.width) <= NARROW)[near]
        | _parked(road, agents, near, np.column_stack([rear, front, (aside + agents.d)[near]])),
        side=np.where(
            (agents.v > STANDING) & (ego.width > NARROW), 1.0 if road.lefthand else -1.0, 0.0
        )[near],
        own=own[near],
    )


def _parked(road: RoadMap, agents: Agents, near: Indices, where: Floats) -> Bools:
    """[M] who of those `near` stands for no cause that is seen; `where` [M, 3]: rear, front and
    aside as in Beside."""
    rear, front, aside = where.T
    apart, width = rear - front[:, None], agents.width[near]
    before = np.abs(aside - aside[:, None]) < 0.5 * (width + width[:, None])
    queues = (before & (apart > 0.0) & (apart < QUEUE_GAP)).any(axis=1)
    stands = (agents.standing_s[near] > STOOD_S) & (agents.blinker[near] == 0) & ~queues
    for k in np.flatnonzero(stands).tolist():
        stands[k] = not waits(road, int(agents.lane[near[k]]), float(agents.s[near[k]]))
    return stands


def _turn(road: RoadMap, route: RouteMap, chain: Chain) -> tuple[float, int]:
    """m to the ego's next turn, inf: none in view; and its side, 1 left, -1 right."""
    way: Ints = road.direction[route.lane[chain.node]]
    turns = np.flatnonzero(((way == LEFT) | (way == RIGHT)) & (chain.begin > 0.0))
    if not len(turns):
        return math.inf, 0
    return float(chain.begin[turns[0]]), 1 if way[turns[0]] == LEFT else -1


def _place(
    ego: EgoState, others: Beside, room: float, limit: float, turn: tuple[float, int]
) -> tuple[float, list[int]]:
    """Where in its lane the ego is to drive (m to the left of the middle), and whom it passes."""
    low, high, passed = -room, room, []
    wide: list[tuple[float, float]] = []  # from where to where it has all the room that it likes
    for i in range(len(others.v)):
        v, beside = float(others.v[i]), others.rear[i] <= 0.0
        # who is behind the ego needs its distance before the ego comes over
        behind = ego.length + STANDSTILL + safe_gap(v, min(ego.v, v), CAREFUL_S)
        if others.front[i] < -behind or others.rear[i] > LOOK:
            continue
        side = 1.0 if others.aside[i] > ego.d else -1.0  # on which side of the ego it is
        bodies = float(others.half_width[i]) + 0.5 * ego.width
        if beside:
            has = abs(float(others.aside[i]) - ego.d) - bodies
            if has <= 0.0:
                continue  # before or behind it, as the ego comes from another lane
            keeps = min(float(others.gap[i] + others.grows[i] * v), has)
            full = min(float(others.gap[i] + others.grows[i] * ego.v), has)
        else:
            if v > limit - FASTER or not others.passable[i]:
                continue
            keeps = float(others.gap[i] + others.grows[i] * (v + FASTER))
            full = float(others.gap[i] + others.grows[i] * limit)
            side = _side(ego.sideways.wish, others, i, bodies + keeps, (low, high))
            if side == 0.0 or _turns_across(ego, others, i, limit, turn, side):
                continue
        # side 1: the ego drives to the right of it
        edge = float(others.aside[i]) - side * (bodies + keeps)
        least, most = (low, min(high, edge)) if side > 0.0 else (max(low, edge), high)
        if least > most:
            continue
        low, high = least, most
        likes = float(others.aside[i]) - side * (bodies + full)
        wide.append((-math.inf, likes) if side > 0.0 else (likes, math.inf))
        passed.append(i)
    to = ego.sideways.wish
    for least, most in wide[::-1]:  # the nearest has the last word
        to = min(max(to, least), most)
    return min(max(to, low), high), passed


def _side(wish: float, others: Beside, i: int, apart: float, free: tuple[float, float]) -> float:
    """On which side of the ego the i-th is to be passed, `apart` m away: 1 left, -1 right, the one
    that takes the ego less far from its `wish`; 0: there is no room in `free`."""
    low, high = free
    best, least = 0.0, math.inf
    for side in (-1.0, 1.0):
        edge = float(others.aside[i]) - side * apart
        if side == -others.side[i] or (edge > high if side < 0.0 else edge < low):
            continue
        away = max(edge - wish, 0.0) if side < 0.0 else max(wish - edge, 0.0)
        if away < least:
            best, least = side, away
    return best


def _turns_across(
    ego: EgoState, others: Beside, i: int, limit: float, turn: tuple[float, int], side: float
) -> bool:
    """Whether the ego would turn towards the side of one that it has not passed by then."""
    away, towards = turn
    if towards != side:
        return False
    time = (others.front[i] + ego.length + STANDSTILL) / max(limit - others.v[i], FASTER)
    return bool(away < limit * time + TURNS_AT)


def _gap(ego: EgoState, others: Beside, i: int, to: float) -> float:
    """m between the ego at `to` and the i-th."""
    return float(abs(others.aside[i] - to) - others.half_width[i] - 0.5 * ego.width)


def _lay(
    rows: Floats, route: RouteMap, chain: Chain, room: Floats, way: tuple[float, float],
    how: tuple[float, float],
) -> None:  # fmt: skip
    """Move the rows of the ego's lanes aside: from way[0] where it is to way[1], within the room of
    each lane. It begins how[0] m ahead, and moves how[1] m aside a metre."""
    aside, to = way
    begins, slope = how
    for k, node in enumerate(chain.node.tolist()):
        first, end = int(route.row[node]), int(route.row[node + 1])
        goal = min(max(to, -float(room[k])), float(room[k]))
        ahead = chain.begin[k] + SPACING * np.arange(end - first)
        driven = np.maximum(ahead - max(float(chain.begin[k]), begins, 0.0), 0.0)
        moved = aside + np.clip(goal - aside, -slope * driven, slope * driven)
        rows[first:end, X] -= moved * rows[first:end, SIN]
        rows[first:end, Y] += moved * rows[first:end, COS]
        aside = float(moved[-1])


def _slow(
    rows: Floats, route: RouteMap, chain: Chain, others: Beside, i: int, speeds: tuple[float, float]
) -> None:
    """Bound the speed beside the i-th, and before it: from speeds[0] now to speeds[1], for which
    there is room, m/s."""
    now, then = speeds
    takes_s = max(float(others.front[i]), 0.0) / FASTER
    end = float(others.front[i]) + min(float(others.v[i]) * takes_s, VIEW) + STANDSTILL
    for k, node in enumerate(chain.node.tolist()):
        first, beyond = int(route.row[node]), int(route.row[node + 1])
        ahead = chain.begin[k] + SPACING * np.arange(beyond - first)
        to = np.maximum(float(others.rear[i]) - ahead, 0.0)
        bound = np.sqrt(then * then + 2.0 * SLOWS * to)
        # who is beside it too fast already slows down no faster than that
        braked = np.sqrt(np.maximum(now * now - 2.0 * SLOWS * np.maximum(ahead, 0.0), 0.0))
        bound = np.maximum(bound, braked)
        cap = rows[first:beyond, CAP]
        rows[first:beyond, CAP] = np.where(ahead <= end, np.minimum(cap, bound), cap)


def seen_within(ego: EgoState) -> float:
    """LocalMap.seen_within.

    Where lanes are divided, drivers look only at those whom they would touch, so not at an ego that
    has begun to change to their lane and is not over its line yet.
    """
    return 0.5 * ego.width + OTHERS_HALF if ego.sideways.speed > 0.0 else math.inf


def reaches_over(road: RoadMap, route: RouteMap, state: State, within: float) -> bool:
    """Whether drivers in the other lane of the ego's change see it there now."""
    if state.other < 0 or state.progress <= 0.0:
        return True
    apart = 0.5 * float(road.width[route.lane[[state.node, state.other]]].sum())
    return (1.0 - min(state.progress, 1.0 - state.progress)) * apart < within
