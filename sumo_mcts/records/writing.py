"""Files that are written whole or not at all."""

import json
import math
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from sumo_mcts import files


def json_text(value: Any, indent: int | None = 2) -> str:
    """JSON without NaN and Infinity: they become null. Takes numpy values, paths and tuples."""
    return json.dumps(_plain(value), indent=indent, allow_nan=False)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file wholly or not at all, and for good; creates the folder. Raises OSError."""
    with written_whole(path) as unfinished:
        unfinished.write_bytes(content)


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Names a file to write, which in the end takes the place of `path`, unless something was
    raised; creates the folder. Raises OSError that names `path`."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    with files.naming(path, temporary):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield temporary
            with temporary.open("r+b") as file:
                os.fsync(file.fileno())
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
        _sync_folder(path.parent)


def _sync_folder(folder: Path) -> None:
    """Have a new name outlast a loss of power; Windows does that by itself."""
    if os.name == "posix":
        number = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain(item) for item in value]
    return value if value is None or isinstance(value, bool | int | str) else str(value)
