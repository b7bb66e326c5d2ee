"""Lanes of oncoming traffic to overtake in: in the map, and where SUMO has a vehicle there."""

from pathlib import Path

import libsumo
import numpy as np
import pytest
from helpers_networks import netconvert, simulation

from sumo_mcts.numerics.lanes import with_changes
from sumo_mcts.records.check import map_problem
from sumo_mcts.road import RoadChanges, RoadMap
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
    assert len(road.oncoming) == 4 and road.oncoming[there - len(road.length)] == theirs
    assert (road.left[own], road.right[there], road.left[there]) == (there, own, -1)
    assert road.edge[there] == road.edge[own]
    np.testing.assert_array_equal(lane_shape(road, there), lane_shape(road, theirs)[::-1])
    assert road.successor_offset[there] == road.successor_offset[there + 1]  # it leads nowhere
    assert map_problem(road) == ""


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
def test_a_change_there_and_back_is_driven_and_seen(tmp_path: Path, change_s: float) -> None:
    """SUMO names the lane of the oncoming and counts from its start; the scene has the ego go on
    along its own edge."""
    road = network(tmp_path, "--opposites.guess")
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
            side = {10: 1, 80: -1}.get(step, 0)
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
    across = np.array([ego.d + 3.2 * (name == "ab_1") for ego, name in zip(seen, on, strict=True)])
    assert across.max() == pytest.approx(3.2, abs=0.01) and across.min() > -0.01
    if change_s:  # bit by bit, on both sides of the middle
        assert np.abs(np.diff(across)).max() < 0.12


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
