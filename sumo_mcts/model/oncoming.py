"""Overtaking through oncoming traffic: when there is a reason for it, and who may come that the ego
cannot see."""

import math
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices
from sumo_mcts.model.caps import SPACING
from sumo_mcts.model.local_map import State
from sumo_mcts.model.route import FIRST_ROW, HOME, LAST_ROW, LEFT_NODE, RIGHT_NODE, RouteMap
from sumo_mcts.numerics.geometry import COS, SIN, X, Y
from sumo_mcts.numerics.lanes import facing, limits
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Agents, EgoState, Forecast, Scene

# Urgency (LocalMap.urgency) of leaving the lane of the oncoming, wherever the ego is on it.
WANTS_BACK = 0.1
# A leader is worth overtaking that is slower than this share of the limit, does not pick up speed
# (m/s2), and is so near, in s of driving at the limit, and m.
SLOWER, STARTS_OFF = 0.8, 0.5
NEAR_S, NEAR_M = 4.0, 40.0
CLEAR_END = 60.0  # m before the end of the lane of the oncoming in which nothing is overtaken
OVER_LIMIT = 1.2  # times the limit: the speed at which the unseen is taken to come
UNSEEN_LENGTH, UNSEEN_WIDTH = 5.0, 1.8  # m
LOOKS_M = 2.0  # m between the places of a lane that are looked at


class Sight(NamedTuple):
    """How far the ego sees."""

    range_m: float = math.inf  # inf: everything
    hidden: bool = False  # vehicles hide what is behind them


def may_overtake(route: RouteMap, state: State, agents: Agents, node: Indices) -> bool:
    """Whether the lane of the oncoming is open to the ego: a slow leader is ahead, or it is there.

    `node` [N]: of the agents now.
    """
    if is_there(route, state):
        return True
    if not route.oncoming.any() or len(agents.ids) != len(node):
        return False
    path, begins = _path(route, state)
    beside = _beside(route)[path]
    has, ends = beside >= 0, begins + route.reach[beside] - CLEAR_END
    limit = float(route.limit[state.node])
    for i in np.flatnonzero((node >= 0) & (agents.trend < STARTS_OFF)).tolist():
        on = np.flatnonzero(path == node[i])
        if not len(on) or agents.v[i] >= SLOWER * min(limit, float(route.limit[node[i]])):
            continue
        away = float(begins[on[0]] + agents.s[i])
        room = (has & (begins <= away) & (away < ends)).any()
        if room and 0.0 < away < NEAR_M + NEAR_S * limit:
            return True
    return False


def is_there(route: RouteMap, state: State) -> bool:
    """Whether the ego is in a lane of oncoming traffic, or changes to or from one."""
    return bool(route.oncoming[[state.node, max(state.other, 0)]].any())


def _path(route: RouteMap, state: State) -> tuple[Indices, Floats]:
    """The nodes that the ego drives without changing lanes, as far as a leader counts, and m from
    its front to where each begins."""
    nodes, begins = [state.node], [-state.s]
    reach = NEAR_M + NEAR_S * float(route.limit[state.node])
    while route.next[nodes[-1]] >= 0:
        begin = begins[-1] + float(route.length[nodes[-1]])
        if begin > reach:
            break
        nodes.append(int(route.next[nodes[-1]]))
        begins.append(begin)
    return np.array(nodes, np.int64), np.array(begins)


def _beside(route: RouteMap) -> Indices:
    """[W] the lane of the oncoming beside each node, -1: none."""
    found = np.full(len(route.lane), -1, np.int64)
    home = route.table[route.oncoming, HOME].astype(np.int64)
    found[home[home >= 0]] = np.flatnonzero(route.oncoming)[home >= 0]
    return found


def side_back(route: RouteMap) -> int:
    """The side to which the ego leaves a lane of oncoming traffic: 1 left, -1 right."""
    return 1 if (route.left[route.oncoming] >= 0).any() else -1


def closed_table(route: RouteMap) -> Floats:
    """RouteMap.table without ways to the lanes of the oncoming."""
    if not route.oncoming.any():
        return route.table
    table = route.table.copy()
    for column, side in ((LEFT_NODE, route.left), (RIGHT_NODE, route.right)):
        table[(side >= 0) & route.oncoming[side], column] = -1.0
    return table


def with_unseen(
    road: RoadMap, route: RouteMap, view: slice, here: float, scene: Scene, forecast: Forecast,
    sight: Sight,
) -> tuple[Scene, Forecast]:  # fmt: skip
    """Scene and forecast with an agent more: the nearest that may come towards the ego where it
    does not see it, faster than the limit.

    `here`: m along the route of the ego's front. Untouched where no lane of the oncoming is in
    `view`, or all is seen.
    """
    nodes = view.start + np.flatnonzero(route.oncoming[view])
    nodes = nodes[route.station[nodes] + route.length[nodes] > here]
    if not len(nodes) or math.isinf(sight.range_m):
        return scene, forecast
    theirs = facing(road)[route.lane[nodes]]
    comes_from = here + _seen_ahead(route, nodes, here, scene, sight)
    # where the map ends nobody is seen either
    ends = route.station[nodes] + route.length[nodes]
    comes_from = min([comes_from, *ends[~np.isin(theirs, road.successor)].tolist()])
    speed = OVER_LIMIT * float(limits(road, theirs, 0).max())
    times = np.arange(forecast.pose.shape[1])
    front = comes_from - speed * forecast.dt * times
    pose, lane, s = np.zeros((len(times), 4)), np.full(len(times), -1), np.zeros(len(times))
    for n, other in zip(nodes.tolist(), theirs.tolist(), strict=True):
        along = front - route.station[n]
        on_it = (along >= 0.0) & (along <= route.length[n])
        lane[on_it], s[on_it] = other, (route.length[n] - along)[on_it]
        middle = _middle(route, n, along[on_it] + 0.5 * UNSEEN_LENGTH, scene.ego.length)
        pose[on_it] = middle * (1.0, 1.0, -1.0, -1.0)
    return _one_more(scene, forecast, pose, lane, s, speed)


def _seen_ahead(route: RouteMap, nodes: Indices, here: float, scene: Scene, sight: Sight) -> float:
    """m ahead of the ego's front up to which the lane of the oncoming is in view."""
    ego, agents = scene.ego, scene.agents
    reach = sight.range_m - 0.5 * ego.length
    if not sight.hidden or not len(agents.ids):
        return reach
    for n in nodes.tolist():
        low = max(here - float(route.station[n]), 0.0)
        high = min(here + reach - float(route.station[n]), float(route.length[n]))
        places = np.arange(low, high, LOOKS_M)
        middle = _middle(route, n, places, ego.length)
        hidden = _is_hidden(middle[:, :2] - (ego.x, ego.y), agents, ego)
        if hidden.any():
            return float(places[np.argmax(hidden)] + route.station[n] - here)
    return reach


def _is_hidden(to: Floats, agents: Agents, ego: EgoState) -> Bools:
    """[K] whether a vehicle stands on the line from the middle of the ego to a place, `to` [K, 2] m
    away."""
    c, n = np.cos(agents.heading), np.sin(agents.heading)
    dx, dy = ego.x - agents.x, ego.y - agents.y
    # the ego, and the way to each place, as each agent's box has it: [N] and [K, N]
    start = np.stack([dx * c + dy * n, dy * c - dx * n])
    way = np.stack([
        np.outer(to[:, 0], c) + np.outer(to[:, 1], n),
        np.outer(to[:, 1], c) - np.outer(to[:, 0], n),
    ])  # fmt: skip
    half = 0.5 * np.stack([agents.length, agents.width])
    with np.errstate(divide="ignore", invalid="ignore"):
        enter, leave = ((sign * half[:, None, :] - start[:, None, :]) / way for sign in (-1.0, 1.0))
    first, last = np.fmin(enter, leave).max(axis=0), np.fmax(enter, leave).min(axis=0)
    crosses = (first < last) & (last > 0.0) & (first < 1.0) & ~agents.person
    return np.asarray(crosses.any(axis=1), dtype=np.bool_)


def _middle(route: RouteMap, node: int, s: Floats, ego_length: float) -> Floats:
    """[K, 4] poses with their middle at s [K] of a node, m, as the ego drives it."""
    first, last = int(route.table[node, FIRST_ROW]), int(route.table[node, LAST_ROW])
    rows = route.rows[first : last + 1]
    # a row is the middle of the ego's box with its front there
    at, end = s + 0.5 * ego_length, SPACING * (len(rows) - 1)
    columns = [np.interp(at / SPACING, np.arange(len(rows)), rows[:, k]) for k in (X, Y, COS, SIN)]
    beyond = np.maximum(at - end, 0.0)
    columns[X] += beyond * columns[COS]
    columns[Y] += beyond * columns[SIN]
    return np.column_stack(columns)


def _one_more(
    scene: Scene, forecast: Forecast, pose: Floats, lane: Indices, s: Floats, speed: float
) -> tuple[Scene, Forecast]:
    """Scene and forecast with one agent more, which waits for nobody; on `lane` [T] at s [T], m,
    -1: not there."""
    x, y, c, n = pose[0]
    row = {
        "x": x, "y": y, "heading": math.atan2(n, c), "v": speed, "length": UNSEEN_LENGTH,
        "width": UNSEEN_WIDTH, "lane": lane[0], "s": s[0],
    }  # fmt: skip
    columns: dict[str, Any] = scene.agents._asdict()
    names = columns.pop("ids")
    more = {
        name: np.append(values, row.get(name, 0)).astype(values.dtype)
        for name, values in columns.items()
    }
    count = len(forecast.weight)

    def longer(old: Any, new: Any) -> Any:
        """Every hypothesis [H, T, N, ...] with the new agent [T, ...]."""
        new = np.broadcast_to(np.asarray(new)[None, :, None], (count, len(lane), 1, *new.shape[1:]))
        return np.concatenate([old, new], axis=2).astype(old.dtype)

    return scene._replace(agents=Agents((*names, ""), **more)), forecast._replace(
        pose=longer(forecast.pose, pose),
        v=longer(forecast.v, np.full(len(lane), speed)),
        lane=longer(forecast.lane, lane),
        s=longer(forecast.s, s),
        valid=longer(forecast.valid, lane >= 0),
        half_length=np.append(forecast.half_length, 0.5 * UNSEEN_LENGTH),
        half_width=np.append(forecast.half_width, 0.5 * UNSEEN_WIDTH),
        reacts=np.append(forecast.reacts, False),
        yields=np.concatenate([forecast.yields, np.zeros((count, 1), np.bool_)], axis=1),
    )
