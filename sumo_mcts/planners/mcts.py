"""The planner that people should use:

UCT on a deterministic forecast, best-value backup, informed rollouts, braking when nothing is free.
"""

import math
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.config import ScenarioConfig
from sumo_mcts.model.local_map import LocalMap, State
from sumo_mcts.model.motion import FOLLOW
from sumo_mcts.model.reactions import at_rest
from sumo_mcts.planners.base import Drawing, Situation, Task, local_of
from sumo_mcts.planners.budget import Effort, budget, next_passes, next_passes_in_time, part
from sumo_mcts.planners.risk import risk, shares
from sumo_mcts.planners.rollout import (
    ALIVE,
    ARRIVED,
    LOST,
    SearchParams,
    entry_of,
    replay,
    search_params,
    side_of,
)
from sumo_mcts.planners.tree import Tree, new_tree, search
from sumo_mcts.scene import Decision, Floats, Follow, Plan, PlannerMemory, RootChild


class MctsParams(NamedTuple):
    """See config.PlannerConfig."""

    effort: Effort
    period_s: float
    step_s: float
    look_ahead_steps: int
    rollout_steps: int
    check_s: float
    accelerations: tuple[float, ...]
    lane_change_accelerations: tuple[float, ...]
    later_accelerations: tuple[float, ...]
    later_lane_change_accelerations: tuple[float, ...]
    exploration: float
    reactive: int
    worst_share: float  # of what may happen, whose mean cost counts; 1: the expected cost
    adaptive: bool


def mcts_params(scenario: ScenarioConfig) -> MctsParams:
    """The search as the section `planner` describes it."""
    p = scenario.planner
    return MctsParams(
        effort=Effort(p.iterations, max(p.iterations, p.most_iterations or 0), p.close_cost),
        period_s=p.period_s,
        step_s=p.step_s,
        look_ahead_steps=p.look_ahead_steps,
        rollout_steps=p.rollout_steps,
        check_s=p.check_s,
        accelerations=p.accelerations_mps2,
        lane_change_accelerations=p.lane_change_accelerations_mps2,
        later_accelerations=p.later_accelerations_mps2,
        later_lane_change_accelerations=p.later_lane_change_accelerations_mps2,
        exploration=p.exploration,
        reactive=p.reactive,
        worst_share=p.cvar_alpha if p.risk == "cvar" else 1.0,
        adaptive=p.adaptive,
    )


def horizon_s(scenario: ScenarioConfig, step: float, forecast_step: float) -> float:
    """How far the section `planner` looks into a forecast, s;

    `step`: of the simulation, `forecast_step`: between the states of the forecast, s.
    """
    p = scenario.planner
    ply = max(1, round(p.step_s / step)) * step
    return (p.look_ahead_steps + p.rollout_steps) * ply + scenario.cost.claim_s + forecast_step


def make(_: Mapping[str, Any], scenario: ScenarioConfig) -> "MctsPlanner":
    """The planner of a scenario."""
    return MctsPlanner(mcts_params(scenario))


class Way(NamedTuple):
    """A root child and the best that is known to follow it."""

    child: RootChild
    plan: Plan
    line: Floats  # [steps] entries (see tree.entry_of)


class MctsPlanner(Drawing):
    """Monte-Carlo tree search over the forecast."""

    weighs_hypotheses = True

    def __init__(self, params: MctsParams) -> None:
        self._params = params
        self._actions = actions_of(params)

    def start(self, task: Task, seed: int) -> None:
        """Take the ego over."""
        super().start(task, seed)
        self._line, self._line_time = np.zeros(0), 0.0

    def memory(self) -> PlannerMemory:
        """The last sequence, after when it began."""
        return super().memory()._replace(numbers=np.array([self._line_time, *self._line]))

    def recall(self, memory: PlannerMemory) -> None:
        """Go on from there."""
        super().recall(memory)
        self._line_time, self._line = float(memory.numbers[0]), memory.numbers[1:]

    def plan(self, situation: Situation) -> Decision:
        """Search from the present state; where the last plan, carried on, is no worse than what was
        found, it goes on."""
        p, task = self._params, self._task
        local = local_of(task, situation, p.reactive)
        share = shares(situation.forecast.weight, p.effort.iterations, len(self._actions))
        q = in_steps(p, task.ego.step, local.dt)._replace(each=len(share) > 1)
        others = at_rest(local, p.reactive)
        carried = _carried(
            local,
            task,
            q,
            situation.state,
            others,
            self._remaining(situation.scene.time, round(q.horizon / task.ego.step)),
            p.period_s,
        )
        tree, done, known = self._search(
            local, q, situation, share, math.inf if carried is None else carried.child.best
        )
        found = _children(tree, local, task, q, self._actions, situation.state, others)
        found += [carried] if carried is not None else []
        if len(share) > 1:
            found, *more = self._weighed(situation, q, found, share)
            done, known = done + more[0], known + more[1]
        chosen = min(range(len(found)), key=lambda i: (found[i].child.best, -i))
        likely = found[chosen].child
        lost = (
            likely.terms[4] > 0.0 and likely.best >= 0.5 * task.cost.contact
        )  # what a contact costs at least
        if lost:  # nothing is free: what counts is how bad the contact is
            chosen = min(
                range(len(found)),
                key=lambda i: (float(found[i].child.terms[4]), found[i].child.best),
            )
        child, plan, line = found[chosen]
        self._line, self._line_time = (
            line if child.terms[4] == 0.0 else np.zeros(0),
            situation.scene.time,
        )
        reason = (
            "brake"
            if lost
            else "carried on"
            if carried is not None and chosen == len(found) - 1
            else "search"
        )
        return Decision(
            Follow(plan.v, child.lane_change),
            plan,
            tuple(way.child for way in found),
            chosen,
            reason,
            done,
            known,
        )

    def _weighed(
        self, situation: Situation, q: SearchParams, found: list[Way], share: Floats
    ) -> tuple[list[Way], int, int]:
        """The ways with the risk over all hypotheses as their cost; the others are searched here.

        And the passes that took.
        """
        p, task, state = self._params, self._task, situation.state
        cost, terms = np.empty((len(found), len(share))), np.empty((len(found), len(share), 5))
        cost[:, 0], terms[:, 0] = (
            [way.child.best for way in found],
            [way.child.terms for way in found],
        )
        done = known = 0
        for h in range(1, len(share)):
            local = local_of(task, situation, p.reactive, h)
            tree, *more = self._search(local, q, situation, share[h:], math.inf)
            done, known = done + more[0], known + more[1]
            for i, way in enumerate(found):
                cost[i, h], terms[i, h] = _cost_in(tree, local, task, q, self._actions, state, way)
        weight = situation.forecast.weight[: len(share)]
        worth = risk(cost, weight / weight.sum(), p.worst_share)
        children = [
            way.child._replace(best=float(value), hypotheses=each)
            for way, value, each in zip(found, worth, terms, strict=True)
        ]
        return (
            [way._replace(child=child) for way, child in zip(found, children, strict=True)],
            done,
            known,
        )

    def _search(
        self, local: LocalMap, q: SearchParams, situation: Situation, share: Floats, beat: float
    ) -> tuple[Tree, int, int]:
        """A tree with the first `share` of the effort, of those that are left; its passes to the
        horizon, and to a known terminal node.

        `beat`: the J of the last plan, carried on.
        """
        p, task, began = self._params, self._task, time.perf_counter()
        effort, until = (
            part(p.effort, share[0]),
            began + (situation.until - began) * share[0] / share.sum(),
        )
        size = 2 + budget(effort.most, until - began)
        tree = new_tree(
            size,
            len(self._actions),
            p.look_ahead_steps + p.rollout_steps,
            at_rest(local, p.reactive),
        )
        done = known = 0
        while count := _count(effort, tree, done + known, began, until):
            more = search(
                tree,
                local,
                task.ego,
                task.cost,
                q,
                self._actions,
                situation.state,
                count,
                beat,
                self._rng,
            )
            if more == (0, 0):  # nothing is left to try, or no room for it
                break
            done, known = done + more[0], known + more[1]
        return tree, done, known

    def _remaining(self, now: float, steps: int) -> Floats:
        """What is left of the last line, with car following up to `steps`; empty where there is
        none."""
        begin = round((now - self._line_time) / self._task.ego.step)
        left = self._line[begin : begin + steps]
        return (
            np.concatenate([left, np.full(steps - len(left), FOLLOW)])
            if 0 < begin < len(self._line)
            else np.zeros(0)
        )


def _count(effort: Effort, tree: Tree, made: int, began: float, until: float) -> int:
    """How many passes come next; no clock is asked unless there is a time budget."""
    if math.isinf(until):
        return next_passes(effort, tree, made)
    now = time.perf_counter()
    return next_passes_in_time(tree, made, now - began, until - now)


def in_steps(p: MctsParams, step: float, forecast_dt: float) -> SearchParams:
    """The search's times in steps of the simulation (`step` and `forecast_dt` in s)."""
    return search_params(
        step,
        forecast_dt,
        p.step_s,
        p.check_s,
        p.look_ahead_steps,
        p.rollout_steps,
        p.exploration,
        p.adaptive,
    )


def actions_of(p: MctsParams) -> Floats:
    """[A, 3] acceleration, lane change, and 1 where it is tried below the root too: car following
    first, then the others in the lane, then the changes."""
    keep = [
        (FOLLOW, 0.0, 1.0),
        *((a, 0.0, float(a in p.later_accelerations)) for a in p.accelerations),
    ]
    change = [
        (a, side, float(a in p.later_lane_change_accelerations))
        for side in (1.0, -1.0)
        for a in p.lane_change_accelerations
    ]
    return np.array(keep + change)


def _children(
    tree: Tree,
    local: LocalMap,
    task: Task,
    q: SearchParams,
    actions: Floats,
    state: State,
    others: Floats,
) -> list[Way]:
    """The root's children, each with the best way through it."""
    result = []
    for k in range(len(actions)):
        i = int(tree.child[0, k])
        if i < 0:
            continue
        line = _steps(tree.plan[k], actions[k], int(tree.end[i]), q.ply)
        plan, terms, _ = follow_line(local, task, q, state, others, line)
        accel = (
            float(actions[k, 0])
            if actions[k, 0] != FOLLOW
            else _first_accel(plan, state.v, q.ply * task.ego.step)
        )
        child = RootChild(
            accel,
            int(actions[k, 1]),
            int(tree.visits[i]),
            float(tree.total[i] / max(tree.visits[i], 1)),
            float(tree.best[i]),
            terms,
            plan.pose,
        )
        result.append(Way(child, plan, line))
    return result


def _cost_in(
    tree: Tree,
    local: LocalMap,
    task: Task,
    q: SearchParams,
    actions: Floats,
    state: State,
    way: Way,
) -> tuple[float, Floats]:
    """What a way costs in another hypothesis, of which the tree is: driven to its end, or else
    begun only and gone on with as is best there. And its terms.

    That is the best below the root's child that comes nearest to the way's first action, as if it
    were known by then what the others do (QMDP).
    """
    v = float(way.plan.v[min(q.ply, len(way.plan.v)) - 1])
    alike = [
        (k, i)
        for k, i in enumerate(tree.child[0])
        if i >= 0 and int(actions[k, 1]) == way.child.lane_change
    ]
    _, begun, k = min(
        ((abs(tree.motion[i, 1] - v), float(tree.best[i]), k) for k, i in alike),
        default=(0.0, task.cost.contact, -1),
    )
    _, terms, end = follow_line(local, task, q, state, tree.others[0], way.line)
    whole = end in (LOST, ARRIVED) or (
        end == ALIVE and len(way.line) >= round(q.horizon / task.ego.step)
    )
    if whole and terms.sum() <= begun:
        return float(terms.sum()), terms
    if k < 0:
        return begun, np.array([0.0, 0.0, 0.0, 0.0, begun])
    line = _steps(tree.plan[k], actions[k], int(tree.end[tree.child[0, k]]), q.ply)
    return begun, follow_line(local, task, q, state, tree.others[0], line)[1]


def _carried(
    local: LocalMap,
    task: Task,
    q: SearchParams,
    state: State,
    others: Floats,
    line: Floats,
    period_s: float,
) -> Way | None:
    """The last plan carried on, if that is possible without a contact.

    Its half-driven actions are none that the tree could try.
    """
    later = line[1 : round(period_s / task.ego.step)]
    if not len(line) or any(
        side_of(entry) for entry in later
    ):  # a lane change begins with a decision period or not at all
        return None
    plan, terms, end = follow_line(local, task, q, state, others, line)
    if end not in (ALIVE, ARRIVED):
        return None
    cost = float(terms.sum())
    return Way(
        RootChild(
            _first_accel(plan, state.v, q.ply * task.ego.step),
            side_of(line[0]),
            0,
            cost,
            cost,
            terms,
            plan.pose,
        ),
        plan,
        line,
    )


def _first_accel(plan: Plan, v: float, seconds: float) -> float:
    """Mean acceleration (m/s2) of a plan's first action: what car following came to."""
    steps = min(len(plan.v), int(np.searchsorted(plan.time, seconds - 1e-9)) + 1)
    return float((plan.v[steps - 1] - v) / plan.time[steps - 1]) if steps else 0.0


def _steps(line: Floats, action: Floats, end: int, ply: int) -> Floats:
    """A sequence of actions of the tree as one entry a simulation step; it certainly starts with
    its own action."""
    line = line.copy()
    line[0] = entry_of(action[0], action[1])
    line = line[
        : 1
        if end != ALIVE
        else len(line)
        if not np.isnan(line).any()
        else int(np.argmax(np.isnan(line)))
    ]
    steps = np.repeat([entry_of(entry, -side_of(entry)) for entry in line], ply)
    steps[::ply] = line
    return steps


def follow_line(
    local: LocalMap, task: Task, q: SearchParams, state: State, others: Floats, line: Floats
) -> tuple[Plan, Floats, int]:
    """The plan, step by step, the cost terms [5] of a sequence, and how it ends (see
    tree.replay)."""
    steps = len(line)
    nodes, motion, pose, terms = (
        np.zeros(steps, np.int64),
        np.zeros((steps, 2)),
        np.zeros((steps, 4)),
        np.zeros(5),
    )
    used, end = replay(
        local, task.ego, task.cost, q, state, others.copy(), line, nodes, motion, pose, terms
    )
    lanes = task.route.lane[nodes[:used]].astype(np.int32)
    times = (np.arange(used, dtype=np.float64) + 1.0) * task.ego.step
    return (
        Plan(times, motion[:used, 1].copy(), lanes, motion[:used, 0].copy(), pose[:used].copy()),
        terms,
        end,
    )
