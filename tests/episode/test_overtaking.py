"""Overtaking through oncoming traffic, in SUMO; its own driver says how long it may take."""

from pathlib import Path
from typing import Any

import pytest
from helpers_networks import netconvert

from sumo_mcts import config
from sumo_mcts.episode import run_episode

NODES = (
    '<node id="w" x="-150" y="0"/><node id="a" x="0" y="0"/><node id="b" x="600" y="0"/>'
    '<node id="e" x="1000" y="0"/>'
)
EDGES = "".join(
    f'<edge id="{name}" from="{name[0]}" to="{name[1]}" numLanes="1" speed="13.9"/>'
    for name in ("wa", "aw", "ab", "ba", "be", "eb")
)
SHORTER = "".join(
    f'<edge id="{name}" from="{name[0]}" to="{name[1]}" numLanes="1" speed="13.9"/>'
    for name in ("wa", "aw", "am", "ma", "mb", "bm", "be", "eb")
)
PARKED = (
    '<vehicle id="s" type="car" depart="0" departPos="200" departSpeed="0"><route edges="ab be"/>'
    '<stop lane="ab_0" startPos="190" endPos="210" duration="3600"/></vehicle>'
)
SLOW = (
    '<vehicle id="s" type="slow" depart="0" departPos="60" departSpeed="max">'
    '<route edges="wa ab be"/></vehicle>'
)
FLOW = (
    '<flow id="o" type="car" begin="0" end="300" period="exp(0.08)" departSpeed="max">'
    '<route edges="eb ba aw"/></flow>'
)
QUICKER = SLOW.replace('"slow"', '"lorry"')  # half of the limit
IN_TWO = {" ab": " am mb", "ba ": "bm ma "}  # the same road in two edges
STREAM = (  # so dense that nobody gets past
    '<flow id="o" type="car" begin="0" end="300" period="2.5" departSpeed="max">'
    '<route edges="eb ba aw"/></flow>'
)


def driven(
    folder: Path,
    others: str,
    *sets: str,
    planner: str = "mcts",
    seed: int = 1,
    in_two: bool = False,
    side: tuple[str, ...] = (),
    after: str = "",
) -> dict[str, Any]:
    """The row of an episode among these others, on a road of one lane each way; `in_two` edges
    between its ends; `side`: where people drive, an option of netconvert; `after`: who departs
    later than the ego."""
    if not (folder / "x.net.xml").exists():
        nodes = NODES + '<node id="m" x="300" y="0"/>'
        netconvert(folder, nodes, SHORTER if in_two else EDGES, "", "--opposites.guess", *side)
    ego = (
        '<vehicle id="ego" type="car" depart="20" departSpeed="max"><route edges="wa ab be"/>'
        "</vehicle>"
    )
    cars = others + ego + after  # in the order of departure, or SUMO drops who comes too late
    for whole, parts in IN_TWO.items() if in_two else ():
        cars = cars.replace(whole, parts)
    (folder / "x.rou.xml").write_text(
        '<routes><vType id="car" speedDev="0.1"/><vType id="slow" maxSpeed="4"/>'
        f'<vType id="lorry" vClass="truck" length="10" maxSpeed="7"/>{cars}</routes>'
    )
    scene = {
        "name": "overtakes",
        "sumo": {
            "net": str(folder / "x.net.xml"),
            "routes": [str(folder / "x.rou.xml")],
            "options": {"lanechange.duration": 3},
        },
        "egos": [{"id": "ego"}],
        "planner": {"name": planner},
        "episode": {"time_limit_s": 260},
    }
    (row,) = run_episode(config.build(scene, "test", sets), seed).rows
    return dict(row)


@pytest.mark.slow
@pytest.mark.parametrize("others", [PARKED, SLOW, PARKED + FLOW, SLOW + FLOW])
def test_the_ego_overtakes_about_as_soon_as_sumos_driver(others: str, tmp_path: Path) -> None:
    twin = driven(tmp_path, others, planner="sumo")
    row = driven(tmp_path, others, "sensor.range_m=300")
    assert row["outcome"] == "arrived" and row["imposed_brakes_4"] == 0
    assert row["travel_time_s"] < 1.25 * twin["travel_time_s"]
    assert row["lane_changes"] >= 2
    assert row["detours"] is None  # the lane of the oncoming leads nowhere, and is no missed lane


@pytest.mark.slow
@pytest.mark.parametrize("side", [(), ("--lefthand",)])
@pytest.mark.parametrize("others", [QUICKER, QUICKER + FLOW])
def test_it_goes_on_across_a_plain_junction(
    others: str, side: tuple[str, ...], tmp_path: Path
) -> None:
    """A lorry at half of the limit needs a longer road than each edge is."""
    how: Any = {"in_two": True, "side": side}
    twin = driven(tmp_path, others, planner="sumo", **how)
    row = driven(tmp_path, others, "sensor.range_m=500", **how)
    assert row["outcome"] == "arrived" and row["imposed_brakes_2"] == 0
    assert row["travel_time_s"] < 1.1 * twin["travel_time_s"]
    assert row["lane_changes"] == 2 and row["detours"] is None


@pytest.mark.slow
@pytest.mark.parametrize("failsafe", ["failsafe.on=false", "failsafe.on=true"])
@pytest.mark.parametrize("away", [150, 250])
def test_somebody_appears_while_it_is_beside_the_other(
    away: int, failsafe: str, tmp_path: Path
) -> None:
    """A car departs from the roadside, in the lane in which the ego is: it goes on or back."""
    place = 600 - 184 - away  # the ego is at 184 m then, in the lane of the oncoming since 90 m
    appears = (
        f'<vehicle id="o" type="car" depart="44" departPos="{place}" departSpeed="max" '
        'insertionChecks="none"><route edges="ba aw"/></vehicle>'
    )
    row = driven(tmp_path, QUICKER, "sensor.range_m=500", failsafe, after=appears)
    assert row["outcome"] == "arrived" and row["lane_changes"] >= 2


@pytest.mark.slow
def test_it_may_be_told_not_to(tmp_path: Path) -> None:
    row = driven(tmp_path, SLOW, "ego_model.overtakes=false")
    assert row["outcome"] == "arrived" and row["lane_changes"] == 0
    assert row["travel_time_s"] > 200.0


@pytest.mark.slow
def test_it_waits_where_somebody_always_comes(tmp_path: Path) -> None:
    row = driven(tmp_path, SLOW + STREAM)
    assert row["outcome"] == "arrived" and row["lane_changes"] == 0


@pytest.mark.slow
@pytest.mark.parametrize("sees", [80, 200])
def test_it_waits_where_it_does_not_see_far_enough(sees: int, tmp_path: Path) -> None:
    """With 200 m it once began just before a junction, and others braked with 4.5 m/s2."""
    row = driven(tmp_path, SLOW, f"sensor.range_m={sees}")
    assert row["outcome"] == "arrived" and row["lane_changes"] == 0
    assert row["imposed_brakes_2"] == 0


@pytest.mark.slow
def test_two_hundred_metres_are_enough_for_one_that_stands(tmp_path: Path) -> None:
    row = driven(tmp_path, PARKED, "sensor.range_m=200")
    assert row["outcome"] == "arrived" and row["travel_time_s"] < 100.0
