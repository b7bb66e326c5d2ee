"""What figures are made of: axes, ticks and strokes, as SVG text.

Colours and fonts are the page's: marks carry classes of page.css. The text that an element shows on
hover stands in `data-tip`.
"""

import math
from collections.abc import Iterable
from html import escape
from typing import NamedTuple

SMALLEST = 0.02  # of a logarithmic axis


class Axis(NamedTuple):
    """Values to pixels."""

    low: float
    high: float
    begin: float  # pixel of `low`
    end: float
    logarithmic: bool = False

    def at(self, value: float) -> float:
        """The pixel of a value; beyond the ends that of the end."""
        low, high, value = (
            math.log10(max(x, SMALLEST)) if self.logarithmic else x
            for x in (self.low, self.high, value)
        )
        share = (value - low) / (high - low) if high > low else 0.5
        return self.begin + min(max(share, 0.0), 1.0) * (self.end - self.begin)


def figure(width: float, height: float, title: str, parts: Iterable[str]) -> str:
    """A figure of so many pixels; `title` is what a screen reader says."""
    size = f'width="{width:.0f}" height="{height:.0f}" viewBox="0 0 {width:.0f} {height:.0f}"'
    return (
        f'<svg class="figure" {size} role="img" aria-label="{escape(title)}">{"".join(parts)}</svg>'
    )


# --- values on an axis ---


def ticks(low: float, high: float, most: int = 5) -> list[float]:
    """Round numbers from `low` to `high`, about `most`."""
    if not high > low:
        return [low]
    rough = (high - low) / most
    unit = 10.0 ** math.floor(math.log10(rough))
    step = next(unit * factor for factor in (1, 2, 5, 10) if unit * factor >= rough * (1 - 1e-9))
    return [
        round(step * k, 10)
        for k in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)
    ]


def decades(low: float, high: float) -> list[float]:
    """1, 2 and 5 of every power of ten from `low` to `high`; fewer where these are many."""
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    factors: tuple[int, ...] = (1,) if len(powers) > 4 else (1, 3) if len(powers) > 3 else (1, 2, 5)
    return [
        factor * 10.0**power
        for power in powers
        for factor in factors
        if low <= factor * 10.0**power <= high
    ]


def axis_range(low: float, high: float, logarithmic: bool) -> tuple[float, float]:
    """Ends of an axis on which these values are well inside."""
    if not logarithmic:
        return min(0.0, low), max(1.05 * high, low + 1e-9)
    low, high = max(low, SMALLEST), max(high, SMALLEST)
    factor = max(1.2, math.sqrt(10.0 * low / high))  # a decade at least
    return low / factor, high * factor


# --- strokes ---


def tip(text: str) -> str:
    """The attribute that shows a text on hover."""
    return f'data-tip="{escape(text)}"'


def grid_line(x1: float, y1: float, x2: float, y2: float) -> str:
    """A thin line behind the marks."""
    return f'<line class="grid" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"/>'


def label(x: float, y: float, text: str, anchor: str, kind: str = "label") -> str:
    """A text at a place; `anchor` is SVG's text-anchor, `kind` the class."""
    return (
        f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>'
    )


def text_width(text: str) -> float:
    """About how wide a label is, px: no narrower than in any of the usual fonts."""
    return sum(
        4.8
        if each in "iljft.,:;'|!()[] -"
        else 11.8
        if each in "mwMW@%"
        else 8.4
        if each.isupper()
        else 7.7
        for each in text
    )
