"""An ego and its twin on a small network of one's own."""

import json
from pathlib import Path
from typing import Any, NamedTuple

from helpers_networks import netconvert
from typer.testing import CliRunner

from sumo_mcts.cli import app

MOST = 1.2  # times as long as SUMO's driver takes
LATE_S = 3.0  # s more, which are nothing of a driver's


class Case(NamedTuple):
    """A network, its traffic, and how SUMO is set."""

    nodes: str
    edges: str
    connections: str
    routes: str
    netconvert: tuple[str, ...] = ()
    sumo: str = '<step-length value="0.5"/>'


def written(folder: Path, case: Case) -> None:
    """Write a.sumocfg and what it names."""
    if not (folder / "x.net.xml").is_file():
        netconvert(folder, case.nodes, case.edges, case.connections, *case.netconvert)
    (folder / "r.rou.xml").write_text(f"<routes>{case.routes}</routes>")
    (folder / "a.sumocfg").write_text(
        '<configuration><net-file value="x.net.xml"/><route-files value="r.rou.xml"/>'
        f"{case.sumo}</configuration>"
    )


def episode(folder: Path, case: Case, *words: str) -> dict[str, Any]:
    """The row of vehicle `ego`."""
    written(folder, case)
    answer = CliRunner().invoke(
        app,
        ["run", str(folder / "a.sumocfg"), "--ego", "ego", "--json", *words],
        catch_exceptions=False,
    )
    assert "{" in answer.output, answer.output
    (row,) = json.loads(answer.output[answer.output.index("{") :])["episodes"]
    return dict(row)


def pair(folder: Path, case: Case) -> tuple[dict[str, Any], dict[str, Any]]:
    """The rows of the ego and of its twin."""
    return (
        episode(folder, case, "--iterations", "100"),
        episode(folder, case, "--planner", "sumo"),
    )


def drives_as_its_twin(folder: Path, case: Case) -> dict[str, Any]:
    """The row of the ego, which has arrived without fault and hardly later than its twin."""
    ego, twin = pair(folder, case)
    assert (twin["outcome"], ego["outcome"], ego["error"]) == ("arrived", "arrived", None)
    assert ego["travel_time_s"] <= MOST * twin["travel_time_s"] + LATE_S
    assert ego["red_lights_run"] == 0
    return ego
