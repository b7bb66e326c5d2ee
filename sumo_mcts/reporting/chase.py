"""A moment of an episode from behind and above the ego, in perspective."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from PIL import Image, ImageDraw

from sumo_mcts.arrays import Floats
from sumo_mcts.reporting.camera import Shot
from sumo_mcts.reporting.canvas import (
    ASPHALT,
    EGO,
    EGO_DARK,
    KERB,
    LAND,
    OTHER,
    OTHER_DARK,
    PAINT,
    ROUTE,
    Colour,
    draw_polygon,
    mixed,
)
from sumo_mcts.reporting.ground import Roads, Strokes, beside
from sumo_mcts.reporting.lights import Light
from sumo_mcts.reporting.marks import expected, plan_marks, plan_path
from sumo_mcts.reporting.perspective import NEAR, Eye, clipped, eye_behind
from sumo_mcts.reporting.solids import Face, normal_of, person, vehicle
from sumo_mcts.reporting.words import BRAKING

SKY: Colour = (205, 219, 235)
HAZE: Colour = (236, 240, 243)
CLEAR_M, HAZE_M = 40.0, 150.0  # m: haze begins; and what then takes away all but a third
REACH_M = 260.0  # what is further away is not drawn
ON_ROAD = 0.02  # m: what lies on the road lies above it


def chase(
    roads: Roads, shot: Shot, lights: Sequence[Light], size: tuple[int, int]
) -> tuple[Image.Image, Eye]:
    """The picture, `size` in pixels, and the eye that sees it."""
    x, y, heading = shot.ego[:3].tolist()
    eye = eye_behind(x, y, heading, size)
    image = Image.new("RGB", size, LAND)
    draw = ImageDraw.Draw(image)
    _draw_roads(draw, eye, roads)
    for light in lights:
        for area in _ribbon(light.bar, 0.7):
            _fill(draw, eye, area, light.colour)
    _draw_marks(draw, eye, shot)
    image = _with_sky(image, eye)
    _draw_solids(ImageDraw.Draw(image), eye, shot)
    return image, eye


# --- the ground ---


def _draw_roads(draw: ImageDraw.ImageDraw, eye: Eye, roads: Roads) -> None:
    """Asphalt with its kerbs, the route, and paint."""
    for extra, colour in ((0.7, KERB), (0.1, ASPHALT)):
        for hull, _ in _near(roads.junctions, eye):
            _fill(draw, eye, _flat(hull), colour)
        for line, width in _near(roads.lanes, eye):
            for area in _ribbon(line, width + extra):
                _fill(draw, eye, area, colour)
    for strokes, colour in ((roads.route, ROUTE), (roads.paint, PAINT)):
        for line, width in _near(strokes, eye):
            for area in _ribbon(line, width):
                _fill(draw, eye, area, colour)


def _near(strokes: Strokes, eye: Eye) -> Iterator[tuple[Floats, float]]:
    """The strokes within reach: [P, 2] m, and the width, m."""
    here = eye.place[:2]
    inside = (strokes.high > here - REACH_M) & (strokes.low < here + REACH_M)
    for i in np.flatnonzero(inside.all(axis=1)).tolist():
        yield strokes.shapes[i], float(strokes.width[i])


def _ribbon(line: Floats, width: float) -> Iterator[Floats]:
    """[4, 3] the areas of a line [P, 2] of this width, m, one for each of its pieces."""
    left, right = _flat(beside(line, width / 2)), _flat(beside(line, -width / 2))
    for k in range(len(line) - 1):
        yield np.array([right[k], right[k + 1], left[k + 1], left[k]])


def _flat(points: Floats) -> Floats:
    """[K, 3] points [K, 2] on the road."""
    return np.column_stack([points, np.zeros(len(points))])


def _fill(draw: ImageDraw.ImageDraw, eye: Eye, area: Floats, colour: Colour) -> None:
    """Draw a convex area [K, 3], as far as it is ahead."""
    seen = eye.seen(area)
    if seen[:, 2].max() > NEAR:
        draw_polygon(draw, eye.pixels(clipped(seen)), colour)


def _draw_marks(draw: ImageDraw.ImageDraw, eye: Eye, shot: Shot) -> None:
    """Where others are expected, and the plan."""
    for place, strength in expected(shot):
        _draw_disc(draw, eye, place, 0.55, mixed(OTHER, ASPHALT, strength))
    path = plan_path(shot)
    for area in _ribbon(path, 0.5) if len(path) > 1 else ():
        _fill(draw, eye, area, EGO)
    for place in plan_marks(shot):
        _draw_disc(draw, eye, place, 0.75, EGO)
        _draw_disc(draw, eye, place, 0.42, PAINT)


def _draw_disc(
    draw: ImageDraw.ImageDraw, eye: Eye, place: Floats, radius: float, colour: Colour
) -> None:
    turn = np.linspace(0, 2 * math.pi, 25)[:-1]
    _fill(draw, eye, _flat(place + radius * np.column_stack([np.cos(turn), np.sin(turn)])), colour)


# --- the air ---


def _haze(metres: Floats) -> Floats:
    """How much of what is so far away is lost, 0..1."""
    lost: Floats = 1.0 - np.exp(-np.maximum(metres - CLEAR_M, 0.0) / HAZE_M)
    return lost


def _with_sky(image: Image.Image, eye: Eye) -> Image.Image:
    """The ground under haze, and a sky above the horizon."""
    wide, tall = eye.size
    rows = np.arange(0.5, tall)
    lost = _haze(eye.depth(rows))
    above = np.clip((eye.horizon - rows) / max(eye.horizon, 1.0), 0.0, 1.0)[:, None]
    air = np.array(HAZE) + above * (np.array(SKY) - np.array(HAZE))
    column = np.round(air).astype(np.uint8)[:, None]
    mask = Image.fromarray(np.round(255 * lost).astype(np.uint8)[:, None]).resize((wide, tall))
    return Image.composite(Image.fromarray(column).resize((wide, tall)), image, mask)


# --- vehicles and people ---


def _draw_solids(draw: ImageDraw.ImageDraw, eye: Eye, shot: Shot) -> None:
    """The ego and the others, the furthest first."""
    agents, state = shot.cycle.agents, shot.cycle.ego
    looks = (state.a < BRAKING, 0)
    solids = [(shot.ego[:3], vehicle((state.length, state.width), (EGO, EGO_DARK), looks),
               (state.length, state.width))]  # fmt: skip
    for n, pose in enumerate(shot.others):
        size = float(agents.length[n]), float(agents.width[n])
        lights = (bool(agents.a[n] < BRAKING), int(agents.blinker[n]))
        colours = (OTHER, OTHER_DARK)
        faces = person(size[1], colours) if agents.person[n] else vehicle(size, colours, lights)
        solids.append((pose, faces, size))
    far = [float(eye.seen(np.array([*pose[:2], 0.5]))[2]) for pose, _, _ in solids]
    for n in sorted(range(len(solids)), key=lambda n: -far[n]):
        if NEAR < far[n] < REACH_M:
            _draw_solid(draw, eye, *solids[n])


def _draw_solid(
    draw: ImageDraw.ImageDraw, eye: Eye, pose: Floats, faces: list[Face], size: tuple[float, float]
) -> None:
    """A shadow and the faces that are turned to the eye."""
    half, side = size[0] / 2 + 0.1, size[1] / 2 + 0.12
    corners = [(-half, -side), (half, -side), (half, side), (-half, side)]
    shadow = placed(np.array([(x, y - 0.12, ON_ROAD) for x, y in corners]), pose)
    lost = float(_haze(np.array(np.hypot(*(pose[:2] - eye.place[:2])))))
    _fill(draw, eye, shadow, mixed(HAZE, (142, 148, 156), lost))
    for face in faces:
        area = placed(face.corners, pose)
        if normal_of(area) @ (eye.place - area[0]) > 0:
            _fill(draw, eye, area, mixed(HAZE, face.colour, lost))


def placed(points: Floats, pose: Floats) -> Floats:
    """[K, 3] points around the middle of a vehicle at a pose (x, y, heading), in the world, m."""
    x, y, heading = pose.tolist()
    cos, sin = math.cos(heading), math.sin(heading)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    moved: Floats = points @ turn + (x, y, 0.0)
    return moved
