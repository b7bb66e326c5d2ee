"""The paper's scenes among SUMO's drivers: what happens by script happens there too."""

from collections import defaultdict
from pathlib import Path

import libsumo
import pytest
from helpers_networks import simulation

from sumo_mcts import load_scenario
from sumo_mcts.world.actors import Actors
from sumo_mcts.world.crowd import Cast, write_routes
from sumo_mcts.world.roadmap import read_roadmap

STEP = 0.1
Seen = dict[str, list[tuple[str, float, float, float]]]  # lane, x, y and speed, one a step


def driven(name: str, seconds: float, folder: Path) -> Seen:
    """What SUMO's drivers do in a scene as it is written, beside an ego that keeps to 5 m/s."""
    config = load_scenario(name)
    net, cast = str(config.sumo.net), Cast(config.traffic.actors)
    seen: Seen = defaultdict(list)
    with simulation(net, [*config.sumo.routes, write_routes(cast, folder)]):
        actors = Actors(config.traffic.actors, read_roadmap(net), STEP)
        for _ in range(round(seconds / STEP)):
            actors.before_step(libsumo.simulation.getTime())
            libsumo.simulationStep()
            libsumo.vehicle.setMaxSpeed("ego", 5.0)
            for who in libsumo.vehicle.getIDList():
                x, y = libsumo.vehicle.getPosition(who)
                speed = libsumo.vehicle.getSpeed(who)
                seen[who].append((libsumo.vehicle.getLaneID(who), x, y, speed))
    return seen


@pytest.mark.parametrize(
    ("name", "who", "lane", "seconds"),
    [
        ("go-straight-1", "cutting_in", "to_east_1", 10),
        ("go-straight-1", "ahead", "to_east_0", 10),
        ("crossing-cut-in", "cutting_in", "from_west_1", 4),
        ("crossing-cut-in", "ahead", "from_west_2", 4),
        ("crossing-cut-in", "from_the_right", "to_east_1", 12),
        ("exit-cut-in", "slow", "approach_1", 8),
    ],
)
def test_who_changes_lanes_by_script_does_so_with_a_driver(
    name: str, who: str, lane: str, seconds: float, tmp_path: Path
) -> None:
    assert driven(name, seconds, tmp_path)[who][-1][0] == lane


@pytest.mark.parametrize(
    ("name", "who", "place", "seconds"),
    [
        ("crossing-cut-in", "cutting_in", (-26, -5), 5),
        ("crossing-cut-in", "ahead", (-8, -2), 5),
        ("crossing-blocked", "blocking_left", (-8, -2), 5),
        ("crossing-blocked", "blocking", (-8, -5), 6),
        ("straight-cross", "south_bound_1", (-1, 3), 0.5),
        ("lujiazui-tunnel", "merging", (-29, 16), 5),
        ("stationary-objects", "parked_1", (-56, -5), 15),
    ],
)
def test_who_stops_by_script_does_so_with_a_driver(
    name: str, who: str, place: tuple[float, float], seconds: float, tmp_path: Path
) -> None:
    stands = [row for row in driven(name, 15, tmp_path)[who] if row[3] < 0.05]
    assert len(stands) * STEP == pytest.approx(seconds, abs=0.4)
    assert stands[0][1:3] == pytest.approx(place, abs=3)
