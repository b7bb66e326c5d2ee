"""A report as Markdown, as JSON and as CSV."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from sumo_mcts.records import SCHEMA_VERSION, Row
from sumo_mcts.reporting.cells import Cell, finite, is_numeric, plain, text
from sumo_mcts.reporting.highlights import Highlight
from sumo_mcts.reporting.results import Results
from sumo_mcts.reporting.tables import Table

# --- Markdown ---


def report_markdown(results: Results, found: Sequence[Table], shown: Sequence[Highlight]) -> str:
    """The whole report in Markdown."""
    head = [f"# {results.name}", *([results.description] if results.description else [])]
    parts = [*head, *(markdown(table) for table in found if table.rows)]
    if shown:
        parts.append(_highlights_markdown(shown))
    if results.notes:
        parts.append("\n".join(["## Notes", "", *(f"- {note}" for note in results.notes)]))
    return "\n\n".join(part.strip() for part in parts) + "\n"


def markdown(table: Table) -> str:
    """A table in Markdown, with its heading and what it is about."""
    return f"## {table.title}\n\n{table.about}\n\n{lines(table)}\n"


def lines(table: Table) -> str:
    """The lines of a table in Markdown."""
    numeric = [any(is_numeric(row[i]) for row in table.rows) for i in range(len(table.columns))]
    shown = [
        _line(text(cell, column.digits) for cell, column in zip(row, table.columns, strict=True))
        for row in table.rows
    ]
    head = _line(column.heading for column in table.columns)
    return "\n".join([head, _line("---:" if right else "---" for right in numeric), *shown])


def _highlights_markdown(shown: Sequence[Highlight]) -> str:
    lines = [
        "## Episodes worth a look",
        "",
        _line(("Episode", "Outcome", "Why")),
        _line(("---",) * 3),
    ]
    lines += [
        _line((row["key"], row["outcome"].replace("_", " "), "; ".join(reasons)))
        for row, reasons in shown
    ]
    return "\n".join(lines) + "\n"


def _line(cells: Iterable[str]) -> str:
    plain_cells = (cell.replace("|", "&#124;").replace("\n", " ") or " " for cell in cells)
    return f"| {' | '.join(plain_cells)} |"


# --- JSON ---


def report_document(
    results: Results, found: Sequence[Table], shown: Sequence[Highlight], of: int
) -> dict[str, Any]:
    """The whole report for JSON; `of`: how many highlights there are."""
    return {
        "schema_version": SCHEMA_VERSION,
        "name": results.name,
        "description": results.description,
        "episodes": len(results.rows),
        "notes": list(results.notes),
        "tables": {table.name: document(table) for table in found},
        "worth_a_look": {
            "of": of,
            "episodes": [
                {"key": row["key"], "outcome": row["outcome"], "reasons": list(reasons)}
                for row, reasons in shown
            ],
        },
    }


def document(table: Table) -> dict[str, Any]:
    """A table for JSON."""
    columns = [
        {"key": c.key, "label": c.label, "unit": c.unit, "about": c.about} for c in table.columns
    ]
    rows = [
        {
            column.key: plain(cell) if isinstance(cell, tuple) else finite(cell)
            for cell, column in zip(row, table.columns, strict=True)
        }
        for row in table.rows
    ]
    return {"title": table.title, "about": table.about, "columns": columns, "rows": rows}


# --- CSV ---


def flat(table: Table) -> tuple[list[str], list[Row]]:
    """Columns and rows for CSV: a rate is KEY_k, KEY_n, KEY_low and KEY_high, and so on; infinity
    is `inf`."""
    rows = [
        {
            name: value
            for cell, column in zip(row, table.columns, strict=True)
            for name, value in _parts(cell, column.key)
        }
        for row in table.rows
    ]
    names = list(dict.fromkeys(name for row in rows for name in row))
    return names or [column.key for column in table.columns], rows


def _parts(cell: Cell, key: str) -> Iterator[tuple[str, Any]]:
    """The columns of a cell, with their values."""
    for name, value in plain(cell).items() if isinstance(cell, tuple) else [("", cell)]:
        yield (f"{key}_{name}" if name not in ("", "value") else key), value
