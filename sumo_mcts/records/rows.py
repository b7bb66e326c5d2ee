"""The rows of episodes: made, added to episodes.jsonl, read from it, written as episodes.csv.

What the keys of a row mean: measures.py.
"""

import hashlib
import io
import json
import math
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np

from sumo_mcts import files
from sumo_mcts.records.layout import ROWS, TABLE
from sumo_mcts.records.measures import BY_KEY, REQUIRED, ROW_KEYS, Row
from sumo_mcts.records.writing import json_text, write_table, written_whole

LONGEST_LINE = 1 << 20  # bytes; a longer line is no row


# --- making a row ---


def complete_row(known: Mapping[str, Any]) -> Row:
    """A row with every key in order: the known values, and None for the others.

    Numbers that are not finite are unknown. Raises TypeError where a key is no measure, or a value
    not of its measure's type, and ValueError where a number is out of its measure's bounds.
    """
    row = {**row_defaults(), **{key: _python_value(value) for key, value in known.items()}}
    for key, value in row.items():
        if key not in BY_KEY:
            raise TypeError(f"{key} is no key of a row: records/measures.py names them all")
        if not BY_KEY[key].is_of_kind(value):
            raise TypeError(f"{key} has to be a {BY_KEY[key].kind.value}, got {value!r}")
        if not BY_KEY[key].is_within(value):
            raise ValueError(f"{key} has to lie between 0 and {BY_KEY[key].most:g}, got {value!r}")
    return row


def row_defaults() -> Row:
    """A row with every key, all unknown."""
    return dict.fromkeys(ROW_KEYS)


def episode_key(scenario: str, variant: str, seed: int | None, ego: str | None = None) -> str:
    """scenario--variant--seed[--ego], safe as a file name; different episodes have different keys.

    Without a seed it is SUMO's own.
    """
    seed_name = "own" if seed is None else str(seed)
    parts = [scenario, variant, seed_name, *([] if ego is None else [ego])]
    return "--".join(_safe_name(part) for part in parts)


def _python_value(value: Any) -> Any:
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _safe_name(part: str) -> str:
    """The text itself where it can stand in a file name; otherwise a readable form with a hash that
    keeps it unique."""
    if len(part) <= 60 and re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.]*(-[A-Za-z0-9_.]+)*", part):
        return part
    readable = re.sub(r"[^A-Za-z0-9_]+", "_", part)[:40] or "_"
    return f"{readable}-{hashlib.sha256(part.encode(errors='backslashreplace')).hexdigest()[:8]}"


# --- episodes.jsonl ---


def append_row(folder: Path, row: Mapping[str, Any]) -> None:
    """Add a row to episodes.jsonl; on disk when this returns. Raises OSError."""
    line = _line(row)
    with files.naming(folder / ROWS):
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / ROWS).open("a+b", buffering=0) as file:
            # A killed process may have left half a line, which must not become one line with this
            # row.
            if file.tell() and _last_byte(file) != b"\n":
                line = b"\n" + line
            _append_whole(file, line)


def put_row(folder: Path, row: Mapping[str, Any]) -> bool:
    """Add a row to episodes.jsonl, or replace the rows with the same key; whether it replaced any.

    On disk when this returns, and all other lines as they were. Raises OSError.
    """
    if all(known["key"] != row["key"] for known in read_rows(folder)):
        append_row(folder, row)
        return False
    line = _line(row)
    with (
        files.opened(folder / ROWS) as file,
        written_whole(folder / ROWS) as unfinished,
        unfinished.open("wb") as copy,
    ):
        for part, whole in _parts(file):
            known = _parsed(part) if whole else None
            if known is None or known["key"] != row["key"]:
                copy.write(part)
            else:
                copy.write(line)
                line = b""  # once
    return True


def read_rows(folder: Path) -> list[Row]:
    """The rows of episodes.jsonl; none where there is no file. Raises OSError.

    Lines that are no whole row are left out: a killed process leaves such a line.
    """
    return rows_and_torn(folder)[0]


def rows_and_torn(folder: Path) -> tuple[list[Row], int]:
    """The same rows, and how many lines are left out."""
    rows, torn, inside = [], 0, False  # inside: of a line that is too long
    try:
        with files.opened(folder / ROWS) as file:
            for part, whole in _parts(file):
                row = _parsed(part) if whole else None
                if row is not None:
                    rows.append(row)
                elif part.strip() and not (inside and not whole):  # its first part counts
                    torn += 1
                inside = not whole
    except FileNotFoundError:
        pass
    return rows, torn


def _line(row: Mapping[str, Any]) -> bytes:
    """A row as a line of episodes.jsonl."""
    return (json_text({**row_defaults(), **row}, indent=None) + "\n").encode()


def _last_byte(file: IO[bytes]) -> bytes:
    file.seek(-1, os.SEEK_END)
    return file.read(1)


def _append_whole(file: io.FileIO, content: bytes) -> None:
    """Append content to an unbuffered file, and write it to the disk. If that fails, the file is as
    before: a full disk may take a part of the content."""
    end = file.seek(0, os.SEEK_END)
    try:
        while content:
            content = content[file.write(content) :]
        os.fsync(file.fileno())
    except OSError:
        os.ftruncate(file.fileno(), end)
        raise


def _parts(file: IO[bytes]) -> Iterator[tuple[bytes, bool]]:
    """The lines of a file, each with whether it is whole: a line longer than LONGEST_LINE comes in
    parts."""
    whole = True
    while part := file.readline(LONGEST_LINE):
        ends = len(part) < LONGEST_LINE or part.endswith(b"\n")
        yield part, whole and ends
        whole = ends


def _parsed(line: bytes) -> Row | None:
    """The row in a line; None where it is no whole row."""
    try:
        row = json.loads(line.decode(errors="replace"))
    except (ValueError, RecursionError):  # also numbers of too many digits, brackets without end
        return None
    whole = isinstance(row, dict) and all(
        isinstance(row.get(key), str) and row[key] for key in REQUIRED
    )
    return row if whole else None


# --- episodes.csv ---


def write_csv(folder: Path) -> None:
    """Write episodes.csv from episodes.jsonl: the last row of each key.

    Raises OSError.
    """
    rows = list({row["key"]: row for row in read_rows(folder)}.values())
    further = dict.fromkeys(key for row in rows for key in row if key not in ROW_KEYS)
    write_table(folder / TABLE, (*ROW_KEYS, *further), rows)
