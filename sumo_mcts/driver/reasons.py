"""Which agents have, or had a moment ago, a reason to stand: somebody right before them, or a red
light. Others that have stood for a while are taken to stay (`prediction.stays_after_s`)."""

import numpy as np

from sumo_mcts.arrays import Bools
from sumo_mcts.numerics.signals import shown
from sumo_mcts.prediction.behaviour import STAY_GAP, STAY_RED
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import GREEN, STANDING, Scene, Signals


class Reasons:
    """When each agent that stands was last seen to have a reason for it."""

    def __init__(self) -> None:
        self.seen: dict[str, float] = {}  # by id: simulation time, s

    def lately(self, road: RoadMap, scene: Scene, seconds: float) -> Bools:
        """[N] which agents have a reason now, or had one less than `seconds` ago. Remembers it."""
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
    agents, ego = scene.agents, scene.ego
    found = np.zeros(len(agents.ids), np.bool_)
    x, y = np.append(agents.x, ego.x), np.append(agents.y, ego.y)
    half_length = 0.5 * np.append(agents.length, ego.length)
    half_width = 0.5 * np.append(agents.width, ego.width)
    for i in np.flatnonzero((agents.v <= STANDING) & (agents.lane >= 0) & ~agents.person):
        cosine, sine = np.cos(agents.heading[i]), np.sin(agents.heading[i])
        ahead = (x - x[i]) * cosine + (y - y[i]) * sine
        aside = np.abs((y - y[i]) * cosine - (x - x[i]) * sine)
        gap = ahead - half_length - half_length[i]
        others = (ahead > 0.0) & (gap <= STAY_GAP) & (aside < half_width + half_width[i])
        found[i] = others.any() or _is_red(road, scene.signals, int(agents.lane[i]), agents.s[i])
    return found


def _is_red(road: RoadMap, signals: Signals, lane: int, s: float) -> bool:
    """Whether no way on from this place is open, and a light is the cause."""
    if road.length[lane] - s > STAY_RED:
        return False
    ways = road.successor[road.successor_offset[lane] : road.successor_offset[lane + 1]]
    lights = [int(way) for way in ways if road.signal[way] >= 0]
    return len(lights) == len(ways) > 0 and all(
        shown(signals, int(road.signal[way]), int(road.link[way])) != GREEN for way in lights
    )
