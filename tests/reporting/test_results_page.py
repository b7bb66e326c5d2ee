"""A page of results: what stands between its marks is made anew, everything else stays."""

import json
import os
from pathlib import Path
from typing import Any

import pytest
from helpers_rows import made_row, made_rows, write_rows
from typer.testing import CliRunner

from sumo_mcts.cli import app
from sumo_mcts.records import MANIFEST, MANIFESTS, ROWS
from sumo_mcts.reporting.results_page import END, Block, blocks

STUDY = f"<!-- results: table study -->\nold\n{END}\n"
BATCH = {
    "experiment": {"name": "trial", "description": "Two scenes, <!-- results: table study -->"},
    "command": ["sumo-mcts", "batch", "my trial.yaml", "--out", "out/trial"],
    "versions": {"sumo_mcts": "0.1.0", "sources": "abcd", "sumo": "1.28.0"},
}


def written(*words: object) -> str:
    """What `sumo-mcts report` prints."""
    result = CliRunner().invoke(app, ["report", *map(str, words)])
    assert result.exit_code == 0, result.stderr
    return result.stdout


def error_of(*words: object) -> str:
    """The one line of an error."""
    result = CliRunner().invoke(app, ["report", *map(str, words), "--quiet"])
    assert (result.exit_code, result.stdout) == (2, "")
    (line,) = result.stderr.splitlines()
    return line.removeprefix("error: ")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A batch of two scenes."""
    return write_rows(tmp_path / "batch", made_rows(6), BATCH)


@pytest.fixture
def page(tmp_path: Path) -> Path:
    """A page with one table."""
    path = tmp_path / "results.md"
    path.write_text(f"# Mine\n\n{STUDY}\nRead by hand.\n")
    return path


# --- what is written ---


def test_the_same_folder_gives_the_same_bytes_and_the_rest_stays(tmp_path: Path) -> None:
    path = tmp_path / "results.md"
    folder = write_rows(tmp_path / "batch", made_rows(6), BATCH)
    before, after = b"\xef\xbb\xbf# Mine \r\n\x0b\n\xe2\x80\xa8 kept\t\n", b"\n  kept, no end"
    path.write_bytes(before + STUDY.encode() + after)
    written(folder, "--results", path)
    once = path.read_bytes()
    assert once.startswith(before + b"<!-- results: table study -->\n")
    assert once.endswith(f"{END}\n".encode() + after)
    assert b"old" not in once and b"| left | mcts-idm-100 | 4/6 " in once
    written(folder, "--results", path)
    assert path.read_bytes() == once


def test_lines_end_as_their_mark_does(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "results.md"
    path.write_bytes(f"a\r\n{STUDY}b\n".replace("\n", "\r\n").encode())
    written(folder, "--results", path)
    assert path.read_bytes().count(b"\n") == path.read_bytes().count(b"\r\n") > 10


def test_a_new_page_has_title_description_and_every_table_and_stays(
    folder: Path, tmp_path: Path
) -> None:
    path = tmp_path / "new" / "results.md"
    written(folder, "--results", path)
    text = path.read_text()
    assert text.startswith("# trial\n\nTwo scenes, &lt;!-- results: table study -->\n\n## Study\n")
    assert [block.asked for block in blocks(text, "")] == [
        f"table {name}"
        for name in (
            "study", "outcomes", "overall", "twin", "others", "comfort", "rules", "planning",
            "variants",
        )
    ]  # fmt: skip
    written(folder, "--results", path)
    assert path.read_text() == text


def test_each_block_tells_where_its_numbers_come_from(folder: Path, page: Path) -> None:
    written(folder, "--results", page)
    assert (
        "\n\n    sumo-mcts batch 'my trial.yaml' --out out/trial\n\n"
        "48 episodes, seeds 0..5; sumo_mcts 0.1.0, sources abcd, SUMO 1.28.0.\n\n"
    ) in page.read_text()


def test_seeds_are_told_apart_where_scenarios_have_others(tmp_path: Path, page: Path) -> None:
    rows = [
        made_row(scene, seed=seed)
        for scene, seeds in (("left", (0, 1, 2, 7)), ("exit", (3,)), ("bend", (3,)))
        for seed in seeds
    ]
    rows.append({**made_row("net"), "seed": None})
    written(write_rows(tmp_path / "a", rows), "--results", page)
    assert (
        "The command is not recorded.\n\n7 episodes, seeds 3 (bend, exit); 0..2, 7 (left); of SUMO "
        "itself (net); versions unknown.\n"
    ) in page.read_text()


def test_the_commands_of_single_runs_are_those_of_their_episodes(
    tmp_path: Path, page: Path
) -> None:
    folder = write_rows(
        tmp_path / "runs",
        [made_row(seed=seed) for seed in range(12)],
        {"scenario": {"name": "left"}, "command": ["sumo-mcts", "run", "left", "--seed", "11"]},
    )
    (folder / MANIFESTS).mkdir()
    for seed in range(12):
        told = {"command": ["sumo-mcts", "run", "left", "--seed", str(seed)]}
        (folder / MANIFESTS / f"{made_row(seed=seed)['key']}.json").write_text(json.dumps(told))
    written(folder, "--results", page)
    text = page.read_text()
    assert text.count("    sumo-mcts run left --seed ") == 8
    assert "--seed 7\n    # and 4 more\n" in text


def test_two_folders_are_one_study(tmp_path: Path, page: Path) -> None:
    folders = [
        write_rows(
            tmp_path / name,
            [made_row(seed=seed)],
            {**BATCH, "command": ["sumo-mcts", "batch", name]},
        )
        for seed, name in enumerate("ab")
    ]
    written(*folders, "--results", page)
    text = page.read_text()
    assert "    sumo-mcts batch a\n    sumo-mcts batch b\n\n2 episodes, seeds 0..1;" in text
    assert "| left | mcts-idm-100 | 2/2 " in text


def test_what_is_missing_stands_in_the_block(tmp_path: Path, page: Path) -> None:
    folder = write_rows(tmp_path / "a", [made_row()], {**BATCH, "rows": 3})
    with (folder / ROWS).open("a") as file:
        file.write('{"key": "torn')
    told = written(folder, "--results", page)
    for note in ("1 of its lines is not a whole row", "1 of the 3 rows of its batch are there"):
        assert f"note: {folder}: " in told and note in told
        assert f"{note}" in page.read_text().split(END)[0]


def test_a_table_without_rows_says_so(tmp_path: Path, page: Path) -> None:
    folder = write_rows(tmp_path / "a", [made_row(variant="sumo")], BATCH)
    written(folder, "--results", page)
    assert "-->\n\nNone of these episodes belongs in this table.\n\n    sumo-" in page.read_text()


def test_only_the_page_is_written(folder: Path, page: Path) -> None:
    written(folder, "--results", page)
    assert sorted(path.name for path in folder.iterdir()) == [ROWS, MANIFEST]


def test_a_link_stays_a_link_and_permissions_stay(folder: Path, page: Path, tmp_path: Path) -> None:
    link = tmp_path / "link.md"
    link.symlink_to(page.name)
    page.chmod(0o660)
    written(folder, "--results", link)
    assert link.is_symlink() and "| left |" in page.read_text()
    assert page.stat().st_mode & 0o777 == 0o660


def test_json_names_the_blocks(folder: Path, page: Path) -> None:
    told = json.loads(written(folder, "--results", page, "--json"))
    assert (told["page"], told["blocks"], told["episodes"]) == (str(page), ["table study"], 48)


@pytest.mark.parametrize("command", [None, 3, [], ["sumo-mcts", 3], ["sumo-mcts", "a\n\x1b[31m"]])
def test_a_command_of_any_kind_costs_no_page(command: Any, tmp_path: Path, page: Path) -> None:
    written(
        write_rows(tmp_path / "a", [made_row()], {**BATCH, "command": command}), "--results", page
    )
    assert "\x1b" not in page.read_text()
    assert "is not recorded" in page.read_text() or r"a\n\x1b[31m" in page.read_text()


# --- what is refused ---

KNOWN = (
    "there are: table study, table outcomes, table overall, table twin, table others, table "
    "comfort, table rules, table planning, table variants"
)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("# Mine\n", f"no <!-- results: table NAME --> ... {END} in it; {KNOWN}"),
        ("", f"no <!-- results: table NAME --> ... {END} in it; {KNOWN}"),
        (
            "a\n<!-- results: table outcome -->\n" + END,
            f"line 2: results: 'table outcome' is unknown; table outcomes?; {KNOWN}",
        ),
        ("<!-- results: table study -->\n", f"line 1: <!-- results: table study --> without {END}"),
        (
            f"<!-- results: table twin -->\n\n{STUDY}",
            f"line 1: <!-- results: table twin --> without {END}",
        ),
        (f"{STUDY}\n{END}\n", f"line 5: {END} without a mark that begins"),
        (b"\xff\xfe", "is not text in UTF-8"),
    ],
)
def test_a_page_that_cannot_be_made_anew_is_left_alone(
    text: str | bytes, error: str, folder: Path, tmp_path: Path
) -> None:
    path = tmp_path / "results.md"
    content = text if isinstance(text, bytes) else text.encode()
    path.write_bytes(content)
    assert error_of(folder, "--results", path) == (f"{path}: {error}")
    assert path.read_bytes() == content


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write it")
def test_a_page_without_permission_is_left_alone(folder: Path, page: Path) -> None:
    page.chmod(0o444)
    before = page.read_bytes()
    assert error_of(folder, "--results", page) == f"{page}: cannot be written"
    assert page.read_bytes() == before


def test_a_page_that_os_says_cannot_be_written_is_left_alone(
    folder: Path, page: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same for root, who may write everything."""
    before, real = page.read_bytes(), os.access
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.W_OK and real(path, mode))
    assert error_of(folder, "--results", page) == f"{page}: cannot be written"
    assert page.read_bytes() == before


def test_a_folder_is_no_page(folder: Path) -> None:
    assert error_of(folder, "--results", folder) == f"{folder}: a folder, not a file"


def test_without_an_episode_the_page_stays(tmp_path: Path, page: Path) -> None:
    before = page.read_bytes()
    assert "no episode in it" in error_of(write_rows(tmp_path / "a", []), "--results", page)
    assert page.read_bytes() == before
    assert "no episode in it" in error_of(tmp_path / "a", "--results", tmp_path / "new.md")
    assert not (tmp_path / "new.md").exists()


def test_a_report_goes_elsewhere(folder: Path, page: Path) -> None:
    assert error_of(folder, "--results", page, "--out", folder) == (
        f"--out {folder}: with --results only the page is written; leave one out"
    )


# --- marks ---


def test_marks_stand_alone_in_their_lines() -> None:
    text = f"    <!-- results: table a -->\n| {END} |\n<!--results:table a-->\t\n{END} \nx"
    assert blocks(text, "p") == [Block("table a", "", 2, 3)]


def test_a_block_of_another_experiment_stays(tmp_path: Path, page: Path) -> None:
    """Two experiments on one page, made anew one at a time, both at once, and none of the two."""
    folders = [
        write_rows(
            tmp_path / name,
            [made_row(name, seed=seed)],
            {"experiment": {"name": name}, "command": ["sumo-mcts", "batch", name]},
        )
        for seed, name in enumerate(("left of it", "exit", "other"))
    ]
    of_left, of_exit = (
        f"<!-- results: table study of {name} -->\nold\n{END}\n" for name in ("left of it", "exit")
    )
    page.write_text(f"{of_left}between\n{of_exit}")
    told = written(folders[1], folders[2], "--results", page)
    assert told.startswith("table study of exit\nas it was: table study of left of it\n")
    text = page.read_text()
    assert text.startswith(f"{of_left}between\n") and "batch exit\n\n1 episode, seeds 1;" in text
    assert "other" not in text
    written(folders[0], "--results", page)
    one_by_one = page.read_text()
    assert one_by_one.endswith(text.split("between")[1]) and "| left of it | mcts" in one_by_one
    written(*folders, "--results", page)
    assert page.read_text() == one_by_one
    assert error_of(folders[2], "--results", page) == (
        f"{page}: its tables are of left of it, exit, of which no folder is given"
    )


def test_every_block_is_made_anew(folder: Path, page: Path) -> None:
    twin = STUDY.replace("study", "twin")
    page.write_text(f"{STUDY}-\n{twin}{STUDY}".removesuffix("\n"))
    written(folder, "--results", page)
    first, second = page.read_text().split("\n-\n")
    assert "\nold\n" not in second and second.endswith(f"\n{first}")
    assert "| Arrived where the twin did |" in second.split(END)[0]
