"""How long an ego waits for the lane of its stop."""

from unittest import mock

import numpy as np
import pytest
from helpers import Agent, Lane, agents_at, build, edges, ego_at, lights
from helpers_model import lanes_east

from sumo_mcts import config
from sumo_mcts.driver import missed_stop
from sumo_mcts.driver.missed_stop import MissedStop
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import GREEN, RED, EgoState, Scene, Stop

PERIOD, PATIENCE = 0.5, 5.0
ROAD = lanes_east(3)
STOP = Stop(0, 299.8, 300.0)


def watch_of(patience: float | None = PATIENCE, road: RoadMap = ROAD) -> MissedStop:
    scenario = {
        "name": "x",
        "sumo": {"net": "x.net.xml"},
        "egos": [{"id": "ego"}],
        "ego_model": {"reroute_after_s": patience},
    }
    return MissedStop("ego", road, config.build(scenario, "test"), PERIOD)


def told(watch: MissedStop, ego: EgoState, cycles: int, *others: Agent) -> list[tuple[int, str]]:
    """What is done in which of so many cycles in which the scene is the same."""
    found = []
    agents = agents_at(ROAD, *others)
    begin = max(watch._time, 0.0)
    with mock.patch.object(missed_stop, "skip_next") as skip:
        for k in range(1, cycles + 1):
            scene = Scene(begin + k * PERIOD, 0.1, ego, agents, lights())
            if said := watch.note(scene):
                found.append((k, said))
                assert watch.note(scene) == said
    assert skip.call_count == len(found)
    return found


def ego_on(lane: str, s: float, v: float = 0.0) -> EgoState:
    return ego_at(ROAD, lane, s, v)._replace(stop=STOP)


def standing(name: str, lane: str, s: float) -> Agent:
    return Agent(name, on=lane, s=s, v=0.0)


def test_it_waits_beside_its_stop_for_so_long() -> None:
    ((k, said), *_) = told(watch_of(), ego_on("a_1", 298.0), 12)
    assert k == PATIENCE / PERIOD
    assert said == "gives up its stop on a_0 at 300 m: stood beside it 5 s"


@pytest.mark.parametrize(
    "ego",
    [
        ego_on("a_1", 298.0, v=1.0),
        ego_on("a_1", 298.0)._replace(held=True),
        ego_on("a_0", 298.0),
        ego_on("a_1", 298.0)._replace(stop=STOP._replace(speed=4.0)),
        ego_on("a_1", 298.0)._replace(stop=STOP._replace(after=1)),
    ],
    ids=["drives", "held", "in its lane", "waypoint", "on another edge"],
)
def test_it_does_not_wait_for_a_gap_there(ego: EgoState) -> None:
    assert not told(watch_of(), ego, 40)


def test_it_may_have_patience_for_ever() -> None:
    assert not told(watch_of(None), ego_on("a_1", 298.0), 400)


def test_who_stands_behind_others_waits_for_them() -> None:
    assert not told(watch_of(), ego_on("a_1", 280.0), 40, standing("x", "a_1", 290.0))


def test_in_the_lane_of_its_stop_it_gives_up_what_it_can_drive_past() -> None:
    queue = [standing("x", "a_0", 290.0)]
    ((_, said), *_) = told(watch_of(), ego_on("a_0", 280.0), 12, *queue)
    assert said.endswith("stood behind others 5 s")
    beside = [standing("y", "a_1", 290.0)]
    assert not told(watch_of(), ego_on("a_0", 280.0), 40, *queue, *beside)


def test_a_queue_that_moves_on_is_waited_for() -> None:
    watch, queue = watch_of(), [standing("x", "a_0", 290.0)]
    for _ in range(4):
        assert not told(watch, ego_on("a_0", 280.0), 8, *queue)
        assert not told(watch, ego_on("a_0", 280.0, v=2.0), 1, *queue)


def test_for_the_next_stop_on_the_same_lane_it_waits_anew() -> None:
    """It gave that one up, too, as soon as it stood beside it."""
    watch = watch_of()
    first = ego_on("a_1", 198.0)._replace(stop=Stop(0, 199.8, 200.0))
    ((k, _), *_) = told(watch, first, int(PATIENCE / PERIOD))
    ((again, _), *_) = told(watch, ego_on("a_1", 298.0), 12)
    assert k == again == PATIENCE / PERIOD


def test_a_lane_of_the_oncoming_is_no_way_past_a_queue() -> None:
    """Where the road has one, a stop behind a long red light was given up."""
    queue = standing("x", "a_1", 290.0)
    ego = ego_on("a_1", 280.0)._replace(stop=STOP._replace(lane=1))
    alone = ROAD._replace(right=np.full_like(ROAD.right, -1))  # but for the lane on the left
    for road, gives_up in ((alone, True), (alone._replace(oncoming=np.zeros(1, np.int32)), False)):
        assert bool(told(watch_of(road=road), ego, 12, queue)) == gives_up


@pytest.mark.parametrize(("light", "gives_up"), [(RED, False), (GREEN, True)])
def test_a_queue_before_a_red_light_is_waited_for(light: int, gives_up: bool) -> None:
    """A red of a minute took the ego the stop that it would have come to with the next green."""
    road = build([
        Lane("a", 0, ((0.0, 0.0), (300.0, 0.0)), (":m_0",)),
        Lane("a", 1, ((0.0, 3.2), (300.0, 3.2))),
        Lane(":m", 0, ((300.0, 0.0), (320.0, 0.0)), ("b_0",), junction="m", signal="t", link=0),
        Lane("b", 0, ((320.0, 0.0), (600.0, 0.0))),
    ])  # fmt: skip
    ego = ego_at(road, "a_0", 180.0, 0.0, route=edges(road, "a", "b"))
    ego = ego._replace(stop=Stop(0, 199.8, 200.0, after=1))
    watch, agents = watch_of(road=road), agents_at(road, standing("x", "a_0", 190.0))
    with mock.patch.object(missed_stop, "skip_next"):
        said = [
            watch.note(Scene(k * PERIOD, 0.1, ego, agents, lights(light))) for k in range(1, 13)
        ]
    assert any(said) == gives_up
