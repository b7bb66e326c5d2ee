"""Good inputs, which cases damage: a short scenario on a small network, the same as a .sumocfg, an
experiment, and what driving them leaves behind."""

import copy
import functools
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

_TOP = Path(__file__).resolve().parents[2]

NET = (_TOP / "networks/straight-line/straight-line.net.xml").read_text(encoding="utf-8")
TYPES = (_TOP / "routes/straight-line.rou.xml").read_text(encoding="utf-8")
ROUTES = """<routes>
    <vehicle id="ego" depart="0" departLane="1" departPos="100" departSpeed="5"><route edges="road beyond"/></vehicle>
    <vehicle id="other" depart="0" departLane="1" departPos="150" departSpeed="5"><route edges="road beyond"/></vehicle>
</routes>
"""
SUMOCFG = """<configuration>
    <net-file value="net.net.xml"/>
    <route-files value="ego.rou.xml"/>
    <step-length value="0.1"/>
    <end value="60"/>
</configuration>
"""
# Planner constant: nothing is compiled, and an episode takes a second.
SCENARIO: dict[str, Any] = {
    "name": "good",
    "sumo": {"net": "net.net.xml", "routes": ["types.rou.xml"]},
    "egos": [{"id": "ego"}],
    "traffic": {
        "actors": [
            {
                "id": "ego",
                "vtype": "ego",
                "route": ["road", "beyond"],
                "depart": {"lane": 1, "pos_m": 100, "speed_mps": 5},
            },
            {
                "id": "other",
                "vtype": "car",
                "route": ["road", "beyond"],
                "depart": {"lane": 1, "pos_m": 150, "speed_mps": 5},
            },
        ]
    },
    "episode": {"time_limit_s": 3},
    "planner": {"name": "constant"},
}
EXPERIMENT: dict[str, Any] = {
    "name": "exp",
    "scenarios": ["good.yaml"],
    "variants": {"constant": {}, "mcts": {"planner.name": "mcts", "planner.iterations": 20}},
    "seeds": "0..1",
    "traces": "all",
}


def dumped(data: object) -> str:
    """YAML of plain data."""
    return yaml.safe_dump(data, sort_keys=False, allow_unicode=True)


def with_key(data: Mapping[str, Any], key: str, value: object) -> dict[str, Any]:
    """A copy of nested mappings and lists in which the `a.b.0` key has another value; mappings that
    are missing on the way are made."""
    result = copy.deepcopy(dict(data))
    parts: list[Any] = [int(part) if part.isdecimal() else part for part in key.split(".")]
    inner: Any = result
    for part in parts[:-1]:
        inner = inner[part] if isinstance(inner, list) else inner.setdefault(part, {})
    inner[parts[-1]] = value
    return result


FILES: dict[str, bytes] = {
    "net.net.xml": NET.encode(),
    "types.rou.xml": TYPES.encode(),
    "ego.rou.xml": ROUTES.encode(),
    "good.sumocfg": SUMOCFG.encode(),
    "good.yaml": dumped(SCENARIO).encode(),
    "exp.yaml": dumped(EXPERIMENT).encode(),
    "one.yaml": dumped(
        {**EXPERIMENT, "variants": {"constant": {}}}
    ).encode(),  # two episodes of planner constant
}

RUN = ("run", "good.yaml", "--json")
OUT = ("run", "good.yaml", "--out", "out", "--quiet")
BATCH = ("batch", "one.yaml", "--out", "out", "--jobs", "1", "--quiet")

COMMAND = (sys.executable, "-m", "sumo_mcts")


@functools.cache
def recorded() -> dict[str, bytes]:
    """File names and contents of what `batch` leaves of the good experiment, in `rec`, and of what
    `run` leaves of a left
    turn by planner mcts, in `one`. The first time it compiles the search."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write(folder, FILES)
        turn = ("unprotected-left-turn", "--iterations", "20", "--time-limit", "2")
        for words in (
            ("batch", "exp.yaml", "--out", "rec", "--jobs", "1", "--quiet"),
            ("run", *turn, "--out", "one", "--quiet"),
        ):
            subprocess.run([*COMMAND, *words], cwd=folder, check=True, capture_output=True)
        found = [
            path
            for top in ("rec", "one")
            for path in sorted((folder / top).rglob("*"))
            if path.is_file()
        ]
        return {
            str(path.relative_to(folder)): path.read_bytes()
            for path in found
            if path.suffix not in (".gif", ".png")
        }


def recorded_file(pattern: str) -> str:
    """The name of the first recorded file that matches."""
    return next(name for name in sorted(recorded()) if Path(name).match(pattern))


def write(folder: Path, files: Mapping[str, bytes]) -> None:
    """Files into a folder, which is made, as are folders in it."""
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
