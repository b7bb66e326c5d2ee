"""SUMO's options as users give them: on a command line, in a scenario, in a .sumocfg.

What they are called in full, which ones no episode can run with, and the bounds of others.
"""

import os
import re
from collections.abc import Iterable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote

from sumo_mcts import files
from sumo_mcts.errors import ConfigError
from sumo_mcts.world import flows

# Short and old names -> the name in full.
_SYNONYMS = {
    "a": "additional-files", "additional": "additional-files", "abs-rand": "random", "b": "begin",
    "B": "breakpoints", "c": "configuration-file",
    "C": "save-configuration", "configuration": "configuration-file", "d": "delay", "D": "demo",
    "data-files": "edgedata-files", "e": "end",
    "g": "gui-settings-file", "G": "game", "H": "human-readable-time", "l": "log",
    "log-file": "log", "m": "edgedata-files", "n": "net-file",
    "N": "alternative-net-file", "ndump": "netstate-dump", "net": "net-file",
    "netstate": "netstate-dump", "netstate-output": "netstate-dump",
    "person-fcd": "person-fcd-output", "personinfo": "personinfo-output",
    "personroutes": "personroute-output", "Q": "quit-on-end", "r": "route-files",
    "routes": "route-files", "routing-threads": "device.rerouting.threads", "s": "route-steps",
    "S": "start", "save-config": "save-configuration",
    "save-config.relative": "save-configuration.relative",
    "save-template.commented": "save-commented", "srand": "seed",
    "statistics-output": "statistic-output", "summary": "summary-output",
    "suppress-warnings": "no-warnings", "t": "duration-log.statistics",
    "T": "disable-textures", "tripinfo": "tripinfo-output", "v": "verbose", "V": "version",
    "vehroutes": "vehroute-output", "w": "weight-files",
    "W": "no-warnings", "weights": "weight-files", "X": "xml-validation", "?": "help",
}  # fmt: skip
# Letters that need no value, so that others may follow in the same word.
_SWITCHES = frozenset("DGHQSTVWtv?")

_TELLS = "SUMO would write that and end"
_WAITS = "SUMO would wait for another program"
_GAME = "SUMO's window would wait for a person"
# Options that concern the window alone; a configuration may have them, as those of SUMO's games do.
_OF_A_PERSON = (
    "breakpoints", "demo", "game", "game.mode", "gui-testing", "gui-testing-debug",
    "gui-testing.setting-output",
)  # fmt: skip
# What switches off those that would have a window wait.
NO_WAITING = {"breakpoints": "", "demo": "false", "game": "false", "gui-testing": "false"}
# Options that no episode can run with, and why.
_UNBEARABLE = {
    **dict.fromkeys(("help", "version", "save-configuration", "save-configuration.relative",
    "save-template", "save-schema", "save-commented"), _TELLS),
    **dict.fromkeys(("remote-port", "num-clients"), _WAITS),
    **dict.fromkeys(_OF_A_PERSON, _GAME),
    "mesosim": "in a mesoscopic simulation vehicles have no positions",
    "no-internal-links": "build the network without them instead (netconvert -s FILE "
    "--no-internal-links true -o NEW)",
    "ignore-accidents": "the referee needs collisions",
}  # fmt: skip
_OFF = {"", "0", "no", "false", "off", "f", "-"}  # SUMO's words for it
# Values of unbearable options that do nothing as long as the option beside them is off.
_HARMLESS = {"num-clients": ("1",), "game.mode": ("tls",)}

# Lowest and highest value. SUMO takes any, and then needs all memory or time, or more threads than
# there are.
_BOUNDS = {
    "begin": (0.0, 1e9), "end": (0.0, 1e9), "step-length": (0.001, 10.0),
    "default.action-step-length": (0.0, 10.0), "lanechange.duration": (0.0, 60.0),
    "lateral-resolution": (0.1, 100.0), "scale": (0.0, 1000.0), "threads": (1.0, 64.0),
    "thread-rngs": (1.0, 10_000.0), "device.rerouting.threads": (0.0, 64.0),
    "precision": (0.0, 30.0), "precision.geo": (0.0, 30.0),
    "pedestrian.striping.stripe-width": (0.1, 10.0),
    "pedestrian.striping.walkingarea-detail": (0.0, 1000.0), "delay": (0.0, 60_000.0),
}  # fmt: skip
_OFF_BELOW_ZERO = ("end", "lateral-resolution")  # these are off at 0 and below

# Options with files that SUMO reads; those of the first have to be XML.
_XML = ("net-file", "route-files", "additional-files")
_READ = (
    *_XML, "weight-files", "load-state", "fcd-output.filter-edges.input-file",
    "device.ssm.filter-edges.input-file",
    "astar.all-distances", "astar.landmark-distances", "device.fcd-replay.files",
    "device.fcd-replay.file", "gui-settings-file", "edgedata-files",
    "alternative-net-file", "selection-file",
)  # fmt: skip
# Options by which SUMO writes a file, in full.
_WRITES = re.compile(r".*[-.]output|netstate-dump|log|message-log|device\.toc\.file")
# Values of theirs that name no file.
_NO_FILE = {
    "", "-", "stdout", "stderr", "nul", "null", os.devnull, "/dev/stdout", "/dev/stderr",
}  # fmt: skip
_SOCKET = re.compile(r"[^/\\]{2,}:\d+")
_VARIABLE = re.compile(r"\$\{(.+?)\}")

LEAST_UNPACKED = 1 << 28  # bytes to which any packed file may grow,
MOST_PACKED = 200  # and how many times its size a large one may: XML shrinks to a tenth


class Given(NamedTuple):
    """An option and its value."""

    name: str  # in full, without dashes
    value: str  # "true" where it needs none


def full_name(option_name: str) -> str:
    """What SUMO calls an option in full, without dashes."""
    return _SYNONYMS.get(option_name, option_name)


def option_names(arguments: Sequence[str]) -> set[str]:
    """The full names of the options on a command line."""
    return {given.name for given in on_command_line(arguments, "options")}


def on_command_line(words: Sequence[str], where: str) -> list[Given]:
    """The options in the words of a command line, read as SUMO does.

    SUMO accepts -e 5, -e5, -e=5, -ve 5, --end 5, --end=5. Raises ConfigError, with `where` in
    front, where a word is neither an option nor a value.
    """
    found: list[Given] = []
    left = list(words)
    while left:
        word = left.pop(0)
        if not _is_option(word):
            raise ConfigError(f"{where}: {word}: an option of SUMO begins with --")
        names, value = _split(word)
        if value is None:
            value = left.pop(0) if left and not _is_option(left[0]) else "true"
        found += [*(Given(name, "true") for name in names[:-1]), Given(names[-1], value)]
    return found


def require_bearable(given: Iterable[Given], where: str) -> None:
    """Raise ConfigError, with `where` in front, where an option would have SUMO do something else
    than simulate, or its number is beyond reason."""
    for name, value in given:
        if name in _UNBEARABLE and not is_off(value) and value not in _HARMLESS.get(name, ()):
            raise ConfigError(f"{where}: {name}: {_UNBEARABLE[name]}; leave it out")
        low, high = _BOUNDS.get(name, (-float("inf"), float("inf")))
        number = _number(value)
        if (
            number is not None
            and not low <= number <= high
            and not (name in _OFF_BELOW_ZERO and number <= 0.0)
        ):
            raise ConfigError(f"{where}: {name}: has to be from {low:g} to {high:g}, got {value}")
        if name == "lanechange.duration" and number is None and value.strip():
            raise ConfigError(f"{where}: {name}: has to be a number, got {value}")


def require_readable(given: Iterable[Given], folder: Path, where: str) -> None:
    """Raise ConfigError where SUMO would read or write what is no file: it would wait for ever at a
    pipe. `folder`: names of files are relative to it."""
    for name, value in given:
        if reads(name):
            for path in paths_in(expanded(value), folder):
                require_file(path, f"{where}: {name}", xml=name in _XML)
        elif writes(name) and value.lower() not in _NO_FILE:
            why = (
                "a socket, not a file"
                if _SOCKET.fullmatch(value)
                else files.problem(folder / expanded(value))
            )
            if why.endswith("not a file"):  # one that is not there yet is made
                raise ConfigError(f"{where}: {name}: {value}: {why}")


def without_window(given: Iterable[Given]) -> list[Given]:
    """The options without those that concern SUMO's window alone."""
    return [each for each in given if each.name not in _OF_A_PERSON]


def is_off(value: str) -> bool:
    """Whether a value switches an option off."""
    return value.strip().lower() in _OFF


def reads(name: str) -> bool:
    """Whether SUMO reads files by this option."""
    return name in _READ


def writes(name: str) -> bool:
    """Whether SUMO writes a file by this option."""
    return _WRITES.fullmatch(name) is not None


def paths_in(value: str, folder: Path) -> list[Path]:
    """The files in the value of an option."""
    return [folder / part.strip() for part in value.split(",") if part.strip()]


def expanded(value: str) -> str:
    """A value of a .sumocfg with its variables replaced as SUMO does.

    ${NAME} by the environment's, by nothing where there is none; ~ at the beginning of a file's
    name by the home folder.
    """
    value = re.sub(r"(^|,)~", r"\1${HOME}", value)
    return _VARIABLE.sub(lambda found: _variable(found[1]), value)


def unescaped(value: str) -> str:
    """The name of a file in a .sumocfg, where %20 stands for a space."""
    return unquote(value, errors="surrogateescape")


def _variable(name: str) -> str:
    if name == "SUMO_HOME":
        from sumo_mcts.world.library import running_sumo

        running_sumo()  # it sets the variable where it is not set
    return str(os.getpid()) if name == "PID" else os.environ.get(name, "")


def require_file(path: Path, where: str, *, xml: bool) -> None:
    """Raise ConfigError, with `where` in front, where this is no regular file, or no XML."""
    why = files.problem(path)
    if not why and xml:
        known = path.stat()
        why = _unbearable(path, known.st_mtime_ns, known.st_size)
    if why:
        raise ConfigError(f"{where}: {path}: {why}")


@lru_cache(maxsize=256)
def _unbearable(path: Path, changed: int, size: int) -> str:
    """Why SUMO cannot read a file, packed or not; "": it can.

    It is no XML, damaged, cut off, holds nothing but repetitions, or a flow without end. `changed`
    and `size` (bytes) are for the cache.
    """
    try:
        files.xml_root(path)
        files.require_whole(path, max(LEAST_UNPACKED, MOST_PACKED * size))
        return flows.problem(path)
    except OSError as error:
        return error.strerror or str(error)
    except ValueError as error:
        return f"not a readable XML file ({error})"


def _split(word: str) -> tuple[list[str], str | None]:
    """The full names of the options in a word, and the value that stands in it."""
    if word.startswith("--"):
        name, sep, value = word[2:].partition("=")
        return [full_name(name)], value if sep else None
    letters = word[1:]
    for k, letter in enumerate(letters):
        if letter not in _SWITCHES:
            rest = letters[k + 1 :]
            names = [full_name(each) for each in letters[: k + 1]]
            return names, rest.removeprefix("=") if rest else None
    return [full_name(each) for each in letters], None


def _is_option(word: str) -> bool:
    return word.startswith("-") and len(word) > 1 and not is_number(word)


def is_number(text: str) -> bool:
    """Whether Python reads a number in it; NaN is one too."""
    return _number(text) is not None


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
