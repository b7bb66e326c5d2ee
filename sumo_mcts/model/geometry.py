"""Polylines and oriented boxes."""

import math

from sumo_mcts.model.kernel import kernel
from sumo_mcts.scene import Floats


@kernel
def point_at(points: Floats, arc: Floats, first: int, last: int, distance: float) -> tuple[float, float]:
    """The point of the polyline points[first:last] [., 2] at an arc length; arc [.] are its vertices' arc lengths. Straight on beyond both ends."""
    low, high = first, last - 1
    while high - low > 1:
        middle = (low + high) // 2
        if arc[middle] <= distance:
            low = middle
        else:
            high = middle
    span = arc[low + 1] - arc[low]
    share = (distance - arc[low]) / span if span > 1e-9 else 0.0
    return (
        points[low, 0] + share * (points[low + 1, 0] - points[low, 0]),
        points[low, 1] + share * (points[low + 1, 1] - points[low, 1]),
    )


@kernel
def boxes_touch(
    ax: float, ay: float, ac: float, asn: float, al: float, aw: float,
    bx: float, by: float, bc: float, bsn: float, bl: float, bw: float,
) -> bool:  # fmt: skip
    """Whether two oriented boxes overlap: centre, cosine and sine of the heading, half length, half width (separating axes)."""
    dx, dy = bx - ax, by - ay
    cosine = abs(ac * bc + asn * bsn)
    sine = abs(ac * bsn - asn * bc)
    if abs(dx * ac + dy * asn) > al + bl * cosine + bw * sine:
        return False
    if abs(dy * ac - dx * asn) > aw + bl * sine + bw * cosine:
        return False
    if abs(dx * bc + dy * bsn) > bl + al * cosine + aw * sine:
        return False
    return abs(dy * bc - dx * bsn) <= bw + al * sine + aw * cosine


@kernel
def chord(front_x: float, front_y: float, rear_x: float, rear_y: float, cos_default: float, sin_default: float) -> tuple[float, float, float, float]:
    """The pose (centre x, y, cos, sin) of a box whose front and rear bumper centres are given."""
    dx, dy = front_x - rear_x, front_y - rear_y
    norm = math.sqrt(dx * dx + dy * dy)
    if norm < 1e-6:
        return front_x, front_y, cos_default, sin_default
    return 0.5 * (front_x + rear_x), 0.5 * (front_y + rear_y), dx / norm, dy / norm


@kernel
def box_distance(
    ax: float, ay: float, ac: float, asn: float, al: float, aw: float,
    bx: float, by: float, bc: float, bsn: float, bl: float, bw: float,
) -> float:  # fmt: skip
    """Distance between two oriented boxes, m; 0 where they overlap: the nearest corner of either to the other."""
    if boxes_touch(ax, ay, ac, asn, al, aw, bx, by, bc, bsn, bl, bw):
        return 0.0
    return min(_corner_distance(ax, ay, ac, asn, al, aw, bx, by, bc, bsn, bl, bw), _corner_distance(bx, by, bc, bsn, bl, bw, ax, ay, ac, asn, al, aw))


@kernel
def _corner_distance(
    ax: float, ay: float, ac: float, asn: float, al: float, aw: float,
    bx: float, by: float, bc: float, bsn: float, bl: float, bw: float,
) -> float:  # fmt: skip
    """From box a to the nearest corner of box b."""
    nearest = math.inf
    for corner in range(4):
        u, v = (bl if corner < 2 else -bl), (bw if corner % 2 == 0 else -bw)
        x, y = bx + u * bc - v * bsn - ax, by + u * bsn + v * bc - ay
        dx = max(abs(x * ac + y * asn) - al, 0.0)
        dy = max(abs(y * ac - x * asn) - aw, 0.0)
        nearest = min(nearest, math.sqrt(dx * dx + dy * dy))
    return nearest


@kernel
def swung(turned: float, forward: float, left: float, length: float) -> float:
    """The angle (rad) between a vehicle and its lane after a step forward and to the left (m): its rear follows its front."""
    if left * left + forward * forward > length * length:
        return math.atan2(left, forward)
    return turned + math.asin(min(max(math.cos(turned) * (left - math.tan(turned) * forward) / length, -1.0), 1.0))
