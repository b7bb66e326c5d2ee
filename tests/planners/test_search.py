"""The passes of planner `mcts`: what a new child holds, which is left out, and how passes are
counted. One action is replaced by one with known costs; tests/planners/test_ply.py has that."""

import math
from typing import Any

import numpy as np
import pytest
from helpers import ego_at
from helpers_model import lanes_east, local_of, plain, scenario, scene_of, task_of

from sumo_mcts.driver.params import cost_params
from sumo_mcts.model.interaction import Neighbours
from sumo_mcts.model.local_map import State
from sumo_mcts.planners import ply, search, tree
from sumo_mcts.planners.ply import ALIVE, ARRIVED, IMPOSSIBLE, LOST, NONE, SearchParams

C = cost_params(scenario())
Q = SearchParams(6, 2, 1, 2, 3, 0.5, 8.0, adaptive=False, each=False)
ADAPTIVE = Q._replace(adaptive=True)
# acceleration, side, whether it is tried below the root too
ACTIONS = np.array([[-2.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.5, 1.0, 1.0], [0.0, -1.0, 1.0]])
NEAR = Neighbours(42.0, 7.0, 3)
expand, passes = plain(search._expand), plain(search.search)


class World:
    """A tree with its root; actions cost 1, 2, 3 and 4, and lead one metre for each acceleration."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, free: bool = True) -> None:
        road = lanes_east(3, 900.0)
        ego = ego_at(road, "a_1", 100.0, 10.0)
        task = task_of(road, ego)
        self.p, (self.local, self.root) = task.ego, local_of(task, scene_of(ego, road))
        self.tree = tree.new_tree(30, len(ACTIONS), 5, np.zeros((0, 2)))
        tree.store(self.tree, 0, self.root, NEAR)
        self.tree.used[0] = 1
        self.asked: list[tuple[float, int, int]] = []
        self.times: list[tuple[float, ...]] = []
        self.end, self.least, self.far = ALIVE, 0.0, 1.0
        monkeypatch.setattr(search, "simulate", self.simulate)
        monkeypatch.setattr(search, "may_change", self.may_change)
        monkeypatch.setattr(search, "least_cost", self.least_cost)
        self.free = free

    def simulate(self, *those: Any) -> ply.Ply:
        state, near, action, at = those[4], *those[6:9]
        assert tuple(near) == tuple(NEAR)
        self.asked.append((action.accel, action.side, at))
        after = state._replace(s=state.s + self.far * action.accel, v=10.0)
        return ply.Ply(after, NEAR, 1.0, 2.0, 3.0, 4.0, self.end, 50.0)

    def may_change(self, *those: Any) -> bool:
        self.times.append((those[5], those[6], those[7], those[8]))
        return self.free

    def least_cost(self, local: Any, p: Any, c: Any, state: State, time: float, horizon: float) -> float:  # fmt: skip
        self.times.append((time, horizon))
        return self.least

    def expand(self, node: int = 0, q: SearchParams = Q, times: int = 1) -> list[int]:
        return [
            int(expand(self.tree, self.local, self.p, C, q, ACTIONS, node, math.inf))
            for _ in range(times)
        ]


def test_actions_are_tried_one_after_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(monkeypatch)
    made = world.tree
    assert world.expand(times=5) == [1, 2, 3, 4, IMPOSSIBLE]
    assert world.asked == [(-2.0, 0, 0), (1.0, 0, 0), (0.5, 1, 0), (0.0, -1, 0)]
    assert world.times == [(1, 0.5, 0.0, math.inf), (-1, 0.0, 0.0, math.inf)]
    assert made.child[0].tolist() == [1, 2, 3, 4] and made.parent[1:5].tolist() == [0] * 4
    assert made.level[1:5].tolist() == [1] * 4 and made.end[1:5].tolist() == [ALIVE] * 4
    assert made.cost[1:3].tolist() == [[1.0, 2.0, 3.0, 4.0]] * 2
    assert made.cost[3:5].tolist() == [[1.0, 2.0, 3.0, 4.6]] * 2  # and a lane change of 0.6
    assert made.motion[1:5, 0].tolist() == [98.0, 101.0, 100.5, 100.0]
    assert made.where[1:5].tolist() == [[1, -1], [1, -1], [1, 2], [1, 0]]
    assert made.leader[1].tolist() == [42.0, 7.0] and made.followers[1] == 3
    assert not made.least[:5].any() and np.all(np.isinf(made.best[:5]))


def test_below_the_root_only_some_are_tried_and_costs_add_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = World(monkeypatch)
    world.expand()
    world.asked.clear()
    world.times.clear()
    assert world.expand(1, times=4) == [2, IMPOSSIBLE, 3, 4]
    assert world.asked == [(-2.0, 0, 6), (0.5, 1, 6), (0.0, -1, 6)]  # after six steps of 0.1 s
    assert [time for *_, time, _ in world.times] == pytest.approx([0.6, 0.6])
    made = world.tree
    assert made.cost[2].tolist() == [2.0, 4.0, 6.0, 8.0] and made.cost[3, 3] == 8.6
    assert made.level[2:5].tolist() == [2] * 3 and made.parent[2:5].tolist() == [1] * 3


def test_a_change_that_may_not_begin_is_no_child(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(monkeypatch, free=False)
    assert world.expand(times=4) == [1, 2, IMPOSSIBLE, IMPOSSIBLE] and len(world.asked) == 2


def test_what_leads_to_the_same_state_is_left_out_but_a_lane_change(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = World(monkeypatch)
    world.far = 0.0
    assert world.expand(times=4) == [1, IMPOSSIBLE, 2, 3]
    known, state = plain(tree.is_known), world.root
    assert known(world.tree, 0, 1, state) and not known(world.tree, 0, 0, state)
    for other in (
        state._replace(node=0), state._replace(other=2), state._replace(s=100.1),
        state._replace(v=10.1), state._replace(a=0.1), state._replace(s=99.9),
        state._replace(v=9.9), state._replace(a=-0.1),
    ):  # fmt: skip
        assert not known(world.tree, 0, 1, other)


def test_who_reacts_goes_on_from_where_the_parent_left_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each action moves it on by one."""
    world = World(monkeypatch)
    world.tree = tree.new_tree(30, len(ACTIONS), 5, np.array([[10.0, 5.0]]))
    tree.store(world.tree, 0, world.root, NEAR)
    world.tree.used[0] = 1
    usual = world.simulate

    def moving(*those: Any) -> ply.Ply:
        those[5][:] += 1.0
        return usual(*those)

    monkeypatch.setattr(search, "simulate", moving)
    world.expand(times=2)
    world.expand(1)
    assert world.tree.others[:4, 0].tolist() == [[10.0, 5.0], [11.0, 6.0], [11.0, 6.0], [12.0, 7.0]]


@pytest.mark.parametrize("end", [LOST, ARRIVED])
def test_a_child_that_ends_has_its_value(end: int, monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(monkeypatch)
    world.end = end
    world.expand(q=ADAPTIVE)
    assert (world.tree.end[1], world.tree.best[1]) == (end, 60.0) and world.times == []


def test_what_cannot_become_the_best_is_left_out_below_the_root(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two actions cost 20, and at least 2.5 more from there on, 1.2 s from now."""
    world = World(monkeypatch)
    world.least = 2.5
    world.expand(q=ADAPTIVE)
    assert world.times == [(pytest.approx(0.6), 8.0)] and world.tree.least[1] == 2.5
    for best, child in ((22.4, IMPOSSIBLE), (22.6, 2)):
        world.tree.best[0] = best
        world.tree.child[1] = NONE
        assert world.expand(1, ADAPTIVE) == [child]
    assert world.times[-1] == (pytest.approx(1.2), 8.0)
    world.tree.best[0] = 3.0
    assert world.expand(0, ADAPTIVE) == [3]  # at the root every action is tried
    world.tree.best[0] = 23.0
    world.tree.child[1, 1:] = NONE
    assert world.expand(1, ADAPTIVE, 2) == [IMPOSSIBLE, IMPOSSIBLE]  # 0.6 more: 23.1


class Passes(World):
    """The search itself, with rollouts of known costs."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *costs: float) -> None:
        super().__init__(monkeypatch)
        self.costs, self.nodes, q = list(costs), [], Q
        self.q = q
        monkeypatch.setattr(search, "_rollout", self.rollout)

    def rollout(self, *those: Any) -> float:
        self.nodes.append(those[5])
        return self.costs[min(len(self.nodes), len(self.costs)) - 1]

    def run(self, iterations: int, q: SearchParams = Q, beat: float = math.inf) -> tuple[int, int]:
        rng = np.random.default_rng(1)
        return passes(self.tree, self.local, self.p, C, q, ACTIONS, self.root, iterations, beat, rng)  # fmt: skip


def test_every_first_action_is_followed_up_by_braking(monkeypatch: pytest.MonkeyPatch) -> None:
    world = Passes(monkeypatch, 20.0)
    assert world.run(8) == (8, 0)
    assert world.nodes == [1, 1, 2, 2, 3, 3, 4, 4] and world.tree.visits[0] == 8
    assert world.tree.total[0] == 160.0 and world.tree.best[0] == 20.0
    assert world.run(1) == (1, 0) and world.nodes[8:] == [5]  # below them only once
    assert world.tree.level[5] == 2


def test_further_below_only_where_following_led_to_a_contact(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A contact costs 30 at least; a known number of passes ends it in any case."""
    for cost, nodes in ((31.0, [5, 5]), (29.0, [5, 6])):
        world = Passes(monkeypatch, *[20.0] * 8, cost)
        world.run(8)
        assert world.run(2) == (2, 0)
        assert [world.tree.level[i] for i in world.nodes[8:]] == [2, 2]
        assert (world.nodes[8] == world.nodes[9]) == (nodes == [5, 5])
    odd = Passes(monkeypatch, 20.0)
    assert odd.run(3) == (3, 0) and odd.nodes == [1, 1, 2]


@pytest.mark.parametrize("end", [LOST, ARRIVED])
def test_ends_are_known_without_a_rollout_and_close_the_tree(
    end: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = Passes(monkeypatch, 20.0)
    world.end = end
    assert world.run(100) == (0, 4) and world.nodes == []
    made = world.tree
    assert made.closed[:5].all() and made.visits[:5].tolist() == [4, 1, 1, 1, 1]
    assert made.best[0] == 60.0 and made.total[0] == 2 * 60.0 + 2 * 60.6
    assert world.run(5) == (0, 0)


def test_a_leaf_closes_when_all_its_continuations_were_driven(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With one level: 3 and 4 for each of 3 further levels are 15."""
    world = Passes(monkeypatch, 20.0)
    q = ADAPTIVE._replace(look_ahead=1)
    assert world.run(1000, q) == (60, 0) and world.tree.closed[0]
    assert world.tree.visits[:5].tolist() == [60, 15, 15, 15, 15]
    open_ended = Passes(monkeypatch, 20.0)
    assert open_ended.run(200, Q._replace(look_ahead=1)) == (200, 0)
    assert not open_ended.tree.closed.any()


def test_a_full_tree_ends_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    world = Passes(monkeypatch, 20.0)
    world.tree.used[0] = 28
    assert world.run(100) == (4, 0) and world.nodes == [28, 28, 29, 29]


def test_a_new_tree_is_planted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    world, planted = Passes(monkeypatch, 20.0), []

    def meet(*those: Any) -> Any:
        planted.append(those[6])
        return ply.meet(*those)._replace(near=NEAR)

    monkeypatch.setattr(search, "meet", plain(meet))
    world.tree.used[0] = 0
    world.run(2)
    assert planted == [0] and world.tree.used[0] == 2
    assert world.tree.motion[0, 0] == 100.0 and world.tree.leader[0].tolist() == [42.0, 7.0]
    world.run(2)
    assert planted == [0]


def test_only_children_that_were_made_are_compared() -> None:
    """Of a full tree: the numbers that stand for no child would count from its end."""
    full = tree.new_tree(3, 3, 2, np.zeros((0, 2)))
    full.child[0] = NONE, IMPOSSIBLE, NONE
    road = lanes_east(3, 900.0)
    ego = ego_at(road, "a_1", 100.0, 10.0)
    _, state = local_of(task_of(road, ego), scene_of(ego, road))
    for i in (1, 2):
        tree.store(full, i, state, NEAR)
    assert not plain(tree.is_known)(full, 0, 3, state)
    full.child[0, 0] = 1
    assert plain(tree.is_known)(full, 0, 3, state)


@pytest.mark.parametrize(("exploration", "chosen"), [(0.58, 1), (0.63, 2)])
def test_values_are_scaled_by_the_open_children_alone(exploration: float, chosen: int) -> None:
    """Two children cost 2 and 4, 0 and 1 on that scale, and were visited 9 times and once: the
    second one is better from 1 / (sqrt(2 ln 21) - sqrt(2 ln 21 / 9)) = 0.608 on. A third one is
    closed, a fourth impossible, and both cost more."""
    grown = tree.new_tree(6, 4, 3, np.zeros((0, 2)))
    grown.child[0] = 1, 2, 3, IMPOSSIBLE
    grown.level[1:4], grown.visits[:4] = 1, (20, 9, 1, 9)
    grown.best[:4], grown.closed[3] = (2.0, 2.0, 4.0, 90.0), True
    grown.best[4:] = 200.0
    q = Q._replace(look_ahead=1, exploration=exploration)
    assert plain(search._select)(grown, C, q, math.inf) == chosen
