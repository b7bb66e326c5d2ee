"""What drivers do if the ego does one thing or another: the same state asked twice of a copy of the
simulation."""

from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Ints
from sumo_mcts.driver.params import traffic_params
from sumo_mcts.episode.loop import Loop
from sumo_mcts.evaluation.driver_events import Course, enters
from sumo_mcts.model.reactions import HELPS
from sumo_mcts.numerics.lanes import successors, usable
from sumo_mcts.prediction.forecast import Question, predict
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Follow, Scene

SECONDS = 3.0
LESS = 0.5  # m/s slower than without it: a driver makes room
REACH = 60.0  # m behind the ego within which the follower of a gap matters
WAITING = 3.0  # m/s2 with which the ego stops
LANES_AHEAD = 8  # of the ego's way after a change

CHANGES, ASKS, WAITS = "makes room, ego changes", "makes room, ego asks", "enters, ego stops"


class Reaction(NamedTuple):
    """The answer to one conditional question about one agent."""

    question: str
    present: float  # the probability that the planner's model gives
    happened: bool


def reactions(loop: Loop, scene: Scene, lanes: Ints, owing: Bools) -> list[Reaction]:
    """What copies of the simulation answer in this cycle.

    `lanes`: that the ego is going to drive; `owing` [N]: who has to let the ego pass.
    """
    ask = Asker(loop, scene)
    found = []
    for side, beside in ((-1, loop.world.road.right), (1, loop.world.road.left)):
        lane = int(beside[scene.ego.lane])
        gap = follower_gap(loop.world.road, scene, lane)
        if gap is not None:
            found += _of_follower(ask, lanes, side, lane, gap)
    if owing.any():
        found += _of_owing(ask, lanes, owing)
    return found


def _of_follower(
    ask: "Asker", lanes: Ints, side: int, lane: int, gap: tuple[int, float]
) -> list[Reaction]:
    """Whether the follower of a gap on that side, on `lane`, makes room."""
    found, scene, (agent, room) = [], ask.scene, gap
    keeps = np.full(ask.steps, scene.ego.v)
    without = ask.copy(Follow(keeps, 0))
    if scene.ego.asks == side:
        closing = max(0.0, float(scene.agents.v[agent]) - scene.ego.v)
        helps = closing * closing <= 2.0 * HELPS * room  # as in model/reactions.py
        brakes = slower(without, ask.copy(Follow(keeps, 0, side)), agent)
        found.append(Reaction(ASKS, float(helps), brakes))
    way = straight_from(ask.road, lane)
    expected = slower(ask.forecast(lanes, keeps), ask.forecast(way, keeps), agent)
    brakes = slower(without, ask.copy(Follow(keeps, side)), agent)
    return [*found, Reaction(CHANGES, float(expected), brakes)]


def _of_owing(ask: "Asker", lanes: Ints, owing: Bools) -> list[Reaction]:
    """Whether those that have to let the ego pass enter the junction where it stops."""
    scene, now = ask.scene, ask.scene.agents.lane
    stops = np.maximum(scene.ego.v - WAITING * scene.step * np.arange(1, ask.steps + 1), 0.0)
    truth, guess = ask.copy(Follow(stops, 0)), ask.forecast(lanes, stops)
    true, guessed = (enters(ask.road, now, each, each) for each in (truth, guess))
    return [
        Reaction(WAITS, float(guessed[i]), bool(true[i]))
        for i in np.flatnonzero(owing & truth.there.all(axis=0))
    ]


def follower_gap(road: RoadMap, scene: Scene, lane: int) -> tuple[int, float] | None:
    """The nearest agent behind the ego in the lane beside it, and m to the ego's rear; None where
    there is none, or the lane beside the ego is occupied."""
    ego, agents = scene.ego, scene.agents
    if lane < 0 or not usable(road, np.array([lane], np.int32), ego.vclass)[0]:
        return None
    there = agents.lane == lane
    beside = there & (agents.s > ego.s - ego.length) & (agents.s - agents.length < ego.s)
    room = ego.s - ego.length - agents.s
    behind = np.flatnonzero(there & (room > 0.0) & (room < REACH))
    if beside.any() or not len(behind):
        return None
    nearest = int(behind[np.argmin(room[behind])])
    return nearest, float(room[nearest])


def straight_from(road: RoadMap, lane: int) -> Ints:
    """[K] a lane, and those that follow it, the first of several."""
    lanes = [lane]
    while len(lanes) < LANES_AHEAD and (after := successors(road, lanes[-1])):
        lanes.append(after[0])
    return np.array(lanes, np.int32)


class Asker:
    """Asks copies of the simulation, and the planner's model, in one cycle."""

    def __init__(self, loop: Loop, scene: Scene) -> None:
        self.scene, self.road = scene, loop.world.road
        self.steps = round(SECONDS / scene.step)
        self._clone = loop.oracles.clone
        self._params = traffic_params(loop.config, loop.world.physics)

    def copy(self, command: Follow) -> Course:
        """What a copy does if the ego carries out the command."""
        dt, count = self._params.step, round(SECONDS / self._params.step) + 1
        found = self._clone(self.scene, command, dt, count)
        shape = (count, len(self.scene.agents.ids))
        lane, there, v = np.full(shape, -1, np.int32), np.zeros(shape, np.bool_), np.zeros(shape)
        for i, states in found.items():
            lane[:, i], there[:, i], v[:, i] = states.lane, states.valid, states.v
        return Course(dt, v, lane, there)

    def forecast(self, lanes: Ints, speeds: Floats) -> Course:
        """What the model has the agents do if the ego drives on these lanes with these speeds."""
        every = max(1, round(self._params.step / self.scene.step))
        nominal = speeds[every - 1 :: every]
        found = predict(self.road, Question(self.scene, lanes, nominal, self._params, SECONDS))
        return Course(found.dt, found.v[0], found.lane[0], found.valid[0])


def slower(without: Course, course: Course, agent: int) -> bool:
    """Whether the agent is LESS slower at some time than it is in the course without."""
    both = without.there[:, agent] & course.there[:, agent]
    return bool(((without.v - course.v)[both, agent] > LESS).any())
