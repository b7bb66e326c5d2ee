"""Where a vehicle that turns sharply is within a step: its front and its rear are on its lanes.

From two poses alone a turn round within one step would look as if the body turned evenly. In truth
its rear is still on the road while its front comes about, and swings round at the end.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats
from sumo_mcts.evaluation.contact import Contact, between, boxes_of, boxes_overlap
from sumo_mcts.evaluation.reachability import driven, predecessors
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Agents, EgoState, Frame

FITS_M, FITS_RAD = 0.2, 0.1  # by which a pose may differ from that on the lanes
REACH = 100.0  # m, the longest step
SHARP = 0.5  # rad within one step from which on a turn is sharp
MOMENTS = 41  # within a step at which boxes are compared


class Place(NamedTuple):
    """Where a vehicle is."""

    lane: int  # of the front, -1: off the road
    s: float  # of the front on that lane, m
    pose: Floats  # [3] x, y, heading


class Move(NamedTuple):
    """How a vehicle moved in a step."""

    before: Place
    after: Place
    length: float  # m


def clear_on_lanes(
    road: RoadMap, before: Frame, frame: Frame, name: str, known: int, contact: Contact
) -> bool:
    """Whether the ego and agent `name`, `known` in the frame before, do not touch along their
    lanes, where one of them turned sharply, and their poses alone let them touch within the step.
    """
    if not contact.exact:
        return False
    i, was, now = frame.agents.ids.index(name), before.agents, frame.agents
    ego = Move(_of_ego(before.ego), _of_ego(frame.ego), 2.0 * float(contact.half[0]))
    other = Move(_of_agent(was, known), _of_agent(now, i), 2.0 * float(contact.other_half[0]))
    if not (_is_sharp(ego) or _is_sharp(other)):
        return False
    t, halves = np.linspace(0.0, 1.0, MOMENTS), (contact.half, contact.other_half)
    boxes = []
    for move, half in zip((ego, other), halves, strict=True):
        poses = poses_on_lanes(road, move, t)
        if poses is None and _is_sharp(move):
            return False
        boxes.append(boxes_of(poses if poses is not None else _evenly(move, t), half))
    return not boxes_overlap(*boxes).any()


def _of_ego(ego: EgoState) -> Place:
    return Place(ego.lane, ego.s, np.array([ego.x, ego.y, ego.heading]))


def _of_agent(agents: Agents, i: int) -> Place:
    pose = np.array([agents.x[i], agents.y[i], agents.heading[i]])
    return Place(int(agents.lane[i]), float(agents.s[i]), pose)


def _is_sharp(move: Move) -> bool:
    return abs(_turned(move.before.pose, move.after.pose)) > SHARP


def _evenly(move: Move, t: Floats) -> Floats:
    return between(move.before.pose, move.after.pose, t)


def poses_on_lanes(road: RoadMap, move: Move, t: Floats) -> Floats | None:
    """[T, 3] the poses at shares t [T] of a step; None where the lanes do not tell them."""
    was, now = move.before, move.after
    if min(was.lane, now.lane) < 0:
        return None
    drive = driven(road, was.lane, was.s, now.lane, now.s, REACH)
    if drive is None or drive.changes or drive.distance < 0.0:
        return None
    moments = np.concatenate([[0.0], t, [1.0]])
    for behind in _behind(road, was.lane, move.length - was.s):
        at, points = _line(road, (*behind, was.lane, *drive.lanes))
        front = float(road.length[list(behind)].sum()) + was.s + moments * drive.distance
        found = _between(at, points, front, move.length)
        if _fits(found[0], was.pose) and _fits(found[-1], now.pose):
            return found[1:-1]
    return None


def _behind(road: RoadMap, lane: int, reach: float) -> Iterator[tuple[int, ...]]:
    """The lanes, in the order of driving, by which `lane` may have been reached, `reach` m back."""
    if reach <= 0.0:
        yield ()
        return
    for before in predecessors(road, lane):
        for further in _behind(road, before, reach - float(road.length[before])):
            yield (*further, before)


def _line(road: RoadMap, lanes: Sequence[int]) -> tuple[Floats, Floats]:
    """[P] positions on lanes one after the other, m from the start of the first, and [P, 2] the
    points there."""
    at, points, begin = [], [], 0.0
    for lane in lanes:
        piece = slice(road.point_offset[lane], road.point_offset[lane + 1])
        at.append(begin + road.point_s[piece] / road.scale[lane])
        points.append(road.points[piece])
        begin += float(road.length[lane])
    return np.concatenate(at), np.concatenate(points)


def _between(at: Floats, points: Floats, front: Floats, length: float) -> Floats:
    """[T, 3] poses of a body whose front is at `front` [T], m, of a line, and its rear behind it;
    as SUMO has it the front is on the line and the body points to it."""
    head, rear = (
        np.stack([np.interp(place, at, points[:, k]) for k in (0, 1)], axis=-1)
        for place in (front, front - length)
    )
    heading = np.arctan2(*(head - rear).T[::-1])
    middle = head - 0.5 * length * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    return np.concatenate([middle, heading[:, None]], axis=1)


def _fits(found: Floats, pose: Floats) -> bool:
    """Whether two poses [3] are the same, but for what is lost in the network's file."""
    return bool(np.hypot(*(found - pose)[:2]) < FITS_M and abs(_turned(found, pose)) < FITS_RAD)


def _turned(one: Floats, other: Floats) -> float:
    """rad between two poses [3], -pi..pi."""
    return float((other[2] - one[2] + np.pi) % (2.0 * np.pi) - np.pi)
