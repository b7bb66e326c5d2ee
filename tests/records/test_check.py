"""What a trace and a map have to hold: all that is written passes, and damaged numbers are refused
before anything is computed from them."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import helpers_damage
import numpy as np
import pytest
from helpers_damage import columns_of, copy_damaged, outcome, uses
from helpers_recorded import keep, of_a_scene
from helpers_trace import busy_trace, crossing_trace, highway_trace
from hypothesis import given, settings
from hypothesis import strategies as st

from sumo_mcts import records
from sumo_mcts.commands import recorded
from sumo_mcts.driver.replan import recorded_config, replan
from sumo_mcts.episode import EpisodeResult, run_episode
from sumo_mcts.records import TraceError, check, coarse
from sumo_mcts.records.rules import RULES
from sumo_mcts.road import RoadMap

KEY = "unprotected-left-turn--mcts-idm-200--3"


@pytest.fixture(scope="module")
def result() -> EpisodeResult:
    """Four seconds of an episode, on the way into the junction."""
    whole = run_episode(of_a_scene("unprotected-left-turn"), 3)
    return whole._replace(
        traces=tuple(trace._replace(cycles=trace.cycles[8:16]) for trace in whole.traces)
    )


@pytest.fixture(scope="module")
def recorded_folder(result: EpisodeResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded") / "good"
    keep(folder, result)
    return folder


@pytest.fixture
def copy(recorded_folder: Path, tmp_path: Path) -> Path:
    shutil.copytree(recorded_folder, tmp_path / "copy")
    return tmp_path / "copy"


# --- the table ---


def kinds_in(kind: Any) -> set[type]:
    """All tuples of the language that an annotated type may hold."""
    if hasattr(kind, "_fields"):
        return {kind}.union(*(kinds_in(annotation) for annotation in get_type_hints(kind).values()))
    if get_origin(kind) in (tuple, Union, UnionType):
        return set[type]().union(*map(kinds_in, get_args(kind)))
    return set()


def test_every_number_of_a_record_has_a_rule() -> None:
    """A new field shows here, not when somebody damages it."""
    for kind in kinds_in(records.Trace) | kinds_in(RoadMap):
        for field, annotation in get_type_hints(kind).items():
            members = (
                [each for each in get_args(annotation) if each is not NoneType]
                if get_origin(annotation) in (Union, UnionType)
                else [annotation]
            )
            itself = all(hasattr(each, "_fields") or each in (bool, str) for each in members)
            assert itself or field in RULES[kind.__name__], f"{kind.__name__}.{field}"


def test_a_rule_is_about_a_field_that_there_is() -> None:
    kinds = {kind.__name__: kind for kind in kinds_in(records.Trace) | kinds_in(RoadMap)}
    for name, rules in RULES.items():
        assert set(rules) <= set(kinds[name]._fields), name


@pytest.mark.parametrize(
    "trace", [crossing_trace(), highway_trace(), busy_trace(), crossing_trace()._replace(cycles=())]
)
def test_what_is_made_up_passes(trace: records.Trace) -> None:
    assert check.trace_problem(trace) == ""


@pytest.mark.slow
@pytest.mark.parametrize(
    "sets",
    [
        (),
        ("planner.name=sumo",),
        ("planner.name=constant", "failsafe.on=true"),
        ("prediction.name=clone",),
        ("planner.name=idm", "sumo.step_length_s=0.5"),
    ],
)
def test_what_is_recorded_passes(sets: tuple[str, ...]) -> None:
    result = run_episode(of_a_scene("highway-exit", "episode.stop_time_s=5", *sets), 1)
    assert result.road is not None
    assert check.map_problem(result.road) == ""
    for trace in result.traces:
        assert check.trace_problem(trace) == ""
        records.require_fit(trace, result.road)


# --- what is refused ---

MAP_DAMAGE = {
    "left": 999, "right": -2, "exit": 10**6, "successor": -1, "successor_offset": 7777,
    "point_offset": -3, "conflict_offset": 10**6, "conflict_lane": -1,
    "edge": -1, "junction": 500, "signal": 99, "rule": 7, "direction": -1, "knot": -2,
    "length": np.nan, "speed": np.inf, "points": np.nan, "point_s": -1.0,
    "width": -1.0, "scale": np.inf, "index": -1, "conflict_begin": np.nan,
}  # fmt: skip


@pytest.mark.parametrize("field", MAP_DAMAGE)
def test_a_number_of_a_map_that_makes_no_sense_is_refused_by_file_and_field(
    field: str, copy: Path
) -> None:
    """Compiled code would read beyond the array: `explain --replan` ended with status 139."""
    (path,) = (copy / records.MAPS).iterdir()
    columns = columns_of(path)
    column = columns[f"roadmap/{field}"]
    column[len(column) // 2] = MAP_DAMAGE[field]
    np.savez(path, **columns)
    with pytest.raises(TraceError, match=rf"{path.name}: map\.{field}: has to "):
        records.load_map(copy, path.stem)
    assert f"map.{field}" in outcome(uses(copy, KEY, 6.0, again=True)["replan"])


def test_lanes_that_lead_round_in_a_circle_are_refused(result: EpisodeResult) -> None:
    """Within all bounds, but followed for ever."""
    road = result.road
    assert road is not None
    inside = int(np.flatnonzero(road.internal & (np.diff(road.successor_offset) > 0))[0])
    successor = road.successor.copy()
    successor[road.successor_offset[inside]] = inside
    assert "successor: leads round in a circle" in check.map_problem(
        road._replace(successor=successor)
    )
    left = road.left.copy()
    beside = int(np.flatnonzero(left >= 0)[0])
    left[beside] = beside
    assert "left: has to name the next lane" in check.map_problem(road._replace(left=left))


def test_offsets_that_fall_by_more_than_their_type_can_tell_are_refused() -> None:
    """As differences of 32 bits they would seem to rise."""
    trace = crossing_trace()
    offset = trace.lanes.offset.copy()
    offset[1:3] = 2**31 - 1, -(2**31) + 10
    assert "lanes.offset: has to rise" in check.trace_problem(
        trace._replace(lanes=trace.lanes._replace(offset=offset))
    )


def test_offsets_of_nothing_are_refused() -> None:
    trace = crossing_trace()
    cycle = trace.cycles[0]._replace(
        signals=trace.cycles[0].signals._replace(offset=np.zeros(0, np.int32))
    )
    assert "signals.offset: has to rise" in check.trace_problem(trace._replace(cycles=(cycle,)))


TRACE_DAMAGE = {
    "cycles/step": 0.0, "cycles/time": np.nan, "setting/step": -0.1, "cycles/ego/lane": -2,
    "cycles/ego/x": np.nan, "cycles/ego/vclass": 64,
    "cycles/agents/lane": -5, "cycles/agents/x": np.nan, "cycles/agents/vclass": 99,
    "cycles/agents/length": -1.0, "cycles/forecast/dt": 0.0,
    "cycles/forecast/pose": 2**60, "cycles/forecast/weight": 2.0, "cycles/decision/chosen": 40,
    "cycles/decision/command/Follow/lane_change": 2, "lanes/points": np.nan, "lanes/offset": -1,
    "cycles/decision/children/poses": -(2**60), "cycles/decision/plan/Plan/time": np.nan,
    "cycles/memory/planner/numbers": np.nan,
}  # fmt: skip


@pytest.mark.parametrize("field", TRACE_DAMAGE)
def test_a_number_of_a_trace_that_makes_no_sense_is_refused_by_file_and_field(
    field: str, copy: Path
) -> None:
    (path,) = (copy / records.TRACES).iterdir()
    columns = columns_of(path)
    name = f"trace/{field}"
    if coarse.layout_of(name) is not None:
        columns[name] = columns[name].astype(np.int64)
    columns[name][len(columns[name]) // 2] = TRACE_DAMAGE[field]
    np.savez(path, **columns)
    with pytest.raises(TraceError, match=rf"{KEY}\.npz: trace\.") as caught:
        records.load_trace(path)
    assert f".{field.rpartition('/')[2]}: has to " in str(caught.value)


def test_a_trace_beside_the_map_of_another_network_is_refused(
    result: EpisodeResult, tmp_path: Path
) -> None:
    """A pair of sound files: lanes that the one names and the other does not have."""
    trace, road = (
        result.traces[0],
        run_episode(of_a_scene("straight-line", "episode.stop_time_s=1"), 1).road,
    )
    assert road is not None
    with pytest.raises(
        TraceError, match=r"trace\.cycles\[0\]\..*: has to be from -1 to .*; its map is maps/"
    ):
        records.require_fit(trace, road)
    with pytest.raises(TraceError, match=r"trace\.cycles\[3\]"):
        replan(trace, road, 4, recorded_config(trace.setting))


def test_a_route_over_edges_to_which_no_lane_belongs_is_refused(result: EpisodeResult) -> None:
    trace, road = result.traces[0], result.road
    assert road is not None
    one_edge = road._replace(edge=np.full_like(road.edge, trace.cycles[0].ego.route[0]))
    with pytest.raises(
        TraceError,
        match=r"trace\.cycles\[0\]\.ego\.route: no lane of the map belongs to edge \d+; its map is "
        r"maps/",
    ):
        records.require_fit(trace, one_edge)


@pytest.mark.parametrize(
    "column",
    [
        "trace/cycles/decision/command#tag",
        "trace/cycles/agents/ids#count",
        "trace/cycles/agents/x#shape",
    ],
)
@pytest.mark.parametrize("value", [-1, 99, 127])
def test_counts_and_kinds_that_do_not_add_up_are_refused(
    column: str, value: int, copy: Path
) -> None:
    (path,) = (copy / records.TRACES).iterdir()
    columns = columns_of(path)
    columns[column][0] = value
    np.savez(path, **columns)
    with pytest.raises(TraceError, match="not a whole trace"):
        records.load_trace(path)


def test_numbers_of_another_kind_and_missing_columns_are_refused_by_name(copy: Path) -> None:
    (path,) = (copy / records.TRACES).iterdir()
    columns = columns_of(path)
    np.savez(
        path,
        **{
            **columns,
            "trace/cycles/agents/lane": columns["trace/cycles/agents/lane"].astype(float),
        },
    )
    with pytest.raises(
        TraceError, match=r"trace/cycles/agents/lane is float64 .*, not a row of int32"
    ):
        records.load_trace(path)
    del columns["trace/cycles/agents/lane"]
    np.savez(path, **columns)
    with pytest.raises(TraceError, match="trace/cycles/agents/lane is missing"):
        records.load_trace(path)


def test_a_map_is_named_by_letters_and_digits_alone(copy: Path) -> None:
    (path,) = (copy / records.TRACES).iterdir()
    np.savez(path, **{**columns_of(path), "trace/setting/map": np.array(["../../etc/x"])})
    with pytest.raises(TraceError, match=r"trace\.setting\.map: has to be letters and digits"):
        records.load_trace(path)


# --- bounded memory ---


def test_an_archive_that_grows_beyond_bounds_is_refused_before_it_is_unpacked(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (path,) = (copy / records.TRACES).iterdir()
    monkeypatch.setattr("sumo_mcts.records.codec.MOST_BYTES", 100_000)
    monkeypatch.setattr(zipfile.ZipFile, "read", lambda *_: pytest.fail("unpacked"))
    with pytest.raises(TraceError, match="unpacked it has more than 100,000 bytes"):
        records.load_trace(path)


def test_an_array_that_claims_to_be_larger_than_its_bytes_is_refused(tmp_path: Path) -> None:
    header = (
        b"\x93NUMPY\x01\x00\x76\x00"
        + f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({10**13},), }}".encode().ljust(117)
        + b"\n"
    )
    with zipfile.ZipFile(tmp_path / "t.npz", "w") as archive:
        archive.writestr("format.npy", header + b"\x00" * 8)
    with pytest.raises(TraceError, match=r"an array of float64 \(10000000000000,\) in 8 bytes"):
        records.load_trace(tmp_path / "t.npz")


# --- anything ---


@pytest.mark.slow
@given(seed=st.integers(0, 2**32))
@settings(max_examples=15, deadline=None)
def test_whatever_is_damaged_is_refused_in_a_line_or_does_no_harm(
    recorded_folder: Path, seed: int
) -> None:
    target = recorded_folder.with_name("damaged")
    copy_damaged(recorded_folder, target, np.random.default_rng(seed))
    for use in uses(target, KEY, 6.0, again=False).values():
        outcome(use)


@given(data=st.data())
@settings(max_examples=40, deadline=None)
def test_a_map_with_damaged_bytes_is_whole_or_refused(
    recorded_folder: Path, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    (path,) = (recorded_folder / records.MAPS).iterdir()
    content, folder = bytearray(path.read_bytes()), tmp_path_factory.mktemp("bytes")
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    records.write_whole(folder / records.MAPS / path.name, bytes(content))
    said = ""
    try:
        records.load_map(folder, path.stem)
    except TraceError as error:
        said = str(error)
    assert "\n" not in said
    assert not said or said.startswith(str(folder))


@pytest.mark.slow
def test_no_decision_taken_again_from_a_damaged_record_reads_beyond_an_array(
    recorded_folder: Path,
) -> None:
    """In plain Python, where that is an IndexError."""
    command = [sys.executable, helpers_damage.__file__, recorded_folder, KEY, "60", "1"]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    assert recorded.choices(recorded_folder)
    assert done.stdout.startswith("60 damaged, ")
