"""The commands render, export and explain: recorded episodes, without SUMO."""

import math
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

from sumo_mcts.errors import ConfigError
from sumo_mcts.records import (
    FIGURES,
    MAPS,
    MOMENTS,
    TRACES,
    Row,
    Trace,
    TraceError,
    load_map,
    load_trace,
    read_rows,
    require_fit,
    scenario_of,
)
from sumo_mcts.road import RoadMap

PICTURES, TABLES = ("png", "gif", "mp4"), ("csv", "fcd")
SUFFIXES = {"fcd": ".fcd.xml"}  # of files, where it is not the format's name
NAMED = 5  # keys that a message names
Note = Callable[[str], object]


class Choice(NamedTuple):
    """A recorded episode."""

    key: str
    outcome: str  # "" where the folder has no row of it


def choices(folder: Path) -> list[Choice]:
    """The recorded episodes of a folder. Raises ConfigError where there are none."""
    if not folder.is_dir():
        raise ConfigError(
            f"{folder}: no such folder; allowed: what --out of `run` or `batch` named"
        )
    keys = sorted(path.stem for path in (folder / TRACES).glob("*.npz"))
    if not keys:
        raise ConfigError(
            f"{folder}: no recorded episode: {TRACES}/*.npz is what `run --out` and `batch --out` "
            "leave"
        )
    outcomes = {row["key"]: row["outcome"] for row in _rows(folder)}
    return [Choice(key, outcomes.get(key, "")) for key in keys]


def chosen(folder: Path, episode: str | None) -> str | None:
    """The key of the episode that is asked for, or of the only one.

    None where there are several. Raises ConfigError where there is none.
    """
    keys = [choice.key for choice in choices(folder)]
    if episode is None:
        return keys[0] if len(keys) == 1 else None
    if episode in keys:
        return episode
    if any(row["key"] == episode for row in _rows(folder)):
        raise ConfigError(
            f"{folder}: --episode {episode}: it was run, but its trace was not kept; an experiment "
            "keeps all of them with traces: all"
        )
    near = get_close_matches(episode, keys, NAMED, 0.4) or keys[:NAMED]
    raise ConfigError(
        f"{folder}: --episode {episode}: no such episode; close to it: {', '.join(near)}"
    )


def _rows(folder: Path) -> list[Row]:
    """The rows of a folder; none where they cannot be read: traces can be read without them."""
    try:
        return read_rows(folder)
    except OSError:
        return []


def trace_of(folder: Path, key: str) -> Trace:
    """The trace of an episode. Raises ConfigError where it cannot be read or holds no decision."""
    path = folder / TRACES / f"{key}.npz"
    try:
        trace = load_trace(path)
    except TraceError as error:
        raise ConfigError(str(error)) from None
    try:
        scenario_of(trace.setting)
    except TraceError as error:
        raise ConfigError(f"{path}: {error}") from None
    if not trace.cycles:
        raise ConfigError(f"{folder}: --episode {key}: its trace holds no decision")
    return trace


def map_of(folder: Path, trace: Trace) -> RoadMap:
    """The roads that a trace refers to. Raises ConfigError where they are missing, or others."""
    path = folder / MAPS / f"{trace.setting.map}.npz"
    if not path.is_file():
        raise ConfigError(
            f"{path}: no such file; {trace.key} refers to its lanes by the numbers that they have "
            "there"
        )
    try:
        road = load_map(folder, trace.setting.map)
    except TraceError as error:
        raise ConfigError(str(error)) from None
    try:
        require_fit(trace, road)
    except TraceError as error:
        raise ConfigError(f"{folder / TRACES / trace.key}.npz: {error}") from None
    return road


def format_of(wanted: str | None, out: Path | None, allowed: Sequence[str]) -> str:
    """The format: `wanted`, or that of the name of the file `out`; else the first of `allowed`.

    Raises ConfigError where the two differ, or are not allowed.
    """
    if wanted is not None and wanted not in allowed:
        raise ConfigError(f"--format {wanted}: allowed: {', '.join(allowed)}")
    known = {SUFFIXES.get(name, f".{name}"): name for name in allowed}
    meant = next(
        (name for suffix, name in known.items() if out is not None and out.name.endswith(suffix)),
        None,
    )
    if out is not None and meant is None and wanted is None:
        way = "Give --format, or a name that" if len(allowed) > 1 else "Give a name that"
        raise ConfigError(f"--out {out}: what is to be written? {way} ends in {', '.join(known)}")
    if meant is not None and wanted not in (None, meant):
        raise ConfigError(f"--format {wanted}: the name of --out {out} says {meant}")
    return wanted or meant or allowed[0]


def write(folder: Path, key: str, form: str, out: Path | None, note: Note) -> Path:
    """Draw or export an episode; the file. Raises ConfigError, OSError."""
    inside = folder / (FIGURES if form in PICTURES else "exports")
    path = out or inside / f"{key}{SUFFIXES.get(form, f'.{form}')}"
    note("reading the trace")
    trace = trace_of(folder, key)
    if form in PICTURES:
        _draw(trace, form, path, note)
    else:
        _export(trace, map_of(folder, trace), form, path, note)
    return path


def moments_of(text: str | None) -> tuple[float, ...]:
    """The times of `--moments`, in rising order; none where it is not given. Raises ConfigError."""
    from sumo_mcts.reporting.sheet import MOST

    if text is None:
        return ()
    words = text.split(",")
    try:
        times = sorted({float(word) for word in words})
    except ValueError:
        times = []
    if not times or not all(map(math.isfinite, times)):
        raise ConfigError(f"--moments {text}: allowed: times in s, as 2,4,6")
    if len(times) > MOST:
        raise ConfigError(f"--moments {text}: {len(times)} moments; allowed: at most {MOST}")
    return tuple(times)


def views_of(text: str | None, moments: str | None) -> tuple[str, ...]:
    """The views of `--views`, each once; all where it is not given.

    Raises ConfigError, also where no `moments` are given.
    """
    from sumo_mcts.reporting.sheet import VIEWS

    if text is None:
        return VIEWS
    views = tuple(dict.fromkeys(text.split(",")))
    unknown = [view for view in views if view not in VIEWS]
    if unknown:
        raise ConfigError(f"--views {text}: {unknown[0]!r}; allowed: {', '.join(VIEWS)}")
    if moments is None:
        raise ConfigError(f"--views {text}: of which moments? Give --moments, in s, as 2,4,6")
    return views


def write_sheet(
    folder: Path, key: str, times: Sequence[float], views: Sequence[str], out: Path | None,
    note: Note,
) -> Path:  # fmt: skip
    """Draw moments of an episode (simulation time, s), a column for each; the file.

    Raises ConfigError, OSError.
    """
    from sumo_mcts.reporting.sheet import sheet

    path = out or folder / FIGURES / f"{key}{MOMENTS}"
    note("reading the trace")
    trace = trace_of(folder, key)
    first, last = trace.cycles[0].time, trace.cycles[-1].time
    beyond = [time for time in times if not first - 1e-6 <= time <= last + 1e-6]
    if beyond:
        raise ConfigError(
            f"--moments: {beyond[0]:g}; {key} has decisions from {first:g} s to {last:g} s"
        )
    note("drawing the moments")
    sheet(trace, _map_if_there(folder, trace), times, views, path)
    return path


def _draw(trace: Trace, form: str, path: Path, note: Note) -> None:
    from sumo_mcts.reporting import animation, storyboard
    from sumo_mcts.reporting.film import EncoderError, film

    match form:
        case "png":
            note("drawing the storyboard")
            storyboard.storyboard(trace, path)
        case "gif":
            note("drawing the film")
            animation.animation(trace, path, note=note)
        case _:
            try:
                film(trace, path, note)
            except EncoderError as error:
                raise ConfigError(f"--format mp4: {error}") from None


def _export(trace: Trace, road: RoadMap, form: str, path: Path, note: Note) -> None:
    from sumo_mcts.reporting import export

    note("writing")
    (export.write_csv if form == "csv" else export.write_fcd)(path, trace, road)


def explain(
    folder: Path,
    key: str,
    at: float | None,
    again: bool,
    overrides: Sequence[str],
    note: Note,
    *,
    allow_plugins: bool = False,
) -> dict[str, Any]:
    """Why the ego did what it did at a moment (simulation time, s).

    `again`: with the decision taken once more, with `overrides` of the scenario; code that the
    trace names runs only where `allow_plugins`. Raises ConfigError.
    """
    from sumo_mcts.driver.driver import PlannerError
    from sumo_mcts.numerics.announce import announced
    from sumo_mcts.reporting import explanation

    trace = trace_of(folder, key)
    cycle = _cycle_at(trace, at)
    row = {row["key"]: row for row in _rows(folder)}.get(key)
    why = explanation.explain(trace, _map_if_there(folder, trace), cycle, row)
    if not again:
        return why
    if not trace.setting.config:
        raise ConfigError(
            f"{folder}: --episode {key}: --replan: the trace does not hold the scenario it was "
            "recorded with"
        )
    road = map_of(folder, trace)
    try:
        with announced(note):
            return {
                **why,
                "replan": explanation.explain_again(
                    trace, road, cycle, overrides, allow_plugins=allow_plugins
                ),
            }
    except TraceError as error:
        raise ConfigError(f"{folder / TRACES / key}.npz: {error}") from None
    except PlannerError as error:
        raise ConfigError(
            f"{folder}: --episode {key}: --replan: the planner fails: {error}"
        ) from None


def _map_if_there(folder: Path, trace: Trace) -> RoadMap | None:
    return map_of(folder, trace) if (folder / MAPS / f"{trace.setting.map}.npz").is_file() else None


def explanation_text(explanation: dict[str, Any]) -> str:
    """An explanation for a person."""
    from sumo_mcts.reporting.explanation_words import text

    return text(explanation)


def _cycle_at(trace: Trace, at: float | None) -> int:
    """The number of the decision in force at a time, s.

    Raises ConfigError outside the episode, or without a time.
    """
    times = [cycle.time for cycle in trace.cycles]
    scenario = scenario_of(trace.setting)
    period = scenario["planner"]["period_s"] if scenario else 0.0
    if at is None or not times[0] - 1e-6 <= at <= times[-1] + period + 1e-6:
        given = "not given" if at is None else f"{at:g}"
        raise ConfigError(
            f"--at: {given}; {trace.key} was driven from {times[0]:g} s to {times[-1] + period:g} s"
        )
    return sum(time <= at + 1e-6 for time in times) - 1
