"""Weighted joint hypotheses: what likely happens, and what happens if one agent does otherwise.

The joint hypotheses are the usual forecast and those that differ from it in one agent
(alternatives.py). Agents are taken to be independent of each other, so the odds of an alternative
are also those of its joint hypothesis. Two unlikely things at once are left out.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sumo_mcts.prediction.alternatives import Alternative, alternatives
from sumo_mcts.prediction.forecast import Question, expected_accels, ground_of, predict
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import STANDING, STARTS, Forecast

# The fields of a Forecast that it has for each hypothesis, beside `weight` and `intents`.
OF_HYPOTHESES = ("pose", "v", "lane", "s", "valid", "yields")


def predict_hypotheses(road: RoadMap, question: Question) -> Forecast:
    """A forecast of up to question.hypotheses joint hypotheses, the likeliest first, from what
    sensors see."""
    params, most = question.params, question.hypotheses
    ground = ground_of(road, question)
    usual = predict(road, question, ground=ground)
    if most == 1 or not params.interacting:
        return usual
    found, odds = [usual], [1.0]
    # What an agent does otherwise is the evidence, so what is expected must not have it in it.
    expected = expected_accels(road, question, ground)
    for other in alternatives(road, question, ground.agents, usual, expected):
        forecast = predict(road, question, intent=other.intent, ground=ground)
        if _differs(forecast, other):
            found.append(forecast)
            odds.append(other.odds)
        if len(found) == most:
            break
    return together(found, odds)


def _differs(forecast: Forecast, other: Alternative) -> bool:
    """Whether the forecast shows the alternative: an agent that is to start may be held by more
    than patience."""
    intent = other.intent
    return intent.does != STARTS or bool(forecast.v[0, :, intent.agent].max() > STANDING)


def together(found: Sequence[Forecast], odds: Sequence[float]) -> Forecast:
    """Forecasts of one hypothesis each as one forecast, the likeliest first."""
    order = np.argsort(-np.array(odds), kind="stable")
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(found[h], name) for h in order]) for name in OF_HYPOTHESES
    }
    return found[0]._replace(
        weight=np.array(odds)[order] / np.sum(odds),
        intents=tuple(intent for h in order for intent in found[h].intents),
        **columns,
    )


def likeliest(forecast: Forecast) -> Forecast:
    """Its first hypothesis alone."""
    return forecast._replace(
        weight=np.ones(1),
        intents=forecast.intents[:1],
        **{name: getattr(forecast, name)[:1] for name in OF_HYPOTHESES},
    )
