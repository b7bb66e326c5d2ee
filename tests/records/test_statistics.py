"""Rates against published intervals, bootstrap intervals against plain resampling, pairs against
counts by hand."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts.records import statistics
from sumo_mcts.records.rows import row_defaults
from sumo_mcts.records.statistics import (
    LEAST,
    Pair,
    Rate,
    arrived,
    at_fault,
    at_most,
    collided,
    contrast,
    interval,
    median,
    pairs,
    rate,
    slow_ratios,
    some,
    time_ratio,
    wilson,
)


def row(seed: int = 0, **known: Any) -> dict[str, Any]:
    return {
        **row_defaults(),
        "scenario": "s",
        "ego": "ego",
        "seed": seed,
        "outcome": "arrived",
        "travel_time_s": 10.0,
        **known,
    }


def stopped(seed: int = 0, outcome: str = "timeout") -> dict[str, Any]:
    return row(seed, outcome=outcome, travel_time_s=None)


def test_the_intervals() -> None:
    """Newcombe 1998, table I: 81/263, 15/148, 0/20, 1/29."""
    for k, n, low, high in (
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ):
        assert wilson(k, n) == (pytest.approx(low, abs=1e-4), pytest.approx(high, abs=1e-4))
    assert wilson(0, 0) is None


def test_a_rate_counts_what_happened() -> None:
    assert rate([True, False, True]) == Rate(2, 3, wilson(2, 3))
    assert rate([]) == Rate(0, 0, None)
    assert rate([True, None, False, None]) == Rate(1, 2, wilson(1, 2)), "what is unknown is neither"


def test_what_is_unclear_counts_as_at_fault() -> None:
    verdicts = {at: at_fault(row(outcome="collision", at_fault=at)) for at in (True, False, None)}
    assert verdicts == {True: True, False: False, None: True}
    assert not at_fault(row(at_fault=None))


def test_pairs_share_scenario_seed_and_ego() -> None:
    ones = [row(1), row(2), row(3, ego="other"), row(4, scenario="t")]
    others = [
        row(2, planner="sumo", travel_time_s=7.0),
        row(2, planner="sumo", travel_time_s=8.0),
        row(3),
        row(4),
        row(5),
    ]
    assert [(pair.one["seed"], pair.other["travel_time_s"]) for pair in pairs(ones, others)] == [
        (2, 7.0)
    ]


def test_pairs_share_the_traffic() -> None:
    ones, others = (
        [row(seed, traffic_digest=traffic) for seed, traffic in enumerate(known)]
        for known in (("a", "a", None, None), ("a", "b", "a", None))
    )
    assert [pair.one["seed"] for pair in pairs(ones, others)] == [0, 3]
    assert [
        pair.other["seed"]
        for pair in pairs([row(0)], [row(0, traffic_digest="a"), row(0, traffic_digest=None)])
    ] == [0]


def test_pairs_were_redrawn_as_often() -> None:
    assert [
        pair.one["seed"]
        for pair in pairs(
            [row(0, redrawn=0), row(1, redrawn=0)], [row(0, redrawn=1), row(1, redrawn=0)]
        )
    ] == [1]


def test_of_an_error_nobody_knows_whether_it_would_have_collided() -> None:
    assert rate(map(collided, [row(outcome="error"), row(outcome="collision"), row()])) == rate(
        [True, False]
    )
    assert at_fault(row(outcome="error")) is None and arrived(row(outcome="error")) is False


def test_who_does_not_arrive_takes_for_ever_and_whose_twin_does_not_is_left_out() -> None:
    both = [
        Pair(row(travel_time_s=5.0), row()),
        Pair(stopped(), row()),
        Pair(row(travel_time_s=9.0), row()),
        Pair(row(travel_time_s=1.0), stopped()),
    ]
    found = time_ratio(both)
    assert found is not None
    assert (found.value, found.n) == (0.9, 3)
    many = time_ratio(both * 4)
    assert many is not None and many.interval is not None
    assert many.interval[1] == math.inf
    assert time_ratio([both[-1]]) is None
    most = time_ratio([both[1], both[1], both[0]])
    assert most is not None
    assert most.value == math.inf


def test_what_so_many_percent_do_not_exceed_is_one_of_the_values() -> None:
    """Against counting: the smallest value that at least so many of the values do not exceed."""
    values = np.array([3.0, 1.0, 2.0, math.inf, 2.0, 5.0, 4.0, 9.0, 8.0, 7.0])
    for n in range(1, 11):
        for percent in (1, 10, 50, 90, 95, 99, 100):
            least = min(v for v in values[:n] if 100 * (values[:n] <= v).sum() >= percent * n)
            assert at_most(values[:n], percent) == least, (n, percent)
    assert at_most(np.array([]), 90) is None


def test_slow_pairs_are_told_beside_the_median() -> None:
    """Of 100 pairs 98 ratios, 0.01 to 0.98, and two that do not arrive; the last twin does not either."""
    both = [Pair(row(travel_time_s=0.1 * k), row()) for k in range(1, 99)]
    both += [Pair(stopped(), row()), Pair(stopped(), row()), Pair(row(), stopped())]
    assert slow_ratios(both) == [pytest.approx(0.90), pytest.approx(0.95), math.inf]
    assert slow_ratios([both[-1]]) == [None, None, None]


def test_a_travel_time_counts_only_if_the_ego_arrived() -> None:
    found = time_ratio([Pair(row(outcome="collision", travel_time_s=1.0), row())])
    assert found is not None
    assert found.value == math.inf


def test_the_paired_difference_is_in_episodes_per_hundred() -> None:
    braked, free = row(imposed_brakes_3=2), row(imposed_brakes_3=0)
    unknown = row(imposed_brakes_3=None)
    found = contrast(
        [Pair(braked, free)] * 3
        + [Pair(free, braked)]
        + [Pair(braked, braked)] * 4
        + [Pair(unknown, free)] * 12,
        some("imposed_brakes_3"),
    )
    assert found is not None
    assert (found.k, found.other, found.n, found.per_hundred) == (7, 5, 8, 25.0)
    assert found.interval is not None
    assert found.interval[0] < 0.0
    assert found.interval[1] > 25.0
    assert contrast([Pair(free, unknown)], some("imposed_brakes_3")) is None
    assert contrast([], arrived) is None


@pytest.mark.parametrize("n", [1, 2, 5, 40, 41])
@pytest.mark.parametrize("which", ["means", "medians"])
def test_resampling_is_plain_resampling(which: str, n: int) -> None:
    """The slow and obvious twin: draw n of n values again and again."""
    rng = np.random.default_rng(n)
    values = rng.normal(10.0, 3.0, n).round(1 if which == "medians" else 0)
    plain, quick = (
        (np.mean, statistics.resampled_means)
        if which == "means"
        else (np.median, statistics.resampled_medians)
    )
    slow = np.array([plain(rng.choice(values, n)) for _ in range(4000)])
    found = quick(values)
    spread = max(float(slow.std()), 1e-9)
    assert abs(float(found.mean() - slow.mean())) < 0.12 * spread + 1e-9
    assert float(found.std()) == pytest.approx(float(slow.std()), rel=0.08, abs=1e-9)
    assert (
        np.abs(np.array(interval(found)) - np.percentile(slow, [2.5, 97.5])).max()
        < 0.4 * spread + 1e-9
    )


@given(st.lists(st.floats(-1e6, 1e6) | st.just(math.inf), min_size=1, max_size=30))
def test_the_median_is_numpys_and_lies_in_its_interval(values: list[float]) -> None:
    found = median(np.array(values))
    assert found is not None
    assert found.value == pytest.approx(float(np.median(values)))
    assert median(np.array(values)) == found, "the same values, the same interval"
    assert (found.interval is None) == (len(values) < LEAST or len(set(values)) == 1)
    low, high = found.interval or (found.value, found.value)
    assert min(values) <= low <= found.value <= high <= max(values)


def test_so_few_values_as_have_no_interval_could_not_have_one() -> None:
    """The whole range of n values misses the median with the probability that all of them lie on
    one side of it."""
    assert 2 * 0.5 ** (LEAST - 1) > 0.05 >= 2 * 0.5**LEAST
    worse = [Pair(row(imposed_brakes_3=1), row(imposed_brakes_3=0))]
    for n, known in ((1, False), (LEAST - 1, False), (LEAST, True)):
        found = contrast(
            [*worse, *[Pair(row(imposed_brakes_3=0), row(imposed_brakes_3=0))] * (n - 1)],
            some("imposed_brakes_3"),
        )
        assert found is not None
        assert (found.interval is not None) == known
    alike = contrast(worse * 100, some("imposed_brakes_3"))
    assert alike is not None
    assert (alike.per_hundred, alike.interval) == (100.0, None), (
        "where all pairs are the same, resampling them says nothing"
    )


def test_an_interval_covers_what_it_should() -> None:
    """Nineteen times in twenty, near enough."""
    rng = np.random.default_rng(5)
    samples = [rng.exponential(1.0, 60) for _ in range(400)]
    covered = sum(
        low <= math.log(2) <= high
        for low, high in (interval(statistics.resampled_medians(sample)) for sample in samples)
    )
    assert 0.91 < covered / len(samples) < 0.985
