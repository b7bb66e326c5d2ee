"""Surrogate measures, from what SUMO's device answers."""

import math
from types import SimpleNamespace

import pytest

from sumo_mcts.world.surrogates import SurrogateReader


def read(answer: str) -> float:
    """The TTC that is read where a device answers this for every measure."""
    answers = {"has.ssm.device": "true"}
    vehicle = SimpleNamespace(
        getParameter=lambda _, key: answers.get(key, answer), getTypeID=lambda _: "car"
    )
    kind = SimpleNamespace(getParameter=lambda *_: "")
    libsumo = SimpleNamespace(vehicle=vehicle, vehicletype=kind, TraCIException=RuntimeError)
    return SurrogateReader(libsumo).read("ego").ttc


@pytest.mark.parametrize("answer", ["", "-0.1", "-1e300", "1e6", "inf", "nan"])
def test_what_no_row_may_hold_stands_for_none(answer: str) -> None:
    assert math.isnan(read(answer))


@pytest.mark.parametrize("answer", ["0.0", "1.25", "999999.0"])
def test_other_numbers_are_read_as_they_are(answer: str) -> None:
    assert read(answer) == float(answer)
