"""A decision taken again from its record is the decision that was taken, to the last bit, cycle by
cycle over whole episodes."""

import shutil
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from helpers_recorded import keep, of_a_scene, of_a_user

from sumo_mcts.config import ScenarioConfig
from sumo_mcts.driver.replan import READ, recorded_config, replan
from sumo_mcts.episode import EpisodeResult, run_episode
from sumo_mcts.errors import ConfigError
from sumo_mcts.planners.base import Situation
from sumo_mcts.planners.mcts import MctsPlanner
from sumo_mcts.records import TRACES, Trace, load_map, load_trace, same, save_map
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import USUAL, Decision, Follow, Forecast

CASES = {
    "left turn": ("unprotected-left-turn",),
    "highway exit, a sensor that errs": (
        "highway-exit",
        "sensor.position_error_m=0.5",
        "sensor.drop_probability=0.1",
        "sensor.occlusion=true",
    ),
    "straight line, drawn rollouts": ("straight-line", "planner.adaptive=false"),
    "oracle script": ("unprotected-left-turn-scripted", "prediction.name=script"),
    "oracle clone": ("unprotected-left-turn", "prediction.name=clone"),
    "oracle routes": ("unprotected-left-turn", "prediction.name=routes"),
    "fail-safe": ("unprotected-left-turn", "planner.name=constant", "failsafe.on=true"),
    "paper": ("unprotected-left-turn", "planner.name=paper"),
    "random": ("straight-line", "planner.name=random"),
    "idm": ("straight-line", "planner.name=idm"),
    "sumo": ("straight-line", "planner.name=sumo"),
}


def kept(folder: Path, result: EpisodeResult) -> tuple[Trace, RoadMap]:
    """What an episode leaves behind, as it comes back from disk."""
    keep(folder, result)
    trace = load_trace(folder / TRACES / f"{result.traces[0].key}.npz")
    return trace, load_map(folder, trace.setting.map)


@pytest.fixture(scope="module")
def on_a_grid(tmp_path_factory: pytest.TempPathFactory) -> EpisodeResult:
    """An episode on a network of a user, of which nothing but the record is left."""
    folder = tmp_path_factory.mktemp("grid")
    result = run_episode(of_a_user(folder))
    shutil.rmtree(folder)
    return result


@cache
def left_turn() -> EpisodeResult:
    return run_episode(of_a_scene("unprotected-left-turn"), 3)


def differing(trace: Trace, road: RoadMap) -> Iterator[int]:
    """Cycles whose decision or forecast comes out otherwise."""
    same_settings = recorded_config(trace.setting)
    for i, cycle in enumerate(trace.cycles):
        thought = replan(trace, road, i, same_settings)
        foreseen = thought.forecast is None or same(Forecast, thought.forecast, cycle.forecast)
        if not (
            foreseen
            and same(Decision, thought.decision, cycle.decision)
            and thought.intervened == cycle.intervened
        ):
            yield i


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_every_decision_of_an_episode_comes_out_again(case: str, tmp_path: Path) -> None:
    result = left_turn() if case == "left turn" else run_episode(of_a_scene(*CASES[case]), 3)
    trace, road = kept(tmp_path, result)
    assert list(differing(trace, road)) == []
    assert any(cycle.intervened for cycle in trace.cycles) == (case == "fail-safe")
    assert any(
        len(cycle.answers.agent) or cycle.answers.ways for cycle in trace.cycles
    ) == case.startswith("oracle")


@pytest.mark.slow
def test_every_decision_on_a_network_of_a_user_comes_out_again(
    on_a_grid: EpisodeResult, tmp_path: Path
) -> None:
    trace, road = kept(tmp_path, on_a_grid)
    assert list(differing(trace, road)) == []
    assert any(cycle.memory.stood for cycle in trace.cycles)
    assert any(len(cycle.forecast.weight) > 1 for cycle in trace.cycles)


@pytest.mark.slow
@pytest.mark.parametrize("forgotten", ["numbers", "stood", "last"])
def test_what_is_remembered_decides(
    forgotten: str, on_a_grid: EpisodeResult, tmp_path: Path
) -> None:
    """Without any one part of the memory some decision is another: so the tests above would notice
    a part that is not kept."""
    trace, road = kept(tmp_path, on_a_grid if forgotten == "stood" else left_turn())
    cycles = trace.cycles
    if forgotten == "numbers":
        blank = np.zeros(1)
        cycles = tuple(
            c._replace(memory=c.memory._replace(planner=c.memory.planner._replace(numbers=blank)))
            if c.memory.edges
            else c
            for c in cycles
        )
    elif forgotten == "stood":
        cycles = tuple(
            c._replace(memory=c.memory._replace(stood=(), stood_since=())) for c in cycles
        )
    else:
        cycles = tuple(c._replace(decision=c.decision._replace(plan=None)) for c in cycles)
    assert any(True for _ in differing(trace._replace(cycles=cycles), road))


@pytest.mark.slow
def test_other_settings_are_followed_and_nothing_else_changes() -> None:
    trace, road = left_turn().traces[0], left_turn().road
    assert road is not None
    kinder = recorded_config(trace.setting, ("planner.name=idm",))
    assert {replan(trace, road, i, kinder).decision.reason for i in range(len(trace.cycles))} == {
        "idm"
    }
    more = recorded_config(trace.setting, ("planner.iterations=2000",))
    assert any(
        replan(trace, road, i, more).decision.iterations > trace.cycles[i].decision.iterations
        for i in range(len(trace.cycles))
    )


def test_an_oracle_that_was_not_asked_cannot_be_asked_later(tmp_path: Path) -> None:
    trace, road = kept(tmp_path, left_turn())
    with pytest.raises(
        ConfigError,
        match=r"prediction.name: routes is an oracle that this episode did not ask; allowed: idm, "
        r"constant_velocity",
    ):
        replan(trace, road, 0, recorded_config(trace.setting, ("prediction.name=routes",)))


def test_an_oracle_told_no_more_than_the_horizon() -> None:
    result = run_episode(of_a_scene(*CASES["oracle script"]), 3)
    assert result.road is not None
    longer = recorded_config(result.traces[0].setting, ("planner.rollout_steps=6",))
    with pytest.raises(ConfigError, match=r"the oracle told \d+ states"):
        replan(result.traces[0], result.road, 2, longer)
    with pytest.raises(
        ConfigError,
        match=r"prediction.step_s: the oracle told where the others are every 0.2 s, not every 0.4 "
        r"s",
    ):
        replan(
            result.traces[0],
            result.road,
            2,
            recorded_config(result.traces[0].setting, ("prediction.step_s=0.4",)),
        )
    shorter = recorded_config(result.traces[0].setting, ("planner.rollout_steps=0",))
    assert isinstance(replan(result.traces[0], result.road, 2, shorter).decision.command, Follow)


@pytest.mark.slow
def test_what_hypotheses_are_about_is_recorded_with_what_each_costs() -> None:
    cycles = [cycle for cycle in left_turn().traces[0].cycles if len(cycle.forecast.weight) > 1]
    assert any(intent.does != USUAL for cycle in cycles for intent in cycle.forecast.intents)
    for cycle in cycles:
        assert len(cycle.forecast.intents) == len(cycle.forecast.weight)
        assert sum(intent.does == USUAL for intent in cycle.forecast.intents) == 1
        for child in cycle.decision.children:
            searched = len(child.hypotheses)
            assert 1 < searched <= len(cycle.forecast.weight)
            weight = cycle.forecast.weight[:searched] / cycle.forecast.weight[:searched].sum()
            assert child.best == pytest.approx(weight @ child.hypotheses.sum(axis=1), rel=1e-9)
            np.testing.assert_array_equal(child.hypotheses[0], child.terms)


def test_maps_are_written_once_and_told_by_their_roads(tmp_path: Path) -> None:
    road = left_turn().road
    assert road is not None
    first = save_map(tmp_path, road)
    written = first.stat().st_mtime_ns
    assert save_map(tmp_path, road) == first
    assert first.stat().st_mtime_ns == written
    first.write_bytes(first.read_bytes()[:99])
    save_map(tmp_path, road)
    assert same(RoadMap, load_map(tmp_path, first.stem), road), "a damaged one is mended"
    assert save_map(tmp_path, road._replace(speed=road.speed + 1.0)) != first
    assert left_turn().traces[0].setting.map == first.stem
    assert same(RoadMap, load_map(tmp_path, first.stem), road)


@pytest.mark.slow
def test_a_planner_that_failed_fails_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The decisions that a bug report is about: the planner raises for a while, and the fail-safe
    drives."""
    plan = MctsPlanner.plan

    def failing(self: MctsPlanner, situation: Situation) -> Decision:
        if 1.0 < situation.scene.time < 3.0:
            raise ZeroDivisionError("for a while")
        return plan(self, situation)

    monkeypatch.setattr(MctsPlanner, "plan", failing)
    trace, road = kept(
        tmp_path, run_episode(of_a_scene("straight-line", "episode.stop_time_s=5"), 3)
    )
    failed = [cycle for cycle in trace.cycles if cycle.intervened]
    assert [cycle.memory.failures for cycle in failed] == [0, 1, 2, 3]
    assert all(
        "the planner failed: ZeroDivisionError: for a while" in cycle.decision.reason
        for cycle in failed
    )
    assert list(differing(trace, road)) == []
    monkeypatch.setattr(MctsPlanner, "plan", plan)
    mended = replan(trace, road, trace.cycles.index(failed[0]), recorded_config(trace.setting))
    assert not mended.intervened
    assert mended.decision.reason in ("search", "carried on")


def test_of_every_section_it_is_known_whether_a_decision_reads_it() -> None:
    assert set(ScenarioConfig.model_fields) - set(READ) == {
        "name",
        "description",
        "sumo",
        "egos",
        "traffic",
        "episode",
        "sensor",
    }
