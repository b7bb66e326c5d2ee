"""Do two versions of the code decide alike? Writes the rows of many episodes, or compares two such
files. Not a test: it takes minutes.

    python tests/closed_loop/same.py rows BEFORE.json [--cfg FILE.sumocfg]...
    python tests/closed_loop/same.py compare BEFORE.json AFTER.json

Planners mcts and paper: every built-in scenario, twenty made networks (made.py) and those named by
--cfg, up to SECONDS of each. Rows are compared in all keys that both have, but for times on the
clock, and digests of settings.
"""

import argparse
import json
import multiprocessing
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from made import KINDS, make

from sumo_mcts.episode import run_episode
from sumo_mcts.errors import ConfigError
from sumo_mcts.scenarios import load_scenario

TOP = Path(__file__).resolve().parents[2]
PLANNERS = ("mcts", "paper")
SECONDS = 60
MORE_OF = (
    "actuated",
    "random",
    "crossings-lights",
    "sublane",
)  # made with a second seed, too: twenty networks in all
OF_THE_CLOCK = {"wall_s", "realtime_factor", "deadline_misses", "config_digest", "key"}


def main() -> int:
    """Do what the command line asks for; the number of rows that differ."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=["rows", "compare"])
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--cfg", action="append", default=[])
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    if options.what == "compare":
        before, after = (json.loads(path.read_text()) for path in options.files)
        return compared(before, after)
    options.files[0].write_text(json.dumps(rows(options.cfg, options.processes), indent=1))
    return 0


def rows(cfgs: list[str], processes: int) -> dict[str, dict[str, Any]]:
    """The rows by name."""
    scenes = sorted(path.stem for path in (TOP / "configs").glob("*.yaml"))
    with tempfile.TemporaryDirectory() as folder:
        made = [make(kind, 1, Path(folder)) for kind in KINDS] + [
            make(kind, 2, Path(folder)) for kind in MORE_OF
        ]
        networks = [(Path(cfg).resolve(), Path(cfg).stem) for cfg in cfgs] + [
            (cfg, cfg.parent.name) for cfg in made
        ]
        jobs = [(scene, scene, planner) for scene in scenes for planner in PLANNERS]
        jobs += [(str(cfg), name, planner) for cfg, name in networks for planner in PLANNERS]
        with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
            found = {}
            for name, row in pool.map(row_of, jobs):
                found[name] = row
                print(
                    f"{len(found)} of {len(jobs)} {name}: {row['outcome']} "
                    f"{row['trace_digest'] or row['error']}",
                    flush=True,
                )
    return found


def row_of(job: tuple[str, str, str]) -> tuple[str, dict[str, Any]]:
    """The row of one episode."""
    scenario, name, planner = job
    built_in = scenario == name
    limit = () if built_in else (f"episode.time_limit_s={SECONDS}",)
    try:
        config = load_scenario(
            scenario, f"planner.name={planner}", *limit, ego=() if built_in else "any"
        )
        row = run_episode(config, 1).rows[0]
    except ConfigError as error:
        row = {"outcome": "refused", "trace_digest": "", "error": str(error)}
    return f"{name} {planner}", json.loads(json.dumps(row, default=str))


def compared(before: dict[str, dict[str, Any]], after: dict[str, dict[str, Any]]) -> int:
    """Prints what differs."""
    names = [name for name in before if name in after]
    different = {name: _differences(before[name], after[name]) for name in names}
    for name, keys in different.items():
        if keys:
            print(f"{name}: {', '.join(keys)}")
    wrong = sum(bool(keys) for keys in different.values())
    print(
        f"{len(names)} rows in both, {wrong} differ; {len(before) - len(names)} only before, "
        f"{len(after) - len(names)} only after"
    )
    return wrong


def _differences(one: dict[str, Any], other: dict[str, Any]) -> list[str]:
    shared = [
        key
        for key in one
        if key in other and key not in OF_THE_CLOCK and not key.startswith("plan_ms_")
    ]
    return [f"{key} {one[key]} {other[key]}" for key in shared if one[key] != other[key]]


if __name__ == "__main__":
    sys.exit(main())
