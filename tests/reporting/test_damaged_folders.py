"""One damaged file costs a report one note, not the report."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers_rows import made_row, write_rows, write_traces

from sumo_mcts.commands.report import Report, report
from sumo_mcts.errors import ConfigError
from sumo_mcts.records import MANIFEST, ROWS, TRACES
from sumo_mcts.records.measures import BY_KEY, REQUIRED
from sumo_mcts.records.rows import LONGEST_LINE
from sumo_mcts.records.statistics import pairs
from sumo_mcts.reporting.results import gather

STRANGE = (
    -1,
    1.5,
    True,
    "text",
    "",
    [],
    {},
    [[1]],
    float("nan"),
    float("inf"),
    1e308,
    10**400,
    "a\nb\x1b[31m",
    "=1+1",
)


def reported(folder: Path) -> Report:
    """What `sumo-mcts report` makes of a folder."""
    return report([folder], folder / "report", (), lambda text: None)


@pytest.mark.parametrize("key", [key for key in BY_KEY if key not in REQUIRED])
def test_a_value_of_any_kind_under_any_key_costs_no_report(key: str, tmp_path: Path) -> None:
    rows = [
        {**made_row(variant=variant, seed=seed), key: value}
        for seed, value in enumerate(STRANGE)
        for variant in ("mcts-idm-100", "sumo")
    ]
    made = reported(write_rows(tmp_path, rows))
    assert made.document["episodes"] == len(rows)
    assert (
        made.document["notes"][0]
        == f"{tmp_path}: {ROWS}: values that their keys do not allow are left out: {key}"
    )
    assert "\x1b" not in "".join(path.read_text() for path in (tmp_path / "report").rglob("*.*"))


def test_texts_that_make_a_row_whole_may_hold_anything(tmp_path: Path) -> None:
    reported(
        write_rows(
            tmp_path,
            [
                {**made_row(seed=seed), key: "a\nb\x1b[31m|<script>"}
                for seed, key in enumerate(REQUIRED)
            ],
        )
    )
    written = "".join(path.read_text() for path in (tmp_path / "report").rglob("*.*"))
    assert "\x1b" not in written
    assert "[31m|<script>" not in (tmp_path / "report" / "report.html").read_text()


@pytest.mark.parametrize(
    "shard",
    [
        "1/99999999999",
        "9" * 5000 + "/3",
        "3/1",
        "-1/3",
        "1/0",
        3,
        None,
        [[[]]],
        {"a": 1},
        "\u0661/\u0663",
        "1/999999999",
    ],
)
def test_a_shard_of_any_kind_costs_no_report(shard: object, tmp_path: Path) -> None:
    assert (
        reported(
            write_rows(tmp_path, [made_row()], {"experiment_digest": "x", "shard": shard})
        ).document["notes"]
        == []
    )


def test_of_many_missing_shards_some_are_named(tmp_path: Path) -> None:
    (note,) = gather(
        [write_rows(tmp_path, [made_row()], {"experiment_digest": "x", "shard": "1/2000"})]
    ).notes
    assert note.startswith("shard 2/2000, 3/2000, ")
    assert note.endswith(", 9/2000 and 1991 more of the experiment is not here")


@pytest.mark.parametrize(
    "key",
    [
        "experiment",
        "experiment_digest",
        "shard",
        "scenarios",
        "variants",
        "versions",
        "rows",
        "scenario",
    ],
)
@pytest.mark.parametrize(
    "value",
    [*STRANGE, None, {"name": 3}, {"name": "a\nb", "description": []}, {"sumo": []}, 10**18],
)
def test_a_manifest_of_anything_costs_no_report(key: str, value: object, tmp_path: Path) -> None:
    made = reported(write_rows(tmp_path, [made_row()], {key: value}))
    assert made.document["episodes"] == 1
    assert "\x1b" not in (tmp_path / "report" / "report.md").read_text()


NO_FILES: dict[str, Callable[[Path], Any]] = {
    "folder": Path.mkdir,
    "pipe": os.mkfifo,
    "loop": lambda path: path.symlink_to(path),
    "device": lambda path: path.symlink_to("/dev/zero"),
}


@pytest.mark.parametrize("kind", NO_FILES)
def test_what_is_no_file_is_a_note_and_nothing_waits_for_it(kind: str, tmp_path: Path) -> None:
    full, other = write_rows(tmp_path / "full", [made_row()]), tmp_path / "other"
    other.mkdir()
    NO_FILES[kind](other / ROWS)
    assert gather([other, full]).notes[0].startswith(f"{other}: {ROWS}: cannot be read: ")
    with pytest.raises(ConfigError, match="cannot be read"):
        gather([other])
    NO_FILES[kind](full / MANIFEST)
    assert gather([full]).notes == (f"{full}: {MANIFEST}: not a manifest, and left out",)
    (full / TRACES).mkdir()
    NO_FILES[kind](full / TRACES / f"{made_row()['key']}.npz")
    assert any(
        note.startswith(f"no replay of {made_row()['key']}: ")
        for note in reported(full).document["notes"]
    )


def test_a_line_without_an_end_is_not_read_into_memory(tmp_path: Path) -> None:
    folder = write_rows(tmp_path, [made_row()])
    with (folder / ROWS).open("ab") as file:
        file.write(
            b"[" * (3 * LONGEST_LINE) + b"\n" + (folder / ROWS).read_bytes().replace(b"--0", b"--1")
        )
    found = gather([folder])
    assert len(found.rows) == 2
    assert found.notes == (f"{folder}: {ROWS}: 1 of its lines is not a whole row, and left out",)


def test_a_trace_that_no_rule_forbids_costs_its_replay_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def strange(trace: object) -> str:
        raise ZeroDivisionError("float division by zero")

    monkeypatch.setattr("sumo_mcts.reporting.page.packed", strange)
    folder = write_rows(tmp_path, [made_row()])
    write_traces(folder, made_row()["key"])
    (note,) = reported(folder).document["notes"]
    assert note.endswith(f"{made_row()['key']}.npz: ZeroDivisionError: float division by zero")


def test_pairs_are_of_draws_that_were_thrown_away_equally_often(tmp_path: Path) -> None:
    row, twin = gather(
        [
            write_rows(
                tmp_path, [{**made_row(), "redrawn": 0}, {**made_row(variant="sumo"), "redrawn": 1}]
            )
        ]
    ).rows
    assert pairs([row], [twin]) == []
    assert len(pairs([row], [{**twin, "redrawn": 0}])) == 1
