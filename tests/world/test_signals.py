"""What the signals near a place will show, without SUMO."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from sumo_mcts.road import RoadMap
from sumo_mcts.scene import GREEN, RED
from sumo_mcts.world.signals import SignalReader


def _phase(state: str, duration: float) -> Any:
    return SimpleNamespace(state=state, duration=duration, minDur=-1, maxDur=-1, next=())


def test_each_signal_has_the_times_of_its_own_program() -> None:
    """Two signals near, one far away; each switches by its own clock."""
    programs = {
        "a": [_phase("G", 30.0), _phase("r", 20.0)],
        "b": [_phase("r", 7.0), _phase("G", 5.0)],
        "far": [_phase("G", 1.0), _phase("r", 1.0)],
    }
    lights = SimpleNamespace(
        getIDList=lambda: tuple(programs),
        getRedYellowGreenState=lambda name: programs[name][0].state,
        getProgram=lambda name: "0",
        getPhase=lambda name: 0,
        getNextSwitch={"a": 104.0, "b": 102.5, "far": 100.5}.__getitem__,
        getAllProgramLogics=lambda name: [
            SimpleNamespace(phases=programs[name], programID="0", type=0)
        ],
    )
    road = SimpleNamespace(
        signal_ids=("a", "b", "far"),
        signal=np.array([0, 1, 2], np.int32),
        link=np.zeros(3, np.int32),
        points=np.array([[0.0, 0.0], [50.0, 0.0], [9000.0, 0.0]]),
        point_offset=np.arange(4, dtype=np.int32),
    )
    reader = SignalReader(SimpleNamespace(trafficlight=lights), cast(RoadMap, road))
    seen = reader.read(0.0, 0.0, 100.0, 4)
    assert seen.until[0] == pytest.approx([4.0, 24.0, 54.0, 74.0])
    assert seen.until[1] == pytest.approx([2.5, 7.5, 14.5, 19.5])
    assert np.isinf(seen.until[2]).all()
    assert seen.state.tolist() == [
        [GREEN, RED, GREEN, RED],
        [RED, GREEN, RED, GREEN],
        [GREEN] * 4,
    ]
    assert np.array_equal(reader.read(0.0, 0.0, 100.0, 4).until, seen.until)  # nothing adds up
