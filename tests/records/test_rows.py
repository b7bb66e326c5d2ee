"""Rows come back as they were written, and half-written lines are told from whole ones."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts import records
from sumo_mcts.records.measures import REQUIRED


def named(key: str, **known: Any) -> records.Row:
    """What makes a row whole, and what else is known."""
    return {"key": key, "scenario": "s", "variant": "v", "outcome": "arrived", **known}


@pytest.mark.parametrize("lacking", REQUIRED)
def test_a_line_that_does_not_say_which_episode_it_is_or_how_it_ended_is_no_row(
    tmp_path: Path, lacking: str
) -> None:
    for unknown in ({}, {lacking: None}, {lacking: 3}, {lacking: ""}):
        records.append_row(
            tmp_path,
            {**{key: value for key, value in named("a").items() if key != lacking}, **unknown},
        )
    assert records.read_rows(tmp_path) == []
    assert records.rows_and_torn(tmp_path)[1] == 4


def test_rows_have_every_key_in_order_and_no_nan(tmp_path: Path) -> None:
    records.append_row(
        tmp_path,
        {
            "key": "k",
            "min_ttc_s": float("nan"),
            "max_drac_mps2": np.float64("inf"),
            "seed": np.int64(3),
            "in_time": np.True_,
        },
    )
    row = json.loads((tmp_path / records.ROWS).read_text(), parse_constant=pytest.fail)
    assert tuple(row) == records.ROW_KEYS
    assert (
        row["min_ttc_s"],
        row["max_drac_mps2"],
        row["seed"],
        row["in_time"],
        row["outcome"],
    ) == (None, None, 3, True, None)


def test_a_row_is_completed_in_order() -> None:
    row = records.complete_row({"seed": np.int64(3), **named("k"), "redrawn": 2})
    assert tuple(row) == (*records.ROW_KEYS, "redrawn")
    assert (row["key"], row["seed"], row["min_ttc_s"]) == ("k", 3, None)
    assert type(row["seed"]) is int


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"min_tcc_s": 1.0}, "min_tcc_s is no key of a row"),
        ({"min_ttc_s": "near"}, "min_ttc_s has to be a number, got 'near'"),
        ({"collisions": 1.0}, "collisions has to be a whole number, got 1.0"),
        ({"at_fault": 1}, "at_fault has to be a true or false, got 1"),
    ],
)
def test_a_row_with_a_wrong_key_or_type_is_not_made(wrong: dict[str, Any], said: str) -> None:
    with pytest.raises(TypeError, match=said):
        records.complete_row(named("k", **wrong))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"min_ttc_s": -0.1}, r"min_ttc_s has to lie between 0 and 1e\+12, got -0.1"),
        ({"wall_s": 2e12}, r"wall_s has to lie between 0 and 1e\+12, got 2000000000000.0"),
        ({"collisions": -1}, r"collisions has to lie between 0 and 1e\+12, got -1"),
        ({"speeding_share": 1.01}, "speeding_share has to lie between 0 and 1, got 1.01"),
    ],
)
def test_a_row_that_a_report_would_refuse_is_not_made(wrong: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        records.complete_row(named("k", **wrong))


def test_the_bounds_themselves_make_a_row_and_what_is_not_finite_is_unknown() -> None:
    row = records.complete_row(
        named(
            "k", min_ttc_s=0.0, wall_s=1e12, speeding_share=1.0,
            min_pet_s=float("nan"), max_drac_mps2=np.float64("inf"),
        )
    )  # fmt: skip
    assert (row["min_ttc_s"], row["wall_s"], row["speeding_share"]) == (0.0, 1e12, 1.0)
    assert row["min_pet_s"] is None and row["max_drac_mps2"] is None


def test_a_row_after_a_torn_line_is_whole(tmp_path: Path) -> None:
    records.append_row(tmp_path, named("a"))
    with (tmp_path / records.ROWS).open("a") as file:
        file.write('{"key": "tor')
    records.append_row(tmp_path, named("b"))
    assert [row["key"] for row in records.read_rows(tmp_path)] == ["a", "b"]


def test_a_row_cut_within_a_letter_is_skipped(tmp_path: Path) -> None:
    with (tmp_path / records.ROWS).open("wb") as file:
        line = json.dumps(named("ä"), ensure_ascii=False)
        file.write(f'{line}\n{{"key": "ä'.encode()[:-1])
    assert [row["key"] for row in records.read_rows(tmp_path)] == ["ä"]


def test_line_breaks_of_other_alphabets_do_not_split_a_row(tmp_path: Path) -> None:
    records.append_row(tmp_path, named("a", error="one\u2028two\x85three\nfour"))
    assert [row["error"] for row in records.read_rows(tmp_path)] == ["one\u2028two\x85three\nfour"]


def test_csv_has_the_rows_of_the_jsonl(tmp_path: Path) -> None:
    records.append_row(
        tmp_path, named("a", at_fault=False, min_ttc_s=1.5, error='said "no", twice')
    )
    records.append_row(tmp_path, named("b", further=1))
    records.write_csv(tmp_path)
    with (tmp_path / records.TABLE).open(newline="", encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    assert list(table[0]) == [*records.ROW_KEYS, "further"]
    assert (
        table[0]["at_fault"],
        table[0]["min_ttc_s"],
        table[0]["error"],
        table[0]["planner"],
    ) == ("false", "1.5", 'said "no", twice', "")
    assert (table[1]["key"], table[1]["further"]) == ("b", "1")


def test_csv_without_rows_is_a_header(tmp_path: Path) -> None:
    records.write_csv(tmp_path)
    assert (tmp_path / records.TABLE).read_text() == ",".join(records.ROW_KEYS) + "\n"


def test_ordinary_keys_stay_readable() -> None:
    assert (
        records.episode_key("unprotected-left-turn", "mcts_1000.idm", 7)
        == "unprotected-left-turn--mcts_1000.idm--7"
    )
    assert records.episode_key("a", "b", 7, "veh.0") == "a--b--7--veh.0"
    assert records.episode_key("a", "b", None) != records.episode_key("a", "b", 0)


_NAMES = st.text(max_size=100) | st.text(alphabet="a-_./", max_size=4)


@given(
    a=st.tuples(_NAMES, _NAMES, st.integers(), st.none() | _NAMES),
    b=st.tuples(_NAMES, _NAMES, st.integers(), st.none() | _NAMES),
)
def test_keys_are_safe_and_tell_episodes_apart(
    a: tuple[str, str, int, str | None], b: tuple[str, str, int, str | None]
) -> None:
    key = records.episode_key(*a)
    assert (key == records.episode_key(*b)) == (a == b)
    assert len(key) <= 240
    assert key.isascii()
    assert not set(key) & set('/\\:*?"<>| \0')
    assert not key.startswith((".", "-"))
