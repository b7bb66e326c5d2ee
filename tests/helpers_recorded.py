"""Recorded episodes for tests, in a network of a user's own and in built-in scenes."""

import subprocess
import sys
from pathlib import Path

import sumo

from sumo_mcts import config, records
from sumo_mcts.config import ScenarioConfig, builtin
from sumo_mcts.episode.run import EpisodeResult
from sumo_mcts.records import Trace

FAST = "planner.iterations=200"
TRAFFIC = """<routes>
    <vType id="ego" length="4.6" decel="6" accel="2.2"/>
    <flow id="east" begin="0" end="60" period="4" from="left1A1" to="C1right1" departLane="random"/>
    <flow id="north" begin="0" end="60" period="5" from="bottom1B0" to="B2top1"/>
    <flow id="turn" begin="0" end="60" period="7" from="top0A2" to="B0bottom1"/>
    <trip id="me" type="ego" depart="20" from="left1A1" to="B0bottom1"/>
</routes>"""
GRID = (
    "--grid",
    "--grid.number",
    "3",
    "--grid.length",
    "90",
    "--grid.attach-length",
    "80",
    "--default.lanenumber",
    "2",
    "--no-turnarounds",
)
RULES = ("--default-junction-type", "allway_stop", "--tls.set", "B1")


def of_a_user(folder: Path) -> ScenarioConfig:
    """A scenario from a .sumocfg: a grid with a light, all-way stops and flows.

    The step is twice the usual one.
    """
    binary = (
        Path(sumo.SUMO_HOME)
        / "bin"
        / ("netgenerate.exe" if sys.platform == "win32" else "netgenerate")
    )
    subprocess.run(
        [binary, *GRID, *RULES, "-o", folder / "grid.net.xml"], check=True, capture_output=True
    )
    (folder / "grid.rou.xml").write_text(TRAFFIC)
    (folder / "grid.sumocfg").write_text(
        '<configuration><net-file value="grid.net.xml"/><route-files '
        'value="grid.rou.xml"/><step-length value="0.2"/><seed value="5"/></configuration>'
    )
    return config.build(
        {"name": "grid", "sumo": {"sumocfg": str(folder / "grid.sumocfg")}, "egos": [{"id": "me"}]},
        "test",
        (FAST,),
    )


def of_a_scene(name: str, *sets: str) -> ScenarioConfig:
    """A built-in scene, with few iterations."""
    return config.load(builtin.scenario_path(name), (FAST, *sets))


def keep(folder: Path, result: EpisodeResult) -> None:
    """Save rows, traces and map like `run --out`."""
    for row in result.rows:
        records.append_row(folder, row)
    for trace in result.traces:
        keep_trace(folder, trace)
    assert result.road is not None
    records.save_map(folder, result.road)


def keep_trace(folder: Path, trace: Trace) -> None:
    """Save a trace where the commands look for it."""
    records.save_trace(folder / records.TRACES / f"{trace.key}.npz", trace)
