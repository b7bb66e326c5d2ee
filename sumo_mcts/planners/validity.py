"""Checks that the result of a planner is a decision that SUMO can execute."""

import numpy as np

from sumo_mcts.model.motion import goes_back
from sumo_mcts.model.route import LEFT_NODE, RIGHT_NODE
from sumo_mcts.planners.base import Situation, Task
from sumo_mcts.scene import Decision, Follow, Plan, Release, RootChild


def why_invalid(task: Task, situation: Situation, decision: object) -> str:
    """Why this is no decision that SUMO could execute; "" where it is one."""
    command = getattr(decision, "command", None)
    if isinstance(command, Release):
        return ""
    if not isinstance(decision, Decision) or not isinstance(command, Follow):
        return f"no decision but {type(decision).__name__}"
    speeds, side, state = np.asarray(command.speeds), command.lane_change, situation.state
    if speeds.ndim != 1 or not len(speeds) or speeds.dtype.kind not in "fiu":
        return f"speeds of shape {speeds.shape} and type {speeds.dtype}"
    if not np.isfinite(speeds).all() or (speeds < 0.0).any():
        return f"a speed of {speeds[~(np.isfinite(speeds) & (speeds >= 0.0))][0]:g} m/s"
    if side not in (-1, 0, 1):
        return f"a lane change by {side!r}"
    if command.asks not in (-1, 0, 1):
        return f"a wish for the side {command.asks!r}"
    if side != 0 and state.progress > 0.0:
        divided = situation.scene.ego.sideways.speed > 0.0
        back = divided and goes_back(task.route.table, state, side)
        return "" if back else "a lane change during another one"
    if side != 0 and task.route.table[state.node, LEFT_NODE if side > 0 else RIGHT_NODE] < 0.0:
        return f"a lane change to the {'left' if side > 0 else 'right'}, where there is no lane"
    if not isinstance(decision.children, tuple) or not all(
        isinstance(child, RootChild) for child in decision.children
    ):
        return "children that are no tuple of RootChild"
    return "" if decision.plan is None else _why_invalid_plan(decision.plan)


def _why_invalid_plan(plan: object) -> str:
    """Why this is no plan; "" where it is one."""
    if not isinstance(plan, Plan):
        return f"no plan but {type(plan).__name__}"
    arrays = [np.asarray(each) for each in plan]
    m = len(arrays[0]) if arrays[0].ndim else 0
    shapes = [(m,)] * 4 + [(m, 4)]
    wrong = [
        i
        for i, each in enumerate(arrays)
        if each.shape != shapes[i] or each.dtype.kind not in "fiu" or not np.isfinite(each).all()
    ]
    return (
        f"a plan whose {Plan._fields[wrong[0]]} has shape {arrays[wrong[0]].shape}, or is not "
        "finite"
        if wrong
        else ""
    )
