"""An ego whose lane does not lead on along its route takes another way, comes to its goal, and
leaves behind when and why it did so."""

from pathlib import Path
from typing import Any

import helpers_sumocfg
import pytest
from helpers_detour import AROUND, network, routes
from typer.testing import CliRunner

from sumo_mcts.cli import app
from sumo_mcts.commands.run_summary import summary_of
from sumo_mcts.driver.replan import recorded_config, replan
from sumo_mcts.records import load_map, load_trace, same
from sumo_mcts.reporting.replay import replay
from sumo_mcts.scene import Decision

SAID = "takes another way, by out around goal: in_{} does not lead to left; stood there 10 s"


def driven(folder: Path, *words: str) -> dict[str, Any]:
    """The row of an episode beside the queue, at most 130 s long."""
    return helpers_sumocfg.driven(folder, "--iterations", "100", *words, limit_s=130)


@pytest.mark.slow
def test_an_ego_that_nobody_lets_in_arrives_by_another_way(tmp_path: Path) -> None:
    network(tmp_path, AROUND)
    routes(tmp_path)
    row = driven(tmp_path, "--set", "ego_model.reroute_after_s=10")
    assert (row["outcome"], row["reroutes"]) == ("arrived", 1)
    when, _, said = row["detours"].partition(" s: ")
    assert said in {SAID.format(0), SAID.format(1)}
    assert row["longest_stop_s"] == pytest.approx(10.0, abs=1.0)

    # every decision around it follows from the trace
    folder = tmp_path / "out"
    trace = load_trace(folder / "traces" / f"{row['key']}.npz")
    road = load_map(folder, trace.setting.map)
    config = recorded_config(trace.setting)
    k = next(k for k, cycle in enumerate(trace.cycles) if cycle.ego.detour)
    assert trace.cycles[k].time == pytest.approx(float(when))
    for cycle in range(k - 2, k + 3):
        again = replan(trace, road, cycle, config).decision
        assert same(Decision, again, trace.cycles[cycle].decision)

    # and it is told where one looks at it
    words = ["explain", str(folder), "--at", when]
    told = CliRunner().invoke(app, words, catch_exceptions=False).output
    assert f"  {said}\n" in told
    assert f"  missed       {row['detours']}\n" in summary_of(row)
    shown = [cycle["detour"] for cycle in replay(trace)["cycles"] if cycle["detour"]]
    assert shown == [said]
    drawn = {
        name.rpartition("_")[0]
        for name, own in zip(trace.lanes.lane_ids, trace.lanes.route, strict=True)
        if own and not name.startswith(":")
    }
    assert drawn == {"in", "left", "out", "around", "goal"}


@pytest.mark.slow
def test_the_same_seed_gives_the_same_detour(tmp_path: Path) -> None:
    rows = []
    for folder in (tmp_path / "one", tmp_path / "other"):
        folder.mkdir()
        network(folder, AROUND)
        routes(folder)
        rows.append(driven(folder, "--set", "ego_model.reroute_after_s=5"))
    assert rows[0]["trace_digest"] == rows[1]["trace_digest"]
    assert rows[0]["reroutes"] == rows[1]["reroutes"] == 1


@pytest.mark.slow
def test_an_ego_that_may_not_leave_its_route_waits(tmp_path: Path) -> None:
    network(tmp_path, AROUND)
    routes(tmp_path)
    row = driven(tmp_path, "--set", "ego_model.reroute_after_s=null")
    assert (row["outcome"], row["reroutes"], row["detours"]) == ("timeout", 0, None)
    assert row["longest_stop_s"] > 60.0


@pytest.mark.slow
def test_the_row_says_where_there_was_no_other_way(tmp_path: Path) -> None:
    network(tmp_path)
    routes(tmp_path)
    row = driven(tmp_path, "--set", "ego_model.reroute_after_s=40")
    assert (row["outcome"], row["reroutes"]) == ("timeout", 0)
    assert row["detours"].count("waits on, since no other way leads from here to the goal") == 2
