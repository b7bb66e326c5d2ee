"""What is read of a simulation that changes its roads, vehicles and signals while it runs."""

from collections.abc import Iterator
from pathlib import Path

import libsumo
import pytest
from helpers_networks import netconvert, simulation

from sumo_mcts.numerics.lanes import limit, usable, with_changes
from sumo_mcts.road import VEHICLE_CLASSES, RoadMap
from sumo_mcts.scene import GREEN, RED
from sumo_mcts.world.observe import Change, Observer
from sumo_mcts.world.roadmap import lane_index, read_roadmap

NODES = (
    '<node id="w" x="0" y="0"/><node id="m" x="200" y="0" type="traffic_light"/>'
    '<node id="e" x="400" y="0"/><node id="s" x="200" y="-200"/>'
)
EDGES = (
    '<edge id="a" from="w" to="m" numLanes="2" speed="10"/><edge id="b" from="m" to="e" '
    'numLanes="2" speed="10" disallow="bus"/><edge id="c" from="s" to="m" speed="10"/>'
)
WAYS = (
    '<connection from="a" to="b" fromLane="0" toLane="0"/><connection from="a" to="b" '
    'fromLane="1" toLane="1"/><connection from="c" to="b" fromLane="0" toLane="0"/>'
)
ROUTES = (
    '<routes><vType id="car" speedDev="0"/><vehicle id="ego" type="car" depart="0" departPos="50">'
    '<route edges="a b"/></vehicle><vehicle id="other" type="car" depart="0" departLane="1" '
    'departPos="60"><route edges="a b"/></vehicle></routes>'
)
PASSENGER, BUS = VEHICLE_CLASSES.index("passenger"), VEHICLE_CLASSES.index("bus")


@pytest.fixture
def running(tmp_path: Path) -> Iterator[tuple[RoadMap, Observer]]:
    """The network with its vehicles on the road, and who reads it."""
    net = netconvert(tmp_path, NODES, EDGES, WAYS)
    (tmp_path / "x.rou.xml").write_text(ROUTES)
    with simulation(net, [tmp_path / "x.rou.xml"]):
        libsumo.simulationStep()
        road = read_roadmap(net)
        yield road, Observer(road)


def seen(road: RoadMap, observer: Observer) -> RoadMap:
    """The map as the ego sees it now."""
    scene = observer.scene("ego", Change(), 100.0, timing=False)
    return with_changes(road, scene.changes)


def test_nothing_is_changed_where_nobody_changes_anything(
    running: tuple[RoadMap, Observer],
) -> None:
    road, observer = running
    assert seen(road, observer) is road


def test_limits_permissions_and_lane_changes_are_those_of_the_moment(
    running: tuple[RoadMap, Observer],
) -> None:
    road, observer = running
    lane = lane_index(road)
    libsumo.lane.setMaxSpeed("b_0", 4.0)
    libsumo.lane.setDisallowed("b_1", ["passenger"])
    libsumo.lane.setAllowed("a_1", ["bus"])
    libsumo.lane.setChangePermissions("a_0", ["bus"], 1)
    libsumo.lane.setMaxSpeed("c_0", 0.0)
    now = seen(road, observer)
    assert limit(now, lane["b_0"], PASSENGER) == 4.0
    lanes = [lane[name] for name in ("a_0", "a_1", "b_0", "b_1")]
    assert [bool(usable(now, [i], PASSENGER)[0]) for i in lanes] == [True, False, True, False]
    assert [bool(usable(now, [i], BUS)[0]) for i in lanes] == [True, True, False, True]
    assert now.change_left[lane["a_0"]] == 1 << BUS
    assert now.change_right[lane["a_1"]] == road.change_right[lane["a_1"]]
    libsumo.lane.setMaxSpeed("b_0", 10.0)
    libsumo.lane.setAllowed("b_1", [c for c in VEHICLE_CLASSES if c != "bus"])
    libsumo.lane.setAllowed("a_1", ["all"])
    libsumo.lane.setChangePermissions("a_0", list(VEHICLE_CLASSES), 1)
    libsumo.lane.setMaxSpeed("c_0", 10.0)
    assert seen(road, observer) is road


def test_an_ego_knows_nothing_of_what_another_one_has_come_near(
    running: tuple[RoadMap, Observer],
) -> None:
    _, observer = running
    libsumo.lane.setMaxSpeed("a_0", 4.0)
    assert len(observer.scene("ego", Change(), 100.0, timing=False).changes.lane)
    observer.frame("other", Change(), None)
    other = observer.frame("other", Change(), None)
    assert observer.ego("other", Change()).lane >= 0
    assert set(other.changes.lane.tolist()) <= {observer.ego("other", Change()).lane}


def test_a_limit_of_0_closes_a_lane(running: tuple[RoadMap, Observer]) -> None:
    road, observer = running
    libsumo.lane.setMaxSpeed("b_0", 0.0)
    assert not usable(seen(road, observer), [lane_index(road)["b_0"]], PASSENGER)[0]


def test_the_referee_sees_the_limit_of_the_moment(running: tuple[RoadMap, Observer]) -> None:
    road, observer = running
    frame = observer.frame("ego", Change(), None)
    libsumo.lane.setMaxSpeed("a_0", 4.0)
    frame = observer.frame("ego", Change(), frame)
    assert limit(with_changes(road, frame.changes), frame.ego.lane, PASSENGER) == 4.0


def test_vehicles_may_become_others(running: tuple[RoadMap, Observer]) -> None:
    """The ego at once, the others within a second."""
    _, observer = running
    observer.scene("ego", Change(), 100.0, timing=False)
    libsumo.vehicle.setMaxSpeed("ego", 7.0)
    libsumo.vehicle.setVehicleClass("ego", "bus")
    libsumo.vehicle.setLength("other", 12.0)
    ego = observer.scene("ego", Change(), 100.0, timing=False).ego
    assert (ego.max_speed, ego.vclass) == (7.0, BUS)
    for _ in range(10):
        libsumo.simulationStep()
    assert observer.scene("ego", Change(), 100.0, timing=False).agents.length.tolist() == [12.0]


def test_what_a_program_shows_lasts_until_nobody_knows_when(
    running: tuple[RoadMap, Observer],
) -> None:
    """SUMO names a switch in a day; phases that were replaced are read again."""
    _, observer = running
    links = len(libsumo.trafficlight.getRedYellowGreenState("m"))
    libsumo.trafficlight.setRedYellowGreenState("m", "r" * links)
    signals = observer.timing(200.0, 0.0)
    assert (signals.state == RED).all() and (signals.until == float("inf")).all()
    for letters in ("Gr", "rG"):
        phases = [libsumo.trafficlight.Phase(5, letter * links) for letter in letters]
        libsumo.trafficlight.setProgramLogic("m", libsumo.trafficlight.Logic("own", 0, 0, phases))
        libsumo.trafficlight.setProgram("m", "own")
        libsumo.trafficlight.setPhase("m", 0)
        shown = observer.timing(200.0, 0.0).state[0, :2].tolist()
        assert shown == [GREEN if letter == "G" else RED for letter in letters]
