"""Networks that are none, or hold numbers that nobody can compute with: refused in a line that
names the lane, never a hang, never a crash of SUMO."""

import copy
import gzip
import math
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from helpers_fuzz import mutated, refusal
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts.config import build
from sumo_mcts.episode import run_episode
from sumo_mcts.errors import ConfigError
from sumo_mcts.world import net_file
from sumo_mcts.world.roadmap import LEAST_SPEED, known_roadmap, read_roadmap

TOP = Path(__file__).resolve().parents[2]
NET = TOP / "networks" / "straight-line" / "straight-line.net.xml"
CROSSING = TOP / "networks" / "crossing" / "crossing.net.xml"

Change = Callable[[ElementTree.Element], object]


def changed(path: Path, change: Change, net: Path = NET) -> Path:
    tree = ElementTree.parse(net)
    change(tree.getroot())
    tree.write(path)
    return path


def found(root: ElementTree.Element, what: str) -> ElementTree.Element:
    element = root.find(what)
    assert element is not None
    return element


def setting(what: str, key: str, value: str) -> Change:
    return lambda root: found(root, what).set(key, value)


def without(what: str) -> Change:
    def change(root: ElementTree.Element) -> None:
        for parent in list(root.iter()):
            for each in [child for child in parent if child.tag == what]:
                parent.remove(each)

    return change


def circle(root: ElementTree.Element) -> None:
    for each in root.findall("connection"):
        if each.get("from", "").startswith(":"):
            each.set("via", f"{each.get('from')}_{each.get('fromLane')}")


LANE = ".//lane[@id='road_1']"
DAMAGED: dict[str, tuple[Change, str]] = {
    "speed nan": (setting(LANE, "speed", "nan"),
    "lane road_1: speed: has to be from -1000 to 1000, got nan"),
    "speed inf": (setting(LANE, "speed", "inf"), "lane road_1: speed: "),
    "speed large": (setting(LANE, "speed", "1e300"), "lane road_1: speed: "),
    "speed text": (setting(LANE, "speed", "fast"), "could not convert string to float: 'fast'"),
    "length 0": (setting(LANE, "length", "0"),
    "lane road_1: length: has to be from 0.01 to 1e+06, got 0"),
    "length negative": (setting(LANE, "length", "-350"), "lane road_1: length: "),
    "length nan": (setting(LANE, "length", "nan"), "lane road_1: length: "),
    "length large": (setting(LANE, "length", "1e300"), "lane road_1: length: "),
    "width 0": (setting(LANE, "width", "0"), "lane road_1: width: "),
    "width nan": (setting(LANE, "width", "nan"), "lane road_1: width: "),
    "shape nan": (setting(LANE, "shape", "0,0 nan,0"), "lane road_1: shape: "),
    "shape large": (setting(LANE, "shape", "0,0 1e300,0"), "lane road_1: shape: "),
    "shape empty": (setting(LANE, "shape", ""), "lane road_1: shape: not given"),
    "lane of another name": (setting(LANE, "id", "road_7"),
    "lane road_7: number 1 of edge road, so its id has to be road_1"),
    "no connections": (without("connection"), "inside a junction, belongs to no connection"),
    "no internal connections": (
        lambda root: [root.remove(each) for each in root.findall("connection") if each.get("from",
        "").startswith(":")],
        "inside a junction, does not lead to one lane outside",
    ),
    "a circle inside a junction": (circle, "inside a junction, does not lead to one lane outside"),
    "no lanes": (lambda root: [found(root,
    ".//edge[@id='road']").remove(lane) for lane in root.findall(".//edge[@id='road']/lane")], ""),
    "connection to no lane": (setting("connection", "toLane", "99"),
    "not a readable SUMO network (line "),
    "lane in the open": (lambda root: root.append(copy.deepcopy(found(root, LANE))),
    "lane: inside net, not edge"),
    "negative phase": (
        lambda root: ElementTree.SubElement(ElementTree.SubElement(root, "tlLogic", {"id": "x"}),
        "phase", {"duration": "-1e300", "state": "G"}),
        "phase: duration: has to be from 0 to 1e+09, got -1e+300",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", DAMAGED)
def test_damaged(case: str, tmp_path: Path) -> None:
    change, said = DAMAGED[case]
    path = changed(tmp_path / "n.net.xml", change)
    with pytest.raises(ConfigError) as refused:
        read_roadmap(str(path))
    assert said in str(refused.value)
    assert str(refused.value).startswith(f"{path}: not a readable SUMO network (")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "no element is found"),
        (b"<routes/>", "its root element is routes, that of a network is net"),
        (gzip.compress(NET.read_bytes())[:-20], "an archive that is cut off"),
        (gzip.compress(NET.read_bytes())[:100] + b"junk" * 200, "a damaged archive"),
        (
            b'<!DOCTYPE n [<!ENTITY a "b"><!ENTITY c "&a;&a;">]><net version="1.20">&c;</net>',
            "entities may not be declared",
        ),
        (NET.read_text().encode("utf-16"), "not a readable SUMO network"),
        (b'<?xml version="1.0" encoding="foo"?><net/>', "unknown encoding: foo"),
    ],
)
def test_no_network_at_all(content: bytes, said: str, tmp_path: Path) -> None:
    path = tmp_path / "n.net.xml.gz"
    path.write_bytes(content)
    assert said in refusal(lambda: read_roadmap(str(path)))


def test_a_bomb(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(net_file, "MOST_UNPACKED", 1 << 20)
    path = tmp_path / "n.net.xml.gz"
    path.write_bytes(gzip.compress(b'<net version="1.20">' + b" " * (1 << 21)))
    assert "unpacks to more than 1 MB" in refusal(lambda: read_roadmap(str(path)))


@pytest.mark.parametrize("speed", ["0", "-5", "0.05"])
def test_a_lane_on_which_nobody_can_drive(speed: str, tmp_path: Path) -> None:
    path = changed(tmp_path / "n.net.xml", setting(LANE, "speed", speed))
    road = known_roadmap(str(path))
    lane = road.lane_ids.index("road_1")
    assert (road.classes[lane], road.speed[lane]) == (0, LEAST_SPEED)
    whole = read_roadmap(str(NET))
    others = np.arange(len(road.lane_ids)) != lane
    assert np.array_equal(road.classes[others], whole.classes[others])
    if speed == "0":
        (tmp_path / "r.rou.xml").write_text(
            '<routes><vehicle id="ego" depart="0" departPos="50" departSpeed="5"><route '
            'edges="road beyond"/></vehicle></routes>'
        )
        data = {
            "name": "x",
            "sumo": {"net": str(path), "routes": [str(tmp_path / "r.rou.xml")]},
            "egos": [{"id": "ego"}],
            "planner": {"iterations": 100},
        }
        (row,) = run_episode(build({**data, "episode": {"time_limit_s": 3}}, "x"), 0).rows
        assert row["outcome"] == "timeout"
        assert row["distance_m"] > 5.0


@given(st.integers(0, 2**32), st.integers(1, 3), st.sampled_from([NET, CROSSING]))
def test_any_damage(seed: int, changes: int, net: Path) -> None:
    path = Path(__file__).parent / f".mutated-{seed}.net.xml"
    try:
        mutated(ElementTree.parse(net), seed, changes).write(path)
        said = refusal(lambda: _require_computable(str(path)))
    finally:
        path.unlink(missing_ok=True)
    assert said.isprintable()


def _require_computable(path: str) -> None:
    road = read_roadmap(path)
    assert (road.length > 0.0).all() and (road.speed > 0.0).all() and (road.width > 0.0).all()
    for name, part in road._asdict().items():
        if isinstance(part, np.ndarray) and part.dtype.kind == "f":
            assert np.isfinite(part).all(), name
    assert math.isfinite(float(road.scale.max()))
