"""How hard the built-in scenes are for an ego that keeps its start speed blindly: python -m tests.world.hardness [SEEDS [SCENARIO]...].

Twice for each scene: with the lane change that its route needs at once, and as late as it fits. A seed is hard if the ego collides or, in
reactive scenes, somebody brakes beyond 4 m/s2 because of it. Attribution is rougher than the referee's: SUMO's leader, or the ego right in front on a junction or changing lanes.
"""

import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import libsumo  # type: ignore[import-untyped]
import numpy as np

from sumo_mcts.assets import scenario_path
from sumo_mcts.config import ScenarioConfig, load
from sumo_mcts.world.actors import Actors, draw, write_routes
from sumo_mcts.world.roadmap import read_roadmap

STEP = 0.1  # s
LIMIT_S = 40.0  # s, of scenes without a stop time
HARD_BRAKE = 4.0  # m/s2
SCENES = ("unprotected-left-turn", "highway-exit", "straight-line")


class Seed(NamedTuple):
    """What an ego did with one seed."""

    collided: str  # with whom, "" nobody
    imposed: float  # m/s2, strongest braking imposed
    others: str  # a collision without the ego: the scene itself is broken
    time: float  # s, end of the episode


def arguments(config: ScenarioConfig, routes: Path, seed: int) -> list[str]:
    """SUMO's command line for a scenario."""
    files = ["-n", str(config.sumo.net), "-r", ",".join([*config.sumo.routes, str(routes)]), "--step-length", str(STEP), "--seed", str(seed)]
    referee = ["--collision.action", "warn", "--collision.check-junctions", "true", "--collision.mingap-factor", "0"]
    options = [text for key, value in config.sumo.options.items() for text in (f"--{key}", str(value))]
    return ["sumo", *files, *referee, *options, "--no-step-log", "true", "--no-warnings", "true"]


def run(name: str, seed: int, late: bool, vary: float = 1.0, twin: bool = False) -> Seed:
    """One episode of a blind ego, or of its twin that SUMO drives."""
    config = load(scenario_path(name), (f"traffic.vary={vary}",))
    road = read_roadmap(str(config.sumo.net))
    actors = draw(config.traffic, np.random.default_rng(seed))
    with tempfile.TemporaryDirectory() as folder:
        libsumo.start(arguments(config, write_routes(actors, Path(folder)), seed))
        try:
            return _drive(Actors(actors, road, STEP), config.episode.stop_time_s or LIMIT_S, config.episode.success_edge, late, twin)
        finally:
            libsumo.close()


def _drive(actors: Actors, limit: float, success_edge: str | None, late: bool, twin: bool) -> Seed:
    libsumo.simulationStep()
    if not twin:
        libsumo.vehicle.setSpeedMode("ego", 0)
        libsumo.vehicle.setLaneChangeMode("ego", 0)
    speed, imposed, collided, others = libsumo.vehicle.getSpeed("ego"), 0.0, "", ""
    while libsumo.simulation.getTime() < limit and "ego" in libsumo.vehicle.getIDList() and not collided:
        if libsumo.vehicle.getRoadID("ego") == success_edge:
            break
        actors.before_step(libsumo.simulation.getTime())
        if not twin:
            libsumo.vehicle.setSpeed("ego", speed)
            _change_lane_for_the_route(speed, late)
        libsumo.simulationStep()
        for collision in libsumo.simulation.getCollisions():
            pair = {collision.collider, collision.victim}
            collided = " ".join(pair - {"ego"}) if "ego" in pair else collided
            others = others if "ego" in pair else " ".join(sorted(pair))
        imposed = max([imposed, *(-libsumo.vehicle.getAcceleration(i) for i in libsumo.vehicle.getIDList() if i != "ego" and _because_of_ego(i))])
    return Seed(collided, imposed, others, libsumo.simulation.getTime())


def _change_lane_for_the_route(speed: float, late: bool) -> None:
    """One lane nearer to the route, at the start or when no more than a lane change's way and 10 m are left."""
    offset = next((lane[3] for lane in libsumo.vehicle.getBestLanes("ego") if lane[0] == libsumo.vehicle.getLaneID("ego")), 0)
    if offset == 0 or libsumo.vehicle.getRoadID("ego").startswith(":"):
        return
    left = libsumo.lane.getLength(libsumo.vehicle.getLaneID("ego")) - libsumo.vehicle.getLanePosition("ego")
    if not late or left < 3.0 * speed + 10.0:
        libsumo.vehicle.changeLane("ego", libsumo.vehicle.getLaneIndex("ego") + (1 if offset > 0 else -1), 0.0)


def _because_of_ego(vehicle: str) -> bool:
    if "ego" not in libsumo.vehicle.getIDList():
        return False
    leader = libsumo.vehicle.getLeader(vehicle, 60.0)
    if leader and leader[0] == "ego":
        return True
    own, ego = np.array(libsumo.vehicle.getPosition(vehicle)), np.array(libsumo.vehicle.getPosition("ego"))
    heading = np.deg2rad(90.0 - libsumo.vehicle.getAngle(vehicle))
    along, aside = float((ego - own) @ [np.cos(heading), np.sin(heading)]), float((ego - own) @ [-np.sin(heading), np.cos(heading)])
    crossing = libsumo.vehicle.getRoadID("ego").startswith(":")
    changing = abs(libsumo.vehicle.getLateralLanePosition("ego")) > 0.05 and abs(aside) < 4.0
    return 0.0 < along < 25.0 and (crossing or changing)


def is_hard(name: str, seed: Seed) -> bool:
    """The definition of measures.md."""
    return bool(seed.collided) or (not name.endswith("-scripted") and seed.imposed > HARD_BRAKE)


def main() -> None:
    """Print a line for each scene and moment of the lane change."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    for name in sys.argv[2:] or [scene + kind for scene in SCENES for kind in ("", "-scripted")]:
        for kind, late, twin in (("early", False, False), ("late", True, False), ("twin", False, True)):
            seeds = [run(name, seed, late, twin=twin) for seed in range(count)]
            hard, hits = sum(is_hard(name, seed) for seed in seeds), sum(bool(seed.collided) for seed in seeds)
            whom = {x: sum(seed.collided == x for seed in seeds) for x in sorted({seed.collided for seed in seeds} - {""})}
            others = [seed.others for seed in seeds if seed.others]
            braking = np.array([seed.imposed for seed in seeds])
            print(
                f"{name:30s} {kind:5s} hard {hard}/{count} collisions {hits} {whom}"
                f" imposed>4: {np.sum(braking > HARD_BRAKE)} median {np.median(braking):.1f}; ends at {np.median([seed.time for seed in seeds]):.0f} s, last {max(seed.time for seed in seeds):.0f}; others among themselves {len(others)} {sorted(set(others))}"
            )


if __name__ == "__main__":
    main()
