"""The sensor: makes of the true Scene what the ego perceives.

It adds errors that last, leaves out agents that are missed or hidden, and remembers agents seen
before. It also says which margins forecasts need for such errors. Planners get its Scene; the
referee's Frames stay true. The ego, the map and the signals are known without error.
"""

import math
import zlib
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats
from sumo_mcts.config import SensorConfig
from sumo_mcts.numerics.geometry import nearest
from sumo_mcts.prediction.drivers import TrafficParams
from sumo_mcts.prediction.forecast import Question, predict
from sumo_mcts.prediction.paths import LEAVES_FROM
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import STANDING, Agents, EgoState, Scene

SMOOTHING_S = 1.0  # of the error of an acceleration, which is derived from speeds
PLAIN_VIEW = 0.5  # share of an agent in view from which on it should be seen
CHANCE = 1e-4  # an agent is taken to be gone when missing it so often in a row is less likely
# standard deviations beyond which errors are neglected (one in fifty, to one side)
SURE = 2.0
EDGE = 1e-6  # m by which a box has to be nearer on a ray to hide another


class Sensor:
    """One ego's sensor.

    The error of an agent depends on seed, id and time alone, not on the planner or other agents.
    """

    def __init__(
        self, sensor: SensorConfig, road: RoadMap, period: float, seed: np.random.SeedSequence
    ) -> None:
        """`period`: s between two looks; errors change with each look."""
        self._sensor, self._road, self._period, self._seed = sensor, road, period, seed
        self._errors: dict[str, _Errors] = {}
        self._lost: dict[str, Lost] = {}
        self._last: Scene | None = None  # as perceived
        self._begin = 0.0

    def perceive(self, scene: Scene) -> Scene:
        """The scene as the sensor shows it. Without faults it is the true scene."""
        if not is_faulty(self._sensor):
            return scene
        if self._last is None:
            self._begin = scene.time
        elif scene.time == self._last.time:
            return self._last
        seen = self._seen(scene)
        self._last = scene._replace(
            agents=seen if self._last is None else self._with_remembered(self._last, scene, seen)
        )
        return self._last

    def _seen(self, scene: Scene) -> Agents:
        """The agents that the sensor shows now, with errors."""
        q, agents = self._sensor, scene.agents
        error, missed = self._drawn(scene)
        if q.occlusion:
            missed |= (
                share_in_view(scene.ego.x, scene.ego.y, agents, ~agents.person) < q.visible_share
            )
        return chosen(with_errors(self._road, agents, error), ~missed)

    def _drawn(self, scene: Scene) -> tuple[Floats, Bools]:
        """[N, 4] the errors that with_errors adds, and [N] which agents are dropped."""
        q, agents = self._sensor, scene.agents
        cycle, decay = (
            round((scene.time - self._begin) / self._period),
            math.exp(-self._period / q.error_time_s),
        )
        error, missed = np.zeros((len(agents.ids), 4)), np.zeros(len(agents.ids), np.bool_)
        for i, name in enumerate(agents.ids):
            if name not in self._errors:
                self._errors[name] = _Errors(self._seed, name)
            error[i], chance = self._errors[name].at(cycle, decay, self._period)
            missed[i] = chance < q.drop_probability
        return error * (
            q.position_error_m,
            q.position_error_m,
            q.speed_error_mps,
            q.speed_error_mps,
        ), missed

    def _with_remembered(self, last: Scene, scene: Scene, seen: Agents) -> Agents:
        """The agents seen now, and those seen before that may still be there."""
        q, now = self._sensor, set(seen.ids)
        before = chosen(
            last.agents, np.array([name not in now for name in last.agents.ids], np.bool_)
        )
        moved = moved_on(
            self._road, last._replace(agents=before), scene.time - last.time, aside_m(q)
        )
        expected = (
            share_past(scene.ego, seen, moved) >= max(PLAIN_VIEW, q.visible_share)
            if q.occlusion
            else np.ones(len(moved.ids), np.bool_)
        )
        lost = {}
        for i, name in enumerate(moved.ids):
            known = self._lost.get(name, Lost(last.time, 0))
            known = known._replace(missed=known.missed + int(expected[i]))
            near = math.dist((moved.x[i], moved.y[i]), (scene.ego.x, scene.ego.y)) <= q.range_m
            if (
                near
                and scene.time - known.since <= q.memory_s
                and q.drop_probability**known.missed >= CHANCE
            ):
                lost[name] = known
        self._lost = lost
        return together(
            seen, chosen(moved, np.array([name in lost for name in moved.ids], np.bool_))
        )


class Lost(NamedTuple):
    """A remembered agent."""

    since: float  # simulation time when it was last seen, s
    missed: int  # cycles since then in which it should have been in view


class _Errors:
    """The errors about one agent: a first-order autoregressive process.

    Their values depend on seed, name and cycle alone.
    """

    def __init__(self, seed: np.random.SeedSequence, name: str) -> None:
        own = np.random.SeedSequence(
            seed.entropy, spawn_key=(*seed.spawn_key, zlib.crc32(name.encode()))
        )
        self._rng = np.random.Generator(np.random.PCG64(own))
        self._error = self._rng.standard_normal(3)
        self._slope, self._chance, self._cycle = 0.0, self._rng.random(), 0

    def at(self, cycle: int, decay: float, period: float) -> tuple[Floats, float]:
        """[4] errors of x, y, v in standard deviations, and of the acceleration in those of v per
        s; and a random number in 0..1.

        The share `decay` of an error is left a cycle (of `period` s) later. Cycles have to be asked
        for in order.
        """
        while self._cycle < cycle:
            before = self._error
            self._error = decay * before + math.sqrt(
                1.0 - decay * decay
            ) * self._rng.standard_normal(3)
            self._slope += ((self._error[2] - before[2]) / period - self._slope) * (
                1.0 - math.exp(-period / SMOOTHING_S)
            )
            self._chance, self._cycle = self._rng.random(), self._cycle + 1
        return np.append(self._error, self._slope), self._chance


def aside_m(sensor: SensorConfig) -> float:
    """m off the centre line of its lane from which on a blinking vehicle has surely begun to
    leave it."""
    return max(LEAVES_FROM, SURE * sensor.position_error_m)


def room_m(sensor: SensorConfig) -> float:
    """The margin before and behind an agent within which its ends surely are, m."""
    return SURE * sensor.position_error_m


def is_faulty(sensor: SensorConfig) -> bool:
    """Whether the sensor may show anything but the truth."""
    return bool(
        sensor.position_error_m
        or sensor.speed_error_mps
        or sensor.drop_probability
        or sensor.occlusion
    )


# --- errors ---


def with_errors(road: RoadMap, agents: Agents, error: Floats) -> Agents:
    """The agents with errors [N, 4] of x, y (m), speed (m/s) and acceleration (m/s2).

    Lane, s and d follow from the wrong place. An agent that stands is seen to stand: its place does
    not change over time.
    """
    moves = agents.v > STANDING
    agents = agents._replace(
        x=agents.x + error[:, 0], y=agents.y + error[:, 1],
        v=np.where(moves, np.maximum(agents.v + error[:, 2], 0.0), agents.v),
        a=np.where(moves, agents.a + error[:, 3], agents.a),
        trend=np.where(moves, agents.trend + error[:, 3], agents.trend),
    )  # fmt: skip
    return matched(road, agents) if error[:, :2].any() else agents


def matched(road: RoadMap, agents: Agents) -> Agents:
    """The agents with lane, s and d computed from their poses.

    The lane is the one where the agent was, or the lane beside it whose middle is nearer to the
    agent's front. A tracker would know the lanes along which an agent came. So no agent jumps to
    lanes of another path, and none leaves the ends of its lane.
    """
    lane, s, d = agents.lane.copy(), agents.s.copy(), agents.d.copy()
    for i in np.flatnonzero(lane >= 0):
        x, y = _front(agents, int(i))
        here = int(lane[i])
        s[i], d[i] = on_lane(road, here, x, y)
        beside = int((road.left if d[i] > 0.0 else road.right)[here])
        if beside >= 0 and abs(d[i]) > 0.5 * road.width[here]:
            there, aside = on_lane(road, beside, x, y)
            if abs(aside) < abs(d[i]):
                lane[i], s[i], d[i] = beside, there, aside
    return agents._replace(lane=lane, s=s, d=d)


def on_lane(road: RoadMap, lane: int, x: float, y: float) -> tuple[float, float]:
    """Lane position s (m) and offset d (m, left positive) of a point, from the nearest place on a
    lane's centre line."""
    first, last = int(road.point_offset[lane]), int(road.point_offset[lane + 1])
    points, arc = road.points[first:last], road.point_s[first:last]
    along = np.diff(points, axis=0)
    share, away = nearest(points[:-1], along, x, y)
    k = int(np.argmin(away))
    span = max(float(arc[k + 1] - arc[k]), 1e-9)
    aside = float(along[k, 0] * (y - points[k, 1]) - along[k, 1] * (x - points[k, 0])) / span
    return float(arc[k] + share[k] * span) / float(road.scale[lane]), aside


def _front(agents: Agents, i: int) -> tuple[float, float]:
    half, heading = 0.5 * float(agents.length[i]), float(agents.heading[i])
    x, y = float(agents.x[i]), float(agents.y[i])
    return x + half * math.cos(heading), y + half * math.sin(heading)


# --- occlusion ---


def share_in_view(x: float, y: float, agents: Agents, blocks: Bools) -> Floats:
    """[N] the share of each agent that is in view from (x, y), by angle. The rest is behind the
    boxes of agents that block ([N]).

    Between the directions of two neighbouring corners boxes that do not overlap keep their order,
    so one ray for each such sector is exact.
    """
    if not len(agents.ids):
        return np.zeros(0)
    corner = np.sort(_corner_angles(x, y, agents))
    width = np.diff(corner, append=corner[0] + 2.0 * math.pi)
    enters = _ray_enters(x, y, corner + 0.5 * width, agents)
    hits = np.isfinite(enters)
    wall = np.where(blocks, enters, np.inf).min(axis=1, keepdims=True)
    spans, free = width @ hits, width @ (hits & (enters <= wall + EDGE))
    return np.where(spans > 0.0, free / np.maximum(spans, 1e-12), 1.0)


def _corner_angles(x: float, y: float, agents: Agents) -> Floats:
    """[4 N] directions of the boxes' corners."""
    c, s = np.cos(agents.heading), np.sin(agents.heading)
    u, v = (
        0.5 * np.multiply.outer(sides, size)
        for sides, size in (((1, 1, -1, -1), agents.length), ((1, -1, 1, -1), agents.width))
    )
    return np.arctan2(agents.y - y + u * s + v * c, agents.x - x + u * c - v * s).ravel()


def _ray_enters(x: float, y: float, angle: Floats, agents: Agents) -> Floats:
    """[R, N] the distance (m) at which a ray from (x, y) in each direction (rad, [R]) enters each
    box; inf where it misses the box."""
    c, s = np.cos(agents.heading), np.sin(agents.heading)
    dx, dy, cosine, sine = (
        x - agents.x,
        y - agents.y,
        np.cos(angle)[:, None],
        np.sin(angle)[:, None],
    )
    enters, leaves = np.zeros((len(angle), len(c))), np.full((len(angle), len(c)), np.inf)
    for start, along, half in (
        (dx * c + dy * s, cosine * c + sine * s, 0.5 * agents.length),
        (dy * c - dx * s, sine * c - cosine * s, 0.5 * agents.width),
    ):
        speed = np.where(np.abs(along) < 1e-12, 1e-12, along)
        one, other = (-half - start) / speed, (half - start) / speed
        enters, leaves = (
            np.maximum(enters, np.minimum(one, other)),
            np.minimum(leaves, np.maximum(one, other)),
        )
    return np.where(enters <= leaves, enters, np.inf)


# --- memory ---


def moved_on(road: RoadMap, scene: Scene, seconds: float, aside: float) -> Agents:
    """The agents of a scene some seconds later, without those that left the map.

    They keep their speed along their likeliest lanes. `aside`: see aside_m.
    """
    agents = scene.agents
    if not len(agents.ids):
        return agents
    keeps_speed = TrafficParams(
        step=seconds,
        headway=0.0,
        gap=0.0,
        accel=0.0,
        decel=0.0,
        yield_decel=0.0,
        yield_gap=0.0,
        stays_after=math.inf,
        persistence=0.0,
        euler=0.0,
        interacting=False,
        aside=aside,
    )
    forecast = predict(
        road, Question(scene, np.zeros(0, np.int32), np.zeros(0), keeps_speed, seconds)
    )
    pose, zero = forecast.pose[0, 1], np.zeros(len(agents.ids))
    just_stood = np.where(agents.standing_s < 0.0, agents.standing_s - seconds, 0.0)
    moved = agents._replace(
        x=pose[:, 0], y=pose[:, 1], heading=np.arctan2(pose[:, 3], pose[:, 2]), a=zero, trend=zero,
        lane=forecast.lane[0, 1], s=forecast.s[0, 1],
        standing_s=np.where(agents.v <= STANDING, agents.standing_s + seconds, just_stood),
    )  # fmt: skip
    return chosen(_still_aside(agents, matched(road, moved)), forecast.valid[0, 1])


def _still_aside(before: Agents, moved: Agents) -> Agents:
    """The moved agents. An agent that blinks and has begun to leave its lane is not moved back to
    the lane's middle."""
    side = np.where(moved.lane == before.lane, before.blinker, 0)
    back = side * np.maximum(side * (before.d - moved.d), 0.0)
    return moved._replace(
        x=moved.x - back * np.sin(moved.heading),
        y=moved.y + back * np.cos(moved.heading),
        d=moved.d + back,
    )


def share_past(ego: EgoState, seen: Agents, remembered: Agents) -> Floats:
    """[N] the share of each remembered agent that would be in view past the agents seen."""
    both = joined(seen, remembered)
    blocks = ~both.person & (np.arange(len(both.ids)) < len(seen.ids))
    return share_in_view(ego.x, ego.y, both, blocks)[len(seen.ids) :]


# --- tables of agents ---


def chosen(agents: Agents, which: Bools) -> Agents:
    """The agents that are marked, [N]."""
    return _rows(agents, np.flatnonzero(which).tolist())


def joined(some: Agents, others: Agents) -> Agents:
    """The agents of both, one after the other."""
    pairs: Any = zip(some[1:], others[1:], strict=True)
    return Agents(some.ids + others.ids, *(np.concatenate(pair) for pair in pairs))


def together(some: Agents, others: Agents) -> Agents:
    """The agents of both, sorted by id."""
    both = joined(some, others)
    return _rows(both, sorted(range(len(both.ids)), key=both.ids.__getitem__))


def _rows(agents: Agents, rows: list[int]) -> Agents:
    columns: tuple[Any, ...] = tuple(column[rows] for column in agents[1:])
    return Agents(tuple(agents.ids[i] for i in rows), *columns)
