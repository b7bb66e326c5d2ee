"""Takes a decision that is not executed, so that the first real one is not late."""

from contextlib import suppress

import numpy as np

from sumo_mcts.config import ScenarioConfig
from sumo_mcts.driver.driver import Driver
from sumo_mcts.driver.factories import reads_forecast
from sumo_mcts.driver.params import Physics
from sumo_mcts.numerics.prepare import prepare
from sumo_mcts.prediction.script_poses import script_poses
from sumo_mcts.registry import asks
from sumo_mcts.road import IGNORING, RoadMap
from sumo_mcts.scene import GREEN, Agents, EgoState, Scene, Signals


def warm_up(config: ScenarioConfig, road: RoadMap, physics: Physics) -> None:
    """Load, or compile the first time, the kernels that decisions need, by a decision that is not
    executed. What is compiled is announced (numerics/announce.py)."""
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
    # what fails here fails again at the first real decision, where it becomes the outcome
    with suppress(Exception):
        prepare(lambda: Driver(tried, road, physics, 0).decide(scene))
    if asks(config.prediction.name, "script"):
        row = np.zeros(1)
        script_poses(road, scene.agents.lane, row, row, row, physics.step, scene.ego.length)


def standing_car(road: RoadMap, lane: int) -> EgoState:
    """An ego of usual size and strength at the beginning of a lane, with its edge as the route."""
    x, y = (float(value) for value in road.points[road.point_offset[lane]])
    return EgoState(
        id="",
        x=x,
        y=y,
        heading=0.0,
        v=0.0,
        a=0.0,
        lane=lane,
        s=0.0,
        d=0.0,
        length=5.0,
        width=1.8,
        max_accel=2.6,
        comfort_decel=4.5,
        emergency_decel=9.0,
        max_speed=50.0,
        speed_factor=1.0,
        vclass=0,
        route=(int(road.edge[lane]),),
        changing=0.0,
        change_to=-1,
        change_from=-1,
    )


def _still_life(road: RoadMap, step: float) -> Scene:
    """An ego and an agent that stand on an ordinary lane of a network."""
    lane = int(np.flatnonzero(~road.internal)[0])
    ego = standing_car(road, lane)._replace(vclass=IGNORING)
    x, y = ego.x, ego.y
    zero, none = np.zeros(1), np.zeros(1, np.int32)
    agents = Agents(
        ids=("agent",),
        x=zero + x,
        y=zero + y,
        heading=zero,
        v=zero,
        a=zero,
        trend=zero,
        length=zero + 5.0,
        width=zero + 1.8,
        lane=none + lane,
        s=zero + float(road.length[lane]),
        d=zero,
        blinker=none,
        standing_s=zero,
        person=none > 0,
        vclass=none,
    )
    return Scene(0.0, step, ego, agents, _all_green(road))


def _all_green(road: RoadMap) -> Signals:
    """Signals that always show green."""
    links = [
        int(road.link[road.signal == signal].max(initial=-1)) + 1
        for signal in range(len(road.signal_ids))
    ]
    offset = np.concatenate([[0], np.cumsum(links)]).astype(np.int32)
    return Signals(
        offset, np.full((int(offset[-1]), 1), GREEN, np.int32), np.full((len(links), 1), np.inf)
    )
