"""No slower than written down: the search and what is around it, as ratios to the yardstick.

The written ratios are those of tests/speed.yaml. A commit that changes them says why.
"""

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import helpers_speed as speed
import pytest
import yaml

from sumo_mcts.files import between
from sumo_mcts.numerics import kernel

WRITTEN = yaml.safe_load(Path(speed.__file__).with_name("speed.yaml").read_text())
ALLOWED = 0.75  # of what is written down
TRIES = 2


def test_all_that_is_written_down_is_measured() -> None:
    assert list(WRITTEN) == list(speed.MEASURED)


@pytest.mark.slow
@pytest.mark.skipif(kernel.is_plain(), reason="nothing is compiled")
@pytest.mark.parametrize("name", WRITTEN)
def test_the_ratio_has_not_fallen(name: str) -> None:
    ratios: list[float] = []
    while len(ratios) < TRIES and max(ratios, default=0.0) < ALLOWED * WRITTEN[name]:
        ratios.append(speed.ratio(name))
    assert max(ratios) >= ALLOWED * WRITTEN[name], (
        f"{name}: {ratios} of the yardstick's rate, {WRITTEN[name]} are written down in "
        "tests/speed.yaml"
    )


def test_the_page_has_the_history() -> None:
    lines = [json.loads(line) for line in speed.HISTORY.read_text().splitlines()]
    page = speed.PAGE.read_text()
    assert between(page, speed.BEGIN, speed.END, speed.table(lines)) == page
    assert speed.FIGURE.read_text() == speed.drawn(lines)


def test_the_figure_has_a_point_for_each_version_and_ratio() -> None:
    line = {"commit": "abc", "date": "2026-01-01", **dict.fromkeys(speed.MEASURED, 0.2)}
    root = ET.fromstring(speed.drawn([line, {**line, "commit": "def"}]))
    circles = [each for each in root.iter() if each.tag.endswith("circle")]
    assert len(circles) == 2 * 4
    assert [each.text for each in root.iter() if each.text in ("abc", "def")] == ["abc", "def"]
