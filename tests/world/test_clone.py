"""The copy of the simulation: it foretells exactly what SUMO then does, leaves no trace in the
original, and its end is never the original's."""

import os
import re
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
import pytest

from sumo_mcts import config
from sumo_mcts.config import ScenarioConfig, builtin
from sumo_mcts.driver.driver import Driver
from sumo_mcts.episode import run_episode
from sumo_mcts.episode.loop import Loop
from sumo_mcts.episode.oracles import SimulationOracles
from sumo_mcts.errors import ConfigError
from sumo_mcts.scene import Decision, Follow, Release, Scene
from sumo_mcts.world import clone
from sumo_mcts.world.observe import LANE, POSE, POSITION, SPEED, THERE
from sumo_mcts.world.simulation import SimulationError

pytestmark = pytest.mark.skipif(
    not hasattr(os, "fork") or not Path("/proc/self/fd").exists(), reason="a copy needs Linux"
)


def scene_of(name: str, *sets: str) -> ScenarioConfig:
    return config.load(builtin.scenario_path(name), sets)


def decided(command: Follow | Release) -> Decision:
    return Decision(command, None, (), -1, "test", 0, 0)


def children() -> set[str]:
    """The child processes of this one, dead ones too."""
    return {
        child
        for thread in Path("/proc/self/task").iterdir()
        for child in (thread / "children").read_text().split()
    }


@pytest.fixture(autouse=True)
def nobody_is_left_behind() -> Iterator[None]:
    """No copy outlives a test, not even dead."""
    before = (
        children()
    )  # another test may have left the helper that Python starts with its first process
    yield
    assert children() <= before


# --- exactness ---


CHANGES = {"lanechange.duration": 3.0}


@pytest.mark.parametrize(
    ("name", "begin", "side", "step", "options"),
    [
        ("unprotected-left-turn", 8, 0, 0.1, CHANGES),
        ("unprotected-left-turn", 14, 0, 0.1, {**CHANGES, "step-method.ballistic": True}),
        ("straight-line", 3, -1, 0.1, CHANGES),
        ("highway-exit", 6, -1, 0.1, {"lateral-resolution": 0.8}),
        ("unprotected-left-turn-scripted", 2, 0, 0.1, CHANGES),
        ("highway-exit-scripted", 2, 0, 0.25, CHANGES),
    ],
)
def test_a_copy_tells_what_sumo_then_does(
    name: str, begin: int, side: int, step: float, options: dict[str, float | bool]
) -> None:
    """The ego drives two seconds as it was said, then SUMO's own driver drives it, in the copy as
    in the original."""
    scene = scene_of(name)
    scene = scene.model_copy(
        update={"sumo": scene.sumo.model_copy(update={"options": options, "step_length_s": step})}
    )
    loop = Loop(scene, 5)
    try:
        for _ in range(begin):
            loop.scenes()
            loop.apply({"ego": decided(Release())})
        known = loop.scenes()["ego"]
        period, told = round(0.5 / step), round(2.0 / step)
        speeds = known.ego.v + np.minimum(np.arange(1, told + 1), told / 2) * 0.9 * step
        copies = loop.oracles.clone(known, Follow(speeds, side), step, round(5.0 / step) + 1)
        assert len(copies) == len(known.agents.ids) > 2
        moved = 0.0
        for k in range(1, 11):
            left = speeds[(k - 1) * period :]
            loop.apply(
                {"ego": decided(Follow(left, side if k == 1 else 0) if len(left) else Release())}
            )
            if not loop.scenes():
                break
            states = loop.world.observer.states(known.agents.ids)
            for i, copy in copies.items():
                at = k * period
                assert copy.valid[at] == (states[i, THERE] > 0)
                if copy.valid[at]:
                    told_row = (*copy.pose[at], copy.v[at], copy.lane[at], copy.s[at])
                    assert told_row == pytest.approx(
                        (*states[i, POSE], states[i, SPEED], states[i, LANE], states[i, POSITION]),
                        abs=1e-9,
                    )
                    moved = max(moved, float(np.hypot(*(copy.pose[at, :2] - copy.pose[0, :2]))))
        assert k > 5 and moved > 20.0
    finally:
        loop.close()


def test_it_depends_on_what_the_ego_does() -> None:
    """A copy in which the ego stops tells of others who brake: without this the last test could
    pass with an ego that nobody minds."""
    loop = Loop(scene_of("straight-line"), 5)
    try:
        for _ in range(6):
            loop.scenes()
            loop.apply({"ego": decided(Release())})
        scene = loop.scenes()["ego"]
        going = loop.oracles.clone(scene, Release(), 0.2, 26)
        stopping = loop.oracles.clone(scene, Follow(np.zeros(50), 0), 0.2, 26)
        assert max(float(np.abs(going[i].v - stopping[i].v).max()) for i in going) > 2.0
    finally:
        loop.close()


def test_states_between_steps_lie_on_a_line_and_end_with_the_vehicle() -> None:
    rows = np.zeros((3, 1, 8))
    rows[:, 0, 0], rows[:, 0, 2], rows[:, 0, SPEED] = [0.0, 4.0, 0.0], 1.0, [8.0, 6.0, 0.0]
    rows[:, 0, LANE], rows[:, 0, POSITION], rows[:, 0, THERE] = (
        [3, 5, -1],
        [96.0, 1.0, 0.0],
        [1, 1, 0],
    )
    found = clone.at_times(rows, 0.5, 0.25, 5)[0]
    assert found.pose[:3, 0].tolist() == [0.0, 2.0, 4.0]
    assert found.v[:3].tolist() == [8.0, 7.0, 6.0]
    assert found.valid.tolist() == [True, True, True, False, False]
    assert found.lane[:3].tolist() == [3, 3, 5]
    assert found.s[:3].tolist() == [96.0, 96.0, 1.0]


# --- the original does not notice ---

OUTPUTS = (
    "tripinfo-output",
    "fcd-output",
    "statistic-output",
    "collision-output",
    "vehroute-output",
    "tripinfo-output.write-unfinished",
)
_CLOCK = re.compile(
    rb'<!--.*?-->|(?:duration|clock\w+|traciDuration|realTimeFactor|\w+UpdatesPerSecond)="[^"]*"',
    re.DOTALL,
)
LOADED_AT_ONCE = 1 << 20  # bytes: SUMO reads route files in pieces of this size


def crowded(folder: Path) -> ScenarioConfig:
    """The left turn among vehicles of a long route file, which SUMO has to go on reading during the
    episode."""
    scene = scene_of("unprotected-left-turn", "planner.name=constant")
    padding = "x" * 8000
    cars = [
        f'<vehicle id="more{k}" depart="{0.1 * k:.1f}" departLane="best"><route edges="from_south '
        f'to_north"/></vehicle><!-- {padding} -->'
        for k in range(600)
    ]
    path = folder / "long.rou.xml"
    path.write_text("<routes>" + "\n".join(cars) + "</routes>")
    assert path.stat().st_size > 3 * LOADED_AT_ONCE
    return scene.model_copy(
        update={"sumo": scene.sumo.model_copy(update={"routes": (*scene.sumo.routes, str(path))})}
    )


def copying(loop: Loop, _: Mapping[str, Driver], scenes: Mapping[str, Scene]) -> None:
    """A look ahead of 10 s in every cycle, for nothing."""
    for scene in scenes.values():
        loop.oracles.clone(scene, Release(), 0.2, 51)


def run_with_outputs(
    scene: ScenarioConfig,
    folder: Path,
    watch: Callable[[Loop, Mapping[str, Driver], Mapping[str, Scene]], None] | None,
) -> dict[str, bytes]:
    """The episode's digest, and every file that SUMO wrote, without what tells the time of day."""
    folder.mkdir()
    options = [
        word
        for name in OUTPUTS
        for word in (
            f"--{name}",
            str(folder / f"{name}.xml") if "unfinished" not in name else "true",
        )
    ]
    row = run_episode(scene, 1, sumo_options=[*options, "--route-steps", "2"], watch=watch).rows[0]
    assert row["outcome"] != "error", row["error"]
    assert row["cycles"] > 10
    return {
        "digest": row["trace_digest"].encode(),
        **{path.name: _CLOCK.sub(b"", path.read_bytes()) for path in folder.iterdir()},
    }


@pytest.mark.slow
def test_no_side_effects(tmp_path: Path) -> None:
    scene = crowded(tmp_path)
    alone, copied = (
        run_with_outputs(scene, tmp_path / "alone", None),
        run_with_outputs(scene, tmp_path / "copied", copying),
    )
    assert len(alone) == len(OUTPUTS)
    for name, text in alone.items():
        assert copied[name] == text, name
    assert set(copied) == set(alone)


def test_a_copy_opens_no_files(tmp_path: Path) -> None:
    """SUMO would write the state of a time to come over that of the original."""

    def work() -> np.ndarray:
        (tmp_path / "new").write_text("something")
        return np.zeros(1)

    with pytest.raises(SimulationError, match="Too many open files"):
        clone.in_copy(work, (1,))
    assert list(tmp_path.iterdir()) == []


def test_a_copy_writes_into_no_open_file_and_moves_no_reader(tmp_path: Path) -> None:
    (tmp_path / "read").write_text("0123456789")
    with (
        (tmp_path / "written").open("w") as written,
        (tmp_path / "read").open("rb", buffering=0) as read,
    ):
        written.write("before ")
        read.seek(3)

        def work() -> np.ndarray:
            written.write("in the copy")
            written.flush()
            return np.array([float(read.read(2))])

        assert clone.in_copy(work, (1,)) == 34.0
        assert read.read(2) == b"34"
        written.write("after")
    assert (tmp_path / "written").read_text() == "before after"


# --- the end of a copy ---


def answer(*, size: int = 3) -> np.ndarray:
    return np.arange(float(size))


def killed() -> np.ndarray:
    os.kill(os.getpid(), signal.SIGKILL)
    return answer()


def hanging() -> np.ndarray:
    time.sleep(60.0)
    return answer()


def raising() -> np.ndarray:
    raise LookupError("nobody there")


def leaving() -> np.ndarray:
    os._exit(0)


@pytest.mark.parametrize(
    ("work", "said"),
    [
        (killed, "ended by signal 9"),
        (raising, "ended with status 1: LookupError: nobody there"),
        (leaving, "ended with status 0"),
        (lambda: answer(size=2), "ended with status 0"),
        (hanging, "did not answer within 0.3 s"),
    ],
)
def test_a_copy_that_fails_is_an_error_and_leaves_nobody_behind(
    work: Callable[[], np.ndarray], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(clone, "PATIENCE_S", 0.3)
    before = len(list(Path("/proc/self/fd").iterdir()))
    with pytest.raises(SimulationError, match=said):
        clone.in_copy(work, (3,))
    assert len(list(Path("/proc/self/fd").iterdir())) == before
    assert clone.in_copy(answer, (3,)).tolist() == [0.0, 1.0, 2.0]


def test_a_large_answer_fits_through_the_pipe() -> None:
    assert clone.in_copy(lambda: answer(size=10**6), (10**6,))[-1] == 10**6 - 1


def test_an_interrupted_wait_leaves_nobody_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(_: int) -> bytes:
        raise KeyboardInterrupt

    monkeypatch.setattr(clone, "_read_all", interrupted)
    with pytest.raises(KeyboardInterrupt):
        clone.in_copy(hanging, (3,))


def test_an_episode_whose_copy_dies_is_an_outcome(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SimulationOracles, "_rehearse", lambda *_: killed())
    row = run_episode(
        scene_of("straight-line", "prediction.name=clone", "planner.iterations=50"), 0
    ).rows[0]
    assert row["outcome"] == "error"
    assert row["error"] == "SimulationError: the copy of the simulation ended by signal 9"


# --- where it works ---


@pytest.mark.slow
def test_the_planner_drives_with_it() -> None:
    scene = scene_of(
        "unprotected-left-turn",
        "prediction.name=clone",
        "planner.iterations=100",
        "episode.time_limit_s=4",
    )
    first, again = run_episode(scene, 3), run_episode(scene, 3)
    assert first.rows[0]["outcome"] == "timeout", first.rows[0]
    assert (first.rows[0]["prediction"], first.rows[0]["variant"]) == ("clone", "mcts-clone-100")
    assert again.rows[0]["trace_digest"] == first.rows[0]["trace_digest"]
    assert first.traces[0].cycles[5].forecast.reacts.all()


@pytest.mark.slow
def test_the_nominal_ego_is_the_rest_of_the_last_command(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[Follow | Release] = []
    copied = SimulationOracles.copied

    def noted(
        oracles: SimulationOracles, scene: Scene, nominal: Follow | Release, dt: float, count: int
    ) -> object:
        told.append(nominal)
        return copied(oracles, scene, nominal, dt, count)

    def again(_: Loop, drivers: Mapping[str, Driver], scenes: Mapping[str, Scene]) -> None:
        drivers["ego"].forecast(scenes["ego"], "clone", 1.0)

    monkeypatch.setattr(SimulationOracles, "copied", noted)
    scene = scene_of(
        "straight-line", "prediction.name=clone", "planner.iterations=100", "episode.time_limit_s=8"
    )
    cycles = run_episode(scene, 1, watch=again).traces[0].cycles
    commands = [cycle.decision.command for cycle in cycles]
    before, after = told[::2], told[1::2]
    assert isinstance(before[0], Release)
    for command, nominal in zip(commands, after, strict=True):
        assert np.array_equal(nominal.speeds, command.speeds[:20])
        assert nominal.lane_change == command.lane_change
    for command, nominal in zip(commands[:-1], before[1:], strict=True):
        assert np.array_equal(nominal.speeds, command.speeds[5:25])
        assert nominal.lane_change == 0
    assert any(command.lane_change for command in commands)


@pytest.mark.slow
def test_scripted_agents_do_not_react_in_it() -> None:
    scene = scene_of("highway-exit-scripted", "prediction.name=clone", "planner.iterations=50")
    forecast = run_episode(scene, 0).traces[0].cycles[2].forecast
    assert len(forecast.reacts) > 2
    assert not forecast.reacts.any()
    assert not forecast.yields.any()


def test_it_says_where_it_does_not_work(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scene_of("straight-line", "prediction.name=clone")
    with pytest.raises(ConfigError, match="a copy has no window"):
        run_episode(scene, 0, gui=True)
    with pytest.raises(ConfigError, match="SUMO's option threads is 2"):
        run_episode(scene, 0, sumo_options=["--threads", "2"])
    with pytest.raises(
        ConfigError, match=r"option save-state\.times is 900, a copy saves no states"
    ):
        run_episode(scene, 0, sumo_options=["--save-state.times", "900"])
    monkeypatch.setattr(clone.sys, "platform", "win32")
    with pytest.raises(ConfigError, match="Linux only"):
        run_episode(scene, 0)
