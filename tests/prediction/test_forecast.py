"""How the others are expected to move."""

import math
from pathlib import Path

import libsumo
import naive
import numpy as np
import pytest
from helpers import Agent, Lane, build, crossing, ego_at, lights
from helpers_model import (
    forecast_of,
    lanes_east,
    predicted,
    road_with_light,
    scenario,
    scene_of,
    task_of,
    traffic_params,
)
from helpers_networks import netconvert, simulation
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts.config import load
from sumo_mcts.config.builtin import root, scenario_path
from sumo_mcts.episode import run_episode
from sumo_mcts.numerics.signals import signal_states
from sumo_mcts.prediction.behaviour import HARD, MOST_HABIT
from sumo_mcts.prediction.course import Course, waiting_place
from sumo_mcts.prediction.forecast import CRUISING, OracleData, Question, predict
from sumo_mcts.road import ALLWAY, LEFT, STRAIGHT, RoadMap
from sumo_mcts.scene import (
    AFTER_STOP,
    BRAKES,
    GREEN,
    RED,
    YELLOW,
    Forecast,
    Intent,
    Sideways,
    Signals,
)
from sumo_mcts.world.observe import Change, Observer
from sumo_mcts.world.roadmap import known_roadmap, read_roadmap

STEP = 0.2  # s between forecast times


def along(road: RoadMap, forecast: Forecast, agent: int, *names: str) -> list[float]:
    """How far an agent is at each time, m from the start of the first of these lanes, one behind
    the other."""
    begins = dict(
        zip(
            (road.lane_ids.index(name) for name in names),
            np.cumsum([0.0, *(road.length[road.lane_ids.index(name)] for name in names)]),
            strict=False,
        )
    )
    return [
        float(begins[int(lane)] + s)
        for lane, s in zip(forecast.lane[0, :, agent], forecast.s[0, :, agent], strict=True)
    ]


# --- alone ---


@given(st.floats(0.0, 25.0), st.floats(50.0, 500.0))
def test_constant_velocity_is_constant(v: float, s: float) -> None:
    road = lanes_east(3, 900.0)
    _, forecast = predicted(road, Agent("a", "a_2", s, v), params=traffic_params(interacting=False))
    times = np.arange(forecast.v.shape[1]) * STEP
    assert np.all(forecast.v[0, :, 0] == v) and np.all(forecast.lane[0] == 2)
    assert forecast.s[0, :, 0] == pytest.approx(s + v * times)
    assert forecast.pose[0, :, 0] == pytest.approx(
        np.column_stack(
            [
                s - 2.5 + v * times,
                np.full(len(times), 3.2),
                np.ones(len(times)),
                np.zeros(len(times)),
            ]
        )
    )


@given(st.floats(0.0, 15.0), st.floats(50.0, 200.0), st.sampled_from([0.1, 0.2, 0.5]))
def test_a_free_car_accelerates_up_to_the_limit(v: float, s: float, step: float) -> None:
    road = lanes_east(3, 900.0)
    params = traffic_params(step)._replace(persistence=0.0)
    _, forecast = predicted(road, Agent("a", "a_2", s, v), params=params, trend=[2.0])
    expected = naive.free_drive(s, v, 15.0, params.accel, step, forecast.v.shape[1])
    assert np.column_stack([forecast.s[0, :, 0], forecast.v[0, :, 0]]) == pytest.approx(
        np.array(expected)
    )


@pytest.mark.parametrize("step", [0.1, 0.5, 1.0])
def test_who_brakes_comes_as_far_as_in_sumo_with_its_steps(step: float) -> None:
    """With Euler integration a position follows the speed at the end of a step: with steps of a
    second a stop from 12 m/s is 6 m shorter."""
    road = lanes_east(3, 900.0)
    params = traffic_params(0.1)._replace(euler=0.5 * step)
    scene, nowhere = (
        scene_of(ego_at(road, "a_0", 10.0, 0.0), road, Agent("a", "a_2", 100.0, 12.0)),
        np.zeros(0, np.int32),
    )
    question = Question(scene, nowhere, np.zeros(0), params, 8.0)
    forecast = predict(road, question, intent=Intent(0, BRAKES))
    s, v = 100.0, 12.0
    while v > 0.0:
        v = max(0.0, v - HARD * step)
        s += v * step
    assert forecast.s[0, -1, 0] == pytest.approx(s, abs=0.6 * step)


def test_who_cruises_goes_on_cruising() -> None:
    road = lanes_east(3, 900.0)
    _, forecast = predicted(road, Agent("a", "a_2", 100.0, 9.0), trend=[0.0])
    assert forecast.v[0, :, 0] == pytest.approx(9.0)
    _, forecast = predicted(road, Agent("a", "a_2", 100.0, 9.0), trend=[1.0])
    assert forecast.v[0, -1, 0] > 13.0


@given(st.floats(2.0, 14.0), st.floats(-3.0, 2.0), st.sampled_from([0.1, 0.2, 0.5]))
def test_what_a_driver_does_otherwise_than_expected_goes_on_and_fades(
    v: float, trend: float, step: float
) -> None:
    params = traffic_params(step)
    _, forecast = predicted(
        lanes_east(3, 900.0),
        Agent("a", "a_2", 50.0, v),
        params=params,
        trend=[trend],
        standing_s=[0.0],
    )
    speeds = forecast.v[0, :, 0]
    likes = v if abs(trend) < CRUISING and v > 3.0 else 15.0
    free = np.clip((likes - speeds) / step, -params.decel, params.accel)
    fades = abs(trend) >= CRUISING or v <= 3.0
    habit = np.clip(trend - free[0], -MOST_HABIT, MOST_HABIT) * np.exp(
        -np.arange(len(speeds)) * step / params.persistence * fades
    )
    moving = (np.minimum(speeds[:-1], speeds[1:]) > 0.5) & (
        speeds[:-1] < 15.0
    )  # not at a stand, nor beyond the limit
    assert (np.diff(speeds) / step)[moving] == pytest.approx((free + habit)[:-1][moving], abs=1e-6)


def test_who_rolls_to_a_stand_is_expected_to_do_so() -> None:
    """However slow it is: what it stops for may be nothing that the map tells, as in a junction
    without lanes."""
    _, forecast = predicted(lanes_east(3, 900.0), Agent("a", "a_2", 50.0, 0.8), trend=[-2.0])
    assert forecast.v[0, :6, 0].max() <= 0.8 and forecast.v[0, 1:4, 0].min() < 0.5
    _, forecast = predicted(lanes_east(3, 900.0), Agent("a", "a_2", 50.0, 0.8), trend=[1.5])
    without = predicted(
        lanes_east(3, 900.0),
        Agent("a", "a_2", 50.0, 0.8),
        params=traffic_params()._replace(persistence=0.0),
        trend=[1.5],
    )[1]
    assert 2.0 < forecast.v[0, 5, 0] < without.v[0, 5, 0] - 0.3


def test_who_keeps_closer_than_the_model_is_expected_to_go_on_doing_so() -> None:
    pair = Agent("a", "a_2", 100.0, 10.0), Agent("b", "a_2", 114.0, 10.0)
    _, forecast = predicted(lanes_east(3, 900.0), *pair, trend=[0.0, 0.0])
    _, without = predicted(
        lanes_east(3, 900.0),
        *pair,
        params=traffic_params()._replace(persistence=0.0),
        trend=[0.0, 0.0],
    )
    assert forecast.v[0, :20, 0] == pytest.approx(10.0, abs=0.5)
    assert without.v[0, 10, 0] < 9.0


def test_who_accelerates_stops_for_red_all_the_same() -> None:
    road = road_with_light()
    _, forecast = predicted(road, Agent("a", "a_0", 120.0, 10.0), signals=lights(RED), trend=[2.6])
    assert (
        forecast.v[0, -1, 0] < 0.5 and forecast.s[0, -1, 0] < 200.0 and forecast.lane[0, -1, 0] == 0
    )


def test_an_offset_from_the_lane_dies_away_and_people_walk_on() -> None:
    road = lanes_east(3, 900.0)
    _, forecast = predicted(
        road,
        Agent("a", "a_2", 100.0, 9.0, d=1.0),
        Agent("p", "", v=1.0, x=50.0, y=-20.0, length=0.3, width=0.5, heading=math.pi / 2),
    )
    aside = forecast.pose[0, :, 0, 1] - 3.2
    assert aside[0] == pytest.approx(1.0) and np.all(np.diff(aside) < 0.0) and aside[-1] < 0.05
    assert forecast.pose[0, -1, 1, :2] == pytest.approx((50.0, -10.0)) and np.all(
        forecast.lane[0, :, 1] == -1
    )


@pytest.mark.parametrize(
    ("d", "v", "blinker", "lane", "ends"),
    [
        (0.5, 9.0, 0, 1, 0.5),  # a place of its own
        (1.3, 9.0, 0, 1, 0.7),  # it comes from the lane beside, and stops where it fits
        (-1.3, 9.0, 0, 1, -0.7),
        (1.3, 0.0, 0, 1, 1.3),  # who stands, stays
        (1.0, 9.0, 1, 2, -0.7),  # it changes to the left, and stops where it fits there
    ],
)
def test_where_lanes_are_divided_agents_have_places_within_them(
    d: float, v: float, blinker: int, lane: int, ends: float
) -> None:
    """A car that had just come over the line was expected to drive on over it."""
    road = lanes_east(3, 900.0)
    ego = ego_at(road, "a_0", 6.0, 0.0)._replace(sideways=Sideways(1.0, 0.6))
    scene = scene_of(ego, road, Agent("a", "a_1", 100.0, v, d=d))
    scene.agents.blinker[:] = blinker
    forecast = forecast_of(task_of(road, ego), scene)
    aside = forecast.pose[0, -1, 0, 1] - (lane - 1) * 3.2
    assert forecast.lane[0, -1, 0] == lane and aside == pytest.approx(ends, abs=0.02)


@pytest.mark.parametrize(
    ("ego", "d", "error", "lane"),
    [
        ("a_0", 0.3, 0.0, 2),
        ("a_0", 0.3, 0.3, 1),
        ("a_1", 0.3, 0.3, 1),
        ("a_0", 1.0, 0.3, 2),
        ("a_2", 0.3, 0.3, 2),
        ("a_2", -0.3, 0.0, 1),
        ("a_2", 0.0, 0.0, 1),
    ],
)
def test_who_blinks_changes_lanes_unless_it_would_make_room_and_may_only_seem_to(
    ego: str, d: float, error: float, lane: int
) -> None:
    """Off its centre line by what may be the sensor's error, it is expected where it leaves the ego
    less room."""
    params = traffic_params(config=scenario(f"sensor.position_error_m={error}"))
    _, forecast = predicted(
        lanes_east(3, 900.0), Agent("a", "a_1", 100.0, 10.0, d), ego=ego, params=params, blinker=[1]
    )
    assert set(forecast.lane[0, :, 0].tolist()) == {lane}


def forked() -> RoadMap:
    """Lane a_0 goes straight on to b_0 or left to c_0."""
    return build(
        [
            Lane("a", 0, ((0, 0), (100, 0)), (":s_0", ":l_0")),
            Lane(":s", 0, ((100, 0), (110, 0)), ("b_0",), junction="j", direction=STRAIGHT),
            Lane(
                ":l",
                0,
                ((100, 0), (107, 3), (110, 10)),
                ("c_0",),
                8.0,
                junction="j",
                direction=LEFT,
            ),
            Lane("b", 0, ((110, 0), (300, 0))),
            Lane("c", 0, ((110, 10), (110, 200))),
        ]
    )


@pytest.mark.parametrize(("blinker", "end"), [(0, "b_0"), (1, "c_0"), (-1, "b_0")])
def test_the_blinker_tells_the_way(blinker: int, end: str) -> None:
    road = forked()
    _, forecast = predicted(road, Agent("a", "a_0", 80.0, 8.0), blinker=[blinker])
    assert road.lane_ids[forecast.lane[0, -1, 0]] == end


def test_who_turns_slows_down_for_the_turn() -> None:
    road = forked()
    _, forecast = predicted(road, Agent("a", "a_0", 40.0, 15.0), blinker=[1], trend=[2.0])
    inside = forecast.lane[0, :, 0] == road.lane_ids.index(":l_0")
    assert forecast.v[0, inside, 0].max() < 8.6 and forecast.v[0, :, 0].min() > 6.0


def test_who_reaches_the_end_of_the_road_is_gone() -> None:
    road = lanes_east(3, 200.0)
    _, forecast = predicted(
        road, Agent("a", "a_2", 150.0, 10.0), params=traffic_params(interacting=False)
    )
    assert forecast.valid[0, :, 0].tolist() == [
        150.0 + 10.0 * k * STEP <= 200.1 for k in range(forecast.valid.shape[1])
    ]


# --- with others ---

platoons = st.lists(st.tuples(st.floats(0.0, 15.0), st.floats(0.5, 40.0)), min_size=2, max_size=6)


@given(platoons, st.booleans())
def test_nobody_overlaps_the_leader(platoon: list[tuple[float, float]], wall: bool) -> None:
    """Where braking at 4.5 m/s2 after a second would do to begin with.

    `wall`: the first one stands and stays.
    """
    road = lanes_east(3, 900.0)
    place, ahead, agents = 500.0, 0.0, []
    for k, (speed, more) in enumerate(platoon):
        v = 0.0 if wall and k == 0 else speed
        place -= 5.0 + more + v + max(0.0, v * v - ahead * ahead) / 9.0
        agents.append(Agent(f"v{k}", "a_2", place, v))
        ahead = v
    _, forecast = predicted(
        road, *agents, standing_s=[9.0 if wall and k == 0 else 0.0 for k in range(len(agents))]
    )
    s = forecast.s[0]
    assert np.all(s[:, :-1] - s[:, 1:] >= 5.0)
    assert np.all(np.diff(s, axis=0) >= 0.0) and np.all(forecast.v >= 0.0)
    assert not wall or np.all(s[:, 0] == s[0, 0])


def test_a_follower_keeps_the_gap_it_likes() -> None:
    road, params = lanes_east(3, 2000.0), traffic_params()
    _, forecast = predicted(
        road,
        Agent("a", "a_2", 200.0, 8.0),
        Agent("b", "a_2", 160.0, 12.0),
        seconds=60.0,
        trend=[0.0, 1.0],
    )
    gap = float(forecast.s[0, -1, 0] - forecast.s[0, -1, 1]) - 5.0
    wish = naive.desired_gap(8.0, 8.0, params.gap, params.headway, params.accel, params.decel)
    assert forecast.v[0, -1] == pytest.approx(8.0, abs=0.05)
    assert gap == pytest.approx(wish, rel=0.03)


def test_the_head_of_a_standing_queue_stays_and_whoever_waits_for_a_leader_does_not() -> None:
    road = lanes_east(3, 900.0)
    queue = [Agent("a", "a_2", 300.0, 0.0), Agent("b", "a_2", 293.0, 0.0)]
    _, forecast = predicted(road, *queue, standing_s=[5.0, 5.0])
    assert np.all(forecast.s[0] == forecast.s[0, 0])
    _, forecast = predicted(road, *queue, standing_s=[1.0, 5.0])
    assert np.all(forecast.s[0, -1] > forecast.s[0, 0] + 20.0)


def test_a_follower_stops_behind_a_standing_ego() -> None:
    road = lanes_east(1, 900.0)
    ego = ego_at(road, "a_0", 200.0, 0.0)
    scene = scene_of(ego._replace(v=0.0), road, Agent("a", "a_0", 150.0, 12.0))
    task = task_of(road, ego)
    standing = forecast_of(task, scene, 10.0)
    # the nominal ego drives off by car following; one that is known to stand is stopped for
    waited = predict(
        road, Question(scene, np.array([0], np.int32), np.zeros(100), traffic_params(), 10.0)
    )
    assert standing.s[0, -1, 0] > 200.0
    assert 188.0 < waited.s[0, -1, 0] < 195.0
    assert waited.v[0, -1, 0] < 0.3 and waited.reacts[0]


# --- signals and right of way ---


def test_a_car_stops_for_red_and_goes_on_at_green() -> None:
    road = road_with_light()
    _, forecast = predicted(road, Agent("a", "a_0", 120.0, 12.0), signals=lights(RED), seconds=15.0)
    assert (
        195.0 < forecast.s[0, -1, 0] <= 200.0
        and forecast.v[0, -1, 0] < 0.3
        and np.all(forecast.lane[0] == 0)
    )
    opening = Signals(
        np.array([0, 1], np.int32), np.array([[RED, GREEN]], np.int32), np.array([[10.0, np.inf]])
    )
    _, forecast = predicted(road, Agent("a", "a_0", 120.0, 12.0), signals=opening, seconds=15.0)
    crossed = np.flatnonzero(forecast.lane[0, :, 0] != 0)
    assert len(crossed) and 10.0 < crossed[0] * STEP < 14.0
    _, forecast = predicted(road, Agent("a", "a_0", 190.0, 12.0), signals=lights(YELLOW))
    assert np.any(forecast.lane[0] > 0)  # too late to stop


@pytest.mark.parametrize("left_s", [0.0, 0.1, 2.0])
def test_who_waits_for_red_goes_at_green_also_where_it_comes_this_moment(left_s: float) -> None:
    """It has stood for long, but not without a cause."""
    until = np.array([[left_s, np.inf]])
    signals = Signals(np.array([0, 1], np.int32), np.array([[RED, GREEN]], np.int32), until)
    queue = [Agent("a", "a_0", 198.5, 0.0), Agent("b", "a_0", 191.0, 0.0)]
    _, forecast = predicted(
        road_with_light(), *queue, signals=signals, seconds=10.0, standing_s=[20.0, 19.0]
    )
    assert np.all(forecast.lane[0, -1] > 0)


@pytest.mark.parametrize("v", [5.0, 9.0, 13.0])
def test_a_line_is_braked_for_as_sumo_does(v: float, tmp_path: Path) -> None:
    """As late as possible, and to a stand where SUMO's driver stands."""
    nodes = (
        '<node id="w" x="0" y="0"/><node id="m" x="200" y="0" type="traffic_light"/><node '
        'id="e" x="400" y="0"/><node id="s" x="200" y="-200"/>'
    )
    edges = "".join(
        f'<edge id="{a}{b}" from="{a}" to="{b}" speed="{v}"/>' for a, b in ("wm", "me", "sm")
    )
    net = netconvert(
        tmp_path, nodes, edges, '<connection from="wm" to="me"/><connection from="sm" to="me"/>'
    )
    (tmp_path / "x.rou.xml").write_text(
        f'''<routes><vType id="car" sigma="0" speedFactor="1" speedDev="0"/><vehicle id="ego" depart="0" departPos="10"><route edges="sm me"/></vehicle>
        <vehicle id="other" type="car" depart="0" departPos="100" departSpeed="{v}"><route edges="wm me"/></vehicle></routes>'''
    )
    with simulation(net, [tmp_path / "x.rou.xml"]):
        road = read_roadmap(net)
        libsumo.simulationStep()
        libsumo.trafficlight.setRedYellowGreenState("m", "rr")
        scene = Observer(road).scene("ego", Change(), 300.0, timing=False)
        driven = []
        for _ in range(200):
            driven.append(
                (libsumo.vehicle.getLanePosition("other"), libsumo.vehicle.getSpeed("other"))
            )
            libsumo.simulationStep()
    lanes = np.array([scene.ego.lane], np.int32)
    forecast = predict(road, Question(scene, lanes, np.zeros(0), traffic_params(), 19.8))
    theirs = np.array(driven)[::2]
    assert np.abs(forecast.s[0, : len(theirs), 0] - theirs[:, 0]).max() < 1.0
    assert theirs[-1, 1] == pytest.approx(0.0, abs=0.01) and forecast.v[0, len(theirs) - 1, 0] < 0.1


@pytest.mark.parametrize(
    ("begin", "waits"),
    [
        (135.0, 130.0),
        (128.0, 120.0),
        (120.0, 120.0),
        (32.0, 30.0),
        (25.0, 20.0),
        (20.0, 20.0),
        (60.0, 60.0),
    ],
)
def test_the_place_to_wait_is_in_the_junction_of_the_stretch(begin: float, waits: float) -> None:
    """A path through two junctions, each with a place to wait inside: 20 to 40 m and 120 to 140 m
    along it."""
    internal = np.array([[False, True, True, False, True, True, False]])
    path, offset = (
        np.arange(7, dtype=np.int32)[None],
        np.array([[0.0, 20.0, 30.0, 40.0, 120.0, 130.0, 140.0, 200.0]]),
    )
    red, sign, nobody = (
        np.zeros((1, 7, 1), np.bool_),
        np.zeros((1, 7), np.bool_),
        np.full((1, 1), -1, np.int32),
    )
    course = Course(
        path,
        offset,
        np.array([7], np.int32),
        np.zeros((1, 7)),
        internal,
        red,
        sign,
        np.array([np.inf]),
        nobody,
        nobody,
        nobody,
        np.zeros((1, 1, 4)),
    )
    assert waiting_place(course, 0, 0, begin) == waits


def test_who_turns_left_waits_inside_the_junction_where_it_waits_in_sumo(tmp_path: Path) -> None:
    net = str(root() / "networks" / "crossing" / "crossing.net.xml")
    stream = "".join(
        f'<vehicle id="o{k}" type="car" depart="0" departLane="2" departPos="{140 - 14 * k}" '
        'departSpeed="9"><route edges="from_south to_north"/></vehicle>'
        for k in range(8)
    )
    (tmp_path / "x.rou.xml").write_text(
        f"""<routes><vType id="car" sigma="0" speedFactor="1" speedDev="0" tau="0.8"/>
        <vehicle id="ego" depart="0" departPos="10"><route edges="from_west to_east"/></vehicle>
        <vehicle id="other" type="car" depart="0" departPos="100" departSpeed="9" departLane="1"><route edges="from_north to_east"/></vehicle>
        {stream}</routes>"""
    )
    with simulation(net, [tmp_path / "x.rou.xml"]):
        road = read_roadmap(net)
        for _ in range(10):  # until all are there
            libsumo.simulationStep()
        scene = Observer(road).scene("ego", Change(), 300.0, timing=False)
        driven = []
        for _ in range(80):
            driven.append(
                (libsumo.vehicle.getLaneID("other"), libsumo.vehicle.getPosition("other"))
            )
            libsumo.simulationStep()
        waits = libsumo.vehicle.getSpeed("other")
    i = scene.agents.ids.index("other")
    lanes = np.array([scene.ego.lane], np.int32)
    forecast = predict(road, Question(scene, lanes, np.zeros(0), traffic_params(), 8.0))
    assert waits < 0.1 and driven[-1][0] == ":centre_3_0" == road.lane_ids[forecast.lane[0, -1, i]]
    centre = forecast.pose[0, -1, i, :2]
    assert (
        np.hypot(
            *(centre + 0.5 * scene.agents.length[i] * forecast.pose[0, -1, i, 2:] - driven[-1][1])
        )
        < 1.5
    )


def test_who_has_to_yield_lets_the_other_pass() -> None:
    """North-bound traffic waits for the west-east road; alone it does not."""
    road = crossing(bridge=False)
    north, east = Agent("n", "si_0", 55.0, 10.0), Agent("w", "wi_0", 55.0, 10.0)
    _, alone = predicted(road, north, ego="no_0")
    assert alone.v[0, :, 0].min() > 9.0
    _, forecast = predicted(road, north, east, ego="no_0")
    n, w = (
        along(road, forecast, 0, "si_0", ":sn_0", "no_0"),
        along(road, forecast, 1, "wi_0", ":we_0", "eo_0"),
    )
    assert forecast.v[0, :, 1].min() > 9.0  # who has the right of way does not brake
    first = next(k for k, s in enumerate(n) if s > 90.0 + 6.2)
    assert (
        w[first] - 5.0 > 90.0 + 9.4
    )  # nobody enters the shared stretch before the other has come out of it ...
    assert forecast.v[0, :, 0].min() < 5.0
    assert n[-1] > 100.0  # ... and afterwards it goes on


def test_whoever_yields_to_the_ego_is_polite() -> None:
    road = crossing(bridge=False)
    ego = ego_at(road, "wi_0", 55.0, 10.0, route=(0, 2))
    scene = scene_of(ego, road, Agent("n", "si_0", 45.0, 10.0))
    assert forecast_of(task_of(road, ego), scene).yields[0].tolist() == [True]
    assert forecast_of(task_of(road, ego), scene, params=traffic_params(interacting=False)).yields[
        0
    ].tolist() == [False]
    too_fast = scene_of(ego, road, Agent("n", "si_0", 84.0, 14.0))
    assert forecast_of(task_of(road, ego), too_fast).yields[0].tolist() == [False]


@pytest.mark.parametrize(("trend", "counted_on"), [(0.0, False), (-2.0, False), (-4.0, True)])
def test_one_that_brakes_to_a_stand_before_the_ego_is_counted_on(
    trend: float, counted_on: bool
) -> None:
    """10 m/s, 18.2 m before the shared stretch: 2.7 m/s2 bring it to a stand."""
    road = crossing(bridge=False)
    ego = ego_at(road, "wi_0", 75.0, 10.0, route=(0, 2))
    scene = scene_of(ego, road, Agent("n", "si_0", 78.0, 10.0))
    scene = scene._replace(agents=scene.agents._replace(trend=np.array([trend])))
    assert forecast_of(task_of(road, ego), scene).yields[0].tolist() == [counted_on]


def all_way_stop() -> RoadMap:
    """The crossing without a bridge, with a stop sign on every arm: whoever came first goes first."""
    road = crossing(bridge=False)
    inside = np.array([road.lane_ids.index(name) for name in (":we_0", ":sn_0", ":wn_0")])
    rule = road.rule.copy()
    rule[inside] = ALLWAY
    return road._replace(rule=rule, conflict_yields=np.ones_like(road.conflict_yields))


def test_at_a_stop_sign_everybody_stands_first() -> None:
    _, forecast = predicted(
        all_way_stop(), Agent("n", "si_0", 50.0, 10.0), ego="no_0", seconds=14.0
    )
    north = forecast.v[0, :, 0]
    stands = int(np.argmin(north))
    assert (
        north[stands] < 0.5 and forecast.s[0, stands, 0] > 85.0 and forecast.lane[0, stands, 0] == 1
    )
    assert north[-1] > 5.0 and forecast.lane[0, -1, 0] == 3


@pytest.mark.parametrize(("s", "stands"), [(70.0, True), (79.5, True), (82.0, True), (86.0, False)])
def test_whoever_still_can_stands_at_a_stop_sign_however_hard_it_has_to_brake(
    s: float, stands: bool
) -> None:
    """10 m/s and 90 m of lane:

    SUMO's drivers begin when 4.5 m/s2 are due, and then need a little more.
    """
    _, forecast = predicted(all_way_stop(), Agent("n", "si_0", s, 10.0), ego="no_0", seconds=14.0)
    assert (forecast.v[0, :, 0].min() < 0.5) == stands


@pytest.mark.parametrize("first", [0, 1])
def test_at_an_all_way_stop_who_stood_first_goes_first(first: int) -> None:
    road = all_way_stop()
    agents = Agent("w", "wi_0", 88.0, 0.0), Agent("n", "si_0", 88.0, 0.0)
    _, forecast = predicted(road, *agents, ego="no_0", standing_s=[1.5 - first, 0.5 + first])
    entered = [int(np.argmax(road.internal[forecast.lane[0, :, i]])) for i in (0, 1)]
    assert 0 < entered[first] < entered[1 - first]


def test_an_ego_that_stands_has_its_turn_before_those_who_come_later() -> None:
    road = all_way_stop()
    ego = ego_at(road, "wi_0", 88.0, 0.0, route=(0, 2))
    for distance, lets_pass in ((60.0, True), (88.0, False)):
        coming = Agent("n", "si_0", distance, 10.0 if lets_pass else 0.0)
        scene = scene_of(ego, road, coming)
        if not lets_pass:
            scene = scene._replace(agents=scene.agents._replace(standing_s=np.array([1.0])))
        assert forecast_of(task_of(road, ego), scene).yields[0].tolist() == [lets_pass]


@pytest.mark.parametrize("s", [70.0, 72.0, 74.0])
def test_one_that_stands_first_anyway_is_counted_on_however_late_it_brakes(s: float) -> None:
    """12 m/s before a stop sign: SUMO's drivers brake at the last moment. The ego has entered."""
    road = all_way_stop()
    ego = ego_at(road, ":we_0", 11.0, 8.0, route=(0, 2))
    scene = scene_of(ego, road, Agent("n", "si_0", s, 12.0))
    assert forecast_of(task_of(road, ego), scene).yields[0].tolist() == [True]


phases = st.integers(1, 6).flatmap(
    lambda n: st.tuples(
        st.lists(
            st.lists(st.sampled_from([GREEN, YELLOW, RED]), min_size=n, max_size=n),
            min_size=3,
            max_size=3,
        ),
        st.lists(st.floats(0.1, 20.0), min_size=n, max_size=n),
    )
)


@given(phases, phases, st.floats(0.05, 1.0))
def test_signal_states_are_those_of_the_phase(
    first: tuple[list[list[int]], list[float]],
    second: tuple[list[list[int]], list[float]],
    dt: float,
) -> None:
    count = max(len(first[1]), len(second[1]))
    state = np.array(
        [[*row, *[row[-1]] * (count - len(row))] for row in (*first[0], *second[0])], np.int32
    )
    until = np.array(
        [
            [*np.cumsum(ends)[:-1], *[np.inf] * (count - len(ends) + 1)]
            for ends in (first[1], second[1])
        ]
    )
    signals = Signals(np.array([0, 3, 6], np.int32), state, until)
    grid = np.arange(80) * dt
    asked = ((0, 0), (0, 2), (1, 1))
    shown = signal_states(signals, *np.array(asked).T, grid)
    assert shown.tolist() == [
        [naive.light_at(signals, signal, link, t) for t in grid] for signal, link in asked
    ]


# --- oracles ---


@pytest.mark.parametrize("names", [("a_0", ":l_0", "c_0"), (":l_0",), ("c_0",)])
def test_the_oracle_knows_better_than_the_blinker(names: tuple[str, ...]) -> None:
    road = forked()
    state = ego_at(road, "b_0", 6.0, 0.0)
    scene = scene_of(state, road, Agent("a", "a_0", 80.0, 8.0), Agent("b", "a_0", 60.0, 8.0))
    lanes = np.array([road.lane_ids.index(name) for name in names], np.int32)
    forecast = forecast_of(task_of(road, state), scene, oracle=OracleData(lanes={0: lanes}))
    assert [road.lane_ids[lane] for lane in forecast.lane[0, -1]] == [
        "c_0" if ":l_0" in names else "b_0",
        "b_0",
    ]


def test_the_oracle_is_known_by_the_edge_to_whoever_changes_lanes() -> None:
    ways = {"r": (":l_0",), "l": (":s_0", ":l_1")}  # both lanes of a may turn left
    road = build(
        [
            Lane("a", 0, ((0, 0), (100, 0)), ways["r"]),
            Lane("a", 1, ((0, 3.2), (100, 3.2)), ways["l"]),
            Lane(":s", 0, ((100, 3.2), (110, 3.2)), ("b_0",), junction="j", direction=STRAIGHT),
            Lane(":l", 0, ((100, 0), (107, 3), (110, 10)), ("c_0",), junction="j", direction=LEFT),
            Lane(
                ":l", 1, ((100, 3.2), (105, 6), (107, 10)), ("c_1",), junction="j", direction=LEFT
            ),
            Lane("b", 0, ((110, 3.2), (300, 3.2))),
            Lane("c", 0, ((110, 10), (110, 200))),
            Lane("c", 1, ((107, 10), (107, 200))),
        ]
    )
    state = ego_at(road, "b_0", 6.0, 0.0)
    scene = scene_of(state, road, Agent("a", "a_1", 80.0, 8.0))
    true = np.array([road.lane_ids.index(name) for name in ("a_0", ":l_0", "c_0")], np.int32)
    for told, end in ((OracleData(), "b_0"), (OracleData(lanes={0: true}), "c_1")):
        assert (
            road.lane_ids[forecast_of(task_of(road, state), scene, oracle=told).lane[0, -1, 0]]
            == end
        )


def test_the_routes_forecast_takes_the_turns_that_sumo_then_takes() -> None:
    """Wherever nobody changes lanes; the blinkers of some come on later than the forecast would
    need them."""

    def wrong(prediction: str) -> int:
        config = load(
            scenario_path("unprotected-left-turn"),
            (f"prediction.name={prediction}", "planner.iterations=50"),
        )
        (trace,) = run_episode(config, seed=2).traces
        road = known_roadmap(config.sumo.net)
        lanes: dict[str, set[int]] = {}
        for cycle in trace.cycles:
            for vehicle, lane in zip(cycle.agents.ids, cycle.agents.lane, strict=True):
                lanes.setdefault(vehicle, set()).add(int(lane))
        count = 0
        for cycle in trace.cycles:
            for i, vehicle in enumerate(cycle.agents.ids):
                turns = [
                    {lane for lane in those if road.internal[lane]}
                    for those in (lanes[vehicle], set(cycle.forecast.lane[0, :, i].tolist()))
                ]
                count += all(turns) and not turns[0] & turns[1]
        return count

    assert wrong("idm") > 0
    assert wrong("routes") == 0


# --- scripts ---


@pytest.mark.parametrize(
    "name", ["unprotected-left-turn-scripted", "highway-exit-scripted", "straight-line-scripted"]
)
def test_the_script_forecast_is_what_sumo_then_does(name: str) -> None:
    """3 s ahead within 2 cm and half a degree, also in lane changes, in which SUMO turns a vehicle."""
    config = load(
        scenario_path(name),
        ("prediction.name=script", "planner.name=mcts", "planner.iterations=20"),
    )
    (trace,) = run_episode(config, seed=2).traces
    centres = []
    for before in trace.cycles:
        after = next(
            (cycle.agents for cycle in trace.cycles if abs(cycle.time - before.time - 3.0) < 1e-6),
            None,
        )
        k = round(3.0 / before.forecast.dt)
        assert k * before.forecast.dt == pytest.approx(3.0)
        for i, vehicle in enumerate(before.agents.ids if after is not None else ()):
            if vehicle not in after.ids:
                continue
            j = after.ids.index(vehicle)
            assert before.forecast.valid[0, k, i] and before.forecast.lane[0, k, i] == after.lane[j]
            x, y, c, n = before.forecast.pose[0, k, i]
            centres.append(
                (
                    math.dist((x, y), (after.x[j], after.y[j])),
                    abs(math.remainder(math.atan2(n, c) - after.heading[j], math.tau)),
                )
            )
    assert len(centres) > 20
    assert np.all(np.array(centres) < (0.02, math.radians(0.5)))


# --- lane changes ---


def test_who_changes_lanes_is_forecast_as_aslant_as_sumo_has_it() -> None:
    """A second ahead: a slow car turns by many degrees, and its rear stands out into the lane that
    it leaves."""
    config = load(
        scenario_path("highway-exit-scripted"), ("planner.name=mcts", "planner.iterations=20")
    )
    errors, slants = [], []
    traces = [run_episode(config, seed).traces[0] for seed in (2, 3)]
    for cycles, before in ((trace.cycles, cycle) for trace in traces for cycle in trace.cycles):
        after = next(
            (cycle.agents for cycle in cycles if abs(cycle.time - before.time - 1.0) < 1e-6), None
        )
        k = round(1.0 / before.forecast.dt)
        for i, vehicle in enumerate(before.agents.ids if after is not None else ()):
            j = after.ids.index(vehicle) if vehicle in after.ids else -1
            if j < 0 or abs(before.agents.d[i]) < 0.3 or before.agents.lane[i] != after.lane[j]:
                continue
            _, _, c, n = before.forecast.pose[0, k, i]
            errors.append(abs(math.remainder(math.atan2(n, c) - after.heading[j], math.tau)))
            slants.append(
                abs(math.remainder(before.agents.heading[i] - after.heading[j], math.tau))
            )
    assert len(errors) > 10 and max(slants) > math.radians(5.0)
    assert max(errors) < math.radians(2.5) and np.median(errors) < math.radians(1.0)


def test_who_stands_aslant_is_expected_to_stand_so() -> None:
    """SUMO keeps a vehicle's angle while it stands: one that stopped in the middle of a lane change
    has its rear in the other lane."""
    road = lanes_east(3, 900.0)
    agent = Agent("a", "a_1", 100.0, 0.0)
    ego = ego_at(road, "a_2", 60.0, 5.0)
    scene = scene_of(ego, road, agent)
    scene = scene._replace(
        agents=scene.agents._replace(heading=np.array([0.6]), standing_s=np.array([30.0]))
    )
    pose = forecast_of(task_of(road, ego), scene).pose[0, :, 0]
    assert np.arctan2(pose[:, 3], pose[:, 2]) == pytest.approx(0.6)
    assert pose[1:, 0] == pytest.approx(100.0 - 2.5 * math.cos(0.6)) and pose[
        1:, 1
    ] == pytest.approx(-2.5 * math.sin(0.6), abs=0.01)


@pytest.mark.parametrize(("shows", "gone"), [(RED, False), (AFTER_STOP, True), (GREEN, True)])
def test_red_that_may_be_passed_after_a_stop_holds_nobody_for_ever(shows: int, gone: bool) -> None:
    """A car that stands at the line drives on, one that comes stands there first."""
    road = road_with_light()
    _, forecast = predicted(
        road, Agent("a", "a_0", 198.5, 0.0), signals=lights(shows), seconds=15.0, standing_s=[1.5]
    )
    assert (forecast.lane[0, -1, 0] != road.lane_ids.index("a_0")) == gone
    _, forecast = predicted(
        road, Agent("a", "a_0", 120.0, 12.0), signals=lights(shows), seconds=15.0
    )
    assert (forecast.v[0, :, 0].min() < 1.0) == (shows != GREEN)
