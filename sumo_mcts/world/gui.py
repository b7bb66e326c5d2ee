"""SUMO's own window: the view follows the ego, which is coloured, and its plan is drawn."""

from collections.abc import Sequence

from sumo_mcts.scene import Floats
from sumo_mcts.world.simulation import import_libsumo

VIEW = "View #0"
EGO_COLOUR = (0, 105, 210, 255)
PLAN_COLOUR = (0, 160, 255, 220)
ZOOM = 900.0
DELAY_MS = "60"


def gui_options() -> list[str]:
    """Options of sumo-gui."""
    return ["--start", "--quit-on-end", "--delay", DELAY_MS, "--window-size", "1200,800"]


def follow(ego: str) -> None:
    """Colour the ego and let the view follow it."""
    sumo = import_libsumo()
    sumo.vehicle.setColor(ego, EGO_COLOUR)
    sumo.gui.trackVehicle(VIEW, ego)
    sumo.gui.setZoom(VIEW, ZOOM)


def draw_plan(ego: str, poses: Floats) -> None:
    """Draw the plan (poses [M, 4]) as a line in front of the ego; none without poses."""
    polygons = import_libsumo().polygon
    name = f"sumo_mcts plan of {ego}"
    points: Sequence[tuple[float, float]] = [(float(x), float(y)) for x, y in poses[::3, :2]]
    if name in polygons.getIDList():
        polygons.remove(name)
    if len(points) > 1:
        polygons.add(name, points, PLAN_COLOUR, False, "plan", 100, 0.6)
