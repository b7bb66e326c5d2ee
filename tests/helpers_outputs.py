"""The pictures and excerpts of docs/outputs.md, made by the commands of that page.

`python tests/helpers_outputs.py` runs every command of the page in an empty folder, one after the
other, takes the pictures of the report with Chromium, and writes anew what lies between the marks
of the page. It needs the extra `dev` and takes two to six minutes, by what else the machine
does; speeds on the page are worth something only if it does nothing else.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import textwrap
import time
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from helpers_docs import DOCS, unpack
from PIL import Image
from playwright.sync_api import Page, sync_playwright

from sumo_mcts.files import between

PAGE = DOCS / "outputs.md"
IMAGES = DOCS / "images"
LONGEST = 230  # columns of a line of an excerpt
WRAPPED = 98  # columns to which a row is wrapped

RUN = "run unprotected-left-turn --seed 3 --out out/left"
FIGURES = "out/left/figures/*"
REPORT = "out/budgets/report"
REPLAY = "replay=highway-exit--mcts-iterations-300--1&t=3"
SCENE = "highway-exit"  # whose figures are shown


class Excerpt(NamedTuple):
    """Some lines of a text."""

    source: str  # a command of the page, for what it prints, or a file that one of them leaves
    lines: slice = slice(None)


EXCERPTS = {
    "run": Excerpt(RUN),
    "row": Excerpt("out/left/episodes.jsonl"),
    "explain": Excerpt("explain out/left --at 4.1"),
    "again": Excerpt("explain out/left --at 4.1 --set prediction.hypotheses=1", slice(-16, None)),
    "json": Excerpt("explain out/left --at 4.1 --json", slice(8)),
    "csv": Excerpt("out/left/exports/*.csv", slice(6)),
    "fcd": Excerpt("out/left/exports/*.fcd.xml", slice(6)),
    "batch": Excerpt("batch budgets.yaml --out out/budgets"),
    "table": Excerpt(f"{REPORT}.md", slice(8, 24)),
    "table-csv": Excerpt("out/budgets/tables/outcomes.csv", slice(5)),
    "forecast": Excerpt("forecast highway-exit --seeds 5"),
    "drivers": Excerpt("drivers highway-exit --seeds 2", slice(14)),
    "value": Excerpt("value dense-permissive-left --seeds 2"),
    "regret": Excerpt("regret highway-exit --planners mcts,paper,idm --iterations 100,1000 --states 40"),
    "bench": Excerpt("bench --quick"),
    "scenarios": Excerpt("scenarios", slice(4)),
    "experiments": Excerpt("experiments", slice(4)),
    "validate": Excerpt("validate mistaken.yaml"),
    "schema": Excerpt("schema", slice(14)),
}  # fmt: skip

# A picture of the page and the file from which it is copied.
COPIES = {
    "storyboard.png": f"{FIGURES}.png",
    "unprotected-left-turn.gif": f"{FIGURES}.gif",
}
# A picture of the report's window, and the part of its address behind the hash.
WINDOWS = {"report.png": "", "replay.png": REPLAY}
# A figure of the report, and the heading above it.
DRAWINGS = {
    "effort.svg": "Effort",
    "travel-time.svg": "Travel time beside SUMO's driver",
    "time-to-collision.svg": "Closest calls: time to collision",
}

# The figure of a heading as a file of its own: its classes become attributes.
STANDALONE = """([scene, heading]) => {
  const names = ["fill", "fill-opacity", "stroke", "stroke-width", "stroke-dasharray",
    "stroke-linecap", "opacity", "font-weight"];
  const figures = document.querySelectorAll(`.figures[data-scene="${scene}"] figure`);
  const svg = [...figures].find((each) => each.querySelector("h3").textContent === heading)
    .querySelector("svg.figure");
  const copy = svg.cloneNode(true), copies = copy.querySelectorAll("*");
  svg.querySelectorAll("*").forEach((each, k) => {
    const style = getComputedStyle(each);
    for (const name of names) copies[k].setAttribute(name, style.getPropertyValue(name));
    copies[k].removeAttribute("class");
    copies[k].removeAttribute("data-tip");
  });
  copy.removeAttribute("class");
  copy.setAttribute("style", "background: #fff; font: 12px system-ui, sans-serif");
  return new XMLSerializer().serializeToString(copy) + "\\n";
}"""


def commands(page: str) -> list[list[str]]:
    """The words of every command of a page behind `sumo-mcts`, in its order."""
    lines = re.findall(r"^    sumo-mcts (.*)$", page, re.MULTILINE)
    return [shlex.split(line, comments=True) for line in lines]


def marks(name: str) -> tuple[str, str]:
    """The lines before and behind an excerpt."""
    return f"<!-- {name}: made by python tests/helpers_outputs.py -->", f"<!-- end of {name} -->"


def excerpt(text: str, lines: slice, suffix: str) -> str:
    """Some lines of a text as Markdown. `suffix`: of the file that it is from, "" if printed."""
    every = [part for line in text.rstrip().splitlines() for part in shortened(line)]
    shown = every[lines]
    if suffix == ".md":
        return "\n".join(shown)
    first, last, _ = lines.indices(len(every))
    before, behind = ["..."] * (first > 0), ["..."] * (last < len(every))
    language = "json" if text.startswith("{") else suffix[1:] or "text"
    return "\n".join([f"```{language}", *before, *shown, *behind, "```"])


def shortened(line: str) -> list[str]:
    """A line that is not too long: JSON in several, anything else cut."""
    if line.startswith("{"):
        return textwrap.wrap(line, WRAPPED, break_long_words=False, break_on_hyphens=False)
    return [line if len(line) <= LONGEST else f"{line[: LONGEST - 1]}…"]


def run(words: list[str], folder: Path) -> str:
    """What a command prints. Raises RuntimeError where it fails, but for `validate`, which tells
    mistakes."""
    began = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "sumo_mcts", *words],
        check=False,
        cwd=folder,
        env={**os.environ, "COLUMNS": str(LONGEST)},
        capture_output=True,
        text=True,
    )
    print(f"{time.monotonic() - began:6.1f} s  sumo-mcts {shlex.join(words)}", flush=True)
    if done.returncode and words[0] != "validate":
        raise RuntimeError(done.stderr)
    return done.stdout or done.stderr


def source(name: str, printed: Mapping[str, str], folder: Path) -> tuple[str, str]:
    """The text of an excerpt's source and its suffix. Raises KeyError, ValueError."""
    if not name.startswith("out/"):
        return printed[name], ""
    (path,) = folder.glob(name)
    return path.read_text(encoding="utf-8"), path.suffix


def take_pictures(report: Path) -> None:
    """Write the pictures of a report into docs/images/. Raises RuntimeError where the page says
    that it cannot show one."""
    with sync_playwright() as playwright:
        path = shutil.which("chromium") or shutil.which("google-chrome")
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        context = browser.new_context(viewport={"width": 1440, "height": 900}, color_scheme="light")
        for name, fragment in WINDOWS.items():
            page = context.new_page()
            page.goto(f"{report.as_uri()}#{fragment}")
            page.wait_for_timeout(1000)  # until a replay is unpacked and drawn
            if page.locator("#trouble").is_visible():
                raise RuntimeError(f"{fragment}: {page.locator('#trouble').inner_text()}")
            save_window(page, IMAGES / name)
        for name, heading in DRAWINGS.items():
            drawing = page.evaluate(STANDALONE, [SCENE, heading])
            (IMAGES / name).write_text(drawing, encoding="utf-8")
        browser.close()


def save_window(page: Page, path: Path) -> None:
    """Write a window as a small PNG."""
    page.screenshot(path=path)
    with Image.open(path) as picture:
        small = picture.convert("RGB").quantize(method=Image.Quantize.MAXCOVERAGE, kmeans=1)
    small.save(path, optimize=True)


def main() -> None:
    """Make everything anew."""
    text = PAGE.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory(prefix="sumo_mcts-") as name:
        folder = Path(name)
        unpack(PAGE.name, folder)
        printed = {shlex.join(words): run(words, folder) for words in commands(text)}
        for picture, pattern in COPIES.items():
            (found,) = folder.glob(pattern)
            shutil.copyfile(found, IMAGES / picture)
        take_pictures(folder / f"{REPORT}.html")
        for each, part in EXCERPTS.items():
            content, suffix = source(part.source, printed, folder)
            text = between(text, *marks(each), excerpt(content, part.lines, suffix))
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
