"""An ego whose lane does not lead on along its route takes another way, comes to its goal, and
leaves behind when and why it did so."""

from pathlib import Path
from typing import Any

import helpers_sumocfg
import pytest
from helpers_detour import AROUND, network, routes
from helpers_networks import netconvert
from typer.testing import CliRunner

from sumo_mcts.cli import app
from sumo_mcts.commands.run_summary import summary_of
from sumo_mcts.config import build
from sumo_mcts.driver.replan import recorded_config, replan
from sumo_mcts.episode import run_episode
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


BANNED = '<lane index="{}" changeLeft="emergency" changeRight="emergency"/>'


def banned_twice(folder: Path, around: bool) -> None:
    """Two edges in a row on which no lane may be left; the ego begins in the right lane of the
    first, and only the left one of the second leads on. The other way leads `around`, or nowhere.
    """
    lanes = BANNED.format(0) + BANNED.format(1)
    nodes = "".join(
        f'<node id="{name}" x="{x}" y="{y}"/>'
        for name, x, y in (("z", -300, 0), ("a", -150, 0), ("c", 0, 0), ("n", 0, 100),
                           ("e", 100, 0), ("g", 0, 200), ("far", 200, 0))
    )  # fmt: skip
    roads = "".join(
        f'<edge id="{name}" from="{begin}" to="{end}" numLanes="{2 if inside else 1}" '
        f'speed="13.9">{inside}</edge>'
        for name, begin, end, inside in (
            ("one", "z", "a", lanes), ("two", "a", "c", lanes), ("left", "c", "n", ""),
            ("out", "c", "e", ""), ("around", "e", "n" if around else "far", ""), ("goal", "n", "g", ""),
        )
    )  # fmt: skip
    joined = "".join(
        f'<connection from="{before}" to="{after}" fromLane="{lane}" toLane="{to}"/>'
        for before, after, lane, to in (("one", "two", 0, 0), ("one", "two", 1, 1),
                                        ("two", "out", 0, 0), ("two", "left", 1, 0),
                                        ("left", "goal", 0, 0))
    )  # fmt: skip
    netconvert(folder, nodes, roads, joined)
    (folder / "x.rou.xml").write_text(
        '<routes><vType id="car" speedDev="0"/><vehicle id="ego" type="car" depart="1" '
        'departLane="0" departPos="10" departSpeed="10"><route edges="one two left goal"/>'
        "</vehicle></routes>"
    )


@pytest.mark.slow
@pytest.mark.parametrize("around", [True, False])
def test_an_ego_in_a_lane_that_may_not_be_left_any_more_leaves_or_halts_gently(
    around: bool, tmp_path: Path
) -> None:
    """SUMO halts it at the end of the first edge, though that lane leads onto the second: within a
    step (139 m/s2) where the ego had not braked."""
    banned_twice(tmp_path, around)
    scene = {
        "name": "banned",
        "sumo": {"net": str(tmp_path / "x.net.xml"), "routes": [str(tmp_path / "x.rou.xml")]},
        "egos": [{"id": "ego"}],
        "planner": {"iterations": 100},
        "episode": {"time_limit_s": 60},
    }
    (row,) = run_episode(build(scene, "test", ()), 1).rows
    assert row["outcome"] == ("arrived" if around else "timeout")
    assert row["reroutes"] == around and row["max_decel_mps2"] <= 4.5
    assert row["detours"].split(": ", 1)[1].startswith("takes" if around else "waits")
