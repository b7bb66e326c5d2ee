"""Writes docs/commands.md, corrects references to functions, and unpacks examples of the documents.

The documents name functions as `file.py::name`. `python tests/helpers_docs.py` corrects the file of
every function that was moved, and prints the names that it does not find.
"""

import ast
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import typer

DOCS = Path(__file__).resolve().parent.parent / "docs"
COMMANDS = DOCS / "commands.md"
NAMED = re.compile(r"`(?!tests/)([\w/]+\.py)::(\w+)`")
_HEAD = """\
# Commands

Every command, its arguments and its options, as `sumo-mcts COMMAND --help` prints them. What
follows `--` goes to SUMO (`run` and `batch`). Exit statuses: [reliability](reliability.md).

This page is generated: `python tests/helpers_docs.py` writes it anew.
"""


def unpack(page: str, folder: Path) -> None:
    """Write every fenced example of a page that has the name of a file as its title."""
    for name, text in re.findall(
        r'^```\w+ title="([\w./]+)"\n(.*?)^```',
        (DOCS / page).read_text(encoding="utf-8"),
        re.DOTALL | re.MULTILINE,
    ):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


def commands_page(app: typer.Typer) -> str:
    """docs/commands.md: a section for each command."""
    group: Any = typer.main.get_command(app)
    sections = [_section(name, group.commands[name]) for name in group.commands]
    return "\n".join([_HEAD, *sections])


def _section(name: str, command: Any) -> str:
    """Usage, what the command does, and a table of its parameters."""
    params = [each for each in command.params if "--help" not in each.opts]
    arguments = [each for each in params if not each.opts[0].startswith("-")]
    usage = " ".join(["sumo-mcts", name, *map(_metavar, arguments), "[OPTIONS]"])
    lines = [f"## {name}", "", f"`{usage}`", "", *_paragraphs(command.help)]
    if params:
        lines += ["| | default | meaning |", "|---|---|---|"]
        lines += [_row(each) for each in params]
    return "\n".join([*lines, ""])


def _metavar(param: Any) -> str:
    """An argument as the usage line shows it."""
    name = f"{param.name.upper()}{'...' if param.nargs == -1 else ''}"
    return name if param.required else f"[{name}]"


def _paragraphs(text: str | None) -> Iterator[str]:
    """The help text, with the line breaks of the source."""
    for paragraph in (text or "").strip().split("\n\n"):
        yield from (line.strip() for line in paragraph.split("\n"))
        yield ""


def _row(param: Any) -> str:
    """One parameter as a row: name, default, meaning."""
    if not param.opts[0].startswith("-"):
        label = f"`{_metavar(param)}`"
    elif param.is_flag:
        label = ", ".join(f"`{each}`" for each in (*param.opts, *param.secondary_opts))
    else:
        label = f"`{param.opts[0]} {param.metavar or param.opts[0].lstrip('-').upper()}`"
    default = "" if param.default in (None, False, (), []) else f"`{param.default}`"
    cells = [label, "required" if param.required else default, " ".join((param.help or "").split())]
    return "| " + " | ".join(each.replace("|", "\\|") for each in cells) + " |"


def definitions(package: Path) -> dict[str, list[str]]:
    """The files that define each function and class at their top level, relative to the package."""
    found = defaultdict(list)
    for path in sorted(package.rglob("*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                found[node.name].append(path.relative_to(package).as_posix())
    return found


def relocated(text: str, files: Mapping[str, list[str]]) -> str:
    """The text with the present file of each function that was moved, if it can be found.

    Of several files with the name, the one in the same package is taken.
    """

    def present(match: re.Match[str]) -> str:
        file, name = match.groups()
        twin = name.removeprefix("_") if name.startswith("_") else f"_{name}"
        name = name if name in files else twin
        there = files.get(name, [])
        near = [each for each in there if each.split("/")[0] == file.split("/")[0]] or there
        if file in there:
            near = [file]
        return f"`{near[0]}::{name}`" if len(near) == 1 else match[0]

    return NAMED.sub(present, text)


if __name__ == "__main__":
    from sumo_mcts.cli import app

    COMMANDS.write_text(commands_page(app), encoding="utf-8")
    known = definitions(DOCS.parent / "sumo_mcts")
    lost = []
    for page in sorted(DOCS.rglob("*.md")):
        text = relocated(page.read_text(encoding="utf-8"), known)
        page.write_text(text, encoding="utf-8")
        lost += [
            f"{page.relative_to(DOCS)}: {file}::{name}"
            for file, name in NAMED.findall(text)
            if file not in known.get(name, [])
        ]
    raise SystemExit("\n".join(lost) or None)
