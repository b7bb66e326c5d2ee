"""The sensor: how wrong it is and for how long, who hides whom, who is remembered; and that the
referee is told the truth."""

import math
from typing import Any

import numpy as np
import pytest
from helpers import Agent, agents_at, ego_at, lane, straight_road
from helpers_model import PHYSICS, lanes_east, scenario, scene_of
from hypothesis import given
from hypothesis import strategies as st
from naive import Box
from naive import share_in_view as naive_share_in_view

from sumo_mcts import config
from sumo_mcts.config import SensorConfig, builtin
from sumo_mcts.driver.driver import Driver
from sumo_mcts.driver.params import streams
from sumo_mcts.driver.sensor import Sensor, matched, moved_on, room_m, share_in_view, with_errors
from sumo_mcts.episode import run_episode
from sumo_mcts.episode.loop import Loop
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Scene
from sumo_mcts.world.library import import_libsumo

PERIOD = 0.5
NOISY = (
    "sensor.position_error_m=0.3",
    "sensor.speed_error_mps=0.3",
    "sensor.drop_probability=0.1",
    "sensor.occlusion=true",
)
ROAD = lanes_east(3, 4000.0)  # lane 1 along y = 0


def senses(road: RoadMap = ROAD, seed: int = 0, **keys: Any) -> Sensor:
    return Sensor(SensorConfig(**keys), road, PERIOD, streams(seed).noise)


def at(time: float, *agents: Agent, road: RoadMap = ROAD, s: float = 1000.0) -> Scene:
    """The ego in lane 1, and the others."""
    return scene_of(ego_at(road, "a_1", s), road, *agents)._replace(time=time)


def passing(time: float, v: float = 10.0) -> Agent:
    """Somebody beside the ego who keeps a speed."""
    return Agent("other", "a_2", 1000.0 + v * time, v)


# --- errors ---


def errors(count: int, seed: int = 0, **keys: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    """[count, 4] errors of x, y, v and trend in so many cycles, about somebody who always drives in
    the same place."""
    sensor, truth = senses(seed=seed, **keys), at(0.0, passing(0.0))
    rows = []
    for k in range(count):
        seen = sensor.perceive(truth._replace(time=k * PERIOD)).agents
        rows.append(
            [
                float(getattr(seen, name)[0] - getattr(truth.agents, name)[0])
                for name in ("x", "y", "v", "trend")
            ]
        )
    return np.array(rows)


@pytest.mark.slow
def test_errors_have_their_size_and_last_as_long_as_they_should() -> None:
    found = errors(6000, position_error_m=0.3, speed_error_mps=0.5, error_time_s=1.0)
    decay = math.exp(-PERIOD / 1.0)
    assert found.mean(axis=0) == pytest.approx(np.zeros(4), abs=0.03)
    assert found[:, :3].std(axis=0) == pytest.approx([0.3, 0.3, 0.5], rel=0.06)
    for column in found[:, :3].T:
        for lag in (1, 3):
            assert np.corrcoef(column[lag:], column[:-lag])[0, 1] == pytest.approx(
                decay**lag, abs=0.05
            )
    assert abs(np.corrcoef(found[:, 0], found[:, 1])[0, 1]) < 0.06


def test_the_error_of_the_acceleration_is_that_of_the_speeds() -> None:
    """A second's memory of how the speed seemed to change, as for the true acceleration."""
    found = errors(400, speed_error_mps=0.5)
    smoothed = 0.0
    for before, now, trend in zip(found[:-1, 2], found[1:, 2], found[1:, 3], strict=True):
        smoothed += ((now - before) / PERIOD - smoothed) * (1.0 - math.exp(-PERIOD))
        assert trend == pytest.approx(smoothed, abs=1e-9)


@pytest.mark.slow
def test_so_many_are_dropped() -> None:
    sensor = senses(drop_probability=0.2, memory_s=0.0)
    missed = [not sensor.perceive(at(k * PERIOD, passing(0.0))).agents.ids for k in range(4000)]
    assert np.mean(missed) == pytest.approx(0.2, abs=0.02)
    assert np.mean(np.array(missed[1:]) & np.array(missed[:-1])) == pytest.approx(
        0.04, abs=0.01
    )  # one miss does not bring another


def test_whoever_stands_is_seen_to_stand() -> None:
    sensor = senses(speed_error_mps=1.0, position_error_m=0.3)
    for k in range(20):
        seen = sensor.perceive(at(k * PERIOD, Agent("other", "a_2", 1030.0, 0.0))).agents
        assert (seen.v[0], seen.a[0], seen.trend[0]) == (0.0, 0.0, 0.0)
        assert seen.s[0] != 1030.0


def test_no_speed_is_negative() -> None:
    sensor = senses(speed_error_mps=3.0)
    assert (
        min(
            float(sensor.perceive(at(k * PERIOD, Agent("other", "a_2", 1030.0, 0.5))).agents.v[0])
            for k in range(50)
        )
        == 0.0
    )


def test_without_faults_the_scene_itself() -> None:
    scene = at(0.0, passing(0.0))
    assert senses(memory_s=5.0, error_time_s=3.0, visible_share=1.0).perceive(scene) is scene


def test_the_same_error_whoever_else_is_there_and_since_when() -> None:
    keys: dict[str, Any] = {
        "position_error_m": 0.5,
        "speed_error_mps": 0.5,
        "drop_probability": 0.3,
        "memory_s": 0.0,
    }
    alone, late, among, other_seed = (
        senses(**keys),
        senses(**keys),
        senses(**keys),
        senses(seed=1, **keys),
    )
    crowd = [Agent(name, "a_0", 900.0 + 20.0 * k, 8.0) for k, name in enumerate("xyz")]
    seen = []
    for k in range(30):
        sight = [
            alone.perceive(at(k * PERIOD, passing(0.0))),
            late.perceive(at(k * PERIOD, *([passing(0.0)] if k >= 10 else []))),
            among.perceive(at(k * PERIOD, passing(0.0), *crowd[: k % 4])),
            other_seed.perceive(at(k * PERIOD, passing(0.0))),
        ]
        seen.append(
            [
                float(s.agents.x[s.agents.ids.index("other")]) if "other" in s.agents.ids else None
                for s in sight
            ]
        )
    assert all(a == c for a, _, c, _ in seen)
    assert all(a == b for a, b, _, _ in seen[10:])
    assert all(a != d for a, _, _, d in seen if a is not None)
    assert None in [a for a, _, _, _ in seen]


def test_a_second_look_at_the_same_time_shows_the_same() -> None:
    sensor = senses(position_error_m=0.5, drop_probability=0.5)
    first = [sensor.perceive(at(k * PERIOD, passing(0.0))) for k in (0, 1)][1]
    assert sensor.perceive(at(PERIOD, passing(0.0))) is first


# --- lanes ---


@given(st.floats(3.0, 197.0), st.floats(-1.5, 1.5), st.sampled_from(["a_0", "a_1", "b_0"]))
def test_the_true_place_is_matched_to_the_true_lane(s: float, d: float, on: str) -> None:
    road = straight_road()
    agents = agents_at(road, Agent("other", on, s, d=d))
    found = matched(road, agents._replace(s=agents.s + 1.0, d=agents.d + 1.0))
    assert found.lane[0] == lane(road, on)
    assert (found.s[0], found.d[0]) == pytest.approx((s, d), abs=1e-6)


@given(st.floats(-2.0, 2.0), st.floats(-2.5, 2.5))
def test_lane_and_offset_say_where_the_agent_seems_to_be(along: float, aside: float) -> None:
    agents = agents_at(ROAD, Agent("other", "a_1", 1050.0))
    found = with_errors(ROAD, agents, np.array([[along, aside, 0.0, 0.0]]))
    middle = (
        0.0
        if found.lane[0] == lane(ROAD, "a_1")
        else 3.2
        if found.lane[0] == lane(ROAD, "a_2")
        else -3.2
    ) + float(found.d[0])
    if along != 0.0 or aside != 0.0:
        assert (found.s[0], middle) == pytest.approx((1050.0 + along, aside), abs=1e-6)
        assert abs(found.d[0]) <= 1.6 + 1e-9


def test_nobody_leaves_the_ends_of_its_lane() -> None:
    road = straight_road()
    agents = agents_at(road, Agent("at the line", "a_1", 199.5), Agent("just behind", "b_1", 0.5))
    found = with_errors(road, agents, np.array([[2.0, 0.0, 0.0, 0.0], [-2.0, 0.0, 0.0, 0.0]]))
    assert [road.lane_ids[k] for k in found.lane] == ["a_1", "b_1"]
    assert found.s.tolist() == [200.0, 0.0]


def test_pedestrians_have_errors_but_no_lane() -> None:
    agents = agents_at(ROAD, Agent("walker", "", x=1000.0, y=8.0, v=1.2))
    found = with_errors(ROAD, agents, np.array([[0.4, -0.2, 0.3, 0.0]]))
    assert (found.x[0], found.y[0], found.v[0], found.lane[0]) == pytest.approx(
        (1000.4, 7.8, 1.5, -1)
    )


def test_plans_leave_room_for_errors_of_position() -> None:
    assert room_m(SensorConfig(speed_error_mps=1.0)) == 0.0
    scene = at(0.0, passing(0.0, 10.0), Agent("ahead", "a_1", 1060.0, 10.0))
    config = scenario("sensor.position_error_m=0.3", "planner.iterations=20")
    thought = Driver(config, ROAD, PHYSICS, 0).decide(scene)
    assert thought.forecast is not None and thought.forecast.half_length.tolist() == pytest.approx(
        [2.5 + 0.6, 2.5 + 0.6]
    )


@pytest.mark.parametrize(("error", "lane"), [(0.0, 2), (0.3, 1)])
def test_the_planner_takes_for_gone_only_who_is_surely_leaving(error: float, lane: int) -> None:
    """Somebody blinks beside the ego and seems a little off its centre line: with such errors it
    may only seem so."""
    config = scenario(f"sensor.position_error_m={error}", "planner.iterations=20")
    scene = scene_of(ego_at(ROAD, "a_0", 1000.0), ROAD, Agent("other", "a_1", 1003.0, 10.0, d=0.3))
    scene = scene._replace(agents=scene.agents._replace(blinker=np.ones(1, np.int32)))
    thought = Driver(config, ROAD, PHYSICS, 0).decide(scene)
    assert thought.forecast is not None and set(thought.forecast.lane[0, :, 0].tolist()) == {lane}


# --- who hides whom ---


def shares(scene: Scene) -> dict[str, float]:
    found = share_in_view(scene.ego.x, scene.ego.y, scene.agents, ~scene.agents.person)
    return dict(zip(scene.agents.ids, found.tolist(), strict=True))


def test_a_truck_hides_the_car_before_it_and_not_the_one_beside_it() -> None:
    truck = Agent("truck", "a_1", 1035.0, length=12.0, width=2.5)
    found = shares(
        at(
            0.0,
            truck,
            Agent("before it", "a_1", 1050.0),
            Agent("beside it", "a_2", 1030.0),
            Agent("behind the ego", "a_1", 980.0),
        )
    )
    assert found == {
        "truck": pytest.approx(1.0),
        "before it": pytest.approx(0.0),
        "beside it": pytest.approx(1.0),
        "behind the ego": pytest.approx(1.0),
    }


def test_who_looks_out_behind_is_seen_in_part() -> None:
    found = shares(
        at(0.0, Agent("near", "a_1", 1020.0), Agent("wide", "a_1", 1060.0, d=3.0, width=2.5))
    )
    assert 0.1 < found["wide"] < 0.95


def test_pedestrians_are_hidden_and_hide_nobody() -> None:
    walker = Agent("walker", "", x=1020.0, y=0.0, length=1.0, width=4.0)
    found = shares(at(0.0, walker, Agent("car", "a_1", 1040.0)))
    assert found == pytest.approx({"walker": 1.0, "car": 1.0})
    found = shares(at(0.0, walker._replace(x=1045.0, width=1.0), Agent("car", "a_1", 1040.0)))
    assert found == pytest.approx({"walker": 0.0, "car": 1.0})


@pytest.mark.slow
def test_as_many_rays_see_it() -> None:
    rng = np.random.default_rng(5)
    compared = 0
    for _ in range(20):
        boxes: list[Box] = []
        for _ in range(80):
            box = Box(
                *rng.uniform(-35.0, 35.0, 2),
                rng.uniform(-math.pi, math.pi),
                rng.uniform(0.5, 6.0),
                rng.uniform(0.3, 1.3),
            )
            if (
                len(boxes) < 12
                and math.hypot(box.x, box.y) > 8.0
                and not any(box.polygon().intersects(b.polygon()) for b in boxes)
            ):
                boxes.append(box)
        blocks = [bool(rng.random() < 0.8) for _ in boxes]
        agents = agents_at(
            ROAD,
            *(
                Agent(
                    f"{k:02}",
                    "",
                    x=b.x,
                    y=b.y,
                    heading=b.heading,
                    length=2 * b.length,
                    width=2 * b.width,
                )
                for k, b in enumerate(boxes)
            ),
        )
        found = share_in_view(0.0, 0.0, agents, np.array(blocks))
        twin = naive_share_in_view(0.0, 0.0, boxes, blocks, 1800)
        assert found == pytest.approx(twin, abs=0.1)  # a small box is hit by some ten rays
        assert [share == 0.0 for share in found] == [share == 0.0 for share in twin] or min(
            s for s in found if s > 0.0
        ) < 0.1
        compared += sum(0.0 < share < 1.0 for share in twin)
    assert compared > 20


def test_the_hidden_are_not_seen() -> None:
    truck = Agent("truck", "a_1", 1035.0, length=12.0, width=2.5)
    seen = (
        senses(occlusion=True)
        .perceive(at(0.0, truck, Agent("car", "a_1", 1050.0), Agent("left", "a_2", 1030.0)))
        .agents
    )
    assert seen.ids == ("left", "truck")


# --- memory ---


def hidden_by_a_truck(time: float, v: float = 8.0) -> tuple[Agent, Agent]:
    """A car that a truck hides from 1 s on: the truck cuts in behind it."""
    truck = Agent(
        "truck", "a_1" if time >= 1.0 else "a_2", 1035.0 + v * time, v, length=12.0, width=2.5
    )
    return truck, Agent("car", "a_1", 1050.0 + v * time, v)


def test_a_hidden_car_is_remembered_where_it_must_be_by_now() -> None:
    sensor = senses(occlusion=True, memory_s=4.0)
    for k in range(14):
        time = k * PERIOD
        scene = at(time, *hidden_by_a_truck(time), s=1000.0 + 8.0 * time)
        seen = sensor.perceive(scene).agents
        assert ("car" in seen.ids) == (time <= 4.5), time  # seen until 0.5 s
        assert list(seen.ids) == sorted(seen.ids)
        if "car" in seen.ids:
            i, j = seen.ids.index("car"), scene.agents.ids.index("car")
            for name in ("x", "y", "heading", "v", "s", "d"):
                assert getattr(seen, name)[i] == pytest.approx(
                    getattr(scene.agents, name)[j], abs=1e-6
                ), name


def test_without_memory_it_is_forgotten_at_once() -> None:
    sensor = senses(occlusion=True, memory_s=0.0)
    seen = [
        sensor.perceive(at(time, *hidden_by_a_truck(time), s=1000.0 + 8.0 * time)).agents.ids
        for time in (0.0, 0.5, 1.0)
    ]
    assert seen == [("car", "truck"), ("car", "truck"), ("truck",)]


def test_it_is_forgotten_where_it_would_be_in_plain_view() -> None:
    """The car leaves the road behind the truck; when the truck turns away there is nobody."""
    sensor = senses(occlusion=True, memory_s=10.0)
    seen = []
    for k in range(8):
        time = k * PERIOD
        truck, car = hidden_by_a_truck(time)
        agents = [
            truck._replace(on="a_2" if time >= 3.0 else truck.on),
            *([car] if time < 2.0 else []),
        ]
        seen.append("car" in sensor.perceive(at(time, *agents, s=1000.0 + 8.0 * time)).agents.ids)
    assert seen == [True] * 6 + [False] * 2


def test_who_needs_to_be_seen_whole_is_not_missed_in_part() -> None:
    """Two thirds of the car stay in view, which is not enough to see it: no reason to take it to be
    gone."""
    sensor = senses(occlusion=True, visible_share=0.9, memory_s=10.0)
    car = Agent("car", "a_1", 1040.0, 0.0)
    alone = [sensor.perceive(at(time, car)).agents.ids for time in (0.0, 0.5)]
    assert alone == [("car",)] * 2
    post = Agent("post", "a_1", 1020.0, 0.0, d=0.3, length=0.5, width=0.3)
    assert 0.5 < shares(at(1.0, car, post))["car"] < 0.9
    assert [sensor.perceive(at(1.0 + 0.5 * k, car, post)).agents.ids for k in range(5)] == [
        ("car", "post")
    ] * 5


@pytest.mark.parametrize(("probability", "cycles"), [(1e-5, 0), (0.03, 2), (0.15, 4), (0.3, 7)])
def test_the_more_often_agents_are_dropped_the_longer_one_is_waited_for(
    probability: float, cycles: int
) -> None:
    """It is gone once so many misses in a row are unlikely: less than one in ten thousand."""
    remembered = []
    for seed in range(40):
        sensor = senses(seed=seed, drop_probability=probability, memory_s=20.0)
        there = [
            "other"
            in sensor.perceive(
                at(k * PERIOD, *([passing(k * PERIOD)] if k < 4 else []), s=1000.0)
            ).agents.ids
            for k in range(12)
        ]
        if all(there[:4]):
            remembered.append(sum(there[4:]))
    assert max(remembered) == cycles  # fewer where it was not seen in the last cycle


def test_who_drives_out_of_range_is_forgotten() -> None:
    sensor = senses(drop_probability=0.5, range_m=60.0, memory_s=60.0)
    for k in range(12):
        time = k * PERIOD
        near = 10.0 * time <= 60.0
        seen = sensor.perceive(at(time, *([passing(time)] if near else []), s=1000.0)).agents
        assert all(math.hypot(x - 997.5, y) <= 60.0 for x, y in zip(seen.x, seen.y, strict=True))


def test_the_remembered_follow_their_lane_into_the_next() -> None:
    road = straight_road()
    sensor = Sensor(
        SensorConfig(occlusion=True, drop_probability=0.5), road, PERIOD, streams(0).noise
    )
    before = scene_of(ego_at(road, "a_1", 150.0), road, Agent("car", "a_0", 197.0, 10.0))
    while "car" not in sensor.perceive(before).agents.ids:
        before = before._replace(time=before.time + PERIOD)
    after = before._replace(time=before.time + PERIOD, agents=agents_at(road))
    seen = sensor.perceive(after).agents
    assert seen.ids == ("car",)
    assert (road.lane_ids[seen.lane[0]], seen.s[0]) == (":m_0", pytest.approx(2.0))


@pytest.mark.parametrize(("blinker", "d"), [(1, 0.5), (0, 0.0)])
def test_who_had_begun_to_leave_its_lane_has_not_gone_back_when_it_is_out_of_sight(
    blinker: int, d: float
) -> None:
    before = at(0.0, Agent("other", "a_1", 1030.0, 10.0, d=0.5))
    blinking = before.agents._replace(blinker=np.array([blinker], np.int32))
    now = moved_on(ROAD, before._replace(agents=blinking), PERIOD, aside=0.6)
    assert (ROAD.lane_ids[now.lane[0]], now.s[0], now.blinker[0]) == (
        "a_1",
        pytest.approx(1035.0),
        blinker,
    )
    assert now.d[0] == pytest.approx(d, abs=0.05)
    assert matched(ROAD, now).d[0] == pytest.approx(now.d[0], abs=0.01)


# --- episodes ---


def test_the_lanes_of_sumo_are_found_again() -> None:
    """The true poses of whole episodes, matched: SUMO's own lane, position and offset."""
    for name in ("unprotected-left-turn", "highway-exit"):
        loop = Loop(config.load(builtin.scenario_path(name), ("planner.name=sumo",)), 3)
        from sumo_mcts.driver.driver import Driver

        driver = Driver(loop.config, loop.world.road, loop.world.physics, 0)
        compared = 0
        while scenes := loop.scenes():
            truth = scenes["ego"].agents
            found = matched(loop.world.road, truth)
            same = found.lane == truth.lane
            assert np.abs(found.s - truth.s)[same] == pytest.approx(np.zeros(same.sum()), abs=0.1)
            assert np.abs(found.d - truth.d)[same] == pytest.approx(np.zeros(same.sum()), abs=0.1)
            assert np.abs(truth.d[~same]) == pytest.approx(
                np.full((~same).sum(), 1.6), abs=0.2
            )  # half-way through a change
            compared += len(same)
            loop.apply({"ego": driver.decide(scenes["ego"]).decision})
        loop.close()
        assert compared > 100


def test_the_referee_is_told_the_truth() -> None:
    loop = Loop(config.load(builtin.scenario_path("highway-exit"), NOISY), 2)
    try:
        scene, pilot = loop.scenes()["ego"], loop._egos[0].vehicle
        assert pilot is not None
        frame = pilot.look()
        true = dict(zip(frame.agents.ids, frame.agents.x.tolist(), strict=True))
        wrong = [
            x - true[name]
            for name, x in zip(scene.agents.ids, scene.agents.x.tolist(), strict=True)
        ]
        assert min(map(abs, wrong)) > 1e-6
        vehicles = import_libsumo().vehicle
        half = {
            name: 0.5 * vehicles.getLength(name) * math.sin(math.radians(vehicles.getAngle(name)))
            for name in true
        }
        assert true == pytest.approx(
            {name: vehicles.getPosition(name)[0] - half[name] for name in true}, abs=1e-9
        )
        assert scene.ego == frame.ego
    finally:
        loop.close()


@pytest.mark.slow
def test_an_episode_with_noise_and_its_digest() -> None:
    scene = config.load(
        builtin.scenario_path("unprotected-left-turn"), ("planner.iterations=300", *NOISY)
    )
    first, again = (run_episode(scene, 5).rows[0] for _ in range(2))
    assert first["outcome"] == "arrived"
    assert first["trace_digest"] == again["trace_digest"]
    quiet = run_episode(
        config.load(builtin.scenario_path("unprotected-left-turn"), ("planner.iterations=300",)), 5
    ).rows[0]
    assert quiet["trace_digest"] != first["trace_digest"]


def test_every_planner_is_shown_the_same_errors() -> None:
    def errors_at_the_start(planner: str) -> list[float]:
        trace = run_episode(
            config.load(
                builtin.scenario_path("straight-line"),
                (f"planner.name={planner}", "episode.stop_time_s=1", *NOISY),
            ),
            1,
        ).traces[0]
        return [float(x) for x in trace.cycles[0].agents.x]

    assert errors_at_the_start("mcts") == errors_at_the_start("sumo")


def test_an_oracle_of_routes_can_be_asked_about_somebody_who_has_left() -> None:
    """Remembered agents may be gone in truth."""
    sets = (
        "prediction.name=routes",
        "planner.iterations=50",
        "sensor.drop_probability=0.6",
        "sensor.memory_s=30",
    )
    result = run_episode(config.load(builtin.scenario_path("unprotected-left-turn"), sets), 1)
    assert result.rows[0]["outcome"] != "error", result.rows[0]["error"]


def test_the_defaults_are_a_perfect_sensor() -> None:
    sensor = scenario().sensor
    assert (
        sensor.position_error_m,
        sensor.speed_error_mps,
        sensor.drop_probability,
        sensor.occlusion,
    ) == (0.0, 0.0, 0.0, False)
