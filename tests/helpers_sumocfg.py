"""Drives in a folder with x.net.xml and x.rou.xml as a user would: by `run` and a .sumocfg."""

import json
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from sumo_mcts.cli import app

CONFIG = (
    '<configuration><net-file value="x.net.xml"/><route-files value="x.rou.xml"/>'
    '<step-length value="0.1"/></configuration>'
)


def driven(folder: Path, *words: str, limit_s: int, seed: int = 1) -> dict[str, Any]:
    """The row of an episode of vehicle `ego`, at most `limit_s` long; the records are in `out`."""
    (folder / "x.sumocfg").write_text(CONFIG)
    scene = ["run", str(folder / "x.sumocfg"), "--ego", "ego", "--seed", str(seed)]
    out = ["--time-limit", str(limit_s), "--no-pictures", "--json", "--out", str(folder / "out")]
    answer = CliRunner().invoke(app, [*scene, *out, *words], catch_exceptions=False)
    (row,) = json.loads(answer.output[answer.output.index("{") :])["episodes"]
    return dict(row)
