"""Files that are written wholly or not at all, JSON text and CSV tables."""

import csv
import io
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from sumo_mcts import files


def write_whole(path: Path, content: bytes) -> None:
    """Write a file wholly or not at all, and onto the disk; creates the folder. Raises OSError."""
    with written_whole(path) as unfinished:
        unfinished.write_bytes(content)


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Name a file to write, which then takes the place of `path`, unless something was raised.

    Creates the folder. Raises OSError that names `path`.
    """
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


def write_table(path: Path, columns: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows as CSV: unknown is an empty cell, and no text begins as a formula does.

    Raises OSError.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writerow({column: _cell(column) for column in columns})
    writer.writerows({key: _cell(value) for key, value in row.items()} for row in rows)
    write_whole(path, text.getvalue().encode(errors="backslashreplace"))


def json_text(value: Any, indent: int | None = 2) -> str:
    """JSON without NaN and Infinity: they become null. Takes numpy values, paths and tuples."""
    return json.dumps(_plain(value), indent=indent, allow_nan=False)


def _sync_folder(folder: Path) -> None:
    """Have a new name outlast a loss of power; Windows does that by itself."""
    if os.name == "posix":
        number = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)


def _cell(value: Any) -> Any:
    """A value as it stands in a table: empty where unknown, and an apostrophe before a text that
    spreadsheets would take for a formula."""
    if value is None:
        return ""
    if isinstance(value, str):
        # A line break is put into quotes; a carriage return is not, and would end the line.
        text = value.replace("\r", "\n")
        return f"'{text}" if text.startswith(("=", "+", "-", "@", "\t", "\n")) else text
    return json.dumps(value) if isinstance(value, bool | list | dict) else value


def _plain(value: Any) -> Any:
    """The value in types of JSON."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain(item) for item in value]
    return value if value is None or isinstance(value, bool | int | str) else str(value)
