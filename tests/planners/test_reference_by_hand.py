"""The reference problem, read once more: what is compared, what can begin, how a profile is driven,
and what a sequence costs that ends in a contact."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from helpers import Agent, Lane, build, edges, ego_at
from helpers_model import PHYSICS, lanes_east, scene_of, situation_of, task_of

from sumo_mcts.driver.params import Physics
from sumo_mcts.model.local_map import SLOT
from sumo_mcts.planners.actions import ACCEL, FOLLOW, NO_SPEED, SIDE
from sumo_mcts.planners.candidates import follow_line
from sumo_mcts.planners.ply import LOST
from sumo_mcts.planners.reference import (
    CHANGING,
    KEEPING,
    Problem,
    forecast_s,
    problem_of,
    profile_line,
    root_lines,
    scale,
    steps_of,
)
from sumo_mcts.planners.reference_solver import Rest, _rest, solve
from sumo_mcts.scene import Follow


def problem(
    *agents: Agent, lane: str = "a_1", v: float = 8.0, length: float = 900.0,
    physics: Physics = PHYSICS, **more: Any,
) -> Problem:  # fmt: skip
    """The ego, its front at 100 m, on one of three lanes."""
    road = lanes_east(3, length)
    ego = ego_at(road, lane, 100.0, v)
    task = task_of(road, ego, physics=physics)
    return problem_of(task, situation_of(task, scene_of(ego, road, *agents)), **more)


@pytest.mark.parametrize("step", [0.1, 0.25])
def test_plies_checks_and_horizon_are_those_of_the_problem(step: float) -> None:
    """A first ply of half a second, ten of them, 8 s; a check each 0.2 s."""
    found = problem(physics=PHYSICS._replace(step=step))
    q = found.q
    assert (q.ply, q.look_ahead, q.rollout) == (round(0.5 / step), 10, 0)
    assert (q.exploration, q.adaptive, q.horizon) == (0.0, False, 8.0)
    assert q.check == (2 if step == 0.1 else 0)
    assert found.ends.tolist() == [round(s / step) for s in (0.5, 1, 1.5, 2, 3, 4, 5, 6, 7, 8)]
    assert forecast_s(0.2) == pytest.approx(8.0 + 1.6 + 0.2)
    # 4 m/s2: 0.02 * 16, and 0.5 for the square of the metre beyond 3 m/s2
    assert scale(found.task) == pytest.approx(0.32 + 0.5)


@pytest.mark.parametrize(("version", "moved"), [("1", 8), ("2", 8), ("2-forecast", 0)])
def test_so_many_react(version: str, moved: int) -> None:
    those = [Agent(f"q{k}", "a_1", 90.0 - 10.0 * k, 8.0) for k in range(3)]
    found = problem(*those, version=version)
    assert found.others.shape == (moved, 2)
    assert (found.local.trait[:, SLOT] >= 0.0).sum() == min(3, moved)


def sides(found: Problem) -> list[float]:
    return sorted(set(found.roots[:, SIDE].tolist()))


@pytest.mark.parametrize(
    ("lane", "beside", "expected"),
    [
        ("a_1", "", [-1.0, 0.0, 1.0]),
        ("a_0", "", [0.0, 1.0]),
        ("a_2", "", [-1.0, 0.0]),
        ("a_1", "a_0", [0.0, 1.0]),
        ("a_1", "a_2", [-1.0, 0.0]),
    ],
)
def test_what_can_begin(lane: str, beside: str, expected: list[float]) -> None:
    found = problem(*([Agent("x", beside, 100.0, 8.0)] if beside else []), lane=lane)
    pairs = [(a, 0.0) for a in KEEPING]
    pairs += [(a, side) for side in (1.0, -1.0) for a in CHANGING]
    assert list(map(tuple, found.actions)) == pairs
    assert list(map(tuple, found.roots)) == [pair for pair in pairs if pair[1] in expected]
    assert sides(found) == expected
    lines = root_lines(found)
    assert lines.shape == (len(found.roots), 5, 3)
    for line, (accel, side) in zip(lines, found.roots, strict=True):
        assert (line[:, ACCEL] == accel).all() and (line[1:, SIDE] == 0.0).all()
        assert line[0, SIDE] == side


@pytest.mark.parametrize(
    ("speeds", "driven"),
    [([9.0, 7.0], [9.0, 7.0, 7.0, 7.0, 7.0]), ([6.0], [6.0] * 5), ([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [1.0, 2.0, 3.0, 4.0, 5.0])],
)  # fmt: skip
def test_a_profile_is_cut_or_keeps_its_last_speed(speeds: list[float], driven: list[float]) -> None:
    line = profile_line(problem(), Follow(np.array(speeds), 1))
    assert line[:, 2].tolist() == driven
    assert line[:, SIDE].tolist() == [1.0, 0.0, 0.0, 0.0, 0.0]


def test_a_sequence_is_written_step_by_step_up_to_its_end() -> None:
    """The third ply ends after 1.5 s; the fifth takes a second."""
    found, best = problem(), np.full((10, 3), np.nan)
    line = root_lines(found)[0]
    assert steps_of(found, line, best).tolist() == line.tolist()
    for k in range(1, 5):
        best[k] = -float(k), 0.0, NO_SPEED
    rows = steps_of(found, line, best)
    assert len(rows) == 30 and rows[:5].tolist() == line.tolist()
    assert rows[5:, ACCEL].tolist() == [-1.0] * 5 + [-2.0] * 5 + [-3.0] * 5 + [-4.0] * 10
    best[5:] = 0.0, 0.0, NO_SPEED
    assert len(steps_of(found, line, best)) == 80


@pytest.mark.parametrize(
    ("length", "v", "limit"),
    [(331.0, 8.0, 15.0), (330.0, 8.0, math.inf), (267.0, 0.0, 15.0), (266.0, 0.0, math.inf)],
)
def test_a_route_may_end_where_the_ego_can_get_in_eight_seconds(
    length: float, v: float, limit: float
) -> None:
    """At most (v + 2.6 * 8) * 8 m from 100 m on: 230.4 m, or 166.4 m."""
    found = problem(v=v, length=length)
    assert found.task.ego.max_accel == 2.6
    assert _rest(found) == Rest(limit, 2.6)


@pytest.mark.parametrize(("length", "limit"), [(331.0, 15.0), (330.0, math.inf)])
def test_the_end_of_a_route_counts_from_the_ego(length: float, limit: float) -> None:
    """Likewise 700 m down the route, of which the limits behind do not count."""
    road = build([
        Lane("u", 0, ((-700, 0), (0, 0)), ("a_0",), 5.0), Lane("a", 0, ((0, 0), (length, 0)), speed=15.0),
    ])  # fmt: skip
    ego = ego_at(road, "a_0", 100.0, 8.0, route=edges(road, "u", "a"))
    task = task_of(road, ego)
    found = problem_of(task, situation_of(task, scene_of(ego, road)))
    assert _rest(found) == Rest(limit, 2.6)


@pytest.mark.parametrize("version", ["2-forecast", "2"])
@pytest.mark.parametrize("ahead", [9.0, 14.0, 60.0])
def test_the_cheapest_of_all_sequences_is_found_and_costs_what_its_terms_say(
    ahead: float, version: str
) -> None:
    """Three plies of two actions each, behind somebody who stands so many metres ahead, before one
    who comes fast from behind, and may react: at 9 m they all end in a contact, with its loss."""
    agents = Agent("x", "a_1", 105.0 + ahead, 0.0), Agent("y", "a_1", 85.0, 15.0)
    found = problem(*agents, v=14.0, version=version)
    few = np.array([(-3.0, 0.0), (FOLLOW, 0.0)])
    found = found._replace(
        ends=found.ends[:3], actions=few, roots=few,
        q=found.q._replace(horizon=float(found.ends[2]) * 0.1, look_ahead=3),
    )  # fmt: skip

    def driven(line: np.ndarray, best: np.ndarray) -> tuple[bool, float]:
        rows = steps_of(found, line, best)
        _, terms, end = follow_line(
            found.local, found.task, found.q, found.state, found.others.copy(), rows
        )
        return end == LOST, float(terms.sum())

    lines = root_lines(found)
    solution = solve(found, lines)
    for i, line in enumerate(lines):
        values = []
        for later in itertools.product(few, repeat=2):
            best = np.full((3, 3), np.nan)
            best[1:, :2], best[1:, 2] = later, NO_SPEED
            values.append(driven(line, best))
        for expected in (min(values), driven(line, solution.best[i])):
            assert solution.collides[i] == expected[0]
            assert solution.value[i] == pytest.approx(expected[1])
        if ahead == 9.0:
            assert solution.collides[i] and solution.value[i] > 30.0  # half a contact's at least


def test_beginnings_that_come_to_the_same_are_solved_once() -> None:
    """Only their first ply is driven again, of five steps."""
    found = problem(version="2-forecast")
    few = np.array([(-3.0, 0.0), (FOLLOW, 0.0)])
    found = found._replace(
        ends=found.ends[:2], actions=few, roots=few,
        q=found.q._replace(horizon=float(found.ends[1]) * 0.1, look_ahead=2),
    )  # fmt: skip
    lines = root_lines(found)
    once, twice = solve(found, lines), solve(found, np.concatenate([lines, lines]))
    assert twice.driven == once.driven + 2 * 5
    assert twice.value.tolist() == once.value.tolist() * 2
