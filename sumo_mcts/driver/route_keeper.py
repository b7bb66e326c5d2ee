"""The ego's route from cycle to cycle, on the map as it is now.

It is laid out at the take-over, and again where SUMO changed it, the road, the vehicle or the next
stop. It knows at which stop signs the ego has stood, and which stop it has given up.
"""

import math
from enum import Enum

import numpy as np

from sumo_mcts.config import ScenarioConfig
from sumo_mcts.driver.change_progress import as_seen
from sumo_mcts.driver.params import Physics, ego_params
from sumo_mcts.driver.stops import NONE_MISSED, is_missed
from sumo_mcts.model.caps import Pace
from sumo_mcts.model.local_map import State, ego_state
from sumo_mcts.model.motion import EgoParams
from sumo_mcts.model.route import RouteMap, is_rest_of, moved_to, route_map
from sumo_mcts.model.too_fast import with_time_to_brake
from sumo_mcts.numerics.lanes import usable, with_changes
from sumo_mcts.numerics.signals import shown
from sumo_mcts.road import RoadChanges, RoadMap
from sumo_mcts.scene import AFTER_STOP, NO_STOP, STANDING, EgoState, Memory, Scene, Stop

TOO_FAST = 0.05  # m/s beyond the limit under the ego that are no rounding
NEAR_STOP = 3.0  # m before a stop sign within which standing counts


class Kept(Enum):
    """What has become of the route."""

    AS_IT_WAS = 0
    RENEWED = 1  # laid out again along the same edges: who drives along it goes on
    OTHER = 2  # who drives along it starts anew


class RouteKeeper:
    """Keeps the route of one ego. Others read its fields, and only its methods change them."""

    def __init__(
        self, config: ScenarioConfig, road: RoadMap, physics: Physics, overtakes: bool
    ) -> None:
        """`overtakes`: the route has lanes of oncoming traffic, too."""
        self._config, self._physics, self._overtakes = config, physics, overtakes
        bound = config.ego_model.max_lateral_accel_mps2
        self._lateral_accel = math.inf if bound is None else bound
        self._map = self.road = road  # as it was read, and as it is now
        self._changes = RoadChanges()
        # as it is driven, and without the time to brake for changes; None: there is none
        self.route: RouteMap | None = None
        self._plain: RouteMap | None = None
        self.edges: tuple[int, ...] = ()
        self._vehicle: tuple[float, ...] = ()  # for which it was laid out, see _laid_for
        self.stood: dict[int, float] = {}  # node at whose stop line the ego has stood -> when
        self.stop, self.missed = NO_STOP, NONE_MISSED  # laid out for; given up last

    def keep(self, scene: Scene) -> Kept:
        """Lay the route out where there is none yet, or where SUMO changed it, the road, the
        vehicle or the next stop; a stop that cannot be served any more is given up."""
        kept, ego = self._follow(scene), scene.ego
        state = self.state(ego)
        if state is None or self.route is None or not is_missed(self.route, self.stop, state, ego):
            return kept
        self.missed, self.stop = self.stop, NO_STOP
        renewed = self._renew(ego, self.route, self._laid_out(ego, self.edges))
        return kept if kept is Kept.OTHER else renewed

    def recall(self, ego: EgoState, changes: RoadChanges, memory: Memory) -> None:
        """Go on as after the decisions that left this memory; `ego` and the `changes` of the map as
        they were then. Raises ValueError where it is no memory."""
        self._note_changes(changes)
        if memory.edges:
            self._lay_out(ego, memory.edges, memory.stop)
            self.stood = dict(zip(memory.stood, memory.stood_since, strict=True))

    def state(self, ego: EgoState) -> State | None:
        """Where the ego is on its route, if it is on it."""
        if self.route is None or ego.lane < 0:
            return None
        return ego_state(self.route, as_seen(self.road, ego))

    def params(self, ego: EgoState) -> EgoParams:
        """The ego's bounds."""
        return ego_params(self._config, ego, self._physics)

    def note_stand(self, route: RouteMap, state: State, scene: Scene) -> None:
        """Remember when the ego came to a stand at a stop sign, or a light that is one; the last
        time that it did, as all others see it."""
        node, to_line = state.node, route.length[state.node] - state.s
        since = scene.time - abs(scene.ego.standing_s)
        if node in self.stood and scene.ego.standing_s != 0.0:
            self.stood[node] = since
        if node in self.stood or state.v >= STANDING or to_line >= NEAR_STOP:
            return
        light = shown(scene.signals, int(route.signal[node]), int(route.link[node]))
        if node == route.halt.node:
            return  # SUMO says when a stop is served
        if route.sign[node] or light == AFTER_STOP:
            self.stood[node] = since

    def stood_s(self, state: State, time: float) -> float:
        """For how long (s) the ego has stood at the stop line of its lane; -inf: it has not."""
        return time - self.stood.get(state.node, math.inf)

    # --- when it is laid out ---

    def _follow(self, scene: Scene) -> Kept:
        """Lay the route out for what the scene shows."""
        ego, other_road = scene.ego, self._note_changes(scene.changes)
        stop = NO_STOP if ego.stop == self.missed else ego.stop
        if self.route is not None and is_rest_of(ego.route, self.edges):
            if stop != self.stop or other_road or self._vehicle != self._laid_for(ego):
                self.stop = stop
                return self._renew(ego, self.route, self._laid_out(ego, self.edges))
            if self._plain is not None:
                return self._renew(ego, self.route, self._plain)
            return Kept.AS_IT_WAS
        if not ego.route or -1 in ego.route:
            self.route = None
            return Kept.AS_IT_WAS
        self._lay_out(ego, ego.route, stop)
        return Kept.OTHER

    def _note_changes(self, changes: RoadChanges) -> bool:
        """Take the map as it is now. Returns whether it is another one than before."""
        before, self._changes = self._changes, changes
        if changes is before or all(
            np.array_equal(getattr(changes, name), getattr(before, name))
            for name in RoadChanges._fields
        ):
            return False
        self.road = with_changes(self._map, changes)
        return True

    def _renew(self, ego: EgoState, before: RouteMap, plain: RouteMap) -> Kept:
        """Go on along the same edges."""
        route = self._eased(ego, plain)
        if before is self._plain is plain is route:
            return Kept.AS_IT_WAS
        self._take(ego, plain, route)
        self.stood = moved_to(before, route, tuple(self.stood), tuple(self.stood.values()))
        return Kept.RENEWED

    def _lay_out(self, ego: EgoState, edges: tuple[int, ...], stop: Stop) -> None:
        """Begin a route along these edges, up to a stop."""
        self.edges, self.stood, self.stop = edges, {}, stop
        plain = self._laid_out(ego, edges)
        self._take(ego, plain, self._eased(ego, plain))

    def _take(self, ego: EgoState, plain: RouteMap, route: RouteMap) -> None:
        self._vehicle, self._plain, self.route = self._laid_for(ego), plain, route

    # --- how it is laid out ---

    def _laid_out(self, ego: EgoState, edges: tuple[int, ...]) -> RouteMap:
        """A route for the ego on the road as it is now."""
        return route_map(
            self.road,
            edges,
            ego.vclass,
            ego.length,
            ego.speed_factor,
            ego.max_speed,
            self.params(ego).approach_decel,
            self._closed_under(ego),
            self.stop,
            self._overtakes,
            self._lateral_accel,
        )

    def _eased(self, ego: EgoState, plain: RouteMap) -> RouteMap:
        """The route, with time to brake for what the simulation has changed: lanes, and what the
        vehicle itself may drive. That is told by an ego too fast for where it is. And one that is
        too fast for the end of a lane beside its stop brakes for it as its type does."""
        state = None if ego.lane < 0 else ego_state(plain, as_seen(self.road, ego))
        if state is None:
            return plain
        params, pace = self.params(ego), Pace(state.node, state.s, state.v, state.a)
        slower = state.v > float(plain.limit[state.node]) + TOO_FAST
        lowered = slower | np.isin(plain.lane, self._changes.lane)
        decels = (params.approach_decel, params.comfort_decel, ego.comfort_decel)
        return with_time_to_brake(plain, lowered, pace, decels, params.jerk, self.stop)

    def _closed_under(self, ego: EgoState) -> tuple[int, ...]:
        """The lanes under the ego that the simulation has closed to it."""
        changed = [i for i in (ego.lane, ego.change_from) if i in self._changes.lane]
        return tuple(i for i in changed if not usable(self.road, np.array([i]), ego.vclass)[0])

    def _laid_for(self, ego: EgoState) -> tuple[float, ...]:
        """What a route and the bounds of the ego depend on, beside the road."""
        return (
            ego.vclass,
            ego.length,
            ego.width,
            ego.max_speed,
            ego.speed_factor,
            ego.max_accel,
            ego.comfort_decel,
            ego.emergency_decel,
            ego.sideways.speed,
            *self._closed_under(ego),
        )
