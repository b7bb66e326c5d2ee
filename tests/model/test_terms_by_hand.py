"""Parts of J and of its bound by hand: the user's own term, obligations of people who walk, the
lane that is needed, the queue before a gate, and what is lost for certain at closed lines."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers import Agent, ego_at
from helpers_model import lanes_east, local_of, plain, scenario, scene_of, task_of

from sumo_mcts.driver.params import cost_params
from sumo_mcts.model import cost, cost_to_go, interaction, least_cost, occupancy, passing
from sumo_mcts.model.cost_params import Term
from sumo_mcts.model.local_map import (
    AWAY,
    CLOCK,
    CLOSES,
    DRIVEN,
    GAP_S,
    HALF_LENGTH,
    HALF_WIDTH,
    IN_WAY,
    KERB,
    LATEST,
    LINE,
    OPENINGS,
    OPENS,
    OWED,
    PAST,
    QUEUE,
    REACTS,
    SLOT,
    SPEED,
    SPREAD,
    STREAM_S,
    STRETCH_END,
    SURE,
    SURE_LATEST,
    SURE_NEXT,
    SURE_SPREAD,
    LocalMap,
    State,
    V,
)
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.model.route import LIMIT, NUMBER
from sumo_mcts.numerics.geometry import Box

C = cost_params(scenario())


def view(*agents: Agent, v: float = 8.0) -> tuple[EgoParams, LocalMap, State]:
    """The ego on the only lane, its front at 100 m; the limit is 15 m/s."""
    road = lanes_east(1, 900.0)
    ego = ego_at(road, "a_0", 100.0, v)
    task = task_of(road, ego)
    return task.ego, *local_of(task, scene_of(ego, road, *agents))


# --- the user's own term ---


@pytest.mark.parametrize(
    ("rate", "found"),
    [(2.5, 0.25), (0.5, 0.05), (59.0, 5.9), (1e6, 6.0), (math.inf, 6.0), (-3.0, 0.0), (math.nan, 0.0)],
)  # fmt: skip
def test_the_own_term_gets_what_the_page_says_and_counts_for_a_step(
    rate: float, found: float
) -> None:
    """Steps of 0.1 s; at most a contact's 60 a second, and nothing below 0."""
    p, local, state = view()
    local.node[state.node, NUMBER] = 3.0
    asked: list[tuple[float, ...]] = []
    own = plain(cost.step_own)
    term: Any = Term(lambda *those: asked.append(those) or rate, 7.0)  # type: ignore[func-returns-value]
    before, after = state._replace(a=-1.0), state._replace(s=101.0, v=9.0, a=0.5)
    assert own(term, local, p, C, before, after, 12.0, 4.0) == pytest.approx(found)
    # t, lane, s, v, a, jerk (1.5 m/s2 more in a tenth of a second), gap, weight
    assert asked == [pytest.approx((4.0, 3, 101.0, 9.0, 0.5, 15.0, 12.0, 7.0))]
    assert own(None, local, p, C, before, after, 12.0, 4.0) == 0.0


# --- people who walk in the ego's way ---

yielding = plain(occupancy.yielding_cost)


def walking(
    kind: float, enters: float, *, begins: float = 95.0, slot: float = -1.0, owed: float = -1.0,
    kerb: float = 0.0, past: float = 0.0,
) -> tuple[EgoParams, LocalMap, State]:  # fmt: skip
    """Somebody who drives 10 m/s towards a stretch up to 105 m of the ego's lane. Forecast times
    are 0.2 s apart, so 2 m."""
    p, local, state = view(Agent("x", "", x=0.0, y=300.0))
    agent, trait = local.agent.copy(), local.trait.copy()
    agent[:, 0, V], agent[:, 0, DRIVEN] = 10.0, 2.0 * np.arange(len(agent))
    trait[0, [REACTS, SLOT, OWED]] = 1.0, slot, owed
    row = np.array([[state.node, begins, 105.0, 0, enters, kind, 0.0, 0.0]])
    row[0, [KERB, PAST]] = kerb, past
    return p, local._replace(agent=agent, trait=trait, obligation=row), state


@pytest.mark.parametrize(
    ("begins", "enters", "kerb", "t", "costs"),
    [
        (110.5, 20.0, 0.0, 0, True),  # from 8 m/s with 3 m/s2 the ego stops in 10.67 m
        (110.8, 20.0, 0.0, 0, False),
        (120.0, 20.0, 0.0, 0, False),
        (95.0, 20.0, 5.0, 0, False),  # it has 5 m to the kerb
        (95.0, 20.0, 5.0, 3, True),  # 6 m driven: past it
        (95.0, 20.0, 6.0, 3, True),
        (95.0, 5.0, 0.0, 3, False),  # it has left the ego's way
    ],
)
def test_who_walks_in_the_way_costs_all_of_a_claim_where_the_ego_could_not_stop(
    begins: float, enters: float, kerb: float, t: int, costs: bool
) -> None:
    p, local, state = walking(IN_WAY, enters, begins=begins, kerb=kerb)
    rate = yielding(local, p, C, state, np.zeros((0, 2)), t)
    assert rate == pytest.approx(16.0 if costs else 0.0)


def test_who_waits_for_the_ego_is_where_it_was_held_up() -> None:
    """By the forecast 10 m are driven, by the search 4 m: 20 m of 24 m are left. It needs 2.5 m, a
    second, and 100 / 9 m to a stand."""
    needed = 2.5 + 10.0 + 100.0 / 9.0
    late = np.array([[0.0, 10.0]])
    late[0, [CLOCK, SPEED]] = 2.0, 10.0
    for slot, owed, left in ((0.0, 0.0, 20.0), (-1.0, 0.0, 14.0), (0.0, -1.0, 14.0)):
        p, local, state = walking(0.0, 24.0, slot=slot, owed=owed, kerb=1.0)
        found = yielding(local, p, C, state, late, 5)
        assert found == pytest.approx(16.0 * min(1.0, 0.5 + 2.0 * (1.0 - left / needed)))


@pytest.mark.parametrize(
    ("kerb", "past", "waits"),
    [(4.0, 1.0, True), (3.9, 1.0, False), (4.0, 0.5, False), (4.0, 0.65, True)],
)
def test_who_stands_at_the_kerb_for_the_ego_costs_nothing(
    kerb: float, past: float, waits: bool
) -> None:
    """The ego, 8 m/s fast, is over the crossing 5 m further: in 0.625 s. The other has walked 4 m,
    and takes `past` s from the kerb until it is past the ego's way."""
    p, local, state = walking(0.0, 24.0, slot=0.0, owed=0.0, kerb=kerb, past=past)
    late = np.zeros((1, 2))
    late[0, [CLOCK, SPEED]] = 2.0, 10.0
    assert (yielding(local, p, C, state, late, 5) == 0.0) == waits


@pytest.mark.parametrize(("kerb", "contact"), [(9.0, False), (3.0, True)])
def test_who_waits_at_a_kerb_needs_no_margin_and_all_others_do(kerb: float, contact: bool) -> None:
    """It has walked 4 m. Its margin, but not its body, reaches into the ego's way, on its left
    side."""
    p, local, state = walking(0.0, 24.0, slot=0.0, owed=0.0, kerb=kerb, past=1.0)
    late = np.zeros((1, 2))
    late[0, [CLOCK, SPEED]] = 2.0, 0.0
    local.agent[:, 0, :4] = 97.5, 0.9 + 0.5, 1.0, 0.0
    local.trait[0, [HALF_LENGTH, HALF_WIDTH]] = 0.6, 0.6
    local.obligation[0, STRETCH_END] = 100.0
    met = plain(interaction.meet)(local, p, C, state, late, 0, 2)
    assert met.contact == contact


@pytest.mark.parametrize("turned", [0.0, 0.5, math.pi / 4, 2.0, -1.0])
def test_people_are_passed_beside_the_ego_whatever_its_heading(turned: float) -> None:
    """A metre ahead and 1.5 m beside: at 12 m/s and 0.1 m of room an eighth of a claim."""
    c, s = math.cos(turned), math.sin(turned)
    ego = Box(10.0, 20.0, c, s, 2.5, 0.9)
    for side in (1.5, -1.5):
        other = Box(10.0 + c - side * s, 20.0 + s + side * c, c, s, 0.5, 0.5)
        for each in (other, other._replace(cos=-c, sin=-s)):  # with the ego, or towards it
            assert plain(passing.passing_cost)(C, 12.0, ego, each) == pytest.approx(16.0 / 8.0)


# --- where the ego has to be, and who stands before it there ---


def test_the_lane_that_is_needed_is_so_many_lanes_beside() -> None:
    """Nodes 3..6 are lanes side by side from the right, 7 is one alone; nodes 0..2 were before."""
    left = np.array([-1, -1, -1, 4, 5, 6, -1, -1])
    right = np.array([-1, -1, -1, -1, 3, 4, 5, -1])

    def needed(*changes: int, last: int = 8) -> list[int]:
        route: Any = SimpleNamespace(left=left, right=right, changes=np.array([9, 9, 9, *changes]))
        return cost_to_go._needed(route, 3, last).tolist()

    assert needed(2, 1, 0, 0, 0) == [2, 2, 2, 3, 4]
    assert needed(0, -1, -2, -3, 0) == [0, 0, 0, 0, 4]
    assert needed(3, -1, 1, -1, 0) == [3, 0, 3, 2, 4]
    assert needed(0, 0, 0, 2, -1) == [0, 1, 2, 3, 4]  # no lane lies there
    assert needed(3, 2, 1, last=6) == [2, 2, 2]  # as far as this cycle looks


@pytest.mark.parametrize(
    ("time", "away", "count"),
    [(0.0, 160.0, 2), (0.0, 121.0, 1), (0.0, 119.0, 0), (2.0, 160.0, 1), (10.0, 160.0, 0), (99.0, 160.0, 0)],
)  # fmt: skip
def test_the_queue_is_counted_at_the_time_that_is_asked(
    time: float, away: float, count: int
) -> None:
    """The ego at 100 m; others at 120 m and 145 m drive 10 m/s, one at 90 m is behind it."""
    agents = [Agent("a", "a_0", 120.0, 10.0), Agent("b", "a_0", 145.0, 10.0), Agent("c", "a_0", 90.0, 10.0)]  # fmt: skip
    _, local, state = view(*agents)
    agent, to_gate = local.agent.copy(), np.zeros((1, 7))
    for i, s in enumerate((120.0, 145.0, 90.0)):
        agent[:, i, 6] = s + (10.0 if i < 2 else 0.0) * local.dt * np.arange(len(agent))
    to_gate[0, [AWAY, QUEUE]] = away, state.node
    local = local._replace(agent=agent, to_gate=to_gate, followers=0)
    queued = plain(cost_to_go._queued)
    assert queued(local, state, time) == count
    agent[-1, 2, 6] = 100.5  # half a metre ahead, but at the last time alone
    last = local.dt * (len(agent) - 1)
    assert queued(local, state, last) == queued(local, state, 999.0) == 1
    assert queued(local, state, last - local.dt) == 0


# --- what is lost for certain ---


@pytest.fixture
def uncompiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the bound calls, as plain Python that takes any object."""
    for name in ("_opens", "_waits", "passes_at", "index_at"):
        monkeypatch.setattr(least_cost, name, plain(getattr(least_cost, name)))


def gate(after: int, latest: float, spread: float, line: int, *openings: float) -> np.ndarray:
    """`openings`: begin and end of the times, s, in which it is expected to be open."""
    row = np.full(CLOSES + 2 * OPENINGS, np.inf)
    row[[GAP_S, STREAM_S, LINE]] = 0.0, 0.0, line
    row[[SURE_NEXT, SURE_LATEST, SURE_SPREAD]] = after, latest, spread
    row[OPENS : OPENS + len(openings)] = openings
    return row


def bound(
    shut: dict[int, tuple[float, float]], *, v: float = 10.0, time: float = 1.0, node: int = 5,
    second: int = 1, beyond: float = 30.0,
) -> float:  # fmt: skip
    """The ego, 20 m along node 5 (limit 10 m/s), is at the gate of line 1 after 4 to 5 s from the
    start of its lane, and 3 to 3.5 s later at that of line 2. Nodes 4..6 are looked at, for 8 s;
    lines are closed from .. to, s."""
    closed, to_gate, table = np.zeros((3, 17), np.uint8), np.zeros((3, 7)), np.zeros((9, 40))
    for line, (begin, end) in shut.items():
        closed[line, [begin <= 0.5 * t < end for t in range(17)]] = 1
    table[:, LIMIT], table[5, LIMIT] = 25.0, 10.0
    to_gate[:, SURE] = -1.0
    to_gate[1, [SURE, LATEST, SPREAD]] = 0.0, 5.0, 1.0
    rows = [gate(second, 3.5, 0.5, 1, 20.0, 40.0), gate(-1, 9.0, 9.0, 2, 22.0, 60.0)]
    local: Any = SimpleNamespace(
        first=4, to_gate=to_gate, node=table, gate=np.array(rows), closed=closed, dt=0.5,
        yellow=np.full((3, 2), np.inf),
    )  # fmt: skip
    p: Any = SimpleNamespace(step=0.2)
    state = State(node, 20.0, v, 0.0, 0.0, -1, 0.0)
    c = C._replace(progress=2.0, beyond_s=beyond)
    return plain(least_cost.least_cost)(local, p, c, state, time, 8.0)


DUE = 1.0 + 5.0 - 2.0 + 0.1  # s: now, free driving, less what is driven, half a step


@pytest.mark.usefixtures("uncompiled")
def test_nothing_is_certain_without_a_closed_line_or_for_who_is_too_fast() -> None:
    assert bound({}) == 0.0
    shut = {1: (0.0, 7.0)}
    assert bound(shut) > 0.0
    assert bound(shut, v=10.19) > 0.0 and bound(shut, v=10.21) == 0.0  # 2 % more than the limit
    assert bound(shut, node=4) == bound(shut, node=6) == 0.0  # no gate ahead of those
    assert bound(shut, node=3) == bound(shut, node=7) == 0.0  # beyond what is looked at


@pytest.mark.usefixtures("uncompiled")
def test_before_a_line_the_time_is_lost_until_it_opens() -> None:
    """It is passed 0.25 s, half a forecast step, before it is seen open, and within a step."""
    for end in (7.0, 6.0):
        lost = end - 0.25 - 0.2 - DUE
        assert bound({1: (0.0, end)}, second=-1) == pytest.approx(2.0 * lost)
    assert bound({1: (0.0, 4.0)}, second=-1) == 0.0  # it opens before
    assert bound({1: (5.0, 7.0)}, second=-1) == 0.0  # it is passed before
    for begin, lost in ((2.6, 7.0 - 0.25 - 0.2 - DUE), (3.1, 0.0)):  # 2.85 s from now perhaps
        assert bound({1: (begin, 7.0)}, second=-1) == pytest.approx(2.0 * lost)


@pytest.mark.usefixtures("uncompiled")
def test_at_a_second_line_only_what_the_first_did_not_cost() -> None:
    """It is reached 3.5 s later at the latest, 6.6 s from now: lost are at most 7.75 - 0.2 - 6.6."""
    second, time = (0.0, 8.0), 0.0
    assert bound({2: second}, time=time) == pytest.approx(2.0 * 0.95)
    assert bound({1: (0.0, 4.0), 2: second}, time=time) == pytest.approx(2.0 * 0.95)
    assert bound({1: (0.0, 4.0)}, time=time) == pytest.approx(2.0 * 0.45)
    assert bound({1: (0.0, 5.0), 2: second}, time=time) == pytest.approx(2.0 * 1.45)
    assert bound({2: second}) == 0.0  # a second later it opens before


@pytest.mark.usefixtures("uncompiled")
def test_beyond_the_horizon_waiting_counts_less_and_less() -> None:
    """The first gate opens at 20 s. The second, 3 s later at the earliest, is open then: the ego
    is there 15.4 s late, so at the first it waits longer, 20 - 8."""
    ever = {1: (0.0, 99.0)}
    until = 8.0 - DUE
    assert bound(ever, beyond=0.0) == pytest.approx(2.0 * until)
    assert bound(ever) == pytest.approx(2.0 * (until + 30.0 * (1.0 - math.exp(-12.0 / 30.0))))
    assert bound(ever, second=-1) == bound(ever)
    # 2 s from now the ego is behind at the horizon anyway, and so is the gate
    assert bound(ever, time=6.0, second=-1) == pytest.approx(
        2.0 * 30.0 * (1.0 - math.exp(-(20.0 - (6.0 + 3.1)) / 30.0))
    )


@pytest.mark.parametrize(
    ("arrives", "time", "opens"),
    [(1.0, 0.0, 3.75), (1.0, 4.6, 4.25), (5.2, 0.0, 4.75), (6.2, 0.0, 5.75), (6.8, 0.0, math.inf), (8.1, 0.0, math.inf)],
)  # fmt: skip
@pytest.mark.usefixtures("uncompiled")
def test_on_yellow_a_line_may_be_passed(arrives: float, time: float, opens: float) -> None:
    """Yellow from 4 s to 6 s, and half a second, a forecast step, at both ends uncertain."""
    local: Any = SimpleNamespace(
        closed=np.ones((1, 17), np.uint8), yellow=np.array([[4.0, 6.0]]), dt=0.5
    )
    assert plain(least_cost._opens)(local, 0, arrives, time, 8.0) == opens


@pytest.mark.parametrize(
    ("opens", "waits"), [((20.0, 10.0), 12.0), ((20.0, 30.0), 17.0), ((5.0, 5.0), 0.0)]
)
@pytest.mark.usefixtures("uncompiled")
def test_the_longest_wait_of_all_gates_counts(opens: tuple[float, float], waits: float) -> None:
    """The first is reached at 7 to 8 s, the second 4 to 5 s later, at 13 s without waiting."""
    rows = [
        gate(1, 5.0, 1.0, 0, opens[0], math.inf),
        gate(-1, 0.0, 0.0, 1, opens[1], math.inf),
    ]
    local: Any = SimpleNamespace(gate=np.array(rows))
    assert plain(least_cost._waits)(local, 0, 7.0, 8.0, 6.0) == pytest.approx(waits)
