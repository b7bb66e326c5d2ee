"""Overtaking on the lane of the oncoming traffic: the ego is then judged as if on its own side.

SUMO names the oncoming lane, on which the ego drives backwards, and which may lead nowhere that the
ego goes.
"""

from math import atan2, cos

from sumo_mcts.evaluation.reachability import REACH, driven
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import EgoState, Frame


class OwnSide:
    """Knows the lane that one ego has left for an oncoming one."""

    def __init__(self, road: RoadMap, step: float) -> None:
        """`step` in s."""
        self._road, self._step = road, step
        self._home, self._oncoming = -1, -1  # the lane left, and the edge that it drives on

    def seen(self, before: EgoState, frame: Frame) -> Frame:
        """The frame, its ego at the same height of the lane that it left where it overtakes.

        `before`: its state a step earlier, on its own side.
        """
        road, ego = self._road, frame.ego
        edge = int(road.edge[ego.lane]) if ego.lane >= 0 else -1
        if edge != self._oncoming:
            begins = before.lane >= 0 and edge >= 0 and self._crosses_over(before, ego)
            self._home, self._oncoming = (before.lane, edge) if begins else (-1, -1)
        if self._home < 0:
            return frame
        share = 1.0 - ego.s / float(road.length[ego.lane])
        mirrored = ego._replace(lane=self._home, s=share * float(road.length[self._home]))
        return frame._replace(ego=mirrored)

    def _crosses_over(self, before: EgoState, ego: EgoState) -> bool:
        """Whether the ego came aside onto a lane that leads the other way."""
        road = self._road
        if road.edge[before.lane] == road.edge[ego.lane] or road.internal[ego.lane]:
            return False
        reach = 1.5 * max(before.v, ego.v) * self._step + REACH
        if driven(road, before.lane, before.s, ego.lane, ego.s, reach) is not None:
            return False
        first = int(road.point_offset[ego.lane])
        (x, y), (end_x, end_y) = (
            road.points[first],
            road.points[road.point_offset[ego.lane + 1] - 1],
        )
        return cos(ego.heading - atan2(end_y - y, end_x - x)) < 0.0
