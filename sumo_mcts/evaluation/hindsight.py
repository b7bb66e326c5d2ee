"""Whether a collision could still be avoided: a search through all that the ego can do, with the
true futures of the others.

Only scripted vehicles have a true future. The ego moves as in the planners' model. A box that
touches the ego's, from any side, is a contact.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices
from sumo_mcts.evaluation.goal import Goal
from sumo_mcts.model.local_build import build_local
from sumo_mcts.model.local_map import (
    GONE,
    HALF_LENGTH,
    HALF_WIDTH,
    NODE,
    LocalMap,
    State,
    boxes_meet,
    ego_state,
    on_other_level,
)
from sumo_mcts.model.motion import (
    GOAL,
    EgoParams,
    advance,
    begin_change,
    can_change,
    pose_of,
    within_step,
)
from sumo_mcts.model.route import RouteMap, route_map
from sumo_mcts.model.stop_lines import Rules
from sumo_mcts.numerics.geometry import COS, SIN, Box, X, Y
from sumo_mcts.numerics.kernel import kernel, lengthy
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Agents, EgoState, Forecast, Scene, Scripted

BEFORE_S = 3.0  # s before the contact from which an escape is looked for
HORIZON_S = 8.0  # s that an escape has to last: as far as planners look
PLY_S = 0.5  # s of one action
CHECK_S = 0.05  # s between two looks at the boxes
# m all around the ego: SUMO rounds otherwise, so that a narrower escape is none there
MARGIN = 0.1
ACCEL, SIDE = 0, 1  # columns of an action
ASIDE = 0.2  # m off the middle of a lane from which a lane change must be under way
ALIVE, TOUCHED, DONE = range(3)


class Future(NamedTuple):
    """All that a vehicle is going to do, and its size."""

    states: Scripted
    length: float  # m
    width: float  # m


# of all vehicles but the ego, from a time (s) on: so many states, a step of the simulation apart
Futures = Callable[[float, int], Sequence[Future]]


class Cell(NamedTuple):
    """How far apart two states may be and count as one: without that the search would not end."""

    s: float  # m
    v: float  # m/s
    a: float  # m/s2
    progress: float  # of a lane change
    turn: float  # rad


CELL = Cell(0.5, 0.5, 2.0, 0.05, 0.1)


class Grain(NamedTuple):
    """How far and how finely the search looks."""

    ply: int  # steps of one action
    plies: int  # actions one after the other
    looks: int  # box tests within a step
    cell: Cell


class Hindsight:
    """Keeps the last seconds of one ego, and finds out whether it had an escape at their
    beginning."""

    def __init__(
        self, road: RoadMap, goal: Goal, take_over: EgoState, params: EgoParams, futures: Futures
    ) -> None:
        """`take_over`: the ego with all of its route ahead. `futures` has to hold all other
        agents."""
        ego = take_over
        self._road, self._params, self._futures = road, params, futures
        self._route = route_map(
            road,
            ego.route,
            ego.vclass,
            ego.length,
            ego.speed_factor,
            ego.max_speed,
            params.approach_decel,
        )
        self._goal_nodes = _goal_nodes(self._route, goal)
        self._scenes: deque[Scene] = deque(maxlen=round(BEFORE_S / params.step) + 1)

    def note(self, scene: Scene) -> None:
        """To be called with the take-over and after every step."""
        empty = Agents._make(column[:0] for column in scene.agents)  # all are in the futures
        self._scenes.append(scene._replace(agents=empty))

    def unavoidable(self) -> bool | None:
        """Whether no motion from BEFORE_S ago (the take-over, if that is later) was free of
        contacts.

        None where the ego was off its route, or in the middle of a lane change of SUMO's driver,
        whose target is unknown.
        """
        scene, p = self._scenes[0], self._params
        state = ego_state(self._route, scene.ego)
        if state is None or (state.progress == 0.0 and abs(scene.ego.d) > ASIDE):
            return None
        ply = max(1, round(PLY_S / p.step))
        plies = math.ceil(HORIZON_S / (ply * p.step) - 1e-9)
        forecast = _forecast(self._futures(scene.time, ply * plies + 1), p.step, ply * plies + 1)
        # a stop sign does not hold an ego that has to escape
        served = frozenset(np.flatnonzero(self._route.sign).tolist())
        rules = Rules(served, p.comfort_decel, claim_s=0.0)
        local = build_local(self._road, self._route, state, scene, forecast, rules)
        grain = Grain(ply, plies, max(1, round(p.step / CHECK_S)), CELL)
        return len(escape(local, p, state, actions(p), self._goal_nodes, grain)) == 0


def actions(p: EgoParams) -> Floats:
    """[A, 2] acceleration (m/s2) and lane change. What is likely to help comes last: it is tried
    first."""
    accelerations = (p.max_accel, 0.0, -p.approach_decel, -p.max_decel)
    return np.array([(a, float(side)) for side in (1, -1, 0) for a in accelerations])


def _goal_nodes(route: RouteMap, goal: Goal) -> Bools:
    """[W] nodes on which the ego has arrived, as the referee sees it."""
    success = max((k for k, edge in enumerate(goal.edges) if edge == goal.success_edge), default=-1)
    beyond = (route.leg >= len(goal.edges)) | ((route.leg == len(goal.edges) - 1) & route.internal)
    reached = (
        (route.leg >= success) & ~route.internal
        if success >= 0
        else np.zeros(len(route.leg), np.bool_)
    )
    return np.asarray(beyond | reached)


def _forecast(futures: Sequence[Future], dt: float, times: int) -> Forecast:
    """The futures [times] side by side."""
    n = len(futures)
    pose, v, s = np.zeros((1, times, n, 4)), np.zeros((1, times, n)), np.zeros((1, times, n))
    lane, valid = np.full((1, times, n), -1, np.int32), np.zeros((1, times, n), np.bool_)
    for i, (states, _, _) in enumerate(futures):
        pose[0, :, i], v[0, :, i], lane[0, :, i], s[0, :, i], valid[0, :, i] = states
    half = 0.5 * np.array([future[1:] for future in futures]).reshape(n, 2)
    never = np.zeros(n, np.bool_)
    return Forecast(
        dt=dt,
        weight=np.ones(1),
        pose=pose,
        v=v,
        lane=lane,
        s=s,
        valid=valid,
        half_length=half[:, 0],
        half_width=half[:, 1],
        reacts=never,
        yields=never[None],
    )


# --- the search ---


@lengthy
def escape(
    local: LocalMap,
    p: EgoParams,
    root: State,
    choice: Floats,
    goals: Bools,
    grain: Grain,
) -> Indices:
    """[K] rows of `choice` [A, 2]: a sequence without a contact, for all plies or until a node of
    `goals` [W]. Empty if there is none.

    Depth first, since most states have many escapes: only where there is none all actions have to
    be tried.
    """
    # actions: index of the one before, row of `choice`; the first stands for none
    taken = [(-1, -1)]
    todo = [(root, 0, 0)]  # a state, how many actions led there, and the last of them
    seen = {_cell_of(root, 0, grain.cell)}
    while len(todo) > 0:
        state, level, last = todo.pop()
        for k in range(len(choice)):
            side = int(choice[k, SIDE])
            if side != 0 and not can_change(local, p, state, side):
                continue
            begun = begin_change(local, p, state, side) if side != 0 else state
            at, accel = level * grain.ply, choice[k, ACCEL]
            after, end = drive(local, p, goals, begun, accel, at, grain.ply, grain.looks)
            if end == TOUCHED:
                continue
            place = _cell_of(after, level + 1, grain.cell)
            if place in seen and end == ALIVE:
                continue
            seen.add(place)
            taken.append((last, k))
            todo.append((after, level + 1, len(taken) - 1))
            if end == DONE or level + 1 == grain.plies:
                found = np.zeros(level + 1, np.int64)
                last = len(taken) - 1
                for i in range(level, -1, -1):
                    last, found[i] = taken[last]
                return found
    return np.zeros(0, np.int64)


@kernel
def _cell_of(state: State, level: int, cell: Cell) -> tuple[int, int, int, int, int, int, int, int]:
    return (
        level, int(state.node), int(state.other), round(state.s / cell.s),
        round(state.v / cell.v), round(state.a / cell.a),
        round(state.progress / cell.progress), round(state.turn / cell.turn),
    )  # fmt: skip


@kernel
def drive(
    local: LocalMap,
    p: EgoParams,
    goals: Bools,
    state: State,
    accel: float,
    at: int,
    steps: int,
    looks: int,
) -> tuple[State, int]:
    """Where `steps` steps towards an acceleration (m/s2) from step `at` on lead, and ALIVE, TOUCHED
    or DONE. A red light run is no contact."""
    for k in range(at, at + steps):
        before = state
        state, event = advance(local, p, state, accel, k * p.step)
        for look in range(1, looks + 1):
            if _touched(
                local, p, within_step(local, p, before, state, look / looks), k, look / looks
            ):
                return state, TOUCHED
        if event == GOAL or goals[state.node]:
            return state, DONE
    return state, ALIVE


@kernel
def _touched(local: LocalMap, p: EgoParams, state: State, row: int, share: float) -> bool:
    """Whether the ego touches another vehicle in a state, a share of a step after forecast time
    `row`."""
    x, y, c, n = pose_of(local, p, state)
    own_length, own_width = p.half_length + MARGIN, p.half_width + MARGIN
    for i in range(local.agent.shape[1]):
        before, after = local.agent[row, i], local.agent[row + 1, i]
        if before[NODE] == GONE or after[NODE] == GONE:
            continue
        ox, oy = (
            before[X] + share * (after[X] - before[X]),
            before[Y] + share * (after[Y] - before[Y]),
        )
        length, width = local.trait[i, HALF_LENGTH], local.trait[i, HALF_WIDTH]
        reach = own_length + own_width + length + width
        if (
            abs(ox - x) > reach
            or abs(oy - y) > reach
            or on_other_level(local, state.node, state.s, 2.0 * p.half_length, row + 1, i)
        ):
            continue
        oc, on = (
            before[COS] + share * (after[COS] - before[COS]),
            before[SIN] + share * (after[SIN] - before[SIN]),
        )
        norm = math.sqrt(oc * oc + on * on)
        own = Box(x, y, c, n, own_length, own_width)
        other = Box(ox, oy, oc / norm, on / norm, length, width)
        if boxes_meet(local, state.node, state.s, p.half_length, own, other, row, i):
            return True
    return False
