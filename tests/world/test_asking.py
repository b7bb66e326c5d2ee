"""Asking for room: others make it as for SUMO's own drivers, and speed and change stay ours."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import libsumo
import numpy as np
import pytest
from helpers_networks import netconvert, simulation

from sumo_mcts.scene import Follow, Release
from sumo_mcts.world.command import Bounds, Commander
from sumo_mcts.world.observe import Observer
from sumo_mcts.world.roadmap import lane_index, read_roadmap

STEP, CHANGE_S = 0.1, 3.0
OWN = {"lcStrategic": "0.50", "lcAssertive": "1.25"}  # of the ego's type
# a road of two lanes, of which the right one ends
NODES = '<node id="a" x="0" y="0"/><node id="b" x="500" y="0"/><node id="c" x="900" y="0"/>'
EDGES = (
    '<edge id="in" from="a" to="b" numLanes="2" speed="20"/>'
    '<edge id="out" from="b" to="c" numLanes="1" speed="20"/>'
)
JOINED = '<connection from="in" to="out" fromLane="1" toLane="0"/>'


class Asks:
    """An ego at 15 m/s on the lane that ends, under command, and a car at `beside` (m from the
    start of its lane, m/s) on the other one."""

    def __init__(self, net: str) -> None:
        road = read_roadmap(net)
        bounds = Bounds(STEP, CHANGE_S, 2.6, 8.0, 20.0)
        self.commander = Commander("ego", road, Observer(road).lanes, bounds)
        self.hardest = 0.0  # braking of the other, m/s2

    def go(self, seconds: float, side: int = 0, asks: int = 0, v: float = 15.0) -> None:
        """Drive on with a speed, and ask on a side."""
        for k in range(round(seconds / STEP)):
            if k % 5 == 0:
                self.commander.accept(Follow(np.full(8, v), side if k == 0 else 0, asks))
            self.commander.before_step()
            libsumo.simulationStep()
            self.commander.notice()
            assert libsumo.vehicle.getSpeed("ego") == pytest.approx(v, abs=1e-9)
            self.hardest = min(self.hardest, libsumo.vehicle.getAcceleration("other"))


@contextmanager
def beside(
    folder: Path, at: float, v: float, change_s: float = CHANGE_S, model: str = "LC2013"
) -> Iterator[Asks]:
    """The ego at 100 m and another car, on the road together."""
    net = netconvert(folder, NODES, EDGES, JOINED)
    own = " ".join(f'{key}="{value}"' for key, value in OWN.items())
    (folder / "x.rou.xml").write_text(
        f'<routes><vType id="ego" laneChangeModel="{model}" {own}/><vType id="other" sigma="0" speedDev="0"/>'
        f'<vehicle id="ego" type="ego" depart="0" departLane="0" departPos="100" departSpeed="15" '
        'insertionChecks="none"><route edges="in out"/></vehicle>'
        f'<vehicle id="other" type="other" depart="0" departPos="{at}" departSpeed="{v}" '
        'departLane="1" insertionChecks="none"><route edges="in out"/></vehicle></routes>'
    )
    with simulation(net, [folder / "x.rou.xml"], STEP, change_s):
        libsumo.simulationStep()
        yield Asks(net)


def gap() -> float:
    """m from the other's front to the ego's rear."""
    places = [libsumo.vehicle.getLanePosition(name) for name in ("ego", "other")]
    return float(places[0] - 5.0 - places[1])


def settings() -> tuple[int, dict[str, str]]:
    """The ego's lane change mode, and what it wants."""
    get = libsumo.vehicle.getParameter
    return libsumo.vehicle.getLaneChangeMode("ego"), {
        key: get("ego", f"laneChangeModel.{key}") for key in OWN
    }


@pytest.mark.parametrize("asks", [0, 1])
def test_a_follower_makes_room_where_it_is_asked(asks: int, tmp_path: Path) -> None:
    with beside(tmp_path, at=98.0, v=15.0) as ego:
        ego.go(8.0, asks=asks)
        assert libsumo.vehicle.getLaneID("ego") == "in_0"
        assert (gap() > 5.0) == (asks == 1)
        assert ego.hardest > -4.6  # their own comfortable braking, for half a second
        assert libsumo.vehicle.getSpeed("other") > 11.0


def test_people_see_that_it_asks(tmp_path: Path) -> None:
    with beside(tmp_path, at=98.0, v=15.0) as ego:
        ego.go(1.0)
        assert libsumo.vehicle.getSignals("ego") & 3 == 0
        ego.go(1.0, asks=1)
        assert libsumo.vehicle.getSignals("ego") & 3 == 2
        ego.go(1.0)
        assert libsumo.vehicle.getSignals("ego") & 3 == 0


def test_the_change_is_made_at_our_command_alone(tmp_path: Path) -> None:
    with beside(tmp_path, at=98.0, v=15.0) as ego:
        ego.go(8.0, asks=1)
        assert ego.commander.change.target < 0
        ego.go(1.0, side=1)
        assert ego.commander.change.progress == pytest.approx(1.0 / 3.0)
        ego.go(2.5)
        assert libsumo.vehicle.getLaneID("ego") == "in_1"


def test_what_it_wanted_before_is_given_back(tmp_path: Path) -> None:
    with beside(tmp_path, at=98.0, v=15.0) as ego:
        before = settings()
        assert before[1] == OWN
        ego.go(0.5, asks=0)
        assert settings() == (0, OWN)
        ego.go(0.5, asks=1)
        assert settings()[0] == 1 and settings()[1] != OWN
        ego.go(0.5, asks=0)
        assert settings() == (0, OWN)
        ego.go(0.5, asks=1)
        ego.commander.accept(Release())
        assert settings() == before


def test_a_mode_set_while_it_asks_is_given_back(tmp_path: Path) -> None:
    with beside(tmp_path, at=98.0, v=15.0) as ego:
        ego.go(0.5, asks=1)
        libsumo.vehicle.setLaneChangeMode("ego", 512)
        ego.go(0.5, asks=1)
        assert settings()[0] == 1
        ego.commander.release()
        assert settings() == (512, OWN)


@pytest.mark.parametrize("change_s", [0.0, 2 * STEP, CHANGE_S])
def test_a_change_that_nobody_brakes_for_may_be_sumos_and_is_noticed(
    change_s: float, tmp_path: Path
) -> None:
    with beside(tmp_path, at=40.0, v=2.0, change_s=change_s) as ego:
        ego.commander._bounds = ego.commander._bounds._replace(change_duration=change_s)
        ego.go(1.0, asks=1)
        if change_s == CHANGE_S:
            assert settings() == (0, OWN)
            assert ego.commander.change.source < ego.commander.change.target
            assert 0.2 < ego.commander.change.progress < 0.4
            ego.go(2.5)
        assert libsumo.vehicle.getLaneID("ego") == "in_1"
        assert ego.commander.change.target < 0
        assert ego.hardest > -0.5


def test_a_lane_change_model_without_a_wish_asks_nobody(tmp_path: Path) -> None:
    with beside(tmp_path, at=98.0, v=15.0, model="DK2008") as ego:
        ego.go(8.0, asks=1)
        assert libsumo.vehicle.getLaneChangeMode("ego") == 0
        assert libsumo.vehicle.getLaneID("ego") == "in_0"
        assert gap() < 5.0


def test_a_change_that_is_past_its_middle_when_it_is_noticed_leads_to_the_lane_asked(
    tmp_path: Path,
) -> None:
    """With a duration of two steps SUMO has the ego on the new lane by then."""
    with beside(tmp_path, at=40.0, v=2.0, change_s=2 * STEP) as ego:
        ego.commander._bounds = ego.commander._bounds._replace(change_duration=2 * STEP)
        changes = set()
        for _ in range(10):
            ego.go(STEP, asks=1)
            change = ego.commander.change
            changes |= {(change.source, change.target)} if change.target >= 0 else set()
        lanes = [lane_index(ego.commander._road)[name] for name in ("in_0", "in_1")]
        assert changes <= {tuple(lanes)}
        assert libsumo.vehicle.getLaneID("ego") == "in_1"


def test_what_is_asked_is_known_and_nothing_where_the_model_has_no_wish(tmp_path: Path) -> None:
    for model, asked in (("LC2013", 1), ("DK2008", 0)):
        with beside(tmp_path, at=98.0, v=15.0, model=model) as ego:
            ego.go(0.5, asks=1)
            assert (ego.commander.asks, ego.commander.can_ask) == (asked, asked == 1)
            ego.go(0.5)
            assert ego.commander.asks == 0
