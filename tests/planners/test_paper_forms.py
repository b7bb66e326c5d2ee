"""The other forms of the paper's costs that its text names, each against its formula worked out by
hand, and its other criteria of termination."""

import math
from typing import Any

import numpy as np
import pytest
from helpers import Agent, Lane, build, edges, ego_at
from helpers_model import (
    lanes_east,
    local_of,
    plain,
    scenario,
    scene_of,
    situation_of,
    task_of,
)
from helpers_tree import Toy, on_three_lanes

from sumo_mcts.model.local_map import ELSEWHERE, NODE, LocalMap, State, V
from sumo_mcts.model.motion import EgoParams, pose_of
from sumo_mcts.numerics.geometry import COS, SIN, X, Y
from sumo_mcts.planners import paper, paper_cost, paper_search
from sumo_mcts.planners.paper_search import new_tree
from sumo_mcts.planners.ply import ALIVE, ARRIVED, IMPOSSIBLE, LOST
from sumo_mcts.road import STOP, RoadMap
from sumo_mcts.scene import Decision

HERE = 100.0  # m: the ego's front
forms = {
    name: getattr(getattr(paper_cost, name), "py_func", getattr(paper_cost, name))
    for name in ("safety", "comfort", "passability", "other", "lane_change", "nearest")
}


class View:
    """An ego on the first lane of a road, others, and what the settings of `paper` make of them."""

    local: LocalMap
    state: State
    p: EgoParams

    def __init__(self, road: RoadMap, v: float, *others: Agent, **keys: Any) -> None:
        self.config = scenario("planner.name=paper", paper=keys)
        route = edges(road, *(e for e in dict.fromkeys(road.edge_ids) if e[0] != ":"))
        ego = ego_at(road, road.lane_ids[0], HERE, v, route=route)
        self.task = task_of(road, ego, self.config)
        self.local, self.state = local_of(self.task, scene_of(ego, road, *others))
        self.p, self.w = self.task.ego, paper.weights_of(self.config, 0.1)

    def safety(self) -> float:
        return float(forms["safety"](self.local, self.p, self.w, self.state, 0.0))

    def guide(self) -> paper.Guide:
        p = self.config.paper
        return paper.guide_of(self.task, self.state, p.goal_distance_m, p.lane_distance_m)


def ahead(gap: float, v: float, lane: str = "a_0") -> Agent:
    """A car of 5 m whose rear is `gap` m before the ego's front."""
    return Agent("x", lane, HERE + gap + 5.0, v=v, length=5.0)


# --- C_s with relative velocity, and by the type of road ---


@pytest.mark.parametrize(("v", "closing"), [(10.0, 0.0), (4.0, 6.0), (14.0, 0.0), (0.0, 10.0)])
def test_relative_velocity_makes_a_distance_dearer(v: float, closing: float) -> None:
    """C_s = (1 + closing / v_0) / d, omega_s = 10, d = 4 m, v_0 = 5 m/s; who falls back or leaves
    costs what the distance does."""
    road = lanes_east(1)
    plain = View(road, 10.0, ahead(4.0, v)).safety()
    assert plain == pytest.approx(10.0 / 4.0)
    found = View(road, 10.0, ahead(4.0, v), closing_speed_mps=5.0).safety()
    assert found == pytest.approx((1.0 + closing / 5.0) * 10.0 / 4.0)


@pytest.mark.parametrize("moved", [(0.0, 0.0), (300.0, -200.0)])
@pytest.mark.parametrize(
    ("its", "closing"),
    [
        ((0.0, -4.0), 10.0 * 0.6 + 4.0 * 0.8),
        ((0.0, 4.0), 10.0 * 0.6 - 4.0 * 0.8),
        ((10.0, 0.0), 0.0),
    ],
)
def test_velocities_count_along_the_line_between_two_bodies(
    its: tuple[float, float], closing: float, moved: tuple[float, float]
) -> None:
    """Somebody is 6 m ahead of the middle of the ego and 8 m to its left; wherever the road lies."""
    view = View(lanes_east(1), 10.0, ahead(40.0, 0.0), closing_speed_mps=5.0)
    speed = math.hypot(*its)
    row = view.local.agent[0, 0]
    row[[X, Y, V]] = HERE - 2.5 + 6.0, 8.0, speed
    row[[COS, SIN]] = its[0] / speed, its[1] / speed
    view.local.row[:, [X, Y]] += moved
    view.local.agent[:, :, [X, Y]] += moved
    found = forms["nearest"](view.local, view.p, view.state, 0.0, False)[1]
    assert found == pytest.approx(max(0.0, closing))


@pytest.mark.parametrize(("limit", "gap", "counts"), [
    (15.0, 9.0, True), (15.0, 11.0, False), (30.0, 11.0, True), (30.0, 24.0, True),
    (30.0, 26.0, False),
])  # fmt: skip
def test_a_highway_may_have_a_threshold_of_its_own(limit: float, gap: float, counts: bool) -> None:
    view = View(lanes_east(1, speed=limit), 10.0, ahead(gap, 10.0), highway_threshold_m=25.0)
    assert view.safety() == pytest.approx(10.0 / gap if counts else 0.0)
    alike = View(lanes_east(1, speed=limit), 10.0, ahead(gap, 10.0))
    assert alike.safety() == pytest.approx(10.0 / gap if gap <= 10.0 else 0.0)


# --- C_c with lateral acceleration ---


@pytest.mark.parametrize("factor", [0.0, 0.5])
def test_lateral_acceleration_adds_to_comfort(factor: float) -> None:
    """A quarter of a circle of 30 m at 10 m/s: v^2 / r = 3.33 m/s2, without any jerk."""
    angles = np.radians(np.arange(0.0, 90.1, 2.0))
    bend = zip(HERE + 30.0 * np.sin(angles), 30.0 * (1.0 - np.cos(angles)), strict=True)
    road = build([Lane("a", 0, ((0.0, 0.0), *((float(x), float(y)) for x, y in bend)))])
    view = View(road, 10.0, lateral_factor=factor)
    began, after = (view.state._replace(s=s, a=0.0) for s in (110.0, 120.0))
    found = forms["comfort"](view.local, view.p, view.w, began, after)
    assert found == pytest.approx(factor * (100.0 / 30.0) ** 2, rel=0.02)
    jerky = forms["comfort"](view.local, view.p, view.w, began, after._replace(a=2.0))
    assert jerky == pytest.approx(found + 0.1 * 2.0**2)
    dearer = view.w._replace(comfort=3.0 * view.w.comfort)
    assert forms["comfort"](view.local, view.p, dearer, began, after) == pytest.approx(3.0 * found)


# --- C_p by the way or the straight line ---


def test_the_local_goal_is_so_far_along_the_route_or_in_a_straight_line() -> None:
    """A road that turns by a right angle 60 m ahead: the local goal, 100 m down the route, is
    72 m away. The box's middle counts, 2.5 m behind its front, for both."""
    corner = ((0.0, 0.0), (160.0, 0.0), (160.0, 300.0))
    road = build([Lane("a", 0, corner)])
    costs = {}
    for along in ("route", "line"):
        view = View(road, 10.0, goal_along=along)
        costs[along] = forms["passability"](view.local, view.p, view.w, view.guide(), view.state)
    assert costs["route"] == pytest.approx(100.0)
    assert costs["line"] == pytest.approx(math.hypot(62.5, 37.5), abs=1.0)


def test_on_a_straight_road_both_are_the_same() -> None:
    road = lanes_east(2)
    for s in (HERE, HERE + 40.0):
        found = [
            forms["passability"](v.local, v.p, v.w, v.guide(), v.state._replace(s=s))
            for v in (View(road, 10.0, goal_along=along) for along in ("route", "line"))
        ]
        assert found[0] == pytest.approx(found[1], abs=1e-6) == pytest.approx(HERE + 100.0 - s)


# --- C_o of a bypass, and of stopping at a stop sign ---


@pytest.mark.parametrize(("gap", "v", "lane", "bypass"), [
    (10.0, 0.0, "a_0", True), (30.0, 7.0, "a_0", True), (10.0, 8.0, "a_0", False),
    (45.0, 0.0, "a_0", False), (10.0, 0.0, "a_1", False), (-20.0, 0.0, "a_0", False),
])  # fmt: skip
def test_a_lane_change_away_from_somebody_slow_is_a_bypass(
    gap: float, v: float, lane: str, bypass: bool
) -> None:
    """The limit is 15 m/s, and half of it is slow; 40 m are in sight."""
    view = View(lanes_east(2), 10.0, ahead(gap, v, lane), bypass_cost=3.0)
    found = forms["lane_change"](view.local, view.w, view.state, 0.0)
    assert found == pytest.approx(1.0 + (3.0 if bypass else 0.0))


@pytest.mark.parametrize(("s", "v", "cost"), [
    (198.0, 0.0, 9.0), (198.0, 1.0, 0.0), (190.0, 0.0, 2.0),
])  # fmt: skip
def test_standing_at_a_stop_sign_has_a_cost_of_its_own(s: float, v: float, cost: float) -> None:
    road = build([
        Lane("a", 0, ((0.0, 0.0), (200.0, 0.0)), (":m_0",)),
        Lane(":m", 0, ((200.0, 0.0), (210.0, 0.0)), ("b_0",), junction="m", rule=STOP),
        Lane("b", 0, ((210.0, 0.0), (410.0, 0.0))),
    ])  # fmt: skip
    view = View(road, 5.0, stop_sign_cost=7.0)
    state = view.state._replace(s=s, v=v)
    found = forms["other"](view.local, view.p, view.w, view.guide(), state, 0.0)
    assert found == pytest.approx(cost)


# --- Algorithm 1 ---


def decided(toy: Toy, passes: int, *sets: str) -> tuple[Decision, paper.PaperTree]:
    """A decision with seed 1, and its tree."""
    trees: list[paper.PaperTree] = []

    class Watched(paper.PaperPlanner):
        def _decision(self, tree: paper.PaperTree, *rest: Any) -> Decision:
            trees.append(tree)
            return super()._decision(tree, *rest)

    config = scenario("planner.name=paper", f"planner.iterations={passes}", *sets)
    planner = Watched(config)
    task = task_of(toy.road, toy.scene.ego, config)
    planner.start(task, 1)
    return planner.plan(situation_of(task, toy.scene)), trees[0]


def test_by_the_other_reading_a_pass_that_finds_a_collision_ends_there() -> None:
    """A wall 8 m ahead: keeping the speed collides, so the root's expansion finds a collision. By
    Algorithm 1's `continue` that pass counts as an iteration and is backed up nowhere."""
    wall = on_three_lanes(None, Agent("x", "a_1", 113.0, v=0.0))
    for passes in (1, 2, 3):
        _, plain = decided(wall, passes)
        _, skipping = decided(wall, passes, "paper.collided=skip")
        assert (plain.visits[0], plain.visits[0] > 0) == (passes, True)
        assert skipping.visits[0] < passes
    _, free = decided(on_three_lanes(), 40, "paper.collided=skip")
    assert free.visits[0] == 40


@pytest.mark.parametrize("patience", [20, 100])
def test_the_search_ends_when_nothing_has_changed_for_so_long(patience: int) -> None:
    toy = on_three_lanes(None, Agent("x", "a_1", 130.0, v=6.0))
    settled, _ = decided(toy, 5000, f"paper.settled_after={patience}")
    assert patience < settled.iterations < 5000
    for before in (0, patience):  # what would have been decided then, too
        alike, _ = decided(toy, settled.iterations - before)
        assert alike.children[alike.chosen].accel == settled.children[settled.chosen].accel


# --- the readings of the published program ---


def bare(visits: tuple[int, ...], totals: tuple[float, ...]) -> paper.PaperTree:
    """A root with 100 visits and one child, which has 10, and children of its own."""
    tree = new_tree(2 + len(visits), len(visits))
    tree.used[0], tree.visits[0], tree.visits[1] = 2 + len(visits), 100, 10
    tree.child[0] = IMPOSSIBLE
    tree.child[0, 0], tree.parent[1] = 1, 0
    for k, (n, total) in enumerate(zip(visits, totals, strict=True)):
        tree.child[1, k], tree.parent[2 + k] = 2 + k, 1
        tree.visits[2 + k], tree.total[2 + k] = n, total
    return tree


@pytest.mark.parametrize(("of", "visits"), [("parent", 10), ("root", 100)])
def test_n_counts_the_visits_of_the_parent_or_of_the_root(of: str, visits: int) -> None:
    w = paper.weights_of(scenario(f"paper.visits_of={of}", "paper.exploration=5"), 0.1)
    found = plain(paper_search.bound)(bare((4, 6), (8.0, 6.0)), w, 1, 2)
    assert found == pytest.approx(-2.0 + 5.0 * math.sqrt(2.0 * math.log(visits) / 4.0))


def test_a_dead_end_may_count_as_free() -> None:
    """Where every child of a node was discarded; a node that is left or ends is none."""
    dead = plain(paper_search._is_dead_end)
    tree = bare((0, 0), (0.0, 0.0))
    assert not dead(tree, 1) and not dead(tree, 2)  # children that are left, and no children yet
    tree.end[2] = LOST
    assert not dead(tree, 1)
    tree.child[1, 1] = IMPOSSIBLE
    assert dead(tree, 1)
    tree.end[1] = ARRIVED
    assert not dead(tree, 1)


def test_a_dead_end_is_backed_up_as_a_cost_of_nothing() -> None:
    """Three walls that nothing can stop before: the root is a dead end, so each pass costs 0."""
    ego = ego_at(lanes_east(3), "a_1", HERE, 14.0)
    walls = [Agent(f"w{k}", f"a_{k}", HERE + 6.5, v=0.0) for k in range(3)]
    toy = on_three_lanes(ego, *walls)
    totals = {}
    for way in ("rollout", "free"):
        decision, tree = decided(toy, 9, f"paper.dead_end={way}")
        assert decision.reason == "brake" and tree.visits[0] == 9
        totals[way] = float(tree.total[0])
    assert totals["free"] == 0.0 and totals["rollout"] >= 9 * 10_000


def test_j_may_be_that_of_the_last_step_alone() -> None:
    """Nobody is near and the ego keeps its speed, so the costs are distances: the sum is of 90, 80
    and 70 m, the last is 70 m."""
    toy = on_three_lanes(ego_at(lanes_east(3), "a_1", HERE, 10.0))
    for way, cost in (("each", 90.0 + 80.0 + 70.0), ("last", 70.0)):
        sets = ("paper.accelerations_mps2=[0]", "paper.lane_change_accelerations_mps2=[0]",
                "paper.brake_probability=0", "paper.accelerate_probability=0")  # fmt: skip
        _, tree = decided(toy, 1, f"paper.counted={way}", *sets)
        assert tree.total[0] == pytest.approx(cost)
        # without a rollout J is that of the tree's last step: a pass that only expands the root
        _, tree = decided(
            toy, 1, f"paper.counted={way}", "paper.rollout_steps=0", "paper.look_ahead_steps=2",
            *sets,
        )  # fmt: skip
        deepest = int(tree.level[: tree.used[0]].argmax())
        path = [deepest]
        while tree.parent[path[-1]] > 0:
            path.append(int(tree.parent[path[-1]]))
        steps = [90.0, 80.0][: len(path)]
        assert tree.cost[deepest].sum() == pytest.approx(sum(steps) if way == "each" else steps[-1])


def test_the_choice_may_be_that_of_the_highest_bound() -> None:
    """Means 10, 11, 12 after 10, 6 and 4 visits: with const = 5 the bound is the highest for the
    last one, whose mean is the worst (test_the_equation_of_the_upper_confidence_bound)."""
    tree = new_tree(4, 3)
    tree.visits[:], tree.total[1:4] = (20, 10, 6, 4), (100.0, 66.0, 48.0)
    tree.child[0], tree.parent[1:] = (1, 2, 3), 0
    w = paper.weights_of(scenario("paper.exploration=5"), 0.1)
    assert [paper._best(tree, w, choice) for choice in ("mean", "ucb")] == [0, 2]
    tree.end[3] = LOST
    assert paper._best(tree, w, "ucb") == 1
    toy, taken = on_three_lanes(None, Agent("x", "a_1", 130.0, v=6.0)), []
    w = paper.weights_of(scenario("paper.exploration=50"), 0.1)
    for choice in ("mean", "ucb"):
        decision, grown = decided(toy, 20, f"paper.choice={choice}", "paper.exploration=50")
        taken.append(decision.chosen)
        best = [int(i) for i in grown.child[0]][paper._best(grown, w, choice)]
        chosen = decision.children[decision.chosen]
        assert (chosen.visits, chosen.mean) == (
            grown.visits[best], pytest.approx(grown.total[best] / grown.visits[best])
        )  # fmt: skip
    assert taken[0] != taken[1]


@pytest.mark.parametrize(("turn", "aligned", "end"), [
    (45.0, "turned", ALIVE), (45.0, "aligned", LOST), (0.0, "aligned", ALIVE),
    (90.0, "aligned", ALIVE),
])  # fmt: skip
def test_contact_may_be_between_upright_boxes(turn: float, aligned: str, end: int) -> None:
    """Half a car of 5 m by 1.8 m, turned by 45 degrees, is 2.40 m wide and high in its upright box:
    with its middle 4.5 m ahead and 2.9 m aside that one meets the ego's, the car itself does not,
    and neither does one that stands along an axis of the world."""
    car = Agent("x", "", x=0.0, y=300.0, width=1.8, length=5.0)
    view = View(lanes_east(1), 0.0, car, contact_boxes=aligned)
    x, y, _, _ = plain(pose_of)(view.local, view.p, view.state)
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    view.local.agent[:, 0, [X, Y, COS, SIN, NODE]] = x + 4.5, y + 2.9, c, s, ELSEWHERE
    if turn == 90.0:
        view.local.agent[:, 0, Y] += 1.0  # it is higher now
    w, accel = view.w, 0.0
    found = plain(paper_search.one_ply)(view.local, view.p, w, view.state, accel, view.guide(), 0)
    assert found[2] == end
    upright, itself = (
        plain(paper_cost.nearest)(view.local, view.p, view.state, 0.0, each)[0]
        for each in (True, False)
    )
    assert upright == itself or (turn == 45.0 and upright == 0.0 < itself)
