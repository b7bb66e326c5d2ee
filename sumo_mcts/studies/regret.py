"""How near planners come to the optimum of the reference problem: every planner is asked in states
that are taken from episodes."""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.config import PLANNER_GROUP, ScenarioConfig, is_plugin
from sumo_mcts.driver.driver import Driver
from sumo_mcts.driver.factories import make_planner
from sumo_mcts.episode import run_episode
from sumo_mcts.episode.loop import Loop
from sumo_mcts.errors import ConfigError
from sumo_mcts.planners.base import Situation, Task
from sumo_mcts.planners.paper import actions_of
from sumo_mcts.planners.paper_optimum import Own, draws, optimum, taken
from sumo_mcts.planners.reference import (
    CELL,
    ENDS_S,
    LABELS,
    NEWEST,
    VERSIONS,
    problem_of,
    profile_line,
    root_lines,
    scale,
)
from sumo_mcts.planners.reference_solver import Solution, best_root, solve
from sumo_mcts.prediction.hypotheses import likeliest
from sumo_mcts.records.statistics import wilson
from sumo_mcts.registry import PLANNERS, searches
from sumo_mcts.scene import Decision, Follow, Scene
from sumo_mcts.world.arguments import without_outputs

# planners whose single decisions can be judged: those that drive, first those that read a forecast
ASKED = tuple(
    row.name
    for row in sorted(PLANNERS.values(), key=lambda row: not row.reads_forecast)
    if row.drives
)
SHARE = 0.05  # near-optimal: regret up to this share of the spread, or
OWN = "paper"  # the planner that may be judged by its own J too
SMALL = 0.1  # up to this share of the scale, where the spread is smaller than the scale
MOST = 200_000  # sequences of J's whole tree and its rollouts: seconds for each state
# the reference has converged if it comes to the same with so many times the labels,
FACTOR = 100
FINER = 10  # and with so many times the labels in cells half as wide
Row = dict[str, Any]
Ask = Callable[[Task, Situation, int], list[Row]]  # with a seed


class Yardstick(NamedTuple):
    """What decisions in one state are measured against. Costs in units of the reference."""

    optimum: float  # of the actions that can begin there; free of losses if any is
    # between the best and the worst action without a loss; 0 where every action ends in one
    spread: float
    scale: float
    avoidable: bool  # some action is free of losses
    contested: bool  # the actions differ by more than the scale, or one of them ends in a loss


class Asked(NamedTuple):
    """What is asked in every state."""

    planners: tuple[str, ...]
    iterations: tuple[int, ...]  # each of them, where a planner searches
    converged: bool = False  # ask no planner, but whether the reference has converged
    reference: str = NEWEST  # which of reference.VERSIONS
    own: bool = False  # judge planner `paper` by the optimum of its own J too


# --- states of an episode ---


class Harvest(NamedTuple):
    """The answers in the cycles of an episode."""

    states: tuple[list[Row], ...]  # the answers in each state
    outcomes: Counter[str]  # of the egos
    problems: tuple[str, ...]  # a line for each ego with outcome `error`


def harvest(
    config: ScenarioConfig, seed: int | None, asked: Asked, every: int, first: int, most: int
) -> Harvest:
    """Drive an episode and ask in every `every`-th cycle of each ego, in at most `most` states.

    `first` moves these cycles. Raises ConfigError.
    """
    panel = None if asked.converged else Panel(config, asked)
    ask = partial(both_budgets, asked.reference) if panel is None else panel.ask
    gathering = _Gathering(ask, every, first, most)
    rows = run_episode(
        config, seed, sumo_options=without_outputs(config.sumo), watch=gathering.watch
    ).rows
    where = {
        "reference": asked.reference,
        "scenario": config.name,
        "prediction": config.prediction.name,
        "seed": seed,
    }
    states = tuple([{**where, **row} for row in state] for state in gathering.states)
    problems = tuple(
        f"{row['scenario']}: ego {row['ego']}: {row['error']}"
        for row in rows
        if row["outcome"] == "error"
    )
    return Harvest(states, Counter(row["outcome"] for row in rows), problems)


class _Gathering:
    """The answers of an episode so far."""

    def __init__(self, ask: Ask, every: int, first: int, most: int) -> None:
        self._ask, self._every, self._first, self._most = ask, every, first, most
        self._cycles = Counter[str]()
        self.states: list[list[Row]] = []

    def watch(self, loop: Loop, drivers: Mapping[str, Driver], scenes: Mapping[str, Scene]) -> None:
        """A cycle of the egos in `scenes`."""
        for ego, scene in scenes.items():
            question = drivers[ego].question
            self._cycles[ego] += 1
            if (
                (self._cycles[ego] + self._first) % self._every
                or question is None
                or len(self.states) >= self._most
            ):
                continue
            try:
                answers = self._ask(*question, len(self.states))
            except Exception as error:  # as with planners: an outcome, not the end of a batch
                loop.fail(ego, f"{type(error).__name__}: {error}")
                continue
            self.states.append([{"ego": ego, "time_s": scene.time, **row} for row in answers])


def check(config: ScenarioConfig, asked: Asked) -> None:
    """Raise ConfigError where the reference cannot be asked in this scenario, or a planner."""
    p = config.planner
    if (p.look_ahead_steps + p.rollout_steps) * p.step_s < ENDS_S[-1] - 1e-9:
        raise ConfigError(
            "planner.look_ahead_steps: with planner.rollout_steps and planner.step_s a forecast "
            f"of {(p.look_ahead_steps + p.rollout_steps) * p.step_s:g} s; "
            f"the reference problem needs {ENDS_S[-1]:g} s or more"
        )
    if asked.reference not in VERSIONS:
        raise ConfigError(
            f"--reference: {asked.reference}: no version of the reference problem; "
            f"allowed: {', '.join(VERSIONS)}"
        )
    if asked.own and (count := sequences(config)) > MOST:
        raise ConfigError(
            "--judge: paper: with paper.look_ahead_steps, paper.rollout_steps and the actions of "
            f"this scenario J has {count} sequences; at most {MOST} are driven in each state"
        )
    if not asked.converged:
        Panel(config, asked)


def sequences(config: ScenarioConfig) -> int:
    """How many sequences of actions and drawn movements the optimum of J is found among, at most:
    where every child was discarded, movements are drawn instead."""
    p = config.paper
    drawn = len(draws(p.brake_probability, p.accelerate_probability)[0])
    tree = max(len(actions_of(config)), drawn) ** p.look_ahead_steps
    return int(tree * drawn**p.rollout_steps)


# --- planners ---


class Panel:
    """The planners that are asked: each in every state again, as if it had just taken over the
    ego."""

    def __init__(self, config: ScenarioConfig, asked: Asked) -> None:
        """Planners that search are asked with each number of iterations.

        Raises ConfigError for a planner that cannot be asked.
        """
        unknown = [
            name
            for name in asked.planners
            if name not in ASKED and not is_plugin(name, PLANNER_GROUP)
        ]
        if unknown:
            raise ConfigError(
                f"--planners: {unknown[0]}: not one that can be asked for a single decision; "
                f"allowed: {', '.join(ASKED)}, plugins"
            )
        self._asked = list(
            dict.fromkeys(
                (name, n)
                for name in asked.planners
                for n in (asked.iterations if searches(name) else (None,))
            )
        )
        self._reference, self._own, self._config = asked.reference, asked.own, config
        self._planners = [make_planner(_with_planner(config, name, n)) for name, n in self._asked]

    def ask(self, task: Task, situation: Situation, seed: int) -> list[Row]:
        """A row for each planner and number of iterations, in the likeliest hypothesis alone: the
        reference problem has one."""
        situation = situation._replace(forecast=likeliest(situation.forecast), until=math.inf)
        problem = problem_of(task, situation, self._reference)
        roots = root_lines(problem)
        lines, decisions = [], list[Decision]()
        for planner in self._planners:
            planner.start(task, seed)
            decisions.append(planner.plan(situation))
            command = decisions[-1].command
            assert isinstance(command, Follow), "a planner that is asked drives"
            lines.append(profile_line(problem, command))
        solution = solve(problem, np.concatenate([roots, lines]))
        here = yardstick(solution, len(roots), scale(problem.task))
        rows: list[Row] = [
            {"planner": name, "iterations": n, **judged(here, solution, len(roots) + i)}
            for i, (name, n) in enumerate(self._asked)
        ]
        if self._own:
            own = optimum(self._config, task, situation)
            for row, decision in zip(rows, decisions, strict=True):
                action = taken(self._config, decision) if row["planner"] == OWN else -1
                row.update(judged_by_own(own, action))
        return rows


def _with_planner(config: ScenarioConfig, name: str, iterations: int | None) -> ScenarioConfig:
    planner = {
        "name": name,
        "time_budget_ms": None,
        "most_iterations": None,
        **({} if iterations is None else {"iterations": iterations}),
    }
    return config.model_copy(update={"planner": config.planner.model_copy(update=planner)})


def yardstick(solution: Solution, roots: int, unit: float) -> Yardstick:
    """The yardstick of a state, whose actions are the first `roots` beginnings of the solution."""
    value, collides = solution.value[:roots], solution.collides[:roots]
    free = value[~collides]
    spread = float(np.ptp(free)) if len(free) else 0.0
    contested = bool(np.ptp(value) > unit or collides.any())
    return Yardstick(
        float(value[best_root(solution, roots)]), spread, unit, len(free) > 0, contested
    )


def judged(here: Yardstick, solution: Solution, i: int) -> Row:
    """The i-th beginning of the solution against the optimum, in units of the scale.

    Regret is below 0 where a speed profile is better than all actions.
    """
    regret = float(solution.value[i]) - here.optimum
    allowed = SHARE * here.spread if here.spread >= here.scale else SMALL * here.scale
    collides = bool(solution.collides[i]) and here.avoidable
    return {
        "regret": regret / here.scale,
        "near_optimal": regret <= allowed and not collides,
        "collides": collides,
        "contested": here.contested,
        "avoidable": here.avoidable,
        "optimum": here.optimum / here.scale,
        "spread": here.spread / here.scale,
    }


def judged_by_own(own: Own, action: int) -> Row:
    """An action against the optimum of J, in units of its own scale; None where there is none to
    judge (-1), since another planner decided or every action was discarded."""
    if action < 0:
        return {"own_regret": None, "own_near_optimal": None}
    regret = float(own.value[action] - own.value.min()) / own.scale
    return {"own_regret": regret, "own_near_optimal": regret <= SMALL}


def ranking(rows: Sequence[Row]) -> list[Row]:
    """A row for each planner and number of iterations, over all states and over the contested
    ones."""
    groups: dict[tuple[str, int | None], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["planner"], row["iterations"]), []).append(row)
    return [
        {
            "planner": name,
            "iterations": n,
            "all": _statistics(those),
            "contested": _statistics([row for row in those if row["contested"]]),
            **_by_own(those),
        }
        for (name, n), those in groups.items()
    ]


def _by_own(rows: Sequence[Row]) -> Row:
    """The same by the optimum of J, where that was asked for."""
    judged = [row for row in rows if row.get("own_regret") is not None]
    if not judged:
        return {}
    regret, near = [row["own_regret"] for row in judged], sum(r["own_near_optimal"] for r in judged)
    return {
        "own": {
            "states": len(judged),
            "near_optimal": near,
            "wilson": wilson(near, len(judged)),
            "mean_regret": float(np.mean(regret)),
            "p95_regret": float(np.percentile(regret, 95)),
        }
    }


def _statistics(rows: Sequence[Row]) -> Row:
    """Counts and regrets, in units of the scale; a profile that is better than all actions has no
    regret."""
    regret = np.maximum([row["regret"] for row in rows], 0.0)
    near = sum(row["near_optimal"] for row in rows)
    return {
        "states": len(rows),
        "near_optimal": near,
        "wilson": wilson(near, len(rows)),
        "mean_regret": float(regret.mean()) if len(rows) else None,
        "p95_regret": float(np.percentile(regret, 95)) if len(rows) else None,
        "collides": sum(row["collides"] for row in rows),
        "avoidable": sum(row["avoidable"] for row in rows),
    }


# --- whether the reference has converged ---


def both_budgets(reference: str, task: Task, situation: Situation, _: int) -> list[Row]:
    """A row for each action that can begin here. It holds the cost with the usual budget of labels,
    and the lower cost of two far larger budgets (FACTOR; FINER)."""
    problem = problem_of(task, situation, reference)
    lines = root_lines(problem)
    usual, finer = (
        solve(problem, lines),
        solve(problem, lines, FINER * LABELS, tuple(0.5 * width for width in CELL)),
    )
    more = cheaper(solve(problem, lines, FACTOR * LABELS), finer)
    unit, best, chosen = scale(problem.task), best_root(more), best_root(usual)
    return [
        {
            "value": float(usual.value[i]) / unit,
            "converged": float(more.value[i]) / unit,
            "regret": float(more.value[i] - more.value[best]) / unit,
            "collides": bool(usual.collides[i]),
            "collides_converged": bool(more.collides[i]),
            "best": i == best,
            "chosen": i == chosen,
        }
        for i in range(len(lines))
    ]


def cheaper(one: Solution, other: Solution) -> Solution:
    """The better of two solutions for each beginning: each value is the cost of a trajectory that
    was found."""
    first = (one.collides < other.collides) | (
        (one.collides == other.collides) & (one.value <= other.value)
    )
    return Solution(
        np.where(first, one.value, other.value),
        one.collides & other.collides,
        np.where(first[:, None, None], one.best, other.best),
        one.driven + other.driven,
    )


def convergence(rows: Sequence[Row]) -> dict[str, Any]:
    """The errors of the usual budget, in units of the scale: of the costs of all actions, of the
    costs of the optimum, and the excess cost of the preferred action over the optimum."""
    same = [row for row in rows if row["collides"] == row["collides_converged"]]
    return {
        "actions": _sizes([row["value"] - row["converged"] for row in same]),
        "optimum": _sizes([row["value"] - row["converged"] for row in same if row["best"]]),
        "choice": _sizes([row["regret"] for row in rows if row["chosen"]]),
        "other_outcome": len(rows) - len(same),
    }


def _sizes(differences: Sequence[float]) -> Row:
    off = np.abs(differences)
    if not len(off):
        return {"count": 0, "mean": None, "p99": None, "max": None}
    return {
        "count": len(off),
        "mean": float(off.mean()),
        "p99": float(np.percentile(off, 99)),
        "max": float(off.max()),
    }
