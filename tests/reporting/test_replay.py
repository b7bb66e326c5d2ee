"""A packed replay holds what the trace holds, to the centimetre, in little room."""

import base64
import gzip
import json
from typing import Any

import numpy as np
import pytest
from helpers_trace import busy_trace, crossing_trace, highway_trace
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sumo_mcts.records import Trace
from sumo_mcts.reporting import replay
from sumo_mcts.scene import Release


def unpacked(trace: Trace) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(gzip.decompress(base64.b64decode(replay.packed(trace))))
    return found


def sums(differences: list[int], unit: float = 100) -> np.ndarray:
    return np.cumsum(differences) / unit


def way(bends: list[int], unit: float) -> np.ndarray:
    """The slow and obvious way back: steps from changes of step, points from steps."""
    points, step = [], np.zeros(2)
    for k, (x, y) in enumerate(zip(bends[::2], bends[1::2], strict=True)):
        step = np.array([x, y]) if k < 2 else step + np.array([x, y])
        points.append((points[-1] if points else 0) + step)
    return np.array(points).reshape(-1, 2) / unit


def origin(trace: Trace) -> np.ndarray:
    return np.floor([trace.cycles[0].ego.x, trace.cycles[0].ego.y])


@pytest.mark.parametrize(
    "trace",
    [crossing_trace(), highway_trace(), busy_trace(20)],
    ids=["crossing", "highway", "busy"],
)
def test_everybody_is_where_the_trace_has_them(trace: Trace) -> None:
    found = unpacked(trace)
    egos = [cycle.ego for cycle in trace.cycles]
    np.testing.assert_allclose(
        sums(found["time"], 1000), [cycle.time for cycle in trace.cycles], atol=5e-4
    )
    np.testing.assert_allclose(
        sums(found["ego"]["x"]) + origin(trace)[0], [ego.x for ego in egos], atol=0.00501
    )
    np.testing.assert_allclose(
        np.cos(sums(found["ego"]["h"], 1000)), [np.cos(ego.heading) for ego in egos], atol=1e-3
    )
    x, y = origin(trace)
    seen = {}
    for other in found["others"]:
        columns = zip(sums(other["x"]) + x, sums(other["y"]) + y, sums(other["v"]), strict=True)
        seen |= {(other["id"], other["from"] + i): state for i, state in enumerate(columns)}
    for k, cycle in enumerate(trace.cycles):
        for n, name in enumerate(cycle.agents.ids):
            np.testing.assert_allclose(
                seen.pop((name, k)),
                (cycle.agents.x[n], cycle.agents.y[n], cycle.agents.v[n]),
                atol=0.00501,
            )
    assert seen == {}


def test_who_is_gone_for_a_while_is_not_drawn_meanwhile() -> None:
    trace = crossing_trace()
    cycles = list(trace.cycles)
    name = next(
        name
        for name in cycles[5].agents.ids
        if all(name in cycle.agents.ids for cycle in cycles[3:8])
    )
    for k in (5, 6):
        keep = np.array([other != name for other in cycles[k].agents.ids])
        kept = {
            field: value[keep]
            for field, value in cycles[k].agents._asdict().items()
            if field != "ids"
        }
        cycles[k] = cycles[k]._replace(
            agents=cycles[k].agents._replace(
                ids=tuple(other for other in cycles[k].agents.ids if other != name), **kept
            )
        )
    stretches = [
        (other["from"], other["from"] + len(other["x"]))
        for other in unpacked(trace._replace(cycles=tuple(cycles)))["others"]
        if other["id"] == name
    ]
    assert len(stretches) == 2
    assert stretches[0][1] == 5
    assert stretches[1][0] == 7


def test_the_decision_is_told_whole() -> None:
    trace = crossing_trace()
    for cycle, told in zip(trace.cycles, unpacked(trace)["cycles"], strict=True):
        decision = cycle.decision
        assert (told["n"], told["known"], told["chosen"], told["why"]) == (
            decision.iterations,
            decision.known,
            decision.chosen,
            decision.reason,
        )
        assert told["released"] == isinstance(decision.command, Release)
        assert len(told["tried"]) == len(decision.children)
        for child, (accel, change, visits, mean, best, terms, poses) in zip(
            decision.children, told["tried"], strict=True
        ):
            assert (accel / 100, mean / 1000) == (
                pytest.approx(child.accel, abs=0.005),
                pytest.approx(child.mean),
            )
            assert (change, visits) == (child.lane_change, child.visits)
            assert (
                best is None if np.isinf(child.best) else best / 1000 == pytest.approx(child.best)
            )
            assert [term / 1000 for term in terms] == pytest.approx(child.terms.tolist())
            np.testing.assert_allclose(
                way(poses, 10) + origin(trace), child.poses[4::5, :2], atol=0.0501
            )
        if decision.plan is not None:
            np.testing.assert_allclose(
                way(told["plan"], 100) + origin(trace), decision.plan.pose[4::5, :2], atol=0.00501
            )


def test_a_manoeuvre_of_the_fail_safe_is_told_by_what_was_recorded_not_by_its_words() -> None:
    trace = crossing_trace()
    said = [
        cycle._replace(decision=cycle.decision._replace(reason=reason))
        for cycle, reason in zip(trace.cycles, ("fail-safety first", "late"), strict=False)
    ]
    cycles = replay.replay(trace._replace(cycles=(said[0], said[1]._replace(intervened=True))))[
        "cycles"
    ]
    assert [cycle["failsafe"] for cycle in cycles] == [0, 1]


def test_the_forecast_is_drawn_where_it_was() -> None:
    trace = crossing_trace()
    cycle, told = trace.cycles[8], unpacked(trace)["cycles"][8]
    pose, valid = cycle.forecast.pose[0, :26:5, :, :2], cycle.forecast.valid[0, :26:5]
    moving = [n for n in range(pose.shape[1]) if np.hypot(*(pose[:, n] - pose[0, n]).T).max() > 0.5]
    assert moving
    assert [share for share, _ in told["forecast"]] == [100] * len(moving)
    for n, (_, bends) in zip(moving, told["forecast"], strict=True):
        np.testing.assert_allclose(
            way(bends, 10) + origin(trace), pose[valid[:, n], n], atol=0.0501
        )


def test_another_hypothesis_is_drawn_only_where_it_differs() -> None:
    trace = crossing_trace()
    cycle = trace.cycles[8]
    pose = np.repeat(cycle.forecast.pose, 2, axis=0)
    pose[1, :, 0, 0] += np.linspace(0.0, 4.0, pose.shape[1])
    forecast = cycle.forecast._replace(
        pose=pose, valid=np.repeat(cycle.forecast.valid, 2, axis=0), weight=np.array([0.8, 0.2])
    )
    told = unpacked(trace._replace(cycles=(cycle._replace(forecast=forecast),)))["cycles"][0][
        "forecast"
    ]
    assert [share for share, _ in told].count(20) == 1


@given(arrays(np.float64, st.tuples(st.integers(0, 12), st.just(2)), elements=st.floats(-1e4, 1e4)))
def test_a_way_comes_back_to_half_a_unit(points: np.ndarray) -> None:
    np.testing.assert_allclose(way(replay.bends(points, 100), 100), points, atol=0.0051)


def test_the_same_trace_is_packed_the_same() -> None:
    assert replay.packed(crossing_trace()) == replay.packed(crossing_trace())


def test_fifty_replays_of_busy_minutes_are_below_20_mb() -> None:
    assert 50 * len(replay.packed(busy_trace())) < 20e6


def test_an_empty_trace_has_no_replay() -> None:
    with pytest.raises(ValueError, match="no cycle"):
        replay.packed(crossing_trace()._replace(cycles=()))
