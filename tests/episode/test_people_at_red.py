"""A turn to the right at lights while somebody waits at the corner, in SUMO."""

import subprocess
from pathlib import Path

import pytest
import sumo

from sumo_mcts import config
from sumo_mcts.episode import run_episode
from sumo_mcts.records import Row

# The first comes to the corner when the ego's light is about to turn red, and waits there until its
# own is green again. The other two get green next, over the road from which the ego comes.
PEOPLE = (("waits", "A1B1 B1C1", 60, 76), ("b", "B1B0 B2B1", 70, 26), ("c", "B2B1 B1B0", 70, 80))


def drive(folder: Path, depart: float) -> Row:
    """The ego's row, which sets out at `depart`, s, and turns right in the last seconds of green.

    Where netgenerate draws a corner, who waits at the kerb stands in the way of a car that turns
    right.
    """
    options = "--grid --grid.number=3 --grid.length=120 -L 2 --sidewalks.guess --crossings.guess"
    subprocess.run(
        [
            str(Path(sumo.SUMO_HOME) / "bin" / "netgenerate"),
            *options.split(),
            "--default-junction-type=traffic_light",
            "-o",
            "x.net.xml",
        ],
        cwd=folder,
        check=True,
        capture_output=True,
    )
    people = "".join(
        f'<person id="{name}" type="walker" depart="{at}" departPos="{place}">'
        f'<walk edges="{edges}"/></person>'
        for name, edges, at, place in PEOPLE
    )
    (folder / "x.rou.xml").write_text(
        '<routes><vType id="car" speedDev="0"/><vType id="walker" vClass="pedestrian" '
        f'maxSpeed="1.3" speedFactor="1" speedDev="0"/>{people}'
        f'<vehicle id="ego" type="car" depart="{depart}" departPos="5" departLane="1" '
        'departSpeed="13"><route edges="A1B1 B1B0"/></vehicle></routes>',
        encoding="utf-8",
    )
    scene = {
        "name": "corner",
        "sumo": {
            "net": str(folder / "x.net.xml"),
            "routes": [str(folder / "x.rou.xml")],
            "step_length_s": 1.0,  # SUMO's default
        },
        "egos": [{"id": "ego"}],
        "episode": {"time_limit_s": 150, "depart_limit_s": 100},
    }
    return run_episode(config.build(scene, "test", ()), 0).rows[0]


@pytest.mark.slow
@pytest.mark.parametrize("depart", [72, 74, 75])
def test_an_ego_waits_at_the_line_not_on_the_junction(depart: float, tmp_path: Path) -> None:
    """It stood on the crossing under its rear, and was walked into when people got green there."""
    row = drive(tmp_path, depart)
    assert (row["outcome"], row["at_fault"]) == ("arrived", None)
    assert row["travel_time_s"] < 80.0
