"""A dense stream of people over a crossing, in SUMO: the ego waits for them off the crossing."""

from pathlib import Path

import pytest
from helpers_networks import netconvert

from sumo_mcts import config
from sumo_mcts.episode import run_episode

ENDS = {"w": (-1, 0), "s": (0, -1), "e": (1, 0), "n": (0, 1)}
FAR = 120.0  # m to the ends
A_SECOND = 0.7  # people, of both directions
UNTIL_S = 60  # they set out until then


def zebra(folder: Path, arm: str) -> None:
    """Four arms of one lane each way and pavements; people have priority across the road `arm`."""
    nodes, roads = '<node id="c" x="0" y="0" type="priority"/>', ""
    for name, (x, y) in ENDS.items():
        nodes += f'<node id="{name}" x="{FAR * x}" y="{FAR * y}"/>'
        more = f'speed="13.9" priority="{3 if name in "we" else 1}" sidewalkWidth="2"'
        roads += f'<edge id="{name}c" from="{name}" to="c" {more}/>'
        roads += f'<edge id="c{name}" from="c" to="{name}" {more}/>'
    over = f'<crossing node="c" edges="{arm}c c{arm}" priority="true" width="4"/>'
    netconvert(folder, nodes, roads, over)


def stream(start: str, end: str, places: dict[str, int]) -> str:
    """People who walk from 5 m before the crossing to 5 m behind it."""
    return (
        f'<personFlow id="from_{start}" begin="0" end="{UNTIL_S}" probability="{A_SECOND / 2}" '
        f'departPos="{places[start]}"><walk from="{start}" to="{end}" '
        f'arrivalPos="{places[end]}"/></personFlow>'
    )


@pytest.mark.slow
@pytest.mark.parametrize("route", ["wn", "we", "ws"])
def test_people_on_a_zebra_crossing_are_waited_for(route: str, tmp_path: Path) -> None:
    """The ego turns onto it to the left or to the right, or meets it straight on. A forecast in
    which people walk straight on past the corner let it stand on the crossing."""
    arm = route[1]
    zebra(tmp_path, arm)
    places = {f"c{arm}": 5, f"{arm}c": -5}
    people = stream(f"c{arm}", f"{arm}c", places) + stream(f"{arm}c", f"c{arm}", places)
    way = f'<route edges="{route[0]}c c{arm}"/>'
    (tmp_path / "x.rou.xml").write_text(
        f'<routes><vType id="car" speedDev="0"/>{people}<vehicle id="ego" type="car" depart="15" '
        f'departPos="40" departSpeed="8">{way}</vehicle></routes>',
        encoding="utf-8",
    )
    scene = {
        "name": "zebra",
        "sumo": {"net": str(tmp_path / "x.net.xml"), "routes": [str(tmp_path / "x.rou.xml")]},
        "egos": [{"id": "ego"}],
        "episode": {"time_limit_s": 90},
    }
    settings = config.build(scene, "test", ())
    rows = [run_episode(settings, seed).rows[0] for seed in (1, 2, 3)]
    assert [row["outcome"] for row in rows] == ["arrived"] * 3
