"""Where SUMO divides lanes the ego passes slow narrow traffic within its lane, as SUMO's drivers
do, and keeps more room beside it."""

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from helpers_pairs import MOST, Case, episode

pytestmark = pytest.mark.slow

TYPES = """<vType id="car" speedDev="0"/>
<vType id="bicycle" vClass="bicycle" speedDev="0" latAlignment="right"/>
<vType id="van" vClass="delivery" latAlignment="right"/><route id="r" edges="ab bc"/>"""
BICYCLE = """<vehicle id="x" type="bicycle" route="r" depart="0" departPos="60" departSpeed="max"
departPosLat="right"/>"""
VAN = """<vehicle id="x" type="van" route="r" depart="0" departPos="200" departPosLat="right">
<stop lane="ab_0" startPos="150" endPos="240" posLat="-1.2" duration="1000"/></vehicle>"""
EGO = """<vehicle id="ego" type="car" route="r" depart="4" departPos="5" departSpeed="max"/>"""
WIDTHS = {"car": 1.8, "bicycle": 0.65, "van": 2.16}  # m, SUMO's
LENGTHS = {"car": 5.0, "bicycle": 1.6, "van": 6.5}  # m


def case_of(width: float, other: str, *netconvert: str) -> Case:
    """An other at the edge of a lane, the ego behind it, and a lane of oncoming traffic beside."""
    edge = f'numLanes="1" speed="13.9" width="{width}"'
    return Case(
        nodes='<node id="a" x="0" y="0"/><node id="b" x="350" y="0"/><node id="c" x="400" y="0"/>',
        edges=f'<edge id="ab" from="a" to="b" {edge}/><edge id="bc" from="b" to="c" {edge}/>'
        f'<edge id="ba" from="b" to="a" {edge}/><edge id="cb" from="c" to="b" {edge}/>',
        connections="",
        routes=f"{TYPES}{other}{EGO}",
        netconvert=netconvert,
        sumo='<step-length value="0.1"/><lateral-resolution value="0.8"/>'
        '<fcd-output value="fcd.xml"/>',
    )


def least_gap(folder: Path) -> float:
    """m between ego and x side by side, on a road along y = const.; inf: they never were."""
    least = float("inf")
    for moment in ET.parse(folder / "fcd.xml").getroot():
        here = {each.get("id"): each for each in moment}
        if "ego" not in here or "x" not in here:
            continue
        (x, y, kind), (ex, ey, mine) = (
            (float(v.get("x", "")), float(v.get("y", "")), v.get("type", ""))
            for v in (here["x"], here["ego"])
        )
        if -LENGTHS[kind] < ex - x < LENGTHS[mine]:
            least = min(least, abs(y - ey) - 0.5 * (WIDTHS[kind] + WIDTHS[mine]))
    return least


@pytest.mark.parametrize(
    ("width", "other", "room", "more"),
    [(4.5, BICYCLE, 1.4, ()), (4.0, BICYCLE, 1.2, ("--lefthand",)), (5.5, VAN, 0.8, ())],
    ids=["bicycle", "bicycle-lefthand", "van"],
)
def test_the_ego_passes_within_its_lane(
    width: float, other: str, room: float, more: tuple[str, ...], tmp_path: Path
) -> None:
    case = case_of(width, other, *more)
    twin = episode(tmp_path, case, "--planner", "sumo")
    ego = episode(tmp_path, case, "--iterations", "100")
    assert (twin["outcome"], ego["outcome"], ego["collisions"]) == ("arrived", "arrived", 0)
    assert ego["travel_time_s"] <= MOST * twin["travel_time_s"]
    assert ego["failsafe_interventions"] == 0 and ego["lane_changes"] == 0
    assert room < least_gap(tmp_path) < 3.0
