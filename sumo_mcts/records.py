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
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import metadata
from itertools import pairwise
from pathlib import Path
from types import UnionType
from typing import IO, Any, NamedTuple, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from sumo_mcts import files, records_check
from sumo_mcts.scene import Agents, Answers, Bools, Decision, EgoState, Floats, Forecast, Ints, Memory, RoadMap, Signals

SCHEMA_VERSION = 1

MANIFEST, ROWS, TABLE = "manifest.json", "episodes.jsonl", "episodes.csv"
TRACES, MAPS, MANIFESTS, FIGURES = "traces", "maps", "manifests", "figures"
LONGEST_LINE = 1 << 20  # bytes; a longer line is no row
LARGEST_MANIFEST = 1 << 26  # bytes

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
    line = _line(row)
    with files.naming(folder / ROWS):
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / ROWS).open("a+b", buffering=0) as file:
            # A killed process may have left half a line: it must not swallow this one.
            if file.tell() and _last_byte(file) != b"\n":
                line = b"\n" + line
            _append_whole(file, line)


def put_row(folder: Path, row: Mapping[str, Any]) -> bool:
    """Add a row to episodes.jsonl, or put it in the place of those with the same key, and whether it did that; on disk when this returns, and all other lines
    as they were. Raises OSError."""
    if all(known["key"] != row["key"] for known in read_rows(folder)):
        append_row(folder, row)
        return False
    line = _line(row)
    with files.opened(folder / ROWS) as file, written_whole(folder / ROWS) as unfinished, unfinished.open("wb") as copy:
        for part, whole in _parts(file):
            known = _parsed(part) if whole else None
            if known is None or known["key"] != row["key"]:
                copy.write(part)
            else:
                copy.write(line)
                line = b""  # once
    return True


def read_rows(folder: Path) -> list[Row]:
    """The rows of episodes.jsonl, without lines that are no whole row, as a killed process leaves one; none where there is no file. Raises OSError."""
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
                elif part.strip() and not (long and not whole):  # of a line that is too long the first part counts
                    torn += 1
                long = not whole
    except FileNotFoundError:
        pass
    return rows, torn


def write_csv(folder: Path) -> None:
    """episodes.csv from episodes.jsonl: a row a key, the last one; unknown is an empty cell. Raises OSError."""
    rows = list({row["key"]: row for row in read_rows(folder)}.values())
    further = dict.fromkeys(key for row in rows for key in row if key not in ROW_KEYS)
    write_table(folder / TABLE, (*ROW_KEYS, *further), rows)


def write_table(path: Path, columns: Sequence[str], rows: Sequence[Row]) -> None:
    """Rows as CSV: unknown is an empty cell, and no text begins as a formula does. Raises OSError."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writerow({column: _cell(column) for column in columns})
    writer.writerows({key: _cell(value) for key, value in row.items()} for row in rows)
    write_whole(path, text.getvalue().encode(errors="backslashreplace"))


def write_manifest(folder: Path, manifest: Mapping[str, Any]) -> None:
    """manifest.json. Raises OSError."""
    write_whole(folder / MANIFEST, (json_text({"schema_version": SCHEMA_VERSION, **manifest}) + "\n").encode())


def read_manifest(folder: Path) -> dict[str, Any] | None:
    """manifest.json; None where it is damaged. Raises OSError where there is none, or it cannot be read."""
    return _read_json(folder / MANIFEST)


def write_manifest_of(folder: Path, key: str, manifest: Mapping[str, Any]) -> None:
    """manifests/KEY.json: what one episode was run with. Raises OSError."""
    write_whole(folder / MANIFESTS / f"{key}.json", (json_text({"schema_version": SCHEMA_VERSION, **manifest}) + "\n").encode())


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
    """Names a file to write, which in the end takes the place of `path`, unless something was raised; creates the folder. Raises OSError that names `path`."""
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


def _safe(part: str) -> str:
    """The text itself where it can stand in a file name; otherwise a readable form with a hash that keeps it unique."""
    if len(part) <= 60 and re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.]*(-[A-Za-z0-9_.]+)*", part):
        return part
    readable = re.sub(r"[^A-Za-z0-9_]+", "_", part)[:40] or "_"
    return f"{readable}-{hashlib.sha256(part.encode(errors='backslashreplace')).hexdigest()[:8]}"


def _line(row: Mapping[str, Any]) -> bytes:
    """A row as a line of episodes.jsonl."""
    return (json_text({**row_defaults(), **row}, indent=None) + "\n").encode()


def _append_whole(file: io.FileIO, content: bytes) -> None:
    """Add to the end of a file without a buffer, for good and wholly, or leave it as it was: a full disk may take half of it."""
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


def _read_json(path: Path) -> dict[str, Any] | None:
    """The mapping in a file; None where it holds none. Raises OSError where it cannot be read."""
    with files.opened(path) as file:
        content = file.read(LARGEST_MANIFEST + 1)
    try:
        found = json.loads(content) if len(content) <= LARGEST_MANIFEST else None
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def _parts(file: IO[bytes]) -> Iterator[tuple[bytes, bool]]:
    """The lines of a file, each with whether it is a whole one: a line longer than LONGEST_LINE comes in parts."""
    whole = True
    while part := file.readline(LONGEST_LINE):
        ends = len(part) < LONGEST_LINE or part.endswith(b"\n")
        yield part, whole and ends
        whole = ends


def _parsed(line: bytes) -> Row | None:
    """The row that a line holds; None where it is no whole one."""
    try:
        row = json.loads(line.decode(errors="replace"))
    except (ValueError, RecursionError):  # numbers of too many digits, and brackets without end, too
        return None
    return row if isinstance(row, dict) and all(isinstance(row.get(key), str) and row[key] for key in WHOLE) else None


def _cell(value: Any) -> Any:
    """What stands in a table: nothing where unknown, and an apostrophe before a text that spreadsheets would take for a formula."""
    if value is None:
        return ""
    if isinstance(value, str):
        text = value.replace("\r", "\n")  # which is put into quotes; a carriage return is not, and would end the line
        return f"'{text}" if text.startswith(("=", "+", "-", "@", "\t", "\n")) else text
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
MOST_BYTES = 1 << 30  # of a trace or map, unpacked: five times what an hour in dense traffic takes
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
    """Read a trace. Raises TraceError where the file is broken, of another format or holds numbers that make no sense, OSError where it cannot be read."""
    trace: Trace = _load(path, Trace, "trace", records_check.trace_problem)
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
    """Write the roads that traces refer to into the maps/ of a folder, once a network, and again where they are damaged there. Raises OSError."""
    name = map_name(road)
    try:
        whole = map_name(load_map(folder, name)) == name
    except (TraceError, OSError):
        whole = False
    path = folder / MAPS / f"{name}.npz"
    if not whole:
        write_whole(path, map_bytes(road))
    return path


def map_bytes(road: RoadMap) -> bytes:
    """Roads as they stand in their file."""
    return _packed(_columns(RoadMap, road))


def load_map(folder: Path, name: str) -> RoadMap:
    """Read roads from the maps/ of a folder. Raises TraceError where the file is broken or holds numbers that make no sense, OSError where it cannot be
    read."""
    road: RoadMap = _load(folder / MAPS / f"{name}.npz", RoadMap, "map", records_check.map_problem)
    return road


def require_fit(trace: Trace, road: RoadMap, numbers: Iterable[int] | None = None) -> None:
    """Raise TraceError where decisions of a trace (default: all) hold numbers that make no sense, or lanes, edges or signals that the map does not have."""
    problem = records_check.fit_problem(trace, road, range(len(trace.cycles)) if numbers is None else numbers)
    if problem:
        raise TraceError(f"{problem}; its map is {MAPS}/{trace.setting.map}.npz")


def _columns(kind: type, value: Any) -> Columns:
    columns: Columns = {"format": np.array(_FORMAT)}
    _encode(kind, [value], kind.__name__.lower(), columns)
    return columns


def _packed(columns: Columns) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **columns)
    return buffer.getvalue()


def _load(path: Path, kind: type, what: str, problem_of: Callable[[Any], str]) -> Any:
    """The value of this kind in a file; `what` it is in messages, `problem_of` says what is wrong with its numbers."""
    try:
        columns = _unpacked(path)
        if int(columns["format"]) != _FORMAT:
            raise TraceError(f"{path}: written in {what} format {int(columns['format'])}, this version reads {_FORMAT}")
        value = _decode(kind, 1, kind.__name__.lower(), columns)[0]
        problem = problem_of(value)
    except (TraceError, OSError):
        raise
    except Exception as error:  # whatever unpacking damaged bytes may do: zipfile and numpy alone raise a dozen kinds
        raise TraceError(f"{path}: not a whole {what}: {' '.join(str(error).split())}") from None
    if problem:
        raise TraceError(f"{path}: {problem}")
    return value


def _unpacked(path: Path) -> Columns:
    """The columns of a file. What it says of its sizes is looked at before room is made for them."""
    with files.opened(path) as file, zipfile.ZipFile(file) as archive:
        members = archive.infolist()
        if sum(member.file_size for member in members) > MOST_BYTES:
            raise ValueError(f"unpacked it has more than {MOST_BYTES:,} bytes")
        return {member.filename.removesuffix(".npy"): _array(archive.read(member)) for member in members}


def _array(content: bytes) -> NDArray[Any]:
    """The array in the bytes of an .npy file."""
    file = io.BytesIO(content)
    version = np.lib.format.read_magic(file)
    read_header = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}[version]
    shape, _, dtype = read_header(file)
    if dtype.hasobject or math.prod(shape) * dtype.itemsize != len(content) - file.tell():
        raise ValueError(f"an array of {dtype} {shape} in {len(content) - file.tell()} bytes")
    return np.frombuffer(content, dtype, math.prod(shape), file.tell()).reshape(shape)


def _encode(kind: Any, values: Sequence[Any], path: str, columns: Columns) -> None:
    """Add the columns of `values`, all of the annotated type `kind`."""
    kind = _without_alias(kind)
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


def _decode(kind: Any, count: int, path: str, columns: Columns) -> Sequence[Any]:
    """`count` values of the annotated type `kind` from their columns; the mirror of _encode."""
    kind = _without_alias(kind)
    origin, args = get_origin(kind), get_args(kind)
    if kind in _SCALARS:
        return _exactly(_column(columns, path, _SCALARS[kind]).tolist(), count, path)
    if origin is np.ndarray:
        shapes = _decode(tuple[int, ...], count, path + "#shape", columns)
        whole: NDArray[Any] = _column(columns, path, _stored(kind, path)).astype(_element(kind))
        return [part.reshape(shape) for part, shape in zip(_split(whole, [math.prod(_lengths(shape, path)) for shape in shapes], path), shapes, strict=True)]
    if origin is tuple:
        lengths = _exactly(_lengths(_column(columns, path + "#count", np.int32).tolist(), path), count, path)
        return [tuple(part) for part in _split(_decode(args[0], sum(lengths), path, columns), lengths, path)]
    if origin in (Union, UnionType):
        tags = _exactly(_column(columns, path + "#tag", np.int8).tolist(), count, path)
        values = {i: iter(_decode(member, tags.count(i), f"{path}/{member.__name__}", columns)) for i, member in _members(args)}
        return [None if args[tag] is type(None) else next(values[tag]) for tag in _lengths(tags, path)]
    fields = [_decode(annotation, count, f"{path}/{field}", columns) for field, annotation in get_type_hints(kind).items()]
    return [kind(*value) for value in zip(*fields, strict=True)] if fields else [kind() for _ in range(count)]


def _without_alias(kind: Any) -> Any:
    """The type that an alias of the `type` statement stands for, as NDArray is one from numpy 2.5 on; any other type as it is."""
    alias = get_origin(kind) or kind
    if not hasattr(alias, "__value__"):
        return kind
    return _without_alias(alias.__value__[get_args(kind)] if get_args(kind) else alias.__value__)


def _members(args: tuple[Any, ...]) -> Iterator[tuple[int, Any]]:
    """The members of a union with something to store, with their tags."""
    return ((i, member) for i, member in enumerate(args) if member is not type(None))


def _element(kind: Any) -> type:
    """The element type of an annotated array."""
    element: type = get_args(get_args(kind)[1])[0]
    return element


def _stored(kind: Any, path: str) -> type:
    return np.float32 if path.endswith(_COARSE) else _element(kind)


def _column(columns: Columns, path: str, kind: type) -> NDArray[Any]:
    """The column of this name, if it is a row of values of this kind."""
    column = columns.get(path)
    if column is None:
        raise ValueError(f"{path} is missing")
    wanted, there = np.dtype(kind), column.dtype.newbyteorder("=")
    if column.ndim != 1 or (there.kind if wanted.kind == "U" else there) != (wanted.kind if wanted.kind == "U" else wanted):
        raise ValueError(f"{path} is {column.dtype} {column.shape}, not a row of {wanted.name}")
    return column


def _lengths(values: Sequence[int], path: str) -> Sequence[int]:
    """The values, if they can be counts."""
    if min(values, default=0) < 0:
        raise ValueError(f"{path} has {min(values)} entries")
    return values


def _exactly(values: Sequence[Any], count: int, path: str) -> Sequence[Any]:
    if len(values) != count:
        raise ValueError(f"{path} has {len(values)} entries, not {count}")
    return values


def _split(flat: Any, lengths: Sequence[int], path: str) -> list[Any]:
    """Cut a list or an array into parts of these lengths."""
    bounds = np.cumsum([0, *lengths]).tolist()
    if bounds[-1] != len(flat):
        raise ValueError(f"{path} has {len(flat)} entries, not {bounds[-1]}")
    return [flat[begin:end] for begin, end in pairwise(bounds)]
