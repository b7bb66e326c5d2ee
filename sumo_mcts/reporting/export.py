"""A trace in formats that other programs read: CSV, and SUMO's floating car data (FCD)."""

import math
from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import quoteattr

from sumo_mcts.records import CycleRecord, Row, Trace, write_table, write_whole
from sumo_mcts.road import RoadMap

COLUMNS = (
    "time_s", "vehicle", "role", "x_m", "y_m", "heading_rad", "v_mps", "a_mps2", "lane", "s_m",
    "d_m", "length_m", "width_m", "reason", "accel_mps2",
    "lane_change", "cost", "iterations",
)  # fmt: skip

# Letters that XML cannot hold, however they are written; tab and line break it can.
_NO_XML = dict.fromkeys({*range(0x20), 0xFFFE, 0xFFFF} - {0x09, 0x0A}, "?")


def write_csv(path: Path, trace: Trace, road: RoadMap) -> None:
    """Write a row for each cycle and vehicle, as the planner saw them, the ego first; the last
    columns hold the ego's decision. Raises OSError."""
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
    """Write a time step for each cycle, as SUMO does. Positions are the middle of the front bumper,
    angles degrees clockwise from north. The time is the one at which the step to that state began.
    Raises OSError."""
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
    yield f'    <timestep time="{cycle.time - cycle.step:.2f}">'
    yield from map(_element, (_ego_row(cycle, road), *_agent_rows(cycle, road)))
    yield "    </timestep>"


def _element(row: Row) -> str:
    """A line of FCD from a row of the CSV."""
    is_person = row["role"] == "person"
    kind = "person" if is_person else "vehicle"
    heading, to_front = row["heading_rad"], 0.0 if is_person else 0.5 * row["length_m"]
    x = row["x_m"] + to_front * math.cos(heading)
    y = row["y_m"] + to_front * math.sin(heading)
    lane = f"lane={quoteattr(row['lane'])} " if row["lane"] and not is_person else ""
    angle = (90.0 - math.degrees(heading)) % 360.0
    return (
        f'        <{kind} id={quoteattr(row["vehicle"])} x="{x:.2f}" y="{y:.2f}" '
        f'angle="{angle:.2f}" speed="{row["v_mps"]:.2f}" pos="{row["s_m"]:.2f}" '
        f'{lane}slope="0.00" acceleration="{row["a_mps2"]:.2f}"/>'
    )


def _lane(road: RoadMap, lane: int) -> str:
    return road.lane_ids[lane] if lane >= 0 else ""
