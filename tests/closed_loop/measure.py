"""Measures the planner in closed loop; the numbers of docs/studies come from here.

Not a test: nothing is asserted.

    python tests/closed_loop/measure.py scenes [--seeds 100] [--scenes NAME...] [--set a.b=c]...
    [--no-twins]
    python tests/closed_loop/measure.py networks [--egos 10] [--nets NAME...] [--plans FOLDER]
    [--cfg FILE.sumocfg]...

Every episode is run with its twin (planner `sumo`, same seed), unless --no-twins says otherwise:
then a row shows shares of arrivals and collisions instead. `--out FILE` keeps the rows as JSON
lines, `--processes` is the number of episodes at a time.
"""

import argparse
import copy
import json
import math
import multiprocessing
import tempfile
import traceback
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import sumo
import sumolib

from sumo_mcts import config
from sumo_mcts.config import builtin
from sumo_mcts.episode import run_episode
from sumo_mcts.records.statistics import wilson
from sumo_mcts.world.arguments import sumo_arguments
from sumo_mcts.world.candidates import candidates
from sumo_mcts.world.crowd import Cast

GAME = Path(sumo.__file__).parent / "tools" / "game"
SCAN = 400  # vehicles among which egos are chosen
Job = tuple[
    str, dict[str, Any], tuple[str, ...], int | None
]  # name, where the scenario comes from, overrides, seed

# The networks of SUMO's own games: configuration, and where the signals wait for a player, which
# plan replaces theirs.
NETS: dict[str, dict[str, Any]] = {
    "A10KW": {"cfg": "A10KW.sumocfg", "plan": "tls_a10kw.add.xml"},
    "fkk_in": {"cfg": "fkk_in.sumocfg", "plan": "tls_fkk.add.xml"},
    "highway": {
        "net": "highway/highway.net.xml",
        "routes": ["highway/highway.rou.xml"],
        "plan": "tls_bremen.add.xml",
    },
    "ramp": {"cfg": "ramp.sumocfg"},
    "grid6": {"cfg": "grid6.sumocfg"},
    "fokr_bs_demo": {"cfg": "fokr_bs_demo.sumocfg"},
    "cross": {"cfg": "cross.sumocfg", "plan": "own"},
    "square": {"cfg": "square.sumocfg", "plan": "own"},
    "corridor": {"cfg": "corridor.sumocfg", "plan": "own"},
}


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=["scenes", "networks"])
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument(
        "--scenes", nargs="*", default=["unprotected-left-turn", "highway-exit", "straight-line"]
    )
    parser.add_argument("--egos", type=int, default=10)
    parser.add_argument("--nets", nargs="*", default=list(NETS))
    parser.add_argument("--plans", type=Path, help="folder with fixed-time signal plans")
    parser.add_argument("--cfg", nargs="*", default=[], type=Path)
    parser.add_argument("--set", action="append", default=[], dest="sets")
    parser.add_argument(
        "--no-twins",
        action="store_true",
        help="for scripted scenes, where SUMO's driver is no measure",
    )
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    with (
        tempfile.TemporaryDirectory() as folder,
        ProcessPoolExecutor(
            options.processes, mp_context=multiprocessing.get_context("spawn")
        ) as pool,
    ):
        jobs = (
            scene_jobs(options)
            if options.what == "scenes"
            else network_jobs(options, Path(folder), pool)
        )
        rows = []
        for name, (ego, twin) in pool.map(run_alone if options.no_twins else run_pair, jobs):
            rows.append((name, ego, twin))
            print(
                f"  {name:24s} {ego['ego']:20s} {show(ego)}"
                + ("" if twin is None else f"   twin {show(twin)}"),
                flush=True,
            )
    if options.out:
        options.out.write_text(
            "".join(json.dumps({"net": n, "ego": e, "twin": t}) + "\n" for n, e, t in rows)
        )
    for name in [*dict.fromkeys(n for n, _, _ in rows), "all"]:
        chosen = [(e, t) for n, e, t in rows if name in (n, "all")]
        pairs = [(e, t) for e, t in chosen if t is not None]
        print(table_row(name, pairs) if pairs else lone_row(name, [e for e, _ in chosen]))


def scene_jobs(options: argparse.Namespace) -> list[Job]:
    """One job a scene and seed."""
    return [
        (name, {"scene": name}, tuple(options.sets), seed)
        for name in options.scenes
        for seed in range(options.seeds)
    ]


def network_jobs(options: argparse.Namespace, folder: Path, pool: ProcessPoolExecutor) -> list[Job]:
    """One job a network and ego; the egos lie evenly among the first suitable vehicles."""
    sources = {name: net_source(name, options.plans, folder) for name in options.nets} | {
        p.stem: {"sumocfg": str(p.resolve())} for p in options.cfg
    }
    sources = {
        name: {**source, "options": {"end": -1}} for name, source in sources.items()
    }  # a game is over long before its traffic is
    jobs = []
    for name, found in zip(sources, pool.map(suitable, sources.values()), strict=True):
        chosen = [
            found[round(k * (len(found) - 1) / max(options.egos - 1, 1))]
            for k in range(min(options.egos, len(found)))
        ]
        for ego in dict.fromkeys(chosen):
            data = {"name": name, "sumo": sources[name], "egos": [{"id": ego}]}
            jobs.append((name, {"data": data}, tuple(options.sets), None))
    return jobs


def net_source(name: str, plans: Path | None, folder: Path) -> dict[str, Any]:
    """The `sumo` section for one of NETS."""
    net = NETS[name]
    source: dict[str, Any] = (
        {"sumocfg": str(GAME / net["cfg"])} if "cfg" in net else {"net": str(GAME / net["net"])}
    )
    if "routes" in net:
        source["routes"] = [str(GAME / route) for route in net["routes"]]
    plan = net.get("plan")
    if plan is None:
        return source
    if plan == "own":
        source["additional"] = [str(fixed_plan(GAME / net["cfg"], folder / f"{name}.add.xml"))]
    elif plans is not None:
        source["additional"] = [str((plans / plan).resolve())]
    return source


def files_of(cfg: Path, key: str) -> list[Path]:
    """The files that a .sumocfg names under a key."""
    found = ElementTree.parse(cfg).getroot().find(f".//{key}")
    return (
        []
        if found is None
        else [cfg.parent / name.strip() for name in found.get("value", "").split(",")]
    )


def fixed_plan(cfg: Path, path: Path) -> Path:
    """Every signal of a network with its own phases at fixed times: 25 s of green, 4 s of yellow."""
    (net,) = files_of(cfg, "net-file")
    root = ElementTree.Element("additional")
    for logic in sumolib.xml.parse(str(net), "tlLogic"):
        element = ElementTree.SubElement(
            root, "tlLogic", id=logic.id, type="static", programID="fixed", offset="0"
        )
        for phase in logic.phase:
            seconds = 4 if "y" in phase.state.lower() else 25 if "g" in phase.state.lower() else 3
            ElementTree.SubElement(element, "phase", duration=str(seconds), state=phase.state)
    ElementTree.ElementTree(root).write(path)
    return path


def suitable(source: dict[str, Any]) -> list[str]:
    """Vehicles that could be egos, in the order of departure."""
    scenario = config.build({"name": "scan", "sumo": source, "egos": [{"id": "nobody"}]}, "scan")
    with tempfile.TemporaryDirectory() as folder:
        arguments = sumo_arguments(scenario, None, Cast(), Path(folder), ())
        return [c.id for c in candidates(arguments, SCAN) if c.suitable]


def run_pair(job: Job) -> tuple[str, tuple[dict[str, Any], dict[str, Any]]]:
    """The episode and its twin."""
    return job[0], (run_one(job), run_one(job, "planner.name=sumo"))


def run_alone(job: Job) -> tuple[str, tuple[dict[str, Any], None]]:
    """The episode without its twin."""
    return job[0], (run_one(job), None)


def run_one(job: Job, *more: str) -> dict[str, Any]:
    """The row of one episode."""
    name, source, sets, seed = job
    try:
        return run_episode(scenario_of(name, source, (*sets, *more)), seed).rows[0]
    except Exception as error:
        # libsumo's exceptions do not pickle
        raise RuntimeError(
            f"{name} {source}: {type(error).__name__}: {error}\n{traceback.format_exc()}"
        ) from None


def scenario_of(
    name: str, source: dict[str, Any], overrides: tuple[str, ...]
) -> config.ScenarioConfig:
    """A built-in scene, or an ego in a network."""
    if "scene" in source:
        return config.load(builtin.scenario_path(source["scene"]), overrides)
    return config.build(copy.deepcopy(source["data"]), name, overrides)


def show(row: dict[str, Any]) -> str:
    """One row in short."""
    if row["outcome"] == "error":
        return f"error: {str(row['error'])[:120]}"
    time = "   -" if row["travel_time_s"] is None else f"{row['travel_time_s']:6.1f} s"
    fault = {True: " at fault", False: " not at fault", None: ""}[row["at_fault"]]
    others = (
        f"imposed {row['imposed_max_decel_mps2']:.1f} red {row['red_lights_run']} fail-safe "
        f"{row['failsafe_interventions']}"
    )
    return f"{row['outcome']}{fault} {time} {others} p50 {row['plan_ms_p50'] or 0:.1f} ms"


def table_row(name: str, pairs: Sequence[tuple[dict[str, Any], dict[str, Any]]]) -> str:
    """k/n of everything that measures.md counts over pairs, as a Markdown row."""
    egos, twins = [e for e, _ in pairs], [t for _, t in pairs]
    both = [(e, t) for e, t in pairs if t["outcome"] == "arrived"]
    ratio = (
        float(
            np.median(
                [
                    math.inf
                    if e["travel_time_s"] is None
                    else e["travel_time_s"] / t["travel_time_s"]
                    for e, t in both
                ]
            )
        )
        if both
        else math.nan
    )
    outcomes = ", ".join(f"{n} {o}" for o, n in Counter(e["outcome"] for e in egos).items())
    arrived = sum(e["outcome"] == "arrived" for e, _ in both)
    imposed = " ".join(f"{_count(egos, k)}:{_count(twins, k)}" for k in (2, 3, 4))
    return (
        f"| {name} | {len(pairs)} | {outcomes} | {arrived}/{len(both)} {span(arrived, len(both))} "
        f"| {sum(bool(e['at_fault']) for e in egos)} | "
        f"{sum(e['red_lights_run'] or 0 for e in egos)} | "
        f"{sum((e['speeding_share'] or 0) > 0 for e in egos)} | {ratio:.2f} | {imposed} | "
        f"{sum((e['hard_brakes'] or 0) > 0 for e in egos)} | "
        f"{np.median([e['plan_ms_p50'] or 0 for e in egos]):.1f} |"
    )


def lone_row(name: str, egos: Sequence[dict[str, Any]]) -> str:
    """Arrivals in time and collisions of episodes without twins, as a Markdown row."""
    n, outcomes = len(egos), Counter(e["outcome"] for e in egos)
    arrived, collided = outcomes["arrived"], outcomes["collision"]
    times = [e["travel_time_s"] for e in egos if e["outcome"] == "arrived"]
    return (
        f"| {name} | {n} | {', '.join(f'{k} {o}' for o, k in outcomes.items())} | {arrived}/{n} "
        f"{span(arrived, n)} | {collided}/{n} {span(collided, n)} | "
        f"{sum(bool(e['at_fault']) for e in egos)} | {np.median(times) if times else math.nan:.1f} "
        f"| {np.median([e['plan_ms_p50'] or 0 for e in egos]):.1f} |"
    )


def _count(rows: Iterable[dict[str, Any]], limit: int) -> int:
    return sum((row[f"imposed_brakes_{limit}"] or 0) > 0 for row in rows)


def span(k: int, n: int) -> str:
    """95 % interval of a rate, in percent."""
    interval = wilson(k, n)
    return "(-)" if interval is None else f"({100 * interval[0]:.0f}..{100 * interval[1]:.0f} %)"


if __name__ == "__main__":
    main()
