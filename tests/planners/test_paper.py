"""The paper's planner: what holds in every tree, and its UCB equation against a computation by
hand."""

import math
import time
from typing import Any

import numpy as np
import pytest
from helpers import Agent, Lane, build, edges, ego_at
from helpers_model import lanes_east, scenario, scene_of, situation_of, task_of
from helpers_tree import TOYS, Toy, mirrored, on_three_lanes

from sumo_mcts.driver.factories import make_planner
from sumo_mcts.planners import paper, paper_cost, paper_search
from sumo_mcts.planners.paper import LOOK_SLICE
from sumo_mcts.planners.ply import ALIVE, ARRIVED, IMPOSSIBLE, LOST, NONE
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Decision, Follow

ACTIONS = 12  # ten accelerations and two lane changes


class Watched(paper.PaperPlanner):
    """Keeps its last tree."""

    tree: paper.PaperTree
    weights: paper.Weights

    def _decision(
        self, tree: paper.PaperTree, local: Any, weights: paper.Weights, situation: Any, done: int
    ) -> Decision:
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
        assert tree.visits[node] - sum(tree.visits[i] for i in below) in (
            (1,) if below and any(tree.end[i] != LOST for i in below) else range(301)
        )
        assert tree.end[node] == ALIVE or not below
        assert tree.end[node] != LOST or tree.visits[node] == 0  # who collides is discarded
        assert (
            np.all(tree.cost[node] >= 0.0)
            and tree.total[node] >= tree.visits[node] * tree.cost[node].sum() - 1e-6
        )
        if node:
            assert np.all(tree.cost[node] >= tree.cost[tree.parent[node]])
        if below:
            assert not np.any(tree.child[node] == NONE)  # all actions at once
    assert np.all(tree.child[:used][tree.level[:used] == planner.weights.look_ahead] == NONE)
    possible = ACTIONS if toy.road.edge_ids == ("a",) else ACTIONS - 2  # one lane, or three
    assert np.sum(tree.child[0] != IMPOSSIBLE) == possible


@pytest.mark.parametrize("passes", [15, 40, 300])
@pytest.mark.parametrize("toy", TOYS.values(), ids=TOYS)
def test_it_takes_the_child_with_the_lowest_mean(toy: Toy, passes: int) -> None:
    planner, decision = plan(toy, f"planner.iterations={passes}")
    tree = planner.tree
    alive = [int(i) for i in tree.child[0] if i >= 0 and tree.end[i] != LOST and tree.visits[i] > 0]
    assert [child.mean for child in decision.children] == [
        tree.total[i] / tree.visits[i] for i in alive
    ]
    assert decision.children[decision.chosen].mean == min(
        tree.total[i] / tree.visits[i] for i in alive
    )
    assert isinstance(decision.command, Follow) and decision.reason == "search"


def test_the_same_seed_the_same_tree() -> None:
    (a, _), (b, _), (c, _) = (plan(TOYS["traffic"], seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(a.tree.total, b.tree.total) and np.array_equal(
        a.tree.visits, b.tree.visits
    )
    assert not np.array_equal(a.tree.total, c.tree.total)


def test_the_equation_of_the_upper_confidence_bound() -> None:
    """X = -C(v)/n(v) + c sqrt(2 ln n(parent) / n(v)): worked out by hand for three children."""
    planner, _ = plan(TOYS["free"])
    tree, weights = paper_search.new_tree(8, 3), planner.weights._replace(exploration=5.0)
    tree.used[0], tree.visits[0] = 4, 20
    tree.child[0], tree.parent[1:4], tree.level[1:4] = (1, 2, 3), 0, 1
    tree.visits[1:4], tree.total[1:4] = (10, 6, 4), (100.0, 66.0, 48.0)
    # -10 + 5 sqrt(2 ln 20 / 10) = -6.13;   -11 + 5 sqrt(2 ln 20 / 6) = -6.00;   -12 + 5 sqrt(2 ln
    # 20 / 4) = -5.88
    scores = [
        -100 / 10 + 5 * math.sqrt(2 * math.log(20) / 10),
        -66 / 6 + 5 * math.sqrt(2 * math.log(20) / 6),
        -48 / 4 + 5 * math.sqrt(2 * math.log(20) / 4),
    ]
    assert scores == pytest.approx([-6.1298, -6.0036, -5.8806], abs=1e-4)
    rng = np.random.default_rng(1)
    assert paper_search._select(tree, weights, rng) == 3
    assert (
        paper_search._select(tree, weights._replace(exploration=3.0), rng) == 1
    )  # -7.68, -8.00, -8.33
    tree.end[3] = LOST
    assert paper_search._select(tree, weights, rng) == 2  # one that collided does not compete
    tree.visits[1] = 0
    assert paper_search._select(tree, weights, rng) == 1  # an unvisited one comes first
    tree.visits[2] = 0
    drawn = [paper_search._select(tree, weights, rng) for _ in range(200)]
    assert set(drawn) == {1, 2} and 60 < drawn.count(1) < 140  # among several one is drawn


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("v", [0.0, 5.0, 10.0])
def test_driving_on_is_worth_more_than_standing(v: float, seed: int) -> None:
    road = lanes_east(1, 900.0)
    toy = Toy(road, scene_of(ego_at(road, "a_0", 100.0, v), road))
    for passes in (100, 1000, 3000):
        _, decision = plan(toy, f"planner.iterations={passes}", seed=seed)
        assert decision.children[decision.chosen].accel >= 1.0
    followed = Toy(
        road,
        scene_of(ego_at(road, "a_0", 100.0, v), road, Agent("leader", "a_0", 108.0 + 3.0 * v, v)),
    )
    _, decision = plan(followed, "planner.iterations=1000", seed=seed)
    assert decision.children[decision.chosen].accel >= -1.0


def exit_on_the_right(first: int = 0) -> RoadMap:
    """Three lanes, of which lane 0 alone leads on, to one of the two lanes of edge b; the next edge
    needs lane `first` of b."""
    lanes = [
        Lane("a", k, ((0.0, 3.2 * k), (200.0, 3.2 * k)), (":m_0",) if k == 0 else ())
        for k in range(3)
    ]
    lanes += [Lane(":m", 0, ((200.0, 0.0), (210.0, 0.0)), ("b_0",), junction="m")]
    lanes += [
        Lane("b", k, ((210.0, 3.2 * k), (410.0, 3.2 * k)), (":n_0",) if k == first else ())
        for k in range(2)
    ]
    lanes += [
        Lane(":n", 0, ((410.0, 3.2 * first), (420.0, 3.2 * first)), ("c_0",), junction="n"),
        Lane("c", 0, ((420.0, 0.0), (600.0, 0.0))),
    ]
    return build(lanes)


def test_a_lane_change_that_the_route_needs_counts_as_distance() -> None:
    road = exit_on_the_right(first=1)
    ego = ego_at(road, "a_1", 150.0, 10.0, route=edges(road, "a", "b", "c"))
    task = task_of(road, ego)
    state = situation_of(task, scene_of(ego, road)).state
    guide = paper.guide_of(task, state, 100.0, 20.0)
    assert guide.goal == 250.0
    node = {road.lane_ids[lane]: i for i, lane in enumerate(task.route.lane)}
    assert [guide.aside[node[lane]] for lane in ("a_0", "a_1", "a_2")] == [0.0, 20.0, 40.0]
    assert guide.aside[node["b_0"]] == 0.0  # what the next edge needs does not punish entering it
    half_way = state._replace(progress=0.25, other=node["a_0"])
    assert [paper_cost._aside(guide, s) for s in (state, half_way)] == [20.0, 15.0]
    assert (
        paper_cost._aside(guide, state._replace(node=node["a_0"], progress=0.75, other=node["a_1"]))
        == 5.0
    )


@pytest.mark.parametrize("seed", range(5))
def test_it_changes_to_the_lane_of_its_route(seed: int) -> None:
    road = exit_on_the_right()
    toy = Toy(
        road, scene_of(ego_at(road, "a_1", 120.0, 8.0, route=edges(road, "a", "b", "c")), road)
    )
    _, decision = plan(toy, "planner.iterations=1000", seed=seed)
    assert decision.children[decision.chosen].lane_change == -1


def test_a_lane_change_whose_place_is_taken_later_is_discarded() -> None:
    """The car on the left is 1 m short of contact after T_1; the change lasts 3 s."""
    taken = on_three_lanes(None, Agent("beside", "a_2", 100.0, 10.0))
    for toy, side in ((taken, 1), (mirrored(taken), -1)):
        planner, decision = plan(toy)
        assert {child.lane_change for child in decision.children} == {0, -side}
        lost = planner.tree.child[0, 10 if side > 0 else 11]
        assert (
            planner.tree.end[lost] == LOST and planner.tree.cost[lost, 0] > 0.0
        )  # found after the step's end, where its costs are counted


def test_how_it_arrives_is_not_free() -> None:
    road = lanes_east(1, 300.0)
    toy = Toy(road, scene_of(ego_at(road, "a_0", 296.0, 10.0), road))
    planner, decision = plan(toy)
    assert (
        planner.tree.end[planner.tree.child[0, 0]] == ARRIVED and decision.children[0].accel == -8.0
    )
    assert decision.children[0].mean > 5.0 and decision.children[decision.chosen].accel == 0.0


def test_nothing_is_left_so_it_brakes() -> None:
    road = lanes_east(1, 900.0)
    toy = Toy(road, scene_of(ego_at(road, "a_0", 100.0, 14.0), road, Agent("w", "a_0", 106.5, 0.0)))
    _, decision = plan(toy)
    assert (
        decision.reason == "brake" and decision.children == () and decision.plan.v[5] < 14.0 - 3.0
    )


def test_it_changes_lanes_before_a_standing_obstacle_and_brakes_before_a_wall() -> None:
    road = lanes_east(3, 900.0)
    block = [Agent(f"b{k}", "a_0", 106.0 + 6.0 * k, 0.0) for k in range(6)]
    toy = on_three_lanes(ego_at(road, "a_1", 100.0, 10.0), Agent("w", "a_1", 132.0, 0.0), *block)
    for those, side in ((toy, 1), (mirrored(toy), -1)):
        _, decision = plan(those, "planner.iterations=2000")
        assert (
            max(decision.children, key=lambda child: child.lane_change * side).lane_change == side
        )
        assert all(
            child.lane_change != -side or child.mean > decision.children[decision.chosen].mean
            for child in decision.children
        )
    wall = on_three_lanes(None, *(Agent(f"w{k}", f"a_{k}", 122.0, 0.0) for k in range(3)))
    _, decision = plan(wall)
    assert decision.children[decision.chosen].accel < -2.0


def test_time_and_iterations_bound_the_search() -> None:
    toy = TOYS["free"]
    task, planner = (
        task_of(toy.road, toy.scene.ego),
        make_planner(scenario("planner.name=paper", "planner.iterations=7")),
    )
    planner.start(task, 1)
    situation = situation_of(task, toy.scene)
    assert planner.plan(situation).iterations == 7
    assert (
        planner.plan(situation._replace(until=time.perf_counter() + 0.05)).iterations > 100
    )  # iterations do not count then
    assert (
        planner.plan(situation._replace(until=time.perf_counter() - 1.0)).iterations == LOOK_SLICE
    )  # an answer in any case
