"""The command article: figures, claims and table, made by one command."""

import json
from pathlib import Path

import pytest
from PIL import Image
from typer.testing import CliRunner

from sumo_mcts.cli import app
from sumo_mcts.commands import article
from sumo_mcts.commands.article import Measured
from sumo_mcts.experiments.experiment import load
from sumo_mcts.experiments.progress import Progress, before_the_first
from sumo_mcts.process.ending import INVALID
from sumo_mcts.records import versions
from sumo_mcts.studies.article import TABLE, Claim

LEFT = "unprotected-left-turn-scripted"


def test_the_table_is_that_of_the_built_in_experiments(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With another number of episodes, and nothing else."""
    told: list[Progress] = []
    driven = lambda *_, watch, **__: [watch(before_the_first("starting SUMO"))] and [{}]  # noqa: E731
    monkeypatch.setattr(article, "run_batch", driven)
    assert article.drive_table(tmp_path, 7, 1, (), told.append) == [{}, {}]
    assert [at.part for at in told] == ["table1-mcts, 1 of 2", "table1, 2 of 2"]
    for planner, name in article.EXPERIMENTS.items():
        ours = load(tmp_path / f"{name}.yaml")
        built_in = load(article.builtin.experiment_path(name))
        assert ours.experiment.seeds == tuple(range(7))
        assert ours.experiment.model_copy(update={"seeds": built_in.experiment.seeds}) == (
            built_in.experiment
        )
        names = {c.planner.name for case in ours.cases for c in case.configs.values()}
        assert names == {planner}
    assert set(TABLE) == {case.name for case in ours.cases}


def test_a_folder_with_another_number_of_episodes_stays_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(article, "run_batch", lambda *_, **__: [])
    article.drive_table(tmp_path, 1, 1, (), lambda _: None)
    held = {path: path.read_bytes() for path in tmp_path.iterdir()}
    article.check_held(tmp_path, 1)
    for change, says in (
        (lambda text: text, "holds --seeds 1; give the same --seeds, or another --out"),
        (lambda text: text.replace("0..0", "5"), "holds another table1-mcts.yaml; give"),
        (lambda text: "[", "table1-mcts.yaml: "),
    ):
        path = tmp_path / "table1-mcts.yaml"
        path.write_text(change(held[path].decode()))
        before = path.read_bytes()
        done = CliRunner().invoke(app, ["article", "--out", str(tmp_path), "--seeds", "2"])
        assert done.exit_code == INVALID
        assert says in done.stderr and len(done.stderr.splitlines()) == 1
        assert path.read_bytes() == before and set(tmp_path.iterdir()) == set(held)
        assert "driving" not in done.output


def test_cells_are_counted_by_scene_planner_and_iterations() -> None:
    rows = [
        {"scenario": LEFT, "planner": planner, "iterations_per_decision": n, "outcome": outcome,
         "in_time": outcome == "arrived", "collisions": int(outcome == "collision")}
        for planner, n, outcome in [
            ("mcts", 1000, "arrived"), ("mcts", 1000, "collision"), ("mcts", 3000, "arrived"),
            ("paper", 1000, "timeout"),
        ]
    ]  # fmt: skip
    found = article.measured(rows, {(LEFT, "mcts", 1000): (9, 10)})
    assert found.in_time == {
        (LEFT, "mcts", 1000): (1, 2), (LEFT, "mcts", 3000): (1, 1), (LEFT, "paper", 1000): (0, 1),
    }  # fmt: skip
    assert found.collisions[LEFT, "mcts", 1000] == (1, 2)
    lines = article.table(found).splitlines()
    assert len(lines) == 2 + sum(map(len, TABLE.values()))
    assert lines[2] == (
        f"| {LEFT} | 1000 | 52.00 % | 17.33 % | 90.0 % (9/10) | 50.0 % (1/2) | 50.0 % (1/2) "
        "| - | 0.0 % (0/1) | 0.0 % (0/1) |"
    )


def test_what_does_not_hold_is_said() -> None:
    claims = [Claim(2.0, "turns", True, "at 1 s"), Claim(None, "leaves", False, "stands")]
    assert article.claims_table(claims).splitlines()[2:] == [
        "| 2 s | turns | yes | at 1 s |",
        "| the end | leaves | no | stands |",
    ]
    page = article.page([], Measured({}, {}, {}))
    assert "| near-optimal, article |" in page
    for said in (f"sumo_mcts {versions()['sumo_mcts']}", "one and the same", "*Near-optimal*"):
        assert said in page


@pytest.mark.slow
def test_one_command_makes_it_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(article, "TABLE", {LEFT: {1000: TABLE[LEFT][1000]}})
    words = ["article", "--out", str(tmp_path), "--seeds", "1", "--states", "2", "--jobs", "1"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    for name in ("left-turn", "exit-cut-in"):
        with Image.open(tmp_path / f"{name}.png") as image:
            assert image.width > 1800
        assert "![" in (page := (tmp_path / "article.md").read_text()) and f"({name}.png)" in page
    assert page.count("| yes |") == 8 and "| no |" not in page
    assert "52.00 % | 17.33 % | 100.0 % (2/2) | 100.0 % (1/1) | 0.0 % (0/1) |" in page
    assert "driving exit-cut-in ..." in done.stderr and "2/2 episodes" not in done.stderr
    assert f"asking for decisions in {LEFT}, 1 of 1 ..." in done.stderr
    states = (tmp_path / "near-optimal" / LEFT / "regret.json").read_text()
    assert json.loads(states)["states"] == 2
    again = CliRunner().invoke(app, [*words, "--quiet"])
    assert (again.exit_code, again.stdout) == (0, "")
    assert (tmp_path / "article.md").read_text() == page
