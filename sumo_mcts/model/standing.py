"""A vehicle that stands in a lane and is no queue, as a double-parked van: where a lane beside
leads past it, the ego's lane ends there."""

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices
from sumo_mcts.model.continuation import nearest
from sumo_mcts.model.route import RouteMap
from sumo_mcts.numerics.lanes import successors
from sumo_mcts.prediction.on_foot import crossings_on
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Agents

STOOD_S = 2.0  # s for which it has stood
QUEUE_GAP = 10.0  # m: a vehicle within it ahead is why one stands
# m before the end of a lane that leads nowhere, or into a junction where vehicles or people meet:
# there one stands that waits for its turn
WAITS = 15.0
PASSED = 50.0  # m beyond it that a lane beside has to lead on, to come back or to go on

Standing = tuple[Indices, Floats, Floats]  # [K] node, and s of rear and front there, m


def standing(
    road: RoadMap, route: RouteMap, ahead: Floats, first: int, agents: Agents,
    place: tuple[Indices, Floats, Bools],
) -> Standing:  # fmt: skip
    """The vehicles that stand in lanes of the route without a cause that is seen.

    `ahead` and `first` as in LocalMap; `place`: node [N] and s [N] of the agents, and whether they
    stay where they are [N]: who is expected to set off does not count.
    """
    node, s, still = place
    here = np.maximum(node, 0)
    if not agents.ids:  # a forecast without a scene (evaluation/hindsight.py)
        return np.zeros(0, np.int64), np.zeros(0), np.zeros(0)
    stays = (agents.standing_s >= STOOD_S) & still & (agents.blinker == 0)
    stays &= (node >= 0) & ~route.internal[here] & ~agents.person
    those = np.flatnonzero(stays)
    if len(those):
        on = np.flatnonzero(node >= 0)
        to_rear = ahead[node[those, None] - first, node[on] - first] + s[on] - agents.length[on]
        gap = to_rear - s[those, None]
        queues = ((gap > -agents.length[on]) & (gap < QUEUE_GAP) & (those[:, None] != on)).any(
            axis=1
        )
        those = those[~queues]
    those = those[[not waits(road, int(route.lane[node[i]]), float(s[i])) for i in those]]
    return node[those], s[those] - agents.length[those], s[those]


def waits(road: RoadMap, lane: int, s: float) -> bool:
    """Whether a vehicle at s (m) on a lane may be waiting for its turn there."""
    todo = [(lane, float(road.length[lane]) - s)]
    while todo:
        here, left = todo.pop()
        if left > WAITS:
            continue
        onto = successors(road, here)
        if not onto or any(_meets(road, after) for after in onto):
            return True
        todo += [(after, left + float(road.length[after])) for after in onto]
    return False


def _meets(road: RoadMap, lane: int) -> bool:
    """Whether a lane leads into a junction with a light, or with others on their way across it."""
    others = road.conflict_offset[lane + 1] > road.conflict_offset[lane]
    return bool(road.signal[lane] >= 0 or others or len(crossings_on(road, np.array([lane])).lane))


def past_standing(route: RouteMap, view: slice, here: float, those: Standing) -> RouteMap:
    """The route with what stands ahead of `here` (m from its start) as the end of its lane.

    In the lanes of `view` that lead to it, `reach`, `changes` and `needed` are those of a lane that
    the route leaves there, where a lane beside leads past. The table is still that of the road: for
    the motion the lane goes on.
    """
    rear, front = _first_standing(route, view, here, those)
    affected = np.flatnonzero(np.isfinite(rear)) + view.start
    if not len(affected):
        return route
    leads = route.station + route.reach
    leads[view] = np.minimum(leads[view], route.station[view] + rear)
    changes, needed, reach = route.changes.copy(), route.needed.copy(), route.reach.copy()
    ends = np.zeros(len(reach), np.bool_)
    for i in affected[::-1].tolist():
        to, after = rear[i - view.start], int(route.next[i])
        leads_past = (leads >= _past(route, front[i - view.start])) & ~route.oncoming
        past = set(np.flatnonzero(leads_past).tolist())
        side = nearest(past, i, (route.left, route.right))
        ends[i] = to < reach[i] and (side is not None or (after >= 0 and ends[after]))
        if ends[i]:
            onward = int(needed[after]) if after >= 0 and ends[after] else 0
            changes[i] = changes[i] or side or 0
            sign = np.sign(changes[i]) or np.sign(onward)
            needed[i] = sign * max(abs(changes[i]), abs(onward))
            reach[i] = to
    return route._replace(changes=changes, needed=needed, reach=reach)


def _past(route: RouteMap, front: float) -> float:
    """m from the start of the route to where a lane has to lead that leads past what stands with
    its front at `front`: to the next stop is enough."""
    halt = route.halt
    place = route.station[halt.node] + halt.place if halt.ends else np.inf
    return min(front + PASSED, float(place)) if place > front else front + PASSED


def _first_standing(
    route: RouteMap, view: slice, here: float, those: Standing
) -> tuple[Floats, Floats]:
    """[W] of the first that stands ahead on each node's path: m to its rear from the start of the
    node, and where its front is, m from the start of the route. inf: nobody does."""
    first, w = view.start, view.stop - view.start
    rear, front = np.full(w, np.inf), np.full(w, np.inf)
    for node, back, nose in zip(*(column.tolist() for column in those), strict=True):
        if route.station[node] + back > here and back < rear[node - first]:
            rear[node - first], front[node - first] = back, route.station[node] + nose
    for i in range(w - 1, -1, -1):
        after = int(route.next[first + i]) - first
        if np.isinf(rear[i]) and 0 <= after < w and np.isfinite(rear[after]):
            rear[i], front[i] = route.length[first + i] + rear[after], front[after]
    return rear, front
