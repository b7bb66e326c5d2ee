"""How far the ego's lane change has come.

It is decided in planners/ and commanded in world/command.py.
"""

from sumo_mcts.model.local_map import State
from sumo_mcts.model.motion import HALF
from sumo_mcts.model.route import RouteMap
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import EgoState, Follow, Release

CENTRED = 0.02  # m from the middle of its lane within which no lane change is under way


def as_seen(road: RoadMap, ego: EgoState) -> EgoState:
    """The ego with the progress of its lane change computed from its offset.

    SUMO may refuse a change, be slower than its own clock, or end one in a junction.
    """
    if ego.changing <= 0.0 or ego.lane < 0:
        return ego
    side = 1 if road.left[ego.change_from] == ego.change_to else -1
    moved = ego.d * side < 0.0  # past the middle
    if moved and ego.lane == ego.change_from and ego.sideways.speed > 0.0:
        # it began on the other side of the middle of its lane
        return ego._replace(changing=CENTRED)
    other = int((road.left if (side > 0) != moved else road.right)[ego.lane])
    if abs(ego.d) < CENTRED or other < 0:
        return ego._replace(changing=0.0)
    share = abs(ego.d) / float(road.width[ego.lane] + road.width[other]) * 2.0
    if moved:  # at half time rounding decides: progress has to agree with the lane
        return ego._replace(
            changing=max(1.0 - share, HALF + 1e-9), change_from=other, change_to=ego.lane
        )
    return ego._replace(changing=min(share, 0.5 - 1e-9), change_from=ego.lane, change_to=other)


def about_to_change(route: RouteMap, state: State, command: Follow | Release) -> State:
    """The ego's state right after a command, whose lane change is about to begin."""
    side = command.lane_change if isinstance(command, Follow) else 0
    other = int((route.left if side > 0 else route.right)[state.node]) if side else -1
    return state if other < 0 else state._replace(progress=CENTRED, other=other)
