"""Two simulated hours in one simulation, and a thousand short episodes in one process: does memory
stay flat?

    python tests/endurance.py [--net FILE.net.xml.gz] [--hours 2] [--episodes 1000]

The network is one that comes with SUMO (Braunschweig) unless another one is given; traffic is drawn
for it. Prints a table as Markdown; exit status 1 where memory grows.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import libsumo

from sumo_mcts import Controller, load_scenario, run_episode
from sumo_mcts.world.arguments import sumo_home

CITY = "tools/game/fokr_bs_demo/fokr_bs.net.xml.gz"
PERIOD_S = 1.5  # between departures: dense, but no standstill
STEP_S = 0.1
ITERATIONS = 300
SCENES = ("unprotected-left-turn", "highway-exit", "straight-line")
ROWS = 12  # of a table
WARM_UP = 0.25  # share of the time in which caches fill
MOST_GROWTH = 0.05  # of the memory at the end of it, until the end


class Sample(NamedTuple):
    """The process at a moment."""

    at: float  # simulated hours, or episodes
    megabytes: float  # resident
    seconds: float  # since the begin
    what: str  # what was done so far


def main() -> int:
    """Run both parts, each in a process of its own."""
    asked = _parsed()
    if asked.part is None:
        statuses = [
            subprocess.run(
                [sys.executable, __file__, *sys.argv[1:], "--part", part], check=False
            ).returncode
            for part in ("hours", "episodes")
        ]
        return max(statuses)
    samples = list(
        hours(asked.net, asked.hours) if asked.part == "hours" else episodes(asked.episodes)
    )
    print(table(asked.part, samples), flush=True)
    return 0 if is_flat(samples) else 1


def hours(net: str, duration_h: float) -> Iterator[Sample]:
    """Drive one vehicle after another by the search, in one simulation."""
    with tempfile.TemporaryDirectory() as folder:
        routes = _traffic(net, duration_h, Path(folder))
        options = [
            "--step-length",
            str(STEP_S),
            "--time-to-teleport",
            "120",
            "--no-warnings",
            "true",
            "--no-step-log",
            "true",
        ]
        libsumo.start(["sumo", "-n", net, "-r", str(routes), *options])
        begun, egos, driven = time.monotonic(), 0, 0
        ego, controller = "", None
        steps = round(duration_h * 3600 / STEP_S)
        for step in range(steps):
            if step % (steps // ROWS) == 0:
                now = (
                    f"{egos} egos, driven for {driven * STEP_S:.0f} s, "
                    f"{libsumo.vehicle.getIDCount()} vehicles on the road"
                )
                yield _sample(step * STEP_S / 3600, begun, now)
            if controller is None and (ego := _just_departed()):
                controller, egos = (
                    Controller(ego, {"planner": {"iterations": ITERATIONS}}, seed=egos),
                    egos + 1,
                )
            if controller is not None:
                controller.step()
                driven += controller.driving
            libsumo.simulationStep()
            if ego in libsumo.simulation.getArrivedIDList():
                controller = None
        yield _sample(duration_h, begun, f"{egos} egos, driven for {driven * STEP_S:.0f} s")
        libsumo.close()


def episodes(count: int) -> Iterator[Sample]:
    """Short episodes of the built-in scenes, one after the other."""
    begun = time.monotonic()
    outcomes: dict[str, int] = {}
    short = ("planner.iterations=50", "episode.time_limit_s=4", "episode.stop_time_s=4")
    scenes = [load_scenario(name, *short) for name in SCENES]
    for number in range(count + 1):
        if number % max(1, count // ROWS) == 0 or number == count:
            yield _sample(
                number,
                begun,
                ", ".join(f"{n} {outcome}" for outcome, n in sorted(outcomes.items())),
            )
        if number < count:
            for row in run_episode(scenes[number % len(scenes)], number).rows:
                outcomes[row["outcome"]] = outcomes.get(row["outcome"], 0) + 1


def is_flat(samples: Sequence[Sample]) -> bool:
    """Whether memory does not grow any more, once it has warmed up."""
    last = samples[-1]
    warm = next(sample for sample in samples if sample.at >= WARM_UP * last.at)
    return last.megabytes <= (1 + MOST_GROWTH) * warm.megabytes


def table(part: str, samples: Sequence[Sample]) -> str:
    """The samples as Markdown."""
    lines = [
        f"| {sample.at:.6g} | {sample.megabytes:.0f} | {sample.seconds:.0f} | {sample.what} |"
        for sample in samples
    ]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    verdict = "flat" if is_flat(samples) else "GROWS"
    return "\n".join(
        [
            f"| {part} | memory, MB | after, s | so far |",
            "|---|---|---|---|",
            *lines,
            "",
            f"memory: {verdict}, {peak:.0f} MB at most",
            "",
        ]
    )


def _sample(at: float, begun: float, what: str) -> Sample:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return Sample(at, pages * resource.getpagesize() / 2**20, time.monotonic() - begun, what)


def _just_departed() -> str:
    """A passenger car that departed in the last step; "": there is none."""
    departed = libsumo.simulation.getDepartedIDList()
    return next(
        (name for name in departed if libsumo.vehicle.getVehicleClass(name) == "passenger"), ""
    )


def _traffic(net: str, duration_h: float, folder: Path) -> Path:
    """Random trips over the network, that last as long."""
    routes = folder / "routes.rou.xml"
    script = Path(sumo_home()) / "tools" / "randomTrips.py"
    words = [
        "-n",
        net,
        "-o",
        str(folder / "trips.xml"),
        "-r",
        str(routes),
        "-e",
        str(int(duration_h * 3600)),
        "-p",
        str(PERIOD_S),
        "--fringe-factor",
        "5",
        "--seed",
        "1",
        "--validate",
    ]
    subprocess.run(
        [sys.executable, str(script), *words], check=True, cwd=folder, capture_output=True
    )
    return routes


def _parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="Does memory stay flat over hours, and over a thousand episodes?"
    )
    parser.add_argument("--net", default=str(Path(sumo_home()) / CITY), help="a network file")
    parser.add_argument("--hours", type=float, default=2.0, help="simulated")
    parser.add_argument("--episodes", type=int, default=1000)
    parser.add_argument("--part", choices=("hours", "episodes"), help="only this one")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
