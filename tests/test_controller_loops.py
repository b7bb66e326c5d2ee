"""Controller in loops that do the unusual: other simulations, other controllers, steps too few and
too many, vehicles that never come or come again."""

import gc
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import libsumo
import pytest

from sumo_mcts.controller import Controller
from sumo_mcts.driver.driver import PlannerError
from sumo_mcts.errors import ConfigError

NET, ROUTES = "networks/straight-line/straight-line.net.xml", "routes/straight-line.rou.xml"
SETTINGS: dict[str, Any] = {"planner": {"iterations": 50}}
OWN, DRIVEN = (
    (7, 512),
    (0, 0),
)  # speed mode and lane change mode: of the vehicle, and while it is driven


def arguments(step: str = "0.1") -> list[str]:
    return ["-n", NET, "-r", ROUTES, "--step-length", step, "--no-step-log", "--no-warnings"]


def add(vehicle: str = "ego", at: float = 60.0, **more: str) -> None:
    """A vehicle that departs in the next step."""
    if "way" not in libsumo.route.getIDList():
        libsumo.route.add("way", ["road", "beyond"])
    libsumo.vehicle.add(
        vehicle, "way", typeID="ego", departLane="1", departPos=str(at), departSpeed="2", **more
    )


def modes(vehicle: str = "ego") -> tuple[int, int]:
    return libsumo.vehicle.getSpeedMode(vehicle), libsumo.vehicle.getLaneChangeMode(vehicle)


def drive(*controllers: Controller, steps: int = 1) -> list[float]:
    """The ego's speeds after these steps."""
    speeds = []
    for _ in range(steps):
        for controller in controllers:
            controller.step()
        libsumo.simulationStep()
        speeds.append(libsumo.vehicle.getSpeed("ego"))
    return speeds


def taken_over(vehicle: str = "ego", planner: str = "mcts") -> Controller:
    """A controller that holds a vehicle whose modes were its user's own."""
    controller = Controller(vehicle, {"planner": {"name": planner, "iterations": 50}})
    libsumo.simulationStep()
    libsumo.vehicle.setSpeedMode(vehicle, OWN[0])
    libsumo.vehicle.setLaneChangeMode(vehicle, OWN[1])
    controller.step()
    assert controller.driving
    assert modes(vehicle) == DRIVEN
    return controller


@pytest.fixture(autouse=True)
def _simulation() -> Iterator[None]:
    libsumo.start(["sumo", *arguments()])
    add()
    yield
    libsumo.close()


# --- other simulations ---


def fresh(step: str) -> list[float]:
    """What a new controller does in a new simulation."""
    libsumo.load(arguments(step))
    add()
    controller = Controller("ego", SETTINGS, seed=3)
    return drive(controller, steps=20)


@pytest.mark.smoke
@pytest.mark.parametrize("step", ["0.1", "0.5"])
@pytest.mark.parametrize("restarts", [False, True])
def test_in_a_new_simulation_it_begins_anew(step: str, restarts: bool) -> None:
    controller = Controller("ego", SETTINGS, seed=3)
    drive(controller, steps=20)
    if restarts:
        libsumo.close()
        libsumo.start(["sumo", *arguments(step)])
    else:
        libsumo.load(arguments(step))
    add()
    assert not controller.driving
    speeds = drive(controller, steps=20)
    assert controller.driving
    assert modes() == DRIVEN
    assert speeds == fresh(step)


def test_also_after_its_vehicle_had_arrived_in_the_one_before() -> None:
    controller = Controller("ego", SETTINGS)
    drive(controller, steps=2)
    libsumo.vehicle.remove("ego")
    libsumo.simulationStep()
    controller.step()
    libsumo.load(arguments())
    add()
    drive(controller, steps=2)
    assert controller.driving


def test_a_released_one_stays_so() -> None:
    controller = taken_over()
    controller.release()
    libsumo.load(arguments())
    add()
    drive(controller, steps=2)
    assert not controller.driving
    assert modes() != DRIVEN


def test_what_it_held_before_is_not_handed_back_to_a_vehicle_of_another_simulation() -> None:
    controller = taken_over()
    libsumo.load(arguments())
    add()
    libsumo.simulationStep()
    libsumo.vehicle.setSpeedMode("ego", 3)
    controller.release()
    assert libsumo.vehicle.getSpeedMode("ego") == 3


def test_a_closed_simulation_is_named_and_the_next_one_driven_in() -> None:
    controller = taken_over()
    libsumo.close()
    assert not controller.driving
    for _ in range(2):
        with pytest.raises(
            ConfigError, match=r"^no simulation runs in this process: call libsumo\.start first"
        ):
            controller.step()
    libsumo.start(["sumo", *arguments()])
    add()
    drive(controller, steps=2)
    assert controller.driving
    libsumo.close()
    controller.release()


def test_a_state_is_driven_on_from(tmp_path: Path) -> None:
    controller = taken_over()
    libsumo.simulationStep()
    libsumo.simulation.saveState(str(tmp_path / "state.xml"))
    drive(controller, steps=8)
    libsumo.simulation.loadState(str(tmp_path / "state.xml"))
    assert drive(controller, steps=10)[-1] > 2.0 + 10 * 0.1
    assert modes() == DRIVEN
    time_then = libsumo.simulation.getTime()
    libsumo.load([*arguments(), "--load-state", str(tmp_path / "state.xml")])
    assert libsumo.simulation.getTime() < time_then
    drive(controller, steps=2)
    assert controller.driving
    assert modes() == DRIVEN


def test_a_state_of_the_same_moment_costs_no_control(tmp_path: Path) -> None:
    """SUMO keeps no modes in a state, so a vehicle that was driven is not any more."""
    controller = taken_over()
    libsumo.simulation.saveState(str(tmp_path / "state.xml"))
    libsumo.simulation.loadState(str(tmp_path / "state.xml"))
    assert modes() != DRIVEN
    drive(controller, steps=2)
    assert modes() == DRIVEN


# --- several controllers ---


@pytest.mark.parametrize("connected", [True, False])
def test_controllers_of_connected_vehicles_tell_each_other_their_plans(connected: bool) -> None:
    """The one whose step() comes later knows the new plan of the other."""
    add("second", at=85.0)
    egos = [{"id": name, "connected": connected} for name in ("ego", "second")]
    with Controller("second", {**SETTINGS, "egos": egos}) as ahead:
        with Controller("ego", {**SETTINGS, "egos": egos}) as behind:
            for _ in range(20):
                ahead.step()
                behind.step()
                libsumo.simulationStep()
            first, then = ahead.thought, behind.thought
        assert first is not None and then is not None and then.forecast is not None
        plan, told = first.decision.plan, then.answers.told
        assert plan is not None
        assert len(told.agent) == connected
        if connected:
            rows = told.valid[0, 1:].sum()
            assert told.v[0, 1 : rows + 1] == pytest.approx(plan.v[1::2][:rows])
            assert (then.forecast.v[0, : rows + 1, 0] == told.v[0, : rows + 1]).all()


def test_a_second_controller_is_refused_until_the_first_lets_go() -> None:
    first = taken_over()
    for _ in range(2):
        with pytest.raises(
            ConfigError,
            match=r"^Controller: ego: another Controller drives this vehicle; release\(\) that one "
            r"first$",
        ):
            Controller("ego", SETTINGS)
    assert first.driving
    first.release()
    second = Controller("ego", SETTINGS)
    second.step()
    assert modes() == DRIVEN
    second.release()
    assert modes() == OWN


@pytest.mark.smoke
def test_a_controller_that_is_garbage_hands_its_vehicle_back() -> None:
    controller = taken_over()
    del controller
    gc.collect()
    assert modes() == OWN
    Controller("ego", SETTINGS)


def test_a_controller_whose_drive_is_over_leaves_the_id_to_others() -> None:
    first = taken_over()
    libsumo.vehicle.remove("ego")
    libsumo.simulationStep()
    first.step()
    assert not first.driving
    add()
    second = Controller("ego", SETTINGS)
    drive(first, second, steps=3)
    assert (first.driving, second.driving) == (False, True)


def test_a_closed_simulation_frees_every_vehicle() -> None:
    first = taken_over()
    libsumo.close()
    libsumo.start(["sumo", *arguments()])
    add()
    second = Controller("ego", SETTINGS)
    drive(second, steps=2)
    with pytest.raises(ConfigError, match="another Controller drives this vehicle"):
        first.step()
    assert second.driving
    assert modes() == DRIVEN


def test_two_vehicles_have_a_controller_each() -> None:
    add("other", 120.0)
    both = Controller("ego", SETTINGS), Controller("other", SETTINGS)
    drive(*both, steps=10)
    assert [controller.driving for controller in both] == [True, True]
    both[0].release()
    assert modes("ego") != DRIVEN
    assert modes("other") == DRIVEN


# --- steps ---


def test_a_second_call_in_a_step_does_nothing() -> None:
    once = drive(Controller("ego", SETTINGS), steps=40)
    libsumo.load(arguments())
    add()
    controller = Controller("ego", SETTINGS)
    assert drive(controller, controller, controller, steps=40) == once


def test_steps_without_a_call_do_not_delay_the_plan() -> None:
    """The speed is kept in them, and caught up with as fast as the bounds allow; lane changes take
    their time."""
    settings = {"planner": {"iterations": 50, "period_s": 1.0}, "failsafe": {"on": False}}
    whole = drive(Controller("ego", settings), steps=10)
    libsumo.load(arguments())
    add()
    controller = Controller("ego", settings)
    some = [*drive(controller, steps=4), *drive(steps=3), *drive(controller, steps=3)]
    assert some[:4] == whole[:4]
    assert some[4:7] == [some[3]] * 3
    assert controller.thought is not None
    command: Any = controller.thought.decision.command
    assert some[-1] == pytest.approx(min(command.speeds[8], some[-2] + 0.26), abs=1e-3)


def test_a_lane_change_goes_on_in_steps_without_a_call() -> None:
    from sumo_mcts.world.command import Bounds, Commander
    from sumo_mcts.world.observe import Change, Observer
    from sumo_mcts.world.roadmap import read_roadmap

    road = read_roadmap(NET)
    commander = Commander("ego", road, Observer(road).lanes, Bounds(0.1, 3.0, 2.6, 4.5, 10.0))
    commander.change = Change(0.2, 0, 1)
    commander.skip(6)
    assert commander.change.progress == pytest.approx(0.4)
    commander.skip(18)
    assert commander.change == Change()


# --- vehicles that do not come, go, and come again ---


def until_none_is_left(controller: Controller, most: int = 2000) -> None:
    for _ in range(most):
        if libsumo.simulation.getMinExpectedNumber() == 0:
            return
        controller.step()
        libsumo.simulationStep()


@pytest.mark.smoke
def test_a_mistyped_id_is_named_when_the_traffic_is_over() -> None:
    controller = Controller("eggo", SETTINGS)
    with pytest.raises(
        ConfigError,
        match=r"^Controller: eggo: never departed: no vehicle is left and none is to come; near: "
        r"ego$",
    ):
        until_none_is_left(controller)
    libsumo.simulationStep()  # said once
    controller.step()


def test_a_mistyped_id_is_named_after_the_time_to_wait() -> None:
    controller = Controller("eggo", {**SETTINGS, "episode": {"depart_limit_s": 2.0}})
    with pytest.raises(
        ConfigError,
        match=r"^Controller: eggo: never departed within 2 s \(episode\.depart_limit_s\); near: "
        r"ego$",
    ):
        until_none_is_left(controller)
    assert libsumo.simulation.getTime() == pytest.approx(2.0)


def test_a_controller_may_be_made_before_there_is_any_traffic() -> None:
    libsumo.load(arguments())
    controller = Controller("ego", SETTINGS)
    for _ in range(5):
        controller.step()
        libsumo.simulationStep()
    add()
    drive(controller, steps=2)
    assert controller.driving


def test_nobody_waits_for_the_vehicle_of_a_controller_that_is_released_or_garbage() -> None:
    Controller("eggo", SETTINGS).release()
    kept = Controller("egggo", SETTINGS)
    del kept
    gc.collect()
    while libsumo.simulation.getMinExpectedNumber():
        libsumo.simulationStep()
    libsumo.simulationStep()


def test_a_vehicle_that_comes_again_under_its_id_is_another_one() -> None:
    controller = taken_over()
    libsumo.simulationStep()
    libsumo.vehicle.remove("ego")
    add()
    libsumo.simulationStep()
    libsumo.vehicle.setSpeedMode("ego", 3)
    drive(controller, steps=3)
    assert not controller.driving
    controller.release()
    assert libsumo.vehicle.getSpeedMode("ego") == 3
    another = Controller("ego", SETTINGS)
    another.step()
    assert modes() == DRIVEN


def block_the_next_edge() -> list[str]:
    """Vehicles that stand so close on it that SUMO finds no room for another one."""
    libsumo.route.add("end", ["beyond"])
    standing = [f"{lane}_{k}" for lane in range(3) for k in range(11)]
    for vehicle in standing:
        lane, k = vehicle.split("_")
        libsumo.vehicle.add(
            vehicle,
            "end",
            typeID="ego",
            departLane=lane,
            departPos=str(6 + 9 * int(k)),
            departSpeed="0",
        )
        libsumo.vehicle.setMaxSpeed(vehicle, 0.001)
    return standing


def test_the_modes_are_given_back_while_sumo_teleports_the_vehicle_and_taken_again_afterwards() -> (
    None
):
    libsumo.load([*arguments(), "--collision.action", "teleport"])
    standing = block_the_next_edge()
    add("wall", 80.0)
    add("ego", 60.0)
    controller = taken_over(planner="constant")
    libsumo.vehicle.setSpeed("wall", 0.0)
    libsumo.vehicle.setLaneChangeMode("wall", 0)
    seen = [("on the road", True, DRIVEN)]
    for _ in range(300):
        libsumo.simulationStep()
        controller.step()
        where = "on the road" if "ego" in libsumo.vehicle.getIDList() else "teleporting"
        if (where, controller.driving, modes()) != seen[-1]:
            seen.append((where, controller.driving, modes()))
            if where == "on the road":
                break
            for vehicle in standing:
                libsumo.vehicle.remove(vehicle)
    assert seen == [
        ("on the road", True, DRIVEN),
        ("teleporting", False, OWN),
        ("on the road", True, DRIVEN),
    ]


# --- the modes are given back ---


def test_a_with_block_gives_the_modes_back_whatever_happens_in_it() -> None:
    controller = taken_over()
    with pytest.raises(ZeroDivisionError), controller:
        raise ZeroDivisionError
    assert modes() == OWN
    assert not controller.driving


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_a_step_that_raises_gives_the_modes_back(
    error: type[BaseException], monkeypatch: pytest.MonkeyPatch
) -> None:
    controller = taken_over()
    libsumo.simulationStep()

    def broken(*_: object) -> None:
        raise error("no idea")

    monkeypatch.setattr("sumo_mcts.planners.mcts.MctsPlanner.plan", broken)
    with pytest.raises(PlannerError if error is RuntimeError else error):
        drive(controller, steps=1000)
    monkeypatch.undo()
    assert modes() == OWN
    assert not controller.driving
    Controller("ego", SETTINGS)


def test_modes_that_the_loop_sets_meanwhile_are_those_to_give_back() -> None:
    controller = taken_over()
    libsumo.vehicle.setSpeedMode("ego", 3)
    drive(controller, steps=3)
    assert modes() == DRIVEN
    controller.release()
    assert libsumo.vehicle.getSpeedMode("ego") == 3


def test_how_often_a_vehicle_acts_is_given_back() -> None:
    libsumo.vehicletype.setActionStepLength("ego", 1.0)
    controller = taken_over()
    libsumo.vehicle.setSpeedMode("ego", 3)
    drive(controller, steps=2)
    assert libsumo.vehicle.getActionStepLength("ego") == pytest.approx(0.1)
    controller.release()
    assert libsumo.vehicle.getActionStepLength("ego") == 1.0


def test_release_never_raises(monkeypatch: pytest.MonkeyPatch) -> None:
    controller = taken_over()

    def broken(*_: object) -> None:
        raise libsumo.TraCIException("no")

    monkeypatch.setattr("sumo_mcts.driver.vehicle.EgoVehicle.release", broken)
    controller.release()
    controller.release()
    libsumo.close()
    controller.release()
    controller.step()


@pytest.mark.parametrize("ego", [5, "", None])
def test_what_is_no_id_is_named(ego: Any) -> None:
    with pytest.raises(ConfigError, match=r"^Controller: ego: the id of a vehicle, got "):
        Controller(ego, SETTINGS)


_IN_A_WINDOW = """
import libsumo, time
from test_controller_loops import SETTINGS, add, arguments, drive, modes
from sumo_mcts.controller import Controller
libsumo.start(["sumo-gui", *arguments(), "--start", "--quit-on-end"])
while "ego" not in libsumo.vehicletype.getIDList():  # the window's thread reads the routes
    time.sleep(0.01)
add()
controller = Controller("ego", SETTINGS)
drive(controller, steps=5)
print(controller.driving, modes())
controller.release()
print(modes(), flush=True)
import os
os._exit(0)  # whether the window closes is not the question here
"""


@pytest.mark.slow
def test_a_simulation_with_a_window_is_driven_in_alike() -> None:
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb is not installed: apt-get install --no-install-recommends xvfb")
    display = f":{200 + os.getpid() % 300}"
    server = subprocess.Popen(
        ["Xvfb", display, "-screen", "0", "800x600x24"], stderr=subprocess.DEVNULL
    )
    try:
        time.sleep(2.0)
        environment = {
            **os.environ,
            "DISPLAY": display,
            "PYTHONPATH": os.pathsep.join(["tests", *sys.path]),
        }
        done = subprocess.run(
            [sys.executable, "-c", _IN_A_WINDOW],
            env=environment,
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert done.stdout.splitlines()[-2:] == ["True (0, 0)", "(31, 1621)"], done.stderr
    finally:
        server.terminate()
        server.wait()


@pytest.mark.parametrize(
    ("options", "warned"),
    [
        ([], True),
        (["--collision.mingap-factor", "0"], False),
        (["--collision.action", "warn"], False),
    ],
)
def test_that_sumo_teleports_who_comes_near_is_logged(
    options: list[str], warned: bool, caplog: pytest.LogCaptureFixture
) -> None:
    libsumo.start(["sumo", *arguments(), *options])
    try:
        with Controller("ego", SETTINGS) as controller:
            add()
            drive(controller)
    finally:
        libsumo.close()
    assert ("--collision.mingap-factor 0" in caplog.text) == warned
