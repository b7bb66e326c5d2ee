"""Whether a collision could still be avoided: a search with the true futures of the others through
everything that the ego can do.

Only who holds a script has a true future. The ego moves as in the planners' model; whoever touches
its box, from whatever side, is a contact.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from sumo_mcts.evaluation.referee import Goal
from sumo_mcts.model.local_build import build_local
from sumo_mcts.model.local_map import (
    COS,
    GONE,
    HALF_LENGTH,
    HALF_WIDTH,
    NODE,
    SIN,
    LocalMap,
    State,
    X,
    Y,
    apart,
    ego_state,
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
from sumo_mcts.numerics.geometry import Box, boxes_touch
from sumo_mcts.numerics.kernel import kernel, lengthy
from sumo_mcts.scene import (
    Agents,
    Bools,
    EgoState,
    Floats,
    Forecast,
    Indices,
    RoadMap,
    Scene,
    Scripted,
)

BEFORE_S = 3.0  # s before the contact from which a way out is looked for
HORIZON_S = 8.0  # s that a way out has to last: as far as planners look
PLY_S = 0.5  # s of one action
CHECK_S = 0.05  # s between two looks at the boxes
# m all around the ego: a way out by a hair's breadth is none in SUMO, which rounds otherwise
MARGIN = 0.1
CELL = (
    0.5,
    0.5,
    2.0,
    0.05,
    0.1,
)  # m, m/s, m/s2, progress, rad: states in a cell count as one, or there would be no end of them
ASIDE = 0.2  # m off the middle of a lane from which a lane change must be under way
ALIVE, TOUCHED, HOME = range(3)


class Future(NamedTuple):
    """All that a vehicle is going to do, and its size in m."""

    states: Scripted
    length: float
    width: float


Futures = Callable[
    [float, int], Sequence[Future]
]  # of everybody, from a time (s) on: so many states, a step of the simulation apart


class Hindsight:
    """Keeps the last seconds of one ego, and finds out whether it had a way out at their
    beginning."""

    def __init__(
        self, road: RoadMap, goal: Goal, take_over: EgoState, params: EgoParams, futures: Futures
    ) -> None:
        """`take_over`: the ego with all of its route ahead;

        `futures` has to know everybody else.
        """
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
        self._home = _home(self._route, goal)
        self._scenes: deque[Scene] = deque(maxlen=round(BEFORE_S / params.step) + 1)

    def note(self, scene: Scene) -> None:
        """To be called with the take-over and after every step."""
        self._scenes.append(
            scene._replace(agents=Agents._make(column[:0] for column in scene.agents))
        )  # the futures have everybody

    def inevitable(self) -> bool | None:
        """Whether no motion from BEFORE_S ago (the take-over, if that is later) was free of
        contacts.

        None where the ego was off its route, or in the middle of a lane change of SUMO's driver,
        who does not say where to.
        """
        scene, p = self._scenes[0], self._params
        state = ego_state(self._route, scene.ego)
        if state is None or (state.progress == 0.0 and abs(scene.ego.d) > ASIDE):
            return None
        ply = max(1, round(PLY_S / p.step))
        plies = math.ceil(HORIZON_S / (ply * p.step) - 1e-9)
        forecast = _forecast(self._futures(scene.time, ply * plies + 1), p.step, ply * plies + 1)
        # a stop sign holds nobody who has to get out of the way
        served = frozenset(np.flatnonzero(self._route.sign).tolist())
        local = build_local(
            self._road, self._route, state, scene, forecast, 0, served, p.comfort_decel, 0.0
        )
        looks = max(1, round(p.step / CHECK_S))
        return len(way_out(local, p, state, actions(p), self._home, ply, plies, looks, CELL)) == 0


def actions(p: EgoParams) -> Floats:
    """[A, 2] acceleration (m/s2) and lane change; what is likely to help comes last, since it is
    tried first."""
    accelerations = (p.max_accel, 0.0, -p.approach_decel, -p.max_decel)
    return np.array([(a, float(side)) for side in (1, -1, 0) for a in accelerations])


def _home(route: RouteMap, goal: Goal) -> Bools:
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
        dt, np.ones(1), pose, v, lane, s, valid, half[:, 0], half[:, 1], never, never[None]
    )


# --- the search ---


@lengthy
def way_out(
    local: LocalMap,
    p: EgoParams,
    root: State,
    choice: Floats,
    home: Bools,
    ply: int,
    plies: int,
    looks: int,
    cell: tuple[float, float, float, float, float],
) -> Indices:
    """[K] rows of `choice` [A, 2], `ply` steps each, that touch nobody for `plies` actions or until
    a node of `home` [W]; empty where there are none.

    Depth first, since most states have many ways out: only where there is none everything has to be
    tried. `looks`: box tests within a step.
    """
    taken = [
        (-1, -1)
    ]  # actions: index of the one before, row of `choice`; the first stands for none
    todo = [(root, 0, 0)]  # how many actions led there, and the last of them
    seen = {_cell_of(root, 0, cell)}
    while len(todo) > 0:
        state, level, last = todo.pop()
        for k in range(len(choice)):
            side = int(choice[k, 1])
            if side != 0 and not can_change(local, p, state, side):
                continue
            begun = begin_change(local, p, state, side) if side != 0 else state
            after, end = drive(local, p, home, begun, choice[k, 0], level * ply, ply, looks)
            if end == TOUCHED:
                continue
            place = _cell_of(after, level + 1, cell)
            if place in seen and end == ALIVE:
                continue
            seen.add(place)
            taken.append((last, k))
            todo.append((after, level + 1, len(taken) - 1))
            if end == HOME or level + 1 == plies:
                way = np.zeros(level + 1, np.int64)
                at = len(taken) - 1
                for i in range(level, -1, -1):
                    at, way[i] = taken[at]
                return way
    return np.zeros(0, np.int64)


@kernel
def _cell_of(
    state: State, level: int, cell: tuple[float, float, float, float, float]
) -> tuple[int, int, int, int, int, int, int, int]:
    return (
        level, int(state.node), int(state.other), round(state.s / cell[0]),
        round(state.v / cell[1]), round(state.a / cell[2]),
        round(state.progress / cell[3]), round(state.turn / cell[4]),
    )  # fmt: skip


@kernel
def drive(
    local: LocalMap,
    p: EgoParams,
    home: Bools,
    state: State,
    accel: float,
    at: int,
    steps: int,
    looks: int,
) -> tuple[State, int]:
    """`steps` steps towards an acceleration (m/s2) from step `at` on: where it leads, and ALIVE,
    TOUCHED or HOME. A red light run is no contact."""
    for k in range(at, at + steps):
        before = state
        state, event = advance(local, p, state, accel, k * p.step)
        for look in range(1, looks + 1):
            if _touched(
                local, p, within_step(local, p, before, state, look / looks), k, look / looks
            ):
                return state, TOUCHED
        if event == GOAL or home[state.node]:
            return state, HOME
    return state, ALIVE


@kernel
def _touched(local: LocalMap, p: EgoParams, state: State, row: int, share: float) -> bool:
    """Whether the ego touches anybody in a state a share of a step after forecast time `row`."""
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
            or apart(local, state.node, state.s, 2.0 * p.half_length, row + 1, i)
        ):
            continue
        oc, on = (
            before[COS] + share * (after[COS] - before[COS]),
            before[SIN] + share * (after[SIN] - before[SIN]),
        )
        norm = math.sqrt(oc * oc + on * on)
        if boxes_touch(
            Box(x, y, c, n, own_length, own_width), Box(ox, oy, oc / norm, on / norm, length, width)
        ):
            return True
    return False
