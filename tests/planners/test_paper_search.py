"""Algorithms 1 and 2 of the paper against small trees worked out by hand, and a second
implementation of the tree policy."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers import ego_at, lights
from helpers_model import (
    lanes_east,
    local_of,
    plain,
    road_with_light,
    scenario,
    scene_of,
    situation_of,
    task_of,
)

from sumo_mcts.arrays import Floats
from sumo_mcts.model.local_map import LocalMap, State, keep_state
from sumo_mcts.model.motion import GOAL, OFF_END, RED_LINE
from sumo_mcts.planners import paper, paper_search
from sumo_mcts.planners.base import Situation
from sumo_mcts.planners.budget import SLICE
from sumo_mcts.planners.paper import LOOK_SLICE
from sumo_mcts.planners.paper_cost import Guide, Weights
from sumo_mcts.planners.paper_search import PaperTree, new_tree
from sumo_mcts.planners.ply import ALIVE, ARRIVED, IMPOSSIBLE, LOST, NONE
from sumo_mcts.scene import GREEN, OTHER

W = paper.weights_of(scenario("planner.name=paper"), 0.1)
GUIDE = Guide(5000.0, 0.0, 0.0, np.zeros(3), *[np.zeros(3, np.bool_)] * 2)
FIRST = SimpleNamespace(random=lambda: 0.99)  # draws the first of the unvisited
select, rollout = plain(paper_search._select), plain(paper_search._rollout)
expand, search = plain(paper_search.expand), plain(paper_search.search)


def view(lane: str = "a_1", v: float = 10.0) -> tuple[Any, LocalMap, State]:
    """The ego on one of three lanes, alone."""
    road = lanes_east(3, 900.0)
    ego = ego_at(road, lane, 100.0, v)
    task = task_of(road, ego)
    return task.ego, *local_of(task, scene_of(ego, road))


def child(tree: PaperTree, node: int, k: int, visits: int, mean: float) -> int:
    """A new child with so many visits and this mean cost."""
    i = int(tree.used[0])
    tree.used[0] += 1
    tree.child[node, k], tree.parent[i], tree.level[i] = i, node, tree.level[node] + 1
    tree.visits[i], tree.total[i] = visits, visits * mean
    return i


# --- the tree policy ---


def test_n_is_the_number_of_visits_of_the_parent_not_of_the_root() -> None:
    """The root has 10 000 visits, its only child 10. Below that, with const = 5:

    -10.0 + 5 sqrt(2 ln 10 / 6) = -5.62 is more than -11.2 + 5 sqrt(2 ln 10 / 4) = -5.84. With ln
    10000 it would be -1.24 against -0.47.
    """
    tree = new_tree(6, 2)
    tree.used[0], tree.visits[0] = 1, 10_000
    only = child(tree, 0, 0, 10, 10.0)
    tree.child[0, 1] = IMPOSSIBLE
    a, b = child(tree, only, 0, 6, 10.0), child(tree, only, 1, 4, 11.2)
    w = W._replace(exploration=5.0)
    assert select(tree, w, FIRST) == a
    tree.visits[only] = 10_000
    assert select(tree, w, FIRST) == b


def test_each_part_of_the_equation_counts() -> None:
    """Two children with 9 and 4 visits, the root with 13: sqrt(2 ln 13 / n) is 0.755 and 1.132."""
    tree = new_tree(4, 2)
    tree.used[0], tree.visits[0] = 1, 13
    a, b = child(tree, 0, 0, 9, 2.0), child(tree, 0, 1, 4, 2.3)
    bonus = [math.sqrt(2.0 * math.log(13.0) / n) for n in (9, 4)]
    assert bonus == pytest.approx([0.755, 1.132], abs=1e-3)
    border = 0.3 / (bonus[1] - bonus[0])  # const at which both are worth the same: 0.795
    assert border == pytest.approx(0.795, abs=1e-3)
    for const, expected in ((0.0, a), (border - 0.01, a), (border + 0.01, b), (5.0, b)):
        assert select(tree, W._replace(exploration=const), FIRST) == expected


def test_a_node_whose_children_all_collide_is_where_selection_stops() -> None:
    tree = new_tree(4, 2)
    tree.used[0], tree.visits[0] = 1, 5
    a = child(tree, 0, 0, 5, 1.0)
    child(tree, a, 0, 0, 0.0)
    child(tree, a, 1, 0, 0.0)
    tree.end[2:4] = LOST
    assert select(tree, W, FIRST) == a


def test_among_the_unvisited_each_is_drawn_as_often() -> None:
    tree = new_tree(6, 4)
    tree.used[0], tree.visits[0] = 1, 1
    child(tree, 0, 0, 1, 0.0)
    those = [child(tree, 0, k, 0, 0.0) for k in (1, 2, 3)]
    rng = np.random.default_rng(5)
    drawn = [select(tree, W, rng) for _ in range(1200)]
    assert all(330 < drawn.count(i) < 470 for i in those) and set(drawn) == set(those)


class Bare:
    """Algorithm 1 without driving: every node of the tree has its own cost, and A children.

    Written down once more below, over paths of actions; the first unvisited child comes first.
    """

    def __init__(self, actions: int, levels: int, const: float) -> None:
        rng = np.random.default_rng(11)
        self.actions, self.levels, self.const = actions, levels, const
        self.paths: list[tuple[int, ...]] = [()]
        every = [(), *((k,) for k in range(actions))]
        every += [(k, i) for k in range(actions) for i in range(actions)]
        self.cost = {path: float(rng.uniform(1.0, 3.0)) for path in every}

    def expand(self, tree: PaperTree, *rest: Any) -> None:
        node = rest[-1]
        for k in range(self.actions):
            child(tree, node, k, 0, 0.0)
            self.paths.append((*self.paths[node], k))

    def rollout(self, tree: PaperTree, *rest: Any) -> float:
        return self.cost[self.paths[rest[-2]]]

    def naive(self, passes: int) -> dict[tuple[int, ...], tuple[int, float]]:
        """Visits and total costs by path."""
        n: dict[tuple[int, ...], int] = {(): 0}
        total = {(): 0.0}

        def below(path: tuple[int, ...]) -> list[tuple[int, ...]]:
            return [(*path, k) for k in range(self.actions) if (*path, k) in n]

        def score(path: tuple[int, ...]) -> float:
            if n[path] == 0:
                return math.inf
            return -total[path] / n[path] + self.const * math.sqrt(
                2.0 * math.log(n[path[:-1]]) / n[path]
            )

        for _ in range(passes):
            at: tuple[int, ...] = ()
            while below(at):
                at = max(below(at), key=score)  # the first of those that are equal
            if len(at) < self.levels:
                for k in range(self.actions):
                    n[(*at, k)], total[(*at, k)] = 0, 0.0
            for end in range(len(at) + 1):
                n[at[:end]] += 1
                total[at[:end]] += self.cost[at]
        return {path: (n[path], total[path]) for path in n}


@pytest.mark.parametrize("const", [0.0, 0.3, 5.0])
def test_passes_go_where_the_algorithm_says(const: float, monkeypatch: pytest.MonkeyPatch) -> None:
    bare = Bare(3, 2, const)
    monkeypatch.setattr(paper_search, "expand", bare.expand)
    monkeypatch.setattr(paper_search, "_rollout", bare.rollout)
    w, tree = W._replace(exploration=const, look_ahead=2), new_tree(20, 3)
    p, local, state = view()
    for passes in (1, 3, 116):  # in pieces it is the same search
        search(tree, local, p, w, np.zeros((3, 2)), state, GUIDE, passes, FIRST)
    found = {path: (int(tree.visits[i]), float(tree.total[i])) for i, path in enumerate(bare.paths)}
    expected = bare.naive(120)
    assert found.keys() == expected.keys() and tree.visits[0] == 120
    assert tree.motion[0, :2].tolist() == [100.0, 10.0] and tree.where[0].tolist() == [1, NONE]
    for path, (visits, total) in expected.items():
        assert found[path] == (visits, pytest.approx(total)), path


# --- expansion ---


class Plies:
    """In place of the simulated ply: notes what is asked, and costs 1, 2, 3, 4."""

    def __init__(self, ends: int = ALIVE, after: int = 99) -> None:
        self.asked: list[tuple[float, int]] = []
        self.ends, self.after = ends, after

    def __call__(
        self, local: Any, p: Any, w: Any, state: State, accel: float, guide: Any, at: int
    ) -> tuple[State, Floats, int]:
        self.asked.append((accel, at))
        end = self.ends if len(self.asked) > self.after else ALIVE
        return state._replace(s=state.s + 1.0), np.array([1.0, 2.0, 3.0, 4.0]), end


ACTIONS = np.array([[-2.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.5, -1.0]])


def grown(monkeypatch: pytest.MonkeyPatch, level: int = 0, size: int = 9, **ego: Any) -> Any:
    """One node on a level, with costs 10, 20, 30, 40 so far, and its children."""
    plies = Plies()
    monkeypatch.setattr(paper_search, "one_ply", plies)
    p, local, state = view(**ego)
    tree = new_tree(size, len(ACTIONS))
    keep_state(tree.where, tree.motion, 0, state)
    tree.used[0], tree.level[0], tree.cost[0] = 1, level, (10.0, 20.0, 30.0, 40.0)
    w = W._replace(other=3.0, lane_change=0.5)
    expand(tree, local, p, w, ACTIONS, GUIDE, 0)
    return tree, plies


@pytest.mark.parametrize("level", [0, 1])
def test_all_children_at_once_with_the_costs_from_the_root(
    level: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The costs add up; a lane change costs omega_o C_lc = 3 * 0.5 more."""
    tree, plies = grown(monkeypatch, level)
    assert plies.asked == [(-2.0, 10 * level), (1.0, 10 * level), (0.0, 10 * level), (0.5, 10 * level)]  # fmt: skip
    assert tree.child[0].tolist() == [1, 2, 3, 4] and tree.used[0] == 5
    assert tree.parent[1:5].tolist() == [0] * 4 and tree.level[1:5].tolist() == [level + 1] * 4
    usual = [11.0, 22.0, 33.0, 44.0]
    assert tree.cost[1:3].tolist() == [usual, usual]
    usual[OTHER] += 1.5
    assert tree.cost[3:5].tolist() == [usual, usual]
    assert tree.where[1:5].tolist() == [[1, NONE], [1, NONE], [1, 2], [1, 0]]
    assert tree.motion[1:5, 0] == pytest.approx(101.0) and not tree.visits.any()
    assert tree.end[:5].tolist() == [ALIVE] * 5


def test_children_of_a_child_begin_where_it_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    """One level further: after 1 s, with the costs so far, and on."""
    plies = Plies()
    monkeypatch.setattr(paper_search, "one_ply", plies)
    p, local, state = view()
    tree = new_tree(9, 4)
    keep_state(tree.where, tree.motion, 0, state)
    tree.used[0] = 1
    for node in (0, 1):
        expand(tree, local, p, W, ACTIONS, GUIDE, node)
    assert [at for _, at in plies.asked] == [0] * 4 + [10] * 4
    assert tree.child[1].tolist() == [5, 6, 7, 8] and tree.parent[5:].tolist() == [1] * 4
    assert tree.level[5:].tolist() == [2] * 4
    assert tree.motion[5:, 0] == pytest.approx(102.0)
    assert tree.cost[5].tolist() == [2.0, 4.0, 6.0, 8.0]
    assert tree.cost[7].tolist() == [2.0, 4.0, 6.0, 8.0 + W.other * W.lane_change]


def test_where_there_is_no_lane_there_is_no_child(monkeypatch: pytest.MonkeyPatch) -> None:
    for lane, expected in (("a_0", [1, 2, 3, IMPOSSIBLE]), ("a_2", [1, 2, IMPOSSIBLE, 3])):
        tree, _ = grown(monkeypatch, lane=lane)
        assert tree.child[0].tolist() == expected


def test_a_full_tree_takes_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    tree, _ = grown(monkeypatch, size=3)
    assert tree.child[0].tolist() == [1, 2, IMPOSSIBLE, IMPOSSIBLE] and tree.used[0] == 3


@pytest.mark.parametrize("end", [LOST, ARRIVED])
def test_how_a_child_ends_is_kept_and_nothing_follows_an_end(
    end: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    p, local, state = view()
    monkeypatch.setattr(paper_search, "one_ply", Plies(end, after=1))
    tree = new_tree(9, 4)
    keep_state(tree.where, tree.motion, 0, state)
    tree.used[0] = 1
    expand(tree, local, p, W, ACTIONS, GUIDE, 0)
    assert tree.end[1:5].tolist() == [ALIVE, end, end, end]
    expand(tree, local, p, W, ACTIONS, GUIDE, 2)
    assert tree.child[2].tolist() == [IMPOSSIBLE] * 4 and tree.used[0] == 5


def test_a_lane_change_that_cannot_be_finished_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """Looked for from the end of the ply on; who only goes straight on is not asked."""
    asked: list[int] = []

    def never(local: Any, p: Any, w: Any, state: State, level: int) -> bool:
        asked.append(level)
        return False

    monkeypatch.setattr(paper_search, "_can_finish", never)
    tree, _ = grown(monkeypatch, level=1)
    assert tree.end[1:5].tolist() == [ALIVE, ALIVE, LOST, LOST] and asked == [2, 2]


def test_a_change_is_followed_to_its_end_as_far_as_the_tree_looks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It lasts 3 s; after half of it 1.5 s are left. Contact is looked for every 0.2 s."""
    p, local, state = view()
    finish = plain(paper_search._can_finish)
    half = state._replace(progress=0.5, other=state.node + 1)
    for level, expected in ((0, 1.5), (1, 2.5), (2, 3.0)):
        times: list[float] = []

        def clear(*those: Any, times: list[float] = times) -> tuple[float, float]:
            times.append(those[3])
            return 1.0, 0.0

        monkeypatch.setattr(paper_search, "nearest", clear)
        assert finish(local, p, W, half, level)
        assert times[0] == pytest.approx(level + 0.2)
        assert np.diff(times) == pytest.approx(np.full(len(times) - 1, 0.2))
        assert expected - 0.25 < times[-1] < expected + 0.05
    for distance, free in ((0.0, False), (0.01, True)):
        monkeypatch.setattr(paper_search, "nearest", lambda *_, d=distance: (d, 0.0))
        assert finish(local, p, W, half, 0) == free
        assert finish(local, p, W, state, 0)  # no change under way: nothing to finish
    for event, free in ((RED_LINE, False), (OFF_END, False), (GOAL, True)):
        asked: list[float] = []
        monkeypatch.setattr(
            paper_search,
            "advance",
            lambda *those, e=event, asked=asked: asked.append(those[3]) or (those[2], e),
        )
        assert finish(local, p, W, half, 0) == free and asked == [0.0]  # at this speed
    monkeypatch.undo()
    over = half._replace(s=899.0)
    monkeypatch.setattr(paper_search, "nearest", lambda *_: (1.0, 0.0))
    assert finish(local, p, W, over, 0)  # the end of the route is no contact


# --- the rollout ---


def drawn(
    monkeypatch: pytest.MonkeyPatch, level: int, plies: Plies, passes: int, w: Weights = W,
    end: int = ALIVE,
) -> list[float]:  # fmt: skip
    """J of so many rollouts from a node with costs 10, 20, 30, 40."""
    monkeypatch.setattr(paper_search, "one_ply", plies)
    p, local, state = view()
    tree = new_tree(2, 1)
    keep_state(tree.where, tree.motion, 0, state)
    tree.level[0], tree.cost[0], tree.end[0] = level, (10.0, 20.0, 30.0, 40.0), end
    rng = np.random.default_rng(2)
    return [rollout(tree, local, p, w, GUIDE, 0, rng) for _ in range(passes)]


@pytest.mark.parametrize(("brake", "accelerate"), [(0.1, 0.1), (0.3, 0.2), (0.0, 1.0), (0.6, 0.0)])
def test_a_rollout_draws_movements_with_the_probabilities(
    brake: float, accelerate: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 4000: counts within five standard deviations. Braking is drawn from 1 to 5 m/s2, with a
    mean of 3; accelerating from 1 to 3, with a mean of 2."""
    plies = Plies()
    w = W._replace(
        brake_probability=brake, accelerate_probability=accelerate, look_ahead=2, rollout=2
    )
    drawn(monkeypatch, 0, plies, 1000, w)
    accels = np.array([accel for accel, _ in plies.asked])
    assert len(accels) == 4000
    for those, share, low, high in (
        (-accels[accels < 0.0], brake, 1.0, 5.0),
        (accels[accels > 0.0], accelerate, 1.0, 3.0),
    ):
        assert abs(len(those) - 4000 * share) <= 5.0 * math.sqrt(4000 * share * (1.0 - share))
        if len(those):
            spread = 5.0 * (high - low) / math.sqrt(12.0 * len(those))
            assert abs(those.mean() - 0.5 * (low + high)) < spread
            assert low <= those.min() < low + 0.1 * (high - low)
            assert high - 0.1 * (high - low) < those.max() <= high


@pytest.mark.parametrize("level", [0, 1, 2])
def test_a_rollout_goes_on_to_the_terminal_state_and_adds_up_j(
    level: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two levels and three further steps: 10 + 20 + 30 + 40, and 1 + 2 + 3 + 4 for each ply."""
    plies = Plies()
    found = drawn(monkeypatch, level, plies, 1, W._replace(look_ahead=2, rollout=3))
    assert [at for _, at in plies.asked] == [10 * k for k in range(level, 5)]
    assert found == [100.0 + 10.0 * (5 - level)]


def test_contact_in_a_rollout_costs_once_and_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    w = W._replace(look_ahead=2, rollout=3, safety=7.0, contact=1000.0)
    lost, home = Plies(LOST, after=1), Plies(ARRIVED, after=1)
    assert drawn(monkeypatch, 0, lost, 1, w) == [120.0 + 7000.0] and len(lost.asked) == 2
    assert drawn(monkeypatch, 0, home, 1, w) == [120.0] and len(home.asked) == 2


def test_who_has_arrived_drives_no_further(monkeypatch: pytest.MonkeyPatch) -> None:
    plies = Plies()
    assert drawn(monkeypatch, 0, plies, 1, end=ARRIVED) == [100.0] and not plies.asked


# --- the planner around them ---


def planner_of(*sets: str) -> tuple[paper.PaperPlanner, Situation]:
    """A planner with its task, and the ego alone on the middle one of three lanes."""
    road, config = lanes_east(3, 900.0), scenario("planner.name=paper", *sets)
    ego = ego_at(road, "a_1", 100.0, 10.0)
    task = task_of(road, ego, config)
    planner = paper.PaperPlanner(config)
    planner.start(task, 1)
    return planner, situation_of(task, scene_of(ego, road))


class Searches:
    """In place of the search: notes the passes asked for and the size of the tree, and takes a
    tenth of a second each time."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.counts: list[int] = []
        self.size, self.now = 0, 0.0
        monkeypatch.setattr(paper, "search", self)
        monkeypatch.setattr(paper, "time", SimpleNamespace(perf_counter=lambda: self.now))

    def __call__(self, tree: PaperTree, *rest: Any) -> None:
        self.counts.append(rest[-2])
        self.size, self.now = len(tree.parent), self.now + 0.1


@pytest.mark.parametrize(
    ("iterations", "counts", "size"),
    [
        (7, [7], 7 * 12 + 2),
        (1000, [1000], 157 * 12 + 2),  # the whole tree has 157 nodes
        (2 * SLICE + 3, [SLICE, SLICE, 3], 157 * 12 + 2),
    ],
)
def test_all_passes_are_made(
    iterations: int, counts: list[int], size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    planner, situation = planner_of(f"planner.iterations={iterations}")
    searches = Searches(monkeypatch)
    decision = planner.plan(situation)
    assert (searches.counts, searches.size, decision.iterations) == (counts, size, iterations)


@pytest.mark.parametrize(("until", "times"), [(-1.0, 1), (0.05, 1), (0.15, 2), (0.45, 5)])
def test_passes_are_made_until_the_time_is_up(
    until: float, times: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    planner, situation = planner_of("planner.iterations=7")
    searches = Searches(monkeypatch)
    searches.now = 1000.0
    decision = planner.plan(situation._replace(until=1000.0 + until))
    assert searches.counts == [LOOK_SLICE] * times and decision.iterations == 20 * times
    assert searches.size == (100 if until < 0.0 else 157) * 12 + 2


def test_without_children_it_brakes_and_else_takes_the_lowest_mean(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    planner, situation = planner_of()
    Searches(monkeypatch)
    braking = planner.plan(situation)
    assert braking.reason == "brake" and braking.plan.v[-1] < 5.0 and braking.children == ()
    assert (braking.chosen, braking.command.lane_change, braking.known) == (-1, 0, 0)
    assert braking.plan.pose[:, 1] == pytest.approx(0.0)

    def fill(tree: PaperTree, *_: Any) -> None:
        tree.used[0] = 1
        for k, (visits, mean) in enumerate([(4, 9.0), (2, 7.0), (9, 8.0), (0, 0.0), (1, 1.0)]):
            child(tree, 0, k, visits, mean)
        tree.end[5] = LOST
        tree.cost[2] = (1.0, 2.0, 3.0, 4.0)

    monkeypatch.setattr(paper, "search", fill)
    decision = planner.plan(situation)
    assert [(c.accel, c.visits, c.mean, c.best) for c in decision.children] == [
        (-8.0, 4, 9.0, 9.0),
        (-5.0, 2, 7.0, 7.0),
        (-4.0, 9, 8.0, 8.0),
    ]
    assert decision.chosen == 1 and decision.reason == "search" and decision.known == 0
    assert decision.children[1].terms.tolist() == [1.0, 2.0, 3.0, 4.0, 0.0]
    assert np.array_equal(decision.command.speeds, decision.plan.v)


def test_actions_are_the_accelerations_and_the_changes_to_both_sides() -> None:
    planner, _ = planner_of(
        "paper.accelerations_mps2=[-1, 2]", "paper.lane_change_accelerations_mps2=[0, 1]"
    )
    assert planner._actions.tolist() == [[-1, 0], [2, 0], [0, 1], [1, 1], [0, -1], [1, -1]]


@pytest.mark.parametrize("side", [0, 1, -1])
def test_the_plan_is_the_first_action_step_by_step(side: int) -> None:
    """1 s at 10 m/s; a lane of 3.2 m is changed within 3 s."""
    planner, situation = planner_of()
    _, local, _ = view()
    local.closed[:, -1] = 1  # after the plan
    task, state = planner._task, situation.state
    plan = paper._drive(local, task, W, state, np.array([0.0, side]))
    assert plan.time == pytest.approx(np.arange(1, 11) * 0.1) and plan.v == pytest.approx(10.0)
    assert plan.s == pytest.approx(np.arange(101, 111)) and plan.lane.tolist() == [1] * 10
    assert plan.pose[0, 0] == pytest.approx(98.5, abs=0.1)
    assert plan.pose[-1, 1] == pytest.approx(side * 3.2 / 3.0, abs=0.35)
    assert abs(plan.pose[-1, 1]) > 0.5 or side == 0
    end = paper._drive(local, task, W, state._replace(s=896.5), np.array([0.0, 0.0]))
    assert end.s.tolist() == [897.5, 898.5, 899.5, 900.0]


def test_the_plan_knows_when_a_line_is_closed() -> None:
    """It would brake for it: 10 m/s, 30 m before a line that is closed in the end only."""
    road = road_with_light()
    ego = ego_at(road, "a_0", 170.0, 10.0, route=(0, 2))
    task = task_of(road, ego)
    local, state = local_of(task, scene_of(ego, road, signals=lights(GREEN)))
    keep = np.array([0.0, 0.0])
    local.closed[:, 8:] = 1  # from 1.5 s on
    assert paper._drive(local, task, W, state, keep).v == pytest.approx(10.0)
    local.closed[:, 3:] = 1
    assert paper._drive(local, task, W, state, keep).v[-1] < 9.5


def test_a_new_tree_is_empty() -> None:
    tree = new_tree(7, 3)
    assert tree.child.shape == (7, 3) and tree.cost.shape == (7, 4)
    assert np.all(tree.child == NONE) and np.all(tree.parent == NONE) and tree.used[0] == 0
    assert tree.used.shape == (1,)
    assert not (tree.visits.any() or tree.total.any() or tree.cost.any() or tree.level.any())
