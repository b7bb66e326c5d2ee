"""The stop lines ahead: when they may not be crossed, at red and yellow lights and stop signs, and
what the local map keeps of them."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.arrays import Floats, Ints
from sumo_mcts.model.halts import LINE_BEYOND
from sumo_mcts.model.local_map import State
from sumo_mcts.model.oncoming import Sight
from sumo_mcts.model.route import RouteMap, stop_ahead
from sumo_mcts.numerics.signals import signal_states
from sumo_mcts.scene import AFTER_STOP, GREEN, YELLOW, Forecast, Scene

# m/s2 of braking beyond which the ego does not stop for red: yellow was short, or it departs right
# before a red light
RED_DECEL = 6.0

BEFORE_SIGN = 2.0  # m before the line of a stop sign: the place to stand
NEAR_SIGN = 5.0  # m before that place over which the cost of lost time falls to 0
NEAR_PLACE = 0.2  # m likewise, of a stop: there SUMO takes a stand for one only at the very place


class Rules(NamedTuple):
    """What the local map of a cycle takes for granted."""

    cleared: frozenset[int]  # nodes at whose stop line the ego has stood
    stop_decel: float  # m/s2 of braking beyond which a yellow light is passed
    claim_s: float  # s for which the path ahead of an agent counts as occupied by it
    asked: int = 0  # the side on which the ego asks for room: 1 left, -1 right, 0 neither
    patience: float = 1.0  # LocalMap.patience
    reactive: int = 0  # agents at most that the search is to move
    sight: Sight = Sight()  # how far the lanes of oncoming traffic are seen


def closed_lines(
    route: RouteMap, view: slice, scene: Scene, forecast: Forecast, state: State, rules: Rules
) -> tuple[NDArray[np.uint8], Floats]:
    """LocalMap.closed [W, T] and LocalMap.yellow [W, 2]: red and yellow lights, and stop signs at
    which the ego has not stood yet."""
    first, here = view.start, route.station[state.node] + state.s
    times = forecast.pose.shape[1]
    closed = np.zeros((view.stop - first, times), np.uint8)
    yellow = np.full((view.stop - first, 2), np.inf)
    lines = first + np.flatnonzero(route.stop[view])
    for n in lines[route.signal[lines] < 0]:
        closed[n - first] = int(n) not in rules.cleared
    lights = lines[route.signal[lines] >= 0]
    grid = np.arange(times, dtype=np.float64) * forecast.dt
    states = signal_states(scene.signals, route.signal[lights], route.link[lights], grid)
    for n, shows in zip(lights, states, strict=True):
        until = scene.signals.until[route.signal[n]]
        phases = scene.signals.state[scene.signals.offset[route.signal[n]] + route.link[n]]
        yellow[n - first] = _next_yellow(phases, until)
        stood = int(n) in rules.cleared
        closed[n - first] = (shows != GREEN) & ~(stood & (shows == AFTER_STOP))
        distance = float(route.station[n] + route.length[n] - here)
        if shows[0] != GREEN and _goes_on(state.v, distance, phases, until, rules.stop_decel):
            reopened = np.flatnonzero(shows == GREEN)
            closed[n - first, : reopened[0] if len(reopened) else times] = 0
    return closed, yellow


def _goes_on(v: float, distance: float, phases: Ints, until: Floats, stop_decel: float) -> bool:
    """Whether the change to yellow (or an unannounced switch) caught the ego too near to stop:
    it goes on until the next green or the stop line.

    `phases` and `until` [K]: what the light shows, and s from now at which that ends.
    """
    in_time = phases[0] == YELLOW and distance < v * _lasts(phases, until, 0)
    decel = stop_decel if in_time else max(stop_decel, RED_DECEL)
    return v > 0.5 and 0.0 < distance < v * v / (2.0 * decel)


def _next_yellow(phases: Ints, until: Floats) -> tuple[float, float]:
    """When a green light turns yellow for the first time, and when that ends, s from now; inf:
    never, as far as known."""
    for k in range(1, len(phases)):
        if phases[k] == YELLOW and phases[k - 1] == GREEN:
            return float(until[k - 1]), _lasts(phases, until, k)
    return math.inf, math.inf


def _lasts(phases: Ints, until: Floats, k: int) -> float:
    """Until when the light shows what it shows in phase k, s from now."""
    while k + 1 < len(phases) and phases[k + 1] == phases[k]:
        k += 1
    return float(until[k])


def is_open(
    route: RouteMap, closed: NDArray[np.uint8], first: int, state: State, distance: float
) -> bool:
    """LocalMap.open_ahead: whether the ego's lane goes on for `distance` m, past lights that are
    open when the forecast ends."""
    node, left = state.node, distance + state.s
    while left > 0.0:
        left -= route.length[node]
        if left > 0.0 and node - first < len(closed) and closed[node - first, -1]:
            return False
        if route.next[node] < 0:
            return left <= 0.0 or bool(np.isinf(route.reach[node]))
        node = int(route.next[node])
    return True


def stop_at(route: RouteMap, state: State, rules: Rules, here: float) -> tuple[float, float, float]:
    """LocalMap.stop_at, stands_before and near_stop."""
    node, distance = stop_ahead(route, state.node, state.s)
    if node < 0 or not route.sign[node] or node in rules.cleared:
        return math.inf, BEFORE_SIGN, NEAR_SIGN
    if route.halt.ends and node == route.halt.node:
        return here + distance, LINE_BEYOND, NEAR_PLACE
    return here + distance, BEFORE_SIGN, NEAR_SIGN
