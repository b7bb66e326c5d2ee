"""Roads with slow traffic to pass: what is drawn stands in the files, and the ego gets past."""

from random import Random
from xml.etree import ElementTree

import pytest

from sumo_mcts.config import builtin, load
from sumo_mcts.episode.run import run_episode
from sumo_mcts.situations import PASSING, drawn, plain_files, routes
from sumo_mcts.situations.passing import BESIDE, VAN

MOST = 1.2  # travel time over SUMO's driver's, in each
SEEDS = range(60)


def texts_of(kind: str, values: dict[str, float]) -> tuple[dict[str, str], ElementTree.Element]:
    """The files of the network, and the routes."""
    situation = PASSING[kind].build(values)
    files = plain_files(situation)
    return files, ElementTree.fromstring(routes(situation, "krauss", 0.1, Random("traffic")))


@pytest.mark.parametrize("kind", PASSING)
def test_every_choice_is_drawn_by_some_seed(kind: str) -> None:
    draws = [drawn(PASSING[kind], None, seed) for seed in SEEDS]
    for name, bounds in PASSING[kind].ranges.items():
        found = {bounds.chosen(values, name) for values in draws} if bounds.choices else set()
        assert found == set(bounds.choices)


def test_those_ahead_depart_so_early_that_they_are_ahead() -> None:
    for seed in SEEDS:
        values = drawn(PASSING["oncoming-lane"], None, seed)
        ahead = PASSING["oncoming-lane"].ranges["ahead"].chosen(values, "ahead")
        _, root = texts_of("oncoming-lane", values)
        depart = {each.get("id"): float(each.get("depart", "nan")) for each in root}
        row = [depart["ego"] - depart[name] for name in depart if name and name.startswith("with")]
        first = values["distance"] / (0.6 * values["speed"])
        assert ("van.0" in depart) == (ahead == "parked van")
        assert len(row) == {"two cars": 2, "four cars": 4, "parked van": 0}.get(ahead, 1)
        assert all(first <= before + 0.02 for before in row)


def test_a_road_in_bends_is_as_long_there_as_back() -> None:
    kind = PASSING["oncoming-lane"]
    values = {**drawn(kind, None, 0), "course": 2.5, "edges": 3.5}
    edges = ElementTree.fromstring(texts_of("oncoming-lane", values)[0]["edge-files"])
    shapes = {each.get("id"): each.get("shape", "").split() for each in edges}
    assert [len(shapes[f"e{k}"]) > 10 for k in range(4)] == [True] * 4
    assert all(shapes[f"o{k}"] == shapes[f"e{k}"][::-1] for k in range(4))


def test_a_van_stands_at_the_edge_of_a_wide_lane_and_partly_beside_it() -> None:
    values = {**drawn(PASSING["wide-lane"], None, 0), "ahead": 3.5, "width": 5.0}
    files, root = texts_of("wide-lane", values)
    (van,) = (each for each in root if each.get("id") == "van.0")
    stop = van.find("stop")
    assert stop is not None and stop.get("posLat") == van.get("departPosLat")
    assert float(stop.get("posLat", "")) - VAN / 2 == pytest.approx(-2.5 - BESIDE, abs=0.01)
    assert 'width="5.00"' in files["edge-files"]


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seed"), [("oncoming-lane", 5), ("wide-lane", 6)])
def test_the_ego_passes_as_soon_as_sumos_driver(kind: str, seed: int) -> None:
    ego, twin = (
        run_episode(
            load(builtin.scenario_path(f"passing-{kind}"), (f"planner.name={planner}",)), seed
        ).rows[0]
        for planner in ("mcts", "sumo")
    )
    assert ego["outcome"] == twin["outcome"] == "arrived", ego["error"]
    assert (ego["collisions"], ego["imposed_brakes_4"]) == (0, 0)
    assert ego["travel_time_s"] < MOST * twin["travel_time_s"]
