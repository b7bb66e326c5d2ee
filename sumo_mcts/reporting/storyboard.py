"""The storyboard of an episode: a page of pictures (PNG)."""

import io
import math
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from sumo_mcts.records import CycleRecord, Trace, write_whole
from sumo_mcts.reporting.birdseye import draw_car, draw_panel, fade
from sumo_mcts.reporting.camera import Shot, arrangement, shot_at, views_of
from sumo_mcts.reporting.canvas import (
    BRAKE,
    EGO,
    EGO_DARK,
    FAINT,
    INK,
    OTHER,
    OTHER_DARK,
    PAINT,
    PAPER,
    SS,
    View,
    draw_dot,
    draw_line,
    draw_tick,
    fitted,
    mixed,
    write_text,
)
from sumo_mcts.reporting.ground import draw_ground, roads_of
from sumo_mcts.reporting.words import action_words, verb_of


def storyboard(trace: Trace, path: Path, moments: int = 6) -> None:
    """Write a PNG of some moments of the episode.

    Raises ValueError where there is no cycle, OSError where it cannot be written.
    """
    shots = [shot_at(trace, trace.cycles[i].time) for i in choose_moments(trace, moments)]
    columns, aspect = arrangement(shots)
    columns = min(columns, len(shots))
    width = (1840 - 24 * (columns - 1)) // columns
    views = views_of(shots, (width, round(width / aspect)))
    roads = roads_of(trace.lanes)
    panels = [
        draw_panel(draw_ground(roads, view), shot, view)
        for shot, view in zip(shots, views, strict=True)
    ]
    page = _page(trace, shots, panels, columns, views[0].scale)
    write_whole(path, _png(page.reduce(SS)))


# --- which moments ---


def choose_moments(trace: Trace, count: int) -> list[int]:
    """The indices of cycles spread evenly over the episode.

    Each is moved a little to where the decision changes or an agent is near.
    """
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
        chosen.append(
            round(target)
            if at_an_end or not within
            else max(within, key=lambda i: interest[i] - 1.2 * abs(i - target) / reach)
        )
    return chosen


def _interest(cycles: tuple[CycleRecord, ...], i: int) -> float:
    """How much a cycle is worth showing, about 0 to 2."""
    changed = i > 0 and verb_of(cycles[i]) != verb_of(cycles[i - 1])
    ego, agents = cycles[i].ego, cycles[i].agents
    nearest = (
        float(np.hypot(agents.x - ego.x, agents.y - ego.y).min()) if len(agents.ids) else math.inf
    )
    return float(changed) + 8.0 / max(nearest, 8.0)


# --- the page ---


def _page(
    trace: Trace, shots: list[Shot], panels: list[Image.Image], columns: int, scale: float
) -> Image.Image:
    """Heading, panels with captions, legend; enlarged."""
    margin, gap, caption, top, bottom = 40, 24, 62, 104, 96
    width, height = panels[0].width // SS, panels[0].height // SS
    rows = math.ceil(len(panels) / columns)
    total = (
        2 * margin + columns * width + (columns - 1) * gap,
        top + rows * (caption + height) + (rows - 1) * gap + bottom,
    )
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
    write_text(
        draw,
        (left, 62),
        fitted(draw, words[:1].upper() + words[1:], 36, right - left - 260),
        30,
        bold=True,
    )  # 36: bold is wider
    good = trace.outcome == "arrived"
    write_text(
        draw,
        (right, 54),
        trace.outcome.replace("_", " "),
        22,
        INK if good else BRAKE,
        bold=True,
        anchor="rs",
    )
    write_text(draw, (right, 78), fitted(draw, trace.key, 13, right - left), 13, FAINT, anchor="rs")


def _caption(draw: ImageDraw.ImageDraw, shot: Shot, x: float, y: float, width: float) -> None:
    """Time, speed and the action in words; on one line where there is room."""
    end = write_text(draw, (x, y + 24), f"{shot.cycle.time:.1f} s", 20, bold=True)
    write_text(draw, (end + 12, y + 24), f"{shot.ego[3]:.1f} m/s", 17, FAINT)
    write_text(draw, (x, y + 50), fitted(draw, action_words(shot.cycle), 17, width), 17, EGO)


def _rounded(size: tuple[int, int], radius: int) -> Image.Image:
    mask = Image.new("L", size, 0)
    ImageDraw.Draw(mask).rounded_rectangle((0, 0, size[0] - 1, size[1] - 1), radius, fill=255)
    return mask


def _legend(draw: ImageDraw.ImageDraw, left: float, right: float, y: float, scale: float) -> None:
    """The signs that the panels use, the scale and north."""
    view = View(0.0, 0.0, 7.0 * SS, (0, 0))
    cars = (
        ((EGO, EGO_DARK), False, "ego"),
        ((OTHER, OTHER_DARK), False, "others"),
        ((OTHER, OTHER_DARK), True, "braking"),
    )
    x = left
    for colours, braking, text in cars:
        draw_car(draw, view, ((x + 17) / 7.0, -y / 7.0, 0.0), (4.8, 1.9), colours, (braking, 0))
        x = write_text(draw, (x + 44, y + 5), text, 15) + 30
    for k in range(4):
        draw_dot(
            draw, np.array([x + 6 + 14 * k, y]) * SS, 4.5 * SS, mixed(OTHER, PAPER, fade(k + 1.0))
        )
    x = write_text(draw, (x + 64, y + 5), "expected, every second", 15) + 30
    ahead = np.array([[x, y], [x + 44, y]]) * SS
    draw_line(draw, ahead, 0.5, EGO, view)
    for k in range(3):
        draw_dot(draw, np.array([x + 10 + 14 * k, y]) * SS, 4.5 * SS, EGO)
        draw_dot(draw, np.array([x + 10 + 14 * k, y]) * SS, 2.5 * SS, PAINT)
    x = write_text(draw, (x + 56, y + 5), "plan", 15) + 30
    for k, share in enumerate((0.3, 0.5, 0.7)):
        tried = np.array([[x, y - 7 + 7 * k], [x + 26 + 8 * k, y - 7 + 7 * k]]) * SS
        draw_line(draw, tried, 0.22, mixed(EGO, PAPER, share), view)
        draw_tick(draw, tried, 3.0 * SS, mixed(EGO, PAPER, share), view)
    write_text(draw, (x + 54, y + 5), "also tried, stronger: more visits", 15)
    _scale_bar(draw, right, y, scale)


def _scale_bar(draw: ImageDraw.ImageDraw, right: float, y: float, scale: float) -> None:
    metres = max((m for m in (5, 10, 20, 50) if m * scale / SS <= 150), default=5)
    long = metres * scale / SS
    north = (right - 8) * SS
    draw.polygon(
        [
            (north, (y - 22) * SS),
            (north - 7 * SS, (y - 4) * SS),
            (north, (y - 9) * SS),
            (north + 7 * SS, (y - 4) * SS),
        ],
        fill=INK,
    )
    write_text(draw, (right - 8, y + 12), "N", 13, bold=True, anchor="ms")
    bar = [
        ((right - 36 - long) * SS, (y - 4) * SS),
        ((right - 36 - long) * SS, (y + 1) * SS),
        ((right - 36) * SS, (y + 1) * SS),
        ((right - 36) * SS, (y - 4) * SS),
    ]
    draw.line(bar, fill=INK, width=2 * SS)
    write_text(draw, (right - 36 - long / 2, y - 8), f"{metres} m", 14, anchor="ms")


def _png(image: Image.Image) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, format="PNG", optimize=False)
    return buffer.getvalue()
