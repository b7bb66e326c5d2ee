"""What users set in their own files: measures of their own for SUMO's safety device, a seed of
SUMO's choice, variables, other names."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from sumo_mcts.cli import app

TOP = Path(__file__).resolve().parents[2]
NET = TOP / "networks" / "straight-line" / "straight-line.net.xml"
ROUTES = """<routes>
    <vType id="mine">{parameters}</vType>
    <vehicle id="ahead" type="mine" depart="0" departPos="80" departSpeed="3" maxSpeed="3"><route edges="road beyond"/></vehicle>
    <vehicle id="ego" type="mine" depart="0" departPos="50" departSpeed="8"><route edges="road beyond"/></vehicle>
</routes>"""


def row(
    folder: Path, more: str, *words: str, parameters: str = "", name: str = "a.sumocfg"
) -> dict[str, object]:
    """The row of an episode of a few seconds."""
    (folder / "r.rou.xml").write_text(ROUTES.format(parameters=parameters))
    (folder / name).write_text(
        f'<configuration><net-file value="{NET}"/><route-files value="r.rou.xml"/><step-length '
        f'value="0.1"/>{more}</configuration>'
    )
    answer = CliRunner().invoke(
        app,
        [
            "run",
            str(folder / name),
            "--ego",
            "ego",
            "--planner",
            "sumo",
            "--time-limit",
            "6",
            "--json",
            *words,
        ],
        catch_exceptions=False,
    )
    (found,) = json.loads(answer.output[answer.output.index("{") :])["episodes"]
    return dict(found)


@pytest.mark.parametrize(
    "parameters",
    [
        "",
        '<param key="device.ssm.measures" value="TTC"/>',
        '<param key="device.ssm.range" value="30"/>',
    ],
)
def test_surrogate_measures_are_ours_or_unknown(parameters: str, tmp_path: Path) -> None:
    found = row(tmp_path, "", parameters=parameters)
    assert (found["outcome"], found["error"]) == ("timeout", None)
    if parameters:
        assert (found["min_ttc_s"], found["min_pet_s"], found["max_drac_mps2"]) == (
            None,
            None,
            None,
        )


def test_a_seed_of_sumos_choice_is_drawn_and_told(tmp_path: Path) -> None:
    drawn = {row(tmp_path, '<random value="true"/>')["seed"] for _ in range(2)}
    assert len(drawn) == 2
    seed = next(iter(drawn))
    again = [
        row(tmp_path, '<random value="true"/>', "--seed", str(seed))["trace_digest"]
        for _ in range(2)
    ]
    assert again[0] == again[1] == row(tmp_path, "", "--seed", str(seed))["trace_digest"]


def test_another_name_and_variables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SCEN", str(tmp_path))
    (tmp_path / "types.add.xml").write_text("<additional/>")
    assert (
        row(tmp_path, '<additional-files value="${SCEN}/types.add.xml"/>', name="a.sumo.cfg")[
            "outcome"
        ]
        == "timeout"
    )


@pytest.mark.parametrize(
    ("attribute", "value"),
    [("width", "inf"), ("length", "inf"), ("width", "1e9"), ("accel", "inf")],
)
def test_a_vehicle_that_is_none(attribute: str, value: str, tmp_path: Path) -> None:
    line = refused(
        tmp_path,
        ROUTES.format(parameters="").replace('id="mine"', f'id="mine" {attribute}="{value}"'),
    )
    assert "vehicle type of " in line and attribute in line


@pytest.mark.parametrize(
    "flow",
    [
        'number="99999999999"',
        'number="inf"',
        'period="exp(inf)"',
        'period="exp(1e300)"',
        'period="exp(nan)"',
    ],
)
def test_a_flow_without_end(flow: str, tmp_path: Path) -> None:
    line = refused(
        tmp_path,
        ROUTES.format(parameters="").replace(
            "</routes>", f'<flow id="f" begin="0" end="9" {flow} from="road" to="beyond"/></routes>'
        ),
    )
    assert "route-files: " in line and "flow f: " in line


def test_a_speed_that_is_none(tmp_path: Path) -> None:
    line = refused(
        tmp_path, ROUTES.format(parameters="").replace('departSpeed="8"', 'departSpeed="nan"')
    )
    assert "a.sumocfg: vehicle ego: SUMO tells no finite position and speed of it" in line


def refused(folder: Path, routes: str) -> str:
    """The line with which an episode with these routes is refused."""
    (folder / "r.rou.xml").write_text(routes)
    (folder / "a.sumocfg").write_text(
        f'<configuration><net-file value="{NET}"/><route-files value="r.rou.xml"/><step-length '
        'value="0.1"/></configuration>'
    )
    answer = CliRunner().invoke(
        app,
        [
            "run",
            str(folder / "a.sumocfg"),
            "--ego",
            "ego",
            "--planner",
            "constant",
            "--time-limit",
            "3",
            "--quiet",
        ],
    )
    (line,) = answer.output.splitlines()
    assert answer.exit_code == 2
    return line
