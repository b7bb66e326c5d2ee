"""The paper's planner, Algorithms 1 and 2 to the letter.

Which reading was chosen where the text leaves it open: docs/planner.md.
"""

import math
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.random import Generator

from sumo_mcts.config import ScenarioConfig
from sumo_mcts.model.local_map import (
    COS,
    GONE,
    HALF_LENGTH,
    HALF_WIDTH,
    NODE,
    SIN,
    LocalMap,
    State,
    X,
    Y,
    apart,
    follows,
    index_at,
    keep_state,
    kept_state,
)
from sumo_mcts.model.motion import (
    FREE,
    GOAL,
    OFF_END,
    RED_LINE,
    EgoParams,
    advance,
    begin_change,
    can_change,
    pose_of,
    towards_other,
)
from sumo_mcts.model.route import INTERNAL, LENGTH, NEXT, STATION
from sumo_mcts.numerics.geometry import Box, box_distance
from sumo_mcts.numerics.kernel import kernel, making_arrays
from sumo_mcts.planners.base import Drawing, Situation, Task, local_of
from sumo_mcts.planners.budget import SLICE, budget
from sumo_mcts.planners.rollout import ALIVE, ARRIVED, IMPOSSIBLE, LOST, NONE
from sumo_mcts.scene import (
    LEFT,
    RIGHT,
    STANDING,
    Bools,
    Decision,
    Floats,
    Follow,
    Indices,
    Plan,
    RootChild,
)

EMERGENCY = -8.0  # m/s2, when every action was discarded
TIMED_SLICE = 20  # iterations between looks at the clock


class PaperParams(NamedTuple):
    """See config.PaperConfig."""

    iterations: int
    step_s: float
    look_ahead_steps: int
    rollout_steps: int
    check_s: float
    accelerations: tuple[float, ...]
    lane_change_accelerations: tuple[float, ...]
    exploration: float
    brake_probability: float
    accelerate_probability: float
    weight_safety: float
    weight_comfort: float
    weight_passability: float
    weight_other: float
    safety_threshold: float
    contact_cost: float
    jerk_factor: float
    goal_distance: float
    lane_distance: float
    goal_factor: float
    junction_penalty: float
    lane_change_cost: float
    stop_cost: float
    turn_cost: float
    emergency_cost: float


def paper_params(scenario: ScenarioConfig) -> PaperParams:
    """The search as the section `paper` describes it."""
    p = scenario.paper
    return PaperParams(
        iterations=scenario.planner.iterations,
        step_s=p.step_s,
        look_ahead_steps=p.look_ahead_steps,
        rollout_steps=p.rollout_steps,
        check_s=scenario.planner.check_s,
        accelerations=p.accelerations_mps2,
        lane_change_accelerations=p.lane_change_accelerations_mps2,
        exploration=p.exploration,
        brake_probability=p.brake_probability,
        accelerate_probability=p.accelerate_probability,
        weight_safety=p.weight_safety,
        weight_comfort=p.weight_comfort,
        weight_passability=p.weight_passability,
        weight_other=p.weight_other,
        safety_threshold=p.safety_threshold_m,
        contact_cost=p.contact_cost,
        jerk_factor=p.jerk_factor,
        goal_distance=p.goal_distance_m,
        lane_distance=p.lane_distance_m,
        goal_factor=p.goal_factor,
        junction_penalty=p.junction_penalty,
        lane_change_cost=p.lane_change_cost,
        stop_cost=p.stop_cost,
        turn_cost=p.turn_cost,
        emergency_cost=p.emergency_cost,
    )


def horizon_s(scenario: ScenarioConfig, step: float, forecast_step: float) -> float:
    """How far the search looks into a forecast, s;

    `step`: of the simulation, `forecast_step`: between the states of the forecast, s.
    """
    p = scenario.paper
    return (p.look_ahead_steps + p.rollout_steps) * max(p.step_s, step) + forecast_step


def make(_: Mapping[str, Any], scenario: ScenarioConfig) -> "PaperPlanner":
    """The planner of a scenario."""
    return PaperPlanner(paper_params(scenario))


class Weights(NamedTuple):
    """The part of PaperParams that the compiled code reads, and times in steps of the
    simulation."""

    ply: int
    check: int
    look_ahead: int
    rollout: int
    exploration: float
    brake_probability: float
    accelerate_probability: float
    safety: float
    comfort: float
    passability: float
    other: float
    threshold: float
    contact: float
    jerk_factor: float
    goal_factor: float
    junction_penalty: float
    lane_change: float
    stop: float
    turn: float
    emergency: float


class Guide(NamedTuple):
    """What the route tells the costs. W nodes of the route."""

    goal: float  # where the local goal lies, m from the start of the route
    aside: Floats  # [W] m that the lane changes still needed there add to the local goal's distance
    turns: Bools  # [W] turns left or right at a junction


class PaperTree(NamedTuple):
    """M nodes, A actions."""

    parent: Indices  # [M]
    child: Indices  # [M, A]
    level: Indices  # [M]
    visits: Indices  # [M] n(v)
    total: Floats  # [M] C(v)
    end: Indices  # [M]
    where: Indices  # [M, 2]
    motion: Floats  # [M, 5]
    cost: Floats  # [M, 4] safety, comfort, passability, other, weighted, from the root
    used: Indices  # [1]


class PaperPlanner(Drawing):
    """Monte-Carlo tree search as the paper prints it."""

    def __init__(self, params: PaperParams) -> None:
        self._params = params
        keep = [(a, 0.0) for a in params.accelerations]
        self._actions = np.array(
            keep + [(a, side) for side in (1.0, -1.0) for a in params.lane_change_accelerations]
        )

    def plan(self, situation: Situation) -> Decision:
        """Search from the present state; emergency braking when every child was discarded."""
        task, p = self._task, self._params
        local = local_of(task, situation)
        weights = _weights(p, task.ego.step)
        guide = _guide(task, situation.state, p.goal_distance, p.lane_distance)
        most = budget(p.iterations, situation.until - time.perf_counter())
        tree = _new_tree(
            min(most, _full_size(len(self._actions), p.look_ahead_steps)) * len(self._actions) + 2,
            len(self._actions),
        )
        done = 0
        while done < most and (done == 0 or time.perf_counter() < situation.until):
            count = min(SLICE if math.isinf(situation.until) else TIMED_SLICE, most - done)
            _search(
                tree,
                local,
                task.ego,
                weights,
                self._actions,
                situation.state,
                guide,
                count,
                self._rng,
            )
            done += count
        return self._decision(tree, local, weights, situation, done)

    def _decision(
        self, tree: PaperTree, local: LocalMap, weights: Weights, situation: Situation, done: int
    ) -> Decision:
        children, plans = [], []
        for k, action in enumerate(self._actions):
            i = int(tree.child[0, k])
            if i < 0 or tree.end[i] == LOST or tree.visits[i] == 0:
                continue
            plan = _drive(local, self._task, weights, situation.state, action)
            terms = np.concatenate([tree.cost[i], [0.0]])
            mean = float(tree.total[i] / tree.visits[i])
            children.append(
                RootChild(
                    float(action[0]),
                    int(action[1]),
                    int(tree.visits[i]),
                    mean,
                    mean,
                    terms,
                    plan.pose,
                )
            )
            plans.append(plan)
        if not children:
            plan = _drive(local, self._task, weights, situation.state, np.array([EMERGENCY, 0.0]))
            return Decision(Follow(plan.v, 0), plan, (), -1, "brake", done, 0)
        chosen = min(range(len(children)), key=lambda i: children[i].mean)
        return Decision(
            Follow(plans[chosen].v, children[chosen].lane_change),
            plans[chosen],
            tuple(children),
            chosen,
            "search",
            done,
            0,
        )


def _full_size(actions: int, levels: int) -> int:
    """Nodes of the whole tree: more are never expanded."""
    return sum(actions**k for k in range(levels + 1))


def _weights(p: PaperParams, step: float) -> Weights:
    return Weights(
        max(1, round(p.step_s / step)), max(1, round(p.check_s / step)), p.look_ahead_steps,
        p.rollout_steps, p.exploration, p.brake_probability,
        p.accelerate_probability, p.weight_safety, p.weight_comfort, p.weight_passability,
        p.weight_other, p.safety_threshold, p.contact_cost,
        p.jerk_factor, p.goal_factor, p.junction_penalty, p.lane_change_cost, p.stop_cost,
        p.turn_cost, p.emergency_cost,
    )  # fmt: skip


def _guide(task: Task, state: State, distance: float, lane_distance: float) -> Guide:
    """The local goal: so many metres down the route, on a lane that does not leave it."""
    route = task.route
    turns = route.internal & np.isin(task.road.direction[route.lane], (LEFT, RIGHT))
    # the changes that the next edge needs must be no reason not to enter it
    here = (route.leg == route.leg[state.node]) & ~route.internal
    return Guide(
        float(route.station[state.node] + state.s + distance),
        np.where(here, np.abs(route.changes) * lane_distance, 0.0),
        turns,
    )


def _new_tree(size: int, actions: int) -> PaperTree:
    return PaperTree(
        np.full(size, NONE, np.int64), np.full((size, actions), NONE, np.int64),
        np.zeros(size, np.int64), np.zeros(size, np.int64), np.zeros(size),
        np.zeros(size, np.int64), np.full((size, 2), NONE, np.int64), np.zeros((size, 5)),
        np.zeros((size, 4)), np.zeros(1, np.int64),
    )  # fmt: skip


def _drive(local: LocalMap, task: Task, w: Weights, state: State, action: Floats) -> Plan:
    """The first action, step by step."""
    state = begin_change(local, task.ego, state, int(action[1])) if action[1] else state
    v, lane, s, pose = [], [], [], []
    for k in range(w.ply):
        state, event = advance(local, task.ego, state, float(action[0]), k * task.ego.step)
        v.append(state.v)
        lane.append(int(task.route.lane[state.node]))
        s.append(state.s)
        pose.append(pose_of(local, task.ego, state))
        if event == GOAL:
            break
    return Plan(
        (np.arange(len(v), dtype=np.float64) + 1.0) * task.ego.step,
        np.array(v),
        np.array(lane, np.int32),
        np.array(s),
        np.array(pose),
    )


@making_arrays
def _search(
    tree: PaperTree,
    local: LocalMap,
    p: EgoParams,
    w: Weights,
    actions: Floats,
    root: State,
    guide: Guide,
    iterations: int,
    rng: Generator,
) -> None:
    """Algorithm 1."""
    if tree.used[0] == 0:
        keep_state(tree.where, tree.motion, 0, root)
        tree.used[0] = 1
    for _ in range(iterations):
        node = _select(tree, w, rng)
        if tree.level[node] < w.look_ahead and tree.child[node, 0] == NONE:
            _expand(tree, local, p, w, actions, guide, node)
        cost = _rollout(tree, local, p, w, guide, node, rng)
        i = node
        while i != NONE:
            tree.total[i] += cost
            tree.visits[i] += 1
            i = tree.parent[i]


@kernel
def _select(tree: PaperTree, w: Weights, rng: Generator) -> int:
    """Down to a node without children by the paper's UCB; collided children are not there, and one
    of the unvisited is drawn."""
    node = 0
    while tree.child[node, 0] != NONE:
        chosen, top, unvisited, drawn = NONE, -math.inf, 0, NONE
        for k in range(tree.child.shape[1]):
            i = tree.child[node, k]
            if i < 0 or tree.end[i] == LOST:
                continue
            if tree.visits[i] == 0:
                unvisited += 1
                if rng.random() * unvisited < 1.0:
                    drawn = i
                continue
            score = -tree.total[i] / tree.visits[i] + w.exploration * math.sqrt(
                2.0 * math.log(max(tree.visits[node], 1)) / tree.visits[i]
            )
            if score > top:
                chosen, top = i, score
        if drawn != NONE:
            return drawn
        if chosen == NONE:
            return node
        node = chosen
    return node


@making_arrays
def _expand(
    tree: PaperTree,
    local: LocalMap,
    p: EgoParams,
    w: Weights,
    actions: Floats,
    guide: Guide,
    node: int,
) -> None:
    """All children of a node; those that collide are marked and never visited."""
    root = kept_state(tree.where, tree.motion, node)
    for k in range(len(actions)):
        side = int(actions[k, 1])
        tree.child[node, k] = IMPOSSIBLE
        if (
            (side != 0 and not can_change(local, p, root, side))
            or tree.used[0] >= len(tree.parent)
            or tree.end[node] != ALIVE
        ):
            continue
        state = begin_change(local, p, root, side) if side != 0 else root
        state, cost, end = _ply(local, p, w, state, actions[k, 0], guide, tree.level[node] * w.ply)
        if side != 0:
            cost[3] += w.other * w.lane_change
            if end == ALIVE and not _can_finish(local, p, w, state, tree.level[node] + 1):
                end = LOST
        i = tree.used[0]
        tree.used[0] += 1
        tree.child[node, k], tree.parent[i], tree.level[i], tree.end[i] = (
            i,
            node,
            tree.level[node] + 1,
            end,
        )
        tree.cost[i] = tree.cost[node] + cost
        keep_state(tree.where, tree.motion, i, state)


@kernel
def _can_finish(local: LocalMap, p: EgoParams, w: Weights, state: State, level: int) -> bool:
    """Whether a lane change that began in the ply before can go on at this speed without contact;
    it may take longer than T_1."""
    for k in range(level * w.ply, (w.look_ahead + w.rollout) * w.ply):
        if state.progress <= 0.0:
            return True
        state, event = advance(local, p, state, 0.0, k * p.step)
        if event != FREE or (
            (k + 1) % w.check == 0 and _nearest(local, p, state, (k + 1) * p.step) <= 0.0
        ):
            return event == GOAL
    return True


@making_arrays
def _rollout(
    tree: PaperTree,
    local: LocalMap,
    p: EgoParams,
    w: Weights,
    guide: Guide,
    node: int,
    rng: Generator,
) -> float:
    """Algorithm 2: random longitudinal actions to the terminal state; the cost J of the whole
    sequence."""
    state, total = kept_state(tree.where, tree.motion, node), tree.cost[node].sum()
    if tree.end[node] == ARRIVED:
        return total
    for level in range(tree.level[node], w.look_ahead + w.rollout):
        draw = rng.random()
        accel = 0.0
        if draw < w.brake_probability:
            accel = -1.0 - 4.0 * rng.random()
        elif draw < w.brake_probability + w.accelerate_probability:
            accel = 1.0 + 2.0 * rng.random()
        state, cost, end = _ply(local, p, w, state, accel, guide, level * w.ply)
        total += cost.sum()
        if end == LOST:
            return total + w.safety * w.contact
        if end == ARRIVED:
            return total
    return total


@making_arrays
def _ply(
    local: LocalMap, p: EgoParams, w: Weights, state: State, accel: float, guide: Guide, at: int
) -> tuple[State, Floats, int]:
    """One step of T_1: the state after it, its four weighted costs, and how it ended.

    Costs are counted at its end, as the sum of equation 1 is.
    """
    began, end = state, ALIVE
    cost = np.zeros(4)
    for k in range(w.ply):
        state, event = advance(local, p, state, accel, (at + k) * p.step)
        if event in (RED_LINE, OFF_END):
            return state, cost, LOST
        if event == GOAL:
            end = ARRIVED
            break
        if (at + k + 1) % w.check == 0 and _nearest(local, p, state, (at + k + 1) * p.step) <= 0.0:
            return state, cost, LOST
    if (
        end == ALIVE
        # neither traffic nor way is left beyond the end of the route; how the ego drove there
        # counts
    ):
        distance = _nearest(local, p, state, (at + w.ply) * p.step)
        if distance <= w.threshold:
            cost[0] = w.safety / max(distance, 0.1)
        remaining = max(0.0, guide.goal - local.node[state.node, STATION] - state.s) + _aside(
            guide, state
        )
        cost[2] = w.passability * (
            w.goal_factor * remaining
            + (w.junction_penalty if _junction_ahead(local, state, guide.goal) else 0.0)
        )
    jerk = (state.a - began.a) / (w.ply * p.step)
    cost[1] = w.comfort * w.jerk_factor * jerk * jerk
    emergency = w.emergency if accel < -p.comfort_decel else 0.0
    cost[3] = w.other * (
        (w.stop if state.v < STANDING else 0.0)
        + (w.turn if guide.turns[state.node] else 0.0)
        + emergency
    )
    return state, cost, end


@kernel
def _nearest(local: LocalMap, p: EgoParams, state: State, time: float) -> float:
    """Distance between the boxes of the ego and of the nearest agent, m; 0 at contact."""
    x, y, c, s = pose_of(local, p, state)
    now = min(index_at(local, time), local.agent.shape[0] - 1)
    nearest = math.inf
    for i in range(local.agent.shape[1]):
        if (
            local.agent[now, i, NODE] == GONE
            or follows(local, local.followers, i)
            or apart(local, state.node, state.s, 2.0 * p.half_length, now, i)
        ):
            continue
        bx, by, bc, bs = (
            local.agent[now, i, X],
            local.agent[now, i, Y],
            local.agent[now, i, COS],
            local.agent[now, i, SIN],
        )
        if abs(bx - x) < 40.0 and abs(by - y) < 40.0:
            length, width = local.trait[i, HALF_LENGTH], local.trait[i, HALF_WIDTH]
            nearest = min(
                nearest,
                box_distance(
                    Box(x, y, c, s, p.half_length, p.half_width), Box(bx, by, bc, bs, length, width)
                ),
            )
    return nearest


@kernel
def _aside(guide: Guide, state: State) -> float:
    """m that lane changes add to the local goal's distance; the one under way counts as far as it
    is not done."""
    here = guide.aside[state.node]
    if state.progress <= 0.0 or state.other < 0:
        return float(here)
    return float(here + towards_other(state) * (guide.aside[state.other] - here))


@kernel
def _junction_ahead(local: LocalMap, state: State, goal: float) -> bool:
    """Whether a junction lies between the state and the local goal."""
    node, distance = state.node, goal - local.node[state.node, STATION]
    while node >= 0 and distance > 0.0:
        if local.node[node, INTERNAL] > 0.0:
            return True
        distance -= local.node[node, LENGTH]
        node = int(local.node[node, NEXT])
    return False
