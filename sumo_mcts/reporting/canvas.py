"""Colours, fonts, views and primitives of the pictures."""

from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from PIL import ImageDraw, ImageFont

from sumo_mcts.records import CycleRecord
from sumo_mcts.scene import Floats

Colour = tuple[int, int, int]
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
PIXELS = 1e6  # how far beyond the window anything is drawn: a line is as much work as it has pixels


class View(NamedTuple):
    """A window on the map: world metres to pixels of the enlarged drawing."""

    west: float  # m
    north: float  # m
    scale: float  # pixels of the enlarged drawing per metre
    size: tuple[int, int]  # width and height of the enlarged drawing, pixels

    def pixels(self, points: Floats) -> Floats:
        """[K, 2] pixel positions of world positions [K, 2]."""
        pixels: Floats = (
            np.asarray(points, dtype=np.float64).reshape(-1, 2) - (self.west, self.north)
        ) * (self.scale, -self.scale)
        return pixels.clip(-PIXELS, PIXELS)


class Shot(NamedTuple):
    """One moment, between two decisions."""

    cycle: CycleRecord  # the last decision
    elapsed: float  # s since then
    ego: Floats  # [4] x, y, heading, v
    others: Floats  # [N, 3] x, y, heading; the agents of the cycle


# --- strokes ---


def draw_line(
    draw: ImageDraw.ImageDraw, pixels: Floats, metres: float, colour: Colour, view: View
) -> None:
    draw.line(
        [(x, y) for x, y in pixels.tolist()],
        fill=colour,
        width=max(1, round(metres * view.scale)),
        joint="curve",
    )


def draw_polygon(
    draw: ImageDraw.ImageDraw, pixels: Floats, colour: Colour, outline: float = 0.0
) -> None:
    corners = [(x, y) for x, y in pixels.tolist()]
    if len(corners) < 3:
        return
    draw.polygon(corners, fill=colour)
    if outline >= 1:
        draw.line(
            [*corners, corners[0], corners[1]], fill=colour, width=round(outline), joint="curve"
        )


def draw_dot(draw: ImageDraw.ImageDraw, centre: Floats, radius: float, colour: Colour) -> None:
    x, y = centre.tolist()
    draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=colour)


def draw_tick(
    draw: ImageDraw.ImageDraw, pixels: Floats, half: float, colour: Colour, view: View
) -> None:
    """A short bar across the end of a line."""
    if len(pixels) < 2 or np.linalg.norm(pixels[-1] - pixels[0]) < half:
        return
    along = pixels[-1] - pixels[-2]
    across = np.array([-along[1], along[0]]) / max(float(np.linalg.norm(along)), 1e-9) * half
    draw_line(draw, np.array([pixels[-1] - across, pixels[-1] + across]), 0.22, colour, view)


def beside(shape: Floats, distance: float) -> Floats:
    """[P, 2] the shape moved to the left by a distance, m."""
    along = np.gradient(shape, axis=0) if len(shape) > 1 else np.zeros_like(shape)
    unit = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    return np.asarray(shape + distance * np.column_stack([-unit[:, 1], unit[:, 0]]))


def draw_dashes(shape: Floats, dash: float, gap: float) -> Floats:
    """[K, 2, 2] pieces of a broken line along a shape, m."""
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(shape, axis=0), axis=1))])
    starts = np.arange(gap / 2, s[-1] - dash, dash + gap)
    ends = np.column_stack([starts, starts + dash])
    return np.stack([np.interp(ends, s, shape[:, 0]), np.interp(ends, s, shape[:, 1])], axis=-1)


def hull(points: Floats) -> Floats:
    """[K, 2] convex hull, counter-clockwise (upper and lower chain over the sorted points)."""
    ordered = sorted(set(map(tuple, points.round(3).tolist())))

    def chain(places: list[Any]) -> list[Any]:
        kept: list[Any] = []
        for p in places:
            while len(kept) > 1 and (kept[-1][0] - kept[-2][0]) * (p[1] - kept[-2][1]) <= (
                kept[-1][1] - kept[-2][1]
            ) * (p[0] - kept[-2][0]):
                kept.pop()
            kept.append(p)
        return kept[:-1]

    return np.array(chain(ordered) + chain(ordered[::-1])).reshape(-1, 2)


def mixed(colour: Colour, ground: Colour, share: float) -> Colour:
    """The colour laid over a ground with this opacity."""
    r, g, b = (round(share * c + (1 - share) * d) for c, d in zip(colour, ground, strict=True))
    return r, g, b


# --- the storyboard's page ---


@cache
def font_of(px: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, which comes with matplotlib: the same everywhere."""
    return ImageFont.truetype(
        str(
            Path(mpl.get_data_path())
            / "fonts"
            / "ttf"
            / ("DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf")
        ),
        px * SS,
    )


def write_text(
    draw: ImageDraw.ImageDraw,
    at: tuple[float, float],
    text: str,
    px: int,
    colour: Colour = INK,
    *,
    bold: bool = False,
    anchor: str = "ls",
) -> float:
    """Text at a position of the finished picture; where it ends."""
    font = font_of(px, bold)
    draw.text((at[0] * SS, at[1] * SS), text, font=font, fill=colour, anchor=anchor)
    return at[0] + draw.textlength(text, font=font) / SS
