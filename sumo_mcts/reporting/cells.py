"""The cells of a report's tables, and how they are written: in words, and as plain data."""

import math
from collections.abc import Callable
from typing import Any

from sumo_mcts.records.statistics import Contrast, Estimate, Rate

Cell = Rate | Estimate | Contrast | float | int | str | None


def text(cell: Cell, digits: int) -> str:
    """A cell in words, with its interval; `digits` after the point where it is no whole number."""
    if isinstance(cell, Rate):
        return f"{cell.k}/{cell.n}{spread(cell)}"
    if isinstance(cell, Estimate):
        return f"{number(cell.value, digits)}{spread(cell)}"
    if isinstance(cell, Contrast):
        return f"{cell.k}:{cell.other}, {signed(cell.per_hundred)}{spread(cell)}"
    if cell is None:
        return "-"
    return cell if isinstance(cell, str) else number(cell, digits * isinstance(cell, float))


def spread(cell: Rate | Estimate | Contrast) -> str:
    """The interval in brackets, after a space; empty where there is none."""
    if cell.interval is None:
        return ""
    show: Callable[[float], str] = {Rate: _percent, Contrast: signed, Estimate: number}[type(cell)]
    low, high = map(show, cell.interval)
    return f" ({low}..{high}{' %' if isinstance(cell, Rate) else ''})"


def number(value: float, digits: int = 2) -> str:
    """A number with so many digits after the point; infinity as its sign."""
    return f"{value:,.{digits}f}".replace(",", "\u2009") if math.isfinite(value) else "∞"


def signed(value: float) -> str:
    """Episodes per hundred, with their sign."""
    return "0.0" if abs(value) < 0.05 else f"{value:+.1f}".replace("-", "\u2212")


def counted(count: int, noun: str) -> str:
    """A count and its noun."""
    return f"{number(count, 0)} {noun}{'' if count == 1 else 's'}"


def is_numeric(cell: Cell) -> bool:
    """Whether a cell holds a number."""
    return cell is not None and not isinstance(cell, str)


def plain(cell: Rate | Estimate | Contrast) -> dict[str, Any]:
    """The parts of a cell by name, its interval as `low` and `high`; infinity as the text `inf`."""
    low, high = cell.interval or (None, None)
    parts = {**cell._asdict(), "low": low, "high": high}
    del parts["interval"]
    return {name: finite(value) for name, value in parts.items()}


def finite(value: Any) -> Any:
    """The value; infinity, which JSON does not know, as the text `inf`."""
    return "inf" if value == math.inf else value


def _percent(share: float) -> str:
    """A share in percent, finer where it is small or large."""
    value = 100 * share
    return f"{value:.1f}" if 0.05 <= value < 10 or 90 < value < 99.95 else f"{value:.0f}"
