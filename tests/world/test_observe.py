"""What is read of running vehicles, against what SUMO says of them by other means."""

import math
from pathlib import Path

import libsumo
import pytest
from helpers_networks import netconvert

from sumo_mcts.world.observe import Change, Observer
from sumo_mcts.world.roadmap import read_roadmap

NODES = '<node id="w" x="0" y="0"/><node id="m" x="200" y="0"/><node id="e" x="400" y="0"/>'
EDGES = '<edge id="a" from="w" to="m" numLanes="2" speed="10"/><edge id="b" from="m" to="e" numLanes="2" speed="10"/>'
WAYS = '<connection from="a" to="b" fromLane="0" toLane="0"/><connection from="a" to="b" fromLane="1" toLane="1"/>'
ROUTES = """<routes>
    <vType id="lorry" vClass="trailer" guiShape="truck/trailer" length="16.5"/>
    <vehicle id="ego" depart="0" departLane="0" departPos="50" departSpeed="0"><route edges="b"/></vehicle>
    <vehicle id="lorry" type="lorry" depart="0" departLane="1" departPos="180" departSpeed="8"><route edges="a b"/></vehicle>
</routes>"""


@pytest.mark.parametrize("internal", [True, False], ids=["inside the junction too", "without internal lanes"])
def test_a_lorry_that_changes_lanes_with_its_rear_on_the_edge_before_stays_lengthwise(tmp_path: Path, internal: bool) -> None:
    """Its body is drawn from where its rear is, which is on the lane that it came from and not far down the one beside it."""
    net = netconvert(tmp_path, NODES, EDGES, WAYS, *([] if internal else ["--no-internal-links"]))
    (tmp_path / "x.rou.xml").write_text(ROUTES)
    libsumo.start(["sumo", "-n", net, "-r", str(tmp_path / "x.rou.xml"), "--step-length", "0.1", "--no-step-log", "true", "--no-warnings", "true"])
    try:
        observer, lanes = Observer(read_roadmap(net)), []
        libsumo.simulationStep()
        libsumo.vehicle.setSpeed("ego", 0.0)
        libsumo.vehicle.setLaneChangeMode("lorry", 0)
        while libsumo.simulation.getTime() < 6.0:
            if libsumo.vehicle.getLaneID("lorry") == "b_1" and libsumo.vehicle.getLanePosition("lorry") > 4.0:
                libsumo.vehicle.changeLane("lorry", 0, 5.0)
            libsumo.simulationStep()
            agents = observer.scene("ego", Change(), 300.0, timing=False).agents
            x, y = libsumo.vehicle.getPosition("lorry")
            assert abs(agents.heading[0]) < math.radians(25.0)
            assert math.hypot(agents.x[0] - x, agents.y[0] - y) == pytest.approx(8.25) and agents.x[0] < x
            lanes.append(libsumo.vehicle.getLaneID("lorry"))
        assert lanes.index("b_0") == lanes.index("b_1") + lanes.count("b_1")
    finally:
        libsumo.close()
