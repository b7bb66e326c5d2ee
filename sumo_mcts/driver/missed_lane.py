"""What becomes of an ego in a lane that does not lead on along its route: it waits for a gap, and
takes another way to its goal where that is in vain."""

from collections import Counter
from math import inf

from sumo_mcts.config import ScenarioConfig
from sumo_mcts.driver.missed_stop import all_red, waits_beside
from sumo_mcts.model.continuation import changes_onward, leads_onto, missed_leg
from sumo_mcts.numerics.lanes import against_traffic, with_changes
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import STANDING, EgoState, Scene
from sumo_mcts.world import detour

NAMED = 3  # edges of a new way that are named, beside its last


class MissedLane:
    """Watches one ego, decision by decision.

    A way that was taken before is taken again only after a wait twice as long, so that an ego that
    comes back to the same lane's end neither goes round and round nor stands there for ever.
    """

    def __init__(self, vehicle: str, road: RoadMap, config: ScenarioConfig, period: float) -> None:
        """`period`: s between two decisions."""
        self._vehicle, self._road, self._period = vehicle, road, period
        self._patience = config.ego_model.reroute_after_s
        self._named = {ego.until for ego in config.egos if ego.id == vehicle}
        self._named.add(config.episode.success_edge)
        self._taken: Counter[tuple[str, ...]] = Counter()
        self._time = -inf  # of the last scene, s
        self._route: tuple[int, ...] = ()  # the ego's then; it tells the edge, too
        self._stood = 0.0  # s, on this edge in a lane that does not lead on
        self._wait = 0.0  # s to stand before the next try
        self._tried = False  # on this edge
        self._said = ""
        self._asked: tuple[object, ...] = ()  # what the answer of changes_onward rests on
        self._needed: int | None = None  # and that answer
        self.reroutes = 0  # so far

    def note(self, scene: Scene) -> str:
        """Look at the scene of a decision, and give the ego another route where it is time to.

        Returns what was done in words, "" where nothing was. The scene then has the old route.
        """
        if scene.time > self._time:
            self._said = "" if self._patience is None else self._judged(scene)
        self._time = scene.time
        return self._said

    def _judged(self, scene: Scene) -> str:
        ego, patience, road = scene.ego, self._patience, with_changes(self._road, scene.changes)
        assert patience is not None, "note() asks"
        if ego.route != self._route:
            self._route, self._stood, self._wait, self._tried = ego.route, 0.0, patience, False
        if ego.lane < 0 or road.internal[ego.lane] or ego.changing > 0.0:
            return ""
        if against_traffic(road)[ego.lane]:
            return ""  # it overtakes
        needed = self._changes_onward(road, scene)
        if needed == 0:
            return ""
        if not ego.held and not waits_beside(road, scene) and _blocked(road, scene):
            # SUMO may have driven in between
            self._stood += min(scene.time - self._time, self._period)
        certain = needed is None and not self._tried
        return self._leave(ego, road, certain) if certain or self._stood >= self._wait else ""

    def _changes_onward(self, road: RoadMap, scene: Scene) -> int | None:
        """As the function; it looks along the whole route, so the last answer is kept."""
        ego = scene.ego
        asked = (ego.route, ego.vclass, ego.lane, *(each.tobytes() for each in scene.changes))
        if asked != self._asked:
            self._asked = asked
            self._needed = changes_onward(road, ego.route, ego.vclass, ego.lane)
        return self._needed

    def _leave(self, ego: EgoState, road: RoadMap, certain: bool) -> str:
        """Take the best other way; `certain`: no lane change is left, and it has not waited."""
        ids, self._tried = self._road.edge_ids, True
        route = [ids[edge] for edge in ego.route]
        leg, lanes = missed_leg(road, ego.route, ego.vclass, ego.lane)
        onto = {edge for lane in lanes for edge in leads_onto(road, lane, ego.vclass)}
        missed = route[min(leg + 1, len(route) - 1)]
        why = "no lane change leads there" if certain else f"stood there {self._stood:.0f} s"
        lane = f"{self._road.lane_ids[ego.lane]} does not lead to {missed}; {why}"
        stops = detour.stop_edges(self._vehicle)
        edges = [ids[edge] for edge in sorted(onto)]
        for way in self._ways(route, leg, edges, stops, keeps_all=certain):
            wait = float(self._patience or 0.0) * 2.0 ** self._taken[way]
            if self._taken[way] and self._stood < wait:
                self._wait = wait
                return ""
            self._taken[way] += 1
            if detour.take(self._vehicle, way):
                self.reroutes += 1
                left_out = tuple((Counter(stops) - Counter(way)).elements())
                without = f", without its stop on {_short(left_out)}" if left_out else ""
                return f"takes another way, by {_short(way[1:])}{without}: {lane}"
        self._stood = 0.0
        return f"waits on, since no other way leads from here to the goal: {lane}"

    def _ways(
        self, route: list[str], leg: int, onto: list[str], stops: list[str], *, keeps_all: bool
    ) -> list[tuple[str, ...]]:
        """The other ways, which leave the route after its edge number `leg`, with what it has after
        the next edge where the ego has to be; those taken least often first, then the quickest.

        Where there are none, and it need not keep all `stops` (edges), those that leave out the
        fewest of them.
        """
        must = {*self._named, route[-1]}
        for until in range(leg + 1, len(route)):
            if route[until] not in must and route[until] not in stops:
                continue
            found = [
                (way.seconds, (*route[: leg + 1], *way.edges, *route[until + 1 :]))
                for way in detour.ways(self._vehicle, onto, route[until])
            ]
            others = [(self._taken[way], time, way) for time, way in found if way != tuple(route)]
            if others or keeps_all or route[until] in must:
                return [way for _, _, way in sorted(others)]
        return []


def _blocked(road: RoadMap, scene: Scene) -> bool:
    """Whether the ego stands as the first in its lane, and no red light would keep it from going
    on."""
    ego, agents = scene.ego, scene.agents
    if ego.v >= STANDING or ((agents.lane == ego.lane) & (agents.s > ego.s)).any():
        return False
    return not all_red(road, scene)


def _short(edges: tuple[str, ...]) -> str:
    """The first edges of a way and its last."""
    return " ".join(edges if len(edges) <= NAMED + 1 else (*edges[:NAMED], "...", edges[-1]))
