"""A trace as the report's page replays it: everything that is drawn or written, as packed whole
numbers.

Lengths are centimetres (of tried actions and forecasts decimetres), angles milliradians, speeds
cm/s, costs thousandths. What changes slowly is written as differences, which pack well: `delta`
once, `bends` twice. The page's script (template/page.js) is the mirror of this file.
"""

import base64
import gzip
import json
import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.arrays import Floats
from sumo_mcts.records import CycleRecord, Lanes, Trace
from sumo_mcts.reporting.words import BRAKING, action_words
from sumo_mcts.scene import TERMS, Decision, EgoState, Forecast, Release, RootChild

MARK_S = 0.5  # between the points of a plan and of a tried trajectory
FORECAST_S = 1.0  # between the points of a forecast
AHEAD_S = 5.0  # of a forecast
MOVES_M = 0.5  # an agent that is forecast to move less has no line
DIFFERS_M = 0.5  # from the usual hypothesis, to be drawn beside it
NONE, BROKEN, SOLID = range(3)  # borders of lanes

Packed = dict[str, Any]


def packed(trace: Trace) -> str:
    """The replay as base64 of gzip of JSON. Raises ValueError where there is no cycle."""
    text = json.dumps(replay(trace), separators=(",", ":"), allow_nan=False)
    return base64.b64encode(gzip.compress(text.encode(), 6, mtime=0)).decode()


def replay(trace: Trace) -> Packed:
    """The data that the page draws and writes."""
    if not trace.cycles:
        raise ValueError(f"{trace.key}: the trace holds no cycle")
    origin = np.floor([trace.cycles[0].ego.x, trace.cycles[0].ego.y])
    cycles = trace.cycles
    return {
        "outcome": trace.outcome,
        "time": delta([cycle.time for cycle in cycles], 1000),
        "lanes": _lanes(trace.lanes, origin),
        "ego": _ego([cycle.ego for cycle in cycles], origin),
        "others": _others(cycles, origin),
        "cycles": [_cycle(cycle, origin) for cycle in cycles],
        "terms": list(TERMS),
    }


def delta(values: Iterable[float], unit: float = 100) -> list[int]:
    """The first value and then the differences, in whole units."""
    return _whole(np.diff(np.round(np.array(list(values), dtype=np.float64) * unit), prepend=0.0))


def bends(points: Floats, unit: float = 10) -> list[int]:
    """A line [K, 2] as x and y of its first point, then of the first step, then of the changes of
    step, in whole units."""
    return _whole(bent(np.asarray(points, dtype=np.float64).reshape(-1, 2), unit).ravel())


def bent(lines: Floats, unit: float = 10) -> NDArray[np.int64]:
    """[..., K, 2] the same of many lines at once."""
    whole = np.round(lines * unit).astype(np.int64)
    steps = np.diff(whole, axis=-2, prepend=np.zeros_like(whole[..., :1, :]))
    steps[..., 2:, :] -= steps[..., 1:-1, :].copy()
    return steps


def _whole(values: NDArray[Any]) -> list[int]:
    numbers: list[int] = values.astype(np.int64).tolist()
    return numbers


# --- the road ---


def _lanes(lanes: Lanes, origin: Floats) -> list[Packed]:
    """Each lane's middle, width and what it is: inside a junction, on the route, which line is on
    its left."""
    shapes = [lanes.points[begin:end] - origin for begin, end in pairwise(lanes.offset.tolist())]
    edges = [name.rpartition("_") for name in lanes.lane_ids]
    top: dict[str, int] = {}
    for edge, _, index in edges:
        top[edge] = max(top.get(edge, 0), int(index) if index.isdigit() else 0)
    borders = [
        NONE if inside else SOLID if index == str(top[edge]) else BROKEN
        for (edge, _, index), inside in zip(edges, lanes.internal, strict=True)
    ]
    return [
        {
            "p": bends(shape, 100),
            "w": round(100 * width),
            "i": int(inside),
            "r": int(route),
            "b": border,
            "j": edge.rpartition("_")[0] if inside else "",
        }
        for shape, width, inside, route, border, (edge, _, _) in zip(
            shapes, lanes.width, lanes.internal, lanes.route, borders, edges, strict=True
        )
    ] + [{"p": bends(line.reshape(2, 2) - origin, 100), "s": 1} for line in lanes.stop_lines]


# --- the ego and the agents ---


def _ego(states: Sequence[EgoState], origin: Floats) -> Packed:
    return {
        "size": [round(100 * states[0].length), round(100 * states[0].width)],
        "x": delta(state.x - origin[0] for state in states),
        "y": delta(state.y - origin[1] for state in states),
        "h": delta(np.unwrap([state.heading for state in states]), 1000),
        "v": delta(state.v for state in states),
        "a": delta(state.a for state in states),
    }


def _others(cycles: Sequence[CycleRecord], origin: Floats) -> list[Packed]:
    """The agents, each once for every stretch of cycles in which it was seen without a gap."""
    seen: dict[str, list[tuple[int, int]]] = {}  # cycle and row
    for k, cycle in enumerate(cycles):
        for n, name in enumerate(cycle.agents.ids):
            seen.setdefault(name, []).append((k, n))
    return [
        _other(name, stretch, cycles, origin)
        for name, rows in seen.items()
        for stretch in _stretches(rows)
    ]


def _stretches(rows: list[tuple[int, int]]) -> list[list[tuple[int, int]]]:
    cuts = [0, *(i for i in range(1, len(rows)) if rows[i][0] != rows[i - 1][0] + 1), len(rows)]
    return [rows[begin:end] for begin, end in pairwise(cuts)]


def _other(
    name: str, stretch: list[tuple[int, int]], cycles: Sequence[CycleRecord], origin: Floats
) -> Packed:
    def column(field: str) -> list[float]:
        return [float(getattr(cycles[k].agents, field)[n]) for k, n in stretch]

    k, n = stretch[0]
    brakes, blinks = column("a"), column("blinker")
    return {
        "id": name,
        "from": k,
        "size": [
            round(100 * float(cycles[k].agents.length[n])),
            round(100 * float(cycles[k].agents.width[n])),
        ],
        "person": int(cycles[k].agents.person[n]),
        "x": delta(x - origin[0] for x in column("x")),
        "y": delta(y - origin[1] for y in column("y")),
        "h": delta(np.unwrap(column("heading")), 1000),
        "v": delta(column("v")),
        "lamps": [
            (a < BRAKING) + 2 * (blink > 0) + 4 * (blink < 0)
            for a, blink in zip(brakes, blinks, strict=True)
        ],
    }


# --- decisions and forecasts ---


def _cycle(cycle: CycleRecord, origin: Floats) -> Packed:
    decision = cycle.decision
    return {
        "does": action_words(cycle),
        "why": decision.reason,
        "failsafe": int(cycle.intervened),
        "released": int(isinstance(decision.command, Release)),
        "off": cycle.deviation,
        "detour": cycle.ego.detour,
        "ms": round(cycle.plan_ms, 2) if math.isfinite(cycle.plan_ms) else None,
        "n": decision.iterations,
        "known": decision.known,
        "chosen": decision.chosen,
        "plan": _plan(decision, origin),
        "tried": [_tried(child, cycle.step, origin) for child in decision.children],
        "forecast": _forecast(cycle.forecast, origin),
    }


def _plan(decision: Decision, origin: Floats) -> list[int]:
    plan = decision.plan
    if plan is None or not len(plan.time):
        return []
    marks = np.arange(MARK_S, plan.time[-1] + 1e-6, MARK_S)
    return bends(
        plan.pose[np.searchsorted(plan.time, marks - 1e-6).clip(max=len(plan.time) - 1), :2]
        - origin,
        100,
    )


def _tried(child: RootChild, step: float, origin: Floats) -> list[Any]:
    """Acceleration in cm/s2, lane change, visits, mean and best cost (null: lost), terms,
    trajectory."""
    every = max(1, round(MARK_S / step))
    trajectory = child.poses[every - 1 :: every, :2]
    costs = [_thousandths(value) for value in (child.mean, child.best)]
    return [
        round(100 * child.accel),
        child.lane_change,
        child.visits,
        *costs,
        [_thousandths(term) for term in child.terms.tolist()],
        bends(trajectory - origin),
    ]


def _thousandths(value: float) -> int | None:
    return round(1000 * value) if math.isfinite(value) else None


def _forecast(forecast: Forecast, origin: Floats) -> list[list[Any]]:
    """[share of the hypothesis in percent, trajectory] of each agent that is expected to move: in
    the likeliest hypothesis, and where another one differs from it."""
    until, every = round(AHEAD_S / forecast.dt) + 1, max(1, round(FORECAST_S / forecast.dt))
    pose, there = (
        forecast.pose[:, :until:every, :, :2],
        forecast.valid[:, :until:every].cumprod(axis=1),
    )
    if not pose.size:
        return []
    usual = int(np.argmax(forecast.weight))
    moves, differs = (
        np.hypot(off[..., 0], off[..., 1]).max(axis=1)
        for off in (pose - pose[:, :1], pose - pose[usual])
    )  # [H, N]
    drawn = np.where(
        np.arange(len(pose))[:, None] == usual, moves > MOVES_M, differs > DIFFERS_M
    ) & (there[:, 0] > 0)
    lines, lasts, shares = (
        bent(np.moveaxis(pose, 1, 2) - origin),
        there.sum(axis=1),
        np.round(100 * forecast.weight),
    )
    return [
        [int(shares[h]), lines[h, n, : lasts[h, n]].ravel().tolist()]
        for h, n in np.argwhere(drawn).tolist()
    ]
