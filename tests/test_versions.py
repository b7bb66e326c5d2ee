"""Which interpreters `make test-versions` finds, and when it makes an environment anew."""

import sys
from pathlib import Path
from typing import Any

import pytest
import versions

RUN = versions.run
PROJECT = {"requires-python": ">=3.11,<3.14"}


def interpreter(path: Path, says: str, status: int = 0) -> Path:
    """Something that answers like a Python."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\necho {says}\nexit {status}\n")
    path.chmod(0o755)
    return path


@pytest.mark.parametrize(
    ("version", "admitted"),
    [
        ((3, 10, 14), False),
        ((3, 11, 0), True),
        ((3, 13, 9), True),
        ((3, 14, 0), False),
        ((2, 7, 18), False),
    ],
)
def test_the_bounds_of_requires_python_hold(version: versions.Version, admitted: bool) -> None:
    assert versions.supported(PROJECT, version) == admitted


def test_the_latest_of_each_supported_minor_version_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pyenv = tmp_path / "pyenv" / "versions"
    latest = {
        (3, 11, 9): interpreter(pyenv / "3.11.9" / "bin" / "python3", "3 11 9"),
        (3, 13, 0): interpreter(tmp_path / "bin" / "python3.13", "3 13 0"),
    }
    for name, says in (("3.11.7", "3 11 7"), ("3.8.1", "3 8 1"), ("broken", "no idea")):
        interpreter(pyenv / name / "bin" / "python3", says)
    interpreter(
        tmp_path / "bin" / "python3.12", "3 12 0", status=127
    )  # as a shim of pyenv's without a version
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:/bin")
    monkeypatch.setenv("PYENV_ROOT", str(tmp_path / "pyenv"))
    monkeypatch.setattr(
        versions.shutil,
        "which",
        lambda name, path: (
            str(Path(path) / name) if path != "/bin" and (Path(path) / name).exists() else None
        ),
    )
    assert versions.supported_pythons(PROJECT) == latest


def test_an_environment_is_made_anew_when_the_project_file_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []

    def run(words: Any, log: Path, environment: Any = None) -> None:
        made.append(words)
        (tmp_path / case.name).mkdir(exist_ok=True)

    case = versions.Case((3, 12, 1), Path(sys.executable), "lowest")
    monkeypatch.setattr(versions, "FOLDER", tmp_path)
    monkeypatch.setattr(versions, "PROJECT", tmp_path / "pyproject.toml")
    monkeypatch.setattr(versions, "run", run)
    counts = []
    for text in ("a", "a", "b"):
        (tmp_path / "pyproject.toml").write_text(text)
        versions.prepared(case, tmp_path / "log")
        counts.append(len(made))
    assert counts == [3, 3, 6]
    assert "lowest-direct" in made[1]


def test_a_step_that_fails_is_in_the_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(versions, "FOLDER", tmp_path)
    monkeypatch.setattr(versions, "prepared", lambda case, log: Path(sys.executable))
    monkeypatch.setattr(
        versions,
        "run",
        lambda words, log, environment=None: RUN(
            [sys.executable, "-c", "print('why'); raise SystemExit(3)"], log
        ),
    )
    result = versions.tried(versions.Case((3, 12, 1), Path(sys.executable), "newest"))
    assert result.outcome.startswith("failed: ")
    assert "why" in capsys.readouterr().out
    rows = versions.table([result]).splitlines()
    assert rows[0].split()[:2] == ["Python", "dependencies"]
    assert rows[1].startswith("3.12.1  newest")
