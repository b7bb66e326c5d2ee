"""Scripts against what SUMO executes, drawn scenes, and events that vehicles driven by SUMO are
told."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import libsumo
import numpy as np
import pytest
from helpers_networks import simulation

from sumo_mcts.config import Actor, TrafficConfig, VehicleEvent, load
from sumo_mcts.config.builtin import root, scenario_names, scenario_path
from sumo_mcts.errors import ConfigError
from sumo_mcts.road import RoadMap
from sumo_mcts.world.actors import Actors, appears, draw
from sumo_mcts.world.crowd import Cast, write_routes
from sumo_mcts.world.roadmap import read_roadmap
from sumo_mcts.world.scripts import compile_script

SCENES = ["unprotected-left-turn", "highway-exit", "straight-line"]
NETWORKS = root() / "networks"


@pytest.fixture(scope="module")
def crossing() -> RoadMap:
    return read_roadmap(str(NETWORKS / "crossing" / "crossing.net.xml"))


def actor(route: Sequence[str] = ("from_west", "to_east"), **keys: Any) -> Actor:
    given = {
        "id": "a",
        "route": tuple(route),
        "driver": "script",
        "depart": {"lane": 1, "pos_m": 50.0, "speed_mps": 8.0},
    }
    return Actor.model_validate({**given, **keys})


def compare(actors: Actors, road: RoadMap, step: float, seconds: float) -> int:
    """Step and hold every scripted vehicle against its script; returns how many rows were compared."""
    compared = 0
    for _ in range(round(seconds / step)):
        actors.before_step(libsumo.simulation.getTime())
        libsumo.simulationStep()
        now = libsumo.simulation.getTime()
        for vehicle in libsumo.vehicle.getIDList():
            script, departed = actors.script_of(vehicle), actors.departure(vehicle)
            if script is None or departed is None:
                continue
            row = round((now - departed) / step)
            assert road.lane_ids[script.lane[row]] == libsumo.vehicle.getLaneID(vehicle), (
                vehicle,
                now,
            )
            assert script.s[row] == pytest.approx(
                libsumo.vehicle.getLanePosition(vehicle), abs=0.01
            )
            assert script.v[row] == pytest.approx(libsumo.vehicle.getSpeed(vehicle), abs=1e-6)
            assert script.d[row] == pytest.approx(
                libsumo.vehicle.getLateralLanePosition(vehicle), abs=0.01
            )
            compared += 1
    return compared


# --- scripts ---


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", [n for n in scenario_names() if n.endswith("-scripted")])
def test_sumo_executes_the_scripts_of_the_built_in_scenes(
    name: str, seed: int, tmp_path: Path
) -> None:
    config = load(scenario_path(name))
    road = read_roadmap(str(config.sumo.net))
    drawn = draw(config.traffic, np.random.default_rng(seed))
    with simulation(
        str(config.sumo.net),
        [*config.sumo.routes, write_routes(Cast(tuple(drawn)), tmp_path)],
        seed=seed,
    ):
        assert compare(Actors(drawn, road, 0.1), road, 0.1, 10.0) == (len(drawn) - 1) * 100


EVENTFUL = [
    {"at_m": 12.0, "slow_to_mps": 4.0, "accel_mps2": 1.7},
    {"at_s": 3.33, "change_lane": "left"},
    {"at_s": 3.5, "change_lane": "right"},  # has to wait for the other
    {"at_s": 8.0, "stop_for_s": 2.0, "accel_mps2": 3.0},
    {"at_s": 15.0, "slow_to_mps": 12.0, "accel_mps2": 2.0},
]


@pytest.mark.parametrize(
    ("step", "change_s"), [(0.1, 3.0), (0.1, 2.0), (0.2, 3.0), (0.5, 3.0), (1.0, 2.0), (0.1, 0.0)]
)
def test_sumo_executes_a_script_with_every_kind_of_event(
    step: float, change_s: float, crossing: RoadMap, tmp_path: Path
) -> None:
    eventful = actor(
        events=EVENTFUL,
        depart={"time_s": 0.25, "lane": 1, "pos_m": 20.123456789, "speed_mps": 9.876},
    )
    net = str(NETWORKS / "crossing" / "crossing.net.xml")
    with simulation(net, [write_routes(Cast((eventful,)), tmp_path)], step, change_s):
        actors = Actors([eventful], crossing, step, change_s=change_s)
        assert compare(actors, crossing, step, 60.0) == len(actors.script_of("a").v)  # type: ignore[union-attr]  # it has one


def test_a_script_leaves_the_map_where_sumo_takes_the_vehicle_out(
    crossing: RoadMap, tmp_path: Path
) -> None:
    leaving = [
        actor(id=f"a{i}", depart={"lane": i, "pos_m": 80.0 + i / 7, "speed_mps": 11.0 + i / 3})
        for i in range(3)
    ]
    with simulation(
        str(NETWORKS / "crossing" / "crossing.net.xml"),
        [write_routes(Cast(tuple(leaving)), tmp_path)],
    ):
        actors = Actors(leaving, crossing, 0.1)
        rows = [len(actors.script_of(vehicle.id).v) for vehicle in leaving]  # type: ignore[union-attr]  # it has one
        assert compare(actors, crossing, 0.1, 40.0) == sum(rows)
        assert not libsumo.vehicle.getIDList()


@pytest.mark.parametrize("begin", [70.0, 83.0, 90.0])
def test_sumo_executes_a_lane_change_that_ends_in_the_junction(
    begin: float, crossing: RoadMap, tmp_path: Path
) -> None:
    turning = actor(
        ["from_west", "to_north"],
        events=[{"at_m": begin, "change_lane": "left"}],
        depart={"lane": 1, "pos_m": 40.0, "speed_mps": 7.0},
    )
    with simulation(
        str(NETWORKS / "crossing" / "crossing.net.xml"), [write_routes(Cast((turning,)), tmp_path)]
    ):
        assert compare(Actors([turning], crossing, 0.1), crossing, 0.1, 25.0) == 250


def test_a_left_turn_leads_over_both_of_its_internal_lanes(crossing: RoadMap) -> None:
    script = compile_script(
        actor(["from_south", "to_west"], depart={"lane": 2, "pos_m": 120.0, "speed_mps": 10.0}),
        crossing,
        0.1,
        20.0,
    )
    inside = list(
        dict.fromkeys(crossing.lane_ids[lane] for lane in script.lane if crossing.internal[lane])
    )
    assert len(inside) == 2
    assert crossing.lane_ids[script.lane[-1]] == "to_west_2"


def test_a_stop_stands_and_goes_on_at_the_speed_before(crossing: RoadMap) -> None:
    script = compile_script(
        actor(events=[{"at_s": 1.0, "stop_for_s": 3.0, "accel_mps2": 4.0}]), crossing, 0.1, 10.0
    )
    assert np.sum(script.v == 0.0) == pytest.approx(30, abs=1)
    assert script.v[0] == script.v[-1] == 8.0
    assert np.all(np.abs(np.diff(script.v)) <= 0.4 + 1e-9)


def test_the_script_ends_with_the_time_asked_for(crossing: RoadMap) -> None:
    assert len(compile_script(actor(depart={"speed_mps": 0.0}), crossing, 0.1, 5.0).v) == 51


def test_a_lane_change_inside_the_junction_waits_for_its_end(crossing: RoadMap) -> None:
    script = compile_script(
        actor(
            events=[{"at_m": 100.0, "change_lane": "left"}],
            depart={"lane": 1, "pos_m": 50.0, "speed_mps": 10.0},
        ),
        crossing,
        0.1,
        20.0,
    )
    (begin,) = np.flatnonzero(script.change)
    assert crossing.lane_ids[script.lane[begin]] == "to_east_1"
    assert crossing.lane_ids[script.lane[-1]] == "to_east_2"


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"route": ("from_west", "nowhere")}, "no edge nowhere"),
        ({"depart": {"lane": 3}}, "lanes 0 to 2, got 3"),
        ({"depart": {"pos_m": 146.0}}, "145.5 m long, got 146"),
        ({"depart": {"speed_mps": 15.0}}, "limit on from_west_0 is 13.9 m/s, got 15"),
        ({"route": ("from_west", "to_north")}, "from_west_1 does not lead to to_north"),
        (
            {"events": [{"at_s": 0, "change_lane": "left"}, {"at_s": 1, "change_lane": "left"}]},
            "no lane left of from_west_2",
        ),
    ],
)
def test_what_cannot_be_driven_is_refused(
    keys: dict[str, Any], says: str, crossing: RoadMap
) -> None:
    with pytest.raises(ConfigError, match=r"traffic\.actors: a: ") as error:
        compile_script(actor(**keys), crossing, 0.1, 30.0)
    assert says in str(error.value)


# --- departures ---


@pytest.mark.parametrize(
    ("due", "step", "there"),
    [(0.0, 0.1, 0.1), (0.25, 0.1, 0.4), (0.3, 0.1, 0.4), (2.0, 0.5, 2.5), (0.7, 1.0, 2.0)],
)
def test_when_a_vehicle_is_there(
    due: float, step: float, there: float, crossing: RoadMap, tmp_path: Path
) -> None:
    late = actor(depart={"time_s": due, "lane": 1, "pos_m": 50.0, "speed_mps": 8.0})
    actors = Actors([late], crossing, step)
    assert appears(due, step) == pytest.approx(there)
    assert actors.departure("a") == pytest.approx(there)
    assert actors.departure("unknown") is None
    with simulation(
        str(NETWORKS / "crossing" / "crossing.net.xml"),
        [write_routes(Cast((late,)), tmp_path)],
        step,
    ):
        while not libsumo.vehicle.getIDList():
            actors.before_step(libsumo.simulation.getTime())
            libsumo.simulationStep()
        assert libsumo.simulation.getTime() == pytest.approx(there)
        assert libsumo.vehicle.getLanePosition("a") == 50.0
        actors.before_step(libsumo.simulation.getTime())
        assert actors.departure("a") == pytest.approx(there)


def test_the_route_file_is_in_the_order_of_departure_and_exact(tmp_path: Path) -> None:
    later = actor(id="b<", depart={"time_s": 3.0, "pos_m": 1 / 3})
    vehicles = (
        ET.parse(
            write_routes(
                Cast(
                    (
                        later,
                        actor(),
                    )
                ),
                tmp_path,
            )
        )
        .getroot()
        .findall("vehicle")
    )
    assert [vehicle.get("id") for vehicle in vehicles] == ["a", "b<"]
    assert float(vehicles[1].get("departPos", "")) == 1 / 3


def test_everybody_appears_whoever_stands_there(crossing: RoadMap, tmp_path: Path) -> None:
    crowd = [
        actor(
            id=f"a{i}",
            driver="sumo",
            depart={"lane": 1, "pos_m": 50.0 + i, "speed_mps": 5.0 * (i % 2)},
        )
        for i in range(6)
    ]
    with simulation(
        str(NETWORKS / "crossing" / "crossing.net.xml"),
        [write_routes(Cast(tuple(crowd)), tmp_path)],
    ):
        libsumo.simulationStep()
        assert len(libsumo.vehicle.getIDList()) == 6


def test_the_ego_is_left_alone(crossing: RoadMap, tmp_path: Path) -> None:
    ego = actor(id="ego", events=[{"at_s": 0.0, "slow_to_mps": 0.0}])
    with simulation(
        str(NETWORKS / "crossing" / "crossing.net.xml"), [write_routes(Cast((ego,)), tmp_path)]
    ):
        actors = Actors([ego], crossing, 0.1)
        compare(actors, crossing, 0.1, 3.0)
        assert actors.script_of("ego") is None
        assert libsumo.vehicle.getSpeed("ego") > 8.0
        assert libsumo.vehicle.getSpeedMode("ego") == 31


# --- drawing ---


@pytest.mark.parametrize("name", SCENES + [f"{scene}-scripted" for scene in SCENES])
def test_scenes_differ_by_seed_and_are_the_same_for_the_same(name: str) -> None:
    traffic = load(scenario_path(name)).traffic
    first, again, other = (draw(traffic, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert first == again
    assert all(a.depart != b.depart for a, b in zip(first, other, strict=True))
    for written, drawn in zip(traffic.actors, first, strict=True):
        assert abs(drawn.depart.pos_m - written.depart.pos_m) <= written.vary.pos_m
        assert abs(drawn.depart.speed_mps - written.depart.speed_mps) <= written.vary.speed_mps
        for event, drawn_event in zip(written.events, drawn.events, strict=True):
            assert abs((drawn_event.at_s or 0.0) - (event.at_s or 0.0)) <= written.vary.time_s


@pytest.mark.parametrize("name", SCENES + [f"{scene}-scripted" for scene in SCENES])
def test_without_variation_it_is_the_written_scene(name: str) -> None:
    traffic = load(scenario_path(name), ("traffic.vary=0",)).traffic
    assert draw(traffic, np.random.default_rng(5)) == traffic.actors


def test_what_one_actor_may_vary_does_not_change_the_others() -> None:
    free, fixed = actor(vary={"pos_m": 5.0}), actor()
    last = actor(id="b", vary={"pos_m": 3.0, "speed_mps": 1.0})
    drawn = [
        draw(TrafficConfig(actors=(first, last)), np.random.default_rng(3))[1]
        for first in (free, fixed)
    ]
    assert drawn[0] == drawn[1]


def test_nothing_drawn_is_negative_and_a_stop_stays_a_stop() -> None:
    events = [{"at_s": 0.1, "slow_to_mps": 0.0}, {"at_s": 0.2, "slow_to_mps": 0.3}]
    wild = actor(
        depart={"time_s": 0.1, "pos_m": 0.1, "speed_mps": 0.1},
        events=events,
        vary={"pos_m": 9.0, "speed_mps": 9.0, "time_s": 9.0},
    )
    for seed in range(20):
        (drawn,) = draw(TrafficConfig(actors=(wild,)), np.random.default_rng(seed))
        assert (
            min(
                drawn.depart.time_s,
                drawn.depart.pos_m,
                drawn.depart.speed_mps,
                *(event.at_s or 0.0 for event in drawn.events),
            )
            >= 0.0
        )
        assert drawn.events[0].slow_to_mps == 0.0


def test_who_is_there_from_the_start_stays() -> None:
    (drawn,) = draw(TrafficConfig(actors=(actor(vary={"time_s": 5.0}),)), np.random.default_rng(1))
    assert drawn.depart.time_s == 0.0


# --- events of vehicles that SUMO drives ---


def follow(actors: Actors, seconds: float, vehicle: str = "a") -> list[tuple[float, str, float]]:
    """Time, lane and speed of a vehicle after each step of 0.1 s."""
    states = []
    for _ in range(round(seconds * 10)):
        actors.before_step(libsumo.simulation.getTime())
        libsumo.simulationStep()
        if vehicle in libsumo.vehicle.getIDList():
            states.append(
                (
                    libsumo.simulation.getTime(),
                    libsumo.vehicle.getLaneID(vehicle),
                    libsumo.vehicle.getSpeed(vehicle),
                )
            )
    return states


def test_a_driver_slows_and_keeps_that_speed(crossing: RoadMap, tmp_path: Path) -> None:
    told = actor(driver="sumo", events=[{"at_s": 2.0, "slow_to_mps": 4.0, "accel_mps2": 2.0}])
    with simulation(
        str(NETWORKS / "crossing" / "crossing.net.xml"), [write_routes(Cast((told,)), tmp_path)]
    ):
        states = follow(Actors([told], crossing, 0.1), 12.0)
    speeds = np.array([v for _, _, v in states])
    assert speeds[18] > 8.0
    assert np.all(np.diff(speeds[22:50]) >= -0.2 - 1e-9)
    assert np.all(np.abs(speeds[80:] - 4.0) < 1e-6)


def test_a_driver_stops_and_then_decides_again(crossing: RoadMap, tmp_path: Path) -> None:
    told = actor(driver="sumo", events=[{"at_m": 10.0, "stop_for_s": 3.0}])
    with simulation(
        str(NETWORKS / "crossing" / "crossing.net.xml"), [write_routes(Cast((told,)), tmp_path)]
    ):
        speeds = np.array([v for _, _, v in follow(Actors([told], crossing, 0.1), 14.0)])
    assert np.sum(speeds == 0.0) == pytest.approx(30, abs=2)
    assert speeds[-1] > 8.0


def test_a_driver_still_keeps_its_distance(crossing: RoadMap, tmp_path: Path) -> None:
    blocked = actor(driver="sumo", events=[{"at_s": 0.5, "slow_to_mps": 12.0}])
    standing = actor(id="b", depart={"lane": 1, "pos_m": 110.0, "speed_mps": 0.0})
    with simulation(
        str(NETWORKS / "crossing" / "crossing.net.xml"),
        [
            write_routes(
                Cast(
                    (
                        blocked,
                        standing,
                    )
                ),
                tmp_path,
            )
        ],
    ):
        states = follow(Actors([blocked, standing], crossing, 0.1), 20.0)
        assert not libsumo.simulation.getCollisions()
    if states[-1][1] == "from_west_1":
        assert states[-1][2] < 0.5


def test_a_driver_changes_lanes(crossing: RoadMap, tmp_path: Path) -> None:
    told = actor(
        driver="sumo",
        max_speed_mps=8.0,
        events=[{"at_s": 1.0, "change_lane": "left"}],
        depart={"lane": 0, "pos_m": 20.0, "speed_mps": 8.0},
    )
    with simulation(
        str(NETWORKS / "crossing" / "crossing.net.xml"), [write_routes(Cast((told,)), tmp_path)]
    ):
        states = follow(Actors([told], crossing, 0.1), 5.0)
    assert states[5][1] == "from_west_0"
    assert states[-1][1] == "from_west_1"
    assert max(v for _, _, v in states) <= 8.0 + 1e-9


def test_vehicles_of_the_route_files_have_events_too(crossing: RoadMap, tmp_path: Path) -> None:
    event = VehicleEvent(vehicle="a", at_s=2.0, slow_to_mps=3.0)
    with simulation(
        str(NETWORKS / "crossing" / "crossing.net.xml"),
        [write_routes(Cast((actor(driver="sumo"),)), tmp_path)],
    ):
        actors = Actors([], crossing, 0.1, events=[event])
        assert actors.departure("a") is None
        states = follow(actors, 8.0)
        assert actors.departure("a") == pytest.approx(0.1)
    assert states[-1][2] == pytest.approx(3.0)
