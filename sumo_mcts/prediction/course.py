"""What lies on the predicted paths: lanes and limits, red lights, stop signs, ends, conflicts."""

import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Ints
from sumo_mcts.numerics.kernel import kernel
from sumo_mcts.numerics.lanes import limits
from sumo_mcts.numerics.signals import signal_states
from sumo_mcts.prediction.conflicts import conflicts_of
from sumo_mcts.prediction.paths import NARROWS, Paths
from sumo_mcts.road import ALLWAY, STOP, RoadMap
from sumo_mcts.scene import AFTER_STOP, GREEN, Signals

SIGN_VIEW = 60.0  # m before a stop sign from which on a driver brakes for it


class Course(NamedTuple):
    """What lies on the paths of N vehicles, of at most L lanes each, at T times."""

    path: Ints  # [N, L] lanes, -1 beyond the end
    offset: Floats  # [N, L+1] where each begins, m from the start of the first
    lanes: Ints  # [N] how many there are; 0: the vehicle is off the road, or a person
    limit: Floats  # [N, L] m/s
    internal: Bools  # [N, L] inside a junction
    red: Bools  # [N, L, T] the signal at the entry of this lane shows red or yellow
    sign: Bools  # [N, L] a vehicle has to stand before it enters this lane
    # [N] m, where the last lane ends beside lanes that go on; inf: it goes on itself, or the road
    # ends
    end: Floats
    along: Ints  # [N, N] as in Conflicts
    # As in Conflicts, F foes. They are not a tuple of their own: kernels are 10 % slower with one
    # inside another.
    foe: Ints  # [N, F]
    kind: Ints  # [N, F]
    place: Floats  # [N, F, 4]


def course_of(road: RoadMap, signals: Signals, paths: Paths, vclass: Ints, times: Floats) -> Course:
    """What lies on the paths of vehicles of these classes [N] at `times` [T], s from now."""
    conflicts = conflicts_of(road, paths)
    red, after_stop = _red_lights(road, signals, paths, times)
    last = paths.offset[np.arange(len(paths.count)), paths.count]
    return Course(
        path=paths.lane,
        offset=paths.offset,
        lanes=paths.count,
        limit=limits(road, paths.lane, vclass[:, None]),
        internal=road.internal[paths.lane],
        red=red,
        sign=stop_signs(road, paths) | after_stop,
        end=np.where(paths.ends == NARROWS, last, np.inf),
        along=conflicts.along,
        foe=conflicts.foe,
        kind=conflicts.kind,
        place=conflicts.place,
    )


def _red_lights(
    road: RoadMap, signals: Signals, paths: Paths, times: Floats
) -> tuple[Bools, Bools]:
    """[N, L, T] the signal at the entry of this lane of the path shows red or yellow, and [N, L] it
    shows now that it may be passed after a stop: as long as it does it is not red."""
    red = np.zeros((*paths.lane.shape, len(times)), np.bool_)
    after_stop = np.zeros(paths.lane.shape, np.bool_)
    rows, places = np.nonzero((paths.lane[:, 1:] >= 0) & (road.signal[paths.lane[:, 1:]] >= 0))
    lanes, which = np.unique(paths.lane[rows, places + 1], return_inverse=True)
    signal, link = road.signal[lanes], road.link[lanes]
    states = signal_states(signals, signal, link, times)
    # A light that changes at this very moment has not done so yet: who stands before it waits.
    states[:, times <= 0.0] = signals.state[signals.offset[signal] + link, :1]
    may_go = states[:, :1] == AFTER_STOP
    red[rows, places + 1] = ((states != GREEN) & ~(may_go & (states == AFTER_STOP)))[which]
    after_stop[rows, places + 1] = may_go[which, 0]
    return red, after_stop


def stop_signs(road: RoadMap, paths: Paths) -> Bools:
    """[N, L] a vehicle has to stand before it enters this lane of the path."""
    rule = road.rule[paths.lane]
    sign = (paths.lane >= 0) & ((rule == STOP) | (rule == ALLWAY)) & (road.signal[paths.lane] < 0)
    sign[:, 0] = False
    return np.asarray(sign)


# --- what is ahead of vehicle i, on the k-th lane of its path ---


@kernel
def red_ahead(c: Course, i: int, k: int, t: int, place: float) -> bool:
    """Whether there is a red light before `place` (m on the path) at the t-th time."""
    for m in range(k + 1, c.lanes[i]):
        if c.offset[i, m] > place:
            return False
        if c.red[i, m, t]:
            return True
    return False


@kernel
def to_sign(c: Course, i: int, k: int, x: float) -> float:
    """m from `x` to the next stop sign; inf where there is none near."""
    for m in range(k + 1, c.lanes[i]):
        if c.offset[i, m] - x > SIGN_VIEW:
            break
        if c.sign[i, m]:
            return float(c.offset[i, m] - x)
    return math.inf


@kernel
def waiting_place(c: Course, i: int, k: int, begin: float) -> float:
    """The place where the vehicle waits before a stretch that begins at `begin`, m on its path. It
    is the entry of the junction, or a waiting place inside it."""
    place = begin
    for m in range(k + 1, c.path.shape[1]):
        if c.offset[i, m] >= begin or c.path[i, m] < 0:
            break
        place = c.offset[i, m] if c.internal[i, m] else begin
    return place
