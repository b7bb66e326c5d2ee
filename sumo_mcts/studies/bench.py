"""How fast this machine plans, against the limits of docs/measures.md.

Only the traffic is random, with a fixed seed. Each figure is also given as a ratio to the yardstick
(numerics/yardstick.py), which runs before it: a rate over its rate, and a time over the time
that it takes for YARD passes. So machines, and busy moments of one machine, compare.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts import config
from sumo_mcts.config import ScenarioConfig, SensorConfig, builtin
from sumo_mcts.controller import Controller
from sumo_mcts.driver.driver import Driver
from sumo_mcts.driver.params import Physics
from sumo_mcts.driver.warmup import standing_car
from sumo_mcts.errors import ConfigError
from sumo_mcts.numerics import yardstick
from sumo_mcts.numerics.announce import COMPILING, announced
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import GREEN, Agents, Scene, Signals
from sumo_mcts.world.grid import write_grid
from sumo_mcts.world.roadmap import read_roadmap
from sumo_mcts.world.simulation import Simulation

Note = Callable[[str], None]
Row = dict[str, Any]

# Setting a: car following, seven accelerations, two on each of two sides are twelve actions.
SETTING_A = (
    "planner.accelerations_mps2=[-8, -4.5, -2, -1, 0, 1, 2.6]",
    "planner.lane_change_accelerations_mps2=[-1, 1]", "planner.look_ahead_steps=4",
    "planner.rollout_steps=4", "planner.step_s=1", "planner.check_s=0.2", "planner.reactive=0",
    "prediction.step_s=0.2", "planner.adaptive=false",
    "prediction.hypotheses=1",
)  # fmt: skip
SCENE = "unprotected-left-turn"  # whose network is filled with agents
EGO_EDGES = ("from_west", "to_north")
EGO_S, EGO_SPEED = 100.0, 8.0
CLEAR = 15.0  # m kept free around the ego
# in the grid: vehicles, seconds before the ego starts, decisions
VEHICLES, SETTLE_S, CYCLES = 300, 60.0, 120
# agents, of them reactive, iterations/s at least; None: no limit
SEARCHES = ((5, 0, 100_000.0), (10, 0, None), (50, 0, None), (10, 10, 20_000.0))
# kind of the 10 agents, how many react; ms at most in the median and the 99th percentile
DECISIONS = (("tabulated", 0, (20.0, 40.0)), ("reactive", 10, (150.0, 300.0)))
YARD = 20_000  # passes of the yardstick
LIMIT_RANGE = 120.0  # m within which about 60 of them are, as the limit says
PHYSICS = Physics(0.1, False, 3.0)
FIRST_DECISION = """
from sumo_mcts import config
from sumo_mcts.config import builtin
from sumo_mcts.driver.driver import Driver
from sumo_mcts.driver.params import streams
from sumo_mcts.driver.warmup import warm_up
from sumo_mcts.episode.loop import Loop
scene = config.load(builtin.scenario_path("highway-exit"))
loop = Loop(scene, 0)
warm_up(scene, loop.world.road, loop.world.physics)
driver = Driver(scene, loop.world.road, loop.world.physics, streams(0).search)
loop.apply({ego: driver.decide(known).decision for ego, known in loop.scenes().items()})
loop.close()
"""


class Quantity(NamedTuple):
    """What one line of the table measures."""

    name: str
    unit: str
    limit: float | None
    at_least: bool = False


def run(share: float, note: Note) -> list[Row]:
    """Measure all of it. Raises ConfigError.

    share: of the usual repetitions; below 1 without the first compilation. note: gets messages
    about what is being measured.
    """
    note("starting new processes")
    rows = _starts(share, note)
    with announced(note):
        return rows + _plans(share, note)


def _plans(share: float, note: Note) -> list[Row]:
    """Planning in this process."""
    rows: list[Row] = []
    for agents, reactive, limit in SEARCHES:
        note(f"searching among {'agents that react' if reactive else f'{agents} agents'}")
        name = f"iterations/s, {agents} " + (
            "reactive agents (setting a otherwise)"
            if reactive
            else "tabulated agents, 12 actions, 4 + 4 steps of 1 s (setting a)"
        )
        quantity, yard = Quantity(name, "1/s", limit, at_least=True), _yard_s()
        rows.append(_row(quantity, _iterations_per_second(agents, reactive, share), yard))
    note("deciding with 3000 iterations")
    for kind, reactive, limits in DECISIONS:
        name, yard = f"one decision of 3000 iterations, 10 {kind} agents", _yard_s()
        rows += _quantiles(name, _decisions(10, reactive, 3000, share), limits, yard)
    note("driving through a grid of streets")
    for range_m, most in ((LIMIT_RANGE, (25.0, 50.0)), (SensorConfig().range_m, (None, None))):
        yard = _yard_s()
        times, in_range = _cycles(share, range_m)
        name = (
            f"a cycle among {VEHICLES} vehicles, up to {in_range} in range ({range_m:.0f} "
            "m), 1000 iterations, all in"
        )
        rows += _quantiles(name, times, most, yard)
    return rows


def _yard_s() -> float:
    """The median time of YARD passes of the yardstick, s."""
    yardstick.searched(1)  # loads it
    times = []
    for _ in range(5):
        began = time.perf_counter()
        yardstick.searched(YARD)
        times.append(time.perf_counter() - began)
    return float(np.median(times))


def _row(measured: Quantity, value: float, yard: float) -> Row:
    """`yard`: s for YARD passes of the yardstick, just before."""
    seconds = value / 1000.0 if measured.unit == "ms" else value
    ratio = value * yard / YARD if measured.unit == "1/s" else seconds / yard
    ok = (
        None
        if measured.limit is None
        else bool(value >= measured.limit if measured.at_least else value <= measured.limit)
    )
    digits = 0 if value >= 1000 else 2
    return {
        "quantity": measured.name,
        "value": round(value, digits),
        "unit": measured.unit,
        "ratio": float(f"{ratio:.3g}"),
        "budget": measured.limit,
        "ok": ok,
    }


def _quantiles(
    name: str, times: Sequence[float], limits: tuple[float | None, float | None], yard: float
) -> list[Row]:
    """Rows for the median and the 99th percentile of times in s."""
    return [
        _row(Quantity(f"{name}, p{q}", "ms", limit), float(np.percentile(times, q)) * 1000.0, yard)
        for q, limit in zip((50, 99), limits, strict=True)
    ]


# --- new processes ---


def _starts(share: float, note: Note) -> list[Row]:
    """--help, the first compilation with an empty cache, and a warm start.

    The warm start comes last: it finds what was compiled.
    """
    yard = _yard_s()
    rows = [_row(Quantity("--help", "s", 0.3), _fastest(["-m", "sumo_mcts", "--help"], 3), yard)]
    if share >= 1.0:
        note(f"{COMPILING}, with an empty cache")
        with tempfile.TemporaryDirectory(prefix="sumo_mcts-") as empty:
            rows.append(
                _row(
                    Quantity("first compilation", "s", 15.0),
                    _seconds(["-c", FIRST_DECISION], {"XDG_CACHE_HOME": empty}),
                    yard,
                )
            )
    _seconds(["-c", FIRST_DECISION], {})  # compiles, where that is still to be done
    warm = Quantity("warm start to first decision", "s", 4.0)
    yard = _yard_s()
    return [*rows, _row(warm, _fastest(["-c", FIRST_DECISION], 3), yard)]


def _fastest(words: list[str], count: int) -> float:
    return min(_seconds(words, {}) for _ in range(count))


def _seconds(words: list[str], environment: dict[str, str]) -> float:
    """Wall time of a new Python process."""
    began = time.perf_counter()
    done = subprocess.run(
        [sys.executable, *words],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise ConfigError(
            f"bench: {' '.join(words)[:40]}: "
            f"{done.stderr.strip().splitlines()[-1] if done.stderr.strip() else 'failed'}"
        )
    return time.perf_counter() - began


# --- scenes without SUMO ---


def _iterations_per_second(agents: int, reactive: int, share: float) -> float:
    """Median over scenes, for decisions of many iterations."""
    scenario, road = _scenario("planner.iterations=20000", f"planner.reactive={reactive}")
    rates = []
    for seed in range(max(2, round(10 * share))):
        scene = _scene(road, agents, seed, near=reactive > 0)
        Driver(scenario, road, PHYSICS, seed).decide(scene)  # touches the memory of the tree
        began = time.perf_counter()
        planned = Driver(scenario, road, PHYSICS, seed).decide(scene)
        rates.append(planned.decision.iterations / (time.perf_counter() - began))
    return float(np.median(rates))


def _decisions(agents: int, reactive: int, iterations: int, share: float) -> list[float]:
    """Times of decisions in s, forecast included, one for each scene."""
    scenario, road = _scenario(f"planner.iterations={iterations}", f"planner.reactive={reactive}")
    driver, times = Driver(scenario, road, PHYSICS, 0), []
    for seed in range(max(20, round(200 * share))):
        scene = _scene(road, agents, seed, near=reactive > 0)
        began = time.perf_counter()
        driver.decide(scene)
        times.append(time.perf_counter() - began)
    return times[1:]  # the first lays out the route


def _scenario(*overrides: str) -> tuple[ScenarioConfig, RoadMap]:
    scenario = config.load(builtin.scenario_path(SCENE), (*SETTING_A, *overrides))
    return scenario, read_roadmap(str(scenario.sumo.net))


def _scene(road: RoadMap, count: int, seed: int, near: bool = False) -> Scene:
    """The ego on its way to the crossing, and `count` agents anywhere on the arms; `near`: on those
    of the ego's route."""
    rng = np.random.default_rng(seed)
    route = tuple(road.edge_ids.index(edge) for edge in EGO_EDGES)
    own = int(np.flatnonzero(road.edge == route[0])[-1])
    x, y, heading = _pose(road, own, EGO_S)
    ego = standing_car(road, own)._replace(
        id="ego", x=x, y=y, heading=heading, v=EGO_SPEED, s=EGO_S, route=route
    )
    places: list[tuple[int, float]] = []
    lanes = np.flatnonzero(np.isin(road.edge, route) if near else ~road.internal)
    while len(places) < count:
        lane = int(rng.choice(lanes))
        s = float(rng.uniform(6.0, road.length[lane]))
        if all(lane != other or abs(s - there) > CLEAR for other, there in [*places, (own, EGO_S)]):
            places.append((lane, s))
    signals = Signals(np.zeros(1, np.int32), np.full((0, 1), GREEN, np.int32), np.zeros((0, 1)))
    return Scene(0.0, PHYSICS.step, ego, _agents(road, places, rng), signals)


def _agents(road: RoadMap, places: Sequence[tuple[int, float]], rng: np.random.Generator) -> Agents:
    """Agents with their fronts at these lane positions."""
    n = len(places)
    x, y, heading = np.array([_pose(road, lane, s) for lane, s in places]).T
    lane, s = np.array([lane for lane, _ in places], np.int32), np.array([s for _, s in places])
    zero, none = np.zeros(n), np.zeros(n, np.int32)
    return Agents(
        ids=tuple(f"agent{i}" for i in range(n)),
        x=x,
        y=y,
        heading=heading,
        v=rng.uniform(0.0, 12.0, n),
        a=zero,
        trend=zero,
        length=zero + 5.0,
        width=zero + 1.8,
        lane=lane,
        s=s,
        d=zero,
        blinker=none,
        standing_s=zero,
        person=np.zeros(n, np.bool_),
        vclass=none,
    )


def _pose(road: RoadMap, lane: int, s: float) -> tuple[float, float, float]:
    """Centre and heading of a car of 5 m with its front at s on a straight lane."""
    first, last = road.points[road.point_offset[lane]], road.points[road.point_offset[lane + 1] - 1]
    along = (last - first) / np.linalg.norm(last - first)
    x, y = first + (s - 2.5) * along
    return float(x), float(y), float(np.arctan2(along[1], along[0]))


# --- whole cycles in SUMO ---


def _cycles(share: float, range_m: float) -> tuple[list[float], int]:
    """Times in s that the program, not SUMO, spends on a decision period in dense city traffic, and
    how many vehicles were in range at most."""
    times: list[float] = []
    in_range = 0
    with tempfile.TemporaryDirectory(prefix="sumo_mcts-") as folder:
        arguments = write_grid(Path(folder), VEHICLES, SETTLE_S)
        arguments += ["--step-length", "0.1", "--time-to-teleport", "-1", "--seed", "1"]
        with closing(Simulation(arguments)) as simulation:
            controller = Controller(
                "ego", {"planner": {"iterations": 1000}, "sensor": {"range_m": range_m}}
            )
            while len(times) < max(20, round(CYCLES * share)) and not simulation.finished:
                spent = 0.0
                for _ in range(5):
                    began = time.perf_counter()
                    controller.step()
                    spent += time.perf_counter() - began
                    simulation.step()
                if (
                    controller.driving
                    and controller.thought is not None
                    and controller.thought.forecast is not None
                ):
                    times.append(spent)
                    in_range = max(in_range, len(controller.thought.forecast.half_length))
    return times[1:], in_range  # the first lays out the route
