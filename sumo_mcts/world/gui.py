"""SUMO's own window: the view follows an ego, which is coloured, and its plan is drawn."""

from collections.abc import Sequence

from sumo_mcts.arrays import Floats
from sumo_mcts.world.library import running_sumo

VIEW = "View #0"
EGO_COLOUR = (0, 105, 210, 255)
PLAN_COLOUR = (0, 160, 255, 220)
PLAN_WIDTH = 0.6  # m
PLAN_LAYER = 100  # above the roads
VIEW_M = 50.0  # shown to each side of the ego
SCHEME = "real world"  # of SUMO's visualisation settings
EVERY = 3  # of the plan's poses one is drawn


def follow(ego: str) -> None:
    """Colour the ego and let the view follow it."""
    sumo = running_sumo()
    sumo.vehicle.setColor(ego, EGO_COLOUR)
    x, y = sumo.vehicle.getPosition(ego)
    sumo.gui.setSchema(VIEW, SCHEME)
    sumo.gui.setBoundary(VIEW, x - VIEW_M, y - VIEW_M, x + VIEW_M, y + VIEW_M)
    sumo.gui.trackVehicle(VIEW, ego)


def draw_plan(ego: str, poses: Floats) -> None:
    """Draw the plan (poses [M, 4]) as a line in front of the ego; none without poses."""
    polygons = running_sumo().polygon
    name = f"sumo_mcts plan of {ego}"
    points: Sequence[tuple[float, float]] = [(float(x), float(y)) for x, y in poses[::EVERY, :2]]
    if name in polygons.getIDList():
        polygons.remove(name)
    if len(points) > 1:
        polygons.add(name, points, PLAN_COLOUR, False, "plan", PLAN_LAYER, PLAN_WIDTH)
