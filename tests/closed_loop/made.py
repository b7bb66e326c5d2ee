"""Makes networks of many kinds with traffic, and an experiment that drives in all of them.

Not a test: nothing is asserted.

    python tests/closed_loop/made.py FOLDER [--seeds 1 2] [--egos 7] [--kinds NAME...]
    sumo-mcts batch FOLDER/made.yaml --out OUT
    sumo-mcts report OUT

Nothing was tuned to them: another seed makes other streets and other traffic.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import sumo
import yaml

BIN, TOOLS = Path(sumo.SUMO_HOME) / "bin", Path(sumo.SUMO_HOME) / "tools"
GRID = ("--grid", "--grid.number=4", "--grid.length=120")
RANDOM = ("--rand", "--rand.iterations=80", "--rand.min-distance=60")


class Kind(NamedTuple):
    """How streets and traffic are made.

    SUMO's defaults are kept where nothing is said: steps of a second, lane changes at once.
    """

    net: tuple[str, ...]  # options of netgenerate
    period: float = 1.2  # s between two departures
    vclass: str = "passenger"
    options: tuple[tuple[str, str], ...] = ()  # of SUMO
    walkers: bool = False  # a pedestrian a second, too


KINDS = {
    "actuated": Kind((*GRID, "-L", "2", "--default-junction-type=traffic_light",
    "--tls.default-type=actuated")),
    "turn-lanes": Kind((*GRID, "-L", "2", "--turn-lanes=1", "--turn-lanes.length=40",
    "--default-junction-type=traffic_light"), 1.0),
    "right-before-left": Kind((*GRID, "--default-junction-type=right_before_left")),
    "stop": Kind((*GRID, "-L", "2", "--default-junction-type=priority_stop"), 1.5),
    "all-way-stop": Kind((*GRID, "--default-junction-type=allway_stop"), 2.0),
    "zipper-lorries": Kind((*GRID, "-L", "2", "--default-junction-type=zipper"), 2.0, "truck"),
    "no-internal-lanes": Kind((*GRID, "-L", "2", "--no-internal-links"), 1.5),
    "spider": Kind(("--spider", "--spider.arm-number=6", "--spider.circle-number=3",
    "--spider.space-radius=80", "-L", "2")),
    "random": Kind((*RANDOM, "-L", "2", "--rand.random-lanenumber"), 1.0),
    "random-left-hand": Kind((*RANDOM, "-L", "2", "--lefthand"), 1.0),
    "random-lights": Kind((*RANDOM, "-L", "3", "--rand.random-lanenumber", "--tls.guess",
    "--tls.guess.threshold=30"), 0.8),
    "bicycles": Kind((*GRID, "--sidewalks.guess"), 2.0, "bicycle"),
    "crossings": Kind((*GRID, "-L", "2", "--sidewalks.guess", "--crossings.guess"), 1.5,
    walkers=True),
    "crossings-lights": Kind((*GRID, "-L", "2", "--sidewalks.guess", "--crossings.guess",
    "--default-junction-type=traffic_light"), 1.5, walkers=True),
    "short-steps": Kind((*GRID, "-L", "2"), 1.5,
    options=(("step-length", "0.05"), ("step-method.ballistic", "true"))),
    "sublane": Kind((*GRID, "-L", "2"), 1.5, options=(("lateral-resolution", "0.8"),)),
}  # fmt: skip


def main() -> None:
    """Make what the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, nargs="*", default=[1, 2])
    parser.add_argument("--egos", type=int, default=7, help="drawn in each network")
    parser.add_argument("--kinds", nargs="*", default=list(KINDS), choices=list(KINDS))
    options = parser.parse_args()
    made = [make(kind, seed, options.folder) for kind in options.kinds for seed in options.seeds]
    scenarios = [{"sumocfg": str(sumocfg), "egos": {"random": options.egos}} for sumocfg in made]
    experiment = {
        "name": "made",
        "description": "Networks made on the spot, with twins.",
        "scenarios": scenarios,
        "variants": {"mcts": {}},
        "twins": True,
    }
    (options.folder / "made.yaml").write_text(yaml.safe_dump(experiment, sort_keys=False))
    print(f"{len(made)} networks; sumo-mcts batch {options.folder / 'made.yaml'} --out OUT")


def make(kind: str, seed: int, folder: Path) -> Path:
    """A network of one kind with traffic for 400 s; returns its configuration."""
    name, how = f"{kind}-{seed}", KINDS[kind]
    here = folder.resolve() / name
    here.mkdir(parents=True, exist_ok=True)
    _run(here, str(BIN / "netgenerate"), *how.net, "--seed", str(seed), "-o", "net.xml")
    cars = (
        "-r",
        "routes.xml",
        "-p",
        str(how.period),
        "--vclass",
        how.vclass,
        "--fringe-factor",
        "3",
        "--min-distance",
        "150",
        "--validate",
    )
    people = (
        "-r",
        "walks.xml",
        "-p",
        "1.0",
        "--pedestrians",
        "--prefix",
        "walker",
        "--max-distance",
        "400",
    )
    for trips in (cars, people) if how.walkers else (cars,):
        _run(
            here,
            sys.executable,
            str(TOOLS / "randomTrips.py"),
            "-n",
            "net.xml",
            "-o",
            "trips.xml",
            "-e",
            "400",
            "--seed",
            str(seed),
            *trips,
        )
    keys = (
        ("net-file", "net.xml"),
        ("route-files", "routes.xml,walks.xml" if how.walkers else "routes.xml"),
        *how.options,
    )
    (here / f"{name}.sumocfg").write_text(
        "<configuration>"
        + "".join(f'<{key} value="{value}"/>' for key, value in keys)
        + "</configuration>"
    )
    return here / f"{name}.sumocfg"


def _run(folder: Path, *command: str) -> None:
    subprocess.run(
        command,
        cwd=folder,
        check=True,
        capture_output=True,
        env={**os.environ, "SUMO_HOME": str(sumo.SUMO_HOME)},
    )


if __name__ == "__main__":
    main()
