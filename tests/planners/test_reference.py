"""The reference problem: against every sequence tried out in turn, with and without what makes its
solution quick, and the planner that drives by it."""

import functools
import json
import os
import subprocess
import sys
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest
from helpers import Agent, crossing, edges, ego_at
from helpers_model import lanes_east, road_with_light, scenario, scene_of, situation_of, task_of
from helpers_tree import TOYS, Toy, before_a_light, decide, on_three_lanes
from hypothesis import given, settings
from hypothesis import strategies as st

from sumo_mcts import config
from sumo_mcts.arrays import Floats
from sumo_mcts.config import builtin
from sumo_mcts.config.sections.cost import CostWeights
from sumo_mcts.episode.run import default_variant, run_episode
from sumo_mcts.model.local_map import SLOT
from sumo_mcts.planners import reference, reference_solver
from sumo_mcts.planners.actions import ACCEL, FOLLOW, NO_SPEED, SIDE, lasting
from sumo_mcts.planners.candidates import follow_line
from sumo_mcts.planners.ply import ALIVE, IMPOSSIBLE, LOST
from sumo_mcts.planners.reference import (
    NEWEST,
    VERSIONS,
    Problem,
    cost_of,
    digest,
    problem_of,
    profile_line,
    root_lines,
    scale,
    steps_of,
)
from sumo_mcts.planners.reference_solver import Rest, Solution, best_root, solve
from sumo_mcts.scene import GREEN, RED, Follow, Plan, Signals

NONE_YET = (np.nan,) * 3  # in place of the first ply, which is the beginning
FINE = (1e-9,) * 6  # cells that nobody shares
FEW = np.array([[FOLLOW, 0.0], [-3.0, 0.0], [0.0, 0.0], [2.6, 0.0], [0.0, 1.0], [0.0, -1.0]])


def problem_in(toy: Toy, *sets: str, version: str = NEWEST) -> Problem:
    task = task_of(toy.road, toy.scene.ego, scenario(*sets))
    return problem_of(task, situation_of(task, toy.scene), version)


def small(problem: Problem, plies: int = 3, actions: Floats = FEW) -> Problem:
    """The first plies and a few actions alone."""
    ends = problem.ends[:plies]
    roots = np.array(
        [
            action
            for action in actions
            if any(np.array_equal(action, root) for root in problem.roots)
        ]
    )
    return problem._replace(
        ends=ends,
        actions=actions,
        roots=roots,
        q=problem.q._replace(horizon=float(ends[-1]) * problem.task.ego.step),
    )


def driven(problem: Problem, steps: Floats) -> tuple[Plan, float, int]:
    """A sequence driven step by step: the plan, its cost and how it ends."""
    plan, terms, end = follow_line(
        problem.local, problem.task, problem.q, problem.state, problem.others, steps
    )
    return plan, float(terms.sum()), end


def by_hand(problem: Problem, line: Floats) -> tuple[float, bool]:
    """The lowest cost of all sequences that begin with `line`, and whether every one of them ends
    in a loss: each is driven."""
    tried = [(accel, side, NO_SPEED) for accel, side in problem.actions]
    found: dict[bool, float] = {}
    for later in product(tried, repeat=len(problem.ends) - 1):
        _, cost, end = driven(problem, steps_of(problem, line, np.array([NONE_YET, *later])))
        if end != IMPOSSIBLE:
            found[end == LOST] = min(cost, found.get(end == LOST, np.inf))
    return (found[False], False) if False in found else (found[True], True)


@functools.cache
def solved(name: str) -> tuple[Problem, Solution]:
    problem = problem_in(SCENES[name])
    return problem, solve(problem, root_lines(problem))


def yields() -> Toy:
    """The ego comes to a road that has priority, and cars on it."""
    road = crossing(bridge=False)
    ego = ego_at(road, "si_0", 60.0, 8.0, route=edges(road, "si", "no"))
    cars = [Agent(f"{k}", "wi_0", 85.0 - 25.0 * k, 10.0) for k in range(3)]
    return Toy(road, scene_of(ego, road, *cars))


SCENES = {
    **TOYS,
    "gap": on_three_lanes(
        None, Agent("ahead", "a_1", 118.0, 3.0), Agent("next", "a_2", 96.0, 12.0)
    ),
    "touching": on_three_lanes(None, *(Agent(f"w{k}", f"a_{k}", 109.0, 0.0) for k in range(3))),
    "green": before_a_light(GREEN, 15.0),
    **{
        # which of them are passed before they close depends on what is done in the first 1.5 s
        f"until {until:g} s": Toy(
            road_with_light(),
            scene_of(
                ego_at(
                    road_with_light(), "a_0", 150.0, 12.0, route=edges(road_with_light(), "a", "b")
                ),
                road_with_light(),
                signals=Signals(
                    np.array([0, 1], np.int32),
                    np.array([[GREEN, RED, GREEN]], np.int32),
                    np.array([[until, until + 20.0, np.inf]]),
                ),
            ),
        )
        for until in (3.5, 4.0)
    },
    "yields": yields(),
    "goal": Toy(
        road_with_light(after=10.0),
        scene_of(
            ego_at(road_with_light(), "a_0", 190.0, 14.0, route=edges(road_with_light(), "a")),
            road_with_light(),
        ),
    ),
}


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("toy", SCENES.values(), ids=SCENES)
def test_it_finds_what_trying_out_everything_finds(toy: Toy, version: str) -> None:
    problem = small(problem_in(toy, version=version))
    lines = root_lines(problem)
    found, rough = solve(problem, lines, 400, FINE), solve(problem, lines)
    for i, line in enumerate(lines):
        cost, lost = by_hand(problem, line)
        assert (found.value[i], found.collides[i]) == (pytest.approx(cost, abs=1e-9), lost)
        assert rough.collides[i] == lost and cost - 1e-9 <= rough.value[i] <= cost + 0.1 * scale(
            problem.task
        )


def test_a_wall_is_hit_whatever_is_done_and_a_gap_is_not() -> None:
    _, hit = solved("touching")
    _, free = solved("gap")
    assert hit.collides.all() and not free.collides[best_root(free)]


@pytest.mark.parametrize("toy", SCENES.values(), ids=SCENES)
def test_a_value_is_what_its_way_costs(toy: Toy) -> None:
    problem = problem_in(toy)
    lines = root_lines(problem)
    found = solve(problem, lines, 20)
    for i, line in enumerate(lines):
        _, cost, end = driven(problem, steps_of(problem, line, found.best[i]))
        assert cost == pytest.approx(found.value[i], abs=1e-6)
        assert (end == LOST) == found.collides[i]


@pytest.mark.parametrize("toy", SCENES.values(), ids=SCENES)
def test_pruning_loses_nothing(toy: Toy, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the bound and without it, on a problem small enough that no label is dropped."""
    problem = small(problem_in(toy), 4)
    lines = root_lines(problem)
    bounded = solve(problem, lines, 5000, FINE)
    monkeypatch.setattr(reference_solver, "_rest", lambda problem: Rest(np.inf, 1.0))
    unbounded = solve(problem, lines, 5000, FINE)
    assert bounded.value == pytest.approx(unbounded.value, abs=1e-9) and np.array_equal(
        bounded.collides, unbounded.collides
    )
    assert bounded.driven <= unbounded.driven


actions = st.sampled_from(
    [(accel, 0.0, NO_SPEED) for accel in reference.KEEPING]
    + [(a, side, NO_SPEED) for a in reference.CHANGING for side in (1.0, -1.0)]
)


@settings(max_examples=60)
@given(
    st.sampled_from(sorted(SCENES)), st.lists(actions, min_size=10, max_size=10), st.integers(1, 9)
)
def test_nothing_that_comes_costs_less_than_the_bound(
    name: str, way: list[tuple[float, float, float]], ply: int
) -> None:
    problem = problem_in(SCENES[name])
    line = lasting(way[0][ACCEL], 0, int(problem.ends[0]))
    whole = steps_of(problem, line, np.array(way))
    plan, total, end = driven(problem, whole)
    _, before, on_the_way = driven(problem, whole[: problem.ends[ply - 1]])
    if end in (IMPOSSIBLE, LOST) or on_the_way != ALIVE:
        return
    left, v = (
        int(problem.ends[-1] - problem.ends[ply - 1]),
        float(plan.v[problem.ends[ply - 1] - 1]),
    )
    assert (
        reference_solver._at_least(
            problem.local,
            problem.task.cost,
            reference_solver._rest(problem),
            v,
            left,
            problem.task.ego.step,
        )
        <= total - before + 1e-9
    )


def test_the_bound_bounds_something() -> None:
    road = lanes_east(1, 900.0)
    problem = problem_in(Toy(road, scene_of(ego_at(road, "a_0", 100.0, 0.0), road)))
    best = float(solve(problem, root_lines(problem)).value.min())
    assert (
        0.7 * best
        < reference_solver._at_least(
            problem.local, problem.task.cost, reference_solver._rest(problem), 0.0, 80, 0.1
        )
        <= best
    )


@settings(max_examples=60)
@given(
    st.sampled_from(["traffic", "reactive", "red", "free"]),
    st.lists(actions, min_size=10, max_size=10),
)
def test_no_sequence_that_anybody_drives_is_cheaper(
    name: str, way: list[tuple[float, float, float]]
) -> None:
    problem, found = solved(name)
    lines = root_lines(problem)
    for i in np.flatnonzero((lines[:, 0] == way[0]).all(axis=1)):
        _, cost, end = driven(problem, steps_of(problem, lines[i], np.array([NONE_YET, *way[1:]])))
        assert end in (LOST, IMPOSSIBLE) or cost >= found.value[i] - 1e-6


@pytest.mark.slow
def test_more_labels_never_find_worse_ways() -> None:
    problem = problem_in(SCENES["traffic"])
    values = [solve(problem, root_lines(problem), labels).value for labels in (1, 10, 100, 1000)]
    assert all((more <= less + 0.02).all() for less, more in pairwise(values))
    assert (values[0] > values[-1] + 0.02).any()


# --- what is frozen ---


DIGESTS = {
    "1": "03173272cdc3a89bd29d9a4f99d57480ea8aeea08bd56d24365d72223a398ab7",
    "2": "98b25a2004154287ca6ab4572033d644c08f99168ca807a67368987e17cc7aea",
    "2-forecast": "b56da5979ccdd6ba4eb7a69fbfe52f2361556a68a8d8b357cc3e5640706b5de8",
}


def test_the_numbers_have_not_moved() -> None:
    assert {version: digest(version) for version in VERSIONS} == DIGESTS


@pytest.mark.parametrize("name", ["red", "until 3.5 s", "until 4 s", "yields"])
def test_waiting_beyond_the_horizon_costs_in_the_second_version_alone(name: str) -> None:
    """The same sequence costs more there, by the term as planner `mcts` has it."""
    old, new = (problem_in(SCENES[name], version=version) for version in ("1", "2"))
    line = np.array([(-3.0, 0.0, NO_SPEED)] * int(old.ends[-1]))
    (plan, cheaper, end), (_, dearer, _) = driven(old, line), driven(new, line)
    assert end == ALIVE and len(plan.v) == len(line)
    weights = {**cost_of("1")._asdict(), "beyond_s": CostWeights().beyond_s}
    usual = new._replace(task=new.task._replace(cost=type(new.task.cost)(**weights)))
    assert cheaper < dearer == driven(usual, line)[1]


def test_the_agents_of_the_third_version_drive_as_forecast() -> None:
    second, third = (problem_in(SCENES["reactive"], version=each) for each in ("2", "2-forecast"))
    assert second.task.cost == third.task.cost
    assert (second.local.trait[:, SLOT] >= 0.0).any()
    assert not (third.local.trait[:, SLOT] >= 0.0).any() and len(third.others) == 0


def test_no_weight_that_is_configured_moves_a_value() -> None:
    sets = (
        "cost.claim=1",
        "cost.claim_s=0",
        "cost.headway_s=3",
        "cost.jerk=1",
        "planner.accelerations_mps2=[0]",
        "planner.reactive=0",
        "planner.check_s=1",
        "planner.step_s=2",
    )
    for name in ("traffic", "yields"):
        usual, tuned = (problem_in(SCENES[name], *those) for those in ((), sets))
        assert np.array_equal(
            solve(usual, root_lines(usual), 20).value, solve(tuned, root_lines(tuned), 20).value
        )


def test_the_scale_is_a_second_of_braking() -> None:
    for version in VERSIONS:
        cost = cost_of(version)
        assert scale(problem_in(on_three_lanes(), version=version).task) == pytest.approx(
            cost.acceleration * 16.0 + cost.braking * 1.0
        )


@pytest.mark.parametrize(
    ("step", "ends"),
    [
        (0.1, [5, 10, 15, 20, 30]),
        (0.25, [2, 4, 6, 8, 12]),
        (0.05, [10, 20, 30, 40, 60]),
        (1.0, [1, 2, 3, 4, 5]),
    ],
)
def test_plies_end_at_the_steps_nearest_to_their_times(step: float, ends: list[int]) -> None:
    toy = on_three_lanes()
    task = task_of(toy.road, toy.scene.ego)
    problem = problem_of(
        task._replace(ego=task.ego._replace(step=step)), situation_of(task, toy.scene)
    )
    assert (
        problem.ends[:5].tolist() == ends
        and problem.ends[-1] * step == pytest.approx(8.0)
        and problem.q.horizon == pytest.approx(8.0)
    )


# --- profiles ---


@pytest.mark.parametrize("name", ["free", "traffic", "red"])
def test_the_profile_of_an_action_is_that_action(name: str) -> None:
    problem = problem_in(SCENES[name])
    lines = root_lines(problem)
    plans = [driven(problem, line)[0] for line in lines]
    profiles = [
        profile_line(problem, Follow(plan.v, int(side)))
        for plan, side in zip(plans, problem.roots[:, SIDE], strict=True)
    ]
    alone, both = solve(problem, lines, 20), solve(problem, np.concatenate([lines, profiles]), 20)
    assert np.array_equal(both.value, np.tile(alone.value, 2)) and np.array_equal(
        both.collides, np.tile(alone.collides, 2)
    )
    assert both.driven == alone.driven + lines[..., ACCEL].size


def test_a_profile_is_driven_whatever_the_road_allows() -> None:
    problem = problem_in(before_a_light(RED, 9.5, 10.0))
    line = profile_line(problem, Follow(np.full(3, 10.0), 0))
    assert line.tolist() == [[FOLLOW, 0.0, 10.0]] * 5
    _, cost, end = driven(problem, line)
    assert end == ALIVE and cost > 0.0
    longer = np.concatenate([line, line])
    assert driven(problem, longer)[2] == LOST
    found = solve(problem, np.array([line, *root_lines(problem)]))
    assert found.collides[0] and not found.collides[1:].all()


def test_a_change_that_the_road_does_not_allow_is_not_driven() -> None:
    road = lanes_east(1, 900.0)
    problem = problem_in(Toy(road, scene_of(ego_at(road, "a_0", 100.0, 10.0), road)))
    keep, change = (profile_line(problem, Follow(np.full(5, 10.0), side)) for side in (0, 1))
    found = solve(problem, np.array([keep, change]), 5)
    assert found.value[0] == found.value[1]


# --- the same everywhere ---

PRINT = """
import json
from test_reference import SCENES, problem_in, root_lines, small, solve
found = [solve(problem, root_lines(problem), 4) for problem in (small(problem_in(SCENES[name]), 5) for name in ("traffic", "reactive"))]
print(json.dumps([[float(v).hex() for v in each.value] + [each.driven] for each in found]))
"""


@pytest.mark.slow
def test_without_compilation_it_is_the_same_to_the_bit() -> None:
    here = Path(__file__).parent
    path = os.pathsep.join([str(here), str(here.parent), *sys.path])
    run = subprocess.run(
        [sys.executable, "-c", PRINT],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    found = [
        solve(problem, root_lines(problem), 4)
        for problem in (small(problem_in(SCENES[name]), 5) for name in ("traffic", "reactive"))
    ]
    assert json.loads(run.stdout) == [
        [float(v).hex() for v in each.value] + [each.driven] for each in found
    ]


# --- the planner ---


@pytest.mark.parametrize("toy", SCENES.values(), ids=SCENES)
def test_the_planner_takes_the_best_beginning(toy: Toy) -> None:
    decision = decide(toy, "planner.name=exhaustive")
    problem = problem_in(toy)
    found = solve(problem, root_lines(problem))
    assert [child.best for child in decision.children] == found.value.tolist()
    assert decision.chosen == best_root(found) and (decision.reason == "brake") == bool(
        found.collides.all()
    )
    assert isinstance(decision.command, Follow) and decision.plan is not None
    assert (
        np.array_equal(decision.command.speeds, decision.plan.v)
        and decision.command.lane_change == problem.roots[decision.chosen, SIDE]
    )
    chosen = decision.children[decision.chosen]
    assert chosen.terms.sum() == pytest.approx(chosen.best, abs=1e-6)


@pytest.mark.slow
def test_it_drives() -> None:
    scene = config.load(
        builtin.scenario_path("unprotected-left-turn"),
        ("planner.name=exhaustive", "episode.time_limit_s=5"),
    )
    assert default_variant(scene) == "exhaustive-idm"
    result = run_episode(scene, 1)
    row, (trace,) = result.rows[0], result.traces
    assert (row["outcome"], row["cycles"], row["failsafe_interventions"], row["iterations"]) == (
        "timeout",
        11,
        0,
        0,
    )
    assert {cycle.decision.reason for cycle in trace.cycles} == {"exhaustive"} and not any(
        cycle.deviation for cycle in trace.cycles
    )
    assert row["distance_m"] > 20.0
