"""In SUMO: when an ego in a lane that does not lead on along its route takes another way, and
which."""

import math
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import libsumo
import numpy as np
import pytest
from helpers import agents_at, ego_at, lights
from helpers_detour import AROUND, BACK, NO_CHANGE, network, routes
from helpers_model import lanes_east, scenario
from helpers_networks import simulation

from sumo_mcts.config import ScenarioConfig, build
from sumo_mcts.driver import missed_lane
from sumo_mcts.driver.missed_lane import MissedLane
from sumo_mcts.driver.missed_stop import MissedStop
from sumo_mcts.driver.vehicle import EgoVehicle, running_world
from sumo_mcts.road import RoadChanges
from sumo_mcts.scene import Decision, EgoState, Follow, Release, Scene

PATIENCE = 10.0
BLOCKED = ("in", "left", "goal")


def config(until: str | None = None, patience: float | None = PATIENCE) -> ScenarioConfig:
    return build(
        {
            "name": "x",
            "sumo": {"net": libsumo.simulation.getOption("net-file")},
            "egos": [{"id": "ego", **({"until": until} if until else {})}],
            "ego_model": {"reroute_after_s": patience},
        },
        "test",
    )


def drive(
    seconds: float,
    until: str | None = None,
    patience: float | None = PATIENCE,
    *,
    sumo: bool = False,
) -> Iterator[tuple[float, EgoState]]:
    """The ego at each decision, for so many seconds: it drives to the end of its lane, and on where
    that leads along its route, without a lane change. `sumo`: SUMO drives."""
    while "ego" not in libsumo.vehicle.getIDList():
        libsumo.simulationStep()
    world = running_world(0.5)
    ego = EgoVehicle("ego", config(until, patience), world, np.random.SeedSequence(1))
    ends = libsumo.simulation.getTime() + seconds
    while libsumo.simulation.getTime() < ends and world.observer.present("ego"):
        ego.catch_up()
        if ego.due():
            state = ego.scene().ego
            yield libsumo.simulation.getTime(), state
            command = Release() if sumo else Follow(_speeds(state), 0)
            ego.accept(Decision(command, None, (), -1, "", 0, 0))
        ego.before_step()
        libsumo.simulationStep()


def _speeds(ego: EgoState) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Five steps: at 10 m/s, and to a stand behind another or at the end of a lane that does not
    lead on."""
    get, v, s, speeds = libsumo.vehicle, ego.v, ego.s, []
    route = get.getRoute("ego")[get.getRouteIndex("ego") :]
    lane = get.getLaneID("ego")
    onto = {link[0].rpartition("_")[0] for link in libsumo.lane.getLinks(lane)}
    goes_on = lane.startswith(":") or len(route) < 2 or route[1] in onto
    ahead = get.getLeader("ego", 100.0)
    free = math.inf if not ahead else s + ahead[1]
    end = min(free, math.inf if goes_on else libsumo.lane.getLength(lane) - 1.5)
    for _ in range(5):
        left = max(end - s, 0.0)
        v = max(min(v + 0.2, 10.0, math.sqrt(2.0 * left) if left < 1e3 else 10.0), 0.0)
        v = 0.0 if left < 0.1 else v
        s += 0.1 * v
        speeds.append(v)
    return np.array(speeds)


def story(seen: list[tuple[float, EgoState]]) -> list[tuple[float, str]]:
    """What was done about missed lanes, and when."""
    return [(time, ego.detour) for time, ego in seen if ego.detour]


def stood_before(seen: list[tuple[float, EgoState]], time: float) -> float:
    """Since when the ego has stood without a break, s."""
    moving = [t for t, ego in seen if t <= time and ego.v >= 0.1]
    return time - max(moving, default=0.0)


def test_after_its_patience_it_goes_round(tmp_path: Path) -> None:
    with simulation(network(tmp_path, AROUND), [routes(tmp_path)]):
        seen = list(drive(150.0))
        ((time, said),) = story(seen)
        assert "ego" not in libsumo.vehicle.getIDList()
    assert stood_before(seen, time) == pytest.approx(PATIENCE, abs=0.6)
    assert said == (
        "takes another way, by out around goal: in_0 does not lead to left; stood there 10 s"
    )
    assert [ego.reroutes for t, ego in seen if t < time][-1] == 0
    assert {ego.reroutes for t, ego in seen if t >= time} == {1}
    ways = [ego.route for t, ego in seen if t >= time]
    assert len(ways[0]) == 4 and len(ways[-1]) == 1


def test_what_was_before_its_departure_is_no_waiting(tmp_path: Path) -> None:
    begin = 'depart="100" departPos="last" departSpeed="0"'
    with simulation(network(tmp_path, AROUND), [routes(tmp_path, begin=begin)]):
        seen = list(drive(60.0))
    ((time, _),) = story(seen)
    assert time > 100.0 + PATIENCE


def test_it_waits_where_it_is_told_to(tmp_path: Path) -> None:
    with simulation(network(tmp_path, AROUND), [routes(tmp_path)]):
        seen = list(drive(90.0, patience=None))
        assert libsumo.vehicle.getRoute("ego") == BLOCKED
    assert not story(seen)


def test_where_sumo_drives_the_route_stays(tmp_path: Path) -> None:
    net = network(tmp_path, AROUND, lanes=NO_CHANGE)
    with simulation(net, [routes(tmp_path, queue="")]):
        seen = list(drive(60.0, sumo=True))
        assert libsumo.vehicle.getRoute("ego") == BLOCKED
    assert not story(seen)


def test_without_another_way_it_waits_and_says_so_every_time(tmp_path: Path) -> None:
    with simulation(network(tmp_path), [routes(tmp_path)]):
        seen = list(drive(80.0))
        assert libsumo.vehicle.getRoute("ego") == BLOCKED
    (first, said), (second, _), *_ = story(seen)
    assert said.startswith("waits on, since no other way leads from here to the goal: in_0")
    assert second - first == pytest.approx(PATIENCE, abs=0.6)
    assert {ego.reroutes for _, ego in seen} == {0}


def test_a_closed_way_is_none(tmp_path: Path) -> None:
    with simulation(network(tmp_path, AROUND), [routes(tmp_path)]):
        libsumo.lane.setDisallowed("around_0", ["passenger"])
        seen = list(drive(60.0))
    assert all(said.startswith("waits on") for _, said in story(seen)) and story(seen)


def test_where_no_lane_change_is_left_it_does_not_even_slow_down(tmp_path: Path) -> None:
    net = network(tmp_path, AROUND, lanes=NO_CHANGE)
    with simulation(net, [routes(tmp_path, queue="")]):
        seen = list(drive(150.0))
        assert "ego" not in libsumo.vehicle.getIDList()
    ((time, said),) = story(seen)
    assert "no lane change leads there" in said
    assert time < 3.0 and min(ego.v for _, ego in seen) > 5.0


def test_it_comes_back_and_waits_longer_each_time(tmp_path: Path) -> None:
    """The only other way leads back to the same lane, and nobody lets it in there."""
    with simulation(network(tmp_path, BACK), [routes(tmp_path)]):
        seen = list(drive(400.0))
    times = [time for time, said in story(seen)]
    stood = [stood_before(seen, time) for time in times]
    assert stood == pytest.approx([PATIENCE * 2.0**n for n in range(len(times))], abs=0.6)
    assert len(times) == 3
    assert seen[-1][1].reroutes == 3


def test_a_red_light_is_no_reason_to_leave(tmp_path: Path) -> None:
    """At red it could not go the other way either: only the time at green counts."""
    net = network(tmp_path, AROUND, kind="traffic_light")
    with simulation(net, [routes(tmp_path)]):
        (light,) = libsumo.trafficlight.getIDList()
        states = libsumo.trafficlight.getRedYellowGreenState(light)
        libsumo.trafficlight.setRedYellowGreenState(light, "r" * len(states))
        seen = []
        for time, ego in drive(150.0):
            seen.append((time, ego))
            if time > 80.0:
                libsumo.trafficlight.setRedYellowGreenState(light, "G" * len(states))
    ((time, _),) = story(seen)
    assert time == pytest.approx(80.0 + PATIENCE, abs=1.1)


def test_behind_another_vehicle_it_is_no_lane_end_that_stops_it(tmp_path: Path) -> None:
    first = (
        '<vehicle id="first" type="car" depart="0" departLane="0" departPos="200" departSpeed="0">'
        '<route edges="in out"/><stop lane="in_0" startPos="199" endPos="200" duration="9999"/>'
        "</vehicle>"
    )
    with simulation(network(tmp_path, AROUND), [routes(tmp_path, queue=first)]):
        seen = list(drive(60.0))
    assert seen[-1][1].v < 0.1 and not story(seen)


def test_stops_stay_in_the_schedule(tmp_path: Path) -> None:
    """A stop that the other way passes is kept."""
    stop = '<stop edge="goal" endPos="100" duration="5"/>'
    with simulation(network(tmp_path, AROUND), [routes(tmp_path, inside=stop)]):
        for _, ego in drive(150.0):
            if ego.reroutes:
                break
        assert libsumo.vehicle.getRoute("ego") == ("in", "out", "around", "goal")
        assert libsumo.vehicle.getStopParameter("ego", 0, "edge") == "goal"


def test_it_does_not_leave_out_its_goal(tmp_path: Path) -> None:
    """On the edge that it cannot reach: no other way will do."""
    with simulation(network(tmp_path, AROUND), [routes(tmp_path)]):
        seen = list(drive(80.0, "left"))
        assert libsumo.vehicle.getRoute("ego") == BLOCKED
    assert all(said.startswith("waits on") for _, said in story(seen)) and story(seen)


LEFT_OUT = '<stop lane="left_0" endPos="100" duration="5"/>'


@pytest.mark.parametrize("more", ["", '<stop lane="goal_0" endPos="100" duration="5"/>'])
@pytest.mark.parametrize("lanes", ["", NO_CHANGE])
def test_after_its_patience_it_leaves_out_the_stop_that_it_cannot_reach(
    lanes: str, more: str, tmp_path: Path
) -> None:
    """And no other one. Before, it waited for ever."""
    net = network(tmp_path, AROUND, lanes=lanes)
    with simulation(net, [routes(tmp_path, inside=LEFT_OUT + more)]):
        seen = []
        for time, ego in drive(80.0):
            seen.append((time, ego))
            if ego.reroutes:
                break
        get = libsumo.vehicle
        assert get.getRoute("ego") == ("in", "out", "around", "goal")
        edges = [get.getStopParameter("ego", i, "edge") for i in range(len(get.getStops("ego")))]
        assert edges == (["goal"] if more else [])
    time, said = story(seen)[-1]
    assert "by out around goal, without its stop on left: in_0 does not lead to left" in said
    assert stood_before(seen, time) >= PATIENCE - 0.6


def test_after_where_it_has_to_be_the_route_stays_as_it_was(tmp_path: Path) -> None:
    """It goes back to the lane's end for its goal `left`, and from there on along its own route."""
    with simulation(network(tmp_path, AROUND, BACK), [routes(tmp_path)]):
        for _, ego in drive(80.0, "left"):
            if ego.reroutes:
                break
        assert libsumo.vehicle.getRoute("ego") == ("in", "out", "back", "in", "left", "goal")


def test_a_stop_that_it_serves_is_no_waiting_for_a_gap(tmp_path: Path) -> None:
    stop = '<stop lane="in_0" startPos="280" endPos="290" duration="40"/>'
    with simulation(network(tmp_path, AROUND), [routes(tmp_path, inside=stop)]):
        seen, held = [], 0.0
        for time, ego in drive(100.0):
            seen.append((time, ego))
            held = time if libsumo.vehicle.isStopped("ego") else held
    ((time, _),) = story(seen)
    assert 40.0 < held < time - PATIENCE


def test_it_looks_along_the_whole_route_once_a_lane() -> None:
    """On a route of 80 edges that took 6 ms in each decision."""
    road = lanes_east(3)
    watch = MissedLane("ego", road, scenario(), 0.5)
    unchanged = RoadChanges()
    closed = RoadChanges(*(np.array([x]) for x in (2, 13.9, 0, 0, 0)))
    with mock.patch.object(
        missed_lane, "changes_onward", wraps=missed_lane.changes_onward
    ) as asked:
        for k, (lane, changes) in enumerate(
            [("a_0", unchanged), ("a_0", unchanged), ("a_1", unchanged), ("a_1", closed)]
        ):
            ego = ego_at(road, lane, 10.0 * k, 10.0)
            watch.note(Scene(0.5 * k, 0.1, ego, agents_at(road), lights(), changes))
    assert asked.call_count == 3


def test_where_it_takes_another_way_no_stop_is_given_up_in_the_same_moment(tmp_path: Path) -> None:
    """On the new route the next stop may be another one than that which was waited for."""
    notes = []
    with (
        simulation(network(tmp_path, AROUND), [routes(tmp_path)]),
        mock.patch.object(MissedStop, "note", lambda _, scene: notes.append(scene.time) or ""),
    ):
        ((time, _),) = story(list(drive(60.0)))
    assert time not in notes and time + 0.5 in [pytest.approx(each) for each in notes]
