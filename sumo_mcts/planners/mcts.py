"""The planner `mcts`, which is the one to use.

UCT on a deterministic forecast, best-value backup, informed rollouts, braking when nothing is free.
"""

import math
import time
from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats
from sumo_mcts.config import ScenarioConfig
from sumo_mcts.model.cost import LEAST_LOSS
from sumo_mcts.model.local_map import LocalMap
from sumo_mcts.model.reactions import undisturbed
from sumo_mcts.planners.actions import FOLLOW, lasting, lines_of, packed, unpacked
from sumo_mcts.planners.base import SeededPlanner, Situation, Task, locals_of
from sumo_mcts.planners.budget import Budget, next_passes, next_passes_in_time, part, passes_within
from sumo_mcts.planners.candidates import (
    Candidate,
    Start,
    asked_side,
    costs_in,
    not_for_a_stop,
    root_candidates,
    warm_start,
)
from sumo_mcts.planners.patience import patience, waited_s
from sumo_mcts.planners.ply import SearchParams, search_params
from sumo_mcts.planners.risk import risk, shares
from sumo_mcts.planners.search import search
from sumo_mcts.planners.threads import side_by_side
from sumo_mcts.planners.tree import GAP, Tree, new_tree
from sumo_mcts.scene import LOSS, Decision, Follow, PlannerMemory


class MctsParams(NamedTuple):
    """See config.PlannerConfig."""

    budget: Budget
    threads: int
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
    impatience: float  # 1/s, see patience.py
    asks: bool  # others for room where the route needs a lane change


class Searched(NamedTuple):
    """What a search in one hypothesis found."""

    tree: Tree
    done: int  # passes to the horizon
    known: int  # passes to a known terminal node


def mcts_params(scenario: ScenarioConfig) -> MctsParams:
    """The search as the section `planner` describes it."""
    p = scenario.planner
    return MctsParams(
        budget=Budget(p.iterations, max(p.iterations, p.most_iterations or 0), p.close_cost),
        threads=p.threads if p.adaptive else 1,  # what is drawn comes from one stream
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
        impatience=p.impatience,
        asks=scenario.ego_model.asks,
    )


def forecast_s(scenario: ScenarioConfig, step: float, forecast_step: float) -> float:
    """How long a forecast the section `planner` needs, s: the horizon, claim_s, and a step.

    `step`: of the simulation, `forecast_step`: between the states of the forecast, s.
    """
    p = scenario.planner
    ply = max(1, round(p.step_s / step)) * step
    return (p.look_ahead_steps + p.rollout_steps) * ply + scenario.cost.claim_s + forecast_step


def make(_: Mapping[str, Any], scenario: ScenarioConfig) -> "MctsPlanner":
    """The planner of a scenario."""
    return MctsPlanner(mcts_params(scenario))


class MctsPlanner(SeededPlanner):
    """Monte-Carlo tree search over the forecast."""

    weighs_hypotheses = True

    def __init__(self, params: MctsParams) -> None:
        self._params = params
        self._actions = actions_of(params)

    def start(self, task: Task, seed: int) -> None:
        """Take the ego over."""
        super().start(task, seed)
        self._last_line, self._last_time, self._waited_s = np.zeros(0), 0.0, 0.0

    def memory(self) -> PlannerMemory:
        """The last sequence, after the time (s) at which it began, and how long the ego has
        waited."""
        numbers = np.array([self._last_time, *self._last_line])
        return super().memory()._replace(numbers=numbers, waited_s=self._waited_s)

    def recall(self, memory: PlannerMemory) -> None:
        """Go on from there."""
        super().recall(memory)
        self._last_time, self._last_line = float(memory.numbers[0]), memory.numbers[1:]
        self._waited_s = memory.waited_s

    def plan(self, situation: Situation) -> Decision:
        """Search from the present state; where the warm start is no worse than what was found, it
        is chosen."""
        p, task, state = self._params, self._task, situation.state
        share = shares(situation.forecast.weight, p.budget.iterations, len(self._actions))
        local, *others = self._locals(situation, len(share))
        q = in_steps(p, task.ego.step, local.dt)._replace(each=len(share) > 1)
        start = Start(local, task, q, state, undisturbed(local))
        left = self._remaining(situation.scene.time, round(q.horizon / task.ego.step))
        warm = warm_start(start, left, p.period_s)
        beat = math.inf if warm is None else warm.child.best
        searched = self._searched([local, *others], q, situation, share, beat)
        tree = searched[0].tree
        found = root_candidates(start, tree, self._actions)
        found += [warm] if warm is not None else []
        if len(share) > 1:
            found = self._weighed(situation, q, found, others, searched[1:])
        chosen, lost = self._choice(found)
        if not lost:
            chosen = not_for_a_stop(start, found, chosen, situation.scene.ego.comfort_decel)
        child, plan, line = found[chosen]
        gap = float(tree.leader[0, GAP])
        self._waited_s = waited_s(self._waited_s, local, task.route, state, gap, p.period_s)
        self._last_time = situation.scene.time
        self._last_line = packed(line) if child.terms[LOSS] == 0.0 else np.zeros(0)
        warm_chosen = warm is not None and chosen == len(found) - 1
        reason = "brake" if lost else "carried on" if warm_chosen else "search"
        children = tuple(each.child for each in found)
        may_ask = p.asks and situation.scene.ego.can_ask and child.lane_change == 0
        asks = asked_side(start, line) if may_ask else 0
        command = Follow(plan.v, child.lane_change, asks)
        return Decision(
            command, plan, children, chosen, reason,
            sum(each.done for each in searched), sum(each.known for each in searched),
        )  # fmt: skip

    def _locals(self, situation: Situation, count: int) -> list[LocalMap]:
        """What the search reads in each of so many hypotheses; asked agents make room, and patience
        counts."""
        return locals_of(
            self._task,
            situation,
            count,
            reactive=self._params.reactive,
            asked=situation.scene.ego.asks,
            patience=patience(self._params.impatience, self._waited_s),
        )

    def _choice(self, found: list[Candidate]) -> tuple[int, bool]:
        """The candidate of lowest J, the last of equal ones; and whether nothing is free.

        Then what counts is how bad the contact is.
        """
        chosen = min(range(len(found)), key=lambda i: (found[i].child.best, -i))
        likely = found[chosen].child
        least = LEAST_LOSS * self._task.cost.contact
        lost = bool(likely.terms[LOSS] > 0.0 and likely.best >= least)
        if lost:
            chosen = min(
                range(len(found)),
                key=lambda i: (float(found[i].child.terms[LOSS]), found[i].child.best),
            )
        return chosen, lost

    def _weighed(
        self, situation: Situation, q: SearchParams, found: list[Candidate],
        others: list[LocalMap], searched: list[Searched],
    ) -> list[Candidate]:  # fmt: skip
        """The candidates with the risk over all hypotheses as their cost; `others` than the
        likeliest one, and what was `searched` in them."""
        p, task, state = self._params, self._task, situation.state
        count = 1 + len(others)
        cost, terms = np.empty((len(found), count)), np.empty((len(found), count, 5))
        cost[:, 0] = [candidate.child.best for candidate in found]
        terms[:, 0] = [candidate.child.terms for candidate in found]
        lines = lines_of([candidate.line for candidate in found])
        for h, (local, (tree, *_)) in enumerate(zip(others, searched, strict=True), start=1):
            start = Start(local, task, q, state, tree.others[0])
            cost[:, h], terms[:, h] = costs_in(start, tree, self._actions, found, lines)
        weight = situation.forecast.weight[:count]
        weighed = risk(cost, weight / weight.sum(), p.worst_share)
        children = [
            candidate.child._replace(best=float(value), hypotheses=each)
            for candidate, value, each in zip(found, weighed, terms, strict=True)
        ]
        pairs = zip(found, children, strict=True)
        return [candidate._replace(child=child) for candidate, child in pairs]

    def _searched(
        self, locals_: list[LocalMap], q: SearchParams, situation: Situation, share: Floats,
        beat: float,
    ) -> list[Searched]:  # fmt: skip
        """A tree in each hypothesis with its `share` [H] of the budget, side by side on several
        threads. `beat`: the J of the warm start, in the likeliest one."""
        tasks = [
            partial(self._search, local, q, situation, share[h:], beat if h == 0 else math.inf)
            for h, local in enumerate(locals_)
        ]
        return side_by_side(tasks, self._params.threads)

    def _search(
        self, local: LocalMap, q: SearchParams, situation: Situation, share: Floats, beat: float
    ) -> Searched:
        """A tree with `share[0]` of the budget; `share`: those of the hypotheses whose search has
        not begun yet."""
        p, task, began = self._params, self._task, time.perf_counter()
        budget = part(p.budget, share[0])
        of_time = min(p.threads * share[0] / share.sum(), 1.0)
        until = began + (situation.until - began) * of_time
        tree = new_tree(
            2 + passes_within(budget.most, until - began),
            len(self._actions),
            p.look_ahead_steps + p.rollout_steps,
            undisturbed(local),
        )
        done = known = 0
        while count := _count(budget, tree, done + known, began, until):
            more = search(
                tree, local, task.ego, task.cost, q, self._actions, situation.state, count, beat,
                self._rng,
            )  # fmt: skip
            if more == (0, 0):  # nothing is left to try, or the tree is full
                break
            done, known = done + more[0], known + more[1]
        return Searched(tree, done, known)

    def _remaining(self, now: float, steps: int) -> Floats:
        """[steps, 3] what is left of the last sequence, continued with car following; no rows where
        nothing is left."""
        begin = round((now - self._last_time) / self._task.ego.step)
        if not 0 < begin < len(self._last_line):
            return lasting(FOLLOW, 0, 0)
        left = unpacked(self._last_line[begin : begin + steps])
        return np.concatenate([left, lasting(FOLLOW, 0, steps - len(left))])


def _count(budget: Budget, tree: Tree, made: int, began: float, until: float) -> int:
    """How many passes come next; no clock is asked unless there is a time budget."""
    if math.isinf(until):
        return next_passes(budget, tree, made)
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
    """[A, 3] ACCEL, SIDE, LATER: car following first, then the others in the lane, then the
    changes."""
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
