"""Dense situations become networks and traffic that SUMO simulates."""

import subprocess
from itertools import product
from pathlib import Path

import pytest

from sumo_mcts.config import SumoConfig, builtin, load
from sumo_mcts.episode.run import run_episode
from sumo_mcts.errors import ConfigError
from sumo_mcts.situations import DENSE, FAMILIES, HALVES, PASSING, RULES
from sumo_mcts.world import generated
from sumo_mcts.world.arguments import sumo_home

EGO_DEPARTS_UNTIL_S = 160
# What SUMO's drivers do now and then in dense traffic.
HARMLESS = ("emergency braking", "emergency stop", "collision")


def dense(kind: str, half: str = "development", family: str = "krauss") -> SumoConfig:
    """A dense situation, as a scenario names it."""
    return SumoConfig.model_validate({"dense": {"kind": kind, "half": half, "family": family}})


def whole(kind: str) -> SumoConfig:
    """A situation without halves, as a scenario names it."""
    return SumoConfig.model_validate({"rule" if kind in RULES else "passing": {"kind": kind}})


def warnings(text: str) -> list[str]:
    """The warnings and errors in what a program of SUMO's printed."""
    lines = [line for line in text.splitlines() if line.startswith(("Warning", "Error"))]
    return [
        line
        for line in lines
        if not any(word in line for word in HARMLESS) or ("collision" in line and "'ego'" in line)
    ]


def simulated(sumo: SumoConfig, seed: int, folder: Path) -> "subprocess.CompletedProcess[str]":
    """What SUMO prints on the way until 30 s after the ego's latest departure."""
    command = [
        str(Path(sumo_home()) / "bin" / "sumo"), "--net-file", str(sumo.net),
        "--route-files", ",".join(sumo.routes), "--step-length", "0.2", "--seed", str(seed),
        "--end", str(EGO_DEPARTS_UNTIL_S + 30), "--time-to-teleport", "-1", "--no-step-log",
        "--tripinfo-output", str(folder / "trips.xml"), "--tripinfo-output.write-unfinished",
        *(part for key, value in sumo.options.items() for part in (f"--{key}", str(value))),
    ]  # fmt: skip
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "half"), [*product(DENSE, HALVES), *((kind, None) for kind in (*RULES, *PASSING))]
)
def test_a_kind_builds_and_moves_without_a_warning(
    kind: str, half: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    printed, run = [], subprocess.run

    def listened(*args, **options):
        done = run(*args, **options)
        printed.append(done.stdout + done.stderr)
        return done

    for seed in (1, 2):
        monkeypatch.setattr(subprocess, "run", listened)
        sumo = generated.standing(
            whole(kind) if half is None else dense(kind, half), seed, tmp_path
        )
        monkeypatch.undo()
        done = simulated(sumo, seed, tmp_path)
        assert done.returncode == 0
        assert warnings("\n".join([*printed, done.stdout, done.stderr])) == []
        assert 'id="ego"' in (tmp_path / "trips.xml").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("kind", DENSE)
def test_sumos_driver_drives_a_kind_for_half_a_minute(kind: str) -> None:
    config = load(
        builtin.scenario_path(f"dense-{kind}"), ("planner.name=sumo", "episode.time_limit_s=30")
    )
    (row,) = run_episode(config, 1).rows
    assert row["outcome"] in {"timeout", "arrived"}, row["error"]
    assert row["distance_m"] > 50


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_drives(family: str, tmp_path: Path) -> None:
    sumo = generated.standing(dense("lane-drop", family=family), 1, tmp_path)
    done = simulated(sumo, 1, tmp_path)
    assert done.returncode == 0 and warnings(done.stdout + done.stderr) == []
    assert (tmp_path / "trips.xml").read_text().count('arrival="-1') < 100


@pytest.mark.slow
def test_an_episode_of_a_seed_is_the_same_again() -> None:
    config = load(
        builtin.scenario_path("dense-side-road"), ("planner.name=sumo", "episode.time_limit_s=20")
    )
    first, again, other = (run_episode(config, seed).rows[0] for seed in (5, 5, 6))
    assert first["distance_m"] == again["distance_m"] != other["distance_m"]


def test_without_a_dense_situation_nothing_is_written(tmp_path: Path) -> None:
    sumo = SumoConfig(net="some.net.xml")
    assert generated.standing(sumo, 1, tmp_path) is sumo
    assert list(tmp_path.iterdir()) == []


def test_the_scenarios_own_options_and_routes_stay(tmp_path: Path) -> None:
    given = dense("zipper", family="sl2015").model_copy(
        update={"routes": ("mine.rou.xml",), "options": {"lateral-resolution": 0.4}}
    )
    sumo = generated.standing(given, None, tmp_path)
    assert sumo.routes[1:] == ("mine.rou.xml",) and sumo.options == {"lateral-resolution": 0.4}
    assert sumo.dense is None and Path(str(sumo.net)).is_file()


def test_what_netconvert_refuses_is_a_wrong_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(generated.situations, "plain_files", lambda _: {"node-files": "<nodes>"})
    with pytest.raises(ConfigError, match=r"situation ramp: netconvert: Error"):
        generated.standing(dense("ramp"), 1, tmp_path)


@pytest.mark.parametrize(
    ("key", "value"), [("kind", "nowhere"), ("half", "middle"), ("family", "none")]
)
def test_unknown_names_are_refused(key: str, value: str) -> None:
    with pytest.raises(ConfigError, match=rf"sumo\.dense\.{key}: "):
        load(builtin.scenario_path("dense-ramp"), (f"sumo.dense.{key}={value}",))
