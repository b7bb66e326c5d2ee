"""A dense stream of people over a crossing, in SUMO: the ego waits for them off the crossing."""

from pathlib import Path

import pytest
from helpers_networks import netconvert

from sumo_mcts import config
from sumo_mcts.episode import run_episode
from sumo_mcts.records import Row

ENDS = {"w": (-1, 0), "s": (0, -1), "e": (1, 0), "n": (0, 1)}
FAR = 120.0  # m to the ends
A_SECOND = 0.7  # people, of both directions
UNTIL_S = 60  # they set out until then


def zebra(folder: Path, arm: str, first: str = "true") -> None:
    """Four arms of one lane each way and pavements, and a crossing over the road `arm`, where people
    go `first`, or not."""
    nodes, roads = '<node id="c" x="0" y="0" type="priority"/>', ""
    for name, (x, y) in ENDS.items():
        nodes += f'<node id="{name}" x="{FAR * x}" y="{FAR * y}"/>'
        more = f'speed="13.9" priority="{3 if name in "we" else 1}" sidewalkWidth="2"'
        roads += f'<edge id="{name}c" from="{name}" to="c" {more}/>'
        roads += f'<edge id="c{name}" from="c" to="{name}" {more}/>'
    over = f'<crossing node="c" edges="{arm}c c{arm}" priority="{first}" width="4"/>'
    netconvert(folder, nodes, roads, over)


def stream(start: str, end: str, places: dict[str, int], a_second: float = A_SECOND) -> str:
    """People who walk from 5 m before the crossing to 5 m behind it."""
    return (
        f'<personFlow id="from_{start}" begin="0" end="{UNTIL_S}" probability="{a_second / 2}" '
        f'departPos="{places[start]}"><walk from="{start}" to="{end}" '
        f'arrivalPos="{places[end]}"/></personFlow>'
    )


def drive(folder: Path, arm: str, route: str, people: float, seeds: tuple[int, ...]) -> list[Row]:
    """The ego's rows on a network in `folder`; `people` a second walk over the road `arm`."""
    places = {f"c{arm}": 5, f"{arm}c": -5}
    both = (
        stream(f"c{arm}", f"{arm}c", places, people),
        stream(f"{arm}c", f"c{arm}", places, people),
    )
    way = f'<route edges="{route[0]}c c{route[1]}"/>'
    (folder / "x.rou.xml").write_text(
        f'<routes><vType id="car" speedDev="0"/>{"".join(both)}<vehicle id="ego" type="car" '
        f'depart="15" departPos="40" departSpeed="8">{way}</vehicle></routes>',
        encoding="utf-8",
    )
    scene = {
        "name": "zebra",
        "sumo": {"net": str(folder / "x.net.xml"), "routes": [str(folder / "x.rou.xml")]},
        "egos": [{"id": "ego"}],
        "episode": {"time_limit_s": 90},
    }
    settings = config.build(scene, "test", ())
    return [run_episode(settings, seed).rows[0] for seed in seeds]


@pytest.mark.slow
@pytest.mark.parametrize("route", ["wn", "we", "ws"])
def test_people_on_a_zebra_crossing_are_waited_for(route: str, tmp_path: Path) -> None:
    """The ego turns onto it to the left or to the right, or meets it straight on. A forecast in
    which people walk straight on past the corner let it stand on the crossing."""
    zebra(tmp_path, route[1])
    rows = drive(tmp_path, route[1], route, A_SECOND, (1, 2, 3))
    assert [row["outcome"] for row in rows] == ["arrived"] * 3


@pytest.mark.slow
@pytest.mark.parametrize(("arm", "route", "seed"), [("n", "wn", 1), ("w", "wn", 7)])
def test_people_who_have_to_let_vehicles_pass_wait_for_one_that_turns(
    arm: str, route: str, seed: int, tmp_path: Path
) -> None:
    """Over the road that it takes, and over that which it leaves. It waited for the last of them:
    for more than 60 s; SUMO's driver needs 17 s."""
    zebra(tmp_path, arm, "false")
    (row,) = drive(tmp_path, arm, route, 0.4, (seed,))
    assert row["outcome"] == "arrived" and row["travel_time_s"] < 45.0
