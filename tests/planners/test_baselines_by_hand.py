"""The drivers to compare with, worked out by hand: who leads, for whom a line is closed, how the
follower drives, what is held and remembered."""

import math
from typing import Any

import numpy as np
import pytest
from helpers import Agent, Lane, build, crossing, edges, ego_at, lane, lights
from helpers_model import (
    PHYSICS,
    lanes_east,
    local_of,
    plain,
    road_with_light,
    scenario,
    scene_of,
    situation_of,
    task_of,
)
from shapely import affinity, box  # type: ignore[import-untyped]

from sumo_mcts.driver.params import Physics
from sumo_mcts.model.local_map import (
    AGENT,
    DRIVEN,
    ENTERS,
    GONE,
    IN_WAY,
    MERGES,
    NODE,
    OWN_NODE,
    LocalMap,
    State,
    V,
)
from sumo_mcts.model.motion import advance, begin_change, follow_accel
from sumo_mcts.model.route import LIMIT, NEXT, STOP_LINE
from sumo_mcts.numerics.geometry import COS, SIN
from sumo_mcts.planners import baselines
from sumo_mcts.planners.base import Task
from sumo_mcts.planners.baselines import (
    ConstantPlanner,
    IdmParams,
    IdmPlanner,
    RandomPlanner,
    SumoPlanner,
    _before,
    _follow,
    _two_periods,
    accel_behind,
    leader_on_path,
    make_constant,
    make_idm,
    make_random,
    make_sumo,
    with_yield_lines,
)
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import GREEN, Follow, Release

LANES = lanes_east(3, 600.0)


def seen(
    road: RoadMap, name: str, s: float, v: float, *agents: Agent, ways: tuple[str, ...] = ()
) -> tuple[Task, LocalMap, State]:
    ego = ego_at(road, name, s, v, route=edges(road, *ways) if ways else ())
    task = task_of(road, ego)
    return task, *local_of(task, scene_of(ego, road, *agents))


# --- SUMO's own, constant, random ---


def test_sumos_own_driver_is_let_drive() -> None:
    mind = make_sumo({}, scenario())
    assert isinstance(mind, SumoPlanner) and not mind.needs_forecast
    ego = ego_at(LANES, "a_1", 100.0)
    made = mind.plan(situation_of(task_of(LANES, ego), scene_of(ego, LANES)))
    assert isinstance(made.command, Release)
    assert (made.plan, made.children, made.chosen, made.iterations, made.known) == (
        None,
        (),
        -1,
        0,
        0,
    )


def constant(period: str = "planner.period_s=0.5") -> ConstantPlanner:
    mind = make_constant({}, scenario(period))
    ego = ego_at(LANES, "a_1", 100.0)
    mind.start(task_of(LANES, ego), 1)
    return mind


def held(mind: ConstantPlanner, v: float) -> np.ndarray:
    ego = ego_at(LANES, "a_1", 100.0, v)
    made = mind.plan(situation_of(mind._task, scene_of(ego, LANES)))
    assert isinstance(made.command, Follow) and made.command.lane_change == 0
    assert (made.plan, made.children, made.chosen, made.iterations, made.known) == (
        None,
        (),
        -1,
        0,
        0,
    )
    return made.command.speeds


def test_the_speed_of_the_take_over_is_held_and_a_metre_a_second_at_least() -> None:
    mind = constant()
    assert not mind.needs_forecast
    assert held(mind, 7.0).tolist() == [7.0] * 10  # two periods of five steps
    assert held(mind, 12.0).tolist() == [7.0] * 10
    assert held(constant(), 0.2).tolist() == [1.0] * 10
    assert held(constant("planner.period_s=0.1"), 3.0).tolist() == [3.0] * 2
    hasty = constant()
    hasty._period = 0.01  # s, less than a step: two steps are the least
    assert held(hasty, 3.0).tolist() == [3.0] * 2
    other = constant()
    assert other.memory().numbers.tolist() == [-1.0]
    other.recall(mind.memory())
    assert held(other, 12.0).tolist() == [7.0] * 10
    other.start(other._task, 1)  # a new episode
    assert held(other, 12.0).tolist() == [12.0] * 10


def turning(number: int) -> RoadMap:
    """Three lanes, of which lane `number` alone leads on."""
    return build([
        *(Lane("a", k, ((0, 3.2 * k), (300, 3.2 * k)), ("b_0",) if k == number else ()) for k in range(3)),
        Lane("b", 0, ((300, 3.2 * number), (600, 3.2 * number))),
    ])  # fmt: skip


@pytest.mark.parametrize(
    ("number", "name", "side"),
    [
        (2, "a_0", 1),
        (2, "a_1", 1),
        (2, "a_2", 0),
        (0, "a_2", -1),
        (0, "a_1", -1),
        (1, "a_0", 1),
        (1, "a_2", -1),
    ],
)
def test_constant_changes_to_the_lane_of_its_route_at_once(
    number: int, name: str, side: int
) -> None:
    road = turning(number)
    ego = ego_at(road, name, 50.0, 7.0, route=edges(road, "a", "b"))
    task = task_of(road, ego)
    situation = situation_of(task, scene_of(ego, road))
    mind = ConstantPlanner(0.5)
    mind.start(task, 1)
    assert mind.plan(situation).command.lane_change == side  # type: ignore[union-attr]
    changing = situation._replace(state=situation.state._replace(progress=0.2))
    assert mind.plan(changing).command.lane_change == 0  # type: ignore[union-attr]
    none = np.full_like(task.route.left, -1)
    mind._task = task._replace(route=task.route._replace(left=none, right=none))
    assert mind.plan(situation).command.lane_change == 0  # type: ignore[union-attr]


@pytest.mark.parametrize("side", [-1, 0, 1])
def test_it_changes_to_any_lane_that_lies_on_the_side_that_it_needs(side: int) -> None:
    """Even to node 0; on the other side lies none."""
    mind = constant()
    ego = ego_at(LANES, "a_1", 100.0)
    situation = situation_of(mind._task, scene_of(ego, LANES))
    route = mind._task.route
    nodes = {k: np.full_like(route.left, 0 if side == k else -1) for k in (1, -1)}
    for more in (1, 2):
        changes = np.full_like(route.changes, more * side)
        those = route._replace(changes=changes, left=nodes[1], right=nodes[-1])
        mind._task = mind._task._replace(route=those)
        made = mind.plan(situation)
        assert isinstance(made.command, Follow) and made.command.lane_change == side


def test_each_key_of_the_driver_reaches_it() -> None:
    sets = (
        "idm.headway_s=1.1", "idm.min_gap_m=2.2", "idm.accel_mps2=1.3", "idm.decel_mps2=2.4",
        "idm.critical_gap_s=5.5", "idm.cut_in_decel_mps2=3.6", "planner.period_s=0.7",
    )  # fmt: skip
    mind = make_idm({}, scenario(*sets))
    assert mind._params == IdmParams(1.1, 2.2, 1.3, 2.4, 5.5, 3.6) and mind._period == 0.7
    ego = ego_at(LANES, "a_1", 100.0)
    task = task_of(LANES, ego)
    mind.start(task, 1)
    follower = task.ego._replace(max_accel=1.3, approach_decel=2.4, headway=1.1, gap=2.2)
    assert mind._follower == follower
    strong = IdmPlanner(mind._params._replace(accel=9.0), 0.7)
    strong.start(task, 1)
    assert strong._follower.max_accel == task.ego.max_accel


@pytest.mark.parametrize(("period", "steps"), [(0.5, 10), (0.26, 6), (0.01, 2)])
def test_two_periods_are_planned(period: float, steps: int) -> None:
    task, *_ = seen(LANES, "a_1", 100.0, 10.0)
    assert _two_periods(period, task) == steps
    mind = RandomPlanner(make_random({}, scenario())._params._replace(period_s=period))
    mind.start(task, 1)
    ego = ego_at(LANES, "a_1", 100.0, 10.0)
    made = mind.plan(situation_of(task, scene_of(ego, LANES)))
    assert isinstance(made.command, Follow) and len(made.command.speeds) == steps
    assert (made.chosen, made.iterations, made.known, made.children) == (-1, 0, 0, ())


# --- who leads ---


def led(
    name: str,
    s: float,
    *agents: Agent,
    ways: tuple[str, ...] = (),
    reach: float = 60.0,
    road: RoadMap = LANES,
    **state: Any,
) -> tuple[float, float]:
    task, local, here = seen(road, name, s, 10.0, *agents, ways=ways)
    return leader_on_path(local, task.ego, here._replace(**state), reach)


CROSSING = crossing(bridge=True)


@pytest.mark.parametrize(("name", "ways"), [("si_0", ("si", "no")), ("wi_0", ("wi", "eo"))])
def test_on_roads_in_any_direction_the_next_body_ahead_leads(
    name: str, ways: tuple[str, ...]
) -> None:
    """Its rear is 20.5 m ahead; looked at every metre, it is met after 21 m."""
    ahead = Agent("x", name, 65.5, 4.0)
    assert led(name, 40.0, ahead, ways=ways, road=CROSSING) == (21.0, 4.0)
    assert led(name, 40.0, Agent("x", name, 34.0, 4.0), ways=ways, road=CROSSING)[0] == math.inf
    nearer = Agent("y", name, 52.5, 6.0)
    assert led(name, 40.0, ahead, nearer, ways=ways, road=CROSSING) == (8.0, 6.0)
    assert led(name, 40.0, Agent("x", name, 39.0, 4.0), ways=ways, road=CROSSING)[0] == math.inf
    # overlapping already, its middle ahead
    assert led(name, 40.0, Agent("x", name, 41.0, 4.0), ways=ways, road=CROSSING) == (0.0, 4.0)


@pytest.mark.parametrize("turned", [0.0, 0.5, math.pi / 2, math.pi])
@pytest.mark.parametrize("name", ["si_0", "wi_0"])
def test_the_speed_along_the_path_counts_and_none_against_it(name: str, turned: float) -> None:
    heading = (math.pi / 2 if name == "si_0" else 0.0) + turned
    place = {"x": 1.6, "y": -40.0} if name == "si_0" else {"x": -40.0, "y": -1.6}
    other = Agent("x", "", v=8.0, heading=heading, **place)
    ways = ("si", "no") if name == "si_0" else ("wi", "eo")
    gap, speed = led(name, 40.0, other, ways=ways, road=CROSSING)
    assert speed == pytest.approx(max(0.0, 8.0 * math.cos(turned)), abs=1e-9)
    assert 10.0 < gap <= 20.0


def test_as_far_as_it_looks_and_over_the_lanes_of_its_route() -> None:
    """The rear of the other is 8 m behind the junction, 40 m ahead."""
    beyond = Agent("x", "no_0", 13.0, 3.0)
    for reach, gap in ((39.0, math.inf), (42.0, 40.0)):
        found = led("si_0", 78.0, beyond, ways=("si", "no"), road=CROSSING, reach=reach)
        assert found[0] == gap
    assert (
        led("si_0", 78.0, Agent("x", "eo_0", 13.0), ways=("si", "no"), road=CROSSING)[0] == math.inf
    )


def test_while_it_changes_lanes_both_count() -> None:
    own, left = Agent("o", "a_1", 130.5, 4.0), Agent("l", "a_2", 120.5, 6.0)
    assert led("a_1", 100.0, own, left) == (26.0, 4.0)
    node = next(
        k
        for k, n in enumerate(seen(LANES, "a_1", 100.0, 9.0)[0].route.lane)
        if n == lane(LANES, "a_2")
    )
    assert led("a_1", 100.0, own, left, other=node, progress=0.1) == (16.0, 6.0)
    far = Agent("l", "a_2", 150.5, 6.0)
    assert led("a_1", 100.0, own, far, other=node, progress=0.1) == (26.0, 4.0)


def test_who_is_on_a_bridge_leads_nobody() -> None:
    """At s = 98.4 m of the bridge, 40 m behind the junction."""
    for name, s, gap in (("br_0", 100.9, math.inf), ("eo_0", 42.5, 33.0)):
        other = Agent("x", name, s, 0.0)
        assert led("eo_0", 5.0, other, road=CROSSING)[0] == gap


def test_the_first_place_at_which_boxes_overlap_is_where_it_would_touch() -> None:
    """Metre by metre, for bodies that are turned and aside; and the speed that they have now."""
    rng, met = np.random.default_rng(12), 0
    for _ in range(12):
        x, y, turned = 110.0 + rng.uniform(0, 20), rng.uniform(-3.0, 3.0), rng.uniform(-0.9, 0.9)
        other = Agent("x", "", x=x, y=y, heading=turned, v=6.0)
        task, local, state = seen(LANES, "a_1", 100.0, 10.0, other)
        later = local.agent.copy()
        later[1:, 0, [V, COS, SIN]] = 1.0, 0.0, 1.0
        body = affinity.rotate(box(x - 2.5, y - 0.9, x + 2.5, y + 0.9), turned, use_radians=True)
        places = [
            k
            for k in range(60)
            if 97.5 + k <= x and body.intersection(box(95.0 + k, -0.9, 100.0 + k, 0.9)).area > 0.0
        ]
        gap, v = leader_on_path(local._replace(agent=later), task.ego, state, 60.0)
        assert gap == (float(places[0]) if places else math.inf)
        assert v == pytest.approx(6.0 * math.cos(turned) if places else 0.0)
        met += bool(places)
    assert 4 < met < 12


@pytest.mark.parametrize(("name", "ways"), [("si_0", ("si", "no")), ("wi_0", ("wi", "eo"))])
def test_who_stands_across_is_as_long_as_it_is_wide(name: str, ways: tuple[str, ...]) -> None:
    """6 m wide and 1 m long, turned by a right angle: its side is 3 m before its middle."""
    place = {"x": 1.6, "y": -40.0} if name == "si_0" else {"x": -40.0, "y": -1.6}
    heading = 0.0 if name == "si_0" else math.pi / 2
    across = Agent("x", "", v=0.0, heading=heading, length=1.0, width=6.0, **place)
    usual = Agent("x", "", v=0.0, heading=heading, length=6.0, width=6.0, **place)
    gaps = [led(name, 40.0, each, ways=ways, road=CROSSING)[0] for each in (across, usual)]
    assert gaps[0] == gaps[1] < math.inf


@pytest.mark.parametrize("turned", [0.0, 0.7, math.pi / 2, 2.5, math.pi, -2.2, -math.pi / 2])
def test_the_way_is_followed_round_a_corner_in_any_direction(turned: float) -> None:
    """50 m, and then to the left. Who stands 30 m behind the corner is there whatever the heading
    of it all, and so is who stands before it; who would be straight ahead, or behind, is not."""
    c, s = math.cos(turned), math.sin(turned)

    def at(x: float, y: float) -> tuple[float, float]:
        return c * x - s * y, s * x + c * y

    road = build([
        Lane("p", 0, (at(0, 0), at(50, 0)), ("q_0",)), Lane("q", 0, (at(50, 0), at(50, 90))),
    ])  # fmt: skip
    for place, heading, gap in (
        ((50.0, 27.5), math.pi / 2, 55.0), ((42.5, 0.0), 0.0, 20.0), ((90.0, 0.0), 0.0, math.inf),
        ((15.0, 0.0), 0.0, math.inf),
    ):  # fmt: skip
        x, y = at(*place)
        other = Agent("x", "", x=x, y=y, v=3.0, heading=heading + turned)
        found, v = led("p_0", 20.0, other, ways=("p", "q"), road=road, reach=80.0)
        assert found == gap or abs(found - gap) <= 1.0
        assert v == pytest.approx(3.0 if gap < math.inf else 0.0)


def test_who_has_gone_leads_nobody_and_all_are_looked_at_as_they_are_now(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    task, local, state = seen(LANES, "a_1", 100.0, 10.0, Agent("x", "a_1", 130.5, 4.0))
    found, asked = plain(leader_on_path), []
    for name in ("on_other_level", "boxes_meet"):
        function = getattr(baselines, name)

        def noted(*those: Any, name: str = name, function: Any = function) -> bool:
            asked.append((name, *(those[3:] if name == "on_other_level" else those[6:])))
            return bool(function(*those))

        monkeypatch.setattr(baselines, name, noted)
    assert found(local, task.ego, state, 60.0) == (26.0, 4.0)
    assert set(asked) == {
        ("on_other_level", 5.0, 0, 0),
        ("boxes_meet", 0, 0),
    }  # length; time, agent
    agent = local.agent.copy()
    agent[0, 0, NODE] = GONE
    assert found(local._replace(agent=agent), task.ego, state, 60.0) == (math.inf, 0.0)


# --- what it plans ---


def decided(side: int, *agents: Agent, **state: float) -> Follow:
    """The driver in the middle of three lanes that a route of 900 m before led to, where it wants
    to change to one side."""
    road = from_far()
    ego = ego_at(road, "a_1", 100.0, 9.0, route=edges(road, "u", "v", "w", "a"))
    task = task_of(road, ego)
    mind = make_idm({}, scenario())
    mind.start(task, 1)
    situation = situation_of(task, scene_of(ego, road, *agents))
    situation = situation._replace(state=situation.state._replace(**state))
    local = local_of(task, scene_of(ego, road, *agents))[0]
    urgency = np.zeros_like(local.urgency)
    urgency[situation.state.node - local.first] = side
    asked: list[tuple[State, float]] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(baselines, "local_of", lambda *_: local._replace(urgency=urgency))
        patch.setattr(
            baselines, "leader_on_path", lambda *those: asked.append(those[2:]) or (math.inf, 0.0)
        )
        made = mind.plan(situation)
    [(at, reach)] = asked
    assert reach == 6.0 * 9.0 + 20.0  # m: six seconds at 9 m/s, and 20 m
    if not state and isinstance(made.command, Follow):  # a change counts from its beginning on
        assert (at.progress > 0.0 and at.other >= 0) == (made.command.lane_change != 0)
    assert (made.children, made.chosen, made.iterations, made.known) == ((), -1, 0, 0)
    assert local.first > 0 and isinstance(made.command, Follow) and made.plan is not None
    assert made.plan.time == pytest.approx(0.1 * np.arange(1, len(made.plan.v) + 1))
    assert (made.plan.v == made.command.speeds).all()
    return made.command


@pytest.mark.parametrize("side", [-1, 0, 1])
def test_it_changes_to_the_lane_that_it_needs_where_it_can(
    side: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert decided(side).lane_change == side
    assert decided(side, progress=0.3).lane_change == 0  # it is changing already
    beside = {1: "a_2", -1: "a_0"}.get(side, "a_1")
    assert decided(side, Agent("x", beside, 101.0, 9.0)).lane_change == 0
    monkeypatch.setattr(baselines, "can_change", lambda *_: False)
    assert decided(side).lane_change == 0
    # a change that is under way may be given up, but this driver does not
    monkeypatch.setattr(baselines, "can_change", lambda *_: True)
    monkeypatch.setattr(baselines, "place_is_free", lambda *_: True)
    assert decided(side, progress=0.3).lane_change == 0


@pytest.mark.parametrize(("hard", "changes"), [(2.05, False), (1.95, True)])
def test_it_changes_where_the_one_behind_brakes_no_harder_than_it_may(
    hard: float, changes: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(baselines, "accel_behind", lambda *_: -hard)
    assert make_idm({}, scenario())._params.cut_in_decel == 2.0
    assert decided(1).lane_change == (1 if changes else 0)


# --- for whom it waits ---


def later(local: LocalMap, state: State) -> tuple[LocalMap, State]:
    """The same where the route began two lanes earlier."""
    before = np.zeros((2, local.node.shape[1]))
    node, owed = np.concatenate([before, local.node]), local.obligation.copy()
    node[2:, NEXT] += 2.0
    owed[:, OWN_NODE] += 2.0
    local = local._replace(first=local.first + 2, node=node, obligation=owed)
    return local, state._replace(node=state.node + 2)


def closed(v: float, to_line: float, enters: float, gap: float, **what: float) -> list[int]:
    """The lines that are closed for an ego at `v` (m/s), so many metres before the junction; an agent
    at 10 m/s has so many metres left to where it enters."""
    agent = Agent("x", "wi_0", 30.0, 10.0)
    task, local, state = seen(CROSSING, "si_0", 90.0 - to_line, v, agent, ways=("si", "no"))
    inside = next(k for k, n in enumerate(task.route.lane) if n == lane(CROSSING, ":sn_0"))
    steady = local.agent.copy()
    steady[:, 0, DRIVEN] = 10.0 * local.dt * np.arange(len(steady))
    owed = np.zeros((1, local.obligation.shape[1]))
    owed[0, [OWN_NODE, AGENT, ENTERS]] = what.get("own", inside), 0, enters
    owed[0, MERGES] = what.get("merges", 0.0)
    open_lines, table = np.zeros_like(local.closed), local.node.copy()
    table[:, STOP_LINE] = 0.0
    local = local._replace(agent=steady, obligation=owed, closed=open_lines, node=table)
    found = with_yield_lines(local, state, gap)
    further = with_yield_lines(*later(local, state), gap)
    assert np.array_equal(further.closed, found.closed)
    assert np.array_equal(further.node[2:, STOP_LINE], found.node[:, STOP_LINE])
    rows = np.flatnonzero(found.closed.any(axis=1))
    for row in rows:
        assert (found.closed[row] == 1).all() and found.node[row + local.first, STOP_LINE] == 1.0
    assert not local.closed.any() and found.node[:, STOP_LINE].sum() == len(rows)
    return [int(task.route.lane[k + local.first]) for k in rows]


@pytest.mark.parametrize(
    ("v", "to_line", "enters", "gap", "waits"),
    [
        (8.0, 20.0, 49.0, 3.0, True),  # the ego is there after 2.5 s; it comes within 5.5 s
        (8.0, 20.0, 58.0, 3.0, False),
        (8.0, 20.0, 58.0, 4.0, True),
        (1.0, 9.0, 44.0, 1.5, True),  # it pulls away: 3 m/s at least, so it is there after 3 s
        (1.0, 9.0, 48.0, 1.5, False),
        (9.0, 15.0, 30.0, 3.0, True),  # with 3 m/s2 it stops in 13.5 m
        (9.0, 13.0, 30.0, 3.0, False),  # too late
    ],
)
def test_a_line_is_closed_for_who_comes_too_soon_after_the_ego_could_be_there(
    v: float, to_line: float, enters: float, gap: float, waits: bool
) -> None:
    assert closed(v, to_line, enters, gap) == ([lane(CROSSING, "si_0")] if waits else [])


def test_no_line_is_closed_for_who_waits_or_is_waited_for_otherwise() -> None:
    assert closed(8.0, 20.0, math.inf, 3.0) == []  # at the kerb
    assert closed(8.0, 20.0, 30.0, 3.0, merges=IN_WAY) == []
    assert (
        closed(
            8.0, 20.0, 30.0, 3.0, own=seen(CROSSING, "si_0", 70.0, 8.0, ways=("si", "no"))[2].node
        )
        == []
    )


def test_the_lane_before_a_place_of_the_path() -> None:
    task, local, state = seen(CROSSING, "si_0", 50.0, 8.0, ways=("si", "no"))
    nodes = {CROSSING.lane_ids[n]: k for k, n in enumerate(task.route.lane)}
    assert _before(local.node, state.node, nodes[":sn_0"]) == nodes["si_0"]
    assert _before(local.node, state.node, nodes["no_0"]) == nodes[":sn_0"]


# --- the one behind ---


def from_far() -> RoadMap:
    """LANES, reached by three edges of 300 m."""
    return build([
        *(Lane(name, 0, ((-900 + 300 * k, 0), (-600 + 300 * k, 0)), (after,))
          for k, (name, after) in enumerate((("u", "v_0"), ("v", "w_0"), ("w", "a_1")))),
        *(Lane("a", k, ((0, 3.2 * (k - 1)), (600, 3.2 * (k - 1)))) for k in range(3)),
    ])  # fmt: skip


@pytest.mark.parametrize(("road", "ways"), [(LANES, ("a",)), (from_far(), ("u", "v", "w", "a"))])
def test_the_nearest_behind_in_the_lane_of_the_change_is_asked(
    road: RoadMap, ways: tuple[str, ...]
) -> None:
    """20 m and 40 m behind the front of the ego, which is 5 m long; those ahead or in other lanes
    are not."""
    others = (
        Agent("far", "a_2", 60.0, 14.0), Agent("near", "a_2", 80.0, 12.0),
        Agent("ahead", "a_2", 101.0, 3.0), Agent("own", "a_1", 90.0, 14.0),
        Agent("right", "a_0", 95.0, 14.0),
    )  # fmt: skip
    for those, gap, v in ((others, 15.0, 12.0), ((others[0], *others[2:]), 35.0, 14.0)):
        task, local, state = seen(road, "a_1", 100.0, 9.0, *those, ways=ways)
        changed = begin_change(local, task.ego, state, 1)
        expected = follow_accel(task.ego, v, local.limit, gap, 9.0)
        assert accel_behind(local, task.ego, changed) == pytest.approx(expected)
    task, local, state = seen(road, "a_1", 100.0, 9.0, *others[2:], ways=ways)
    changed = begin_change(local, task.ego, state, 1)
    assert accel_behind(local, task.ego, changed) == math.inf
    beside = Agent("beside", "a_2", 99.5, 8.0)
    task, local, state = seen(road, "a_1", 100.0, 9.0, beside, ways=ways)
    changed = begin_change(local, task.ego, state, 1)
    expected = follow_accel(task.ego, 8.0, local.limit, -4.5, 9.0)
    assert accel_behind(local, task.ego, changed) == pytest.approx(expected)


# --- following ---


@pytest.mark.parametrize("step", [0.1, 0.25])
def test_it_follows_step_by_step(step: float) -> None:
    """Behind a leader that keeps its speed, up to a light that closes after two seconds."""
    road = road_with_light()
    ego = ego_at(road, "a_0", 172.0, 9.0, route=edges(road, "a", "b"))
    task = task_of(road, ego, physics=Physics(step, PHYSICS.ballistic, 3.0))
    local, state = local_of(task, scene_of(ego, road, signals=lights(GREEN), step=step))
    shut = local.closed.copy()
    shut[state.node - local.first, int(2.0 / local.dt) :] = 1
    local = local._replace(closed=shut)
    follower = task.ego._replace(max_accel=1.5, headway=1.2, gap=2.0)
    nodes, motion, pose = np.zeros(30, np.int64), np.zeros((30, 2)), np.zeros((30, 4))
    _follow(local, task.ego, follower, state, 25.0, 6.0, nodes, motion, pose)
    gap = 25.0
    for k in range(30):
        wanted = follow_accel(follower, state.v, local.node[state.node, LIMIT], gap, 6.0)
        state, _ = advance(local, task.ego, state, wanted, k * step)
        gap += (6.0 - state.v) * step
        assert (nodes[k], *motion[k]) == (state.node, state.s, state.v)
    assert np.all(np.diff(pose[:, 0]) >= 0.0) and pose[0, 2:].tolist() == [1.0, 0.0]
    assert pose[:, 0] == pytest.approx(
        [
            s + (200.0 if n != nodes[0] else 0.0) - 2.5
            for n, s in zip(nodes, motion[:, 0], strict=True)
        ]
    )
