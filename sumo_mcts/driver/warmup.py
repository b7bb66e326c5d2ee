"""A decision that is not executed, so that the first real one is not late."""

from contextlib import suppress

import numpy as np

from sumo_mcts.config import ScenarioConfig
from sumo_mcts.driver.driver import Driver
from sumo_mcts.driver.params import Physics
from sumo_mcts.driver.registry import reads_forecast
from sumo_mcts.numerics.prepare import prepare
from sumo_mcts.prediction.script_poses import script_poses
from sumo_mcts.scene import GREEN, IGNORING, Agents, EgoState, RoadMap, Scene, Signals


def warm_up(config: ScenarioConfig, road: RoadMap, physics: Physics) -> None:
    """Load (the first time: compile) what decisions need, by one that nobody executes; without it
    the ego's first decision would be late. What is compiled is announced (model/announce.py)."""
    if not reads_forecast(config) and not config.failsafe.on:
        return
    planner = config.planner.model_copy(
        update={
            "iterations": 1,
            "most_iterations": None,
            "time_budget_ms": None,
            "enforce_deadline": False,
        }
    )
    checked = config.failsafe.on or config.planner.enforce_deadline
    tried = config.model_copy(
        update={"planner": planner, "failsafe": config.failsafe.model_copy(update={"on": checked})}
    )
    scene = _still_life(road, physics.step)
    with suppress(
        Exception
    ):  # what fails here fails again at the first real decision, where it becomes the outcome
        prepare(lambda: Driver(tried, road, physics, 0).decide(scene))
    if config.prediction.name == "script":
        row = np.zeros(1)
        script_poses(road, scene.agents.lane, row, row, row, physics.step, scene.ego.length)


def _still_life(road: RoadMap, step: float) -> Scene:
    """An ego and an agent that stand on an ordinary lane of a network."""
    lane = int(np.flatnonzero(~road.internal)[0])
    x, y = (float(value) for value in road.points[road.point_offset[lane]])
    ego = EgoState(
        "",
        x,
        y,
        0.0,
        0.0,
        0.0,
        lane,
        0.0,
        0.0,
        5.0,
        1.8,
        2.6,
        4.5,
        9.0,
        50.0,
        1.0,
        IGNORING,
        (int(road.edge[lane]),),
        0.0,
        -1,
        -1,
    )
    zero, none, end = np.zeros(1), np.zeros(1, np.int32), float(road.length[lane])
    agents = Agents(
        ("agent",), zero + x, zero + y, zero, zero, zero, zero, zero + 5.0, zero + 1.8,
        none + lane, zero + end, zero, none, zero, none > 0, none
    )  # fmt: skip
    links = [
        int(road.link[road.signal == signal].max(initial=-1)) + 1
        for signal in range(len(road.signal_ids))
    ]
    offset = np.concatenate([[0], np.cumsum(links)]).astype(np.int32)
    signals = Signals(
        offset, np.full((int(offset[-1]), 1), GREEN, np.int32), np.full((len(links), 1), np.inf)
    )
    return Scene(0.0, step, ego, agents, signals)
