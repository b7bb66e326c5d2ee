"""What a folder of results says of itself: manifest.json, versions, the names of its files."""

import functools
import hashlib
import json
import platform
import re
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from sumo_mcts import files
from sumo_mcts.records.writing import json_text, write_whole

SCHEMA_VERSION = 1
MANIFEST, ROWS, TABLE = "manifest.json", "episodes.jsonl", "episodes.csv"
TRACES, MAPS, MANIFESTS, FIGURES = "traces", "maps", "manifests", "figures"
LARGEST_MANIFEST = 1 << 26  # bytes


def write_manifest(folder: Path, manifest: Mapping[str, Any]) -> None:
    """manifest.json. Raises OSError."""
    write_whole(
        folder / MANIFEST,
        (json_text({"schema_version": SCHEMA_VERSION, **manifest}) + "\n").encode(),
    )


def read_manifest(folder: Path) -> dict[str, Any] | None:
    """manifest.json;

    None where it is damaged. Raises OSError where there is none, or it cannot be read.
    """
    return _read_json(folder / MANIFEST)


def write_manifest_of(folder: Path, key: str, manifest: Mapping[str, Any]) -> None:
    """manifests/KEY.json: what one episode was run with. Raises OSError."""
    write_whole(
        folder / MANIFESTS / f"{key}.json",
        (json_text({"schema_version": SCHEMA_VERSION, **manifest}) + "\n").encode(),
    )


def read_manifest_of(folder: Path, key: str) -> dict[str, Any]:
    """What one episode was run with; empty where nothing, or nothing that can be read, tells."""
    try:
        return _read_json(folder / MANIFESTS / f"{key}.json") or {}
    except OSError:
        return {}


def versions() -> dict[str, str | None]:
    """What this ran on; null where a package is not installed."""
    packages = {"sumo_mcts": "sumo-mcts", "sumo": "libsumo", "numpy": "numpy", "numba": "numba"}
    numbers = {name: _version(package) for name, package in packages.items()}
    return {
        **numbers,
        "sources": sources(),
        "python": platform.python_version(),
        "platform": platform.platform(),
    }


@functools.cache
def sources() -> str:
    """A digest of the package's code: a version number outlives many changes."""
    folder = Path(__file__).resolve().parent
    return hashlib.sha256(
        b"".join(path.read_bytes() for path in sorted(folder.rglob("*.py")))
    ).hexdigest()[:16]


def safe_name(part: str) -> str:
    """The text itself where it can stand in a file name; otherwise a readable form with a hash that
    keeps it unique."""
    if len(part) <= 60 and re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.]*(-[A-Za-z0-9_.]+)*", part):
        return part
    readable = re.sub(r"[^A-Za-z0-9_]+", "_", part)[:40] or "_"
    return f"{readable}-{hashlib.sha256(part.encode(errors='backslashreplace')).hexdigest()[:8]}"


def _read_json(path: Path) -> dict[str, Any] | None:
    """The mapping in a file; None where it holds none. Raises OSError where it cannot be read."""
    with files.opened(path) as file:
        content = file.read(LARGEST_MANIFEST + 1)
    try:
        found = json.loads(content) if len(content) <= LARGEST_MANIFEST else None
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
