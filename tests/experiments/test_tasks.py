"""What a worker does: several egos in one episode, and the choice of egos."""

import errno
import subprocess
import sys
from pathlib import Path

import pytest
from helpers_batch import (
    GOOD,
    write,
)

from sumo_mcts import config, records
from sumo_mcts.config import builtin
from sumo_mcts.experiments import folder
from sumo_mcts.experiments.experiment import Episode, episodes, load
from sumo_mcts.experiments.schema import Egos
from sumo_mcts.experiments.tasks import choose, drive, failed, rehearse
from sumo_mcts.records.highlights import TraceSelection


@pytest.fixture
def two(tmp_path: Path) -> Episode:
    """One episode of two egos."""
    (tmp_path / "two.yaml").write_text(
        f"base: {builtin.scenario_path('highway-exit')}\nname: two\negos: [{{id: ego}}, {{id: "
        "left_lane}]\n"
    )
    (episode,) = episodes(
        load(
            write(
                tmp_path,
                "name: x\nscenarios: [two.yaml]\nvariants: {constant: {planner.name: constant}}\n",
            )
        ),
        {},
    )
    return episode


def test_two_egos_leave_two_rows(two: Episode) -> None:
    driven = drive(two, TraceSelection("all").bar("two", "constant"))
    assert [(row["key"], row["ego"]) for row in driven.rows] == [
        ("two--constant--0--ego", "ego"),
        ("two--constant--0--left_lane", "left_lane"),
    ]
    assert set(driven.traces) == {row["key"] for row in driven.rows}


def test_a_part_of_an_episode_does_not_count(two: Episode, tmp_path: Path) -> None:
    first, second = failed(two, "a reason")
    records.append_row(tmp_path, first)
    assert folder.done(tmp_path, [two]) == []
    records.append_row(tmp_path, second)
    records.append_row(tmp_path, {**first, "error": "the later one"})
    assert [row["error"] for row in folder.done(tmp_path, [two])] == ["the later one", "a reason"]


def test_an_exception_is_the_outcome(two: Episode, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("as asked")

    monkeypatch.setattr("sumo_mcts.experiments.tasks.run_episode", broken)
    driven = drive(two, TraceSelection("all").bar("two", "constant"))
    assert [(row["outcome"], row["error"]) for row in driven.rows] == [
        ("error", "RuntimeError: as asked")
    ] * 2
    assert driven.traces == {}


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        *(
            OSError(getattr(errno, name), name)
            for name in ("ENOSPC", "EDQUOT", "ENFILE", "ENOMEM", "EIO")
        ),
    ],
)
def test_what_the_machine_lacks_is_no_outcome(
    error: Exception, two: Episode, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("sumo_mcts.experiments.tasks.run_episode", broken)
    monkeypatch.setattr("sumo_mcts.experiments.tasks.warm_up", broken)
    with pytest.raises(type(error)):
        drive(two, TraceSelection("all").bar("two", "constant"))
    with pytest.raises(type(error)):
        rehearse(two.config, 0)


def test_a_draw_of_egos() -> None:
    scenario = config.build(
        {"name": "x", "sumo": {"sumocfg": str(GOOD)}, "egos": [{"id": "any"}]}, "x"
    )
    drawn = [choose(scenario, Egos(random=1, seed=seed)) for seed in range(8)]
    assert set(drawn) == {("ego",), ("other",)}
    assert [choose(scenario, Egos(random=1, seed=seed)) for seed in range(8)] == drawn
    assert choose(scenario, Egos(ids=("other",))) == ("other",)


MEASURED = """
import sys
import libsumo
from sumo_mcts import config
from sumo_mcts.episode.launch import LaunchOptions
from sumo_mcts.episode.loop import Loop
for ego in ("ego", "other"):
    scene = config.build({"name": "x", "sumo": {"sumocfg": sys.argv[1]}, "egos": [{"id": ego}]}, "x")
    loop = Loop(scene, None, LaunchOptions(measured=sys.argv[2:]))
    loop.scenes()
    print(libsumo.vehicle.getParameter(ego, "has.ssm.device"))
    loop.close()
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("measured", "found"), [((), ["true", "false"]), (("ego", "other"), ["true", "true"])]
)
def test_sumo_measures_whom_it_was_told_first_in_a_process(
    measured: tuple[str, ...], found: list[str]
) -> None:
    """So every episode of a batch names the egos of all; should the first row ever be true, true,
    that is not needed any more."""
    done = subprocess.run(
        [sys.executable, "-c", MEASURED, str(GOOD), *measured],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == found
