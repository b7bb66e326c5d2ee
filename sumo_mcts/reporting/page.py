"""The page of a report: one file that holds tables, figures and replays of the highlights."""

import re
from collections.abc import Callable, Mapping, Sequence
from html import escape
from importlib import resources
from pathlib import Path

from sumo_mcts.records import Row, TraceError, load_trace
from sumo_mcts.records.statistics import LEAST
from sumo_mcts.reporting.cells import counted
from sumo_mcts.reporting.elements import select
from sumo_mcts.reporting.highlights import Highlight
from sumo_mcts.reporting.page_figures import figures, legend
from sumo_mcts.reporting.page_highlights import highlights_about, highlights_list
from sumo_mcts.reporting.page_tables import html_table, tiles
from sumo_mcts.reporting.replay import packed
from sumo_mcts.reporting.results import Results
from sumo_mcts.reporting.tables import Table
from sumo_mcts.reporting.variants import colours, foremost, labels, planner_style

_FOOTER = (
    "Written by {}. Rates with the 95 % Wilson interval; medians and paired differences with a 95 "
    "% bootstrap interval over episodes. "
    f"None stands where fewer than {LEAST} are known or all are the same: there the number of "
    "pairs says what a result is worth."
)


def page(
    results: Results,
    found: Sequence[Table],
    shown: Sequence[Highlight],
    of: int,
    replayed: Mapping[str, str],
    command: str,
) -> str:
    """The whole page.

    `of`: how many highlights `shown` was chosen from; `replayed`: packed replays by key; `command`:
    the command that writes it.
    """
    rows, colour = results.rows, colours(results.rows)
    scenarios = {
        scenario: [row for row in rows if row["scenario"] == scenario]
        for scenario in dict.fromkeys(row["scenario"] for row in rows)
    }
    parts = {
        "title": escape(results.name),
        "style": _asset("page.css") + planner_style(),
        "script": _asset("page.js"),
        "description": escape(results.description),
        "meta": escape(_meta(results)),
        "focus": select("focus", labels(rows), foremost(rows)),
        "over": escape(_over(rows)),
        "tiles": "".join(
            tiles(variant, [row for row in rows if row["variant"] == variant], rows)
            for variant in labels(rows)
        ),
        "summary": html_table(found[0], rows, colour),
        "scenes": select(
            "scene", {scenario: scenario for scenario in scenarios}, label_text="Scenario"
        ),
        "legend": legend(rows, colour),
        "figures": "".join(
            figures(scenario, those, colour) for scenario, those in scenarios.items()
        ),
        "looks_about": escape(highlights_about(shown, of)),
        "looks": highlights_list(shown, replayed, colour),
        "tables": "".join(html_table(table, rows, colour) for table in found[1:] if table.rows),
        "notes_link": '<a href="#notes">Notes</a>' if results.notes else "",
        "notes": _notes(results.notes),
        "footer": escape(_FOOTER.format(command)),
        "replays": "\n".join(_replay(key, text) for key, text in replayed.items()),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match.group(1)], _asset("page.html"))


def replays(
    shown: Sequence[Highlight], traces: Mapping[str, Path], note: Callable[[str], None]
) -> tuple[dict[str, str], list[str]]:
    """The packed replays of the highlights that have a trace, by key; and what is wrong with the
    traces of the others."""
    found, problems = {}, []
    for i, (row, _) in enumerate(shown):
        key = row["key"]
        path = traces.get(key)
        note(f"packing replays  {i + 1} of {len(shown)}")
        try:
            if path is not None:
                found[key] = packed(load_trace(path))
        except (TraceError, OSError) as error:
            problems.append(f"no replay of {key}: {error}")
        # A trace may hold what no rule forbids: that costs its own replay, not the report.
        except Exception as error:
            reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
            problems.append(f"no replay of {key}: {path}: {reason}")
    return found, problems


def _replay(key: str, text: str) -> str:
    return f'<script type="text/plain" class="replay" data-key="{escape(key)}">{text}</script>'


def _asset(name: str) -> str:
    return (
        resources.files("sumo_mcts.reporting")
        .joinpath("template", name)
        .read_text(encoding="utf-8")
    )


def _meta(results: Results) -> str:
    rows = results.rows
    counts = [
        counted(len(rows), "episode"),
        *(counted(len({row[key] for row in rows}), key) for key in ("scenario", "variant")),
    ]
    named = {"sumo_mcts": "sumo_mcts", "sumo": "SUMO", "python": "Python"}
    return " · ".join(
        [
            *counts,
            *(
                f"{name} {results.versions[key]}"
                for key, name in named.items()
                if key in results.versions
            ),
        ]
    )


def _over(rows: Sequence[Row]) -> str:
    count = len({row["scenario"] for row in rows})
    return "" if count == 1 else f"over all {count} scenarios together; the table keeps them apart"


def _notes(notes: Sequence[str]) -> str:
    if not notes:
        return ""
    listed = "".join(f"<li>{escape(note)}</li>" for note in notes)
    return f'<section id="notes"><div class="notes"><h2>Notes</h2><ul>{listed}</ul></div></section>'
