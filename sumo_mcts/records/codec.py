"""Named tuples of arrays to and from the columns of an .npz file.

Every field of a tuple, and of the tuples inside it, becomes one column over all cycles. The name of
a column is its path, as `trace/cycles/ego/x`. Beside it stand `#shape` of arrays, `#count` of
tuples and `#tag`, which member of a union a value is.
"""

import io
import math
import zipfile
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from types import UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from sumo_mcts import files
from sumo_mcts.records.coarse import from_steps, layout_of, narrowed, to_steps

SINGLE, FORMAT = 6, 7  # format 6 has the coarse columns in single precision
MOST_BYTES = 1 << 30  # of a trace or map, unpacked: five times what an hour in dense traffic takes
# Columns that traces of this format may lack: their fields then have their default.
ADDED = (
    "Follow/asks", "Follow/skips_stop", "Follow/shift", "memory/planner/waited_s", "memory/stop",
    "memory/held_up", "memory/held_up_at",
    "ego/asks", "ego/can_ask", "ego/reroutes", "ego/detour", "ego/stop", "stop/waits", "ego/held",
    "ego/sideways", "ego/standing_s", "cycles/changes", "answers/told", "roadmap/oncoming",
)  # fmt: skip
Columns = dict[str, NDArray[Any]]
_SCALARS: dict[type, type] = {float: np.float64, int: np.int64, bool: np.bool_, str: np.str_}


class TraceError(Exception):
    """A file that is not a whole trace of this format."""


def columns_of(kind: type, value: Any) -> Columns:
    """The columns of a value of this kind, a named tuple."""
    columns: Columns = {"format": np.array(FORMAT)}
    _encode(kind, [value], kind.__name__.lower(), columns)
    return columns


def value_of(kind: type, columns: Columns) -> Any:
    """The value of this kind from its columns: the inverse of columns_of.

    Raises ValueError where a column is missing or does not fit.
    """
    return _decode(kind, 1, kind.__name__.lower(), columns)[0]


def packed(columns: Columns) -> bytes:
    """The columns as the content of a compressed .npz file."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **columns)
    return buffer.getvalue()


def load_columns(path: Path, kind: type, what: str, problem_of: Callable[[Any], str]) -> Any:
    """The value of this kind in a file.

    `what` names the kind in messages; `problem_of` finds wrong numbers. Raises TraceError where the
    file is no such value, OSError where it cannot be read.
    """
    try:
        columns = _unpacked(path)
        if int(columns["format"]) not in (SINGLE, FORMAT):
            raise TraceError(
                f"{path}: written in {what} format {int(columns['format'])}, this version reads "
                f"{SINGLE} and {FORMAT}"
            )
        value = value_of(kind, columns)
        problem = problem_of(value)
    except (TraceError, OSError):
        raise
    # Damaged bytes may raise anything: zipfile and numpy alone raise a dozen kinds.
    except Exception as error:
        raise TraceError(f"{path}: not a whole {what}: {' '.join(str(error).split())}") from None
    if problem:
        raise TraceError(f"{path}: {problem}")
    return value


def without_alias(kind: Any) -> Any:
    """The type behind an alias of the `type` statement, such as NDArray from numpy 2.5 on; any
    other type as it is."""
    alias = get_origin(kind) or kind
    if not hasattr(alias, "__value__"):
        return kind
    return without_alias(alias.__value__[get_args(kind)] if get_args(kind) else alias.__value__)


# --- from the bytes of a file ---


def _unpacked(path: Path) -> Columns:
    """The columns in a file.

    The sizes that it names are checked before memory is taken for them.
    """
    with files.opened(path) as file, zipfile.ZipFile(file) as archive:
        members = archive.infolist()
        if sum(member.file_size for member in members) > MOST_BYTES:
            raise ValueError(f"unpacked it has more than {MOST_BYTES:,} bytes")
        return {
            member.filename.removesuffix(".npy"): _array(archive.read(member)) for member in members
        }


def _array(content: bytes) -> NDArray[Any]:
    """The array in the bytes of an .npy file."""
    file = io.BytesIO(content)
    version = np.lib.format.read_magic(file)
    read_header = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }[version]
    shape, _, dtype = read_header(file)
    if dtype.hasobject or math.prod(shape) * dtype.itemsize != len(content) - file.tell():
        raise ValueError(f"an array of {dtype} {shape} in {len(content) - file.tell()} bytes")
    return np.frombuffer(content, dtype, math.prod(shape), file.tell()).reshape(shape)


# --- values to columns and back ---


def _encode(kind: Any, values: Sequence[Any], path: str, columns: Columns) -> None:
    """Add the columns of `values`, all of the annotated type `kind`."""
    kind = without_alias(kind)
    origin, args = get_origin(kind), get_args(kind)
    if kind in _SCALARS:
        columns[path] = np.array(values, dtype=_SCALARS[kind])
    elif origin is np.ndarray:
        _encode(tuple[int, ...], [value.shape for value in values], path + "#shape", columns)
        layout, stored = layout_of(path), _element(kind)
        flat: list[NDArray[Any]] = [
            np.ravel(value).astype(stored) if layout is None else to_steps(value, layout)
            for value in values
        ]
        whole = np.concatenate(flat) if flat else np.zeros(0, dtype=stored)
        columns[path] = whole if layout is None else narrowed(whole.astype(np.int64))
    elif origin is tuple:
        columns[path + "#count"] = np.array([len(value) for value in values], dtype=np.int32)
        _encode(args[0], [item for value in values for item in value], path, columns)
    elif origin in (Union, UnionType):
        tags = [
            next(i for i, member in enumerate(args) if isinstance(value, member))
            for value in values
        ]
        columns[path + "#tag"] = np.array(tags, dtype=np.int8)
        for i, member in _members(args):
            _encode(
                member,
                [value for value, tag in zip(values, tags, strict=True) if tag == i],
                f"{path}/{member.__name__}",
                columns,
            )
    else:
        for field, annotation in get_type_hints(kind).items():
            _encode(
                annotation, [getattr(value, field) for value in values], f"{path}/{field}", columns
            )


def _decode(kind: Any, count: int, path: str, columns: Columns) -> Sequence[Any]:
    """`count` values of the annotated type `kind` from their columns; the mirror of _encode."""
    kind = without_alias(kind)
    origin, args = get_origin(kind), get_args(kind)
    if kind in _SCALARS:
        return _exactly(_column(columns, path, _SCALARS[kind]).tolist(), count, path)
    if origin is np.ndarray:
        shapes = _decode(tuple[int, ...], count, path + "#shape", columns)
        layout, stored = layout_of(path), _element(kind)
        if layout is not None and int(columns["format"]) == SINGLE:
            layout, stored = None, np.float32
        elif layout is not None:
            there = columns.get(path)
            stored = np.int32 if there is not None and there.dtype == np.int32 else np.int64
        whole: NDArray[Any] = _column(columns, path, stored)
        parts = _split(whole, [math.prod(_lengths(shape, path)) for shape in shapes], path)
        return [
            part.astype(_element(kind)).reshape(shape)
            if layout is None
            else from_steps(part, shape, layout)
            for part, shape in zip(parts, shapes, strict=True)
        ]
    if origin is tuple:
        lengths = _exactly(
            _lengths(_column(columns, path + "#count", np.int32).tolist(), path), count, path
        )
        return [
            tuple(part)
            for part in _split(_decode(args[0], sum(lengths), path, columns), lengths, path)
        ]
    if origin in (Union, UnionType):
        tags = _exactly(_column(columns, path + "#tag", np.int8).tolist(), count, path)
        values = {
            i: iter(_decode(member, tags.count(i), f"{path}/{member.__name__}", columns))
            for i, member in _members(args)
        }
        return [
            None if args[tag] is type(None) else next(values[tag]) for tag in _lengths(tags, path)
        ]
    fields = [
        [kind._field_defaults[field]] * count
        if f"{path}/{field}".endswith(ADDED) and not _is_there(f"{path}/{field}", columns)
        else _decode(annotation, count, f"{path}/{field}", columns)
        for field, annotation in get_type_hints(kind).items()
    ]
    return (
        [kind(*value) for value in zip(*fields, strict=True)]
        if fields
        else [kind() for _ in range(count)]
    )


def _is_there(path: str, columns: Columns) -> bool:
    """Whether there is a column for a field, or for a part of it."""
    return any(name == path or name.startswith(f"{path}/") for name in columns)


def _members(args: tuple[Any, ...]) -> Iterator[tuple[int, Any]]:
    """The members of a union with something to store, with their tags."""
    return ((i, member) for i, member in enumerate(args) if member is not type(None))


def _element(kind: Any) -> type:
    """The element type of an annotated array."""
    element: type = get_args(get_args(kind)[1])[0]
    return element


def _column(columns: Columns, path: str, kind: type) -> NDArray[Any]:
    """The column of this name, if it is a row of values of this kind."""
    column = columns.get(path)
    if column is None:
        raise ValueError(f"{path} is missing")
    wanted, there = np.dtype(kind), column.dtype.newbyteorder("=")
    if column.ndim != 1 or (there.kind if wanted.kind == "U" else there) != (
        wanted.kind if wanted.kind == "U" else wanted
    ):
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
