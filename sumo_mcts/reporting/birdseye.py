"""A moment of an episode seen from above, north up: vehicles, plan, forecast and tried actions.

From a trace alone, without SUMO.
"""

import math
from collections.abc import Callable

import numpy as np
from PIL import Image, ImageDraw

from sumo_mcts.arrays import Floats
from sumo_mcts.records import Trace
from sumo_mcts.reporting.camera import Shot, shot_at, views_of
from sumo_mcts.reporting.canvas import (
    ASPHALT,
    BLINK,
    BRAKE,
    EGO,
    EGO_DARK,
    OTHER,
    OTHER_DARK,
    PAINT,
    SS,
    Colour,
    View,
    draw_dot,
    draw_line,
    draw_polygon,
    draw_tick,
    mixed,
)
from sumo_mcts.reporting.ground import draw_ground, roads_of
from sumo_mcts.reporting.marks import expected, plan_marks, plan_path
from sumo_mcts.reporting.words import BRAKING
from sumo_mcts.scene import RootChild


def picture(trace: Trace, time: float, width: int = 720) -> tuple[Image.Image, View]:
    """One moment as an image without text, and its view; a pixel of the image is SS pixels of the
    view."""
    shot = shot_at(trace, time)
    view = views_of([shot], (width, round(width / 1.5)))[0]
    return draw_panel(draw_ground(roads_of(trace.lanes), view), shot, view).reduce(SS), view


def draw_panel(image: Image.Image, shot: Shot, view: View) -> Image.Image:
    """Draw one moment on an image of the roads in this view; the image."""
    draw = ImageDraw.Draw(image)
    _draw_forecast(draw, view, shot)
    _draw_tried(draw, view, shot)
    _draw_plan(draw, view, shot)
    agents = shot.cycle.agents
    for n, (x, y, heading) in enumerate(shot.others.tolist()):
        if agents.person[n]:
            draw_dot(draw, view.pixels(np.array([x, y]))[0], 0.35 * view.scale, OTHER_DARK)
        else:
            lights = (agents.a[n] < BRAKING, int(agents.blinker[n]))
            draw_car(
                draw,
                view,
                (x, y, heading),
                (agents.length[n], agents.width[n]),
                (OTHER, OTHER_DARK),
                lights,
            )
    ego, state = shot.ego.tolist(), shot.cycle.ego
    draw_car(
        draw,
        view,
        (ego[0], ego[1], ego[2]),
        (state.length, state.width),
        (EGO, EGO_DARK),
        (state.a < BRAKING, 0),
        halo=True,
    )
    return image


# --- vehicles ---


Place = Callable[[list[tuple[float, float]]], Floats]  # points on a vehicle, m, to pixels


def draw_car(
    draw: ImageDraw.ImageDraw,
    view: View,
    pose: tuple[float, float, float],
    size: tuple[float, float],
    colours: tuple[Colour, Colour],
    lights: tuple[bool, int],
    *,
    halo: bool = False,
) -> None:
    """A vehicle from above: its windscreen shows the heading; `lights`: braking, blinker.

    `pose` is x, y (m) and heading (rad), `size` length and width (m).
    """
    place = _placed(view, pose)
    half, side = size[0] / 2, size[1] / 2
    corner = min(0.5, 0.25 * size[0])
    body = [
        (half, 0.55 * side),
        (half - corner, side),
        (-half + 0.4 * corner, side),
        (-half, 0.75 * side),
    ]
    outline = place(body + [(a, -b) for a, b in reversed(body)])
    if halo:
        draw_polygon(draw, outline, PAINT, outline=0.9 * view.scale)
    draw_polygon(draw, outline, colours[0])
    front = half - min(1.1, 0.25 * size[0])
    back = front - min(0.75, 0.2 * size[0])
    windscreen = [
        (front, 0.74 * side), (front, -0.74 * side), (back, -0.62 * side), (back, 0.62 * side),
    ]  # fmt: skip
    draw_polygon(draw, place(windscreen), colours[1])
    lamp = min(0.45, 0.12 * size[0])
    braking, blinker = lights
    if braking:
        for lamps in (side, -side):
            inner, rear = -half + lamp, -half - 0.1
            corners = [(inner, 0.35 * lamps), (inner, lamps), (rear, lamps), (rear, 0.35 * lamps)]
            draw_polygon(draw, place(corners), BRAKE)
    if blinker:
        for along in (half - corner, -half + lamp):
            draw_dot(draw, place([(along, blinker * side)])[0], 0.32 * view.scale, BLINK)


def _placed(view: View, pose: tuple[float, float, float]) -> Place:
    """Pixels of points that are given ahead of and left of a pose, m."""
    x, y, heading = pose
    turn = np.array(
        [[math.cos(heading), math.sin(heading)], [-math.sin(heading), math.cos(heading)]]
    )
    return lambda points: view.pixels(np.array(points) @ turn + (x, y))


# --- forecast, tried actions, plan ---


def _draw_forecast(draw: ImageDraw.ImageDraw, view: View, shot: Shot) -> None:
    """The expected positions of the others, fading."""
    for place, strength in expected(shot):
        colour = mixed(OTHER, ASPHALT, strength)
        draw_dot(draw, view.pixels(place)[0], 0.55 * view.scale, colour)


def _draw_tried(draw: ImageDraw.ImageDraw, view: View, shot: Shot) -> None:
    """The best continuation of each action at the root; more visits make it stronger."""
    most = max((child.visits for child in shot.cycle.decision.children), default=0)
    for i in _by_visits(shot.cycle.decision.children):
        child = shot.cycle.decision.children[i]
        if i == shot.cycle.decision.chosen or len(child.poses) == 0:
            continue
        colour = mixed(EGO, ASPHALT, 0.25 + 0.45 * math.sqrt(child.visits / max(most, 1)))
        pixels = view.pixels(child.poses[:, :2])
        draw_line(draw, pixels, 0.22, colour, view)
        draw_tick(draw, pixels, 0.8 * view.scale, colour, view)


def _draw_plan(draw: ImageDraw.ImageDraw, view: View, shot: Shot) -> None:
    """The chosen plan, marked every second like the forecast."""
    path = plan_path(shot)
    if not len(path):
        return
    draw_line(draw, view.pixels(path), 0.5, EGO, view)
    for mark in plan_marks(shot):
        place = view.pixels(mark)[0]
        if np.linalg.norm(place - view.pixels(shot.ego[:2])[0]) > 1.5 * view.scale:
            draw_dot(draw, place, 0.62 * view.scale, EGO)
            draw_dot(draw, place, 0.34 * view.scale, PAINT)


def _by_visits(children: tuple[RootChild, ...]) -> list[int]:
    return sorted(range(len(children)), key=lambda i: children[i].visits)
