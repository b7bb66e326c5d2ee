"""Where the bodies of the others are, from how far they have come along their paths."""

import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices, Ints
from sumo_mcts.numerics.geometry import COS, SIN, Lines, X, Y, chord, lines_of, point_on, swung
from sumo_mcts.numerics.kernel import entry, kernel
from sumo_mcts.prediction.on_foot import Ways, walked
from sumo_mcts.prediction.overtaking import Return
from sumo_mcts.prediction.paths import OPEN, Paths
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import STANDING, Agents

SIDEWAYS = 1.2  # m/s with which a vehicle moves to the centre line: a lane in 3 s
UNTURNED = 0.05  # rad between body and lane up to which it is a matter of how curves are drawn
GONE = 0.1  # m behind the end of the road from which on a vehicle has left the map


class Poses(NamedTuple):
    """N agents at T times."""

    pose: Floats  # [T, N, 4] columns X .. SIN: the centre, m, and the heading
    lane: Ints  # [T, N] lane of the front, -1 off the road
    s: Floats  # [T, N] position of the front on that lane, m
    valid: Bools  # [T, N] not beyond the end of the road


class _Bodies(NamedTuple):
    """The agents now, [N] each."""

    x: Floats  # m, of the centre
    y: Floats
    heading: Floats  # rad
    length: Floats  # m
    aside: Floats  # m off the centre line, left positive
    place: Floats  # m off it that it moves to


def places(road: RoadMap, agents: Agents, back: Indices) -> Floats:
    """[N] where agents drive within their lanes where SUMO divides these, m to the left of the
    middle: where they are, if they have room there. Others are on their way into the lane, and stop
    moving aside where they fit. Who stands stays, and who goes `back` to a lane, to its middle.
    """
    room = np.maximum(0.5 * (road.width[agents.lane] - agents.width), 0.0)
    place = np.where(agents.v < STANDING, agents.d, np.clip(agents.d, -room, room))
    return np.where((agents.lane >= 0) & (back < 0), place, 0.0)


def poses(
    road: RoadMap, agents: Agents, paths: Paths, on_foot: Ways, back: Return, x: Floats,
    step: float, place: Floats,
) -> Poses:  # fmt: skip
    """The agents at times `step` s apart, from their positions along the paths, x [T, N+1] m; its
    row 0 is the ego.

    They move to their `place` [N], m to the left of the centre lines of their lanes.
    """
    times, n = len(x), len(agents.ids)
    out = Poses(
        pose=np.zeros((times, n, 4)),
        lane=np.full((times, n), -1, np.int32),
        s=np.zeros((times, n)),
        valid=np.ones((times, n), np.bool_),
    )
    bodies = _Bodies(agents.x, agents.y, agents.heading, agents.length, agents.d, place)
    _place(out, paths, bodies, on_foot, back, lines_of(road), x, step)
    return out


@entry
def _place(
    out: Poses, paths: Paths, bodies: _Bodies, ways: Ways, back: Return, lines: Lines, x: Floats,
    step: float,
) -> None:  # fmt: skip
    for i in range(x.shape[1] - 1):
        if paths.count[i + 1] == 0:
            _place_off_road(out.pose, ways, x, i)
        else:
            _place_on_path(out, paths, bodies, back, lines, x, i, step)


@kernel
def _place_off_road(pose: Floats, ways: Ways, x: Floats, i: int) -> None:
    """Straight on, or over a crossing."""
    for t in range(len(x)):
        px, py, pc, ps = walked(ways, i, x[t, i + 1] - x[0, i + 1])
        pose[t, i, X], pose[t, i, Y], pose[t, i, COS], pose[t, i, SIN] = px, py, pc, ps


@kernel
def _place_on_path(
    out: Poses, paths: Paths, bodies: _Bodies, back: Return, lines: Lines, x: Floats, i: int,
    step: float,
) -> None:  # fmt: skip
    """Front and rear on the path; the offset from the centre line and the angle to it that the body
    has now become less as it drives. Who goes back moves on to the middle of the lane beside."""
    row, length = i + 1, bodies.length[i]
    cs, sn = math.cos(bodies.heading[i]), math.sin(bodies.heading[i])
    start, aside, turn = x[0, row], bodies.aside[i], 0.0
    k, kr = 0, 0
    for t in range(len(x)):
        front, rear = x[t, row], x[t, row] - length
        before, k = k, _lane_at(paths, row, k, front)
        if k > before == 0:
            aside -= back.aside[i]  # the path goes on from the lane to which it goes back
        if front > paths.offset[row, paths.count[row]] + GONE and paths.ends[row] != OPEN:
            out.valid[t, i] = False
        out.lane[t, i], out.s[t, i] = paths.lane[row, k], front - paths.offset[row, k]
        fx, fy = _point(paths, lines, row, k, front)
        if rear < 0.0:
            # its rear is where it has already been: on the line from rear to front now
            moved = front - start
            rx = bodies.x[i] - 0.5 * length * cs + moved * cs
            ry = bodies.y[i] - 0.5 * length * sn + moved * sn
        else:
            kr = _lane_at(paths, row, kr, rear)
            rx, ry = _point(paths, lines, row, kr, rear)
        _, _, pc, ps = chord(fx, fy, rx, ry, cs, sn)
        if t == 0:
            turn = math.atan2(sn * pc - cs * ps, cs * pc + sn * ps)
            turn = turn if abs(turn) > UNTURNED else 0.0
            out.pose[t, i, X], out.pose[t, i, Y] = bodies.x[i], bodies.y[i]
            out.pose[t, i, COS], out.pose[t, i, SIN] = cs, sn
            continue
        goes_back = k == 0 and back.lane[i] >= 0 and t * step > back.after[i]
        goal = back.aside[i] if goes_back else bodies.place[i]
        if turn != 0.0 or aside != goal:
            left = -math.copysign(min(SIDEWAYS * step, abs(aside - goal)), aside - goal)
            aside, turn = aside + left, swung(turn, x[t, row] - x[t - 1, row], left, length)
        if k == 0 and back.lane[i] >= 0 and aside / back.aside[i] > 0.5:
            out.lane[t, i] = back.lane[i]
        ct, st = math.cos(turn), math.sin(turn)
        c, s = pc * ct - ps * st, ps * ct + pc * st
        out.pose[t, i, X] = fx - aside * ps - 0.5 * length * c
        out.pose[t, i, Y] = fy + aside * pc - 0.5 * length * s
        out.pose[t, i, COS], out.pose[t, i, SIN] = c, s


@kernel
def _lane_at(paths: Paths, row: int, k: int, x: float) -> int:
    """Which lane of its path a position is on; not before the k-th."""
    while k < paths.count[row] - 1 and x > paths.offset[row, k + 1]:
        k += 1
    return k


@kernel
def _point(paths: Paths, lines: Lines, row: int, k: int, x: float) -> tuple[float, float]:
    """The centre line's point at a position on the k-th lane of a path."""
    return point_on(lines, paths.lane[row, k], x - paths.offset[row, k])
