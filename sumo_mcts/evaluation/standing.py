"""How long one ego stood at a stretch, and how long at a green light.

Definitions: docs/measures.md, `longest_stop_s` and `stopped_at_green_s`.
"""

import numpy as np

from sumo_mcts.arrays import Bools
from sumo_mcts.numerics.lanes import connection, successors
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import STANDING, Frame

AT_LINE = 50.0  # m before a stop line from which on a standing ego stands at its light


def longest_run(happened: Bools) -> int:
    """How often in a row something happened [T], at most."""
    turns = np.flatnonzero(np.diff(np.concatenate([[False], happened, [False]])))
    return int((turns[1::2] - turns[::2]).max(initial=0))


class GreenRecord:
    """The steps in which one ego stood at green."""

    def __init__(self, road: RoadMap) -> None:
        self._road = road
        self._stood = False  # in the last state
        self.steps = 0

    def note_state(self, frame: Frame) -> None:
        """The next state, from the take-over on."""
        stands = stands_at_green(self._road, frame)
        self.steps += stands and self._stood
        self._stood = stands


def stands_at_green(road: RoadMap, frame: Frame) -> bool:
    """Whether the ego stands first before a stop line whose light is green."""
    ego, agents = frame.ego, frame.agents
    if ego.v >= STANDING or ego.lane < 0 or float(road.length[ego.lane]) - ego.s > AT_LINE:
        return False
    ways = [lane for lane in successors(road, ego.lane) if road.signal[lane] >= 0]
    onto = ego.route[1] if len(ego.route) > 1 else -1
    # in a lane that does not lead along its route, it keeps all who come behind from going on
    own = [lane for lane in ways if road.edge[road.exit[lane]] == onto] or ways
    links = [int(frame.signals.offset[road.signal[lane]] + road.link[lane]) for lane in own]
    if not links or not frame.green[links].all():
        return False
    ahead = (agents.lane == ego.lane) & (agents.s > ego.s)
    crossing = np.isin(agents.lane, [lane for way in ways for lane in connection(road, way)[:-1]])
    return not (ahead | crossing).any()
