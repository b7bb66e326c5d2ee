"""Chosen moments of an episode: a column for each, a row for each view."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from sumo_mcts.arrays import Floats
from sumo_mcts.records import Trace
from sumo_mcts.reporting.birdseye import draw_panel
from sumo_mcts.reporting.camera import Shot, shot_at, views_of
from sumo_mcts.reporting.canvas import INK, PAPER, SS, View, draw_line, fitted, font_of
from sumo_mcts.reporting.chase import chase, placed
from sumo_mcts.reporting.ground import Roads, draw_ground, roads_of
from sumo_mcts.reporting.lights import Light, lights
from sumo_mcts.reporting.perspective import NEAR, Eye
from sumo_mcts.reporting.picture_page import Strip, column_width, write_page
from sumo_mcts.reporting.solids import LONG
from sumo_mcts.road import RoadMap

VIEWS = ("above", "chase")
MOST = 6  # moments: more would be too small to read
ASPECTS = {"above": 1.3, "chase": 1.6}
BESIDE = 1.45  # of both views, where they stand side by side
LABELLED, LABEL_PX = 8, 15  # the nearest agents; letters
LABEL_WIDTH = 170.0  # px
LIFTS = 4  # heights at which a label may stand
NEAR_M = 45.0  # agents as near as this are in a window that stays
LARGEST_M = 130.0  # of such a window

HIGH = 1.5  # m: the ego in the picture
CORNERS = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0.0, 1.0)])

Box = tuple[float, float, float, float]  # left, upper, right, lower, pixels of the drawing


class Label(NamedTuple):
    """What is written over an agent."""

    at: Floats  # [2] pixels of the drawing: the middle of the text's lower edge
    text: str


def sheet(
    trace: Trace, road: RoadMap | None, times: Sequence[float], views: Sequence[str], path: Path
) -> None:
    """Write a PNG of the moments at these simulation times, s, in these of VIEWS.

    Without a map no signals are drawn. Raises ValueError where there is no cycle, OSError where it
    cannot be written.
    """
    if not trace.cycles:
        raise ValueError(f"{trace.key}: the trace holds no cycle to draw")
    shots = [shot_at(trace, time) for time in times]
    alone = len(shots) == 1
    width = column_width(max(len(shots), len(views) if alone else 1))
    heights = {
        view: round(width / (BESIDE if alone and len(views) > 1 else ASPECTS[view]))
        for view in views
    }
    windows = views_of(
        shots, (width, heights.get("above", width)), largest=LARGEST_M, also=_near(shots)
    )
    roads = roads_of(trace.lanes)
    shown = [lights(road, shot.cycle.signals) if road is not None else [] for shot in shots]
    rows = [
        [
            _above(roads, shot, bars, window)
            if view == "above"
            else _chase(roads, shot, bars, (width * SS, heights[view] * SS))
            for shot, bars, window in zip(shots, shown, windows, strict=True)
        ]
        for view in views
    ]
    strips = (
        [Strip(shots * len(views), [panel for row in rows for panel in row])]
        if alone
        else [Strip(shots if k == 0 else [], row) for k, row in enumerate(rows)]
    )
    write_page(path, trace, strips, windows[0].scale if "above" in views else None)


def _near(shots: list[Shot]) -> Floats:
    """[K, 2] where agents near the ego are, m."""
    places = [shot.others[:, :2] for shot in shots]
    near = [
        others[np.hypot(*(others - shot.ego[:2]).T) < NEAR_M]
        for shot, others in zip(shots, places, strict=True)
    ]
    return np.concatenate(near)


def _above(roads: Roads, shot: Shot, bars: list[Light], view: View) -> Image.Image:
    """The moment from above, north up."""
    image = draw_ground(roads, view)
    draw = ImageDraw.Draw(image)
    for light in bars:
        draw_line(draw, view.pixels(light.bar), 0.7, light.colour, view)
    draw_panel(image, shot, view)
    at = view.pixels(shot.others[:, :2])
    there = np.all((at > 0) & (at < view.size), axis=1)
    labels = [Label(at[n] - (0, 1.9 * view.scale), text) for n, text in _named(shot) if there[n]]
    ego, *others = (
        _box_of(view.pixels(corners[:, :2])) for corners in _bodies(shot, range(len(at)))
    )
    _write_labels(draw, view.size, labels, ego, others)
    return image


def _chase(roads: Roads, shot: Shot, bars: list[Light], size: tuple[int, int]) -> Image.Image:
    """The moment from behind the ego."""
    image, eye = chase(roads, shot, bars, size)
    labels = [Label(at, text) for n, text in _named(shot) if (at := _top(eye, shot, n)) is not None]
    ego = next(_bodies(shot, ()))
    _write_labels(ImageDraw.Draw(image), size, labels, _box_of(eye.pixels(eye.seen(ego))))
    return image


def _bodies(shot: Shot, others: Iterable[int]) -> Iterator[Floats]:
    """[8, 3] the corners of the ego, and of each of these agents, m."""
    agents, ego = shot.cycle.agents, shot.cycle.ego
    yield placed(CORNERS * (ego.length, ego.width, HIGH), shot.ego[:3])
    for n in others:
        yield placed(CORNERS * (agents.length[n], agents.width[n], HIGH), shot.others[n])


def _box_of(pixels: Floats) -> Box:
    """The box about [K, 2] pixels."""
    (left, upper), (right, lower) = pixels.min(axis=0).tolist(), pixels.max(axis=0).tolist()
    return left, upper, right, lower


def _top(eye: Eye, shot: Shot, n: int) -> Floats | None:
    """[2] the pixel above an agent; None where its middle is out of the picture."""
    high = 3.3 if shot.cycle.agents.length[n] > LONG else 2.0  # m
    seen = eye.seen(placed(np.array([[0.0, 0.0, 0.5], [0.0, 0.0, high]]), shot.others[n]))
    if seen[:, 2].min() < NEAR:
        return None
    middle, top = eye.pixels(seen)
    return top if np.all((middle > 0) & (middle < eye.size)) else None


def _named(shot: Shot) -> list[tuple[int, str]]:
    """The vehicles that have a label, the nearest first: index, id and speed."""
    agents = shot.cycle.agents
    far = np.hypot(*(shot.others[:, :2] - shot.ego[:2]).T)
    nearest = [n for n in np.argsort(far, kind="stable").tolist() if not agents.person[n]]
    return [(n, f"{agents.ids[n]}, {agents.v[n]:.0f} m/s") for n in nearest]


def _write_labels(
    draw: ImageDraw.ImageDraw,
    size: tuple[int, int],
    labels: Sequence[Label],
    ego: Box | None = None,
    others: Sequence[Box] = (),
) -> None:
    """Write labels that fit in, LABELLED at most, none over the ego.

    Higher up where an earlier one is in the way, or, if there is room, one of the other vehicles.
    """
    kept_free = [] if ego is None else [ego]
    font, placed_at = font_of(LABEL_PX), list[tuple[str, Floats, Floats, Box]]()
    for label in labels[:LABELLED]:
        text = fitted(draw, label.text, LABEL_PX, LABEL_WIDTH)
        x, y = label.at.tolist()
        if not 0 <= x <= size[0]:
            continue
        half = draw.textlength(text, font=font) / 2 + 2 * SS
        at = np.array([min(max(x, half), size[0] - half), y])  # at the edge it moves in
        lifts = [row * 1.25 * LABEL_PX * SS for row in range(LIFTS)]
        boxes = [draw.textbbox((at[0], y - up), text, font=font, anchor="ms") for up in lifts]
        taken = [*kept_free, *(other for *_, other in placed_at)]
        fitting = [k for k, box in enumerate(boxes) if _inside(box, size) and _free(box, taken)]
        if fitting:
            k = next((k for k in fitting if _free(boxes[k], others)), fitting[0])
            placed_at.append((text, at - (0, lifts[k]), label.at, boxes[k]))
    for _, (x, y), (over, foot), _ in placed_at:
        if (x, y) != (over, foot):
            draw.line((x, y, over, foot + 4 * SS), fill=INK, width=SS)
    for text, (x, y), _, _ in placed_at:
        draw.text(
            (x, y), text, font=font, fill=INK, anchor="ms", stroke_width=2 * SS,
            stroke_fill=PAPER,
        )  # fmt: skip


def _inside(box: Box, size: tuple[int, int]) -> bool:
    return box[0] >= 0 and box[2] <= size[0] and box[1] >= 0 and box[3] <= size[1]


def _free(box: Box, taken: Sequence[Box]) -> bool:
    """Whether a box covers none of the others."""
    return all(
        box[2] < other[0] or other[2] < box[0] or box[3] < other[1] or other[3] < box[1]
        for other in taken
    )
