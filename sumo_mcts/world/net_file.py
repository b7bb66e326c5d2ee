"""Reads a SUMO network file with sumolib, and refuses a file that is none."""

import zlib
from typing import Any, NamedTuple
from xml.sax import SAXException
from xml.sax.expatreader import ExpatParser

import sumolib  # type: ignore[import-untyped]

from sumo_mcts import files
from sumo_mcts.process.garbage import no_collection

MOST_UNPACKED = 1 << 30  # bytes of a network
MOST_DURATION = 1e9  # s, of a phase of a signal
MOST_SPEED = 1000.0  # m/s: beyond it a number is taken for damage
CROSSING = "crossing"
ON_FOOT = ("walkingarea", CROSSING)  # functions of edges that no vehicle drives on

# What sumolib and its parser raise on a file that is not what they expect.
BROKEN = (
    OSError,
    EOFError,
    zlib.error,
    SAXException,
    ValueError,
    LookupError,
    AttributeError,
    TypeError,
)
_TRUE = ("true", "t", "yes", "y", "on", "x", "1")  # as SUMO reads it
# The element in which each element has to be.
_PARENTS = {
    "lane": "edge",
    "request": "junction",
    "phase": "tlLogic",
    "restriction": "type",
    **dict.fromkeys(("edge", "junction", "connection", "tlLogic", "location"), "net"),
}


class NetFile(NamedTuple):
    """What a network file says."""

    net: Any  # as sumolib has it
    # what sumolib leaves out: vehicle classes that may change from a lane (id) to the left and to
    # the right, where not all may
    changes: dict[str, tuple[str, str]]
    # type of edges -> vehicle class -> its limit there, m/s
    restrictions: dict[str, dict[str, float]]
    lefthand: bool  # traffic drives on the left


def read_net(net_file: str) -> NetFile:
    """Read a network file. Raises BROKEN, most of it as ValueError with the line."""
    root = files.xml_root(net_file)
    if root != "net":
        raise ValueError(f"its root element is {root}, that of a network is net")
    files.require_whole(net_file, MOST_UNPACKED)
    reader = _Reader(withInternal=True)
    parser = ExpatParser()
    parser.setContentHandler(reader)
    try:
        with no_collection():
            for chunk in files.unpacked(net_file, MOST_UNPACKED):
                parser.feed(chunk)
            parser.close()
    except SAXException:
        raise
    except BROKEN as error:
        missing = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise ValueError(
            f"line {parser.getLineNumber()}: {missing or type(error).__name__}"
        ) from error
    return NetFile(reader.getNet(), reader.changes, reader.restrictions, reader.lefthand)


class _Reader(sumolib.net.NetReader):  # type: ignore[misc]  # sumolib has no types
    """Refuses what sumolib lets pass and SUMO does not survive: elements out of place, and lanes
    that are not numbered one by one."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self._inside: list[str] = []
        self._edge, self._lanes = "", 0
        self._type = ""
        self.changes: dict[str, tuple[str, str]] = {}
        self.restrictions: dict[str, dict[str, float]] = {}
        self.lefthand = False

    def startElement(self, name: str, attrs: Any) -> None:  # noqa: N802  # the parser's name
        """Called by the parser."""
        parent = self._inside[-1] if self._inside else ""
        if _PARENTS.get(name, parent) != parent:
            raise ValueError(f"{name}: inside {parent}, not {_PARENTS[name]}")
        if name == "net":
            self.lefthand = attrs.get("lefthand", "").lower() in _TRUE
        elif name == "edge":
            self._edge, self._lanes = attrs["id"], 0
        elif name == "lane":
            if attrs["id"] != f"{self._edge}_{self._lanes}":
                raise ValueError(
                    f"lane {attrs['id']}: number {self._lanes} of edge {self._edge}, so its id has "
                    f"to be {self._edge}_{self._lanes}"
                )
            self._lanes += 1
            if "changeLeft" in attrs or "changeRight" in attrs:
                self.changes[attrs["id"]] = (
                    attrs.get("changeLeft", "all"),
                    attrs.get("changeRight", "all"),
                )
        elif name == "type":
            self._type = attrs["id"]
        elif name == "restriction":
            speed = float(attrs["speed"])
            require_within(f"type {self._type}: restriction: speed", speed, 0.0, MOST_SPEED)
            self.restrictions.setdefault(self._type, {})[attrs["vClass"]] = speed
        elif name == "phase":
            for key in ("duration", "minDur", "maxDur"):
                require_within(f"phase: {key}", float(attrs.get(key, 0.0)), 0.0, MOST_DURATION)
        self._inside.append(name)
        super().startElement(name, attrs)

    def endElement(self, name: str) -> None:  # noqa: N802  # the parser's name
        """Called by the parser."""
        self._inside.pop()
        super().endElement(name)


def require_within(what: str, value: float, low: float, high: float) -> None:
    """Raise ValueError where a value is not a number from `low` to `high`."""
    if not low <= value <= high:
        raise ValueError(f"{what}: has to be from {low:g} to {high:g}, got {value:g}")
