"""The command report: tables and a page over the episodes of output folders."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from sumo_mcts import records
from sumo_mcts.scenarios import Note

REPLAYS = 50  # episodes that a report lists, and replays


class Report(NamedTuple):
    """What `report` made."""

    document: dict[str, Any]  # what --json prints
    text: str  # the first tables, as Markdown; report.md has them all
    files: tuple[Path, ...]  # what a person wants to open


def report(folders: Sequence[Path], out: Path, command: Sequence[str], note: Note) -> Report:
    """Tables and a page over all episodes of the folders, into `out`.

    Raises ConfigError where there is none, OSError.
    """
    # Quick to load, but no other command needs them.
    from sumo_mcts.reporting import documents, page, results, tables
    from sumo_mcts.reporting.highlights import choose_highlights

    found = results.gather(folders)
    note("counting")
    made = tables.tables(found.rows)
    shown, of = choose_highlights(found.rows, REPLAYS)
    replays, problems = page.replays(shown, found.traces, note)
    found = found._replace(notes=(*found.notes, *problems))
    note("writing the page")
    records.write_whole(
        out / "report.md", documents.report_markdown(found, made, shown).encode(errors="replace")
    )
    for table in made:
        records.write_table(out / "tables" / f"{table.name}.csv", *documents.flat(table))
    written = page.page(found, made, shown, of, replays, " ".join(["sumo-mcts", *command]))
    records.write_whole(out / "report.html", written.encode(errors="replace"))
    text = "\n".join(
        [
            *(documents.markdown(table) for table in made[:2] if table.rows),
            *(f"note: {line}" for line in found.notes),
        ]
    )
    return Report(
        documents.report_document(found, made, shown, of),
        text,
        (out / "report.html", out / "report.md", out / "tables"),
    )
