"""Junctions without lanes inside, in SUMO: what is read there, and what is refused."""

from pathlib import Path

import libsumo
import pytest
from helpers_networks import car, four_arms, simulation

from sumo_mcts.controller import Controller
from sumo_mcts.errors import ConfigError
from sumo_mcts.numerics.lanes import jumps
from sumo_mcts.world.observe import Change, Observer
from sumo_mcts.world.road_changes import RoadReader
from sumo_mcts.world.roadmap import lane_index, read_roadmap


def test_the_coming_lanes_lead_over_the_junction(tmp_path: Path) -> None:
    """SUMO names no lane there, and is not asked for the limit of one."""
    net = four_arms(tmp_path, "priority", "--no-internal-links", "true")
    road = read_roadmap(net)
    number = lane_index(road)
    (tmp_path / "x.rou.xml").write_text(f'<routes><vType id="car"/>{car("sn", 100.0)}</routes>')
    with simulation(net, [tmp_path / "x.rou.xml"]):
        libsumo.simulationStep()
        observer = Observer(road)
        here, over, onto = observer.coming_lanes("s", number["sc_0"]).tolist()
        assert (here, onto) == (number["sc_0"], number["cn_0"]) and jumps(road)[over]
        libsumo.edge.setMaxSpeed("cn", 5.0)
        changes = RoadReader(libsumo, road).look(observer.ego("s", Change()))
        assert changes.lane.tolist() == [number["cn_0"]]


def test_a_simulation_that_leaves_out_lanes_of_its_network_is_refused(tmp_path: Path) -> None:
    four_arms(tmp_path, "priority")
    libsumo.start(["sumo", "-n", str(tmp_path / "x.net.xml"), "--no-internal-links", "true"])
    try:
        with pytest.raises(ConfigError, match=r"^no-internal-links: .*netconvert -s FILE"):
            Controller("ego")
    finally:
        libsumo.close()
