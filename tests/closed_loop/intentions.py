"""Measures what hypotheses about the others are worth where somebody does what is unlikely.

Not a test: nothing is asserted.

    python tests/closed_loop/intentions.py [--seeds 30] [--scenes NAME...] [--set a.b=c]... [--out
    FILE]

Each situation comes in kinds that look alike until it happens: cars from a side road that let the
ego pass or do not (`jmIgnoreFoeProb`), a leader that drives on or brakes hard for no reason, and
oncoming cars without turn signal that go straight on, or turn left across the ego's way, with or
without letting it pass. A row is that of `measure.py --no-twins`, then episodes in which others
braked for the ego beyond 2, 3, 4 m/s2, and in which the ego braked beyond 4.5 m/s2.
"""

import argparse
import json
import multiprocessing
import subprocess
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import sumo
from measure import Job, lone_row, run_one

from sumo_mcts.scene import Scene
from sumo_mcts.world.observe import Observer

NODES = {"w": (-300, 0), "e": (300, 0), "s": (0, -300), "n": (0, 300), "c": (0, 0)}
LIKE = 'length="4.7" sigma="0.5" speedFactor="1" speedDev="0"'
IGNORES = 'jmIgnoreFoeProb="1" jmIgnoreFoeSpeed="100" jmIgnoreJunctionFoeProb="1"'
TYPES = f'<routes><vType id="car" {LIKE}/><vType id="forcing" {LIKE} {IGNORES}/></routes>'
MAIN, SIDE = 3, 1  # priorities
_SEEN = Observer.scene


def actor(
    name: str, begin: str, end: str, pos_m: float, speed_mps: float, **keys: Any
) -> dict[str, Any]:
    """A car from one arm to another, drawn about these values."""
    return {
        "id": name, "route": [f"{begin}c", f"c{end}"], "vtype": "car",
        "depart": {"pos_m": pos_m, "speed_mps": speed_mps},
        "vary": {"pos_m": 12.0, "speed_mps": 1.5, "time_s": 0.5}, **keys,
    }  # fmt: skip


def file_of(name: str, begin: str, end: str, pos_m: float, **keys: Any) -> list[dict[str, Any]]:
    """Three cars so far apart that the ego comes in between, or meets one of them."""
    return [actor(f"{name}{k}", begin, end, pos_m - 24.0 * k, 12.0, **keys) for k in range(3)]


EGO = actor("ego", "w", "e", 150.0, 12.0)
STOP = {"at_s": 4.0, "stop_for_s": 4.0, "accel_mps2": 7.0}
SCENES: dict[str, list[dict[str, Any]]] = {
    "side-yields": file_of("side", "s", "n", 200.0),
    "side-forces": file_of("side", "s", "n", 200.0, vtype="forcing"),
    "leader-drives": [actor("leader", "w", "e", 185.0, 12.0)],
    "leader-brakes": [actor("leader", "w", "e", 185.0, 12.0, events=[STOP])],
    "oncoming-straight": file_of("oncoming", "e", "w", 210.0),
    "oncoming-turns": file_of("oncoming", "e", "s", 210.0),
    "oncoming-forces": file_of("oncoming", "e", "s", 210.0, vtype="forcing"),
}


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--scenes", nargs="*", default=list(SCENES), choices=list(SCENES))
    parser.add_argument("--set", action="append", default=[], dest="sets")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    with (
        tempfile.TemporaryDirectory() as name,
        ProcessPoolExecutor(
            options.processes, mp_context=multiprocessing.get_context("spawn")
        ) as pool,
    ):
        folder = Path(name)
        source = {
            "net": str(network(folder)),
            "routes": [str(types(folder))],
            "options": {"lanechange.duration": 3},
        }
        jobs: list[Job] = [
            (
                scene,
                {
                    "data": {
                        "name": scene,
                        "sumo": source,
                        "egos": [{"id": "ego"}],
                        "traffic": {"actors": [EGO, *SCENES[scene]]},
                    }
                },
                tuple(options.sets),
                seed,
            )
            for scene in options.scenes
            for seed in range(options.seeds)
        ]
        rows = list(zip((job[0] for job in jobs), pool.map(run_unsignalled, jobs), strict=True))
    if options.out:
        options.out.write_text(
            "".join(
                json.dumps({"net": scene, "ego": row, "twin": None}) + "\n" for scene, row in rows
            )
        )
    for scene in options.scenes:
        chosen = [row for name, row in rows if name == scene]
        imposed = " ".join(
            str(sum((row[f"imposed_brakes_{k}"] or 0) > 0 for row in chosen)) for k in (2, 3, 4)
        )
        print(
            f"{lone_row(scene, chosen)} {imposed} | "
            f"{sum((row['hard_brakes'] or 0) > 0 for row in chosen)} |"
        )


def network(folder: Path) -> Path:
    """A main road from west to east that a side road crosses, one lane each way."""
    nodes = "".join(
        f'<node id="{name}" x="{x}" y="{y}" type="priority"/>' for name, (x, y) in NODES.items()
    )
    edges = "".join(
        f'<edge id="{a}{b}" from="{a}" to="{b}" numLanes="1" speed="13.9" '
        f'priority="{MAIN if arm in "we" else SIDE}"/>'
        for arm in "wesn"
        for a, b in ((arm, "c"), ("c", arm))
    )
    (folder / "x.nod.xml").write_text(f"<nodes>{nodes}</nodes>")
    (folder / "x.edg.xml").write_text(f"<edges>{edges}</edges>")
    net = folder / "x.net.xml"
    command = [
        str(Path(sumo.__file__).parent / "bin" / "netconvert"),
        "-n",
        "x.nod.xml",
        "-e",
        "x.edg.xml",
        "-o",
        net.name,
        "--no-turnarounds",
    ]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return net


def types(folder: Path) -> Path:
    """Those who keep the rules, and those who take the right of way."""
    path = folder / "types.rou.xml"
    path.write_text(TYPES)
    return path


def run_unsignalled(job: Job) -> dict[str, Any]:
    """The row of one episode in which nobody shows where he is going: SUMO's drivers always do."""
    Observer.scene = unsignalled  # type: ignore[method-assign]
    return run_one(job)


def unsignalled(observer: Observer, *arguments: Any) -> Scene:
    """What is seen, without turn signals."""
    scene = _SEEN(observer, *arguments)
    return scene._replace(agents=scene.agents._replace(blinker=np.zeros_like(scene.agents.blinker)))


if __name__ == "__main__":
    main()
