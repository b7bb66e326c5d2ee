"""Behind a parked van, with a dense lane beside it, the ego is let in as SUMO's driver is."""

from pathlib import Path
from typing import Any

import helpers_sumocfg
import pytest
from helpers_networks import netconvert

NODES = '<node id="a" x="0" y="0"/><node id="b" x="900" y="0"/>'
EDGES = '<edge id="road" from="a" to="b" numLanes="2" speed="13.9"/>'
ROUTES = """<routes><vType id="car" speedDev="0.1"/><vType id="ego_car" speedDev="0"/>
<vehicle id="van" type="car" depart="0" departLane="0" departPos="480"><route edges="road"/>
<stop lane="road_0" endPos="500" duration="1000"/></vehicle>
<flow id="f" type="car" begin="0" end="400" vehsPerHour="2100" departLane="1" departSpeed="max">
<route edges="road"/></flow>
<vehicle id="ego" type="ego_car" depart="100" departLane="0" departSpeed="max">
<route edges="road"/></vehicle></routes>"""


def driven(folder: Path, *words: str) -> dict[str, Any]:
    """The row of an episode."""
    folder.mkdir()
    netconvert(folder, NODES, EDGES, "")
    (folder / "x.rou.xml").write_text(ROUTES)
    return helpers_sumocfg.driven(folder, *words, limit_s=300)


@pytest.mark.slow
def test_the_ego_asks_for_room_past_a_parked_van(tmp_path: Path) -> None:
    twin = driven(tmp_path / "twin", "--planner", "sumo")
    row = driven(tmp_path / "own", "--iterations", "200")
    assert (twin["outcome"], row["outcome"], row["collisions"]) == ("arrived", "arrived", 0)
    assert row["longest_stop_s"] == 0.0
    assert row["travel_time_s"] <= 1.1 * twin["travel_time_s"]
    assert row["imposed_brakes_4"] <= twin["imposed_brakes_4"]
