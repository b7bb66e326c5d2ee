"""The smoke tests with every supported Python of this machine, each with the newest and with the
lowest versions of all dependencies that pyproject.toml
allows: python tests/versions.py [--newest-python]

Environments lie in .versions/, one for each pair, and are made anew when pyproject.toml changes.
What the tools say is beside them, in *.log.
"""

import argparse
import hashlib
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

TOP = Path(__file__).resolve().parent.parent
PROJECT = TOP / "pyproject.toml"
FOLDER = TOP / ".versions"
RESOLUTIONS = {"newest": "highest", "lowest": "lowest-direct"}  # ours -> uv's
SHOWN = ("numpy", "numba", "pydantic")  # packages whose versions the table tells
LINES = 40  # of the log of a step that failed, to be shown
ASK = "import sys; print(*sys.version_info[:3])"
TELL = f"from importlib.metadata import version; print(*(version(name) for name in {SHOWN}))"
UV = [sys.executable, "-m", "uv", "--quiet", "--no-python-downloads"]

Version = tuple[int, int, int]


class StepError(Exception):
    """A step that ended with another status than 0; the message is what it was."""


class Case(NamedTuple):
    """An interpreter, and which of the versions that are allowed it gets."""

    version: Version
    python: Path
    resolution: str

    @property
    def name(self) -> str:
        return f"{self.version[0]}.{self.version[1]}-{self.resolution}"


class Result(NamedTuple):
    """A row of the table."""

    case: Case
    versions: str
    outcome: str
    seconds: float


def supported(project: dict[str, object], version: Version) -> bool:
    """Whether requires-python, as in >=3.11,<3.14, admits a version."""
    least, below = (
        tuple(map(int, bound))
        for bound in re.findall(r"[>=<]+(\d+)\.(\d+)", str(project["requires-python"]))
    )
    return least <= version[:2] < below


def interpreters(minors: Sequence[str]) -> Iterator[Path]:
    """Everything that may be one of these Pythons: on the PATH and among those that pyenv
    installed."""
    folders = os.environ.get("PATH", "").split(os.pathsep)
    for name in ("python3", *(f"python{minor}" for minor in minors)):
        yield from (Path(found) for folder in folders if (found := shutil.which(name, path=folder)))
    root = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv")
    yield from sorted(root.glob("versions/*/bin/python3"))


def version_of(python: Path) -> Version | None:
    """The version of an interpreter that runs; a shim of pyenv's may have none to run."""
    try:
        done = subprocess.run(
            [python, "-c", ASK], capture_output=True, text=True, timeout=30, check=True
        )
        major, minor, patch = map(int, done.stdout.split())
    except (OSError, ValueError, subprocess.SubprocessError):
        return None
    return major, minor, patch


def supported_pythons(project: dict[str, object]) -> dict[Version, Path]:
    """The latest of each supported minor version that this machine has, from the lowest on."""
    found: dict[tuple[int, int], tuple[Version, Path]] = {}
    for python in dict.fromkeys(interpreters([f"3.{minor}" for minor in range(11, 30)])):
        version = version_of(python)
        if (
            version is not None
            and supported(project, version)
            and version > found.get(version[:2], ((0, 0, 0), python))[0]
        ):
            found[version[:2]] = version, python
    return dict(found[minor] for minor in sorted(found))


def run(words: Sequence[object], log: Path, environment: dict[str, str] | None = None) -> None:
    """Run a command at the top of the checkout, its output at the end of the log.

    Raises StepError.
    """
    line = [str(word) for word in words]
    with log.open("a", encoding="utf-8") as file:
        file.write(f"$ {' '.join(line)}\n")
        file.flush()
        whole = {**os.environ, **(environment or {})}
        done = subprocess.run(
            line,
            cwd=TOP,
            env=whole,
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            check=False,
        )
    if done.returncode != 0:
        raise StepError(f"failed: {' '.join(line[1:4])}")


def prepared(case: Case, log: Path) -> Path:
    """The interpreter of an environment for a case, made anew where it was made for another
    pyproject.toml or another Python. Raises StepError."""
    folder = FOLDER / case.name
    stamp, python = folder / ".made", folder / "bin" / "python"
    made_for = hashlib.sha256(PROJECT.read_bytes() + repr(case).encode()).hexdigest()
    if not stamp.exists() or stamp.read_text() != made_for:
        shutil.rmtree(folder, ignore_errors=True)
        install = [*UV, "pip", "install", "--python", python]
        run([*UV, "venv", "--python", case.python, folder], log)
        run(
            [
                *install,
                "--resolution",
                RESOLUTIONS[case.resolution],
                "--only-binary",
                ":all:",
                "-r",
                PROJECT,
                "--extra",
                "dev",
            ],
            log,
        )
        run([*install, "--no-deps", "--editable", TOP], log)
        stamp.write_text(made_for)
    return python


def tried(case: Case) -> Result:
    """Run the checks of a case, and show how they failed."""
    log, began, versions, outcome = FOLDER / f"{case.name}.log", time.monotonic(), "", "passed"
    log.write_text("", encoding="utf-8")
    print(
        f"Python {'.'.join(map(str, case.version))} with the {case.resolution} dependencies ...",
        flush=True,
    )
    try:
        python = prepared(case, log)
        versions = subprocess.run(
            [python, "-c", TELL], capture_output=True, text=True, check=True
        ).stdout.strip()
        cache = (
            FOLDER / f"{case.name}-cache"
        )  # outlives the environment, since numba knows for which of its versions a kernel is
        own = {"XDG_CACHE_HOME": str(cache), "PYTHONPATH": str(TOP)}
        if (
            case.resolution == "newest"
        ):  # types of numpy differ between versions, and mypy is asked about the newest only
            run(
                [python, "-m", "mypy", "--strict", "--cache-dir", cache / "mypy", "sumo_mcts"],
                log,
                own,
            )
        run([python, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "smoke"], log, own)
    except StepError as failure:
        outcome = str(failure)
        print(
            "\n".join(log.read_text(encoding="utf-8", errors="replace").splitlines()[-LINES:]),
            flush=True,
        )
    return Result(case, versions, outcome, time.monotonic() - began)


def table(results: Sequence[Result]) -> str:
    """One line a case."""
    rows = [("Python", "dependencies", *SHOWN, "seconds", "result")]
    for case, versions, outcome, seconds in results:
        shown = versions.split() or ["-"] * len(SHOWN)
        rows.append(
            (".".join(map(str, case.version)), case.resolution, *shown, f"{seconds:.0f}", outcome)
        )
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )


def main() -> int:
    """0: all passed; 1: some did not; 2: there is no supported Python."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument(
        "--newest-python",
        action="store_true",
        help="only with the newest supported Python that there is",
    )
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    pythons = supported_pythons(project)
    if parser.parse_args().newest_python:
        pythons = dict(list(pythons.items())[-1:])
    if not pythons:
        print(f"no Python of this machine is {project['requires-python']}", file=sys.stderr)
        return 2
    FOLDER.mkdir(exist_ok=True)
    results = [
        tried(Case(version, python, resolution))
        for version, python in pythons.items()
        for resolution in RESOLUTIONS
    ]
    print(table(results))
    return 0 if all(result.outcome == "passed" for result in results) else 1


if __name__ == "__main__":
    sys.exit(main())
