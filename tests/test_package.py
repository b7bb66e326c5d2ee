"""The package as an installed one: its types, its version, its errors, its metadata."""

import re
import subprocess
import sys
import sysconfig
import tomllib
import venv
from importlib import metadata
from pathlib import Path

import pytest
import yaml

import sumo_mcts
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments.problems import BatchError

TOP = Path(__file__).resolve().parent.parent
SCRIPT = """\
import sumo_mcts

reveal_type(sumo_mcts.__version__)
reveal_type(sumo_mcts.load_scenario)
sumo_mcts.load_scenario(3)
"""


def printed(*command: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=TOP)


@pytest.mark.slow
def test_mypy_finds_the_types_of_an_installed_package(tmp_path: Path) -> None:
    """The package lies in the site-packages of an environment, where only py.typed tells mypy."""
    environment = tmp_path / "environment"
    venv.create(environment, symlinks=True)
    (site,) = environment.glob("lib/python*/site-packages")
    (site / "sumo_mcts").symlink_to(TOP / "sumo_mcts")
    (site / "others.pth").write_text(sysconfig.get_path("purelib"))
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    python = environment / "bin" / "python"
    told = subprocess.run(
        [sys.executable, "-m", "mypy", "--config-file=", "--python-executable", python,
         "--cache-dir", tmp_path / "cache", script],
        capture_output=True, text=True, check=False, cwd=tmp_path, env={"PATH": "/usr/bin:/bin"},
    ).stdout  # fmt: skip
    assert 'Revealed type is "str"' in told or 'Revealed type is "builtins.str"' in told
    assert re.search(r"Revealed type is \"def \(.*\) -> .*Scenario", told), told
    assert "script.py:5: error: Argument 1" in told and "[import-untyped]" not in told


@pytest.mark.parametrize("module", [True, False], ids=["python -m", "sumo-mcts"])
def test_the_version_is_told(module: bool) -> None:
    version = metadata.version("sumo-mcts")
    command = Path(sys.executable).with_name("sumo-mcts")
    done = printed(*([sys.executable, "-m", "sumo_mcts"] if module else [command]), "--version")
    assert (done.returncode, done.stdout, done.stderr) == (0, f"sumo-mcts {version}\n", "")
    assert sumo_mcts.__version__ == version


def test_errors_are_at_hand() -> None:
    assert sumo_mcts.ConfigError is ConfigError and sumo_mcts.BatchError is BatchError
    with pytest.raises(sumo_mcts.ConfigError, match="no-such-scene"):
        sumo_mcts.load_scenario("no-such-scene")


def test_the_metadata_agree_with_the_citation() -> None:
    project = tomllib.loads((TOP / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = yaml.safe_load((TOP / "CITATION.cff").read_text(encoding="utf-8"))
    assert project["authors"] == citation["authors"]
    for key in ("version", "license", "keywords"):
        assert project[key] == citation[key], key
