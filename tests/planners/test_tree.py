"""The search: what holds in every tree, the trees of a few toys to the bit, and decisions whose
answer is known.

After a wanted change of model, cost or search the golden trees are renewed by: .venv/bin/python
tests/helpers_tree.py
"""

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import helpers_tree
import numpy as np
import pytest
from helpers import Agent, Lane, build, edges, ego_at, lights
from helpers_model import lanes_east, road_with_light, scenario, scene_of, situation_of, task_of
from helpers_tree import (
    GOLDEN,
    TOYS,
    Grown,
    Toy,
    before_a_light,
    decide,
    grow,
    mirrored,
    on_three_lanes,
    plain,
    rough,
    small_trees,
    steady,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from sumo_mcts.driver.factories import make_planner
from sumo_mcts.planners.budget import Budget
from sumo_mcts.planners.mcts import MctsPlanner
from sumo_mcts.planners.ply import ALIVE, IMPOSSIBLE, LOST, NONE
from sumo_mcts.planners.search import search
from sumo_mcts.planners.tree import new_tree
from sumo_mcts.scene import GREEN, RED, YELLOW, Follow

PASSES = [1, 7, 40, 400, 3000]


def children_of(grown: Grown, node: int) -> list[int]:
    return [int(i) for i in grown.tree.child[node] if i >= 0]


def check(grown: Grown) -> None:
    """What holds in every tree."""
    tree, used = grown.tree, int(grown.tree.used[0])
    assert tree.visits[0] == grown.done + grown.known
    for node in range(used):
        below = children_of(grown, node)
        assert all(tree.parent[i] == node and tree.level[i] == tree.level[node] + 1 for i in below)
        own = tree.visits[node] - sum(tree.visits[i] for i in below)
        assert (
            0 <= own <= (tree.visits[node] if tree.level[node] == grown.q.look_ahead else 2)
        )  # rollouts from the node itself, before it had children
        if node > 0 or grown.done + grown.known > 0:
            assert tree.visits[node] > 0
        if below and not own:
            assert tree.best[node] == min(tree.best[i] for i in below)
        assert all(tree.best[node] <= tree.best[i] for i in below)
        mean = tree.total[node] / tree.visits[node]
        assert 0.0 <= tree.best[node] <= mean + 1e-9
        assert np.all(tree.cost[node] >= 0.0) and (
            node == 0 or np.all(tree.cost[node] >= tree.cost[tree.parent[node]])
        )
        least = tree.cost[node].sum() + tree.least[node]
        assert tree.best[node] >= least - 1e-9
        known = (
            tree.best[0]
            if grown.q.adaptive and tree.best[0] < 0.5 * grown.task.cost.contact
            else math.inf
        )
        hopeless = least >= known
        spent = (
            grown.q.adaptive
            and tree.level[node] == grown.q.look_ahead
            and tree.visits[node] >= 3 + 4 * grown.q.rollout
        )
        over = tree.level[node] < grown.q.look_ahead and all(
            i == IMPOSSIBLE or (i >= 0 and tree.closed[i]) for i in tree.child[node]
        )
        assert bool(tree.closed[node]) >= bool(tree.end[node] != ALIVE or over or spent)
        assert bool(tree.closed[node]) <= bool(tree.end[node] != ALIVE or over or spent or hopeless)
        assert tree.end[node] == ALIVE or not below
    assert np.all(tree.child[tree.level == grown.q.look_ahead] == NONE)


@pytest.mark.parametrize("passes", PASSES)
@pytest.mark.parametrize("toy", TOYS.values(), ids=TOYS)
def test_every_tree(toy: Toy, passes: int) -> None:
    for grown in (grow(toy, passes), grow(steady(toy), passes)):
        assert grown.done + grown.known == passes or grown.tree.closed[0]
        check(grown)


agents = st.lists(
    st.tuples(st.integers(0, 2), st.floats(40.0, 220.0), st.floats(0.0, 15.0)), max_size=5
)


@given(agents, st.integers(0, 2), st.floats(0.0, 15.0), st.integers(0, 2**32 - 1))
@settings(max_examples=30)
def test_trees_of_any_scene(
    those: list[tuple[int, float, float]], lane: int, v: float, seed: int
) -> None:
    road = lanes_east(3, 900.0)
    check(
        grow(
            on_three_lanes(
                ego_at(road, f"a_{lane}", 100.0, v),
                *(Agent(f"v{k}", f"a_{i}", s, u) for k, (i, s, u) in enumerate(those)),
            ),
            200,
            seed,
        )
    )


@pytest.mark.parametrize("toy", TOYS.values(), ids=TOYS)
def test_more_passes_never_worsen_the_best(toy: Toy) -> None:
    best = [float(grow(toy, passes).tree.best[0]) for passes in (10, 50, 200, 1000, 4000)]
    assert best == sorted(best, reverse=True)


def test_the_same_seed_gives_the_same_tree_and_another_one_another() -> None:
    assert plain(grow(TOYS["traffic"], 500, 1)) == plain(grow(TOYS["traffic"], 500, 1))
    assert plain(grow(steady(TOYS["traffic"]), 500, 1)) == plain(
        grow(steady(TOYS["traffic"]), 500, 1)
    )
    assert any(
        plain(grow(steady(toy), 3000, 1)) != plain(grow(steady(toy), 3000, 2))
        for toy in TOYS.values()
    )


def test_a_search_in_pieces_is_the_search_in_one() -> None:
    """As a time budget does it."""
    whole = grow(TOYS["traffic"], 300)
    tree = new_tree(302, len(whole.actions), whole.q.look_ahead + whole.q.rollout, np.zeros((0, 2)))
    rng = np.random.Generator(np.random.PCG64(1))
    for passes in (100, 1, 199):
        search(
            tree,
            whole.local,
            whole.task.ego,
            whole.task.cost,
            whole.q,
            whole.actions,
            whole.root,
            passes,
            math.inf,
            rng,
        )
    # A pass that would be repeated with brakes at the border of a piece is not
    assert tree.visits[0] == whole.tree.visits[0]
    assert tree.best[0] == pytest.approx(whole.tree.best[0], rel=0.02)


def test_it_looks_most_where_it_is_best() -> None:
    grown = grow(TOYS["traffic"], 5000)
    below = sorted(children_of(grown, 0), key=lambda i: grown.tree.best[i])
    assert max(below, key=lambda i: grown.tree.visits[i]) in below[:3]
    assert grown.tree.visits[below[0]] > 2.0 * np.mean(grown.tree.visits[below])
    assert grown.tree.visits[below[-1]] < 0.5 * np.mean(grown.tree.visits[below])


# --- the same tree everywhere ---


@pytest.mark.slow
def test_without_compilation_the_tree_is_the_same_to_the_bit() -> None:
    run = subprocess.run(
        [sys.executable, helpers_tree.__file__, "--print"],
        env={
            **os.environ,
            "NUMBA_DISABLE_JIT": "1",
            "PYTHONPATH": os.pathsep.join([str(Path(helpers_tree.__file__).parent), *sys.path]),
        },
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    assert json.loads(run.stdout) == small_trees()


def test_the_golden_trees_grow_again() -> None:
    golden, now = json.loads(GOLDEN.read_text()), small_trees()
    assert list(golden) == list(now)
    for name, tree in now.items():
        expected, found = rough(golden[name]), rough(tree)
        assert found.pop("best") == pytest.approx(expected.pop("best"), rel=1e-9), (
            f"{name}: wanted? then .venv/bin/python tests/helpers_tree.py"
        )
        assert found == expected, name


SMALL = ("planner.look_ahead_steps=2", "planner.rollout_steps=2")  # leaves have many rollouts


def test_nothing_is_drawn_by_default() -> None:
    """The seed has no effect on a tree, but where rollouts are drawn."""
    toy = TOYS["traffic"]._replace(sets=SMALL)
    trees = [plain(grow(toy, 600, seed)) for seed in (1, 2, 3)]
    assert trees[0] == trees[1] == trees[2]
    drawn = [plain(grow(steady(toy), 600, seed)) for seed in (1, 1, 2)]
    assert drawn[0] == drawn[1] != drawn[2]


# --- decisions whose answer is known ---


def chosen(toy: Toy, *sets: str) -> tuple[float, int]:
    decision = decide(toy, *sets)
    child = decision.children[decision.chosen]
    return child.accel, child.lane_change


BLOCKED = on_three_lanes(None, Agent("w", "a_1", 140.0, 0.0), Agent("x", "a_0", 125.0, 4.0))


@pytest.mark.slow
@pytest.mark.parametrize(
    "toy", [TOYS["traffic"], TOYS["wall"], BLOCKED], ids=["traffic", "wall", "blocked"]
)
def test_a_mirrored_scene_gets_the_mirrored_decision(toy: Toy) -> None:
    """Values of the root's children, each with its lane change to the other side.

    Little exploration, so that they come to their end.
    """
    here, there = (
        decide(t, "planner.iterations=200000", "planner.adaptive=false", "planner.exploration=0.3")
        for t in (toy, mirrored(toy))
    )
    found = [
        {(c.accel, side * c.lane_change): c.best for c in d.children}
        for d, side in ((here, 1), (there, -1))
    ]
    assert found[0].keys() == found[1].keys()
    (accel, change), (accel_there, change_there) = (
        (d.children[d.chosen].accel, d.children[d.chosen].lane_change) for d in (here, there)
    )
    assert change_there == -change and accel_there == accel
    best = min(found[0].values())
    for action, value in found[0].items():
        assert found[1][action] == pytest.approx(value, rel=0.02, abs=0.02 * (1.0 + best)), action


@pytest.mark.parametrize("v", [0.0, 1.9, 2.1])
def test_a_slow_ego_drives_off_for_a_lane_change(v: float) -> None:
    decision = decide(on_three_lanes(ego_at(lanes_east(3, 900.0), "a_1", 100.0, v)))
    slow = {
        (c.accel, c.lane_change) for c in decision.children if c.lane_change != 0 and c.accel <= 0.0
    }
    assert bool(slow) == (v > 2.0) and {
        c.lane_change for c in decision.children if c.accel > 0.0
    } == {-1, 0, 1}


def test_who_is_held_at_the_end_of_a_lane_leaves_it_standing() -> None:
    lanes = [Lane("a", k, ((0.0, 3.2 * k), (300.0, 3.2 * k)), ("b_0",) * k) for k in range(2)]
    road = build([*lanes, Lane("b", 0, ((300.0, 3.2), (600.0, 3.2)))])
    toy = Toy(
        road, scene_of(ego_at(road, "a_0", 300.0, 0.0, route=edges(road, "a", "b")), road), ()
    )
    assert (
        any(c.accel <= 0.0 and c.lane_change == 1 for c in decide(toy).children)
        and chosen(toy)[1] == 1
    )


def test_round_a_standing_obstacle_by_the_free_lane() -> None:
    road = lanes_east(3, 900.0)
    beside = [Agent(f"b{k}", "a_0", 70.0 + 14.0 * k, 10.0) for k in range(9)]
    toy = on_three_lanes(ego_at(road, "a_1", 100.0, 10.0), Agent("w", "a_1", 140.0, 0.0), *beside)
    assert chosen(toy, "planner.iterations=3000")[1] == 1
    assert chosen(mirrored(toy), "planner.iterations=3000")[1] == -1


def drive(toy: Toy, cycles: int) -> Toy:
    """Let it drive: every half second the plan is carried out, and the others stand."""
    for _ in range(cycles):
        decision = decide(toy, "planner.iterations=400")
        assert isinstance(decision.command, Follow)
        plan = decision.plan
        k = min(4, len(plan.v) - 1)
        ego = toy.scene.ego
        before = float(plan.v[k - 1]) if k > 0 else ego.v
        x, y, c, n = (float(value) for value in plan.pose[k])
        change = ego._replace(
            x=x,
            y=y,
            heading=float(np.arctan2(n, c)),
            v=float(plan.v[k]),
            a=(float(plan.v[k]) - before) / 0.1,
            s=float(plan.s[k]),
            lane=int(plan.lane[k]),
        )
        toy = toy._replace(scene=toy.scene._replace(ego=change))
    return toy


def test_no_way_round_a_wall_so_it_stops_before_it() -> None:
    road = lanes_east(1, 900.0)
    wall = Agent("w", "a_0", 160.0, 0.0)
    scene = scene_of(ego_at(road, "a_0", 100.0, 10.0), road, wall)
    end = drive(
        Toy(road, scene._replace(agents=scene.agents._replace(standing_s=np.array([9.0])))), 40
    ).scene.ego
    assert end.v < 0.05 and 0.5 < 155.0 - end.s < 8.0
    assert chosen(TOYS["wall"], "planner.iterations=1000")[0] != 2.6


def test_it_stops_for_red_within_three_metres_of_the_line() -> None:
    end = drive(before_a_light(RED), 40).scene.ego
    assert end.v < 0.05 and 0.0 < 200.0 - end.s < 3.0


def test_it_does_not_brake_for_green() -> None:
    toy = before_a_light(GREEN)
    decision = decide(toy)
    assert np.min(decision.plan.v) >= 11.9 and decision.plan.v[-1] > 13.5
    assert drive(toy, 12).scene.ego.lane == 2


def test_where_everything_is_lost_it_brakes_as_hard_as_it_can() -> None:
    road = lanes_east(1, 900.0)
    toy = Toy(road, scene_of(ego_at(road, "a_0", 100.0, 14.0), road, Agent("w", "a_0", 112.0, 0.0)))
    decision = decide(toy)
    assert decision.reason == "brake"
    assert decision.plan.v[3] < 14.0 - 1.5
    grown = grow(toy, 3000)
    assert grown.tree.closed[0] and all(
        grown.tree.end[i] == LOST for i in children_of(grown, 0) if not children_of(grown, i)
    )


def test_where_every_way_ends_in_a_contact_the_root_dies() -> None:
    """People fill the road: they are no leaders, so that every action is tried."""
    people = [
        Agent(f"p{k}", "", x=109.0, y=3.2 * (k - 1), v=0.0, length=3.0, width=3.2) for k in range(3)
    ]
    grown = grow(on_three_lanes(ego_at(lanes_east(3, 900.0), "a_1", 100.0, 14.0), *people), 3000)
    assert grown.tree.closed[0] and len(children_of(grown, 0)) > 8
    check(grown)


def test_the_line_of_a_lane_change_leads_to_its_side() -> None:
    decision = decide(TOYS["free"], "planner.iterations=2000")
    sides = [(child.lane_change, float(child.poses[25, 1])) for child in decision.children]
    assert {side for side, _ in sides} == {-1, 0, 1}
    assert all(y * side > 2.0 if side else True for side, y in sides)


def test_the_plan_is_the_best_line_driven_again() -> None:
    """The chosen child's terms add up to its value, and its poses are the plan's."""
    for toy in TOYS.values():
        decision = decide(toy, "planner.iterations=500")
        child = decision.children[decision.chosen]
        assert child.best == min(c.best for c in decision.children)
        assert np.array_equal(child.poses, decision.plan.pose)
        assert (
            np.array_equal(decision.plan.v, decision.command.speeds)
            and decision.command.lane_change == child.lane_change
        )
        assert child.terms.sum() == pytest.approx(child.best, abs=1e-6)


def test_a_light_that_nobody_can_stop_for_is_passed() -> None:
    road = road_with_light()
    toy = Toy(
        road, scene_of(ego_at(road, "a_0", 192.0, 13.0, route=(0, 2)), road, signals=lights(RED))
    )
    assert np.min(decide(toy).plan.v) > 11.0


@pytest.mark.parametrize(
    ("shows", "needed", "passes"),
    [(RED, 5.0, False), (RED, 7.0, True), (YELLOW, 2.5, False), (YELLOW, 3.5, True)],
)
def test_who_comes_upon_red_brakes_harder_for_it_than_for_yellow(
    shows: int, needed: float, passes: bool
) -> None:
    """As who departs in front of a red light.

    `needed`: the braking that leads to a stand at the line, m/s2.
    """
    road = road_with_light()
    toy = Toy(
        road,
        scene_of(
            ego_at(road, "a_0", 200.0 - 121.0 / (2.0 * needed), 11.0, route=(0, 2)),
            road,
            signals=lights(shows),
        ),
    )
    plan = decide(toy).plan
    assert (np.flatnonzero(plan.lane == 0)[-1] + 1 < len(plan.lane)) == passes
    assert passes == (plan.v[9] > 9.5)


def test_the_last_plan_is_carried_on_where_it_is_no_worse() -> None:
    """Half a period later, in the state that was planned, with one pass only: what was found before
    is not lost."""
    toy = TOYS["traffic"]
    config = scenario("planner.iterations=3000")
    task = task_of(toy.road, toy.scene.ego, config)
    planner = make_planner(config)
    assert isinstance(planner, MctsPlanner)
    planner.start(task, 1)
    first = planner.plan(situation_of(task, toy.scene))
    plan, k = first.plan, 4
    x, y, c, n = (float(value) for value in plan.pose[k])
    v, s, lane = float(plan.v[k]), float(plan.s[k]), int(plan.lane[k])
    ego = toy.scene.ego._replace(
        x=x,
        y=y,
        heading=float(np.arctan2(n, c)),
        v=v,
        a=(v - float(plan.v[k - 1])) / 0.1,
        s=s,
        lane=lane,
    )
    assert (
        first.children[first.chosen].lane_change == 0
    )  # the clock of a lane change is none of a plan's business
    agents = toy.scene.agents
    later = toy.scene._replace(
        time=0.5,
        ego=ego,
        agents=agents._replace(x=agents.x + 0.5 * agents.v, s=agents.s + 0.5 * agents.v),
    )
    situation = situation_of(task, later)
    planner._params = planner._params._replace(budget=Budget(1, 1, 0.0))
    second = planner.plan(situation)
    assert second.reason == "carried on"
    assert second.plan.v[:70] == pytest.approx(plan.v[5:75], abs=0.3)
    fresh = make_planner(config)
    fresh.start(task, 1)
    assert fresh.plan(situation).reason == "search"
