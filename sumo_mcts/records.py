"""What an episode leaves behind: rows (JSON Lines, CSV), a manifest, and a trace of every cycle (npz, no pickle)."""

import csv
import functools
import hashlib
import io
import json
import math
import os
import platform
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import metadata
from itertools import pairwise
from pathlib import Path
from types import UnionType
from typing import Any, NamedTuple, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.scene import Agents, Answers, Bools, Decision, EgoState, Floats, Forecast, Ints, Memory, RoadMap, Signals

SCHEMA_VERSION = 1

MANIFEST, ROWS, TABLE = "manifest.json", "episodes.jsonl", "episodes.csv"
TRACES, MAPS = "traces", "maps"

# The row, in the order of docs/measures.md.
ROW_KEYS = (
    "key", "scenario", "variant", "planner", "prediction", "ego", "seed", "outcome", "error", "at_fault", "inevitable", "collisions",
    "travel_time_s", "free_flow_s", "in_time", "distance_m", "stopped_s", "max_decel_mps2", "hard_brakes", "rms_jerk_mps3", "comfortable_share",
    "speeding_share", "lane_changes", "decision_flips", "red_lights_run", "yellow_run", "imposed_max_decel_mps2", "imposed_brakes_2",
    "imposed_brakes_3", "imposed_brakes_4", "min_ttc_s", "min_pet_s", "max_drac_mps2", "failsafe_interventions", "iterations_per_decision",
    "iterations", "cycles", "deadline_s", "deadline_misses", "plan_ms_p50", "plan_ms_p95", "plan_ms_p99", "plan_ms_max", "wall_s",
    "realtime_factor", "trace_digest", "config_digest",
)  # fmt: skip

WHOLE = ("key", "scenario", "variant", "outcome")  # texts without which a line is no row

Row = dict[str, Any]


class TraceError(Exception):
    """A file that is not a whole trace of this format."""


class CycleRecord(NamedTuple):
    """One decision: what was known, what was expected, what was decided, and what came of it."""

    time: float  # simulation time, s
    step: float  # simulation step, s
    ego: EgoState
    agents: Agents
    signals: Signals
    forecast: Forecast
    decision: Decision
    plan_ms: float  # wall time from scene to decision, ms
    commanded_speed: float  # at the end of this period, m/s; nan: none
    executed_speed: float  # the state one decision period later, m/s; nan for the last cycle
    commanded_lane: int  # global lane index at the end of this period; -1: none
    executed_lane: int  # -1 for the last cycle
    deviation: str  # why the executed state differs from the commanded one; "" it does not
    intervened: bool = False  # the fail-safe manoeuvre in place of what the planner decided; why: decision.reason
    memory: Memory = Memory()  # of earlier decisions, beside the last one
    answers: Answers = Answers()  # of oracles


class Lanes(NamedTuple):
    """The roads of one episode, for drawing. L lanes, P shape points, S stop lines."""

    lane_ids: tuple[str, ...]
    points: Floats  # [P, 2] m
    offset: Ints  # [L+1] lane i owns points offset[i]:offset[i+1]
    width: Floats  # [L] m
    internal: Bools  # [L] inside a junction
    route: Bools  # [L] on the ego's route
    stop_lines: Floats  # [S, 4] x and y of both ends, m


class Setting(NamedTuple):
    """What all decisions of an episode rest on."""

    config: str = ""  # the resolved scenario, JSON; "": unknown
    seed: int = 0  # of the search
    step: float = math.nan  # of the simulation, s
    ballistic: bool = False  # how the simulation integrates
    change_duration: float = math.nan  # of a lane change, s
    map: str = ""  # maps/MAP.npz holds the roads, by the indices of which lanes are named


class Trace(NamedTuple):
    """One episode of one ego, cycle by cycle."""

    key: str
    scenario: str
    outcome: str
    lanes: Lanes
    cycles: tuple[CycleRecord, ...]
    setting: Setting = Setting()


# --- rows and manifest ---


def row_defaults() -> Row:
    """A row with every key, all unknown."""
    return dict.fromkeys(ROW_KEYS)


def episode_key(scenario: str, variant: str, seed: int | None, ego: str | None = None) -> str:
    """scenario--variant--seed[--ego], safe as a file name; different episodes have different keys. Without a seed it is SUMO's own."""
    parts = [scenario, variant, "own" if seed is None else str(seed), *([] if ego is None else [ego])]
    return "--".join(_safe(part) for part in parts)


def append_row(folder: Path, row: Mapping[str, Any]) -> None:
    """Add a row to episodes.jsonl; on disk when this returns. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    line = json_text({**row_defaults(), **row}, indent=None) + "\n"
    with (folder / ROWS).open("a+b") as file:
        # A killed process may have left half a line: it must not swallow this one.
        if file.tell() and _last_byte(file) != b"\n":
            line = "\n" + line
        file.write(line.encode())
        file.flush()
        os.fsync(file.fileno())


def read_rows(folder: Path) -> list[Row]:
    """The rows of episodes.jsonl, without lines that are no whole row, as a killed process leaves one; none where there is no file."""
    return rows_and_torn(folder)[0]


def rows_and_torn(folder: Path) -> tuple[list[Row], int]:
    """The same, and how many lines are left out."""
    parsed = [_parsed(line) for line in _lines(folder)]
    rows = [row for row in parsed if row is not None]
    return rows, len(parsed) - len(rows)


def write_csv(folder: Path) -> None:
    """episodes.csv from episodes.jsonl: unknown is an empty cell. Raises OSError."""
    rows = read_rows(folder)
    further = dict.fromkeys(key for row in rows for key in row if key not in ROW_KEYS)
    write_table(folder / TABLE, (*ROW_KEYS, *further), rows)


def write_table(path: Path, columns: Sequence[str], rows: Sequence[Row]) -> None:
    """Rows as CSV: unknown is an empty cell. Raises OSError."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: _cell(value) for key, value in row.items()} for row in rows)
    write_whole(path, text.getvalue().encode(errors="backslashreplace"))


def write_manifest(folder: Path, manifest: Mapping[str, Any]) -> None:
    """manifest.json. Raises OSError."""
    write_whole(folder / MANIFEST, (json_text({"schema_version": SCHEMA_VERSION, **manifest}) + "\n").encode())


def read_manifest(folder: Path) -> dict[str, Any] | None:
    """manifest.json; None where it is damaged. Raises OSError where there is none, or it cannot be read."""
    try:
        found = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def versions() -> dict[str, str | None]:
    """What this ran on; null where a package is not installed."""
    packages = {"sumo_mcts": "sumo-mcts", "sumo": "libsumo", "numpy": "numpy", "numba": "numba"}
    numbers = {name: _version(package) for name, package in packages.items()}
    return {**numbers, "sources": sources(), "python": platform.python_version(), "platform": platform.platform()}


@functools.cache
def sources() -> str:
    """A digest of the package's code: a version number outlives many changes."""
    folder = Path(__file__).resolve().parent
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(folder.rglob("*.py")))).hexdigest()[:16]


def json_text(value: Any, indent: int | None = 2) -> str:
    """JSON without NaN and Infinity: they become null. Takes numpy values, paths and tuples."""
    return json.dumps(_plain(value), indent=indent, allow_nan=False)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file wholly or not at all, and for good; creates the folder. Raises OSError."""
    with written_whole(path) as unfinished:
        unfinished.write_bytes(content)


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Names a file to write, which in the end takes the place of `path`, unless something was raised; creates the folder. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
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


def _safe(part: str) -> str:
    """The text itself where it can stand in a file name; otherwise a readable form with a hash that keeps it unique."""
    if len(part) <= 60 and re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.]*(-[A-Za-z0-9_.]+)*", part):
        return part
    readable = re.sub(r"[^A-Za-z0-9_]+", "_", part)[:40] or "_"
    return f"{readable}-{hashlib.sha256(part.encode(errors='backslashreplace')).hexdigest()[:8]}"


def _last_byte(file: io.BufferedRandom) -> bytes:
    file.seek(-1, os.SEEK_END)
    return file.read(1)


def _lines(folder: Path) -> list[str]:
    """The lines of episodes.jsonl that are not empty."""
    path = folder / ROWS
    if not path.exists():
        return []
    return [line for line in path.read_text(encoding="utf-8", errors="replace").split("\n") if line.strip()]


def _parsed(line: str) -> Row | None:
    """The row that a line holds; None where it is no whole one."""
    try:
        row = json.loads(line)
    except (ValueError, RecursionError):  # numbers of too many digits, and brackets without end, too
        return None
    return row if isinstance(row, dict) and all(isinstance(row.get(key), str) and row[key] for key in WHOLE) else None


def _cell(value: Any) -> Any:
    if value is None:
        return ""
    return json.dumps(value) if isinstance(value, bool | list | dict) else value


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


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


# --- traces and maps: every field of the tuples becomes a column over all cycles ---

_FORMAT = 5
Columns = dict[str, NDArray[Any]]

_SCALARS: dict[type, type] = {float: np.float64, int: np.int64, bool: np.bool_, str: np.str_}
# Large columns that are drawn and not computed with: single precision (0.5 mm at 5 km).
_COARSE = ("forecast/pose", "forecast/v", "forecast/s", "Plan/pose", "children/poses")


def save_trace(path: Path, trace: Trace) -> None:
    """Write a trace as one compressed npz. Raises OSError."""
    write_whole(path, trace_bytes(trace))


def trace_bytes(trace: Trace) -> bytes:
    """A trace as it stands in its file."""
    return _packed(_columns(Trace, trace))


def load_trace(path: Path) -> Trace:
    """Read a trace. Raises TraceError where the file is broken or of another format, OSError where it cannot be read."""
    trace: Trace = _load(path, Trace, "trace")
    return trace


def scenario_of(setting: Setting) -> dict[str, Any]:
    """The resolved scenario of an episode; empty: unknown. Raises TraceError where the text is none."""
    if not setting.config:
        return {}
    try:
        scenario: dict[str, Any] = json.loads(setting.config)
        names = scenario["planner"]["name"], scenario["prediction"]["name"]
        resolved = all(isinstance(name, str) for name in names) and scenario["planner"]["period_s"] > 0.0
    except (ValueError, RecursionError, TypeError, KeyError):
        resolved = False
    if not resolved:
        raise TraceError("the scenario in it is not a resolved one")
    return scenario


def same(kind: type, one: Any, other: Any) -> bool:
    """Whether two values of this kind leave the same record, to the last bit that is kept."""
    before, after = _columns(kind, one), _columns(kind, other)
    return before.keys() == after.keys() and all(column.tobytes() == after[name].tobytes() for name, column in before.items())


def map_name(road: RoadMap) -> str:
    """What the file of a network is called in maps/: a digest of its roads, whatever file they come from."""
    content = hashlib.sha256()
    for name, column in _columns(RoadMap, road).items():
        content.update(name.encode())
        content.update(np.ascontiguousarray(column).tobytes())
    return content.hexdigest()[:16]


def save_map(folder: Path, road: RoadMap) -> Path:
    """Write the roads that traces refer to into the maps/ of a folder, once a network. Raises OSError."""
    path = folder / MAPS / f"{map_name(road)}.npz"
    if not path.exists():
        write_whole(path, map_bytes(road))
    return path


def map_bytes(road: RoadMap) -> bytes:
    """Roads as they stand in their file."""
    return _packed(_columns(RoadMap, road))


def load_map(folder: Path, name: str) -> RoadMap:
    """Read roads from the maps/ of a folder. Raises TraceError where the file is broken, OSError where it cannot be read."""
    road: RoadMap = _load(folder / MAPS / f"{name}.npz", RoadMap, "map")
    return road


def _columns(kind: type, value: Any) -> Columns:
    columns: Columns = {"format": np.array(_FORMAT)}
    _encode(kind, [value], kind.__name__.lower(), columns)
    return columns


def _packed(columns: Columns) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **columns)
    return buffer.getvalue()


def _load(path: Path, kind: type, what: str) -> Any:
    """The value of this kind in a file; `what` it is in messages."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            columns = {name: archive[name] for name in archive.files}
        if int(columns["format"]) != _FORMAT:
            raise TraceError(f"{path}: written in {what} format {int(columns['format'])}, this version reads {_FORMAT}")
        return _decode(kind, 1, kind.__name__.lower(), columns)[0]
    except (TraceError, OSError):
        raise
    except Exception as error:  # whatever unpacking damaged bytes may do: zipfile and numpy alone raise a dozen kinds
        raise TraceError(f"{path}: not a whole {what}: {' '.join(str(error).split())}") from None


def _encode(kind: Any, values: Sequence[Any], path: str, columns: Columns) -> None:
    """Add the columns of `values`, all of the annotated type `kind`."""
    origin, args = get_origin(kind), get_args(kind)
    if kind in _SCALARS:
        columns[path] = np.array(values, dtype=_SCALARS[kind])
    elif origin is np.ndarray:
        _encode(tuple[int, ...], [value.shape for value in values], path + "#shape", columns)
        flat: list[NDArray[Any]] = [np.ravel(value).astype(_stored(kind, path)) for value in values]
        columns[path] = np.concatenate(flat) if flat else np.zeros(0, dtype=_stored(kind, path))
    elif origin is tuple:
        columns[path + "#count"] = np.array([len(value) for value in values], dtype=np.int32)
        _encode(args[0], [item for value in values for item in value], path, columns)
    elif origin in (Union, UnionType):
        tags = [next(i for i, member in enumerate(args) if isinstance(value, member)) for value in values]
        columns[path + "#tag"] = np.array(tags, dtype=np.int8)
        for i, member in _members(args):
            _encode(member, [value for value, tag in zip(values, tags, strict=True) if tag == i], f"{path}/{member.__name__}", columns)
    else:
        for field, annotation in get_type_hints(kind).items():
            _encode(annotation, [getattr(value, field) for value in values], f"{path}/{field}", columns)


def _decode(kind: Any, count: int, path: str, columns: Columns) -> list[Any]:
    """`count` values of the annotated type `kind` from their columns; the mirror of _encode."""
    origin, args = get_origin(kind), get_args(kind)
    if kind in _SCALARS:
        return _exactly(columns[path].tolist(), count, path)
    if origin is np.ndarray:
        shapes = _decode(tuple[int, ...], count, path + "#shape", columns)
        whole: NDArray[Any] = columns[path].astype(_element(kind))
        return [part.reshape(shape) for part, shape in zip(_split(whole, [math.prod(shape) for shape in shapes], path), shapes, strict=True)]
    if origin is tuple:
        lengths = _exactly(columns[path + "#count"].tolist(), count, path)
        return [tuple(part) for part in _split(_decode(args[0], sum(lengths), path, columns), lengths, path)]
    if origin in (Union, UnionType):
        tags = _exactly(columns[path + "#tag"].tolist(), count, path)
        values = {i: iter(_decode(member, tags.count(i), f"{path}/{member.__name__}", columns)) for i, member in _members(args)}
        return [next(values[tag]) if tag in values else None for tag in tags]
    fields = [_decode(annotation, count, f"{path}/{field}", columns) for field, annotation in get_type_hints(kind).items()]
    return [kind(*value) for value in zip(*fields, strict=True)] if fields else [kind() for _ in range(count)]


def _members(args: tuple[Any, ...]) -> Iterator[tuple[int, Any]]:
    """The members of a union with something to store, with their tags."""
    return ((i, member) for i, member in enumerate(args) if member is not type(None))


def _element(kind: Any) -> type:
    """The element type of an annotated array."""
    element: type = get_args(get_args(kind)[1])[0]
    return element


def _stored(kind: Any, path: str) -> type:
    return np.float32 if path.endswith(_COARSE) else _element(kind)


def _exactly(values: list[Any], count: int, path: str) -> list[Any]:
    if len(values) != count:
        raise ValueError(f"{path} has {len(values)} entries, not {count}")
    return values


def _split(flat: Any, lengths: Sequence[int], path: str) -> list[Any]:
    """Cut a list or an array into parts of these lengths."""
    bounds = np.cumsum([0, *lengths]).tolist()
    if bounds[-1] != len(flat):
        raise ValueError(f"{path} has {len(flat)} entries, not {bounds[-1]}")
    return [flat[begin:end] for begin, end in pairwise(bounds)]
