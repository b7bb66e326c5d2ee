"""What rollouts have driven is not driven again, and nothing comes out differently for it."""

import math
from typing import Any

import numpy as np
import pytest
from helpers import ego_at
from helpers_model import lanes_east, local_of, plain, scenario, scene_of, task_of
from helpers_tree import TOYS, Toy, grow, steady

from sumo_mcts.planners import ply, search
from sumo_mcts.planners.actions import FOLLOW
from sumo_mcts.planners.continued import nothing_continued
from sumo_mcts.planners.ply import ALIVE, LOST
from sumo_mcts.planners.tree import WISHES, new_tree, store

FOLLOWS, BRAKES, SLOWS_DOWN, THEN_BRAKES, PUSHES, CHANGES = range(6)
ALONE = ply.Neighbours(math.inf, 0.0, 0)


@pytest.mark.parametrize("name", TOYS)
@pytest.mark.parametrize("adaptive", [True, False])
def test_the_tree_is_the_same_where_nothing_of_it_is_kept(name: str, adaptive: bool) -> None:
    toy: Toy = TOYS[name] if adaptive else steady(TOYS[name])
    grown = grow(toy, 400)
    kept, others = grown.tree, grown.tree.others[0]
    assert kept.continued.used[0] > 10
    bare = new_tree(len(kept.parent), len(grown.actions), len(kept.line), others)
    bare = bare._replace(continued=nothing_continued(len(kept.parent), 2, WISHES, len(others)))
    passes = search.search(
        bare, grown.local, grown.task.ego, grown.task.cost, grown.q, grown.actions, grown.root,
        400, math.inf, np.random.Generator(np.random.PCG64(1)),
    )  # fmt: skip
    assert passes == (grown.done, grown.known) and bare.continued.used[0] == 1
    for field in ("parent", "visits", "total", "best", "closed", "plan", "cost", "others"):
        np.testing.assert_array_equal(getattr(bare, field), getattr(kept, field), field)


def test_each_ply_from_a_node_is_driven_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Four plies from level 0, of 1 each, on which an agent that reacts goes on by 1."""
    road = lanes_east(1, 900.0)
    ego = ego_at(road, "a_0", 100.0, 10.0)
    task = task_of(road, ego, scenario())
    local, state = local_of(task, scene_of(ego, road))
    made = new_tree(8, 1, 4, np.array([[7.0, 0.0]]))
    store(made, 0, state, ALONE)
    q = grow(TOYS["free"], 1).q._replace(look_ahead=0, rollout=4)
    asked: list[tuple[float, float]] = []

    def simulated(*those: Any) -> ply.Ply:
        others, accel = those[5], those[7].accel
        asked.append((accel, float(others[0, 0])))
        others[0, 0] += 1.0
        end = LOST if accel == -0.5 * task.ego.approach_decel else ALIVE
        return ply.Ply(those[4]._replace(s=len(asked)), ALONE, 1.0, 0.0, 0.0, 0.0, end, 50.0)

    monkeypatch.setattr(search, "simulate", simulated)
    monkeypatch.setattr(search, "terminal", lambda *_: 0.25)
    monkeypatch.setattr(search, "unfinished", lambda *_: 0.5)
    brakes, slows, pushes = -task.ego.approach_decel, -0.5 * task.ego.approach_decel, 2.6
    follows = [(FOLLOW, 7.0), (FOLLOW, 8.0), (FOLLOW, 9.0), (FOLLOW, 10.0)]
    for policy, turn, new, j in (
        (FOLLOWS, 4, follows, 4.75),
        (FOLLOWS, 4, [], 4.75),
        (THEN_BRAKES, 2, [(brakes, 9.0), (brakes, 10.0)], 4.75),
        (BRAKES, 4, [(brakes, t) for t in (7.0, 8.0, 9.0, 10.0)], 4.75),
        (THEN_BRAKES, 0, [], 4.75),
        (PUSHES, 0, [(pushes, 7.0), *follows[1:]], 4.75),
        (PUSHES, 1, [(pushes, 8.0), *follows[2:]], 4.75),
        (SLOWS_DOWN, 4, [(slows, 7.0)], 51.0),
        (SLOWS_DOWN, 4, [], 51.0),
    ):
        asked.clear()
        monkeypatch.setattr(search, "_continuation", lambda *_, to=(policy, turn): (*to, 0))
        line = np.full((4, 3), 9.0)
        found = plain(search._rollout)(
            made, local, task.ego, task.cost, q, 0, line, np.random.default_rng(1)
        )
        assert (found, asked) == (j, new)
        assert np.isnan(line[:, 0]).sum() == (3 if policy == SLOWS_DOWN else 0)
