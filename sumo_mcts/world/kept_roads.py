"""Large networks on disk as they were read: reading one takes seconds, loading it milliseconds.

A file is named by a digest of what the map follows from: the network file's content, the versions
of this package's code and of the libraries. What is damaged counts as missing; deleting files, or
all of the folder, is safe at any time.
"""

import hashlib
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import sumolib  # type: ignore[import-untyped]

from sumo_mcts import files
from sumo_mcts.numerics.kept import lasting_folder
from sumo_mcts.records import TraceError, check, map_bytes, write_whole
from sumo_mcts.records.codec import load_columns
from sumo_mcts.records.provenance import versions
from sumo_mcts.road import RoadMap

FOLDER = "networks"  # in the user's cache folder
LEAST_BYTES = 1 << 20  # smaller network files are read at once
MOST_FILES = 32  # those that were used last


def kept_roadmap(net_file: Path, read: Callable[[], RoadMap]) -> RoadMap:
    """The roads in `net_file`: those on disk, or those that `read` returns, which are then kept.

    Raises what `read` raises.
    """
    name = _name(net_file)
    folder = lasting_folder(FOLDER) if name else None
    if folder is None:
        return read()
    place = folder / name
    try:
        road: RoadMap = load_columns(place, RoadMap, "map", check.map_problem)
    except (TraceError, OSError):
        road = read()
        if _name(net_file) == name:  # it is still the file that was read
            _keep(place, road)
    else:
        with suppress(OSError):
            os.utime(place)  # used last
    return road


def _name(net_file: Path) -> str:
    """The name of the file for a network; "" where none is kept."""
    digest = hashlib.sha256(repr((versions(), sumolib.__version__)).encode())
    try:
        if net_file.stat().st_size < LEAST_BYTES:
            return ""
        with files.opened(net_file) as file:
            for chunk in iter(lambda: file.read(LEAST_BYTES), b""):
                digest.update(chunk)
    except OSError:
        return ""
    return f"{digest.hexdigest()[:32]}.npz"


def _keep(place: Path, road: RoadMap) -> None:
    """Write roads, and remove what has not been used for the longest time. It may fail: then the
    network is read again next time."""
    with suppress(OSError):
        write_whole(place, map_bytes(road))
        by_use = sorted(place.parent.iterdir(), key=lambda each: each.stat().st_mtime_ns)
        for old in by_use[:-MOST_FILES]:
            old.unlink()
