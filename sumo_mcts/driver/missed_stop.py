"""What becomes of an ego that finds no gap in the lane of its next stop: it stands beside the place
and waits, and goes on without the stop where that is in vain."""

from math import inf

import numpy as np

from sumo_mcts.config import ScenarioConfig
from sumo_mcts.model.continuation import leads_onto
from sumo_mcts.numerics.lanes import against_traffic, usable
from sumo_mcts.numerics.signals import shows
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import NO_STOP, RED, STANDING, Scene, Stop
from sumo_mcts.world.stops import skip_next


class MissedStop:
    """Watches one ego, decision by decision."""

    def __init__(self, vehicle: str, road: RoadMap, config: ScenarioConfig, period: float) -> None:
        """`period`: s between two decisions."""
        self._vehicle, self._road, self._period = vehicle, road, period
        self._patience = config.ego_model.reroute_after_s
        self._lane, self._after = NO_STOP.lane, NO_STOP.after  # which stop it is
        self._stood = 0.0  # s, beside it
        self._time, self._said = -inf, ""  # of the last scene, s, and what was done then

    def note(self, scene: Scene) -> str:
        """Look at the scene of a decision, and strike the stop off where it is time to.

        Returns what was done in words, "" where nothing was. The scene then has the stop still.
        """
        if scene.time > self._time:
            passed = min(scene.time - self._time, self._period)  # SUMO may have driven in between
            self._said = self._judged(scene, passed)
        self._time = scene.time
        return self._said

    def _judged(self, scene: Scene, passed: float) -> str:
        stop = scene.ego.stop  # its place may change, behind others
        if (stop.lane, stop.after) != (self._lane, self._after):
            self._lane, self._after, self._stood = stop.lane, stop.after, 0.0
        if scene.ego.lane == stop.lane and scene.ego.v >= STANDING:
            self._stood = 0.0  # the queue moves on
        where = "beside it" if waits_beside(self._road, scene) else "behind others"
        if self._patience is None or not (where == "beside it" or _is_behind(self._road, scene)):
            return ""
        self._stood += passed
        if self._stood < self._patience:
            return ""
        skip_next(self._vehicle)
        stood, self._stood = self._stood, 0.0  # the next one may be on the same lane
        return f"gives up {named(self._road, stop)}: stood {where} {stood:.0f} s"


def waits_beside(road: RoadMap, scene: Scene) -> bool:
    """Whether the ego stands in a lane beside that of its stop, and nobody stands before it up to
    the place."""
    ego, stop = scene.ego, scene.ego.stop
    return _stands_before(road, scene) and ego.lane != stop.lane and not _between(scene, ego.lane)


def _is_behind(road: RoadMap, scene: Scene) -> bool:
    """Whether the ego stands in the lane of its stop behind others who stand before the place,
    while it could drive past them on another lane of its direction."""
    ego, stop = scene.ego, scene.ego.stop
    if not _stands_before(road, scene) or ego.lane != stop.lane or not _between(scene, ego.lane):
        return False
    if all_red(road, scene):
        return False  # they wait for green
    beside = np.array([road.left[ego.lane], road.right[ego.lane]])
    ours = (beside >= 0) & ~against_traffic(road)[beside]
    beside = beside[ours & usable(road, beside, ego.vclass)]
    return any(not _between(scene, lane) for lane in beside)


def _stands_before(road: RoadMap, scene: Scene) -> bool:
    """Whether the ego stands on the edge of the stop at which it has to stand next."""
    ego, stop = scene.ego, scene.ego.stop
    if min(ego.lane, stop.lane) < 0 or ego.held or ego.v >= STANDING or not stop.ends:
        return False
    return road.edge[ego.lane] == road.edge[stop.lane] and stop.after == len(ego.route) - 1


def _between(scene: Scene, lane: int) -> bool:
    """Whether anybody stands in a lane between the ego and the place of its stop."""
    ego, agents = scene.ego, scene.agents
    ahead = (agents.s > ego.s - ego.length) & (agents.s - agents.length < ego.stop.place)
    return bool(((agents.lane == lane) & ahead & (agents.v < STANDING)).any())


def all_red(road: RoadMap, scene: Scene) -> bool:
    """Whether red lights keep everybody in the ego's lane from going on."""
    onto = leads_onto(road, scene.ego.lane, scene.ego.vclass)
    onward = [lane for lanes in onto.values() for lane in lanes]
    return bool(onward) and all(shows(scene.signals, road, lane) == RED for lane in onward)


def named(road: RoadMap, stop: Stop) -> str:
    """A stop in words."""
    return f"its stop on {road.lane_ids[stop.lane]} at {stop.place:.0f} m"
