"""People at a crossing where they have to let vehicles pass, inside the search."""

import math

import numpy as np
import pytest
from helpers import Agent, Lane, build, edges, ego_at
from helpers_model import compiled, local_of, scene_of, task_of

from sumo_mcts.model.kerbs import stands_aside, walk
from sumo_mcts.model.local_map import CLOCK, ENTERS, KERB, OWED, PAST, SLOT, LocalMap, State
from sumo_mcts.model.occupancy import yielding_cost
from sumo_mcts.model.reactions import undisturbed
from sumo_mcts.planners.base import Task
from sumo_mcts.planners.baselines import with_yield_lines
from sumo_mcts.road import LEFT, PEOPLE_FIRST, PEOPLE_WAIT, RIGHT, VEHICLE_CLASSES, RoadMap

walk = compiled(walk)
stands_aside = compiled(stands_aside)
yielding_cost = compiled(yielding_cost)
ON_FOOT = 1 << VEHICLE_CLASSES.index("pedestrian")
DT = 0.2  # s between forecast times
V = 1.2  # m/s of the person
BEGIN, END = 12.0, 16.0  # m along the ego's lane inside the junction: the crossing


def road(rule: int = PEOPLE_WAIT) -> RoadMap:
    """A turn to the left, drawn straight, with a crossing from y = -5 to 2 at its end."""
    return build([
        Lane("w", 0, ((-100.0, -1.6), (0.0, -1.6)), (":w_0",)),
        Lane(":w", 0, ((0.0, -1.6), (16.5, -1.6)), ("e_0",), junction="c", direction=LEFT),
        Lane("e", 0, ((16.5, -1.6), (200.0, -1.6))),
        Lane(":c_c0", 0, ((14.0, -5.0), (14.0, 2.0)), junction="c", width=4.0, classes=ON_FOOT,
             rule=rule),
    ])  # fmt: skip


def to_the_right(kerb: float = 2.0) -> RoadMap:
    """The same, reached by a turn to the right, and the crossing begins at y = `kerb`."""
    return build([
        Lane("w", 0, ((0.0, -100.0), (0.0, -1.6)), (":w_0",)),
        Lane(":w", 0, ((0.0, -1.6), (16.5, -1.6)), ("e_0",), junction="c", direction=RIGHT),
        Lane("e", 0, ((16.5, -1.6), (200.0, -1.6))),
        Lane(":c_c0", 0, ((14.0, -5.0), (14.0, kerb)), junction="c", width=4.0, classes=ON_FOOT,
             rule=PEOPLE_WAIT),
    ])  # fmt: skip


def road_of_two() -> RoadMap:
    """The same with a lane on the right."""
    return build([
        Lane("w", 0, ((-100.0, -4.8), (0.0, -4.8)), (":w_0",)),
        Lane("w", 1, ((-100.0, -1.6), (0.0, -1.6)), (":w_1",)),
        Lane(":w", 0, ((0.0, -4.8), (16.5, -4.8)), ("e_0",), junction="c", direction=LEFT),
        Lane(":w", 1, ((0.0, -1.6), (16.5, -1.6)), ("e_1",), junction="c", direction=LEFT),
        Lane("e", 0, ((16.5, -4.8), (200.0, -4.8))),
        Lane("e", 1, ((16.5, -1.6), (200.0, -1.6))),
        Lane(":c_c0", 0, ((14.0, -8.0), (14.0, 2.0)), junction="c", width=4.0, classes=ON_FOOT,
             rule=PEOPLE_WAIT),
    ])  # fmt: skip


def meeting(on: RoadMap, lane: str, s: float, v: float, y: float) -> tuple[Task, LocalMap, State]:
    """The ego on its way over the crossing, and a person at `y` who walks south to it."""
    ego = ego_at(on, lane, s, v, route=edges(on, "w", "e"))
    who = Agent("p", "", v=V, length=0.2, width=0.5, x=14.0, y=y, heading=-math.pi / 2)
    task = task_of(on, ego)
    return task, *local_of(task, scene_of(ego, on, who))


def walked(s: float, v: float, y: float = 3.0, seconds: float = 2.0, lane: str = ":w_0") -> float:
    """m that the person has walked while the ego drives on from `s`, at a speed of `v`."""
    task, local, state = meeting(road(), lane, s, v, y)
    others = undisturbed(local)
    for t in range(1, round(seconds / DT) + 1):
        state = state._replace(s=state.s + v * DT)
        walk(local, task.ego, state, others, t, 0, DT)
    return float(np.interp(others[0, CLOCK], np.arange(len(local.agent)), local.agent[:, 0, -1]))


@pytest.mark.parametrize(
    ("s", "v", "waits"),
    [
        (6.0, 4.0, True),  # it is over the crossing before the person is past its way
        (10.0, 2.0, True),
        (1.0, 1.0, False),  # it is not
        (11.5, 0.0, False),  # who stands is not waited for, however near it is
    ],
)
def test_who_is_at_the_kerb_waits_for_an_ego_that_comes_over_the_crossing(
    s: float, v: float, waits: bool
) -> None:
    local = meeting(road(), ":w_0", s, v, 3.0)[1]
    kerb = local.obligation[int(local.trait[0, OWED]), KERB]
    assert 0.0 <= kerb <= 1.0
    assert (walked(s, v) <= kerb) == waits
    if not waits:
        assert walked(s, v) == pytest.approx(2.0 * V)


def test_nobody_waits_for_an_ego_that_is_not_in_the_junction_yet() -> None:
    """It may still stop at its line. Whether it is let pass there is for the forecast to say."""
    assert walked(85.0, 4.0, lane="w_0") == pytest.approx(2.0 * V)


def test_who_is_on_the_crossing_or_has_the_right_of_way_walks_on() -> None:
    for on, y in ((road(), 1.0), (road(PEOPLE_FIRST), 3.0)):
        local = meeting(on, ":w_0", 6.0, 4.0, y)[1]
        assert local.trait[0, SLOT] == local.trait[0, OWED] == -1.0
        assert not local.obligation[:, PAST].any()


@pytest.mark.parametrize(("kerb", "waits"), [(2.0, True), (0.0, True), (-0.3, False)])
def test_nobody_waits_where_the_ego_comes_too_near_to_the_kerb(kerb: float, waits: bool) -> None:
    """Where it turns to the near side its rear cuts the corner."""
    local = meeting(to_the_right(kerb), ":w_0", 6.0, 4.0, kerb + 1.0)[1]
    assert local.obligation[:, PAST].any() == waits
    assert (local.obligation[:, ENTERS] < math.inf).any()


@pytest.mark.parametrize(
    ("s", "v", "y", "due"),
    [
        (8.0, 5.0, -1.6, True),  # it could not stop before the crossing
        (8.0, 1.0, -1.6, False),
        (11.0, 0.0, -1.6, False),
        (8.0, 5.0, -3.2, False),  # who has left its part of the crossing is not in its way
    ],
)
def test_nobody_drives_at_a_person_faster_than_it_could_stop(
    s: float, v: float, y: float, due: bool
) -> None:
    task, local, state = meeting(to_the_right(), ":w_0", s, v, y)
    price = yielding_cost(local, task.ego, task.cost, state, undisturbed(local), 0)
    assert (price > 0.0) == due
    if due:
        later = round(2.5 / DT)  # it has walked 3 m by then
        assert yielding_cost(local, task.ego, task.cost, state, undisturbed(local), later) == 0.0


@pytest.mark.parametrize("lane", [":w_0", ":w_1"])
def test_they_wait_for_an_ego_in_any_of_several_lanes(lane: str) -> None:
    """The crossing is owed to them on each lane; the last one counted, wherever the ego was."""
    task, local, state = meeting(road_of_two(), lane, 8.0, 4.0, 3.0)
    assert stands_aside(local, task.ego, state, undisturbed(local), 0)


def test_nobody_waits_in_turn_for_who_stands_at_the_kerb() -> None:
    """It never enters, and counted as who enters at once, and as a stream without a gap."""
    ego = ego_at(on := road(), "w_0", 60.0, 10.0, route=edges(on, "w", "e"))
    task = task_of(on, ego)
    for v, waits in ((V, True), (0.0, False)):
        who = Agent("p", "", v=v, length=0.2, width=0.5, x=14.0, y=2.4, heading=-math.pi / 2)
        local, state = local_of(task, scene_of(ego, on, who))
        assert local.obligation[:, PAST].any()
        assert with_yield_lines(local, state, 5.0).closed.any() == waits
        assert (len(local.gate) > 0) == waits
