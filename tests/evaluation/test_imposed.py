"""The referee on small hand-made roads: braking imposed on others."""

from typing import Any

import numpy as np
import pytest
from helpers import (
    Agent,
    edges,
    ego_at,
    frame_of,
    lane,
    lights,
)
from helpers_referee import CROSSING, ROUTE, SIGNALLED, STEP, STRAIGHT, referee

from sumo_mcts.road import RoadMap
from sumo_mcts.scene import GREEN, RED


def imposed(
    road: RoadMap,
    ego: Any,
    *agents: Agent,
    path: tuple[str, ...] = (),
    leader: str = "",
    decel: float = 3.5,
    signals: Any = None,
) -> float:
    """What the referee holds the ego responsible for when the first agent (by id) brakes."""
    faster = [a._replace(v=a.v + decel * STEP) if k == 0 else a for k, a in enumerate(agents)]
    judge = referee(
        road,
        frame_of(road, 0.0, ego, *faster, signals=signals),
        *(road.edge_ids[k] for k in ego.route),
    )
    frame = frame_of(road, STEP, ego, *agents, signals=signals)
    n = len(agents)
    none = np.zeros(0, np.int32)
    way = np.array([lane(road, name) for name in path], dtype=np.int32)
    judge.observe(
        frame._replace(leader=(leader,) + ("",) * (n - 1), paths=(way,) + (none,) * (n - 1))
    )
    return judge.row()["imposed_max_decel_mps2"]  # type: ignore[no-any-return]


def test_braking_for_the_ego_as_leader() -> None:
    ego = ego_at(STRAIGHT, "a_1", 60.0, 5.0, route=edges(STRAIGHT, *ROUTE))
    assert imposed(STRAIGHT, ego, Agent("x", "a_1", 30.0), leader="ego") == pytest.approx(3.5)
    assert imposed(STRAIGHT, ego, Agent("x", "a_1", 30.0), leader="ego", decel=1.9) == 0.0
    assert (
        imposed(STRAIGHT, ego, Agent("x", "a_1", 90.0), leader="y", path=("a_1", ":m_1", "b_1"))
        == 0.0
    )  # it is in front


def test_braking_for_an_ego_on_the_path() -> None:
    ego = ego_at(STRAIGHT, "b_1", 5.0, 5.0, route=edges(STRAIGHT, "b", "c"))
    way = ("a_1", ":m_1", "b_1")
    assert imposed(STRAIGHT, ego, Agent("x", "a_1", 180.0), path=way) == pytest.approx(3.5)
    assert (
        imposed(STRAIGHT, ego, Agent("x", "a_1", 120.0, 11.0), path=way) == 0.0
    )  # 90 m ahead, more than 4 s
    assert imposed(STRAIGHT, ego, Agent("x", "a_1", 195.0, 0.5), path=way) == 0.0  # 15 m ahead
    assert (
        imposed(STRAIGHT, ego, Agent("x", "a_0", 190.0), path=("a_0", ":m_0", "b_0")) == 0.0
    )  # a neighbour
    changing = ego._replace(
        changing=0.2, change_from=lane(STRAIGHT, "b_1"), change_to=lane(STRAIGHT, "b_0")
    )
    assert imposed(
        STRAIGHT, changing, Agent("x", "a_0", 190.0), path=("a_0", ":m_0", "b_0")
    ) == pytest.approx(3.5)


def test_braking_for_an_ego_whose_rear_is_still_on_the_path() -> None:
    route = edges(STRAIGHT, "a", "d")
    ways = [
        ego_at(STRAIGHT, name, s, 4.0, route=route)
        for name, s in (("a_0", 199.0), (":mr_0", 1.0), (":mr_0", 3.0))
    ]
    judge = referee(STRAIGHT, frame_of(STRAIGHT, 0.0, ways[0]), "a", "d")
    path = np.array([lane(STRAIGHT, name) for name in ("a_0", ":m_0", "b_0")], dtype=np.int32)
    judge.observe(frame_of(STRAIGHT, 0.5, ways[1], Agent("x", "a_0", 185.0, 10.0)))
    judge.observe(
        frame_of(STRAIGHT, 1.0, ways[2], Agent("x", "a_0", 189.0, 8.5))._replace(paths=(path,))
    )
    assert judge.row()["imposed_max_decel_mps2"] == pytest.approx(3.0)


def test_braking_for_a_conflict_area() -> None:
    way, route = ("wi_0", ":we_0", "eo_0"), edges(CROSSING, "si", "no")
    oncoming = Agent("x", "wi_0", 70.0)
    assert imposed(
        CROSSING, ego_at(CROSSING, ":sn_0", 8.0, 4.0, route=route), oncoming, path=way
    ) == pytest.approx(3.5)
    assert imposed(
        CROSSING, ego_at(CROSSING, "si_0", 85.0, 8.0, route=route), oncoming, path=way
    ) == pytest.approx(3.5)  # in it within 2 s
    assert (
        imposed(CROSSING, ego_at(CROSSING, "si_0", 85.0, 2.0, route=route), oncoming, path=way)
        == 0.0
    )
    assert (
        imposed(CROSSING, ego_at(CROSSING, ":sn_0", 18.0, 4.0, route=route), oncoming, path=way)
        == 0.0
    )  # has left it
    assert (
        imposed(
            CROSSING,
            ego_at(CROSSING, ":sn_0", 8.0, 4.0, route=route),
            Agent("x", "wi_0", 20.0),
            path=way,
        )
        == 0.0
    )  # too far
    assert (
        imposed(
            CROSSING,
            ego_at(CROSSING, ":sn_0", 8.0, 4.0, route=route),
            Agent("x", ":we_0", 15.0),
            path=way[1:],
        )
        == 0.0
    )  # has passed it


def test_not_for_the_ego_on_a_bridge() -> None:
    assert (
        imposed(CROSSING, ego_at(CROSSING, "br_0", 100.0), Agent("x", "eo_0", 30.0), path=("eo_0",))
        == 0.0
    )


def test_braking_before_a_red_light_is_not_for_the_ego_behind_it() -> None:
    way, ego = (
        ("wi_0", ":we_0", "eo_0"),
        ego_at(SIGNALLED, ":sn_0", 8.0, 4.0, route=edges(SIGNALLED, "si", "no")),
    )
    assert (
        imposed(SIGNALLED, ego, Agent("x", "wi_0", 70.0), path=way, signals=lights(RED, GREEN, RED))
        == 0.0
    )
    assert imposed(
        SIGNALLED, ego, Agent("x", "wi_0", 70.0), path=way, signals=lights(GREEN, GREEN, RED)
    ) == pytest.approx(3.5)
    waits = ego_at(SIGNALLED, "si_0", 85.0, 8.0, route=edges(SIGNALLED, "si", "no"))
    assert (
        imposed(
            SIGNALLED, waits, Agent("x", "wi_0", 70.0), path=way, signals=lights(GREEN, RED, RED)
        )
        == 0.0
    )


def test_where_paths_merge_only_the_one_behind_brakes_for_the_other() -> None:
    way, route = ("si_0", ":sn_0", "no_0"), edges(CROSSING, "wi", "no")
    assert imposed(
        CROSSING,
        ego_at(CROSSING, ":wn_0", 12.0, 6.0, route=route),
        Agent("x", ":sn_0", 3.0, 6.0),
        path=way[1:],
    ) == pytest.approx(3.5)
    assert (
        imposed(
            CROSSING,
            ego_at(CROSSING, ":wn_0", 6.0, 6.0, route=route),
            Agent("x", ":sn_0", 15.0, 6.0),
            path=way[1:],
        )
        == 0.0
    )


def test_imposed_events_are_a_second_apart() -> None:
    ego = ego_at(STRAIGHT, "a_1", 60.0, 5.0)
    # time, deceleration that the follower begins to show
    shown = [2.5, 3.5, 4.5, 0.0, 2.5, 0.0, 0.0, 0.0, 2.2]
    v = 30.0
    judge = referee(STRAIGHT, frame_of(STRAIGHT, 0.0, ego, Agent("x", "a_1", 30.0, v)), *ROUTE)
    for k, decel in enumerate(shown, 1):
        v -= decel * STEP
        judge.observe(
            frame_of(STRAIGHT, k * STEP, ego, Agent("x", "a_1", 30.0, v))._replace(leader=("ego",))
        )
    row = judge.row()
    assert row["imposed_max_decel_mps2"] == pytest.approx(4.5)
    assert (row["imposed_brakes_2"], row["imposed_brakes_3"], row["imposed_brakes_4"]) == (2, 1, 1)
