"""Which agents have, or had a moment ago, a reason to stand: somebody right before them, or a red
light. Others that have stood for a while are taken to stay (`prediction.stays_after_s`)."""

import numpy as np

from sumo_mcts.arrays import Bools, Indices
from sumo_mcts.model.agent_tables import levels
from sumo_mcts.numerics.lanes import successors
from sumo_mcts.numerics.signals import shown
from sumo_mcts.prediction.behaviour import STAY_GAP, STAY_RED
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import AFTER_STOP, GREEN, STANDING, Scene, Signals


class Reasons:
    """When each agent that stands was last seen to have a reason for it."""

    def __init__(self) -> None:
        self.seen: dict[str, float] = {}  # by id: simulation time, s

    def lately(self, road: RoadMap, scene: Scene, seconds: float) -> Bools:
        """[N] which agents have a reason now, or had one up to `seconds` ago. Remembers it."""
        agents, now = scene.agents, scene.time
        has = has_reason(road, scene)
        before = {name: time for name, time in self.seen.items() if now - time <= seconds}
        self.seen = {
            name: now if has[i] else before[name]
            for i, name in enumerate(agents.ids)
            if has[i] or (name in before and agents.v[i] <= STANDING)
        }
        return np.array([name in self.seen for name in agents.ids], np.bool_)


def has_reason(road: RoadMap, scene: Scene) -> Bools:
    """[N] which agents stand right behind somebody, the ego included, or close before a red
    light."""
    agents = scene.agents
    found = np.zeros(len(agents.ids), np.bool_)
    stands = np.flatnonzero((agents.v <= STANDING) & (agents.lane >= 0) & ~agents.person)
    if len(stands):
        found[stands] = _is_behind(road, scene, stands)
    for i in stands[~found[stands]].tolist():
        found[i] = _is_before_red(road, scene.signals, int(agents.lane[i]), agents.s[i])
    return found


def _is_behind(road: RoadMap, scene: Scene, those: Indices) -> Bools:
    """[K] which of the agents `those` [K] have somebody within STAY_GAP straight ahead, on no other
    level."""
    agents, ego = scene.agents, scene.ego
    x, y = np.append(agents.x, ego.x), np.append(agents.y, ego.y)
    heading, lane = np.append(agents.heading, ego.heading), np.append(agents.lane, ego.lane)
    half_length = 0.5 * np.append(agents.length, ego.length)
    half_width = 0.5 * np.append(agents.width, ego.width)
    dx, dy = x - x[those, None], y - y[those, None]
    cosine, sine = np.cos(heading[those, None]), np.sin(heading[those, None])
    ahead, aside = dx * cosine + dy * sine, np.abs(dy * cosine - dx * sine)
    turned = heading - heading[those, None]
    cosine, sine = np.abs(np.cos(turned)), np.abs(np.sin(turned))
    gap = ahead - half_length * cosine - half_width * sine - half_length[those, None]
    across = half_length * sine + half_width * cosine + half_width[those, None]
    there = np.where(lane >= 0, lane, 0).astype(np.int64)
    touch = (lane < 0) | (levels(road, agents.lane[those].astype(np.int64), there) > 0)
    before = touch & (ahead > 0.0) & (gap <= STAY_GAP) & (aside < across)
    return np.asarray(before.any(axis=1), np.bool_)


def _is_before_red(road: RoadMap, signals: Signals, lane: int, s: float) -> bool:
    """Whether no way on from this place is open, and a light is the cause."""
    if road.length[lane] - s > STAY_RED:
        return False
    ways = successors(road, lane)
    lights = [way for way in ways if road.signal[way] >= 0]
    return len(lights) == len(ways) > 0 and all(
        shown(signals, int(road.signal[way]), int(road.link[way])) not in (GREEN, AFTER_STOP)
        for way in lights
    )
