"""Which traces are kept: against an obvious twin, in any order of the rows."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts.records.highlights import HARDEST, STUCK_S, TraceSelection, is_highlight, reasons
from sumo_mcts.reporting.highlights import choose_highlights

SCORES = st.one_of(st.none(), st.sampled_from([0.0, 0.5, 1.0, 2.0, 4.5]))

QUIET = {
    "key": "k", "scenario": "s", "variant": "a", "planner": "mcts", "seed": 1, "ego": None,
    "outcome": "arrived", "at_fault": None, "prediction": "idm",
    "failsafe_interventions": 0, "imposed_max_decel_mps2": 0.0, "min_ttc_s": None,
    "min_pet_s": None, "longest_stop_s": 0.0,
}  # fmt: skip


@st.composite
def rows(draw: st.DrawFn) -> list[dict[str, Any]]:
    """Rows of two variants, in some order, with many ties."""
    seeds, calm = (
        draw(st.permutations(range(25))),
        draw(st.booleans()),
    )  # calm: nothing happens to the second
    found = [
        {
            "key": f"{variant}-{k}", "scenario": "s", "variant": variant, "planner": "mcts",
            "seed": seeds[k], "ego": None, "at_fault": None,
            "prediction": "idm", "outcome": draw(st.sampled_from(["arrived", "arrived", "arrived",
            "arrived", "collision", "timeout"])),
            "failsafe_interventions": draw(st.sampled_from([0, 0, 0, 0, 1, None])),
            "imposed_max_decel_mps2": draw(SCORES), "min_ttc_s": draw(SCORES),
            "min_pet_s": draw(SCORES),
            "longest_stop_s": draw(st.sampled_from([None, 0.0, 29.9, 30.0, 45.0, 80.0])),
        }
        for variant in ("a", "b")
        for k in range(draw(st.integers(0, 25)))
    ]  # fmt: skip
    nothing = {
        key: QUIET[key]
        for key in (
            "outcome",
            "failsafe_interventions",
            "imposed_max_decel_mps2",
            "min_ttc_s",
            "min_pet_s",
            "longest_stop_s",
        )
    }
    return draw(
        st.permutations(
            [{**row, **nothing} if calm and row["variant"] == "b" else row for row in found]
        )
    )


def obvious(found: list[dict[str, Any]]) -> set[str]:
    """What went wrong, and the first few of each variant in each respect, a collision being no
    close call; or its first episode."""
    kept = {
        row["key"] for row in found if row["outcome"] != "arrived" or row["failsafe_interventions"]
    }
    for variant in ("a", "b"):
        of = [row for row in found if row["variant"] == variant]
        kept |= {
            row["key"]
            for row in sorted(
                (r for r in of if r["imposed_max_decel_mps2"]),
                key=lambda r: (-r["imposed_max_decel_mps2"], r["key"]),
            )[:HARDEST]
        }
        stood = [
            row for row in of if (row["longest_stop_s"] or 0) >= 30 and row["outcome"] != "timeout"
        ]
        kept |= {
            row["key"]
            for row in sorted(stood, key=lambda r: (-r["longest_stop_s"], r["key"]))[:HARDEST]
        }
        for name in ("min_ttc_s", "min_pet_s"):
            close = [row for row in of if row[name] is not None and row["outcome"] != "collision"]
            kept |= {
                row["key"]
                for row in sorted(close, key=lambda r, name=name: (r[name], r["key"]))[:HARDEST]
            }
        if of and not kept & {row["key"] for row in of}:
            kept.add(min(of, key=lambda row: row["seed"])["key"])
    return kept


@pytest.mark.slow
@given(rows(), st.data())
def test_what_is_kept_does_not_depend_on_the_order(
    found: list[dict[str, Any]], data: st.DataObject
) -> None:
    worth, kept, flying = TraceSelection("worth"), set(), []
    for row in found:
        flying.append((row, worth.bar("s", row["variant"])))  # the bar when its episode begins
        while flying and data.draw(st.booleans()):  # episodes end later, in any order
            ended, bar = flying.pop(data.draw(st.integers(0, len(flying) - 1)))
            kept |= {ended["key"]} if is_highlight(ended, bar) else set()
            kept -= worth.add(ended)
    for ended, bar in flying:
        kept |= {ended["key"]} if is_highlight(ended, bar) else set()
        kept -= worth.add(ended)
    assert kept == obvious(found)


@pytest.mark.slow
@given(rows())
def test_what_a_report_shows_has_been_kept(found: list[dict[str, Any]]) -> None:
    worth, kept = TraceSelection("worth"), set()
    for row in found:
        kept |= {row["key"]} if is_highlight(row, worth.bar("s", row["variant"])) else set()
        kept -= worth.add(row)
    looks, of = choose_highlights(found, 1000)
    assert {look.row["key"] for look in looks} <= kept
    assert len(looks) == of
    assert {look.row["variant"] for look in looks} == {row["variant"] for row in found}


def test_twins_are_not_shown_and_not_kept() -> None:
    twin = {**QUIET, "planner": "sumo", "outcome": "collision", "min_ttc_s": 0.1}
    for rule, wanted in (("worth", False), ("all", True), ("none", False)):
        worth = TraceSelection(rule)
        assert is_highlight(twin, worth.bar("s", "a")) is wanted
        assert worth.add(twin) == (set() if wanted else {"k"})


@pytest.mark.slow
@given(rows())
def test_all_and_none(found: list[dict[str, Any]]) -> None:
    for rule, wanted in (("all", True), ("none", False)):
        worth = TraceSelection(rule)
        for row in found:
            assert is_highlight(row, worth.bar("s", row["variant"])) is wanted
            assert worth.add(row) == (set() if wanted else {row["key"]})


def test_nobody_who_had_to_brake_is_no_hard_moment() -> None:
    worth = TraceSelection("worth")
    assert worth.add({**QUIET, "key": "first", "seed": 0}) == set()
    assert not is_highlight(QUIET, worth.bar("s", "a"))
    close = {**QUIET, "min_ttc_s": 2.9}
    assert is_highlight(close, worth.bar("s", "a"))
    assert worth.add(close) == {"first"}


@pytest.mark.parametrize("rule", ["worth", "all", "none"])
def test_an_unknown_row_is_judged(rule: str) -> None:
    nothing = {
        **QUIET,
        "outcome": "error",
        "failsafe_interventions": None,
        "imposed_max_decel_mps2": None,
    }
    worth = TraceSelection(rule)
    assert is_highlight(nothing, worth.bar("s", "a")) is (rule != "none")
    assert worth.add(nothing) == ({"k"} if rule == "none" else set())


def stuck(row: dict[str, Any], twin: dict[str, Any] | None) -> bool:
    return any(each.kind == 1 for each in reasons(row, twin))


def test_stuck_is_an_ego_whose_time_was_up_or_that_stood_far_longer_than_its_twin() -> None:
    twin = {**QUIET, "planner": "sumo", "longest_stop_s": 40.0}
    stood = {**QUIET, "longest_stop_s": 40.0 + STUCK_S}
    assert stuck(stood, twin)
    assert not stuck({**stood, "longest_stop_s": 69.9}, twin)  # as at a red light
    for unknown in (None, {**twin, "longest_stop_s": None}):
        assert not stuck(stood, unknown)
    for waited in (0.0, None):
        assert stuck({**QUIET, "outcome": "timeout", "longest_stop_s": waited}, twin)
    assert not stuck({**stood, "longest_stop_s": None}, twin)


def test_a_row_from_before_these_keys_is_judged() -> None:
    """A batch that an older version began goes on."""
    old = {key: value for key, value in QUIET.items() if key != "longest_stop_s"}
    assert reasons(old, {**old, "planner": "sumo"}) == []
    assert [each.words for each in reasons({**old, "outcome": "timeout"})] == ["timeout"]
    assert TraceSelection("worth").add(old) == set()
