"""An explanation is what the trace says: distances by an independent judge, costs that add up, the
light that is ahead, and words for every planner."""

import json
import math
import re
from functools import cache

import numpy as np
import pytest
from helpers_recorded import of_a_scene, of_a_user
from shapely import Polygon

from sumo_mcts import records
from sumo_mcts.arrays import Floats
from sumo_mcts.episode import EpisodeResult, run_episode
from sumo_mcts.records import CycleRecord
from sumo_mcts.reporting.explanation import closest, explain, explain_again
from sumo_mcts.reporting.explanation_words import text
from sumo_mcts.road import RoadMap


@cache
def braking() -> EpisodeResult:
    """On the straight road with this seed somebody ahead may brake hard."""
    return run_episode(of_a_scene("straight-line-varied"), 2)


@pytest.fixture(scope="module")
def on_a_grid(tmp_path_factory: pytest.TempPathFactory) -> EpisodeResult:
    return run_episode(of_a_user(tmp_path_factory.mktemp("grid")))


def road_of(result: EpisodeResult) -> RoadMap:
    assert result.road is not None
    return result.road


def box(x: float, y: float, c: float, s: float, half_length: float, half_width: float) -> Polygon:
    corners = np.array(
        [
            (half_length, half_width),
            (-half_length, half_width),
            (-half_length, -half_width),
            (half_length, -half_width),
        ]
    )
    return Polygon(corners @ np.array([[c, s], [-s, c]]) + (x, y))


def judged(cycle: CycleRecord, h: int, i: int) -> list[tuple[float, float]]:
    """The distances between ego and agent on the forecast's grid, and when: by shapely."""
    ego, plan, forecast = cycle.ego, cycle.decision.plan, cycle.forecast
    assert plan is not None
    found: list[tuple[float, float]] = []
    for t in range(forecast.pose.shape[1]):
        seconds = t * forecast.dt
        if seconds > plan.time[-1] + 1e-6 or not forecast.valid[h, t, i]:
            continue
        own: Floats = np.array([ego.x, ego.y, math.cos(ego.heading), math.sin(ego.heading)])
        if t > 0:
            own = plan.pose[int(np.argmin(np.abs(plan.time - seconds)))]
        other = box(*forecast.pose[h, t, i], cycle.agents.length[i] / 2, cycle.agents.width[i] / 2)
        found.append((box(*own, ego.length / 2, ego.width / 2).distance(other), seconds))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("number", [0, 8, 20])
def test_how_near_others_come_is_what_shapely_says(number: int) -> None:
    cycle = braking().traces[0].cycles[number]
    near = closest(cycle)
    for h in range(len(cycle.forecast.weight)):
        for i in range(len(cycle.agents.ids)):
            found = judged(cycle, h, i)
            distance = min(found)[0]
            assert near[h, i, 0] == pytest.approx(distance, abs=1e-6)
            if distance > 0.0:  # they may be as near several times
                assert any(
                    near[h, i, 1] == pytest.approx(seconds, abs=0.21)
                    for there, seconds in found
                    if there < distance + 1e-6
                )


@pytest.mark.slow
def test_costs_add_up_and_the_chosen_action_is_what_was_driven() -> None:
    result = braking()
    trace = result.traces[0]
    for number, cycle in enumerate(trace.cycles):
        told = explain(trace, road_of(result), number)
        best = [action["best"] for action in told["actions"]]
        assert best == sorted(best)
        assert sum(each["weight"] for each in told["hypotheses"]) == pytest.approx(1.0)
        (chosen,) = [action for action in told["actions"] if action["chosen"]]
        assert (
            chosen["best"]
            == told["decision"]["cost"]
            == cycle.decision.children[cycle.decision.chosen].best
        )
        assert chosen["action"] == told["decision"]["action"]
        if not chosen["hypotheses"]:
            assert sum(chosen["terms"].values()) == pytest.approx(chosen["best"])
        assert told["decision"]["speeds_mps"] == cycle.decision.command.speeds.tolist()
        assert (told["decision"]["action"] == "last plan, carried on") == (
            told["decision"]["reason"] == "carried on"
        )
        assert json.loads(records.json_text(told))["time_s"] == cycle.time
        if number + 1 < len(trace.cycles):
            assert told["executed"]["executed_mps"] == trace.cycles[number + 1].ego.v


@pytest.mark.slow
def test_what_a_hypothesis_is_about_is_named() -> None:
    told = explain(braking().traces[0], braking().road, 15)
    words = [each["words"] for each in told["hypotheses"]]
    assert words[0] == "all agents do what is likeliest"
    assert "right brakes hard, to a stand" in words
    about = next(each for each in told["hypotheses"] if each["about"] == "right")
    agent = next(agent for agent in told["agents"] if agent["id"] == "right")
    assert about["closest_m"] < agent["closest_m"]


@pytest.mark.slow
def test_the_light_and_the_stop_signs_ahead_are_told(on_a_grid: EpisodeResult) -> None:
    trace, road = on_a_grid.traces[0], road_of(on_a_grid)
    ahead = [
        explain(trace, road, number)["ego"]["stop_line"] for number in range(len(trace.cycles))
    ]
    kinds = [line["kind"] for line in ahead if line is not None]
    assert {"light", "stop sign"} == set(kinds)
    seen = {line["shows"] for line in ahead if line is not None}
    assert {"to stop", "stood there"} <= seen
    assert "red" in seen or "green" in seen
    for before, after, cycle, following in zip(
        ahead, ahead[1:], trace.cycles, trace.cycles[1:], strict=False
    ):
        if before is not None and after is not None and cycle.ego.lane == following.ego.lane:
            assert before["distance_m"] - after["distance_m"] == pytest.approx(
                following.ego.s - cycle.ego.s
            )
        if before is not None and before["shows"] == "red" and before["distance_m"] < 1.0:
            assert following.ego.lane == cycle.ego.lane
    assert "stop sign in" in text(
        explain(
            trace,
            road,
            next(
                i
                for i, line in enumerate(ahead)
                if line is not None and line["kind"] == "stop sign"
            ),
        )
    )


def test_an_oracle_is_called_one_and_what_a_planner_does_not_read_is_not_named() -> None:
    heads = {}
    for planner, prediction in (("mcts", "idm"), ("mcts", "script"), ("sumo", "idm")):
        sets = (f"planner.name={planner}", f"prediction.name={prediction}", "episode.stop_time_s=1")
        result = run_episode(of_a_scene("straight-line-scripted", *sets), 4)
        heads[planner, prediction] = text(explain(result.traces[0], result.road, 0)).splitlines()[0]
    assert heads["mcts", "idm"].endswith("; planner mcts, forecast idm")
    assert heads["mcts", "script"].endswith("; planner mcts, forecast script (an oracle)")
    assert heads["sumo", "idm"].endswith("; planner sumo")


def test_whoever_may_come_nearest_is_first() -> None:
    agents = explain(braking().traces[0], braking().road, 15)["agents"]
    assert [agent["worst_m"] for agent in agents] == sorted(agent["worst_m"] for agent in agents)
    assert all(agent["worst_m"] <= agent["closest_m"] for agent in agents)
    assert {agents[0]["id"], agents[1]["id"]} == {
        "right",
        "braking",
    }  # in a hypothesis, though not in the likeliest


def test_without_its_map_lanes_go_by_numbers() -> None:
    told = explain(braking().traces[0], None, 15)
    assert re.fullmatch(r"lane \d+", told["ego"]["lane"])
    assert "road_0" not in text(told)
    assert "road_0" in text(explain(braking().traces[0], braking().road, 15))


PLANNERS = {
    "sumo": ("SUMO's own driver drives", "decision: SUMO drives", "nothing commanded"),
    "constant": ("the speed of the take-over is held; other agents are ignored",),
    "idm": ("car following and gap acceptance; no action is weighed",),
    "random": ("drawn",),
}


@pytest.mark.parametrize("planner", PLANNERS)
def test_planners_that_weigh_nothing_are_explained_as_far_as_that_goes(planner: str) -> None:
    result = run_episode(
        of_a_scene("straight-line", f"planner.name={planner}", "episode.stop_time_s=4"), 4
    )
    told = explain(result.traces[0], result.road, 2)
    shown = text(told)
    assert told["actions"] == []
    assert "actions, the cheapest" not in shown
    assert all(words in shown for words in PLANNERS[planner])
    assert len(told["agents"]) == len(result.traces[0].cycles[2].agents.ids) > 0
    last = text(explain(result.traces[0], result.road, len(result.traces[0].cycles) - 1))
    assert "in SUMO: timeout before the next decision" in last


def test_why_the_fail_safe_acted_is_told() -> None:
    result = run_episode(
        of_a_scene("unprotected-left-turn", "planner.name=constant", "failsafe.on=true"), 3
    )
    number = next(i for i, cycle in enumerate(result.traces[0].cycles) if cycle.intervened)
    told = explain(result.traces[0], result.road, number)
    assert told["decision"]["fail_safe"]
    assert "in place of what the planner decided; fail-safe: no stop and no way out that" in text(
        told
    )


def test_the_same_settings_give_the_identical_decision_and_others_stand_beside() -> None:
    trace, road = braking().traces[0], road_of(braking())
    told = explain(trace, road, 15)
    again = explain_again(trace, road, 15, ())
    assert again["identical"] and again["same_command"]
    assert {key: told[key] for key in ("ego", "agents", "hypotheses", "actions", "decision")} == {
        key: again[key] for key in again if key in told
    }
    assert text({**told, "replan": again}).endswith(
        "taken again with the same settings: the identical decision"
    )
    other = explain_again(trace, road, 15, ("prediction.hypotheses=1",))
    assert not other["identical"] and not other["same_command"]
    assert all(action["hypotheses"] == [] for action in other["actions"])
    shown = text({**told, "replan": other})
    assert "taken again with prediction.hypotheses=1: another command" in shown
    table = shown[shown.index("again: visits") :].splitlines()[1:]
    assert len(table) == len(
        {
            (a["action"], a["lane_change"], a["action"] == "acceleration" and a["accel_mps2"])
            for a in told["actions"] + other["actions"]
        }
    )


def test_a_decision_with_a_time_budget_is_called_not_reproducible() -> None:
    result = run_episode(
        of_a_scene("straight-line", "planner.time_budget_ms=5", "episode.stop_time_s=2"), 4
    )
    trace = result.traces[0]
    again = explain_again(trace, road_of(result), 2, ())
    assert not again["reproducible"]
    changed = {**again, "identical": False}
    assert "a decision that a clock has a say in is not reproducible" in text(
        {**explain(trace, result.road, 2), "replan": changed}
    )
