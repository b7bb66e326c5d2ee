"""Emergency vehicles with blue light: SUMO tells the vehicles near them to make room, and sets their
lane-change modes; the ego keeps its own."""

from pathlib import Path

import libsumo
import pytest
from helpers_pairs import Case, drives_as_its_twin, written

from sumo_mcts import Controller

pytestmark = pytest.mark.slow

ROUTES = """
<vType id="car"/>
<vType id="rescue" vClass="emergency" guiShape="emergency" speedFactor="1.5">
    <param key="has.bluelight.device" value="true"/>
</vType>
<route id="r" edges="ab bc cd"/>
<flow id="f" type="car" route="r" begin="0" end="40" period="3" departLane="random" departSpeed="max"/>
<vehicle id="ego" type="car" route="r" depart="10" departLane="1" departSpeed="max"/>
<vehicle id="first" type="rescue" route="r" depart="16" departLane="best" departSpeed="max"/>
<vehicle id="second" type="rescue" route="r" depart="22" departLane="best" departSpeed="max"/>
"""


SUBLANE = '<lateral-resolution value="0.4"/>'


def case_with(more: str) -> Case:
    """A road with a light, two emergency vehicles behind the ego; `more` options of SUMO."""
    return Case(
        nodes='<node id="a" x="0" y="0"/><node id="b" x="300" y="0" type="traffic_light"/>'
        '<node id="c" x="600" y="0"/><node id="d" x="800" y="0"/><node id="e" x="300" y="200"/>',
        edges='<edge id="ab" from="a" to="b" numLanes="2"/><edge id="bc" from="b" to="c" numLanes="2"/>'
        '<edge id="cd" from="c" to="d" numLanes="2"/><edge id="eb" from="e" to="b"/>',
        connections="",
        routes=ROUTES,
        sumo=f'<step-length value="0.2"/>{more}',
    )


@pytest.mark.parametrize("more", [SUBLANE, ""], ids=["sublane", "lanes"])
def test_an_emergency_vehicle_behind(more: str, tmp_path: Path) -> None:
    ego = drives_as_its_twin(tmp_path, case_with(more))
    assert ego["max_decel_mps2"] < 4.6


def test_what_sumo_sets_is_set_back_before_the_next_step(tmp_path: Path) -> None:
    written(tmp_path, case_with(SUBLANE))
    options = ["--no-step-log", "--no-warnings", "--collision.mingap-factor", "0"]
    libsumo.start(["sumo", "-c", str(tmp_path / "a.sumocfg"), *options])
    get, held, modes = libsumo.vehicle, set(), set()
    try:
        with Controller("ego", {"planner": {"iterations": 50}}) as controller:
            for _ in range(250):
                controller.step()
                if controller.driving:
                    held.add((get.getSpeedMode("ego"), get.getLaneChangeMode("ego")))
                libsumo.simulationStep()
                if held:
                    modes.add(get.getLaneChangeMode("ego"))
    finally:
        libsumo.close()
    assert held == {(0, 0)}
    assert len(modes) > 1  # SUMO did set another one
