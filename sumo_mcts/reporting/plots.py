"""The figures of a report as SVG text: sweeps of the budget, distributions, pairs with the twin.

Every mark carries a class of page.css, variants the class of their colour (variants.py). A figure
is drawn at the size at which it is shown, so that its letters are those of the page.
"""

import math
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from sumo_mcts.records.measures import BY_KEY, Row
from sumo_mcts.records.statistics import Pair, Rate, arrived, collided, pairs, rate
from sumo_mcts.reporting import svg
from sumo_mcts.reporting.cells import number, spread
from sumo_mcts.reporting.svg import Axis
from sumo_mcts.reporting.variants import driven, grouped, labelled

WIDTH = 540.0  # px


# --- arrivals and collisions over the number of iterations ---


class Swept(NamedTuple):
    """A variant family over its budgets."""

    variant: str  # the first of the family, whose colour it has
    label: str
    points: tuple[tuple[float, Rate, Rate], ...]  # iterations, arrived, collided


def sweeps(rows: Sequence[Row]) -> dict[str, list[Swept]]:
    """By scenario, the variants that differ in their iterations alone, at two budgets or more.

    Their names are the same but for that number.
    """
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
        svg.grid_line(across.begin, up.at(tick), across.end, up.at(tick))
        + svg.label(38, up.at(tick) + 4, f"{tick} %", "end")
        for tick in (0, 25, 50, 75, 100)
    ]
    last = -math.inf
    for budget in budgets:
        if across.at(budget) - last > 34:
            last = across.at(budget)
            parts.append(
                svg.label(last, height - 22, f"{budget:,.0f}".replace(",", "\u2009"), "middle")
            )
    parts.append(
        svg.label((across.begin + across.end) / 2, height - 5, "iterations a decision", "middle")
    )
    for i, family in enumerate(swept):
        lines = ""
        for k, which in enumerate(("arrived", "collided")):
            shift = 5.0 * (2 * i + k - len(swept) + 0.5)  # so that intervals stand side by side
            lines += _swept_line(
                family, which, [across.at(budget) + shift for budget, _, _ in family.points], up
            )
        parts.append(f'<g class="{colour[family.variant]}">{lines}</g>')
    return svg.figure(width, height, f"{title}: arrivals and collisions over iterations", parts)


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
        tip = svg.tip(
            f"{family.label}, {number(budget, 0)} iterations: {which} "
            f"{cell.k}/{cell.n}{spread(cell)}"
        )
        parts.append(f"{disc if which == 'arrived' else square} {tip}/>")
    return "".join(parts)


# --- distributions over episodes ---


class Distribution(NamedTuple):
    """A measure whose distribution over episodes is drawn."""

    key: str
    title: str
    about: str = ""
    logarithmic: bool = False

    @property
    def unit(self) -> str:
        """The measure's unit."""
        return BY_KEY[self.key].unit


class Spread(NamedTuple):
    """The distribution of a measure over the episodes of a variant."""

    variant: str
    label: str
    quantiles: tuple[float, ...]  # 5, 25, 50, 75 and 95 %; empty where it is known of no episode
    known: int
    of: int


def spread_figure(rows: Sequence[Row], drawn: Distribution, colour: Mapping[str, str]) -> str:
    """A line for each variant: 5 to 95 % of its episodes thin, the middle half thick, the median a
    dot. Only words where the measure is known of none of its episodes; empty where of none at all.
    """
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(labelled(row), []).append(row)
    spreads = [_spread(label, those, drawn.key) for label, those in groups.items()]
    known = [found.quantiles for found in spreads if found.known]
    if not known:
        return ""
    low, high = svg.axis_range(
        min(q[0] for q in known), max(q[4] for q in known), drawn.logarithmic
    )
    name_width = 18 + max(svg.text_width(found.label) for found in spreads)
    width, line, top = max(WIDTH, name_width + 300.0), 24.0, 8.0
    height = top + line * len(spreads) + 34
    across = Axis(low, high, name_width, width - 64, drawn.logarithmic)
    marks = [
        (across.at(tick), f"{tick:g}")
        for tick in (svg.decades(low, high) if drawn.logarithmic else svg.ticks(low, high))
    ]
    parts = [
        svg.grid_line(x, top, x, height - 34) + svg.label(x, height - 19, name, "middle")
        for x, name in marks
    ]
    parts.append(svg.label((across.begin + across.end) / 2, height - 4, drawn.unit, "middle"))
    for i, found in enumerate(spreads):
        y = top + line * (i + 0.5)
        shown, tip = _spread_words(found, drawn.unit)
        hover = (
            f'<rect class="hover" x="0" y="{y - line / 2}" width="{width:.0f}" height="{line}" '
            f"{svg.tip(tip)}/>"
        )
        parts.append(f'<g class="{colour[found.variant]}">{_spread_line(found, across, y)}</g>')
        parts.append(
            svg.label(name_width - 10, y + 4, found.label, "end", "name")
            + svg.label(width - 2, y + 4, shown, "end", "value" if found.known else "label")
        )
        parts.append(hover)
    return svg.figure(width, height, f"{drawn.title} over episodes, by variant", parts)


def _spread(label: str, rows: Sequence[Row], key: str) -> Spread:
    values = [float(row[key]) for row in rows if row[key] is not None]
    quantiles = np.percentile(np.array(values), (5, 25, 50, 75, 95)).tolist() if values else ()
    return Spread(rows[0]["variant"], label, tuple(quantiles), len(values), len(rows))


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
    """The label at the end of the line, and the text on hover."""
    if not found.known:
        return "none", f"{found.label}: none in any of {found.of} episodes"
    q = [number(value, 2) for value in found.quantiles]
    tip = (
        f"{found.label}: median {q[2]} {unit}; half of the episodes {q[1]}..{q[3]}, nine tenths "
        f"{q[0]}..{q[4]}; known in {found.known} of {found.of} episodes"
    )
    return q[2], tip


# --- travel times beside the twin's ---


def twin_figure(
    title: str, ones: Sequence[Row], twins: Iterable[Row], colour: Mapping[str, str]
) -> str:
    """Each pair a dot: the twin's travel time across, the ego's up; on the edge without arrival.

    Empty without pairs.
    """
    both = [
        pair
        for pair in pairs(driven(ones), twins)
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
    for tick in svg.ticks(low, high):
        parts.append(
            svg.grid_line(across.begin, up.at(tick), across.end, up.at(tick))
            + svg.label(38, up.at(tick) + 4, f"{tick:g}", "end")
        )
        parts.append(
            svg.grid_line(across.at(tick), up.begin, across.at(tick), up.end)
            + svg.label(across.at(tick), height - 22, f"{tick:g}", "middle")
        )
    parts += [
        svg.label((across.begin + across.end) / 2, height - 5, "SUMO's driver, s", "middle"),
        svg.label(8, 12, "ego, s", "start"),
    ]
    if any(_time(pair.one) is None for pair in both):
        parts.append(
            svg.grid_line(across.begin, 26, across.end, 26)
            + svg.label(across.end, 18, "ego did not arrive", "end")
        )
    if any(_time(pair.other) is None for pair in both):
        parts.append(svg.grid_line(edge, up.begin, edge, up.end))
        parts.append(
            f'<text class="label" transform="translate({edge + 8} {up.end}) rotate(90)" '
            'text-anchor="start">twin did not arrive</text>'
        )
    for variant, those in _by_variant(both).items():
        parts.append(
            f'<path class="points {colour[variant]}" d="{_dots(those, across, up, edge)}"/>'
        )
    return svg.figure(width, height, f"{title}: travel times beside those of SUMO's driver", parts)


def _by_variant(both: Iterable[Pair]) -> dict[str, list[Pair]]:
    """The pairs of each variant, the first variant last: on top."""
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
