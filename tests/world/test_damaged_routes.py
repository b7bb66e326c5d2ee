"""Route files with values replaced and elements removed, doubled or moved: refused in a line or
driven, never an error of the program's own, never a hang.

SUMO may crash on such a file, so each example is driven by a process of its own, as the command
does it.
"""

import faulthandler
import os
import signal
import tempfile
import traceback
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import pytest
from helpers_fuzz import HOSTILE, mutated
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sumo_mcts.config import build
from sumo_mcts.episode import run_episode
from sumo_mcts.process.ending import FAILED, INVALID, OK, explained

TOP = Path(__file__).resolve().parents[2]
NET = TOP / "networks" / "straight-line" / "straight-line.net.xml"
ROUTES = """<routes>
    <vType id="car" vClass="passenger" length="4.7" width="1.8" minGap="2.5" accel="2.6" decel="4.5" maxSpeed="30" sigma="0.5"/>
    <vTypeDistribution id="some"><vType id="slow" maxSpeed="8" probability="0.5"/><vType id="lorry" vClass="truck" probability="0.5"/></vTypeDistribution>
    <route id="through" edges="road beyond"/>
    <vehicle id="ego" type="car" depart="0" departLane="1" departPos="100" departSpeed="5"><route edges="road beyond"/></vehicle>
    <vehicle id="other" type="some" route="through" depart="0" departLane="0" departPos="150"><stop lane="road_0" endPos="200" duration="1"/></vehicle>
    <flow id="stream" type="car" begin="0" end="20" period="exp(0.5)" from="road" to="beyond" departLane="best" departSpeed="max"/>
    <flow id="more" type="some" begin="0" end="20" number="10" route="through"/>
    <trip id="last" depart="1" from="road" to="beyond" departLane="free"/>
</routes>
"""
WITHIN_S = 30  # on a machine that does other things too: driving one takes 0.1 s
OF_SUMO = (
    signal.SIGSEGV,
    signal.SIGABRT,
    signal.SIGFPE,
)  # in which SUMO may end; the command's parent process says so


def drive(routes: Path) -> int:
    """The exit status of half a simulated second of traffic."""
    scenario = {
        "name": "x", "sumo": {"net": str(NET), "routes": [str(routes)]}, "egos": [{"id": "ego"}],
        "planner": {"name": "constant"},
        "episode": {"time_limit_s": 0.5},
    }  # fmt: skip
    try:
        run_episode(build(scenario, "x"), 0)
    except Exception as error:
        line, status = explained(error)
        if "a fault of sumo-mcts" in line or "\n" in line or not line.isprintable():
            traceback.print_exc()
            return 99
        return status
    return OK


def in_a_child(work: Callable[[], int]) -> int:
    """What a process of its own answers: its exit status, or minus the signal that ended it."""
    child = os.fork()
    if child == 0:
        try:
            faulthandler.disable()
            signal.alarm(WITHIN_S)
            os._exit(work())
        finally:
            os._exit(98)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def test_the_good_one(tmp_path: Path) -> None:
    path = tmp_path / "r.rou.xml"
    path.write_text(ROUTES)
    assert in_a_child(lambda: drive(path)) == OK


@pytest.mark.slow
@settings(
    max_examples=max(settings.default.max_examples // 2, 50)
)  # half of what others have: each is a process
@given(st.integers(0, 2**32), st.integers(1, 3))
@example(0, 1)
def test_any_damage(seed: int, changes: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "r.rou.xml"
        tree = mutated(
            ElementTree.ElementTree(ElementTree.fromstring(ROUTES)),
            seed,
            changes,
            (*HOSTILE, "exp(inf)", "exp(1e9)", "random", "max", "ego"),
        )
        tree.write(path)
        status = in_a_child(lambda: drive(path))
        said = f"{status}: {path.read_text()}"
    assert status in (OK, FAILED, INVALID) or -status in OF_SUMO, said
