"""Writes docs/paper-figures.md: the article's figures, made by `sumo-mcts article`.

`python tests/helpers_article.py` drives the two episodes, draws the pictures and writes the page.
"""

import tempfile
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from sumo_mcts.commands.article import Shown, claims_table, draw_figures
from sumo_mcts.studies.article import FIGURES

DOCS = Path(__file__).resolve().parent.parent / "docs"
PAGE = DOCS / "paper-figures.md"
PICTURES = DOCS / "images" / "paper"
WIDTH = 1440  # pixels of a picture
_HEAD = """\
# The paper's figures

The article shows two scenes at three moments each, from above and from behind the ego, and says
what its ego does there. Here are the same moments of ours: planner `mcts` with its defaults and
seed 0, in the scenes where SUMO drives the others. Nothing of their future is known, while the
article assumes perfect prediction. A test drives both episodes and asks for every sentence
(`tests/studies/test_article.py`). Asked is the decision nearest to the moment, up to 0.25 s away;
the pictures show the moment itself. What is measured is what SUMO reports: states in the trace, and
[the row](measures.md).

    sumo-mcts article --out out/article

makes the pictures and these tables, and fills [the article's Table
1](studies/paper-scenes.md), with `--seeds` episodes of each cell (300, as the article) and
`--states` decisions of each scene (100). It goes on where it was interrupted. A single picture:

    sumo-mcts run exit-cut-in --out out/exit
    sumo-mcts render out/exit --moments 4,5,11 --views above,chase

This page is generated: `python tests/helpers_article.py` writes it anew.
"""
_NOTES = {
    "left-turn": """\
The article's ego meets a car from the left; in this scene the ones that cross its path come from
the south, on its right, and from the east. The ego is through before they arrive.
""",
    "exit-cut-in": """\
At 11 s the slow car is behind the picture. It begins to move over at 4 s, and the forecast has it
in the ego's lane as soon as it blinks. In [this scene](scenarios.md#exit-cut-in) a car has broken
down on the right lane. Before it stood there, the ego passed on the right, in the lane that the
slow car had left. In `exit-cut-in-scripted`, with the scripts known and `traffic.vary` 0, the ego
waits longer and changes to the left at 7.1 s, so that at 11 s it is only beside the slow car.
""",
}


def page(tables: Sequence[str]) -> str:
    """The text of the page, with the claims of each figure as a table."""
    parts = [_HEAD]
    for figure, table in zip(FIGURES, tables, strict=True):
        times = ", ".join(f"{time:g}" for time in figure.times)
        name, alt = figure.name, f"{figure.scenario} at {times} s, from above and from behind"
        parts += [f"## {figure.caption}\n", f"![{alt}](images/paper/{name}.png)\n"]
        parts += [f"{table}\n", _NOTES[name]]
    return "\n".join(parts)


def _keep(shown: Shown) -> None:
    """The picture, smaller, where the page shows it."""
    picture = Image.open(shown.picture).convert("RGB")
    small = picture.resize((WIDTH, round(picture.height * WIDTH / picture.width)), Image.LANCZOS)
    small.save(PICTURES / f"{shown.figure.name}.png", optimize=True)  # a palette makes bands


if __name__ == "__main__":
    PICTURES.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        made = draw_figures(Path(folder), (), print)
        for each in made:
            _keep(each)
    PAGE.write_text(page([claims_table(each.claims) for each in made]), encoding="utf-8")
