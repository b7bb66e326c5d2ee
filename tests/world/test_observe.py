"""What is read of running vehicles, against what SUMO says of them by other means."""

import itertools
import math
from pathlib import Path
from types import SimpleNamespace

import libsumo
import numpy as np
import pytest
from helpers import Lane, build
from helpers_networks import netconvert, simulation

from sumo_mcts.scene import GREEN, RED, YELLOW
from sumo_mcts.world.agents import CHANGED, TREND_S
from sumo_mcts.world.observe import Change, Observer
from sumo_mcts.world.roadmap import read_roadmap
from sumo_mcts.world.signals import PHASES, SignalReader

NODES = '<node id="w" x="0" y="0"/><node id="m" x="200" y="0"/><node id="e" x="400" y="0"/>'
EDGES = (
    '<edge id="a" from="w" to="m" numLanes="2" speed="10"/><edge id="b" from="m" to="e" '
    'numLanes="2" speed="10"/>'
)
WAYS = (
    '<connection from="a" to="b" fromLane="0" toLane="0"/><connection from="a" to="b" '
    'fromLane="1" toLane="1"/>'
)
ROUTES = """<routes>
    <vType id="lorry" vClass="trailer" guiShape="truck/trailer" length="16.5"/>
    <vehicle id="ego" depart="0" departLane="0" departPos="50" departSpeed="0"><route edges="b"/></vehicle>
    <vehicle id="lorry" type="lorry" depart="0" departLane="1" departPos="180" departSpeed="8"><route edges="a b"/></vehicle>
</routes>"""


@pytest.mark.parametrize(
    "internal", [True, False], ids=["inside the junction too", "without internal lanes"]
)
def test_a_lorry_that_changes_lanes_with_its_rear_on_the_edge_before_stays_lengthwise(
    tmp_path: Path, internal: bool
) -> None:
    """Its body is drawn from where its rear is, which is on the lane that it came from and not far
    down the one beside it."""
    net = netconvert(tmp_path, NODES, EDGES, WAYS, *([] if internal else ["--no-internal-links"]))
    (tmp_path / "x.rou.xml").write_text(ROUTES)
    with simulation(net, [tmp_path / "x.rou.xml"]):
        observer, lanes = Observer(read_roadmap(net)), []
        libsumo.simulationStep()
        libsumo.vehicle.setSpeed("ego", 0.0)
        libsumo.vehicle.setLaneChangeMode("lorry", 0)
        while libsumo.simulation.getTime() < 6.0:
            if (
                libsumo.vehicle.getLaneID("lorry") == "b_1"
                and libsumo.vehicle.getLanePosition("lorry") > 4.0
            ):
                libsumo.vehicle.changeLane("lorry", 0, 5.0)
            libsumo.simulationStep()
            agents = observer.scene("ego", Change(), 300.0, timing=False).agents
            x, y = libsumo.vehicle.getPosition("lorry")
            assert abs(agents.heading[0]) < math.radians(25.0)
            assert (
                math.hypot(agents.x[0] - x, agents.y[0] - y) == pytest.approx(8.25)
                and agents.x[0] < x
            )
            lanes.append(libsumo.vehicle.getLaneID("lorry"))
        assert lanes.index("b_0") == lanes.index("b_1") + lanes.count("b_1")


def test_a_lorry_lies_on_all_the_lanes_that_it_has_come_over(tmp_path: Path) -> None:
    """Its rear is where its front was a length of it before, over lanes much shorter than it is."""
    nodes = (
        '<node id="w" x="0" y="0"/><node id="m" x="200" y="0"/><node id="n" x="212" '
        'y="4"/><node id="e" x="300" y="90"/>'
    )
    edges = "".join(
        f'<edge id="{name}" from="{a}" to="{b}" speed="10"/>'
        for name, a, b in (("a", "w", "m"), ("b", "m", "n"), ("c", "n", "e"))
    )
    net = netconvert(
        tmp_path, nodes, edges, '<connection from="a" to="b"/><connection from="b" to="c"/>'
    )
    (tmp_path / "x.rou.xml").write_text(
        """<routes><vType id="lorry" vClass="trailer" guiShape="truck/trailer" length="16.5"/>
        <vehicle id="ego" depart="0" departPos="90"><route edges="c"/></vehicle>
        <vehicle id="lorry" type="lorry" depart="0" departPos="150" departSpeed="6"><route edges="a b c"/></vehicle></routes>"""
    )
    with simulation(net, [tmp_path / "x.rou.xml"]):
        observer, trail, turned = Observer(read_roadmap(net)), [], 0
        libsumo.simulationStep()
        libsumo.vehicle.setSpeed("ego", 0.0)
        while libsumo.simulation.getTime() < 9.0:
            libsumo.simulationStep()
            x, y = libsumo.vehicle.getPosition("lorry")
            trail.append((x, y))
            agents = observer.scene("ego", Change(), 300.0, timing=False).agents
            driven = np.concatenate(
                [[0.0], np.cumsum(np.hypot(*np.diff(np.array(trail), axis=0).T))]
            )
            if driven[-1] < 16.5 + 1.0:
                continue
            rear = [
                np.interp(driven[-1] - 16.5, driven, np.array(trail)[:, axis]) for axis in (0, 1)
            ]
            assert agents.heading[0] == pytest.approx(
                math.atan2(y - rear[1], x - rear[0]), abs=0.06
            )
            turned += 0.1 < agents.heading[0] < 0.7
        assert turned > 10


@pytest.mark.parametrize("kind", ["static", "actuated"])
def test_nobody_knows_when_a_phase_ends_that_the_traffic_ends(tmp_path: Path, kind: str) -> None:
    """Of an actuated signal SUMO tells when it asks its detectors next; yellow lasts as long as its
    program says."""
    nodes = '<node id="C" x="0" y="0" type="traffic_light"/>' + "".join(
        f'<node id="{arm}" x="{x}" y="{y}"/>'
        for arm, x, y in (("W", -200, 0), ("E", 200, 0), ("S", 0, -200), ("N", 0, 200))
    )
    edges = "".join(f'<edge id="{a}{b}" from="{a}" to="{b}"/>' for a, b in ("WC", "CE", "SC", "CN"))
    net = netconvert(
        tmp_path,
        nodes,
        edges,
        '<connection from="WC" to="CE"/><connection from="SC" to="CN"/>',
        "--tls.default-type",
        kind,
    )
    flows = (
        f'<flow id="{a}" begin="0" end="60" period="9"><route edges="{a}C C{b}"/></flow>'
        for a, b in ("WE", "SN")
    )
    (tmp_path / "x.rou.xml").write_text(f"<routes>{''.join(flows)}</routes>")
    libsumo.start(
        [
            "sumo",
            "-n",
            net,
            "-r",
            str(tmp_path / "x.rou.xml"),
            "--no-step-log",
            "true",
            "--no-warnings",
            "true",
        ]
    )
    try:
        observer, said = Observer(read_roadmap(net)), []
        for _ in range(120):
            libsumo.simulationStep()
            said.append(observer.timing(0.0, 0.0))
    finally:
        libsumo.close()
    shown = [signals.state[:, 0] for signals in said]
    for t, signals in enumerate(said):
        ends = next(
            (k for k in range(t, len(shown)) if not np.array_equal(shown[k], shown[t])), None
        )
        if ends is None:
            continue
        first, after = signals.until[0, :2]
        if YELLOW in shown[t] or kind == "static":
            assert first == pytest.approx(ends - t, abs=1.0) and np.array_equal(
                signals.state[:, 1], shown[ends]
            )
            assert (after < np.inf) == (kind == "static")
        else:
            assert GREEN in shown[t] and RED in shown[t]
            assert np.all(np.isinf(signals.until)) and np.array_equal(
                signals.state, np.repeat(shown[t][:, None], PHASES, axis=1)
            )
    assert sum(YELLOW in each for each in shown) > 4


def test_an_acceleration_is_smoothed_until_the_driver_changes_its_mind(tmp_path: Path) -> None:
    """A driver with noise in its speed brakes hard for a while and lets go: what it does now is
    seen at once, the noise is not."""
    net = netconvert(tmp_path, NODES, EDGES, WAYS)
    (tmp_path / "x.rou.xml").write_text(
        """<routes><vType id="noisy" sigma="0.5"/><vehicle id="ego" depart="0" departPos="10" departLane="1"><route edges="a b"/></vehicle>
        <vehicle id="other" type="noisy" depart="0" departPos="5" departSpeed="9" departLane="0"><route edges="a b"/></vehicle></routes>"""
    )
    with simulation(net, [tmp_path / "x.rou.xml"]):
        observer, seen = Observer(read_roadmap(net)), []
        libsumo.simulationStep()
        while libsumo.simulation.getTime() < 10.0:
            if 6.0 <= libsumo.simulation.getTime() < 7.5:
                libsumo.vehicle.setSpeed("other", libsumo.vehicle.getSpeed("other") - 0.4)
            elif libsumo.simulation.getTime() >= 7.5:
                libsumo.vehicle.setSpeed("other", -1.0)
            libsumo.simulationStep()
            agents = observer.scene("ego", Change(), 300.0, timing=False).agents
            assert agents.a[0] == pytest.approx(libsumo.vehicle.getAcceleration("other"))
            seen.append((libsumo.simulation.getTime(), float(agents.a[0]), float(agents.trend[0])))
    for (_, _, before), (_, a, trend) in itertools.pairwise(seen):
        smoothed = before + (a - before) * (1.0 - math.exp(-0.1 / TREND_S))
        assert trend == pytest.approx(a if abs(a - before) > CHANGED else smoothed)
    of = {round(time, 1): (a, trend) for time, a, trend in seen}
    assert of[6.2][1] < -3.0 and of[7.4][1] == pytest.approx(-4.0, abs=0.1)
    assert of[7.7][0] > 1.0 and of[7.7][1] > 0.5  # a memory of half a second would still be at -1.5
    noise = [(a, trend) for time, a, trend in seen if 3.0 < time < 6.0]
    assert np.std(noise, axis=0)[1] < 0.7 * np.std(noise, axis=0)[0]


# --- signals that stand far apart ---


def test_a_signal_is_read_near_each_of_its_links() -> None:
    """One controller for two junctions, 1.4 km apart."""
    ends = [0.0, 700.0, 1400.0, 2100.0]
    lanes = [
        Lane(f"a{k}", 0, ((x, 0.0), (x + 680.0, 0.0)), (f":j{k}_0",))
        for k, x in enumerate(ends[:3])
    ]
    lanes += [
        Lane(
            f":j{k}",
            0,
            ((x + 680.0, 0.0), (x + 700.0, 0.0)),
            (f"a{k + 1}_0",) if k < 2 else (),
            junction=f"j{k}",
            signal="s",
            link=k,
        )
        for k, x in enumerate(ends[:3])
    ]
    traffic_light = SimpleNamespace(getIDList=lambda: ["s"], getRedYellowGreenState=lambda _: "rrr")
    reader = SignalReader(SimpleNamespace(trafficlight=traffic_light), build(lanes))
    read = [
        reader.read(x, 0.0, 0.0, 1).state[:, 0].tolist() for x in (690.0, 2090.0, -400.0, 4000.0)
    ]
    assert read == [[RED] * 3, [RED] * 3, [GREEN] * 3, [GREEN] * 3]
    again = [reader.read(x, 0.0, 1.0, 1).state for x in (690.0, 690.0)]
    assert again[0] is again[1]  # lights that do not change are not laid out again


@pytest.mark.parametrize(("depart", "stood"), [("0", 2.0), ("3", 0.0)])
def test_who_stands_when_first_seen_has_stood_before(
    tmp_path: Path, depart: str, stood: float
) -> None:
    """But for one that SUMO puts there before open eyes. What counts ends with the stand."""
    net = netconvert(tmp_path, NODES, EDGES, WAYS)
    (tmp_path / "x.rou.xml").write_text(
        f"""<routes><vType id="still" sigma="0"/>
        <vehicle id="ego" depart="0" departPos="50" departSpeed="0"><route edges="a b"/></vehicle>
        <vehicle id="x" type="still" depart="{depart}" departLane="1" departPos="80" departSpeed="0"><route edges="a b"/></vehicle>
        </routes>"""
    )
    with simulation(net, [tmp_path / "x.rou.xml"]):
        observer, found, own = Observer(read_roadmap(net)), [], []
        while len(found) < 40:
            libsumo.simulationStep()
            libsumo.vehicle.setSpeed("ego", 0.0)
            if "x" in libsumo.vehicle.getIDList():
                libsumo.vehicle.setSpeed("x", 0.0 if len(found) < 10 else 8.0)
            scene = observer.scene("ego", Change(), 300.0, timing=False)
            found += scene.agents.standing_s.tolist()
            own.append(scene.ego.standing_s)
        assert own[:3] == pytest.approx([0.0, 0.1, 0.2])
        assert found[:10] == pytest.approx(stood + 0.1 * np.arange(10.0), abs=1e-6)
        moving = np.array(found[11:])
        assert moving[0] == pytest.approx(-stood - 1.1, abs=0.11) and moving[-1] == 0.0
