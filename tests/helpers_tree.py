"""Searches in small scenes, and their trees as plain data.

`python tests/helpers_tree.py` writes the golden trees again.
"""

import json
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from helpers import Agent, edges, ego_at, lights
from helpers_model import (
    lanes_east,
    local_of,
    road_with_light,
    scenario,
    scene_of,
    situation_of,
    task_of,
)

from sumo_mcts.arrays import Floats
from sumo_mcts.driver.factories import make_planner
from sumo_mcts.model.local_map import LocalMap, State
from sumo_mcts.model.reactions import undisturbed
from sumo_mcts.planners.base import Task
from sumo_mcts.planners.mcts import actions_of, in_steps, mcts_params
from sumo_mcts.planners.ply import SearchParams
from sumo_mcts.planners.search import search
from sumo_mcts.planners.tree import Tree, new_tree
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import RED, Decision, EgoState, Scene

GOLDEN = Path(__file__).parent / "planners" / "golden_tree.json"


class Toy(NamedTuple):
    """A scene and the configuration of its search."""

    road: RoadMap
    scene: Scene
    sets: tuple[str, ...] = ()


class Grown(NamedTuple):
    """A tree, and all inputs of its search."""

    tree: Tree
    local: LocalMap
    task: Task
    q: SearchParams
    actions: Floats
    root: State
    done: int  # passes to the horizon
    known: int  # passes that ended in a known terminal node


def on_three_lanes(ego: EgoState | None = None, *agents: Agent, sets: tuple[str, ...] = ()) -> Toy:
    """By default the ego in the middle one of three lanes, at 100 m and 10 m/s."""
    road = lanes_east(3, 900.0)
    return Toy(road, scene_of(ego or ego_at(road, "a_1", 100.0, 10.0), road, *agents), sets)


def mirrored(toy: Toy) -> Toy:
    """The scene with left and right exchanged, for lanes that are symmetric about y = 0."""
    ego, others, last = toy.scene.ego, toy.scene.agents, len(toy.road.lane_ids) - 1
    ego = ego._replace(y=-ego.y, heading=-ego.heading, d=-ego.d, lane=last - ego.lane)
    others = others._replace(
        y=-others.y,
        heading=-others.heading,
        d=-others.d,
        lane=(last - others.lane).astype(np.int32),
        blinker=-others.blinker,
    )
    return toy._replace(scene=toy.scene._replace(ego=ego, agents=others))


def before_a_light(shows: int, distance: float = 60.0, v: float = 12.0) -> Toy:
    """The ego `distance` m before a stop line."""
    road = road_with_light()
    return Toy(
        road,
        scene_of(
            ego_at(road, "a_0", 200.0 - distance, v, route=edges(road, "a", "b")),
            road,
            signals=lights(shows),
        ),
    )


def steady(toy: Toy) -> Toy:
    """The same scene for a search that is not adaptive: all passes, drawn rollouts."""
    return toy._replace(sets=(*toy.sets, "planner.adaptive=false"))


TOYS = {
    "free": on_three_lanes(),
    "traffic": on_three_lanes(
        None,
        Agent("ahead", "a_1", 130.0, 6.0),
        Agent("beside", "a_2", 98.0, 11.0),
        Agent("behind", "a_0", 80.0, 13.0),
    ),
    "reactive": on_three_lanes(
        None,
        Agent("ahead", "a_1", 130.0, 6.0),
        Agent("beside", "a_2", 93.0, 11.0),
        Agent("behind", "a_1", 80.0, 13.0),
        sets=("planner.reactive=3",),
    ),
    "wall": on_three_lanes(None, *(Agent(f"w{k}", f"a_{k}", 135.0, 0.0) for k in range(3))),
    "red": before_a_light(RED),
}


def grow(toy: Toy, iterations: int, seed: int = 1, *, each: bool = False) -> Grown:
    """The tree after a number of passes.

    `each`: the search also finds the best sequence of every root action (rollout.SearchParams).
    """
    config = scenario(*toy.sets)
    task = task_of(toy.road, toy.scene.ego, config)
    local, root = local_of(task, toy.scene, reactive=config.planner.reactive)
    p = config.planner
    actions = actions_of(mcts_params(config))
    q = in_steps(mcts_params(config), task.ego.step, local.dt)._replace(each=each)
    tree = new_tree(
        iterations + 2,
        len(actions),
        p.look_ahead_steps + p.rollout_steps,
        undisturbed(local, p.reactive),
    )
    done, known = search(
        tree,
        local,
        task.ego,
        task.cost,
        q,
        actions,
        root,
        iterations,
        math.inf,
        np.random.Generator(np.random.PCG64(seed)),
    )
    return Grown(tree, local, task, q, actions, root, int(done), int(known))


def decide(toy: Toy, *sets: str, seed: int = 1) -> Decision:
    """The decision of the planner that the configuration names."""
    config = scenario(*toy.sets, *sets)
    planner = make_planner(config)
    task = task_of(toy.road, toy.scene.ego, config)
    planner.start(task, seed)
    return planner.plan(situation_of(task, toy.scene))


def plain(grown: Grown) -> dict[str, Any]:
    """The tree as JSON data; floats as hexadecimal text, which is exact."""
    tree, used = grown.tree, int(grown.tree.used[0])
    return {
        "passes": [grown.done, grown.known],
        "parent": tree.parent[:used].tolist(),
        "visits": tree.visits[:used].tolist(),
        "closed": tree.closed[:used].astype(int).tolist(),
        "best": [float(best).hex() for best in tree.best[:used]],
    }


def rough(data: Mapping[str, Any]) -> dict[str, Any]:
    """The same data with floats as numbers, for comparison across platforms."""
    return {
        **data,
        "best": [float.fromhex(best) if best != "inf" else math.inf for best in data["best"]],
    }


def small_trees(iterations: int = 150) -> dict[str, Any]:
    """The trees of all toys after a few passes, from the adaptive search and from the other one."""
    return {
        name: plain(grow(toy, iterations))
        for name, toy in (
            *TOYS.items(),
            *((f"{name}-steady", steady(toy)) for name, toy in TOYS.items()),
        )
    }


if __name__ == "__main__":
    trees = small_trees()
    if "--print" in sys.argv:
        sys.stdout.write(json.dumps(trees))
    else:
        GOLDEN.write_text(json.dumps(trees, indent=None, separators=(",", ":")) + "\n")
