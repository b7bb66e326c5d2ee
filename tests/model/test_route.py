"""The layout of a route against what SUMO knows of its own vehicles, and its speed caps against a
slow twin.

Compared with libsumo for every vehicle of real traffic, every second, on every lane of its present
edge that its class may use:
- the lanes that it can drive from there without a lane change: `next` against getBestLanes' list,
  which SUMO may end early (a bounded look-ahead);
- how far they reach: `reach` without the internal lanes, which SUMO's list leaves out, where the
  list ends before the route does;
- `changes` against the offset to the best lane.
"""

import math
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import libsumo
import naive
import numpy as np
import pytest
import sumo
from helpers import ALL_CLASSES, Lane, build, edges
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts.config import load
from sumo_mcts.config.builtin import root, scenario_path
from sumo_mcts.model.caps import SPACING
from sumo_mcts.model.route import (
    NUMBER,
    UPSTREAM_VIEW,
    RouteMap,
    lane_pose,
    route_map,
)
from sumo_mcts.road import IGNORING, STOP, VEHICLE_CLASSES, RoadMap
from sumo_mcts.scene import EgoState
from sumo_mcts.world.crowd import Cast, write_routes
from sumo_mcts.world.observe import Change, Observer
from sumo_mcts.world.roadmap import lane_index, read_roadmap

GAME = Path(sumo.SUMO_HOME) / "tools" / "game"
GAMES = ["cross", "ramp", "square", "grid6"]
SCENES = ["unprotected-left-turn", "highway-exit", "straight-line"]
LOOK_AHEAD = 9  # lanes in a list that SUMO may end early


class Seen(NamedTuple):
    """One vehicle at one moment."""

    ego: EgoState
    whole: tuple[int, ...]  # its route from the start, edges
    best: tuple[
        tuple[str, float, float, int, bool, tuple[str, ...]], ...
    ]  # getBestLanes; empty inside junctions
    settled: float  # m driven since its last lane change


@cache
def observed(name: str) -> tuple[RoadMap, tuple[Seen, ...]]:
    """A minute of traffic, looked at every second."""
    with TemporaryDirectory() as folder:
        arguments = (
            ["-c", str(GAME / f"{name}.sumocfg")]
            if name in GAMES
            else _scene_arguments(name, Path(folder))
        )
        libsumo.start(
            [
                "sumo",
                *arguments,
                "--no-step-log",
                "true",
                "--no-warnings",
                "true",
                "--message-log",
                "/dev/null",
            ]
        )
        try:
            road = read_roadmap(libsumo.simulation.getOption("net-file"))
            step = libsumo.simulation.getDeltaT()
            return road, tuple(_watch(road, round(60.0 / step), round(1.0 / step)))
        finally:
            libsumo.close()


def _scene_arguments(name: str, folder: Path) -> list[str]:
    config = load(scenario_path(name))
    return [
        "-n",
        str(config.sumo.net),
        "-r",
        ",".join([*config.sumo.routes, str(write_routes(Cast(config.traffic.actors), folder))]),
        "--step-length",
        "0.1",
    ]


def _watch(road: RoadMap, steps: int, every: int) -> list[Seen]:
    observer, edge = Observer(road), {name: i for i, name in enumerate(road.edge_ids)}
    seen: list[Seen] = []
    lane: dict[str, str] = {}
    changed: dict[str, float] = {}
    for k in range(steps):
        libsumo.simulationStep()
        for vehicle in libsumo.vehicle.getIDList():
            here, driven = libsumo.vehicle.getLaneID(vehicle), libsumo.vehicle.getDistance(vehicle)
            before = lane.get(vehicle, "")
            if before != here and (
                not before or before.rpartition("_")[0] == here.rpartition("_")[0]
            ):
                changed[vehicle] = driven
            lane[vehicle] = here
            if k % every == 0:
                whole = tuple(edge[name] for name in libsumo.vehicle.getRoute(vehicle))
                best = () if here.startswith(":") else tuple(libsumo.vehicle.getBestLanes(vehicle))
                seen.append(
                    Seen(observer.ego(vehicle, Change()), whole, best, driven - changed[vehicle])
                )
    return seen


@cache
def laid_out(name: str, route: tuple[int, ...], vclass: int, length: float) -> RouteMap:
    """Its route for one vehicle."""
    return route_map(observed(name)[0], route, vclass, length, 1.0, 100.0, 2.0)


def ordinary_lanes(road: RoadMap, route: RouteMap, node: int) -> list[int]:
    """The lanes of the chain from a node on, without those inside junctions."""
    return [int(route.lane[i]) for i in naive.chain_of(route, node) if not route.internal[i]]


@pytest.mark.parametrize("name", [*GAMES, *SCENES])
def test_lanes_changes_and_reach_are_sumos(name: str) -> None:
    road, seen = observed(name)
    number = lane_index(road)
    compared = cut = 0
    for vehicle in seen:
        for lane_id, _, _, offset, _, following in vehicle.best:
            route = laid_out(name, vehicle.ego.route, vehicle.ego.vclass, vehicle.ego.length)
            (node,) = np.flatnonzero((route.leg == 0) & (route.lane == number[lane_id]))
            chain = [road.lane_ids[i] for i in ordinary_lanes(road, route, int(node))]
            cut += len(following) < len(chain)
            assert chain[: len(following)] == list(following), (vehicle.ego.id, lane_id)
            assert len(following) == len(chain) or len(following) >= LOOK_AHEAD, (
                vehicle.ego.id,
                lane_id,
            )
            assert route.changes[node] == offset, (vehicle.ego.id, lane_id)
            inside = sum(
                float(route.length[i])
                for i in naive.chain_of(route, int(node))
                if route.internal[i]
            )
            last = len(chain) == len(vehicle.ego.route)
            assert math.isinf(route.reach[node]) == last
            if not last:
                assert route.reach[node] - inside == pytest.approx(
                    sum(float(road.length[number[i]]) for i in following), abs=0.01
                )
            compared += 1
    assert compared > 50
    assert cut < compared / 2


@pytest.mark.parametrize("name", [*GAMES, *SCENES])
def test_poses_are_sumos(name: str) -> None:
    """Within 1 cm and half a degree on straight lanes, 10 cm and 2 degrees in turns, whatever the
    lengths of lane and shape.

    Vehicles that have been in their lane for longer than they are; those of 13 m and less: SUMO
    bends the longest ones at their joint.
    """
    road, seen = observed(name)
    straight, turning = [], []
    for vehicle in seen:
        ego = vehicle.ego
        if vehicle.settled < 2 * ego.length or ego.length > 13.0:
            continue
        route = laid_out(name, vehicle.whole, ego.vclass, ego.length)
        (node,) = np.flatnonzero(route.lane == ego.lane)
        x, y, c, n = lane_pose(route.table, route.rows, int(node), ego.s)
        error = (
            math.hypot(x - ego.x, y - ego.y),
            math.degrees(abs(math.remainder(math.atan2(n, c) - ego.heading, math.tau))),
        )
        points = road.point_offset[ego.lane + 1] - road.point_offset[ego.lane]
        (straight if points == 2 and ego.s > ego.length else turning).append(error)
    assert len(straight) + len(turning) > 50
    assert np.all(np.array(straight).reshape(-1, 2) < (0.01, 0.5))
    assert np.all(np.array(turning).reshape(-1, 2) < (0.1, 2.0))


@pytest.mark.parametrize("name", [*GAMES, *SCENES])
def test_stations_grow_along_next(name: str) -> None:
    _, seen = observed(name)
    for whole, vclass, length in {(v.whole, v.ego.vclass, v.ego.length) for v in seen}:
        route = laid_out(name, whole, vclass, length)
        nodes = np.flatnonzero(route.next >= 0)
        assert np.all(route.next[nodes] > nodes)
        room = route.station[route.next[nodes]] - route.station[nodes] - route.length[nodes]
        assert np.all(
            room > -1e-6
        )  # ways through a junction may be shorter than the longest of them
        assert np.all(np.diff(route.leg[nodes]) >= 0)
        assert not np.any(route.internal & ((route.left >= 0) | (route.right >= 0)))


@pytest.mark.parametrize("name", [*GAMES, "unprotected-left-turn"])
def test_lanes_upstream_are_those_from_which_a_search_ahead_finds_the_route(name: str) -> None:
    road, seen = observed(name)
    compared = 0
    for vehicle in seen[:: max(1, len(seen) // 5)]:
        route = laid_out(name, vehicle.whole, vehicle.ego.vclass, vehicle.ego.length)
        found = {
            lane: (onto, begin)
            for lane, onto, begin in zip(
                *(column.tolist() for column in route.upstream), strict=True
            )
        }
        own, ways = set(route.lane.tolist()), dict[int, float]()
        for lane in set(range(len(road.lane_ids))) - own:
            way = metres_to_the_route(road, own, lane)
            if way < UPSTREAM_VIEW:
                ways[lane] = way
        assert found.keys() == ways.keys() and {onto for onto, _ in found.values()} <= own
        assert all(
            begin == pytest.approx(-ways[lane] - road.length[lane])
            for lane, (_, begin) in found.items()
        )
        compared += len(found)
    assert compared > 0


def metres_to_the_route(road: RoadMap, own: set[int], lane: int) -> float:
    """From the end of a lane on, by the shortest way; inf where that is longer than UPSTREAM_VIEW."""
    best, todo = {lane: 0.0}, [lane]
    nearest = math.inf
    while todo:
        here = todo.pop()
        for after in road.successor[
            road.successor_offset[here] : road.successor_offset[here + 1]
        ].tolist():
            if after in own:
                nearest = min(nearest, best[here])
            elif best[here] + road.length[after] < min(UPSTREAM_VIEW, best.get(after, math.inf)):
                best[after] = best[here] + float(road.length[after])
                todo.append(after)
    return nearest


# --- small routes ---


def two_ways() -> RoadMap:
    """Edge a (3 lanes) leads to b by lanes 1 and 2 and to the side road x by lane 0; of b's two
    lanes only the left one goes on to c."""
    lanes = [
        Lane("a", 0, ((0, 0), (100, 0)), (":j_0",)),
        Lane("a", 1, ((0, 3), (100, 3)), (":k_0",)),
        Lane("a", 2, ((0, 6), (100, 6)), (":k_1",)),
        Lane(":j", 0, ((100, 0), (110, -10)), ("x_0",), junction="j"),
        Lane(":k", 0, ((100, 3), (110, 3)), ("b_0",), junction="j"),
        Lane(":k", 1, ((100, 6), (110, 6)), ("b_1",), junction="j"),
        Lane("x", 0, ((110, -10), (210, -10))),
        Lane("b", 0, ((110, 3), (170, 3)), speed=8.0),
        Lane("b", 1, ((110, 6), (170, 6)), (":m_0",), speed=8.0),
        Lane(":m", 0, ((170, 6), (175, 6)), ("c_0",), junction="m", rule=STOP),
        Lane("c", 0, ((175, 6), (275, 6))),
    ]
    return build(lanes)


def node_of(road: RoadMap, route: RouteMap, name: str) -> int:
    return int(np.flatnonzero(route.lane == road.lane_ids.index(name))[0])


def test_a_route_with_dead_ends() -> None:
    road = two_ways()
    route = route_map(road, edges(road, "a", "b", "c"), 0, 5.0, 1.0, 50.0, 2.0)
    at = {
        name: node_of(road, route, name)
        for name in ("a_0", "a_1", "a_2", ":k_0", "b_0", "b_1", ":m_0", "c_0")
    }
    assert [route.changes[at[name]] for name in ("a_0", "a_1", "a_2", "b_0", "b_1", "c_0")] == [
        2,
        1,
        0,
        1,
        0,
        0,
    ]
    assert [route.reach[at[name]] for name in ("a_0", "a_1", "a_2", ":k_0", "b_0", "b_1")] == [
        100.0,
        170.0,
        math.inf,
        70.0,
        60.0,
        math.inf,
    ]
    assert (
        route.next[at["a_0"]] == -1
        and route.next[at["b_0"]] == -1
        and route.next[at["b_1"]] == at[":m_0"]
    )
    assert [bool(route.stop[at[name]]) for name in ("a_1", "b_0", "b_1", "c_0")] == [
        False,
        False,
        True,
        False,
    ]
    assert (
        route.sign[at["b_1"]]
        and route.left[at["a_1"]] == at["a_2"]
        and route.right[at["a_0"]] == -1
    )
    assert route.station[at["c_0"]] == 175.0


def test_lanes_closed_to_the_vehicle_are_not_there() -> None:
    road = two_ways()
    road.classes[road.lane_ids.index("b_1")] = 1 << 8  # buses
    route = route_map(road, edges(road, "a", "b"), 0, 5.0, 1.0, 50.0, 2.0)
    assert road.lane_ids.index("b_1") not in route.lane
    assert route.changes[node_of(road, route, "a_2")] == -1
    bus = route_map(road, edges(road, "a", "b"), 8, 5.0, 1.0, 50.0, 2.0)
    assert bus.changes[node_of(road, bus, "a_2")] == 0


def test_a_lane_that_was_closed_under_the_ego_ends_unless_the_whole_edge_was() -> None:
    """It may be left, and not be entered."""
    bus = 1 << VEHICLE_CLASSES.index("bus")
    for closed in ((0,), (0, 1)):
        road = build(
            [
                *(
                    Lane("a", k, ((0, 3.0 * k), (100, 3.0 * k)), (f"b_{k}",),
                         classes=bus if k in closed else ALL_CLASSES)
                    for k in (0, 1)
                ),
                *(Lane("b", k, ((100, 3.0 * k), (200, 3.0 * k))) for k in (0, 1)),
            ]
        )  # fmt: skip
        under = tuple(lane_index(road)[f"a_{k}"] for k in closed)
        route = route_map(road, edges(road, "a", "b"), 0, 5.0, 1.0, 50.0, 2.0, under)
        node = node_of(road, route, "a_0")
        left = node_of(road, route, "a_1")
        if closed == (0,):
            assert (route.next[node], route.changes[node], route.reach[node]) == (-1, 1, 100.0)
            assert (route.left[node], route.right[left]) == (left, -1)
            assert route.cap[route.row[node + 1] - 1] == 0.0
        else:
            assert route.next[node] == node_of(road, route, "b_0")
            assert not route.lost[node]


def test_of_two_ways_that_end_alike_the_one_with_fewer_changes_to_come_is_taken() -> None:
    lanes = [
        Lane("a", 0, ((0, 0), (100, 0)), ("b_0", "b_1")),
        *(
            Lane("b", k, ((100, 3.0 * k), (150, 3.0 * k)), ("c_0",) if k == 2 else ())
            for k in range(3)
        ),
        Lane("c", 0, ((150, 6), (250, 6))),
    ]
    road = build(lanes)
    route = route_map(road, edges(road, "a", "b", "c"), 0, 5.0, 1.0, 50.0, 2.0)
    assert route.next[node_of(road, route, "a_0")] == node_of(road, route, "b_1")


def banned(**lanes: str) -> RoadMap:
    """Edges a, b, c of two lanes; b_1 alone leads on to c_1, and c_1 alone is left at the end.

    `lanes`: name -> side to which cars may not change from it.
    """
    ways = {"a_0": ("b_0",), "a_1": ("b_1",), "b_0": (), "b_1": ("c_1",), "c_0": (), "c_1": ()}
    return build(
        [
            Lane(
                name[0],
                int(name[2]),
                ((x, 3.0 * int(name[2])), (x + 100.0, 3.0 * int(name[2]))),
                ways[name],
                change_left=0 if lanes.get(name) == "left" else ALL_CLASSES,
                change_right=0 if lanes.get(name) == "right" else ALL_CLASSES,
            )
            for name, x in zip(ways, (0.0, 0.0, 100.0, 100.0, 200.0, 200.0), strict=True)
        ]
    )


def test_the_ego_changes_before_the_lanes_that_may_not_be_left() -> None:
    free, solid = banned(), banned(b_0="left")
    routes = [route_map(r, edges(r, "a", "b", "c"), 0, 5.0, 1.0, 50.0, 2.0) for r in (free, solid)]
    a, b = (node_of(free, routes[0], name) for name in ("a_0", "b_0"))
    assert [int(route.left[b]) >= 0 for route in routes] == [True, False]
    assert [float(route.reach[a]) for route in routes] == [200.0, 100.0]
    assert [int(route.changes[a]) for route in routes] == [1, 1]
    assert [int(route.changes[b]) for route in routes] == [1, 0]  # none is possible
    assert [bool(route.lost[b]) for route in routes] == [False, True]
    assert int(routes[1].right[node_of(solid, routes[1], "b_1")]) == b  # the other way it may


def test_a_lane_that_leads_into_one_that_may_not_be_left_is_no_way() -> None:
    """Over a junction, whose lanes count too."""
    ways = {
        "a_0": (":m_0",), "a_1": (":m_1",), ":m_0": ("b_0",), ":m_1": ("b_1",),
        "b_0": (":n_0",), "b_1": (":n_1",), ":n_0": ("c_0",), ":n_1": ("c_1",),
        "c_0": (), "c_1": ("d_1",), "d_0": (), "d_1": (),
    }  # fmt: skip
    begins = {"a": 0.0, ":m": 100.0, "b": 110.0, ":n": 210.0, "c": 220.0, "d": 320.0}
    lanes = []
    for name, after in ways.items():
        edge, k = name.rsplit("_", 1)
        x, y = begins[edge], 3.0 * int(k)
        length, inside = (10.0, edge[1:]) if edge.startswith(":") else (100.0, "")
        allowed = 0 if name in ("b_0", "c_0") else ALL_CLASSES
        lanes.append(
            Lane(edge, int(k), ((x, y), (x + length, y)), after, junction=inside,
                 change_left=allowed)
        )  # fmt: skip
    road = build(lanes)
    route = route_map(road, edges(road, "a", "b", "c", "d"), 0, 5.0, 1.0, 50.0, 2.0)
    a, b = (node_of(road, route, name) for name in ("a_0", "b_0"))
    assert (float(route.reach[a]), int(route.changes[a])) == (100.0, 1)
    assert int(route.changes[b]) == 0


def test_where_the_best_lane_is_out_of_reach_the_next_best_that_goes_on_is_taken() -> None:
    """From a_0, which leads nowhere, over a_1 and b_0; from a_1 nobody may change to a_2."""
    lanes = [
        Lane("a", 0, ((0.0, 0.0), (100.0, 0.0))),
        Lane("a", 1, ((0.0, 3.0), (100.0, 3.0)), ("b_0",), change_left=0),
        Lane("a", 2, ((0.0, 6.0), (100.0, 6.0)), ("b_1",)),
        Lane("b", 0, ((100.0, 3.0), (200.0, 3.0))),
        Lane("b", 1, ((100.0, 6.0), (200.0, 6.0)), ("c_0",)),
        Lane("c", 0, ((200.0, 6.0), (300.0, 6.0))),
    ]
    road = build(lanes)
    route = route_map(road, edges(road, "a", "b", "c"), 0, 5.0, 1.0, 50.0, 2.0)
    at = [node_of(road, route, name) for name in ("a_0", "a_1", "a_2", "b_0")]
    assert route.changes[at].tolist() == [1, 1, 0, 1]
    assert not route.lost.any()
    assert route.table[at, NUMBER].tolist() == [0, 1, 2, 0]


def test_a_lane_between_that_is_closed_to_the_vehicle_is_no_way() -> None:
    lanes = [
        Lane(
            "a", k, ((0.0, 3.0 * k), (100.0, 3.0 * k)), (f"b_{k}",), classes=1 if k != 1 else 1 << 8
        )
        for k in range(3)
    ]
    lanes += [
        Lane("b", k, ((100.0, 3.0 * k), (200.0, 3.0 * k)), ("c_0",) if k == 2 else ())
        for k in range(3)
    ]
    road = build([*lanes, Lane("c", 0, ((200.0, 6.0), (300.0, 6.0)))])
    route = route_map(road, edges(road, "a", "b", "c"), 0, 5.0, 1.0, 50.0, 2.0)
    right, left = (node_of(road, route, name) for name in ("a_0", "a_2"))
    assert route.left[right] == -1 and route.changes[right] == 2  # on b it may
    assert route.changes[left] == 0


def test_limits_are_those_of_the_vehicle_s_class() -> None:
    road = banned()
    row = np.full(len(VEHICLE_CLASSES), -1, np.int32)
    row[VEHICLE_CLASSES.index("truck")] = 0
    road = road._replace(
        class_row=row, class_speed=np.array([[5.0, 20.0] * 3]), speed=np.full(6, 9.0)
    )
    truck, car = (
        route_map(road, edges(road, "a", "b", "c"), kind, 5.0, 1.1, 50.0, 2.0)
        for kind in (VEHICLE_CLASSES.index("truck"), 0)
    )
    assert truck.limit[:2].tolist() == pytest.approx([5.5, 22.0])
    assert car.limit[:2].tolist() == pytest.approx([9.9, 9.9])
    anyone = route_map(road, edges(road, "a", "b", "c"), IGNORING, 5.0, 1.0, 50.0, 2.0)
    assert (anyone.limit == 9.0).all()


# --- speed caps ---


def chain(
    lengths: Sequence[float], limits: Sequence[float], dead: bool
) -> tuple[RoadMap, tuple[int, ...]]:
    """A road of edges e0, e1, ... without junctions between them.

    `dead`: its last edge is only beside the end of the one before.
    """
    x, lanes = 0.0, []
    for k, (length, limit) in enumerate(zip(lengths, limits, strict=True)):
        last = k + 1 == len(lengths)
        after = () if last or (dead and k + 2 == len(lengths)) else (f"e{k + 1}_0",)
        lanes.append(Lane(f"e{k}", 0, ((x, 0.0), (x + length, 0.0)), after, speed=limit))
        x += length
    road = build(lanes)
    return road, edges(road, *(f"e{k}" for k in range(len(lengths))))


roads = st.integers(2, 6).flatmap(
    lambda n: st.tuples(
        st.lists(st.floats(naive.END_GAP + 0.1, 60.0), min_size=n, max_size=n),
        st.lists(st.floats(2.0, 40.0), min_size=n, max_size=n),
        st.booleans(),
    )
)


@given(roads, st.floats(0.5, 5.0), st.floats(0.8, 1.2), st.floats(5.0, 35.0))
def test_caps_are_the_least_over_all_places_ahead(
    road: tuple[list[float], list[float], bool], decel: float, factor: float, top: float
) -> None:
    made, route_edges = chain(*road)
    route = route_map(made, route_edges, 0, 5.0, factor, top, decel)
    assert route.limit.tolist() == pytest.approx([min(limit * factor, top) for limit in road[1]])
    goal = (route.leg == len(route_edges) - 1).tolist()
    for node in range(len(route.lane)):
        *rows, (last, s) = naive.rows_of(route, node)
        for row, s in rows:
            assert route.cap[row] == pytest.approx(
                naive.cap(route, node, s, decel, goal), abs=1e-6
            ), (node, s)
        # The last row lies at the lane's end or beyond; read between the last two, the end has its
        # own cap, but where that would be below zero.
        assert s + SPACING >= route.length[node] > s - 1e-9
        at_end = route.cap[last - 1] + (route.length[node] - s) / SPACING * (
            route.cap[last] - route.cap[last - 1]
        )
        assert at_end == pytest.approx(
            naive.cap(route, node, float(route.length[node]), decel, goal), abs=1e-6
        ) or (route.cap[last] == 0.0 and not goal[node])


def test_the_networks_are_there() -> None:
    assert (root() / "networks").is_dir() and all(
        (GAME / f"{name}.sumocfg").is_file() for name in GAMES
    )
