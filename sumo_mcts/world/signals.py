"""Reads what SUMO's signals show, and what they will show."""

from collections.abc import Collection
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Ints
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import AFTER_STOP, GREEN, RED, YELLOW, Signals
from sumo_mcts.world.nearby import Nearby

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
        self._offset, self._near = _offset(road), _nearby(road, set(self._get.getIDList()))
        self._programs: dict[tuple[int, str], list[_Phase]] = {}
        # Lights change now and then: what was laid out for the same ones is there already.
        self._course = lru_cache(maxsize=4096)(self._course_of)
        self._state = lru_cache(maxsize=4)(self._state_of)
        self._green = lru_cache(maxsize=4)(self._green_of)
        self._never = np.full((len(self._ids), 1), np.inf)

    def read(self, x: float, y: float, time: float, phases: int) -> Signals:
        """The signals at a place (m) and time (s), with so many phases.

        Signals whose links' bounding box is further away than SIGNAL_RANGE read as green.
        """
        lights = self._lights(x, y)
        if phases == 1:
            return Signals(self._offset, self._state(lights, 1), self._never)
        lights = tuple(self._in_program(light) for light in lights)
        until = np.full((len(self._ids), phases), np.inf)
        if lights:  # all at once: there may be dozens, and each call of numpy costs time
            near = [light.signal for light in lights]
            lasting = np.stack([self._course(light, phases).lasting for light in lights])
            switch = [*map(self._get.getNextSwitch, map(self._ids.__getitem__, near))]
            lasting[:, 0] += np.array(switch) - time
            until[near] = np.cumsum(lasting, axis=1)
        return Signals(self._offset, self._state(lights, phases), until)

    def green(self, x: float, y: float) -> Bools:
        """[links] whether each shows green, for vehicles at a place (m).

        Not so where the signal is off or farther away than SIGNAL_RANGE.
        """
        return self._green(self._lights(x, y))

    def _lights(self, x: float, y: float) -> tuple["_Light", ...]:
        """What the signals within SIGNAL_RANGE of a place show."""
        near = self._near.of(x, y).tolist()
        letters = map(self._get.getRedYellowGreenState, map(self._ids.__getitem__, near))
        return tuple(map(_Light, near, letters))

    def _in_program(self, light: "_Light") -> "_Light":
        """The same with its place in the program that runs."""
        name = self._ids[light.signal]
        running, phase = self._get.getProgram(name), self._get.getPhase(name)
        if running != BY_PROGRAM:
            self._keep_program(light._replace(program=running, phase=phase))
        return light._replace(program=running, phase=phase)

    def _keep_program(self, light: "_Light") -> None:
        """Read the phases of a program that is not known; none where SUMO does not give them.

        They are read again where the present phase shows other letters: a program may be replaced
        by another one of its name.
        """
        key = light.signal, light.program
        known = self._programs.get(key, [])
        if 0 <= light.phase < len(known) and known[light.phase].state == light.letters:
            return
        logics = self._get.getAllProgramLogics(self._ids[light.signal])
        found = next((_phases(logic) for logic in logics if logic.programID == light.program), [])
        if found != known:
            self._programs[key] = found
            self._course.cache_clear()
            self._state.cache_clear()

    def _course_of(self, light: "_Light", phases: int) -> "_Course":
        """What a signal shows in so many phases, the present one first."""
        course = _Course(
            np.full((self._links(light.signal), phases), GREEN, np.int32), np.zeros(phases)
        )
        _show(light.letters, course.state[:, 0])
        program, index = self._programs.get((light.signal, light.program), []), light.phase
        for k in range(1, phases):
            if not 0 <= index < len(program) or program[index].open_ended:
                course.state[:, k], course.lasting[k - 1] = course.state[:, k - 1], np.inf
                continue
            index = program[index].following
            _show(program[index].state, course.state[:, k])
            course.lasting[k] = program[index].duration
        return course

    def _state_of(self, lights: tuple["_Light", ...], phases: int) -> Ints:
        """Signals.state."""
        state = np.full((int(self._offset[-1]), phases), GREEN, np.int32)
        for light in lights:
            first = int(self._offset[light.signal])
            state[first : first + self._links(light.signal)] = self._course(light, phases).state
        return state

    def _green_of(self, lights: tuple["_Light", ...]) -> Bools:
        lit = np.zeros(int(self._offset[-1]), np.bool_)
        for light in lights:
            links = lit[self._offset[light.signal] : self._offset[light.signal + 1]]
            letters = light.letters[: len(links)]
            links[: len(letters)] = [letter in _LIT_GREEN for letter in letters]
        return lit

    def _links(self, signal: int) -> int:
        return int(self._offset[signal + 1] - self._offset[signal])


class _Light(NamedTuple):
    """What a signal shows now."""

    signal: int  # index
    letters: str  # SUMO's, one for each link
    program: str = ""  # that runs
    phase: int = -1  # index of the phase in it; -1: not asked


class _Course(NamedTuple):
    """What the links of a signal will show, phase by phase."""

    state: Ints  # [links, phases]
    lasting: Floats  # [phases] s; of the first, which is under way, 0. inf: nobody knows


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


def _offset(road: RoadMap) -> Ints:
    """Signals.offset."""
    links = np.zeros(len(road.signal_ids), np.int64)
    at = np.flatnonzero(road.signal >= 0)
    np.maximum.at(links, road.signal[at], road.link[at] + 1)
    return np.concatenate([[0], np.cumsum(links)]).astype(np.int32)


def _nearby(road: RoadMap, known: Collection[str]) -> Nearby:
    """The signals by where their links begin; those that SUMO does not have are nowhere."""
    count = len(road.signal_ids)
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    at = np.flatnonzero(road.signal >= 0)
    begin = road.points[road.point_offset[at]]
    np.minimum.at(low, road.signal[at], begin)
    np.maximum.at(high, road.signal[at], begin)
    low[[name not in known for name in road.signal_ids]] = np.inf
    return Nearby(low, high, SIGNAL_RANGE)
