"""Options of SUMO: read as SUMO reads them, and refused where an episode does not bear them."""

import os
import socket
from pathlib import Path

import pytest
from helpers_fuzz import refusal
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts.config import SumoConfig, build
from sumo_mcts.errors import ConfigError
from sumo_mcts.world.arguments import (
    draws_seed,
    is_sumocfg,
    network_of,
    require_good,
    sumo_arguments,
    sumocfg_arguments,
)
from sumo_mcts.world.crowd import Cast
from sumo_mcts.world.options import Given, expanded, on_command_line, option_names

TOP = Path(__file__).resolve().parents[2]
NET = TOP / "networks" / "straight-line" / "straight-line.net.xml"
ROUTES = TOP / "routes" / "straight-line.rou.xml"


def sumo(**options: str | float | bool) -> SumoConfig:
    return SumoConfig(net=str(NET), routes=(str(ROUTES),), options=options)


def sumocfg(folder: Path, inner: str, name: str = "a.sumocfg") -> str:
    path = folder / name
    path.write_text(
        f'<configuration><net-file value="{NET}"/><route-files '
        f'value="{ROUTES}"/>{inner}</configuration>'
    )
    return str(path)


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("--end 5 --begin=1", [("end", "5"), ("begin", "1")]),
        ("-e 5 -b=1", [("end", "5"), ("begin", "1")]),
        ("-e5", [("end", "5")]),
        ("-vWe 5", [("verbose", "true"), ("no-warnings", "true"), ("end", "5")]),
        ("-e -1", [("end", "-1")]),
        ("--verbose -W false", [("verbose", "true"), ("no-warnings", "false")]),
        ("--save-config x", [("save-configuration", "x")]),
        ("-cother.sumocfg", [("configuration-file", "other.sumocfg")]),
        ("-vcother.sumocfg", [("verbose", "true"), ("configuration-file", "other.sumocfg")]),
        ("-?", [("help", "true")]),
    ],
)
def test_a_command_line_is_read_as_sumo_does(words: str, found: list[tuple[str, str]]) -> None:
    assert on_command_line(words.split(), "here") == [Given(*each) for each in found]
    assert option_names(words.split()) == {name for name, _ in found}


REFUSED = [
    "--remote-port 9393", "--num-clients 2", "--save-configuration x", "-C x", "-Cx",
    "--save-template x", "--save-schema x", "--save-commented", "--help",
    "-?", "--version", "-V", "--game", "-G", "--demo", "--breakpoints 3", "--gui-testing",
    "--mesosim", "--no-internal-links", "--ignore-accidents",
    "--random", "--abs-rand", "--step-length 0", "--step-length 11", "--step-length nan",
    "--lateral-resolution 0.0001", "--scale 1e9", "--threads 1000",
    "--thread-rngs 0", "--begin 1e15", "--end 1e300", "--lanechange.duration 0:0:3",
    "--default.action-step-length 1e9", "-c other.sumocfg", "-cx", "-vc x",
    "--net-file x", "-n x", "--error-log x", "--collision.action none", "--device.ssm.range 3",
    "--route-files /dev/zero", "-r .", "-a nowhere.xml",
    "--load-state nowhere", "--weight-files /dev/null", "--fcd-output localhost:9999",
    "--fcd-output /dev/zero", "--tripinfo /", "help", "save-configuration x",
]  # fmt: skip


@pytest.mark.parametrize("words", REFUSED)
def test_refused_behind_the_dashes(words: str) -> None:
    with pytest.raises(ConfigError, match=r"^options after --: "):
        require_good(sumo(), words.split())


@pytest.mark.parametrize(
    "name", ["configuration-file", "net-file", "n", "c", "error-log", "device.ssm.range"]
)
def test_the_options_of_a_scenario_do_not_replace_its_network(name: str) -> None:
    assert "set by sumo_mcts itself" in refusal(lambda: require_good(sumo(**{name: str(NET)})))


@pytest.mark.parametrize(
    ("name", "value", "fine"),
    [
        ("remote-port", 8813, False), ("remote-port", 0, True), ("num-clients", 1, True), ("mesosim", True, False), ("mesosim", False, True),
        ("help", True, False), ("step-length", 100, False), ("lateral-resolution", -1, True),
        ("lateral-resolution", 0, True), ("end", -1, True), ("end", "nan", False), ("lateral-resolution", 0.8, True),
        ("lateral-resolution", 0.001, False), ("fcd-output", "stdout", True), ("fcd-output", "/dev/null", True), ("save-configuration", "", True),
        ("game.mode", "tls", True),
    ],
)  # fmt: skip
def test_in_a_scenario_and_in_a_sumocfg(
    name: str, value: str | float | bool, fine: bool, tmp_path: Path
) -> None:
    said = refusal(lambda: require_good(sumo(**{name: value})))
    assert said.startswith(f"sumo.options: {name}: ") or (fine and said == "")
    text = str(value).lower() if isinstance(value, bool) else str(value)
    path = sumocfg(tmp_path, f'<x><{name} value="{text}"/></x>')
    said = refusal(lambda: require_good(SumoConfig(sumocfg=path)))
    assert said.startswith(f"{path}: {name}: ") or (fine and said == "")


@pytest.mark.parametrize("name", ["demo", "game", "breakpoints", "gui-testing"])
def test_what_concerns_the_window_of_a_sumocfg_is_passed_over(name: str, tmp_path: Path) -> None:
    """SUMO's own games have it (fokr_bs_demo.sumocfg)."""
    path = sumocfg(tmp_path, f'<x><gui_only><{name} value="1"/></gui_only></x>')
    require_good(SumoConfig(sumocfg=path))


def test_pipes_and_sockets_are_never_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / "socket"))
        for key, name in (
            ("route-files", "pipe"),
            ("additional-files", "socket"),
            ("fcd-output", "pipe"),
            ("load-state", "pipe"),
            ("weight-files", "pipe"),
        ):
            with pytest.raises(ConfigError, match=rf"options after --: {key}: .*, not a file$"):
                require_good(sumo(), ["-W", f"--{key}", str(tmp_path / name)])
        for name in ("pipe", "socket", "."):
            other = str(tmp_path / name)
            for config in (
                SumoConfig(net=other),
                SumoConfig(net=str(NET), routes=(other,)),
                SumoConfig(net=str(NET), additional=(other,)),
            ):
                with pytest.raises(
                    ConfigError, match=r"^sumo\.(net|routes|additional): .*, not a file$"
                ):
                    require_good(config)


def test_every_missing_file_is_told() -> None:
    with pytest.raises(ConfigError) as refused:
        require_good(SumoConfig(net="nowhere.net.xml", routes=("a.rou.xml", "b.rou.xml")))
    assert len(refused.value.every) == 3


# --- what is a .sumocfg, and what stands in it ---


def test_a_sumocfg_by_any_name(tmp_path: Path) -> None:
    assert is_sumocfg(sumocfg(tmp_path, "", "a.sumo.cfg"))
    assert is_sumocfg(sumocfg(tmp_path, "", "a.cfg"))
    assert is_sumocfg("nowhere.sumocfg")
    assert not is_sumocfg("straight-line")
    assert not is_sumocfg(str(NET))
    assert not is_sumocfg(str(TOP / "configs" / "straight-line.yaml"))
    assert not is_sumocfg("/dev/zero")


def test_variables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SCEN", "/scen")
    monkeypatch.setenv("HOME", "/home/me")
    monkeypatch.delenv("NOTHING", raising=False)
    told = {
        "${SCEN}/a.xml": "/scen/a.xml", "a${NOTHING}b": "ab", "$SCEN/a": "$SCEN/a",
        "~/a,~/b": "/home/me/a,/home/me/b", "a~": "a~", "${}": "${}",
        "${SCEN}${SCEN}": "/scen/scen", "%20": "%20", "${PID}": str(os.getpid()),
    }  # fmt: skip
    assert {value: expanded(value) for value in told} == told
    monkeypatch.setenv("SCEN", str(NET.parent))
    path = tmp_path / "a.sumocfg"
    path.write_text(f'<configuration><net-file value="${{SCEN}}/{NET.name}"/></configuration>')
    assert network_of(str(path), None) == str(NET)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "not a SUMO configuration"),
        (b"<configuration>", "not a SUMO configuration"),
        (
            b'<?xml version="1.0" encoding="foo"?><configuration/>',
            "not a SUMO configuration (unknown encoding: foo)",
        ),
        (b'<?xml version="1.0" encoding="utf-7"?><configuration/>', "not a SUMO configuration"),
        (
            b'<!DOCTYPE c [<!ENTITY a "b">]><configuration/>',
            "not a SUMO configuration (entities may not be declared)",
        ),
        (
            b'<!DOCTYPE c [<!ENTITY a SYSTEM "/etc/passwd">]><configuration/>',
            "not a SUMO configuration (entities may not be declared)",
        ),
        (b"\x1f\x8b\x08", "an archive that is cut off"),
        (b"\0" * 100, "not a SUMO configuration"),
    ],
)
def test_damaged_configurations(content: bytes, said: str, tmp_path: Path) -> None:
    path = tmp_path / "a.sumocfg"
    path.write_bytes(content)
    assert said in refusal(lambda: network_of(str(path), None))


def test_a_configuration_in_utf_16(tmp_path: Path) -> None:
    path = tmp_path / "a.sumocfg"
    path.write_text(
        '<?xml version="1.0" encoding="utf-16"?><configuration><net-file '
        f'value="{NET}"/></configuration>',
        encoding="utf-16",
    )
    assert network_of(str(path), None) == str(NET)


# --- seeds ---


def test_no_episode_has_a_seed_of_sumos_choice(tmp_path: Path) -> None:
    path = sumocfg(tmp_path, '<random value="true"/>')
    assert draws_seed(SumoConfig(sumocfg=path))
    assert not draws_seed(
        SumoConfig(sumocfg=sumocfg(tmp_path, '<random value="false"/>', "b.sumocfg"))
    )
    config = build({"name": "x", "sumo": {"sumocfg": path}, "egos": [{"id": "ego"}]}, "x")
    for seed, told in ((3, ["--seed", "3"]), (None, [])):
        for words in (
            sumo_arguments(config, seed, Cast(), tmp_path, ()),
            sumocfg_arguments(path, seed, ()),
        ):
            assert words[words.index("--random") + 1] == "false"
            assert ("--seed" in words) == bool(told)
    with pytest.raises(ConfigError, match="seed: at most 2147483647, got 2147483648"):
        sumo_arguments(config, 2**31, Cast(), tmp_path, ())


@given(st.lists(st.sampled_from(REFUSED) | st.text(max_size=8), max_size=4))
def test_any_words(words: list[str]) -> None:
    said = refusal(lambda: require_good(sumo(), words))
    assert said.isprintable()
