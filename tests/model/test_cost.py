"""What a state costs, and who is seen from it: rules that hold whatever the weights are."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers import Agent, Conflict, Lane, build, crossing, edges, ego_at
from helpers_model import compiled, lanes_east, local_of, scenario, scene_of, task_of
from hypothesis import given, settings
from hypothesis import strategies as st

from sumo_mcts.arrays import Floats, Ints
from sumo_mcts.config import load
from sumo_mcts.config.builtin import scenario_path
from sumo_mcts.driver.params import Physics
from sumo_mcts.evaluation.reachability import can_meet
from sumo_mcts.model.agent_tables import Moving, levels, tables_of
from sumo_mcts.model.cost import RUN_UP, step_passability, terminal
from sumo_mcts.model.gaps import TAKEN
from sumo_mcts.model.interaction import ROUND_SHARE, meet, place_is_free
from sumo_mcts.model.local_map import (
    AGENT,
    ENTERS,
    HALF_LENGTH,
    NODE,
    UPSTREAM,
    LocalMap,
    S,
    State,
    V,
    chain_gap,
    follows,
    on_other_level,
)
from sumo_mcts.model.motion import FREE, OFF_END, advance, begin_change, can_change, pose_of
from sumo_mcts.model.occupancy import late_cost
from sumo_mcts.model.reactions import undisturbed
from sumo_mcts.model.route import Upstream, route_map
from sumo_mcts.numerics.geometry import Box
from sumo_mcts.planners.actions import lasting
from sumo_mcts.planners.base import Task
from sumo_mcts.planners.candidates import follow_line
from sumo_mcts.planners.mcts import in_steps, mcts_params
from sumo_mcts.planners.ply import ALIVE, LOST
from sumo_mcts.road import STOP, RoadMap
from sumo_mcts.world.roadmap import known_roadmap

meet, place_is_free, step_passability, terminal = map(
    compiled, (meet, place_is_free, step_passability, terminal)
)

NO_OTHERS = np.zeros((0, 2))  # who reacts in the search


def ending_lane(length: float = 500.0) -> RoadMap:
    """Two lanes of edge a, of which only the left one leads on to edge b."""
    return build(
        [
            Lane("a", 0, ((0.0, -1.6), (length, -1.6))),
            Lane("a", 1, ((0.0, 1.6), (length, 1.6)), ("b_0",)),
            Lane("b", 0, ((length, 1.6), (length + 500.0, 1.6))),
        ]
    )


def view(
    road: RoadMap, lane: str, s: float, v: float, *agents: Agent
) -> tuple[Task, LocalMap, State]:
    ego = ego_at(road, lane, s, v, route=edges(road, *dict.fromkeys(road.edge_ids)))
    task = task_of(road, ego)
    return task, *local_of(task, scene_of(ego, road, *agents))


@pytest.mark.slow
@settings(deadline=None)
@given(
    st.floats(50.0, 480.0),
    st.floats(0.0, 15.0),
    st.floats(0.0, 200.0),
    st.floats(0.0, 15.0),
    st.sampled_from(["a_0", "a_1"]),
)
def test_a_metre_more_never_costs_more_than_the_time_it_saves(
    s: float, v: float, gap: float, leader_v: float, lane: str
) -> None:
    """Else it would pay to stand before a slow leader, or before the end of a lane."""
    task, local, state = view(ending_lane(), lane, 100.0, 10.0)
    here, further = (state._replace(s=s + more, v=v) for more in (0.0, 1.0))
    rise = terminal(local, task.cost, further, gap, leader_v, 8.0) - terminal(
        local, task.cost, here, gap + 1.0, leader_v, 8.0
    )
    assert rise <= task.cost.progress / local.limit + 1e-9


def test_the_end_of_a_lane_counts_like_somebody_who_stands_there_and_goes_on_being_urgent() -> None:
    task, local, state = view(ending_lane(), "a_0", 400.0, 10.0)
    at_the_end = terminal(local, task.cost, state._replace(s=498.0, v=0.0), math.inf, 0.0, 8.0)
    on_the_other = terminal(
        local,
        task.cost,
        state._replace(node=int(np.flatnonzero(task.route.lane == 1)[0]), s=498.0, v=0.0),
        math.inf,
        0.0,
        8.0,
    )
    urgency = (14.4 - 100.0 / local.limit) / 9.0
    slow = 1.0 - math.sqrt(2.0 * 2.6 * 2.0) / local.target_lane_speed
    worth = task.cost.progress + task.cost.route * urgency * (1.0 + RUN_UP * slow)
    assert at_the_end - on_the_other == pytest.approx(worth * task.cost.tail_s, rel=0.01)


@pytest.mark.parametrize("length", [100.0, 249.0, 251.0, 2000.0])
def test_followers_are_seen_over_the_end_of_a_lane_however_long_it_is(length: float) -> None:
    road = build(
        [
            Lane("a", 0, ((0.0, 0.0), (length, 0.0)), ("b_0",)),
            Lane("b", 0, ((length, 0.0), (length + 400.0, 0.0))),
        ]
    )
    _, local, state = view(road, "b_0", 20.0, 10.0, Agent("f", "a_0", length - 10.0, 10.0))
    assert chain_gap(local, state.node - 1, length - 10.0, state.node, 20.0) == pytest.approx(30.0)
    assert local.followers == 1


def test_the_changes_to_come_are_known_before_the_lanes_part() -> None:
    """One lane leads to the rightmost of three, of which only the leftmost goes on."""
    lanes = [
        Lane("b", k, ((100.0, 3.2 * k), (300.0, 3.2 * k)), ("c_0",) if k == 2 else ())
        for k in range(3)
    ]
    road = build(
        [
            Lane("a", 0, ((0.0, 0.0), (100.0, 0.0)), ("b_0",)),
            *lanes,
            Lane("c", 0, ((300.0, 6.4), (600.0, 6.4))),
        ]
    )
    task, local, state = view(road, "a_0", 90.0, 10.0)
    assert task.route.changes.tolist()[:4] == [0, 2, 1, 0] and task.route.needed.tolist()[:4] == [
        2,
        2,
        1,
        0,
    ]
    assert (
        local.urgency[state.node - local.first] == local.urgency[state.node + 1 - local.first] > 1.0
    )


def test_going_on_is_no_loss_where_the_next_edge_needs_more_changes_than_this_one() -> None:
    """Both lanes have to be left for one further left: the right one once here, and twice where the
    lanes are three."""
    three = [
        Lane("b", k, ((100.0, 3.2 * k), (200.0, 3.2 * k)), ("c_0",) if k == 2 else ())
        for k in range(3)
    ]
    two = [Lane("a", k, ((0.0, 3.2 * k), (100.0, 3.2 * k)), (f"b_{k}",)) for k in (0, 1)]
    road = build([*two, *three, Lane("c", 0, ((200.0, 6.4), (500.0, 6.4)))])
    task, local, state = view(road, "a_0", 90.0, 0.0)
    assert task.route.needed.tolist()[:5] == [2, 1, 2, 1, 0]
    rates = [
        step_passability(local, task.ego, task.cost, state._replace(node=node))
        for node in (state.node, task.route.next[state.node])
    ]
    assert rates[0] == pytest.approx(rates[1])


# --- bridges ---


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lane", "s", "contact"), [("br_0", 98.4 + 2.5, False), ("eo_0", 41.0, True)]
)
def test_who_drives_on_the_bridge_above_is_not_met(lane: str, s: float, contact: bool) -> None:
    """The bridge is at x = 50, 40 m along the road below it."""
    task, local, state = view(crossing(), "wi_0", 10.0, 10.0, Agent("there", lane, s, 0.0))
    below = state._replace(
        node=int(np.flatnonzero(task.route.lane == task.road.lane_ids.index("eo_0"))[0]), s=42.5
    )
    found = meet(local, task.ego, task.cost, below, NO_OTHERS, local.followers, 0)
    assert found.contact == contact and (contact or found.rate == 0.0)


def test_what_lies_behind_a_short_edge_is_not_behind_a_bridge() -> None:
    """Two junctions 8 m apart are one place: a long vehicle stands on both."""
    lanes = [
        Lane("a", 0, ((0, 0), (100, 0)), (":j_0",)),
        Lane(":j", 0, ((100, 0), (110, 0)), ("m_0",), junction="j"),
        Lane("m", 0, ((110, 0), (118, 0)), (":k_0",)),
        Lane(":k", 0, ((118, 0), (128, 0)), ("b_0",), junction="k"),
        Lane("b", 0, ((128, 0), (300, 0))),
        Lane("side", 0, ((105, -80), (105, -6)), (":s_0",)),
        Lane(":s", 0, ((105, -6), (105, 6)), ("out_0",), junction="j"),
        Lane("out", 0, ((105, 6), (105, 90))),
        Lane("over", 0, ((60, -80), (60, 80))),
    ]
    road = build(lanes)
    ego = ego_at(road, "side_0", 70.0, 3.0, route=edges(road, "side", "out"))
    task = task_of(road, ego)
    local, state = local_of(
        task,
        scene_of(
            ego,
            road,
            Agent("long", "b_0", 4.0, 0.0, length=30.0),
            Agent("over", "over_0", 80.0, 0.0),
        ),
    )
    inside = state._replace(node=state.node + 1, s=6.0)
    assert not on_other_level(local, inside.node, inside.s, 5.0, 0, 0) and on_other_level(
        local, inside.node, inside.s, 5.0, 0, 1
    )


@pytest.mark.parametrize("name", ["unprotected-left-turn", "highway-exit", "straight-line"])
def test_whoever_the_referee_would_count_is_never_on_another_level(name: str) -> None:
    config = load(scenario_path(name))
    road, rng = known_roadmap(str(config.sumo.net)), np.random.default_rng(0)
    route = route_map(
        road,
        tuple(road.edge_ids.index(edge) for edge in config.traffic.actors[0].route),
        0,
        5.0,
        1.0,
        50.0,
        2.0,
    )
    met = 0
    for _ in range(400):
        node, lane = rng.integers(len(route.lane)), int(rng.integers(len(road.lane_ids)))
        s, other_s = (float(rng.uniform(0.0, road.length[k])) for k in (route.lane[node], lane))
        level = levels(road, route.lane[[node]], np.array([lane]))
        other = moving_on(np.array([[lane]]), np.array([[other_s]]))
        nodes = np.full(len(road.lane_ids), -1)
        (place,) = tables_of(
            road.length, route.upstream, nodes, np.array([lane]), other, 0.2, 1.0
        ).place
        local = SimpleNamespace(first=node, level=level, place=place, node=route.table)
        if can_meet(road, (int(route.lane[node]), s, 5.0), (lane, other_s, 5.0)):
            met += 1
            assert not on_other_level.py_func(local, node, s, 5.0, 0, 0), (
                road.lane_ids[lane],
                other_s,
                road.lane_ids[route.lane[node]],
                s,
            )
    assert met > 20


@pytest.mark.slow
@pytest.mark.parametrize(
    ("progress", "contact"), [(0.0, False), (0.45, True), (0.52, True), (0.6, False)]
)
def test_who_is_beside_the_ego_in_the_lane_that_it_leaves_is_met(
    progress: float, contact: bool
) -> None:
    """SUMO counts lanes: until the ego counts to the other lane, and a step longer, nobody may be
    beside it in its own."""
    road = lanes_east(2, 900.0)
    task, local, state = view(road, "a_0", 100.0, 10.0, Agent("beside", "a_0", 103.0, 10.0, d=-2.6))
    if progress == 0.0:  # alone in its lane, with somebody whose box is far aside: the boxes decide
        assert not meet(local, task.ego, task.cost, state, NO_OTHERS, local.followers, 0).contact
        return
    first, second = (
        (state.node, state.node + 1) if progress <= 0.5 else (state.node + 1, state.node)
    )
    changing = state._replace(node=first, other=second, progress=progress)
    assert (
        meet(local, task.ego, task.cost, changing, NO_OTHERS, local.followers, 0).contact == contact
    )


@pytest.mark.parametrize(
    ("gap", "accel", "contact"), [(1.0, 1.5, True), (1.0, 0.5, False), (2.0, 1.5, False)]
)
def test_a_change_without_a_duration_leads_a_step_down_the_old_lane_first(
    gap: float, accel: float, contact: bool
) -> None:
    """SUMO moves the ego, looks for collisions, and puts it into the other lane: with steps of a
    second that is metres."""
    road = lanes_east(2, 900.0)
    ego = ego_at(road, "a_0", 100.0, 0.0)
    task = task_of(road, ego, physics=Physics(1.0, False, 0.0))
    local, state = local_of(
        task, scene_of(ego, road, Agent("x", "a_0", 105.0 + gap, 0.0), step=1.0)
    )
    after, _ = advance(local, task.ego, begin_change(local, task.ego, state, 1), accel, 0.0)
    assert after.node != state.node and after.s == pytest.approx(100.0 + accel)
    assert pose_of(local, task.ego, after)[1] == pytest.approx(1.6, abs=1e-3)
    assert meet(local, task.ego, task.cost, after, NO_OTHERS, 0, 1).contact == contact
    later, _ = advance(local, task.ego, after, 0.0, 1.0)
    assert later.node == after.node and (later.progress, later.other) == (0.0, -1)


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_whom_a_first_look_leaves_out_would_not_have_mattered(seed: int) -> None:
    """Local.reach spares most agents a closer look; without it the result is the same to the last
    bit."""
    rng = np.random.default_rng(seed)
    road = crossing() if seed % 2 else lanes_east(3, 400.0)
    here, lanes = ("wi_0", ["eo_0", "br_0", "wi_0"]) if seed % 2 else ("a_1", ["a_0", "a_1", "a_2"])
    agents = [
        Agent(
            f"x{k}",
            str(rng.choice(lanes)),
            rng.uniform(6.0, 90.0),
            rng.uniform(0.0, 20.0),
            rng.uniform(-1.6, 1.6),
        )
        for k in range(12)
    ]
    task, local, state = view(road, here, rng.uniform(10.0, 60.0), rng.uniform(0.0, 15.0), *agents)
    everywhere = np.broadcast_to(
        np.array([-np.inf, np.inf, -np.inf, np.inf]), local.bounds.shape
    ).copy()
    for index in (0, 1, 5, 20, 60):
        after = state._replace(s=state.s + state.v * index * local.dt)
        seen, all_of_them = (
            meet(view, task.ego, task.cost, after, NO_OTHERS, 0, index)
            for view in (local, local._replace(bounds=everywhere))
        )
        assert seen == all_of_them


def on_foot(ahead: float, v: float = 0.0, who: str = "") -> tuple[Task, LocalMap, State]:
    """Somebody comes towards an ego that drives at v, `ahead` m before its front."""
    walker = Agent(
        "walker",
        who,
        v=1.0,
        length=0.4,
        width=0.5,
        x=100.0 + ahead,
        heading=math.pi,
        s=100.2 + ahead,
    )
    return view(lanes_east(1), "a_0", 100.0, v, walker)


def test_who_is_on_foot_walks_round_an_ego_that_stands() -> None:
    """Else it would set off where all that is left is to stand still, only to be met a little
    later."""
    task, local, state = on_foot(0.1)
    met = meet(local, task.ego, task.cost, state, NO_OTHERS, local.followers, 0)
    assert not met.contact and met.rate == pytest.approx(ROUND_SHARE * task.cost.claim)
    task, local, state = on_foot(1.0)
    moving, standing = (
        meet(local, task.ego, task.cost, state._replace(v=v), NO_OTHERS, local.followers, 0).rate
        for v in (0.2, 0.0)
    )
    assert moving > 0.0 and standing == pytest.approx(ROUND_SHARE * moving), (
        "and so where somebody is going to come"
    )


@pytest.mark.parametrize(
    ("now", "then"),
    [
        ({"v": 0.5}, {}),
        ({"v": 5.0}, {"v": 0.0, "a": 0.0}),  # it drives, and plans to stop in somebody's way
        (
            {},
            {"v": 0.0, "a": -2.0},
            # it has come to its stand in this step: with ballistic steps of a second it may have
            # come
            # metres
        ),
        ({"who": "a_0"}, {}),
    ],
)
def test_but_nobody_walks_round_an_ego_that_drives_and_no_vehicle_does(
    now: dict[str, Any], then: dict[str, float]
) -> None:
    task, local, state = on_foot(0.1, **now)
    assert meet(
        local, task.ego, task.cost, state._replace(**then), NO_OTHERS, local.followers, 0
    ).contact


# --- the end of a lane that leads nowhere ---


@pytest.mark.parametrize(("v", "event"), [(10.0, OFF_END), (3.0, OFF_END), (1.5, FREE)])
def test_running_off_the_end_of_a_lane_is_no_way_to_stop(v: float, event: int) -> None:
    task, local, state = view(ending_lane(), "a_0", 400.0, v)
    after, what = advance(local, task.ego, state._replace(s=499.95), v, 0.0)
    assert (what, after.v, after.s) == (event, 0.0, 500.0)


@pytest.mark.parametrize(
    ("lane", "s", "v", "side", "may"),
    [("a_0", 500.0, 0.0, 1, True), ("a_0", 500.0, 2.0, 1, False), ("a_1", 500.0, 0.0, -1, False)],
)
def test_who_is_held_at_the_end_of_a_lane_may_still_leave_it(
    lane: str, s: float, v: float, side: int, may: bool
) -> None:
    task, local, state = view(ending_lane(), lane, 400.0, v)
    assert can_change(local, task.ego, state._replace(s=s), side) == may


# --- standing across two lanes ---


@pytest.mark.parametrize(
    ("lane", "v", "turn", "dear"),
    [("a_1", 0.0, 0.3, True), ("a_1", 0.5, -0.3, True), ("b_0", 0.0, 0.3, True), ("a_1", 1.5, 0.3, False), ("a_1", 0.0, 0.1, False), ("a_0", 0.0, 0.3, False)],
)  # fmt: skip
def test_standing_aslant_is_dear_but_where_the_lane_leads_nowhere(
    lane: str, v: float, turn: float, dear: bool
) -> None:
    task, local, state = view(ending_lane(), lane, 400.0, v)
    costs = [
        step_passability(local, task.ego, task.cost, state._replace(turn=t)) for t in (0.0, turn)
    ]
    assert costs[1] - costs[0] == pytest.approx(task.cost.astride * task.ego.step if dear else 0.0)


# --- stop signs ---


def stop_sign() -> RoadMap:
    """Edge a ends at a stop sign."""
    return build(
        [
            Lane("a", 0, ((0.0, 0.0), (200.0, 0.0)), (":m_0",)),
            Lane(":m", 0, ((200.0, 0.0), (220.0, 0.0)), ("b_0",), junction="m", rule=STOP),
            Lane("b", 0, ((220.0, 0.0), (420.0, 0.0))),
        ]
    )


@pytest.mark.parametrize(
    ("room", "v", "share"),
    [
        (60.0, 5.0, 1.0),
        (10.0, 0.0, 1.0),
        (4.5, 0.0, 0.5),
        (1.5, 0.15, 0.5),
        (1.5, 1.0, 1.0),
        (1.5, 0.0, 0.0),
    ],
)
def test_every_second_counts_until_the_ego_has_stood_at_the_stop_sign(
    room: float, v: float, share: float
) -> None:
    """Its turn comes after that; where it is far away, or has stood, nothing is lost."""
    road = stop_sign()
    ego = ego_at(road, "a_0", 200.0 - room, v, route=edges(road, "a", "b"))
    task = task_of(road, ego)
    local, state = local_of(task, scene_of(ego, road))
    cleared = local._replace(stop_at=math.inf)
    rates = [
        step_passability(each, task.ego, task.cost, state) / task.ego.step
        for each in (local, cleared)
    ]
    assert rates[0] - rates[1] == pytest.approx(task.cost.progress * share)
    ends = [terminal(each, task.cost, state, math.inf, 0.0, 8.0) for each in (local, cleared)]
    assert ends[0] - ends[1] == pytest.approx(
        task.cost.progress * min(max(room - 2.0, 0.0), 30.0) / 4.0
    )


def test_only_the_stop_sign_that_comes_next_and_only_until_the_ego_has_stood_there() -> None:
    road = stop_sign()
    ego = ego_at(road, "a_0", 150.0, 8.0, route=edges(road, "a", "b"))
    task = task_of(road, ego)
    sign = int(np.flatnonzero(task.route.sign)[0])
    assert local_of(task, scene_of(ego, road))[0].stop_at == pytest.approx(200.0)
    assert local_of(task, scene_of(ego, road), cleared=frozenset({sign}))[0].stop_at == math.inf
    ego = ego_at(road, "b_0", 10.0, 8.0, route=edges(road, "a", "b"))
    assert local_of(task, scene_of(ego, road))[0].stop_at == math.inf


# --- a leader far ahead ---


@settings(deadline=None, max_examples=60)
@given(
    st.integers(0, 2),
    st.lists(
        st.tuples(st.integers(0, 2), st.floats(0.0, 590.0), st.floats(4.0, 18.0), st.booleans()),
        max_size=8,
    ),
    st.floats(0.0, 0.6),
)
def test_the_leader_is_the_nearest_ahead_in_the_lanes_of_the_ego(
    lane: int, cars: list[tuple[int, float, float, bool]], progress: float
) -> None:
    """Whether it is in sight or not: looked for in every agent, one after the other."""
    road = lanes_east(3)
    ego = ego_at(road, f"a_{lane}", 200.0, 12.0)
    agents = [
        Agent(f"c{k}", f"a_{n}", s, 5.0 + k, length=length)
        for k, (n, s, length, _) in enumerate(cars)
        if s - length > 205.0 or s < 190.0
    ]
    task = task_of(road, ego)
    local, state = local_of(task, scene_of(ego, road, *agents))
    if progress > 0.1:
        state = state._replace(progress=progress, other=(lane + 1) % 2)
    behind = sum(
        1 << k for k, car in enumerate(cars) if car[3] and k < len(local.trait)
    )  # some of them follow the ego
    lanes = {state.node, state.other}
    gaps = [
        (float(row[S]) - state.s - 2.0 * float(trait[HALF_LENGTH]), float(row[V]))
        for k, (row, trait) in enumerate(zip(local.agent[0], local.trait, strict=True))
        if int(row[NODE]) in lanes and row[S] >= state.s and not follows(local, behind, k)
    ]
    met = meet(local, task.ego, task.cost, state, NO_OTHERS, behind, 0)
    if not met.contact:
        assert (met.near.gap, met.near.leader_v) == pytest.approx(min(gaps, default=(math.inf, 0)))


@pytest.mark.parametrize("ahead", [60.0, 79.0, 85.0, 200.0])
def test_a_leader_counts_at_any_distance(ahead: float) -> None:
    """Else an ego waits where a queue is just out of sight."""
    task, local, state = view(
        lanes_east(1, 900.0), "a_0", 100.0, 10.0, Agent("x", "a_0", 105.0 + ahead, 0.0)
    )
    near = meet(local, task.ego, task.cost, state, NO_OTHERS, 0, 0).near
    assert near.gap == pytest.approx(ahead) and near.leader_v == 0.0
    assert near.followers == 0


@pytest.mark.parametrize("v", [0.0, 5.0, 15.0])
def test_no_place_behind_a_queue_is_worth_waiting_in(v: float) -> None:
    """A metre further on costs at the horizon at most what driving it takes."""
    task, local, state = view(
        lanes_east(1, 900.0), "a_0", 100.0, 10.0, Agent("x", "a_0", 300.0, 0.0)
    )
    worth = []
    for s in range(100, 280):
        there = state._replace(s=float(s), v=v)
        near = meet(local, task.ego, task.cost, there, NO_OTHERS, 0, 0).near
        worth.append(terminal(local, task.cost, there, near.gap, near.leader_v, 8.0))
    assert np.diff(worth).max() <= 1.0 / local.limit + 1e-9


# --- those who leave a lane, those who come late ---


@pytest.mark.parametrize(
    ("lane", "d", "times"),
    [
        ("a_0", 1.7, 5),
        ("a_0", 0.9, 1),
        ("a_0", 0.6, 0),
        ("a_0", 0.0, 0),
        ("a_0", -1.7, 0),
        ("a_2", -1.7, 5),
        ("a_1", 0.0, 99),
    ],
)
def test_who_leaves_the_ego_s_lane_leads_until_its_whole_box_is_out_of_it(
    lane: str, d: float, times: int
) -> None:
    """3.2 m wide lanes, a car 1.8 m wide, 1.2 m/s sideways: it is out at 0.7 m off its own lane's
    centre line."""
    task, local, state = view(
        lanes_east(3, 900.0), "a_1", 100.0, 10.0, Agent("x", lane, 125.0, 8.0, d)
    )
    gaps = [meet(local, task.ego, task.cost, state, NO_OTHERS, 0, k).near.gap for k in range(20)]
    leads = [k for k, gap in enumerate(gaps) if gap < math.inf]
    assert leads == list(range(min(times, 20)))
    if leads:
        assert gaps[0] == pytest.approx(20.0) and meet(
            local, task.ego, task.cost, state, NO_OTHERS, 0, 0
        ).near.leader_v == pytest.approx(8.0)


@pytest.mark.parametrize(
    ("lane", "d", "s", "v", "free"),
    [
        ("a_0", 1.7, 85.0, 13.0, False), ("a_0", 0.6, 85.0, 13.0, True), ("a_0", 1.7, 99.5, 5.0, False), ("a_0", 1.7, 108.0, 5.0, True),
        ("a_0", 1.7, 78.0, 13.0, True), ("a_0", 1.7, 85.0, 3.0, True),
    ],
)  # fmt: skip
def test_who_leaves_a_lane_is_not_cut_in_on_until_its_whole_box_is_out_of_it(
    lane: str, d: float, s: float, v: float, free: bool
) -> None:
    """The ego, at 3 m/s, wants to the right, where somebody moves over to the lane beyond."""
    task, local, state = view(lanes_east(3, 900.0), "a_2", 105.0, 3.0, Agent("x", lane, s, v, d))
    assert (
        place_is_free(
            local, task.ego, task.cost, begin_change(local, task.ego, state, -1), NO_OTHERS, 0
        )
        == free
    )


def test_moving_in_front_of_who_leaves_the_lane_has_its_price() -> None:
    task, local, state = view(
        lanes_east(3, 900.0), "a_2", 105.0, 8.0, Agent("x", "a_0", 86.0, 12.0, 1.7)
    )
    changing = begin_change(local, task.ego, state, -1)._replace(progress=0.1)
    prices = [meet(local, task.ego, task.cost, changing, NO_OTHERS, 0, k).once for k in range(8)]
    assert min(prices[:5]) > 0.0 and max(prices[5:]) == 0.0


@pytest.mark.parametrize(
    ("behind", "taken"), [(40.0, 0.0), (22.24, 0.0), (13.983, 2.5), (9.7, 4.0), (1.5, -1.0)]
)
def test_the_nearer_a_follower_the_dearer_a_lane_change(behind: float, taken: float) -> None:
    """A follower at 8 m/s, an ego at 4: a follower at 2.5 m + 1.8 s * 8 m/s + (64 - 16) / 9 m keeps
    its speed, one at 9.7 m gives up 4 m/s."""
    task, local, state = view(
        lanes_east(3, 900.0), "a_1", 205.0, 4.0, Agent("x", "a_0", 200.0 - behind, 8.0)
    )
    met = meet(
        local,
        task.ego,
        task.cost,
        begin_change(local, task.ego, state, -1)._replace(progress=0.1),
        NO_OTHERS,
        0,
        0,
    )
    if taken < 0.0:
        assert (met.once, met.rate > 0.0, met.near.followers) == (0.0, True, 0)
    else:
        assert (
            met.once == pytest.approx(task.cost.claim * taken / TAKEN, abs=0.01)
            and met.near.followers == 1
        )


@pytest.mark.parametrize(
    ("behind", "free", "at_no_cost"), [(25.0, True, True), (15.0, True, False), (1.5, False, False)]
)
def test_a_place_may_be_free_at_a_price_only(behind: float, free: bool, at_no_cost: bool) -> None:
    task, local, state = view(
        lanes_east(3, 900.0), "a_1", 205.0, 4.0, Agent("x", "a_0", 200.0 - behind, 8.0)
    )
    changed = begin_change(local, task.ego, state, -1)
    assert (
        place_is_free(local, task.ego, task.cost, changed, NO_OTHERS, 0),
        place_is_free(local, task.ego, task.cost, changed, NO_OTHERS, 0, 0.0),
    ) == (free, at_no_cost)


# --- merging ---


def acceleration_lane() -> RoadMap:
    """A ramp leads to the lane a_0, which ends; main_0, from which x_0 branches off, leads to a_1
    beside it, and on to b."""
    return build(
        [
            Lane("ramp", 0, ((-100.0, -60.0), (0.0, 0.0)), ("a_0",)),
            Lane("main", 0, ((-300.0, 3.2), (0.0, 3.2)), ("a_1", "x_0"), speed=30.0),
            Lane("x", 0, ((0.0, 3.2), (80.0, 40.0)), speed=30.0),
            Lane("a", 0, ((0.0, 0.0), (150.0, 0.0)), speed=30.0),
            Lane("a", 1, ((0.0, 3.2), (150.0, 3.2)), ("b_0",), speed=30.0),
            Lane("b", 0, ((150.0, 3.2), (600.0, 3.2)), speed=30.0),
        ]
    )


def moving_on(lane: Ints, s: Floats) -> Moving:
    """Cars on `lane` [T, N] at s [T, N], m."""
    times, n = lane.shape
    return Moving(
        pose=np.zeros((1, times, n, 4)),
        v=np.zeros((1, times, n)),
        lane=lane.astype(np.int32)[None],
        s=s[None],
        valid=np.ones((1, times, n), np.bool_),
        half_length=np.full(n, 2.5),
        half_width=np.full(n, 0.9),
    )


def merging(s: float, v: float, *agents: Agent) -> tuple[Task, LocalMap, State]:
    road = acceleration_lane()
    ego = ego_at(road, "a_0", s, v, route=edges(road, "a", "b"))
    task = task_of(road, ego)
    return task, *local_of(task, scene_of(ego, road, *agents))


@pytest.mark.parametrize(
    ("v", "left", "free", "at_no_cost"),
    [(20.0, 8.0, False, False), (20.0, 45.0, True, False), (14.0, 50.0, True, True)],
)
def test_who_comes_to_the_new_lane_from_beside_the_route_is_behind_there(
    v: float, left: float, free: bool, at_no_cost: bool
) -> None:
    """The ego, at 10 m/s, is 12 m down the acceleration lane; somebody is `left` m before the lane
    beside begins."""
    task, local, state = merging(12.0, 10.0, Agent("x", "main_0", 300.0 - left, v))
    changed = begin_change(local, task.ego, state, 1)
    assert (
        place_is_free(local, task.ego, task.cost, changed, NO_OTHERS, 0),
        place_is_free(local, task.ego, task.cost, changed, NO_OTHERS, 0, 0.0),
    ) == (free, at_no_cost)
    met = meet(local, task.ego, task.cost, changed._replace(progress=0.1), NO_OTHERS, 0, 0)
    assert (met.rate > 0.0, met.once > 0.0, met.near.followers) == (
        not free,
        free and not at_no_cost,
        int(free),
    )


def test_who_comes_from_beside_the_route_leads_nobody_and_matters_to_lane_changes_only() -> None:
    task, local, state = merging(12.0, 10.0, Agent("x", "main_0", 295.0, 20.0))
    met = meet(local, task.ego, task.cost, state, NO_OTHERS, 0, 0)
    assert (met.rate, met.once, met.near.followers, met.near.gap) == (0.0, 0.0, 0, math.inf)


def test_who_is_expected_to_turn_off_before_does_not_come() -> None:
    """Lanes: 0 leads into the route's lane 1, or to lane 2."""
    lane_node, upstream = (
        np.array([-1, 7, -1]),
        Upstream(np.array([0]), np.array([1]), np.array([-50.0])),
    )
    lane = np.array([[0, 0, 0], [0, 0, 0], [1, 0, 2]], np.int32)  # [T, N]
    s = np.array([[10.0, 10.0, 10.0], [40.0, 20.0, 40.0], [5.0, 30.0, 5.0]])
    tables = tables_of(
        np.full(3, 50.0), upstream, lane_node, np.arange(3), moving_on(lane, s), 0.2, 1.0
    )
    node, s = tables.node[0], tables.position[0]
    assert np.where(node <= UPSTREAM, UPSTREAM - node, -1).tolist() == [
        [7, 7, -1],
        [7, 7, -1],
        [-1, 7, -1],
    ]
    assert s.tolist() == [[-40.0, -40.0, 10.0], [-10.0, -30.0, 40.0], [5.0, -20.0, 5.0]]


@pytest.mark.parametrize(
    ("others", "pace"),
    [
        ((), 30.0),
        (
            (
                ("a_1", 60.0, 20.0),
                ("main_0", 290.0, 26.0),
                ("a_0", 50.0, 3.0),
                ("main_0", 50.0, 9.0),
            ),
            23.0,
        ),
    ],
)
def test_the_pace_is_that_of_those_beside_and_of_those_who_come(
    others: tuple[tuple[str, float, float], ...], pace: float
) -> None:
    _, local, _ = merging(12.0, 10.0, *(Agent(str(k), *each) for k, each in enumerate(others)))
    assert local.target_lane_speed == pytest.approx(pace)


def test_at_the_horizon_room_to_get_as_fast_as_the_others_is_worth_something() -> None:
    task, local, state = merging(12.0, 10.0, Agent("x", "a_1", 60.0, 20.0))
    costs = [
        terminal(local, task.cost, state._replace(s=s, v=v), math.inf, 0.0, 8.0)
        for s, v in ((60.0, 0.0), (120.0, 0.0), (120.0, 16.0))
    ]
    no_room, full = 1.0 - math.sqrt(2.0 * 2.6 * 30.0) / 20.0, task.cost.route * task.cost.tail_s
    further = 0.4 * 60.0 / local.limit  # the end of the lane is nearer
    assert costs[1] - costs[0] == pytest.approx(
        RUN_UP * full * (no_room - max(0.0, 1.0 - math.sqrt(2.0 * 2.6 * 90.0) / 20.0)) + further,
        rel=0.01,
    )
    assert costs[2] == pytest.approx(costs[1] - RUN_UP * full * no_room)


@pytest.mark.parametrize(
    ("limit", "room", "urgent"),
    [
        (13.9, 210.0, 0.0),
        (13.9, 190.0, 0.08),
        (33.0, 210.0, 0.89),
        (33.0, 480.0, 0.0),
        (33.0, 100.0, 1.0),
    ],
)
def test_a_lane_change_is_the_sooner_urgent_the_faster_the_road(
    limit: float, room: float, urgent: float
) -> None:
    lanes = [
        Lane("a", k, ((0.0, 3.2 * k), (500.0, 3.2 * k)), ("b_0",) * k, speed=limit)
        for k in range(2)
    ]
    road = build([*lanes, Lane("b", 0, ((500.0, 3.2), (900.0, 3.2)), speed=limit)])
    _, local, state = view(road, "a_0", 500.0 - room, 10.0)
    assert local.urgency[state.node - local.first] == pytest.approx(urgent, abs=0.01)


def test_who_stands_beside_half_out_of_the_lane_leads_nobody() -> None:
    task, local, state = view(
        lanes_east(3, 900.0), "a_1", 100.0, 10.0, Agent("x", "a_0", 103.0, 8.0, 1.0)
    )
    assert meet(local, task.ego, task.cost, state, NO_OTHERS, 0, 0).near.gap == math.inf


def box_at(task: Task, x: float, y: float) -> Box:
    """The ego's, heading east."""
    return Box(x, y, 1.0, 0.0, task.ego.half_length, task.ego.half_width)


@pytest.mark.parametrize(("behind", "dear"), [(0.5, True), (3.5, True), (4.5, False), (9.0, False)])
def test_right_behind_somebody_is_dear_since_it_may_belate_cost(behind: float, dear: bool) -> None:
    """At 10 m/s it was 4 m further back 0.4 s before."""
    task, local, state = view(
        lanes_east(3, 900.0), "a_1", 100.0, 10.0, Agent("x", "a_2", 125.0, 10.0)
    )
    x, y = local.agent[8, 0, :2]
    rate = late_cost(local, task.cost, state, box_at(task, x - 5.0 - behind, y), 8, 0)
    assert rate == (0.5 * task.cost.claim if dear else 0.0)


def test_nobody_is_late_who_stands() -> None:
    task, local, state = view(
        lanes_east(3, 900.0), "a_1", 100.0, 10.0, Agent("x", "a_2", 125.0, 0.0)
    )
    local.agent[:] = local.agent[0]
    x, y = local.agent[8, 0, :2]
    assert late_cost(local, task.cost, state, box_at(task, x - 5.1, y), 8, 0) == 0.0
    assert late_cost(local, task.cost, state, box_at(task, x - 4.9, y), 8, 0) > 0.0


# --- whom the ego has to leave a stretch to ---


@settings(deadline=None)
@given(st.floats(25.0, 60.0), st.floats(10.0, 15.0))
def test_a_stretch_on_a_short_lane_is_not_driven_over_unseen(s: float, v: float) -> None:
    """The foe's way inside the junction has a lane of 0.4 m, in the middle of which the shared
    stretch begins."""
    road = build(
        [
            Lane("w", 0, ((-100.0, 0.0), (-10.0, 0.0)), (":w_0",)),
            Lane(":w", 0, ((-10.0, 0.0), (10.0, 0.0)), ("e_0",), junction="m"),
            Lane("e", 0, ((10.0, 0.0), (200.0, 0.0))),
            Lane("s", 0, ((0.0, -100.0), (0.0, -10.0)), (":s_0",)),
            Lane(":s", 0, ((0.0, -10.0), (0.0, -2.4)), (":t_0",), junction="m"),
            Lane(":t", 0, ((0.0, -2.4), (0.0, -2.0)), (":u_0",), junction="m"),
            Lane(":u", 0, ((0.0, -2.0), (0.0, 10.0)), ("n_0",), junction="m"),
            Lane("n", 0, ((0.0, 10.0), (0.0, 200.0))),
        ],
        [Conflict(":w_0", 8.0, 12.0, ":t_0", 0.2, 0.4, yields=":w_0")],
    )
    ego = ego_at(road, "w_0", 60.0, 5.0, route=edges(road, "w", "e"))
    task = task_of(road, ego)
    local, _ = local_of(task, scene_of(ego, road, Agent("x", "s_0", s, v)))
    assert local.obligation[:, AGENT].tolist() == [0.0]
    assert local.obligation[0, ENTERS] == pytest.approx(90.0 - s + 7.6 + 0.2, abs=1e-6)


# --- who follows ---


@pytest.mark.parametrize("bystanders", [0, 70])
def test_who_follows_does_so_among_however_many(bystanders: int) -> None:
    """Whose contact is imposed braking is written down in 63 bits."""
    away = [Agent(f"p{k:02d}", "", x=40.0 + k, y=60.0) for k in range(bystanders)]
    task, local, state = view(
        lanes_east(3, 900.0), "a_1", 100.0, 15.0, *away, Agent("z", "a_1", 85.0, 15.0)
    )
    assert follows(local, local.followers, bystanders)
    braking = state._replace(s=103.0, v=2.0)
    assert not meet(local, task.ego, task.cost, braking, NO_OTHERS, local.followers, 5).contact
    assert (
        meet(local, task.ego, task.cost, state, NO_OTHERS, 0, 0).near.followers == local.followers
    )  # whoever comes to follow later gets the same bit


# --- between the ends of a long step ---


def sharp_bend() -> RoadMap:
    return build(
        [
            Lane("a", 0, ((0.0, 0.0), (100.0, 0.0)), (":t_0",)),
            Lane(
                ":t",
                0,
                ((100.0, 0.0), (104.0, -1.0), (107.0, -4.0), (108.0, -8.0)),
                ("b_0",),
                junction="t",
            ),
            Lane("b", 0, ((108.0, -8.0), (108.0, -108.0))),
        ]
    )


@pytest.mark.parametrize("step", [0.1, 1.0])
@pytest.mark.parametrize(("x", "y", "end"), [(105.5, -2.5, LOST), (108.0, 1.0, ALIVE)])
def test_who_stands_in_a_bend_is_met_whatever_the_step(
    x: float, y: float, end: int, step: float
) -> None:
    """A step of a second leads past the whole bend; the line back from its end leads elsewhere."""
    road = sharp_bend()
    ego = ego_at(road, "a_0", 99.0, 14.0, route=edges(road, "a", "b"))
    task = task_of(road, ego, physics=Physics(step, False, 3.0))
    scene = scene_of(
        ego, road, Agent("walker", "", v=0.0, length=0.5, width=0.5, x=x, y=y), step=step
    )
    local, state = local_of(task, scene)
    q = in_steps(mcts_params(scenario()), step, local.dt)
    line = lasting(0.0, 0, round(2.0 / step))
    assert follow_line(local, task, q, state, NO_OTHERS, line)[2] == end


def test_an_agent_held_up_before_the_lane_asked_still_counts_as_behind() -> None:
    """Its forecast is on that lane by now, it is not yet: both belong to one moment."""
    road = acceleration_lane()
    ego = ego_at(road, "a_0", 6.0, 1.0, route=edges(road, "a", "b"))
    task = task_of(road, ego)
    scene = scene_of(ego, road, Agent("x", "main_0", 297.0, 20.0))
    local, state = local_of(task, scene, asked=1)
    others, t = undisturbed(local), 4
    assert others.shape == (1, 2)
    assert local.agent[t, 0, NODE] >= 0.0  # the forecast: past the beginning of the lane
    others[0] = 0.5, 20.0  # where it has come to: 1.5 m before it
    changed = begin_change(local, task.ego, state._replace(s=8.0), 1)
    assert not place_is_free(local, task.ego, task.cost, changed, others, t)
