"""A small tree search that never changes, as a yardstick for speed: `bench` measures it in the same
run and gives every figure as a ratio to it, so that machines and days compare.

It does what any search like ours has to do at least: poses along a path, boxes, distances, one
cost, a choice by UCB. It has no lanes, signals, leaders or rules. Whoever changes it makes all
ratios that were noted before worthless; tests/numerics/test_yardstick.py has its digest.
"""

import hashlib
import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats, Indices
from sumo_mcts.numerics.geometry import COS, SIN, Box, X, Y, box_distance
from sumo_mcts.numerics.kernel import entry, kernel

AGENTS, ACTIONS, LEVELS, PLIES = 10, 12, 4, 8
CHECKS, CHECK_S = 5, 0.2  # a ply is one second
REACH = 8.0  # m between centres beyond which no distance is measured
CONTACT = 10.0  # cost
EXPLORES = 20.0
HALF_LENGTH, HALF_WIDTH = 2.5, 0.9


class Problem(NamedTuple):
    """What is searched: a path, an agent table, and the actions."""

    path: Floats  # [P, 4] pose (X .. SIN) at every metre
    agent: Floats  # [PLIES * CHECKS + 1, AGENTS, 4] poses
    accel: Floats  # [ACTIONS] m/s2


class Nodes(NamedTuple):
    """M nodes; node 0 is the root."""

    parent: Indices  # [M]
    child: Indices  # [M, ACTIONS] -1: untried
    visits: Indices  # [M]
    total: Floats  # [M] sum of the costs backed up
    motion: Floats  # [M, 2] m along the path, m/s
    cost: Floats  # [M] from the root
    lost: Indices  # [M] 1: in contact


def problem() -> Problem:
    """A left turn through ten agents on straight lines. Only arithmetic that rounds alike
    everywhere."""
    path = np.zeros((200, 4))
    cosine, sine, x, y = 1.0, 0.0, 0.0, 0.0
    for i in range(len(path)):
        path[i] = x, y, cosine, sine
        x, y = x + cosine, y + sine
        if 40 <= i < 60:  # a quarter of a circle, about
            cosine, sine = cosine - 0.08 * sine, sine + 0.08 * cosine
            norm = math.sqrt(cosine * cosine + sine * sine)
            cosine, sine = cosine / norm, sine / norm
    agent = np.zeros((PLIES * CHECKS + 1, AGENTS, 4))
    for t in range(len(agent)):
        for j in range(AGENTS):
            gone = CHECK_S * t * (4.0 + j)
            agent[t, j] = (
                (62.0 + 11.0 * j - gone, 4.0 + 3.0 * (j % 3), -1.0, 0.0)
                if j % 2
                else (45.0 + 3.0 * j, -30.0 - 7.0 * j + gone, 0.0, 1.0)
            )
    return Problem(path, agent, np.linspace(-6.0, 2.6, ACTIONS))


def searched(passes: int) -> Nodes:
    """The tree of so many passes."""
    nodes = Nodes(
        parent=np.full(passes + 1, -1),
        child=np.full((passes + 1, ACTIONS), -1),
        visits=np.zeros(passes + 1, np.int64),
        total=np.zeros(passes + 1),
        motion=np.zeros((passes + 1, 2)),
        cost=np.zeros(passes + 1),
        lost=np.zeros(passes + 1, np.int64),
    )
    nodes.motion[0] = 25.0, 8.0
    search(problem(), nodes, passes)
    return nodes


def digest(nodes: Nodes) -> str:
    """Of which nodes there are, and how often each was visited."""
    return hashlib.sha256(nodes.parent.tobytes() + nodes.visits.tobytes()).hexdigest()[:16]


@entry
def search(given: Problem, nodes: Nodes, passes: int) -> None:
    """Grow the tree by so many passes."""
    used = 1
    for _ in range(passes):
        node, level, new = 0, 0, False
        while level < LEVELS and not new and nodes.lost[node] == 0:
            action = _choice(nodes, node)
            level += 1
            if nodes.child[node, action] < 0:
                _expand(given, nodes, node, action, used, level)
                node, new = used, True
                used += 1
            else:
                node = nodes.child[node, action]
        _back_up(nodes, node, nodes.cost[node] + _rollout(given, nodes, node, level))


@kernel
def _choice(nodes: Nodes, node: int) -> int:
    """The first untried action, else that of the best bound."""
    best, found, wide = math.inf, 0, EXPLORES * math.sqrt(2.0 * math.log(nodes.visits[node] + 1.0))
    for action in range(ACTIONS):
        child = nodes.child[node, action]
        if child < 0:
            return action
        n = nodes.visits[child]
        bound = nodes.total[child] / n - wide / math.sqrt(n)
        if bound < best:
            best, found = bound, action
    return found


@kernel
def _expand(given: Problem, nodes: Nodes, node: int, action: int, new: int, level: int) -> None:
    nodes.child[node, action], nodes.parent[new] = new, node
    s, v, cost, lost = _ply(
        given, nodes.motion[node, 0], nodes.motion[node, 1], given.accel[action], level - 1
    )
    nodes.motion[new, 0], nodes.motion[new, 1] = s, v
    nodes.cost[new], nodes.lost[new] = nodes.cost[node] + cost, lost


@kernel
def _rollout(given: Problem, nodes: Nodes, node: int, level: int) -> float:
    """The cost of keeping the speed to the horizon."""
    s, v, total, lost = nodes.motion[node, 0], nodes.motion[node, 1], 0.0, int(nodes.lost[node])
    while level < PLIES and lost == 0:
        s, v, cost, lost = _ply(given, s, v, 0.0, level)
        total += cost
        level += 1
    return total


@kernel
def _ply(
    given: Problem, s: float, v: float, accel: float, level: int
) -> tuple[float, float, float, int]:
    """One second with one acceleration: position, speed, cost, and whether there is contact."""
    cost = 0.0
    for k in range(CHECKS):
        v = min(max(v + accel * CHECK_S, 0.0), 14.0)
        s += v * CHECK_S
        near = _nearest(given, _pose(given.path, s), level * CHECKS + k + 1)
        if near <= 0.0:
            return s, v, cost + CONTACT, 1
        cost += CHECK_S * (1.0 - v / 14.0 + 1.0 / (1.0 + near))
    return s, v, cost + 0.01 * accel * accel, 0


@kernel
def _pose(path: Floats, s: float) -> Box:
    i = min(int(s), path.shape[0] - 2)
    share = s - i
    return Box(
        path[i, X] + share * (path[i + 1, X] - path[i, X]),
        path[i, Y] + share * (path[i + 1, Y] - path[i, Y]),
        path[i, COS],
        path[i, SIN],
        HALF_LENGTH,
        HALF_WIDTH,
    )


@kernel
def _nearest(given: Problem, ego: Box, t: int) -> float:
    """m to the nearest agent, REACH at most."""
    nearest = REACH
    for j in range(AGENTS):
        dx, dy = given.agent[t, j, X] - ego.x, given.agent[t, j, Y] - ego.y
        if dx * dx + dy * dy > REACH * REACH:
            continue
        other = Box(
            given.agent[t, j, X],
            given.agent[t, j, Y],
            given.agent[t, j, COS],
            given.agent[t, j, SIN],
            HALF_LENGTH,
            HALF_WIDTH,
        )
        nearest = min(nearest, box_distance(ego, other))
    return nearest


@kernel
def _back_up(nodes: Nodes, node: int, cost: float) -> None:
    while node >= 0:
        nodes.visits[node] += 1
        nodes.total[node] += cost
        node = nodes.parent[node]
