"""The paper's planner: what holds in every tree, and its UCB equation against a computation by hand."""

import math
from typing import Any

import numpy as np
import pytest
from helpers import Agent, ego_at
from helpers_model import lanes_east, local_of, scenario, scene_of, situation_of, task_of
from helpers_tree import TOYS, Toy, mirrored, on_three_lanes

from sumo_mcts.driver import make_planner
from sumo_mcts.planners import paper
from sumo_mcts.planners.tree import ALIVE, IMPOSSIBLE, LOST, NONE
from sumo_mcts.scene import Decision, Follow

ACTIONS = 12  # ten accelerations and two lane changes


class Watched(paper.PaperPlanner):
    """Keeps its last tree."""

    tree: paper.PaperTree
    weights: paper.Weights

    def _decision(self, tree: paper.PaperTree, local: Any, weights: paper.Weights, situation: Any, done: int) -> Decision:
        self.tree, self.weights = tree, weights
        return super()._decision(tree, local, weights, situation, done)


def plan(toy: Toy, *sets: str, seed: int = 1) -> tuple[Watched, Decision]:
    config = scenario("planner.name=paper", "planner.iterations=300", *toy.sets, *sets)
    planner = make_planner(config)
    planner.__class__ = Watched
    task = task_of(toy.road, toy.scene.ego, config)
    planner.start(task, seed)
    return planner, planner.plan(situation_of(task, toy.scene))


@pytest.mark.parametrize("toy", TOYS.values(), ids=TOYS)
def test_every_tree(toy: Toy) -> None:
    planner, _ = plan(toy)
    tree, used = planner.tree, int(planner.tree.used[0])
    assert tree.visits[0] == 300
    for node in range(used):
        below = [int(i) for i in tree.child[node] if i >= 0]
        assert all(tree.parent[i] == node and tree.level[i] == tree.level[node] + 1 for i in below)
        assert tree.visits[node] - sum(tree.visits[i] for i in below) in ((1,) if below and any(tree.end[i] != LOST for i in below) else range(301))
        assert tree.end[node] == ALIVE or not below
        assert tree.end[node] != LOST or tree.visits[node] == 0  # who collides is discarded
        assert np.all(tree.cost[node] >= 0.0) and tree.total[node] >= tree.visits[node] * tree.cost[node].sum() - 1e-6
        if node:
            assert np.all(tree.cost[node] >= tree.cost[tree.parent[node]])
        if below:
            assert not np.any(tree.child[node] == NONE)  # all actions at once
    assert np.all(tree.child[:used][tree.level[:used] == planner.weights.look_ahead] == NONE)
    assert np.sum(tree.child[0] != IMPOSSIBLE) == ACTIONS if len(toy.road.lane_ids) > 3 else True


@pytest.mark.parametrize("passes", [15, 40, 300])
@pytest.mark.parametrize("toy", TOYS.values(), ids=TOYS)
def test_it_takes_the_child_with_the_lowest_mean(toy: Toy, passes: int) -> None:
    planner, decision = plan(toy, f"planner.iterations={passes}")
    tree = planner.tree
    alive = [int(i) for i in tree.child[0] if i >= 0 and tree.end[i] != LOST and tree.visits[i] > 0]
    assert [child.mean for child in decision.children] == [tree.total[i] / tree.visits[i] for i in alive]
    assert decision.children[decision.chosen].mean == min(tree.total[i] / tree.visits[i] for i in alive)
    assert isinstance(decision.command, Follow) and decision.reason == "search"


def test_the_same_seed_the_same_tree() -> None:
    (a, _), (b, _), (c, _) = (plan(TOYS["traffic"], seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(a.tree.total, b.tree.total) and np.array_equal(a.tree.visits, b.tree.visits)
    assert not np.array_equal(a.tree.total, c.tree.total)


def test_the_equation_of_the_upper_confidence_bound() -> None:
    """X = -C(v)/n(v) + c sqrt(2 ln n(parent) / n(v)): worked out by hand for three children."""
    planner, _ = plan(TOYS["free"])
    tree, weights = paper._new_tree(8, 3), planner.weights._replace(exploration=5.0)
    tree.used[0], tree.visits[0] = 4, 20
    tree.child[0], tree.parent[1:4], tree.level[1:4] = (1, 2, 3), 0, 1
    tree.visits[1:4], tree.total[1:4] = (10, 6, 4), (100.0, 66.0, 48.0)
    # -10 + 5 sqrt(2 ln 20 / 10) = -6.13;   -11 + 5 sqrt(2 ln 20 / 6) = -6.00;   -12 + 5 sqrt(2 ln 20 / 4) = -5.88
    scores = [-100 / 10 + 5 * math.sqrt(2 * math.log(20) / 10), -66 / 6 + 5 * math.sqrt(2 * math.log(20) / 6), -48 / 4 + 5 * math.sqrt(2 * math.log(20) / 4)]
    assert scores == pytest.approx([-6.1298, -6.0036, -5.8806], abs=1e-4)
    assert paper._select(tree, weights) == 3
    assert paper._select(tree, weights._replace(exploration=3.0)) == 1  # -7.68, -8.00, -8.33
    tree.end[3] = LOST
    assert paper._select(tree, weights) == 2  # one that collided does not compete
    tree.visits[1] = 0
    assert paper._select(tree, weights) == 1  # an unvisited one comes first


def test_nothing_is_left_so_it_brakes() -> None:
    road = lanes_east(1, 900.0)
    toy = Toy(road, scene_of(ego_at(road, "a_0", 100.0, 14.0), road, Agent("w", "a_0", 106.5, 0.0)))
    _, decision = plan(toy)
    assert decision.reason == "brake" and decision.children == () and decision.plan.v[5] < 14.0 - 3.0


def test_it_changes_lanes_before_a_standing_obstacle_and_brakes_before_a_wall() -> None:
    road = lanes_east(3, 900.0)
    block = [Agent(f"b{k}", "a_0", 106.0 + 6.0 * k, 0.0) for k in range(6)]
    toy = on_three_lanes(ego_at(road, "a_1", 100.0, 10.0), Agent("w", "a_1", 132.0, 0.0), *block)
    for those, side in ((toy, 1), (mirrored(toy), -1)):
        _, decision = plan(those, "planner.iterations=2000")
        assert max(decision.children, key=lambda child: child.lane_change * side).lane_change == side
        assert all(child.lane_change != -side or child.mean > decision.children[decision.chosen].mean for child in decision.children)
    wall = on_three_lanes(None, *(Agent(f"w{k}", f"a_{k}", 122.0, 0.0) for k in range(3)))
    _, decision = plan(wall)
    assert decision.children[decision.chosen].accel < -2.0


def test_time_and_iterations_bound_the_search() -> None:
    task = task_of(TOYS["free"].road, TOYS["free"].scene.ego)
    local_of(task, TOYS["free"].scene)
    _, decision = plan(TOYS["free"], "planner.time_budget_ms=0.001", "planner.iterations=1000000")
    assert 0 < decision.iterations <= 100
    _, decision = plan(TOYS["free"], "planner.iterations=7")
    assert decision.iterations == 7
