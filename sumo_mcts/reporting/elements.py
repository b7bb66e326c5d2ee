"""The HTML elements that the parts of the page share."""

from collections.abc import Mapping
from html import escape

from sumo_mcts.records.statistics import Estimate, Rate
from sumo_mcts.reporting.cells import spread


def swatch(colour: str) -> str:
    """A patch of a variant's colour."""
    return f'<span class="swatch {colour}"></span>'


def select(name: str, options: Mapping[str, str], chosen: str = "", label_text: str = "") -> str:
    """A choice among values, each with its label.

    `label_text`: the name of the choice for screen readers, where there is no visible label.
    """
    entries = (
        f'<option value="{escape(value)}"{" selected" if value == chosen else ""}>'
        f"{escape(label)}</option>"
        for value, label in options.items()
    )
    label = f' aria-label="{label_text}"' if label_text else ""
    return f'<select id="{name}"{label}>{"".join(entries)}</select>'


def number_cell(value: str, shown: str, within: str = "", bar: str = "") -> str:
    """A table cell that sorts by `value`; "": unknown."""
    drawn = f'<span class="kn">{shown}</span>{bar}' if within else shown
    interval = f' <span class="iv">{within}</span>' if within else ""
    return f'<td class="n{" share" if within else ""}" data-v="{value}">{drawn}{interval}</td>'


def bar(cell: Rate, kind: str) -> str:
    """A drawing of the share and its interval; `kind`: further classes."""
    if cell.interval is None:
        return ""
    low, high = (f"{100 * share:.1f}%" for share in cell.interval)
    return (
        f'<i class="bar{kind}" '
        f'style="--low:{low};--high:{high};--at:{100 * cell.k / cell.n:.1f}%"></i>'
    )


def interval(cell: Rate | Estimate) -> str:
    """The interval of a cell, without brackets."""
    return spread(cell).strip(" ()")
