"""Drawings of an episode seen from above, north up: a storyboard (PNG) and an animation (GIF).

From a trace alone, without SUMO.

Everything is drawn with Pillow at twice the size and scaled down; the roads once, under all frames.
Sizes named `px` are those of the finished picture.
"""

import math

import numpy as np
from PIL import Image, ImageDraw

from sumo_mcts.records import Trace
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
    Shot,
    View,
    draw_dot,
    draw_line,
    draw_polygon,
    draw_tick,
    mixed,
)
from sumo_mcts.reporting.ground import draw_ground, roads_of
from sumo_mcts.reporting.words import BRAKES
from sumo_mcts.scene import Agents, Floats, RootChild

MARK_S = 1.0  # expected positions are marked every second, of plan and forecast alike
AHEAD_S = 5.0  # so far ahead
STRIP = 4.4  # aspect ratio of a window on a long straight road


def picture(trace: Trace, time: float, width: int = 720) -> tuple[Image.Image, View]:
    """One moment as an image (without text), and its view; an image pixel is SS pixels of the
    view."""
    shot = shot_at(trace, time)
    view = views_of([shot], (width, round(width / 1.5)))[0]
    return draw_panel(draw_ground(roads_of(trace.lanes), view), shot, view).reduce(SS), view


def extent_of(shots: list[Shot]) -> tuple[float, float]:
    """Width and height of the box around the ego's positions, m."""
    places = np.array([shot.ego[:2] for shot in shots])
    wide, tall = np.ptp(places, axis=0)
    return float(wide), float(tall)


def views_of(shots: list[Shot], size: tuple[int, int], largest: float = 110.0) -> list[View]:
    """One window for all shots where the ego's way fits into `largest` m; else one of the same
    scale that goes with it."""
    wide, tall = size
    stretch = min(max(wide / tall / 1.3, 1.0), 1.8)  # a strip may show more of the road
    spans = extent_of(shots)
    needed = max(spans[0] + 40.0, (spans[1] + 40.0) * wide / tall, 60.0 * stretch)
    fixed = needed <= largest * stretch
    metres = needed if fixed else 88.0 * stretch  # beyond it vehicles would be too small to read
    places = np.array([shot.ego[:2] for shot in shots])
    middle = (places.min(axis=0) + places.max(axis=0)) / 2
    centres = [middle if fixed else _ahead(shot, metres, metres * tall / wide) for shot in shots]
    pixel = metres / wide  # the window moves by whole pixels, so that edges do not flicker
    corners = [
        np.round((centre + np.array([-metres / 2, metres / 2 * tall / wide])) / pixel) * pixel
        for centre in centres
    ]
    return [
        View(float(west), float(north), SS / pixel, (SS * wide, SS * tall))
        for west, north in corners
    ]


def _ahead(shot: Shot, wide: float, tall: float) -> Floats:
    """The point before the ego that a moving window of this size (m) is centred on."""
    return np.array(
        [
            shot.ego[0] + 0.2 * wide * math.cos(shot.ego[2]),
            shot.ego[1] + 0.2 * tall * math.sin(shot.ego[2]),
        ]
    )


def shot_at(trace: Trace, time: float) -> Shot:
    """The moment at a simulation time; between two cycles positions are interpolated, agents told
    by their ids."""
    times = [cycle.time for cycle in trace.cycles]
    i = int(np.clip(np.searchsorted(times, time + 1e-9, side="right") - 1, 0, len(times) - 1))
    cycle, after = trace.cycles[i], trace.cycles[min(i + 1, len(times) - 1)]
    elapsed = max(0.0, time - cycle.time)
    share = min(elapsed / (after.time - cycle.time), 1.0) if after.time > cycle.time else 0.0
    now = np.array([cycle.ego.x, cycle.ego.y, cycle.ego.heading])
    then = np.array([after.ego.x, after.ego.y, after.ego.heading])
    ego = np.append(_between(now, then, share), cycle.ego.v + share * (after.ego.v - cycle.ego.v))
    coming = dict(zip(after.agents.ids, _poses(after.agents), strict=True))
    others = [
        _between(pose, coming.get(name, pose), share)
        for name, pose in zip(cycle.agents.ids, _poses(cycle.agents), strict=True)
    ]
    return Shot(cycle, elapsed, ego, np.array(others).reshape(-1, 3))


def _poses(agents: Agents) -> Floats:
    """[N, 3] x, y, heading."""
    return np.column_stack([agents.x, agents.y, agents.heading])


def _between(a: Floats, b: Floats, share: float) -> Floats:
    """[3] pose on the way from a to b; the heading turns the shorter way round."""
    turn = (b[2] - a[2] + math.pi) % (2 * math.pi) - math.pi
    return a + share * np.array([b[0] - a[0], b[1] - a[1], turn])


# --- what was thought ---


def draw_forecast(draw: ImageDraw.ImageDraw, view: View, shot: Shot) -> None:
    """Where the others are expected, every second, fading."""
    forecast = shot.cycle.forecast
    times = forecast.dt * np.arange(forecast.pose.shape[1])
    for at in reversed(_marks(shot.elapsed, times[-1] if len(times) else 0.0)):
        k = int(np.argmin(np.abs(times - at)))
        for h in np.argsort(forecast.weight):
            strength = fade(at) * (0.35 + 0.65 * float(forecast.weight[h]))
            for n in np.flatnonzero(forecast.valid[h, k]):
                moved = np.hypot(*(forecast.pose[h, k, n, :2] - forecast.pose[h, 0, n, :2]))
                if moved > 0.5:
                    draw_dot(
                        draw,
                        view.pixels(forecast.pose[h, k, n, :2])[0],
                        0.55 * view.scale,
                        mixed(OTHER, ASPHALT, strength),
                    )


def draw_tried(draw: ImageDraw.ImageDraw, view: View, shot: Shot) -> None:
    """The best continuation of every action at the root, the more visited the stronger, with its
    end marked."""
    most = max((child.visits for child in shot.cycle.decision.children), default=0)
    for i in _by_visits(shot.cycle.decision.children):
        child = shot.cycle.decision.children[i]
        if i == shot.cycle.decision.chosen or len(child.poses) == 0:
            continue
        colour = mixed(EGO, ASPHALT, 0.25 + 0.45 * math.sqrt(child.visits / max(most, 1)))
        pixels = view.pixels(child.poses[:, :2])
        draw_line(draw, pixels, 0.22, colour, view)
        draw_tick(draw, pixels, 0.8 * view.scale, colour, view)


def draw_plan(draw: ImageDraw.ImageDraw, view: View, shot: Shot) -> None:
    """The chosen plan from where the ego is, marked every second like the forecast."""
    plan = shot.cycle.decision.plan
    if plan is None or len(plan.time) == 0:
        return
    coming = plan.time > shot.elapsed
    ahead = np.concatenate([shot.ego[None, :2], plan.pose[coming, :2]])
    draw_line(draw, view.pixels(ahead), 0.5, EGO, view)
    for at in reversed(_marks(shot.elapsed, float(plan.time[-1]))):
        place = view.pixels(plan.pose[int(np.argmin(np.abs(plan.time - at))), :2])[0]
        if np.linalg.norm(place - view.pixels(shot.ego[:2])[0]) > 1.5 * view.scale:
            draw_dot(draw, place, 0.62 * view.scale, EGO)
            draw_dot(draw, place, 0.34 * view.scale, PAINT)


def _by_visits(children: tuple[RootChild, ...]) -> list[int]:
    return sorted(range(len(children)), key=lambda i: children[i].visits)


def _marks(elapsed: float, horizon: float) -> list[float]:
    """Times since the decision at which an expected position is marked."""
    return [
        float(t) for t in np.arange(MARK_S, min(AHEAD_S, horizon) + 1e-6, MARK_S) if t > elapsed
    ]


def fade(at: float) -> float:
    return 0.9 - 0.65 * min(at / AHEAD_S, 1.0)


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
    """A vehicle from above: body with a slightly narrower nose, a windscreen that shows its
    heading, brake lights, a blinker."""
    x, y, heading = pose
    half, side = size[0] / 2, size[1] / 2
    turn = np.array(
        [[math.cos(heading), math.sin(heading)], [-math.sin(heading), math.cos(heading)]]
    )

    def place(points: list[tuple[float, float]]) -> Floats:
        return view.pixels(np.array(points) @ turn + (x, y))

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
    draw_polygon(
        draw,
        place(
            [(front, 0.74 * side), (front, -0.74 * side), (back, -0.62 * side), (back, 0.62 * side)]
        ),
        colours[1],
    )
    braking, blinker = lights
    lamp = min(0.45, 0.12 * size[0])
    if braking:
        for sign in (1.0, -1.0):
            draw_polygon(
                draw,
                place(
                    [
                        (-half + lamp, 0.35 * sign * side),
                        (-half + lamp, sign * side),
                        (-half - 0.1, sign * side),
                        (-half - 0.1, 0.35 * sign * side),
                    ]
                ),
                BRAKE,
            )
    if blinker:
        for along in (half - corner, -half + lamp):
            draw_dot(draw, place([(along, blinker * side)])[0], 0.32 * view.scale, BLINK)


# --- the scene ---


def draw_panel(image: Image.Image, shot: Shot, view: View) -> Image.Image:
    """The enlarged drawing of one moment, on an image of the roads in this view."""
    draw = ImageDraw.Draw(image)
    draw_forecast(draw, view, shot)
    draw_tried(draw, view, shot)
    draw_plan(draw, view, shot)
    agents = shot.cycle.agents
    for n, (x, y, heading) in enumerate(shot.others.tolist()):
        if agents.person[n]:
            draw_dot(draw, view.pixels(np.array([x, y]))[0], 0.35 * view.scale, OTHER_DARK)
        else:
            lights = (agents.a[n] < BRAKES, int(agents.blinker[n]))
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
        (state.a < BRAKES, 0),
        halo=True,
    )
    return image
