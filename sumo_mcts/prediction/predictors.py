"""The built-in predictors; registry.py has a row for each."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from sumo_mcts.prediction.forecast import OracleData, predict, times_of
from sumo_mcts.prediction.hypotheses import predict_hypotheses
from sumo_mcts.prediction.interface import Oracles, Question
from sumo_mcts.scene import Forecast, RoadMap, Scripted


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
        return predict_hypotheses(self._road, **_known(question), most=question.hypotheses)


class ConstantVelocity(_BuiltIn):
    """Every agent keeps its speed along its likeliest lanes."""

    def predict(self, question: Question) -> Forecast:
        """One hypothesis."""
        alone = question.params._replace(interacting=False)
        return _predict(self._road, question._replace(params=alone), OracleData())


class Routes(_BuiltIn):
    """An oracle: car following along the lanes that the agents are really going to take."""

    oracle = True

    def predict(self, question: Question) -> Forecast:
        """One hypothesis; without oracles along the likeliest lanes."""
        agents, ask = question.scene.agents, self._oracles
        if ask is None:
            return _predict(self._road, question, OracleData())
        lanes = {
            int(i): ask.way(agents.ids[i], int(agents.lane[i]))
            for i in np.flatnonzero(agents.lane >= 0)
        }
        return _predict(self._road, question, OracleData(ways=lanes))


class Scripts(_BuiltIn):
    """An oracle: agents with a script follow it, all others drive by car following."""

    oracle = True

    def predict(self, question: Question) -> Forecast:
        """One hypothesis; without oracles all agents drive by car following."""
        if self._oracles is None:
            return _predict(self._road, question, OracleData())
        return _predict(self._road, question, OracleData(scripts=_scripts(self._oracles, question)))


class Clone(_BuiltIn):
    """An oracle: what a copy of the running simulation does when its ego drives on as planned."""

    oracle = True

    def predict(self, question: Question) -> Forecast:
        """One hypothesis; without oracles all agents drive by car following."""
        if self._oracles is None:
            return _predict(self._road, question, OracleData())
        scripted = _scripts(self._oracles, question)
        step = question.params.step
        copies = self._oracles.clone(
            question.scene, question.command, step, times_of(question.seconds, step)
        )
        told = OracleData(scripts={i: copies[i] for i in scripted}, copies=copies)
        return _predict(self._road, question, told)


def _predict(road: RoadMap, question: Question, told: OracleData) -> Forecast:
    """The forecast of one hypothesis, with what an oracle tells."""
    return predict(road, **_known(question), told=told)


def _known(question: Question) -> dict[str, Any]:
    """The arguments of predict and predict_hypotheses that a question holds."""
    q = question
    return {
        "scene": q.scene,
        "ego_lanes": q.ego_lanes,
        "nominal": q.nominal,
        "params": q.params,
        "seconds": q.seconds,
        "ego_stood_s": q.stood_s,
    }


def _scripts(oracles: Oracles, question: Question) -> dict[int, Scripted]:
    """The coming states of the agents (index) that have a script."""
    scene, step = question.scene, question.params.step
    count = times_of(question.seconds, step)
    found = {
        i: oracles.script(vehicle, scene.time, step, count)
        for i, vehicle in enumerate(scene.agents.ids)
    }
    return {i: states for i, states in found.items() if states is not None}
