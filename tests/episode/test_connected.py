"""The same drive in a SUMO that runs by itself: `run --connect`, and Controller over TraCI."""

import socket
import subprocess
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import libsumo
import pytest
import traci
from helpers_networks import car, four_arms

from sumo_mcts import config
from sumo_mcts.config import ScenarioConfig
from sumo_mcts.controller import Controller
from sumo_mcts.episode.launch import LaunchOptions
from sumo_mcts.episode.run import open_episode, run_episode
from sumo_mcts.errors import ConfigError
from sumo_mcts.world import connected
from sumo_mcts.world.arguments import REFEREE_OPTIONS, sumo_program
from sumo_mcts.world.connected import Connected

CARS = (("we", 40.0), ("sn", 45.0), ("ew", 30.0), ("ns", 20.0))
JUDGED = [word for name, value in REFEREE_OPTIONS.items() for word in (f"--{name}", value)]
CAR = {"id": "x", "driver": "sumo", "route": ["wc", "ce"], "depart": {"time_s": 0}}
SETS = ("planner.iterations=100", "episode.time_limit_s=60")


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """A crossing of right before left, with four cars."""
    four_arms(tmp_path, "right_before_left")
    cars = "".join(car(*each) for each in CARS)
    (tmp_path / "x.rou.xml").write_text(
        f'<routes><vType id="car" speedDev="0"/>{cars}</routes>', encoding="utf-8"
    )
    (tmp_path / "x.sumocfg").write_text(
        '<configuration><net-file value="x.net.xml"/><route-files value="x.rou.xml"/>'
        '<step-length value="0.1"/><seed value="5"/></configuration>',
        encoding="utf-8",
    )
    return tmp_path / "x.sumocfg"


def scenario(sumocfg: Path, *sets: str) -> ScenarioConfig:
    data = {"name": "crossing", "sumo": {"sumocfg": str(sumocfg)}, "egos": [{"id": "s"}]}
    return config.build(data, "test", (*SETS, *sets))


@contextmanager
def started(sumocfg: Path, *options: str) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """SUMO in a process and a folder of its own, from where it names its files; its address."""
    with closing(socket.socket()) as free:
        free.bind(("localhost", 0))
        port = free.getsockname()[1]
    command = [sumo_program("sumo"), "-c", sumocfg.name, "--remote-port", str(port), *options]
    process = subprocess.Popen(
        command, cwd=sumocfg.parent, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    try:
        yield f"localhost:{port}", process
    finally:
        process.kill()
        process.communicate()


def answered(address: str) -> Any:
    """A connection of traci's, as a user makes it."""
    return connected._connected(address).connection


@pytest.mark.slow
@pytest.mark.smoke
def test_run_decides_alike_in_another_process(scene: Path) -> None:
    own = run_episode(scenario(scene))
    with started(scene, *JUDGED) as (address, process):
        options = LaunchOptions(connect=address)
        with open_episode(scenario(scene), options=options) as result:
            pass
        out, _ = process.communicate(timeout=20.0)  # it ends with its only connection
    assert own.rows[0]["outcome"] == "arrived"
    assert own.rows[0]["trace_digest"] == result.rows[0]["trace_digest"]
    assert (result.manifest["connected_to"], result.manifest["reproducible"]) == (address, False)
    assert own.manifest["reproducible"] and "connected_to" not in own.manifest
    assert b"Error" not in out  # nothing was asked for that is not there


def drive(sumo: Any, controller: Controller) -> list[tuple[float, ...]]:
    """Where the ego is in each step."""
    places, steps = [], 0
    while sumo.simulation.getMinExpectedNumber() and steps < 600:
        controller.step()
        sumo.simulationStep()
        steps += 1
        if "s" in sumo.vehicle.getIDList():
            places.append((*sumo.vehicle.getPosition("s"), sumo.vehicle.getSpeed("s")))
    return places


@pytest.mark.slow
def test_a_controller_drives_alike_over_a_connection(scene: Path) -> None:
    """Both simulations at once, step by step, each with a controller of the same vehicle."""
    libsumo.start(["sumo", "-c", str(scene), *JUDGED, "--no-step-log"])
    with started(scene, *JUDGED) as (address, _):
        connection = answered(address)
        settings = {"planner": {"iterations": 100}}
        net = {"sumo": {"net": str(scene.with_name("x.net.xml"))}}
        here = Controller("s", settings, seed=3)
        there = Controller("s", {**settings, **net}, seed=3, connection=connection)
        try:
            for _ in range(40):
                for sumo, controller in ((libsumo, here), (connection, there)):
                    controller.step()
                    sumo.simulationStep()
            assert here.driving and there.driving
            assert drive(libsumo, here) == drive(connection, there) != []
            assert not here.driving and not there.driving
        finally:
            libsumo.close()
            connection.close()


def test_the_module_traci_stands_for_its_connection_in_use(scene: Path) -> None:
    traci.start([sumo_program("sumo"), "-c", str(scene), *JUDGED, "--no-step-log"])
    controller = Controller("s", scenario(scene), connection=traci)
    while not controller.driving:
        controller.step()
        traci.simulationStep()
    controller.release()
    assert traci.vehicle.getSpeedMode("s") == 31  # SUMO's own
    traci.close()
    late = Controller("s", scenario(scene), connection=traci) if traci.isLoaded() else None
    assert late is None


def test_a_missing_network_and_a_closed_connection_are_named(scene: Path) -> None:
    with started(scene, *JUDGED) as (address, _):
        connection = answered(address)
        with pytest.raises(
            ConfigError, match=r"x\.net\.xml: SUMO's network is not found from here"
        ):
            Controller("s", connection=connection)
        net = {"sumo": {"net": str(scene.with_name("x.net.xml"))}}
        controller = Controller("s", net, connection=connection)
        controller.step()
        connection.close()
        with pytest.raises(ConfigError, match="connection: it is closed, or SUMO has ended"):
            controller.step()
        assert not controller.driving


def test_who_never_departs_is_named(scene: Path) -> None:
    with started(scene, *JUDGED) as (address, _):
        connection = answered(address)
        net = {"sumo": {"net": str(scene.with_name("x.net.xml"))}}
        settings = {**net, "episode": {"depart_limit_s": 2}}
        controller = Controller("nobody", settings, connection=connection)
        with pytest.raises(ConfigError, match="nobody: never departed within 2 s"):
            drive(connection, controller)
        connection.close()


@pytest.mark.parametrize("given", ["localhost:8813", 8813, object()])
def test_what_is_no_connection_is_refused(given: object) -> None:
    with pytest.raises(ConfigError, match="connection: one of traci's"):
        Controller("s", connection=given)


def test_traci_without_a_connection_is_refused() -> None:
    with pytest.raises(ConfigError, match="connection: traci: "):
        Controller("s", connection=traci)


@pytest.mark.parametrize("address", ["", "8813", "localhost", "localhost:", "localhost:0", ":8813",
    "localhost:65536", "localhost:-1", "localhost:٣", "localhost:8813/"])  # fmt: skip
def test_wrong_addresses_are_refused(address: str) -> None:
    with pytest.raises(ConfigError, match="--connect: host:port of a SUMO"):
        Connected(address)


def test_nobody_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connected, "PATIENCE_S", 0.5)
    with pytest.raises(ConfigError, match=r"nobody answers at localhost:1 .*--remote-port 1 "):
        Connected("localhost:1")


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ((), "collision.action teleport, collision.check-junctions false, collision.mingap-factor"),
        ((*JUDGED[:4], "--collision.mingap-factor", "1"), "runs with collision.mingap-factor 1"),
    ],
)
def test_options_with_which_nothing_could_be_judged_are_refused(
    options: tuple[str, ...], named: str, scene: Path
) -> None:
    with started(scene, *options) as (address, process):
        with pytest.raises(ConfigError, match=named):
            Connected(address)
        process.communicate(timeout=20.0)  # and SUMO was let go


@pytest.mark.slow
def test_where_the_connection_ends_so_does_the_episode(scene: Path) -> None:
    with started(scene, *JUDGED) as (address, process):

        def ends(*_: object) -> None:
            process.kill()
            process.wait()

        options = LaunchOptions(connect=address)
        with open_episode(scenario(scene), options=options, watch=ends) as result:
            (row,) = result.rows
    assert row["outcome"] == "error"
    assert "Connection closed by SUMO" in row["error"]
    assert run_episode(scenario(scene)).rows[0]["outcome"] == "arrived"  # libsumo is in use again


@pytest.mark.parametrize(
    ("data", "named"),
    [
        (
            {"sumo": {"dense": {"kind": "crossing"}}},
            "sumo: with --connect the files of a drawn",
        ),
        ({"traffic": {"actors": [CAR]}}, "traffic: with --connect"),
        ({"prediction": {"name": "clone"}}, "prediction.name: clone copies a simulation"),
    ],
)
def test_what_only_a_sumo_of_ours_has_is_refused(
    data: dict[str, Any], named: str, scene: Path
) -> None:
    own = {"name": "x", "sumo": {"sumocfg": str(scene)}, "egos": [{"id": "s"}], **data}
    with (
        pytest.raises(ConfigError, match=named),
        open_episode(config.build(own, "test"), options=LaunchOptions(connect="localhost:1")),
    ):
        pass
