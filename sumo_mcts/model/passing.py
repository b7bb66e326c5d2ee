"""What it costs to pass people at the edge of the ego's lane too fast."""

from sumo_mcts.model.cost_params import CostParams
from sumo_mcts.numerics.geometry import Box
from sumo_mcts.numerics.kernel import inlined
from sumo_mcts.prediction.roadside import ALONG

# m between the ego's side and the margin of who walks beside it, with which the ego passes as if
# nobody was there. The margin takes half of the room where there is little, so it is twice as much.
AMPLE = 0.4
PACE = 8.0  # m/s at which it would pass without any room


@inlined
def passing_cost(c: CostParams, v: float, box: Box, other: Box) -> float:
    """Cost per second of driving at v (m/s) past a person that walks along the road. At twice the
    speed that the room allows it is that of standing in its way."""
    dx, dy = other.x - box.x, other.y - box.y
    if v <= PACE or abs(box.cos * other.cos + box.sin * other.sin) < ALONG:
        return 0.0
    if abs(dx * box.cos + dy * box.sin) > box.half_length + other.half_length:
        return 0.0
    room = abs(dy * box.cos - dx * box.sin) - box.half_width - other.half_width
    return c.claim * min(max(v / PACE * (1.0 - room / AMPLE) - 1.0, 0.0), 1.0)
