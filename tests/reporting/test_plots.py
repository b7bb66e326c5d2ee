"""The figures show the numbers: axes keep the order, marks are in place, no variant is missing."""

import re
from importlib import resources
from typing import Any
from xml.etree import ElementTree

import pytest
from helpers_rows import crashed, made_row, made_rows
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts.records.statistics import Rate, wilson
from sumo_mcts.reporting import plots
from sumo_mcts.reporting.plots import Distribution
from sumo_mcts.reporting.svg import Axis, decades, ticks
from sumo_mcts.reporting.variants import FURTHER, KNOWN, colours, planner_style

TTC = Distribution("min_ttc_s", "TTC", logarithmic=True)


def spread(rows: list[dict[str, Any]]) -> str:
    return plots.spread_figure(rows, TTC, colours(rows))


@given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6))
def test_ticks_are_round_within_and_neither_few_nor_many(low: float, width: float) -> None:
    found = ticks(low, low + width)
    assert 2 <= len(found) <= 6
    slack = 1e-6 * (abs(low) + width)
    assert all(low - slack <= tick <= low + width + slack for tick in found)
    assert found == sorted(set(found))


@given(st.floats(0.02, 1e4), st.floats(1.5, 1e5))
def test_decades_lie_within(low: float, times: float) -> None:
    assert all(low <= tick <= low * times for tick in decades(low, low * times))
    assert len(decades(low, low * times)) < 16


@given(st.lists(st.floats(0.02, 100.0), min_size=2, max_size=9), st.booleans())
def test_an_axis_keeps_the_order(values: list[float], logarithmic: bool) -> None:
    axis = Axis(0.02, 100.0, 0.0, 500.0, logarithmic)
    places = [axis.at(value) for value in sorted(values)]
    assert places == sorted(places)
    assert (axis.at(0.02), axis.at(100.0), axis.at(1e9)) == (0.0, 500.0, 500.0)


def test_a_sweep_is_what_differs_in_iterations_alone() -> None:
    rows = [*made_rows(6), made_row(variant="other")]
    rows += [
        made_row(variant=f"paper-iterations-{n}", planner="paper", iterations_per_decision=n)
        for n in (50, 500)
    ]
    found = plots.sweeps(rows)
    assert list(found) == ["left", "exit"]
    assert [
        (family.label, [budget for budget, _, _ in family.points]) for family in found["left"]
    ] == [("mcts-idm", [100, 1000]), ("paper", [50, 500])]
    assert found["exit"][0].points[0] == (100, Rate(4, 6, wilson(4, 6)), Rate(2, 6, wilson(2, 6)))
    assert (
        plots.sweeps(
            [
                row
                for row in rows
                if row["variant"] != "mcts-idm-1000" and not row["variant"].startswith("paper")
            ]
        )
        == {}
    )


def test_a_sweep_goes_on_beyond_a_million() -> None:
    budgets = (1000, 1_000_000, 2_500_000.0)
    rows = [
        made_row(variant=f"mcts-idm-{n:.0f}", planner="mcts", iterations_per_decision=n)
        for n in budgets
    ]
    (swept,) = plots.sweeps(rows)["left"]
    assert (swept.label, [budget for budget, _, _ in swept.points]) == ("mcts-idm", list(budgets))
    assert "1\u2009000\u2009000 iterations: arrived 1/1" in plots.sweep_figure(
        "left", [swept], colours(rows)
    )


def test_the_sweep_shows_every_rate() -> None:
    rows = made_rows(6)
    drawn = plots.sweep_figure("left", plots.sweeps(rows)["left"], colours(rows))
    ElementTree.fromstring(drawn)
    assert re.findall(r"(?:arrived|collided) \d+/\d+", drawn) == [
        "arrived 4/6",
        "arrived 6/6",
        "collided 2/6",
        "collided 0/6",
    ]


def test_a_spread_tells_its_quantiles() -> None:
    rows = [made_row(seed=k, min_ttc_s=float(k)) for k in range(1, 100)] + [
        made_row(seed=100, min_ttc_s=None)
    ]
    drawn = spread(rows)
    ElementTree.fromstring(drawn)
    assert (
        "median 50.00 s; half of the episodes 25.50..74.50, nine tenths 5.90..94.10; known in 99 "
        "of 100 episodes" in drawn
    )
    assert spread([made_row(min_ttc_s=None)]) == ""
    ElementTree.fromstring(spread([made_row(min_ttc_s=0.0)]))


def test_a_variant_of_which_nothing_is_known_stays_in_the_figure() -> None:
    root = ElementTree.fromstring(
        spread(
            [
                made_row(),
                *(made_row(variant="calm", seed=seed, min_ttc_s=None) for seed in range(3)),
            ]
        )
    )
    assert [text.text for text in root.iter("text") if text.get("class") == "name"] == [
        "mcts-idm-100",
        "calm",
    ]
    assert "none" in [text.text for text in root.iter("text")]
    assert "calm: none in any of 3 episodes" in [mark.get("data-tip") for mark in root.iter("rect")]
    assert len(list(root.iter("circle"))) == 1


def test_every_variant_has_a_colour_of_its_own_as_long_as_there_are_some() -> None:
    rows = [
        made_row(variant=name, planner=planner)
        for planner in ("mcts", "sumo", "mine", None)
        for name in (f"{planner}-b", f"{planner}-a")
    ]
    found = colours([*rows, *rows])
    assert len(set(found.values())) == len(found) == 8
    assert (found["mcts-b"], found["sumo-b"], found["mine-b"]) == ("p-mcts", "p-sumo", "p-other"), (
        "a planner's first variant has the planner's"
    )
    many = colours([made_row(variant=str(k), planner="mcts") for k in range(40)])
    assert set(many.values()) == {f"p-{planner}" for planner in KNOWN if planner != "sumo"} | {
        f"p-further-{k + 1}" for k in range(FURTHER)
    }
    style = resources.files("sumo_mcts.reporting").joinpath("template", "page.css").read_text()
    style += planner_style()
    assert all(f".{name} {{ --c:" in style for name in (*many.values(), "p-sumo", "p-other"))


@pytest.mark.parametrize("name", ['<b>&"x"</b>', "\u00e4 b"])
def test_names_are_escaped(name: str) -> None:
    root = ElementTree.fromstring(spread([made_row(variant=name)]))
    assert name in [text.text for text in root.iter("text")]


def test_a_drive_without_arrival_stands_on_the_edge() -> None:
    twins = [made_row(variant="sumo", seed=k, travel_time_s=30.0) for k in range(3)]
    rows = [made_row(seed=0), crashed(made_row(seed=1)), made_row(seed=2)]
    colour = colours([*rows, *twins])
    drawn = plots.twin_figure("left", rows, twins, colour)
    ElementTree.fromstring(drawn)
    assert "ego did not arrive" in drawn
    assert "twin did not arrive" not in drawn
    assert len(re.findall(r"M[\d. ]+h0", drawn)) == 3
    assert "twin did not arrive" in plots.twin_figure(
        "left",
        rows,
        [*twins[:2], {**twins[2], "outcome": "timeout", "travel_time_s": None}],
        colour,
    )
    assert plots.twin_figure("left", rows, [], colour) == ""


def test_thousands_of_pairs_are_one_path() -> None:
    rows, twins = (
        [made_row(variant=variant, seed=k, travel_time_s=20.0 + k % 97 / 10) for k in range(4000)]
        for variant in ("mcts-idm-100", "sumo")
    )
    assert len(plots.twin_figure("left", rows, twins, colours([*rows, *twins]))) < 20_000
