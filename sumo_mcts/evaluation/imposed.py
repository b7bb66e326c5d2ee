"""Which agents brake for the ego. Definition: docs/measures.md, `imposed_brakes_2`."""

from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Ints
from sumo_mcts.numerics.lanes import successors
from sumo_mcts.numerics.signals import shows
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import RED, EgoState, Frame

IMPOSED = (2.0, 3.0, 4.0)  # m/s2
PATH_S, MIN_PATH = 4.0, 10.0  # s, m of an agent's path on which an ego is in its way
ENTERING_S = 2.0  # s of an ego's route that count as about to be entered
_EPS = 1e-6


class Stretch(NamedTuple):
    """A part of a lane that the ego is on or comes over: positions on that lane, m."""

    lane: int
    begin: float
    end: float
    front: float  # where the ego's front is, as this lane counts; below 0: not on it yet


class _Path(NamedTuple):
    """A lane on an agent's path."""

    lane: int
    start: float  # m from the agent's front to the beginning of the lane
    reach: float  # m from the agent's front to where the path ends
    v: float  # m/s of the agent


def braking_for_ego(
    road: RoadMap, trail: list[int], step: float, before: Frame, frame: Frame, known: Ints
) -> list[tuple[str, float]]:
    """The agents that brake for the ego in this step beyond the smallest threshold, with their
    deceleration, m/s2.

    trail: lanes under the ego, the front's last. step: s. known [N]: index of each agent in the
    frame before, -1 new.
    """
    if not len(known):
        return []
    was = np.append(before.agents.v, 0.0)[known]  # a newcomer (-1) finds the 0
    decel = np.where(known >= 0, (was - frame.agents.v) / step, 0.0)
    braking = np.flatnonzero((decel > IMPOSED[0] + _EPS) & ~frame.agents.person)
    if len(braking) == 0:
        return []
    stretches = lanes_under(road, frame.ego, trail) + _coming(road, frame)
    return [
        (frame.agents.ids[i], float(decel[i]))
        for i in braking
        if frame.leader[i] == frame.ego.id
        or _is_in_path(road, frame, int(i), float(was[i]), stretches)
    ]


def lanes_under(road: RoadMap, ego: EgoState, trail: list[int]) -> list[Stretch]:
    """The lanes under the ego: that of its front, those that its rear has not left, and during a
    lane change both.

    trail: lanes that it came over, the front's last.
    """
    if ego.lane < 0:
        return []
    begin, end = ego.s - ego.length, ego.s
    here = (
        [
            Stretch(lane, begin, end, ego.s)
            for lane in {ego.change_from, ego.change_to} - {ego.lane, -1}
        ]
        if ego.changing > 0
        else []
    )
    for k in range(len(trail) - 1, -1, -1):
        here.append(Stretch(trail[k], begin, end, begin + ego.length))
        if begin >= 0 or k == 0:
            break
        end = float(road.length[trail[k - 1]])
        begin += end
    return here


def _coming(road: RoadMap, frame: Frame) -> list[Stretch]:
    """What the ego drives over within ENTERING_S at its present speed. A red light ends it."""
    ego = frame.ego
    lane, front, left = ego.lane, ego.s, ego.v * ENTERING_S
    found: list[Stretch] = []
    while lane >= 0 and left > 0:
        begin, length = max(front, 0.0), float(road.length[lane])
        found.append(Stretch(lane, begin, min(length, begin + left), front))
        left -= length - begin
        front -= length
        lane = _next_on_route(road, lane, ego.route)
        if lane >= 0 and _shows_red(road, frame, lane):
            break
    return found


def _next_on_route(road: RoadMap, lane: int, route: tuple[int, ...]) -> int:
    """The lane after this one; -1 where the route ends, or cannot be followed on this lane."""
    after = successors(road, lane)
    if road.internal[lane]:
        return after[0] if after else -1
    edge = int(road.edge[lane])
    onto = route[route.index(edge) + 1] if edge in route[:-1] else -1
    return next(
        (lane_after for lane_after in after if road.edge[road.exit[lane_after]] == onto), -1
    )


def _shows_red(road: RoadMap, frame: Frame, lane: int) -> bool:
    return bool(road.signal[lane] >= 0 and shows(frame.signals, road, lane) == RED)


def _is_in_path(road: RoadMap, frame: Frame, i: int, v: float, stretches: list[Stretch]) -> bool:
    """Whether the ego's stretches lie on the next PATH_S of agent i, which drove at v, m/s, or
    share a conflict area with them."""
    agents = frame.agents
    path = frame.paths[i].tolist() or [int(agents.lane[i])]
    if path[0] < 0:
        return False
    reach, start = max(MIN_PATH, PATH_S * v), -float(agents.s[i])
    for k, lane in enumerate(path):
        # an agent that brakes before its own red light does not brake for what lies behind it
        if start > reach or (k and _shows_red(road, frame, lane)):
            return False
        for stretch in stretches:
            if stretch.lane != lane:
                if _shares_conflict(road, stretch, frame.ego.v, _Path(lane, start, reach, v)):
                    return True
            elif (
                start + stretch.front > 0 and start + stretch.begin <= reach
            ):  # in front of it, and near enough
                return True
        start += float(road.length[lane])
    return False


def _shares_conflict(road: RoadMap, stretch: Stretch, ego_v: float, path: _Path) -> bool:
    """Whether an ego's stretch and a lane of an agent's path have a conflict area in common where
    the agent has to brake; ego_v: m/s."""
    for c in range(
        int(road.conflict_offset[stretch.lane]), int(road.conflict_offset[stretch.lane + 1])
    ):
        if (
            road.conflict_lane[c] != path.lane
            or stretch.end <= road.conflict_begin[c]
            or stretch.begin >= road.conflict_end[c]
        ):
            continue
        near = path.start + float(road.conflict_other_begin[c])
        far = path.start + float(road.conflict_other_end[c])
        if far <= 0 or near > path.reach:
            continue
        # where both go on in one lane, the one behind is no reason for the other to brake
        left = max(0.0, float(road.conflict_end[c]) - stretch.front)
        if (
            not road.conflict_merge[c]
            or left <= far
            or left / max(ego_v, 1.0) <= far / max(path.v, 1.0)
        ):
            return True
    return False
