"""A scene is worth counting only if an ego that keeps its start speed blindly fails in it:

`python -m pytest tests/world/test_hardness.py -s` prints how often.

Three ways for each scene: with the lane change that its route needs at once, as late as it fits,
and, for comparison, driven by SUMO. A seed is hard if the ego collides or, in reactive scenes,
somebody brakes beyond 4 m/s2 because of it. Whose fault a braking is, is told more roughly than the
referee does: SUMO names the ego as the leader, or it is right in front on a junction or changing
lanes.
"""

import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import libsumo
import numpy as np
import pytest

from sumo_mcts.config import ScenarioConfig, load
from sumo_mcts.config.builtin import scenario_path
from sumo_mcts.world.actors import Actors, draw
from sumo_mcts.world.crowd import Cast, write_routes
from sumo_mcts.world.roadmap import read_roadmap

SEEDS = 30
SHARE = 0.3  # of the seeds that have to be hard
STEP = 0.1  # s
LIMIT_S = 40.0  # s, of scenes without a stop time
HARD_BRAKE = 4.0  # m/s2
SCENES = ["unprotected-left-turn", "highway-exit", "straight-line"]


class Outcome(NamedTuple):
    """What an ego did with one seed."""

    collided: str  # with whom, "" nobody
    imposed: float  # m/s2, strongest braking imposed
    others: str  # a collision without the ego: the scene itself is broken
    time: float  # s, end of the episode


@pytest.mark.slow
@pytest.mark.parametrize("way", ["early", "late"])
@pytest.mark.parametrize("name", [scene + kind for scene in SCENES for kind in ("", "-scripted")])
def test_a_blind_ego_fails(name: str, way: str) -> None:
    outcomes = [run(name, seed, way) for seed in range(SEEDS)]
    tell(name, way, outcomes)
    assert sum(is_hard(name, outcome) for outcome in outcomes) >= SHARE * SEEDS
    assert not any(outcome.others for outcome in outcomes)


@pytest.mark.parametrize("way", ["early", "late"])
@pytest.mark.parametrize("scene", SCENES)
def test_a_blind_ego_collides_in_the_fixed_scene(scene: str, way: str) -> None:
    assert run(f"{scene}-scripted", 0, way, vary=0.0).collided


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_sumo_gets_through_the_reactive_scene(name: str) -> None:
    outcomes = [run(name, seed, "twin") for seed in range(SEEDS)]
    tell(name, "twin", outcomes)
    assert not any(outcome.collided or outcome.others for outcome in outcomes)
    assert max(outcome.time for outcome in outcomes) < LIMIT_S - STEP


def tell(name: str, way: str, outcomes: Sequence[Outcome]) -> None:
    """One line with the counts."""
    hard, braking = (
        sum(is_hard(name, outcome) for outcome in outcomes),
        np.array([outcome.imposed for outcome in outcomes]),
    )
    whom = dict(Counter(outcome.collided for outcome in outcomes if outcome.collided))
    counts = (
        f"hard {hard}/{len(outcomes)}, collisions {whom}, imposed braking beyond 4 m/s2 "
        f"{np.sum(braking > HARD_BRAKE)}"
    )
    sys.stdout.write(
        f"\n{name} {way}: {counts}, ends at "
        f"{np.median([outcome.time for outcome in outcomes]):.0f} s\n"
    )


def is_hard(name: str, outcome: Outcome) -> bool:
    """The definition of measures.md."""
    return bool(outcome.collided) or (
        not name.endswith("-scripted") and outcome.imposed > HARD_BRAKE
    )


def run(name: str, seed: int, way: str, vary: float = 1.0) -> Outcome:
    """One episode of a blind ego, or of its twin that SUMO drives."""
    config = load(scenario_path(name), (f"traffic.vary={vary}",))
    road = read_roadmap(str(config.sumo.net))
    actors = draw(config.traffic, np.random.default_rng(seed))
    with tempfile.TemporaryDirectory() as folder:
        libsumo.start(arguments(config, write_routes(Cast(actors), Path(folder)), seed))
        try:
            return _drive(
                Actors(actors, road, STEP),
                config.episode.stop_time_s or LIMIT_S,
                config.episode.success_edge,
                way,
            )
        finally:
            libsumo.close()


def arguments(config: ScenarioConfig, routes: Path, seed: int) -> list[str]:
    """SUMO's command line for a scenario."""
    files = [
        "-n",
        str(config.sumo.net),
        "-r",
        ",".join([*config.sumo.routes, str(routes)]),
        "--step-length",
        str(STEP),
        "--seed",
        str(seed),
    ]
    referee = [
        "--collision.action",
        "warn",
        "--collision.check-junctions",
        "true",
        "--collision.mingap-factor",
        "0",
    ]
    options = [
        text for key, value in config.sumo.options.items() for text in (f"--{key}", str(value))
    ]
    return ["sumo", *files, *referee, *options, "--no-step-log", "true", "--no-warnings", "true"]


def _drive(actors: Actors, limit: float, success_edge: str | None, way: str) -> Outcome:
    libsumo.simulationStep()
    if way != "twin":
        libsumo.vehicle.setSpeedMode("ego", 0)
        libsumo.vehicle.setLaneChangeMode("ego", 0)
    speed, imposed, collided, others = libsumo.vehicle.getSpeed("ego"), 0.0, "", ""
    while (
        libsumo.simulation.getTime() < limit
        and "ego" in libsumo.vehicle.getIDList()
        and not collided
    ):
        if libsumo.vehicle.getRoadID("ego") == success_edge:
            break
        actors.before_step(libsumo.simulation.getTime())
        if way != "twin":
            libsumo.vehicle.setSpeed("ego", speed)
            _change_lane_for_the_route(speed, way == "late")
        libsumo.simulationStep()
        for collision in libsumo.simulation.getCollisions():
            pair = {collision.collider, collision.victim}
            collided = " ".join(pair - {"ego"}) if "ego" in pair else collided
            others = others if "ego" in pair else " ".join(sorted(pair))
        imposed = max(
            [
                imposed,
                *(
                    -libsumo.vehicle.getAcceleration(i)
                    for i in libsumo.vehicle.getIDList()
                    if i != "ego" and _because_of_ego(i)
                ),
            ]
        )
    return Outcome(collided, imposed, others, libsumo.simulation.getTime())


def _change_lane_for_the_route(speed: float, late: bool) -> None:
    """One lane nearer to the route, at the start or when no more than a lane change's way and 10 m
    are left."""
    offset = next(
        (
            lane[3]
            for lane in libsumo.vehicle.getBestLanes("ego")
            if lane[0] == libsumo.vehicle.getLaneID("ego")
        ),
        0,
    )
    if offset == 0 or libsumo.vehicle.getRoadID("ego").startswith(":"):
        return
    left = libsumo.lane.getLength(
        libsumo.vehicle.getLaneID("ego")
    ) - libsumo.vehicle.getLanePosition("ego")
    if not late or left < 3.0 * speed + 10.0:
        libsumo.vehicle.changeLane(
            "ego", libsumo.vehicle.getLaneIndex("ego") + (1 if offset > 0 else -1), 0.0
        )


def _because_of_ego(vehicle: str) -> bool:
    if "ego" not in libsumo.vehicle.getIDList():
        return False
    leader = libsumo.vehicle.getLeader(vehicle, 60.0)
    if leader and leader[0] == "ego":
        return True
    own, ego = (
        np.array(libsumo.vehicle.getPosition(vehicle)),
        np.array(libsumo.vehicle.getPosition("ego")),
    )
    heading = np.deg2rad(90.0 - libsumo.vehicle.getAngle(vehicle))
    along, aside = (
        float((ego - own) @ [np.cos(heading), np.sin(heading)]),
        float((ego - own) @ [-np.sin(heading), np.cos(heading)]),
    )
    crossing = libsumo.vehicle.getRoadID("ego").startswith(":")
    changing = abs(libsumo.vehicle.getLateralLanePosition("ego")) > 0.05 and abs(aside) < 4.0
    return 0.0 < along < 25.0 and (crossing or changing)
