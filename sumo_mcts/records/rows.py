"""What an episode leaves behind: rows (JSON Lines, CSV), a manifest, and a trace of every cycle
(npz, no pickle)."""

import csv
import io
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

from sumo_mcts import files
from sumo_mcts.records.manifest import ROWS, TABLE, safe_name
from sumo_mcts.records.writing import json_text, write_whole, written_whole

LONGEST_LINE = 1 << 20  # bytes; a longer line is no row

# The row, in the order of docs/measures.md.
ROW_KEYS = (
    "key", "scenario", "variant", "planner", "prediction", "ego", "seed", "outcome", "error",
    "at_fault", "inevitable", "collisions",
    "travel_time_s", "free_flow_s", "in_time", "distance_m", "stopped_s", "max_decel_mps2",
    "hard_brakes", "rms_jerk_mps3", "comfortable_share",
    "speeding_share", "lane_changes", "decision_flips", "red_lights_run", "yellow_run",
    "imposed_max_decel_mps2", "imposed_brakes_2",
    "imposed_brakes_3", "imposed_brakes_4", "min_ttc_s", "min_pet_s", "max_drac_mps2",
    "failsafe_interventions", "iterations_per_decision",
    "iterations", "cycles", "deadline_s", "deadline_misses", "plan_ms_p50", "plan_ms_p95",
    "plan_ms_p99", "plan_ms_max", "wall_s",
    "realtime_factor", "trace_digest", "config_digest",
)  # fmt: skip
WHOLE = ("key", "scenario", "variant", "outcome")  # texts without which a line is no row
Row = dict[str, Any]


# --- rows and manifest ---


def row_defaults() -> Row:
    """A row with every key, all unknown."""
    return dict.fromkeys(ROW_KEYS)


def episode_key(scenario: str, variant: str, seed: int | None, ego: str | None = None) -> str:
    """scenario--variant--seed[--ego], safe as a file name; different episodes have different keys.

    Without a seed it is SUMO's own.
    """
    parts = [
        scenario,
        variant,
        "own" if seed is None else str(seed),
        *([] if ego is None else [ego]),
    ]
    return "--".join(safe_name(part) for part in parts)


def append_row(folder: Path, row: Mapping[str, Any]) -> None:
    """Add a row to episodes.jsonl; on disk when this returns. Raises OSError."""
    line = _line(row)
    with files.naming(folder / ROWS):
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / ROWS).open("a+b", buffering=0) as file:
            # A killed process may have left half a line: it must not swallow this one.
            if file.tell() and _last_byte(file) != b"\n":
                line = b"\n" + line
            _append_whole(file, line)


def put_row(folder: Path, row: Mapping[str, Any]) -> bool:
    """Add a row to episodes.jsonl, or put it in the place of those with the same key, and whether
    it did that; on disk when this returns, and all other lines as they were. Raises OSError."""
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
    """The rows of episodes.jsonl, without lines that are no whole row, as a killed process leaves
    one; none where there is no file. Raises OSError."""
    return rows_and_torn(folder)[0]


def rows_and_torn(folder: Path) -> tuple[list[Row], int]:
    """The same, and how many lines are left out."""
    rows, torn, long = [], 0, False
    try:
        with files.opened(folder / ROWS) as file:
            for part, whole in _parts(file):
                row = _parsed(part) if whole else None
                if row is not None:
                    rows.append(row)
                elif part.strip() and not (
                    long and not whole
                ):  # of a line that is too long the first part counts
                    torn += 1
                long = not whole
    except FileNotFoundError:
        pass
    return rows, torn


def write_csv(folder: Path) -> None:
    """episodes.csv from episodes.jsonl: a row a key, the last one; unknown is an empty cell.

    Raises OSError.
    """
    rows = list({row["key"]: row for row in read_rows(folder)}.values())
    further = dict.fromkeys(key for row in rows for key in row if key not in ROW_KEYS)
    write_table(folder / TABLE, (*ROW_KEYS, *further), rows)


def write_table(path: Path, columns: Sequence[str], rows: Sequence[Row]) -> None:
    """Rows as CSV: unknown is an empty cell, and no text begins as a formula does.

    Raises OSError.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writerow({column: _cell(column) for column in columns})
    writer.writerows({key: _cell(value) for key, value in row.items()} for row in rows)
    write_whole(path, text.getvalue().encode(errors="backslashreplace"))


def _line(row: Mapping[str, Any]) -> bytes:
    """A row as a line of episodes.jsonl."""
    return (json_text({**row_defaults(), **row}, indent=None) + "\n").encode()


def _append_whole(file: io.FileIO, content: bytes) -> None:
    """Add to the end of a file without a buffer, for good and wholly, or leave it as it was: a full
    disk may take half of it."""
    end = file.seek(0, os.SEEK_END)
    try:
        while content:
            content = content[file.write(content) :]
        os.fsync(file.fileno())
    except OSError:
        os.ftruncate(file.fileno(), end)
        raise


def _last_byte(file: IO[bytes]) -> bytes:
    file.seek(-1, os.SEEK_END)
    return file.read(1)


def _parts(file: IO[bytes]) -> Iterator[tuple[bytes, bool]]:
    """The lines of a file, each with whether it is a whole one: a line longer than LONGEST_LINE
    comes in parts."""
    whole = True
    while part := file.readline(LONGEST_LINE):
        ends = len(part) < LONGEST_LINE or part.endswith(b"\n")
        yield part, whole and ends
        whole = ends


def _parsed(line: bytes) -> Row | None:
    """The row that a line holds; None where it is no whole one."""
    try:
        row = json.loads(line.decode(errors="replace"))
    except (
        ValueError,
        RecursionError,
    ):  # numbers of too many digits, and brackets without end, too
        return None
    return (
        row
        if isinstance(row, dict)
        and all(isinstance(row.get(key), str) and row[key] for key in WHOLE)
        else None
    )


def _cell(value: Any) -> Any:
    """What stands in a table: nothing where unknown, and an apostrophe before a text that
    spreadsheets would take for a formula."""
    if value is None:
        return ""
    if isinstance(value, str):
        text = value.replace(
            "\r", "\n"
        )  # which is put into quotes; a carriage return is not, and would end the line
        return f"'{text}" if text.startswith(("=", "+", "-", "@", "\t", "\n")) else text
    return json.dumps(value) if isinstance(value, bool | list | dict) else value
