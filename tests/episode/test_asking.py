"""Beside a standing queue nobody lets the ego in that does not ask."""

from pathlib import Path
from typing import Any

import helpers_sumocfg
import pytest
from helpers_networks import netconvert

from sumo_mcts.records.trace import load_trace
from sumo_mcts.scene import Follow

# A road of two lanes to a light: the left lane turns left, and its queue is as long as the road.
# The ego comes on the right lane and has to turn left too.
NODES = (
    '<node id="a" x="-400" y="0"/><node id="c" x="0" y="0" type="traffic_light"/>'
    '<node id="n" x="0" y="200"/><node id="e" x="200" y="0"/><node id="s" x="0" y="-200"/>'
)
EDGES = "".join(
    f'<edge id="{name}" from="{begin}" to="{end}" numLanes="{lanes}" speed="13.9"/>'
    for name, begin, end, lanes in (
        ("in", "a", "c", 2),
        ("out", "c", "e", 1),
        ("left", "c", "n", 1),
        ("side", "s", "c", 1),
    )
)
JOINED = (
    '<connection from="in" to="out" fromLane="0" toLane="0"/>'
    '<connection from="in" to="left" fromLane="1" toLane="0"/>'
    '<connection from="side" to="left" fromLane="0" toLane="0"/>'
)
ROUTES = """<routes><vType id="car" speedDev="0.1"/><vType id="ego_car" speedDev="0"/>
<flow id="l" type="car" begin="0" end="400" vehsPerHour="1100" departLane="1" departSpeed="max"><route edges="in left"/></flow>
<flow id="s" type="car" begin="0" end="900" vehsPerHour="200" departSpeed="max"><route edges="side left"/></flow>
<vehicle id="ego" type="ego_car" depart="180" departLane="0" departSpeed="max"><route edges="in left"/></vehicle>
</routes>"""


def driven(folder: Path, *words: str) -> dict[str, Any]:
    """The row of an episode in the queue, at most 130 s long."""
    netconvert(folder, NODES, EDGES, JOINED)
    (folder / "x.rou.xml").write_text(ROUTES)
    return helpers_sumocfg.driven(folder, *words, limit_s=130)


def asked(folder: Path) -> list[int]:
    """The sides that were asked for, decision by decision."""
    (path,) = folder.glob("out/traces/*.npz")
    commands = [cycle.decision.command for cycle in load_trace(path).cycles]
    return [command.asks for command in commands if isinstance(command, Follow)]


@pytest.mark.slow
def test_an_ego_that_asks_is_let_in_as_sumos_driver_is(tmp_path: Path) -> None:
    (tmp_path / "twin").mkdir()
    twin = driven(tmp_path / "twin", "--planner", "sumo")
    row = driven(tmp_path, "--iterations", "200")
    assert (twin["outcome"], row["outcome"]) == ("arrived", "arrived")
    assert row["travel_time_s"] <= twin["travel_time_s"]
    assert row["imposed_brakes_4"] <= twin["imposed_brakes_4"]
    sides = asked(tmp_path)
    assert set(sides) == {0, 1}
    assert sides[-1] == 0 and sides[0] == 0  # not before it matters, not when it is there


@pytest.mark.slow
def test_an_ego_that_does_not_ask_is_not_let_in(tmp_path: Path) -> None:
    row = driven(tmp_path, "--iterations", "200", "--set", "ego_model.asks=false")
    assert row["outcome"] == "timeout"
    assert row["stopped_s"] > 60.0
    assert set(asked(tmp_path)) == {0}
