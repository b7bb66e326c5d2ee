"""The terms of J in planner `paper`, each written down once more from the paper's formula.

The numbers are worked out by hand for steps of 0.1 s, T_1 = 1 s, and the weights of the defaults:
omega_s 10, d_thresh 10 m, k 0.1, 1 a metre to the goal, 10 before a junction, 1 a lane change, 2
for standing, 5 for an emergency.
"""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from helpers import Agent, Lane, build, edges, ego_at, lights
from helpers_model import (
    lanes_east,
    local_of,
    plain,
    road_with_light,
    scenario,
    scene_of,
    task_of,
)

from sumo_mcts.arrays import Floats
from sumo_mcts.model.local_map import BIT, ELSEWHERE, GONE, NODE, LocalMap, State
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.numerics.geometry import COS, SIN, X, Y
from sumo_mcts.planners import paper, paper_cost, paper_search
from sumo_mcts.planners.paper_cost import Guide, Weights
from sumo_mcts.planners.ply import ALIVE, ARRIVED, LOST
from sumo_mcts.road import LEFT, RIGHT, RoadMap
from sumo_mcts.scene import COMFORT, GREEN, OTHER, PASSABILITY, SAFETY

ply = plain(paper_search.one_ply)


def nearest(
    local: LocalMap, p: EgoParams, state: State, time: float, aligned: bool = False
) -> float:
    """The distance alone."""
    return float(plain(paper_cost.nearest)(local, p, state, time, aligned)[0])


W = paper.weights_of(scenario("planner.name=paper"), 0.1)._replace(turn=3.0)
FAR = 5000.0  # m: the local goal, where the distance to it is not the question


class View:
    """The ego with its front at s on the first lane of a road, and boxes of 5 m x 1.8 m."""

    local: LocalMap
    state: State
    p: EgoParams

    def __init__(
        self, *boxes: tuple[float, float], road: RoadMap | None = None, s: float = 100.0,
        v: float = 10.0, shows: int = -1,
    ) -> None:  # fmt: skip
        road = road or lanes_east(1, 900.0)
        route = edges(road, *(e for e in dict.fromkeys(road.edge_ids) if e[0] != ":"))
        ego = ego_at(road, road.lane_ids[0], s, v, route=route)
        task = task_of(road, ego)
        those = [
            Agent(f"x{k}", "", x=0.0, y=300.0, width=1.8, length=5.0) for k in range(len(boxes))
        ]
        signals = lights(shows) if shows >= 0 else None
        self.local, self.state = local_of(task, scene_of(ego, road, *those, signals=signals))
        self.p, self.nodes = task.ego, len(task.route.lane)
        trait = self.local.trait.copy()
        trait[:, 0], trait[:, 1], trait[:, BIT] = 2.5, 0.9, -1.0
        self.local = self.local._replace(trait=trait)
        self.put(*boxes)

    def put(self, *boxes: tuple[float, float]) -> None:
        """The centres of all others, which stand there, off the lanes of the ego."""
        agent, place = self.local.agent.copy(), self.local.place.copy()
        for i, (x, y) in enumerate(boxes):
            agent[:, i, [X, Y, COS, SIN, NODE]] = x, y, 1.0, 0.0, ELSEWHERE
            place[:, i] = -1
        self.local = self.local._replace(agent=agent, place=place)

    def guide(self, goal: float = FAR, aside: float = 0.0, turns: bool = False) -> Guide:
        none = np.zeros(self.nodes, np.bool_)
        return Guide(goal, 0.0, 0.0, np.full(self.nodes, aside), np.full(self.nodes, turns), none)

    def costs(
        self, accel: float = 0.0, w: Weights = W, at: int = 0, **guide: Any
    ) -> tuple[State, Floats, int]:
        """The state after one ply, its four costs, and its end."""
        return ply(self.local, self.p, w, self.state, accel, self.guide(**guide), at)


def safety(gap: float, w: Weights = W) -> float:
    """f(d) of the paper: 1/d up to d_thresh, no less than 0.1 m counts."""
    return w.safety * (1.0 / max(gap, 0.1) if gap <= w.threshold else 0.0)


# --- C_s ---


@pytest.mark.parametrize(
    ("gap", "cost"), [(0.05, 100.0), (0.2, 50.0), (2.0, 5.0), (5.0, 2.0), (9.99, 1.001), (10.01, 0.0), (15.0, 0.0)]
)  # fmt: skip
def test_safety_is_one_over_the_distance_up_to_the_threshold(gap: float, cost: float) -> None:
    """The ego stands with its front at 100 m, the other's rear is `gap` m before it."""
    assert safety(gap) == pytest.approx(cost, rel=1e-3)
    state, found, end = View((102.5 + gap, 0.0), v=0.0).costs()
    assert (state.s, end) == (100.0, ALIVE) and found[SAFETY] == pytest.approx(cost, rel=1e-3)


def test_the_distance_is_that_at_the_end_of_the_ply() -> None:
    """From 100 m to 110 m in a second; the other stands from 113 m on: 3 m, not 13."""
    _, found, _ = View((115.5, 0.0)).costs()
    assert found[SAFETY] == pytest.approx(10.0 / 3.0)


def test_the_nearer_the_dearer_and_by_the_nearest_of_all() -> None:
    rng = np.random.default_rng(3)
    drawn = np.sort(rng.uniform(0.1, 14.0, 12))
    view, away, alone = View((0.0, 300.0), (0.0, 300.0), v=0.0), (0.0, 300.0), []
    for gap in drawn:
        view.put((102.5 + gap, 0.0), away)
        alone.append(view.costs()[1][SAFETY])
    assert alone == sorted(alone, reverse=True)
    assert alone == pytest.approx([safety(gap) for gap in drawn])
    for near, far in pairwise(drawn):
        both = (102.5 + far, 0.0), (92.5 - near, 0.0)  # the nearer one at the ego's rear
        for boxes in (both, both[::-1]):
            view.put(*boxes)
            assert view.costs()[1][SAFETY] == pytest.approx(safety(near))


@pytest.mark.parametrize(
    ("aside", "ahead", "distance"), [(3.0, -1.0, 1.2), (-3.0, 0.0, 1.2), (4.8, 9.0, 5.0), (2.8, 5.0, 1.0)]
)  # fmt: skip
def test_the_distance_is_between_boxes(aside: float, ahead: float, distance: float) -> None:
    """Two boxes of 5 m by 1.8 m. `ahead`, `aside`: of the other's centre, m. At (9, 4.8) it is 4 m
    further and 3 m aside."""
    view = View((97.5 + ahead, aside), v=0.0)
    assert nearest(view.local, view.p, view.state, 0.0) == pytest.approx(distance)
    assert view.costs()[1][SAFETY] == pytest.approx(10.0 / distance)


def test_contact_ends_the_ply_without_further_cost() -> None:
    for box in ((112.0, 0.0), (106.0, 1.0)):
        _, found, end = View(box).costs()
        assert end == LOST and not found.any()


def test_beyond_forty_metres_nobody_counts() -> None:
    view, w = View((0.0, 0.0), road=lanes_east(3), v=0.0), W._replace(threshold=100.0)
    for ahead, aside in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        for away, seen in ((39.0, True), (41.0, False)):
            view.put((97.5 + away * ahead, -3.2 + away * aside))  # the ego is at (97.5, -3.2)
            assert bool(view.costs(w=w)[1][SAFETY]) == seen


def test_who_is_gone_or_follows_the_ego_does_not_count() -> None:
    view = View((104.5, 0.0), v=0.0)
    usual, trait, gone = view.local, view.local.trait.copy(), view.local.agent.copy()
    assert view.costs()[1][SAFETY] == pytest.approx(5.0)
    gone[:, 0, NODE] = GONE
    view.local = usual._replace(agent=gone)
    assert view.costs()[1][SAFETY] == 0.0
    trait[0, BIT] = 0.0
    for followers, cost in ((0, 5.0), (1, 0.0)):
        view.local = usual._replace(trait=trait, followers=followers)
        assert view.costs()[1][SAFETY] == pytest.approx(cost)


@pytest.mark.parametrize(
    ("check", "at", "index", "end"),
    [
        (2, 0, 3, LOST),  # after 0.2, 0.4, 0.6 .. s, so at forecast index 1, 2, 3 ..
        (10, 0, 3, ALIVE),  # after 1 s only
        (10, 0, 5, LOST),
        (5, 0, 3, LOST),  # after 0.5 s: index 3 by rounding half a step up
        (5, 0, 2, ALIVE),
        (2, 10, 3, ALIVE),  # the second ply lasts from 1 s to 2 s
        (2, 10, 8, LOST),
        (2, 10, 10, LOST),
        (2, 10, 11, ALIVE),
    ],
)
def test_when_contact_is_looked_for(check: int, at: int, index: int, end: int) -> None:
    """Somebody is in the way at one forecast time (0.2 s apart) only."""
    view = View((100.0, 300.0), v=0.0)
    assert view.local.dt == pytest.approx(0.2)
    view.local.agent[index, 0, Y] = 0.0
    assert view.costs(w=W._replace(check=check), at=at)[2] == end


def test_the_distance_is_that_at_the_time_of_the_end() -> None:
    """5 m of distance at one forecast time only: after 1 s at index 5, after 2 s at index 10."""
    for index, at, cost in ((5, 0, 2.0), (10, 10, 2.0), (10, 0, 0.0), (5, 10, 0.0)):
        view = View((107.5, 300.0), v=0.0)
        view.local.agent[index, 0, Y] = 0.0
        assert view.costs(at=at)[1][SAFETY] == pytest.approx(cost)


def test_who_is_on_another_level_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    view, asked = View((104.5, 0.0), v=0.0), []

    def above(_: Any, node: int, s: float, length: float, at: int, i: int) -> bool:
        asked.append((node, s, length, at, i))
        return True

    monkeypatch.setattr(paper_cost, "on_other_level", above)
    assert nearest(view.local, view.p, view.state, 1.0) == math.inf
    assert asked == [(view.state.node, 100.0, 5.0, 5, 0)]


def test_where_vehicles_are_drawn_short_so_are_the_boxes() -> None:
    """The other, 5 m long, is drawn to half of that, in front: its rear is 2.5 m further away."""
    view = View((104.5, 0.0), v=0.0)
    whole = nearest(view.local, view.p, view.state, 0.0)
    view.local = view.local._replace(drawn=np.full(view.local.agent.shape[:2], 0.5))
    assert nearest(view.local, view.p, view.state, 0.0) == pytest.approx(whole + 2.5)


def test_beyond_the_forecast_its_last_time_counts() -> None:
    view = View((104.5, 300.0), v=0.0)
    view.local.agent[-1, 0, Y] = 0.0
    assert nearest(view.local, view.p, view.state, 1e4) == pytest.approx(2.0)


# --- C_c ---


@pytest.mark.parametrize(
    ("before", "accel", "cost"),
    [
        (0.0, 0.0, 0.0),
        (0.0, 2.0, 0.4),  # j = 2 m/s3: 0.1 * 2^2
        (0.0, -2.0, 0.4),
        (1.0, 2.0, 0.1),
        (-1.0, 2.0, 0.9),
        (0.0, -3.0, 0.9),
    ],
)
def test_comfort_is_k_j_squared(before: float, accel: float, cost: float) -> None:
    view = View()
    view.state = view.state._replace(a=before)
    state, found, _ = view.costs(accel)
    assert state.a == pytest.approx(accel) and found[COMFORT] == pytest.approx(cost)


def test_jerk_is_the_change_of_acceleration_over_the_length_of_the_ply() -> None:
    """From 0 to 2 m/s2 within 0.5 s: j = 4 m/s3, and 1.6."""
    state, found, _ = View().costs(2.0, w=W._replace(ply=5))
    assert state.a == pytest.approx(2.0) and found[COMFORT] == pytest.approx(1.6)


# --- C_p ---


@pytest.mark.parametrize(
    ("goal", "aside", "cost"), [(300.0, 0.0, 190.0), (300.0, 20.0, 210.0), (105.0, 0.0, 0.0), (105.0, 20.0, 20.0)]
)  # fmt: skip
def test_passability_is_the_distance_to_the_local_goal(
    goal: float, aside: float, cost: float
) -> None:
    """The ply ends at 110 m. Past the goal no distance is left; a lane change still is."""
    assert View().costs(goal=goal, aside=aside)[1][PASSABILITY] == pytest.approx(cost)
    half = W._replace(goal_factor=0.5)
    found = View().costs(goal=goal, aside=aside, w=half)[1]
    assert found[PASSABILITY] == pytest.approx(0.5 * cost)


@pytest.mark.parametrize(
    ("s", "goal", "penalty"),
    [
        (150.0, 195.0, 0.0),  # the goal lies before the junction, which is from 200 m to 220 m
        (150.0, 205.0, 10.0),
        (150.0, 300.0, 10.0),
        (195.0, 300.0, 10.0),  # ends inside it
        (205.0, 300.0, 10.0),
        (215.0, 300.0, 0.0),  # ends behind it
    ],
)
def test_the_penalty_lasts_until_the_junction_is_passed(
    s: float, goal: float, penalty: float
) -> None:
    """10 m/s for a second."""
    view = View(road=road_with_light(), s=min(s, 199.0), shows=GREEN)
    if s > 200.0:
        view.state = view.state._replace(node=view.state.node + 1, s=s - 200.0)
    else:
        view.state = view.state._replace(s=s)
    found = view.costs(goal=goal)[1][PASSABILITY]
    assert found == pytest.approx(max(goal - s - 10.0, 0.0) + penalty)
    none = view.costs(goal=goal, w=W._replace(junction_penalty=0.0))[1][PASSABILITY]
    assert found - none == pytest.approx(penalty)


def test_only_junctions_before_the_goal_count() -> None:
    """Junctions are from 200 m to 220 m and from 320 m to 330 m down the route."""
    lanes = [
        Lane("a", 0, ((0, 0), (200, 0)), (":m_0",)),
        Lane(":m", 0, ((200, 0), (220, 0)), ("b_0",), junction="m"),
        Lane("b", 0, ((220, 0), (320, 0)), (":n_0",)),
        Lane(":n", 0, ((320, 0), (330, 0)), ("c_0",), junction="n"),
        Lane("c", 0, ((330, 0), (500, 0))),
    ]
    view, ahead = View(road=build(lanes)), plain(paper_cost._junction_ahead)
    for node, goal, found in ((0, 190, False), (0, 210, True), (1, 240, True), (2, 310, False), (2, 325, True), (3, 325, True), (4, 400, False)):  # fmt: skip
        assert ahead(view.local, view.state._replace(node=node), float(goal)) == found


@pytest.mark.parametrize(
    ("node", "other", "progress", "metres"),
    [(1, -1, 0.0, 20.0), (2, -1, 0.0, 50.0), (1, 0, 0.25, 15.0), (0, 1, 0.75, 5.0), (1, 2, 0.2, 26.0), (2, 1, 0.9, 47.0), (1, 0, 0.0, 20.0)],
)  # fmt: skip
def test_a_change_under_way_counts_for_what_is_left_of_it(
    node: int, other: int, progress: float, metres: float
) -> None:
    """Lanes 0, 1 and 2 are 0 m, 20 m and 50 m off."""
    guide = Guide(FAR, 0.0, 0.0, np.array([0.0, 20.0, 50.0]), *[np.zeros(3, np.bool_)] * 2)
    state = State(node, 100.0, 10.0, 0.0, progress, other, 0.0)
    assert plain(paper_cost._aside)(guide, state) == pytest.approx(metres)


@pytest.mark.parametrize("metres", [20.0, 7.0])
def test_each_change_that_the_route_still_needs_counts(metres: float) -> None:
    """Of four lanes the rightmost leads on; what the next edge needs does not count yet."""
    lanes = [Lane("a", k, ((0, 3.2 * k), (200, 3.2 * k)), () if k else ("b_0",)) for k in range(4)]
    lanes += [Lane("b", k, ((200, 3.2 * k), (400, 3.2 * k)), ("c_0",) if k else ()) for k in (0, 1)]
    road = build([*lanes, Lane("c", 0, ((400, 3.2), (600, 3.2)))])
    ego = ego_at(road, "a_1", 150.0, 10.0, route=edges(road, "a", "b", "c"))
    task = task_of(road, ego)
    _, state = local_of(task, scene_of(ego, road))
    aside = paper.guide_of(task, state, 100.0, metres).aside
    of = {road.lane_ids[lane]: float(aside[i]) for i, lane in enumerate(task.route.lane)}
    assert [of[f"a_{k}"] for k in range(4)] == [0.0, metres, 2.0 * metres, 3.0 * metres]
    assert of["b_0"] == of["b_1"] == of["c_0"] == 0.0


def bent(direction: int) -> RoadMap:
    """A junction of 20 m after 200 m that counts as a turn."""
    return build(
        [
            Lane("a", 0, ((0, 0), (200, 0)), (":m_0",)),
            Lane(":m", 0, ((200, 0), (220, 0)), ("b_0",), junction="m", direction=direction),
            Lane("b", 0, ((220, 0), (400, 0))),
        ]
    )


@pytest.mark.parametrize(("direction", "turns"), [(0, False), (LEFT, True), (RIGHT, True)])
def test_the_guide_knows_goal_and_turns(direction: int, turns: bool) -> None:
    road = bent(direction)
    ego = ego_at(road, "a_0", 150.0, 10.0, route=edges(road, "a", "b"))
    task = task_of(road, ego)
    _, state = local_of(task, scene_of(ego, road))
    guide = paper.guide_of(task, state, 100.0, 20.0)
    assert guide.goal == 250.0 and guide.turns.tolist() == [False, turns, False]
    inside = state._replace(node=1, s=5.0)
    assert paper.guide_of(task, inside, 100.0, 20.0).goal == 305.0


# --- C_o ---


@pytest.mark.parametrize(
    ("v", "accel", "turns", "cost"),
    [
        (10.0, 0.0, False, 0.0),
        (10.0, -2.9, False, 0.0),  # the comfortable deceleration is 3 m/s2
        (10.0, -3.1, False, 5.0),
        (0.0, 0.0, False, 2.0),
        (0.0, -8.0, False, 7.0),
        (0.2, 0.0, False, 0.0),
        (10.0, 0.0, True, 3.0),
        (0.0, -8.0, True, 10.0),
    ],
)
def test_standing_turning_and_braking_hard_have_their_costs(
    v: float, accel: float, turns: bool, cost: float
) -> None:
    assert View(v=v).costs(accel, turns=turns)[1][OTHER] == pytest.approx(cost)


# --- the ends of a ply ---


def test_a_closed_line_is_a_contact_and_an_open_one_is_nothing() -> None:
    """Too late to stop: 12 m/s, 5 m before the line."""
    view = View(road=road_with_light(), s=195.0, v=12.0, shows=GREEN)
    assert view.costs()[2] == ALIVE and view.costs()[1].any()
    view.local.closed[:] = 1
    _, found, end = view.costs()
    assert end == LOST and not found.any()


def test_a_line_counts_that_is_closed_when_the_ego_comes_to_it() -> None:
    """It crosses the line in the fifth step: the line is closed around 1.6 s from now only."""
    view = View(road=road_with_light(), s=195.0, v=12.0, shows=GREEN)
    view.local.closed[:, 8] = 1
    assert view.costs(at=10)[2] == LOST and view.costs(at=0)[2] == ALIVE


def test_so_is_the_end_of_a_lane_that_leads_nowhere() -> None:
    lanes = [Lane("a", k, ((0, 3.2 * k), (200, 3.2 * k)), ("b_0",) if k else ()) for k in range(2)]
    view = View(road=build([*lanes, Lane("b", 0, ((200, 3.2), (400, 3.2)))]), s=197.0, v=10.0)
    _, found, end = view.costs()
    assert end == LOST and not found.any()


def test_beyond_the_end_of_the_route_only_the_driving_counts() -> None:
    view = View((312.0, 0.0), road=lanes_east(1, 300.0), s=296.0)
    _, found, end = view.costs(-8.0, turns=True)
    assert end == ARRIVED and found[SAFETY] == found[PASSABILITY] == 0.0
    assert found[COMFORT] > 0.0 and found[OTHER] == 8.0


# --- all terms together ---

TERMS = {
    "safety": SAFETY, "comfort": COMFORT, "jerk_factor": COMFORT, "passability": PASSABILITY,
    "other": OTHER,
}  # fmt: skip


def test_each_weight_belongs_to_exactly_one_term() -> None:
    """Without it the term is gone, with twice of it the term is doubled, and no other changes."""
    view = View((105.5, 0.0), road=road_with_light(), s=150.0, v=0.0, shows=GREEN)
    view.state = view.state._replace(s=100.0, a=-1.0)
    usual = view.costs(-8.0, turns=True, goal=220.0)[1]
    assert np.all(usual > 0.0)
    assert usual == pytest.approx([10.0 / 3.0, 0.1, 120.0 + 10.0, 2.0 + 5.0 + 3.0])
    for name, term in TERMS.items():
        for factor in (0.0, 2.0):
            w = W._replace(**{name: factor * getattr(W, name)})
            expected = usual.copy()
            expected[term] *= factor
            assert view.costs(-8.0, w=w, turns=True, goal=220.0)[1] == pytest.approx(expected)


PARTS = {"goal_factor": (PASSABILITY, 120.0), "junction_penalty": (PASSABILITY, 10.0),
         "stop": (OTHER, 2.0), "emergency": (OTHER, 5.0), "turn": (OTHER, 3.0)}  # fmt: skip


@pytest.mark.parametrize("name", PARTS)
def test_each_part_of_a_term_goes_with_its_own_weight(name: str) -> None:
    view = View(road=road_with_light(), s=150.0, v=0.0, shows=GREEN)
    view.state = view.state._replace(s=100.0)
    w = W._replace(passability=3.0, other=2.0)
    usual = view.costs(-8.0, w=w, turns=True, goal=220.0)[1]
    term, part = PARTS[name]
    for factor in (0.0, 2.0):
        expected = usual.copy()
        expected[term] += (factor - 1.0) * part * (3.0 if term == PASSABILITY else 2.0)
        changed = w._replace(**{name: factor * getattr(w, name)})
        found = view.costs(-8.0, w=changed, turns=True, goal=220.0)[1]
        assert found == pytest.approx(expected)


def test_drawn_plies_cost_what_the_formulas_say() -> None:
    """A second implementation of one ply, for boxes in line with the ego."""
    rng, view = np.random.default_rng(7), View((0.0, 0.0))
    root = view.state
    for _ in range(40):
        gap, v, accel = rng.uniform(9.0, 30.0), rng.uniform(0.0, 9.0), rng.uniform(-6.0, 2.6)
        before, goal = rng.uniform(-2.0, 2.0), rng.uniform(90.0, 300.0)
        w = W._replace(
            **{name: float(rng.uniform(0.1, 9.0)) for name in ("safety", "comfort", "passability", "other", "threshold", "jerk_factor", "goal_factor", "stop", "emergency")}
        )  # fmt: skip
        view.put((102.5 + gap, 0.0))
        view.state = root._replace(v=v, a=before)
        after, found, end = view.costs(accel, w=w, goal=goal)
        d, jerk = 100.0 + gap - after.s, after.a - before
        if end == LOST:
            assert d <= 0.0
            continue
        assert found == pytest.approx(
            [
                w.safety / max(d, 0.1) if d <= w.threshold else 0.0,
                w.comfort * w.jerk_factor * jerk**2,
                w.passability * w.goal_factor * max(0.0, goal - after.s),
                w.other * (w.stop * (after.v < 0.1) + w.emergency * (accel < -3.0)),
            ]
        )


# --- what the scenario says ---

KEYS = {
    "weight_safety": "safety", "weight_comfort": "comfort", "weight_passability": "passability",
    "weight_other": "other", "safety_threshold_m": "threshold", "contact_cost": "contact",
    "jerk_factor": "jerk_factor", "goal_factor": "goal_factor", "stop_cost": "stop",
    "junction_penalty": "junction_penalty", "lane_change_cost": "lane_change", "turn_cost": "turn",
    "emergency_cost": "emergency", "exploration": "exploration", "bypass_cost": "bypass",
    "highway_threshold_m": "highway_threshold", "closing_speed_mps": "closing",
    "lateral_factor": "lateral_factor", "stop_sign_cost": "stop_sign",
    "brake_probability": "brake_probability", "accelerate_probability": "accelerate_probability",
    "look_ahead_steps": "look_ahead", "rollout_steps": "rollout",
}  # fmt: skip


@pytest.mark.parametrize("key", KEYS)
def test_each_key_reaches_the_search_and_no_other_number_changes(key: str) -> None:
    usual, value = paper.weights_of(scenario(), 0.1), 0.25 if "probability" in key else 7
    said = paper.weights_of(scenario(f"paper.{key}={value}"), 0.1)
    more = {"highway_threshold": value} if key == "safety_threshold_m" else {}  # unless it is given
    assert said == usual._replace(**{KEYS[key]: value}, **more) != usual


def test_times_become_steps_of_the_simulation() -> None:
    config = scenario("paper.step_s=0.8", "planner.check_s=0.4")
    found = [paper.weights_of(config, step)[:2] for step in (0.1, 0.2, 0.5, 1.0)]
    assert found == [(8, 4), (4, 2), (2, 1), (1, 1)]
    several = scenario("paper.step_s=0.8", "paper.look_ahead_steps=3", "paper.rollout_steps=2")
    assert paper.forecast_s(several, 0.1, 0.2) == pytest.approx(5 * 0.8 + 0.2)
    assert paper.forecast_s(several, 1.0, 0.2) == pytest.approx(5 * 1.0 + 0.2)


def test_the_tree_is_as_large_as_all_its_levels() -> None:
    assert [paper.full_size(12, levels) for levels in range(3)] == [1, 13, 157]
    assert math.isclose(paper.EMERGENCY, -8.0)
