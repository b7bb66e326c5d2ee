"""What a signal shows over time, as arrays of states."""

import numpy as np

from sumo_mcts.arrays import Floats, Indices, Ints
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import GREEN, Signals


def signal_states(
    signals: Signals, signal: Ints | Indices, link: Ints | Indices, grid: Floats
) -> Ints:
    """[M, T] what M links of these signals show at these times from now; the last known phase
    stays."""
    over = signals.until[signal][:, None] <= grid[:, None]
    phase = np.minimum(over.sum(axis=2), signals.until.shape[1] - 1)
    return np.asarray(signals.state[(signals.offset[signal] + link)[:, None], phase])


def shown(signals: Signals, signal: int, link: int) -> int:
    """What a signal (-1: none) shows to a link now; GREEN without a signal."""
    return int(signals.state[signals.offset[signal] + link, 0]) if signal >= 0 else GREEN


def shows(signals: Signals, road: RoadMap, lane: int) -> int:
    """What the signal before an internal lane shows now."""
    return shown(signals, int(road.signal[lane]), int(road.link[lane]))
