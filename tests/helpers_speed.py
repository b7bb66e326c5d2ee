"""How fast the search and what is around it are, as ratios to the yardstick; their history.

`python tests/helpers_speed.py` measures this version, adds a line to docs/studies/speed.jsonl, and
draws docs/images/speed.svg of all lines. `--of COMMIT` measures an older version instead, in a
folder of its own. It needs a quiet machine for a minute or two.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

from sumo_mcts.driver.driver import Driver
from sumo_mcts.files import between
from sumo_mcts.numerics import yardstick
from sumo_mcts.reporting import svg
from sumo_mcts.reporting.svg import Axis
from sumo_mcts.studies import bench

TOP = Path(__file__).resolve().parent.parent
HISTORY = TOP / "docs" / "studies" / "speed.jsonl"
PAGE = TOP / "docs" / "performance.md"
BEGIN = "<!-- history: made by python tests/helpers_speed.py -->"
END = "<!-- end of history -->"
FIGURE = TOP / "docs" / "images" / "speed.svg"
YARD = 20_000  # passes, as in studies/bench.py, which older versions have without it
TIMES = 5
WIDTH, HEIGHT, LEFT, RIGHT, TOP_PX, BOTTOM = 720.0, 300.0, 46.0, 190.0, 14.0, 34.0
COLOURS = ("#3465a4", "#c4510e", "#4e7d0e", "#75507b", "#555753")


# --- measured ---


def search(agents: int, reactive: int) -> Callable[[], float]:
    """What measures: passes of a search over those of the yardstick in the same processor time."""
    scenario, road = bench._scenario("planner.iterations=20000", f"planner.reactive={reactive}")
    driver = Driver(scenario, road, bench.PHYSICS, 0)
    scene = bench._scene(road, agents, 1, near=reactive > 0)
    driver.decide(scene)

    def rate() -> float:
        began = time.process_time()
        iterations = driver.decide(scene).decision.iterations
        return iterations / (time.process_time() - began) / YARD

    return rate


def around() -> Callable[[], float]:
    """What measures: decisions of one iteration among 60 agents, over runs of the yardstick."""
    scenario, road = bench._scenario("planner.iterations=1")
    driver, scene = Driver(scenario, road, bench.PHYSICS, 0), bench._scene(road, 60, 1)
    driver.decide(scene)

    def rate() -> float:
        began = time.process_time()
        for _ in range(20):
            driver.decide(scene)
        return 20 / (time.process_time() - began)

    return rate


def by_default() -> Callable[[], float]:
    """What measures: adaptive decisions of up to 3000 iterations among 10 agents, over runs of the
    yardstick. Nearly all of what they pass is driven, so a slower step shows here."""
    scenario, road = bench._scenario("planner.iterations=3000", "planner.adaptive=true")
    driver = Driver(scenario, road, bench.PHYSICS, 0)
    scenes = [bench._scene(road, 10, seed) for seed in range(4)]
    for scene in scenes:
        driver.decide(scene)

    def rate() -> float:
        began = time.process_time()
        for scene in 5 * scenes:
            driver.decide(scene)
        return 20 / (time.process_time() - began)

    return rate


MEASURED: dict[str, Callable[[], Callable[[], float]]] = {
    "iterations, 5 agents": lambda: search(5, 0),
    "iterations, 10 agents": lambda: search(10, 0),
    "iterations, 50 agents": lambda: search(50, 0),
    "iterations, 10 reactive agents": lambda: search(10, 10),
    "decisions without a search, 60 agents": around,
    "decisions by default, 10 agents": by_default,
}


def ratio(name: str) -> float:
    """The median of several, each beside the yardstick."""
    rate = MEASURED[name]()
    _yards_a_second()
    return median(rate() / _yards_a_second() for _ in range(TIMES))


def _yards_a_second() -> float:
    """Runs of YARD passes in a second of processor time."""
    began = time.process_time()
    yardstick.searched(YARD)
    return 1.0 / (time.process_time() - began)


def measured_at(commit: str) -> dict[str, Any]:
    """The line of an older version: measured by this file, with this yardstick."""
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        _git("worktree", "add", "-q", "--detach", str(tree), commit)
        try:
            mine = Path(yardstick.__file__)
            (tree / mine.relative_to(TOP)).write_bytes(mine.read_bytes())
            done = subprocess.run(
                [sys.executable, str(Path(__file__).resolve()), "--print"],
                cwd=tree, stdout=subprocess.PIPE, text=True, check=True,
                env={**os.environ, "PYTHONPATH": str(tree)},
            )  # fmt: skip
        finally:
            _git("worktree", "remove", "--force", str(tree))
    day = _git("log", "-1", "--format=%as", commit)
    return {
        "commit": _git("rev-parse", "--short", commit), "date": day, **json.loads(done.stdout)
    }  # fmt: skip


def _git(*words: str) -> str:
    return subprocess.run(
        ["git", *words], cwd=TOP, capture_output=True, text=True, check=True
    ).stdout.strip()


# --- drawn ---


def drawn(lines: list[dict[str, Any]]) -> str:
    """The history as a figure: a curve for each ratio, the versions from left to right."""
    most = max(line[name] for line in lines for name in _shown())
    down = Axis(0.0, 1.1 * most, HEIGHT - BOTTOM, TOP_PX)
    along = Axis(0.0, max(len(lines) - 1.0, 1.0), LEFT + 20.0, WIDTH - RIGHT - 20.0)
    parts = [f'<rect width="{WIDTH:.0f}" height="{HEIGHT:.0f}" fill="#ffffff"/>']
    for value in svg.ticks(0.0, 1.1 * most):
        y = down.at(value)
        parts += [
            f'<path d="M{LEFT:.0f} {y:.1f}H{WIDTH - RIGHT:.0f}" stroke="#dddddd"/>',
            _text(LEFT - 6.0, y + 4.0, f"{value:g}", "end"),
        ]
    for k, line in enumerate(lines):
        parts.append(_text(along.at(k), HEIGHT - 14.0, line["commit"], "middle"))
    for name, colour in zip(_shown(), COLOURS, strict=False):
        places = [(along.at(k), down.at(line[name])) for k, line in enumerate(lines)]
        path = "L".join(f"{x:.1f} {y:.1f}" for x, y in places)
        parts.append(f'<path d="M{path}" fill="none" stroke="{colour}" stroke-width="2"/>')
        parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{colour}"/>' for x, y in places]
        parts.append(_text(places[-1][0] + 12.0, places[-1][1] + 4.0, name, "start", colour))
    size = f'viewBox="0 0 {WIDTH:.0f} {HEIGHT:.0f}" width="{WIDTH:.0f}" height="{HEIGHT:.0f}"'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="sans-serif" '
        f'font-size="12">{"".join(parts)}</svg>\n'
    )


def table(lines: list[dict[str, Any]]) -> str:
    """The history as a table in Markdown; empty where a version was not measured so."""
    head = f"| commit | {' | '.join(MEASURED)} |\n|{'---|' * (len(MEASURED) + 1)}\n"
    return head + "\n".join(
        f"| {line['commit']} | {' | '.join(f'{line[name]:g}' if name in line else '' for name in MEASURED)} |"
        for line in lines
    )


def _shown() -> list[str]:
    """Rates of the search: they have one scale."""
    return [name for name in MEASURED if name.startswith("iterations")]


def _text(x: float, y: float, text: str, anchor: str, colour: str = "#333333") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}">{text}</text>'


def main() -> None:
    """Measure, and draw anew."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--of", action="append", default=[], metavar="COMMIT")
    parser.add_argument("--print", action="store_true", help="the ratios alone, nothing is kept")
    parser.add_argument("--draw", action="store_true", help="the figure alone")
    asked = parser.parse_args()
    if asked.print:
        print(json.dumps({name: float(f"{ratio(name):.3g}") for name in MEASURED}))
        return
    lines = [json.loads(line) for line in HISTORY.read_text().splitlines()]
    if not asked.draw:
        for commit in asked.of or ["HEAD"]:
            lines.append(measured_at(commit))
            print(json.dumps(lines[-1]), flush=True)
        HISTORY.write_text("".join(json.dumps(line) + "\n" for line in lines))
    FIGURE.write_text(drawn(lines))
    PAGE.write_text(between(PAGE.read_text(), BEGIN, END, table(lines)))


if __name__ == "__main__":
    main()
