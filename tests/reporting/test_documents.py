"""Numbers as text; tables as Markdown, CSV and JSON."""

import csv
import json
import math
from pathlib import Path

from helpers_rows import made_rows

from sumo_mcts import records
from sumo_mcts.records.statistics import Contrast, Estimate, Rate, wilson
from sumo_mcts.reporting import documents
from sumo_mcts.reporting.cells import text
from sumo_mcts.reporting.columns import Column
from sumo_mcts.reporting.tables import Table, tables


def test_numbers_as_text() -> None:
    shown = {
        text(cell, digits)
        for cell, digits in (
            (Rate(0, 300, wilson(0, 300)), 2), (Rate(0, 0, None), 2),
            (Estimate(math.inf, (0.5, math.inf), 9), 2),
            (Contrast(6, 1, 100, 5.0, (-0.02, 10.0)), 2),
            (Estimate(0.5, None, 3), 2), (Contrast(1, 0, 2, 50.0, None), 2), (None, 2), (12345, 2),
            (0.456, 1), ("a", 2),
        )
    }  # fmt: skip
    assert shown == {
        "0/300 (0..1.3 %)",
        "0/0",
        "∞ (0.50..∞)",
        "6:1, +5.0 (0.0..+10.0)",
        "0.50",
        "1:0, +50.0",
        "-",
        "12\u2009345",
        "0.5",
        "a",
    }


def test_markdown_keeps_the_columns_together() -> None:
    table = Table(
        "t",
        "Title",
        "About.",
        (Column("a", "A"), Column("b", "B", unit="s")),
        (("x|y\nz", 1.5), ("", None)),
    )
    lines = documents.markdown(table).splitlines()
    assert lines[4:] == ["| A | B, s |", "| --- | ---: |", "| x&#124;y z | 1.50 |", "|   | - |"]


def test_csv_has_a_column_for_each_number(tmp_path: Path) -> None:
    for table in tables(made_rows(8)):
        records.write_table(tmp_path / "t.csv", *documents.flat(table))
        read = list(csv.DictReader((tmp_path / "t.csv").read_text().splitlines()))
        assert len(read) == len(table.rows)
        for row, cell in (
            (row, cell)
            for row, cells_of in zip(read, table.rows, strict=True)
            for cell in zip(table.columns, cells_of, strict=True)
        ):
            column, value = cell
            if isinstance(value, Rate):
                assert (int(row[f"{column.key}_k"]), int(row[f"{column.key}_n"])) == (
                    value.k,
                    value.n,
                )
            elif isinstance(value, Estimate):
                high = "" if value.interval is None else str(value.interval[1])
                assert (float(row[column.key]), row[f"{column.key}_high"]) == (value.value, high)
    assert documents.flat(Table("t", "", "", (Column("a", "A"),), ())) == (["a"], [])


def test_json_has_no_numbers_that_json_does_not_know() -> None:
    document = documents.document(
        Table(
            "t",
            "T",
            "",
            (Column("a", "A"),),
            (
                (Estimate(math.inf, (1.0, math.inf), 9),),
                (Estimate(1.0, None, 3),),
                (Rate(1, 2, wilson(1, 2)),),
                (None,),
                (math.inf,),
            ),
        )
    )
    assert json.loads(json.dumps(document, allow_nan=False))["rows"][0] == {
        "a": {"value": "inf", "low": 1.0, "high": "inf", "n": 9}
    }
    assert document["rows"][1] == {"a": {"value": 1.0, "low": None, "high": None, "n": 3}}
    assert document["rows"][2]["a"]["k"] == 1
    assert document["rows"][4] == {"a": "inf"}
