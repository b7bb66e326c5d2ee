"""Measures how much of the braking that counts as imposed would have come without the ego too.

Not a test: nothing is asserted.

    python tests/closed_loop/caused.py [--seeds 200] [--scenes NAME...] [--set a.b=c]... [--out
    FILE]

An agent's braking counts if SUMO names the ego as its leader, or the ego is in its way
(docs/measures.md), whatever else it brakes for. So each episode that has such braking, of the
planner and of its twin, is run once more, and right before each step in question a copy of the
simulation goes on for that step without the ego. Braking beyond a limit is caused by the ego if
without it it would be within the limit, and less by MARGIN at least. Only that step is looked at:
what the ego has caused before, the agent's speed and place, is the same in both.
"""

import argparse
import json
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import libsumo  # type: ignore[import-untyped]
import numpy as np
from measure import span

from sumo_mcts import config
from sumo_mcts.arrays import Floats
from sumo_mcts.config import builtin
from sumo_mcts.episode import run_episode
from sumo_mcts.evaluation import referee
from sumo_mcts.evaluation.imposed import IMPOSED, braking_for_ego
from sumo_mcts.world.clone import in_copy
from sumo_mcts.world.simulation import Simulation

MARGIN = (
    1.0  # m/s2; drivers dawdle at random, and other numbers are drawn where a vehicle is missing
)
EPS = 1e-6
SCENES = ("unprotected-left-turn-varied", "highway-exit-varied", "straight-line-varied")
Job = tuple[str, tuple[str, ...], int]  # scene, overrides, seed
_JUDGE, _STEP = braking_for_ego, Simulation.step


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--scenes", nargs="*", default=list(SCENES))
    parser.add_argument("--set", action="append", default=[], dest="sets")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    sides = {"ego": tuple(options.sets), "twin": (*options.sets, "planner.name=sumo")}
    jobs: list[Job] = [
        (scene, sets, seed)
        for scene in options.scenes
        for sets in sides.values()
        for seed in range(options.seeds)
    ]
    rows = []
    with ProcessPoolExecutor(
        options.processes, mp_context=multiprocessing.get_context("spawn")
    ) as pool:
        for (scene, sets, seed), found in zip(jobs, pool.map(looked_at, jobs), strict=True):
            rows.append(
                {
                    "scene": scene,
                    "side": "ego" if sets == sides["ego"] else "twin",
                    "seed": seed,
                    "braking": found,
                }
            )
            print(
                f"  {scene:30s} {rows[-1]['side']:4s} {seed:4d}  {len(found)} steps of braking",
                flush=True,
            )
    if options.out:
        options.out.write_text("".join(json.dumps(row) + "\n" for row in rows))
    for scene in options.scenes:
        print(table_row(scene, [row for row in rows if row["scene"] == scene]))


def looked_at(job: Job) -> list[tuple[float, str, float, float]]:
    """Each step (s) and agent of one episode in which it brakes for the ego: with how many m/s2,
    and with how many it would without the ego."""
    scene, sets, seed = job
    scenario = config.load(builtin.scenario_path(scene), sets)
    heard = Braking(scenario.egos[0].id)
    referee.braking_for_ego, Simulation.step = heard.judge, heard.step  # type: ignore[attr-defined, method-assign]
    try:
        run_episode(scenario, seed)
        first, heard.wanted = (
            heard.found,
            {time: [name for name, _ in braking] for time, braking in heard.found.items()},
        )
        if first:
            heard.found = {}
            run_episode(scenario, seed)
        if heard.found != first:
            raise RuntimeError(f"{scene}, seed {seed}: the second run is not the first")
    finally:
        referee.braking_for_ego, Simulation.step = _JUDGE, _STEP  # type: ignore[attr-defined, method-assign]
    return [
        (time, name, decel, heard.without[time, name])
        for time, braking in first.items()
        for name, decel in braking
    ]


class Braking:
    """Listens to the referee, and asks copies of the simulation."""

    def __init__(self, ego: str) -> None:
        self._ego = ego
        self.wanted: dict[float, list[str]] = {}  # by the time at the end of a step
        self.found: dict[float, list[tuple[str, float]]] = {}
        self.without: dict[tuple[float, str], float] = {}

    @property
    def judge(self) -> Any:
        """In place of referee.braking_for_ego."""

        def judge(*asked: Any) -> list[tuple[str, float]]:
            braking, frame = _JUDGE(*asked), asked[-2]
            if braking:
                self.found[round(frame.time, 3)] = braking
            return braking

        return judge

    @property
    def step(self) -> Any:
        """In place of Simulation.step."""

        def step(simulation: Simulation) -> None:
            time = round(simulation.time + libsumo.simulation.getDeltaT(), 3)
            names = self.wanted.get(time, [])
            if names:
                answers = in_copy(lambda: self._alone(names), (len(names),))
                self.without |= {
                    (time, name): float(decel) for name, decel in zip(names, answers, strict=True)
                }
            _STEP(simulation)

        return step

    def _alone(self, names: list[str]) -> Floats:
        """In the copy: the braking of these agents in a step without the ego, m/s2."""
        before = np.array([libsumo.vehicle.getSpeed(name) for name in names])
        libsumo.vehicle.remove(self._ego)
        libsumo.simulationStep()
        there = set(libsumo.vehicle.getIDList())
        after = np.array(
            [
                libsumo.vehicle.getSpeed(name) if name in there else v
                for name, v in zip(names, before, strict=True)
            ]
        )
        return np.asarray((before - after) / libsumo.simulation.getDeltaT())


def table_row(scene: str, rows: list[dict[str, Any]]) -> str:
    """Episodes with braking beyond 2, 3 and 4 m/s2 that counts as imposed (ego:twin), and of them
    those in which the ego causes it."""
    sides = {
        side: [row["braking"] for row in rows if row["side"] == side] for side in ("ego", "twin")
    }
    counts = {
        side: [
            sum(any(decel > limit + EPS for _, _, decel, _ in braking) for braking in found)
            for limit in IMPOSED
        ]
        for side, found in sides.items()
    }
    caused = {
        side: [sum(causes(braking, limit) for braking in found) for limit in IMPOSED]
        for side, found in sides.items()
    }
    pairs = [
        " ".join(f"{mine}:{twins}" for mine, twins in zip(of["ego"], of["twin"], strict=True))
        for of in (counts, caused)
    ]
    n = len(sides["ego"])
    return (
        f"| {scene} | {n} | {pairs[0]} | {pairs[1]} | "
        f"{', '.join(f'{caused[side][-1]}/{n} {span(caused[side][-1], n)}' for side in sides)} "
        "|"
    )


def causes(braking: list[tuple[float, str, float, float]], limit: float) -> bool:
    """Whether the ego causes braking beyond the limit, m/s2, in an episode."""
    return any(
        decel > limit + EPS and without <= min(limit, decel - MARGIN)
        for _, _, decel, without in braking
    )


if __name__ == "__main__":
    main()
