"""Manifests: what the episodes of a folder were run with."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sumo_mcts import files
from sumo_mcts.records.layout import MANIFEST, MANIFESTS, SCHEMA_VERSION
from sumo_mcts.records.writing import json_text, write_whole

LARGEST_MANIFEST = 1 << 26  # bytes


def write_manifest(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Write the manifest of a folder. Raises OSError."""
    _write(folder / MANIFEST, manifest)


def read_manifest(folder: Path) -> dict[str, Any] | None:
    """The manifest of a folder; None where it is damaged.

    Raises OSError where there is none, or where it cannot be read.
    """
    return _read(folder / MANIFEST)


def write_manifest_of(folder: Path, key: str, manifest: Mapping[str, Any]) -> None:
    """Write the manifest of one episode. Raises OSError."""
    _write(folder / MANIFESTS / f"{key}.json", manifest)


def read_manifest_of(folder: Path, key: str) -> dict[str, Any]:
    """The manifest of one episode; empty where there is none that can be read."""
    try:
        return _read(folder / MANIFESTS / f"{key}.json") or {}
    except OSError:
        return {}


def _write(path: Path, manifest: Mapping[str, Any]) -> None:
    text = json_text({"schema_version": SCHEMA_VERSION, **manifest})
    write_whole(path, (text + "\n").encode())


def _read(path: Path) -> dict[str, Any] | None:
    """The mapping in a file; None where it holds none. Raises OSError where it cannot be read."""
    with files.opened(path) as file:
        content = file.read(LARGEST_MANIFEST + 1)
    try:
        found = json.loads(content) if len(content) <= LARGEST_MANIFEST else None
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None
