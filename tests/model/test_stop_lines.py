"""When stop lines are closed: what an ego does that yellow has caught."""

import math

import numpy as np
import pytest
from helpers import edges, ego_at
from helpers_model import local_of, road_with_light, scene_of, task_of

from sumo_mcts.model.local_map import LocalMap
from sumo_mcts.scene import AFTER_STOP, GREEN, RED, YELLOW, Signals


def before_light(
    v: float, distance: float, *phases: tuple[int, float], stood: bool = False
) -> LocalMap:
    """An ego before a light with these phases (state, end in s from now)."""
    road = road_with_light()
    ego = ego_at(road, "a_0", 200.0 - distance, v, route=edges(road, "a", "b"))
    states, until = zip(*phases, strict=True)
    signals = Signals(np.array([0, 1], np.int32), np.array([states], np.int32), np.array([until]))
    cleared = frozenset([0] if stood else [])
    return local_of(task_of(road, ego), scene_of(ego, road, signals=signals), cleared)[0]


@pytest.mark.parametrize(
    ("distance", "left", "opened"),
    [
        (25.0, 3.0, True),  # needs 3.1 m/s2, is over the line after 2 s
        (27.0, 3.0, False),  # needs 2.9
        (25.0, 1.9, False),  # red comes first, and it can stop
        (12.0, 0.5, True),  # red comes first, and it cannot stop with 6 m/s2 either
    ],
)
def test_an_ego_passes_yellow_where_it_cannot_stop_and_reaches_the_line_in_time(
    distance: float, left: float, opened: bool
) -> None:
    local = before_light(12.5, distance, (YELLOW, left), (RED, 60.0), (GREEN, math.inf))
    assert (local.closed[0] == 0).all() == opened
    assert np.isinf(local.yellow).all()  # yellow is there already


@pytest.mark.parametrize("stood", [False, True])
def test_red_that_may_be_passed_after_a_stop_is_closed_until_then(stood: bool) -> None:
    local = before_light(0.0, 2.0, (AFTER_STOP, 5.0), (RED, math.inf), stood=stood)
    early = int(4.9 / local.dt)
    assert (local.closed[0, :early] == (not stood)).all()
    assert local.closed[0, early + 1 :].all()


def test_the_next_yellow_is_known() -> None:
    local = before_light(
        12.5, 100.0, (RED, 2.0), (GREEN, 7.0), (YELLOW, 9.0), (YELLOW, 10.0), (RED, math.inf)
    )
    assert local.yellow[0].tolist() == [7.0, 10.0]
    assert np.isinf(local.yellow[1:]).all()


@pytest.mark.parametrize(
    "phases",
    [[(GREEN, math.inf)], [(GREEN, 4.0), (RED, math.inf)], [(RED, 3.0), (YELLOW, math.inf)]],
)
def test_without_green_before_it_there_is_no_yellow_to_pass(
    phases: list[tuple[int, float]],
) -> None:
    """In some countries red and yellow come before green."""
    assert np.isinf(before_light(12.5, 100.0, *phases).yellow).all()
