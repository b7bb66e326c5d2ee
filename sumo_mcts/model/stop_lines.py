"""When the stop lines ahead may not be crossed: red and yellow lights, and stop signs."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.model.local_map import State
from sumo_mcts.model.route import RouteMap
from sumo_mcts.numerics.signals import signal_states
from sumo_mcts.scene import GREEN, YELLOW, Forecast, Scene

# m/s2 of braking beyond which the ego does not stop for red: yellow was short, or it departs right
# before a red light
RED_DECEL = 6.0


class Rules(NamedTuple):
    """What the local map of a cycle takes for granted."""

    cleared: frozenset[int]  # nodes at whose stop sign the ego has stood
    stop_decel: float  # m/s2 of braking beyond which a yellow light is passed
    claim_s: float  # s for which the path ahead of an agent counts as occupied by it
    asked: int = 0  # the side on which the ego asks for room: 1 left, -1 right, 0 neither
    patience: float = 1.0  # LocalMap.patience
    reactive: int = 0  # agents at most that the search is to move


def closed_lines(
    route: RouteMap, view: slice, scene: Scene, forecast: Forecast, state: State, rules: Rules
) -> NDArray[np.uint8]:
    """[W, T] red and yellow lights, and stop signs at which the ego has not stood yet."""
    first, here = view.start, route.station[state.node] + state.s
    times = forecast.pose.shape[1]
    closed = np.zeros((view.stop - first, times), np.uint8)
    lines = first + np.flatnonzero(route.stop[view])
    for n in lines[route.signal[lines] < 0]:
        closed[n - first] = int(n) not in rules.cleared
    lights = lines[route.signal[lines] >= 0]
    grid = np.arange(times, dtype=np.float64) * forecast.dt
    states = signal_states(scene.signals, route.signal[lights], route.link[lights], grid)
    for n, shows in zip(lights, states, strict=True):
        closed[n - first] = shows != GREEN
        distance = route.station[n] + route.length[n] - here
        # An ego that the change to yellow (or an unannounced switch) catches too close to stop goes
        # on: until the next green or the stop line.
        decel = rules.stop_decel if shows[0] == YELLOW else max(rules.stop_decel, RED_DECEL)
        if shows[0] != GREEN and state.v > 0.5 and 0.0 < distance < state.v**2 / (2.0 * decel):
            reopened = np.flatnonzero(shows == GREEN)
            closed[n - first, : reopened[0] if len(reopened) else times] = 0
    return closed
