"""Drawings of an episode seen from above, north up: a storyboard (PNG) and an animation (GIF). From a trace alone, without SUMO.

Everything is drawn with Pillow at twice the size and scaled down; the roads once, under all frames. Sizes named `px` are those of the finished picture.
"""

import io
import math
from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from sumo_mcts.records import CycleRecord, Lanes, Trace, write_whole
from sumo_mcts.scene import Agents, Decision, Floats, Follow, RootChild

Colour = tuple[int, int, int]
Note = Callable[[str], object]  # is told what takes long

PAPER: Colour = (255, 255, 255)
LAND: Colour = (240, 241, 236)
KERB: Colour = (176, 181, 187)
ASPHALT: Colour = (205, 209, 214)
ROUTE: Colour = (196, 209, 228)  # lanes on the ego's way
PAINT: Colour = (250, 250, 250)
EGO: Colour = (18, 92, 224)
EGO_DARK: Colour = (9, 48, 122)
OTHER: Colour = (84, 91, 101)
OTHER_DARK: Colour = (44, 49, 57)
BRAKE: Colour = (222, 46, 46)
BLINK: Colour = (245, 158, 11)
INK: Colour = (28, 32, 38)
FAINT: Colour = (112, 119, 128)

SS = 2  # supersampling
MARK_S = 1.0  # expected positions are marked every second, of plan and forecast alike
AHEAD_S = 5.0  # so far ahead
BRAKES = -1.0  # m/s2; slower changes are no braking
STRIP = 4.4  # aspect ratio of a window on a long straight road
FPS = 10
REAL_TIME_S = 30.0  # a drive up to so long is shown in real time; a longer one so many times faster,
FAST_S = 16.0  # ... a whole number, that it takes at most so long
GIF_BYTES = 1_500_000  # in real time, for up to 20 s, in proportion beyond; faster twice as much. Else every second frame is left out
HOLD_MS = 1500  # the last frame stays
TILES = 8  # pieces of the ground that are kept while the camera moves
PIXELS = 1e6  # how far beyond the window anything is drawn: a line is as much work as it has pixels


class View(NamedTuple):
    """A window on the map: world metres to pixels of the enlarged drawing."""

    west: float  # m
    north: float  # m
    scale: float  # pixels of the enlarged drawing per metre
    size: tuple[int, int]  # width and height of the enlarged drawing, pixels

    def pixels(self, points: Floats) -> Floats:
        """[K, 2] pixel positions of world positions [K, 2]."""
        pixels: Floats = (np.asarray(points, dtype=np.float64).reshape(-1, 2) - (self.west, self.north)) * (self.scale, -self.scale)
        return pixels.clip(-PIXELS, PIXELS)


class Shot(NamedTuple):
    """One moment, between two decisions."""

    cycle: CycleRecord  # the last decision
    elapsed: float  # s since then
    ego: Floats  # [4] x, y, heading, v
    others: Floats  # [N, 3] x, y, heading; the agents of the cycle


def silent(text: str) -> None:
    """A note that nobody reads."""


# --- what people call ---


def storyboard(trace: Trace, path: Path, moments: int = 6) -> None:
    """Write a PNG of some moments of the episode. Raises ValueError where there is no cycle, OSError where it cannot be written."""
    shots = [shot_at(trace, trace.cycles[i].time) for i in choose_moments(trace, moments)]
    columns, aspect = _arrangement(shots)
    columns = min(columns, len(shots))
    width = (1840 - 24 * (columns - 1)) // columns
    views = _views(shots, (width, round(width / aspect)))
    roads = roads_of(trace.lanes)
    panels = [_panel(_ground(roads, view), shot, view) for shot, view in zip(shots, views, strict=True)]
    page = _page(trace, shots, panels, columns, views[0].scale)
    write_whole(path, _png(page.reduce(SS)))


def animation(trace: Trace, path: Path, width: int = 720, note: Note = silent) -> None:
    """Write a GIF of the whole episode, a long one faster than real time. Raises ValueError where there is no cycle, OSError where it cannot be written."""
    speed = film_speed(trace)
    drawn = [frame.quantize(palette=_palette(), dither=Image.Dither.NONE) for frame in frames(trace, width, note)]
    content = _gif(drawn, FPS)
    if len(content) > GIF_BYTES * (2.0 if speed > 1 else max(1.0, _duration(trace) / 20.0)):  # a moving camera leaves no pixel as it was
        content = _gif([*drawn[:-1:2], drawn[-1]], FPS // 2)
    write_whole(path, content)


def picture(trace: Trace, time: float, width: int = 720) -> tuple[Image.Image, View]:
    """One moment as an image (without text), and its view; an image pixel is SS pixels of the view."""
    shot = shot_at(trace, time)
    view = _views([shot], (width, round(width / 1.5)))[0]
    return _panel(_ground(roads_of(trace.lanes), view), shot, view).reduce(SS), view


# --- which moments, which window ---


def choose_moments(trace: Trace, count: int) -> list[int]:
    """Cycles spread evenly over the episode, each moved a little to where the decision changes or somebody is near."""
    total = len(trace.cycles)
    if total == 0:
        raise ValueError(f"{trace.key}: the trace holds no cycle to draw")
    if total <= count:
        return list(range(total))
    interest = [_interest(trace.cycles, i) for i in range(total)]
    targets = np.linspace(0, total - 1, count)
    reach = (targets[1] - targets[0]) / 2 if count > 1 else 0.0
    chosen = []
    for target in targets:
        within = [i for i in range(total) if abs(i - target) < reach]
        at_an_end = target in (0, total - 1)
        chosen.append(round(target) if at_an_end or not within else max(within, key=lambda i: interest[i] - 1.2 * abs(i - target) / reach))
    return chosen


def _interest(cycles: tuple[CycleRecord, ...], i: int) -> float:
    """How much a cycle is worth showing, about 0 to 2."""
    changed = i > 0 and _verb(cycles[i]) != _verb(cycles[i - 1])
    ego, agents = cycles[i].ego, cycles[i].agents
    nearest = float(np.hypot(agents.x - ego.x, agents.y - ego.y).min()) if len(agents.ids) else math.inf
    return float(changed) + 8.0 / max(nearest, 8.0)


def _arrangement(shots: list[Shot]) -> tuple[int, float]:
    """Number of columns and aspect ratio of a panel, after the shape of what the ego drives through."""
    wide, tall = _extent(shots)
    if wide > 100 and wide > 3 * tall:
        return 2, STRIP
    if tall > 100 and tall > 3 * wide:
        return 6, 0.5
    return 3, 1.3


def _extent(shots: list[Shot]) -> tuple[float, float]:
    """Width and height of the box around the ego's positions, m."""
    places = np.array([shot.ego[:2] for shot in shots])
    wide, tall = np.ptp(places, axis=0)
    return float(wide), float(tall)


def _views(shots: list[Shot], size: tuple[int, int], largest: float = 110.0) -> list[View]:
    """One window for all shots where the ego's way fits into `largest` m; else one of the same scale that goes with it."""
    wide, tall = size
    stretch = min(max(wide / tall / 1.3, 1.0), 1.8)  # a strip may show more of the road
    spans = _extent(shots)
    needed = max(spans[0] + 40.0, (spans[1] + 40.0) * wide / tall, 60.0 * stretch)
    fixed = needed <= largest * stretch
    metres = needed if fixed else 88.0 * stretch  # beyond it vehicles would be too small to read
    places = np.array([shot.ego[:2] for shot in shots])
    middle = (places.min(axis=0) + places.max(axis=0)) / 2
    centres = [middle if fixed else _ahead(shot, metres, metres * tall / wide) for shot in shots]
    pixel = metres / wide  # the window moves by whole pixels, so that edges do not flicker
    corners = [np.round((centre + np.array([-metres / 2, metres / 2 * tall / wide])) / pixel) * pixel for centre in centres]
    return [View(float(west), float(north), SS / pixel, (SS * wide, SS * tall)) for west, north in corners]


def _ahead(shot: Shot, wide: float, tall: float) -> Floats:
    """The point before the ego that a moving window of this size (m) is centred on."""
    return np.array([shot.ego[0] + 0.2 * wide * math.cos(shot.ego[2]), shot.ego[1] + 0.2 * tall * math.sin(shot.ego[2])])


def shot_at(trace: Trace, time: float) -> Shot:
    """The moment at a simulation time; between two cycles positions are interpolated, agents told by their ids."""
    times = [cycle.time for cycle in trace.cycles]
    i = int(np.clip(np.searchsorted(times, time + 1e-9, side="right") - 1, 0, len(times) - 1))
    cycle, after = trace.cycles[i], trace.cycles[min(i + 1, len(times) - 1)]
    elapsed = max(0.0, time - cycle.time)
    share = min(elapsed / (after.time - cycle.time), 1.0) if after.time > cycle.time else 0.0
    now = np.array([cycle.ego.x, cycle.ego.y, cycle.ego.heading])
    then = np.array([after.ego.x, after.ego.y, after.ego.heading])
    ego = np.append(_between(now, then, share), cycle.ego.v + share * (after.ego.v - cycle.ego.v))
    coming = dict(zip(after.agents.ids, _poses(after.agents), strict=True))
    others = [_between(pose, coming.get(name, pose), share) for name, pose in zip(cycle.agents.ids, _poses(cycle.agents), strict=True)]
    return Shot(cycle, elapsed, ego, np.array(others).reshape(-1, 3))


def _poses(agents: Agents) -> Floats:
    """[N, 3] x, y, heading."""
    return np.column_stack([agents.x, agents.y, agents.heading])


def _between(a: Floats, b: Floats, share: float) -> Floats:
    """[3] pose on the way from a to b; the heading turns the shorter way round."""
    turn = (b[2] - a[2] + math.pi) % (2 * math.pi) - math.pi
    return a + share * np.array([b[0] - a[0], b[1] - a[1], turn])


# --- words ---


def action_words(cycle: CycleRecord) -> str:
    """What was decided, in words."""
    accel, change = _action(cycle.decision, cycle.ego.v)
    if accel is None:
        return "SUMO drives"
    words = [_verb(cycle)]
    if abs(accel) >= 0.05 and words != ["stand"]:
        sign = "+" if accel > 0 else "\u2212"
        words[0] += f" {sign}{abs(accel):.1f} m/s\u00b2"
    if change:
        words.append("change to the " + ("left" if change > 0 else "right"))
    elif 0 < cycle.ego.changing < 1:
        words.append("changing to the " + ("left" if cycle.ego.change_to > cycle.ego.change_from else "right"))
    reason = cycle.decision.reason.partition(":")[0]  # in the fail-safe's reason an explanation follows
    if reason not in ("", "search", words[0].split()[0]):
        words.append(reason)
    return ", ".join(words)


def _verb(cycle: CycleRecord) -> str:
    accel, _ = _action(cycle.decision, cycle.ego.v)
    if accel is None:
        return "release"
    if cycle.ego.v < 0.1 and accel <= 0.1:
        return "stand"
    limits = ((-4.0, "brake hard"), (-0.05, "brake"), (0.05, "keep speed"))
    return next((word for limit, word in limits if accel < limit), "accelerate")


def _action(decision: Decision, v: float) -> tuple[float | None, int]:
    """Acceleration in m/s2 (None: SUMO drives) and lane change of a decision."""
    if not isinstance(decision.command, Follow):
        return None, 0
    if 0 <= decision.chosen < len(decision.children):
        child = decision.children[decision.chosen]
        return child.accel, child.lane_change
    speeds, plan = decision.command.speeds, decision.plan
    if plan is None or len(speeds) == 0 or plan.time[min(len(speeds), len(plan.time)) - 1] <= 0:
        return 0.0, decision.command.lane_change
    return float((speeds[-1] - v) / plan.time[min(len(speeds), len(plan.time)) - 1]), decision.command.lane_change


# --- the scene ---


def _panel(image: Image.Image, shot: Shot, view: View) -> Image.Image:
    """The enlarged drawing of one moment, on an image of the roads in this view."""
    draw = ImageDraw.Draw(image)
    _draw_forecast(draw, view, shot)
    _draw_tried(draw, view, shot)
    _draw_plan(draw, view, shot)
    agents = shot.cycle.agents
    for n, (x, y, heading) in enumerate(shot.others.tolist()):
        if agents.person[n]:
            _dot(draw, view.pixels(np.array([x, y]))[0], 0.35 * view.scale, OTHER_DARK)
        else:
            lights = (agents.a[n] < BRAKES, int(agents.blinker[n]))
            _car(draw, view, (x, y, heading), (agents.length[n], agents.width[n]), (OTHER, OTHER_DARK), lights)
    ego, state = shot.ego.tolist(), shot.cycle.ego
    _car(draw, view, (ego[0], ego[1], ego[2]), (state.length, state.width), (EGO, EGO_DARK), (state.a < BRAKES, 0), halo=True)
    return image


# --- the roads ---


class Strokes(NamedTuple):
    """Lines or areas of one kind. K of them."""

    shapes: list[Floats]  # [K] each [P, 2] m
    width: Floats  # [K] m
    low: Floats  # [K, 2] corner of the box around each, m
    high: Floats  # [K, 2]


class Roads(NamedTuple):
    """What is drawn of the roads, whatever the window."""

    lanes: Strokes
    route: Strokes  # lanes on the ego's way
    junctions: Strokes  # areas
    paint: Strokes  # lines between lanes, beside them, and where to stop


def roads_of(lanes: Lanes) -> Roads:
    """The roads of a trace, ready to be drawn."""
    shapes = [lanes.points[begin:end] for begin, end in pairwise(lanes.offset.tolist())]
    drawn = [i for i, shape in enumerate(shapes) if len(shape)]
    on_route = [i for i in drawn if lanes.route[i]]
    hulls, borders = _junctions(lanes, shapes), _borders(lanes, shapes)
    return Roads(
        _strokes([shapes[i] for i in drawn], lanes.width[drawn]),
        _strokes([shapes[i] for i in on_route], lanes.width[on_route]),
        _strokes(hulls, np.zeros(len(hulls))),
        _strokes([*borders, *lanes.stop_lines.reshape(-1, 2, 2)], np.repeat([0.16, 0.45], [len(borders), len(lanes.stop_lines)])),
    )


def _strokes(shapes: list[Floats], width: Floats) -> Strokes:
    boxes = np.array([(shape.min(axis=0), shape.max(axis=0)) for shape in shapes]).reshape(-1, 2, 2)
    return Strokes(shapes, width, boxes[:, 0], boxes[:, 1])


def _ground(roads: Roads, view: View) -> Image.Image:
    """Land, asphalt, lane borders and stop lines."""
    image = Image.new("RGB", view.size, LAND)
    draw = ImageDraw.Draw(image)
    for extra, colour in ((0.7, KERB), (0.1, ASPHALT)):  # 0.1: no seams between lanes
        for hull, _ in _seen(roads.junctions, view):
            _polygon(draw, hull, colour, outline=extra * view.scale)
        for line, width in _seen(roads.lanes, view):
            _line(draw, line, width + extra, colour, view)
    for strokes, colour in ((roads.route, ROUTE), (roads.paint, PAINT)):
        for line, width in _seen(strokes, view):
            _line(draw, line, width, colour, view)
    return image


def _seen(strokes: Strokes, view: View) -> Iterator[tuple[Floats, float]]:
    """In whole pixels, which tiles agree about, those that reach into the window, or nearly; with their width in m."""
    margin = 5.0  # m
    west, south, east, north = view.west, view.north - view.size[1] / view.scale, view.west + view.size[0] / view.scale, view.north
    inside = (strokes.high > (west - margin, south - margin)) & (strokes.low < (east + margin, north + margin))
    for i in np.flatnonzero(inside.all(axis=1)).tolist():
        yield np.floor(view.pixels(strokes.shapes[i]) + 1e-6), float(strokes.width[i])


class _Ground:
    """The roads under a camera that moves by whole pixels: drawn once, in tiles of the window's size, as far as they are seen."""

    def __init__(self, roads: Roads, view: View) -> None:
        self._roads, self._origin = roads, view
        self._tiles: dict[tuple[int, int], Image.Image] = {}

    def under(self, view: View) -> Image.Image:
        """The image of a view of the same scale and size."""
        wide, tall = view.size
        x, y = round((view.west - self._origin.west) * view.scale), round((self._origin.north - view.north) * view.scale)
        image = Image.new("RGB", view.size)
        for column in range(x // wide, -(-(x + wide) // wide)):
            for row in range(y // tall, -(-(y + tall) // tall)):
                image.paste(self._tile(column, row), (column * wide - x, row * tall - y))
        return image

    def _tile(self, column: int, row: int) -> Image.Image:
        here = column, row
        if here not in self._tiles:
            west, north, scale, size = self._origin
            self._tiles[here] = _ground(self._roads, View(west + column * size[0] / scale, north - row * size[1] / scale, scale, size))
        self._tiles[here] = self._tiles.pop(here)  # the one used last stands last
        if len(self._tiles) > TILES:
            del self._tiles[next(iter(self._tiles))]
        return self._tiles[here]


def _junctions(lanes: Lanes, shapes: list[Floats]) -> list[Floats]:
    """The area of each junction: the hull of the lanes inside it."""
    inside: dict[str, list[Floats]] = defaultdict(list)
    for i, shape in enumerate(shapes):
        if lanes.internal[i] and len(shape):
            half = lanes.width[i] / 2
            inside[lanes.lane_ids[i].rsplit("_", 2)[0]] += [_beside(shape, half), _beside(shape, -half)]
    return [_hull(np.concatenate(sides)) for sides in inside.values()]


def _borders(lanes: Lanes, shapes: list[Floats]) -> list[Floats]:
    """Broken lines between the lanes of an edge, a solid one to the left of it."""
    places = [lane_id.rpartition("_") for lane_id in lanes.lane_ids]
    top: dict[str, int] = defaultdict(int)
    for edge, _, index in places:
        top[edge] = max(top[edge], int(index) if index.isdecimal() else 0)
    found: list[Floats] = []
    for i, (edge, _, index) in enumerate(places):
        if lanes.internal[i] or not index.isdecimal() or not len(shapes[i]):
            continue
        if int(index) > 0:
            found += list(_dashes(_beside(shapes[i], -lanes.width[i] / 2), 3.0, 4.5))
        if int(index) == top[edge]:
            found.append(_beside(shapes[i], lanes.width[i] / 2))
    return found


# --- what was thought ---


def _draw_forecast(draw: ImageDraw.ImageDraw, view: View, shot: Shot) -> None:
    """Where the others are expected, every second, fading."""
    forecast = shot.cycle.forecast
    times = forecast.dt * np.arange(forecast.pose.shape[1])
    for at in reversed(_marks(shot.elapsed, times[-1] if len(times) else 0.0)):
        k = int(np.argmin(np.abs(times - at)))
        for h in np.argsort(forecast.weight):
            strength = _fade(at) * (0.35 + 0.65 * float(forecast.weight[h]))
            for n in np.flatnonzero(forecast.valid[h, k]):
                moved = np.hypot(*(forecast.pose[h, k, n, :2] - forecast.pose[h, 0, n, :2]))
                if moved > 0.5:
                    _dot(draw, view.pixels(forecast.pose[h, k, n, :2])[0], 0.55 * view.scale, _mix(OTHER, ASPHALT, strength))


def _draw_tried(draw: ImageDraw.ImageDraw, view: View, shot: Shot) -> None:
    """The best continuation of every action at the root, the more visited the stronger, with its end marked."""
    most = max((child.visits for child in shot.cycle.decision.children), default=0)
    for i in _by_visits(shot.cycle.decision.children):
        child = shot.cycle.decision.children[i]
        if i == shot.cycle.decision.chosen or len(child.poses) == 0:
            continue
        colour = _mix(EGO, ASPHALT, 0.25 + 0.45 * math.sqrt(child.visits / max(most, 1)))
        pixels = view.pixels(child.poses[:, :2])
        _line(draw, pixels, 0.22, colour, view)
        _tick(draw, pixels, 0.8 * view.scale, colour, view)


def _draw_plan(draw: ImageDraw.ImageDraw, view: View, shot: Shot) -> None:
    """The chosen plan from where the ego is, marked every second like the forecast."""
    plan = shot.cycle.decision.plan
    if plan is None or len(plan.time) == 0:
        return
    coming = plan.time > shot.elapsed
    ahead = np.concatenate([shot.ego[None, :2], plan.pose[coming, :2]])
    _line(draw, view.pixels(ahead), 0.5, EGO, view)
    for at in reversed(_marks(shot.elapsed, float(plan.time[-1]))):
        place = view.pixels(plan.pose[int(np.argmin(np.abs(plan.time - at))), :2])[0]
        if np.linalg.norm(place - view.pixels(shot.ego[:2])[0]) > 1.5 * view.scale:
            _dot(draw, place, 0.62 * view.scale, EGO)
            _dot(draw, place, 0.34 * view.scale, PAINT)


def _by_visits(children: tuple[RootChild, ...]) -> list[int]:
    return sorted(range(len(children)), key=lambda i: children[i].visits)


def _marks(elapsed: float, horizon: float) -> list[float]:
    """Times since the decision at which an expected position is marked."""
    return [float(t) for t in np.arange(MARK_S, min(AHEAD_S, horizon) + 1e-6, MARK_S) if t > elapsed]


def _fade(at: float) -> float:
    return 0.9 - 0.65 * min(at / AHEAD_S, 1.0)


def _car(
    draw: ImageDraw.ImageDraw,
    view: View,
    pose: tuple[float, float, float],
    size: tuple[float, float],
    colours: tuple[Colour, Colour],
    lights: tuple[bool, int],
    *,
    halo: bool = False,
) -> None:
    """A vehicle from above: body with a slightly narrower nose, a windscreen that shows its heading, brake lights, a blinker."""
    x, y, heading = pose
    half, side = size[0] / 2, size[1] / 2
    turn = np.array([[math.cos(heading), math.sin(heading)], [-math.sin(heading), math.cos(heading)]])

    def place(points: list[tuple[float, float]]) -> Floats:
        return view.pixels(np.array(points) @ turn + (x, y))

    corner = min(0.5, 0.25 * size[0])
    body = [(half, 0.55 * side), (half - corner, side), (-half + 0.4 * corner, side), (-half, 0.75 * side)]
    outline = place(body + [(a, -b) for a, b in reversed(body)])
    if halo:
        _polygon(draw, outline, PAINT, outline=0.9 * view.scale)
    _polygon(draw, outline, colours[0])
    front = half - min(1.1, 0.25 * size[0])
    back = front - min(0.75, 0.2 * size[0])
    _polygon(draw, place([(front, 0.74 * side), (front, -0.74 * side), (back, -0.62 * side), (back, 0.62 * side)]), colours[1])
    braking, blinker = lights
    lamp = min(0.45, 0.12 * size[0])
    if braking:
        for sign in (1.0, -1.0):
            _polygon(
                draw,
                place([(-half + lamp, 0.35 * sign * side), (-half + lamp, sign * side), (-half - 0.1, sign * side), (-half - 0.1, 0.35 * sign * side)]),
                BRAKE,
            )
    if blinker:
        for along in (half - corner, -half + lamp):
            _dot(draw, place([(along, blinker * side)])[0], 0.32 * view.scale, BLINK)


# --- strokes ---


def _line(draw: ImageDraw.ImageDraw, pixels: Floats, metres: float, colour: Colour, view: View) -> None:
    draw.line([(x, y) for x, y in pixels.tolist()], fill=colour, width=max(1, round(metres * view.scale)), joint="curve")


def _polygon(draw: ImageDraw.ImageDraw, pixels: Floats, colour: Colour, outline: float = 0.0) -> None:
    corners = [(x, y) for x, y in pixels.tolist()]
    if len(corners) < 3:
        return
    draw.polygon(corners, fill=colour)
    if outline >= 1:
        draw.line([*corners, corners[0], corners[1]], fill=colour, width=round(outline), joint="curve")


def _dot(draw: ImageDraw.ImageDraw, centre: Floats, radius: float, colour: Colour) -> None:
    x, y = centre.tolist()
    draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=colour)


def _tick(draw: ImageDraw.ImageDraw, pixels: Floats, half: float, colour: Colour, view: View) -> None:
    """A short bar across the end of a line."""
    if len(pixels) < 2 or np.linalg.norm(pixels[-1] - pixels[0]) < half:
        return
    along = pixels[-1] - pixels[-2]
    across = np.array([-along[1], along[0]]) / max(float(np.linalg.norm(along)), 1e-9) * half
    _line(draw, np.array([pixels[-1] - across, pixels[-1] + across]), 0.22, colour, view)


def _beside(shape: Floats, distance: float) -> Floats:
    """[P, 2] the shape moved to the left by a distance, m."""
    along = np.gradient(shape, axis=0) if len(shape) > 1 else np.zeros_like(shape)
    unit = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    return np.asarray(shape + distance * np.column_stack([-unit[:, 1], unit[:, 0]]))


def _dashes(shape: Floats, dash: float, gap: float) -> Floats:
    """[K, 2, 2] pieces of a broken line along a shape, m."""
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(shape, axis=0), axis=1))])
    starts = np.arange(gap / 2, s[-1] - dash, dash + gap)
    ends = np.column_stack([starts, starts + dash])
    return np.stack([np.interp(ends, s, shape[:, 0]), np.interp(ends, s, shape[:, 1])], axis=-1)


def _hull(points: Floats) -> Floats:
    """[K, 2] convex hull, counter-clockwise (upper and lower chain over the sorted points)."""
    ordered = sorted(set(map(tuple, points.round(3).tolist())))

    def chain(places: list[Any]) -> list[Any]:
        kept: list[Any] = []
        for p in places:
            while len(kept) > 1 and (kept[-1][0] - kept[-2][0]) * (p[1] - kept[-2][1]) <= (kept[-1][1] - kept[-2][1]) * (p[0] - kept[-2][0]):
                kept.pop()
            kept.append(p)
        return kept[:-1]

    return np.array(chain(ordered) + chain(ordered[::-1])).reshape(-1, 2)


def _mix(colour: Colour, ground: Colour, share: float) -> Colour:
    """The colour laid over a ground with this opacity."""
    r, g, b = (round(share * c + (1 - share) * d) for c, d in zip(colour, ground, strict=True))
    return r, g, b


# --- the storyboard's page ---


@cache
def _font(px: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, which comes with matplotlib: the same everywhere."""
    return ImageFont.truetype(str(Path(mpl.get_data_path()) / "fonts" / "ttf" / ("DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf")), px * SS)


def _write(draw: ImageDraw.ImageDraw, at: tuple[float, float], text: str, px: int, colour: Colour = INK, *, bold: bool = False, anchor: str = "ls") -> float:
    """Text at a position of the finished picture; where it ends."""
    font = _font(px, bold)
    draw.text((at[0] * SS, at[1] * SS), text, font=font, fill=colour, anchor=anchor)
    return at[0] + draw.textlength(text, font=font) / SS


def _page(trace: Trace, shots: list[Shot], panels: list[Image.Image], columns: int, scale: float) -> Image.Image:
    """Heading, panels with captions, legend; enlarged."""
    margin, gap, caption, top, bottom = 40, 24, 62, 104, 96
    width, height = panels[0].width // SS, panels[0].height // SS
    rows = math.ceil(len(panels) / columns)
    total = (2 * margin + columns * width + (columns - 1) * gap, top + rows * (caption + height) + (rows - 1) * gap + bottom)
    page = Image.new("RGB", (total[0] * SS, total[1] * SS), PAPER)
    draw = ImageDraw.Draw(page)
    _heading(draw, trace, margin, total[0] - margin)
    mask = _rounded((width * SS, height * SS), 10 * SS)
    for n, (shot, panel) in enumerate(zip(shots, panels, strict=True)):
        x, y = margin + n % columns * (width + gap), top + n // columns * (caption + height + gap)
        _caption(draw, shot, x, y, width)
        page.paste(panel, (x * SS, (y + caption) * SS), mask)
    _legend(draw, margin, total[0] - margin, total[1] - bottom / 2 + 6, scale)
    return page


def _heading(draw: ImageDraw.ImageDraw, trace: Trace, left: float, right: float) -> None:
    words = trace.scenario.replace("-", " ").replace("_", " ")
    _write(draw, (left, 62), _fitted(draw, words[:1].upper() + words[1:], 36, right - left - 260), 30, bold=True)  # 36: bold is wider
    good = trace.outcome == "arrived"
    _write(draw, (right, 54), trace.outcome.replace("_", " "), 22, INK if good else BRAKE, bold=True, anchor="rs")
    _write(draw, (right, 78), _fitted(draw, trace.key, 13, right - left), 13, FAINT, anchor="rs")


def _caption(draw: ImageDraw.ImageDraw, shot: Shot, x: float, y: float, width: float) -> None:
    """Time, speed and the action in words; on one line where there is room."""
    end = _write(draw, (x, y + 24), f"{shot.cycle.time:.1f} s", 20, bold=True)
    _write(draw, (end + 12, y + 24), f"{shot.ego[3]:.1f} m/s", 17, FAINT)
    _write(draw, (x, y + 50), _fitted(draw, action_words(shot.cycle), 17, width), 17, EGO)


def _fitted(draw: ImageDraw.ImageDraw, text: str, px: int, width: float) -> str:
    """The text, cut where it would not fit."""
    if draw.textlength(text, font=_font(px)) <= width * SS:
        return text
    while text and draw.textlength(text + "\u2026", font=_font(px)) > width * SS:
        text = text[:-1]
    return text.rstrip(" ,") + "\u2026"


def _rounded(size: tuple[int, int], radius: int) -> Image.Image:
    mask = Image.new("L", size, 0)
    ImageDraw.Draw(mask).rounded_rectangle((0, 0, size[0] - 1, size[1] - 1), radius, fill=255)
    return mask


def _legend(draw: ImageDraw.ImageDraw, left: float, right: float, y: float, scale: float) -> None:
    """The signs that the panels use, the scale and north."""
    view = View(0.0, 0.0, 7.0 * SS, (0, 0))
    cars = (((EGO, EGO_DARK), False, "ego"), ((OTHER, OTHER_DARK), False, "others"), ((OTHER, OTHER_DARK), True, "braking"))
    x = left
    for colours, braking, text in cars:
        _car(draw, view, ((x + 17) / 7.0, -y / 7.0, 0.0), (4.8, 1.9), colours, (braking, 0))
        x = _write(draw, (x + 44, y + 5), text, 15) + 30
    for k in range(4):
        _dot(draw, np.array([x + 6 + 14 * k, y]) * SS, 4.5 * SS, _mix(OTHER, PAPER, _fade(k + 1.0)))
    x = _write(draw, (x + 64, y + 5), "expected, every second", 15) + 30
    ahead = np.array([[x, y], [x + 44, y]]) * SS
    _line(draw, ahead, 0.5, EGO, view)
    for k in range(3):
        _dot(draw, np.array([x + 10 + 14 * k, y]) * SS, 4.5 * SS, EGO)
        _dot(draw, np.array([x + 10 + 14 * k, y]) * SS, 2.5 * SS, PAINT)
    x = _write(draw, (x + 56, y + 5), "plan", 15) + 30
    for k, share in enumerate((0.3, 0.5, 0.7)):
        tried = np.array([[x, y - 7 + 7 * k], [x + 26 + 8 * k, y - 7 + 7 * k]]) * SS
        _line(draw, tried, 0.22, _mix(EGO, PAPER, share), view)
        _tick(draw, tried, 3.0 * SS, _mix(EGO, PAPER, share), view)
    _write(draw, (x + 54, y + 5), "also tried, stronger: more visits", 15)
    _scale_bar(draw, right, y, scale)


def _scale_bar(draw: ImageDraw.ImageDraw, right: float, y: float, scale: float) -> None:
    metres = max((m for m in (5, 10, 20, 50) if m * scale / SS <= 150), default=5)
    long = metres * scale / SS
    north = (right - 8) * SS
    draw.polygon([(north, (y - 22) * SS), (north - 7 * SS, (y - 4) * SS), (north, (y - 9) * SS), (north + 7 * SS, (y - 4) * SS)], fill=INK)
    _write(draw, (right - 8, y + 12), "N", 13, bold=True, anchor="ms")
    bar = [
        ((right - 36 - long) * SS, (y - 4) * SS),
        ((right - 36 - long) * SS, (y + 1) * SS),
        ((right - 36) * SS, (y + 1) * SS),
        ((right - 36) * SS, (y - 4) * SS),
    ]
    draw.line(bar, fill=INK, width=2 * SS)
    _write(draw, (right - 36 - long / 2, y - 8), f"{metres} m", 14, anchor="ms")


def _png(image: Image.Image) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, format="PNG", optimize=False)
    return buffer.getvalue()


# --- the animation ---

_BAND = 44  # px: the line of text below the scene


def film_speed(trace: Trace) -> int:
    """How many times faster than real time an episode is shown, so that no film has more frames than REAL_TIME_S."""
    duration = _duration(trace)
    return 1 if duration <= REAL_TIME_S else math.ceil(duration / FAST_S)


def _duration(trace: Trace) -> float:
    """From the first decision to the last, s."""
    if not trace.cycles:
        raise ValueError(f"{trace.key}: the trace holds no cycle to draw")
    return trace.cycles[-1].time - trace.cycles[0].time


def frame_times(trace: Trace) -> Floats:
    """[F] simulation times of the frames, s: from the first decision to the last, FPS of them a second of the film."""
    apart, duration = film_speed(trace) / FPS, _duration(trace)
    elapsed: Floats = np.minimum(apart * np.arange(math.ceil(duration / apart - 1e-6) + 1), duration)
    return trace.cycles[0].time + elapsed


def frames(trace: Trace, width: int, note: Note = silent) -> Iterator[Image.Image]:
    """The whole episode, FPS frames a second. Raises ValueError where there is no cycle."""
    shots, speed = [shot_at(trace, float(time)) for time in frame_times(trace)], film_speed(trace)
    _, aspect = _arrangement(shots)
    height = round(width / (0.75 * STRIP if aspect == STRIP else 1.5))
    views = _views(shots, (width, height), largest=145.0)  # a camera that stays is worth smaller vehicles
    ground = _Ground(roads_of(trace.lanes), views[0])
    for number, (shot, view) in enumerate(zip(shots, views, strict=True), 1):
        note(f"drawing the film  frame {number} of {len(shots)}")
        yield _frame(_panel(ground.under(view), shot, view), shot, trace.outcome if number == len(shots) else "", speed)


def _gif(drawn: list[Image.Image], fps: int) -> bytes:
    """The encoded animation."""
    durations = [1000 // fps] * (len(drawn) - 1) + [HOLD_MS]
    buffer = io.BytesIO()
    drawn[0].save(buffer, format="GIF", save_all=True, append_images=drawn[1:], duration=durations, loop=0, disposal=1, optimize=False)
    return buffer.getvalue()


def _frame(panel: Image.Image, shot: Shot, ended: str, speed: int) -> Image.Image:
    """The finished frame: scene and a line of text; `speed`: times faster than real time."""
    scene = panel.reduce(SS)
    frame = Image.new("RGB", (scene.width, scene.height + _BAND), PAPER)
    frame.paste(scene, (0, 0))
    band = Image.new("RGB", (scene.width * SS, _BAND * SS), PAPER)
    draw = ImageDraw.Draw(band)
    end = _write(draw, (14, 29), f"{shot.cycle.time + shot.elapsed:.1f} s", 17, bold=True)
    end = _write(draw, (max(96, end + 14), 29), f"{shot.ego[3]:.1f} m/s", 15, FAINT)
    if speed > 1:
        end = _write(draw, (end + 14, 29), f"{speed}\u00d7 speed", 15, FAINT)
    text = ended.replace("_", " ") if ended else action_words(shot.cycle)
    colour = EGO if ended in ("", "arrived") else BRAKE
    _write(draw, (scene.width - 14, 29), _fitted(draw, text, 15, scene.width - 34 - end), 15, colour, bold=bool(ended), anchor="rs")
    frame.paste(band.reduce(SS), (0, scene.height))
    return frame


@cache
def _palette() -> Image.Image:
    """The colours that occur and the steps between neighbours: one palette for all frames, so that still pixels stay the same."""
    pairs = [(LAND, KERB), (KERB, ASPHALT), (ASPHALT, PAINT), (ASPHALT, EGO), (ASPHALT, OTHER), (ROUTE, EGO), (ROUTE, PAINT), (EGO, PAINT), (OTHER, OTHER_DARK)]
    pairs += [(EGO, EGO_DARK), (ASPHALT, BRAKE), (ASPHALT, BLINK), (PAPER, INK), (PAPER, FAINT), (PAPER, EGO), (PAPER, BRAKE), (ASPHALT, ROUTE)]
    colours = list(dict.fromkeys(_mix(a, b, share) for a, b in pairs for share in (0.0, 0.25, 0.5, 0.75, 1.0)))
    image = Image.new("P", (1, 1))
    image.putpalette([channel for colour in colours for channel in colour])
    return image
