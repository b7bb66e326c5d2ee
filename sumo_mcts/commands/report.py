"""The command report: tables and a page over the episodes of output folders."""

import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from sumo_mcts import files, records
from sumo_mcts.errors import ConfigError
from sumo_mcts.scenarios import Note

REPLAYS = 50  # episodes that a report lists, and replays
LARGEST_PAGE = 1 << 24  # bytes


class Report(NamedTuple):
    """What `report` made."""

    document: dict[str, Any]  # what --json prints
    text: str  # the first tables, as Markdown; report.md has them all
    files: tuple[Path, ...]  # the file to open in a browser


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


def write_results(folders: Sequence[Path], page: Path, note: Note) -> Report:
    """The tables between the marks of a Markdown page, made anew from the folders; without the
    page a new one with all tables.

    Raises ConfigError where there is no episode, or a mark is wrong; OSError.
    """
    from sumo_mcts.reporting import results_page

    text = _text_of(page)
    marked = [] if text is None else results_page.blocks(text, str(page))
    made = results_page.studies(folders, marked)
    note("writing the page")
    if text is None:
        text = results_page.new_page(made[""])
        marked = results_page.blocks(text, str(page))
    _write_page(page, results_page.refreshed(text, marked, made, str(page)))
    found = made[""].results
    anew = [block.words for block in marked if block.of in made]
    left = [block.words for block in marked if block.of not in made]
    document = {
        "schema_version": records.SCHEMA_VERSION,
        "page": str(page),
        "blocks": anew,
        "left": left,
        "episodes": len(found.rows),
        "notes": list(found.notes),
    }
    told = [", ".join(anew), *([f"as it was: {', '.join(left)}"] if left else [])]
    told += [f"note: {line}" for line in found.notes]
    return Report(document, "\n".join(told), (page,))


def _text_of(page: Path) -> str | None:
    """The text of a page that may be written; None: there is none.

    Raises ConfigError, OSError.
    """
    if not page.exists():
        return None
    try:
        text = files.content(page, LARGEST_PAGE).decode()
    except UnicodeDecodeError:
        raise ConfigError(f"{page}: is not text in UTF-8") from None
    if not os.access(page, os.W_OK):
        raise ConfigError(f"{page}: cannot be written")
    return text


def _write_page(page: Path, text: str) -> None:
    """Write a page wholly or not at all; links and permissions stay. Raises OSError."""
    target = files.absolute(page)
    with records.written_whole(target) as unfinished:
        unfinished.write_bytes(text.encode(errors="replace"))
        if target.exists():
            shutil.copymode(target, unfinished)
