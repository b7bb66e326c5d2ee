"""Junctions without lanes inside, over which vehicles jump, in SUMO: the ego gives way where its
link has to, and goes on where it has the right of way."""

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
from helpers_networks import ENDS, FAR, netconvert

from sumo_mcts import config
from sumo_mcts.episode import run_episode

LENGTH = 5.0  # m, of the ego


def crossing(folder: Path, control: str) -> str:
    """Two lanes each way from west to east, one each way from south to north, and no lanes inside."""
    nodes, roads = f'<node id="c" x="0" y="0" type="{control}"/>', ""
    for name, (x, y) in ENDS.items():
        main = name in "we"
        more = f'speed="13.9" numLanes="{1 + main}" priority="{1 + main}"'
        nodes += f'<node id="{name}" x="{FAR * x}" y="{FAR * y}"/>'
        roads += f'<edge id="{name}c" from="{name}" to="c" {more}/>'
        roads += f'<edge id="c{name}" from="c" to="{name}" {more}/>'
    return netconvert(folder, nodes, roads, "", "--no-internal-links", "true")


def stream(way: str, probability: float) -> str:
    return (
        f'<flow id="f{way}" type="car" begin="0" end="90" probability="{probability}" '
        f'departSpeed="max" departLane="best"><route edges="{way[0]}c c{way[1]}"/></flow>'
    )


def driven(folder: Path, net: str, way: str, flows: str, planner: str = "mcts") -> dict[str, Any]:
    """The ego's row, who drives `way` at 15 s."""
    (folder / "x.rou.xml").write_text(
        f'<routes><vType id="car" speedDev="0"/>{flows}<vehicle id="ego" type="car" depart="15" '
        f'departSpeed="max" departLane="best"><route edges="{way[0]}c c{way[1]}"/></vehicle>'
        "</routes>",
        encoding="utf-8",
    )
    scene = {
        "name": "jumps",
        "sumo": {
            "net": net,
            "routes": [str(folder / "x.rou.xml")],
            "options": {"fcd-output": str(folder / f"{planner}.xml")},
        },
        "egos": [{"id": "ego"}],
        "planner": {"name": planner},
        "episode": {"time_limit_s": 90},
    }
    return dict(run_episode(config.build(scene, "test", ()), 1).rows[0])


def jumps(fcd: Path, arms: str) -> dict[str, tuple[float, float]]:
    """When the ego and the vehicles from `arms` jumped, s, and how fast they were then, m/s."""
    was: dict[str, str] = {}
    found: dict[str, tuple[float, float]] = {}
    for step in ET.parse(fcd).getroot():
        for vehicle in step:
            name, lane = vehicle.get("id", ""), vehicle.get("lane", "")
            before = was.get(name, lane)
            if before[0] != "c" and lane[0] == "c" and (name == "ego" or before[0] in arms):
                found[name] = float(step.get("time", "")), float(vehicle.get("speed", ""))
            was[name] = lane
    return found


@pytest.mark.slow
def test_the_ego_gives_way(tmp_path: Path) -> None:
    """From the minor road, over one with priority. Nobody meets it there, since all jump: it drove
    into a gap of 0.9 s, where SUMO's drivers leave a second behind their rear."""
    net = crossing(tmp_path, "priority")
    row = driven(tmp_path, net, "sn", stream("we", 0.2) + stream("ew", 0.2))
    assert row["outcome"] == "arrived" and row["imposed_brakes_3"] == 0
    when = jumps(tmp_path / "mcts.xml", "we")
    own, v = when.pop("ego")
    assert min(time for time, _ in when.values() if time >= own) - own > LENGTH / v + 1.0


@pytest.mark.slow
def test_the_ego_goes_on_where_it_has_priority(tmp_path: Path) -> None:
    """It turns right, and those who come from two sides onto the same road have to wait: they brake
    at their lines, late. It braked for them, and they for it."""
    net = crossing(tmp_path, "priority")
    flows = stream("es", 0.15) + stream("ns", 0.15)
    twin, row = (driven(tmp_path, net, "ws", flows, planner) for planner in ("sumo", "mcts"))
    assert (twin["outcome"], row["outcome"]) == ("arrived", "arrived")
    assert row["travel_time_s"] < twin["travel_time_s"] + 4.0
    assert row["imposed_brakes_3"] <= twin["imposed_brakes_3"]


@pytest.mark.slow
@pytest.mark.parametrize("control", ["traffic_light", "priority_stop", "allway_stop"])
def test_lights_and_stop_signs_hold_the_ego(control: str, tmp_path: Path) -> None:
    """Such networks were refused."""
    net = crossing(tmp_path, control)
    flows = stream("we", 0.1) + stream("ew", 0.1)
    twin, row = (driven(tmp_path, net, "sn", flows, planner) for planner in ("sumo", "mcts"))
    assert (twin["outcome"], row["outcome"]) == ("arrived", "arrived")
    assert row["red_lights_run"] == 0 and row["travel_time_s"] > 20.0
    assert row["travel_time_s"] < twin["travel_time_s"] + 6.0
