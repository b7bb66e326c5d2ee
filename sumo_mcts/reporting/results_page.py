"""A page of results: a Markdown file of the user's own, with generated tables between marks.

    <!-- results: table NAME -->
    ...
    <!-- end of results -->

What stands between the marks is made anew from the rows; everything else stays as it is. With
`table NAME of EXPERIMENT` it is made of the folders of that experiment, and stays without them.
Each block says where its numbers come from: commands, episodes, seeds, versions, what is missing.
"""

import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

from sumo_mcts.errors import ConfigError, near, shown
from sumo_mcts.records import Row
from sumo_mcts.reporting import documents
from sumo_mcts.reporting.cells import counted
from sumo_mcts.reporting.results import Results, commands, experiment_of, gather, some_of
from sumo_mcts.reporting.tables import Table, study, tables

END = "<!-- end of results -->"
MOST_COMMANDS = 8  # that are listed; single runs have one each
WIDTH = 100  # columns of the sentences
_BEGIN = re.compile(r"<!--\s*results:\s*(?P<asked>.*?)(?:\s+of\s+(?P<of>.*?))?\s*-->")
_EMPTY = "None of these episodes belongs in this table."
_VERSIONS = {
    "sumo_mcts": "sumo_mcts",
    "sources": "sources",
    "sumo": "SUMO",
    "python": "Python",
    "numba": "numba",
    "numpy": "numpy",
}


class Block(NamedTuple):
    """A pair of marks: what is asked for between them, and the lines of the two, from 0."""

    asked: str  # `table NAME`
    of: str  # the experiment; "": whatever is in the folders
    begin: int
    end: int

    @property
    def words(self) -> str:
        """What the mark says."""
        return f"{self.asked} of {self.of}" if self.of else self.asked


class Study(NamedTuple):
    """What the blocks of some folders are made of."""

    results: Results
    commands: list[str]
    tables: list[Table]


# --- the page ---


def blocks(text: str, page: str) -> list[Block]:
    """The pairs of marks of a page, in their order; a mark stands alone in its line.

    Raises ConfigError, with the name of the `page`, where a mark has no counterpart.
    """
    found: list[Block] = []
    begun: Block | None = None
    for i, line in enumerate(text.split("\n")):
        begin, ends = _BEGIN.fullmatch(line.rstrip()), line.rstrip() == END
        if begun is not None and begin:
            break
        if begun is not None and ends:
            found.append(begun._replace(end=i))
            begun = None
        elif begin:
            begun = Block(begin["asked"], begin["of"] or "", i, i)
        elif ends:
            raise ConfigError(f"{page}: line {i + 1}: {END} without a mark that begins")
    if begun is not None:
        raise ConfigError(f"{page}: line {begun.begin + 1}: {_mark(begun.words)} without {END}")
    return found


def studies(folders: Sequence[Path], found: Iterable[Block]) -> dict[str, Study]:
    """What blocks are made of: that of all folders under "", and of each experiment that a block
    names and that is in the folders.

    Raises ConfigError where there is no episode.
    """
    named = [experiment_of(folder) for folder in folders]
    made = {"": _study(folders)}
    for name in dict.fromkeys(block.of for block in found if block.of in named):
        those = [folder for folder, its in zip(folders, named, strict=True) if its == name]
        made[name] = made[""] if len(those) == len(folders) else _study(those)
    return made


def _study(folders: Sequence[Path]) -> Study:
    found = gather(folders)
    made = [study(found.rows), *tables(found.rows)]
    return Study(found, commands(folders, found.rows), made)


def refreshed(text: str, found: Sequence[Block], made: Mapping[str, Study], page: str) -> str:
    """The text of a page with the blocks that were `found` in it made anew; those of other
    experiments than `made` has stay.

    Raises ConfigError where there is none, and where one asks for what no table is.
    """
    names = [_asked(table) for table in made[""].tables]
    known = f"there are: {', '.join(names)}"
    if not found:
        raise ConfigError(f"{page}: no {_mark('table NAME')} ... {END} in it; {known}")
    for block in found:
        if block.asked not in names:
            meant = "".join(f"; {name}?" for name in near(block.asked, names, 1))
            where = f"{page}: line {block.begin + 1}: results"
            raise ConfigError(f"{where}: {shown(block.asked)} is unknown{meant}; {known}")
    ours = [block for block in found if block.of in made]
    if not ours:
        of = some_of(list(dict.fromkeys(block.of for block in found)))
        raise ConfigError(f"{page}: its tables are of {of}, of which no folder is given")
    contents = {of: _contents(each) for of, each in made.items()}
    lines = text.split("\n")
    for block in reversed(ours):
        ending = "\r" if lines[block.begin].endswith("\r") else ""
        between = ("", *contents[block.of][block.asked].split("\n"), "")
        lines[block.begin + 1 : block.end] = [f"{line}{ending}" for line in between]
    return "\n".join(lines)


def new_page(made: Study) -> str:
    """A new page: title, description, and empty blocks for all tables that have rows."""
    results = made.results
    head = [f"# {_escaped(results.name)}"]
    head += [_filled(_escaped(results.description))] if results.description else []
    parts = [
        f"## {table.title}\n\n{_mark(_asked(table))}\n{END}" for table in made.tables if table.rows
    ]
    return "\n\n".join([*head, *parts]) + "\n"


def _contents(made: Study) -> dict[str, str]:
    """What stands in the block of each table, by what its mark asks for."""
    source = _source(made.results, made.commands)
    return {
        _asked(table): "\n\n".join(
            [_filled(table.about), documents.lines(table), source]
            if table.rows
            else [_EMPTY, source]
        )
        for table in made.tables
    }


def _asked(table: Table) -> str:
    return f"table {table.name}"


def _mark(words: str) -> str:
    return f"<!-- results: {words} -->"


def _escaped(text: str) -> str:
    """Text that begins no comment, and so no mark."""
    return text.replace("<", "&lt;")


def _filled(text: str) -> str:
    return textwrap.fill(text, WIDTH, break_long_words=False, break_on_hyphens=False)


# --- where the numbers come from ---


def _source(results: Results, used: Sequence[str]) -> str:
    """The commands, an indented example; a sentence of what was driven with what; the notes."""
    more = len(used) - MOST_COMMANDS
    listed = [*used[:MOST_COMMANDS], *([f"# and {more} more"] if more > 0 else [])]
    examples = "\n".join(f"    {command}" for command in listed)
    versions = [
        f"{name} {results.versions[key]}"
        for key, name in _VERSIONS.items()
        if key in results.versions
    ]
    told = ", ".join(versions) if versions else "versions unknown"
    driven = f"{counted(len(results.rows), 'episode')}, {_seeds(results.rows)}; {told}."
    notes = "\n".join(f"- {note}" for note in results.notes)
    parts = (examples or "The command is not recorded.", _filled(driven), notes)
    return "\n\n".join(part for part in parts if part)


def _seeds(rows: Iterable[Row]) -> str:
    """The seeds in ranges; apart for scenarios that have others."""
    of_scenario: dict[str, set[int | None]] = {}
    for row in rows:
        of_scenario.setdefault(row["scenario"], set()).add(row["seed"])
    alike: dict[str, list[str]] = {}
    for scenario, seeds in of_scenario.items():
        alike.setdefault(_ranges(seeds), []).append(scenario)
    told = [f"{seeds} ({some_of(scenarios)})" for seeds, scenarios in alike.items()]
    return f"seeds {'; '.join(told) if len(alike) > 1 else next(iter(alike))}"


def _ranges(seeds: Iterable[int | None]) -> str:
    """Whole numbers as `0..99, 120`; None: SUMO keeps a seed of its own."""
    known = sorted(seed for seed in seeds if seed is not None)
    runs = groupby(enumerate(known), lambda each: each[1] - each[0])
    ends = [(run[0][1], run[-1][1]) for run in (list(members) for _, members in runs)]
    told = [f"{first}..{last}" if last > first else f"{first}" for first, last in ends]
    return some_of([*told, *(["of SUMO itself"] if None in seeds else [])])
