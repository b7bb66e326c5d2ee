"""The goal of an ego and its time limit, from the scenario and the ego's route."""

import math

from sumo_mcts.config import ScenarioConfig
from sumo_mcts.errors import ConfigError
from sumo_mcts.evaluation.goal import Goal
from sumo_mcts.evaluation.metrics import free_flow_time
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import EgoState
from sumo_mcts.world.roadmap import has_edge

FREE_FLOWS = 3.0  # the default time limit in free-flow times, and
LIMIT_SLACK_S = 120.0  # what comes on top: see measures.md


def check_edges(config: ScenarioConfig, road: RoadMap) -> None:
    """Raise ConfigError where the scenario names an edge that the network does not have."""
    for ego in config.egos:
        if ego.until is not None:
            has_edge(road, ego.until, f"egos: {ego.id}: until")
    if config.episode.success_edge is not None:
        has_edge(road, config.episode.success_edge, "episode.success_edge")


def goal_of(config: ScenarioConfig, road: RoadMap, ego: EgoState, until: str | None) -> Goal:
    """Where the ego has to go. `until`: its goal edge, else the last of its route.

    Raises ConfigError where it cannot get there.
    """
    if -1 in ego.route or not ego.route:
        raise ConfigError(f"egos: {ego.id}: its route leaves the network")
    end = len(ego.route) - 1
    if until is not None:
        end = _place(road, ego, until, f"egos: {ego.id}: until")
    success = config.episode.success_edge
    if success is not None:  # the success point may lie beyond the goal
        end = max(end, _place(road, ego, success, "episode.success_edge"))
    edges = ego.route[: end + 1]
    free = free_flow_time(road, edges, ego.s, ego)
    if not math.isfinite(free):
        raise ConfigError(
            f"egos: {ego.id}: its route does not connect: "
            f"{' '.join(road.edge_ids[edge] for edge in edges)}"
        )
    given = config.episode.stop_time_s or config.episode.time_limit_s
    return Goal(
        edges=edges,
        success_edge=road.edge_ids.index(success) if success is not None else -1,
        time_limit=given or FREE_FLOWS * free + LIMIT_SLACK_S,
        free_flow=free,
        per_free_flow=0.0 if given else FREE_FLOWS,
    )


def _place(road: RoadMap, ego: EgoState, edge: str, key: str) -> int:
    """Index of an edge on the ego's route. Raises ConfigError, which names `key`."""
    route = [road.edge_ids[index] for index in ego.route]
    if edge not in route:
        raise ConfigError(
            f"{key}: the route of {ego.id} does not pass edge {edge}, only {' '.join(route)}"
        )
    return route.index(edge)
