"""Where an ego has to go, and how far it has come on its route."""

from collections.abc import Iterable
from math import isfinite, nan
from typing import NamedTuple

from sumo_mcts.evaluation.metrics import crossing_time, free_flow_time
from sumo_mcts.evaluation.reachability import REACH
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import EgoState


class Goal(NamedTuple):
    """Where the ego has to go, and until when."""

    # its route at departure: the first edge is where it departed, the last the goal
    edges: tuple[int, ...]
    # -1: arrived at the end of the goal edge; else as soon as the front is on this edge or on one
    # after it
    success_edge: int
    time_limit: float  # s after departure
    free_flow: float  # s; nan unknown
    per_free_flow: float = 0.0  # s of the time limit for each s of free_flow


class RouteProgress:
    """The edges of its route that one ego has passed."""

    def __init__(self, road: RoadMap, goal: Goal) -> None:
        self._road, self._goal = road, goal
        # position on the route, as an index into goal.edges; the success edge may come twice on it,
        # the last time counts
        self._at = 0
        self._success = max(
            (k for k, edge in enumerate(goal.edges) if edge == goal.success_edge), default=-1
        )
        self._on_goal = False
        self.arrived = False

    def advance(self, lanes: Iterable[int]) -> None:
        """Follow the route along the lanes that the front has come over."""
        edges, success = self._goal.edges, self._goal.success_edge
        for lane in lanes:
            edge = int(self._road.edge[lane])
            left_goal = self._on_goal and edge != edges[-1]
            if edge in edges[self._at :]:
                self._at = edges.index(edge, self._at)
            self._on_goal = edge == edges[-1] and self._at == len(edges) - 1
            if success < 0:
                self.arrived |= left_goal
            else:
                self.arrived |= edge == success if self._success < 0 else self._at >= self._success

    def free_flow_left(self, ego: EgoState) -> float | None:
        """Free-flow time, s, from where the ego is to the end of its route; None off the route."""
        road, ahead = self._road, self._goal.edges[self._at :]
        if ego.lane < 0:
            return None
        crossing, lane = crossing_time(road, ego.lane, ego.s, ego)
        inside = lane != ego.lane
        if int(road.edge[lane]) not in ahead[inside : inside + 1]:
            return None
        return crossing + free_flow_time(road, ahead[inside:], 0.0 if inside else ego.s, ego)

    def rerouted(self, ego: EgoState, elapsed: float) -> Goal | None:
        """The goal of an ego whose route has another end now, `elapsed` s after departure: that
        end. None: its route still leads to the goal, or to no place outside junctions."""
        old = self._goal
        if not ego.route or -1 in ego.route or old.edges[-1] in ego.route:
            return None
        if self._road.edge_ids[ego.route[-1]].startswith(":"):
            return None
        left = self.free_flow_left(ego)
        driven = elapsed if left is None or not isfinite(old.free_flow) else old.free_flow - left
        new = old._replace(edges=ego.route)
        left = RouteProgress(self._road, new).free_flow_left(ego)
        if left is None or not isfinite(left):
            return new._replace(free_flow=nan)
        limit = old.time_limit
        if isfinite(old.free_flow):
            limit += old.per_free_flow * (driven + left - old.free_flow)
        return new._replace(free_flow=driven + left, time_limit=limit)

    def ends_at_goal(self, last: EgoState | None, step: float) -> bool:
        """Whether an ego that SUMO has removed had reached the edge of the goal, or reached it
        within its last step (s). `last`: the last state before."""
        edges, road = self._goal.edges, self._road
        goal = self._success if self._goal.success_edge >= 0 else len(edges) - 1
        if goal <= self._at or last is None or last.lane < 0:
            return 0 <= goal <= self._at
        between = sum(
            float(road.length[road.edge == edge].min()) for edge in edges[self._at + 1 : goal]
        )
        rest = float(road.length[last.lane]) - last.s + between
        return rest <= 1.5 * last.v * step + REACH
