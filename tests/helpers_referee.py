"""A referee on small hand-made roads."""

from typing import Any

from helpers import (
    crossing,
    edge,
    edges,
    ego_at,
    frame_of,
    straight_road,
)

from sumo_mcts.evaluation.goal import Goal
from sumo_mcts.evaluation.referee import Referee
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Frame

ROUTE = ("a", "b", "c")
STRAIGHT = straight_road()
CROSSING = crossing()
SIGNALLED = crossing("c")
STEP = 0.5


def referee(
    road: RoadMap,
    first: Frame,
    *route: str,
    success: str = "",
    limit: float = 100.0,
    step: float = STEP,
) -> Referee:
    return Referee(
        road,
        Goal(edges(road, *route), edge(road, success) if success else -1, limit, 20.0),
        step,
        first,
    )


def drive(
    road: RoadMap,
    where: list[tuple[str, float]],
    route: tuple[str, ...],
    v: float = 10.0,
    step: float = STEP,
    **goal: Any,
) -> tuple[Referee, str | None]:
    """The referee and its verdict for an ego at these lane positions, one for each step."""
    states = [ego_at(road, name, s, v, route=edges(road, *route)) for name, s in where]
    judge = referee(road, frame_of(road, 0.0, states[0]), *route, step=step, **goal)
    outcome = None
    for k, ego in enumerate(states[1:], 1):
        outcome = judge.observe(frame_of(road, k * step, ego))
    return judge, outcome
