"""Which traces are kept: against an obvious twin, in any order of the rows."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts.experiments.worth import HARDEST, Worth, is_worth

SCORES = st.one_of(st.none(), st.sampled_from([0.0, 0.5, 1.0, 2.0, 4.5]))


@st.composite
def rows(draw: st.DrawFn) -> list[dict[str, Any]]:
    """Rows of two variants, in some order, with many ties."""
    found = [
        {
            "key": f"{variant}-{k}", "scenario": "s", "variant": variant, "outcome": draw(st.sampled_from(["arrived", "arrived", "arrived", "collision"])),
            "failsafe_interventions": draw(st.sampled_from([0, 0, 0, 0, 1, None])), "imposed_max_decel_mps2": draw(SCORES), "min_ttc_s": draw(SCORES),
            "min_pet_s": draw(SCORES),
        }
        for variant in ("a", "b")
        for k in range(draw(st.integers(0, 25)))
    ]  # fmt: skip
    return draw(st.permutations(found))


def obvious(found: list[dict[str, Any]]) -> set[str]:
    """What went wrong, and the first few of each variant in each respect."""
    kept = {row["key"] for row in found if row["outcome"] != "arrived" or row["failsafe_interventions"]}
    for variant in ("a", "b"):
        of = [row for row in found if row["variant"] == variant]
        kept |= {row["key"] for row in sorted((r for r in of if r["imposed_max_decel_mps2"]), key=lambda r: (-r["imposed_max_decel_mps2"], r["key"]))[:HARDEST]}
        for name in ("min_ttc_s", "min_pet_s"):
            kept |= {row["key"] for row in sorted((r for r in of if r[name] is not None), key=lambda r, name=name: (r[name], r["key"]))[:HARDEST]}
    return kept


@given(rows(), st.data())
def test_what_is_kept_does_not_depend_on_the_order(found: list[dict[str, Any]], data: st.DataObject) -> None:
    worth, kept, flying = Worth("worth"), set(), []
    for row in found:
        flying.append((row, worth.bar("s", row["variant"])))  # the bar when its episode begins
        while flying and data.draw(st.booleans()):  # episodes end later, in any order
            ended, bar = flying.pop(data.draw(st.integers(0, len(flying) - 1)))
            kept |= {ended["key"]} if is_worth(ended, bar) else set()
            kept -= worth.add(ended)
    for ended, bar in flying:
        kept |= {ended["key"]} if is_worth(ended, bar) else set()
        kept -= worth.add(ended)
    assert kept == obvious(found)


@given(rows())
def test_all_and_none(found: list[dict[str, Any]]) -> None:
    for rule, wanted in (("all", True), ("none", False)):
        worth = Worth(rule)
        for row in found:
            assert is_worth(row, worth.bar("s", row["variant"])) is wanted
            assert worth.add(row) == (set() if wanted else {row["key"]})


def test_nobody_who_had_to_brake_is_no_score() -> None:
    row = {
        "key": "k", "scenario": "s", "variant": "a", "outcome": "arrived", "failsafe_interventions": 0, "imposed_max_decel_mps2": 0.0, "min_ttc_s": None,
        "min_pet_s": None,
    }  # fmt: skip
    assert not is_worth(row, Worth("worth").bar("s", "a"))
    assert is_worth({**row, "min_ttc_s": 2.9}, Worth("worth").bar("s", "a"))


@pytest.mark.parametrize("rule", ["worth", "all", "none"])
def test_an_unknown_row_is_judged(rule: str) -> None:
    nothing = {
        "key": "k", "scenario": "s", "variant": "a", "outcome": "error", "failsafe_interventions": None, "imposed_max_decel_mps2": None, "min_ttc_s": None,
        "min_pet_s": None,
    }  # fmt: skip
    worth = Worth(rule)
    assert is_worth(nothing, worth.bar("s", "a")) is (rule != "none")
    assert worth.add(nothing) == ({"k"} if rule == "none" else set())
