"""The crowd and the kinds of drivers: what a seed draws, and that SUMO has it on the road so."""

from collections import Counter
from itertools import combinations
from pathlib import Path

import libsumo
import numpy as np
import pytest

from sumo_mcts.config import ScenarioConfig, load
from sumo_mcts.config.builtin import scenario_path
from sumo_mcts.world.actors import draw
from sumo_mcts.world.crowd import Cast, cast, write_routes
from sumo_mcts.world.roadmap import known_roadmap

SCENES = ["unprotected-left-turn-varied", "highway-exit-varied", "straight-line-varied"]


def scenario(name: str, *sets: str) -> ScenarioConfig:
    return load(scenario_path(name), sets)


def drawn(config: ScenarioConfig, seed: int) -> Cast:
    return cast(
        config.traffic, ["ego"], known_roadmap(str(config.sumo.net)), np.random.default_rng(seed)
    )


@pytest.mark.parametrize("name", SCENES)
def test_a_seed_draws_the_same_again_and_another_one_something_else(name: str) -> None:
    first, again, other = (drawn(scenario(name), seed) for seed in (1, 1, 2))
    assert first == again
    assert first.actors != other.actors and first.types != other.types


@pytest.mark.parametrize("name", SCENES)
def test_the_actors_are_the_same_with_and_without_a_crowd(name: str) -> None:
    config = scenario(name, "traffic.drivers={ordinary: 0, aggressive: 0, inattentive: 0}")
    assert drawn(config, 3).actors[: len(config.traffic.actors)] == draw(
        config.traffic, np.random.default_rng(3)
    )
    assert [a.depart.pos_m for a in drawn(scenario(name), 3).actors] == [
        a.depart.pos_m for a in drawn(config, 3).actors
    ]


@pytest.mark.parametrize("name", SCENES)
def test_every_number_in_the_range_is_drawn_and_everybody_keeps_to_a_stream(name: str) -> None:
    config = scenario(name, "traffic.drivers={ordinary: 0, aggressive: 0, inattentive: 0}")
    traffic = config.traffic
    crowds = [drawn(config, seed).actors[len(traffic.actors) :] for seed in range(200)]
    assert {len(crowd) for crowd in crowds} == set(range(16))
    for member in (member for crowd in crowds for member in crowd):
        depart = member.depart
        streams = [
            s for s in traffic.crowd.streams if s.route == member.route and depart.lane in s.lanes
        ]
        assert any(s.speed_mps[0] <= depart.speed_mps <= s.speed_mps[1] for s in streams)
        if depart.time_s == 0.0:
            assert any(s.pos_m[0] <= depart.pos_m <= s.pos_m[1] for s in streams)
        else:
            assert depart.pos_m == 0.0 and depart.time_s <= traffic.crowd.within_s


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_nobody_of_the_crowd_starts_on_top_of_another(name: str) -> None:
    for seed in range(100):
        there = [a for a in drawn(scenario(name), seed).actors if a.depart.time_s == 0.0]
        for one, other in combinations(there, 2):
            if "crowd" in other.id and (one.route[0], one.depart.lane) == (
                other.route[0],
                other.depart.lane,
            ):
                assert abs(one.depart.pos_m - other.depart.pos_m) > 10.0


def test_kinds_of_drivers_follow_their_shares_and_egos_and_scripts_keep_their_types() -> None:
    config = scenario("straight-line-varied")
    types = [kind for seed in range(150) for kind in drawn(config, seed).types.values()]
    kinds = Counter(
        "aggressive"
        if "lcAssertive" in t
        else "inattentive"
        if "jmIgnoreFoeProb" in t
        else "ordinary"
        for t in types
    )
    assert np.array([kinds[k] for k in ("ordinary", "aggressive", "inattentive")]) / len(
        types
    ) == pytest.approx((0.5, 0.3, 0.2), abs=0.05)
    assert "ego" not in drawn(config, 0).types
    scripted = scenario("straight-line-scripted", "traffic.drivers.ordinary=1")
    assert drawn(scripted, 0).types == {}


def test_nobody_enters_faster_than_its_driver_goes_there() -> None:
    config = scenario("unprotected-left-turn-varied", "traffic.drivers={inattentive: 1}")
    for seed in range(30):
        who = drawn(config, seed)
        assert all(
            a.depart.speed_mps <= 13.9 * float(who.types[a.id]["speedFactor"]) + 1e-9
            for a in who.actors
            if a.id != "ego"
        )


@pytest.mark.parametrize("name", SCENES)
def test_sumo_has_everybody_with_the_driver_that_was_drawn(name: str, tmp_path: Path) -> None:
    config = scenario(name, "traffic.crowd.count=[15, 15]")
    who = drawn(config, 5)
    files = ",".join([*config.sumo.routes, str(write_routes(who, tmp_path))])
    libsumo.start(
        [
            "sumo",
            "-n",
            str(config.sumo.net),
            "-r",
            files,
            "--step-length",
            "0.1",
            "--no-step-log",
            "--no-warnings",
        ]
    )
    met = set()
    try:
        for _ in range(900):
            libsumo.simulationStep()
            for vehicle in libsumo.simulation.getDepartedIDList():
                met.add(vehicle)
                actor = next(a for a in who.actors if a.id == vehicle)
                assert libsumo.vehicle.getRoute(vehicle) == actor.route
                if actor.depart.time_s == 0.0:
                    assert libsumo.vehicle.getLanePosition(vehicle) == pytest.approx(
                        actor.depart.pos_m, abs=0.01
                    )
                if vehicle in who.types:
                    own = {
                        "tau": libsumo.vehicle.getTau(vehicle),
                        "sigma": libsumo.vehicle.getImperfection(vehicle),
                    }
                    assert own == pytest.approx(
                        {key: float(who.types[vehicle][key]) for key in own}
                    )
    finally:
        libsumo.close()
    assert met == {actor.id for actor in who.actors}
