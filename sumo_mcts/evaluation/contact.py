"""Finds the agents that touch the ego within a step.

Two boxes move from their poses at the beginning of the step to those at its end; this tells whether
they meet.
"""

from math import ceil, cos, hypot, inf, sin
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices, Ints
from sumo_mcts.evaluation.reachability import can_meet, driven
from sumo_mcts.numerics.drawn import Drawing, drawn_shares
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Agents, EgoState, Frame

SUBSTEP = 0.4  # m of relative motion between two box tests
LOOK = 50.0  # m along lanes drawn shorter within which boxes may seem to touch
JUMP = 1.5  # m sideways within one step: a change of lanes at once, which is not driven


class Contact(NamedTuple):
    """The first overlap of two boxes. Poses are x, y, heading."""

    ego: tuple[float, float, float]
    other: tuple[float, float, float]
    half: Floats  # [2] half length and half width of the ego's box, m, as it is drawn
    other_half: Floats  # [2]
    # found within the step; else the boxes overlap where the step began or ended, and where they
    # first touched is unknown
    exact: bool


class _Moves(NamedTuple):
    """How K agents near the ego moved in a step. Poses are x, y, heading."""

    agent: Indices  # [K] index in the frame
    before: Floats  # [K, 3] poses
    after: Floats  # [K, 3]
    half: Floats  # [K, 2] half length, half width, m
    share: Floats  # [K] the share of its length to which it is drawn
    leap: Bools  # [K] the agent or the ego was put somewhere else, not driven there


def contacts(
    road: RoadMap, drawing: Drawing, step: float, before: Frame, frame: Frame, known: Ints
) -> dict[str, Contact]:
    """The first contact with each agent whose box the ego's met in the step (s) from `before` to
    `frame`, by the agent's id. Boxes are as long as they are drawn.

    known [N]: index of each agent in the frame before, -1 new. A first frame stands for both.
    """
    near = _near(step, before, frame, known)
    if len(near) == 0:
        return {}
    ego, was = frame.ego, before.ego
    half = np.array([ego.length / 2, ego.width / 2])
    now, then = np.array([ego.x, ego.y, ego.heading]), np.array([was.x, was.y, was.heading])
    share = _drawn_share(drawing, ego, was)
    moves = _moves(road, drawing, step, before, frame, near, known[near])
    if before is frame or jumped(
        then, now, np.array(1.5 * max(ego.v, was.v) * _stretch(road, ego.lane) * step + 3.0)
    ):
        moves.leap[:] = True
    then, now = as_drawn(then, half[0], share), as_drawn(now, half[0], share)
    half = half * (share, 1.0)
    apart = kept_apart(then, now, half, moves.before, moves.after, moves.half)
    hits = {}
    for k in np.flatnonzero(moves.leap | ~apart):
        size, after = moves.half[k], moves.after[k]
        if moves.leap[k]:
            touching = bool(boxes_overlap(boxes_of(now, half), boxes_of(after, size)))
            poses = as_pose(now), as_pose(after)
            contact = Contact(*poses, half, size, False) if touching else None
        else:
            contact = first_contact(then, now, moves.before[k], after, half, size)
        i = int(moves.agent[k])
        if contact is None or not _on_one_level(road, step, before, frame, i):
            continue
        # drawn closer together than they are
        squeezed = min(share, moves.share[k]) < 1.0
        if not (squeezed and _one_behind_the_other(road, before, frame, i, int(known[i]))):
            hits[frame.agents.ids[i]] = contact
    return hits


def _near(step: float, before: Frame, frame: Frame, known: Ints) -> Indices:
    """[K] agents that may have touched the ego within the step."""
    agents, ego = frame.agents, frame.ego
    if not len(agents.ids):
        return np.zeros(0, np.int64)
    radius = hypot(ego.length / 2, ego.width / 2) + 0.5 * np.hypot(agents.length, agents.width)
    # an agent that was driven here within the step came from no further away
    its_speed = np.maximum(agents.v, np.append(before.agents.v, 0.0)[known])
    far = radius + 1.1 * (max(ego.v, before.ego.v) + its_speed) * step + 0.5
    return np.flatnonzero((agents.x - ego.x) ** 2 + (agents.y - ego.y) ** 2 < far * far)


def _moves(
    road: RoadMap,
    drawing: Drawing,
    step: float,
    before: Frame,
    frame: Frame,
    near: Indices,
    past: Ints,
) -> _Moves:
    """How these agents moved; past [K]: their indices in the frame before, -1 new."""
    agents, old = frame.agents, before.agents
    after = np.stack([agents.x[near], agents.y[near], agents.heading[near]], axis=1)
    earlier, seen = after.copy(), past >= 0
    known = past[seen]
    earlier[seen] = np.stack([old.x[known], old.y[known], old.heading[known]], axis=1)
    speed = agents.v[near].copy()
    speed[seen] = np.maximum(speed[seen], old.v[known])
    speed *= _stretch(road, agents.lane[near])
    leap = ~seen | jumped(earlier, after, 1.5 * speed * step + 3.0)
    half = 0.5 * np.stack([agents.length[near], agents.width[near]], axis=1)
    share = drawn_shares(drawing, agents.lane[near], agents.s[near], agents.length[near])
    share[seen] = np.maximum(
        share[seen],
        drawn_shares(drawing, old.lane[known], old.s[known], old.length[known]),
    )
    earlier, after = (as_drawn(poses, half[:, 0], share) for poses in (earlier, after))
    half[:, 0] *= share
    return _Moves(near, earlier, after, half, share, leap)


def _drawn_share(drawing: Drawing, ego: EgoState, was: EgoState) -> float:
    """The share of its length to which the ego is drawn, the larger one of two moments."""
    place = np.array([ego.lane, was.lane]), np.array([ego.s, was.s])
    return float(drawn_shares(drawing, *place, np.array([ego.length, was.length])).max())


def _stretch(road: RoadMap, lane: Ints | int) -> Floats:
    """By how much faster vehicles are drawn on lanes whose shape is longer, 1 at least."""
    return np.where(np.asarray(lane) >= 0, np.maximum(road.scale[lane], 1.0), 1.0)


def as_drawn(poses: Floats, half: Floats, share: Floats | float) -> Floats:
    """Poses [..., 3] of the boxes that are drawn only to a share of their half lengths (m); their
    fronts stay."""
    ahead, out = (1.0 - share) * half, poses.copy()
    out[..., 0] += ahead * np.cos(poses[..., 2])
    out[..., 1] += ahead * np.sin(poses[..., 2])
    return out


def _on_one_level(road: RoadMap, step: float, before: Frame, frame: Frame, i: int) -> bool:
    """Whether the ego and agent i are where two vehicles can meet; what they drove in this step
    counts as body."""
    ego, agents = frame.ego, frame.agents
    if agents.person[i]:
        return True
    length = float(agents.length[i] + agents.v[i] * step)
    return can_meet(
        road,
        (ego.lane, ego.s, ego.length + max(ego.v, before.ego.v) * step),
        (int(agents.lane[i]), float(agents.s[i]), length),
    )


def _one_behind_the_other(road: RoadMap, before: Frame, frame: Frame, i: int, was: int) -> bool:
    """Whether agent i, `was` in the frame before (-1 new), and the ego are apart along their lanes,
    before and after the step."""
    return all(
        _gap_along(road, each.ego, each.agents, k) > 0.0
        for each, k in ((before, was), (frame, i))
        if k >= 0
    )


def _gap_along(road: RoadMap, ego: EgoState, agents: Agents, i: int) -> float:
    """m along the lanes from the front of the one behind to the rear of the other; -inf: no lanes
    lead from one to the other."""
    own = (ego.lane, ego.s, ego.length)
    its = (int(agents.lane[i]), float(agents.s[i]), float(agents.length[i]))
    if min(own[0], its[0]) < 0:
        return -inf
    gaps = [-inf]
    for behind, ahead in ((own, its), (its, own)):
        drive = driven(road, behind[0], behind[1], ahead[0], ahead[1], ahead[2] + LOOK)
        if drive is not None and drive.changes == 0:
            gaps.append(drive.distance - ahead[2])
    return max(gaps)


def boxes_overlap(first: Floats, second: Floats) -> Bools:
    """Whether oriented boxes overlap: first and second [..., 5] broadcast, each x, y, heading, half
    length, half width (m, rad); separating axes."""
    dx, dy = second[..., 0] - first[..., 0], second[..., 1] - first[..., 1]
    c1, s1, c2, s2 = (
        np.cos(first[..., 2]),
        np.sin(first[..., 2]),
        np.cos(second[..., 2]),
        np.sin(second[..., 2]),
    )
    along, across = np.abs(c1 * c2 + s1 * s2), np.abs(c1 * s2 - s1 * c2)
    l1, w1, l2, w2 = first[..., 3], first[..., 4], second[..., 3], second[..., 4]
    apart = np.abs(dx * c1 + dy * s1) >= l1 + l2 * along + w2 * across
    apart |= np.abs(dy * c1 - dx * s1) >= w1 + l2 * across + w2 * along
    apart |= np.abs(dx * c2 + dy * s2) >= l2 + l1 * along + w1 * across
    apart |= np.abs(dy * c2 - dx * s2) >= w2 + l1 * across + w1 * along
    return np.asarray(~apart, dtype=np.bool_)


def between(before: Floats, after: Floats, t: Floats) -> Floats:
    """Poses [..., 3] (x, y, heading) at t (0..1, broadcast) of a move from pose before to pose
    after.

    Cubic with the headings as tangents: a chord would cut the corner by a metre where a step of 1 s
    is driven in a bend.
    """
    chord = after[..., :2] - before[..., :2]
    length = np.sqrt(np.sum(chord * chord, axis=-1))
    turn = _wrap(after[..., 2] - before[..., 2])
    rest = t * (1.0 - t)
    out = np.empty((*np.broadcast_shapes(before.shape[:-1], t.shape), 3))
    for axis, part in ((0, np.cos), (1, np.sin)):
        start, end = (
            part(before[..., 2]) * length - chord[..., axis],
            part(after[..., 2]) * length - chord[..., axis],
        )
        out[..., axis] = (
            before[..., axis] + t * chord[..., axis] + rest * ((1.0 - t) * start - t * end)
        )
    out[..., 2] = before[..., 2] + t * turn
    return out


def _stray(before: Floats, after: Floats) -> Floats:
    """[...] bound, m, on how far the path of between() leaves the chord; poses [..., 3]."""
    dx, dy = after[..., 0] - before[..., 0], after[..., 1] - before[..., 1]
    length = np.sqrt(dx * dx + dy * dy)
    skew = [
        length * length - length * (dx * np.cos(pose[..., 2]) + dy * np.sin(pose[..., 2]))
        for pose in (before, after)
    ]
    return np.asarray(
        4.0 / 27.0 * sum(np.sqrt(np.maximum(2.0 * each, 0.0)) for each in skew), dtype=np.float64
    )


def jumped(before: Floats, after: Floats, reach: Floats) -> Bools:
    """[N] whether a move between poses [N, 3] cannot have been driven: sideways by more than JUMP,
    or further than reach [N], m."""
    dx, dy = after[..., 0] - before[..., 0], after[..., 1] - before[..., 1]
    # along the mean heading, so that an arc does not look like a step aside
    mean = before[..., 2] + 0.5 * _wrap(after[..., 2] - before[..., 2])
    return np.asarray(
        (np.abs(dy * np.cos(mean) - dx * np.sin(mean)) > JUMP)
        | (dx * dx + dy * dy > reach * reach),
        dtype=np.bool_,
    )


def kept_apart(
    before: Floats,
    after: Floats,
    half: Floats,
    other_before: Floats,
    other_after: Floats,
    other_half: Floats,
) -> Bools:
    """[K] True where an axis of the ego parts its box from another all through a step: a cheap test
    that never denies a contact.

    before, after [3], half [2]: the ego's poses and half sizes; the others' [K, 3] and [K, 2].
    """
    start, end = other_before[:, :2] - before[:2], other_after[:, :2] - after[:2]
    own_turn, turn = (
        abs(float(_wrap(after[2] - before[2]))),
        np.abs(_wrap(other_after[:, 2] - other_before[:, 2])),
    )
    # what a turn adds to a box's half width at most, and by how much the paths bend
    slack = (
        0.5 * (hypot(*half) * own_turn + np.hypot(other_half[:, 0], other_half[:, 1]) * turn)
        + _stray(before, after)
        + _stray(other_before, other_after)
    )
    apart = np.zeros(len(start), np.bool_)
    for axis in (float(after[2]), float(after[2]) + np.pi / 2):
        c, s = cos(axis), sin(axis)
        own = max(
            half[0] * abs(cos(h - axis)) + half[1] * abs(sin(h - axis))
            for h in (before[2], after[2])
        )
        angles = np.stack([other_before[:, 2], other_after[:, 2]]) - axis
        theirs = (
            other_half[:, 0] * np.abs(np.cos(angles)) + other_half[:, 1] * np.abs(np.sin(angles))
        ).max(axis=0)
        first, last = start[:, 0] * c + start[:, 1] * s, end[:, 0] * c + end[:, 1] * s
        apart |= (first * last > 0) & (
            np.minimum(np.abs(first), np.abs(last)) > own + theirs + slack
        )
    return apart


def first_contact(
    before: Floats,
    after: Floats,
    other_before: Floats,
    other_after: Floats,
    half: Floats,
    other_half: Floats,
) -> Contact | None:
    """The first overlap of two boxes while both move from pose before to pose after, [3] each; half
    [2]: half length and half width, m."""
    chord = (after - before - other_after + other_before)[:2]
    turned = abs(float(_wrap(after[2] - before[2]))) * hypot(*half) + abs(
        float(_wrap(other_after[2] - other_before[2]))
    ) * hypot(*other_half)
    t = np.linspace(0.0, 1.0, ceil((hypot(*chord) + turned) / SUBSTEP) + 1 + 1)
    hit = boxes_overlap(
        boxes_of(between(before, after, t), half),
        boxes_of(between(other_before, other_after, t), other_half),
    )
    if not hit.any():
        return None
    k = int(np.argmax(hit))
    low, high = float(t[max(k - 1, 0)]), float(t[k])
    for _ in range(10 if k else 0):
        middle = np.array(0.5 * (low + high))
        if boxes_overlap(
            boxes_of(between(before, after, middle), half),
            boxes_of(between(other_before, other_after, middle), other_half),
        ):
            high = float(middle)
        else:
            low = float(middle)
    end = np.array(high)
    return Contact(
        as_pose(between(before, after, end)),
        as_pose(between(other_before, other_after, end)),
        half,
        other_half,
        k > 0,
    )


def boxes_of(poses: Floats, half: Floats) -> Floats:
    """Poses [..., 3] and half sizes [2] -> boxes [..., 5]."""
    return np.concatenate([poses, np.broadcast_to(half, (*poses.shape[:-1], 2))], axis=-1)


def as_pose(values: Floats) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


def touch_point(contact: Contact) -> tuple[float, float]:
    """Middle of the overlap (x, y), m; the middle of the centres where there is no overlap."""
    ring, other_half = _corners(contact.ego, contact.half), contact.other_half
    x, y, heading = contact.other
    for k, reach in enumerate(
        (other_half[0], other_half[1], other_half[0], other_half[1])
    ):  # clip by each side of the other box
        nx, ny = cos(heading + k * np.pi / 2), sin(heading + k * np.pi / 2)
        # rounded, so that a corner on the side is on it
        inside = [round(reach - (px - x) * nx - (py - y) * ny, 9) for px, py in ring]
        clipped = []
        for i, (p, d) in enumerate(zip(ring, inside, strict=True)):
            q, e = ring[i - 1], inside[i - 1]
            if d * e < 0:
                clipped.append(
                    (q[0] + (p[0] - q[0]) * e / (e - d), q[1] + (p[1] - q[1]) * e / (e - d))
                )
            if d >= 0:
                clipped.append(p)
        ring = clipped
    if not ring:
        return 0.5 * (contact.ego[0] + x), 0.5 * (contact.ego[1] + y)
    return sum(p[0] for p in ring) / len(ring), sum(p[1] for p in ring) / len(ring)


def _corners(pose: tuple[float, float, float], half: Floats) -> list[tuple[float, float]]:
    x, y, heading = pose
    c, s = cos(heading), sin(heading)
    return [
        (x + a * half[0] * c - b * half[1] * s, y + a * half[0] * s + b * half[1] * c)
        for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))
    ]


def ahead_of(pose: tuple[float, float, float], point: tuple[float, float]) -> float:
    """How far a point lies ahead of the middle of a box, m."""
    return (point[0] - pose[0]) * cos(pose[2]) + (point[1] - pose[1]) * sin(pose[2])


def _wrap(angle: Floats) -> Floats:
    """Angles folded into -pi..pi."""
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi, dtype=np.float64)
