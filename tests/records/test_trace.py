"""Traces come back as they were written, and broken files are refused."""

import os
import re
from contextlib import suppress
from pathlib import Path
from types import UnionType
from typing import Any, NamedTuple, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
import pytest
from helpers_referee import CROSSING
from helpers_trace import busy_trace, crossing_trace
from hypothesis import given, settings
from hypothesis import strategies as st
from typing_extensions import TypeAliasType

from sumo_mcts import records
from sumo_mcts.records import check, coarse, codec
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import NO_STOP, Decision, EgoState, Follow, Release


def random_value(kind: Any, rng: np.random.Generator, path: str = "") -> Any:
    """Any value of an annotated type: empty and odd-shaped arrays, nan and inf, strings beyond
    ASCII."""
    kind = codec.without_alias(kind)
    origin, args = get_origin(kind), get_args(kind)
    if kind is float:
        return float(rng.choice([rng.normal() * 1e4, np.nan, np.inf, -np.inf, 0.0]))
    if kind is int:
        return int(rng.integers(-(2**40), 2**40))
    if kind is bool:
        return bool(rng.integers(2))
    if kind is str:
        return str(rng.choice(["", "ego", "fußgänger→1", 'a,b\n"c"', "x" * 70]))
    if origin is np.ndarray:
        shape = rng.integers(0, 4, size=rng.integers(1, 4))
        values = rng.normal(size=shape) * 1000
        if issubclass(get_args(args[1])[0], np.floating):
            values = np.where(rng.random(shape) < 0.1, np.inf, values)
            layout = coarse.layout_of(path)
            if layout is None:
                return values
            return coarse.from_steps(coarse.to_steps(values, layout), values.shape, layout)
        return values.astype(get_args(args[1])[0])
    if origin is tuple:
        return tuple(random_value(args[0], rng, path) for _ in range(rng.integers(4)))
    if origin is UnionType:
        member = args[rng.integers(len(args))]
        return (
            None if member is type(None) else random_value(member, rng, f"{path}/{member.__name__}")
        )
    return kind(
        *(
            random_value(annotation, rng, f"{path}/{field}")
            for field, annotation in get_type_hints(kind).items()
        )
    )


def assert_same(a: Any, b: Any, path: str = "trace") -> None:
    """Equal in types, structure, shapes, element types and every value."""
    assert type(a) is type(b), path
    if isinstance(a, np.ndarray):
        assert a.dtype == b.dtype, path
        np.testing.assert_array_equal(a, b, err_msg=path)
    elif isinstance(a, tuple):
        assert len(a) == len(b), path
        for i, (x, y) in enumerate(zip(a, b, strict=True)):
            assert_same(x, y, f"{path}/{getattr(a, '_fields', range(len(a)))[i]}")
    elif isinstance(a, float) and np.isnan(a):
        assert np.isnan(b), path
    else:
        assert a == b, path


@pytest.mark.slow
@pytest.mark.smoke
@given(seed=st.integers(0, 2**32))
@settings(max_examples=30, deadline=None)
def test_a_trace_of_anything_comes_back(
    tmp_path_factory: pytest.TempPathFactory, seed: int
) -> None:
    trace = random_value(records.Trace, np.random.default_rng(seed))
    path = tmp_path_factory.mktemp("trace") / "t.npz"
    records.save_trace(path, trace)
    assert_same(codec.load_columns(path, records.Trace, "trace", lambda _: ""), trace)


def test_an_alias_of_a_type_is_the_type_behind_it() -> None:
    element = TypeVar("element", bound=np.generic)
    array = TypeAliasType(
        "array", np.ndarray[tuple[Any, ...], np.dtype[element]], type_params=(element,)
    )
    column = TypeAliasType("column", array[np.int32])
    kind: Any = NamedTuple(
        "kind", [("speeds", array[np.float64]), ("lanes", column), ("several", tuple[column, ...])]
    )
    value = kind(
        np.arange(6.0).reshape(2, 3),
        np.arange(3, dtype=np.int32),
        (np.zeros(0, np.int32), np.ones(2, np.int32)),
    )
    assert_same(codec.value_of(kind, codec.columns_of(kind, value)), value)


def test_a_trace_without_cycles_comes_back(tmp_path: Path) -> None:
    trace = crossing_trace()._replace(cycles=())
    records.save_trace(tmp_path / "t.npz", trace)
    assert_same(records.load_trace(tmp_path / "t.npz"), trace)


def test_the_ego_keeps_double_precision_and_the_forecast_five_millimetres(tmp_path: Path) -> None:
    trace = crossing_trace()
    records.save_trace(tmp_path / "t.npz", trace)
    back = records.load_trace(tmp_path / "t.npz")
    for before, after in zip(trace.cycles, back.cycles, strict=True):
        assert_same(after.ego, before.ego)
        assert_same(after.agents, before.agents)
        there, back_there = before.forecast.pose, after.forecast.pose
        np.testing.assert_allclose(back_there[..., :2], there[..., :2], atol=0.005 + 1e-9)
        np.testing.assert_allclose(back_there[..., 2:], there[..., 2:], atol=5e-5 + 1e-9)
        np.testing.assert_allclose(after.forecast.v, before.forecast.v, atol=0.005 + 1e-9)
        assert after.forecast.pose.dtype == np.float64
    assert isinstance(back.cycles[-1].decision.command, Release)
    assert isinstance(back.cycles[0].decision.command, Follow)
    assert back.cycles[-1].decision.plan is None
    assert back.cycles[-1].executed_lane == -1


def test_a_trace_of_format_6_is_read_too(tmp_path: Path) -> None:
    """There the coarse columns are in single precision."""
    trace = crossing_trace()
    columns, single = codec.columns_of(records.Trace, trace), {"format": np.array(6)}
    for name in columns:
        if coarse.layout_of(name) is not None and "children" not in name and "Plan" not in name:
            field = name.rpartition("/")[2]
            values = [np.ravel(getattr(cycle.forecast, field)) for cycle in trace.cycles]
            single[name] = np.concatenate(values).astype(np.float32)
        elif coarse.layout_of(name) is not None:
            single[name] = np.zeros(len(columns[name]), np.float32)
    old = {**columns, **single}
    for name in [each for each in old if "memory/held_up" in each]:  # it came with format 7
        del old[name]
    np.savez(tmp_path / "t.npz", **old)
    back = records.load_trace(tmp_path / "t.npz")
    np.testing.assert_allclose(
        back.cycles[1].forecast.pose, trace.cycles[1].forecast.pose, atol=5e-4
    )


def test_a_long_trace_is_small(tmp_path: Path) -> None:
    records.save_trace(tmp_path / "t.npz", busy_trace())
    assert (tmp_path / "t.npz").stat().st_size < 4_000_000


def test_the_same_trace_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        records.save_trace(tmp_path / name, crossing_trace())
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_every_field_of_a_cycle_is_storable() -> None:
    """A new field in scene.py of a kind that the trace cannot hold shows here, not at the end of an
    episode."""
    columns = codec.columns_of(records.Trace, crossing_trace())
    stored = {"/".join(name.split("#")[0].split("/")[:4]) for name in columns}
    assert stored >= {f"trace/cycles/ego/{field}" for field in EgoState._fields}
    assert {
        name.split("#")[0].split("/")[3]
        for name in columns
        if name.startswith("trace/cycles/decision/")
    } == set(Decision._fields)
    assert all(column.dtype != object for column in columns.values())


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_a_truncated_trace_is_refused_by_name(tmp_path: Path, share: float) -> None:
    path = tmp_path / "cut.npz"
    records.save_trace(path, crossing_trace())
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
    with pytest.raises(records.TraceError, match=r"cut\.npz: not a whole trace") as caught:
        records.load_trace(path)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
@given(data=st.data())
@settings(max_examples=150, deadline=None)
def test_a_damaged_trace_is_whole_or_refused(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """Bytes overwritten anywhere, most of all where the archive and its headers say what is in
    them."""
    path = tmp_path_factory.mktemp("trace") / "t.npz"
    content = bytearray(
        records.trace_bytes(crossing_trace()._replace(cycles=crossing_trace().cycles[:1]))
    )
    heads = [
        found.start()
        for mark in (b"PK\x01\x02", b"PK\x03\x04", b"PK\x05\x06")
        for found in re.finditer(re.escape(mark), content)
    ]
    for _ in range(data.draw(st.integers(1, 3))):
        at = (
            data.draw(st.sampled_from(heads)) + data.draw(st.integers(0, 90))
            if data.draw(st.booleans())
            else data.draw(st.integers(0, len(content) - 1))
        )
        content[at : at + 1] = data.draw(st.binary(min_size=1, max_size=1))
    path.write_bytes(content)
    with suppress(records.TraceError):
        records.load_trace(path)


@pytest.mark.parametrize(
    ("what", "changed"),
    [
        (b"PK\x01\x02", (10, b"\x07")),
        (b"\x93NUMPY", (10, b"{'a': (")),
        (b"\x93NUMPY", (10, b"[" * 40)),
    ],
)
def test_damage_that_the_archive_does_not_know_is_refused(
    tmp_path: Path, what: bytes, changed: tuple[int, bytes]
) -> None:
    """A kind of packing that nobody knows, and headers that cannot be parsed."""
    np.savez(tmp_path / "t.npz", format=np.array(3))
    content, (offset, new) = bytearray((tmp_path / "t.npz").read_bytes()), changed
    at = content.index(what) + offset
    content[at : at + len(new)] = new
    (tmp_path / "t.npz").write_bytes(content)
    with pytest.raises(records.TraceError, match="not a whole trace"):
        records.load_trace(tmp_path / "t.npz")


def test_a_trace_with_columns_that_are_no_longer_kept_is_read(tmp_path: Path) -> None:
    """As the reason of a decision was, twice."""
    trace = crossing_trace()
    records.save_trace(tmp_path / "t.npz", trace)
    with np.load(tmp_path / "t.npz") as archive:
        columns = dict(archive)
    columns["trace/cycles/note"] = np.array([cycle.decision.reason for cycle in trace.cycles])
    np.savez_compressed(tmp_path / "t.npz", **columns)
    assert records.same(records.Trace, records.load_trace(tmp_path / "t.npz"), trace)


def test_flipped_bits_in_a_trace_are_noticed(tmp_path: Path) -> None:
    path = tmp_path / "t.npz"
    records.save_trace(path, crossing_trace())
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(bytes(content))
    with pytest.raises(records.TraceError):
        records.load_trace(path)


def test_other_files_are_not_traces(tmp_path: Path) -> None:
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    np.save(tmp_path / "array.npy", np.zeros(3))
    (tmp_path / "text.npz").write_text("no archive")
    np.savez(tmp_path / "future.npz", format=np.array(99))
    for name in ("other.npz", "array.npy", "text.npz"):
        with pytest.raises(records.TraceError, match="not a whole trace"):
            records.load_trace(tmp_path / name)
    with pytest.raises(records.TraceError, match="trace format 99"):
        records.load_trace(tmp_path / "future.npz")
    with pytest.raises(FileNotFoundError):
        records.load_trace(tmp_path / "none.npz")


def test_a_failed_write_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "t.npz"
    path.write_bytes(b"old")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        records.save_trace(path, crossing_trace())
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["t.npz"]


def test_a_trace_from_before_anybody_asked_or_waited(tmp_path: Path) -> None:
    """Each column that an older version did not write is one that this version does without."""
    trace = busy_trace()
    columns = codec.columns_of(records.Trace, trace)
    written = tuple(columns)
    for name in set(codec.ADDED) - {"roadmap/oncoming"}:
        gone = [each for each in written if each.endswith(name) or f"{name}/" in each]
        assert gone
        for column in gone:  # some end like others
            columns.pop(column, None)
    (tmp_path / "old.npz").write_bytes(codec.packed(columns))
    cycles = records.load_trace(tmp_path / "old.npz").cycles
    commands = [cycle.decision.command for cycle in cycles]
    assert {command.asks for command in commands if isinstance(command, Follow)} == {0}
    assert {(c.ego.asks, c.ego.can_ask, c.memory.planner.waited_s) for c in cycles} == {
        (0, True, 0.0)
    }
    assert {(c.ego.reroutes, c.ego.detour) for c in cycles} == {(0, "")}
    assert not any(len(cycle.changes.lane) for cycle in cycles)
    assert {(c.ego.stop, c.ego.held, c.memory.stop) for c in cycles} == {(NO_STOP, False, NO_STOP)}


def test_a_map_from_before_lanes_of_oncoming_traffic(tmp_path: Path) -> None:
    columns = codec.columns_of(RoadMap, CROSSING)
    written = [name for name in columns if name.startswith("roadmap/oncoming")]
    assert written
    for name in written:
        del columns[name]
    (tmp_path / "old.npz").write_bytes(codec.packed(columns))
    road = codec.load_columns(tmp_path / "old.npz", RoadMap, "map", check.map_problem)
    assert len(road.oncoming) == 0 and road.lane_ids == CROSSING.lane_ids
