"""What the pictures are drawn with: colours, a view, strokes and text.

Everything is drawn with Pillow at SS times the size and scaled down. Sizes named `px` are those of
the finished picture.
"""

from functools import cache
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from PIL import ImageDraw, ImageFont

from sumo_mcts.arrays import Floats

Colour = tuple[int, int, int]
PAPER: Colour = (255, 255, 255)
LAND: Colour = (240, 241, 236)
KERB: Colour = (176, 181, 187)
ASPHALT: Colour = (205, 209, 214)
ROUTE: Colour = (196, 209, 228)  # lanes on the ego's route
PAINT: Colour = (250, 250, 250)
EGO: Colour = (18, 92, 224)
EGO_DARK: Colour = (9, 48, 122)
OTHER: Colour = (84, 91, 101)
OTHER_DARK: Colour = (44, 49, 57)
BRAKE: Colour = (222, 46, 46)
BLINK: Colour = (245, 158, 11)
GO: Colour = (38, 158, 92)  # of a signal
INK: Colour = (28, 32, 38)
FAINT: Colour = (112, 119, 128)
SS = 2  # supersampling: pixels of the drawing per pixel of the finished picture
PIXELS = 1e6  # how far beyond the window anything is drawn: a line is as much work as it has pixels


class View(NamedTuple):
    """A window on the map: world metres to pixels of the drawing."""

    west: float  # m
    north: float  # m
    scale: float  # pixels of the drawing per metre
    size: tuple[int, int]  # width and height of the drawing, pixels

    def pixels(self, points: Floats) -> Floats:
        """[K, 2] pixel positions of world positions [K, 2]."""
        pixels: Floats = (
            np.asarray(points, dtype=np.float64).reshape(-1, 2) - (self.west, self.north)
        ) * (self.scale, -self.scale)
        return pixels.clip(-PIXELS, PIXELS)


def mixed(colour: Colour, ground: Colour, share: float) -> Colour:
    """The colour laid over a ground with this opacity."""
    r, g, b = (round(share * c + (1 - share) * d) for c, d in zip(colour, ground, strict=True))
    return r, g, b


# --- strokes ---


def draw_line(
    draw: ImageDraw.ImageDraw, pixels: Floats, metres: float, colour: Colour, view: View
) -> None:
    """A line of this width, m, through [K, 2] pixels."""
    draw.line(
        [(x, y) for x, y in pixels.tolist()],
        fill=colour,
        width=max(1, round(metres * view.scale)),
        joint="curve",
    )


def draw_polygon(
    draw: ImageDraw.ImageDraw, pixels: Floats, colour: Colour, outline: float = 0.0
) -> None:
    """An area with [K, 2] corners in pixels, widened by an outline of so many pixels."""
    corners = [(x, y) for x, y in pixels.tolist()]
    if len(corners) < 3:
        return
    draw.polygon(corners, fill=colour)
    if outline >= 1:
        draw.line(
            [*corners, corners[0], corners[1]], fill=colour, width=round(outline), joint="curve"
        )


def draw_dot(draw: ImageDraw.ImageDraw, centre: Floats, radius: float, colour: Colour) -> None:
    """A disc; the radius in pixels of the drawing."""
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


# --- text ---


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
    """Write a text at a position, px; the x at which it ends, px."""
    font = font_of(px, bold)
    draw.text((at[0] * SS, at[1] * SS), text, font=font, fill=colour, anchor=anchor)
    return at[0] + draw.textlength(text, font=font) / SS


def fitted(draw: ImageDraw.ImageDraw, text: str, px: int, width: float) -> str:
    """The text in letters of `px`, cut where it would be wider than `width`, px."""
    if draw.textlength(text, font=font_of(px)) <= width * SS:
        return text
    while text and draw.textlength(text + "\u2026", font=font_of(px)) > width * SS:
        text = text[:-1]
    return text.rstrip(" ,") + "\u2026"


@cache
def font_of(px: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, which comes with matplotlib: the same everywhere."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(mpl.get_data_path(), "fonts", "ttf", name)), px * SS)
