"""People at crossings with signals: they wait at the kerb while it shows red, and go at green."""

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Ints
from sumo_mcts.numerics.signals import signal_states
from sumo_mcts.prediction.on_foot import (
    NO_LIGHT,
    Crossings,
    Ways,
    approach,
    crossings_on,
    ways_on_foot,
)
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import GREEN, STANDING, Agents, Scene, Signals

SETS_OFF = 1.4  # m/s with which who has stood at red sets off: as fast as SUMO's people walk
KEEPS_STILL_S = 4.0  # who stands at a light that stays red for so long keeps still
STILL = 0.1  # m: the margin around who does


def ways_at(
    road: RoadMap, lanes: Ints, scene: Scene, agents: Agents, times: int, step: float
) -> Ways:
    """The ways of `agents` [N] at so many `times`, `step` s apart, now first, where the ego of the
    scene drives `lanes` [K]."""
    lanes = lanes if agents.person.any() else lanes[:0]
    crossings = crossings_on(road, lanes)
    grid = np.arange(times, dtype=np.float64) * step
    green = green_at(road, crossings, scene.signals, grid)
    return ways_on_foot(agents, crossings, approach(road, lanes, scene.ego, crossings), green, step)


def green_at(road: RoadMap, crossings: Crossings, signals: Signals, grid: Floats) -> Bools:
    """[C, T] whether people may enter the crossings at the times `grid` [T] from now, s: where no
    signal shows red or yellow."""
    green = np.ones((len(crossings.over), len(grid)), np.bool_)
    lit = np.flatnonzero(road.signal[crossings.over] >= 0)
    if len(lit):
        over = crossings.over[lit]
        green[lit] = signal_states(signals, road.signal[over], road.link[over], grid) == GREEN
    return green


def with_waiting(
    ways: Ways, x: Floats, v: Floats, step: float, but: int
) -> tuple[Ways, Floats, Floats]:
    """The ways, positions x [T, N+1] m and speeds v [T, N+1], m/s, whose row 0 is the ego, with the
    time that people wait for a signal in them; not so of agent `but`, which stops for another
    reason."""
    those = np.flatnonzero(ways.goes != NO_LIGHT)
    those = those[those != but]
    if not len(those):
        return ways, x, v
    x, v, stop = x.copy(), v.copy(), ways.stop.copy()
    time, row = (np.arange(len(x)) * step)[:, None], those + 1
    pace = v[0, row]
    away = np.where(pace > STANDING, pace, SETS_OFF)
    goes, to_kerb = ways.goes[those], np.minimum(pace * time, stop[those])
    x[:, row] = x[0, row] + to_kerb + away * np.maximum(time - goes, 0.0)
    v[:, row] = np.where(time >= goes, away, np.where(pace * time < stop[those], pace, 0.0))
    stop[those] = np.inf
    return ways._replace(stop=stop), x, v


def margins_on_foot(road: RoadMap, lanes: Ints, scene: Scene, usual: float) -> float | Floats:
    """The margin around people, m, of all or [N]: `usual`, and less of who stands at red."""
    agents = scene.agents
    if usual <= STILL or not (agents.person & (agents.v < STANDING)).any():
        return usual
    ways = ways_at(road, lanes, scene, agents, 2, KEEPS_STILL_S)
    still = (ways.stop == 0.0) & (ways.goes > KEEPS_STILL_S) & (agents.v < STANDING)
    return np.where(still, STILL, usual)
