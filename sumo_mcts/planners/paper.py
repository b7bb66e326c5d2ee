"""The paper's planner. paper_search.py has its algorithms.

Which reading was chosen where the text leaves it open: docs/planner.md.
"""

import math
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from sumo_mcts.arrays import Floats
from sumo_mcts.config import ScenarioConfig
from sumo_mcts.model.caps import SPACING
from sumo_mcts.model.local_map import LocalMap, State
from sumo_mcts.model.motion import GOAL, advance, begin_change, pose_of
from sumo_mcts.model.route import RouteMap
from sumo_mcts.numerics.geometry import X, Y
from sumo_mcts.planners.actions import ACCEL, SIDE
from sumo_mcts.planners.base import SeededPlanner, Situation, Task, local_of
from sumo_mcts.planners.budget import SLICE, passes_within
from sumo_mcts.planners.paper_cost import Guide, Weights
from sumo_mcts.planners.paper_search import PaperTree, bound, new_tree, search
from sumo_mcts.planners.ply import LOST
from sumo_mcts.road import LEFT, RIGHT
from sumo_mcts.scene import Decision, Follow, Plan, RootChild

EMERGENCY = -8.0  # m/s2, when every action was discarded
LOOK_SLICE = 20  # iterations between looks at the clock, and at what would be decided


def forecast_s(scenario: ScenarioConfig, step: float, forecast_step: float) -> float:
    """How long a forecast the search needs, s.

    `step`: of the simulation, `forecast_step`: between the states of the forecast, s.
    """
    p = scenario.paper
    return (p.look_ahead_steps + p.rollout_steps) * max(p.step_s, step) + forecast_step


def make(_: Mapping[str, Any], scenario: ScenarioConfig) -> "PaperPlanner":
    """The planner of a scenario."""
    return PaperPlanner(scenario)


class PaperPlanner(SeededPlanner):
    """Monte-Carlo tree search as the paper prints it."""

    def __init__(self, scenario: ScenarioConfig) -> None:
        self._scenario, self._actions = scenario, actions_of(scenario)

    def plan(self, situation: Situation) -> Decision:
        """Search from the present state; emergency braking when every child was discarded."""
        task, p = self._task, self._scenario.paper
        local, weights = local_of(task, situation), weights_of(self._scenario, task.ego.step)
        left = situation.until - time.perf_counter()
        most, actions = passes_within(self._scenario.planner.iterations, left), len(self._actions)
        tree = new_tree(min(most, full_size(actions, p.look_ahead_steps)) * actions + 2, actions)
        done = self._search(tree, local, weights, situation, most)
        return self._decision(tree, local, weights, situation, done)

    def _search(
        self, tree: PaperTree, local: LocalMap, weights: Weights, situation: Situation, most: int
    ) -> int:
        """Grow the tree until one of the criteria of termination holds. Returns the iterations."""
        task, p, state = self._task, self._scenario.paper, situation.state
        guide = guide_of(task, state, p.goal_distance_m, p.lane_distance_m)
        patience = math.inf if p.settled_after is None else p.settled_after
        at_once = SLICE if math.isinf(situation.until) and math.isinf(patience) else LOOK_SLICE
        done, settled, best = 0, 0, -1
        while done < most and settled < patience:
            if done > 0 and time.perf_counter() >= situation.until:
                break
            count = min(at_once, most - done)
            search(tree, local, task.ego, weights, self._actions, state, guide, count, self._rng)
            done, before, best = done + count, best, _best(tree, weights, p.choice)
            settled = settled + count if best == before else 0
        return done

    def _decision(
        self, tree: PaperTree, local: LocalMap, weights: Weights, situation: Situation, done: int
    ) -> Decision:
        """The root's child of lowest mean cost C/n, or by the other reading of highest UCB."""
        children: list[RootChild] = []
        plans, chosen = [], 0
        preferred = _best(tree, weights, self._scenario.paper.choice)
        for k, action in enumerate(self._actions):
            i = int(tree.child[0, k])
            if i < 0 or tree.end[i] == LOST or tree.visits[i] == 0:
                continue
            plan = _drive(local, self._task, weights, situation.state, action)
            mean = float(tree.total[i] / tree.visits[i])
            chosen = len(children) if k == preferred else chosen
            children.append(
                RootChild(
                    accel=float(action[ACCEL]),
                    lane_change=int(action[SIDE]),
                    visits=int(tree.visits[i]),
                    mean=mean,
                    best=mean,
                    terms=np.concatenate([tree.cost[i], [0.0]]),
                    poses=plan.pose,
                )
            )
            plans.append(plan)
        if not children:
            plan = _drive(local, self._task, weights, situation.state, np.array([EMERGENCY, 0.0]))
            return Decision(Follow(plan.v, 0), plan, (), -1, "brake", done, 0)
        command = Follow(plans[chosen].v, children[chosen].lane_change)
        return Decision(command, plans[chosen], tuple(children), chosen, "search", done, 0)


def _best(tree: PaperTree, weights: Weights, choice: str) -> int:
    """The root's child to take, as a number of an action; -1: none has a visit."""
    worth = [
        -math.inf
        if i < 0 or tree.end[i] == LOST or tree.visits[i] == 0
        else bound(tree, weights, 0, i)
        if choice == "ucb"
        else -tree.total[i] / tree.visits[i]
        for i in tree.child[0]
    ]
    return -1 if math.isinf(max(worth)) else int(np.argmax(worth))


def actions_of(scenario: ScenarioConfig) -> Floats:
    """[A, 2] ACCEL, SIDE: the actions of each node, in their order."""
    p = scenario.paper
    keep = [(a, 0.0) for a in p.accelerations_mps2]
    change = [(a, side) for side in (1.0, -1.0) for a in p.lane_change_accelerations_mps2]
    return np.array(keep + change)


def full_size(actions: int, levels: int) -> int:
    """Nodes of the whole tree: more are never expanded."""
    return sum(actions**k for k in range(levels + 1))


def weights_of(scenario: ScenarioConfig, step: float) -> Weights:
    """What the compiled code reads of the scenario, with times in steps (s) of the simulation."""
    p = scenario.paper
    return Weights(
        ply=max(1, round(p.step_s / step)),
        check=max(1, round(scenario.planner.check_s / step)),
        look_ahead=p.look_ahead_steps,
        rollout=p.rollout_steps,
        skips=p.collided == "skip",
        by_root=p.visits_of == "root",
        dead_end_free=p.dead_end == "free",
        last_alone=p.counted == "last",
        aligned=p.contact_boxes == "aligned",
        exploration=p.exploration,
        brake_probability=p.brake_probability,
        accelerate_probability=p.accelerate_probability,
        safety=p.weight_safety,
        comfort=p.weight_comfort,
        passability=p.weight_passability,
        other=p.weight_other,
        threshold=p.safety_threshold_m,
        highway_threshold=p.highway_threshold_m or p.safety_threshold_m,
        closing=p.closing_speed_mps or math.inf,
        contact=p.contact_cost,
        jerk_factor=p.jerk_factor,
        lateral_factor=p.lateral_factor,
        goal_factor=p.goal_factor,
        straight=p.goal_along == "line",
        junction_penalty=p.junction_penalty,
        lane_change=p.lane_change_cost,
        bypass=p.bypass_cost,
        stop=p.stop_cost,
        stop_sign=p.stop_sign_cost,
        turn=p.turn_cost,
        emergency=p.emergency_cost,
    )


def guide_of(task: Task, state: State, distance: float, lane_distance: float) -> Guide:
    """The local goal: so many metres down the route, on a lane that does not leave it."""
    route = task.route
    turns = route.internal & np.isin(task.road.direction[route.lane], (LEFT, RIGHT))
    # the changes that the next edge needs must be no reason not to enter it
    here = (route.leg == route.leg[state.node]) & ~route.internal
    return Guide(
        float(route.station[state.node] + state.s + distance),
        *_place(route, state.node, state.s + distance),
        np.where(here, np.abs(route.changes) * lane_distance, 0.0),
        turns,
        route.sign,
    )


def _place(route: RouteMap, node: int, s: float) -> tuple[float, float]:
    """Where the middle of a box on the route is with its front at s (m) of a node or, beyond its
    end, on those that follow; at most at the end of the last."""
    while s > route.length[node] and route.next[node] >= 0:
        s -= float(route.length[node])
        node = int(route.next[node])
    row = int(route.row[node]) + min(int(s / SPACING), int(np.diff(route.row)[node]) - 1)
    return float(route.pose[row, X]), float(route.pose[row, Y])


def _drive(local: LocalMap, task: Task, w: Weights, state: State, action: Floats) -> Plan:
    """The first action [2] ACCEL, SIDE, step by step."""
    side = int(action[SIDE])
    state = begin_change(local, task.ego, state, side) if side != 0 else state
    v, lane, s, pose = [], [], [], []
    for k in range(w.ply):
        state, event = advance(local, task.ego, state, float(action[ACCEL]), k * task.ego.step)
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
