"""What is ahead of the ego, by hand: lanes that the route leaves, gaps in streams, what it owes to
others, and what the bound knows of the way to a gate. Routes begin some lanes before the window."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers import Agent, ego_at, lights
from helpers_model import lanes_east, local_of, plain, road_with_light, scenario, scene_of, task_of

from sumo_mcts.driver.params import cost_params
from sumo_mcts.model import cost, cost_to_go, gaps, kerbs, obligations, reactions
from sumo_mcts.model.leaving import leaving
from sumo_mcts.model.local_map import (
    AGENT,
    AWAY,
    BESIDE,
    CLOCK,
    CLOSES,
    DENSITY,
    END,
    ENTERS,
    FREE_S,
    GAP_S,
    GATE,
    HEAD_ON,
    IN_WAY,
    KERB,
    LATEST,
    LINE,
    MERGES,
    NEXT_FREE_S,
    NEXT_GATE,
    OPENS,
    OWED,
    OWN_NODE,
    PAST,
    SLOT,
    SPREAD,
    STREAM,
    STREAM_S,
    STRETCH_END,
    SURE,
    UNSEEN,
    UNTIL,
    State,
)
from sumo_mcts.model.obligations import Coming
from sumo_mcts.model.reactions import undisturbed
from sumo_mcts.model.route import HOME, LIMIT
from sumo_mcts.scene import GREEN

C = cost_params(scenario())

# --- a lane that the route leaves ---


def left_lanes(
    urgency: list[float], *stream: tuple[int, float, float], here: float = 250.0
) -> list[list[float]]:
    """Nodes 2, 3 lie side by side and then 4, 5, each 100 m long, from 200 m of the route on; the
    right ones, 2 and 4, end there at 400 m. The limit is 15 m/s, on node 5 it is 20 m/s."""
    route: Any = SimpleNamespace(
        station=np.array([0.0, 100.0, 200.0, 200.0, 300.0, 300.0]),
        reach=np.array([math.inf, math.inf, 200.0, math.inf, 100.0, math.inf]),
        length=np.full(6, 100.0), limit=np.array([15.0, 15.0, 15.0, 15.0, 15.0, 20.0]),
        left=np.array([-1, -1, 3, -1, 5, -1]), right=np.array([-1, -1, -1, 2, -1, 4]),
        changes=np.array([0, 0, 1, 0, 1, 0]), next=np.array([1, 3, 4, 5, -1, -1]),
    )  # fmt: skip
    node, s, v = (np.array([each[k] for each in stream]) for k in range(3))
    those = node.astype(np.int64), s, v
    return leaving(route, slice(2, 6), here, np.array(urgency), those).tolist()


def test_the_stream_beside_a_lane_that_is_left() -> None:
    """Two in 300 m, from 50 m of the route on, of which the lanes beside take 100 m to 400 m."""
    found = left_lanes([1.0, 0.0, 1.0, 0.0], (3, 20.0, 8.0), (5, 10.0, 12.0), (4, 10.0, 1.0))
    assert [row[END] for row in found] == [200.0, math.inf, 100.0, math.inf]
    for k in (0, 2):
        assert (found[k][STREAM], found[k][DENSITY]) == pytest.approx((10.0, 2.0 / 300.0))
    for k in (1, 3):
        assert (found[k][STREAM], found[k][DENSITY]) == (0.0, 0.0)
    # none there: as fast as it may be
    assert left_lanes([1.0, 0.0, 1.0, 0.0])[0][:2] == [20.0, 0.0]
    # a lane that is not urgent has none, nor has one that is to be left to the other side
    assert left_lanes([0.0, 0.0, 1.0, 0.0], (5, 10.0, 12.0))[0][:2] == [0.0, 0.0]
    assert left_lanes([-1.0, 0.0, -1.0, 0.0], (5, 10.0, 12.0))[0][:2] == [0.0, 0.0]
    # one on the way to the next lane, which leads onto it
    assert left_lanes([0.0, 0.0, 1.0, 0.0], (3, 90.0, 8.0))[2][STREAM] == 8.0
    assert left_lanes([0.0, 0.0, 1.0, 0.0], (4, 10.0, 8.0))[2][STREAM] == 20.0
    # who is too far behind or ahead is not counted
    assert left_lanes([1.0, 0.0, 1.0, 0.0], (0, 40.0, 5.0), (3, 20.0, 8.0))[0][STREAM] == 8.0


def test_only_the_lanes_that_end_together_are_left_to_one_stream() -> None:
    """Node 4 is to be left elsewhere than node 2."""
    two = left_lanes([1.0, 0.0, 0.0, 0.0], (3, 20.0, 8.0))
    assert two[0][STREAM] == 8.0 and two[2][STREAM] == 0.0


def test_how_much_rarer_a_gap_is_for_a_slow_ego_on_a_route_that_began_before() -> None:
    """1 - exp(-k d^2 / 6), 5 m/s slower."""
    to_leave = np.zeros((3, 4))
    to_leave[2, [STREAM, DENSITY]] = 20.0, 0.04
    local: Any = SimpleNamespace(first=4, to_leave=to_leave)
    for node, share in ((6, 1.0 - math.exp(-0.04 * 25.0 / 6.0)), (5, 0.0), (4, 0.0)):
        state = State(node, 10.0, 15.0, 0.0, 0.0, -1, 0.0)
        assert plain(cost._mismatch)(local, state) == pytest.approx(share)


def test_an_ego_that_overtakes_is_back_as_it_drives() -> None:
    table = np.zeros((4, 40))
    table[:, HOME] = -1.0, 0.0, -1.0, 2.0
    local: Any = SimpleNamespace(node=table)
    for node, home in ((1, 0), (3, 2), (2, 2)):
        state = State(node, 10.0, 15.0, -1.0, 0.4, 3, 0.2)
        assert plain(cost._back)(local, state) == State(home, 10.0, 15.0, -1.0, 0.0, -1, 0.0)


# --- gaps in streams ---


def stream(*those: tuple[int, int, float, float, int]) -> np.ndarray:
    """Node, agent, end of the stretch, m until it enters, kind."""
    rows = np.zeros((len(those), PAST + 1))
    for row, (node, agent, end, enters, kind) in zip(rows, those, strict=True):
        row[[OWN_NODE, AGENT, STRETCH_END, ENTERS, MERGES]] = node, agent, end, enters, kind
    return rows


def adams(count: int, seconds: float, way: float) -> float:
    """(exp(q t) - 1 - q t) / q: `way` m from a stand with 2.6 m/s2, after a second."""
    q, t = count / seconds, 1.0 + math.sqrt(2.0 * way / 2.6)
    return min((math.exp(q * t) - 1.0 - q * t) / q, 20.0)


def test_the_longest_wait_counts_for_all_lanes_that_wait() -> None:
    """Nodes 3, 4, 5 are lanes of one edge, 6 is another one; the ego is 5 m long."""
    leg = np.array([0, 0, 0, 1, 1, 1, 2])
    rows = stream(
        (3, 0, 8.0, 20.0, 0), (3, 1, 12.0, 30.0, 0), (3, 1, 10.0, 40.0, 0), (4, 0, 3.0, 20.0, 0),
        (6, 2, 5.0, 30.0, 0), (5, 3, 9.0, math.inf, 0), (5, 4, 9.0, 10.0, IN_WAY),
    )  # fmt: skip
    found = cost_to_go.gap_times(rows, leg, 2, 7, 10.0, 5.0).tolist()
    two, alone = adams(2, 10.0, 17.0), adams(1, 10.0, 10.0)
    assert two > adams(1, 10.0, 8.0)
    assert found == pytest.approx([0.0, two, two, 0.0, alone])
    many = stream(*((3, k, 12.0, 20.0, 0) for k in range(90)))
    assert cost_to_go.gap_times(many, leg, 2, 7, 10.0, 5.0).tolist() == [0.0, 20.0, 0.0, 0.0, 0.0]
    assert not cost_to_go.gap_times(rows[5:], leg, 2, 7, 10.0, 5.0).any()


# --- what is owed ---


@pytest.mark.parametrize(
    ("yields", "zipper", "merge", "lets_pass", "owes"),
    [
        (True, False, 0, False, True),
        (True, False, 1, False, True),
        (True, True, 0, False, True),  # its path is crossed there
        (True, True, 1, False, False),  # nobody has the right of way
        (False, False, 0, False, False),
        (True, False, 0, True, False),
    ],
)
def test_what_the_ego_owes_inside_a_junction(
    yields: bool, zipper: bool, merge: int, lets_pass: bool, owes: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """Lane 7 is the ego's node 4; its first area is another lane's."""
    monkeypatch.setattr(obligations, "_enters", lambda _, __, i, lane, begin: 10.0 * i + begin)
    areas: Any = SimpleNamespace(
        first=np.array([0, 0, 0, 0, 0, 0, 0, 1, 2]), yields=np.array([True, yields]),
        zipper=np.array([False] * 7 + [zipper]), merge=np.array([0, merge]),
        other=np.array([0, 3]), other_begin=np.array([0.0, 6.0]), end=np.array([0.0, 9.0]),
    )  # fmt: skip
    coming: Any = SimpleNamespace(lets_pass=np.array([lets_pass, True, lets_pass]))
    rows, lanes = np.zeros((9, PAST + 1)), np.array([0, 1, 2, 3, 7])
    used = plain(obligations._find_obligations)(rows, [4], lanes, areas, None, coming)
    assert used == (2 if owes else 0)
    if owes:
        columns = [OWN_NODE, AGENT, STRETCH_END, ENTERS, MERGES]
        assert rows[0, columns].tolist() == [4, 0, 9.0, 6.0, merge]
        assert rows[1, columns].tolist() == [4, 2, 9.0, 26.0, merge]
    assert not rows[used:].any()
    few = np.zeros((1, PAST + 1))
    found = plain(obligations._find_obligations)(few, [4], lanes, areas, None, coming)
    assert found == (1 if owes else 0)


def test_what_an_ego_that_overtakes_owes_to_those_who_come(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Node 2, lane 1, is the lane of the oncoming from 200 m to 500 m of the route; they drive on
    it as lane 3, from its end. One is 60 m along it, one comes to it after 35 m, one is beside."""
    monkeypatch.setattr(obligations, "facing", lambda _: np.array([2, 3, 0, 1]))
    road: Any = SimpleNamespace(lane_ids=["a", "b", "c", "d"])
    route: Any = SimpleNamespace(
        oncoming=np.array([False, True, True]), station=np.array([0.0, 0.0, 200.0]),
        length=np.array([200.0, 200.0, 300.0]), lane=np.array([0, 2, 1]),
    )  # fmt: skip
    lane = np.array([[3, -1, 2], [3, 3, 2], [3, 3, 2]])
    s = np.array([[60.0, 0.0, 5.0], [65.0, 5.0, 6.0], [70.0, 10.0, 7.0]])
    driven = np.array([[0.0, 0.0, 0.0], [5.0, 35.0, 1.0], [10.0, 40.0, 2.0]])
    coming = Coming(
        lane.astype(np.int32), s, driven, np.ones((3, 3), np.bool_), np.zeros(3, np.bool_),
        np.array([False, True, False]),
    )  # fmt: skip
    rows = obligations.to_oncoming(road, route, slice(2, 3), 250.0, coming)
    columns = [OWN_NODE, AGENT, ENTERS, MERGES]
    assert rows[:, columns].tolist() == [
        [2.0, 0.0, 240.0, HEAD_ON],  # m until it has left node 2, at whose end it came in
        [2.0, 1.0, 330.0, UNSEEN],
    ]
    assert np.isinf(rows[:, STRETCH_END]).all()
    assert len(obligations.to_oncoming(road, route, slice(2, 3), 501.0, coming)) == 0
    assert len(obligations.to_oncoming(road, route, slice(0, 1), 0.0, coming)) == 0
    coming.valid[:, 0] = False
    assert obligations.to_oncoming(road, route, slice(2, 3), 250.0, coming)[:, AGENT] == [1.0]


def test_junctions_count_within_a_hundred_and_twenty_metres() -> None:
    route: Any = SimpleNamespace(
        station=np.array([0.0, 100.0, 200.0, 319.0, 330.0, 500.0]),
        internal=np.array([True, True, False, True, True, True]),
    )
    assert obligations.junction_nodes(route, 0, 6, 200.0).tolist() == [1, 3]
    assert obligations.junction_nodes(route, 2, 6, 211.0).tolist() == [3, 4]
    assert obligations.junction_nodes(route, 2, 3, 200.0).tolist() == []


@pytest.mark.parametrize(("lane", "s", "gap"), [(0, 130.0, 25.0), (1, 130.0, 25.0), (0, 104.0, math.inf), (2, 130.0, math.inf)])  # fmt: skip
def test_who_leaves_the_lane_leads_in_it_until_it_is_out(lane: int, s: float, gap: float) -> None:
    """The ego, at 100 m, changes from the right lane to the middle; the rear of the other, 5 m
    long, is in a lane until the third forecast time."""
    road = lanes_east(3, 900.0)
    ego = ego_at(road, "a_0", 100.0, 8.0)
    local, state = local_of(task_of(road, ego), scene_of(ego, road, Agent("x", "a_2", s, 8.0)))
    trait = local.trait.copy()
    trait[0, [BESIDE, UNTIL]] = lane, 3.0
    local, changing = local._replace(trait=trait), state._replace(other=1, progress=0.2)
    found = plain(gaps.gap_to_leaving)
    assert [found(local, changing, 0, s, t) for t in (0, 3)] == [gap, gap]
    assert found(local, changing, 0, s, 4) == math.inf
    trait[0, BESIDE] = -1.0
    assert found(local, changing, 0, s, 0) == math.inf


@pytest.mark.parametrize(
    ("s", "v", "waits"),
    [(110.4, 0.0, True), (110.6, 0.0, False), (105.0, 0.0, True), (104.0, 0.6, True), (104.0, 0.4, False)],
)  # fmt: skip
def test_who_waits_at_a_kerb_does_until_the_ego_has_passed(s: float, v: float, waits: bool) -> None:
    """The crossing ends at 105 m; the ego is 5 m long, and keeps half a metre. It needs two seconds
    to be past the ego's way."""
    road = lanes_east(1, 900.0)
    ego = ego_at(road, "a_0", 100.0, 0.0)
    task = task_of(road, ego)
    local, state = local_of(task, scene_of(ego, road, Agent("x", "a_0", 300.0, 1.0)))
    trait, row = local.trait.copy(), np.zeros((1, PAST + 1))
    trait[0, [SLOT, OWED]] = 0.0
    row[0, [OWN_NODE, STRETCH_END, KERB, PAST]] = state.node, 105.0, 1.0, 2.0
    others = np.zeros((1, 2))
    others[0, CLOCK] = 0.0
    local = local._replace(trait=trait, obligation=row)
    there = state._replace(s=s, v=v)
    assert plain(kerbs.stands_aside)(local, task.ego, there, others, 0) == waits


@pytest.mark.parametrize("names", [("a", "b"), ("b", "a")])
def test_only_the_nearest_behind_is_asked_for_room(names: tuple[str, str]) -> None:
    road = lanes_east(3, 900.0)
    ego = ego_at(road, "a_1", 300.0, 10.0)
    task = task_of(road, ego)
    those = [Agent(names[0], "a_2", 285.0, 10.0), Agent(names[1], "a_2", 265.0, 10.0)]
    local, state = local_of(task, scene_of(ego, road, *those), asked=1)
    others, near = undisturbed(local), sorted(names).index(names[0])
    asked = plain(reactions._gap_when_asked)
    assert asked(local, task.ego, state, others, near, 0) == pytest.approx(10.0)
    assert asked(local, task.ego, state, others, 1 - near, 0) == math.inf
    assert asked(local._replace(asked=0), task.ego, state, others, near, 0) == math.inf
    assert asked(local._replace(asked=-1), task.ego, state, others, near, 0) == math.inf


# --- the way to a gate ---


@pytest.mark.parametrize(("after", "jump"), [(15.0, 0.0), (10.0, 0.1 / 3.0), (20.0, 0.025)])
def test_the_way_to_a_gate_is_known_where_no_lane_differs(after: float, jump: float) -> None:
    """200 m at 15 m/s; where the limit changes, to a share of a step of 0.1 s."""
    road = road_with_light(after=after)
    ego = ego_at(road, "a_0", 50.0, 10.0, route=(0, 2))
    local, _ = local_of(task_of(road, ego), scene_of(ego, road, signals=lights(GREEN)))
    assert local.to_gate[0, SURE] == 0.0 and (local.to_gate[1:, SURE] == -1.0).all()
    assert local.to_gate[0, LATEST] == pytest.approx(200.0 / 15.0)
    assert local.to_gate[0, SPREAD] == pytest.approx(0.0)
    assert local.to_gate[1, LATEST] == pytest.approx(20.0 / 15.0 + local.to_gate[2, LATEST] + jump)


def test_a_gate_without_a_signal_is_open_from_now_on() -> None:
    """Before a stretch that others have a gap in after 7 s; a signal's times are those it shows."""
    road = road_with_light()
    ego = ego_at(road, "a_0", 50.0, 10.0, route=(0, 2))
    route, streams = task_of(road, ego).route, np.array([0.0, 7.0, 0.0])
    shown = lights(GREEN)
    rows, to_gate = cost_to_go.gates(road, route, 0, 3, shown, streams)
    assert rows[0, [LINE, GAP_S]].tolist() == [0.0, 7.0] and len(rows) == 1
    assert to_gate[0, [GATE, FREE_S, AWAY]] == pytest.approx((0.0, 200.0 / 15.0, 200.0))
    assert (to_gate[1:, GATE] == -1.0).all()
    route = route._replace(signal=np.full(3, -1))
    rows, _ = cost_to_go.gates(road, route, 0, 3, shown, streams)
    assert rows[0, [OPENS, CLOSES]].tolist() == [0.0, math.inf]
    assert np.isinf(rows[0, OPENS + 2 :]).all()
    none, _ = cost_to_go.gates(road, route, 0, 3, shown, np.zeros(3))
    assert len(none) == 0


def test_no_gate_is_waited_at_beyond_the_window() -> None:
    """2 s from now, 50 m before the line at 10 m/s: 5 s, and 1 s to be lost; it opens at 20 s."""
    row, to_gate, table = (
        np.full((1, CLOSES + 8), np.inf),
        np.full((3, 7), np.inf),
        np.zeros((9, 40)),
    )
    row[0, [NEXT_GATE, NEXT_FREE_S, GAP_S, STREAM_S, OPENS]] = -1.0, 0.0, 0.0, 0.0, 20.0
    to_gate[:, [GATE, FREE_S]], table[:, LIMIT] = (0.0, 12.0), 10.0
    local: Any = SimpleNamespace(first=4, to_gate=to_gate, gate=row, node=table)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cost_to_go, "passes_at", plain(cost_to_go.passes_at))
        for queue in (0, 2):
            patch.setattr(cost_to_go, "_queued", lambda *_, queue=queue: queue)
            for node, waits in ((4, 12.0), (6, 12.0), (3, 0.0), (7, 0.0)):
                state = State(node, 70.0, 8.0, 0.0, 0.0, -1, 0.0)
                found = plain(cost_to_go.waiting_s)(local, state, 2.0, 1.0)
                assert found == pytest.approx(waits + 2.0 * queue if waits else 0.0)
        to_gate[:, GATE] = -1.0
        state = State(5, 70.0, 8.0, 0.0, 0.0, -1, 0.0)
        assert plain(cost_to_go.waiting_s)(local, state, 2.0, 1.0) == 0.0
