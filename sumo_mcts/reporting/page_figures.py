"""The page's figures."""

from collections.abc import Mapping, Sequence
from html import escape

from sumo_mcts.records import Row
from sumo_mcts.reporting.elements import swatch
from sumo_mcts.reporting.plots import (
    Distribution,
    spread_figure,
    sweep_figure,
    sweeps,
    twin_figure,
)
from sumo_mcts.reporting.variants import driven, labels, twins_of

_OF_DRIVERS = (
    Distribution(
        "min_ttc_s",
        "Closest calls: time to collision",
        "The smallest of each episode; none where no collision was near.",
        logarithmic=True,
    ),
    Distribution(
        "rms_jerk_mps3",
        "Jerk",
        "Root mean square of each episode, smoothed over half a second: how evenly the ego drives.",
    ),
)
_OF_PLANNERS = (  # not of SUMO's own driver
    Distribution(
        "plan_ms_p50",
        "Decision time, typical",
        "The median of each episode's decisions, from scene to decision.",
        logarithmic=True,
    ),
    Distribution(
        "plan_ms_p99",
        "Decision time, slowest",
        "What one in a hundred of an episode's decisions exceeded.",
        logarithmic=True,
    ),
)
_QUANTILES = "Thin: nine tenths of the episodes; thick: half of them; dot and number: the median."


def figures(scenario: str, rows: Sequence[Row], colour: Mapping[str, str]) -> str:
    """The figures of a scenario."""
    parts = []
    for title, swept in sweeps(rows).items():
        about = (
            "Arrived (solid, dots) and collided (dashed, squares), with 95 % intervals: "
            f"{', '.join(family.label for family in swept)}."
        )
        parts.append(_figure("Effort", about, sweep_figure(title, swept, colour)))
    about = "A dot for each pair of the same seed; below the line the ego was faster."
    beside = twin_figure(scenario, rows, twins_of(rows), colour)
    parts.append(_figure("Travel time beside SUMO's driver", about, beside))
    for those, distributions in ((rows, _OF_DRIVERS), (driven(rows), _OF_PLANNERS)):
        for drawn in distributions:
            figure = spread_figure(those, drawn, colour)
            parts.append(_figure(drawn.title, f"{drawn.about} {_QUANTILES}", figure))
    return f'<div class="figures" data-scene="{escape(scenario)}" hidden>{"".join(parts)}</div>'


def legend(rows: Sequence[Row], colour: Mapping[str, str]) -> str:
    """The colours of the variants."""
    named = (
        f"<span>{swatch(colour[variant])}{escape(label)}</span>"
        for variant, label in labels(rows).items()
    )
    return f'<p class="legend">{"".join(named)}</p>'


def _figure(title: str, about: str, drawn: str) -> str:
    """A figure with its caption; empty where nothing is drawn."""
    if not drawn:
        return ""
    return (
        f"<figure><h3>{escape(title)}</h3><figcaption>{escape(about)}</figcaption>{drawn}</figure>"
    )
