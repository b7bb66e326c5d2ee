"""Whether the ego is at fault in a collision. Definition: docs/measures.md, `at_fault`."""

from collections.abc import Mapping
from math import hypot, inf
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats
from sumo_mcts.evaluation.contact import Contact, ahead_of, touch_point
from sumo_mcts.evaluation.imposed import Stretch
from sumo_mcts.evaluation.reachability import spread
from sumo_mcts.numerics.lanes import against_traffic
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import STANDING, Agents, EgoState, Frame

TOUCHING = 0.1  # m: a contact this close to the plane of a bumper is on it
CHANGE_COUNTS_S = 3.0  # s after its beginning during which a lane change makes the ego at fault
DRIFT = 0.02  # m sideways within one step: moving into another lane
# m, m/s: a leader this close and this slow blocks a vehicle that stands behind it
BLOCKED_GAP, BLOCKED_SPEED = 5.0, 1.0
_EPS = 1e-6


class Conduct(NamedTuple):
    """What is known of the ego before a collision, beside its state."""

    body: list[Stretch]  # the lanes under it
    change_began: float  # time of its last lane change, s; -inf: none
    red_junction: int  # the junction it is on and entered against red, -1: none
    red_runners: Mapping[str, int]  # agent -> junction that it entered against red


def is_at_fault(
    road: RoadMap,
    conduct: Conduct,
    step: float,
    before: Frame,
    frame: Frame,
    name: str,
    contact: Contact | None,
) -> bool:
    """Whether the ego is at fault in a collision with agent `name` in the step (s) from `before` to
    `frame`. Unclear counts as at fault.

    contact: None where SUMO reports a collision that the boxes do not show.
    """
    ego, agents = frame.ego, frame.agents
    i, j = _index(agents, name), _index(before.agents, name)
    if i < 0 or not frame.present:
        return True
    if not _moves(before.agents, j, agents, i, step):
        return True
    head_on = _overtook_into(road, conduct.body, frame, i)
    if head_on is not None:
        return head_on
    if frame.time - conduct.change_began < CHANGE_COUNTS_S - _EPS:
        return True
    if _violates_right_of_way(road, conduct, step, frame, i):
        return True
    if _stands_on_junction(road, conduct.body, frame, i):
        return True
    if contact is None:
        its_pose = (float(agents.x[i]), float(agents.y[i]), float(agents.heading[i]))
        contact = Contact(
            (ego.x, ego.y, ego.heading), its_pose, *_half_sizes(ego, agents, i), False
        )
    # by its own lane change, or about to change
    drifts = j >= 0 and _shifts(road, before.agents, j, agents, i)
    return not _hit_by_other(contact, drifts)


def _half_sizes(ego: EgoState, agents: Agents, i: int) -> tuple[Floats, Floats]:
    """Half length and half width of the ego and of agent i, m, [2] each."""
    return (
        np.array([ego.length / 2, ego.width / 2]),
        np.array([agents.length[i] / 2, agents.width[i] / 2]),
    )


def _hit_by_other(contact: Contact, drifts: bool) -> bool:
    """Whether the place of the contact shows that the other ran into the ego.

    It did with its front or sideways (`drifts`), and the ego's front has no part in it.
    """
    half, its_half, point = contact.half, contact.other_half, touch_point(contact)
    forward, its_forward = ahead_of(contact.ego, point), ahead_of(contact.other, point)
    if not contact.exact:
        # how deep they are in each other hides where they touched: clear only where the other came
        # from behind
        return bool(forward <= -half[0] / 2 and its_forward >= its_half[0] / 2)
    if forward >= half[0] - TOUCHING:
        return False
    return bool(its_forward >= its_half[0] - TOUCHING or drifts)


def _moves(before: Agents, j: int, now: Agents, i: int, step: float) -> bool:
    """Whether agent i (j before, -1: not there) drives or changes lanes. SUMO moves even standing
    vehicles to the side."""
    if j < 0:
        return bool(now.v[i] >= STANDING)
    moved = hypot(now.x[i] - before.x[j], now.y[i] - before.y[j])
    return bool(max(now.v[i], before.v[j], moved / step) >= STANDING)


def _violates_right_of_way(
    road: RoadMap, conduct: Conduct, step: float, frame: Frame, i: int
) -> bool:
    """Whether the ego is inside a junction that it entered against red, or inside a conflict area
    in which it has to yield to agent i."""
    ego, agents = frame.ego, frame.agents
    if ego.lane < 0:
        return True
    here = [(part.lane, part.begin - ego.v * step, part.end) for part in conduct.body]
    inside = {int(road.junction[lane]) for lane, _, _ in here} - {-1}
    if conduct.red_junction in inside or (agents.person[i] and inside):
        return True
    if agents.lane[i] < 0:
        return False
    margin = float(agents.v[i]) * step + 2.0
    theirs = spread(
        road, int(agents.lane[i]), float(agents.s[i]), float(agents.length[i]) + margin, margin
    )
    runs_red = conduct.red_runners.get(agents.ids[i], -2)
    for lane, begin, end in here:
        for c in range(int(road.conflict_offset[lane]), int(road.conflict_offset[lane + 1])):
            inside_area = begin < road.conflict_end[c] and end > road.conflict_begin[c]
            if (
                road.conflict_yields[c]
                and inside_area
                and int(road.conflict_lane[c]) in theirs
                and road.junction[lane] != runs_red
            ):
                return True
    return False


def _overtook_into(road: RoadMap, body: list[Stretch], frame: Frame, i: int) -> bool | None:
    """Whether it was the ego that met agent i in a lane of oncoming traffic, or the agent; None:
    neither."""
    ego, agents = frame.ego, frame.agents
    if np.cos(agents.heading[i] - ego.heading) >= 0.0:
        return None
    against = against_traffic(road)
    if any(against[part.lane] for part in body):
        return True
    return False if agents.lane[i] >= 0 and against[agents.lane[i]] else None


def _stands_on_junction(road: RoadMap, body: list[Stretch], frame: Frame, i: int) -> bool:
    """Whether the ego stands on a junction, and no vehicle in front of it, other than agent i, is
    the reason."""
    ego, agents = frame.ego, frame.agents
    if ego.v >= STANDING or ego.lane < 0 or not any(road.internal[part.lane] for part in body):
        return False
    ahead = spread(road, ego.lane, ego.s, 0.0, BLOCKED_GAP + float(agents.length.max(initial=0.0)))
    for k in np.flatnonzero((agents.v < BLOCKED_SPEED) & ~agents.person):
        front = ahead.get(int(agents.lane[k]), -inf) + float(agents.s[k])
        if k != i and front > 0 and front - agents.length[k] <= BLOCKED_GAP:
            return False
    return True


def _shifts(road: RoadMap, before: Agents, j: int, now: Agents, i: int) -> bool:
    """Whether agent j of the frame before, i now, moved sideways on its road."""
    was, lane = int(before.lane[j]), int(now.lane[i])
    if was < 0 or lane < 0:
        return False
    return (
        bool(abs(now.d[i] - before.d[j]) > DRIFT)
        if was == lane
        else bool(road.edge[was] == road.edge[lane])
    )


def _index(agents: Agents, name: str) -> int:
    return agents.ids.index(name) if name in agents.ids else -1
