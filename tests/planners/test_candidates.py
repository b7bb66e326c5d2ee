"""Which of a decision's candidates is driven."""

from typing import Any, cast

import numpy as np
import pytest
from helpers import Agent, ego_at
from helpers_model import lanes_east, local_of, scene_of, task_of

from sumo_mcts.model.reactions import undisturbed
from sumo_mcts.planners.actions import lasting, lines_of
from sumo_mcts.planners.candidates import Candidate, Start, drive, follow_line, not_for_a_stop
from sumo_mcts.planners.ply import ALIVE, IMPOSSIBLE, search_params
from sumo_mcts.scene import NO_STOP, PASSABILITY, SAFETY, Plan, RootChild, Stop

DECEL = 4.5


def start(stop: Stop) -> Start:
    road = lanes_east(2)
    ego = ego_at(road, "a_1", 100.0, 10.0)._replace(stop=stop)
    task = task_of(road, ego)
    local, state = local_of(task, scene_of(ego, road))
    q = search_params(task.ego.step, 0.2, 1.0, 0.2, 6, 2, 0.5, adaptive=True)
    return Start(local, task, q, state, np.zeros((0, 2)))


def braking(decel: float, passability: float, safety: float) -> Candidate:
    terms = np.zeros(5)
    terms[PASSABILITY], terms[SAFETY] = passability, safety
    time = np.linspace(0.1, 1.0, 10)
    none = cast(Any, np.zeros(0))
    plan = Plan(time, 10.0 - decel * time, none, none, np.zeros((0, 4)))
    return Candidate(RootChild(-decel, 0, 1, 0.0, float(terms.sum()), terms, plan.pose), plan, none)


@pytest.mark.parametrize(
    ("stop", "hard", "gentle", "chosen"),
    [
        (Stop(0, 299.8, 300.0), (20.0, 0.0), (40.0, 0.0), 1),
        (Stop(0, 299.8, 300.0), (20.0, 0.0), (40.0, 5.0), 0),  # it brakes for others
        (Stop(0, 299.8, 300.0, speed=4.0), (20.0, 0.0), (40.0, 0.0), 0),
        (NO_STOP, (20.0, 0.0), (40.0, 0.0), 0),
    ],
    ids=["stop", "others", "waypoint", "no stop"],
)
def test_nobody_brakes_hard_for_a_gap_beside_a_stop(
    stop: Stop, hard: tuple[float, float], gentle: tuple[float, float], chosen: int
) -> None:
    found = [braking(7.0, *hard), braking(DECEL, *gentle)]
    assert not_for_a_stop(start(stop), found, 0, DECEL) == chosen
    assert not_for_a_stop(start(stop), found, 1, DECEL) == 1


def test_sequences_driven_together_are_as_each_driven_alone() -> None:
    """Also one that changes lanes, and one that is shorter; agents that react move anew in each."""
    road = lanes_east(2)
    ego = ego_at(road, "a_1", 100.0, 10.0)
    task = task_of(road, ego)
    cars = Agent("behind", "a_1", 80.0, 12.0), Agent("ahead", "a_0", 140.0, 6.0)
    local, state = local_of(task, scene_of(ego, road, *cars), reactive=2)
    q = search_params(task.ego.step, 0.2, 1.0, 0.2, 6, 2, 0.5, adaptive=True)
    begun = Start(local, task, q, state, undisturbed(local))
    sequences = [
        lasting(-3.0, 0, 80),
        lasting(0.0, -1, 80),
        lasting(1.0, 0, 20),
        lasting(9.0, 1, 5),
    ]
    driven = drive(begun, lines_of(sequences))
    for m, line in enumerate(sequences):
        plan, terms, end = follow_line(local, task, q, state, undisturbed(local), line)
        assert (end, len(plan.v)) == (driven.end[m], driven.steps[m])
        assert np.array_equal(terms, driven.terms[m])
        assert np.array_equal(plan.pose, driven.pose[m, : driven.steps[m]])
    assert driven.end.tolist() == [ALIVE, ALIVE, ALIVE, IMPOSSIBLE]
    assert len({terms.sum() for terms in driven.terms[:2]}) == 2
