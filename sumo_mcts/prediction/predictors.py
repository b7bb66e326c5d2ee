"""The built-in predictors; registry.py has a row for each."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from sumo_mcts.prediction.forecast import OracleData, Question, predict, times_of
from sumo_mcts.prediction.hypotheses import predict_hypotheses
from sumo_mcts.prediction.interface import Oracles
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Forecast, Scripted


class _BuiltIn:
    """What the built-in predictors have in common."""

    oracle = False

    def __init__(self, options: Mapping[str, Any], scenario: object) -> None:
        """They have no options: all they read of a scenario is part of each question."""

    def start(self, road: RoadMap, oracles: Oracles | None) -> None:
        """Keep the map, and what may be asked."""
        self._road, self._oracles = road, oracles


class Idm(_BuiltIn):
    """Car following along the likeliest lanes, and as many hypotheses as the planner weighs."""

    def predict(self, question: Question) -> Forecast:
        """The usual forecast first."""
        return predict_hypotheses(self._road, question)


class ConstantVelocity(_BuiltIn):
    """Every agent keeps its speed along its likeliest lanes."""

    def predict(self, question: Question) -> Forecast:
        """One hypothesis."""
        alone = question.params._replace(interacting=False)
        return predict(self._road, question._replace(params=alone))


class Routes(_BuiltIn):
    """An oracle: car following along the lanes that the agents are really going to take."""

    oracle = True

    def predict(self, question: Question) -> Forecast:
        """One hypothesis; without oracles along the likeliest lanes."""
        agents, ask = question.scene.agents, self._oracles
        if ask is None:
            return predict(self._road, question)
        lanes = {
            int(i): ask.lanes(agents.ids[i], int(agents.lane[i]))
            for i in np.flatnonzero(agents.lane >= 0)
        }
        return predict(self._road, question, OracleData(lanes=lanes))


class Scripts(_BuiltIn):
    """An oracle: agents with a script follow it, all others drive by car following."""

    oracle = True

    def predict(self, question: Question) -> Forecast:
        """One hypothesis; without oracles all agents drive by car following."""
        if self._oracles is None:
            return predict(self._road, question)
        return predict(self._road, question, OracleData(scripts=_scripts(self._oracles, question)))


class Clone(_BuiltIn):
    """An oracle: what a copy of the running simulation does when its ego drives on as planned."""

    oracle = True

    def predict(self, question: Question) -> Forecast:
        """One hypothesis; without oracles all agents drive by car following."""
        if self._oracles is None:
            return predict(self._road, question)
        scripted = _scripts(self._oracles, question)
        step = question.params.step
        copies = self._oracles.clone(
            question.scene, question.command, step, times_of(question.seconds, step)
        )
        data = OracleData(scripts={i: copies[i] for i in scripted}, copies=copies)
        return predict(self._road, question, data)


def _scripts(oracles: Oracles, question: Question) -> dict[int, Scripted]:
    """The coming states of the agents (index) that have a script."""
    scene, step = question.scene, question.params.step
    count = times_of(question.seconds, step)
    found = {
        i: oracles.script(vehicle, scene.time, step, count)
        for i, vehicle in enumerate(scene.agents.ids)
    }
    return {i: states for i, states in found.items() if states is not None}
