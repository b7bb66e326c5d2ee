"""Roads, routes and goals that SUMO changes while the ego drives."""

from pathlib import Path
from typing import Any

import libsumo
import numpy as np
import pytest
from helpers_networks import netconvert

from sumo_mcts import Controller, config
from sumo_mcts.driver.replan import recorded_config, replan
from sumo_mcts.episode import EpisodeResult, run_episode
from sumo_mcts.records import same
from sumo_mcts.scene import Decision

NODES = (
    '<node id="w" x="0" y="0"/><node id="p" x="200" y="0"/><node id="q" x="400" y="0"/>'
    '<node id="e" x="600" y="0"/><node id="n" x="300" y="-100"/><node id="s" x="400" y="-200"/>'
)
EDGES = "".join(
    f'<edge id="{name}" from="{name_from}" to="{to}" numLanes="{lanes}" speed="15"/>'
    for name, name_from, to, lanes in (
        ("a", "w", "p", 2), ("b", "p", "q", 2), ("c", "q", "e", 2),
        ("d", "p", "n", 1), ("f", "n", "q", 1), ("g", "q", "s", 1),
    )
)  # fmt: skip
ROUTES = (
    '<routes><vType id="car" sigma="0" speedDev="0"/><vehicle id="ego" type="car" depart="0" '
    'departLane="0" departSpeed="10"><route edges="a b c"/></vehicle></routes>'
)
FAST = {"planner": {"iterations": 100}}


def rerouter(edge: str, what: str, begin: int = 0) -> str:
    return (
        f'<rerouter id="r" edges="{edge}"><interval begin="{begin}" end="999">{what}</interval>'
        "</rerouter>"
    )


def sign(lanes: str, speed: float, time: int = 0) -> str:
    return (
        f'<variableSpeedSign id="v" lanes="{lanes}"><step time="{time}" speed="{speed}"/>'
        "</variableSpeedSign>"
    )


def network(folder: Path, additional: str) -> str:
    netconvert(folder, NODES, EDGES, "")
    (folder / "x.rou.xml").write_text(ROUTES)
    (folder / "x.add.xml").write_text(f"<additional>{additional}</additional>")
    (folder / "x.sumocfg").write_text(
        '<configuration><net-file value="x.net.xml"/><route-files value="x.rou.xml"/>'
        '<additional-files value="x.add.xml"/><step-length value="0.1"/>'
        '<lanechange.duration value="3"/></configuration>'
    )
    return str(folder / "x.sumocfg")


def driven(folder: Path, additional: str, **episode: Any) -> EpisodeResult:
    scene = {
        "name": "changes",
        "sumo": {"sumocfg": network(folder, additional)},
        "egos": [{"id": "ego"}],
        "episode": episode,
        **FAST,
    }
    return run_episode(config.build(scene, "test", ()), 1)


def speeds_on(result: EpisodeResult, edge: str) -> list[float]:
    """The ego's speeds at its decisions on an edge, m/s."""
    road = result.road
    assert road is not None
    return [
        cycle.ego.v
        for cycle in result.traces[0].cycles
        if cycle.ego.lane >= 0 and road.edge_ids[road.edge[cycle.ego.lane]] == edge
    ]


def test_a_speed_sign_ahead_is_kept(tmp_path: Path) -> None:
    result = driven(tmp_path, sign("b_0 b_1", 5.0))
    row = result.rows[0]
    assert (row["outcome"], row["speeding_share"]) == ("arrived", 0.0)
    assert max(speeds_on(result, "b")) < 5.1
    assert row["max_decel_mps2"] < 2.5
    assert max(speeds_on(result, "c")) > 10.0


def test_a_higher_limit_is_used(tmp_path: Path) -> None:
    assert max(speeds_on(driven(tmp_path, sign("b_0 b_1", 25.0)), "b")) > 18.0


def test_a_sign_that_changes_over_the_ego_is_met_gently_and_the_decisions_come_out_again(
    tmp_path: Path,
) -> None:
    """The referee counts the speed above the limit of the moment meanwhile."""
    result = driven(tmp_path, sign("a_0 a_1", 5.0, 6))
    row, trace, road = result.rows[0], result.traces[0], result.road
    assert road is not None
    assert row["outcome"] == "arrived"
    assert 2.0 < row["speeding_share"] * row["travel_time_s"] < 8.0
    assert row["max_decel_mps2"] < 3.0
    assert speeds_on(result, "a")[-1] < 5.1
    before = recorded_config(trace.setting)
    again = [replan(trace, road, i, before).decision for i in range(len(trace.cycles))]
    assert all(same(Decision, c.decision, d) for c, d in zip(trace.cycles, again, strict=True))
    assert {len(cycle.changes.lane) for cycle in trace.cycles} == {0, 2}


def test_a_closed_lane_is_left(tmp_path: Path) -> None:
    result = driven(tmp_path, rerouter("a", '<closingLaneReroute id="b_0" disallow="all"/>'))
    row = result.rows[0]
    assert row["outcome"] == "arrived" and row["max_decel_mps2"] < 2.5
    assert row["time_lost_s"] < 3.0


def test_before_a_closed_edge_without_a_way_round_the_ego_waits(tmp_path: Path) -> None:
    """As SUMO's driver does."""
    result = driven(
        tmp_path, rerouter("d", '<closingReroute id="c" disallow="all"/>', 5), time_limit_s=60
    )
    row = result.rows[0]
    assert row["outcome"] == "timeout" and row["max_decel_mps2"] < 2.5
    assert speeds_on(result, "b")[-1] < 0.1


def test_a_goal_that_sumo_changes_is_reached_at_the_end_of_the_new_route(tmp_path: Path) -> None:
    result = driven(tmp_path, rerouter("b", '<destProbReroute id="g" probability="1"/>'))
    row = result.rows[0]
    assert row["outcome"] == "arrived"
    # along a, b and g
    assert row["free_flow_s"] == pytest.approx(600 / 15, abs=3.0)
    assert 0.0 <= row["time_lost_s"] < 5.0


def test_in_a_loop_of_the_users_own_the_ego_leaves_a_lane_that_is_closed_under_it(
    tmp_path: Path,
) -> None:
    cfg, lanes = network(tmp_path, ""), []
    libsumo.start(["sumo", "-c", cfg, "--no-step-log", "true", "--no-warnings", "true"])
    try:
        with Controller("ego", FAST) as controller:
            while libsumo.simulation.getTime() < 20.0:
                if round(libsumo.simulation.getTime(), 1) == 5.0:
                    libsumo.lane.setDisallowed("a_0", ["passenger"])
                controller.step()
                libsumo.simulationStep()
                if libsumo.simulation.getTime() > 5.5:
                    assert controller.thought is not None
                    assert controller.thought.decision.reason in {"search", "carried on"}
                if libsumo.vehicle.getIDList():
                    lanes.append(libsumo.vehicle.getLaneID("ego"))
    finally:
        libsumo.close()
    assert "a_1" in lanes
    assert np.unique(lanes[-1:]).tolist() in (["b_0"], ["b_1"], ["c_0"], ["c_1"])
