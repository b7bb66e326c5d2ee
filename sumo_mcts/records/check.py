"""What a trace and a map have to hold before anything is computed from them.

That is the shape of every field and the bounds of its numbers (rules.py), and rules of several
fields. Compiled code checks no index, so a damaged number would make it read beyond an array.
"""

import math
from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.records.rules import ANSWERED, RULES, Rule
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import TURNS

ROUTE = 2e6  # m of all lanes of a route together: a table has a row for each metre
INSIDE = 50  # lanes one after the other inside a junction
DRAWN = 1e7  # m of all lanes together that a trace keeps to be drawn
Sizes = dict[str, int]


def map_problem(road: RoadMap) -> str:
    """What is wrong with a map, by field; "": nothing."""
    return next(_wrong(road, "map", {}), "") or next(_lanes_wrong(road), "")


def trace_problem(trace: Any) -> str:
    """The problem of a trace, by field, as far as it shows without its map; "": none."""
    return next(_wrong(trace, "trace", {}), "") or next(_trace_wrong(trace), "")


def fit_problem(trace: Any, road: RoadMap, numbers: Iterable[int]) -> str:
    """What is wrong with these decisions of a trace beside its map, which is sound: lanes, edges
    and signals that it does not have, too. "": nothing."""
    return next(
        (
            problem
            for i in numbers
            for problem in _beside_wrong(trace.cycles[i], f"trace.cycles[{i}]", road)
        ),
        "",
    )


# --- the rules of each field ---


def _wrong(value: Any, name: str, sizes: Sizes) -> Iterator[str]:
    """What is wrong with a named tuple and all that it holds.

    `sizes` are those known so far, to which it adds its own.
    """
    rules = RULES[type(value).__name__]
    inside = dict(sizes)
    # Fields with a rule come first, in the order of the rules: they set the sizes.
    for field in (*rules, *(each for each in value._fields if each not in rules)):
        part, where = getattr(value, field), f"{name}.{field}"
        if field in rules:
            yield from _field_wrong(part, rules[field], where, inside)
        yield from _parts_wrong(part, where, inside)
    sizes.update({size: number for size, number in inside.items() if size[0].isupper()})


def _parts_wrong(part: Any, where: str, sizes: Sizes) -> Iterator[str]:
    """What is wrong with a field that is a named tuple, or a tuple of them."""
    if hasattr(part, "_fields"):
        yield from _wrong(part, where, sizes)
    elif isinstance(part, tuple):
        for i, item in enumerate(part):
            if hasattr(item, "_fields"):
                yield from _wrong(item, f"{where}[{i}]", dict(sizes))
            elif isinstance(item, np.ndarray):
                yield from _field_wrong(item, ANSWERED, f"{where}[{i}]", dict(sizes))


def _field_wrong(value: Any, rule: Rule, where: str, sizes: Sizes) -> Iterator[str]:
    """What is wrong with one field: its shape, then its numbers."""
    shape = (
        value.shape
        if isinstance(value, np.ndarray)
        else (len(value),)
        if isinstance(value, tuple)
        else ()
    )
    if len(shape) != len(rule.shape):
        yield f"{where}: has {len(shape)} dimensions, not {len(rule.shape)}"
        return
    for size, number in zip(rule.shape, shape, strict=True):
        wanted = _size(size, number, sizes)
        if number != wanted:
            yield f"{where}: has {number} entries, not {wanted}"
            return
    if rule.rises:
        yield from _rises_wrong(value, rule, where, sizes[rule.rises])
    elif not _all_within(
        value, rule.least, most := sizes[rule.below] - 1 if rule.below in sizes else rule.most
    ):
        yield from _numbers_wrong(np.asarray(value), rule, most, where)


def _size(size: str | int, number: int, sizes: Sizes) -> int:
    """How many entries there have to be; a size that is not known yet is set to this number."""
    if isinstance(size, int):
        return size
    name, _, more = size.partition("+")
    return sizes.setdefault(name, number - int(more or 0)) + int(more or 0)


def _all_within(value: Any, least: float, most: float) -> bool:
    """Whether all numbers, if any, are within bounds: a quick test, which nearly always holds."""
    if isinstance(value, np.ndarray):
        return (
            value.dtype.kind not in "iuf"
            or not value.size
            or bool(value.min() >= least and value.max() <= most)
        )
    return all(
        not isinstance(item, int | float) or least <= item <= most
        for item in (value if isinstance(value, tuple) else (value,))
    )


def _numbers_wrong(values: NDArray[Any], rule: Rule, most: float, where: str) -> Iterator[str]:
    fine = (values >= rule.least) & (values <= most)
    if values.dtype.kind == "f":
        fine |= (rule.endless & np.isinf(values)) | (rule.unknown & np.isnan(values))
    if not fine.all():
        yield f"{where}: has to be {_range(rule.least, most)}, got {values[~fine].flat[0]:g}"


def _rises_wrong(values: NDArray[Any], rule: Rule, where: str, end: int) -> Iterator[str]:
    steps = np.diff(values.astype(np.int64))  # wide enough for the difference of any two
    if (
        not len(values)
        or values[0] != 0
        or values[-1] != end
        or steps.min(initial=rule.least) < rule.least
    ):
        yield f"{where}: has to rise from 0 to {end}" + (
            f" by {rule.least:g} at least" if rule.least else ""
        )


def _range(least: float, most: float) -> str:
    return f"from {least:g} to {most:g}" if math.isfinite(most) else f"at least {least:g}"


# --- rules of several fields ---


def _lanes_wrong(road: RoadMap) -> Iterator[str]:
    """Lanes beside each other, and paths through a junction, which have to come to an end."""
    place = road.index
    for name, side, step in (("left", road.left, 1), ("right", road.right, -1)):
        has = np.flatnonzero(side >= 0)
        if (
            (road.edge[side[has]] != road.edge[has]) | (place[side[has]] != place[has] + step)
        ).any():
            yield f"map.{name}: has to name the next lane of the same edge"
    origin = np.repeat(np.arange(len(road.edge)), np.diff(road.successor_offset))
    inside = road.internal[origin] & road.internal[road.successor]
    if _circles(origin[inside], road.successor[inside]):
        yield "map.successor: leads round in a circle inside a junction"
    arcs = road.point_s
    starts, lasts = road.point_offset[:-1], road.point_offset[1:] - 1
    rising = np.diff(arcs) >= 0.0
    rising[lasts[:-1]] = True
    if arcs[starts].any() or not rising.all():
        yield "map.point_s: has to rise from 0 along each lane"
    if (road.internal[road.exit] & (road.exit != np.arange(len(road.exit)))).any():
        yield "map.exit: has to name a lane outside junctions"


def _circles(origin: NDArray[Any], target: NDArray[Any]) -> bool:
    """Whether the arrows from origin [K] to target [K] form a circle, or a chain of more than
    INSIDE lanes.

    The last arrows are removed INSIDE times; then none may be left.
    """
    for _ in range(INSIDE):
        goes_on = np.isin(target, origin)
        origin, target = origin[goes_on], target[goes_on]
    return len(origin) > 0


def _trace_wrong(trace: Any) -> Iterator[str]:
    """What is wrong with the order of decisions, the lanes to draw, or the map's name."""
    times = [cycle.time for cycle in trace.cycles]
    if any(after <= before for before, after in pairwise(times)):
        yield "trace.cycles.time: has to grow from one decision to the next"
    if not trace.setting.map.isalnum() and trace.setting.map:
        yield "trace.setting.map: has to be letters and digits"
    shapes = (trace.lanes.points[begin:end] for begin, end in pairwise(trace.lanes.offset))
    if sum(float(np.hypot(*np.diff(shape, axis=0).T).sum()) for shape in shapes) > DRAWN:
        yield f"trace.lanes.points: has to be {DRAWN / 1000:,.0f} km of lanes at most"
    for i, cycle in enumerate(trace.cycles):
        yield from _cycle_wrong(cycle, f"trace.cycles[{i}]")


def _cycle_wrong(cycle: Any, name: str) -> Iterator[str]:
    agents, forecast = len(cycle.agents.ids), cycle.forecast
    if len(forecast.half_length) not in (0, agents):
        yield f"{name}.forecast: has {len(forecast.half_length)} agents, not {agents}"
    if not forecast.pose.shape[0] or not forecast.pose.shape[1]:
        yield f"{name}.forecast: has to hold one hypothesis and one time at least"
    if len(forecast.intents) not in (0, len(forecast.weight)):
        yield (
            f"{name}.forecast.intents: has {len(forecast.intents)} entries, not "
            f"{len(forecast.weight)}"
        )
    if any(intent.does == TURNS and not intent.way for intent in forecast.intents):
        yield f"{name}.forecast.intents: one that turns has to name its lanes"
    if len(cycle.answers.ways) not in (0, agents):
        yield f"{name}.answers.ways: has {len(cycle.answers.ways)} entries, not {agents}"
    if len(cycle.signals.until) and not cycle.signals.until.shape[1]:
        yield f"{name}.signals.until: has to hold the present phase at least"


def _beside_wrong(cycle: Any, name: str, road: RoadMap) -> Iterator[str]:
    """What is wrong with a decision beside its map: its fields, signals and routes.

    A route must not use an edge without a lane, or be too long to be laid out.
    """
    yield from _wrong(cycle, name, {"lanes": len(road.lane_ids), "edges": len(road.edge_ids)})
    yield from _cycle_wrong(cycle, name)
    links, lit = np.diff(cycle.signals.offset), np.flatnonzero(road.signal >= 0)
    if len(links) != len(road.signal_ids):
        yield f"{name}.signals: has {len(links)} signals, not {len(road.signal_ids)}"
    elif (road.link[lit] >= links[road.signal[lit]]).any():
        yield f"{name}.signals.offset: has fewer links than the map names"
    per_edge = np.bincount(road.edge, weights=road.length, minlength=len(road.edge_ids))
    for field, edges in (("ego.route", cycle.ego.route), ("memory.edges", cycle.memory.edges)):
        yield from (
            f"{name}.{field}: no lane of the map belongs to edge {edge}"
            for edge in edges
            if edge >= 0 and not per_edge[edge]
        )
        if sum(per_edge[edge] for edge in edges if edge >= 0) > ROUTE:
            yield f"{name}.{field}: has to be {ROUTE / 1000:,.0f} km of lanes at most"
