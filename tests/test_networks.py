"""The built networks are what their sources say, and carry nothing of the machine that built them."""

import importlib.util
import re
from types import ModuleType

import pytest
import sumolib

from sumo_mcts.config.builtin import root


def _load_build() -> ModuleType:
    spec = importlib.util.spec_from_file_location(
        "build_networks", root() / "networks" / "build.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


build = _load_build()


def test_every_folder_has_sources_and_a_network() -> None:
    folders = sorted(
        path.name
        for path in build.NETWORKS.iterdir()
        if path.is_dir() and not path.name.startswith("__")
    )
    assert build.names() == folders
    assert all(build.net_path(name).is_file() for name in folders)


@pytest.mark.parametrize("name", build.names())
def test_a_rebuild_gives_the_network_that_is_there(name: str) -> None:
    assert build.built(name) == build.net_path(name).read_text(encoding="utf-8"), (
        f"run python networks/build.py {name}"
    )


@pytest.mark.parametrize("name", build.names())
def test_no_dates_and_no_paths(name: str) -> None:
    text = build.net_path(name).read_text(encoding="utf-8")
    assert "generated on" not in text
    assert not re.search(r"/(home|root|tmp|work|usr)/", text)


@pytest.mark.parametrize("name", build.names())
def test_no_turnarounds_and_one_connection_to_an_edge(name: str) -> None:
    net = sumolib.net.readNet(str(build.net_path(name)))
    for edge in net.getEdges():
        for lane in edge.getLanes():
            targets = [connection.getTo().getID() for connection in lane.getOutgoing()]
            assert len(targets) == len(set(targets))
            assert all(net.getEdge(target).getToNode() != edge.getFromNode() for target in targets)


def test_the_crossing_lies_where_the_scenes_say() -> None:
    net = sumolib.net.readNet(str(build.net_path("crossing")))
    centre = {
        lane.getID(): lane.getShape()[-1]
        for name in ("from_west", "from_east", "from_south", "from_north")
        for lane in net.getEdge(name).getLanes()
    }
    assert [centre[f"from_west_{i}"][1] for i in (2, 1, 0)] == pytest.approx(
        [-2, -5.5, -9], abs=0.5
    )
    assert [centre[f"from_east_{i}"][1] for i in (2, 1, 0)] == pytest.approx([2, 5, 9], abs=0.5)
    assert [centre[f"from_south_{i}"][0] for i in (2, 1, 0)] == pytest.approx([9, 13, 16], abs=0.8)
    assert [centre[f"from_north_{i}"][0] for i in (2, 1, 0)] == pytest.approx([5, 2, -2], abs=1.3)


def test_only_the_left_lane_from_the_west_turns_left() -> None:
    net = sumolib.net.readNet(str(build.net_path("crossing")))
    turning = [
        lane.getIndex()
        for lane in net.getEdge("from_west").getLanes()
        if any(c.getTo().getID() == "to_north" for c in lane.getOutgoing())
    ]
    assert turning == [2]
