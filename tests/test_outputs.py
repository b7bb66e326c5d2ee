"""docs/outputs.md shows every kind of output, and what its script makes is there."""

import re
from pathlib import Path
from typing import Any

import pytest
import typer
from helpers_docs import unpack
from helpers_outputs import (
    COPIES,
    DRAWINGS,
    EXCERPTS,
    IMAGES,
    PAGE,
    WINDOWS,
    commands,
    excerpt,
    marks,
)
from typer.testing import CliRunner

from sumo_mcts.cli import app

TEXT = PAGE.read_text(encoding="utf-8")
SAME_EVERYWHERE = ("scenarios", "experiments", "validate", "schema")  # and done in no time


def shown(name: str) -> str:
    """What stands between the marks of an excerpt."""
    begin, end = marks(name)
    return TEXT.split(begin)[1].split(end)[0].strip()


def test_every_command_is_on_the_page() -> None:
    group: Any = typer.main.get_command(app)
    assert {words[0] for words in commands(TEXT)} == set(group.commands)


def test_the_excerpts_are_those_of_the_script() -> None:
    assert set(re.findall(r"<!-- end of ([\w-]+) -->", TEXT)) == set(EXCERPTS)
    assert all(len(shown(name).splitlines()) >= 3 for name in EXCERPTS)
    there = {" ".join(words) for words in commands(TEXT)}
    sources = {part.source for part in EXCERPTS.values()}
    assert {source for source in sources if not source.startswith("out/")} <= there


def test_the_pictures_are_those_of_the_script_and_small() -> None:
    on_page = set(re.findall(r"\]\(images/([\w.-]+)\)", TEXT))
    assert on_page == {*COPIES, *WINDOWS, *DRAWINGS}
    for name in on_page:
        most = 1_500_000 if name.endswith(".gif") else 200_000
        assert 1_000 < (IMAGES / name).stat().st_size < most, name


@pytest.mark.parametrize("name", DRAWINGS)
def test_a_figure_needs_no_style_of_the_report(name: str) -> None:
    drawing = (IMAGES / name).read_text(encoding="utf-8")
    assert drawing.startswith("<svg xmlns=")
    assert "class=" not in drawing
    assert "var(" not in drawing
    assert "stroke=" in drawing


@pytest.mark.parametrize("name", SAME_EVERYWHERE)
def test_excerpts_that_are_the_same_everywhere_are_up_to_date(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    unpack(PAGE.name, tmp_path)
    monkeypatch.chdir(tmp_path)
    part = EXCERPTS[name]
    answer = CliRunner().invoke(app, part.source.split())
    assert shown(name) == excerpt(answer.stdout or answer.stderr, part.lines, ""), (
        "run python tests/helpers_outputs.py"
    )


def test_an_excerpt_tells_what_it_leaves_out_and_wraps_json() -> None:
    lines = "one\ntwo\nthree\n"
    assert excerpt(lines, slice(None), "") == "```text\none\ntwo\nthree\n```"
    assert excerpt(lines, slice(2), ".csv") == "```csv\none\ntwo\n...\n```"
    assert excerpt(lines, slice(-1, None), "") == "```text\n...\nthree\n```"
    assert excerpt(lines, slice(1, 2), ".md") == "two"
    assert excerpt("x" * 1000, slice(None), "").splitlines()[1].endswith("xx…")
    row = '{"key": ' + ", ".join(["1.25"] * 50) + "}\n"
    (first, *wrapped, last) = excerpt(row, slice(None), ".jsonl").splitlines()
    assert (first, last) == ("```json", "```")
    assert " ".join(wrapped) == row.strip()
    assert all(len(line) <= 98 for line in wrapped)
