"""The drivers that a forecast moves: what they do now, and how they are taken to drive."""

from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices, Ints


class TrafficParams(NamedTuple):
    """How drivers are taken to drive: config.PredictionConfig, and `aside` from sensing.aside_m."""

    step: float  # s between two times of the forecast
    headway: float  # s that a driver keeps to its leader,
    gap: float  # and m beyond that
    accel: float  # m/s2, of the car-following model
    decel: float  # m/s2, positive: comfortable
    yield_decel: float  # m/s2, positive: with more than this no driver brakes for the ego
    yield_gap: float  # s that a driver leaves before one that has the right of way
    stays_after: float  # s of standing after which a vehicle is taken to stay
    # s after which 1/e is left of what a driver did otherwise than expected; 0: nothing is left
    persistence: float
    # Half of SUMO's step, s: its positions follow the speed at the end of a step. 0 where it
    # integrates ballistically.
    euler: float
    interacting: bool  # False: constant velocity
    # m off the centre line of its lane from which a blinking vehicle has surely begun to leave it
    aside: float


class Drivers(NamedTuple):
    """N drivers at the first time of the forecast; row 0 is the ego."""

    x: Floats  # [N] front, m from the start of the path
    v: Floats  # [N] m/s
    length: Floats  # [N] m
    stays: Bools  # [N] it has stood for a while, and is not expected to move
    cruises: Bools  # [N] it keeps its speed where no leader is near
    # [N] when it came to a stand from which it has hardly moved, s from now (below 0: ago); inf: it
    # has not
    stood: Floats
    turn: Ints  # [N] who goes first of those that are equal otherwise: the lower one
    trend: Floats  # [N] m/s2, its smoothed acceleration
    does: Indices  # [N] as in Intent.does
    vclass: Ints  # [N] as in Agents


_NONE, _NO = np.zeros(0), np.zeros(0, np.bool_)
NO_DRIVERS = Drivers(
    x=_NONE, v=_NONE, length=_NONE, stays=_NO, cruises=_NO, stood=_NONE,
    turn=np.zeros(0, np.int32), trend=_NONE, does=np.zeros(0, np.int64),
    vclass=np.zeros(0, np.int32),
)  # fmt: skip


class Progress(NamedTuple):
    """What a forecast carries for N vehicles from one time to the next; kernels write into it."""

    at: Ints  # [N] position in its path of the lane that a vehicle is on
    # [N] when it came to a stand at the stop sign ahead, s from now; inf: it has not. INSIDE a
    # junction it comes before all others.
    rank: Floats
    liked: Floats  # [N] speed that it does not exceed, m/s
    # [N] m/s2 by which it accelerates otherwise than expected: it follows in another manner, or
    # knows more
    habit: Floats
