"""Egos that tell each other their plans, in SUMO."""

from pathlib import Path

import numpy as np
import pytest
from helpers_networks import car, four_arms
from helpers_recorded import FAST, keep

from sumo_mcts import config
from sumo_mcts.driver.replan import recorded_config, replan
from sumo_mcts.episode import EpisodeResult, run_episode
from sumo_mcts.prediction.told import Told, states_told
from sumo_mcts.records import TRACES, CycleRecord, Trace, load_map, load_trace, same
from sumo_mcts.scene import Decision, Forecast, Scripted

ROUTES = {"e": ("ew", 41.0), "s": ("sn", 40.0), "w": ("wn", 42.0)}  # arm: route, place
OTHER_CAR = car("ns", 0.0)  # it tells nobody


def driven(folder: Path, connected: str) -> EpisodeResult:
    """Three egos at a crossing, in the order of ROUTES; `connected`: the arms of those that are."""
    four_arms(folder, "right_before_left")
    cars = "".join(car(*each) for each in ROUTES.values()) + OTHER_CAR
    (folder / "x.rou.xml").write_text(
        f'<routes><vType id="car" speedDev="0"/>{cars}</routes>', encoding="utf-8"
    )
    scene = {
        "name": "connected",
        "sumo": {"net": str(folder / "x.net.xml"), "routes": [str(folder / "x.rou.xml")]},
        "egos": [{"id": ego, "connected": ego in connected} for ego in ROUTES],
        "sensor": {"position_error_m": 0.3},
        "episode": {"time_limit_s": 40},
    }
    return run_episode(config.build(scene, "test", (FAST,)), 1)


@pytest.fixture(scope="module")
def all_connected(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, EpisodeResult]:
    """An episode, saved, and its result."""
    folder = tmp_path_factory.mktemp("connected")
    result = driven(folder, "esw")
    keep(folder, result)
    return folder, result


def ego_of(trace: Trace) -> str:
    return trace.cycles[0].ego.id


def last_told(trace: Trace, now: float, *, before: bool) -> CycleRecord | None:
    """The last decision until now, or `before` now."""
    known = [c for c in trace.cycles if c.time < now - 1e-6 or (not before and c.time < now + 1e-6)]
    return known[-1] if known else None


@pytest.mark.slow
def test_the_forecast_is_the_other_egos_last_plan(
    all_connected: tuple[Path, EpisodeResult],
) -> None:
    """Of an ego that decides before this one in the same step, its new plan; of the others, the one
    before. In all hypotheses, though the sensor errs."""
    _, result = all_connected
    traces = {ego_of(trace): trace for trace in result.traces}
    assert list(traces) == list(ROUTES)
    compared, reaches = {"new": 0, "old": 0, "hypotheses": 0}, []
    for place, (ego, trace) in enumerate(traces.items()):
        for cycle in trace.cycles:
            for i in cycle.answers.told.agent.tolist():
                other = cycle.agents.ids[i]
                earlier = list(ROUTES).index(other) < place
                told = last_told(traces[other], cycle.time, before=not earlier)
                assert told is not None and told.decision.plan is not None
                count = cycle.forecast.v.shape[1]
                states = states_told(
                    Told(told.ego, told.decision.plan, told.time),
                    cycle.time,
                    cycle.forecast.dt,
                    count,
                )
                reach = int(states.valid.sum())
                reaches.append(reach)
                for h in range(len(cycle.forecast.weight)):
                    for name in Scripted._fields:
                        said = getattr(cycle.forecast, name)[h, :reach, i]
                        assert (said == getattr(states, name)[:reach]).all(), (ego, other, name)
                assert all(intent.agent != i for intent in cycle.forecast.intents)
                compared["new" if told.time == cycle.time else "old"] += 1
                compared["hypotheses"] += len(cycle.forecast.weight) > 1
            assert "n" not in {cycle.agents.ids[i] for i in cycle.answers.told.agent}
    assert min(compared.values()) > 5, compared
    assert np.median(reaches) * 0.2 > 7.0, "plans reach 8 s from their decision on"


@pytest.mark.slow
def test_decisions_of_connected_egos_come_out_again(
    all_connected: tuple[Path, EpisodeResult], tmp_path: Path
) -> None:
    """From the trace alone, as it comes back from disk; and in a second episode."""
    folder, result = all_connected
    told = 0
    for kept in result.traces:
        trace = load_trace(folder / TRACES / f"{kept.key}.npz")
        road, settings = load_map(folder, trace.setting.map), recorded_config(trace.setting)
        for i, cycle in enumerate(trace.cycles):
            again = replan(trace, road, i, settings)
            assert same(Decision, again.decision, cycle.decision), (kept.key, i)
            assert again.forecast is not None and same(Forecast, again.forecast, cycle.forecast)
            told += len(cycle.answers.told.agent)
    assert told > 10
    second = driven(tmp_path, "esw")
    assert [row["trace_digest"] for row in second.rows] == [
        row["trace_digest"] for row in result.rows
    ]


@pytest.mark.slow
def test_an_ego_that_is_not_connected_plans_by_itself(
    all_connected: tuple[Path, EpisodeResult], tmp_path: Path
) -> None:
    """One that is connected with nobody decides as one that is not connected."""
    alone, none = driven(tmp_path, "s"), driven(tmp_path, "")
    digests = [[row["trace_digest"] for row in each.rows] for each in (alone, none)]
    assert digests[0] == digests[1]
    assert digests[0] != [row["trace_digest"] for row in all_connected[1].rows]
    two = driven(tmp_path, "es")
    for trace in two.traces:
        known = {c.agents.ids[i] for c in trace.cycles for i in c.answers.told.agent}
        assert known == {"e": {"s"}, "s": {"e"}, "w": set()}[ego_of(trace)]
