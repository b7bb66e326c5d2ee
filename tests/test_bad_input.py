"""Wrong input through the command line: one line that names file and key, status 2 (or an outcome),
nothing left behind, no traceback."""

import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from attack.kinds.options import commands, options

from sumo_mcts import cli, records
from sumo_mcts.registry import PLANNERS

FILES = Path(__file__).parent / "bad_inputs"
PATIENCE_S = 60.0


class Answer(NamedTuple):
    status: int
    out: str
    err: str


Command = Callable[..., Answer]


@pytest.fixture
def command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Iterator[Command]:
    """sumo-mcts in this process, with a folder of its own for temporary files, which has to be
    empty afterwards."""
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.chdir(FILES)
    before = signal.getsignal(signal.SIGINT)

    def run(*words: str) -> Answer:
        monkeypatch.setattr(sys, "argv", ["sumo-mcts", *words])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return Answer(int(end.value.code or 0), *capfd.readouterr())

    yield run
    signal.signal(signal.SIGINT, before)
    assert list(scratch.iterdir()) == []


SCENARIOS = {
    "net-missing": "sumo.net: {folder}/nowhere.net.xml: no such file",
    "crowd-edge": "traffic.crowd.streams: stream 1: route: no connection leads from from_west to "
    "from_east",
    "crowd-id": "crowd-id.yaml: traffic: actors: crowd_1: ids that begin with crowd_ are the "
    "crowd's",
    "crowd-lane": "traffic.crowd.streams: stream 2: depart.lane: from_west has lanes 0 to 2, got 3",
    "crowd-order": "crowd-order.yaml: traffic.crowd.streams.0: pos_m: give the smaller number "
    "first",
    "crowd-streams": "crowd-streams.yaml: traffic.crowd: count: give streams too",
    "drivers-negative": "drivers-negative.yaml: traffic.drivers.aggressive: has to be at least 0",
    "net-junk": "{folder}/junk.net.xml: not a readable SUMO network",
    "net-truncated": "{folder}/truncated.net.xml: not a readable SUMO network",
    "net-empty": "{folder}/empty.net.xml: not a readable SUMO network",
    "routes-missing": "sumo.routes: {folder}/nowhere.rou.xml: no such file",
    "routes-truncated": "In file '{folder}/truncated.rou.xml' At line",
    "routes-unknown-edge": "The edge 'to_nowhere' within the route for vehicle 'ego' is not known",
    "routes-unknown-type": "The vehicle type 'tank' for vehicle 'ego' is not known",
    "routes-same-id": "'ego'",
    "comma": "sumo.routes",
    "not-yaml": "not valid YAML: line 2, column 5",
    "not-a-mapping": "a scenario is a mapping of keys",
    "nothing": "a scenario is a mapping of keys",
    "not-text": "not valid YAML",
    "base-missing": "base: nowhere.yaml: no such file",
    "base-network": "base-network.yaml: base: ../../networks/crossing/crossing.net.xml: a file of "
    "SUMO's; allowed: a scenario file, or the name of a built-in one",
    "base-circle": "base: base-circle.yaml leads back to itself",
    "event-vehicle": "traffic.events: nobody: no file of the simulation names such a vehicle",
    "key-unknown": "planner.iteration: unknown key; allowed: name, iterations,",
    "section-unknown": "planer: unknown key; allowed: name, description, sumo,",
    "weight-text": "cost.headway: has to be a number, got 'heavy'",
    "weight-nan": "cost.headway: has to be a finite number, got nan",
    "weight-negative": "cost.jerk: has to be at least 0, got -1",
    "planner-unknown": f"planner.name: has to be {', '.join(map(repr, PLANNERS))}, an installed "
    "plugin (there is none) or module:name, got 'alphazero'",
    "sensor-negative": "sensor.position_error_m: has to be at least 0, got -0.3",
    "sensor-nan": "sensor.speed_error_mps: has to be a finite number, got nan",
    "sensor-share": "sensor.drop_probability: has to be at most 1, got 3",
    "sensor-time-zero": "sensor.error_time_s: has to be at least 0.01, got 0",
    "sumo-both": "sumo: give either sumocfg or net or dense",
    "no-egos": "egos: has to have at least 1 entry",
    "name-unsafe": "name: has to be a text like ^[A-Za-z0-9]",
    "option-unknown": "No option with the name 'warp-speed' exists",
    "option-of-the-referee": "sumo.options: collision.action: the referee needs warn",
    "step-zero": "sumo.step_length_s: has to be at least 0.001, got 0",
    "success-unknown": "episode.success_edge: the network has no edge to_nowhere; among its 8 "
    "edges: ",
    "success-off-route": "episode.success_edge: the route of ego does not pass edge to_south, only "
    "from_west to_north",
    "until-unknown": "egos: ego: until: the network has no edge to_nort; among its 8 edges: "
    "to_north",
    "until-off-route": "egos: ego: until: the route of ego does not pass edge to_east, only "
    "from_west to_north",
    "actor-edge-unknown": "traffic.actors: ego: route: the network has no edge to_nowhere; among "
    "its 8 edges: ",
    "actor-route-disconnected": "traffic.actors: ego: route: no connection leads from from_west to "
    "from_east",
    "actor-lane": "traffic.actors: ego: depart.lane: from_west has lanes 0 to 2, got 7",
    "actor-position": "traffic.actors: ego: depart.pos_m: from_west_0 is ",
    "actor-type": "The vehicle type 'tank' for vehicle 'ego' is not known",
}


@pytest.mark.parametrize("name", SCENARIOS)
def test_scenarios(name: str, command: Command, tmp_path: Path) -> None:
    check(
        command("run", f"{name}.yaml", "--out", str(tmp_path / "out")),
        f"{name}.yaml",
        SCENARIOS[name],
        tmp_path,
    )


SCENARIOS |= {
    "yaml-date": "not valid YAML: line 4, column 14: a date: allowed are",
    "yaml-deep": "lists and mappings more than 40 deep",
    "yaml-twice": "given twice",
    "yaml-aliases": "more than 50000 values",
    "yaml-tag": "!!python/name:os.system: allowed are",
    "number-truth": "planner.iterations: has to be a whole number, got True",
    "number-text": "planner.iterations: has to be a whole number, got '12'",
    "number-huge": "cost.headway: has to be at most 1000000",
    "option-serves": "sumo.options: remote-port: SUMO would wait for another program; leave it out",
    "option-device": "sumo.routes: /dev/zero: a device, not a file",
    "option-pipe": "sumo.options: fcd-output: localhost:9393: a socket, not a file",
}

SUMOCFGS = {
    "truncated": "not a SUMO configuration",
    "empty": "not a SUMO configuration",
    "cfg-key-unknown": "No option with the name 'warp-speed' exists",
    "cfg-step-text": "Invalid Number Format (double) fast (step-length)",
    "cfg-net-missing": "net-file: {folder}/nowhere.net.xml: no such file",
    "cfg-no-net": "net-file: not given",
    "cfg-net-empty": "{folder}/empty.net.xml: not a readable SUMO network",
    "cfg-serves": "cfg-serves.sumocfg: remote-port: SUMO would wait for another program; leave it "
    "out",
    "cfg-saves": "cfg-saves.sumocfg: save-configuration: SUMO would write that and end; leave it "
    "out",
    "cfg-meso": "cfg-meso.sumocfg: mesosim: in a mesoscopic simulation vehicles have no positions; "
    "leave it out",
    "cfg-step-long": "cfg-step-long.sumocfg: step-length: has to be from 0.001 to 10, got 1e300",
    "cfg-sublane": "cfg-sublane.sumocfg: lateral-resolution: has to be from 0.1 to 100, got 0.0001",
    "cfg-encoding": "not a SUMO configuration (unknown encoding: foo)",
    "cfg-entities": "not a SUMO configuration (entities may not be declared)",
    "cfg-routes-device": "route-files: /dev/zero: a device, not a file",
    "cfg-routes-missing": "route-files: {folder}/nowhere.rou.xml: no such file",
}


@pytest.mark.parametrize("name", SUMOCFGS)
@pytest.mark.parametrize("ego", [(), ("--ego", "any"), ("--ego", "ego")])
def test_sumocfgs(name: str, ego: tuple[str, ...], command: Command, tmp_path: Path) -> None:
    check(
        command("run", f"{name}.sumocfg", *ego, "--out", str(tmp_path / "out")),
        f"{name}.sumocfg",
        SUMOCFGS[name],
        tmp_path,
    )


OPTIONS = [
    (("run", "highway-exit", "stray"), "stray: unexpected; options for SUMO follow --"),
    (
        ("run", "good.sumocfg", "--ego", "--planner", "mcts"),
        "mcts: unexpected; options for SUMO follow --",
    ),
    (("run", "empty.net.xml"), "empty.net.xml: a file of SUMO's; give the .sumocfg that names it"),
    (
        ("run", "good.sumocfg", "--ego", "ego", "--ego", "ego"),
        "good.sumocfg: egos: ego is named twice",
    ),
    (
        ("run", "highway-exit", "--ego", "any"),
        "egos: any: no file of the simulation names such a vehicle; the scenario's own: ego, ",
    ),
    (
        ("run", "nowhere"),
        "nowhere: no such scenario; give a .yaml, a .sumocfg, or one of: century-avenue-right",
    ),
    (("run", "nowhere.yaml"), "nowhere.yaml: no such scenario"),
    (("run", "nowhere.sumocfg", "--ego", "any"), "nowhere.sumocfg: no such file"),
    (
        ("run", "cfg-nobody.sumocfg", "--ego", "any"),
        "cfg-nobody.sumocfg: --ego any: no suitable vehicle departs",
    ),
    (
        ("run", "good.yaml", "--set", "cost.headway=heavy"),
        "good.yaml: cost.headway: has to be a number",
    ),
    (
        ("run", "good.yaml", "--set", "cost.headway=[1"),
        "--set cost.headway=[1: the value is not valid YAML",
    ),
    (
        ("run", "good.yaml", "--set", "cost.heading=1"),
        "good.yaml: cost.heading: unknown key; allowed: contact,",
    ),
    (("run", "good.yaml", "--set", "cost"), "--set cost: write it as key.subkey=value"),
    (("run", "good.yaml", "--set", "name.x=1"), "--set name.x=1: name has no keys below it"),
    (
        ("run", "good.yaml", "--set", "prediction.hypotheses=9"),
        "good.yaml: prediction.hypotheses: has to be at most 8, got 9",
    ),
    (
        ("run", "good.yaml", "--set", "prediction.hypotheses=0"),
        "good.yaml: prediction.hypotheses: has to be at least 1, got 0",
    ),
    (
        ("run", "good.yaml", "--set", "planner.risk=averse"),
        "good.yaml: planner.risk: has to be 'expected' or 'cvar', got 'averse'",
    ),
    (
        ("run", "good.yaml", "--set", "planner.cvar_alpha=0"),
        "good.yaml: planner.cvar_alpha: has to be at least 0.001, got 0",
    ),
    (
        ("run", "good.yaml", "--set", "failsafe.decel_mps2=0"),
        "good.yaml: failsafe.decel_mps2: has to be at least 0.01",
    ),
    (("run", "good.yaml", "--planner", "alphazero"), "good.yaml: planner.name"),
    (("run", "good.yaml", "--prediction", "oracle"), "good.yaml: prediction.name"),
    (
        ("run", "good.yaml", "--planner", "nowhere:X"),
        (
            "good.yaml: planner.name: nowhere:X: code that a scenario names runs only with "
            "--allow-plugins"
        ),
    ),
    (
        ("forecast", "good.yaml", "--set", "prediction.name=nowhere:X"),
        "prediction.name: nowhere:X: code that a scenario names runs only with",
    ),
    (
        ("run", "good.yaml", "--planner", "nowhere:X", "--allow-plugins"),
        "good.yaml: planner.name: nowhere:X: nowhere cannot be imported: ModuleNotFound",
    ),
    (
        ("run", "good.yaml", "--set", "cost.term=idle"),
        (
            "good.yaml: cost.term: has to be an installed plugin (there is none) or module:name, got "
            "'idle'"
        ),
    ),
    (
        ("regret", "good.yaml", "--planners", "mcts,nowhere:X"),
        "--planners: nowhere:X: code that a scenario names runs only with --allow-plugins",
    ),
    (
        ("regret", "good.yaml", "--planners", "mcts,alphazero"),
        "--planners: alphazero: not one that can be asked for a single decision; allowed: ",
    ),
    (
        ("run", "good.yaml", "--time-budget", "-1"),
        "good.yaml: planner.time_budget_ms: has to be at least 0.01",
    ),
    (
        ("run", "good.yaml", "--set", "planner.most_iterations=10"),
        "good.yaml: planner: most_iterations: at least iterations (1000), got 10",
    ),
    (("run", "good.yaml", "--time-limit", "nan"), "has to be a number, got 'nan'"),
    (
        ("run", "good.yaml", "--ego", "eggo"),
        "good.yaml: egos: eggo: no file of the simulation names such a vehicle; near: ego",
    ),
    (
        ("run", "good.sumocfg", "--ego", "nobody"),
        (
            "egos: nobody: no file of the simulation names such a vehicle; `sumo-mcts run "
            "{folder}/good.sumocfg` lists"
        ),
    ),
    (
        ("forecast", "good.sumocfg", "--ego", "nobody"),
        "good.sumocfg: egos: nobody: no file of the simulation names such a vehicle",
    ),
    (
        ("run", "good.yaml", "--ego-until", "to_nowhere"),
        "good.yaml: egos: ego: until: the network has no edge to_nowhere",
    ),
    (("run", "good.yaml", "--gui"), "--gui: no display"),
    (
        ("run", "good.yaml", "--", "--warp-speed", "9"),
        "good.yaml: SUMO does not start: On processing option '--warp-speed': No option",
    ),
    (
        ("run", "good.yaml", "--", "--step-length", "0"),
        "good.yaml: options after --: step-length: has to be from 0.001 to 10, got 0",
    ),
    (
        ("run", "good.yaml", "--", "--collision.action", "remove"),
        "options after --: collision.action: the referee needs warn",
    ),
    (
        ("run", "good.yaml", "--", "--fcd-output", "/nowhere/fcd.xml"),
        "Could not build output file '/nowhere/fcd.xml'",
    ),
    (
        ("run", "good.yaml", "--", "--remote-port", "9393"),
        "options after --: remote-port: SUMO would wait for another program; leave it out",
    ),
    (
        ("run", "good.yaml", "--", "-Cx"),
        "options after --: save-configuration: SUMO would write that and end; leave it out",
    ),
    (("run", "good.yaml", "--", "-W", "help"), "good.yaml: "),
    (
        ("run", "good.sumocfg", "--", "-c", "other.sumocfg"),
        "options after --: configuration-file: set by sumo_mcts itself; leave it out",
    ),
    (("run", "good.yaml", "--ego", "a\nb\x1b[31m"), "a\\nb\\x1b[31m"),
    (("run", "/dev/zero"), "/dev/zero: a device, not a file"),
    (("run", "."), ".: a folder, not a file"),
    (("run", f"{'x' * 300}.yaml"), ".yaml: cannot be read: File name too long"),
    (("run", "good.yaml", "--bogus"), "No such option: --bogus"),
    (("run", "good.yaml", "--iterations", "many"), "'--iterations'"),
    (("run", "good.yaml", "--iterations", "0"), "'--iterations'"),
    (("run", "good.yaml", "--seed", "-1"), "'--seed'"),
    (
        ("run", "good.yaml", "--prediction", "clone", "--gui"),
        (
            "good.yaml: prediction.name: clone: a copy has no window; leave --gui out; allowed here: "
            "idm"
        ),
    ),
    (
        ("run", "good.yaml", "--prediction", "clone", "--", "--threads", "2"),
        "good.yaml: prediction.name: clone: SUMO's option threads is 2, a copy has one",
    ),
    (
        ("forecast", "good.yaml", "--", "--save-state.times", "900"),
        "prediction.name: clone: SUMO's option save-state.times is 900, a copy saves no",
    ),
    (
        ("forecast", "good.yaml", "--", "--threads", "2"),
        "good.yaml: prediction.name: clone: SUMO's option threads is 2, a copy has one thread",
    ),
    (("forecast", "good.yaml", "--seeds", "0"), "'--seeds'"),
    (("forecast", "good.yaml", "--planner", "alphazero"), "good.yaml: planner.name"),
    (
        ("forecast", "good.sumocfg"),
        "good.sumocfg: --ego: not given; `sumo-mcts run good.sumocfg` lists the candidates",
    ),
    (
        ("regret", "nowhere"),
        "nowhere: no such scenario; give a .yaml, a .sumocfg, or one of: century-avenue-right",
    ),
    (
        ("regret", "good.yaml", "--planners", "mcts,sumo"),
        (
            "--planners: sumo: not one that can be asked for a single decision; allowed: mcts, paper, "
            "idm"
        ),
    ),
    (
        ("regret", "good.yaml", "--iterations", "10,many"),
        "--iterations 10,many: whole numbers from 1 on, separated by commas, as in 100,1000",
    ),
    (("regret", "good.yaml", "--iterations", "0"), "--iterations 0: whole numbers from 1 on"),
    (("regret", "good.yaml", "--every", "0"), "'--every'"),
    (
        ("regret", "good.yaml", "--set", "planner.step_s=0.5"),
        (
            "good.yaml: planner.look_ahead_steps: with planner.rollout_steps and planner.step_s a "
            "forecast of 4 s"
        ),
    ),
    (
        ("regret", "good.sumocfg"),
        "good.sumocfg: --ego: not given; `sumo-mcts run good.sumocfg` lists the candidates",
    ),
    (("report", "nowhere"), "nowhere: no such folder"),
    (
        ("report", "."),
        (
            ".: episodes.jsonl: no such file; `sumo-mcts run` and `sumo-mcts batch` write one with "
            "--out"
        ),
    ),
    (("report", "good.yaml"), "good.yaml: no such folder"),
    (
        ("report", ".", "--out", "good.yaml/in"),
        "--out good.yaml/in: good.yaml is a file, not a folder",
    ),
    (("report",), "Missing argument"),
    (("run",), "Missing argument"),
    (("bogus",), "No such command 'bogus'"),
    (("validate", "key-unknown.yaml"), "key-unknown.yaml: planner.iteration: unknown key"),
    (
        ("validate", "net-missing.yaml"),
        "net-missing.yaml: sumo.net: {folder}/nowhere.net.xml: no such file",
    ),
    (("validate", "nowhere.yaml"), "nowhere.yaml: no such file"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("words", "said"), OPTIONS, ids=[" ".join(words) for words, _ in OPTIONS])
def test_options(words: tuple[str, ...], said: str, command: Command, tmp_path: Path) -> None:
    check(command(*words), "", said, tmp_path)


BESIDE = {
    "run": ("good.yaml",), "forecast": ("good.yaml",), "drivers": ("good.yaml",),
    "regret": ("good.yaml",), "value": ("good.yaml",),
    "batch": ("quick", "--out", "/nowhere"), "article": ("--out", "/nowhere"),
}  # fmt: skip


def integer_options() -> list[tuple[str, str]]:
    """(command, option) of every option that takes a whole number, or several of them."""
    found = [
        (name, option.name)
        for name, function in commands().items()
        for option in options(function)
        if option.kind is int
    ]
    return [*found, ("regret", "--iterations"), ("batch", "--shard")]


@pytest.mark.parametrize(("name", "option"), integer_options())
@pytest.mark.parametrize("digits", [3000, 6000])  # Python reads numbers of 4300 digits
def test_numbers_of_thousands_of_digits(
    name: str, option: str, digits: int, command: Command
) -> None:
    begun, number = time.monotonic(), "9" * digits
    value = f"1/{number}" if option == "--shard" else number
    answer = command(name, *BESIDE[name], option, value)
    assert (answer.status, answer.out) == (2, "")
    (line,) = answer.err.splitlines()
    assert line.startswith("error: ")
    assert option.removeprefix("--") in line
    assert len(line) < 2500
    assert time.monotonic() - begun < 10.0


def check(answer: Answer, file: str, said: str, tmp_path: Path) -> None:
    """Status 2 and one line that names the file and says what is wrong."""
    assert answer.status == 2, answer
    assert answer.out == ""
    (line,) = answer.err.splitlines()
    assert file in line
    assert said.format(folder=FILES) in line
    assert "Traceback" not in line
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("inside", ["", "/further/down"])
def test_an_output_folder_that_cannot_be_written(
    inside: str, command: Command, tmp_path: Path
) -> None:
    (tmp_path / "out").write_text("a file")
    answer = command("run", "good.yaml", "--out", f"{tmp_path / 'out'}{inside}")
    assert answer.status == 2
    (line,) = answer.err.splitlines()
    assert f"--out {tmp_path / 'out'}{inside}: {tmp_path / 'out'} is a file, not a folder" in line


def test_the_folder_of_a_batch_takes_no_run(command: Command, tmp_path: Path) -> None:
    records.write_manifest(
        tmp_path / "out", {"experiment": {"name": "x"}, "experiment_digest": "0"}
    )
    before = (tmp_path / "out" / records.MANIFEST).read_bytes()
    answer = command(
        "run", "nowhere", "--out", str(tmp_path / "out")
    )  # refused before anything is read
    assert (answer.status, answer.out, answer.err) == (
        2,
        "",
        f"error: --out {tmp_path / 'out'}: holds a batch; take another --out\n",
    )
    assert [(path.name, path.read_bytes()) for path in (tmp_path / "out").iterdir()] == [
        (records.MANIFEST, before)
    ]


# --- what happens during the run is an outcome ---

RUNS: dict[str, tuple[tuple[str, ...], str, str]] = {
    "never made": (
        ("good.sumocfg", "--ego", "ego.7"),
        "error",
        "never departed: no vehicle is left and none is to come; the first that did: ego, other",
    ),
    "too late": (
        ("good.yaml", "--ego", "ego.7", "--set", "episode.depart_limit_s=2"),
        "error",
        "never departed within 2 s (episode.depart_limit_s); the",
    ),
    "after the end": (
        ("good.sumocfg", "--ego", "ego.7", "--", "--end", "2"),
        "error",
        "never departed before the simulation's end at 2 s (SUMO's option end)",
    ),
    "disconnected": (
        ("routes-disconnected.yaml",),
        "error",
        "No connection between edge 'from_west' and edge 'from_east'",
    ),
    "vanished": (("vanishing.sumocfg", "--ego", "ego"), "error", "vanished"),
    "teleported": (("teleported.sumocfg", "--ego", "ego"), "teleported", ""),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", RUNS)
def test_outcomes(case: str, command: Command, tmp_path: Path) -> None:
    words, outcome, error = RUNS[case]
    answer = command("run", "--planner", "sumo", "--json", "--out", str(tmp_path / "out"), *words)
    (row,) = json.loads(answer.out)["episodes"]
    assert row["outcome"] == outcome
    assert answer.status == (1 if outcome == "error" else 0)
    assert error in (row["error"] or "")
    assert answer.err.splitlines() == (
        [f"error: {row['scenario']}: ego {row['ego']}: {row['error']}"] if error else []
    )
    roads = ["maps"] if any((tmp_path / "out" / "traces").iterdir()) else []
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "episodes.csv", "episodes.jsonl", "figures", "manifest.json", "manifests", *roads, "traces"
    ]  # fmt: skip


# --- what a user without an ego in mind sees ---


def test_without_ego_lists(command: Command) -> None:
    answer = command("run", "good.sumocfg")
    assert (answer.status, answer.err) == (0, "")
    assert [line.split()[0] for line in answer.out.splitlines()[1:]] == ["ego", "other"]
    listed = json.loads(command("run", "good.sumocfg", "--json").out)
    assert [item["id"] for item in listed] == ["ego", "other"]


def test_any_ego(command: Command) -> None:
    answer = command("run", "good.sumocfg", "--ego", "any", "--planner", "sumo", "--json")
    assert (answer.status, answer.err) == (0, "")
    (row,) = json.loads(answer.out)["episodes"]
    assert (row["ego"], row["outcome"]) == ("ego", "arrived")


# --- a process of its own ---


def start(*words: str, **environment: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "sumo_mcts", *words]
    return subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **environment},
    )


@pytest.mark.slow
@pytest.mark.parametrize("after_s", [1.0, 3.0])
def test_interrupted(after_s: float, tmp_path: Path) -> None:
    process = start(
        "run",
        "straight-line",
        "--set",
        "planner.iterations=20000",
        "--out",
        str(tmp_path / "out"),
        XDG_CACHE_HOME=str(tmp_path),
    )
    time.sleep(after_s)
    process.send_signal(signal.SIGINT)
    sent = time.monotonic()
    out, err = process.communicate(timeout=PATIENCE_S)
    assert time.monotonic() - sent < 3.0
    assert (process.returncode, out) == (130, "")
    assert err.splitlines()[-1] == "interrupted"
    assert "Traceback" not in err
    assert not (tmp_path / "out").exists()


IN_A_CALLBACK = """
import ctypes, signal, sys, time
from sumo_mcts import cli

@ctypes.CFUNCTYPE(None)
def callback():
    signal.raise_signal(signal.SIGINT)
    time.sleep(0.0)

def app(standalone_mode):
    callback()
    for _ in range(300):
        time.sleep(0.1)

cli.app = app
cli.main()
"""


def test_an_interrupt_in_a_callback_is_not_lost() -> None:
    """Python ignores what is raised in a callback from compiled code, such as the compiler's."""
    begun = time.monotonic()
    answer = subprocess.run(
        [sys.executable, "-c", IN_A_CALLBACK],
        check=False,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert (answer.returncode, answer.stdout, answer.stderr) == (130, "", "interrupted\n")
    assert time.monotonic() - begun < 20.0


@pytest.mark.slow
def test_help_is_quick() -> None:
    def seconds() -> float:
        """Of a core: what else the machine does is no matter."""
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        out, _ = start("run", "--help").communicate(timeout=PATIENCE_S)
        assert "--ego-until" in out
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    assert min(seconds() for _ in range(3)) < 0.5


@pytest.mark.slow
def test_the_terminal_stays_clean_where_a_sumocfg_is_verbose(tmp_path: Path) -> None:
    text = (
        (FILES / "good.sumocfg")
        .read_text()
        .replace("../../", f"{FILES.parent.parent}/")
        .replace('"one.', f'"{FILES}/one.')
    )
    chatty = tmp_path / "chatty.sumocfg"
    chatty.write_text(text.replace("</conf", '    <verbose value="true"/>\n</conf'))
    process = start("run", str(chatty), "--ego", "ego", "--planner", "sumo", "--json")
    out, err = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, err) == (0, "")
    assert json.loads(out)["schema_version"] == 1
