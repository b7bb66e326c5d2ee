"""Damaged traces and maps, and the errors that they may cause.

A column of a good file gets other numbers, is cut off, or has another type. As a program this
tries COUNT damaged copies of a folder. Without the JIT an index beyond an array is an error, not a
crash.

    NUMBA_DISABLE_JIT=1 python tests/helpers_damage.py FOLDER KEY COUNT SEED
"""

import shutil
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sumo_mcts import records
from sumo_mcts.commands import recorded
from sumo_mcts.errors import ConfigError
from sumo_mcts.reporting.replay import packed

WHOLE = (-1, -2, 0, 1, 7, 10**6, 2**31 - 1)
REAL = (np.nan, np.inf, -np.inf, 1e300, -1e300, -1.0, 0.0, 1e-300, 1e9, 1e7, 5e5, 1e-3, 3.7)
TEXTS = ("", "x" * 50, "a\n\x1b[31m", "=1+1", "../../x", '{"planner": 1}')

Columns = dict[str, NDArray[Any]]


def columns_of(path: Path) -> Columns:
    """The columns of a file by name."""
    with np.load(path) as archive:
        return dict(archive)


def damaged(columns: Columns, rng: np.random.Generator) -> tuple[Columns, list[str]]:
    """The columns with one or two of them damaged, and which."""
    result, names = dict(columns), sorted(name for name in columns if name != "format")
    chosen = [names[k] for k in rng.integers(len(names), size=rng.integers(1, 3))]
    for name in chosen:
        result[name] = _damaged(result[name].copy(), rng)
    return result, chosen


def _damaged(column: NDArray[Any], rng: np.random.Generator) -> NDArray[Any]:
    kind = rng.integers(8)
    if kind == 0:
        return column[: rng.integers(len(column) + 1)]
    if kind == 1:
        return column.astype(str)
    if kind == 2:
        return column.reshape(-1, 1)
    places = (
        np.arange(len(column))
        if kind == 3
        else rng.integers(max(len(column), 1), size=rng.integers(1, 4))
    )
    if not len(column):
        return column
    if column.dtype.kind == "U":
        texts = column.astype(object)
        texts[places] = TEXTS[rng.integers(len(TEXTS))]
        return texts.astype(str)
    if column.dtype.kind == "f":
        column[places] = REAL[rng.integers(len(REAL))]
    elif column.dtype.kind == "b":
        column[places] = rng.random(len(places)) < 0.5
    else:
        # a value from another place of the column, so inside its bounds
        within = int(column[rng.integers(len(column))])
        bounds = np.iinfo(column.dtype)
        column[places] = min(
            max((*WHOLE, within, within)[rng.integers(len(WHOLE) + 2)], int(bounds.min)),
            int(bounds.max),
        )
    return column


def copy_damaged(source: Path, target: Path, rng: np.random.Generator) -> list[str]:
    """Copy a folder with one trace and one map, and damage one of them. Returns the damaged columns."""
    shutil.rmtree(target, ignore_errors=True)
    kinds = (records.TRACES, records.MAPS)
    hit = kinds[rng.integers(2)]
    what: list[str] = []
    for kind in kinds:
        (path,) = (source / kind).iterdir()
        columns = columns_of(path)
        if kind == hit:
            columns, what = damaged(columns, rng)
        (target / kind).mkdir(parents=True)
        np.savez(target / kind / path.name, **columns)  # type: ignore[arg-type]
    return what


def uses(
    folder: Path, key: str, at: float, *sets: str, again: bool
) -> dict[str, Callable[[], object]]:
    """All functions that read a trace and its map; `again`: the slow ones too."""
    trace = lambda: recorded.trace_of(folder, key)  # noqa: E731
    silent = lambda text: None  # noqa: E731
    found: dict[str, Callable[[], object]] = {
        "explain": lambda: recorded.explanation_text(
            recorded.explain(folder, key, at, False, (), silent)
        ),
        "packed": lambda: packed(trace()),
        "csv": lambda: recorded.write(folder, key, "csv", None, silent),
        "fcd": lambda: recorded.write(folder, key, "fcd", None, silent),
    }
    if again:
        found["png"] = lambda: recorded.write(folder, key, "png", None, silent)
        found["replan"] = lambda: _not_failed(recorded.explain(folder, key, at, True, sets, silent))
    return found


def _not_failed(explained: dict[str, Any]) -> None:
    """The driver catches errors of the planner. An IndexError would be a crash in compiled code."""
    reason = explained["replan"]["decision"]["reason"]
    assert "failed: IndexError" not in reason, reason


def outcome(use: Callable[[], object]) -> str:
    """The error message, of one line; "" where `use` succeeds."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # overflows of large but valid numbers
            use()
    except ConfigError as error:
        return _one_line(str(error))
    return ""


def _one_line(message: str) -> str:
    assert "\n" not in message, message
    return message


def main(source: Path, key: str, count: int, seed: int) -> None:
    """Damage `count` copies, and read each with every function."""
    rng, refused = np.random.default_rng(seed), 0
    for _ in range(count):
        what = copy_damaged(source, source.with_name("damaged"), rng)
        for name, use in uses(
            source.with_name("damaged"), key, 6.0, "planner.iterations=1", again=True
        ).items():
            try:
                refused += outcome(use) != ""
            except BaseException:
                sys.stderr.write(f"{name}: {', '.join(what)}\n")
                raise
    sys.stdout.write(f"{count} damaged, {refused} refusals\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
