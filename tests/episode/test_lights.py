"""At a light in SUMO: a planner that stands at green, and yellow that comes at any moment."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers_networks import netconvert

from sumo_mcts import config
from sumo_mcts.episode import run_episode
from sumo_mcts.planners.base import Situation, Task
from sumo_mcts.scene import Decision, Follow

RED_S, STANDS_S = 35, 50  # when the light turns green; when the idle planner drives on
NODES = (
    '<node id="w" x="0" y="0"/><node id="m" x="150" y="0" type="traffic_light"/>'
    '<node id="e" x="300" y="0"/><node id="s" x="150" y="-150"/>'
)
EDGES = (
    '<edge id="a" from="w" to="m" speed="10"/><edge id="b" from="m" to="e" speed="10"/>'
    '<edge id="c" from="s" to="m" speed="10"/>'
)
WAYS = '<connection from="a" to="b"/><connection from="c" to="b"/>'
ROUTES = (
    '<routes><vType id="car" sigma="0"/>'
    '<trip id="one" type="car" depart="0" from="a" to="b"/>'
    '<trip id="two" type="car" depart="3" from="a" to="b"/></routes>'
)


class Idle:
    """Drives up to the line, or to the vehicle ahead, and stands there until a time."""

    needs_forecast = False

    def __init__(self, options: dict[str, Any], scenario: config.ScenarioConfig) -> None:
        self._period = scenario.planner.period_s

    def start(self, task: Task, seed: int) -> None:
        self._task = task

    def plan(self, situation: Situation) -> Decision:
        scene = situation.scene
        ego, agents, step = scene.ego, scene.agents, scene.step
        way = 1e3
        if scene.time < STANDS_S and not self._task.road.internal[ego.lane]:
            way = float(self._task.road.length[ego.lane]) - ego.s - 1.0
        ahead = (agents.lane == ego.lane) & (agents.s > ego.s)
        way = min([way, *(agents.s - agents.length - ego.s)[ahead] - 2.5])
        v, speeds = ego.v, []
        for _ in range(round(self._period / step)):
            v = min(v + 2.0 * step, 10.0, (4.0 * max(way, 0.0)) ** 0.5)
            v = v if way > 0.05 else 0.0
            way -= v * step
            speeds.append(v)
        return Decision(Follow(np.array(speeds), 0), None, (), -1, "idle", 0, 0)


def driven(folder: Path, planner: str, phases: str, *egos: str) -> list[dict[str, Any]]:
    """The rows of these egos before a light with these phases."""
    netconvert(folder, NODES, EDGES, WAYS)
    (folder / "x.rou.xml").write_text(ROUTES)
    (folder / "x.add.xml").write_text(
        f'<additional><tlLogic id="m" type="static" programID="own" offset="0">{phases}</tlLogic>'
        "</additional>"
    )
    (folder / "x.sumocfg").write_text(
        '<configuration><net-file value="x.net.xml"/><route-files value="x.rou.xml"/>'
        '<additional-files value="x.add.xml"/><step-length value="0.1"/></configuration>'
    )
    scene = {
        "name": "light",
        "sumo": {"sumocfg": str(folder / "x.sumocfg")},
        "egos": [{"id": ego} for ego in egos],
        "planner": {"name": planner},
    }
    return list(run_episode(config.build(scene, "test", (), allow_plugins=True), 1).rows)


TURNS_GREEN = f'<phase duration="{RED_S}" state="rr"/><phase duration="200" state="GG"/>'
PERMISSIVE = f'<phase duration="{RED_S}" state="rr"/><phase duration="200" state="gg"/>'
TURNS_OFF = f'<phase duration="{RED_S}" state="rr"/><phase duration="200" state="OO"/>'
IDLE = f"{__name__}:Idle"


def test_sumo_s_driver_stands_at_red_alone(tmp_path: Path) -> None:
    for row in driven(tmp_path, "sumo", TURNS_GREEN, "one", "two"):
        assert row["outcome"] == "arrived"
        assert row["stopped_at_green_s"] == 0.0
        assert row["stopped_s"] == pytest.approx(row["longest_stop_s"])
        assert row["longest_stop_s"] < RED_S
        assert row["time_lost_s"] == pytest.approx(row["travel_time_s"] - row["free_flow_s"])
        assert row["time_lost_s"] > row["longest_stop_s"] > 0.0


@pytest.mark.parametrize("phases", [TURNS_GREEN, PERMISSIVE])
def test_an_ego_that_stays_stands_at_green_and_the_one_behind_it_does_not(
    phases: str, tmp_path: Path
) -> None:
    first, second = driven(tmp_path, IDLE, phases, "one", "two")
    assert (first["outcome"], second["outcome"]) == ("arrived", "arrived")
    assert first["stopped_at_green_s"] == pytest.approx(STANDS_S - RED_S, abs=0.31)
    assert first["longest_stop_s"] > first["stopped_at_green_s"]
    assert second["stopped_at_green_s"] == 0.0
    assert second["longest_stop_s"] > STANDS_S - RED_S


def test_a_light_that_goes_out_is_not_green(tmp_path: Path) -> None:
    (row,) = driven(tmp_path, IDLE, TURNS_OFF, "one")
    assert row["outcome"] == "arrived"
    assert row["longest_stop_s"] > STANDS_S - RED_S
    assert row["stopped_at_green_s"] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("yellow_s", [13.0, 14.0, 14.5, 15.0, 15.5, 16.0])
def test_yellow_is_passed_as_by_sumo_s_driver(yellow_s: float, tmp_path: Path) -> None:
    """An ego that knows when yellow comes does not brake for it before, where it may be passed."""
    phases = (
        f'<phase duration="{yellow_s}" state="GG"/><phase duration="3" state="yy"/>'
        '<phase duration="60" state="rr"/><phase duration="200" state="GG"/>'
    )
    (ego,) = driven(tmp_path, "mcts", phases, "one")
    (twin,) = driven(tmp_path, "sumo", phases, "one")
    assert (ego["red_lights_run"], ego["yellow_run"]) == (0, 0)
    assert ego["travel_time_s"] < twin["travel_time_s"] + 1.0
