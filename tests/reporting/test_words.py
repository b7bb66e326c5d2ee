"""Decisions in words, which load no drawing library."""

import subprocess
import sys

import numpy as np
import pytest
from helpers_trace import crossing_trace

from sumo_mcts.reporting.words import action_words
from sumo_mcts.scene import Follow


def test_actions_in_words() -> None:
    cycle = crossing_trace().cycles[0]
    child = cycle.decision.children[0]

    def words(accel: float, change: int = 0, reason: str = "search", v: float = 8.0) -> str:
        decision = cycle.decision._replace(
            children=(child._replace(accel=accel, lane_change=change),), chosen=0, reason=reason
        )
        return action_words(cycle._replace(decision=decision, ego=cycle.ego._replace(v=v)))

    assert words(0.0) == "keep speed"
    assert words(-2.0) == "brake \u22122.0 m/s\u00b2"
    assert words(-8.0, reason="brake") == "brake hard \u22128.0 m/s\u00b2"
    assert words(1.5, 1) == "accelerate +1.5 m/s\u00b2, change to the left"
    assert words(0.0, -1, "fallback") == "keep speed, change to the right, fallback"
    assert words(-2.0, v=0.0) == "stand"
    assert action_words(crossing_trace().cycles[-1]) == "SUMO drives"
    unchosen = cycle._replace(
        decision=cycle.decision._replace(
            chosen=-1, command=Follow(np.array([9.9, 9.8, 9.7, 9.6, 9.5]), 0)
        )
    )
    assert action_words(unchosen) == "brake \u22121.0 m/s\u00b2"
    for side, words_of_it in ((1, "asks for room on the left"), (-1, "asks for room on the right")):
        command = Follow(np.full(5, 10.0), 0, side)
        asking = cycle._replace(decision=cycle.decision._replace(command=command))
        assert words_of_it in action_words(asking)


@pytest.mark.slow
def test_an_explanation_loads_no_drawing_library() -> None:
    code = (
        "import sys, sumo_mcts.reporting.explanation, sumo_mcts.reporting.explanation_words; "
        "print([m for m in ('matplotlib', 'PIL') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
