"""The time that is still to be lost beyond the horizon."""

import math

import numpy as np
import pytest
from helpers import Agent, Conflict, Lane, build, crossing, edges, ego_at
from helpers_model import compiled, local_of, road_with_light, scene_of, task_of
from hypothesis import given, settings
from hypothesis import strategies as st

from sumo_mcts.model.cost import terminal
from sumo_mcts.model.cost_to_go import (
    DISCHARGE_S,
    MOST_GAP_S,
    UNKNOWN_S,
    gap_times,
    open_times,
    waiting_s,
)
from sumo_mcts.model.local_map import (
    AGENT,
    CLOSES,
    GAP_S,
    MERGES,
    NEXT_FREE_S,
    NEXT_GATE,
    OPENINGS,
    OPENS,
    OWN_NODE,
    STREAM_S,
    STRETCH_END,
    LocalMap,
    State,
)
from sumo_mcts.model.occupancy import yielding_cost
from sumo_mcts.model.reactions import undisturbed
from sumo_mcts.planners.base import Task
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import AFTER_STOP, GREEN, RED, YELLOW, Signals

terminal, waiting_s, yielding_cost = map(compiled, (terminal, waiting_s, yielding_cost))

Shown = tuple[int, float]  # what a light shows, and until when (s)


def light(*phases: Shown) -> Signals:
    """One signal with one link."""
    return Signals(
        np.array([0, 1], np.int32),
        np.array([[state for state, _ in phases]], np.int32),
        np.array([[until for _, until in phases]]),
    )


RED_FOR_20 = light((RED, 20.0), (GREEN, 50.0), (YELLOW, 53.0), (RED, 90.0), (GREEN, 120.0))


def before_a_light(
    s: float, v: float, signals: Signals, *agents: Agent
) -> tuple[Task, LocalMap, State]:
    road = road_with_light()
    ego = ego_at(road, "a_0", s, v, route=edges(road, "a", "b"))
    task = task_of(road, ego)
    return task, *local_of(task, scene_of(ego, road, *agents, signals=signals))


def test_phases_that_show_green_one_after_the_other_are_one_green() -> None:
    signals = light((GREEN, 5.0), (GREEN, 9.0), (YELLOW, 12.0), (RED, 30.0), (GREEN, math.inf))
    assert open_times(signals, 0, 0) == [(0.0, 9.0), (30.0, math.inf)]
    assert open_times(light((RED, math.inf)), 0, 0) == []
    after_stop = light((AFTER_STOP, 4.0), (GREEN, 9.0), (AFTER_STOP, math.inf))
    assert open_times(after_stop, 0, 0) == [(4.0, 9.0)]
    assert open_times(after_stop, 0, 0, (GREEN, AFTER_STOP)) == [(0.0, math.inf)]


@pytest.mark.parametrize(("time", "waits"), [(0.0, 20.0), (8.0, 12.0), (20.0, 0.0), (49.0, 0.0)])
def test_a_red_light_costs_the_time_until_it_opens(time: float, waits: float) -> None:
    _, local, state = before_a_light(199.99, 0.0, RED_FOR_20)
    assert waiting_s(local, state, time, 0.0) == pytest.approx(waits, abs=0.01)


def test_a_missed_green_costs_the_whole_red_that_follows() -> None:
    _, local, state = before_a_light(200.0 - 30.0, 15.0, RED_FOR_20)
    passes, misses = (waiting_s(local, state, time, 0.0) for time in (47.9, 48.1))
    assert passes == 0.0
    assert misses == pytest.approx(90.0 - 50.1, abs=0.01)


def test_a_light_of_which_nothing_is_known_costs_the_same_at_any_time() -> None:
    _, local, state = before_a_light(190.0, 0.0, light((RED, math.inf)))
    assert waiting_s(local, state, 0.0, 0.0) == waiting_s(local, state, 8.0, 0.0) == UNKNOWN_S


@settings(deadline=None, max_examples=60)
@given(
    st.floats(0.0, 60.0),
    st.floats(0.0, 10.0),
    st.floats(0.0, 30.0),
    st.floats(0.0, 80.0),
    st.lists(st.floats(1.0, 30.0), min_size=2, max_size=2 * OPENINGS),
)
def test_coming_later_never_means_to_be_through_earlier(
    time: float, later: float, gap: float, stream: float, phases: list[float]
) -> None:
    """A state from which nothing was gained is worth no more a cycle later."""
    _, local, state = before_a_light(180.0, 0.0, RED_FOR_20)
    row = local.gate[0]
    row[GAP_S], row[STREAM_S] = gap, stream
    row[OPENS:] = np.inf
    ends = np.cumsum(phases)[: len(phases) // 2 * 2]
    row[OPENS : OPENS + len(ends)] = ends
    now, then = (t + waiting_s(local, state, t, 0.0) for t in (time, time + later))
    assert then >= now - 1e-6


@settings(deadline=None, max_examples=60)
@given(
    st.floats(0.0, 60.0),
    st.floats(0.0, 10.0),
    st.floats(0.0, 190.0),
    st.lists(st.tuples(st.floats(0.0, 30.0), st.floats(0.0, 80.0)), min_size=2, max_size=2),
    st.lists(
        st.lists(st.floats(1.0, 30.0), min_size=2, max_size=2 * OPENINGS), min_size=2, max_size=2
    ),
)
def test_standing_still_never_brings_the_end_of_two_gates_nearer(
    time: float,
    later: float,
    s: float,
    waits: list[tuple[float, float]],
    phases: list[list[float]],
) -> None:
    """Nor does being further back."""
    _, local, state = before_a_light(s, 0.0, RED_FOR_20)
    gate = np.repeat(local.gate, 2, axis=0)
    gate[0, NEXT_GATE], gate[0, NEXT_FREE_S], gate[1, NEXT_GATE] = 1, 8.0, -1
    for row, (gap, stream), each in zip(gate, waits, phases, strict=True):
        row[GAP_S], row[STREAM_S] = gap, stream
        row[OPENS:] = np.inf
        ends = np.cumsum(each)[: len(each) // 2 * 2]
        row[OPENS : OPENS + len(ends)] = ends
    local = local._replace(gate=gate)
    now, then = (t + waiting_s(local, state, t, 0.0) for t in (time, time + later))
    assert then >= now - 1e-6
    behind = state._replace(s=max(s - 10.0, 0.0))
    away, further = ((200.0 - each.s) / 15.0 for each in (state, behind))
    at_once, back = (
        time + free + waiting_s(local, each, time, 0.0)
        for free, each in ((away, state), (further, behind))
    )
    assert back >= at_once - 1e-6


@settings(deadline=None, max_examples=40)
@given(
    st.lists(st.floats(181.0, 199.0), max_size=6),
    st.floats(0.0, 8.0),
    st.floats(0.0, 8.0),
    st.floats(0.0, 8.0),
)
def test_standing_in_a_queue_never_brings_the_end_of_it_nearer(
    cars: list[float], opens: float, time: float, later: float
) -> None:
    """Also where its light opens in between; the queue stands."""
    signals = light((RED, opens + 0.01), (GREEN, 30.0), (RED, 60.0), (GREEN, 90.0))
    queue = [Agent(f"{k}", "a_0", s, 0.0) for k, s in enumerate(cars)]
    _, local, state = before_a_light(180.0, 0.0, signals, *queue)
    local = local._replace(agent=np.repeat(local.agent[:1], len(local.agent), axis=0))
    now, then = (t + waiting_s(local, state, t, 0.0) for t in (time, time + later))
    assert then >= now - 1e-6


def test_a_queue_takes_its_time_where_the_light_is_open_too() -> None:
    cars = [Agent(f"{k}", "a_0", 198.0 - 8.0 * k, 0.0) for k in range(5)]
    for signals in (light((GREEN, math.inf)), light((GREEN, 9.0), (RED, 40.0), (GREEN, 90.0))):
        _, local, state = before_a_light(150.0, 0.0, signals, *cars)
        local = local._replace(agent=np.repeat(local.agent[:1], len(local.agent), axis=0))
        # it would be there after 50 / 15 s
        alone = waiting_s(local, state._replace(s=199.0), 0.0, 0.0)
        waits = waiting_s(local, state, 0.0, 0.0) + 50.0 / 15.0
        assert alone == 0.0
        assert waits == pytest.approx(
            5 * DISCHARGE_S if signals.until[0, 0] > 10.0 else 40.0 + 5 * DISCHARGE_S - 9.0
        )


def test_each_vehicle_of_the_queue_before_the_light_takes_its_time_to_start() -> None:
    waits = [
        waiting_s(local, state, 8.0, 0.0)
        for _, local, state in (
            before_a_light(160.0, 0.0, RED_FOR_20, *cars)
            for cars in (
                [],
                [Agent("one", "a_0", 198.0, 0.0)],
                [Agent("one", "a_0", 198.0, 0.0), Agent("two", "a_0", 190.0, 0.0)],
                [Agent("behind", "a_0", 140.0, 0.0)],
            )
        )
    ]
    assert np.diff(waits[:3]) == pytest.approx([DISCHARGE_S, DISCHARGE_S])
    assert waits[3] == waits[0]


def two_lanes_before_a_light() -> RoadMap:
    """Only the left lane of a leads through the light to b; the right one has a queue of none."""
    return build(
        [
            Lane("a", 0, ((0.0, -1.6), (200.0, -1.6))),
            Lane("a", 1, ((0.0, 1.6), (200.0, 1.6)), (":m_0",)),
            Lane(":m", 0, ((200.0, 1.6), (220.0, 1.6)), ("b_0",), junction="m", signal="t", link=0),
            Lane("b", 0, ((220.0, 1.6), (520.0, 1.6))),
        ]
    )


def test_leaving_the_queue_for_a_lane_that_leads_elsewhere_saves_nothing() -> None:
    road = two_lanes_before_a_light()
    queue = [Agent(f"q{k}", "a_1", 198.0 - 8.0 * k, 0.0) for k in range(4)]
    found = []
    for lane in ("a_0", "a_1"):
        ego = ego_at(road, lane, 150.0, 0.0, route=edges(road, "a", "b"))
        task = task_of(road, ego)
        local, state = local_of(task, scene_of(ego, road, *queue, signals=RED_FOR_20))
        found.append(waiting_s(local, state, 8.0, 0.0))
    assert found[0] == found[1] > 4 * DISCHARGE_S


def test_what_leads_onto_a_lane_that_the_route_leaves_is_worth_as_much_as_that() -> None:
    """Else the ego would gain by creeping towards it: the wait at the light would begin there."""
    road = build(
        [
            Lane("a", 0, ((0.0, 1.6), (200.0, 1.6)), ("b_1",)),
            Lane("b", 0, ((200.0, -1.6), (300.0, -1.6)), (":m_0",)),
            Lane("b", 1, ((200.0, 1.6), (300.0, 1.6)), ("d_0",)),
            Lane(
                ":m", 0, ((300.0, -1.6), (320.0, -1.6)), ("c_0",), junction="m", signal="t", link=0
            ),
            Lane("c", 0, ((320.0, -1.6), (520.0, -1.6))),
            Lane("d", 0, ((300.0, 1.6), (520.0, 1.6))),
        ]
    )
    for lane, s, away in (("a_0", 150.0, 150.0), ("b_1", 50.0, 50.0), ("b_0", 50.0, 50.0)):
        route = edges(road, *"abc"["abc".index(lane[0]) :])
        ego = ego_at(road, lane, s, 0.0, route=route)
        found = local_of(task_of(road, ego), scene_of(ego, road, signals=RED_FOR_20))
        waits = waiting_s(*found, 0.0, 0.0)
        assert waits == pytest.approx(20.0 - away / 15.0)


def turn_off(side: int) -> RoadMap:
    """Three lanes a to a light; only the outermost on `side` leads through it to b, which gives way
    to a stream d that comes across."""
    outer, y = 1 + side, 3.2 * side
    return build(
        [
            *(
                Lane(
                    "a", k, ((0.0, 3.2 * (k - 1)), (200.0, 3.2 * (k - 1))), (":m_0",) * (k == outer)
                )
                for k in range(3)
            ),
            Lane(":m", 0, ((200.0, y), (220.0, y)), ("b_0",), junction="m", signal="t", link=0),
            Lane("b", 0, ((220.0, y), (520.0, y))),
            Lane("d", 0, ((210.0, -90.0 * side), (210.0, -10.0 * side)), (":n_0",)),
            Lane(":n", 0, ((210.0, -10.0 * side), (210.0, 10.0 * side)), ("e_0",), junction="m"),
            Lane("e", 0, ((210.0, 10.0 * side), (210.0, 90.0 * side))),
        ],
        [Conflict(":m_0", 7.0, 13.0, ":n_0", 10.0 + 3.2 - 3.0, 10.0 + 3.2 + 3.0, yields=":m_0")],
    )


@settings(deadline=None, max_examples=25)
@given(
    st.integers(0, 2),
    st.floats(20.0, 150.0),
    st.floats(0.0, 15.0),
    st.lists(st.tuples(st.integers(0, 2), st.floats(5.0, 195.0), st.floats(0.0, 15.0)), max_size=4),
    st.lists(st.tuples(st.floats(5.0, 75.0), st.floats(5.0, 15.0)), max_size=3),
    st.sampled_from([0.0, 8.0]),
)
def test_a_mirrored_scene_is_worth_the_same(
    lane: int,
    s: float,
    v: float,
    beside: list[tuple[int, float, float]],
    across: list[tuple[float, float]],
    time: float,
) -> None:
    found = []
    for side in (1, -1):
        road = turn_off(side)
        ego = ego_at(road, f"a_{1 + side * (lane - 1)}", s, v, route=edges(road, "a", "b"))
        task = task_of(road, ego)
        cars = [
            *(
                Agent(f"a{k}", f"a_{1 + side * (n - 1)}", at, u)
                for k, (n, at, u) in enumerate(beside)
            ),
            *(Agent(f"d{k}", "d_0", at, u) for k, (at, u) in enumerate(across)),
        ]
        local, state = local_of(task, scene_of(ego, road, *cars, signals=RED_FOR_20))
        waits = waiting_s(local, state, time, 0.0)
        found.append((len(local.gate), waits, terminal(local, task.cost, state, 50.0, 9.0, time)))
    assert found[0] == pytest.approx(found[1])


def owed(*agents: int, end: float = 12.0) -> np.ndarray:  # type: ignore[type-arg]
    """Obligations on node 3."""
    rows = np.zeros((len(agents), MERGES + 1))
    for row, agent in zip(rows, agents, strict=True):
        row[OWN_NODE], row[AGENT], row[STRETCH_END] = 3, agent, end
    return rows


LEGS = np.array([0, 0, 0, 0, 0, 1])  # of six nodes


def test_lanes_side_by_side_wait_for_the_same_gap() -> None:
    rows = np.vstack([owed(0), owed(1, 2, 3)])
    rows[1:, OWN_NODE] = 4
    both = gap_times(rows, LEGS, 0, 6, 10.0, 5.0)
    assert both[3] == both[4] == gap_times(rows[1:], LEGS, 0, 6, 10.0, 5.0)[4]
    rows[1:, OWN_NODE] = 5  # the next junction
    apart = gap_times(rows, LEGS, 0, 6, 10.0, 5.0)
    assert 0.0 < apart[3] < apart[5]


def test_the_gap_in_a_stream_comes_the_later_the_more_vehicles_come() -> None:
    times = [gap_times(owed(*range(n)), LEGS, 0, 6, 10.0, 5.0)[3] for n in (1, 3, 6)]
    assert 0.0 < times[0] < times[1] < times[2] <= MOST_GAP_S
    assert gap_times(owed(1, 1), LEGS, 0, 6, 10.0, 5.0)[3] == times[0]  # one vehicle, two stretches
    # Adams: three in ten seconds, and 1 + sqrt(2 * 17 / 2.6) s to clear the stretch
    clears = 1.0 + math.sqrt(2.0 * 17.0 / 2.6)
    assert times[1] == pytest.approx((math.exp(0.3 * clears) - 1.0 - 0.3 * clears) / 0.3)


def test_a_stream_that_its_light_stops_is_waited_for_until_then_only() -> None:
    _, local, state = before_a_light(199.99, 0.0, light((GREEN, math.inf)))
    row = local.gate[0]
    row[GAP_S], row[STREAM_S] = 30.0, math.inf
    for_ever = waiting_s(local, state, 0.0, 0.0)
    row[STREAM_S] = 10.0
    until_red = waiting_s(local, state, 0.0, 0.0)
    assert for_ever == pytest.approx(30.0)
    assert until_red == pytest.approx(30.0 * (1.0 - math.exp(-10.0 / 30.0)), abs=0.01)
    row[CLOSES] = 5.0  # the own green ends before the stream does, and no other one is known
    share = math.exp(-5.0 / 30.0)
    own = 30.0 * (1.0 - share) + share * UNKNOWN_S
    assert waiting_s(local, state, 0.0, 0.0) == pytest.approx(own, abs=0.05)


def test_there_is_a_gate_where_the_ego_yields_and_none_where_it_has_priority() -> None:
    road = crossing(bridge=False)
    gates = []
    for begin, end, other in (("si", "no", "wi"), ("wi", "eo", "si")):
        ego = ego_at(road, f"{begin}_0", 70.0, 5.0, route=edges(road, begin, end))
        task = task_of(road, ego)
        cars = [Agent(f"{k}", f"{other}_0", 85.0 - 25.0 * k, 10.0) for k in range(3)]
        local, state = local_of(task, scene_of(ego, road, *cars))
        gates.append((len(local.gate), waiting_s(local, state, 8.0, 0.0)))
    assert gates[0][0] == 1
    assert gates[0][1] > 0.5
    assert gates[1] == (0, 0.0)


def turn_with_a_place_to_wait() -> RoadMap:
    """A left turn over two lanes inside the junction; only the second one crosses the stream that
    comes from the east."""
    return build(
        [
            Lane("wi", 0, ((-100.0, 0.0), (-10.0, 0.0)), (":w1_0",)),
            Lane(":w1", 0, ((-10.0, 0.0), (-2.0, 0.0)), (":w2_0",), junction="c"),
            Lane(":w2", 0, ((-2.0, 0.0), (0.0, 10.0)), ("no_0",), junction="c"),
            Lane("no", 0, ((0.0, 10.0), (0.0, 100.0))),
            Lane("ei", 0, ((100.0, 4.0), (10.0, 4.0)), (":ew_0",)),
            Lane(":ew", 0, ((10.0, 4.0), (-10.0, 4.0)), ("wo_0",), junction="c"),
            Lane("wo", 0, ((-10.0, 4.0), (-100.0, 4.0))),
        ],
        [Conflict(":w2_0", 2.0, 7.0, ":ew_0", 8.0, 13.0, yields=":w2_0")],
    )


@pytest.mark.parametrize(("lane", "s", "due"), [(":w1_0", 7.0, False), (":w2_0", 1.0, True)])
def test_waiting_inside_short_of_the_stream_has_no_price(lane: str, s: float, due: bool) -> None:
    road = turn_with_a_place_to_wait()
    ego = ego_at(road, lane, s, 0.0, route=edges(road, "wi", "no"))
    task = task_of(road, ego)
    local, state = local_of(task, scene_of(ego, road, Agent("x", "ei_0", 75.0, 12.0)))
    assert len(local.obligation) == 1
    assert (yielding_cost(local, task.ego, task.cost, state, undisturbed(local), 0) > 0.0) == due
