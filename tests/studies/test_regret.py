"""Regret: the judgement by hand, the panel on scenes made by hand, and the command in small
episodes."""

import json
from pathlib import Path

import numpy as np
import pytest
from helpers import Agent
from helpers_model import scenario, situation_of, task_of
from helpers_tree import TOYS, Toy, on_three_lanes
from test_bad_input import FILES
from typer.testing import CliRunner

from sumo_mcts.cli import app
from sumo_mcts.errors import ConfigError
from sumo_mcts.planners.paper_optimum import Own
from sumo_mcts.planners.reference import NEWEST, digest, problem_of, root_lines
from sumo_mcts.planners.reference_solver import Solution, best_root, solve
from sumo_mcts.studies import regret
from sumo_mcts.studies.regret import (
    Asked,
    Panel,
    Row,
    both_budgets,
    check,
    convergence,
    judged,
    judged_by_own,
    ranking,
    sequences,
    yardstick,
)

SCALE = 0.8
SHORT = ("--set", "episode.time_limit_s=4", "--every", "4")


def solution(*values: float, collides: tuple[int, ...] = ()) -> Solution:
    return Solution(
        np.array(values), np.isin(np.arange(len(values)), collides), np.zeros((len(values), 3)), 0
    )


def verdict(found: Solution, roots: int, i: int) -> Row:
    return judged(yardstick(found, roots, SCALE), found, i)


# --- by hand ---


def test_regret_is_what_is_lost_against_the_best_action_in_units_of_the_scale() -> None:
    row = verdict(solution(3.0, 5.0, 11.0, 3.4), 3, 3)
    assert (row["regret"], row["optimum"], row["spread"]) == (
        pytest.approx(0.5),
        pytest.approx(3.75),
        pytest.approx(10.0),
    )


@pytest.mark.parametrize(
    ("worst", "chosen", "near"),
    [
        (11.0, 3.39, True),
        (11.0, 3.41, False),
        (3.7, 3.079, True),
        (3.7, 3.081, False),
        (3.9, 3.046, False),
    ],
)
def test_near_optimal_is_a_twentieth_of_the_spread_or_a_tenth_of_the_scale_where_the_spread_is_small(
    worst: float, chosen: float, near: bool
) -> None:
    assert verdict(solution(3.0, worst, chosen), 2, 2)["near_optimal"] == near


def test_a_collision_that_could_be_avoided_is_never_near_optimal() -> None:
    row = verdict(solution(70.0, 90.0, 69.0, 71.0, collides=(2, 3)), 2, 2)
    assert (row["collides"], row["near_optimal"], row["contested"]) == (True, False, True)
    assert row["regret"] < 0.0


def test_a_collision_that_cannot_be_avoided_may_be() -> None:
    row = verdict(solution(60.0, 65.0, 60.0, collides=(0, 1, 2)), 2, 2)
    assert (
        row["collides"],
        row["avoidable"],
        row["near_optimal"],
        row["contested"],
        row["spread"],
    ) == (False, False, True, True, 0.0)


def test_the_spread_and_the_optimum_are_of_what_does_not_collide() -> None:
    here = yardstick(solution(2.0, 5.0, 8.0, 60.0, collides=(0, 3)), 4, SCALE)
    assert (here.optimum, here.spread, here.avoidable, here.contested) == (5.0, 3.0, True, True)


@pytest.mark.parametrize(
    ("values", "collides", "contested"),
    [((1.0, 1.7), (), False), ((1.0, 1.9), (), True), ((1.0, 1.1), (1,), True)],
)
def test_contested(values: tuple[float, ...], collides: tuple[int, ...], contested: bool) -> None:
    assert yardstick(solution(*values, 99.0, collides=collides), 2, SCALE).contested == contested


def test_the_table_counts() -> None:
    row = {
        "planner": "mcts",
        "iterations": 50,
        "regret": -1.0,
        "near_optimal": True,
        "collides": False,
        "avoidable": True,
        "contested": False,
    }
    rows = [
        row,
        {**row, "regret": 3.0, "near_optimal": False, "collides": True, "contested": True},
        {**row, "iterations": 100},
    ]
    first, second = ranking(rows)
    assert (
        first["all"]["near_optimal"],
        first["all"]["states"],
        first["all"]["mean_regret"],
        first["all"]["collides"],
    ) == (1, 2, 1.5, 1)
    assert (
        first["contested"]["states"],
        first["contested"]["near_optimal"],
        second["contested"]["wilson"],
    ) == (1, 0, None)


# --- planners ---


def test_a_version_that_is_none_is_a_mistake_in_one_line() -> None:
    asked = Asked(("mcts",), (10,), reference="0")
    with pytest.raises(ConfigError, match=r"--reference: 0: .*allowed: 1, 2, 2-forecast"):
        regret.check(scenario(), asked)


def test_each_version_judges_by_its_own_costs() -> None:
    """Before a light that stays red waiting has a cost in version 2 alone; what is decided is the
    same."""
    toy = TOYS["red"]
    task = task_of(toy.road, toy.scene.ego, scenario())
    old, new = (
        Panel(scenario(), Asked(("idm",), (10,), reference=name)).ask(
            task, situation_of(task, toy.scene), 0
        )
        for name in ("1", "2")
    )
    assert old[0]["optimum"] < new[0]["optimum"]


@pytest.mark.slow
@pytest.mark.parametrize("toy", TOYS.values(), ids=TOYS)
def test_the_reference_regrets_nothing_and_no_action_is_better(toy: Toy) -> None:
    """Planner random draws among the reference's own actions, so the optimum bounds it from below;
    others drive profiles between the actions."""
    config = scenario(*toy.sets)
    task = task_of(toy.road, toy.scene.ego, config)
    situation = situation_of(task, toy.scene)
    asked = Asked(("exhaustive", "random", "mcts", "paper", "idm", "constant"), (30, 300))
    rows = Panel(config, asked).ask(task, situation, 5)
    assert [(row["planner"], row["iterations"]) for row in rows[:4]] == [
        ("exhaustive", None),
        ("random", None),
        ("mcts", 30),
        ("mcts", 300),
    ]
    assert rows[0]["regret"] == 0.0 and rows[0]["near_optimal"]
    assert rows[1]["regret"] >= 0.0
    assert len({(row["optimum"], row["spread"], row["contested"]) for row in rows}) == 1
    assert rows == Panel(config, asked).ask(task, situation, 5)


def test_whoever_drives_into_a_wall_regrets_it() -> None:
    toy = on_three_lanes(None, *(Agent(f"w{k}", f"a_{k}", 113.0, 0.0) for k in range(3)))
    config = scenario()
    task = task_of(toy.road, toy.scene.ego, config)
    asked = Asked(("constant", "mcts"), (200,))
    blind = Panel(config, asked).ask(task, situation_of(task, toy.scene), 0)
    assert blind[0]["collides"] and blind[0]["regret"] > 10.0
    assert not blind[1]["collides"] and blind[1]["regret"] < 5.0


@pytest.mark.parametrize("name", ["sumo", "alphazero", ""])
def test_who_decides_nothing_from_one_cycle_is_not_asked(name: str) -> None:
    with pytest.raises(
        ConfigError, match="allowed: mcts, paper, idm, random, exhaustive, constant"
    ):
        Panel(scenario(), Asked(("mcts", name), (10,)))


@pytest.mark.slow
def test_the_efforts_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(regret, "FACTOR", 3)
    monkeypatch.setattr(regret, "FINER", 2)
    toy = TOYS["traffic"]
    task = task_of(toy.road, toy.scene.ego, scenario())
    situation = situation_of(task, toy.scene)
    rows = both_budgets(NEWEST, task, situation, 3)
    problem = problem_of(task, situation)
    found = solve(problem, root_lines(problem))
    unit = rows[0]["value"] / found.value[0]
    assert [row["value"] for row in rows] == pytest.approx((found.value * unit).tolist())
    assert [row["chosen"] for row in rows].index(True) == best_root(found) and sum(
        row["best"] for row in rows
    ) == 1
    assert min(row["regret"] for row in rows) == 0.0
    off = convergence(
        [
            *rows,
            {**rows[0], "value": rows[0]["converged"] + 2.0},
            {**rows[0], "collides": not rows[0]["collides_converged"]},
        ]
    )
    assert (
        off["actions"]["max"] == pytest.approx(2.0)
        and off["other_outcome"] == 1
        and off["choice"]["count"] >= 1
    )
    assert convergence([])["optimum"] == {"count": 0, "mean": None, "p99": None, "max": None}


def test_paper_is_judged_by_its_own_costs_too() -> None:
    """Units of the scale: 4.3 more than the least of the actions is half of a scale of 8.6."""
    own = Own(np.array([20.0, 24.3, 20.5, np.inf]), 8.6)
    assert [judged_by_own(own, i) for i in (0, 1, 2)] == [
        {"own_regret": 0.0, "own_near_optimal": True},
        {"own_regret": pytest.approx(0.5), "own_near_optimal": False},
        {"own_regret": pytest.approx(0.5 / 8.6), "own_near_optimal": True},
    ]
    assert judged_by_own(own, -1) == {"own_regret": None, "own_near_optimal": None}
    toy = TOYS["traffic"]
    config = scenario(*toy.sets)
    task = task_of(toy.road, toy.scene.ego, config)
    asked = Asked(("constant", "paper"), (100,), own=True)
    rows = Panel(config, asked).ask(task, situation_of(task, toy.scene), 0)
    assert rows[0]["own_regret"] is None and rows[1]["own_regret"] >= 0.0
    told = ranking(rows)
    assert "own" not in told[0] and told[1]["own"]["states"] == 1
    assert told[1]["own"]["mean_regret"] == rows[1]["own_regret"]
    plain = Panel(config, asked._replace(own=False)).ask(task, situation_of(task, toy.scene), 0)
    assert plain == [{k: v for k, v in row.items() if k[:4] != "own_"} for row in rows]


@pytest.mark.parametrize(("judge", "planners"), [("paper", "paper"), ("reference,paper", "mcts")])
def test_who_may_judge(judge: str, planners: str) -> None:
    done = CliRunner().invoke(app, ["regret", "--judge", judge, "--planners", planners])
    assert done.exit_code == 2 and "--judge" in done.output + done.stderr


def test_a_tree_too_large_to_be_grown_whole_is_refused() -> None:
    """12 actions on 2 levels, and 9 movements that the rollout may draw."""
    asked = Asked(("paper",), (100,), own=True)
    assert sequences(scenario()) == 12**2 * 9
    assert sequences(scenario("paper.accelerations_mps2=[0]")) == 9**2 * 9
    for key in ("look_ahead_steps=5", "rollout_steps=6"):
        large = scenario(f"paper.{key}")
        check(large, asked._replace(own=False))
        with pytest.raises(ConfigError, match=r"--judge: paper: .*sequences"):
            check(large, asked)


# --- the command ---


def command(*words: str) -> str:
    done = CliRunner().invoke(app, ["regret", *words])
    assert done.exit_code == 0, (done.output, done.exception)
    return done.stdout


@pytest.mark.slow
def test_the_command_from_end_to_end(tmp_path: Path) -> None:
    words = (
        "straight-line",
        "highway-exit-scripted",
        *SHORT,
        "--planners",
        "mcts,exhaustive",
        "--iterations",
        "20,60",
        "--states",
        "3",
    )
    told = json.loads(command(*words, "--json", "--out", str(tmp_path / "out")))
    rows = [
        json.loads(line) for line in (tmp_path / "out" / "regret.jsonl").read_text().splitlines()
    ]
    assert told["reference_digest"] == digest(NEWEST) and told["problems"] == []
    assert (told["states"], len(rows)) == (3, 9)
    assert sum(told["outcomes"].values()) == 2 and told["scenarios"] == [
        "straight-line",
        "highway-exit-scripted",
    ]
    assert [(line["planner"], line["iterations"],
    line["all"]["states"]) for line in told["planners"]] == [
        ("mcts", 20, 3), ("mcts", 60, 3), ("exhaustive", None, 3),
    ]  # fmt: skip
    assert all(row["regret"] == 0.0 for row in rows if row["planner"] == "exhaustive")
    assert len({(row["scenario"], row["seed"], row["time_s"]) for row in rows}) == 3
    table = (tmp_path / "out" / "regret.csv").read_text().splitlines()
    assert len(table) == 10 and table[0].startswith(
        "reference,scenario,prediction,seed,ego,time_s,planner,iterations,regret,near_optimal"
    )
    assert json.loads((tmp_path / "out" / "regret.json").read_text()) == told
    again = command(*words)
    old = json.loads(command(*words, "--json", "--reference", "1"))
    judge = ("--planners", "paper", "--states", "1", "--judge", "reference,paper")
    assert "By its own J" in command(*words, *judge) and "By its own J" not in again
    assert (old["reference"], old["reference_digest"]) == ("1", digest("1"))
    assert (told["reference"], old["states"]) == (NEWEST, 3)
    assert digest(NEWEST)[:16] in again and "| exhaustive | - | 3 | 3/3 (" in again
    assert len({line.count("|") for line in again.splitlines()[2:] if line}) == 1


@pytest.mark.slow
def test_the_number_of_processes_changes_nothing(tmp_path: Path) -> None:
    """What is driven ahead in vain does not count."""
    words = (
        "straight-line",
        "highway-exit",
        *SHORT,
        "--planners",
        "mcts,random",
        "--iterations",
        "20",
        "--states",
        "4",
        "--seeds",
        "2",
        "--json",
    )
    told = [
        json.loads(command(*words, "--jobs", jobs, "--out", str(tmp_path / jobs)))
        for jobs in ("1", "2")
    ]
    assert told[0] == told[1] and told[0]["states"] == 4
    assert (tmp_path / "1" / "regret.jsonl").read_bytes() == (
        tmp_path / "2" / "regret.jsonl"
    ).read_bytes()


@pytest.mark.slow
def test_the_command_looks_at_the_reference_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(regret, "FACTOR", 3)
    monkeypatch.setattr(regret, "FINER", 2)
    words = ("unprotected-left-turn", *SHORT, "--states", "2", "--converged", "--jobs", "1")
    told = json.loads(command(*words, "--json"))
    assert (
        told["states"] == told["convergence"]["choice"]["count"] == 2
        and told["convergence"]["actions"]["count"] >= 18
    )
    assert "costs of the optimum: 2, off by" in command(*words)


@pytest.mark.slow
def test_a_sumocfg_with_an_ego(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(FILES)
    told = json.loads(
        command(
            "good.sumocfg",
            "--ego",
            "any",
            "--planners",
            "constant",
            "--states",
            "2",
            "--seeds",
            "1",
            "--json",
        )
    )
    assert told["states"] == 2 and told["planners"][0]["planner"] == "constant"


def test_a_planner_that_fails_is_an_outcome(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("no idea")

    monkeypatch.setattr("sumo_mcts.planners.baselines.IdmPlanner.plan", broken)
    done = CliRunner().invoke(
        app,
        [
            "regret",
            "straight-line",
            *SHORT,
            "--planners",
            "idm",
            "--seeds",
            "1",
            "--states",
            "2",
            "--jobs",
            "1",
        ],
    )
    assert done.exit_code == 1 and "straight-line: ego ego: RuntimeError: no idea" in done.output
