"""Kinds of situations: their draws, their halves, their texts, their pages."""

from collections import Counter
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import pytest

from sumo_mcts.config import builtin
from sumo_mcts.situations import (
    DENSE,
    FAMILIES,
    HALVES,
    PASSING,
    RULES,
    drawn,
    families,
    plain_files,
    routes,
)
from sumo_mcts.situations.docs import PAGES, refreshed
from sumo_mcts.situations.kind import INTERVALS, parts, source
from sumo_mcts.situations.situation import LEAST_GAP_S, row_per_hour

TOP = Path(__file__).resolve().parents[2]
KINDS = {**DENSE, **RULES, **PASSING}
EVERY = pytest.mark.parametrize("kind", KINDS.values(), ids=lambda kind: kind.name)


def text_of(
    name: str, half: str | None = "development", seed: int = 3, family: str = "krauss"
) -> str:
    """The route file of a seed."""
    kind = KINDS[name]
    situation = kind.build(drawn(kind, half, seed))
    return routes(situation, family, 0.1, source(name, half, seed, "traffic"))


def test_there_are_twelve_kinds_at_least() -> None:
    assert len(DENSE) >= 12


def test_no_name_stands_for_two_kinds() -> None:
    assert len(KINDS) == len(DENSE) + len(RULES) + len(PASSING)


@EVERY
def test_without_a_half_all_of_a_range_is_drawn(kind) -> None:
    draws = [drawn(kind, None, seed) for seed in range(300)]
    for name, bounds in kind.ranges.items():
        found = Counter(
            half for each in draws for half in HALVES
            if any(a <= each[name] < b for a, b in parts(bounds, half))
        )  # fmt: skip
        assert sum(found.values()) == len(draws) and min(found[half] for half in HALVES) > 100


@EVERY
def test_the_halves_share_no_situation(kind) -> None:
    for bounds in kind.ranges.values():
        first, second = (parts(bounds, half) for half in HALVES)
        widths = [sum(high - low for low, high in each) for each in (first, second)]
        assert widths == pytest.approx([(bounds.high - bounds.low) / 2] * 2)
        assert not any(
            min(a[1], b[1]) - max(a[0], b[0]) > 1e-9 * bounds.high for a in first for b in second
        )
        assert len(first) == len(second) == INTERVALS // 2


@EVERY
@pytest.mark.parametrize("half", HALVES)
def test_parameters_lie_in_their_half_and_reach_all_of_it(kind, half) -> None:
    draws = [drawn(kind, half, seed) for seed in range(300)]
    for name, bounds in kind.ranges.items():
        intervals = parts(bounds, half)
        found = Counter(
            k for each in draws for k, (a, b) in enumerate(intervals) if a <= each[name] < b
        )
        assert sum(found.values()) == len(draws) and min(found[k] for k in range(4)) > 40


@EVERY
@pytest.mark.parametrize("half", HALVES)
def test_a_seed_makes_the_same_files_again_and_another_seed_others(kind, half) -> None:
    made = [
        (plain_files(kind.build(drawn(kind, half, seed))), text_of(kind.name, half, seed))
        for seed in (3, 3, 4)
    ]
    assert made[0] == made[1]
    assert made[0][1] != made[2][1]


def test_a_draw_is_the_same_with_every_python() -> None:
    values = drawn(KINDS["ramp"], "development", 7)
    assert {name: round(value, 6) for name, value in values.items()} == {
        "gap": 51.910209,
        "length": 242.187303,
        "merging": 158.319137,
        "speed": 25.76357,
        "trucks": 0.006847,
    }


@EVERY
def test_routes_are_in_the_order_of_departure_with_one_ego_among_traffic(kind) -> None:
    root = ElementTree.fromstring(text_of(kind.name))
    times = [float(each.get("depart", "")) for each in root if each.tag != "vType"]
    assert times == sorted(times)
    (ego,) = (each for each in root.iter("vehicle") if each.get("id") == "ego")
    before = sum(time < float(ego.get("depart", "")) for time in times)
    assert before >= (1 if kind.name in PASSING else 8)


@EVERY
def test_every_route_is_of_edges_that_there_are(kind) -> None:
    situation = kind.build(drawn(kind, "development", 0))
    ends = {edge.id: (edge.start, edge.end) for edge in situation.edges}
    for route in (situation.ego_route, *(stream.route for stream in situation.streams)):
        edges = route.split()
        walking = all(stream.vtype == "pedestrian" for stream in situation.streams
                      if stream.route == route)  # fmt: skip
        assert walking or all(ends[a][1] == ends[b][0] for a, b in pairwise(edges))


def test_a_stream_has_the_demand_that_was_drawn() -> None:
    kind = KINDS["lane-drop"]
    for seed in range(5):
        demand = drawn(kind, "development", seed)["demand"]
        count = text_of("lane-drop", seed=seed).count("<vehicle") - 1
        assert count == pytest.approx(demand * 480 / 3600, abs=4 * (demand * 480 / 3600) ** 0.5)


def test_gaps_of_a_row_stay_near_their_mean() -> None:
    kind, seed = KINDS["ramp"], 0
    values = drawn(kind, "development", seed)
    root = ElementTree.fromstring(text_of("ramp", seed=seed))
    times = [float(each.get("depart", "")) for each in root if each.get("id", "").startswith("0.")]
    mean = 3600 / row_per_hour(values["gap"], values["speed"])
    assert mean >= LEAST_GAP_S
    assert all(0.59 * mean < b - a < 1.41 * mean for a, b in pairwise(times))


def test_a_family_is_in_all_types_but_the_ego_and_those_without_motor() -> None:
    assert len(FAMILIES) == 6 and len(families.HELD_APART) == 3
    for family in FAMILIES:
        root = ElementTree.fromstring(text_of("crossing", family=family))
        said = {
            each.get("id"): (each.get("carFollowModel"), each.get("laneChangeModel"))
            for each in root.iter("vType")
        }
        assert said["car"] == said["truck"] == said["van"]
        assert said["ego"] == said["bicycle"] == said["pedestrian"] == (None, None)
        assert (said["car"] == (None, None)) == (family == "krauss")


def test_only_the_family_differs_between_families() -> None:
    texts = {
        tuple(line for line in text_of("zipper", family=family).splitlines() if "vType" not in line)
        for family in FAMILIES
    }
    assert len(texts) == 1


def test_every_kind_is_a_scenario() -> None:
    for group, kinds in (("dense-", DENSE), ("rule-", RULES), ("passing-", PASSING)):
        names = {name for name in builtin.scenario_names() if name.startswith(group)}
        assert names == {f"{group}{name}" for name in kinds}


@pytest.mark.parametrize("page", PAGES)
def test_the_page_is_up_to_date(page: str) -> None:
    text = (TOP / "docs" / page).read_text(encoding="utf-8")
    assert text == refreshed(page, text), "run python -m sumo_mcts.situations.docs"
