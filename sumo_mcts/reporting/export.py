"""A trace in formats that other programs read: CSV, and SUMO's floating car data (FCD)."""

import math
from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import quoteattr

from sumo_mcts.records import CycleRecord, Row, Trace, write_table, write_whole
from sumo_mcts.scene import RoadMap

COLUMNS = (
    "time_s", "vehicle", "role", "x_m", "y_m", "heading_rad", "v_mps", "a_mps2", "lane", "s_m",
    "d_m", "length_m", "width_m", "reason", "accel_mps2",
    "lane_change", "cost", "iterations",
)  # fmt: skip

_NO_XML = dict.fromkeys(
    [*range(0x20), 0xFFFE, 0xFFFF], "?"
)  # letters that XML cannot hold, however they are written; but tab and line break
del _NO_XML[0x09], _NO_XML[0x0A]


def write_csv(path: Path, trace: Trace, road: RoadMap) -> None:
    """A row for each cycle and vehicle, the ego first, as the planner saw them; the last columns
    tell of its decision. Raises OSError."""
    write_table(
        path,
        COLUMNS,
        [
            row
            for cycle in trace.cycles
            for row in (_ego_row(cycle, road), *_agent_rows(cycle, road))
        ],
    )


def write_fcd(path: Path, trace: Trace, road: RoadMap) -> None:
    """A time step for each cycle, as SUMO has it: the middle of the front bumper, degrees clockwise
    from north, and the time at which the step began that led there. Raises OSError."""
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        "<fcd-export>",
        *(line for cycle in trace.cycles for line in _timestep(cycle, road)),
        "</fcd-export>",
    ]
    write_whole(path, ("\n".join(lines) + "\n").translate(_NO_XML).encode(errors="replace"))


def _ego_row(cycle: CycleRecord, road: RoadMap) -> Row:
    ego, decision = cycle.ego, cycle.decision
    chosen = decision.children[decision.chosen] if decision.chosen >= 0 else None
    return {
        "time_s": cycle.time, "vehicle": ego.id, "role": "ego", "x_m": ego.x, "y_m": ego.y,
        "heading_rad": ego.heading, "v_mps": ego.v, "a_mps2": ego.a,
        "lane": _lane(road, ego.lane), "s_m": ego.s, "d_m": ego.d, "length_m": ego.length,
        "width_m": ego.width, "reason": decision.reason,
        "accel_mps2": None if chosen is None else chosen.accel,
        "lane_change": None if chosen is None else chosen.lane_change,
        "cost": None if chosen is None or not math.isfinite(chosen.best) else chosen.best,
        "iterations": decision.iterations,
    }  # fmt: skip


def _agent_rows(cycle: CycleRecord, road: RoadMap) -> Iterator[Row]:
    agents = cycle.agents
    for i, name in enumerate(agents.ids):
        yield {
            "time_s": cycle.time, "vehicle": name,
            "role": "person" if agents.person[i] else "agent", "x_m": float(agents.x[i]),
            "y_m": float(agents.y[i]),
            "heading_rad": float(agents.heading[i]), "v_mps": float(agents.v[i]),
            "a_mps2": float(agents.a[i]), "lane": _lane(road, int(agents.lane[i])),
            "s_m": float(agents.s[i]), "d_m": float(agents.d[i]),
            "length_m": float(agents.length[i]), "width_m": float(agents.width[i]),
        }  # fmt: skip


def _timestep(cycle: CycleRecord, road: RoadMap) -> Iterator[str]:
    ego, agents = cycle.ego, cycle.agents
    yield f'    <timestep time="{cycle.time - cycle.step:.2f}">'
    yield _element(
        "vehicle",
        ego.id,
        ego.x,
        ego.y,
        ego.heading,
        ego.length,
        ego.v,
        ego.a,
        _lane(road, ego.lane),
        ego.s,
    )
    for i, name in enumerate(agents.ids):
        kind, lane = "person" if agents.person[i] else "vehicle", _lane(road, int(agents.lane[i]))
        x, y, heading, length = agents.x[i], agents.y[i], agents.heading[i], agents.length[i]
        yield _element(
            kind, name, x, y, heading, length, agents.v[i], agents.a[i], lane, agents.s[i]
        )
    yield "    </timestep>"


def _element(
    kind: str,
    name: str,
    x: float,
    y: float,
    heading: float,
    length: float,
    v: float,
    a: float,
    lane: str,
    s: float,
) -> str:
    """A line of FCD; x and y (m) are the centre, `heading` in rad."""
    front_x, front_y = (
        (x, y)
        if kind == "person"
        else (x + 0.5 * length * math.cos(heading), y + 0.5 * length * math.sin(heading))
    )
    where = f"lane={quoteattr(lane)} " if lane and kind == "vehicle" else ""
    angle = (90.0 - math.degrees(heading)) % 360.0
    return (
        f'        <{kind} id={quoteattr(name)} x="{front_x:.2f}" y="{front_y:.2f}" '
        f'angle="{angle:.2f}" speed="{v:.2f}" pos="{s:.2f}" '
        f'{where}slope="0.00" acceleration="{a:.2f}"/>'
    )


def _lane(road: RoadMap, lane: int) -> str:
    return road.lane_ids[lane] if lane >= 0 else ""
