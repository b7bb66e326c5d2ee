"""Stops on the ego's route, in SUMO: braked for in time, stood for, left. SUMO's own driver says how
long that may take."""

import re
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import libsumo
import pytest
from helpers_networks import netconvert, simulation

from sumo_mcts import Controller, config
from sumo_mcts.episode import run_episode

SPEED = 13.9
PLACES = (
    '<busStop id="bus" lane="ab_0" startPos="150" endPos="170"/>'
    '<containerStop id="box" lane="ab_0" startPos="100" endPos="120"/>'
    '<chargingStation id="plug" lane="bc_0" startPos="100" endPos="120"/>'
    '<parkingArea id="park" lane="ab_0" startPos="100" endPos="160" roadsideCapacity="5"/>'
)


class Served(NamedTuple):
    """A stop in SUMO's own output."""

    lane: str
    place: float
    stood: float  # s


def road(folder: Path) -> None:
    """300 m and 300 m of two lanes each, and a way round to their start."""
    nodes = "".join(
        f'<node id="{name}" x="{x}" y="{y}"/>'
        for name, x, y in (("a", 0, 0), ("b", 300, 0), ("c", 600, 0), ("d", 300, 200))
    )
    edges = "".join(
        f'<edge id="{way}" from="{way[0]}" to="{way[1]}" numLanes="2" speed="{SPEED}"/>'
        for way in ("ab", "bc", "cd", "da")
    )
    netconvert(folder, nodes, edges, "")


def driven(
    folder: Path,
    stops: str,
    planner: str,
    route: str = "ab bc",
    others: str = "",
    more: str = "",
    overrides: tuple[str, ...] = (),
) -> tuple[dict[str, Any], list[Served]]:
    """The ego's row, and the stops that SUMO saw it serve."""
    (folder / "x.add.xml").write_text(f"<additional>{PLACES}</additional>", encoding="utf-8")
    begins = more or 'departSpeed="10" departLane="0"'
    (folder / "x.rou.xml").write_text(
        f'<routes><vType id="car" speedDev="0" sigma="0"/>{others}'
        f'<vehicle id="ego" type="car" depart="1" {begins}><route edges="{route}"/>{stops}'
        "</vehicle></routes>",
        encoding="utf-8",
    )
    output = folder / f"{planner}.xml"
    scene = {
        "name": "stops",
        "sumo": {
            "net": str(folder / "x.net.xml"),
            "routes": [str(folder / "x.rou.xml")],
            "additional": [str(folder / "x.add.xml")],
            "options": {"stop-output": str(output)},
        },
        "egos": [{"id": "ego"}],
        "planner": {"name": planner},
        "episode": {"time_limit_s": 200},
    }
    (row,) = run_episode(config.build(scene, "test", overrides), 1).rows
    text = output.read_text(encoding="utf-8")
    found = [
        dict(re.findall(r'(\w+)="([^"]*)"', each))
        for each in re.findall(r'<stopinfo id="ego"[^>]*>', text)
    ]
    return row, [
        Served(s["lane"], float(s["pos"]), float(s["ended"]) - float(s["started"])) for s in found
    ]


LANE = '<stop lane="ab_{}" endPos="{}" duration="{}"/>'
PARKED = (
    '<vehicle id="parked" type="car" depart="0" departPos="60"><route edges="ab bc"/>'
    '<stop parkingArea="park" duration="500"/></vehicle>'
)
BESIDE = "".join(
    f'<vehicle id="beside{i}" type="car" depart="0" departLane="1" departPos="{60 - 15 * i}" '
    'departSpeed="10"><route edges="ab bc"/></vehicle>'
    for i in range(4)
)
BUS = (
    '<vehicle id="bus" type="car" depart="0" departPos="60"><route edges="ab bc"/>'
    '<stop busStop="bus" duration="40"/></vehicle>'
)
WALKER = (
    '<person id="p" depart="0" departPos="140"><walk from="ab" to="ab" arrivalPos="148"/>'
    '<ride from="ab" to="bc" lines="ego"/></person>'
)
KINDS = {
    "lane": (LANE.format(0, 150, 5), {}),
    "lane beside": (LANE.format(1, 150, 5), {}),
    "lane beside, with traffic": (LANE.format(1, 150, 5), {"others": BESIDE}),
    "bus stop": ('<stop busStop="bus" duration="5"/>', {}),
    "two of two kinds": (
        '<stop containerStop="box" duration="3"/><stop chargingStation="plug" duration="4"/>', {},
    ),
    "parking area": ('<stop parkingArea="park" duration="5"/>', {}),
    "a lot is taken": ('<stop parkingArea="park" duration="5"/>', {"others": PARKED}),
    "off the road": ('<stop lane="ab_0" endPos="150" duration="5" parking="true"/>', {}),
    "until": ('<stop lane="ab_0" endPos="150" duration="1" until="30"/>', {}),
    "near each other": (LANE.format(0, 150, 3) + LANE.format(0, 152, 3), {}),
    "at one place": (LANE.format(0, 150, 3) * 2, {}),
    "first metres": (LANE.format(0, 12, 3), {"more": 'departPos="6" departSpeed="0"'}),
    "end of the route": ('<stop lane="bc_1" duration="5"/>', {}),
    "any lane": ('<stop edge="ab" endPos="150" duration="5"/>', {}),
    "behind another one": ('<stop busStop="bus" duration="5"/>', {"others": BUS}),
    "behind a junction": ('<stop lane="bc_1" endPos="3" duration="5"/>', {}),
    "waits for a person": ('<stop busStop="bus" triggered="true"/>', {"others": WALKER}),
    "waypoint": ('<stop lane="ab_0" startPos="100" endPos="150" speed="4"/>', {}),
    "waypoint until": ('<stop lane="ab_0" startPos="100" endPos="150" speed="4" until="30"/>', {}),
    "waypoint beside": ('<stop lane="ab_1" endPos="200" speed="4"/>', {}),
    "second round": (
        LANE.format(0, 150, 3) + '<stop lane="cd_0" endPos="50" duration="3"/>'
        + LANE.format(0, 50, 3), {"route": "ab bc cd da ab bc"},
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_stops_are_served_as_sumo_s_driver_does(kind: str, tmp_path: Path) -> None:
    """Before, the ego drove past its stop, and SUMO halted it at the end of the edge."""
    stops, more = KINDS[kind]
    longer = 0.6 if "waypoint" in kind else 0.0  # s: it is braked for like any lower limit
    road(tmp_path)
    twin, expected = driven(tmp_path, stops, "sumo", **more)
    row, served = driven(tmp_path, stops, "mcts", **more)
    assert (twin["outcome"], row["outcome"]) == ("arrived", "arrived")
    assert row["max_decel_mps2"] <= 3.31
    if kind != "second round":  # which has turns, too
        assert row["travel_time_s"] <= twin["travel_time_s"] + 1.6 * len(served) + longer
    assert [s.lane for s in served] == [s.lane for s in expected]
    assert [s.place for s in served] == pytest.approx([s.place for s in expected], abs=0.5)
    if "waypoint" not in kind and kind != "until":
        assert [s.stood for s in served] == pytest.approx([s.stood for s in expected], abs=0.2)


def queue(lane: int, front: float, count: int) -> str:
    """Vehicles that stand in a lane for ever, bumper to bumper."""
    return "".join(
        f'<vehicle id="q{i:02d}" type="car" depart="0" departLane="{lane}" departPos="{at}" '
        f'departSpeed="0"><route edges="ab bc"/><stop lane="ab_{lane}" endPos="{at + 0.1:.1f}" '
        'duration="9999"/></vehicle>'
        for i, at in enumerate(front - 7.5 * i for i in range(count))
    )


@pytest.mark.slow
@pytest.mark.parametrize(("front", "where"), [(170.0, "behind others"), (290.0, "beside it")])
def test_a_stop_in_a_full_lane_is_given_up_after_a_while(
    front: float, where: str, tmp_path: Path
) -> None:
    """As SUMO's driver does, the ego stood there for ever."""
    road(tmp_path)
    row, served = driven(
        tmp_path,
        LANE.format(1, 150, 5),
        "mcts",
        others=queue(1, front, int((front - 8.0) // 7.5) if where == "beside it" else 12),
        overrides=("ego_model.reroute_after_s=10",),
    )
    assert (row["outcome"], served) == ("arrived", [])
    assert row["max_decel_mps2"] <= 4.5 and row["longest_stop_s"] < 20.0
    assert f"gives up its stop on ab_1 at 150 m: stood {where} 10 s" in row["detours"]


@pytest.mark.slow
def test_for_a_stop_beside_nobody_brakes_harder_than_its_type(tmp_path: Path) -> None:
    """Too fast for the gentle way to the place, the ego braked with 8 m/s2 where 3 were enough."""
    road(tmp_path)
    row, _ = driven(
        tmp_path,
        LANE.format(1, 40, 5),
        "mcts",
        others=queue(1, 71.0, 9),
        more='departSpeed="13.9" departLane="0"',
        overrides=("ego_model.reroute_after_s=3",),
    )
    assert row["outcome"] == "arrived" and row["max_decel_mps2"] <= 4.51


@pytest.mark.slow
def test_a_stop_is_served_with_steps_of_a_second(tmp_path: Path) -> None:
    stops, more = KINDS["parking area"]
    road(tmp_path)
    slow = {"overrides": ("sumo.step_length_s=1.0",), **more}
    twin, expected = driven(tmp_path, stops, "sumo", **slow)
    row, served = driven(tmp_path, stops, "mcts", **slow)
    assert row["outcome"] == "arrived" and row["max_decel_mps2"] <= 4.5
    assert row["travel_time_s"] <= 1.2 * twin["travel_time_s"]
    assert served == expected


@pytest.mark.slow
@pytest.mark.parametrize("planner", ["idm", "paper"])
def test_other_planners_serve_stops_too(planner: str, tmp_path: Path) -> None:
    road(tmp_path)
    row, served = driven(tmp_path, KINDS["lane"][0], planner)
    assert row["outcome"] == "arrived" and row["max_decel_mps2"] <= 4.5
    assert [s.lane for s in served] == ["ab_0"]


class Loop(NamedTuple):
    """A drive in a loop of the user's own."""

    reasons: list[str]  # of the decisions
    hardest: float  # m/s2 of braking
    stood: float  # s
    arrived: bool


def looped(folder: Path, each: Callable[[Any, float], None]) -> Loop:
    """Drive the ego; `each` is called before each step, with SUMO's vehicles and the time."""
    road(folder)
    routes = folder / "x.rou.xml"
    routes.write_text(
        '<routes><vType id="car" speedDev="0"/><vehicle id="ego" type="car" depart="0" '
        'departSpeed="10" departLane="0"><route edges="ab bc"/></vehicle></routes>',
        encoding="utf-8",
    )
    reasons, speeds, arrived = [], [], False
    with simulation(str(folder / "x.net.xml"), [routes]), Controller("ego") as controller:
        for _ in range(900):
            if "ego" in libsumo.vehicle.getIDList():
                each(libsumo.vehicle, libsumo.simulation.getTime())
                speeds.append(libsumo.vehicle.getSpeed("ego"))
            controller.step()
            if controller.thought is not None:
                reasons.append(controller.thought.decision.reason)
            libsumo.simulationStep()
            arrived |= "ego" in libsumo.simulation.getArrivedIDList()
    braking = [(b - a) / 0.1 for a, b in pairwise(speeds)]
    return Loop(reasons, -min(braking), 0.1 * sum(v < 0.01 for v in speeds), arrived)


@pytest.mark.slow
def test_planner_sumo_is_sumos_own_driver_at_a_stop_too(tmp_path: Path) -> None:
    """However often it is asked: SUMO drives off at once where the stop ends."""
    road(tmp_path)
    stop = LANE.format(0, 150, 5)
    times = {
        driven(tmp_path, stop, "sumo", overrides=(f"planner.period_s={period}",))[0][
            "travel_time_s"
        ]
        for period in (0.5, 1.0)
    }
    assert len(times) == 1


FORK = (  # from the lane that the ego is in only the way round leads on
    '<connection from="ab" to="bd" fromLane="0" toLane="0"/>'
    '<connection from="ab" to="bc" fromLane="1" toLane="1"/>'
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stop", "lane"),
    [(LANE.format(0, 150, 5), "ab_0"), (LANE.format(0, 150, 5).replace("ab", "cf"), "cf_0")],
)
def test_who_takes_another_way_serves_its_stops(stop: str, lane: str, tmp_path: Path) -> None:
    """On the edge that it leaves, and on one to which the other way leads."""
    places = {
        "a": (0, 0),
        "b": (300, 0),
        "c": (600, 0),
        "d": (300, -200),
        "e": (600, -200),
        "f": (900, 0),
    }
    nodes = "".join(f'<node id="{name}" x="{x}" y="{y}"/>' for name, (x, y) in places.items())
    banned = '<lane index="0" changeLeft="emergency"/>'
    edges = "".join(
        f'<edge id="{way}" from="{way[0]}" to="{way[1]}" numLanes="{count}" speed="{SPEED}">'
        f"{banned if way == 'ab' else ''}</edge>"
        for way, count in (("ab", 2), ("bc", 2), ("bd", 1), ("de", 1), ("ec", 1), ("cf", 1))
    )
    netconvert(tmp_path, nodes, edges, FORK)
    row, served = driven(tmp_path, stop, "mcts", route="ab bc cf")
    assert row["outcome"] == "arrived" and row["reroutes"] == 1
    assert [each.lane for each in served] == [lane]


@pytest.mark.slow
def test_a_stop_that_is_added_on_the_way_is_served(tmp_path: Path) -> None:
    def add(vehicle: Any, time: float) -> None:
        if time == pytest.approx(5.0):
            vehicle.setStop("ego", "ab", 180.0, 1, 4.0)

    loop = looped(tmp_path, add)
    assert loop.arrived and loop.hardest <= 4.5
    assert loop.stood == pytest.approx(4.0, abs=1.0)
    assert not any("given up" in reason for reason in loop.reasons)


@pytest.mark.slow
@pytest.mark.parametrize("lane", [0, 1])
def test_a_stop_that_comes_too_late_is_given_up(lane: int, tmp_path: Path) -> None:
    """SUMO would halt the ego at the end of the edge: at once, and for ever on the other lane."""

    def add(vehicle: Any, time: float) -> None:
        if time == pytest.approx(8.0):
            vehicle.setStop("ego", "ab", vehicle.getLanePosition("ego") + 4.0, lane, 4.0)

    loop = looped(tmp_path, add)
    assert loop.arrived and loop.hardest <= 4.5
    assert loop.stood == 0.0
    assert any("given up" in reason for reason in loop.reasons)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["setSpeedFactor", "setMaxSpeed"])
def test_a_lower_speed_of_its_own_is_braked_for_as_a_lower_limit_is(
    method: str, tmp_path: Path
) -> None:
    """Before with 8 m/s2, where SUMO's driver brakes with 4.5."""

    def lower(vehicle: Any, time: float) -> None:
        if time == pytest.approx(8.0):
            getattr(vehicle, method)("ego", 0.5 if method == "setSpeedFactor" else 6.0)

    loop = looped(tmp_path, lower)
    assert loop.arrived and 1.5 < loop.hardest <= 2.5


@pytest.mark.slow
def test_who_is_told_to_go_on_leaves_its_stop(tmp_path: Path) -> None:
    def tell(vehicle: Any, time: float) -> None:
        if time == pytest.approx(5.0):
            vehicle.setStop("ego", "ab", 180.0, 0, 1000.0)
        if time == pytest.approx(25.0):
            assert vehicle.isStopped("ego")
            vehicle.resume("ego")

    loop = looped(tmp_path, tell)
    assert loop.arrived and loop.hardest <= 4.5
