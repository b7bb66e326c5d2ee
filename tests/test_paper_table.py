"""The table of docs/paper.md: each sentence has its function and its test, and both are there."""

import re
from pathlib import Path
from typing import NamedTuple

import pytest
from helpers_docs import DOCS, NAMED, definitions

TOP = DOCS.parent
_TEST = re.compile(r"`(tests/[\w/]+\.py)::(\w+)`")


class Sentence(NamedTuple):
    """A row of the table."""

    says: str
    function: str
    test: str
    tried: bool


def sentences() -> list[Sentence]:
    found = []
    for line in (DOCS / "paper.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("| ") and cells[0] != "the paper says":
            assert len(cells) == 4, line
            found.append(Sentence(*cells[:3], tried=cells[3] == "●"))
    return found


ROWS = sentences()
FILES = definitions(TOP / "sumo_mcts")


def test_the_table_is_whole() -> None:
    assert len(ROWS) > 40 and len({row.says for row in ROWS}) == len(ROWS)
    assert sum(row.tried for row in ROWS) >= 10


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.says)
def test_its_function_is_there_or_the_reason_why_there_is_none(row: Sentence) -> None:
    named = NAMED.findall(row.function)
    assert named or row.function.startswith("none: ")
    assert not [f"{file}::{name}" for file, name in named if file not in FILES.get(name, [])]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.says)
def test_its_test_is_there_or_the_reason_why_there_is_none(row: Sentence) -> None:
    named = _TEST.findall(row.test)
    assert named or (row.test.startswith("none: ") and not row.tried)
    for file, name in named:
        assert name.startswith("test_")
        assert re.search(rf"^def {name}\(", Path(TOP / file).read_text("utf-8"), re.MULTILINE)
