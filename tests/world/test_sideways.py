"""How a vehicle is moved within its lane where SUMO divides lanes."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import libsumo
import numpy as np
import pytest
from helpers_networks import netconvert

from sumo_mcts.scene import EgoState, Follow, Sideways
from sumo_mcts.world.command import Bounds, Commander
from sumo_mcts.world.observe import Change, Observer
from sumo_mcts.world.roadmap import read_roadmap

STEP, WIDTH = 0.1, 4.5
NODES = '<node id="a" x="0" y="0"/><node id="b" x="600" y="0"/>'


def edges(width: float, lanes: int = 2) -> str:
    """Lanes of this width, m, side by side."""
    return f'<edge id="ab" from="a" to="b" numLanes="{lanes}" speed="13.9" width="{width}"/>'


class Ego:
    """An ego at 10 m/s on the right lane, under command."""

    def __init__(self, net: str) -> None:
        self.road = read_roadmap(net)
        self.observer = Observer(self.road)
        bounds = Bounds(STEP, 4.2, 2.6, 8.0, 20.0)  # as driver/params.py has it
        self.commander = Commander("ego", self.road, self.observer.lanes, bounds)

    def go(self, seconds: float, side: int = 0, shift: float = 0.0) -> None:
        """Drive on, and at once change lanes or move so far to the left."""
        self.commander.accept(Follow(np.full(200, 10.0), side, shift=shift))
        for _ in range(round(seconds / STEP)):
            self.step()

    def step(self) -> None:
        """One step of SUMO."""
        self.commander.before_step()
        libsumo.simulationStep()

    def state(self) -> EgoState:
        """Where it is now."""
        return self.observer.ego("ego", Change())

    def left(self) -> float:
        """m to the left of the middle of the rightmost lane."""
        state = self.state()
        return WIDTH * int(self.road.index[state.lane]) + state.d


@contextmanager
def ego_in(
    folder: Path,
    *options: str,
    more: tuple[str, ...] = ("--lateral-resolution", "0.8"),
    kind: str = "",
    edges: str = edges(WIDTH),
) -> Iterator[Ego]:
    """SUMO with an ego, on a network made with these `options` of netconvert."""
    net = netconvert(folder, NODES, edges, "", *options)
    (folder / "x.rou.xml").write_text(
        f'<routes><vType id="t" {kind}/><vehicle id="ego" type="t" depart="0" departPos="20" '
        'departLane="0" departSpeed="10"><route edges="ab"/></vehicle></routes>'
    )
    files = ["-n", net, "-r", str(folder / "x.rou.xml"), "--step-length", str(STEP)]
    libsumo.start(["sumo", *files, *more, "--no-step-log", "--no-warnings"])
    try:
        libsumo.simulationStep()
        yield Ego(net)
    finally:
        libsumo.close()


@pytest.mark.parametrize("lanes", [1, 2])
@pytest.mark.parametrize("options", [(), ("--lefthand",)], ids=["right", "lefthand"])
@pytest.mark.parametrize("shift", [0.9, -0.7])
def test_it_moves_to_its_place_and_stays(
    shift: float, options: tuple[str, ...], lanes: int, tmp_path: Path
) -> None:
    with ego_in(tmp_path, *options, edges=edges(WIDTH, lanes)) as ego:
        middle = ego.state().y  # it drives to the east
        ego.go(0.5, shift=shift)
        assert 0.0 < ego.state().d / shift < 0.5  # gently
        ego.go(3.0)
        assert ego.state().d == pytest.approx(shift, abs=0.02)
        assert ego.state().y - middle == pytest.approx(shift, abs=0.02)
        ego.go(1.0, shift=-ego.state().d)
        ego.go(2.0)
        assert ego.state().d == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize("after_s", [0.3, 1.0, 4.0])
def test_a_lane_change_on_the_way_is_made(after_s: float, tmp_path: Path) -> None:
    """SUMO drops the wish for one while the vehicle moves aside."""
    with ego_in(tmp_path) as ego:
        ego.go(after_s, shift=1.0)
        ego.go(6.0, side=1)
        assert ego.state().lane == 1 and ego.left() > WIDTH - 1.4


@pytest.mark.parametrize("width", [3.2, 6.5])
def test_a_change_is_under_way_until_it_is_on_the_other_lane(width: float, tmp_path: Path) -> None:
    """SUMO goes aside with 1 m/s: over a wide lane for longer than a change takes elsewhere."""
    with ego_in(tmp_path, edges=edges(width)) as ego:
        ego.go(0.0, side=1)
        for _ in range(100):
            ego.step()
            if ego.state().lane == 1:
                break
            assert ego.commander.change.target == 1
        assert ego.state().lane == 1


@pytest.mark.parametrize("beside", [-2.0, 0.0, 3.0])
def test_a_change_is_made_beside_another_vehicle(beside: float, tmp_path: Path) -> None:
    """A wish for a lane is dropped where SUMO's driver would not change; whether there is room is
    the planner's affair."""
    with ego_in(tmp_path) as ego:
        libsumo.vehicle.add(
            "x", "", "t", departLane="1", departPos=str(20.0 + beside), departSpeed="10"
        )
        libsumo.vehicle.setRoute("x", ["ab"])
        libsumo.simulationStep()
        libsumo.vehicle.setSpeedMode("x", 0)
        libsumo.vehicle.setSpeed("x", 10.0)
        ego.go(3.0, side=1)
        assert ego.left() > 0.5 * WIDTH


@pytest.mark.parametrize("options", [(), ("--lefthand",)], ids=["right", "lefthand"])
@pytest.mark.parametrize("after_s", [0.3, 0.7, 1.1])
def test_a_change_can_be_given_up(after_s: float, options: tuple[str, ...], tmp_path: Path) -> None:
    """It ends in the middle of its lane, and does not come half way into the other."""
    with ego_in(tmp_path, *options) as ego:
        inwards, home = -1 if options else 1, ego.left()  # from the outermost lane
        ego.go(after_s, side=inwards)
        begun = ego.commander.change
        ego.go(0.0, side=-inwards)
        assert (ego.commander.change.source, ego.commander.change.target) == begun[:0:-1]
        under_way, furthest = [], 0.0
        for _ in range(45):
            ego.step()
            furthest = max(furthest, abs(ego.left() - home))
            under_way.append(ego.commander.change.target >= 0 or abs(ego.left() - home) < 0.05)
        assert all(under_way)  # it counts as changing until it is in the middle again
        assert furthest < 0.35 * WIDTH and ego.left() == pytest.approx(home, abs=0.02)
        assert ego.commander.change == Change()


def test_a_change_that_has_come_too_far_goes_on(tmp_path: Path) -> None:
    with ego_in(tmp_path) as ego:
        ego.go(2.2, side=1)
        begun = ego.commander.change
        ego.go(0.0, side=-1)
        assert ego.commander.change == begun
        ego.go(6.0)
        assert ego.state().lane == 1


@pytest.mark.parametrize("more", [(), ("--lateral-resolution", "0.8")], ids=["plain", "divided"])
def test_a_change_that_is_asked_for_again_is_not_given_up(
    more: tuple[str, ...], tmp_path: Path
) -> None:
    with ego_in(tmp_path, more=more) as ego:
        ego.go(0.3, side=1)
        ego.go(6.0, side=1)
        assert ego.state().lane == 1


def test_what_the_type_says(tmp_path: Path) -> None:
    with ego_in(tmp_path, kind='latAlignment="right" minGapLat="0.4" maxSpeedLat="0.8"') as ego:
        assert ego.state().sideways == pytest.approx(Sideways(0.8, 0.4, 0.5 * (1.8 - WIDTH)))
    with ego_in(tmp_path, kind='latAlignment="compact"') as ego:
        ego.go(3.0, shift=0.5)
        assert ego.state().sideways.wish == ego.state().d  # no place of its own


def test_where_lanes_are_not_divided_nothing_moves(tmp_path: Path) -> None:
    with ego_in(tmp_path, more=()) as ego:
        ego.go(3.0, shift=1.0)
        assert ego.state().sideways == Sideways() and ego.state().d == 0.0
