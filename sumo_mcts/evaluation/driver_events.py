"""What drivers do within the next seconds, as events: of forecasts and of what then happened."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Ints
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import BRAKES, FORCES, STANDING, STARTS, Forecast, Intent

MOVES = 1.0  # m/s from which on a vehicle moves
FAST = 4.0  # m/s from which on it can brake hard
HARD = 3.0  # m/s lost within a second: it brakes hard


class Course(NamedTuple):
    """N agents at T times, `dt` s apart; the first is now."""

    dt: float
    v: Floats  # [T, N] m/s
    lane: Ints  # [T, N] of the front, -1 off the road
    there: Bools  # [T, N] it is on the road


def foreseen(forecast: Forecast, h: int, dt: float, count: int) -> Course:
    """A hypothesis of a forecast, at the times of it that are nearest to `count` times `dt` s
    apart."""
    last = forecast.v.shape[1] - 1
    times = np.minimum(np.round(np.arange(count) * dt / forecast.dt).astype(int), last)
    return Course(dt, forecast.v[h, times], forecast.lane[h, times], forecast.valid[h, times])


# road, lanes now [N], course, the usual course as the forecast has it -> [N]
Event = Callable[[RoadMap, Ints, Course, Course], Bools]


def changes_right(road: RoadMap, lane: Ints, course: Course, usual: Course) -> Bools:
    """It comes to a lane further right on its edge."""
    return _changes(road, lane, course, -1)


def changes_left(road: RoadMap, lane: Ints, course: Course, usual: Course) -> Bools:
    """It comes to a lane further left on its edge."""
    return _changes(road, lane, course, 1)


def _changes(road: RoadMap, lane: Ints, course: Course, side: int) -> Bools:
    same = (road.edge[course.lane] == road.edge[lane]) & (course.lane >= 0) & course.there
    return np.asarray(
        (same & ((road.index[course.lane] - road.index[lane]) * side > 0)).any(axis=0)
    )


def starts(road: RoadMap, lane: Ints, course: Course, usual: Course) -> Bools:
    """It moves."""
    return np.asarray((course.v > MOVES).any(axis=0))


def stops(road: RoadMap, lane: Ints, course: Course, usual: Course) -> Bools:
    """It comes to a stand."""
    return np.asarray(((course.v < STANDING) & course.there).any(axis=0))


def brakes(road: RoadMap, lane: Ints, course: Course, usual: Course) -> Bools:
    """It loses HARD m/s within a second."""
    span = max(1, round(1.0 / course.dt))
    lost = course.v[:-span] - course.v[span:]
    return np.asarray(((lost > HARD) & course.there[span:]).any(axis=0))


def falls_back(road: RoadMap, lane: Ints, course: Course, usual: Course) -> Bools:
    """It is HARD m/s slower than the usual course has it."""
    slower = usual.v - course.v > HARD
    return np.asarray((slower & course.there & usual.there).any(axis=0))


def enters(road: RoadMap, lane: Ints, course: Course, usual: Course) -> Bools:
    """It leaves its edge, for the junction."""
    left = (road.edge[course.lane] != road.edge[lane]) & (course.lane >= 0) & course.there
    return np.asarray(left.any(axis=0))


EVENTS: dict[str, Event] = {
    "changes right": changes_right,
    "changes left": changes_left,
    "starts": starts,
    "stops": stops,
    "brakes hard": brakes,
    "falls back": falls_back,
    "enters": enters,
}


def stays(road: RoadMap, lane: Ints, course: Course, usual: Course) -> Bools:
    """It does not move."""
    return ~starts(road, lane, course, usual)


def of_intent(intent: Intent, v: float) -> tuple[str, Event] | None:
    """What it is called, and what happens, if an agent at `v` m/s does what a hypothesis has it
    do; None for turns, which take longer."""
    if intent.does == BRAKES:
        return ("goes on waiting", stays) if v < MOVES else ("brakes for no reason", falls_back)
    return {
        FORCES: ("forces its way", enters),
        STARTS: ("starts after a while", starts),
    }.get(intent.does)
