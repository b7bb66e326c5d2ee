"""A loop is built, with SUMO running, or it is not, with nothing left behind."""

from contextlib import closing
from pathlib import Path

import pytest

from sumo_mcts import config
from sumo_mcts.config import builtin
from sumo_mcts.episode.loop import Loop
from sumo_mcts.errors import ConfigError
from sumo_mcts.scene import Decision, Release
from sumo_mcts.world.library import is_running


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which temporary files lie."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return tmp_path


def scene(*sets: str) -> config.ScenarioConfig:
    return config.load(builtin.scenario_path("highway-exit"), sets)


@pytest.mark.parametrize(
    "wrong",
    [
        "episode.success_edge=nowhere",  # found before SUMO starts,
        "egos=[{id: nobody}]",  # after that,
        "sumo.options={warp-speed: 9}",  # and by SUMO itself
    ],
)
def test_wrong_input_leaves_nothing_running(wrong: str, temporary: Path) -> None:
    with pytest.raises(ConfigError):
        Loop(scene(wrong), 0)
    assert not is_running()
    assert list(temporary.iterdir()) == []


def test_a_loop_runs_from_its_construction_to_its_end(temporary: Path) -> None:
    with closing(Loop(scene(), 0)) as loop:
        assert is_running()
        known = loop.scenes()
        assert list(known) == ["ego"]
        loop.apply({"ego": Decision(Release(), None, (), -1, "", 0, 0)})
        assert loop.scenes()["ego"].time == pytest.approx(known["ego"].time + loop.world.period)
        loop.fail("ego", "enough")
        assert loop.scenes() == {}
    assert not is_running()
    assert list(temporary.iterdir()) == []
    loop.close()  # once more does no harm
    (row,) = loop.rows()
    assert (row["outcome"], row["error"]) == ("error", "enough")
