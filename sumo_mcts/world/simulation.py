"""Starts, steps and closes SUMO in this process: libsumo, headless or with its own window."""

import ctypes
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from sumo_mcts.config import ConfigError

# What each shared library that libsumo asks for is called in Debian and Ubuntu.
_PACKAGES = {"libGL.so": "libgl1", "libX11.so": "libx11-6", "libXext.so": "libxext6", "libXrender.so": "libxrender1", "libatomic.so": "libatomic1"}

REFEREE_OPTIONS = {"collision.action": "warn", "collision.check-junctions": "true", "collision.mingap-factor": "0"}


class SimulationError(Exception):
    """SUMO failed while running; the text is SUMO's own where it left one."""


def import_libsumo() -> Any:
    """The libsumo module. Raises ConfigError that says which package to install where a system library is missing."""
    try:
        import libsumo  # type: ignore[import-untyped]
    except ImportError as error:
        package = next((name for library, name in _PACKAGES.items() if library in str(error)), None)
        hint = f"; install it with: apt-get install {package}" if package else ""
        raise ConfigError(f"libsumo cannot be loaded: {error}{hint}") from None
    return libsumo


class Simulation:
    """One running SUMO. libsumo holds a single simulation per process: close one before starting the next."""

    def __init__(self, arguments: Sequence[str], *, gui: bool = False) -> None:
        """`arguments` as on SUMO's command line, without the program's name. Raises ConfigError with SUMO's own message."""
        self._libsumo = import_libsumo()
        if gui:
            _check_display()
        self._log = Path(tempfile.mkstemp(prefix="sumo_mcts-", suffix=".log")[1])
        program = ["sumo-gui", "--start", "--quit-on-end"] if gui else ["sumo"]
        quiet = ["--no-step-log", "--duration-log.disable", "--no-warnings", "--error-log", str(self._log)]
        try:
            with _muted():
                self._libsumo.start([*program, *arguments, *quiet])
        except Exception as error:  # libsumo's two exception types share no base of their own
            text = self._take_log() or str(error)
            self._libsumo.close()
            self._log.unlink(missing_ok=True)
            raise ConfigError(f"SUMO does not start: {text}") from None
        self.gui = gui

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def step(self) -> None:
        """One step. Raises SimulationError with SUMO's own message."""
        try:
            self._libsumo.simulationStep()
        except Exception as error:  # libsumo.FatalTraCIError does not derive from TraCIException
            raise SimulationError(self._take_log() or str(error)) from None

    @property
    def time(self) -> float:
        """Simulation time, s."""
        return float(self._libsumo.simulation.getTime())

    @property
    def finished(self) -> bool:
        """Whether SUMO expects no further vehicles."""
        return int(self._libsumo.simulation.getMinExpectedNumber()) == 0

    def close(self) -> None:
        """End the simulation; its output files are complete afterwards."""
        with _muted():
            self._libsumo.close()
        self._log.unlink(missing_ok=True)

    def _take_log(self) -> str:
        """The first error that SUMO wrote, in one line."""
        lines = self._log.read_text(encoding="utf-8", errors="replace").splitlines() if self._log.is_file() else []
        errors = [line.removeprefix("Error: ").strip() for line in lines if line.strip() and not line.startswith("Quitting")]
        return errors[0] if errors else ""


def option(name: str) -> str:
    """The value of an option of the running simulation."""
    return str(import_libsumo().simulation.getOption(name))


def step_length() -> float:
    """Step of the running simulation, s."""
    return float(import_libsumo().simulation.getDeltaT())


def ssm_options(egos: Sequence[str], folder: Path) -> list[str]:
    """Options that equip the egos with SUMO's surrogate safety device, as the referee reads it."""
    return [
        "--device.ssm.explicit", ",".join(egos), "--device.ssm.measures", "TTC DRAC PET", "--device.ssm.thresholds", "3.0 3.0 2.0",
        "--device.ssm.range", "60", "--device.ssm.extratime", "5", "--device.ssm.file", str(folder / "ssm.xml"),
    ]  # fmt: skip


def _check_display() -> None:
    """sumo-gui ends the whole process where there is no display: look first."""
    if os.name != "posix" or "DISPLAY" not in os.environ:
        if os.name == "posix":
            raise ConfigError("--gui: no display (DISPLAY is not set); leave --gui out, or start a virtual one: xvfb-run -a sumo-mcts run ... --gui")
        return
    try:
        x11 = ctypes.CDLL("libX11.so.6")
    except OSError:
        return  # without the library we cannot look
    x11.XOpenDisplay.restype = ctypes.c_void_p
    x11.XCloseDisplay.argtypes = [ctypes.c_void_p]
    display = x11.XOpenDisplay(None)
    if not display:
        raise ConfigError(f"--gui: the display {os.environ['DISPLAY']} cannot be opened; leave --gui out, or start a virtual one: xvfb-run -a sumo-mcts run ... --gui")
    x11.XCloseDisplay(display)


class _muted:  # noqa: N801  # a context manager that reads as a word
    """Keeps SUMO's own chatter off standard output and error; its errors are read from the error log."""

    def __enter__(self) -> None:
        self._null = os.open(os.devnull, os.O_WRONLY)
        self._kept = [os.dup(1), os.dup(2)]
        os.dup2(self._null, 1)
        os.dup2(self._null, 2)

    def __exit__(self, *_: object) -> None:
        for number, kept in zip((1, 2), self._kept, strict=True):
            os.dup2(kept, number)
            os.close(kept)
        os.close(self._null)
