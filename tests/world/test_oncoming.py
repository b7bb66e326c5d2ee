"""Lanes of oncoming traffic to overtake in: in the map, and where SUMO has a vehicle there."""

from pathlib import Path

import libsumo
import numpy as np
import pytest
from helpers_networks import netconvert, simulation

from sumo_mcts.model.continuation import collect
from sumo_mcts.numerics.lanes import facing, home_lanes, successors, with_changes
from sumo_mcts.records.check import map_problem
from sumo_mcts.road import VEHICLE_CLASSES, RoadChanges, RoadMap
from sumo_mcts.scene import Follow
from sumo_mcts.world.command import Bounds, Commander
from sumo_mcts.world.observe import Change, Observer
from sumo_mcts.world.roadmap import lane_index, lane_shape, read_roadmap

NODES = '<node id="a" x="0" y="0"/><node id="b" x="400" y="0"/><node id="c" x="700" y="0"/>'
EDGES = "".join(
    f'<edge id="{name}" from="{name[0]}" to="{name[1]}" numLanes="1" speed="20"/>'
    for name in ("ab", "ba", "bc", "cb")
)
CAR = '<vType id="car" speedDev="0" sigma="0"/>'


def network(folder: Path, *options: str) -> RoadMap:
    return read_roadmap(netconvert(folder, NODES, EDGES, "", *options))


def test_the_lane_of_the_oncoming_is_a_lane_beside_the_leftmost(tmp_path: Path) -> None:
    road = network(tmp_path, "--opposites.guess")
    lanes = lane_index(road)
    there, own, theirs = lanes["ab_1"], lanes["ab_0"], lanes["ba_0"]
    assert facing(road)[there] == theirs and facing(road)[theirs] == there
    assert (road.left[own], road.right[there], road.left[there]) == (there, own, -1)
    assert road.edge[there] == road.edge[own]
    np.testing.assert_array_equal(lane_shape(road, there), lane_shape(road, theirs)[::-1])
    assert map_problem(road) == ""


def test_where_traffic_drives_on_the_left_it_is_to_the_right(tmp_path: Path) -> None:
    road = network(tmp_path, "--opposites.guess", "--lefthand")
    lanes = lane_index(road)
    there, own = lanes["ab_1"], lanes["ab_0"]
    assert road.lefthand and home_lanes(road)[there - len(road.length)] == own
    assert (road.right[own], road.left[there], road.right[there]) == (there, own, -1)
    assert map_problem(road) == ""


def names_after(road: RoadMap, lane: str) -> list[str]:
    return [road.lane_ids[after] for after in successors(road, lane_index(road)[lane])]


@pytest.mark.parametrize("side", [(), ("--lefthand",)])
def test_it_leads_on_through_a_plain_junction(side: tuple[str, ...], tmp_path: Path) -> None:
    road = network(tmp_path, "--opposites.guess", *side)
    (inside,) = names_after(road, "ab_1")
    own = int(home_lanes(road)[lane_index(road)[inside] - len(road.length)])
    assert [road.lane_ids[own]] == names_after(road, "ab_0") and road.internal[own]
    assert names_after(road, inside) == ["bc_1"] and names_after(road, "bc_1") == []
    assert road.lane_ids[road.exit[lane_index(road)[inside]]] == "bc_1"


def is_driven_on(road: RoadMap) -> bool:
    """Whether an ego may go on from ab_1 to bc_1."""
    route = tuple(road.edge_ids.index(name) for name in ("ab", "bc"))
    nodes = collect(road, route, VEHICLE_CLASSES.index("passenger"), oncoming=True)
    return bool(nodes.following[0, lane_index(road)["ab_1"]])


def test_the_ego_drives_on_where_nobody_else_is(tmp_path: Path) -> None:
    assert is_driven_on(network(tmp_path, "--opposites.guess"))


def test_it_ends_where_a_side_road_leads_in(tmp_path: Path) -> None:
    """Who turns in there does not expect anybody in the wrong lane."""
    nodes = NODES + '<node id="s" x="400" y="-100"/>'
    side = '<edge id="sb" from="s" to="b" numLanes="1" speed="10" priority="1"/>'
    road = read_roadmap(netconvert(tmp_path, nodes, EDGES + side, "", "--opposites.guess"))
    assert not is_driven_on(road)


def test_it_ends_at_a_light(tmp_path: Path) -> None:
    nodes = NODES.replace('y="0"/><node id="c"', 'y="0" type="traffic_light"/><node id="c"')
    road = read_roadmap(netconvert(tmp_path, nodes, EDGES, "", "--opposites.guess"))
    assert len(road.signal_ids) == 1 and not is_driven_on(road)


def test_its_limit_and_its_classes_are_those_of_the_moment(tmp_path: Path) -> None:
    """The limit of the ego's side, the classes of the lane of the oncoming."""
    road = network(tmp_path, "--opposites.guess")
    lanes = lane_index(road)
    changed = np.array(sorted((lanes["ab_0"], lanes["ba_0"])), np.int32)
    speed = np.where(changed == lanes["ab_0"], 5.0, 20.0)
    classes = np.where(changed == lanes["ab_0"], road.classes[changed], np.uint64(4))
    now = with_changes(
        road,
        RoadChanges(changed, speed, classes, road.change_left[changed], road.change_right[changed]),
    )
    assert now.speed[lanes["ab_1"]] == 5.0 and now.classes[lanes["ab_1"]] == 4
    assert now.speed[lanes["cb_1"]] == road.speed[lanes["cb_1"]]


def test_without_such_lanes_the_map_is_as_it_was(tmp_path: Path) -> None:
    with_them, without = network(tmp_path, "--opposites.guess"), network(tmp_path)
    assert not len(without.oncoming) and "ab_1" not in without.lane_ids
    count = len(without.length)
    assert with_them.lane_ids[:count] == without.lane_ids
    np.testing.assert_array_equal(with_them.length[:count], without.length)
    assert (without.left[lane_index(without)["ab_0"]]) == -1


@pytest.mark.parametrize("change_s", [0.0, 3.0])
@pytest.mark.parametrize("left", [1, -1])  # where the middle of the road is
def test_a_change_there_and_back_is_driven_and_seen(
    tmp_path: Path, change_s: float, left: int
) -> None:
    """SUMO names the lane of the oncoming and counts from its start; the scene has the ego go on
    along its own edge."""
    road = network(tmp_path, "--opposites.guess", *(["--lefthand"] if left < 0 else []))
    lanes = lane_index(road)
    routes = tmp_path / "x.rou.xml"
    routes.write_text(
        f'<routes>{CAR}<vehicle id="ego" type="car" depart="0" departPos="50" departSpeed="10">'
        '<route edges="ab bc"/></vehicle></routes>'
    )
    with simulation(str(tmp_path / "x.net.xml"), [routes], change_s=change_s):
        libsumo.simulationStep()
        observer = Observer(road)
        commander = Commander("ego", road, lanes, Bounds(0.1, change_s, 2.6, 8.0, 20.0))
        seen = []
        for step in range(160):
            side = {10: left, 80: -left}.get(step, 0)
            if step % 5 == 0:
                commander.accept(Follow(np.full(5, 10.0), side))
            commander.before_step()
            libsumo.simulationStep()
            seen.append(observer.ego("ego", commander.change))
        assert libsumo.vehicle.getRoadID("ego") == "ab"
    on = [road.lane_ids[ego.lane] for ego in seen]
    flips = [i for i in range(1, len(on)) if on[i] != on[i - 1]]
    assert [on[i] for i in flips] == ["ab_1", "ab_0"]
    assert [i - begun for i, begun in zip(flips, (10, 80), strict=True)] == [
        pytest.approx(5.0 * change_s, abs=1.0)
    ] * 2
    driven = np.diff([ego.s for ego in seen])
    np.testing.assert_allclose(driven, 1.0, atol=0.02)
    aside = [left * ego.d + 3.2 * (name == "ab_1") for ego, name in zip(seen, on, strict=True)]
    across = np.array(aside)
    assert across.max() == pytest.approx(3.2, abs=0.01) and across.min() > -0.01
    if change_s:  # bit by bit, on both sides of the middle
        assert np.abs(np.diff(across)).max() < 0.12


def test_the_ego_drives_on_there_through_a_plain_junction(tmp_path: Path) -> None:
    """Its change back ends beyond another one."""
    nodes = NODES + '<node id="d" x="900" y="0"/>'
    more = '<edge id="cd" from="c" to="d" speed="20"/><edge id="dc" from="d" to="c" speed="20"/>'
    road = read_roadmap(netconvert(tmp_path, nodes, EDGES + more, "", "--opposites.guess"))
    lanes = lane_index(road)
    routes = tmp_path / "x.rou.xml"
    routes.write_text(
        f'<routes>{CAR}<vehicle id="ego" type="car" depart="0" departPos="300" departSpeed="10">'
        '<route edges="ab bc cd"/></vehicle></routes>'
    )
    with simulation(str(tmp_path / "x.net.xml"), [routes], change_s=3.0):
        libsumo.simulationStep()
        observer = Observer(road)
        commander = Commander("ego", road, lanes, Bounds(0.1, 3.0, 2.6, 8.0, 20.0))
        seen = []
        for step in range(430):
            side = {10: 1, 380: -1}.get(step, 0)
            if step % 5 == 0:
                commander.accept(Follow(np.full(5, 10.0), side))
            commander.before_step()
            libsumo.simulationStep()
            seen.append(observer.ego("ego", commander.change))
    on = [road.lane_ids[ego.lane] for ego in seen]
    edges = [name for i, name in enumerate(on) if not i or on[i - 1] != name]
    assert [name for name in edges if name[0] != ":"] == ["ab_0", "ab_1", "bc_1", "bc_0", "cd_0"]
    assert all(ego.lane >= 0 for ego in seen)
    # lanes inside the junction are 0.1 m long, at one place
    np.testing.assert_allclose(np.diff([ego.x for ego in seen]), 1.0, atol=0.11)
    assert np.abs(np.diff([ego.y for ego in seen])).max() < 0.12
    assert seen[-1].d == pytest.approx(0.0, abs=0.1)


def test_another_that_overtakes_is_seen_there_too(tmp_path: Path) -> None:
    road = network(tmp_path, "--opposites.guess")
    routes = tmp_path / "x.rou.xml"
    routes.write_text(
        f'<routes>{CAR}<vType id="slow" maxSpeed="3"/>'
        '<vehicle id="s" type="slow" depart="0" departPos="60"><route edges="ab bc"/></vehicle>'
        '<vehicle id="x" type="car" depart="0" departPos="20"><route edges="ab bc"/></vehicle>'
        '<vehicle id="ego" type="car" depart="0" departPos="50"><route edges="cb ba"/></vehicle>'
        "</routes>"
    )
    places = set()
    with simulation(str(tmp_path / "x.net.xml"), [routes]):
        libsumo.simulationStep()
        observer = Observer(road)
        for _ in range(250):
            libsumo.vehicle.setSpeed("ego", 0.0)
            libsumo.simulationStep()
            agents = observer.scene("ego", Change(), 1000.0, timing=False).agents
            if "x" in agents.ids:
                i = agents.ids.index("x")
                places.add(road.lane_ids[agents.lane[i]])
                ahead = agents.x[i] + 0.5 * agents.length[i]
                assert (
                    agents.lane[i] < 0
                    or road.lane_ids[agents.lane[i]][:2] != "ab"
                    or (agents.s[i] == pytest.approx(ahead, abs=0.3))
                )
    assert {"ab_0", "ab_1"} <= places
