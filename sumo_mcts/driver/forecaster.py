"""What the planner is told of the traffic to come."""

import numpy as np

from sumo_mcts.model.local_map import State
from sumo_mcts.model.motion import HALF
from sumo_mcts.model.route import RouteMap
from sumo_mcts.prediction.paths import LANES
from sumo_mcts.scene import EgoState, Forecast, Ints, RoadMap

# s of the last plan that the forecast takes for granted; afterwards the nominal ego follows its
# leader
NOMINAL_S = 2.0
CENTRED = 0.02  # m from the middle of its lane within which no lane change is under way


def as_seen(road: RoadMap, ego: EgoState) -> EgoState:
    """The ego with its lane change as far as SUMO has it by now, which may refuse one, be slower
    than its own clock, or end it in a junction."""
    if ego.changing <= 0.0 or ego.lane < 0:
        return ego
    side = 1 if road.left[ego.change_from] == ego.change_to else -1
    moved = ego.d * side < 0.0  # past the middle
    other = int((road.left if (side > 0) != moved else road.right)[ego.lane])
    if abs(ego.d) < CENTRED or other < 0:
        return ego._replace(changing=0.0)
    share = abs(ego.d) / float(road.width[ego.lane] + road.width[other]) * 2.0
    if moved:  # at half time rounding decides: progress has to agree with the lane
        return ego._replace(
            changing=max(1.0 - share, HALF + 1e-9), change_from=other, change_to=ego.lane
        )
    return ego._replace(changing=min(share, 0.5 - 1e-9), change_from=ego.lane, change_to=other)


def ego_lanes(route: RouteMap, state: State) -> Ints:
    """The lanes that the ego is going to drive, the one it moves to first."""
    node = state.other if 0.0 < state.progress < 0.5 and state.other >= 0 else state.node
    lanes: list[int] = []
    while node >= 0 and len(lanes) < LANES:
        lanes.append(int(route.lane[node]))
        node = int(route.next[node])
    return np.array(lanes, np.int32)


def no_forecast(dt: float) -> Forecast:
    """A forecast without agents, `dt` s between its states."""
    none = np.zeros((1, 1, 0))
    return Forecast(
        dt, np.ones(1), np.zeros((1, 1, 0, 4)), none, none.astype(np.int32), none,
        none.astype(np.bool_), np.zeros(0), np.zeros(0),
        np.zeros(0, np.bool_), np.zeros((1, 0), np.bool_),
    )  # fmt: skip
