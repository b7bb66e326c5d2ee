"""Comfort, jerk, events and free-flow time against hand calculation."""

from math import inf

import numpy as np
import pytest
from helpers import Lane, build, crossing, edges, ego_at, straight_road

from sumo_mcts.evaluation.metrics import (
    JERK_MAX,
    LATERAL_MAX,
    accelerations,
    comfortable_share,
    crossing_time,
    events,
    free_flow_time,
    jerks,
    lateral_accelerations,
    rms,
    window,
)
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import EgoState


@pytest.mark.parametrize(("step", "steps"), [(0.05, 10), (0.1, 5), (0.3, 2), (0.5, 1), (1.0, 1)])
def test_window_fills_half_a_second(step: float, steps: int) -> None:
    assert window(step) == steps


@pytest.mark.parametrize("step", [0.05, 0.1, 0.5])
def test_jerk_of_a_constant_jerk(step: float) -> None:
    t = np.arange(0.0, 4.0, step)
    assert jerks(0.5 * 1.7 * t * t, step) == pytest.approx(1.7)


def test_jerk_of_a_jump_in_acceleration_is_spread_over_the_window() -> None:
    v = np.concatenate([np.full(20, 20.0), 20.0 - 0.1 * 2.0 * np.arange(1, 20)])
    assert np.abs(jerks(v, 0.1)).max() == pytest.approx(2.0 / 0.5)
    assert jerks(v[:10], 0.1).shape == (0,)
    assert jerks(v[:11], 0.1).shape == (1,)


def test_lateral_acceleration_on_a_circle() -> None:
    t = np.arange(0.0, 6.0, 0.1)
    v = np.full(len(t), 8.0)
    heading = (8.0 / 20.0 * t + np.pi) % (2 * np.pi) - np.pi
    assert lateral_accelerations(v, heading, 0.1) == pytest.approx(8.0 * 8.0 / 20.0)


def test_comfortable_share_counts_steps() -> None:
    assert comfortable_share(np.array([3.0]), np.zeros(1), 0.1) is None
    assert comfortable_share(np.full(50, 10.0), np.zeros(50), 0.1) == 1.0
    one_hard_step = np.concatenate([np.full(20, 10.0), np.full(20, 9.5)])
    assert accelerations(one_hard_step, 0.1).min() == pytest.approx(-5.0)
    # 1 m/s2 of mean acceleration come and go within 0.5 s: 2 m/s3 are fine, the step itself is not
    assert comfortable_share(one_hard_step, np.zeros(40), 0.1) == pytest.approx(38 / 39)
    bend = 0.06 * np.maximum(np.arange(40.0) - 20.0, 0.0)
    assert comfortable_share(np.full(40, 10.0), bend, 0.1) == pytest.approx(
        24 / 39
    )  # 6 m/s2 once the window is full


def test_bounds_themselves_are_comfortable() -> None:
    v = np.linspace(30.0, 30.0 - 4.05 * 3.9, 40)
    assert comfortable_share(v, np.zeros(40), 0.1) == 1.0


def test_rms() -> None:
    assert rms(np.zeros(0)) is None
    assert rms(np.array([3.0, -4.0])) == pytest.approx(np.sqrt(12.5))


def test_events_need_a_second_of_quiet() -> None:
    assert events([], [], 0.1) == []
    assert events([1.0, 1.1, 1.2, 2.0], [3.0, 5.0, 4.0, 2.5], 0.1) == [5.0]
    assert events([1.0, 1.1, 2.2], [3.0, 5.0, 2.5], 0.1) == [5.0, 2.5]
    assert events([1.0, 2.0, 3.0, 5.0], [3.0, 2.0, 4.0, 2.5], 1.0) == [
        4.0,
        2.5,
    ]  # the same at long steps


def driver(road: RoadMap, speed_factor: float, max_speed: float) -> EgoState:
    return ego_at(road, road.lane_ids[0], 0.0)._replace(
        speed_factor=speed_factor, max_speed=max_speed
    )


def test_free_flow_time_over_junctions() -> None:
    road = straight_road(speed=15.0)
    route = edges(road, "a", "b", "c")
    assert free_flow_time(road, route, 50.0, driver(road, 1.0, inf)) == pytest.approx(
        (620.0 - 50.0) / 15.0
    )
    assert free_flow_time(road, route, 50.0, driver(road, 1.1, inf)) == pytest.approx(
        (620.0 - 50.0) / 16.5
    )
    assert free_flow_time(road, route, 0.0, driver(road, 1.0, 10.0)) == pytest.approx(62.0)
    assert free_flow_time(road, edges(road, "b"), 50.0, driver(road, 1.0, inf)) == pytest.approx(
        10.0
    )


def test_free_flow_time_takes_the_connection_of_the_route_and_the_fast_lane() -> None:
    road = crossing()
    turn = float(road.length[road.lane_ids.index(":wn_0")])
    assert free_flow_time(
        road, edges(road, "wi", "no"), 0.0, driver(road, 1.0, inf)
    ) == pytest.approx(90 / 15 + turn / 8 + 90 / 15)
    two = build(
        [
            Lane("a", 0, ((0, 0), (100, 0)), ("b_0",), 10.0),
            Lane("a", 1, ((0, 3), (100, 3)), (), 20.0),
            Lane("b", 0, ((100, 0), (200, 0)), (), 10.0),
        ]
    )
    assert free_flow_time(two, edges(two, "a", "b"), 20.0, driver(two, 1.0, inf)) == pytest.approx(
        4.0 + 10.0
    )


def test_unconnected_edges_are_never_reached() -> None:
    road = crossing()
    assert free_flow_time(road, edges(road, "si", "eo"), 0.0, driver(road, 1.0, inf)) == inf


def test_lateral_acceleration_is_mean_speed_times_mean_yaw_rate() -> None:
    """With speeds and headings that change unevenly, window by window."""
    rng, step = np.random.default_rng(6), 0.1
    v, heading = rng.uniform(2.0, 12.0, 30), np.cumsum(rng.uniform(-0.2, 0.3, 30))
    n = window(step)
    found = lateral_accelerations(v, heading, step)
    for k in range(len(found)):
        mean = sum(0.5 * (v[i] + v[i + 1]) for i in range(k, k + n)) / n
        assert found[k] == pytest.approx(mean * (heading[k + n] - heading[k]) / (n * step))
    assert len(found) == 30 - n


@pytest.mark.parametrize("step", [0.1, 0.02, 0.05])
def test_the_bounds_of_jerk_and_of_lateral_acceleration_are_comfortable_to_the_rounding(
    step: float,
) -> None:
    time = step * np.arange(round(1.5 / step))
    jerky = 20.0 - 4.0 * time + 0.5 * JERK_MAX * time * time
    assert JERK_MAX < jerks(jerky, step).max() < JERK_MAX + 1e-9  # by rounding alone
    straight = np.zeros(len(time))
    assert comfortable_share(jerky, straight, step) == 1.0
    assert comfortable_share(jerky + 0.005 * JERK_MAX * time * time, straight, step) < 1.0
    steady = np.full(len(time), 7.0)
    turned = time * LATERAL_MAX / 7.0
    assert comfortable_share(steady, turned, step) == 1.0
    assert comfortable_share(steady, 1.01 * turned, step) < 1.0
    assert comfortable_share(steady, -1.01 * turned, step) < 1.0


def test_from_inside_a_junction_the_rest_of_its_lanes_is_driven() -> None:
    """7 of 10 m, and 20 m behind them, at 5 m/s."""
    road = build([
        Lane("a", 0, ((0, 0), (50, 0)), (":m_0",)),
        Lane(":m", 0, ((50, 0), (60, 0)), (":n_0",), 5.0, junction="m"),
        Lane(":n", 0, ((60, 0), (80, 0)), ("b_0",), 5.0, junction="m"),
        Lane("b", 0, ((80, 0), (160, 0))),
    ])  # fmt: skip
    ego = ego_at(road, ":m_0", 3.0)
    assert crossing_time(road, 1, 3.0, ego) == (pytest.approx(27.0 / 5.0), 3)
    assert crossing_time(road, 2, 3.0, ego) == (pytest.approx(17.0 / 5.0), 3)
    assert crossing_time(road, 0, 3.0, ego) == (0.0, 0)
