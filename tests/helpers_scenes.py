"""Writes docs/scenarios.md: the scenes of the paper, as their files have them.

`python tests/helpers_scenes.py` writes the text; with `--pictures` it drives every scene, or those
whose names follow, with planner mcts, seed 0, and draws the pictures too.
"""

import sys
import tempfile
import textwrap
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from sumo_mcts import load_scenario
from sumo_mcts.arrays import Floats
from sumo_mcts.config import Actor, Event, ScenarioConfig, builtin
from sumo_mcts.road import RoadMap
from sumo_mcts.world.roadmap import known_roadmap, lane_shape

DOCS = Path(__file__).resolve().parent.parent / "docs"
PAGE = DOCS / "scenarios.md"
PICTURES = DOCS / "images" / "scenes"
WIDTH = 1100  # pixels of a picture
_HEAD = """\
# The paper's scenes, one by one

Each scene is built in twice: NAME, where SUMO drives the others, and NAME-scripted, where they
follow their scripts whatever the ego does. Three more, with `-varied` at the end, draw their
traffic; in the others places and speeds vary a little with the seed (`traffic.vary`). The pictures
show planner `mcts` with seed 0 in NAME. What the scenes ask for, 49 of 50 arrivals in each, has not
been measured with 50 seeds yet; what has been: [the paper's scenes](studies/paper-scenes.md). In
`crossing-cut-in` its time is up [with some
seeds](studies/paper-scenes.md#among-sumos-drivers).

Where a scene differs from what the paper and its program have:

- `exit-cut-in`: a sixth car has broken down in the right lane. That is why the slow one leaves it.
  Without it the ego would pass on the right, in the lane that the slow car has left.
- `stationary-objects`: the last parked car stands right behind the junction, 6 m further on, since
  SUMO lets no vehicle begin inside a junction.

    sumo-mcts run go-straight-1 --seed 0 --out out/straight
    sumo-mcts run go-straight-1-scripted --set prediction.name=script # the scripts are known

Places are x east and y north, in metres, speeds in m/s, times in seconds after departure.

This page is generated: `python tests/helpers_scenes.py` writes it anew.
"""


def names() -> list[str]:
    """The scenes that exist twice."""
    found = builtin.scenario_names()
    return [name for name in found if f"{name}-scripted" in found]


def place(actor: Actor, road: RoadMap) -> Floats:
    """[2] Where an actor enters, m."""
    lane = road.lane_ids.index(f"{actor.route[0]}_{actor.depart.lane}")
    shape = lane_shape(road, lane)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(shape, axis=0).T))])
    s = actor.depart.pos_m * road.scale[lane]
    return np.array([np.interp(s, along, shape[:, k]) for k in (0, 1)])


def page() -> str:
    """The text of the page."""
    return "\n".join([_HEAD, *("\n".join(_section(load_scenario(name))) for name in names())])


def _section(config: ScenarioConfig) -> Iterator[str]:
    scripted = load_scenario(f"{config.name}-scripted")
    road = known_roadmap(str(config.sumo.net))
    yield f"## {config.name}"
    yield ""
    yield from textwrap.wrap(config.description, 100)
    yield ""
    if (PICTURES / f"{config.name}.png").exists():
        yield f"![Six moments of {config.name} from above](images/scenes/{config.name}.png)"
        yield ""
    here, there = _limit(config), _limit(scripted)
    yield f"{here}." if here == there else f"{here}; scripted: {there}."
    yield ""
    yield "| vehicle | from | x, y | speed | way | then |"
    yield "|---|---|---|---|---|---|"
    for actor in config.traffic.actors:
        x, y = place(actor, road)
        cells = [
            f"`{actor.id}`",
            f"`{actor.route[0]}`, lane {actor.depart.lane}",
            f"{x:.0f}, {y:.0f}",
            f"{actor.depart.speed_mps:g}",
            f"`{actor.route[-1]}`",
            "; ".join(map(_words, actor.events)),
        ]
        yield "| " + " | ".join(cells) + " |"
    yield ""


def _limit(config: ScenarioConfig) -> str:
    """How much time the ego has, and for what."""
    if config.episode.stop_time_s is None:
        return "No time limit"
    return f"{config.episode.stop_time_s:g} s to reach `{config.episode.success_edge}`"


def _words(event: Event) -> str:
    when = f"at {event.at_s:g} s" if event.at_s is not None else f"after {event.at_m:g} m"
    if event.change_lane:
        return f"{when} to the {event.change_lane}"
    if event.stop_for_s is not None:
        return f"{when} brakes to a stand, for {event.stop_for_s:g} s"
    return f"{when} to {event.slow_to_mps:g} m/s"


def _draw(name: str) -> None:
    """Drive the scene and write its picture."""
    from typer.testing import CliRunner

    from sumo_mcts.cli import app

    with tempfile.TemporaryDirectory() as folder:
        drawn = str(Path(folder) / "drawn.png")
        for command in (
            ["run", name, "--seed", "0", "--out", folder, "--no-pictures", "--quiet"],
            ["render", folder, "--out", drawn, "--quiet"],
        ):
            CliRunner().invoke(app, command, catch_exceptions=False)
        picture = Image.open(drawn).convert("RGB")
        small = picture.resize((WIDTH, round(picture.height * WIDTH / picture.width)))
        # the few red and amber pixels of the lights have to survive
        few = small.quantize(method=Image.Quantize.MAXCOVERAGE, kmeans=1)
        few.save(PICTURES / f"{name}.png", optimize=True)


if __name__ == "__main__":
    if "--pictures" in sys.argv:
        PICTURES.mkdir(parents=True, exist_ok=True)
        for each in sys.argv[sys.argv.index("--pictures") + 1 :] or names():
            _draw(each)
    PAGE.write_text(page(), encoding="utf-8")
