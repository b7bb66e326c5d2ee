"""Which lanes the others are expected to drive, on roads where that is not plain."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from helpers import ALL_CLASSES, Agent, Conflict, Lane, build, crossing, edges, ego_at
from helpers_model import forecast_of, lanes_east, predicted, scene_of, task_of, traffic_params

from sumo_mcts.numerics.geometry import Y
from sumo_mcts.prediction.alternatives import alternatives
from sumo_mcts.prediction.conflicts import conflicts_of
from sumo_mcts.prediction.forecast import Question, predict
from sumo_mcts.prediction.paths import LANES, NARROWS, PATH, likely_paths
from sumo_mcts.road import VEHICLE_CLASSES, RoadMap
from sumo_mcts.scene import TURNS, Forecast, Sideways
from sumo_mcts.world.oncoming import with_oncoming

CYCLE_TRACK = 1 << VEHICLE_CLASSES.index("bicycle")
NO_BICYCLES = ALL_CLASSES & ~CYCLE_TRACK
CAR, BICYCLE = VEHICLE_CLASSES.index("passenger"), VEHICLE_CLASSES.index("bicycle")


def roundabout(radius: float = 14.0, pieces: int = 8) -> RoadMap:
    """A ring r0, r1, .. counter-clockwise from the east, into which lane in_0 leads from the south
    at the beginning of r6; the ring has the right of way."""
    angles = [2.0 * math.pi * k / pieces for k in range(pieces + 1)]
    corners = [(radius * math.cos(a), radius * math.sin(a)) for a in angles]
    lanes = [
        Lane(
            f"r{k}",
            0,
            (corners[k], corners[k + 1]),
            (f"r{(k + 1) % pieces}_0",),
            8.0,
            junction="m" if k == 6 else "",
        )
        for k in range(pieces)
    ]
    south = corners[6]
    lanes += [
        Lane(
            "in",
            0,
            ((south[0] - 20.0, south[1] - 90.0), (south[0] - 8.0, south[1] - 8.0)),
            (":in_0",),
            8.0,
        ),
        Lane(
            ":in", 0, ((south[0] - 8.0, south[1] - 8.0), corners[7]), ("r7_0",), 8.0, junction="m"
        ),
    ]
    length = math.dist((south[0] - 8.0, south[1] - 8.0), corners[7])
    return away_lane(
        lanes,
        [
            Conflict(
                ":in_0",
                3.0,
                length,
                "r6_0",
                2.0,
                math.dist(corners[6], corners[7]),
                merge=True,
                yields=":in_0",
            )
        ],
    )


def away_lane(road: list[Lane], conflicts: Sequence[Conflict] = ()) -> RoadMap:
    """The road, and a lane far away for the ego."""
    return build([*road, Lane("away", 0, ((0.0, 900.0), (50.0, 900.0)))], conflicts)


def forecast_in(road: RoadMap, *agents: Agent, **traits: list[float]) -> Forecast:
    """What is expected of agents, with the ego on the lane far away."""
    return predicted(road, *agents, ego="away_0", seconds=9.0, **traits)[1]


# --- round and round ---


def test_who_drives_round_a_roundabout_does_not_drive_through_who_stands_there() -> None:
    road = roundabout()
    forecast = forecast_in(
        road,
        Agent("behind", "r0_0", 6.0, 6.0),
        Agent("stands", "r2_0", 8.0, 0.0),
        standing_s=[0.0, 30.0],
    )
    between = np.hypot(*(forecast.pose[0, :, 0, :2] - forecast.pose[0, :, 1, :2]).T)
    assert between.min() > 4.5 and forecast.v[0, -1, 0] < 0.5


def test_who_enters_a_roundabout_lets_who_comes_round_pass() -> None:
    road = roundabout()
    alone = forecast_in(road, Agent("enters", "in_0", 70.0, 6.0))
    forecast = forecast_in(
        road, Agent("enters", "in_0", 70.0, 6.0), Agent("round", "r4_0", 4.0, 6.0)
    )
    assert forecast.v[0, :, 0].min() < 0.6 * alone.v[0, :, 0].min()
    between = np.hypot(*(forecast.pose[0, :, 0, :2] - forecast.pose[0, :, 1, :2]).T)
    assert between.min() > 4.5


# --- for whom a lane is ---


def beside_a_track() -> RoadMap:
    """A lane for all goes on as a cycle track, the first way on, and as a lane for cars."""
    return away_lane(
        [
            Lane("a", 0, ((0.0, 0.0), (100.0, 0.0)), ("b_0", "b_1")),
            Lane("b", 0, ((100.0, -2.4), (300.0, -2.4)), classes=CYCLE_TRACK),
            Lane("b", 1, ((100.0, 0.0), (300.0, 0.0)), classes=NO_BICYCLES),
        ]
    )


@pytest.mark.parametrize(("vclass", "lane"), [(CAR, "b_1"), (BICYCLE, "b_0")])
def test_everybody_stays_on_lanes_of_its_kind(vclass: int, lane: str) -> None:
    road = beside_a_track()
    forecast = forecast_in(road, Agent("x", "a_0", 60.0, 10.0), vclass=[vclass])
    assert road.lane_ids[forecast.lane[0, -1, 0]] == lane


def test_no_hypothesis_has_a_car_on_a_cycle_track() -> None:
    """The ego's way leads along both."""
    road = beside_a_track()
    ego = ego_at(
        road, "a_0", 10.0, 10.0, route=(road.edge_ids.index("a"), road.edge_ids.index("b"))
    )
    for vclass in (CAR, BICYCLE):
        scene = scene_of(ego, road, Agent("x", "a_0", 80.0, 8.0))
        scene = scene._replace(agents=scene.agents._replace(vclass=np.array([vclass], np.int32)))
        usual = forecast_of(task_of(road, ego), scene)
        lanes = np.array([0, 2], np.int32)
        question = Question(scene, lanes, np.zeros(0), traffic_params(), 10.0)
        found = alternatives(road, question, scene.agents, usual, np.zeros(1))
        assert all(one.intent.does != TURNS for one in found)


def test_nobody_changes_lanes_onto_a_footway() -> None:
    """Off its centre line and with the turn signal on, as before a turn where lanes are wide."""
    walk = 1 << VEHICLE_CLASSES.index("pedestrian")
    road = away_lane(
        [
            Lane("a", 0, ((0.0, -3.2), (300.0, -3.2)), classes=walk),
            Lane("a", 1, ((0.0, 0.0), (300.0, 0.0)), classes=ALL_CLASSES & ~walk),
        ]
    )
    forecast = forecast_in(road, Agent("x", "a_1", 60.0, 10.0, -0.4), blinker=[-1])
    assert (
        set(forecast.lane[0, :, 0].tolist()) == {road.lane_ids.index("a_1")}
        and forecast.valid.all()
    )


# --- where roads and paths end ---


def acceleration_lane(length: float = 150.0) -> RoadMap:
    """Two lanes of which the right one ends."""
    return away_lane(
        [
            Lane("a", 0, ((0.0, -3.2), (length, -3.2))),
            Lane("a", 1, ((0.0, 0.0), (length, 0.0)), ("b_0",)),
            Lane("b", 0, ((length, 0.0), (length + 300.0, 0.0))),
        ]
    )


@pytest.mark.parametrize(("s", "v"), [(147.0, 0.5), (120.0, 4.0)])
def test_whoever_creeps_on_a_lane_that_ends_stands_at_its_end(s: float, v: float) -> None:
    road = acceleration_lane()
    forecast = forecast_in(road, Agent("x", "a_0", s, v))
    assert (
        forecast.valid.all()
        and forecast.s[0, -1, 0] == pytest.approx(149.0, abs=1.2)
        and forecast.v[0, -1, 0] < 0.2
    )


@pytest.mark.parametrize(("s", "v"), [(147.0, 8.0), (110.0, 13.0)])
def test_whoever_drives_there_goes_on_where_the_lane_beside_leads(s: float, v: float) -> None:
    road = acceleration_lane()
    forecast = forecast_in(road, Agent("x", "a_0", s, v))
    assert forecast.valid.all() and road.lane_ids[forecast.lane[0, -1, 0]] == "b_0"


def test_whoever_comes_to_the_end_of_the_network_leaves_it() -> None:
    road = lanes_east(2, 150.0)
    scene = scene_of(ego_at(road, "a_1", 10.0, 0.0), road, Agent("x", "a_0", 100.0, 13.0))
    forecast = forecast_of(task_of(road, scene.ego), scene, 9.0)
    assert not forecast.valid[0, -1, 0] and forecast.v[0, 10, 0] > 12.0


def test_a_fast_driver_has_a_path_for_the_whole_forecast() -> None:
    """Thirty metres a lane, forty metres a second."""
    lanes = [
        Lane(
            f"m{k}",
            0,
            ((30.0 * k, 0.0), (30.0 * k + 30.0, 0.0)),
            (f"m{k + 1}_0",) if k < 29 else (),
            40.0,
        )
        for k in range(30)
    ]
    road = away_lane(lanes)
    scene, forecast = predicted(road, Agent("x", "m0_0", 10.0, 40.0), ego="away_0", seconds=9.0)
    assert forecast.s[0, :, 0].max() <= 30.1 and forecast.valid.all()
    assert road.lane_ids[forecast.lane[0, -1, 0]] == f"m{int((10.0 + 40.0 * 9.0) / 30.0)}_0"
    slow = likely_paths(
        road, scene.agents._replace(v=np.array([1.0])), scene.ego, np.array([30], np.int32), {}, 1.0
    )
    assert (
        slow.offset[1, slow.count[1]] < PATH + 50.0
        and slow.count[1] < LANES
        and slow.ends[1] != NARROWS
    )


def two_way(y: float = 3.2, *more: Lane, leads_to: tuple[str, ...] = ()) -> RoadMap:
    """Edge a eastward at y = 0 and b westward, both with a lane to overtake in. With b at y < 0
    people drive on the left."""
    lanes = [
        Lane("a", 0, ((0.0, 0.0), (600.0, 0.0))),
        Lane("b", 0, ((600.0, y), (0.0, y)), leads_to),
        *more,
    ]
    return with_oncoming(build(lanes)._replace(lefthand=y < 0.0), {0: 1, 1: 0})


def with_ego(
    road: RoadMap, ego: tuple[str, float], *agents: Agent, divided: bool = False
) -> Forecast:
    """What is expected of agents, for 7 s, where the ego drives at 10 m/s; `divided`: so are the
    lanes."""
    state = ego_at(road, *ego, 10.0, route=edges(road, ego[0][0]))
    state = state._replace(sideways=Sideways(1.0 if divided else 0.0))
    lanes = np.array([road.lane_ids.index(ego[0])], np.int32)
    scene = scene_of(state, road, *agents)
    return predict(road, Question(scene, lanes, np.zeros(0), traffic_params(), 7.0))


@pytest.mark.parametrize("y", [3.2, -3.2])
@pytest.mark.parametrize(
    ("v", "other", "ego", "after"),
    [
        (20.0, None, ("a_0", 100.0), 0.0),
        (20.0, ("b_0", 170.0), ("a_0", 100.0), 0.0),  # it has overtaken this one
        (20.0, ("b_0", 198.0), ("a_0", 100.0), 1.0),  # this one it passes with 5 m/s
        (20.0, ("b_0", 208.0), ("a_0", 100.0), 3.0),
        (20.0, ("b_0", 260.0), ("a_0", 100.0), 0.0),
        (20.0, None, ("b_0", 198.0), 0.5),  # it overtakes the ego
        (14.0, ("b_0", 198.0), ("a_0", 100.0), math.inf),
        (2.0, None, ("a_0", 100.0), math.inf),
    ],
)
def test_who_has_overtaken_goes_back_to_its_lane(
    v: float, other: tuple[str, float] | None, ego: tuple[str, float], after: float, y: float
) -> None:
    """It comes towards the ego on the lane of the ego. If it stayed there, whatever the ego did
    would end in a contact."""
    road = two_way(y)
    agents = [Agent("x", "b_1", 200.0, v), *([] if other is None else [Agent("y", *other, 15.0)])]
    forecast = with_ego(road, ego, *agents)
    moves, steps = forecast.pose[0, :, 0, Y], forecast.v.shape[1] - 1
    stays = min(steps, after / forecast.dt)
    assert moves[: int(stays) + 1] == pytest.approx(0.0)
    back = int(min(steps, (after + 3.2) / forecast.dt))
    assert moves[back:] == pytest.approx(0.0 if after == math.inf else y, abs=0.1)
    assert road.lane_ids[forecast.lane[0, -1, 0]] == ("b_1" if after == math.inf else "b_0")


@pytest.mark.parametrize("y", [3.2, -3.2])
@pytest.mark.parametrize("divided", [False, True])
def test_who_has_not_gone_back_at_the_end_of_the_lane_does_so_behind_it(
    divided: bool, y: float
) -> None:
    """Its path goes on from its own lane; its body does not jump there by a lane, nor stay between
    the two where drivers have places of their own within their lanes."""
    road = two_way(y, Lane("c", 0, ((0.0, y), (-300.0, y))), leads_to=("c_0",))
    there = Agent("x", "b_1", 590.0, 20.0)
    forecast = with_ego(road, ("a_0", 100.0), there, divided=divided)
    assert np.abs(np.diff(forecast.pose[0, :, 0, Y])).max() < 1.6
    assert forecast.pose[0, -1, 0, Y] == pytest.approx(y, abs=0.1)


def test_those_along_a_path_are_all_that_drive_on_a_lane_of_it() -> None:
    road = crossing(bridge=False)
    cars = (
        Agent("crosses", "si_0", 60.0, 8.0),
        Agent("turned", ":wn_0", 2.0, 8.0),
        Agent("behind", "wi_0", 10.0, 8.0),
        Agent("beyond", "eo_0", 10.0, 8.0),
    )
    ego = ego_at(road, "wi_0", 40.0, 8.0, route=edges(road, "wi", "eo"))
    lanes = np.array([road.lane_ids.index(name) for name in ("wi_0", ":we_0", "eo_0")], np.int32)
    agents = scene_of(ego, road, *cars).agents
    paths = likely_paths(road, agents, ego, lanes, {}, 10.0)
    driven = [set(row[:count].tolist()) for row, count in zip(paths.lane, paths.count, strict=True)]
    found = [[j for j in row if j >= 0] for row in conflicts_of(road, paths).along.tolist()]
    rows = range(len(driven))
    assert found == [[j for j in rows if j != i and driven[i] & driven[j]] for i in rows]
    assert found[0] == [1, 2] and found[3] == [4]  # in the order of their names
