"""Where two lanes become one and neither has the right of way: one by one."""

from pathlib import Path

import libsumo
import numpy as np
import pytest
from helpers import Agent, Conflict, Lane, build, edges, ego_at
from helpers_model import compiled, forecast_of, local_of, scene_of, task_of, traffic_params
from helpers_networks import netconvert, simulation

from sumo_mcts.model.gaps import cut_in_cost
from sumo_mcts.prediction.forecast import Question, predict
from sumo_mcts.road import ZIPPER, RoadMap
from sumo_mcts.scene import Forecast
from sumo_mcts.world.observe import Change, Observer
from sumo_mcts.world.roadmap import read_roadmap

cut_in_cost = compiled(cut_in_cost)
PLACE = 200.0  # m from the start of both lanes


def zipper() -> RoadMap:
    """Two lanes eastward that become one behind a junction of 10 m; each has to yield to the other
    in the network."""
    road = build(
        [
            *(
                Lane("in", k, ((0.0, y), (PLACE, y)), (f":c_{k}",))
                for k, y in ((0, -1.6), (1, 1.6))
            ),
            *(
                Lane(
                    ":c", k, ((PLACE, y), (PLACE + 10.0, 0.0)), ("out_0",), junction="c",
                    rule=ZIPPER,
                )
                for k, y in ((0, -1.6), (1, 1.6))
            ),
            Lane("out", 0, ((PLACE + 10.0, 0.0), (PLACE + 410.0, 0.0))),
        ],
        [Conflict(":c_0", 4.0, 10.1, ":c_1", 4.0, 10.1, merge=True)],
    )  # fmt: skip
    return road._replace(conflict_yields=np.ones_like(road.conflict_yields))


def drive(*agents: Agent) -> tuple[RoadMap, Forecast]:
    """The forecast of agents ahead of an ego that stands at the start of the left lane."""
    road = zipper()
    ego = ego_at(road, "in_1", 6.0, 0.0, route=edges(road, "in", "out"))
    return road, forecast_of(task_of(road, ego), scene_of(ego, road, *agents))


def enters(road: RoadMap, forecast: Forecast, i: int) -> int:
    """The number of the first forecast time at which agent i is past the zipper."""
    return int(np.argmax(forecast.lane[0, :, i] == road.lane_ids.index("out_0")))


@pytest.mark.parametrize("ahead", [2.0, 10.0, 20.0])
@pytest.mark.parametrize("left_first", [True, False])
def test_the_one_ahead_goes_first_and_the_other_makes_room_without_a_stop(
    ahead: float, left_first: bool
) -> None:
    first, second = ("in_1", "in_0") if left_first else ("in_0", "in_1")
    road, forecast = drive(Agent("a", first, 140.0, 12.0), Agent("b", second, 140.0 - ahead, 12.0))
    entered = [enters(road, forecast, i) for i in (0, 1)]
    assert 0 < entered[0] < entered[1]
    assert forecast.v[0, :, 0].min() > 11.5
    assert forecast.v[0, :, 1].min() > 3.0
    both = slice(entered[1], None)
    assert (forecast.s[0, both, 0] - forecast.s[0, both, 1]).min() > 5.0


def test_one_that_comes_so_fast_that_the_other_would_be_in_its_way_goes_first() -> None:
    """It is 3 m behind, 10 m/s faster, and comes first."""
    road, forecast = drive(Agent("fast", "in_1", 160.0, 12.0), Agent("slow", "in_0", 163.0, 2.0))
    assert 0 < enters(road, forecast, 0) < enters(road, forecast, 1)
    assert forecast.v[0, :, 0].min() > 11.5 and forecast.v[0, :, 1].min() > 1.5


def test_at_a_zipper_the_ego_owes_no_stretch_to_others() -> None:
    """It waits for no stream there: else it stands at the place while the others go."""
    for road, owed in ((zipper(), 0), (zipper()._replace(rule=np.zeros(5, np.int32)), 1)):
        ego = ego_at(road, "in_1", 150.0, 8.0, route=edges(road, "in", "out"))
        scene = scene_of(ego, road, Agent("x", "in_0", 185.0, 8.0))
        local, _ = local_of(task_of(road, ego), scene)
        assert len(local.obligation) == owed


@pytest.mark.parametrize(
    ("left", "right"), [((215.0, 12.0), (210.0, 12.0)), ((190.0, 13.0), (205.0, 10.0))]
)
def test_the_forecast_is_what_sumo_s_drivers_do(
    left: tuple[float, float], right: tuple[float, float], tmp_path: Path
) -> None:
    """Two cars, m and m/s, 300 m of road before the zipper: where they are 6 s later."""
    net = netconvert(
        tmp_path,
        '<node id="a" x="-300" y="0"/><node id="c" x="0" y="0" type="zipper"/>'
        '<node id="z" x="400" y="0"/>',
        '<edge id="in" from="a" to="c" numLanes="2" speed="14"/>'
        '<edge id="out" from="c" to="z" numLanes="1" speed="14"/>',
        '<connection from="in" to="out" fromLane="0" toLane="0"/>'
        '<connection from="in" to="out" fromLane="1" toLane="0"/>',
    )
    car = 'type="car" depart="0"'
    (tmp_path / "x.rou.xml").write_text(
        f"""<routes><vType id="car" sigma="0" speedFactor="1" speedDev="0"/>
        <vehicle id="ego" {car} departPos="10"><route edges="in out"/></vehicle>
        <vehicle id="left" {car} departLane="1" departPos="{left[0]}" departSpeed="{left[1]}">
        <route edges="in out"/></vehicle>
        <vehicle id="right" {car} departLane="0" departPos="{right[0]}" departSpeed="{right[1]}">
        <route edges="in out"/></vehicle></routes>"""
    )
    with simulation(net, [tmp_path / "x.rou.xml"]):
        road = read_roadmap(net)
        libsumo.simulationStep()
        for name in ("left", "right"):
            libsumo.vehicle.setLaneChangeMode(name, 0)
        for _ in range(10):  # until their accelerations are known
            libsumo.simulationStep()
        scene = Observer(road).scene("ego", Change(), 300.0, timing=False)
        for _ in range(60):
            libsumo.simulationStep()
        then = {name: libsumo.vehicle.getPosition(name)[0] for name in ("left", "right")}
    lanes = np.array([scene.ego.lane], np.int32)
    forecast = predict(road, Question(scene, lanes, np.zeros(0), traffic_params(), 6.0))
    for name, x in then.items():
        i = scene.agents.ids.index(name)
        front = forecast.pose[0, -1, i, 0] + 0.5 * scene.agents.length[i]
        assert front == pytest.approx(x, abs=4.0)


def test_the_one_behind_lets_the_ego_pass_and_expects_it() -> None:
    """So moving in front of it costs what a usual driver needs, not a careful one."""
    road = zipper()
    ego = ego_at(road, "in_1", 150.0, 10.0, route=edges(road, "in", "out"))
    behind, ahead = Agent("b", "in_0", 138.0, 10.0), Agent("a", "in_0", 170.0, 10.0)
    task = task_of(road, ego)
    forecast = forecast_of(task, scene_of(ego, road, ahead, behind))
    assert forecast.yields[0].tolist() == [False, True]
    careful, usual = (
        cut_in_cost(task.cost, 12.0, 10.0, 10.0, expects) for expects in (False, True)
    )
    assert 0.0 <= usual < careful
