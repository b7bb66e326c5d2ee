"""What counts as an event of a driver, by hand."""

import numpy as np
import pytest
from helpers import lane, straight_road

from sumo_mcts.arrays import Ints
from sumo_mcts.evaluation.driver_events import EVENTS, Course, foreseen, of_intent
from sumo_mcts.scene import BRAKES, FORCES, STARTS, Forecast, Intent

ROAD = straight_road()
RIGHT, LEFT, BEYOND = (lane(ROAD, name) for name in ("a_0", "a_1", ":m_1"))


def course(
    lanes: list[int], v: list[float] | None = None, there: list[bool] | None = None
) -> Course:
    """One agent, half a second between the times."""
    n = len(lanes)
    return Course(
        0.5,
        np.array([v or [10.0] * n]).T,
        np.array([lanes], np.int32).T,
        np.array([there or [True] * n]).T,
    )


def now(lane: int) -> Ints:
    return np.array([lane], np.int32)


def happens(name: str, what: Course, likely: Course | None = None) -> bool:
    first = now(int(what.lane[0, 0]))
    return bool(EVENTS[name](ROAD, first, what, likely or what)[0])


def test_a_change_is_another_lane_of_the_same_edge() -> None:
    over = course([RIGHT, RIGHT, LEFT])
    assert happens("changes left", over) and not happens("changes right", over)
    back = course([LEFT, RIGHT, LEFT])
    assert happens("changes right", back) and not happens("changes left", back)
    ahead = course([RIGHT, BEYOND, BEYOND])  # onto the next edge
    assert not happens("changes left", ahead) and happens("enters", ahead)
    assert not happens("enters", over)
    gone = course([RIGHT, LEFT, LEFT], there=[True, False, False])
    assert not happens("changes left", gone)


@pytest.mark.parametrize(
    ("name", "speeds", "expected"),
    [
        ("starts", [0.0, 0.5, 1.5], True),
        ("starts", [0.0, 0.5, 0.9], False),
        ("stops", [5.0, 2.0, 0.05], True),
        ("stops", [5.0, 2.0, 0.2], False),
        ("brakes hard", [10.0, 9.0, 6.9], True),
        ("brakes hard", [10.0, 9.0, 7.1], False),
        ("brakes hard", [10.0, 8.5, 7.1, 6.0], False),  # never so much within a second
    ],
)
def test_speeds(name: str, speeds: list[float], expected: bool) -> None:
    assert happens(name, course([RIGHT] * len(speeds), speeds)) is expected


def test_falling_back_is_against_the_likeliest_course() -> None:
    likely, real = course([RIGHT] * 3, [10.0, 8.0, 6.0]), course([RIGHT] * 3, [10.0, 7.0, 2.9])
    assert happens("falls back", real, likely)
    assert not happens("falls back", likely, likely)
    assert not happens("falls back", likely, real)


def test_a_hypothesis_is_read_at_the_nearest_times() -> None:
    v = np.arange(6.0)[None, :, None] * np.array([1.0, 10.0])[:, None, None]
    none = np.zeros(1)
    forecast = Forecast(
        0.2, np.full(2, 0.5), np.zeros((2, 6, 1, 4)), v, np.zeros((2, 6, 1), np.int32), v,
        np.ones((2, 6, 1), np.bool_), none, none, none > 0, np.zeros((2, 1), np.bool_),
    )  # fmt: skip
    assert foreseen(forecast, 1, 0.4, 3).v[:, 0].tolist() == [0.0, 20.0, 40.0]
    assert foreseen(forecast, 0, 0.5, 4).v[:, 0].tolist() == [0.0, 2.0, 5.0, 5.0]


def test_what_is_asked_of_a_hypothesis() -> None:
    def asked(does: int, v: float = 5.0) -> str:
        found = of_intent(Intent(0, does), v)
        return found[0] if found else ""

    assert asked(BRAKES) == "brakes for no reason" and asked(BRAKES, 0.9) == "goes on waiting"
    assert asked(BRAKES, 1.0) == "brakes for no reason"
    assert asked(FORCES) == "forces its way" and asked(STARTS) == "starts after a while"
    others = {BRAKES, FORCES, STARTS}
    assert all(asked(does) == "" for does in range(-1, 9) if does not in others)
    waits, drives = course([RIGHT] * 3, [0.0, 0.2, 0.5]), course([RIGHT] * 3, [0.0, 0.8, 1.6])
    question = of_intent(Intent(0, BRAKES), 0.0)
    assert question is not None
    for what, stays in ((waits, True), (drives, False)):
        assert bool(question[1](ROAD, now(RIGHT), what, what)[0]) is stays
