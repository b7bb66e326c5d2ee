"""The bench measures what the table of budgets names; how fast this machine is, it does not judge."""

import numpy as np
import pytest

from sumo_mcts.driver.driver import Driver
from sumo_mcts.studies import bench


@pytest.mark.slow
def test_every_quantity_is_measured() -> None:
    said: list[str] = []
    rows = bench.run(0.05, said.append)
    assert all(
        list(row) == ["quantity", "value", "unit", "ratio", "budget", "ok"]
        and row["value"] > 0
        and row["ratio"] > 0
        for row in rows
    )
    quantities = " ".join(row["quantity"] for row in rows)
    for words in (
        "--help",
        "warm start",
        "5 tabulated agents",
        "50 tabulated agents",
        "3000 iterations",
        "reactive",
        "300 vehicles",
    ):
        assert words in quantities
    assert "first compilation" not in quantities
    assert said[0].startswith("starting")


@pytest.mark.slow
def test_whoever_is_near_reacts() -> None:
    scenario, road = bench._scenario("planner.iterations=50", "planner.reactive=10")
    for seed in range(3):
        scene = bench._scene(road, 10, seed, near=True)
        thought = Driver(scenario, road, bench.PHYSICS, 0).decide(scene)
        assert thought.forecast is not None and thought.forecast.reacts.sum() == 10
        own = [road.edge_ids.index(edge) for edge in bench.EGO_EDGES]
        assert np.isin(road.edge[scene.agents.lane], own).all()


def test_budgets_are_judged_from_their_side() -> None:
    floor, ceiling = (
        bench.Quantity("rate", "1/s", 100.0, at_least=True),
        bench.Quantity("time", "ms", 20.0),
    )
    assert [bench._row(floor, value, 0.02)["ok"] for value in (99.0, 100.0)] == [False, True]
    assert [bench._row(ceiling, value, 0.02)["ok"] for value in (20.0, 20.1)] == [True, False]
    assert bench._row(ceiling._replace(limit=None), 3.0, 0.02)["ok"] is None


def test_a_ratio_is_a_rate_over_the_yardsticks_or_a_time_over_its_time() -> None:
    """20 000 passes in 20 ms are a million a second."""
    rate = bench.Quantity("rate", "1/s", None)
    assert bench._row(rate, 250_000.0, 0.02)["ratio"] == 0.25
    assert bench._row(rate._replace(unit="ms"), 15.0, 0.02)["ratio"] == 0.75
    assert bench._row(rate._replace(unit="s"), 2.0, 0.02)["ratio"] == 100.0
