"""Small road maps and frames made by hand, for tests that need no SUMO."""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from math import atan2, cos, hypot, nan, pi, sin
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Ints
from sumo_mcts.road import PRIORITY, STRAIGHT, VEHICLE_CLASSES, RoadMap
from sumo_mcts.scene import GREEN, Agents, EgoState, Frame, Signals
from sumo_mcts.world.links import junction_clusters

ALL_CLASSES = 2**33 - 1


class Lane(NamedTuple):
    """One lane of a map to be built; its id is EDGE_NUMBER."""

    edge: str
    number: int  # within the edge, 0 = rightmost
    points: Sequence[tuple[float, float]]
    after: Sequence[str] = ()  # ids of the lanes driven next
    speed: float = 15.0
    width: float = 3.2
    junction: str = ""  # makes it an internal lane
    signal: str = ""  # id of the signal that controls the lane, and its link
    link: int = -1
    rule: int = PRIORITY
    direction: int = STRAIGHT
    classes: int = ALL_CLASSES
    change_left: int = ALL_CLASSES
    change_right: int = ALL_CLASSES


class Conflict(NamedTuple):
    """A shared stretch; build() makes the entries of both lanes."""

    lane: str
    begin: float
    end: float
    other: str
    other_begin: float
    other_end: float
    merge: bool = False
    yields: str = ""  # id of the lane that has to let the other pass; "" neither


def build(lanes: Sequence[Lane], conflicts: Sequence[Conflict] = ()) -> RoadMap:
    """A RoadMap of the lanes, in their order; lane lengths are those of the shapes."""
    ids = [f"{lane.edge}_{lane.number}" for lane in lanes]
    number = {name: i for i, name in enumerate(ids)}
    edges = list(dict.fromkeys(lane.edge for lane in lanes))
    begins, ends = _joints(lanes)
    junctions = list(
        dict.fromkeys(
            [*(lane.junction for lane in lanes if lane.junction), *begins.values(), *ends.values()]
        )
    )
    signals = list(dict.fromkeys(lane.signal for lane in lanes if lane.signal))
    shapes = [np.array(lane.points, dtype=np.float64) for lane in lanes]
    arcs = [
        np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(shape, axis=0).T))]) for shape in shapes
    ]
    length = np.array([arc[-1] for arc in arcs])

    def leads_to(lane: Lane) -> int:
        while lane.junction and lane.after:
            lane = lanes[number[lane.after[0]]]
        return number[f"{lane.edge}_{lane.number}"]

    both = [
        *conflicts,
        *(
            Conflict(c.other, c.other_begin, c.other_end, c.lane, c.begin, c.end, c.merge, c.yields)
            for c in conflicts
        ),
    ]
    both.sort(key=lambda c: number[c.lane])
    return RoadMap(
        lane_ids=tuple(ids),
        edge_ids=tuple(edges),
        junction_ids=tuple(junctions),
        signal_ids=tuple(signals),
        lefthand=False,
        edge=_ints(edges.index(lane.edge) for lane in lanes),
        index=_ints(lane.number for lane in lanes),
        internal=np.array([bool(lane.junction) for lane in lanes]),
        length=length,
        scale=np.ones(len(lanes)),
        width=np.array([lane.width for lane in lanes]),
        speed=np.array([lane.speed for lane in lanes]),
        classes=np.array([lane.classes for lane in lanes], dtype=np.uint64),
        change_left=np.array([lane.change_left for lane in lanes], dtype=np.uint64),
        change_right=np.array([lane.change_right for lane in lanes], dtype=np.uint64),
        class_row=np.full(len(VEHICLE_CLASSES), -1, dtype=np.int32),
        class_speed=np.zeros((0, len(lanes))),
        left=_ints(number.get(f"{lane.edge}_{lane.number + 1}", -1) for lane in lanes),
        right=_ints(number.get(f"{lane.edge}_{lane.number - 1}", -1) for lane in lanes),
        point_offset=_offsets(len(shape) for shape in shapes),
        points=np.concatenate(shapes),
        point_s=np.concatenate(arcs),
        successor_offset=_offsets(len(lane.after) for lane in lanes),
        successor=_ints(number[name] for lane in lanes for name in lane.after),
        exit=_ints(leads_to(lane) for lane in lanes),
        direction=_ints(lane.direction for lane in lanes),
        junction=_ints(junctions.index(lane.junction) if lane.junction else -1 for lane in lanes),
        **junction_clusters(
            np.array([bool(lane.junction) for lane in lanes]),
            length,
            *(
                _ints(
                    junctions.index(lane.junction or joints.get(lane.edge, ""))
                    if lane.junction or lane.edge in joints
                    else -1
                    for lane in lanes
                )
                for joints in (begins, ends)
            ),
        ),
        rule=_ints(lane.rule for lane in lanes),
        signal=_ints(signals.index(lane.signal) if lane.signal else -1 for lane in lanes),
        link=_ints(lane.link for lane in lanes),
        conflict_offset=_offsets(sum(c.lane == name for c in both) for name in ids),
        conflict_lane=_ints(number[c.other] for c in both),
        conflict_begin=np.array([c.begin for c in both], dtype=np.float64),
        conflict_end=np.array([c.end for c in both], dtype=np.float64),
        conflict_other_begin=np.array([c.other_begin for c in both], dtype=np.float64),
        conflict_other_end=np.array([c.other_end for c in both], dtype=np.float64),
        conflict_merge=np.array([c.merge for c in both], dtype=np.bool_),
        conflict_yields=np.array([c.yields == c.lane for c in both], dtype=np.bool_),
    )


def _joints(lanes: Sequence[Lane]) -> tuple[dict[str, str], dict[str, str]]:
    """The junctions at which edges begin and at which they end.

    Where lanes join without a junction, the joint is named after the edge before it.
    """
    begins: dict[str, str] = {}
    ends: dict[str, str] = {}
    by_id = {f"{lane.edge}_{lane.number}": lane for lane in lanes}
    for lane in lanes:
        for after in (by_id[name] for name in lane.after):
            joint = lane.junction or after.junction or f"{lane.edge}|"
            ends.setdefault(lane.edge, joint)
            begins.setdefault(after.edge, joint)
    return begins, ends


def _ints(values: Iterable[int]) -> Ints:
    return np.array(list(values), dtype=np.int32)


def _offsets(counts: Iterable[int]) -> Ints:
    return np.concatenate([[0], np.cumsum(list(counts))]).astype(np.int32)


def straight_road(length: float = 200.0, speed: float = 15.0) -> RoadMap:
    """Two lanes eastward: edge a (x from 0), junction m (10 m), edge b, junction n (10 m), edge c;
    lane 1 (left) at y = 0, lane 0 at y = -3.2.

    A side road d leaves a_0 through m southward and leads nowhere.
    """
    lanes, x = [], 0.0
    for here, inside, after, junction in (
        ("a", ":m", "b", "m"),
        ("b", ":n", "c", "n"),
        ("c", "", "", ""),
    ):
        for k, y in ((0, -3.2), (1, 0.0)):
            turn = (":mr_0",) if (here, k) == ("a", 0) else ()
            lanes.append(
                Lane(
                    here,
                    k,
                    ((x, y), (x + length, y)),
                    (f"{inside}_{k}", *turn) if inside else (),
                    speed,
                )
            )
        if inside:
            lanes += [
                Lane(
                    inside,
                    k,
                    ((x + length, y), (x + length + 10, y)),
                    (f"{after}_{k}",),
                    speed,
                    junction=junction,
                )
                for k, y in ((0, -3.2), (1, 0.0))
            ]
        x += length + 10
    lanes.append(
        Lane(
            ":mr",
            0,
            ((length, -3.2), (length + 5, -5.2), (length + 7, -10.2)),
            ("d_0",),
            8.0,
            junction="m",
        )
    )
    lanes.append(Lane("d", 0, ((length + 7, -10.2), (length + 7, -110.2))))
    return build(lanes)


def crossing(signal: str = "", bridge: bool = True) -> RoadMap:
    """West-east road (wi -> :we -> eo, y = -1.6) that has priority over south-north (si -> :sn ->
    no, x = 1.6); :wn turns left from wi into no.

    Arms of 90 m end 10 m from the middle (0, 0). Links of the signal, if any: 0 :we, 1 :sn, 2 :wn.
    A bridge (br, northward at x = 50) crosses eo.
    """
    left = [(-10.0, -1.6), (-4.0, -0.8), (0.8, 4.0), (1.6, 10.0)]
    lanes = [
        Lane("wi", 0, ((-100, -1.6), (-10, -1.6)), (":we_0", ":wn_0")),
        Lane("si", 0, ((1.6, -100), (1.6, -10)), (":sn_0",)),
        Lane("eo", 0, ((10, -1.6), (100, -1.6))),
        Lane("no", 0, ((1.6, 10), (1.6, 100))),
        Lane(
            ":we",
            0,
            ((-10, -1.6), (10, -1.6)),
            ("eo_0",),
            junction="c",
            signal=signal,
            link=0 if signal else -1,
        ),
        Lane(
            ":sn",
            0,
            ((1.6, -10), (1.6, 10)),
            ("no_0",),
            junction="c",
            signal=signal,
            link=1 if signal else -1,
        ),
        Lane(":wn", 0, left, ("no_0",), 8.0, junction="c", signal=signal, link=2 if signal else -1),
    ]
    if bridge:
        lanes.append(Lane("br", 0, ((50, -100), (50, 100))))
    turn = sum(hypot(q[0] - p[0], q[1] - p[1]) for p, q in pairwise(left))
    return build(
        lanes,
        [
            Conflict(":we_0", 9.4, 13.8, ":sn_0", 6.2, 10.6, yields=":sn_0"),
            Conflict(":wn_0", turn - 8, turn, ":sn_0", 12.0, 20.0, merge=True, yields=":sn_0"),
        ],
    )


def lane(road: RoadMap, name: str) -> int:
    return road.lane_ids.index(name)


def edge(road: RoadMap, name: str) -> int:
    return road.edge_ids.index(name)


def edges(road: RoadMap, *names: str) -> tuple[int, ...]:
    return tuple(road.edge_ids.index(name) for name in names)


def place(
    road: RoadMap, name: str, s: float, length: float, d: float = 0.0
) -> tuple[float, float, float]:
    """Centre x, y and heading of a box with its front at lane position s, d m left of the centre
    line. The heading is that of the lane at the front."""
    k = lane(road, name)
    shape = road.points[road.point_offset[k] : road.point_offset[k + 1]]
    arc = road.point_s[road.point_offset[k] : road.point_offset[k + 1]]
    at = s * float(road.scale[k])
    i = min(max(int(np.searchsorted(arc, at, side="right")) - 1, 0), len(arc) - 2)
    heading = atan2(shape[i + 1, 1] - shape[i, 1], shape[i + 1, 0] - shape[i, 0])
    ahead = at - float(arc[i]) - length / 2
    return (
        float(shape[i, 0]) + ahead * cos(heading) - d * sin(heading),
        float(shape[i, 1]) + ahead * sin(heading) + d * cos(heading),
        heading,
    )


def ego_at(
    road: RoadMap,
    name: str,
    s: float,
    v: float = 10.0,
    d: float = 0.0,
    route: tuple[int, ...] = (),
    length: float = 5.0,
    width: float = 1.8,
) -> EgoState:
    """A passenger car as ego; change further fields with _replace."""
    x, y, heading = place(road, name, s, length, d)
    k = lane(road, name)
    return EgoState(
        id="ego", x=x, y=y, heading=heading, v=v, a=0.0, lane=k, s=s, d=d, length=length,
        width=width, max_accel=2.6, comfort_decel=4.5, emergency_decel=9.0,
        max_speed=50.0, speed_factor=1.0, vclass=0, route=route or (int(road.edge[k]),),
        changing=0.0, change_to=-1, change_from=-1,
    )  # fmt: skip


class Agent(NamedTuple):
    """One agent by lane position; on="" puts a pedestrian at (x, y)."""

    id: str
    on: str
    s: float = 0.0
    v: float = 10.0
    d: float = 0.0
    length: float = 5.0
    width: float = 1.8
    x: float = 0.0
    y: float = 0.0
    heading: float = pi / 2


def agents_at(road: RoadMap, *those: Agent) -> Agents:
    """Agents sorted by id."""
    those = tuple(sorted(those))
    poses = [
        place(road, a.on, a.s, a.length, a.d) if a.on else (a.x, a.y, a.heading) for a in those
    ]
    x, y, heading = np.array(poses, dtype=np.float64).reshape(-1, 3).T.copy()

    def column(values: Sequence[float]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return np.array(values, dtype=np.float64)

    return Agents(
        ids=tuple(a.id for a in those),
        x=x,
        y=y,
        heading=heading,
        v=column([a.v for a in those]),
        a=np.zeros(len(those)),
        trend=np.zeros(len(those)),
        length=column([a.length for a in those]),
        width=column([a.width for a in those]),
        lane=_ints(lane(road, a.on) if a.on else -1 for a in those),
        s=column([a.s for a in those]),
        d=column([a.d for a in those]),
        blinker=np.zeros(len(those), np.int32),
        standing_s=np.zeros(len(those)),
        person=np.array([not a.on for a in those], dtype=np.bool_),
        vclass=np.zeros(len(those), np.int32),
    )


def lights(*states: int) -> Signals:
    """One signal with these states of its links, for an unknown time; without states: no signal."""
    q = 1 if states else 0
    return Signals(
        _ints([0, len(states)] if states else [0]),
        np.array(states, dtype=np.int32).reshape(-1, 1),
        np.full((q, 1), np.inf),
    )


def frame_of(
    road: RoadMap, time: float, ego: EgoState, *agents: Agent, signals: Signals | None = None
) -> Frame:
    """A frame without collisions, leaders and paths of agents.

    Change further fields with _replace.
    """
    agents_now = agents_at(road, *agents)
    links = int(road.link.max()) + 1
    n = len(agents_now.ids)
    shown = signals or lights(*([GREEN] * links))
    return Frame(
        time=time, ego=ego, present=True, agents=agents_now,
        signals=shown, green=shown.state[:, 0] == GREEN, leader=("",) * n,
        paths=(np.zeros(0, np.int32),) * n, collisions=(), collision_type="", teleported=False,
        arrived=False, ttc=nan, pet=nan, drac=nan,
    )  # fmt: skip
