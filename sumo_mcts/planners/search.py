"""The search in the tree: selection, expansion, rollout and backpropagation, pass by pass.

Compiled; the random generator is passed in.
"""

import math

from numpy.random import Generator

from sumo_mcts.arrays import Floats
from sumo_mcts.model.completing import unfinished
from sumo_mcts.model.cost import LEAST_LOSS, is_against, terminal
from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.model.interaction import Neighbours, meet
from sumo_mcts.model.least_cost import least_cost
from sumo_mcts.model.local_map import LocalMap, State, keep_state, kept_state
from sumo_mcts.model.motion import EgoParams, begin_change
from sumo_mcts.numerics.kernel import entry, inlined, kernel
from sumo_mcts.planners.actions import (
    ACCEL,
    FOLLOW,
    LATER,
    NO_SPEED,
    SIDE,
    Action,
    clear_line,
    put_action,
)
from sumo_mcts.planners.continued import NOT_DRIVEN, choice, new_row
from sumo_mcts.planners.ply import (
    ALIVE,
    IMPOSSIBLE,
    LOST,
    NONE,
    SearchParams,
    change_price,
    copy_pairs,
    may_change,
    needed_side,
    simulate,
)
from sumo_mcts.planners.tree import (
    GAP,
    LEADER_V,
    WISHES,
    Tree,
    back_up,
    close_branch,
    is_exhausted,
    is_known,
    near_of,
    spent,
    store,
)
from sumo_mcts.scene import COMFORT, OTHER, PASSABILITY, SAFETY

# What a rollout does (see _continuation).
FOLLOWS, BRAKES, SLOWS_DOWN, THEN_BRAKES, PUSHES, CHANGES = range(6)
TO_FOLLOW, TO_BRAKE, TO_SLOW_DOWN, TO_PUSH = range(WISHES)  # what it wants in a ply
ROLLOUTS_WITHOUT_TURN = 3  # from a leaf that do not depend on a level: to follow, brake, slow down
FOR_EACH_LEVEL = 4  # and those for each level at which they may turn to something else


@entry
def search(
    tree: Tree, local: LocalMap, p: EgoParams, c: CostParams, q: SearchParams, actions: Floats,
    root: State, iterations: int, beat: float, rng: Generator,
) -> tuple[int, int]:  # fmt: skip
    """Grow the tree from the state `root` by up to `iterations` passes.

    `actions` [A, 3]: ACCEL, SIDE, LATER. `beat`: the J of a sequence that is known without the
    tree; inf: none.

    Returns (passes that simulated to the horizon, passes that ended in a known terminal node). The
    value of a node is the lowest J below it. The model is deterministic, and a mean would punish
    nodes with many bad children, so that the ego stands.
    """
    if tree.used[0] == 0:
        _plant(tree, local, p, c, root)
    line = tree.line
    done, known = 0, 0
    while done + known < iterations and not tree.closed[0]:
        node = _select(tree, c, q, beat)
        leaf = tree.level[node] == q.look_ahead
        if not leaf:
            if tree.used[0] >= len(tree.parent):
                break
            child = _expand(tree, local, p, c, q, actions, node, beat)
            if child < 0:
                if is_exhausted(tree, node):
                    close_branch(tree, node)
                continue
            node = child
            if tree.end[node] != ALIVE:
                known += 1
                clear_line(line)
                back_up(tree, actions, node, tree.best[node], line)
                close_branch(tree, node)
                continue
        # One call of the rollout, in a loop: what is inlined there takes long to compile.
        for again in (False, True):
            j = _rollout(tree, local, p, c, q, node, line, rng)
            done += 1
            back_up(tree, actions, node, j, line)
            # Whether to try braking after car following. It is tried for every first action, since
            # one that looks bad after a single pass is not visited again, and wherever car
            # following led to a contact.
            doubtful = not leaf and (tree.level[node] == 1 or j > LEAST_LOSS * c.contact)
            if again or not doubtful or done + known >= iterations:
                break
        # Every continuation was driven, see _continuation.
        driven = ROLLOUTS_WITHOUT_TURN + FOR_EACH_LEVEL * q.rollout
        if leaf and q.adaptive and tree.visits[node] >= driven:
            close_branch(tree, node)
    return done, known


@kernel
def _plant(tree: Tree, local: LocalMap, p: EgoParams, c: CostParams, root: State) -> None:
    store(tree, 0, root, meet(local, p, c, root, tree.others[0], local.followers, 0).near)
    tree.used[0] = 1


# --- selection ---


@kernel
def _select(tree: Tree, c: CostParams, q: SearchParams, beat: float) -> int:
    """Down from the root by UCB1 on best values, to a node with an untried action or on the last
    level. Closes what is pruned."""
    # Values are scaled to 0 .. 1, from the lowest J to the highest of the root's open children (at
    # least 1 more): so `exploration` has no unit.
    low = tree.best[0]
    high = low + 1.0
    for k in range(tree.child.shape[1]):
        i = tree.child[0, k]
        if i >= 0 and not tree.closed[i] and tree.best[i] > high:
            high = tree.best[i]
    node = 0
    while tree.level[node] < q.look_ahead:
        chosen, top = NONE, -math.inf
        for k in range(tree.child.shape[1]):
            i = tree.child[node, k]
            if i == NONE:
                return node
            if i < 0 or tree.closed[i]:
                continue
            if _is_pruned(tree, c, q, i, spent(tree, i) + tree.least[i], beat):
                tree.closed[i] = True
                continue
            value = -min((tree.best[i] - low) / (high - low), 1.0)
            score = value + q.exploration * math.sqrt(
                2.0 * math.log(tree.visits[node] + 1.0) / tree.visits[i]
            )
            if score > top:
                chosen, top = i, score
        if chosen == NONE:
            return node
        node = chosen
    return node


@kernel
def _is_pruned(
    tree: Tree, c: CostParams, q: SearchParams, node: int, cost: float, beat: float
) -> bool:
    """Whether a sequence through a node below the root that costs at least this much cannot become
    the best. Where even the best may be lost nothing is pruned."""
    while q.each and tree.level[node] > 1:
        node = tree.parent[node]
    known = tree.best[node] if q.each else min(tree.best[0], beat)
    return q.adaptive and known < LEAST_LOSS * c.contact and cost >= known


# --- expansion ---


@kernel
def _expand(
    tree: Tree, local: LocalMap, p: EgoParams, c: CostParams, q: SearchParams, actions: Floats,
    node: int, beat: float,
) -> int:  # fmt: skip
    """Try the next action of a node. Returns the new child, or IMPOSSIBLE."""
    k = 0
    while k < tree.child.shape[1] and tree.child[node, k] != NONE:
        k += 1
    if k == tree.child.shape[1]:
        return IMPOSSIBLE
    level = tree.level[node]
    tree.child[node, k] = IMPOSSIBLE  # unless it turns out otherwise
    if level > 0 and actions[k, LATER] == 0.0:
        return IMPOSSIBLE
    state, at = kept_state(tree.where, tree.motion, node), level * q.ply
    action = Action(actions[k, ACCEL], int(actions[k, SIDE]), NO_SPEED)
    changed = 0.0
    if action.side != 0:
        if not may_change(
            local, p, c, state, tree.others[node], action.side, action.accel, at * p.step, math.inf
        ):
            return IMPOSSIBLE
        changed = change_price(c, state)
        state = begin_change(local, p, state, action.side)
    copy_pairs(tree.others[node], tree.moving)
    ply = simulate(local, p, c, q, state, tree.moving, near_of(tree, node), action, at)
    least = 0.0
    if q.adaptive and ply.end == ALIVE:
        least = least_cost(local, p, c, ply.state, (at + q.ply) * p.step, q.horizon)
        cost = spent(tree, node) + ply.safety + ply.comfort + ply.passability + ply.other + changed
        if level > 0 and _is_pruned(tree, c, q, node, cost + least, beat):
            return IMPOSSIBLE
    if action.side == 0 and is_known(tree, node, k, ply.state):
        return IMPOSSIBLE
    i = tree.used[0]
    tree.used[0] += 1
    tree.child[node, k], tree.parent[i], tree.level[i] = i, node, level + 1
    store(tree, i, ply.state, ply.near)
    copy_pairs(tree.moving, tree.others[i])
    tree.cost[i, SAFETY] = tree.cost[node, SAFETY] + ply.safety
    tree.cost[i, COMFORT] = tree.cost[node, COMFORT] + ply.comfort
    tree.cost[i, PASSABILITY] = tree.cost[node, PASSABILITY] + ply.passability
    tree.cost[i, OTHER] = tree.cost[node, OTHER] + changed + ply.other
    tree.end[i], tree.least[i] = ply.end, least
    if ply.end != ALIVE:
        tree.best[i] = spent(tree, i) + ply.loss
    return i


# --- rollout ---


@inlined
def _rollout(
    tree: Tree, local: LocalMap, p: EgoParams, c: CostParams, q: SearchParams, node: int,
    line: Floats, rng: Generator,
) -> float:  # fmt: skip
    """J of a continuation to the horizon; `line` [levels, 3] receives its actions.

    What an earlier one from this node has driven is not driven again.
    """
    known, row = tree.continued, _beginning(tree, node)
    level, last = tree.level[node], q.look_ahead + q.rollout
    policy, turn, to_side = _continuation(tree, q, node, rng)
    clear_line(line)
    for k in range(level, last):
        wish = _wish(policy, turn, k, level)
        if (
            policy == FOLLOWS
            and is_against(local, kept_state(known.where, known.motion, row)) > 0.0
        ):
            wish = TO_PUSH
        side = to_side if k == turn else 0
        then = known.then[row, choice(wish, side)]
        if then == NOT_DRIVEN:
            then = _drive_on(tree, local, p, c, q, row, wish, side, k)
        put_action(line, k, _accel(p, wish), known.side[then])
        row = then
        if known.end[row] != ALIVE:
            break
    return float(known.j[row])


@inlined
def _beginning(tree: Tree, node: int) -> int:
    """The row of Continued in which the rollouts from a node begin."""
    known, row = tree.continued, tree.continued.begin[node]
    if row == NOT_DRIVEN:
        row, kept = new_row(known.used, known.then)
        keep_state(known.where, known.motion, row, kept_state(tree.where, tree.motion, node))
        near = near_of(tree, node)
        known.leader[row, GAP], known.leader[row, LEADER_V] = near.gap, near.leader_v
        known.followers[row] = near.followers
        copy_pairs(tree.others[node], known.others[row])
        known.j[row] = spent(tree, node)
        if kept:
            known.begin[node] = row
    return int(row)


@kernel
def _wish(policy: int, turn: int, k: int, level: int) -> int:
    """What a rollout from a node on `level` wants on level k."""
    if policy == BRAKES or (policy == THEN_BRAKES and k >= turn):
        return TO_BRAKE
    if policy == SLOWS_DOWN and k == level:
        return TO_SLOW_DOWN
    if (policy == PUSHES and k <= turn) or (policy == CHANGES and turn <= k < turn + 2):
        return TO_PUSH
    return TO_FOLLOW


@kernel
def _accel(p: EgoParams, wish: int) -> float:
    """The acceleration of a wish, m/s2 or FOLLOW."""
    if wish == TO_BRAKE:
        return -p.approach_decel
    if wish == TO_SLOW_DOWN:
        return -0.5 * p.approach_decel
    return p.max_accel if wish == TO_PUSH else FOLLOW


@inlined
def _drive_on(
    tree: Tree, local: LocalMap, p: EgoParams, c: CostParams, q: SearchParams, row: int, wish: int,
    to_side: int, k: int,
) -> int:  # fmt: skip
    """Drive the ply on level k from the state in `row` of Continued. Returns the row after it."""
    known, others, time = tree.continued, tree.moving, k * q.ply * p.step
    state = kept_state(known.where, known.motion, row)
    near = Neighbours(known.leader[row, GAP], known.leader[row, LEADER_V], known.followers[row])
    copy_pairs(known.others[row], others)
    j, accel = known.j[row], _accel(p, wish)
    # The tree's own changes may cost others something; what the route needs waits for a gap.
    side, most = (to_side, math.inf) if to_side != 0 else (needed_side(local, state), 0.0)
    if side != 0 and may_change(local, p, c, state, others, side, accel, time, most):
        j += change_price(c, state)
        state = begin_change(local, p, state, side)
    else:
        side = 0
    ply = simulate(local, p, c, q, state, others, near, Action(accel, side, NO_SPEED), k * q.ply)
    j += ply.safety + ply.comfort + ply.passability + ply.other
    if ply.end == LOST:
        j += ply.loss
    elif ply.end == ALIVE and k + 1 == q.look_ahead + q.rollout:
        j += terminal(local, c, ply.state, ply.near.gap, ply.near.leader_v, q.horizon)
        j += unfinished(local, p, c, ply.state, q.horizon)
    then, kept = new_row(known.used, known.then)
    if kept:
        known.then[row, choice(wish, to_side)] = then
    keep_state(known.where, known.motion, then, ply.state)
    known.followers[then] = ply.near.followers
    known.leader[then, GAP], known.leader[then, LEADER_V] = ply.near.gap, ply.near.leader_v
    copy_pairs(others, known.others[then])
    known.side[then], known.end[then], known.j[then] = side, ply.end, j
    return then


@kernel
def _continuation(tree: Tree, q: SearchParams, node: int, rng: Generator) -> tuple[int, int, int]:
    """The next rollout from a node: its policy, the level at which another one takes over, and the
    side of a lane change there.

    The first FOLLOWS, and pushes on in a lane of oncoming traffic. The second BRAKES. Later ones
    are drawn, or taken one after the other where the search is adaptive: SLOWS_DOWN first, follows
    and THEN_BRAKES, PUSHES and then follows, CHANGES lanes. Only nodes on the last level have later
    ones.
    """
    level, last, visits = tree.level[node], q.look_ahead + q.rollout, tree.visits[node]
    if visits < SLOWS_DOWN:
        return visits, last, 0
    if q.adaptive:
        if visits == SLOWS_DOWN:
            return SLOWS_DOWN, last, 0
        which = (
            visits - ROLLOUTS_WITHOUT_TURN
        ) % FOR_EACH_LEVEL  # push, brake, to the right, to the left
        turn = level + (visits - ROLLOUTS_WITHOUT_TURN) // FOR_EACH_LEVEL
        if which >= 2:
            return CHANGES, turn, 2 * which - 5
        return PUSHES if which == 0 else THEN_BRAKES, turn, 0
    policy = BRAKES + int(rng.random() * 5.0)
    turn = level + int(rng.random() * (last - level)) if policy >= THEN_BRAKES else last
    return policy, turn, (1 if rng.random() < 0.5 else -1) if policy == CHANGES else 0
