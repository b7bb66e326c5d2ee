"""Reads what SUMO's signals show, and what they will show."""

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Ints
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import AFTER_STOP, GREEN, RED, YELLOW, Signals

PHASES = 8  # coming phases that are broadcast
# SUMO's name of what is shown after a program set the lights: until it sets them again
BY_PROGRAM = "online"
STATIC = 0  # SUMO's type of signals whose phases last as long as their program says
MOMENT = 0.001  # s: how long a phase of a level crossing is said to last that trains end
SIGNAL_RANGE = 500.0  # m within which signals are read
# SUMO's letters; any other one counts as green.
_SHOWS = {
    **dict.fromkeys("GgoO", GREEN),
    **dict.fromkeys("yY", YELLOW),
    **dict.fromkeys("ru", RED),
    "s": AFTER_STOP,
}
_LIT_GREEN = "Gg"


class SignalReader:
    """The state of the signals near a place, and their coming phases."""

    def __init__(self, libsumo: Any, road: RoadMap) -> None:
        self._get = libsumo.trafficlight
        self._ids = road.signal_ids
        known = set(self._get.getIDList())
        links = [
            int(road.link[road.signal == q].max(initial=-1)) + 1
            for q in range(len(road.signal_ids))
        ]
        self._offset = np.concatenate([[0], np.cumsum(links)]).astype(np.int32)
        starts = [
            road.points[road.point_offset[np.flatnonzero(road.signal == q)]]
            for q in range(len(road.signal_ids))
        ]  # the first points of its links
        low = [points.min(axis=0, initial=math.inf) for points in starts]
        high = [points.max(axis=0, initial=-math.inf) for points in starts]
        self._low, self._high = np.array(low).reshape(-1, 2), np.array(high).reshape(-1, 2)
        self._known = np.array([name in known for name in road.signal_ids], np.bool_)
        self._programs: dict[tuple[int, str], list[_Phase]] = {}

    def read(self, x: float, y: float, time: float, phases: int) -> Signals:
        """The signals at a place (m) and time (s), with so many phases.

        Signals whose links' bounding box is further away than SIGNAL_RANGE read as green.
        """
        state = np.full((int(self._offset[-1]), phases), GREEN, np.int32)
        until = np.full((len(self._ids), phases), np.inf)
        for q in self._near(x, y):
            links = slice(self._offset[q], self._offset[q + 1])
            self._fill(q, self._ids[q], time, state[links], until[q])
        return Signals(self._offset, state, until)

    def green(self, x: float, y: float) -> Bools:
        """[links] whether each shows green, for vehicles at a place (m).

        Not so where the signal is off or farther away than SIGNAL_RANGE.
        """
        lit = np.zeros(int(self._offset[-1]), np.bool_)
        for q in self._near(x, y):
            links = lit[self._offset[q] : self._offset[q + 1]]
            letters = self._get.getRedYellowGreenState(self._ids[q])[: len(links)]
            links[: len(letters)] = [letter in _LIT_GREEN for letter in letters]
        return lit

    def _near(self, x: float, y: float) -> list[int]:
        """The signals within SIGNAL_RANGE of a place."""
        away = np.maximum(np.maximum(self._low - (x, y), (x, y) - self._high), 0.0)
        near: list[int] = np.flatnonzero(
            self._known & ((away * away).sum(axis=1) < SIGNAL_RANGE**2)
        ).tolist()
        return near

    def _fill(self, q: int, name: str, time: float, state: Ints, until: Floats) -> None:
        """The rows of one signal: `state` [links, K] and `until` [K], as in Signals."""
        letters = self._get.getRedYellowGreenState(name)
        _show(letters, state[:, 0])
        if len(until) == 1:
            return
        current = self._get.getProgram(name)
        if current == BY_PROGRAM:
            state[:, 1:] = state[:, :1]
            return
        until[0] = self._get.getNextSwitch(name) - time
        index = self._get.getPhase(name)
        program = self._program((q, current), index, letters)
        for k in range(1, len(until)):
            if not 0 <= index < len(program) or program[index].open_ended:
                state[:, k], until[k - 1] = state[:, k - 1], np.inf
                continue
            index = program[index].following
            _show(program[index].state, state[:, k])
            until[k] = until[k - 1] + program[index].duration

    def _program(self, key: tuple[int, str], index: int, letters: str) -> list["_Phase"]:
        """The phases of a signal's running program, given by their numbers and name; empty where
        SUMO does not give them.

        They are read again where the present phase (index) shows other letters: a program may be
        replaced by another one of its name.
        """
        known = self._programs.get(key, [])
        if not 0 <= index < len(known) or known[index].state != letters:
            logics = self._get.getAllProgramLogics(self._ids[key[0]])
            known = next((_phases(logic) for logic in logics if logic.programID == key[1]), [])
            self._programs[key] = known
        return known


class _Phase(NamedTuple):
    """A phase of a signal's program."""

    state: str
    duration: float  # s
    following: int  # index of the phase after it
    # traffic, or a train, decides when it ends: SUMO's next switch is when it asks next
    open_ended: bool


def _phases(logic: Any) -> list[_Phase]:
    found = list(logic.phases)
    return [
        _Phase(
            state=p.state,
            duration=p.duration,
            following=p.next[0] if p.next and p.next[0] >= 0 else (k + 1) % len(found),
            open_ended=logic.type != STATIC and (p.minDur < p.maxDur or p.duration <= MOMENT),
        )
        for k, p in enumerate(found)
    ]


def _show(letters: str, column: Ints) -> None:
    """What each link shows, into a column of Signals.state."""
    shown = _shown(letters)[: len(column)]
    column[: len(shown)] = shown


@lru_cache(maxsize=4096)
def _shown(letters: str) -> Ints:
    return np.array([_SHOWS.get(letter, GREEN) for letter in letters], np.int32)
