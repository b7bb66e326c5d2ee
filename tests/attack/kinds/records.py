"""Damaged output folders: traces, maps, rows, manifests."""

import functools
import io
import itertools
import json
import random
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..case import ANY, DRIVING_S, Case
from ..good import recorded, recorded_file

_SEED = 24
Columns = dict[str, NDArray[Any]]

REPLAN = ("explain", "one", "--at", "1", "--replan", "--json")
READERS: tuple[tuple[str, ...], ...] = (
    REPLAN,
    ("report", "one", "--json"),
    ("explain", "one", "--at", "1", "--json"),
    ("render", "one", "--out", "x.png"),
    ("export", "one", "--format", "fcd", "--out", "x.xml"),
    ("export", "one", "--out", "x.csv"),
)


def archive_cases() -> Iterator[Case]:
    """Traces and maps: bytes that are turned or cut off, members that are replaced, numbers out of
    range."""
    for what in ("traces", "maps"):
        name = recorded_file(f"one/{what}/*.npz")
        readers = itertools.cycle(
            READERS if what == "traces" else (REPLAN, READERS[4], READERS[5], READERS[1])
        )
        for damage, content in _bytes(recorded()[name]):
            yield _read(f"{what}: {damage}", name, content, next(readers))
        for column in _columns(name):
            for damage, content in _values(name, column):
                words = REPLAN if what == "maps" else next(readers)
                yield _read(f"{what}: {column} {damage}, {words[0]}", name, content, words)


def _read(name: str, damaged: str, content: bytes, words: tuple[str, ...]) -> Case:
    return Case(
        "archive",
        name,
        words,
        {damaged: content},
        recorded=True,
        allowed=ANY,
        naming=("one",),
        patience_s=DRIVING_S,
    )


def _bytes(content: bytes) -> Iterator[tuple[str, bytes]]:
    """Damages that any file may have."""
    chance = random.Random(_SEED)
    yield "nothing", b""
    yield "zero bytes", b"\0" * len(content)
    yield "no archive", b"tank" * 100
    for share in (5, 30, 60, 95, 99):
        yield f"cut off at {share} %", content[: len(content) * share // 100]
    yield "twice", content + content
    for number in range(24):
        turned = bytearray(content)
        for _ in range(1 + number % 3 * 10):
            turned[chance.randrange(len(turned))] ^= 1 << chance.randrange(8)
        yield f"bits turned, {number}", bytes(turned)
    yield "a column alone", _npy(np.arange(3))
    yield "an empty archive", _packed({})
    yield "a format of the future", _packed({"format": np.array(99)})
    yield "a format that is a text", _packed({"format": np.array("tank")})
    yield "a bomb", _packed({"format": np.array(5), "x": np.zeros(400_000_000, dtype=np.uint8)})


@functools.cache
def _whole(name: str) -> Columns:
    with np.load(io.BytesIO(recorded()[name])) as archive:
        return {column: archive[column] for column in archive.files}


def _columns(name: str) -> list[str]:
    """Columns that hold something."""
    return [column for column, values in _whole(name).items() if values.size and column != "format"]


def _values(name: str, column: str) -> Iterator[tuple[str, bytes]]:
    """A column with values that make no sense: for a map all of them, for a trace one, another for
    each column."""
    whole = _whole(name)
    values = whole[column]
    changes = [(label, change) for label, change in _CHANGES if _fits(values, label)]
    number = list(whole).index(column)
    for label, change in (
        changes if "/maps/" in name and "#" not in column else changes[number % len(changes) :][:1]
    ):
        changed = change(values)
        yield (
            label,
            _packed(
                {key: old for key, old in whole.items() if key != column}
                if changed is None
                else {**whole, column: changed}
            ),
        )


def _filled(value: float) -> Callable[[NDArray[Any]], NDArray[Any]]:
    return lambda old: np.full_like(old, _within(old, value))


def _one(value: float) -> Callable[[NDArray[Any]], NDArray[Any]]:
    def change(old: NDArray[Any]) -> NDArray[Any]:
        new = old.copy()
        new.flat[old.size // 2] = _within(old, value)
        return new

    return change


def _within(values: NDArray[Any], value: float) -> float:
    """The value, or the largest that a column of whole numbers can hold."""
    return min(value, int(np.iinfo(values.dtype).max)) if values.dtype.kind == "i" else value


_CHANGES: list[tuple[str, Callable[[NDArray[Any]], NDArray[Any] | None]]] = [
    ("of nan", _filled(np.nan)), ("with an inf", _one(np.inf)), ("with a nan", _one(np.nan)),
    ("of 1e300", _filled(1e300)), ("of -1e9", _filled(-1e9)), ("of 0.0", _filled(0.0)),
    ("of whole -1", _filled(-1)), ("of whole 2**31-1", _filled(2**31 - 1)),
    ("with a whole 99999", _one(99_999)), ("with a whole -7", _one(-7)),
    ("of whole 0", _filled(0)),
    ("turned round", lambda old: old[::-1].copy()), ("without its last", lambda old: old[:-1]),
    ("twice as long", lambda old: np.concatenate([old, old])), ("missing", lambda _: None),
    ("as texts", lambda old: old.astype(str)), ("as objects", lambda old: old.astype(object)),
    ("as complex numbers", lambda old: np.ones(old.shape, dtype=complex)),
    ("as a number", lambda _: np.array(3)),
    ("as a square", lambda old: old.reshape(1, -1)),
]  # fmt: skip


def _fits(values: NDArray[Any], label: str) -> bool:
    """Whether a column of this type can hold the value of this change."""
    if values.ndim == 0:
        return label in ("missing", "as a number", "as texts")
    if "whole" in label:
        return values.dtype.kind == "i"
    return values.dtype.kind == "f" or label not in [name for name, _ in _CHANGES[:6]]


def _packed(columns: Columns) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=True, **columns)
    return buffer.getvalue()


def _npy(values: NDArray[Any]) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, values)
    return buffer.getvalue()


# --- rows and manifests ---

ROW_VALUES: tuple[Any, ...] = (
    None,
    "",
    "x",
    True,
    -1,
    1e308,
    10**400,
    [],
    {},
    [[[]]],
    "\x1b[31mred",
    "a\nb",
    "=1+1",
    "<script>alert(1)</script>",
    "../../x",
    "x" * 10_000,
)
LINES: dict[str, bytes] = {
    "nothing": b"", "an empty line": b"\n\n\n", "no JSON": b"tank\n", "a number": b"3\n",
    "null": b"null\n", "a list": b"[]\n", "an empty row": b"{}\n", "half a row": b'{"key": "a',
    "NaN": b'{"key": "a", "scenario": "s", "variant": "v", "outcome": "arrived", "travel_time_s": '
           b'NaN}\n',
    "zero bytes": b"\0" * 1000, "no UTF-8": b"\xff\xfe\n",
    "deep": b'{"key": ' + b"[" * 100_000 + b"\n",
    "a long number": b'{"key": "a", "seed": ' + b"9" * 100_000 + b"}\n",
    "half a surrogate": b'{"key": "\\ud800", "scenario": "s", "variant": "v", "outcome": '
                        b'"arrived"}\n',
    "only the names": b'{"key": "a", "scenario": "s", "variant": "v", "outcome": "arrived"}\n',
    "an outcome of nobody": b'{"key": "a", "scenario": "s", "variant": "v", "outcome": "tank"}\n',
}  # fmt: skip
DOCUMENTS: dict[str, bytes] = {
    "nothing": b"", "no JSON": b"tank", "null": b"null", "a list": b"[]", "a number": b"3",
    "a text": b'"x"', "an empty mapping": b"{}", "deep": b"[" * 100_000, "no UTF-8": b"\xff\xfe",
    "half": b'{"versions": {',
    "a long number": b'{"seed": ' + b"9" * 100_000 + b"}", "zero bytes": b"\0" * 100,
}  # fmt: skip


def row_cases() -> Iterator[Case]:
    """Rows and manifests of any type, read by reports, and by a batch that goes on."""
    rows, manifest = "rec/episodes.jsonl", "rec/manifest.json"
    first, *others = recorded()[rows].decode().splitlines()
    for name, line in LINES.items():
        yield from _folder(f"rows: {name}", rows, line)
        yield from _folder(
            f"rows: {name}, among good ones",
            rows,
            line + b"\n" + "\n".join([first, *others, ""]).encode(),
        )
    values = itertools.cycle(ROW_VALUES)
    for key in json.loads(first):
        for value in itertools.islice(values, 2):
            changed = json.dumps({**json.loads(first), key: value})
            yield _report(
                f"rows: {key} {value!r:.30}", rows, "\n".join([changed, *others, ""]).encode()
            )
    for name, document in DOCUMENTS.items():
        yield from _folder(f"manifest: {name}", manifest, document)
    told = json.loads(recorded()[manifest])
    for key in told:
        for value in itertools.islice(values, 4):
            yield from _folder(
                f"manifest: {key} {value!r:.30}",
                manifest,
                json.dumps({**told, key: value}).encode(),
            )
    for shard in ("1/99999999999", "0/0", "2/1", "-1/2", "x", [1, 2], [1, 99999999999], 3, None):
        yield _report(
            f"manifest: shard {shard!r}", manifest, json.dumps({**told, "shard": shard}).encode()
        )


def _report(name: str, damaged: str, content: bytes) -> Case:
    return Case(
        "record",
        f"{name}, report",
        ("report", "rec", "--out", "out", "--json"),
        {damaged: content},
        recorded=True,
        allowed=ANY,
        naming=("rec",),
        patience_s=DRIVING_S,
    )


def _folder(name: str, damaged: str, content: bytes) -> Iterator[Case]:
    files = {damaged: content}
    yield _report(name, damaged, content)
    yield Case(
        "record",
        f"{name}, batch",
        ("batch", "exp.yaml", "--out", "rec", "--jobs", "1", "--quiet"),
        files,
        recorded=True,
        allowed=ANY,
        naming=("rec",),
        patience_s=DRIVING_S,
    )
