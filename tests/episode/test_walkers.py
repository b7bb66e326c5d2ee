"""People who walk along a road without a sidewalk, in SUMO: the ego passes them."""

from pathlib import Path

import pytest
from helpers_networks import netconvert

from sumo_mcts import config
from sumo_mcts.episode import run_episode

NODES = '<node id="n0" x="0" y="0"/><node id="n1" x="200" y="0"/><node id="n2" x="390" y="60"/>'
EDGES = "".join(
    f'<edge id="{name}" from="n{a}" to="n{b}" speed="13.9" numLanes="1"/>'
    for name, a, b in (("ab", 0, 1), ("bc", 1, 2), ("cb", 2, 1), ("ba", 1, 0))
)


def walk(name: str, edges: str, start: float, end: float) -> str:
    return (
        f'<person id="{name}" depart="0" departPos="{start}"><walk edges="{edges}" '
        f'arrivalPos="{end}"/></person>'
    )


# ahead of the ego in its direction, and towards it on its lane
SAME = walk("same", "ab bc", 60, 150)
AGAINST = walk("against", "ab", 190, 5)


@pytest.mark.slow
@pytest.mark.parametrize("people", [SAME, AGAINST], ids=["same", "against"])
def test_people_at_the_edge_of_the_lane_are_passed(people: str, tmp_path: Path) -> None:
    """They leave 0.14 m, at which SUMO's driver passes them at full speed. With the margin around
    people on foot the ego followed them to the end."""
    netconvert(tmp_path, NODES, EDGES, "")
    (tmp_path / "x.rou.xml").write_text(
        f'<routes><vType id="car" speedDev="0"/>{people}<vehicle id="ego" type="car" depart="10" '
        'departSpeed="10"><route edges="ab bc"/></vehicle></routes>',
        encoding="utf-8",
    )
    scene = {
        "name": "walkers",
        "sumo": {"net": str(tmp_path / "x.net.xml"), "routes": [str(tmp_path / "x.rou.xml")]},
        "egos": [{"id": "ego"}],
        "episode": {"time_limit_s": 90},
    }
    mine, usual = (
        run_episode(config.build({**scene, "planner": {"name": name}}, "test", ()), 1).rows[0]
        for name in ("mcts", "sumo")
    )
    assert (mine["outcome"], usual["outcome"]) == ("arrived", "arrived")
    assert mine["travel_time_s"] < 1.25 * usual["travel_time_s"]
