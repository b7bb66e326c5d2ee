"""Traces: what the ego knew, decided and executed in each cycle; and the maps to which they refer.

Both are .npz files without pickle (codec.py), and checked when they are read (check.py).
"""

import hashlib
import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Ints
from sumo_mcts.records import check
from sumo_mcts.records.codec import TraceError, columns_of, load_columns, packed
from sumo_mcts.records.layout import MAPS
from sumo_mcts.records.writing import write_whole
from sumo_mcts.road import RoadChanges, RoadMap
from sumo_mcts.scene import Agents, Answers, Decision, EgoState, Forecast, Memory, Signals


class CycleRecord(NamedTuple):
    """One decision: what the ego knew, expected and decided, and what it then did."""

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
    deviation: str  # how the executed state differs from the commanded one; "": it does not
    intervened: bool = False  # a fail-safe manoeuvre replaced the decision; why: decision.reason
    memory: Memory = Memory()  # of earlier decisions, beside the last one
    answers: Answers = Answers()  # of oracles
    changes: RoadChanges = RoadChanges()  # of the map


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
    """What all decisions of an episode share."""

    config: str = ""  # the resolved scenario, JSON; "": unknown
    seed: int = 0  # of the search
    step: float = math.nan  # of the simulation, s
    ballistic: bool = False  # how the simulation integrates
    change_duration: float = math.nan  # of a lane change, s
    map: str = ""  # the roads are in maps/MAP.npz; lanes are indices into it


class Trace(NamedTuple):
    """One episode of one ego, cycle by cycle."""

    key: str
    scenario: str
    outcome: str
    lanes: Lanes
    cycles: tuple[CycleRecord, ...]
    setting: Setting = Setting()


def save_trace(path: Path, trace: Trace) -> None:
    """Write a trace as one compressed npz. Raises OSError."""
    write_whole(path, trace_bytes(trace))


def trace_bytes(trace: Trace) -> bytes:
    """A trace as it stands in its file."""
    return packed(columns_of(Trace, trace))


def load_trace(path: Path) -> Trace:
    """Read a trace.

    Raises TraceError where the file is broken, of another format or holds impossible numbers,
    OSError where it cannot be read.
    """
    trace: Trace = load_columns(path, Trace, "trace", check.trace_problem)
    return trace


def scenario_of(setting: Setting) -> dict[str, Any]:
    """The resolved scenario of an episode; empty where it is unknown.

    Raises TraceError where the text is no resolved scenario.
    """
    if not setting.config:
        return {}
    try:
        scenario: dict[str, Any] = json.loads(setting.config)
        names = scenario["planner"]["name"], scenario["prediction"]["name"]
        named = all(isinstance(name, str) for name in names)
        resolved = named and scenario["planner"]["period_s"] > 0.0
    except (ValueError, RecursionError, TypeError, KeyError):
        resolved = False
    if not resolved:
        raise TraceError("the scenario in it is not a resolved one")
    return scenario


def same(kind: type, one: Any, other: Any) -> bool:
    """Whether two values of this kind are stored as the same bits."""
    before, after = columns_of(kind, one), columns_of(kind, other)
    return before.keys() == after.keys() and all(
        column.tobytes() == after[name].tobytes() for name, column in before.items()
    )


def map_name(road: RoadMap) -> str:
    """The name of a network's file in maps/: a digest of its roads, not of their file."""
    content = hashlib.sha256()
    for name, column in columns_of(RoadMap, road).items():
        content.update(name.encode())
        content.update(np.ascontiguousarray(column).tobytes())
    return content.hexdigest()[:16]


def save_map(folder: Path, road: RoadMap) -> Path:
    """Write roads into the maps/ of a folder, unless they are there undamaged; their path.

    Raises OSError.
    """
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
    return packed(columns_of(RoadMap, road))


def load_map(folder: Path, name: str) -> RoadMap:
    """Read roads from the maps/ of a folder.

    Raises TraceError where the file is broken or holds impossible numbers, OSError where it cannot
    be read.
    """
    road: RoadMap = load_columns(folder / MAPS / f"{name}.npz", RoadMap, "map", check.map_problem)
    return road


def require_fit(trace: Trace, road: RoadMap, numbers: Iterable[int] | None = None) -> None:
    """Raise TraceError where decisions of a trace (default: all) have impossible numbers, or name
    lanes, edges or signals that the map does not have."""
    problem = check.fit_problem(
        trace, road, range(len(trace.cycles)) if numbers is None else numbers
    )
    if problem:
        raise TraceError(f"{problem}; its map is {MAPS}/{trace.setting.map}.npz")
