"""RoadMap against what netconvert was asked to build, against shapely, and against sumolib's own
account of the right of way."""

import gzip
import xml.etree.ElementTree as ET
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import sumo
import sumolib
from helpers_networks import netconvert
from shapely.geometry import LineString, Point

from sumo_mcts.errors import ConfigError
from sumo_mcts.numerics.lanes import jumps, limits
from sumo_mcts.road import (
    ALLWAY,
    IGNORING,
    JUMP,
    LEFT,
    PEOPLE_FIRST,
    PEOPLE_WAIT,
    PRIORITY,
    RIGHT,
    STOP,
    STRAIGHT,
    VEHICLE_CLASSES,
    YIELD,
    ZIPPER,
    RoadMap,
)
from sumo_mcts.world import conflicts as conflict_areas
from sumo_mcts.world.roadmap import lane_index, lane_shape, read_roadmap

GAME = Path(sumo.SUMO_HOME) / "tools" / "game"
WHEEL = [
    "cross/cross.net.xml",
    "ramp/ramp.net.xml",
    "square/square.net.xml",
    "grid6/grid6.net.xml",
    "kuehne/kuehne.net.xml",
    "highway/highway.net.xml",
    "racing/spreewaldring.net.xml",
    "fkk_in/ingolstadt.net.xml.gz",
    "fokr_bs_demo/fokr_bs.net.xml.gz",
]

ARMS = {"W": (-200, 0), "E": (200, 0), "N": (0, 200), "S": (0, -200)}
ACROSS = {"W": "E", "E": "W", "N": "S", "S": "N"}
LEFT_OF = {"W": "N", "N": "E", "E": "S", "S": "W"}  # where a left turn leads, coming from the key
ON_FOOT = (  # options of netconvert: sidewalks, and crossings for people
    *("--sidewalks.guess", "true", "--sidewalks.guess.max-speed", "20"),
    *("--crossings.guess", "true"),
)
RIGHT_OF = {arm: ACROSS[LEFT_OF[arm]] for arm in ARMS}


def crossing(folder: Path, *options: str, node_type: str = "priority") -> str:
    """Four arms of three lanes: right and straight on, straight on, left.

    East-west has priority.
    """
    nodes = f'<node id="C" x="0" y="0" type="{node_type}"/>' + "".join(
        f'<node id="{arm}" x="{x}" y="{y}"/>' for arm, (x, y) in ARMS.items()
    )
    edges = connections = ""
    for arm in ARMS:
        rank = 3 if arm in "WE" else 1
        edges += (
            f'<edge id="{arm}C" from="{arm}" to="C" numLanes="3" priority="{rank}"/><edge '
            f'id="C{arm}" from="C" to="{arm}" numLanes="3" priority="{rank}"/>'
        )
        for lane, out, target in (
            (0, RIGHT_OF[arm], 0),
            (0, ACROSS[arm], 0),
            (1, ACROSS[arm], 1),
            (2, LEFT_OF[arm], 2),
        ):
            connections += (
                f'<connection from="{arm}C" to="C{out}" fromLane="{lane}" toLane="{target}"/>'
            )
    return netconvert(folder, nodes, edges, connections, *options)


@pytest.fixture(scope="module")
def crossing_file(tmp_path_factory: pytest.TempPathFactory) -> str:
    return crossing(tmp_path_factory.mktemp("crossing"))


@pytest.fixture(scope="module")
def road(crossing_file: str) -> RoadMap:
    return read_roadmap(crossing_file)


def successors(road: RoadMap, lane: int) -> list[int]:
    return road.successor[road.successor_offset[lane] : road.successor_offset[lane + 1]].tolist()


def chain(road: RoadMap, origin: str, target: str) -> list[int]:
    """Internal lanes from one ordinary lane to another."""
    number = lane_index(road)
    for lane in successors(road, number[origin]):
        if road.exit[lane] == number[target]:
            lanes = [lane]
            while road.internal[successors(road, lanes[-1])[0]]:
                lanes += successors(road, lanes[-1])
            return lanes
    raise AssertionError(f"no way from {origin} to {target}")


def conflicts(road: RoadMap, a: list[int], b: list[int]) -> list[int]:
    """Conflict entries of the lanes of a with those of b."""
    return [
        k
        for lane in a
        for k in range(road.conflict_offset[lane], road.conflict_offset[lane + 1])
        if road.conflict_lane[k] in b
    ]


def yields(road: RoadMap, a: list[int], b: list[int]) -> set[bool]:
    return {bool(road.conflict_yields[k]) for k in conflicts(road, a, b)}


def edit_lane(net_file: str, lane_id: str, target: Path, **attributes: str) -> str:
    tree = ET.parse(net_file)
    (lane,) = (lane for lane in tree.iter("lane") if lane.get("id") == lane_id)
    lane.attrib.update(attributes)
    tree.write(target)
    return str(target)


# --- the crossing ---


def test_lanes_and_neighbours(road: RoadMap) -> None:
    number = lane_index(road)
    right, middle, left = (number[f"WC_{i}"] for i in range(3))
    assert (road.left[right], road.left[middle], road.left[left]) == (middle, left, -1)
    assert (road.right[right], road.right[middle], road.right[left]) == (-1, right, middle)
    assert road.index[[right, middle, left]].tolist() == [0, 1, 2]
    assert {road.edge_ids[road.edge[i]] for i in (right, middle, left)} == {"WC"}
    shape = lane_shape(road, middle)
    assert shape[0, 0] == pytest.approx(-200, abs=0.1) and np.all(
        shape[:, 1] == pytest.approx(-4.8)
    )  # second lane right of the axis, driving on the right
    assert (
        not road.internal[middle]
        and road.exit[middle] == middle
        and road.junction[middle] == -1
        and road.signal[middle] == -1
    )
    assert road.speed[middle] == pytest.approx(13.89, abs=0.05) and road.width[middle] == 3.2


@pytest.mark.parametrize("arm", sorted(ARMS))
def test_connections_lead_where_they_were_built_to(road: RoadMap, arm: str) -> None:
    ways = {
        f"C{RIGHT_OF[arm]}_0": (0, RIGHT),
        f"C{ACROSS[arm]}_0": (0, STRAIGHT),
        f"C{ACROSS[arm]}_1": (1, STRAIGHT),
        f"C{LEFT_OF[arm]}_2": (2, LEFT),
    }
    for target, (lane, direction) in ways.items():
        path = chain(road, f"{arm}C_{lane}", target)
        assert all(road.internal[path]) and set(road.direction[path]) == {direction}
        assert {road.lane_ids[i] for i in road.exit[path]} == {target} and {
            road.junction_ids[i] for i in road.junction[path]
        } == {"C"}
        assert successors(road, path[-1]) == [lane_index(road)[target]]
        assert set(road.rule[path[1:]]) <= {PRIORITY}


def test_left_turn_waits_inside_the_junction(road: RoadMap) -> None:
    assert len(chain(road, "WC_2", "CN_2")) == 2 and len(chain(road, "WC_1", "CE_1")) == 1


def test_rules_of_a_priority_junction(road: RoadMap) -> None:
    assert road.rule[chain(road, "WC_1", "CE_1")[0]] == PRIORITY
    assert road.rule[chain(road, "WC_2", "CN_2")[0]] == YIELD
    assert road.rule[chain(road, "SC_1", "CN_1")[0]] == YIELD


@pytest.mark.parametrize("arm", ["W", "E", "N", "S"])
def test_left_turn_yields_to_oncoming_traffic(road: RoadMap, arm: str) -> None:
    left = chain(road, f"{arm}C_2", f"C{LEFT_OF[arm]}_2")
    for lane in (0, 1):
        oncoming = chain(road, f"{ACROSS[arm]}C_{lane}", f"C{arm}_{lane}")
        assert yields(road, left, oncoming) == {True} and yields(road, oncoming, left) == {False}


def test_minor_road_yields_to_the_major_one(road: RoadMap) -> None:
    minor, major = chain(road, "SC_1", "CN_1"), chain(road, "WC_1", "CE_1")
    assert yields(road, minor, major) == {True} and yields(road, major, minor) == {False}


def test_paths_that_keep_clear_have_no_entry(road: RoadMap) -> None:
    left, right, straight = (
        {arm: chain(road, f"{arm}C_{lane}", f"C{to[arm]}_{lane}") for arm in ARMS}
        for lane, to in ((2, LEFT_OF), (0, RIGHT_OF), (1, ACROSS))
    )
    for arm in ARMS:
        assert not conflicts(road, straight[arm], straight[ACROSS[arm]])  # oncoming
        assert not conflicts(
            road, straight[arm], chain(road, f"{arm}C_0", f"C{ACROSS[arm]}_0")
        )  # beside it
        assert not conflicts(road, straight[arm], left[arm])  # from the neighbouring lane
        assert not conflicts(
            road, right[arm], chain(road, f"{arm}C_0", f"C{ACROSS[arm]}_0")
        )  # from the same lane
        assert not conflicts(
            road, left[arm], left[ACROSS[arm]]
        )  # opposing left turns pass in front of each other


def test_merges_reach_the_end_of_both_lanes(road: RoadMap) -> None:
    right, straight = chain(road, "SC_0", "CE_0"), chain(road, "WC_0", "CE_0")
    (k,) = conflicts(road, right, straight)
    assert road.conflict_merge[k] and road.conflict_yields[k]
    assert road.conflict_end[k] == pytest.approx(road.length[right[0]]) and road.conflict_other_end[
        k
    ] == pytest.approx(road.length[straight[0]])
    assert (
        0 < road.conflict_begin[k] < road.conflict_end[k]
        and 0 < road.conflict_other_begin[k] < road.conflict_other_end[k]
    )
    (back,) = conflicts(road, straight, right)
    assert road.conflict_merge[back] and not road.conflict_yields[back]


def test_crossing_is_no_merge(road: RoadMap) -> None:
    (k,) = conflicts(road, chain(road, "SC_1", "CN_1"), chain(road, "WC_1", "CE_1"))
    assert not road.conflict_merge[k]
    # the two centre lines cross at (4.8, -4.8) at a right angle
    lane = chain(road, "SC_1", "CN_1")[0]
    middle = (road.conflict_begin[k] + road.conflict_end[k]) / 2
    assert LineString(lane_shape(road, lane)).interpolate(middle).distance(Point(4.8, -4.8)) < 0.3
    assert road.conflict_end[k] - road.conflict_begin[k] == pytest.approx(2 * 2.2, abs=0.6)


def test_stretches_agree_with_shapely(road: RoadMap) -> None:
    lines = {i: LineString(lane_shape(road, i)) for i in np.flatnonzero(road.internal)}
    seen = 0
    for lane, line in lines.items():
        for k in range(road.conflict_offset[lane], road.conflict_offset[lane + 1]):
            shared = line.intersection(lines[road.conflict_lane[k]].buffer(2.2, quad_segs=32))
            at = [
                line.project(Point(p))
                for part in getattr(shared, "geoms", [shared])
                for p in part.coords
            ]
            scale = road.length[lane] / line.length
            assert road.conflict_begin[k] == pytest.approx(min(at) * scale, abs=0.5)
            assert road.conflict_end[k] == pytest.approx(max(at) * scale, abs=0.5)
            seen += 1
    assert seen > 40


def test_every_meeting_of_paths_has_an_entry(road: RoadMap) -> None:
    paths = {
        (o, e): chain(road, road.lane_ids[o], road.lane_ids[e])
        for o in np.flatnonzero(~road.internal)
        for e in {road.exit[i] for i in successors(road, o)}
    }
    for (origin_a, path_a), (origin_b, path_b) in combinations(
        [(o, p) for (o, _), p in paths.items()], 2
    ):
        for a in path_a:
            for b in path_b:
                gap = LineString(lane_shape(road, a)).distance(LineString(lane_shape(road, b)))
                if origin_a == origin_b or gap > 2.25:
                    assert not conflicts(road, [a], [b])
                elif gap < 1.85:
                    assert conflicts(road, [a], [b]) and conflicts(road, [b], [a])


# --- variants ---


def test_signals(tmp_path: Path) -> None:
    net_file = crossing(tmp_path, "--tls.set", "C")
    road = read_roadmap(net_file)
    assert road.signal_ids == ("C",)
    for connection in ET.parse(net_file).iter("connection"):
        if connection.get("tl"):
            first = chain(
                road,
                f"{connection.get('from')}_{connection.get('fromLane')}",
                f"{connection.get('to')}_{connection.get('toLane')}",
            )[0]
            assert road.signal[first] == 0 and road.link[first] == int(
                connection.get("linkIndex", "-1")
            )
    lanes = np.flatnonzero(road.signal >= 0)
    assert sorted(road.link[lanes]) == list(range(16)) and np.all(road.link[road.signal < 0] == -1)
    assert road.rule[chain(road, "WC_2", "CN_2")[0]] == YIELD
    # turning right from the major road there is nobody to let pass
    assert road.rule[chain(road, "WC_0", "CS_0")[0]] == PRIORITY


@pytest.mark.parametrize(
    ("node_type", "minor", "major"),
    [
        ("priority_stop", STOP, PRIORITY),
        ("allway_stop", ALLWAY, ALLWAY),
        ("right_before_left", YIELD, YIELD),
        ("unregulated", PRIORITY, PRIORITY),
    ],
)
def test_rules_by_type_of_junction(tmp_path: Path, node_type: str, minor: int, major: int) -> None:
    road = read_roadmap(crossing(tmp_path, node_type=node_type))
    assert (
        road.rule[chain(road, "SC_1", "CN_1")[0]] == minor
        and road.rule[chain(road, "WC_1", "CE_1")[0]] == major
    )


def test_right_before_left(tmp_path: Path) -> None:
    road = read_roadmap(crossing(tmp_path, node_type="right_before_left"))
    from_west, from_south = (
        chain(road, "WC_1", "CE_1"),
        chain(road, "SC_1", "CN_1"),
    )  # coming from the west, the south is on the right
    assert yields(road, from_west, from_south) == {True} and yields(
        road, from_south, from_west
    ) == {False}


def test_zipper(tmp_path: Path) -> None:
    nodes = (
        '<node id="A" x="0" y="0"/><node id="B" x="200" y="0" type="zipper"/><node id="C" '
        'x="400" y="0"/>'
    )
    edges = '<edge id="AB" from="A" to="B" numLanes="2"/><edge id="BC" from="B" to="C"/>'
    ways = "".join(f'<connection from="AB" to="BC" fromLane="{i}" toLane="0"/>' for i in (0, 1))
    road = read_roadmap(netconvert(tmp_path, nodes, edges, ways))
    right, left = chain(road, "AB_0", "BC_0"), chain(road, "AB_1", "BC_0")
    assert road.rule[right[0]] == road.rule[left[0]] == ZIPPER
    (k,) = conflicts(road, right, left)
    assert road.conflict_merge[k]


@pytest.mark.parametrize(("options", "lefthand"), [((), False), (("--lefthand",), True)])
@pytest.mark.parametrize("lanes", [1, 2])
def test_on_which_side_people_drive(
    lanes: int, options: tuple[str, ...], lefthand: bool, tmp_path: Path
) -> None:
    """With one lane each way it cannot be seen from the lanes of an edge."""
    nodes = '<node id="a" x="0" y="0"/><node id="b" x="300" y="0"/>'
    edges = "".join(
        f'<edge id="{way}" from="{way[0]}" to="{way[1]}" numLanes="{lanes}"/>'
        for way in ("ab", "ba")
    )
    assert read_roadmap(netconvert(tmp_path, nodes, edges, "", *options)).lefthand == lefthand


def foes(road: RoadMap) -> dict[tuple[tuple[str, str], tuple[str, str]], bool]:
    """Connections that meet, as pairs of lanes, and whether the first has to yield to the second."""
    way = {}
    for origin in np.flatnonzero(~road.internal).tolist():
        for first in successors(road, origin):
            inside = first
            while road.internal[inside]:
                way[inside] = road.lane_ids[origin], road.lane_ids[road.exit[first]]
                inside = successors(road, inside)[0]
    here = np.repeat(np.arange(len(road.length)), np.diff(road.conflict_offset)).tolist()
    others, yields = road.conflict_lane.tolist(), road.conflict_yields.tolist()
    return {(way[a], way[b]): y for a, b, y in zip(here, others, yields, strict=True)}


def _place(road: RoadMap, lane: int) -> int:
    """Where the lane stands among the successors."""
    return int(np.flatnonzero(road.successor == lane)[0])


CONTROLS = ("priority", "right_before_left", "traffic_light", "priority_stop", "allway_stop")


@pytest.mark.parametrize("control", CONTROLS)
def test_without_internal_lanes_each_connection_has_a_lane_of_its_own(
    tmp_path: Path, control: str
) -> None:
    """Vehicles jump over the junction. Lights, signs and right of way are as with lanes inside;
    only who meets whom is as SUMO says, and not as the paths are drawn."""
    inside, over = (
        read_roadmap(crossing(tmp_path, *options, node_type=control))
        for options in ((), ("--no-internal-links", "true"))
    )
    for lane in np.flatnonzero(jumps(over)).tolist():
        assert over.length[lane] == JUMP and over.junction[lane] >= 0
        assert successors(over, lane) == [over.exit[lane]]
        origin = int(np.searchsorted(over.successor_offset, _place(over, lane), side="right")) - 1
        assert lane_shape(over, lane)[0] == pytest.approx(lane_shape(over, origin)[-1])
        assert lane_shape(over, lane)[1] == pytest.approx(lane_shape(over, over.exit[lane])[0])
        path = chain(inside, over.lane_ids[origin], over.lane_ids[over.exit[lane]])[0]
        for field in ("direction", "link", *(() if control == "traffic_light" else ("rule",))):
            assert getattr(over, field)[lane] == getattr(inside, field)[path]
        assert (over.signal[lane] >= 0) == (control == "traffic_light")
    ordinary = np.flatnonzero(~over.internal)
    assert all(jumps(over)[successors(over, int(lane))].all() for lane in ordinary)
    drawn, listed = foes(inside), foes(over)
    assert drawn and drawn.keys() <= listed.keys()
    # at lights netconvert has who goes straight on yield to those who wait inside, if they can
    assert all(drawn[pair] == listed[pair] for pair in drawn if control != "traffic_light")
    assert all(drawn[pair] >= listed[pair] for pair in drawn)


def test_a_network_with_lanes_inside_has_no_jumps(road: RoadMap) -> None:
    assert road.internal.any() and not jumps(road).any()


def test_permissions_of_a_connection_hold_on_its_internal_lanes(tmp_path: Path) -> None:
    nodes = '<node id="A" x="0" y="0"/><node id="B" x="100" y="0"/><node id="C" x="200" y="0"/>'
    edges = (
        '<edge id="AB" from="A" to="B" numLanes="2"/><edge id="BC" from="B" to="C" '
        'numLanes="2" disallow="truck pedestrian"/>'
    )
    ways = (
        '<connection from="AB" to="BC" fromLane="0" toLane="0" allow="bus taxi"/><connection '
        'from="AB" to="BC" fromLane="1" toLane="1"/>'
    )
    net_file = netconvert(tmp_path, nodes, edges, ways)
    via = next(str(c.get("via")) for c in ET.parse(net_file).iter("connection") if c.get("allow"))
    road = read_roadmap(
        edit_lane(net_file, via, tmp_path / "y.net.xml", allow="bus passenger taxi")
    )  # whatever the lane itself says

    def names(lane: int) -> set[str]:
        return {name for i, name in enumerate(VEHICLE_CLASSES) if int(road.classes[lane]) >> i & 1}

    number = lane_index(road)
    assert names(number["AB_0"]) == set(VEHICLE_CLASSES) and names(number["BC_1"]) == set(
        VEHICLE_CLASSES
    ) - {"truck", "pedestrian"}
    assert names(chain(road, "AB_0", "BC_0")[0]) == {"bus", "taxi"}


def test_what_single_classes_may_do(tmp_path: Path) -> None:
    """Bans of lane changes as netconvert writes them from OSM, and limits of an edge's type."""
    (tmp_path / "t.typ.xml").write_text(
        '<types><type id="road" speed="30"><restriction vClass="truck" speed="17"/>'
        '<restriction vClass="bus" speed="20"/></type></types>'
    )
    edges = (
        '<edge id="a" from="w" to="m" type="road" numLanes="2">'
        '<lane index="0" changeLeft="authority bus"/><lane index="1" changeRight="authority"/></edge>'
        '<edge id="b" from="m" to="e" numLanes="2" speed="25"/>'
    )
    nodes = '<node id="w" x="0" y="0"/><node id="m" x="200" y="0"/><node id="e" x="400" y="0"/>'
    road = read_roadmap(netconvert(tmp_path, nodes, edges, "", "-t", "t.typ.xml"))
    at = {name: i for i, name in enumerate(road.lane_ids)}
    kind = {name: np.uint64(1 << VEHICLE_CLASSES.index(name)) for name in VEHICLE_CLASSES}
    assert road.change_left[at["a_0"]] == kind["authority"] | kind["bus"]
    assert road.change_right[at["a_1"]] == kind["authority"]
    assert (road.change_left[[at["a_1"], at["b_0"]]] & kind["passenger"] != 0).all()
    lanes = np.array([at["a_0"], at["b_0"]])
    for name, expected in (("truck", [17, 25]), ("bus", [20, 25]), ("passenger", [30, 25])):
        assert limits(road, lanes, VEHICLE_CLASSES.index(name)).tolist() == expected
    both = np.array([VEHICLE_CLASSES.index("truck"), IGNORING])
    assert limits(road, lanes[[0, 0]], both).tolist() == [17, 30]


def test_crossings_for_pedestrians_are_lanes_without_successors(tmp_path: Path) -> None:
    road = read_roadmap(crossing(tmp_path, *ON_FOOT))
    on_foot = [i for i, name in enumerate(road.lane_ids) if name.startswith((":C_c", ":C_w"))]
    assert (
        on_foot
        and all(road.internal[on_foot])
        and {road.junction_ids[i] for i in road.junction[on_foot]} == {"C"}
    )
    assert not set(on_foot) & set(road.successor.tolist()) and not any(
        successors(road, i) for i in on_foot
    )


def test_crossings_are_shown_what_their_own_link_of_the_signal_is(tmp_path: Path) -> None:
    """People have other links than vehicles; without a signal a crossing has none."""
    for control in ("traffic_light", "priority"):
        folder = tmp_path / control
        folder.mkdir()
        road = read_roadmap(crossing(folder, *ON_FOOT, node_type=control))
        on_foot = [i for i, name in enumerate(road.lane_ids) if name.startswith(":C_c")]
        vehicles = [i for i in np.flatnonzero(road.link >= 0) if i not in on_foot]
        assert on_foot
        if control == "priority":
            assert (road.signal[on_foot] == -1).all() and not vehicles
        else:
            links = road.link[on_foot].tolist()
            assert (road.signal[on_foot] == 0).all() and (road.rule[on_foot] == PEOPLE_FIRST).all()
            assert len(set(links)) == len(links) and min(links) > road.link[vehicles].max()


def test_conflicts_are_in_lane_positions(crossing_file: str, road: RoadMap, tmp_path: Path) -> None:
    lane = chain(road, "SC_1", "CN_1")[0]
    longer = read_roadmap(
        edit_lane(
            crossing_file,
            road.lane_ids[lane],
            tmp_path / "longer.net.xml",
            length=str(2 * road.length[lane]),
        )
    )
    mine = slice(road.conflict_offset[lane], road.conflict_offset[lane + 1])
    assert (
        longer.scale[lane] == pytest.approx(0.5 * road.scale[lane])
        and longer.length[lane] == 2 * road.length[lane]
    )
    assert longer.conflict_begin[mine] == pytest.approx(
        2 * road.conflict_begin[mine]
    ) and longer.conflict_end[mine] == pytest.approx(2 * road.conflict_end[mine])
    assert longer.conflict_other_begin[mine] == pytest.approx(road.conflict_other_begin[mine])


def test_lane_whose_points_coincide(crossing_file: str, road: RoadMap, tmp_path: Path) -> None:
    first, second = chain(road, "WC_2", "CN_2")
    x, y = lane_shape(road, second)[0]
    name = road.lane_ids[first]
    odd = read_roadmap(
        edit_lane(
            crossing_file, name, tmp_path / "odd.net.xml", shape=f"{x},{y} {x},{y}", length="0.10"
        )
    )
    shape = lane_shape(odd, first)
    way, onward = np.diff(shape, axis=0)[0], np.diff(lane_shape(odd, second), axis=0)[0]
    assert 0 < odd.scale[first] < 1.0 and np.dot(way, onward) > 0.99 * np.linalg.norm(
        way
    ) * np.linalg.norm(onward)
    assert all(
        np.all(np.isfinite(column))
        for column in (odd.points, odd.point_s, odd.scale, odd.conflict_begin, odd.conflict_end)
    )


@pytest.mark.parametrize(("gap", "meets"), [(1.6, True), (2.05, False)])
def test_cars_that_just_pass_each_other_do_not_conflict(
    crossing_file: str, road: RoadMap, tmp_path: Path, gap: float, meets: bool
) -> None:
    eastward, westward = chain(road, "WC_1", "CE_1"), chain(road, "EC_1", "CW_1")
    x, y = lane_shape(road, eastward[0]).T
    shape = f"{x[-1]},{y[-1] + gap} {x[0]},{y[0] + gap}"
    near = read_roadmap(
        edit_lane(crossing_file, road.lane_ids[westward[0]], tmp_path / "near.net.xml", shape=shape)
    )
    assert (
        bool(conflicts(near, eastward, westward))
        == bool(conflicts(near, westward, eastward))
        == meets
    )


def test_merge_of_lanes_that_are_drawn_apart(
    crossing_file: str, road: RoadMap, tmp_path: Path
) -> None:
    right, straight = chain(road, "SC_0", "CE_0"), chain(road, "WC_0", "CE_0")
    shape = " ".join(f"{x + 3},{y - 3}" for x, y in lane_shape(road, right[0]))
    apart = read_roadmap(
        edit_lane(crossing_file, road.lane_ids[right[0]], tmp_path / "apart.net.xml", shape=shape)
    )
    (k,) = conflicts(apart, right, straight)
    assert apart.conflict_merge[k] and apart.conflict_end[k] == pytest.approx(
        apart.length[right[0]]
    )


def test_lanes_beside_each_other_do_not_conflict_however_they_are_drawn() -> None:
    road = read_roadmap(str(GAME / "highway" / "highway.net.xml"))
    lanes = [lane_index(road)[f":1658939360_0_{i}"] for i in range(3)]
    assert (
        LineString(lane_shape(road, lanes[0])).distance(LineString(lane_shape(road, lanes[1])))
        < 0.5
    )
    assert not conflicts(road, lanes, lanes)


def test_reading_twice_gives_the_same(crossing_file: str, road: RoadMap) -> None:
    for a, b in zip(road, read_roadmap(crossing_file), strict=True):
        assert np.array_equal(a, b)


@pytest.mark.parametrize("size", [1, 500])
def test_conflicts_are_the_same_however_many_paths_are_compared_at_once(
    crossing_file: str, road: RoadMap, monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    monkeypatch.setattr(conflict_areas, "BATCH", size)
    for a, b in zip(road, read_roadmap(crossing_file), strict=True):
        assert np.array_equal(a, b)


# --- wrong input ---


@pytest.mark.parametrize(
    "content",
    [
        None,
        b"",
        b"no xml",
        b"<net",
        b"<routes/>",
        b'<net version="1.20"><edge id="a" from="b" to="c"><lane/></edge></net>',
    ],
)
def test_unreadable_file(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "bad.net.xml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"bad\.net\.xml") as error:
        read_roadmap(str(path))
    assert "\n" not in str(error.value)


def test_truncated_files(crossing_file: str, tmp_path: Path) -> None:
    whole = Path(crossing_file).read_bytes()
    (tmp_path / "cut.net.xml").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "cut.net.xml.gz").write_bytes(gzip.compress(whole)[:2000])
    for name in ("cut.net.xml", "cut.net.xml.gz"):
        with pytest.raises(ConfigError, match="cut"):
            read_roadmap(str(tmp_path / name))


# --- networks of the wheel ---


def check_invariants(road: RoadMap) -> None:
    count = len(road.lane_ids)
    assert len(set(road.lane_ids)) == count and np.all(np.diff(road.point_offset) >= 2)
    assert all(
        np.all(np.isfinite(column))
        for column in (road.points, road.point_s, road.length, road.scale, road.width, road.speed)
    )
    own = np.repeat(np.arange(count), np.diff(road.point_offset))
    steps = np.diff(road.point_s)[own[1:] == own[:-1]]
    assert np.all(steps > 0) and road.scale * road.length == pytest.approx(
        road.point_s[road.point_offset[1:] - 1]
    )
    for side, other in ((road.left, road.right), (road.right, road.left)):
        has = np.flatnonzero(side >= 0)
        assert np.array_equal(other[side[has]], has) and np.array_equal(
            road.edge[side[has]], road.edge[has]
        )

    origin = np.repeat(np.arange(count), np.diff(road.successor_offset))
    gap = np.linalg.norm(
        road.points[road.point_offset[origin + 1] - 1]
        - road.points[road.point_offset[road.successor]],
        axis=1,
    )
    assert len(road.successor) and np.all(gap < 3.0)
    leaving = origin[road.internal[origin]]
    after = road.successor[road.internal[origin]]
    assert np.array_equal(
        np.where(road.internal[after], road.exit[after], after), road.exit[leaving]
    )
    assert len(leaving) == len(set(leaving))  # one way on inside a junction
    assert not road.internal[road.exit[leaving]].any() and np.all(road.junction[leaving] >= 0)

    me = np.repeat(np.arange(count), np.diff(road.conflict_offset))
    assert np.all(road.internal[me]) and np.array_equal(
        road.junction[me], road.junction[road.conflict_lane]
    )
    assert np.array_equal(road.conflict_merge, road.exit[me] == road.exit[road.conflict_lane])
    for begin, end, lane in (
        (road.conflict_begin, road.conflict_end, me),
        (road.conflict_other_begin, road.conflict_other_end, road.conflict_lane),
    ):
        assert (
            np.all(begin >= 0) and np.all(begin < end) and np.all(end <= road.length[lane] + 1e-9)
        )
    there = zip(
        me,
        road.conflict_lane,
        road.conflict_begin,
        road.conflict_end,
        road.conflict_other_begin,
        road.conflict_other_end,
        strict=True,
    )
    back = zip(
        road.conflict_lane,
        me,
        road.conflict_other_begin,
        road.conflict_other_end,
        road.conflict_begin,
        road.conflict_end,
        strict=True,
    )
    assert sorted(there) == sorted(back)


@pytest.mark.parametrize("name", WHEEL)
def test_wheel_networks(name: str) -> None:
    path = str(GAME / name)
    road = read_roadmap(path)
    check_invariants(road)
    number = lane_index(road)
    net = sumolib.net.readNet(path, withInternal=True)
    entries = {}
    for edge in net.getEdges(withInternal=False):
        for lane in edge.getLanes():
            for connection in lane.getOutgoing():
                if connection.getViaLaneID():
                    first = number[connection.getViaLaneID()]
                    assert road.exit[first] == number[connection.getToLane().getID()]
                    entries[first] = connection
    for first, connection in entries.items():
        for k in range(road.conflict_offset[first], road.conflict_offset[first + 1]):
            other = entries.get(int(road.conflict_lane[k]))
            if (
                other is not None and connection.getJunction().getType() != "unregulated"
            ):  # those have no matrix
                assert connection.getFromLane() is not other.getFromLane()
                assert bool(road.conflict_yields[k]) == connection.getJunction().forbids(
                    other, connection
                )


@pytest.mark.parametrize(("first", "rule"), [("true", PEOPLE_FIRST), ("false", PEOPLE_WAIT)])
def test_who_goes_first_on_a_crossing_is_read_whatever_its_name(
    first: str, rule: int, tmp_path: Path
) -> None:
    """An edge is a crossing by its function. The state of the connection to it tells the rest."""
    nodes = '<node id="w" x="-90" y="0"/><node id="c" x="0" y="0"/><node id="e" x="90" y="0"/>'
    roads = "".join(
        f'<edge id="{a}{b}" from="{a}" to="{b}" sidewalkWidth="2"/>'
        for a, b in ("wc", "ce", "ec", "cw")
    )
    over = f'<crossing node="c" edges="ce ec" priority="{first}"/>'
    path = Path(netconvert(tmp_path, nodes, roads, over))
    path.write_text(path.read_text().replace(":c_c0", ":zebra"))
    road = read_roadmap(str(path))
    crossings = np.flatnonzero(road.rule >= PEOPLE_FIRST)
    assert [(road.lane_ids[lane], road.rule[lane]) for lane in crossings] == [(":zebra_0", rule)]
