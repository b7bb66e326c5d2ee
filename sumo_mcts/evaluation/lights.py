"""The lights that an ego passes: which red and yellow ones it ran, and which agents run red ones.

Definitions: docs/measures.md, `red_lights_run` and `yellow_run`.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.arrays import Ints
from sumo_mcts.evaluation.reachability import spread
from sumo_mcts.numerics.lanes import successors
from sumo_mcts.numerics.signals import shows
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import AFTER_STOP, GREEN, RED, STANDING, Agents, Frame, Signals

# m/s2: an ego that needed more to stop could not be asked to
STOPPABLE_RED, STOPPABLE_YELLOW = 4.5, 3.0
# m before the line within which a vehicle has to have stood where red may be passed after a stop
STOOD_WITHIN = 10.0


class LightRecord:
    """What one ego and the agents around it did at traffic lights."""

    def __init__(self, road: RoadMap) -> None:
        self._road = road
        self.red = self.yellow = 0  # lights that the ego ran
        self.red_junction = -1  # on which the ego is, entered against red
        self.red_runners: dict[str, int] = {}  # agent -> junction that it entered against red
        # per signalled link: index of the state in which it last showed green
        self._last_green: NDArray[np.int64] = np.zeros(0, np.int64)

    def note_state(self, signals: Signals, index: int) -> None:
        """The lights in the ego's state `index`, counted from the take-over."""
        if len(self._last_green) != len(signals.state):
            self._last_green = np.full(len(signals.state), -1, np.int64)
        if len(self._last_green):
            self._last_green[signals.state[:, 0] == GREEN] = index

    def leave_junction(self, lanes: Iterable[int]) -> None:
        """Forget the junction entered against red, if none of the lanes under the ego is on it: an
        ego that comes back enters again."""
        if self.red_junction not in {int(self._road.junction[lane]) for lane in lanes}:
            self.red_junction = -1

    def cross_stop_line(
        self,
        before: Frame,
        frame: Frame,
        lane: int,
        line: float,
        speeds: Sequence[float],
        odometer: Sequence[float],
    ) -> None:
        """The front went over the stop line before internal lane `lane` in the step from `before`
        to `frame`.

        line: its distance from the take-over, m. speeds, odometer: m/s and m in every state from
        the take-over to `before`.
        """
        road = self._road
        earlier, later = shows(before.signals, road, lane), shows(frame.signals, road, lane)
        if GREEN in (earlier, later):
            return
        link = int(frame.signals.offset[road.signal[lane]] + road.link[lane])
        # the end of green, or take-over where it was not green since
        then = max(0, int(self._last_green[link]))
        needed = needed_decel(speeds[then], line - odometer[then])
        # an ego that stood in between has shown that stopping was possible
        stood = [k for k in range(then + 1, len(speeds)) if speeds[k] < STANDING]
        if stood and AFTER_STOP in (earlier, later) and line - odometer[stood[-1]] < STOOD_WITHIN:
            return
        needed = 0.0 if stood else needed
        if earlier >= RED and later >= RED:
            self.red_junction = int(road.junction[lane])
            self.red += needed <= STOPPABLE_RED
        else:
            self.yellow += needed <= STOPPABLE_YELLOW

    def note_red_runners(self, before: Frame, frame: Frame, known: Ints) -> None:
        """Note the agents that drive through red: the ego does not have to yield to them.

        known [N]: index of each agent in the frame before, -1 new.
        """
        road, lanes = self._road, frame.agents.lane
        self.red_runners = {
            name: junction
            for name, junction in self.red_runners.items()
            if _is_on(road, frame.agents, name, junction)
        }
        if not len(self._last_green) or not len(lanes):
            return
        for i in np.flatnonzero((known >= 0) & (lanes >= 0)):
            was = int(before.agents.lane[known[i]])
            lane = _lit(road, was, int(lanes[i])) if was != lanes[i] else -1
            if (
                lane >= 0
                and shows(before.signals, road, lane) == RED
                and shows(frame.signals, road, lane) == RED
            ):
                self.red_runners[frame.agents.ids[i]] = int(road.junction[lane])


def _lit(road: RoadMap, was: int, lane: int) -> int:
    """The lane behind a light over whose line a vehicle drove that came onto `lane`: this one, or
    the one on which it jumped over the junction; -1: none."""
    if road.signal[lane] >= 0:
        return lane
    over = [i for i in (successors(road, was) if was >= 0 else ()) if road.signal[i] >= 0]
    return next((i for i in over if lane in successors(road, i)), -1)


def needed_decel(v: float, distance: float) -> float:
    """Deceleration, m/s2, that stops from v, m/s, within distance, m."""
    return v * v / (2.0 * max(distance, 1e-3))


def _is_on(road: RoadMap, agents: Agents, name: str, junction: int) -> bool:
    """Whether a part of an agent is on a junction."""
    i = agents.ids.index(name) if name in agents.ids else -1
    if i < 0 or agents.lane[i] < 0:
        return False
    under = spread(road, int(agents.lane[i]), float(agents.s[i]), float(agents.length[i]), 0.0)
    return any(road.junction[lane] == junction for lane in under)
