"""Egos on straight roads, asked whether they could have escaped from cars whose futures are known."""

import math
from typing import NamedTuple
from unittest import mock

import numpy as np
from helpers import edge, edges
from helpers_model import PHYSICS, scenario, scene_of

from sumo_mcts.driver.params import Physics, ego_params
from sumo_mcts.evaluation import hindsight
from sumo_mcts.evaluation.goal import Goal
from sumo_mcts.evaluation.hindsight import Future, Futures, Hindsight
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import EgoState, Scripted, Signals

LENGTH, BREADTH = 5.0, 1.8  # m, of every car


class Car(NamedTuple):
    """A car that drives east with a constant speed, on the road from `begin` to `end` (s)."""

    front: float  # m, at time 0
    y: float
    v: float = 0.0
    begin: float = 0.0
    end: float = math.inf


def futures(*cars: Car, step: float = 0.1) -> Futures:
    """Of all these."""

    def known(now: float, count: int) -> list[Future]:
        time = now + np.arange(count) * step
        return [Future(_states(car, time), LENGTH, BREADTH) for car in cars]

    return known


def _states(car: Car, time: np.ndarray) -> Scripted:
    n, zero = len(time), np.zeros(len(time))
    pose = np.column_stack([car.front - LENGTH / 2 + car.v * time, zero + car.y, zero + 1.0, zero])
    valid = (time >= car.begin - 1e-9) & (time <= car.end + 1e-9)
    return Scripted(pose, zero + car.v, np.full(n, -1, np.int32), zero, valid)


def seen_later(
    road: RoadMap,
    ego: EgoState,
    *cars: Car,
    success: str = "",
    signals: Signals | None = None,
    moves: Physics = PHYSICS,
) -> Hindsight:
    """With this ego as its only state."""
    own = edges(road, *[name for name in road.edge_ids if not name.startswith(":")])
    goal = Goal(own, edge(road, success) if success else -1, 100.0, 10.0)
    result = Hindsight(
        road,
        goal,
        ego._replace(route=own),
        ego_params(scenario(), ego, moves),
        futures(*cars, step=moves.step),
    )
    result.note(scene_of(ego._replace(route=own), road, signals=signals, step=moves.step))
    return result


def question(asked: Hindsight) -> tuple:
    """The arguments with which the search is called."""
    with mock.patch.object(hindsight, "escape", return_value=np.zeros(0, np.int64)) as search:
        asked.unavoidable()
    return search.call_args.args
