"""The paper's scenes beyond its table: their conflicts are where and when the paper's program has
them, read from scripts, routes and networks. Lengths in m, speeds in m/s, times in s."""

import math
from functools import cache
from itertools import combinations, pairwise
from typing import Any, NamedTuple
from xml.etree.ElementTree import parse

import helpers_scenes
import numpy as np
import pytest

from sumo_mcts import load_scenario, run_episode
from sumo_mcts.arrays import Floats
from sumo_mcts.config import Actor, ScenarioConfig
from sumo_mcts.numerics.geometry import Box, box_distance
from sumo_mcts.prediction.script_poses import script_poses
from sumo_mcts.road import RoadMap
from sumo_mcts.world.roadmap import lane_shape, read_roadmap
from sumo_mcts.world.scripts import compile_script

STEP = 0.1
HALF = np.array([4.7, 1.8]) / 2  # of a car
WEST_LINE, CROSSING = -6.5, (-6.5, 22.5)  # x of the stop line from the west, and of the junction
EGO_LANE_Y = -5.25  # the middle lane from the west


class Facts(NamedTuple):
    """What the paper's program says of a scene."""

    stop_s: float
    start: tuple[float, float]  # of the ego
    end: tuple[float, float]  # where it leaves
    others: int
    speeds: tuple[float, float]  # slowest and fastest of the others while they drive freely


SCENES = {
    "go-straight-1": Facts(15, (-49, -6), (97, -6), 5, (5, 10)),
    "go-straight-2": Facts(15, (-23, -6), (97, -6), 5, (5, 15)),
    "crossing-cut-in": Facts(15, (-56, -6), (97, -6), 5, (5, 10)),
    "unprotected-right-turn": Facts(20, (-42, -10), (-2, -74), 5, (5, 15)),
    "straight-cross": Facts(15, (-23, -6), (84, -5), 5, (3, 10)),
    "crossing-blocked": Facts(15, (-47, -6), (97, -6), 5, (5, 10)),
    "stationary-objects": Facts(25, (-65, -6), (97, -6), 5, (0, 0)),
    "large-curvature": Facts(30, (0, 0), (-15.5, 88), 3, (10, 15)),
    "exit-cut-in": Facts(20, (-182, -72), (100, -42), 6, (0, 12)),
    "century-avenue-right": Facts(25, (34, -87), (86, 25), 5, (10, 10)),
    "century-avenue-straight": Facts(25, (34, -87), (-40, 87), 5, (10, 10)),
    "pudong-south-left": Facts(15, (17, -23), (-40, 6), 5, (3, 10)),
    "lujiazui-tunnel": Facts(30, (-33, 164), (-47, -93), 4, (4, 10)),
    "lujiazui-roundabout": Facts(25, (16, -58), (-78, 72), 5, (3, 10)),
}
KINDS = [f"{name}{kind}" for name in SCENES for kind in ("", "-scripted")]


class Track(NamedTuple):
    """A script, a row a step."""

    front: Floats  # [M, 2]
    pose: Floats  # [M, 4] of the box
    v: Floats  # [M]
    lane: tuple[str, ...]  # [M]

    def when(self, holds: Any) -> float:
        """When a condition, one a row, holds for the first time."""
        assert np.any(holds)
        return float(np.argmax(holds)) * STEP

    def stands(self) -> tuple[float, Floats]:
        """For how long it stands, and where."""
        still = self.v < 0.05
        return float(np.count_nonzero(still)) * STEP, self.front[int(np.argmax(still))]

    def indices(self) -> list[int]:
        """The lanes' numbers in the order in which they are driven."""
        numbers = [int(lane.rsplit("_", 1)[1]) for lane in self.lane if lane[0] != ":"]
        return [numbers[0], *(b for a, b in pairwise(numbers) if a != b)]


@cache
def scene(name: str) -> ScenarioConfig:
    return load_scenario(name)


@cache
def road(name: str) -> RoadMap:
    return read_roadmap(str(scene(name).sumo.net))


def actor(name: str, who: str) -> Actor:
    return next(each for each in scene(name).traffic.actors if each.id == who)


def others(name: str) -> list[str]:
    return [each.id for each in scene(name).traffic.actors if each.id != "ego"]


@cache
def track(name: str, who: str) -> Track:
    """Where the script of a scene, as it is written, has one of the others."""
    roads = road(name)
    script = compile_script(actor(name, who), roads, STEP, 30.0)
    pose = script_poses(roads, script.lane, script.s, script.d, script.v, STEP, 2 * HALF[0])
    lanes = tuple(roads.lane_ids[lane] for lane in script.lane)
    return Track(pose[:, :2] + HALF[0] * pose[:, 2:], pose, script.v, lanes)


def scripted(name: str) -> dict[str, Track]:
    return {who: track(f"{name}-scripted", who) for who in others(name)}


def place(name: str, who: str) -> Floats:
    """Where one of them enters."""
    return helpers_scenes.place(actor(name, who), road(name))


def shapes(name: str, edge: str) -> Floats:
    """The points of the lanes of an edge, dense."""
    roads = road(name)
    lanes = [i for i, lane in enumerate(roads.lane_ids) if lane.rsplit("_", 1)[0] == edge]
    legs = [leg for lane in lanes for leg in pairwise(lane_shape(roads, lane))]
    return np.concatenate([np.linspace(a, b, 100) for a, b in legs])


def ego_driven(t: float) -> tuple[float, float]:
    """How far the ego has come: with its 5 m/s kept, and with full acceleration from 5 m/s on."""
    return 5 * t, 5 * t + 1.3 * t**2


# --- all of them ---


@pytest.mark.parametrize("name", KINDS)
def test_time_number_and_speeds_are_those_of_the_paper(name: str) -> None:
    facts = SCENES[name.removesuffix("-scripted")]
    assert scene(name).episode.stop_time_s == facts.stop_s
    assert scene(name).episode.success_edge in actor(name, "ego").route
    assert len(others(name)) == facts.others
    assert actor(name, "ego").depart.speed_mps == 5
    speeds = [
        speed
        for who in others(name)
        for each in [actor(name, who)]
        for speed in (each.depart.speed_mps, *(event.slow_to_mps for event in each.events))
        if speed is not None
    ]
    assert (min(speeds), max(speeds)) == facts.speeds


@pytest.mark.parametrize("name", SCENES)
def test_the_ego_comes_and_leaves_where_the_paper_has_it(name: str) -> None:
    facts = SCENES[name]
    assert place(name, "ego") == pytest.approx(facts.start, abs=5.5)
    after = shapes(name, actor(name, "ego").route[-1])
    assert np.min(np.hypot(*(after - facts.end).T)) < 5


@pytest.mark.parametrize("name", SCENES)
def test_both_kinds_have_the_others_in_the_same_places(name: str) -> None:
    for who in others(name):
        here, there = actor(name, who), actor(f"{name}-scripted", who)
        assert (here.driver, there.driver) == ("sumo", "script")
        assert there.model_copy(update={"driver": "sumo"}) == here


@pytest.mark.parametrize("name", SCENES)
def test_among_sumo_drivers_the_others_can_do_what_their_scripts_do(name: str) -> None:
    """SUMO bounds what they are told by their type: they would set off later than in their
    scripts."""
    types = {
        each.get("id"): each
        for path in scene(name).sumo.routes
        for each in parse(path).iter("vType")
    }
    for who in others(name):
        kind = types[actor(name, who).vtype]
        for event in actor(name, who).events:
            if event.change_lane is None:
                assert event.accel_mps2 <= float(kind.get("accel"))
                assert event.accel_mps2 <= float(kind.get("decel"))


@pytest.mark.parametrize("name", SCENES)
def test_scripts_do_not_meet(name: str) -> None:
    rows = round(SCENES[name].stop_s / STEP)
    for a, b in combinations(scripted(name).values(), 2):
        for p, q in zip(a.pose[:rows], b.pose[:rows], strict=False):
            if np.hypot(*(p - q)[:2]) < 10:
                assert box_distance(Box(*p, *HALF), Box(*q, *HALF)) > 0.3


@pytest.mark.parametrize("name", KINDS)
def test_sumo_drives_it(name: str) -> None:
    config = load_scenario(name, "planner.name=sumo", "episode.stop_time_s=4")
    (row,) = run_episode(config, 0).rows
    assert (row["outcome"], row["error"]) == ("timeout", None)
    assert row["distance_m"] > 0


# --- the crossing ---


def stop_at_the_line(track: Track, seconds: float, lane: int) -> None:
    """It comes with 10, stands so long, at the line, in this lane, and goes on."""
    stood, where = track.stands()
    assert stood == pytest.approx(seconds, abs=0.2)
    assert WEST_LINE - 4 < where[0] < WEST_LINE
    assert track.lane[int(np.argmax(track.v < 0.05))] == f"from_west_{lane}"
    assert track.v[0] == track.v[-1] == 10


def test_go_straight_1() -> None:
    cars = scripted("go-straight-1")
    stop_at_the_line(cars["stopping"], 1, 2)
    assert cars["ahead"].indices()[:2] == [1, 0] and set(cars["ahead"].v) == {10}
    assert cars["slow"].indices() == [0] and set(cars["slow"].v) == {5}
    cutting = cars["cutting_in"]
    inside = [k for k, lane in enumerate(cutting.lane) if lane[0] == ":"]
    assert cutting.indices() == [2, 1] and set(cutting.v) == {5}
    y = cutting.front[inside, 1]
    assert y[0] > -3 and y[-1] == pytest.approx(EGO_LANE_Y, abs=0.1)  # across inside the junction
    weaving = cars["weaving"]
    assert weaving.indices() == [1, 0, 1] and set(weaving.v) == {5}
    assert weaving.front[0, 0] < place("go-straight-1", "ego")[0]


def test_go_straight_2() -> None:
    cars = list(scripted("go-straight-2").values())
    across = [car.when(car.front[:, 1] < EGO_LANE_Y) for car in cars]
    assert across == sorted(across)
    assert all(car.lane[-1].startswith("to_south") for car in cars)
    at_junction = cars[0].when(cars[0].front[:, 0] < CROSSING[1])
    to_line = WEST_LINE - place("go-straight-2", "ego")[0]
    kept, fast = ego_driven(at_junction)
    assert kept < to_line + 2.5 and fast > to_line - 2.5


def test_unprotected_right_turn() -> None:
    cars = scripted("unprotected-right-turn")
    assert all(car.lane[-1] == "to_south_0" for car in cars.values())  # the lane of the ego
    for who in cars:
        here, there = actor("unprotected-right-turn", who), actor("go-straight-2", who)
        assert (here.route, here.depart) == (there.route, there.depart)


def test_crossing_cut_in() -> None:
    cars, ego = scripted("crossing-cut-in"), place("crossing-cut-in", "ego")
    stood, where = cars["cutting_in"].stands()
    assert stood == pytest.approx(5, abs=0.2) and where == pytest.approx((-26, -5.25), abs=0.5)
    assert 0 < cars["cutting_in"].front[0, 0] - ego[0] < 2 * HALF[0]  # right beside the ego
    assert cars["cutting_in"].indices()[:2] == [2, 1]
    stop_at_the_line(cars["ahead"], 5, 2)
    assert cars["ahead"].indices() == [1, 2]
    assert cars["from_the_right"].indices() == [0, 1] and set(cars["from_the_right"].v) == {5}
    ends = [cars[who].lane[-1][:-2] for who in ("turning_right", "turning_left")]
    assert ends == ["to_south", "to_north"]


def test_straight_cross() -> None:
    cars = list(scripted("straight-cross").values())
    stood, where = cars[0].stands()
    assert stood == pytest.approx(0.5, abs=0.2) and EGO_LANE_Y < where[1] < 14
    for car in cars:
        assert np.ptp(car.front[:, 0]) < 0.5 and car.front[-1, 1] < EGO_LANE_Y < car.front[0, 1]
        assert 5 <= car.v[0] <= 10
    assert all(3 <= car.v.min() <= 5 for car in cars[1:])


def test_crossing_blocked() -> None:
    cars = scripted("crossing-blocked")
    stop_at_the_line(cars["blocking_left"], 5, 2)
    stop_at_the_line(cars["blocking"], 6, 1)
    assert cars["slow"].indices() == [0] and set(cars["slow"].v) == {5}
    ends = [cars[who].lane[-1][:-2] for who in ("slow", "turning_right", "turning_left")]
    assert ends == ["to_east", "to_south", "to_north"]


def test_stationary_objects() -> None:
    cars = scripted("stationary-objects")
    assert all(np.all(car.v == 0) for car in cars.values())
    lanes = [(car.indices()[0], car.front[0, 0]) for car in cars.values()]
    # SUMO has no place for the last one, at 21, inside the junction: it stands behind it
    assert lanes == [(lane, pytest.approx(x, abs=1)) for lane, x in
                     [(1, -56), (0, -34), (2, -20), (2, -10), (1, 27)]]  # fmt: skip


# --- the highway ---


def curvature(name: str, lane: str) -> tuple[Floats, Floats]:
    """Lengths of the parts of a lane, and by how much it turns from one to the next."""
    steps = np.diff(lane_shape(road(name), road(name).lane_ids.index(lane)), axis=0)
    turned = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
    return np.hypot(*steps.T), turned


def test_large_curvature() -> None:
    length, turned = curvature("large-curvature", "bend_1")
    bend = length[1:].sum()  # a straight part of 60 m leads to it
    assert bend == pytest.approx(285, abs=10)
    assert math.degrees(turned.sum()) > 180
    radius = (length[1:] + length[:-1])[5:-5] / 2 / turned[5:-5]
    assert radius.min() == pytest.approx(35, abs=4)
    lanes = {who: car.indices() for who, car in scripted("large-curvature").items()}
    assert sorted(lane for (lane,) in lanes.values()) == [0, 2, 2]  # beside the ego's lane, 1


def test_exit_cut_in() -> None:
    name, cars = "exit-cut-in-scripted", scripted("exit-cut-in")
    ego = actor(name, "ego").depart.pos_m
    along = {who: actor(name, who).depart.pos_m for who in cars}
    assert road(name).length[road(name).lane_ids.index("approach_1")] > 250
    begun = cars["slow"].indices()
    assert begun == [0, 1] and actor(name, "slow").events[0].at_s == 4
    gap = along["slow"] + 4 * 4 - 2 * HALF[0] - (ego + ego_driven(4)[1])
    assert 30 < gap < 45  # nearer, SUMO's driver is not let in
    beside = ego + ego_driven(5)[1]  # of the ego, at 5 s
    left = [along[f"left_{who}"] + 5 * actor(name, f"left_{who}").depart.speed_mps - beside
            for who in ("ahead_1", "ahead_2", "behind_1", "behind_2")]  # fmt: skip
    assert left[0] > left[1] > 2 * HALF[0] and left[3] < left[2] < -2 * HALF[0]
    assert {cars[who].indices()[0] for who in cars if who.startswith("left")} == {2}
    # on the right there is no way past: what stands there is beside the slow one, or ahead of it
    stands, done = cars["broken_down"], round(7 / STEP)
    assert set(stands.v) == {0} and stands.indices() == [0]
    assert along["slow"] + 4 * 7 < along["broken_down"] < along["slow"] + 4 * 11
    assert cars["slow"].lane[done].endswith("_1")


# --- Shanghai ---


def test_century_avenue() -> None:
    for name in ("century-avenue-right", "century-avenue-straight"):
        cars, target = scripted(name), actor(name, "ego").route
        assert all(set(car.v) == {10.0} for car in cars.values())
        assert place(name, "ahead") == pytest.approx((30, -76), abs=2)
        assert cars["ahead"].lane[-1].startswith("to_fushan_nw")
        assert cars["on_the_avenue"].lane[-1].startswith("to_century_e")
        ends = {cars[f"along_weifang_{k}"].lane[-1][:-2] for k in (1, 2)}
        assert ends == {"beyond_weifang_e"}
        assert ("beyond_weifang_e" in target) == name.endswith("right")
    right, straight = (
        place(f"century-avenue-{turn}", "oncoming")[1] for turn in ("right", "straight")
    )
    assert straight < right - 20  # nearer


def test_arms_and_slip_lanes_of_century_avenue() -> None:
    roads = road("century-avenue-right")
    arms = {edge.rsplit("_", 1)[0] + edge[-1] for edge in roads.edge_ids if edge[:5] == "from_"}
    assert len({arm for arm in arms if "frontage" not in arm}) == 6
    lanes = {edge: int(np.count_nonzero(roads.edge == i)) for i, edge in enumerate(roads.edge_ids)}
    assert all(n == (1 if "frontage" in edge or "slip" in edge else 2)
               for edge, n in lanes.items() if edge[0] != ":")  # fmt: skip
    for slip in ("slip_s", "slip_n"):
        assert np.hypot(*(shapes("century-avenue-right", slip) - (4, -7)).T).min() < 60


def test_pudong_south_left() -> None:
    cars = scripted("pudong-south-left")
    assert [cars[f"oncoming_left_{k}"].v.min() for k in (1, 2)] == pytest.approx([7, 3])
    ends = {who: car.lane[-1][:-2] for who, car in cars.items()}
    assert ends == {"oncoming_left_1": "to_east", "oncoming_left_2": "to_east",
                    "south_bound": "to_south", "from_the_west": "to_north",
                    "north_left": "to_east"}  # fmt: skip
    # both that cross the ego's path do so while an ego that does not wait is inside the junction
    for who in ("south_bound", "from_the_west"):
        t = cars[who].when(np.hypot(*(cars[who].front - (3, 2)).T) < 4.5)
        kept, fast = ego_driven(t)
        assert kept < 9 + 32 and fast > 9  # 9 m to the line, then a path of 32 m
    left = [lane_shape(road("pudong-south-left"), road("pudong-south-left").lane_ids.index(lane))
            for lane in ("from_south_1", "to_south_1")]  # fmt: skip
    assert np.hypot(*(left[0][:, None] - left[1][None]).reshape(-1, 2).T).min() == pytest.approx(
        10, abs=0.5
    )


def test_lujiazui_tunnel() -> None:
    cars = scripted("lujiazui-tunnel")
    same = [car for car in cars.values() if car.lane[0] == "west_1"]
    assert len(same) == 3 and sorted(float(car.v.min()) for car in same) == [4, 10, 10]
    stood, where = cars["merging"].stands()
    assert stood == pytest.approx(5, abs=0.2) and cars["merging"].lane[0] == "east_ramp_0"
    ramp_end = lane_shape(road("lujiazui-tunnel"),
                          road("lujiazui-tunnel").lane_ids.index("joined_ramp_0"))[0]  # fmt: skip
    assert np.hypot(*(where - ramp_end)) < 45
    # it joins behind the car that the ego follows, before an ego 4 s behind that
    joined = [who.when([lane == "joined_ramp_0" for lane in who.lane])
              for who in (cars["slowing"], cars["merging"])]  # fmt: skip
    assert 1 < joined[1] - joined[0] < 4


def test_lujiazui_roundabout() -> None:
    name = "lujiazui-roundabout"
    roads, cars = road(name), scripted(name)
    ring = [edge for edge in roads.edge_ids if edge.startswith("ring_")]
    ways = [edge for edge in roads.edge_ids if edge.startswith(("from_", "to_"))]
    number = {edge: int(np.count_nonzero(roads.edge == roads.edge_ids.index(edge)))
              for edge in roads.edge_ids}  # fmt: skip
    assert {number[edge] for edge in ring} == {4}
    assert len(ways) == 8 and {number[edge] for edge in ways} == {1, 2}
    points = np.concatenate([shapes(name, edge) for edge in ring])
    assert np.hypot(*(points - (25, 15)).T).mean() == pytest.approx(30, abs=1)
    assert sum(car.lane[-1].startswith("to_west") for car in cars.values()) == 2
    first, last = (shapes(name, edge)[k] - (25, 15) for edge, k in
                   (("ring_south_in", 0), ("ring_north_in", -1)))  # fmt: skip
    assert (math.degrees(math.atan2(*last[::-1]) - math.atan2(*first[::-1]))) % 360 > 190
    # who circles in the ego's lane passes its entry while an ego that does not wait enters
    t = cars["passing"].when([lane == "ring_south_in_0" for lane in cars["passing"].lane])
    kept, fast = ego_driven(t)
    assert kept < 34 + 10 < fast + 20
