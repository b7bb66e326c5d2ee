"""The tree as arrays, and the search in it: select, expand, simulate, back up.

Compiled; the random generator is passed in.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from sumo_mcts.model.cost import terminal
from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.model.interaction import meet
from sumo_mcts.model.local_map import LocalMap, State, keep_state, kept_state
from sumo_mcts.model.motion import FOLLOW, EgoParams, begin_change
from sumo_mcts.numerics.kernel import entry, inlined, kernel
from sumo_mcts.planners.rollout import (
    ALIVE,
    ARRIVED,
    IMPOSSIBLE,
    LOST,
    NONE,
    SearchParams,
    copy_pairs,
    entry_of,
    may_change,
    needed_side,
    simulate,
)
from sumo_mcts.scene import Bools, Floats, Indices


class Tree(NamedTuple):
    """M nodes, A actions. Node 0 is the root."""

    parent: Indices  # [M]
    child: Indices  # [M, A] NONE: untried, IMPOSSIBLE
    level: Indices  # [M]
    visits: Indices  # [M]
    total: Floats  # [M] sum of the costs J backed up
    best: Floats  # [M] lowest J found below
    # [M] nothing below is left to try: lost, arrived, all children dead, or (adaptive) nothing
    # better can be there
    dead: Bools
    end: Indices  # [M] ALIVE, LOST or ARRIVED
    where: Indices  # [M, 2] State.node and State.other
    motion: Floats  # [M, 5] State.s, v, a, progress, turn
    followers: Indices  # [M] int64
    leader: Floats  # [M, 2] gap (m) and speed of the leader
    others: Floats  # [M, R, 2] the agents that the search moves (see model/react.py)
    moving: Floats  # [R, 2] scratch for them
    cost: Floats  # [M, 4] safety, comfort, passability, other, from the root
    plan: Floats  # [A, plies] for each root action the best sequence of entries (see entry_of)
    line: Floats  # [plies] scratch
    used: Indices  # [1] nodes in use


def new_tree(size: int, actions: int, plies: int, others: Floats) -> Tree:
    """An empty tree for `size` nodes;

    `others` [R, 2]: the agents that the search moves, as they are now.
    """
    moved = np.zeros((size, *others.shape))
    moved[0] = others
    return Tree(
        np.full(size, NONE, np.int64), np.full((size, actions), NONE, np.int64),
        np.zeros(size, np.int64), np.zeros(size, np.int64),
        np.zeros(size), np.full(size, np.inf), np.zeros(size, np.bool_), np.zeros(size, np.int64),
        np.full((size, 2), NONE, np.int64),
        np.zeros((size, 5)), np.zeros(size, np.int64), np.zeros((size, 2)), moved, others.copy(),
        np.zeros((size, 4)), np.full((actions, plies), np.nan),
        np.zeros(plies), np.zeros(1, np.int64),
    )  # fmt: skip


@entry
def search(
    tree: Tree,
    local: LocalMap,
    p: EgoParams,
    c: CostParams,
    q: SearchParams,
    actions: Floats,
    root: State,
    iterations: int,
    beat: float,
    rng: Generator,
) -> tuple[int, int]:
    """Grow the tree from the state `root` by up to `iterations` passes.

    `actions` [A, 3]: acceleration, lane change, 1 where it is tried below the root too. `beat`: the
    J of a sequence that is known without the tree; inf: none.

    Returns (passes that simulated to the horizon, passes that ended in a known terminal node). The
    lower its J, the better a node; node values are the best J below (the model is deterministic,
    and a mean would punish nodes with many bad children: a standing ego).
    """
    if tree.used[0] == 0:
        _plant(tree, local, p, c, root)
    line = tree.line
    done, known = 0, 0
    while done + known < iterations and not tree.dead[0]:
        node = _select(tree, c, q, beat)
        leaf = tree.level[node] == q.look_ahead
        if not leaf:
            if tree.used[0] >= len(tree.parent):
                break
            child = _expand(tree, local, p, c, q, actions, node, beat)
            if child < 0:
                if _exhausted(tree, node):
                    _close_branch(tree, node)
                continue
            node = child
            if tree.end[node] != ALIVE:
                known += 1
                line[:] = np.nan
                _back_up(tree, actions, node, tree.best[node], line)
                _close_branch(tree, node)
                continue
        for again in (
            False,
            True,
        ):  # at one place for all: what is inlined there takes long to compile
            j = _rollout(tree, local, p, c, q, node, line, rng)
            done += 1
            _back_up(tree, actions, node, j, line)
            # Would braking be better than car following? Asked of every beginning, since one that
            # looks bad after a single try is not looked at again, and where car following ran into
            # something.
            doubtful = not leaf and (tree.level[node] == 1 or j > c.contact * 0.5)
            if again or not doubtful or done + known >= iterations:
                break
        if (
            leaf and q.adaptive and tree.visits[node] >= 3 + 4 * q.rollout
        ):  # every continuation was driven, see _continuation
            _close_branch(tree, node)
    return done, known


@kernel
def _plant(tree: Tree, local: LocalMap, p: EgoParams, c: CostParams, root: State) -> None:
    meeting = meet(local, p, c, root, tree.others[0], local.followers, 0)
    _store(tree, 0, root, meeting.followers, meeting.gap, meeting.leader_v)
    tree.used[0] = 1


@kernel
def _store(tree: Tree, i: int, state: State, followers: int, gap: float, leader_v: float) -> None:
    keep_state(tree.where, tree.motion, i, state)
    tree.followers[i] = followers
    tree.leader[i, 0], tree.leader[i, 1] = gap, leader_v


@kernel
def _spent(tree: Tree, node: int) -> float:
    """J of the way from the root to a node."""
    return float(tree.cost[node, 0] + tree.cost[node, 1] + tree.cost[node, 2] + tree.cost[node, 3])


@kernel
def _is_pruned(
    tree: Tree, c: CostParams, q: SearchParams, node: int, cost: float, beat: float
) -> bool:
    """Whether a sequence by way of a node below the root that has cost this much already cannot
    become the best: costs only add up. Where even the best may be lost all count."""
    while q.each and tree.level[node] > 1:
        node = tree.parent[node]
    known = tree.best[node] if q.each else min(tree.best[0], beat)
    return q.adaptive and known < 0.5 * c.contact and cost >= known


@kernel
def _select(tree: Tree, c: CostParams, q: SearchParams, beat: float) -> int:
    """Down from the root by UCB1 on best values, to a node with an untried action or on the last
    level."""
    low = tree.best[0]
    high = low + 1.0
    for k in range(tree.child.shape[1]):
        i = tree.child[0, k]
        if i >= 0 and not tree.dead[i] and tree.best[i] > high:
            high = tree.best[i]
    node = 0
    while tree.level[node] < q.look_ahead:
        chosen, top = NONE, -math.inf
        for k in range(tree.child.shape[1]):
            i = tree.child[node, k]
            if i == NONE:
                return node
            if i < 0 or tree.dead[i]:
                continue
            if _is_pruned(tree, c, q, i, _spent(tree, i), beat):
                tree.dead[i] = True
                continue
            worth = -min((tree.best[i] - low) / (high - low), 1.0)
            score = worth + q.exploration * math.sqrt(
                2.0 * math.log(tree.visits[node] + 1.0) / tree.visits[i]
            )
            if score > top:
                chosen, top = i, score
        if chosen == NONE:
            return node
        node = chosen
    return node


@kernel
def _expand(
    tree: Tree,
    local: LocalMap,
    p: EgoParams,
    c: CostParams,
    q: SearchParams,
    actions: Floats,
    node: int,
    beat: float,
) -> int:
    """Try the next action of a node. Returns the new child, or IMPOSSIBLE."""
    k = 0
    while k < tree.child.shape[1] and tree.child[node, k] != NONE:
        k += 1
    if k == tree.child.shape[1]:
        return IMPOSSIBLE
    if tree.level[node] > 0 and actions[k, 2] == 0.0:
        tree.child[node, k] = IMPOSSIBLE
        return IMPOSSIBLE
    state, side = kept_state(tree.where, tree.motion, node), int(actions[k, 1])
    changed = 0.0
    if side != 0:
        if not may_change(
            local, p, c, state, side, actions[k, 0], tree.level[node] * q.ply * p.step, math.inf
        ):
            tree.child[node, k] = IMPOSSIBLE
            return IMPOSSIBLE
        state = begin_change(local, p, state, side)
        changed = c.lane_change
    copy_pairs(tree.others[node], tree.moving)
    ply = simulate(
        local,
        p,
        c,
        q,
        state,
        tree.moving,
        tree.followers[node],
        tree.leader[node, 0],
        tree.leader[node, 1],
        actions[k, 0],
        tree.level[node] * q.ply,
    )
    dear = (
        tree.level[node] > 0
        and ply.end == ALIVE
        and _is_pruned(
            tree,
            c,
            q,
            node,
            _spent(tree, node) + ply.safety + ply.comfort + ply.passability + ply.other + changed,
            beat,
        )
    )
    if dear or (side == 0 and _known(tree, node, k, ply.state)):
        tree.child[node, k] = IMPOSSIBLE
        return IMPOSSIBLE
    i = tree.used[0]
    tree.used[0] += 1
    tree.child[node, k], tree.parent[i], tree.level[i] = i, node, tree.level[node] + 1
    _store(tree, i, ply.state, ply.followers, ply.gap, ply.leader_v)
    copy_pairs(tree.moving, tree.others[i])
    tree.cost[i, 0] = tree.cost[node, 0] + ply.safety
    tree.cost[i, 1] = tree.cost[node, 1] + ply.comfort
    tree.cost[i, 2] = tree.cost[node, 2] + ply.passability
    tree.cost[i, 3] = tree.cost[node, 3] + changed + ply.other
    tree.end[i] = ply.end
    if ply.end != ALIVE:
        tree.best[i] = _spent(tree, i) + ply.loss
    return i


@kernel
def _known(tree: Tree, node: int, action: int, state: State) -> bool:
    """Whether an earlier action led to the same state: the road or the bounds left no choice."""
    for k in range(action):
        i = tree.child[node, k]
        if i >= 0 and tree.where[i, 0] == state.node and tree.where[i, 1] == state.other:
            if (
                abs(tree.motion[i, 0] - state.s) < 1e-6
                and abs(tree.motion[i, 1] - state.v) < 1e-6
                and abs(tree.motion[i, 2] - state.a) < 1e-6
            ):
                return True
    return False


@inlined
def _rollout(
    tree: Tree,
    local: LocalMap,
    p: EgoParams,
    c: CostParams,
    q: SearchParams,
    node: int,
    line: Floats,
    rng: Generator,
) -> float:
    """J of a continuation to the horizon; `line` receives its accelerations."""
    state, followers = kept_state(tree.where, tree.motion, node), tree.followers[node]
    gap, leader_v = tree.leader[node, 0], tree.leader[node, 1]
    level, last = tree.level[node], q.look_ahead + q.rollout
    policy, turn, way = _continuation(tree, q, node, rng)
    line[:] = np.nan
    others = tree.moving
    copy_pairs(tree.others[node], others)
    j = _spent(tree, node)
    for k in range(level, last):
        accel = FOLLOW
        if policy == 1 or (policy == 3 and k >= turn):
            accel = -p.approach_decel
        elif policy == 2 and k == level:
            accel = -0.5 * p.approach_decel
        elif (policy == 4 and k <= turn) or (policy == 5 and turn <= k < turn + 2):
            accel = p.max_accel
        line[k] = accel
        side = way if k == turn and way != 0 else needed_side(local, state)
        most = (
            math.inf if k == turn and way != 0 else 0.0
            # the tree's own actions may cost others something; what goes on of itself waits for a
            # gap
        )
        if side != 0 and may_change(local, p, c, state, side, accel, k * q.ply * p.step, most):
            state = begin_change(local, p, state, side)
            line[k] = entry_of(accel, side)
            j += c.lane_change
        ply = simulate(local, p, c, q, state, others, followers, gap, leader_v, accel, k * q.ply)
        j += ply.safety + ply.comfort + ply.passability + ply.other
        if ply.end == LOST:
            return j + ply.loss
        if ply.end == ARRIVED:
            return j
        state, followers, gap, leader_v = ply.state, ply.followers, ply.gap, ply.leader_v
    return j + terminal(local, c, state, gap, leader_v)


@kernel
def _continuation(tree: Tree, q: SearchParams, node: int, rng: Generator) -> tuple[int, int, int]:
    """What the next rollout from a node does: policy, the level at which it turns to something
    else, and the side of a lane change there.

    The first follows (0), the second brakes (1). Later ones are drawn, or taken one after the other
    where the search is adaptive: slow down first (2), follow and then brake (3), push and then
    follow (4), change lanes (5). Only nodes on the last level have later ones.
    """
    level, last, visits = tree.level[node], q.look_ahead + q.rollout, tree.visits[node]
    if visits < 2:
        return visits, last, 0
    if q.adaptive:
        turn, which = level + (visits - 3) // 4, (visits - 3) % 4
        return (
            (2, last, 0)
            if visits == 2
            else (5, turn, 2 * which - 5)
            if which >= 2
            else (4 - which, turn, 0)
        )
    policy = 1 + int(rng.random() * 5.0)
    turn = level + int(rng.random() * (last - level)) if policy >= 3 else last
    return policy, turn, (1 if rng.random() < 0.5 else -1) if policy == 5 else 0


@kernel
def _back_up(tree: Tree, actions: Floats, node: int, j: float, line: Floats) -> None:
    """Count a visit on the way to the root; keep the best J, and the sequence behind the best J of
    each root action."""
    i = node
    while i != NONE:
        tree.visits[i] += 1
        tree.total[i] += j
        better = j < tree.best[i] or (tree.visits[i] == 1 and j <= tree.best[i])
        tree.best[i] = min(tree.best[i], j)
        if tree.level[i] == 1 and better:
            k = _action_of(tree, 0, i)
            for n in range(len(line)):
                tree.plan[k, n] = line[n]
            _trace_back(tree, actions, node, k)
        i = tree.parent[i]


@kernel
def _action_of(tree: Tree, node: int, child: int) -> int:
    for k in range(tree.child.shape[1]):
        if tree.child[node, k] == child:
            return k
    return NONE


@kernel
def _trace_back(tree: Tree, actions: Floats, node: int, row: int) -> None:
    """Fill the part of a sequence that lies in the tree with 1000 * lane change + acceleration."""
    while tree.parent[node] != NONE:
        k = _action_of(tree, tree.parent[node], node)
        tree.plan[row, tree.level[node] - 1] = entry_of(actions[k, 0], actions[k, 1])
        node = tree.parent[node]


@kernel
def _exhausted(tree: Tree, node: int) -> bool:
    for k in range(tree.child.shape[1]):
        i = tree.child[node, k]
        if i == NONE or (i >= 0 and not tree.dead[i]):
            return False
    return True


@kernel
def _close_branch(tree: Tree, node: int) -> None:
    """Nothing is left to try below this node: it is dead, and so are its ancestors that have
    nothing else."""
    tree.dead[node] = True
    i = tree.parent[node]
    while i != NONE and _exhausted(tree, i):
        tree.dead[i] = True
        i = tree.parent[i]
