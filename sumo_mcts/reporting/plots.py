"""Figures as SVG text, from rows.

Colours and fonts are the page's: every mark carries a class, variants a class of their own
(`colours`).

Each figure is drawn at the size at which it is shown, so that its letters are those of the page.
What an element says on hover stands in `data-tip`.
"""

import math
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from itertools import cycle
from typing import NamedTuple

import numpy as np

from sumo_mcts.records.statistics import TWIN, Pair, Rate, Row, arrived, collided, pairs, rate
from sumo_mcts.registry import PLANNERS
from sumo_mcts.reporting.tables import grouped, labelled, number, spread

# planners with a colour of their own
KNOWN = tuple(row.name for row in PLANNERS.values() if row.colour)
FURTHER = 6  # colours that are nobody's own
SMALLEST = 0.02  # of a logarithmic axis
WIDTH = 540.0  # px


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


class Measure(NamedTuple):
    """A key of the row whose distribution is drawn."""

    key: str
    label: str
    unit: str
    logarithmic: bool = False


def svg(width: float, height: float, title: str, parts: Iterable[str]) -> str:
    """A figure of so many pixels; `title` is what a screen reader says."""
    size = f'width="{width:.0f}" height="{height:.0f}" viewBox="0 0 {width:.0f} {height:.0f}"'
    return (
        f'<svg class="figure" {size} role="img" aria-label="{escape(title)}">{"".join(parts)}</svg>'
    )


def colours(rows: Iterable[Row]) -> dict[str, str]:
    """The class that gives the marks of each variant their colour.

    The first of a planner has the planner's own; the others have those of planners that drive
    nowhere here, and then further ones, in turns.
    """
    own = {
        row["variant"]: f"p-{row['planner']}" if row["planner"] in KNOWN else "p-other"
        for row in rows
    }
    first = {colour: variant for variant, colour in reversed(own.items())}
    spare = [f"p-{planner}" for planner in KNOWN if planner != TWIN and f"p-{planner}" not in first]
    free = cycle([*spare, *(f"p-further-{k}" for k in range(1, FURTHER + 1))])
    return {
        variant: colour if first[colour] == variant else next(free)
        for variant, colour in own.items()
    }


def planner_style() -> str:
    """CSS: the colours of the planners that have one of their own."""
    return "".join(
        f".p-{row.name} {{ --c: {row.colour}; }}\n" for row in PLANNERS.values() if row.colour
    )


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


# --- arrival and collisions over the number of iterations ---


class Swept(NamedTuple):
    """A variant family over its budgets."""

    variant: str  # its first, which lends it its colour
    label: str
    points: tuple[tuple[float, Rate, Rate], ...]  # iterations, arrived, collided


def sweeps(rows: Sequence[Row]) -> dict[str, list[Swept]]:
    """By scenario, the variants that differ in their iterations alone: those whose names are the
    same but for that number, at two budgets or more."""
    found: dict[str, dict[tuple[str, str], dict[float, list[Row]]]] = defaultdict(
        lambda: defaultdict(dict)
    )
    for (scenario, variant), those in grouped(rows).items():
        budgets = {
            row["iterations_per_decision"]
            for row in those
            if row["iterations_per_decision"] is not None
        }
        if len(budgets) == 1:
            budget = budgets.pop()
            written = re.escape(str(int(budget) if budget == int(budget) else budget))
            family = re.sub(rf"(-iterations)?[-_=, ]*(?<![\d.]){written}(?![\d.])", "", variant)
            found[scenario][those[0]["planner"] or "", family].setdefault(budget, []).extend(those)
    result = {}
    for scenario, families in found.items():
        swept = [
            Swept(
                next(iter(by_budget.values()))[0]["variant"],
                family,
                tuple(
                    (budget, rate(map(arrived, those)), rate(map(collided, those)))
                    for budget, those in sorted(by_budget.items())
                ),
            )
            for (_, family), by_budget in families.items()
            if len(by_budget) > 1
        ]
        if swept:
            result[scenario] = swept
    return result


def sweep_figure(title: str, swept: Sequence[Swept], colour: Mapping[str, str]) -> str:
    """Arrived (solid, dots) and collided (dashed, squares) in percent over iterations, with
    intervals."""
    width, height = WIDTH, 330.0
    budgets = sorted({budget for family in swept for budget, _, _ in family.points})
    across = Axis(budgets[0] / 1.25, budgets[-1] * 1.25, 46, width - 12, logarithmic=True)
    up = Axis(0, 100, height - 40, 14)
    parts = [
        _grid_line(across.begin, up.at(tick), across.end, up.at(tick))
        + _label(38, up.at(tick) + 4, f"{tick} %", "end")
        for tick in (0, 25, 50, 75, 100)
    ]
    last = -math.inf
    for budget in budgets:
        if across.at(budget) - last > 34:
            last = across.at(budget)
            parts.append(
                _label(last, height - 22, f"{budget:,.0f}".replace(",", "\u2009"), "middle")
            )
    parts.append(
        _label((across.begin + across.end) / 2, height - 5, "iterations a decision", "middle")
    )
    for i, family in enumerate(swept):
        lines = ""
        for k, which in enumerate(("arrived", "collided")):
            shift = 5.0 * (2 * i + k - len(swept) + 0.5)  # so that intervals stand side by side
            lines += _swept_line(
                family, which, [across.at(budget) + shift for budget, _, _ in family.points], up
            )
        parts.append(f'<g class="{colour[family.variant]}">{lines}</g>')
    return svg(width, height, f"{title}: arrivals and collisions over iterations", parts)


def _swept_line(family: Swept, which: str, places: Sequence[float], up: Axis) -> str:
    """One of the two rates at these places across, with its intervals."""
    cells = [
        (budget, ended if which == "arrived" else crashed)
        for budget, ended, crashed in family.points
    ]
    heights = [up.at(100 * cell.k / cell.n) for _, cell in cells]
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(places, heights, strict=True))
    parts = [f'<polyline class="line {which}" points="{points}"/>']
    for x, y, (budget, cell) in zip(places, heights, cells, strict=True):
        low, high = cell.interval or (0.0, 1.0)
        parts.append(
            f'<line class="whisker" x1="{x:.1f}" x2="{x:.1f}" y1="{up.at(100 * low):.1f}" '
            f'y2="{up.at(100 * high):.1f}"/>'
        )
        disc, square = (
            f'<circle class="dot" cx="{x:.1f}" cy="{y:.1f}" r="4"',
            f'<rect class="dot" x="{x - 3.5:.1f}" y="{y - 3.5:.1f}" width="7" height="7"',
        )
        tip = _tip(
            f"{family.label}, {number(budget, 0)} iterations: {which} "
            f"{cell.k}/{cell.n}{spread(cell)}"
        )
        parts.append(f"{disc if which == 'arrived' else square} {tip}/>")
    return "".join(parts)


# --- distributions over episodes ---


class Spread(NamedTuple):
    """A measure over the episodes of a variant."""

    variant: str
    label: str
    quantiles: tuple[float, ...]  # 5, 25, 50, 75 and 95 %; empty where it is known of no episode
    known: int
    of: int


def spread_figure(rows: Sequence[Row], measure: Measure, colour: Mapping[str, str]) -> str:
    """A line for each variant: 5 to 95 % of its episodes thin, the middle half thick, the median a
    dot; nothing but words where it is known of none of its episodes. Empty where it is known of
    nobody's."""
    spreads = [_spread(label, those, measure.key) for label, those in _by_label(rows).items()]
    known = [found.quantiles for found in spreads if found.known]
    if not known:
        return ""
    low, high = _range(min(q[0] for q in known), max(q[4] for q in known), measure.logarithmic)
    name_width = 18 + max(_text_width(found.label) for found in spreads)
    width, line, top = max(WIDTH, name_width + 300.0), 24.0, 8.0
    height = top + line * len(spreads) + 34
    across = Axis(low, high, name_width, width - 64, measure.logarithmic)
    marks = [
        (across.at(tick), f"{tick:g}")
        for tick in (decades(low, high) if measure.logarithmic else ticks(low, high))
    ]
    parts = [
        _grid_line(x, top, x, height - 34) + _label(x, height - 19, name, "middle")
        for x, name in marks
    ]
    parts.append(_label((across.begin + across.end) / 2, height - 4, measure.unit, "middle"))
    for i, found in enumerate(spreads):
        y = top + line * (i + 0.5)
        shown, tip = _spread_words(found, measure.unit)
        hover = (
            f'<rect class="hover" x="0" y="{y - line / 2}" width="{width:.0f}" height="{line}" '
            f"{_tip(tip)}/>"
        )
        parts.append(f'<g class="{colour[found.variant]}">{_spread_line(found, across, y)}</g>')
        parts.append(
            _label(name_width - 10, y + 4, found.label, "end", "name")
            + _label(width - 2, y + 4, shown, "end", "value" if found.known else "label")
        )
        parts.append(hover)
    return svg(width, height, f"{measure.label} over episodes, by variant", parts)


def _spread(label: str, rows: Sequence[Row], key: str) -> Spread:
    values = [float(row[key]) for row in rows if row[key] is not None]
    quantiles = np.percentile(np.array(values), (5, 25, 50, 75, 95)).tolist() if values else ()
    return Spread(rows[0]["variant"], label, tuple(quantiles), len(values), len(rows))


def _range(low: float, high: float, logarithmic: bool) -> tuple[float, float]:
    """What an axis shows so that all of this is well inside."""
    if not logarithmic:
        return min(0.0, low), max(1.05 * high, low + 1e-9)
    low, high = max(low, SMALLEST), max(high, SMALLEST)
    room = max(1.2, math.sqrt(10.0 * low / high))  # a decade at least
    return low / room, high * room


def _spread_line(found: Spread, across: Axis, y: float) -> str:
    if not found.known:
        return ""
    x = [across.at(q) for q in found.quantiles]
    thin, thick = (
        f'<line class="{kind}" x1="{x[i]:.1f}" x2="{x[4 - i]:.1f}" y1="{y}" y2="{y}"/>'
        for i, kind in enumerate(("thin", "thick"))
    )
    return f'{thin}{thick}<circle class="dot" cx="{x[2]:.1f}" cy="{y}" r="4.5"/>'


def _spread_words(found: Spread, unit: str) -> tuple[str, str]:
    """What stands at the end of the line, and what is told on hover."""
    if not found.known:
        return "none", f"{found.label}: none in any of {found.of} episodes"
    q = [number(value, 2) for value in found.quantiles]
    tip = (
        f"{found.label}: median {q[2]} {unit}; half of the episodes {q[1]}..{q[3]}, nine tenths "
        f"{q[0]}..{q[4]}; known in {found.known} of {found.of} episodes"
    )
    return q[2], tip


def _by_label(rows: Iterable[Row]) -> dict[str, list[Row]]:
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(labelled(row), []).append(row)
    return groups


# --- travel times beside the twin's ---


def twin_figure(
    title: str, ones: Sequence[Row], twins: Iterable[Row], colour: Mapping[str, str]
) -> str:
    """Each pair a dot: the twin's travel time across, the ego's up; whoever did not arrive stands
    on the edge. Empty without pairs."""
    both = [
        pair
        for pair in pairs([row for row in ones if row["planner"] != TWIN], twins)
        if _time(pair.one) is not None or _time(pair.other) is not None
    ]
    times = [
        time for pair in both for time in (_time(pair.one), _time(pair.other)) if time is not None
    ]
    if not times:
        return ""
    width, height, edge = WIDTH, 380.0, WIDTH - 26.0
    low, high = min(times) * 0.94, max(times) * 1.04
    across, up = Axis(low, high, 46, edge - 24), Axis(low, high, height - 40, 40)
    parts = [
        (
            f'<line class="diagonal" x1="{across.begin}" y1="{up.begin}" x2="{across.end}" '
            f'y2="{up.end}"/>'
        )
    ]
    for tick in ticks(low, high):
        parts.append(
            _grid_line(across.begin, up.at(tick), across.end, up.at(tick))
            + _label(38, up.at(tick) + 4, f"{tick:g}", "end")
        )
        parts.append(
            _grid_line(across.at(tick), up.begin, across.at(tick), up.end)
            + _label(across.at(tick), height - 22, f"{tick:g}", "middle")
        )
    parts += [
        _label((across.begin + across.end) / 2, height - 5, "SUMO's driver, s", "middle"),
        _label(8, 12, "ego, s", "start"),
    ]
    if any(_time(pair.one) is None for pair in both):
        parts.append(
            _grid_line(across.begin, 26, across.end, 26)
            + _label(across.end, 18, "ego did not arrive", "end")
        )
    if any(_time(pair.other) is None for pair in both):
        parts.append(_grid_line(edge, up.begin, edge, up.end))
        parts.append(
            f'<text class="label" transform="translate({edge + 8} {up.end}) rotate(90)" '
            'text-anchor="start">twin did not arrive</text>'
        )
    for variant, those in _by_variant(both).items():
        parts.append(
            f'<path class="points {colour[variant]}" d="{_dots(those, across, up, edge)}"/>'
        )
    return svg(width, height, f"{title}: travel times beside those of SUMO's driver", parts)


def _by_variant(both: Iterable[Pair]) -> dict[str, list[Pair]]:
    """The first of all last, on top."""
    groups: dict[str, list[Pair]] = {}
    for pair in both:
        groups.setdefault(pair.one["variant"], []).append(pair)
    return dict(reversed(groups.items()))


def _dots(both: Iterable[Pair], across: Axis, up: Axis, beyond: float) -> str:
    """A path with a stroke of no length for each dot; dots on the same half pixel are one."""
    places = set()
    for pair in both:
        one, other = _time(pair.one), _time(pair.other)
        x, y = beyond if other is None else across.at(other), 26.0 if one is None else up.at(one)
        places.add((round(2 * x) / 2, round(2 * y) / 2))
    return "".join(f"M{x:g} {y:g}h0" for x, y in sorted(places))


def _time(row: Row) -> float | None:
    return row["travel_time_s"] if arrived(row) else None


# --- strokes ---


def _tip(text: str) -> str:
    return f'data-tip="{escape(text)}"'


def _grid_line(x1: float, y1: float, x2: float, y2: float) -> str:
    return f'<line class="grid" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"/>'


def _text_width(text: str) -> float:
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


def _label(x: float, y: float, text: str, anchor: str, kind: str = "label") -> str:
    return (
        f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>'
    )
