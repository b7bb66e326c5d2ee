"""Waiting at gates and obligations: against plain integration, and values worked out by hand."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from helpers import Lane, build, crossing, ego_at, lane
from helpers_model import local_of, plain, road_with_light, scene_of, task_of

from sumo_mcts.model.cost_to_go import UNKNOWN_S, _stream_ends, gap_times, passes_at
from sumo_mcts.model.least_cost import _fill_sure, _merged, _opens
from sumo_mcts.model.local_map import (
    AGENT,
    AWAY,
    CLOSES,
    ENTERS,
    FREE_S,
    GAP_S,
    GATE,
    IN_WAY,
    LATEST,
    LINE,
    MERGES,
    OPENINGS,
    OPENS,
    OWN_NODE,
    PAST,
    SPREAD,
    STREAM_S,
    STRETCH_END,
    SURE,
    SURE_LATEST,
    SURE_NEXT,
    SURE_SPREAD,
)
from sumo_mcts.model.obligations import Coming, _enters
from sumo_mcts.model.route import LENGTH, LIMIT, NEXT
from sumo_mcts.numerics.lanes import ahead_of
from sumo_mcts.scene import GREEN, RED, YELLOW, Signals

# --- when a gate is passed ---


def gate(openings: list[tuple[float, float]], gap: float = 0.0, stream: float = 0.0) -> object:
    """A local map with one gate: open from .. to, s; a stream with a gap every so many seconds,
    until it ends."""
    row = np.full(CLOSES + 2 * OPENINGS, np.inf)
    row[GAP_S], row[STREAM_S] = gap, stream
    row[OPENS : OPENS + 2 * len(openings)] = np.ravel(openings)
    return SimpleNamespace(gate=row[None])


def passed(
    openings: list[tuple[float, float]], gap: float, stream: float, arrives: float, time: float,
    queue: float,
) -> float:  # fmt: skip
    """The same by small steps: the mean wait is the sum of how likely the ego still waits."""
    tick, waits, share, t = 1e-3, 0.0, 1.0, min(time, arrives)
    end = max(closes for _, closes in openings)
    while t < min(end, 200.0) and share > 1e-9:
        is_open = any(opens <= t < closes for opens, closes in openings)
        if is_open and t >= time and queue > 0.0:
            queue -= tick
        elif is_open and t >= arrives:
            share *= math.exp(-tick / gap) if gap > 0.0 and t < stream else 0.0
        t += tick
        if t > arrives:
            waits += share * tick
    return arrives + waits + (share * UNKNOWN_S if share > 1e-9 else 0.0)


@pytest.mark.parametrize(
    ("openings", "gap", "stream", "arrives", "time", "queue"),
    [
        ([(0.0, math.inf)], 0.0, 0.0, 5.0, 2.0, 0.0),  # open
        ([(0.0, math.inf)], 0.0, 0.0, 5.0, 2.0, 6.0),  # behind a queue
        ([(9.0, 20.0)], 0.0, 0.0, 5.0, 2.0, 0.0),  # red
        ([(9.0, 20.0)], 0.0, 0.0, 5.0, 2.0, 4.0),
        ([(9.0, 12.0), (30.0, 60.0)], 0.0, 0.0, 5.0, 2.0, 5.0),  # the queue needs two greens
        ([(0.0, 12.0), (30.0, 60.0)], 0.0, 0.0, 11.0, 4.0, 9.0),
        ([(0.0, 4.0)], 0.0, 0.0, 5.0, 2.0, 0.0),  # no coming green is known
        ([(0.0, math.inf)], 3.0, math.inf, 5.0, 2.0, 0.0),  # a stream without end
        ([(0.0, math.inf)], 3.0, 9.0, 5.0, 2.0, 0.0),  # one that ends
        ([(0.0, 12.0), (30.0, 60.0)], 5.0, math.inf, 8.0, 2.0, 0.0),
        ([(0.0, 12.0), (30.0, 60.0)], 5.0, 10.0, 8.0, 2.0, 0.0),  # all are gone in this green
        ([(0.0, 12.0), (30.0, 40.0)], 5.0, 35.0, 8.0, 2.0, 0.0),
        ([(9.0, 12.0), (30.0, 34.0)], 4.0, math.inf, 5.0, 2.0, 0.0),
        ([(9.0, 12.0), (30.0, 34.0)], 4.0, math.inf, 5.0, 2.0, 1.0),  # a queue is left once
    ],
)
def test_when_a_gate_is_passed_in_the_mean(
    openings: list[tuple[float, float]], gap: float, stream: float, arrives: float, time: float,
    queue: float,
) -> None:  # fmt: skip
    found = plain(passes_at)(gate(openings, gap, stream), 0, arrives, time, queue)
    assert found == pytest.approx(passed(openings, gap, stream, arrives, time, queue), abs=0.02)


# --- gaps in streams ---


def owed(*those: tuple[int, int, float, float]) -> np.ndarray:
    """Node, agent, end of the stretch, m until it enters."""
    rows = np.zeros((len(those), PAST + 1))
    for row, (node, agent, end, enters) in zip(rows, those, strict=True):
        row[OWN_NODE], row[AGENT], row[STRETCH_END], row[ENTERS] = node, agent, end, enters
    return rows


def test_the_mean_wait_for_a_gap_by_hand() -> None:
    """To clear 11.7 m from standing takes 1 s and 3 s with 2.6 m/s2. With q vehicles a second:
    (exp(4 q) - 1 - 4 q) / q."""
    legs = np.arange(9)
    one = gap_times(owed((4, 0, 6.7, 9.0)), legs, 2, 8, 10.0, 5.0)
    assert one == pytest.approx([0, 0, 0.918247, 0, 0, 0], abs=1e-6)
    three = owed(*((4, i, 6.7 - i, 9.0) for i in range(3)))  # the longest stretch counts
    assert gap_times(three, legs, 2, 8, 10.0, 5.0)[2] == pytest.approx(3.733723, abs=1e-6)
    many = owed(*((4, i, 6.7, 9.0) for i in range(20)))
    assert gap_times(many, legs, 2, 8, 10.0, 5.0)[2] == 20.0
    beside = np.array([0, 1, 2, 3, 3, 5, 6, 7, 8])  # nodes 3 and 4 side by side
    two = owed((3, 0, 6.7, 9.0), (4, 1, 6.7, 9.0), (4, 2, 6.7, 9.0), (4, 3, 6.7, 9.0))
    assert gap_times(two, beside, 2, 8, 10.0, 5.0) == pytest.approx(
        [0, 3.733723, 3.733723, 0, 0, 0]
    )


def test_who_waits_at_the_kerb_or_is_in_the_way_is_no_stream() -> None:
    waits, is_there = owed((4, 0, 6.7, math.inf)), owed((4, 0, 6.7, 9.0))
    is_there[0, MERGES] = IN_WAY
    for rows in (waits, is_there, owed()):
        assert not gap_times(rows, np.arange(9), 2, 8, 10.0, 5.0).any()


@pytest.mark.parametrize(
    ("straight", "left", "ends"),
    [
        (((GREEN, 9.0), (RED, 60.0)), ((RED, 9.0), (RED, 60.0)), 9.0),
        (((RED, 9.0), (GREEN, 60.0)), ((GREEN, 9.0), (RED, 60.0)), 9.0),
        (((GREEN, 9.0), (GREEN, 20.0)), ((GREEN, 9.0), (RED, 20.0)), 20.0),
        (((YELLOW, 9.0), (RED, 60.0)), ((RED, 9.0), (RED, 60.0)), 0.0),
    ],
)
def test_a_stream_ends_with_its_green(
    straight: tuple[tuple[int, float], ...], left: tuple[tuple[int, float], ...], ends: float
) -> None:
    """The road from the south yields to both connections from the west."""
    road = crossing("c", bridge=False)
    shows = [[s for s, _ in straight], [RED, RED], [s for s, _ in left]]
    until = np.array([[u for _, u in straight]])
    signals = Signals(np.array([0, 3], np.int32), np.array(shows, np.int32), until)
    assert _stream_ends(road, lane(road, ":sn_0"), signals) == ends
    assert _stream_ends(road, lane(road, ":we_0"), signals) == 0.0  # yields to nobody
    plainly = crossing(bridge=False)
    assert _stream_ends(plainly, lane(plainly, ":sn_0"), signals) == math.inf


# --- the way to a light ---


def lit(*shows: tuple[int, float]) -> Signals:
    """One link that shows these states, each until a time, s."""
    states = np.array([[state for state, _ in shows]], np.int32)
    return Signals(np.array([0, 1], np.int32), states, np.array([[until for _, until in shows]]))


def before_light(*shows: tuple[int, float]) -> tuple:
    """Task, local map and state of an ego 60 m before a light."""
    road = road_with_light()
    ego = ego_at(road, "a_0", 140.0, 10.0, route=(0, 2))
    task = task_of(road, ego)
    return task, *local_of(task, scene_of(ego, road, signals=lit(*shows)))


def test_the_way_to_the_next_gate() -> None:
    """200 m at 15 m/s, then none."""
    _, local, _ = before_light((RED, 5.0), (GREEN, math.inf))
    node = 0
    assert local.to_gate[node, GATE] == 0.0
    assert local.to_gate[node, FREE_S] == pytest.approx(200.0 / 15.0)
    assert local.to_gate[node, AWAY] == pytest.approx(200.0)
    assert (local.to_gate[1:3, GATE] == -1.0).all()
    assert local.gate[0, OPENS] == 5.0 and local.gate[0, CLOSES] == math.inf


@pytest.mark.parametrize(
    ("arrives", "time", "opens"),
    [
        (1.0, 0.0, 5.0),  # it waits for green
        (1.0, 6.0, 6.0),  # not before now
        (7.0, 0.0, 7.0),
        (9.5, 0.0, 9.5),  # yellow
        (12.5, 0.0, math.inf),  # red again
        (21.0, 0.0, math.inf),  # beyond the horizon
    ],
)
def test_a_line_is_passed_when_it_opens(arrives: float, time: float, opens: float) -> None:
    """To half a step of the forecast, 0.2 s, and to another one at yellow."""
    _, local, _ = before_light((RED, 5.0), (GREEN, 9.0), (YELLOW, 12.0), (RED, 60.0))
    found = plain(_opens)(local, 0, arrives, time, 10.0 if arrives < 9.6 else 20.0)
    assert found == opens or found == pytest.approx(opens, abs=0.31)


# --- when an agent enters a stretch ---


def coming(*states: tuple[str, float, float]) -> tuple[object, Coming]:
    """The road, and an agent at these lanes, positions and distances driven."""
    road = build([
        Lane("a", 0, ((0, 0), (100, 0)), ("b_0",)), Lane("b", 0, ((100, 0), (104, 0)), ("c_0",)),
        Lane("c", 0, ((104, 0), (200, 0))), Lane("d", 0, ((0, 9), (100, 9))),
    ])  # fmt: skip
    lanes = [[lane(road, name)] for name, _, _ in states]
    s, driven = (np.array([[each[k]] for each in states]) for k in (1, 2))
    never = np.zeros(1, np.bool_)
    there = np.ones((len(states), 1), np.bool_)
    return road, Coming(np.array(lanes, np.int32), s, driven, there, never, never)


@pytest.mark.parametrize(
    ("states", "onto", "begin", "enters"),
    [
        ([("a_0", 90.0, 0.0), ("a_0", 96.0, 6.0)], "a_0", 94.0, 4.0),
        ([("a_0", 90.0, 0.0), ("a_0", 93.0, 3.0)], "a_0", 94.0, math.inf),  # it never comes there
        ([("a_0", 95.0, 0.0), ("a_0", 99.0, 4.0)], "a_0", 94.0, math.inf),  # it is behind that
        ([("a_0", 95.0, 0.0), ("b_0", 2.0, 7.0)], "b_0", 1.0, 6.0),
        ([("a_0", 95.0, 0.0), ("b_0", 2.0, 7.0)], "a_0", 98.0, 3.0),  # passed within the step
        ([("a_0", 95.0, 0.0), ("c_0", 3.0, 12.0)], "b_0", 1.0, 6.0),  # so was the whole lane
        ([("a_0", 95.0, 0.0), ("c_0", 3.0, 12.0)], "d_0", 1.0, math.inf),
        ([("a_0", 80.0, 0.0), ("a_0", 95.0, 15.0), ("c_0", 3.0, 27.0)], "b_0", 1.0, 21.0),
    ],
)
def test_how_far_an_agent_drives_until_it_enters(
    states: list[tuple[str, float, float]], onto: str, begin: float, enters: float
) -> None:
    road, those = coming(*states)
    found = plain(_enters)(those, ahead_of(road), 0, lane(road, onto), begin)
    assert found == pytest.approx(enters)
    gone = those._replace(valid=np.array([[True]] + [[False]] * (len(states) - 1)))
    assert plain(_enters)(gone, ahead_of(road), 0, lane(road, onto), begin) == math.inf


# --- what is certain before a gate ---


def sure(limits: tuple[float, ...], lengths: tuple[float, ...], next_limit: float) -> np.ndarray:
    """SURE, LATEST and SPREAD of lanes side by side, which all lead to a lane of 50 m with a gate at
    its end."""
    count = len(limits)
    table = np.zeros((count + 3, 32))
    first = 1  # of the lanes that are looked at
    for k in range(count):
        table[first + k, [LIMIT, LENGTH, NEXT]] = limits[k], lengths[k], first + count
    table[first + count, [LIMIT, LENGTH, NEXT]] = next_limit, 50.0, first + count + 1
    table[first + count + 1, [LIMIT, LENGTH, NEXT]] = next_limit, 10.0, -1.0
    gates = np.full((1, CLOSES + 2 * OPENINGS), np.inf)
    gates[0, LINE] = count
    to_gate = np.full((count + 2, SPREAD + 1), np.inf)
    to_gate[:, GATE] = -1.0
    at = np.full(count + 2, -1)
    at[count] = 0
    group = np.array([7] * count + [8, -1])
    closed = np.zeros((count + 2, 5), np.uint8)
    plain(_fill_sure)(gates, to_gate, at, closed, group, table, first, 0.1)
    assert to_gate[count + 1, SURE] == -1.0 and to_gate[count, SURE] == 0.0
    assert to_gate[count, LATEST] == pytest.approx(50.0 / next_limit)
    assert to_gate[count, SPREAD] == pytest.approx(0.0)
    assert gates[0, SURE_NEXT] == -1.0
    return to_gate[:count, [SURE, LATEST, SPREAD]]


def test_how_long_it_takes_to_a_gate_at_the_latest_and_by_how_much_that_may_differ() -> None:
    """Of one lane it is known: 100 m at 10 m/s and 5 s behind it. Where the next limit is another
    one, a step of 0.1 s may be driven at either."""
    assert sure((10.0,), (100.0,), 10.0) == pytest.approx(np.array([[0.0, 15.0, 0.0]]))
    for next_limit, other in ((20.0, 0.05), (5.0, 0.05)):
        late = 10.0 + 50.0 / next_limit + other
        assert sure((10.0,), (100.0,), next_limit) == pytest.approx(
            np.array([[0.0, late, 2 * other]])
        )
    # between two lanes it may change: the longest at the lowest limit, the shortest at the highest,
    # and what 120 m take longer at 10 m/s than at 20 m/s both ways
    found = sure((20.0, 10.0), (100.0, 120.0), 20.0)
    late, soon = 12.0 + 6.0 + 0.05 + 2.5, 5.0 - 6.0 - 0.05 + 2.5
    assert found == pytest.approx(np.array([[0.0, late, late - soon]] * 2))
    assert sure((10.0, 20.0), (120.0, 100.0), 20.0) == pytest.approx(found)


def two_gates(**other: float) -> tuple[int, np.ndarray]:
    """The gate that stands for two, which differ in what is said of the second; and their rows.
    After the first one comes gate 5 within 9 s, or up to 2 s earlier."""
    gates = np.full((2, CLOSES + 2 * OPENINGS), np.inf)
    gates[:, LINE] = 0, 1
    gates[:, GAP_S], gates[:, OPENS] = 3.0, 4.0
    gates[:, SURE_NEXT], gates[:, SURE_LATEST], gates[:, SURE_SPREAD] = 5.0, 9.0, 2.0
    columns = {
        "gap": GAP_S,
        "opens": OPENS,
        "next": SURE_NEXT,
        "latest": SURE_LATEST,
        "spread": SURE_SPREAD,
    }
    closed = np.zeros((2, 4), np.uint8)
    for name, value in other.items():
        if name == "closed":
            closed[1, int(value)] = 1
        else:
            gates[1, columns[name]] = value
    return int(plain(_merged)(gates, closed, 0, 1)), gates[0, [SURE_NEXT, SURE_LATEST, SURE_SPREAD]]


def test_two_gates_are_one_where_who_waits_waits_as_long() -> None:
    for other, after in (
        ({}, (5.0, 9.0, 2.0)),
        ({"next": 6.0}, (-1.0, 9.0, 2.0)),  # what comes after them differs
        ({"latest": 12.0}, (5.0, 12.0, 5.0)),  # from 7 s, as before, to 12 s
        ({"latest": 8.0, "spread": 4.0}, (5.0, 9.0, 5.0)),  # from 4 s
    ):
        merged, row = two_gates(**other)
        assert merged == 0 and row.tolist() == pytest.approx(list(after))
    for differs in ({"gap": 4.0}, {"opens": 5.0}, {"closed": 0.0}, {"closed": 3.0}):
        assert two_gates(**differs)[0] == -1
    for one, other, stands in ((2, 2, 2), (-1, 3, -1), (3, -1, -1), (-1, -1, -1), (0, -2, -1)):
        empty = np.zeros((4, CLOSES + 2 * OPENINGS))
        assert plain(_merged)(empty, np.zeros((4, 1), np.uint8), one, other) == stands
