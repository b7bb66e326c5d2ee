"""Starts, steps and closes SUMO in this process: libsumo, headless or with its own window."""

import abc
import contextlib
import ctypes
import math
import os
import re
import tempfile
import time
import uuid
import weakref
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from itertools import count, pairwise
from pathlib import Path
from typing import Any

from sumo_mcts import files
from sumo_mcts.errors import ConfigError
from sumo_mcts.process.supervisor import doing
from sumo_mcts.world.library import import_libsumo, is_running, running_sumo
from sumo_mcts.world.options import (
    NO_WAITING,
    expanded,
    full_name,
    is_number,
    option_names,
    paths_in,
    unescaped,
)

# Wall time for each simulated second with a window, as SUMO's option `delay` means it: four times
# real time. And the most that a user may ask for.
WINDOW_DELAY_MS = 250.0
WINDOW_DELAY_MOST_MS = 60_000.0
WAKING_STEPS = 3  # before a window is closed

# Options that we give, unless the arguments do: always, and with a window.
_QUIET = {
    "verbose": "false",
    "no-step-log": "true",
    "duration-log.disable": "true",
    "no-warnings": "true",
}
_WINDOW = {"start": "true", "quit-on-end": "true", "window-size": "1200,800", **NO_WAITING}
_WITHOUT_DISPLAY = "leave --gui out, or start a virtual one: xvfb-run -a sumo-mcts run ... --gui"

TYPES_WITHIN = 1 << 24  # bytes of a file in which types of vehicles are looked for
_ACTION_STEP = re.compile(rb"""actionStepLength\s*=\s*["']([0-9]+\.?[0-9]*|\.[0-9]+)["']""")
_END_OF_ERROR = re.compile(r"\n(?=\S)|\nQuitting")  # further lines of an error are indented
# A parameter of a lane that bears the simulation's number: no output shows it, no state keeps it,
# and it goes with its simulation. Several processes may be connected to one SUMO.
_MARK = f"sumo_mcts.simulation.{uuid.uuid4()}"


class SimulationError(Exception):
    """SUMO failed while running; the text is SUMO's own where it left one."""


class Stepped(abc.ABC):
    """A running SUMO that is stepped here."""

    @abc.abstractmethod
    def step(self) -> None:
        """One step. Raises SimulationError."""

    @abc.abstractmethod
    def close(self) -> None:
        """Leave the simulation."""

    @property
    def time(self) -> float:
        """Simulation time, s."""
        return now()

    @property
    def finished(self) -> bool:
        """Whether SUMO expects no further vehicles."""
        return expected() == 0

    @property
    def end(self) -> float:
        """When the configuration says that the traffic ends, s; inf: it does not say.

        SUMO itself does not stop there while a program steps it.
        """
        end = float(running_sumo().simulation.getEndTime())
        return end if end > 0 else math.inf

    def departed(self) -> list[str]:
        """The vehicles that departed in the last step."""
        return departed()


class Simulation(Stepped):
    """One running SUMO in this process. libsumo holds a single simulation per process: close one
    before starting the next."""

    def __init__(
        self, arguments: Sequence[str], *, gui: bool = False, delay_ms: float = WINDOW_DELAY_MS
    ) -> None:
        """`arguments` as on SUMO's command line, without the program's name.

        `delay_ms`: with a window, how long a simulated second takes at least, unless the arguments
        say so. Raises ConfigError with SUMO's own message.
        """
        self._libsumo, self._gui = import_libsumo(), gui
        self._log = _temporary_file()
        # With a delay of its own SUMO's window never closes (seen with 10 ms and more, SUMO 1.28).
        # So `step` waits instead.
        arguments, delay_ms = (
            delay_taken_out(arguments, delay_ms) if gui else (list(arguments), 0.0)
        )
        self._pace = _Pace(delay_ms / 1000.0)
        given = option_names(arguments)
        own = {"error-log": str(self._log), **_QUIET, **({**_WINDOW, "delay": "0"} if gui else {})}
        further = [
            part
            for name, value in own.items()
            if name not in given
            for part in (f"--{name}", value)
        ]
        source = _source(arguments)
        doing(f"SUMO, reading {source},")
        try:
            with _display_open() if gui else contextlib.nullcontext(), _muted(self._log):
                self._start(["sumo-gui" if gui else "sumo", *arguments, *further])
        except ConfigError:
            self._log.unlink(missing_ok=True)
            raise
        doing(f"the simulation of {source}")

    def _start(self, command: list[str]) -> None:
        try:
            self._libsumo.start(command)
        except Exception as error:  # libsumo's two exception types share no base of their own
            self._libsumo.close()  # writes its log to the end
            raise ConfigError(f"SUMO does not start: {self._reason(error)}") from None

    def step(self) -> None:
        """One step. Raises SimulationError with SUMO's own message."""
        self._pace.wait(self.time)
        try:
            self._libsumo.simulationStep()
        except Exception as error:  # libsumo.FatalTraCIError does not derive from TraCIException
            raise SimulationError(self._reason(error)) from None

    def close(self) -> None:
        """End the simulation; its output files are complete afterwards."""
        with _muted():
            if self._gui:
                self._wake_window()
            self._libsumo.close()
        self._log.unlink(missing_ok=True)
        doing("")

    def _wake_window(self) -> None:
        """Step right before closing: SUMO waits for the window's thread, which otherwise sleeps for
        ever (SUMO 1.28)."""
        with contextlib.suppress(Exception):  # libsumo's exceptions share no base
            for _ in range(WAKING_STEPS):
                self._libsumo.simulationStep()

    def _reason(self, error: Exception) -> str:
        """Why SUMO failed, in one line: the exception often says no more than `Process Error`."""
        try:
            text = self._log.read_text(encoding="utf-8", errors="replace")
        except OSError:  # not there, or this is a copy of the process, which opens no files
            text = ""
        first = (
            text[text.find("Error: ") :].removeprefix("Error: ")
            if "Error: " in text
            else str(error)
        )
        return " ".join(_END_OF_ERROR.split(first)[0].split())


class _Pace:
    """Keeps a simulation from running faster than a person can watch."""

    def __init__(self, per_second: float) -> None:
        """`per_second`: wall time for each simulated second, s; 0: as fast as it goes."""
        self._per_second = per_second
        self._simulated = self._wall = math.nan  # at the step before, s

    def wait(self, simulated: float) -> None:
        """Wait until the step that begins at this simulation time (s) is due."""
        if self._per_second <= 0.0:
            return
        if not math.isnan(self._wall):
            due = self._wall + (simulated - self._simulated) * self._per_second
            time.sleep(max(0.0, due - time.monotonic()))
        self._simulated, self._wall = simulated, time.monotonic()


def delay_taken_out(arguments: Sequence[str], default_ms: float) -> tuple[list[str], float]:
    """SUMO's arguments without its option `delay`, and the delay in ms for each simulated second.

    Raises ConfigError.
    """
    left, given = [], str(default_ms)
    words = iter(arguments)
    for word in words:
        name, assigned, value = word.lstrip("-").partition("=")
        if word.startswith("-") and not is_number(word) and full_name(name) == "delay":
            given = value if assigned else next(words, "")
        else:
            left.append(word)
    if not is_number(given) or not 0.0 <= float(given) <= WINDOW_DELAY_MOST_MS:
        raise ConfigError(
            f"delay: milliseconds for each simulated second, from 0 to {WINDOW_DELAY_MOST_MS:g}, "
            f"got {given!r}"
        )
    return left, float(given)


def _source(arguments: Sequence[str]) -> str:
    """The file that SUMO's arguments name first: the configuration, or the network."""
    named = dict(pairwise(arguments))
    return named.get("--configuration-file") or named.get("--net-file") or "its files"


def _temporary_file() -> Path:
    number, name = tempfile.mkstemp(prefix="sumo_mcts-", suffix=".log")
    os.close(number)
    return Path(name)


@contextlib.contextmanager
def _display_open() -> Iterator[None]:
    """Look for a display first: sumo-gui ends the whole process where it finds none.

    Ours stays open until SUMO's window is: a virtual display starts again when its last client
    leaves, and refuses clients that come meanwhile. Raises ConfigError.
    """
    if os.name == "posix" and "DISPLAY" not in os.environ:
        raise ConfigError(f"--gui: no display (DISPLAY is not set); {_WITHOUT_DISPLAY}")
    try:
        x11 = ctypes.CDLL("libX11.so.6")
    except OSError:
        yield  # without the library we cannot look
        return
    x11.XOpenDisplay.restype = ctypes.c_void_p
    x11.XCloseDisplay.argtypes = [ctypes.c_void_p]
    display = x11.XOpenDisplay(None)
    if not display:
        raise ConfigError(
            f"--gui: the display {os.environ['DISPLAY']} cannot be opened; {_WITHOUT_DISPLAY}"
        )
    try:
        yield
    finally:
        x11.XCloseDisplay(display)


@contextlib.contextmanager
def _muted(into: Path = Path(os.devnull)) -> Iterator[None]:
    """Sends what SUMO prints on standard output and error into a file."""
    kept = [os.dup(1), os.dup(2)]
    file = os.open(into, os.O_WRONLY | os.O_APPEND)
    try:
        os.dup2(file, 1)
        os.dup2(file, 2)
        yield
    finally:
        for number, before in zip((1, 2), kept, strict=True):
            os.dup2(before, number)
            os.close(before)
        os.close(file)


# --- the running simulation, ours or the user's ---


def require_running() -> None:
    """Raise ConfigError where no simulation runs."""
    if is_running():
        return
    if running_sumo() is not import_libsumo():
        raise ConfigError("connection: it is closed, or SUMO has ended")
    raise ConfigError(
        "no simulation runs in this process: call libsumo.start first, or give the connection to "
        "one that runs by itself, as in Controller(ego, connection=traci.getConnection())"
    )


def moves_who_comes_near() -> bool:
    """Whether SUMO teleports or removes a vehicle that is nearer to another than its minGap."""
    moves = option("collision.action") in ("teleport", "remove")
    return moves and float(option("collision.mingap-factor")) != 0.0


def number() -> int:
    """A number that the running simulation alone has, until it is closed or another one is loaded;
    0: none runs."""
    if not is_running():
        return 0
    sumo = running_sumo()
    seen, lanes = _seen.setdefault(getattr(sumo, "connection", sumo), _Marked()), sumo.lane
    with contextlib.suppress(Exception):  # another network may have no such lane
        if lanes.getParameter(seen.lane, _MARK) == str(seen.number):
            return seen.number
    seen.lane, seen.number = str(lanes.getIDList()[0]), next(_numbers)
    lanes.setParameter(seen.lane, _MARK, str(seen.number))
    return seen.number


class _Marked:
    """The lane that bears the number of the simulation seen last."""

    lane, number = "", 0


# by libsumo, or the connection
_seen: weakref.WeakKeyDictionary[Any, _Marked] = weakref.WeakKeyDictionary()
_numbers = count(1)


def now() -> float:
    """Time of the running simulation, s."""
    return float(running_sumo().simulation.getTime())


def expected() -> int:
    """The number of vehicles and persons in the running simulation, and of those still to come."""
    return int(running_sumo().simulation.getMinExpectedNumber())


def departed() -> list[str]:
    """The vehicles that departed in the last step of the running simulation."""
    return [str(vehicle) for vehicle in running_sumo().simulation.getDepartedIDList()]


def after_each_step(call: Callable[[], bool]) -> None:
    """Call this after each simulationStep() of the user's, for as long as it returns True and the
    simulation is not closed."""
    sumo: Any = running_sumo()

    class Listener(sumo.StepListener):  # type: ignore[misc]  # libsumo has no types
        """What libsumo asks for."""

        def step(self, _time: float = 0.0) -> bool:
            """Whether to be called again."""
            return call()

    sumo.addStepListener(Listener())


def option(name: str) -> str:
    """The value of an option of the running simulation."""
    return str(running_sumo().simulation.getOption(name))


def named_files(name: str) -> list[Path]:
    """The files that an option of the running simulation names, as the option was given."""
    return paths_in(unescaped(expanded(option(name))), Path())


def step_length() -> float:
    """Step of the running simulation, s."""
    return float(running_sumo().simulation.getDeltaT())


def is_ballistic() -> bool:
    """Whether positions follow the mean speed of a step.

    That is asked for, or SUMO changes to it silently where a type of vehicle acts less often than
    every step. (An option that asks for the opposite cannot be seen.) The types are read from the
    files: asking SUMO for a type draws from its random numbers where that is a distribution, and so
    changes the traffic.
    """
    named = [
        path
        for key in ("route-files", "additional-files")
        for path in named_files(key)
        if not files.problem(path)
    ]
    longest = max(
        [
            float(option("default.action-step-length")),
            *(_longest_action_step(path, path.stat().st_mtime_ns) for path in named),
        ]
    )
    return option("step-method.ballistic") == "true" or longest > step_length() + 1e-9


@lru_cache(maxsize=32)
def _longest_action_step(path: Path, changed: int) -> float:
    """The longest actionStepLength in a file of routes or types, s.

    Of large files only the beginning counts, where types stand. `changed`: when the file was, for
    the cache.
    """
    try:
        text = files.beginning(path, TYPES_WITHIN)
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from None
    return max((float(found) for found in _ACTION_STEP.findall(text)), default=0.0)
