"""A bend of 12 m radius on a road for 50 km/h, in SUMO: both planners keep to the bound on lateral
acceleration, and without it nothing slows them down, as nothing does SUMO's driver."""

import math
from pathlib import Path

import pytest
from helpers_networks import netconvert

from sumo_mcts import config
from sumo_mcts.episode import run_episode

RADIUS, BEFORE = 12.0, 120.0  # m


def bend(folder: Path) -> str:
    """One lane that turns round by half a circle."""
    angles = [math.radians(k) for k in range(-90, 91, 5)]
    points = [(RADIUS * math.cos(a), RADIUS * (1.0 + math.sin(a))) for a in angles]
    drawn = [(-BEFORE, 0.0), *points, (-BEFORE, 2.0 * RADIUS)]
    shape = " ".join(f"{x:.2f},{y:.2f}" for x, y in drawn)
    nodes = f'<node id="a" x="{-BEFORE}" y="0"/><node id="b" x="{-BEFORE}" y="{2.0 * RADIUS}"/>'
    road = f'<edge id="e" from="a" to="b" speed="13.9" spreadType="center" shape="{shape}"/>'
    return netconvert(folder, nodes, road, "")


@pytest.mark.slow
@pytest.mark.parametrize("planner", ["mcts", "paper"])
@pytest.mark.parametrize("bound", [None, 3.0])
def test_the_bound_holds_in_a_tight_bend(planner: str, bound: float | None, tmp_path: Path) -> None:
    net = bend(tmp_path)
    (tmp_path / "x.rou.xml").write_text(
        '<routes><vType id="car" speedDev="0"/><vehicle id="ego" type="car" depart="0" '
        'departSpeed="13"><route edges="e"/></vehicle></routes>'
    )
    scene = {
        "name": "bend",
        "sumo": {"net": net, "routes": [str(tmp_path / "x.rou.xml")]},
        "egos": [{"id": "ego"}],
        "planner": {"name": planner, "iterations": 200},
        "ego_model": {"max_lateral_accel_mps2": bound},
    }
    result = run_episode(config.build(scene, "test", ()), 0)
    inside = [c.ego.v for c in result.traces[0].cycles if 125.0 < c.ego.s < 155.0]
    assert result.rows[0]["outcome"] == "arrived" and len(inside) > 3
    fastest = max(inside) ** 2 / RADIUS  # m/s2
    assert fastest > 12.0 if bound is None else 2.0 < fastest < 1.1 * bound
    assert result.rows[0]["hard_brakes"] == 0
