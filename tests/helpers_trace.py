"""A synthetic episode: two crossing roads, the ego turns left through oncoming traffic. No SUMO."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.arrays import Floats
from sumo_mcts.records import CycleRecord, Lanes, Trace
from sumo_mcts.scene import (
    Agents,
    Decision,
    EgoState,
    Follow,
    Forecast,
    Plan,
    Release,
    RootChild,
    Signals,
)

PERIOD, STEP, FORECAST_DT, HORIZON = 0.5, 0.1, 0.2, 8.0
LANE_WIDTH, ARM, BOX = 3.2, 120.0, 11.0  # m: lane, arm length, half the junction

Path = NDArray[np.float64]  # [P, 2]


@cache
def crossing_trace(cycles: int = 36, others: int = 8, key: str = "crossing--mcts--7") -> Trace:
    """One cycle every 0.5 s.

    The ego comes from the south, waits in the junction for a gap, and leaves to the west.
    """
    path = _left_turn()
    speeds = _ego_speeds(cycles)
    along = np.concatenate([[62.0], 62.0 + np.cumsum(speeds) * STEP])
    actors = _actors(others)
    records = tuple(_cycle(i, cycles, path, along, speeds, actors) for i in range(cycles))
    return Trace(key, "crossing", "arrived", _lanes(), records)


@cache
def highway_trace(cycles: int = 30) -> Trace:
    """Three lanes to the east; the ego changes to the left behind a slower vehicle.

    Too long for one window.
    """
    w = LANE_WIDTH
    path = np.array(
        [
            [0.0, 0.5 * w],
            [150.0, 0.5 * w],
            [160.0, 0.6 * w],
            [215.0, 1.4 * w],
            [225.0, 1.5 * w],
            [1000.0, 1.5 * w],
        ]
    )
    speeds = np.full(round(cycles * PERIOD / STEP) + 60, 25.0)
    along = np.concatenate([[62.0], 62.0 + np.cumsum(speeds) * STEP])
    rows = [_line((0.0, (lane + 0.5) * w), (1000.0, (lane + 0.5) * w)) for lane in range(3)]
    actors = [
        (
            rows[i % 3],
            40.0 + 47.0 * i,
            (19.0, 26.0, 31.0)[i % 3],
            12.0 if i == 3 else 4.6,
            f"car.{i:02d}",
        )
        for i in range(9)
    ]
    records = tuple(_cycle(i, cycles, path, along, speeds, actors) for i in range(cycles))
    lanes = Lanes(
        lane_ids=tuple(f"motorway_{lane}" for lane in range(3)),
        points=np.concatenate(rows),
        offset=np.array([0, 2, 4, 6], dtype=np.int32),
        width=np.full(3, w),
        internal=np.zeros(3, dtype=np.bool_),
        route=np.ones(3, dtype=np.bool_),
        stop_lines=np.zeros((0, 4)),
    )
    return Trace("highway--mcts--1", "highway", "collision", lanes, records)


@cache
def busy_trace(cycles: int = 120, others: int = 30) -> Trace:
    """A trace as large as that of an episode of a minute.

    It has forecasts of 30 agents, which turn and brake, each in another manner.
    """
    rng = np.random.default_rng(1)
    trace = crossing_trace(cycles, 8, "busy--mcts--1")
    return trace._replace(
        cycles=tuple(
            cycle._replace(
                agents=_crowd(cycle.agents, others), forecast=_busy_forecast(rng, others)
            )
            for cycle in trace.cycles
        )
    )


def _crowd(agents: Agents, count: int) -> Agents:
    """`count` agents: the given ones, repeated."""
    copied = Agents(*(np.resize(column, count) for column in agents))
    return copied._replace(ids=tuple(f"car.{i:02d}" for i in range(count)))


def _busy_forecast(rng: np.random.Generator, others: int) -> Forecast:
    t = FORECAST_DT * np.arange(50)[:, None]
    heading = rng.uniform(-3.0, 3.0, others) + rng.choice([0.0, 0.1], others) * t
    v = np.maximum(rng.uniform(0.0, 14.0, others) + rng.uniform(-2.0, 2.0, others) * t, 0.0)
    s = rng.uniform(0.0, 300.0, others) + np.cumsum(v, axis=0) * FORECAST_DT
    pose = np.stack(
        [
            300.0 + s * np.cos(heading),
            300.0 + s * np.sin(heading),
            np.cos(heading),
            np.sin(heading),
        ],
        axis=-1,
    )
    half, flags, valid = (
        np.full(others, 1.0),
        np.zeros(others, dtype=np.bool_),
        np.ones((1, 50, others), dtype=np.bool_),
    )
    return Forecast(
        FORECAST_DT,
        np.ones(1),
        pose[None],
        v[None],
        valid.astype(np.int32),
        s[None],
        valid,
        half,
        half,
        flags,
        flags[None],
    )


def _cycle(
    i: int,
    cycles: int,
    path: Path,
    along: Floats,
    speeds: Floats,
    actors: list[tuple[Path, float, float, float, str]],
) -> CycleRecord:
    k = round(i * PERIOD / STEP)
    time = i * PERIOD
    x, y, heading = _pose(path, along[k])
    accel = float(speeds[k + 5] - speeds[k]) / PERIOD
    ego = EgoState(
        id="ego", x=x, y=y, heading=heading, v=float(speeds[k]), a=accel, lane=2,
        s=float(along[k]), d=0.0, length=5.0, width=1.8,
        max_accel=2.6, comfort_decel=4.5, emergency_decel=9.0, max_speed=50.0, speed_factor=1.0,
        vclass=0, route=(0, 3),
        changing=0.0, change_to=2, change_from=-1,
    )  # fmt: skip
    agents = _agents(actors, time)
    children, chosen = _children(path, float(along[k]), float(speeds[k]), accel)
    steps = np.arange(1, 1 + round(PERIOD / STEP))
    plan = Plan(
        STEP * np.arange(1.0, 51.0),
        speeds[k + 1 : k + 51],
        np.full(50, 2, dtype=np.int32),
        along[k + 1 : k + 51],
        _poses(path, along[k + 1 : k + 51]),
    )
    released = i == cycles - 1
    last = i + 1 == cycles
    decision = Decision(
        command=Release() if released else Follow(speeds[k + steps], 0),
        plan=None if released else plan,
        children=() if released else children,
        chosen=-1 if released else chosen,
        reason="release" if released else "search",
        iterations=0 if released else 1000,
        known=3 * i,
    )
    return CycleRecord(
        time=time,
        step=STEP,
        ego=ego,
        agents=agents,
        signals=Signals(
            np.array([0, 2], dtype=np.int32),
            np.zeros((2, 3), dtype=np.int32),
            np.array([[4.0, 7.0, np.inf]]),
        ),
        forecast=_forecast(actors, agents, time),
        decision=decision,
        plan_ms=12.5,
        commanded_speed=float(speeds[k + 5]),
        executed_speed=float("nan") if last else float(speeds[k + 5]),
        commanded_lane=2,
        executed_lane=-1 if last else 2,
        deviation="" if i != 3 else "SUMO kept the lane",
    )


def _children(
    path: Path, along: float, v: float, accel: float
) -> tuple[tuple[RootChild, ...], int]:
    """The actions at the root, and which is chosen: the one nearest to the acceleration `accel`.

    It has the most visits.
    """
    tried = np.array([-8.0, -4.5, -3.0, -2.0, -1.0, 0.0, 1.0, 2.6])
    chosen = int(np.argmin(np.abs(tried - accel)))
    time = STEP * np.arange(1.0, 51.0)
    children = []
    for i, a in enumerate(tried):
        moved = np.cumsum(np.maximum(v + a * np.minimum(time, 2.0), 0.0)) * STEP
        lost = abs(i - chosen) > 4
        children.append(
            RootChild(
                accel=float(a),
                lane_change=0,
                visits=int(600 * np.exp(-abs(i - chosen))),
                mean=float(1 + abs(i - chosen)),
                best=float("inf") if lost else float(abs(i - chosen)),
                terms=np.arange(5.0),
                poses=np.zeros((0, 4)) if lost else _poses(path, along + moved),
            )
        )
    return tuple(children), chosen


def _forecast(
    actors: list[tuple[Path, float, float, float, str]], agents: Agents, time: float
) -> Forecast:
    times = np.arange(0.0, HORIZON + 1e-9, FORECAST_DT)
    by_id = {actor[4]: actor for actor in actors}
    present = [by_id[name] for name in agents.ids]
    along = np.array(
        [[start + v * (time + t) for path, start, v, _, _ in present] for t in times]
    ).reshape(len(times), len(present))
    pose = np.zeros((1, len(times), len(present), 4))
    for n, actor in enumerate(present):
        pose[0, :, n] = _poses(actor[0], along[:, n])
    return Forecast(
        dt=FORECAST_DT,
        weight=np.ones(1),
        pose=pose,
        v=np.tile(agents.v, (1, len(times), 1)),
        lane=np.tile(agents.lane, (1, len(times), 1)),
        s=along[None],
        valid=(along < [_length(actor[0]) for actor in present])[None],
        half_length=agents.length / 2,
        half_width=agents.width / 2,
        reacts=np.zeros(len(present), dtype=np.bool_),
        yields=np.zeros((1, len(present)), dtype=np.bool_),
    )


def _agents(actors: list[tuple[Path, float, float, float, str]], time: float) -> Agents:
    """The agents that are between the ends of their road at `time`."""
    here = sorted(
        (a for a in actors if 0 <= a[1] + a[2] * time <= _length(a[0])), key=lambda actor: actor[4]
    )
    count = len(here)
    poses = np.array([_pose(path, start + v * time) for path, start, v, _, _ in here]).reshape(
        count, 3
    )
    return Agents(
        ids=tuple(actor[4] for actor in here),
        x=poses[:, 0],
        y=poses[:, 1],
        heading=poses[:, 2],
        v=np.array([v for _, _, v, _, _ in here]),
        a=np.array([-2.0 if i % 5 == 2 else 0.0 for i in range(count)]),
        trend=np.zeros(count),
        length=np.array([length for _, _, _, length, _ in here]),
        width=np.full(count, 1.9),
        lane=np.full(count, 3, dtype=np.int32),
        s=np.array([start + v * time for _, start, v, _, _ in here]),
        d=np.zeros(count),
        blinker=np.zeros(count, dtype=np.int32),
        standing_s=np.zeros(count),
        person=np.zeros(count, dtype=np.bool_),
        vclass=np.zeros(count, dtype=np.int32),
    )


def _actors(count: int) -> list[tuple[Path, float, float, float, str]]:
    """(path, position at time 0, m/s, length, id) of each actor.

    Half of them come towards the ego. The others drive behind it or on the crossing road.
    """
    w = LANE_WIDTH
    south, north = _line((-1.5 * w, ARM), (-1.5 * w, -ARM)), _line((1.5 * w, -ARM), (1.5 * w, ARM))
    west = _line((ARM, 0.5 * w), (-ARM, 0.5 * w))
    rng = np.random.default_rng(5)
    result = []
    for i in range(count):
        path = (south, south, north, west)[i % 4]
        start = (75.0, 47.0, 95.0, -60.0)[i % 4] - 80.0 * (i // 4)
        result.append(
            (
                path,
                start,
                float(rng.uniform(8.5, 9.5)),
                9.0 if i == 1 else float(rng.uniform(4.2, 5.0)),
                f"car.{i:02d}",
            )
        )
    return result


def _ego_speeds(cycles: int) -> Floats:
    """[steps] m/s: the ego approaches, waits for about four seconds in the junction, then goes."""
    count = round(cycles * PERIOD / STEP) + 60
    speeds, v = [], 10.0
    for k in range(count):
        t = k * STEP
        a = 0.0 if t < 1.0 else -1.25 if t < 9.0 else 1.8
        v = min(max(v + a * STEP, 0.0), 10.0)
        speeds.append(v)
    return np.array(speeds)


def _left_turn() -> Path:
    w = LANE_WIDTH
    angle = np.linspace(0.0, np.pi / 2, 25)
    radius = BOX + 0.5 * w
    arc = np.stack([-BOX + radius * np.cos(angle), -BOX + radius * np.sin(angle)], axis=1)
    return np.concatenate([[[0.5 * w, -ARM]], arc, [[-ARM, 0.5 * w]]])


def _length(path: Path) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _line(start: tuple[float, float], end: tuple[float, float]) -> Path:
    return np.array([start, end])


def _poses(path: Path, along: Floats) -> Floats:
    """[M, 4] centre x, y, cos, sin at these positions of the path, straight on beyond its ends."""
    steps = np.diff(path, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    starts = np.concatenate([[0.0], np.cumsum(lengths)])
    i = np.clip(np.searchsorted(starts, along, side="right") - 1, 0, len(lengths) - 1)
    unit = steps[i] / lengths[i, None]
    return np.column_stack([path[i] + unit * (along - starts[i])[:, None], unit])


def _pose(path: Path, along: float) -> tuple[float, float, float]:
    """x, y, heading at a position of the path."""
    x, y, cos, sin = _poses(path, np.array([along]))[0].tolist()
    return x, y, float(np.arctan2(sin, cos))


def _lanes() -> Lanes:
    """Four arms with two lanes in each direction, and lanes straight on and left in the
    junction."""
    w, shapes = LANE_WIDTH, []
    for quarter in range(4):
        turn = np.array(
            [
                [np.cos(quarter * np.pi / 2), np.sin(quarter * np.pi / 2)],
                [-np.sin(quarter * np.pi / 2), np.cos(quarter * np.pi / 2)],
            ]
        )
        for lane, offset in enumerate((0.5 * w, 1.5 * w)):
            shapes.append(
                (
                    f"in{quarter}_{1 - lane}",
                    _line((offset, -ARM), (offset, -BOX)) @ turn,
                    False,
                    quarter == 0,
                )
            )
            shapes.append(
                (
                    f"out{quarter}_{1 - lane}",
                    _line((-offset, -BOX), (-offset, -ARM)) @ turn,
                    False,
                    quarter == 3,
                )
            )
            shapes.append(
                (f":c_{quarter}_{lane}", _line((offset, -BOX), (offset, BOX)) @ turn, True, False)
            )
        shapes.append((f":c_{quarter}_left", _left_turn()[1:-1] @ turn, True, quarter == 0))
    ends = [
        (shape[-1], _across(shape) * w / 2) for name, shape, _, _ in shapes if name.startswith("in")
    ]
    return Lanes(
        lane_ids=tuple(name for name, _, _, _ in shapes),
        points=np.concatenate([shape for _, shape, _, _ in shapes]),
        offset=np.cumsum([0, *(len(shape) for _, shape, _, _ in shapes)], dtype=np.int32),
        width=np.full(len(shapes), w),
        internal=np.array([internal for _, _, internal, _ in shapes]),
        route=np.array([route for _, _, _, route in shapes]),
        stop_lines=np.array([np.concatenate([end + side, end - side]) for end, side in ends]),
    )


def _across(shape: Path) -> Floats:
    along = (shape[-1] - shape[-2]) / np.linalg.norm(shape[-1] - shape[-2])
    return np.array([-along[1], along[0]])
