"""Scores of probabilities: by hand, and for a forecaster that is right about its doubt."""

import numpy as np
import pytest

from sumo_mcts.evaluation.reliability import BINS, Judged, reliability, scores


def judged(probability: list[float], happened: list[bool]) -> Judged:
    return Judged(np.array(probability), np.array(happened))


def test_brier_score_and_skill_by_hand() -> None:
    found = scores(judged([0.9, 0.2, 0.5, 0.0], [True, False, True, False]))
    assert found["brier"] == pytest.approx((0.01 + 0.04 + 0.25 + 0.0) / 4)
    assert found["skill"] == pytest.approx(1.0 - found["brier"] / 0.25)
    assert (found["asked"], found["happened"]) == (4, 2)


def test_who_knows_is_perfect_and_who_says_the_base_rate_has_no_skill() -> None:
    happened = [True, False, False, False]
    assert scores(judged([1.0, 0.0, 0.0, 0.0], happened))["skill"] == 1.0
    assert scores(judged([0.25] * 4, happened))["skill"] == pytest.approx(0.0)
    assert scores(judged([0.0] * 4, happened))["skill"] < 0.0


def test_what_never_or_always_happens_has_no_skill_to_show() -> None:
    assert scores(judged([0.1, 0.2], [False, False]))["skill"] is None
    assert scores(judged([], []))["brier"] is None


def test_every_prediction_lies_in_one_bin() -> None:
    probability = [0.0, *BINS, 1.0, 0.3]
    rows = reliability(judged(probability, [False] * len(probability)))
    assert sum(row["asked"] for row in rows) == len(probability)
    for row in rows:
        assert row["from"] <= row["predicted"] <= row["to"]
    assert rows[-1]["asked"] == 3  # 0.8, and 1 twice: 1 belongs to the last bin


def test_who_is_right_about_its_doubt_is_within_nearly_all_intervals() -> None:
    rng = np.random.default_rng(3)
    probability = rng.random(20000) ** 3
    calm = Judged(probability, rng.random(20000) < probability)
    inside = [
        row["interval"][0] <= row["predicted"] <= row["interval"][1] for row in reliability(calm)
    ]
    assert sum(inside) >= len(inside) - 1
    bold = Judged(np.minimum(2.0 * probability, 1.0), calm.happened)
    outside = [
        not row["interval"][0] <= row["predicted"] <= row["interval"][1]
        for row in reliability(bold)
    ]
    assert sum(outside) >= len(outside) - 2
