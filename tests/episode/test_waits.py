"""Two who wait for each other, in SUMO: one goes. SUMO's own driver says how long it may take."""

from pathlib import Path
from typing import Any

import pytest
from helpers_networks import netconvert

from sumo_mcts import config
from sumo_mcts.episode import run_episode

ENDS = {"w": (-1, 0), "s": (0, -1), "e": (1, 0), "n": (0, 1)}  # counterclockwise
FAR = 120.0  # m to the ends
STANDS_S = 100  # how long the car stands that has the right of way


def crossing(folder: Path, control: str) -> None:
    """Four arms of one lane each way; with `priority` the road from west to east has it."""
    nodes, roads = f'<node id="c" x="0" y="0" type="{control}"/>', ""
    for name, (x, y) in ENDS.items():
        nodes += f'<node id="{name}" x="{FAR * x}" y="{FAR * y}"/>'
        more = f'speed="13.9" priority="{3 if control == "priority" and name in "we" else 1}"'
        roads += f'<edge id="{name}c" from="{name}" to="c" {more}/>'
        roads += f'<edge id="c{name}" from="c" to="{name}" {more}/>'
    netconvert(folder, nodes, roads, "")


def car(route: str, place: float, stops: str = "") -> str:
    """A vehicle, named after the arm that it comes from."""
    way = f'<route edges="{route[0]}c c{route[1]}"/>'
    begins = f'depart="0" departPos="{place}" departSpeed="8"'
    return f'<vehicle id="{route[0]}" type="car" {begins}>{way}{stops}</vehicle>'


def driven(folder: Path, cars: str, egos: str, planner: str = "mcts") -> list[dict[str, Any]]:
    """The rows of the egos, named after the arms that they come from."""
    (folder / "x.rou.xml").write_text(
        f'<routes><vType id="car" speedDev="0"/>{cars}</routes>', encoding="utf-8"
    )
    scene = {
        "name": "waits",
        "sumo": {"net": str(folder / "x.net.xml"), "routes": [str(folder / "x.rou.xml")]},
        "egos": [{"id": ego} for ego in egos],
        "planner": {"name": planner},
        "episode": {"time_limit_s": 60},
    }
    return list(run_episode(config.build(scene, "test", ()), 1).rows)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("control", "ego", "other"),
    [
        ("priority", "sn", "ew"),  # it comes from the right,
        ("priority", "sn", "we"),  # from the left,
        ("priority", "wn", "ew"),  # towards an ego that turns left
        ("right_before_left", "sn", "ew"),
        ("right_before_left", "sw", "ns"),
    ],
)
def test_who_has_the_right_of_way_and_stands_is_passed(
    control: str, ego: str, other: str, tmp_path: Path
) -> None:
    """It stands at its line for no reason that can be seen. Without patience for it the ego stood
    there for 20 to 60 s."""
    crossing(tmp_path, control)
    stop = f'<stop lane="{other[0]}c_0" endPos="-1" startPos="-5" duration="{STANDS_S}"/>'
    cars = car(ego, 40.0) + car(other, 70.0, stop)
    (twin,) = driven(tmp_path, cars, ego[0], "sumo")
    (row,) = driven(tmp_path, cars, ego[0])
    assert (twin["outcome"], row["outcome"]) == ("arrived", "arrived")
    assert row["travel_time_s"] < twin["travel_time_s"] + 6.0
    assert row["imposed_brakes_2"] <= twin["imposed_brakes_2"]


@pytest.mark.slow
@pytest.mark.parametrize("routes", [("we", "sn", "ew", "ns"), ("wn", "sw", "es", "ne")])
@pytest.mark.parametrize("control", ["allway_stop", "right_before_left"])
def test_four_egos_that_come_at_once_get_through(
    control: str, routes: tuple[str, ...], tmp_path: Path
) -> None:
    """Each has one from the right, and all are as fast and as far away as the others."""
    crossing(tmp_path, control)
    egos = "".join(route[0] for route in routes)
    rows = driven(tmp_path, "".join(car(route, 40.0) for route in routes), egos)
    assert [row["outcome"] for row in rows] == ["arrived"] * len(routes)
    assert max(row["longest_stop_s"] for row in rows) < 10.0
