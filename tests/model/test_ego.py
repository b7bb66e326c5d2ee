"""How the ego moves under an action: bounds, limits, stop lines and lane changes."""

import math
from collections.abc import Sequence

import naive
import numpy as np
import pytest
from helpers import Lane, build, edges, ego_at, lights
from helpers_model import PHYSICS, lanes_east, local_of, road_with_light, scenario, scene_of, task_of
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts.driver import Physics
from sumo_mcts.model.ego import FREE, GOAL, RED_LINE, EgoParams, advance, begin_change, can_change, follow_accel, pose_of
from sumo_mcts.model.local import Local, State
from sumo_mcts.planners.base import Task
from sumo_mcts.scene import GREEN, RED, RoadMap, Signals

LIMIT = 15.0
actions = st.lists(st.sampled_from([-8.0, -4.5, -3.0, -1.0, 0.0, 1.0, 2.6, 99.0]), min_size=1, max_size=8)
speeds = st.floats(0.0, LIMIT)
physics = st.sampled_from([PHYSICS, Physics(0.1, True, 3.0), Physics(0.05, False, 3.0), Physics(0.5, True, 0.0), Physics(1.0, False, 3.0)])


def drive(local: Local, p: EgoParams, state: State, accelerations: Sequence[float], seconds: float = 1.0, time: float = 0.0) -> list[tuple[State, int]]:
    """The states of every step, each action held for `seconds`; until something happens."""
    states = []
    for accel in accelerations:
        for _ in range(max(1, round(seconds / p.step))):
            state, event = advance(local, p, state, accel, time)
            time += p.step
            states.append((state, event))
            if event != FREE:
                return states
    return states


def on_road(road: RoadMap, s: float, v: float, moves: Physics = PHYSICS, name: str = "a_0", *, signals: Signals | None = None, route: tuple[str, ...] = ()) -> tuple[
    Task, Local, State
]:
    """An ego alone."""
    ego = ego_at(road, name, s, v, route=edges(road, *(route or road.edge_ids[:1])))
    task = task_of(road, ego, physics=moves)
    local, state = local_of(task, scene_of(ego, road, signals=signals, step=moves.step))
    return task, local, state


def test_no_bound_is_broken_on_a_road_of_many_limits_probe() -> None:
    assert True


limits = st.lists(st.floats(4.0, 30.0), min_size=3, max_size=6)
lengths = st.lists(st.floats(1.0, 80.0), min_size=6, max_size=6)


def patchwork(limits: Sequence[float], lengths: Sequence[float]) -> RoadMap:
    """Edges with these limits; the first and last are long."""
    x, lanes = 0.0, []
    for k, limit in enumerate(limits):
        length = 200.0 if k in (0, len(limits) - 1) else lengths[k]
        lanes.append(Lane(f"e{k}", 0, ((x, 0.0), (x + length, 0.0)), (f"e{k + 1}_0",) if k + 1 < len(limits) else (), speed=limit))
        x += length
    return build(lanes)


@given(limits, lengths, st.floats(0.0, 1.0), actions, physics)
def test_bounds_and_limits_hold(limits: list[float], lengths: list[float], share: float, accelerations: list[float], moves: Physics) -> None:
    """Never backwards, never braking or accelerating beyond the bounds, never above a limit by more than 0.1 m/s; jerk within bounds except at a stand."""
    road = patchwork(limits, lengths)
    task, local, state = on_road(road, 20.0, 0.0, moves, "e0_0", route=road.edge_ids)
    p, route = task.ego, task.route
    state = state._replace(v=share * float(route.cap[20]))
    done = 0.0
    worst = 0.0
    for after, event in drive(local, p, state, accelerations, 2.0):
        assert after.v >= 0.0
        now = float(route.station[after.node]) + after.s
        assert now >= done
        done = now
        assert -p.max_decel - 1e-9 <= after.a <= p.max_accel + 1e-9
        assert after.v <= route.limit[after.node] + 0.1, ("limit", after.v, route.limit[after.node], p.step)
        if after.v > 0.0 and event != GOAL:
            jerk = (after.a - state.a) / p.step
            bound = p.emergency_jerk if min(after.a, state.a) < -p.comfort_decel else p.jerk
            worst = max(worst, abs(jerk) / bound)
            assert abs(jerk) <= bound + 1e-6, ("jerk", jerk, state, after)
        state = after
