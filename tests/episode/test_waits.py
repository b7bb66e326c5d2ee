"""Two who wait for each other, in SUMO: one goes. SUMO's own driver says how long it may take."""

from pathlib import Path
from typing import Any

import pytest
from helpers_networks import car, four_arms

from sumo_mcts import config
from sumo_mcts.episode import run_episode

STANDS_S = 100  # how long the car stands that has the right of way


def driven(
    folder: Path, cars: str, egos: str, planner: str = "mcts", connected: bool = False
) -> list[dict[str, Any]]:
    """The rows of the egos, named after the arms that they come from."""
    (folder / "x.rou.xml").write_text(
        f'<routes><vType id="car" speedDev="0"/>{cars}</routes>', encoding="utf-8"
    )
    scene = {
        "name": "waits",
        "sumo": {"net": str(folder / "x.net.xml"), "routes": [str(folder / "x.rou.xml")]},
        "egos": [{"id": ego, "connected": connected} for ego in egos],
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
    four_arms(tmp_path, control)
    stop = f'<stop lane="{other[0]}c_0" endPos="-1" startPos="-5" duration="{STANDS_S}"/>'
    cars = car(ego, 40.0) + car(other, 70.0, stop)
    (twin,) = driven(tmp_path, cars, ego[0], "sumo")
    (row,) = driven(tmp_path, cars, ego[0])
    assert (twin["outcome"], row["outcome"]) == ("arrived", "arrived")
    assert row["travel_time_s"] < twin["travel_time_s"] + 6.0
    assert row["imposed_brakes_2"] <= twin["imposed_brakes_2"]


@pytest.mark.slow
@pytest.mark.parametrize("connected", [False, True])
@pytest.mark.parametrize("routes", [("we", "sn", "ew", "ns"), ("wn", "sw", "es", "ne")])
@pytest.mark.parametrize("control", ["allway_stop", "right_before_left"])
def test_four_egos_that_come_at_once_get_through(
    control: str, routes: tuple[str, ...], connected: bool, tmp_path: Path
) -> None:
    """Each has one from the right, and all are as fast and as far away as the others."""
    four_arms(tmp_path, control)
    egos = "".join(route[0] for route in routes)
    cars = "".join(car(route, 40.0) for route in routes)
    rows = driven(tmp_path, cars, egos, connected=connected)
    assert [row["outcome"] for row in rows] == ["arrived"] * len(routes)
    assert max(row["longest_stop_s"] for row in rows) < 10.0


@pytest.mark.slow
@pytest.mark.parametrize("connected", [False, True])
@pytest.mark.parametrize(
    ("routes", "places", "most_s"),
    [
        (("we", "sn"), (41.9, 40.8), 50.0),  # one stands a tenth of a second before the other
        (("we", "sn"), (40.0, 40.0), 50.0),  # in the same step
        (("we", "sn", "ew"), (40.0, 40.0, 40.0), 75.0),
    ],
)
def test_egos_that_stop_at_once_go_one_after_the_other(
    routes: tuple[str, ...],
    places: tuple[float, ...],
    most_s: float,
    connected: bool,
    tmp_path: Path,
) -> None:
    """They come to a stand at an all-way stop in the same half second. As long as each took the
    other to have lost its turn when it set off they needed 60 s in sum, and 203 s."""
    four_arms(tmp_path, "allway_stop")
    cars = "".join(car(*each) for each in zip(routes, places, strict=True))
    egos = "".join(route[0] for route in routes)
    rows = driven(tmp_path, cars, egos, connected=connected)
    assert [row["outcome"] for row in rows] == ["arrived"] * len(routes)
    assert sum(row["travel_time_s"] for row in rows) < most_s
    # of connected ones the first to decide may set off on what the others told half a second ago
    assert sum(row["imposed_brakes_3"] for row in rows) <= int(connected)
    assert max(row["longest_stop_s"] for row in rows) < 4.0
