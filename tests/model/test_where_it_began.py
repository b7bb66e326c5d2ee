"""A state costs the same wherever the route began: the search reads the lanes from some metres
behind the ego on, so the numbers of lanes, and where that window begins, must not matter."""

import functools
import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pytest
from helpers import Agent, Conflict, Lane, build, edges, ego_at
from helpers_model import scenario, scene_of, situation_of, task_of

from sumo_mcts.driver.params import cost_params
from sumo_mcts.model import (
    completing,
    cost,
    cost_to_go,
    interaction,
    least_cost,
    occupancy,
    reactions,
)
from sumo_mcts.model.local_map import LocalMap
from sumo_mcts.model.motion import begin_change, can_change
from sumo_mcts.planners.base import Situation, Task, local_of
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import GREEN, RED, Signals

C = cost_params(scenario())
BEFORE = ("z", "y", "x", "w", "v")
STATES = [
    (name, s, v, progress)
    for name, s in (("si_0", 60.0), ("si_1", 60.0), ("si_1", 85.0), (":sn_0", 8.0), ("no_0", 20.0))
    for v in (0.0, 4.0, 11.0)
    for progress in (0.0, 0.4)
]


def road_from_far(signal: str = "") -> RoadMap:
    """Five edges of 250 m, then two lanes of 90 m, of which the right one leads over a road that has
    priority, or past a light, and on."""
    lights = {"signal": signal, "link": 0} if signal else {}
    return build(
        [
            *(
                Lane(name, 0, ((1.6, -1350 + 250 * k), (1.6, -1100 + 250 * k)), (f"{after}_0",))
                for k, (name, after) in enumerate(pairwise([*BEFORE, "si"]))
            ),
            Lane("si", 0, ((1.6, -100), (1.6, -10)), (":sn_0",)),
            Lane("si", 1, ((-1.6, -100), (-1.6, -10))),
            Lane(":sn", 0, ((1.6, -10), (1.6, 10)), ("no_0",), junction="c", **lights),  # type: ignore[arg-type]
            Lane("no", 0, ((1.6, 10), (1.6, 310)), speed=9.0),
            Lane("wi", 0, ((-200, -1.6), (-10, -1.6)), (":we_0",)),
            Lane(":we", 0, ((-10, -1.6), (10, -1.6)), ("eo_0",), junction="c"),
            Lane("eo", 0, ((10, -1.6), (100, -1.6))),
        ],
        [Conflict(":we_0", 9.4, 13.8, ":sn_0", 6.2, 10.6, yields=":sn_0")],
    )


OTHERS = (
    Agent("behind", "si_0", 35.0, 9.0), Agent("beside", "si_0", 76.0, 6.0),
    Agent("comes", "wi_0", 150.0, 12.0), Agent("far", "wi_0", 90.0, 12.0),
    Agent("leads", "no_0", 60.0, 5.0),
)  # fmt: skip


class Seen(NamedTuple):
    task: Task
    situation: Situation
    local: LocalMap


@functools.cache
def seen(first: str, signal: str, name: str, s: float, v: float) -> Seen:
    """An ego whose route began on this edge."""
    road = road_from_far(signal)
    names = (*BEFORE, "si", "no")
    ego = ego_at(road, name, s, v, route=edges(road, *names[names.index(first) :]))
    shown = None
    if signal:
        shown = Signals(
            np.array([0, 1], np.int32), np.array([[RED, GREEN, RED]], np.int32),
            np.array([[4.0, 9.0, math.inf]]),
        )  # fmt: skip
    task = task_of(road, ego)
    situation = situation_of(task, scene_of(ego, road, *OTHERS, signals=shown))
    return Seen(task, situation, local_of(task, situation, reactive=2))


def costs(first: str, signal: str, name: str, s: float, v: float, progress: float) -> list[Any]:
    task, situation, local = seen(first, signal, name, s, v)
    p, state = task.ego, situation.state
    if progress:
        side = 1 if name == "si_0" else -1
        if not can_change(local, p, state, side):
            return []
        state = begin_change(local, p, state, side)._replace(progress=progress)
    others = reactions.undisturbed(local, 2)
    found: list[Any] = [
        cost.terminal(local, C, state, 30.0, 4.0, 3.0),
        cost.step_passability(local, p, C, state),
        cost_to_go.waiting_s(local, state, 2.0, 1.0),
        cost_to_go.expected_wait(local, state, 2.0, 1.0),
        least_cost.least_cost(local, p, C, state, 1.0, 8.0),
        completing.unfinished(local, p, C, state, 4.0),
        cost.is_against(local, state),
    ]
    for t in (0, 5, 12):
        met = interaction.meet(local, p, C, state, others, local.followers, t)
        found += [met.contact, met.rate, met.once, *met.near]
        found.append(interaction.place_is_free(local, p, C, state, others, t))
        found.append(occupancy.yielding_cost(local, p, C, state, others, t))
        moved = others.copy()
        found += [reactions.react(local, p, state, moved, t, 0.2), *moved.ravel()]
    return found


@pytest.mark.parametrize("signal", ["", "t"])
@pytest.mark.parametrize(("name", "s", "v", "progress"), STATES)
def test_a_state_costs_the_same_wherever_the_route_began(
    name: str, s: float, v: float, progress: float, signal: str
) -> None:
    near = costs("si", signal, name, s, v, progress)
    far = costs("z", signal, name, s, v, progress)
    assert far == pytest.approx(near, rel=1e-9, abs=1e-9)


def test_the_window_begins_elsewhere_and_what_is_compared_is_something() -> None:
    firsts = {seen(first, "", "si_0", 60.0, 4.0).local.first for first in ("z", "si")}
    assert min(firsts) == 0 and max(firsts) >= 4
    found = np.array([[float(x) for x in costs("z", "t", *each)] for each in STATES if not each[3]])
    varied = (np.ptp(found, axis=0) > 0.0).sum()
    assert varied > 20
    assert found[:, 4].max() > 2.0  # the bound
    waits = seen("z", "t", "si_0", 85.0, 4.0)
    assert cost_to_go.waiting_s(waits.local, waits.situation.state, 0.0, 0.0) > 3.0
