"""A page of pictures (PNG): heading, strips of panels with captions, legend."""

import io
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from sumo_mcts.records import Trace, write_whole
from sumo_mcts.reporting.birdseye import draw_car
from sumo_mcts.reporting.camera import Shot
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
from sumo_mcts.reporting.marks import fade
from sumo_mcts.reporting.words import action_words

WIDTH = 1840  # px of a strip
MARGIN, GAP, CAPTION, TOP, BOTTOM = 40, 24, 62, 104, 96  # px


class Strip(NamedTuple):
    """Panels of one size side by side."""

    captions: list[Shot]  # what stands above each panel; empty: nothing does
    panels: list[Image.Image]  # enlarged


def column_width(columns: int) -> int:
    """The width of each of so many panels of a strip, px."""
    return (WIDTH - GAP * (columns - 1)) // columns


def write_page(path: Path, trace: Trace, strips: list[Strip], scale: float | None) -> None:
    """Write the page; `scale`: pixels of the drawing per metre, None: no panel is from above.

    Raises OSError.
    """
    write_whole(path, _png(_page(trace, strips, scale).reduce(SS)))


def _page(trace: Trace, strips: list[Strip], scale: float | None) -> Image.Image:
    """Heading, panels with captions, legend; enlarged."""
    widest = max(strips, key=lambda strip: len(strip.panels)).panels
    width = 2 * MARGIN + sum(panel.width // SS + GAP for panel in widest) - GAP
    heights = [strip.panels[0].height // SS + CAPTION * bool(strip.captions) for strip in strips]
    height = TOP + sum(heights) + GAP * (len(strips) - 1) + BOTTOM
    page = Image.new("RGB", (width * SS, height * SS), PAPER)
    draw = ImageDraw.Draw(page)
    _heading(draw, trace, MARGIN, width - MARGIN)
    y = TOP
    for strip, tall in zip(strips, heights, strict=True):
        x, mask = MARGIN, _rounded(strip.panels[0].size, 10 * SS)
        top = y + CAPTION * bool(strip.captions)
        for n, panel in enumerate(strip.panels):
            if strip.captions:
                _caption(draw, strip.captions[n], x, y, panel.width // SS)
            page.paste(panel, (x * SS, top * SS), mask)
            x += panel.width // SS + GAP
        y += tall + GAP
    _legend(draw, MARGIN, width - MARGIN, height - BOTTOM / 2 + 6, scale)
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
    end = write_text(draw, (x, y + 24), f"{shot.cycle.time + shot.elapsed:.1f} s", 20, bold=True)
    write_text(draw, (end + 12, y + 24), f"{shot.ego[3]:.1f} m/s", 17, FAINT)
    write_text(draw, (x, y + 50), fitted(draw, action_words(shot.cycle), 17, width), 17, EGO)


def _rounded(size: tuple[int, int], radius: int) -> Image.Image:
    mask = Image.new("L", size, 0)
    ImageDraw.Draw(mask).rounded_rectangle((0, 0, size[0] - 1, size[1] - 1), radius, fill=255)
    return mask


def _legend(
    draw: ImageDraw.ImageDraw, left: float, right: float, y: float, scale: float | None
) -> None:
    """The signs that the panels use; from above also what was tried, the scale and north."""
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
    if scale is None:
        return
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
