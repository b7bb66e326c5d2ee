"""The changes that `make mutants` makes: which they are, and that a run tells killed from
survived."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from mutants.__main__ import PARTS, _paths, equivalents, sampled
from mutants.changes import TOP, Mutant, codes, compiled, mutants


def changed(path: str, function: str) -> set[str]:
    return {each.change for each in mutants(path) if each.function == function}


def test_numbers_comparisons_arithmetic_and_terms_are_changed() -> None:
    headway = changed("model/interaction.py", "_headway")
    assert {
        "gap >= wish -> gap < wish",
        "c.headway * missing * missing -> c.headway * missing",
        "c.headway * missing -> missing",
        "c.headway_gap_m + c.headway_s * v -> c.headway_s * v",
        "c.headway_gap_m + c.headway_s * v -> c.headway_gap_m - c.headway_s * v",
        "max(gap, 0.0) -> min(gap, 0.0)",
        "1.0 -> 2.0",
    } <= headway
    assert "tree.visits[node] -> tree.visits[0]" in changed("planners/paper_search.py", "bound")
    assert "rate += c.blocking -> pass" in changed("model/cost.py", "step_passability")


@pytest.mark.parametrize("path", ["model/gaps.py", "planners/paper_search.py", "world/command.py"])
def test_every_change_has_a_name_of_its_own_and_changes_the_code(path: str) -> None:
    every = mutants(path)
    assert len({each.key for each in every}) == len(every) and every == mutants(path)
    for each in every[::25]:
        usual = codes(compiled(each._replace(order=-1)))
        module = codes(compiled(each))
        place = each.function, each.first
        assert each.function == "" or module[place] != usual[place]


def test_the_same_seed_draws_the_same_changes() -> None:
    every = mutants("model/cost.py")
    assert sampled(every, 20, 1) == sampled(every, 20, 1) != sampled(every, 20, 2)
    assert len(sampled(every, 20, 1)) == 20 and sampled(every, 0, 1) == every


def test_what_is_listed_as_equivalent_is_a_change_and_has_its_reason() -> None:
    listed = equivalents()
    there = {each.key for path in {key.split("::")[0] for key in listed} for each in mutants(path)}
    assert set(listed) <= there and all(len(why) > 20 for why in listed.values())


def test_every_part_has_its_modules() -> None:
    assert all(_paths(part) for part in PARTS)


@pytest.mark.slow
def test_a_run_tells_what_was_noticed(tmp_path: Path) -> None:
    """By the tests of `bounded` alone, which know nothing of the commander around it."""
    run = subprocess.run(
        [sys.executable, "-m", "mutants", "world/command.py", "--count", "20", "--tests",
         "tests/world/test_command.py", "--out", str(tmp_path)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(TOP / "tests"), *sys.path])},
        cwd=TOP, capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    asked = sampled(mutants("world/command.py"), 20, 1)
    told = [line.split(maxsplit=1)[1] for line in run.stdout.splitlines() if "/20 " in line]

    def killed(each: Mutant) -> bool:
        place = f" world/command.py:{each.line} {each.change} ["
        (line,) = (line for line in told if place in line)
        return line.startswith("killed ")

    verdicts = [(each.function == "bounded", killed(each)) for each in asked]
    assert verdicts.count((False, False)) == sum(not own for own, _ in verdicts)
    assert verdicts.count((True, True)) >= 0.7 * sum(own for own, _ in verdicts) > 0
    assert run.returncode == 1 and "(wanted: 95 %)" in run.stdout and not run.stderr
