"""What folders hold, and what is said where they are broken."""

import json
from pathlib import Path

import pytest
from helpers_rows import crashed, made_row, made_rows, write_rows, write_traces

from sumo_mcts.errors import ConfigError
from sumo_mcts.records import MANIFEST, ROW_KEYS, ROWS
from sumo_mcts.reporting.results import gather


def test_of_the_same_key_the_last_counts(tmp_path: Path) -> None:
    first = write_rows(
        tmp_path / "a", [made_row(seed=1), made_row(seed=2), crashed(made_row(seed=1))]
    )
    second = write_rows(tmp_path / "b", [made_row(seed=3), crashed(made_row(seed=2))])
    write_traces(first, made_row(seed=1)["key"], made_row(seed=2)["key"])
    found = gather([first, second])
    assert [(row["seed"], row["outcome"]) for row in found.rows] == [
        (1, "collision"),
        (2, "collision"),
        (3, "arrived"),
    ]
    assert list(found.traces) == [made_row(seed=1)["key"]], (
        "the trace of a row that another folder replaced is not its trace"
    )
    assert found.notes == ()


def test_folders_that_do_not_belong_together_are_told(tmp_path: Path) -> None:
    first = [
        made_row(seed=1, config_digest="a"),
        made_row(seed=2, config_digest="a"),
        made_row(seed=3),
    ]
    second = [
        made_row(seed=1, config_digest="a"),
        made_row(seed=2, config_digest="b"),
        made_row(seed=3, config_digest="b"),
    ]
    versions = [
        {"sumo_mcts": "1.0", "sumo": "1.25", "platform": "x"},
        {"sumo_mcts": "1.0", "sumo": "1.26", "platform": "y"},
    ]
    folders = [
        write_rows(tmp_path / name, rows, {"versions": told})
        for name, rows, told in zip("ab", (first, second), versions, strict=True)
    ]
    assert gather(folders).notes == (
        (
            f"{tmp_path / 'b'}: 1 of its episodes replace those of the same key that were driven with "
            "other settings"
        ),
        "the folders were written with different versions of sumo: 1.25, 1.26",
    )
    assert gather(folders[:1]).notes == ()


def test_a_part_of_an_experiment_is_told_from_the_whole(tmp_path: Path) -> None:
    def part(number: int, rows: int) -> Path:
        manifest = {"experiment_digest": "x", "shard": f"{number}/3", "rows": 2}
        return write_rows(
            tmp_path / str(number), [made_row(seed=10 * number + k) for k in range(rows)], manifest
        )

    one, two, three = part(1, 2), part(2, 1), part(3, 2)
    torn = f"{two}: 1 of the 2 rows of its batch are there; the command that began it goes on"
    assert gather([one]).notes == ("shard 2/3, 3/3 of the experiment is not here",)
    assert gather([one, two]).notes == (torn, "shard 3/3 of the experiment is not here")
    assert gather([one, two, three]).notes == (torn,)


def test_the_order_is_the_experiments(tmp_path: Path) -> None:
    manifest = {
        "experiment": {"name": "trial", "description": "Of order."},
        "scenarios": {"exit": {}, "left": {}},
        "variants": {"idm": {}, "mcts-idm-1000": {}},
    }
    found = gather([write_rows(tmp_path, reversed(made_rows(2)), manifest)])
    assert list(dict.fromkeys(row["scenario"] for row in found.rows)) == ["exit", "left"]
    assert list(dict.fromkeys(row["variant"] for row in found.rows)) == [
        "idm",
        "mcts-idm-1000",
        "mcts-idm-100",
        "sumo",
    ]
    assert (found.name, found.description) == ("trial", "Of order.")


def test_without_an_experiment_planners_have_an_order_and_numbers_count_as_numbers(
    tmp_path: Path,
) -> None:
    found = gather([write_rows(tmp_path / "mine", reversed(made_rows(2)))])
    assert list(dict.fromkeys(row["variant"] for row in found.rows)) == [
        "mcts-idm-100",
        "mcts-idm-1000",
        "idm",
        "sumo",
    ]
    assert found.name == "mine"


def test_a_run_is_called_by_its_scenario(tmp_path: Path) -> None:
    manifest = {"scenario": {"name": "left", "description": "Turn left."}}
    assert gather([write_rows(tmp_path / "a", [made_row()], manifest)])[:2] == (
        "left",
        "Turn left.",
    )
    assert gather([write_rows(tmp_path / "b", [made_row(), made_row("exit")], manifest)])[:2] == (
        "b",
        "",
    )


def test_torn_lines_and_foreign_values_are_told(tmp_path: Path) -> None:
    folder = write_rows(
        tmp_path,
        [
            made_row(seed=1),
            {**made_row(seed=2), "min_ttc_s": "near", "at_fault": 1, "rms_jerk_mps3": float("nan")},
            {"key": "alone"},
        ],
    )
    with (folder / ROWS).open("a") as file:
        file.write('[1, 2]\n{"key": "left--mcts--4", "scen')
    found = gather([folder])
    assert len(found.rows) == 2
    assert [found.rows[1][key] for key in ("min_ttc_s", "at_fault", "rms_jerk_mps3")] == [
        None,
        None,
        None,
    ]
    assert found.notes == (
        f"{folder}: {ROWS}: 3 of its lines are not a whole row, and left out",
        (
            f"{folder}: {ROWS}: values that their keys do not allow are left out: at_fault, "
            "rms_jerk_mps3, min_ttc_s"
        ),
    )


def test_numbers_beyond_all_bounds_are_unknown_and_lines_that_cannot_be_read_are_left_out(
    tmp_path: Path,
) -> None:
    folder = write_rows(tmp_path, [made_row(seed=seed) for seed in range(4)])
    lines = (folder / ROWS).read_text().splitlines()
    lines[1] = (
        lines[1]
        .replace('"cycles": 40', f'"cycles": {"9" * 400}')
        .replace('"rms_jerk_mps3": 1.1', '"rms_jerk_mps3": 1e400')
    )
    lines[2] = lines[2].replace('"cycles": 40', f'"cycles": {"9" * 5000}')
    lines[3] = lines[3].replace('"cycles": 40', f'"cycles": {"[" * 200_000}')
    (folder / ROWS).write_text("\n".join(lines))
    found = gather([folder])
    assert [(row["cycles"], row["rms_jerk_mps3"]) for row in found.rows] == [
        (40, 1.0),
        (None, None),
    ]
    assert found.notes == (
        f"{folder}: {ROWS}: 2 of its lines are not a whole row, and left out",
        (
            f"{folder}: {ROWS}: values that their keys do not allow are left out: rms_jerk_mps3, "
            "cycles"
        ),
    )


def test_rows_of_another_version_are_told_and_filled(tmp_path: Path) -> None:
    old = {
        key: value
        for key, value in made_row().items()
        if key not in ("min_pet_s", "decision_flips")
    }
    found = gather([write_rows(tmp_path, [old, made_row(seed=1)])])
    assert set(found.rows[0]) == set(ROW_KEYS)
    assert found.notes == (
        (
            f"{tmp_path}: {ROWS}: up to 1 of 2 rows are of another version, without decision_flips, "
            "min_pet_s"
        ),
    )


@pytest.mark.parametrize("text", ["{", "[]", "\udcff", "[" * 200_000, '{"a": ' + "9" * 5000 + "}"])
def test_a_broken_manifest_is_told(text: str, tmp_path: Path) -> None:
    (write_rows(tmp_path, [made_row()]) / MANIFEST).write_bytes(
        text.encode(errors="surrogateescape")
    )
    assert gather([tmp_path]).notes == (f"{tmp_path}: {MANIFEST}: not a manifest, and left out",)


@pytest.mark.parametrize(
    "manifest", [{"experiment": 3, "versions": [], "scenarios": []}, {"experiment": {"name": 1}}]
)
def test_a_strange_manifest_does_no_harm(manifest: object, tmp_path: Path) -> None:
    found = gather([write_rows(tmp_path / "mine", [made_row()], manifest)])
    assert (found.name, found.versions) == ("mine", {})


def test_an_empty_folder_beside_a_full_one_is_a_note(tmp_path: Path) -> None:
    full, empty = write_rows(tmp_path / "full", [made_row()]), tmp_path / "empty"
    empty.mkdir()
    assert gather([empty, full]).notes == (
        (
            f"{empty}: {ROWS}: no such file; `sumo-mcts run` and `sumo-mcts batch` write one with "
            "--out"
        ),
    )


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, f"{ROWS}: no such file"),
        ("", f"{ROWS}: no episode in it"),
        ('{"key": "x"}\n', f"{ROWS}: 1 of its lines is not a whole row, and left out"),
    ],
)
def test_nothing_to_report_is_wrong_input(content: str | None, said: str, tmp_path: Path) -> None:
    if content is not None:
        (tmp_path / ROWS).write_text(content)
    with pytest.raises(ConfigError, match=said):
        gather([tmp_path])


def test_no_folder_is_wrong_input(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="nowhere: no such folder"):
        gather([write_rows(tmp_path, [made_row()]), tmp_path / "nowhere"])


def test_several_twins_are_told(tmp_path: Path) -> None:
    rows = [
        made_row(variant="sumo"),
        {**made_row(variant="sumo"), "variant": "sumo-late", "key": "left--sumo-late--0"},
    ]
    assert "1 episodes have several twins" in gather([write_rows(tmp_path, rows)]).notes[0]
    assert json.loads((tmp_path / ROWS).read_text().splitlines()[1])["variant"] == "sumo-late"
