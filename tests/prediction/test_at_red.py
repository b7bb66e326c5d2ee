"""People at a crossing with a signal, in the forecast."""

import math

import numpy as np
import pytest
from helpers import Agent, Lane, build, edges, ego_at
from helpers_model import compiled, forecast_of, local_of, scene_of, task_of

from sumo_mcts.arrays import Floats
from sumo_mcts.model.local_map import AGENT
from sumo_mcts.model.occupancy import yielding_cost
from sumo_mcts.model.reactions import undisturbed
from sumo_mcts.prediction.at_red import STILL, margins_on_foot
from sumo_mcts.road import PEOPLE_FIRST, VEHICLE_CLASSES
from sumo_mcts.scene import GREEN, RED, YELLOW, Scene, Signals

yielding_cost = compiled(yielding_cost)
ON_FOOT = 1 << VEHICLE_CLASSES.index("pedestrian")
MIDDLE, LOW, HIGH = 8.0, -5.0, 2.0  # m: x and y of the crossing
WEST, SOUTH, NORTH = math.pi, -math.pi / 2, math.pi / 2
STEP = 0.2  # s between the times of a forecast
USUAL = 0.4  # m, the margin around people

# A lane eastward at y = -1.6 through a junction from x = -10 to 10, with a crossing. Vehicles have
# link 0 of the signal, people link 1.
ROAD = build([
    Lane("w", 0, ((-100.0, -1.6), (-10.0, -1.6)), (":w_0",)),
    Lane(":w", 0, ((-10.0, -1.6), (10.0, -1.6)), ("e_0",), junction="c", signal="t", link=0),
    Lane("e", 0, ((10.0, -1.6), (200.0, -1.6))),
    Lane(":c_c0", 0, ((MIDDLE, LOW), (MIDDLE, HIGH)), junction="c", width=4.0, classes=ON_FOOT,
         rule=PEOPLE_FIRST, signal="t", link=1),
])  # fmt: skip


def shows(*phases: tuple[int, float]) -> Signals:
    """What people are shown, phase by phase, and until when (s from now); vehicles have green."""
    return Signals(
        np.array([0, 2], np.int32),
        np.array([[GREEN] * len(phases), [state for state, _ in phases]], np.int32),
        np.array([[until for _, until in phases]]),
    )


def scene(signals: Signals, y: float, heading: float, v: float, x: float = MIDDLE) -> Scene:
    """The ego comes to the junction, and a person is at (x, y)."""
    ego = ego_at(ROAD, "w_0", 60.0, 5.0, route=edges(ROAD, "w", "e"))
    who = Agent("p", "", v=v, length=0.4, width=0.5, x=x, y=y, heading=heading)
    return scene_of(ego, ROAD, who, signals=signals)


def walk(
    signals: Signals, y: float, heading: float, v: float, x: float = MIDDLE
) -> tuple[Floats, Floats]:
    """[T, 4] where it is expected, [T] how fast."""
    now = scene(signals, y, heading, v, x)
    forecast = forecast_of(task_of(ROAD, now.ego), now)
    return forecast.pose[0, :, 0], forecast.v[0, :, 0]


ALWAYS_RED, ALWAYS_GREEN = shows((RED, math.inf)), shows((GREEN, math.inf))
SOON = shows((RED, 3.0), (GREEN, math.inf))


def test_who_comes_to_a_red_light_stops_at_the_kerb() -> None:
    for signals in (ALWAYS_RED, shows((YELLOW, math.inf))):
        way, v = walk(signals, HIGH + 2.0, SOUTH, 1.2)
        assert way[-1, :2] == pytest.approx((MIDDLE, HIGH + 0.5)) and v[-1] == 0.0
    way, v = walk(ALWAYS_GREEN, HIGH + 2.0, SOUTH, 1.2)
    assert way[-1, 1] < LOW and (v == 1.2).all()


def test_also_who_turns_to_it_from_the_corner() -> None:
    red, green = (walk(each, 4.0, WEST, 1.2, 11.0)[0] for each in (ALWAYS_RED, ALWAYS_GREEN))
    assert red[-1, 1] > HIGH and green[-1, 1] < LOW


def test_when_it_turns_green_it_goes_on() -> None:
    way, v = walk(SOON, HIGH + 1.0, SOUTH, 1.0)
    at = round(3.0 / STEP)
    assert (way[5:at, 1] == pytest.approx(HIGH + 0.5)) and (v[5:at] == 0.0).all()
    assert way[at + 10, 1] == pytest.approx(HIGH + 0.5 - 10 * STEP) and v[at + 10] == 1.0


@pytest.mark.parametrize(
    ("y", "heading", "waits"),
    [
        (HIGH - 0.1, SOUTH, True),  # SUMO's people stand on the edge of the crossing
        (HIGH + 1.0, SOUTH + 0.3, True),
        (LOW, NORTH, True),
        (HIGH + 1.0, NORTH, False),  # it looks away
        (HIGH + 5.0, SOUTH, False),
    ],
)
def test_who_stands_at_red_sets_off_at_green(y: float, heading: float, waits: bool) -> None:
    way, v = walk(SOON, y, heading, 0.0)
    before, after = way[: round(3.0 / STEP)], way[round(5.0 / STEP)]
    assert (before[:, 1] == y).all()
    assert (abs(after[1] - y) == pytest.approx(2.8)) == waits and (v[-1] > 1.0) == waits


def test_who_was_on_it_when_it_turned_red_walks_on() -> None:
    way, _ = walk(ALWAYS_RED, HIGH - 1.5, SOUTH, 1.2)
    assert way[-1, 1] < LOW


@pytest.mark.parametrize(
    ("signals", "v", "margin"),
    [
        (ALWAYS_RED, 0.0, STILL),
        (SOON, 0.0, USUAL),
        (ALWAYS_GREEN, 0.0, USUAL),
        (ALWAYS_RED, 1.0, USUAL),
    ],
)
def test_who_keeps_still_at_red_needs_little_room(
    signals: Signals, v: float, margin: float
) -> None:
    now = scene(signals, HIGH, SOUTH, v)
    lanes = np.array([ROAD.lane_ids.index(each) for each in ("w_0", ":w_0", "e_0")], np.int32)
    assert np.all(margins_on_foot(ROAD, lanes, now, USUAL) == pytest.approx(margin))


def test_who_stands_at_red_is_owed_nothing_until_it_goes() -> None:
    """Else an ego could not drive past people who wait at the kerb."""
    ego = ego_at(ROAD, ":w_0", 16.5, 1.0, route=edges(ROAD, "w", "e"))
    who = Agent("p", "", v=0.0, length=0.4, width=0.5, x=MIDDLE, y=HIGH - 0.4, heading=SOUTH)
    task = task_of(ROAD, ego)
    local, state = local_of(task, scene_of(ego, ROAD, who, signals=SOON))
    assert local.obligation[:, AGENT].tolist() == [0.0]
    due = [
        yielding_cost(local, task.ego, task.cost, state, undisturbed(local), round(t / STEP)) > 0.0
        for t in (0.0, 2.8, 3.2)
    ]
    assert due == [False, False, True]
