"""Scripted vehicles: their events compiled to a position at each step; and what SUMO would refuse
of a route."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats, Indices, Ints
from sumo_mcts.config import Actor, Depart, Event
from sumo_mcts.errors import ConfigError
from sumo_mcts.numerics.lanes import against_traffic, successors
from sumo_mcts.road import RoadMap
from sumo_mcts.world.roadmap import has_edge

ARRIVAL_SLACK = 0.1  # m before the end of its route at which SUMO takes a vehicle out
AT_REST = 0.01  # m/s
LATERAL_STANDING = 1.0  # m/s: SUMO's limit for going sideways is this plus the speed
SIDES = {"left": 1, "right": -1}
EPS = 1e-9


class Script(NamedTuple):
    """Where a scripted vehicle is, whatever happens.

    M rows, the first when it appears, one a step; the last before it leaves the map.
    """

    v: Floats  # [M] m/s, during the step that ends then
    lane: Ints  # [M] lane of the front
    s: Floats  # [M] lane position of the front, m
    d: Floats  # [M] offset from the lane's centre line, m, left positive
    # [M] a lane change that begins in the step that ends then: -1 right, 0 none, 1 left
    change: Ints


def compile_script(
    actor: Actor, road: RoadMap, step: float, seconds: float, change_s: float = 3.0
) -> Script:
    """What a scripted actor does until it leaves the map, at most `seconds`.

    `step` in s; a lane change takes `change_s` (SUMO's lanechange.duration), s. Raises ConfigError
    where its lane does not lead on along its route, or a lane change has no lane to go to.
    """
    check(actor, road)
    state = _start(actor, road)
    rows = [(state.v, state.lane, state.s, 0.0, 0)]
    for m in range(math.ceil(seconds / step)):
        state, begun = _obey(state, actor, road, m * step)
        moved = _moved(state, actor, road, step)
        if moved is None:
            break
        state, d = _shifted(moved, actor, road, step, change_s)
        rows.append((state.v, state.lane, state.s, d, begun))
    v, lane, s, offset, change = zip(*rows, strict=True)
    return Script(
        v=np.array(v),
        lane=np.array(lane, dtype=np.int32),
        s=np.array(s),
        d=np.array(offset),
        change=np.array(change, dtype=np.int32),
    )


# --- one step ---


class _State(NamedTuple):
    """A scripted vehicle between two steps."""

    v: float  # m/s
    lane: int
    s: float  # m
    edge: int  # position in its route of the edge that it is on or heads for
    driven: float  # m
    drive: "Drive"
    waiting: tuple[Event, ...]  # events to come
    side: int  # of the lane change under way: -1 right, 0 none, 1 left
    progress: float  # of that lane change, 0..1


def _start(actor: Actor, road: RoadMap) -> _State:
    lane = int(_lanes(road, actor.route[0])[actor.depart.lane])
    speed = actor.depart.speed_mps
    return _State(
        v=speed,
        lane=lane,
        s=actor.depart.pos_m,
        edge=0,
        driven=0.0,
        drive=Drive(speed, 0.0, 0.0, None),
        waiting=actor.events,
        side=0,
        progress=0.0,
    )


def _obey(state: _State, actor: Actor, road: RoadMap, time: float) -> tuple[_State, int]:
    """The state with the events that are due now, and the lane change that begins."""
    begun = 0
    kept = []
    for event in state.waiting:
        if not is_due(event, time, state.driven):
            kept.append(event)
        elif event.change_lane is None:
            state = state._replace(drive=after_event(state.drive, event, state.v))
        elif state.side or road.internal[state.lane]:
            kept.append(event)  # one after the other, and not inside a junction
        else:
            begun = SIDES[event.change_lane]
            state = state._replace(side=begun, progress=0.0)
            _beside(road, state.lane, begun, actor)
    return state._replace(waiting=tuple(kept)), begun


def _moved(state: _State, actor: Actor, road: RoadMap, step: float) -> _State | None:
    """One step along the route with the new speed, as SUMO's Euler step does; None once it has left
    the map."""
    drive = stood(state.drive, state.v, step)
    v = towards(drive.target or 0.0, state.v, drive.accel * step)
    lane, s, edge = state.lane, state.s + v * step, state.edge
    while s > road.length[lane]:
        if edge + 1 == len(actor.route):
            return None
        s -= float(road.length[lane])
        lane = _next_lane(road, lane, actor, edge)
        edge += not road.internal[lane]
    if (
        edge + 1 == len(actor.route)
        and not road.internal[lane]
        and s >= road.length[lane] - ARRIVAL_SLACK
    ):
        return None
    return state._replace(
        v=v, lane=lane, s=s, edge=edge, driven=state.driven + v * step, drive=drive
    )


def _next_lane(road: RoadMap, lane: int, actor: Actor, edge: int) -> int:
    """The lane after `lane` for a vehicle that leaves edge number `edge` of its route, with as much
    of the route ahead as possible."""
    route = [road.edge_ids.index(name) for name in actor.route]
    after = [i for i in successors(road, lane) if road.edge[road.exit[i]] == route[edge + 1]]
    if not after:
        raise ConfigError(
            f"traffic.actors: {actor.id}: {road.lane_ids[lane]} does not lead to "
            f"{actor.route[edge + 1]}; change lanes before"
        )
    return max(after, key=lambda i: _reach(road, int(road.exit[i]), route[edge + 2 :]))


def _reach(road: RoadMap, lane: int, route: list[int]) -> int:
    """How many of the edges to come can be driven from `lane` without a lane change."""
    lanes = {lane}
    for count, edge in enumerate(route):
        lanes = {
            int(road.exit[i])
            for each in lanes
            for i in successors(road, each)
            if road.edge[road.exit[i]] == edge
        }
        if not lanes:
            return count
    return len(route)


def _shifted(
    state: _State, actor: Actor, road: RoadMap, step: float, change_s: float
) -> tuple[_State, float]:
    """The state after a step of the lane change, if there is one, and the offset from the centre of
    its lane then, m."""
    if not state.side:
        return state, 0.0
    before, lane = state.progress, state.lane
    if before >= 0.5 and (road.right if state.side > 0 else road.left)[lane] < 0:
        # on a turn of one lane SUMO breaks it off: there is no lane to leave
        return state._replace(side=0, progress=0.0), 0.0
    other = _beside(road, lane, -state.side if before >= 0.5 else state.side, actor)
    apart = float(road.width[lane] + road.width[other]) / 2
    # SUMO goes sideways with the speed that takes change_s, less where the vehicle hardly moves
    progress = before + (
        min(step / change_s, (LATERAL_STANDING + state.v) * step / apart) if change_s > 0 else 1.0
    )
    if before < 0.5 <= progress:  # from here on SUMO counts the vehicle to the new lane
        lane = other
    if progress >= 1.0 - EPS:
        return state._replace(lane=lane, side=0, progress=0.0), 0.0
    return state._replace(lane=lane, progress=progress), state.side * apart * (
        progress - (progress >= 0.5)
    )


def _beside(road: RoadMap, lane: int, side: int, actor: Actor) -> int:
    """The lane to the left (1) or right (-1)."""
    lane_there = int((road.left if side > 0 else road.right)[lane])
    if lane_there < 0 or against_traffic(road)[lane_there]:
        raise ConfigError(
            f"traffic.actors: {actor.id}: change_lane: no lane {'left' if side > 0 else 'right'} "
            f"of {road.lane_ids[lane]}"
        )
    return lane_there


# --- events about speed, also of vehicles that SUMO drives ---


class Drive(NamedTuple):
    """The last order that a vehicle has about its speed."""

    target: float | None  # m/s, to be reached and kept; None: its driver decides
    accel: float  # m/s2, until that speed is reached
    stand: float  # s that it still has to stand
    resume: float | None  # target after that


def after_event(drive: Drive, event: Event, speed: float | None) -> Drive:
    """After a speed event; `speed` is the target to go back to after a stop."""
    if event.stop_for_s is not None:
        return Drive(
            0.0,
            event.accel_mps2,
            drive.stand + event.stop_for_s,
            drive.resume if drive.stand > 0 else speed,
        )
    if drive.stand > 0:
        return drive._replace(resume=event.slow_to_mps)
    return Drive(event.slow_to_mps, event.accel_mps2, 0.0, None)


def stood(drive: Drive, v: float, step: float) -> Drive:
    """At the end of its stop it gets its old target back."""
    if drive.stand <= 0 or v > AT_REST:
        return drive
    left = drive.stand - step
    return drive._replace(stand=left) if left > EPS else Drive(drive.resume, drive.accel, 0.0, None)


def towards(target: float, v: float, by: float) -> float:
    """The speed `v` moved to `target` by at most `by`, m/s."""
    return min(max(target, v - by), v + by)


def is_due(event: Event, time: float, driven: float) -> bool:
    """Whether its moment has come, `time` s and `driven` m after departure."""
    return time >= event.at_s - EPS if event.at_s is not None else driven >= (event.at_m or 0.0)


# --- what SUMO would refuse ---


def check(actor: Actor, road: RoadMap) -> None:
    """Raise ConfigError where SUMO would refuse the actor or, worse, wait for ever in silence."""
    check_path(f"traffic.actors: {actor.id}", actor.route, actor.depart, road)


def check_path(where: str, route: Sequence[str], depart: Depart, road: RoadMap) -> None:
    """Raise ConfigError where SUMO could insert no vehicle there for this route.

    `where`: the place in the scenario file that the message names.
    """
    for edge in route:
        has_edge(road, edge, f"{where}: route")
    for edge, following in pairwise(route):
        if not _connected(road, edge, following):
            raise ConfigError(f"{where}: route: no connection leads from {edge} to {following}")
    lanes = _lanes(road, route[0])
    if depart.lane >= len(lanes):
        raise ConfigError(
            f"{where}: depart.lane: {route[0]} has lanes 0 to {len(lanes) - 1}, got {depart.lane}"
        )
    lane = lanes[depart.lane]
    if depart.pos_m > road.length[lane]:
        raise ConfigError(
            f"{where}: depart.pos_m: {road.lane_ids[lane]} is {road.length[lane]:.1f} m long, got "
            f"{depart.pos_m:g}"
        )
    if depart.speed_mps > road.speed[lane]:
        raise ConfigError(
            f"{where}: depart.speed_mps: the limit on {road.lane_ids[lane]} is "
            f"{road.speed[lane]:g} m/s, got {depart.speed_mps:g}"
        )


def _connected(road: RoadMap, edge: str, following: str) -> bool:
    """Whether a lane of an edge leads onto another edge."""
    lanes = _lanes(road, edge)
    onto = road.edge_ids.index(following)
    return any(
        road.edge[road.exit[i]] == onto for lane in lanes for i in successors(road, int(lane))
    )


def _lanes(road: RoadMap, edge: str) -> Indices:
    """The lanes of an edge, in SUMO's order."""
    return np.flatnonzero((road.edge == road.edge_ids.index(edge)) & ~against_traffic(road))
