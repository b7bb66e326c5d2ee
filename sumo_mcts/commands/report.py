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
    from sumo_mcts.reporting import page, results, tables  # quick, but no other command needs them

    found = results.gather(folders)
    note("counting")
    made = tables.tables(found.rows)
    looks, of = tables.worth_a_look(found.rows, REPLAYS)
    replays, problems = page.replays(looks, found.traces, note)
    found = found._replace(notes=(*found.notes, *problems))
    note("writing the page")
    records.write_whole(
        out / "report.md", tables.report_markdown(found, made, looks).encode(errors="replace")
    )
    for table in made:
        records.write_table(out / "tables" / f"{table.name}.csv", *tables.flat(table))
    written = page.page(found, made, looks, of, replays, " ".join(["sumo-mcts", *command]))
    records.write_whole(out / "report.html", written.encode(errors="replace"))
    text = "\n".join(
        [
            *(tables.markdown(table) for table in made[:2] if table.rows),
            *(f"note: {line}" for line in found.notes),
        ]
    )
    return Report(
        tables.report_document(found, made, looks, of),
        text,
        (out / "report.html", out / "report.md", out / "tables"),
    )
