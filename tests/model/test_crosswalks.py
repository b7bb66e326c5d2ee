"""An ego that ends on a crossing for people on foot."""

import pytest
from helpers import Agent, Lane, build, edges, ego_at
from helpers_model import compiled, local_of, scene_of, task_of

from sumo_mcts.model.cost import terminal
from sumo_mcts.model.crosswalks import stays_on_crosswalk
from sumo_mcts.model.local_map import LocalMap, State
from sumo_mcts.planners.base import Task
from sumo_mcts.road import PEOPLE_FIRST, VEHICLE_CLASSES

stays_on_crosswalk = compiled(stays_on_crosswalk)
terminal = compiled(terminal)
ON_FOOT = 1 << VEHICLE_CLASSES.index("pedestrian")
LENGTH = 5.0  # m, of the ego

# A lane through a junction from x = 0 to 20, with a crossing from x = 12 to 16.
ROAD = build([
    Lane("w", 0, ((-100.0, -1.6), (0.0, -1.6)), (":w_0",)),
    Lane(":w", 0, ((0.0, -1.6), (20.0, -1.6)), ("e_0",), junction="c"),
    Lane("e", 0, ((20.0, -1.6), (200.0, -1.6))),
    Lane(":c_c0", 0, ((14.0, -5.0), (14.0, 2.0)), junction="c", width=4.0, classes=ON_FOOT,
         rule=PEOPLE_FIRST),
])  # fmt: skip


def cycle(
    x: float = 14.0, y: float = 3.0, person: bool = True, at: tuple[str, float] = ("w_0", 90.0)
) -> tuple[Task, LocalMap, State]:
    """The ego comes to the junction, and somebody stands at (x, y)."""
    ego = ego_at(ROAD, *at, 5.0, route=edges(ROAD, "w", "e"))
    who = (Agent("p", "", v=0.0, length=0.3, width=0.5, x=x, y=y),) if person else ()
    task = task_of(ROAD, ego)
    return task, *local_of(task, scene_of(ego, ROAD, *who))


@pytest.mark.parametrize(
    ("lane", "s", "v", "stays"),
    [
        (":w_0", 8.0, 0.0, False),  # before it
        (":w_0", 12.0, 0.0, True),
        (":w_0", 18.0, 0.0, True),
        ("e_0", 0.5, 0.0, True),  # its rear
        ("e_0", 2.0, 0.0, False),
        ("w_0", 12.0, 0.0, False),
        (":w_0", 12.0, 10.0, False),  # it drives off it
    ],
)
def test_where_its_body_is_on_the_crossing(lane: str, s: float, v: float, stays: bool) -> None:
    task, local, _ = cycle()
    node = task.route.lane.tolist().index(ROAD.lane_ids.index(lane))
    assert bool(stays_on_crosswalk(local, State(node, s, v, 0.0, 0.0, -1, 0.0))) == stays


def test_without_people_near_a_crossing_is_a_piece_of_road() -> None:
    assert len(cycle()[1].crosswalk) == 2
    assert not len(cycle(person=False)[1].crosswalk)
    assert not len(cycle(x=60.0)[1].crosswalk)


def test_who_is_on_it_already_has_nothing_to_choose() -> None:
    assert len(cycle(at=(":w_0", 8.0))[1].crosswalk) == 2
    assert not len(cycle(at=(":w_0", 13.0))[1].crosswalk)
    assert not len(cycle(at=("e_0", 0.5))[1].crosswalk)


def test_waiting_on_it_gains_nothing() -> None:
    """Else an ego drove onto it in the last second of green, to wait there until it could be hit
    rather than at the line."""
    task, local, _ = cycle()
    nodes = [task.route.lane.tolist().index(ROAD.lane_ids.index(each)) for each in ("w_0", ":w_0")]
    line, on_it = (
        terminal(local, task.cost, State(n, s, 0.0, 0.0, 0.0, -1, 0.0), 1e9, 0.0, 8.0)
        for n, s in zip(nodes, (99.0, 14.0), strict=True)
    )
    assert on_it > line + 0.9 * task.cost.beyond_s * task.cost.progress
